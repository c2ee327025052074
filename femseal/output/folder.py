"""The folder of a run: every file a user may want to look at."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..topography import Topography
from .files import made_folder, replacing, write_text
from .maps import seal_figure, surface_figure
from .plots import cells_figure, leakage_figure
from .results import Results, save
from .tables import csv_text
from .vtk import write_vtk

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_folder(results: Results, folder: str | os.PathLike[str], surface: Topography | None = None) -> list[Path]:
    """Write `results.nc`, `table.csv`, the pictures and, in `vtk/`, the files for ParaView.

    Parameters
    ----------
    results : of a run; pictures and fields that they have nothing for are left out.
    folder : made if needed; files of the same name are replaced, each whole or not at all.
    surface : the combined heights, for `surface.png` and the fields; None: without.

    Returns
    -------
    Paths of all files written.

    Raises
    ------
    InputError : the folder cannot be made.
    """
    target = made_folder(folder)
    data = results.dataset
    pictures: dict[str, Callable[[], Figure]] = {"leakage.png": lambda: leakage_figure(results)}
    if "library_k" in data or "k1" in data:
        pictures["cells.png"] = lambda: cells_figure(results)
    if "k1" in data:
        pictures["seal.png"] = lambda: seal_figure(results)
    if surface is not None:
        pictures["surface.png"] = lambda: surface_figure(surface)
    written = [save(results, target), write_text(target / "table.csv", csv_text(results))]
    for name, picture in pictures.items():
        figure = picture()
        with replacing(target / name) as temporary:
            figure.savefig(temporary)
        written.append(target / name)
    if "k1" in data or surface is not None:
        written += write_vtk(results, surface, target / "vtk")
    return written

"""Files for ParaView: the seal at every load step, a few windows seen closely, and the heights."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..base.errors import InputError
from ..base.files import made_folder
from ..topography import Topography
from . import series, vtkhdf
from .drawn_seal import drawn_cells
from .interpolated import solved_steps
from .views import Heights, View, seal_grid, window_images

if TYPE_CHECKING:
    from .results import Results

#: Formats: the series, which every ParaView opens; VTKHDF for ParaView 5.13 or later; both; or none.
FORMATS = ("vtu", "vtkhdf", "both", "none")


def write_vtk(
    results: Results, surface: Topography | None, folder: str | os.PathLike[str], file_format: str = "vtu"
) -> list[Path]:
    """Write the views of results; open the `.pvd` or the `.vtkhdf` files in ParaView.

    Parameters
    ----------
    results : of a two-scale study: `seal`, the windows of the whole seal at every step; with the study's own fields in
        memory also `window_i_j`, gap, contact pressure and fluid pressure in the windows with the largest, median and
        smallest k1 > 0 at the highest load; of a stochastic study: `drawn`, the seal nearest to the median at every
        step.
    surface : heights, for `surface` [µm]; None: not written.
    folder : made if needed. Each file is written whole or not at all, a `.pvd` after the files it names.
    file_format : "vtu" (series of `.vtu`, images of windows as `.vti`), "vtkhdf", "both" or "none".

    Returns
    -------
    Paths of all files.

    Raises
    ------
    InputError : the folder cannot be made, or another format.
    """
    if file_format not in FORMATS:
        raise InputError("file_format", file_format, f"one of {', '.join(FORMATS)}")
    if file_format == "none":
        return []
    if (solved := solved_steps(results.dataset)).size < results.dataset.sizes["step"]:
        results = replace(results, dataset=results.dataset.isel(step=solved))
    views: list[View] = [seal_grid(results.dataset)] if "k1" in results.dataset else []
    views += [drawn_cells(results.dataset)] if "drawn_corners" in results.dataset else []
    views += window_images(results)
    views += [] if surface is None else [Heights(surface)]
    target = made_folder(folder)
    writers = [module.write for name, module in (("vtu", series), ("vtkhdf", vtkhdf)) if file_format in (name, "both")]
    return [path for write in writers for view in views for path in write(view, target)]

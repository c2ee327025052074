"""Draw the pictures of a run for its results folder and its report page, and write the pictures to files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import AnyPath, InputError, made_folder, write_bytes
from ..plots import cells_figure, heights_figure, leak_test_figure, leakage_figure, seal_figure
from ..plots.drawing import LINES, Sheet, add_grid, label_decades
from ..plots.maps import default_step, patch_figure, surface_figure
from ..plots.pressure_lines import seat_figure
from ..plots.realisations import realisation_figure
from ..plots.style import GREY, STYLES, rendered_formats, styled
from ..results.file_options import PICTURE_FORMATS
from ..results.results import Results
from ..topography import Surface

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Names of the pictures that are also written as files. All other pictures appear only on the report page.
FILES = ("surface", "seal", "seat", "patch", "drawn", "cells", "leakage")


def draw_all(results: Results) -> dict[str, bytes]:
    """Draw every picture for which the results have data; return the pictures as PNG, by their names."""
    pictures = draw_formats(results, None, ("png",))
    return {name: formats["png"] for name, formats in pictures.items()}


def draw_formats(
    results: Results, surface: Surface | None, formats: Sequence[str]
) -> dict[str, dict[str, bytes]]:
    """Draw every picture for which the results have data, and render each picture in several formats.

    Parameters
    ----------
    results : Results
        Results of a run.
    surface : Topography or Patches or None
        Combined heights of the faces, for the picture "surface".
    formats : sequence of {"png", "svg", "pdf"}
        Formats of the pictures.

    Returns
    -------
    dict of dict of bytes
        Contents of the picture files, by the name of the picture and then by the format.
    """
    # Pictures are drawn in this process, because importing matplotlib in another process would take half as long as
    # drawing all of them.
    figures = _figures(results, surface)
    return {name: rendered_formats(draw(), formats) for name, draw in figures.items()}


def write_pictures(
    results: Results,
    folder: AnyPath | None = None,
    formats: Sequence[str] = ("png",),
    names: Sequence[str] = (),
    step: int | None = None,
) -> list[Path]:
    """Write pictures of a run to files.

    Parameters
    ----------
    results : Results
        Results of a run.
    folder : path, optional
        Folder of the picture files, which is created if it does not exist; by default the folder of the results.
    formats : sequence of {"png", "svg", "pdf"}
        Formats of the pictures.
    names : sequence of str
        Names of the pictures; by default all pictures for which the results have data.
    step : int, optional
        Index of the load step that the maps show; by default the step with the highest load at which the seal leaks.

    Returns
    -------
    list of Path
        Paths of the files.

    Raises
    ------
    InputError
        A format, a name or a step is unknown; the results have no data for a picture; the folder cannot be created; or
        `folder` is missing for results without a folder.
    """
    target = folder or results.folder
    if target is None:
        raise InputError(
            "folder", "no folder, and the results have no folder either", "a folder to write to"
        )
    check_formats(formats)
    surface = None if results.scene is None else results.scene.surface
    last = results.dataset.sizes["step"] - 1
    if step is not None and not 0 <= step <= last:
        raise InputError("step", step, f"a number from 0 to {last}")
    figures = _figures(results, surface, step)
    for name in names:
        if name not in figures:
            raise InputError("picture", f"'{name}'", f"one of {', '.join(figures)}")
    target = made_folder(target)
    chosen = [name for name in figures if name in names or not names]
    drawings = {name: rendered_formats(figures[name](), formats) for name in chosen}
    return [
        write_bytes(target / f"{name}.{form}", drawings[name][form])
        for name in chosen
        for form in formats
    ]


def check_formats(formats: Sequence[str]) -> None:
    """Raise an InputError if a picture format is unknown, or if no format is given."""
    unknown = [form for form in formats if form not in PICTURE_FORMATS]
    if unknown or not formats or isinstance(formats, str):
        given = f"'{formats if isinstance(formats, str) else ','.join(formats)}'"
        raise InputError("format", given, f"some of {', '.join(PICTURE_FORMATS)}")


def _figures(
    results: Results, surface: Surface | None, step: int | None = None
) -> dict[str, Callable[[], Figure]]:
    """Return the functions that draw the pictures of a run, by the names of the pictures.

    Pictures for which the results have no data are left out.

    step : index of the load step that the maps show; None for the step with the highest load at which the seal leaks.
    """
    data = results.dataset
    step = default_step(data) if step is None else step
    has_maps = "face_gap" in data
    has_realisation = "drawn_corners" in data
    figures: dict[str, Callable[[], Figure]] = {}
    if surface is not None:
        figures["surface"] = lambda: heights_figure(surface)
    if has_maps or has_realisation:
        figures["seal"] = lambda: seal_figure(results, step)
    if has_maps and has_realisation:
        figures["drawn"] = lambda: realisation_figure(data, step)
    if "cell_k1" in data or "state_k1" in data:
        figures["cells"] = lambda: cells_figure(results)
    figures["leakage"] = lambda: leakage_figure(results)
    if "test_leakage" in data:
        figures["test"] = lambda: leak_test_figure(results)
    if "face_height" in data:
        figures["face"] = lambda: surface_figure(data)
    if data.attrs.get("seat") and "row_pressure" in data:
        figures["seat"] = lambda: seat_figure(data)
    if "patch_height" in data:
        figures["patch"] = lambda: patch_figure(data)
    attempts = results.attempts
    if attempts is not None and _finished_attempts(attempts):
        figures["attempts"] = lambda: _attempts_figure(attempts)
    return figures


def _finished_attempts(attempts: dict[str, Any]) -> dict[int, dict[str, Any]]:
    """Return the attempts to reach the requested accuracy, numbered from 1.

    Attempts without an estimate of the error are left out.
    """
    numbered = enumerate(attempts["attempts"], start=1)
    return {number: attempt for number, attempt in numbered if attempt["half_width"] is not None}


@styled
def _attempts_figure(attempts: dict[str, Any]) -> Figure:
    """Draw the error of each attempt to reach the requested accuracy against its computing time."""
    sheet = Sheet([2.4])
    axes = sheet.panel(0, LINES)
    axes.set(xlabel="time of the attempt [s]", ylabel="error [%]", yscale="log")
    add_grid(axes)
    axes.axhline(100 * attempts["wanted"], color=GREY, ls="--", lw=0.8)
    for number, attempt in _finished_attempts(attempts).items():
        time_and_error = attempt["seconds"], 100 * np.expm1(attempt["half_width"])
        axes.plot(*time_and_error, "o", color=STYLES[0]["color"])
        axes.annotate(str(number), time_and_error, xytext=(6, 4), textcoords="offset points")
    axes.set_xlim(left=0)
    label_decades(axes.yaxis)
    return sheet.figure

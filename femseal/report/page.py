"""Write the report of a run: one self-contained HTML page for screens, phones and paper.

The page has no scripts and loads nothing. A browser prints it, also to a PDF.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import (
    AnyPath,
    FemsealError,
    InputError,
    format_deviation,
    number_text,
    to_text,
    write_text,
    writing,
)
from ..plots import cells_figure, heights_figure, leak_test_figure, leakage_figure, seal_figure
from ..plots.drawing import (
    GREY,
    HEIGHTS,
    LINES,
    STYLES,
    Sheet,
    label_decades,
    png,
)
from ..plots.heights import draw_heights
from ..plots.map_panels import map_row_height, on_its_side
from ..plots.maps import (
    default_step,
    draw_row_pressures,
    patch_figure,
    representative_steps,
    sides,
    surface_leakage,
)
from ..plots.realisations import realisation_figure
from ..results.dataset_file import FILE_NAME, inconsistent, open_results
from ..results.load_steps import load_names
from ..results.results import Results
from ..results.tables import as_chosen, attempts_table, leakage_table, totals_table
from ..results.verdict_text import verdict_paragraphs
from ..topography import Surface
from . import report_tables
from .report_tables import design_section, png_uri

if TYPE_CHECKING:
    import xarray
    from jinja2 import Template
    from matplotlib.figure import Figure

REPORT_NAME = "report.html"
#: Names of the pictures that are also written as files. All other pictures are only on the page.
FILES = ("surface", "seal", "seat", "patch", "drawn", "cells", "leakage")
#: Pictures as PNG, by their names.
Drawings = Mapping[str, bytes]


def draw_all(results: Results, surface: Surface | None = None) -> dict[str, bytes]:
    """Draw every picture for which the results have data.

    Parameters
    ----------
    results : Results
        Results of a run.
    surface : Topography or Patches, optional
        Combined heights of the faces, for the picture "surface".

    Returns
    -------
    dict of bytes
        Pictures as PNG, by their names.
    """
    # Pictures are drawn in this process, because importing matplotlib in another process would take half as long as
    # drawing all of them.
    return {name: png(draw()) for name, draw in _figures(results, surface).items()}


def _figures(results: Results, surface: Surface | None) -> dict[str, Callable[[], Figure]]:
    """Return the functions that draw the pictures for which the results have data, by the names of the pictures."""
    data = results.dataset
    step = default_step(data)
    has_maps = "face_gap" in data
    has_realisation = "drawn_corners" in data
    figures: dict[str, Callable[[], Figure]] = {}
    if surface is not None:
        figures["surface"] = lambda: heights_figure(surface)
    if has_maps or has_realisation:
        figures["seal"] = lambda: seal_figure(results)
    if has_maps and has_realisation:
        figures["drawn"] = lambda: realisation_figure(data, step)
    if "cell_k1" in data or "state_k1" in data:
        figures["cells"] = lambda: cells_figure(results)
    figures["leakage"] = lambda: leakage_figure(results)
    if "test_leakage" in data:
        figures["test"] = lambda: leak_test_figure(results)
    if "face_height" in data:
        figures["face"] = lambda: _surface_figure(data)
    if data.attrs.get("seat") and "row_pressure" in data:
        figures["seat"] = lambda: _seat_figure(data, step)
    if "patch_height" in data:
        figures["patch"] = lambda: patch_figure(data)
    attempts = results.attempts
    if attempts is not None and _finished_attempts(attempts):
        figures["attempts"] = lambda: _attempts_figure(attempts)
    return figures


def _surface_figure(data: xarray.Dataset) -> Figure:
    """Draw the heights of the surface for which contact and flow were solved."""
    size = sides(data)
    sheet = Sheet([map_row_height(on_its_side(size), HEIGHTS)])
    draw_heights(sheet.panel(0, HEIGHTS), data["face_height"].values * 1e6, size)
    return sheet.figure


def _seat_figure(data: xarray.Dataset, step: int) -> Figure:
    """Draw the contact pressure across the seat."""
    sheet = Sheet([4.0])
    draw_row_pressures(sheet.panel(0, LINES), data, representative_steps(data, step))
    return sheet.figure


def _finished_attempts(attempts: dict[str, Any]) -> dict[int, dict[str, Any]]:
    """Return those attempts to reach the accuracy whose error is known, by their numbers (from 1)."""
    numbered = enumerate(attempts["attempts"], start=1)
    return {number: attempt for number, attempt in numbered if attempt["half_width"] is not None}


def _attempts_figure(attempts: dict[str, Any]) -> Figure:
    """Draw the error of each attempt to reach the accuracy against its computing time."""
    sheet = Sheet([3.2])
    axes = sheet.panel(0, LINES)
    axes.set(xlabel="time of the attempt [s]", ylabel="error [%]", yscale="log")
    axes.grid(alpha=0.25, lw=0.6)
    axes.axhline(100 * attempts["wanted"], color=GREY, ls="--", lw=1)
    for number, attempt in _finished_attempts(attempts).items():
        time_and_error = attempt["seconds"], 100 * np.expm1(attempt["half_width"])
        axes.plot(*time_and_error, "o", color=STYLES[0]["color"])
        axes.annotate(str(number), time_and_error, xytext=(6, 4), textcoords="offset points")
    axes.set_xlim(left=0)
    label_decades(axes.yaxis)
    return sheet.figure


def write_report(
    results: Results | AnyPath, path: AnyPath | None = None, drawings: Drawings | None = None
) -> Path:
    """Write a self-contained HTML page about a run, which needs no other files and can be printed.

    The page begins with the verdict: the leakage classes, the leakage, the accuracy, and the measures that would help
    most. Warnings and the leakage against load follow, and then maps, cells, faces, tables and the error budget. All
    contents come from the dataset, so that a page made from a folder is identical to the page that the run wrote.

    Parameters
    ----------
    results : Results or path
        Results of a run, or the folder that contains them.
    path : path, optional
        Path of the page, by default `report.html` in the folder of the results.
    drawings : mapping of bytes, optional
        Pictures as PNG by their names, if they have been drawn already.

    Returns
    -------
    Path
        Path of the page. The page is written completely or not at all.

    Raises
    ------
    InputError
        The folder contains no results, the page cannot be written, or `path` is missing for results without a folder.

    Examples
    --------
    >>> write_report("results/seal", "report.html")  # doctest: +SKIP
    """
    folder = None
    if not isinstance(results, Results):
        folder = Path(results)
        results = open_results(results)
    if path is None and results.folder is None:
        raise InputError("path", "none, for results without a folder", "a file to write")
    target = Path(path or (results.folder or Path()) / REPORT_NAME)
    if target.is_dir() or not os.access(target.parent, os.W_OK):
        raise InputError("path", f"'{target}'", "a file in a folder that can be written")
    try:
        page = report_html(results, drawings)
    except FemsealError:
        raise
    except Exception as error:
        if folder is None:
            raise
        # the file with the results must have been changed
        raise inconsistent(folder / FILE_NAME, error) from error
    with writing("path", target, "a file in a folder"):
        return write_text(target, page)


def report_html(results: Results, drawings: Drawings | None = None) -> str:
    """Return the text of the page.

    Parameters
    ----------
    results : Results
        Results of a run.
    drawings : mapping of bytes, optional
        Pictures as PNG by their names, if they have been drawn already.
    """
    data = results.dataset
    step = default_step(data)
    names = load_names(data)
    attempts = results.attempts
    timings = json.loads(data.attrs["timings"])
    stage_timings = {
        stage: seconds
        for stage, seconds in timings.items()
        if ": " not in stage  # these are parts of stages
    }
    pictures = drawings or draw_all(results)
    return page_template().render(
        results=results,
        data=data,
        load_names=names,
        load=names[step],
        basis=results.leak_basis,
        verdict=verdict_paragraphs(results),
        key_numbers=report_tables.key_numbers(results),
        flows=np.nan_to_num(surface_leakage(data)[step]) != 0,
        half_drop=_cells_of_half_drop(data, step),
        # without the column "class", because the page has a table of classes
        leakage_table=leakage_table(results).without("class"),
        totals=totals_table(results),
        classes=report_tables.class_table(results),
        test_fluid=report_tables.test_fluid(results),
        design=design_section(results),
        pictures={name: png_uri(picture) for name, picture in pictures.items()},
        budget=report_tables.budget_table(results),
        attempts=None if attempts is None else attempts_table(attempts),
        stages=stage_timings,
        case=as_chosen(results.case, attempts),
    )


@cache
def page_template() -> Template:
    """Compile the template of the page."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("femseal.report", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "deviation": format_deviation,
        "flat": flatten,
        "number": number_text,
        "parsed": json.loads,
        "si": to_text,
    }
    return environment.get_template("report.html.jinja")


def _cells_of_half_drop(data: xarray.Dataset, step: int) -> int:
    """Return the smallest number of cells with half of the pressure drop at a load step; 0 if it is unknown."""
    if "cell_drop_fraction" not in data:
        return 0
    fractions = data["cell_drop_fraction"].values[step].ravel()
    if np.isnan(fractions).any():
        return 0
    largest_first = np.sort(fractions)[::-1]
    return int(np.searchsorted(np.cumsum(largest_first), 0.5)) + 1


def flatten(value: Any, name: str = "") -> list[tuple[str, str]]:
    """Convert nested tables and lists to a flat list of dotted keys and texts of their values.

    >>> flatten({"load": {"loading": [1e6, 2e6]}, "face": [{"kind": "file"}]})
    [('load.loading', '1e+06, 2e+06'), ('face.0.kind', 'file')]
    """
    if isinstance(value, list):
        if not any(isinstance(item, dict) for item in value):
            return [(name, ", ".join(map(_plain_text, value)))]
        value = dict(enumerate(value))
    if not isinstance(value, dict):
        return [(name, _plain_text(value))]
    lines = []
    for key, item in value.items():
        lines += flatten(item, f"{name}.{key}".lstrip("."))
    return lines


def _plain_text(value: Any) -> str:
    """Convert a value to text; numbers are written in short form."""
    return f"{value:g}" if isinstance(value, float) else str(value)

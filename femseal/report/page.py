"""The report of a run: one self-contained page of HTML for screens, phones and paper.

It has no scripts, and loads nothing. A browser prints it, also as PDF.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

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
from ..plots import heights_figure, leak_test_figure, leakage_figure, pieces_figure, seal_figure
from ..plots.drawing import GREY, HEIGHTS, LINES, STYLES, Sheet, decades, lying, map_row, png
from ..plots.heights import height_panel
from ..plots.maps import (
    default_step,
    drawn_figure,
    drop_steps,
    face_leakage,
    place_figure,
    row_panel,
    sides,
)
from ..results.dataset import FILE_NAME, open_results, unfit
from ..results.results import Results, load_names, loads_as_given
from ..results.tables import as_chosen, attempts_table, leakage_table, totals_table
from ..results.verdict import verdicts_in_words
from ..topography import Surface
from . import report_tables
from .report_tables import design_section, png_uri

if TYPE_CHECKING:
    import xarray
    from jinja2 import Template
    from matplotlib.figure import Figure

REPORT_NAME = "report.html"
#: Pictures that are files of the folder too, by their name without ending; the page alone has the others.
FILES = ("surface", "seal", "seat", "place", "drawn", "pieces", "leakage")
#: Pictures as PNG by their name.
Drawings = Mapping[str, bytes]


def draw_all(results: Results, surface: Surface | None = None) -> dict[str, bytes]:
    """Draw every picture for which there are data.

    results : of a run.
    surface : the combined heights, for the picture "surface"; None: without.
    """
    # in one process: others would import what draws once more, which takes as long as half of the pictures
    return {name: png(draw()) for name, draw in _figures(results, surface).items()}


def _figures(results: Results, surface: Surface | None) -> dict[str, Callable[[], Figure]]:
    """What draws each picture for which there are data."""
    data, s = results.dataset, default_step(results.dataset)
    maps, drawn_seal = "face_gap" in data, "drawn_corners" in data
    found = results.attempts or {"attempts": []}
    pictures: dict[str, tuple[bool, Callable[[], Figure]]] = {
        "surface": (surface is not None, lambda: heights_figure(cast(Surface, surface))),
        "seal": (maps or drawn_seal, lambda: seal_figure(results)),
        "drawn": (maps and drawn_seal, lambda: drawn_figure(data, s)),
        "pieces": ("piece_k1" in data or "state_k1" in data, lambda: pieces_figure(results)),
        "leakage": (True, lambda: leakage_figure(results)),
        "test": ("test_leakage" in data, lambda: leak_test_figure(results)),
        "face": ("face_height" in data, lambda: _face_figure(data)),
        "seat": (
            bool(data.attrs.get("seat")) and "row_pressure" in data,
            lambda: _seat_figure(data, s),
        ),
        "place": ("place_height" in data, lambda: place_figure(data)),
        "attempts": (
            any(attempt["half_width"] is not None for attempt in found["attempts"]),
            lambda: _attempts_figure(found),
        ),
    }
    return {name: draw for name, (there, draw) in pictures.items() if there}


def _seat_figure(data: xarray.Dataset, s: int) -> Figure:
    sheet = Sheet([4.0])
    row_panel(sheet.panel(0, LINES), data, drop_steps(data, s))
    return sheet.figure


def _attempts_figure(found: dict[str, Any]) -> Figure:
    """Error of the attempts whose error is known against their time, by their numbers."""
    sheet = Sheet([3.2])
    axes = sheet.panel(0, LINES)
    axes.set(xlabel="time of the attempt [s]", ylabel="error [%]", yscale="log")
    axes.grid(alpha=0.25, lw=0.6)
    axes.axhline(100 * found["wanted"], color=GREY, ls="--", lw=1)
    for number, attempt in enumerate(found["attempts"], start=1):
        if attempt["half_width"] is not None:
            at = attempt["seconds"], 100 * np.expm1(attempt["half_width"])
            axes.plot(*at, "o", color=STYLES[0]["color"])
            axes.annotate(str(number), at, xytext=(6, 4), textcoords="offset points")
    axes.set_xlim(left=0)
    decades(axes.yaxis)
    return sheet.figure


def _face_figure(data: xarray.Dataset) -> Figure:
    sheet = Sheet([map_row(lying(sides(data)), HEIGHTS)])
    height_panel(sheet.panel(0, HEIGHTS), data["face_height"].values * 1e6, sides(data))
    return sheet.figure


def write_report(
    results: Results | AnyPath, path: AnyPath | None = None, drawings: Drawings | None = None
) -> Path:
    """Write one self-contained HTML page about a run: it loads nothing, and prints.

    First the verdict on leakage classes, the leakage of the whole seal, its band and what limits it, warnings, and the
    leakage over load; then maps, pieces, faces, tables, error budget and the rest. It
    depends on the dataset alone, so that a page made from a folder equals the one that the run wrote.

    Parameters
    ----------
    results : of a run, or the folder they are in.
    path : of the page; `report.html` in the folder of the results unless given.
    drawings : its pictures, if they are drawn already.

    Returns
    -------
    Path of the page; it is written whole or not at all.

    Raises
    ------
    InputError : no results in the folder; a path that cannot be written; no path for results without a folder.

    Examples
    --------
    >>> write_report("results/seal", "report.html")  # doctest: +SKIP
    """
    folder = None
    if not isinstance(results, Results):
        folder, results = Path(results), open_results(results)
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
        raise unfit(folder / FILE_NAME, error) from error
    with writing("path", target, "a file in a folder"):
        return write_text(target, page)


def report_html(results: Results, drawings: Drawings | None = None) -> str:
    """The page as text; pictures are drawn unless given."""
    data, s = results.dataset, default_step(results.dataset)
    timings = json.loads(data.attrs["timings"])  # also of parts of a study
    drawn = drawings or draw_all(results)
    return page_template().render(
        results=results,
        data=data,
        load_names=load_names(data),
        load=load_names(data)[s],
        basis=results.leak_basis,
        verdicts=verdicts_in_words(results.verdicts, loads_as_given(data, 3)),
        key_numbers=report_tables.key_numbers(results),
        flows=np.nan_to_num(face_leakage(data)[s]) != 0,
        half_drop=_half_drop(data, s),
        # the page has a table of classes
        leakage_table=leakage_table(results).without("class"),
        totals=totals_table(results),
        classes=report_tables.class_table(results),
        test_fluid=report_tables.test_fluid(results),
        design=design_section(results),
        pictures={name: png_uri(drawing) for name, drawing in drawn.items()},
        budget=report_tables.budget_table(results),
        attempts=None if results.attempts is None else attempts_table(results.attempts),
        stages={name: time for name, time in timings.items() if ": " not in name},
        case=as_chosen(results.case, results.attempts),
    )


@cache
def page_template() -> Template:
    """The template of the page, which is compiled once."""
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
        "flat": flat,
        "number": number_text,
        "parsed": json.loads,
        "si": to_text,
    }
    return environment.get_template("report.html.jinja")


def _half_drop(data: xarray.Dataset, s: int) -> int:
    """Number of pieces that carry half of the pressure drop at a step; 0 where it is not known."""
    if "piece_drop_fraction" not in data or not data["piece_drop_fraction"][s].notnull().all():
        return 0
    fraction = np.sort(data["piece_drop_fraction"].values[s].ravel())[::-1]
    return int(np.searchsorted(np.cumsum(fraction), 0.5)) + 1


def flat(value: Any, name: str = "") -> list[tuple[str, str]]:
    """A nested case as lines of key and value."""
    if isinstance(value, list):
        if not any(isinstance(item, dict) for item in value):
            return [(name, ", ".join(map(_plain, value)))]
        value = dict(enumerate(value))
    if not isinstance(value, dict):
        return [(name, _plain(value))]
    return [line for key, item in value.items() for line in flat(item, f"{name}.{key}".lstrip("."))]


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)

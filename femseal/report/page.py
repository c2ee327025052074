"""The report of a run: one self-contained page of HTML for screens, phones and paper.

It has no scripts, and loads nothing. A browser without a window prints it as PDF, or else WeasyPrint does.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from ..base import AnyPath, FemsealError, InputError, replacing, to_text, write_text, writing
from ..plots import heights_figure, leakage_figure, pieces_figure, seal_figure
from ..plots.drawing import GREY, HEIGHTS, LINES, STYLES, Sheet, decades, lying, map_row, png
from ..plots.heights import height_panel
from ..plots.maps import (
    default_step,
    drawn_figure,
    drop_steps,
    face_leakage,
    face_size,
    has_maps,
    place_figure,
    row_panel,
)
from ..results.dataset import FILE_NAME, open_results, unfit
from ..results.results import Results, load_names
from ..results.tables import as_chosen, attempts_table, leakage_table, totals_table
from ..topography import Topography
from . import report_tables
from .report_tables import design_section, png_uri

if TYPE_CHECKING:
    import xarray
    from jinja2 import Template
    from matplotlib.figure import Figure

REPORT_NAME = "report.html"
#: Browsers that print a page by `--headless --print-to-pdf`, by the names of their commands.
BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "msedge",
)
#: Longest time that a browser may take [s].
_PATIENCE = 120
#: Least and largest of values that may be undefined.
_ENDS = np.nanmin, np.nanmax
#: Pictures that are files of the folder too, by their name without ending; the page alone has the others.
FILES = ("surface", "seal", "seat", "place", "drawn", "pieces", "leakage")
#: Pictures as PNG by their name.
Drawings = Mapping[str, bytes]


class Picture(NamedTuple):
    """A picture of the page as a data URI, with its caption."""

    uri: str
    caption: str


def page_pictures(results: Results, drawings: Drawings) -> dict[str, Picture]:
    """The pictures of the page by their name."""
    captions = _captions(results)
    return {
        name: Picture(png_uri(drawing), captions[name])
        for name, drawing in drawings.items()
        if name in captions
    }


def _captions(results: Results) -> dict[str, str]:
    """What each picture of the page shows."""
    data = results.dataset
    load = load_names(data)[default_step(data)]
    drawn_seal = f"The drawn seal nearest to the median, in its plane, at {load}."
    maps = (
        f"Contact pressure, gap and fluid pressure of the face at {load}, mean of each block of "
        "pixels, and the fluid pressure along the leakage from the inlet at x1 = 0."
    )
    place = most_leaking_place(results).capitalize() if "place_height" in data else ""
    return {
        "face": "The face that was solved: heights of the combined faces.",
        "seat": "Contact pressure across the seat, mean of each row.",
        "place": f"{place}: its heights, and its gap with the contact in grey.",
        "leakage": "Leakage against load, a line for each branch of the load cycle.",
        "seal": maps if has_maps(data) else drawn_seal,
        "drawn": drawn_seal,
        "attempts": "Error of each attempt against its time; the line is the accuracy asked for.",
        "pieces": "Permeability of pieces against mean gap: wide gaps follow h̄³/12 of parallel "
        "plates, and narrow gaps close. A piece is closed where nothing passes between its own "
        "sides; grooves that wind may lead the fluid past it. Below, against contact pressure: "
        "unloading (squares) lies below loading (circles) because of the plastic deformation that "
        "the peak left.",
    }


def draw_all(results: Results, surface: Topography | None = None) -> dict[str, bytes]:
    """Draw every picture for which there are data.

    results : of a run.
    surface : the combined heights, for the picture "surface"; None: without.
    """
    # in one process: others would import what draws once more, which takes as long as half of the pictures
    return {name: png(draw()) for name, draw in _figures(results, surface).items()}


def _figures(results: Results, surface: Topography | None) -> dict[str, Callable[[], Figure]]:
    """What draws each picture for which there are data."""
    data, s = results.dataset, default_step(results.dataset)
    maps, drawn_seal = has_maps(data), "drawn_corners" in data
    found = results.attempts or {"attempts": []}
    pictures: dict[str, tuple[bool, Callable[[], Figure]]] = {
        "surface": (surface is not None, lambda: heights_figure(cast(Topography, surface))),
        "seal": (maps or drawn_seal, lambda: seal_figure(results)),
        "drawn": (maps and drawn_seal, lambda: drawn_figure(data, s)),
        "pieces": ("piece_k1" in data or "state_k1" in data, lambda: pieces_figure(results)),
        "leakage": (True, lambda: leakage_figure(results)),
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
    sheet = Sheet([map_row(lying(face_size(data)), HEIGHTS)])
    height_panel(sheet.panel(0, HEIGHTS), data["face_height"].values * 1e6, face_size(data))
    return sheet.figure


def most_leaking_place(results: Results) -> str:
    """Which of several measured places leaks most by itself, and how much, over the loads that count."""
    about = results.dataset["place_height"].attrs
    count = results.dataset.sizes["place"]
    if not about["over_mean"]:
        return f"place {about['place']} of {count}, of which none leaks"
    return (
        f"place {about['place']} of {count} leaks most, {about['over_mean']:.3g} times their mean"
    )


def write_report(
    results: Results | AnyPath,
    path: AnyPath | None = None,
    drawings: Drawings | None = None,
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
        raise InputError(
            "path", "none, for results without a folder", "the path of a file to write"
        )
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
    return page_template().render(_content(results, drawings or draw_all(results)))


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
    return environment.get_template("report.html.jinja")


def _content(results: Results, drawings: Drawings) -> dict[str, Any]:
    """What the template of the page takes."""
    data = results.dataset
    return {
        "title": results.case.get("title") or "Leakage of a metal-to-metal seal",
        "source": data.attrs["source"],
        "key_numbers": report_tables.key_numbers(results),
        "date": str(data.attrs.get("date_created", "")).replace("T", " ").replace("+00:00", " UTC"),
        "digests": json.loads(data.attrs.get("face_files", "{}")),
        "limiting": report_tables.limiting_text(results),
        "description": json.loads(data.attrs.get("description", "[]")),
        "seal": _seal_text(data),
        "drop_text": _drop_text(data) if has_maps(data) else "",
        "gas_state": report_tables.gas_state_text(results),
        # the page has a table of classes
        "leakage_table": leakage_table(results).without("class"),
        "totals": totals_table(results),
        "classes": report_tables.class_table(results),
        "test_fluid": report_tables.test_fluid_sentences(results),
        "design": design_section(results),
        "method": results.method,
        "pictures": page_pictures(results, drawings),
        "budget": report_tables.budget_table(results),
        "attempts": None if results.attempts is None else attempts_table(results.attempts),
        "times": report_tables.time_lines(results),
        "warnings": results.warnings,
        "failures": results.failures,
        "versions": flat(json.loads(data.attrs["versions"])),
        "machine": flat(json.loads(data.attrs["machine"])),
        "case": flat(as_chosen(results.case, results.attempts)),
    }


def _seal_text(data: xarray.Dataset) -> str:
    """Shape and sides of the seal, on what band a seat touches, and how tiles of an uneven seal are pressed."""
    width, length = (to_text(side, "m") for side in data.attrs["seal_size_m"])
    seal = data.attrs["seal"]
    texts = [f"The seal is {seal}, {width} wide along the leakage and {length} long."]
    if data.attrs.get("seat") and "band_breadth" in data:
        least, most = (to_text(f(data["band_breadth"].values), "m", 3) for f in _ENDS)
        highest = to_text(np.nanmax(data["largest_row_pressure"].values), "Pa", 3)
        texts.append(
            f"The seat touches on a band {least} to {most} broad, with at most {highest} as the "
            "mean of a row."
        )
    name = "drawn_nominal_pressure" if "drawn_form" in data else "drawn_contact_pressure"
    uneven = "drawn_form" in data or json.loads(data.attrs["case"]).get("load", {}).get("map")
    if uneven and name in data:
        loads = data["nominal_pressure"].values
        for s in dict.fromkeys((loads.argmin(), loads.argmax())):
            at = data[name].values[s]
            low, high = (to_text(f(at), "Pa", 3) for f in _ENDS)
            texts.append(
                f"At {load_names(data)[s]} the tiles are pressed with {low} to {high}, and "
                f"{(at == 0).mean():.0%} of them stand apart."
            )
    return " ".join(texts)


def _drop_text(data: xarray.Dataset) -> str:
    """Number of pieces that carry half of the pressure drop at the step of the maps."""
    s = default_step(data)
    if np.nan_to_num(face_leakage(data)[s]) == 0:
        return f"At {load_names(data)[s]} nothing flows."
    if "piece_drop_fraction" not in data or not data["piece_drop_fraction"][s].notnull().all():
        return ""
    fraction = np.sort(data["piece_drop_fraction"].values[s].ravel())[::-1]
    half = np.searchsorted(np.cumsum(fraction), 0.5) + 1
    return f"Half of the pressure drops in {half} of {fraction.size} pieces."


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


def write_pdf(page: AnyPath, path: AnyPath | None = None) -> Path:
    """Print a page as PDF.

    page : the HTML file. path : of the PDF; beside the page unless given.

    Returns the path of the PDF; it is written whole or not at all.
    Raises InputError: neither a browser nor WeasyPrint is there.
    FemsealError : the browser did not print.
    """
    page = Path(page)
    target = page.with_suffix(".pdf") if path is None else Path(path)
    browser = find_browser()
    if browser is None and find_spec("weasyprint") is None:
        expected = (
            f"one of the browsers {', '.join(BROWSERS)} on the path, or `pip install weasyprint`; "
            "or print report.html from a browser"
        )
        raise InputError("PDF", "no program that prints a page", expected)
    with replacing(target) as temporary:
        if browser is not None:
            _print(browser, page, temporary)
        else:
            from weasyprint import HTML

            HTML(filename=str(page)).write_pdf(str(temporary))
    return target


def find_browser() -> str | None:
    """Command of the first browser of `BROWSERS` on the path; None without one."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


def _print(browser: str, page: Path, target: Path) -> None:
    """Have a browser print a page, in a profile of its own."""
    flags = [
        "--headless",
        "--disable-gpu",
        "--no-pdf-header-footer",
        f"--print-to-pdf={target.resolve()}",
    ]
    # within a container the root user has no sandbox
    flags += ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
    with tempfile.TemporaryDirectory() as profile:
        command = [browser, *flags, f"--user-data-dir={profile}", page.resolve().as_uri()]
        try:
            done = subprocess.run(command, capture_output=True, timeout=_PATIENCE, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise FemsealError(f"PDF: '{browser}' did not print the page ({error})") from error
    if done.returncode or not target.read_bytes().startswith(b"%PDF"):
        last = (done.stderr.decode(errors="replace").strip().splitlines() or ["no message"])[-1]
        raise FemsealError(f"PDF: '{browser}' did not print the page ({last})")

"""The report of a run: one self-contained page of HTML for screens, phones and paper.

Its curves can be hovered and zoomed by uPlot, whose code is in the page: the page's policy names its script by its
digest, and nothing is loaded. Each curve has a picture, which stands in its place without scripts and on paper. uPlot
1.6.32 is in `uplot/`, with its licence. A browser without a window prints the page as PDF, or else WeasyPrint does.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, FemsealError, InputError, replacing, write_text, writing
from ..plots.drawing import branch_styles
from ..plots.leakage_curves import leakage_curves
from ..plots.maps import pressure_rows
from ..results.results import Results
from ..results.results_file import FILE_NAME, open_results, unfit
from ..results.selections import load_names
from ..results.summary import as_chosen, attempts_table
from ..results.tables import (
    format_error_band,
    format_leakage,
    leakage_of,
    leakage_table,
    totals_table,
)
from . import case_text, error_tables, leakage_tables, pictures
from .leakage_tables import design_section

if TYPE_CHECKING:
    from jinja2 import Template

REPORT_NAME = "report.html"


def write_report(
    results: Results | str | os.PathLike[str],
    path: str | os.PathLike[str] | None = None,
    drawings: pictures.Drawings | None = None,
) -> Path:
    """Write one self-contained HTML page about a run: it loads nothing, and prints.

    First the verdict on leakage classes, the leakage of the whole seal, its band and what limits it, warnings, and the
    leakage over load, to be hovered and zoomed; then maps, pieces, faces, tables, error budget and the rest. It
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
        folder, results = results, open_results(results)
    if path is None and results.folder is None:
        raise InputError(
            "path", "none, for results without a folder", "the path of a file to write"
        )
    target = Path(path) if path is not None else Path(results.folder or "") / REPORT_NAME
    if target.is_dir() or not os.access(target.parent, os.W_OK):
        raise InputError("path", f"'{target}'", "a file in a folder that can be written")
    try:
        page = report_html(results, drawings)
    except FemsealError:
        raise
    except Exception as error:
        if folder is None:
            raise
        raise unfit(Path(folder) / FILE_NAME, error) from error
    with writing("path", target, "a file in a folder"):
        return write_text(target, page)


def report_html(results: Results, drawings: pictures.Drawings | None = None) -> str:
    """The page as text; pictures are drawn unless given."""
    return page_template().render(
        _content(results, pictures.draw_all(results) if drawings is None else drawings)
    )


@cache
def page_template() -> Template:
    """The template of the page, which is compiled once."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    source = files("femseal.report").joinpath("report.html.jinja").read_text(encoding="utf-8")
    return environment.from_string(source)


def _content(results: Results, drawings: pictures.Drawings) -> dict[str, Any]:
    """What the template of the page takes."""
    data = results.dataset
    content: dict[str, Any] = {
        "title": results.case.get("title") or "Leakage of a metal-to-metal seal",
        "source": data.attrs["source"],
        "key_numbers": leakage_tables.key_numbers(results),
        "date": str(data.attrs.get("date_created", "")).replace("T", " ").replace("+00:00", " UTC"),
        "computed": _digest_lines(results),
        "limiting": leakage_tables.limiting_text(results),
        **page_code(),
        "charts": {"leakage": leakage_chart(results)},
        "sentences": case_text.case_sentences(results),
        "face": pictures.face_picture(results, drawings) if "face" in drawings else None,
        "seat": pictures.seat_picture(results, drawings) if "seat" in drawings else None,
        "place": pictures.place_picture(results, drawings) if "place" in drawings else None,
        "total": leakage_tables.total_leakage_text(results),
        "leakage": pictures.leakage_picture(results, drawings),
        # the page has a table of classes
        "leakage_table": leakage_table(results).without(["class"]),
        "totals": totals_table(results),
        "classes": leakage_tables.class_table(results),
        "test_fluid": leakage_tables.test_fluid_sentences(results),
        "design": design_section(results),
        "method": results.method,
        "pieces": pictures.piece_pictures(results, drawings) if "pieces" in drawings else [],
        "drawn": pictures.drawn_picture(results, drawings) if "drawn_corners" in data else None,
        "map_step": "",
        "maps": [],
        "drop": None,
        "drop_sentences": [],
        "budget": error_tables.budget_table(results),
        "checks": error_tables.check_lines(results),
        "attempts": None if results.attempts is None else attempts_table(results.attempts),
        "times": error_tables.time_lines(results),
        "warnings": results.warnings,
        "failures": results.failures,
        "versions": flat(json.loads(data.attrs["versions"])),
        "machine": flat(json.loads(data.attrs["machine"])),
        "case": flat(as_chosen(results.case, results.attempts)),
    }
    if "drop" in drawings:
        content["map_step"], content["maps"] = pictures.map_pictures(results, drawings)
        content["drop"] = pictures.drop_picture(results, drawings)
        content["charts"]["drop"] = drop_chart(results, pictures.drop_steps(data))
        content["drop_sentences"] = case_text.pressure_drop_sentences(results)
    return content


def _digest_lines(results: Results) -> list[tuple[str, str]]:
    """The digest of every measured face: label, text."""
    try:
        faces = json.loads(results.dataset.attrs.get("face_files", "{}"))
        return [(f"SHA-256 of {name}", str(digest)) for name, digest in faces.items()]
    except (TypeError, ValueError, AttributeError):
        return []


def flat(value: Any, name: str = "") -> list[tuple[str, str]]:
    """A nested case as lines of key and value."""
    if isinstance(value, dict):
        return [
            line
            for key, item in value.items()
            for line in flat(item, f"{name}.{key}" if name else str(key))
        ]
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        return [
            line
            for n, item in enumerate(value, 1)
            for line in flat(item, name if len(value) == 1 else f"{name} {n}")
        ]
    if isinstance(value, list):
        return [(name, ", ".join(_plain(item) for item in value))]
    return [(name, _plain(value))]


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


Chart = dict[str, Any]


def page_code() -> dict[str, str]:
    """Script and style of the page's charts, and the script's digest for the policy of the page."""
    folder = files("femseal.report")
    read = [
        folder.joinpath(name).read_text(encoding="utf-8")
        for name in ("uplot/uPlot.iife.min.js", "charts.js")
    ]
    # a section of plain characters, so that the page is XML too
    script = "//<![CDATA[\n" + "".join(read) + "//]]>"
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    style = folder.joinpath("uplot/uPlot.min.css").read_text(encoding="utf-8").strip()
    return {"script": script, "script_digest": f"sha256-{digest}", "chart_style": style}


def leakage_chart(results: Results) -> Chart:
    """Leakage over load, a curve for each branch, with the band of error shaded and the limits of classes."""
    curves, (unit, factor) = leakage_curves(results), results.leak_scale
    name, load_factor = curves.load
    sizes = curves.range[np.isfinite(curves.range) & (curves.range > 0)] / factor
    low, high = (sizes.min() / 1.3, sizes.max() * 1.3) if sizes.size else (0.1, 10.0)
    loads = np.unique(curves.pressure)
    parts = curves.branches
    series = []
    for (branch, steps), (colour, *_) in zip(parts, branch_styles(len(parts)), strict=True):
        one = _series(branch, colour, loads.size)
        if curves.band is not None:
            one |= {"low": [None] * loads.size, "high": [None] * loads.size}
        for s in steps:
            n, value = (
                int(np.searchsorted(loads, curves.pressure[s])),
                abs(float(curves.leakage[s])),
            )
            one["texts"][n] = format_leakage(value, factor)
            one["values"][n] = None if np.isnan(value) else max(value / factor, low)
            if curves.band is not None:
                lower, upper = (abs(float(end[s])) for end in curves.band)
                one["texts"][n] += f", band {format_error_band(lower, upper, factor, value)}"
                one["low"][n], one["high"][n] = (
                    _number(min(end / factor, 10 * high)) for end in (lower, upper)
                )
        series.append(one)
    caption = "Leakage against load; points at the lower edge are sealed."
    caption += f" Shaded: {' '.join(curves.band_name.split())}." if curves.band is not None else ""
    what = f"{leakage_of(results).rstrip(',')} [{unit.name}]"
    chart = _chart((name, loads * load_factor), (what, (low, high)), series, caption, log_y=True)
    limits = {limit: limit_value / factor for limit, limit_value in curves.limits.items()}
    return chart | {
        "limits": {limit: value for limit, value in limits.items() if low <= value <= high}
    }


def drop_chart(results: Results, steps: Sequence[int]) -> Chart:
    """Fluid pressure along the leakage at some steps, mean over the length of the seal."""
    data, series, x = results.dataset, [], np.empty(0)
    for s, (colour, *_) in zip(steps, branch_styles(len(steps)), strict=True):
        x, p = pressure_rows(data, s)
        values = [_number(value) for value in np.ma.filled(p.mean(axis=1), np.nan) / 1e6]
        texts = ["–" if value is None else f"{value:.4g}" for value in values]
        series.append(
            _series(load_names(data)[s], colour, len(x)) | {"values": values, "texts": texts}
        )
    known = [value for one in series for value in one["values"] if value is not None] or [0.0, 1.0]
    margin = 0.05 * (max(known) - min(known) or 1.0)
    span = min(known) - margin, max(known) + margin
    caption = "Fluid pressure along the leakage, mean over the length of the seal."
    return _chart(("x1, inlet at 0 [mm]", x * 1e3), ("fluid pressure [MPa]", span), series, caption)


def _series(label: str, colour: str, count: int) -> dict[str, Any]:
    return {"label": label, "colour": colour, "values": [None] * count, "texts": [None] * count}


def _chart(
    across: tuple[str, Array],
    up: tuple[str, tuple[float, float]],
    series: list[dict[str, Any]],
    caption: str,
    log_y: bool = False,
) -> Chart:
    """What `charts.js` takes; the horizontal axis of a logarithmic chart is logarithmic too, but for a load of 0.

    across : its label and values. up : its label and the ends of the scale.
    """
    (x_label, x), (y_label, span) = across, up
    log_x = log_y and bool(x[0] > 0 and x[-1] > 3 * x[0])
    margin = (x[-1] / x[0]) ** 0.02 if log_x else 0.02 * (x[-1] - x[0]) or 1.0
    ends = (x[0] / margin, x[-1] * margin) if log_x else (x[0] - margin, x[-1] + margin)
    return {
        "x": {
            "label": x_label,
            "values": [float(v) for v in x],
            "log": log_x,
            "range": [float(end) for end in ends],
        },
        "y": {"label": y_label, "log": log_y, "range": [float(end) for end in span]},
        "series": series,
        "limits": {},
        "caption": caption,
    }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


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


def write_pdf(page: str | os.PathLike[str], path: str | os.PathLike[str] | None = None) -> Path:
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
            f"one of the browsers {', '.join(BROWSERS)} on the path, or `pip install weasyprint`"
        )
        raise InputError(
            "PDF",
            "no program that prints a page",
            f"{expected}; or print report.html from a browser",
        )
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

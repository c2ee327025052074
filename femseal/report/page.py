"""The report of a run: one self-contained page of HTML for screens, phones and paper."""

from __future__ import annotations

import json
import os
from importlib.resources import files
from pathlib import Path
from typing import Any

from ..base.errors import FemsealError, InputError
from ..base.files import replacing
from ..results.dataset import FILE_NAME, open_results, unfit
from ..results.results import Results, as_chosen, attempts_table
from ..results.run_data import RunData
from ..results.tables import leakage_table, lengths_table, totals_table
from . import case_text, charts, error_tables, leakage_tables, pictures
from .leakage_tables import design_section

REPORT_NAME = "report.html"


def write_report(
    results: Results | str | os.PathLike[str],
    path: str | os.PathLike[str] | None = None,
    drawings: pictures.Drawings | None = None,
) -> Path:
    """Write one self-contained HTML page about a run: it loads nothing, and prints.

    First the verdict on leakage classes, the leakage of the whole seal, its band and what limits it, warnings, and the
    leakage over load, to be hovered and zoomed; then maps, cells, faces, tables, error budget and the rest. It
    depends on the dataset alone, so that a page made from a folder equals the one that the run wrote; an
    `accuracy.json` in the folder is added.

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
    """
    folder = None
    if not isinstance(results, Results):
        folder, results = results, open_results(results)
    if path is None and results.folder is None:
        raise InputError("path", "none, for results without a folder", "the path of a file to write")
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
    try:
        with replacing(target) as temporary:
            temporary.write_text(page, encoding="utf-8", newline="")
    except OSError as error:
        expected = f"a file in a folder that can be written ({error.strerror})"
        raise InputError("path", f"'{target}'", expected) from None
    return target


def report_html(results: Results, drawings: pictures.Drawings | None = None) -> str:
    """The page as text; pictures are drawn unless given."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    source = files("femseal.report").joinpath("report.html.jinja").read_text(encoding="utf-8")
    return environment.from_string(source).render(
        _content(results, pictures.draw_all(results) if drawings is None else drawings)
    )


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
        **charts.page_code(),
        "charts": {"leakage": charts.leakage_chart(results)},
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
        "lengths": None,
        "cells": pictures.cell_pictures(results, drawings) if "cells" in drawings else [],
        "drawn": pictures.drawn_picture(results, drawings) if "drawn_corners" in data else None,
        "map_step": "",
        "maps": [],
        "drop": None,
        "drop_sentences": [],
        "budget": error_tables.budget_table(results),
        "scatter": error_tables.scatter_lines(results),
        "checks": error_tables.check_lines(results),
        "attempts": None if results.attempts is None else attempts_table(results.attempts),
        "accuracy": error_tables.accuracy_lines(results),
        "times": error_tables.time_lines(results),
        "warnings": results.warnings,
        "failures": results.failures,
        "versions": flat(json.loads(data.attrs["versions"])),
        "machine": flat(json.loads(data.attrs["machine"])),
        "case": flat(as_chosen(results.case, results.attempts)),
    }
    if "lengths" in drawings:
        content["lengths"] = pictures.lengths_picture(results, drawings)
        content["lengths_table"] = lengths_table(results)
    if "drop" in drawings:
        content["map_step"], content["maps"] = pictures.map_pictures(results, drawings)
        content["drop"] = pictures.drop_picture(results, drawings)
        content["charts"]["drop"] = charts.drop_chart(results, pictures.drop_steps(data))
        content["drop_sentences"] = case_text.pressure_drop_sentences(results)
    return content


def _digest_lines(results: RunData) -> list[tuple[str, str]]:
    """The digest of every measured face: label, text."""
    try:
        faces = json.loads(results.dataset.attrs.get("face_files", "{}"))
        return [(f"SHA-256 of {name}", str(digest)) for name, digest in faces.items()]
    except (TypeError, ValueError, AttributeError):
        return []


def flat(value: Any, name: str = "") -> list[tuple[str, str]]:
    """A nested case as lines of key and value."""
    if isinstance(value, dict):
        return [line for key, item in value.items() for line in flat(item, f"{name}.{key}" if name else str(key))]
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        return [
            line for n, item in enumerate(value, 1) for line in flat(item, name if len(value) == 1 else f"{name} {n}")
        ]
    if isinstance(value, list):
        return [(name, ", ".join(_plain(item) for item in value))]
    return [(name, _plain(value))]


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)

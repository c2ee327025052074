"""Write the report of a run: one self-contained HTML page for screens, phones and paper.

The page contains no scripts and loads no other files. A browser can print the page, also to a PDF file.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import (
    AnyPath,
    FemsealError,
    InputError,
    flatten,
    format_deviation,
    number_text,
    to_text,
    write_text,
    writing,
)
from ..plots.maps import default_step
from ..plots.pressure_lines import surface_leakage
from ..results.attempts import as_chosen, attempts_table
from ..results.dataset_file import FILE_NAME, inconsistent, open_results
from ..results.load_steps import load_names
from ..results.results import Results
from ..results.tables import leakage_table, totals_table
from ..results.verdict_paragraphs import verdict_paragraphs
from . import report_tables
from .pictures import draw_all
from .report_tables import design_section, png_uri

if TYPE_CHECKING:
    import xarray
    from jinja2 import Template

REPORT_NAME = "report.html"
#: Pictures as PNG, by their names.
Drawings = Mapping[str, bytes]


def write_report(
    results: Results | AnyPath, path: AnyPath | None = None, drawings: Drawings | None = None
) -> Path:
    """Write a self-contained HTML page about a run. The page needs no other files and can be printed.

    The page begins with the verdict: the leakage classes, the leakage, the accuracy, and the measures that would help
    most. The next sections are warnings, the leakage against load, maps, cells, faces, tables and the error budget. The
    page is made from the dataset and the pixel fields only, so that a page made later from the results folder is
    identical to the page of the run.

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
        raise InputError("path", "no path, and the results have no folder", "a file to write")
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
    """Return the HTML text of the report page.

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
        stages=_times_of_parts(data),
        case=as_chosen(results.case, attempts),
    )


def _times_of_parts(data: xarray.Dataset) -> dict[str, float]:
    """Return the wall time of each part of a run [s], but not of the single stages within the parts."""
    timings = json.loads(data.attrs["timings"])
    if "timed_parts" in data.attrs:
        return {part: timings[part] for part in json.loads(data.attrs["timed_parts"])}
    # without this attribute, as in files of earlier versions, the name of a stage contains the name of its part
    return {name: seconds for name, seconds in timings.items() if ": " not in name}


@cache
def page_template() -> Template:
    """Compile the Jinja template of the report page."""
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
        "flat": flat_lines,
        "number": number_text,
        "parsed": json.loads,
        "si": to_text,
    }
    return environment.get_template("report.html.jinja")


def _cells_of_half_drop(data: xarray.Dataset, step: int) -> int:
    """Return the smallest number of cells that together account for half of the pressure drop over the seal.

    The dataset contains the pressure drop of each cell as a fraction of the pressure drop over the seal. The largest
    fractions are added up, in decreasing order, until their sum reaches 1/2. The result is 0 if the fractions are
    unknown.
    """
    if "cell_drop_fraction" not in data:
        return 0
    fractions = data["cell_drop_fraction"].values[step].ravel()
    if np.isnan(fractions).any():
        return 0
    largest_first = np.sort(fractions)[::-1]
    return int(np.searchsorted(np.cumsum(largest_first), 0.5)) + 1


def flat_lines(table: dict[str, Any]) -> list[tuple[str, str]]:
    """Convert nested tables to pairs of a dotted key and its value as text.

    >>> flat_lines({"load": {"loading": [1e6, 2e6]}, "face": [{"kind": "file"}]})
    [('load.loading', '1e+06, 2e+06'), ('face.0.kind', 'file')]
    """
    return [(key, _plain_text(value)) for key, value in flatten(table).items()]


def _plain_text(value: Any) -> str:
    """Convert a value or a list of values to text. A float is written with at most six significant digits."""
    items = value if isinstance(value, list) else [value]
    return ", ".join(f"{item:g}" if isinstance(item, float) else str(item) for item in items)

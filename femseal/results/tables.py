"""Make tables and short summaries of results, for reading or for use in spreadsheets."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import TextTable, counted, rows_of, to_text
from ..base.fields import Field, with_unit
from ..base.leak_units import USUAL_UNITS
from .leakage_format import (
    class_unit,
    format_interval,
    format_leakage,
    format_scatter,
    leakage_label,
)
from .load_steps import branch_text, cycle_text, load_format
from .pixel_fields import stored_steps
from .results import Results

if TYPE_CHECKING:
    import xarray

#: Heading of a column of a table, and the text in each line of the column.
Column = tuple[str, list[str]]

#: Headings in the terminal that are longer than this are broken between words [characters].
_HEADING_WIDTH = 10
# --- tables for programs ----------------------------------------------------------------------------------------


def rows(run: Results) -> list[dict[str, Any]]:
    """Return the results at all load steps in SI units, and the leakage also in other units.

    Parameters
    ----------
    run : Results
        Results of a run.

    Returns
    -------
    list of dict
        Results of each load step, as a dictionary whose keys contain the units, such as "leakage_m2_per_s".
    """
    data = run.dataset
    variables = {"nominal_pressure_Pa": data["nominal_pressure"], "leakage_m2_per_s": run.leakage}
    for variable in data.data_vars.values():
        if variable.dims == ("step",):
            variables[Field.from_variable(variable).column_name] = variable
    for unit in run.leak_basis.units():
        if unit.si != 1:
            variables[with_unit("leakage", unit.name)] = run.leakage_in(unit.name)
    if "class_fraction" in data:
        for fraction in data["class_fraction"]:
            name = str(fraction["leak_class"].values)
            variables[with_unit("fraction_in", name)] = fraction
    branch = [branch_text(peak) for peak in data["unloaded_from"].values]
    numbers = {name: variable.values.astype(float) for name, variable in variables.items()}
    return rows_of({"step": data["step"], "branch": branch} | numbers)


def write_workbook(run: Results, path: Path) -> Path:
    """Write `rows` to an Excel workbook.

    NaN becomes an empty cell. Texts that begin with "=" are not interpreted as formulas.
    """
    from pandas import DataFrame, ExcelWriter

    options = {"in_memory": True, "strings_to_formulas": False, "strings_to_urls": False}
    with ExcelWriter(path, engine="xlsxwriter", engine_kwargs={"options": options}) as book:
        table = DataFrame(rows(run))
        table.to_excel(book, sheet_name="leakage", index=False, freeze_panes=(1, 3))
        sheet = book.sheets["leakage"]
        sheet.autofilter(0, 0, len(table), len(table.columns) - 1)
        sheet.autofit()
    return path


# --- tables for people ------------------------------------------------------------------------------------------


def leakage_table(run: Results) -> TextTable:
    """Return the leakage as a table, which `rich.print` can display.

    The columns of the table are:

    - the branch of the load cycle and the load,
    - the leakage by the best method, with its 95 % interval and its scatter between realisations,
    - the leakage of the whole seal,
    - other variables over the load steps, such as the leakage by other methods,
    - the leakage of the test fluid, and
    - the leakage classes that are met.

    The unit of the leakage is given in the title of the table. The leakage of the whole seal and of the test fluid have
    other units, which are given in their column headings.

    Parameters
    ----------
    run : Results
        Results of a run.

    Returns
    -------
    TextTable
        Table with one line for each load step.
    """
    data = run.dataset
    best = run.leakage
    unit, factor = run.leak_scale
    heading = best.attrs.get("heading", run.method)
    columns = [
        *_load_columns(data),
        (heading, _value_texts(best, factor)),
        *_interval_columns(run, factor),
    ]
    if unit.per_length:
        seal_unit = run.leak_basis.readable(best.values)
        seal_factor = run.leak_basis.factor(seal_unit)
        texts = [format_leakage(leakage, seal_factor) for leakage in best.values]
        columns.append((f"whole seal [{seal_unit.name}]", texts))
    data_with_headings = data.filter_by_attrs(heading=lambda text: text is not None)
    for name, variable in data_with_headings.items():
        is_shown = name != "sealed_fraction" or bool(variable.any())
        if is_shown and name != best.name:
            columns.append((variable.attrs["heading"], _value_texts(variable, factor)))
    if "test_leakage" in data:
        test_unit = class_unit(run)
        test_factor = run.class_basis.factor(test_unit)
        texts = [format_leakage(leakage, test_factor) for leakage in data["test_leakage"].values]
        columns.append((f"test fluid [{test_unit.name}]", texts))
    if "leak_class" in data.coords:
        columns.append(("class", run.classes))
    title = f"{leakage_label(run)} in {unit.name}"
    columns = [(heading, _with_open_steps(run, texts)) for heading, texts in columns]
    return TextTable.of_columns(title, columns, grouped=True, wrap=_HEADING_WIDTH)


def _interval_columns(run: Results, factor: float) -> list[Column]:
    """Return the columns for the 95 % interval and for the scatter between realisations, if they are known.

    Parameters
    ----------
    run : results of a run.
    factor : leakage per unit seal length [m²/s] that corresponds to 1 in the unit of the table.
    """
    data = run.dataset
    budget = run.budget
    columns: list[Column] = []
    if budget is not None:
        by_step = zip(budget.lower, budget.upper, run.leakage.values, strict=True)
        texts = [format_interval(low, high, factor, leakage) for low, high, leakage in by_step]
        columns.append(("95 % interval", texts))
    if "leakage_lower" in data:
        lower, upper = data["leakage_lower"], data["leakage_upper"]
        quantiles = "–".join(f"{100 * end.attrs['quantile']:g}" for end in (lower, upper))
        pairs = zip(lower.values, upper.values, strict=True)
        texts = [format_scatter(low, high, factor) for low, high in pairs]
        columns.append((f"scatter between seals, {quantiles} %", texts))
    return columns


def totals_table(run: Results) -> TextTable:
    """Return a table of the leakage in several units, with a column for each unit."""
    units = run.leak_basis.units(USUAL_UNITS)
    if run.leak_unit not in units:
        units = [*units, run.leak_unit]
    columns = _load_columns(run.dataset)
    for unit in units:
        columns.append((unit.name, leakage_texts(run, run.leak_basis.factor(unit))))
    return TextTable.of_columns("leakage in several units", columns, grouped=True)


def _load_columns(data: xarray.Dataset) -> list[Column]:
    """Return the columns for the branch, the force (if the case gives forces) and the nominal pressure."""
    loads = load_format(data)
    pressures = data["nominal_pressure"].values.tolist()
    branch = [branch_text(peak, loads.full) for peak in data["unloaded_from"].values]
    columns = [("branch", branch)]
    if loads.unit:
        name, per_pascal = loads.axis
        columns.append((name, [f"{per_pascal * pressure:.4g}" for pressure in pressures]))
    columns.append(("pressure", [to_text(pressure, "Pa") for pressure in pressures]))
    return columns


def _value_texts(variable: xarray.DataArray, factor: float) -> list[str]:
    """Convert the values of a variable at all load steps to strings.

    A leakage is divided by `factor`, the leakage [m²/s] that corresponds to 1 in the unit of the table. A fraction is
    given in per cent.
    """
    unit = variable.attrs["units"]
    if unit == "m^2/s":
        return [format_leakage(value, factor) for value in variable.values]
    if unit == "1":
        return ["–" if np.isnan(value) else f"{100 * value:.3g}" for value in variable.values]
    return [to_text(value, unit, 3) for value in variable.values]


def leakage_texts(run: Results, factor: float) -> list[str]:
    """Convert the leakage at every load step to text, which is "open" if the surfaces are separated.

    Parameters
    ----------
    run : results of a run.
    factor : leakage per unit seal length [m²/s] that corresponds to 1 in the unit of the table.
    """
    return _with_open_steps(run, _value_texts(run.leakage, factor))


def _with_open_steps(run: Results, texts: Iterable[str]) -> list[str]:
    """Replace "failed" by "open" at the steps where the fluid carries the whole load."""
    texts = list(texts)
    for step in run.open_steps:
        if texts[step] == "failed":
            texts[step] = "open"
    return texts


# --- summary of results -----------------------------------------------------------------------------------------


def summary_text(run: Results) -> str:
    """Summarise the main results as text, with one result per line."""
    title = run.case.get("title", "")
    head = f"femseal.Results {title!r}" if title else "femseal.Results"
    facts = contents(run)
    if run.folder:
        facts["folder"] = str(run.folder)
    lines = [f"{name:<10} {value}" for name, value in facts.items()]
    return "\n".join([f"<{head}>", *lines])


def summary_html(run: Results) -> str:
    """Summarise the main results as HTML, with the table of the leakage."""
    title = escape(run.case.get("title", "") or "femseal results")
    facts = TextTable("", (), tuple(contents(run).items()))._repr_html_()
    return f"<div><b>{title}</b>\n{facts}\n{leakage_table(run)._repr_html_()}</div>"


def contents(run: Results) -> dict[str, str]:
    """Return the main results as strings, by the names of the results."""
    steps = run.steps
    unit, factor = run.leak_scale
    leakage_at_peak = run.leakage.values[run.peak]
    leakage_text = format_leakage(leakage_at_peak, factor, unit)
    peak_text = to_text(steps[run.peak].pressure, "Pa")
    facts = {
        "leakage": f"at {peak_text}: {leakage_text} ({run.method})",
        "load": cycle_text(steps),
    }
    load_text = load_format(run.dataset, 3).full
    for verdict in run.verdicts:
        assembly_load = load_text(verdict.assembly_load)
        facts[f"class {verdict.name}"] = f"{verdict.answer}, at {assembly_load}"
    stored = stored_steps(run)
    if stored:
        facts["fields"] = f"over all pixels at {len(stored)} of {counted(len(steps), 'step')}"
    for name, texts in (("warnings", run.warnings), ("failures", run.failures)):
        if texts:
            facts[name] = f"{len(texts)}, the first: {texts[0]}"
    if run.left_out:
        facts["left out"] = "; ".join(run.left_out)
    return facts

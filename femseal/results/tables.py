"""Make tables and short summaries of results, for reading or for use in spreadsheets."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from math import inf, log1p
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import TextTable, counted, duration, format_deviation, number_text, rows_of, to_text
from ..base.fields import Field, with_unit
from ..base.leak_units import LEAK_UNITS, USUAL_UNITS, LeakUnit
from ..budget import VAGUE
from .load_steps import branch_text, cycle_text, load_format
from .pixel_fields import stored_steps
from .results import Results

if TYPE_CHECKING:
    import xarray

#: Heading of a column of a table, and the text of each of its lines.
Column = tuple[str, list[str]]

#: Headings in the terminal that are longer than this are broken between words [characters].
_HEADING_WIDTH = 10
#: If the upper end of an interval is at most this many times the lower end, the interval is written with three digits,
#: otherwise with two digits.
_NARROW_RATIO = 1.2

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
    title = f"{leakage_of(run)} in {unit.name}"
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
        texts = [_scatter_text(low, high, factor) for low, high in pairs]
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


# --- units and numbers ------------------------------------------------------------------------------------------


def class_unit(run: Results) -> LeakUnit:
    """Return the unit in which the class leakage is shown.

    In a run without a test fluid, the class leakage has the unit of all leakages of the run. In a run with a test
    fluid, the class leakage has the unit of the case. If this unit does not suit the test fluid, a usual unit for gases
    or liquids is taken.
    """
    if "test_leakage" not in run.dataset:
        return run.leak_unit
    basis, asked = run.class_basis, run.asked_unit
    if asked is not None and basis.has(asked):
        return asked
    return LEAK_UNITS["mbar·L/(m·s)" if basis.is_gas else "mL/(m·min)"]


def leakage_of(run: Results) -> str:
    """Describe the leakage that tables show: per unit length, or of the whole seal with its length."""
    text = kind_of(run.leak_unit)
    return text if run.leak_unit.per_length else f"{text}, {to_text(run.leak_basis.length, 'm')},"


def kind_of(unit: LeakUnit) -> str:
    """Say whether a unit is for the leakage per unit seal length or for the leakage of the whole seal."""
    return "leakage per length of seal" if unit.per_length else "leakage of the whole seal"


def format_leakage(value: float, factor: float, unit: LeakUnit | None = None) -> str:
    """Format a leakage with three digits, as "sealed" if it is 0, and as "failed" if it is NaN.

    Parameters
    ----------
    value : leakage per unit seal length [m²/s].
    factor : leakage per unit seal length [m²/s] that corresponds to 1 in the unit of the text.
    unit : unit that is written behind a number; None for a number without a unit.
    """
    if np.isnan(value):
        return "failed"
    return "sealed" if value == 0 else f"{number_text(value / factor)}{_behind_number(unit)}"


def format_interval(
    low: float, high: float, factor: float, leakage: float, unit: LeakUnit | None = None
) -> str:
    """Format the 95 % interval of a leakage.

    An end of the interval is written as a number with two digits, or with three digits if the interval is narrow. An
    end that differs from the leakage by more than a factor of `VAGUE` is described in words.

    Parameters
    ----------
    low, high : lower and upper ends of the 95 % interval [m²/s].
    factor : leakage per unit seal length [m²/s] that corresponds to 1 in the unit of the text.
    leakage : leakage whose interval is written [m²/s].
    unit : unit that is written behind the number of the upper end; None for numbers without a unit.

    Examples
    --------
    >>> format_interval(0.1, 2.0, 1.0, leakage=1.0), format_interval(0.0, 2.0, 1.0, 1.0, LEAK_UNITS["mL/h"])
    ('0.1–2', 'sealed–2 mL/h')
    >>> format_interval(1e-6, 2.0, 1.0, leakage=1.0), format_interval(1e-6, 2e39, 1.0, 1.0, LEAK_UNITS["mL/h"])
    ('≈0–2', '≈0 to > 1000 times')
    """
    magnitude = abs(leakage)
    if np.isnan(low) or np.isnan(high):
        return "unknown"
    if np.isinf(high):
        return "open or sealed" if low == 0 else f"{format_leakage(low, factor, unit)} or more"
    if low == high == 0:
        return "sealed"
    is_narrow = high <= _NARROW_RATIO * low
    digits = 3 if is_narrow else 2
    lower = number_text(low / factor, digits) if low else "sealed"
    upper = f"{number_text(high / factor, digits)}{_behind_number(unit)}" if high else "sealed"
    dash = _dash_after(low)
    # ends that differ from the leakage by more than a factor of `VAGUE`
    if 0 < VAGUE * low < magnitude:
        lower = "≈0"
    if high > VAGUE * magnitude > 0:
        upper = f"> {VAGUE:g} times"
        dash = " to "
    return f"{lower}{dash}{upper}"


def _scatter_text(low: float, high: float, factor: float) -> str:
    """Format the leakages at two quantiles of the realisations; see `format_leakage`."""
    lower = format_leakage(low, factor)
    upper = format_leakage(high, factor)
    return lower if lower == upper else f"{lower}{_dash_after(low)}{upper}"


def _dash_after(low: float) -> str:
    """Return the text between the ends of an interval: "to" if a dash behind a negative lower end could be misread."""
    return " to " if low < 0 else "–"


def format_upper_end(high: float, factor: float, unit: LeakUnit) -> str:
    """Format the upper end of the 95 % interval of a seal that does not leak as computed.

    Parameters
    ----------
    high : upper end of the 95 % interval [m²/s], finite and positive.
    factor : leakage per unit seal length [m²/s] that corresponds to 1 in the unit of the text.
    unit : unit of the text.
    """
    return f"up to {number_text(high / factor, 2)}{_behind_number(unit)}"


def _behind_number(unit: LeakUnit | None) -> str:
    """Return a unit with a space before it, "" without a unit."""
    return "" if unit is None else f" {unit.name}"


# --- attempts to reach a requested accuracy ---------------------------------------------------------------------


def attempt_sentences(attempts: dict[str, Any]) -> list[str]:
    """Say whether the requested accuracy is reached, what limits the accuracy, and what halving the error would cost.

    Parameters
    ----------
    attempts : record of the attempts, as in `Results.attempts`.
    """
    wanted = format_deviation(log1p(attempts["wanted"]))
    reached = "reached" if attempts["reached"] else "not reached"
    sentences = [
        f"The accuracy of {wanted} is {reached}: the leakage is known within {half_width_text(attempts)} at all loads "
        "that leak more than 1/1000 of the first, by the numerical sources of its error budget alone."
    ]
    model_parts = attempts.get("model_parts")
    if model_parts:
        half_width = attempts["with_model"]
        error = format_deviation(inf if half_width is None else half_width)
        sources = ", ".join(model_parts)
        sentences.append(f"With the model and its input ({sources}) it is known within {error}.")
    has_error = attempts["half_width"] != 0
    if has_error:
        sentences.append(f"It is limited by the {attempts['limit']}, most at {attempts['load']}.")
    if attempts["why"]:
        sentences.append(f"No further attempt: {attempts['why']}.")
    # the reason why there was no further attempt says already why the error cannot be halved
    can_halve = attempts.get("can_halve_error")
    if can_halve is None:  # in a record of an earlier version, only the text says so
        can_halve = not attempts["half_error"].startswith("not possible")
    is_reason_stated = attempts["why"] and not can_halve
    if has_error and not is_reason_stated:
        sentences.append(f"Half the error: {attempts['half_error']}.")
    return sentences


def attempts_table(attempts: dict[str, Any]) -> TextTable:
    """Return a table with a line for each attempt to reach the requested accuracy, and a note on the outcome.

    Parameters
    ----------
    attempts : record of the attempts, as in `Results.attempts`.
    """
    records = attempts["attempts"]
    settings = [attempt["settings"] for attempt in records]
    columns: list[Column] = [
        ("attempt", [str(number) for number in range(1, len(records) + 1)]),
        ("method", [setting["method"] for setting in settings]),
        ("points", [" × ".join(map(str, attempt["points"])) for attempt in records]),
        ("residual", [f"{setting['rtol']:.0e}" for setting in settings]),
        ("seals", [str(setting["realisations"] or "–") for setting in settings]),
        ("time", [duration(attempt["seconds"]) for attempt in records]),
        ("error", [half_width_text(attempt) for attempt in records]),
        ("limited by", [attempt["limit"] for attempt in records]),
    ]
    notes = (" ".join(attempt_sentences(attempts)),)
    return TextTable.of_columns("", columns, names=len(columns), notes=notes)


def as_chosen(case: dict[str, Any], attempts: dict[str, Any] | None) -> dict[str, Any]:
    """Return a copy of a case with the settings of the last attempt to reach the requested accuracy.

    Parameters
    ----------
    case : case in SI units, as in `Results.case`.
    attempts : record of the attempts, as in `Results.attempts`; None if the case requests no accuracy.
    """
    if attempts is None:
        return case
    chosen = attempts["settings"]
    changes = {"method": chosen["method"], "contact": case["contact"] | {"rtol": chosen["rtol"]}}
    realisations = chosen["realisations"]
    if case.get("stochastic") is not None and realisations is not None:
        changes["stochastic"] = case["stochastic"] | {"realisations": realisations}
    return case | changes


def half_width_text(attempt: dict[str, Any]) -> str:
    """Format the half-width of the 95 % interval of ln(leakage) after an attempt, as infinity if unknown."""
    width = attempt["half_width"]
    return format_deviation(inf if width is None else width)


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

"""Results as tables, for people and for spreadsheets, and in a few lines; the attempts at a wanted accuracy."""

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
from .load_steps import branch_text, cycle_text, force_scale, loads_as_given
from .pixel_fields import stored_steps
from .results import Results

if TYPE_CHECKING:
    import xarray

#: A column of a table: heading, and the text of each line.
Column = tuple[str, list[str]]

#: Length of a heading in the terminal beyond which it is broken between words.
_HEADING_WIDTH = 10
#: Ratio of the ends of an interval up to which they have three digits instead of two.
_NARROW_RATIO = 1.2

# --- tables for programs ----------------------------------------------------------------------------------------


def rows(run: Results) -> list[dict[str, Any]]:
    """Return the table of results in SI, with leakage in more units in the last columns.

    Parameters
    ----------
    run : Results
        The results.

    Returns
    -------
    list of dict
        One for each load step. Keys contain the units, such as "leakage_m2_per_s".
    """
    data = run.dataset
    variables = {"nominal_pressure_Pa": data["nominal_pressure"], "leakage_m2_per_s": run.leakage}
    for variable in data.data_vars.values():
        if variable.dims == ("step",):
            variables[Field.of(variable).column_name] = variable
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
    """Write the rows as a sheet of an Excel workbook; NaN is an empty cell, and no text is read as a formula."""
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
    """Return the table of the leakage for people, to be given to `rich.print`.

    Its columns are branch, load, leakage with its intervals, leakage of the whole seal, every field over the load steps
    that has a heading, leakage of the test fluid, and leakage classes. All leakages but that of the whole seal and of
    the test fluid are in one unit.

    Parameters
    ----------
    run : Results
        The results.

    Returns
    -------
    TextTable
        One line for each load step.
    """
    data, best = run.dataset, run.leakage
    unit, factor = run.leak_scale
    heading = best.attrs.get("heading", run.method)
    columns = [
        *_load_columns(data),
        (heading, _cells(best, factor)),
        *_interval_columns(run, factor),
    ]
    if unit.per_length:
        whole = run.leak_basis.readable(best.values)
        texts = [format_leakage(q, run.leak_basis.factor(whole)) for q in best.values]
        columns.append((f"whole seal [{whole.name}]", texts))
    with_heading = data.filter_by_attrs(heading=lambda text: text is not None)
    for name, variable in with_heading.items():
        is_shown = name != "sealed_fraction" or bool(variable.any())
        if is_shown and name != best.name:
            columns.append((variable.attrs["heading"], _cells(variable, factor)))
    if "test_leakage" in data:
        test_unit = class_unit(run)
        scale = run.class_basis.factor(test_unit)
        texts = [format_leakage(q, scale) for q in data["test_leakage"].values]
        columns.append((f"test fluid [{test_unit.name}]", texts))
    if "leak_class" in data.coords:
        columns.append(("class", run.classes))
    title = f"{leakage_of(run)} in {unit.name}"
    columns = [(heading, _with_open_steps(run, texts)) for heading, texts in columns]
    return TextTable.of_columns(title, columns, grouped=True, wrap=_HEADING_WIDTH)


def _interval_columns(run: Results, factor: float) -> list[Column]:
    """Return the columns of the 95 % interval, and of the scatter between realisations, as far as they are known."""
    data, budget = run.dataset, run.budget
    columns: list[Column] = []
    if budget is not None:
        ends = zip(budget.lower, budget.upper, run.leakage.values, strict=True)
        texts = [format_interval(low, high, factor, q) for low, high, q in ends]
        columns.append(("95 % interval", texts))
    if "leakage_lower" in data:
        lower, upper = data["leakage_lower"], data["leakage_upper"]
        quantiles = "–".join(f"{100 * end.attrs['quantile']:g}" for end in (lower, upper))
        pairs = zip(_cells(lower, factor), _cells(upper, factor), strict=True)
        texts = [low if low == high else _joined(low, high) for low, high in pairs]
        columns.append((f"scatter between seals, {quantiles} %", texts))
    return columns


def totals_table(run: Results) -> TextTable:
    """Return a table of the leakage in several units, with a column for each."""
    units = run.leak_basis.units(USUAL_UNITS)
    if run.leak_unit not in units:
        units = [*units, run.leak_unit]
    columns = _load_columns(run.dataset)
    for unit in units:
        columns.append((unit.name, leakage_texts(run, run.leak_basis.factor(unit))))
    return TextTable.of_columns("leakage in several units", columns, grouped=True)


def _load_columns(data: xarray.Dataset) -> list[Column]:
    """Return the columns of branch, of force if the case gives forces, and of nominal pressure."""
    scale, load_text = force_scale(data), loads_as_given(data)
    pressures = data["nominal_pressure"].values.tolist()
    columns = [("branch", [branch_text(peak, load_text) for peak in data["unloaded_from"].values])]
    if scale is not None:
        forces = [f"{scale.per_pascal * pressure:.4g}" for pressure in pressures]
        columns.append((f"force [{scale.unit}]", forces))
    columns.append(("pressure", [to_text(pressure, "Pa") for pressure in pressures]))
    return columns


def _cells(variable: xarray.DataArray, factor: float) -> list[str]:
    """Return values over the load steps as texts: leakage in the unit `factor`, fractions in per cent."""
    unit = variable.attrs["units"]
    if unit == "m^2/s":
        return [format_leakage(value, factor) for value in variable.values]
    if unit == "1":
        return ["–" if np.isnan(value) else f"{100 * value:.3g}" for value in variable.values]
    return [to_text(value, unit, 3) for value in variable.values]


def leakage_texts(run: Results, factor: float) -> list[str]:
    """Return the leakage at every step in the unit `factor` as text, see `format_leakage`; "open" at open steps."""
    return _with_open_steps(run, _cells(run.leakage, factor))


def _with_open_steps(run: Results, texts: Iterable[str]) -> list[str]:
    """Replace "failed" by "open" at steps where the fluid carries all of the load."""
    texts = list(texts)
    for step in run.open_steps:
        if texts[step] == "failed":
            texts[step] = "open"
    return texts


# --- units and numbers ------------------------------------------------------------------------------------------


def class_unit(run: Results) -> LeakUnit:
    """Return the unit of the leakage that decides on classes: that of the case if it is for the test fluid."""
    if "test_leakage" not in run.dataset:
        return run.leak_unit
    basis, asked = run.class_basis, run.asked_unit
    if asked is not None and basis.has(asked):
        return asked
    return LEAK_UNITS["mbar·L/(m·s)" if basis.is_gas else "mL/(m·min)"]


def leakage_of(run: Results) -> str:
    """Return what the leakage in its unit refers to, with the length of a whole seal."""
    text = kind_of(run.leak_unit)
    return text if run.leak_unit.per_length else f"{text}, {to_text(run.leak_basis.length, 'm')},"


def kind_of(unit: LeakUnit) -> str:
    """Return what a leakage in a unit refers to."""
    return "leakage per length of seal" if unit.per_length else "leakage of the whole seal"


def format_leakage(value: float, factor: float) -> str:
    """Return a leakage as text with three digits; "sealed" for 0, "failed" for NaN.

    Parameters
    ----------
    value : the leakage [m²/s].
    factor : leakage [m²/s] that is 1 in the unit of the text.
    """
    if np.isnan(value):
        return "failed"
    return "sealed" if value == 0 else number_text(value / factor)


def format_interval(low: float, high: float, factor: float, leakage: float) -> str:
    """Return both ends of the 95 % interval of a leakage as text.

    Ends that differ from the leakage by more than a factor of `VAGUE` have no number. The others have two digits, or
    three if the interval is narrow.

    Parameters
    ----------
    low, high : ends of the interval [m²/s].
    factor : leakage [m²/s] that is 1 in the unit of the text.
    leakage : the leakage [m²/s].

    Examples
    --------
    >>> format_interval(0.1, 2.0, 1.0, leakage=1.0), format_interval(0.0, 2.0, 1.0, leakage=1.0)
    ('0.1–2', 'sealed–2')
    >>> format_interval(1e-6, 2.0, 1.0, leakage=1.0), format_interval(1e-6, 2e39, 1.0, leakage=1.0)
    ('≈0–2', '≈0 to > 1000 times')
    """
    size = abs(leakage)
    if np.isnan(low) or np.isnan(high):
        return "unknown"
    if np.isinf(high):
        return "open or sealed" if low == 0 else f"{format_leakage(low, factor)} or more"
    digits = 2 if high > _NARROW_RATIO * low else 3
    lower = number_text(low / factor, digits) if low else "sealed"
    upper = number_text(high / factor, digits) if high else "sealed"
    if 0 < VAGUE * low < size:
        lower = "≈0"
    if high > VAGUE * size > 0:
        upper = f"> {VAGUE:g} times"
    return "sealed" if low == high == 0 else _joined(lower, upper)


def _joined(low: str, high: str) -> str:
    """Join both ends of an interval; a dash would be misread before a minus sign."""
    is_ambiguous = low.startswith("-") or high.startswith(">")
    return f"{low} to {high}" if is_ambiguous else f"{low}–{high}"


def with_leak_unit(text: str, unit: LeakUnit) -> str:
    """Add the unit to a leakage or an interval as text, except to words such as "sealed".

    Examples
    --------
    >>> [with_leak_unit(text, LEAK_UNITS["mL/h"]) for text in ("0.1–2", "sealed–2", "sealed", "≈0 to > 1000 times")]
    ['0.1–2 mL/h', 'sealed–2 mL/h', 'sealed', '≈0 to > 1000 times']
    """
    number = text.removesuffix(" or more")
    rest = text[len(number) :]
    # superscripts of powers of ten are digits as well
    return f"{number} {unit.name}{rest}" if number[-1:].isdigit() else text


# --- attempts at a wanted accuracy ------------------------------------------------------------------------------


def attempt_sentences(attempts: dict[str, Any]) -> list[str]:
    """Return sentences that say whether the wanted accuracy is reached, what limits it, and what half the error costs.

    Parameters
    ----------
    attempts : as `Results.attempts` has them.
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
    is_known_to_fail = attempts["why"] and attempts["half_error"].startswith("cannot")
    if has_error and not is_known_to_fail:
        sentences.append(f"Half the error: {attempts['half_error']}.")
    return sentences


def attempts_table(attempts: dict[str, Any]) -> TextTable:
    """Return a table with a line for each attempt at the wanted accuracy, and with sentences on them as notes.

    Parameters
    ----------
    attempts : as `Results.attempts` has them.
    """
    single = attempts["attempts"]
    settings = [attempt["settings"] for attempt in single]
    columns: list[Column] = [
        ("attempt", [str(number) for number in range(1, len(single) + 1)]),
        ("method", [setting["method"] for setting in settings]),
        ("points", [" × ".join(map(str, attempt["points"])) for attempt in single]),
        ("residual", [f"{setting['rtol']:.0e}" for setting in settings]),
        ("seals", [str(setting["realisations"] or "–") for setting in settings]),
        ("time", [duration(attempt["seconds"]) for attempt in single]),
        ("error", [half_width_text(attempt) for attempt in single]),
        ("limited by", [attempt["limit"] for attempt in single]),
    ]
    notes = (" ".join(attempt_sentences(attempts)),)
    return TextTable.of_columns("", columns, names=len(columns), notes=notes)


def as_chosen(case: dict[str, Any], attempts: dict[str, Any] | None) -> dict[str, Any]:
    """Return a case with the values that the last attempt has chosen for keys that the case leaves open.

    Parameters
    ----------
    case : in SI, as `Results.case` has it.
    attempts : as `Results.attempts` has them; None leaves the case as it is.
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
    """Return the half-width of the 95 % interval as text; None stands for one that is not known."""
    width = attempt["half_width"]
    return format_deviation(inf if width is None else width)


# --- a few lines on the results ---------------------------------------------------------------------------------


def summary_text(run: Results) -> str:
    """Return the main results as text, one per line."""
    title = run.case.get("title", "")
    head = f"femseal.Results {title!r}" if title else "femseal.Results"
    facts = contents(run)
    if run.folder:
        facts["folder"] = str(run.folder)
    lines = [f"{name:<10} {value}" for name, value in facts.items()]
    return "\n".join([f"<{head}>", *lines])


def summary_html(run: Results) -> str:
    """Return the main results and the table of the leakage as HTML."""
    title = escape(run.case.get("title", "") or "femseal results")
    facts = TextTable("", (), tuple(contents(run).items()))._repr_html_()
    return f"<div><b>{title}</b>\n{facts}\n{leakage_table(run)._repr_html_()}</div>"


def contents(run: Results) -> dict[str, str]:
    """Return name and text of each of the main results."""
    steps, peak = run.steps, run.peak
    unit, factor = run.leak_scale
    leakage = run.leakage.values[peak]
    text = with_leak_unit(format_leakage(leakage, factor), unit)
    facts = {
        "leakage": f"at {to_text(steps[peak].pressure, 'Pa')}: {text} ({run.method})",
        "load": cycle_text(steps),
    }
    load_text = loads_as_given(run.dataset, 3)
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

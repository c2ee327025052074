"""Results as tables, for people and for a spreadsheet, and in a few lines; the attempts at a wanted accuracy."""

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
from .pixel_fields import stored_steps
from .results import Results, branch_text, cycle_text, force_scale, loads_as_given

if TYPE_CHECKING:
    import xarray

#: Length of a heading in the terminal beyond which it is broken between words.
_HEADING = 10
#: Ratio of the ends of a narrow band.
_NARROW = 1.2


def rows(run: Results) -> list[dict[str, Any]]:
    """The table as dictionaries in SI, one for each step, with leakage in more units at the end; keys carry units."""
    data = run.dataset
    numbers = {"nominal_pressure_Pa": data["nominal_pressure"], "leakage_m2_per_s": run.leakage}
    numbers |= {Field.of(v).column_name: v for v in data.data_vars.values() if v.dims == ("step",)}
    for unit in run.leak_basis.units():
        if unit.si != 1:
            numbers[with_unit("leakage", unit.name)] = run.leakage_in(unit.name)
    if "class_fraction" in data:
        for fraction in data["class_fraction"]:
            numbers[with_unit("fraction_in", str(fraction["leak_class"].values))] = fraction
    branch = [branch_text(peak) for peak in data["unloaded_from"].values]
    reals = {name: values.values.astype(float) for name, values in numbers.items()}
    return rows_of({"step": data["step"], "branch": branch} | reals)


def write_workbook(run: Results, path: Path) -> Path:
    """Write the rows as a sheet of a workbook, .xlsx; texts are texts, whatever they begin with, NaN is empty."""
    from pandas import DataFrame, ExcelWriter

    plain = {"options": {"in_memory": True, "strings_to_formulas": False, "strings_to_urls": False}}
    with ExcelWriter(path, engine="xlsxwriter", engine_kwargs=plain) as book:
        table = DataFrame(rows(run))
        table.to_excel(book, sheet_name="leakage", index=False, freeze_panes=(1, 3))
        sheet = book.sheets["leakage"]
        sheet.autofilter(0, 0, len(table), len(table.columns) - 1)
        sheet.autofit()
    return path


def leakage_table(run: Results) -> TextTable:
    """The table for people, for `rich.print`: one unit of leakage in all columns but one, 0 is "sealed".

    Branch, pressure, leakage with its bands, that of the whole seal, and every field over the steps that has a heading.
    """
    data, best, basis = run.dataset, run.leakage, run.leak_basis
    unit, factor = run.leak_scale
    leakage = (best.attrs.get("heading", run.method), _cells(best, factor))
    columns: list[tuple[str, Iterable[str]]] = [*_loads(data), leakage]
    if (budget := run.budget) is not None:
        bands = zip(budget.lower, budget.upper, best.values, strict=True)
        texts = [format_error_band(low, high, factor, q) for low, high, q in bands]
        columns.append(("95 % band of error", texts))
    if "leakage_lower" in data:
        ends = data["leakage_lower"], data["leakage_upper"]
        # second to the band of error, which is of the leakage that is given
        range_ = "–".join(f"{100 * end.attrs['quantile']:g}" for end in ends)
        lows, highs = (_cells(end, factor) for end in ends)
        texts = [a if a == b else _joined(a, b) for a, b in zip(lows, highs, strict=True)]
        columns.append((f"redraws of the measured patch, {range_} %", texts))
    if unit.per_length:
        whole = basis.readable(best.values)
        texts = [format_leakage(q, basis.factor(whole)) for q in best.values]
        columns.append((f"whole seal [{whole.name}]", texts))
    for name, variable in data.filter_by_attrs(heading=lambda text: text is not None).items():
        # no column for sealed realisations if there are none
        if name != best.name and (name != "sealed_fraction" or variable.any()):
            columns.append((variable.attrs["heading"], _cells(variable, factor)))
    if "test_leakage" in data:
        test = class_unit(run)
        scale = run.class_basis.factor(test)
        texts = [format_leakage(q, scale) for q in data["test_leakage"].values]
        columns.append((f"test fluid [{test.name}]", texts))
    if "leak_class" in data.coords:
        columns.append(("class", run.classes))
    shown = [(head, _of_steps(run, texts)) for head, texts in columns]
    title = f"{leakage_of(run)} in {unit.name}"
    return TextTable.of_columns(title, shown, grouped=True, wrap=_HEADING)


def totals_table(run: Results) -> TextTable:
    """The leakage in several units: branch, pressure, and a column for each unit."""
    basis, own = run.leak_basis, run.leak_unit
    units = basis.units(USUAL_UNITS)
    units += [] if own in units else [own]
    columns = [(unit.name, leakage_texts(run, basis.factor(unit))) for unit in units]
    columns = [*_loads(run.dataset), *columns]
    return TextTable.of_columns("leakage in several units", columns, grouped=True)


def _loads(data: xarray.Dataset) -> list[tuple[str, list[str]]]:
    """The columns of branch, of the force where the case gives forces, and of nominal pressure."""
    force, text = force_scale(data), loads_as_given(data)
    nominal = data["nominal_pressure"].values.tolist()
    columns = [("branch", [branch_text(peak, text) for peak in data["unloaded_from"].values])]
    if force:
        columns.append((f"force [{force[0]}]", [f"{force[1] * p:.4g}" for p in nominal]))
    return [*columns, ("pressure", [to_text(p, "Pa") for p in nominal])]


def class_unit(run: Results) -> LeakUnit:
    """The unit of the leakage that decides on classes: that of the case where it is for the test fluid."""
    basis = run.class_basis
    if "test_leakage" not in run.dataset:
        return run.leak_unit
    if (asked := run.asked_unit) is not None and basis.has(asked):
        return asked
    return LEAK_UNITS["mbar·L/(m·s)" if basis.is_gas else "mL/(m·min)"]


def leakage_of(run: Results) -> str:
    """What the leakage in its unit is of."""
    kind = kind_of(run.leak_unit)
    return kind if run.leak_unit.per_length else f"{kind}, {to_text(run.leak_basis.length, 'm')},"


def kind_of(unit: LeakUnit) -> str:
    """What a leakage in a unit is of."""
    return "leakage per length of seal" if unit.per_length else "leakage of the whole seal"


def leakage_texts(run: Results, factor: float) -> list[str]:
    """The leakage at every step in the unit `factor`, see `format_leakage`; "open" where the fluid carries all."""
    return _of_steps(run, _cells(run.leakage, factor))


def _of_steps(run: Results, texts: Iterable[str]) -> list[str]:
    """Texts over the steps, "open" for "failed" where the fluid carries all of the load."""
    texts = list(texts)
    for step in run.open_steps:
        texts[step] = "open" if texts[step] == "failed" else texts[step]
    return texts


def _cells(variable: xarray.DataArray, factor: float) -> list[str]:
    """Values over the steps as texts: leakages in the unit `factor`, fractions in percent, others with their unit."""
    unit = variable.attrs["units"]
    if unit == "m^2/s":
        return [format_leakage(value, factor) for value in variable.values]
    if unit == "1":
        return ["–" if np.isnan(value) else f"{100 * value:.3g}" for value in variable.values]
    return [to_text(value, unit, 3) for value in variable.values]


def _joined(low: str, high: str) -> str:
    """Both ends of a band."""
    return (" to " if low.startswith("-") or high.startswith(">") else "–").join((low, high))


def format_leakage(value: float, factor: float) -> str:
    """A leakage in the unit `factor`, in three digits; "sealed" where it is 0, "failed" where it is NaN."""
    known = {"nan": "failed", "0": "sealed"}.get(f"{value:g}")
    return number_text(value / factor) if known is None else known


def format_error_band(low: float, high: float, factor: float, leakage: float) -> str:
    """Both ends of the band of error of a leakage in the unit `factor`, as text; in two digits unless it is narrow.

    Ends that are more than `VAGUE` times off the leakage have no number.

    >>> [format_error_band(low, high, 1.0, 1.0) for low, high in ((0.1, 2.0), (0.0, 2.0), (1e-6, 2.0), (1e-6, 2e39))]
    ['0.1–2', 'sealed–2', '≈0–2', '≈0 to > 1000 times']
    """
    q = abs(leakage)
    if np.isnan(low) or np.isnan(high):
        return "unknown"
    if np.isinf(high):
        return "open or sealed" if low == 0 else f"{format_leakage(low, factor)} or more"
    digits = 2 if high > _NARROW * low else 3
    below, above = (number_text(end / factor, digits) if end else "sealed" for end in (low, high))
    below = "≈0" if 0 < VAGUE * low < q else below
    above = f"> {VAGUE:g} times" if high > VAGUE * q > 0 else above
    return below if low == high == 0 else _joined(below, above)


def with_leak_unit(text: str, unit: LeakUnit) -> str:
    """A leakage or an interval as text with its unit, which words such as "sealed" do not have.

    >>> [with_leak_unit(text, LEAK_UNITS["mL/h"]) for text in ("0.1–2", "sealed–2", "sealed", "≈0 to > 1000 times")]
    ['0.1–2 mL/h', 'sealed–2 mL/h', 'sealed', '≈0 to > 1000 times']
    """
    # the last word is a number, or "more" than one
    end = text.removesuffix(" or more")
    is_number = end[-1:].isdigit()  # also one above, of a power of ten
    return f"{end} {unit.name}{text[len(end) :]}" if is_number else text


def attempt_sentences(found: dict[str, Any]) -> list[str]:
    """Whether the accuracy is met, what limits it, and what half the error takes."""
    wanted, error = format_deviation(log1p(found["wanted"])), _half_width(found)
    met = "" if found["reached"] else "not "
    lines = [
        f"The accuracy of {wanted} is {met}reached: the leakage is known within {error} at all loads that leak more "
        "than 1/1000 of the first, by the numbers alone of its error budget."
    ]
    if model := found.get("model_parts"):
        both = format_deviation(inf if found["with_model"] is None else found["with_model"])
        parts = ", ".join(model)
        lines.append(f"With the model and its input ({parts}) it is known within {both}.")
    if found["half_width"] != 0:
        lines.append(f"It is limited by the {found['limit']}, most at {found['load']}.")
    if found["why"]:
        lines.append(f"No further attempt: {found['why']}.")
    if found["half_width"] != 0 and not (found["why"] and found["half_error"].startswith("cannot")):
        lines.append(f"Half the error: {found['half_error']}.")
    return lines


def attempts_table(found: dict[str, Any]) -> TextTable:
    """A line for each attempt; the sentences are its notes."""
    attempts = found["attempts"]
    settings = [attempt["settings"] for attempt in attempts]
    columns: dict[str, list[str]] = {
        "attempt": [str(number) for number in range(1, len(attempts) + 1)],
        "method": [each["method"] for each in settings],
        "points": [" × ".join(map(str, attempt["points"])) for attempt in attempts],
        "residual": [f"{each['rtol']:.0e}" for each in settings],
        "seals": [str(each["realisations"] or "–") for each in settings],
        "time": [duration(attempt["seconds"]) for attempt in attempts],
        "error": [_half_width(attempt) for attempt in attempts],
        "limited by": [attempt["limit"] for attempt in attempts],
    }
    notes = (" ".join(attempt_sentences(found)),)
    return TextTable.of_columns("", list(columns.items()), names=len(columns), notes=notes)


def as_chosen(case: dict[str, Any], found: dict[str, Any] | None) -> dict[str, Any]:
    """A case whose keys have the values of the last attempt; it is the same without attempts.

    Keys that the case gives have them already, others hold defaults that were not taken.
    """
    if found is None:
        return case
    chosen = found["settings"]
    changed = {"method": chosen["method"], "contact": case["contact"] | {"rtol": chosen["rtol"]}}
    if case.get("stochastic") is not None and (count := chosen["realisations"]) is not None:
        changed["stochastic"] = case["stochastic"] | {"realisations": count}
    return case | changed


def _half_width(found: dict[str, Any]) -> str:
    width = found["half_width"]
    return format_deviation(inf if width is None else width)


def summary_text(run: Results) -> str:
    """Method and main results, a line each."""
    title = run.case.get("title", "")
    head = "femseal.Results" + (f" {title!r}" if title else "")
    lines = contents(run) | ({"folder": str(run.folder)} if run.folder else {})
    return "\n".join([f"<{head}>", *(f"{name:<10} {value}" for name, value in lines.items())])


def summary_html(run: Results) -> str:
    """The lines, and the table of the leakage."""
    title = escape(run.case.get("title", "") or "femseal results")
    lines = TextTable("", (), tuple(contents(run).items()))._repr_html_()
    return f"<div><b>{title}</b>\n{lines}\n{leakage_table(run)._repr_html_()}</div>"


def contents(run: Results) -> dict[str, str]:
    """Name and text of the lines on the contents."""
    steps, peak = run.steps, run.peak
    unit, factor = run.leak_scale
    leakage = run.leakage.values[peak]
    text = format_leakage(leakage, factor)
    text += f" {unit.name}" if np.isfinite(leakage) and leakage else ""
    found = {
        "leakage": f"at {to_text(steps[peak].pressure, 'Pa')}: {text} ({run.method})",
        "load": cycle_text(steps),
    }
    for name, text in zip(run.verdicts, run.verdict_texts, strict=True):
        found[f"class {name.name}"] = text
    if stored := stored_steps(run):
        found["fields"] = f"over all pixels at {len(stored)} of {counted(len(steps), 'step')}"
    for name, texts in (("warnings", run.warnings), ("failures", run.failures)):
        if texts:
            found[name] = f"{len(texts)}, the first: {texts[0]}"
    if missing := run.left_out:
        found["left out"] = "; ".join(missing)
    return found

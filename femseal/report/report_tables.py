"""Make the tables of the report: key numbers, leakage classes, test fluid and error budget.

The report also has a section about the nominal pressures that are required to meet the leakage classes. The content of
this section is read from files that `femseal design` has written to the results folder.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from ..base import Array, TextTable, format_deviation, read_plain
from ..base.leak_units import LEAK_UNITS, LeakUnit
from ..loads import first_known, least_counted
from ..results.leakage_format import class_unit, format_interval, format_leakage
from ..results.load_steps import load_names
from ..results.needed_pressure import LeakageCurve
from ..results.results import Results
from ..results.verdict import deciding_fluid
from ..results.verdict_text import verdict_table

#: Files of `femseal design` in the folder of a run.
DESIGN_FILE, DESIGN_PICTURE = "design.json", "design.png"
#: Largest size [byte] of a file of `femseal design` that is read.
_LARGEST_DESIGN_FILE = 1e7
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


class KeyNumber(NamedTuple):
    """A number at the top of the report: label, value with its unit, and 95 % interval ("" if it is unknown)."""

    label: str
    value: str
    interval: str


def key_numbers(results: Results) -> list[KeyNumber]:
    """List the leakage of the whole seal at the assembly load, the first load and the last load.

    If the case has a test fluid, its leakage is listed instead of the leakage of the service fluid. All leakages are
    given in the same unit.
    """
    curve = LeakageCurve.of_results(results)
    leakage = results.class_leakage[0]
    names = load_names(results.dataset)
    last = len(names) - 1
    steps = list(dict.fromkeys((curve.assembly_step, 0, last)))
    unit = _whole_seal_unit(results, np.concatenate([leakage[steps], curve.upper[steps]]))
    factor = results.class_basis.factor(unit)
    subject = "whole seal"
    if "test_leakage" in results.dataset:
        subject = f"test with {deciding_fluid(results)}"
    numbers = []
    for step in steps:
        if step in results.open_steps:
            value = "open"
        elif results.has_failed[step]:
            value = "failed"
        else:
            value = format_leakage(leakage[step], factor, unit)
        interval = ""
        if curve.has_interval and np.isfinite(curve.leakage[step]):
            ends = format_interval(
                curve.lower[step], curve.upper[step], factor, leakage[step], unit
            )
            interval = f"95 % interval {ends}"
        numbers.append(KeyNumber(f"{subject}, {names[step]}", value, interval))
    return numbers


def _whole_seal_unit(results: Results, values: Array) -> LeakUnit:
    """Choose a unit for the leakage of the whole seal.

    The function returns the unit that the case states for the leakage of a whole seal. If the case states no such unit,
    the function chooses a unit in which the leakages of the whole seal are numbers of a readable size.

    values : leakages per length of seal [m²/s], (any number,).
    """
    basis = results.class_basis
    unit = results.asked_unit
    if unit is not None and not unit.per_length and basis.has(unit):
        return unit
    return basis.readable(values[np.isfinite(values)])


def class_table(results: Results) -> TextTable | None:
    """Tabulate the loads required for each leakage class; return None if the case has no classes."""
    verdicts = results.verdicts
    if not verdicts:
        return None
    return verdict_table(results, verdicts)


def test_fluid(results: Results) -> dict[str, Any] | None:
    """Describe the leakage of the test fluid at the assembly load, and compare it with the leakage in service.

    Returns
    -------
    dict or None
        None if the case has no test fluid; otherwise the following entries:

        - name: name of the test fluid
        - load: name of the assembly load
        - leakage: leakage of the test fluid at the assembly load, as text
        - gases: whether the test fluid and the service fluid are both gases
        - ratio: leakage in service divided by leakage in the test. The ratio is the median over all loads at which the
          seal leaks with both fluids, or 0 if the seal does not leak with both fluids at any load. If both fluids are
          gases, the ratio is computed from throughputs (pressure × volume per time), otherwise from volume flow rates.
    """
    data = results.dataset
    if "test_leakage" not in data:
        return None
    service_basis = results.leak_basis
    test_basis = results.class_basis
    both_are_gases = service_basis.is_gas and test_basis.is_gas
    common_unit = LEAK_UNITS["Pa·m³/s" if both_are_gases else "m³/s"]
    service = results.leakage.values / service_basis.factor(common_unit)
    test = data["test_leakage"].values / test_basis.factor(common_unit)
    both_leak = np.isfinite(service) & np.isfinite(test) & (service != 0) & (test != 0)
    ratio = np.median(service[both_leak] / test[both_leak]) if both_leak.any() else 0.0
    step = LeakageCurve.of_results(results).assembly_step
    unit = class_unit(results)
    leakage = format_leakage(data["test_leakage"].values[step], test_basis.factor(unit), unit)
    return {
        "name": deciding_fluid(results),
        "load": load_names(data)[step],
        "leakage": leakage,
        "gases": both_are_gases,
        "ratio": ratio,
    }


def png_uri(picture: bytes) -> str:
    """Encode a PNG picture as a data URI."""
    return "data:image/png;base64," + base64.b64encode(picture).decode()


def design_section(results: Results) -> dict[str, Any] | None:
    """Read the results of `femseal design` for the same case from the results folder.

    Returns
    -------
    dict or None
        Entries "sentences", "tables" and "picture"; None if the folder contains no readable results for this case.
    """
    if results.folder is None:
        return None
    try:
        design = json.loads(read_plain(results.folder / DESIGN_FILE, _LARGEST_DESIGN_FILE))
        picture = read_plain(results.folder / DESIGN_PICTURE, _LARGEST_DESIGN_FILE)
        if design["case"] != results.case or not picture.startswith(_PNG_SIGNATURE):
            return None
        return {
            "sentences": design["sentences"],
            "tables": design["tables"],
            "picture": png_uri(picture),
        }
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def important_steps(results: Results) -> list[int]:
    """List the indices of the load steps that the table of the error budget shows, without repetition.

    - The first load step with a known leakage.
    - The highest load on loading at which the leakage still exceeds a thousandth of the first known leakage.
    - The load step with the highest load.
    - The last load step.
    """
    leakage = np.abs(results.leakage.values)
    is_large_enough = (leakage > least_counted(leakage)) & results.steps.on_loading
    # a list of one step, or an empty list
    highest_leaking = np.flatnonzero(is_large_enough)[-1:].tolist()
    last = len(leakage) - 1
    return list(dict.fromkeys([first_known(leakage), *highest_leaking, results.peak, last]))


class _BudgetLine(NamedTuple):
    """A line of the table of the error budget.

    Attributes
    ----------
    source : source of error.
    half_widths : half-width of the 95 % interval of ln(leakage) due to the source, (steps,).
    note : explanation of how the half-width was estimated.
    """

    source: str
    half_widths: Array
    note: str


def budget_table(results: Results) -> TextTable | None:
    """Make a table of the error sources, from the largest to the smallest, and of their sum.

    The columns are the `important_steps`. Return None if the results have no error budget.
    """
    budget = results.budget
    if budget is None:
        return None
    steps = important_steps(results)
    half_widths = budget.widths()
    lines = [_BudgetLine(part.name, half_widths[part.name], part.note) for part in budget.parts]

    def largest_half_width(line: _BudgetLine) -> float:
        """Return the largest half-width of a source over the load steps of the table, counting unknown values as
        infinite."""
        return float(np.nan_to_num(line.half_widths[steps], nan=np.inf).max())

    lines.sort(key=largest_half_width, reverse=True)
    has_model_errors = len(budget.numerical.parts) < len(budget.parts)
    if has_model_errors:
        note = (
            "all sources except the model and its input (hardness, fluid pressure, form, …): this is what the key "
            "accuracy limits"
        )
        numerical = np.asarray(budget.numerical.half_width())
        lines.append(_BudgetLine("numbers alone", numerical, note))
    note = "square root of the sum of the squared distances in ln(leakage)"
    lines.append(_BudgetLine("together", np.asarray(budget.half_width()), note))
    names = load_names(results.dataset)
    columns: list[tuple[str, Iterable[str]]] = [("source", [line.source for line in lines])]
    for step in steps:
        texts = [_half_width_text(line.half_widths[step]) for line in lines]
        columns.append((names[step], texts))
    columns.append(("how it was estimated", [line.note for line in lines]))
    return TextTable.of_columns("", columns)


def _half_width_text(half_width: float) -> str:
    """Convert the half-width of an interval of ln(leakage) to text.

    An infinite half-width means that the interval ranges from a sealed to an open seal.
    """
    if np.isnan(half_width):
        return "unknown"
    if np.isinf(half_width):
        return "open or sealed"
    if half_width == 0:
        return "0"
    return format_deviation(half_width, "× ")

"""Tables of the report: numbers at its head, leakage of the whole seal, classes, test fluid, error budget, times.

Also what pressures the seal needs, from the files of `femseal design` in the folder.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable
from typing import Any

import numpy as np

from ..base import TextTable, format_deviation, read_plain
from ..base.leak_units import LEAK_UNITS
from ..budget import ErrorPart
from ..loads import first_known, least_counted
from ..results.results import Results, load_names
from ..results.tables import class_unit, format_error_band, format_leakage, with_leak_unit
from ..results.verdict import LeakageCurve, deciding_fluid, verdict_table


def key_numbers(results: Results) -> list[tuple[str, str, str]]:
    """Leakage of the whole seal at the assembly load, the first one and the last: label, value and interval.

    It is that of the fluid that decides on classes, the test fluid where there is one, in one unit.
    """
    curve, basis = LeakageCurve.of_results(results), results.class_basis
    leakage, names = results.class_leakage[0], load_names(results.dataset)
    steps = list(dict.fromkeys((curve.assembly_step, 0, len(names) - 1)))
    unit = results.asked_unit
    if unit is None or unit.per_length or not basis.has(unit):
        shown = np.r_[leakage[steps], curve.upper[steps]]
        unit = basis.readable(shown[np.isfinite(shown)])
    factor = basis.factor(unit)
    of = (
        f"test with {deciding_fluid(results)}"
        if "test_leakage" in results.dataset
        else "whole seal"
    )
    numbers = []
    for s in steps:
        value = with_leak_unit(format_leakage(leakage[s], factor), unit)
        if s in results.open_steps:
            value = "open"
        elif results.has_failed[s]:
            value = "failed"
        note = ""
        if curve.has_interval and np.isfinite(curve.leakage[s]):
            ends = format_error_band(curve.lower[s], curve.upper[s], factor, leakage[s])
            note = f"95 % interval {with_leak_unit(ends, unit)}"
        numbers.append((f"{of}, {names[s]}", value, note))
    return numbers


def class_table(results: Results) -> TextTable | None:
    """Each class, from which load on it is met, down to which it is kept in service; None without classes."""
    verdicts = results.verdicts
    return verdict_table(results, verdicts) if verdicts else None


def test_fluid(results: Results) -> dict[str, Any] | None:
    """Leakage of the test fluid at the assembly load, and how many times as much leaks in service; None without one.

    The ratio is of pressure × volume where both are gases, else of volumes, over the loads at which both leak; 0 where
    there are none.
    """
    data = results.dataset
    if "test_leakage" not in data:
        return None
    unit, basis = class_unit(results), results.class_basis
    own, test = results.leakage.values, data["test_leakage"].values
    gases = basis.is_gas and results.leak_basis.is_gas
    common = LEAK_UNITS["Pa·m³/s" if gases else "m³/s"]
    scale = basis.factor(common) / results.leak_basis.factor(common)
    both = np.isfinite(own) & np.isfinite(test) & (own != 0) & (test != 0)
    step = LeakageCurve.of_results(results).assembly_step
    text = format_leakage(test[step], basis.factor(unit))
    return {
        "name": deciding_fluid(results),
        "load": load_names(data)[step],
        "leakage": with_leak_unit(text, unit),
        "gases": gases,
        "ratio": scale * np.median(own[both] / test[both]) if both.any() else 0.0,
    }


DESIGN_FILE, DESIGN_PICTURE = "design.json", "design.png"
#: No file of them is larger [byte].
_LARGEST = 1e7
_PNG = b"\x89PNG\r\n\x1a\n"


def png_uri(picture: bytes) -> str:
    """A picture as a data URI."""
    return "data:image/png;base64," + base64.b64encode(picture).decode()


def design_section(results: Results) -> dict[str, Any] | None:
    """Sentences, tables and picture for the same case; None where the folder has none."""
    if results.folder is None:
        return None
    try:
        found = json.loads(read_plain(results.folder / DESIGN_FILE, _LARGEST))
        picture = read_plain(results.folder / DESIGN_PICTURE, _LARGEST)
        if found["case"] != results.case or not picture.startswith(_PNG):
            return None
        kept = {key: found[key] for key in ("sentences", "tables")}
        return kept | {"picture": png_uri(picture)}
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def important_steps(results: Results) -> list[int]:
    """The first load, the highest, the highest that leaks more than 1e-3 of the first, and the last one."""
    leakage = np.abs(results.leakage.values)
    leaks = (leakage > least_counted(leakage)) & results.steps.on_loading
    highest = np.flatnonzero(leaks)[-1:].tolist()
    return list(dict.fromkeys((first_known(leakage), *highest, results.peak, len(leakage) - 1)))


def budget_table(results: Results) -> TextTable | None:
    """A line for each source, the widest first, and one for all together; None without a budget."""
    budget = results.budget
    if budget is None:
        return None
    steps, widths = important_steps(results), budget.widths()

    def largest(part: ErrorPart) -> float:
        return float(np.nan_to_num(widths[part.name][steps], nan=np.inf).max())

    order = sorted(budget.parts, key=largest, reverse=True)
    lines = [(part.name, widths[part.name], part.note) for part in order]
    if len(budget.numerical.parts) < len(budget.parts):
        text = "without the model and its input (hardness, fluid pressure, form, …): what an accuracy asks for"
        lines.append(("numbers alone", np.asarray(budget.numerical.half_width()), text))
    text = "root of the sum of squares of the distances of ln(leakage)"
    lines.append(("together", np.asarray(budget.half_width()), text))
    names, widths_of, notes = zip(*lines, strict=True)
    # inf is of a seal that may leak or be sealed
    known = {"nan": "unknown", "inf": "open or sealed", "0": "0"}
    columns: list[tuple[str, Iterable[str]]] = [("source", names)]
    for s in steps:
        at = [width[s] for width in widths_of]
        texts = [known.get(f"{w:g}") or format_deviation(w, "× ") for w in at]
        columns.append((load_names(results.dataset)[s], texts))
    return TextTable.of_columns("", [*columns, ("how it was estimated", notes)])

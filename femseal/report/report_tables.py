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
from ..base.leak_rates import leak_classes, within
from ..base.leak_units import LEAK_UNITS
from ..budget import ErrorPart
from ..loads import first_known, least_counted
from ..results.results import Results, branches_in, load_names, loads_as_given
from ..results.tables import class_unit, format_error_band, format_leakage, leakage_texts


def key_numbers(results: Results) -> list[tuple[str, str, str]]:
    """Leakage of the whole seal at the highest and the first load and after the last unloading: label, value, note."""
    leakage, basis, budget = results.leakage.values, results.leak_basis, results.budget
    names = load_names(results.dataset)
    numbers = []
    for s in dict.fromkeys((results.peak, 0, len(names) - 1)):
        unit = results.asked_unit
        if unit is None or unit.per_length or not basis.has(unit):
            unit = basis.readable([leakage[s]])
        factor, note = basis.factor(unit), ""
        value = leakage_texts(results, factor)[s]
        value += f" {unit.name}" if leakage[s] and not np.isnan(leakage[s]) else ""
        if budget is not None:
            ends = budget.lower[s], budget.upper[s]
            note = f"95 % band of error {format_error_band(*ends, factor, leakage[s])}"
        numbers.append((f"whole seal, {names[s]}", value, note))
    return numbers


def class_table(results: Results) -> TextTable | None:
    """Each class, its limit, from which load on it is met, down to which it is kept in service; None without classes.

    Loads are load steps. Where the leakage that decides has a band of error, also from which load on all of it is met.
    """
    data = results.dataset
    if "leak_class" not in data.coords:
        return None
    limits, met = data["class_limit"].values, data["class_met"].values
    names = data["leak_class"].values.tolist()
    units, factor = [LEAK_UNITS[c.unit] for c in leak_classes(names)], results.class_basis.factor
    texts = [
        f"{format_leakage(limit, factor(unit))} {unit.name}" if limit else "no leakage"
        for limit, unit in zip(limits, units, strict=True)
    ]
    columns = [("class", names), ("limit", texts)]
    text = loads_as_given(data)
    # the force alone where the case has forces
    short = [text(p).partition(" (")[0] for p in data["nominal_pressure"].values]
    seal = "the median seal" if results.method == "median" else "the seal"
    for n, (_, steps) in enumerate(branches_in(data)):
        loads = [short[s] for s in steps]
        if n == 0 and results.budget is not None:
            upper = results.class_upper[steps]
            sure = [within(upper, limit) for limit in limits]
            columns.append(("met with the whole band", [_met_text(loads, each) for each in sure]))
        if n == 0:
            columns.append((f"met by {seal}", [_met_text(loads, each[steps]) for each in met]))
        else:
            head = f"in service, unloading from {loads[0]}"
            columns.append((head, [_kept_text(loads, each[steps]) for each in met]))
    fluid = "the test fluid" if "test_leakage" in data else "the fluid"
    title = f"Leakage classes at the load steps, decided by {fluid}"
    return TextTable.of_columns(title, columns, names=len(columns))


def _met_text(loads: list[str], met: np.ndarray) -> str:
    """From which load on a class is met; "open" where the leakage at the highest may be any."""
    if np.isnan(met[-1]):
        return "open"
    if (met == 1).all():
        return "at every load step"
    good = len(met) - np.argmin(met[::-1] == 1)
    return "at no load step" if good == len(met) else f"from {loads[good]}"


def _kept_text(loads: list[str], met: np.ndarray) -> str:
    """Down to which load a class is kept; "open" where the leakage at the peak may be any."""
    if np.isnan(met[0]):
        return "open"
    good = np.argmin(met == 1) if not (met == 1).all() else len(met)
    return "not even at the peak" if good == 0 else f"kept down to {loads[good - 1]}"


def test_fluid(results: Results) -> dict[str, Any] | None:
    """Leakage of the test fluid at the highest load, and how many times as much leaks in service; None without one.

    The ratio is of pressure × volume where both are gases, else of volumes; 0 where neither leaks.
    """
    data = results.dataset
    if "test_leakage" not in data:
        return None
    unit, basis = class_unit(results), results.class_basis
    own, test = results.leakage.values, data["test_leakage"].values
    gases = basis.is_gas and results.leak_basis.is_gas
    common = LEAK_UNITS["Pa·m³/s" if gases else "m³/s"]
    scale = basis.factor(common) / results.leak_basis.factor(common)
    known = np.isfinite(own) & np.isfinite(test) & (test != 0)
    return {
        "leakage": f"{format_leakage(test[results.peak], basis.factor(unit))} {unit.name}",
        "gases": gases,
        "ratio": scale * np.median(own[known] / test[known]) if known.any() else 0.0,
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

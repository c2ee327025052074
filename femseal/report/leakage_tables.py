"""Leakage in the report: numbers at its head, the leakage of the whole seal, leakage classes, and the test fluid.

Also what pressures the seal needs, from the files of `femseal design` in the folder.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import TextTable, format_deviation, read_plain, to_text
from ..base.leak_rates import LeakUnit, within
from ..results.run_data import RunData
from ..results.selections import branches_in
from ..results.tables import class_unit, format_error_band, format_leakage, in_several_units, leakage_at
from .case_text import fluid_text

if TYPE_CHECKING:
    from ..results.results import Results


@dataclass(frozen=True)
class KeyNumber:
    """One of the numbers at the head of the report."""

    label: str
    value: str
    note: str


def key_numbers(results: RunData) -> list[KeyNumber]:
    """Leakage of the whole seal at the first and the highest load and after the last unloading; contact there."""
    data, steps, leakage = results.dataset, results.steps, results.leakage.values
    unit, factor = _whole_seal(results)
    peak = results.peak
    numbers, budget = [], results.budget
    for s in dict.fromkeys((peak, 0, len(steps) - 1)):
        value = leakage_at(results, s, factor)
        value += f" {unit.name}" if leakage[s] and not np.isnan(leakage[s]) else ""
        note = ""
        if budget is not None:
            note = f"95 % band of error {format_error_band(budget.lower[s], budget.upper[s], factor, leakage[s])}"
        elif "leakage_lower" in data:
            ends = (format_leakage(float(data[f"leakage_{end}"][s]), factor) for end in ("lower", "upper"))
            note = f"redraws of the measured patch {'–'.join(ends)}"
        numbers.append(KeyNumber(f"whole seal, {steps[s].name}", value, note))
    if "contact_fraction" in data:
        fraction = float(data["contact_fraction"][peak])
        numbers.append(KeyNumber("in contact at the highest load", f"{100 * fraction:.3g} %", ""))
    return numbers


def _whole_seal(results: RunData) -> tuple[LeakUnit, float]:
    """The unit of leakage, or a readable one of the whole seal where that is per length, and the value of 1 [m²/s]."""
    unit, basis = results.leak_unit, results.leak_basis
    unit = basis.readable(results.leakage.values) if unit.per_length else unit
    return unit, basis.factor(unit)


def limiting_text(results: RunData) -> str:
    """What widens the band of error most at the highest load, and how wide the band is; "" without a budget."""
    budget, peak = results.budget, results.peak
    if budget is None or not (name := budget.limiting(peak)):
        return ""
    half_width, step = float(budget.half_width(peak)), results.steps[peak].name
    if not np.isfinite(half_width):
        return f"One end of the band of error at {step} is unknown; its widest source: {name}."
    return f"Half-width of the band of error at {step}: {format_deviation(half_width)}; its widest source: {name}."


def total_leakage_text(results: RunData) -> str:
    """Leakage of the whole seal at the highest load, in several units."""
    if not (whole := in_several_units(results, results.peak)):
        return ""
    length, load = to_text(results.leak_basis.length, "m"), to_text(results.steps[results.peak].pressure, "Pa")
    return f"Over its whole length of {length} the seal leaks {whole} at {load}.{_reference_text(results)}"


def _reference_text(results: RunData) -> str:
    basis = results.leak_basis
    if basis.pressure is None or basis.temperature is None:
        return ""
    state = f"{basis.pressure:g} Pa and {basis.temperature:g} K"
    return (
        f" Volumes of the gas are those at {state}, standard ones at 0 °C; its pressure × volume is that at "
        f"{basis.stated_temperature:g} K."
    )


def class_table(results: RunData) -> TextTable | None:
    """Each class, its limit, from which load on it is met, down to which it is kept in service; None without classes.

    Loads are load steps. Where the leakage that decides has a band of error, also from which load on all of it is met.
    """
    data = results.dataset
    if "leak_class" not in data.coords:
        return None
    unit, budget = class_unit(results), results.budget
    scale, pressure = results.class_basis.factor(unit), data["nominal_pressure"].values
    limits, met = data["class_limit"].values, data["class_met"].values
    columns = [
        ("class", [str(name) for name in data["leak_class"].values]),
        ("limit", [f"{format_leakage(q, scale)} {unit.name}" if q else "no leakage" for q in limits]),
    ]
    for n, (name, steps) in enumerate(branches_in(data)):
        head = "met on loading" if n == 0 else f"in service, {name}"
        columns.append((head, [_span(pressure[steps], each[steps], loading=n == 0) for each in met]))
        if n == 0 and budget is not None and "test_leakage" not in data:
            sure = [within(np.nan_to_num(budget.upper[steps], nan=np.inf), limit) for limit in limits]
            columns.append(("with all of its band", [_span(pressure[steps], each, loading=True) for each in sure]))
    fluid = "the test fluid" if "test_leakage" in data else "the fluid"
    seal = "the median seal" if results.method == "median" else "the seal"
    title = f"Leakage classes at the load steps, decided by {fluid} and {seal}"
    return TextTable.of_columns(title, columns, names=len(columns))


def _span(pressure: np.ndarray, met: np.ndarray, loading: bool) -> str:
    """From which load on, or down to which, a class is met; "open" where the leakage there may be any."""
    if np.isnan(met[-1 if loading else 0]):
        return "open"
    met = met == 1
    if loading:
        good = len(met) - int(np.argmin(met[::-1])) if not met.all() else 0
        return "at no load step" if good == len(met) else f"from {to_text(float(pressure[good]), 'Pa')}"
    good = int(np.argmin(met)) if not met.all() else len(met)
    return "not even at the peak" if good == 0 else f"kept down to {to_text(float(pressure[good - 1]), 'Pa')}"


def test_fluid_sentences(results: RunData) -> list[str]:
    """Leakage of the test fluid at the highest load, how it compares, and what both limits of flow would give."""
    data = results.dataset
    if "test_leakage" not in data:
        return []
    attrs, unit, basis = data.attrs, class_unit(results), results.class_basis
    best, _ = results.class_leakage
    most = int(np.argmax(data["nominal_pressure"].values))
    inlet, outlet = (to_text(float(attrs[f"test_{end}_pressure_Pa"]), "Pa") for end in ("inlet", "outlet"))
    own = results.leakage.values
    fluid = fluid_text(results.case.get("output", {}).get("test_fluid") or {}, str(attrs["test_fluid"]))
    sentences = [
        f"A test fluid, {fluid}, runs from {inlet} to {outlet} through the same seals: "
        f"{format_leakage(float(best[most]), basis.factor(unit))} {unit.name} at {data['name'].values[most]}."
    ]
    if both_gases := basis.is_gas and results.leak_basis.is_gas:
        assert basis.pressure is not None
        assert results.leak_basis.pressure is not None
        own = own * results.leak_basis.pressure / basis.pressure
    what = "in pressure × volume" if both_gases else "by volume"
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = own / best
    found = ratio[np.isfinite(ratio)]
    if not found.size:
        return sentences
    low, high = (f"{value:.3g}" for value in (found.min(), found.max()))
    text = f"{what.capitalize()} the fluid in service leaks {low if low == high else f'{low} to {high}'} times as much"
    viscous, molecular = float(attrs["test_viscous_factor"]), float(attrs["test_molecular_factor"])
    limits = [f"flow as a continuum would give {viscous:.3g}"]
    limits += [] if np.isnan(molecular) else [f"flow of free molecules {molecular:.3g}"]
    return [*sentences, f"{text}; {', '.join(limits)}."]


DESIGN_FILE, DESIGN_PICTURE = "design.json", "design.png"
#: No file of them is larger [byte].
_LARGEST = 1e7
_PNG = b"\x89PNG\r\n\x1a\n"


def design_section(results: Results) -> dict[str, Any] | None:
    """Sentences, tables and picture for the same case; None where the folder has none."""
    if results.folder is None:
        return None
    try:
        found = json.loads(read_plain(results.folder / DESIGN_FILE, _LARGEST))
        if found["case"] != results.case:
            return None
        picture = read_plain(results.folder / DESIGN_PICTURE, _LARGEST)
        if not picture.startswith(_PNG):
            return None
        tables = [{"title": "Pressure in assembly (Qmin) and in service (QSmin)", **found["sheet"]}]
        tables += [found["slopes"]] if found["slopes"] else []
        return {
            "sentences": [str(text) for text in found["sentences"]],
            "tables": [
                {"title": str(t["title"]), "heads": [str(h) for h in t["heads"]], "lines": _texts(t)} for t in tables
            ],
            "picture": "data:image/png;base64," + base64.b64encode(picture).decode(),
        }
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def _texts(table: dict[str, Any]) -> list[list[str]]:
    lines = [[str(text) for text in line] for line in table["lines"]]
    if any(len(line) != len(table["heads"]) for line in lines):
        raise ValueError("lines of another length than the headings")
    return lines

"""Leakage in the report: numbers at its head, the leakage of the whole seal, leakage classes, and the test fluid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.quantities import to_text
from ..base.text_table import TextTable
from ..results.run_data import RunData
from ..results.selections import branches_in
from ..results.tables import class_unit, format_error_band, format_leakage, in_several_units
from .case_text import fluid_text


@dataclass(frozen=True)
class KeyNumber:
    """One of the numbers at the head of the report."""

    label: str
    value: str
    note: str


def key_numbers(results: RunData) -> list[KeyNumber]:
    """Leakage at the first and the highest load and after the last unloading; contact there."""
    data, steps, leakage = results.dataset, results.steps, results.leakage.values
    unit, factor = results.leak_scale
    peak = results.peak
    numbers, budget = [], results.budget
    for s in dict.fromkeys((0, peak, len(steps) - 1)):
        value = format_leakage(leakage[s], factor)
        value += f" {unit.name}" if leakage[s] and not np.isnan(leakage[s]) else ""
        note = ""
        if budget is not None:
            note = f"95 % band of error {format_error_band(budget.lower[s], budget.upper[s], factor)}"
        elif "leakage_lower" in data:
            ends = (format_leakage(float(data[f"leakage_{end}"][s]), factor) for end in ("lower", "upper"))
            note = f"between seals {'–'.join(ends)}"
        numbers.append(KeyNumber(steps[s].name, value, note))
    if "contact_fraction" in data:
        fraction = float(data["contact_fraction"][peak])
        numbers.append(KeyNumber("in contact at the highest load", f"{100 * fraction:.3g} %", ""))
    return numbers


def total_leakage_text(results: RunData) -> str:
    """Leakage of the whole seal at the highest load, in several units."""
    steps = results.steps
    peak = results.peak
    if not (whole := in_several_units(results, peak)):
        return ""
    length, load = to_text(results.leak_basis.length, "m"), to_text(steps[peak].pressure, "Pa")
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
    """Each class with its limit, and the load steps of each branch between which the leakage given meets it.

    None without classes.
    """
    data = results.dataset
    if "leak_class" not in data.coords:
        return None
    unit = class_unit(results)
    scale, pressure = results.class_basis.factor(unit), data["nominal_pressure"].values
    limits, met = data["class_limit"].values, data["class_met"].values
    columns = [
        ("class", [str(name) for name in data["leak_class"].values]),
        ("limit", [f"{format_leakage(q, scale)} {unit.name}" if q else "no leakage" for q in limits]),
    ]
    for n, (name, steps) in enumerate(branches_in(data)):
        head = "met on loading" if n == 0 else f"kept on {name}"
        columns.append((head, [_span(pressure[steps], each[steps], loading=n == 0) for each in met]))
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
    return "not at the peak" if good == 0 else f"down to {to_text(float(pressure[good - 1]), 'Pa')}"


def test_fluid_sentences(results: RunData) -> list[str]:
    """Leakage of the test fluid at the highest load, how it compares, and what both limits of flow would give."""
    data = results.dataset
    if "test_leakage" not in data:
        return []
    attrs, unit, basis = data.attrs, class_unit(results), results.class_basis
    best, _ = results.class_leakage
    inlet, outlet = (to_text(float(attrs[f"test_{end}_pressure_Pa"]), "Pa") for end in ("inlet", "outlet"))
    own = results.leakage.values
    fluid = fluid_text(results.case.get("output", {}).get("test_fluid") or {}, str(attrs["test_fluid"]))
    sentences = [
        f"A test fluid, {fluid}, runs from {inlet} to {outlet} through the same seals: "
        f"{format_leakage(float(best[0]), basis.factor(unit))} {unit.name} at {data['name'].values[0]}."
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

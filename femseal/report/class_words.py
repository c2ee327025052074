"""Lines of the report on leakage classes, and on the test fluid beside the fluid in service."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..base.quantities import to_text
from ..results.selections import branches
from ..results.tables import class_unit, format_leakage
from .case_text import fluid_text

if TYPE_CHECKING:
    from ..results.results import Results

Lines = list[tuple[str, ...]]


def class_heads(results: Results) -> list[str]:
    """Headings of the table of classes."""
    heads = ["class", "limit"]
    if "leak_class" not in results.dataset.coords:
        return heads
    return heads + [
        "reached on loading" if n == 0 else f"kept on {name}" for n, (name, _) in enumerate(_branches(results))
    ]


def class_lines(results: Results) -> Lines:
    """Each class with its limit, and the load steps of each branch between which the leakage given reaches it."""
    data = results.dataset
    if "leak_class" not in data.coords:
        return []
    unit = class_unit(results)
    scale, pressure = results.class_basis.factor(unit), data["nominal_pressure"].values
    lines: Lines = []
    for name, limit, reached in zip(
        data["leak_class"].values, data["class_limit"].values, data["class_met"].values, strict=True
    ):
        line = [str(name), f"{format_leakage(float(limit), scale)} {unit.name}" if limit else "no leakage"]
        for n, (_, steps) in enumerate(_branches(results)):
            line.append(_span(pressure[steps], reached[steps], loading=n == 0))
        lines.append(tuple(line))
    return lines


def _branches(results: Results) -> list[tuple[str, np.ndarray]]:
    data = results.dataset
    return branches(data["nominal_pressure"].values, data["unloaded_from"].values)


def _span(pressure: np.ndarray, reached: np.ndarray, loading: bool) -> str:
    """From which load on, or down to which, a class is reached; "open" where the leakage there may be any."""
    if np.isnan(reached[-1 if loading else 0]):
        return "open"
    reached = reached == 1
    if loading:
        good = len(reached) - int(np.argmin(reached[::-1])) if not reached.all() else 0
        return "at no load step" if good == len(reached) else f"from {to_text(float(pressure[good]), 'Pa')}"
    good = int(np.argmin(reached)) if not reached.all() else len(reached)
    return "not at the peak" if good == 0 else f"down to {to_text(float(pressure[good - 1]), 'Pa')}"


def class_note(results: Results) -> str:
    """What the table of classes is judged by."""
    data = results.dataset
    if "leak_class" not in data.coords:
        return ""
    fluid = "the test fluid" if "test_leakage" in data else "the fluid"
    seal = "the median seal" if results.method == "median" else "the seal"
    return f"Leakage classes at the load steps, judged by {fluid} and {seal}"


def test_fluid_sentences(results: Results) -> list[str]:
    """Leakage of the test fluid at the highest load, how it compares, and what both limits of flow would give."""
    data = results.dataset
    if "test_leakage" not in data:
        return []
    attrs, unit, basis = data.attrs, class_unit(results), results.class_basis
    best, _ = results.class_leakage
    inlet, outlet = (to_text(float(attrs[f"test_{end}_pressure_Pa"]), "Pa") for end in ("inlet", "outlet"))
    own = results.leakage.values
    told = fluid_text(results.case.get("output", {}).get("test_fluid") or {}, str(attrs["test_fluid"]))
    sentences = [
        f"A test fluid, {told}, runs from {inlet} to {outlet} through the same seals: "
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

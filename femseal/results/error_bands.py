"""Error budgets in the dataset: the band of every leakage, and that of each source of error."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..budget import ErrorBudget, ErrorPart
from ..loads import LoadProgramme

if TYPE_CHECKING:
    import xarray

#: Sources of error in the order in which they are told.
SOURCES = ("solver", "pixels", "filter", "windows", "two scales", "sampler", "library", "realisations", "loads")
#: Method of every leakage in the dataset, and its name in the variables of its budget.
BUDGETED = {"median": "stochastic", "two-scale": "two_scale", "deterministic": "deterministic"}


def add_budgets(data: xarray.Dataset, budgets: Mapping[str, ErrorBudget]) -> None:
    """Add the bands of the budgets, by the name of their method in variables."""
    if not budgets:
        return
    present = {part.name for budget in budgets.values() for part in budget.parts}
    names = [name for name in SOURCES if name in present]
    text = "source of error of the leakage"
    data.coords["budget_part"] = ("budget_part", names, {"units": "1", "long_name": text})
    notes = {}
    for method, budget in budgets.items():
        parts = {part.name: part for part in budget.parts}
        told = f"of the band of error of the leakage, {method.replace('_', '-')}"
        for end in ("lower", "upper"):
            labels = {"units": "m^2/s", "long_name": f"{end} end {told}"}
            data[f"leakage_{method}_budget_{end}"] = ("step", getattr(budget, end), labels)
            # a source that the method does not have moves nothing
            ends = [getattr(parts[name], end) if name in parts else budget.leakage for name in names]
            labels = {"units": "m^2/s", "long_name": f"{end} end {told}, of each source"}
            data[f"leakage_{method}_budget_part_{end}"] = (("budget_part", "step"), np.array(ends), labels)
        notes[method] = {name: parts[name].note for name in names if name in parts}
    data.attrs["error_budget"] = json.dumps(notes, ensure_ascii=False)


def budgets_in(data: xarray.Dataset, steps: LoadProgramme) -> dict[str, ErrorBudget]:
    """The budgets of a dataset by the name of their method in variables; empty if there are none."""
    notes: dict[str, dict[str, str]] = json.loads(data.attrs.get("error_budget", "{}"))
    leakages = {"stochastic": "leakage_median"}
    found = {}
    for method, parts in notes.items():
        lower, upper = (data[f"leakage_{method}_budget_part_{end}"] for end in ("lower", "upper"))
        made = tuple(
            ErrorPart(name, lower.sel(budget_part=name).values, upper.sel(budget_part=name).values, note)
            for name, note in parts.items()
        )
        leakage = data[leakages.get(method, f"leakage_{method}")].values
        found[method] = ErrorBudget(method.replace("_", "-"), leakage, made, steps)
    return found


def half_width_text(width: float) -> str:
    """A half-width of ln(leakage) as a share, or as a factor where it is large.

    >>> half_width_text(0.0953), half_width_text(1.5), half_width_text(0.0), half_width_text(float("inf"))
    ('10 %', '× 4.5', '0', 'open or sealed')
    """
    if np.isnan(width):
        return "unknown"
    if np.isinf(width):
        return "open or sealed"
    share = float(np.expm1(width))
    return "0" if share == 0 else f"{100 * share:.2g} %" if share < 1 else f"× {1 + share:.2g}"

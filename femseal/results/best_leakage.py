"""The leakage of a dataset: that of the best method, that which decides on leakage classes, and their intervals.

All functions take the dataset of a run, as `assemble` makes it.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Flags
from ..base.leak_rates import LeakBasis
from ..base.leak_units import LEAK_UNITS, LeakUnit, leakage_unit
from ..budget import ErrorBudget, ErrorPart
from ..studies import STUDIES
from .load_steps import load_programme

if TYPE_CHECKING:
    import xarray

#: Variables with the leakage of each method, the best method first.
METHODS = {study.label: study.leakage_variable for study in reversed(STUDIES.values())}
#: Names of the methods in the variables of error budgets.
_BUDGET_NAMES = {study.label: study.key for study in STUDIES.values()}
#: Attributes of a dataset that store the parts of a `LeakBasis`.
_BASIS_ATTRIBUTES = {
    "density": "reference_density_kg_per_m3",
    "pressure": "reference_pressure_Pa",
    "temperature": "reference_temperature_K",
    "molar_mass": "molar_mass_kg_per_mol",
    "stated": "stated_temperature_K",
    "drop": "drop_volume_m3",
    "bubble": "bubble_volume_m3",
    "pressure_drop": "pressure_drop_Pa",
    "capacity": "rated_capacity_m3_per_s",
}


def best_method(data: xarray.Dataset) -> str:
    """Return the best method of a run: "median" (of realisations), "two-scale", "blocks" or "deterministic"."""
    return next(method for method, variable in METHODS.items() if variable in data)


def best_leakage(data: xarray.Dataset) -> xarray.DataArray:
    """Return the leakage per length of seal by the best method (step,) [m²/s]."""
    return data[METHODS[best_method(data)]]


def open_steps(data: xarray.Dataset) -> list[int]:
    """Return the steps at which the fluid carries all of the load, so that the seal is open and has no leakage."""
    steps: list[int] = json.loads(data.attrs.get("open_steps", "[]"))
    return steps


# --- units ------------------------------------------------------------------------------------------------------


def basis_attributes(basis: LeakBasis, prefix: str = "") -> dict[str, float]:
    """Return the attributes in which a dataset stores a basis of leakage, except the length of the seal."""
    values = {attribute: getattr(basis, name) for name, attribute in _BASIS_ATTRIBUTES.items()}
    return {
        f"{prefix}{attribute}": float(value)
        for attribute, value in values.items()
        if value is not None
    }


def leak_basis_of(data: xarray.Dataset, prefix: str = "") -> LeakBasis:
    """Return length of the seal and reference state of the fluid, with which leakage is converted to any unit."""
    attrs: dict[str, Any] = data.attrs
    known = {
        name: float(attrs[f"{prefix}{attribute}"])
        for name, attribute in _BASIS_ATTRIBUTES.items()
        if f"{prefix}{attribute}" in attrs
    }
    length = float(attrs["seal_size_m"][1])
    return LeakBasis(**{"length": length, "density": np.nan} | known)


def asked_unit(data: xarray.Dataset) -> LeakUnit | None:
    """Return the unit of leakage that the case gives, for its fluid, its test fluid, or both."""
    return LEAK_UNITS.get(data.attrs.get("leakage_unit", ""))


def unit_of_leakage(data: xarray.Dataset) -> LeakUnit:
    """Return the unit of leakage in tables and pictures: that of the case, else a readable one per length of seal."""
    asked = asked_unit(data)
    if asked is not None and leak_basis_of(data).has(asked):
        return asked
    return LEAK_UNITS[leakage_unit(best_leakage(data).values)[1]]


# --- error budgets ----------------------------------------------------------------------------------------------


def error_budgets(data: xarray.Dataset) -> dict[str, ErrorBudget]:
    """Return the error budgets by method: "deterministic", "two_scale", "stochastic"; empty without budgets."""
    steps = load_programme(data)
    notes: dict[str, dict[str, str]] = json.loads(data.attrs.get("error_budget", "{}"))
    budgets = {}
    for method, notes_of_sources in notes.items():
        lower = data[f"leakage_{method}_budget_part_lower"]
        upper = data[f"leakage_{method}_budget_part_upper"]
        parts = tuple(
            ErrorPart(
                source,
                lower.sel(budget_part=source).values,
                upper.sel(budget_part=source).values,
                note,
            )
            for source, note in notes_of_sources.items()
        )
        variable = "leakage_median" if method == "stochastic" else f"leakage_{method}"
        leakage = data[variable].values
        budgets[method] = ErrorBudget(method.replace("_", "-"), leakage, parts, steps)
    return budgets


def best_budget(data: xarray.Dataset) -> ErrorBudget | None:
    """Return the error budget of the leakage by the best method, None without budgets."""
    return error_budgets(data).get(_BUDGET_NAMES[best_method(data)])


# --- the fluid that decides on leakage classes ------------------------------------------------------------------


def has_test_fluid(data: xarray.Dataset) -> bool:
    """Return whether a run has a test fluid, which then decides on leakage classes."""
    return "test_leakage" in data


def class_basis_of(data: xarray.Dataset) -> LeakBasis:
    """Return the basis of leakage of the fluid that decides on classes."""
    return leak_basis_of(data, "test_" if has_test_fluid(data) else "")


def class_leakage_of(data: xarray.Dataset) -> Array:
    """Return the leakage that decides on classes (step,) [m²/s]."""
    leakage = data["test_leakage"] if has_test_fluid(data) else best_leakage(data)
    return leakage.values


def class_leakage_of_realisations(data: xarray.Dataset) -> Array:
    """Return the leakage of each realisation that decides on classes (realisation, step) [m²/s].

    Without realisations, that by the best method counts as a single one.
    """
    variable = "test_leakage_realisations" if has_test_fluid(data) else "leakage"
    if variable in data and best_method(data) == "median":
        return data[variable].values
    return class_leakage_of(data)[None]


def failed_steps(data: xarray.Dataset) -> Flags:
    """Return whether the leakage of the fluid, or of the test fluid, could not be computed (step,)."""
    has_failed = np.isnan(best_leakage(data).values) | np.isnan(class_leakage_of(data))
    has_failed[open_steps(data)] = False
    return has_failed


def class_interval_of(
    data: xarray.Dataset, budget: ErrorBudget | None = None
) -> tuple[Array, Array] | None:
    """Return the 95 % interval of the leakage that decides on classes: both ends (step,) [m²/s], NaN if unknown.

    The interval of a test fluid is that of the fluid of the run, multiplied by the ratio of both leakages. At steps
    without leakage, the ratio is the largest of all steps. None without an error budget.

    budget : error budget of the leakage by the best method; that of the run unless given.
    """
    if budget is None:
        budget = best_budget(data)
    if budget is None:
        return None
    service, deciding = np.abs(budget.leakage), np.abs(class_leakage_of(data))
    leaks = (service > 0) & (deciding > 0)
    ratio = np.divide(deciding, service, out=np.zeros_like(deciding), where=leaks)
    largest = ratio.max(initial=0.0) or 1.0
    factor = np.where(leaks, ratio, largest)
    return factor * budget.lower, factor * budget.upper

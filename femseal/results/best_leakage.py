"""Read leakages from the dataset of a run, with their units, error budgets and 95 % intervals.

The *leakage of the best method* is the main result of a run. The *class leakage* is the one that is compared with the
limits of leakage classes. If the case has a test fluid, the class leakage is the leakage of the test fluid. If the case
has no test fluid, the class leakage is the leakage of the best method. The argument `data` of the functions is a
dataset that was made by `assemble`.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, Flags
from ..base.leak_rates import LeakBasis
from ..budget import MODEL_PARTS, ErrorBudget, ErrorPart
from ..studies import STUDIES, Study
from .load_steps import load_programme

if TYPE_CHECKING:
    import xarray

#: Attribute of a dataset that stores each field of a `LeakBasis`.
_BASIS_ATTRIBUTES = {
    "density": "reference_density_kg_per_m3",
    "pressure": "reference_pressure_Pa",
    "temperature": "reference_temperature_K",
    "molar_mass": "molar_mass_kg_per_mol",
    "given_temperature": "stated_temperature_K",
    "drop_volume": "drop_volume_m3",
    "bubble_volume": "bubble_volume_m3",
    "pressure_drop": "pressure_drop_Pa",
    "capacity": "rated_capacity_m3_per_s",
}


def solved_studies(data: xarray.Dataset) -> list[Study]:
    """Return the studies whose leakage is in a dataset, the best study first."""
    return [study for study in reversed(STUDIES.values()) if study.leakage_variable in data]


def best_study(data: xarray.Dataset) -> Study:
    """Return the study that computed the leakage of the best method."""
    return solved_studies(data)[0]


def best_leakage(data: xarray.Dataset) -> xarray.DataArray:
    """Return the leakage per unit seal length computed by the best method, (step,) [m²/s]."""
    return data[best_study(data).leakage_variable]


def open_steps(data: xarray.Dataset) -> list[int]:
    """Return the load steps where the fluid carries the whole load.

    Where the fluid carries the whole load, the surfaces are separated and the leakage is unknown.
    """
    steps: list[int] = json.loads(data.attrs.get("open_steps", "[]"))
    return steps


# --- units ------------------------------------------------------------------------------------------------------


def basis_attributes(basis: LeakBasis, prefix: str = "") -> dict[str, float]:
    """Return, as attributes of a dataset, the data needed to convert a leakage to other units, except the seal length.

    Parameters
    ----------
    basis : properties of the fluid and the seal that are needed to convert a leakage to another unit.
    prefix : text before the name of each attribute, "test_" for the test fluid.
    """
    attributes = {}
    for name, attribute in _BASIS_ATTRIBUTES.items():
        value = getattr(basis, name)
        if value is not None:
            attributes[f"{prefix}{attribute}"] = float(value)
    return attributes


def leak_basis_of(data: xarray.Dataset, prefix: str = "") -> LeakBasis:
    """Return the seal length and the fluid properties that are needed to convert a leakage to other units.

    Parameters
    ----------
    data : dataset of a run.
    prefix : text before the name of each attribute, "test_" for the test fluid.
    """
    attrs: dict[str, Any] = data.attrs
    # the size of the seal is its width along x1 and its length along x2
    values = {"length": float(attrs["seal_size_m"][1]), "density": np.nan}
    for name, attribute in _BASIS_ATTRIBUTES.items():
        if f"{prefix}{attribute}" in attrs:
            values[name] = float(attrs[f"{prefix}{attribute}"])
    return LeakBasis(**values)


# --- error budgets ----------------------------------------------------------------------------------------------


def error_budgets(data: xarray.Dataset) -> dict[str, ErrorBudget]:
    """Return the error budgets by the key of their study, such as "two_scale".

    The dictionary contains only studies that have an error budget and are still in `STUDIES`.
    """
    steps = load_programme(data)
    # note on each source of error, by method and source
    notes: dict[str, dict[str, str]] = json.loads(data.attrs.get("error_budget", "{}"))
    studies = {study.key: study for study in STUDIES.values()}
    budgets = {}
    for method, notes_by_source in notes.items():
        study = studies.get(method)
        if study is None:
            continue
        lower = data[f"leakage_{method}_budget_part_lower"]
        upper = data[f"leakage_{method}_budget_part_upper"]
        parts = []
        for source, note in notes_by_source.items():
            source_lower = lower.sel(budget_part=source).values
            source_upper = upper.sel(budget_part=source).values
            of_model = source in MODEL_PARTS
            parts.append(ErrorPart(source, source_lower, source_upper, note, of_model))
        leakage = data[study.leakage_variable].values
        budgets[method] = ErrorBudget(study.name, leakage, tuple(parts), steps)
    return budgets


def best_budget(data: xarray.Dataset) -> ErrorBudget | None:
    """Return the error budget of the best method, or None if it has none."""
    return error_budgets(data).get(best_study(data).key)


# --- the fluid that decides on leakage classes ------------------------------------------------------------------


def has_test_fluid(data: xarray.Dataset) -> bool:
    """Return whether a run has a test fluid, whose leakage is then compared with the leakage classes."""
    return "test_leakage" in data


def class_basis_of(data: xarray.Dataset) -> LeakBasis:
    """Return the seal length and the properties of the fluid that is compared with the leakage classes."""
    return leak_basis_of(data, "test_" if has_test_fluid(data) else "")


def class_leakage_of(data: xarray.Dataset) -> Array:
    """Return the class leakage, (step,) [m²/s]."""
    leakage = data["test_leakage"] if has_test_fluid(data) else best_leakage(data)
    return leakage.values


def class_leakage_of_realisations(data: xarray.Dataset) -> Array:
    """Return the class leakage for each realisation, (realisation, step) [m²/s].

    For a run without realisations, there is a single row with the leakage of the best method.
    """
    variable = "test_leakage_realisations" if has_test_fluid(data) else "leakage"
    if variable in data and best_study(data).has_realisations:
        return data[variable].values
    return class_leakage_of(data)[None]


def failed_steps(data: xarray.Dataset) -> Flags:
    """Flag each step at which the leakage of the service fluid or of the test fluid could not be computed."""
    has_failed = np.isnan(best_leakage(data).values) | np.isnan(class_leakage_of(data))
    has_failed[open_steps(data)] = False
    return has_failed


def class_interval_of(
    data: xarray.Dataset, budget: ErrorBudget | None = None
) -> tuple[Array, Array] | None:
    """Return the 95 % interval of the class leakage.

    Only the leakage of the service fluid has an error budget. If the run has a test fluid, the interval of the service
    leakage is multiplied by the ratio of the test leakage to the service leakage. At steps where the service leakage or
    the test leakage is 0, the largest ratio of all steps is used, so that the upper end is not too low.

    Parameters
    ----------
    data : dataset of a run.
    budget : error budget of the best method; by default the budget that is stored in the dataset.

    Returns
    -------
    Lower and upper ends of the 95 % interval, arrays (step,) [m²/s], NaN where unknown. The result is None if the
    run has no error budget.
    """
    if budget is None:
        budget = best_budget(data)
    if budget is None:
        return None
    service_leakage = np.abs(budget.leakage)
    class_leakage = np.abs(class_leakage_of(data))
    both_leak = (service_leakage > 0) & (class_leakage > 0)
    ratio = np.zeros_like(class_leakage)
    np.divide(class_leakage, service_leakage, out=ratio, where=both_leak)
    largest_ratio = ratio.max(initial=0.0) or 1.0  # 1 if no step leaks
    factor = np.where(both_leak, ratio, largest_ratio)
    return factor * budget.lower, factor * budget.upper

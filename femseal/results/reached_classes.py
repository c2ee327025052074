"""Leakage classes that a seal reaches at each load step, and the leakage of a test fluid by which they are judged."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.errors import InputError
from ..base.leak_classes import LeakClass, leak_classes, within
from ..base.leak_units import LeakBasis
from ..base.quantities import to_text
from ..fluids import leak_basis
from ..studies.other_fluid import limit_factors

if TYPE_CHECKING:
    import xarray

    from ..studies import FluidState, OtherLeakage
    from .results import Results

#: Ratio of the length of a seal to the circumference of its nominal diameter beyond which a warning says so.
_ODD_LENGTH = 1.5


def add_test_fluid(data: xarray.Dataset, test: OtherLeakage, service: FluidState, stated: float | None) -> None:
    """Add the leakage of the test fluid, and attributes that tell its state and what both limits of flow would give."""
    labels = {"units": "m^2/s", "long_name": "leakage per unit seal length, test fluid"}
    data["test_leakage"] = ("step", test.leakage, labels)
    for name, values in (("realisations", test.realisations), ("resampled", test.resampled)):
        if values is not None:
            data[f"test_leakage_{name}"] = (("realisation", "step"), values, labels)
    basis, factors = leak_basis(test.state.fluid, 1.0, stated), limit_factors(test.state, service)
    data.attrs |= {
        "test_fluid": repr(test.state.fluid),
        "test_inlet_pressure_Pa": float(test.state.inlet_pressure),
        "test_outlet_pressure_Pa": float(test.state.outlet_pressure),
        "test_viscous_factor": factors.viscous,
        "test_molecular_factor": factors.molecular,
        **basis_attributes(basis, "test_"),
    }


def basis_attributes(basis: LeakBasis, prefix: str = "") -> dict[str, float]:
    """What `basis_of` reads back, without the length."""
    known = {
        "reference_density_kg_per_m3": basis.density,
        "reference_pressure_Pa": basis.pressure,
        "reference_temperature_K": basis.temperature,
        "molar_mass_kg_per_mol": basis.molar_mass,
        "stated_temperature_K": basis.stated,
    }
    return {prefix + name: float(value) for name, value in known.items() if value is not None}


def basis_of(attrs: dict[str, Any], prefix: str = "") -> LeakBasis:
    """Length of the seal and reference state of a fluid, from the attributes of a dataset."""

    def number(name: str) -> float | None:
        value = attrs.get(prefix + name)
        return None if value is None else float(value)

    return LeakBasis(
        length=float(attrs["seal_size_m"][1]),
        density=float(attrs.get(f"{prefix}reference_density_kg_per_m3", np.nan)),
        pressure=number("reference_pressure_Pa"),
        temperature=number("reference_temperature_K"),
        molar_mass=number("molar_mass_kg_per_mol"),
        stated=number("stated_temperature_K"),
    )


def add_classes(results: Results, names: Sequence[str], diameter: float | None) -> list[str]:
    """Add which classes are reached at each step, and by which share of the realisations; returns warnings.

    Classes are judged by the test fluid where there is one.

    Raises
    ------
    InputError : an unknown class, a class that needs a diameter without one, or one that is not for the fluid.
    """
    data, classes = results.dataset, leak_classes(names)
    if diameter is not None:
        data.attrs["nominal_diameter_m"] = float(diameter)
    if not classes:
        return []
    limits = np.array([c.limit(results.judged_basis, diameter) for c in classes])
    best, several = judged_leakage(data, results)
    reached = np.array([within(best, limit) for limit in limits], float)
    reached[:, (best == 0) & _upper_end_unknown(results)] = np.nan
    known = np.isfinite(several)
    count = np.maximum(known.sum(axis=0), 1)
    share = np.array([(within(several, limit) & known).sum(axis=0) / count for limit in limits])
    share[:, ~known.any(axis=0)] = np.nan
    told = "leakage class"
    data.coords["leak_class"] = ("leak_class", [c.name for c in classes], {"units": "1", "long_name": told})
    text = "largest leakage per unit seal length in the class, of the fluid that it is judged by"
    data["class_limit"] = ("leak_class", limits, {"units": "m^2/s", "long_name": text})
    for name, values, text in (
        (
            "class_reached",
            reached,
            "1 where the leakage given reaches the class, else 0; NaN: open, it may leak any amount",
        ),
        ("class_share", share, "share of the realisations that reach the class"),
    ):
        data[name] = (("leak_class", "step"), values, {"units": "1", "long_name": text})
    return _doubts(classes, results.judged_basis.length, diameter)


def _upper_end_unknown(results: Results) -> np.ndarray:
    """Whether the band of error has no known upper end at a step (steps,); False without a budget."""
    budget = results.budget
    return np.array(False) if budget is None else ~np.isfinite(np.asarray(budget.upper))


def _doubts(classes: Sequence[LeakClass], length: float, diameter: float | None) -> list[str]:
    if diameter is None or not any(c.per_diameter for c in classes):
        return []
    round_ = np.pi * diameter
    if 1 / _ODD_LENGTH <= length / round_ <= _ODD_LENGTH:
        return []
    sizes = to_text(length, "m", 3), to_text(diameter, "m", 3), to_text(round_, "m", 3)
    return [
        f"leakage classes by nominal diameter are of the whole seal: it is {sizes[0]} long, but a seat of {sizes[1]} "
        f"is about {sizes[2]} long"
    ]


def judged_leakage(data: xarray.Dataset, results: Results) -> tuple[np.ndarray, np.ndarray]:
    """Leakage by which classes are judged [m²/s]: the one that is given (step,), and that of each realisation."""
    prefix = "test_leakage" if "test_leakage" in data else ""
    best = data[prefix].values if prefix else results.leakage.values
    name = f"{prefix}_realisations" if prefix else "leakage"
    several = data[name].values if name in data and results.method == "median" else best[None]
    return np.asarray(best), np.asarray(several)


def tightest(results: Results) -> list[str]:
    """The tightest class of each family that is reached at every step; "–": none, "open": unknown."""
    data = results.dataset
    classes = leak_classes(str(name) for name in data["leak_class"].values)
    limits, reached = data["class_limit"].values, data["class_reached"].values
    lines = []
    for s in range(data.sizes["step"]):
        if np.isnan(reached[:, s]).any():
            lines.append("open")
            continue
        best: dict[str, tuple[float, str]] = {}
        for one, limit, there in zip(classes, limits, reached[:, s], strict=True):
            family = one.family or one.name
            if there and (family not in best or limit < best[family][0]):
                best[family] = (float(limit), one.name)
        lines.append(", ".join(name for _, name in best.values()) or "–")
    return lines


def check_classes(
    names: Sequence[str], diameter: float | None, fluid: Any, stated: float | None = None
) -> tuple[LeakClass, ...]:
    """The classes of names, checked for the fluid that they are judged by.

    Raises
    ------
    InputError : as `add_classes`.
    """
    basis = leak_basis(fluid, 1.0, stated)
    classes = leak_classes(names)
    for one in classes:
        if not np.isfinite(one.limit(basis, diameter)):
            raise InputError("classes", one.name, "a class with a limit")
    return classes

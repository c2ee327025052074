"""Variables of the leakage classes that a seal meets at each load step, by the leakage of its test fluid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import Array, to_text
from ..base.fields import LEAK_CLASS, REALISATION, Field, Place
from ..base.leak_rates import LeakBasis, LeakClass, leak_classes, within
from ..base.quantities import with_its_unit
from ..fluids import FLUIDS, Fluid, leak_basis
from ..studies.other_fluid import OtherLeakage, limit_factors
from ..studies.scene import FluidState
from .variables import add, add_coordinate, add_step

if TYPE_CHECKING:
    import xarray

#: Ratio of the length of a seal to the circumference of its nominal diameter beyond which a warning says so.
_ODD_LENGTH = 1.5
#: Attributes of a dataset by the part of the basis of its leakage that they hold.
_BASIS = {
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


def add_test_fluid(
    data: xarray.Dataset,
    test: OtherLeakage,
    service: FluidState,
    stated: float | None,
    valve: Mapping[str, float],
) -> None:
    """Add the leakage of the test fluid, and attributes with its state and what both limits of flow would give."""
    text = "leakage per unit seal length, test fluid"
    add_step(data, "test_leakage", "m^2/s", text, test.leakage)
    if test.realisations is not None:
        add(data, Field("test_leakage_realisations", "m^2/s", text, REALISATION), test.realisations)
    state, factors = test.state, limit_factors(test.state, service)
    basis = leak_basis(state.fluid, 1.0, stated, pressure_drop=state.pressure_drop, **valve)
    data.attrs |= {
        "test_fluid": fluid_text(test.state.fluid),
        "test_inlet_pressure_Pa": float(test.state.inlet_pressure),
        "test_outlet_pressure_Pa": float(test.state.outlet_pressure),
        "test_viscous_factor": factors.viscous,
        "test_molecular_factor": factors.molecular,
        **basis_attributes(basis, "test_"),
    }


def fluid_text(fluid: Fluid) -> str:
    """Kind and parameters of a fluid; one that is made in Python is as Python shows it.

    >>> import femseal as fs
    >>> fluid_text(fs.IdealGas(1.8e-5, 0.029, 293.0))
    'ideal-gas, viscosity 18 µPa·s, molar mass 0.029 kg/mol, temperature 293 K, slip'
    """
    kind = next((kind for kind, known in FLUIDS.items() if type(fluid) is known), None)
    if kind is None:
        return repr(fluid)
    found = [kind]
    for one in fields(FLUIDS[kind]):
        name, value = one.name.replace("_", " "), getattr(fluid, one.name)
        if isinstance(value, bool):
            found.append(name if value else f"no {name}")
        elif isinstance(value, str):
            found.append(value)
        elif value:
            found.append(f"{name} {with_its_unit(value, one.metadata['unit'])}")
    return ", ".join(found)


def basis_attributes(basis: LeakBasis, prefix: str = "") -> dict[str, float]:
    """What `basis_of` reads back, without the length."""
    values = {prefix + attribute: getattr(basis, name) for name, attribute in _BASIS.items()}
    return {attribute: float(value) for attribute, value in values.items() if value is not None}


def basis_of(attrs: dict[str, Any], prefix: str = "") -> LeakBasis:
    """Length of the seal and reference state of a fluid, from the attributes of a dataset."""
    names = {name: prefix + attribute for name, attribute in _BASIS.items()}
    known = {
        name: float(attrs[attribute]) for name, attribute in names.items() if attribute in attrs
    }
    return LeakBasis(**{"length": float(attrs["seal_size_m"][1]), "density": np.nan} | known)


def add_classes(
    data: xarray.Dataset,
    classes: Sequence[LeakClass],
    basis: LeakBasis,
    diameter: float | None,
    leakage: Array,
    realisations: Array,
    upper: Array | None = None,
) -> list[str]:
    """Add which classes are met at each step, and by which fraction of the realisations; returns warnings.

    basis, leakage, realisations : of the fluid that decides [m²/s]: (steps,) and (realisations, steps).
    diameter : nominal diameter [m], which some classes need. upper : upper end of the band of error (steps,) [m²/s]: a
    class of a sealed step without a known one is open, neither met nor not.

    Raises InputError: a class that needs a diameter without one, or one that is not for the fluid.
    """
    if diameter is not None:
        data.attrs["nominal_diameter_m"] = float(diameter)
    if not classes:
        return []
    limits = np.array([c.limit(basis, diameter) for c in classes])
    known = np.isfinite(realisations)
    count = np.maximum(known.sum(axis=0), 1)
    fraction = np.array(
        [(within(realisations, limit) & known).sum(axis=0) / count for limit in limits]
    )
    fraction[:, ~known.any(axis=0)] = np.nan
    add_coordinate(data, "leak_class", "1", "leakage class", [c.name for c in classes])
    text = "largest leakage per unit seal length in the class, of the fluid that decides on it"
    add(
        data, Field("class_limit", "m^2/s", text, Place("leakage classes", ("leak_class",))), limits
    )
    met = np.array([within(leakage, limit) for limit in limits]).astype(float)
    if upper is not None:
        met[:, (leakage == 0) & ~np.isfinite(upper)] = np.nan
        fraction[:, (realisations == 0).any(axis=0) & ~np.isfinite(upper)] = np.nan
    text = "1 where the leakage given meets the class, 0 where not, NaN: open"
    add(data, Field("class_met", "1", text, LEAK_CLASS), met)
    text = "fraction of the realisations that meet the class, NaN: open"
    add(data, Field("class_fraction", "1", text, LEAK_CLASS), fraction)
    return _doubts(classes, basis.length, diameter)


def _doubts(classes: Sequence[LeakClass], length: float, diameter: float | None) -> list[str]:
    """Warnings of limits at second hand, and of a nominal diameter that does not go with the length of the seal."""
    found, second = [], ", ".join(f"{c.name} ({c.edition})" for c in classes if c.second_hand)
    if second:
        found.append(
            f"limits of {second} are from tables of others, not checked against the standard's own text"
        )
    if diameter is None or not any(c.per_diameter for c in classes):
        return found
    round_ = np.pi * diameter
    if not 1 / _ODD_LENGTH <= length / round_ <= _ODD_LENGTH:
        sizes = to_text(length, "m", 3), to_text(diameter, "m", 3), to_text(round_, "m", 3)
        found.append(
            f"leakage classes by nominal diameter are of the whole seal: it is {sizes[0]} long, but a seat of "
            f"{sizes[1]} is about {sizes[2]} long"
        )
    return found


def tightest_classes(data: xarray.Dataset) -> list[str]:
    """The tightest class of each family that is met, at every step; "none", or "open": unknown; [] without classes."""
    if "leak_class" not in data.coords:
        return []
    classes = leak_classes(data["leak_class"].values.tolist())
    # the tightest of a family last
    order = np.argsort(data["class_limit"].values, kind="stable")[::-1]
    lines = []
    for met in data["class_met"].values.T:
        best = {classes[n].family or classes[n].name: classes[n].name for n in order if met[n]}
        lines.append("open" if np.isnan(met).any() else ", ".join(best.values()) or "none")
    return lines

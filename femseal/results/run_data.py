"""What a run has found: one labelled dataset, the large fields of its studies, and what follows from them.

That is also the leakage classes that a seal meets at each load step, by the leakage of a test fluid.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base import Array, to_text
from ..base.fields import LEAK_CLASS, REALISATION, Field, Place
from ..base.leak_rates import LEAK_UNITS, LeakBasis, LeakClass, LeakUnit, leak_classes, leak_unit, leakage_unit, within
from ..budget import ErrorBudget
from ..fluids import leak_basis
from ..loads import LoadProgramme, LoadStep
from ..studies import STUDIES, FaceResult, Scene, StochasticResult
from ..studies.other_fluid import FluidState, OtherLeakage, limit_factors
from .variables import add, add_coordinate, add_step, budgets_in

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
    data: xarray.Dataset, test: OtherLeakage, service: FluidState, stated: float | None, valve: Mapping[str, float]
) -> None:
    """Add the leakage of the test fluid, and attributes with its state and what both limits of flow would give."""
    text = "leakage per unit seal length, test fluid"
    add_step(data, "test_leakage", "m^2/s", text, test.leakage)
    if test.realisations is not None:
        add(data, Field("test_leakage_realisations", "m^2/s", text, REALISATION), test.realisations)
    state, factors = test.state, limit_factors(test.state, service)
    basis = leak_basis(state.fluid, 1.0, stated, pressure_drop=state.pressure_drop, **valve)
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
    values = {prefix + attribute: getattr(basis, name) for name, attribute in _BASIS.items()}
    return {attribute: float(value) for attribute, value in values.items() if value is not None}


def basis_of(attrs: dict[str, Any], prefix: str = "") -> LeakBasis:
    """Length of the seal and reference state of a fluid, from the attributes of a dataset."""
    names = {name: prefix + attribute for name, attribute in _BASIS.items()}
    known = {name: float(attrs[attribute]) for name, attribute in names.items() if attribute in attrs}
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
    fraction = np.array([(within(realisations, limit) & known).sum(axis=0) / count for limit in limits])
    fraction[:, ~known.any(axis=0)] = np.nan
    add_coordinate(data, "leak_class", "1", "leakage class", [c.name for c in classes])
    text = "largest leakage per unit seal length in the class, of the fluid that decides on it"
    add(data, Field("class_limit", "m^2/s", text, Place("leakage classes", ("leak_class",))), limits)
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
        found.append(f"limits of {second} are from tables of others, not checked against the standard's own text")
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
    classes = leak_classes(str(name) for name in data["leak_class"].values)
    limits, met = data["class_limit"].values, data["class_met"].values
    lines = []
    for s in range(data.sizes["step"]):
        if np.isnan(met[:, s]).any():
            lines.append("open")
            continue
        best: dict[str, tuple[float, str]] = {}
        for one, limit, there in zip(classes, limits, met[:, s], strict=True):
            family = one.family or one.name
            if there and (family not in best or limit < best[family][0]):
                best[family] = (float(limit), one.name)
        lines.append(", ".join(name for _, name in best.values()) or "none")
    return lines


#: Methods from the best, each with its leakage in the dataset, and its name in the variables of its budget.
METHODS = tuple((study.label, study.leakage_variable) for study in reversed(STUDIES.values()))
BUDGETED = {study.label: study.key for study in STUDIES.values()}


@dataclass(frozen=True, eq=False, repr=False)
class RunData:
    """What a run has found.

    dataset : every number with its unit, see `assemble`. folder : from which it was read, or to which it was saved.
    scene : the input of the studies; deterministic, two_scale, stochastic : the results of the studies with the fields
    that are too large for the dataset. None if not run, or read from a folder.
    """

    dataset: xarray.Dataset
    folder: Path | None = None
    scene: Scene | None = None
    deterministic: FaceResult | None = None
    two_scale: FaceResult | None = None
    stochastic: StochasticResult | None = None

    @property
    def method(self) -> str:
        """Source of `leakage`: "median" (of realisations), "two-scale" or "deterministic"."""
        return next(method for method, name in METHODS if name in self.dataset)

    @property
    def leakage(self) -> xarray.DataArray:
        """Best available leakage per length of seal (step,) [m²/s]: median, else two-scale, else deterministic."""
        return self.dataset[dict(METHODS)[self.method]]

    @property
    def per_length(self) -> xarray.DataArray:
        """`leakage` by its name in `Leakage` [m²/s]."""
        return self.leakage

    @property
    def volume_rate(self) -> xarray.DataArray:
        """Best available leakage of the whole seal (step,) [m³/s], as in `Leakage`."""
        return self.dataset["leakage_total"]

    @property
    def mass_rate(self) -> xarray.DataArray:
        """The same by mass (step,) [kg/s].

        Raises InputError: the density of the fluid is unknown.
        """
        return self.leakage_in("kg/s")

    @property
    def leak_basis(self) -> LeakBasis:
        """Length of the seal and reference state of the fluid, which turn the leakage into any unit."""
        return basis_of(self.dataset.attrs)

    @property
    def class_basis(self) -> LeakBasis:
        """The same of the fluid that decides on leakage classes: the test fluid where there is one."""
        return basis_of(self.dataset.attrs, "test_" if "test_leakage" in self.dataset else "")

    @property
    def class_leakage(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Leakage that decides on classes [m²/s]: the one that is given (step,), and that of each realisation."""
        data, tested = self.dataset, "test_leakage" in self.dataset
        best = data["test_leakage"].values if tested else self.leakage.values
        name = "test_leakage_realisations" if tested else "leakage"
        several = data[name].values if name in data and self.method == "median" else best[None]
        return np.asarray(best), np.asarray(several)

    @property
    def classes(self) -> list[str]:
        """The tightest leakage class that is met at each step, of each standard asked for; "none" where none is."""
        return tightest_classes(self.dataset)

    @property
    def leak_unit(self) -> LeakUnit:
        """The unit of leakage in tables and pictures: that of the case, else a readable one per length of seal."""
        if (asked := self.asked_unit) is not None and self.leak_basis.has(asked):
            return asked
        return LEAK_UNITS[leakage_unit(self.leakage.values)[1]]

    @property
    def asked_unit(self) -> LeakUnit | None:
        """The unit of leakage that the case gives, for its fluid, for its test fluid, or for both."""
        return LEAK_UNITS.get(self.dataset.attrs.get("leakage_unit", ""))

    @property
    def leak_scale(self) -> tuple[LeakUnit, float]:
        """`leak_unit`, and the leakage per length that is 1 in it [m²/s]."""
        return self.leak_unit, self.leak_basis.factor(self.leak_unit)

    def leakage_in(self, unit: str) -> xarray.DataArray:
        """`leakage` (step,) in a unit such as "mL/min", "g/year", "mL/(m·min)"; of gases also "mbar·L/s", "std cm³/s".

        Units that are not per length are of the whole seal. Volumes of gases are at 101 325 Pa and their temperature,
        standard ones at 0 °C; pressure × volume is at the temperature stated in the case, else at that of the gas.

        Raises InputError: no such unit, or a unit of gases for a liquid.
        """
        chosen = leak_unit(unit)
        values = self.leakage / self.leak_basis.factor(chosen)
        return values.assign_attrs(units=chosen.name, long_name=self.leakage.attrs["long_name"])

    @property
    def budgets(self) -> dict[str, ErrorBudget]:
        """Error budgets by method: "deterministic", "two_scale", "stochastic"; empty where none was asked for."""
        return budgets_in(self.dataset, self.steps)

    @property
    def budget(self) -> ErrorBudget | None:
        """Error budget of `leakage`; None where none was asked for."""
        return self.budgets.get(BUDGETED[self.method])

    @property
    def steps(self) -> LoadProgramme:
        """The load programme."""
        pairs = zip(self.dataset["nominal_pressure"].values, self.dataset["unloaded_from"].values, strict=True)
        return LoadProgramme(LoadStep(float(p), None if np.isnan(peak) else float(peak)) for p, peak in pairs)

    @property
    def peak(self) -> int:
        """The first step of the highest load."""
        return int(np.argmax(self.dataset["nominal_pressure"].values))

    @property
    def warnings(self) -> list[str]:
        """Reasons to doubt the numbers, one line each; empty if there are none."""
        return json.loads(self.dataset.attrs["warnings"])

    @property
    def failures(self) -> list[str]:
        """Failures, whose numbers are missing or NaN, one line each; empty if there are none."""
        return json.loads(self.dataset.attrs["failures"])

    @property
    def open_steps(self) -> list[int]:
        """Numbers of the steps without leakage at which the fluid carries all of the load, so that the seal is open."""
        names, failures = self.dataset["name"].values, self.failures
        return [s for s, name in enumerate(names) if any(f"{name}: open: " in text for text in failures)]

    @property
    def left_out(self) -> list[str]:
        """Files that were not written to the folder, with the reason, one line each; empty if there are none."""
        return json.loads(self.dataset.attrs.get("left_out", "[]"))

    @property
    def case(self) -> dict[str, Any]:
        """The case in SI, as given to `assemble`; tuples have become lists."""
        return json.loads(self.dataset.attrs["case"])

    @property
    def attempts(self) -> dict[str, Any] | None:
        """The attempts at the accuracy that the case asks for, and whether it is met; None if it asks for none."""
        text = self.dataset.attrs.get("accuracy")
        return None if text is None else json.loads(text)

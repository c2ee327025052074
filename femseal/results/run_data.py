"""What a run has found: one labelled dataset, the large fields of its studies, and what follows from them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base.leak_rates import LEAK_UNITS, LeakBasis, LeakUnit, leak_unit, leakage_unit
from ..budget import ErrorBudget
from ..loads import LoadProgramme, LoadStep
from ..studies import STUDIES, DeterministicResult, Scene, StochasticResult, TwoScaleResult
from ..studies.link_flow import WindowPixels
from .class_results import basis_of, tightest_classes
from .variables import budgets_in

if TYPE_CHECKING:
    import xarray

#: Methods from the best, each with its leakage in the dataset, and its name in the variables of its budget.
METHODS = tuple((study.label, study.leakage_variable) for study in reversed(STUDIES.values()))
BUDGETED = {study.label: study.key for study in STUDIES.values()}


@dataclass(frozen=True, eq=False, repr=False)
class RunData:
    """What a run has found.

    dataset : every number with its unit, see `assemble`. folder : from which it was read, or to which it was saved.
    scene : the input of the studies; deterministic, two_scale, stochastic : the results of the studies with the fields
    that are too large for the dataset; windows : fields of single windows. None, or empty, if not run, or read from a
    folder.
    """

    dataset: xarray.Dataset
    folder: Path | None = None
    scene: Scene | None = None
    deterministic: DeterministicResult | None = None
    two_scale: TwoScaleResult | None = None
    stochastic: StochasticResult | None = None
    windows: tuple[WindowPixels, ...] = ()

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
        return (
            LEAK_UNITS.get(self.dataset.attrs.get("leakage_unit", ""))
            or LEAK_UNITS[leakage_unit(self.leakage.values)[1]]
        )

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

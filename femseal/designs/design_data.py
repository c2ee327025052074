"""What a seal needs: its requirements, the load that seals it, and what changes its leakage most."""

from __future__ import annotations

from dataclasses import dataclass

from ..base.leak_rates import LEAK_UNITS, LeakUnit, leak_classes
from ..results.results import Results
from .requirements import NeededPressure, Requirement
from .seals import Seals
from .sensitivities import Sensitivity, TurnedFace


@dataclass(frozen=True, eq=False, repr=False)
class DesignData:
    """What a seal needs, see `design`.

    results : of the run. seals : the leakages that decide. probability : fraction of the seals that keep a class.
    requirements : Qmin and QSmin of every class. sealing : load from which on nothing leaks. at : class and nominal
    pressure [Pa] of the sensitivities; NaN where there is none. sensitivities, turned : what changes the leakage.
    notes : what to keep in mind, one line each.
    """

    results: Results
    seals: Seals
    probability: float
    requirements: tuple[Requirement, ...]
    sealing: NeededPressure
    at: tuple[str, float]
    sensitivities: tuple[Sensitivity, ...]
    turned: TurnedFace | None
    notes: tuple[str, ...]

    @property
    def relaxation(self) -> float:
        """Fraction of the load in assembly that is lost before service."""
        return float(self.results.case.get("load", {}).get("relaxation", 0.0))

    @property
    def leak_scale(self) -> tuple[LeakUnit, float]:
        """The unit of leakage, that of the first class, and the leakage per length that is 1 in it [m²/s]."""
        unit = self.results.leak_unit
        if self.requirements:
            unit = LEAK_UNITS[leak_classes([self.requirements[0].name])[0].unit]
        return unit, self.results.class_basis.factor(unit)

"""Another fluid on the same seals, such as the gas of a leak test beside the fluid in service."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base import Array
from .scene import FluidState, Scene


@dataclass(frozen=True, eq=False)
class OtherLeakage:
    """Leakage of another fluid through the same seals, per length at its own reference density [m²/s].

    leakage : (steps,), of the median seal where there are realisations. realisations : (realisation, step); None
    without.
    """

    state: FluidState
    leakage: Array
    realisations: Array | None = None

    @classmethod
    def of_study(cls, state: FluidState, study: Any, ratio: float = 1.0) -> OtherLeakage:
        """From a study of the same seals, whose leakage is multiplied by a ratio."""
        if hasattr(study, "quantile"):
            return cls(state, ratio * study.quantile(0.5), ratio * study.leakage)
        return cls(state, ratio * study.leakage)


def drop_ratio(state: FluidState, scene: Scene) -> float | None:
    """Ratio of the leakage of a fluid to that of the scene's own; None where it has to be solved for.

    The conductance of a seal [m³] is the same for fluids of one law that does not depend on the pressure, if neither
    presses the faces apart: the drops of their potentials then have the ratio of their leakages, exactly.
    """
    if scene.acting_fluid is not None or state.in_scene(scene).acting_fluid is not None:
        return None
    own = FluidState.of(scene)
    return None if state.law != own.law or state.law.depends_on_pressure else state.drop / own.drop


@dataclass(frozen=True)
class LimitFactors:
    """Factors from the leakage of a test gas to that of the fluid in service that the two limits of flow would give.

    viscous : ratio of the leakages as a continuum, in pressure × volume of two gases, else in volume at the reference
    density. molecular : that of free molecules, of two gases with molar mass and temperature; NaN otherwise.
    """

    viscous: float
    molecular: float


def limit_factors(test: FluidState, service: FluidState) -> LimitFactors:
    """Factors of both limits, with the pressures of both fluids.

    Viscous flow of gases goes with (p1² − p2²)/η in pressure × volume, molecular flow with (p1 − p2)/√(M/T). At equal
    pressures and temperature they are η/η' and √(M/M'): of helium to nitrogen 1.12 and 0.378.
    """

    def free_flow(state: FluidState) -> float:
        gas: Any = state.fluid
        speed = float(np.sqrt(gas.temperature / gas.molar_mass))
        return (state.inlet_pressure - state.outlet_pressure) * speed

    viscous, molecular = service.drop / test.drop, float("nan")
    gases: list[Any] = [service.fluid, test.fluid]
    if all(hasattr(gas, "reference_pressure") for gas in gases):
        viscous *= gases[0].reference_pressure / gases[1].reference_pressure
        if all(hasattr(gas, "molar_mass") and hasattr(gas, "temperature") for gas in gases):
            molecular = free_flow(service) / free_flow(test)
    return LimitFactors(viscous, molecular)

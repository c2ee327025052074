"""Compute the leakage of another fluid through the same seals, such as the gas of a leak test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base import Array
from ..scene import FluidState, Scene


@dataclass(frozen=True, eq=False)
class OtherLeakage:
    """Leakage of another fluid through the same seals, per length at its own reference density.

    Parameters
    ----------
    state : the fluid and its pressures.
    leakage : array (steps,), m²/s; of the median seal where there are realisations.
    realisations : array (realisation, step), m²/s; None without any.
    """

    state: FluidState
    leakage: Array
    realisations: Array | None = None

    @classmethod
    def of_study(cls, state: FluidState, study: Any, ratio: float = 1.0) -> OtherLeakage:
        """Take the leakage of a study of the same seals, multiplied by a ratio."""
        if hasattr(study, "quantile"):
            return cls(state, ratio * study.quantile(0.5), ratio * study.leakage)
        return cls(state, ratio * study.leakage)


def drop_ratio(state: FluidState, scene: Scene) -> float | None:
    """Return the ratio of the leakage of a fluid to that of the scene's fluid; None where it has to be solved.

    The conductance of a seal [m³] is the same for all fluids with one flow law that does not depend on the pressure, if
    no fluid presses the bodies apart. Their leakages then have exactly the ratio of the drops of their potentials.
    """
    if scene.acting_fluid is not None or state.in_scene(scene).acting_fluid is not None:
        return None
    in_service = FluidState.of(scene)
    if state.law != in_service.law or state.law.depends_on_pressure:
        return None
    return state.drop / in_service.drop


@dataclass(frozen=True)
class LimitFactors:
    """Factors from the leakage of a test gas to that of the fluid in service, at the two limits of gas flow.

    Parameters
    ----------
    viscous : ratio of the leakages in viscous flow, in pressure × volume of two gases, else in volume at the reference
        density.
    molecular : ratio of the leakages in free molecular flow, of two gases with molar mass and temperature; NaN
        otherwise.
    """

    viscous: float
    molecular: float


def limit_factors(test: FluidState, service: FluidState) -> LimitFactors:
    """Compute the factors of both limits of gas flow, at the pressures of both fluids.

    Viscous flow of gases is proportional to (p1² − p2²)/η in pressure × volume, molecular flow to (p1 − p2)/√(M/T). At
    equal pressures and temperature the factors are η/η' and √(M/M'): from helium to nitrogen 1.12 and 0.378.
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

"""Compute the leakage of another fluid through the same seals, such as the gas of a leak test."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base import Array
from ..scene import FluidState, Scene


@dataclass(frozen=True, eq=False)
class OtherLeakage:
    """Hold the leakage of another fluid through the same seals, as a volume at the reference density of that fluid.

    Parameters
    ----------
    state : FluidState
        The fluid and its pressures.
    leakage : array (steps,), m²/s
        Leakage per unit seal length; the median if there are several realisations.
    realisations : array (realisations, steps), m²/s, optional
        Leakage of each realisation; None for studies that have no realisations.
    """

    state: FluidState
    leakage: Array
    realisations: Array | None = None

    @classmethod
    def of_study(cls, state: FluidState, study: Any, ratio: float = 1.0) -> OtherLeakage:
        """Multiply the leakage of a study of the same seals by the ratio between the two fluids."""
        if hasattr(study, "quantile"):
            return cls(state, ratio * study.quantile(0.5), ratio * study.leakage)
        return cls(state, ratio * study.leakage)


def drop_ratio(state: FluidState, scene: Scene) -> float | None:
    """Return the ratio of the leakage of a fluid to that of the fluid of the scene, if no new solution is needed.

    The ratio is known if both fluids have the same flow law, this law does not depend on the pressure, and the fluid
    pressure does not act on the surfaces. Then the conductance of the seal [m³] is the same for both fluids, and the
    ratio of their leakages is that of the drops of their pressure potentials. Otherwise the result is None.
    """
    if scene.acting_fluid is not None or state.in_scene(scene).acting_fluid is not None:
        return None
    in_service = FluidState.of(scene)
    if state.law != in_service.law or state.law.depends_on_pressure:
        return None
    return state.drop / in_service.drop


@dataclass(frozen=True)
class LimitFactors:
    """Hold the ratios of the leakage of the service fluid to that of a test gas, in the two limits of gas flow.

    Parameters
    ----------
    viscous : float
        Ratio in viscous flow. Leakages of two gases are compared as pressure × volume, others as the volume at the
        reference density.
    molecular : float
        Ratio in free molecular flow. It is NaN unless both fluids are gases with a molar mass and a temperature.
    """

    viscous: float
    molecular: float


def limit_factors(test: FluidState, service: FluidState) -> LimitFactors:
    """Compute the ratio of the leakages of two fluids in viscous and in free molecular flow.

    As pressure × volume, the viscous flow of a gas is proportional to (p1² − p2²)/η, and its molecular flow to
    (p1 − p2)/√(M/T). If both gases have the same pressures and temperature, the ratios are therefore η/η' and √(M/M'),
    with the test gas in the numerator. A test with helium for nitrogen in service gives 1.12 and 0.378.
    """

    def free_flow(state: FluidState) -> float:
        """Return a number that is proportional to the free molecular flow of a gas, as pressure × volume."""
        gas: Any = state.fluid
        speed = float(np.sqrt(gas.temperature / gas.molar_mass))
        return (state.inlet_pressure - state.outlet_pressure) * speed

    viscous = service.drop / test.drop
    molecular = float("nan")
    gases: list[Any] = [service.fluid, test.fluid]
    if all(hasattr(gas, "reference_pressure") for gas in gases):
        viscous *= gases[0].reference_pressure / gases[1].reference_pressure
        if all(hasattr(gas, "molar_mass") and hasattr(gas, "temperature") for gas in gases):
            molecular = free_flow(service) / free_flow(test)
    return LimitFactors(viscous, molecular)

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
        """Compute the leakage of the other fluid: multiply the leakages of a study by the ratio for the two fluids."""
        if hasattr(study, "quantile"):
            return cls(state, ratio * study.quantile(0.5), ratio * study.leakage)
        return cls(state, ratio * study.leakage)


def drop_ratio(state: FluidState, scene: Scene) -> float | None:
    """Return the ratio of the leakage of another fluid to the leakage of the scene's fluid, None if it is unknown.

    The ratio is known without a new solution if both fluids have the same flow law, this law does not depend on the
    pressure, and the fluid pressure does not act on the surfaces. Then the conductance of the seal [m³] is the same for
    both fluids, and their leakages are proportional to the drops of their pressure potentials.
    """
    if scene.acting_fluid is not None or state.in_scene(scene).acting_fluid is not None:
        return None
    in_service = FluidState.of(scene)
    if state.law != in_service.law or state.law.depends_on_pressure:
        return None
    return state.drop / in_service.drop


@dataclass(frozen=True)
class LimitFactors:
    """Hold the leakage of the service fluid divided by the leakage of a test gas, in the two limits of gas flow.

    Parameters
    ----------
    viscous : float
        Ratio in viscous flow. If both fluids are gases, their leakages are compared as pressure × volume per time,
        otherwise as volume per time at the reference density.
    molecular : float
        Ratio in free molecular flow. It is NaN unless both fluids are gases with a molar mass and a temperature.
    """

    viscous: float
    molecular: float


def limit_factors(test: FluidState, service: FluidState) -> LimitFactors:
    """Compute the ratio of the leakages of two fluids in viscous and in free molecular flow.

    The flow of a gas, as pressure × volume per time, is proportional to (p1² − p2²)/η in viscous flow, and to
    (p1 − p2) √(T/M) in molecular flow. If both gases have the same pressures and temperature, the ratios are therefore
    η/η' and √(M/M'), with the test gas in the numerator. For a test with helium and nitrogen in service, they are 1.12
    and 0.378.
    """

    def molecular_flow(state: FluidState) -> float:
        """Return (p1 − p2) √(T/M), to which the molecular flow of a gas is proportional."""
        gas: Any = state.fluid
        speed = float(np.sqrt(gas.temperature / gas.molar_mass))
        return (state.inlet_pressure - state.outlet_pressure) * speed

    viscous = service.drop / test.drop  # ratio of the volume rates at the reference densities
    molecular = float("nan")
    service_fluid: Any = service.fluid
    test_fluid: Any = test.fluid
    fluids = (service_fluid, test_fluid)
    if all(hasattr(fluid, "reference_pressure") for fluid in fluids):
        # the volume rate at the reference density, times the reference pressure, is pressure × volume per time
        viscous *= service_fluid.reference_pressure / test_fluid.reference_pressure
        if all(hasattr(fluid, "molar_mass") and hasattr(fluid, "temperature") for fluid in fluids):
            molecular = molecular_flow(service) / molecular_flow(test)
    return LimitFactors(viscous, molecular)

"""Compute the leakage of a second fluid, such as a leak-test gas, through the seals of a study."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base import Array
from ..scene import FluidState, Scene
from .study_result import StudyResult


@dataclass(frozen=True, eq=False)
class OtherLeakage:
    """Leakage of a second fluid through the seals of a study, as a volume rate at its reference density.

    Parameters
    ----------
    state : FluidState
        The second fluid and its pressures.
    leakage : array (steps,), m²/s
        Leakage per unit seal length; the median leakage for a study with realisations.
    realisations : array (realisations, steps), m²/s, optional
        Leakage of each realisation; None for a study without realisations.
    """

    state: FluidState
    leakage: Array
    realisations: Array | None = None

    @classmethod
    def of_study(cls, state: FluidState, study: StudyResult, ratio: float = 1.0) -> OtherLeakage:
        """Multiply the leakages of a study by the ratio of the leakages of the two fluids."""
        leakage = ratio * study.predicted_leakage
        if study.realisation_count is None:
            return cls(state, leakage)
        return cls(state, leakage, ratio * study.leakage)


def drop_ratio(state: FluidState, scene: Scene) -> float | None:
    """Return the ratio of the leakage of another fluid to the leakage of the scene's fluid; None if unknown.

    The ratio is known if three conditions are met: the flow law is the same for both fluids, the flow law does not
    depend on the pressure, and the fluid pressure does not act on the surfaces. Under these conditions, the conductance
    of the seal [m³] is the same for both fluids. The leakages are then proportional to the differences of the pressure
    potential between inlet and outlet.
    """
    if scene.acting_fluid is not None or state.in_scene(scene).acting_fluid is not None:
        return None
    in_service = FluidState.of(scene)
    if state.law != in_service.law or state.law.depends_on_pressure:
        return None
    return state.drop / in_service.drop


@dataclass(frozen=True)
class LimitFactors:
    """Ratios of the leakage of the service fluid to the leakage of a test gas, in the two limits of gas flow.

    Parameters
    ----------
    viscous : float
        Ratio of the leakages in viscous flow. If both fluids are gases, the leakages are measured as pressure × volume
        per time, otherwise as volume per time at the reference density.
    molecular : float
        Ratio of the leakages in free molecular flow; NaN unless both fluids are gases with a molar mass and a
        temperature.
    """

    viscous: float
    molecular: float


def limit_factors(test: FluidState, service: FluidState) -> LimitFactors:
    """Compute the ratio of the leakages of two fluids in viscous and in free molecular flow.

    The flow of a gas, as pressure × volume per time, is proportional to (p1² − p2²)/η in viscous flow, and to (p1 − p2)
    √(T/M) in molecular flow. Here p1 and p2 are the inlet and outlet pressures, η the viscosity, T the temperature and
    M the molar mass. If the test gas (η, M) and the service gas (η', M') have the same pressures and the same
    temperature, the ratio of the leakages (service gas to test gas) is η/η' in viscous flow and √(M/M') in molecular
    flow. For helium as the test gas and nitrogen as the service gas, the ratio is 1.12 in viscous flow and 0.378 in
    molecular flow.
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

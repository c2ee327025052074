"""Flow that the model does not hold: a gas as fast as sound, or a fluid whose inertia counts."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import numpy as np

from ..base import Array, to_text
from ..fluids import Fluid, leak_basis
from .scene import Scene

#: Flux of a choked nozzle over √(p ρ) at its inlet, √κ (2/(κ + 1))^((κ + 1)/2(κ − 1)) for κ = 1.4; 0.67 for κ = 1.3 and
#: 0.73 for 5/3.
_CHOKED = 0.685


def choked_flux(fluid: Fluid, pressure: float) -> float:
    """Mass that a nozzle lets through at most, from an inlet pressure [Pa] of a gas [kg/(m² s)]; inf of a liquid.

    √(pρ) times a number of the ratio κ of specific heats alone, which is that of air.
    """
    basis = leak_basis(fluid, 1.0)
    if basis.pressure is None:
        return np.inf
    real = getattr(fluid, "density_at", None)
    density = float(real(pressure)) if real else basis.density * pressure / basis.pressure
    return _CHOKED * float(np.sqrt(pressure * density))


def flow_warnings(scene: Scene, leakage: Array, gaps: Array) -> Iterator[str]:
    """A sentence for the step where a gas passes the choked flux most, and one where inertia counts most.

    leakage : per length at every step (steps,) [m²/s]. gaps : mean gaps (steps,) [m], through whose section it passes.
    NaN where one is unknown. Reynolds number ρuh/η = rate per length over η, times gap over wave, as the wave of the
    rms height and slope, 2πSq/h′.
    """
    fluid, surface, pressure = (
        scene.fluid,
        scene.surface,
        max(scene.inlet_pressure, scene.outlet_pressure),
    )
    viscosity_at = getattr(fluid, "viscosity_at", None)
    viscosity = float(
        viscosity_at(pressure) if viscosity_at else getattr(fluid, "viscosity", np.nan)
    )
    mass = np.abs(leakage) * fluid.reference_density
    wave = 2 * pi * surface.rms_height / max(surface.rms_slope, 1e-300)
    with np.errstate(divide="ignore", invalid="ignore"):
        choked = np.nan_to_num(mass / (choked_flux(fluid, pressure) * gaps), posinf=0.0)
        reynolds = np.nan_to_num(mass / viscosity * gaps / wave)
    fastest, n = int(choked.argmax()), int(reynolds.argmax())
    names = [step.name for step in scene.steps]
    if choked[fastest] > 1:
        rate, times, gap = mass[fastest], choked[fastest], to_text(gaps[fastest], "m", 2)
        yield (
            f"at {names[fastest]} {rate:.2g} kg/s per metre of the gas leak, {times:.2g} times what a choked nozzle as "
            f"narrow as the mean gap, {gap}, lets through: it leaks no more than {rate / times:.2g} kg/s per metre, as "
            "the model has no speed of sound"
        )
    if reynolds[n] > 1:
        yield (
            f"at {names[n]} the Reynolds number of the mean gap, {mass[n] / viscosity:.2g}, times gap over wave, "
            f"{gaps[n] / wave:.2g}, is {reynolds[n]:.2g}: above 1 inertia slows the flow, and the model has none"
        )

"""Warn about flow that the model does not describe: choked gas flow, and flow with inertia."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi
from typing import Any

import numpy as np

from ..base import Array, to_text
from ..fluids import Fluid, leak_basis
from ..scene import Scene

#: Mass flux through a choked nozzle, divided by √(p ρ) at its inlet: √κ (2/(κ + 1))^((κ + 1)/2(κ − 1)) for κ = 1.4. For
#: κ = 1.3, this number would be 0.67, and for κ = 5/3 it would be 0.73.
_CHOKED = 0.685


def choked_flux(fluid: Fluid, pressure: float) -> float:
    """Compute the largest mass flux through a nozzle [kg/(m² s)], which is infinite for a liquid.

    The largest flux is √(pρ), with the pressure p and the density ρ at the inlet, multiplied by a function of the ratio
    κ of specific heats. For all gases, this function is evaluated at κ = 1.4, the ratio for air.

    Parameters
    ----------
    fluid : Fluid
        The fluid.
    pressure : float
        Pressure at the inlet [Pa].
    """
    basis = leak_basis(fluid, 1.0)
    if basis.pressure is None:
        return np.inf
    density_at = getattr(fluid, "density_at", None)
    if density_at:
        density = float(density_at(pressure))
    else:
        density = basis.density * pressure / basis.pressure
    return _CHOKED * float(np.sqrt(pressure * density))


def flow_warnings(scene: Scene, leakage: Array, mean_gap: Array) -> Iterator[str]:
    """Warn, for the worst load step, if a gas flow would be choked or if inertia is not negligible.

    Inertia is measured by the reduced Reynolds number (ρuh/η)(h/λ), with the density ρ, the mean velocity u and the
    viscosity η of the fluid, and the mean gap h. The product ρuh is the mass rate per length of seal. The length λ =
    2πSq/Sdq is the wavelength of a sine wave with the rms height Sq and the rms slope Sdq of the surface.

    Parameters
    ----------
    scene : Scene
        Surface and fluid.
    leakage : array, (steps,)
        Leakage per length of seal [m²/s], NaN where unknown.
    mean_gap : array, (steps,)
        Mean gap through which the fluid passes [m], NaN where unknown.
    """
    fluid, surface = scene.fluid, scene.surface
    pressure = max(scene.inlet_pressure, scene.outlet_pressure)
    viscosity = _viscosity(fluid, pressure)
    mass_rate = np.abs(leakage) * fluid.reference_density
    wave = 2 * pi * surface.rms_height / max(surface.rms_slope, 1e-300)
    with np.errstate(divide="ignore", invalid="ignore"):
        choked = np.nan_to_num(mass_rate / (choked_flux(fluid, pressure) * mean_gap), posinf=0.0)
        inertia = np.nan_to_num(mass_rate / viscosity * mean_gap / wave)
    names = [step.name for step in scene.steps]
    worst = int(choked.argmax())
    if choked[worst] > 1:
        yield (
            f"Less gas leaks than computed, at most {mass_rate[worst] / choked[worst]:.2g} kg/s per metre at "
            f"{names[worst]}: the computed {mass_rate[worst]:.2g} kg/s per metre are {choked[worst]:.2g} times what a "
            f"choked nozzle as narrow as the mean gap, {to_text(mean_gap[worst], 'm', 2)}, lets through, and the model "
            "does not include choking"
        )
    worst = int(inertia.argmax())
    if inertia[worst] > 1:
        yield (
            f"Less leaks than computed at {names[worst]}, as inertia is not negligible: the Reynolds number of the "
            f"mean gap, {mass_rate[worst] / viscosity:.2g}, times gap over wave, {mean_gap[worst] / wave:.2g}, is "
            f"{inertia[worst]:.2g} and should be below 1"
        )


def _viscosity(fluid: Any, pressure: float) -> float:
    """Return the viscosity of a fluid at a pressure [Pa·s], or NaN if the fluid has no viscosity."""
    if hasattr(fluid, "viscosity_at"):
        return float(fluid.viscosity_at(pressure))
    return float(getattr(fluid, "viscosity", np.nan))

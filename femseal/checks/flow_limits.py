"""Detect flow that the model does not describe: choked flow of gases, inertia, and gases that are not ideal."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite, pi
from typing import Any

import numpy as np

from ..base import Array, to_text
from ..fluids import Fluid, IdealGas, leak_basis
from ..named_fluids import ideal_gas_error, is_nearly_ideal
from ..scene import Scene

#: Above the first pressure [Pa] no gas is ideal to good accuracy; up to the second no common gas condenses at 20 °C.
_IDEAL_UP_TO, _NO_GAS_CONDENSES_UP_TO = 20e5, 2e5
#: Relative error of the leakage of an ideal gas up to which there is no warning at lower pressures.
_IDEAL_WITHIN = 0.05
#: Mass flux of a choked nozzle over √(p ρ) at its inlet, √κ (2/(κ + 1))^((κ + 1)/2(κ − 1)) for κ = 1.4. It is 0.67 for
#: κ = 1.3 and 0.73 for 5/3.
_CHOKED = 0.685


def choked_flux(fluid: Fluid, pressure: float) -> float:
    """Compute the largest mass flux through a nozzle [kg/(m² s)], which is infinite for a liquid.

    The flux is √(pρ) at the inlet times a function of the ratio κ of specific heats, for which that of air is taken.

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
    """Warn if a gas flow would be choked, or if inertia is not negligible, at the load step where this is worst.

    Inertia is measured by the reduced Reynolds number (ρuh/η)(h/λ). The first factor is the mass rate per length over
    η. The wavelength λ is that of a sine wave with the rms height Sq and rms slope h′ of the surface, 2πSq/h′.

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
    n = int(choked.argmax())
    if choked[n] > 1:
        yield (
            f"Less gas leaks than computed, at most {mass_rate[n] / choked[n]:.2g} kg/s per metre at {names[n]}: the "
            f"computed {mass_rate[n]:.2g} kg/s per metre are {choked[n]:.2g} times what a choked nozzle as narrow as "
            f"the mean gap, {to_text(mean_gap[n], 'm', 2)}, lets through, and the model has no speed of sound"
        )
    n = int(inertia.argmax())
    if inertia[n] > 1:
        yield (
            f"Less leaks than computed at {names[n]}, as inertia is not negligible: the Reynolds number of the mean "
            f"gap, {mass_rate[n] / viscosity:.2g}, times gap over wave, {mean_gap[n] / wave:.2g}, is {inertia[n]:.2g} "
            "and should be below 1"
        )


def _viscosity(fluid: Any, pressure: float) -> float:
    """Return the viscosity of a fluid at a pressure [Pa·s], or NaN if the fluid does not define one."""
    if hasattr(fluid, "viscosity_at"):
        return float(fluid.viscosity_at(pressure))
    return float(getattr(fluid, "viscosity", np.nan))


def gas_warnings(key: str, fluid: Any, inlet: float, outlet: float) -> Iterator[str]:
    """Warn if an ideal gas is used at pressures at which the real gas is not ideal.

    Nearly ideal gases are checked above 20 bar, all others above 2 bar, because many of them condense.

    Parameters
    ----------
    key : str
        Key of the fluid in a case, for the message.
    fluid : Fluid
        The fluid.
    inlet, outlet : float
        Fluid pressures [Pa].
    """
    if not isinstance(fluid, IdealGas):
        return
    is_high = inlet > _IDEAL_UP_TO
    if not is_high and (is_nearly_ideal(fluid) or inlet <= _NO_GAS_CONDENSES_UP_TO):
        return
    error = ideal_gas_error(fluid, inlet, outlet)
    ends = f"from {to_text(inlet, 'Pa')} to {to_text(outlet, 'Pa')}"
    if not isfinite(error.ratio):
        if is_high or error.name:
            yield f"the leakage of the ideal gas in {key} {ends} has an unknown error: {error.reason}"
    elif is_high or abs(error.ratio - 1) > _IDEAL_WITHIN:
        yield (
            f"the ideal gas in {key} leaks {error.ratio:.3g} times as much {ends} as {error.name}, which it seems to "
            f"be, does by CoolProp: kind = 'real-gas' with name = '{error.name}' takes density and viscosity as they "
            "are"
        )

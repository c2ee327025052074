"""Warn about gases that are not ideal, by comparing an ideal gas with the real gas for which it stands."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from math import isfinite, log, nan
from typing import Any

import numpy as np

from ..base import InputError, to_text
from ..gases import IdealGas, RealGas
from ..named_fluids import (
    FLUID_TABLE,
    TABLE_TEMPERATURE,
    coolprop_state,
    lacks_viscosity_model,
    names_in_coolprop,
)

#: Above this pressure no gas is ideal to good accuracy [Pa].
_IDEAL_UP_TO = 20e5
#: Up to this pressure no common gas condenses at 20 °C [Pa].
_NO_GAS_CONDENSES_UP_TO = 2e5
#: At pressures below `_IDEAL_UP_TO`, a warning is given if the relative error of the leakage exceeds this value.
_IDEAL_WITHIN = 0.05
#: Two gases are taken to be the same if the relative difference of their molar masses is at most this large. Nitrogen
#: and ethylene, the closest pair, differ by 1.5e-3.
_SAME_MASS = 1.3e-3
#: Two gases are taken to be the same if the ratio of their viscosities is at most this large.
_SAME_VISCOSITY = 1.3
#: A pressure at which every gas is ideal [Pa].
_THIN = 1.0
#: Temperature above the critical temperatures of all gases in the table [K]. The highest critical temperature is 191 K,
#: of methane.
_ABOVE_CRITICAL = 200.0


def gas_warnings(key: str, fluid: Any, inlet: float, outlet: float) -> Iterator[str]:
    """Warn if an ideal gas is used at pressures at which the real gas is not ideal.

    For a nearly ideal gas, a warning is given only at inlet pressures above 20 bar. All other gases are checked at
    inlet pressures above 2 bar, because many of these gases condense.

    Parameters
    ----------
    key : str
        Key of the fluid in a case file, which the warning quotes.
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
            f"be: kind = 'real-gas' with name = '{error.name}' takes the true density and viscosity from CoolProp"
        )


@dataclass(frozen=True)
class IdealGasError:
    """Ratio of the ideal-gas leakage to the leakage of the corresponding real gas.

    Parameters
    ----------
    name : str
        Name of the real gas, "" if the real gas is unknown.
    ratio : float
        Leakage of the ideal gas, divided by the leakage of the real gas; NaN if the ratio is unknown.
    reason : str
        Reason why the ratio is unknown, "" if the ratio is known.
    """

    name: str
    ratio: float = nan
    reason: str = ""


def ideal_gas_error(gas: Any, inlet: float, outlet: float) -> IdealGasError:
    """Compute the ratio of the ideal-gas leakage to the leakage of the corresponding real gas.

    The corresponding real gas is the CoolProp fluid with the same molar mass. If several gases have this molar mass,
    the one with the closest viscosity is chosen. If CoolProp has no viscosity for the gas with the closest molar mass,
    the ratio of the leakages is unknown.

    Parameters
    ----------
    gas : IdealGas
        Ideal gas.
    inlet, outlet : float
        Absolute pressures at inlet and outlet [Pa].
    """
    try:
        name = _recognise_gas(gas)  # by molar mass and viscosity
        closest = _closest_in_mass(gas)  # by molar mass alone
    except ImportError:
        missing = (
            "CoolProp, which knows real gases, is not installed (pip install 'femseal[fluids]')"
        )
        return IdealGasError("", reason=missing)
    if name not in FLUID_TABLE and closest and not _has_viscosity(closest):
        reason = (
            f"by its molar mass it is {closest}, of which CoolProp has no viscosity: take density and viscosity at "
            "these pressures from another source"
        )
        return IdealGasError(closest, reason=reason)
    if not name:
        mass = f"a molar mass of {1e3 * gas.molar_mass:.5g} g/mol"
        return IdealGasError("", reason=f"CoolProp has no gas with {mass} and this viscosity")
    try:
        real = RealGas(name, gas.temperature)
        if real.condenses and max(inlet, outlet) > real.highest_pressure:
            limit = to_text(real.highest_pressure, "Pa")
            temperature = f"{gas.temperature - 273.15:.4g} °C"
            reason = (
                f"the gas seems to be {name}, which condenses at {limit} and {temperature} and is then "
                "a liquid"
            )
            return IdealGasError(name, reason=reason)
        real.check_pressure("inlet", inlet)
        real.check_pressure("outlet", outlet)
    except InputError as error:
        return IdealGasError(name, reason=f"the gas seems to be {name}: {error}")
    ideal_drop = gas.potential(inlet) - gas.potential(outlet)
    real_drop = real.potential(inlet) - real.potential(outlet)
    return IdealGasError(name, float(ideal_drop / real_drop) if real_drop else nan)


def is_nearly_ideal(gas: Any) -> bool:
    """Return whether the real gas that an ideal gas stands for behaves almost ideally.

    A gas counts as nearly ideal if its molar mass matches that of a gas in `FLUID_TABLE` and its temperature is above
    the critical temperatures of all gases in `FLUID_TABLE`. Up to 20 bar, the leakage of such a gas is within 2 % of
    the ideal-gas leakage.
    """
    masses = [fluid.parameters.get("molar_mass", 0.0) for fluid in FLUID_TABLE.values()]
    is_in_table = any(abs(gas.molar_mass - mass) <= _SAME_MASS * mass for mass in masses)
    return is_in_table and gas.temperature >= _ABOVE_CRITICAL


def _recognise_gas(gas: Any) -> str:
    """Return the name of the real gas whose molar mass and viscosity match an ideal gas, "" if there is none.

    Gases in `FLUID_TABLE` are identified by their molar mass alone. If none of them matches, the fluids of CoolProp are
    searched; an ImportError is raised if CoolProp is not installed.
    """
    for table_name, fluid in FLUID_TABLE.items():
        mass = fluid.parameters.get("molar_mass", 0.0)
        if abs(gas.molar_mass - mass) <= _SAME_MASS * mass:
            return table_name
    # among the gases with the same molar mass, take the gas with the closest viscosity
    viscosity_differences = {}
    for name in _mass_differences(gas):
        with suppress(InputError, ValueError):
            viscosity = RealGas(name, gas.temperature).viscosity_at(_THIN)
            viscosity_differences[name] = abs(float(np.log(viscosity / gas.viscosity)))
    if not viscosity_differences:
        return ""
    closest = min(viscosity_differences, key=lambda name: viscosity_differences[name])
    return closest if viscosity_differences[closest] <= log(_SAME_VISCOSITY) else ""


def _mass_differences(gas: Any) -> dict[str, float]:
    """Find the CoolProp fluids with nearly the same molar mass as a gas.

    Returns a dictionary that maps the name of each fluid to the relative difference of the two molar masses.
    """
    from CoolProp import CoolProp

    differences = {}
    for name in sorted({*names_in_coolprop().values()}):
        mass = CoolProp.PropsSI("M", name)
        difference = abs(float(gas.molar_mass) - mass) / mass
        if difference <= _SAME_MASS:
            differences[name] = difference
    return differences


def _closest_in_mass(gas: Any) -> str:
    """Return the name of the CoolProp fluid closest to a gas in molar mass, "" if none is close enough."""
    differences = _mass_differences(gas)
    return min(differences, key=lambda name: differences[name], default="")


@cache
def _has_viscosity(name: str) -> bool:
    """Return whether CoolProp can compute the viscosity of a fluid.

    name : name of the fluid in CoolProp, one of the values of `names_in_coolprop`.
    """
    import CoolProp

    state = coolprop_state(name)
    try:
        state.update(CoolProp.PT_INPUTS, _THIN, max(state.Tmin(), TABLE_TEMPERATURE))
        state.viscosity()
    except ValueError as error:
        return not lacks_viscosity_model(error)
    return True

"""Fluids by name: ten common ones at 20 °C from a table, all that CoolProp knows at any temperature.

Gases are ideal, with the viscosity of the mean pressure; liquids have the density and viscosity of the mean pressure.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

from .base import InputError, Pair, shown

#: Temperature of the table, and of named fluids unless given [K].
TABLE_TEMPERATURE = 293.15
#: Pressure of the table [Pa].
TABLE_PRESSURE = 101_325.0


@dataclass(frozen=True)
class NamedFluid:
    """Properties of a fluid in a state, in the keys of a kind of `femseal.fluids`.

    kind : "liquid" or "ideal-gas". parameters : of that kind, in SI.
    """

    kind: str
    parameters: dict[str, float]


def _gas(viscosity: float, molar_mass: float, temperature: float = TABLE_TEMPERATURE) -> NamedFluid:
    found = {"viscosity": viscosity, "molar_mass": molar_mass, "temperature": temperature}
    return NamedFluid("ideal-gas", found)


def _liquid(viscosity: float, density: float) -> NamedFluid:
    return NamedFluid("liquid", {"viscosity": viscosity, "density": density})


#: Fluids at 20 °C and 101 325 Pa, by their name. Values of gases and water equal those of CoolProp 8 to the last digit.
#: Sources: water by the IAPWS formulations of 1995 (density) and 2008 (viscosity); oils by ISO 3448, at 20 °C by ASTM
#: D341 with a viscosity index of about 100, and a density usual for mineral oils; air, nitrogen, oxygen and argon by
#: Lemmon & Jacobsen, Int. J. Thermophys. 25, 2004, 21; helium by Arp, McCarty & Friend, NIST Technical Note 1334, 1998;
#: hydrogen by Muzny, Huber & Kazakov, J. Chem. Eng. Data 58, 2013, 969; methane by Quiñones-Cisneros & Deiters, J.
#: Phys. Chem. B 110, 2006, 12820.
TABLE: dict[str, NamedFluid] = {
    "water": _liquid(1.0016e-3, 998.21),
    "mineral oil ISO VG 32": _liquid(0.0747, 866.0),
    "mineral oil ISO VG 46": _liquid(0.1164, 870.0),
    "air": _gas(18.21e-6, 28.965e-3),
    "nitrogen": _gas(17.57e-6, 28.013e-3),
    "oxygen": _gas(20.27e-6, 31.999e-3),
    "argon": _gas(22.31e-6, 39.948e-3),
    "helium": _gas(19.62e-6, 4.0026e-3),
    "hydrogen": _gas(8.80e-6, 2.0159e-3),
    "methane": _gas(11.04e-6, 16.043e-3),
}

_BY_NAME = {name.casefold(): fluid for name, fluid in TABLE.items()}


def named_fluid(
    name: str,
    temperature: float = TABLE_TEMPERATURE,
    pressures: Pair = (TABLE_PRESSURE, TABLE_PRESSURE),
) -> NamedFluid:
    """Properties of a fluid by its name, from the table at 20 °C and otherwise from CoolProp.

    name : one of `TABLE`, or of CoolProp; upper and lower case are the same.
    temperature : [K]. pressures : at inlet and outlet, absolute [Pa]; with CoolProp the state is that of their mean.

    Raises InputError: an unknown name, a temperature at which the fluid is not known, or changes phase between the
    pressures.
    """
    known = _BY_NAME.get(str(name).casefold())
    if known and abs(temperature - TABLE_TEMPERATURE) < 0.01:
        return known
    properties = known_to_coolprop(name, temperature)
    try:
        low, high = (float(properties.PropsSI(limit, name)) for limit in ("Tmin", "Tmax"))
        if not low <= temperature <= high:
            refuse(
                name,
                temperature,
                f"a temperature from {low - 273.15:.4g} to {high - 273.15:.4g} °C",
            )
        phases = {properties.PhaseSI("T", temperature, "P", max(p, 1.0), name) for p in pressures}
        state = ("T", temperature, "P", max(sum(pressures) / 2, 1.0), name)
        viscosity, density = (float(properties.PropsSI(letter, *state)) for letter in "VD")
        molar_mass = float(properties.PropsSI("M", name))
    except InputError:
        raise
    except ValueError as error:
        refuse(
            name, temperature, f"a fluid and a temperature that CoolProp knows: {shown(str(error))}"
        )
    is_gas = {"gas" in phase or phase == "supercritical" for phase in phases}
    if len(is_gas) > 1 or "twophase" in phases:
        refuse(name, temperature, "a temperature at which it is a gas, or a liquid, at both ends")
    if is_gas == {True}:
        return _gas(viscosity, molar_mass, temperature)
    return _liquid(viscosity, density)


def known_to_coolprop(name: Any, temperature: float, without: str = "") -> Any:
    """The module CoolProp, where it is there and knows the fluid; InputError otherwise."""
    table = ", ".join(TABLE)
    try:
        from CoolProp import CoolProp
    except ImportError:
        allowed = f"one of {table} at 20 °C; any temperature and more fluids after: pip install 'femseal[fluids]'"
        refuse(name, temperature, without or allowed)
    aliases = names_in_coolprop()
    if str(name).casefold() not in aliases:
        if str(name).casefold() in _BY_NAME:
            refuse(
                name,
                temperature,
                "20 °C for a fluid that CoolProp does not know; or its viscosity and density",
            )
        raise InputError(
            "name",
            shown(name),
            f"one of {table}, or a fluid of CoolProp: {', '.join(sorted({*aliases.values()}))}",
        )
    return CoolProp


@cache
def names_in_coolprop() -> dict[str, str]:
    """Fluids of CoolProp by all their names in lower case."""
    from CoolProp import CoolProp

    fluids = CoolProp.get_global_param_string("fluids_list").split(",")
    return {
        alias.casefold(): fluid
        for fluid in fluids
        for alias in (fluid, *CoolProp.get_aliases(fluid))
    }


def refuse(name: Any, temperature: float, allowed: str) -> Any:
    """Raise InputError for a fluid at a temperature [K]."""
    raise InputError("name", f"{shown(name)} at {temperature - 273.15:.4g} °C", allowed)

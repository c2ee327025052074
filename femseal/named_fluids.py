"""Look up the properties of fluids by name, in a table or in CoolProp.

The table `FLUID_TABLE` contains the properties of ten common fluids at 20 °C. For other fluids and other temperatures,
CoolProp computes the density and the viscosity at the mean of inlet and outlet pressure. A named gas is treated as an
ideal gas with a constant viscosity. A named liquid has a constant density and a constant viscosity.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from .base import Array, InputError, Pair, reals, shown
from .base.validate import parameter

#: Temperature of the table of fluids, and default temperature of named fluids [K].
TABLE_TEMPERATURE = 293.15
#: Pressure of the table of fluids [Pa].
TABLE_PRESSURE = 101_325.0


#: Phrases that explain a key of a fluid in a case, whose value the name of the fluid may supply.
WITHOUT_NAME = "without a `name`"
VISCOSITY = 'dynamic viscosity, or kinematic viscosity such as `"46 cSt"` together with a density'


def viscosity_parameter(example: str) -> Any:
    """Declare the parameter `viscosity` of a fluid class, for use in a case file."""
    allowed = "a viscosity > 0"
    return parameter("Pa*s", allowed, example, VISCOSITY, usual=(1e-6, 1e3), needed=WITHOUT_NAME)


@dataclass(frozen=True)
class NamedFluid:
    """Properties of a named fluid, from which `femseal.fluids` makes a liquid or an ideal gas.

    Parameters
    ----------
    kind : str
        Kind of the fluid, "liquid" or "ideal-gas".
    parameters : dict
        Properties of the fluid in SI units, by the names of the parameters of `Liquid` or `IdealGas`.
    """

    kind: str
    parameters: dict[str, float]


def _gas(viscosity: float, molar_mass: float, temperature: float = TABLE_TEMPERATURE) -> NamedFluid:
    """Return the properties of an ideal gas as an entry of `FLUID_TABLE`."""
    parameters = {"viscosity": viscosity, "molar_mass": molar_mass, "temperature": temperature}
    return NamedFluid("ideal-gas", parameters)


def _liquid(viscosity: float, density: float) -> NamedFluid:
    """Return the properties of a liquid as an entry of `FLUID_TABLE`."""
    return NamedFluid("liquid", {"viscosity": viscosity, "density": density})


#: Fluids at 20 °C and 101 325 Pa by name. The values of gases and water agree with CoolProp 8 to the last digit given.
#: Sources: water by the IAPWS formulations of 1995 (density) and 2008 (viscosity); oils by ISO 3448, at 20 °C by ASTM
#: D341 with a viscosity index of about 100, and a density usual for mineral oils; air, nitrogen, oxygen and argon by
#: Lemmon & Jacobsen, Int. J. Thermophys. 25, 2004, 21; helium by Arp, McCarty & Friend, NIST Technical Note 1334, 1998;
#: hydrogen by Muzny, Huber & Kazakov, J. Chem. Eng. Data 58, 2013, 969; methane by Quiñones-Cisneros & Deiters, J.
#: Phys. Chem. B 110, 2006, 12820.
FLUID_TABLE: dict[str, NamedFluid] = {
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

#: Further names of fluids in the table or in CoolProp, in addition to the names that CoolProp knows.
_OTHER_NAMES = {
    "h2o": "water",
    "steam": "water",
    "dry air": "air",
    "compressed air": "air",
    "n2": "nitrogen",
    "gn2": "nitrogen",
    "o2": "oxygen",
    "ar": "argon",
    "he": "helium",
    "h2": "hydrogen",
    "ch4": "methane",
    "ethene": "ethylene",
    "propene": "propylene",
    "fluoroform": "R23",
    "heavy steam": "heavy water",
}
#: Names that mean the vapour of a fluid that is liquid at 20 °C.
_VAPOURS = ("steam", "heavy steam")


def named_fluid(
    name: str,
    temperature: float = TABLE_TEMPERATURE,
    pressures: Pair = (TABLE_PRESSURE, TABLE_PRESSURE),
) -> NamedFluid:
    """Return the properties of a fluid by its name, at 20 °C from `FLUID_TABLE` and otherwise from CoolProp.

    Parameters
    ----------
    name : str
        Name of the fluid in `FLUID_TABLE` or in CoolProp, in upper or lower case.
    temperature : float
        Temperature [K].
    pressures : tuple of two float
        Absolute pressures at inlet and outlet [Pa]. CoolProp computes the properties at the mean of inlet and outlet
        pressure.

    Raises
    ------
    InputError
        The name is unknown, the properties at the temperature are unknown, or the fluid changes phase between inlet and
        outlet pressure.
    """
    is_vapour = _plain_name(name) in map(_plain_name, _VAPOURS)
    if not is_vapour and abs(temperature - TABLE_TEMPERATURE) < 0.01:
        fluid_of_table = _in_table(name)
        if fluid_of_table is not None:
            return fluid_of_table
    coolprop, fluid = _coolprop_and_name(name, temperature)
    try:
        phases = {coolprop.PhaseSI("T", temperature, "P", max(p, 1.0), fluid) for p in pressures}
        mean_pressure = max(sum(pressures) / 2, 1.0)
        state = ("T", temperature, "P", mean_pressure, fluid)
        viscosity = float(coolprop.PropsSI("V", *state))
        density = float(coolprop.PropsSI("D", *state))
        molar_mass = float(coolprop.PropsSI("M", fluid))
    except ValueError as error:
        refuse_unknown(name, temperature, error)
    is_gas_at_each_end = ["gas" in phase or phase == "supercritical" for phase in phases]
    is_gas = all(is_gas_at_each_end)
    changes_phase = any(is_gas_at_each_end) and not is_gas
    if changes_phase or "twophase" in phases:
        _refuse(name, temperature, "a temperature at which it is a gas, or a liquid, at both ends")
    if is_vapour and not is_gas:
        _refuse(
            name, temperature, "a temperature at which it is a gas at both ends: here it is liquid"
        )
    if is_gas:
        return _gas(viscosity, molar_mass, temperature)
    return _liquid(viscosity, density)


def _plain_name(name: object) -> str:
    """Normalise the name of a fluid, so that different spellings compare equal.

    The result is in lower case without spaces, hyphens or underscores, and "sulph" becomes "sulf".
    """
    plain = str(name).casefold().translate(str.maketrans("", "", " -_"))
    return plain.replace("sulph", "sulf")


def _in_table(name: object) -> NamedFluid | None:
    """Find a fluid of `FLUID_TABLE` by any of its names."""
    # replace a further name, such as "N2", by the name in the table
    main_names = {_plain_name(other): main_name for other, main_name in _OTHER_NAMES.items()}
    plain = _plain_name(main_names.get(_plain_name(name), name))
    for table_name, fluid in FLUID_TABLE.items():
        if _plain_name(table_name) == plain:
            return fluid
    return None


def check_name(name: Any, temperature: float) -> None:
    """Raise an InputError if CoolProp is not installed, or does not know a fluid at a temperature [K]."""
    _coolprop_and_name(name, temperature)


def _coolprop_and_name(name: Any, temperature: float) -> tuple[Any, str]:
    """Return the module CoolProp, and the name that CoolProp uses for a fluid.

    Raises an InputError if CoolProp is not installed, does not know the fluid, or has no valid equations for it at this
    temperature [K].
    """
    names_in_table = f"one of {', '.join(FLUID_TABLE)} at 20 °C"
    try:
        from CoolProp import CoolProp
    except ImportError:
        remedy = "other fluids, and real gases, after: pip install 'femseal[fluids]'"
        _refuse(name, temperature, f"{names_in_table}; {remedy}")
    fluid = _name_in_coolprop(name)
    if fluid is None:
        known = ", ".join(sorted({*names_in_coolprop().values()}))
        expected = f"{names_in_table}, or a fluid of CoolProp: {known}"
        if _in_table(name):
            _refuse(name, temperature, expected)
        raise InputError("name", shown(name), expected)
    low, high = coolprop_state(fluid).Tmin(), coolprop_state(fluid).Tmax()
    if not low <= temperature <= high:
        limits = f"a temperature from {low - 273.15:.4g} to {high - 273.15:.4g} °C"
        _refuse(name, temperature, limits)
    return CoolProp, fluid


def _name_in_coolprop(name: object) -> str | None:
    """Return the name that CoolProp uses for a fluid, None if it does not know the fluid.

    For example, the name in CoolProp is "CarbonDioxide" for "CO2", "R-744" and "carbon dioxide".
    """
    return names_in_coolprop().get(_plain_name(name))


@cache
def names_in_coolprop() -> dict[str, str]:
    """Map every known name of a fluid, normalised by `_plain_name`, to its main name in CoolProp."""
    from CoolProp import CoolProp

    names = {}
    for fluid in CoolProp.get_global_param_string("fluids_list").split(","):
        for alias in (fluid, *CoolProp.get_aliases(fluid)):
            names[_plain_name(alias)] = fluid
    further_names = {
        _plain_name(other): names[_plain_name(fluid)]
        for other, fluid in _OTHER_NAMES.items()
        if _plain_name(fluid) in names
    }
    return further_names | names


def _refuse(name: Any, temperature: float, allowed: str) -> NoReturn:
    """Raise an InputError that rejects a fluid at a temperature [K]; `allowed` says what is allowed instead."""
    raise InputError("name", f"{shown(name)} at {temperature - 273.15:.4g} °C", allowed)


def refuse_unknown(name: Any, temperature: float, error: ValueError) -> NoReturn:
    """Raise an InputError for a fluid whose properties CoolProp cannot compute at a temperature [K]."""
    if lacks_viscosity_model(error):
        expected = (
            "a fluid whose viscosity CoolProp knows: for this one it knows only the density. Give the viscosity, "
            "with kind = 'ideal-gas' and molar_mass for a gas, with kind = 'liquid' and density for a liquid"
        )
    else:
        expected = f"a fluid and a temperature that CoolProp knows: {shown(str(error))}"
    _refuse(name, temperature, expected)


def coolprop_state(name: str) -> Any:
    """Create the object with which CoolProp computes states of a gas.

    The object is not cached, because CoolProp prints errors if such an object still exists when the interpreter exits.
    """
    from CoolProp.CoolProp import AbstractState

    return AbstractState("HEOS", names_in_coolprop()[_plain_name(name)])


def density_and_viscosity(
    name: str, temperature: float, pressure: ArrayLike
) -> tuple[Array, Array]:
    """Return density [kg/m³] and viscosity [Pa s] of a gas at pressures > 0 [Pa].

    Raises a ValueError if CoolProp cannot compute the density or the viscosity.
    """
    import CoolProp

    state = coolprop_state(name)
    p = reals(pressure)
    density = np.empty(p.size)
    viscosity = np.empty(p.size)
    for n, value in enumerate(p.ravel()):
        state.update(CoolProp.PT_INPUTS, float(value), temperature)
        density[n] = state.rhomass()
        viscosity[n] = state.viscosity()
    return density.reshape(p.shape), viscosity.reshape(p.shape)


def lacks_viscosity_model(error: ValueError) -> bool:
    """Return whether an error message from CoolProp says that it has no viscosity model for the fluid."""
    return "iscosity model" in str(error)

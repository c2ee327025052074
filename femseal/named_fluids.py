"""Fluids by name: ten common ones at 20 °C from a table, all that CoolProp knows at any temperature; and real gases.

Named gases are ideal, with the viscosity of the mean pressure; liquids have the density and viscosity of the mean
pressure. A real gas is a change of variable as every fluid is, dφ = (ρ/η) dp, from a table of CoolProp's density and
viscosity that is made once for a gas and its temperature. In narrow gaps it flows by Fukui and Kaneko's law with its
own mean free path, which goes with η/ρ.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from math import log, nan, sqrt
from typing import Any, ClassVar, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from .base import Array, InputError, Pair, reals, shown, to_text
from .base.leak_rates import GAS_CONSTANT, STANDARD_PRESSURE
from .base.validate import check_parameters, described, parameter
from .flow.law import CUBIC_LAW, FlowLaw, FukuiKaneko

#: Temperature of the table, and of named fluids unless given [K].
TABLE_TEMPERATURE = 293.15
#: Pressure of the table [Pa].
TABLE_PRESSURE = 101_325.0
#: Relative error of the potential, by that of its slope in the middle of two points of the table, up to which no point
#: is added there.
_ERROR = 1e-7
#: First pressure of the table above 0 [Pa], and the number of points with which it begins.
_FIRST_PRESSURE, _FEWEST = 1e5, 33
#: Highest pressure of tables [Pa]: no seal carries more, and equations of state are extrapolated there.
_HIGHEST = 1e9
#: Largest relative distance of a molar mass by which a gas is known; ethylene is at 1.5e-3 of nitrogen. Of several, the
#: gas whose viscosity differs least is taken, by at most this factor. Pressure of a thin gas [Pa].
_SAME_MASS, _SAME_VISCOSITY, _THIN = 1.3e-3, 1.3, 1.0
#: Temperature [K] above the critical ones of all gases of the table, the highest of which is that of methane.
_ABOVE_CRITICAL = 200.0
#: The slope of a potential is 0 at no pressure, where it does not count [s/m²].
_LEAST_SLOPE = 1e-200


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

#: Other names, beside those of CoolProp: of a fluid of the table, or of CoolProp.
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
#: Names of fluids that are gases, although the fluid is a liquid at 20 °C.
_VAPOURS = {"steam": "water", "heavy steam": "heavy water"}


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
    vapour = _plain_name(name) in map(_plain_name, _VAPOURS)
    known = None if vapour else _in_table(name)
    if known and abs(temperature - TABLE_TEMPERATURE) < 0.01:
        return known
    properties, fluid = _known_to_coolprop(name, temperature)
    try:
        phases = {properties.PhaseSI("T", temperature, "P", max(p, 1.0), fluid) for p in pressures}
        state = ("T", temperature, "P", max(sum(pressures) / 2, 1.0), fluid)
        viscosity, density = (float(properties.PropsSI(letter, *state)) for letter in "VD")
        molar_mass = float(properties.PropsSI("M", fluid))
    except ValueError as error:
        _refuse_unknown(name, temperature, error)
    is_gas = {"gas" in phase or phase == "supercritical" for phase in phases}
    if len(is_gas) > 1 or "twophase" in phases:
        _refuse(name, temperature, "a temperature at which it is a gas, or a liquid, at both ends")
    if vapour and is_gas != {True}:
        _refuse(
            name, temperature, "a temperature at which it is a gas at both ends: here it is liquid"
        )
    if is_gas == {True}:
        return _gas(viscosity, molar_mass, temperature)
    return _liquid(viscosity, density)


def _plain_name(name: object) -> str:
    """Write the name of a fluid without capitals, spaces and hyphens, and in American English."""
    plain = str(name).casefold().translate(str.maketrans("", "", " -_"))
    return plain.replace("sulph", "sulf")


def _in_table(name: object) -> NamedFluid | None:
    """Find a fluid of `TABLE` by any of its names."""
    meant = {_plain_name(other): fluid for other, fluid in _OTHER_NAMES.items()}
    plain = _plain_name(meant.get(_plain_name(name), name))
    return next((fluid for known, fluid in TABLE.items() if _plain_name(known) == plain), None)


def _known_to_coolprop(name: Any, temperature: float) -> tuple[Any, str]:
    """The module CoolProp, and its own name of a fluid that it knows at the temperature [K]; InputError otherwise."""
    table = f"one of {', '.join(TABLE)} at 20 °C"
    try:
        from CoolProp import CoolProp
    except ImportError:
        others = "others, and real gases, after: pip install 'femseal[fluids]'"
        _refuse(name, temperature, f"{table}; {others}")
    fluid = _name_in_coolprop(name)
    if fluid is None:
        known = ", ".join(sorted({*_names_in_coolprop().values()}))
        expected = f"{table}, or a fluid of CoolProp: {known}"
        if _in_table(name):
            _refuse(name, temperature, expected)
        raise InputError("name", shown(name), expected)
    low, high = _state(fluid).Tmin(), _state(fluid).Tmax()
    if not low <= temperature <= high:
        known = f"a temperature from {low - 273.15:.4g} to {high - 273.15:.4g} °C"
        _refuse(name, temperature, known)
    return CoolProp, fluid


def _name_in_coolprop(name: object) -> str | None:
    """CoolProp's own name of a fluid, such as "CarbonDioxide" of "CO2", "R-744" and "carbon dioxide"."""
    return _names_in_coolprop().get(_plain_name(name))


@cache
def _names_in_coolprop() -> dict[str, str]:
    """Fluids of CoolProp by all their names as `_plain_name` writes them."""
    from CoolProp import CoolProp

    fluids = CoolProp.get_global_param_string("fluids_list").split(",")
    names = {
        _plain_name(alias): fluid
        for fluid in fluids
        for alias in (fluid, *CoolProp.get_aliases(fluid))
    }
    others = {
        _plain_name(other): names[_plain_name(fluid)]
        for other, fluid in _OTHER_NAMES.items()
        if _plain_name(fluid) in names
    }
    return others | names


def _refuse(name: Any, temperature: float, allowed: str) -> NoReturn:
    """Raise InputError for a fluid at a temperature [K]."""
    raise InputError("name", f"{shown(name)} at {temperature - 273.15:.4g} °C", allowed)


def _refuse_unknown(name: Any, temperature: float, error: ValueError) -> NoReturn:
    """Raise InputError for a fluid at a temperature [K] of which CoolProp fails to give the properties."""
    if "iscosity model" in str(error):
        otherwise = (
            "give viscosity and molar_mass of an ideal gas, or viscosity and density of a liquid"
        )
        _refuse(name, temperature, f"a fluid whose viscosity CoolProp knows; otherwise {otherwise}")
    _refuse(
        name, temperature, f"a fluid and a temperature that CoolProp knows: {shown(str(error))}"
    )


@dataclass(frozen=True)
class DenseGasSlip(FukuiKaneko):
    """Fukui and Kaneko's law with the mean free path of a real gas: D = h ρ √(2R_sT)/2η.

    viscosity : η of the thin gas [Pa s]. speed : √(2R_sT) [m/s]. gas : whose ρ/η counts at every pressure.
    """

    gas: RealGas

    def inverse_knudsen(self, gap: ArrayLike, pressure: ArrayLike) -> Array:
        """D = h ρ √(2R_sT)/2η."""
        return 0.5 * self.speed * reals(gap) * self.gas.slope(pressure)


def temperature_of_gas(**more: Any) -> Any:
    """The parameter `temperature` of a gas; more : as `parameter` takes it."""
    allowed = "a temperature above absolute zero, such as '20 °C'"
    return parameter("K", allowed, "of the gas", usual=(2.0, 2000.0), **more)


def slip_of_gas() -> Any:
    """The parameter `slip` of a gas."""
    meaning = "slip and free molecular flow in narrow gaps"
    return described(meaning, default=True)


class Gas:
    """What gases of a temperature, a molar mass and a choice of slip have in common."""

    #: Outlet pressure of a case that gives none [Pa], absolute.
    outlet_pressure: ClassVar[float] = STANDARD_PRESSURE
    #: Pressure at which volumes are stated [Pa], absolute; their temperature is the gas's own.
    reference_pressure: ClassVar[float] = STANDARD_PRESSURE

    def __post_init__(self: Any) -> None:
        check_parameters(self)
        if not isinstance(self.slip, bool):
            raise InputError("slip", repr(self.slip), "True or False")

    @property
    def speed(self: Any) -> float:
        """√(2R_sT) of the molecules [m/s]."""
        return sqrt(2 * GAS_CONSTANT * self.temperature / self.molar_mass)

    @property
    def reference_density(self: Any) -> float:
        """Density of the ideal gas at 101 325 Pa [kg/m³]."""
        return STANDARD_PRESSURE * float(self.molar_mass) / (GAS_CONSTANT * float(self.temperature))


@dataclass(frozen=True)
class RealGas(Gas):
    """A gas by its name, isothermal, with density and viscosity of CoolProp: φ = ∫ρ/η dp within 1e-6.

    Volume rates are stated as those of an ideal gas of its molar mass at 101 325 Pa and its own temperature, so that
    pressure × volume and standard volumes count molecules. Needs `pip install 'femseal[fluids]'`.

    Parameters
    ----------
    name : as CoolProp knows it, such as "nitrogen"; upper and lower case are the same.
    temperature : T [K].
    slip : whether the flow factor of rarefied gases counts; it tends to 1 at high pressure.

    Raises
    ------
    InputError : CoolProp is not installed, or does not know the gas, its viscosity, or the temperature.
    """

    kind: ClassVar[str] = "real-gas"
    name: str = described("a gas as CoolProp knows it", example="nitrogen")
    temperature: float = temperature_of_gas(default=TABLE_TEMPERATURE)
    slip: bool = slip_of_gas()

    def __post_init__(self) -> None:
        super().__post_init__()
        _known_to_coolprop(self.name, self.temperature)
        _table(self.name, self.temperature)

    @property
    def molar_mass(self) -> float:
        """M [kg/mol]."""
        return _table(self.name, self.temperature).molar_mass

    @property
    def law(self) -> FlowLaw:
        """Fukui and Kaneko's law with the mean free path of the gas, or the cubic one without slip."""
        if not self.slip:
            return CUBIC_LAW
        return DenseGasSlip(float(self.viscosity_at(1.0)), self.speed, self)

    @property
    def highest_pressure(self) -> float:
        """Pressure [Pa] of saturation, or up to which CoolProp knows the gas, at most 1 GPa."""
        return float(_table(self.name, self.temperature).pressures[-1])

    @property
    def condenses(self) -> bool:
        """Whether the gas condenses at `highest_pressure`."""
        return _table(self.name, self.temperature).saturates

    def density_at(self, pressure: ArrayLike) -> Array:
        """Density ρ(p) [kg/m³] by CoolProp, at pressures > 0."""
        return _properties(self.name, self.temperature, pressure)[0]

    def viscosity_at(self, pressure: ArrayLike) -> Array:
        """Viscosity η(p) [Pa s] by CoolProp, at pressures > 0."""
        return _properties(self.name, self.temperature, pressure)[1]

    def slope(self, pressure: ArrayLike) -> Array:
        """dφ/dp = ρ/η [s/m²] of the table; p is absolute."""
        return _table(self.name, self.temperature).slope(pressure)

    def potential(self, pressure: ArrayLike) -> Array:
        """Pressure potential φ(p) of the viscous flow [kg/(m³ s)]; p is absolute, see `check_pressure`."""
        return _table(self.name, self.temperature).potential(pressure)

    def pressure(self, potential: ArrayLike) -> Array:
        """Inverse of `potential` [Pa], absolute, by Newton's method."""
        table, φ = _table(self.name, self.temperature), reals(potential)
        # φ goes with p² in a thin gas
        start = np.interp(np.sqrt(φ), np.sqrt(table.potential(table.pressures)), table.pressures)
        return with_potential(
            φ, start, table.potential, lambda p: np.maximum(table.slope(p), _LEAST_SLOPE)
        )

    def check_pressure(self, name: str, pressure: float) -> None:
        """Raise InputError if it is no gas at a pressure [Pa] that is called `name`, or CoolProp does not know it."""
        if not 0 <= pressure <= self.highest_pressure:
            at = f"{self.temperature - 273.15:.4g} °C"
            limit = to_text(self.highest_pressure, "Pa")
            expected = f"at most {limit}, absolute, up to which CoolProp knows {self.name} at {at}"
            if self.condenses:
                expected = f"less than {limit}, absolute, at which {self.name} condenses at {at}"
            raise InputError(name, to_text(pressure, "Pa"), expected)


def with_potential(
    potentials: Array, start: Array, potential: Callable[..., Any], slope: Callable[..., Any]
) -> Array:
    """Pressures [Pa] that have potentials, by Newton's method; inf where no pressure has one."""
    p = start
    with np.errstate(all="ignore"):  # a potential beyond the limit
        for _ in range(100):
            step = (potentials - potential(p)) / slope(p)
            p = p + step
            if not np.any(np.abs(step) > 1e-13 * np.abs(p)):
                break
    return p


class _Table(NamedTuple):
    """Rising pressures [Pa] from 0 on, splines of the potential [kg/(m³ s)] and its slope over them; M [kg/mol]."""

    pressures: Array
    potential: Any
    slope: Any
    saturates: bool
    molar_mass: float


def _state(name: str) -> Any:
    """The gas in CoolProp; it is not kept, as CoolProp complains of what is left when the interpreter ends."""
    from CoolProp.CoolProp import AbstractState

    return AbstractState("HEOS", _names_in_coolprop()[_plain_name(name)])


def _properties(name: str, temperature: float, pressure: ArrayLike) -> tuple[Array, Array]:
    """Density [kg/m³] and viscosity [Pa s] of the gas at pressures > 0 [Pa]; ValueError where CoolProp has none."""
    import CoolProp

    state, p = _state(name), reals(pressure)
    found = np.empty((2, p.size))
    for n, each in enumerate(p.ravel()):
        state.update(CoolProp.PT_INPUTS, float(each), temperature)
        found[:, n] = state.rhomass(), state.viscosity()
    return found[0].reshape(p.shape), found[1].reshape(p.shape)


@cache
def _table(name: str, temperature: float) -> _Table:
    """The potential of a gas at a temperature [K], the integral of a spline of its slope.

    Points are added until the spline is right between them; it ends at saturation, or where CoolProp knows no more.
    """
    import CoolProp
    from scipy.interpolate import CubicSpline

    def slopes(pressure: ArrayLike) -> Array:
        density, viscosity = _properties(name, temperature, pressure)
        return density / viscosity

    state = _state(name)
    limit, saturates = min(state.pmax(), _HIGHEST), temperature < state.T_critical()
    if saturates:
        state.update(CoolProp.QT_INPUTS, 1.0, temperature)
        limit = (1 - 1e-6) * state.p()
    while True:
        try:
            slopes(limit)
            break
        except ValueError as failure:
            limit, saturates = 0.5 * limit, False
            if limit < _FIRST_PRESSURE:
                _refuse_unknown(name, temperature, failure)
    first = min(_FIRST_PRESSURE, 0.5 * limit)
    pressures = np.append(0.0, np.geomspace(first, limit, _FEWEST))
    known = np.append(0.0, slopes(pressures[1:]))
    wrong = np.zeros(1, int)
    while wrong.size:
        slope = CubicSpline(pressures, known)
        potential = slope.antiderivative()
        middle = 0.5 * (pressures[1:] + pressures[:-1])
        found = slopes(middle)
        error = np.abs(slope(middle) - found) * np.diff(pressures) / potential(middle)
        wrong = np.flatnonzero(error > _ERROR)
        pressures = np.insert(pressures, wrong + 1, middle[wrong])
        known = np.insert(known, wrong + 1, found[wrong])
    return _Table(pressures, potential, slope, saturates, float(state.molar_mass()))


@dataclass(frozen=True)
class IdealGasError:
    """How far the leakage of an ideal gas is off that of the real gas that it stands for.

    name : of the real gas, "" where it is unknown. ratio : leakage of the ideal gas over that of the real one, NaN
    where it is unknown. reason : why it is unknown, "" otherwise.
    """

    name: str
    ratio: float = nan
    reason: str = ""


def ideal_gas_error(gas: Any, inlet: float, outlet: float) -> IdealGasError:
    """Compare the leakage of an ideal gas between two pressures [Pa] with that of the real gas, by CoolProp.

    The real gas is recognised by its molar mass, and of several by its viscosity.
    """
    try:
        name = _recognised(gas)
    except ImportError:
        missing = (
            "CoolProp, which knows real gases, is not installed (pip install 'femseal[fluids]')"
        )
        return IdealGasError("", reason=missing)
    if not name:
        mass = f"a molar mass of {1e3 * gas.molar_mass:.5g} g/mol"
        return IdealGasError("", reason=f"CoolProp has no gas with {mass} and this viscosity")
    try:
        real = RealGas(name, gas.temperature)
        if real.condenses and max(inlet, outlet) > real.highest_pressure:
            limit = to_text(real.highest_pressure, "Pa")
            at = f"{gas.temperature - 273.15:.4g} °C"
            liquid = (
                f"it seems to be {name}, which condenses at {limit} and {at}, and is a liquid then"
            )
            return IdealGasError(name, reason=liquid)
        for end, pressure in (("inlet", inlet), ("outlet", outlet)):
            real.check_pressure(end, pressure)
    except InputError as error:
        return IdealGasError(name, reason=f"it seems to be {name}, and of that {error}")
    ideal_drop, drop = (g.potential(inlet) - g.potential(outlet) for g in (gas, real))
    return IdealGasError(name, float(ideal_drop / drop) if drop else nan)


def is_nearly_ideal(gas: Any) -> bool:
    """Whether an ideal gas stands for one of the table, well above its boiling point: ideal within 2 % up to 20 bar."""
    masses = [fluid.parameters.get("molar_mass", 0.0) for fluid in TABLE.values()]
    known = any(abs(gas.molar_mass - mass) <= _SAME_MASS * mass for mass in masses)
    return known and gas.temperature >= _ABOVE_CRITICAL


def _recognised(gas: Any) -> str:
    """Name of the gas that an ideal gas stands for, "" if CoolProp has none. Raises ImportError without CoolProp."""
    from CoolProp import CoolProp

    def is_same(mass: float) -> bool:
        return abs(gas.molar_mass - mass) <= _SAME_MASS * mass

    for name, known in TABLE.items():
        if is_same(known.parameters.get("molar_mass", 0.0)):
            return name
    distances = {}
    for name in sorted({*_names_in_coolprop().values()}):
        if is_same(CoolProp.PropsSI("M", name)):
            with suppress(InputError, ValueError):
                viscosity = RealGas(name, gas.temperature).viscosity_at(_THIN)
                distances[name] = abs(float(np.log(viscosity / gas.viscosity)))
    name = min(distances, key=lambda name: distances[name], default="")
    return name if name and distances[name] <= log(_SAME_VISCOSITY) else ""

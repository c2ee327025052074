"""Look up the properties of fluids by name, and describe real gases.

The table `TABLE` contains the properties of ten common fluids at 20 °C. For other fluids and other temperatures,
CoolProp computes the density and the viscosity at the mean of inlet and outlet pressure. A named gas is treated as an
ideal gas with a constant viscosity. A named liquid has a constant density and a constant viscosity.

The pressure potential of a real gas is φ = ∫ρ/η dp, with the density ρ and the viscosity η from CoolProp. The potential
is tabulated once for each gas and temperature. In narrow gaps, the flow follows the law of Fukui and Kaneko. The mean
free path in this law is that of the real gas, proportional to η/ρ.
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

#: Temperature of the table of fluids, and default temperature of named fluids [K].
TABLE_TEMPERATURE = 293.15
#: Pressure of the table of fluids [Pa].
TABLE_PRESSURE = 101_325.0
#: Relative error of the potential of a real gas above which a point is added to its table.
_ERROR = 1e-7
#: Lowest pressure above 0 in the table of a real gas [Pa].
_FIRST_PRESSURE = 1e5
#: Number of pressures above 0 in the first table of a real gas, before points are added.
_FEWEST = 33
#: Highest pressure in the table of a real gas [Pa]. No seal carries a higher pressure, and equations of state are not
#: valid at higher pressures.
_HIGHEST = 1e9
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
#: Smallest slope dφ/dp of a potential by which is divided [s/m²], because the slope at zero pressure is 0.
_LEAST_SLOPE = 1e-200


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
    """Return the properties of an ideal gas as an entry of `TABLE`."""
    parameters = {"viscosity": viscosity, "molar_mass": molar_mass, "temperature": temperature}
    return NamedFluid("ideal-gas", parameters)


def _liquid(viscosity: float, density: float) -> NamedFluid:
    """Return the properties of a liquid as an entry of `TABLE`."""
    return NamedFluid("liquid", {"viscosity": viscosity, "density": density})


#: Fluids at 20 °C and 101 325 Pa by name. The values of gases and water agree with CoolProp 8 to the last digit given.
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
_VAPOURS = {"steam": "water", "heavy steam": "heavy water"}


def named_fluid(
    name: str,
    temperature: float = TABLE_TEMPERATURE,
    pressures: Pair = (TABLE_PRESSURE, TABLE_PRESSURE),
) -> NamedFluid:
    """Return the properties of a fluid by its name, at 20 °C from `TABLE` and otherwise from CoolProp.

    Parameters
    ----------
    name : str
        Name of the fluid in `TABLE` or in CoolProp, in upper or lower case.
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
        _refuse_unknown(name, temperature, error)
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
    """Find a fluid of `TABLE` by any of its names."""
    # replace a further name, such as "N2", by the name in the table
    main_names = {_plain_name(other): main_name for other, main_name in _OTHER_NAMES.items()}
    plain = _plain_name(main_names.get(_plain_name(name), name))
    for table_name, fluid in TABLE.items():
        if _plain_name(table_name) == plain:
            return fluid
    return None


def _coolprop_and_name(name: Any, temperature: float) -> tuple[Any, str]:
    """Return the module CoolProp, and the name that CoolProp uses for a fluid.

    Raises an InputError if CoolProp is not installed, does not know the fluid, or has no valid equations for it at this
    temperature [K].
    """
    names_in_table = f"one of {', '.join(TABLE)} at 20 °C"
    try:
        from CoolProp import CoolProp
    except ImportError:
        remedy = "others, and real gases, after: pip install 'femseal[fluids]'"
        _refuse(name, temperature, f"{names_in_table}; {remedy}")
    fluid = _name_in_coolprop(name)
    if fluid is None:
        known = ", ".join(sorted({*_names_in_coolprop().values()}))
        expected = f"{names_in_table}, or a fluid of CoolProp: {known}"
        if _in_table(name):
            _refuse(name, temperature, expected)
        raise InputError("name", shown(name), expected)
    low, high = _state(fluid).Tmin(), _state(fluid).Tmax()
    if not low <= temperature <= high:
        limits = f"a temperature from {low - 273.15:.4g} to {high - 273.15:.4g} °C"
        _refuse(name, temperature, limits)
    return CoolProp, fluid


def _name_in_coolprop(name: object) -> str | None:
    """Return the name that CoolProp uses for a fluid, None if it does not know the fluid.

    For example, the name in CoolProp is "CarbonDioxide" for "CO2", "R-744" and "carbon dioxide".
    """
    return _names_in_coolprop().get(_plain_name(name))


@cache
def _names_in_coolprop() -> dict[str, str]:
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


def _refuse_unknown(name: Any, temperature: float, error: ValueError) -> NoReturn:
    """Raise an InputError for a fluid whose properties CoolProp cannot compute at a temperature [K]."""
    if _means_no_viscosity(error):
        expected = (
            "a fluid of which CoolProp has the viscosity: of this one it has the density alone. Give the viscosity, "
            "with kind = 'ideal-gas' and molar_mass for a gas, with kind = 'liquid' and density for a liquid"
        )
    else:
        expected = f"a fluid and a temperature that CoolProp knows: {shown(str(error))}"
    _refuse(name, temperature, expected)


@dataclass(frozen=True)
class DenseGasSlip(FukuiKaneko):
    """Describe the flow law of Fukui and Kaneko with the mean free path of a real gas.

    The inverse Knudsen number of a gap h is D = h ρ √(2R_sT)/2η, with the density ρ and the viscosity η at the local
    pressure, the specific gas constant R_s and the temperature T.

    Parameters
    ----------
    viscosity : float
        Viscosity η of the gas at low pressure [Pa s].
    speed : float
        Molecular speed √(2R_sT) [m/s].
    gas : RealGas
        Real gas, whose ratio ρ/η determines the mean free path at every pressure.
    """

    gas: RealGas

    def inverse_knudsen(self, gap: ArrayLike, pressure: ArrayLike) -> Array:
        """Return the inverse Knudsen number D = h ρ √(2R_sT)/2η."""
        return 0.5 * self.speed * reals(gap) * self.gas.slope(pressure)


def temperature_of_gas(**more: Any) -> Any:
    """Return the declaration of the field `temperature` of a gas class; `more` is passed on to `parameter`."""
    allowed = "a temperature above absolute zero, such as '20 °C'"
    return parameter("K", allowed, "temperature of the gas", usual=(2.0, 2000.0), **more)


def slip_of_gas() -> Any:
    """Return the declaration of the field `slip` of a gas class."""
    meaning = "whether slip and free molecular flow in narrow gaps are taken into account"
    return described(meaning, default=True)


class Gas:
    """Base class of all gases. A subclass has the attributes `temperature`, `molar_mass` and `slip`."""

    #: Default outlet pressure of a case, absolute [Pa].
    outlet_pressure: ClassVar[float] = STANDARD_PRESSURE
    #: Absolute pressure at which volumes of a gas are given [Pa]. The volumes are given at the temperature of the gas.
    reference_pressure: ClassVar[float] = STANDARD_PRESSURE

    def __post_init__(self: Any) -> None:
        check_parameters(self)
        if not isinstance(self.slip, bool):
            raise InputError("slip", repr(self.slip), "True or False")

    @property
    def speed(self: Any) -> float:
        """Molecular speed √(2R_sT) [m/s]."""
        return sqrt(2 * GAS_CONSTANT * self.temperature / self.molar_mass)

    @property
    def reference_density(self: Any) -> float:
        """Density of the ideal gas at 101 325 Pa [kg/m³]."""
        return STANDARD_PRESSURE * float(self.molar_mass) / (GAS_CONSTANT * float(self.temperature))


@dataclass(frozen=True)
class RealGas(Gas):
    """Describe an isothermal real gas by its name, with density and viscosity from CoolProp.

    The potential φ = ∫ρ/η dp has a relative error of at most 1e-6. Volume flow rates are ideal-gas equivalents: the
    volume flow of an ideal gas of the same molar mass and mass flow rate, at 101 325 Pa and the temperature of the gas.
    By this convention, volume flow rates and throughputs are proportional to the number of molecules. CoolProp is
    required (`pip install 'femseal[fluids]'`).

    Parameters
    ----------
    name : str
        Name of the gas in CoolProp, such as "nitrogen", in upper or lower case.
    temperature : float
        Temperature T [K].
    slip : bool
        Whether slip and free molecular flow in narrow gaps are taken into account. Slip and free molecular flow vanish
        at high pressure.

    Raises
    ------
    InputError
        CoolProp is not installed, or does not know the gas, its viscosity, or the temperature.
    """

    kind: ClassVar[str] = "real-gas"
    name: str = described("name of the gas in CoolProp", example="nitrogen")
    temperature: float = temperature_of_gas(default=TABLE_TEMPERATURE)
    slip: bool = slip_of_gas()

    def __post_init__(self) -> None:
        super().__post_init__()
        _coolprop_and_name(self.name, self.temperature)
        _table(self.name, self.temperature)

    @property
    def molar_mass(self) -> float:
        """Molar mass M [kg/mol]."""
        return _table(self.name, self.temperature).molar_mass

    @property
    def law(self) -> FlowLaw:
        """Flow law of Fukui and Kaneko with the mean free path of the real gas, or the cubic law if slip is ignored."""
        if not self.slip:
            return CUBIC_LAW
        return DenseGasSlip(float(self.viscosity_at(1.0)), self.speed, self)

    @property
    def highest_pressure(self) -> float:
        """Highest pressure at which the properties are known and the fluid is a gas [Pa], at most 1 GPa.

        The highest pressure is the saturation pressure if the gas condenses at its temperature.
        """
        return float(_table(self.name, self.temperature).pressures[-1])

    @property
    def condenses(self) -> bool:
        """Whether the gas condenses at the pressure `highest_pressure`."""
        return _table(self.name, self.temperature).saturates

    def density_at(self, pressure: ArrayLike) -> Array:
        """Return the density ρ(p) [kg/m³] from CoolProp at absolute pressures > 0."""
        return _properties(self.name, self.temperature, pressure)[0]

    def viscosity_at(self, pressure: ArrayLike) -> Array:
        """Return the viscosity η(p) [Pa s] from CoolProp at absolute pressures > 0."""
        return _properties(self.name, self.temperature, pressure)[1]

    def slope(self, pressure: ArrayLike) -> Array:
        """Return dφ/dp = ρ/η [s/m²] from the table at absolute pressures."""
        return _table(self.name, self.temperature).slope(pressure)

    def potential(self, pressure: ArrayLike) -> Array:
        """Return the pressure potential φ(p) of viscous flow [kg/(m³ s)] at absolute pressures."""
        return _table(self.name, self.temperature).potential(pressure)

    def pressure(self, potential: ArrayLike) -> Array:
        """Return the absolute pressures [Pa] at which the potential has the given values, by Newton's method."""
        table = _table(self.name, self.temperature)
        φ = reals(potential)

        def slope(p: Array) -> Array:
            """Return dφ/dp, and a tiny number in place of 0, because Newton's method divides by the slope."""
            return np.maximum(table.slope(p), _LEAST_SLOPE)

        # at low pressure φ is proportional to p², so that p is nearly linear in √φ
        start = np.interp(np.sqrt(φ), np.sqrt(table.potential(table.pressures)), table.pressures)
        return solve_for_pressure(φ, start, table.potential, slope)

    def check_pressure(self, name: str, pressure: float) -> None:
        """Raise an InputError unless the fluid is a gas with known properties at a pressure.

        Parameters
        ----------
        name : str
            Name of the pressure in the error message, such as "inlet".
        pressure : float
            Absolute pressure [Pa].
        """
        if 0 <= pressure <= self.highest_pressure:
            return
        temperature = f"{self.temperature - 273.15:.4g} °C"
        limit = to_text(self.highest_pressure, "Pa")
        if self.condenses:
            expected = (
                f"less than {limit}, absolute, at which {self.name} condenses at {temperature}"
            )
        else:
            expected = f"at most {limit}, absolute, up to which CoolProp knows {self.name} at {temperature}"
        raise InputError(name, to_text(pressure, "Pa"), expected)


def solve_for_pressure(
    potentials: Array, start: Array, potential: Callable[..., Any], slope: Callable[..., Any]
) -> Array:
    """Solve φ(p) = potential for the pressures p by Newton's method.

    Parameters
    ----------
    potentials : array
        Potentials [kg/(m³ s)].
    start : array
        Initial guess of the pressure for each potential [Pa].
    potential : callable
        Potential φ(p) of a fluid.
    slope : callable
        Derivative dφ/dp of the potential φ(p).

    Returns
    -------
    array
        Pressures [Pa]; inf where there is no solution.
    """
    p = start
    # without a solution the iteration diverges to inf
    with np.errstate(all="ignore"):
        for _ in range(100):
            step = (potentials - potential(p)) / slope(p)
            p = p + step
            if not np.any(np.abs(step) > 1e-13 * np.abs(p)):
                break
    return p


class _Table(NamedTuple):
    """Tabulated potential of a real gas.

    Attributes
    ----------
    pressures : pressures in the table [Pa], in increasing order from 0.
    potential : spline of the potential φ(p) [kg/(m³ s)].
    slope : spline of dφ/dp = ρ/η [s/m²].
    saturates : whether the gas condenses at the last pressure of the table.
    molar_mass : molar mass of the gas [kg/mol].
    """

    pressures: Array
    potential: Any
    slope: Any
    saturates: bool
    molar_mass: float


def _state(name: str) -> Any:
    """Create the object with which CoolProp computes states of a gas.

    The object is not cached, because CoolProp prints errors if such an object still exists when the interpreter exits.
    """
    from CoolProp.CoolProp import AbstractState

    return AbstractState("HEOS", _names_in_coolprop()[_plain_name(name)])


def _properties(name: str, temperature: float, pressure: ArrayLike) -> tuple[Array, Array]:
    """Return density [kg/m³] and viscosity [Pa s] of a gas at pressures > 0 [Pa].

    Raises a ValueError if CoolProp cannot compute the density or the viscosity.
    """
    import CoolProp

    state = _state(name)
    p = reals(pressure)
    density = np.empty(p.size)
    viscosity = np.empty(p.size)
    for n, value in enumerate(p.ravel()):
        state.update(CoolProp.PT_INPUTS, float(value), temperature)
        density[n] = state.rhomass()
        viscosity[n] = state.viscosity()
    return density.reshape(p.shape), viscosity.reshape(p.shape)


@cache
def _table(name: str, temperature: float) -> _Table:
    """Tabulate the potential of a gas at a temperature [K].

    A cubic spline interpolates the slope dφ/dp = ρ/η. The integral of this spline is the potential φ. Midway between
    neighbouring pressures of the table, the interpolated slope is checked against the exact slope. Where the error is
    too large, the midpoint is added to the table. This is repeated until all errors are small enough.
    """
    from scipy.interpolate import CubicSpline

    def exact_slope(pressure: ArrayLike) -> Array:
        """Return ρ/η from CoolProp."""
        density, viscosity = _properties(name, temperature, pressure)
        return density / viscosity

    limit, saturates = _highest_pressure(name, temperature)
    first = min(_FIRST_PRESSURE, 0.5 * limit)
    pressures = np.append(0.0, np.geomspace(first, limit, _FEWEST))
    slopes = np.append(0.0, exact_slope(pressures[1:]))
    while True:
        slope = CubicSpline(pressures, slopes)
        potential = slope.antiderivative()
        middles = 0.5 * (pressures[1:] + pressures[:-1])
        exact = exact_slope(middles)
        # error of the slope times the width of the interval, relative to the potential
        error = np.abs(slope(middles) - exact) * np.diff(pressures) / potential(middles)
        coarse = np.flatnonzero(error > _ERROR)  # intervals to be halved
        if not coarse.size:
            molar_mass = float(_state(name).molar_mass())
            return _Table(pressures, potential, slope, saturates, molar_mass)
        pressures = np.insert(pressures, coarse + 1, middles[coarse])
        slopes = np.insert(slopes, coarse + 1, exact[coarse])


def _highest_pressure(name: str, temperature: float) -> tuple[float, bool]:
    """Return the highest tabulated pressure of a gas, and whether the gas condenses there.

    Below the critical temperature, the highest pressure of the table is the saturation pressure [Pa]. Above the
    critical temperature, the table ends at the highest pressure for which CoolProp has an equation of state, but at 1
    GPa at most. The highest pressure is halved until CoolProp can compute density and viscosity there.
    """
    import CoolProp

    state = _state(name)
    limit = min(state.pmax(), _HIGHEST)
    saturates = temperature < state.T_critical()
    if saturates:
        state.update(CoolProp.QT_INPUTS, 1.0, temperature)
        limit = (1 - 1e-6) * state.p()  # just below saturation
    while True:
        try:
            _properties(name, temperature, limit)
            return limit, saturates
        except ValueError as error:
            limit = 0.5 * limit
            saturates = False
            if limit < _FIRST_PRESSURE:
                _refuse_unknown(name, temperature, error)


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
    if name not in TABLE and closest and not _has_viscosity(closest):
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

    A gas counts as nearly ideal if its molar mass matches that of a gas in `TABLE` and its temperature is above the
    critical temperatures of all gases in `TABLE`. Up to 20 bar, the leakage of such a gas is within 2 % of the
    ideal-gas leakage.
    """
    masses = [fluid.parameters.get("molar_mass", 0.0) for fluid in TABLE.values()]
    is_in_table = any(abs(gas.molar_mass - mass) <= _SAME_MASS * mass for mass in masses)
    return is_in_table and gas.temperature >= _ABOVE_CRITICAL


def _recognise_gas(gas: Any) -> str:
    """Return the name of the real gas whose molar mass and viscosity match an ideal gas, "" if there is none.

    Gases in `TABLE` are identified by their molar mass alone. If none of them matches, the fluids of CoolProp are
    searched; an ImportError is raised if CoolProp is not installed.
    """
    for table_name, fluid in TABLE.items():
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
    for name in sorted({*_names_in_coolprop().values()}):
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

    name : name of the fluid in `CoolProp`, see `_name_in_coolprop`.
    """
    import CoolProp

    state = _state(name)
    try:
        state.update(CoolProp.PT_INPUTS, _THIN, max(state.Tmin(), TABLE_TEMPERATURE))
        state.viscosity()
    except ValueError as error:
        return not _means_no_viscosity(error)
    return True


def _means_no_viscosity(error: ValueError) -> bool:
    """Return whether an error message from CoolProp says that it has no viscosity model for the fluid."""
    return "iscosity model" in str(error)

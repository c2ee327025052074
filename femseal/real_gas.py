"""Gases that are not ideal: density and viscosity by CoolProp, and what the ideal law leaves out.

A real gas is a change of variable as every fluid is, dφ = (ρ/η) dp, from a table that is made once for a gas and its
temperature. In narrow gaps it flows by Fukui and Kaneko's law with its own mean free path, which goes with η/ρ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import sqrt
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .base import Array, InputError, reals, shown, to_text
from .base.leak_rates import GAS_CONSTANT, STANDARD_PRESSURE
from .base.validate import check_parameters, described, parameter
from .flow.law import CUBIC_LAW, FlowLaw, FukuiKaneko
from .named_fluids import TABLE_TEMPERATURE, known_to_coolprop, names_in_coolprop, refuse

#: Relative error of the cubic in the middle of two points of the table up to which no more points are sought; the
#: middle is a point then, so that the error left is a sixteenth of it.
_ERROR = 1e-7
#: First pressure of the table above 0 [Pa]; those that follow are twice as high.
_FIRST_PRESSURE = 1e5
#: Highest pressure of tables [Pa]: no seal carries more, and equations of state are extrapolated there.
_HIGHEST = 1e9
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(6)
#: The slope of a potential is 0 at no pressure, where it does not count [s/m²].
_LEAST_SLOPE = 1e-200


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
        without = "an ideal gas, as real ones need CoolProp: pip install 'femseal[fluids]'"
        known_to_coolprop(self.name, self.temperature, without)
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
        start = np.interp(np.sqrt(φ), np.sqrt(table.potentials), table.pressures)
        return with_potential(
            φ, start, table.potential, lambda p: np.maximum(table.slope(p), _LEAST_SLOPE)
        )

    def check_pressure(self, name: str, pressure: float) -> None:
        """Raise InputError if it is no gas at a pressure [Pa] that is called `name`, or CoolProp does not know it."""
        if not 0 <= pressure <= self.highest_pressure:
            table = _table(self.name, self.temperature)
            at, limit = f"{self.temperature - 273.15:.4g} °C", to_text(self.highest_pressure, "Pa")
            expected = f"at most {limit}, absolute, up to which CoolProp knows {self.name} at {at}"
            if table.saturates:
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
    """Potentials [kg/(m³ s)] at rising pressures [Pa] from 0 on, cubics between them and their slopes; M [kg/mol]."""

    pressures: Array
    potentials: Array
    potential: Any
    slope: Any
    saturates: bool
    molar_mass: float


def _state(name: str) -> Any:
    """The gas in CoolProp; it is not kept, as CoolProp complains of what is left when the interpreter ends."""
    from CoolProp.CoolProp import AbstractState

    return AbstractState("HEOS", names_in_coolprop()[name.casefold()])


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
    """The potential of a gas at a temperature [K], by quadrature of 12 points between two pressures of the table.

    Points are added until the cubics between them are right; it ends at saturation, or where CoolProp knows no more.
    """
    from scipy.interpolate import CubicHermiteSpline

    limit, saturates = _limit(name, temperature)

    def slopes(pressure: Array) -> Array:
        density, viscosity = _properties(name, temperature, pressure)
        return density / viscosity

    points = [(0.0, 0.0, 0.0)]  # pressure, potential, slope
    edges = [limit]
    while edges[-1] > _FIRST_PRESSURE:
        edges.append(max(0.5 * edges[-1], _FIRST_PRESSURE))
    while edges:
        (a, φ, slope), b = points[-1], edges[-1]
        half = 0.5 * (b - a)
        try:
            within = slopes(a + half * np.array([0.5 * (1 + _POINTS), 0.5 * (3 + _POINTS)]))
            middle, end = slopes(np.array([a + half, b]))
        except ValueError as error:
            if len(points) == 1:
                refuse(
                    name,
                    temperature,
                    f"a gas whose density and viscosity CoolProp knows: {shown(str(error))}",
                )
            break
        parts = 0.5 * half * (within @ _WEIGHTS)
        by_cubic = φ + 0.5 * parts.sum() + 0.25 * half * (slope - end)
        if abs(by_cubic - (φ + parts[0])) > _ERROR * (φ + parts[0]):
            edges.append(a + half)
            continue
        points += [(a + half, φ + parts[0], middle), (b, φ + parts.sum(), end)]
        edges.pop()
    pressures, potentials, known = (np.array(column) for column in zip(*points, strict=True))
    potential = CubicHermiteSpline(pressures, potentials, known)
    slope, molar_mass = potential.derivative(), float(_state(name).molar_mass())
    return _Table(pressures, potentials, potential, slope, saturates and not edges, molar_mass)


def _limit(name: str, temperature: float) -> tuple[float, bool]:
    """Pressure up to which a table goes [Pa], and whether the gas saturates there.

    Raises InputError: a temperature outside of those that CoolProp knows.
    """
    import CoolProp

    state = _state(name)
    low, high = state.Tmin(), state.Tmax()
    if not low <= temperature <= high:
        refuse(
            name, temperature, f"a temperature from {low - 273.15:.4g} to {high - 273.15:.4g} °C"
        )
    if temperature >= state.T_critical():
        return min(state.pmax(), _HIGHEST), False
    state.update(CoolProp.QT_INPUTS, 1.0, temperature)
    return (1 - 1e-6) * state.p(), True


@dataclass(frozen=True)
class _Critical:
    """Molar mass [kg/mol], critical temperature [K], pressure [Pa] and volume [m³/mol], acentric factor."""

    molar_mass: float
    temperature: float
    pressure: float
    volume: float
    acentric: float


#: Constants of the gases that have a name at 20 °C, of their equations of state, see `femseal.named_fluids`.
_CRITICAL = {
    "air": _Critical(28.965e-3, 132.5, 3.786e6, 84.5e-6, 0.0335),
    "nitrogen": _Critical(28.013e-3, 126.19, 3.396e6, 89.4e-6, 0.0372),
    "oxygen": _Critical(31.999e-3, 154.58, 5.043e6, 73.4e-6, 0.0222),
    "argon": _Critical(39.948e-3, 150.69, 4.863e6, 74.6e-6, -0.0022),
    "helium": _Critical(4.0026e-3, 5.195, 0.2276e6, 57.5e-6, -0.385),
    "hydrogen": _Critical(2.0159e-3, 33.15, 1.296e6, 64.5e-6, -0.219),
    "methane": _Critical(16.043e-3, 190.56, 4.599e6, 98.6e-6, 0.0114),
}
#: Largest relative distance of a molar mass by which a gas is known; ethylene is at 1.5e-3 of nitrogen.
_SAME_MASS = 1.3e-3


def dense_gas(name: str, temperature: float, pressure: ArrayLike) -> tuple[Array, Array]:
    """Compressibility z and rise of the viscosity η − η(0) [Pa s] of a gas of `named_fluids` without CoolProp.

    z by Peng & Robinson, η by Jossi, Stiel & Thodos, whose errors partly cancel in ρ/η: measured at 20 °C, the flow is
    within 3 % of CoolProp's up to 100 bar and within 6 % up to 700 bar.
    Source: Ind. Eng. Chem. Fundam. 15, 1976, 59; AIChE J. 8, 1962, 59.
    """
    gas, p = _CRITICAL[name], reals(pressure)
    ω, reduced = gas.acentric, temperature / gas.temperature
    slope = 0.37464 + 1.54226 * ω - 0.26992 * ω**2
    attraction = 0.45724 * (p / gas.pressure) / reduced**2 * (1 + slope * (1 - sqrt(reduced))) ** 2
    volume = 0.07780 * (p / gas.pressure) / reduced
    z = np.array(
        [_largest_root(a, b) for a, b in zip(attraction.ravel(), volume.ravel(), strict=True)]
    )
    z = z.reshape(p.shape)
    ratio = p * gas.volume / (z * GAS_CONSTANT * temperature)
    terms = 0.10230 + ratio * (
        0.023364 + ratio * (0.058533 + ratio * (-0.040758 + ratio * 0.0093324))
    )
    # in cP, g/mol and atm
    scale = (
        gas.temperature ** (1 / 6)
        / sqrt(1e3 * gas.molar_mass)
        / (gas.pressure / STANDARD_PRESSURE) ** (2 / 3)
    )
    return z, 1e-3 * (terms**4 - 1e-4) / scale


def _largest_root(a: float, b: float) -> float:
    """Compressibility of the gas by the cubic of Peng and Robinson."""
    roots = np.roots([1.0, b - 1, a - 3 * b**2 - 2 * b, -(a * b - b**2 - b**3)])
    return float(roots.real[np.abs(roots.imag) < 1e-9].max())


def ideal_gas_error(gas: Any, inlet: float, outlet: float) -> tuple[str, float, str] | None:
    """Name of an ideal gas, relative error of its leakage between two pressures [Pa], and by what it was found.

    The gas is known by its molar mass; None of another, and without a drop of pressure. By CoolProp where that is
    installed, else by `dense_gas`.
    """
    found = (
        n for n, c in _CRITICAL.items() if abs(gas.molar_mass / c.molar_mass - 1) <= _SAME_MASS
    )
    if (name := next(found, None)) is None or inlet == outlet:
        return None
    ideal = float(gas.potential(inlet) - gas.potential(outlet))
    try:
        real = RealGas(name, gas.temperature)
        real.check_pressure("inlet", inlet)
        drop, how = float(real.potential(inlet) - real.potential(outlet)), "CoolProp"
    except InputError:
        p = outlet + 0.5 * (inlet - outlet) * (1 + _POINTS)
        z, rise = dense_gas(name, gas.temperature, p)
        thin = gas.molar_mass * p / (GAS_CONSTANT * gas.temperature)
        drop = float(0.5 * (inlet - outlet) * _WEIGHTS @ (thin / z / (gas.viscosity + rise)))
        how = "Peng & Robinson's density and Jossi's viscosity"
    return name, ideal / drop - 1, how

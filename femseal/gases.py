"""Describe gases: ideal gases, and real gases with density and viscosity from CoolProp.

The pressure potential of a real gas is φ = ∫ρ/η dp, with the density ρ and the viscosity η from CoolProp. The potential
is tabulated once for each gas and temperature. In narrow gaps, the flow follows the law of Fukui and Kaneko. The mean
free path in this law is that of the real gas, proportional to η/ρ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import sqrt
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .base import Array, InputError, NotConverged, reals, to_text
from .base.leak_rates import GAS_CONSTANT, STANDARD_PRESSURE
from .base.validate import check_parameters, described, parameter
from .flow.law import CUBIC_LAW, FlowLaw, FukuiKaneko
from .named_fluids import (
    TABLE_TEMPERATURE,
    WITHOUT_NAME,
    check_name,
    coolprop_state,
    density_and_viscosity,
    refuse_unknown,
    viscosity_parameter,
)

#: Relative error of the potential of a real gas above which a point is added to its table.
_ERROR = 1e-7
#: Lowest pressure above 0 in the table of a real gas [Pa].
_FIRST_PRESSURE = 1e5
#: Number of pressures above 0 in the first table of a real gas, before points are added.
_FEWEST = 33
#: Largest number of pressures in the table of a real gas. Usual gases need fewer than 200.
_MOST = 10_000
#: Highest pressure in the table of a real gas [Pa]. No seal carries a higher pressure, and equations of state are not
#: valid at higher pressures.
_HIGHEST = 1e9
#: Smallest slope dφ/dp [s/m²] by which Newton's method divides, because the slope at zero pressure is 0.
_LEAST_SLOPE = 1e-200


def temperature_of_gas(**more: Any) -> Any:
    """Return the declaration of the field `temperature` of a gas class; `more` is passed on to `parameter`."""
    allowed = "a temperature above absolute zero"
    return parameter("K", allowed, "20 °C", "temperature of the gas", usual=(2.0, 2000.0), **more)


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
class IdealGas(Gas):
    """Describe an isothermal ideal gas.

    The pressure potential is φ = M p²/(2 R T η). Without slip, the mass flow rate is therefore proportional to
    p_in² − p_out². If the gap is not much larger than the mean free path, the flow rate is multiplied by `flow_factor`,
    which depends on the gap and the pressure. Volume flow rates refer to 101 325 Pa and the temperature of the gas.

    Parameters
    ----------
    viscosity : float
        Viscosity η [Pa s].
    molar_mass : float
        Molar mass M [kg/mol].
    temperature : float
        Temperature T [K].
    slip : bool
        Whether slip and free molecular flow in narrow gaps are taken into account.

    Examples
    --------
    >>> helium = IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15)
    >>> bool(helium.flow_factor(100e-9, 1e5) > helium.flow_factor(1e-6, 1e5) > 1)
    True
    """

    kind: ClassVar[str] = "ideal-gas"
    viscosity: float = viscosity_parameter("18 uPa*s")
    molar_mass: float = parameter(
        "kg/mol",
        "a molar mass > 0",
        "29 g/mol",
        "molar mass of the gas",
        usual=(1e-3, 1.0),
        needed=WITHOUT_NAME,
    )
    temperature: float = temperature_of_gas(needed=WITHOUT_NAME)
    slip: bool = slip_of_gas()

    @property
    def law(self) -> FlowLaw:
        """Flow law: the law of Fukui and Kaneko, or the cubic law if slip is ignored."""
        if not self.slip:
            return CUBIC_LAW
        return FukuiKaneko(self.viscosity, self.speed)

    @property
    def _potential_factor(self) -> float:
        """Ratio φ/p² of the pressure potential to the square of the pressure [kg/(m³ s Pa²)]."""
        return self.molar_mass / (2 * GAS_CONSTANT * self.temperature * self.viscosity)

    def potential(self, pressure: ArrayLike) -> Array:
        """Return the pressure potential φ(p) of viscous flow [kg/(m³ s)] at an absolute pressure [Pa]."""
        return self._potential_factor * reals(pressure) ** 2

    def pressure(self, potential: ArrayLike) -> Array:
        """Return the absolute pressure [Pa] at which the potential has a given value."""
        return np.sqrt(reals(potential) / self._potential_factor)

    def flow_factor(self, gap: ArrayLike, pressure: ArrayLike) -> Array:
        """Return the ratio of the gas flow rate through a gap to the flow rate by the cubic law; 1 if slip is ignored.

        Parameters
        ----------
        gap : array_like
            Gap h >= 0 [m], broadcast with `pressure`.
        pressure : array_like
            Absolute pressure p >= 0 [Pa].

        Returns
        -------
        array
            Flow factor F = Q(D)/(D/6) with the inverse Knudsen number D and the dimensionless flow rate Q(D); infinite
            where the gap or the pressure is 0.

        Raises
        ------
        InputError
            A value is negative or undefined.

        Notes
        -----
        See `femseal.flow.law.flow_rate` for Q(D), its source and its accuracy. For helium at 1 bar and 20 °C, the flow
        factor is 2.5 in a gap of 1 µm and 21 in a gap of 100 nm.

        Examples
        --------
        >>> IdealGas(19.6e-6, 4.0026e-3, 293.15).flow_factor([1e-6, 100e-9, 30e-9], 1e5).round(1)
        array([ 2.5, 20.9, 82.8])
        """
        h, p = np.broadcast_arrays(reals(gap), reals(pressure))
        for name, values, unit in (("gap", h, "m"), ("pressure", p, "Pa, absolute")):
            if not np.isfinite(values).all() or values.min(initial=0.0) < 0:
                expected = f"finite numbers >= 0 [{unit}]"
                raise InputError(name, "negative or undefined values", expected)
        return self.law.factor(h, p)


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
        check_name(self.name, self.temperature)
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
        return density_and_viscosity(self.name, self.temperature, pressure)[0]

    def viscosity_at(self, pressure: ArrayLike) -> Array:
        """Return the viscosity η(p) [Pa s] from CoolProp at absolute pressures > 0."""
        return density_and_viscosity(self.name, self.temperature, pressure)[1]

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


@cache
def _table(name: str, temperature: float) -> _Table:
    """Tabulate the potential of a gas at a temperature [K].

    A cubic spline interpolates the slope dφ/dp = ρ/η. The integral of this spline is the potential φ. Midway between
    neighbouring pressures of the table, the interpolated slope is checked against the exact slope. Where the error is
    too large, the midpoint is added to the table. This is repeated until all errors are small enough.

    Raises
    ------
    NotConverged
        The errors are too large even with 10,000 pressures in the table.
    """
    from scipy.interpolate import CubicSpline

    def exact_slope(pressure: ArrayLike) -> Array:
        """Return ρ/η from CoolProp."""
        density, viscosity = density_and_viscosity(name, temperature, pressure)
        return density / viscosity

    limit, saturates = _highest_pressure(name, temperature)
    first = min(_FIRST_PRESSURE, 0.5 * limit)
    pressures = np.append(0.0, np.geomspace(first, limit, _FEWEST))
    slopes = np.append(0.0, exact_slope(pressures[1:]))
    while pressures.size <= _MOST:
        slope = CubicSpline(pressures, slopes)
        potential = slope.antiderivative()
        middles = 0.5 * (pressures[1:] + pressures[:-1])
        exact = exact_slope(middles)
        # error of the slope times the width of the interval, relative to the potential
        error = np.abs(slope(middles) - exact) * np.diff(pressures) / potential(middles)
        coarse = np.flatnonzero(error > _ERROR)  # intervals to be halved
        if not coarse.size:
            molar_mass = float(coolprop_state(name).molar_mass())
            return _Table(pressures, potential, slope, saturates, molar_mass)
        pressures = np.insert(pressures, coarse + 1, middles[coarse])
        slopes = np.insert(slopes, coarse + 1, exact[coarse])
    raise NotConverged(
        f"real gas: {_MOST:,} pressures do not resolve density and viscosity of {name} at "
        f"{temperature - 273.15:.4g} °C, which CoolProp computes. Try another temperature, or an IdealGas",
        float(error.max()),
    )


def _highest_pressure(name: str, temperature: float) -> tuple[float, bool]:
    """Return the highest tabulated pressure of a gas, and whether the gas condenses there.

    Below the critical temperature, the highest pressure of the table is the saturation pressure [Pa]. Above the
    critical temperature, the table ends at the highest pressure for which CoolProp has an equation of state, but at 1
    GPa at most. The highest pressure is halved until CoolProp can compute density and viscosity there.
    """
    import CoolProp

    state = coolprop_state(name)
    limit = min(state.pmax(), _HIGHEST)
    saturates = temperature < state.T_critical()
    if saturates:
        state.update(CoolProp.QT_INPUTS, 1.0, temperature)
        limit = (1 - 1e-6) * state.p()  # just below saturation
    while True:
        try:
            density_and_viscosity(name, temperature, limit)
            return limit, saturates
        except ValueError as error:
            limit = 0.5 * limit
            saturates = False
            if limit < _FIRST_PRESSURE:
                refuse_unknown(name, temperature, error)

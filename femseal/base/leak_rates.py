"""Convert leakage between units.

A leakage is stored as a volume rate per length of seal [m²/s] at the reference density of the fluid. Converting to a
unit of `leak_units` requires the seal length, the fluid density and, for a gas, the reference state. For a given amount
of gas, the product pressure × volume is proportional to the temperature. A leakage in a unit of pressure × volume is
therefore only meaningful together with a temperature. Standard volumes refer to 0 °C and 101 325 Pa.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import isnan

from numpy.typing import ArrayLike

from .errors import InputError
from .leak_units import LEAK_UNITS, USUAL_UNITS, LeakUnit, readable_unit
from .validate import number, reals

#: Molar gas constant [J/(mol K)], CODATA (exact since 2019).
GAS_CONSTANT = 8.31446261815324
#: Temperature [K] and pressure [Pa] of standard volumes of gas.
STANDARD_TEMPERATURE, STANDARD_PRESSURE = 273.15, 101_325.0
#: Usual units of the leakage of a whole seal, from the largest to the smallest.
_USUAL_FOR_GASES = ("std L/min", "mbar·L/s")
_USUAL_FOR_LIQUIDS = ("L/min", "mL/min", "drops/min", "drops/h", "mL/year")
#: Volume of a drop and of a bubble [m³]: 20 drops make 1 mL, and a bubble has 0.15 mL by FCI 70-2.
DROP, BUBBLE = 0.05e-6, 0.15e-6


@dataclass(frozen=True)
class LeakBasis:
    """Quantities needed to convert a volume rate per length of seal to other units.

    Parameters
    ----------
    length : float
        Length of the seal [m].
    density : float
        Density of the fluid at its reference state [kg/m³], NaN if it is unknown.
    pressure, temperature : float, optional
        Absolute pressure [Pa] and temperature [K] of the reference state of a gas. None for a liquid, whose leakage
        cannot be expressed as pressure × volume or as a standard volume.
    molar_mass : float, optional
        Molar mass of a gas [kg/mol].
    given_temperature : float, optional
        Reference temperature [K] of leakages in units of pressure × volume. Default: the reference temperature.
    drop_volume, bubble_volume : float
        Volume of a drop and of a bubble [m³].
    pressure_drop : float, optional
        Pressure drop over the seal [Pa], which some classes need.
    capacity : float, optional
        Rated capacity of the open valve [m³/s], which some classes need.
    """

    length: float
    density: float
    pressure: float | None = None
    temperature: float | None = None
    molar_mass: float | None = None
    given_temperature: float | None = None
    drop_volume: float = DROP
    bubble_volume: float = BUBBLE
    pressure_drop: float | None = None
    capacity: float | None = None

    def __post_init__(self) -> None:
        for name in ("temperature", "given_temperature"):
            value = getattr(self, name)
            if value is not None:
                number(name, value, unit="K")

    @property
    def is_gas(self) -> bool:
        """Whether the fluid is a gas."""
        return self.pressure is not None

    @property
    def throughput_temperature(self) -> float | None:
        """Temperature [K] at which leakages in units of pressure × volume are given; None for a liquid."""
        if self.is_gas and self.given_temperature is not None:
            return self.given_temperature
        return self.temperature

    def lacks(self, unit: LeakUnit) -> str:
        """Return "" if the leakage can be expressed in a unit, and otherwise advice on which unit to use instead."""
        is_unit_of_gases = unit.kind in ("throughput", "standard", "bubbles")
        if is_unit_of_gases and not self.is_gas:
            return f"another unit: {unit.name} is for gases"
        if unit.kind == "drops" and self.is_gas:
            return f"another unit: {unit.name} is for liquids"
        if unit.kind == "standard" and self.temperature is None:
            return "another unit: the gas has no temperature"
        if unit.kind == "mass" and isnan(self.density):
            return "a unit of volume: the density of the fluid is unknown"
        return ""

    def has(self, unit: LeakUnit) -> bool:
        """Return whether the leakage can be expressed in a unit."""
        return not self.lacks(unit)

    def factor(self, unit: LeakUnit) -> float:
        """Return the factor that converts a leakage in this unit to a volume rate per length of seal [m²/s].

        Raises
        ------
        InputError
            The leakage cannot be expressed in the unit, for example because the unit is only defined for gases.
        """
        alternative = self.lacks(unit)
        if alternative:
            fluid = "gas" if self.is_gas else "liquid"
            raise InputError("leakage_unit", f"{unit.name} for a {fluid}", alternative)
        length = 1.0 if unit.per_length else self.length
        return unit.si / self._amount_per_volume(unit) / length

    def _amount_per_volume(self, unit: LeakUnit) -> float:
        """Return how much fluid is in 1 m³ at the reference state, as the quantity that a unit measures.

        Depending on the kind of `unit`, the amount is for example a mass [kg], a volume [m³] or a number of drops.
        """
        if unit.kind == "volume":
            return 1.0
        if unit.kind == "mass":
            return self.density
        if unit.kind == "drops":
            return 1 / self.drop_volume
        if unit.kind == "bubbles":
            return 1 / self.bubble_volume
        pressure = self.pressure or 1.0
        temperature = self.temperature or 1.0
        if unit.kind == "standard":
            return pressure / STANDARD_PRESSURE * STANDARD_TEMPERATURE / temperature
        # throughput: for the same amount of gas, pressure × volume is proportional to the temperature
        if self.given_temperature and self.temperature:
            return pressure * (self.given_temperature / temperature)
        return pressure

    def units(self, names: Iterable[str] = USUAL_UNITS) -> list[LeakUnit]:
        """Return the units with the given names, leaving out those in which the leakage cannot be expressed."""
        return [LEAK_UNITS[name] for name in names if self.has(LEAK_UNITS[name])]

    def readable(self, values: ArrayLike) -> LeakUnit:
        """Choose one readable unit for several leakages [m²/s], for example for a column of a table.

        The unit refers to the whole seal: volume per time for a liquid, and pressure × volume per time for a gas.
        """
        if self.is_gas:
            return LEAK_UNITS["mbar·L/s"]
        return readable_unit(reals(values) * self.length, per_length=False)

    def usual_unit(self, value: float) -> LeakUnit:
        """Choose the customary unit for the leakage of a whole seal that leaks `value` [m²/s] per length.

        Gas leakages of at least 1 std L/min are given in standard litres per minute, and smaller ones in mbar·L/s, the
        unit of leak tests. The leakage of a liquid is given in L/min, mL/min, drops per minute, drops per hour or mL
        per year: whichever is the largest unit that gives a value of at least 1.
        """
        names = _USUAL_FOR_GASES if self.is_gas else _USUAL_FOR_LIQUIDS
        units = self.units(names)
        for unit in units:
            if abs(value) >= self.factor(unit):
                return unit
        return units[-1]

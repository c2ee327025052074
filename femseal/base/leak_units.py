"""Units of leakage that engineers use, all in one table: of volume, of mass, of drops, of gas as pressure × volume.

A leakage is known as volume rate per length of seal at the fluid's reference density [m²/s]. The length of the seal,
the fluid's density and, for a gas, its reference state turn it into any unit of the table. Pressure × volume of a gas
is proportional to its temperature, so it is stated at one; standard volumes are those at 0 °C and 101 325 Pa. To add
a unit, add it to the table.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import isnan
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from .errors import InputError, shown

Kind = Literal["volume", "mass", "throughput", "standard", "drops"]
#: Molar gas constant [J/(mol K)], CODATA (exact since 2019).
GAS_CONSTANT = 8.31446261815324
#: State of standard volumes of gas, 0 °C [K] and 101 325 Pa.
STANDARD_TEMPERATURE, STANDARD_PRESSURE = 273.15, 101_325.0
#: Volume of a drop [m³]: 20 drops are 1 mL.
DROP = 0.05e-6


@dataclass(frozen=True)
class LeakUnit:
    """A unit of leakage.

    name : as people write it. kind : what it counts. si : its value in m³/s, kg/s or Pa·m³/s, or in these per metre;
    of standard volumes m³/s at 0 °C and 101 325 Pa.
    per_length : whether it is per length of seal.
    """

    name: str
    kind: Kind
    si: float
    per_length: bool


_MINUTE, _HOUR, _DAY, _YEAR = 60.0, 3600.0, 86_400.0, 365.25 * 86_400.0
_TABLE: tuple[tuple[Kind, bool, dict[str, float]], ...] = (
    ("volume", True, {"m²/s": 1.0, "L/(m·s)": 1e-3, "mL/(m·s)": 1e-6, "µL/(m·s)": 1e-9, "nL/(m·s)": 1e-12,
                      "pL/(m·s)": 1e-15, "mL/(m·min)": 1e-6 / _MINUTE, "mL/(m·h)": 1e-6 / _HOUR}),
    ("volume", False, {"m³/s": 1.0, "L/s": 1e-3, "L/min": 1e-3 / _MINUTE, "L/h": 1e-3 / _HOUR, "mL/s": 1e-6,
                       "mL/min": 1e-6 / _MINUTE, "mL/h": 1e-6 / _HOUR, "mL/day": 1e-6 / _DAY, "µL/s": 1e-9,
                       "µL/min": 1e-9 / _MINUTE, "mm³/s": 1e-9, "nL/s": 1e-12, "pL/s": 1e-15}),
    ("mass", True, {"kg/(m·s)": 1.0, "g/(m·s)": 1e-3, "mg/(m·s)": 1e-6, "µg/(m·s)": 1e-9, "g/(m·h)": 1e-3 / _HOUR}),
    ("mass", False, {"kg/s": 1.0, "g/s": 1e-3, "mg/s": 1e-6, "µg/s": 1e-9, "kg/h": 1 / _HOUR, "g/h": 1e-3 / _HOUR,
                     "mg/h": 1e-6 / _HOUR, "kg/year": 1 / _YEAR, "g/year": 1e-3 / _YEAR}),
    ("throughput", True, {"Pa·m³/(m·s)": 1.0, "mbar·L/(m·s)": 0.1}),
    ("throughput", False, {"Pa·m³/s": 1.0, "mbar·L/s": 0.1}),
    ("standard", True, {"std cm³/(m·s)": 1e-6}),
    ("standard", False, {"std cm³/s": 1e-6, "std cm³/min": 1e-6 / _MINUTE, "std L/min": 1e-3 / _MINUTE}),
    ("drops", False, {"drops/s": DROP, "drops/min": DROP / _MINUTE, "drops/h": DROP / _HOUR}),
)  # fmt: skip
#: All units, by their name.
LEAK_UNITS: dict[str, LeakUnit] = {
    name: LeakUnit(name, kind, si, per_length) for kind, per_length, values in _TABLE for name, si in values.items()
}
#: Units in which every leakage is given; those of gases are left out for liquids.
USUAL_UNITS = ("m²/s", "mL/(m·min)", "mg/(m·s)", "m³/s", "mL/min", "drops/min", "kg/s", "g/year", "Pa·m³/s", "mbar·L/s",
        "std cm³/s")  # fmt: skip
#: Units among which a readable one is chosen, per length of seal and for a whole seal.
_READABLE = {
    True: ("L/(m·s)", "mL/(m·s)", "µL/(m·s)", "nL/(m·s)", "pL/(m·s)"),
    False: ("L/s", "mL/s", "mL/min", "mL/h", "nL/s", "pL/s"),
}


#: Other letters for the same.
_LETTERS = str.maketrans({"μ": "u", "µ": "u", "·": "*", "²": "2", "³": "3", "^": "", " ": "", "l": "L"})
#: Other names of units.
_ALIASES = {"sccm": "std cm³/min", "slm": "std L/min", "scc/s": "std cm³/s", "std cc/s": "std cm³/s",
            "Ncm³/s": "std cm³/s", "drop/min": "drops/min", "drop/s": "drops/s", "drop/h": "drops/h"}  # fmt: skip


def leak_unit(text: str) -> LeakUnit:
    """The unit of a name; "mL/(min*m)", "Pa*m^3/s", "ml/min" and "ug/s" are understood too.

    Raises InputError: another name.
    """
    if isinstance(text, str):
        wanted = _key(text)
        for written, name in (*((unit, unit) for unit in LEAK_UNITS), *_ALIASES.items()):
            if wanted == _key(written):
                return LEAK_UNITS[name]
    raise InputError("leakage_unit", shown(text), f"one of {', '.join(LEAK_UNITS)}")


def _key(name: str) -> tuple[str, tuple[str, ...]]:
    """Numerator and factors of the denominator, however they are written."""
    name = name.translate(_LETTERS)
    above, _, below = name.partition("/")
    return above, tuple(sorted(below.replace("(", "").replace(")", "").replace("/", "*").split("*")))


@dataclass(frozen=True)
class LeakBasis:
    """What turns a volume rate per length of seal into other units.

    length : of the seal [m]. density : of the fluid at its reference state [kg/m³], NaN where unknown. pressure,
    temperature : of the reference state of a gas, absolute [Pa] and [K]; None for a liquid, which has no leakage in
    pressure × volume and no standard volume. molar_mass : of a gas [kg/mol], None where unknown. stated : temperature
    at which pressure × volume is stated [K]; that of the reference state unless given.
    """

    length: float
    density: float
    pressure: float | None = None
    temperature: float | None = None
    molar_mass: float | None = None
    stated: float | None = None

    @property
    def is_gas(self) -> bool:
        """Whether the fluid has leakage in pressure × volume."""
        return self.pressure is not None

    @property
    def stated_temperature(self) -> float | None:
        """Temperature at which pressure × volume is stated [K]; None for a liquid."""
        return self.stated if self.is_gas and self.stated is not None else self.temperature

    def lacks(self, unit: LeakUnit) -> str:
        """Why leakage of the fluid cannot be given in the unit, as what is allowed instead; "" where it can."""
        if unit.kind in ("throughput", "standard") and not self.is_gas:
            return "a unit of volume or of mass for a liquid: pressure × volume and standard volumes are for gases"
        if unit.kind == "standard" and self.temperature is None:
            return "another unit: the gas has no temperature"
        if unit.kind == "drops" and self.is_gas:
            return "another unit for a gas: drops are of liquids"
        if unit.kind == "mass" and isnan(self.density):
            return "a unit of volume: the density of the fluid is unknown"
        return ""

    def has(self, unit: LeakUnit) -> bool:
        """Whether leakage of the fluid can be given in the unit."""
        return not self.lacks(unit)

    def factor(self, unit: LeakUnit) -> float:
        """Volume rate per length of seal that is 1 in the unit [m²/s].

        Raises InputError: a unit of gases for a liquid, or of liquids for a gas.
        """
        if lack := self.lacks(unit):
            raise InputError("leakage_unit", f"{unit.name} for a {'gas' if self.is_gas else 'liquid'}", lack)
        per_volume = 1.0
        if unit.kind == "mass":
            per_volume = self.density
        elif unit.kind == "throughput":
            assert self.pressure is not None
            # pressure × volume of the same amount of gas goes with its temperature
            ratio = self.stated / self.temperature if self.stated and self.temperature else 1.0
            per_volume = self.pressure * ratio
        elif unit.kind == "standard":
            assert self.pressure is not None
            assert self.temperature is not None
            per_volume = self.pressure / STANDARD_PRESSURE * STANDARD_TEMPERATURE / self.temperature
        return unit.si / per_volume / (1.0 if unit.per_length else self.length)

    def units(self, names: Iterable[str] = USUAL_UNITS) -> list[LeakUnit]:
        """Those of the named units in which leakage of the fluid can be given."""
        return [unit for unit in map(LEAK_UNITS.__getitem__, names) if self.has(unit)]

    def readable(self, values: ArrayLike) -> LeakUnit:
        """One unit of volume rate of the whole seal for all the leakages [m²/s] given."""
        return _readable(np.asarray(values, dtype=float) * self.length, per_length=False)


def leakage_unit(values: ArrayLike) -> tuple[float, str]:
    """One readable unit for all the leakages per length [m²/s] given, by the median of those not 0: value and name.

    >>> leakage_unit([0.0, 3e-9, 4e-7, 2e-8])
    (1e-09, 'µL/(m·s)')
    """
    unit = _readable(np.asarray(values, dtype=float), per_length=True)
    return unit.si, unit.name


def _readable(values: ArrayLike, per_length: bool) -> LeakUnit:
    size = np.abs(np.ravel(values))
    size = size[np.isfinite(size) & (size > 0)]
    middle = float(np.median(size)) if size.size else 1e-9
    units = [LEAK_UNITS[name] for name in _READABLE[per_length]]
    return next((unit for unit in units if middle >= unit.si * (1 - 1e-12)), units[-1])

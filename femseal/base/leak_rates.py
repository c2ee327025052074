"""Leakage in any unit, and the leakage classes of standards in one table.

A leakage is known as volume rate per length of seal at the fluid's reference density [m²/s]. The length of the seal,
the fluid's density and, for a gas, its reference state turn it into any unit of the table. Pressure × volume of a gas
is proportional to its temperature, so it is stated at one; standard volumes are those at 0 °C and 101 325 Pa. Units
are in `leak_units`.

Limits, with the edition they are of, stand in `_TABLE`. Those of ISO 5208, which EN 12266-1 shares, are of closed
valves, times the nominal diameter in mm; A is no visible leakage while the test lasts, here none at all. Those of
API 598 and FCI 70-2 are of the seat of a valve, those of ISO 15848-1 of its stem:
the nominal diameter is that of either.

Other limits are leakages with their unit, such as "5 mL/min".
"""

import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from math import inf, isnan

import numpy as np
from numpy.typing import ArrayLike

from .errors import InputError, shown
from .leak_units import LEAK_UNITS, USUAL_UNITS, LeakUnit, leak_unit, readable_unit
from .validate import Flags, number, reals

#: Molar gas constant [J/(mol K)], CODATA (exact since 2019).
GAS_CONSTANT = 8.31446261815324
#: State of standard volumes of gas, 0 °C [K] and 101 325 Pa.
STANDARD_TEMPERATURE, STANDARD_PRESSURE = 273.15, 101_325.0
#: Volume of a drop and of a bubble [m³]: 20 drops are 1 mL, and a bubble is 0.15 mL by FCI 70-2.
DROP, BUBBLE = 0.05e-6, 0.15e-6


@dataclass(frozen=True)
class LeakBasis:
    """What turns a volume rate per length of seal into other units.

    length : of the seal [m]. density : of the fluid at its reference state [kg/m³], NaN where unknown. pressure,
    temperature : of the reference state of a gas, absolute [Pa] and [K]; None for a liquid, which has no leakage in
    pressure × volume and no standard volume. molar_mass : of a gas [kg/mol], None where unknown. stated : temperature
    at which pressure × volume is stated [K]; that of the reference state unless given. drop, bubble : volume of one
    [m³]. pressure_drop : over the seal [Pa]. capacity : rated one of an open valve [m³/s]. Classes need these.
    """

    length: float
    density: float
    pressure: float | None = None
    temperature: float | None = None
    molar_mass: float | None = None
    stated: float | None = None
    drop: float = DROP
    bubble: float = BUBBLE
    pressure_drop: float | None = None
    capacity: float | None = None

    def __post_init__(self) -> None:
        for name, value in (("temperature", self.temperature), ("stated", self.stated)):
            if value is not None:
                number(name, value, unit="K")

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
        of_gases = unit.kind in ("throughput", "standard", "bubbles")
        if (self.is_gas and unit.kind == "drops") or (of_gases and not self.is_gas):
            return f"another unit: {unit.name} is for {'gases' if of_gases else 'liquids'}"
        if unit.kind == "standard" and self.temperature is None:
            return "another unit: the gas has no temperature"
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
            fluid = "gas" if self.is_gas else "liquid"
            raise InputError("leakage_unit", f"{unit.name} for a {fluid}", lack)
        pressure, temperature = self.pressure or 1.0, self.temperature or 1.0
        # pressure × volume of the same amount of gas goes with its temperature
        ratio = (self.stated or temperature) / temperature if self.temperature else 1.0
        per_volume = {
            "volume": 1.0,
            "mass": self.density,
            "drops": 1 / self.drop,
            "bubbles": 1 / self.bubble,
            "throughput": pressure * ratio,
            "standard": pressure / STANDARD_PRESSURE * STANDARD_TEMPERATURE / temperature,
        }[unit.kind]
        return unit.si / per_volume / (1.0 if unit.per_length else self.length)

    def units(self, names: Iterable[str] = USUAL_UNITS) -> list[LeakUnit]:
        """Those of the named units in which leakage of the fluid can be given."""
        return [LEAK_UNITS[name] for name in names if self.has(LEAK_UNITS[name])]

    def readable(self, values: ArrayLike) -> LeakUnit:
        """One unit of volume rate of the whole seal for all the leakages [m²/s] given."""
        return readable_unit(reals(values) * self.length, per_length=False)


#: Molar mass of helium [kg/mol], and the relative tolerance within which a gas is helium.
HELIUM, _SAME_GAS = 4.0026e-3, 0.01
#: A leakage that is the limit up to rounding meets the class.
_ROUNDING = 1e-9
_INCH, _PSI = 0.0254, 6894.757
#: Limits of class VI of FCI 70-2 by the diameter of the seat: [m], and [mL/min].
_VI_DIAMETERS = np.array([25, 38, 51, 64, 76, 102, 152, 203, 250, 300, 350, 400]) * 1e-3
_VI_LIMITS = np.array([0.15, 0.30, 0.45, 0.60, 0.90, 1.70, 4.00, 6.75, 11.1, 16.0, 21.6, 28.4])


def _nominal_inches(diameter: float) -> float:
    """Nominal pipe size of API 598 in inches, to half ones, of a nominal diameter [m]; 0 up to 2: nothing leaks."""
    size = int(2 * diameter / 0.025 + 1e-9) / 2
    return size if size > 2 else 0.0


def _class_vi(diameter: float) -> float:
    """Limit of class VI [mL/min]; between the diameters of the table straight in the square, beyond it NaN."""
    found = np.interp(diameter**2, _VI_DIAMETERS**2, _VI_LIMITS, right=np.nan)
    return float(found)


#: By what amounts are multiplied: the key that gives it, an example of its value, and the factor.
_PER: dict[str, tuple[str, str, Callable[[float], float]]] = {
    "mm": ("nominal_diameter", "a length > 0, such as '50 mm'", lambda d: 1e3 * d),
    "inch": ("nominal_diameter", "a length > 0, such as '50 mm'", lambda d: d / _INCH),
    "NPS": ("nominal_diameter", "a length > 0, such as '50 mm'", _nominal_inches),
    "class VI": ("nominal_diameter", "a length from 0 to 400 mm, such as '50 mm'", _class_vi),
    "psi": ("pressure_drop", "the pressures of the fluid", lambda p: p / _PSI),
    "capacity": (
        "rated_capacity",
        "the flow of the open valve in the test, such as '100 L/min'",
        float,
    ),
}


@dataclass(frozen=True)
class LeakClass:
    """A class of leakage: what leaks no more than its limit meets it.

    name : as the standard writes it. family : the standard; "" for a leakage of the user's own.
    amount, gas_amount, unit : the limit of liquids and of gases, and their unit in `LEAK_UNITS`.
    per : by what the amounts are multiplied. tested : the only fluid that it is defined for, "" where for any.
    edition : of the standard. second_hand : whether the limit is from tables of others, not from the standard's text.
    """

    name: str
    family: str
    amount: float
    gas_amount: float
    unit: str
    per: tuple[str, ...] = ()
    tested: str = ""
    edition: str = ""
    second_hand: bool = False

    @property
    def per_diameter(self) -> bool:
        """Whether it is of a valve of some nominal diameter."""
        return any(_PER[name][0] == "nominal_diameter" for name in self.per)

    def limit(self, basis: LeakBasis, diameter: float | None = None) -> float:
        """Largest leakage per length of seal in the class [m²/s].

        basis : fluid and length of the seal, pressure drop and capacity where a class needs them.
        diameter : nominal diameter [m], of the valve, its seat or its stem.

        Raises InputError: what a class needs is not given or beyond its table, another fluid than it is defined for,
        or a unit that is not for the fluid.
        """
        fluid = "gas" if basis.is_gas else "liquid"
        is_helium = basis.molar_mass is not None and abs(basis.molar_mass / HELIUM - 1) < _SAME_GAS
        if self.tested not in ("", fluid, "helium" if is_helium else ""):
            defined = f"{self.name}, which is defined for {self.tested}"
            expected = f"a class for the fluid, or {self.tested} as the fluid or the test fluid"
            raise InputError("classes", defined, expected)
        unit = LEAK_UNITS[self.unit]
        if lack := basis.lacks(unit):
            raise InputError("classes", f"{self.name}, a limit in {self.unit}, for a {fluid}", lack)
        amount = self.gas_amount if basis.is_gas else self.amount
        known = {
            "nominal_diameter": diameter,
            "pressure_drop": basis.pressure_drop,
            "rated_capacity": basis.capacity,
        }
        for name in self.per:
            key, expected, factor = _PER[name]
            if (value := known[key]) is None:
                raise InputError(key, f"none for the class {self.name}", expected)
            amount *= factor(value)
            if isnan(amount):
                raise InputError(key, f"{value:g} for the class {self.name}", expected)
        return amount * basis.factor(unit)


def within(leakage: ArrayLike, limit: float) -> Flags:
    """Whether leakages of any direction are no more than a limit, up to rounding; NaN is not."""
    return np.abs(reals(leakage)) <= limit * (1 + _ROUNDING)


#: Limits: name, standard, limit of liquids and, where it differs, of gases, unit, by what it is multiplied (`_PER`),
#: the only fluid tested, edition, and whether it is from tables of others. Those of ISO 15848-1 are π times 1e-5, 1e-4
#: and 1e-2 mg/(m·s) of helium at 0 °C; 16 drops or 100 bubbles are 1 mL in API 598.
_TABLE = """
L0.01          | EN 13555    | 0.01          | mg/(m·s)     |          |        | 2014          |
L0.1           | EN 13555    | 0.1           | mg/(m·s)     |          |        | 2014          |
L1             | EN 13555    | 1             | mg/(m·s)     |          |        | 2014          |
TA Luft        | TA Luft     | 0.01          | mg/(m·s)     |          | helium | 2021          |
VDI 2290       | VDI 2290    | 0.01          | mg/(m·s)     |          |        | 2012          | second hand
VDI 2440       | VDI 2440    | 1e-4          | mbar·L/(m·s) |          | helium | 2000          |
ISO 5208 A     | ISO 5208    | 0 0           | mm³/s        | mm       |        | 2015, table 4 |
ISO 5208 AA    | ISO 5208    | 0.006 0.18    | mm³/s        | mm       |        | 2015, table 4 |
ISO 5208 B     | ISO 5208    | 0.01 0.3      | mm³/s        | mm       |        | 2015, table 4 |
ISO 5208 C     | ISO 5208    | 0.03 3        | mm³/s        | mm       |        | 2015, table 4 |
ISO 5208 CC    | ISO 5208    | 0.08 22.3     | mm³/s        | mm       |        | 2015, table 4 |
ISO 5208 D     | ISO 5208    | 0.1 30        | mm³/s        | mm       |        | 2015, table 4 |
ISO 5208 E     | ISO 5208    | 0.3 300       | mm³/s        | mm       |        | 2015, table 4 |
ISO 5208 EE    | ISO 5208    | 0.39 470      | mm³/s        | mm       |        | 2015, table 4 |
ISO 5208 F     | ISO 5208    | 1 3000        | mm³/s        | mm       |        | 2015, table 4 |
ISO 5208 G     | ISO 5208    | 2 6000        | mm³/s        | mm       |        | 2015, table 4 |
API 598        | API 598     | 0.125 0.04    | mL/min       | NPS      |        | 2016          | second hand
FCI 70-2 VI    | FCI 70-2    | 1             | mL/min       | class VI | gas    | 2006          | second hand
FCI 70-2 V     | FCI 70-2    | 5e-4          | mL/min       | inch psi | liquid | 2006          | second hand
FCI 70-2 IV    | FCI 70-2    | 1e-4          | m³/s         | capacity |        | 2006          | second hand
ISO 15848-1 AH | ISO 15848-1 | 1.78e-7       | mbar·L/s     | mm       | helium | 2015          | second hand
ISO 15848-1 BH | ISO 15848-1 | 1.78e-6       | mbar·L/s     | mm       | helium | 2015          | second hand
ISO 15848-1 CH | ISO 15848-1 | 1.78e-4       | mbar·L/s     | mm       | helium | 2015          | second hand
"""


def _made_class(line: str) -> LeakClass:
    """The class in a line of the table."""
    name, family, limits, unit, per, tested, edition, hand = (p.strip() for p in line.split("|"))
    amounts = [float(limit) for limit in limits.split()]
    keys = tuple(key for key in _PER if key in per)
    limit = amounts[0], amounts[-1], unit
    return LeakClass(name, family, *limit, keys, tested, edition, bool(hand))


#: All classes by name, in each family from the tightest.
LEAK_CLASSES: dict[str, LeakClass] = {
    found.name: found for found in map(_made_class, _TABLE.strip().splitlines())
}
#: Classes taken where none are asked for.
USUAL = ("L0.01", "L0.1", "L1")
_LIMIT = re.compile(r"^\s*(\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?)\s*(\D.*)$")
#: What may be written, for messages.
KNOWN = (
    "'L1', 'L0.1', 'L0.01', 'TA Luft', 'VDI 2290', 'VDI 2440', 'ISO 5208 A' (AA, B, C, CC, D, E, EE, F, G), 'API 598', "
    "'FCI 70-2 IV' (V, VI), 'ISO 15848-1 AH' (BH, CH), the name of a standard for all of its classes, or a leakage "
    "with its unit, such as '5 mL/min'"
)


def leak_classes(names: Iterable[str]) -> tuple[LeakClass, ...]:
    """The classes of names such as "L0.01", "ta-luft", "ISO 5208 C"; the name of a standard stands for all of its own.

    Leakages with a unit, such as "5 mL/min", are classes too.

    Raises InputError: a name that is neither.
    """
    return tuple({one.name: one for name in names for one in _named(name)}.values())


def check_classes(names: Iterable[str], diameter: float | None, basis: LeakBasis) -> None:
    """Raise InputError for an unknown class, or one that needs a diameter or another fluid."""
    for one in leak_classes(names):
        one.limit(basis, diameter)


def _named(name: str) -> list[LeakClass]:
    """Classes of a name: of one class, of a family, or a limit such as '1e-6 mg/(s*m)'."""
    if isinstance(name, str):
        key = _class_key(name)
        for kind in ("name", "family"):
            known = LEAK_CLASSES.values()
            if chosen := [one for one in known if _class_key(getattr(one, kind)) == key]:
                return chosen
        with suppress(InputError):  # of another unit
            match = _LIMIT.match(name)
            if match and 0 < (amount := float(match[1])) < inf:
                unit = leak_unit(match[2]).name
                return [LeakClass(f"{amount:g} {unit}", "", amount, amount, unit)]
    raise InputError("classes", shown(name), KNOWN)


#: What people write in names of classes, and what it stands for.
_SAME_NAMES = dict.fromkeys(("rate", "class", "2021", "2015"), "")
_SAME_NAMES |= {"1591-1": "13555", "en 12266-1": "iso 5208"}


def _class_key(name: str) -> str:
    """A name without case, spaces, hyphens and additions that people write."""
    name = name.lower()
    for written, meant in _SAME_NAMES.items():
        name = name.replace(written, meant)
    return name.replace(",", ".").translate(str.maketrans("", "", " -_:")).removesuffix(".0")

"""Leakage classes of standards: the leakage up to which a seal meets a class, all in one table.

EN 13555   L1, L0.1 and L0.01, which EN 1591-1 calculates with: 1, 0.1 and 0.01 mg/(m·s); tested with helium.
TA Luft    2021: 0.01 mg/(m·s) of helium, which are 0.0609 mbar·L/(m·s) at 20 °C.
VDI 2440   1e-4 mbar·L/(m·s) of helium.
ISO 5208   rates A to G of closed valves, in mm³/s times the nominal diameter in mm, for liquids and for gases that leak
           to the atmosphere. A: no visible leakage while the test lasts, here none at all. Edition 2015, table 4.

Other limits are leakages with their unit, such as "5 mL/min". To add a class, add it to the table.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError, shown
from .leak_units import LEAK_UNITS, LeakBasis, leak_unit

#: Molar mass of helium [kg/mol], and the relative tolerance within which a gas is helium.
HELIUM, _SAME_GAS = 4.0026e-3, 0.01
#: A leakage that is the limit up to rounding meets the class.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class LeakClass:
    """A class of leakage: what leaks no more than its limit meets it.

    name : as the standard writes it. family : the standard; "" for a leakage of the user's own.
    amount, unit : the limit, and its unit in `LEAK_UNITS`. gas_amount : that of gases, where it differs.
    per_diameter : whether the amounts are multiplied by the nominal diameter in mm. helium : whether the class is
    defined for helium alone.
    """

    name: str
    family: str
    amount: float
    unit: str
    gas_amount: float | None = None
    per_diameter: bool = False
    helium: bool = False

    def limit(self, basis: LeakBasis, diameter: float | None = None) -> float:
        """Largest leakage per length of seal in the class [m²/s].

        basis : fluid and length of the seal.
        diameter : nominal diameter [m], for the rates of ISO 5208.

        Raises InputError: no diameter for a class that needs it, another gas than helium for a class that is defined
        for it, or a unit that is not for the fluid.
        """
        if self.per_diameter and diameter is None:
            raise InputError("nominal_diameter", f"none for the class {self.name}", "a length > 0, such as '50 mm'")
        if self.helium and not is_helium(basis):
            allowed = "a class for the fluid, or helium as the fluid or the test fluid"
            raise InputError("classes", f"{self.name}, which is defined for helium", allowed)
        unit = LEAK_UNITS[self.unit]
        if lack := basis.lacks(unit):
            fluid = "gas" if basis.is_gas else "liquid"
            raise InputError("classes", f"{self.name}, a limit in {self.unit}, for a {fluid}", lack)
        amount = self.gas_amount if basis.is_gas and self.gas_amount is not None else self.amount
        return amount * basis.factor(unit) * (1e3 * diameter if self.per_diameter and diameter is not None else 1.0)

    def met_by(self, leakage: ArrayLike, basis: LeakBasis, diameter: float | None = None) -> NDArray[np.bool_]:
        """Whether leakages per length of seal [m²/s] of any direction meet the class; NaN does not."""
        return within(leakage, self.limit(basis, diameter))


def within(leakage: ArrayLike, limit: float) -> NDArray[np.bool_]:
    """Whether leakages of any direction are no more than a limit, up to rounding; NaN is not."""
    return np.asarray(np.abs(np.asarray(leakage, dtype=float)) <= limit * (1 + _ROUNDING))


def is_helium(basis: LeakBasis) -> bool:
    """Whether the fluid is helium, by its molar mass."""
    return basis.molar_mass is not None and abs(basis.molar_mass / HELIUM - 1) < _SAME_GAS


#: Rates of ISO 5208: mm³/s per mm of nominal diameter, of liquids and of gases.
_ISO_5208 = {"A": (0.0, 0.0), "AA": (0.006, 0.18), "B": (0.01, 0.3), "C": (0.03, 3.0), "CC": (0.08, 22.3),
             "D": (0.1, 30.0), "E": (0.3, 300.0), "EE": (0.39, 470.0), "F": (1.0, 3000.0),
             "G": (2.0, 6000.0)}  # fmt: skip
_CLASSES = (
    *(LeakClass(f"L{amount:g}", "EN 13555", amount, "mg/(m·s)") for amount in (0.01, 0.1, 1.0)),
    LeakClass("TA Luft", "TA Luft", 0.01, "mg/(m·s)", helium=True),
    LeakClass("VDI 2440", "VDI 2440", 1e-4, "mbar·L/(m·s)", helium=True),
    *(LeakClass(f"ISO 5208 {rate}", "ISO 5208", *amounts[:1], "mm³/s", amounts[1], per_diameter=True)
      for rate, amounts in _ISO_5208.items()),
)  # fmt: skip
#: All classes by name, in each family from the tightest.
LEAK_CLASSES: dict[str, LeakClass] = {found.name: found for found in _CLASSES}
#: Classes taken where none are asked for.
USUAL = ("L0.01", "L0.1", "L1")
_LIMIT = re.compile(r"^\s*(\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?)\s*(\D.*)$")
#: What may be written, for messages.
KNOWN = (
    "'L1', 'L0.1', 'L0.01', 'TA Luft', 'VDI 2440', 'ISO 5208 A' (AA, B, C, CC, D, E, EE, F, G), the name of a standard "
    "for all of its classes, or a leakage with its unit, such as '5 mL/min'"
)


def leak_classes(names: Iterable[str]) -> tuple[LeakClass, ...]:
    """The classes of names such as "L0.01", "ta-luft", "ISO 5208 C"; the name of a standard stands for all of its own.

    Leakages with a unit, such as "5 mL/min", are classes too.

    Raises InputError: a name that is neither.
    """
    found: dict[str, LeakClass] = {}
    for name in names:
        for one in _named(name):
            found[one.name] = one
    return tuple(found.values())


def check_classes(names: Iterable[str], diameter: float | None, basis: LeakBasis) -> None:
    """Raise InputError for an unknown class, or one that needs a diameter or another fluid."""
    for one in leak_classes(names):
        if not np.isfinite(one.limit(basis, diameter)):
            raise InputError("classes", one.name, "a class with a limit")


def _named(name: str) -> list[LeakClass]:
    """Classes of a name: of one class, of a family, or a limit such as '1e-6 mg/(s*m)'."""
    if isinstance(name, str):
        key = _key(name)
        if chosen := [c for c in _CLASSES if key == _key(c.name)] or [c for c in _CLASSES if key == _key(c.family)]:
            return chosen
        if match := _LIMIT.match(name):
            try:
                unit = leak_unit(match[2])
            except InputError:
                raise InputError("classes", shown(name), KNOWN) from None
            if 0 < (amount := float(match[1])) < inf:
                return [LeakClass(f"{amount:g} {unit.name}", "", amount, unit.name)]
    raise InputError("classes", shown(name), KNOWN)


def _key(name: str) -> str:
    """A name without case, spaces, hyphens and additions that people write."""
    for part in ("rate", "class", "2021", "2015", "1591-1"):
        name = name.lower().replace(part, {"1591-1": "13555"}.get(part, ""))
    return name.replace(",", ".").translate(str.maketrans("", "", " -_:")).removesuffix(".0")

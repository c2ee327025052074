"""Look up the leakage classes of standards, and the limits of the leakage that they set.

The table `_TABLE` contains the limits of the classes and the edition of each standard. The limits of ISO 5208, which EN
12266-1 has adopted, apply to closed valves and are multiplied by the nominal diameter in mm. Class A of ISO 5208
requires that no leakage is visible during the test; here it requires a leakage of 0. The limits of API 598 and FCI 70-2
apply to the seat of a valve and depend on its diameter. Likewise, the limits of ISO 15848-1 apply to the valve stem and
depend on the stem diameter.

Instead of a class, the user can give a limit of the leakage with its unit, such as "5 mL/min".
"""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import inf, isnan
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .errors import InputError, shown
from .leak_rates import LeakBasis
from .leak_units import LEAK_UNITS, leak_unit
from .validate import Flags, reals

#: Molar mass of helium [kg/mol], and relative deviation from it up to which a gas counts as helium.
HELIUM, _SAME_GAS = 4.0026e-3, 0.01
#: Relative tolerance within which a leakage still meets a limit, for rounding errors.
_ROUNDING = 1e-9
#: An inch [m] and a pound per square inch [Pa].
_INCH, _PSI = 0.0254, 6894.757
#: Class VI of FCI 70-2: diameters of the seat [m] and limits [mL/min].
_VI_DIAMETERS = np.array([25, 38, 51, 64, 76, 102, 152, 203, 250, 300, 350, 400]) * 1e-3
_VI_LIMITS = np.array([0.15, 0.30, 0.45, 0.60, 0.90, 1.70, 4.00, 6.75, 11.1, 16.0, 21.6, 28.4])


def _nominal_inches(diameter: float) -> float:
    """Convert a nominal diameter [m] to the nominal pipe size of API 598, in inches rounded down to half inches.

    Return 0 for pipe sizes up to 2 inches, for which API 598 allows no leakage.
    """
    # a nominal inch has 25 mm; the small number keeps rounding errors from reducing a size
    size = int(2 * diameter / 0.025 + 1e-9) / 2
    return size if size > 2 else 0.0


def _class_vi(diameter: float) -> float:
    """Return the limit of class VI [mL/min] for a seat diameter [m].

    Between two diameters in the standard's table, the limit is interpolated linearly over the squared diameter. Above
    the largest diameter of the table, the limit is NaN.
    """
    limit = np.interp(diameter**2, _VI_DIAMETERS**2, _VI_LIMITS, right=np.nan)
    return float(limit)


class _Multiplier(NamedTuple):
    """Describe a quantity by which the limit of a leakage class is multiplied, such as the nominal diameter.

    key : name of the quantity in a case file.
    example : example of a value that a user may give, for messages.
    factor : function that computes the factor of the limit from the quantity in SI units.
    """

    key: str
    example: str
    factor: Callable[[float], float]


_LENGTH = "a length > 0, such as '50 mm'"
_LENGTH_OF_CLASS_VI = "a length from 0 to 400 mm, such as '50 mm'"
_CAPACITY = "the flow of the open valve in the test, such as '100 L/min'"
#: Quantities by which the limits of classes are multiplied, by their name in `_TABLE`.
_MULTIPLIERS = {
    "mm": _Multiplier("nominal_diameter", _LENGTH, lambda d: 1e3 * d),
    "inch": _Multiplier("nominal_diameter", _LENGTH, lambda d: d / _INCH),
    "NPS": _Multiplier("nominal_diameter", _LENGTH, _nominal_inches),
    "class VI": _Multiplier("nominal_diameter", _LENGTH_OF_CLASS_VI, _class_vi),
    "psi": _Multiplier("pressure_drop", "the pressures of the fluid", lambda p: p / _PSI),
    "capacity": _Multiplier("rated_capacity", _CAPACITY, float),
}


@dataclass(frozen=True)
class LeakClass:
    """Describe a leakage class. A seal meets the class if its leakage does not exceed the limit.

    Parameters
    ----------
    name : str
        Name in the standard.
    family : str
        The standard, or "" for a user-defined limit.
    amount, gas_amount : float
        Limit for liquids and for gases, in `unit`.
    unit : str
        Name of a unit in `LEAK_UNITS`.
    per : tuple of str
        Names in `_MULTIPLIERS` of the quantities by which the limit is multiplied.
    tested : str
        Only fluid for which the class is defined, or "" if it is defined for all fluids.
    edition : str
        Edition of the standard.
    second_hand : bool
        Whether the limit comes from secondary sources instead of the text of the standard.
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
        """Whether the limit depends on the nominal diameter of a valve."""
        return any(_MULTIPLIERS[name].key == "nominal_diameter" for name in self.per)

    def limit(self, basis: LeakBasis, diameter: float | None = None) -> float:
        """Return the largest leakage per length of seal [m²/s] that the class allows.

        Parameters
        ----------
        basis : LeakBasis
            Fluid and length of the seal. It must also contain the pressure drop or the rated capacity if the limit
            depends on it.
        diameter : float, optional
            Nominal diameter of the valve, its seat or its stem [m], if the limit depends on it.

        Raises
        ------
        InputError
            A quantity on which the limit depends is missing or out of range, or the class is not defined for the fluid.
        """
        self._check_fluid(basis)
        known = {
            "nominal_diameter": diameter,
            "pressure_drop": basis.pressure_drop,
            "rated_capacity": basis.capacity,
        }
        amount = self.gas_amount if basis.is_gas else self.amount
        for name in self.per:
            key, expected, factor = _MULTIPLIERS[name]
            value = known[key]
            if value is None:
                raise InputError(key, f"none for the class {self.name}", expected)
            amount *= factor(value)
            if isnan(amount):
                raise InputError(key, f"{value:g} for the class {self.name}", expected)
        return amount * basis.factor(LEAK_UNITS[self.unit])

    def _check_fluid(self, basis: LeakBasis) -> None:
        """Raise InputError if the class, or the unit of its limit, is not defined for the fluid."""
        fluid = "gas" if basis.is_gas else "liquid"
        is_helium = basis.molar_mass is not None and abs(basis.molar_mass / HELIUM - 1) < _SAME_GAS
        if self.tested not in ("", fluid, "helium" if is_helium else ""):
            given = f"{self.name}, which is defined for {self.tested}"
            expected = f"a class for the fluid, or {self.tested} as the fluid or the test fluid"
            raise InputError("classes", given, expected)
        alternative = basis.lacks(LEAK_UNITS[self.unit])
        if alternative:
            given = f"{self.name}, a limit in {self.unit}, for a {fluid}"
            raise InputError("classes", given, alternative)


def within(leakage: ArrayLike, limit: float) -> Flags:
    """Return whether the absolute values of leakages are within a limit, apart from rounding errors; False for NaN."""
    return np.abs(reals(leakage)) <= limit * (1 + _ROUNDING)


#: Leakage classes. Columns: name, standard, limit for liquids and, if it differs, for gases, unit, multipliers (see
#: `_MULTIPLIERS`; several are joined by "+"), only fluid for which the class is defined, edition, and whether the limit
#: is from secondary sources. The limits of ISO 15848-1 are 1e-5, 1e-4 and 1e-2 mg/s of helium per metre of the
#: circumference of the stem, which is π times its diameter. The standard also states 1.78e-7, 1.78e-6 and 1.78e-4
#: mbar·L/s per mm of the diameter, which are the same masses at 0 °C. In API 598, 16 drops or 100 bubbles make 1 mL.
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
FCI 70-2 V     | FCI 70-2    | 5e-4          | mL/min       | inch+psi | liquid | 2006          | second hand
FCI 70-2 IV    | FCI 70-2    | 1e-4          | m³/s         | capacity |        | 2006          | second hand
ISO 15848-1 AH | ISO 15848-1 | 3.1416e-8     | mg/s         | mm       | helium | 2015          | second hand
ISO 15848-1 BH | ISO 15848-1 | 3.1416e-7     | mg/s         | mm       | helium | 2015          | second hand
ISO 15848-1 CH | ISO 15848-1 | 3.1416e-5     | mg/s         | mm       | helium | 2015          | second hand
"""


def _parse_class(line: str) -> LeakClass:
    """Read a class from a line of the table."""
    name, family, limits, unit, per, tested, edition, source = (
        column.strip() for column in line.split("|")
    )
    amounts = [float(limit) for limit in limits.split()]
    return LeakClass(
        name=name,
        family=family,
        amount=amounts[0],
        gas_amount=amounts[-1],
        unit=unit,
        per=tuple(per.split("+")) if per else (),
        tested=tested,
        edition=edition,
        second_hand=source == "second hand",
    )


#: All classes by name. Most standards begin with their tightest class.
LEAK_CLASSES: dict[str, LeakClass] = {
    leak_class.name: leak_class for leak_class in map(_parse_class, _TABLE.strip().splitlines())
}
#: Classes that are reported if the user asks for none.
USUAL_CLASSES = ("L0.01", "L0.1", "L1")
#: A number and a unit.
_LIMIT = re.compile(r"^\s*(\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?)\s*(\D.*)$")
#: Classes that a user may write, for messages.
KNOWN = (
    "'L1', 'L0.1', 'L0.01', 'TA Luft', 'VDI 2290', 'VDI 2440', 'ISO 5208 A' (AA, B, C, CC, D, E, EE, F, G), 'API 598', "
    "'FCI 70-2 IV' (V, VI), 'ISO 15848-1 AH' (BH, CH), the name of a standard for all of its classes, or a leakage "
    "with its unit, such as '5 mL/min'"
)


def find_leak_classes(names: Iterable[str]) -> tuple[LeakClass, ...]:
    """Look up leakage classes by their names, and return each class once.

    Parameters
    ----------
    names : iterable of str
        Names of classes, such as "L0.01", "ta-luft" or "ISO 5208 C"; names of standards, which stand for all of their
        classes; or leakages with a unit, such as "5 mL/min".

    Raises
    ------
    InputError
        A name is neither a class or standard nor a leakage with a unit.
    """
    classes = {}
    for name in names:
        for leak_class in _find_by_name(name):
            classes[leak_class.name] = leak_class
    return tuple(classes.values())


def check_classes(names: Iterable[str], diameter: float | None, basis: LeakBasis) -> None:
    """Raise InputError if a class is unknown, is not defined for the fluid, or needs a diameter that is missing."""
    for leak_class in find_leak_classes(names):
        leak_class.limit(basis, diameter)


def _find_by_name(name: str) -> list[LeakClass]:
    """Return the class of a given name, all classes of a standard, or a class for a limit such as '1e-6 mg/(s*m)'."""
    if not isinstance(name, str):
        raise InputError("classes", shown(name), KNOWN)
    key = _class_key(name)
    classes = LEAK_CLASSES.values()
    with_name = [leak_class for leak_class in classes if _class_key(leak_class.name) == key]
    if with_name:
        return with_name
    of_standard = [leak_class for leak_class in classes if _class_key(leak_class.family) == key]
    if of_standard:
        return of_standard
    limit = _parse_limit(name)
    if limit is None:
        raise InputError("classes", shown(name), KNOWN)
    return [limit]


def _parse_limit(text: str) -> LeakClass | None:
    """Read a limit with its unit, such as '1e-6 mg/(s*m)'; return None for any other text."""
    match = _LIMIT.match(text)
    if match is None:
        return None
    amount = float(match[1])
    if not 0 < amount < inf:
        return None
    try:
        unit = leak_unit(match[2]).name
    except InputError:
        return None
    return LeakClass(f"{amount:g} {unit}", "", amount, amount, unit)


#: Parts of class names that are replaced before names are compared.
_SAME_NAMES = dict.fromkeys(("rate", "class", "2021", "2015"), "")
_SAME_NAMES |= {"1591-1": "13555", "en 12266-1": "iso 5208"}


def _class_key(name: str) -> str:
    """Simplify a class name for comparisons: without capitals, spaces, hyphens and words such as "class"."""
    key = name.lower()
    for written, replacement in _SAME_NAMES.items():
        key = key.replace(written, replacement)
    key = key.replace(",", ".")
    return key.translate(str.maketrans("", "", " -_:")).removesuffix(".0")

"""Define the units of leakage, and read their many spellings.

A unit is an amount per time, or an amount per time and per length of seal. To add a unit, add its amount to `_AMOUNTS`
and its name to `_NAMES`. Spellings are read factor by factor, so that "mbar l/s", "mbar*l/s" and "mbar·L·s⁻¹" are the
same unit.
"""

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from .errors import InputError, shown
from .validate import reals

Kind = Literal["volume", "mass", "throughput", "standard", "drops", "bubbles"]


@dataclass(frozen=True)
class LeakUnit:
    """Describe a unit of leakage.

    Parameters
    ----------
    name : str
        Name of the unit in its usual spelling.
    kind : str
        Quantity that the unit measures per time: "volume", "mass", "throughput" (pressure × volume), "standard"
        (standard volume of a gas), "drops" or "bubbles".
    si : float
        Size of the unit in the SI unit of its kind: m³/s for volumes and standard volumes, kg/s for masses, Pa·m³/s for
        pressure × volume, and 1/s for drops and bubbles. If the unit is a rate per length of seal, `si` is a rate per
        metre, for example in m³/(s·m) for volumes.
    per_length : bool
        Whether the unit is a rate per length of seal.
    """

    name: str
    kind: Kind
    si: float
    per_length: bool


#: Amounts of each kind, in SI.
_AMOUNTS: dict[Kind, dict[str, float]] = {
    "volume": {
        "m³": 1.0,
        "L": 1e-3,
        "mL": 1e-6,
        "cm³": 1e-6,
        "µL": 1e-9,
        "mm³": 1e-9,
        "nL": 1e-12,
        "pL": 1e-15,
    },
    "mass": {"kg": 1.0, "g": 1e-3, "mg": 1e-6, "µg": 1e-9, "oz": 28.349523125e-3},
    "throughput": {
        "Pa·m³": 1.0,
        "mbar·L": 0.1,
        "Torr·L": 101_325 / 760 * 1e-3,
        "atm·cm³": 0.101325,
    },
    "standard": {"std cm³": 1e-6, "std L": 1e-3},
    "drops": {"drops": 1.0},
    "bubbles": {"bubbles": 1.0},
}
#: Times [s].
_TIMES = {"s": 1.0, "min": 60.0, "h": 3600.0, "day": 86_400.0, "year": 365.25 * 86_400.0}
#: All units, grouped by kind; within a kind, units per length of seal come first.
_NAMES = (
    "m²/s, L/(m·s), mL/(m·s), µL/(m·s), nL/(m·s), pL/(m·s), mL/(m·min), mL/(m·h), "
    "m³/s, L/s, L/min, L/h, mL/s, mL/min, mL/h, mL/day, mL/year, cm³/s, cm³/min, cm³/h, µL/s, µL/min, mm³/s, "
    "nL/s, pL/s, "
    "kg/(m·s), g/(m·s), mg/(m·s), µg/(m·s), g/(m·h), "
    "kg/s, g/s, mg/s, µg/s, kg/h, g/h, mg/h, kg/year, g/year, oz/year, "
    "Pa·m³/(m·s), mbar·L/(m·s), Torr·L/(m·s), atm·cm³/(m·s), Pa·m³/s, mbar·L/s, Torr·L/s, atm·cm³/s, "
    "std cm³/(m·s), std cm³/s, std cm³/min, std L/min, drops/s, drops/min, drops/h, bubbles/s, bubbles/min"
)


def _parse_unit(name: str) -> LeakUnit:
    """Make a unit from a name of the form "amount/time" or "amount/(m·time)"."""
    if name == "m²/s":
        return LeakUnit(name, "volume", 1.0, per_length=True)
    amount, _, time = name.partition("/")
    kind = next(kind for kind, amounts in _AMOUNTS.items() if amount in amounts)
    per_length = time.startswith("(m·")
    if per_length:
        time = time.removeprefix("(m·").removesuffix(")")
    return LeakUnit(name, kind, _AMOUNTS[kind][amount] / _TIMES[time], per_length)


#: All units, by their name.
LEAK_UNITS: dict[str, LeakUnit] = {name: _parse_unit(name) for name in _NAMES.split(", ")}
#: Units in which every leakage is reported. Units of gases are left out for liquids.
USUAL_UNITS = ("m²/s", "mL/(m·min)", "mg/(m·s)", "m³/s", "mL/min", "drops/min", "kg/s", "g/year", "Pa·m³/s", "mbar·L/s",
        "std cm³/s")  # fmt: skip
#: Units from which a readable unit is chosen. Key: whether the unit is per length of seal.
_READABLE = {
    True: ("L/(m·s)", "mL/(m·s)", "µL/(m·s)", "nL/(m·s)", "pL/(m·s)"),
    False: ("L/min", "mL/min", "mL/h", "mL/year"),
}

#: Replaces characters that have the same meaning by one spelling.
_CHARACTERS = str.maketrans({"μ": "u", "µ": "u", "²": "2", "³": "3", "⁻": "-", "¹": "1", "^": ""})
#: Spellings of the factors of units. Some, such as "scc", stand for two factors.
_WORDS = {
    "L": "l litre litres liter liters",
    "mL": "ml millilitre milliliter",
    "uL": "ul",
    "nL": "nl",
    "pL": "pl",
    "cm3": "cc ccm",
    "std cm3": "scc Ncc Ncm3 Nml NmL",
    "std L": "sl sL Nl NL",
    "std": "standard STD Std",
    "Torr": "torr",
    "mbar": "mBar",
    "s": "sec second seconds",
    "min": "minute minutes",
    "h": "hr hrs hour hours",
    "day": "d days",
    "year": "a y yr years",
    "drops": "drop",
    "bubbles": "bubble",
    "m": "metre meter",
}
_SAME_WORD = {word: factor for factor, words in _WORDS.items() for word in words.split()}
#: Abbreviations of a whole unit, in lower case.
_ABBREVIATIONS = {
    "sccm": "std cm³/min",
    "sccs": "std cm³/s",
    "slm": "std L/min",
    "slpm": "std L/min",
    "lpm": "L/min",
}
_CUBIC_FEET = "std L/min (at 0 °C and 101 325 Pa), as standard cubic feet are at 60 °F for some, at 70 °F for others"
#: Abbreviations in lower case that may mean several units, and what to write instead.
_AMBIGUOUS = {
    "ccm": "cm³/min for a volume per minute, or sccm for one at 0 °C and 101 325 Pa",
    "gpm": "L/min, as there are gallons of two sizes",
    "scfh": _CUBIC_FEET,
    "scfm": _CUBIC_FEET,
    "scfd": _CUBIC_FEET,
}
#: A factor, perhaps with the power -1, or a character between factors.
_FACTOR = re.compile(r"(?P<word>[A-Za-z]+[23]?)(?P<inverse>-1)?|(?P<between>[·*×./()\s-])")

#: Factors of the numerator and of the denominator, each in alphabetical order.
_Factors = tuple[tuple[str, ...], tuple[str, ...]]


def leak_unit(text: str) -> LeakUnit:
    """Read a unit of leakage, such as "mL/(min*m)", "Pa*m^3/s", "mbar l/s", "sccm" or "atm-cc/s".

    Raises
    ------
    InputError
        The unit is unknown or ambiguous.
    """
    expected = f"one of {', '.join(LEAK_UNITS)}"
    if isinstance(text, str):
        short = text.strip().lower()
        if short in _AMBIGUOUS:
            raise InputError("leakage_unit", shown(text), _AMBIGUOUS[short])
        name = _BY_FACTORS.get(_factors(_ABBREVIATIONS.get(short, text)))
        if name is not None:
            return LEAK_UNITS[name]
    raise InputError("leakage_unit", shown(text), expected)


def _factors(text: str) -> _Factors:
    """Split the text of a unit into the factors of its numerator and of its denominator.

    Everything after a slash belongs to the denominator, because people write mg/s·m for mg/(s·m). If the unit cannot be
    read, both tuples are empty.

    >>> _factors("mbar·L/s"), _factors("mg/s·m")
    ((('L', 'mbar'), ('s',)), (('mg',), ('m', 's')))
    """
    plain = text.translate(_CHARACTERS)
    above: list[str] = []
    below: list[str] = []
    after_slash = False
    end = 0
    for match in _FACTOR.finditer(plain):
        if match.start() != end:
            return (), ()
        end = match.end()
        word = match["word"]
        if match["between"] == "/" or word == "per":
            after_slash = True
        elif word:
            factors = below if after_slash or match["inverse"] else above
            factors += _SAME_WORD.get(word, word).split()
    if end != len(plain):
        return (), ()
    if "std" in above:
        above = ["cm3" if factor == "mL" else factor for factor in above]
    return tuple(sorted(above)), tuple(sorted(below))


_BY_FACTORS: dict[_Factors, str] = {_factors(name): name for name in LEAK_UNITS}


def leakage_unit(values: ArrayLike) -> tuple[float, str]:
    """Choose one readable unit for all given leakages per length of seal [m²/s].

    The unit is chosen such that the median of all non-zero leakages is a readable number.

    Returns
    -------
    value : float
        Size of the unit [m²/s].
    name : str
        Name of the unit.

    Examples
    --------
    >>> leakage_unit([0.0, 3e-9, 4e-7, 2e-8])
    (1e-09, 'µL/(m·s)')
    """
    unit = readable_unit(values, per_length=True)
    return unit.si, unit.name


def readable_unit(values: ArrayLike, per_length: bool) -> LeakUnit:
    """Choose a unit of volume rate in which the median leakage is a readable number.

    Parameters
    ----------
    values : array_like
        Leakages in m²/s if `per_length`, otherwise in m³/s. Leakages that are 0 or undefined have no influence on the
        unit.
    per_length : bool
        Whether the leakages are per length of seal.
    """
    sizes = np.abs(np.ravel(reals(values)))
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
    median = float(np.median(sizes)) if sizes.size else 1e-9
    units = [LEAK_UNITS[name] for name in _READABLE[per_length]]
    for unit in units:
        if median >= unit.si * (1 - 1e-12):
            return unit
    return units[-1]

"""Convert between quantities with units as text and numbers in SI: '210 GPa' -> 210e9.

This module alone reads and writes quantities with units. All other modules use numbers in SI units.
"""

import re
from functools import cache, lru_cache
from math import degrees, inf, isfinite, isnan
from typing import Any, NamedTuple, SupportsInt

from .errors import InputError, shown

_DECIMAL_COMMA = re.compile(r"\d,\d")
#: Longest text that can be a quantity [characters].
_LONGEST = 80
#: Parts of a unit: an exponent such as "^2", "-1" or "²", a name such as "mm" or "°C", a name with an exponent, and a
#: product or quotient of these.
_EXPONENT = r"(?:(?:\^|\*\*)?[-+]?\d{1,2}|⁻?[¹²³⁴⁵⁶])"
_NAME = r"(?:[^\W\d_]|[°%])+(?:(?:_|\d+)[^\W\d_]+)*"
_FACTOR = rf"(?:1|{_NAME}{_EXPONENT}?)"
_PRODUCT = rf"{_FACTOR}(?:(?:\s*(?:\*|/|·|\.)\s*|\s+){_FACTOR})*"
#: Texts that are passed to the parser of units: products and quotients of names with exponents, and simple brackets.
_UNIT = re.compile(_PRODUCT.replace(_FACTOR, rf"(?:{_FACTOR}|\(\s*{_PRODUCT}\s*\))"))
#: An exponent without "^", such as the exponent 2 in "mm2".
_BARE_EXPONENT = re.compile(r"(?<=[^\W\d_])([-+]?\d)(?!\d*[^\W\d_])")
#: The "s" of "Pas" and "mPas", which the parser of units would take for a plural instead of a second.
_PASCAL_SECOND = re.compile(r"(?<=Pa)s\b")
_NUMBER_AND_UNIT = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*)?$")
#: Celsius and Fahrenheit in all their spellings. The zero of both scales is not absolute zero.
_TEMPERATURE = re.compile(
    r"(?:(?:[°º]|deg(?:rees?)?)[\s_]?)?([CF]|celsius|fahrenheit)|[℃℉]", re.IGNORECASE
)
#: The end of a gauge or absolute pressure: "(g)" or "(a)", a word, or a letter after bar, psi or Pa.
_REFERENCE = re.compile(
    r"\s?(?:\(\s?([gaü])\s?\)|(?:(?<=bar)|(?<=psi)|(?<=Pa))\s?([gaü])|\s([ga])(?:auge|bs(?:olute)?))\s?$",
    re.IGNORECASE,
)
#: Prefixes that are used when a value is printed: (factor, text).
_PREFIXES = [
    (1e9, "G"),
    (1e6, "M"),
    (1e3, "k"),
    (1.0, ""),
    (1e-3, "m"),
    (1e-6, "µ"),
    (1e-9, "n"),
    (1e-12, "p"),
]
#: Turns "kg/m^3" into "kg/m³" and "Pa*s" into "Pa·s".
_SIGNS = str.maketrans("*23", "·²³", "^")
#: Spellings that the parser of units does not know or misunderstands. A mil is a thousandth of an inch here; the
#: parser takes it for an angle.
_SPELLINGS = {
    "mil": "thou",
    "mils": "thou",
    "Torr": "torr",
    "mTorr": "millitorr",
    "Msi": "megapsi",
    "msi": "megapsi",
    "kp": "kgf",
    "mmWC": "mmH2O",
    "mmWS": "mmH2O",
    "inWC": "inH2O",
}
#: Units that are sometimes written by mistake in place of a unit of another kind, and the unit that was probably meant.
_MISTAKEN = {"kg": "kgf", "lb": "lbf", "lbs": "lbf", "micron": "mTorr", "microns": "mTorr"}
_WORD = re.compile(r"[^\W\d_]+")
#: Kelvins per degree Fahrenheit.
_FAHRENHEIT = 1 / 1.8
#: Absolute temperature at 0 °F [°F above absolute zero] and at 0 °C [K].
_FAHRENHEIT_ZERO, _CELSIUS_ZERO = 459.67, 273.15
#: An example of a value for each unit, for messages.
_EXAMPLES = {
    "Pa": "10 MPa",
    "m": "1.5 mm",
    "Pa*s": "1 mPa*s",
    "K": "20 °C",
    "kg/m^3": "870 kg/m^3",
    "kg/mol": "29 g/mol",
    "1/Pa": "20 1/GPa",
}
#: Common units with their SI unit and factor, for which the parser of units, which is slow to import, is not needed.
_USUAL = {"kg/m^3": ("kg/m^3", 1.0)} | {
    prefix + name: (unit, factor * size)
    for factor, prefix in [*_PREFIXES, (1e-6, "u")]
    for name, unit, size in [
        ("Pa", "Pa", 1.0),
        ("bar", "Pa", 1e5),
        ("m", "m", 1.0),
        ("Pa*s", "Pa*s", 1.0),
    ]
}


@cache
def _registry() -> Any:
    """Load the parser of units."""
    import pint

    return pint.UnitRegistry()


class OtherKind(InputError):
    """Report a value that is not a finite number with a unit of the expected kind."""


def to_si(text: object, unit: str, name: str = "quantity", like: str = "") -> float:
    """Convert a quantity given as text with its unit to a number in SI.

    Parameters
    ----------
    text : str
        For example ``"210 GPa"``, ``"1 mm"`` or ``"20 °C"``. A plain number is accepted only if `unit` is "".
    unit : str
        The expected SI unit, for example "Pa", "m" or "Pa*s", or "" for a plain number.
    name : str
        Name of the value, for the error message.
    like : str
        An example of the value for the error message, such as "300 MPa".

    Raises
    ------
    InputError
        The unit is missing or of another kind, the number has a decimal comma, or it is not finite.

    Examples
    --------
    >>> to_si("210 GPa", "Pa")
    210000000000.0
    >>> to_si("20 °C", "K")
    293.15
    >>> to_si("1,5 mm", "m", "d")
    Traceback (most recent call last):
    femseal.base.errors.InputError: d: given '1,5 mm', expected a number with a decimal point and no comma
    """
    given = _GivenQuantity(text, unit, name, like)
    is_plain_number = isinstance(text, (int, float)) and not isinstance(text, bool)
    if unit == "" and is_plain_number:
        try:
            value = float(text)  # type: ignore[arg-type]
        except OverflowError:  # an integer that is too large for a floating-point number
            value = inf
    else:
        number, given_unit = _parse(given)
        value = _convert(given, number, given_unit)
    if not isfinite(value):
        raise given.kind_error()
    return value


class _GivenQuantity(NamedTuple):
    """A value that `to_si` converts, with its arguments, which are used in error messages."""

    text: object
    unit: str
    name: str
    like: str

    @property
    def expected(self) -> str:
        """Description of the kind of quantity that is expected, with an example."""
        if not self.unit:
            return "a finite number"
        example = self.like or _EXAMPLES.get(self.unit, f"1 {self.unit}")
        return f"text with a number and a unit of the kind {self.unit!r}, such as {example!r}"

    def error(self, expected: str) -> InputError:
        """Make the error for a value that does not agree with the text `expected`."""
        return InputError(self.name, shown(self.text), expected)

    def kind_error(self, hint: str = "") -> OtherKind:
        """Make the error for a value that is not a quantity of the expected kind; `hint` is added to the message."""
        return OtherKind(self.name, shown(self.text), self.expected + hint)


def _parse(given: _GivenQuantity) -> tuple[float, str]:
    """Divide a text into its number and its unit, which is "" if there is none; raise InputError for other texts.

    The unit is not checked.
    """
    text = given.text
    if not isinstance(text, str):
        raise given.kind_error()
    if len(text) > _LONGEST:
        raise given.kind_error(f", not longer than {_LONGEST} characters")
    if given.unit == "Pa" and _REFERENCE.search(text):
        plain = shown(_REFERENCE.sub("", text))
        reason = "only the fluid pressures of a case can be gauge or absolute"
        raise given.error(f"a pressure without (g) or (a), such as {plain}: {reason}")
    if _DECIMAL_COMMA.search(text):
        raise given.error("a number with a decimal point and no comma")
    match = _NUMBER_AND_UNIT.match(text)
    if match is None or (match[2] is None and given.unit):
        raise given.kind_error()
    return float(match[1]), (match[2] or "").strip()


def _convert(given: _GivenQuantity, number: float, given_unit: str) -> float:
    """Convert a number with its unit to the expected SI unit; raise InputError if the unit is of another kind."""
    if given.unit == "K":
        kelvin = _kelvin(number, given_unit)
        if kelvin is not None and kelvin < 0:
            example = given.like or "20 °C"
            expected = f"a temperature not below absolute zero, -273.15 °C, such as {example!r}"
            raise given.error(expected)
        if kelvin is not None:
            return kelvin
    if given_unit and not _UNIT.fullmatch(given_unit):
        raise given.kind_error()
    factor = _factor(given_unit, given.unit)
    if factor is None:
        raise given.kind_error(_hint(given_unit, given.unit))
    return _rounded(number * factor)


def _rounded(value: float) -> float:
    """Round a converted value to 15 digits, because factors of units are not exactly representable in binary.

    For example, 3 times 1e-6 becomes exactly the number 3e-6.
    """
    return float(f"{value:.15g}")


def _kelvin(number: float, unit: str) -> float | None:
    """Convert a temperature to kelvin without a range check; return None if `unit` is not a temperature unit."""
    scale = _TEMPERATURE.fullmatch(unit)
    if scale is not None:
        # the group of the pattern is the letter or name of the scale; ℃ and ℉ match without a group
        first_letter = (scale[1] or unit)[0]
        if first_letter in "fF℉":
            return _rounded((number + _FAHRENHEIT_ZERO) * _FAHRENHEIT)
        return _rounded(number + _CELSIUS_ZERO)
    factor = _factor(unit, "K") if _UNIT.fullmatch(unit) else None
    return None if factor is None else _rounded(number * factor)


def _hint(given_unit: str, unit: str) -> str:
    """Suggest a unit of the expected kind that the user may have meant; return "" without a suggestion."""
    same_letters = [
        name
        for name, (kind, _) in _USUAL.items()
        if kind == unit and name.lower() == given_unit.lower()
    ]
    if same_letters:
        return f"; capitals count: {' or '.join(same_letters)}"
    suggestion = _WORD.sub(lambda word: _MISTAKEN.get(word[0], word[0]), given_unit)
    if suggestion != given_unit and _factor(suggestion, unit) is not None:
        return f"; {given_unit} is of another kind, perhaps meant: {suggestion}"
    return ""


def absolute_pressure(text: object, ambient: float, name: str = "quantity") -> float | None:
    """Convert a gauge or absolute pressure, given as text such as "10 bar(g)", to an absolute pressure [Pa].

    Gauge pressures, such as "10 bar(g)", "10 barg" or "150 psig", are relative to the ambient pressure. Absolute
    pressures look like "10 bar(a)".

    Parameters
    ----------
    text : object
        The pressure.
    ambient : float
        Ambient pressure [Pa].
    name : str
        Name of the value, for the error message.

    Returns
    -------
    float or None
        None if the text does not say whether the pressure is gauge or absolute.

    Raises
    ------
    InputError
        The text is not a pressure, or the absolute pressure is negative.

    Examples
    --------
    >>> absolute_pressure("10 bar(g)", 101325.0), absolute_pressure("10 bara", 101325.0)
    (1101325.0, 1000000.0)
    """
    if not isinstance(text, str) or len(text) > _LONGEST:
        return None
    mark = _REFERENCE.search(text)
    if mark is None:
        return None
    is_gauge = bool({"g", "G", "ü", "Ü"} & {*mark.groups()})
    reference = ambient if is_gauge else 0.0
    try:
        pressure = to_si(text[: mark.start()], "Pa", name) + reference
    except InputError as error:
        raise InputError(name, shown(text), error.expected) from None
    if pressure < 0:
        vacuum = to_text(0.0 - reference, "Pa")
        raise InputError(
            name, shown(text), f"a pressure of at least {vacuum}, the pressure of a vacuum"
        )
    return pressure


@lru_cache(maxsize=1000)
def _factor(given_unit: str, unit: str) -> float | None:
    """Return the factor that converts a unit to an SI unit; None if the unit is unknown or of another kind."""
    if given_unit in _USUAL:
        kind, factor = _USUAL[given_unit]
        return factor if kind == unit else None
    spelling = _WORD.sub(lambda word: _SPELLINGS.get(word[0], word[0]), given_unit)
    spelling = spelling.replace(".", "*")
    spelling = _PASCAL_SECOND.sub("*s", spelling)  # mPas -> mPa*s
    spelling = _BARE_EXPONENT.sub(r"^\1", spelling)  # N/mm2 -> N/mm^2
    try:
        parsed = _registry().parse_units(spelling)
        si_unit = unit or "dimensionless"
        at_zero = (0.0 * parsed).to(si_unit).magnitude
        at_one = (1.0 * parsed).to(si_unit).magnitude
    except Exception:
        # the parser raises many kinds of errors for unknown units; all of them mean the same here
        return None
    if at_zero:
        return None  # a scale with another zero, such as °C, cannot be converted by a factor
    return float(at_one)


def to_text(value: float, unit: str, digits: int = 4) -> str:
    """Format an SI value as text, with an SI prefix that makes the number readable.

    Examples
    --------
    >>> to_text(210e9, "Pa"), to_text(6.25e-05, "m"), to_text(0.0, "m")
    ('210 GPa', '62.5 µm', '0 m')
    """
    number, unit_with_prefix = _number_and_unit(value, unit, digits)
    return f"{number} {unit_with_prefix}"


def range_text(low: float, high: float, unit: str, digits: int = 4) -> str:
    """Format a range of SI values as text; if both ends have the same prefix, only the upper end has a unit.

    Examples
    --------
    >>> range_text(150e6, 300e6, "Pa"), range_text(0.5e6, 2e9, "Pa")
    ('150 – 300 MPa', '500 kPa – 2 GPa')
    """
    lower, lower_unit = _number_and_unit(low, unit, digits)
    upper, upper_unit = _number_and_unit(high, unit, digits)
    if lower_unit != upper_unit:
        lower = f"{lower} {lower_unit}"
    return f"{lower} – {upper} {upper_unit}"


def _number_and_unit(value: float, unit: str, digits: int) -> tuple[str, str]:
    """Return a value in SI as a number of few digits, and the unit with the prefix that belongs to this number."""
    if value == 0 or not isfinite(value):
        return f"{value:g}", unit
    fitting = [entry for entry in _PREFIXES if abs(value) >= entry[0] * (1 - 1e-12)]
    factor, prefix = fitting[0] if fitting else _PREFIXES[-1]
    return f"{value / factor:.{digits}g}", f"{prefix}{unit}"


def counted(count: SupportsInt, noun: str) -> str:
    """Format a count with its noun in the singular or plural.

    Examples
    --------
    >>> counted(1, "more step"), counted(2, "cell")
    ('1 more step', '2 cells')
    """
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def unit_text(unit: str) -> str:
    """Format a unit with typographic signs; the unit "1" of a plain number becomes "".

    Examples
    --------
    >>> unit_text("Pa*s"), unit_text("kg/m^3"), unit_text("1")
    ('Pa·s', 'kg/m³', '')
    """
    return "" if unit == "1" else unit.translate(_SIGNS)


def with_its_unit(value: float, unit: str) -> str:
    """Format an SI value with its unit, and with a prefix if the unit can have one.

    Examples
    --------
    >>> with_its_unit(1e-3, "Pa*s"), with_its_unit(1000.0, "kg/m^3"), with_its_unit(0.2, "")
    ('1 mPa·s', '1000 kg/m³', '0.2')
    """
    takes_prefix = unit.startswith(("P", "m", "N", "s")) and "^" not in unit
    if takes_prefix:
        return to_text(value, unit_text(unit))
    return f"{value:.4g} {unit_text(unit)}".rstrip()


def as_text(value: Any, unit: str = "", *, percent: bool = False, joint: str = "", **_: Any) -> str:
    """Format an SI value, or a tuple of values, as readable text.

    Parameters
    ----------
    value : object
        The value in SI, or a tuple of values. Angles are written in degrees, None and NaN as a dash, and truth values
        as "yes" or "no".
    unit : str
        SI unit of the value.
    percent : bool
        Whether to write a fraction as a percentage.
    joint : str
        Text between the values of a tuple. Default: " × " for lengths and whole numbers, otherwise ", ".
    **_
        Ignored, so that all metadata of a field can be passed.

    Examples
    --------
    >>> as_text((1e-6, 2e-6), "m"), as_text(0.5, "rad"), as_text(0.0023, "", percent=True)
    ('1 µm × 2 µm', '28.65°', '0.23 %')
    """
    if isinstance(value, tuple):
        default_joint = " × " if unit == "m" or isinstance(value[0], int) else ", "
        return (joint or default_joint).join(as_text(v, unit, percent=percent) for v in value)
    if value is None or (isinstance(value, float) and isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return str(value)
    if percent:
        return f"{100 * value:.3g} %"
    if unit == "rad":
        return f"{degrees(value):.4g}°"
    if unit == "m":
        return to_text(value, unit)
    return f"{value:.4g} {unit}".strip()

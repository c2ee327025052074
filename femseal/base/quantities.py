"""Quantities as text: '210 GPa' -> 210e9. The only place that knows units as text; everything else is SI."""

import re
from functools import cache, lru_cache
from math import degrees, isfinite, isnan
from typing import Any, SupportsInt

from .errors import InputError, shown

_DECIMAL_COMMA = re.compile(r"\d,\d")
#: Longest text that can be a quantity, in characters.
_LONGEST = 80
_EXPONENT = r"(?:(?:\^|\*\*)?[-+]?\d{1,2}|⁻?[¹²³⁴⁵⁶])"
_NAME = r"(?:[^\W\d_]|[°%])+(?:(?:_|\d+)[^\W\d_]+)*"
_FACTOR = rf"(?:1|{_NAME}{_EXPONENT}?)"
_PRODUCT = rf"{_FACTOR}(?:(?:\s*(?:\*|/|·|\.)\s*|\s+){_FACTOR})*"
#: What may be given to the parser of units: names with exponents, multiplied and divided, brackets one deep.
_UNIT = re.compile(_PRODUCT.replace(_FACTOR, rf"(?:{_FACTOR}|\(\s*{_PRODUCT}\s*\))"))
_BARE_EXPONENT = re.compile(r"(?<=[^\W\d_])([-+]?\d)(?!\d*[^\W\d_])")
#: Pressure times time is often written as one word, which a parser of units takes for a plural.
_PASCAL_SECOND = re.compile(r"(?<=Pa)s\b")
_NUMBER_AND_UNIT = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*)?$")
#: Scales of temperature whose zero is not the absolute one, however they are written.
_TEMPERATURE = re.compile(
    r"(?:(?:[°º]|deg(?:rees?)?)[\s_]?)?([CF]|celsius|fahrenheit)|[℃℉]", re.IGNORECASE
)
#: What a pressure is counted from, gauge or absolute: "(g)", "(a)", a word, or a letter after bar, psi or Pa.
_REFERENCE = re.compile(
    r"\s?(?:\(\s?([gaü])\s?\)|(?:(?<=bar)|(?<=psi)|(?<=Pa))\s?([gaü])|\s([ga])(?:auge|bs(?:olute)?))\s?$",
    re.IGNORECASE,
)
#: Prefixes for people: (factor, text), used when a value is printed.
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
#: Signs of units for people.
_SIGNS = str.maketrans("*23", "·²³", "^")
#: Spellings that the parser of units does not know or takes for something else: a mil is a thousandth of an inch here,
#: and an angle of a wrong size there.
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
#: Spellings that stand for a unit of another kind, and what may have been meant where they do not fit.
_MISTAKEN = {"kg": "kgf", "lb": "lbf", "lbs": "lbf", "micron": "mTorr", "microns": "mTorr"}
_WORD = re.compile(r"[^\W\d_]+")
#: Kelvins per degree Fahrenheit, its zero and that of Celsius above absolute zero in degrees.
_FAHRENHEIT, _FAHRENHEIT_ZERO, _CELSIUS_ZERO = 1 / 1.8, 459.67, 273.15
#: Values by their unit, for messages.
_EXAMPLES = {
    "Pa": "10 MPa",
    "m": "1.5 mm",
    "Pa*s": "1 mPa*s",
    "K": "20 °C",
    "kg/m^3": "870 kg/m^3",
    "kg/mol": "29 g/mol",
    "1/Pa": "20 1/GPa",
}
#: Units of most cases, in SI, for which the parser of units need not be loaded.
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
    import pint

    return pint.UnitRegistry()


def to_si(text: object, unit: str, name: str = "quantity", like: str = "") -> float:
    """Value in SI of a quantity given as text with its unit.

    text : for example ``"210 GPa"``, ``"1 mm"``, ``"20 °C"``. A bare number is refused unless `unit` is "" (a ratio).
    unit : the SI unit of what is expected, for example "Pa", "m", "Pa*s", "" for a plain number.
    name : of the value in an error message. like : a value for that message, such as "300 MPa".

    Raises InputError: no unit, a unit of another kind, a decimal comma, or not a finite number.

    >>> to_si("210 GPa", "Pa")
    210000000000.0
    >>> to_si("20 °C", "K")
    293.15
    >>> to_si("1,5 mm", "m", "d")
    Traceback (most recent call last):
    femseal.base.errors.InputError: d: given '1,5 mm', expected a number with a decimal point and no comma
    """
    example = "a finite number"
    if unit:
        like = like or _EXAMPLES.get(unit, f"1 {unit}")
        example = f"text with a number and a unit of the kind {unit!r}, such as {like!r}"
    if unit == "" and isinstance(text, (int, float)) and not isinstance(text, bool):
        return _finite(float(text), text, name, example)

    def refused(expected: str) -> InputError:
        return InputError(name, shown(text), expected)

    if not isinstance(text, str):
        raise refused(example)
    if len(text) > _LONGEST:
        raise refused(f"{example}, not longer than {_LONGEST} characters")
    if unit == "Pa" and _REFERENCE.search(text):
        plain = shown(_REFERENCE.sub("", text))
        alone = "those of the fluid alone in a case are gauge or absolute"
        raise refused(f"a pressure without (g) or (a), such as {plain}: {alone}")
    if _DECIMAL_COMMA.search(text):
        raise refused("a number with a decimal point and no comma")
    match = _NUMBER_AND_UNIT.match(text)
    if match is None or (match[2] is None and unit):
        raise refused(example)
    written = (match[2] or "").strip()
    if unit == "K":
        kelvin = _kelvin(float(match[1]), written)
        if kelvin is not None:
            if kelvin < 0:
                raise refused(
                    f"a temperature not below absolute zero, -273.15 °C, such as {like or '20 °C'!r}"
                )
            return _finite(kelvin, text, name, example)
    if written and not _UNIT.fullmatch(written):
        raise refused(example)
    if (factor := _factor(written, unit)) is None:
        raise refused(example + _hint(written, unit))
    # 15 digits restore the decimal number as written, although the factor of a prefix is not exact in binary
    return _finite(float(f"{float(match[1]) * factor:.15g}"), text, name, example)


def _kelvin(number: float, written: str) -> float | None:
    """Convert a temperature to kelvin, also below absolute zero; None if the text is no unit of temperature."""
    scale = _TEMPERATURE.fullmatch(written)
    if scale is not None:
        if (scale[1] or written)[0] in "fF℉":
            return (number + _FAHRENHEIT_ZERO) * _FAHRENHEIT
        return number + _CELSIUS_ZERO
    factor = _factor(written, "K") if _UNIT.fullmatch(written) else None
    return None if factor is None else float(f"{number * factor:.15g}")


def _hint(written: str, unit: str) -> str:
    """Say which unit of the wanted kind may have been meant by one that does not fit, "" if none is known."""
    of_kind = (one for one, (kind, _) in _USUAL.items() if kind == unit)
    alike = " or ".join(one for one in of_kind if one.lower() == written.lower())
    if alike:
        return f"; capitals count: {alike}"
    meant = _WORD.sub(lambda word: _MISTAKEN.get(word[0], word[0]), written)
    if meant != written and _factor(meant, unit) is not None:
        return f"; {written} is of another kind, perhaps meant: {meant}"
    return ""


def absolute_pressure(text: object, ambient: float, name: str = "quantity") -> float | None:
    """Absolute pressure [Pa] of text that says what it is counted from; None of any other.

    Gauge pressures, "10 bar(g)", "10 barg" or "150 psig", are above the ambient pressure [Pa]; "10 bar(a)" is absolute.

    Raises InputError: no pressure, or one below that of a vacuum.

    >>> absolute_pressure("10 bar(g)", 101325.0), absolute_pressure("10 bara", 101325.0)
    (1101325.0, 1000000.0)
    """
    if not isinstance(text, str) or len(text) > _LONGEST or not (match := _REFERENCE.search(text)):
        return None
    above = ambient if {"g", "G", "ü", "Ü"} & {*match.groups()} else 0.0
    try:
        pressure = to_si(text[: match.start()], "Pa", name) + above
    except InputError as error:
        raise InputError(name, shown(text), error.expected) from None
    if pressure < 0:
        raise InputError(
            name, shown(text), f"a pressure not below a vacuum, {to_text(0.0 - above, 'Pa')} there"
        )
    return pressure


@lru_cache(maxsize=1000)
def _factor(written: str, unit: str) -> float | None:
    """What a unit is in SI, kept as long lists repeat it; None if it is of another kind or unknown."""
    if written in _USUAL:
        kind, factor = _USUAL[written]
        return factor if kind == unit else None
    known = _WORD.sub(lambda word: _SPELLINGS.get(word[0], word[0]), written)
    try:
        # N/mm2 is N/mm^2, mPas is mPa*s
        spelled = _BARE_EXPONENT.sub(r"^\1", _PASCAL_SECOND.sub("*s", known.replace(".", "*")))
        parsed, wanted = _registry().parse_units(spelled), unit or "dimensionless"
        zero, factor = ((number * parsed).to(wanted).magnitude for number in (0.0, 1.0))
    # a parser of units fails on unknown names in many ways, all of which mean the same
    except Exception:
        return None
    return None if zero else float(factor)  # a scale with another zero has no factor


def _finite(value: float, given: object, name: str, allowed: str) -> float:
    if not isfinite(value):
        raise InputError(name, shown(given), allowed)
    return value


def to_text(value: float, unit: str, digits: int = 4) -> str:
    """A value in SI as text with a readable prefix.

    >>> to_text(210e9, "Pa"), to_text(6.25e-05, "m"), to_text(0.0, "m")
    ('210 GPa', '62.5 µm', '0 m')
    """
    if value == 0 or not isfinite(value):
        return f"{value:g} {unit}"
    factor, prefix = next((p for p in _PREFIXES if abs(value) >= p[0] * (1 - 1e-12)), _PREFIXES[-1])
    return f"{value / factor:.{digits}g} {prefix}{unit}"


def counted(count: SupportsInt, noun: str) -> str:
    """A number of things for a message.

    >>> counted(1, "more step"), counted(2, "piece")
    ('1 more step', '2 pieces')
    """
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def unit_text(unit: str) -> str:
    """A unit as people write it; nothing for a plain number, "1" in declarations of fields.

    >>> unit_text("Pa*s"), unit_text("kg/m^3"), unit_text("1")
    ('Pa·s', 'kg/m³', '')
    """
    return "" if unit == "1" else unit.translate(_SIGNS)


def with_its_unit(value: float, unit: str) -> str:
    """A value in SI as text, with a prefix where its unit takes one.

    >>> with_its_unit(1e-3, "Pa*s"), with_its_unit(1000.0, "kg/m^3"), with_its_unit(0.2, "")
    ('1 mPa·s', '1000 kg/m³', '0.2')
    """
    if unit.startswith(("P", "m", "N", "s")) and "^" not in unit:
        return to_text(value, unit_text(unit))
    return f"{value:.4g} {unit_text(unit)}".rstrip()


def as_text(value: Any, unit: str = "", *, percent: bool = False, joint: str = "", **_: Any) -> str:
    """A value in SI for people: angles in degrees, fractions in per cent, None and NaN as a dash; `joint` between two.

    >>> as_text((1e-6, 2e-6), "m"), as_text(0.5, "rad"), as_text(0.0023, "", percent=True)
    ('1 µm × 2 µm', '28.65°', '0.23 %')
    """
    if isinstance(value, tuple):
        joint = joint or (" × " if unit == "m" or isinstance(value[0], int) else ", ")
        return joint.join(as_text(v, unit, percent=percent) for v in value)
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
    return to_text(value, unit) if unit == "m" else f"{value:.4g} {unit}".strip()

"""Format numbers, durations and errors as text, and prepare plain data for JSON."""

from __future__ import annotations

import json
from math import expm1, isfinite
from typing import Any

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Exponents of ten of the numbers that are written without a power of ten.
_PLAIN_EXPONENTS = range(-4, 6)


def number_text(value: float, digits: int = 3, plain: range = _PLAIN_EXPONENTS) -> str:
    """Format a number other than 0 as readable text, with a power of ten if it is very large or small.

    Parameters
    ----------
    value : float
        The number.
    digits : int
        Number of significant digits.
    plain : range
        Exponents of ten for which a number is written in plain notation, without a power of ten.

    Examples
    --------
    >>> number_text(16634567.0), number_text(1e-12), number_text(99960.0), number_text(-0.012345, 2)
    ('1.66·10⁷', '10⁻¹²', '100000', '-0.012')
    """
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    if int(exponent) in plain:
        rounded = float(f"{value:.{digits}g}")
        return f"{rounded:.15g}"
    power = str(int(exponent)).translate(_SUPERSCRIPTS)
    return f"{float(mantissa):g}·10{power}".removeprefix("1·")


def duration(seconds: float) -> str:
    """Format a duration in a readable unit.

    Examples
    --------
    >>> duration(0.01234), duration(75.0), duration(9000.0)
    ('0.012 s', '75 s', '2.5 h')
    """
    if seconds < 99.5:
        return f"{seconds:.2g} s"
    if seconds < 600:
        return f"{seconds:.0f} s"
    if seconds < 7200:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.2g} h"


def format_deviation(half_width: float, factor: str = "a factor of ") -> str:
    """Format an error of ln(x) as the relative error of x: as a percentage, or as a factor if the error is large.

    Examples
    --------
    >>> format_deviation(0.0953), format_deviation(1.5)
    ('10 %', 'a factor of 4.5')
    >>> format_deviation(800.0), format_deviation(float("inf"))
    ('a factor of more than 10000', 'an unknown factor')
    """
    if not isfinite(half_width):
        return "an unknown factor"
    change = expm1(min(half_width, 10.0))  # the cap avoids an overflow
    if change < 1:
        return f"{100 * change:.2g} %"
    if change < 1e4:
        return f"{factor}{1 + change:.2g}"
    return f"{factor}more than 10000"


def finite_data(data: Any) -> Any:
    """Return a copy of plain data for JSON, in which infinite and undefined numbers are None.

    Examples
    --------
    >>> finite_data({"NaN": [1.0, float("nan"), float("-inf")]})
    {'NaN': [1.0, None, None]}
    """
    # JSON has no infinite or undefined numbers: Python writes them as constants, which are read as None here
    return json.loads(json.dumps(data), parse_constant=lambda _: None)

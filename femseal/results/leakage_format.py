"""Format leakages and their intervals, and choose the unit in which they are shown."""

from __future__ import annotations

import numpy as np

from ..base import number_text, to_text
from ..base.leak_units import LEAK_UNITS, LeakUnit
from ..budget import VAGUE
from .results import Results

#: If the upper end of an interval is at most this many times the lower end, the interval is written with three digits,
#: otherwise with two digits.
_NARROW_RATIO = 1.2


def class_unit(run: Results) -> LeakUnit:
    """Return the unit in which the class leakage is shown.

    In a run without a test fluid, the class leakage has the unit of all leakages of the run. In a run with a test
    fluid, the class leakage has the unit of the case. If this unit does not suit the test fluid, a usual unit for gases
    or liquids is taken.
    """
    if "test_leakage" not in run.dataset:
        return run.leak_unit
    basis, asked = run.class_basis, run.asked_unit
    if asked is not None and basis.has(asked):
        return asked
    return LEAK_UNITS["mbar·L/(m·s)" if basis.is_gas else "mL/(m·min)"]


def leakage_label(run: Results) -> str:
    """Describe the leakage that tables show: per unit length, or of the whole seal with its length."""
    text = leakage_kind(run.leak_unit)
    return text if run.leak_unit.per_length else f"{text}, {to_text(run.leak_basis.length, 'm')},"


def leakage_kind(unit: LeakUnit) -> str:
    """Say whether a unit is for the leakage per unit seal length or for the leakage of the whole seal."""
    return "leakage per length of seal" if unit.per_length else "leakage of the whole seal"


def format_leakage(value: float, factor: float, unit: LeakUnit | None = None) -> str:
    """Format a leakage with three digits, as "sealed" if it is 0, and as "failed" if it is NaN.

    Parameters
    ----------
    value : leakage per unit seal length [m²/s].
    factor : leakage per unit seal length [m²/s] that corresponds to 1 in the unit of the text.
    unit : unit that is written after a number; None for a number without a unit.
    """
    if np.isnan(value):
        return "failed"
    return "sealed" if value == 0 else f"{number_text(value / factor)}{_behind_number(unit)}"


def format_interval(
    low: float, high: float, factor: float, leakage: float, unit: LeakUnit | None = None
) -> str:
    """Format the 95 % interval of a leakage.

    An end of the interval is written as a number with two digits, or with three digits if the interval is narrow. An
    end that differs from the leakage by more than a factor of `VAGUE` is described in words.

    Parameters
    ----------
    low, high : lower and upper ends of the 95 % interval [m²/s].
    factor : leakage per unit seal length [m²/s] that corresponds to 1 in the unit of the text.
    leakage : leakage whose interval is written [m²/s].
    unit : unit that is written after the number of the upper end; None for numbers without a unit.

    Examples
    --------
    >>> format_interval(0.1, 2.0, 1.0, leakage=1.0), format_interval(0.0, 2.0, 1.0, 1.0, LEAK_UNITS["mL/h"])
    ('0.1–2', 'sealed–2 mL/h')
    >>> format_interval(1e-6, 2.0, 1.0, leakage=1.0), format_interval(1e-6, 2e39, 1.0, 1.0, LEAK_UNITS["mL/h"])
    ('≈0–2', '≈0 to > 1000 times')
    """
    magnitude = abs(leakage)
    if np.isnan(low) or np.isnan(high):
        return "unknown"
    if np.isinf(high):
        return "open or sealed" if low == 0 else f"{format_leakage(low, factor, unit)} or more"
    if low == high == 0:
        return "sealed"
    is_narrow = high <= _NARROW_RATIO * low
    digits = 3 if is_narrow else 2
    lower = number_text(low / factor, digits) if low else "sealed"
    upper = f"{number_text(high / factor, digits)}{_behind_number(unit)}" if high else "sealed"
    dash = _dash_after(low)
    # ends that differ from the leakage by more than a factor of `VAGUE`
    if 0 < VAGUE * low < magnitude:
        lower = "≈0"
    if high > VAGUE * magnitude > 0:
        upper = f"> {VAGUE:g} times"
        dash = " to "
    return f"{lower}{dash}{upper}"


def format_scatter(low: float, high: float, factor: float) -> str:
    """Format the leakages at two quantiles of the realisations; see `format_leakage`."""
    lower = format_leakage(low, factor)
    upper = format_leakage(high, factor)
    return lower if lower == upper else f"{lower}{_dash_after(low)}{upper}"


def _dash_after(low: float) -> str:
    """Return the text between the ends of an interval: "to" if a dash after a negative lower end could be misread."""
    return " to " if low < 0 else "–"


def format_upper_end(high: float, factor: float, unit: LeakUnit) -> str:
    """Format the upper end of the 95 % interval of a seal whose computed leakage is zero.

    Parameters
    ----------
    high : upper end of the 95 % interval [m²/s], finite and positive.
    factor : leakage per unit seal length [m²/s] that corresponds to 1 in the unit of the text.
    unit : unit of the text.
    """
    return f"up to {number_text(high / factor, 2)}{_behind_number(unit)}"


def _behind_number(unit: LeakUnit | None) -> str:
    """Return a unit with a space before it, or "" if there is no unit."""
    return "" if unit is None else f" {unit.name}"

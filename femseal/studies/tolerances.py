"""Tolerance of the contact from the accuracy that is wanted of the leakage."""

from __future__ import annotations

from math import log1p

from ..base import validate

#: Tolerance of the contact, and the largest error of ln(leakage) measured with it on six faces, elastic and plastic,
#: from open to a hundredth of the leakage, see `tests/benchmarks/only_what_is_needed.py`.
MEASURED = ((1e-2, 1.1e-2), (1e-3, 6.2e-4), (1e-4, 5.6e-5), (1e-5, 5.7e-6), (1e-6, 4.8e-7), (1e-7, 9.5e-8))
#: Share of the error wanted that the tolerance may cause, and factor on the measured error, for scenes that are worse.
SHARE, SAFETY = 0.1, 3.0


def contact_tolerance(accuracy: float) -> float:
    """The largest tolerance of the contact whose error is a small part of the accuracy wanted of the leakage.

    Parameters
    ----------
    accuracy : relative error that the leakage may have, 0.1 for 10 %.

    Raises
    ------
    InputError : an accuracy that is not a positive number.

    Examples
    --------
    >>> contact_tolerance(0.1), contact_tolerance(0.01), contact_tolerance(1e-9)
    (0.001, 0.0001, 1e-07)
    """
    wanted = SHARE * log1p(validate.number("accuracy", accuracy))
    allowed = (rtol for rtol, error in MEASURED if SAFETY * error <= wanted)
    return next(allowed, MEASURED[-1][0])

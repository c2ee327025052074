"""A cell's gap, checked, and the conductances of the links between its pixels.

The gap midway between two pixels is a four-point cubic, at least a tenth of the smaller of the two and 0 next to
contact: so a link is open exactly where both its ends are, and no pocket is orphaned by the interpolation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from ..base import validate
from ..base.errors import InputError

Array = NDArray[np.float64]
SIDES = ("mirror", "periodic")

_compiled: dict[str, Any] = {"cache": True, "nogil": True}


def validated_gap(gap: ArrayLike, spacing: tuple[float, float]) -> tuple[Array, tuple[float, float]]:
    """Gap as a 2-D array of finite numbers >= 0 and spacing as two numbers > 0, or an InputError."""
    h = validate.field("gap", gap, unit="m")
    if h.min() < 0:
        raise InputError.of("gap", f"{h.min():g} m", "numbers >= 0 [m]")
    return h, validate.lengths("spacing", spacing)


def validated_cell(
    gap: ArrayLike, spacing: tuple[float, float], axis: int, sides: str
) -> tuple[Array, tuple[float, float]]:
    """Gap and spacing with the flow along the first axis, or an InputError that names what is wrong."""
    h, (d1, d2) = validated_gap(gap, spacing)
    axis = validate.axis_number(axis)
    if sides not in SIDES:
        raise InputError.of("sides", sides, f"one of {', '.join(SIDES)}")
    return (h, (d1, d2)) if axis == 0 else (np.ascontiguousarray(h.T), (d2, d1))


@njit(**_compiled)
def _midway(before, a, b, after):
    smaller = min(a, b)
    middle = (9.0 * (a + b) - before - after) / 16.0
    return max(middle, 0.1 * smaller) if smaller > 0.0 else 0.0


@njit(**_compiled)
def _inside(i, n, wrap):
    """Index of a point past the ends of an axis, which is periodic or continued evenly."""
    while i < 0 or i >= n:
        if wrap:
            i %= n
        else:
            i = -1 - i if i < 0 else 2 * n - 1 - i
    return i


@njit(**_compiled)
def conductances_between(gap, factor1, factor2, wrap1, wrap2):
    """factor · h³/12 midway between neighbours along both axes.

    Along a wrapped axis of n points there are n links, from each point to the next; otherwise n + 1 along the first
    axis, one past each end, and n − 1 along the second.
    """
    n1, n2 = gap.shape
    m1 = n1 if wrap1 else n1 + 1
    c1 = np.empty((m1, n2))
    for i in range(m1):
        first = i - 1 if wrap1 else i - 2
        rows = [_inside(first + k, n1, wrap1) for k in range(4)]
        before, a, b, after = gap[rows[0]], gap[rows[1]], gap[rows[2]], gap[rows[3]]
        for j in range(n2):
            h = _midway(before[j], a[j], b[j], after[j])
            c1[i, j] = h * h * h * (factor1 / 12.0)
    m2 = n2 if wrap2 else n2 - 1
    c2 = np.empty((n1, m2))
    for i in range(n1):
        row = gap[i]
        for j in range(1, n2 - 2):
            h = _midway(row[j - 1], row[j], row[j + 1], row[j + 2])
            c2[i, j] = h * h * h * (factor2 / 12.0)
        for k in range(3):
            j = (0, n2 - 2, n2 - 1)[k]
            if 0 <= j < m2:
                h = _midway(row[_inside(j - 1, n2, wrap2)], row[j], row[(j + 1) % n2], row[_inside(j + 2, n2, wrap2)])
                c2[i, j] = h * h * h * (factor2 / 12.0)
    return c1, c2

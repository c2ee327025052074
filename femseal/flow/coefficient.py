"""Permeability at the quadrature points from a gap, by the cubic law.

The gap is given at pixel centres. On the links between pixels, the midpoints of the edges of the elements, it is
interpolated by a four-point cubic, at least a tenth of the smaller of the two pixels and 0 next to contact: a link is
open exactly where both its pixels are, and the interpolation closes no pixel off. Where the cubic would dip because the
gap jumps beyond one of the two pixels, that pixel's outer neighbour is left out.
"""

from __future__ import annotations

from math import frexp, ldexp

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, InputError, Lengths, validate
from ..base.compiled import compiled, inner, over, rows
from .law import cubic_law

SIDES = ("mirror", "periodic")
#: Largest gap [m] and largest ratio of spacings; their inverses are the smallest.
_EXTREME = 1e60
#: Largest ratio of two open gaps.
_CONTRAST = 1e50

#: The cubic is doubted where it is below this fraction of both pixels, and left where one second difference is so many
#: times the other: that is a jump beyond one of the two. On 36 gaps with eight pixels for the shortest wave, cut by a
#: plane or in contact, that changed no permeability by more than 4e-7, at errors of 7e-5 to 2e-2 by the pixels.
_DOUBTED, _JUMP = 0.8, 8.0


def validated_gap(gap: ArrayLike, spacing: Lengths) -> tuple[Array, tuple[float, float]]:
    """Gap as a 2-D array of finite numbers >= 0 and spacing as two numbers > 0, or an InputError.

    Numbers whose cubes or ratios double precision cannot bear are refused too.
    """
    h = validate.field("gap", gap, unit="m")
    lowest, smallest, largest = map(min, zip(*over(rows(*h.shape), _extent, h), strict=True))
    largest = -largest
    if lowest < 0:
        raise InputError("gap", f"{lowest:g} m", "numbers >= 0 [m]")
    if largest > 0 and not 1 / _EXTREME <= largest <= _EXTREME:
        raise InputError(
            "gap", f"a largest gap of {largest:g} m", f"one from {1 / _EXTREME:g} to {_EXTREME:g} m"
        )
    if smallest < largest / _CONTRAST:
        given = f"{smallest:g} m beside {largest:g} m"
        raise InputError("gap", given, f"0, or numbers >= {1 / _CONTRAST:g} of the largest")
    d1, d2 = validate.lengths("spacing", spacing)
    if not 1 / _EXTREME <= d1 / d2 <= _EXTREME:
        raise InputError(
            "spacing", (d1, d2), f"two lengths whose ratio is from {1 / _EXTREME:g} to {_EXTREME:g}"
        )
    return h, (d1, d2)


def unit_spacing(spacing: tuple[float, float]) -> tuple[float, float]:
    """Spacing over a power of two near the larger length: the flow depends on the ratio only, which keeps its digits.

    >>> unit_spacing((3e-6, 1.5e-6))
    (1.572864, 0.786432)
    """
    exponent = frexp(max(spacing))[1] - 1
    return ldexp(spacing[0], -exponent), ldexp(spacing[1], -exponent)


def validated_cell(
    gap: ArrayLike, spacing: Lengths, axis: int, sides: str
) -> tuple[Array, tuple[float, float]]:
    """Gap and spacing with the flow along the first axis, or an InputError that names what is wrong."""
    h, (d1, d2) = validated_gap(gap, spacing)
    axis = validate.axis_number(axis)
    if sides not in SIDES:
        raise InputError("sides", sides, f"one of {', '.join(SIDES)}")
    return (h, (d1, d2)) if axis == 0 else (np.ascontiguousarray(h.T), (d2, d1))


def gap_on_links(gap: Array, ring1: bool, ring2: bool) -> tuple[Array, Array]:
    """Gap midway between neighbouring pixels along both axes [m].

    Along an axis that forms a ring n pixels have n links, from each to the next; otherwise the first axis has n + 1
    links, one to each end, beyond which the gap is mirrored, and the second n − 1.
    """
    n1, n2 = gap.shape
    on1, on2 = np.empty((n1 if ring1 else n1 + 1, n2)), np.empty((n1, n2 if ring2 else n2 - 1))
    over(rows(n1, n2), links_of_rows, gap, ring1, ring2, False, on1, on2)
    return on1, on2


_law = inner()(cubic_law)


@compiled()
def _extent(begin, end, gap):
    """The lowest gap of some rows, the smallest that is open, inf if none is, and minus the largest."""
    smallest = lowest = np.inf
    largest = -np.inf
    for i in range(begin, end):
        for j in range(gap.shape[1]):
            here = gap[i, j]
            lowest, largest = min(lowest, here), max(largest, here)
            smallest = here if 0.0 < here < smallest else smallest
    return lowest, smallest, -largest


@inner()
def _midway(before, a, b, after):
    """The gap between two points a and b, by a cubic through them and their neighbours; 0 where one is closed."""
    smaller = min(a, b)
    if not smaller > 0.0:
        return 0.0
    middle = (9.0 * (a + b) - before - after) / 16.0
    if middle < _DOUBTED * smaller:
        # second differences, alike where the gap is smooth
        left, right = before - 2.0 * a + b, a - 2.0 * b + after
        if max(left, right) > _JUMP * abs(min(left, right)):
            middle = 0.5 * (a + b) - min(left, right) / 8.0
    return max(middle, 0.1 * smaller)


@inner()
def _inside(i, n, ring):
    """Index of the pixel that stands for i beyond the ends of an axis, which is periodic (`ring`) or mirrored."""
    while i < 0 or i >= n:
        if ring:
            i %= n
        else:
            i = -1 - i if i < 0 else 2 * n - 1 - i
    return i


@compiled()
def links_of_rows(first, end, gap, ring1, ring2, as_permeability, on1, on2):
    """Write gap or permeability on the links of some rows, with the last one those after it along the first axis."""
    n1, n2 = gap.shape
    for i in range(first, on1.shape[0] if end == n1 else end):
        start = i - 1 if ring1 else i - 2
        rows = [_inside(start + k, n1, ring1) for k in range(4)]
        before, a, b, after = gap[rows[0]], gap[rows[1]], gap[rows[2]], gap[rows[3]]
        for j in range(n2):
            h = _midway(before[j], a[j], b[j], after[j])
            on1[i, j] = _law(h) if as_permeability else h
    m2 = on2.shape[1]
    for i in range(first, end):
        row = gap[i]
        for j in range(1, n2 - 2):
            h = _midway(row[j - 1], row[j], row[j + 1], row[j + 2])
            on2[i, j] = _law(h) if as_permeability else h
        for k in range(3):
            j = (0, n2 - 2, n2 - 1)[k]
            if 0 <= j < m2:
                h = _midway(
                    row[_inside(j - 1, n2, ring2)],
                    row[j],
                    row[(j + 1) % n2],
                    row[_inside(j + 2, n2, ring2)],
                )
                on2[i, j] = _law(h) if as_permeability else h

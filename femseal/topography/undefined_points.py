"""Undefined points of a measured map: filled by the harmonic surface through their rims, ∇²z = 0, or cropped.

Too many of them are an error, which offers the largest rectangle of the map with few.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.quantities import to_text

#: Lines along each axis between which rectangles are sought.
_LINES = 96
#: Fraction of the limit that a rectangle may reach: what is left is for spikes that only the cropped map has.
_SPARE = 0.8
#: A part with a side that is a smaller fraction of the map's is not offered.
_LEAST_SIDE = 0.05

Part = tuple[float, float, float, float]


class TooManyUndefined(InputError):
    """A map with too many undefined points; `part`: the largest one with few, x1 from, to, x2 from, to [m], or None."""

    def __init__(self, fraction: float, limit: float, part: Part | None, spikes: int = 0) -> None:
        self.fraction, self.limit, self.part, self.spikes = fraction, limit, part, spikes
        largest = "no part of the map has so few"
        if part is not None:
            largest = f"the largest part with so few is crop = {part_text(part)} in [face]"
        note = f"; {spikes} of them are spikes, which spikes=inf leaves alone" if spikes else ""
        raised = "or raise the fraction that may be filled (max_undefined)"
        expected = f"at most {100 * limit:.3g} %: {largest}, {raised}{note}"
        super().__init__("undefined points", f"{100 * fraction:.3g} %", expected)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.fraction, self.limit, self.part, self.spikes)

    def from_origin(self, x1: float, x2: float) -> TooManyUndefined:
        """The same error about a map that was cropped before, from x1 and x2 [m] on: its part in the whole map."""
        if self.part is None:
            return self
        from1, to1, from2, to2 = self.part
        moved = (from1 + x1, to1 + x1, from2 + x2, to2 + x2)
        return TooManyUndefined(self.fraction, self.limit, moved, self.spikes)


def part_text(part: Part) -> str:
    """A part as the key `crop` of a case."""
    return "[" + ", ".join(f'"{to_text(length, "m", 6)}"' for length in part) + "]"


def largest_part(undefined: NDArray[np.bool_], spacing: tuple[float, float], limit: float) -> Part | None:
    """A large rectangle of which no more than the fraction `limit` is undefined; None without a useful one.

    undefined : points (n1, n2).
    spacing : pixel [m].
    limit : 0 to 1; the rectangle keeps below it with a little to spare.

    It has the largest number of points less that of the undefined ones over `limit`: a strip belongs to it only if the
    strip itself is defined so far. Rectangles between at most 96 lines along each axis, evenly spaced, are compared.
    """
    n1, n2 = undefined.shape
    rows, columns = (np.unique(np.linspace(0, n, min(n, _LINES) + 1).round().astype(int)) for n in (n1, n2))
    # points counted from the corner of the map to each crossing of lines
    counted = np.zeros((n1 + 1, n2 + 1), dtype=np.int64)
    np.cumsum(np.cumsum(undefined, axis=0, dtype=np.int64), axis=1, out=counted[1:, 1:])
    x1, x2 = rows[:, None], columns[None, :]
    price = 1 / max(_SPARE * limit, 1 / undefined.size)
    lost = price * counted[np.ix_(rows, columns)]
    best = 0.0
    found: tuple[int, int, int, int] | None = None
    for a in range(rows.size - 1):
        # sums over the rows from a to b, then over all pairs of columns: the best one begins at the least sum before
        gained = (x1[a + 1 :] - x1[a]) * x2 - (lost[a + 1 :] - lost[a])
        rise = gained - np.minimum.accumulate(gained, axis=1)
        below, right = (int(n) for n in np.unravel_index(int(rise.argmax()), rise.shape))
        if rise[below, right] > best:
            left = int(gained[below, : right + 1].argmin())
            best, found = float(rise[below, right]), (a, a + 1 + below, left, right)
    if found is None:
        return None
    a, b, c, d = found
    if rows[b] - rows[a] < _LEAST_SIDE * n1 or columns[d] - columns[c] < _LEAST_SIDE * n2:
        return None
    d1, d2 = spacing
    return float(rows[a] * d1), float(rows[b] * d1), float(columns[c] * d2), float(columns[d] * d2)


def fill_holes(heights: NDArray, spacing: tuple[float, float], periodic: tuple[bool, bool]) -> NDArray:
    """`heights` (n1, n2) [m] with every NaN replaced; at least one point must be defined.

    Five-point Laplacian on the holes, defined neighbours as Dirichlet values, wrapped on periodic axes, no
    flux through the other borders. Exact for a plane in holes that do not touch a border; the filled values
    stay between the extremes of the rim (maximum principle), so a hole adds no new summit.
    """
    holes = np.argwhere(np.isnan(heights))
    if not len(holes):
        return heights
    number = np.full(heights.shape, -1)
    number[tuple(holes.T)] = np.arange(len(holes))
    diagonal, right = np.zeros(len(holes)), np.zeros(len(holes))
    rows, columns, values = [], [], []
    for axis in (0, 1):
        n, weight = heights.shape[axis], (spacing[0] / spacing[axis]) ** 2
        for step in (-1, 1):
            at = holes.copy()
            at[:, axis] += step
            inside = np.full(len(at), True) if periodic[axis] else (at[:, axis] >= 0) & (at[:, axis] < n)
            at[:, axis] %= n
            neighbour = number[tuple(at.T)]
            unknown, known = inside & (neighbour >= 0), inside & (neighbour < 0)
            diagonal[inside] += weight
            right[known] += weight * heights[tuple(at[known].T)]
            rows.append(np.flatnonzero(unknown))
            columns.append(neighbour[unknown])
            values.append(np.full(np.count_nonzero(unknown), -weight))
    index = np.arange(len(holes))
    entries = np.concatenate([*values, diagonal])
    where = (np.concatenate([*rows, index]), np.concatenate([*columns, index]))
    laplacian = scipy.sparse.csc_array((entries, where), shape=(len(holes), len(holes)))
    filled = heights.copy()
    filled[tuple(holes.T)] = scipy.sparse.linalg.spsolve(laplacian, right)
    return filled

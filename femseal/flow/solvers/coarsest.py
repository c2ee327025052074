"""The coarsest level of multigrid: its nodes are eliminated one after another, row by row; compiled.

The ends are one node, at potential 0. Nothing is subtracted, see `elimination`: that of a band needs no order of its
own, and takes a small part of the time of a solution as long as the level is small.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base.arrays import Array, Indices
from ...base.compiled import REORDERED, compiled

#: What the centre has beyond all conductances is taken for a rounding error below this fraction.
_ROUNDING = 1e-13


class Coarsest(NamedTuple):
    """The eliminated level.

    number (n1, n2) : of each node, in the order of elimination. band (n, width) : links of each node to the next ones
    at the time it was eliminated. inverse (n,) : 1 over their sum, or 0.
    """

    number: Indices
    band: Array
    inverse: Array


@compiled()
def _numbered(n1, n2, ring):
    """Numbers of the nodes along the shorter axis first, and the most by which those of two linked nodes differ.

    Around a ring both sides are numbered alternately.
    """
    number = np.empty((n1, n2), np.int64)
    for j in range(n2):
        place = j
        if ring:
            place = 2 * j if 2 * j < n2 else 2 * (n2 - 1 - j) + 1
        for i in range(n1):
            number[i, j] = i * n2 + place if n2 <= n1 else place * n1 + i
    step = 2 if ring else 1
    return number, (n2 + step if n2 <= n1 else step * n1 + 1)


@compiled(**REORDERED)
def eliminated(operator, ring):
    """`Coarsest` of an operator, see `hierarchy`."""
    centre = operator[0]
    n1, n2 = centre.shape[0] - 2, centre.shape[1] - 2
    number, width = _numbered(n1, n2, ring)
    n = n1 * n2
    # rows without nodes at the end, so that no loop needs to stop before them
    band = np.zeros((n + width, width), np.float32)
    ends, inverse = np.zeros(n + width, np.float32), np.zeros(n, np.float32)
    for i in range(n1):
        for j in range(n2):
            k, rest = number[i, j], centre[i + 1, j + 1]
            for side in range(1, 5):
                down, right = (0, 1, 1, 1)[side - 1], (1, 0, 1, -1)[side - 1]
                link = operator[side]
                if link.size == 1:
                    continue
                rest -= link[i + 1, j + 1] + link[i + 1 - down, j + 1 - right]
                column = (j + right) % n2 if ring else j + right
                if i + down < n1 and 0 <= column < n2 and number[i + down, column] != k:
                    other = number[i + down, column]
                    band[min(k, other), abs(k - other) - 1] += link[i + 1, j + 1]
            if rest > _ROUNDING * centre[i + 1, j + 1]:
                ends[k] = rest
    for k in range(n):
        row, later = band[k], band[k + 1 : k + 1 + width]
        total = ends[k]
        for a in range(width):
            total += row[a]
        if not total > 0.0:
            continue
        inverse[k] = np.float32(1.0) / total
        for a in range(width):
            fraction = row[a] * inverse[k]
            if fraction != np.float32(0.0):
                ends[k + 1 + a] += fraction * ends[k]
                for b in range(width - 1 - a):
                    later[a, b] += fraction * row[a + 1 + b]
    return Coarsest(number, band, inverse)


@compiled(**REORDERED)
def solve_coarsest(coarsest, b, ring, x):
    """Write x of the level from its right-hand side b, both with a border."""
    number, band, inverse = coarsest
    n1, n2 = number.shape
    n, width = inverse.size, band.shape[1]
    v = np.zeros(n + width, np.float32)
    for i in range(n1):
        for j in range(n2):
            v[number[i, j]] = b[i + 1, j + 1]
    for k in range(n):
        here = v[k] * inverse[k]
        v[k] = here
        for a in range(width):
            v[k + 1 + a] += band[k, a] * here
    for k in range(n - 1, -1, -1):
        s = np.float32(0.0)
        for a in range(width):
            s += band[k, a] * v[k + 1 + a]
        v[k] += s * inverse[k]
    for i in range(n1):
        for j in range(n2):
            x[i + 1, j + 1] = v[number[i, j]]
        if ring:
            x[i + 1, 0], x[i + 1, n2 + 1] = x[i + 1, n2], x[i + 1, 1]

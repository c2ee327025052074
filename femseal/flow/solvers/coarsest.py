"""The coarsest level of multigrid, eliminated once and solved for many right-hand sides: compiled.

Elimination is that of `elimination`, with couples across corners; the ends are one node, at the potential 0.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .elimination import factors

#: What the centre has beyond all couples is taken for a rounding error below this share.
_ROUNDING = 1e-13


@njit(cache=True, nogil=True)
def eliminated(centre, right, below, below_right, below_left, ring):
    """The factors of an operator on its nodes that have links, see `elimination.factors`."""
    n1, n2 = centre.shape[0] - 2, centre.shape[1] - 2
    nine = below_right.size > 1
    m2 = n2 if ring else n2 - 1
    c1, c2 = np.zeros((n1 + 1, n2)), np.zeros((n1, m2))
    corners = (n1 + 1, m2) if nine else (0, 0)
    falling, rising = np.zeros(corners), np.zeros(corners)
    ends = np.zeros((n1, n2))
    keep = np.zeros((n1, n2), np.bool_)
    for i in range(1, n1 + 1):
        for j in range(1, n2 + 1):
            rest = centre[i, j] - right[i, j] - right[i, j - 1] - below[i, j] - below[i - 1, j]
            if nine:
                rest -= below_right[i, j] + below_right[i - 1, j - 1] + below_left[i, j] + below_left[i - 1, j + 1]
                if j <= m2 and i < n1:
                    falling[i, j - 1] = below_right[i, j]
                    rising[i, j - 1] = below_left[i, j % n2 + 1]
            keep[i - 1, j - 1] = centre[i, j] > 0.0
            ends[i - 1, j - 1] = rest if rest > _ROUNDING * centre[i, j] else 0.0
            if i < n1:
                c1[i, j - 1] = below[i, j]
            if j <= m2:
                c2[i - 1, j - 1] = right[i, j]
    order, first, border, start, at, links, total, _ = factors(
        c1, c2, falling, rising, keep, ring, ends, np.zeros((n1, n2))
    )
    inverse = np.zeros(total.size)
    for i in range(total.size):
        inverse[i] = 1.0 / total[i] if total[i] > 0.0 else 0.0
    return order, first, border, start, at, links, inverse


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def solve_eliminated(factored, b, x):
    """x of the level from its right-hand side b, both with a border."""
    order, first, border, start, at, links, inverse = factored
    n, n2 = order.size, x.shape[1] - 2
    v = np.zeros(n + 2)
    for i in range(n):
        v[i] = b[order[i] // n2 + 1, order[i] % n2 + 1]
    for f in range(first.size - 1):
        a, p, q = first[f], first[f + 1] - first[f], start[f + 1] - start[f]
        later = border[start[f] : start[f + 1]]
        for i in range(p):
            row = links[at[f] + i * (p + q) : at[f] + (i + 1) * (p + q)]
            here = v[a + i] * inverse[a + i]
            for j in range(i + 1, p):
                v[a + j] += row[j] * here
            for j in range(q):
                v[later[j]] += row[p + j] * here
    v[n] = v[n + 1] = 0.0
    for f in range(first.size - 2, -1, -1):
        a, p, q = first[f], first[f + 1] - first[f], start[f + 1] - start[f]
        later = border[start[f] : start[f + 1]]
        for i in range(p - 1, -1, -1):
            row = links[at[f] + i * (p + q) : at[f] + (i + 1) * (p + q)]
            here = v[a + i]
            for j in range(i + 1, p):
                here += row[j] * v[a + j]
            for j in range(q):
                here += row[p + j] * v[later[j]]
            v[a + i] = here * inverse[a + i]
    for i in range(n):
        x[order[i] // n2 + 1, order[i] % n2 + 1] = v[i]

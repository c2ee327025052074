"""Fields between a grid and the next coarser one, which has half the points along each axis."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def prolong(coarse, hardness, p, state):
    """Values of a grid of half the points on the finer one, at most the hardness; state 1 where there is pressure."""
    n1, n2 = p.shape
    one = hardness.size == 1
    for i in range(n1):
        for j in range(n2):
            h = hardness[0, 0] if one else hardness[i, j]
            y = min(coarse[i // 2, j // 2], h)
            p[i, j] = y
            state[i, j] = 1 if y > 0.0 else 0


@njit(cache=True, nogil=True)
def coarsen(a):
    """Means over 2×2 points; an odd last row or column is averaged alone."""
    n1, n2 = a.shape
    out = np.empty(((n1 + 1) // 2, (n2 + 1) // 2))
    for i in range(out.shape[0]):
        a1 = min(2 * i + 1, n1 - 1)
        for j in range(out.shape[1]):
            b1 = min(2 * j + 1, n2 - 1)
            out[i, j] = 0.25 * (a[2 * i, 2 * j] + a[a1, 2 * j] + a[2 * i, b1] + a[a1, b1])
    return out

"""Flow between the corners of pixels, Q1 elements of constant permeability: compiled.

Each pixel links its corners: `along` those one row apart, `across` those one column apart, `diagonal` the others
(arrays of the pixels' conductances). Corner rows run from the inlet to the outlet; the columns may form a ring.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

_compiled: dict[str, Any] = {"cache": True, "nogil": True}


@njit(**_compiled)
def corner_operator(along, across, diagonal, keep, ring):
    """Operator of `multigrid` for the inner corners that are kept, and the links of its outer rows to the ends."""
    n1, n2 = along.shape
    columns = keep.shape[1]
    shape = (n1 + 1, columns + 2)
    centre, right, below = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    below_right, below_left = np.zeros(shape), np.zeros(shape)
    inlet, outlet = np.zeros(columns), np.zeros(columns)
    for i in range(n1):
        for j in range(n2):
            if along[i, j] == 0.0 and diagonal[i, j] == 0.0:
                continue
            k = (j + 1) % columns
            # corner (i, j) of all is node (i, j + 1) with its border, the inlet its row 0
            if not (keep[i, j] or keep[i, k] or keep[i + 1, j] or keep[i + 1, k]):
                continue
            total = along[i, j] + across[i, j] + diagonal[i, j]
            for row in (i, i + 1):
                if 0 < row < n1:
                    right[row, j + 1] += across[i, j]
                    centre[row, j + 1] += total
                    centre[row, k + 1] += total
            if 0 < i < n1 - 1:
                below[i, j + 1] += along[i, j]
                below[i, k + 1] += along[i, j]
                below_right[i, j + 1] += diagonal[i, j]
                below_left[i, k + 1] += diagonal[i, j]
            if i == 0:
                inlet[j] += along[i, j] + diagonal[i, j]
                inlet[k] += along[i, j] + diagonal[i, j]
            if i == n1 - 1:
                outlet[j] += along[i, j] + diagonal[i, j]
                outlet[k] += along[i, j] + diagonal[i, j]
    if ring:
        for field in (right, below, below_right, below_left):
            for i in range(n1 + 1):
                field[i, 0] = field[i, columns]
                field[i, columns + 1] = field[i, 1]
    return (centre, right, below, below_right, below_left), inlet, outlet


@njit(**_compiled)
def corner_energy(along, across, diagonal, p):
    """Dirichlet energy of a pressure at the corners, from differences within each pixel: no cancellation."""
    n1, n2 = along.shape
    columns = p.shape[1]
    total = 0.0
    for i in range(n1):
        for j in range(n2):
            k = (j + 1) % columns
            a, b, c, d = p[i, j], p[i, k], p[i + 1, j], p[i + 1, k]
            total += (
                along[i, j] * ((a - c) ** 2 + (b - d) ** 2)
                + across[i, j] * ((a - b) ** 2 + (c - d) ** 2)
                + diagonal[i, j] * ((a - d) ** 2 + (b - c) ** 2)
            )
    return total

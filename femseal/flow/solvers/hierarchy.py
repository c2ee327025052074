"""The levels of multigrid on a structured grid, from the couples of the finest one: compiled.

A level is the operator of a grid, with the fields that a multigrid cycle needs there. Fields have a border of one node,
with zeros at ends and closed sides and with copies of the other side around a ring. Couples have the sign of a
conductance: `right` (i, j)–(i, j + 1), `below` (i, j)–(i + 1, j), on nine points `below_right` (i, j)–(i + 1, j + 1)
and `below_left` (i, j)–(i + 1, j − 1). A node between coarse ones takes the mean of them that its own couples would
give it; coarse operators are Galerkin's. Source: Dendy, J. Comput. Phys. 48, 1982, 366 (black box multigrid).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .clusters import clusters
from .compiled import COMPILED

#: Nodes of an axis at which coarsening ends.
FEWEST = 4
#: Coarsening also ends where so small a share of the nodes is left: their elimination costs less than the iterations
#: that bays and channels of the coarser grids do.
_ELIMINATED = 1 / 40


def coarsest_nodes(n1: int, n2: int) -> int:
    """Nodes of the coarsest level for n1 × n2 unknowns; many if the network is slender."""
    while min(n1, n2) > FEWEST:
        n1, n2 = (n1 + 1) // 2, (n2 + 1) // 2
    return n1 * n2


@njit(**COMPILED)
def bordered(along, across, falling, rising, ring):
    """Centres and couples of the inner nodes of a stencil with a border of one node, and their sums with both ends."""
    n1, n2 = along.shape[0] - 1, along.shape[1]
    m2 = across.shape[1]
    nine = falling.size > 0
    shape = (n1 + 2, n2 + 2)
    centre, right, below = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    small = shape if nine else (1, 1)
    below_right, below_left = np.zeros(small), np.zeros(small)
    inlet, outlet = along[0].copy(), along[n1].copy()
    for i in range(1, n1 + 1):
        for j in range(1, m2 + 1):
            right[i, j] = across[i - 1, j - 1]
        if ring:
            right[i, 0] = right[i, n2]
        for j in range(1, n2 + 1):
            if i < n1:
                below[i, j] = along[i, j - 1]
            centre[i, j] = along[i - 1, j - 1] + along[i, j - 1] + right[i, j - 1] + right[i, j]
    if nine:
        for i in range(n1 + 1):
            for j in range(m2):
                k = (j + 1) % n2
                down, up = falling[i, j], rising[i, j]
                if i > 0:
                    centre[i, j + 1] += down
                    centre[i, k + 1] += up
                else:
                    inlet[k] += down
                    inlet[j] += up
                if i < n1:
                    centre[i + 1, k + 1] += down
                    centre[i + 1, j + 1] += up
                else:
                    outlet[j] += down
                    outlet[k] += up
                if 0 < i < n1:
                    below_right[i, j + 1] = down
                    below_left[i, k + 1] = up
        if ring:
            for i in range(1, n1):
                for field in (below, below_right, below_left):
                    field[i, 0] = field[i, n2]
                    field[i, n2 + 1] = field[i, 1]
                right[i, n2 + 1] = right[i, 1]
            right[n1, n2 + 1] = right[n1, 1]
    return (centre, right, below, below_right, below_left), inlet, outlet


@njit(**COMPILED)
def _share(part, whole):
    """part / whole, or 0 if either is not > 0."""
    return part / whole if part > 0.0 and whole > 0.0 else 0.0


@njit(**COMPILED)
def _wrap(weights):
    """Copy the weights of the first and last columns to the border, around a ring."""
    rows, columns = weights.shape[:2]
    for i in range(rows):
        for k in range(3):
            for m in range(3):
                weights[i, 0, k, m] = weights[i, columns - 2, k, m]
                weights[i, columns - 1, k, m] = weights[i, 1, k, m]


@njit(**COMPILED)
def _interpolation(centre, right, below, below_right, below_left, nine):
    """Weight of each coarse node, at (2I − 1, 2J − 1), at itself and its eight neighbours."""
    n1, n2 = centre.shape[0] - 2, centre.shape[1] - 2
    m1, m2 = (n1 + 1) // 2, (n2 + 1) // 2
    w = np.zeros((m1 + 2, m2 + 2, 3, 3))
    for i in range(m1 + 2):
        for j in range(m2 + 2):
            w[i, j, 1, 1] = 1.0
    # between two coarse nodes of a row: links above and below are added to those along the row, or left out
    for i in range(1, n1 + 1, 2):
        for j in range(2, n2 + 1, 2):
            west, east = right[i, j - 1], right[i, j]
            if nine:
                west += below_right[i - 1, j - 1] + below_left[i, j]
                east += below_left[i - 1, j + 1] + below_right[i, j]
            whole = max(centre[i, j] - below[i - 1, j] - below[i, j], west + east)
            w[(i + 1) // 2, j // 2, 1, 2] = _share(west, whole)
            w[(i + 1) // 2, (j // 2) % m2 + 1 if j == n2 else j // 2 + 1, 1, 0] = _share(east, whole)
    for i in range(2, n1 + 1, 2):
        for j in range(1, n2 + 1, 2):
            north, south = below[i - 1, j], below[i, j]
            if nine:
                north += below_right[i - 1, j - 1] + below_left[i - 1, j + 1]
                south += below_left[i, j] + below_right[i, j]
            whole = max(centre[i, j] - right[i, j - 1] - right[i, j], north + south)
            w[i // 2, (j + 1) // 2, 2, 1] = _share(north, whole)
            w[i // 2 + 1, (j + 1) // 2, 0, 1] = _share(south, whole)
    for i in range(2, n1 + 1, 2):
        for j in range(2, n2 + 1, 2):
            c = centre[i, j]
            if c <= 0.0:
                continue
            top, bottom, left = i // 2, i // 2 + 1, j // 2
            over = (j // 2) % m2 + 1 if j == n2 else j // 2 + 1
            north, south, west, east = below[i - 1, j], below[i, j], right[i, j - 1], right[i, j]
            nw = north * w[top, left, 1, 2] + west * w[top, left, 2, 1]
            ne = north * w[top, over, 1, 0] + east * w[top, over, 2, 1]
            sw = south * w[bottom, left, 1, 2] + west * w[bottom, left, 0, 1]
            se = south * w[bottom, over, 1, 0] + east * w[bottom, over, 0, 1]
            if nine:
                nw += below_right[i - 1, j - 1]
                ne += below_left[i - 1, j + 1]
                sw += below_left[i, j]
                se += below_right[i, j]
            w[top, left, 2, 2] = _share(nw, c)
            w[top, over, 2, 0] = _share(ne, c)
            w[bottom, left, 0, 2] = _share(sw, c)
            w[bottom, over, 0, 0] = _share(se, c)
    for j in range(m2 + 2):
        w[0, j] = 0.0
        w[m1 + 1, j] = 0.0
    for i in range(m1 + 2):
        w[i, 0] = 0.0
        w[i, m2 + 1] = 0.0
    return w


@njit(**COMPILED)
def _galerkin(centre, right, below, below_right, below_left, w, nine, ring):
    """PᵀAP: centres and links of the next level."""
    n1, n2 = centre.shape[0] - 2, centre.shape[1] - 2
    m1, m2 = w.shape[0] - 2, w.shape[1] - 2
    out = np.zeros((5, m1 + 2, m2 + 2))
    row = np.zeros((5, 5))  # of A P_I at the fine nodes around a coarse one
    for ci in range(1, m1 + 1):
        for cj in range(1, m2 + 1):
            row[:] = 0.0
            for a in range(3):
                i = 2 * ci - 2 + a
                if i < 1 or i > n1:
                    continue
                for b in range(3):
                    v = w[ci, cj, a, b]
                    j = 2 * cj - 2 + b
                    if j < 1:
                        j = n2 if ring else 0
                    if v == 0.0 or j < 1 or j > n2:
                        continue
                    row[a + 1, b + 1] += centre[i, j] * v
                    row[a + 1, b] -= right[i, j - 1] * v
                    row[a + 1, b + 2] -= right[i, j] * v
                    row[a, b + 1] -= below[i - 1, j] * v
                    row[a + 2, b + 1] -= below[i, j] * v
                    if nine:
                        row[a, b] -= below_right[i - 1, j - 1] * v
                        row[a, b + 2] -= below_left[i - 1, j + 1] * v
                        row[a + 2, b] -= below_left[i, j] * v
                        row[a + 2, b + 2] -= below_right[i, j] * v
            # with itself and the coarse nodes at the right, below, below right and below left
            for k in range(5):
                di = (0, 0, 1, 1, 1)[k]
                dj = (0, 1, 0, 1, -1)[k]
                # the last and the first coarse node of an odd ring are neighbours on the finer one
                seam = (dj == 1 and cj == m2) or (dj == -1 and cj == 1)
                shift = dj if seam and n2 % 2 else 2 * dj
                s = 0.0
                for a in range(3):
                    y = 2 * di + a + 1
                    if y > 4:
                        continue
                    for b in range(3):
                        x = shift + b + 1
                        if 0 <= x <= 4:
                            s += w[ci + di, cj + dj, a, b] * row[y, x]
                out[k, ci, cj] = s if k == 0 else -s
    if ring:
        for k in range(1, 5):
            for i in range(m1 + 2):
                out[k, i, 0] = out[k, i, m2]
                out[k, i, m2 + 1] = out[k, i, 1]
    return out[0], out[1], out[2], out[3], out[4]


@njit(**COMPILED)
def hierarchy(centre, right, below, below_right, below_left, ring):
    """Levels from the finest: operator, inverse centres, weights of the next level's nodes, work x, b, r; clusters."""
    levels = []
    fewest = _ELIMINATED * np.count_nonzero(centre)
    while True:
        shape = centre.shape
        nine = below_right.size > 1
        last = min(shape[0], shape[1]) - 2 <= FEWEST or np.count_nonzero(centre) <= fewest
        if last:
            weights = np.zeros((1, 1, 3, 3))
            apart = (np.zeros((1, 1), np.int32), np.zeros((0, 2), np.int64), np.zeros(1, np.int64), np.zeros(0))
        else:
            weights = _interpolation(centre, right, below, below_right, below_left, nine)
            if ring:
                _wrap(weights)
            apart = clusters(centre, right, below, below_right, below_left, nine, ring)
        inverse = np.zeros(shape)
        for i in range(shape[0]):
            for j in range(shape[1]):
                if centre[i, j] > 0.0:
                    inverse[i, j] = 1.0 / centre[i, j]
        levels.append((centre, right, below, below_right, below_left, inverse, weights, np.zeros(shape),
                       np.zeros(shape), np.zeros(shape), apart))  # fmt: skip
        if last:
            return levels
        centre, right, below, below_right, below_left = _galerkin(
            centre, right, below, below_right, below_left, weights, nine, ring
        )

"""Algebraic multigrid that knows the grid, as preconditioner of conjugate gradients: compiled.

Each level halves both axes. A node between coarse ones takes the mean of them that its own links would give it, coarse
operators are Galerkin's, and one sweep of Gauss-Seidel forward before and backward after the coarser grid keep the
preconditioner symmetric. Source: Dendy, J. Comput. Phys. 48, 1982, 366 (black box multigrid).

Levels carry a border of one node, zeros at ends and closed sides and copies of the other side around a ring. Links
are stored with the sign of a conductance: `right` (i, j)–(i, j + 1), `below` (i, j)–(i + 1, j), and on coarse levels
`below_right` (i, j)–(i + 1, j + 1) and `below_left` (i, j)–(i + 1, j − 1).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..errors import NotConverged

Array = NDArray[np.float64]
#: Nodes of the coarsest level up to which multigrid is worth while; only slender grids have more.
COARSEST_NODES = 600
#: Nodes of an axis at which coarsening ends.
_FEWEST = 4
#: Iterations after which their number is foreseen.
_FORESEEN = 10

_compiled: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"reassoc", "contract", "arcp", "nsz"},
}


@dataclass(frozen=True)
class _Level:
    centre: Array
    right: Array
    below: Array
    below_right: Array
    below_left: Array
    inverse: Array
    weights: Array
    x: Array
    b: Array
    r: Array

    @property
    def nine(self) -> bool:
        """Whether there are links along the diagonals."""
        return self.below_right.size > 1


def coarsest_nodes(n1: int, n2: int) -> int:
    """Nodes of the coarsest level for n1 × n2 unknowns; many if the network is slender."""
    while min(n1, n2) > _FEWEST:
        n1, n2 = (n1 + 1) // 2, (n2 + 1) // 2
    return n1 * n2


class Multigrid:
    """Multigrid preconditioner of an operator on the grid's nodes.

    Parameters
    ----------
    operator : centres and links right, below and, for nine points, below right and below left, each (n1 + 2, n2 + 2)
        with its border; `network_operator` makes it of a network's conductances.
    ring : whether the columns form a ring.

    Notes
    -----
    The coarsest level is inverted densely: `coarsest_nodes` says how large it is.
    """

    def __init__(self, operator: tuple[Array, ...], ring: bool) -> None:
        self._ring = ring
        self._levels: list[_Level] = []
        if len(operator) == 3:
            operator += (np.zeros((1, 1)), np.zeros((1, 1)))
        while True:
            shape = operator[0].shape
            last = min(shape) - 2 <= _FEWEST
            nine = operator[3].size > 1
            weights = np.zeros((1, 1, 3, 3)) if last else _interpolation(*operator, nine)
            if not last and ring:
                weights[:, 0], weights[:, -1] = weights[:, -2], weights[:, 1]
            inverse = np.divide(1.0, operator[0], out=np.zeros(shape), where=operator[0] > 0)
            arrays = (*operator, inverse, weights, *(np.zeros(shape) for _ in range(3)))
            self._levels.append(_Level(*arrays))
            if last:
                break
            operator = _galerkin(*operator, weights, nine, ring)
        self._inverse = _inverse(operator, ring)

    @property
    def finest(self) -> _Level:
        """The network's own nodes."""
        return self._levels[0]

    def apply(self) -> Array:
        """One cycle from `finest.b` to an approximate solution in `finest.x`."""
        ring, levels = self._ring, self._levels
        for level, coarse in pairwise(levels):
            _sweep_down(level.x, level.b, level.r, level.inverse, level.right, level.below, level.below_right,
                        level.below_left, level.nine, ring)  # fmt: skip
            _restrict(level.r, level.weights, coarse.b)
        bottom = levels[-1]
        inside = bottom.x[1:-1, 1:-1]
        inside[:] = (self._inverse @ bottom.b[1:-1, 1:-1].ravel()).reshape(inside.shape)
        for k in range(len(levels) - 2, -1, -1):
            level = levels[k]
            _prolong(levels[k + 1].x, level.weights, level.x, ring)
            _sweep_up(level.x, level.b, level.inverse, level.right, level.below, level.below_right, level.below_left,
                      level.nine, ring)  # fmt: skip
        return self.finest.x

    def solve(self, inlet: Array, outlet: Array, rtol: float, limit: int) -> tuple[Array, int, float]:
        """Potential φ of the nodes for a unit drop, iterations, and the error estimate reached.

        inlet, outlet (n2) are the links of the first and the last row of nodes to the ends, φ = 1 and 0. Conjugate
        gradients until √(rᵀM⁻¹r / rate), which estimates the error of φ in the norm of the energy, is below rtol.

        Raises
        ------
        NotConverged : when it is foreseen not to happen within `limit` iterations.
        """
        level = self.finest
        shape = level.x.shape
        x, r, p, y = (np.zeros(shape) for _ in range(4))
        r[1, 1:-1] = inlet
        level.b[:] = r
        rz, error, first = 0.0, np.inf, 0.0
        for iteration in range(limit + 1):
            z = self.apply()
            before, rz = rz, float(np.vdot(r, z))
            rate = float(outlet @ x[-2, 1:-1])
            error = float(np.sqrt(rz / rate)) if rz >= 0 and rate > 0 else np.inf
            if error <= rtol:
                return x[1:-1, 1:-1], iteration, error
            first = first or rz
            if not 0 < rz < np.inf or iteration == limit:
                break
            if iteration >= _FORESEEN:
                wanted = np.log(first / (rtol**2 * rate)) if rate > 0 else np.inf
                if iteration * wanted > limit * np.log(first / rz):
                    break
            curvature = _direction(level.centre, level.right, level.below, level.below_right, level.below_left, z, p, y,
                                   rz / before if iteration else 0.0, level.nine, self._ring)  # fmt: skip
            if not curvature > 0:
                break
            _advance(rz / curvature, p, y, x, r, level.b)
        raise NotConverged(
            f"flow: error {error:.1e} after {iteration} iterations of multigrid, wanted {rtol:.1e}; "
            "try the direct solver",
            error,
        )


def _inverse(operator: tuple[Array, ...], ring: bool) -> Array:
    """Dense inverse of the coarsest operator on the nodes that have links, 0 for the others."""
    matrix = _dense(*operator, ring)
    diagonal = np.maximum(matrix.diagonal(), 0.0)
    scale = np.divide(1.0, np.sqrt(diagonal), out=np.zeros_like(diagonal), where=diagonal > 0)
    scaled = scale[:, None] * matrix * scale
    # nodes without links get a row of their own; Galerkin's operator may be singular to rounding
    scaled[np.diag_indices_from(scaled)] += np.where(diagonal > 0, 1e-14, 1.0)
    return scale[:, None] * np.linalg.inv(scaled) * scale


@njit(**_compiled)
def _dense(centre, right, below, below_right, below_left, ring):
    """The operator of a level as a matrix."""
    n1, n2 = centre.shape[0] - 2, centre.shape[1] - 2
    a = np.zeros((n1 * n2, n1 * n2))
    nine = below_right.size > 1
    for i in range(n1):
        for j in range(n2):
            here = i * n2 + j
            a[here, here] += centre[i + 1, j + 1]
            for k in range(4 if nine else 2):
                down, over = min(k, 1), (1, 0, 1, -1)[k]
                if i + down == n1 or (not ring and not 0 <= j + over < n2):
                    continue
                c = (right, below, below_right, below_left)[k][i + 1, j + 1]
                there = (i + down) * n2 + (j + over) % n2
                a[here, there] -= c
                a[there, here] -= c
    return a


@njit(**_compiled)
def network_operator(c1, c2, ring):
    """Centres and links right and below of a network's inner nodes; c1, c2 as in `network`, closed links 0."""
    n1, n2 = c1.shape[0] - 1, c1.shape[1]
    m2 = c2.shape[1]
    centre, right, below = np.zeros((n1 + 2, n2 + 2)), np.zeros((n1 + 2, n2 + 2)), np.zeros((n1 + 2, n2 + 2))
    for i in range(1, n1 + 1):
        for j in range(1, m2 + 1):
            right[i, j] = c2[i - 1, j - 1]
        if ring:
            right[i, 0] = right[i, n2]
        for j in range(1, n2 + 1):
            if i < n1:
                below[i, j] = c1[i, j - 1]
            centre[i, j] = c1[i - 1, j - 1] + c1[i, j - 1] + right[i, j - 1] + right[i, j]
    return centre, right, below


@njit(**_compiled)
def _share(part, whole):
    """part / whole where that is a weight."""
    return part / whole if part > 0.0 and whole > 0.0 else 0.0


@njit(**_compiled)
def _interpolation(centre, right, below, below_right, below_left, nine):
    """Weight of each coarse node, at (2I − 1, 2J − 1), at itself and its eight neighbours."""
    n1, n2 = centre.shape[0] - 2, centre.shape[1] - 2
    m1, m2 = (n1 + 1) // 2, (n2 + 1) // 2
    w = np.zeros((m1 + 2, m2 + 2, 3, 3))
    for i in range(m1 + 2):
        for j in range(m2 + 2):
            w[i, j, 1, 1] = 1.0
    # between two coarse nodes of a row: links above and below count as sideways or not at all
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


@njit(**_compiled)
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


@njit(**_compiled)
def _sweep_down(x, b, r, inverse, right, below, below_right, below_left, nine, ring):
    """Gauss-Seidel forward from zero, and the residual it leaves: the links to later nodes."""
    n1, n2 = x.shape[0] - 2, x.shape[1] - 2
    for i in range(1, n1 + 1):
        before = 0.0
        x[i, n2 + 1] = 0.0
        if nine:
            for j in range(1, n2 + 1):
                r[i, j] = (
                    b[i, j]
                    + below[i - 1, j] * x[i - 1, j]
                    + below_right[i - 1, j - 1] * x[i - 1, j - 1]
                    + below_left[i - 1, j + 1] * x[i - 1, j + 1]
                )
        else:
            for j in range(1, n2 + 1):
                r[i, j] = b[i, j] + below[i - 1, j] * x[i - 1, j]
        for j in range(1, n2):
            before = (r[i, j] + right[i, j - 1] * before) * inverse[i, j]
            x[i, j] = before
        s = r[i, n2] + right[i, n2 - 1] * before
        if ring:
            s += right[i, n2] * x[i, 1]
        x[i, n2] = s * inverse[i, n2]
        if ring:
            x[i, 0] = x[i, n2]
            x[i, n2 + 1] = x[i, 1]
    for i in range(1, n1 + 1):
        if nine:
            for j in range(1, n2 + 1):
                r[i, j] = (
                    right[i, j] * x[i, j + 1]
                    + below[i, j] * x[i + 1, j]
                    + below_right[i, j] * x[i + 1, j + 1]
                    + below_left[i, j] * x[i + 1, j - 1]
                )
        else:
            for j in range(1, n2 + 1):
                r[i, j] = right[i, j] * x[i, j + 1] + below[i, j] * x[i + 1, j]
        if ring:
            # the last node comes after the first
            r[i, n2] -= right[i, n2] * x[i, 1]
            r[i, 1] += right[i, 0] * x[i, n2]
            r[i, 0] = r[i, n2]


@njit(**_compiled)
def _sweep_up(x, b, inverse, right, below, below_right, below_left, nine, ring):
    """Gauss-Seidel backward."""
    n1, n2 = x.shape[0] - 2, x.shape[1] - 2
    rest = np.empty(n2 + 2)
    for i in range(n1, 0, -1):
        for j in range(1, n2 + 1):
            rest[j] = b[i, j] + below[i - 1, j] * x[i - 1, j] + below[i, j] * x[i + 1, j]
        if nine:
            for j in range(1, n2 + 1):
                rest[j] += (
                    below_right[i - 1, j - 1] * x[i - 1, j - 1]
                    + below_left[i - 1, j + 1] * x[i - 1, j + 1]
                    + below_right[i, j] * x[i + 1, j + 1]
                    + below_left[i, j] * x[i + 1, j - 1]
                )
        after = x[i, n2 + 1]
        for j in range(n2, 0, -1):
            if j == 1 and ring:
                x[i, 0] = x[i, n2]
            after = (rest[j] + right[i, j - 1] * x[i, j - 1] + right[i, j] * after) * inverse[i, j]
            x[i, j] = after
        if ring:
            x[i, 0] = x[i, n2]
            x[i, n2 + 1] = x[i, 1]


@njit(**_compiled)
def _restrict(r, w, b):
    """Pᵀ r."""
    m1, m2 = b.shape[0] - 2, b.shape[1] - 2
    for ci in range(1, m1 + 1):
        i = 2 * ci - 1
        for cj in range(1, m2 + 1):
            j = 2 * cj - 1
            s = 0.0
            for a in range(3):
                s += w[ci, cj, a, 0] * r[i + a - 1, j - 1]
                s += w[ci, cj, a, 1] * r[i + a - 1, j]
                s += w[ci, cj, a, 2] * r[i + a - 1, j + 1]
            b[ci, cj] = s


@njit(**_compiled)
def _prolong(coarse, w, x, ring):
    """x += P coarse."""
    n1, n2 = x.shape[0] - 2, x.shape[1] - 2
    m1, m2 = coarse.shape[0] - 2, coarse.shape[1] - 2
    if ring:
        for i in range(1, n1 + 1):
            x[i, 0] = 0.0
    for ci in range(1, m1 + 1):
        i = 2 * ci - 1
        for cj in range(1, m2 + 1):
            j = 2 * cj - 1
            v = coarse[ci, cj]
            for a in range(3):
                x[i + a - 1, j - 1] += v * w[ci, cj, a, 0]
                x[i + a - 1, j] += v * w[ci, cj, a, 1]
                x[i + a - 1, j + 1] += v * w[ci, cj, a, 2]
    if ring:
        for i in range(1, n1 + 1):
            x[i, n2] += x[i, 0]
            x[i, 0] = x[i, n2]
            x[i, n2 + 1] = x[i, 1]


@njit(**_compiled)
def _direction(centre, right, below, below_right, below_left, z, p, y, beta, nine, ring):
    """p = z + β p, y = A p; returns p·y."""
    n1, n2 = p.shape[0] - 2, p.shape[1] - 2
    for i in range(1, n1 + 1):
        for j in range(1, n2 + 1):
            p[i, j] = z[i, j] + beta * p[i, j]
        if ring:
            p[i, 0] = p[i, n2]
            p[i, n2 + 1] = p[i, 1]
    total = 0.0
    for i in range(1, n1 + 1):
        for j in range(1, n2 + 1):
            y[i, j] = (
                centre[i, j] * p[i, j]
                - right[i, j] * p[i, j + 1]
                - right[i, j - 1] * p[i, j - 1]
                - below[i, j] * p[i + 1, j]
                - below[i - 1, j] * p[i - 1, j]
            )
        if nine:
            for j in range(1, n2 + 1):
                y[i, j] -= (
                    below_right[i, j] * p[i + 1, j + 1]
                    + below_right[i - 1, j - 1] * p[i - 1, j - 1]
                    + below_left[i, j] * p[i + 1, j - 1]
                    + below_left[i - 1, j + 1] * p[i - 1, j + 1]
                )
        for j in range(1, n2 + 1):
            total += y[i, j] * p[i, j]
    return total


@njit(**_compiled)
def _advance(step, p, y, x, r, b):
    """x += step p, r −= step y, b = r."""
    n1, n2 = p.shape[0] - 2, p.shape[1] - 2
    for i in range(1, n1 + 1):
        for j in range(1, n2 + 1):
            x[i, j] += step * p[i, j]
            r[i, j] -= step * y[i, j]
            b[i, j] = r[i, j]

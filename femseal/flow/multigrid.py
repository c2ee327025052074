"""Algebraic multigrid that knows the grid, as preconditioner of conjugate gradients: compiled.

Each level halves both axes. A node between coarse ones takes the mean of them that its own links would give it, coarse
operators are Galerkin's, and one sweep of Gauss-Seidel forward before and backward after the coarser grid keep the
preconditioner symmetric. Source: Dendy, J. Comput. Phys. 48, 1982, 366 (black box multigrid).

Levels carry a border of one node, zeros at ends and closed sides and copies of the other side around a ring. Links
are stored with the sign of a conductance: `right` (i, j)–(i, j + 1), `below` (i, j)–(i + 1, j), and on coarse levels
`below_right` (i, j)–(i + 1, j + 1) and `below_left` (i, j)–(i + 1, j − 1).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..base.errors import NotConverged

Array = NDArray[np.float64]
#: Nodes of the coarsest level up to which multigrid is worth while; only slender grids have more.
COARSEST_NODES = 128
#: Nodes of an axis at which coarsening ends.
_FEWEST = 4
#: Largest correction that may be left at a node, in shares of the error allowed in the norm of the energy, which does
#: not see an island behind narrow links.
_LARGEST = 100.0
#: Iterations after which their number is foreseen.
_FORESEEN = 10

_compiled: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"reassoc", "contract", "arcp", "nsz"},
}


def coarsest_nodes(n1: int, n2: int) -> int:
    """Nodes of the coarsest level for n1 × n2 unknowns; many if the network is slender."""
    while min(n1, n2) > _FEWEST:
        n1, n2 = (n1 + 1) // 2, (n2 + 1) // 2
    return n1 * n2


def solve_multigrid(
    operator: tuple[Array, ...],
    ring: bool,
    inlet: Array,
    outlet: Array,
    rtol: float,
    limit: int,
    judged: NDArray[np.bool_] | None = None,
) -> tuple[Array, int, float]:
    """Potential φ of the nodes for a unit drop, iterations, and the error estimate reached.

    Parameters
    ----------
    operator : centres and links right and below and, for nine points, below right and below left, each
        (n1 + 2, n2 + 2) with its border; `network_operator` makes it of a network's conductances.
    ring : whether the columns form a ring.
    inlet, outlet : (n2) links of the first and the last row of nodes to the ends, φ = 1 and 0.
    rtol : of √(rᵀM⁻¹r / rate), which estimates the error of φ in the norm of the energy; M⁻¹r, an estimate of the error
        itself, may be 100 times that at any node judged.
    limit : of iterations.
    judged : nodes (n1, n2) whose potential has to be right, all unless given.

    Raises
    ------
    NotConverged : as soon as it is foreseen not to happen within `limit` iterations.

    Notes
    -----
    The coarsest level is inverted densely: `coarsest_nodes` says how large it is.
    """
    five = (np.zeros((1, 1)), np.zeros((1, 1))) if len(operator) == 3 else ()
    try:
        if judged is None:
            judged = np.ones((operator[0].shape[0] - 2, operator[0].shape[1] - 2), np.bool_)
        x, iterations, error = _solve(*operator, *five, ring, inlet, outlet, rtol, limit, judged)
    except np.linalg.LinAlgError:
        raise NotConverged("flow: the coarsest grid of multigrid is singular; try the direct solver", np.inf) from None
    if not error <= rtol:
        raise NotConverged(
            f"flow: error {error:.1e} after {iterations} iterations of multigrid, wanted {rtol:.1e}; "
            "try the direct solver",
            error,
        )
    return x, iterations, error


@njit(**_compiled)
def _solve(centre, right, below, below_right, below_left, ring, inlet, outlet, rtol, limit, judged):
    """Conjugate gradients; an error above rtol where they were given up."""
    levels = _hierarchy(centre, right, below, below_right, below_left, ring)
    inverse = _inverse(levels[-1], ring)
    nine = below_right.size > 1
    n1, n2 = centre.shape[0] - 2, centre.shape[1] - 2
    z, b = levels[0][7], levels[0][8]
    x, r, p, y = np.zeros(z.shape), np.zeros(z.shape), np.zeros(z.shape), np.zeros(z.shape)
    for j in range(n2):
        r[1, j + 1] = b[1, j + 1] = inlet[j]
    rz, error, first = 0.0, np.inf, 0.0
    iteration = 0
    while True:
        _cycle(levels, inverse, ring)
        before, rz, largest = rz, 0.0, 0.0
        for i in range(1, n1 + 1):
            for j in range(1, n2 + 1):
                rz += r[i, j] * z[i, j]
                if judged[i - 1, j - 1]:
                    largest = max(largest, abs(z[i, j]))
        rate = 0.0
        for j in range(n2):
            rate += outlet[j] * x[n1, j + 1]
        error = np.sqrt(rz / rate) if rz >= 0.0 and rate > 0.0 else np.inf
        if iteration == 0:
            first = rz
        if error <= rtol and largest <= _LARGEST * rtol:
            break
        hopeless = iteration == limit or not 0.0 < rz < np.inf
        if not hopeless and iteration >= _FORESEEN and rate > 0.0:
            hopeless = iteration * np.log(first / (rtol**2 * rate)) > limit * np.log(first / rz)
        if hopeless:
            error = max(error, largest / _LARGEST)
            break
        beta = rz / before if iteration > 0 else 0.0
        curvature = _direction(centre, right, below, below_right, below_left, z, p, y, beta, nine, ring)
        if not curvature > 0.0:
            error = np.inf
            break
        _advance(rz / curvature, p, y, x, r, b)
        iteration += 1
    return x[1:-1, 1:-1].copy(), iteration, error


@njit(**_compiled)
def _wrap(weights):
    """Those of the first and last columns repeat the others', around a ring."""
    rows, columns = weights.shape[:2]
    for i in range(rows):
        for k in range(3):
            for m in range(3):
                weights[i, 0, k, m] = weights[i, columns - 2, k, m]
                weights[i, columns - 1, k, m] = weights[i, 1, k, m]


@njit(**_compiled)
def _hierarchy(centre, right, below, below_right, below_left, ring):
    """Levels from the finest: operator, inverse centres, weights of the next level's nodes, and work x, b, r."""
    levels = []
    while True:
        shape = centre.shape
        nine = below_right.size > 1
        last = min(shape[0], shape[1]) - 2 <= _FEWEST
        if last:
            weights = np.zeros((1, 1, 3, 3))
        else:
            weights = _interpolation(centre, right, below, below_right, below_left, nine)
            if ring:
                _wrap(weights)
        inverse = np.zeros(shape)
        for i in range(shape[0]):
            for j in range(shape[1]):
                if centre[i, j] > 0.0:
                    inverse[i, j] = 1.0 / centre[i, j]
        levels.append((centre, right, below, below_right, below_left, inverse, weights, np.zeros(shape),
                       np.zeros(shape), np.zeros(shape)))  # fmt: skip
        if last:
            return levels
        centre, right, below, below_right, below_left = _galerkin(
            centre, right, below, below_right, below_left, weights, nine, ring
        )


@njit(**_compiled)
def _cycle(levels, inverse, ring):
    """One V-cycle from b to x of the finest level."""
    for k in range(len(levels) - 1):
        _, right, below, below_right, below_left, inverse_centre, weights, x, b, r = levels[k]
        _sweep_down(x, b, r, inverse_centre, right, below, below_right, below_left, below_right.size > 1, ring)
        _restrict(r, weights, levels[k + 1][8])
    x, b = levels[-1][7], levels[-1][8]
    n2 = x.shape[1] - 2
    for i in range(inverse.shape[0]):
        s = 0.0
        for j in range(inverse.shape[0]):
            s += inverse[i, j] * b[j // n2 + 1, j % n2 + 1]
        x[i // n2 + 1, i % n2 + 1] = s
    for k in range(len(levels) - 2, -1, -1):
        _, right, below, below_right, below_left, inverse_centre, weights, x, b, _ = levels[k]
        _prolong(levels[k + 1][7], weights, x, ring)
        _sweep_up(x, b, inverse_centre, right, below, below_right, below_left, below_right.size > 1, ring)


@njit(**_compiled)
def _inverse(level, ring):
    """Dense inverse of the coarsest operator on the nodes that have links, 0 for the others."""
    a = _dense(level[0], level[1], level[2], level[3], level[4], ring)
    n = a.shape[0]
    scale = np.zeros(n)
    for i in range(n):
        if a[i, i] > 0.0:
            scale[i] = 1.0 / np.sqrt(a[i, i])
    for i in range(n):
        for j in range(n):
            a[i, j] *= scale[i] * scale[j]
        # nodes without links get a row of their own; Galerkin's operator may be singular to rounding
        a[i, i] += 1e-14 if scale[i] > 0.0 else 1.0
    a = np.linalg.inv(a)
    for i in range(n):
        for j in range(n):
            a[i, j] *= scale[i] * scale[j]
    return a


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

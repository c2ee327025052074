"""Conjugate gradients with algebraic multigrid on the structured grid as preconditioner: compiled.

One sweep of Gauss-Seidel forward before and backward after the coarser grid keep the preconditioner symmetric; the
levels come from `hierarchy`, where their fields are described.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ...base.errors import NotConverged
from ..stencil import Stencil
from .hierarchy import COMPILED, bordered, coarsest_inverse, hierarchy

Array = NDArray[np.float64]
#: Largest coarsest level, in nodes, for which multigrid pays; only slender grids have more.
COARSEST_NODES = 128
#: Largest correction left at a node, relative to the error allowed in the norm of the energy; that norm hardly has a
#: share of nodes that only narrow links connect with the others.
_LARGEST = 100.0
#: Iterations after which the number still needed is extrapolated.
_FORESEEN = 10


def solve_multigrid(
    stencil: Stencil, rtol: float, limit: int, judged: NDArray[np.bool_] | None = None
) -> tuple[Array, int, float]:
    """Potential φ of the inner nodes for a unit drop, iterations, and the error estimate reached.

    Parameters
    ----------
    stencil : every coupled node must be connected to both ends.
    rtol : of √(rᵀM⁻¹r / rate), which estimates the error of φ in the norm of the energy; M⁻¹r, an estimate of the error
        itself, may be 100 times that at any node judged.
    limit : of iterations.
    judged : inner nodes (n1 − 1, n2) whose potential has to be right, all unless given.

    Raises
    ------
    NotConverged : as soon as the extrapolated number of iterations exceeds `limit`.

    Notes
    -----
    The coarsest level is inverted densely: `coarsest_nodes` says how large it is.
    """
    s = stencil
    operator, inlet, outlet = bordered(s.along, s.across, s.falling, s.rising, s.ring2)
    if judged is None:
        judged = np.ones((s.along.shape[0] - 1, s.along.shape[1]), np.bool_)
    try:
        x, iterations, error = _solve(*operator, s.ring2, inlet, outlet, rtol, limit, judged)
    except np.linalg.LinAlgError:
        raise NotConverged(
            "flow: the coarsest grid of multigrid is singular; try the solver 'elimination'", np.inf
        ) from None
    if not error <= rtol:
        raise NotConverged(
            f"flow: error {error:.1e} after {iterations} iterations of multigrid, wanted {rtol:.1e}; "
            "try the solver 'elimination'",
            error,
        )
    return x, iterations, error


@njit(**COMPILED)
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


@njit(**COMPILED)
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


@njit(**COMPILED)
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


@njit(**COMPILED)
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


@njit(**COMPILED)
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


@njit(**COMPILED)
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


@njit(**COMPILED)
def _advance(step, p, y, x, r, b):
    """x += step p, r −= step y, b = r."""
    n1, n2 = p.shape[0] - 2, p.shape[1] - 2
    for i in range(1, n1 + 1):
        for j in range(1, n2 + 1):
            x[i, j] += step * p[i, j]
            r[i, j] -= step * y[i, j]
            b[i, j] = r[i, j]


@njit(**COMPILED)
def _solve(centre, right, below, below_right, below_left, ring, inlet, outlet, rtol, limit, judged):
    """Conjugate gradients; the error is above rtol if they were stopped early."""
    levels = hierarchy(centre, right, below, below_right, below_left, ring)
    inverse = coarsest_inverse(levels[-1], ring)
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

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
from .clusters import relax_backward, relax_forward
from .compiled import COMPILED
from .hierarchy import bordered, coarsest_inverse, hierarchy

Array = NDArray[np.float64]
#: Largest coarsest level, in nodes, for which multigrid pays; only slender grids have more.
COARSEST_NODES = 128
#: The estimated error of the rate is this share of what is allowed: it is an estimate, from below where the iteration
#: has not met the slowest part of the error yet.
_SHARE = 0.1
#: Largest correction left at a node, relative to the error allowed in the norm of the energy; that norm hardly has a
#: share of nodes that only narrow links connect with the others.
_LARGEST = 100.0
#: Iterations after which the number still needed is extrapolated.
_FORESEEN = 10


def solve_multigrid(
    stencil: Stencil,
    rtol: float,
    limit: int,
    judged: NDArray[np.bool_] | None = None,
    field_rtol: float | None = None,
) -> tuple[Array, int, float]:
    """Potential φ of the inner nodes for a unit drop, iterations, and the error of φ in the norm of the energy.

    Parameters
    ----------
    stencil : every coupled node must be connected to both ends.
    rtol : relative error of the rate Σ c (Δφ)² allowed.
    limit : of iterations.
    judged : inner nodes (n1 − 1, n2) whose potential has to be right, all unless given.
    field_rtol : if the potential itself has to be right, its error allowed in the norm of the energy; M⁻¹r, an estimate
        of the error itself, may be 100 times that at any node judged.

    Raises
    ------
    NotConverged : as soon as the extrapolated number of iterations exceeds `limit`.

    Notes
    -----
    The rate of φ exceeds the true one by the square of the error e of φ in the norm of the energy, eᵀAe <= rᵀM⁻¹r/θ,
    with the lowest eigenvalue θ of M⁻¹A, which is taken from the coefficients of the iteration (Lanczos). The iteration
    stops when that is a tenth of what is allowed, and inlet and outlet flow, which err by the first order, differ by
    less than thrice the square root of it. The coarsest level is inverted densely: `coarsest_nodes` says how large it
    is.
    Sources: Strakoš & Tichý, ETNA 13, 2002, 56; Meurant, Papež & Tichý, Numer. Algorithms 88, 2021, 1337.
    """
    s = stencil
    operator, inlet, outlet = bordered(s.along, s.across, s.falling, s.rising, s.ring2)
    if judged is None:
        judged = np.ones((s.along.shape[0] - 1, s.along.shape[1]), np.bool_)
    field = np.inf if field_rtol is None else field_rtol
    try:
        x, iterations, error, done = _solve(*operator, s.ring2, inlet, outlet, rtol, field, limit, judged)
    except np.linalg.LinAlgError:
        raise NotConverged(
            "flow: the coarsest grid of multigrid is singular; try the solver 'elimination'", np.inf
        ) from None
    if not done:
        raise NotConverged(
            f"flow: error {error**2:.1e} of the rate after {iterations} iterations of multigrid, wanted {rtol:.1e}"
            + (f", and {error:.1e} of the pressure, wanted {field:.1e}" if field_rtol else "")
            + "; try the solver 'elimination'",
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
        centre, right, below, below_right, below_left, inverse_centre, weights, x, b, r, apart = levels[k]
        nine = below_right.size > 1
        _sweep_down(x, b, r, inverse_centre, right, below, below_right, below_left, nine, ring)
        if apart[3].size > 0:
            relax_forward(apart, x, r, centre, right, below, below_right, below_left, nine, ring)
        _restrict(r, weights, levels[k + 1][8])
    x, b = levels[-1][7], levels[-1][8]
    n2 = x.shape[1] - 2
    for i in range(inverse.shape[0]):
        s = 0.0
        for j in range(inverse.shape[0]):
            s += inverse[i, j] * b[j // n2 + 1, j % n2 + 1]
        x[i // n2 + 1, i % n2 + 1] = s
    for k in range(len(levels) - 2, -1, -1):
        centre, right, below, below_right, below_left, inverse_centre, weights, x, b, _, apart = levels[k]
        nine = below_right.size > 1
        _prolong(levels[k + 1][7], weights, x, ring)
        if apart[3].size > 0:
            relax_backward(apart, x, b, centre, right, below, below_right, below_left, nine, ring)
        _sweep_up(x, b, inverse_centre, right, below, below_right, below_left, nine, ring)


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
def _start(centre, right, below, below_right, below_left, inlet, outlet, x, r):
    """x of the least energy among potentials that are constant along rows, and its residual r."""
    n1, n2 = x.shape[0] - 2, x.shape[1] - 2
    resistance = np.zeros(n1 + 1)
    for i in range(n1 + 1):
        s = 0.0
        for j in range(1, n2 + 1):
            if i == 0:
                s += inlet[j - 1]
            elif i == n1:
                s += outlet[j - 1]
            else:
                s += below[i, j]
                if below_right.size > 1:
                    s += below_right[i, j] + below_left[i, j]
        resistance[i] = 1.0 / s
    total = resistance.sum()
    rest = 0.0
    for i in range(n1, 0, -1):
        rest += resistance[i]
        for j in range(1, n2 + 1):
            if centre[i, j] > 0.0:
                x[i, j] = rest / total
    for i in range(n1 + 1):
        drop = resistance[i] / total
        for j in range(1, n2 + 1):
            if i == 0:
                r[1, j] += inlet[j - 1] * drop
            elif i == n1:
                r[n1, j] -= outlet[j - 1] * drop
            else:
                flow = below[i, j] * drop
                r[i, j] -= flow
                r[i + 1, j] += flow
                if below_right.size > 1:
                    flow = below_right[i, j] * drop
                    r[i, j] -= flow
                    r[i + 1, j + 1] += flow
                    flow = below_left[i, j] * drop
                    r[i, j] -= flow
                    r[i + 1, j - 1] += flow


@njit(**COMPILED)
def _lowest(steps, ratios, count):
    """The lowest eigenvalue of M⁻¹A on the space searched, within a factor of two, from the steps and ratios of CG."""
    if count == 0:
        return 1.0
    value = 1.0 / steps[0]
    for i in range(1, count):
        value = min(value, 1.0 / steps[i] + ratios[i] / steps[i - 1])
    for _ in range(100):
        # LDLᵀ of the tridiagonal matrix minus the value; no pivot is negative below the lowest eigenvalue
        pivot = 1.0 / steps[0] - value
        for i in range(1, count):
            if not pivot > 0.0:
                break
            pivot = 1.0 / steps[i] + ratios[i] / steps[i - 1] - value - ratios[i] / (steps[i - 1] ** 2 * pivot)
        if pivot > 0.0:
            break
        value *= 0.5
    return value


@njit(**COMPILED)
def _solve(centre, right, below, below_right, below_left, ring, inlet, outlet, rtol, field, limit, judged):
    """Conjugate gradients: potential, iterations, error in the norm of the energy, and whether it is what was asked."""
    levels = hierarchy(centre, right, below, below_right, below_left, ring)
    inverse = coarsest_inverse(levels[-1], ring)
    nine = below_right.size > 1
    n1, n2 = centre.shape[0] - 2, centre.shape[1] - 2
    z, b = levels[0][7], levels[0][8]
    x, r, p, y = np.zeros(z.shape), np.zeros(z.shape), np.zeros(z.shape), np.zeros(z.shape)
    _start(centre, right, below, below_right, below_left, inlet, outlet, x, r)
    if ring:
        for i in range(1, n1 + 1):
            r[i, n2] += r[i, 0]
            r[i, 1] += r[i, n2 + 1]
    for i in range(1, n1 + 1):
        for j in range(1, n2 + 1):
            b[i, j] = r[i, j]
    steps, ratios = np.zeros(limit + 1), np.zeros(limit + 1)
    allowed = min(_SHARE * rtol, (0.1 * field) ** 2)
    balance = 3.0 * max(np.sqrt(rtol), 1e-6)
    rz, error, first = 0.0, np.inf, 0.0
    iteration = 0
    done = False
    while True:
        _cycle(levels, inverse, ring)
        before, rz, largest, excess, at_inlet = rz, 0.0, 0.0, 0.0, 0.0
        for i in range(1, n1 + 1):
            for j in range(1, n2 + 1):
                rz += r[i, j] * z[i, j]
                excess += r[i, j]
                at_inlet += r[i, j] * x[i, j]
        rate = 0.0
        for j in range(n2):
            rate += outlet[j] * x[n1, j + 1]
        error = np.inf
        if 0.0 <= rz <= allowed * rate and max(abs(excess), abs(at_inlet)) <= balance * rate:
            error = np.sqrt(rz / rate / _lowest(steps, ratios, iteration))
            if field < np.inf:
                for i in range(1, n1 + 1):
                    for j in range(1, n2 + 1):
                        if judged[i - 1, j - 1]:
                            largest = max(largest, abs(z[i, j]))
            if error**2 <= allowed and largest <= _LARGEST * 0.1 * field:
                done = True
                break
        if iteration == 0:
            first = rz
        if iteration == limit or not 0.0 < rz < np.inf:
            break
        if iteration >= _FORESEEN and rate > 0.0 and rz > allowed * rate:
            needed = iteration * np.log(first / (allowed * rate)) / np.log(first / rz)
            if rz >= first or needed > limit:
                break
        beta = rz / before if iteration > 0 else 0.0
        curvature = _direction(centre, right, below, below_right, below_left, z, p, y, beta, nine, ring)
        if not curvature > 0.0:
            break
        steps[iteration], ratios[iteration] = rz / curvature, beta
        _advance(rz / curvature, p, y, x, r, b)
        iteration += 1
    if not done and rate > 0.0 and rz >= 0.0:
        error = np.sqrt(rz / rate)
    return x[1:-1, 1:-1].copy(), iteration, error, done

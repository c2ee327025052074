"""Conjugate gradients with algebraic multigrid on the structured grid as preconditioner: compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ...base.errors import NotConverged
from ..stencil import Stencil
from .coarsest import eliminate_coarsest
from .compiled import COMPILED
from .hierarchy import hierarchy, level
from .v_cycle import v_cycle

Array = NDArray[np.float64]
#: Largest coarsest level, in nodes, for which multigrid pays; only slender grids have more.
COARSEST_NODES = 128
#: The estimated error of the rate is this fraction of what is allowed: an estimate, from below where the iteration
#: has not met the slowest part of the error yet.
_SHARE = 0.1
#: The slowest part of the error, as an eigenvalue of M⁻¹A, that may be there without the iteration having met it, at
#: first and at last. Without this, 1 in 2000 random cells of extreme contrast erred by more than was allowed.
_SLOWEST = 2e-3, 1e-7
#: Iterations that are usual on 128² nodes, and two more on twice as many; where it takes more there may be slower
#: parts, half so slow with each.
_FEW = 6
#: Largest correction left at a node, relative to the error allowed in the norm of the energy; that norm hardly has a
#: fraction of nodes that only narrow links connect with the others.
_LARGEST = 100.0
#: No nodes singled out: all are judged.
_ALL = np.zeros((0, 0), np.bool_)
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
    with the lowest eigenvalue θ of M⁻¹A, which is taken from the coefficients of the iteration (Lanczos), with a margin
    for what it has not met yet. The iteration stops when that is a tenth of what is allowed, and inlet and outlet flow,
    which err by the first order, differ by less than thrice the square root of it. The coarsest level is eliminated.
    Sources: Strakoš & Tichý, ETNA 13, 2002, 56; Meurant, Papež & Tichý, Numer. Algorithms 88, 2021, 1337.
    """
    s = stencil
    if judged is None:
        judged = _ALL
    field = np.inf if field_rtol is None else field_rtol
    levels, inlet, outlet = hierarchy(s.along, s.across, s.falling, s.rising, s.ring2)
    last = len(levels.shape) - 1
    centre, right, below, _, _, _, _, below_right, below_left = level(*levels[:5], last)
    coarsest = eliminate_coarsest(centre, right, below, below_right, below_left, s.ring2)
    x, iterations, error, done = _solve(levels, coarsest, inlet, outlet, s.nine, s.ring2, rtol, field, limit, judged)
    if not done:
        raise NotConverged(
            f"flow: error {error**2:.1e} of the rate after {iterations} iterations of multigrid, wanted {rtol:.1e}"
            + (f", and {error:.1e} of the pressure, wanted {field:.1e}" if field_rtol else "")
            + "; try the solver 'elimination'",
            error,
        )
    return x[1:-1, 1:-1].copy(), iterations, error


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
def _advance(step, p, y, x, r):
    """x += step p, r −= step y; the sums of r and of r x, by which inlet and outlet flow and the rate differ."""
    n1, n2 = p.shape[0] - 2, p.shape[1] - 2
    excess = weighted = 0.0
    for i in range(1, n1 + 1):
        for j in range(1, n2 + 1):
            x[i, j] += step * p[i, j]
            r[i, j] -= step * y[i, j]
            excess += r[i, j]
            weighted += r[i, j] * x[i, j]
    return max(abs(excess), abs(weighted))


@njit(**COMPILED)
def _start(centre, right, below, below_right, below_left, inlet, outlet, x, r):
    """x of the least energy among potentials that are constant along rows, and its residual r."""
    n1, n2 = x.shape[0] - 2, x.shape[1] - 2
    resistance = np.empty(n1 + 1)
    total = 0.0
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
        total += resistance[i]
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
def _slowest(steps, ratios, count, nodes):
    """The slowest part of the error that is reckoned with, from the lowest eigenvalue of M⁻¹A on the space searched.

    That is found within a factor of two from the steps and ratios of `count` iterations.
    """
    lowest = 1.0 if count == 0 else 1.0 / steps[0]
    for i in range(1, count):
        lowest = min(lowest, 1.0 / steps[i] + ratios[i] / steps[i - 1])
    for _ in range(100):
        # LDLᵀ of the tridiagonal matrix minus the value; no pivot is negative below the lowest eigenvalue
        pivot = 1.0 if count == 0 else 1.0 / steps[0] - lowest
        for i in range(1, count):
            if not pivot > 0.0:
                break
            pivot = 1.0 / steps[i] + ratios[i] / steps[i - 1] - lowest - ratios[i] / (steps[i - 1] ** 2 * pivot)
        if pivot > 0.0:
            break
        lowest *= 0.5
    first, last = _SLOWEST
    usual = _FEW + 2.0 * max(0.0, np.log2(nodes / 128**2))
    unmet = min(lowest**2 / first, first) * 0.5 ** max(0.0, count - usual)
    return min(max(unmet, last), lowest)


@njit(**COMPILED)
def _solve(levels, coarsest, inlet, outlet, nine, ring, rtol, field, limit, judged):
    """Conjugate gradients: potential, iterations, error in the norm of the energy, and whether it is what was asked."""
    # the residual is the right-hand side of a cycle, whose own residual is not needed after it
    centre, right, below, _, z, r, y, below_right, below_left = level(
        levels[0], levels[1], levels[2], levels[3], levels[4], np.int64(0)
    )
    n1, n2 = centre.shape[0] - 2, centre.shape[1] - 2
    x, p = np.zeros(z.shape), np.zeros(z.shape)
    _start(centre, right, below, below_right, below_left, inlet, outlet, x, r)
    if ring:
        for i in range(1, n1 + 1):
            r[i, n2] += r[i, 0]
            r[i, 1] += r[i, n2 + 1]
    steps, ratios = np.zeros(limit + 1), np.zeros(limit + 1)
    allowed = min(_SHARE * rtol, (0.1 * field) ** 2)
    balance = 3.0 * max(np.sqrt(rtol), 1e-6)
    rz, error, first, unbalanced = 0.0, np.inf, 0.0, 0.0
    iteration = 0
    done = False
    while True:
        v_cycle(levels, coarsest, nine, ring)
        before, rz, largest = rz, 0.0, 0.0
        for i in range(1, n1 + 1):
            for j in range(1, n2 + 1):
                rz += r[i, j] * z[i, j]
        rate = 0.0
        for j in range(n2):
            rate += outlet[j] * x[n1, j + 1]
        error = np.inf
        if 0.0 <= rz <= allowed * rate and unbalanced <= balance * rate:
            error = np.sqrt(rz / rate / _slowest(steps, ratios, np.int64(iteration), n1 * n2))
            if field < np.inf:
                for i in range(1, n1 + 1):
                    for j in range(1, n2 + 1):
                        if judged.size == 0 or judged[i - 1, j - 1]:
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
        unbalanced = _advance(rz / curvature, p, y, x, r)
        iteration += 1
    if not done and rate > 0.0 and rz >= 0.0:
        error = np.sqrt(rz / rate)
    return x, iteration, error, done

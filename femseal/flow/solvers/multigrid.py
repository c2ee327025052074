"""Conjugate gradients with algebraic multigrid on the structured grid as preconditioner: compiled.

Potential, residual and operator are in double precision, the operator as differences; the cycle and the directions are
in single precision, which the residual then follows to all digits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.compiled import REORDERED, compiled, inner
from ...base.errors import NotConverged
from ...base.threads import ONE, ZERO, over
from ..stencil import Stencil
from .coarsest import Coarsest, eliminate_by_parts, eliminate_coarsest
from .hierarchy import Levels, hierarchy, large_levels, level, strips
from .v_cycle import cycle, v_cycle

Array = NDArray[np.float64]
#: Largest coarsest level, in nodes, for which multigrid pays; only slender grids have more.
COARSEST_NODES = 128
#: The estimated error of the rate is this fraction of what is allowed: an estimate, from below where the iteration
#: has not met the slowest part of the error yet.
_SHARE = 0.1
#: The slowest part of the error, as an eigenvalue of M⁻¹A, that may be there without the iteration having met it, at
#: first and at last. Without this, 1 in 2000 random cells of extreme contrast erred by more than was allowed; with it,
#: 3 of 1200 smooth gaps with 10 to 35 % in contact, where the caller did not check the solution.
_SLOWEST = 2e-3, 1e-7
#: Largest correction left at a node, relative to the error allowed in the norm of the energy; that norm hardly has a
#: fraction of nodes that only narrow links connect with the others.
_LARGEST = 100.0
#: No nodes are hidden.
_NONE = np.zeros((0, 0), np.bool_)
#: Where memory is short, A p is not kept but found twice.
_NOTHING = np.zeros((0, 0))
#: Iterations after which the number still needed is extrapolated.
_FORESEEN = 10


def solve_multigrid(
    stencil: Stencil,
    rtol: float,
    limit: int,
    hidden: NDArray[np.bool_] | None = None,
    field_rtol: float | None = None,
) -> tuple[Array, int, float]:
    """Potential φ of all nodes for a unit drop, iterations, and the error of φ in the norm of the energy.

    The caller bounds the error of a solution of many iterations, of which slow parts may not be met.

    Parameters
    ----------
    stencil : every coupled node must be connected to both ends.
    rtol : relative error of the rate Σ c (Δφ)² allowed.
    limit : of iterations.
    hidden : inner nodes (n1 − 1, n2) whose potential need not be right, none unless given.
    field_rtol : if the potential itself has to be right, its error allowed in the norm of the energy; M⁻¹r, an estimate
        of the error itself, may be 100 times that at any node not hidden.

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
    field, hidden = (
        np.inf if field_rtol is None else field_rtol,
        _NONE if hidden is None else hidden,
    )
    conductances = s.along, s.across
    levels, operator = hierarchy(*conductances, s.ring2)
    large = large_levels(levels.shape)
    eliminate: Any = eliminate_by_parts if large == len(levels.shape) - 1 else eliminate_coarsest
    coarsest = eliminate(*operator, s.ring2)
    iterate: Any = _iterate_by_parts if large else _iterate
    x, iterations, error, done = iterate(
        levels, coarsest, conductances, s.ring2, rtol, field, limit, hidden
    )
    small = error**2 <= rtol and error <= field
    if not (done or (small and field_rtol is None)):
        found = f"error {error**2:.1e} of the rate" + (
            f" and {error:.1e} of the pressure" if field_rtol else ""
        )
        wanted = f"{rtol:.1e}" + (f" and {field:.1e}" if field_rtol else "")
        hedged = ", but slow parts of it may not be seen" if small else ""
        raise NotConverged(
            f"flow: {found} after {iterations} iterations of multigrid, wanted {wanted}{hedged}; "
            "try the solver 'elimination'",
            error,
        )
    return x, iterations, error


@inner(**REORDERED)
def _flow_out(conductances, p, i, ring, beside, y):
    """Write A p of row i, of p with a border of one node that is 0 at the ends: from differences.

    beside : room for the flow from each node of the row to the next one. Loops over few arrays become vector
    instructions: they take a third of the time of one over all.
    """
    along, across = conductances
    n2 = along.shape[1]
    above, below, to_right = along[i - 1], along[i], across[i - 1]
    before, here, after = p[i - 1], p[i], p[i + 1]
    for j in range(1, n2):
        beside[j] = to_right[j - 1] * (np.float64(here[j]) - here[j + 1])
    beside[0] = beside[n2] = to_right[n2 - 1] * (np.float64(here[n2]) - here[1]) if ring else 0.0
    for j in range(1, n2 + 1):
        x = np.float64(here[j])
        y[j] = (
            above[j - 1] * (x - before[j])
            + below[j - 1] * (x - after[j])
            + (beside[j] - beside[j - 1])
        )


@compiled(**REORDERED)
def _turn(first, end, z, scale, beta, p):
    """p = scale z + β p on some rows."""
    for i in range(first, end):
        for j in range(1, p.shape[1] - 1):
            p[i, j] = scale * z[i, j] + beta * p[i, j]


@compiled(**REORDERED)
def _curvature(first, end, conductances, p, ring, flow):
    """The part of p·A p of some rows; A p is written to `flow`, unless that is empty."""
    n2 = p.shape[1] - 2
    y, beside = np.empty(n2 + 2), np.empty(n2 + 1)
    total = 0.0
    for i in range(first, end):
        if flow.size > 0:
            y = flow[i]
        _flow_out(conductances, p, i, ring, beside, y)
        for j in range(1, n2 + 1):
            total += y[j] * p[i, j]
    return total


@compiled(**REORDERED)
def _advance(first, end, conductances, step, p, scale, ring, flow, x, r, b):
    """x += step p, r −= step A p, b = r / scale on some rows; their sums of r and of r x.

    Those of all rows are what inlet and outlet flow and the rate differ by. A p is found again where `flow` is empty.
    """
    n2 = p.shape[1] - 2
    y, beside = np.empty(n2 + 2), np.empty(n2 + 1)
    excess = weighted = 0.0
    for i in range(first, end):
        if flow.size > 0:
            y = flow[i]
        else:
            _flow_out(conductances, p, i, ring, beside, y)
        xs, rs, ps, bs = x[i], r[i], p[i], b[i]
        for j in range(1, n2 + 1):
            value, rest = xs[j - 1] + step * ps[j], rs[j] - step * y[j]
            xs[j - 1], rs[j] = value, rest
            excess += rest
            weighted += rest * value
        for j in range(1, n2 + 1):
            bs[j] = rs[j] / scale
    return excess, weighted


@compiled(**REORDERED)
def _product(first, end, r, z, field, hidden):
    """The part of r·z of some rows; where the field is wanted also their largest |z| at nodes that are not hidden."""
    total = largest = 0.0
    for i in range(first, end):
        for j in range(1, z.shape[1] - 1):
            total += r[i, j] * z[i, j]
        if field < np.inf:
            for j in range(1, z.shape[1] - 1):
                if hidden.size == 0 or not hidden[i - 1, j - 1]:
                    largest = max(largest, abs(z[i, j]))
    return total, largest


@compiled(**REORDERED)
def _resistances(first, end, conductances, drop):
    """Write the inverse sum of the conductances from some rows to the next ones, the inlet's with the first."""
    along = conductances[0]
    for i in range(first if first > 1 else 0, end):
        s = 0.0
        for j in range(along.shape[1]):
            s += along[i, j]
        drop[i] = 1.0 / s


@compiled(**{**REORDERED, "fastmath": {"arcp"}})
def _drops(drop):
    """Make resistances from row to row the drops of a flow through all; the potentials of the rows before them."""
    rest, total = np.empty(drop.size), 0.0
    for i in range(drop.size):
        total += drop[i]
    before = 0.0
    for i in range(drop.size - 1, -1, -1):
        drop[i] /= total
        before += drop[i]
        rest[i] = before
    return rest


@compiled(**{**REORDERED, "fastmath": False})
def _start(first, end, conductances, drop, rest, inverse, x, r, b):
    """x of the least energy among potentials that are constant along rows, and its residual r, also as b."""
    along = conductances[0]
    n2 = along.shape[1]
    for i in range(first, end):
        for j in range(n2):
            if inverse[i, j + 1] > 0.0:
                x[i, j] = rest[i]
        # flows to the next row, and from the one before
        for j in range(n2):
            r[i, j + 1] -= along[i, j] * drop[i]
        for j in range(n2):
            r[i, j + 1] += along[i - 1, j] * drop[i - 1]
        for j in range(1, n2 + 1):
            b[i, j] = r[i, j]


@compiled(**REORDERED)
def _outflow(conductances, x):
    """Flow of x into the outlet."""
    along = conductances[0]
    n1, n2 = along.shape[0] - 1, along.shape[1]
    rate = 0.0
    for j in range(n2):
        rate += along[n1, j] * x[n1, j]
    return rate


@inner(**REORDERED)
def _slowest(steps, ratios, count):
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
            pivot = (
                1.0 / steps[i]
                + ratios[i] / steps[i - 1]
                - lowest
                - ratios[i] / (steps[i - 1] ** 2 * pivot)
            )
        if pivot > 0.0:
            break
        lowest *= 0.5
    first, last = _SLOWEST
    unmet = min(lowest**2 / first, first)
    return min(max(unmet, last), lowest)


@compiled(**REORDERED)
def _judged(iteration, rz, largest, unbalanced, rate, history, rtol, field):
    """Error in the norm of the energy, and whether it is what was asked, or more iterations than allowed are needed.

    history (3, limit + 1) : rᵀM⁻¹r of each iteration, and steps and ratios of those before.
    """
    limit = history.shape[1] - 1
    allowed = min(_SHARE * rtol, (0.1 * field) ** 2)
    error = np.inf
    if 0.0 <= rz <= allowed * rate and unbalanced <= 3.0 * max(np.sqrt(rtol), 1e-6) * rate:
        error = np.sqrt(rz / rate / _slowest(history[1], history[2], np.int64(iteration)))
        if error**2 <= allowed and largest <= _LARGEST * 0.1 * field:
            return error, True, False
    history[0, iteration] = rz
    hopeless = iteration == limit or not 0.0 < rz < np.inf
    if not hopeless and iteration >= _FORESEEN and rate > 0.0 and rz > allowed * rate:
        first = history[0, 0]
        hopeless = (
            rz >= first or iteration * np.log(first / (allowed * rate)) / np.log(first / rz) > limit
        )
    return error, False, hopeless


@compiled(**REORDERED)
def _iterate(levels, coarsest, conductances, ring, rtol, field, limit, hidden):
    """Conjugate gradients: potential, iterations, error in the norm of the energy, and whether it is what was asked."""
    _, _, inverse, z, b, _, _, _ = level(levels[0], levels[1], levels[2], ZERO)
    r = np.zeros(b.shape)
    rows = z.shape[0] - 1
    x, p, history = (
        np.zeros((rows + 1, z.shape[1] - 2)),
        np.zeros(z.shape, np.float32),
        np.zeros((3, limit + 1)),
    )
    flow, drop = np.empty(z.shape), np.empty(rows)
    x[0] = 1.0
    _resistances(ONE, rows, conductances, drop)
    _start(ONE, rows, conductances, drop, _drops(drop), inverse, x, r, b)
    scale, unbalanced, iteration = 1.0, 0.0, np.int64(0)
    while True:
        v_cycle(levels, coarsest, ring, ZERO)
        rz, largest = _product(ONE, rows, r, z, field, hidden)
        rz *= scale
        rate = _outflow(conductances, x)
        error, done, hopeless = _judged(
            iteration, rz, scale * largest, unbalanced, rate, history, rtol, field
        )
        if done or hopeless:
            break
        beta = rz / history[0, iteration - 1] if iteration > 0 else 0.0
        _turn(ONE, rows, z, scale, beta, p)
        curvature = _curvature(ONE, rows, conductances, p, ring, flow)
        if not curvature > 0.0:
            break
        history[1, iteration], history[2, iteration] = rz / curvature, beta
        # far from the limits of single precision, however small the residual is
        scale = np.sqrt(rz)
        excess, weighted = _advance(
            ONE, rows, conductances, rz / curvature, p, scale, ring, flow, x, r, b
        )
        unbalanced = max(abs(excess), abs(weighted))
        iteration += 1
    if not done and rate > 0.0 and rz >= 0.0:
        error = np.sqrt(rz / rate)
    return x, iteration, error, done


def _iterate_by_parts(
    levels: Levels,
    coarsest: Coarsest,
    conductances: tuple[Array, ...],
    ring: bool,
    rtol: float,
    field: float,
    limit: int,
    hidden: NDArray[np.bool_],
) -> tuple[Array, int, float, bool]:
    """`_iterate`, with threads on large levels."""
    _, _, inverse, z, b, _, _, _ = level(*levels[:3], 0)
    # in single precision the residual is the right side of the cycle, else that is a copy relative to its size
    single = conductances[0].dtype == np.float32
    r, flow = (b, _NOTHING) if single else (np.zeros(b.shape), np.empty(b.shape))
    rows = strips(len(z))
    x, p, history = (
        np.zeros((len(z), z.shape[1] - 2)),
        np.zeros(z.shape, np.float32),
        np.zeros((3, limit + 1)),
    )
    x[0], drop = 1.0, np.empty(len(z) - 1)
    over(rows, _resistances, conductances, drop)
    over(rows, _start, conductances, drop, _drops(drop), inverse, x, r, b)
    scale, unbalanced, iteration = 1.0, 0.0, 0
    while True:
        cycle(levels, coarsest, ring)
        products, largest = zip(*over(rows, _product, r, z, field, hidden), strict=True)
        rz = scale * sum(products)
        rate = _outflow(conductances, x)
        error, done, hopeless = _judged(
            iteration, rz, scale * max(largest), unbalanced, rate, history, rtol, field
        )
        if done or hopeless:
            break
        beta = rz / history[0, iteration - 1] if iteration > 0 else 0.0
        over(rows, _turn, z, scale, beta, p)
        curvature = sum(over(rows, _curvature, conductances, p, ring, flow))
        if not curvature > 0.0:
            break
        history[1:, iteration] = rz / curvature, beta
        scale = 1.0 if single else float(np.sqrt(rz))
        sums = over(rows, _advance, conductances, rz / curvature, p, scale, ring, flow, x, r, b)
        unbalanced = max(abs(sum(of_rows)) for of_rows in zip(*sums, strict=True))
        iteration += 1
    if not done and rate > 0.0 and rz >= 0.0:
        error = float(np.sqrt(rz / rate))
    return x, iteration, error, done

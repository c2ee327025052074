"""Solve the flow by conjugate gradients, preconditioned by multigrid on the structured grid.

Potential and residual are stored in double precision, and the operator is applied to differences of the potential. The
multigrid cycle and the search directions are in single precision; the residual is updated with exactly the directions
that are used, so that this causes no error. The cycle has one sweep of damped Jacobi before and one after the coarser
grid. The rows of large levels are divided between threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base import Array
from ...base.compiled import NO, REORDERED, YES, by_rows, compiled, inner, leader
from ...base.errors import NotConverged
from ..error_bound import error_bound
from ..grid import Stencil
from .hierarchy import FEWEST, close_ring, coarser, hierarchy, solve_coarsest

#: Largest number of nodes of the coarsest possible level for which multigrid is efficient. Slender grids have more.
COARSEST_NODES = 128
#: Damping factor of the Jacobi sweeps.
_DAMPING = np.float32(0.8)
#: The iteration stops when the estimated error is below this fraction of the tolerance. The estimate is too small as
#: long as the slowest error component has not appeared. The first fraction is used at first; the second one is used
#: after `CHECKED` iterations, when the error is bounded in addition.
_SHARE, _SHARE_CHECKED = 0.03, 0.3
#: Number of iterations from which on the error of the rate is bounded by means of a conserved flux.
CHECKED = 12
#: Smallest fraction of the tolerance at which an iteration may be asked to stop.
_LEAST_SHARE = 1e-9
#: Smallest eigenvalues of M⁻¹A that are allowed for in the error estimate although the iteration has not found them:
#: after few iterations, and in the limit of many iterations. With ten times the first value, the error exceeded the
#: estimate in 2 of 10,000 random cells of extreme contrast, and in 3 of 1200 smooth gaps with 10 to 35 % in contact.
_SLOWEST = 2e-4, 1e-7
#: Largest remaining correction at a node, relative to the tolerance in the energy norm. This is a separate condition,
#: because nodes that are only connected by narrow links hardly contribute to the energy norm.
_LARGEST = 100.0
#: Flags for the case that no nodes are hidden.
_NONE = np.zeros((0, 0), np.bool_)
#: Number of nodes from which on the work is divided between threads.
_LARGE = 2**18
#: Number of iterations after which the total number of iterations is extrapolated.
_FORESEEN = 10


def coarsest_nodes(n1: int, n2: int) -> int:
    """Return the number of nodes of the coarsest possible level for n1 × n2 unknowns; it is large for slender grids."""
    n1, n2 = n1 + 2, n2 + 2
    while min(n1, n2) - 2 > FEWEST:
        n1, n2 = coarser(n1, n2)
    return (n1 - 2) * (n2 - 2)


def solve_multigrid(
    stencil: Stencil,
    rtol: float,
    limit: int,
    hidden: NDArray[np.bool_] | None = None,
    field_rtol: float | None = None,
    checked: int = CHECKED,
) -> tuple[Array, int, float]:
    """Solve for the potential φ of all nodes for a unit potential drop.

    Parameters
    ----------
    stencil : conductances of the links. Each node with open links must be connected to both ends.
    rtol : largest relative error of the rate Σ c (Δφ)².
    limit : largest number of iterations.
    hidden : flags (n1 − 1, n2) of inner nodes whose potential need not be accurate; by default there are none.
    field_rtol : largest relative error of φ in the energy norm, if φ itself has to be accurate. At each node that is
        not hidden, the estimate M⁻¹r of the error must then also be less than 10 times this number.
    checked : number of iterations from which on the error is bounded.

    Returns
    -------
    Potential φ (n1 + 1, n2), number of iterations, and error of φ in the energy norm.

    Raises
    ------
    NotConverged : the number of iterations, or an extrapolation of it, exceeds `limit`.

    Notes
    -----
    The relative error of the rate is the square of the error e of φ in the energy norm. It satisfies eᵀAe ≤ rᵀM⁻¹r/θ
    with the smallest eigenvalue θ of M⁻¹A, which is estimated from the coefficients of the iteration (Lanczos). If the
    iteration ends early, θ is reduced to allow for error components that have not appeared yet. After `checked`
    iterations the error is bounded rigorously instead, and the iteration is continued if the bound is too large. Inlet
    and outlet flow have a first-order error. They must agree to within three times the square root of the tolerance.
    Sources: Strakoš & Tichý, ETNA 13, 2002, 56; Meurant, Papež & Tichý, Numer. Algorithms 88, 2021, 1337.
    """
    along, across, ring = stencil.along, stencil.across, stencil.ring2
    field = np.inf if field_rtol is None else field_rtol
    with np.errstate(divide="ignore", invalid="ignore"):
        resistance = 1 / along.sum(axis=1, dtype=float)
        drop = resistance / resistance.sum()
    asked = _Asked(rtol, field, limit, _NONE if hidden is None else hidden, checked)
    iterated = _at_once if along.size < _LARGE else _iterated
    x, iterations, error, done = iterated((along, across, ring), drop, asked)
    if done:
        return x, iterations, error
    reached = f"error {error**2:.1e} of the rate"
    wanted = f"{rtol:.1e}"
    if field_rtol:
        reached, wanted = f"{reached} and {error:.1e} of the pressure", f"{wanted} and {field:.1e}"
    raise NotConverged(
        f"flow: {reached} after {iterations} iterations of multigrid, wanted {wanted}; "
        "try the solver 'elimination'",
        error,
    )


class _Asked(NamedTuple):
    """Arguments of `solve_multigrid`; `field` is `field_rtol`, or infinite if only the rate has to be accurate."""

    rtol: float
    field: float
    limit: int
    hidden: NDArray[np.bool_]
    checked: int


@leader(**REORDERED)
def _iterated(network, drop, asked):
    """Perform the iteration of `solve_multigrid`.

    network : conductances `along` and `across` of the stencil, and whether the columns form a ring.
    drop : array (n1,), potential drop between adjacent rows for the initial potential.
    asked : arguments of `solve_multigrid`.

    Returns the potential, the number of iterations, the error in the energy norm, and whether the tolerance is reached.
    """
    levels, coarsest = hierarchy(network[0], network[1], network[2])
    b, z = levels[0].b, levels[0].r
    along, _, ring = network
    n1, n2 = b.shape
    x = np.zeros((n1, n2 - 2))
    r = np.zeros((n1, n2))
    p = np.zeros((n1, n2), np.float32)
    sums = np.zeros((2, n1))
    history = np.zeros((3, asked.limit + 1))
    x[0] = 1.0
    rest = np.cumsum(drop[::-1])[::-1]
    _start(x, r, b, along, (drop, rest), levels[0].inverse)
    scale, unbalanced, iteration, share = 1.0, 0.0, 0, _SHARE_CHECKED
    while True:
        cycle(levels, coarsest, ring)
        _product(z, r, asked.field, asked.hidden, sums)
        rz = scale * sums[0].sum()
        largest = scale * sums[1].max()
        rate = (along[-1] * x[-2]).sum()
        state = rz, largest, unbalanced, rate
        error, done, hopeless = _judged(iteration, state, history, share, asked)
        if done and iteration >= asked.checked:
            bound = error_bound(along, network[1], x, 1.0 - x, asked.hidden)
            error = max(error, np.sqrt(bound))
            if not bound <= asked.rtol:
                done = False
                share *= 0.5 * asked.rtol / bound
                hopeless = not share > _LEAST_SHARE
        if done or hopeless:
            break
        ratio = rz / history[0, iteration - 1] if iteration > 0 else 0.0
        _turn(p, z, scale, ratio)
        _curvature(p, network, sums)
        curvature = sums[0].sum()
        if not curvature > 0.0:
            break
        step = rz / curvature
        history[1, iteration], history[2, iteration] = step, ratio
        # scale the right-hand side of the cycle, so that a small residual is within the range of single precision
        scale = np.sqrt(rz)
        _advance(x, (r, b, p), network, (step, scale), sums)
        unbalanced = max(abs(sums[0].sum()), abs(sums[1].sum()))
        iteration += 1
    if not done and asked.field == np.inf:
        # if rounding errors have stopped the iteration, its error may still be small enough
        error = np.sqrt(error_bound(along, network[1], x, 1.0 - x, asked.hidden))
        done = error**2 <= asked.rtol
    return x, iteration, error, done


#: `_iterated` without threads.
_at_once = compiled(**REORDERED)(_iterated)


@leader(**REORDERED)
def _judged(iteration, state, history, share, asked):
    """Estimate the error in the energy norm, and decide whether the iteration has converged or is hopeless.

    state : rᵀM⁻¹r, largest correction, difference between inlet and outlet flow, and rate.
    history : array (3, limit + 1), rᵀM⁻¹r of each iteration, and step lengths and ratios of the iterations before.
    share : fraction of the tolerance at which the iteration stops if the error is then bounded.

    Returns the error, whether the iteration has converged, and whether it would need more than `limit` iterations.
    """
    rz, largest, unbalanced, rate = state
    rtol, field, limit = asked.rtol, asked.field, asked.limit
    early = iteration < asked.checked or field < np.inf
    allowed = min((min(_SHARE, share) if early else share) * rtol, (0.1 * field) ** 2)
    history[0, iteration] = rz
    error = np.inf
    if 0.0 <= rz <= allowed * rate and unbalanced <= 3.0 * max(np.sqrt(rtol), 1e-6) * rate:
        # if the error is bounded afterwards, no allowance for unseen error components is needed
        slowest = _slowest(history[1, :iteration], history[2, :iteration]) if early else 1.0
        error = np.sqrt(rz / rate / slowest)
        if error**2 <= allowed and largest <= _LARGEST * 0.1 * field:
            return error, True, False
    hopeless = iteration == limit or not 0.0 < rz < np.inf
    if not hopeless and iteration >= _FORESEEN and rate > 0.0 and rz > allowed * rate:
        first = history[0, 0]
        hopeless = (
            rz >= first or iteration * np.log(first / (allowed * rate)) / np.log(first / rz) > limit
        )
    return error, False, hopeless


@compiled(**REORDERED)
def _slowest(steps, ratios):
    """Estimate the smallest eigenvalue of M⁻¹A, with an allowance for eigenvalues that have not appeared yet.

    The smallest eigenvalue in the Krylov space, the smallest Ritz value, is found within a factor of two from the
    tridiagonal matrix of the Lanczos process.

    steps, ratios : step lengths and ratios of the conjugate gradients.
    """
    n = steps.size
    diagonal = np.ones(max(n, 1))
    for i in range(n):
        diagonal[i] = 1.0 / steps[i] + (ratios[i] / steps[i - 1] if i > 0 else 0.0)
    lowest = diagonal.min()
    for _ in range(100):
        # factorise T − lowest · I as LDLᵀ: all pivots are positive if the value is below the smallest eigenvalue
        pivot = diagonal[0] - lowest
        for i in range(1, n):
            if not pivot > 0.0:
                break
            pivot = diagonal[i] - lowest - ratios[i] / (steps[i - 1] ** 2 * pivot)
        if pivot > 0.0:
            break
        lowest *= 0.5
    first, last = _SLOWEST
    return min(max(min(lowest**2 / first, first), last), lowest)


@leader(**REORDERED)
def cycle(levels, coarsest, ring):
    """Perform one V-cycle, which computes `r` of the finest level from its right-hand side `b`."""
    for k in range(len(levels) - 1):
        here, after = levels[k], levels[k + 1]
        _begin(here.x, here.b, here.inverse, ring)
        _sweep(here.r, here, YES, ring)
        _restrict(after.b, here.r, here.weights)
    solve_coarsest(coarsest, levels[-1].b, ring, levels[-1].r)
    for k in range(len(levels) - 2, -1, -1):
        after, here = levels[k + 1], levels[k]
        _prolong(here.x, after.r, here.weights, ring)
        _sweep(here.r, here, NO, ring)


@by_rows(**REORDERED)
def _begin(first, end, x, b, inverse, ring):
    """Perform the first sweep of damped Jacobi, which begins with zero, on some rows."""
    for i in range(first, end):
        for j in range(1, b.shape[1] - 1):
            x[i, j] = _DAMPING * b[i, j] * inverse[i, j]
        if ring:
            close_ring(x[i])


@by_rows(**REORDERED)
def _sweep(first, end, r, level, down, ring):
    """Compute, for some rows, the residual after `_begin` if `down`; otherwise perform a sweep of damped Jacobi.

    After `_begin` x = ω b/a with the damping ω and the diagonal a. The diagonal part of the residual is therefore
    b − a x = (1 − ω) b.
    """
    rights, belows, below_rights, below_lefts = level.links
    x = level.x
    for i in range(first, end):
        here, up, out = x[i], x[i - 1], r[i]
        below, right, above, known = x[i + 1], rights[i], belows[i - 1], level.b[i]
        to_below, own = belows[i], level.inverse[i]
        for j in range(1, x.shape[1] - 1):
            beside = right[j] * here[j + 1] + right[j - 1] * here[j - 1]
            out[j] = known[j] + beside + to_below[j] * below[j] + above[j] * up[j]
        if below_rights.size > 1:
            falling, rising = below_rights[i], below_lefts[i]
            before, after = below_rights[i - 1], below_lefts[i - 1]
            for j in range(1, x.shape[1] - 1):
                lower = falling[j] * below[j + 1] + rising[j] * below[j - 1]
                out[j] += lower + before[j - 1] * up[j - 1] + after[j + 1] * up[j + 1]
        if down:
            for j in range(1, x.shape[1] - 1):
                out[j] -= _DAMPING * known[j]
        else:
            for j in range(1, x.shape[1] - 1):
                out[j] = here[j] + _DAMPING * (own[j] * out[j] - here[j])
        if ring:
            close_ring(out)


@by_rows(**REORDERED)
def _restrict(first, end, b, r, w):
    """Restrict the residual: compute Pᵀ r for some rows of the coarser grid."""
    for ci in range(first, end):
        i = 2 * ci - 1
        for cj in range(1, b.shape[1] - 1):
            j = 2 * cj - 1
            s = np.float32(0.0)
            for a in range(3):
                s += w[ci, cj, a, 0] * r[i + a - 1, j - 1]
                s += w[ci, cj, a, 1] * r[i + a - 1, j]
                s += w[ci, cj, a, 2] * r[i + a - 1, j + 1]
            b[ci, cj] = s


@by_rows(**REORDERED)
def _prolong(first, end, x, coarse, w, ring):
    """Add the interpolated correction to x: compute x += P coarse for some rows of the finer grid."""
    for i in range(first, end):
        # a fine row in a coarse row (odd i) has one contribution; a row between two coarse rows has one from each
        for half in range(1 + (i + 1) % 2):
            ci = (i + 1) // 2 + half
            a = 1 if i % 2 else 2 - 2 * half
            for cj in range(1, coarse.shape[1] - 1):
                j, v = 2 * cj - 1, coarse[ci, cj]
                x[i, j] += v * w[ci, cj, a, 1]
                x[i, j + 1] += v * w[ci, cj, a, 2] + coarse[ci, cj + 1] * w[ci, cj + 1, a, 0]
        if ring:
            close_ring(x[i])


@inner(**REORDERED)
def _flow_out(network, p, i, beside, y):
    """Compute row i of A p from differences of p, and write it to y.

    p has a border of one node, which is 0 at the ends. The flow from each node of the row to the next one is stored in
    the work array `beside`. Separate loops over few arrays compile to vector instructions and take a third of the time
    of a single loop.
    """
    along, across, ring = network
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


@by_rows(**REORDERED)
def _turn(first, end, p, z, scale, beta):
    """Compute the next search direction p = scale z + β p on some rows."""
    for i in range(first, end):
        for j in range(1, p.shape[1] - 1):
            p[i, j] = scale * z[i, j] + beta * p[i, j]


@by_rows(**REORDERED)
def _curvature(first, end, p, network, sums):
    """Compute the contributions of some rows to p·A p."""
    n2 = p.shape[1] - 2
    y = np.empty(n2 + 2)
    beside = np.empty(n2 + 1)
    for i in range(first, end):
        _flow_out(network, p, i, beside, y)
        total = 0.0
        for j in range(1, n2 + 1):
            total += y[j] * p[i, j]
        sums[0, i] = total


@by_rows(**REORDERED)
def _advance(first, end, x, others, network, steps, sums):
    """Perform the step x += step p, r −= step A p on some rows, and compute b = r / scale.

    The sums of r and of r x of each row are written to `sums`. Over all rows, they are the difference between inlet and
    outlet flow, and the difference between this flow and the rate. A p is computed here again instead of being stored,
    because memory limits the size of faces.
    """
    r, b, p = others
    step, scale = steps
    n2 = p.shape[1] - 2
    y = np.empty(n2 + 2)
    beside = np.empty(n2 + 1)
    for i in range(first, end):
        _flow_out(network, p, i, beside, y)
        xs, rs, ps, bs = x[i], r[i], p[i], b[i]
        excess = weighted = 0.0
        for j in range(1, n2 + 1):
            value = xs[j - 1] + step * ps[j]
            rest = rs[j] - step * y[j]
            xs[j - 1], rs[j] = value, rest
            excess += rest
            weighted += rest * value
        for j in range(1, n2 + 1):
            bs[j] = rs[j] / scale
        sums[0, i], sums[1, i] = excess, weighted


@by_rows(**REORDERED)
def _product(first, end, z, r, field, hidden, sums):
    """Compute the contributions of some rows to r·z; if the field has to be accurate, also the largest |z| of each row.

    Hidden nodes are ignored in |z|.
    """
    for i in range(first, end):
        total = largest = 0.0
        for j in range(1, z.shape[1] - 1):
            total += r[i, j] * z[i, j]
        if field < np.inf:
            for j in range(1, z.shape[1] - 1):
                if hidden.size == 0 or not hidden[i - 1, j - 1]:
                    largest = max(largest, abs(z[i, j]))
        sums[0, i], sums[1, i] = total, largest


@by_rows(**{**REORDERED, "fastmath": False})
def _start(first, end, x, r, b, along, potential, inverse):
    """Set the initial potential x and its residual r, which is also stored as b.

    The initial potential is constant along each row, and has the lowest energy of all such potentials.

    potential : its drop between adjacent rows, and its value in each row.
    """
    drop, rest = potential
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

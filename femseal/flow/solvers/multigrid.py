"""Solve the flow by conjugate gradients, preconditioned by multigrid on the structured grid.

The potential and the residual are stored in double precision. The operator is applied to differences of the potential,
to avoid cancellation. The multigrid cycle and the search directions are computed in single precision. The rounding of
the search directions causes no error, because the potential and the residual are updated with the same rounded
directions. A multigrid cycle performs one sweep of damped Jacobi before the coarse-grid correction, and one sweep after
the correction. On large levels, the rows are divided between threads.
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
from .hierarchy import COARSEST_SIDE, build_levels, coarser_shape, solve_coarsest, wrap_row

#: Largest number of nodes of the coarsest possible level for which multigrid is efficient. The coarsest level of a
#: slender grid has more nodes.
COARSEST_NODES = 128
#: Damping factor of the Jacobi sweeps.
_DAMPING = np.float32(0.8)
#: The iteration stops when the estimated error is below this fraction of the tolerance. The fraction is small, because
#: the error is underestimated as long as its slowest component has not appeared.
_STOPPING = 0.03
#: Fraction of the tolerance at which the iteration stops after `BOUNDED_FROM` iterations, when the error is also
#: bounded.
_STOPPING_IF_BOUNDED = 0.3
#: Number of iterations after which the error of the flow rate is bounded by means of a conserved flux.
BOUNDED_FROM = 12
#: If the bound of the error is too large, `_STOPPING_IF_BOUNDED` is replaced by smaller fractions. The iteration is
#: given up when the fraction falls below this number.
_LEAST_STOPPING = 1e-9
#: Smallest eigenvalues of M⁻¹A that the error estimate allows for although the iteration has not found them: the first
#: value after few iterations, and the second value in the limit of many iterations. With ten times the first value, the
#: error exceeded the estimate in 2 of 10,000 random cells of extreme contrast, and in 3 of 1200 smooth gaps with 10 to
#: 35 % in contact.
_UNSEEN_EIGENVALUES = 2e-4, 1e-7
#: Largest remaining correction at a node, relative to the tolerance in the energy norm. The correction at a node is a
#: separate condition, because nodes that are only connected by narrow links hardly contribute to the energy norm.
_LARGEST_CORRECTION = 100.0
#: Flags of ignored nodes, if no nodes are ignored.
_NONE_IGNORED = np.zeros((0, 0), np.bool_)
#: Smallest number of nodes for which the work is divided between threads.
_THREADED_NODES = 2**18
#: Number of iterations after which the total number of iterations is extrapolated.
_EXTRAPOLATED_FROM = 10


def coarsest_nodes(n1: int, n2: int) -> int:
    """Count the nodes of the coarsest possible multigrid level of a grid with n1 × n2 unknowns.

    The coarsest level of a slender grid has many nodes.
    """
    rows, columns = n1 + 2, n2 + 2  # with a border of one node
    while min(rows, columns) - 2 > COARSEST_SIDE:
        rows, columns = coarser_shape(rows, columns)
    return (rows - 2) * (columns - 2)


class MultigridSolution(NamedTuple):
    """Solution by multigrid.

    potential : array (n1 + 1, n2), potential φ at the nodes.
    iterations : number of iterations.
    error : relative error of φ in the energy norm, either an estimate or an upper bound.
    """

    potential: Array
    iterations: int
    error: float


def solve_multigrid(
    stencil: Stencil,
    rtol: float,
    limit: int,
    ignored: NDArray[np.bool_] | None = None,
    field_rtol: float | None = None,
    bounded_from: int = BOUNDED_FROM,
) -> MultigridSolution:
    """Solve for the potential φ of all nodes for a unit potential drop.

    Parameters
    ----------
    stencil : conductances of the links. Each node with open links must be connected to both inlet and outlet.
    rtol : largest relative error of the flow rate Σ c (Δφ)².
    limit : largest number of iterations.
    ignored : flags (n1 − 1, n2) of inner nodes whose potential does not have to be accurate; None if there are no such
        nodes.
    field_rtol : largest relative error of φ in the energy norm; None if only the flow rate has to be accurate. If
        `field_rtol` is given, the correction M⁻¹r must also be smaller than 10 `field_rtol` at each node that is not
        ignored. M⁻¹r is the result of one multigrid cycle for the residual r.
    bounded_from : number of iterations after which the error is bounded rigorously.

    Raises
    ------
    NotConverged : the iteration has not converged after `limit` iterations, or an extrapolation shows that it will not.

    Notes
    -----
    The relative error of the flow rate is the square of the error e of φ in the energy norm. The error e satisfies
    eᵀAe ≤ rᵀM⁻¹r/θ, where θ is the smallest eigenvalue of M⁻¹A. θ is estimated from the coefficients of the iteration
    (Lanczos). After few iterations, the estimate of θ is reduced to allow for error components that have not appeared
    yet. After `bounded_from` iterations, the error is not estimated but bounded rigorously, and the iteration continues
    if the bound is too large. The inflow and the outflow may differ by a fraction of at most 3 √rtol, because their
    errors are proportional to e and not to e².
    Sources: Strakoš & Tichý, ETNA 13, 2002, 56; Meurant, Papež & Tichý, Numer. Algorithms 88, 2021, 1337.
    """
    field = np.inf if field_rtol is None else field_rtol
    network = stencil.along, stencil.across, stencil.ring2
    # the initial potential is constant in each row; its drop between two rows is proportional to their resistance
    with np.errstate(divide="ignore", invalid="ignore"):
        resistance = 1 / stencil.along.sum(axis=1, dtype=float)
        row_drop = resistance / resistance.sum()
    settings = _Settings(
        rtol, field, limit, _NONE_IGNORED if ignored is None else ignored, bounded_from
    )
    is_small = stencil.along.size < _THREADED_NODES
    iterate = _iterate_in_one_thread if is_small else _iterate
    φ, iterations, error, has_converged = iterate(network, row_drop, settings)
    if has_converged:
        return MultigridSolution(φ, iterations, error)
    reached = f"error {error**2:.1e} of the flow rate"
    wanted = f"{rtol:.1e}"
    if field_rtol:
        reached += f" and {error:.1e} of the pressure"
        wanted += f" and {field:.1e}"
    raise NotConverged(
        f"flow: {reached} after {iterations} iterations of multigrid, wanted {wanted}; "
        "try the solver 'elimination'",
        error,
    )


class _Settings(NamedTuple):
    """Arguments of `solve_multigrid` for the iteration.

    field : `field_rtol`, or infinity if only the flow rate has to be accurate.
    """

    rtol: float
    field: float
    limit: int
    ignored: NDArray[np.bool_]
    bounded_from: int


@leader(**REORDERED)
def _iterate(network, row_drop, settings):
    """Perform the iteration of `solve_multigrid`.

    network : tuple of the conductances `along` and `across` of the stencil and a flag, whether the columns form a ring.
    row_drop : array (n1,), drop of the initial potential from each row of nodes to the next row.
    settings : arguments of `solve_multigrid`.

    Returns the potential, the number of iterations, the relative error of the potential in the energy norm, and whether
    the tolerance is reached.
    """
    along, across, ring = network
    levels, coarsest = build_levels(along, across, ring)
    b, z = levels[0].b, levels[0].r  # right-hand side and result of the multigrid cycle
    n1, n2 = b.shape  # with a border of one node
    x = np.zeros((n1, n2 - 2))  # potential; the border along the first axis is inlet and outlet
    r = np.zeros((n1, n2))  # residual
    p = np.zeros((n1, n2), np.float32)  # search direction
    sums = np.zeros((2, n1))  # two sums over each row
    history = np.zeros((3, settings.limit + 1))  # see `_judge`
    x[0] = 1.0
    row_potential = np.cumsum(row_drop[::-1])[::-1]  # sum of all drops between a row and the outlet
    _set_initial_potential(x, r, b, along, (row_drop, row_potential), levels[0].inverse)
    scale = 1.0  # b is r divided by this number
    unbalanced = 0.0  # difference between inlet and outlet flow
    share = _STOPPING_IF_BOUNDED
    iteration = 0
    while True:
        cycle(levels, coarsest, ring)
        _sum_products(z, r, settings.field, settings.ignored, sums)
        rz = scale * sums[0].sum()
        largest = scale * sums[1].max()
        rate = (along[-1] * x[-2]).sum()
        state = rz, largest, unbalanced, rate
        error, done, hopeless = _judge(iteration, state, history, share, settings)
        if done and iteration >= settings.bounded_from:
            bound = error_bound(along, across, x, 1.0 - x, settings.ignored)
            error = max(error, np.sqrt(bound))
            if not bound <= settings.rtol:
                # continue: the estimate must become smaller by twice the factor by which the bound is too large
                done = False
                share *= 0.5 * settings.rtol / bound
                hopeless = not share > _LEAST_STOPPING
        if done or hopeless:
            break
        ratio = rz / history[0, iteration - 1] if iteration > 0 else 0.0
        _update_direction(p, z, scale, ratio)
        _sum_curvature(p, network, sums)
        curvature = sums[0].sum()
        if not curvature > 0.0:
            break
        step = rz / curvature
        history[1, iteration], history[2, iteration] = step, ratio
        # scale the right-hand side of the cycle, so that a small residual is within the range of single precision
        scale = np.sqrt(rz)
        _update_solution(x, (r, b, p), network, (step, scale), sums)
        unbalanced = max(abs(sums[0].sum()), abs(sums[1].sum()))
        iteration += 1
    if not done and settings.field == np.inf:
        # if rounding errors have stopped the iteration, its error may still be small enough
        error = np.sqrt(error_bound(along, across, x, 1.0 - x, settings.ignored))
        done = error**2 <= settings.rtol
    return x, iteration, error, done


#: `_iterate` without threads.
_iterate_in_one_thread = compiled(**REORDERED)(_iterate)


@leader(**REORDERED)
def _judge(iteration, state, history, share, settings):
    """Estimate the error in the energy norm, and decide whether the iteration has converged or should be abandoned.

    state : tuple of rᵀM⁻¹r, the largest correction at a node, the difference between inflow and outflow, and the flow
        rate.
    history : array (3, limit + 1), in each column the values of an iteration: rᵀM⁻¹r, the step length, and the ratio β
        of the conjugate gradients. The function stores rᵀM⁻¹r of the current iteration in row 0 of `history`.
    share : if a rigorous error bound is computed afterwards, the iteration stops when the estimated error falls below
        this fraction of the tolerance.

    Returns the estimated error, whether the iteration has converged, and whether it should be abandoned because it
    would need more than `limit` iterations.
    """
    rz, largest, unbalanced, rate = state
    rtol, field, limit = settings.rtol, settings.field, settings.limit
    # The flow rate is equal to the energy, so that rᵀM⁻¹r / rate is an estimate of the squared relative error of φ. The
    # estimate must be reliable if the error is not bounded afterwards.
    is_estimate = iteration < settings.bounded_from or field < np.inf
    if is_estimate:
        share = min(_STOPPING, share)
    # largest accepted square of the relative error of φ, from the tolerance of the flow rate and from the tolerance of
    # φ
    allowed = min(share * rtol, (0.1 * field) ** 2)
    history[0, iteration] = rz
    error = np.inf
    is_balanced = unbalanced <= 3.0 * max(np.sqrt(rtol), 1e-6) * rate
    if 0.0 <= rz <= allowed * rate and is_balanced:
        # if the error is bounded afterwards, no allowance for unseen error components is needed
        θ = 1.0
        if is_estimate:
            θ = _smallest_eigenvalue(history[1, :iteration], history[2, :iteration])
        error = np.sqrt(rz / rate / θ)
        if error**2 <= allowed and largest <= _LARGEST_CORRECTION * 0.1 * field:
            return error, True, False
    is_hopeless = iteration == limit or not 0.0 < rz < np.inf
    if not is_hopeless and iteration >= _EXTRAPOLATED_FROM and rate > 0.0 and rz > allowed * rate:
        # Extrapolate the total number of iterations, assuming that each iteration reduces rᵀM⁻¹r by the mean factor of
        # the iterations so far.
        initial = history[0, 0]
        needed_reduction = np.log(initial / (allowed * rate))
        is_hopeless = rz >= initial or iteration * needed_reduction / np.log(initial / rz) > limit
    return error, False, is_hopeless


@compiled(**REORDERED)
def _smallest_eigenvalue(steps, ratios):
    """Estimate the smallest eigenvalue of M⁻¹A, with an allowance for eigenvalues that have not appeared yet.

    The coefficients of the conjugate gradients define the tridiagonal matrix T of the Lanczos process. The smallest
    eigenvalue of T (Ritz value) approximates the smallest eigenvalue of M⁻¹A, and is computed within a factor of two.

    steps, ratios : step length α and ratio β of the conjugate gradients in each iteration.
    """
    n = steps.size
    diagonal = np.ones(max(n, 1))  # of the tridiagonal matrix T
    for i in range(n):
        diagonal[i] = 1.0 / steps[i] + (ratios[i] / steps[i - 1] if i > 0 else 0.0)
    # halve an upper bound of the smallest eigenvalue of T until it is below this eigenvalue
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
    # Smaller eigenvalues may not have appeared yet. As long as the Ritz value is above `after_few`, eigenvalues down to
    # `after_few` are allowed for. For smaller Ritz values, the allowance falls with the square of the Ritz value, down
    # to `after_many`.
    after_few, after_many = _UNSEEN_EIGENVALUES
    allowance = min(lowest**2 / after_few, after_few)
    allowance = max(allowance, after_many)
    return min(allowance, lowest)


@leader(**REORDERED)
def cycle(levels, coarsest, ring):
    """Perform one V-cycle: compute the solution `r` of the finest level from the right-hand side `b` of this level."""
    for k in range(len(levels) - 1):
        fine, coarse = levels[k], levels[k + 1]
        _first_sweep(fine.x, fine.b, fine.inverse, ring)
        _residual_or_sweep(fine.r, fine, YES, ring)
        _restrict(coarse.b, fine.r, fine.weights)
    solve_coarsest(coarsest, levels[-1].b, ring, levels[-1].r)
    for k in range(len(levels) - 2, -1, -1):
        coarse, fine = levels[k + 1], levels[k]
        _prolong(fine.x, coarse.r, fine.weights, ring)
        _residual_or_sweep(fine.r, fine, NO, ring)


@by_rows(**REORDERED)
def _first_sweep(first, end, x, b, inverse, ring):
    """Perform the first sweep of damped Jacobi on some rows, starting from x = 0."""
    for i in range(first, end):
        for j in range(1, b.shape[1] - 1):
            x[i, j] = _DAMPING * b[i, j] * inverse[i, j]
        if ring:
            wrap_row(x[i])


@by_rows(**REORDERED)
def _residual_or_sweep(first, end, r, level, after_first_sweep, ring):
    """Compute the residual after the first sweep, or perform the second sweep of damped Jacobi, on some rows.

    Let s = b + Σ c x be the sum over the neighbours of a node, where c is the conductance of the link to a neighbour.
    Let a be the diagonal entry, and ω the damping factor. The function writes one of two results to r:

    - if `after_first_sweep` is set, the residual s − a x, which equals s − ω b after the first sweep (x = ω b/a);
    - otherwise, x + ω (s/a − x), which is the result of the second sweep.
    """
    right, below, below_right, below_left = level.links
    x = level.x
    for i in range(first, end):
        # values of x in this row and in the rows above and below
        x_above, x_here, x_below = x[i - 1], x[i], x[i + 1]
        # conductances to the nodes beside, below and above
        to_right, to_below, to_above = right[i], below[i], below[i - 1]
        b, inverse, out = level.b[i], level.inverse[i], r[i]
        for j in range(1, x.shape[1] - 1):
            beside = to_right[j] * x_here[j + 1] + to_right[j - 1] * x_here[j - 1]
            out[j] = b[j] + beside + to_below[j] * x_below[j] + to_above[j] * x_above[j]
        if below_right.size > 1:
            to_below_right, to_below_left = below_right[i], below_left[i]
            from_above_left, from_above_right = below_right[i - 1], below_left[i - 1]
            for j in range(1, x.shape[1] - 1):
                from_below = to_below_right[j] * x_below[j + 1] + to_below_left[j] * x_below[j - 1]
                out[j] += (
                    from_below
                    + from_above_left[j - 1] * x_above[j - 1]
                    + from_above_right[j + 1] * x_above[j + 1]
                )
        if after_first_sweep:  # the residual
            for j in range(1, x.shape[1] - 1):
                out[j] -= _DAMPING * b[j]
        else:  # the sweep
            for j in range(1, x.shape[1] - 1):
                out[j] = x_here[j] + _DAMPING * (inverse[j] * out[j] - x_here[j])
        if ring:
            wrap_row(out)


@by_rows(**REORDERED)
def _restrict(first, end, b, r, w):
    """Restrict the residual: compute b = Pᵀ r for some rows of the coarser grid.

    The coarse node (ci, cj) collects the residuals r of the 3 × 3 fine nodes around it, with the weights w[ci, cj].
    """
    for ci in range(first, end):
        i = 2 * ci - 1  # coarse node (ci, cj) is fine node (i, j)
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
    """Add the interpolated correction to x: compute x += P coarse for some rows of the finer grid.

    The coarse node (ci, cj) is the fine node (2 ci − 1, 2 cj − 1). The value of the coarse node times `w[ci, cj,
    fine_row, fine_column]` is added to each of the 3 × 3 fine nodes around it, see `Level.weights`.
    """
    for i in range(first, end):
        # An odd fine row i contains coarse nodes, of coarse row (i + 1) / 2. An even fine row i lies between the coarse
        # rows i / 2 and i / 2 + 1, and gets a contribution from each of the two.
        contributions = 1 + (i + 1) % 2
        for half in range(contributions):
            ci = (i + 1) // 2 + half
            # fine row relative to the coarse row: 1 for the same row, 2 for the row below, 0 for the row above
            fine_row = 1 if i % 2 else 2 - 2 * half
            for cj in range(1, coarse.shape[1] - 1):
                j = 2 * cj - 1
                v = coarse[ci, cj]
                x[i, j] += v * w[ci, cj, fine_row, 1]
                # the fine node between the coarse nodes cj and cj + 1; after the last cj, cj + 1 is in the border
                next_v = coarse[ci, cj + 1]
                x[i, j + 1] += v * w[ci, cj, fine_row, 2] + next_v * w[ci, cj + 1, fine_row, 0]
        if ring:
            wrap_row(x[i])


@inner(**REORDERED)
def _apply_to_row(network, p, i, flow_to_right, y):
    """Compute row i of the product A p from differences of p, and write the row to y.

    The arrays p and y have a border of one node on each side; the conductances have no border. At the inlet and at the
    outlet, the border of p is 0. The work array `flow_to_right` contains the flow from each node of the row to the next
    node. Separate loops over few arrays compile to vector instructions, and take a third of the time of a single loop.
    """
    along, across, ring = network
    n2 = along.shape[1]
    to_above, to_below, to_right = along[i - 1], along[i], across[i - 1]
    p_above, p_here, p_below = p[i - 1], p[i], p[i + 1]
    for j in range(1, n2):
        flow_to_right[j] = to_right[j - 1] * (np.float64(p_here[j]) - p_here[j + 1])
    # flow over the seam of a ring, which leaves the last node of the row and enters the first node
    seam = to_right[n2 - 1] * (np.float64(p_here[n2]) - p_here[1]) if ring else 0.0
    flow_to_right[0] = seam
    flow_to_right[n2] = seam
    for j in range(1, n2 + 1):
        value = np.float64(p_here[j])
        y[j] = (
            to_above[j - 1] * (value - p_above[j])
            + to_below[j - 1] * (value - p_below[j])
            + (flow_to_right[j] - flow_to_right[j - 1])
        )


@by_rows(**REORDERED)
def _update_direction(first, end, p, z, scale, beta):
    """Compute the next search direction p = scale z + β p on some rows."""
    for i in range(first, end):
        for j in range(1, p.shape[1] - 1):
            p[i, j] = scale * z[i, j] + beta * p[i, j]


@by_rows(**REORDERED)
def _sum_curvature(first, end, p, network, sums):
    """Compute p·A p for some rows, and store the result for each row in `sums[0]`."""
    n2 = p.shape[1] - 2
    y = np.empty(n2 + 2)
    flow_to_right = np.empty(n2 + 1)
    for i in range(first, end):
        _apply_to_row(network, p, i, flow_to_right, y)
        total = 0.0
        for j in range(1, n2 + 1):
            total += y[j] * p[i, j]
        sums[0, i] = total


@by_rows(**REORDERED)
def _update_solution(first, end, x, fields, network, steps, sums):
    """Perform the step x += step p, r −= step A p on some rows, and compute b = r / scale.

    For each row, Σr is written to `sums[0]`, and Σ r x to `sums[1]`. The total of Σr over all rows is the difference
    between inflow and outflow. The total of Σ r x over all rows is the difference between flow and energy. The product
    A p, which `_sum_curvature` has already computed, is computed again, because storing A p would need much memory.

    fields : tuple of the residual r, the right-hand side b of the next cycle, and the search direction p.
    steps : tuple (step length, `scale`). The right-hand side b is r divided by `scale`.
    """
    r, b, p = fields
    step, scale = steps
    n2 = p.shape[1] - 2
    y = np.empty(n2 + 2)
    flow_to_right = np.empty(n2 + 1)
    for i in range(first, end):
        _apply_to_row(network, p, i, flow_to_right, y)
        x_row, r_row, p_row, b_row = x[i], r[i], p[i], b[i]
        sum_r = 0.0
        sum_rx = 0.0
        for j in range(1, n2 + 1):
            value = x_row[j - 1] + step * p_row[j]  # x has no border along the row
            residual = r_row[j] - step * y[j]
            x_row[j - 1] = value
            r_row[j] = residual
            sum_r += residual
            sum_rx += residual * value
        for j in range(1, n2 + 1):
            b_row[j] = r_row[j] / scale
        sums[0, i] = sum_r
        sums[1, i] = sum_rx


@by_rows(**REORDERED)
def _sum_products(first, end, z, r, field, ignored, sums):
    """Compute r·z for some rows, and also the largest |z| in each row if the potential itself has to be accurate.

    z is the result M⁻¹r of a multigrid cycle. Ignored nodes do not count for the largest |z|.
    """
    for i in range(first, end):
        total = 0.0
        largest = 0.0
        for j in range(1, z.shape[1] - 1):
            total += r[i, j] * z[i, j]
        if field < np.inf:
            for j in range(1, z.shape[1] - 1):
                if ignored.size == 0 or not ignored[i - 1, j - 1]:
                    largest = max(largest, abs(z[i, j]))
        sums[0, i] = total
        sums[1, i] = largest


@by_rows(**{**REORDERED, "fastmath": False})
def _set_initial_potential(first, end, x, r, b, along, potential, inverse):
    """Set the initial potential x and its residual r, and copy r to the right-hand side b of the first cycle.

    The initial potential is constant along each row. Of all potentials that are constant along each row, the initial
    potential has the lowest energy.

    potential : tuple (row_drop, row_potential): the drop of the initial potential from each row of nodes to the next,
        and the initial potential of each row.
    """
    row_drop, row_potential = potential
    n2 = along.shape[1]
    for i in range(first, end):
        for j in range(n2):
            if inverse[i, j + 1] > 0.0:
                x[i, j] = row_potential[i]
        # flow to the next row, and flow from the previous row
        for j in range(n2):
            r[i, j + 1] -= along[i, j] * row_drop[i]
        for j in range(n2):
            r[i, j + 1] += along[i - 1, j] * row_drop[i - 1]
        for j in range(1, n2 + 1):
            b[i, j] = r[i, j]

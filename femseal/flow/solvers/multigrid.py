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
from ..error_bound import (
    correction_energy,
    excess_and_energy,
    find_drainage,
    no_drainage,
)
from ..grid import Stencil
from .clusters import correct_clusters
from .hierarchy import (
    COARSEST_SIDE,
    build_levels,
    coarser_shape,
    solve_coarsest,
    wrap_row,
    wrap_rows,
)

#: Largest number of nodes of the coarsest possible level for which multigrid is efficient. The coarsest level of a
#: slender grid has more nodes.
COARSEST_NODES = 128
#: Damping factor of the Jacobi sweeps.
_DAMPING = np.float32(0.8)
#: Expected ratio of the error bound to its estimate rᵀM⁻¹r. Measured ratios are 30 to 60 with 30 % of the area in
#: contact, and 300 to 2000 with 5 %.
_EXPECTED_RATIO = 100.0
#: The same number if the potential at all nodes has to be accurate. The number is large, because the potential of nodes
#: that are only connected by narrow links converges later than the energy.
_EXPECTED_RATIO_OF_FIELD = 5e5
#: The iteration is given up when the ratio of the error bound to rᵀM⁻¹r exceeds this number.
_LARGEST_RATIO = 1e9
#: Largest remaining correction at a node, relative to the tolerance in the energy norm. The correction at a node is a
#: separate condition, because nodes that are only connected by narrow links hardly contribute to the energy norm.
_LARGEST_CORRECTION = 10.0
#: Flags of ignored nodes, if no nodes are ignored.
_NONE_IGNORED = np.zeros((0, 0), np.bool_)
#: Largest number of nodes for which the product A p is stored. For more nodes, it is computed twice to save memory.
_STORED_NODES = 2**22
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
    error : upper bound of the relative error of φ in the energy norm.
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

    Raises
    ------
    NotConverged : the iteration has not converged after `limit` iterations, or an extrapolation shows that it will not.

    Notes
    -----
    The relative error of the flow rate is the square of the error e of φ in the energy norm. The iteration stops when
    an upper bound of this error, computed from a conserved flux, is within the tolerance, see `flow.error_bound`. As
    the bound takes about as long as an iteration, it is only computed when rᵀM⁻¹r, an estimate of e², is small enough.
    The inflow and the outflow may differ by a fraction of at most 3 √rtol, because their errors are proportional to e
    and not to e².
    """
    field = np.inf if field_rtol is None else field_rtol
    network = stencil.along, stencil.across, stencil.ring2
    # the initial potential is constant in each row; its drop between two rows is proportional to their resistance
    with np.errstate(divide="ignore", invalid="ignore"):
        resistance = 1 / stencil.along.sum(axis=1, dtype=float)
        row_drop = resistance / resistance.sum()
    settings = _Settings(rtol, field, limit, _NONE_IGNORED if ignored is None else ignored)
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
    a_p = np.empty((n1, n2) if n1 * n2 <= _STORED_NODES else (0, 0))  # product A p
    sums = np.zeros((2, n1))  # two sums over each row
    x[0] = 1.0
    row_potential = np.cumsum(row_drop[::-1])[::-1]  # sum of all drops between a row and the outlet
    _set_initial_potential(x, r, b, along, (row_drop, row_potential), levels[0].inverse)
    scale = 1.0  # b is r divided by this number
    unbalanced = 0.0  # difference between inlet and outlet flow, and between flow and energy
    # largest accepted square of the relative error of φ, from the tolerance of the flow rate and from that of φ
    allowed = min(settings.rtol, settings.field**2)
    largest_imbalance = min(3.0 * max(np.sqrt(settings.rtol), 1e-6), 0.5)
    drainage = no_drainage()
    ratio_to_bound = _EXPECTED_RATIO if settings.field == np.inf else _EXPECTED_RATIO_OF_FIELD
    error = np.inf
    first_rz = previous_rz = np.inf
    iteration = 0
    while True:
        cycle(levels, coarsest, ring)
        _sum_products(z, r, settings.field, settings.ignored, sums)
        rz = scale * sums[0].sum()
        largest = scale * sums[1].max()
        rate = (along[-1] * x[-2]).sum()
        # The flow rate is equal to the energy, so that rᵀM⁻¹r / rate is an estimate of the squared relative error of φ.
        is_small = 0.0 <= rz * ratio_to_bound <= allowed * rate
        is_balanced = unbalanced <= largest_imbalance * rate
        if is_small and is_balanced and largest <= _LARGEST_CORRECTION * settings.field:
            if drainage.first.size == 0:
                drainage = find_drainage(along, across)
            # the array of A p is free until the next direction is computed
            room = a_p.reshape(-1) if a_p.size > 0 else np.empty(r.size)
            excess = _excess(r, settings.ignored, room)
            bound = correction_energy(across, drainage, excess) / (rate - unbalanced)
            error = np.sqrt(bound)
            if bound <= allowed:
                return x, iteration, error, True
            ratio_to_bound = bound * rate / rz
        if iteration == 0:
            first_rz = rz
        total = (iteration, settings.limit)
        needed_rz = allowed * rate / ratio_to_bound
        if _is_hopeless(total, rz, first_rz, needed_rz) or ratio_to_bound > _LARGEST_RATIO:
            break
        β = rz / previous_rz if iteration > 0 else 0.0
        _update_direction(p, z, scale, β)
        _sum_curvature(p, network, a_p, sums)
        curvature = sums[0].sum()
        if not curvature > 0.0:
            break
        step = rz / curvature
        # scale the right-hand side of the cycle, so that a small residual is within the range of single precision
        scale = np.sqrt(rz)
        _update_solution(x, (r, b, p, a_p), network, (step, scale), sums)
        unbalanced = max(abs(sums[0].sum()), abs(sums[1].sum()))
        previous_rz = rz
        iteration += 1
    has_converged = False
    if settings.field == np.inf:
        # if rounding errors have stopped the iteration, its error may still be small enough
        if drainage.first.size == 0:
            drainage = find_drainage(along, across)
        excess, energy = excess_and_energy(along, across, x, 1.0 - x)
        _ignore(excess, settings.ignored)
        error = np.sqrt(correction_energy(across, drainage, excess) / energy)
        has_converged = error**2 <= settings.rtol
    return x, iteration, error, has_converged


#: `_iterate` without threads.
_iterate_in_one_thread = compiled(**REORDERED)(_iterate)


@compiled(**REORDERED)
def _excess(r, ignored, room):
    """Return the residual of the inner nodes, numbered row by row: the excess of inflow over outflow at each node.

    The excess of ignored nodes is set to 0. The result is written to the beginning of the array `room`.
    """
    n1, n2 = r.shape[0] - 2, r.shape[1] - 2
    excess = room[: n1 * n2]
    for i in range(n1):
        for j in range(n2):
            excess[i * n2 + j] = r[i + 1, j + 1]
    _ignore(excess, ignored)
    return excess


@compiled(**REORDERED)
def _ignore(excess, ignored):
    """Set the excess of the ignored nodes to 0."""
    is_ignored = ignored.ravel()
    for node in range(is_ignored.size):
        if is_ignored[node]:
            excess[node] = 0.0


@leader(**REORDERED)
def _is_hopeless(total, rz, first_rz, needed_rz):
    """Return whether the iteration has failed, or would need more than the largest number of iterations.

    total : number of iterations, and their largest number.
    rz, first_rz, needed_rz : rᵀM⁻¹r of this iteration, of the first iteration, and at convergence.
    """
    iteration, limit = total
    if iteration == limit or not 0.0 < rz < np.inf:
        return True
    if iteration < _EXTRAPOLATED_FROM or not 0.0 < needed_rz < rz:
        return False
    # Extrapolate the total number of iterations, assuming that each iteration reduces rᵀM⁻¹r by the mean factor of the
    # iterations so far.
    needed_reduction = np.log(first_rz / needed_rz)
    return rz >= first_rz or iteration * needed_reduction / np.log(first_rz / rz) > limit


@leader(**REORDERED)
def cycle(levels, coarsest, ring):
    """Perform one V-cycle: compute the solution `r` of the finest level from the right-hand side `b` of this level."""
    for k in range(len(levels) - 1):
        fine, coarse = levels[k], levels[k + 1]
        _first_sweep(fine.x, fine.b, fine.inverse, ring)
        _residual_after_first_sweep(fine.r, fine, ring)
        correct_clusters(fine, ring, YES)
        _restrict(coarse.b, fine.r, fine.weights)
    solve_coarsest(coarsest, levels[-1].b, ring, levels[-1].r)
    for k in range(len(levels) - 2, -1, -1):
        coarse, fine = levels[k + 1], levels[k]
        _prolong(fine.x, coarse.r, fine.weights, ring)
        correct_clusters(fine, ring, NO)
        _second_sweep(fine.r, fine, ring)


@by_rows(**REORDERED)
def _first_sweep(first, end, x, b, inverse, ring):
    """Perform the first sweep of damped Jacobi on some rows, starting from x = 0."""
    source = b[first:end].reshape(-1)
    factor = inverse[first:end].reshape(-1)
    result = x[first:end].reshape(-1)
    for k in range(result.size):
        result[k] = _DAMPING * source[k] * factor[k]
    if ring:
        wrap_rows(x, first, end)


@by_rows(**REORDERED)
def _residual_after_first_sweep(first, end, r, level, ring):
    """Compute the residual b + Σ c x − a x of some rows after the first sweep.

    The product of the diagonal entry a and x is ω b after the first sweep, with the damping factor ω.
    """
    _sum_inflow(level, first, end, np.float32(1.0) - _DAMPING, r)
    if ring:
        wrap_rows(r, first, end)


@by_rows(**REORDERED)
def _second_sweep(first, end, r, level, ring):
    """Perform a sweep of damped Jacobi on some rows, and write its result x + ω ((b + Σ c x)/a − x) to r."""
    _sum_inflow(level, first, end, np.float32(1.0), r)
    x = level.x[first:end].reshape(-1)
    inverse = level.inverse[first:end].reshape(-1)
    out = r[first:end].reshape(-1)
    for k in range(out.size):
        out[k] = x[k] + _DAMPING * (inverse[k] * out[k] - x[k])
    if ring:
        wrap_rows(r, first, end)


@inner(**REORDERED)
def _sum_inflow(level, first, end, share, out):
    """Compute `share` b + Σ c x for the rows `first` to `end` − 1, and write it to `out`.

    The sum is over all neighbours of a node, with the conductances c of the links to them. The rows form one long list
    of nodes, so that short rows are also computed with vector instructions. The results in the border are 0, because
    all its conductances are 0; in a ring, they are meaningless and are overwritten afterwards.
    """
    n2 = out.shape[1]
    # without the first and the last node of the list, which are in the border
    start, stop = first * n2 + 1, end * n2 - 1
    b, result = level.b.reshape(-1)[start:stop], out.reshape(-1)[start:stop]
    x = level.x.reshape(-1)
    right, below = level.links[0].reshape(-1), level.links[1].reshape(-1)
    # neighbours of the nodes in the list, and links to the neighbours
    x_right, x_left = x[start + 1 : stop + 1], x[start - 1 : stop - 1]
    x_below, x_above = x[start + n2 : stop + n2], x[start - n2 : stop - n2]
    to_right, to_left = right[start:stop], right[start - 1 : stop - 1]
    to_below, to_above = below[start:stop], below[start - n2 : stop - n2]
    for k in range(result.size):
        beside = to_right[k] * x_right[k] + to_left[k] * x_left[k]
        result[k] = share * b[k] + beside + to_below[k] * x_below[k] + to_above[k] * x_above[k]
    if level.links[2].size > 1:
        below_right, below_left = level.links[2].reshape(-1), level.links[3].reshape(-1)
        # two loops over few arrays, because a single loop would not compile to vector instructions
        x_right, x_left = x[start + n2 + 1 : stop + n2 + 1], x[start + n2 - 1 : stop + n2 - 1]
        to_right, to_left = below_right[start:stop], below_left[start:stop]
        for k in range(result.size):
            result[k] += to_right[k] * x_right[k] + to_left[k] * x_left[k]
        x_right, x_left = x[start - n2 + 1 : stop - n2 + 1], x[start - n2 - 1 : stop - n2 - 1]
        to_right = below_left[start - n2 + 1 : stop - n2 + 1]
        to_left = below_right[start - n2 - 1 : stop - n2 - 1]
        for k in range(result.size):
            result[k] += to_right[k] * x_right[k] + to_left[k] * x_left[k]


@by_rows(**REORDERED)
def _restrict(first, end, b, r, w):
    """Restrict the residual: compute b = Pᵀ r for some rows of the coarser grid.

    The coarse node (ci, cj) collects the residuals r of the 3 × 3 fine nodes around it, with the weights
    w[ci, :, :, cj].
    """
    for ci in range(first, end):
        out = b[ci]
        out[:] = np.float32(0.0)
        for a in range(3):
            # the coarse node (ci, cj) is the fine node (2 ci − 1, 2 cj − 1)
            r_row = r[2 * ci - 2 + a]
            from_left, from_centre, from_right = w[ci, a, 0], w[ci, a, 1], w[ci, a, 2]
            for cj in range(1, out.size - 1):
                j = 2 * cj - 1
                out[cj] += (
                    from_left[cj] * r_row[j - 1]
                    + from_centre[cj] * r_row[j]
                    + from_right[cj] * r_row[j + 1]
                )


@by_rows(**REORDERED)
def _prolong(first, end, x, coarse, w, ring):
    """Add the interpolated correction to x: compute x += P coarse for some rows of the finer grid.

    The coarse node (ci, cj) is the fine node (2 ci − 1, 2 cj − 1). The value of the coarse node times `w[ci, fine_row,
    fine_column, cj]` is added to each of the 3 × 3 fine nodes around it, see `Level.weights`.
    """
    for i in range(first, end):
        # An odd fine row i contains coarse nodes, of coarse row (i + 1) / 2. An even fine row i lies between the coarse
        # rows i / 2 and i / 2 + 1, and gets a contribution from each of the two.
        contributions = 1 + (i + 1) % 2
        for half in range(contributions):
            ci = (i + 1) // 2 + half
            # fine row relative to the coarse row: 1 for the same row, 2 for the row below, 0 for the row above
            fine_row = 1 if i % 2 else 2 - 2 * half
            v, x_row = coarse[ci], x[i]
            to_left, to_centre, to_right = (
                w[ci, fine_row, 0],
                w[ci, fine_row, 1],
                w[ci, fine_row, 2],
            )
            for cj in range(1, v.size - 1):
                j = 2 * cj - 1
                x_row[j] += v[cj] * to_centre[cj]
                # the fine node between the coarse nodes cj and cj + 1; after the last cj, cj + 1 is in the border
                x_row[j + 1] += v[cj] * to_right[cj] + v[cj + 1] * to_left[cj + 1]
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
def _sum_curvature(first, end, p, network, a_p, sums):
    """Compute p·A p for some rows, and store the result for each row in `sums[0]`.

    a_p : array for the product A p, of the shape of p; or an empty array if A p is not to be stored.
    """
    n2 = p.shape[1] - 2
    y = np.empty(n2 + 2)
    flow_to_right = np.empty(n2 + 1)
    for i in range(first, end):
        row = a_p[i] if a_p.size > 0 else y
        _apply_to_row(network, p, i, flow_to_right, row)
        total = 0.0
        for j in range(1, n2 + 1):
            total += row[j] * p[i, j]
        sums[0, i] = total


@by_rows(**REORDERED)
def _update_solution(first, end, x, fields, network, steps, sums):
    """Perform the step x += step p, r −= step A p on some rows, and compute b = r / scale.

    For each row, Σr is written to `sums[0]`, and Σ r x to `sums[1]`. The total of Σr over all rows is the difference
    between inflow and outflow. The total of Σ r x over all rows is the difference between flow and energy.

    fields : tuple of the residual r, the right-hand side b of the next cycle, the search direction p, and the product
        A p. If the array for A p is empty, A p is computed again.
    steps : tuple (step length, `scale`). The right-hand side b is r divided by `scale`.
    """
    r, b, p, a_p = fields
    step, scale = steps
    n2 = p.shape[1] - 2
    y = np.empty(n2 + 2)
    flow_to_right = np.empty(n2 + 1)
    for i in range(first, end):
        row = a_p[i] if a_p.size > 0 else y
        if a_p.size == 0:
            _apply_to_row(network, p, i, flow_to_right, row)
        x_row, r_row, p_row, b_row = x[i], r[i], p[i], b[i]
        sum_r = 0.0
        sum_rx = 0.0
        for j in range(1, n2 + 1):
            value = x_row[j - 1] + step * p_row[j]  # x has no border along the row
            residual = r_row[j] - step * row[j]
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

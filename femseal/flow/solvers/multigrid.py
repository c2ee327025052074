"""Solve the flow by conjugate gradients, preconditioned by multigrid on the structured grid.

The potential and the residual are stored in double precision. The operator is applied to differences of the potential,
to avoid cancellation. The multigrid cycle and the search directions are computed in single precision. The rounding of
the search directions causes no error, because the potential and the residual are updated with the same rounded
directions. A multigrid cycle performs one sweep of damped Jacobi before the coarse-grid correction, and one sweep after
the correction. On large levels, the rows are divided between threads.

Source: Saad, Iterative Methods for Sparse Linear Systems, 2nd ed., SIAM 2003, algorithm 9.1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base import Array
from ...base.compiled import REORDERED, compiled, inlined_leader, leader
from ...base.errors import NotConverged
from ..error_bound import (
    correction_energy,
    excess_and_energy,
    find_drainage,
    no_drainage,
)
from ..grid import Stencil
from .gradient_rows import (
    set_initial_potential,
    sum_curvature,
    sum_products,
    update_direction,
    update_solution,
)
from .hierarchy import COARSEST_SIDE, build_levels, coarser_shape
from .v_cycle import cycle

#: Largest number of nodes of the coarsest possible level for which multigrid is efficient. The coarsest level of a
#: slender grid has more nodes.
COARSEST_NODES = 128
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
THREADED_NODES = 2**18
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
    on_threads: bool | None = None,
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
    on_threads : whether the rows of the grid may be divided between threads; by default, the rows of a grid with at
        least `THREADED_NODES` nodes.

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
    row_potential = np.cumsum(row_drop[::-1])[::-1]  # sum of all drops between a row and the outlet
    if on_threads is None:
        on_threads = stencil.along.size >= THREADED_NODES
    iterate = _iterate if on_threads else _iterate_in_one_thread
    φ, iterations, error, has_converged = iterate(
        network, (row_drop, row_potential.copy()), settings
    )
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
def _iterate(network, initial, settings):
    """Perform the iteration of `solve_multigrid`: preconditioned conjugate gradients (Saad 2003, algorithm 9.1).

    The symbols are those of the algorithm: potential x, residual r, search direction p, and M⁻¹r, which one multigrid
    cycle computes. The cycle reads its right-hand side b from an array of the finest level, and writes its result z to
    another one. These arrays are in single precision: b contains r/`scale`, and z contains M⁻¹r/`scale`. All arrays
    have a border of one node on each side, as in `hierarchy`; only x has none on the left and on the right.

    network : tuple of the conductances `along` and `across` of the stencil and a flag, whether the columns form a ring.
    initial : tuple of the arrays row_drop and row_potential: drop of the initial potential from each row of nodes to
        the next row, and initial potential of each row.
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
    set_initial_potential(x, r, b, along, initial, levels[0].inverse)
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
        # the cycle computes z = M⁻¹r/scale; rᵀM⁻¹r estimates the squared error in the energy norm
        cycle(levels, coarsest, ring)
        sum_products(z, r, settings.field, settings.ignored, sums)
        rz = scale * sums[0].sum()
        largest = scale * sums[1].max()
        rate = (along[-1] * x[-2]).sum()
        # Compute the error bound if all estimates are within the tolerance.
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
        # give up if the iteration has failed, or would take too long
        if iteration == 0:
            first_rz = rz
        total = (iteration, settings.limit)
        needed_rz = allowed * rate / ratio_to_bound
        if _is_hopeless(total, rz, first_rz, needed_rz) or ratio_to_bound > _LARGEST_RATIO:
            break
        # next search direction, and the step along it
        β = rz / previous_rz if iteration > 0 else 0.0
        update_direction(p, z, scale, β)
        sum_curvature(p, network, a_p, sums)
        curvature = sums[0].sum()
        if not curvature > 0.0:
            break
        step = rz / curvature
        # scale the right-hand side of the cycle, so that a small residual is within the range of single precision
        scale = np.sqrt(rz)
        update_solution(x, (r, b, p, a_p), network, (step, scale), sums)
        unbalanced = max(abs(sums[0].sum()), abs(sums[1].sum()))
        previous_rz = rz
        iteration += 1
    has_converged = False
    if settings.field == np.inf:
        # if rounding errors have stopped the iteration, its error may still be small enough
        error = _error_of_potential(x, along, across, drainage, settings.ignored)
        has_converged = error**2 <= settings.rtol
    return x, iteration, error, has_converged


@inlined_leader(**REORDERED)
def _error_of_potential(x, along, across, drainage, ignored):
    """Bound the relative error of a potential x in the energy norm, without its residual.

    The residual of the iteration is updated in each step and may have lost its accuracy by rounding. The excess of each
    node is therefore computed again from x itself.

    drainage : result of `find_drainage` for the network, or of `no_drainage` if it has not been computed yet.
    ignored : flags of the inner nodes whose excess is left out.
    """
    if drainage.first.size == 0:
        drainage = find_drainage(along, across)
    excess, energy = excess_and_energy(along, across, x, 1.0 - x)
    _ignore(excess, ignored)
    return np.sqrt(correction_energy(across, drainage, excess) / energy)


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


@inlined_leader(**REORDERED)
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

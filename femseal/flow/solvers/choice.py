"""Choose a solver for the flow through a network of links, solve the flow, and check the solution.

The table in `femseal.flow.solvers` says which solver is used, and the module `thresholds` contains its numbers. Nodes
that are not connected to both the inlet and the outlet are left out. If there is no open path from the inlet to the
outlet, the flow is exactly 0.
"""

from __future__ import annotations

from dataclasses import replace
from math import exp, isfinite, ldexp, log, log2, sqrt
from typing import NamedTuple

import numpy as np

from ...base import Array, Flags, NotConverged, validate
from ...base.compiled import REORDERED, compiled
from ..grid import Stencil
from ..percolation import (
    BOTH_ENDS,
    PreparedLinks,
    closed_in_place,
    nodes_reached,
    prepare_links_in_place,
)
from ..problem import (
    FAST_SOLVERS,
    MAX_IMBALANCE,
    DarcyFlow,
    check_links,
    check_solver,
    checked_imbalance,
)
from .elimination import eliminate
from .multigrid import COARSEST_NODES, coarsest_nodes, solve_multigrid
from .thresholds import (
    CLOSED_ROUGHNESS,
    CONTRIBUTING_LINK,
    ELIMINATED_NODES,
    LARGEST_PIXEL_RATIO,
    MOST_MULTIGRID_ITERATIONS,
    MULTIGRID_PATIENCE,
    RESOLVED_LINK,
    ROUGHNESS_GROWTH,
    SAMPLED_ROWS,
    SLENDER_ROUGHNESS,
    SMOOTH_NODES,
)

#: Potential of a node, by the result of `nodes_reached`: undefined in a pocket (result 0), 1 if the node is connected
#: to the inlet only (result 1), and 0 if it is connected to the outlet only (result 2). The potential of a node that
#: carries flow (result 3) is computed.
_POTENTIAL_WITHOUT_FLOW = np.array([np.nan, 1.0, 0.0, np.nan])


def elimination_memory(nodes: float) -> float:
    """Estimate the memory [byte] that the elimination of a given number of open nodes needs.

    For n nodes, the dense arrays of nested dissection need c n log2 n bytes. Measured values of c are 27 to 32, on gaps
    of 512² to 1448² pixels. For networks that are too large for elimination, the function returns 0.
    """
    is_possible = 1 < nodes <= ELIMINATED_NODES
    return 32.0 * nodes * log2(nodes) if is_possible else 0.0


def solve_flow(
    stencil: Stencil,
    *,
    rtol: float = 1e-6,
    solver: str = "auto",
    field_rtol: float | None = None,
) -> DarcyFlow:
    """Solve the mass balance of the inner nodes for a unit potential drop between the first and the last row.

    Parameters
    ----------
    stencil : conductances of the links between the nodes. The first row of nodes is the inlet, and the last row the
        outlet.
    rtol : largest relative error of the conductance that an iterative solver may leave.
    solver : "multigrid", "elimination" or "auto". The solver "multigrid" uses conjugate gradients with a multigrid
        preconditioner. The solver "elimination" uses star-mesh elimination. Its relative error is small even if the
        conductances differ by a factor of 1e150. "auto" chooses multigrid for large networks with smooth conductances;
        it chooses elimination for other networks, and if multigrid fails. `DarcyFlow.solver` names the solver that was
        used. For elongated pixels, with one side more than 3.5 times as long as the other side, multigrid is slow and
        may miss a part of the error. Networks with elongated pixels are solved by elimination if they have up to 5
        million open nodes. If a network with elongated pixels has more open nodes, the error of multigrid is bounded
        rigorously. Some nodes are connected to the inlet and the outlet only by paths with very narrow links (less than
        1e-8 of the largest conductance). After multigrid, their potentials are computed by elimination.
    field_rtol : largest relative error of the potential in the energy norm; None if only the conductance is needed. The
        relative error of the conductance is the square of the relative error of the potential. If `field_rtol` is None,
        an iterative solver therefore leaves an error of about √rtol in the potential.

    Returns
    -------
    DarcyFlow with the `potential` at all nodes, array (n1 + 1, n2), and the `conductance` in the unit of the links.

    Raises
    ------
    InputError : the solver is unknown, a tolerance is not valid, or the network has more than 2³¹ − 1 links.
    NotConverged : the solver failed, or the relative difference between inflow and outflow is larger than 1e-5. After
        multigrid, the limit is 10 √rtol instead, or 10 field_rtol if `field_rtol` is given. "multigrid" also fails if
        links with less than 1e-13 of the largest conductance might carry more than `rtol` of the flow.
    """
    check_solver(solver, ("auto", *FAST_SOLVERS))
    validate.tolerance("rtol", rtol)
    if field_rtol is not None:
        validate.tolerance("field_rtol", field_rtol)
    check_links("along", stencil.along.shape, stencil.along.size + stencil.across.size)
    links = prepare_links_in_place(stencil.along.copy(), stencil.across.copy())
    return solve_in_place(links, stencil.ring2, rtol=rtol, solver=solver, field_rtol=field_rtol)


def solve_in_place(
    links: PreparedLinks,
    ring2: bool,
    *,
    rtol: float,
    solver: str,
    field_rtol: float | None,
) -> DarcyFlow:
    """Solve the flow through a network of links that `prepare_links_in_place` has prepared; its arrays are reused.

    The prepared conductances are divided by 2^exponent, so that the conductance of the network is multiplied by
    2^exponent at the end. For a unit potential drop, the conductance of a network is equal to its energy Σ c (Δφ)².

    Parameters
    ----------
    links : prepared links of the network. To save memory, the arrays `along`, `across` and `reached` may be
        overwritten.
    ring2 : whether the columns form a ring.
    rtol, solver, field_rtol : as in `solve_flow`.
    """
    stencil = Stencil(links.along, links.across, ring2=ring2)
    percolates = links.percolate
    has_inner_nodes = len(stencil.along) > 1
    if not (percolates and has_inner_nodes):
        # nothing is left to solve: the potential of a node is known from its connections to the inlet and the outlet
        potential = _POTENTIAL_WITHOUT_FLOW.take(links.reached)
        potential[0] = 1.0
        potential[-1] = 0.0
        # without inner nodes, the potential is known everywhere, and its energy is the conductance
        conductance = stencil.energy(np.nan_to_num(potential)) if percolates else 0.0
        return DarcyFlow(conductance, potential, 1 - potential, percolates)
    # `reached` is not needed any more, so that its memory is used for the flags
    keep = np.equal(links.reached, BOTH_ENDS, out=links.reached.view(np.bool_))
    flow = _solve(stencil, keep, rtol, solver, field_rtol)
    return replace(flow, conductance=ldexp(flow.conductance, links.exponent))


def _solve(
    stencil: Stencil, keep: Flags, rtol: float, solver: str, field_rtol: float | None
) -> DarcyFlow:
    """Choose a solver, and solve the flow.

    keep : flags (n1 + 1, n2) of the nodes that are connected to both inlet and outlet.
    solver : name of a solver, or "auto". If "auto" chooses multigrid and multigrid fails, elimination is used.
    """
    nodes = int(np.count_nonzero(keep[1:-1]))
    can_eliminate = nodes <= ELIMINATED_NODES
    if solver == "elimination" or (solver == "auto" and not _suits_multigrid(stencil, nodes)):
        return _solve_by_elimination(stencil, keep)
    has_long_pixels = _pixel_ratio(stencil) > LARGEST_PIXEL_RATIO
    if has_long_pixels and can_eliminate:
        return _solve_by_elimination(stencil, keep)
    limit = MULTIGRID_PATIENCE if solver == "auto" and can_eliminate else MOST_MULTIGRID_ITERATIONS
    try:
        return _solve_by_multigrid(stencil, keep, rtol, limit, field_rtol)
    except NotConverged:
        if solver == "multigrid":
            raise
    return _solve_by_elimination(stencil, keep)


def _suits_multigrid(stencil: Stencil, nodes: int) -> bool:
    """Return whether multigrid should be tried first on a network with `nodes` open nodes."""
    n1, n2 = stencil.along.shape
    roughness = _roughness(stencil.along, max(1, n1 // SAMPLED_ROWS))
    is_slender = coarsest_nodes(n1 - 1, n2) > COARSEST_NODES
    flows_along = n1 > n2  # the fluid flows along the long side
    if is_slender and (flows_along or roughness > SLENDER_ROUGHNESS):
        return False
    if nodes > ELIMINATED_NODES:
        return True
    # multigrid is faster from SMOOTH_NODES exp(ROUGHNESS_GROWTH r) nodes on; logarithms are compared, so that nothing
    # can overflow
    return log(nodes / SMOOTH_NODES) > ROUGHNESS_GROWTH * roughness


@compiled()
def _roughness(along, step):
    """Compute the mean difference of ln c between neighbouring links in every `step`-th row.

    If only one of two neighbouring links is open, their difference counts as `CLOSED_ROUGHNESS`.
    """
    total, pairs = 0.0, 1  # one additional pair avoids a division by 0
    for i in range(0, along.shape[0], step):
        before = along[i, 0]
        for j in range(1, along.shape[1]):
            here = along[i, j]
            if here > 0.0 and before > 0.0:
                total += abs(np.log(here / before))
                pairs += 1
            elif here > 0.0 or before > 0.0:
                total += CLOSED_ROUGHNESS
                pairs += 1
            before = here
    return total / pairs


def _pixel_ratio(stencil: Stencil) -> float:
    """Estimate the ratio of the longer to the shorter side of a pixel from the conductances of the open links.

    The conductance of a link along x1 is proportional to Δ2/Δ1, and the conductance of a link along x2 to Δ1/Δ2. If the
    gap is isotropic, the geometric means of the conductances along x1 and along x2 therefore have the ratio (Δ2/Δ1)².
    The geometric means are computed from a sample of the rows of links.
    """
    step = max(1, len(stencil.along) // SAMPLED_ROWS)
    difference = _mean_logarithm(stencil.along, step) - _mean_logarithm(stencil.across, step)
    return exp(abs(difference) / 2) if isfinite(difference) else 1.0


@compiled(**REORDERED)
def _mean_logarithm(links, step):
    """Compute the mean of ln c over the open links of every `step`-th row; NaN if there are no open links."""
    total, count = 0.0, 0
    for i in range(0, links.shape[0], step):
        for j in range(links.shape[1]):
            if links[i, j] > 0.0:
                total += np.log(links[i, j])
                count += 1
    return total / count if count > 0 else np.nan


@compiled(**REORDERED)
def _smallest_open(links):
    """Return the smallest conductance of the open links; infinity if there are no open links."""
    smallest = np.inf
    for i in range(links.shape[0]):
        for j in range(links.shape[1]):
            if 0.0 < links[i, j] < smallest:
                smallest = links[i, j]
    return smallest


def _solve_by_elimination(stencil: Stencil, keep: Flags) -> DarcyFlow:
    """Solve the flow by star-mesh elimination.

    The conductance is taken from the elimination, because it is more accurate than the energy of the potential.
    """
    φ, ψ = np.zeros((2, *keep.shape))
    φ[0] = 1.0
    ψ[-1] = 1.0
    conductance = eliminate(stencil, keep[1:-1], φ, ψ)
    return _check_balance(stencil, keep, (φ, ψ), _Statistics("elimination"), conductance)


def _solve_by_multigrid(
    stencil: Stencil,
    keep: Flags,
    rtol: float,
    limit: int,
    field_rtol: float | None,
) -> DarcyFlow:
    """Solve the flow by multigrid, and then by elimination at isolated nodes, see `_isolated_nodes`.

    Multigrid leaves out very narrow links, because their conductances would be lost by rounding when they are added to
    larger ones. The flow through the network without these links is a lower bound of the flow (Rayleigh's principle).
    The energy of any potential in the complete network is an upper bound of the flow (Dirichlet's principle). The error
    of the flow is at most the difference between the lower bound and the upper bound.

    limit : largest number of iterations.
    """
    # isolated nodes; None if multigrid can solve all nodes
    isolated: Flags | None = None
    # nodes that remain connected to inlet and outlet if links below `RESOLVED_LINK` are closed; None to close no links
    through: Flags | None = None
    # the largest conductance is close to 1, because `prepare_links_in_place` has scaled the conductances
    smallest = min(_smallest_open(stencil.along), _smallest_open(stencil.across))
    if smallest < CONTRIBUTING_LINK:
        isolated = _isolated_nodes(stencil, keep)
    if isolated is not None and smallest < RESOLVED_LINK:
        through = nodes_reached(stencil.along, stencil.across, RESOLVED_LINK) == BOTH_ENDS
        if not through.any():
            raise NotConverged(
                f"flow: every path contains a link below {RESOLVED_LINK:g} of the largest conductance, which is too "
                "narrow for multigrid; try the solver 'elimination'",
            )
    lower_bound = 0.0
    with closed_in_place(stencil, through, RESOLVED_LINK):
        solution = solve_multigrid(stencil, rtol, limit, isolated, field_rtol)
        potential, error = solution.potential, solution.error
        if isolated is not None:
            # lower bound of the exact energy of the network without the very narrow links
            lower_bound = stencil.energy(potential) * (1 - error**2)
    complement = 1 - potential
    if isolated is not None:
        eliminate(stencil, isolated, potential, complement)
    potential_tolerance = sqrt(rtol) if field_rtol is None else field_rtol
    allowed = max(MAX_IMBALANCE, 10 * potential_tolerance)
    statistics = _Statistics("multigrid", solution.iterations, error)
    flow = _check_balance(stencil, keep, (potential, complement), statistics, allowed=allowed)
    if isolated is None:
        return flow
    bound_gap = 1 - lower_bound / flow.conductance
    if not bound_gap <= rtol:
        raise NotConverged(
            f"flow: links that are too narrow for multigrid may change the flow rate by {bound_gap:.1e} of its value, "
            f"wanted {rtol:.1e}; try the solver 'elimination'",
            bound_gap,
        )
    return replace(flow, residual=float(max(error, np.sqrt(max(bound_gap, 0.0)))))


def _isolated_nodes(stencil: Stencil, keep: Flags) -> Flags | None:
    """Find isolated nodes, at which multigrid converges slowly or not at all.

    An isolated node is connected to the inlet and to the outlet, but each path contains a link with a conductance below
    `CONTRIBUTING_LINK`.

    Returns
    -------
    Flags (n1 − 1, n2) of the isolated inner nodes; None if there are no isolated nodes.
    """
    reached_by_wide_links = nodes_reached(stencil.along, stencil.across, CONTRIBUTING_LINK)
    isolated = (keep & (reached_by_wide_links == 0))[1:-1]
    return isolated if isolated.any() else None


class _Statistics(NamedTuple):
    """Name of the solver, number of iterations, and bound of the relative error of the potential in the energy norm."""

    solver: str
    iterations: int = 0
    residual: float = 0.0


def _check_balance(
    stencil: Stencil,
    keep: Flags,
    potentials: tuple[Array, Array],
    statistics: _Statistics,
    conductance: float | None = None,
    allowed: float = MAX_IMBALANCE,
) -> DarcyFlow:
    """Check that the inflow and the outflow of a solution agree, and make a DarcyFlow from the solution.

    Parameters
    ----------
    stencil : conductances of the links between the nodes.
    keep : flags (n1 + 1, n2) of the nodes that carry flow; at all other nodes, the potential is set to NaN.
    potentials : array with the potential φ at the nodes, and array with the complement ψ = 1 − φ.
    statistics : solver, number of iterations and bound of the error of the solution.
    conductance : conductance that the solver has computed; by default, the energy of φ is used.
    allowed : largest relative difference between inlet and outlet flow.

    Raises
    ------
    NotConverged : inlet and outlet flow differ by more than `allowed`.
    """
    φ, ψ = potentials
    # the energy is a sum of positive terms and therefore more accurate than a sum of flows
    if conductance is None:
        conductance = stencil.energy(φ)
    inflow = (stencil.along[0] * ψ[1]).sum()
    outflow = (stencil.along[-1] * φ[-2]).sum()
    imbalance = checked_imbalance(
        inflow,
        outflow,
        conductance,
        scale=conductance,
        allowed=allowed,
        advice="try the solver 'elimination'",
    )
    φ[~keep] = np.nan
    ψ[~keep] = np.nan
    return DarcyFlow(
        conductance,
        φ,
        ψ,
        percolates=True,
        iterations=statistics.iterations,
        residual=statistics.residual,
        imbalance=imbalance,
        solver=statistics.solver,
    )

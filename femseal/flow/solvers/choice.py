"""Solve the flow through a stencil for a unit potential drop: choose the solver, and check its solution.

Multigrid is used for large networks with smooth conductances. Elimination is used for all others, for long pixels, and
if multigrid does not converge. Nodes that are not connected to both ends are left out; without an open path the flow is
exactly 0.
"""

from __future__ import annotations

from dataclasses import replace
from math import exp, inf, ldexp, log, log2, sqrt
from typing import NamedTuple

import numpy as np

from ...base import Array, Flags, NotConverged, validate
from ...base.compiled import compiled
from ..grid import Stencil
from ..percolation import BOTH_ENDS, PreparedLinks, closed, nodes_reached, prepare_links
from ..problem import FAST_SOLVERS, MAX_IMBALANCE, DarcyFlow, check_solver
from .elimination import eliminate
from .multigrid import BOUNDED_FROM, COARSEST_NODES, coarsest_nodes, solve_multigrid

#: Largest number of nodes of a network for which elimination may be the first choice (about 4 GB at the limit).
ELIMINATED_NODES = 5_000_000
#: Largest ratio of the sides of a pixel for which multigrid is used. On gaps of 64² and 128² pixels multigrid takes as
#: long as elimination at ratios of 2.5 to 3.5, and 2 to 6 times as long at ratios of 4 to 12. At a ratio of 28 it fails
#: in 1 of 12 cases and once had an error of 22 %. The reason is that it coarsens along both sides of the pixels, so
#: that the slowest error components are only found late.
_LARGEST_PIXEL_RATIO = 3.5
#: Approximate number of rows of links that are sampled to estimate this ratio and the contrast of neighbouring links.
_SAMPLED_ROWS = 64
#: Links with a conductance below this fraction of the largest one hardly contribute to sums of conductances. At nodes
#: that are only connected by such links, an iteration converges slowly or not at all.
_CONTRIBUTING = 1e-8
#: Links below this fraction are lost by rounding in sums with wide links, so that the matrix may become indefinite.
_RESOLVED = 1e-13
#: Multigrid is tried first if there are more than _FEWEST exp(_GROWTH r) nodes, where r is the `_roughness`; a pair of
#: an open and a closed link counts as _CLOSED in r. On 245 networks of 24² to 512² nodes (independent links and pixels,
#: contacts, and faces cut by a plane) this choice takes 1.1 times as long on average as the faster solver.
_FEWEST, _GROWTH, _CLOSED = 15, 3.5, 4.0
#: Number of iterations after which multigrid is given up if elimination is possible.
_PATIENCE = 120
#: Largest number of iterations if the caller chose multigrid, or if elimination would need too much memory.
_MOST_ITERATIONS = 600
#: Potential of a node without flow, by the number from `nodes_reached`: a node in a pocket, a node that is connected to
#: the inlet only, and one that is connected to the outlet only. The potential of other nodes is computed.
_POTENTIAL_AT_REST = np.array([np.nan, 1.0, 0.0, np.nan])


def elimination_memory(nodes: float) -> float:
    """Estimate the memory [byte] that the elimination of a given number of open nodes needs.

    The dense fronts of nested dissection need a memory proportional to n log2 n for n nodes, with a factor of 27 to 32
    bytes on gaps of 512² to 1448² pixels. For networks that are too large to be eliminated, 0 is returned.
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
    stencil : conductances of the links between the nodes. The first row of nodes is the inlet, the last one the outlet.
    rtol : largest relative error of the conductance that an iterative solver may leave.
    solver : "multigrid", "elimination" or "auto". Multigrid preconditions conjugate gradients on the grid. Star-mesh
        elimination retains its relative accuracy even if the conductances differ by a factor of 1e150. "auto" chooses
        multigrid for large networks with smooth conductances, and elimination otherwise or if multigrid fails.
        If the ratio of the sides of a pixel exceeds 3.5, multigrid is slow and may miss a part of the error. Such
        networks are solved by elimination if they have up to 5 million open nodes; for larger ones the error of
        multigrid is bounded. `DarcyFlow.solver` names the solver that was used. After multigrid, nodes that are only
        connected by links narrower than 1e-8 of the widest link are solved by elimination.
    field_rtol : largest relative error of the potential in the energy norm; None if only the conductance is needed. The
        error of the conductance is the square of the error of the potential. An iteration that only makes the
        conductance accurate therefore leaves an error of about √rtol in the potential.

    Returns
    -------
    DarcyFlow with the `potential` at all nodes, array (n1 + 1, n2), and the `conductance` in the unit of the links.

    Raises
    ------
    InputError : the solver is unknown, or a tolerance is not valid.
    NotConverged : the solver failed, or inlet and outlet flow differ by more than 1e-5. After multigrid they may differ
        by 10 √rtol, or by 10 field_rtol if this is given. "multigrid" also fails if links narrower than 1e-13 of the
        widest link might carry more than `rtol` of the flow.
    """
    check_solver(solver, ("auto", *FAST_SOLVERS))
    validate.tolerance("rtol", rtol)
    if field_rtol is not None:
        validate.tolerance("field_rtol", field_rtol)
    links = prepare_links(stencil.along.copy(), stencil.across.copy())
    return solve_prepared(links, stencil.ring2, rtol=rtol, solver=solver, field_rtol=field_rtol)


def solve_prepared(
    links: PreparedLinks,
    ring2: bool,
    *,
    rtol: float,
    solver: str,
    field_rtol: float | None,
) -> DarcyFlow:
    """Solve the flow through a stencil whose links have been prepared.

    The prepared links are scaled by a power of two, which is undone in the conductance. For a unit potential drop, the
    energy Σ c (Δφ)² of a network is equal to its conductance.

    Parameters
    ----------
    links : links of the stencil, and `reached`, which says to which of the two ends each node is connected. The arrays
        `along`, `across` and `reached` may be overwritten, to save memory.
    ring2 : whether the columns form a ring.
    rtol, solver, field_rtol : as in `solve_flow`.
    """
    stencil = Stencil(links.along, links.across, ring2=ring2)
    percolates = links.percolate
    has_inner_nodes = len(stencil.along) > 1
    if not (percolates and has_inner_nodes):
        # nothing is left to solve: the potential of a node follows from the ends to which it is connected
        potential = _POTENTIAL_AT_REST.take(links.reached)
        potential[0] = 1.0
        potential[-1] = 0.0
        conductance = stencil.energy(np.nan_to_num(potential)) if percolates else 0.0
        return DarcyFlow(conductance, potential, 1 - potential, percolates)
    # the flags are stored in the memory of `reached`
    keep = np.equal(links.reached, BOTH_ENDS, out=links.reached.view(np.bool_))
    flow = _solve(stencil, keep, rtol, solver, field_rtol)
    return replace(flow, conductance=ldexp(flow.conductance, links.exponent))


def _solve(
    stencil: Stencil, keep: Flags, rtol: float, solver: str, field_rtol: float | None
) -> DarcyFlow:
    """Choose a solver, and solve the flow.

    keep : flags (n1 + 1, n2) of the nodes that are connected to both ends.
    solver : name of a solver, or "auto". If multigrid is chosen by "auto" and fails, elimination is used.
    """
    nodes = int(np.count_nonzero(keep[1:-1]))
    can_eliminate = nodes <= ELIMINATED_NODES
    if solver == "elimination" or (solver == "auto" and not _suits_multigrid(stencil, nodes)):
        return _solve_by_elimination(stencil, keep)
    has_long_pixels = _pixel_ratio(stencil) > _LARGEST_PIXEL_RATIO
    if has_long_pixels and can_eliminate:
        return _solve_by_elimination(stencil, keep)
    limit = _PATIENCE if solver == "auto" and can_eliminate else _MOST_ITERATIONS
    # on long pixels the estimate of the error cannot be trusted, so that the error is bounded from the beginning
    bounded_from = 0 if has_long_pixels else BOUNDED_FROM
    try:
        return _solve_by_multigrid(stencil, keep, rtol, limit, field_rtol, bounded_from)
    except NotConverged:
        if solver == "multigrid":
            raise
    return _solve_by_elimination(stencil, keep)


def _suits_multigrid(stencil: Stencil, nodes: int) -> bool:
    """Return whether multigrid should be tried first on a network with `nodes` open nodes."""
    n1, n2 = stencil.along.shape
    is_slender = coarsest_nodes(n1 - 1, n2) > COARSEST_NODES
    if is_slender:
        return False
    if nodes > ELIMINATED_NODES:
        return True
    roughness = _roughness(stencil.along, max(1, n1 // _SAMPLED_ROWS))
    # multigrid is faster from _FEWEST exp(_GROWTH r) nodes on; logarithms are compared, so that nothing can overflow
    return log(nodes / _FEWEST) > _GROWTH * roughness


@compiled()
def _roughness(along, step):
    """Compute the mean difference of ln c of neighbouring links in every `step`-th row.

    If only one of two neighbouring links is open, `_CLOSED` takes the place of their difference.
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
                total += _CLOSED
                pairs += 1
            before = here
    return total / pairs


def _pixel_ratio(stencil: Stencil) -> float:
    """Estimate the ratio of the longer to the shorter side of a pixel from the open links of some rows.

    The conductance of a link is proportional to its width over its length. If the gap is isotropic, the ratio of the
    geometric means of both kinds of links is therefore the square of the ratio of the sides.
    """
    step = max(1, len(stencil.along) // _SAMPLED_ROWS)
    means = []
    for links in (stencil.along[::step], stencil.across[::step]):
        is_open = links[links > 0]
        if not is_open.size:
            return 1.0
        means.append(float(np.log(is_open).mean()))
    return exp(abs(means[0] - means[1]) / 2)


def _solve_by_elimination(stencil: Stencil, keep: Flags) -> DarcyFlow:
    """Solve by star-mesh elimination, and use the conductance that elimination itself gives, which is more accurate."""
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
    bounded_from: int,
) -> DarcyFlow:
    """Solve by multigrid, and then by elimination at the nodes that are only connected by very narrow links.

    Multigrid leaves out links that are so narrow that rounding removes them from a sum of conductances. The flow
    without these links is a lower bound of the flow (Rayleigh's principle). The energy of any potential on all links is
    an upper bound (Dirichlet's principle). The error is at most the difference between the two bounds.

    limit : largest number of iterations.
    bounded_from : number of iterations from which on the error is bounded, see `solve_multigrid`.
    """
    # nodes that multigrid cannot solve, and nodes that keep their links; both are None if multigrid can solve all nodes
    isolated: Flags | None = None
    through: Flags | None = None
    # conductances are divided by a power of two near the largest one
    has_narrow_links = any(
        ((c > 0) & (c < _CONTRIBUTING)).any() for c in (stencil.along, stencil.across)
    )
    if has_narrow_links:
        isolated, through = _isolated_nodes(stencil, keep)
    lower_bound = 0.0
    with closed(stencil, through, _RESOLVED):
        solution = solve_multigrid(stencil, rtol, limit, isolated, field_rtol, bounded_from)
        potential, error = solution.potential, solution.error
        if isolated is not None:
            # exact energy of the network without its narrow links, from below
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


def _isolated_nodes(stencil: Stencil, keep: Flags) -> tuple[Flags | None, Flags | None]:
    """Find nodes at which multigrid converges slowly or not at all, because they are only connected by narrow links.

    Returns
    -------
    isolated : flags (n1 − 1, n2) of these inner nodes. They are connected to both ends, but no path of wide links leads
        to either of them.
    through : flags (n1 + 1, n2) of the nodes that remain connected to both ends if links below `_RESOLVED` are closed.
    Both are None if there are no isolated nodes.
    """
    along, across = stencil.along, stencil.across
    reached_by_wide_links = nodes_reached(along, across, _CONTRIBUTING)
    isolated = (keep & (reached_by_wide_links == 0))[1:-1]
    if not isolated.any():
        return None, None
    return isolated, nodes_reached(along, across, _RESOLVED) == BOTH_ENDS


class _Statistics(NamedTuple):
    """Name of the solver, number of its iterations, and estimated error of the potential in the energy norm."""

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
    """Check that inlet and outlet flow of a solution agree, and make a DarcyFlow from it.

    Parameters
    ----------
    stencil : conductances between the nodes.
    keep : flags (n1 + 1, n2) of the nodes that carry flow; the potential of all others becomes NaN.
    potentials : arrays φ and ψ = 1 − φ at the nodes.
    statistics : details of the solution.
    conductance : conductance, if the solver has computed it; by default it is the energy of φ.
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
    imbalance = inf
    if conductance > 0:
        difference = max(abs(inflow - outflow), abs(inflow - conductance))
        imbalance = float(difference / conductance)
    if not imbalance <= allowed:
        raise NotConverged(
            f"flow: inlet and outlet differ by {imbalance:.1e} of the flow, expected {allowed:.0e}; "
            "try the solver 'elimination'",
            imbalance,
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

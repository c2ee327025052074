"""Solve the flow for a unit drop between inlet and outlet of a stencil: choose the solver, and check its solution.

Multigrid is taken on many nodes and smooth conductances, elimination on others, on long pixels and where multigrid does
not converge. Nodes that are not connected to both ends are left out; without a path the flow is exactly 0.
"""

from __future__ import annotations

from dataclasses import replace
from math import exp, inf, ldexp, log, log2, sqrt

import numpy as np
from numpy.typing import NDArray

from ...base import Array, Flags, NotConverged, validate
from ...base.compiled import compiled
from ..grid import Stencil
from ..percolation import closed, nodes_reached, ready
from ..problem import FAST_SOLVERS, MAX_IMBALANCE, DarcyFlow, check_solver
from .elimination import eliminate
from .multigrid import CHECKED, COARSEST_NODES, coarsest_nodes, solve_multigrid

#: Largest number of nodes of a network for which elimination may be the first choice (about 4 GB at the limit).
ELIMINATED_NODES = 5_000_000
#: Ratio of the sides of a pixel up to which multigrid is used. On gaps of 64² and 128² pixels it takes the time of
#: elimination at 2.5 to 3.5, 2 to 6 times that at 4 to 12, and at 28 it fails in 1 of 12 calls and had an error of
#: 22 % once: it does not coarsen along the long side of the pixels alone, and meets the slowest part of the error late.
_LONGEST_PIXEL = 3.5
#: About so many rows of links are sampled to estimate that ratio, and the contrast of neighbouring links.
_SAMPLED = 64
#: Links narrower than this fraction of the widest hardly count in sums of conductances: an iteration converges slowly,
#: or not at all, at nodes that only such links connect with the others.
_SEEN = 1e-8
#: Links narrower than this fraction are lost to rounding in sums with wide ones, and the matrix may become indefinite.
_LOST = 1e-13
#: Multigrid is tried first on more than so many nodes × exp(growth × roughness), see `_roughness`; it is given up after
#: so many iterations. On 245 networks of 24² to 512² nodes, of independent links and pixels, contacts and faces cut by
#: a plane, the solver so chosen takes 1.1 times the time of the faster one in the mean.
_FEWEST, _GROWTH, _CLOSED, _PATIENCE = 15, 3.5, 4.0, 120
#: Iterations allowed to multigrid where the caller chose it, or where elimination would take too much memory.
_MOST_ITERATIONS = 600
#: Potential of a node that is connected to neither end, to the inlet, or to the outlet; both: it is computed.
_AT_REST = np.array([np.nan, 1.0, 0.0, np.nan])


def elimination_memory(nodes: float) -> float:
    """Return the memory [byte] that elimination of so many open nodes takes; 0 for more nodes than are eliminated.

    Its dense fronts grow with the logarithm of the number of nodes (nested dissection). Measured on gaps of 512² to
    1448² pixels: 27 to 32 bytes for each open node and each doubling of their number.
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
    """Solve the mass balance of every inner node for a unit drop of potential.

    Parameters
    ----------
    stencil : conductances of the nodes, those of the first and the last row being inlet and outlet.
    rtol : relative error of the conductance allowed to an iterative solution.
    solver : "multigrid" (conjugate gradients on the grid's own hierarchy), "elimination" (star-mesh elimination, keeps
        its relative accuracy at any contrast up to 1e150), or "auto": multigrid on many nodes and smooth conductances,
        and elimination elsewhere and where that fails. Where the sides of a pixel differ by more than 3.5 : 1,
        multigrid is slow and may not meet a part of the error: elimination then takes its place, up to 5 million open
        nodes, and beyond that the error is bounded. `DarcyFlow.solver` says what was used. After multigrid, nodes that
        only links narrower than 1e-8 of the widest connect with the others are solved by elimination.
    field_rtol : error of the potential allowed to an iteration, in the norm of the energy, where the potential itself
        is wanted. The conductance errs by the square of the error of the potential, so that an iteration that stops
        where the conductance is right leaves an error of about √rtol to the potential.

    Returns
    -------
    DarcyFlow, its `potential` at all nodes (n1 + 1, n2) and its `conductance` in the unit of the conductances.

    Raises
    ------
    InputError : an unknown solver, a bad rtol.
    NotConverged : the solver failed, or inlet and outlet flow differ by more than 1e-5, after multigrid by more than
        10 √rtol, or 10 field_rtol if that is given. "multigrid" fails where links narrower than 1e-13 of the widest may
        carry more than rtol of the flow.
    """
    check_solver(solver, ("auto", *FAST_SOLVERS))
    validate.tolerance("rtol", rtol)
    if field_rtol is not None:
        validate.tolerance("field_rtol", field_rtol)
    conductances = stencil.along.copy(), stencil.across.copy()
    return solve_ready(
        *ready(*conductances),
        conductances,
        stencil.ring2,
        rtol=rtol,
        solver=solver,
        field_rtol=field_rtol,
    )


def solve_ready(
    reached: NDArray[np.int8],
    exponent: int,
    conductances: tuple[Array, Array],
    ring2: bool,
    *,
    rtol: float,
    solver: str,
    field_rtol: float | None,
) -> DarcyFlow:
    """`solve_flow` of what `ready` makes, which is written over."""
    stencil = Stencil(*conductances, ring2=ring2)
    percolates = bool(reached[0, 0] == 3)
    if not percolates or len(stencil.along) == 1:
        potential = _AT_REST.take(reached)
        potential[0], potential[-1] = 1.0, 0.0
        total = stencil.energy(np.nan_to_num(potential)) if percolates else 0.0
        return DarcyFlow(total, potential, 1 - potential, percolates)
    flow = _solve(
        stencil, np.equal(reached, 3, out=reached.view(np.bool_)), rtol, solver, field_rtol
    )
    return replace(flow, conductance=ldexp(flow.conductance, exponent))


def _solve(
    stencil: Stencil, keep: Flags, rtol: float, solver: str, field_rtol: float | None
) -> DarcyFlow:
    """Solve by the given or chosen solver; if that is multigrid and fails, by elimination unless it was given."""
    nodes = int(np.count_nonzero(keep[1:-1]))
    can_eliminate = nodes <= ELIMINATED_NODES
    if solver == "elimination" or (solver == "auto" and not _suits_multigrid(stencil, nodes)):
        return _by_elimination(stencil, keep)
    has_long_pixels = _pixel_ratio(stencil) > _LONGEST_PIXEL
    if has_long_pixels and can_eliminate:
        return _by_elimination(stencil, keep)
    limit = _PATIENCE if solver == "auto" and can_eliminate else _MOST_ITERATIONS
    checked = 0 if has_long_pixels else CHECKED
    try:
        return _by_multigrid(stencil, keep, rtol, limit, field_rtol, checked)
    except NotConverged:
        if solver == "multigrid":
            raise
    return _by_elimination(stencil, keep)


def _suits_multigrid(stencil: Stencil, nodes: int) -> bool:
    """Return whether multigrid is to be tried first on a network with so many open nodes."""
    n1, n2 = stencil.along.shape
    if (
        coarsest_nodes(n1 - 1, n2) > COARSEST_NODES
    ):  # the coarsest level of a slender grid has many nodes
        return False
    if nodes > ELIMINATED_NODES:
        return True
    roughness = _roughness(stencil.along, max(1, n1 // _SAMPLED))
    return log(nodes / _FEWEST) > _GROWTH * roughness


@compiled()
def _roughness(along, step):
    """Mean difference of the logarithms of neighbouring links in some rows, _CLOSED where one of the two is closed."""
    total, pairs = 0.0, 1
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

    The conductance of a link is proportional to its width over its length, so that the geometric means along and across
    differ by the square of the ratio, on gaps without a direction of their own.
    """
    step = max(1, len(stencil.along) // _SAMPLED)
    means = []
    for links in (stencil.along[::step], stencil.across[::step]):
        is_open = links[links > 0]
        if not is_open.size:
            return 1.0
        means.append(float(np.log(is_open).mean()))
    return exp(abs(means[0] - means[1]) / 2)


def _by_elimination(stencil: Stencil, keep: Flags) -> DarcyFlow:
    """Solve by star-mesh elimination, whose conductance is kept as it has a relative accuracy of its own."""
    φ, ψ = np.zeros((2, *keep.shape))
    φ[0] = ψ[-1] = 1.0
    rate = eliminate(stencil, keep[1:-1], φ, ψ)
    return _checked(stencil, keep, (φ, ψ), (0, 0.0, "elimination"), rate)


def _by_multigrid(
    stencil: Stencil,
    keep: Flags,
    rtol: float,
    limit: int,
    field_rtol: float | None,
    checked: int,
) -> DarcyFlow:
    """Solve by multigrid, then by elimination at nodes that only very narrow links connect with the others.

    Multigrid does without links that are lost in sums. Those can carry a part of a small flow, which lies between that
    without them (Rayleigh's principle) and the energy of any potential with them (Dirichlet's): how far these two are
    apart bounds the error.
    """
    hidden: Flags | None = None
    seen: Flags | None = None
    if any(((c > 0) & (c < _SEEN)).any() for c in (stencil.along, stencil.across)):
        hidden, seen = _hidden(stencil, keep)
    least = 0.0
    with closed(stencil, seen, _LOST):
        potential, iterations, error = solve_multigrid(
            stencil, rtol, limit, hidden, field_rtol, checked
        )
        if hidden is not None:
            least = stencil.energy(potential) * (1 - error**2)
    complement = 1 - potential
    if hidden is not None:
        eliminate(stencil, hidden, potential, complement)
    allowed = max(MAX_IMBALANCE, 10 * (sqrt(rtol) if field_rtol is None else field_rtol))
    how = iterations, error, "multigrid"
    flow = _checked(stencil, keep, (potential, complement), how, allowed=allowed)
    if hidden is None:
        return flow
    between = 1 - least / flow.conductance
    if not between <= rtol:
        raise NotConverged(
            f"flow: error up to {between:.1e} of the rate by links too narrow for multigrid, wanted {rtol:.1e}; "
            "try the solver 'elimination'",
            between,
        )
    return replace(flow, residual=float(max(error, np.sqrt(max(between, 0.0)))))


def _hidden(stencil: Stencil, keep: Flags) -> tuple[Flags | None, Flags | None]:
    """Find nodes at which multigrid converges slowly, or not at all.

    Returns the inner nodes that only narrow links connect with others, and the nodes that links which are not lost
    connect with both ends; None without any of the first.
    """
    links = stencil.along, stencil.across
    hidden = (keep & (nodes_reached(*links, _SEEN) == 0))[1:-1]
    return (hidden, nodes_reached(*links, _LOST) == 3) if hidden.any() else (None, None)


def _checked(
    stencil: Stencil,
    keep: Flags,
    potentials: tuple[Array, Array],
    how: tuple[int, float, str],
    rate: float | None = None,
    allowed: float = MAX_IMBALANCE,
) -> DarcyFlow:
    """The solution φ with 1 − φ = ψ, NaN where nodes are not kept, unless inlet and outlet flow differ.

    how : iterations, residual and solver. rate : conductance, the energy of φ unless given.
    """
    φ, ψ = potentials
    # the energy sum keeps its relative accuracy where a difference of flows would not
    rate = stencil.energy(φ) if rate is None else rate
    inlet = (stencil.along[0] * ψ[1]).sum()
    outlet = (stencil.along[-1] * φ[-2]).sum()
    imbalance = float(max(abs(inlet - outlet), abs(inlet - rate)) / rate) if rate > 0 else inf
    if not imbalance <= allowed:
        raise NotConverged(
            f"flow: inlet and outlet differ by {imbalance:.1e} of the flow, expected {allowed:.0e}; "
            "try the solver 'elimination'",
            imbalance,
        )
    φ[~keep] = ψ[~keep] = np.nan
    iterations, residual, solver = how
    return DarcyFlow(rate, φ, ψ, True, iterations, residual, imbalance, solver)

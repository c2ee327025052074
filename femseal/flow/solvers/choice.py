"""Flow for a unit drop between inlet and outlet of a stencil: choice of the solver, and check of its solution.

Multigrid is taken on many nodes and smooth conductances, elimination on others and where multigrid does not converge.
Nodes that are not connected to both ends are left out; without a path the flow is exactly 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import exp, inf, ldexp, log, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base import Array, Flags, NotConverged, validate
from ...base.compiled import compiled, number, on_threads
from ..balance import energy_gap
from ..grid import Stencil
from ..percolation import closed, dead_ends, fill_dead_ends, nodes_reached, ready
from ..problem import FAST_SOLVERS, MAX_IMBALANCE, DarcyFlow, check_solver
from .elimination import eliminate
from .multigrid import CHECKED, COARSEST_NODES, coarsest_nodes, solve_multigrid

#: Largest number of nodes of a network for which elimination may be the first choice (about 4 GB at the limit).
ELIMINATED_NODES = 5_000_000
#: About so many rows of links are sampled to estimate their contrast.
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
#: Dead ends are sought on so many nodes, and where there may be some, as no more than this fraction of the nodes are
#: open. Iterations with and without them on gaps with 14, 22 and 27 % in contact: at 512² 11 of 71, 49 of 140 and 68 of
#: 183, in a third to a half of the time; at 1024² 70 of 212, and 108 where without them more than 400 were needed. On
#: fewer nodes few iterations are the rule, and seeking takes 1.2 times the time of those.
_MANY, _MAY_HAVE_DEAD_ENDS = 400_000, 0.88
#: Ratio of the sides of a pixel up to which multigrid is used. On gaps of 64² and 128² pixels it takes the time of
#: elimination at 2.5 to 3.5, 2 to 6 times that at 4 to 12, and at 28 it fails in 1 of 12 calls and had an error of
#: 22 % once: it does not coarsen along the long side of the pixels alone, and meets the slowest part of the error late.
_LONGEST_PIXEL = 3.5
#: Iterations allowed to multigrid where the caller chose it, or where elimination would take too much memory.
_MOST_ITERATIONS = 600
#: Part of the error allowed at which an iteration stops, as some part of the error may be so slow that it has not met
#: it; from `CHECKED` iterations on the error is bounded by a flux that balances, and factor of it allowed to the next
#: solution if it is too large. Of 437 gaps of four kinds that took fewer, for 1e-6, none erred by more than 3e-11; a
#: pool behind narrow links that took 12 erred by 1.6e-6. The bound takes the time of 6 iterations.
_PART, _TIGHTER = 1 / 3, 1e-7
#: Potential of a node that is connected to neither end, to the inlet, or to the outlet; both: it is computed.
_AT_REST = np.array([np.nan, 1.0, 0.0, np.nan])


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
        its relative accuracy at any contrast up to 1e150), or "auto". Where the sides of a pixel differ by more than
        3.5 : 1, multigrid is slow and may not meet a part of the error: elimination then takes its place, up to 5
        million open nodes, and beyond that the error is bounded. `DarcyFlow.solver` says what was used. After
        multigrid, nodes that only links narrower than 1e-8 of the widest connect with the others are solved by
        elimination.
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
    """Solve by the given or chosen solver; if that is iterative and fails, directly, unless multigrid was given."""
    first, limit = _chosen(stencil, keep) if solver == "auto" else (solver, _MOST_ITERATIONS)
    has_long_pixels = first == "multigrid" and _pixel_ratio(stencil) > _LONGEST_PIXEL
    if has_long_pixels and np.count_nonzero(keep[1:-1]) <= ELIMINATED_NODES:
        first = "elimination"
    try:
        if first == "multigrid":
            checked = 0 if has_long_pixels else CHECKED
            return _by_multigrid(stencil, keep, rtol, limit, field_rtol, checked=checked)
    except NotConverged:
        if solver == "multigrid":
            raise
    return _by_elimination(stencil, keep)


def _chosen(stencil: Stencil, keep: Flags) -> tuple[str, int]:
    """The solver to try first, and the iterations after which it is given up."""
    n1, n2 = stencil.along.shape
    nodes = int(np.count_nonzero(keep[1:-1]))
    slender = (
        coarsest_nodes(n1 - 1, n2) > COARSEST_NODES
    )  # the coarsest level of such a grid has many nodes
    if nodes > ELIMINATED_NODES and not slender:
        return "multigrid", _MOST_ITERATIONS
    roughness = _roughness(stencil.along, max(1, n1 // _SAMPLED))
    smooth = not slender and log(nodes / _FEWEST) > _GROWTH * roughness
    return ("multigrid" if smooth else "elimination"), _PATIENCE


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
    field_rtol: float | None = None,
    *,
    checked: int = CHECKED,
) -> DarcyFlow:
    """Solve by multigrid, bound the error from `checked` iterations on, and lessen it where it is too large."""
    gap = inf
    for allowed in (_PART * rtol, _PART * rtol * _TIGHTER):
        try:
            flow = _by_iterations(stencil, keep, rtol, allowed, limit, field_rtol)
        except NotConverged:
            if gap == inf:
                raise
            break  # what is said of a smaller error than was asked for helps nobody
        if flow.iterations < checked:
            return flow
        gap = energy_gap(stencil, flow.potential, flow.complement)
        if gap <= rtol:
            return replace(flow, residual=max(flow.residual, sqrt(gap)))
        if allowed <= 1e-14 or flow.iterations >= limit:
            break
    raise NotConverged(
        f"flow: error up to {gap:.1e} of the rate by multigrid, wanted {rtol:.1e}; try the solver 'elimination'",
        gap,
    )


def _by_iterations(
    stencil: Stencil, keep: Flags, rtol: float, stop: float, limit: int, field_rtol: float | None
) -> DarcyFlow:
    """Solve by multigrid, then by elimination at nodes that only very narrow links connect with the others.

    Multigrid does without links that are lost in sums. Those can carry a part of a small flow, which lies between that
    without them (Rayleigh's principle) and the energy of any potential with them (Dirichlet's): how far these two are
    apart bounds the error.
    """
    inner = keep[1:-1]
    through: Flags | None = None
    dead: tuple[NDArray[np.int32], NDArray[np.int32]] | None = None
    unseen: Flags | None = None
    seen: Flags | None = None
    searches: list[Callable[..., Any]] = []
    if any(((c > 0) & (c < _SEEN)).any() for c in (stencil.along, stencil.across)):
        searches.append(_unseen)
    if inner.size >= _MANY and _MANY <= np.count_nonzero(inner) < _MAY_HAVE_DEAD_ENDS * inner.size:
        searches.append(
            dead_ends
        )  # no path to an end leads through them, so that neither search needs the other
    found = on_threads(number(), lambda search: search(stencil, keep), searches) if searches else []
    if dead_ends in searches:
        through, dead = found.pop()
    if found:
        unseen, seen = found.pop()
    hidden = None
    with closed(stencil, through):
        if unseen is not None:
            hidden = (unseen if through is None else unseen & through)[1:-1]
            hidden = hidden if hidden.any() else None
        del through, unseen
        with closed(stencil, None if hidden is None else seen, _LOST):
            del seen
            potential, iterations, error = solve_multigrid(stencil, stop, limit, hidden, field_rtol)
            if hidden is not None:
                least = stencil.energy(potential) * (1 - error**2)
        complement = 1 - potential
        φ, ψ = potential[1:-1], complement[1:-1]
        if hidden is not None:
            eliminate(stencil, hidden, potential, complement)
    if dead is not None:
        fill_dead_ends(φ, dead, 1.0, 0.0)
        fill_dead_ends(ψ, dead, 0.0, 1.0)
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


def _unseen(stencil: Stencil, keep: Flags) -> tuple[Flags | None, Flags | None]:
    """Nodes that only narrow links connect with others, and those that links which are not lost connect with both ends.

    None if there are none of the first.
    """
    links = stencil.along, stencil.across
    unseen = keep & (nodes_reached(*links, _SEEN) == 0)
    return (unseen, nodes_reached(*links, _LOST) == 3) if unseen.any() else (None, None)


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

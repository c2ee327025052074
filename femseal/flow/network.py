"""Flow through a network of links between a given inlet and outlet: the one operator of both scales.

Nodes form n1 + 1 rows of n2; row 0 is the inlet at potential 1, row n1 the outlet at 0. Links along x1 have the
conductances c1 (n1, n2), links along x2 c2 (n1 − 1, n2), or (n1 − 1, n2 − 1) between closed sides. Closed links carry
nothing, and without an open path the flow is exactly 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..base import validate
from ..base.errors import InputError, NotConverged
from .connectivity import links_between, nodes_reached
from .elimination import eliminate
from .mesh import link_pattern
from .multigrid import COARSEST_NODES, coarsest_nodes, network_operator, solve_multigrid
from .solvers.amg import solve_amg

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
#: Inlet and outlet flow may differ by this share before the solution is refused.
MAX_IMBALANCE = 1e-5
#: Nodes up to which the network may be eliminated directly (about 4 GB at the limit) before all else is tried.
DIRECT_NODES = 5_000_000
#: Rows of links from which their contrast is taken, about.
_SAMPLED = 64
#: Links narrower than this share of the widest hardly count in sums of conductances: an iteration does not see, or only
#: slowly, what hangs on them only.
_SEEN = 1e-8
#: Iterations of multigrid allowed where it is wanted, or elimination takes much memory.
_MOST_ITERATIONS = 400
METHODS = ("auto", "direct", "multigrid", "amg")
#: Potential of a node that neither, the inlet, or the outlet reaches.
_AT_REST = np.array([np.nan, 1.0, 0.0, np.nan])


@dataclass(frozen=True)
class NetworkFlow:
    """Flow for a unit drop: rate (= dissipated energy), potential of the nodes, and how it was solved.

    potential : 1 and 0 where only the inlet or only the outlet reaches, NaN in pockets that neither does.
    complement : 1 − potential, of its own relative accuracy with the direct method.
    imbalance : difference of inlet and outlet flow, in shares of the rate.
    iterations, residual : 0 for a direct solution; otherwise residual is the estimated error of the potential in the
        norm of the energy.
    """

    rate: float
    potential: Array
    complement: Array
    percolates: bool
    iterations: int
    residual: float
    imbalance: float


def solve_network(c1: Array, c2: Array, *, rtol: float = 1e-6, method: str = "auto") -> NetworkFlow:
    """Solve the mass balance of every node for a unit drop of potential.

    Parameters
    ----------
    c1, c2 : conductances >= 0 of the links along x1 and x2; c2 has n2 columns on a periodic network, n2 − 1 otherwise.
    rtol : relative error of the rate allowed to an iterative solution.
    method : "direct" (star-mesh elimination, keeps its relative accuracy at any contrast up to 1e150), "multigrid"
        (conjugate gradients on the grid's own hierarchy), "amg" (on pyamg's, the matrix assembled by scikit-fem), or
        "auto": multigrid where it is expected to be faster or elimination takes more than 4 GB, and elimination
        wherever that does not converge. What hangs on links 1e-8 times as wide as others only is eliminated behind
        multigrid.

    Raises
    ------
    InputError : an unknown method, shapes that do not match, conductances that are negative or not finite.
    NotConverged : the linear solver failed, or inlet and outlet flow differ by more than 1e-5.
    """
    if method not in METHODS:
        raise InputError.of("method", method, f"one of {', '.join(METHODS)}")
    validate.tolerance("rtol", rtol)
    c1, c2, periodic = _validated(c1, c2)
    reached = nodes_reached(c1, c2)
    percolates = bool(reached[0, 0] == 3)
    if not percolates or len(c1) == 1:
        potential = _AT_REST.take(reached)
        potential[0], potential[-1] = 1.0, 0.0
        return NetworkFlow(float(c1.sum()) if percolates else 0.0, potential, 1 - potential, percolates, 0, 0.0, 0.0)
    keep = reached == 3
    c1, c2 = links_between(c1, c2, keep)
    # a power of two changes no digit and keeps products from overflowing
    exponent = int(np.floor(np.log2(max(c1.max(), c2.max(initial=0.0)))))
    flow = _solve(np.ldexp(c1, -exponent), np.ldexp(c2, -exponent), keep, periodic, rtol, method)
    return replace(flow, rate=float(np.ldexp(flow.rate, exponent)))


def _solve(c1: Array, c2: Array, keep: Flags, periodic: bool, rtol: float, method: str) -> NetworkFlow:
    """Elimination unless something else is asked for, or expected to be faster and fit."""
    n1, n2 = c1.shape
    if method == "amg":
        return _by_amg(c1, c2, keep, periodic, rtol)
    if method == "multigrid":
        return _by_multigrid(c1, c2, keep, periodic, rtol, _MOST_ITERATIONS)
    if method == "direct":
        return _by_elimination(c1, c2, keep, periodic)
    nodes = int(np.count_nonzero(keep[1:-1]))
    few = nodes <= DIRECT_NODES
    if coarsest_nodes(n1 - 1, n2) <= COARSEST_NODES:
        worth, limit = _worth_of_multigrid(c1, (n1 - 1) * n2, nodes)
        if worth or not few:
            try:
                return _by_multigrid(c1, c2, keep, periodic, rtol, limit if few else _MOST_ITERATIONS)
            except NotConverged:
                pass
    elif not few:
        return _by_amg(c1, c2, keep, periodic, rtol)
    return _by_elimination(c1, c2, keep, periodic)


def _by_elimination(c1: Array, c2: Array, keep: Flags, periodic: bool) -> NetworkFlow:
    inlet, outlet = np.zeros((2, len(c1) - 1, c1.shape[1]))
    inlet[0], outlet[-1] = c1[0], c1[-1]
    rate, φ, ψ = eliminate(c1, c2, keep[1:-1], periodic, inlet, outlet)
    return _balanced(c1, c2, keep, φ, ψ, rate, 0, 0.0)


def _validated(c1: Array, c2: Array) -> tuple[Array, Array, bool]:
    """Conductances as arrays, and whether the columns form a ring."""
    try:
        if np.iscomplexobj(c1) or np.iscomplexobj(c2):
            raise TypeError
        c1, c2 = np.ascontiguousarray(c1, dtype=float), np.ascontiguousarray(c2, dtype=float)
    except (TypeError, ValueError):
        raise InputError("c1, c2: given no arrays of real numbers, allowed are (n1, n2) and (n1 - 1, n2)") from None
    if c1.ndim != 2 or c1.size == 0:
        raise InputError.of("c1", f"shape {c1.shape}", "a shape (n1, n2)")
    n1, n2 = c1.shape
    if c2.shape not in ((n1 - 1, n2), (n1 - 1, n2 - 1)):
        raise InputError.of("c2", f"shape {c2.shape}", f"shape {(n1 - 1, n2)} or {(n1 - 1, n2 - 1)}")
    for name, c in (("c1", c1), ("c2", c2)):
        if not (np.isfinite(c).all() and c.min(initial=0.0) >= 0):
            raise InputError.of(name, "negative or undefined values", "finite conductances >= 0")
    if n2 == 1:  # no neighbours across
        return c1, np.zeros((n1 - 1, 1)), True
    return c1, c2, c2.shape[1] == n2


def _worth_of_multigrid(c1: Array, unknowns: int, nodes: int) -> tuple[bool, int]:
    """Whether multigrid is expected to take less time than elimination, and the iterations that take as long.

    Elimination leaves out what is closed. From times at 24² to 256² and closed shares of 0.02 to 0.4 on one core,
    multigrid against elimination in ms: 32² 0.16 : 0.36 to 0.18 : 0.15; 64² 0.6 : 2.0 to 1.1 : 0.8; 128² 2.6 : 12 to
    3.8 : 4.6; 256² 13 : 65 to 25 : 23. Links that differ from their neighbours, as those drawn one by one do, are not
    seen on coarser grids.
    """
    share = nodes / unknowns
    iteration, elimination = 1.5e-8 * unknowns, 2e-3 * (nodes / 4000) ** 1.25 * share**0.4
    limit = int(elimination / iteration)
    smooth = 6e-5 + (8 + 30 * (1 - share)) * iteration < elimination
    return bool(smooth) and _iterations_of_noise(c1) < 2 * limit, limit


def _iterations_of_noise(c1: Array) -> float:
    """What multigrid takes where neighbouring links are independent, within a factor of two.

    From log-normal links with standard deviations of 0.5 to 2.5, of which none, a tenth or a third are closed, at 100²
    and 316²: 10 to 177, and up to 319. Where they are not independent it is more than is taken, up to three times.
    """
    rows = c1[:: max(1, len(c1) // _SAMPLED)]
    is_open = rows > 0
    left, right = is_open[:, :-1], is_open[:, 1:]
    logarithm = np.log(rows, out=np.zeros_like(rows), where=is_open)
    both = left & right
    contrast = np.abs(np.diff(logarithm, axis=1)).sum(where=both) / max(1, int(both.sum()))
    ends = (left ^ right).sum() / max(1, int((left | right).sum()))
    return float(5 * np.exp(1.3 * contrast + 7 * ends))


def _by_multigrid(c1: Array, c2: Array, keep: Flags, periodic: bool, rtol: float, limit: int) -> NetworkFlow:
    """Multigrid, then elimination of what hangs on links so narrow that its potential is lost in the others' sums."""
    seen = nodes_reached(np.where(c1 >= _SEEN, c1, 0.0), np.where(c2 >= _SEEN, c2, 0.0)) > 0
    hidden = (keep & ~seen)[1:-1]
    operator = network_operator(c1, c2, periodic)
    φ, iterations, error = solve_multigrid(operator, periodic, c1[0], c1[-1], 0.1 * rtol, limit, ~hidden)
    ψ = 1 - φ
    if hidden.any():
        n1, n2 = c1.shape
        high, low = np.zeros((2, n1 + 1, n2))
        high[0] = low[-1] = 1.0
        high[1:-1], low[1:-1] = np.where(hidden, 0.0, np.clip(φ, 0.0, 1.0)), np.where(hidden, 0.0, np.clip(ψ, 0.0, 1.0))
        # every neighbour that is known is a little of both ends
        inlet, outlet = (_links_to(c1, c2, a) for a in (high, low))
        _, φ_hidden, ψ_hidden = eliminate(c1, c2, hidden, periodic, inlet, outlet)
        φ, ψ = (np.where(hidden, a.reshape(hidden.shape), b) for a, b in ((φ_hidden, φ), (ψ_hidden, ψ)))
    return _balanced(c1, c2, keep, φ, ψ, None, iterations, error)


def _links_to(c1: Array, c2: Array, values: Array) -> Array:
    """Sum over the neighbours of every inner node of link · value."""
    m2 = c2.shape[1]
    out = c1[:-1] * values[:-2] + c1[1:] * values[2:]
    inner = values[1:-1]
    out[:, :m2] += c2 * np.roll(inner, -1, axis=1)[:, :m2]
    out += np.roll(np.pad(c2, ((0, 0), (0, inner.shape[1] - m2))) * inner, 1, axis=1)
    return out


def _by_amg(c1: Array, c2: Array, keep: Flags, periodic: bool, rtol: float) -> NetworkFlow:
    n1, n2 = c1.shape
    matrix = link_pattern(n1, n2, periodic).matrix(c1, c2)
    solution = solve_amg(matrix, np.r_[c1[0], np.zeros((n1 - 2) * n2)], rtol=rtol, unit_drop=True)
    return _balanced(c1, c2, keep, solution.x, solution.complement, None, solution.iterations, solution.residual)


def _balanced(
    c1: Array, c2: Array, keep: Flags, φ: Array, ψ: Array, rate: float | None, iterations: int, residual: float
) -> NetworkFlow:
    """The solution with the potentials φ and 1 − φ = ψ of the inner nodes, unless inlet and outlet flow differ."""
    n1, n2 = c1.shape
    potential, complement = np.zeros((n1 + 1, n2)), np.zeros((n1 + 1, n2))
    potential[0] = complement[-1] = 1.0
    potential[1:-1], complement[1:-1] = φ.reshape(n1 - 1, n2), ψ.reshape(n1 - 1, n2)
    if rate is None:
        # the energy sum keeps its relative accuracy where a difference of flows would not
        drop2 = (np.roll(potential, -1, axis=1) - potential)[1:-1, : c2.shape[1]]
        rate = float((c1 * (potential[:-1] - potential[1:]) ** 2).sum() + (c2 * drop2**2).sum())
    inlet, outlet = float(c1[0] @ complement[1]), float(c1[-1] @ potential[-2])
    imbalance = max(abs(inlet - outlet), abs(inlet - rate)) / rate if rate > 0 else np.inf
    if not imbalance <= MAX_IMBALANCE:
        raise NotConverged(
            f"flow: inlet and outlet differ by {imbalance:.1e} of the flow, allowed is {MAX_IMBALANCE:.0e}; "
            "try the direct solver",
            imbalance,
        )
    potential[~keep] = complement[~keep] = np.nan
    return NetworkFlow(rate, potential, complement, True, iterations, residual, imbalance)

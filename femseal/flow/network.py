"""Flow through a network of links between a given inlet and outlet: the one operator of both scales.

Nodes form n1 + 1 rows of n2; row 0 is the inlet at potential 1, row n1 the outlet at 0. Links along x1 have conductances
c1 (n1, n2), links along x2 c2 (n1 − 1, n2), or (n1 − 1, n2 − 1) between closed sides. Closed links carry nothing, and
without an open path the flow is exactly 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import NotConverged
from .connectivity import percolating_nodes
from .linear import solve_spd
from .mesh import link_pattern

Array = NDArray[np.float64]
#: Inlet and outlet flow may differ by this share before the solution is refused.
MAX_IMBALANCE = 1e-5


@dataclass(frozen=True)
class NetworkFlow:
    """Flow for a unit drop: rate (= dissipated energy), potential of the nodes, and how it was solved."""

    rate: float
    potential: Array
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
    method : linear solver, see `linear.solve_spd`.

    Raises
    ------
    NotConverged : the linear solver failed, or inlet and outlet flow differ by more than 1e-5.

    Notes
    -----
    The rate is the energy sum Σ c (Δφ)², which keeps its relative accuracy however small it is.
    """
    c1, c2 = np.ascontiguousarray(c1, dtype=float), np.ascontiguousarray(c2, dtype=float)
    n1, n2 = c1.shape
    periodic = n2 == 1 or c2.shape[1] == n2
    if n2 == 1:  # no neighbours across
        c2 = np.zeros((n1 - 1, 1))
    potential = np.zeros((n1 + 1, n2))
    potential[0] = 1.0
    keep = percolating_nodes(c1, c2)
    if not keep.any():
        return NetworkFlow(0.0, potential, False, 0, 0.0, 0.0)
    iterations, residual = 0, 0.0
    if n1 > 1:
        c1 = np.where(keep[:-1] & keep[1:], c1, 0.0)
        across = np.roll(keep, -1, axis=1)[1:-1, : c2.shape[1]]
        c2 = np.where(keep[1:-1, : c2.shape[1]] & across, c2, 0.0)
        pattern = link_pattern(n1, n2, periodic)
        matrix = pattern.matrix(c1, c2)
        matrix.data[pattern.diagonal[~keep[1:-1].ravel()]] = 1.0
        rhs = np.zeros((n1 - 1) * n2)
        rhs[:n2] = c1[0]
        solution = solve_spd(matrix, rhs, rtol, method)
        potential[1:-1] = solution.x.reshape(n1 - 1, n2)
        iterations, residual = solution.iterations, solution.residual
    flow1 = c1 * (potential[:-1] - potential[1:])
    drop2 = (np.roll(potential, -1, axis=1) - potential)[1:-1, : c2.shape[1]]
    rate = float((flow1 * (potential[:-1] - potential[1:])).sum() + (c2 * drop2**2).sum())
    inlet, outlet = float(flow1[0].sum()), float(flow1[-1].sum())
    imbalance = abs(inlet - outlet) / max(rate, np.finfo(float).tiny)
    if not imbalance <= MAX_IMBALANCE:
        raise NotConverged(
            f"flow: inlet and outlet differ by {imbalance:.1e} of the flow, allowed is {MAX_IMBALANCE:.0e}; "
            "try the direct solver",
            imbalance,
        )
    return NetworkFlow(rate, potential, True, iterations, residual, imbalance)

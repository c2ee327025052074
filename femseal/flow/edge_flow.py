"""Flow through a cell by the discretisation "edge": from the gap to the couples in one compiled function.

It is called for many small cells, where the steps one by one take longer than what they compute.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .assembly import edge_weights, weighted
from .coefficient import on_links
from .grid import Grid
from .solution import DarcyFlow
from .solvers.choice import ready, solve_ready

Array = NDArray[np.float64]


def edge_flow(
    gap: Array, grid: Grid, *, rtol: float = 1e-6, solver: str = "auto", field_rtol: float | None = None
) -> DarcyFlow:
    """`solve_flow` of `cell_stencil` of a gap (n1, n2), on a grid of nodes at its pixels."""
    reached, couples, exponent = _ready(gap, grid.ring2, edge_weights(grid))
    return solve_ready(reached, couples, exponent, grid.ring2, rtol=rtol, solver=solver, field_rtol=field_rtol)


@njit(cache=True, nogil=True)
def edge_couples(gap, ring2, weights):
    """Couples along and across of a gap at the pixels of a cell, with the `edge_weights` of its grid."""
    w = weights
    along, across = on_links(gap, False, ring2, True)
    weighted(along, w.rows1, w.columns1, w.kinds1, along)
    weighted(across, w.rows2, w.columns2, w.kinds2, across)
    return along, across


@njit(cache=True, nogil=True)
def _ready(gap, ring2, weights):
    """What `choice.ready` returns of the couples of a gap."""
    along, across = edge_couples(gap, ring2, weights)
    none = np.zeros((0, 0))
    return ready(along, across, none, none)

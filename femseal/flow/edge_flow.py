"""Flow through a cell on the grid of its pixels: from the gap to conductances and flow, for small cells too."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..base.arrays import Array
from ..base.compiled import compiled
from ..base.threads import over, rows
from .assembly import EdgeWeights, edge_weights, weighted
from .coefficient import links_of_rows
from .grid import Grid
from .percolation import ready
from .solution import DarcyFlow
from .solvers.choice import solve_ready
from .stencil import Stencil


def edge_flow(
    along: Array,
    across: Array,
    ring2: bool,
    *,
    rtol: float = 1e-6,
    solver: str = "auto",
    field_rtol: float | None,
) -> DarcyFlow:
    """`solve_flow` of `edge_conductances`, which are written over."""
    reached, exponent = ready(along, across)
    return solve_ready(
        reached, (along, across), exponent, ring2, rtol=rtol, solver=solver, field_rtol=field_rtol
    )


def edge_conductances(
    gap: Array, ring2: bool, weights: EdgeWeights, dtype: Any = np.float64
) -> tuple[Array, Array]:
    """Conductances along and across of a gap at the pixels of a cell, with the `edge_weights` of its grid."""
    n1, n2 = gap.shape
    along, across = np.empty((n1 + 1, n2), dtype), np.empty((n1, n2 if ring2 else n2 - 1), dtype)
    over(rows(n1, n2), _conductances, gap, ring2, *weights, along, across)
    return along, across


@compiled()
def _conductances(
    first, end, gap, ring2, rows1, columns1, kinds1, rows2, columns2, kinds2, along, across
):
    """Write `edge_conductances` of some rows, with the last one those to the outlet."""
    links_of_rows(first, end, gap, False, ring2, True, along, across)
    weighted(first, end + 1 if end == gap.shape[0] else end, along, rows1, columns1, kinds1, along)
    weighted(first, end, across, rows2, columns2, kinds2, across)


def cell_stencil(gap: Array, grid: Grid) -> Stencil:
    """Operator of the flow through a cell on a grid of nodes at its pixels, from the gap [m] (n1, n2) there."""
    along, across = edge_conductances(gap, grid.ring2, edge_weights(grid))
    return Stencil(along, across, ring2=grid.ring2)

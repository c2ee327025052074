"""How the flow through a cell is discretised: on the grid of its pixels, or on a general mesh of scikit-fem.

All of them assemble `forms.darcy_flow` (RT0: `forms.flux_resistance`). A new element is an entry of `DISCRETISATIONS`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skfem import ElementQuad2, ElementQuadRT0, ElementTriP1

from ..base.errors import InputError
from .assembly import GAUSS_POINTS, assemble_on_elements, edge_weights, gauss
from .coefficient import permeability_at_gauss_points
from .edge_flow import edge_conductances
from .grid import Grid
from .solvers.choice import check_solver
from .stencil import Stencil

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Discretisation:
    """An element and where it takes the coefficient.

    element : class of scikit-fem's element on a general mesh, None on the grid of pixels.
    degree : polynomials of this degree are integrated exactly. triangles : whether the mesh has triangles.
    """

    description: str
    element: type | None = None
    degree: int = 0
    triangles: bool = False


#: Degrees on general meshes: the cube of the gap times the square of the gradient.
DISCRETISATIONS = {
    "edge": Discretisation("Q1, cubic gap at the midpoints of edges"),
    "gauss": Discretisation("Q1, bilinear gap at 2 × 2 Gauss points"),
    "P1": Discretisation("linear triangles, linear gap", ElementTriP1, 3, triangles=True),
    "Q2": Discretisation("biquadratic quadrilaterals, bilinear gap", ElementQuad2, 8),
    "RT0": Discretisation("mixed, gap constant on each pixel", ElementQuadRT0, 2),
}


def on_grid(discretisation: str) -> bool:
    """Whether the discretisation uses the grid of pixels; otherwise it uses a general mesh."""
    return DISCRETISATIONS[discretisation].element is None


def check_discretisation(discretisation: str, solver: str, estimate: bool = False) -> None:
    """Raise InputError for an unknown discretisation or solver, or for two that do not go together."""
    if discretisation not in DISCRETISATIONS:
        raise InputError("discretisation", repr(discretisation), f"one of {', '.join(DISCRETISATIONS)}")
    check_solver(solver)
    if not on_grid(discretisation) and solver not in ("auto", "amg"):
        raise InputError("solver", f"'{solver}' of a general mesh ('{discretisation}')", "'auto' or 'amg'")
    if discretisation == "gauss" and solver == "elimination":
        raise InputError("solver", "'elimination' of nine points ('gauss')", "'auto', 'multigrid' or 'amg'")
    if estimate and not on_grid(discretisation):
        raise InputError("estimate", f"true with '{discretisation}'", "true with 'edge' or 'gauss'")


def cell_stencil(gap: Array, grid: Grid, discretisation: str = "edge") -> Stencil:
    """Operator of the flow through a cell on a grid of nodes at its pixels, from the gap [m] (n1, n2) there."""
    if discretisation == "edge":
        along, across = edge_conductances(gap, grid.ring2, edge_weights(grid))
        return Stencil(along, across, ring2=grid.ring2)
    # K11 and K22 have the same value at a point
    k = permeability_at_gauss_points(gap, grid, GAUSS_POINTS)
    return assemble_on_elements(grid, k, gauss((0, 0), (1, 1)), [p for p in range(len(k)) for _ in range(2)])

"""How the flow through a cell is discretised: on the grid of its pixels, or on a general mesh of scikit-fem.

All of them assemble `forms.darcy_flow` (RT0: `forms.flux_resistance`). A new element is an entry of `DISCRETISATIONS`.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..base.errors import InputError

#: Solvers of the flow through a grid.
SOLVERS = ("auto", "multigrid", "elimination", "amg")


@dataclass(frozen=True)
class Discretisation:
    """An element and where it takes the coefficient.

    element : name of scikit-fem's element on a general mesh; none on the grid of pixels.
    degree : polynomials of this degree are integrated exactly. triangles : whether the mesh has triangles.
    cost : time of a flow as a multiple of that of "edge", on 64² to 128² pixels; within a factor of 2 on 32² to 512².
    """

    description: str
    element: str = ""
    degree: int = 0
    triangles: bool = False
    cost: float = 1.0


#: Degrees on general meshes: the cube of the gap times the square of the gradient.
DISCRETISATIONS = {
    "edge": Discretisation("Q1, cubic gap at the midpoints of edges"),
    "gauss": Discretisation("Q1, bilinear gap at 2 × 2 Gauss points", cost=1.8),
    "P1": Discretisation("linear triangles, linear gap", "ElementTriP1", 3, triangles=True, cost=50),
    "Q2": Discretisation("biquadratic quadrilaterals, bilinear gap", "ElementQuad2", 8, cost=250),
    "RT0": Discretisation("mixed, gap constant on each pixel", "ElementQuadRT0", 2, cost=70),
}


def on_grid(discretisation: str) -> bool:
    """Whether the discretisation uses the grid of pixels; otherwise it uses a general mesh."""
    return DISCRETISATIONS[discretisation].element == ""


def check_solver(solver: str) -> None:
    """Raise InputError unless this is the name of a solver."""
    if solver not in SOLVERS:
        raise InputError("solver", repr(solver), f"one of {', '.join(SOLVERS)}")


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

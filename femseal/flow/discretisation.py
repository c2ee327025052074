"""How the flow through a cell is discretised: on the grid of its pixels, or on a general mesh of scikit-fem.

All of them assemble `forms.darcy_flow` (RT0: `forms.flux_resistance`). A new element is an entry of `DISCRETISATIONS`.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from skfem import Basis, ElementQuad1, ElementQuad2, ElementQuadRT0, ElementTriP1, Mesh, MeshQuad, MeshTri
from skfem.mesh import MeshQuad1DG, MeshTri1DG

from ..base.errors import InputError
from .assembly import GAUSS_POINTS, assemble_on_elements, assemble_on_links, gauss
from .coefficient import cubic_law, permeability_at_gauss_points, permeability_on_links
from .grid import Grid
from .mesh import conforming_flow
from .mixed import flux_conductance
from .reach import elements_reached
from .solution import DarcyFlow
from .solvers.choice import check_solver
from .stencil import Stencil

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Discretisation:
    """An element and where it takes the coefficient.

    element : of scikit-fem on a general mesh, None on the grid. degree : that its quadrature integrates exactly.
    triangles : the mesh is one of triangles.
    """

    description: str
    element: type | None = None
    degree: int = 0
    triangles: bool = False


# scikit-fem warns that it copies vertices whenever it makes a mesh of more than 1000 vertices periodic
logging.getLogger("skfem.mesh.mesh").addFilter(lambda record: "C_CONTIGUOUS" not in record.getMessage())
#: Degrees on general meshes: the cube of the gap times the square of the gradient.
DISCRETISATIONS = {
    "edge": Discretisation("Q1, cubic gap at the midpoints of edges"),
    "gauss": Discretisation("Q1, bilinear gap at 2 × 2 Gauss points"),
    "P1": Discretisation("linear triangles, linear gap", ElementTriP1, 3, triangles=True),
    "Q2": Discretisation("biquadratic quadrilaterals, bilinear gap", ElementQuad2, 8),
    "RT0": Discretisation("mixed, gap constant on each pixel", ElementQuadRT0, 2),
}


def on_grid(discretisation: str) -> bool:
    """Whether the discretisation is one of the pixels' grid, or else of a general mesh."""
    return DISCRETISATIONS[discretisation].element is None


def check_discretisation(discretisation: str, solver: str, estimate: bool = False) -> None:
    """Raise InputError for a discretisation or solver that does not exist, or that does not go with the other."""
    if discretisation not in DISCRETISATIONS:
        raise InputError.of("discretisation", repr(discretisation), f"one of {', '.join(DISCRETISATIONS)}")
    check_solver(solver)
    if not on_grid(discretisation) and solver not in ("auto", "amg"):
        raise InputError.of("solver", f"'{solver}' of a general mesh ('{discretisation}')", "'auto' or 'amg'")
    if discretisation == "gauss" and solver == "elimination":
        raise InputError.of("solver", "'elimination' of nine points ('gauss')", "'auto', 'multigrid' or 'amg'")
    if estimate and not on_grid(discretisation):
        raise InputError.of("estimate", f"true with '{discretisation}'", "true with 'edge' or 'gauss'")


def cell_stencil(gap: Array, grid: Grid, discretisation: str = "edge") -> Stencil:
    """Operator of the flow through a cell on a grid of nodes at its pixels, from the gap [m] (n1, n2) there."""
    if discretisation == "edge":
        k1, k2 = permeability_on_links(gap, False, grid.ring2)
        return assemble_on_links(grid, k1, k2, overwrite=True)
    # both K11 and K22 take the value of their point
    k = permeability_at_gauss_points(gap, grid, GAUSS_POINTS)
    return assemble_on_elements(grid, k, gauss((0, 0), (1, 1)), [p for p in range(len(k)) for _ in range(2)])


def mesh_flow(
    gap: Array, spacing: tuple[float, float], sides: str, discretisation: str, *, rtol: float, solver: str = "auto"
) -> DarcyFlow:
    """Flow along x1 through a cell on a general mesh, its potential at the pixels (n1, n2).

    Raises
    ------
    InputError : fewer than 3 columns of pixels in a ring.
    NotConverged : the linear solver failed.
    """
    if sides == "periodic" and gap.shape[1] < 3:
        raise InputError.of("gap", f"{gap.shape[1]} columns", f"at least 3 with periodic sides and '{discretisation}'")
    kind = DISCRETISATIONS[discretisation]
    assert kind.element is not None
    if discretisation == "RT0":
        return _mixed(gap, spacing, sides, kind, rtol, solver)
    grid = Grid.of_pixel_centres(gap.shape, spacing, sides)
    plain, mesh, vertex = _meshes(grid.lines1, grid.lines2, sides, kind.triangles)
    row, column = (np.searchsorted(lines, x) for lines, x in zip((grid.lines1, grid.lines2), plain.p, strict=True))
    pixel = np.clip(row - 1, 0, gap.shape[0] - 1), grid.columns[column]
    at_vertex = np.zeros(mesh.nvertices)
    at_vertex[vertex] = gap[pixel]
    ends = _facets_of(mesh, vertex[row == 0]), _facets_of(mesh, vertex[row == grid.elements[0]])
    isotropic = at_vertex[mesh.t].max(axis=0)[:, None, None] * np.eye(2)
    carrying, at_inlet, at_outlet = elements_reached(mesh, isotropic, ends, through_corners=True)
    potential = np.full(mesh.nvertices, np.nan)
    potential[mesh.t[:, at_inlet]], potential[mesh.t[:, at_outlet]] = 1.0, 0.0
    flow = DarcyFlow(0.0, potential, potential, False)
    if carrying.size:
        basis, gaps = (Basis(mesh, element(), intorder=kind.degree, elements=carrying)
                       for element in (kind.element, ElementTriP1 if kind.triangles else ElementQuad1))  # fmt: skip
        k = cubic_law(np.asarray(gaps.interpolate(at_vertex))) * np.eye(2)[:, :, None, None]
        flow = conforming_flow(basis, k, ends, rtol=rtol, solver=solver)
        solved = np.unique(mesh.t[:, carrying])
        potential[solved] = flow.potential[basis.nodal_dofs[0, solved]]
    at_centre = (row > 0) & (row < grid.elements[0]) & ((column > 0) & (column < grid.elements[1]) | grid.ring2)
    at_pixels = np.empty(gap.shape)
    at_pixels[pixel[0][at_centre], pixel[1][at_centre]] = potential[vertex[at_centre]]
    at_pixels[gap == 0] = np.nan
    return replace(flow, potential=at_pixels, complement=1 - at_pixels)


def _mixed(
    gap: Array, spacing: tuple[float, float], sides: str, kind: Discretisation, rtol: float, solver: str
) -> DarcyFlow:
    """Lowest-order Raviart-Thomas flux on the pixels; its conductance is a lower bound for their gap."""
    lines1, lines2 = (np.arange(n + 1) * d for n, d in zip(gap.shape, spacing, strict=True))
    plain, mesh, vertex = _meshes(lines1, lines2, sides, triangles=False)
    middle = plain.p[:, plain.t].mean(axis=1)
    pixel = tuple((x / d).astype(int) for x, d in zip(middle, spacing, strict=True))
    tensor = cubic_law(gap[pixel])[:, None, None] * np.eye(2)
    ends = tuple(_facets_of(mesh, vertex[plain.p[0] == end]) for end in (lines1[0], lines1[-1]))
    flow = flux_conductance(mesh, tensor, (ends[0], ends[1]), ElementQuadRT0(), kind.degree, rtol=rtol, solver=solver)
    at_pixels = np.empty(gap.shape)
    at_pixels[pixel] = flow.potential
    return replace(flow, potential=at_pixels, complement=1 - at_pixels)


def _meshes(lines1: Array, lines2: Array, sides: str, triangles: bool) -> tuple[Mesh, Mesh, Indices]:
    """A mesh between lines, the same with periodic sides joined, and where each vertex of the first is in that."""
    plain = MeshQuad.init_tensor(lines1, lines2)
    if triangles:
        halves = np.hstack([plain.t[[0, 1, 3]], plain.t[[1, 2, 3]]])
        plain = MeshTri(plain.p, np.ascontiguousarray(halves))
    if sides != "periodic":
        return plain, plain, np.arange(plain.nvertices)
    last, first = (np.flatnonzero(plain.p[1] == end) for end in (lines2[-1], lines2[0]))
    ring = (MeshTri1DG if triangles else MeshQuad1DG).periodic(plain, last, first)
    vertex = np.empty(plain.nvertices, np.int64)
    vertex[plain.t] = ring.t
    return plain, ring, vertex


def _facets_of(mesh: Mesh, vertices: Indices) -> Indices:
    """Boundary facets between these vertices."""
    facets = mesh.boundary_facets()
    return facets[np.isin(mesh.facets[:, facets], vertices).all(axis=0)]

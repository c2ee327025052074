"""Flow through a cell on a general mesh of scikit-fem, for any of its elements.

The vertices of conforming elements lie at the centres of the pixels and on the sides of the cell, the elements of the
mixed method are the pixels. On a ring the mesh itself is periodic.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import skfem
from skfem import Basis, ElementQuad1, ElementQuadRT0, ElementTriP1, Mesh, MeshQuad, MeshTri
from skfem.mesh import MeshQuad1DG, MeshTri1DG

from ..base import Array, Indices, InputError, NotConverged, counted
from .connected_elements import connected_elements
from .discretisation import DISCRETISATIONS, Discretisation
from .grid import Grid
from .law import cubic_law
from .mesh import conforming_flow
from .mixed import flux_conductance
from .solution import MAX_IMBALANCE, DarcyFlow

# scikit-fem warns that it copies vertices whenever it makes a mesh of more than 1000 vertices periodic
logging.getLogger("skfem.mesh.mesh").addFilter(lambda record: "C_CONTIGUOUS" not in record.getMessage())


def mesh_flow(
    gap: Array, spacing: tuple[float, float], sides: str, discretisation: str, *, rtol: float, solver: str = "auto"
) -> DarcyFlow:
    """Flow along x1 through a cell on a general mesh, its potential at the pixels (n1, n2).

    Raises InputError: fewer than 3 columns of pixels in a ring.
    NotConverged : the linear solver failed, or the contrast of the gap is too high for mixed elements.
    """
    if sides == "periodic" and gap.shape[1] < 3:
        raise InputError(
            "gap", counted(gap.shape[1], "column"), f"at least 3 with periodic sides and '{discretisation}'"
        )
    kind = DISCRETISATIONS[discretisation]
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
    carrying, at_inlet, at_outlet = connected_elements(mesh, isotropic, ends, through_corners=True)
    potential = np.full(mesh.nvertices, np.nan)
    potential[mesh.t[:, at_inlet]], potential[mesh.t[:, at_outlet]] = 1.0, 0.0
    flow = DarcyFlow(0.0, potential, potential, False)
    if carrying.size:
        own = getattr(skfem, kind.element)
        basis, gaps = (Basis(mesh, element(), intorder=kind.degree, elements=carrying)
                       for element in (own, ElementTriP1 if kind.triangles else ElementQuad1))  # fmt: skip
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
    if not flow.imbalance <= max(MAX_IMBALANCE, rtol):
        raise NotConverged(
            f"flow: the energies of flux and pressure of mixed elements differ by {flow.imbalance:.1e} of the flow; "
            "the contrast of the gap is too high for them: try the discretisation 'edge'",
            flow.imbalance,
        )
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

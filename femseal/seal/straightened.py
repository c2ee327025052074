"""Meshes of the second order as straight ones."""

from __future__ import annotations

import numpy as np
from skfem import Mesh, MeshQuad1, MeshQuad2, MeshTri1, MeshTri2

from ..base import Indices

#: Places, in a second-order element, of the corners of the four straight ones that fill it.
_PARTS = {
    MeshTri2: (MeshTri1, ((0, 3, 5), (1, 4, 3), (2, 5, 4), (3, 4, 5))),
    MeshQuad2: (MeshQuad1, ((0, 4, 8, 7), (1, 5, 8, 4), (2, 6, 8, 5), (3, 7, 8, 6))),
}


def straightened(mesh: Mesh, *ends: Indices) -> tuple[Mesh, tuple[Indices, ...]]:
    """The mesh with four straight elements in place of each of the second order, and its boundary facets."""
    if type(mesh) not in _PARTS:
        return mesh, ends
    kind, parts = _PARTS[type(mesh)]
    nodes = mesh.dofs.element_dofs
    straight = kind(mesh.doflocs, np.ascontiguousarray(np.hstack([nodes[list(part)] for part in parts])))
    boundary = straight.boundary_facets()
    found = []
    for facets in ends:
        middles = mesh.dofs.facet_dofs[0, facets]
        found.append(boundary[np.isin(straight.facets[:, boundary], middles).any(axis=0)])
    return straight, tuple(found)

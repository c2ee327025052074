"""Which elements of a mesh carry flow from one boundary to another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from skfem import Mesh

from ..base.arrays import Array, Indices


def open_facets(mesh: Mesh, facets: Indices, elements: Indices) -> Indices:
    """Boundary facets that belong to these elements."""
    return facets[np.isin(mesh.f2t[0, facets], elements)]


@dataclass(frozen=True, eq=False)
class Connected:
    """What open elements connect.

    between : elements connected to two or more boundaries. alone : those connected to each boundary only.
    joined : whether each boundary is connected to another one (boundaries,).
    """

    between: Indices
    alone: list[Indices]
    joined: NDArray[np.bool_]


def connected_elements(
    mesh: Mesh, tensor: Array, ends: Sequence[Indices], *, through_corners: bool
) -> Connected:
    """What the elements connect, each through a facet that both can carry flow across, n·Kn > 0.

    With `through_corners` also through a vertex, if both are open in every direction.
    """
    label, of_ends = _labels(mesh, tensor, ends, through_corners)
    joined = np.array([np.count_nonzero(of_ends == own) > 1 for own in of_ends])
    alone = [
        np.flatnonzero((label == own) & ~more) for own, more in zip(of_ends, joined, strict=True)
    ]
    return Connected(np.flatnonzero(np.isin(label, of_ends[joined])), alone, joined)


def _labels(
    mesh: Mesh, tensor: Array, ends: Sequence[Indices], through_corners: bool
) -> tuple[Indices, Indices]:
    """Numbers of the connected parts to which the elements and the ends belong."""
    full, across = _open_ways(mesh, tensor)
    slot, element = np.nonzero(across)
    facet = mesh.t2f[slot, element]
    # one graph of elements, facets, vertices and the ends
    ne, nf = mesh.nelements, mesh.nfacets
    first = ne + nf + mesh.nvertices
    start, end = [element], [ne + facet]
    if through_corners:
        open_ = np.flatnonzero(full)
        start.append(np.tile(open_, mesh.t.shape[0]))
        end.append(ne + nf + mesh.t[:, open_].ravel())
    for node, facets in enumerate(ends, first):
        start.append(ne + facets)
        end.append(np.full(facets.size, node))
    i, j = np.concatenate(start), np.concatenate(end)
    size = first + len(ends)
    graph = sp.coo_array((np.ones(i.size), (i, j)), shape=(size, size))
    _, label = connected_components(graph, directed=False)
    return label[:ne], label[first:]


def _open_ways(mesh: Mesh, tensor: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Elements open in every direction, and which facets (facets of an element, elements) they carry flow across."""
    if not np.any(tensor[:, 0, 1]) and np.array_equal(tensor[:, 0, 0], tensor[:, 1, 1]):
        full = tensor[:, 0, 0] > 0
        return full, np.broadcast_to(full, mesh.t2f.shape)
    values = np.linalg.eigvalsh(tensor)
    # normals of the chords of each element: vertices of periodic meshes have no single place
    corners = mesh.mapping().F(mesh.refdom.p)
    chord = np.stack(
        [corners[:, :, end] - corners[:, :, start] for start, end in mesh.refdom.facets], axis=1
    )
    n = np.array([chord[1], -chord[0]]) / np.linalg.norm(chord, axis=0)
    across = np.einsum("ife,eij,jfe->fe", n, tensor, n) > 1e-12 * values[:, 1]
    return values[:, 0] > 1e-14 * values[:, 1], across

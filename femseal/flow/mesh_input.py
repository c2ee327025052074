"""Check the permeability and the ends of a mesh, and find the elements that carry flow between its ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components
from skfem import Mesh

from ..base import Array, Flags, Indices, InputError
from .law import checked_permeability

#: If a tensor is closed along one principal axis, its principal value there is replaced by this fraction of the other
#: principal value, so that K⁻¹ exists.
CLOSED_AXIS = 1e-10
#: A tensor counts as closed along an axis if its principal value there is at most this fraction of the other one.
_CLOSED = 1e-12


def permeability_tensors(permeability: ArrayLike, elements: int) -> Array:
    """Check a permeability, and convert it to positive semidefinite tensors (elements, 2, 2).

    permeability : a number, or an array (n,), (n, 2) of principal values along x and y, or (n, 2, 2) of tensors, for n
        elements.

    Raises
    ------
    InputError : the permeability has another shape, is negative or undefined, or is not symmetric.
    """
    n = elements
    k = checked_permeability("permeability", permeability, (n,), (n, 2), (n, 2, 2))
    if k.ndim < 3:
        principal = np.broadcast_to(k if k.ndim == 2 else k.reshape(-1, 1), (n, 2))
        return principal[:, :, None] * np.eye(2)
    size = np.abs(k).max(axis=(1, 2))
    skew = np.abs(k[:, 0, 1] - k[:, 1, 0]) > 1e-9 * size
    k = (k + k.transpose(0, 2, 1)) / 2
    negative = principal_values(k)[0] < -1e-12 * size
    for bad, is_so, expected in (
        (skew, "a tensor that is not symmetric", "symmetric tensors"),
        (negative, "a negative principal value", "principal values >= 0 [m³]"),
    ):
        if bad.any():
            raise InputError("permeability", f"{is_so} in element {bad.argmax()}", expected)
    return k


def principal_values(tensor: Array) -> tuple[Array, Array]:
    """Compute the smaller and the larger principal value of symmetric tensors (n, 2, 2)."""
    a = tensor[:, 0, 0]
    b = tensor[:, 1, 1]
    c = tensor[:, 0, 1]
    mean = (a + b) / 2
    radius = np.hypot((a - b) / 2, c)
    return mean - radius, mean + radius


def is_connected(mesh: Mesh, inlet: ArrayLike, outlet: ArrayLike) -> bool:
    """Return whether a mesh whose elements are all open connects inlet and outlet.

    Raises
    ------
    InputError : see `ends_of`.
    """
    unit = np.broadcast_to(np.eye(2), (mesh.nelements, 2, 2))
    ends = ends_of(mesh, inlet, outlet)
    connected = connected_elements(mesh, unit, ends, through_corners=True)
    return bool(connected.joined.all())


def ends_of(mesh: Mesh, inlet: ArrayLike, outlet: ArrayLike) -> tuple[Indices, Indices]:
    """Check the facets of inlet and outlet, and return them without duplicates.

    Raises
    ------
    InputError : an end has no facets or facets inside the mesh, or inlet and outlet have a vertex in common.
    """
    ends = _facets(mesh, inlet, "inlet"), _facets(mesh, outlet, "outlet")
    if np.intersect1d(mesh.facets[:, ends[0]], mesh.facets[:, ends[1]]).size:
        raise InputError(
            "inlet and outlet", "boundaries that touch", "boundaries with no vertex in common"
        )
    return ends


def _facets(mesh: Mesh, facets: ArrayLike, name: str) -> Indices:
    """Check the facets of one end."""
    chosen = np.unique(np.asarray(facets).astype(np.int64))
    if chosen.size == 0:
        raise InputError(name, "no facets", "at least one facet of the boundary")
    if not np.all(np.isin(chosen, mesh.boundary_facets())):
        raise InputError(name, "facets inside the mesh", "facets of its boundary")
    return chosen


def invertible(tensor: Array) -> Array:
    """Make tensors (n, 2, 2) that are closed along one principal axis invertible.

    Their smaller principal value, which is about 0, is replaced by `CLOSED_AXIS` times the larger one.
    """
    smaller, larger = principal_values(tensor)
    half_closed = np.flatnonzero((smaller <= _CLOSED * larger) & (larger > 0))
    if not half_closed.size:
        return tensor
    k = tensor[half_closed]
    least = smaller[half_closed, None, None]
    most = larger[half_closed, None, None]
    # (most I − k)/(most − least) is the projection on the principal axis of the smaller value
    change = (CLOSED_AXIS * most - least) / (most - least) * (most * np.eye(2) - k)
    invertible_tensor = tensor.copy()
    invertible_tensor[half_closed] += change
    return invertible_tensor


def open_facets(mesh: Mesh, facets: Indices, elements: Indices) -> Indices:
    """Return those boundary facets that belong to one of the elements."""
    return facets[np.isin(mesh.f2t[0, facets], elements)]


@dataclass(frozen=True, eq=False)
class Connected:
    """Elements that are connected to the boundaries of a mesh through open elements.

    Attributes
    ----------
    between : elements that are connected to two or more boundaries and can carry flow.
    alone : for each boundary, the elements that are connected to no other boundary.
    joined : array (boundaries,), whether each boundary is connected to another one.
    """

    between: Indices
    alone: list[Indices]
    joined: Flags


def connected_elements(
    mesh: Mesh, tensor: Array, ends: Sequence[Indices], *, through_corners: bool
) -> Connected:
    """Find the elements that are connected to the boundaries `ends`.

    Two elements are connected if they share a facet with the normal n across which both can carry flow, n·Kn > 0. With
    `through_corners` two elements are also connected through a common vertex, if they are open in all directions.
    """
    across = _open_facets_of_elements(mesh, tensor)
    slot, element = np.nonzero(across)
    # The nodes of the graph are elements, facets, vertices and boundaries, numbered in this order. An element is linked
    # to its open facets and vertices, and a boundary to its facets.
    ne, nf = mesh.nelements, mesh.nfacets
    first = ne + nf + mesh.nvertices  # node of the first boundary
    start = [element]
    end = [ne + mesh.t2f[slot, element]]
    if through_corners:
        least, most = principal_values(tensor)
        is_open = np.flatnonzero(least > _CLOSED * most)
        start.append(np.tile(is_open, len(mesh.t)))
        end.append(ne + nf + mesh.t[:, is_open].ravel())
    for node, facets in enumerate(ends, first):
        start.append(ne + facets)
        end.append(np.full(facets.size, node))
    i, j = np.concatenate(start), np.concatenate(end)
    size = first + len(ends)
    graph = sp.coo_array((np.ones(i.size), (i, j)), shape=(size, size))
    label = connected_components(graph, directed=False)[1]
    element_label = label[:ne]
    end_label = label[first:]
    joined = np.array([np.count_nonzero(end_label == component) > 1 for component in end_label])
    alone = [
        np.flatnonzero((element_label == component) & ~is_joined)
        for component, is_joined in zip(end_label, joined, strict=True)
    ]
    between = np.flatnonzero(np.isin(element_label, end_label[joined]))
    return Connected(between, alone, joined)


def _open_facets_of_elements(mesh: Mesh, tensor: Array) -> Flags:
    """Return whether each element can carry flow across each of its facets, array (facets of an element, elements)."""
    least, most = principal_values(tensor)
    if (least > _CLOSED * most).all():
        return np.ones(mesh.t2f.shape, bool)
    # Corners are mapped element by element, because a vertex of a periodic mesh has more than one position. The normal
    # of a curved facet is the normal of its chord.
    corners = mesh.mapping().F(mesh.refdom.p)  # (axis, element, corner)
    start, end = np.transpose(mesh.refdom.facets)
    chord = corners[:, :, end] - corners[:, :, start]
    n = np.array([chord[1], -chord[0]]) / np.linalg.norm(chord, axis=0)
    return np.asarray(np.einsum("ief,eij,jef->fe", n, tensor, n) > _CLOSED * most)

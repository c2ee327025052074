"""Check the permeability, the inlet and the outlet of a mesh, and find the elements that can carry flow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components
from skfem import Mesh

from ..base import Array, Flags, Indices, InputError
from .problem import checked_permeability

#: If one principal value of a tensor is 0, it is replaced by this fraction of the other principal value, so that K⁻¹
#: exists.
CLOSED_AXIS = 1e-10
#: A principal value of a tensor counts as 0 if it is at most this fraction of the other principal value.
_CLOSED = 1e-12


def permeability_tensors(permeability: ArrayLike, elements: int) -> Array:
    """Check a permeability, and convert it to positive semidefinite tensors (elements, 2, 2).

    permeability : a number, or an array for n elements: numbers (n,), principal values along x and y (n, 2), or tensors
        (n, 2, 2).

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
    is_skew = np.abs(k[:, 0, 1] - k[:, 1, 0]) > 1e-9 * size
    if is_skew.any():
        given = f"a tensor that is not symmetric in element {is_skew.argmax()}"
        raise InputError("permeability", given, "symmetric tensors")
    k = (k + k.transpose(0, 2, 1)) / 2
    smaller, _ = principal_values(k)
    is_negative = smaller < -1e-12 * size
    if is_negative.any():
        given = f"a negative principal value in element {is_negative.argmax()}"
        raise InputError("permeability", given, "tensors with principal values >= 0 [m³]")
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
    """Return whether inlet and outlet of a mesh are connected if all elements are open.

    Raises
    ------
    InputError : see `ends_of`.
    """
    open_everywhere = np.broadcast_to(np.eye(2), (mesh.nelements, 2, 2))
    ends = ends_of(mesh, inlet, outlet)
    connected = connected_elements(mesh, open_everywhere, ends, through_corners=True)
    return bool(connected.is_joined.all())


def ends_of(mesh: Mesh, inlet: ArrayLike, outlet: ArrayLike) -> tuple[Indices, Indices]:
    """Check the facets of inlet and outlet, and return them without duplicates.

    Raises
    ------
    InputError : the inlet or the outlet has no facets, facets inside the mesh, or numbers of facets that are not
        integers; or inlet and outlet have a vertex in common.
    """
    ends = _facets(mesh, inlet, "inlet"), _facets(mesh, outlet, "outlet")
    if np.intersect1d(mesh.facets[:, ends[0]], mesh.facets[:, ends[1]]).size:
        raise InputError(
            "inlet and outlet", "boundaries that touch", "boundaries with no vertex in common"
        )
    return ends


def _facets(mesh: Mesh, facets: ArrayLike, name: str) -> Indices:
    """Check the facets of the inlet or the outlet, and return them without duplicates.

    facets : numbers of facets, or a flag for each facet of the mesh.
    """
    given = np.asarray(facets)
    if given.dtype == bool and given.shape == (mesh.nfacets,):
        given = np.flatnonzero(given)
    if given.size == 0:
        raise InputError(name, "no facets", "at least one facet of the boundary")
    if not np.issubdtype(given.dtype, np.integer):
        expected = f"numbers of facets, which are integers, or flags of shape ({mesh.nfacets},)"
        raise InputError(name, f"an array of {given.dtype}, shape {given.shape}", expected)
    chosen = np.unique(given.astype(np.int64))
    if not np.all(np.isin(chosen, mesh.boundary_facets())):
        raise InputError(name, "facets inside the mesh", "facets of its boundary")
    return chosen


def invertible(tensor: Array) -> Array:
    """Make tensors (n, 2, 2) invertible if one of their two principal values is about 0.

    If the smaller principal value of a tensor is about 0, it is replaced by `CLOSED_AXIS` times the larger principal
    value.
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
    """Select the boundary facets that belong to one of the given elements."""
    return facets[np.isin(mesh.f2t[0, facets], elements)]


@dataclass(frozen=True, eq=False)
class Connected:
    """Elements of a mesh, sorted by the boundaries to which they are connected through open elements.

    Attributes
    ----------
    carrying : numbers of the elements that are connected to two or more boundaries and can carry flow.
    at_one_boundary : for each boundary, the numbers of the elements that are connected to this boundary only.
    is_joined : flags (boundaries,), whether open elements connect each boundary to another boundary.
    """

    carrying: Indices
    at_one_boundary: list[Indices]
    is_joined: Flags


def connected_elements(
    mesh: Mesh, tensor: Array, ends: Sequence[Indices], *, through_corners: bool
) -> Connected:
    """Find the elements that are connected to each of the boundaries in `ends`.

    Two elements are connected if they share a facet and both can carry flow across it, that is, n·Kn > 0 for the normal
    n of the facet. With `through_corners`, two elements that are open in all directions are also connected if they
    share only a vertex.
    """
    # The nodes of the graph are elements, facets, vertices and boundaries, numbered in this order.
    first_facet = mesh.nelements
    first_vertex = first_facet + mesh.nfacets
    first_boundary = first_vertex + mesh.nvertices
    # links from each element to its open facets
    local_facet, element = np.nonzero(_open_facets_of_elements(mesh, tensor))
    start = [element]
    end = [first_facet + mesh.t2f[local_facet, element]]
    if through_corners:
        # links from each element that is open in all directions to its vertices
        smaller, larger = principal_values(tensor)
        open_elements = np.flatnonzero(smaller > _CLOSED * larger)
        start.append(np.tile(open_elements, len(mesh.t)))
        end.append(first_vertex + mesh.t[:, open_elements].ravel())
    # links from the facets of each boundary to the boundary
    for boundary, facets in enumerate(ends, first_boundary):
        start.append(first_facet + facets)
        end.append(np.full(facets.size, boundary))
    i, j = np.concatenate(start), np.concatenate(end)
    size = first_boundary + len(ends)
    graph = sp.coo_array((np.ones(i.size), (i, j)), shape=(size, size))
    _, label = connected_components(graph, directed=False)

    element_label = label[: mesh.nelements]
    boundary_label = label[first_boundary:]
    is_joined = np.array(
        [np.count_nonzero(boundary_label == component) > 1 for component in boundary_label]
    )
    at_one_boundary = [
        np.flatnonzero((element_label == component) & ~joined)
        for component, joined in zip(boundary_label, is_joined, strict=True)
    ]
    carrying = np.flatnonzero(np.isin(element_label, boundary_label[is_joined]))
    return Connected(carrying, at_one_boundary, is_joined)


def _open_facets_of_elements(mesh: Mesh, tensor: Array) -> Flags:
    """Find the facets across which each element can carry flow, flags (facets of an element, elements)."""
    least, most = principal_values(tensor)
    if (least > _CLOSED * most).all():
        return np.ones(mesh.t2f.shape, bool)
    # Corners are mapped element by element, because a vertex of a periodic mesh has more than one position. The normal
    # of a curved facet is the normal of its chord.
    corners = mesh.mapping().F(mesh.refdom.p)  # (axis, element, corner)
    start, end = np.transpose(mesh.refdom.facets)  # corners at both ends of each facet
    chord = corners[:, :, end] - corners[:, :, start]  # (axis, element, facet)
    n = np.array([chord[1], -chord[0]]) / np.linalg.norm(chord, axis=0)
    return np.asarray(np.einsum("ief,eij,jef->fe", n, tensor, n) > _CLOSED * most)

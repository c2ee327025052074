"""Checks of the permeability and the ends of a mesh, and the elements that carry flow between its ends."""

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

#: A tensor closed along one principal axis keeps this fraction of its other value there, so that K⁻¹ exists.
CLOSED_AXIS = 1e-10
#: It is closed along an axis whose principal value is no larger than this fraction of the other.
_CLOSED = 1e-12


def permeability_tensors(permeability: ArrayLike, elements: int) -> Array:
    """Return positive semidefinite tensors (elements, 2, 2) of a permeability of any shape, or an InputError."""
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
    """Return the smaller and the larger principal value of symmetric tensors (n, 2, 2)."""
    a, b, c = tensor[:, 0, 0], tensor[:, 1, 1], tensor[:, 0, 1]
    mean = (a + b) / 2
    radius = np.hypot((a - b) / 2, c)
    return mean - radius, mean + radius


def is_connected(mesh: Mesh, inlet: ArrayLike, outlet: ArrayLike) -> bool:
    """Return whether a mesh of open elements joins inlet and outlet; InputError if these cannot be ends."""
    unit = np.broadcast_to(np.eye(2), (mesh.nelements, 2, 2))
    return bool(
        connected_elements(
            mesh, unit, ends_of(mesh, inlet, outlet), through_corners=True
        ).joined.all()
    )


def ends_of(mesh: Mesh, inlet: ArrayLike, outlet: ArrayLike) -> tuple[Indices, Indices]:
    """Return the boundary facets of inlet and outlet, or raise an InputError."""
    ends = _facets(mesh, inlet, "inlet"), _facets(mesh, outlet, "outlet")
    if np.intersect1d(mesh.facets[:, ends[0]], mesh.facets[:, ends[1]]).size:
        raise InputError(
            "inlet and outlet", "boundaries that touch", "boundaries with no vertex in common"
        )
    return ends


def _facets(mesh: Mesh, facets: ArrayLike, name: str) -> Indices:
    chosen = np.unique(np.asarray(facets).astype(np.int64))
    if chosen.size == 0:
        raise InputError(name, "no facets", "at least one facet of the boundary")
    if not np.all(np.isin(chosen, mesh.boundary_facets())):
        raise InputError(name, "facets inside the mesh", "facets of its boundary")
    return chosen


def invertible(tensor: Array) -> Array:
    """Return tensors whose smaller principal value is `CLOSED_AXIS` times the larger one where it was 0."""
    least, most = principal_values(tensor)
    half = np.flatnonzero((least <= _CLOSED * most) & (most > 0))
    if not half.size:
        return tensor
    k, least, most = (a[half] for a in (tensor, least[:, None, None], most[:, None, None]))
    invertible_tensor = tensor.copy()
    invertible_tensor[half] += (
        (CLOSED_AXIS * most - least) / (most - least) * (most * np.eye(2) - k)
    )
    return invertible_tensor


def open_facets(mesh: Mesh, facets: Indices, elements: Indices) -> Indices:
    """Return the boundary facets that belong to these elements."""
    return facets[np.isin(mesh.f2t[0, facets], elements)]


@dataclass(frozen=True, eq=False)
class Connected:
    """What open elements connect.

    between : elements connected to two or more boundaries. alone : those connected to each boundary only.
    joined : whether each boundary is connected to another one (boundaries,).
    """

    between: Indices
    alone: list[Indices]
    joined: Flags


def connected_elements(
    mesh: Mesh, tensor: Array, ends: Sequence[Indices], *, through_corners: bool
) -> Connected:
    """What the elements connect, each through a facet that both can carry flow across, n·Kn > 0.

    With `through_corners` also through a vertex, if both are open in every direction.
    """
    across = _open_ways(mesh, tensor)
    slot, element = np.nonzero(across)
    # one graph of elements, facets, vertices and the ends
    ne, nf = mesh.nelements, mesh.nfacets
    first = ne + nf + mesh.nvertices
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
    label, of_ends = label[:ne], label[first:]
    joined = np.array([np.count_nonzero(of_ends == own) > 1 for own in of_ends])
    alone = [
        np.flatnonzero((label == own) & ~more) for own, more in zip(of_ends, joined, strict=True)
    ]
    return Connected(np.flatnonzero(np.isin(label, of_ends[joined])), alone, joined)


def _open_ways(mesh: Mesh, tensor: Array) -> Flags:
    """Which facets (facets of an element, elements) the elements carry flow across."""
    least, most = principal_values(tensor)
    if (least > _CLOSED * most).all():
        return np.ones(mesh.t2f.shape, bool)
    # normals of the chords of each element: vertices of periodic meshes have no single place
    corners = mesh.mapping().F(mesh.refdom.p)
    start, end = np.transpose(mesh.refdom.facets)
    chord = corners[:, :, end] - corners[:, :, start]
    n = np.array([chord[1], -chord[0]]) / np.linalg.norm(chord, axis=0)
    return np.asarray(np.einsum("ief,eij,jef->fe", n, tensor, n) > _CLOSED * most)

"""Permeability and ends of a mesh, checked, and which of its elements carry flow from one boundary to another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.csgraph import connected_components
from skfem import Mesh

from ..base import Array, Indices, InputError, counted, shown

#: A tensor closed along one principal axis keeps this fraction of its other value there, so that K⁻¹ exists.
CLOSED_AXIS = 1e-10
#: Ratio of the smallest principal value to the largest from which on all elements count as open.
_OPEN = 1e-12


def checked(name: str, permeability: ArrayLike, *shapes: tuple[int, ...]) -> Array:
    """Permeability as a finite number, or numbers of one of the shapes, >= 0 but for tensors; else InputError."""
    try:
        k = np.asarray(permeability, dtype=float)
    except (TypeError, ValueError):
        raise InputError(name, shown(permeability), "numbers [m³]") from None
    if k.shape not in ((), *shapes):
        allowed = f"a number or shape {' or '.join(map(str, shapes))}"
        raise InputError(name, f"shape {k.shape}", allowed)
    if undefined := np.count_nonzero(~np.isfinite(k)):
        raise InputError(name, f"{counted(undefined, 'value')} not finite", "numbers >= 0 [m³]")
    if k.ndim < 3 and k.min(initial=0.0) < 0:
        raise InputError(name, f"{k.min():g}", "numbers >= 0 [m³]")
    return k


def permeability_tensors(permeability: ArrayLike, elements: int) -> Array:
    """K as (elements, 2, 2) positive semidefinite tensors, from any allowed shape; or an InputError."""
    n = elements
    k = checked("permeability", permeability, (n,), (n, 2), (n, 2, 2))
    if k.ndim < 3:
        principal = np.broadcast_to(k if k.ndim == 2 else k.reshape(-1, 1), (n, 2))
        return principal[:, :, None] * np.eye(2)
    size = np.abs(k).max(axis=(1, 2))
    skew = np.flatnonzero(np.abs(k[:, 0, 1] - k[:, 1, 0]) > 1e-9 * size)
    if skew.size:
        raise InputError(
            "permeability",
            f"a tensor that is not symmetric in element {skew[0]}",
            "symmetric tensors",
        )
    k = (k + k.transpose(0, 2, 1)) / 2
    negative = np.flatnonzero(np.linalg.eigvalsh(k)[:, 0] < -1e-12 * size)
    if negative.size:
        raise InputError(
            "permeability",
            f"a negative principal value in element {negative[0]}",
            "principal values >= 0 [m³]",
        )
    return k


def is_connected(mesh: Mesh, inlet: ArrayLike, outlet: ArrayLike) -> bool:
    """Whether the mesh itself, all of it open, joins inlet and outlet; InputError if these cannot be ends."""
    unit = np.broadcast_to(np.eye(2), (mesh.nelements, 2, 2))
    return bool(
        connected_elements(
            mesh, unit, ends_of(mesh, inlet, outlet), through_corners=True
        ).joined.all()
    )


def ends_of(mesh: Mesh, inlet: ArrayLike, outlet: ArrayLike) -> tuple[Indices, Indices]:
    """Boundary facets of inlet and outlet, or an InputError."""
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


def is_open(tensor: Array) -> bool:
    """Whether all elements count as open in every direction, of tensors whose largest entry is 1."""
    a, b, c = tensor[:, 0, 0], tensor[:, 1, 1], tensor[:, 0, 1]
    return bool(((a + b) / 2 - np.hypot((a - b) / 2, c)).min() > _OPEN)


def invertible(tensor: Array) -> Array:
    """Tensors with a smaller principal value of CLOSED_AXIS of the larger instead of 0."""
    if is_open(tensor):
        return tensor
    values, axes = np.linalg.eigh(tensor)
    half = (values[:, 1] > 0) & (values[:, 0] <= 1e-14 * values[:, 1])
    values[half, 0] = CLOSED_AXIS * values[half, 1]
    regular = np.einsum("eij,ej,ekj->eik", axes, values, axes)
    return np.where(half[:, None, None], regular, tensor)


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
    if is_open(tensor):
        full = np.ones(len(tensor), bool)
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

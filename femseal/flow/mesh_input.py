"""Permeability and ends of a mesh, checked."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from skfem import Mesh

from ..base import Array, Indices, InputError, counted
from .connected_elements import connected_elements

#: A tensor closed along one principal axis keeps this fraction of its other value there, so that K⁻¹ exists.
CLOSED_AXIS = 1e-10
#: Ratio of the smallest principal value to the largest from which on all elements count as open.
_OPEN = 1e-12


def permeability_tensors(permeability: ArrayLike, elements: int) -> Array:
    """K as (elements, 2, 2) positive semidefinite tensors, from any allowed shape; or an InputError."""
    try:
        k = np.asarray(permeability, dtype=float)
    except (TypeError, ValueError):
        raise InputError("permeability", type(permeability).__name__, "numbers [m³]") from None
    n = elements
    if k.shape not in ((), (n,), (n, 2), (n, 2, 2)):
        raise InputError(
            "permeability",
            f"shape {k.shape}",
            f"a number, or shape ({n},), ({n}, 2) or ({n}, 2, 2) for {n} elements",
        )
    if not np.all(np.isfinite(k)):
        raise InputError(
            "permeability",
            f"{counted(np.count_nonzero(~np.isfinite(k)), 'value')} not finite",
            "numbers >= 0 [m³]",
        )
    if k.ndim < 3:
        if k.min(initial=0.0) < 0:
            raise InputError("permeability", f"{k.min():g}", "numbers >= 0 [m³]")
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

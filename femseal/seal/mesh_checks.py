"""Check the mesh of a seal: its elements must be valid and must not overlap, and fluid should reach all its parts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from skfem import Mesh

from ..base import Indices, InputError, to_text
from .mesh_overlaps import first_overlap_at_boundary
from .plane import polygon_areas


def check_elements(mesh: Mesh) -> None:
    """Raise InputError if nodes are not finite, or if elements are degenerate, tangled or overlapping."""
    _check_element_shapes(mesh)
    overlapping = _overlapping_neighbours(mesh) or first_overlap_at_boundary(mesh)
    if overlapping:
        given = f"a mesh whose elements {' and '.join(map(str, overlapping))} overlap"
        raise InputError("path", given, "elements that do not overlap")


def _check_element_shapes(mesh: Mesh) -> None:
    """Raise InputError if nodes are not finite, or if elements are degenerate or tangled."""
    undefined = np.flatnonzero(~np.isfinite(mesh.p).all(axis=0))
    if undefined.size:
        raise InputError(
            "path",
            f"a mesh whose node {undefined[0]} has no finite coordinates",
            "finite coordinates",
        )
    corners = mesh.p.T[mesh.t.T]  # (element, corner, 2)
    to_previous = np.roll(corners, 1, axis=1) - corners
    to_next = np.roll(corners, -1, axis=1) - corners
    # the Jacobian of a bilinear element has its extremes at the corners; if it changes sign, the element is tangled
    det = to_next[..., 0] * to_previous[..., 1] - to_next[..., 1] * to_previous[..., 0]
    size = np.ptp(corners, axis=1).max(axis=1) ** 2
    is_flat = np.abs(det).min(axis=1) <= 1e-12 * size
    is_tangled = det.min(axis=1) * det.max(axis=1) <= 0
    bad = np.flatnonzero(is_flat | is_tangled)
    if bad.size:
        given = f"a mesh whose element {bad[0]} is degenerate or tangled"
        raise InputError("path", given, "a valid mesh")


def _overlapping_neighbours(mesh: Mesh) -> tuple[int, ...]:
    """Return the indices of the first two elements that overlap a neighbour; empty if no neighbours overlap.

    Neighbours overlap if both traverse their common edge in the same direction when their boundaries are followed
    anticlockwise. Elements also overlap if more than two of them share an edge.
    """
    vertices, edge = mesh.t.T, mesh.t2f.T  # (element, corner)
    # direction of each edge: 1 if the number of its second vertex is larger, −1 if it is smaller
    direction = np.sign(np.roll(vertices, -1, axis=1) - vertices)
    # the area is negative if the corners are in clockwise order; the direction is then reversed
    areas = polygon_areas(mesh.p.T[vertices])
    direction *= np.sign(areas)[:, None].astype(int)
    # number of elements at each edge, and sum of their directions, which is 0 for opposite directions
    element_count = np.bincount(edge.ravel())
    direction_sum = np.bincount(edge.ravel(), direction.ravel())
    has_overlap = (element_count > 2) | ((element_count == 2) & (direction_sum != 0))
    overlapping = np.flatnonzero(has_overlap[edge].any(axis=1))
    return tuple(overlapping[:2])


def parts_without_flow(mesh: Mesh, inlet: Indices, outlet: Indices) -> Iterator[str]:
    """Yield a warning for each part of a mesh that does not connect the inlet with the outlet.

    Parameters
    ----------
    mesh : Mesh
        Mesh of linear elements, with coordinates in metres.
    inlet, outlet : arrays of int
        Facets of the inlet and of the outlet.
    """
    corners = mesh.t  # (corner, element)
    part = _connected_parts(mesh, corners)
    inlet_parts = np.unique(part[mesh.facets[:, inlet]])
    outlet_parts = np.unique(part[mesh.facets[:, outlet]])
    element_part = part[corners[0]]  # all corners of an element belong to the same part
    area = np.abs(polygon_areas(mesh.p.T[corners.T]))
    for number in np.setdiff1d(element_part, np.intersect1d(inlet_parts, outlet_parts)):
        is_inside = element_part == number
        if number in outlet_parts:
            missing = "no inlet"
        elif number in inlet_parts:
            missing = "no outlet"
        else:
            missing = "neither inlet nor outlet"
        share = f"{area[is_inside].sum() * 1e6:.3g} of {area.sum() * 1e6:.3g} mm²"
        yield (
            f"a part of the mesh around {_centre_text(mesh, corners[:, is_inside])}, {share}, "
            f"touches {missing}: nothing flows there"
        )


def boundaries_without_name(mesh: Mesh) -> Iterator[str]:
    """Yield a warning for each connected part of the boundary, such as the rim of a hole, that has no name.

    Parameters
    ----------
    mesh : Mesh
        Mesh of linear elements, with coordinates in metres.
    """
    named = [np.asarray(facets) for facets in (mesh.boundaries or {}).values()]
    unnamed = np.setdiff1d(mesh.boundary_facets(), np.concatenate([*named, []]))
    ends = mesh.facets[:, unnamed]  # vertices at the two ends, (2, facet)
    part = _connected_parts(mesh, ends)[ends[0]]  # number of the line to which each facet belongs
    length = np.hypot(*(mesh.p[:, ends[1]] - mesh.p[:, ends[0]]))
    for number in np.unique(part):
        is_in_part = part == number
        yield (
            f"a boundary of the mesh around {_centre_text(mesh, ends[:, is_in_part])}, "
            f"{to_text(float(length[is_in_part].sum()), 'm', 3)} long, is in no group: it is closed"
        )


def _connected_parts(mesh: Mesh, corners: Indices) -> Indices:
    """Number the connected parts of a mesh, and return the number of the part to which each vertex belongs.

    corners : indices of the vertices of n elements or facets with k corners each (k, n). All corners of an element or
    facet count as connected with each other.
    """
    # links from the first corner to the other corners are sufficient
    starts = np.tile(corners[0], len(corners) - 1)
    ends = corners[1:].ravel()
    shape = (mesh.nvertices, mesh.nvertices)
    links = coo_array((np.ones(starts.size), (starts, ends)), shape=shape)
    _, part = connected_components(links, directed=False)
    return part


def _centre_text(mesh: Mesh, corners: Indices) -> str:
    """Return the mean position of the given vertices as text, for a message."""
    x, y = (to_text(float(c[corners].mean()), "m", 3) for c in mesh.p)
    return f"({x}, {y})"

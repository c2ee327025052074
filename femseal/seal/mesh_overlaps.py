"""Find elements of a mesh that overlap although they are not neighbours.

This happens, for example, where two separate parts of the mesh lie on top of each other. If no element overlaps its
neighbours but two elements overlap, at least one of these two is at the boundary of the mesh. Only the elements at the
boundary are therefore compared with the elements near them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree
from skfem import Mesh

from ..base import Array, Flags, Indices

#: Allowed overlap of two elements, as a fraction of the extent of the smaller element. The overlap can be positive
#: because of rounded coordinates, and because straight edges approximate arcs.
_ALLOWED_OVERLAP = 0.1
#: Number of pairs of elements that are processed at a time. This limits the memory, because elements that are much
#: longer than wide are close to many more elements than they have neighbours.
_PAIRS_AT_ONCE = 2**17


def first_overlap_at_boundary(mesh: Mesh) -> tuple[int, ...]:
    """Find an element at the boundary of the mesh that overlaps another element.

    Parameters
    ----------
    mesh : Mesh
        Triangles or quadrilaterals, which are not tangled and do not overlap their neighbours.

    Returns
    -------
    tuple of int
        Indices of the two overlapping elements; empty if no elements overlap. If several elements overlap, these are
        the element at the boundary with the smallest index, and the first element that it overlaps.
    """
    corners = mesh.p[:, mesh.t]  # (axis, corner, element)
    normals = _edge_normals(corners)
    boundary_elements = np.unique(mesh.f2t[0, mesh.boundary_facets()])
    for first, second in _pairs_of_boxes(corners, boundary_elements):
        overlapping = _overlap(corners, normals, first, second)
        if overlapping.any():
            return min(zip(first[overlapping].tolist(), second[overlapping].tolist(), strict=True))
    return ()


def _pairs_of_boxes(
    corners: Array, boundary_elements: Indices
) -> Iterator[tuple[Indices, Indices]]:
    """Find all pairs of an element at the boundary and another element whose bounding boxes overlap.

    If both elements are at the boundary, only the pair in which the first element has the smaller index is found.

    A tree of the centres of the bounding boxes finds the elements near an element. The search radius must cover the
    largest element of a tree. The elements are therefore grouped by size, with one tree for each group, so that a few
    large elements do not make the search slow.

    Parameters
    ----------
    corners : array, (2, corners, n)
        Coordinates of the corners of all elements [m].
    boundary_elements : array of int
        Indices of the elements at the boundary, in rising order.

    Yields
    ------
    Indices of the first elements and indices of the second elements of some pairs. All pairs of the same first element
    are yielded together. The first elements of a later batch have larger indices; within a batch, the pairs are in no
    particular order.
    """
    low, high = corners.min(axis=1).T, corners.max(axis=1).T  # opposite corners of the boxes
    centre = (low + high) / 2
    extent = (high - low).max(axis=1) / 2
    # two elements have the same size class if their extents are between the same powers of two
    _, size_class = np.frexp(extent)
    at_boundary = np.zeros(extent.size, bool)
    at_boundary[boundary_elements] = True
    trees = []
    near_count = np.zeros(boundary_elements.size, int)
    for number in np.unique(size_class):
        members = np.flatnonzero(size_class == number)
        tree = cKDTree(centre[members], balanced_tree=False, compact_nodes=False)
        # the maximum norm (p = inf); a little more than necessary, because the centres are rounded
        reach = (extent[boundary_elements] + extent[members].max()) * (1 + 1e-6)
        near_count += tree.query_ball_point(
            centre[boundary_elements], reach, p=np.inf, return_length=True
        )
        trees.append((tree, members, reach))
    # a batch ends with the element with which it reaches the largest number of pairs
    batch = (np.cumsum(near_count) - near_count) // _PAIRS_AT_ONCE
    ends = np.flatnonzero(np.diff(batch)) + 1
    for part in np.split(np.arange(boundary_elements.size), ends):
        elements = boundary_elements[part]
        pairs = []
        for tree, members, reach in trees:
            found = tree.query_ball_point(centre[elements], reach[part], p=np.inf)
            count = [len(near) for near in found]
            first = np.repeat(elements, count)
            second = members[np.concatenate([*found, []]).astype(int)]
            # the boxes overlap along both axes
            overlap = np.minimum(high[first], high[second]) > np.maximum(low[first], low[second])
            # of two elements at the boundary, the pair in the other order is left out
            is_pair = overlap.all(axis=1) & ((first < second) | ~at_boundary[second])
            pairs.append((first[is_pair], second[is_pair]))
        yield (
            np.concatenate([first for first, _ in pairs]),
            np.concatenate([second for _, second in pairs]),
        )


def _overlap(corners: Array, normals: Array, first: Indices, second: Indices) -> Flags:
    """Return whether two convex polygons overlap, for each of n pairs.

    Overlaps are found by the separating axis theorem: two convex polygons do not overlap if their projections on the
    normal of an edge do not overlap. Pairs that are separated by a normal are not projected on further normals.

    Parameters
    ----------
    corners : array, (2, corners, polygons)
        Coordinates of the corners of all polygons.
    normals : array, (2, edges, polygons)
        Normals of the edges of all polygons, see `_edge_normals`.
    first, second : arrays of int, (n,)
        Indices of the two polygons of each pair.
    """
    left = np.arange(first.size)  # pairs that no normal has separated so far
    for edge in range(normals.shape[1]):
        for polygon in (first, second):
            normal = normals[:, edge, polygon[left]]
            low1, high1 = _project(corners[:, :, first[left]], normal)
            low2, high2 = _project(corners[:, :, second[left]], normal)
            overlap = np.minimum(high1, high2) - np.maximum(low1, low2)
            smaller_extent = np.minimum(high1 - low1, high2 - low2)
            left = left[overlap > _ALLOWED_OVERLAP * smaller_extent]
    is_overlapping = np.zeros(first.size, bool)
    is_overlapping[left] = True
    return is_overlapping


def _project(corners: Array, normal: Array) -> tuple[Array, Array]:
    """Return the lowest and the highest projection of the corners of n polygons on a normal for each (2, n)."""
    projection = corners[0] * normal[0] + corners[1] * normal[1]  # (corner, polygon)
    return projection.min(axis=0), projection.max(axis=0)


def _edge_normals(corners: Array) -> Array:
    """Return a vector normal to each edge of n polygons (2, edges, n), from their corners (2, corners, n).

    The normals of the longest edges come first, because they separate most pairs of thin polygons.
    """
    edges = np.roll(corners, -1, axis=1) - corners
    normals = np.stack([edges[1], -edges[0]])
    longest_first = np.argsort(-np.hypot(*edges), axis=0, kind="stable")
    return np.take_along_axis(normals, longest_first[None], axis=1)

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
#: Number of elements at the boundary, and number of pairs of elements, that are processed at a time. This limits the
#: memory for usual meshes; thin elements can have many more candidates than neighbours.
_ELEMENTS_AT_ONCE = 2**12
_PAIRS_AT_ONCE = 2**15


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
    corners = mesh.p.T[mesh.t.T]  # (element, corner, 2)
    boundary_elements = np.unique(mesh.f2t[0, mesh.boundary_facets()])
    for first, second in _pairs_of_boxes(corners, boundary_elements):
        overlapping = np.zeros(first.size, bool)
        for start in range(0, first.size, _PAIRS_AT_ONCE):
            part = slice(start, start + _PAIRS_AT_ONCE)
            overlapping[part] = _overlap(corners[first[part]], corners[second[part]])
        if overlapping.any():
            return min(zip(first[overlapping].tolist(), second[overlapping].tolist(), strict=True))
    return ()


def _pairs_of_boxes(
    corners: Array, boundary_elements: Indices
) -> Iterator[tuple[Indices, Indices]]:
    """Find all pairs of an element at the boundary and another element whose bounding boxes overlap.

    A tree of the centres of the bounding boxes finds the elements near an element. The search radius must cover the
    largest element of a tree. The elements are therefore grouped by size, with one tree for each group, so that a few
    large elements do not make the search slow.

    Parameters
    ----------
    corners : array, (n, corners, 2)
        Corners of all elements [m].
    boundary_elements : array of int
        Indices of the elements at the boundary, in rising order.

    Yields
    ------
    Indices of the first elements and indices of the second elements of some pairs. All pairs of the same first element
    are yielded together. The first elements of a later batch have larger indices; within a batch, the pairs are in no
    particular order.
    """
    low, high = corners.min(axis=1), corners.max(axis=1)  # opposite corners of the bounding boxes
    centre = (low + high) / 2
    extent = (high - low).max(axis=1) / 2
    # two elements have the same size class if their extents are between the same powers of two
    _, size_class = np.frexp(extent)
    trees = []
    for number in np.unique(size_class):
        members = np.flatnonzero(size_class == number)
        tree = cKDTree(centre[members], balanced_tree=False, compact_nodes=False)
        trees.append((tree, members, extent[members].max()))
    for start in range(0, boundary_elements.size, _ELEMENTS_AT_ONCE):
        elements = boundary_elements[start : start + _ELEMENTS_AT_ONCE]
        pairs = []
        for tree, members, largest in trees:
            # the maximum norm (p = inf); a little more than necessary, because the centres are rounded
            reach = (extent[elements] + largest) * (1 + 1e-6)
            found = tree.query_ball_point(centre[elements], reach, p=np.inf)
            count = [len(near) for near in found]
            first = np.repeat(elements, count)
            second = members[np.concatenate([*found, []]).astype(int)]
            # the boxes overlap along both axes
            overlap = np.minimum(high[first], high[second]) > np.maximum(low[first], low[second])
            is_pair = overlap.all(axis=1) & (first != second)
            pairs.append((first[is_pair], second[is_pair]))
        yield (
            np.concatenate([first for first, _ in pairs]),
            np.concatenate([second for _, second in pairs]),
        )


def _overlap(first: Array, second: Array) -> Flags:
    """Return whether two convex polygons overlap, for each of n pairs.

    Overlaps are found by the separating axis theorem: two convex polygons do not overlap if their projections on the
    normal of an edge do not overlap.

    Parameters
    ----------
    first, second : arrays, (n, corners, 2)
        Corners of the two polygons of each pair.
    """
    normals = np.concatenate([_edge_normals(first), _edge_normals(second)], axis=1)
    # projections of the corners on the normals, (pair, corner, normal)
    projection1 = first @ normals.swapaxes(1, 2)
    projection2 = second @ normals.swapaxes(1, 2)
    low1, high1 = projection1.min(axis=1), projection1.max(axis=1)
    low2, high2 = projection2.min(axis=1), projection2.max(axis=1)
    overlap = np.minimum(high1, high2) - np.maximum(low1, low2)
    smaller_extent = np.minimum(high1 - low1, high2 - low2)
    return np.asarray((overlap > _ALLOWED_OVERLAP * smaller_extent).all(axis=1))


def _edge_normals(corners: Array) -> Array:
    """Return a vector normal to each edge of n polygons, from their corners (n, corners, 2)."""
    edges = np.roll(corners, -1, axis=1) - corners
    return np.stack([edges[..., 1], -edges[..., 0]], axis=-1)

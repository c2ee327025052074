"""Meshes that cover a place twice although no element lies on its neighbour, such as two parts on each other.

Such a mesh has outlines that cross, or an edge of an outline with elements on both of its sides. Outlines are walked
with the mesh on their left: the number of times that they run round a place is the number of elements there.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from skfem import Mesh

from ..base.arrays import Array, Indices

#: Depth in fractions of the shorter edge, and of an element, to which parts that touch may lie on each other:
#: coordinates are rounded, and edges are chords of arcs.
_EDGE_FRACTION, _ELEMENT_FRACTION = 0.05, 0.1
#: Pairs that are looked at together.
_CHUNK = 1_000_000


def first_overlap(mesh: Mesh) -> tuple[int, ...]:
    """One or two elements that lie on others; empty without any.

    mesh : triangles or quadrilaterals, none of which is tangled or lies on its neighbour.
    """
    start, end, inside, element = _outlines(mesh)
    crossing = _crossing(start, end)
    if crossing is not None:
        return int(element[crossing[0]]), int(element[crossing[1]])
    twice = np.flatnonzero(_rounds(start, end, inside) > 1)
    return (int(element[twice[0]]),) if twice.size else ()


def _outlines(mesh: Mesh) -> tuple[Array, Array, Array, Indices]:
    """Start and end of the edges of outlines, places beside them in their elements (m, 2), and these elements (m,)."""
    # along an outline of the usual kind, the edges follow each other in both coordinates when it is turned
    c, s = np.cos(1.0), np.sin(1.0)
    points = (np.array([[c, -s], [s, c]]) @ mesh.p[:, : mesh.nvertices]).T
    corners = mesh.t.T
    x, y = points[corners].transpose(2, 0, 1)
    area = (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)
    corners = np.where(area[:, None] > 0, corners, corners[:, ::-1])
    first, second = corners, np.roll(corners, -1, axis=1)
    key = np.minimum(first, second).astype(np.int64) * mesh.nvertices + np.maximum(first, second)
    _, edge, count = np.unique(key, return_inverse=True, return_counts=True)
    element, side = np.nonzero(count[edge.reshape(key.shape)] == 1)
    start, end = points[first[element, side]], points[second[element, side]]
    middle, centre = (start + end) / 2, points[corners[element]].mean(axis=1)
    return start, end, middle + _ELEMENT_FRACTION * (centre - middle), element


def _crossing(start: Array, end: Array) -> tuple[int, int] | None:
    """Two edges that cross; None without any."""
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = np.argsort(low[:, 1], kind="stable")
    last = np.searchsorted(low[order, 1], high[order, 1])
    for i, j in _pairs(np.arange(len(order)) + 1, last):
        a, b = order[i], order[j]
        near = (low[a, 0] <= high[b, 0]) & (low[b, 0] <= high[a, 0])
        a, b = a[near], b[near]
        along_a, along_b = end[a] - start[a], end[b] - start[b]
        length_a, length_b = np.hypot(*along_a.T), np.hypot(*along_b.T)
        depth = _EDGE_FRACTION * np.minimum(length_a, length_b)
        found = np.ones(len(a), bool)
        for origin, along, length, ends in (
            (start[a], along_a, length_a, (start[b], end[b])),
            (start[b], along_b, length_b, (start[a], end[a])),
        ):
            one, other = (_cross(along, place - origin) / length for place in ends)
            found &= (one * other < 0) & (np.minimum(np.abs(one), np.abs(other)) > depth)
        if found.any():
            at = int(np.argmax(found))
            return int(a[at]), int(b[at])
    return None


def _rounds(start: Array, end: Array, places: Array) -> Indices:
    """How often the outlines run round each place, by the edges that a ray to the right of it meets."""
    order = np.argsort(places[:, 1], kind="stable")
    height = places[order, 1]
    upwards = end[:, 1] > start[:, 1]
    low, high = np.minimum(start[:, 1], end[:, 1]), np.maximum(start[:, 1], end[:, 1])
    rounds = np.zeros(len(places), np.int64)
    for edge, at in _pairs(np.searchsorted(height, low), np.searchsorted(height, high)):
        place = order[at]
        left = (_cross(end[edge] - start[edge], places[place] - start[edge]) > 0) == upwards[edge]
        np.add.at(rounds, place[left], np.where(upwards[edge[left]], 1, -1))
    return rounds


def _pairs(first: Indices, last: Indices) -> Iterator[tuple[Indices, Indices]]:
    """Pairs of n and every number from first[n] to last[n], without it; not too many at a time."""
    count = np.maximum(last - first, 0)
    total = np.cumsum(count)
    begin = 0
    while begin < len(count):
        before = total[begin - 1] if begin else 0
        stop = max(begin + 1, int(np.searchsorted(total, before + _CHUNK, side="right")))
        n = np.repeat(np.arange(begin, stop), count[begin:stop])
        offset = np.arange(len(n)) - np.repeat(total[begin:stop] - count[begin:stop] - before, count[begin:stop])
        yield n, first[n] + offset
        begin = stop


def _cross(a: Array, b: Array) -> Array:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]

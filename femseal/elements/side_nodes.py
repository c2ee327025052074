"""Nodes on the sides of windows, and the interpolation of the pressure between them.

An open segment is a run of points of a side whose links across it are open. On each of them the pressure is
interpolated between nodes as a flow along the side would have it, with the resistances of the links along the side. The
outer nodes lie at the ends of the segment. Of those beside contact, which hardly carry flow, the next node is only half
a distance away.
Source: Hou & Wu, J. Comput. Phys. 134, 1997, 169 (oscillating boundary conditions of multiscale elements).
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def side_nodes(crossing, along, spacing):
    """Nodes of a side of n points, and the interpolation between them.

    crossing (n,) : conductances of the links across the side, 0 where it is closed.
    along (n − 1,) : conductances of the links along the side, of both of its sides together.
    spacing : largest distance of two nodes [points].

    Returns node (n, 2), weight (n, 2) : the pressure at a point is the weighted mean of those at two nodes; −1 where
    closed. place (nodes,) : point of each node.
    """
    n = crossing.size
    node, weight = np.full((n, 2), -1, np.int64), np.zeros((n, 2))
    place = np.empty(n, np.int64)
    count, first = 0, 0
    while first < n:
        if not crossing[first] > 0.0:
            first += 1
            continue
        last = first
        while last < n - 1 and crossing[last + 1] > 0.0 and along[last] > 0.0:
            last += 1
        nodes = _place(np.int64(first), last, n, spacing, place[count:])
        every = np.arange(count, count + nodes)
        for i in range(first, last + 1):
            (node[i, 0], node[i, 1]), (weight[i, 0], weight[i, 1]) = _between(along, place, every, i)
        count += nodes
        first = last + 1
    return node, weight, place[:count].copy()


@njit(cache=True, nogil=True)
def _place(first, last, n, spacing, place):
    """Put nodes on the segment from point `first` to `last` of a side of n points; return their number."""
    # half a distance is left beside contact, none in a corner of the window
    before, after = 0.5 * (first > 0), 0.5 * (last < n - 1)
    inner = max(1, int(np.ceil((last - first) / spacing + 1 - before - after)))
    distance = (last - first) / max(inner - 1 + before + after, 1.0)
    place[0] = first
    nodes = 1
    for k in range(inner + 1):
        here = last if k == inner else first + int(np.floor((before + k) * distance + 0.5))
        if here > place[nodes - 1]:
            place[nodes] = here
            nodes += 1
    return nodes


@njit(cache=True, nogil=True)
def _between(along, place, nodes, point):
    """The two of the `nodes` of a segment between which a point lies, and their weights."""
    for k in range(nodes.size):
        if place[nodes[k]] == point:
            return (nodes[k], nodes[k]), (1.0, 0.0)
    right = 0
    while place[nodes[right]] < point:
        right += 1
    a, b = nodes[right - 1], nodes[right]
    # both weights keep their relative accuracy
    before, after = _resistance(along, place[a], point), _resistance(along, point, place[b])
    return (a, b), (after / (before + after), before / (before + after))


@njit(cache=True, nogil=True)
def _resistance(along, a, b):
    total = 0.0
    for i in range(a, b):
        total += 1.0 / along[i]
    return total

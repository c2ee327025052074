"""Windows as finite elements: the flow through a window, condensed to nodes on its sides.

The windows tile the face. A link that crosses the side between two windows is cut into two halves at a side point, and
the pressure at the side points is interpolated between a few nodes. An open segment is a run of points of a side whose
links across it are open; on it the pressure is interpolated as a flow along the side would have it, with the
resistances of the links along the side. The outer nodes lie at the ends of the segment. Of those beside contact, which
hardly carry flow, the next node is only half a distance away. The matrix of such an element is symmetric, its rows sum
to zero, and it joins two nodes only where open pixels inside the window do.
Source: Hou & Wu, J. Comput. Phys. 134, 1997, 169 (multiscale finite elements, oscillating boundary conditions); Guyan,
AIAA J. 3, 1965, 380 (static condensation).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base import Array, Indices, InputError, validate
from ..base.compiled import compiled, inner
from ..flow.edge_flow import cell_stencil
from ..flow.grid import Grid
from ..flow.solvers.link_network import condense
from ..windows.partition import Partition


@compiled()
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


@inner()
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


@inner()
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


@inner()
def _resistance(along, a, b):
    total = 0.0
    for i in range(a, b):
        total += 1.0 / along[i]
    return total


#: Rows of pixels beyond a window on which the links on its sides depend.
_HALO = 2


@dataclass(frozen=True, eq=False)
class WindowLinks:
    """Conductances of the links of a window [m³], those across its sides cut into halves; they are whole at an end.

    along (w1 + 1, w2), across (w1, w2 + 1) : along both axes; the first and the last ones lead to the side points.
    beside1 (2, w2 − 1), beside2 (2, w1 − 1) : links along the first and the last side across x1, and along those across
        x2, of the pixels on both of their sides together.
    ends : whether the first and the last side across x1 are inlet and outlet.
    """

    along: Array
    across: Array
    beside1: Array
    beside2: Array
    ends: tuple[bool, bool]


@dataclass(frozen=True, eq=False)
class WindowElement:
    """A window condensed to the nodes on its sides, which are numbered side after side.

    The sides are the one before the first row of pixels, after the last row, before the first column and after the last
    column; so are the p = 2 w2 + 2 w1 side points. A side at the inlet or the outlet has a single node.

    conductances (n, n) : minus the entries of the element matrix off its diagonal [m³], 0 on the diagonal; few are
        negative.
    counts (4,) : number of nodes on each side.
    node (p, 2), weight (p, 2) : nodes between which the potential at a side point is interpolated, −1 where closed.
    component (p,) : side points with the same number are joined by open links inside the window.
    place (n,) : point of its side at which each node lies; −1 at an end.
    """

    conductances: Array
    counts: Indices
    node: Indices
    weight: Array
    component: Indices
    place: Indices

    @classmethod
    def of(cls, links: WindowLinks, node_spacing: int) -> WindowElement:
        """Condense a window; nodes on its sides are at most `node_spacing` pixels apart."""
        condensed, component = condense(links.along, links.across)
        along, across = (np.ascontiguousarray(c) for c in (links.along, links.across))
        beside1, beside2 = (np.ascontiguousarray(c) for c in (links.beside1, links.beside2))
        projected, counts, node, weight, place = _element(
            condensed, along, across, beside1, beside2, links.ends, node_spacing
        )
        return cls(projected, counts, node, weight, component, place)

    @property
    def side(self) -> Indices:
        """Side on which each node lies (n,)."""
        return np.repeat(np.arange(4), self.counts)

    def at_points(self, potential: Array) -> Array:
        """Potential at the side points (p,) from that at the nodes (n,); NaN where a point is closed."""
        values = np.full(len(self.node), np.nan)
        is_open = self.node[:, 0] >= 0
        values[is_open] = (self.weight[is_open] * potential[self.node[is_open]]).sum(axis=1)
        return values


def validated_face(gap: ArrayLike, partition: Partition) -> Array:
    """Gap as an array of the partition's shape of finite numbers >= 0, or an InputError."""
    h = validate.field("gap", gap, unit="m", shape=partition.shape, copy=False)
    if h.min() < 0:
        raise InputError("gap", f"{h.min():g} m", "numbers >= 0 [m]")
    return h


def window_links(gap: NDArray[np.floating], partition: Partition, row: int) -> list[WindowLinks]:
    """Links of all windows in a row of them, from the gap (n1, n2) [m] of a face that is periodic along x2.

    Only the pixels of these windows and two rows beside them are used.
    """
    (n1, n2), (w1, w2) = partition.shape, partition.window
    a, b = row * w1, (row + 1) * w1
    low, high = max(a - _HALO, 0), min(b + _HALO, n1)
    strip = np.asarray(gap[low:high], dtype=float)
    stencil = cell_stencil(strip, Grid.of_pixel_centres(strip.shape, partition.spacing, "periodic"))
    ends = (a == 0, b == n1)
    along, across = stencil.along[a - low : b - low + 1], stencil.across
    beside1 = np.zeros((2, n2))
    for side, line in enumerate((a - low, b - low)):
        if not ends[side]:
            beside1[side] = across[line - 1] + across[line]
            along[0 if side == 0 else -1] *= 2
    across = across[a - low : b - low]
    found = []
    for first in range(0, n2, w2):
        columns = slice(first, first + w2)
        own = across[:, np.arange(first - 1, first + w2) % n2]
        own[:, [0, -1]] *= 2
        beside2 = [along[1:-1, k - 1] + along[1:-1, k % n2] for k in (first, first + w2)]
        found.append(WindowLinks(along[:, columns], own, beside1[:, columns][:, :-1], np.array(beside2), ends))
    return found


@compiled()
def _element(conductances, along, across, beside1, beside2, ends, spacing):
    """Conductances between the nodes on the sides of a window, from those between its side points.

    Also returned: nodes on each side (4,), the two nodes (points, 2) between which each point is interpolated, with
    their weights, and the point at which each node lies, -1 for those of an end.
    """
    w1, w2 = across.shape[0], along.shape[1]
    points = conductances.shape[0]
    node, weight = np.full((points, 2), -1, np.int64), np.zeros((points, 2))
    place = np.full(points, -1, np.int64)
    counts = np.zeros(4, np.int64)
    start, count = 0, 0
    for side in range(4):
        n = w2 if side < 2 else w1
        if side < 2 and ends[side]:
            crossing = along[0] if side == 0 else along[-1]
            for i in range(n):
                if crossing[i] > 0.0:
                    node[start + i], weight[start + i, 0] = count, 1.0
            counts[side] = 1
        else:
            if side < 2:
                crossing, beside = along[0 if side == 0 else w1], beside1[side]
            else:
                crossing, beside = across[:, 0 if side == 2 else w2].copy(), beside2[side - 2]
            of_point, w, at = side_nodes(crossing, beside, spacing)
            for i in range(n):
                if of_point[i, 0] >= 0:
                    for k in range(2):
                        node[start + i, k] = of_point[i, k] + count
                        weight[start + i, k] = w[i, k]
            for k in range(at.size):
                place[count + k] = at[k]
            counts[side] = at.size
        count += counts[side]
        start += n
    projected = _projected(conductances, node, weight, np.int64(count))
    return projected, counts, node, weight, place[:count].copy()


@inner()
def _projected(conductances, node, weight, nodes):
    """Conductances of nodes (nodes, nodes) from those of side points (p, p), by c (p_i − p_j)² of interpolations."""
    out = np.zeros((nodes, nodes))
    which, fraction = np.empty(4, np.int64), np.empty(4)
    for i in range(len(conductances)):
        for j in range(i):
            c = conductances[i, j]
            if c == 0.0:
                continue
            m = 0
            for point, sign in ((i, 1.0), (j, -1.0)):
                for k in range(2):
                    if weight[point, k] == 0.0:
                        continue
                    at = 0
                    while at < m and which[at] != node[point, k]:
                        at += 1
                    if at == m:
                        which[m], fraction[m] = node[point, k], 0.0
                        m += 1
                    fraction[at] += sign * weight[point, k]
            for k in range(m):
                for q in range(k):
                    out[which[k], which[q]] -= c * fraction[k] * fraction[q]
    for k in range(nodes):
        for q in range(k):
            out[k, q] += out[q, k]
            out[q, k] = out[k, q]
    return out

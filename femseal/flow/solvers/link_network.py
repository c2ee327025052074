"""Elimination of networks of links on a grid: to inlet and outlet, and of islands.

The order is nested dissection of the open nodes. Source: George, SIAM J. Numer. Anal. 10, 1973, 345.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...base import Array, Flags, Indices
from ...base.compiled import compiled, inner
from ..grid import Stencil
from .elimination import Links, Order, factored, find_potentials

#: Boxes of about so many nodes are not cut any further; deepest nesting of boxes.
_LEAF, _DEEPEST = 12, 400


def eliminate(
    c1: Array, c2: Array, keep: Flags, ring: bool, node: Indices, end: Indices, link: Array
) -> tuple[float, Array, Array]:
    """Conductance between inlet and outlet, and of each inner node the potential φ and 1 − φ (n1 − 1, n2).

    c1 (n1, n2), c2 (n1 − 1, n2 or n2 − 1) : conductances of the links as in `Stencil`; those of c1 to the ends are
    not used. ring : whether the columns form one.
    keep (n1 − 1, n2) : nodes to solve for, which both ends have to reach; others get φ = 0 and 1 − φ = 0, and links to
    them count as closed.
    node, end, link : nodes (row · n2 + column) with links to an end, 0 the inlet with φ = 1, 1 the outlet with φ = 0,
    and their conductances.
    """
    φ, ψ = np.zeros(keep.shape), np.zeros(keep.shape)
    order = Order(*_dissect(keep, ring))
    return _solved(order, _grid_links(c1, c2, ring, order.nodes, node, end, link), φ, ψ), φ, ψ


def _solved(order: Order, links: tuple[Any, ...], φ: Array, ψ: Array) -> float:
    """Write φ and 1 − φ of the nodes of an order to contiguous fields; the conductance between inlet and outlet."""
    factors = factored(order, Links(*links))
    n = order.nodes.size
    v, w = np.zeros((2, n + 2))
    v[n] = w[n + 1] = 1.0
    find_potentials(factors, v, w)
    φ.ravel()[order.nodes], ψ.ravel()[order.nodes] = v[:n], w[:n]
    return float(factors.between)


def island_potentials(stencil: Stencil, hidden: Flags, φ: Array, ψ: Array) -> None:
    """Write φ and 1 − φ = ψ of the hidden ones of the inner nodes (n1 − 1, n2), found from the others.

    A neighbour of known potential φ acts as the inlet with the fraction φ of its link and as the outlet with 1 − φ.

    stencil : of a network, without nodes that are not connected to both ends.
    hidden : nodes that only very narrow links connect with the others, whose potential is wanted.
    φ, ψ : potential of the others, and its complement.
    """
    along, across, ring = stencil.along, stencil.across, stencil.ring2
    ends = _links_to_known(along, across, hidden, φ)
    # they are few: only the rows and columns that have some are dissected
    rows, columns = np.flatnonzero(hidden.any(axis=1)), np.flatnonzero(hidden.any(axis=0))
    among, *fronts = _dissect(hidden[np.ix_(rows, columns)], ring)
    nodes = rows[among // columns.size] * hidden.shape[1] + columns[among % columns.size]
    order = Order(nodes, *fronts)
    _solved(order, _grid_links(along, across, ring, nodes, *ends), φ, ψ)


def _links_to_known(
    along: Array, across: Array, hidden: Flags, φ: Array
) -> tuple[Indices, Indices, Array]:
    """Links of hidden nodes with the others: the node, 0 for the inlet or 1 for the outlet, and the conductance."""
    n1, n2 = hidden.shape
    i, j = np.nonzero(hidden)
    found = []
    for down, right in ((-1, 0), (1, 0), (0, 1), (0, -1)):
        a, b = i + down, (j + right) % n2
        if down:
            c = along[np.maximum(i, a), j]
        else:
            start = j if right > 0 else b
            c, linked = np.zeros(i.size), start < across.shape[1]
            c[linked] = across[i[linked], start[linked]]
        inside = (a >= 0) & (a < n1)
        row = np.clip(a, 0, n1 - 1)
        known = (c > 0) & ~(inside & hidden[row, b])
        fraction = np.where(inside, np.clip(φ[row, b], 0.0, 1.0), a < 0)[known]
        node, c = (i * n2 + j)[known], c[known]
        found += [(node, 0 * node, c * fraction), (node, 0 * node + 1, c * (1 - fraction))]
    node, end, link = (np.concatenate(part) for part in zip(*found, strict=True))
    return node, end, link


@compiled()
def _grid_links(c1, c2, ring, order, node, end, link):
    """`Links` of the nodes of a grid, and of some of them to ends; links of nodes that are not in the order are closed.

    Every link is found from the first of its nodes in the grid: to the right and below.
    """
    n1, n2 = c1.shape[0] - 1, c1.shape[1]
    m2 = c2.shape[1]
    n = order.size
    place = np.empty(n1 * n2, np.int32)
    for i in range(n1 * n2):
        place[i] = -1
    for i in range(n):
        place[order[i]] = i
    row = np.zeros(n + 1, np.int64)
    for k in range(node.size):
        row[place[node[k]] + 1] += 1
    later, value = np.empty(0, np.int64), np.empty(0)
    for counted in range(2):
        if counted == 1:
            for i in range(n):
                row[i + 1] += row[i]
            later, value = np.empty(row[n], np.int64), np.empty(row[n])
            for k in range(node.size):
                a = place[node[k]]
                later[row[a]], value[row[a]] = n + end[k], link[k]
                row[a] += 1
        for i in range(n1):
            for j in range(n2):
                a = place[i * n2 + j]
                if a < 0:
                    continue
                for kind in range(2):
                    c, b = 0.0, a
                    if kind == 1 and i < n1 - 1:
                        c, b = c1[i + 1, j], place[(i + 1) * n2 + j]
                    elif kind == 0 and j < m2 and n2 > 1:
                        c, b = c2[i, j], place[i * n2 + (j + 1) % n2]
                    if c == 0.0 or b < 0:
                        continue
                    at = min(a, b)
                    if counted == 0:
                        row[at + 1] += 1
                    else:
                        later[row[at]], value[row[at]] = max(a, b), c
                        row[at] += 1
    for i in range(n, 0, -1):
        row[i] = row[i - 1]
    row[0] = 0
    return row, later, value


@compiled()
def _dissect(keep, ring):
    """`Order` of the nodes of a grid by nested dissection.

    Every box is cut by the row or column with the fewest nodes near its middle; only the nodes of that cut link its
    two halves. A front comes after the fronts of both halves, the second half first.
    """
    n1, n2 = keep.shape
    # nodes above and left of a corner; twice the columns of a ring, so that a box may lie across the seam
    around = 2 if ring else 1
    nodes = np.zeros((n1 + 1, around * n2 + 1), np.int32)
    for i in range(n1):
        in_row = 0
        for start in range(0, around * n2, n2):
            for j in range(n2):
                in_row += keep[i, j]
                nodes[i + 1, start + j + 1] = nodes[i, start + j + 1] + in_row
    n = nodes[n1, n2]
    order = np.empty(n, np.int64)
    first = np.empty(n + 1, np.int64)
    parent = np.empty(n, np.int64)
    placed, fronts = 0, 0
    # of each box that waits: its rows and columns, whether it is a ring, and the front of the cut above it
    boxes = np.empty((_DEEPEST, 6), np.int64)
    boxes[0, 0], boxes[0, 1], boxes[0, 2], boxes[0, 3], boxes[0, 4], boxes[0, 5] = (
        0,
        n1,
        0,
        n2,
        ring and n2 > 2,
        -1,
    )
    count = 1
    while count > 0:
        count -= 1
        a, b, c, d = boxes[count, 0], boxes[count, 1], boxes[count, 2], boxes[count, 3]
        in_ring, above = boxes[count, 4] > 0, boxes[count, 5]
        inside = nodes[b, d] - nodes[a, d] - nodes[b, c] + nodes[a, c]
        if inside == 0:
            continue
        low1, high1, low2, high2 = a, b, c, d
        along = False
        if inside > _LEAF:
            row, in_row = _thinnest(nodes, a, b, c, d, np.int64(1))
            column, in_column = _thinnest(nodes, c, d, a, b, np.int64(0))
            # of two equal cuts, take the one across the longer side
            along = in_row < in_column or (in_row == in_column and b - a >= d - c)
            if along:
                low1, high1 = row, row + 1
            else:
                low2, high2 = column, column + 1
        before = placed
        for i in range(low1, high1):
            for j in range(low2, high2):
                if keep[i, j % n2]:
                    order[n - 1 - placed] = i * n2 + j % n2
                    placed += 1
        if placed > before:
            first[fronts] = before
            parent[fronts] = above
            above = fronts
            fronts += 1
        if inside <= _LEAF:
            continue
        for half in range(2):
            boxes[count, 0], boxes[count, 1], boxes[count, 2], boxes[count, 3] = a, b, c, d
            boxes[count, 4], boxes[count, 5] = in_ring, above
            if along:
                boxes[count, 1 - half] = row + half
            elif in_ring:
                boxes[count, 2], boxes[count, 3], boxes[count, 4] = (
                    high2 % n2,
                    high2 % n2 + n2 - 1,
                    0,
                )
            else:
                boxes[count, 3 - half] = column + half
            count += 1
            if in_ring and not along:
                break
    # from the leaves to the root
    starts = np.empty(fronts + 1, np.int64)
    parents = np.empty(fronts, np.int64)
    first[fronts] = n
    for f in range(fronts):
        g = fronts - 1 - f
        starts[f] = n - first[g + 1]
        parents[f] = fronts - 1 - parent[g] if parent[g] >= 0 else fronts
    starts[fronts] = n
    return order, starts, parents


@inner()
def _thinnest(nodes, a, b, c, d, rows):
    """Line with the fewest nodes in the middle third of a box, the one nearest to its middle, and its nodes.

    a, b : first line and end of the lines that may be cut, rows (1) or columns (0). c, d : those across them.
    """
    middle = (a + b) // 2
    best, fewest = middle, 1 << 60
    extent = (b - a) // 6
    for k in range(2 * extent + 1):
        i = middle + ((k + 1) // 2 if k % 2 else -(k // 2))
        if i < a or i >= b:
            continue
        if rows == 1:
            here = nodes[i + 1, d] - nodes[i, d] - nodes[i + 1, c] + nodes[i, c]
        else:
            here = nodes[d, i + 1] - nodes[d, i] - nodes[c, i + 1] + nodes[c, i]
        if here < fewest:
            best, fewest = i, here
    return best, fewest

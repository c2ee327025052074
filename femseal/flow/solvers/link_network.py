"""Elimination of networks of links on a grid: to inlet and outlet, and of islands.

The order is nested dissection of the open nodes. Source: George, SIAM J. Numer. Anal. 10, 1973, 345.
"""

from __future__ import annotations

import numpy as np

from ...base.arrays import Array, Flags, Indices
from ...base.compiled import compiled, inner
from ..stencil import Stencil
from .elimination import Factors, Links, Order, factored, find_two_potentials

#: Boxes of about so many nodes are not cut any further; deepest nesting of boxes.
_LEAF, _DEEPEST = 12, 400
_NOTHING = np.zeros((0, 0))


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
    order = Order(*dissect(keep, ring))
    factors = factored(
        order, Links(*grid_links(c1, c2, _NOTHING, _NOTHING, ring, order.nodes, node, end, link)), 2
    )
    φ, ψ = np.zeros(keep.shape), np.zeros(keep.shape)
    _write_potentials(order, factors, φ, ψ)
    return float(factors.between[0, 1]), φ, ψ


def _write_potentials(order: Order, factors: Factors, φ: Array, ψ: Array) -> None:
    """Write φ and 1 − φ of the eliminated nodes between inlet and outlet to contiguous fields."""
    n = order.nodes.size
    v, w = np.zeros((2, n + 2))
    v[n] = w[n + 1] = 1.0
    find_two_potentials(factors, v, w)
    φ.ravel()[order.nodes], ψ.ravel()[order.nodes] = v[:n], w[:n]


def island_potentials(stencil: Stencil, hidden: Flags, φ: Array, ψ: Array) -> None:
    """Write φ and 1 − φ = ψ of the hidden ones of the inner nodes (n1 − 1, n2), found from the others.

    A neighbour of known potential φ acts as the inlet with the fraction φ of its link and as the outlet with 1 − φ.

    stencil : of a network, without nodes that are not connected to both ends.
    hidden : nodes that only very narrow links connect with the others, whose potential is wanted.
    φ, ψ : potential of the others, and its complement.
    """
    node, end, link = _links_to_known(stencil.along, stencil.across, hidden, φ)
    # they are few: only the rows and columns that have some are dissected
    rows, columns = np.flatnonzero(hidden.any(axis=1)), np.flatnonzero(hidden.any(axis=0))
    among, *fronts = dissect(hidden[np.ix_(rows, columns)], stencil.ring2)
    order = Order(
        rows[among // columns.size] * hidden.shape[1] + columns[among % columns.size], *fronts
    )
    grid = stencil.along, stencil.across, _NOTHING, _NOTHING, stencil.ring2
    factors = factored(order, Links(*grid_links(*grid, order.nodes, node, end, link)), 2)
    _write_potentials(order, factors, φ, ψ)


@compiled()
def _links_to_known(along, across, hidden, φ):
    """Links of hidden nodes with the others: the node, 0 for the inlet or 1 for the outlet, and the conductance."""
    n1, n2 = hidden.shape
    m2 = across.shape[1]
    count = 0
    node, end, link = np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    for written in range(2):
        if written == 1:
            node, end, link = (
                np.empty(2 * count, np.int64),
                np.empty(2 * count, np.int64),
                np.empty(2 * count),
            )
            count = 0
        for i in range(n1):
            for j in range(n2):
                if not hidden[i, j]:
                    continue
                for side in range(4):
                    a, b, c = i, j, 0.0
                    if side < 2:
                        a = i + 2 * side - 1
                        c = along[i + side, j]
                    elif side == 2:
                        b = (j + 1) % n2
                        c = across[i, j] if j < m2 else 0.0
                    else:
                        b = (j - 1) % n2
                        c = across[i, b] if b < m2 else 0.0
                    inside = 0 <= a < n1
                    if not c > 0.0 or (inside and hidden[a, b]):
                        continue
                    if written == 1:
                        fraction = 1.0 if a < 0 else 0.0
                        if inside:
                            fraction = min(max(φ[a, b], 0.0), 1.0)
                        for k in range(2):
                            at = 2 * count + k
                            node[at], end[at] = i * n2 + j, k
                            link[at] = c * (fraction if k == 0 else 1.0 - fraction)
                    count += 1
    return node, end, link


@compiled()
def grid_links(c1, c2, falling, rising, ring, order, node, end, link):
    """`Links` of the nodes of a grid, and of some of them to ends; links of nodes that are not in the order are closed.

    Every link is found from the first of its nodes in the grid: to the right, below, and across both corners below.
    """
    n1, n2 = c1.shape[0] - 1, c1.shape[1]
    m2 = c2.shape[1]
    kinds = 4 if falling.size > 0 else 2
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
                for kind in range(kinds):
                    c, b = 0.0, a
                    right, left = j + 1 if j < n2 - 1 else 0, j - 1 if j > 0 else n2 - 1
                    if kind == 0:
                        if j < m2 and n2 > 1:
                            c, b = c2[i, j], place[i * n2 + right]
                    elif i == n1 - 1:
                        break
                    elif kind == 1:
                        c, b = c1[i + 1, j], place[(i + 1) * n2 + j]
                    elif kind == 2:
                        if j < m2 and n2 > 1:
                            c, b = falling[i + 1, j], place[(i + 1) * n2 + right]
                    elif left < m2 and n2 > 1:
                        c, b = rising[i + 1, left], place[(i + 1) * n2 + left]
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
def dissect(keep, ring):
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

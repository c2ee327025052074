"""Solve networks on a grid by star-mesh elimination, which is accurate for any ratio of the conductances.

The elimination of node i adds links between its neighbours: c_jk += c_ij c_ik / Σ_l c_il. There are no subtractions.
The conductance between the ends and the potentials therefore have small relative errors, however narrow a constriction
is. A factorisation of the assembled matrix loses this accuracy, because narrow links vanish in the diagonal sums.

Nodes are eliminated in groups, the fronts (multifrontal method). A front is a cut of nested dissection; its nodes and
all their neighbours are stored in one dense array. In this file, the *place* of a node is its position in the order of
elimination. Inlet and outlet have the last two places, n and n + 1.
Sources: Grassmann, Taksar & Heyman, Oper. Res. 33, 1985, 1107 (no subtractions); Duff & Reid, ACM TOMS 9, 1983, 302;
George, SIAM J. Numer. Anal. 10, 1973, 345 (nested dissection).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...base import Array, Flags, Indices
from ...base.compiled import compiled, inner
from ..grid import Stencil

#: Boxes with at most this number of nodes are not cut any further.
_LEAF = 12
#: Number of multiplications above which a matrix product is computed by BLAS.
_BLAS = 30_000

_fast: dict[str, Any] = {"error_model": "numpy", "fastmath": {"reassoc", "contract"}}


def eliminate(stencil: Stencil, unknown: Flags, φ: Array, ψ: Array) -> float:
    """Solve for the potentials of some nodes, given the potentials of all others.

    A link to a node of known potential φ is replaced by two links, to the inlet with the fraction φ of its conductance,
    and to the outlet with the fraction 1 − φ.

    Parameters
    ----------
    stencil : conductances of all links.
    unknown : flags (n1 − 1, n2) of the inner nodes to solve for. Each must be connected to a node of known potential.
    φ, ψ : arrays (n1 + 1, n2), potential and 1 − potential. The solution is written to the unknown nodes of both
        arrays.

    Returns
    -------
    Conductance between inlet and outlet through the unknown nodes.
    """
    order, first, parent = _nested_dissection(unknown, stencil.ring2)
    later, links = _list_links(order, stencil.along, stencil.across, φ)
    conductance, potential, complement = _eliminate_fronts(first, parent, later, links)
    φ.ravel()[order] = potential
    ψ.ravel()[order] = complement
    return float(conductance)


@compiled()
def _list_links(order, along, across, φ):
    """List, for each node in the order of elimination, its links to later nodes and to inlet and outlet.

    Parameters
    ----------
    order : array (n,), numbers of the nodes (row · n2 + column) in the order of elimination. The place of a node is its
        index in this array.
    along : array (n1, n2), conductance between the nodes (i, j) and (i + 1, j). The nodes have n1 + 1 rows; row 0 is at
        the inlet and row n1 at the outlet.
    across : array (n1 − 1, m2), conductance between the nodes (i + 1, j) and (i + 1, j + 1). m2 is n2 on a ring, where
        the last column is linked to the first one, and n2 − 1 otherwise.
    φ : array (n1 + 1, n2), potential of the nodes that are not in `order`.

    Returns
    -------
    later : array (n, 6), places of the nodes that are eliminated later. n stands for the inlet, n + 1 for the outlet.
    conductance : array (n, 6), conductances of these links. A node has at most six links: to four neighbours and to
        both ends. Unused entries at the end of a row have the conductance 0.
    """
    n = order.size
    n2, m2 = along.shape[1], across.shape[1]
    # place of each node; −1 for nodes of known potential, which have none
    place = np.full((along.shape[0] + 1) * n2, -1, np.int32)
    for a in range(n):
        place[order[a]] = a
    later = np.empty((n, 6), np.int32)
    conductance = np.zeros((n, 6))
    for a in range(n):
        node = order[a]
        i, j = node // n2, node % n2
        row_start = node - j
        # columns on either side, if the row is a ring; otherwise the link over the seam has the conductance 0
        left = j - 1 if j > 0 else n2 - 1
        right = j + 1 if j < n2 - 1 else 0
        # number of each neighbour, and conductance of the link to it; row i − 1 of `across` is in row i of the nodes
        neighbours = (
            (row_start + left, across[i - 1, left] if left < m2 else 0.0),
            (row_start + right, across[i - 1, j] if j < m2 else 0.0),
            (node - n2, along[i - 1, j]),
            (node + n2, along[i, j]),
        )
        to_inlet = 0.0
        to_outlet = 0.0
        k = 0  # number of links listed for this node
        for neighbour, c in neighbours:
            if c > 0.0 and place[neighbour] > a:
                later[a, k], conductance[a, k] = place[neighbour], c
                k += 1
            elif c > 0.0 and place[neighbour] < 0:
                # a known potential φ acts like links to the inlet (fraction φ) and to the outlet (fraction 1 − φ)
                known = min(max(φ[neighbour // n2, neighbour % n2], 0.0), 1.0)
                to_inlet += c * known
                to_outlet += c * (1.0 - known)
        for b, c in ((n, to_inlet), (n + 1, to_outlet)):
            if c > 0.0:
                later[a, k], conductance[a, k] = b, c
                k += 1
    return later, conductance


@compiled()
def _nested_dissection(unknown, ring):
    """Order the nodes by nested dissection.

    Each box is divided by a row or column near its middle, the one with the fewest nodes. Only the nodes of this cut,
    which form a front, connect both halves of the box. They are eliminated last, after all fronts of both halves. What
    remains of a front after elimination is added to its parent, the front of the next larger box.

    Returns
    -------
    order : array (n,), numbers of the nodes (row · n2 + column) in the order of elimination.
    first : array (fronts + 1,), place of the first node of each front; the last entry is n.
    parent : array (fronts,), parent of each front.
    """
    n1, n2 = unknown.shape
    # nodes[i, j] is the number of unknown nodes in the first i rows and j columns, which gives the number in any box by
    # four values. The columns of a ring are repeated, so that a box may extend across the seam.
    columns = 2 * n2 if ring else n2
    nodes = np.zeros((n1 + 1, columns + 1), np.int32)
    for i in range(n1):
        in_row = 0
        for start in range(0, columns, n2):
            for j in range(n2):
                in_row += unknown[i, j]
                nodes[i + 1, start + j + 1] = nodes[i, start + j + 1] + in_row
    n = nodes[n1, n2]
    # arrays are filled from the root to the leaves, and reversed at the end
    order = np.empty(n, np.int64)
    first = np.empty(n + 1, np.int64)
    parent = np.empty(n, np.int64)
    placed = fronts = 0
    # boxes still to be divided: first row, end of rows, first column, end of columns, parent, and whether it is a ring
    boxes = [(0, n1, 0, n2, -1, ring and n2 > 2)]
    while len(boxes) > 0:
        top, bottom, left, right, above, in_ring = boxes.pop()
        # number of unknown nodes in the box
        inside = nodes[bottom, right] - nodes[top, right] - nodes[bottom, left] + nodes[top, left]
        if inside == 0:
            continue
        # rows low1 to high1 − 1 and columns low2 to high2 − 1 of the cut, which is the whole box if it is small
        low1, high1, low2, high2 = top, bottom, left, right
        if inside > _LEAF:
            row, in_row = _thinnest_line(nodes, top, bottom, left, right)
            column, in_column = _thinnest_line(nodes.T, left, right, top, bottom)
            # of two equal cuts, take the one across the longer side
            if in_row < in_column or (in_row == in_column and bottom - top >= right - left):
                low1, high1 = row, row + 1
            else:
                low2, high2 = column, column + 1
        before = placed
        for i in range(low1, high1):
            for j in range(low2, high2):
                if unknown[i, j % n2]:
                    order[n - 1 - placed] = (i + 1) * n2 + j % n2
                    placed += 1
        if placed > before:
            first[fronts], parent[fronts] = before, above
            above = fronts
            fronts += 1
        if inside <= _LEAF:
            continue
        if low1 > top or high1 < bottom:
            boxes.append((top, low1, left, right, above, in_ring))
            boxes.append((high1, bottom, left, right, above, in_ring))
        elif in_ring:  # a single cut across a ring leaves a single box
            boxes.append((top, bottom, high2 % n2, high2 % n2 + n2 - 1, above, False))
        else:
            boxes.append((top, bottom, left, low2, above, False))
            boxes.append((top, bottom, high2, right, above, False))
    first[fronts] = n
    # reverse the fronts; places and numbers of fronts then count from the other end
    return order, n - first[fronts::-1], fronts - 1 - parent[:fronts][::-1]


@inner()
def _thinnest_line(nodes, first, end, left, right):
    """Find the line with the fewest nodes in the middle third of a box, and the number of its nodes.

    Of several such lines the one nearest to the middle is taken. The lines are rows. To examine columns, pass the
    transpose of `nodes`.

    nodes : summed-area table: nodes[i, j] is the number of nodes in the first i lines, at the first j positions.
    first, end : the lines of the box are `first` to `end` − 1.
    left, right : the positions of the box along each line are `left` to `right` − 1.
    """
    middle = (first + end) // 2
    best, fewest = middle, 1 << 60
    extent = (end - first) // 6
    for k in range(2 * extent + 1):
        line = middle + ((k + 1) // 2 if k % 2 else -(k // 2))  # middle, +1, −1, +2, −2, …
        if first <= line < end:
            up_to_line = nodes[line + 1, right] - nodes[line + 1, left]
            before_line = nodes[line, right] - nodes[line, left]
            in_line = up_to_line - before_line
            if in_line < fewest:
                best, fewest = line, in_line
    return best, fewest


@compiled(**_fast)
def _eliminate_fronts(first, parent, later, conductance):
    """Eliminate all nodes; return the conductance between inlet and outlet, and the two potentials of `_potentials`.

    A front has p nodes. Its border consists of the q later nodes to which these nodes are linked. The array `front` (p,
    p + q) has the links within the front, and those from the front to the border. `fill_in` (q, q) has the new links
    within the border, which elimination creates; they are added to the parent of the front.
    """
    n, fronts = len(later), parent.size
    # for each node, 1 over the sum of its conductances at the time of its elimination
    inverse = np.empty(n)
    # for each front: its links at the time of elimination, and the places of its border
    rows: list[Array] = []
    borders: list[Indices] = []
    # stack of fronts whose fill-in has not been added to their parent yet; the children of a front are on its top
    waiting: list[int] = []
    waiting_fill_in: list[Array] = []
    last_front = np.full(n + 2, -1)  # last front in whose border a place was listed
    listed = np.empty(n + 2, np.int64)  # places in the border of a front, not yet sorted
    column = np.empty(n + 2, np.int64)  # column of each place in `front`
    places = np.empty(n + 2, np.int64)  # columns of the border of a child
    for f in range(fronts):
        start, end = first[f], first[f + 1]
        p, q, children = end - start, 0, 0
        # list the border: later places that are linked to the nodes, and those in the borders of the children
        for a in range(start, end):
            column[a] = a - start
            for k in range(6):
                b = later[a, k]
                if conductance[a, k] == 0.0:
                    break
                if b >= end and last_front[b] != f:
                    last_front[b], listed[q] = f, b
                    q += 1
        while children < len(waiting) and parent[waiting[-1 - children]] == f:
            for b in borders[waiting[-1 - children]]:
                if b >= end and last_front[b] != f:
                    last_front[b], listed[q] = f, b
                    q += 1
            children += 1
        border_places = listed[:q].copy()
        border_places.sort()
        for k in range(q):
            column[border_places[k]] = p + k
        # add up the links of the nodes themselves and the fill-in of the children
        front = np.zeros((p, p + q))
        fill_in = np.zeros((q, q))
        for a in range(start, end):
            for k in range(6):
                if conductance[a, k] == 0.0:
                    break
                front[a - start, column[later[a, k]]] += conductance[a, k]
        for _ in range(children):
            # places are in rising order in both fronts, so that links remain in the upper triangle
            block, border = waiting_fill_in.pop(), borders[waiting.pop()]
            for i in range(border.size):
                places[i] = column[border[i]]
            for i in range(border.size):
                here = places[i]
                if here < p:
                    for j in range(i + 1, border.size):
                        front[here, places[j]] += block[i, j]
                else:
                    for j in range(i + 1, border.size):
                        fill_in[here - p, places[j] - p] += block[i, j]
        _eliminate_front(front, fill_in, inverse[start:end])
        rows.append(front)
        borders.append(border_places)
        waiting.append(f)
        waiting_fill_in.append(fill_in)
    # the border of a front without parent is inlet and outlet, and its fill-in is a link between them
    between_ends = 0.0
    for k in range(len(waiting_fill_in) - 1, -1, -1):
        if len(waiting_fill_in[k]) == 2:
            between_ends += waiting_fill_in[k][0, 1]
    return between_ends, *_potentials(first, rows, borders, inverse)


@inner(**_fast)
def _eliminate_front(front, fill_in, inverse):
    """Eliminate the nodes of a front, and add the new links within its border to `fill_in`.

    Each link is stored only once, in the row of the node that is eliminated first. Both arrays are therefore upper
    triangular.

    inverse : array (p,), to which 1 over the sum of the conductances of each node is written.
    """
    p, q = inverse.size, len(fill_in)
    # Star-mesh elimination of node i adds the link c_ij c_ik / Σ_l c_il between its neighbours j and k. First, the new
    # links from a later node j of the front are added.
    for i in range(p):
        total = 0.0
        for j in range(i + 1, p + q):
            total += front[i, j]
        inverse[i] = 1.0 / total if total != 0.0 else 0.0
        for j in range(i + 1, p):
            fraction = front[i, j] * inverse[i]
            if fraction != 0.0:
                for k in range(j + 1, p + q):
                    front[j, k] += fraction * front[i, k]
    # Then the new links within the border, whose nodes have the indices p + j and p + k in `front`. They are BᵀDB with
    # D = diag(inverse) and the links B from the front to the border.
    if p * q * q > _BLAS:
        to_border = front[:, p:].copy()
        fill_in += np.dot((to_border * inverse.reshape(p, 1)).T, to_border)
        return
    # two nodes, i and i2, at a time, which is faster; if p is odd, the last node has no second one
    for i in range(0, p, 2):
        i2 = min(i + 1, p - 1)
        inverse2 = inverse[i2] if i + 1 < p else 0.0
        for j in range(q):
            fraction = inverse[i] * front[i, p + j]
            fraction2 = inverse2 * front[i2, p + j]
            for k in range(j + 1, q):
                fill_in[j, k] += fraction * front[i, p + k] + fraction2 * front[i2, p + k]


@inner(**_fast)
def _potentials(first, rows, borders, inverse):
    """Compute two potentials at all places: v for 1 at the inlet, w for 1 at the outlet, and 0 at the other end.

    In reverse order of elimination, the potential of a node is the weighted mean of the potentials of the neighbours
    that it had when it was eliminated.

    first : place of the first node of each front.
    rows, borders : for each front, the array `front` after elimination, and the places of the nodes in its border.
    inverse : array (n,), 1 over the sum of the conductances of each node.
    """
    n = inverse.size
    v = np.zeros(n + 2)
    w = np.zeros(n + 2)
    v[n] = 1.0  # the inlet
    w[n + 1] = 1.0  # the outlet
    for f in range(len(rows) - 1, -1, -1):
        front, border, start = rows[f], borders[f], first[f]
        p = len(front)
        for i in range(p - 1, -1, -1):
            # sums of conductance times potential over the links to later nodes, in the front and in its border
            sum_v = 0.0
            sum_w = 0.0
            for j in range(i + 1, p):
                sum_v += front[i, j] * v[start + j]
                sum_w += front[i, j] * w[start + j]
            for j in range(border.size):
                sum_v += front[i, p + j] * v[border[j]]
                sum_w += front[i, p + j] * w[border[j]]
            v[start + i] = sum_v * inverse[start + i]
            w[start + i] = sum_w * inverse[start + i]
    return v[:n], w[:n]

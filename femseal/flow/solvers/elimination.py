"""Solve networks on a grid by star-mesh elimination, which is accurate for any ratio of the conductances.

The elimination of node i adds links between its neighbours: c_jk += c_ij c_ik / Σ_l c_il. Star-mesh elimination needs
no subtractions. The computed potentials and the conductance between inlet and outlet therefore have small relative
errors, even if the path from inlet to outlet has a very narrow constriction. A factorisation of the assembled matrix is
less accurate, because small conductances are lost by rounding in the sums on the diagonal.

Nodes are eliminated in groups called fronts (multifrontal method). A front is the set of nodes in a row or column that
divides a box of the grid into two halves (nested dissection). The links of the nodes of a front are stored in a dense
array. The *position* of a node is its index in the order of elimination. The n nodes of the network have the positions
0 to n − 1; the inlet has the position n, and the outlet the position n + 1.

Sources: Grassmann, Taksar & Heyman, Oper. Res. 33, 1985, 1107 (no subtractions); Duff & Reid, ACM TOMS 9, 1983, 302;
George, SIAM J. Numer. Anal. 10, 1973, 345 (nested dissection).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...base import Array, Flags, Indices
from ...base.compiled import compiled, inlined, inner
from ..grid import Stencil

#: Boxes with at most this number of nodes are not divided any further.
_LEAF = 12
#: Number of multiplications above which a matrix product is computed by BLAS.
_BLAS = 30_000

_fast: dict[str, Any] = {"fastmath": {"reassoc", "contract"}}


def eliminate(stencil: Stencil, unknown: Flags, φ: Array, ψ: Array) -> float:
    """Solve for the potentials of some nodes, given the potentials of all other nodes.

    A link with the conductance c to a node of known potential φ is replaced by two links: one to the inlet with the
    conductance φ c, and one to the outlet with the conductance (1 − φ) c.

    Parameters
    ----------
    stencil : conductances of all links.
    unknown : flags (n1 − 1, n2) of the inner nodes to solve for. Each unknown node must be connected to a node of known
        potential.
    φ, ψ : arrays (n1 + 1, n2), potential φ and complement ψ = 1 − φ at the nodes. The solution is written to the
        entries of φ and ψ that belong to unknown nodes.

    Returns
    -------
    Conductance between inlet and outlet of the network of unknown nodes.
    """
    order, first, parent = _nested_dissection(unknown, stencil.ring2)
    later, links = _list_links(order, stencil.along, stencil.across, φ)
    conductance, potential, complement = _eliminate_fronts(first, parent, later, links)
    φ.ravel()[order] = potential
    ψ.ravel()[order] = complement
    return float(conductance)


@compiled()
def _list_links(order, along, across, φ):
    """List the links of each node to nodes that are eliminated later, to the inlet and to the outlet.

    Parameters
    ----------
    order : array (n,), numbers of the nodes (row · n2 + column) in the order of elimination. The position of a node is
        its index in `order`.
    along : array (n1, n2), conductance between the nodes (i, j) and (i + 1, j). The nodes have n1 + 1 rows; row 0 is at
        the inlet and row n1 at the outlet.
    across : array (n1 − 1, m2), conductance between the nodes (i + 1, j) and (i + 1, j + 1). On a ring, where the last
        column is linked to the first column, m2 is n2; otherwise m2 is n2 − 1.
    φ : array (n1 + 1, n2), potential at the nodes; only used for nodes that are not in `order`.

    Returns
    -------
    later : array (n, 6), positions of the nodes to which each node is linked: n for the inlet, n + 1 for the outlet,
        and a smaller number for a node that is eliminated later.
    conductance : array (n, 6), conductances of the links in `later`. A node has at most six links: to four neighbours,
        to the inlet and to the outlet. Unused entries at the end of a row of `conductance` are 0.
    """
    n = order.size
    n2, m2 = along.shape[1], across.shape[1]
    # position of each node; −1 for nodes of known potential, which are not eliminated
    position = np.full((along.shape[0] + 1) * n2, -1, np.int32)
    for a in range(n):
        position[order[a]] = a
    later = np.empty((n, 6), np.int32)
    conductance = np.zeros((n, 6))
    for a in range(n):
        node = order[a]
        i, j = node // n2, node % n2
        row_start = node - j
        # columns on either side, if the row is a ring; otherwise the link over the seam has the conductance 0
        left = j - 1 if j > 0 else n2 - 1
        right = j + 1 if j < n2 - 1 else 0
        # number of each neighbour, and conductance of the link; row i − 1 of `across` lies in row i of the nodes
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
            if c > 0.0 and position[neighbour] > a:
                later[a, k], conductance[a, k] = position[neighbour], c
                k += 1
            elif c > 0.0 and position[neighbour] < 0:
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
    """Order the nodes of a grid by nested dissection.

    Each box of the grid is divided into two halves by a front. The front consists of the nodes of the row or column
    near the middle of the box that has the fewest nodes. The two halves are only connected through the front, which is
    eliminated after all nodes of the two halves. The elimination of a front creates new links. They are added to the
    parent of the front, which is the front of the next larger box.

    Returns
    -------
    order : array (n,), numbers of the nodes (row · n2 + column) in the order of elimination.
    first : array (fronts + 1,), position of the first node of each front; the last entry is n.
    parent : array (fronts,), number of the parent of each front.
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
        # the front: rows low1 to high1 − 1 and columns low2 to high2 − 1; a small box is a single front
        low1, high1, low2, high2 = top, bottom, left, right
        if inside > _LEAF:
            row, in_row = _thinnest_line(nodes, top, bottom, left, right)
            column, in_column = _thinnest_line(nodes.T, left, right, top, bottom)
            # if the row and the column have equally many nodes, divide the longer side of the box
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
        elif in_ring:  # a ring that is divided by a single column becomes a single box
            boxes.append((top, bottom, high2 % n2, high2 % n2 + n2 - 1, above, False))
        else:
            boxes.append((top, bottom, left, low2, above, False))
            boxes.append((top, bottom, high2, right, above, False))
    first[fronts] = n
    # reverse the order of the fronts: positions of nodes and numbers of fronts are counted from the other end
    return order, n - first[fronts::-1], fronts - 1 - parent[:fronts][::-1]


@inner()
def _thinnest_line(nodes, first, end, left, right):
    """Find the row with the fewest nodes in the middle third of a box.

    If several rows have equally few nodes, the row nearest to the middle is chosen. To find a column instead of a row,
    pass the transpose of `nodes`, and exchange the ranges of rows and columns.

    nodes : summed-area table; nodes[i, j] is the number of unknown nodes in the first i rows and the first j columns.
    first, end : the box consists of the rows `first` to `end` − 1.
    left, right : the box consists of the columns `left` to `right` − 1.

    Returns the row, and the number of unknown nodes of the box in this row.
    """
    middle = (first + end) // 2
    best, fewest = middle, 1 << 60
    extent = (end - first) // 6
    for k in range(2 * extent + 1):
        row = middle + ((k + 1) // 2 if k % 2 else -(k // 2))  # middle, +1, −1, +2, −2, …
        if first <= row < end:
            up_to_row = nodes[row + 1, right] - nodes[row + 1, left]
            before_row = nodes[row, right] - nodes[row, left]
            in_row = up_to_row - before_row
            if in_row < fewest:
                best, fewest = row, in_row
    return best, fewest


@compiled(**_fast)
def _eliminate_fronts(first, parent, later, conductance):
    """Eliminate all nodes, front by front.

    A front has p nodes. The border of the front consists of q nodes that are eliminated later and are linked to nodes
    of the front. The array `front` (p, p + q) contains the links within the front, and the links from the front to the
    border. The array `fill_in` (q, q) contains the links within the border that are created by the elimination of the
    front. The new links in `fill_in` are added to the parent of the front.

    first, parent : first node and parent of each front, see `_nested_dissection`.
    later, conductance : links of each node, see `_list_links`.

    Returns the conductance between inlet and outlet, and the two potentials of `_potentials`.
    """
    n, fronts = len(later), parent.size
    # for each node, 1/Σc with the sum of the conductances c of its links at the time of its elimination
    inverse = np.empty(n)
    # for each front: its links at the time of elimination, and the positions of the nodes in its border
    eliminated: list[Array] = []
    borders: list[Indices] = []
    # stack of fronts whose fill-in has not been added to their parent yet; the children of a front are on its top
    waiting: list[int] = []
    waiting_fill_in: list[Array] = []
    # work arrays with an entry for each position
    last_front = np.full(
        n + 2, -1
    )  # number of the last front in whose border a position was listed
    listed = np.empty(n + 2, np.int64)  # positions of the nodes in the border of a front
    column = np.empty(n + 2, np.int64)  # column of `front` that belongs to each position
    child_columns = np.empty(n + 2, np.int64)  # columns of `front` for the border of a child
    for f in range(fronts):
        start, end = first[f], first[f + 1]
        p = end - start
        q = _list_linked(f, start, end, later, conductance, last_front, listed)
        children = 0
        while children < len(waiting) and parent[waiting[-1 - children]] == f:
            q = _list_border(f, end, borders[waiting[-1 - children]], last_front, listed, q)
            children += 1
        border_positions = listed[:q].copy()
        _sort(border_positions)
        for k in range(p):
            column[start + k] = k
        for k in range(q):
            column[border_positions[k]] = p + k
        # add up the links of the nodes themselves and the fill-in of the children
        front = np.zeros((p, p + q))
        fill_in = np.zeros((q, q))
        for a in range(start, end):
            for k in range(6):
                if conductance[a, k] == 0.0:
                    break
                front[a - start, column[later[a, k]]] += conductance[a, k]
        for _ in range(children):
            border = borders[waiting.pop()]
            for i in range(border.size):
                child_columns[i] = column[border[i]]
            _add_child(waiting_fill_in.pop(), child_columns, front, fill_in)
        _eliminate_front(front, fill_in, inverse[start:end])
        eliminated.append(front)
        borders.append(border_positions)
        waiting.append(f)
        waiting_fill_in.append(fill_in)
    # the border of a front without parent consists of inlet and outlet, and its fill-in is a link between the two
    between_ends = 0.0
    for k in range(len(waiting_fill_in) - 1, -1, -1):
        if len(waiting_fill_in[k]) == 2:
            between_ends += waiting_fill_in[k][0, 1]
    return between_ends, *_potentials(first, eliminated, borders, inverse)


@inlined()
def _list_linked(f, start, end, later, conductance, last_front, listed):
    """List the positions of later nodes that are linked to front f, and return their number.

    start, end : the front consists of the positions `start` to `end` − 1.
    last_front : number of the last front in whose border each position was listed, which is updated.
    listed : array for the positions.
    """
    q = 0
    for a in range(start, end):
        for k in range(6):
            b = later[a, k]
            if conductance[a, k] == 0.0:
                break
            if b >= end and last_front[b] != f:
                last_front[b], listed[q] = f, b
                q += 1
    return q


@inlined()
def _list_border(f, end, border, last_front, listed, q):
    """Append later nodes in the border of a child of front f to `listed`, and return the new number of positions.

    end, last_front, listed : as in `_list_linked`.
    border : positions of the nodes in the border of the child.
    q : number of positions that are listed already.
    """
    for b in border:
        if b >= end and last_front[b] != f:
            last_front[b], listed[q] = f, b
            q += 1
    return q


@inlined()
def _add_child(block, child_columns, front, fill_in):
    """Add the fill-in of a child, array `block`, to the links of its parent, the arrays `front` and `fill_in`.

    Positions are in rising order in the front and in the child, so that links remain in the upper triangle.

    child_columns : column of `front` for each row and column of `block`.
    """
    p = len(front)
    for i in range(len(block)):
        here = child_columns[i]
        if here < p:
            for j in range(i + 1, len(block)):
                front[here, child_columns[j]] += block[i, j]
        else:
            for j in range(i + 1, len(block)):
                fill_in[here - p, child_columns[j] - p] += block[i, j]


@inlined()
def _sort(values):
    """Sort positions by insertion.

    The positions come from few sorted lists, and the elimination of a front takes longer than this sorting. The sort
    function of NumPy would take several times as long to compile.
    """
    for k in range(1, values.size):
        value = values[k]
        i = k
        while i > 0 and values[i - 1] > value:
            values[i] = values[i - 1]
            i -= 1
        values[i] = value


@inlined(**_fast)
def _eliminate_front(front, fill_in, inverse):
    """Eliminate the nodes of a front, and add the new links between nodes of the border to `fill_in`.

    Each link is stored only once, in the row of the node that is eliminated first. The arrays `front` and `fill_in` are
    therefore upper triangular.

    inverse : array (p,) for a result: 1/Σc for each node, with the sum of the conductances c of its links at the time
        of its elimination.
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
    # Then the new links within the border, whose nodes have the indices p + j and p + k in `front`. The matrix of the
    # new links is BᵀDB, with D = diag(inverse) and the links B from the front to the border.
    if p * q * q > _BLAS:
        to_border = np.empty((p, q))
        scaled = np.empty((p, q))
        for i in range(p):
            for j in range(q):
                to_border[i, j] = front[i, p + j]
                scaled[i, j] = inverse[i] * front[i, p + j]
        product = np.dot(scaled.T, to_border)
        for i in range(q):
            for j in range(q):
                fill_in[i, j] += product[i, j]
        return
    # two nodes, i and i2, at a time, which is faster; if p is odd, the last node is alone, with inverse2 = 0
    for i in range(0, p, 2):
        i2 = min(i + 1, p - 1)
        inverse2 = inverse[i2] if i + 1 < p else 0.0
        for j in range(q):
            fraction = inverse[i] * front[i, p + j]
            fraction2 = inverse2 * front[i2, p + j]
            for k in range(j + 1, q):
                fill_in[j, k] += fraction * front[i, p + k] + fraction2 * front[i2, p + k]


@inlined(**_fast)
def _potentials(first, eliminated, borders, inverse):
    """Compute the potential v, which is 1 at the inlet and 0 at the outlet, and the potential w = 1 − v.

    The nodes are visited in reverse order of elimination. When a node was eliminated, it was linked to later nodes. Its
    potential is the mean of the potentials of these nodes, weighted with the conductances of the links. w is computed
    in the same way as v, and not as the difference 1 − v, so that small values are accurate.

    first : position of the first node of each front.
    eliminated : array `front` of each front after the elimination.
    borders : positions of the nodes in the border of each front.
    inverse : array (n,), 1/Σc for each node, see `_eliminate_front`.
    """
    n = inverse.size
    v = np.zeros(n + 2)
    w = np.zeros(n + 2)
    v[n] = 1.0  # the inlet
    w[n + 1] = 1.0  # the outlet
    for f in range(len(eliminated) - 1, -1, -1):
        front, border, start = eliminated[f], borders[f], first[f]
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

"""Star-mesh elimination of networks of links on a grid, exact to rounding at any contrast.

Eliminating node i joins its neighbours j, k by c_jk += c_ij c_ik / Σ_l c_il. Nothing is ever subtracted, so what
links the ends, and the potentials, keep their relative accuracy however small a constriction is; a factorisation of
the assembled matrix loses it, as weak links vanish in the diagonal sums.

Nodes are eliminated front by front: all nodes of a front with all their neighbours in one dense array (multifrontal).
The fronts are the cuts of nested dissection. A place is that of a node in this order; inlet and outlet come last.
Sources: Grassmann, Taksar & Heyman, Oper. Res. 33, 1985, 1107 (no subtractions); Duff & Reid, ACM TOMS 9, 1983, 302;
George, SIAM J. Numer. Anal. 10, 1973, 345 (nested dissection).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...base import Array, Flags, Indices
from ...base.compiled import compiled, inner
from ..grid import Stencil

#: Boxes of about so many nodes are not cut any further.
_LEAF = 12
#: Multiplications from which a product of matrices is left to BLAS.
_BLAS = 30_000

_fast: dict[str, Any] = {"error_model": "numpy", "fastmath": {"reassoc", "contract"}}


def eliminate(stencil: Stencil, unknown: Flags, φ: Array, ψ: Array) -> float:
    """Write φ and ψ = 1 − φ (n1 + 1, n2) of unknown nodes, given those of the nodes that these have links to.

    A neighbour of known potential φ acts as the inlet with the fraction φ of its link and as the outlet with 1 − φ.

    unknown (n1 − 1, n2) : nodes to solve for, none at an end; links have to join all of them to known ones.

    Returns the conductance between inlet and outlet through them.
    """
    order, first, parent = _dissected(unknown, stencil.ring2)
    links = _links(order, stencil.along, stencil.across, φ)
    between, of_inlet, of_outlet = _solved(first, parent, *links)
    φ.ravel()[order], ψ.ravel()[order] = of_inlet, of_outlet
    return float(between)


@compiled()
def _links(order, along, across, φ):
    """Links of the nodes at all places to later ones beside them and to the ends: places and conductances (n, 6).

    After the last link of a node there are zeros.
    """
    n, n2, m2 = order.size, along.shape[1], across.shape[1]
    place = np.full((along.shape[0] + 1) * n2, -1, np.int32)
    for a in range(n):
        place[order[a]] = a
    later = np.empty((n, 6), np.int32)
    conductance = np.zeros((n, 6))
    for a in range(n):
        v = order[a]
        i, j = v // n2, v % n2
        before = j - 1 if j > 0 else n2 - 1
        after = j + 1 if j < n2 - 1 else 0
        beside = (
            (v - j + before, across[i - 1, before] if before < m2 else 0.0),
            (v - j + after, across[i - 1, j] if j < m2 else 0.0),
            (v - n2, along[i - 1, j]),
            (v + n2, along[i, j]),
        )
        inlet = outlet = 0.0
        k = 0
        for u, c in beside:
            if c > 0.0 and place[u] > a:
                later[a, k], conductance[a, k] = place[u], c
                k += 1
            elif c > 0.0 and place[u] < 0:
                known = min(max(φ[u // n2, u % n2], 0.0), 1.0)
                inlet += c * known
                outlet += c * (1.0 - known)
        for b, c in ((n, inlet), (n + 1, outlet)):
            if c > 0.0:
                later[a, k], conductance[a, k] = b, c
                k += 1
    return later, conductance


@compiled()
def _dissected(unknown, ring):
    """Order of the nodes (row · n2 + column) by nested dissection, the first of each front, and the front it goes into.

    Every box is cut by the row or column with the fewest nodes near its middle; only the nodes of that cut link its
    two halves. A front comes after the fronts of both halves, the second half first, and goes into that of the cut
    above it.
    """
    n1, n2 = unknown.shape
    # nodes above and left of a corner; twice the columns of a ring, so that a box may lie across the seam
    columns = 2 * n2 if ring else n2
    nodes = np.zeros((n1 + 1, columns + 1), np.int32)
    for i in range(n1):
        in_row = 0
        for start in range(0, columns, n2):
            for j in range(n2):
                in_row += unknown[i, j]
                nodes[i + 1, start + j + 1] = nodes[i, start + j + 1] + in_row
    n = nodes[n1, n2]
    # from the root to the leaves
    order = np.empty(n, np.int64)
    first = np.empty(n + 1, np.int64)
    parent = np.empty(n, np.int64)
    placed = fronts = 0
    # rows and columns of boxes that wait, the front of the cut above, and whether they are a ring
    boxes = [(0, n1, 0, n2, -1, ring and n2 > 2)]
    while len(boxes) > 0:
        a, b, c, d, above, in_ring = boxes.pop()
        inside = nodes[b, d] - nodes[a, d] - nodes[b, c] + nodes[a, c]
        if inside == 0:
            continue
        low1, high1, low2, high2 = a, b, c, d
        if inside > _LEAF:
            row, in_row = _thinnest(nodes, a, b, c, d)
            column, in_column = _thinnest(nodes.T, c, d, a, b)
            # of two equal cuts, take the one across the longer side
            if in_row < in_column or (in_row == in_column and b - a >= d - c):
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
        if low1 > a or high1 < b:
            boxes.append((a, low1, c, d, above, in_ring))
            boxes.append((high1, b, c, d, above, in_ring))
        elif in_ring:
            boxes.append((a, b, high2 % n2, high2 % n2 + n2 - 1, above, False))
        else:
            boxes.append((a, b, c, low2, above, False))
            boxes.append((a, b, high2, d, above, False))
    first[fronts] = n
    return order, n - first[fronts::-1], fronts - 1 - parent[:fronts][::-1]


@inner()
def _thinnest(nodes, a, b, c, d):
    """Line of a box with the fewest nodes in its middle third, the one nearest to its middle, and its nodes.

    a, b : first line and end of the lines that may be cut. c, d : those across them.
    """
    middle = (a + b) // 2
    best, fewest = middle, 1 << 60
    extent = (b - a) // 6
    for k in range(2 * extent + 1):
        i = middle + ((k + 1) // 2 if k % 2 else -(k // 2))
        if a <= i < b:
            here = nodes[i + 1, d] - nodes[i, d] - nodes[i + 1, c] + nodes[i, c]
            if here < fewest:
                best, fewest = i, here
    return best, fewest


@compiled(**_fast)
def _solved(first, parent, later, conductance):
    """Conductance between inlet and outlet, and `_potentials`."""
    n, fronts = len(later), parent.size
    inverse = np.empty(n)
    # of each front: its links at the time of elimination, and the places beyond it that they lead to
    rows: list[Array] = []
    borders: list[Indices] = []
    # fronts that left links among places beyond them, and these
    waiting: list[int] = []
    left: list[Array] = []
    seen = np.full(n + 2, -1)
    found = np.empty(n + 2, np.int64)
    local = np.empty(n + 2, np.int64)
    places = np.empty(n + 2, np.int64)
    for f in range(fronts):
        start, end = first[f], first[f + 1]
        p, q, children = end - start, 0, 0
        for a in range(start, end):
            local[a] = a - start
            for k in range(6):
                b = later[a, k]
                if conductance[a, k] == 0.0:
                    break
                if b >= end and seen[b] != f:
                    seen[b], found[q] = f, b
                    q += 1
        while children < len(waiting) and parent[waiting[-1 - children]] == f:
            for b in borders[waiting[-1 - children]]:
                if b >= end and seen[b] != f:
                    seen[b], found[q] = f, b
                    q += 1
            children += 1
        own = found[:q].copy()
        own.sort()
        for k in range(q):
            local[own[k]] = p + k
        front = np.zeros((p, p + q))
        rest = np.zeros((q, q))
        for a in range(start, end):
            for k in range(6):
                if conductance[a, k] == 0.0:
                    break
                front[a - start, local[later[a, k]]] += conductance[a, k]
        for _ in range(children):
            # both number their places in the same order
            block, border = left.pop(), borders[waiting.pop()]
            for i in range(border.size):
                places[i] = local[border[i]]
            for i in range(border.size):
                here = places[i]
                if here < p:
                    for j in range(i + 1, border.size):
                        front[here, places[j]] += block[i, j]
                else:
                    for j in range(i + 1, border.size):
                        rest[here - p, places[j] - p] += block[i, j]
        _eliminate_front(front, rest, inverse[start:end])
        rows.append(front)
        borders.append(own)
        waiting.append(f)
        left.append(rest)
    between = 0.0
    for k in range(len(left) - 1, -1, -1):
        if len(left[k]) == 2:
            between += left[k][0, 1]
    return between, *_potentials(first, rows, borders, inverse)


@inner(**_fast)
def _eliminate_front(front, rest, inverse):
    """Eliminate the nodes of a front, its rows; links to later nodes only, also within its border."""
    p, q = inverse.size, len(rest)
    for i in range(p):
        total = 0.0
        for j in range(i + 1, p + q):
            total += front[i, j]
        inverse[i] = 1.0 / total if total != 0.0 else 0.0
        for j in range(i + 1, p):
            f = front[i, j] * inverse[i]
            if f != 0.0:
                for k in range(j + 1, p + q):
                    front[j, k] += f * front[i, k]
    if p * q * q > _BLAS:
        later = front[:, p:].copy()
        rest += np.dot((later * inverse.reshape(p, 1)).T, later)
        return
    for i in range(0, p, 2):  # two nodes at once
        after = min(i + 1, p - 1)
        second = inverse[after] if i + 1 < p else 0.0
        for j in range(q):
            f = inverse[i] * front[i, p + j]
            g = second * front[after, p + j]
            for k in range(j + 1, q):
                rest[j, k] += f * front[i, p + k] + g * front[after, p + k]


@inner(**_fast)
def _potentials(first, rows, borders, inverse):
    """Potentials at all places of a unit drop from inlet to outlet, and of one from outlet to inlet.

    That of a node is the mean of those of its neighbours at the time it was eliminated.
    """
    n = inverse.size
    v = np.zeros(n + 2)
    w = np.zeros(n + 2)
    v[n] = w[n + 1] = 1.0
    for f in range(len(rows) - 1, -1, -1):
        front, border, start = rows[f], borders[f], first[f]
        p = len(front)
        for i in range(p - 1, -1, -1):
            x = y = 0.0
            for j in range(i + 1, p):
                x += front[i, j] * v[start + j]
                y += front[i, j] * w[start + j]
            for j in range(border.size):
                x += front[i, p + j] * v[border[j]]
                y += front[i, p + j] * w[border[j]]
            v[start + i], w[start + i] = x * inverse[start + i], y * inverse[start + i]
    return v[:n], w[:n]

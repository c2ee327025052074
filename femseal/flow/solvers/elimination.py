"""Direct solution of a link network by star-mesh elimination, exact to rounding at any contrast up to 1e150.

Eliminating node i joins its neighbours j, k by c_jk += c_ij c_ik / Σ_l c_il. Nothing is ever subtracted, so the
effective conductance and the potentials keep their relative accuracy however small a constriction is; a factorisation
of the assembled matrix loses it, because weak links vanish in the diagonal sums. Inlet and outlet are nodes as well,
never eliminated: what links them in the end is the flow for a unit drop.

The order is nested dissection of the open nodes; each separator is eliminated with all its neighbours in one dense
array (multifrontal). Sources: Grassmann, Taksar & Heyman, Oper. Res. 33, 1985, 1107 (subtraction-free elimination);
George, SIAM J. Numer. Anal. 10, 1973, 345 (nested dissection); Duff & Reid, ACM TOMS 9, 1983, 302 (multifrontal).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from .fronts import eliminate_front, gather, leave, sort_places

#: Boxes of about so many nodes are not cut any further.
_LEAF = 12

_exact: dict[str, Any] = {"cache": True, "nogil": True}
_fast: dict[str, Any] = {**_exact, "error_model": "numpy", "fastmath": {"reassoc", "contract"}}


@njit(**_exact)
def eliminate(c1, c2, keep, periodic, inlet, outlet):
    """Conductance between inlet and outlet, and of each inner node the potential φ and 1 − φ.

    c1 (n1, n2), c2 (n1 − 1, n2 or n2 − 1) : conductances of the links as in `Stencil`; those of c1 to the ends are
    not used. keep (n1 − 1, n2) : nodes to solve for, which both ends have to reach; others get φ = 0 and 1 − φ = 0,
    and links to them count as closed. inlet, outlet (n1 − 1, n2) : links of each node to the ends, φ = 1 and 0.
    """
    nothing = np.zeros((0, 0))
    order, first, border, start, at, links, total, rate = factors(
        c1, c2, nothing, nothing, keep, periodic, inlet, outlet
    )
    n = order.size
    high, low = np.zeros(n + 2), np.zeros(n + 2)
    high[n] = low[n + 1] = 1.0
    for f in range(first.size - 2, -1, -1):
        a, p, q = first[f], first[f + 1] - first[f], start[f + 1] - start[f]
        front = links[at[f] : at[f + 1]].reshape(p, p + q)
        _substitute(front, total[a : a + p], a, border[start[f] : start[f + 1]], high, low)
    potential, complement = np.zeros(keep.size), np.zeros(keep.size)
    for i in range(n):
        potential[order[i]] = high[i]
        complement[order[i]] = low[i]
    return rate, potential, complement


@njit(**_exact)
def factors(c1, c2, falling, rising, keep, periodic, inlet, outlet):
    """Eliminate all nodes: what is needed to find their potentials.

    Couples across corners, falling and rising (n1, n2 or n2 − 1) as in `Stencil`, may be empty. Returned are the order
    of the nodes, the first place of each front in it, the later nodes that each front is linked to and where they
    start, the links of the nodes at the time they were eliminated, front by front, and where those of each front start,
    their sums, and the conductance between inlet and outlet.
    """
    order, first, parent = dissect(keep, periodic)
    n = order.size
    # nodes go by their place in the order; after them come inlet and outlet
    rank = np.full(keep.size, -1, np.int64)
    for i in range(n):
        rank[order[i]] = i
    border, start, width, waiting = _borders(c1, c2, falling, rising, periodic, order, first, parent, rank)
    fronts = first.size - 1
    at = np.zeros(fronts + 1, np.int64)
    for f in range(fronts):
        p = first[f + 1] - first[f]
        at[f + 1] = at[f] + p * (p + start[f + 1] - start[f])
    links = np.zeros(at[fronts])
    total = np.zeros(n)
    left = np.empty(waiting)  # links within the borders of fronts whose parents have not come yet
    work = np.empty(width * width)
    local = np.zeros(n + 2, np.int64)
    neighbour = np.empty(8, np.int64)
    link = np.empty(8)
    pending = np.empty(fronts + 1, np.int64)
    n_pending = 0
    top = 0
    for f in range(fronts):
        a, p, q = first[f], first[f + 1] - first[f], start[f + 1] - start[f]
        front = links[at[f] : at[f + 1]].reshape(p, p + q)
        rest = work[: q * q].reshape(q, q)
        rest[:] = 0.0
        for i in range(p):
            local[a + i] = i
        for i in range(q):
            local[border[start[f] + i]] = p + i
        for i in range(p):
            node = order[a + i]
            for k in range(_links(c1, c2, falling, rising, periodic, node, neighbour, link)):
                if link[k] != 0.0 and rank[neighbour[k]] > a + i:
                    front[i, local[rank[neighbour[k]]]] += link[k]
            front[i, p + q - 2] += inlet[node // c1.shape[1], node % c1.shape[1]]
            front[i, p + q - 1] += outlet[node // c1.shape[1], node % c1.shape[1]]
        n_pending, top = gather(f, parent, pending, n_pending, border, start, left, top, local, front, rest)
        eliminate_front(front, rest, total[a : a + p])
        top = leave(rest, left, top)
        pending[n_pending] = f
        n_pending += 1
    rate = 0.0
    while n_pending > 0:
        n_pending -= 1
        top -= 4
        rate += left[top + 1]
    return order, first, border, start, at, links, total, rate


@njit(**_exact)
def _links(c1, c2, falling, rising, periodic, node, neighbour, link):
    """Inner neighbours of an inner node and the links to them, and their number: above, below, left, right, corners."""
    n1, n2 = c1.shape
    i, j = node // n2, node % n2
    row = i * n2
    west, east = (j - 1) % n2, (j + 1) % n2
    has_west, has_east = (periodic or j > 0) and n2 > 1, (periodic or j < n2 - 1) and n2 > 1
    has_above, has_below = i > 0, i < n1 - 2
    neighbour[0] = node - n2 if has_above else node
    link[0] = c1[i, j] if has_above else 0.0
    neighbour[1] = node + n2 if has_below else node
    link[1] = c1[i + 1, j] if has_below else 0.0
    neighbour[2] = row + west
    link[2] = c2[i, west] if has_west else 0.0
    neighbour[3] = row + east
    link[3] = c2[i, j] if has_east else 0.0
    if falling.size == 0:
        return 4
    neighbour[4] = row - n2 + west if has_above else node
    link[4] = falling[i, west] if has_above and has_west else 0.0
    neighbour[5] = row - n2 + east if has_above else node
    link[5] = rising[i, j] if has_above and has_east else 0.0
    neighbour[6] = row + n2 + west if has_below else node
    link[6] = rising[i + 1, west] if has_below and has_west else 0.0
    neighbour[7] = row + n2 + east if has_below else node
    link[7] = falling[i + 1, j] if has_below and has_east else 0.0
    return 8


@njit(**_exact)
def dissect(keep, periodic):
    """Nested dissection: order of elimination, first place of each front in it (and the end), parents of the fronts.

    Every box is cut by the row or column with the fewest nodes near its middle; only the nodes of that cut couple its
    two halves. A front comes after the fronts of both halves, the second half first.
    """
    n1, n2 = keep.shape
    # nodes above and left of a corner; twice the columns, so that a box may lie across the seam
    nodes = np.zeros((n1 + 1, 2 * n2 + 1), np.int64)
    for i in range(n1):
        in_row = 0
        for j in range(2 * n2):
            in_row += keep[i, j % n2]
            nodes[i + 1, j + 1] = nodes[i, j + 1] + in_row
    n = nodes[n1, n2]
    order = np.empty(n, np.int64)
    first = np.empty(n + 1, np.int64)
    parent = np.empty(n, np.int64)
    placed, fronts = 0, 0
    boxes = [(0, n1, 0, n2, periodic and n2 > 2, -1)]
    while len(boxes) > 0:
        a, b, c, d, ring, above = boxes.pop()
        inside = nodes[b, d] - nodes[a, d] - nodes[b, c] + nodes[a, c]
        if inside == 0:
            continue
        if inside > _LEAF:
            row, in_row = _thinnest(nodes, a, b, c, d)
            column, in_column = _thinnest(nodes.T, c, d, a, b)
            # of two equal cuts, take the one across the longer side
            along = in_row < in_column or (in_row == in_column and b - a >= d - c)
            if along:
                cut = row, row + 1, c, d
            else:
                cut = a, b, column, column + 1
        else:
            cut = a, b, c, d
        before = placed
        for i in range(cut[0], cut[1]):
            for j in range(cut[2], cut[3]):
                if keep[i, j % n2]:
                    order[placed] = i * n2 + j % n2
                    placed += 1
        if placed > before:
            first[fronts] = before
            parent[fronts] = above
            above = fronts
            fronts += 1
        if inside <= _LEAF:
            continue
        if along:
            boxes.append((a, row, c, d, ring, above))
            boxes.append((row + 1, b, c, d, ring, above))
        elif ring:
            boxes.append((a, b, (column + 1) % n2, (column + 1) % n2 + n2 - 1, False, above))
        else:
            boxes.append((a, b, c, column, False, above))
            boxes.append((a, b, column + 1, d, False, above))
    # from the leaves to the root
    starts = np.empty(fronts + 1, np.int64)
    parents = np.empty(fronts, np.int64)
    first[fronts] = n
    for f in range(fronts):
        g = fronts - 1 - f
        starts[f] = n - first[g + 1]
        parents[f] = fronts - 1 - parent[g] if parent[g] >= 0 else fronts
    starts[fronts] = n
    return order[::-1].copy(), starts, parents


@njit(**_exact)
def _thinnest(nodes, a, b, c, d):
    """Line with the fewest nodes in the middle third of a box, the one nearest to its middle, and its nodes."""
    middle = (a + b) // 2
    best, fewest = middle, nodes[b, d] + 1
    reach = (b - a) // 6
    for k in range(2 * reach + 1):
        i = middle + ((k + 1) // 2 if k % 2 else -(k // 2))
        if i < a or i >= b:
            continue
        here = nodes[i + 1, d] - nodes[i, d] - nodes[i + 1, c] + nodes[i, c]
        if here < fewest:
            best, fewest = i, here
    return best, fewest


@njit(**_exact)
def _borders(c1, c2, falling, rising, periodic, order, first, parent, rank):
    """Later nodes that each front is linked to, both ends last; the widest border, and the most links left over."""
    fronts = first.size - 1
    n = order.size
    border = np.empty(12 * n + 16, np.int64)
    start = np.zeros(fronts + 1, np.int64)
    seen = np.full(n, -1, np.int64)
    pending = np.empty(fronts + 1, np.int64)
    neighbour = np.empty(8, np.int64)
    link = np.empty(8)
    n_pending = 0
    size = 0
    width = 2
    top = 0
    waiting = 4
    for f in range(fronts):
        end = first[f + 1]
        most = size + 8 * (end - first[f]) + 2
        k = n_pending
        while k > 0 and parent[pending[k - 1]] == f:
            k -= 1
            most += start[pending[k] + 1] - start[pending[k]]
        if most > border.size:
            grown = np.empty(2 * most, np.int64)
            for i in range(size):
                grown[i] = border[i]
            border = grown
        for i in range(first[f], end):
            for m in range(_links(c1, c2, falling, rising, periodic, order[i], neighbour, link)):
                j = rank[neighbour[m]]
                if link[m] != 0.0 and end <= j < n and seen[j] != f:
                    seen[j] = f
                    border[size] = j
                    size += 1
        while n_pending > k:
            n_pending -= 1
            child = pending[n_pending]
            top -= (start[child + 1] - start[child]) ** 2
            for i in range(start[child], start[child + 1]):
                j = border[i]
                if end <= j < n and seen[j] != f:
                    seen[j] = f
                    border[size] = j
                    size += 1
        sort_places(border[start[f] : size])
        border[size], border[size + 1] = n, n + 1
        size += 2
        start[f + 1] = size
        q = size - start[f]
        width = max(width, q)
        top += q * q
        waiting = max(waiting, top)
        pending[n_pending] = f
        n_pending += 1
    return border, start, width, waiting


@njit(**_fast)
def _substitute(front, total, first, border, high, low):
    """Potentials of a front's pivots, means of those of their neighbours at the time they were eliminated."""
    p, q = total.size, border.size
    for i in range(p - 1, -1, -1):
        u = w = 0.0
        for j in range(q):
            u += front[i, p + j] * high[border[j]]
            w += front[i, p + j] * low[border[j]]
        for j in range(i + 1, p):
            u += front[i, j] * high[first + j]
            w += front[i, j] * low[first + j]
        if total[i] > 0.0:
            high[first + i] = u / total[i]
            low[first + i] = w / total[i]

"""Direct solution of a link network by star-mesh elimination, exact to rounding at any contrast.

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

#: Nodes that are eliminated together at the end of the dissection, about.
_LEAF = 16
#: Pivots eliminated one by one before what follows takes them as one product of matrices.
_PANEL = 32
#: Multiplications from which a product of matrices is left to BLAS.
_BLAS = 30_000

_exact: dict[str, Any] = {"cache": True, "nogil": True}
_fast: dict[str, Any] = {"cache": True, "nogil": True, "fastmath": {"reassoc", "contract", "arcp"}}


@njit(**_exact)
def eliminate(c1, c2, keep, periodic):
    """Conductance between inlet and outlet, and of each inner node the potential φ and 1 − φ.

    c1 (n1, n2), c2 (n1 − 1, n2 or n2 − 1) : conductances of the links as in `network`. keep (n1 − 1, n2) : the nodes
    that both ends reach; links to others must be closed. Other nodes get φ = 0 and 1 − φ = 0.
    """
    order, first, parent = _dissect(keep, periodic)
    n = order.size
    rank = np.full(keep.size, -1, np.int64)
    for i in range(n):
        rank[order[i]] = i
    border, border_start, width, waiting = _borders(c1, c2, periodic, order, first, parent, rank)
    fronts = first.size - 1
    inner_at = np.zeros(fronts + 1, np.int64)
    outer_at = np.zeros(fronts + 1, np.int64)
    for f in range(fronts):
        p = first[f + 1] - first[f]
        inner_at[f + 1] = inner_at[f] + p * p
        outer_at[f + 1] = outer_at[f] + p * (border_start[f + 1] - border_start[f] + 2)
    inner = np.zeros(inner_at[fronts])
    outer = np.zeros(outer_at[fronts])
    total = np.zeros(n)
    left = np.empty(waiting)  # links among the borders of fronts whose parents have not come yet
    work = np.zeros(width * width)
    local = np.zeros(keep.size + 2, np.int64)
    neighbour = np.empty(4, np.int64)
    link = np.empty(4)
    pending = np.empty(fronts + 1, np.int64)
    n_pending = 0
    top = 0
    for f in range(fronts):
        start, p = first[f], first[f + 1] - first[f]
        b = border_start[f + 1] - border_start[f]
        q = b + 2
        own = inner[inner_at[f] : inner_at[f + 1]].reshape(p, p)
        out = outer[outer_at[f] : outer_at[f + 1]].reshape(p, q)
        rest = work[: q * q].reshape(q, q)
        rest[:] = 0.0
        for i in range(p):
            local[order[start + i]] = i
        for i in range(b):
            local[border[border_start[f] + i]] = p + i
        local[keep.size], local[keep.size + 1] = p + b, p + b + 1
        for i in range(p):
            node = order[start + i]
            _links(c1, c2, periodic, node, neighbour, link)
            for k in range(4):
                if link[k] > 0.0 and (neighbour[k] >= keep.size or rank[neighbour[k]] > start + i):
                    j = local[neighbour[k]]
                    if j < p:
                        own[i, j] += link[k]
                    else:
                        out[i, j - p] += link[k]
        while n_pending > 0 and parent[pending[n_pending - 1]] == f:
            n_pending -= 1
            child = pending[n_pending]
            cb = border_start[child + 1] - border_start[child]
            top -= (cb + 2) ** 2
            _add(left[top : top + (cb + 2) ** 2].reshape(cb + 2, cb + 2), border[border_start[child] :], local,
                 keep.size, p, own, out, rest)  # fmt: skip
        _eliminate_front(own, out, rest, total[start : start + p])
        left[top : top + q * q] = rest.ravel()
        top += q * q
        pending[n_pending] = f
        n_pending += 1
    rate = 0.0
    while n_pending > 0:
        n_pending -= 1
        top -= 4
        rate += left[top + 1]
    high, low = np.zeros(keep.size + 2), np.zeros(keep.size + 2)
    high[keep.size] = low[keep.size + 1] = 1.0
    for f in range(fronts - 1, -1, -1):
        start, p = first[f], first[f + 1] - first[f]
        q = border_start[f + 1] - border_start[f] + 2
        own = inner[inner_at[f] : inner_at[f + 1]].reshape(p, p)
        out = outer[outer_at[f] : outer_at[f + 1]].reshape(p, q)
        _substitute(own, out, total[start : start + p], order[start : start + p], border[border_start[f] :], high, low)
    return rate, high[: keep.size], low[: keep.size]


@njit(**_exact)
def _links(c1, c2, periodic, node, neighbour, link):
    """Neighbours and conductances of an inner node: above, below, left and right; the ends come after all nodes."""
    n1, n2 = c1.shape
    inner = (n1 - 1) * n2
    i, j = node // n2, node % n2
    neighbour[0] = node - n2 if i > 0 else inner
    link[0] = c1[i, j]
    neighbour[1] = node + n2 if i < n1 - 2 else inner + 1
    link[1] = c1[i + 1, j]
    row = i * n2
    neighbour[2] = row + (j - 1) % n2
    link[2] = c2[i, (j - 1) % n2] if (periodic or j > 0) and n2 > 1 else 0.0
    neighbour[3] = row + (j + 1) % n2
    link[3] = c2[i, j] if (periodic or j < n2 - 1) and n2 > 1 else 0.0


@njit(**_exact)
def _dissect(keep, periodic):
    """Nested dissection: order of elimination, first place of each front in it and after the last, parents of the fronts.

    Every box is cut by the row or column with the fewest nodes near its middle; what it has in common with its
    neighbours is only that cut. Fronts come after all that they separate, the last of these first.
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
            # of cuts alike the one across the longer side
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
def _borders(c1, c2, periodic, order, first, parent, rank):
    """Nodes to be eliminated later that each front is linked to, the widest front, and the most values left over."""
    fronts = first.size - 1
    border = np.empty(8 * order.size + 16, np.int64)
    start = np.zeros(fronts + 1, np.int64)
    seen = np.full(rank.size, -1, np.int64)
    pending = np.empty(fronts + 1, np.int64)
    neighbour = np.empty(4, np.int64)
    link = np.empty(4)
    n_pending = 0
    size = 0
    width = 2
    top = 0
    waiting = 4
    for f in range(fronts):
        last = first[f + 1] - 1
        most = size + 4 * (first[f + 1] - first[f])
        k = n_pending
        while k > 0 and parent[pending[k - 1]] == f:
            k -= 1
            most += start[pending[k] + 1] - start[pending[k]]
        if most > border.size:
            grown = np.empty(2 * most, np.int64)
            grown[:size] = border[:size]
            border = grown
        for i in range(first[f], first[f + 1]):
            _links(c1, c2, periodic, order[i], neighbour, link)
            for m in range(4):
                if link[m] > 0.0 and neighbour[m] < rank.size:
                    j = neighbour[m]
                    if rank[j] > last and seen[j] != f:
                        seen[j] = f
                        border[size] = j
                        size += 1
        while n_pending > 0 and parent[pending[n_pending - 1]] == f:
            n_pending -= 1
            child = pending[n_pending]
            top -= (start[child + 1] - start[child] + 2) ** 2
            for i in range(start[child], start[child + 1]):
                j = border[i]
                if rank[j] > last and seen[j] != f:
                    seen[j] = f
                    border[size] = j
                    size += 1
        start[f + 1] = size
        q = size - start[f] + 2
        width = max(width, q)
        top += q * q
        waiting = max(waiting, top)
        pending[n_pending] = f
        n_pending += 1
    return border, start, width, waiting


@njit(**_exact)
def _add(links, nodes, local, ends, p, own, out, rest):
    """Links left over by a child into the arrays of its parent."""
    q = links.shape[0]
    at = np.empty(q, np.int64)
    for i in range(q):
        at[i] = local[nodes[i]] if i < q - 2 else local[ends + i - (q - 2)]
    for i in range(q):
        for j in range(i + 1, q):
            c = links[i, j]
            low, high = min(at[i], at[j]), max(at[i], at[j])
            if high < p:
                own[low, high] += c
            elif low < p:
                out[low, high - p] += c
            else:
                rest[low - p, high - p] += c


@njit(**_fast)
def _eliminate_front(own, out, rest, total):
    """Eliminate the pivots of a front: links among them (upper half), to its border, and within that (upper half)."""
    p, q = out.shape
    for start in range(0, p, _PANEL):
        end = min(start + _PANEL, p)
        for i in range(start, end):
            s = 0.0
            for j in range(i + 1, p):
                s += own[i, j]
            for j in range(q):
                s += out[i, j]
            total[i] = s
            for j in range(i + 1, end):
                if own[i, j] > 0.0:
                    f = own[i, j] / s
                    for k in range(j + 1, p):
                        own[j, k] += f * own[i, k]
                    for k in range(q):
                        out[j, k] += f * out[i, k]
        if end < p:
            later = own[start:end, end:].copy()
            shares = later.copy()
            for i in range(end - start):
                shares[i] /= total[start + i]
            own[end:, end:] += np.dot(shares.T, later)
            out[end:] += np.dot(shares.T, out[start:end])
    if p * q * q > _BLAS:
        shares = out.copy()
        for i in range(p):
            shares[i] /= total[i]
        rest += np.dot(shares.T, out)
    else:
        for i in range(p):
            for j in range(q):
                if out[i, j] > 0.0:
                    f = out[i, j] / total[i]
                    for k in range(j + 1, q):
                        rest[j, k] += f * out[i, k]


@njit(**_fast)
def _substitute(own, out, total, pivots, border, high, low):
    """Potentials of a front's pivots, means of those of their neighbours at the time they were eliminated."""
    p, q = out.shape
    ends = high.size - 2
    for i in range(p - 1, -1, -1):
        u = out[i, q - 2] * high[ends]
        w = out[i, q - 1] * low[ends + 1]
        for j in range(q - 2):
            u += out[i, j] * high[border[j]]
            w += out[i, j] * low[border[j]]
        for j in range(i + 1, p):
            u += own[i, j] * high[pivots[j]]
            w += own[i, j] * low[pivots[j]]
        if total[i] > 0.0:
            high[pivots[i]] = u / total[i]
            low[pivots[i]] = w / total[i]

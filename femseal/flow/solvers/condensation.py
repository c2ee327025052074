"""Condensation of a window of a link network to the points of its sides, by star-mesh elimination.

What is left are couples >= 0 of the side points: the window's operator without its inner nodes, its Schur complement.
As nothing is ever subtracted, they keep their relative accuracy at any contrast, and two side points have a couple only
if open links inside the window join them. Order and fronts are those of `elimination`.
Source: Guyan, AIAA J. 3, 1965, 380 (static condensation).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from ..percolation import find, union
from .elimination import dissect
from .fronts import eliminate_front, gather, leave, sort_places

_exact: dict[str, Any] = {"cache": True, "nogil": True}


@njit(**_exact)
def condense(c1, c2):
    """Couples of the side points of a window, and the component to which each of them belongs inside the window.

    Parameters
    ----------
    c1 (w1 + 1, w2), c2 (w1, w2 + 1) : conductances of the links along both axes of w1 × w2 nodes; the first and the
        last ones along an axis lead to the points of the window's sides.

    Returns
    -------
    couples (p, p) of the p = 2 w1 + 2 w2 side points: those before the first row of nodes, after the last row, before
        the first column, and after the last column. Symmetric, >= 0, 0 on the diagonal.
    component (p,) : side points with the same number are joined by open links.
    """
    w1, w2 = c2.shape[0], c1.shape[1]
    nodes, points = w1 * w2, 2 * (w1 + w2)
    component = components(c1, c2)
    joined = np.zeros(nodes + points, np.bool_)  # whether a component reaches a side
    for t in range(nodes, nodes + points):
        joined[component[t]] = True
    keep = np.empty((w1, w2), np.bool_)
    for node in range(nodes):
        keep[node // w2, node % w2] = joined[component[node]]
    couples = np.zeros((points, points))
    order, first, parent = dissect(keep, False)
    n, fronts = order.size, first.size - 1
    if n == 0:
        return couples, component[nodes:].copy()
    rank = np.full(nodes + points, -1, np.int64)
    for i in range(n):
        rank[order[i]] = i
    for t in range(points):
        rank[nodes + t] = n + t
    border, start, widest, waiting = _borders(c1, c2, order, first, parent, rank)
    left = np.empty(waiting)  # couples within the borders of fronts whose parents have not come yet
    work = np.empty(widest)
    total = np.empty(n)
    local = np.zeros(n + points, np.int64)
    neighbour, link = np.empty(4, np.int64), np.empty(4)
    pending = np.empty(fronts + 1, np.int64)
    n_pending, top = 0, 0
    for f in range(fronts):
        a, p, q = first[f], first[f + 1] - first[f], start[f + 1] - start[f]
        front = work[: p * (p + q)].reshape(p, p + q)
        front[:] = 0.0
        rest = work[p * (p + q) : p * (p + q) + q * q].reshape(q, q)
        rest[:] = 0.0
        for i in range(p):
            local[a + i] = i
        for i in range(q):
            local[border[start[f] + i]] = p + i
        for i in range(p):
            _links(c1, c2, order[a + i], neighbour, link)
            for k in range(4):
                if link[k] > 0.0 and rank[neighbour[k]] > a + i:
                    front[i, local[rank[neighbour[k]]]] += link[k]
        n_pending, top = gather(f, parent, pending, n_pending, border, start, left, top, local, front, rest)
        eliminate_front(front, rest, total[a : a + p])
        top = leave(rest, left, top)
        pending[n_pending] = f
        n_pending += 1
    while n_pending > 0:
        n_pending -= 1
        child = pending[n_pending]
        m = start[child + 1] - start[child]
        top -= m * m
        for i in range(m):
            for j in range(i + 1, m):
                s, t = border[start[child] + i] - n, border[start[child] + j] - n
                couples[s, t] += left[top + i * m + j]
                couples[t, s] = couples[s, t]
    return couples, component[nodes:].copy()


@njit(**_exact)
def _links(c1, c2, node, neighbour, link):
    """Neighbours of a node and the links to them: above, below, left and right; side points follow all nodes."""
    w1, w2 = c2.shape[0], c1.shape[1]
    i, j = node // w2, node % w2
    points = w1 * w2
    neighbour[0] = node - w2 if i > 0 else points + j
    link[0] = c1[i, j]
    neighbour[1] = node + w2 if i < w1 - 1 else points + w2 + j
    link[1] = c1[i + 1, j]
    neighbour[2] = node - 1 if j > 0 else points + 2 * w2 + i
    link[2] = c2[i, j]
    neighbour[3] = node + 1 if j < w2 - 1 else points + 2 * w2 + w1 + i
    link[3] = c2[i, j + 1]


@njit(**_exact)
def components(c1, c2):
    """Component of every node and side point, by the lowest number among them."""
    w1, w2 = c2.shape[0], c1.shape[1]
    nodes = w1 * w2
    parent = np.arange(nodes + 2 * (w1 + w2))
    neighbour, link = np.empty(4, np.int64), np.empty(4)
    for node in range(nodes):
        _links(c1, c2, node, neighbour, link)
        for k in range(4):
            if link[k] > 0.0:
                union(parent, node, neighbour[k])
    for node in range(parent.size):
        parent[node] = find(parent, node)
    return parent


@njit(**_exact)
def _borders(c1, c2, order, first, parent, rank):
    """Later nodes and side points that each front is linked to, the most numbers of a front, and the most left over."""
    fronts = first.size - 1
    n = order.size
    border = np.empty(12 * n + 16, np.int64)
    start = np.zeros(fronts + 1, np.int64)
    seen = np.full(int(rank.max()) + 1, -1, np.int64)
    pending = np.empty(fronts + 1, np.int64)
    neighbour, link = np.empty(4, np.int64), np.empty(4)
    n_pending, size, top = 0, 0, 0
    widest, waiting = 0, 0
    for f in range(fronts):
        end = first[f + 1]
        most = size + 4 * (end - first[f])
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
            _links(c1, c2, order[i], neighbour, link)
            for m in range(4):
                j = rank[neighbour[m]]
                if link[m] > 0.0 and j >= end and seen[j] != f:
                    seen[j] = f
                    border[size] = j
                    size += 1
        while n_pending > k:
            n_pending -= 1
            child = pending[n_pending]
            top -= (start[child + 1] - start[child]) ** 2
            for i in range(start[child], start[child + 1]):
                j = border[i]
                if j >= end and seen[j] != f:
                    seen[j] = f
                    border[size] = j
                    size += 1
        sort_places(border[start[f] : size])
        start[f + 1] = size
        p, q = end - first[f], size - start[f]
        widest = max(widest, p * (p + q) + q * q)
        top += q * q
        waiting = max(waiting, top)
        pending[n_pending] = f
        n_pending += 1
    return border, start, widest, waiting

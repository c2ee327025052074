"""Clusters of nodes that a coarser grid cannot move: found on a level of multigrid, and relaxed as one: compiled.

A node between coarse ones follows them over its own conductances. Where these are weak against those to other such
nodes, as in a bay behind a narrow mouth or in a channel that no coarse node lies on, neither the coarser grid nor a
sweep of Gauss-Seidel changes the potential that such nodes have in common, and each cluster costs conjugate gradients
several iterations. All nodes of a cluster are therefore moved by one amount, after which what flows out of it balances:
a correction in the subspace of its indicator. Levels and conductances are as in `hierarchy`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.compiled import REORDERED, compiled, inner

#: A node is strong if coarse nodes, or others that are strong, have this fraction of its conductances.
_STRONG = 0.1
#: Strength passes over so many nodes.
_STEPS = 2
#: Nodes are of one cluster if their conductance has this fraction of all conductances of one of them.
_TIED = 0.1
#: What the centre has beyond all conductances is taken for a rounding error below this fraction.
_ROUNDING = 1e-10


@inner(**REORDERED, inline="always")
def _conductance(k, i, j, right, below, below_right, below_left):
    """Row, column and conductance of the k-th neighbour of a node; the last four are those across corners."""
    if k == 0:
        return i, j + 1, right[i, j]
    if k == 1:
        return i, j - 1, right[i, j - 1]
    if k == 2:
        return i + 1, j, below[i, j]
    if k == 3:
        return i - 1, j, below[i - 1, j]
    if k == 4:
        return i + 1, j + 1, below_right[i, j]
    if k == 5:
        return i - 1, j - 1, below_right[i - 1, j - 1]
    if k == 6:
        return i + 1, j - 1, below_left[i, j]
    return i - 1, j + 1, below_left[i - 1, j + 1]


@inner(**REORDERED)
def _not_strong(centre, right, below, below_right, below_left, nine, ring):
    """Nodes with weak conductances to coarse nodes, and to nodes between two that have strong ones."""
    n1, n2 = centre.shape[0] - 2, centre.shape[1] - 2
    strong = np.ones(centre.shape, np.bool_)
    count = 0
    for i in range(1, n1 + 1):
        if i % 2 == 1:
            for j in range(2, n2 + 1, 2):
                strong[i, j] = right[i, j - 1] + right[i, j] >= _STRONG * centre[i, j]
                count += not strong[i, j]
        else:
            for j in range(1, n2 + 1, 2):
                strong[i, j] = below[i - 1, j] + below[i, j] >= _STRONG * centre[i, j]
                count += not strong[i, j]
        if ring:
            strong[i, 0], strong[i, n2 + 1] = strong[i, n2], strong[i, 1]
    for i in range(2, n1 + 1, 2):
        for j in range(2, n2 + 1, 2):
            by = 0.0
            if strong[i, j - 1]:
                by += right[i, j - 1]
            if strong[i, j + 1]:
                by += right[i, j]
            if strong[i - 1, j]:
                by += below[i - 1, j]
            if strong[i + 1, j]:
                by += below[i, j]
            if nine:
                by += below_right[i, j] + below_right[i - 1, j - 1] + below_left[i, j] + below_left[i - 1, j + 1]
            strong[i, j] = by >= _STRONG * centre[i, j]
            count += not strong[i, j]
    found = np.empty((count, 2), np.int32)
    if count > 0:
        count = 0
        for i in range(1, n1 + 1):
            for j in range(1, n2 + 1):
                if not strong[i, j]:
                    found[count, 0], found[count, 1] = i, j
                    count += 1
    return found


@inner(**REORDERED)
def _copied(field, i, j, ring):
    """Copy a value at the first or last column to the border, around a ring."""
    n2 = field.shape[1] - 2
    if ring:
        if j == 1:
            field[i, n2 + 1] = field[i, 1]
        if j == n2:
            field[i, 0] = field[i, n2]


@compiled(**REORDERED)
def clusters(centre, right, below, below_right, below_left, nine, ring):
    """Nodes by cluster, first places, bits of neighbours outside, conductances with the ends, inverse sums.

    The sums are of the conductances of a cluster with other nodes and with the ends.
    """
    n2 = centre.shape[1] - 2
    neighbours = 8 if nine else 4
    loose = _not_strong(centre, right, below, below_right, below_left, nine, ring)
    if loose.shape[0] < 2:
        return loose[:0], np.zeros(1, np.int64), np.zeros(0, np.uint8), np.zeros(0, np.float32), np.zeros(0, np.float32)
    number = np.zeros(centre.shape, np.int32)
    for q in range(loose.shape[0]):
        i, j = loose[q]
        number[i, j] = -1
        _copied(number, i, j, ring)
    strong = np.empty(loose.shape[0], np.bool_)
    for _ in range(_STEPS):
        for q in range(loose.shape[0]):
            i, j = loose[q]
            by_strong = 0.0
            for k in range(neighbours):
                a, b, c = _conductance(k, i, j, right, below, below_right, below_left)
                if number[a, b] == 0:
                    by_strong += c
            strong[q] = by_strong >= _STRONG * centre[i, j]
        count = 0
        for q in range(loose.shape[0]):
            i, j = loose[q]
            if strong[q]:
                number[i, j] = 0
                _copied(number, i, j, ring)
            else:
                loose[count, 0], loose[count, 1] = i, j
                count += 1
        loose = loose[:count]
    nodes = np.empty(loose.shape, np.int32)
    first = np.zeros(loose.shape[0] + 1, np.int64)
    found, size = 0, 0
    for q in range(loose.shape[0]):
        if number[loose[q, 0], loose[q, 1]] != -1:
            continue
        start = size
        nodes[size, 0], nodes[size, 1] = loose[q]
        size += 1
        number[loose[q, 0], loose[q, 1]] = found + 1
        m = start
        while m < size:
            i, j = nodes[m]
            m += 1
            for k in range(neighbours):
                a, b, c = _conductance(k, i, j, right, below, below_right, below_left)
                b = n2 if b == 0 else (1 if b == n2 + 1 else b)
                if c > 0.0 and number[a, b] == -1 and c >= _TIED * min(centre[i, j], centre[a, b]):
                    number[a, b] = found + 1
                    nodes[size, 0], nodes[size, 1] = a, b
                    size += 1
        if size == start + 1:  # a sweep moves single nodes
            number[loose[q, 0], loose[q, 1]] = 0
            size = start
        else:
            found += 1
            first[found] = size
    for m in range(size):
        _copied(number, nodes[m, 0], nodes[m, 1], ring)
    for q in range(loose.shape[0]):
        _copied(number, loose[q, 0], loose[q, 1], ring)
    inverse, outside, ground = np.zeros(found, np.float32), np.zeros(size, np.uint8), np.zeros(size, np.float32)
    for s in range(found):
        total = 0.0
        for m in range(first[s], first[s + 1]):
            i, j = nodes[m]
            beyond = centre[i, j]
            for k in range(neighbours):
                a, b, c = _conductance(k, i, j, right, below, below_right, below_left)
                beyond -= c
                if c != 0.0 and number[a, b] != s + 1:
                    outside[m] |= 1 << k
                    total += c
            if beyond > _ROUNDING * centre[i, j]:
                ground[m] = beyond
                total += beyond
        inverse[s] = 1.0 / total if total > 1e-30 else 0.0
    return nodes[:size].copy(), first[: found + 1].copy(), outside, ground, inverse


def no_clusters(levels: int) -> tuple[NDArray[Any], ...]:
    """What `Levels` of so many levels has of clusters, before there are any."""
    none = np.zeros(0, np.float32)
    first = np.zeros(levels, np.int64)
    return first, np.zeros(1, np.int64), np.zeros((0, 2), np.int32), np.zeros(0, np.uint8), none, none


@compiled(**REORDERED)
def with_clusters(found, k, nodes, start, outside, ground, inverse):
    """What `Levels` has of clusters with those of level k, the last one that has any."""
    first, starts, all_nodes, all_outside, all_ground, all_inverse = found
    first[k + 1] = first[k] + inverse.size
    if inverse.size == 0:
        return found
    return (
        first,
        np.concatenate((starts[:-1], start + all_nodes.shape[0])),
        np.concatenate((all_nodes, nodes)),
        np.concatenate((all_outside, outside)),
        np.concatenate((all_ground, ground)),
        np.concatenate((all_inverse, inverse)),
    )


@compiled(**REORDERED)
def relax_forward(nodes, start, outside, ground, inverse, x, r, right, below, below_right, below_left, ring):
    """Move the clusters in turn by their residuals r, which are kept up to date."""
    n2 = x.shape[1] - 2
    for s in range(inverse.size):
        total = 0.0
        for m in range(start[s], start[s + 1]):
            total += r[nodes[m, 0], nodes[m, 1]]
        step = total * inverse[s]
        for m in range(start[s], start[s + 1]):
            i, j = nodes[m, 0], nodes[m, 1]
            x[i, j] += step
            _copied(x, i, j, ring)
            out = ground[m]
            for q in range(8):
                if outside[m] >> q & 1:
                    a, b, c = _conductance(q, i, j, right, below, below_right, below_left)
                    out += c
                    b = n2 if b == 0 else (1 if b == n2 + 1 else b)
                    r[a, b] += step * c
                    _copied(r, a, b, ring)
            r[i, j] -= step * out
            _copied(r, i, j, ring)


@compiled(**REORDERED)
def relax_backward(nodes, start, outside, ground, inverse, x, right_hand, right, below, below_right, below_left, ring):
    """Move the clusters in reverse, from x and the right-hand side."""
    for s in range(inverse.size - 1, -1, -1):
        total = 0.0
        for m in range(start[s], start[s + 1]):
            i, j = nodes[m, 0], nodes[m, 1]
            total += right_hand[i, j] - ground[m] * x[i, j]
            for q in range(8):
                if outside[m] >> q & 1:
                    a, b, c = _conductance(q, i, j, right, below, below_right, below_left)
                    total -= c * (x[i, j] - x[a, b])
        step = total * inverse[s]
        for m in range(start[s], start[s + 1]):
            x[nodes[m, 0], nodes[m, 1]] += step
            _copied(x, nodes[m, 0], nodes[m, 1], ring)

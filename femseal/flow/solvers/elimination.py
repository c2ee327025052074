"""Star-mesh elimination: the one kernel by which nodes of a network are eliminated, exact to rounding at any contrast.

Eliminating node i joins its neighbours j, k by c_jk += c_ij c_ik / Σ_l c_il. Nothing is ever subtracted, so what
links the nodes that stay, and the potentials, keep their relative accuracy however small a constriction is; a
factorisation of the assembled matrix loses it, as weak links vanish in the diagonal sums.

Nodes are eliminated front by front: all nodes of a front with all their neighbours in one dense array (multifrontal).
Sources: Grassmann, Taksar & Heyman, Oper. Res. 33, 1985, 1107 (no subtractions); Duff & Reid, ACM TOMS 9, 1983, 302.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...base import Array, Indices
from ...base.compiled import compiled, inner

#: Pivots eliminated one by one before what follows takes them as one product of matrices.
_PANEL = 32
#: Nodes that stay: inlet and outlet.
_STAY = 2
#: Multiplications from which a product of matrices is left to BLAS.
_BLAS = 30_000

_exact: dict[str, Any] = {"error_model": "numpy"}
_fast: dict[str, Any] = {**_exact, "fastmath": {"reassoc", "contract"}}


class Order(NamedTuple):
    """Order in which nodes are eliminated, front by front.

    nodes (n,) : numbers of the nodes in order. first (fronts + 1,) : place of the first node of each front, and n.
    parent (fronts,) : the first later front that a front is linked to. The fronts of one parent are the last ones
        before it that have no parent yet.
    """

    nodes: Indices
    first: Indices
    parent: Indices


class Links(NamedTuple):
    """Links of the nodes in their order, each kept at the one of its two nodes that is eliminated first.

    row (n + 1,) : where the links of each node start. later : place in the order of the other node; nodes that stay
    follow the n that are eliminated. value : conductances; links between two nodes add up.
    """

    row: Indices
    later: Indices
    value: Array


class Network(NamedTuple):
    """A network to eliminate, of `Order` and `Links`, and what the elimination takes.

    border : later places that each front is linked to. start (fronts + 1,) : where those of each front start. at
    (fronts + 1,) : where the links of each front start once it is eliminated. waiting : most numbers that are left over
    for later fronts. widest : the longest border.
    """

    first: Indices
    parent: Indices
    links: Links
    border: Indices
    start: Indices
    at: Indices
    waiting: int
    widest: int


class Factors(NamedTuple):
    """The eliminated network; places are those of `Order`, the nodes that stay follow.

    first, border, start, at : see `Network`. links : of the nodes at the time they were eliminated, front by front.
    inverse (n,) : 1 over the sum of these, or 0.
    between : what links the two nodes that stay, through those eliminated.
    """

    first: Indices
    border: Indices
    start: Indices
    at: Indices
    links: Array
    inverse: Array
    between: float


@compiled(**_exact)
def _network_of(order, of_nodes):
    """`Network` of an order and links."""
    _, first, parent = order
    row, later, _ = of_nodes
    fronts = first.size - 1
    n = first[fronts]
    border = np.empty(12 * n + 16, np.int64)
    start = np.zeros(fronts + 1, np.int64)
    seen = np.empty(n + _STAY, np.int64)
    for i in range(n + _STAY):
        seen[i] = -1
    pending = np.empty(fronts + 1, np.int64)
    n_pending, size, top, waiting, widest = 0, 0, 0, 0, 0
    for f in range(fronts):
        end = first[f + 1]
        most = size + row[end] - row[first[f]]
        k = n_pending
        while k > 0 and parent[pending[k - 1]] == f:
            k -= 1
            most += start[pending[k] + 1] - start[pending[k]]
        if most > border.size:
            grown = np.empty(2 * most, np.int64)
            for i in range(size):
                grown[i] = border[i]
            border = grown
        for m in range(row[first[f]], row[end]):
            j = later[m]
            if j >= end and seen[j] != f:
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
        border[start[f] : size].sort()
        start[f + 1] = size
        q = size - start[f]
        widest = max(widest, q)
        top += q * q
        waiting = max(waiting, top)
        pending[n_pending] = f
        n_pending += 1
    at = np.zeros(fronts + 1, np.int64)
    for f in range(fronts):
        p = first[f + 1] - first[f]
        at[f + 1] = at[f] + p * (p + start[f + 1] - start[f])
    return Network(first, parent, of_nodes, border, start, at, waiting, widest)


@compiled(**_exact)
def factored(order, of_nodes):
    """`Factors` of all nodes of an order, after whose elimination only two are left."""
    network = _network_of(order, of_nodes)
    first, parent, (row, later, link), border, start, at, waiting, widest = network
    n, fronts = first[-1], first.size - 1
    links, inverse = np.empty(at[-1]), np.empty(n)
    left = np.empty(waiting)  # links within the borders of fronts whose parents have not come yet
    work = np.empty(widest * widest)
    local = np.empty(n + _STAY, np.int64)
    places = np.empty(widest, np.int64)
    pending = np.empty(fronts + 1, np.int64)
    n_pending, top = 0, 0
    for f in range(fronts):
        a, p, q = first[f], first[f + 1] - first[f], start[f + 1] - start[f]
        front = links[at[f] : at[f] + p * (p + q)].reshape(p, p + q)
        rest = work[: q * q].reshape(q, q)
        links[at[f] : at[f] + p * (p + q)] = 0.0
        work[: q * q] = 0.0
        for i in range(p):
            local[a + i] = i
        for i in range(q):
            local[border[start[f] + i]] = p + i
        for i in range(p):
            for k in range(row[a + i], row[a + i + 1]):
                front[i, local[later[k]]] += link[k]
        # what earlier fronts left; both number their nodes in the same order
        while n_pending > 0 and parent[pending[n_pending - 1]] == f:
            n_pending -= 1
            nodes = border[start[pending[n_pending]] : start[pending[n_pending] + 1]]
            m = nodes.size
            top -= m * m
            for i in range(m):
                places[i] = local[nodes[i]]
            for i in range(m):
                here = places[i]
                if here < p:
                    for j in range(i + 1, m):
                        front[here, places[j]] += left[top + i * m + j]
                else:
                    for j in range(i + 1, m):
                        rest[here - p, places[j] - p] += left[top + i * m + j]
        _eliminate_front(front, rest, inverse[a : a + p])
        for i in range(q * q):
            left[top + i] = work[i]
        top += q * q
        pending[n_pending] = f
        n_pending += 1
    between = 0.0
    for k in range(n_pending - 1, -1, -1):
        m = start[pending[k] + 1] - start[pending[k]]
        top -= m * m
        if m == _STAY:
            between += left[top + 1]
    return Factors(first, border, start, at, links, inverse, between)


@inner(**_fast)
def _eliminate_front(front, rest, inverse):
    """Eliminate the pivots of a front, the rows of `front`; links to later nodes only, also within its border."""
    p, q = inverse.size, rest.shape[0]
    for start in range(0, p, _PANEL):
        end = min(start + _PANEL, p)
        for i in range(start, end):
            total = 0.0
            for j in range(i + 1, p + q):
                total += front[i, j]
            inverse[i] = 1.0 / total if total != 0.0 else 0.0
            for j in range(i + 1, end):
                f = front[i, j] * inverse[i]
                if f != 0.0:
                    for k in range(j + 1, p + q):
                        front[j, k] += f * front[i, k]
        if end < p:
            _add_product(front, inverse, start, end, end, p - end, front, end)
    if p * q * q > _BLAS:
        _add_product(front, inverse, np.int64(0), p, p, q, rest, np.int64(0))
        return
    for i in range(0, p, 2):  # two pivots at once
        after = min(i + 1, p - 1)
        second = inverse[after] if i + 1 < p else 0.0
        for j in range(q):
            f, g = inverse[i] * front[i, p + j], second * front[after, p + j]
            for k in range(j + 1, q):
                rest[j, k] += f * front[i, p + k] + g * front[after, p + k]


@inner(**_fast)
def _add_product(front, inverse, start, end, column, rows, out, first):
    """Add what some pivots join beyond a column to rows of `out`, from its row and column `first` on."""
    count, columns = end - start, front.shape[1] - column
    later, fractions = np.empty((count, columns)), np.empty((rows, count))
    for i in range(count):
        for j in range(columns):
            later[i, j] = front[start + i, column + j]
        for j in range(rows):
            fractions[j, i] = later[i, j] * inverse[start + i]
    product = np.dot(fractions, later)
    for i in range(rows):
        for j in range(columns):
            out[first + i, first + j] += product[i, j]


@compiled(**_fast)
def find_potentials(factors, v, w):
    """Write two potentials (n + 2,), given for the nodes that stay, to the others: at once, as reading the links takes
    most of the time.

    That of a node is the mean of those of its neighbours at the time it was eliminated.
    """
    first, border, start, at, links, inverse, _ = factors
    for f in range(first.size - 2, -1, -1):
        a, p, q = first[f], first[f + 1] - first[f], start[f + 1] - start[f]
        later = border[start[f] : start[f + 1]]
        for i in range(p - 1, -1, -1):
            row = at[f] + i * (p + q)
            x = y = 0.0
            for j in range(i + 1, p):
                x += links[row + j] * v[a + j]
                y += links[row + j] * w[a + j]
            for j in range(q):
                x += links[row + p + j] * v[later[j]]
                y += links[row + p + j] * w[later[j]]
            v[a + i], w[a + i] = x * inverse[a + i], y * inverse[a + i]

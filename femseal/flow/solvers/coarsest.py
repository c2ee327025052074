"""The coarsest level of multigrid: eliminated once, solved for many right-hand sides; the ends are one node, at 0."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Array
from ...base.compiled import compiled, inner
from ...base.threads import over
from .elimination import (
    Factors,
    Links,
    Order,
    carry_from,
    carry_sources,
    eliminated,
    eliminated_fronts,
    factors_of,
    find_on,
    find_potentials,
    network_of,
)
from .hierarchy import FEWEST
from .link_network import dissect, grid_links

#: What the centre has beyond all conductances is taken for a rounding error below this fraction.
_ROUNDING = 1e-13
#: Fronts that threads share are parts of no more than this fraction of the links.
_PART = 0.3


def coarsest_nodes(n1: int, n2: int) -> int:
    """Nodes of the coarsest level for n1 × n2 unknowns; many if the network is slender."""
    while min(n1, n2) > FEWEST:
        n1, n2 = (n1 + 1) // 2, (n2 + 1) // 2
    return n1 * n2


class Coarsest(NamedTuple):
    """The eliminated level: numbers of its nodes in their order, factors, and room for potentials in that order.

    parts (…, 2) : first and last + 1 of the fronts of parts, which are linked by later ones only.
    """

    nodes: NDArray[np.int64]
    factors: Factors
    work: Array
    parts: NDArray[np.int64]


@compiled()
def eliminate_coarsest(centre, right, below, below_right, below_left, ring):
    """Eliminate an operator, given with a border of one node, on its nodes that have links."""
    nodes, parts, network = _dissected(centre, right, below, below_right, below_left, ring)
    return Coarsest(nodes, eliminated(network), np.zeros(nodes.size + 1), parts)


def eliminate_by_parts(*operator: Any) -> Coarsest:
    """`eliminate_coarsest`, with threads on the parts."""
    nodes, parts, network = _dissected(*operator)
    links, inverse = np.empty(network.at[-1]), np.empty(nodes.size)
    written = network, links, inverse
    left = [
        of_part
        for of_part, _ in over(parts.tolist(), eliminated_fronts, parts[:0], inverse[:0], *written)
    ]
    rest = eliminated_fronts(
        0, len(network.at) - 1, parts, np.concatenate([*left, inverse[:0]]), *written
    )
    return Coarsest(nodes, factors_of(*written, *rest), np.zeros(nodes.size + 1), parts)


@compiled()
def _dissected(centre, right, below, below_right, below_left, ring):
    """Order of the nodes of an operator, `Coarsest.parts`, and the network of them."""
    n1, n2 = centre.shape[0] - 2, centre.shape[1] - 2
    nine = below_right.size > 1
    m2 = n2 if ring else n2 - 1
    c1, c2 = np.zeros((n1 + 1, n2)), np.zeros((n1, m2))
    corners = (n1 + 1, m2) if nine else (0, 0)
    falling, rising = np.zeros(corners), np.zeros(corners)
    keep = np.zeros((n1, n2), np.bool_)
    node, end, link = np.empty(n1 * n2, np.int64), np.zeros(n1 * n2, np.int64), np.empty(n1 * n2)
    count = 0
    for i in range(1, n1 + 1):
        for j in range(1, n2 + 1):
            rest = centre[i, j] - right[i, j] - right[i, j - 1] - below[i, j] - below[i - 1, j]
            if nine:
                rest -= (
                    below_right[i, j]
                    + below_right[i - 1, j - 1]
                    + below_left[i, j]
                    + below_left[i - 1, j + 1]
                )
                if j <= m2 and i < n1:
                    falling[i, j - 1] = below_right[i, j]
                    rising[i, j - 1] = below_left[i, j % n2 + 1]
            keep[i - 1, j - 1] = centre[i, j] > 0.0
            if centre[i, j] > 0.0 and rest > _ROUNDING * centre[i, j]:
                node[count], link[count] = (i - 1) * n2 + j - 1, rest
                count += 1
            if i < n1:
                c1[i, j - 1] = below[i, j]
            if j <= m2:
                c2[i - 1, j - 1] = right[i, j]
    order = Order(*dissect(keep, ring))
    ends = node[:count], end[:count], link[:count]
    links = Links(*grid_links(c1, c2, falling, rising, ring, order.nodes, *ends))
    network = network_of(order, links, np.int64(1))
    return order.nodes, _parts(order.parent, network.at), network


@inner()
def _parts(parent, at):
    """Parts of fronts, see `Coarsest`: the largest trees of them that are small enough."""
    fronts = parent.size
    earliest = np.arange(fronts)
    for f in range(fronts):
        if parent[f] < fronts:
            earliest[parent[f]] = min(earliest[parent[f]], earliest[f])
    parts = np.empty((fronts, 2), np.int64)
    count = 0
    most = _PART * at[fronts]
    for f in range(fronts):
        above = parent[f]
        is_small = at[f + 1] - at[earliest[f]] <= most
        if is_small and (above == fronts or at[above + 1] - at[earliest[above]] > most):
            parts[count, 0], parts[count, 1] = earliest[f], f + 1
            count += 1
    return parts[:count].copy()


@compiled()
def solve_coarsest(coarsest, b, x):
    """x of the level from its right-hand side b, both with a border."""
    nodes, factors, v, _ = coarsest
    n = nodes.size
    _take(nodes, 0, n, b, v)
    carry_sources(factors, v)
    v[n] = 0.0
    find_potentials(factors, v)
    _put(nodes, 0, n, v, x)


@inner()
def _take(nodes, begin, end, b, v):
    """Write what b has at some nodes to v."""
    n2 = b.shape[1] - 2
    for i in range(begin, end):
        v[i] = b[nodes[i] // n2 + 1, nodes[i] % n2 + 1]


@inner()
def _put(nodes, begin, end, v, x):
    """Write what v has at some nodes to x."""
    n2 = x.shape[1] - 2
    for i in range(begin, end):
        x[nodes[i] // n2 + 1, nodes[i] % n2 + 1] = v[i]


@compiled()
def _carry_part(begin, end, beyond, coarsest, b):
    """Carry the sources of a part on, and to `beyond`, which is 0 at first, where they leave it."""
    nodes, factors, v, _ = coarsest
    _take(nodes, factors.first[begin], factors.first[end], b, v)
    carry_from(factors, begin, end, v, beyond)


@compiled()
def _between_parts(coarsest, beyond, b, x):
    """Potentials of the fronts of no part, from what the parts carry beyond them."""
    nodes, factors, v, parts = coarsest
    first, border, start = factors.first, factors.border, factors.start
    last = parts.shape[0]
    fronts = np.empty((last + 1, 2), np.int64)
    fronts[0, 0], fronts[last, 1] = 0, first.size - 1
    fronts[1:, 0], fronts[:last, 1] = parts[:, 1], parts[:, 0]
    for begin, end in fronts:
        _take(nodes, first[begin], first[end], b, v)
    for k in range(last):
        f = parts[k, 1] - 1
        for place in border[start[f] : start[f + 1]]:
            v[place] += beyond[k, place]
    for begin, end in fronts:
        carry_from(factors, begin, end, v, v)
    v[nodes.size] = 0.0
    for begin, end in fronts[::-1]:
        find_on(factors, begin, end, v, v[:0])
        _put(nodes, first[begin], first[end], v, x)


@compiled()
def _find_part(begin, end, _, coarsest, x):
    """Potentials of a part from those of later fronts."""
    nodes, factors, v, _ = coarsest
    find_on(factors, begin, end, v, v[:0])
    _put(nodes, factors.first[begin], factors.first[end], v, x)


def solve_by_parts(coarsest: Coarsest, b: NDArray[np.float32], x: NDArray[np.float32]) -> None:
    """`solve_coarsest`, with threads on the parts."""
    beyond = np.zeros((len(coarsest.parts), coarsest.work.size))
    parts = [(*part, row) for part, row in zip(coarsest.parts.tolist(), beyond, strict=True)]
    over(parts, _carry_part, coarsest, b)
    _between_parts(coarsest, beyond, b, x)
    over(parts, _find_part, coarsest, x)

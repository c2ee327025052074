"""The coarsest level of multigrid: eliminated once, solved for many right-hand sides; the ends are one node, at 0."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ...base.arrays import Array
from .elimination import Factors, borders, carry_sources, eliminated, find_potentials
from .hierarchy import FEWEST
from .link_network import dissect, grid_links

#: What the centre has beyond all conductances is taken for a rounding error below this fraction.
_ROUNDING = 1e-13


def coarsest_nodes(n1: int, n2: int) -> int:
    """Nodes of the coarsest level for n1 × n2 unknowns; many if the network is slender."""
    while min(n1, n2) > FEWEST:
        n1, n2 = (n1 + 1) // 2, (n2 + 1) // 2
    return n1 * n2


class Coarsest(NamedTuple):
    """The eliminated level: numbers of its nodes in their order, factors, and room for potentials in that order."""

    nodes: NDArray[np.int64]
    factors: Factors
    work: Array


@njit(cache=True, nogil=True)
def eliminate_coarsest(centre, right, below, below_right, below_left, ring):
    """Eliminate an operator, given with a border of one node, on its nodes that have links."""
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
                rest -= below_right[i, j] + below_right[i - 1, j - 1] + below_left[i, j] + below_left[i - 1, j + 1]
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
    order, first, parent = dissect(keep, ring)
    row, later, value = grid_links(c1, c2, falling, rising, ring, order, node[:count], end[:count], link[:count])
    border, start, waiting, widest = borders(first, parent, row, later, np.int64(1))
    at = np.zeros(first.size, np.int64)
    for f in range(first.size - 1):
        p = first[f + 1] - first[f]
        at[f + 1] = at[f] + p * (p + start[f + 1] - start[f])
    links, inverse, between = eliminated(
        first, parent, row, later, value, border, start, at, at[first.size - 1], waiting, widest, np.int64(1)
    )
    return Coarsest(order, Factors(first, border, start, at, links, inverse, between), np.zeros(order.size + 1))


@njit(cache=True, nogil=True)
def solve_coarsest(coarsest, b, x):
    """x of the level from its right-hand side b, both with a border."""
    nodes, factors, v = coarsest
    n, n2 = nodes.size, x.shape[1] - 2
    for i in range(n):
        v[i] = b[nodes[i] // n2 + 1, nodes[i] % n2 + 1]
    carry_sources(factors, v)
    v[n] = 0.0
    find_potentials(factors, v)
    for i in range(n):
        x[nodes[i] // n2 + 1, nodes[i] % n2 + 1] = v[i]

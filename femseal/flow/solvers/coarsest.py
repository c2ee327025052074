"""The coarsest level of multigrid: eliminated once, solved for many right-hand sides; the ends are one node, at 0."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .elimination import Factors, carry_sources, find_potentials
from .link_network import grid_factors

Array = NDArray[np.float64]
#: What the centre has beyond all couples is taken for a rounding error below this fraction.
_ROUNDING = 1e-13


class Coarsest(NamedTuple):
    """The eliminated level: numbers of its nodes in their order, factors, and room for potentials in that order."""

    nodes: NDArray[np.int64]
    factors: Factors
    work: Array


def eliminate_coarsest(
    centre: Array, right: Array, below: Array, below_right: Array, below_left: Array, ring: bool
) -> Coarsest:
    """Eliminate an operator, given with a border of one node, on its nodes that have links."""
    n1, n2 = centre.shape[0] - 2, centre.shape[1] - 2
    nine = below_right.size > 1
    m2 = n2 if ring else n2 - 1
    inner = np.s_[1:-1, 1:-1]
    c1, c2 = np.zeros((n1 + 1, n2)), np.ascontiguousarray(right[1:-1, 1 : m2 + 1])
    c1[1:n1] = below[1:n1, 1:-1]
    rest = centre[inner] - right[inner] - right[1:-1, :-2] - below[inner] - below[:-2, 1:-1]
    corners = (n1 + 1, m2) if nine else (0, 0)
    falling, rising = np.zeros(corners), np.zeros(corners)
    if nine:
        rest -= below_right[inner] + below_right[:-2, :-2] + below_left[inner] + below_left[:-2, 2:]
        falling[1:n1] = below_right[1:n1, 1 : m2 + 1]
        rising[1:n1] = below_left[1:n1, np.arange(1, m2 + 1) % n2 + 1]
    keep = centre[inner] > 0
    node = np.flatnonzero(keep & (rest > _ROUNDING * centre[inner]))
    end = np.zeros(node.size, np.int64)
    order, factors = grid_factors(c1, c2, falling, rising, keep, ring, node, end, rest.ravel()[node], 1)
    return Coarsest(order.nodes, factors, np.zeros(order.nodes.size + 1))


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

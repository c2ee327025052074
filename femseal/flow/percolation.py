"""Percolation: which nodes are joined to the inlet, to the outlet, or around a periodic cell, by union-find.

Nodes that are not connected to both ends carry no flow and are left out. Without a path the flow is exactly 0.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .stencil import Stencil

Array = NDArray[np.float64]


@njit(cache=True, nogil=True)
def find(parent, a):
    """Find the root of a node, halving the path to it."""
    while parent[a] != a:
        parent[a] = parent[parent[a]]
        a = parent[a]
    return a


@njit(cache=True, nogil=True)
def union(parent, a, b):
    """Join two components; return whether they were different. The root is the lowest node of a component."""
    a = find(parent, a)
    b = find(parent, b)
    if a < b:
        parent[b] = a
    elif b < a:
        parent[a] = b
    return a != b


@njit(cache=True, nogil=True)
def _ends_reached(parent, rows, columns):
    """0 none, 1 inlet, 2 outlet, 3 both for rows of nodes, of which inlet and outlet are the last two."""
    n = rows * columns
    inlet = find(parent, n)
    outlet = find(parent, n + 1)
    reached = np.zeros((rows, columns), np.int8)
    for a in range(n):
        # parents come before their children
        parent[a] = parent[parent[a]]
        reached[a // columns, a % columns] = (parent[a] == inlet) + 2 * (parent[a] == outlet)
    return reached


def nodes_reached(stencil: Stencil) -> NDArray[np.int8]:
    """Which ends each node is joined to by couples that are not 0, (n1 + 1, n2): 0 none, 1 inlet, 2 outlet, 3 both.

    Dead ends of a path from inlet to outlet are joined to both; they are kept, and carry no flow.
    """
    return _nodes_reached(stencil.along, stencil.across, stencil.falling, stencil.rising)


@njit(cache=True, nogil=True)
def _nodes_reached(along, across, falling, rising):
    n1, n2 = along.shape
    m2 = across.shape[1]
    parent = _ends_joined(n1, n2)
    _join(parent, along, across, 0.0, np.inf)
    if falling.size > 0:
        for i in range(n1):
            for j in range(m2):
                k = (j + 1) % n2
                if falling[i, j] != 0.0:
                    union(parent, i * n2 + j, (i + 1) * n2 + k)
                if rising[i, j] != 0.0:
                    union(parent, i * n2 + k, (i + 1) * n2 + j)
    return _ends_reached(parent, n1 + 1, n2)


@njit(cache=True, nogil=True)
def _ends_joined(n1, n2):
    """Nodes of n1 + 1 rows, each its own root but for the first and the last row, which are joined to the two ends."""
    n = (n1 + 1) * n2
    parent = np.arange(n + 2)
    for j in range(n2):
        union(parent, n, j)
        union(parent, n + 1, n1 * n2 + j)
    return parent


def nodes_reached_by(stencil: Stencil, wide: float, narrow: float) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """`nodes_reached` of a network by links of a conductance >= `wide` only, and by those >= `narrow` < `wide`."""
    return _nodes_reached_by(stencil.along, stencil.across, wide, narrow)


@njit(cache=True, nogil=True)
def _nodes_reached_by(along, across, wide, narrow):
    n1, n2 = along.shape
    parent = _ends_joined(n1, n2)
    _join(parent, along, across, wide, np.inf)
    first = _ends_reached(parent, n1 + 1, n2)
    _join(parent, along, across, narrow, wide)
    return first, _ends_reached(parent, n1 + 1, n2)


@njit(cache=True, nogil=True)
def _join(parent, along, across, least, below):
    """Join the nodes of couples along the axes that are not 0 and whose size is >= `least` and < `below`."""
    n1, n2 = along.shape
    m2 = across.shape[1]
    for i in range(n1):
        for j in range(n2):
            if along[i, j] != 0.0 and least <= abs(along[i, j]) < below:
                union(parent, i * n2 + j, (i + 1) * n2 + j)
    for i in range(n1 - 1):
        for j in range(m2):
            if across[i, j] != 0.0 and least <= abs(across[i, j]) < below:
                union(parent, (i + 1) * n2 + j, (i + 1) * n2 + (j + 1) % n2)


def restricted(stencil: Stencil, keep: NDArray[np.bool_], factor: float = 1.0, least: float = 0.0) -> Stencil:
    """Copy times a factor, without the couples of nodes (n1 + 1, n2) that are not kept and those below `least`."""
    parts = _restricted(stencil.along, stencil.across, stencil.falling, stencil.rising, keep, factor, least)
    return replace(stencil, along=parts[0], across=parts[1], falling=parts[2], rising=parts[3])


@njit(cache=True, nogil=True)
def _restricted(along, across, falling, rising, keep, factor, least):
    n1, n2 = along.shape
    m2 = across.shape[1]
    out1, out2 = np.zeros(along.shape), np.zeros(across.shape)
    out3, out4 = np.zeros(falling.shape), np.zeros(rising.shape)
    for i in range(n1):
        for j in range(n2):
            if keep[i, j] and keep[i + 1, j] and abs(along[i, j]) >= least:
                out1[i, j] = factor * along[i, j]
    for i in range(n1 - 1):
        for j in range(m2):
            if keep[i + 1, j] and keep[i + 1, (j + 1) % n2] and abs(across[i, j]) >= least:
                out2[i, j] = factor * across[i, j]
    if falling.size > 0:
        for i in range(n1):
            for j in range(m2):
                k = (j + 1) % n2
                if keep[i, j] and keep[i + 1, k] and abs(falling[i, j]) >= least:
                    out3[i, j] = factor * falling[i, j]
                if keep[i, k] and keep[i + 1, j] and abs(rising[i, j]) >= least:
                    out4[i, j] = factor * rising[i, j]
    return out1, out2, out3, out4


@njit(cache=True, nogil=True)
def percolates(is_open):
    """Whether pixels (n1, n2), periodic along x2, join the ends of x1 over common sides.

    Depth-first search from the inlet, towards the outlet first.
    """
    n1, n2 = is_open.shape
    seen = np.zeros((n1, n2), np.bool_)
    waiting = [(0, j) for j in range(n2)]
    while waiting:
        i, j = waiting.pop()
        if i < 0 or not is_open[i, j] or seen[i, j]:
            continue
        if i == n1 - 1:
            return True
        seen[i, j] = True
        waiting.append((i - 1, j))
        waiting.append((i, (j - 1) % n2))
        waiting.append((i, (j + 1) % n2))
        waiting.append((i + 1, j))
    return False


@njit(cache=True, nogil=True)
def winding_components(c1, c2):
    """Doubly periodic network: component of each node, and which components wind around each axis.

    c1, c2 (n1, n2) link node (i, j) to (i + 1, j) and (i, j + 1), wrapped. Each node keeps its displacement to its
    parent, so that a link closing a loop shows how often the loop winds around the cell.
    """
    n1, n2 = c1.shape
    n = n1 * n2
    parent = np.arange(n)
    shift = np.zeros((n, 2), np.int64)
    winds = np.zeros((n, 2), np.bool_)
    for axis in range(2):
        for i in range(n1):
            for j in range(n2):
                if (c1[i, j] if axis == 0 else c2[i, j]) <= 0:
                    continue
                a = i * n2 + j
                if axis == 0:
                    b = ((i + 1) % n1) * n2 + j
                else:
                    b = i * n2 + (j + 1) % n2
                sa0 = sa1 = sb0 = sb1 = 0
                while parent[a] != a:
                    sa0 += shift[a, 0]
                    sa1 += shift[a, 1]
                    a = parent[a]
                while parent[b] != b:
                    sb0 += shift[b, 0]
                    sb1 += shift[b, 1]
                    b = parent[b]
                # displacement from root b to root a along the new link
                d0 = sb0 - sa0 - (1 if axis == 0 else 0)
                d1 = sb1 - sa1 - (1 if axis == 1 else 0)
                if a == b:
                    winds[a, 0] |= d0 != 0
                    winds[a, 1] |= d1 != 0
                else:
                    parent[a] = b
                    shift[a, 0] = d0
                    shift[a, 1] = d1
                    winds[b, 0] |= winds[a, 0]
                    winds[b, 1] |= winds[a, 1]
                # compress the path of the node the link started from
                a = i * n2 + j
                t0 = t1 = 0
                c = a
                while parent[c] != c:
                    t0 += shift[c, 0]
                    t1 += shift[c, 1]
                    c = parent[c]
                while parent[a] != a:
                    up = parent[a]
                    u0 = shift[a, 0]
                    u1 = shift[a, 1]
                    parent[a] = c
                    shift[a, 0] = t0
                    shift[a, 1] = t1
                    t0 -= u0
                    t1 -= u1
                    a = up
    label = np.empty(n, np.int64)
    for a in range(n):
        c = a
        while parent[c] != c:
            c = parent[c]
        label[a] = c
    return label, winds

"""Percolation: which nodes are joined to the inlet, to the outlet, or around a periodic cell, by union-find.

Nodes that are not connected to both ends carry no flow and are left out. Without a path the flow is exactly 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..base.threads import over, rows
from .stencil import Stencil


@njit(cache=True, nogil=True)
def find(parent, a):
    """Find the root of a node, halving the path to it."""
    while parent[a] != a:
        parent[a] = parent[parent[a]]
        a = np.int64(parent[a])
    return a


@njit(cache=True, nogil=True)
def union(parent, a, b):
    """Join two components; return whether they were different. The root is the lowest node of a component."""
    a = find(parent, np.int64(a))
    b = find(parent, np.int64(b))
    if a < b:
        parent[b] = a
    elif b < a:
        parent[a] = b
    return a != b


def nodes_reached(stencil: Stencil) -> NDArray[np.int8]:
    """Which ends each node is joined to by conductances above 0, (n1 + 1, n2): 0 none, 1 inlet, 2 outlet, 3 both.

    Dead ends of a path from inlet to outlet are joined to both; they are kept, and carry no flow.
    """
    return nodes_reached_of(stencil.along, stencil.across, stencil.falling, stencil.rising, 0.0)


def nodes_reached_by(stencil: Stencil, least: float) -> NDArray[np.int8]:
    """`nodes_reached` of a network by links of a conductance >= `least` only."""
    return nodes_reached_of(stencil.along, stencil.across, stencil.falling, stencil.rising, least)


@njit(cache=True, nogil=True)
def nodes_reached_of(along, across, falling, rising, least):
    """`nodes_reached_by` of the conductances of a stencil.

    Row by row: a node takes the label of a neighbour that it is joined to, and where two meet they become one.

    Labels are few against nodes: those of inlet and outlet are 0 and 1.
    """
    n1, n2 = along.shape
    m2 = across.shape[1]
    nine = falling.size > 0
    label = np.empty((n1 + 1, n2), np.int32)
    parent = np.empty((n1 - 1) * n2 + 2, np.int32)
    parent[0], parent[1] = 0, 1
    count = 2
    for j in range(n2):
        label[0, j] = 0
    for i in range(1, n1 + 1):
        last = i == n1
        for j in range(n2):
            here = np.int32(1 if last else -1)
            c = along[i - 1, j]
            if c != 0.0 and abs(c) >= least:
                above = label[i - 1, j]
                if here < 0:
                    here = above
                elif here != above:
                    union(parent, here, above)
            if not last and j > 0:
                c = across[i - 1, j - 1]
                if c != 0.0 and abs(c) >= least:
                    left = label[i, j - 1]
                    if here < 0:
                        here = left
                    elif here != left:
                        union(parent, here, left)
            if here < 0:
                here = np.int32(count)
                parent[count] = count
                count += 1
            label[i, j] = here
        if not last and m2 == n2 and n2 > 1:
            c = across[i - 1, n2 - 1]
            if c != 0.0 and abs(c) >= least and label[i, n2 - 1] != label[i, 0]:
                union(parent, label[i, n2 - 1], label[i, 0])
        if nine:
            for j in range(m2):
                k = (j + 1) % n2
                c = falling[i - 1, j]
                if c != 0.0 and abs(c) >= least and label[i - 1, j] != label[i, k]:
                    union(parent, label[i - 1, j], label[i, k])
                c = rising[i - 1, j]
                if c != 0.0 and abs(c) >= least and label[i - 1, k] != label[i, j]:
                    union(parent, label[i - 1, k], label[i, j])
    inlet, outlet = find(parent, np.int64(0)), find(parent, np.int64(1))
    ends = np.empty(count, np.int8)
    for a in range(count):
        root = find(parent, a)
        ends[a] = (root == inlet) + 2 * (root == outlet)
    reached = np.empty((n1 + 1, n2), np.int8)
    for i in range(n1 + 1):
        for j in range(n2):
            reached[i, j] = ends[label[i, j]]
    return reached


@njit(cache=True, nogil=True)
def narrowest(along, across):
    """The smallest of these conductances that is not 0; inf if all are."""
    least = np.inf
    for i in range(along.shape[0]):
        for j in range(along.shape[1]):
            if 0.0 < along[i, j] < least:
                least = along[i, j]
    for i in range(across.shape[0]):
        for j in range(across.shape[1]):
            if 0.0 < across[i, j] < least:
                least = across[i, j]
    return least


@njit(cache=True, nogil=True)
def widest(along, across):
    """The largest of these conductances."""
    most = 0.0
    for i in range(along.shape[0]):
        for j in range(along.shape[1]):
            most = along[i, j] if along[i, j] > most else most
    for i in range(across.shape[0]):
        for j in range(across.shape[1]):
            most = across[i, j] if across[i, j] > most else most
    return most


def restricted(stencil: Stencil, keep: NDArray[np.bool_], least: float = 0.0) -> Stencil:
    """Copy without the conductances of nodes (n1 + 1, n2) that are not kept and those below `least`."""
    along, across, falling, rising = (
        c.copy() for c in (stencil.along, stencil.across, stencil.falling, stencil.rising)
    )
    restrict(along, across, falling, rising, keep, (1.0, 1.0), least)
    return replace(stencil, along=along, across=across, falling=falling, rising=rising)


@contextmanager
def closed(stencil: Stencil, keep: NDArray[np.bool_] | None, least: float = 0.0) -> Iterator[None]:
    """Meanwhile close the links of a network that `restricted` does without, in its own arrays, none without `keep`.

    Only the few that are closed are copied.
    """
    aside = []
    if keep is not None:
        parts = over(rows(*stencil.along.shape), _closing, stencil.along, stencil.across, keep, least)
        for c, of_parts in zip((stencil.along, stencil.across), zip(*parts, strict=True), strict=True):
            links, at = c.reshape(-1), np.concatenate(of_parts)
            aside.append((links, at, links[at]))
            links[at] = 0.0
    try:
        yield
    finally:
        for links, at, conductances in aside:
            links[at] = conductances


@njit(cache=True, nogil=True)
def _closing(begin, end, along, across, keep, least):
    """Places of the open links along and across of some rows that `restricted` does without."""
    n2, m2 = along.shape[1], across.shape[1]
    found = np.empty(0, np.int64), np.empty(0, np.int64)
    for written in range(2):
        first = second = 0
        for i in range(begin, end):
            for j in range(n2):
                c = along[i, j]
                if c > 0.0 and not (keep[i, j] and keep[i + 1, j] and c >= least):
                    if written == 1:
                        found[0][first] = i * n2 + j
                    first += 1
        for i in range(begin, min(end, across.shape[0])):
            for j in range(m2):
                c = across[i, j]
                if c > 0.0 and not (keep[i + 1, j] and keep[i + 1, (j + 1) % n2] and c >= least):
                    if written == 1:
                        found[1][second] = i * m2 + j
                    second += 1
        if written == 0:
            found = np.empty(first, np.int64), np.empty(second, np.int64)
    return found


@njit(cache=True, nogil=True)
def restrict(along, across, falling, rising, keep, factors, least):
    """`restricted` of the conductances of a stencil in place, times two factors."""
    first, second = factors
    n1, n2 = along.shape
    m2 = across.shape[1]
    for i in range(n1):
        for j in range(n2):
            kept = keep[i, j] and keep[i + 1, j] and abs(along[i, j]) >= least
            along[i, j] = second * (first * along[i, j]) if kept else 0.0
    for i in range(n1 - 1):
        for j in range(m2):
            kept = keep[i + 1, j] and keep[i + 1, (j + 1) % n2] and abs(across[i, j]) >= least
            across[i, j] = second * (first * across[i, j]) if kept else 0.0
    if falling.size > 0:
        for i in range(n1):
            for j in range(m2):
                k = (j + 1) % n2
                kept = keep[i, j] and keep[i + 1, k] and abs(falling[i, j]) >= least
                falling[i, j] = second * (first * falling[i, j]) if kept else 0.0
                kept = keep[i, k] and keep[i + 1, j] and abs(rising[i, j]) >= least
                rising[i, j] = second * (first * rising[i, j]) if kept else 0.0


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

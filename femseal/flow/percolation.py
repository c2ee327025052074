"""Find which nodes of a network carry flow: percolation, by union-find, and the critical constriction.

Nodes that are not connected to both ends carry no flow and are left out. Without a path the flow is exactly 0. Where
the widest path is narrowest is the constriction that controls the leakage near closing.
Sources: Ambegaokar, Halperin & Langer, Phys. Rev. B 4, 1971, 2612; for seals Persson & Yang, J. Phys. Condens. Matter
20, 2008, 315011.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import frexp, ldexp

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base import Array, Lengths, Pair
from ..base.compiled import compiled, inner, over, rows
from .grid import Stencil, gap_on_links
from .problem import validated_cell


@inner()
def find(parent, a):
    """Find the root of a node, halving the path to it."""
    while parent[a] != a:
        parent[a] = parent[parent[a]]
        a = np.int64(parent[a])
    return a


@inner()
def union(parent, a, b):
    """Join two components; return whether they were different. The root is the lowest node of a component."""
    a = find(parent, np.int64(a))
    b = find(parent, np.int64(b))
    if a < b:
        parent[b] = a
    elif b < a:
        parent[a] = b
    return a != b


def nodes_reached(along: Array, across: Array, least: float = 0.0) -> NDArray[np.int8]:
    """Which ends each node is joined to by open links of a conductance >= `least`: 0 none, 1 inlet, 2 outlet, 3 both.

    along, across : as of a `Stencil` of (n1 + 1, n2) nodes. Dead ends of a path from inlet to outlet are joined to both
    and carry no flow.
    """
    n1, n2 = along.shape
    label = np.empty((n1 + 1, n2), np.int32)
    parent = np.empty((n1 + 1) * n2 + 2, np.int32)
    parent[:2] = 0, 1
    parts = rows(n1 + 1, n2)
    links = along, across, least
    over(parts, _label_rows, *links, label, parent)
    for first, _ in parts[1:]:
        _join_rows(first, along, least, label, parent)
    reached = np.empty(label.shape, np.int8)
    over(parts, _reached_rows, label, parent, reached)
    return reached


@inner()
def _is_open(c, least):
    return c > 0.0 and c >= least


@compiled()
def _label_rows(begin, end, along, across, least, label, parent):
    """Label some rows of nodes. Those of inlet and outlet are 0 and 1.

    Row by row: a node takes the label of a neighbour that it is joined to, and where two meet they become one. Labels
    are few against nodes.
    """
    n1, n2 = along.shape
    m2 = across.shape[1]
    count = begin * n2 + 2
    if begin == 0:
        for j in range(n2):
            label[0, j] = 0
    for i in range(max(begin, 1), end):
        last = i == n1
        for j in range(n2):
            here = np.int32(1 if last else -1)
            if i > begin and _is_open(along[i - 1, j], least):
                above = label[i - 1, j]
                if here < 0:
                    here = above
                elif here != above:
                    union(parent, here, above)
            if not last and j > 0 and _is_open(across[i - 1, j - 1], least):
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
        around = not last and m2 == n2 and n2 > 1
        if around and _is_open(across[i - 1, n2 - 1], least) and label[i, n2 - 1] != label[i, 0]:
            union(parent, label[i, n2 - 1], label[i, 0])


@compiled()
def _join_rows(i, along, least, label, parent):
    """Join the labels of a row of nodes and those of the row above."""
    for j in range(along.shape[1]):
        if _is_open(along[i - 1, j], least):
            union(parent, label[i - 1, j], label[i, j])


@compiled()
def _reached_rows(begin, end, label, parent, reached):
    """Write which ends some rows of nodes are joined to."""
    for i in range(begin, end):
        for j in range(label.shape[1]):
            reached[i, j] = _ends(parent, label[i, j])


@inner()
def _ends(parent, a):
    """The ends that a label is joined to: `find` that writes nothing."""
    while parent[a] != a:
        a = parent[a]
    if a > 1:
        return 0
    if parent[1] == 0:
        return 3
    return a + 1


@contextmanager
def closed(stencil: Stencil, keep: NDArray[np.bool_] | None, least: float = 0.0) -> Iterator[None]:
    """Meanwhile close the links of nodes (n1 + 1, n2) that are not kept and those below `least`; none without `keep`.

    It is in the arrays of the stencil: only the few links that are closed are copied.
    """
    aside = []
    if keep is not None:
        inner = keep[1:-1]
        both = np.roll(inner, -1, axis=1)
        both &= inner
        for c, kept in (
            (stencil.along, keep[:-1] & keep[1:]),
            (stencil.across, both[:, : stencil.across.shape[1]]),
        ):
            links = c.reshape(-1)
            at = np.flatnonzero((c > 0) & ~(kept & (c >= least)))
            aside.append((links, at, links[at]))
            links[at] = 0.0
    try:
        yield
    finally:
        for links, at, conductances in aside:
            links[at] = conductances


@compiled()
def _restrict(begin, end, along, across, keep, first, second):
    """Close the links of nodes that are not kept in some rows, and multiply the others by two factors."""
    n2, m2 = along.shape[1], across.shape[1]
    for i in range(begin, end):
        for j in range(n2):
            kept = keep[i, j] and keep[i + 1, j]
            along[i, j] = second * (first * along[i, j]) if kept else 0.0
    for i in range(begin, min(end, across.shape[0])):
        for j in range(m2):
            kept = keep[i + 1, j] and keep[i + 1, (j + 1) % n2]
            across[i, j] = second * (first * across[i, j]) if kept else 0.0


def ready(along: Array, across: Array) -> tuple[NDArray[np.int8], int]:
    """Make the conductances of a stencil what `solve_ready` takes, in place: between nodes that reach both ends.

    They are over a power of two near the widest. Returns which ends each node reaches, see `nodes_reached`, and the
    exponent.
    """
    parts = rows(*along.shape)
    reached = nodes_reached(along, across)
    through = reached[0, 0] == 3 and len(along) > 1
    exponent = frexp(max(along.max(), across.max(initial=0.0)))[1] - 1 if through else 0
    keep = np.equal(reached, 3) if through else np.ones(reached.shape, np.bool_)
    # a power of two changes no digit; two of half the exponent are in range
    half = exponent // 2
    over(parts, _restrict, along, across, keep, ldexp(1.0, -half), ldexp(1.0, half - exponent))
    return reached, exponent


@dataclass(frozen=True)
class Constriction:
    """Where the widest path from inlet to outlet is narrowest, (x1, x2) between two pixels, and its gap there [m]."""

    position: Pair
    gap: float


def critical_constriction(
    gap: ArrayLike, spacing: Lengths, *, axis: int = 0, sides: str = "mirror"
) -> Constriction | None:
    """Critical constriction of a cell, None where the gap does not percolate.

    Parameters
    ----------
    gap, spacing, axis, sides : as in `cell_permeability`, whose gap midway between two pixels is used.

    Raises
    ------
    InputError : as `cell_permeability`.
    """
    h, (d1, d2) = validated_cell(gap, spacing, axis, sides)
    h1, h2 = gap_on_links(h, False, sides == "periodic")
    widths = np.unique(np.concatenate([h1.ravel(), h2.ravel()]))
    widths = widths[widths > 0]
    joined = bisect_left(widths, True, key=lambda width: nodes_reached(h1, h2, width)[0, 0] != 3)
    if joined == 0:
        return None
    width = widths[joined - 1]
    if (h1 == width).any():
        i, j = np.argwhere(h1 == width)[0]
        position = float(i * d1), float((j + 0.5) * d2)
    else:
        i, j = np.argwhere(h2 == width)[0]
        position = float((i + 0.5) * d1), float((j + 1) * d2)
    return Constriction(position if axis == 0 else position[::-1], float(width))

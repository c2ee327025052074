"""Dead ends of a network of links: parts behind one node, through which nothing can flow, and which have its potential.

They are few, but behind a narrow mouth they are what multigrid is slowest at: their potential is wrong by an amount
that hardly costs energy, and no coarser grid has it. Source: Hopcroft & Tarjan, Commun. ACM 16, 1973, 372 (biconnected
components), with inlet and outlet as one node.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..base.arrays import Array, Flags
from .stencil import Stencil

Indices = NDArray[np.int32]
_THROUGH = np.int32(-1)


def dead_ends(stencil: Stencil, keep: Flags) -> tuple[Flags, tuple[Indices, Indices]]:
    """Find dead ends.

    stencil : a network of links between nodes that are connected to both ends.
    keep : those nodes, the ends among them.

    Returns the nodes without dead ends; the numbers (row · n2 + column) of the inner nodes in dead ends, with those
    that they hang on; two more numbers stand for the inlet and the outlet.
    """
    anchor = _anchors(stencil.along, stencil.across, keep, stencil.ring2)
    left = keep.copy()
    left[1:-1] &= anchor == _THROUGH
    at = np.flatnonzero(anchor != _THROUGH).astype(np.int32)
    return left, (at, anchor.ravel()[at])


def fill_dead_ends(potential: Array, dead: tuple[Indices, Indices], at_inlet: float, at_outlet: float) -> None:
    """Write the potential of all `dead_ends` of the inner nodes, given that of both ends."""
    anchor = np.full(potential.shape, _THROUGH)
    anchor.ravel()[dead[0]] = dead[1]
    _fill(potential, anchor, at_inlet, at_outlet)


@njit(cache=True, nogil=True)
def _fill(potential, anchor, at_inlet, at_outlet):
    """`fill_dead_ends` of what each node hangs on."""
    n2 = potential.shape[1]
    for i in range(potential.shape[0]):
        for j in range(n2):
            a = anchor[i, j]
            if a != _THROUGH:
                while a < anchor.size and anchor[a // n2, a % n2] != _THROUGH:
                    a = anchor[a // n2, a % n2]
                if a < anchor.size:
                    potential[i, j] = potential[a // n2, a % n2]
                else:
                    potential[i, j] = at_inlet if a == anchor.size else at_outlet


@njit(cache=True, nogil=True)
def _anchors(along, across, keep, ring):
    """Depth-first search from both ends as one node, which is number 1, towards the outlet first.

    What a node's branch reaches is the lowest number that any of its nodes has a link to. A branch that reaches no
    further than the node it starts from hangs on that node; what reaches no other end hangs on its end.
    """
    n1, n2 = along.shape[0] - 1, along.shape[1]
    n = n1 * n2
    number, reach = np.zeros(n, np.int32), np.empty(n, np.int32)
    parent, anchor = np.empty(n, np.int32), np.full(n, _THROUGH, np.int32)
    tried = np.zeros(n, np.int8)
    path, found = np.empty(n, np.int32), np.empty(n, np.int32)  # nodes above this one; those not yet sorted
    count = 1
    for first in range(n2):
        if not keep[1, first] or along[0, first] <= 0.0 or number[first] > 0:
            continue
        count += 1
        number[first], reach[first], parent[first] = count, 1, -1
        path[0] = found[0] = first
        depth, waiting = 0, 1
        at_outlet = False
        while depth >= 0:
            v = path[depth]
            i, j = v // n2, v % n2
            k = tried[v]
            if k == 4:
                depth -= 1
                u = parent[v]
                if u < 0:
                    if not at_outlet:
                        for q in range(waiting):
                            anchor[found[q]] = n
                elif reach[v] >= number[u]:
                    here = -1
                    while here != v:
                        waiting -= 1
                        here = found[waiting]
                        anchor[here] = u
                elif reach[v] < reach[u]:
                    reach[u] = reach[v]
                continue
            tried[v] = k + 1
            w, c = -1, 0.0
            if k == 0:
                w, c = v + n2, along[i + 1, j]
            elif k == 1:
                if ring or j + 1 < n2:
                    w, c = i * n2 + (j + 1) % n2, across[i, j]
            elif k == 2:
                if ring or j > 0:
                    a = (j - 1) % n2
                    w, c = i * n2 + a, across[i, a]
            else:
                w, c = v - n2, along[i, j]
            if c <= 0.0 or w == parent[v]:
                continue
            if w < 0 or w >= n:
                reach[v] = 1
                at_outlet = at_outlet or w >= n
            elif number[w] == 0:
                count += 1
                number[w] = reach[w] = count
                parent[w] = v
                depth += 1
                path[depth] = w
                found[waiting] = w
                waiting += 1
            elif number[w] < reach[v]:
                reach[v] = number[w]
    for v in range(n):
        if number[v] == 0 and keep[v // n2 + 1, v % n2]:
            anchor[v] = n + 1
    return anchor.reshape(n1, n2)

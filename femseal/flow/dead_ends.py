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
#: Links of a node, in the order in which they are tried.
_DOWN, _RIGHT, _LEFT, _UP = 1, 2, 4, 8


def dead_ends(stencil: Stencil, keep: Flags) -> tuple[Flags, tuple[Indices, Indices]]:
    """Find dead ends.

    stencil : a network of links between nodes that are connected to both ends.
    keep : those nodes, the ends among them.

    Returns the nodes without dead ends; the numbers (row · n2 + column) of the inner nodes in dead ends, with those
    that they hang on; two more numbers stand for the inlet and the outlet.
    """
    anchor = _anchors(stencil.along, stencil.across, keep)
    through = anchor == _THROUGH
    left = keep.copy()
    left[1:-1] &= through
    at = np.flatnonzero(~through).astype(np.int32)
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
def _open_links(along, across):
    """Bits of the open links of every node, those to the ends among them."""
    n1, n2 = along.shape[0] - 1, along.shape[1]
    links = np.zeros(n1 * n2, np.uint8)
    for i in range(n1):
        for j in range(n2):
            links[i * n2 + j] = (along[i + 1, j] > 0.0) * _DOWN + (along[i, j] > 0.0) * _UP
        for j in range(across.shape[1]):
            if across[i, j] > 0.0:
                links[i * n2 + j] |= _RIGHT
                links[i * n2 + (j + 1) % n2] |= _LEFT
    return links


@njit(cache=True, nogil=True)
def _anchors(along, across, keep):
    """Depth-first search from both ends as one node, which is number 1, towards the outlet first.

    What a node's branch reaches is the lowest number that any of its nodes has a link to. A branch that reaches no
    further than the node it starts from hangs on that node; what reaches no other end hangs on its end. Each open link
    is tried once, from one of its nodes.
    """
    n1, n2 = along.shape[0] - 1, along.shape[1]
    n = n1 * n2
    number, reach = np.zeros(n, np.int32), np.empty(n, np.int32)
    anchor = np.full(n, _THROUGH, np.int32)
    links = _open_links(along, across)
    path, found = np.empty(n, np.int32), np.empty(n, np.int32)  # nodes above this one; those not yet sorted
    count = 1
    for first in range(n2):
        if not keep[1, first] or along[0, first] <= 0.0 or number[first] > 0:
            continue
        count += 1
        number[first], reach[first] = count, 1
        path[0] = found[0] = first
        depth, waiting = 0, 1
        at_outlet = False
        while depth >= 0:
            v = path[depth]
            untried = links[v]
            if untried == 0:
                depth -= 1
                u = path[depth] if depth >= 0 else -1
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
            if untried & _DOWN:
                w, there, back = v + n2, _DOWN, _UP
            elif untried & _RIGHT:
                w, there, back = (v + 1 if (v + 1) % n2 > 0 else v + 1 - n2), _RIGHT, _LEFT
            elif untried & _LEFT:
                w, there, back = (v - 1 if v % n2 > 0 else v - 1 + n2), _LEFT, _RIGHT
            else:
                w, there, back = v - n2, _UP, _DOWN
            links[v] = untried & ~there
            if w < 0 or w >= n:
                reach[v] = 1
                at_outlet = at_outlet or w >= n
                continue
            links[w] &= ~back
            if number[w] == 0:
                count += 1
                number[w] = reach[w] = count
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

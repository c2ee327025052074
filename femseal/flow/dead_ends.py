"""Dead ends of a network of links: parts behind one node, through which nothing can flow, and which have its potential.

They are few, but behind a narrow mouth they are what multigrid is slowest at: their potential is wrong by an amount
that hardly costs energy, and no coarser grid has it. Source: Hopcroft & Tarjan, Commun. ACM 16, 1973, 372 (biconnected
components), with inlet and outlet as one node.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Flags
from ..base.compiled import compiled, inner
from .grid import Stencil

Indices = NDArray[np.int32]
#: Links of a node, in the order in which they are tried: along a row first, as its nodes are neighbours in memory. The
#: next two are those around a ring, between the last and the first node of a row.
_RIGHT, _LEFT, _ONWARD, _BACK, _DOWN, _UP = 1, 2, 4, 8, 16, 32


def dead_ends(stencil: Stencil, keep: Flags) -> tuple[Flags, tuple[Indices, Indices]]:
    """Find dead ends.

    stencil : a network of links between nodes that are connected to both ends.
    keep : those nodes, the ends among them.

    Returns the nodes without dead ends; the numbers (row · n2 + column) of the inner nodes in dead ends, with those
    that they hang on, which come before them if they are in dead ends too; two more numbers stand for the inlet and the
    outlet.
    """
    n2 = keep.shape[1]
    n = keep[1:-1].size
    number, path, found = np.zeros(n, np.int32), np.empty(n, np.int32), np.empty(n, np.int32)
    at = found[n - _search(stencil.along, stencil.across, keep, number, path, found) :].copy()
    left = keep.copy()
    left.reshape(-1)[n2:][at] = False
    return left, (at, number[at])


@compiled()
def fill_dead_ends(potential, dead, at_inlet, at_outlet):
    """Write the potential of all `dead_ends` of the inner nodes, given that of both ends."""
    n1, n2 = potential.shape
    at, anchor = dead
    for k in range(at.size):
        i, a = at[k], anchor[k]
        here = at_inlet if a == n1 * n2 else at_outlet
        potential[i // n2, i % n2] = potential[a // n2, a % n2] if a < n1 * n2 else here


@inner()
def _open_links(along, across):
    """Bits of the open links of every node, those to the ends among them."""
    n1, n2 = along.shape[0] - 1, along.shape[1]
    links = np.zeros((n1, n2), np.uint8)
    for i in range(n1):
        for j in range(n2):
            links[i, j] = (along[i + 1, j] > 0.0) * _DOWN + (along[i, j] > 0.0) * _UP
        for j in range(n2 - 1):
            if across[i, j] > 0.0:
                links[i, j] |= _RIGHT
                links[i, j + 1] |= _LEFT
        if across.shape[1] == n2 and across[i, n2 - 1] > 0.0:
            links[i, n2 - 1] |= _ONWARD
            links[i, 0] |= _BACK
    return links.reshape(-1)


@compiled()
def _search(along, across, keep, number, path, found):
    """Depth-first search from both ends as one node, which is number 1: how many nodes are in dead ends.

    What a node's branch reaches is the lowest number that any of its nodes has a link to. A branch that reaches no
    further than the node it starts from hangs on that node; what reaches no other end hangs on its end. Each open link
    is tried once, from one of its nodes.

    number : 0 at first; at last the number of each node, and what it hangs on in dead ends, which have no open link
    left. path : room for the nodes above this one. found : room for those not yet sorted, and from its end for those in
    dead ends.
    """
    n1, n2 = along.shape[0] - 1, along.shape[1]
    n = n1 * n2
    links = _open_links(along, across)
    reach = np.empty(n, np.int32)  # of the nodes above
    count, dead = 1, n
    for first in range(n2):
        if not keep[1, first] or along[0, first] <= 0.0 or number[first] > 0:
            continue
        count += 1
        number[first], reach[0] = count, 1
        path[0] = found[0] = first
        depth, waiting = 0, 1
        at_outlet = False
        while depth >= 0:
            v = path[depth]
            untried = links[v]
            if untried == 0:
                here, reached = -1, reach[depth]
                depth -= 1
                if depth < 0:
                    while not at_outlet and waiting > 0:
                        waiting -= 1
                        dead -= 1
                        here = found[waiting]
                        found[dead], number[here] = here, n
                elif reached >= number[path[depth]]:
                    while here != v:
                        waiting -= 1
                        dead -= 1
                        here = found[waiting]
                        found[dead], number[here] = here, path[depth]
                elif reached < reach[depth]:
                    reach[depth] = reached
                continue
            if untried & _RIGHT:
                w, there, back = v + 1, _RIGHT, _LEFT
            elif untried & _LEFT:
                w, there, back = v - 1, _LEFT, _RIGHT
            elif untried & _ONWARD:
                w, there, back = v + 1 - n2, _ONWARD, _BACK
            elif untried & _BACK:
                w, there, back = v - 1 + n2, _BACK, _ONWARD
            elif untried & _DOWN:
                w, there, back = v + n2, _DOWN, _UP
            else:
                w, there, back = v - n2, _UP, _DOWN
            links[v] = untried & ~there
            if w < 0 or w >= n:
                reach[depth] = 1
                at_outlet = at_outlet or w >= n
                continue
            links[w] &= ~back
            if number[w] == 0:
                count += 1
                depth += 1
                number[w] = reach[depth] = count
                path[depth] = found[waiting] = w
                waiting += 1
            elif number[w] < reach[depth]:
                reach[depth] = number[w]
    for v in range(n):
        if number[v] == 0 and keep[v // n2 + 1, v % n2]:
            dead -= 1
            found[dead], number[v] = v, n + 1
    return n - dead

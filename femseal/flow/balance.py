"""Correct a flux over a mesh so that it balances: the excess of every node is sent to the ends along a spanning tree.

The flux of a numerical solution balances up to rounding only, and at a high contrast rounding matters. A lower bound of
the flow (Thomson's principle) needs a flux that balances exactly.
"""

from __future__ import annotations

from math import frexp

import numpy as np

from ..base.compiled import compiled, inner
from .percolation import union

#: Exponents of two from the largest number down, and that of a closed link.
_LARGEST, _EXPONENTS, _CLOSED = 1024, 2100, -2000


@compiled()
def _exponents(width):
    """Return the exponent of two of the width of every link."""
    exponents = np.empty(width.size, np.int16)
    for k in range(width.size):
        exponents[k] = frexp(width[k])[1] if width[k] > 0.0 else _CLOSED
    return exponents


@compiled()
def balance(tail, head, width, flux, nodes):
    """Change a flux in place so that it balances at every node but node 0, where it enters and leaves.

    tail, head : nodes of each link, both ends of the seal being node 0.
    width : conductance of each link; links of width 0 keep their flux.
    flux : from tail to head; 0 where the width is.
    nodes : number of nodes, all of which links of width > 0 join to node 0 or that have no flux.
    """
    excess = np.zeros(nodes)
    for k in range(flux.size):
        excess[tail[k]] -= flux[k]
        excess[head[k]] += flux[k]
    link = _send(tail, head, _exponents(width), excess)
    for node in range(1, nodes):
        if excess[node] != 0.0:
            k = link[node]
            flux[k] += excess[node] if tail[k] == node else -excess[node]


@compiled()
def _send(tail, head, exponent, excess):
    """Turn the excess of every node but node 0 into what it sends along a link; returns the number of that link.

    What nodes have too much of goes to node 0 along the spanning tree of the widest links (Kruskal), so that the excess
    of wide links runs through narrow ones only where there is no other path.
    """
    nodes = excess.size
    degree, link = spanning_tree(tail, head, exponent, nodes)
    for leaf in range(1, nodes):
        node = np.int64(leaf)
        while node != 0 and degree[node] == 1:
            k = link[node]
            other = np.int64(tail[k]) + head[k] - node
            excess[other] += excess[node]
            degree[node] = 0
            degree[other] -= 1
            link[other] ^= k
            node = other
    return link


@inner()
def spanning_tree(tail, head, exponent, nodes):
    """Find the spanning tree of the widest links (Kruskal).

    tail, head : nodes of each link. exponent : of two, of the width of each link; `_CLOSED` of a closed one.

    Returns for every node how many links of the tree it has, and the exclusive or of their numbers: that of the last
    one that is left.
    """
    degree = np.zeros(nodes, np.int32)
    link = np.zeros(nodes, np.int32)
    parent = np.arange(nodes).astype(np.int32)
    for k in _widest_first(exponent):
        if union(parent, tail[k], head[k]):
            for node in (tail[k], head[k]):
                degree[node] += 1
                link[node] ^= k
    return degree, link


@inner()
def _widest_first(exponent):
    """Numbers of the open links, sorted by their exponents, which takes a tenth of the time of sorting by widths."""
    start = np.zeros(_EXPONENTS + 1, np.int64)  # of every exponent, the largest first
    for e in exponent:
        if e != _CLOSED:
            start[_LARGEST - e + 1] += 1
    start = np.cumsum(start)
    order = np.empty(start[-1], np.int32)
    for k in range(exponent.size):
        if exponent[k] != _CLOSED:
            place = _LARGEST - exponent[k]
            order[start[place]] = k
            start[place] += 1
    return order

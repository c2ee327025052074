"""A flux made to balance: what a solver leaves over at the nodes of a graph is sent out along a spanning tree.

The flux of a numerical solution balances up to rounding, which a high contrast makes matter. For a lower
bound of the flow (Thomson's principle) it must balance exactly.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .percolation import union

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def balanced_flux(tail: Indices, head: Indices, width: Array, flux: Array, nodes: int) -> Array:
    """Flux near `flux` that balances at every node but node 0, where it enters and leaves.

    Parameters
    ----------
    tail, head : nodes of each link, both ends of the seal being node 0.
    width : conductance of each link; links of width 0 are left alone. The tree is the one of the widest
        links, so that the rounding errors of wide links do not run through narrow ones unless they have to.
    flux : from tail to head; 0 where the width is.
    nodes : their number; those that no link of width > 0 joins to node 0 are left alone.
    """
    excess = np.bincount(head, flux, nodes) - np.bincount(tail, flux, nodes)
    candidates = np.flatnonzero((width > 0) & (tail != head))
    widest_first = candidates[np.argsort(-width[candidates], kind="stable")]
    result = flux.copy()
    _send_out(tail, head, widest_first, excess, result)
    return result


@njit(cache=True, nogil=True)
def _send_out(tail, head, widest_first, excess, flux):
    """Excess of each node to node 0 along the spanning tree of the widest links (Kruskal)."""
    n = excess.size
    parent = np.arange(n)
    tree = np.empty(n, np.int64)
    size = 0
    degree = np.zeros(n + 1, np.int64)
    for link in widest_first:
        if union(parent, tail[link], head[link]):
            tree[size] = link
            size += 1
            degree[tail[link] + 1] += 1
            degree[head[link] + 1] += 1
    start = np.cumsum(degree)
    at = start[:-1].copy()
    links = np.empty(2 * size, np.int64)
    for k in range(size):
        for node in (tail[tree[k]], head[tree[k]]):
            links[at[node]] = tree[k]
            at[node] += 1
    # outward from node 0, then back
    order = np.empty(n, np.int64)
    inward = np.full(n, -1, np.int64)
    order[0] = 0
    seen = 1
    k = 0
    while k < seen:
        node = order[k]
        k += 1
        for m in range(start[node], start[node + 1]):
            link = links[m]
            if link != inward[node]:
                other = tail[link] + head[link] - node
                inward[other] = link
                order[seen] = other
                seen += 1
    for k in range(seen - 1, 0, -1):
        node = order[k]
        link = inward[node]
        excess[tail[link] + head[link] - node] += excess[node]
        flux[link] += excess[node] if tail[link] == node else -excess[node]

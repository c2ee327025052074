"""Correct a flux so that it balances: the excess of every node is sent to the ends along a spanning tree.

The flux of a numerical solution balances up to rounding only, and at a high contrast rounding matters. A lower bound of
the flow (Thomson's principle) needs a flux that balances exactly.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .percolation import union
from .stencil import Stencil

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def balanced_link_fluxes(stencil: Stencil, potential: Array, complement: Array) -> tuple[Array, Array]:
    """Fluxes near −c Δφ along and across that balance at every node between the ends, on five points.

    `complement` is 1 − φ: each difference is taken of the smaller of the two, which has the smaller rounding errors.
    """
    n1, n2 = stencil.along.shape
    parts = [(c.ravel(), a.ravel(), b.ravel()) for c, a, b, _ in stencil.conductances()]
    c, tail, head = (np.concatenate(part) for part in zip(*parts, strict=True))
    φ, ψ = potential.ravel(), complement.ravel()
    q = c * np.where(φ[tail] + φ[head] < 1, φ[tail] - φ[head], ψ[head] - ψ[tail])
    # both ends are node 0: what enters and leaves there need not balance
    rooted = np.zeros((n1 + 1) * n2, np.int64)
    rooted[n2:-n2] = np.arange(1, (n1 - 1) * n2 + 1)
    q = balanced_flux(rooted[tail], rooted[head], c, q, (n1 - 1) * n2 + 1)
    return q[: n1 * n2].reshape(n1, n2), q[n1 * n2 :].reshape(stencil.across.shape)


def energy_gap(stencil: Stencil, potential: Array, complement: Array) -> float:
    """Bound of the relative error of the energy of a potential, on five points.

    It is the energy of the difference between the flux of the potential and one that balances: the least energy of all
    potentials lies between that of both (principles of Dirichlet and Thomson). NaN where no flow is left.
    """
    φ, ψ = np.nan_to_num(potential), np.nan_to_num(complement)
    gap = energy = 0.0
    fluxes = balanced_link_fluxes(stencil, φ, ψ)
    for (c, a, b, _), flux in zip(stencil.conductances(), fluxes, strict=True):
        drop = np.where(φ.ravel()[a] + φ.ravel()[b] < 1, φ.ravel()[a] - φ.ravel()[b], ψ.ravel()[b] - ψ.ravel()[a])
        excess = flux - c * drop
        gap += float(np.divide(excess**2, c, out=np.zeros(c.shape), where=c > 0).sum())
        energy += float((c * drop**2).sum())
    return gap / energy if energy > 0 else np.nan


def balanced_flux(tail: Indices, head: Indices, width: Array, flux: Array, nodes: int) -> Array:
    """Flux near `flux` that balances at every node but node 0, where it enters and leaves.

    Parameters
    ----------
    tail, head : nodes of each link, both ends of the seal being node 0.
    width : conductance of each link; links of width 0 keep their flux. The tree is the one of the widest
        links, so that the excess of wide links runs through narrow ones only where there is no other path.
    flux : from tail to head; 0 where the width is.
    nodes : number of nodes; nodes that no link of width > 0 joins to node 0 keep their excess.
    """
    excess = np.bincount(head, flux, nodes) - np.bincount(tail, flux, nodes)
    candidates = np.flatnonzero((width > 0) & (tail != head))
    # within a factor of two: sorting small integers takes a tenth of the time
    widest_first = candidates[np.argsort(-np.frexp(width[candidates])[1].astype(np.int16), kind="stable")]
    result = flux.copy()
    _send_out(tail, head, widest_first, excess, result)
    return result


@njit(cache=True, nogil=True)
def _send_out(tail, head, widest_first, excess, flux):
    """Send the excess of each node to node 0 along the spanning tree of the widest links (Kruskal)."""
    n = excess.size
    parent = np.arange(n).astype(np.int32)
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

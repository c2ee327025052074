"""Correct a flux so that it balances: the excess of every node is sent to the ends along a spanning tree.

The flux of a numerical solution balances up to rounding only, and at a high contrast rounding matters. A lower bound of
the flow (Thomson's principle) needs a flux that balances exactly.
"""

from __future__ import annotations

from math import frexp

import numpy as np

from ..base.arrays import Array, Indices
from ..base.compiled import compiled, inner
from .percolation import union
from .stencil import Stencil


def balanced_link_fluxes(stencil: Stencil, potential: Array, complement: Array) -> tuple[Array, Array]:
    """Fluxes near −c Δφ along and across that balance at every node between the ends, on five points.

    `complement` is 1 − φ: each difference is taken of the smaller of the two, which has the smaller rounding errors.
    What is NaN counts as 0.
    """
    along, across = stencil.along, stencil.across
    flux1, flux2 = np.empty(along.shape), np.empty(across.shape)
    _link_fluxes(along, across, potential, complement, flux1, flux2)
    _balance(along, across, _spanning_tree(along, across), flux1, flux2)
    return flux1, flux2


def energy_gap(stencil: Stencil, potential: Array, complement: Array) -> float:
    """Bound of the relative error of the energy of a potential, on five points.

    It is the energy of the difference between the flux of the potential and one that balances: the least energy of all
    potentials lies between that of both (principles of Dirichlet and Thomson). NaN where no flow is left.
    """
    flux1, flux2 = balanced_link_fluxes(stencil, potential, complement)
    gap, energy = _energies(stencil.along, stencil.across, potential, complement, flux1, flux2)
    return float(gap / energy) if energy > 0 else np.nan


@inner()
def _drop(φ, ψ, i, j, a, b):
    """Difference of the potential between nodes (i, j) and (a, b)."""
    one, other = φ[i, j], φ[a, b]
    one, other = 0.0 if np.isnan(one) else one, 0.0 if np.isnan(other) else other
    if one + other < 1.0:
        return one - other
    one, other = ψ[i, j], ψ[a, b]
    return (0.0 if np.isnan(other) else other) - (0.0 if np.isnan(one) else one)


@compiled()
def _link_fluxes(along, across, φ, ψ, flux1, flux2):
    """Write c times the drop of all links along and across."""
    n2 = along.shape[1]
    for i in range(along.shape[0]):
        for j in range(n2):
            flux1[i, j] = along[i, j] * _drop(φ, ψ, i, j, i + 1, j)
    for i in range(across.shape[0]):
        for j in range(across.shape[1]):
            flux2[i, j] = across[i, j] * _drop(φ, ψ, i + 1, j, i + 1, (j + 1) % n2)


@compiled()
def _energies(along, across, φ, ψ, flux1, flux2):
    """Energy of the difference between these fluxes and those of the potential, and energy of the potential."""
    n2 = along.shape[1]
    gap = energy = 0.0
    for i in range(along.shape[0]):
        for j in range(n2):
            if along[i, j] > 0.0:
                drop = _drop(φ, ψ, i, j, i + 1, j)
                gap += (flux1[i, j] - along[i, j] * drop) ** 2 / along[i, j]
                energy += along[i, j] * drop**2
    for i in range(across.shape[0]):
        for j in range(across.shape[1]):
            if across[i, j] > 0.0:
                drop = _drop(φ, ψ, i + 1, j, i + 1, (j + 1) % n2)
                gap += (flux2[i, j] - across[i, j] * drop) ** 2 / across[i, j]
                energy += across[i, j] * drop**2
    return gap, energy


@compiled()
def _spanning_tree(along, across):
    """Which links along, then across, are of the spanning tree of the widest ones (Kruskal), both ends being one node.

    Widths are sorted within a factor of two.
    """
    n1, n2 = along.shape
    m2, inner = max(across.shape[1], 1), (n1 - 1) * n2
    first, second = along.ravel(), across.ravel()
    links = first.size + second.size
    start = np.zeros(2200, np.int64)  # of every exponent, the largest first
    for k in range(links):
        c = first[k] if k < first.size else second[k - first.size]
        if c > 0.0:
            start[1100 - frexp(c)[1] + 1] += 1
    start = np.cumsum(start)
    order = np.empty(start[-1], np.int32)
    for k in range(links):
        c = first[k] if k < first.size else second[k - first.size]
        if c > 0.0:
            order[start[1100 - frexp(c)[1]]] = k
            start[1100 - frexp(c)[1]] += 1
    parent = np.arange(inner + 1).astype(np.int32)
    chosen = np.zeros(links, np.bool_)
    for k in order:
        if k < first.size:  # node (i, j) of row i >= 1 has the number (i − 1) n2 + j + 1
            i = k // n2
            tail = k - n2 + 1 if i > 0 else 0
            head = k + 1 if i < n1 - 1 else 0
        else:
            i, j = (k - first.size) // m2, (k - first.size) % m2
            tail, head = i * n2 + j + 1, i * n2 + (j + 1) % n2 + 1
        if tail != head and union(parent, tail, head):
            chosen[k] = True
    return chosen


@compiled()
def _balance(along, across, chosen, flux1, flux2):
    """Send what every node between the ends has too much of to the ends along a spanning tree, in place."""
    n1, n2 = along.shape
    m2 = across.shape[1]
    tree1 = chosen[: along.size].reshape(along.shape)
    tree2 = chosen[along.size :].reshape(across.shape)
    excess = np.zeros((n1 + 1, n2))
    for i in range(n1):
        for j in range(n2):
            excess[i, j] -= flux1[i, j]
            excess[i + 1, j] += flux1[i, j]
    for i in range(n1 - 1):
        for j in range(m2):
            excess[i + 1, j] -= flux2[i, j]
            excess[i + 1, (j + 1) % n2] += flux2[i, j]
    # outward from the ends, then back; every node keeps the step inward: up, down, left or right
    inward = np.full((n1 + 1, n2), 4, np.int8)
    order = np.empty((n1 + 1) * n2, np.int32)
    seen = 2 * n2
    for j in range(n2):
        order[j], order[n2 + j] = j, n1 * n2 + j
    k = 0
    while k < seen:
        i, j = order[k] // n2, order[k] % n2
        k += 1
        for step in range(4):
            a, b = i, j
            if step == 0:
                joined, a = i < n1 and tree1[min(i, n1 - 1), j], i + 1
            elif step == 1:
                joined, a = i > 0 and tree1[i - 1, j], i - 1
            elif step == 2:
                joined, b = 0 < i < n1 and j < m2 and tree2[i - 1, min(j, m2 - 1)], (j + 1) % n2
            else:
                b = j - 1 if j > 0 else n2 - 1
                joined = 0 < i < n1 and b < m2 and tree2[i - 1, min(b, m2 - 1)]
            if joined and 0 < a < n1 and inward[a, b] == 4 and (i == 0 or i == n1 or inward[i, j] != step ^ 1):
                inward[a, b] = step
                order[seen] = a * n2 + b
                seen += 1
    for k in range(seen - 1, 2 * n2 - 1, -1):
        i, j = order[k] // n2, order[k] % n2
        step, more = inward[i, j], excess[i, j]
        if step == 0:
            excess[i - 1, j] += more
            flux1[i - 1, j] -= more
        elif step == 1:
            excess[i + 1, j] += more
            flux1[i, j] += more
        elif step == 2:
            b = j - 1 if j > 0 else n2 - 1
            excess[i, b] += more
            flux2[i - 1, b] -= more
        else:
            excess[i, (j + 1) % n2] += more
            flux2[i - 1, j] += more


def balanced_flux(tail: Indices, head: Indices, width: Array, flux: Array, nodes: int) -> Array:
    """Flux near `flux` that balances at every node but node 0, where it enters and leaves.

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


@compiled()
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

"""Correct a flux so that it balances: the excess of every node is sent to the ends along a spanning tree.

The flux of a numerical solution balances up to rounding only, and at a high contrast rounding matters. A lower bound of
the flow (Thomson's principle) needs a flux that balances exactly.
"""

from __future__ import annotations

from math import frexp

import numpy as np

from ..base import Array
from ..base.compiled import compiled, inner
from .grid import Stencil
from .percolation import union

#: Exponents of two from the largest number down, and that of a closed link.
_LARGEST, _EXPONENTS, _CLOSED = 1024, 2100, -2000


def energy_gap(stencil: Stencil, potential: Array, complement: Array) -> float:
    """Bound of the relative error of the energy of a potential, on five points.

    It is the energy of the difference between the flux of the potential and one that balances: the least energy of all
    potentials lies between that of both (principles of Dirichlet and Thomson). NaN where no flow is left.
    """
    along, across = stencil.along, stencil.across
    excess, energy = _excess(along, across, potential, complement)
    tail, head = _grid_links(*along.shape, across.shape[1])
    link = _send(tail, head, _exponents(along.ravel(), across.ravel()), excess)
    gap = _energy(along.ravel(), across.ravel(), link, excess)
    return float(gap / energy) if energy > 0 else np.nan


@inner()
def potential_drop(φ, ψ, i, j, a, b):
    """Difference of the potential between nodes (i, j) and (a, b)."""
    one = φ[i, j]
    other = φ[a, b]
    one, other = 0.0 if np.isnan(one) else one, 0.0 if np.isnan(other) else other
    if one + other < 1.0:
        return one - other
    one = ψ[i, j]
    other = ψ[a, b]
    return (0.0 if np.isnan(other) else other) - (0.0 if np.isnan(one) else one)


@inner()
def _width(along, across, k):
    """Conductance of link k, those along before those across."""
    return along[k] if k < along.size else across[k - along.size]


@compiled()
def _excess(along, across, φ, ψ):
    """What flows into every node and not out of it, both ends being node 0, and the energy of the potential."""
    n1, n2 = along.shape
    excess, energy = np.zeros((n1 - 1) * n2 + 1), 0.0
    for i in range(n1):
        for j in range(n2):
            drop = potential_drop(φ, ψ, i, j, i + 1, j)
            node = (i - 1) * n2 + j + 1
            excess[node if i > 0 else 0] -= along[i, j] * drop
            excess[node + n2 if i < n1 - 1 else 0] += along[i, j] * drop
            energy += along[i, j] * drop**2
    for i in range(n1 - 1):
        for j in range(across.shape[1]):
            drop = potential_drop(φ, ψ, i + 1, j, i + 1, (j + 1) % n2)
            excess[i * n2 + j + 1] -= across[i, j] * drop
            excess[i * n2 + (j + 1) % n2 + 1] += across[i, j] * drop
            energy += across[i, j] * drop**2
    return excess, energy


@compiled()
def _energy(along, across, link, excess):
    """Energy of what every node sends along its link."""
    total = 0.0
    for node in range(1, link.size):
        if excess[node] != 0.0:
            total += excess[node] ** 2 / _width(along, across, link[node])
    return total


@compiled()
def _grid_links(n1, n2, m2):
    """Tail and head of all links along, then across, of a `Stencil`; both ends are node 0."""
    links = n1 * n2 + (n1 - 1) * m2
    tail = np.empty(links, np.int32)
    head = np.empty(links, np.int32)
    for i in range(n1):  # node (i, j) of row i >= 1 has the number (i − 1) n2 + j + 1
        for j in range(n2):
            k = i * n2 + j
            tail[k] = k - n2 + 1 if i > 0 else 0
            head[k] = k + 1 if i < n1 - 1 else 0
    for i in range(n1 - 1):
        for j in range(m2):
            k = n1 * n2 + i * m2 + j
            tail[k], head[k] = i * n2 + j + 1, i * n2 + (j + 1) % n2 + 1
    return tail, head


@compiled()
def _exponents(along, across):
    """Exponents of two of the widths of all links."""
    found = np.empty(along.size + across.size, np.int16)
    for k in range(found.size):
        width = _width(along, across, k)
        found[k] = frexp(width)[1] if width > 0.0 else _CLOSED
    return found


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
    link = _send(tail, head, _exponents(width, width[:0]), excess)
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
    # number of links of the tree at each node, and the exclusive or of their numbers: that of the last one
    degree = np.zeros(nodes, np.int32)
    link = np.zeros(nodes, np.int32)
    parent = np.arange(nodes).astype(np.int32)
    for k in _widest_first(exponent):
        if union(parent, tail[k], head[k]):
            for node in (tail[k], head[k]):
                degree[node] += 1
                link[node] ^= k
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

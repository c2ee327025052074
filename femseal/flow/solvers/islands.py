"""Islands: nodes of a network that only very narrow links connect with the others, between potentials that are known.

A neighbour of known potential φ acts as the inlet with the share φ of its link and as the outlet with 1 − φ. Small
islands are eliminated one by one, each in a dense array without subtraction, as `elimination` does it with large ones.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..stencil import Stencil
from .elimination import eliminate

Array = NDArray[np.float64]
#: Nodes up to which an island is eliminated in a dense array.
_SMALL = 100


def island_potentials(stencil: Stencil, hidden: NDArray[np.bool_], φ: Array) -> tuple[Array, Array]:
    """φ and 1 − φ of the inner nodes (n1 − 1, n2) with those of the hidden ones found from the others.

    Parameters
    ----------
    stencil : of a network, without nodes that are not connected to both ends.
    hidden : nodes whose potential is wanted.
    φ : potential of the others.
    """
    ψ = 1.0 - φ
    inlet, outlet = _known_neighbours(stencil.along, stencil.across, stencil.ring2, hidden, φ)
    potential, complement = φ.copy(), ψ
    done = _eliminate_small(stencil.along, stencil.across, stencil.ring2, hidden, inlet, outlet, potential, complement)
    if not done:
        _, one, other = eliminate(stencil.along, stencil.across, hidden, stencil.ring2, inlet, outlet)
        potential, complement = (
            np.where(hidden, found.reshape(hidden.shape), known) for found, known in ((one, φ), (other, ψ))
        )
    return potential, complement


@njit(cache=True, nogil=True)
def _link(k, i, j, c1, c2, ring):
    """Row, column and link of the k-th neighbour of an inner node; rows -1 and n1 − 1 are the ends."""
    n2 = c1.shape[1]
    if k == 0:
        return i - 1, j, c1[i, j]
    if k == 1:
        return i + 1, j, c1[i + 1, j]
    if k == 2:
        a = (j + 1) % n2
        return i, a, (c2[i, j] if (ring or a > j) and n2 > 1 else 0.0)
    a = (j - 1) % n2
    return i, a, (c2[i, a] if (ring or a < j) and n2 > 1 else 0.0)


@njit(cache=True, nogil=True)
def _known_neighbours(c1, c2, ring, hidden, φ):
    """Links of hidden nodes to known potentials, as links to inlet and outlet."""
    n1, n2 = hidden.shape
    inlet, outlet = np.zeros(hidden.shape), np.zeros(hidden.shape)
    for i in range(n1):
        for j in range(n2):
            if not hidden[i, j]:
                continue
            for k in range(4):
                a, b, c = _link(k, i, j, c1, c2, ring)
                if a < 0:
                    inlet[i, j] += c
                elif a == n1:
                    outlet[i, j] += c
                elif not hidden[a, b]:
                    known = min(max(φ[a, b], 0.0), 1.0)
                    inlet[i, j] += c * known
                    outlet[i, j] += c * (1.0 - known)
    return inlet, outlet


@njit(cache=True, nogil=True)
def _eliminate_small(c1, c2, ring, hidden, inlet, outlet, potential, complement):
    """Write φ and 1 − φ of all islands; whether all were small enough."""
    n1, n2 = hidden.shape
    place = np.full(hidden.shape, -1, np.int32)  # of a node in its island
    nodes = np.empty((_SMALL + 5, 2), np.int64)
    links = np.empty((_SMALL, _SMALL + 2))
    for i0 in range(n1):
        for j0 in range(n2):
            if not hidden[i0, j0] or place[i0, j0] >= 0:
                continue
            nodes[0, 0], nodes[0, 1] = i0, j0
            place[i0, j0] = 0
            m, q = 1, 0
            while q < m:
                i, j = nodes[q]
                q += 1
                for k in range(4):
                    a, b, c = _link(k, i, j, c1, c2, ring)
                    if c > 0.0 and 0 <= a < n1 and hidden[a, b] and place[a, b] < 0:
                        if m == _SMALL:
                            return False
                        place[a, b] = m
                        nodes[m, 0], nodes[m, 1] = a, b
                        m += 1
            # columns 0 and 1 are inlet and outlet
            links[:m, : m + 2] = 0.0
            for q in range(m):
                i, j = nodes[q]
                links[q, 0], links[q, 1] = inlet[i, j], outlet[i, j]
                for k in range(4):
                    a, b, c = _link(k, i, j, c1, c2, ring)
                    if c > 0.0 and 0 <= a < n1 and hidden[a, b]:
                        links[q, 2 + place[a, b]] += c
            for q in range(m - 1, -1, -1):
                total = 0.0
                for k in range(q + 2):
                    total += links[q, k]
                if total > 0.0:
                    for k in range(q + 2):
                        links[q, k] /= total
                for p in range(q):
                    weight = links[p, 2 + q]
                    if weight > 0.0:
                        for k in range(q + 2):
                            links[p, k] += weight * links[q, k]
            for q in range(m):
                high, low = links[q, 0], links[q, 1]
                for p in range(q):
                    a, b = nodes[p]
                    high += links[q, 2 + p] * potential[a, b]
                    low += links[q, 2 + p] * complement[a, b]
                potential[nodes[q, 0], nodes[q, 1]] = high
                complement[nodes[q, 0], nodes[q, 1]] = low
    return True

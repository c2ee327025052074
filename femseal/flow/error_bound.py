"""Bound the error of a potential on a structured grid by a flux that balances at every node.

The energy of a computed potential is above that of the flow (Dirichlet's principle), and that of any flux that balances
gives a value below it (Thomson's principle). Here the flux of the potential is corrected: every node sends its excess
towards an end along a spanning tree of wide links. The energy of this correction bounds the error.
"""

from __future__ import annotations

import numpy as np

from ..base import Array
from ..base.compiled import compiled, inner
from .grid import Stencil

#: Bits of a double below its exponent, and lowest bits of the exponent that are left out: conductances within a factor
#: of 16 are one class.
_FRACTION_BITS, _CLASS_BITS = 52, 2
#: Number of classes of conductances, the widest last; class of a node that the tree has reached.
_CLASSES, _REACHED = 2 ** (11 - _CLASS_BITS), 2 ** (11 - _CLASS_BITS) + 1
#: Directions from a node to its neighbours.
_UP, _DOWN, _LEFT, _RIGHT = 0, 1, 2, 3


def energy_gap(stencil: Stencil, potential: Array, complement: Array) -> float:
    """Bound the relative error of the energy of a potential on a stencil of five points.

    Parameters
    ----------
    stencil : conductances between the nodes.
    potential, complement : φ (n1 + 1, n2) and 1 − φ; NaN counts as 0.

    Returns
    -------
    float : the bound, NaN without a flow.
    """
    none = np.zeros((0, 0), np.bool_)
    return float(error_bound(stencil.along, stencil.across, potential, complement, none))


@inner()
def potential_drop(φ, ψ, i, j, a, b):
    """Return the drop of the potential from node (i, j) to node (a, b), from whichever of φ and ψ = 1 − φ is smaller.

    The smaller one has the smaller rounding errors. NaN counts as 0.
    """
    here, there = φ[i, j], φ[a, b]
    here, there = 0.0 if np.isnan(here) else here, 0.0 if np.isnan(there) else there
    if here + there < 1.0:
        return here - there
    here, there = ψ[i, j], ψ[a, b]
    return (0.0 if np.isnan(there) else there) - (0.0 if np.isnan(here) else here)


@compiled()
def error_bound(along, across, φ, ψ, hidden):
    """Bound the relative error of the energy of φ, see `energy_gap`.

    hidden : inner nodes (n1 − 1, n2) that count as balanced; none where it is empty.
    """
    excess, energy = _excess(along, across, φ, ψ)
    flags = hidden.ravel()
    for node in range(flags.size):
        if flags[node]:
            excess[node] = 0.0
    correction = _correction_energy(along, across, excess)
    return correction / energy if energy > 0.0 else np.nan


@inner()
def _excess(along, across, φ, ψ):
    """Return what flows into every inner node and not out of it, and the energy of the potential."""
    n1, n2 = along.shape[0] - 1, along.shape[1]
    excess = np.zeros(n1 * n2)
    energy = 0.0
    for i in range(n1 + 1):
        for j in range(n2):
            drop = potential_drop(φ, ψ, i, j, i + 1, j)
            flux = along[i, j] * drop
            if i > 0:
                excess[(i - 1) * n2 + j] -= flux
            if i < n1:
                excess[i * n2 + j] += flux
            energy += flux * drop
    for i in range(n1):
        for j in range(across.shape[1]):
            beside = (j + 1) % n2
            drop = potential_drop(φ, ψ, i + 1, j, i + 1, beside)
            flux = across[i, j] * drop
            excess[i * n2 + j] -= flux
            excess[i * n2 + beside] += flux
            energy += flux * drop
    return excess, energy


@inner()
def _classes(conductances):
    """Return the class of every conductance: 0 of closed links, else rising with the exponent."""
    bits = conductances.view(np.int64)
    classes = np.zeros(conductances.shape, np.int16)
    for i in range(conductances.shape[0]):
        for j in range(conductances.shape[1]):
            if conductances[i, j] > 0.0:
                # the exponent of a positive double is in its highest bits
                classes[i, j] = (bits[i, j] >> (_FRACTION_BITS + _CLASS_BITS)) + 1
    return classes


@inner()
def _offer(node, direction, width, widest_offer, queues):
    """Queue the link of a node in a direction, unless one as wide has been offered to the node before.

    width : class of the link, 0 where it is closed. Returns the class.
    """
    first, last, following = queues
    if width > widest_offer[node]:
        widest_offer[node] = width
        entry = 4 * node + direction
        following[entry] = -1
        if first[width] < 0:
            first[width] = entry
        else:
            following[last[width]] = entry
        last[width] = entry
    return width


@inner()
def _widest_tree(along, across):
    """Grow a tree from both ends along the widest links (Prim), of one class along those that were met first.

    Returns the inner nodes in the order in which the tree reaches them, their number, and the direction of the link of
    each towards its end.
    """
    n1, n2 = along.shape[0] - 1, along.shape[1]
    m2 = across.shape[1]
    columns, rows = _classes(along), _classes(across)
    widest_offer = np.zeros(n1 * n2, np.int16)
    # a queue for each class, as a linked list; an entry is a node and the direction of a link
    first = np.full(_CLASSES + 1, -1, np.int32)
    last = np.full(_CLASSES + 1, -1, np.int32)
    following = np.empty(4 * n1 * n2, np.int32)
    queues = first, last, following
    order = np.empty(n1 * n2, np.int32)
    towards = np.empty(n1 * n2, np.int8)
    width = 0
    for j in range(n2):
        width = max(width, _offer(j, _UP, columns[0, j], widest_offer, queues))
        at_outlet = (n1 - 1) * n2 + j
        width = max(width, _offer(at_outlet, _DOWN, columns[n1, j], widest_offer, queues))
    count = 0
    while width > 0:
        entry = first[width]
        if entry < 0:
            width -= 1
            continue
        first[width] = following[entry]
        node = entry // 4
        if widest_offer[node] == _REACHED:
            continue
        widest_offer[node] = _REACHED
        towards[node] = entry % 4
        order[count] = node
        count += 1
        i, j = node // n2, node % n2
        if i > 0:
            width = max(width, _offer(node - n2, _DOWN, columns[i, j], widest_offer, queues))
        if i < n1 - 1:
            width = max(width, _offer(node + n2, _UP, columns[i + 1, j], widest_offer, queues))
        if j < m2:
            right = node + 1 if j + 1 < n2 else node + 1 - n2
            width = max(width, _offer(right, _LEFT, rows[i, j], widest_offer, queues))
        before = j - 1 if j > 0 else n2 - 1
        if before < m2:
            left = i * n2 + before
            width = max(width, _offer(left, _RIGHT, rows[i, before], widest_offer, queues))
    return order, count, towards


@inner()
def _correction_energy(along, across, excess):
    """Send the excess of every node to an end along a tree of wide links, and return the energy of this flux."""
    n1, n2 = along.shape[0] - 1, along.shape[1]
    order, count, towards = _widest_tree(along, across)
    energy = 0.0
    for k in range(count - 1, -1, -1):  # the last ones have no nodes beyond them
        node = order[k]
        if excess[node] == 0.0:
            continue
        i, j = node // n2, node % n2
        direction = towards[node]
        if direction == _UP:
            conductance = along[i, j]
            other = node - n2 if i > 0 else -1
        elif direction == _DOWN:
            conductance = along[i + 1, j]
            other = node + n2 if i < n1 - 1 else -1
        elif direction == _RIGHT:
            conductance = across[i, j]
            other = node + 1 if j + 1 < n2 else node + 1 - n2
        else:
            before = j - 1 if j > 0 else n2 - 1
            conductance = across[i, before]
            other = i * n2 + before
        energy += excess[node] ** 2 / conductance
        if other >= 0:
            excess[other] += excess[node]
    return energy

"""Bound the error of a potential on a structured grid by a flux that balances at every node.

The energy of a computed potential is above that of the flow (Dirichlet's principle), and that of any flux that balances
gives a value below it (Thomson's principle). Here the flux of the potential is corrected: every node sends its excess
towards an end along a spanning tree of wide links. The energy of this correction bounds the error.

To save time the tree is one of runs: neighbouring nodes of a row between narrow links. A run sends its excess along its
row to the node where it is joined to the next run of the tree. A bound takes the time of a few iterations of multigrid.
"""

from __future__ import annotations

from math import frexp

import numpy as np

from ..base import Array
from ..base.compiled import compiled, inner
from .balance import spanning_tree
from .grid import Stencil

#: A run ends at a link that is narrower than this fraction of its widest link.
_NARROW = 1 / 64


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
def _runs(along, across):
    """Divide the inner nodes of each row into runs.

    Returns the run of every inner node, from 1 on, 0 for closed nodes; the first node of each run; their number plus 1.
    """
    n1, n2 = along.shape[0] - 1, along.shape[1]
    m2 = across.shape[1]
    run = np.zeros((n1, n2), np.int32)
    first = np.empty(n1 * n2 + 2, np.int32)
    count = 0
    for i in range(n1):
        widest = 0.0
        is_inside = False
        for j in range(n2):
            left = across[i, j - 1] if j > 0 else 0.0
            right = across[i, j] if j < m2 else 0.0
            if j == 0 and m2 == n2:
                is_open = along[i, 0] + along[i + 1, 0] + right + across[i, n2 - 1] > 0.0
            else:
                is_open = along[i, j] + along[i + 1, j] + right + left > 0.0
            if not is_open:
                is_inside = False
                continue
            if is_inside and left > 0.0 and left >= _NARROW * widest:
                widest = max(widest, left)
            else:
                count += 1
                first[count] = i * n2 + j
                widest = 0.0
            is_inside = True
            run[i, j] = count
    return run, first, count + 1


@inner()
def _joints(along, across, run):
    """Find the links that may join runs: the widest one between two runs above each other, and narrow ones in a row.

    The ends are run 0. A link has the number i n2 + j along, and n1 n2 more across, with n1 rows of links along.

    Returns the two runs, the link and its exponent of two for every joint.
    """
    n1, n2 = along.shape
    most = along.size + across.size
    above = np.empty(most, np.int32)
    below = np.empty(most, np.int32)
    link = np.empty(most, np.int32)
    exponent = np.empty(most, np.int16)
    count = 0
    for i in range(n1):
        last_a = last_b = -1
        widest = 0.0
        for j in range(n2):
            width = along[i, j]
            if not width > 0.0:
                continue
            a = run[i - 1, j] if i > 0 else 0
            b = run[i, j] if i < n1 - 1 else 0
            if a == last_a and b == last_b:
                if width > widest:
                    widest = width
                    link[count - 1] = i * n2 + j
                    exponent[count - 1] = frexp(width)[1]
                continue
            last_a, last_b = a, b
            widest = width
            above[count], below[count], link[count] = a, b, i * n2 + j
            exponent[count] = frexp(width)[1]
            count += 1
    for i in range(n1 - 1):
        for j in range(across.shape[1]):
            a = run[i, j]
            b = run[i, (j + 1) % n2]
            if across[i, j] > 0.0 and a != b:
                above[count], below[count], link[count] = a, b, n1 * n2 + i * n2 + j
                exponent[count] = frexp(across[i, j])[1]
                count += 1
    return above[:count], below[:count], link[:count], exponent[:count]


@inner()
def _correction_energy(along, across, excess):
    """Send the excess of every node to an end along a tree of runs, and return the energy of this flux."""
    run, first, runs = _runs(along, across)
    above, below, link, exponent = _joints(along, across, run)
    degree, joint = spanning_tree(above, below, exponent, runs)
    energy = 0.0
    for leaf in range(1, runs):
        a = np.int64(leaf)
        while a != 0 and degree[a] == 1:
            k = joint[a]
            other = np.int64(above[k]) + below[k] - a
            energy += _emptied(along, across, run, first[a], link[k], excess, a)
            degree[a] = 0
            degree[other] -= 1
            joint[other] ^= k
            a = other
    return energy


@inner()
def _emptied(along, across, run, first, link, excess, number):
    """Send the excess of a run through a link to another run, and return the energy of this flux."""
    n1, n2 = along.shape
    flat = run.reshape(-1)
    i = first // n2
    end = (i + 1) * n2
    if link < n1 * n2:
        row, j = link // n2, link % n2
        conductance = along[row, j]
        node = i * n2 + j
        other = node - n2 if row == i else node + n2
        if row == 0 or row == n1 - 1:
            other = -1
    else:
        j = (link - n1 * n2) % n2
        conductance = across[i, j]
        node = i * n2 + j
        other = i * n2 + (j + 1) % n2
        if flat[node] != number:
            node, other = other, node
    energy = 0.0
    total = 0.0
    for k in range(first, node):
        total += excess[k]
        energy += total**2 / across[i, k - i * n2]
    last = node
    while last + 1 < end and flat[last + 1] == number:
        last += 1
    beyond = 0.0
    for k in range(last, node, -1):
        beyond += excess[k]
        energy += beyond**2 / across[i, k - 1 - i * n2]
    total += beyond + excess[node]
    energy += total**2 / conductance
    if other >= 0:
        excess[other] += total
    return energy

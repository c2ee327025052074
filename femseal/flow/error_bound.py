"""Bound the error of a potential on a structured grid by means of a flux that is conserved at every node.

The energy of a computed potential is an upper bound of the exact energy (Dirichlet's principle). Any conserved flux
yields a lower bound (Thomson's principle). The flux of the computed potential is made conservative: the excess of each
node, that is, inflow less outflow, is sent along a spanning tree to the inlet or the outlet. The tree consists of links
with large conductances. The energy of the correcting flux is a bound of the error.

To save time, the spanning tree connects *runs* of nodes and not single nodes. A run is a sequence of neighbouring nodes
in the same row of the grid. Two runs of the same row are separated by a narrow link, that is, a link with a small
conductance. The excess of all nodes of a run is collected at one of them, and then sent through a link to the parent of
the run in the tree. Finding the tree takes about as long as a multigrid iteration. If the error of several potentials
of the same network is bounded, the tree is used again.
"""

from __future__ import annotations

from math import frexp
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base import Array
from ..base.compiled import REORDERED, compiled, inlined, inner, leader
from .balance import spanning_tree
from .grid import Stencil

#: A run of nodes ends at a link whose conductance is below this fraction of the largest conductance within the run.
_NARROW = 1 / 64


class Drainage(NamedTuple):
    """Spanning tree of the runs of a network, through which the excess of all nodes is sent to the inlet or the outlet.

    The arrays have one entry for each run; each run comes before its parent. Inner nodes are numbered row by row.

    first, last : first node and last node of the run.
    exit_node : node of the run from which the excess leaves to the parent.
    parent_node : node of the parent that receives the excess; −1 for the inlet or the outlet.
    conductance : conductance of the link between `exit_node` and `parent_node`.
    """

    first: NDArray[np.int32]
    last: NDArray[np.int32]
    exit_node: NDArray[np.int32]
    parent_node: NDArray[np.int32]
    conductance: Array


def least_conductance(stencil: Stencil, potential: Array, complement: Array) -> float:
    """Compute a lower bound of the conductance of a network from an approximate potential.

    Parameters
    ----------
    stencil : conductances of the links between the nodes.
    potential, complement : arrays (n1 + 1, n2), potential φ and 1 − φ at the nodes; NaN counts as 0. If conductances
        differ by many orders of magnitude, the complement must be accurate by itself. The difference 1 − φ has a
        rounding error of 1e-16, which is a large flux through a link with a large conductance.

    Returns
    -------
    float : the energy of the potential less the energy of the flux that makes it conservative; at least 0.
    """
    along, across = stencil.along, stencil.across
    excess, energy = excess_and_energy(along, across, potential, complement)
    correction = correction_energy(across, find_drainage(along, across), excess)
    return max(0.0, float(energy - correction))


@inner()
def potential_drop(φ, ψ, i, j, a, b):
    """Return the potential drop from node (i, j) to node (a, b).

    The drop is computed from the potential φ or from the complement ψ = 1 − φ. The smaller of the two is used, because
    its rounding errors are smaller. NaN counts as 0.
    """
    here, there = φ[i, j], φ[a, b]
    here, there = 0.0 if np.isnan(here) else here, 0.0 if np.isnan(there) else there
    if here + there < 1.0:
        return here - there
    here, there = ψ[i, j], ψ[a, b]
    return (0.0 if np.isnan(there) else there) - (0.0 if np.isnan(here) else here)


@compiled()
def excess_and_energy(along, across, φ, ψ):
    """Compute the excess of each inner node, that is, inflow less outflow, and the energy of the potential.

    Inner nodes are numbered row by row. Row i of the inner nodes is row i + 1 of φ, because row 0 of φ is the inlet.

    φ, ψ : arrays (n1 + 1, n2), potential φ and complement ψ = 1 − φ at the nodes.

    Returns
    -------
    Excess as an array (inner nodes,), and energy.
    """
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
            next_column = (j + 1) % n2
            drop = potential_drop(φ, ψ, i + 1, j, i + 1, next_column)
            flux = across[i, j] * drop
            excess[i * n2 + j] -= flux
            excess[i * n2 + next_column] += flux
            energy += flux * drop
    return excess, energy


@inlined()
def _runs(along, across):
    """Divide the inner nodes of each row into runs, see the docstring of the module.

    Returns
    -------
    run : array (n1 − 1, n2), number of the run to which each inner node belongs. Runs are numbered from 1; closed nodes
        have the number 0.
    first : array, number of the first node of each run. Inner nodes are numbered row by row.
    runs : number of runs plus 1, because run 0 represents the inlet and the outlet.
    """
    n1, n2 = along.shape[0] - 1, along.shape[1]
    m2 = across.shape[1]
    run = np.zeros((n1, n2), np.int32)
    first = np.empty(n1 * n2 + 2, np.int32)
    count = 0
    for i in range(n1):
        largest = 0.0  # largest conductance inside the present run
        is_inside = False  # whether the node on the left is open
        for j in range(n2):
            left = across[i, j - 1] if j > 0 else 0.0
            right = across[i, j] if j < m2 else 0.0
            # the links above and below are along[i, j] and along[i + 1, j]; a ring also has a link over its seam
            if j == 0 and m2 == n2:
                is_open = along[i, 0] + along[i + 1, 0] + right + across[i, n2 - 1] > 0.0
            else:
                is_open = along[i, j] + along[i + 1, j] + right + left > 0.0
            if not is_open:
                is_inside = False
                continue
            if is_inside and left > 0.0 and left >= _NARROW * largest:
                largest = max(largest, left)
            else:  # the link on the left is narrow, so that a new run begins
                count += 1
                first[count] = i * n2 + j
                largest = 0.0
            is_inside = True
            run[i, j] = count
    return run, first, count + 1


@inlined()
def _joints(along, across, run, first, runs):
    """Find the joints: the links through which the spanning tree may connect two runs.

    The joint of two runs in adjacent rows is the link with the largest conductance between the two runs. Two adjacent
    runs in the same row are joined by the narrow link that separates them. Run 0 represents the inlet and the outlet.
    For an array `along` of the shape (n1, n2), link (i, j) of `along` has the number i n2 + j. Link (i, j) of `across`
    has the number n1 n2 + i n2 + j.

    run, first, runs : results of `_runs`.

    Returns
    -------
    above, below : numbers of the two runs that each joint connects.
    link : number of the link that forms each joint.
    exponent : binary exponent of the conductance of each joint.
    """
    n1, n2 = along.shape
    most = along.size + across.size
    above = np.empty(most, np.int32)
    below = np.empty(most, np.int32)
    link = np.empty(most, np.int32)
    count = 0
    # links between two rows of nodes
    for i in range(n1):
        # the two runs that the last joint of this row of links connects, and the conductance of the joint
        last_above = last_below = -1
        largest = 0.0
        for j in range(n2):
            conductance = along[i, j]
            if not conductance > 0.0:
                continue
            run_above = run[i - 1, j] if i > 0 else 0
            run_below = run[i, j] if i < n1 - 1 else 0
            if run_above == last_above and run_below == last_below:
                # another link between the same two runs: the joint is the link with the larger conductance
                if conductance > largest:
                    largest = conductance
                    link[count - 1] = i * n2 + j
                continue
            last_above, last_below = run_above, run_below
            largest = conductance
            above[count], below[count], link[count] = run_above, run_below, i * n2 + j
            count += 1
    # links between two runs of the same row: the link on the left of the first node of a run, and the seam of a ring
    for k in range(1, runs):
        i, j = first[k] // n2, first[k] % n2
        if j > 0 and across[i, j - 1] > 0.0:
            above[count], below[count], link[count] = k - 1, k, n1 * n2 + i * n2 + j - 1
            count += 1
    if across.shape[1] == n2:
        for i in range(n1 - 1):
            if across[i, n2 - 1] > 0.0 and run[i, n2 - 1] != run[i, 0]:
                above[count], below[count] = run[i, n2 - 1], run[i, 0]
                link[count] = n1 * n2 + i * n2 + n2 - 1
                count += 1
    exponent = np.empty(count, np.int16)
    for k in range(count):
        exponent[k] = frexp(_conductance(along, across, link[k])[0])[1]
    return above[:count], below[:count], link[:count], exponent


@inner()
def _conductance(along, across, link):
    """Return the conductance of a link, whether the link is one of `along`, and its row and column in the array.

    link : number of the link, counted as in `_joints`.
    """
    n1, n2 = along.shape
    is_along = link < n1 * n2
    i = link // n2 if is_along else (link - n1 * n2) // n2
    j = link % n2
    return (along[i, j] if is_along else across[i, j]), is_along, i, j


@compiled()
def find_drainage(along, across):
    """Find a spanning tree of runs through which the excess of all nodes can be sent."""
    n1, n2 = along.shape
    run, first_node, runs = _runs(along, across)
    above, below, link, exponent = _joints(along, across, run, first_node, runs)
    order, joint = spanning_tree(above, below, exponent, runs)
    run_of_node = run.reshape(-1)
    first = np.empty(order.size, np.int32)
    last = np.empty_like(first)
    exit_node = np.empty_like(first)
    parent_node = np.empty_like(first)
    conductance = np.empty(order.size)
    for k in range(order.size):
        number = order[k]
        node = np.int64(first_node[number])
        i = node // n2  # row of the run
        first[k] = node
        row_end = (i + 1) * n2  # number of the node after the last node of this row
        while node + 1 < row_end and run_of_node[node + 1] == number:
            node += 1
        last[k] = node
        conductance[k], is_along, row, j = _conductance(along, across, link[joint[number]])
        if is_along:
            # row i of `along` contains the links above the inner nodes of row i, and row i + 1 the links below
            exit_node[k] = i * n2 + j
            parent_node[k] = exit_node[k] - n2 if row == i else exit_node[k] + n2
            if row == 0 or row == n1 - 1:
                parent_node[k] = -1  # inlet or outlet, whose excess is not stored
        else:
            left, right = i * n2 + j, i * n2 + (j + 1) % n2
            is_left = run_of_node[left] == number
            exit_node[k], parent_node[k] = (left, right) if is_left else (right, left)
    return Drainage(first, last, exit_node, parent_node, conductance)


@leader(**REORDERED)
def no_drainage():
    """Return a drainage without runs, as long as no drainage has been found."""
    none = np.empty(0, np.int32)
    return Drainage(none, none, none, none, np.empty(0))


@compiled()
def correction_energy(across, drainage, excess):
    """Send the excess of all nodes through the drainage to the inlet or the outlet.

    excess : excess of the inner nodes, numbered row by row; the array is overwritten.

    Returns the energy Σ q²/c of the fluxes q that carry the excess through links with the conductances c.
    """
    n2 = excess.size // across.shape[0]
    energy = 0.0
    for k in range(drainage.first.size):
        first, last = np.int64(drainage.first[k]), np.int64(drainage.last[k])
        exit_node, parent_node = np.int64(drainage.exit_node[k]), np.int64(drainage.parent_node[k])
        row = first // n2
        to_right = across[row]  # conductance of the link from each node of the row to the next node
        start = row * n2  # first node of the row
        # the excess of the nodes on the left of `exit_node` is sent to the right, from node to node
        from_left = 0.0
        for node in range(first, exit_node):
            from_left += excess[node]
            energy += from_left**2 / to_right[node - start]
        # the excess of the nodes on the right of `exit_node` is sent to the left, beginning at the last node
        from_right = 0.0
        for node in range(last, exit_node, -1):
            from_right += excess[node]
            energy += from_right**2 / to_right[node - 1 - start]
        # finally, the sum is sent through the link to the parent
        total = from_left + from_right + excess[exit_node]
        energy += total**2 / drainage.conductance[k]
        if parent_node >= 0:
            excess[parent_node] += total
    return energy

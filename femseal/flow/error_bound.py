"""Bound the error of a potential on a structured grid by means of a flux that is conserved at every node.

The energy of a computed potential is an upper bound of the exact energy (Dirichlet's principle). Any conserved flux
yields a lower bound (Thomson's principle). The flux of the computed potential is made conservative: the excess of each
node, that is, inflow less outflow, is sent along a spanning tree to the inlet or the outlet. The tree consists of links
with large conductances. The energy of the correcting flux is a bound of the error.

To save time, the spanning tree connects *runs* of nodes and not single nodes. A run is a sequence of neighbouring nodes
in the same row of the grid. Two runs of the same row are separated by a narrow link, that is, a link with a small
conductance. The excess of all nodes of a run is collected at one of them, and then sent through a link to the parent of
the run in the tree. Computing the bound takes about as long as a few multigrid iterations.
"""

from __future__ import annotations

from math import frexp

import numpy as np

from ..base import Array
from ..base.compiled import compiled, inlined, inner
from .balance import spanning_tree
from .grid import Stencil

#: A run of nodes ends at a link whose conductance is below this fraction of the largest conductance within the run.
_NARROW = 1 / 64


def energy_gap(stencil: Stencil, potential: Array, complement: Array) -> float:
    """Compute an upper bound of the relative error of the energy of a potential.

    Parameters
    ----------
    stencil : conductances of the links between the nodes.
    potential, complement : arrays (n1 + 1, n2), potential φ and 1 − φ at the nodes; NaN counts as 0.

    Returns
    -------
    float : upper bound of the relative error; NaN if nothing flows.
    """
    none_ignored = np.zeros((0, 0), np.bool_)
    return float(error_bound(stencil.along, stencil.across, potential, complement, none_ignored))


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
def error_bound(along, across, φ, ψ, ignored):
    """Compute the upper bound of the relative error of the energy, see `energy_gap`.

    φ, ψ : arrays (n1 + 1, n2), potential φ and complement ψ = 1 − φ at the nodes.
    ignored : flags (n1 − 1, n2) of the inner nodes whose excess is set to 0; an empty array if there are no such nodes.
    """
    excess, energy = _excess(along, across, φ, ψ)
    is_ignored = ignored.ravel()
    for node in range(is_ignored.size):
        if is_ignored[node]:
            excess[node] = 0.0
    correction = _correction_energy(along, across, excess)
    return correction / energy if energy > 0.0 else np.nan


@inlined()
def _excess(along, across, φ, ψ):
    """Compute the excess of each inner node, that is, inflow less outflow, and the energy of the potential.

    Inner nodes are numbered row by row. Row i of the inner nodes is row i + 1 of φ, because row 0 of φ is the inlet.

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
    size : number of runs plus 1, because run 0 represents the inlet and the outlet.
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
def _joints(along, across, run):
    """Find the joints: the links through which the spanning tree may connect two runs.

    The joint of two runs in adjacent rows is the link with the largest conductance between the two runs. Two adjacent
    runs in the same row are joined by the narrow link that separates them. Run 0 represents the inlet and the outlet.
    For an array `along` of the shape (n1, n2), link (i, j) of `along` has the number i n2 + j. Link (i, j) of `across`
    has the number n1 n2 + i n2 + j.

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
    exponent = np.empty(most, np.int16)
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
                    exponent[count - 1] = frexp(conductance)[1]
                continue
            last_above, last_below = run_above, run_below
            largest = conductance
            above[count], below[count], link[count] = run_above, run_below, i * n2 + j
            exponent[count] = frexp(conductance)[1]
            count += 1
    # links between two runs of the same row
    for i in range(n1 - 1):
        for j in range(across.shape[1]):
            run_left = run[i, j]
            run_right = run[i, (j + 1) % n2]
            if across[i, j] > 0.0 and run_left != run_right:
                above[count], below[count], link[count] = run_left, run_right, n1 * n2 + i * n2 + j
                exponent[count] = frexp(across[i, j])[1]
                count += 1
    return above[:count], below[:count], link[:count], exponent[:count]


@inlined()
def _correction_energy(along, across, excess):
    """Send the excess of all nodes along a spanning tree of runs to the inlet or the outlet.

    Returns the energy of the flux that carries the excess.
    """
    run, first, runs = _runs(along, across)
    above, below, link, exponent = _joints(along, across, run)
    degree, joints_xor = spanning_tree(above, below, exponent, runs)
    energy = 0.0
    # Remove the leaves of the tree one after another. A leaf has a single remaining joint, so that the exclusive or of
    # the numbers of its joints is the number of this joint, see `spanning_tree`.
    for leaf in range(1, runs):
        number = np.int64(leaf)  # of the run
        while number != 0 and degree[number] == 1:
            k = joints_xor[number]
            parent = np.int64(above[k]) + below[k] - number  # the other run of the joint
            energy += _send_excess(along, across, run, first[number], link[k], excess, number)
            degree[number] = 0
            degree[parent] -= 1
            joints_xor[parent] ^= k  # removes joint k from the joints of the parent
            number = parent  # the parent may have become a leaf
    return energy


@inlined()
def _send_excess(along, across, run, first, link, excess, number):
    """Send the excess of a run through a link to the parent of the run in the tree.

    Returns the energy Σ q²/c of the fluxes q in the links, which have the conductances c.

    first : number of the first node of the run.
    link : number of the link to the parent, counted as in `_joints`.
    number : number of the run.
    """
    # Part 1: find the two nodes of the link, and its conductance. Inner nodes are numbered row by row.
    n1, n2 = along.shape
    run_of_node = run.reshape(-1)
    i = first // n2  # row of the run
    row_end = (i + 1) * n2  # number of the node after the last node of this row
    # the link leads from `exit_node` of this run to `parent_node` of its parent
    is_along = link < n1 * n2  # otherwise it is a link of `across`
    if is_along:
        link_row = link // n2
        j = link % n2
        conductance = along[link_row, j]
        exit_node = i * n2 + j
        # row i of `along` contains the links above the inner nodes of row i, and row i + 1 the links below these nodes
        parent_node = exit_node - n2 if link_row == i else exit_node + n2
        if link_row == 0 or link_row == n1 - 1:
            parent_node = -1  # inlet or outlet, whose excess is not stored
    else:
        j = (link - n1 * n2) % n2
        conductance = across[i, j]
        exit_node = i * n2 + j
        parent_node = i * n2 + (j + 1) % n2
        if run_of_node[exit_node] != number:
            exit_node, parent_node = parent_node, exit_node
    # Part 2: send the excess, and add up the energies q²/c of the fluxes q. The excess of the nodes on the left of
    # `exit_node` is sent to the right, from node k to node k + 1, through the links of the row.
    energy = 0.0
    total = 0.0
    for k in range(first, exit_node):
        total += excess[k]
        energy += total**2 / across[i, k - i * n2]
    # the excess of the nodes on the right of `exit_node` is sent to the left, beginning at the last node of the run
    last = exit_node
    while last + 1 < row_end and run_of_node[last + 1] == number:
        last += 1
    from_right = 0.0
    for k in range(last, exit_node, -1):
        from_right += excess[k]
        energy += from_right**2 / across[i, k - 1 - i * n2]
    # finally, the sum is sent through the link to the parent
    total += from_right + excess[exit_node]
    energy += total**2 / conductance
    if parent_node >= 0:
        excess[parent_node] += total
    return energy

"""Solve the coarsest multigrid level by elimination.

The nodes of the coarsest level are eliminated one after another, row by row, without subtractions, as in `elimination`.
The inlet and the outlet are a single node with the potential 0. The links are stored as a band matrix, for which the
nodes need no further ordering. The elimination of a small coarsest level takes only a small part of the solution time.
Operators, levels and borders are as in `hierarchy`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base import Indices, Singles
from ...base.compiled import REORDERED, compiled, inlined

#: A diagonal entry less the conductances to all neighbours is the conductance to inlet and outlet. The difference
#: counts as a rounding error if it is below this fraction of the diagonal entry.
_ROUNDING = 1e-13


class Coarsest(NamedTuple):
    """The coarsest level, after the elimination of all its nodes.

    number : array (n1, n2), position of each node in the order of elimination.
    band : array (≥ n, width), conductances of the links from each node to the `width` nodes that are eliminated next,
        as they are when the node is eliminated.
    inverse : array (n,), 1/Σc for each node, where c are the conductances of its links in `band` and to inlet and
        outlet; 0 for a node without links.
    """

    number: Indices
    band: Singles
    inverse: Singles


@inlined(**REORDERED)
def _number_nodes(n1, n2, ring):
    """Number the nodes along the shorter axis first, so that linked nodes have similar numbers.

    If the columns form a ring, the columns on the left and on the right of the seam are numbered alternately, so that
    nodes that are linked over the seam also have similar numbers.

    Returns the numbers as an array (n1, n2), and the largest difference between the numbers of two linked nodes.
    """
    number = np.empty((n1, n2), np.int64)
    for j in range(n2):
        column = j
        if ring:
            column = 2 * j if 2 * j < n2 else 2 * (n2 - 1 - j) + 1
        for i in range(n1):
            number[i, j] = i * n2 + column if n2 <= n1 else column * n1 + i
    # neighbours in a row differ by `step` in the number of the column, and diagonal neighbours also by one row
    step = 2 if ring else 1
    return number, (n2 + step if n2 <= n1 else step * n1 + 1)


@inlined(**REORDERED)
def _store_as_band(operator, number, width, ring):
    """Store the links of all nodes of an operator as a band matrix.

    operator, ring : as in `eliminate_coarsest`.
    number, width : results of `_number_nodes`.

    Returns
    -------
    band : array (n + width, width). Entry a of row k is the conductance of the link between the nodes k and k + 1 + a.
        The last `width` rows are empty, so that no loop has to check whether it goes beyond the last node.
    to_ends : array (n + width,), conductance between each node and inlet and outlet.
    """
    centre = operator[0]
    n1, n2 = number.shape
    n = n1 * n2
    band = np.zeros((n + width, width), np.float32)
    to_ends = np.zeros(n + width, np.float32)
    # the nodes count from 0 in `number`, and from 1 in the arrays of the operator, which have a border
    for i in range(n1):
        for j in range(n2):
            k = number[i, j]
            # diagonal entry less all conductances to neighbours: the rest is the conductance to inlet and outlet
            rest = centre[i + 1, j + 1]
            # links to the right, below, below right and below left: operator[1] to operator[4]
            for side in range(1, 5):
                # row and column of the neighbour, relative to the node
                down = (0, 1, 1, 1)[side - 1]
                right = (1, 0, 1, -1)[side - 1]
                link = operator[side]
                if link.size == 1:  # a five-point operator has no diagonal links
                    continue
                # link from this node to its neighbour, and link from the neighbour on the opposite side to this node
                rest -= link[i + 1, j + 1] + link[i + 1 - down, j + 1 - right]
                column = (j + right) % n2 if ring else j + right
                if i + down < n1 and 0 <= column < n2 and number[i + down, column] != k:
                    other = number[i + down, column]
                    # each link is stored at the node that is eliminated first
                    band[min(k, other), abs(k - other) - 1] += link[i + 1, j + 1]
            if rest > _ROUNDING * centre[i + 1, j + 1]:
                to_ends[k] = rest
    return band, to_ends


@inlined(**REORDERED)
def _eliminate_band(band, to_ends, n):
    """Eliminate n nodes one after another by star-mesh elimination, and return `inverse` of `Coarsest`.

    The elimination of a node adds links between all its later neighbours, and from its later neighbours to inlet and
    outlet. The new links are added to the arrays `band` and `to_ends`, see `_store_as_band`.
    """
    width = band.shape[1]
    inverse = np.zeros(n, np.float32)
    for k in range(n):
        row = band[k]
        later = band[k + 1 : k + 1 + width]  # rows of the nodes that may be neighbours of node k
        total = to_ends[k]
        for a in range(width):
            total += row[a]
        if not total > 0.0:
            continue
        inverse[k] = np.float32(1.0) / total
        for a in range(width):
            fraction = row[a] * inverse[k]
            if fraction != np.float32(0.0):
                to_ends[k + 1 + a] += fraction * to_ends[k]
                for b in range(width - 1 - a):
                    later[a, b] += fraction * row[a + 1 + b]
    return inverse


@compiled(**REORDERED)
def eliminate_coarsest(operator, ring):
    """Eliminate all nodes of the coarsest level.

    operator : arrays `centre`, `right`, `below`, `below_right` and `below_left`, see the docstring of `hierarchy`.
    ring : whether the columns form a ring.
    """
    centre = operator[0]
    number, width = _number_nodes(centre.shape[0] - 2, centre.shape[1] - 2, ring)
    band, to_ends = _store_as_band(operator, number, width, ring)
    inverse = _eliminate_band(band, to_ends, number.size)
    return Coarsest(number, band, inverse)


@compiled(**REORDERED)
def solve_coarsest(coarsest, b, ring, x):
    """Solve the coarsest level for the right-hand side b, and write the solution to x.

    b, x : arrays with a border of one node on each side.
    """
    number, band, inverse = coarsest
    n1, n2 = number.shape
    n = inverse.size
    width = band.shape[1]
    # source of each node in the order of elimination, and later its potential
    v = np.zeros(n + width, np.float32)
    for i in range(n1):
        for j in range(n2):
            v[number[i, j]] = b[i + 1, j + 1]
    # forwards: the source of an eliminated node is distributed over its later neighbours
    for k in range(n):
        share = v[k] * inverse[k]
        v[k] = share
        for a in range(width):
            v[k + 1 + a] += band[k, a] * share
    # backwards: the potentials of the later neighbours are known
    for k in range(n - 1, -1, -1):
        inflow = np.float32(0.0)
        for a in range(width):
            inflow += band[k, a] * v[k + 1 + a]
        v[k] += inflow * inverse[k]
    for i in range(n1):
        for j in range(n2):
            x[i + 1, j + 1] = v[number[i, j]]
        if ring:
            x[i + 1, 0], x[i + 1, n2 + 1] = x[i + 1, n2], x[i + 1, 1]

"""Build the multigrid levels of a structured grid from the conductances of the finest grid (black box multigrid).

Each multigrid level has an operator on a grid, and the fields that a multigrid cycle needs on this grid. Levels are
computed in double precision and stored in single precision. Single precision is sufficient, because the multigrid cycle
is only a preconditioner.

All fields have a border of one node on each side. At the inlet, at the outlet and at closed sides, the border contains
zeros. If the columns form a ring, the border contains copies of the nodes at the opposite side. The operator of a level
is stored as the array `centre` with its diagonal entries, and as arrays of conductances:

- `right` between the nodes (i, j) and (i, j + 1),
- `below` between (i, j) and (i + 1, j),
- on coarse levels, whose operator has nine points, also `below_right` between (i, j) and (i + 1, j + 1), and
  `below_left` between (i, j) and (i + 1, j − 1).

The operator of the finest level has no diagonal links (five points). The module `interpolation` computes the operators
of the coarser levels, the module `clusters` finds nodes that a coarser level hardly moves, and the module `coarsest`
eliminates the nodes of the coarsest level. Source: Dendy, J. Comput. Phys. 48, 1982, 366.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base import Singles
from ...base.compiled import REORDERED, by_rows, compiled, inlined_leader, leader
from .clusters import Clusters, find_clusters
from .coarsest import eliminate_coarsest
from .interpolation import (
    compute_galerkin_product,
    weigh_coarse_rows,
    weigh_rows_between,
)
from .rings import wrap_row

#: Coarsening ends if an axis has at most this number of nodes.
COARSEST_SIDE = 4
#: Coarsening also ends if a level has at most `_ELIMINATED` times as many open nodes as the finest level, and at most
#: `_MOST_ELIMINATED`. The elimination of these nodes takes less time than the additional iterations that coarser levels
#: would cause, because coarser grids do not resolve dead ends and channels. There are few of them in a level of which
#: more than `_NEARLY_OPEN` is open; such a level is only eliminated up to `_MOST_IF_NEARLY_OPEN` nodes.
_ELIMINATED, _MOST_ELIMINATED = 1 / 40, 20000
_NEARLY_OPEN, _MOST_IF_NEARLY_OPEN = 0.98, 5000
#: Largest stored inverse of a diagonal entry; the largest number in single precision is 3e38.
_MOST_INVERSE = 1e30


class Level(NamedTuple):
    """Arrays of a multigrid level, each with a border of one node on each side.

    links : four arrays of conductances: `right`, `below`, `below_right` and `below_left`. On the finest level, which
        has no diagonal links, `below_right` and `below_left` have the shape (1, 1).
    inverse : 1 over the diagonal entries of the operator; 0 at nodes without links.
    b : right-hand side of a cycle.
    x : approximate solution during a cycle.
    r : residual during a cycle, and solution at the end of the cycle.
    weights : array (coarse rows, 3, 3, coarse columns), interpolation weights of each node of the next coarser level.
        The value of a coarse node contributes to the fine node at the same position and to its eight neighbours. The
        second axis is the row of the fine node: 0 above the coarse node, 1 in the same row, 2 below. The third axis is
        the column of the fine node: 0 on the left of the coarse node, 1 in the same column, 2 on the right.
    clusters : clusters of nodes that the coarser grid hardly moves.
    """

    links: tuple[Singles, Singles, Singles, Singles]
    inverse: Singles
    b: Singles
    x: Singles
    r: Singles
    weights: Singles
    clusters: Clusters


@by_rows(**REORDERED)
def _five_point_operator(first, end, centre, right, below, along, across, ring):
    """Fill the rows `first` to `end` − 1 of `centre`, `right` and `below` with the operator of a stencil.

    The arrays `centre`, `right` and `below` have a border of one node on each side; the conductances `along` and
    `across` of the stencil have no border. Row i of `right` is therefore row i − 1 of `across`. Row i − 1 of `along`
    contains the links above row i of `centre`, and row i of `along` the links below row i of `centre`.
    """
    n1 = centre.shape[0] - 2
    n2 = centre.shape[1] - 2
    for i in range(first, end):
        for j in range(1, across.shape[1] + 1):
            right[i, j] = across[i - 1, j - 1]
        if ring:
            wrap_row(right[i])
        for j in range(1, n2 + 1):
            if i < n1:
                below[i, j] = along[i, j - 1]
            centre[i, j] = along[i - 1, j - 1] + along[i, j - 1] + right[i, j - 1] + right[i, j]
        if ring:
            wrap_row(below[i])


@inlined_leader(**REORDERED)
def build_levels(along, across, ring):
    """Build the multigrid levels of a stencil, and eliminate the nodes of the coarsest level."""
    fine = np.zeros((3, along.shape[0] + 1, along.shape[1] + 2))
    _five_point_operator(fine[0], fine[1], fine[2], along, across, ring)
    return levels_of_operator(fine, ring)


@inlined_leader(**REORDERED)
def levels_of_operator(fine, ring):
    """Build the multigrid levels of a five-point operator, and eliminate the nodes of the coarsest level.

    fine : array (3, n1 + 2, n2 + 2), diagonal `centre` and conductances `right` and `below` of the operator, with a
        border of one node on each side.
    """
    none = np.zeros((1, 1))  # a five-point operator has no diagonal links
    operator = fine[0], fine[1], fine[2], none, none
    levels: list[Level] = []
    fewest = 0.0  # number of open nodes at which coarsening ends
    while True:
        n1, n2 = operator[0].shape
        # fields of the level in one array: links to the right and below, inverse, b, x and r
        fields = np.zeros((6, n1, n2), np.float32)
        diagonal_links = np.zeros((2, n1, n2) if levels else (2, 1, 1), np.float32)
        links = fields[0], fields[1], diagonal_links[0], diagonal_links[1]
        inverse, b, x, r = fields[2], fields[3], fields[4], fields[5]
        _store_operator(inverse, links, operator)
        open_nodes = _count_open(inverse)
        if not levels:
            fewest = _ELIMINATED * open_nodes
        is_nearly_open = open_nodes > _NEARLY_OPEN * (n1 - 2) * (n2 - 2)
        most = _MOST_IF_NEARLY_OPEN if is_nearly_open else _MOST_ELIMINATED
        is_coarsest = min(n1, n2) - 2 <= COARSEST_SIDE or open_nodes <= min(fewest, most)
        m1, m2 = (0, 0) if is_coarsest else coarser_shape(n1, n2)
        weights = np.zeros((m1, 3, 3, m2), np.float32)
        is_nine_point = operator[3].size > 1  # the operator of the finest level has five points
        coarse = np.zeros((5, m1, m2))  # diagonal and four kinds of conductances
        is_loose = np.zeros((n1, n2) if not is_coarsest else (2, 2), np.bool_)
        if not is_coarsest:
            weigh_coarse_rows(coarse[0], weights, is_loose, operator, is_nine_point, ring)
            weigh_rows_between(coarse[0], weights, is_loose, operator, is_nine_point, ring)
            compute_galerkin_product(coarse[0], coarse, weights, operator, is_nine_point, ring)
        clusters = find_clusters(is_loose, operator, is_nine_point, ring)
        levels.append(Level(links, inverse, b, x, r, weights, clusters))
        if is_coarsest:
            return levels, eliminate_coarsest(operator, ring)
        operator = coarse[0], coarse[1], coarse[2], coarse[3], coarse[4]


@compiled(**REORDERED)
def _count_open(inverse):
    """Count the nodes with links. (`np.count_nonzero` would take ten times as long to compile.)"""
    count = 0
    for i in range(inverse.shape[0]):
        for j in range(inverse.shape[1]):
            count += inverse[i, j] > 0.0
    return count


@leader(**REORDERED)
def coarser_shape(n1, n2):
    """Compute the shape of the next coarser level from the shape of a level; both include the border."""
    return (n1 + 1) // 2 + 1, (n2 + 1) // 2 + 1


@by_rows(**REORDERED)
def _store_operator(first, end, inverse, links, operator):
    """Store some rows of an operator in the arrays of a level, in single precision.

    The Galerkin product may contain negative conductances, which could make a Jacobi sweep diverge. They are replaced
    by 0, and the diagonal is increased by the same amount, so that the sum of each row does not change.
    """
    centre, right, below, below_right, below_left = operator
    to_right, to_below, to_below_right, to_below_left = links
    is_nine_point = below_right.size > 1
    for i in range(first, end):
        for j in range(centre.shape[1]):
            to_right[i, j] = max(right[i, j], 0.0)
            to_below[i, j] = max(below[i, j], 0.0)
            if is_nine_point:
                to_below_right[i, j] = max(below_right[i, j], 0.0)
                to_below_left[i, j] = max(below_left[i, j], 0.0)
            diagonal = centre[i, j]
            if diagonal > 0.0:
                if is_nine_point:
                    # sum of the negative conductances of all eight links of the node
                    negative = min(right[i, j], 0.0) + min(right[i, j - 1], 0.0)
                    negative += min(below[i, j], 0.0) + min(below[i - 1, j], 0.0)
                    negative += min(below_right[i, j], 0.0) + min(below_right[i - 1, j - 1], 0.0)
                    diagonal -= (
                        negative + min(below_left[i, j], 0.0) + min(below_left[i - 1, j + 1], 0.0)
                    )
                inverse[i, j] = min(1.0 / diagonal, _MOST_INVERSE)

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

The operator of the finest level has no diagonal links (five points). Coarse node (I, J) is fine node (2I − 1, 2J − 1).
The values at all other fine nodes are interpolated from the coarse nodes, with weights that follow from the
conductances. Coarse operators are Galerkin products PᵀAP with the interpolation P from coarse to fine nodes. Source:
Dendy, J. Comput. Phys. 48, 1982, 366.

The nodes of the coarsest level are eliminated one after another, row by row, without subtractions, as in `elimination`.
The inlet and the outlet are a single node with the potential 0. The links are stored as a band matrix, for which the
nodes need no further ordering. The elimination of a small coarsest level takes only a small part of the solution time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base import Indices, Singles
from ...base.compiled import REORDERED, by_rows, compiled, inlined, leader
from .clusters import HOLDING, Clusters, find_clusters

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
#: A diagonal entry less the conductances to all neighbours is the conductance to inlet and outlet. The difference
#: counts as a rounding error if it is below this fraction of the diagonal entry.
_ROUNDING = 1e-13


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


@compiled()
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


@compiled(**REORDERED)
def eliminate_coarsest(operator, ring):
    """Eliminate all nodes of the coarsest level.

    operator : arrays `centre`, `right`, `below`, `below_right` and `below_left`, see the docstring of the module.
    ring : whether the columns form a ring.
    """
    # The nodes have the rows 1 to n1 and the columns 1 to n2 of the fields, which have a border. In `number` and in the
    # loops they count from 0.
    centre = operator[0]
    n1 = centre.shape[0] - 2
    n2 = centre.shape[1] - 2
    number, width = _number_nodes(n1, n2, ring)
    n = n1 * n2
    # `width` empty rows at the end, so that no loop has to check whether it goes beyond the last node
    band = np.zeros((n + width, width), np.float32)
    to_ends = np.zeros(n + width, np.float32)
    inverse = np.zeros(n, np.float32)
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
    # Star-mesh elimination: the elimination of node k adds links between all its later neighbours, and from its later
    # neighbours to inlet and outlet. Entry a of row k of `band` is the link to node k + 1 + a.
    for k in range(n):
        row = band[k]
        later = band[k + 1 : k + 1 + width]
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


@inlined(**REORDERED)
def wrap_row(row):
    """Continue a row of a ring periodically: copy the last node to the left border, and the first node to the right."""
    row[0], row[-1] = row[-2], row[1]


@inlined(**REORDERED)
def wrap_rows(field, first, end):
    """Continue the rows `first` to `end` − 1 of a ring periodically."""
    for i in range(first, end):
        wrap_row(field[i])


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


@inlined(**REORDERED)
def _fraction(part, total):
    """Return part / total if both numbers are positive, otherwise 0."""
    return part / total if part > 0.0 and total > 0.0 else 0.0


@by_rows(**REORDERED)
def _weights_in_coarse_rows(first, end, coarse, w, is_loose, operator, is_nine_point, ring):
    """Compute the interpolation weights w in the fine rows that contain coarse nodes.

    At a fine node that is also a coarse node, the weight of the coarse node is 1. At a fine node between two coarse
    nodes, the weight of each coarse node follows from the conductances of the links on its side.

    coarse : array (coarse rows, coarse columns), which only defines the coarse grid.
    w : array (coarse rows, 3, 3, coarse columns), see `Level.weights`.
    is_loose : flags of the nodes that are not held by the coarser grid, see `clusters`.
    is_nine_point : whether the operator has links along the diagonals.
    """
    centre, right, below, below_right, below_left = operator
    n2 = centre.shape[1] - 2
    m2 = w.shape[3] - 2
    # fine row i, which is odd, contains the nodes of coarse row ci
    for i in range(2 * first - 1, 2 * end - 1, 2):
        ci = (i + 1) // 2
        for j in range(1, m2 + 1):
            w[ci, 1, 1, j] = 1.0
        # The value of a node between two coarse nodes follows from its links along the row. Diagonal links are added to
        # the links along the row, and links directly above and below are left out.
        for j in range(2, n2 + 1, 2):
            west = right[i, j - 1]
            east = right[i, j]
            if is_nine_point:
                west += below_right[i - 1, j - 1] + below_left[i, j]
                east += below_left[i - 1, j + 1] + below_right[i, j]
            # the diagonal entry less the links above and below also contains links to inlet and outlet
            total = max(centre[i, j] - below[i - 1, j] - below[i, j], west + east)
            # coarse columns on the left and on the right; in a ring, the first column follows the last column
            left = j // 2
            right_column = (j // 2) % m2 + 1 if j == n2 else j // 2 + 1
            w[ci, 1, 2, left] = _fraction(west, total)
            w[ci, 1, 0, right_column] = _fraction(east, total)
            is_loose[i, j] = west + east < HOLDING * centre[i, j]
        if ring:
            _wrap_weights(w, ci, 1)
            wrap_row(is_loose[i])


@by_rows(**REORDERED)
def _weights_between_coarse_rows(first, end, coarse, w, is_loose, operator, is_nine_point, ring):
    """Compute the interpolation weights w in the fine rows between two rows with coarse nodes.

    The weights depend on the results of `_weights_in_coarse_rows`, which must be called first. The parameters are those
    of `_weights_in_coarse_rows`.
    """
    centre, right, below, below_right, below_left = operator
    n1 = centre.shape[0] - 2
    n2 = centre.shape[1] - 2
    m2 = w.shape[3] - 2
    # fine row i, which is even, lies between the coarse rows `top` and `bottom`
    for i in range(2 * first, min(2 * end, n1 + 1), 2):
        top = i // 2
        bottom = i // 2 + 1
        # Nodes directly between two coarse nodes, one above and one below. As in `_weights_in_coarse_rows`, diagonal
        # links are added to the links above and below, and links along the row are left out.
        for j in range(1, n2 + 1, 2):
            north = below[i - 1, j]
            south = below[i, j]
            if is_nine_point:
                north += below_right[i - 1, j - 1] + below_left[i - 1, j + 1]
                south += below_left[i, j] + below_right[i, j]
            total = max(centre[i, j] - right[i, j - 1] - right[i, j], north + south)
            w[top, 2, 1, (j + 1) // 2] = _fraction(north, total)
            w[bottom, 0, 1, (j + 1) // 2] = _fraction(south, total)
            is_loose[i, j] = north + south < HOLDING * centre[i, j]
        if ring:
            wrap_row(is_loose[i])
        # Nodes in the middle of four coarse nodes (nw, ne, sw and se). The value of a node in the middle is the mean of
        # its neighbours in the north, south, west and east, weighted with the conductances. Each of these neighbours is
        # interpolated from two of the four coarse nodes, with weights that have been computed before. nw, ne, sw and se
        # add up the contributions of each coarse node.
        for j in range(2, n2 + 1, 2):
            c = centre[i, j]
            if c <= 0.0:
                continue
            left = j // 2
            right_column = (j // 2) % m2 + 1 if j == n2 else j // 2 + 1
            north = below[i - 1, j]
            south = below[i, j]
            west = right[i, j - 1]
            east = right[i, j]
            # conductances to neighbours that are held by coarse nodes
            held = 0.0 if is_loose[i - 1, j] else north
            held += 0.0 if is_loose[i + 1, j] else south
            held += 0.0 if is_loose[i, j - 1] else west
            held += 0.0 if is_loose[i, j + 1] else east
            nw = north * w[top, 1, 2, left] + west * w[top, 2, 1, left]
            ne = north * w[top, 1, 0, right_column] + east * w[top, 2, 1, right_column]
            sw = south * w[bottom, 1, 2, left] + west * w[bottom, 0, 1, left]
            se = south * w[bottom, 1, 0, right_column] + east * w[bottom, 0, 1, right_column]
            if is_nine_point:
                nw += below_right[i - 1, j - 1]
                ne += below_left[i - 1, j + 1]
                sw += below_left[i, j]
                se += below_right[i, j]
                held += below_right[i - 1, j - 1] + below_left[i - 1, j + 1]
                held += below_left[i, j] + below_right[i, j]
            is_loose[i, j] = held < HOLDING * c
            w[top, 2, 2, left] = _fraction(nw, c)
            w[top, 2, 0, right_column] = _fraction(ne, c)
            w[bottom, 0, 2, left] = _fraction(sw, c)
            w[bottom, 0, 0, right_column] = _fraction(se, c)
        if ring:
            _wrap_weights(w, top, 2)
            _wrap_weights(w, bottom, 0)


@inlined(**REORDERED)
def _wrap_weights(w, i, fine_row):
    """Copy the weights of the coarse nodes in row i of a ring to the border at the opposite side.

    fine_row : index of the weights for a fine row: 0 for the row above the coarse nodes, 1 for their own row, 2 for the
        row below.
    """
    m2 = w.shape[3] - 2
    for b in range(3):
        w[i, fine_row, b, 0] = w[i, fine_row, b, m2]
        w[i, fine_row, b, m2 + 1] = w[i, fine_row, b, 1]


@by_rows(**REORDERED)
def _galerkin_product(first, end, diagonal, coarse, w, operator, is_nine_point, ring):
    """Compute the Galerkin product PᵀAP for some rows of the next coarser level.

    coarse : array (5, coarse rows, coarse columns) for the result: the diagonal and the four kinds of conductances of
        the next coarser level.
    """
    centre, right, below, below_right, below_left = operator
    n1 = centre.shape[0] - 2
    n2 = centre.shape[1] - 2
    m2 = w.shape[3] - 2
    # A times the interpolation of one coarse node, at the 5 × 5 fine nodes around it
    row = np.empty((5, 5))
    out = np.empty(5)
    for ci in range(first, end):
        for cj in range(1, m2 + 1):
            for a in range(25):
                row[a // 5, a % 5] = 0.0
            for a in range(3):
                i = 2 * ci - 2 + a  # fine row, from 1 to n1
                if i < 1 or i > n1:
                    continue
                for b in range(3):
                    v = w[ci, a, b, cj]
                    j = 2 * cj - 2 + b
                    if j < 1:
                        j = n2 if ring else 0  # the column before the first one
                    if v == 0.0 or j < 1 or j > n2:
                        continue
                    row[a + 1, b + 1] += centre[i, j] * v
                    row[a + 1, b] -= right[i, j - 1] * v
                    row[a + 1, b + 2] -= right[i, j] * v
                    row[a, b + 1] -= below[i - 1, j] * v
                    row[a + 2, b + 1] -= below[i, j] * v
                    if is_nine_point:
                        row[a, b] -= below_right[i - 1, j - 1] * v
                        row[a, b + 2] -= below_left[i - 1, j + 1] * v
                        row[a + 2, b] -= below_left[i, j] * v
                        row[a + 2, b + 2] -= below_right[i, j] * v
            # entries with the node itself and the coarse nodes at the right, below, below right and below left
            for k in range(5):
                di = (0, 0, 1, 1, 1)[k]
                dj = (0, 1, 0, 1, -1)[k]
                # In general the fine nodes of two adjacent coarse nodes are shifted by 2 columns against each other. In
                # a ring with an odd number of columns, the last and the first coarse node are adjacent fine nodes.
                seam = (dj == 1 and cj == m2) or (dj == -1 and cj == 1)
                shift = dj if seam and n2 % 2 else 2 * dj
                s = 0.0
                for a in range(3):
                    y = 2 * di + a + 1
                    if y > 4:
                        continue
                    for b in range(3):
                        x = shift + b + 1  # (y, x) is the position of the fine node in `row`
                        if 0 <= x <= 4:
                            s += w[ci + di, a, b, cj + dj] * row[y, x]
                out[k] = s
            coarse[0, ci, cj] = out[0]
            for k in range(1, 5):
                coarse[k, ci, cj] = -out[k]
        if ring:
            for k in range(1, 5):
                wrap_row(coarse[k, ci])


@leader(**REORDERED)
def build_levels(along, across, ring):
    """Build the multigrid levels of a stencil, and eliminate the nodes of the coarsest level."""
    fine = np.zeros((3, along.shape[0] + 1, along.shape[1] + 2))
    _five_point_operator(fine[0], fine[1], fine[2], along, across, ring)
    return levels_of_operator(fine, ring)


@leader(**REORDERED)
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
        open_nodes = np.count_nonzero(inverse)
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
            _weights_in_coarse_rows(coarse[0], weights, is_loose, operator, is_nine_point, ring)
            _weights_between_coarse_rows(
                coarse[0], weights, is_loose, operator, is_nine_point, ring
            )
            _galerkin_product(coarse[0], coarse, weights, operator, is_nine_point, ring)
        clusters = find_clusters(is_loose, operator, is_nine_point, ring)
        levels.append(Level(links, inverse, b, x, r, weights, clusters))
        if is_coarsest:
            return levels, eliminate_coarsest(operator, ring)
        operator = coarse[0], coarse[1], coarse[2], coarse[3], coarse[4]


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

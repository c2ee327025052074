"""Compute the interpolation between two multigrid levels, and the operator of the coarser level.

Coarse node (I, J) is fine node (2I − 1, 2J − 1). The values at all other fine nodes are interpolated from the coarse
nodes, with weights that follow from the conductances. Coarse operators are Galerkin products PᵀAP with the
interpolation P from coarse to fine nodes. Operators, levels and borders are as in `hierarchy`. Source: Dendy, J.
Comput. Phys. 48, 1982, 366.
"""

from __future__ import annotations

import numpy as np

from ...base.compiled import REORDERED, by_rows, inlined
from .clusters import HOLDING
from .rings import wrap_row


@inlined(**REORDERED)
def _fraction(part, total):
    """Return part / total if both numbers are positive, otherwise 0."""
    return part / total if part > 0.0 and total > 0.0 else 0.0


@by_rows(**REORDERED)
def weigh_coarse_rows(first, end, coarse, w, is_loose, operator, is_nine_point, ring):
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
def weigh_rows_between(first, end, coarse, w, is_loose, operator, is_nine_point, ring):
    """Compute the interpolation weights w in the fine rows between two rows with coarse nodes.

    The weights depend on the results of `weigh_coarse_rows`, which must be called first. The parameters are those
    of `weigh_coarse_rows`.
    """
    centre, right, below, below_right, below_left = operator
    n1 = centre.shape[0] - 2
    n2 = centre.shape[1] - 2
    m2 = w.shape[3] - 2
    # fine row i, which is even, lies between the coarse rows `top` and `bottom`
    for i in range(2 * first, min(2 * end, n1 + 1), 2):
        top = i // 2
        bottom = i // 2 + 1
        # Nodes directly between two coarse nodes, one above and one below. As in `weigh_coarse_rows`, diagonal
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
def compute_galerkin_product(first, end, diagonal, coarse, w, operator, is_nine_point, ring):
    """Compute the Galerkin product PᵀAP for some rows of the next coarser level.

    The columns of P contain the interpolation weights of the coarse nodes. A P is computed for one coarse node at a
    time; it is only different from 0 at the 5 × 5 fine nodes around the coarse node. The products of A P with the
    weights of the node itself and of its neighbours are the entries of the coarse operator.

    coarse : array (5, coarse rows, coarse columns) for the result: the diagonal and the four kinds of conductances of
        the next coarser level.
    """
    centre, right, below, below_right, below_left = operator
    n1 = centre.shape[0] - 2
    n2 = centre.shape[1] - 2
    m2 = w.shape[3] - 2
    # A P of one coarse node at the 5 × 5 fine nodes around it; the coarse node itself is at (2, 2)
    a_p = np.empty((5, 5))
    entries = np.empty(5)  # of the coarse operator
    for ci in range(first, end):
        for cj in range(1, m2 + 1):
            for a in range(25):
                a_p[a // 5, a % 5] = 0.0
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
                    a_p[a + 1, b + 1] += centre[i, j] * v
                    a_p[a + 1, b] -= right[i, j - 1] * v
                    a_p[a + 1, b + 2] -= right[i, j] * v
                    a_p[a, b + 1] -= below[i - 1, j] * v
                    a_p[a + 2, b + 1] -= below[i, j] * v
                    if is_nine_point:
                        a_p[a, b] -= below_right[i - 1, j - 1] * v
                        a_p[a, b + 2] -= below_left[i - 1, j + 1] * v
                        a_p[a + 2, b] -= below_left[i, j] * v
                        a_p[a + 2, b + 2] -= below_right[i, j] * v
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
                        x = shift + b + 1  # (y, x) is the position of the fine node in `a_p`
                        if 0 <= x <= 4:
                            s += w[ci + di, a, b, cj + dj] * a_p[y, x]
                entries[k] = s
            coarse[0, ci, cj] = entries[0]
            for k in range(1, 5):
                coarse[k, ci, cj] = -entries[k]
        if ring:
            for k in range(1, 5):
                wrap_row(coarse[k, ci])

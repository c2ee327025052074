"""Perform the V-cycle of multigrid: sweeps on each level, and the transfer of residual and correction between levels.

A cycle performs one sweep of damped Jacobi before the coarse-grid correction, and one sweep after the correction. All
fields are in single precision. Levels and borders are as in `hierarchy`.
"""

from __future__ import annotations

import numpy as np

from ...base.compiled import NO, REORDERED, YES, by_rows, inlined_leader, inner
from .clusters import correct_clusters
from .coarsest import solve_coarsest
from .rings import wrap_row, wrap_rows

#: Damping factor of the Jacobi sweeps.
_DAMPING = np.float32(0.8)


@inlined_leader(**REORDERED)
def cycle(levels, coarsest, ring):
    """Perform one V-cycle: compute the solution `r` of the finest level from the right-hand side `b` of this level."""
    for k in range(len(levels) - 1):
        fine, coarse = levels[k], levels[k + 1]
        _first_sweep(fine.x, fine.b, fine.inverse, ring)
        _residual_after_first_sweep(fine.r, fine, ring)
        correct_clusters(fine, ring, YES)
        _restrict(coarse.b, fine.r, fine.weights)
    solve_coarsest(coarsest, levels[-1].b, ring, levels[-1].r)
    for k in range(len(levels) - 2, -1, -1):
        coarse, fine = levels[k + 1], levels[k]
        _prolong(fine.x, coarse.r, fine.weights, ring)
        correct_clusters(fine, ring, NO)
        _second_sweep(fine.r, fine, ring)


@by_rows(**REORDERED)
def _first_sweep(first, end, x, b, inverse, ring):
    """Perform the first sweep of damped Jacobi on some rows, starting from x = 0."""
    source = b[first:end].reshape(-1)
    factor = inverse[first:end].reshape(-1)
    result = x[first:end].reshape(-1)
    for k in range(result.size):
        result[k] = _DAMPING * source[k] * factor[k]
    if ring:
        wrap_rows(x, first, end)


@by_rows(**REORDERED)
def _residual_after_first_sweep(first, end, r, level, ring):
    """Compute the residual b + Σ c x − a x of some rows after the first sweep.

    The product of the diagonal entry a and x is ω b after the first sweep, with the damping factor ω.
    """
    _sum_inflow(level, first, end, np.float32(1.0) - _DAMPING, r)
    if ring:
        wrap_rows(r, first, end)


@by_rows(**REORDERED)
def _second_sweep(first, end, r, level, ring):
    """Perform a sweep of damped Jacobi on some rows, and write its result x + ω ((b + Σ c x)/a − x) to r."""
    _sum_inflow(level, first, end, np.float32(1.0), r)
    x = level.x[first:end].reshape(-1)
    inverse = level.inverse[first:end].reshape(-1)
    out = r[first:end].reshape(-1)
    for k in range(out.size):
        out[k] = x[k] + _DAMPING * (inverse[k] * out[k] - x[k])
    if ring:
        wrap_rows(r, first, end)


@inner(**REORDERED)
def _sum_inflow(level, first, end, share, out):
    """Compute `share` b + Σ c x for the rows `first` to `end` − 1, and write it to `out`.

    The sum is over all neighbours of a node, with the conductances c of the links to them. The rows form one long list
    of nodes, so that short rows are also computed with vector instructions. The results in the border are 0, because
    all its conductances are 0; in a ring, they are meaningless and are overwritten afterwards.
    """
    n2 = out.shape[1]
    # without the first and the last node of the list, which are in the border
    start, stop = first * n2 + 1, end * n2 - 1
    b, result = level.b.reshape(-1)[start:stop], out.reshape(-1)[start:stop]
    x = level.x.reshape(-1)
    right, below = level.links[0].reshape(-1), level.links[1].reshape(-1)
    # neighbours of the nodes in the list, and links to the neighbours
    x_right, x_left = x[start + 1 : stop + 1], x[start - 1 : stop - 1]
    x_below, x_above = x[start + n2 : stop + n2], x[start - n2 : stop - n2]
    to_right, to_left = right[start:stop], right[start - 1 : stop - 1]
    to_below, to_above = below[start:stop], below[start - n2 : stop - n2]
    for k in range(result.size):
        beside = to_right[k] * x_right[k] + to_left[k] * x_left[k]
        result[k] = share * b[k] + beside + to_below[k] * x_below[k] + to_above[k] * x_above[k]
    if level.links[2].size > 1:
        below_right, below_left = level.links[2].reshape(-1), level.links[3].reshape(-1)
        # two loops over few arrays, because a single loop would not compile to vector instructions
        x_right, x_left = x[start + n2 + 1 : stop + n2 + 1], x[start + n2 - 1 : stop + n2 - 1]
        to_right, to_left = below_right[start:stop], below_left[start:stop]
        for k in range(result.size):
            result[k] += to_right[k] * x_right[k] + to_left[k] * x_left[k]
        x_right, x_left = x[start - n2 + 1 : stop - n2 + 1], x[start - n2 - 1 : stop - n2 - 1]
        to_right = below_left[start - n2 + 1 : stop - n2 + 1]
        to_left = below_right[start - n2 - 1 : stop - n2 - 1]
        for k in range(result.size):
            result[k] += to_right[k] * x_right[k] + to_left[k] * x_left[k]


@by_rows(**REORDERED)
def _restrict(first, end, b, r, w):
    """Restrict the residual: compute b = Pᵀ r for some rows of the coarser grid.

    The coarse node (ci, cj) collects the residuals r of the 3 × 3 fine nodes around it, with the weights
    w[ci, :, :, cj].
    """
    for ci in range(first, end):
        out = b[ci]
        out[:] = np.float32(0.0)
        for a in range(3):
            # the coarse node (ci, cj) is the fine node (2 ci − 1, 2 cj − 1)
            r_row = r[2 * ci - 2 + a]
            from_left, from_centre, from_right = w[ci, a, 0], w[ci, a, 1], w[ci, a, 2]
            for cj in range(1, out.size - 1):
                j = 2 * cj - 1
                out[cj] += (
                    from_left[cj] * r_row[j - 1]
                    + from_centre[cj] * r_row[j]
                    + from_right[cj] * r_row[j + 1]
                )


@by_rows(**REORDERED)
def _prolong(first, end, x, coarse, w, ring):
    """Add the interpolated correction to x: compute x += P coarse for some rows of the finer grid.

    The coarse node (ci, cj) is the fine node (2 ci − 1, 2 cj − 1). The value of the coarse node times `w[ci, fine_row,
    fine_column, cj]` is added to each of the 3 × 3 fine nodes around it, see `Level.weights`.
    """
    for i in range(first, end):
        # An odd fine row i contains coarse nodes, of coarse row (i + 1) / 2. An even fine row i lies between the coarse
        # rows i / 2 and i / 2 + 1, and gets a contribution from each of the two.
        contributions = 1 + (i + 1) % 2
        for half in range(contributions):
            ci = (i + 1) // 2 + half
            # fine row relative to the coarse row: 1 for the same row, 2 for the row below, 0 for the row above
            fine_row = 1 if i % 2 else 2 - 2 * half
            v, x_row = coarse[ci], x[i]
            to_left, to_centre, to_right = (
                w[ci, fine_row, 0],
                w[ci, fine_row, 1],
                w[ci, fine_row, 2],
            )
            for cj in range(1, v.size - 1):
                j = 2 * cj - 1
                x_row[j] += v[cj] * to_centre[cj]
                # the fine node between the coarse nodes cj and cj + 1; after the last cj, cj + 1 is in the border
                x_row[j + 1] += v[cj] * to_right[cj] + v[cj + 1] * to_left[cj + 1]
        if ring:
            wrap_row(x[i])

"""Compile the loops of conjugate gradients on the free points, with a 3 × 3 stencil as preconditioner M.

`conjugate_gradients` calls `prepare_directions` and `gradient_step`. Both functions call loops over the points `first`
to `end` − 1 of a list. The groups of arrays `law`, `points`, `near`, `free`, `lists` (`GradientLists`) and
`preconditioner` are described in `point_arrays`.

The symbols are those of the module `conjugate_gradients`: pressure p, displacement plus undeformed gap v, residual r,
preconditioned residual w, search direction d, compliance of the half-space K, and compliance a of a point that hardens.
After each step, the mean of r is subtracted, because adding a constant to r only changes the approach δ.
"""

import numpy as np

from .law_at_points import value_at
from .loop_decorators import fast, fast_leader, fast_loop
from .point_arrays import HARDENING


@fast_leader
def prepare_directions(law, points, near, free, lists, preconditioner, n_free, delta):
    """Prepare the first search direction: compute the residual r = δ − v − a (p − H) and M1 at the free points.

    Returns the sum of M1 over the free points, where M1 is the preconditioner applied to a vector of ones.
    """
    set_scale(n_free, law, points, free, lists, preconditioner)
    total_ones = precondition(n_free, lists.ones, lists.scale, points, free, preconditioner)
    total = first_residual(n_free, delta, law, near, free, lists)
    center_and_scatter_residual(n_free, total / n_free, points, free, lists)
    return total_ones


@fast_loop
def set_scale(first, end, law, points, free, lists, preconditioner):
    """Compute the compliance a and the factor s of some free points, and store s in `dense` to prepare M1."""
    index = free.index[first:end]
    compliance = lists.hardening_compliance[first:end]
    scale = lists.scale[first:end]
    dense, state = points.dense, points.state
    middle_weight = preconditioner.weights[1, 1]
    for k in range(end - first):
        i = index[k]
        if state[i] == HARDENING:
            compliance[k] = 1.0 / value_at(law.slope, i)
            scale[k] = 1.0 / np.sqrt(1.0 + compliance[k] * middle_weight)
        else:
            compliance[k] = 0.0
            scale[k] = 1.0
        dense[i] = scale[k]


@fast_loop
def first_residual(first, end, delta, law, near, free, lists):
    """Compute the residuals of some free points, and return their sum."""
    index = free.index[first:end]
    position = free.position[first:end]
    r = lists.r[first:end]
    compliance = lists.hardening_compliance[first:end]
    p, v = near.p, near.v
    total = 0.0
    for k in range(end - first):
        j = position[k]
        r[k] = delta - v[j]
        if compliance[k] > 0.0:
            r[k] -= compliance[k] * (p[j] - value_at(law.hardness, index[k]))
        total += r[k]
    return total


@fast_loop
def precondition(first, end, out, scale, points, free, preconditioner):
    """Compute s M x at some free points for the grid values x in `dense`, and return the sum of the results.

    The results are written to the list `out`.
    """
    index = free.index[first:end]
    return apply_stencil(index, points.dense, scale[first:end], out[first:end], preconditioner)


@fast_leader
def next_direction(points, free, lists, preconditioner, n_free, previous_wr, total_ones):
    """Compute the next search direction d = w + β d with β = w·r / previous_wr, and scatter d to `dense`.

    The preconditioned residual w is M r minus a multiple of M1, chosen such that Σ w = 0 and the steps do not change
    the load. The arguments are described in `gradient_step`.

    Returns w·r. If w·r is not positive, no direction is computed.
    """
    total = precondition(n_free, lists.w, lists.scale, points, free, preconditioner)
    wr = remove_change_of_load(n_free, total / total_ones, lists)
    if wr > 0.0:
        set_direction(n_free, wr / previous_wr, points, free, lists)
    return wr


@fast_loop
def remove_change_of_load(first, end, factor, lists):
    """Subtract `factor` times M1 from w at some free points, so that a step along w does not change the load.

    Returns the contribution of these points to w·r.
    """
    r = lists.r[first:end]
    w = lists.w[first:end]
    ones = lists.ones[first:end]
    wr = 0.0
    for k in range(end - first):
        w[k] -= factor * ones[k]
        wr += w[k] * r[k]
    return wr


@fast_loop
def set_direction(first, end, beta, points, free, lists):
    """Compute the search direction d = w + beta d at some free points, and scatter d to `dense`."""
    index = free.index[first:end]
    w = lists.w[first:end]
    d = lists.d[first:end]
    dense = points.dense
    for k in range(end - first):
        d[k] = w[k] + beta * d[k] if beta > 0.0 else w[k]
        dense[index[k]] = d[k]


@fast_leader
def gradient_step(
    points, near, free, lists, preconditioner, compliance, n_near, n_free, wr, total_ones
):  # fmt: skip
    """Perform a step of conjugate gradients along the search direction d, and compute the next search direction.

    The step is p += α d, v += α Kd and r −= α (Kd + a d), with α = w·r / d·(Kd + a d). It is only performed if
    d·(Kd + a d) > 0. Otherwise, the next direction begins a new sequence of directions. A step and the next direction
    are computed in a single call, because on small grids the calls of compiled functions take as long as the loops.

    compliance : factor 1/E* [1/Pa], by which `points.kd` is multiplied to obtain Kd.
    wr : product w·r of the search direction d; infinite if there is no direction yet, so that no step is performed.
    total_ones : sum of M1 over the free points, see `prepare_directions`.

    Returns d·Kd, d·d, whether the step was performed, and the product w·r of the next direction.
    """
    curvature = 0.0
    squared_length = 0.0
    total_curvature = 0.0
    if wr < np.inf:
        gather_response(n_near, compliance, points, near)
        curvature, squared_length, total_curvature = curvatures(n_free, near, free, lists)
        residual_sum = 0.0
        if total_curvature > 0.0:
            alpha = wr / total_curvature
            residual_sum = update_pressure_and_residual(n_free, alpha, near, free, lists)
            update_displacement(n_near, alpha, near)
        center_and_scatter_residual(n_free, residual_sum / n_free, points, free, lists)
    is_made = total_curvature > 0.0
    previous_wr = wr if is_made else np.inf
    next_wr = next_direction(points, free, lists, preconditioner, n_free, previous_wr, total_ones)
    return curvature, squared_length, is_made, next_wr


@fast_loop
def gather_response(first, end, compliance, points, near):
    """Gather the displacement Kd of some points near contact from the grid into a list.

    The rows of the grid may be shorter than the rows of `kd`. The grid indices in `near` increase, so the loop can keep
    count of the row. This is faster than dividing each index by the number of columns.
    """
    index = near.index[first:end]
    out = near.response[first:end]
    values = points.kd.ravel()
    columns = points.dense.size // points.kd.shape[0]
    unused = points.kd.shape[1] - columns  # unused values at the end of each row of `kd`
    if unused == 0:
        for j in range(end - first):
            out[j] = compliance * values[index[j]]
        return
    skipped = 0  # number of unused values in the rows before the row of the point
    next_row = columns  # grid index of the first point in the next row
    for j in range(end - first):
        i = index[j]
        while i >= next_row:
            skipped += unused
            next_row += columns
        out[j] = compliance * values[i + skipped]


@fast_loop
def curvatures(first, end, near, free, lists):
    """Compute the contributions of some free points to the sums d·Kd, d·d and d·(Kd + a d)."""
    position = free.position[first:end]
    d = lists.d[first:end]
    compliance = lists.hardening_compliance[first:end]
    response = near.response
    curvature = 0.0
    squared_length = 0.0
    hardening = 0.0
    for k in range(end - first):
        curvature += response[position[k]] * d[k]
        squared_length += d[k] * d[k]
        hardening += compliance[k] * d[k] * d[k]
    return curvature, squared_length, curvature + hardening


@fast_loop
def update_pressure_and_residual(first, end, alpha, near, free, lists):
    """Update the pressures and residuals of some free points: p += α d, r −= α (Kd + a d); return the sum of r."""
    position = free.position[first:end]
    r = lists.r[first:end]
    d = lists.d[first:end]
    compliance = lists.hardening_compliance[first:end]
    response = near.response
    p = near.p
    total = 0.0
    for k in range(end - first):
        j = position[k]
        p[j] += alpha * d[k]
        r[k] -= alpha * (response[j] + compliance[k] * d[k])
        total += r[k]
    return total


@fast_loop
def update_displacement(first, end, alpha, near):
    """Update v of some points near contact: v += α Kd."""
    v = near.v[first:end]
    response = near.response[first:end]
    for j in range(end - first):
        v[j] += alpha * response[j]


@fast_loop
def center_and_scatter_residual(first, end, mean, points, free, lists):
    """Subtract the mean residual from the residuals r of some free points, and scatter s r to the grid array `dense`.

    After the first conjugate-gradient step, the mean residual differs from 0 only by rounding errors.
    """
    index = free.index[first:end]
    r = lists.r[first:end]
    scale = lists.scale[first:end]
    dense = points.dense
    for k in range(end - first):
        r[k] -= mean
        dense[index[k]] = r[k] * scale[k]


@fast
def apply_stencil(index, dense, scale, out, preconditioner):
    """Apply the 3 × 3 stencil to the grid values `dense` at the listed points, and multiply the results by `scale`.

    The products are written to `out`. Returns their sum.

    Points that follow each other in the interior of a row are processed together by `apply_to_run`. At the border, the
    neighbours of a point are found by the maps `rows` and `columns` of the preconditioner.

    index : grid index of each listed point in the array `dense` (n1 n2,), which contains the grid row by row; in
        increasing order.
    """
    weights = preconditioner.weights
    rows = preconditioner.rows
    columns = preconditioner.columns
    n1 = rows.size - 2  # `rows` and `columns` have an additional entry at both ends
    n2 = columns.size - 2
    sum_of_all = 0.0
    k = 0
    while k < index.size:
        point = index[k]
        i = point // n2  # row and column of the point
        j = point - i * n2
        if 1 <= i < n1 - 1 and 1 <= j < n2 - 1:
            most = min(index.size - k, n2 - 1 - j)
            length = 1
            while length < most and index[k + length] == point + length:
                length += 1
            run = slice(k, k + length)
            sum_of_all += apply_to_run(point, n2, dense, weights, scale[run], out[run])
            k += length
            continue
        total = 0.0
        for a in range(3):
            for b in range(3):
                # entry i + a of `rows` is the grid row that corresponds to the row number i + a − 1
                row = rows[i + a]
                column = columns[j + b]
                if row >= 0 and column >= 0:  # −1 is beyond the end of a free axis
                    total += weights[a, b] * dense[row * n2 + column]
        out[k] = total * scale[k]
        sum_of_all += out[k]
        k += 1
    return sum_of_all


@fast
def apply_to_run(point, n2, dense, weights, scale, out):
    """Apply the 3 × 3 stencil at `out.size` points that follow each other in the interior of a row.

    The results are multiplied by `scale` and written to `out`. Returns their sum. The weights are symmetric about both
    axes. Neighbours with the same weight are added in single precision, the precision of the values in `dense`.

    point : grid index of the first point.
    n2 : number of points of a row.
    """
    corner, above_or_below = weights[0, 0], weights[0, 1]
    beside, middle = weights[1, 0], weights[1, 1]
    n = out.size
    above = dense[point - n2 - 1 : point - n2 + n + 1]
    row = dense[point - 1 : point + n + 1]
    below = dense[point + n2 - 1 : point + n2 + n + 1]
    total = 0.0
    for k in range(n):
        value = (
            corner * (above[k] + above[k + 2] + below[k] + below[k + 2])
            + above_or_below * (above[k + 1] + below[k + 1])
            + beside * (row[k] + row[k + 2])
            + middle * row[k + 1]
        )
        out[k] = value * scale[k]
        total += out[k]
    return total

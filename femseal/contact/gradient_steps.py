"""Compile the loops of conjugate gradients on the free points, with a 3 × 3 stencil as preconditioner M.

`active_sets` calls `restart`, `next_direction` and `step`. Each of the three functions calls loops over the points
`first` to `end` − 1 of a list. The arrays p, v, state, near, near_p, near_v, free and place are described in
`projection`.

Arrays of the free points, in the order of the list `free`
----------------------------------------------------------
r, w, d : residual, preconditioned residual and search direction.
ones : M1, the preconditioner applied to a vector of ones.
hardening_compliance : compliance a = 1/h [m/Pa] of a point that yields and hardens, and 0 for an elastic point.
scale : factor s = 1/√(1 + a m) of each free point, where m is the middle weight of the stencil M. With hardening, the
    preconditioner is s M s; the factor s accounts for the compliance a.

Other arrays
------------
response : Kd at the points near contact, in the order of the list `near`.
dense : values on the whole grid: the search direction d or other values to which the stencil is applied; 0 at points
    that are not free.
weights : stencil M of the preconditioner (3, 3).
rows : grid rows that correspond to the row numbers −1 to n1, (n1 + 2,). The row numbers −1 and n1 lie outside the grid.
    On a periodic or mirror axis, the row numbers −1 and n1 correspond to rows of the grid. On a free axis, the array
    contains −1 for the row numbers −1 and n1.
columns : grid columns that correspond to the column numbers −1 to n2, (n2 + 2,), defined like `rows`.
"""

import numpy as np

from .projection import fast, fast_leader, fast_loop, value_at


@fast_leader
def restart(
    hardness, slope, state, dense, near_p, near_v, free, place, r, ones, hardening_compliance,
    scale, weights, rows, columns, n_free, delta,
):  # fmt: skip
    """Prepare the first search direction: compute the residual r = δ − v − a (p − H) and M1 at the free points.

    Returns the sum of M1 over the free points, where M1 is the preconditioner applied to a vector of ones.
    """
    set_scale(n_free, slope, state, dense, free, hardening_compliance, scale, weights)
    total_ones = preconditioned(n_free, ones, dense, free, scale, weights, rows, columns)
    total = first_residual(
        n_free, delta, hardness, near_p, near_v, free, place, r, hardening_compliance
    )
    spread_residual(n_free, total / n_free, dense, free, r, scale)
    return total_ones


@fast_loop
def set_scale(first, end, slope, state, dense, free, hardening_compliance, scale, weights):
    """Compute the compliance a and the factor s of some free points, and store s in `dense` to prepare M1."""
    for k in range(first, end):
        i = free[k]
        hardening_compliance[k] = 1.0 / value_at(slope, i) if state[i] == 3 else 0.0
        scale[k] = 1.0 / np.sqrt(1.0 + hardening_compliance[k] * weights[1, 1])
        dense[i] = scale[k]


@fast_loop
def first_residual(
    first, end, delta, hardness, near_p, near_v, free, place, r, hardening_compliance
):
    """Compute the residuals of some free points, and return their sum."""
    total = 0.0
    for k in range(first, end):
        j = place[k]  # position of the point in the list `near`
        r[k] = delta - near_v[j]
        if hardening_compliance[k] > 0.0:
            r[k] -= hardening_compliance[k] * (near_p[j] - value_at(hardness, free[k]))
        total += r[k]
    return total


@fast_loop
def preconditioned(first, end, out, dense, free, scale, weights, rows, columns):
    """Compute s M x at some free points for the grid values x in `dense`, and return the sum of the results.

    The results are written to `out`.
    """
    listed = free[first:end]
    scale = scale[first:end]
    out = out[first:end]
    apply_stencil(listed, dense, out, weights, rows, columns)
    total = 0.0
    for k in range(end - first):
        out[k] *= scale[k]
        total += out[k]
    return total


@fast_leader
def next_direction(
    dense, free, r, w, d, ones, scale, weights, rows, columns, n_free, previous_wr, total_ones
):
    """Compute the next search direction d = w + β d with β = w·r / previous_wr, and copy d to `dense`.

    The preconditioned residual w is M r minus a multiple of M1, chosen such that Σ w = 0 and the steps do not change
    the load.

    previous_wr : product w·r of the previous direction; infinite if there is no previous direction.

    Returns w·r. If w·r is not positive, no direction is computed.
    """
    total = preconditioned(n_free, w, dense, free, scale, weights, rows, columns)
    wr = remove_mean(n_free, total / total_ones, r, w, ones)
    if wr > 0.0:
        set_direction(n_free, wr / previous_wr, dense, free, w, d)
    return wr


@fast_loop
def remove_mean(first, end, factor, r, w, ones):
    """Subtract `factor` times M1 from w at some free points, and return the contribution of these points to w·r."""
    r, w, ones = r[first:end], w[first:end], ones[first:end]
    wr = 0.0
    for k in range(end - first):
        w[k] -= factor * ones[k]
        wr += w[k] * r[k]
    return wr


@fast_loop
def set_direction(first, end, beta, dense, free, w, d):
    """Compute the search direction d = w + beta d at some free points, and copy d to `dense`."""
    free, w, d = free[first:end], w[first:end], d[first:end]
    for k in range(end - first):
        d[k] = w[k] + beta * d[k] if beta > 0.0 else w[k]
        dense[free[k]] = d[k]


@fast_leader
def step(
    kd, compliance, dense, near, near_p, near_v, free, place, r, d, hardening_compliance, scale, response,
    n_near, n_free, wr,
):  # fmt: skip
    """Perform a step of conjugate gradients: p += α d, v += α Kd and r −= α (Kd + a d), with α = w·r / d·(Kd + a d).

    kd : array (n1, >= n2), displacement under the pressure d for a half-space of unit modulus.
    compliance : factor 1/E* [1/Pa], by which `kd` is multiplied to obtain Kd.
    wr : product w·r for this search direction d.

    Returns d·Kd, d·d, and whether the step was performed. The step is only taken if d·(Kd + a d) > 0.
    """
    list_response(n_near, kd, compliance, dense.size // kd.shape[0], near, response)
    curvature, squared_length, total_curvature = curvatures(
        n_free, place, d, hardening_compliance, response
    )
    total = 0.0
    if total_curvature > 0.0:
        total = advance(
            n_free, wr / total_curvature, near_p, place, r, d, hardening_compliance, response
        )
        advance_gap(n_near, wr / total_curvature, near_v, response)
    spread_residual(n_free, total / n_free, dense, free, r, scale)
    return curvature, squared_length, total_curvature > 0.0


@fast_loop
def list_response(first, end, kd, compliance, columns, near, response):
    """Copy Kd at some points near contact from the grid to a list.

    The rows of the grid have `columns` points; the rows of `kd` may be longer. The grid indices in `near` increase, so
    the loop can keep count of the row. This is faster than dividing each index by `columns`.
    """
    listed = near[first:end]  # grid indices, in increasing order
    out = response[first:end]
    values = kd.ravel()
    unused = kd.shape[1] - columns  # unused values at the end of each row of `kd`
    skipped = 0  # number of unused values in the rows before the row of the point
    next_row = columns  # grid index of the first point in the next row
    for j in range(end - first):
        i = listed[j]
        while unused > 0 and i >= next_row:
            skipped += unused
            next_row += columns
        out[j] = compliance * values[i + skipped]


@fast_loop
def curvatures(first, end, place, d, hardening_compliance, response):
    """Compute the contributions of some free points to the sums d·Kd, d·d and d·(Kd + a d)."""
    place, d, hardening_compliance = place[first:end], d[first:end], hardening_compliance[first:end]
    curvature = 0.0
    squared_length = 0.0
    hardening = 0.0
    for k in range(end - first):
        curvature += response[place[k]] * d[k]
        squared_length += d[k] * d[k]
        hardening += hardening_compliance[k] * d[k] * d[k]
    return curvature, squared_length, curvature + hardening


@fast_loop
def advance(first, end, alpha, near_p, place, r, d, hardening_compliance, response):
    """Update the pressures and residuals of some free points: p += α d, r −= α (Kd + a d); return the sum of r."""
    place, r, d, hardening_compliance = (
        place[first:end],
        r[first:end],
        d[first:end],
        hardening_compliance[first:end],
    )
    total = 0.0
    for k in range(end - first):
        j = place[k]
        near_p[j] += alpha * d[k]
        r[k] -= alpha * (response[j] + hardening_compliance[k] * d[k])
        total += r[k]
    return total


@fast_loop
def advance_gap(first, end, alpha, near_v, response):
    """Add α Kd to v at some points near contact."""
    v, kd = near_v[first:end], response[first:end]
    for j in range(end - first):
        v[j] += alpha * kd[j]


@fast_loop
def spread_residual(first, end, mean, dense, free, r, scale):
    """Subtract the mean residual from the residuals r of some free points, and write s r to `dense`.

    After the first conjugate-gradient step, the mean residual differs from 0 only by rounding errors.
    """
    free, r, scale = free[first:end], r[first:end], scale[first:end]
    for k in range(end - first):
        r[k] -= mean
        dense[free[k]] = r[k] * scale[k]


@fast
def apply_stencil(listed, dense, out, weights, rows, columns):
    """Apply the 3 × 3 stencil to the grid values `dense` at the listed points, and write the results to `out`.

    listed : index of each point in the flat array `dense` (n1 n2,), which contains the grid row by row.
    """
    n1 = rows.size - 2  # `rows` and `columns` have an additional entry at both ends
    n2 = columns.size - 2
    for k in range(listed.size):
        point = listed[k]
        i = point // n2  # row and column of the point
        j = point - i * n2
        total = 0.0
        # all neighbours of a point in the interior are grid points
        if 1 <= i < n1 - 1 and 1 <= j < n2 - 1:
            for a in range(3):
                for b in range(3):
                    total += weights[a, b] * dense[point + (a - 1) * n2 + b - 1]
        else:
            for a in range(3):
                for b in range(3):
                    # entry i + a of `rows` is the grid row that corresponds to the row number i + a − 1
                    row = rows[i + a]
                    column = columns[j + b]
                    if row >= 0 and column >= 0:  # −1 is beyond the end of a free axis
                        total += weights[a, b] * dense[row * n2 + column]
        out[k] = total

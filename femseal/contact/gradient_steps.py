"""Compile the loops of conjugate gradients on the free points, with a preconditioner M of 3 × 3 points.

`active_sets` calls `restart`, `turn` and `step`. They consist of loops over the points `first` to `end` of a list. The
arrays p, v, state, near, near_p, near_v, free and place are those of `projection`.

Arrays of the free points, in the order of the list `free`
----------------------------------------------------------
r, w, d : residual, preconditioned residual and direction.
ones : M1, the preconditioner applied to a vector of ones.
soft : compliance a = 1/h of a point that yields and hardens [m/Pa], 0 of an elastic one.
scale : s = 1/√(1 + a m), where m is the middle weight of the stencil. A point that yields is softer by a, and the
    preconditioner is s M s.

Other arrays
------------
response : Kd of the points near contact, in the order of the list `near`.
dense : values at all points of the grid, 0 where a point is not free: what the stencil is applied to, or d.
weights : the stencil of the preconditioner (3, 3).
rows, columns : row and column that each row and column of the padded grid stands for, −1 outside a free axis.
"""

import numpy as np

from .projection import fast, fast_leader, fast_loop, value_at


@fast_leader
def restart(
    hardness, slope, state, dense, near_p, near_v, free, place, r, ones, soft,
    scale, weights, rows, columns, n_free, delta,
):  # fmt: skip
    """Compute the residual r = δ − v − a (p − H) and M1 on the free points, for the first direction; return Σ M1."""
    lay_ones(n_free, slope, state, dense, free, soft, scale, weights)
    total_ones = preconditioned(n_free, ones, dense, free, scale, weights, rows, columns)
    total = first_residual(n_free, delta, hardness, near_p, near_v, free, place, r, soft)
    spread_residual(n_free, total / n_free, dense, free, r, scale)
    return total_ones


@fast_loop
def lay_ones(first, end, slope, state, dense, free, soft, scale, weights):
    """Set compliance and scale of some free points, and write the values to `dense` from which M1 is computed."""
    for k in range(first, end):
        i = free[k]
        soft[k] = 1.0 / value_at(slope, i) if state[i] == 3 else 0.0
        scale[k] = 1.0 / np.sqrt(1.0 + soft[k] * weights[1, 1])
        dense[i] = scale[k]


@fast_loop
def first_residual(first, end, delta, hardness, near_p, near_v, free, place, r, soft):
    """Compute r of some free points; return its sum."""
    total = 0.0
    for k in range(first, end):
        j = place[k]
        r[k] = delta - near_v[j]
        if soft[k] > 0.0:
            r[k] -= soft[k] * (near_p[j] - value_at(hardness, free[k]))
        total += r[k]
    return total


@fast_loop
def preconditioned(first, end, out, dense, free, scale, weights, rows, columns):
    """Apply s M to `dense` at some free points, into `out`; return the sum."""
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
def turn(dense, free, r, w, d, ones, scale, weights, rows, columns, n_free, former, total_ones):
    """Compute the next direction d = w + (w·r / former) d, with w = M r minus the multiple of M1 that makes Σ w = 0.

    Returns w·r. If it is not > 0, there is no direction.
    """
    total = preconditioned(n_free, w, dense, free, scale, weights, rows, columns)
    wr = level(n_free, total / total_ones, r, w, ones)
    if wr > 0.0:
        direct(n_free, wr / former, dense, free, w, d)
    return wr


@fast_loop
def level(first, end, factor, r, w, ones):
    """Subtract a multiple of M1 from w at some free points; return w·r."""
    r, w, ones = r[first:end], w[first:end], ones[first:end]
    wr = 0.0
    for k in range(end - first):
        w[k] -= factor * ones[k]
        wr += w[k] * r[k]
    return wr


@fast_loop
def direct(first, end, beta, dense, free, w, d):
    """Set d = w + beta d at some free points, and in `dense`."""
    free, w, d = free[first:end], w[first:end], d[first:end]
    for k in range(end - first):
        d[k] = w[k] + beta * d[k] if beta > 0.0 else w[k]
        dense[free[k]] = d[k]


@fast_leader
def step(
    kd, compliance, dense, near, near_p, near_v, free, place, r, d, soft, scale, response,
    n_near, n_free, wr,
):  # fmt: skip
    """Make a step of conjugate gradients: p += α d, v += α Kd and r −= α (Kd + a d), with α = w·r / d·(Kd + a d).

    kd : product of the direction with K of a unit modulus (n1, >= n2), so that Kd is `compliance` times it. Returns
    d·Kd, d·d, and whether the step was made; it is not made unless d·(Kd + a d) > 0.
    """
    gather(n_near, kd, compliance, dense.size // kd.shape[0], near, response)
    curvature, length, stiff = curvatures(n_free, place, d, soft, response)
    total = 0.0
    if stiff > 0.0:
        total = advance(n_free, wr / stiff, near_p, place, r, d, soft, response)
        advance_gap(n_near, wr / stiff, near_v, response)
    spread_residual(n_free, total / n_free, dense, free, r, scale)
    return curvature, length, stiff > 0.0


@fast_loop
def gather(first, end, kd, compliance, columns, near, response):
    """Copy Kd of some points near contact from the grid, whose rows have `columns` points, to their list.

    The rows of `kd` are longer than those of the grid. The list rises, so that no division is needed to find the row of
    a point.
    """
    listed = near[first:end]
    out = response[first:end]
    values = kd.ravel()
    more = kd.shape[1] - columns
    skipped = 0
    next_row = columns
    for j in range(end - first):
        i = listed[j]
        while more > 0 and i >= next_row:
            skipped += more
            next_row += columns
        out[j] = compliance * values[i + skipped]


@fast_loop
def curvatures(first, end, place, d, soft, response):
    """Compute d·Kd, d·d and d·(Kd + a d) of some free points."""
    place, d, soft = place[first:end], d[first:end], soft[first:end]
    curvature = 0.0
    length = 0.0
    compliance = 0.0
    for k in range(end - first):
        curvature += response[place[k]] * d[k]
        length += d[k] * d[k]
        compliance += soft[k] * d[k] * d[k]
    return curvature, length, curvature + compliance


@fast_loop
def advance(first, end, alpha, near_p, place, r, d, soft, response):
    """Compute p += α d and r −= α (Kd + a d) at some free points; return Σ r."""
    place, r, d, soft = place[first:end], r[first:end], d[first:end], soft[first:end]
    total = 0.0
    for k in range(end - first):
        j = place[k]
        near_p[j] += alpha * d[k]
        r[k] -= alpha * (response[j] + soft[k] * d[k])
        total += r[k]
    return total


@fast_loop
def advance_gap(first, end, alpha, near_v, response):
    """Compute v += α Kd at some points near contact."""
    v, kd = near_v[first:end], response[first:end]
    for j in range(end - first):
        v[j] += alpha * kd[j]


@fast_loop
def spread_residual(first, end, mean, dense, free, r, scale):
    """Subtract the mean from the residuals of some free points, and write the scaled residuals to `dense`.

    The mean differs from 0 only because the load has a rounding error.
    """
    free, r, scale = free[first:end], r[first:end], scale[first:end]
    for k in range(end - first):
        r[k] -= mean
        dense[free[k]] = r[k] * scale[k]


@fast
def apply_stencil(listed, dense, out, weights, rows, columns):
    """Apply the stencil to `dense` at the listed points, into `out`."""
    n1 = rows.size - 2
    n2 = columns.size - 2
    for k in range(listed.size):
        f = listed[k]
        i = f // n2
        j = f - i * n2
        total = 0.0
        if 1 <= i < n1 - 1 and 1 <= j < n2 - 1:
            for a in range(3):
                for b in range(3):
                    total += weights[a, b] * dense[f + (a - 1) * n2 + b - 1]
        else:
            for a in range(3):
                for b in range(3):
                    row = rows[i + a]
                    column = columns[j + b]
                    if row >= 0 and column >= 0:
                        total += weights[a, b] * dense[row * n2 + column]
        out[k] = total

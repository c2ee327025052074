"""Compiled loops of conjugate gradients on the free points, with a preconditioner of 3×3 points.

The arrays are those of `kernels`. `restart`, `turn` and `step` are made of loops over some points of a list, from
`first` to `end`.
"""

import numpy as np

from .kernels import (
    FREE,
    KD,
    NEAR,
    ONES,
    PLACE,
    SCALE,
    SOFT,
    D,
    Line,
    P,
    Points,
    R,
    Stencil,
    V,
    W,
    fast,
    fast_leader,
    fast_loop,
    own,
)


@fast_leader
def restart(free, delta, loaded, line, points, stencil):
    """Residual r = δ − v − a (p − H) and M1 on the free points, with which conjugate gradients begin; returns Σ M1."""
    line, points, stencil = Line(*line), Points(*points), Stencil(*stencil)
    lay_ones(free, line, points, stencil)
    ones = preconditioned(free, points.on_free[ONES], points, stencil)
    total = first_residual(free, delta, line, points)
    spread_residual(free, total / free if loaded and free > 0 else 0.0, points)
    return ones


@fast_loop
def lay_ones(first, end, line, points, stencil):
    """Compliance and scale of some free points, and what M1 is found from."""
    listed = points.lists[FREE, first:end]
    soft = points.on_free[SOFT, first:end]
    scale = points.on_free[SCALE, first:end]
    weights = stencil.weights
    largest = weights[weights.shape[0] // 2, weights.shape[1] // 2]
    for k in range(end - first):
        i = listed[k]
        soft[k] = 1.0 / own(line.slope, i) if points.state[i] == 3 else 0.0
        scale[k] = 1.0 / np.sqrt(1.0 + soft[k] * largest)
        points.dense[i] = scale[k]


@fast_loop
def first_residual(first, end, delta, line, points):
    """r of some free points; returns its sum."""
    listed = points.lists[FREE, first:end]
    place = points.lists[PLACE, first:end]
    p, v = points.near[P], points.near[V]
    r = points.on_free[R, first:end]
    soft = points.on_free[SOFT, first:end]
    total = 0.0
    for k in range(end - first):
        r[k] = delta - v[place[k]]
        if soft[k] > 0.0:
            r[k] -= soft[k] * (p[place[k]] - own(line.hardness, listed[k]))
        total += r[k]
    return total


@fast_loop
def preconditioned(first, end, out, points, stencil):
    """s M of what is on the grid, at some free points; returns its sum."""
    listed = points.lists[FREE, first:end]
    scale = points.on_free[SCALE, first:end]
    out = out[first:end]
    apply_stencil(listed, points.dense, out, stencil)
    total = 0.0
    for k in range(end - first):
        out[k] *= scale[k]
        total += out[k]
    return total


@fast_leader
def turn(free, former, ones_total, loaded, points, stencil):
    """Next direction d = w + (w·r / former) d, where w = M r less a multiple of M1 that keeps Σ w = 0 under a load.

    Returns w·r. Where that is not > 0, there is no direction.
    """
    points, stencil = Points(*points), Stencil(*stencil)
    total = preconditioned(free, points.on_free[W], points, stencil)
    wr = level(free, total / ones_total if loaded else 0.0, points)
    if wr > 0.0:
        direct(free, wr / former, points)
    return wr


@fast_loop
def level(first, end, factor, points):
    """Take a multiple of M1 from w at some free points; returns w·r."""
    r = points.on_free[R, first:end]
    w = points.on_free[W, first:end]
    ones = points.on_free[ONES, first:end]
    wr = 0.0
    for k in range(end - first):
        w[k] -= factor * ones[k]
        wr += w[k] * r[k]
    return wr


@fast_loop
def direct(first, end, beta, points):
    """d = w + beta d at some free points, and on the grid."""
    listed = points.lists[FREE, first:end]
    w = points.on_free[W, first:end]
    d = points.on_free[D, first:end]
    for k in range(end - first):
        d[k] = w[k] + beta * d[k] if beta > 0.0 else w[k]
        points.dense[listed[k]] = d[k]


@fast_leader
def step(n, free, wr, loaded, kd, points):
    """One step of conjugate gradients, p += α d, v += α Kd and r −= α (Kd + a d), with α = w·r / d·(Kd + a d).

    Returns d·Kd, d·d and whether the step was made: not where d·(Kd + a d) is not > 0.
    """
    points = Points(*points)
    gather(n, kd, points.dense.size // kd.shape[0], points)
    curvature, length, stiff = curvatures(free, points)
    total = 0.0
    if stiff > 0.0:
        total = advance(free, wr / stiff, points)
        advance_gap(n, wr / stiff, points)
    spread_residual(free, total / free if loaded and free > 0 else 0.0, points)
    return curvature, length, stiff > 0.0


@fast_loop
def gather(first, end, kd, columns, points):
    """Kd of some points near contact, of which each row of the grid has so many columns."""
    listed = points.lists[NEAR, first:end]
    kn = points.near[KD, first:end]
    values = kd.ravel()
    more = kd.shape[1] - columns
    skipped = 0
    next_row = columns
    for j in range(end - first):
        i = listed[j]
        while more > 0 and i >= next_row:
            skipped += more
            next_row += columns
        kn[j] = values[i + skipped]


@fast_loop
def curvatures(first, end, points):
    """d·Kd, d·d and d·(Kd + a d) of some free points."""
    place = points.lists[PLACE, first:end]
    kn = points.near[KD]
    d = points.on_free[D, first:end]
    soft = points.on_free[SOFT, first:end]
    curvature = 0.0
    length = 0.0
    compliance = 0.0
    for k in range(end - first):
        curvature += kn[place[k]] * d[k]
        length += d[k] * d[k]
        compliance += soft[k] * d[k] * d[k]
    return curvature, length, curvature + compliance


@fast_loop
def advance(first, end, alpha, points):
    """p += α d and r −= α (Kd + a d) at some free points; returns Σ r."""
    place = points.lists[PLACE, first:end]
    p = points.near[P]
    kn = points.near[KD]
    r = points.on_free[R, first:end]
    d = points.on_free[D, first:end]
    soft = points.on_free[SOFT, first:end]
    total = 0.0
    for k in range(end - first):
        p[place[k]] += alpha * d[k]
        r[k] -= alpha * (kn[place[k]] + soft[k] * d[k])
        total += r[k]
    return total


@fast_loop
def advance_gap(first, end, alpha, points):
    """v += α Kd at some points near contact."""
    v = points.near[V, first:end]
    kn = points.near[KD, first:end]
    for j in range(end - first):
        v[j] += alpha * kn[j]


@fast_loop
def spread_residual(first, end, mean, points):
    """Write residuals to the points of the grid, less their mean under a load, which only rounding would leave over."""
    listed = points.lists[FREE, first:end]
    r = points.on_free[R, first:end]
    scale = points.on_free[SCALE, first:end]
    for k in range(end - first):
        r[k] -= mean
        points.dense[listed[k]] = r[k] * scale[k]


@fast
def apply_stencil(listed, dense, out, stencil):
    """Write stencil ∗ dense at the listed points to `out`."""
    weights, rows, columns = stencil
    r1 = weights.shape[0] // 2
    r2 = weights.shape[1] // 2
    n1 = rows.size - 2 * r1
    n2 = columns.size - 2 * r2
    nine = (r1 == 1) & (r2 == 1)
    for k in range(listed.size):
        f = listed[k]
        i = f // n2
        j = f - i * n2
        s = 0.0
        if nine and 1 <= i < n1 - 1 and 1 <= j < n2 - 1:
            for a in range(3):
                for b in range(3):
                    s += weights[a, b] * dense[f + (a - 1) * n2 + b - 1]
        else:
            for a in range(2 * r1 + 1):
                for b in range(2 * r2 + 1):
                    row = rows[i + a]
                    column = columns[j + b]
                    if row >= 0 and column >= 0:
                        s += weights[a, b] * dense[row * n2 + column]
        out[k] = s

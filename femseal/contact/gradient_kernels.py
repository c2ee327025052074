"""Compiled loops of conjugate gradients on the free points, with a preconditioner of 3×3 points.

The arrays are those of `kernels`. `restart`, `turn` and `step` are made of loops over some points of a list, from
`first` to `end`, which `long_lists` runs on several threads.
"""

from __future__ import annotations

import numpy as np

from ..base.compiled import compiled, inner
from ..base.threads import ZERO
from .kernels import FAST


@compiled(**FAST)
def restart(free, delta, loaded, hardens, hardness, slope, state, lists, near, on_free, dense, stencil, rows, columns):
    """Residual r = δ − v − a (p − H) and M1 on the free points, with which conjugate gradients begin; returns Σ M1."""
    lay_ones(ZERO, free, hardens, slope, state, lists, on_free, dense, stencil)
    line = hardness, slope
    ones, total = first_residual(
        0, free, delta, hardens, *line, state, lists, near, on_free, dense, stencil, rows, columns
    )
    spread_residual(ZERO, free, total / free if loaded and free > 0 else 0.0, hardens, lists, on_free, dense)
    return ones


@compiled(**FAST)
def lay_ones(first, end, hardens, slope, state, lists, on_free, dense, stencil):
    """Compliance and scale of some free points, and what M1 is found from."""
    listed, soft, scale = lists[1, first:end], on_free[4, first:end], on_free[5, first:end]
    if hardens:
        largest = stencil[stencil.shape[0] // 2, stencil.shape[1] // 2]
        for k in range(end - first):
            soft[k] = 1.0 / slope[listed[k] if slope.size > 1 else 0] if state[listed[k]] == 3 else 0.0
            scale[k] = 1.0 / np.sqrt(1.0 + soft[k] * largest)
            dense[listed[k]] = scale[k]
    else:
        for k in range(end - first):
            dense[listed[k]] = 1.0


@compiled(**FAST)
def first_residual(
    first, end, delta, hardens, hardness, slope, state, lists, near, on_free, dense, stencil, rows, columns
):
    """M1 and r of some free points; returns the sums of both."""
    listed, place, p, v = lists[1, first:end], lists[2, first:end], near[1], near[2]
    r, ones, soft, scale = on_free[0, first:end], on_free[3, first:end], on_free[4, first:end], on_free[5, first:end]
    ones_total = apply_stencil(listed, dense, ones, stencil, rows, columns)
    total = 0.0
    for k in range(end - first):
        r[k] = delta - v[place[k]]
        total += r[k]
    if hardens:
        ones_total = _scaled(ones, scale)
        for k in range(end - first):
            if state[listed[k]] == 3:
                away = soft[k] * (p[place[k]] - hardness[listed[k] if hardness.size > 1 else 0])
                r[k] -= away
                total -= away
    return ones_total, total


@inner(**FAST)
def _scaled(values, scale):
    """Multiply values by the scale of their points; returns their sum."""
    total = 0.0
    for k in range(values.size):
        values[k] *= scale[k]
        total += values[k]
    return total


@compiled(**FAST)
def turn(free, former, ones_total, loaded, hardens, lists, on_free, dense, stencil, rows, columns):
    """Next direction d = w + (w·r / former) d, where w = M r less a multiple of M1 that keeps Σ w = 0 under a load.

    Returns w·r. Where that is not > 0, there is no direction.
    """
    total = precondition(ZERO, free, hardens, lists, on_free, dense, stencil, rows, columns)
    wr = level(ZERO, free, total / ones_total if loaded else 0.0, on_free)
    if wr > 0.0:
        direct(ZERO, free, wr / former, lists, on_free, dense)
    return wr


@compiled(**FAST)
def precondition(first, end, hardens, lists, on_free, dense, stencil, rows, columns):
    """w = M r of some free points; returns its sum."""
    w = on_free[1, first:end]
    total = apply_stencil(lists[1, first:end], dense, w, stencil, rows, columns)
    return _scaled(w, on_free[5, first:end]) if hardens else total


@compiled(**FAST)
def level(first, end, factor, on_free):
    """Take a multiple of M1 from w at some free points; returns w·r."""
    r, w, ones = on_free[0, first:end], on_free[1, first:end], on_free[3, first:end]
    wr = 0.0
    for k in range(end - first):
        w[k] -= factor * ones[k]
        wr += w[k] * r[k]
    return wr


@compiled(**FAST)
def direct(first, end, beta, lists, on_free, dense):
    """d = w + beta d at some free points, and on the grid."""
    listed, w, d = lists[1, first:end], on_free[1, first:end], on_free[2, first:end]
    if beta == 0.0:
        for k in range(end - first):
            d[k] = w[k]
            dense[listed[k]] = w[k]
    else:
        for k in range(end - first):
            d[k] = w[k] + beta * d[k]
            dense[listed[k]] = d[k]


@compiled(**FAST)
def step(n, free, wr, loaded, hardens, kd, lists, near, on_free, dense):
    """One step of conjugate gradients, p += α d, v += α Kd and r −= α (Kd + a d), with α = w·r / d·(Kd + a d).

    Returns d·Kd, d·d and whether the step was made: not where d·(Kd + a d) is not > 0.
    """
    gather(ZERO, n, kd, dense.size // kd.shape[0], lists, near)
    curvature, length, stiff = curvatures(ZERO, free, hardens, lists, near, on_free)
    total = 0.0
    if stiff > 0.0:
        total = advance(ZERO, free, wr / stiff, hardens, lists, near, on_free)
        advance_gap(ZERO, n, wr / stiff, near)
    spread_residual(ZERO, free, total / free if loaded and free > 0 else 0.0, hardens, lists, on_free, dense)
    return curvature, length, stiff > 0.0


@compiled(**FAST)
def gather(first, end, kd, columns, lists, near):
    """Kd of some points near contact, of which each row of the grid has so many columns."""
    listed, kn = lists[0, first:end], near[3, first:end]
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


@compiled(**FAST)
def curvatures(first, end, hardens, lists, near, on_free):
    """d·Kd, d·d and d·(Kd + a d) of some free points."""
    place, kn, d, soft = lists[2, first:end], near[3], on_free[2, first:end], on_free[4, first:end]
    curvature = 0.0
    length = 0.0
    for k in range(end - first):
        curvature += kn[place[k]] * d[k]
        length += d[k] * d[k]
    stiff = curvature
    if hardens:
        for k in range(end - first):
            stiff += soft[k] * d[k] * d[k]
    return curvature, length, stiff


@compiled(**FAST)
def advance(first, end, alpha, hardens, lists, near, on_free):
    """p += α d and r −= α (Kd + a d) at some free points; returns Σ r."""
    place, p, kn = lists[2, first:end], near[1], near[3]
    r, d, soft = on_free[0, first:end], on_free[2, first:end], on_free[4, first:end]
    total = 0.0
    if hardens:
        for k in range(end - first):
            r[k] -= alpha * soft[k] * d[k]
    for k in range(end - first):
        p[place[k]] += alpha * d[k]
        r[k] -= alpha * kn[place[k]]
        total += r[k]
    return total


@compiled(**FAST)
def advance_gap(first, end, alpha, near):
    """v += α Kd at some points near contact."""
    v, kn = near[2, first:end], near[3, first:end]
    for j in range(end - first):
        v[j] += alpha * kn[j]


@compiled(**FAST)
def spread_residual(first, end, mean, hardens, lists, on_free, dense):
    """Write residuals to the points of the grid, less their mean under a load, which only rounding would leave over."""
    listed, r, scale = lists[1, first:end], on_free[0, first:end], on_free[5, first:end]
    if hardens:
        for k in range(end - first):
            r[k] -= mean
            dense[listed[k]] = r[k] * scale[k]
    else:
        for k in range(end - first):
            r[k] -= mean
            dense[listed[k]] = r[k]


@compiled(**FAST)
def apply_stencil(listed, dense, out, stencil, rows, columns):
    """Write stencil ∗ dense at the listed points to `out` and return its sum.

    rows, columns : index on the grid for each index of the padded grid, −1 outside.
    """
    r1 = stencil.shape[0] // 2
    r2 = stencil.shape[1] // 2
    n1 = rows.size - 2 * r1
    n2 = columns.size - 2 * r2
    total = 0.0
    nine = (r1 == 1) & (r2 == 1)
    s00, s01, s02 = stencil[0, 0], stencil[0, r2], stencil[0, -1]
    s10, s11, s12 = stencil[r1, 0], stencil[r1, r2], stencil[r1, -1]
    s20, s21, s22 = stencil[-1, 0], stencil[-1, r2], stencil[-1, -1]
    for k in range(listed.size):
        f = listed[k]
        i = f // n2
        j = f - i * n2
        s = 0.0
        if nine and 1 <= i < n1 - 1 and 1 <= j < n2 - 1:
            s = (
                s00 * dense[f - n2 - 1]
                + s01 * dense[f - n2]
                + s02 * dense[f - n2 + 1]
                + s10 * dense[f - 1]
                + s11 * dense[f]
                + s12 * dense[f + 1]
                + s20 * dense[f + n2 - 1]
                + s21 * dense[f + n2]
                + s22 * dense[f + n2 + 1]
            )
        else:
            for a in range(2 * r1 + 1):
                row = rows[i + a]
                if row >= 0:
                    for b in range(2 * r2 + 1):
                        column = columns[j + b]
                        if column >= 0:
                            s += stencil[a, b] * dense[row * n2 + column]
        out[k] = s
        total += s
    return total

"""Compiled loops of conjugate gradients on the free points, with a preconditioner of 3×3 points.

The arrays are those of `kernels`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .kernels import FAST


@njit(**FAST)
def restart(free, delta, loaded, hardens, hardness, slope, state, lists, near, on_free, dense, stencil, rows, columns):
    """Residual r = δ − v − a (p − H) and M1 on the free points, with which conjugate gradients begin; returns Σ M1."""
    listed, place, p, v = lists[1], lists[2], near[1], near[2]
    r, ones, soft, scale = on_free[0], on_free[3], on_free[4], on_free[5]
    for k in range(free):
        dense[listed[k]] = 1.0
    if hardens:
        largest = stencil[stencil.shape[0] // 2, stencil.shape[1] // 2]
        for k in range(free):
            soft[k] = 1.0 / slope[listed[k] if slope.size > 1 else 0] if state[listed[k]] == 3 else 0.0
            scale[k] = 1.0 / np.sqrt(1.0 + soft[k] * largest)
            dense[listed[k]] = scale[k]
    ones_total = apply_stencil(free, listed, dense, ones, stencil, rows, columns)
    total = 0.0
    for k in range(free):
        r[k] = delta - v[place[k]]
        total += r[k]
    if hardens:
        ones_total = _scaled(free, ones, scale)
        for k in range(free):
            if state[listed[k]] == 3:
                away = soft[k] * (p[place[k]] - hardness[listed[k] if hardness.size > 1 else 0])
                r[k] -= away
                total -= away
    _spread_residual(free, listed, r, total, loaded, hardens, scale, dense)
    return ones_total


@njit(**FAST)
def _scaled(free, values, scale):
    """Multiply values by the scale of their points; returns their sum."""
    total = 0.0
    for k in range(free):
        values[k] *= scale[k]
        total += values[k]
    return total


@njit(**FAST)
def turn(free, former, ones_total, loaded, hardens, lists, on_free, dense, stencil, rows, columns):
    """Next direction d = w + (w·r / former) d, where w = M r less a multiple of M1 that keeps Σ w = 0 under a load.

    Returns w·r. Where that is not > 0, there is no direction.
    """
    listed, r, w, d, ones = lists[1], on_free[0], on_free[1], on_free[2], on_free[3]
    total = apply_stencil(free, listed, dense, w, stencil, rows, columns)
    if hardens:
        total = _scaled(free, w, on_free[5])
    wr = 0.0
    if loaded:
        factor = total / ones_total
        for k in range(free):
            w[k] -= factor * ones[k]
            wr += w[k] * r[k]
    else:
        for k in range(free):
            wr += w[k] * r[k]
    if wr > 0.0:
        beta = wr / former
        if beta == 0.0:
            for k in range(free):
                d[k] = w[k]
                dense[listed[k]] = w[k]
        else:
            for k in range(free):
                d[k] = w[k] + beta * d[k]
                dense[listed[k]] = d[k]
    return wr


@njit(**FAST)
def step(n, free, wr, loaded, hardens, kd, lists, near, on_free, dense):
    """One step of conjugate gradients, p += α d, v += α Kd and r −= α (Kd + a d), with α = w·r / d·(Kd + a d).

    Returns d·Kd, d·d and whether the step was made: not where d·(Kd + a d) is not > 0.
    """
    listed_near, listed, place = lists[0], lists[1], lists[2]
    p, v, kn, r, d, soft = near[1], near[2], near[3], on_free[0], on_free[2], on_free[4]
    for j in range(n):
        kn[j] = kd[listed_near[j]]
    curvature = 0.0
    length = 0.0
    for k in range(free):
        curvature += kn[place[k]] * d[k]
        length += d[k] * d[k]
    stiff = curvature
    if hardens:
        for k in range(free):
            stiff += soft[k] * d[k] * d[k]
    total = 0.0
    if stiff > 0.0:
        alpha = wr / stiff
        if hardens:
            for k in range(free):
                r[k] -= alpha * soft[k] * d[k]
        for k in range(free):
            p[place[k]] += alpha * d[k]
            r[k] -= alpha * kn[place[k]]
            total += r[k]
        for j in range(n):
            v[j] += alpha * kn[j]
    _spread_residual(free, listed, r, total, loaded, hardens, on_free[5], dense)
    return curvature, length, stiff > 0.0


@njit(**FAST)
def _spread_residual(free, listed, r, total, loaded, hardens, scale, dense):
    """Write residuals to the points of the grid, less their mean under a load, which only rounding would leave over."""
    mean = total / free if loaded and free > 0 else 0.0
    if hardens:
        for k in range(free):
            r[k] -= mean
            dense[listed[k]] = r[k] * scale[k]
    else:
        for k in range(free):
            r[k] -= mean
            dense[listed[k]] = r[k]


@njit(**FAST)
def apply_stencil(n, listed, dense, out, stencil, rows, columns):
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
    for k in range(n):
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

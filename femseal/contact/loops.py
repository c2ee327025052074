"""Compiled loops of the contact solver, on flat arrays.

State of a point: 0 out of contact (p = 0), 1 free (0 < p < H), 2 plastic (p = H). `hardness` has one value or one
per point; `hs` is its stride, 0 or 1.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

_exact: dict[str, Any] = {"cache": True, "nogil": True}
_fast: dict[str, Any] = {"cache": True, "nogil": True, "fastmath": {"reassoc", "nsz", "arcp", "contract"}}


@njit(**_exact)
def root_of_load(p, v, c, hardness, hs, load, start, work):
    """δ with Σ clip(p − c(v − δ), 0, H) = load: monotone, piecewise linear; Newton within a bracket.

    Only points that can be in contact for a δ in the bracket are looked at again; `work` holds them.
    """
    n = p.size
    reach = 0.0
    for i in range(n):
        if p[i] > reach:
            reach = p[i]
    if reach == 0.0:
        reach = load / n
    top = start + 2.0 * reach / c
    low = np.inf  # below every point: no load
    for i in range(n):
        low = min(low, v[i] - p[i] / c)
    k = 0
    while True:  # raise the bracket's top until the load there is enough
        shift = c * top
        k = 0
        total = 0.0
        full = 0
        for i in range(n):
            y = p[i] - c * v[i] + shift
            if y > 0.0:
                h = hardness[i * hs]
                work[0, k] = y - shift
                work[1, k] = h
                k += 1
                if y < h:
                    total += y
                else:
                    total += h
                    full += 1
        if total >= load or full == n:
            break
        low = top
        reach *= 4.0
        top += reach / c
    d = min(max(start, low), top)
    for _ in range(200):
        total = 0.0
        slope = 0
        shift = c * d
        for j in range(k):
            y = work[0, j] + shift
            if y > 0.0:
                if y < work[1, j]:
                    total += y
                    slope += 1
                else:
                    total += work[1, j]
        excess = total - load
        if excess > 0.0:
            top = d
        else:
            low = d
        if abs(excess) <= 1e-14 * load:
            break
        new = d - excess / (c * slope) if slope > 0 else low
        if new <= low or new >= top:
            new = 0.5 * (low + top)
        if new == d:
            break
        d = new
    return d


@njit(**_exact)
def count_changes(p, v, c, hardness, hs, delta, state):
    """‖p − y‖², ‖y‖² with y = clip(p − c(v − δ), 0, H), and how many points would change state."""
    r2 = 0.0
    n2 = 0.0
    changed = 0
    for i in range(p.size):
        y = p[i] - c * (v[i] - delta)
        if y <= 0.0:
            s = 0
            y = 0.0
        elif y >= hardness[i * hs]:
            s = 2
            y = hardness[i * hs]
        else:
            s = 1
        if s != state[i]:
            changed += 1
        if s != 0 or p[i] != 0.0:
            e = y - p[i]
            r2 += e * e
            n2 += y * y
    return r2, n2, changed


@njit(**_exact)
def project(p, v, c, hardness, hs, load, delta, state, free):
    """p = clip(p − c(v − δ), 0, H); set the states and the list of free points; returns their number."""
    k = 0
    left = load
    total = 0.0
    for i in range(p.size):
        y = p[i] - c * (v[i] - delta)
        if y <= 0.0:
            state[i] = 0
            p[i] = 0.0
        elif y >= hardness[i * hs]:
            state[i] = 2
            p[i] = hardness[i * hs]
            left -= p[i]
        else:
            state[i] = 1
            p[i] = y
            total += y
            free[k] = i
            k += 1
    if k > 0 and left > 0.0:
        factor = left / total
        if 0.5 < factor < 2.0:
            for j in range(k):
                p[free[j]] = min(p[free[j]] * factor, hardness[free[j] * hs])
    return k


@njit(**_fast)
def add_gap(u, gap0, v):
    """v = u + h₁."""
    for i in range(v.size):
        v[i] = u[i] + gap0[i]


@njit(**_fast)
def energy(p, v, gap0):
    """½⟨p, Kp⟩ + ⟨p, h₁⟩ from v = Kp + h₁."""
    s = 0.0
    for i in range(p.size):
        if p[i] != 0.0:
            s += p[i] * (v[i] + gap0[i])
    return 0.5 * s


@njit(**_fast)
def free_residual(free, n, v, r):
    """r = −(v − mean v) on the free points."""
    s = 0.0
    for k in range(n):
        r[k] = -v[free[k]]
        s += r[k]
    s /= n
    for k in range(n):
        r[k] -= s


@njit(**_fast)
def scatter(free, n, x, shift, dense):
    """dense[free] = x − shift."""
    for k in range(n):
        dense[free[k]] = x[k] - shift


@njit(**_fast)
def clear(free, n, dense):
    """dense[free] = 0."""
    for k in range(n):
        dense[free[k]] = 0.0


@njit(**_fast)
def stencil_product(free, n, dense, out, n2, stencil, rows, columns):
    """out = stencil ∗ dense at the free points; `rows`, `columns` map padded to real indices, −1 outside."""
    r1 = stencil.shape[0] // 2
    r2 = stencil.shape[1] // 2
    n1 = rows.size - 2 * r1
    for k in range(n):
        i = free[k] // n2
        j = free[k] - i * n2
        s = 0.0
        if r1 <= i < n1 - r1 and r2 <= j < n2 - r2:
            for a in range(-r1, r1 + 1):
                base = (i + a) * n2 + j
                for b in range(-r2, r2 + 1):
                    s += stencil[a + r1, b + r2] * dense[base + b]
        else:
            for a in range(2 * r1 + 1):
                row = rows[i + a]
                if row >= 0:
                    for b in range(2 * r2 + 1):
                        column = columns[j + b]
                        if column >= 0:
                            s += stencil[a, b] * dense[row * n2 + column]
        out[k] = s


@njit(**_fast)
def total(x, n):
    """Σ x."""
    s = 0.0
    for k in range(n):
        s += x[k]
    return s


@njit(**_fast)
def project_and_dot(w, ones, factor, r, n):
    """w −= factor · ones, so that Σ w = 0; returns w·r."""
    s = 0.0
    for k in range(n):
        w[k] -= factor * ones[k]
        s += w[k] * r[k]
    return s


@njit(**_fast)
def new_direction(free, n, w, d, beta, dense):
    """d = w + β d, also at its place in the dense array."""
    for k in range(n):
        d[k] = w[k] + beta * d[k]
        dense[free[k]] = d[k]


@njit(**_fast)
def curvature(free, n, d, kd):
    """d·Kd and d·d over the free points."""
    s = 0.0
    t = 0.0
    for k in range(n):
        s += kd[free[k]] * d[k]
        t += d[k] * d[k]
    return s, t


@njit(**_fast)
def step(free, n, alpha, d, kd, p, r, v):
    """p += α d and r −= α Kd on the free points, v += α Kd everywhere."""
    for k in range(n):
        p[free[k]] += alpha * d[k]
        r[k] -= alpha * kd[free[k]]
    for i in range(v.size):
        v[i] += alpha * kd[i]

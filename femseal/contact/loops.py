"""Compiled part of the contact solver: all between two products with K, on flat arrays.

`advance` is a coroutine in all but name. It goes on until it needs a product, says which, and is called again once the
buffers hold it; what it has to remember is a `Progress` record. State of a point: 0 out of contact (p = 0), 1 free
(0 < p < H), 2 plastic (p = H). `hardness` has one value or one per point.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

#: What `advance` asks for: v = K p, Kd, or nothing more.
PRESSURE, DIRECTION, DONE = 0, 1, 2
#: Where a solution is.
_FIRST, _PROJECTED, _SEARCHING = 0, 1, 2
#: Conjugate gradients go on for so many steps, or until the residual's energy norm fell so far.
_STEPS_AFTER_CHANGE, _STEPS, _DROP = 3, 5, 0.04

Progress = np.dtype(
    [(name, "f8") for name in (
        "load", "delta", "offset", "c", "c0", "c_min", "rtol", "damping", "energy", "residual", "rz", "rz_start",
        "rz_direction", "largest", "ones_total")]
    + [(name, "i8") for name in (
        "phase", "approach_given", "active", "free", "changed", "converged", "fresh", "preconditioned", "block", "cg",
        "iteration", "limit")],
    align=True,
)  # fmt: skip

_exact: dict[str, Any] = {"cache": True, "nogil": True}
_fast: dict[str, Any] = {"cache": True, "nogil": True, "fastmath": {"reassoc", "nsz", "arcp", "contract", "nnan"}}


@njit(**_exact)
def advance(progress, p, v, d, kd, gap0, hardness, state, lists, work, dense, stencil, rows, columns):
    """Continue a solution; returns what is needed next.

    p, v : pressure, and K p where asked for, to which the gap is added. d, kd : direction and K d.
    state : of each point. lists : indices of the points in contact and of the free ones.
    work : five rows for values on these lists. dense : zeros, for values at their place.
    """
    t = progress[0]
    active, free = lists[0], lists[1]
    x, r, w, direction, ones = work[0], work[1], work[2], work[3], work[4]
    pending = 0.0
    if t.phase == _SEARCHING:
        curvature, length = _curvature(free, t.free, direction, kd, w)
        if curvature > 0.0:
            pending = t.rz_direction / curvature
            t.largest = min(t.largest, length / curvature)
            _step(t, free, pending, direction, w, p, r, dense)
            t.fresh = 0
            t.block += 1
            t.cg += 1
            t.preconditioned = 0
            if t.block < (_STEPS_AFTER_CHANGE if t.changed else _STEPS):
                t.rz = _precondition(t, free, r, w, ones, dense, stencil, rows, columns)
                t.preconditioned = 1
                if t.rz > 0.0 and t.rz >= _DROP * t.rz_start:
                    _add(v, pending, kd)
                    return _search(t, free, w, direction, d)
        else:
            t.cg = 0
        t.c = max(t.c_min, min(t.c0, 2.0 * t.damping * t.largest))
    else:
        _contact_and_energy(t, p, v, gap0, state, active, free)
        if t.phase == _FIRST:
            if not t.approach_given:
                t.delta = _mean_at(v, active, t.active)
        else:
            if t.changed:
                _fill(free, t.free, dense)
                t.ones_total = _stencil_product(free, t.free, dense, ones, stencil, rows, columns)
            _free_residual(t, free, v, r, dense)
            t.cg = 0
            t.preconditioned = 0
            if not t.converged and t.free >= 2:
                needs = _begin_block(t, free, r, w, direction, ones, d, dense, stencil, rows, columns)
                if needs != DONE:
                    return needs
    while True:
        count = _look(t, p, v, pending, kd, hardness, state, active, x)
        pending = 0.0
        t.converged = t.residual <= t.rtol
        if (t.converged and t.fresh) or t.iteration >= t.limit:
            _clear(free, t.free, d, dense)
            return DONE
        t.iteration += 1
        if t.changed or t.converged or t.phase == _FIRST or t.free < 2:
            _clear(free, t.free, d, dense)
            _project(t, p, hardness, state, active, count, x)
            t.changed += t.phase == _FIRST
            t.phase = _PROJECTED
            return PRESSURE
        needs = _begin_block(t, free, r, w, direction, ones, d, dense, stencil, rows, columns)
        if needs != DONE:
            return needs
        # no direction left to go: the sets have to change, with a step as long as possible
        t.c = t.c0


@njit(**_exact)
def _begin_block(t, free, r, w, direction, ones, d, dense, stencil, rows, columns):
    """Direction of a next run of conjugate gradients; DONE if the residual is 0."""
    if not t.preconditioned:
        t.rz = _precondition(t, free, r, w, ones, dense, stencil, rows, columns)
    t.rz_start = t.rz
    t.block = 0
    t.largest = t.c0
    return _search(t, free, w, direction, d) if t.rz > 0.0 else DONE


@njit(**_exact)
def _search(t, free, w, direction, d):
    """Ask for the product with the next direction."""
    _new_direction(free, t.free, w, direction, t.rz / t.rz_direction if t.cg > 0 else 0.0, d)
    t.rz_direction = t.rz
    t.preconditioned = 0
    t.phase = _SEARCHING
    return DIRECTION


@njit(**_exact)
def _look(t, p, v, pending, kd, hardness, state, active, x):
    """v += pending · Kd, then δ, the residual and the number of points that change state.

    With y(δ) = clip(p − c(v − δ), 0, H), the points in contact alone carry the load at no less than the right δ, so
    only points below that can come into contact: they are appended to `active`. Returns the number of its entries.
    """
    c = t.c
    m = t.active
    for j in range(m):
        i = active[j]
        x[j] = p[i] - c * (v[i] + pending * kd[i] if pending != 0.0 else v[i])
    top = t.delta
    if not t.approach_given:
        top, carried = _root(x, m, hardness, active, c, t.load, t.delta)
        if not carried:
            top = np.inf
    count = m
    if pending != 0.0:
        for i in range(v.size):
            vi = v[i] + pending * kd[i]
            v[i] = vi
            if vi < top and state[i] == 0:
                active[count] = i
                x[count] = -c * vi
                count += 1
    else:
        for i in range(v.size):
            if v[i] < top and state[i] == 0:
                active[count] = i
                x[count] = -c * v[i]
                count += 1
    if not t.approach_given:
        if count > m:
            top, carried = _root(x, count, hardness, active, c, t.load, top if top < np.inf else t.delta)
        t.delta = top
    r2 = 0.0
    y2 = 0.0
    changed = 0
    shift = c * t.delta
    one = hardness.size == 1
    h = hardness[0]
    for j in range(count):
        i = active[j]
        if not one:
            h = hardness[i]
        y = x[j] + shift
        s = 1
        if y <= 0.0:
            y = 0.0
            s = 0
        elif y >= h:
            y = h
            s = 2
        if s != state[i]:
            changed += 1
        e = y - p[i]
        r2 += e * e
        y2 += y * y
    t.changed = changed
    # of the step c₀, whatever the step is now
    t.residual = np.sqrt(r2 / y2) * (t.c0 / c) if y2 > 0.0 else (0.0 if r2 == 0.0 else np.inf)
    return count


@njit(**_exact)
def _root(x, m, hardness, active, c, load, start):
    """δ with Σ clip(x + cδ, 0, H) = load on a list of points, and whether they can carry it.

    The sum is monotone and piecewise linear: Newton within a bracket.
    """
    highest = -np.inf
    full = -np.inf
    capacity = 0.0
    h = hardness[0]
    one = hardness.size == 1
    for j in range(m):
        highest = max(highest, x[j])
        if not one:
            h = hardness[active[j]]
        full = max(full, min(h, load) - x[j])
        capacity += h
    if capacity <= load:
        return full / c, capacity >= load
    low = -highest / c
    top = full / c
    top += 1e-12 * abs(top)
    d = min(max(start, low), top)
    for _ in range(200):
        total, slope = _clipped(x, m, c * d, hardness, active)
        excess = total - load
        if excess > 0.0:
            top = min(top, d)
        else:
            low = max(low, d)
        if abs(excess) <= 1e-14 * load:
            break
        new = d - excess / (c * slope) if slope > 0.0 else low
        if new <= low or new >= top:
            new = 0.5 * (low + top)
        if new == d:
            break
        d = new
    return d, True


@njit(**_fast)
def _clipped(x, m, shift, hardness, active):
    """Σ clip(x + shift, 0, H), and the number of points between the bounds."""
    total = 0.0
    slope = 0.0
    if hardness.size == 1:
        h = hardness[0]
        for j in range(m):
            y = x[j] + shift
            inside = 1.0 if (y > 0.0) & (y < h) else 0.0
            y = y if y > 0.0 else 0.0
            total += y if y < h else h
            slope += inside
    else:
        for j in range(m):
            h = hardness[active[j]]
            y = x[j] + shift
            inside = 1.0 if (y > 0.0) & (y < h) else 0.0
            y = y if y > 0.0 else 0.0
            total += y if y < h else h
            slope += inside
    return total, slope


@njit(**_exact)
def _project(t, p, hardness, state, active, count, x):
    """p = clip(x + cδ, 0, H), exactly the load, and the states."""
    shift = t.c * t.delta
    left = t.load
    total = 0.0
    one = hardness.size == 1
    h = hardness[0]
    for j in range(count):
        i = active[j]
        if not one:
            h = hardness[i]
        y = x[j] + shift
        if y <= 0.0:
            state[i] = 0
            p[i] = 0.0
        elif y >= h:
            state[i] = 2
            p[i] = h
            left -= h
        else:
            state[i] = 1
            p[i] = y
            total += y
    if total > 0.0 and left > 0.0 and not t.approach_given:
        factor = left / total
        if 0.5 < factor < 2.0:
            for j in range(count):
                i = active[j]
                if state[i] == 1:
                    p[i] = min(p[i] * factor, h if one else hardness[i])


@njit(**_exact)
def _contact_and_energy(t, p, v, gap0, state, active, free):
    """v = Kp + h₁; lists of the points in contact and of the free ones; whether ½⟨p, Kp⟩ + ⟨p, h₁⟩ fell."""
    offset = t.offset
    m = 0
    k = 0
    energy = 0.0
    for i in range(v.size):
        h = gap0[i] - offset
        vi = v[i] + h
        v[i] = vi
        if state[i] != 0:
            active[m] = i
            m += 1
            energy += p[i] * (vi + h)
            if state[i] == 1:
                free[k] = i
                k += 1
    energy *= 0.5
    t.active = m
    t.free = k
    t.fresh = 1
    if t.approach_given:
        total = 0.0
        for j in range(m):
            total += p[active[j]]
        energy -= t.delta * total
    if t.phase == _PROJECTED:
        rose = energy > t.energy + 1e-13 * abs(t.energy)
        t.damping = max(t.damping / 2, 1e-3) if rose else min(1.0, 1.25 * t.damping)
        t.energy = energy


@njit(**_fast)
def _mean_at(v, indices, n):
    s = 0.0
    for k in range(n):
        s += v[indices[k]]
    return s / n


@njit(**_fast)
def _free_residual(t, free, v, r, dense):
    """r = δ − v on the free points, also at its place."""
    total = 0.0
    for k in range(t.free):
        r[k] = t.delta - v[free[k]]
        total += r[k]
    _scatter(t, free, r, total, dense)


@njit(**_fast)
def _scatter(t, free, r, total, dense):
    """Residuals at their place, less their mean where the load is given: it would only cancel, but for rounding."""
    mean = 0.0 if t.approach_given or t.free == 0 else total / t.free
    for k in range(t.free):
        r[k] -= mean
        dense[free[k]] = r[k]


@njit(**_fast)
def _fill(free, n, dense):
    for k in range(n):
        dense[free[k]] = 1.0


@njit(**_fast)
def _clear(free, n, d, dense):
    for k in range(n):
        d[free[k]] = 0.0
        dense[free[k]] = 0.0


@njit(**_fast)
def _add(v, factor, kd):
    """v += factor · Kd."""
    for i in range(v.size):
        v[i] += factor * kd[i]


@njit(**_fast)
def _precondition(t, free, r, w, ones, dense, stencil, rows, columns):
    """w = M r, with Σ w = 0 where the load is given; returns w·r."""
    n = t.free
    total = _stencil_product(free, n, dense, w, stencil, rows, columns)
    rz = 0.0
    if t.approach_given:
        for k in range(n):
            rz += w[k] * r[k]
    else:
        factor = total / t.ones_total
        for k in range(n):
            w[k] -= factor * ones[k]
            rz += w[k] * r[k]
    return rz


@njit(**_fast)
def _stencil_product(free, n, dense, out, stencil, rows, columns):
    """out = stencil ∗ dense at the free points; `rows`, `columns` map padded to real indices, −1 outside.

    Returns Σ out.
    """
    r1 = stencil.shape[0] // 2
    r2 = stencil.shape[1] // 2
    n1 = rows.size - 2 * r1
    n2 = columns.size - 2 * r2
    total = 0.0
    whole = (r1 == 2) & (r2 == 2)
    for k in range(n):
        i = free[k] // n2
        j = free[k] - i * n2
        s = 0.0
        if whole and 2 <= i < n1 - 2 and 2 <= j < n2 - 2:
            base = free[k] - 2 * n2 - 2
            for a in range(5):
                s += (
                    stencil[a, 0] * dense[base]
                    + stencil[a, 1] * dense[base + 1]
                    + stencil[a, 2] * dense[base + 2]
                    + stencil[a, 3] * dense[base + 3]
                    + stencil[a, 4] * dense[base + 4]
                )
                base += n2
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


@njit(**_fast)
def _new_direction(free, n, w, direction, beta, d):
    """d = w + β d on the free points, and at its place."""
    if beta == 0.0:
        for k in range(n):
            direction[k] = w[k]
            d[free[k]] = w[k]
    else:
        for k in range(n):
            direction[k] = w[k] + beta * direction[k]
            d[free[k]] = direction[k]


@njit(**_fast)
def _curvature(free, n, direction, kd, out):
    """d·Kd and d·d over the free points; out = Kd there."""
    s = 0.0
    t = 0.0
    for k in range(n):
        q = kd[free[k]]
        out[k] = q
        s += q * direction[k]
        t += direction[k] * direction[k]
    return s, t


@njit(**_fast)
def _step(t, free, alpha, direction, kd, p, r, dense):
    """p += α d and r −= α Kd on the free points."""
    total = 0.0
    for k in range(t.free):
        p[free[k]] += alpha * direction[k]
        r[k] -= alpha * kd[k]
        total += r[k]
    _scatter(t, free, r, total, dense)


@njit(**_exact)
def prolong(coarse, hardness, p, state):
    """Values of a grid of half the points on the finer one, at most the hardness; state 1 where there is pressure."""
    n1, n2 = p.shape
    one = hardness.size == 1
    for i in range(n1):
        for j in range(n2):
            h = hardness[0, 0] if one else hardness[i, j]
            y = min(coarse[i // 2, j // 2], h)
            p[i, j] = y
            state[i, j] = 1 if y > 0.0 else 0


@njit(**_exact)
def coarsen(a):
    """Means over 2×2 points; an odd last row or column stands for itself."""
    n1, n2 = a.shape
    out = np.empty(((n1 + 1) // 2, (n2 + 1) // 2))
    for i in range(out.shape[0]):
        a1 = min(2 * i + 1, n1 - 1)
        for j in range(out.shape[1]):
            b1 = min(2 * j + 1, n2 - 1)
            out[i, j] = 0.25 * (a[2 * i, 2 * j] + a[a1, 2 * j] + a[2 * i, b1] + a[a1, b1])
    return out


@njit(**_exact)
def gap_and_deformation(p, v, delta, hardness, gap, deformation, plastic):
    """Deformed gap and permanent deformation; contact is exactly closed."""
    one = hardness.size == 1
    h = hardness[0]
    for i in range(p.size):
        g = v[i] - delta
        if not one:
            h = hardness[i]
        gap[i] = 0.0 if p[i] > 0.0 or g < 0.0 else g
        plastic[i] = p[i] >= h
        if plastic[i] and g < 0.0:
            deformation[i] = -g

"""Compiled part of the contact solver: all between two products with K, on flat arrays.

`advance` is a coroutine in all but name. It goes on until it needs a product, says which, and is called again once the
buffers hold it; what it has to remember is a `Progress` record. State of a point: 0 out of contact (p = 0), 1 free
(0 < p < H), 2 plastic (p = H). `hardness` has one value or one per point.

Between two products with the pressure, only points in contact or near it are looked at: their values stand in the
rows of `near_values` in the order of `near`, those of the free ones in `free_values`.
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
#: Sets stay while the points that would leave them have no more than this share of the squared residual, and it halves.
_PROPORTION = 0.1
#: From this iteration on no step may raise the energy. It is seldom needed, and slower.
_MONOTONE_AFTER = 60

Progress = np.dtype(
    [(name, "f8") for name in (
        "load", "delta", "offset", "c", "c0", "c_min", "rtol", "damping", "energy", "residual", "rz", "rz_start",
        "rz_direction", "largest", "ones_total", "margin", "reach")]
    + [(name, "i8") for name in (
        "phase", "approach_given", "near", "free", "changed", "converged", "fresh", "preconditioned", "block", "cg",
        "iteration", "limit", "monotone", "gradient_next")],
    align=True,
)  # fmt: skip

#: Inlined, as functions that are called may be other ones in the process that compiles, which would change last digits.
_exact: dict[str, Any] = {"cache": True, "nogil": True, "forceinline": True}
_fast: dict[str, Any] = {**_exact, "fastmath": {"reassoc", "nsz", "arcp", "contract", "nnan"}}


@njit(**_exact)
def advance(
    gap0, hardness, progress, p, v, d, kd, state, lists, near_values, free_values, stencil, rows, columns, best
):
    """Continue a solution; returns what is needed next.

    p, v : pressure, and K p where asked for, to which the gap is added.
    d, kd : direction and K d; kd may be in v's memory. Between products d holds residuals or ones for the stencil.
        It is always 0 where a point is not free.
    state : of each point. lists : indices of the points near contact, of the free ones, and of these in the first list.
    near_values, free_values : work.
    best : p and v of the lowest energy, once steps are monotone.
    """
    t = progress[0]
    near, free, place = lists[0], lists[1], lists[2]
    x, pn, vn, kn = near_values[0], near_values[1], near_values[2], near_values[3]
    r, w, direction, ones = free_values[0], free_values[1], free_values[2], free_values[3]
    pending = 0.0
    if t.phase == _SEARCHING:
        curvature, length = _curvature(t, near, place, direction, kd, kn)
        if curvature > 0.0:
            pending = t.rz_direction / curvature
            t.largest = min(t.largest, length / curvature)
            _step(t, free, place, pending, direction, kn, pn, r, d)
            t.fresh = 0
            t.block += 1
            t.cg += 1
            t.preconditioned = 0
            if t.block < (_STEPS_AFTER_CHANGE if t.changed else _STEPS):
                t.rz = _precondition(t, free, r, w, ones, d, stencil, rows, columns)
                t.preconditioned = 1
                if t.rz > 0.0 and t.rz >= _DROP * t.rz_start:
                    for j in range(t.near):
                        vn[j] += pending * kn[j]
                    return _search(t, free, w, direction, d)
        else:
            t.cg = 0
            _scatter(t, free, r, 0.0, d)
        t.c = max(t.c_min, min(t.c0, 2.0 * t.damping * t.largest))
    else:
        _full_product(t, p, v, gap0, state, near, free, place, pn, vn)
        if t.iteration >= _MONOTONE_AFTER:
            _search_line(t, p, v, hardness, state, best)
            _list_near(t, p, v, state, near, free, place, pn, vn)
        if t.phase == _PROJECTED:
            if t.changed:
                _fill(free, t.free, d)
                t.ones_total = _stencil_product(free, t.free, d, ones, stencil, rows, columns)
            _free_residual(t, free, place, vn, r, d)
            t.cg = 0
            t.preconditioned = 0
            if t.converged:
                t.c = t.c0  # judged by the residual as it is defined
            if not t.converged and t.free >= 2 and not t.gradient_next:
                needs = _begin_block(t, free, r, w, direction, ones, d, stencil, rows, columns)
                if needs != DONE:
                    return needs
    while True:
        _look(t, p, v, pending, hardness, state, near, free, place, x, pn, vn, kn)
        pending = 0.0
        t.converged = t.residual <= t.rtol
        if (t.converged and t.fresh and _carries_load(t, p)) or t.iteration >= t.limit:
            _clear(free, t.free, d)
            return DONE
        t.iteration += 1
        if t.changed or t.converged or t.phase == _FIRST or t.free < 2 or t.gradient_next:
            _clear(free, t.free, d)
            _project(t, p, hardness, state, near, free, x, pn)
            t.changed += t.phase == _FIRST
            t.phase = _PROJECTED
            return PRESSURE
        needs = _begin_block(t, free, r, w, direction, ones, d, stencil, rows, columns)
        if needs != DONE:
            return needs


@njit(**_exact)
def _carries_load(t, p):
    """A projected pressure does; what a solution starts from may miss the load by as much as the residual."""
    if t.approach_given or t.phase != _FIRST:
        return True
    total = 0.0
    for i in range(p.size):
        total += p[i]
    return abs(total - t.load) <= 1e-10 * t.load


@njit(**_exact)
def _begin_block(t, free, r, w, direction, ones, d, stencil, rows, columns):
    """Direction of a next run of conjugate gradients; DONE if the residual is 0."""
    if not t.preconditioned:
        t.rz = _precondition(t, free, r, w, ones, d, stencil, rows, columns)
    t.rz_start = t.rz
    t.block = 0
    t.largest = t.c0
    if t.rz > 0.0:
        return _search(t, free, w, direction, d)
    # flat on the free points: the sets have to change
    t.c = max(t.c_min, t.damping * t.c0)
    return DONE


@njit(**_exact)
def _search(t, free, w, direction, d):
    """Ask for the product with the next direction."""
    _new_direction(free, t.free, w, direction, t.rz / t.rz_direction if t.cg > 0 else 0.0, d)
    t.rz_direction = t.rz
    t.preconditioned = 0
    t.phase = _SEARCHING
    return DIRECTION


@njit(**_exact)
def _look(t, p, v, pending, hardness, state, near, free, place, x, pn, vn, kn):
    """v += pending · Kd, then δ, the residual and the number of points to change state.

    With y(δ) = clip(p − c(v − δ), 0, H). At the last product with p, points that are not near had v above `reach`. If
    that is still how things are and δ lies beyond, the list is made anew; else the next such product will tell.
    """
    c = t.c
    while True:
        if pending != 0.0:
            for j in range(t.near):
                vn[j] += pending * kn[j]
        for j in range(t.near):
            x[j] = pn[j] - c * vn[j]
        carried = True
        if not t.approach_given:
            t.delta, carried = _root(x, t.near, hardness, near, c, t.load, t.delta)
        if (carried and t.delta <= t.reach) or not t.fresh or t.reach == np.inf:
            break
        t.margin = max(4.0 * t.margin, t.delta - t.reach)
        # also if something is not a number
        t.reach = t.delta + t.margin if carried and t.margin < np.inf else np.inf
        _list_near(t, p, v, state, near, free, place, pn, vn)
    r2 = 0.0
    y2 = 0.0
    c2 = 0.0
    changed = 0
    shift = c * t.delta
    one = hardness.size == 1
    h = hardness[0]
    for j in range(t.near):
        i = near[j]
        if not one:
            h = hardness[i]
        y, s = _clip(x[j] + shift, h)
        e = y - pn[j]
        r2 += e * e
        y2 += y * y
        if s != state[i]:
            changed += 1
            c2 += e * e
    # about that of the step c₀
    residual = np.sqrt(r2 / y2) * (t.c0 / c) if y2 > 0.0 else (0.0 if r2 == 0.0 else np.inf)
    # the sets are worth keeping as long as it helps and the points that would leave them matter little
    t.changed = changed if c2 > _PROPORTION * r2 or residual > 0.5 * t.residual else 0
    t.residual = residual


@njit(**_exact)
def _clip(y, h):
    """y within 0 and h, and the state that says."""
    y = min(max(y, 0.0), h)
    return y, (y > 0.0) + (y >= h)


@njit(**_exact)
def _list_near(t, p, v, state, near, free, place, pn, vn):
    """Points in contact or below `reach`, their pressure and v; the free ones."""
    n = 0
    k = 0
    reach = t.reach
    for i in range(v.size):
        if state[i] != 0 or v[i] < reach:
            near[n] = i
            pn[n] = p[i]
            vn[n] = v[i]
            if state[i] == 1:
                free[k] = i
                place[k] = n
                k += 1
            n += 1
    t.near = n
    t.free = k


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
def _project(t, p, hardness, state, near, free, x, pn):
    """The states, and a pressure within the bounds that is exactly the load.

    Points that stay free keep what conjugate gradients made of them, the others take clip(x + cδ, 0, H).
    """
    shift = t.c * t.delta
    left = t.load
    k = 0
    one = hardness.size == 1
    h = hardness[0]
    for j in range(t.near):
        i = near[j]
        if not one:
            h = hardness[i]
        y, s = _clip(x[j] + shift, h)
        if s == 1:
            if state[i] == 1 and t.phase != _FIRST and not t.gradient_next:
                y = min(max(pn[j], 0.0), h)
            free[k] = i
            x[k] = y
            k += 1
        else:
            left -= y
        p[i] = y
        state[i] = s
    t.free = k
    t.reach = t.delta + t.margin
    if k > 0 and left > 0.0 and not t.approach_given:
        shift = _root(x, k, hardness, free, 1.0, left, 0.0)[0]
        for j in range(k):
            p[free[j]] = min(max(x[j] + shift, 0.0), h if one else hardness[free[j]])


@njit(**_exact)
def _full_product(t, p, v, gap0, state, near, free, place, pn, vn):
    """v = Kp + h₁ everywhere, the lists, and whether ½⟨p, Kp⟩ + ⟨p, h₁⟩ fell."""
    offset = t.offset
    reach = t.reach
    energy = 0.0
    total = 0.0
    n = 0
    k = 0
    for i in range(v.size):
        h = gap0[i] - offset
        vi = v[i] + h
        v[i] = vi
        if state[i] != 0 or vi < reach:
            energy += 0.5 * p[i] * (vi + h)
            total += p[i]
            near[n] = i
            pn[n] = p[i]
            vn[n] = vi
            if state[i] == 1:
                free[k] = i
                place[k] = n
                k += 1
            n += 1
    t.near = n
    t.free = k
    t.fresh = 1
    if t.approach_given:
        energy -= t.delta * total
    if t.phase == _FIRST:
        # so far the list has the points in contact only
        if not t.approach_given:
            t.delta = vn[:n].mean()
        t.margin = 0.5 * total / (max(n, 1) * t.c0)
        t.reach = t.delta + t.margin
        _list_near(t, p, v, state, near, free, place, pn, vn)
    else:
        rose = energy > t.energy + 1e-13 * abs(t.energy)
        t.damping = max(t.damping / 2, 1e-3) if rose else min(1.0, 1.25 * t.damping)
        t.energy = energy


@njit(**_exact)
def _search_line(t, p, v, hardness, state, best):
    """The lowest energy between the best point so far and this one; it is quadratic, and v linear, on the way.

    Where conjugate gradients and projection do not lead down, a projected gradient does: that comes next, with a step
    of Barzilai and Borwein. Source: Birgin, Martínez & Raydan, SIAM J. Optim. 10, 2000, 1196.
    """
    if not t.monotone:
        t.monotone = 1
        for i in range(p.size):
            best[0, i] = p[i]
            best[1, i] = v[i]
        return
    slope = 0.0
    curvature = 0.0
    length = 0.0
    for i in range(p.size):
        step = p[i] - best[0, i]
        slope += step * (best[1, i] - t.delta)
        curvature += step * (v[i] - best[1, i])
        length += step * step
    s = 0.0
    if slope < 0.0:
        s = min(1.0, -slope / curvature) if curvature > 0.0 else 1.0
    h = hardness[0]
    for i in range(p.size):
        if hardness.size > 1:
            h = hardness[i]
        p[i] = best[0, i] + s * (p[i] - best[0, i])
        v[i] = best[1, i] + s * (v[i] - best[1, i])
        best[0, i] = p[i]
        best[1, i] = v[i]
        state[i] = 0 if p[i] <= 0.0 else (2 if p[i] >= h else 1)
    if curvature > 0.0:
        t.c = max(1e-2 * t.c_min, min(t.c0, length / curvature))
    t.gradient_next = not t.gradient_next and s < 0.1
    # the points between the bounds may be others now
    t.changed += 1


@njit(**_fast)
def _free_residual(t, free, place, vn, r, d):
    """r = δ − v on the free points, also at its place."""
    total = 0.0
    for k in range(t.free):
        r[k] = t.delta - vn[place[k]]
        total += r[k]
    _scatter(t, free, r, total, d)


@njit(**_fast)
def _scatter(t, free, r, total, d):
    """Residuals at their place, less their mean where the load is given: it would only cancel, but for rounding."""
    mean = 0.0 if t.approach_given or t.free == 0 else total / t.free
    for k in range(t.free):
        r[k] -= mean
        d[free[k]] = r[k]


@njit(**_fast)
def _fill(free, n, d):
    for k in range(n):
        d[free[k]] = 1.0


@njit(**_fast)
def _clear(free, n, d):
    for k in range(n):
        d[free[k]] = 0.0


@njit(**_fast)
def _precondition(t, free, r, w, ones, d, stencil, rows, columns):
    """w = M r, with Σ w = 0 where the load is given; returns w·r."""
    n = t.free
    total = _stencil_product(free, n, d, w, stencil, rows, columns)
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
    nine = (r1 == 1) & (r2 == 1)
    s00, s01, s02 = stencil[0, 0], stencil[0, r2], stencil[0, -1]
    s10, s11, s12 = stencil[r1, 0], stencil[r1, r2], stencil[r1, -1]
    s20, s21, s22 = stencil[-1, 0], stencil[-1, r2], stencil[-1, -1]
    for k in range(n):
        f = free[k]
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
def _curvature(t, near, place, direction, kd, kn):
    """d·Kd and d·d over the free points; Kd near contact."""
    for j in range(t.near):
        kn[j] = kd[near[j]]
    curvature = 0.0
    length = 0.0
    for k in range(t.free):
        curvature += kn[place[k]] * direction[k]
        length += direction[k] * direction[k]
    return curvature, length


@njit(**_fast)
def _step(t, free, place, alpha, direction, kn, pn, r, d):
    """p += α d and r −= α Kd on the free points."""
    total = 0.0
    for k in range(t.free):
        pn[place[k]] += alpha * direction[k]
        r[k] -= alpha * kn[place[k]]
        total += r[k]
    _scatter(t, free, r, total, d)


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

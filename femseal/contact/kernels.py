"""Compiled loops of the contact solver on flat arrays: lists of points near contact, projection on the law, new sets.

`active_sets` calls them, and those in `gradient_kernels`, between two products with K.

State of a point: 0 out of contact (p = 0), 1 elastic (0 < p < H), 2 perfectly plastic (p = H), 3 yielding on a slope
h > 0 (p = H + h u). Odd ones are free. `hardness` H and `slope` h have one value or one per point, see `law.YieldLine`.
Lists hold a number of points that a kernel returns or is given:

lists : indices of the points near contact, of the free points, and of the free points in the first list.
near : x, p, v = Kp + h₁ and Kd of the points near contact, in the order of their list.
on_free : residual r, preconditioned residual w, direction d and M1 of the free points, in the order of their list; of
    a law that hardens also their compliance a (1/h in state 3, else 0) and the scale s = 1/√(1 + a m), m the largest
    entry of the stencil: a point that yields is softer by a, and the preconditioner is s M s.
dense : on all points of the grid, 0 where a point is not free: first what the stencil is applied to, then d.

`loaded` : whether the load is given; otherwise the approach is.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

#: Every function is inlined: a called one may be compiled differently in another process and change last digits.
EXACT: dict[str, Any] = {"cache": True, "nogil": True, "forceinline": True}
FAST: dict[str, Any] = {**EXACT, "fastmath": {"reassoc", "nsz", "arcp", "contract", "nnan"}}
#: Sets stay while points that would leave them have at most this fraction of the squared residual, and it halves.
_FRACTION = 0.1


@njit(**EXACT)
def add_gap(p, v, gap0, offset, reach, hardness, slope, state, lists, near):
    """v = Kp + h₁ from Kp; lists the points in contact or with v below `reach`.

    Returns the numbers of points near contact and of free points, the energy ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ½ Σ (p − H)²/h where
    points yield on a slope, Σ p, and Σ v on the first list.
    """
    energy = 0.0
    load = 0.0
    total = 0.0
    n = 0
    k = 0
    for i in range(v.size):
        h = gap0[i] - offset
        vi = v[i] + h
        v[i] = vi
        if state[i] != 0 or vi < reach:
            energy += 0.5 * p[i] * (vi + h)
            load += p[i]
            total += vi
            lists[0, n] = i
            near[1, n] = p[i]
            near[2, n] = vi
            if state[i] == 3:
                over = p[i] - hardness[i if hardness.size > 1 else 0]
                energy += 0.5 * over * over / slope[i if slope.size > 1 else 0]
            if state[i] & 1:
                lists[1, k] = i
                lists[2, k] = n
                k += 1
            n += 1
    return n, k, energy, load, total


@njit(**EXACT)
def list_near(p, v, reach, state, lists, near):
    """Lists the points in contact or with v below `reach`; returns how many they are, and how many are free."""
    n = 0
    k = 0
    for i in range(v.size):
        if state[i] != 0 or v[i] < reach:
            lists[0, n] = i
            near[1, n] = p[i]
            near[2, n] = v[i]
            if state[i] & 1:
                lists[1, k] = i
                lists[2, k] = n
                k += 1
            n += 1
    return n, k


@njit(**EXACT)
def look(n, c, load, loaded, delta, hardness, slope, state, lists, near):
    """Approach δ and residual of the complementarity on the points near contact.

    With x = p − c v and y(δ) the projection of x + cδ on the law, δ from Σ y = load. Returns δ, whether these points
    can carry the load, ‖p − y‖/‖p‖, the number of points whose state y changes, and whether they have much of ‖p −
    y‖².
    """
    listed, x, p, v = lists[0], near[0], near[1], near[2]
    for j in range(n):
        x[j] = p[j] - c * v[j]
    carried = True
    if loaded:
        delta, carried = root(x, n, hardness, slope, c, listed, c, load, delta)
    r2 = 0.0
    y2 = 0.0
    c2 = 0.0
    changed = 0
    shift = c * delta
    one = hardness.size + slope.size == 2
    h, t = _line(0, hardness, slope, c)
    for j in range(n):
        i = listed[j]
        if not one:
            h, t = _line(i, hardness, slope, c)
        y, s = _projected(x[j] + shift, h, t)
        e = y - p[j]
        r2 += e * e
        y2 += y * y
        if s != state[i]:
            changed += 1
            c2 += e * e
    residual = np.sqrt(r2 / y2) if y2 > 0.0 else (0.0 if r2 == 0.0 else np.inf)
    return delta, carried, residual, changed, c2 > _FRACTION * r2


@njit(**EXACT)
def _line(i, hardness, slope, c):
    """Hardness of a point, and the fraction t = h/(h + c) by which its pressure follows a trial pressure above it."""
    h = slope[i if slope.size > 1 else 0]
    return hardness[i if hardness.size > 1 else 0], h / (h + c) if h > 0.0 else 0.0


@njit(**EXACT)
def _projected(z, h, t):
    """Projection of a trial pressure on the law, z between 0 and H and above H + t (z − H), and the point's state."""
    y = min(max(z, 0.0), h)
    s = (y > 0.0) + (y >= h)
    if t > 0.0 and s == 2:
        return h + t * (z - h), 3
    return y, s


@njit(**EXACT)
def root(x, n, hardness, slope, kept, listed, c, load, start):
    """Find δ with Σ y(x + cδ) = load on a list of points; returns whether they can carry the load.

    y is the projection on the law with t = h/(h + kept). The sum is monotone and piecewise linear in δ: Newton's method
    within a bracket.
    """
    highest = -np.inf
    full = -np.inf
    capacity = 0.0
    rise = 0.0
    one = hardness.size + slope.size == 2
    h, t = _line(0, hardness, slope, kept)
    for j in range(n):
        if not one:
            h, t = _line(listed[j], hardness, slope, kept)
        highest = max(highest, x[j])
        full = max(full, min(h, load) - x[j])
        capacity += h
        rise += t
    if capacity <= load:
        if rise == 0.0:
            return full / c, capacity >= load
        full += (load - capacity) / rise
    low = -highest / c
    top = full / c
    top += 1e-12 * abs(top)
    d = min(max(start, low), top)
    for _ in range(200):
        total, slopes = _total(x, n, c * d, hardness, slope, kept, listed)
        excess = total - load
        if excess > 0.0:
            top = min(top, d)
        else:
            low = max(low, d)
        if abs(excess) <= 1e-14 * load:
            break
        new = d - excess / (c * slopes) if slopes > 0.0 else low
        if new <= low or new >= top:
            new = 0.5 * (low + top)
        if new == d:
            break
        d = new
    return d, True


@njit(**FAST)
def _total(x, n, shift, hardness, slope, kept, listed):
    """Return Σ y(x + shift) and its derivative, the number of points between the bounds where nothing hardens."""
    total = 0.0
    slopes = 0.0
    if hardness.size == 1 and slope.size == 1 and slope[0] == 0.0:
        h = hardness[0]
        for j in range(n):
            y = x[j] + shift
            inside = 1.0 if (y > 0.0) & (y < h) else 0.0
            y = y if y > 0.0 else 0.0
            total += y if y < h else h
            slopes += inside
    else:
        for j in range(n):
            h, t = _line(listed[j], hardness, slope, kept)
            y = x[j] + shift
            above = 0.0 if y < h else t
            inside = 1.0 if (y > 0.0) & (y < h) else above
            y = y if y > 0.0 else 0.0
            total += y if y < h else h + above * (y - h)
            slopes += inside
    return total, slopes


@njit(**EXACT)
def project(n, free, c, delta, load, loaded, keep, p, hardness, slope, state, lists, near, dense):
    """Give every point near contact the state and value of the projection of x + cδ on the law; the load is then exact.

    keep : points that stay free in their state keep the pressure that conjugate gradients gave them. The load that all
    others leave is put on the free points by a uniform shift within the bounds. Returns the number of free points.
    """
    listed, listed_free, x, pn = lists[0], lists[1], near[0], near[1]
    for k in range(free):
        dense[listed_free[k]] = 0.0
    left = load
    shift = c * delta
    k = 0
    one = hardness.size + slope.size == 2
    h, t = _line(0, hardness, slope, c)
    for j in range(n):
        i = listed[j]
        if not one:
            h, t = _line(i, hardness, slope, c)
        y, s = _projected(x[j] + shift, h, t)
        if s & 1:
            if keep and state[i] == s:
                y = min(max(pn[j], 0.0), h) if s == 1 else max(pn[j], h)
            listed_free[k] = i
            x[k] = y
            k += 1
        else:
            left -= y
        p[i] = y
        state[i] = s
    if k > 0 and left > 0.0 and loaded:
        uniform = root(x, k, hardness, slope, 0.0, listed_free, 1.0, left, 0.0)[0]
        for j in range(k):
            i = listed_free[j]
            if not one:
                h, t = _line(i, hardness, slope, c)
            y = max(x[j] + uniform, 0.0)
            p[i] = min(y, h) if t == 0.0 else y
    return k


@njit(**EXACT)
def gap_and_deformation(p, gap, delta, c, hardness, slope, deformation, plastic):
    """Deformed gap, in place of v, and plastic deformation u = (p − H − c g)/(h + c), −g on a law without slope.

    u is that of the projection of p − c g: where h is large p gives it better, where h is small the raw gap g does.
    """
    for i in range(p.size):
        g = gap[i] - delta
        h = hardness[i if hardness.size > 1 else 0]
        gap[i] = 0.0 if p[i] > 0.0 or g < 0.0 else g
        plastic[i] = p[i] >= h
        if plastic[i]:
            s = slope[i if slope.size > 1 else 0]
            u = -g if s == 0.0 else (p[i] - h - c * g) / (s + c)
            if u > 0.0:
                deformation[i] = u

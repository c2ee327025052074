"""Compiled loops of the contact solver on flat arrays: lists of points near contact, projection on the law, new sets.

`active_sets` calls them, and those in `gradient_kernels`, between two products with K: `add_gap`, `look` and `project`,
which are made of loops over some points of a list, from `first` to `end`. `long_lists` runs these on several threads.

State of a point: 0 out of contact (p = 0), 1 elastic (0 < p < H), 2 perfectly plastic (p = H), 3 yielding on a slope
h > 0 (p = H + h u). Odd ones are free. `hardness` H and `slope` h have one value or one per point, see `law.YieldLine`.
Lists hold a number of points that a kernel returns or is given:

lists : indices of the points near contact, of the free points, and of the free points in the first list.
v : (n1, >= n2), whose rows begin with those of the grid; so does Kd, before it is gathered.
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

from ..base.compiled import compiled, inner
from ..base.threads import YES, ZERO

#: Every function is inlined: a called one may be compiled differently in another process and change last digits.
EXACT: dict[str, Any] = {"forceinline": True}
FAST: dict[str, Any] = {**EXACT, "fastmath": {"reassoc", "nsz", "arcp", "contract", "nnan"}}
#: Most steps of Newton's method for δ.
ROOT_STEPS = 200
#: Sets stay while points that would leave them have at most this fraction of the squared residual, and it halves.
_FRACTION = 0.1


@compiled(**EXACT)
def add_gap(first, end, add, n, k, p, v, gap0, offset, reach, hardness, slope, state, lists, near):
    """v = Kp + h₁ from Kp on some rows of points where `add`; lists those in contact or with v below `reach`.

    They are listed from place n, and the free ones of them from place k. Returns the next places, the energy ½⟨p, Kp⟩ +
    ⟨p, h₁⟩ + ½ Σ (p − H)²/h where points yield on a slope, Σ p, and Σ v of those on the first list.
    """
    weight = 1.0 if add else 0.0
    energy = 0.0
    load = 0.0
    total = 0.0
    columns = p.size // v.shape[0]
    for row in range(first, end):
        start = row * columns
        vs, ps, heights, states = (
            v[row, :columns],
            p[start : start + columns],
            gap0[start : start + columns],
            state[start : start + columns],
        )
        for j in range(columns):
            h = heights[j] - offset
            vj = vs[j] + weight * h
            vs[j] = vj
            if states[j] != 0 or vj < reach:
                energy += 0.5 * ps[j] * (vj + h)
                load += ps[j]
                total += vj
                at = start + j
                lists[0, n] = at
                near[1, n] = ps[j]
                near[2, n] = vj
                if states[j] == 3:
                    over = ps[j] - hardness[at if hardness.size > 1 else 0]
                    energy += 0.5 * over * over / slope[at if slope.size > 1 else 0]
                if states[j] & 1:
                    lists[1, k] = at
                    lists[2, k] = n
                    k += 1
                n += 1
    return n, k, energy, load, total


@compiled(**EXACT)
def count_near(first, end, add, v, gap0, offset, reach, state):
    """Add h₁ to v on some rows where `add`; returns how many points `add_gap` lists, and how many as free."""
    weight = 1.0 if add else 0.0
    n = 0
    k = 0
    columns = gap0.size // v.shape[0]
    for row in range(first, end):
        start = row * columns
        vs, heights, states = v[row, :columns], gap0[start : start + columns], state[start : start + columns]
        for j in range(columns):
            vj = vs[j] + weight * (heights[j] - offset)
            vs[j] = vj
            is_near = (states[j] != 0) | (vj < reach)
            n += is_near
            k += is_near & states[j] & 1
    return n, k


@compiled(**EXACT)
def look(n, c, load, loaded, delta, hardness, slope, state, lists, near):
    """Approach δ and residual of the complementarity on the points near contact.

    With x = p − c v and y(δ) the projection of x + cδ on the law, δ from Σ y = load. Returns δ, whether these points
    can carry the load, ‖p − y‖/‖p‖, the number of points whose state y changes, and whether they have much of ‖p −
    y‖².
    """
    carried = True
    find_trial(ZERO, n, c, near)
    if loaded:
        delta, carried = root(near[0], n, hardness, slope, c, lists[0], c, load, delta)
    return delta, carried, *residual(*compare(ZERO, n, c, delta, hardness, slope, state, lists, near))


@compiled(**EXACT)
def find_trial(first, end, c, near):
    """x = p − c v of some points near contact."""
    x, p, v = near[0, first:end], near[1, first:end], near[2, first:end]
    for j in range(end - first):
        x[j] = p[j] - c * v[j]


@compiled(**EXACT)
def compare(first, end, c, delta, hardness, slope, state, lists, near):
    """‖p − y‖² and ‖y‖² of some points near contact, and the number and ‖p − y‖² of those whose state y changes."""
    listed, x, p = lists[0, first:end], near[0, first:end], near[1, first:end]
    r2 = 0.0
    y2 = 0.0
    changed = 0
    c2 = 0.0
    shift = c * delta
    one = hardness.size + slope.size == 2
    h, t = _line(ZERO, hardness, slope, c)
    for j in range(end - first):
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
    return r2, y2, changed, c2


@compiled(**EXACT)
def residual(r2, y2, changed, c2):
    """The last three values of `look` from the sums of `compare`."""
    relative = np.sqrt(r2 / y2) if y2 > 0.0 else (0.0 if r2 == 0.0 else np.inf)
    return relative, changed, c2 > _FRACTION * r2


@inner(**EXACT)
def _line(i, hardness, slope, c):
    """Hardness of a point, and the fraction t = h/(h + c) by which its pressure follows a trial pressure above it."""
    h = slope[i if slope.size > 1 else 0]
    return hardness[i if hardness.size > 1 else 0], h / (h + c) if h > 0.0 else 0.0


@compiled(**EXACT)
def _projected(z, h, t):
    """Projection of a trial pressure on the law, z between 0 and H and above H + t (z − H), and the point's state."""
    y = min(max(z, 0.0), h)
    s = (y > 0.0) + (y >= h)
    if t > 0.0 and s == 2:
        return h + t * (z - h), 3
    return y, s


@compiled(**EXACT)
def root(x, n, hardness, slope, kept, listed, c, load, start):
    """Find δ with Σ y(x + cδ) = load on a list of points; returns whether they can carry the load.

    y is the projection on the law with t = h/(h + kept). The sum is monotone and piecewise linear in δ: Newton's method
    within a bracket.
    """
    limits = capacity(ZERO, n, x, hardness, slope, kept, listed, load)
    found, carried, d, low, top = bracket(*limits, c, load, start)
    for _ in range(ROOT_STEPS):
        if found:
            break
        total, slopes = carry(ZERO, n, x, c * d, hardness, slope, kept, listed)
        found, d, low, top = refine(total, slopes, c, load, d, low, top)
    return d, carried


@compiled(**EXACT)
def capacity(first, end, x, hardness, slope, kept, listed, load):
    """Of some points: the highest x, the highest min(H, load) − x, Σ H and Σ t."""
    x, listed = x[first:end], listed[first:end]
    highest = -np.inf
    full = -np.inf
    total = 0.0
    rise = 0.0
    one = hardness.size + slope.size == 2
    h, t = _line(ZERO, hardness, slope, kept)
    for j in range(end - first):
        if not one:
            h, t = _line(listed[j], hardness, slope, kept)
        highest = max(highest, x[j])
        full = max(full, min(h, load) - x[j])
        total += h
        rise += t
    return highest, full, total, rise


@compiled(**EXACT)
def bracket(highest, full, capacity, rise, c, load, start):
    """Whether δ is known, whether the points can carry the load, δ or the first guess of it, and its bounds."""
    if capacity <= load:
        if rise == 0.0:
            return True, capacity >= load, full / c, 0.0, 0.0
        full += (load - capacity) / rise
    low = -highest / c
    top = full / c
    top += 1e-12 * abs(top)
    return False, True, min(max(start, low), top), low, top


@compiled(**EXACT)
def refine(total, slopes, c, load, d, low, top):
    """Whether δ is found, and the next one with its bounds."""
    excess = total - load
    if excess > 0.0:
        top = min(top, d)
    else:
        low = max(low, d)
    if abs(excess) <= 1e-14 * load:
        return True, d, low, top
    new = d - excess / (c * slopes) if slopes > 0.0 else low
    if new <= low or new >= top:
        new = 0.5 * (low + top)
    return new == d, new, low, top


@compiled(**FAST)
def carry(first, end, x, shift, hardness, slope, kept, listed):
    """Σ y(x + shift) of some points and its derivative, the number between the bounds where nothing hardens."""
    x, listed = x[first:end], listed[first:end]
    total = 0.0
    slopes = 0.0
    if hardness.size == 1 and slope.size == 1 and slope[0] == 0.0:
        h = hardness[0]
        for j in range(end - first):
            y = x[j] + shift
            inside = 1.0 if (y > 0.0) & (y < h) else 0.0
            y = y if y > 0.0 else 0.0
            total += y if y < h else h
            slopes += inside
    else:
        for j in range(end - first):
            h, t = _line(listed[j], hardness, slope, kept)
            y = x[j] + shift
            above = 0.0 if y < h else t
            inside = 1.0 if (y > 0.0) & (y < h) else above
            y = y if y > 0.0 else 0.0
            total += y if y < h else h + above * (y - h)
            slopes += inside
    return total, slopes


@compiled(**EXACT)
def project(n, free, c, delta, load, loaded, keep, p, hardness, slope, state, lists, near, dense):
    """Give every point near contact the state and value of the projection of x + cδ on the law; the load is then exact.

    keep : points that stay free in their state keep the pressure that conjugate gradients gave them. The load that all
    others leave is put on the free points by a uniform shift within the bounds. Returns the number of free points.
    """
    clear(ZERO, free, lists, dense)
    k, carried = assign(ZERO, n, YES, c, delta, keep, p, hardness, slope, state, lists, near)
    left = load - carried
    if k > 0 and left > 0.0 and loaded:
        uniform = root(near[3], k, hardness, slope, 0.0, lists[1], 1.0, left, 0.0)[0]
        shift(ZERO, k, c, uniform, p, hardness, slope, lists, near)
    return k


@compiled(**EXACT)
def clear(first, end, lists, dense):
    """Take some free points from the grid."""
    for i in lists[1, first:end]:
        dense[i] = 0.0


@compiled(**EXACT)
def assign(first, end, enlist, c, delta, keep, p, hardness, slope, state, lists, near):
    """Pressure and state of some points near contact; returns how many are free, and what the others carry.

    Where `enlist`, the free points are listed from the first place, with their pressures in place of Kd.
    """
    listed, x, pn = lists[0, first:end], near[0, first:end], near[1, first:end]
    carried = 0.0
    k = 0
    one = hardness.size + slope.size == 2
    h, t = _line(ZERO, hardness, slope, c)
    for j in range(end - first):
        i = listed[j]
        if not one:
            h, t = _line(i, hardness, slope, c)
        y, s = _projected(x[j] + c * delta, h, t)
        if s & 1:
            if keep and state[i] == s:
                y = min(max(pn[j], 0.0), h) if s == 1 else max(pn[j], h)
            if enlist:
                lists[1, k] = i
                near[3, k] = y
            k += 1
        else:
            carried += y
        x[j] = y
        p[i] = y
        state[i] = s
    return k, carried


@compiled(**EXACT)
def list_free(first, end, k, state, lists, near):
    """List those of some points near contact that are free from place k, with the pressures that `assign` gave them."""
    listed, x = lists[0, first:end], near[0, first:end]
    for j in range(end - first):
        i = listed[j]
        if state[i] & 1:
            lists[1, k] = i
            near[3, k] = x[j]
            k += 1


@compiled(**EXACT)
def shift(first, end, c, uniform, p, hardness, slope, lists, near):
    """Add a uniform pressure to some free points, within the bounds."""
    one = hardness.size + slope.size == 2
    h, t = _line(ZERO, hardness, slope, c)
    listed, x = lists[1, first:end], near[3, first:end]
    for k in range(end - first):
        i = listed[k]
        if not one:
            h, t = _line(i, hardness, slope, c)
        y = max(x[k] + uniform, 0.0)
        p[i] = min(y, h) if t == 0.0 else y


@compiled(**EXACT)
def gap_and_deformation(first, end, p, v, delta, c, hardness, slope, gap, deformation, plastic):
    """Deformed gap on some rows of points, and plastic deformation u.

    u = (p − H − c g)/(h + c), on a law without slope −g, is that of the projection of p − c g: where h is large p gives
    it better, where h is small the raw gap g does.
    """
    columns = p.size // v.shape[0]
    for row in range(first, end):
        for j in range(columns):
            i = row * columns + j
            g = v[row, j] - delta
            h = hardness[i if hardness.size > 1 else 0]
            gap[i] = 0.0 if p[i] > 0.0 or g < 0.0 else g
            plastic[i] = p[i] >= h
            deformation[i] = 0.0
            if plastic[i]:
                s = slope[i if slope.size > 1 else 0]
                u = -g if s == 0.0 else (p[i] - h - c * g) / (s + c)
                if u > 0.0:
                    deformation[i] = u

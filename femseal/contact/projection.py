"""Compiled loops of the contact solver: which points are near contact, and their projection on the law.

`list_near`, `look` and `project` are what `active_sets` calls between two products with K: arrays first, then what
changes from call to call. They are made of loops over some points of a list, from `first` to `end`. On small grids each
is compiled as a whole; on large ones Python calls their loops, of which threads share the parts.

State of a point: 0 out of contact (p = 0), 1 elastic (0 < p < H), 2 perfectly plastic (p = H), 3 yielding on a slope
h > 0 (p = H + h u). Points of odd state are free: their pressure is unknown.

Arrays that several loops share
-------------------------------
p, v, state : pressure [Pa], Kp + h₁ [m] and state of every point of the grid. v has rows that are at least as long as
    those of the grid.
near : indices of the points near contact; near_p, near_v, trial : their p, v and x = p − c v.
free : indices of the free points; place : where these are in the list `near`.
hardness, slope : H [Pa] and h [Pa/m] of the law, one value for all points or one for each.
"""

from typing import Any

import numpy as np

from ..base.compiled import by_items, compiled, leader, number, over, parts, summed

#: Every function is inlined: a called one may be compiled differently in another process and change last digits.
_EXACT: dict[str, Any] = {"forceinline": True}
_FAST: dict[str, Any] = {
    "forceinline": True,
    "fastmath": {"reassoc", "nsz", "arcp", "contract", "nnan"},
}
exact, fast = compiled(**_EXACT), compiled(**_FAST)
#: Loops over some points of a list, whose values are summed.
exact_loop, fast_loop = by_items(summed, **_EXACT), by_items(summed, **_FAST)
#: Functions that are made of loops.
exact_leader, fast_leader = leader(**_EXACT), leader(**_FAST)
#: Points of a grid of which one loop makes lists, before they are joined.
PART = 2**19
#: Most steps of Newton's method for δ.
ROOT_STEPS = 200


@exact
def list_near(
    gap0, offset, hardness, slope, p, v, state, near, near_p, near_v, free, place,
    factor, weight, reach, first, end,
):  # fmt: skip
    """Set v to factor · v + weight · (h₁ − offset) on some rows, and list points in contact or with v below `reach`.

    Returns the number of these points and of the free ones, the energy ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ½ Σ (p − H)²/h where
    points yield on a slope, Σ p, and the sum of v over the listed points.
    """
    energy = 0.0
    load = 0.0
    total = 0.0
    columns = p.size // v.shape[0]
    n_near = 0
    n_free = 0
    for row in range(first, end):
        start = row * columns
        row_v = v[row, :columns]
        row_p = p[start : start + columns]
        heights = gap0[start : start + columns]
        states = state[start : start + columns]
        for j in range(columns):
            h = heights[j] - offset
            vj = factor * row_v[j] + weight * h
            row_v[j] = vj
            if states[j] != 0 or vj < reach:
                energy += 0.5 * row_p[j] * (vj + h)
                load += row_p[j]
                total += vj
                i = start + j
                near[n_near] = i
                near_p[n_near] = row_p[j]
                near_v[n_near] = vj
                if states[j] == 3:
                    beyond = row_p[j] - value_at(hardness, i)
                    energy += 0.5 * beyond * beyond / value_at(slope, i)
                if states[j] & 1:
                    free[n_free] = i
                    place[n_free] = n_near
                    n_free += 1
                n_near += 1
    return n_near, n_free, energy, load, total


def list_near_in_parts(*arguments):
    """Do what `list_near` does. Threads share the parts, some at a time, so that their lists take little memory."""
    *given, near, near_p, near_v, free, place, factor, weight, reach, _, end = arguments
    columns = given[0].size // end
    pieces = parts(end, PART / columns)
    together = 2 * number()
    size = columns * max(last - row for row, last in pieces)
    lists = [
        (np.empty(size, np.int32), *np.empty((2, size)), *np.empty((2, size), np.int32))
        for _ in pieces[:together]
    ]

    def listed(piece, own_lists):
        return list_near(*given, *own_lists, factor, weight, reach, *piece)

    sums = []
    n_near = n_free = 0
    for start in range(0, len(pieces), together):
        some = list(zip(pieces[start : start + together], lists, strict=False))
        for (k, m, *values), (_, own_lists) in zip(over(some, listed), some, strict=True):
            for whole, part in zip((near, near_p, near_v), own_lists[:3], strict=True):
                whole[n_near : n_near + k] = part[:k]
            free[n_free : n_free + m] = own_lists[3][:m]
            place[n_free : n_free + m] = own_lists[4][:m] + n_near
            n_near, n_free = n_near + k, n_free + m
            sums.append(tuple(values))
    return n_near, n_free, *summed(sums)


@exact_leader
def look(hardness, slope, state, near, near_p, near_v, trial, load, n_near, c, delta):
    """Find the approach δ that carries the load, and how far the pressure is from its projection on the law.

    y(δ) is the projection of x + cδ, x = p − c v, and δ follows from Σ y = load. Returns δ, whether the points near
    contact can carry the load, and what `compare` does.
    """
    find_trial(n_near, c, near_p, near_v, trial)
    delta, carried = root(trial, n_near, hardness, slope, c, near, c, load, delta)
    return delta, carried, *compare(n_near, c, delta, hardness, slope, state, near, near_p, trial)


@exact_loop
def find_trial(first, end, c, near_p, near_v, trial):
    """x = p − c v of some points near contact."""
    for j in range(first, end):
        trial[j] = near_p[j] - c * near_v[j]


@exact_loop
def compare(first, end, c, delta, hardness, slope, state, near, near_p, trial):
    """‖p − y‖² and ‖y‖² of some points near contact, and the number and ‖p − y‖² of those whose state y changes."""
    listed = near[first:end]
    x = trial[first:end]
    p = near_p[first:end]
    r2 = 0.0
    y2 = 0.0
    changed = 0
    changed2 = 0.0
    shift = c * delta
    is_uniform = hardness.size + slope.size == 2
    h, t = law_at(0, hardness, slope, c)
    for j in range(end - first):
        i = listed[j]
        if not is_uniform:
            h, t = law_at(i, hardness, slope, c)
        y, s = projected(x[j] + shift, h, t)
        e = y - p[j]
        r2 += e * e
        y2 += y * y
        if s != state[i]:
            changed += 1
            changed2 += e * e
    return r2, y2, changed, changed2


@exact
def value_at(values, i):
    """Value of a point, of one each or one for all."""
    return values[i if values.size > 1 else 0]


@exact
def law_at(i, hardness, slope, c):
    """Hardness of a point, and the fraction t = h/(h + c) by which its pressure follows a trial pressure above it."""
    h = value_at(slope, i)
    return value_at(hardness, i), h / (h + c) if h > 0.0 else 0.0


@exact
def projected(z, h, t):
    """Projection of a trial pressure on the law, z between 0 and H and above H + t (z − H), and the point's state."""
    y = min(max(z, 0.0), h)
    s = (y > 0.0) + (y >= h)
    if t > 0.0 and s == 2:
        return h + t * (z - h), 3
    return y, s


@exact_leader
def root(x, n, hardness, slope, kept, listed, c, load, start):
    """Find δ with Σ y(x + cδ) = load on a list of points; returns whether they can carry the load.

    y is the projection on the law with t = h/(h + kept). The sum is monotone and piecewise linear in δ: Newton's method
    within a bracket.
    """
    sums = capacity(n, x, hardness, slope, kept, listed, load)
    delta, low, top, carried = bracket(*sums, c, load, start)
    for _ in range(ROOT_STEPS):
        if low == top:
            break
        total, slopes = carry(n, x, c * delta, hardness, slope, kept, listed)
        delta, low, top = refine(delta, low, top, total, slopes, c, load)
    return delta, carried


def _bounds(values: list[Any]) -> Any:
    """Of the values of `capacity` the largest first two, and sums."""
    highest, full, total, rise = zip(*values, strict=True)
    return max(highest), max(full), sum(total), sum(rise)


@by_items(_bounds, **_EXACT)
def capacity(first, end, x, hardness, slope, kept, listed, load):
    """Of some points: the highest x, the highest min(H, load) − x, Σ H and Σ t."""
    x, listed = x[first:end], listed[first:end]
    highest = -np.inf
    full = -np.inf
    total = 0.0
    rise = 0.0
    is_uniform = hardness.size + slope.size == 2
    h, t = law_at(0, hardness, slope, kept)
    for j in range(end - first):
        if not is_uniform:
            h, t = law_at(listed[j], hardness, slope, kept)
        highest = max(highest, x[j])
        full = max(full, min(h, load) - x[j])
        total += h
        rise += t
    return highest, full, total, rise


@exact
def bracket(highest, full, capacity, rise, c, load, start):
    """δ to begin with, bounds of δ, which are the same where it is found, and whether the points can carry the load."""
    if capacity <= load:
        if rise == 0.0:
            return full / c, full / c, full / c, capacity >= load
        full += (load - capacity) / rise
    low = -highest / c
    top = full / c
    top += 1e-12 * abs(top)
    return min(max(start, low), top), low, top, True


@exact
def refine(delta, low, top, total, slopes, c, load):
    """The next δ and its bounds, from the sums of `carry`."""
    excess = total - load
    if abs(excess) <= 1e-14 * load:
        return delta, delta, delta
    if excess > 0.0:
        top = min(top, delta)
    else:
        low = max(low, delta)
    new = delta - excess / (c * slopes) if slopes > 0.0 else low
    if new <= low or new >= top:
        new = 0.5 * (low + top)
    if new == delta:
        return delta, delta, delta
    return new, low, top


@fast_loop
def carry(first, end, x, shift, hardness, slope, kept, listed):
    """Σ y(x + shift) of some points and its derivative, the number between the bounds where nothing hardens."""
    x, listed = x[first:end], listed[first:end]
    total = 0.0
    slopes = 0.0
    h, t = law_at(0, hardness, slope, kept)
    if hardness.size + slope.size == 2 and t == 0.0:  # a loop that vector instructions carry out
        for j in range(end - first):
            y = x[j] + shift
            inside = 1.0 if (y > 0.0) & (y < h) else 0.0
            y = y if y > 0.0 else 0.0
            total += y if y < h else h
            slopes += inside
        return total, slopes
    for j in range(end - first):
        h, t = law_at(listed[j], hardness, slope, kept)
        y = x[j] + shift
        above = 0.0 if y < h else t
        inside = 1.0 if (y > 0.0) & (y < h) else above
        y = y if y > 0.0 else 0.0
        total += y if y < h else h + above * (y - h)
        slopes += inside
    return total, slopes


@exact_leader
def project(
    hardness, slope, p, state, dense, near, near_p, trial, free, response, load,
    n_near, n_free, c, delta, keep,
):  # fmt: skip
    """Give every point near contact the state and value of the projection of x + cδ on the law; the load is then exact.

    keep : points that stay free in their state keep the pressure that conjugate gradients gave them. What all others
    leave of the load is put on the free points by a uniform shift within the bounds. The memory of `response` holds
    pressures of the free points meanwhile. Returns the number of free points.
    """
    clear(n_free, free, dense)
    n_free, carried = assign(n_near, c, delta, keep, hardness, slope, p, state, near, near_p, trial)
    list_free(n_near, state, near, trial, free, response)
    left = load - carried
    if n_free > 0 and left > 0.0:
        uniform = root(response, n_free, hardness, slope, 0.0, free, 1.0, left, 0.0)[0]
        shift(n_free, c, uniform, hardness, slope, p, free, response)
    return n_free


@exact_loop
def clear(first, end, free, dense):
    """Take some free points from the field of the stencil and of directions."""
    for i in free[first:end]:
        dense[i] = 0.0


@exact_loop
def assign(first, end, c, delta, keep, hardness, slope, p, state, near, near_p, trial):
    """Pressure and state of some points near contact; returns how many are free, and what the others carry."""
    listed = near[first:end]
    x = trial[first:end]
    former = near_p[first:end]
    carried = 0.0
    n_free = 0
    for j in range(end - first):
        i = listed[j]
        h, t = law_at(i, hardness, slope, c)
        y, s = projected(x[j] + c * delta, h, t)
        if s & 1:
            if keep and state[i] == s:
                y = min(max(former[j], 0.0), h) if s == 1 else max(former[j], h)
            n_free += 1
        else:
            carried += y
        x[j] = y
        p[i] = y
        state[i] = s
    return n_free, carried


@exact
def list_free(n_near, state, near, trial, free, pressure):
    """List those of the points near contact that are free, with the pressures that `assign` gave them."""
    k = 0
    for j in range(n_near):
        i = near[j]
        if state[i] & 1:
            free[k] = i
            pressure[k] = trial[j]
            k += 1


@exact_loop
def shift(first, end, c, uniform, hardness, slope, p, free, pressure):
    """Add a uniform pressure to some free points, within the bounds."""
    for k in range(first, end):
        i = free[k]
        h, t = law_at(i, hardness, slope, c)
        y = max(pressure[k] + uniform, 0.0)
        p[i] = min(y, h) if t == 0.0 else y


@exact
def gap_and_deformation(first, end, p, v, delta, c, hardness, slope, gap, deformation, plastic):
    """Write the deformed gap on some rows of points, their plastic deformation u and whether they are plastic.

    u = (p − H − c g)/(h + c), on a law without slope −g, is that of the projection of p − c g: where h is large p gives
    it better, where h is small the raw gap g does.
    """
    columns = p.size // v.shape[0]
    for row in range(first, end):
        for j in range(columns):
            i = row * columns + j
            g = v[row, j] - delta
            h = value_at(hardness, i)
            gap[i] = 0.0 if p[i] > 0.0 or g < 0.0 else g
            plastic[i] = p[i] >= h
            deformation[i] = 0.0
            if plastic[i]:
                s = value_at(slope, i)
                u = -g if s == 0.0 else (p[i] - h - c * g) / (s + c)
                if u > 0.0:
                    deformation[i] = u

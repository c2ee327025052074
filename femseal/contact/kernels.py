"""Compiled loops of the contact solver on flat arrays: lists of points near contact, projection on the law, new sets.

`active_sets` calls them, and those in `gradient_kernels`, between two products with K: `add_gap`, `look` and `project`,
which are made of loops over some points of a list, from `first` to `end`. On small grids these functions are compiled
as a whole; on large ones Python calls their loops, of which threads share the parts.

`add_gap`, `look` and `project` take `Line` and `Points` as plain tuples, as numba needs 2 µs more for named ones.

State of a point: 0 out of contact (p = 0), 1 elastic (0 < p < H), 2 perfectly plastic (p = H), 3 yielding on a slope
h > 0 (p = H + h u). Odd ones are free. Lists hold a number of points that a kernel returns or is given.

Kd : (n1, >= n2), whose rows begin with those of the grid, before it is gathered.
`loaded` : whether the load is given; otherwise the approach is.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Indices
from ..base.compiled import by_items, compiled, leader, number, over, parts, summed

#: Rows of `Points.lists`: indices of the points near contact, of the free ones, and of these in the first list.
NEAR, FREE, PLACE = range(3)
#: Rows of `Points.near`: x = p − c v, p, v = Kp + h₁ and Kd of the points near contact, in the order of their list.
X, P, V, KD = range(4)
#: Rows of `Points.on_free`: residual r, preconditioned residual w, direction d and M1 of the free points, in the order
#: of their list; their compliance a (1/h in state 3, else 0) and scale s = 1/√(1 + a m), m the largest entry of the
#: stencil: a point that yields on a slope is softer by a, and the preconditioner is s M s.
R, W, D, ONES, SOFT, SCALE = range(6)


class Points(NamedTuple):
    """Pressure and state (n,) of the points of a grid, lists (3, n) of some, and what belongs to these: near (4, n),
    on_free (6, n).

    v : Kp + h₁ (n1, >= n2), whose rows begin with those of the grid. dense : on all points of the grid, 0 where a point
    is not free: first what the stencil is applied to, then d.
    """

    p: Array
    v: Array
    state: NDArray[np.int8]
    lists: NDArray[np.int32]
    near: Array
    on_free: Array
    dense: NDArray[np.float32]


class Line(NamedTuple):
    """Hardness H and slope h, of one value or one per point, see `law.YieldLine`."""

    hardness: Array
    slope: Array


class Stencil(NamedTuple):
    """Weights of a stencil of 3 × 3 points or fewer; index of each row and column of the padded grid, −1 outside."""

    weights: Array
    rows: Indices
    columns: Indices


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
def add_gap(first, end, add, gap0, offset, reach, line, points):
    """v = Kp + h₁ from Kp on some rows of points where `add`; lists those in contact or with v below `reach`.

    Returns the number of these and of the free ones of them, the energy ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ½ Σ (p − H)²/h where
    points yield on a slope, Σ p, and Σ v of those on the first list.
    """
    line, points = Line(*line), Points(*points)
    weight = 1.0 if add else 0.0
    energy = 0.0
    load = 0.0
    total = 0.0
    p, v = points.p, points.v
    columns = p.size // v.shape[0]
    n = k = 0
    for row in range(first, end):
        start = row * columns
        vs = v[row, :columns]
        ps = p[start : start + columns]
        heights = gap0[start : start + columns]
        states = points.state[start : start + columns]
        for j in range(columns):
            h = heights[j] - offset
            vj = vs[j] + weight * h
            vs[j] = vj
            if states[j] != 0 or vj < reach:
                energy += 0.5 * ps[j] * (vj + h)
                load += ps[j]
                total += vj
                at = start + j
                points.lists[NEAR, n] = at
                points.near[P, n] = ps[j]
                points.near[V, n] = vj
                if states[j] == 3:
                    over = ps[j] - own(line.hardness, at)
                    energy += 0.5 * over * over / own(line.slope, at)
                if states[j] & 1:
                    points.lists[FREE, k] = at
                    points.lists[PLACE, k] = n
                    k += 1
                n += 1
    return n, k, energy, load, total


def add_gap_in_parts(first, end, *arguments):
    """`add_gap` of which threads share the parts, some at a time, so that the lists of parts take little memory."""
    *others, points = *arguments[:-1], Points(*arguments[-1])
    columns = points.p.size // end
    pieces = parts(end, PART / columns)
    together = 2 * number()
    size = columns * max(last - row for row, last in pieces)
    own = [
        points._replace(lists=np.empty((3, size), np.int32), near=np.empty((4, size)))
        for _ in pieces[:together]
    ]

    def listed(piece, found):
        return add_gap(*piece, *others, tuple(found))

    sums = []
    n = k = 0
    for start in range(0, len(pieces), together):
        some = list(zip(pieces[start : start + together], own, strict=False))
        for (near, free, *values), (_, found) in zip(over(some, listed), some, strict=True):
            points.lists[NEAR, n : n + near] = found.lists[NEAR, :near]
            points.near[P : V + 1, n : n + near] = found.near[P : V + 1, :near]
            points.lists[FREE, k : k + free] = found.lists[FREE, :free]
            points.lists[PLACE, k : k + free] = found.lists[PLACE, :free] + n
            n, k = n + near, k + free
            sums.append(tuple(values))
    return n, k, *summed(sums)


@exact_leader
def look(n, c, load, loaded, delta, line, points):
    """Approach δ and residual of the complementarity on the points near contact.

    With x = p − c v and y(δ) the projection of x + cδ on the law, δ from Σ y = load. Returns δ, whether these points
    can carry the load, and what `compare` does.
    """
    line, points = Line(*line), Points(*points)
    carried = True
    find_trial(n, c, points)
    if loaded:
        delta, carried = root(points.near[X], n, line, c, points.lists[NEAR], c, load, delta)
    return delta, carried, *compare(n, c, delta, line, points)


@exact_loop
def find_trial(first, end, c, points):
    """x = p − c v of some points near contact."""
    x = points.near[X, first:end]
    p = points.near[P, first:end]
    v = points.near[V, first:end]
    for j in range(end - first):
        x[j] = p[j] - c * v[j]


@exact_loop
def compare(first, end, c, delta, line, points):
    """‖p − y‖² and ‖y‖² of some points near contact, and the number and ‖p − y‖² of those whose state y changes."""
    listed = points.lists[NEAR, first:end]
    x = points.near[X, first:end]
    p = points.near[P, first:end]
    r2 = 0.0
    y2 = 0.0
    changed = 0
    c2 = 0.0
    shift = c * delta
    for j in range(end - first):
        i = listed[j]
        h, t = _line(i, line, c)
        y, s = _projected(x[j] + shift, h, t)
        e = y - p[j]
        r2 += e * e
        y2 += y * y
        if s != points.state[i]:
            changed += 1
            c2 += e * e
    return r2, y2, changed, c2


@exact
def own(values, i):
    """Value of a point, of one each or one for all."""
    return values[i if values.size > 1 else 0]


@exact
def _line(i, line, c):
    """Hardness of a point, and the fraction t = h/(h + c) by which its pressure follows a trial pressure above it."""
    h = own(line.slope, i)
    return own(line.hardness, i), h / (h + c) if h > 0.0 else 0.0


@exact
def _projected(z, h, t):
    """Projection of a trial pressure on the law, z between 0 and H and above H + t (z − H), and the point's state."""
    y = min(max(z, 0.0), h)
    s = (y > 0.0) + (y >= h)
    if t > 0.0 and s == 2:
        return h + t * (z - h), 3
    return y, s


@exact_leader
def root(x, n, line, kept, listed, c, load, start):
    """Find δ with Σ y(x + cδ) = load on a list of points; returns whether they can carry the load.

    y is the projection on the law with t = h/(h + kept). The sum is monotone and piecewise linear in δ: Newton's method
    within a bracket.
    """
    delta, low, top, carried = bracket(*capacity(n, x, line, kept, listed, load), c, load, start)
    for _ in range(ROOT_STEPS):
        if low == top:
            break
        sums = carry(n, x, c * delta, line, kept, listed)
        delta, low, top = refine(delta, low, top, *sums, c, load)
    return delta, carried


def _bounds(values: list[Any]) -> Any:
    """Of the values of `capacity` the largest first two, and sums."""
    highest, full, total, rise = zip(*values, strict=True)
    return max(highest), max(full), sum(total), sum(rise)


@by_items(_bounds, **_EXACT)
def capacity(first, end, x, line, kept, listed, load):
    """Of some points: the highest x, the highest min(H, load) − x, Σ H and Σ t."""
    x, listed = x[first:end], listed[first:end]
    highest = -np.inf
    full = -np.inf
    total = 0.0
    rise = 0.0
    for j in range(end - first):
        h, t = _line(listed[j], line, kept)
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
def carry(first, end, x, shift, line, kept, listed):
    """Σ y(x + shift) of some points and its derivative, the number between the bounds where nothing hardens."""
    x, listed = x[first:end], listed[first:end]
    total = 0.0
    slopes = 0.0
    for j in range(end - first):
        h, t = _line(listed[j], line, kept)
        y = x[j] + shift
        above = 0.0 if y < h else t
        inside = 1.0 if (y > 0.0) & (y < h) else above
        y = y if y > 0.0 else 0.0
        total += y if y < h else h + above * (y - h)
        slopes += inside
    return total, slopes


@exact_leader
def project(n, free, c, delta, load, keep, line, points):
    """Give every point near contact the state and value of the projection of x + cδ on the law; the load is then exact.

    keep : points that stay free in their state keep the pressure that conjugate gradients gave them. load : 0 where the
    approach is given; what all others leave of it is put on the free points by a uniform shift within the bounds.
    Returns the number of free points.
    """
    line, points = Line(*line), Points(*points)
    clear(free, points)
    k, carried = assign(n, c, delta, keep, line, points)
    list_free(n, points)
    left = load - carried
    if k > 0 and left > 0.0:
        uniform = root(points.near[KD], k, line, 0.0, points.lists[FREE], 1.0, left, 0.0)[0]
        shift(k, c, uniform, line, points)
    return k


@exact_loop
def clear(first, end, points):
    """Take some free points from the grid."""
    for i in points.lists[FREE, first:end]:
        points.dense[i] = 0.0


@exact_loop
def assign(first, end, c, delta, keep, line, points):
    """Pressure and state of some points near contact; returns how many are free, and what the others carry."""
    listed = points.lists[NEAR, first:end]
    x = points.near[X, first:end]
    pn = points.near[P, first:end]
    carried = 0.0
    k = 0
    for j in range(end - first):
        i = listed[j]
        h, t = _line(i, line, c)
        y, s = _projected(x[j] + c * delta, h, t)
        if s & 1:
            if keep and points.state[i] == s:
                y = min(max(pn[j], 0.0), h) if s == 1 else max(pn[j], h)
            k += 1
        else:
            carried += y
        x[j] = y
        points.p[i] = y
        points.state[i] = s
    return k, carried


@exact
def list_free(n, points):
    """List those of the points near contact that are free, with the pressures that `assign` gave them."""
    k = 0
    for j in range(n):
        i = points.lists[NEAR, j]
        if points.state[i] & 1:
            points.lists[FREE, k] = i
            points.near[KD, k] = points.near[X, j]
            k += 1


@exact_loop
def shift(first, end, c, uniform, line, points):
    """Add a uniform pressure to some free points, within the bounds."""
    listed = points.lists[FREE, first:end]
    x = points.near[KD, first:end]
    for k in range(end - first):
        i = listed[k]
        h, t = _line(i, line, c)
        y = max(x[k] + uniform, 0.0)
        points.p[i] = min(y, h) if t == 0.0 else y


@exact
def gap_and_deformation(first, end, p, v, delta, c, line, found):
    """Write the deformed gap on some rows of points, their plastic deformation u and whether they are plastic.

    u = (p − H − c g)/(h + c), on a law without slope −g, is that of the projection of p − c g: where h is large p gives
    it better, where h is small the raw gap g does.
    """
    gap, deformation, plastic = found
    columns = p.size // v.shape[0]
    for row in range(first, end):
        for j in range(columns):
            i = row * columns + j
            g = v[row, j] - delta
            h = own(line.hardness, i)
            gap[i] = 0.0 if p[i] > 0.0 or g < 0.0 else g
            plastic[i] = p[i] >= h
            deformation[i] = 0.0
            if plastic[i]:
                s = own(line.slope, i)
                u = -g if s == 0.0 else (p[i] - h - c * g) / (s + c)
                if u > 0.0:
                    deformation[i] = u

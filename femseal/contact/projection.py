"""Compile the loops of the contact solver that list points near contact and project pressures on the contact law.

`active_sets` calls `list_near`, `evaluate` and `project` between two products with the compliance K of the half-space.
These three functions take groups of arrays first, see `point_arrays`, and then the values that change from call to
call. A loop processes the points `first` to `end` − 1 of a list. For small grids, `list_near`, `evaluate` and `project`
are each compiled as a single function. For large grids, the three functions run in Python and call compiled loops, and
several threads share the work of each loop.
"""

from typing import Any

import numpy as np

from ..base.compiled import by_items, compiled, leader, over, parts, summed, thread_count
from .point_arrays import FreePoints, NearPoints

#: All functions are inlined. A function that is called may be compiled differently in another process, which would
#: change the last digits of results.
_EXACT: dict[str, Any] = {"forceinline": True}
_FAST: dict[str, Any] = {
    "forceinline": True,
    "fastmath": {"reassoc", "nsz", "arcp", "contract", "nnan"},
}
exact, fast = compiled(**_EXACT), compiled(**_FAST)
#: Decorators of loops over a part of a list; the returned values of all parts are added up.
exact_loop, fast_loop = by_items(summed, **_EXACT), by_items(summed, **_FAST)
#: Decorators of functions that consist of such loops.
exact_leader, fast_leader = leader(**_EXACT), leader(**_FAST)
#: Approximate number of grid points from which one thread makes a list at a time.
PART = 2**19
#: Largest number of steps of Newton's method for δ.
ROOT_STEPS = 200


@exact
def list_near(
    gap0, offset, law, points, near, free, values, stores, factor, weight, reach, first, end
):  # fmt: skip
    """Compute v = factor · values + weight · (h₁ − offset), and list the points near contact in some rows.

    A point is near contact if it is in contact or if v is below the threshold `reach`. The free points are listed, too.

    Parameters
    ----------
    gap0 : array (n,)
        Undeformed gap h₁ [m].
    offset : float
        Height [m] that is subtracted from h₁.
    law, points, near, free
        Groups of arrays, see `point_arrays`.
    values : array (n1, >= n2)
        Displacement or v of all points: `points.v` or, in single precision, `points.kd`.
    stores : bool
        Whether to replace `values` by v.
    factor, weight : float
        Factors of `values` and of h₁ − offset. If `values` is the displacement of a half-space of unit modulus,
        `factor` is 1/E* and `weight` is 1. If `values` is already v and only a new list is needed, `factor` is 1 and
        `weight` is 0.
    reach : float
        Threshold of v [m].
    first, end : int
        Range of the rows.

    Returns
    -------
    n_near : number of points near contact.
    n_free : number of free points.
    energy : energy ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ½ Σ (p − H)²/h. The sum Σ includes only the points that harden.
    load : sum of p.
    total : sum of v over the points near contact.
    """
    energy = 0.0
    load = 0.0
    total = 0.0
    columns = points.p.size // values.shape[0]  # rows of `values` may be longer
    # reading the members of a group within a loop takes time
    all_p, all_states, dense = points.p, points.state, points.dense
    near_index, near_p, near_v = near.index, near.p, near.v
    free_index, free_place = free.index, free.place
    n_near = 0
    n_free = 0
    for row in range(first, end):
        start = row * columns
        row_values = values[row, :columns]
        p = all_p[start : start + columns]
        state = all_states[start : start + columns]
        heights = gap0[start : start + columns]
        for j in range(columns):
            h = heights[j] - offset
            vj = factor * row_values[j] + weight * h
            if stores:
                row_values[j] = vj
            if state[j] != 0 or vj < reach:
                energy += 0.5 * p[j] * (vj + h)  # ½⟨p, Kp⟩ + ⟨p, h₁⟩ = ½⟨p, v + h₁⟩
                load += p[j]
                total += vj
                i = start + j
                near_index[n_near] = i
                near_p[n_near] = p[j]
                near_v[n_near] = vj
                if state[j] == 3:
                    # the point yields and hardens: its energy contains the term ψ = ½ (p − H)²/h
                    above_hardness = p[j] - value_at(law.hardness, i)
                    energy += 0.5 * above_hardness * above_hardness / value_at(law.slope, i)
                if state[j] & 1:  # odd states are free: 1 is elastic, 3 hardens
                    free_index[n_free] = i
                    free_place[n_free] = n_near
                    n_free += 1
                else:
                    dense[i] = 0.0  # a product in single precision has written the pressure there
                n_near += 1
    return n_near, n_free, energy, load, total


def _empty_lists(size: int) -> tuple[NearPoints, FreePoints]:
    """Make the lists that `list_near` fills, for at most `size` points; the arrays it does not use are empty."""
    unused = np.empty(0)
    p, v = np.empty((2, size))
    near = NearPoints(np.empty(size, np.int32), p, v, trial=unused, response=unused)
    index, place = np.empty((2, size), np.int32)
    return near, FreePoints(index, place)


def list_near_in_parts(
    gap0, offset, law, points, near, free, values, stores, factor, weight, reach, _first, n_rows
):  # fmt: skip
    """Make the lists of `list_near` on several threads.

    Each thread lists the points of some parts of the grid. Only a few parts are processed at a time, to keep the memory
    for their lists small. The points of all rows are listed. The argument `_first` is unused; it only keeps the
    signature the same as that of `list_near`.
    """
    columns = gap0.size // n_rows
    row_ranges = parts(n_rows, PART / columns)  # (first row, end) of each part
    n_at_a_time = 2 * thread_count()
    most_points = columns * max(end - first for first, end in row_ranges)
    part_lists = [_empty_lists(most_points) for _ in row_ranges[:n_at_a_time]]

    def list_part(row_range, lists):
        return list_near(
            gap0, offset, law, points, *lists, values, stores, factor, weight, reach, *row_range
        )

    sums = []  # energy, load and total of each part
    n_near = 0
    n_free = 0
    for start in range(0, len(row_ranges), n_at_a_time):
        # the last round may have fewer parts than lists
        tasks = list(zip(row_ranges[start : start + n_at_a_time], part_lists, strict=False))
        results = over(tasks, list_part)
        # append the lists of each part to the lists of the grid, in the order of the rows
        for result, (_, (part_near, part_free)) in zip(results, tasks, strict=True):
            n_part_near, n_part_free, energy, load, total = result
            in_near = slice(n_near, n_near + n_part_near)
            in_free = slice(n_free, n_free + n_part_free)
            near.index[in_near] = part_near.index[:n_part_near]
            near.p[in_near] = part_near.p[:n_part_near]
            near.v[in_near] = part_near.v[:n_part_near]
            free.index[in_free] = part_free.index[:n_part_free]
            free.place[in_free] = part_free.place[:n_part_free] + n_near
            n_near += n_part_near
            n_free += n_part_free
            sums.append((energy, load, total))
    return n_near, n_free, *summed(sums)


@exact_leader
def evaluate(law, points, near, load, n_near, c, delta):
    """Compute the approach δ, and the difference between the pressure and its projection on the contact law.

    The trial pressure is x + cδ with x = p − c v, and y(δ) is its projection on the contact law. The approach δ follows
    from Σ y(δ) = load.

    Returns δ, a flag that is True if the points near contact can carry the load, and the four results of `compare`.
    """
    find_trial(n_near, c, near)
    # c is both the length of the projection step and the factor of δ in the trial pressure
    delta, can_carry = find_approach(near.trial, n_near, law, c, near.index, c, load, delta)
    differences = compare(n_near, c, delta, law, points, near)
    return delta, can_carry, *differences


@exact_loop
def find_trial(first, end, c, near):
    """Compute x = p − c v of some points near contact."""
    p = near.p[first:end]
    v = near.v[first:end]
    x = near.trial[first:end]
    for j in range(end - first):
        x[j] = p[j] - c * v[j]


@exact_loop
def compare(first, end, c, delta, law, points, near):
    """Compare the pressures p of some points near contact with the projections y of their trial pressures.

    Returns
    -------
    squared_difference : ‖p − y‖².
    squared_projection : ‖y‖².
    n_changed : number of points whose state would change if p were set to y.
    squared_change : sum of (p − y)² over the points whose state would change.
    """
    index = near.index[first:end]
    x = near.trial[first:end]
    p = near.p[first:end]
    state = points.state
    squared_difference = 0.0
    squared_projection = 0.0
    n_changed = 0
    squared_change = 0.0
    shift = c * delta
    is_uniform = law.hardness.size == 1 and law.slope.size == 1  # the law is the same at all points
    H, t = hardness_and_fraction(0, law, c)
    for j in range(end - first):
        i = index[j]
        if not is_uniform:
            H, t = hardness_and_fraction(i, law, c)
        y, new_state = projected(x[j] + shift, H, t)
        difference = y - p[j]
        squared_difference += difference * difference
        squared_projection += y * y
        if new_state != state[i]:
            n_changed += 1
            squared_change += difference * difference
    return squared_difference, squared_projection, n_changed, squared_change


@exact
def value_at(values, i):
    """Return the value of point i from an array with one value for all points (1,) or one for each point (n,)."""
    return values[i if values.size > 1 else 0]


@exact
def hardness_and_fraction(i, law, c):
    """Return the hardness H [Pa] of point i, and the fraction t = h/(h + c).

    In the formula, h is the hardening modulus [Pa/m] of the point, and c the length [Pa/m] of the projection step.
    Above the hardness, the slope of the projected pressure with respect to the trial pressure is t. Without hardening,
    t is 0.
    """
    modulus = value_at(law.slope, i)
    fraction = modulus / (modulus + c) if modulus > 0.0 else 0.0
    return value_at(law.hardness, i), fraction


@exact
def projected(z, H, t):
    """Project a trial pressure z onto the pressures that the contact law allows.

    The projected pressure is 0 for z < 0, z for z between 0 and the hardness H, and H + t (z − H) for larger z.

    Returns the projected pressure and the state of the point.
    """
    y = min(max(z, 0.0), H)
    state = (y > 0.0) + (y >= H)  # without hardening: 0 out of contact, 1 elastic, 2 plastic
    if t > 0.0 and state == 2:  # yields and hardens: state 3
        return H + t * (z - H), 3
    return y, state


@exact_leader
def find_approach(x, n, law, c_law, index, c, load, start):
    """Solve Σ y(x + cδ) = load for δ on a list of n points.

    The pressure y(z) is the projection of the trial pressure z on the contact law, see `projected`. The sum of y is a
    monotone and piecewise linear function of δ. The equation is solved by Newton's method within a bracket, with the
    first guess `start`.

    x : list of the trial pressures at δ = 0 [Pa].
    law : contact law, see `point_arrays`.
    c_law : the c [Pa/m] used in t = h/(h + c), where t is the slope dy/dz at a point that hardens.
    index : grid index of each point in the list.
    c : factor of δ in the trial pressure.
    load : required sum of the pressures [Pa].

    In a projection step, `c` and `c_law` are both equal to the length of this step. When `project` adds a uniform
    pressure δ to the free points, c = 1 and c_law = 0. With c_law = 0, t is 1, so that points that harden also gain the
    full δ.

    Returns δ, and whether the points can carry the load.
    """
    highest, full, total_hardness, rise = maxima_and_sums(n, x, law, c_law, index, load)
    delta, low, top, can_carry = bracket_approach(
        highest, full, total_hardness, rise, c, load, start
    )
    for _ in range(ROOT_STEPS):
        if low == top:  # δ is the solution
            break
        total, slopes = total_pressure(n, x, c * delta, law, c_law, index)
        delta, low, top = refine_approach(delta, low, top, total, slopes, c, load)
    return delta, can_carry


def _merged(values: list[Any]) -> Any:
    """Combine the four results of `maxima_and_sums` for all parts: the first two are maxima, the last two are sums."""
    highest, full, total, rise = zip(*values, strict=True)
    return max(highest), max(full), sum(total), sum(rise)


@by_items(_merged, **_EXACT)
def maxima_and_sums(first, end, x, law, c_law, index, load):
    """Compute, for some points, the sums and maxima from which `bracket_approach` finds bounds of the approach δ.

    Returns
    -------
    highest : largest trial pressure x at δ = 0. If cδ < −highest, all projected pressures are 0.
    full : largest value of min(H, load) − x. If cδ > full, the pressure of each point is at least min(H, load). The
        points then carry at least the load, or all points are at their hardness.
    total : sum of the hardnesses H, that is, the load carried if every point is at its hardness.
    rise : sum of the slopes t, that is, the derivative of the load with respect to cδ when all points harden.
    """
    x, index = x[first:end], index[first:end]
    highest = -np.inf
    full = -np.inf
    total = 0.0
    rise = 0.0
    is_uniform = law.hardness.size == 1 and law.slope.size == 1  # the law is the same at all points
    H, t = hardness_and_fraction(0, law, c_law)
    for j in range(end - first):
        if not is_uniform:
            H, t = hardness_and_fraction(index[j], law, c_law)
        highest = max(highest, x[j])
        full = max(full, min(H, load) - x[j])
        total += H
        rise += t
    return highest, full, total, rise


@exact
def bracket_approach(highest, full, total_hardness, rise, c, load, start):
    """Return a first guess of δ, a lower and an upper bound of δ, and whether the points can carry the load.

    If the lower and the upper bound are equal, they are the solution δ. The first four arguments are the values that
    the function `maxima_and_sums` returns.
    """
    if total_hardness <= load:
        if rise == 0.0:  # without hardening, all points are at their hardness
            delta = full / c
            return delta, delta, delta, total_hardness >= load
        # At cδ = full, all points are at their hardness, but carry less than the load. For larger cδ, the load that
        # they carry increases at the rate `rise`.
        full += (load - total_hardness) / rise
    low = -highest / c  # there, all pressures are 0
    top = full / c  # there, the points carry at least the load
    top += 1e-12 * abs(top)  # allows for rounding errors
    return min(max(start, low), top), low, top, True


@exact
def refine_approach(delta, low, top, total, slopes, c, load):
    """Perform a step of Newton's method for δ, and return the new δ with its lower and upper bound.

    The arguments `total` and `slopes` are the values that `total_pressure` returns. If the lower and the upper bound
    are equal, they are the solution δ.
    """
    excess = total - load
    if abs(excess) <= 1e-14 * load:  # only a rounding error is left
        return delta, delta, delta
    # the sum of the projected pressures increases with δ, so that δ is a new bound
    if excess > 0.0:
        top = min(top, delta)
    else:
        low = max(low, delta)
    # step of Newton's method; without a slope, and outside the bounds, the bracket is bisected instead
    new = delta - excess / (c * slopes) if slopes > 0.0 else low
    if new <= low or new >= top:
        new = 0.5 * (low + top)
    if new == delta:  # the bracket cannot be divided further
        return delta, delta, delta
    return new, low, top


@fast_loop
def total_pressure(first, end, x, shift, law, c_law, index):
    """Compute Σ y(x + shift) over some points, and its derivative with respect to `shift`.

    The projection of a trial pressure z is y = 0 for z < 0, y = z for z between 0 and the hardness H, and y = H + t
    (z − H) for larger z. The slope t depends on the hardening modulus, see `hardness_and_fraction`. Without hardening,
    the derivative of the sum is the number of points with 0 < y < H.

    Parameters
    ----------
    first, end : int
        Range of positions in the lists `x` and `index`.
    x : array
        Trial pressures of the points in the list [Pa].
    shift : float
        Pressure that is added to the trial pressures of all points [Pa].
    law, c_law : group of arrays and float
        Contact law and length of the projection step, see `hardness_and_fraction`.
    index : array
        Grid index of each point in the list.
    """
    x, index = x[first:end], index[first:end]
    total = 0.0
    slopes = 0.0
    H, t = hardness_and_fraction(0, law, c_law)
    is_uniform = law.hardness.size == 1 and law.slope.size == 1  # the law is the same at all points
    if is_uniform and t == 0.0:  # without hardening, this loop compiles to vector instructions
        for j in range(end - first):
            z = x[j] + shift
            derivative = 1.0 if (z > 0.0) & (z < H) else 0.0
            z = z if z > 0.0 else 0.0
            total += z if z < H else H
            slopes += derivative
        return total, slopes
    for j in range(end - first):
        H, t = hardness_and_fraction(index[j], law, c_law)
        z = x[j] + shift
        above = 0.0 if z < H else t  # derivative dy/dz where the point yields
        derivative = 1.0 if (z > 0.0) & (z < H) else above
        z = z if z > 0.0 else 0.0
        total += z if z < H else H + above * (z - H)
        slopes += derivative
    return total, slopes


@exact_leader
def project(law, points, near, free, load, n_near, n_free, c, delta, keep):
    """Project the trial pressure x + cδ of each point near contact on the law, and set its pressure and state.

    If `keep` is True, a free point whose state does not change keeps the pressure found by conjugate gradients.
    Finally, a uniform pressure is added to the free points, within their bounds, until the load is carried. During this
    function, the list `near.response` holds the pressures of the free points.

    Returns the number of free points.
    """
    clear(n_free, points, free)
    n_free, carried = set_pressures(n_near, c, delta, keep, law, points, near)
    list_free(n_near, points, near, free)
    load_of_free_points = load - carried
    if n_free > 0 and load_of_free_points > 0.0:
        # Find the uniform pressure that must be added to all free points, so that they carry the rest of the load. Here
        # x are the pressures of the free points, and the uniform pressure is sought from 0 as δ, with c = 1.
        uniform, _ = find_approach(
            near.response, n_free, law, 0.0, free.index, 1.0, load_of_free_points, 0.0
        )
        shift(n_free, c, uniform, law, points, near, free)
    return n_free


@exact_loop
def clear(first, end, points, free):
    """Reset `dense` to 0 at some of the points that were free before."""
    dense = points.dense
    for i in free.index[first:end]:
        dense[i] = 0.0


@exact_loop
def set_pressures(first, end, c, delta, keep, law, points, near):
    """Set pressure and state of some points near contact, see `project`.

    Returns the number of free points, and the load carried by all other points.
    """
    index = near.index[first:end]
    x = near.trial[first:end]
    previous_p = near.p[first:end]
    p, state = points.p, points.state
    carried = 0.0
    n_free = 0
    is_uniform = law.hardness.size == 1 and law.slope.size == 1  # the law is the same at all points
    H, t = hardness_and_fraction(0, law, c)
    for j in range(end - first):
        i = index[j]
        if not is_uniform:
            H, t = hardness_and_fraction(i, law, c)
        y, new_state = projected(x[j] + c * delta, H, t)
        if new_state & 1:  # odd states are free: 1 is elastic, 3 hardens
            if keep and state[i] == new_state:
                # the previous pressure, within the bounds of the state: 0 to H if it is elastic, at least H otherwise
                if new_state == 1:
                    y = min(max(previous_p[j], 0.0), H)
                else:
                    y = max(previous_p[j], H)
            n_free += 1
        else:
            carried += y
        x[j] = y  # from now on, `near.trial` holds the projected pressures
        p[i] = y
        state[i] = new_state
    return n_free, carried


@exact
def list_free(n_near, points, near, free):
    """List the free points among those near contact, and collect their pressures in `near.response`.

    The pressures are copied from `near.trial`, where `set_pressures` has stored them.
    """
    index, projected_p, pressure = near.index, near.trial, near.response
    free_index, state = free.index, points.state
    k = 0
    for j in range(n_near):
        i = index[j]
        if state[i] & 1:
            free_index[k] = i
            pressure[k] = projected_p[j]
            k += 1


@exact_loop
def shift(first, end, c, uniform, law, points, near, free):
    """Add the same pressure to some free points, and limit the new pressures to their bounds."""
    index = free.index[first:end]
    pressure = near.response[first:end]
    p = points.p
    is_uniform = law.hardness.size == 1 and law.slope.size == 1  # the law is the same at all points
    H, t = hardness_and_fraction(0, law, c)
    for k in range(end - first):
        i = index[k]
        if not is_uniform:
            H, t = hardness_and_fraction(i, law, c)
        y = max(pressure[k] + uniform, 0.0)
        p[i] = min(y, H) if t == 0.0 else y  # a point that hardens has no upper bound


@exact
def gap_and_deformation(first, end, p, v, delta, c, law, gap, deformation, plastic):
    """Compute gap, plastic deformation u and flags of plastic points in the rows `first` to `end` − 1.

    The plastic deformation u = (p − H − c g)/(s + c) follows from the projection of the trial pressure p − c g on the
    law H + s u. Here H is the hardness, s the hardening modulus, c the length of the projection step, and g = v − δ the
    raw gap, with the displacement plus undeformed gap v and the approach δ. For s = 0, p = H and the formula becomes
    u = −g. The rounding error of u is small for any hardening modulus s. If s is much larger than c, the term p − H
    determines u. If s is much smaller than c, the term −c g determines u.

    The arrays `deformation` and `plastic` must contain zeros at first. Most rows of a light contact have no plastic
    point, and need no memory in arrays made by `numpy.zeros` as long as nothing is written there.
    """
    hardness, slope = law.hardness, law.slope
    columns = p.size // v.shape[0]
    for row in range(first, end):
        start = row * columns
        n_plastic = 0
        for j in range(columns):  # this loop compiles to vector instructions
            i = start + j
            g = v[row, j] - delta
            gap[i] = 0.0 if (p[i] > 0.0) | (g < 0.0) else g
            n_plastic += p[i] >= value_at(hardness, i)
        if n_plastic == 0:
            continue
        for j in range(columns):
            i = start + j
            if p[i] >= value_at(hardness, i):
                plastic[i] = True
                g = v[row, j] - delta
                s = value_at(slope, i)
                u = -g if s == 0.0 else (p[i] - value_at(hardness, i) - c * g) / (s + c)
                if u > 0.0:
                    deformation[i] = u

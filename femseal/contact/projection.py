"""Compile the loops of the contact solver that list points near contact and project pressures on the contact law.

`active_sets` calls `list_near`, `evaluate` and `project` between two products with the compliance K of the half-space.
These three functions take arrays first, and then the values that change from call to call. A loop processes the points
`first` to `end` − 1 of a list. For small grids, `list_near`, `evaluate` and `project` are each compiled as a single
function. For large grids, the three functions run in Python and call compiled loops, and several threads share the work
of each loop.

The state of a point is 0 out of contact (p = 0), 1 if it is elastic (0 < p < H), 2 if it is perfectly plastic (p = H),
and 3 if it yields and hardens (p = H + h u, h > 0). Points with an odd state are free: their pressure is unknown.

Arrays of several loops
-----------------------
p : pressure of each grid point [Pa], (n,).
v : displacement plus undeformed gap of each grid point, v = Kp + h₁ [m], (n1, >= n2).
state : state of each grid point, (n,).
near : indices of the points near contact.
near_p, near_v, trial : p, v and x = p − c v of the points near contact, in the order of `near`.
free : indices of the free points.
place : position of each free point in the list `near`.
hardness, slope : hardness H [Pa] and hardening modulus h [Pa/m], with one value for all points (1,) or one for each
    point (n,).
"""

from typing import Any, NamedTuple

import numpy as np

from ..base.compiled import by_items, compiled, leader, over, parts, summed, thread_count

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
    gap0, offset, hardness, slope, p, v, state, near, near_p, near_v, free, place,
    factor, weight, reach, first, end,
):  # fmt: skip
    """Compute v = factor · v + weight · (h₁ − offset) in rows `first` to `end` − 1, and list the points near contact.

    A point is near contact if it is in contact or if v is below the threshold `reach`.

    factor, weight : factors of v and of h₁ − offset. If v is the displacement of a half-space of unit modulus, `factor`
        is 1/E* and `weight` is 1. If v is already complete and only a new list is needed, `factor` is 1 and `weight`
        is 0.

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
    columns = p.size // v.shape[0]  # rows of v may be longer
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
                energy += 0.5 * row_p[j] * (vj + h)  # ½⟨p, Kp⟩ + ⟨p, h₁⟩ = ½⟨p, v + h₁⟩
                load += row_p[j]
                total += vj
                i = start + j
                near[n_near] = i
                near_p[n_near] = row_p[j]
                near_v[n_near] = vj
                if states[j] == 3:
                    # the point yields and hardens: its energy contains the term ψ = ½ (p − H)²/h
                    above_hardness = row_p[j] - value_at(hardness, i)
                    energy += 0.5 * above_hardness * above_hardness / value_at(slope, i)
                if states[j] & 1:  # odd states are free: 1 is elastic, 3 hardens
                    free[n_free] = i
                    place[n_free] = n_near
                    n_free += 1
                n_near += 1
    return n_near, n_free, energy, load, total


class _PartLists(NamedTuple):
    """Lists of points for one part of a grid; the docstring of this module explains each list."""

    near: Any
    near_p: Any
    near_v: Any
    free: Any
    place: Any

    @classmethod
    def empty(cls, size):
        """Make lists for at most `size` points."""
        near_p, near_v = np.empty((2, size))
        free, place = np.empty((2, size), np.int32)
        return cls(np.empty(size, np.int32), near_p, near_v, free, place)


def list_near_in_parts(
    gap0, offset, hardness, slope, p, v, state, near, near_p, near_v, free, place,
    factor, weight, reach, _first, n_rows,
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
    part_lists = [_PartLists.empty(most_points) for _ in row_ranges[:n_at_a_time]]

    def list_part(row_range, lists):
        return list_near(
            gap0, offset, hardness, slope, p, v, state, *lists, factor, weight, reach, *row_range
        )

    sums = []  # energy, load and total of each part
    n_near = 0
    n_free = 0
    for start in range(0, len(row_ranges), n_at_a_time):
        # the last round may have fewer parts than lists
        tasks = list(zip(row_ranges[start : start + n_at_a_time], part_lists, strict=False))
        results = over(tasks, list_part)
        # append the lists of each part to the lists of the grid, in the order of the rows
        for result, (_, lists) in zip(results, tasks, strict=True):
            part_near, part_free, energy, load, total = result
            in_near = slice(n_near, n_near + part_near)
            in_free = slice(n_free, n_free + part_free)
            near[in_near] = lists.near[:part_near]
            near_p[in_near] = lists.near_p[:part_near]
            near_v[in_near] = lists.near_v[:part_near]
            free[in_free] = lists.free[:part_free]
            place[in_free] = lists.place[:part_free] + n_near
            n_near += part_near
            n_free += part_free
            sums.append((energy, load, total))
    return n_near, n_free, *summed(sums)


@exact_leader
def evaluate(hardness, slope, state, near, near_p, near_v, trial, load, n_near, c, delta):
    """Compute the approach δ, and the difference between the pressure and its projection on the contact law.

    The trial pressure is x + cδ with x = p − c v, and y(δ) is its projection on the contact law. The approach δ follows
    from Σ y(δ) = load.

    Returns δ, a flag that is True if the points near contact can carry the load, and the four results of `compare`.
    """
    find_trial(n_near, c, near_p, near_v, trial)
    delta, can_carry = find_approach(
        trial,  # x
        n_near,
        hardness,
        slope,
        c,  # c_law, which is equal to c in a projection step
        near,
        c,
        load,
        delta,  # first guess
    )
    differences = compare(n_near, c, delta, hardness, slope, state, near, near_p, trial)
    return delta, can_carry, *differences


@exact_loop
def find_trial(first, end, c, near_p, near_v, trial):
    """Compute x = p − c v of some points near contact."""
    for j in range(first, end):
        trial[j] = near_p[j] - c * near_v[j]


@exact_loop
def compare(first, end, c, delta, hardness, slope, state, near, near_p, trial):
    """Compare the pressures p of some points near contact with the projections y of their trial pressures.

    Returns
    -------
    squared_difference : ‖p − y‖².
    squared_projection : ‖y‖².
    n_changed : number of points whose state would change if p were set to y.
    squared_change : sum of (p − y)² over the points whose state would change.
    """
    listed = near[first:end]
    x = trial[first:end]
    p = near_p[first:end]
    squared_difference = 0.0
    squared_projection = 0.0
    n_changed = 0
    squared_change = 0.0
    shift = c * delta
    is_uniform = hardness.size == 1 and slope.size == 1  # the law is the same at all points
    H, t = law_at(0, hardness, slope, c)
    for j in range(end - first):
        i = listed[j]
        if not is_uniform:
            H, t = law_at(i, hardness, slope, c)
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
def law_at(i, hardness, slope, c):
    """Return the hardness H [Pa] of point i, and the fraction t = h/(h + c).

    In the formula, h is the hardening modulus [Pa/m] of the point, and c the length [Pa/m] of the projection step.
    Above the hardness, the slope of the projected pressure with respect to the trial pressure is t. Without hardening,
    t is 0.
    """
    modulus = value_at(slope, i)
    fraction = modulus / (modulus + c) if modulus > 0.0 else 0.0
    return value_at(hardness, i), fraction


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
def find_approach(x, n, hardness, slope, c_law, listed, c, load, start):
    """Solve Σ y(x + cδ) = load for δ on a list of n points.

    The pressure y(z) is the projection of the trial pressure z on the contact law, see `projected`. The sum of y is a
    monotone and piecewise linear function of δ. The equation is solved by Newton's method within a bracket, with the
    first guess `start`.

    c : factor of δ in the trial pressure.
    c_law : the c [Pa/m] used in t = h/(h + c), where t is the slope dy/dz at a point that hardens.

    In a projection step, `c` and `c_law` are both equal to the length of this step. When `project` adds a uniform
    pressure δ to the free points, c = 1 and c_law = 0. With c_law = 0, t is 1, so that points that harden also gain the
    full δ.

    Returns δ, and whether the points can carry the load.
    """
    highest, full, total_hardness, rise = capacity(n, x, hardness, slope, c_law, listed, load)
    delta, low, top, can_carry = bracket_approach(
        highest, full, total_hardness, rise, c, load, start
    )
    for _ in range(ROOT_STEPS):
        if low == top:  # δ is the solution
            break
        total, slopes = total_pressure(n, x, c * delta, hardness, slope, c_law, listed)
        delta, low, top = refine_approach(delta, low, top, total, slopes, c, load)
    return delta, can_carry


def _bounds(values: list[Any]) -> Any:
    """Combine the results of `capacity` for all parts: maxima of `highest` and `full`, sums of `total` and `rise`."""
    highest, full, total, rise = zip(*values, strict=True)
    return max(highest), max(full), sum(total), sum(rise)


@by_items(_bounds, **_EXACT)
def capacity(first, end, x, hardness, slope, c_law, listed, load):
    """Compute, for some points, the sums and maxima from which `bracket_approach` finds bounds of the approach δ.

    Returns
    -------
    highest : largest trial pressure x at δ = 0. If cδ < −highest, all projected pressures are 0.
    full : largest value of min(H, load) − x. If cδ > full, the pressure of each point is at least min(H, load). The
        points then carry at least the load, or all points are at their hardness.
    total : sum of the hardnesses H, that is, the load carried if every point is at its hardness.
    rise : sum of the slopes t, that is, the derivative of the load with respect to cδ when all points harden.
    """
    x, listed = x[first:end], listed[first:end]
    highest = -np.inf
    full = -np.inf
    total = 0.0
    rise = 0.0
    is_uniform = hardness.size == 1 and slope.size == 1  # the law is the same at all points
    H, t = law_at(0, hardness, slope, c_law)
    for j in range(end - first):
        if not is_uniform:
            H, t = law_at(listed[j], hardness, slope, c_law)
        highest = max(highest, x[j])
        full = max(full, min(H, load) - x[j])
        total += H
        rise += t
    return highest, full, total, rise


@exact
def bracket_approach(highest, full, total_hardness, rise, c, load, start):
    """Return a first guess of δ, a lower and an upper bound of δ, and whether the points can carry the load.

    If the lower and the upper bound are equal, they are the solution δ. The first four arguments are the values that
    the function `capacity` returns.
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
def total_pressure(first, end, x, shift, hardness, slope, c_law, listed):
    """Compute Σ y(x + shift) over some points, and its derivative with respect to `shift`.

    The projection of a trial pressure z is y = 0 for z < 0, y = z for z between 0 and the hardness H, and y = H + t
    (z − H) for larger z. The slope t depends on the hardening modulus, see `law_at`. Without hardening, the derivative
    of the sum is the number of points with 0 < y < H.

    Parameters
    ----------
    first, end : int
        Range of positions in the lists `x` and `listed`.
    x : array
        Trial pressures of the points in the list [Pa].
    shift : float
        Pressure that is added to the trial pressures of all points [Pa].
    hardness, slope, c_law : arrays and float
        Parameters of the contact law, see `law_at`.
    listed : array
        Grid index of each point in the list.
    """
    x, listed = x[first:end], listed[first:end]
    total = 0.0
    slopes = 0.0
    H, t = law_at(0, hardness, slope, c_law)
    is_uniform = hardness.size == 1 and slope.size == 1  # the law is the same at all points
    if is_uniform and t == 0.0:  # without hardening, this loop compiles to vector instructions
        for j in range(end - first):
            z = x[j] + shift
            derivative = 1.0 if (z > 0.0) & (z < H) else 0.0
            z = z if z > 0.0 else 0.0
            total += z if z < H else H
            slopes += derivative
        return total, slopes
    for j in range(end - first):
        H, t = law_at(listed[j], hardness, slope, c_law)
        z = x[j] + shift
        above = 0.0 if z < H else t  # derivative dy/dz where the point yields
        derivative = 1.0 if (z > 0.0) & (z < H) else above
        z = z if z > 0.0 else 0.0
        total += z if z < H else H + above * (z - H)
        slopes += derivative
    return total, slopes


@exact_leader
def project(
    hardness, slope, p, state, dense, near, near_p, trial, free, response, load,
    n_near, n_free, c, delta, keep,
):  # fmt: skip
    """Project the trial pressure x + cδ of each point near contact on the law, and set its pressure and state.

    If `keep` is True, a free point whose state does not change keeps the pressure found by conjugate gradients.
    Finally, a uniform pressure is added to the free points, within their bounds, until the load is carried. During this
    function, the array `response` holds the pressures of the free points.

    Returns the number of free points.
    """
    clear(n_free, free, dense)
    n_free, carried = set_pressures(
        n_near, c, delta, keep, hardness, slope, p, state, near, near_p, trial
    )
    list_free(n_near, state, near, trial, free, response)
    load_of_free_points = load - carried
    if n_free > 0 and load_of_free_points > 0.0:
        # find the uniform pressure that must be added to all free points, so that they carry the rest of the load
        uniform, _ = find_approach(
            response,  # x, here the pressures of the free points
            n_free,
            hardness,
            slope,
            0.0,  # c_law
            free,
            1.0,  # c
            load_of_free_points,
            0.0,  # first guess
        )
        shift(n_free, c, uniform, hardness, slope, p, free, response)
    return n_free


@exact_loop
def clear(first, end, free, dense):
    """Reset `dense` to 0 at some of the points that were free before."""
    for i in free[first:end]:
        dense[i] = 0.0


@exact_loop
def set_pressures(first, end, c, delta, keep, hardness, slope, p, state, near, near_p, trial):
    """Set pressure and state of some points near contact, see `project`.

    Returns the number of free points, and the load carried by all other points.
    """
    listed = near[first:end]
    x = trial[first:end]
    previous_p = near_p[first:end]
    carried = 0.0
    n_free = 0
    for j in range(end - first):
        i = listed[j]
        H, t = law_at(i, hardness, slope, c)
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
        x[j] = y  # from now on, `trial` holds the projected pressures
        p[i] = y
        state[i] = new_state
    return n_free, carried


@exact
def list_free(n_near, state, near, trial, free, pressure):
    """Collect the free points among those near contact in `free`, and their pressures in `pressure`.

    The pressures are copied from `trial`, where `set_pressures` has stored them.
    """
    k = 0
    for j in range(n_near):
        i = near[j]
        if state[i] & 1:
            free[k] = i
            pressure[k] = trial[j]
            k += 1


@exact_loop
def shift(first, end, c, uniform, hardness, slope, p, free, pressure):
    """Add the same pressure to some free points, and limit the new pressures to their bounds."""
    for k in range(first, end):
        i = free[k]
        H, t = law_at(i, hardness, slope, c)
        y = max(pressure[k] + uniform, 0.0)
        p[i] = min(y, H) if t == 0.0 else y  # a point that hardens has no upper bound


@exact
def gap_and_deformation(first, end, p, v, delta, c, hardness, slope, gap, deformation, plastic):
    """Compute gap, plastic deformation u and flags of plastic points in the rows `first` to `end` − 1.

    The plastic deformation u = (p − H − c g)/(s + c) follows from the projection of the trial pressure p − c g on the
    law H + s u. Here H is the hardness, s the hardening modulus, c the length of the projection step, and g = v − δ the
    raw gap, with the displacement plus undeformed gap v and the approach δ. For s = 0, p = H and the formula becomes
    u = −g. The rounding error of u is small for any hardening modulus s. If s is much larger than c, the term p − H
    determines u. If s is much smaller than c, the term −c g determines u.
    """
    columns = p.size // v.shape[0]
    for row in range(first, end):
        for j in range(columns):
            i = row * columns + j
            g = v[row, j] - delta
            H = value_at(hardness, i)
            gap[i] = 0.0 if p[i] > 0.0 or g < 0.0 else g
            plastic[i] = p[i] >= H
            deformation[i] = 0.0
            if plastic[i]:
                s = value_at(slope, i)
                u = -g if s == 0.0 else (p[i] - H - c * g) / (s + c)
                if u > 0.0:
                    deformation[i] = u

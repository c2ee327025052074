"""Find the approach δ at which the projected pressures carry the load, by Newton's method within a bracket.

The trial pressure of a point is z = x + cδ, and y(z) is its projection on the contact law (`law_at_points.projected`).
The sum Σ y is a monotone and piecewise linear function of δ. `find_approach` solves Σ y = load.
"""

from typing import Any

import numpy as np

from ..base.compiled import by_items
from .law_at_points import hardness_and_slope, is_same_at_all_points
from .loop_decorators import EXACT, exact, exact_leader, fast_loop

#: Largest number of steps of Newton's method for δ.
ROOT_STEPS = 200


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


@by_items(_merged, **EXACT)
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
    is_uniform = is_same_at_all_points(law)
    H, t = hardness_and_slope(0, law, c_law)
    for j in range(end - first):
        if not is_uniform:
            H, t = hardness_and_slope(index[j], law, c_law)
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
    (z − H) for larger z. The slope t depends on the hardening modulus, see `hardness_and_slope`. Without hardening,
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
        Contact law and length of the projection step, see `hardness_and_slope`.
    index : array
        Grid index of each point in the list.
    """
    x, index = x[first:end], index[first:end]
    total = 0.0
    slopes = 0.0
    H, t = hardness_and_slope(0, law, c_law)
    is_uniform = is_same_at_all_points(law)
    if is_uniform and t == 0.0:  # without hardening, this loop compiles to vector instructions
        for j in range(end - first):
            z = x[j] + shift
            derivative = 1.0 if (z > 0.0) & (z < H) else 0.0
            z = z if z > 0.0 else 0.0
            total += z if z < H else H
            slopes += derivative
        return total, slopes
    for j in range(end - first):
        H, t = hardness_and_slope(index[j], law, c_law)
        z = x[j] + shift
        above = 0.0 if z < H else t  # derivative dy/dz where the point yields
        derivative = 1.0 if (z > 0.0) & (z < H) else above
        z = z if z > 0.0 else 0.0
        total += z if z < H else H + above * (z - H)
        slopes += derivative
    return total, slopes

"""Compile the loops that project trial pressures on the contact law and choose the active sets.

The trial pressure of a point is x + cδ with x = p − c v. Its projection y on the contact law is the pressure that the
point would have after a projection step of length c. `evaluate` compares the present pressures p with y. `project`
replaces p by y, which changes the active sets.

Both functions take groups of arrays first, see `point_arrays`, and then the values that change from call to call. For
small grids, each of them is compiled as a single function. For large grids, they run in Python and call compiled loops,
and several threads share the work of each loop.
"""

from .approach import find_approach
from .law_at_points import hardness_and_slope, is_same_at_all_points, projected
from .loop_decorators import exact, exact_leader, exact_loop
from .point_arrays import ELASTIC, FREE


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
    is_uniform = is_same_at_all_points(law)
    H, t = hardness_and_slope(0, law, c)
    for j in range(end - first):
        i = index[j]
        if not is_uniform:
            H, t = hardness_and_slope(i, law, c)
        y, new_state = projected(x[j] + shift, H, t)
        difference = y - p[j]
        squared_difference += difference * difference
        squared_projection += y * y
        if new_state != state[i]:
            n_changed += 1
            squared_change += difference * difference
    return squared_difference, squared_projection, n_changed, squared_change


@exact_leader
def project(law, points, near, free, load, n_near, n_free, c, delta, keep):
    """Project the trial pressure x + cδ of each point near contact on the law, and set its pressure and state.

    If `keep` is True, a free point whose state does not change keeps the pressure found by conjugate gradients.
    Finally, a uniform pressure is added to the free points, within their bounds, until the load is carried. During this
    function, the list `near.response` holds the pressures of the free points.

    Returns the number of free points.
    """
    clear_dense(n_free, points, free)
    n_free, carried = set_pressures(n_near, c, delta, keep, law, points, near)
    list_free_points(n_near, points, near, free)
    load_of_free_points = load - carried
    if n_free > 0 and load_of_free_points > 0.0:
        # Find the uniform pressure that must be added to all free points, so that they carry the rest of the load. Here
        # x are the pressures of the free points, and the uniform pressure is sought from 0 as δ, with c = 1.
        uniform, _ = find_approach(
            near.response, n_free, law, 0.0, free.index, 1.0, load_of_free_points, 0.0
        )
        add_uniform_pressure(n_free, c, uniform, law, points, near, free)
    return n_free


@exact_loop
def clear_dense(first, end, points, free):
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
    is_uniform = is_same_at_all_points(law)
    H, t = hardness_and_slope(0, law, c)
    for j in range(end - first):
        i = index[j]
        if not is_uniform:
            H, t = hardness_and_slope(i, law, c)
        y, new_state = projected(x[j] + c * delta, H, t)
        if new_state & FREE:
            if keep and state[i] == new_state:
                # the previous pressure, within the bounds of the state: 0 to H if it is elastic, at least H otherwise
                if new_state == ELASTIC:
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
def list_free_points(n_near, points, near, free):
    """List the free points among those near contact, and collect their pressures in `near.response`.

    The pressures are copied from `near.trial`, where `set_pressures` has stored them.
    """
    index, projected_p, pressure = near.index, near.trial, near.response
    free_index, state = free.index, points.state
    k = 0
    for j in range(n_near):
        i = index[j]
        if state[i] & FREE:
            free_index[k] = i
            pressure[k] = projected_p[j]
            k += 1


@exact_loop
def add_uniform_pressure(first, end, c, uniform, law, points, near, free):
    """Add the same pressure to some free points, and limit the new pressures to their bounds."""
    index = free.index[first:end]
    pressure = near.response[first:end]
    p = points.p
    is_uniform = is_same_at_all_points(law)
    H, t = hardness_and_slope(0, law, c)
    for k in range(end - first):
        i = index[k]
        if not is_uniform:
            H, t = hardness_and_slope(i, law, c)
        y = max(pressure[k] + uniform, 0.0)
        p[i] = min(y, H) if t == 0.0 else y  # a point that hardens has no upper bound

"""Solve a contact on one grid by projected active sets, with preconditioned conjugate gradients on the free points.

The solution minimises the energy ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ψ(p) under a given load. The term ψ depends on the contact law.

With v = Kp + h₁, the trial pressure of a point is p − c (v − δ). The projection of the trial pressure on the
contact law is y. For perfect plasticity, y = clip(p − c (v − δ), 0, H). The approach δ is chosen such that Σ y is equal
to the load. The pressure p is the solution if p = y, for any step length c > 0.

An iteration consists of three parts:

1. If some points have to change their state (separated, elastic or plastic), the active sets are updated: p is set to
   y, and v is recomputed by a product with K.
2. A few steps of conjugate gradients reduce the energy. They change the pressure of the free points only, that is, of
   points that are elastic or harden. Each step needs a product with K.
3. The contact is evaluated: δ, y and the residual ‖p − y‖/‖y‖ · c₀/c are computed.

The iteration is an inexact semismooth Newton method. Its convergence is not proved. If the energy increases repeatedly,
or after 60 iterations, the method in `descent` is used instead. Before the solver accepts a pressure as the solution,
it recomputes v by a product with K and evaluates the residual again. The reported residual is therefore that of the
returned pressure. Sources: Moré & Toraldo, SIAM J. Optim. 1, 1991, 93; Polonsky & Keer, Wear 231, 1999, 206.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any, NamedTuple, Protocol

from .descent import Solution, descend
from .workspace import Loops, Problem, Workspace


class StepLimits(NamedTuple):
    """Limits for the conjugate-gradient steps in one iteration of the contact solver.

    after_change : maximum number of conjugate-gradient steps if the iteration has changed the active sets.
    without_change : maximum number of conjugate-gradient steps if the iteration has not changed the active sets.
    drop : the steps end when w·r (the squared energy norm of the residual) falls below this fraction of its initial
        value.
    """

    after_change: int
    without_change: int
    drop: float


_STEPS = StepLimits(3, 5, 0.04)
#: Limits for grids with a long axis, on which contact patches may be large or far from each other. Compared with
#: `_STEPS`, the number of products falls from 48 to 37 for unloading on 2048² points, and from between 400 and 1,400 to
#: 200 for a strip of 2 × 32768 points.
_LONG_STEPS = StepLimits(64, 64, 0.01)
#: An axis is long from this number of points on.
_LONG = 1024
#: Number of iterations after which `descent`, whose steps never increase the energy, is used.
_MONOTONE_AFTER = 60
#: `descent` is also used when the damping is below this value. The damping is reduced whenever the energy increases.
_MONOTONE_BELOW = 0.1
#: Smallest damping.
_LEAST_DAMPING = 1e-3
#: Relative increase of the energy that cannot be explained by rounding errors.
_RISE = 1e-13
#: With the tangents of a curved law, the damping is reduced if the residual has become larger than this fraction of its
#: value at the previous change of the sets. Energies with different tangents cannot be compared.
_SLOW = 0.9
#: Value of w·r below which the residual is a rounding error, relative to w·r for the residual δ at all free points.
_FLAT = 1e-30
#: The sets are not changed as long as each iteration reduces the residual to a half, and the points that would change
#: sets contribute at most this fraction of the squared residual.
_FRACTION = 0.1
#: Relative error of the load up to which the initial pressure can be accepted as the solution.
_LOAD_RTOL = 1e-10


class Lists(NamedTuple):
    """Sizes of the lists of `projection`, and the threshold with which the lists were made.

    near : number of points near contact. A point is near contact if it is in contact or if v is below `reach`.
    free : number of free points. The pressure of a free point is unknown.
    reach : value of v [m] below which a point is listed as near contact.
    margin : `reach` minus the approach δ at the time the lists were made [m].
    """

    near: int
    free: int
    reach: float
    margin: float


class Evaluation(NamedTuple):
    """Result of an evaluation of the contact.

    delta : approach δ [m], minus the height that the solver has subtracted from the undeformed gap.
    residual : residual ‖p − y‖/‖y‖ · c₀/c.
    sets_change : whether the active sets should be changed in the next iteration.
    """

    delta: float
    residual: float
    sets_change: bool


class Directions(NamedTuple):
    """State of the conjugate gradients on one set of free points.

    total_ones : sum of all components of M1, the preconditioner M applied to a vector of ones.
    previous_wr : product w·r of the previous direction; infinite if there is no previous direction.
    unused_wr : product w·r of the next direction; None if the next direction has not been computed.
    """

    total_ones: float
    previous_wr: float = inf
    unused_wr: float | None = None


class Gradients(NamedTuple):
    """Result of several steps of conjugate gradients.

    directions : scalars needed to continue the conjugate-gradient iteration after the last step.
    steps : number of steps.
    longest_step : largest permissible length c [Pa/m] of the next projection step, computed from the Rayleigh quotients
        of the search directions.
    """

    directions: Directions
    steps: int
    longest_step: float


class Tangents(Protocol):
    """Tangents of a curved contact law at the present plastic deformation of each point.

    Each evaluation of the contact gives new plastic deformations, and therefore new tangents.

    delta : first guess of the approach, measured from the offset of the heights [m]; or None.
    number : number of points whose tangent has a positive slope dH/du.
    """

    delta: float | None
    number: int

    def evaluate(self, n_near: int, c: float, delta: float) -> tuple[Any, ...]:
        """Evaluate the contact like `projection.evaluate`, and set the tangent of each point."""


def solve_active_sets(
    grid: Workspace,
    problem: Problem,
    rtol: float,
    limit: int,
    tangents: Tangents | None = None,
) -> Solution:
    """Solve a contact problem, beginning with the pressure that is stored in the workspace.

    Parameters
    ----------
    grid : Workspace
        Workspace of the grid with the initial pressure, see `Workspace.start`. The solution replaces this pressure.
    problem : Problem
        Gap, law and load.
    rtol : float
        Target residual.
    limit : int
        Largest number of iterations.
    tangents : Tangents, optional
        Tangents of a curved law. If given, `tangents.evaluate` is called instead of `projection.evaluate`. It updates
        the hardness and slope of each point in `problem`.

    Returns
    -------
    Solution
    """
    loops = grid.loops(problem)
    first_delta = None
    if tangents is not None:
        loops = loops._replace(evaluate=tangents.evaluate)
        first_delta = tangents.delta
    c0 = grid.stiffness
    step = c0
    shortest_step = c0 / (4 * max(grid.half_space.shape))
    lists, state = _first_evaluation(grid, loops, c0, first_delta)
    iterations = 0
    products = 1
    damping = 1.0
    energy = inf
    changed_residual = inf
    # whether v was computed from p by a product; steps of conjugate gradients only update v
    is_fresh = True
    directions = None
    lists, state = _evaluate(grid, loops, lists, state, step, is_fresh)
    state = state._replace(sets_change=True)
    while not _is_solved(grid, problem, state, rtol, is_fresh, iterations):
        is_converged = state.residual <= rtol
        if iterations >= limit and not is_converged:
            break
        sets_repeat = iterations >= _MONOTONE_AFTER or damping < _MONOTONE_BELOW
        if sets_repeat and not is_converged and tangents is None:
            _change_sets(grid, loops, lists, step, state.delta, keep=True)
            solution = descend(grid, problem, state.delta, rtol, limit - iterations)
            return Solution(
                solution.delta,
                solution.residual,
                iterations + solution.iterations,
                products + 1 + solution.products,
            )
        iterations += 1
        if state.sets_change or is_converged or lists.free < 2:
            keep = iterations > 1
            previous_energy = energy
            previous_residual, changed_residual = changed_residual, state.residual
            lists, energy = _change_sets(grid, loops, lists, step, state.delta, keep)
            products += 1
            is_fresh = True
            has_risen = energy > previous_energy + _RISE * abs(previous_energy)
            if tangents is not None:
                has_risen = changed_residual > _SLOW * previous_residual
            if has_risen:
                damping = max(damping / 2, _LEAST_DAMPING)
            else:
                damping = min(1.0, 1.25 * damping)
            directions = None
        if is_converged:
            step = c0  # the returned residual is defined with c₀
        elif lists.free >= 2:
            if tangents is not None and tangents.number > 0:
                directions = None  # the directions were conjugate for other tangents
            gradients = _conjugate_gradients(grid, loops, lists, state, directions)
            directions = gradients.directions
            products += gradients.steps
            is_fresh = is_fresh and gradients.steps == 0
            step = max(shortest_step, min(c0, damping * gradients.longest_step))
        lists, state = _evaluate(grid, loops, lists, state, step, is_fresh)
    return Solution(state.delta, state.residual, iterations, products)


def _is_solved(
    grid: Workspace,
    problem: Problem,
    state: Evaluation,
    rtol: float,
    is_fresh: bool,
    iterations: int,
) -> bool:
    """Return whether the pressure is accepted as the solution.

    The pressure must carry the load, and its residual must be at most `rtol`. The residual must have been computed from
    a product of K with the present pressure (`is_fresh`).
    """
    if not (state.residual <= rtol and is_fresh):
        return False
    if iterations > 0:
        return True  # the projection in the iteration has made the pressure carry the load
    # the initial pressure may carry another load
    return abs(float(grid.arrays.p.sum()) - problem.load) <= _LOAD_RTOL * problem.load


class Product(NamedTuple):
    """Results of a product of K with the pressure: sums over the grid points, and sizes of the point lists.

    lists : sizes of the lists, and the threshold used to make them.
    energy : energy of the pressure.
    load : sum Σ p of the pressures of all points [Pa].
    total_v : sum Σ v over the points near contact [m].
    """

    lists: Lists
    energy: float
    load: float
    total_v: float


def _multiply(grid: Workspace, loops: Loops, reach: float, margin: float) -> Product:
    """Compute v = Kp + h₁, and list the points near contact: points in contact, and points with v below `reach` [m]."""
    loops.respond()
    n_rows = len(grid.arrays.v)
    near, free, energy, load, total_v = loops.list_near(grid.compliance, 1.0, reach, 0, n_rows)
    return Product(Lists(near, free, reach, margin), energy, load, total_v)


def _list_near(grid: Workspace, loops: Loops, reach: float, margin: float) -> Lists:
    """List the points near contact again, with another threshold `reach` [m]. The values of v are not changed."""
    n_rows = len(grid.arrays.v)
    near, free, *_sums = loops.list_near(1.0, 0.0, reach, 0, n_rows)
    return Lists(near, free, reach, margin)


def _first_evaluation(
    grid: Workspace, loops: Loops, c: float, delta: float | None = None
) -> tuple[Lists, Evaluation]:
    """List the points near contact for the initial pressure.

    delta : first guess of the approach δ [m]; by default, the mean of v over the points in contact.
    """
    product = _multiply(grid, loops, reach=-inf, margin=0.0)  # lists the points in contact only
    # with a very small load there may be no point in contact on a coarse grid
    n_contact = max(product.lists.near, 1)
    if delta is None:
        delta = product.total_v / n_contact
    # half of the mean pressure in the contact, converted to a length by the step length c
    margin = 0.5 * product.load / (n_contact * c)
    lists = _list_near(grid, loops, delta + margin, margin)
    return lists, Evaluation(delta, residual=inf, sets_change=True)


def _evaluate(
    grid: Workspace, loops: Loops, lists: Lists, previous: Evaluation, c: float, is_fresh: bool
) -> tuple[Lists, Evaluation]:
    """Compute δ and the residual for the step length c [Pa/m], and decide whether the active sets should be changed.

    Only the listed points near contact are considered: at all other points, v was above `reach` when the list was made.
    If δ exceeds `reach`, a new list is made, provided that v is accurate at all points (`is_fresh`). Conjugate-gradient
    steps update v only at the listed points. After such a step, no new list is therefore made until K is next
    multiplied by the pressure.
    """
    delta = previous.delta
    while True:
        # r2 and y2 are ‖p − y‖² and ‖y‖². `changed_r2` is ‖p − y‖² of the `n_changed` points whose state would change.
        delta, can_carry, r2, y2, n_changed, changed_r2 = loops.evaluate(lists.near, c, delta)
        is_complete = can_carry and delta <= lists.reach
        lists_all_points = lists.reach == inf
        if is_complete or lists_all_points or not is_fresh:
            break
        # list more points: the margin grows at least by a factor of 4, so that few new lists are needed
        margin = max(4.0 * lists.margin, delta - lists.reach)
        reach = delta + margin
        if not (can_carry and reach < inf):
            # the listed points cannot carry the load, or `reach` is NaN: list all points
            reach = inf
        lists = _list_near(grid, loops, reach, margin)
    if y2 > 0.0:
        relative_difference = sqrt(r2 / y2)
    else:
        relative_difference = inf if r2 > 0.0 else 0.0
    # approximately the residual for the step length c₀
    residual = relative_difference * (grid.stiffness / c)
    is_slow = residual > 0.5 * previous.residual
    needs_change = changed_r2 > _FRACTION * r2 or is_slow
    return lists, Evaluation(delta, residual, sets_change=n_changed > 0 and needs_change)


def _change_sets(
    grid: Workspace, loops: Loops, lists: Lists, c: float, delta: float, keep: bool
) -> tuple[Lists, float]:
    """Change the active sets: set the pressure p to the projection y, and compute v from the new pressure.

    keep : whether a free point keeps its pressure if it remains elastic or continues to harden.

    Returns how many points the new lists contain, and the energy of the new pressure.
    """
    loops.project(lists.near, lists.free, c, delta, keep)
    product = _multiply(grid, loops, delta + lists.margin, lists.margin)
    return product.lists, product.energy


def _conjugate_gradients(
    grid: Workspace,
    loops: Loops,
    lists: Lists,
    state: Evaluation,
    directions: Directions | None,
) -> Gradients:
    """Perform a few steps of conjugate gradients on the free points.

    directions : scalars needed to continue an earlier conjugate-gradient iteration; None to restart it, because the
        free points have changed.
    """
    is_long = max(grid.half_space.shape) >= _LONG
    limits = _LONG_STEPS if is_long else _STEPS
    most_steps = limits.after_change if state.sets_change else limits.without_change
    if directions is None:
        directions = Directions(loops.restart(lists.free, state.delta))
    total_ones, previous_wr, wr = directions
    first_wr = inf  # w·r of the first direction
    smallest_stiffness = inf  # smallest d·d/(d·Kd) of all directions d [Pa/m]
    steps = 0
    while steps < most_steps:
        if wr is None:
            wr = loops.next_direction(lists.free, previous_wr, total_ones)
        if steps == 0:
            first_wr = wr
            # if the residual on the free points is only a rounding error, only a change of the sets can help
            if not first_wr > _FLAT * state.delta**2 * total_ones:
                break
        if not (wr > 0.0 and wr >= limits.drop * first_wr):
            break
        loops.search()  # computes Kd
        curvature, squared_length, is_made = loops.step(lists.near, lists.free, wr)
        steps += 1
        previous_wr = wr if is_made else inf
        wr = None
        if not is_made:
            break
        if curvature > 0.0:
            smallest_stiffness = min(smallest_stiffness, squared_length / curvature)
    return Gradients(Directions(total_ones, previous_wr, wr), steps, 2.0 * smallest_stiffness)

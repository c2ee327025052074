"""Solve a contact on one grid by projected active sets, with preconditioned conjugate gradients on the free points.

The solution minimises the energy ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ψ(p) under a given load, where ψ depends on the contact law. Let
y be the projection of p − c (v − δ) on the contact law, with v = Kp + h₁ and the δ for which Σ y is equal to the load.
For perfect plasticity y = clip(p − c (v − δ), 0, H). The pressure p is the solution if p = y, for any c > 0.

Each iteration consists of three parts:

1. If points have to leave the contact, reach the hardness, or return from either, the sets are changed: p is set to y,
   and v is computed by a product with K.
2. A few steps of conjugate gradients on the free points, which are elastic or harden, reduce the energy. Each step
   needs a product with K.
3. The contact is evaluated: δ, y and the residual ‖p − y‖/‖y‖ · c₀/c are computed.

This is an inexact semismooth Newton method, for which convergence is not proved. If the energy increases repeatedly, or
after 60 iterations, the method in `descent` is used instead. Before convergence is accepted, v is computed again by a
product with K, so that the residual is that of the returned pressure. Sources: Moré & Toraldo, SIAM J. Optim. 1, 1991,
93; Polonsky & Keer, Wear 231, 1999, 206.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any, NamedTuple, Protocol

from .descent import Solution, descend
from .workspace import Loops, Problem, Workspace


class StepLimits(NamedTuple):
    """Limits for the steps of conjugate gradients in one iteration.

    after_change : largest number of steps in an iteration in which the active sets have changed.
    without_change : largest number of steps in an iteration in which the active sets have remained the same.
    drop : the steps end when w·r, the squared energy norm of the residual, falls below this fraction of its first
        value.
    """

    after_change: int
    without_change: int
    drop: float


_STEPS = StepLimits(3, 5, 0.04)
#: Limits for grids with a long axis, on which contact patches may be large or far from each other. They reduce the
#: number of products for unloading on 2048² points from 48 to 37, and for a strip of 2 × 32768 points from 400 to 1,400
#: to 200.
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
    """Numbers of listed points, and the threshold with which the lists were made.

    near : number of points near contact. A point is near contact if it is in contact or if v is below `reach`.
    free : number of free points, whose pressure is unknown.
    reach : threshold of v [m].
    margin : difference between `reach` and δ at the time when the lists were made [m].
    """

    near: int
    free: int
    reach: float
    margin: float


class Evaluation(NamedTuple):
    """State of the iteration.

    delta : approach δ minus the offset of the heights [m].
    residual : residual ‖p − y‖/‖y‖ · c₀/c.
    sets_change : whether the sets should be changed in the next iteration.
    """

    delta: float
    residual: float
    sets_change: bool


class Directions(NamedTuple):
    """State of the conjugate gradients on one set of free points.

    total_ones : sum Σ M1, where M is the preconditioner and 1 a vector of ones.
    previous_wr : product w·r of the previous direction; infinite if there is none.
    unused_wr : product w·r of the next direction, if it has already been computed; otherwise None.
    """

    total_ones: float
    previous_wr: float = inf
    unused_wr: float | None = None


class Gradients(NamedTuple):
    """Result of several steps of conjugate gradients.

    directions : state of the conjugate gradients after the last step.
    steps : number of steps.
    longest_step : largest length c [Pa/m] that the next projection step may have, from the Rayleigh quotients of the
        directions.
    """

    directions: Directions
    steps: int
    longest_step: float


class Tangents(Protocol):
    """Tangents of a curved law, whose hardness and slope of each point change with each evaluation of the contact.

    delta : first guess of the approach minus the offset [m], or None.
    number : number of points whose tangent rises.
    """

    delta: float | None
    number: int

    def evaluate(self, n_near: int, c: float, delta: float) -> tuple[Any, ...]:
        """Set the tangents, and evaluate the contact as `projection.evaluate` does."""


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
        Tangents of a curved law, which evaluates the contact and thereby updates the linear law of the problem.

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

    Its residual must be small enough and computed with an accurate v, and it must carry the load.
    """
    if not (state.residual <= rtol and is_fresh):
        return False
    if iterations > 0:
        return True  # the projection in the iteration has made the pressure carry the load
    # the initial pressure may carry another load
    return abs(float(grid.arrays.p.sum()) - problem.load) <= _LOAD_RTOL * problem.load


class Product(NamedTuple):
    """Result of a product with K.

    lists : numbers of listed points, and the threshold.
    energy : energy of the pressure.
    load : sum Σ p of the pressure [Pa].
    total_v : sum Σ v over the points near contact [m].
    """

    lists: Lists
    energy: float
    load: float
    total_v: float


def _multiply(grid: Workspace, loops: Loops, reach: float, margin: float) -> Product:
    """Compute v = Kp + h₁, and list the points that are in contact or have v below the threshold `reach` [m]."""
    loops.respond()
    n_rows = len(grid.arrays.v)
    near, free, energy, load, total_v = loops.list_near(grid.compliance, 1.0, reach, 0, n_rows)
    return Product(Lists(near, free, reach, margin), energy, load, total_v)


def _list_near(grid: Workspace, loops: Loops, reach: float, margin: float) -> Lists:
    """Make the list of points near contact again with another threshold `reach` [m]; v is not changed."""
    n_rows = len(grid.arrays.v)
    near, free, *_sums = loops.list_near(1.0, 0.0, reach, 0, n_rows)
    return Lists(near, free, reach, margin)


def _first_evaluation(
    grid: Workspace, loops: Loops, c: float, delta: float | None = None
) -> tuple[Lists, Evaluation]:
    """List the points near contact for the initial pressure.

    delta : first guess of δ [m]. Default: the mean v of the points in contact.
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
    """Compute δ and the residual for the step length c [Pa/m], and decide whether the sets should be changed.

    Only listed points are considered, because v of all other points was above `reach` when the list was made. If δ
    exceeds `reach`, a new list is made, provided that v is accurate at all points (`is_fresh`). Steps of conjugate
    gradients only update v at listed points. After such steps, no new list is made until the next product of K with the
    pressure.
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
        if not (
            can_carry and reach < inf
        ):  # the listed points cannot carry the load, or `reach` is NaN
            reach = inf
        lists = _list_near(grid, loops, reach, margin)
    if y2 > 0.0:
        relative_difference = sqrt(r2 / y2)
    else:
        relative_difference = inf if r2 > 0.0 else 0.0
    residual = relative_difference * (
        grid.stiffness / c
    )  # approximately that for the step length c₀
    is_slow = residual > 0.5 * previous.residual
    needs_change = changed_r2 > _FRACTION * r2 or is_slow
    return lists, Evaluation(delta, residual, sets_change=n_changed > 0 and needs_change)


def _change_sets(
    grid: Workspace, loops: Loops, lists: Lists, c: float, delta: float, keep: bool
) -> tuple[Lists, float]:
    """Set p to its projection y, which changes the active sets, and compute v from the new p.

    keep : whether points that remain free keep their present pressure.

    Returns the new lists of points, and the energy of the new pressure.
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

    directions : state of the conjugate gradients after previous steps; None if the free points have changed since then.
    """
    is_long = max(grid.half_space.shape) >= _LONG
    limits = _LONG_STEPS if is_long else _STEPS
    most_steps = limits.after_change if state.sets_change else limits.without_change
    if directions is None:
        directions = Directions(loops.restart(lists.free, state.delta))
    total_ones, previous_wr, wr = directions
    first_wr = inf  # w·r of the first direction
    smallest_stiffness = inf
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
        loops.search()
        curvature, squared_length, is_made = loops.step(lists.near, lists.free, wr)
        steps += 1
        previous_wr = wr if is_made else inf
        wr = None
        if not is_made:
            break
        if curvature > 0.0:
            smallest_stiffness = min(smallest_stiffness, squared_length / curvature)
    return Gradients(Directions(total_ones, previous_wr, wr), steps, 2.0 * smallest_stiffness)

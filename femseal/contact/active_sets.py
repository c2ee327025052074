"""Solve a contact on one grid by projected active sets, with preconditioned conjugate gradients on the free points.

The energy is ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ψ(p), where ψ comes from the law. Its minimum under a load is the p that equals y for
any c > 0. Here y is the projection of p − c (v − δ) on the law, with v = Kp + h₁ and the δ for which Σ y = load. For
perfect plasticity y = clip(p − c (v − δ), 0, H). Each iteration

1. changes the sets, if y moves points out of contact, to the hardness, or back: p becomes y, and a product with K gives
   the new v;
2. lowers the energy by a few steps of conjugate gradients on the free points, which are elastic or yield and harden,
   with a product with K for each step;
3. evaluates the contact: computes δ, y and the residual ‖p − y‖/‖y‖ · c₀/c.

This is an inexact semismooth Newton method, for which there is no proof of convergence. If the energy keeps rising, or
after 60 iterations, `descent` takes over. The residual that is returned is the one that was reached.
Sources: Moré & Toraldo, SIAM J. Optim. 1, 1991, 93; Polonsky & Keer, Wear 231, 1999, 206.
"""

from math import inf, sqrt
from typing import NamedTuple

from .descent import Solution, descend
from .workspace import Loops, Problem, Workspace


class StepLimits(NamedTuple):
    """Limits of the steps of conjugate gradients in an iteration.

    after_change, without_change : most steps after the sets have changed, and if they have not. drop : fraction of the
    first squared energy norm of the residual at which the steps stop.
    """

    after_change: int
    without_change: int
    drop: float


_STEPS = StepLimits(3, 5, 0.04)
#: The limits if an axis is long, because patches in contact are then wide or far from each other: an unloading of 2048²
#: points takes 37 products in place of 48; a strip of 2 × 32768 points takes 200 in place of 400 to 1,400.
_LONG_STEPS = StepLimits(64, 64, 0.01)
#: Number of points of the longer axis from which on it is long.
_LONG = 1024
#: Number of iterations after which no step may raise the energy any more.
_MONOTONE_AFTER = 60
#: Damping below which no step may raise the energy any more; it falls when steps keep raising the energy.
_MONOTONE_BELOW = 0.1
#: Smallest damping.
_LEAST_DAMPING = 1e-3
#: Relative rise of the energy that is more than a rounding error.
_RISE = 1e-13
#: w·r that is a rounding error, relative to the value for a residual of δ at all free points.
_FLAT = 1e-30
#: The sets are kept while the residual halves, and the points that would leave them contribute at most this fraction of
#: its square.
_FRACTION = 0.1
#: Relative error of the load of the initial pressure up to which it may be the solution.
_LOAD_RTOL = 1e-10


class Lists(NamedTuple):
    """Numbers of points on the lists of a grid.

    near : points near contact, which are in contact or have v below `reach` [m]. free : points whose pressure is
    unknown. margin : `reach` minus δ when the list was made [m].
    """

    near: int
    free: int
    reach: float
    margin: float


class Evaluation(NamedTuple):
    """State of the iteration: approach δ minus the offset [m], residual, and whether the sets should be changed."""

    delta: float
    residual: float
    sets_change: bool


class Directions(NamedTuple):
    """State of the conjugate gradients on one set of free points.

    total_ones : Σ M1, with the preconditioner M. former : w·r of the former direction; infinite if there is none.
    ready : w·r of a direction that has been made, but along which no step was made yet; None if there is none.
    """

    total_ones: float
    former: float = inf
    ready: float | None = None


class Gradients(NamedTuple):
    """Result of some steps of conjugate gradients.

    directions : state at their end. steps : their number. longest : largest step c of the next projection that the
    Rayleigh quotients of the directions allow [Pa/m].
    """

    directions: Directions
    steps: int
    longest: float


def solve_active_sets(grid: Workspace, problem: Problem, rtol: float, limit: int) -> Solution:
    """Solve a contact problem, starting from the pressure in the memory of the grid.

    Parameters
    ----------
    grid : Workspace
        Grid with the initial pressure, see `Workspace.start`, which is replaced by the solution.
    problem : Problem
        Gap, law and load.
    rtol : float
        Residual to reach.
    limit : int
        Most iterations.

    Returns
    -------
    Solution
    """
    loops = grid.loops(problem)
    c0 = grid.stiffness
    step = c0
    shortest_step = c0 / (4 * max(grid.half_space.shape))
    lists, state = _first_evaluation(grid, loops, c0)
    iterations = 0
    products = 1
    damping = 1.0
    energy = inf
    is_fresh = True  # v belongs to p, up to rounding
    directions = None
    lists, state = _evaluate(grid, loops, lists, state, step, is_fresh)
    state = state._replace(sets_change=True)
    while not _is_solved(grid, problem, state, rtol, is_fresh, iterations):
        is_converged = state.residual <= rtol
        if iterations >= limit and not is_converged:
            break
        sets_repeat = iterations >= _MONOTONE_AFTER or damping < _MONOTONE_BELOW
        if sets_repeat and not is_converged:
            _change_sets(grid, loops, lists, step, state.delta, keep=True)
            rest = descend(grid, problem, state.delta, rtol, limit - iterations)
            return Solution(
                rest.delta,
                rest.residual,
                iterations + rest.iterations,
                products + 1 + rest.products,
            )
        iterations += 1
        if state.sets_change or is_converged or lists.free < 2:
            keep = iterations > 1
            former_energy = energy
            lists, energy = _change_sets(grid, loops, lists, step, state.delta, keep)
            products += 1
            is_fresh = True
            if energy > former_energy + _RISE * abs(former_energy):
                damping = max(damping / 2, _LEAST_DAMPING)
            else:
                damping = min(1.0, 1.25 * damping)
            directions = None
        if is_converged:
            step = c0  # with which the returned residual is defined
        elif lists.free >= 2:
            gradients = _conjugate_gradients(grid, loops, lists, state, directions)
            directions = gradients.directions
            products += gradients.steps
            is_fresh = is_fresh and gradients.steps == 0
            step = max(shortest_step, min(c0, damping * gradients.longest))
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
    """Tell whether the residual is reached, by a pressure whose v is known and which carries the load."""
    if not (state.residual <= rtol and is_fresh):
        return False
    if iterations > 0:
        return True  # a projected pressure carries the load, whereas the initial one may not
    return abs(float(grid.arrays.p.sum()) - problem.load) <= _LOAD_RTOL * problem.load


class Product(NamedTuple):
    """Result of a product with K.

    lists : points near contact. energy : of the pressure. load : Σ p [Pa]. total_v : Σ v over the listed points [m].
    """

    lists: Lists
    energy: float
    load: float
    total_v: float


def _multiply(grid: Workspace, loops: Loops, reach: float, margin: float) -> Product:
    """Compute v = Kp + h₁, and list the points that are in contact or have v below `reach` [m]."""
    loops.respond()
    n_rows = len(grid.arrays.v)
    near, free, energy, load, total_v = loops.list_near(grid.compliance, 1.0, reach, 0, n_rows)
    return Product(Lists(near, free, reach, margin), energy, load, total_v)


def _list_near(grid: Workspace, loops: Loops, reach: float, margin: float) -> Lists:
    """List the points near contact again, with another reach [m], for the same v."""
    n_rows = len(grid.arrays.v)
    near, free, *_sums = loops.list_near(1.0, 0.0, reach, 0, n_rows)
    return Lists(near, free, reach, margin)


def _first_evaluation(grid: Workspace, loops: Loops, c: float) -> tuple[Lists, Evaluation]:
    """List the points near contact for the initial pressure, and guess δ as the mean v of the points in contact."""
    product = _multiply(grid, loops, -inf, 0.0)
    n_contact = max(product.lists.near, 1)  # a very small load may be lost on the coarser grids
    delta = product.total_v / n_contact
    margin = 0.5 * product.load / (n_contact * c)
    return _list_near(grid, loops, delta + margin, margin), Evaluation(delta, inf, True)


def _evaluate(
    grid: Workspace, loops: Loops, lists: Lists, former: Evaluation, c: float, is_fresh: bool
) -> tuple[Lists, Evaluation]:
    """Find δ and the residual with the step c [Pa/m], and decide whether the sets should be changed.

    Points that are not on the list had v above `reach` when the list was made. If δ exceeds `reach`, a new list is
    needed. This requires v of all points, so that after steps of conjugate gradients it waits for the next product with
    p (`is_fresh`).
    """
    delta = former.delta
    while True:
        delta, carried, r2, y2, changed, changed2 = loops.look(lists.near, c, delta)
        if (carried and delta <= lists.reach) or not is_fresh or lists.reach == inf:
            break
        margin = max(4.0 * lists.margin, delta - lists.reach)
        reach = delta + margin
        is_finite = carried and reach < inf  # reach may be NaN too
        lists = _list_near(grid, loops, reach if is_finite else inf, margin)
    if y2 > 0.0:
        relative = sqrt(r2 / y2)
    else:
        relative = inf if r2 > 0.0 else 0.0
    residual = relative * (grid.stiffness / c)  # approximately that for the step c₀
    matters = changed2 > _FRACTION * r2 or residual > 0.5 * former.residual
    return lists, Evaluation(delta, residual, sets_change=changed > 0 and matters)


def _change_sets(
    grid: Workspace, loops: Loops, lists: Lists, c: float, delta: float, keep: bool
) -> tuple[Lists, float]:
    """Project p on the law and the load, which decides which points are free, and compute v.

    keep : whether points that remain free keep their pressure. Returns the lists of points, and the energy.
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
    """Make a few steps of conjugate gradients on the free points.

    directions : state of the former steps on the same free points; None if the sets have changed.
    """
    is_long = max(grid.half_space.shape) >= _LONG
    limits = _LONG_STEPS if is_long else _STEPS
    most_steps = limits.after_change if state.sets_change else limits.without_change
    if directions is None:
        directions = Directions(loops.restart(lists.free, state.delta))
    total_ones, former, ready = directions
    first = inf  # w·r of the first direction
    smallest_stiffness = inf
    steps = 0
    while steps < most_steps:
        if ready is None:
            ready = loops.turn(lists.free, former, total_ones)
        if steps == 0:
            first = ready
            # the residual vanishes on the free points, up to rounding, so that only the sets can change
            if not first > _FLAT * state.delta**2 * total_ones:
                break
        if not (ready > 0.0 and ready >= limits.drop * first):
            break
        loops.search()
        curvature, length, is_made = loops.step(lists.near, lists.free, ready)
        steps += 1
        former = ready if is_made else inf
        ready = None
        if not is_made:
            break
        if curvature > 0.0:
            smallest_stiffness = min(smallest_stiffness, length / curvature)
    return Gradients(Directions(total_ones, former, ready), steps, 2.0 * smallest_stiffness)

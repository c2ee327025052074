"""Contact on one grid: projected active sets, and preconditioned conjugate gradients on the free points.

The energy is ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ψ(p), ψ that of the law. Its minimum under a load is where p = y(δ) for any c > 0: y
is the projection of p − c (v − δ) on the law, with v = Kp + h₁ and the δ that keeps Σ y = load; for perfect plasticity
y = clip(p − c (v − δ), 0, H). Each iteration

1. changes the sets where y moves points out of contact, to the hardness or back: p becomes y, and a product with K
   gives the new v;
2. lowers the energy by a few steps of conjugate gradients on the free points (elastic, or yielding on a slope), with a
   product with K each;
3. looks at the contact: computes δ, y and the residual ‖p − y‖/‖y‖ · c₀/c.

This is an inexact semismooth Newton method. There is no proof of convergence: where the energy keeps rising, or after
60 iterations, `descent` takes over, and the residual returned is the one reached.
Sources: Moré & Toraldo, SIAM J. Optim. 1, 1991, 93; Polonsky & Keer, Wear 231, 1999, 206.
"""

from math import inf, sqrt
from typing import NamedTuple

from .descent import Solution, descend
from .workspace import Loops, Problem, Workspace

#: Steps of conjugate gradients after a change of the sets, and without one, and the fraction to which the squared
#: energy norm of the residual falls in them at most.
_STEPS = 3, 5, 0.04
#: The same where an axis is long, as patches in contact are wide or far from each other: an unloading of 2048² points
#: takes 37 products, not 48; a strip of 2 × 32768 points takes 200, not 400 to 1,400.
_LONG_STEPS = 64, 64, 0.01
#: Points of the longer axis from which it is long.
_LONG = 1024
#: Iterations, and damping of steps that keep raising the energy, after which no step may raise it.
_MONOTONE_AFTER, _MONOTONE_BELOW = 60, 0.1
#: Smallest damping.
_LEAST_DAMPING = 1e-3
#: w·r that is a rounding error, relative to that of δ at all free points.
_FLAT = 1e-30
#: Sets stay while points that would leave them have at most this fraction of the squared residual, and it halves.
_FRACTION = 0.1
#: The initial pressure is the solution only if its load is right to this relative error.
_LOAD_RTOL = 1e-10


class Lists(NamedTuple):
    """Numbers of points on the lists of a grid.

    near : points near contact, in contact or with v below `reach` [m]. free : points whose pressure is unknown.
    margin : reach less δ when the list was made [m].
    """

    near: int
    free: int
    reach: float
    margin: float


class Look(NamedTuple):
    """Approach δ less the offset [m], residual, and whether the sets are to be changed."""

    delta: float
    residual: float
    sets_change: bool


class Directions(NamedTuple):
    """Conjugate gradients on one set of free points.

    total_ones : Σ M1. former : w·r of the direction before; inf, there is none. ready : w·r of a direction that is
    made but not gone yet; None, there is none.
    """

    total_ones: float
    former: float = inf
    ready: float | None = None


class Gradients(NamedTuple):
    """Steps of conjugate gradients: where they ended, their number, and the largest step c that they allow [Pa/m]."""

    directions: Directions
    steps: int
    longest: float


def solve_active_sets(grid: Workspace, problem: Problem, rtol: float, limit: int) -> Solution:
    """Solve a contact problem from the pressure that the grid holds, which then holds the solution.

    Parameters
    ----------
    grid : with the initial pressure; see `Workspace.start`.
    problem : gap, law and load.
    rtol : residual to reach.
    limit : most iterations.
    """
    loops = grid.loops(problem)
    c0 = step = grid.stiffness
    least = c0 / (4 * max(grid.half_space.shape))
    lists, look = _first_look(grid, loops, c0)
    iterations, products = 0, 1
    damping, energy = 1.0, inf
    is_fresh = True  # v belongs to p, to rounding
    directions = None
    lists, look = _look(grid, loops, lists, look, step, is_fresh)
    look = look._replace(sets_change=True)
    while not _is_solved(grid, problem, look, rtol, is_fresh, iterations):
        is_converged = look.residual <= rtol
        if iterations >= limit and not is_converged:
            break
        circles = iterations >= _MONOTONE_AFTER or damping < _MONOTONE_BELOW
        if circles and not is_converged:
            _change_sets(grid, loops, lists, step, look.delta, keep=True)
            rest = descend(grid, problem, look.delta, rtol, limit - iterations)
            return Solution(
                rest.delta,
                rest.residual,
                iterations + rest.iterations,
                products + 1 + rest.products,
            )
        iterations += 1
        if look.sets_change or is_converged or lists.free < 2:
            keep = iterations > 1
            former = energy
            lists, energy = _change_sets(grid, loops, lists, step, look.delta, keep)
            products += 1
            is_fresh = True
            rises = energy > former + 1e-13 * abs(former)
            damping = max(damping / 2, _LEAST_DAMPING) if rises else min(1.0, 1.25 * damping)
            directions = None
        if is_converged:
            step = c0  # the returned residual follows its definition
        elif lists.free >= 2:
            gradients = _conjugate_gradients(grid, loops, lists, look, directions)
            directions = gradients.directions
            products += gradients.steps
            is_fresh = is_fresh and gradients.steps == 0
            step = max(least, min(c0, damping * gradients.longest))
        lists, look = _look(grid, loops, lists, look, step, is_fresh)
    return Solution(look.delta, look.residual, iterations, products)


def _is_solved(
    grid: Workspace, problem: Problem, look: Look, rtol: float, is_fresh: bool, iterations: int
) -> bool:
    """Return whether the residual is reached by a pressure whose v is known and that carries the load."""
    if not (look.residual <= rtol and is_fresh):
        return False
    if iterations > 0:
        return True  # a projected pressure carries the load; the initial one may miss it
    return abs(float(grid.arrays.p.sum()) - problem.load) <= _LOAD_RTOL * problem.load


def _product(
    grid: Workspace, loops: Loops, reach: float, margin: float
) -> tuple[Lists, float, float, float]:
    """Find v = Kp + h₁ and list the points near contact; returns the lists, energy, Σ p, and Σ v on the list."""
    loops.respond()
    near, free, energy, load, total = loops.list_near(
        grid.compliance, 1.0, reach, 0, len(grid.arrays.v)
    )
    return Lists(near, free, reach, margin), energy, load, total


def _list_near(grid: Workspace, loops: Loops, reach: float, margin: float) -> Lists:
    """List the points near contact again, with another reach."""
    near, free, *_ = loops.list_near(1.0, 0.0, reach, 0, len(grid.arrays.v))
    return Lists(near, free, reach, margin)


def _first_look(grid: Workspace, loops: Loops, c: float) -> tuple[Lists, Look]:
    """List the points near contact of the initial pressure, with a first guess of the approach: the mean v of these."""
    lists, _, load, total = _product(grid, loops, -inf, 0.0)
    in_contact = max(lists.near, 1)  # none where coarser grids lose so light a load
    delta = total / in_contact
    margin = 0.5 * load / (in_contact * c)
    return _list_near(grid, loops, delta + margin, margin), Look(delta, inf, True)


def _look(
    grid: Workspace, loops: Loops, lists: Lists, former: Look, c: float, is_fresh: bool
) -> tuple[Lists, Look]:
    """Find δ and the residual, and decide whether the sets are to be changed.

    Points that are not on the list had v above `reach` when the list was made. If δ exceeds `reach`, a new list is
    made. It needs v of all points; after a step of conjugate gradients it waits for the next product with p.
    """
    delta = former.delta
    while True:
        delta, carried, r2, y2, changed, changed2 = loops.look(lists.near, c, delta)
        if (carried and delta <= lists.reach) or not is_fresh or lists.reach == inf:
            break
        margin = max(4.0 * lists.margin, delta - lists.reach)
        reach = delta + margin
        is_finite = carried and reach < inf  # not NaN either
        lists = _list_near(grid, loops, reach if is_finite else inf, margin)
    if y2 > 0.0:
        relative = sqrt(r2 / y2)
    else:
        relative = inf if r2 > 0.0 else 0.0
    residual = relative * (grid.stiffness / c)  # about the residual for the step c₀
    # keep the sets as long as the residual falls and the points that would leave them have a small fraction of it
    matters = changed2 > _FRACTION * r2 or residual > 0.5 * former.residual
    return lists, Look(delta, residual, changed > 0 and matters)


def _change_sets(
    grid: Workspace, loops: Loops, lists: Lists, c: float, delta: float, keep: bool
) -> tuple[Lists, float]:
    """Project p on the bounds and the load, which decides which points are free, and find v; returns the energy too."""
    loops.project(lists.near, lists.free, c, delta, keep)
    lists, energy, _, _ = _product(grid, loops, delta + lists.margin, lists.margin)
    return lists, energy


def _conjugate_gradients(
    grid: Workspace, loops: Loops, lists: Lists, look: Look, directions: Directions | None
) -> Gradients:
    """Make a few steps on the free points, going on with `directions` where the sets are the same.

    The Rayleigh quotients d·Kd/d·d of the steps limit the step c of the next look.
    """
    is_long = max(grid.half_space.shape) >= _LONG
    after_change, without, drop = _LONG_STEPS if is_long else _STEPS
    if directions is None:
        directions = Directions(loops.restart(lists.free, look.delta))
    total_ones, former, ready = directions
    first = smallest = inf
    steps = 0
    while steps < (after_change if look.sets_change else without):
        if ready is None:
            ready = loops.turn(lists.free, former, total_ones)
        if steps == 0:
            first = ready
            # flat to rounding on the free points: the sets have to change
            if not first > _FLAT * look.delta**2 * total_ones:
                break
        if not (ready > 0.0 and ready >= drop * first):
            break
        loops.search()
        curvature, length, is_made = loops.step(lists.near, lists.free, ready)
        steps += 1
        former = ready if is_made else inf
        ready = None
        if not is_made:
            break
        if curvature > 0.0:
            smallest = min(smallest, length / curvature)
    return Gradients(Directions(total_ones, former, ready), steps, 2.0 * smallest)

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
returned pressure.

Products with the directions of conjugate gradients are computed in single precision. Products with the pressure are
computed in single precision only as long as the residual is much larger than the rounding error of such a product. The
last product with the pressure is always computed in double precision.

Sources: Moré & Toraldo, SIAM J. Optim. 1, 1991, 93; Polonsky & Keer, Wear 231, 1999, 206.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Literal, NamedTuple

import numpy as np

from .conjugate_gradients import ConjugateSteps, StepLimits, conjugate_gradients
from .descent import Solution, descend
from .law_on_grid import ActiveSets, LawOnGrid, StraightLaw
from .workspace import Loops, Problem, Workspace

#: Limits of the conjugate-gradient steps in an iteration, for grids without and with a long axis. Along a long axis,
#: patches may be large or far from each other. Longer iterations then save products: a strip of 2 × 32768 points takes
#: 200 instead of 400 to 1,400, and 512² points, a third of which are in contact, take 44 instead of 49.
_STEPS, _LONG_STEPS = StepLimits(64, 0.04), StepLimits(64, 0.01)
#: An axis is long from this number of points on.
_LONG = 512
#: Number of iterations after which `descent`, whose steps never increase the energy, is used.
_MONOTONE_AFTER = 60
#: `descent` is also used when the damping is below this value. The damping is reduced whenever the energy increases.
_MONOTONE_BELOW = 0.1
#: Smallest damping.
_LEAST_DAMPING = 1e-3
#: Relative increase of the energy that cannot be explained by rounding errors.
_RISE = 1e-13
#: Residual down to which products with the pressure are computed in single precision. The rounding error of such a
#: product changes the residual by 1e-6 on 512² to 1500² points, and by 1e-4 on strips of 1 × 65536 points.
_SINGLE_ABOVE = 1e-3
#: Residual below which v is computed in double precision, even if the sets do not change.
_SINGLE_UNTIL = 1e-4
#: Relative increase of the energy that can be explained by products in single precision, whose error is up to 1e-7.
_SINGLE_RISE = 1e-6
#: Smallest number of points of a grid on which single precision saves time.
_SINGLE_FROM = 2**14
#: The sets are not changed as long as each iteration reduces the residual to a half, and the points that would change
#: sets contribute at most this fraction of the squared residual.
_FRACTION = 0.1
#: Relative error of the load up to which the initial pressure can be accepted as the solution.
_LOAD_RTOL = 1e-10


class EnergyReduction(NamedTuple):
    """Result of the second part of an iteration, the reduction of the energy by conjugate gradients.

    step : length c [Pa/m] of the next projection step.
    conjugate_steps : steps of conjugate gradients that can be continued; None to restart the conjugate gradients.
    is_fresh : whether v was computed from p by a product. Conjugate gradients only update v at points near contact.
    products : number of products with K.
    """

    step: float
    conjugate_steps: ConjugateSteps | None = None
    is_fresh: bool = True
    products: int = 0


class Evaluation(NamedTuple):
    """Result of the third part of an iteration, the evaluation of the contact.

    delta : approach δ [m], minus the height that the solver has subtracted from the undeformed gap.
    residual : residual ‖p − y‖/‖y‖ · c₀/c.
    sets_change : whether the active sets should be changed in the next iteration.
    """

    delta: float
    residual: float
    sets_change: bool


#: What the solver does next, see `_next_action`:
#: - "stop": the pressure is the solution, or all iterations are used up.
#: - "project and stop": project the pressure, which is accurate enough for a coarse grid.
#: - "descend": project the pressure, and continue by the method in `descent`.
#: - "verify": project the pressure, which appears to be the solution, and recompute its residual from a product with K.
#: - "change sets": change the active sets, and reduce the energy.
#: - "reduce the energy": reduce the energy with the present active sets.
Action = Literal[
    "stop", "project and stop", "descend", "verify", "change sets", "reduce the energy"
]


class _Solver(NamedTuple):
    """What does not change during the iteration.

    grid : work arrays of the grid.
    problem : gap, law and load.
    loops : compiled loops.
    law : contact law.
    limits : limits of the conjugate-gradient steps.
    rtol : target residual.
    iteration_limit : largest number of iterations.
    is_coarse : whether the solution is only a first guess on a finer grid, see `solve_active_sets`.
    shortest_step : smallest length c [Pa/m] of a projection step.
    allows_single : whether products with the pressure may be computed in single precision.
    """

    grid: Workspace
    problem: Problem
    loops: Loops
    law: LawOnGrid
    limits: StepLimits
    rtol: float
    iteration_limit: int
    is_coarse: bool
    shortest_step: float
    allows_single: bool


def solve_active_sets(
    grid: Workspace,
    problem: Problem,
    rtol: float,
    limit: int,
    tangents: LawOnGrid | None = None,
    is_coarse: bool = False,
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
    tangents : LawOnGrid, optional
        Tangents of a curved law. They update the hardness and slope of each point in `problem`. By default, the law of
        `problem` remains the same.
    is_coarse : bool
        Whether only the pressure and the approach of the solution are needed, as a first guess on a finer grid. The
        last product is then left out, so that the displacement on the grid is not valid.

    Returns
    -------
    Solution
    """
    loops = grid.loops(problem)
    law = StraightLaw(loops) if tangents is None else tangents
    longest_axis = max(grid.half_space.shape)
    solver = _Solver(
        grid,
        problem,
        loops,
        law,
        limits=_LONG_STEPS if longest_axis >= _LONG else _STEPS,
        rtol=rtol,
        iteration_limit=limit,
        is_coarse=is_coarse,
        shortest_step=grid.stiffness / (4 * longest_axis),
        allows_single=law.allows_single and grid.pressure.size >= _SINGLE_FROM,
    )
    sets, delta = _initial_sets(solver)
    reduction = EnergyReduction(step=grid.stiffness)
    evaluation = Evaluation(delta, residual=inf, sets_change=True)
    sets, evaluation = _evaluate(solver, sets, reduction, evaluation)
    evaluation = evaluation._replace(sets_change=True)
    iterations = 0
    products = 1
    while True:
        action = _next_action(solver, sets, reduction, evaluation, iterations)
        if action == "stop":
            break
        if action == "project and stop":
            loops.project(sets.n_near, sets.n_free, reduction.step, evaluation.delta, True)
            break
        if action == "descend":
            loops.project(sets.n_near, sets.n_free, reduction.step, evaluation.delta, True)
            solution = descend(grid, problem, evaluation.delta, rtol, limit - iterations)
            return solution.after(iterations, products)
        iterations += 1
        keep = iterations > 1  # no point keeps its initial pressure, which is only a first guess
        if action == "verify":
            sets = _change_sets(solver, sets, reduction, evaluation, keep, in_single=False)
            reduction = EnergyReduction(grid.stiffness)  # the returned residual is defined with c₀
            products += 1
        else:
            if action == "change sets":
                in_single = _is_single_enough(solver, sets, evaluation)
                sets = _change_sets(solver, sets, reduction, evaluation, keep, in_single)
                reduction = EnergyReduction(reduction.step)
                products += 1
            if sets.n_free >= 2:
                reduction = _reduce_energy(solver, sets, reduction, evaluation)
                products += reduction.products
        sets, evaluation = _evaluate(solver, sets, reduction, evaluation)
    return Solution(evaluation.delta, evaluation.residual, iterations, products)


def _next_action(
    solver: _Solver,
    sets: ActiveSets,
    reduction: EnergyReduction,
    evaluation: Evaluation,
    iterations: int,
) -> Action:
    """Decide what the solver does next, from the results of the last iteration.

    iterations : number of iterations so far.
    """
    if evaluation.residual <= solver.rtol:
        has_accurate_v = reduction.is_fresh and not sets.in_single
        # only the initial pressure may carry another load: the projection in each iteration restores the load
        if has_accurate_v and (iterations > 0 or _carries_load(solver)):
            return "stop"
        return "project and stop" if solver.is_coarse else "verify"
    if iterations >= solver.iteration_limit:
        return "stop"
    may_cycle = iterations >= _MONOTONE_AFTER or sets.damping < _MONOTONE_BELOW
    if may_cycle and solver.law.can_descend:
        return "descend"
    is_stale = sets.in_single and evaluation.residual < _SINGLE_UNTIL
    if evaluation.sets_change or is_stale or sets.n_free < 2:
        return "change sets"
    return "reduce the energy"


def _carries_load(solver: _Solver) -> bool:
    """Return whether the sum of the pressures is equal to the load of the problem."""
    load = solver.problem.load
    return abs(float(solver.grid.points.p.sum()) - load) <= _LOAD_RTOL * load


def _is_single_enough(solver: _Solver, sets: ActiveSets, evaluation: Evaluation) -> bool:
    """Return whether single precision suffices for the next product with the pressure."""
    # if the residual does not fall, rounding errors may be the reason
    is_rough = _SINGLE_ABOVE < evaluation.residual < sets.residual
    return solver.allows_single and is_rough


class Product(NamedTuple):
    """Results of a product of K with the pressure, and of the search for points near contact.

    n_near : number of points near contact.
    n_free : number of free points.
    energy : energy of the pressure.
    load : sum Σ p of the pressures of all points [Pa].
    total_v : sum Σ v over the points near contact [m].
    """

    n_near: int
    n_free: int
    energy: float
    load: float
    total_v: float


def _multiply(solver: _Solver, reach: float, in_single: bool) -> Product:
    """Compute v = Kp + h₁, and list the points near contact: points in contact, and points with v below `reach` [m].

    in_single : whether to compute the product Kp in single precision.
    """
    grid, loops = solver.grid, solver.loops
    n_rows = len(grid.points.v)
    if in_single:
        grid.points.dense[:] = grid.points.p
        loops.search()
        return Product(*loops.list_near_in_single(grid.compliance, 1.0, reach, 0, n_rows))
    loops.respond()
    return Product(*loops.list_near(grid.compliance, 1.0, reach, 0, n_rows))


def _list_again(solver: _Solver, sets: ActiveSets, reach: float, margin: float) -> ActiveSets:
    """List the points near contact with another threshold `reach` [m]. The values of v are not changed."""
    grid, loops = solver.grid, solver.loops
    n_rows = len(grid.points.v)
    if sets.in_single:
        # the grid still contains Kp
        n_near, n_free, *_sums = loops.list_near_in_single(grid.compliance, 1.0, reach, 0, n_rows)
    else:
        n_near, n_free, *_sums = loops.list_near(1.0, 0.0, reach, 0, n_rows)
    return sets._replace(n_near=n_near, n_free=n_free, reach=reach, margin=margin)


def _initial_sets(solver: _Solver) -> tuple[ActiveSets, float]:
    """List the points near contact for the initial pressure; return the sets, and a first guess of the approach [m].

    If the problem has no first guess of the approach, it is the mean of v over the points in contact.
    """
    grid, problem = solver.grid, solver.problem
    # with a very small load there may be no point in contact on a coarse grid
    n_contact = max(int(np.count_nonzero(grid.points.state)), 1)
    # half of the mean pressure in the contact, converted to a length by the stiffness c₀
    margin = 0.5 * problem.load / (n_contact * grid.stiffness)
    delta = problem.first_delta
    if delta is None:
        # lists the points in contact only
        product = _multiply(solver, reach=-inf, in_single=False)
        delta = product.total_v / n_contact
        sets = ActiveSets(product.n_near, product.n_free, reach=-inf, margin=margin)
        return _list_again(solver, sets, delta + margin, margin), delta
    # the initial pressure is that of a coarser grid, so that the residual is large
    in_single = solver.allows_single
    reach = delta + margin
    product = _multiply(solver, reach, in_single)
    sets = ActiveSets(product.n_near, product.n_free, reach, margin, in_single=in_single)
    return sets, delta


def _change_sets(
    solver: _Solver,
    sets: ActiveSets,
    reduction: EnergyReduction,
    evaluation: Evaluation,
    keep: bool,
    in_single: bool,
) -> ActiveSets:
    """Change the active sets: set the pressure p to the projection y, and compute v from the new pressure.

    keep : whether a free point keeps its pressure if it remains elastic or continues to harden.
    in_single : whether to compute v in single precision.
    """
    delta = evaluation.delta
    solver.loops.project(sets.n_near, sets.n_free, reduction.step, delta, keep)
    reach = delta + sets.margin
    product = _multiply(solver, reach, in_single)
    rounding = _SINGLE_RISE if in_single or sets.in_single else _RISE
    if solver.law.has_risen(sets, product.energy, evaluation.residual, rounding):
        damping = max(sets.damping / 2, _LEAST_DAMPING)
    else:
        damping = min(1.0, 1.25 * sets.damping)
    return ActiveSets(
        product.n_near,
        product.n_free,
        reach,
        sets.margin,
        product.energy,
        evaluation.residual,
        damping,
        in_single,
    )


def _reduce_energy(
    solver: _Solver, sets: ActiveSets, reduction: EnergyReduction, evaluation: Evaluation
) -> EnergyReduction:
    """Perform a few steps of conjugate gradients, and choose the length of the next projection step.

    The longest permissible projection step is twice the smallest Rayleigh quotient d·d/(d·Kd) of the search directions
    d. The symbols are those of the module `conjugate_gradients`. The pressure and v at the points near contact are
    updated in the arrays of `solver.grid`; v is then no longer `is_fresh`, that is, a product of K with the pressure.
    """
    # w·r falls about like the squared residual, which need not become smaller than the target residual
    drop = max(solver.limits.drop, (solver.rtol / evaluation.residual) ** 2)
    result = conjugate_gradients(
        solver.loops,
        sets.n_near,
        sets.n_free,
        evaluation.delta,
        StepLimits(solver.limits.steps, drop),
        reduction.conjugate_steps if solver.law.keeps_directions else None,
    )
    longest_step = min(solver.grid.stiffness, sets.damping * 2.0 * result.least_stiffness)
    is_fresh = reduction.is_fresh and result.steps == 0
    step = max(solver.shortest_step, longest_step)
    return EnergyReduction(
        step=step, conjugate_steps=result, is_fresh=is_fresh, products=result.steps
    )


def _evaluate(
    solver: _Solver, sets: ActiveSets, reduction: EnergyReduction, previous: Evaluation
) -> tuple[ActiveSets, Evaluation]:
    """Compute δ and the residual, and decide whether the active sets should be changed.

    Only the listed points near contact are considered: at all other points, v was above `reach` when the list was made.
    If δ exceeds `reach`, a new list is made, provided that v is accurate at all points (`is_fresh`). Conjugate-gradient
    steps update v only at the listed points. After such a step, no new list is therefore made until K is next
    multiplied by the pressure.
    """
    c = reduction.step
    delta = previous.delta
    while True:
        delta, can_carry, squared_difference, squared_projection, n_changed, squared_change = (
            solver.law.evaluate(sets.n_near, c, delta)
        )
        is_complete = can_carry and delta <= sets.reach
        lists_all_points = sets.reach == inf
        if is_complete or lists_all_points or not reduction.is_fresh:
            break
        # list more points: the margin grows at least by a factor of 4, so that few new lists are needed
        margin = max(4.0 * sets.margin, delta - sets.reach)
        reach = delta + margin
        if not (can_carry and reach < inf):
            # the listed points cannot carry the load, or `reach` is NaN: list all points
            reach = inf
        sets = _list_again(solver, sets, reach, margin)
    if squared_projection > 0.0:
        relative_difference = sqrt(squared_difference / squared_projection)  # ‖p − y‖/‖y‖
    else:
        relative_difference = inf if squared_difference > 0.0 else 0.0
    # approximately the residual for the step length c₀
    residual = relative_difference * (solver.grid.stiffness / c)
    is_slow = residual > 0.5 * previous.residual
    is_wrong_state_important = squared_change > _FRACTION * squared_difference
    needs_change = is_wrong_state_important or is_slow
    return sets, Evaluation(delta, residual, sets_change=n_changed > 0 and needs_change)

"""Reduce the energy of a contact by conjugate gradients on the free points, whose bounds are ignored.

The residual of a free point is r = δ − v − a (p − H), with the compliance a = 1/h of a point that hardens, and a = 0
for an elastic point. The preconditioned residual w = M r − λ M1 has the sum 0, so that the load remains constant. The
search direction is d = w + β d, with β = w·r / (w·r of the previous direction). The compiled loops are those of
`gradient_steps`.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from .workspace import Loops

#: Value of w·r below which the residual is a rounding error, relative to w·r for the residual δ at all free points.
_FLAT = 1e-30


class StepLimits(NamedTuple):
    """Limits of a few conjugate-gradient steps.

    steps : maximum number of steps.
    drop : the steps end when w·r (the squared energy norm of the residual) falls below this fraction of its initial
        value.
    """

    steps: int
    drop: float


class ConjugateSteps(NamedTuple):
    """Result of a few steps of conjugate gradients, and what is needed to continue them on the same free points.

    steps : number of steps, each with a product of K with a direction.
    least_stiffness : smallest Rayleigh quotient d·d/(d·Kd) of the directions d [Pa/m]; infinite without a step.
    total_ones : sum of all components of M1, the preconditioner M applied to a vector of ones.
    next_wr : product w·r of the next direction, which has been computed but not yet used.
    """

    steps: int
    least_stiffness: float
    total_ones: float
    next_wr: float


def conjugate_gradients(
    loops: Loops,
    n_near: int,
    n_free: int,
    delta: float,
    limits: StepLimits,
    previous: ConjugateSteps | None = None,
) -> ConjugateSteps:
    """Perform a few steps of conjugate gradients on the free points.

    The steps change p and v in the lists of the points near contact.

    Parameters
    ----------
    loops : Loops
        Compiled loops, which contain the lists of points.
    n_near, n_free : int
        Numbers of points near contact and of free points.
    delta : float
        Approach δ [m].
    limits : StepLimits
        When to stop.
    previous : ConjugateSteps, optional
        Earlier steps on the same free points, which are continued. By default, the iteration begins with the steepest
        descent.

    Returns
    -------
    ConjugateSteps
    """
    if previous is None:
        total_ones = loops.prepare_directions(n_free, delta)
        # without a previous direction, only the first direction is computed
        *_no_step, first_wr = loops.gradient_step(n_near, n_free, inf, total_ones)
    else:
        total_ones = previous.total_ones
        first_wr = previous.next_wr
    # if the residual on the free points is only a rounding error, only a change of the sets can help
    most_steps = limits.steps if first_wr > _FLAT * delta**2 * total_ones else 0
    last_wr = limits.drop * first_wr
    wr = first_wr
    least_stiffness = inf
    steps = 0
    while steps < most_steps and wr > 0.0 and wr >= last_wr:
        loops.search()  # computes Kd
        curvature, squared_length, is_made, wr = loops.gradient_step(n_near, n_free, wr, total_ones)
        steps += 1
        if not is_made:
            break
        if curvature > 0.0:
            least_stiffness = min(least_stiffness, squared_length / curvature)
    return ConjugateSteps(steps, least_stiffness, total_ones, wr)

"""Solve fixed-point problems, for example for a fluid pressure and a permeability that depend on each other."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from .errors import NotConverged

Solution = TypeVar("Solution")
#: Largest number of solutions of one problem.
_MOST_SOLUTIONS = 40
#: Number of solutions after which changes of the state are halved. Without this damping the state may oscillate
#: indefinitely, for example if the fluid itself opens the last paths through which it flows.
_UNDAMPED = 8


@dataclass(frozen=True, eq=False)
class FixedPoint(Generic[Solution]):
    """Solution of a fixed-point problem.

    Parameters
    ----------
    solution : object
        Last solution, as returned by `solve`.
    coefficient : object
        Coefficient for which the last solution was computed.
    rate : float
        Rate in the last solution, for example a flow rate. The iteration stops when the rate has converged.
    solutions : int
        Number of calls of `solve`.
    error : float
        Estimated relative error of the rate, 0 if the rate is 0.
    """

    solution: Solution
    coefficient: Any
    rate: float
    solutions: int
    error: float


def fixed_point(
    coefficient: Callable[[Any], Any],
    solve: Callable[[Any], tuple[float, Any, Solution]],
    state: Any,
    *,
    rtol: float,
    name: str = "flow",
) -> FixedPoint[Solution]:
    """Solve a problem whose coefficient depends on its solution, by Picard iteration.

    Each iteration computes the coefficient from the previous state, and then solves the problem with it. The iteration
    stops when the rate has converged.

    Parameters
    ----------
    coefficient : callable
        Function that computes the coefficient from a state, for example permeabilities from fluid pressures.
    solve : callable
        Function that solves the problem for a given coefficient. It returns the rate, the state (from which the next
        coefficient is computed) and the solution.
    state : array
        Initial state, NaN where the state is undefined.
    rtol : float
        Largest relative error of the rate. From the third solution on, the error is taken to be the relative change
        since the previous solution.
    name : str
        Name of the problem, for the error message.

    Raises
    ------
    NotConverged
        The rate still changes after 40 solutions.
    """
    error = np.inf
    previous_rate = np.inf
    for number in range(1, _MOST_SOLUTIONS + 1):
        current = coefficient(state)
        previous_state = state
        rate, state, solution = solve(current)
        if rate == 0:
            return FixedPoint(solution, current, 0.0, number, 0.0)
        error = abs(rate / previous_rate - 1)
        previous_rate = rate
        # the first two rates may agree by chance
        if number > 2 and error <= rtol:
            return FixedPoint(solution, current, rate, number, error)
        if number > _UNDAMPED:
            half_way = 0.5 * (previous_state + state)
            state = np.where(np.isnan(half_way), state, half_way)
    raise NotConverged(
        f"{name}: the solution did not settle. After {_MOST_SOLUTIONS} solutions it still changes by {error:.1e}, "
        f"which should be at most {rtol:.0e}. Try a smaller difference between the inlet and outlet pressures.",
        error,
    )

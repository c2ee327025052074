"""Solve fixed-point problems, such as fluid pressures and the permeabilities that depend on them."""

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
    """Hold the solution of a fixed-point problem.

    Parameters
    ----------
    solution : object
        Last solution, as returned by `solve`.
    coefficient : object
        Coefficient for which the last solution was computed.
    rate : float
        Rate of the last solution, such as a flow.
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
    """Solve a problem whose coefficient depends on its solution, by repeated solution until the rate converges.

    Each solution takes the coefficient for the state that the previous solution returned.

    Parameters
    ----------
    coefficient : callable
        Returns the coefficient for a state, for example permeabilities for pressures.
    solve : callable
        Returns the rate, the new state and the solution for a coefficient.
    state : array
        Initial state, NaN where the state is undefined.
    rtol : float
        Largest relative error of the rate. The error is estimated by the last change of the rate, from the third
        solution on.
    name : str
        Name of the problem for the error message.

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
        f"which should be at most {rtol:.0e}. Try pressures at both ends that are closer to each other.",
        error,
    )

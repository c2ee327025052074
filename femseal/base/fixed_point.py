"""Fixed points of two functions of arrays, such as fluid pressures and the permeabilities that depend on them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from .errors import NotConverged

Found = TypeVar("Found")
#: Most solutions of a fixed point, and those from which on a state goes half way: it may overshoot again and again, as
#: where a fluid opens the last paths that it flows through.
_MOST_SOLUTIONS, _UNDAMPED = 40, 8


@dataclass(frozen=True, eq=False)
class FixedPoint(Generic[Found]):
    """A fixed point: what was solved last, and the coefficient with which it was.

    rate : of the last solution. solutions : number of solutions. error : estimated relative error of the rate; 0 where
        nothing flows.
    """

    found: Found
    coefficient: Any
    rate: float
    solutions: int
    error: float


def fixed_point(
    coefficient: Callable[[Any], Any],
    solve: Callable[[Any], tuple[float, Any, Found]],
    state: Any,
    *,
    rtol: float,
    name: str = "flow",
) -> FixedPoint[Found]:
    """Solve again and again, each time with the coefficient of the state before, until the rate settles.

    coefficient : of a state, such as permeabilities of pressures.
    solve : from a coefficient to the rate, the state that has it, and whatever is to be kept.
    state : the first one; NaN where there is none.
    rtol : relative error of the rate, estimated as its last change, of the third solution or a later one.
    name : of the problem, for the message.

    Raises NotConverged: the rate still changes after 40 solutions.
    """
    error = last = np.inf
    for n in range(1, _MOST_SOLUTIONS + 1):
        given = coefficient(state)
        former = state
        rate, state, found = solve(given)
        if rate == 0:
            return FixedPoint(found, given, 0.0, n, 0.0)
        error, last = abs(rate / last - 1), rate
        # two that differ little may do so by chance
        if n > 2 and error <= rtol:
            return FixedPoint(found, given, rate, n, error)
        if n > _UNDAMPED:
            half_way = 0.5 * (former + state)
            state = np.where(np.isnan(half_way), state, half_way)
    raise NotConverged(
        f"{name}: after {_MOST_SOLUTIONS} solutions it still changes by {error:.1e}, expected is at most {rtol:.0e}; "
        "try pressures at both ends that are nearer to each other",
        error,
    )

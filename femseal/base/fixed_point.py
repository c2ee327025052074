"""Fixed points of two functions of arrays, such as fluid pressures and the permeabilities that depend on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from .errors import NotConverged

Found = TypeVar("Found")
#: Most solutions of a fixed point.
_MOST_SOLUTIONS = 40
#: A predicted rate was off by up to three widths of its bounds where it hardly differed from the rate before.
_WIDTHS = 3.0


@dataclass(frozen=True, eq=False)
class FixedPoint(Generic[Found]):
    """A fixed point: what was solved last, and the coefficient with which it was.

    rate : of the last solution, or as predicted for the next one. solutions : number of solutions.
    error : estimated relative error of the rate; 0 where nothing flows.
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
    predict: Callable[[Found, Any, Any], tuple[float, float]] | None = None,
    name: str = "flow",
) -> FixedPoint[Found]:
    """Solve again and again, each time with the coefficient of the state before, until the rate settles.

    coefficient : of a state, such as permeabilities of pressures.
    solve : from a coefficient to the rate, the state that has it, and whatever is to be kept.
    state : the first one.
    rtol : relative error of the rate, estimated from the last three rates, whose differences fall by a factor each.
    predict : of what was found, its coefficient and the next one, bounds of the next rate. With it the last of the
        three rates is the middle of these bounds, which saves a solution.
    name : of the problem, for the message.

    Raises NotConverged: the rate still changes after 40 solutions.
    """
    rates: list[float] = []
    error, given = np.inf, coefficient(state)
    for n in range(1, _MOST_SOLUTIONS + 1):
        rate, state, found = solve(given)
        if rate == 0:
            return FixedPoint(found, given, 0.0, n, 0.0)
        rates.append(rate)
        latest, width, following = rates, 0.0, None
        if predict is not None:
            following = coefficient(state)
            lower, upper = predict(found, given, following)
            latest = [*rates, float(np.sqrt(lower * upper))]
            width = upper / lower - 1 if lower > 0 else np.inf
        error = _change(latest[-3:]) + _WIDTHS * width
        if error <= rtol:
            return FixedPoint(found, given, latest[-1], n, error)
        given = coefficient(state) if following is None else following
    raise NotConverged(
        f"{name}: after {_MOST_SOLUTIONS} solutions it still changes by {error:.1e}, expected is at most {rtol:.0e}; "
        "try pressures at both ends that are nearer to each other",
        error,
    )


def _change(rates: Sequence[float]) -> float:
    """Estimated relative error of the last of up to three rates."""
    if len(rates) < 2:
        return np.inf
    change = abs(rates[-1] / rates[-2] - 1)
    before = abs(rates[-2] / rates[0] - 1) if len(rates) == 3 else 0.0
    ratio = change / before if before > 0 else 1.0
    return change * ratio / (1 - ratio) if ratio < 0.5 else change

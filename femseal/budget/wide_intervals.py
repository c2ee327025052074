"""Find the widest interval of an error budget, and the intervals that are too wide to be shown as numbers."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from ..base import Indices
from ..loads import least_counted
from .error_parts import ErrorBudget, largest_half_width

#: An end of an interval that differs from the leakage by more than this factor is described in words instead of a
#: number.
VAGUE = 1000.0


@dataclass(frozen=True)
class WidestInterval:
    """Widest 95 % interval of an error budget, among the load steps that `counting_steps` selects.

    Parameters
    ----------
    half_width : float
        Half-width of the interval of ln(leakage), see `ErrorBudget.half_width`; inf if the half-width is unknown or
        unbounded.
    step : int
        Index of the step with the widest interval.
    limit : str
        Name of the error source with the widest interval.
    parts : dict
        Largest half-width of each error source over the selected load steps, by the name of the error source.
    """

    half_width: float
    step: int
    limit: str
    parts: dict[str, float]


def counting_steps(budget: ErrorBudget) -> np.ndarray:
    """Return the indices of the load steps that decide whether an interval is narrow enough.

    If the seal leaks at the first step, the function selects the steps where the leakage is unknown or exceeds 1e-3
    of the leakage at the first step. Sealed steps are left out: the intervals of the last leaking steps already show
    whether the seal may still be open. If the seal does not leak at the first step, all steps that leak or may leak are
    selected. Steps where the fluid carries the whole load are never selected.
    """
    q, upper = np.abs(budget.leakage), np.abs(budget.upper)
    least = np.nan_to_num(least_counted(q))
    if least == 0:
        counts = (q != 0) | (upper != 0)
    else:
        counts = (q > least) | np.isnan(q)
    counts[list(budget.separated)] = False
    return np.flatnonzero(counts)


def vague_steps(budget: ErrorBudget) -> Indices:
    """Return the indices of the leaking steps whose interval is too wide to be shown as numbers.

    An interval is too wide if its upper end is more than `VAGUE` times the leakage. At the steps that `counting_steps`
    selects, an interval is also too wide if the leakage is more than `VAGUE` times the lower end.
    """
    q = np.abs(budget.leakage)
    counts = np.zeros(len(budget.leakage), bool)
    counts[counting_steps(budget)] = True
    upper_is_vague = budget.upper > VAGUE * q
    lower_is_vague = counts & (VAGUE * budget.lower < q)
    return np.flatnonzero((q > 0) & (upper_is_vague | lower_is_vague))


def widest_interval(budget: ErrorBudget) -> WidestInterval:
    """Find the widest interval of a budget; its half-width is inf if the error due to the pixel size is unknown."""
    steps = counting_steps(budget)
    widths = np.nan_to_num(np.asarray(budget.half_width())[steps], nan=inf, posinf=inf)
    # without the error due to the pixel size, the budget says little about the true leakage
    largest_widths = {"pixels": inf}  # replaced below if the budget contains this error
    for name, width in budget.widths().items():
        largest_widths[name] = largest_half_width(width[steps])
    half_width = largest_half_width(widths)
    if np.isinf(largest_widths["pixels"]):
        half_width = inf
    return WidestInterval(
        half_width=half_width,
        step=int(steps[np.argmax(widths)]) if steps.size else 0,
        limit=max(largest_widths, key=lambda name: largest_widths[name]),
        parts=largest_widths,
    )

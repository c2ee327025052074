"""Limit the intervals of load steps by the rule that a seal never leaks more under a higher load."""

from __future__ import annotations

import numpy as np

from ..base import Array
from ..loads import LoadProgramme

#: Factor by which the computed leakage may be larger under a higher load, because of numerical errors.
_RISE = 1.001


def within_others(
    steps: LoadProgramme, leakage: Array, lower: Array, upper: Array
) -> tuple[Array, Array]:
    """Limit the interval of each load step by the intervals of the other steps.

    The limits follow from two rules for the leakage. On loading, and on each unloading, the leakage does not rise with
    the load. At the same load, the leakage on unloading is not larger than the leakage on loading. If the computed
    leakage breaks one of the two rules, for example because the pressure map changes with the load, the intervals are
    returned unchanged. Unknown ends remain unknown, and each interval still contains the leakage of its step.

    Returns the lower and the upper ends of the intervals, arrays (steps,) [m²/s].
    """
    low, high = _bounds_by_other_steps(steps, lower, upper)
    # The rules are tested with intervals of zero width at the computed leakages. If the leakages follow both rules,
    # these intervals do not change. Otherwise, at least one leakage lies outside its bounds.
    lower_bound, upper_bound = _bounds_by_other_steps(steps, leakage, leakage)
    breaks_rules = (leakage > _RISE * upper_bound).any() or (_RISE * leakage < lower_bound).any()
    if breaks_rules:
        return lower, upper
    low = np.where(np.isnan(lower), np.nan, low)
    high = np.where(np.isnan(upper), np.nan, high)
    with np.errstate(invalid="ignore"):
        return np.minimum(low, leakage), np.maximum(high, leakage)


def _bounds_by_other_steps(steps: LoadProgramme, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Narrow the interval of each load step by means of the intervals of all other steps.

    The lower end at a step s is raised to the largest lower end of the steps that cannot leak more than s. The upper
    end at s is reduced to the smallest upper end of the steps that leak at least as much as s.
    """
    low = lower.copy()
    high = upper.copy()
    pressure = steps.pressures
    loading, *unloadings = steps.branches  # step indices of each branch
    # On loading, the steps are ordered from the lowest load to the highest, and the leakage falls. All earlier steps
    # leak at least as much as a step, and all later steps do not leak more. `fmin` and `fmax` ignore unknown ends.
    high[loading] = np.fmin.accumulate(high[loading])
    low[loading] = np.fmax.accumulate(low[loading][::-1])[::-1]
    for unloading in unloadings:
        # On unloading, the steps are ordered from the highest load to the lowest, and the leakage rises. Two kinds of
        # steps leak at least as much as a step: those with a lower load of the same unloading, and the step of the
        # loading that has the same or the next lower load (number −1 if there is none).
        from_lowest = unloading[::-1]
        next_lower = np.searchsorted(pressure[loading], pressure[from_lowest], side="right") - 1
        high_on_loading = np.where(next_lower >= 0, high[loading[next_lower]], np.inf)
        high[from_lowest] = np.fmin.accumulate(np.fmin(high[from_lowest], high_on_loading))
        # the peak and the steps with a higher load of the same unloading do not leak more than a step
        peak = steps.peak_indices[unloading[0]]
        from_peak = np.append(peak, unloading)
        low[unloading] = np.fmax.accumulate(low[from_peak])[1:]
        # a step on unloading leaks at least as much as its peak, so its upper end is not below that of the peak
        high[unloading] = np.where(
            np.isnan(high[unloading]), np.nan, np.fmax(high[unloading], high[peak])
        )
    return low, high

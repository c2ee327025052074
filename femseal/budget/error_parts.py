"""Combine the error sources of a leakage into one 95 % interval.

The class `ErrorPart` holds one error source, and the class `ErrorBudget` combines all error sources. The class
`CoarserSolution` holds the leakage of a coarser solution, for example with larger pixels or without the shortest waves.
The difference between the leakage and the leakage of the coarser solution shows the error of the pixel size or of the
removed waves.

The change of ln(leakage) from one grid to a coarser grid is not a smooth function of the load. At loads where
contacts open and close, the sign of the change is random. Near the load at which the last leakage path closes, the
coarser grid shifts the load at which the seal closes, so that the change of ln(leakage) is this shift of ln(load) times
the slope |d ln(leakage)/d ln(load)|. The function `scale_of_changes` estimates the typical size of the change at a load
from two contributions: the changes at neighbouring loads, and the typical shift of the load over the whole cycle.

Source: Celik, Ghia, Roache, Freitas, Coleman & Raad, J. Fluids Eng. 130, 2008, 078001.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.csgraph import shortest_path

from ..base import Array, Flags, Indices, Shape, counted
from ..loads import LoadProgramme, least_counted, load_sensitivity, neighbouring_steps

if TYPE_CHECKING:
    from ..studies import Scene

#: Error sources of the model and its input, in the order in which they are shown. All other error sources are
#: numerical.
MODEL_PARTS = (
    "hardness",
    "plastic law",
    "fluid pressure",
    "effective pressure",
    "form",
    "form of the patch",
    "longer waves",
    "continuation",
    "thin gap",
)
#: An end of an interval that differs from the leakage by more than this factor is described in words instead of a
#: number.
VAGUE = 1000.0
#: Factor by which the computed leakage may be larger under a higher load, because of numerical errors.
_RISE = 1.001
#: Smallest slope |d ln(leakage)/d ln(load)| by which changes are divided.
LEAST_SLOPE = 0.3
#: Order of convergence of the leakage in the pixel size. Measured on 320 surfaces of 64² to 256² points: the median is
#: 1.9.
ORDER = 2.0
#: Ratio of the half-width of the interval to the typical change of ln(leakage) between a grid and one with half the
#: points along each side, see `scale_of_changes`. The ratio was measured on 154 surfaces of six kinds, at loads at
#: which the leakage exceeds 1e-3 of the leakage under the first load: with a ratio of 0.28 the interval contains the
#: true leakage in 95 % of the cases, with 0.31 in 96.5 %, and with 0.43 in 98 % (97 % on other surfaces).
PER_CHANGE = 0.43
#: Factor by which the half-width of an interval is multiplied if only a few loads were solved on the fine and on the
#: coarse grid; the keys are the numbers of these loads. The factors were measured on the surfaces with which
#: `PER_CHANGE` was measured.
FEW_LOADS = {0: 3.0, 1: 3.0, 2: 1.45, 3: 1.15}
#: Smallest shift of ln(load) that is assumed for any surface, and smallest slope |d ln(leakage)/d ln(load)| by which
#: this shift is multiplied. The shift and the slope were measured on the surfaces of `PER_CHANGE`: with a third of the
#: shift and a fifth of the slope, intervals of equal width contain the true leakage in 94.5 % of the cases instead of
#: 97 %.
_LEAST_SHIFT, _LEAST_SLOPE = 0.012, 1.5
#: In nine of ten contact states, the slope |d ln(leakage)/d ln(load)| is at most this multiple of
#: `expected_sensitivity`.
STEEPEST = 2.0
#: Pixels in the shortest wave of the surfaces on which `PER_CHANGE` and the constants below it were measured.
USUAL_PIXELS = 8.0
#: A seal is near closing if it leaks less than this fraction of the leakage through a uniform gap of the same mean
#: height. Measured on 20 surfaces of ten kinds, which leak at this limit about 1e-3 of their leakage under the lowest
#: load.
_CLOSING_LEAKAGE = 1e-2
#: A step near closing may be sealed if the error of ln(leakage) is larger than this.
_MAY_CLOSE = 1.5


@dataclass(frozen=True)
class ErrorPart:
    """One error source, with the 95 % interval that the leakage would have without any other error.

    Parameters
    ----------
    name : "solver", "pixels", "filter", "realisations", "patch", "patches", "blocks", or one of `MODEL_PARTS`.
    lower, upper : lower and upper ends of the 95 % interval of the leakage, arrays (steps,), m²/s. A lower end of 0
        means that the seal may be sealed. An upper end of inf means that no upper bound is known. NaN means that the
        error of the source is unknown.
    note : a sentence that says how the interval was estimated.
    """

    name: str
    lower: Array
    upper: Array
    note: str

    @classmethod
    def from_distances(
        cls, name: str, leakage: Array, below: Array, above: Array, note: str
    ) -> ErrorPart:
        """Make an error source from the distances between ln(leakage) and both ends of its interval.

        Parameters
        ----------
        name : str
            Name of the error source, one of the names in `ErrorPart`.
        leakage : array (steps,), m²/s
            Leakage. At steps where the leakage is 0, the lower and upper ends of the interval are 0.
        below, above : array (steps,)
            Distances from ln(leakage) to the lower and to the upper end of its interval. If `below` is inf, the seal
            may be sealed.
        note : str
            Sentence that says how the interval was estimated.
        """
        q = np.asarray(leakage, dtype=float)
        with np.errstate(invalid="ignore", over="ignore"):
            lower = np.where(q == 0, 0.0, q * np.exp(-np.asarray(below)))
            upper = np.where(q == 0, 0.0, q * np.exp(np.asarray(above)))
        return cls(name, lower, upper, note)

    def widened(self, leakage: Array, factor: Array) -> ErrorPart:
        """Widen the interval by a factor for each step (steps,), except at sealed steps.

        The factor multiplies the distances from ln(leakage) to the lower and to the upper end.
        """
        q = np.asarray(leakage, dtype=float)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            # a power of end/q multiplies the distance ln(end/q)
            lower, upper = (
                np.where(q == 0, end, q * (end / q) ** factor) for end in (self.lower, self.upper)
            )
        return replace(self, lower=lower, upper=upper)


@dataclass(frozen=True, repr=False)
class ErrorBudget:
    """Error budget of the leakage that a study computed: its error sources and its 95 % interval.

    Parameters
    ----------
    method : str
        Name of the study.
    leakage : array (steps,), m²/s
        Leakage per unit seal length.
    parts : tuple of ErrorPart
        Error sources.
    steps : LoadProgramme, optional
        Load steps. If load steps are given, the intervals are made consistent with the rule that a seal never leaks
        more under a higher load, see `within_others`. Without load steps, the interval of each step is not changed.
    separated : tuple of int
        Indices of the steps where the fluid carries the whole load, so that the faces are separated and the leakage
        is unknown.
    """

    method: str
    leakage: Array
    parts: tuple[ErrorPart, ...]
    steps: LoadProgramme | None = None
    separated: tuple[int, ...] = ()

    def __repr__(self) -> str:
        parts = ", ".join(part.name for part in self.parts)
        return f"<femseal.ErrorBudget of the {self.method} leakage at {counted(len(self.leakage), 'load')}: {parts}>"

    @property
    def numerical(self) -> ErrorBudget:
        """Error budget that contains only the numerical error sources, without the errors of the model."""
        return replace(
            self, parts=tuple(part for part in self.parts if part.name not in MODEL_PARTS)
        )

    @property
    def lower(self) -> Array:
        """Lower end of the 95 % interval (steps,) [m²/s].

        The lower end is 0 where the seal may be sealed, and NaN where an error source is unknown. The distance from
        ln(leakage) to the logarithm of the lower end is √Σd², where d is the distance due to one error source.
        """
        return self._ends[0]

    @property
    def upper(self) -> Array:
        """Upper end of the 95 % interval (steps,) [m²/s].

        The distance from ln(leakage) to the logarithm of the upper end is √Σd², where d is the distance due to one
        error source. At a sealed step, ln(leakage) does not exist, and the upper end of the budget is the largest upper
        end of all error sources.
        """
        return self._ends[1]

    @cached_property
    def _ends(self) -> tuple[Array, Array]:
        """Lower and upper ends of the 95 % interval, arrays (steps,)."""
        q = np.abs(self.leakage)
        highest = np.max([np.abs(part.upper) for part in self.parts], axis=0, initial=0.0)
        with np.errstate(invalid="ignore", over="ignore"):
            low = np.where(q == 0, 0.0, q * np.exp(-self._distance("lower")))
            high = np.where(q == 0, highest, q * np.exp(self._distance("upper")))
        if self.steps is None:
            return low, high
        return within_others(self.steps, q, low, high)

    def half_width(self, step: int | None = None) -> Array | float:
        """Return the larger of the two distances from ln(leakage) to the ends of its interval.

        The half-width is an array (steps,), or a number if a step is given. A value of inf means that it is unknown
        whether the seal leaks: either the computed leakage is above 0 but the lower end is 0, or the computed leakage
        is 0 but the upper end is above 0.
        """
        widths = _width(np.abs(self.leakage), self.lower, self.upper)
        return widths if step is None else float(widths[step])

    def widths(self) -> dict[str, Array]:
        """Return the half-width (steps,) of the interval of each error source, by the name of the source."""
        q = np.abs(self.leakage)
        return {part.name: _width(q, np.abs(part.lower), np.abs(part.upper)) for part in self.parts}

    def limiting(self, step: int | None = None) -> str:
        """Return the name of the error source with the widest interval, or "" if the budget has none.

        If a step is given, the intervals of the error sources are compared at this step. By default, the intervals are
        compared at all steps whose leakage is more than 1e-3 of the leakage at the first step.
        """
        widths = self.widths()
        if not widths:
            return ""
        q = np.abs(self.leakage)
        if step is None:
            is_compared = q > least_counted(q)
        else:
            is_compared = np.arange(q.size) == step
        if not is_compared.any():
            is_compared[:] = True
        return max(widths, key=lambda name: _largest(widths[name][is_compared]))

    def _distance(self, end: str) -> Array:
        """Compute the distance (steps,) from ln(leakage) to the "lower" or "upper" end of the combined interval.

        The distance is √Σd², where d is the distance from ln(leakage) to the same end of the interval of one error
        source.
        """
        total = np.zeros(np.shape(self.leakage))
        for part in self.parts:
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = np.abs(getattr(part, end)) / np.abs(self.leakage)
                total += np.where(self.leakage == 0, 0.0, np.log(ratio) ** 2)
        return np.sqrt(total)


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
    # Intervals without width, at the computed leakages, remain without width if the leakages follow the two rules.
    # Otherwise, a leakage lies outside its bounds.
    lower_bound, upper_bound = _bounds_by_other_steps(steps, leakage, leakage)
    breaks_rules = (leakage > _RISE * upper_bound).any() or (_RISE * leakage < lower_bound).any()
    if breaks_rules:
        return lower, upper
    low = np.where(np.isnan(lower), np.nan, low)
    high = np.where(np.isnan(upper), np.nan, high)
    with np.errstate(invalid="ignore"):
        return np.minimum(low, leakage), np.maximum(high, leakage)


def near_closing(leakage: Array, open_leakage: Array) -> Flags:
    """Flag the load steps at which the last leakage path is about to close, array (steps,).

    At such a step, the surface leaks far less than a uniform gap of equal mean height, see `_CLOSING_LEAKAGE`.

    open_leakage : leakage of the uniform gap (steps,) [m²/s]; NaN where it is unknown.
    """
    with np.errstate(invalid="ignore"):
        return np.abs(leakage) < _CLOSING_LEAKAGE * np.abs(open_leakage)


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
        # an unloaded step leaks at least as much as its peak, so that its upper end is not below that of the peak
        high[unloading] = np.where(
            np.isnan(high[unloading]), np.nan, np.fmax(high[unloading], high[peak])
        )
    return low, high


def _width(leakage: Array, lower: Array, upper: Array) -> Array:
    """Compute the half-width (steps,), which is the larger distance from ln(leakage) to an end of its interval.

    The half-width is inf at a sealed step that may leak (upper end above 0).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.maximum(np.log(leakage / lower), np.log(upper / leakage))
    sealed = np.where(np.isnan(upper), np.nan, np.where(upper > 0, np.inf, 0.0))
    return np.where(leakage == 0, sealed, width)


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
    """Find the widest interval of a budget; its half-width is inf if the error of the pixel size is unknown."""
    steps = counting_steps(budget)
    widths = np.nan_to_num(np.asarray(budget.half_width())[steps], nan=inf, posinf=inf)
    # without the error of the pixel size, the budget says little about the true leakage
    largest_widths = {"pixels": inf}  # replaced below if the budget contains this error
    for name, width in budget.widths().items():
        largest_widths[name] = _largest(width[steps])
    half_width = _largest(widths)
    if np.isinf(largest_widths["pixels"]):
        half_width = inf
    return WidestInterval(
        half_width=half_width,
        step=int(steps[np.argmax(widths)]) if steps.size else 0,
        limit=max(largest_widths, key=lambda name: largest_widths[name]),
        parts=largest_widths,
    )


def _largest(widths: Array) -> float:
    """Return the largest of several half-widths; inf if one of the half-widths is unknown."""
    return float(np.max(np.nan_to_num(widths, nan=inf, posinf=inf), initial=0.0))


@dataclass(frozen=True)
class CoarserSolution:
    """Leakage of a solution on fewer points, without the shortest waves or with a changed model.

    Parameters
    ----------
    points : (int, int)
        Number of points of the surface along x1 and x2.
    leakage : array (steps,), m²/s
        Leakage at every load step.
    reference : array (steps,), m²/s, optional
        Leakage with which `leakage` is compared; by default the leakage of the error budget.
    rms_slope : float, optional
        Rms slope of the surface that was solved.
    """

    points: Shape
    leakage: Array
    reference: Array | None = None
    rms_slope: float | None = None

    def change(self, leakage: Array) -> Array:
        """Compute the change ln(Q/Q_r) (steps,) from a leakage Q_r to the leakage Q of the coarser solution.

        The change is inf where only Q_r is 0, −inf where only Q is 0, and 0 where Q and Q_r are 0. The change is NaN
        where Q or Q_r is unknown.

        leakage : leakage of the error budget (steps,) [m²/s], which is Q_r unless `reference` is given.
        """
        compared_with = leakage if self.reference is None else self.reference
        reference = np.abs(np.asarray(compared_with, float))
        coarser = np.abs(np.asarray(self.leakage, float))
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.log(coarser / reference)
            return np.where((reference == 0) & (coarser == 0), 0.0, ratio)


def expected_sensitivity(in_contact: Array) -> Array:
    """Estimate the slope |d ln(leakage) / d ln(load)| (steps,) from the contact fraction alone.

    The slope is estimated as 0.5 + 9 A, with the contact fraction A. The slope was measured on 25 surfaces of five
    kinds at up to 16 loads each. The median slope was 0.6 for contact fractions below 2 %, 1.0 at 5 %, 2.0 at 17 %, 4.0
    at 32 % and 4.9 at 45 %. In nine of ten contact states, the slope was at most about twice the median slope.
    """
    return 0.5 + 9.0 * np.nan_to_num(np.asarray(in_contact, float))


def sensitivity(steps: LoadProgramme, leakage: Array, in_contact: Array) -> Array:
    """Estimate the slope |d ln(leakage) / d ln(load)| at every step (steps,).

    The slope is computed from the leakages under neighbouring loads, but is at least `expected_sensitivity`. If there
    is no leakage at the neighbouring loads to give a slope, the slope is estimated as `STEEPEST` times
    `expected_sensitivity`. In nine of ten contact states, the true slope is at most `STEEPEST` times
    `expected_sensitivity`, so that the intervals computed from it are wide enough.

    in_contact : contact fraction (steps,), NaN where it is unknown.
    """
    expected = expected_sensitivity(in_contact)
    between_loads = load_sensitivity(steps, leakage)  # 0 where it is unknown
    at_least_expected = np.maximum(between_loads, expected)
    return np.where(between_loads > 0, at_least_expected, STEEPEST * expected)


def scale_of_changes(steps: LoadProgramme, change: Array, slope: Array) -> Array:
    """Estimate how much ln(leakage) typically changes from one grid to a coarser grid, at every step (steps,).

    The typical size of the change at a step is √(a² + b²). The term `a` is the root mean square of the known changes at
    the two nearest steps, including the step itself; if several steps are equally near, all these steps are used. The
    term b is the change that a typical shift of the load would cause: the slope at the step, times the mean shift of
    ln(load) over the whole cycle.

    Parameters
    ----------
    steps : LoadProgramme
        Load steps.
    change : array (steps,)
        Change of ln(leakage) from one grid to the coarser grid; NaN or ±inf where it is unknown.
    slope : array (steps,)
        Slope |d ln(leakage) / d ln(load)|, above 0.
    """
    finite = np.flatnonzero(np.isfinite(change))
    if not finite.size:
        return np.zeros(len(steps))
    shift = mean_shift(change[finite], slope[finite])
    # Distance from each step to each step with a finite change, array (step, finite step). The distance is counted in
    # steps along the load cycle, which is a graph: the unloadings branch off from the loading.
    is_neighbour = np.zeros((len(steps), len(steps)))
    for step, previous in neighbouring_steps(steps):
        is_neighbour[step, previous] = 1
    distance = shortest_path(is_neighbour, directed=False, unweighted=True)[:, finite]
    # a step is near if it is at most as far away as the second nearest step; a step with a finite change is its own
    # nearest step, at the distance 0
    second_smallest = np.sort(distance, axis=1)[:, :2].max(axis=1, keepdims=True)
    is_near = distance <= second_smallest  # (step, finite step)
    rms_nearby = np.sqrt(is_near @ np.square(change[finite]) / is_near.sum(axis=1))
    return np.hypot(rms_nearby, slope * shift)


def mean_shift(change: Array, slope: Array) -> float:
    """Compute the mean shift of ln(load) that would explain given changes of ln(leakage), or 0 without changes.

    change : changes of ln(leakage) (n,).
    slope : slope |d ln(leakage)/d ln(load)| at the load of each change (n,).
    """
    return float(np.mean(np.abs(change / slope))) if change.size else 0.0


def sealed_upper(
    steps: LoadProgramme,
    q: Array,
    distance: Array,
    change: Array | None = None,
    coarse: CoarserSolution | None = None,
) -> Array:
    """Estimate how much the seal may leak at load steps where the computed leakage is 0.

    Returns an array (steps,) [m²/s] with the upper end of the 95 % interval at sealed steps, and 0 at leaking steps.

    An error of ln(leakage) has the effect of a shift of ln(load), see `_load_shift`. If this shift may open the seal at
    a sealed step, the leakage of the step is estimated from the nearest leaking step with a lower load: it is at most
    the upper end of the interval of that step. If a second solution with another grid or a changed model leaks at the
    sealed step, the upper end is at least the leakage of the second solution.

    Parameters
    ----------
    steps : the load programme.
    q : leakage (steps,), m²/s.
    distance : distance from ln(leakage) to the upper end of its interval at leaking steps (steps,).
    change : change of ln(leakage) in the second solution (steps,), inf where only the second solution leaks; None if
        there is no second solution.
    coarse : the second solution; None if there is no second solution.
    """
    upper = np.zeros(q.size)
    change = np.zeros(q.size) if change is None else change
    other_leakage = np.zeros(q.size)
    if coarse is not None:
        other_leakage = np.nan_to_num(np.abs(coarse.leakage))
    is_open = (q > 0) & np.isfinite(distance)
    shift = _load_shift(distance, load_sensitivity(steps, q), is_open)
    pressure = steps.pressures
    for s in np.flatnonzero((q == 0) & ~np.isnan(change)):
        upper[s] = other_leakage[s]
        leaks_no_less = _leaks_no_less_at_lower_load(steps, int(s))
        open_below = np.flatnonzero(leaks_no_less & is_open & (pressure <= pressure[s]))
        # The seal may be open at s if the shifted load is not above the lowest load at which the seal is sealed. If the
        # shifted load is higher, the seal is certainly sealed at s.
        lowest_sealed = pressure[leaks_no_less & (q == 0)].min()
        opens_in_other = np.isposinf(change[s])
        may_open = opens_in_other or pressure[s] * np.exp(-shift) <= lowest_sealed
        if open_below.size and may_open:
            # the step with the highest load; of two steps with the same load, the step that leaks less
            nearest = max(open_below, key=lambda n: (pressure[n], -q[n]))
            factor = np.exp(min(float(distance[nearest]), 50.0))  # limited to avoid an overflow
            upper[s] = max(upper[s], q[nearest] * factor)
        if opens_in_other and upper[s] == 0:
            upper[s] = other_leakage.max()
    return upper


def _leaks_no_less_at_lower_load(steps: LoadProgramme, step: int) -> Flags:
    """Flag the steps that leak at least as much as a given step if their load is equal or lower.

    All steps on loading are flagged. If the given step is on an unloading branch, the steps of this branch are flagged
    as well.
    """
    loading, peaks = steps.on_loading, steps.peak_indices
    same_unloading = ~loading[step] & (peaks == peaks[step])
    return loading | same_unloading


def _load_shift(distance: Array, slope: Array, is_open: Flags) -> float:
    """Return the largest shift of ln(load) that explains the given distances of ln(leakage) at leaking steps.

    At each leaking step, the shift of ln(load) is the distance from ln(leakage) divided by the slope d ln(leakage)/d
    ln(load).

    Parameters
    ----------
    distance : distance from ln(leakage) to the upper end of its interval (steps,).
    slope : slope |d ln(leakage)/d ln(load)| (steps,), 0 where it is unknown. Leaking steps with an unknown slope are
        ignored, unless the slope is unknown at all leaking steps.
    is_open : whether the seal leaks (steps,).
    """
    has_slope = is_open & (slope > 0)
    is_used = has_slope if has_slope.any() else is_open
    shifts = distance[is_used] / np.maximum(slope[is_used], LEAST_SLOPE)
    return float(np.max(shifts, initial=0.0))


def part_of_changes(
    name: str,
    steps: LoadProgramme,
    leakage: Array,
    below: Array,
    above: Array,
    note: str,
    *,
    change: Array | None = None,
    coarse: CoarserSolution | None = None,
) -> ErrorPart:
    """Make an error source from distances to ln(leakage), and estimate its upper ends at sealed steps.

    At load steps that leak, each end of the interval is set by its distance from ln(leakage). At sealed steps, where
    the computed leakage is zero and has no logarithm, `sealed_upper` estimates the upper end of the interval.

    Parameters
    ----------
    below, above : distances from ln(leakage) to the lower and to the upper end of its interval, arrays (steps,).
    change : change of ln(leakage) from the study to a second solution (steps,), if the error was estimated with a
        second solution. Where the change is NaN, the interval of the error source is unknown.
    coarse : the second solution; None if the error was estimated without a second solution.
    """
    q = np.abs(np.asarray(leakage, float))
    part = ErrorPart.from_distances(name, leakage, below, above, note)
    upper = np.where(q == 0, sealed_upper(steps, q, above, change, coarse), part.upper)
    if change is None:
        return ErrorPart(name, part.lower, upper, note)
    is_unknown = np.isnan(change)
    lower = np.where(is_unknown, np.nan, part.lower)
    upper = np.where(is_unknown, np.nan, upper)
    return ErrorPart(name, lower, upper, note)


def pixels_part(
    scene: Scene,
    leakage: Array,
    coarse: CoarserSolution,
    wave_pixels: float = USUAL_PIXELS,
    closing: Flags | bool = False,
    in_contact: Array | float = np.nan,
) -> ErrorPart:
    """Estimate the error of the pixel size from a solution on a coarser grid.

    The half-width of the interval of ln(leakage) is P √(c² + s²). The factor P is `PER_CHANGE`, multiplied by
    `FEW_LOADS` if few loads were solved. The term c is the typical change of ln(leakage) from a grid to a grid with
    half the points along each side, see `scale_of_changes`. The term s is the change of ln(leakage) under a small shift
    of the load. The term s keeps the interval from being too narrow if the change between the grids is small by chance.

    The lower end of the interval is 0 at steps where the coarser grid does not leak. The lower end is also 0 at
    steps where the last leakage path is about to close and the half-width is larger than `_MAY_CLOSE`.

    Parameters
    ----------
    scene : input of the study.
    leakage : array (steps,), m²/s.
    coarse : solution on the coarser grid.
    wave_pixels : number of pixels in the shortest wave. Above `USUAL_PIXELS` pixels, the assumed shift of the load
        decreases in inverse proportion to the number of pixels.
    closing : whether the last leakage path is about to close at each step (steps,), see `near_closing`.
    in_contact : contact fraction (steps,).
    """
    steps = scene.steps
    # ratio of the pixel sizes of the coarser grid and of the grid of the study
    coarsening = float(np.sqrt(np.prod(scene.surface.shape) / np.prod(coarse.points)))
    change = coarse.change(leakage)
    slope = np.maximum(sensitivity(steps, leakage, np.asarray(in_contact)), _LEAST_SLOPE)
    # The error of a grid is proportional to (pixel size)**ORDER, so that the change to a grid with pixels r times as
    # large is proportional to r**ORDER − 1. Scale it to r = 2.
    change_to_half = change * (2.0**ORDER - 1) / (coarsening**ORDER - 1)
    least_shift = _LEAST_SHIFT * min(1.0, USUAL_PIXELS / wave_pixels)
    typical_change = scale_of_changes(steps, change_to_half, slope)  # c
    least_change = least_shift * slope  # s
    n_loads = int((np.isfinite(change) & steps.on_loading).sum())
    factor = PER_CHANGE * FEW_LOADS.get(n_loads, 1.0)  # P
    half_width = factor * np.hypot(typical_change, least_change)
    may_close = closing & (half_width > _MAY_CLOSE)
    half_width_below = np.where(may_close | np.isneginf(change), np.inf, half_width)
    grid = " × ".join(map(str, coarse.points))
    note = f"change of ln(leakage) to {grid} points, at a load and its neighbours; order {ORDER:g} expected"
    return part_of_changes(
        "pixels",
        steps,
        leakage,
        half_width_below,
        half_width,
        note,
        change=change,
        coarse=coarse,
    )

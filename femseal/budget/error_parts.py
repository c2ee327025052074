"""Combine the error sources of a leakage to one 95 % interval.

The module holds the contribution of each error source, the budget that combines them, and the comparison with a coarser
solution of the same scene. This comparison shows how much the pixel size and the removed waves matter.

The change of ln(leakage) between two grids is not a smooth function of the load. Its sign is random where contacts open
and close. Near closing, a coarser grid shifts the load at which the seal closes, and the change is this shift times the
slope of ln(leakage) over ln(load). The size of the change at one load is therefore estimated from this load, its
neighbours, and the typical shift over the whole cycle.

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

#: Error sources of the model and its input, in the order in which they are shown. All others are numerical.
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
#: An end of an interval is not given as a number if it differs from the leakage by more than this factor.
VAGUE = 1000.0
#: Factor by which the computed leakage may be larger under a higher load, because of numerical errors.
_RISE = 1.001
#: Smallest slope |d ln(leakage)/d ln(load)| by which changes are divided.
LEAST_SLOPE = 0.3
#: Order of convergence of the leakage in the pixel size. Measured on 320 surfaces of 64² to 256² points: the median is
#: 1.9.
ORDER = 2.0
#: Ratio of the half-width of the interval to the typical change of ln(leakage) between a grid and one with half the
#: points along each side, see `scale_of_changes`. Measured on 154 surfaces of six kinds, at loads that leak more than
#: 1e-3 of the first one: with a ratio of 0.28 the interval contains the true leakage in 95 % of the cases, with 0.31 in
#: 96.5 %, and with 0.43 in 98 % (97 % on other surfaces).
PER_CHANGE = 0.43
#: Factor on the half-width if only a few loads were solved on both grids, by the number of these loads. Measured as
#: above.
FEW_LOADS = {0: 3.0, 1: 3.0, 2: 1.45, 3: 1.15}
#: Smallest shift of ln(load) that is assumed for any surface, and smallest slope |d ln(leakage)/d ln(load)| by which it
#: is multiplied. Measured as above: with a third of the shift and a fifth of the slope, intervals of equal width
#: contain the true leakage in 94.5 % of the cases instead of 97 %.
_LEAST_SHIFT, _LEAST_SLOPE = 0.012, 1.5
#: In nine of ten contact states, the slope is at most this many times that of `expected_sensitivity`.
STEEPEST = 2.0
#: Pixels in the shortest wave of the surfaces on which these constants were measured.
USUAL_PIXELS = 8.0
#: A seal is near closing if it leaks less than this fraction of the leakage through a uniform gap of the same mean
#: height. Measured on 20 surfaces of ten kinds: they then leak about 1e-3 of their leakage under the lowest load.
_CLOSING_LEAKAGE = 1e-2
#: A step near closing may be sealed if the error of ln(leakage) is larger than this.
_MAY_CLOSE = 1.5


@dataclass(frozen=True)
class ErrorPart:
    """Hold one error source, with the 95 % interval that the leakage would have if there were no other error.

    Parameters
    ----------
    name : "solver", "pixels", "filter", "realisations", "patch", "patches", "blocks", or one of `MODEL_PARTS`.
    lower, upper : ends of this interval, arrays (steps,), m²/s. A lower end of 0 means that the seal may be sealed. An
        upper end of inf means that no upper bound is known. NaN means that this error is unknown.
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
            See the class.
        leakage : array (steps,), m²/s
            Leakage. At steps at which it is 0, both ends of the interval are 0.
        below, above : array (steps,)
            Distance of ln(leakage) to the lower and to the upper end. If `below` is inf, the seal may be sealed.
        note : str
            See the class.
        """
        q = np.asarray(leakage, dtype=float)
        with np.errstate(invalid="ignore", over="ignore"):
            lower = np.where(q == 0, 0.0, q * np.exp(-np.asarray(below)))
            upper = np.where(q == 0, 0.0, q * np.exp(np.asarray(above)))
        return cls(name, lower, upper, note)

    def widened(self, leakage: Array, factor: Array) -> ErrorPart:
        """Multiply the distances of ln(leakage) to both ends by a factor (steps,); sealed steps remain as they are."""
        q = np.asarray(leakage, dtype=float)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            lower, upper = (
                np.where(q == 0, end, q * (end / q) ** factor) for end in (self.lower, self.upper)
            )
        return replace(self, lower=lower, upper=upper)


@dataclass(frozen=True, repr=False)
class ErrorBudget:
    """Hold the error budget of the leakage that one study computed for one scene.

    Parameters
    ----------
    method : str
        Name of the study.
    leakage : array (steps,), m²/s
        Leakage per unit seal length.
    parts : tuple of ErrorPart
        Error sources.
    steps : LoadProgramme, optional
        Load steps. If they are given, the intervals are made consistent with each other, because a seal leaks no more
        under a higher load, see `within_others`. By default the interval of each step stays as it is.
    separated : tuple of int
        Indices of the steps at which the fluid carries the whole load, so that the faces are separated and the leakage
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
        """Budget of the numerical errors alone, which a finer solution would reduce."""
        return replace(
            self, parts=tuple(part for part in self.parts if part.name not in MODEL_PARTS)
        )

    @property
    def lower(self) -> Array:
        """Lower end of the 95 % interval (steps,) [m²/s].

        It is 0 where the seal may be sealed, and NaN where an error source is unknown. The distances of ln(leakage) to
        the ends of all error sources are combined as the square root of the sum of their squares.
        """
        return self._ends[0]

    @property
    def upper(self) -> Array:
        """Upper end of the 95 % interval (steps,) [m²/s].

        At a sealed step it is the largest upper end of all error sources.
        """
        return self._ends[1]

    @cached_property
    def _ends(self) -> tuple[Array, Array]:
        """Lower and upper end of the 95 % interval, arrays (steps,)."""
        q = np.abs(self.leakage)
        highest = np.max([np.abs(part.upper) for part in self.parts], axis=0, initial=0.0)
        with np.errstate(invalid="ignore", over="ignore"):
            low = np.where(q == 0, 0.0, q * np.exp(-self._distance("lower")))
            high = np.where(q == 0, highest, q * np.exp(self._distance("upper")))
        return (low, high) if self.steps is None else within_others(self.steps, q, low, high)

    def half_width(self, step: int | None = None) -> Array | float:
        """Return the distance of ln(leakage) to that end of its interval which is further away.

        The result is an array (steps,), or a number if a step is given. It is inf if only the lower end is 0, or if
        only the upper end is above 0.
        """
        widths = _width(np.abs(self.leakage), self.lower, self.upper)
        return widths if step is None else float(widths[step])

    def widths(self) -> dict[str, Array]:
        """Return the half-width of each error source, by its name, at every step (steps,); see `half_width`."""
        q = np.abs(self.leakage)
        return {part.name: _width(q, np.abs(part.lower), np.abs(part.upper)) for part in self.parts}

    def limiting(self, step: int | None = None) -> str:
        """Return the name of the error source with the widest interval, or "" if the budget has none.

        The intervals are compared at the given step, or at all steps that leak more than 1e-3 of the first one.
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
        """Combine the distances of ln(leakage) to an end of each interval: the square root of the sum of squares."""
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

    A seal does not leak more under a higher load of the same branch. Under the same load, it does not leak more on
    unloading than on loading. If the computed leakage does not follow these rules, for example because the pressure map
    changes with the load, the intervals are returned unchanged. Unknown ends remain unknown, and each interval contains
    its leakage.

    Returns the lower and the upper ends (steps,).
    """
    low, high = _bounds_by_other_steps(steps, lower, upper)
    # the same bounds from the leakages themselves show whether these follow the rules
    lower_bound, upper_bound = _bounds_by_other_steps(steps, leakage, leakage)
    if (leakage > _RISE * upper_bound).any() or (_RISE * leakage < lower_bound).any():
        return lower, upper
    low = np.where(np.isnan(lower), np.nan, low)
    high = np.where(np.isnan(upper), np.nan, high)
    with np.errstate(invalid="ignore"):
        return np.minimum(low, leakage), np.maximum(high, leakage)


def near_closing(leakage: Array, open_leakage: Array) -> Flags:
    """Return at which steps the surface is near closing (steps,), because it leaks far less than a uniform gap.

    open_leakage : leakage through a uniform gap of the same mean height (steps,) [m²/s]; NaN where it is unknown.
    """
    with np.errstate(invalid="ignore"):
        return np.abs(leakage) < _CLOSING_LEAKAGE * np.abs(open_leakage)


def _bounds_by_other_steps(steps: LoadProgramme, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Find the narrowest interval of each step that the intervals of all steps allow (steps,).

    The lower end is the largest one of all steps that cannot leak more than this step. The upper end is the smallest
    one of all steps that leak at least as much.
    """
    low, high, pressure = lower.copy(), upper.copy(), steps.pressures
    # loading, from the lowest load to the highest: the leakage falls
    loading, *unloadings = steps.branches
    high[loading] = np.fmin.accumulate(high[loading])
    low[loading] = np.fmax.accumulate(low[loading][::-1])[::-1]
    for unloading in unloadings:  # from the highest load to the lowest: the leakage rises
        from_lowest = unloading[::-1]
        # step of loading with the same load or the next lower one, −1 if there is none
        next_lower = np.searchsorted(pressure[loading], pressure[from_lowest], side="right") - 1
        high_on_loading = np.where(next_lower >= 0, high[loading[next_lower]], np.inf)
        high[from_lowest] = np.fmin.accumulate(np.fmin(high[from_lowest], high_on_loading))
        peak = steps.peak_indices[unloading[0]]
        from_peak = np.append(peak, unloading)
        low[unloading] = np.fmax.accumulate(low[from_peak])[1:]
        # an unloaded step may leak at least as much as its peak may
        high[unloading] = np.where(
            np.isnan(high[unloading]), np.nan, np.fmax(high[unloading], high[peak])
        )
    return low, high


def _width(leakage: Array, lower: Array, upper: Array) -> Array:
    """Compute the larger distance of ln(leakage) to the ends of an interval; inf for a sealed step that may be open."""
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.maximum(np.log(leakage / lower), np.log(upper / leakage))
    sealed = np.where(np.isnan(upper), np.nan, np.where(upper > 0, np.inf, 0.0))
    return np.where(leakage == 0, sealed, width)


@dataclass(frozen=True)
class WidestInterval:
    """Hold the widest interval of a budget at the load steps that `counting_steps` returns.

    Parameters
    ----------
    half_width : float
        Half-width of ln(leakage), see `ErrorBudget.half_width`. It is inf if it is unknown or unbounded.
    step : int
        Index of the step with the widest interval.
    limit : str
        Name of the error source with the largest half-width at any of the steps.
    parts : dict
        Largest half-width of each error source at any of the steps, by the name of the error source.
    """

    half_width: float
    step: int
    limit: str
    parts: dict[str, float]


def counting_steps(budget: ErrorBudget) -> np.ndarray:
    """Return the indices of the load steps that decide whether an interval is narrow enough.

    These are the steps whose leakage is unknown, or more than 1e-3 of the leakage at the first step. If the seal does
    not leak at the first step, these are all steps that leak or may leak. Other sealed steps are left out, because the
    intervals of the steps before them show whether they may be open. Steps at which the fluid carries the whole load
    are left out as well.
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
    """Return the indices of the leaking steps whose interval is too wide to be given as numbers.

    The upper end is above the leakage by more than the factor `VAGUE`, or at the steps of `counting_steps` the lower
    end is below the leakage by more than this factor.
    """
    q = np.abs(budget.leakage)
    counts = np.zeros(len(budget.leakage), bool)
    counts[counting_steps(budget)] = True
    is_vague = (budget.upper > VAGUE * q) | (counts & (VAGUE * budget.lower < q))
    return np.flatnonzero((q > 0) & is_vague)


def widest_interval(budget: ErrorBudget) -> WidestInterval:
    """Find the widest interval of a budget; its half-width is inf if the error of the pixel size is unknown."""
    steps = counting_steps(budget)
    widths = np.nan_to_num(np.asarray(budget.half_width())[steps], nan=inf, posinf=inf)
    parts = {"pixels": inf} | {
        name: _largest(width[steps]) for name, width in budget.widths().items()
    }
    return WidestInterval(
        half_width=max(_largest(widths), inf if np.isinf(parts["pixels"]) else 0.0),
        step=int(steps[np.argmax(widths)]) if steps.size else 0,
        limit=max(parts, key=lambda name: parts[name]),
        parts=parts,
    )


def _largest(widths: Array) -> float:
    """Return the largest half-width; it is inf if one of them is unknown."""
    return float(np.max(np.nan_to_num(widths, nan=inf, posinf=inf), initial=0.0))


@dataclass(frozen=True)
class CoarserSolution:
    """Hold the leakage of a scene that was solved on fewer points, with fewer waves or with a changed model.

    Parameters
    ----------
    points : (int, int)
        Number of points of the surface along x1 and x2.
    leakage : array (steps,), m²/s
        Leakage at every step of the scene.
    reference : array (steps,), m²/s, optional
        Leakage of the same study with which it is compared. Default: the leakage of the budget.
    rms_slope : float, optional
        Rms slope of the surface that was solved.
    """

    points: Shape
    leakage: Array
    reference: Array | None = None
    rms_slope: float | None = None

    def change(self, leakage: Array) -> Array:
        """Compute ln of the ratio of the leakage of this solution to the leakage with which it is compared (steps,).

        It is inf or −inf where one of the two solutions is sealed, 0 where both are, and NaN where one is unknown.

        leakage : leakage of the budget (steps,) [m²/s], the reference unless the solution has another one.
        """
        compared_with = leakage if self.reference is None else self.reference
        reference = np.abs(np.asarray(compared_with, float))
        coarser = np.abs(np.asarray(self.leakage, float))
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.log(coarser / reference)
            return np.where((reference == 0) & (coarser == 0), 0.0, ratio)


def expected_sensitivity(in_contact: Array) -> Array:
    """Estimate the slope |d ln(leakage) / d ln(load)| from the contact fraction alone (steps,).

    Measured on 25 surfaces of five kinds at up to 16 loads each: the median slope is 0.6 for contact fractions below
    2 %, 1.0 at 5 %, 2.0 at 17 %, 4.0 at 32 % and 4.9 at 45 %. In nine of ten states it is at most about twice the
    median.
    """
    return 0.5 + 9.0 * np.nan_to_num(np.asarray(in_contact, float))


def sensitivity(steps: LoadProgramme, leakage: Array, in_contact: Array) -> Array:
    """Estimate the slope |d ln(leakage) / d ln(load)| at every step (steps,).

    It is the slope between neighbouring loads, but at least `expected_sensitivity`. At a load without neighbours it is
    a slope that nine of ten contact states do not exceed. The interval is then not narrower than with neighbouring
    loads.

    in_contact : contact fraction (steps,), NaN where it is unknown.
    """
    expected = expected_sensitivity(in_contact)
    between_loads = load_sensitivity(steps, leakage)  # 0 where it is unknown
    at_least_expected = np.maximum(between_loads, expected)
    return np.where(between_loads > 0, at_least_expected, STEEPEST * expected)


def scale_of_changes(steps: LoadProgramme, change: Array, slope: Array) -> Array:
    """Estimate the typical size of the change of ln(leakage) between two grids at every step (steps,).

    Two contributions are combined as the square root of the sum of their squares: the rms change at the nearest two or
    more steps, and the change that corresponds to the mean shift of the load over the cycle.

    Parameters
    ----------
    steps : LoadProgramme
        Load steps.
    change : array (steps,)
        Change of ln(leakage).
    slope : array (steps,)
        Slope |d ln(leakage) / d ln(load)|, above 0.
    """
    finite = np.flatnonzero(np.isfinite(change))
    if not finite.size:
        return np.zeros(len(steps))
    shift = mean_shift(change[finite], slope[finite])
    adjacency = np.zeros((len(steps), len(steps)))
    for step, previous in neighbouring_steps(steps):
        adjacency[step, previous] = 1
    # number of steps along the cycle from each step to each step with a finite change (step, finite step)
    distance = shortest_path(adjacency, directed=False, unweighted=True)[:, finite]
    second_smallest = np.sort(distance, axis=1)[:, :2].max(axis=1, keepdims=True)
    is_near = distance <= second_smallest
    rms = np.sqrt(is_near @ np.square(change[finite]) / is_near.sum(axis=1))
    return np.hypot(rms, slope * shift)


def mean_shift(change: Array, slope: Array) -> float:
    """Compute the mean shift of ln(load) that corresponds to changes of ln(leakage); 0 if there are no changes.

    change : changes of ln(leakage) (n,). slope : slopes |d ln(leakage)/d ln(load)| (n,).
    """
    return float(np.mean(np.abs(change / slope))) if change.size else 0.0


def sealed_upper(
    steps: LoadProgramme,
    q: Array,
    distance: Array,
    change: Array | None = None,
    coarse: CoarserSolution | None = None,
) -> Array:
    """Estimate the upper end of the interval at the sealed steps (steps,) [m²/s]; it is 0 at all other steps.

    If the error can shift the load to that of the next open step, a sealed step may leak as much as the upper end of
    the interval of this open step. It may also leak as much as the other solution does at the sealed step.

    Parameters
    ----------
    steps : the load programme.
    q : leakage (steps,), m²/s.
    distance : distance of ln(leakage) to the upper end (steps,).
    change : change of ln(leakage) to the other solution (steps,); None if there is none.
    coarse : the other solution; None if there is none.
    """
    upper = np.zeros(q.size)
    change = np.zeros(q.size) if change is None else change
    other_leakage = np.zeros(q.size)
    if coarse is not None:
        other_leakage = np.nan_to_num(np.abs(coarse.leakage))
    is_open = (q > 0) & np.isfinite(distance)
    shift = _load_shift(distance, load_sensitivity(steps, q), is_open)
    pressure, loading, peaks = steps.pressures, steps.on_loading, steps.peak_indices
    for s in np.flatnonzero((q == 0) & ~np.isnan(change)):
        upper[s] = other_leakage[s]
        # steps that leak at least as much under the same load: loading, and for an unloaded step its own branch
        path = loading | (~loading[s] & (peaks == peaks[s]))
        open_below = np.flatnonzero(path & is_open & (pressure <= pressure[s]))
        # a higher load cannot open what is sealed for certain at the lowest sealed load
        lowest_sealed = pressure[path & (q == 0)].min()
        opens_in_other = np.isposinf(change[s])
        may_open = opens_in_other or pressure[s] * np.exp(-shift) <= lowest_sealed
        if open_below.size and may_open:
            # the highest of these loads, and of two steps with the same load the one that leaks less
            nearest = max(open_below, key=lambda n: (pressure[n], -q[n]))
            factor = np.exp(min(float(distance[nearest]), 50.0))
            upper[s] = max(upper[s], q[nearest] * factor)
        if opens_in_other and upper[s] == 0:
            upper[s] = other_leakage.max()
    return upper


def _load_shift(distance: Array, slope: Array, is_open: Flags) -> float:
    """Return the largest shift of ln(load) that corresponds to distances of ln(leakage) at open steps, arrays (steps,).

    slope : slope |d ln(leakage)/d ln(load)|, 0 where it is unknown. Steps with an unknown slope are only used if that
        of all open steps is unknown.
    """
    is_used = is_open
    if (slope[is_open] > 0).any():
        is_used = is_open & (slope > 0)
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
    """Make an error source from the distances between ln(leakage) and both ends of its interval.

    In contrast to `ErrorPart.from_distances`, the upper ends of sealed steps are estimated, see `sealed_upper`.

    Parameters
    ----------
    below, above : distances to the lower and the upper end, arrays (steps,).
    change, coarse : change of ln(leakage) to another solution (steps,), and this solution, if the error was estimated
        by comparing the two. The error is unknown where the change is NaN.
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

    The change of ln(leakage) between both grids is scaled to a halving of the number of points along each side. To its
    square is added that of the change under a small shift of the load, because the change between two grids may be
    small by chance. The half-width of the interval is a calibrated multiple, `PER_CHANGE`, of the root of the sum. It
    is larger where few loads were solved, see `FEW_LOADS`.

    If a step is open on one grid and sealed on the other, it may in truth be open or sealed. The lower end is then 0,
    as it is for a step near closing whose error is large.

    Parameters
    ----------
    scene : input of the study.
    leakage : array (steps,), m²/s.
    coarse : solution on the coarser grid.
    wave_pixels : number of pixels in the shortest wave. With more than `USUAL_PIXELS`, the smallest shift of the load
        that is assumed is reduced in proportion.
    closing : whether the surface is near closing at each step (steps,), see `near_closing`.
    in_contact : contact fraction (steps,).
    """
    steps = scene.steps
    coarsening = float(np.sqrt(np.prod(scene.surface.shape) / np.prod(coarse.points)))
    change = coarse.change(leakage)
    slope = np.maximum(sensitivity(steps, leakage, np.asarray(in_contact)), _LEAST_SLOPE)
    # change to a grid with half the points along each side, extrapolated with the order of convergence
    scaled = change * (2.0**ORDER - 1) / (coarsening**ORDER - 1)
    least_shift = _LEAST_SHIFT * min(1.0, USUAL_PIXELS / wave_pixels)
    change_scale = np.hypot(scale_of_changes(steps, scaled, slope), least_shift * slope)
    n_loads = int((np.isfinite(change) & steps.on_loading).sum())
    half_width = PER_CHANGE * FEW_LOADS.get(n_loads, 1.0) * change_scale
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

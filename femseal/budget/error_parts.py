"""Combine the error sources of a leakage to one 95 % interval.

The module holds the contribution of each error source, the budget that combines them, and the comparison with a coarser
solution of the same scene. This comparison shows how much the pixel size and the removed waves matter.

The change of ln(leakage) between two grids is not a smooth function of the load. Where contacts open and close, it has
either sign. Near closing, a coarser grid shifts the load at which the seal closes. The change is then this shift
multiplied by the slope of ln(leakage) over ln(load). The size of the change at one load is therefore estimated from
this load, its neighbours, and the typical shift over the whole cycle.

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

#: Sources of error of the model and its input, in the order in which they are shown. All others are numerical.
MODEL_PARTS = (
    "hardness",
    "fluid pressure",
    "effective pressure",
    "form",
    "form of the patch",
    "longer waves",
    "continuation",
    "thin gap",
)
#: An end of the interval that is further from the leakage than this factor is not worth stating as a number.
VAGUE = 1000.0
#: Ratio by which the leakage may rise under a higher load because of errors of the solution.
_RISE = 1.001
#: Least slope of ln(leakage) over ln(load) that is counted.
LEAST_SLOPE = 0.3
#: Order of convergence of the leakage in the pixel size. Measured on 320 surfaces of 64² to 256² points: the median is
#: 1.9.
ORDER = 2.0
#: Half-width of the interval over the scale of the changes to half the points a side, see `scale_of_changes`. Measured
#: on 154 surfaces of six kinds, at loads that leak more than 1e-3 of the first: an interval with 0.28 contains 95 % of
#: the errors, with 0.31 96.5 %, and with 0.43 98 %, of which 97 % were found again on other surfaces.
PER_CHANGE = 0.43
#: Factor on the half-width where only a few loads were solved on both grids, by their number. Measured as above.
FEW_LOADS = {0: 3.0, 1: 3.0, 2: 1.45, 3: 1.15}
#: Least shift of ln(load) that is assumed for any surface, and least slope of ln(leakage) over ln(load) by which it is
#: multiplied. Measured as above: with a third of the shift and a fifth of the slope, equally wide intervals contain
#: 94.5 % instead of 97 %.
_LEAST_SHIFT, _LEAST_SLOPE = 0.012, 1.5
#: Nine in ten states have at most this many times the slope that `expected_sensitivity` gives.
STEEPEST = 2.0
#: Pixels in the shortest wave of the surfaces on which these constants were measured.
USUAL_PIXELS = 8.0
#: A seal is near closing where it leaks less than this fraction of what it would leak if its mean gap were everywhere.
#: Measured on 20 surfaces of ten kinds: they then leak about 1e-3 of what they leak under the least load.
_CLOSING_LEAKAGE = 1e-2
#: A step near closing may be sealed if the error of ln(leakage) is larger than this.
_MAY_CLOSE = 1.5


@dataclass(frozen=True)
class ErrorPart:
    """Hold one error source of a leakage, with the 95 % interval that it would have by itself.

    Parameters
    ----------
    name : "solver", "pixels", "filter", "realisations", "patch", "patches", "blocks", or one of `MODEL_PARTS`.
    lower, upper : ends of the interval if this were the only source of error, array (steps,), m²/s. A lower end of 0
        means that the seal may be sealed. An upper end of inf means that no bound is known. NaN means unknown.
    note : a sentence that says how the interval was estimated.
    """

    name: str
    lower: Array
    upper: Array
    note: str

    @classmethod
    def of(cls, name: str, leakage: Array, below: Array, above: Array, note: str) -> ErrorPart:
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
    parted : tuple of int
        Indices of the steps at which the fluid carries the whole load. The surfaces are separated there, and no leakage
        is known.
    """

    method: str
    leakage: Array
    parts: tuple[ErrorPart, ...]
    steps: LoadProgramme | None = None
    parted: tuple[int, ...] = ()

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
        """Upper end of the 95 % interval (steps,) [m²/s]; in a sealed state the largest of all error sources."""
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
        """Return the distance of ln(leakage) to the end of the interval that is further away.

        The result is an array (steps,), or a number if a step is given. It is inf where the leakage is above 0 and the
        lower end is 0, and where the leakage is 0 and the upper end is above 0.
        """
        widths = _width(np.abs(self.leakage), self.lower, self.upper)
        return widths if step is None else float(widths[step])

    def widths(self) -> dict[str, Array]:
        """Return the half-width of each error source, by its name, at every step (steps,); see `half_width`."""
        q = np.abs(self.leakage)
        return {part.name: _width(q, np.abs(part.lower), np.abs(part.upper)) for part in self.parts}

    def limiting(self, step: int | None = None) -> str:
        """Return the name of the error source with the widest interval, or "" if the budget has none.

        The widest interval is sought at the given step, or at all steps that leak more than 1e-3 of the first one.
        """
        widths = self.widths()
        if not widths:
            return ""
        q = np.abs(self.leakage)
        chosen = q > least_counted(q) if step is None else np.arange(q.size) == step
        chosen = chosen if chosen.any() else np.ones_like(chosen)
        return max(widths, key=lambda name: _largest(widths[name][chosen]))

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

    A seal does not leak more under a higher load of the same branch, and not more on unloading than on loading under
    the same load. If the leakage does not follow this rule, the intervals are returned unchanged. An example are
    pressure maps that change with the load. Unknown ends remain unknown, and each interval contains its leakage.

    Returns the lower and the upper ends (steps,).
    """
    rising = np.flatnonzero(steps.on_loading)
    high, low = _from_others(steps, rising, upper, lower)
    # The same bounds from the leakages themselves show whether these follow the rule.
    least, most = _from_others(steps, rising, leakage, leakage)
    if (leakage > _RISE * least).any() or (_RISE * leakage < most).any():
        return lower, upper
    low = np.where(np.isnan(lower), np.nan, low)
    high = np.where(np.isnan(upper), np.nan, high)
    with np.errstate(invalid="ignore"):
        return np.minimum(low, leakage), np.maximum(high, leakage)


def near_closing(leakage: Array, open_leakage: Array) -> Flags:
    """Return at which steps the surface is near closing (steps,): it leaks far less than a uniform gap would.

    open_leakage : leakage if the gap were everywhere equal to the mean gap (steps,) [m²/s]; NaN where it is unknown.
    """
    with np.errstate(invalid="ignore"):
        return np.abs(leakage) < _CLOSING_LEAKAGE * np.abs(open_leakage)


def _from_others(
    steps: LoadProgramme, rising: Indices, upper: Array, lower: Array
) -> tuple[Array, Array]:
    """Find the narrowest interval of each step that the intervals of all steps allow.

    Returns the smallest upper end of all steps that must leak at least as much, and the largest lower end of all steps
    that cannot leak more. `rising` are the indices of the steps on loading.
    """
    low, high, pressure = lower.copy(), upper.copy(), steps.pressures
    high[rising] = np.fmin.accumulate(high[rising])
    low[rising] = np.fmax.accumulate(low[rising][::-1])[::-1]
    for falling in steps.branches[1:]:
        # from the lowest load to the highest
        branch = falling[::-1]
        below = np.searchsorted(pressure[rising], pressure[branch], side="right") - 1
        before = np.where(below >= 0, high[rising[below]], np.inf)
        high[branch] = np.fmin.accumulate(np.fmin(high[branch], before))
        peak = steps.peak_indices[falling[0]]
        way = np.append(peak, falling)
        low[falling] = np.fmax.accumulate(low[way])[1:]
        # what the peak may leak, its unloading may leak as well
        high[falling] = np.where(
            np.isnan(high[falling]), np.nan, np.fmax(high[falling], high[peak])
        )
    return high, low


def _width(leakage: Array, lower: Array, upper: Array) -> Array:
    """Compute the larger distance of ln(leakage) to an end; it is inf for a sealed step that may be open."""
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.maximum(np.log(leakage / lower), np.log(upper / leakage))
    sealed = np.where(np.isnan(upper), np.nan, np.where(upper > 0, np.inf, 0.0))
    return np.where(leakage == 0, sealed, width)


@dataclass(frozen=True)
class WidestBand:
    """Hold the widest interval of a budget, among the load steps that `counting_steps` returns.

    Parameters
    ----------
    half_width : float
        Half-width of ln(leakage), see `ErrorBudget.half_width`. It is inf if it is unknown or unbounded.
    step : int
        Index of the step with the widest interval.
    limit : str
        Name of the error source with the largest half-width at any of the steps.
    parts : dict
        Name of each error source and its largest half-width at any of the steps.
    """

    half_width: float
    step: int
    limit: str
    parts: dict[str, float]


def counting_steps(budget: ErrorBudget) -> np.ndarray:
    """Return the indices of the load steps that decide whether an interval is narrow enough.

    These are the steps whose leakage is unknown, or more than 1e-3 of the leakage at the first step. If the seal does
    not leak at the first step, they are all steps that leak or may leak. Other sealed steps are left out, because the
    intervals of the steps before them show whether they may be open. Steps at which the fluid carries the whole load
    are left out as well.
    """
    q, upper = np.abs(budget.leakage), np.abs(budget.upper)
    least = np.nan_to_num(least_counted(q))
    counts = (q != 0) | (upper != 0) if least == 0 else (q > least) | np.isnan(q)
    counts[list(budget.parted)] = False
    return np.flatnonzero(counts)


def vague_steps(budget: ErrorBudget) -> Indices:
    """Return the indices of the leaking steps whose interval is too wide to be stated as numbers.

    The upper end exceeds the leakage by more than the factor `VAGUE`. At the steps of `counting_steps` it is also
    enough that the lower end is below the leakage by more than this factor.
    """
    q = np.abs(budget.leakage)
    counts = np.zeros(len(budget.leakage), bool)
    counts[counting_steps(budget)] = True
    return np.flatnonzero(
        (q > 0) & ((budget.upper > VAGUE * q) | (counts & (VAGUE * budget.lower < q)))
    )


def widest_band(budget: ErrorBudget) -> WidestBand:
    """Find the widest interval of a budget; its half-width is inf if the error of the pixel size is unknown."""
    steps = counting_steps(budget)
    widths = np.nan_to_num(np.asarray(budget.half_width())[steps], nan=inf, posinf=inf)
    parts = {"pixels": inf} | {
        name: _largest(width[steps]) for name, width in budget.widths().items()
    }
    return WidestBand(
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
    """Hold the leakage of a scene that was solved on fewer points or without its shortest waves.

    Parameters
    ----------
    points : (int, int)
        Number of points of the surface along x1 and x2.
    leakage : array (steps,), m²/s
        Leakage at every step of the scene.
    against : array (steps,), m²/s, optional
        Leakage of the same study with which it is compared. The default is the leakage of the budget.
    rms_slope : float, optional
        Rms slope of the surface that was solved.
    """

    points: Shape
    leakage: Array
    against: Array | None = None
    rms_slope: float | None = None

    def change(self, leakage: Array) -> Array:
        """Compute ln of the ratio of the leakage of this solution to the leakage with which it is compared (steps,).

        It is inf or −inf where one of the two solutions is sealed, 0 where both are, and NaN where one is unknown.

        leakage : leakage of the budget (steps,) [m²/s], used unless `against` is given.
        """
        reference = np.abs(np.asarray(leakage if self.against is None else self.against, float))
        coarser = np.abs(np.asarray(self.leakage, float))
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.log(coarser / reference)
            return np.where((reference == 0) & (coarser == 0), 0.0, ratio)


def expected_sensitivity(in_contact: Array) -> Array:
    """Estimate the slope |d ln(leakage) / d ln(load)| from the contact fraction alone (steps,).

    Measured on 25 surfaces of five kinds at up to 16 loads each. The median slope is 0.6 below 2 % of contact, 1.0 at 5
    %, 2.0 at 17 %, 4.0 at 32 % and 4.9 at 45 %; nine in ten states have at most about twice as much.
    """
    return 0.5 + 9.0 * np.nan_to_num(np.asarray(in_contact, float))


def sensitivity(steps: LoadProgramme, leakage: Array, in_contact: Array) -> Array:
    """Estimate the slope |d ln(leakage) / d ln(load)| at every step (steps,).

    It is the slope between neighbouring loads, but at least `expected_sensitivity`. A load without neighbours takes a
    slope that nine of ten contact states do not exceed, so that its interval is not narrower than it would be among
    other loads.

    in_contact : contact fraction (steps,), NaN where it is unknown.
    """
    expected = expected_sensitivity(in_contact)
    found = load_sensitivity(steps, leakage)
    return np.where(found > 0, np.maximum(found, expected), STEEPEST * expected)


def scale_of_changes(steps: LoadProgramme, change: Array, slope: Array) -> Array:
    """Estimate the typical size of the change of ln(leakage) between two grids at every step (steps,).

    It combines the rms change at the nearest two or more steps with the mean shift of the load over the cycle.

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
    beside = np.zeros((len(steps), len(steps)))
    for s, other in neighbouring_steps(steps):
        beside[s, other] = 1
    apart = shortest_path(beside, directed=False, unweighted=True)[:, finite]
    near = apart <= np.sort(apart, axis=1)[:, :2].max(axis=1, keepdims=True)
    rms = np.sqrt(near @ np.square(change[finite]) / near.sum(axis=1))
    return np.hypot(rms, slope * shift)


def mean_shift(change: Array, slope: Array) -> float:
    """Compute the mean shift of ln(load) that explains changes of ln(leakage), from their slopes; 0 without any."""
    return float(np.mean(np.abs(change / slope))) if change.size else 0.0


def sealed_upper(
    steps: LoadProgramme,
    q: Array,
    distance: Array,
    change: Array | None = None,
    coarse: CoarserSolution | None = None,
) -> Array:
    """Find the upper end of the interval at the sealed steps (steps,) [m²/s]; it is 0 elsewhere.

    A sealed step may leak as much as the upper end of the next open step, if the error can shift the load that far. It
    may also leak what the other solution leaks there.

    Parameters
    ----------
    q : leakage (steps,), m²/s.
    distance : of ln(leakage) to the upper end (steps,).
    change : of ln(leakage) to the other solution (steps,); None without one.
    coarse : the other solution; None without one.
    """
    found = np.zeros(q.size)
    slope = load_sensitivity(steps, q)
    open_ = (q > 0) & np.isfinite(distance)
    # the shift is that of steps whose slope is known, if there are any
    chosen = open_ & (slope > 0) if (slope[open_] > 0).any() else open_
    shift = float(np.max(distance[chosen] / np.maximum(slope[chosen], LEAST_SLOPE), initial=0.0))
    change, other = np.zeros(q.size) if change is None else change, np.zeros(q.size)
    if coarse is not None:
        other = np.nan_to_num(np.abs(coarse.leakage))
    pressure, loading, peaks = steps.pressures, steps.on_loading, steps.peak_indices
    for s in np.flatnonzero((q == 0) & ~np.isnan(change)):
        found[s] = other[s]
        branch = loading | (~loading[s] & (peaks == peaks[s]))
        less = np.flatnonzero(branch & open_ & (pressure <= pressure[s]))
        # a load that is sealed for certain seals all higher ones
        lowest = pressure[branch & (q == 0)].min()
        if less.size and (np.isposinf(change[s]) or pressure[s] * np.exp(-shift) <= lowest):
            nearest = max(less, key=lambda n: (pressure[n], -q[n]))
            found[s] = max(found[s], q[nearest] * np.exp(min(float(distance[nearest]), 50.0)))
        if np.isposinf(change[s]) and found[s] == 0:
            found[s] = other.max()
    return found


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
    """Make a part from distances of ln(leakage), with the upper ends of sealed steps from `sealed_upper`.

    Parameters
    ----------
    below, above : distances to the lower and the upper end, arrays (steps,).
    change, coarse : change of ln(leakage) to another solution (steps,), and that solution, where the part comes from
        one. Where the change is NaN, the part is unknown.
    """
    q = np.abs(np.asarray(leakage, float))
    part = ErrorPart.of(name, leakage, below, above, note)
    upper = np.where(q == 0, sealed_upper(steps, q, above, change, coarse), part.upper)
    unknown = np.isnan(np.zeros(q.size) if change is None else change)
    lower, upper = (np.where(unknown, np.nan, end) for end in (part.lower, upper))
    return ErrorPart(name, lower, upper, note)


def pixels_part(
    scene: Scene,
    leakage: Array,
    coarse: CoarserSolution,
    wave_pixels: float = USUAL_PIXELS,
    closing: Flags | bool = False,
    in_contact: Array | float = np.nan,
) -> ErrorPart:
    """Estimate the error of the pixels from a solution on a coarser grid.

    A step that is open on one grid and sealed on the other may be either.

    Parameters
    ----------
    coarse : the solution on the coarser grid.
    wave_pixels : pixels in the shortest wave. With more than usual, the least shift of the load is smaller in
        proportion.
    closing : whether the surface is near closing at each step (steps,), see `near_closing`.
    in_contact : contact fraction (steps,).
    """
    steps = scene.steps
    coarsening = float(np.sqrt(np.prod(scene.surface.shape) / np.prod(coarse.points)))
    change = coarse.change(leakage)
    slope = np.maximum(sensitivity(steps, leakage, np.asarray(in_contact)), _LEAST_SLOPE)
    # the change that a grid with half the points a side would show, by the order of convergence
    scaled = change * (2.0**ORDER - 1) / (coarsening**ORDER - 1)
    least = _LEAST_SHIFT * min(1.0, USUAL_PIXELS / wave_pixels)
    scale = np.hypot(scale_of_changes(steps, scaled, slope), least * slope)
    loads = int((np.isfinite(change) & steps.on_loading).sum())
    distance = PER_CHANGE * FEW_LOADS.get(loads, 1.0) * scale
    may_close = closing & (distance > _MAY_CLOSE)
    below = np.where(may_close | np.isneginf(change), np.inf, distance)
    grid = " × ".join(map(str, coarse.points))
    note = f"change of ln(leakage) to {grid} points, at a load and its neighbours; order {ORDER:g} expected"
    return part_of_changes(
        "pixels", steps, leakage, below, distance, note, change=change, coarse=coarse
    )

"""The error budget of a leakage: the band of each source of error, their combination, and the widest band of all.

Also coarser solutions of a scene, and the changes of ln(leakage) between solutions, which tell how much pixels and
removed waves matter. They are smooth functions of neither load nor pixel: where contacts open and close they have
either sign, and near closing they are a shift of the load at which the seal closes, times the slope of ln(leakage) over
ln(load). So the change at a step is that of its neighbours too, and of the typical shift over the whole cycle.
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

#: Sources of error of the model and its input, in the order in which they are shown; the others are of its solution.
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
#: Factor between a leakage and an end of its band from which on the number of that end says nothing.
VAGUE = 1000.0
#: Ratio by which a leakage may rise under a higher load by the errors of its solution.
_RISE = 1.001
#: Least slope of ln(leakage) over ln(load) that is counted.
LEAST_SLOPE = 0.3
#: Order of the leakage in the size of pixels. Measured on 320 faces of 64² to 256² points: 1.9 in the median.
ORDER = 2.0
#: Error over the scale of the changes to half the points a side, see `scale_of_changes`. Measured on 154 faces of six
#: kinds, at the loads that leak more than 1e-3 of the first: 0.28 holds 95 of 100 errors, 0.31 96.5, and 0.43 98, which
#: on other faces held 97.
PER_CHANGE = 0.43
#: The factor besides where few loads were solved on both grids, by their number; measured as above.
FEW_LOADS = {0: 3.0, 1: 3.0, 2: 1.45, 3: 1.15}
#: The least shift of the load, that of all faces, and the least slope of ln(leakage) over ln(load) that it is counted
#: with. Measured as above: with a third of the shift and a fifth of the slope as wide bands hold 94.5 in place of 97.
_LEAST_SHIFT, _LEAST_SLOPE = 0.012, 1.5
#: Slope of ln(leakage) over ln(load) over that which is expected, see `expected_sensitivity`, of nine in ten states.
STEEPEST = 2.0
#: Pixels to the shortest wave of the faces on which that was measured.
USUAL_PIXELS = 8.0
#: Leakage over that of an open seal, one whose gap is the mean gap everywhere, below which a seal is near closing.
#: Measured on 20 faces of ten kinds: about where they leak 1e-3 of what they leak under the least load.
_CLOSING_LEAKAGE = 1e-2
#: Error of ln(leakage) from which on a step near closing may be sealed.
_MAY_CLOSE = 1.5


@dataclass(frozen=True)
class ErrorPart:
    """One source of error of a leakage, with the band that holds its truth in about 95 of 100 cases.

    name : "solver", "pixels", "filter", "realisations", "patch", "places", "blocks", or one of
        `MODEL_PARTS`.
    lower, upper : leakage at every step if only this source erred (steps,) [m²/s]. A lower end of 0: may be sealed; an
        upper end of inf: no bound is known; NaN: unknown.
    note : how it was estimated, a sentence.
    """

    name: str
    lower: Array
    upper: Array
    note: str

    @classmethod
    def of(cls, name: str, leakage: Array, below: Array, above: Array, note: str) -> ErrorPart:
        """A part by its distances of ln(leakage) on both sides (steps,), inf below where it may be sealed.

        A sealed step stays sealed.
        """
        q = np.asarray(leakage, dtype=float)
        with np.errstate(invalid="ignore", over="ignore"):
            low, high = (
                np.where(q == 0, 0.0, q * np.exp(d))
                for d in (-np.asarray(below), np.asarray(above))
            )
        return cls(name, low, high, note)

    def widened(self, leakage: Array, factor: Array) -> ErrorPart:
        """The part with the distances of ln(leakage) at the open steps times a factor (steps,)."""
        q = np.asarray(leakage, dtype=float)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            lower, upper = (
                np.where(q == 0, end, q * (end / q) ** factor) for end in (self.lower, self.upper)
            )
        return replace(self, lower=lower, upper=upper)


@dataclass(frozen=True, repr=False)
class ErrorBudget:
    """The error budget of the leakage of one study of one scene.

    method : name of the study. leakage : at every step (steps,) [m²/s]. parts : sources of error. steps : the load
    programme, by which no load leaks more than a lower one: the band of a load ends where those of others do, see
    `within_others`. Without it each load has its own band. parted : steps of which the fluid carries all: they have no
    leakage.
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
        """The budget without the parts of the model and its input: what a finer solution makes smaller."""
        return replace(
            self, parts=tuple(part for part in self.parts if part.name not in MODEL_PARTS)
        )

    @property
    def lower(self) -> Array:
        """Lower end of the band at every step (steps,) [m²/s], 0 where it may be sealed, NaN where a part is unknown.

        It is that of the root of the sum of squares of the parts' distances of ln(leakage); 0 of a sealed step.
        """
        return self._ends[0]

    @property
    def upper(self) -> Array:
        """Upper end of the band (steps,) [m²/s], see `lower`; of a sealed step the largest of the parts' upper ends."""
        return self._ends[1]

    @cached_property
    def _ends(self) -> tuple[Array, Array]:
        q = np.abs(self.leakage)
        highest = np.max([np.abs(part.upper) for part in self.parts], axis=0, initial=0.0)
        with np.errstate(invalid="ignore", over="ignore"):
            low = np.where(q == 0, 0.0, q * np.exp(-self._distance("lower")))
            high = np.where(q == 0, highest, q * np.exp(self._distance("upper")))
        return (low, high) if self.steps is None else within_others(self.steps, q, low, high)

    def half_width(self, step: int | None = None) -> Array | float:
        """Larger distance of ln(leakage) to an end of the band: at every step (steps,), or at one.

        It is inf where the band has an end at 0 and the leakage is not 0, or the reverse.
        """
        widths = _width(np.abs(self.leakage), self.lower, self.upper)
        return widths if step is None else float(widths[step])

    def widths(self) -> dict[str, Array]:
        """Half-width of every part at every step (steps,), by its name, see `half_width`."""
        q = np.abs(self.leakage)
        return {part.name: _width(q, np.abs(part.lower), np.abs(part.upper)) for part in self.parts}

    def limiting(self, step: int | None = None) -> str:
        """Name of the widest part at a step; unless given, over all steps that leak more than 1e-3 of the first.

        "" without parts.
        """
        widths = self.widths()
        if not widths:
            return ""
        q = np.abs(self.leakage)
        chosen = q > least_counted(q) if step is None else np.arange(q.size) == step
        chosen = chosen if chosen.any() else np.ones_like(chosen)
        return max(widths, key=lambda name: _largest(widths[name][chosen]))

    def _distance(self, end: str) -> Array:
        """Root of the sum of squares of the parts' distances of ln(leakage) to an end (steps,)."""
        total = np.zeros(np.shape(self.leakage))
        for part in self.parts:
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = np.abs(getattr(part, end)) / np.abs(self.leakage)
                total += np.where(self.leakage == 0, 0.0, np.log(ratio) ** 2)
        return np.sqrt(total)


def within_others(
    steps: LoadProgramme, leakage: Array, lower: Array, upper: Array
) -> tuple[Array, Array]:
    """Ends of bands (steps,) that do not go beyond those of other loads.

    A seal leaks no more under a higher load of the same branch, and no more on unloading than it did on loading under
    the same load. Bands of leakages that do not fall so, as under maps of the pressure that change with the load, are
    left as they are. Ends that are unknown stay so, and the leakage itself stays within its band.
    """
    rising = np.flatnonzero(steps.on_loading)
    (high, low), (least, most) = (
        _from_others(steps, rising, a, b) for a, b in ((upper, lower), (leakage, leakage))
    )
    if (leakage > _RISE * least).any() or (_RISE * leakage < most).any():
        return lower, upper
    low, high = np.where(np.isnan(lower), np.nan, low), np.where(np.isnan(upper), np.nan, high)
    with np.errstate(invalid="ignore"):
        return np.minimum(low, leakage), np.maximum(high, leakage)


def near_closing(leakage: Array, open_leakage: Array) -> Flags:
    """Whether a surface is near closing at each step (steps,): it leaks far less than its mean gap would.

    open_leakage : of a uniform gap as large as the mean gap of the state (steps,) [m²/s]; NaN where it is unknown.
    """
    with np.errstate(invalid="ignore"):
        return np.abs(leakage) < _CLOSING_LEAKAGE * np.abs(open_leakage)


def _from_others(
    steps: LoadProgramme, rising: Indices, upper: Array, lower: Array
) -> tuple[Array, Array]:
    """The least upper end of the loads that leak no less, and the largest lower end of those that leak no more."""
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
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.maximum(np.log(leakage / lower), np.log(upper / leakage))
    sealed = np.where(np.isnan(upper), np.nan, np.where(upper > 0, np.inf, 0.0))
    return np.where(leakage == 0, sealed, width)


@dataclass(frozen=True)
class WidestBand:
    """The widest band of a budget at the loads that count, see `counting_steps`.

    half_width : of ln(leakage), see `ErrorBudget.half_width`; inf where it is unknown or has no end. step : index of
    the load where it is widest. limit : the widest part at any of the loads. parts : half-width of every part, the
    widest at any of the loads.
    """

    half_width: float
    step: int
    limit: str
    parts: dict[str, float]


def counting_steps(budget: ErrorBudget) -> np.ndarray:
    """Indices of the loads at which the leakage is more than 1e-3 of the first, or unknown.

    Where nothing leaks at the first load, all count that leak or may do so. Others that are found sealed do not count:
    the wide bands at the loads before them tell if they may be open. Nor do those of which the fluid carries all.
    """
    q, upper = np.abs(budget.leakage), np.abs(budget.upper)
    least = np.nan_to_num(least_counted(q))
    counts = (q != 0) | (upper != 0) if least == 0 else (q > least) | np.isnan(q)
    counts[list(budget.parted)] = False
    return np.flatnonzero(counts)


def vague_steps(budget: ErrorBudget) -> Indices:
    """Indices of the loads that may leak more than `VAGUE` times as much as found, or, where they count, as little."""
    q = np.abs(budget.leakage)
    counts = np.zeros(len(budget.leakage), bool)
    counts[counting_steps(budget)] = True
    return np.flatnonzero(
        (q > 0) & ((budget.upper > VAGUE * q) | (counts & (VAGUE * budget.lower < q)))
    )


def widest_band(budget: ErrorBudget) -> WidestBand:
    """Judge a budget. Pixels of which nothing is known have no end."""
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
    return float(np.max(np.nan_to_num(widths, nan=inf, posinf=inf), initial=0.0))


@dataclass(frozen=True)
class CoarserSolution:
    """Leakage of a scene that was solved otherwise: on fewer points, or without its shortest waves.

    points : of the face. leakage : at every step of the scene [m²/s].
    against : leakage of the same study on the points of the scene; None: that of which the budget is.
    rms_slope : of the face; None where it is not known.
    """

    points: Shape
    leakage: Array
    against: Array | None = None
    rms_slope: float | None = None

    def change(self, leakage: Array) -> Array:
        """Change of ln(leakage) to this solution at every step (steps,), unless `against` says otherwise.

        It is inf or -inf where one of the two is sealed, 0 where both are, NaN where one is unknown.
        """
        own = np.abs(np.asarray(leakage if self.against is None else self.against, float))
        other = np.abs(np.asarray(self.leakage, float))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where((own == 0) & (other == 0), 0.0, np.log(other / own))


def expected_sensitivity(in_contact: Array) -> Array:
    """Slope |d ln(leakage) / d ln(load)| that the fraction in contact lets expect (steps,), whatever other loads say.

    Measured on 25 faces of five kinds at up to 16 loads each: the median is 0.6 below 2 % of contact, 1.0 at 5 %, 2.0
    at 17 %, 4.0 at 32 % and 4.9 at 45 %; nine in ten states have at most about twice as much.
    """
    return 0.5 + 9.0 * np.nan_to_num(np.asarray(in_contact, float))


def sensitivity(steps: LoadProgramme, leakage: Array, in_contact: Array) -> Array:
    """Slope |d ln(leakage) / d ln(load)| at every step (steps,), no less than its contact lets expect.

    It is that to the loads beside a step. A load that is solved alone has the largest slope of nine in ten states, so
    that what follows from it is no narrower than among other loads.

    in_contact : fraction in contact at every step (steps,), NaN where it is unknown.
    """
    expected = expected_sensitivity(in_contact)
    found = load_sensitivity(steps, leakage)
    return np.where(found > 0, np.maximum(found, expected), STEEPEST * expected)


def scale_of_changes(steps: LoadProgramme, change: Array, slope: Array) -> Array:
    """Size of the changes of ln(leakage) at every step (steps,), from those of the steps near it and of all of them.

    It is made of the rms change of the nearest two or more steps, and of the mean shift of the load over the cycle.

    change : of ln(leakage) at every step. slope : see `load_sensitivity`, > 0.
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
    """Mean shift of ln(load) of changes of ln(leakage) over its slope, 0 without any."""
    return float(np.mean(np.abs(change / slope))) if change.size else 0.0


def sealed_upper(
    steps: LoadProgramme,
    q: Array,
    distance: Array,
    change: Array | None = None,
    coarse: CoarserSolution | None = None,
) -> Array:
    """Upper end at the sealed steps (steps,) [m²/s], 0 elsewhere.

    It is the upper end of the next open step, where that is within the shift of the load at which the error would open
    the seal; and what the other solution leaks there, if there is one.

    q : leakage. distance : of ln(leakage) to the upper end. change : of ln(leakage) to the other solution.
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
    """A part by its distances of ln(leakage) on both sides (steps,), its upper end at sealed steps by `sealed_upper`.

    change, coarse : of ln(leakage) to the other solution, where the part comes from one; unknown where it is NaN.
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
    """Part of the pixels, from the solution on a coarser grid.

    A step that is open on one grid and sealed on the other may be either. wave_pixels : to the shortest wave; where
    they are more than usual, the least shift of the load is in proportion to the size of the pixels.
    closing : whether the surface is near closing at each step, see `near_closing`. in_contact : fraction in contact at
    every step (steps,).
    """
    steps = scene.steps
    coarsening = float(np.sqrt(np.prod(scene.surface.shape) / np.prod(coarse.points)))
    change = coarse.change(leakage)
    slope = np.maximum(sensitivity(steps, leakage, np.asarray(in_contact)), _LEAST_SLOPE)
    # as if the change were that to half the points a side, by the order of the leakage
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

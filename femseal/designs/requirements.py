"""Pressures that a seal needs: in assembly for a leakage class, in service to keep it, and to seal at all.

Between load steps of the leakage of many seals ln(leakage) is straight in ln(pressure); beyond the steps nothing is
extrapolated: a pressure is then known to lie above the highest or below the lowest one. Where a seal opens or closes
between two steps, and at a load of 0, the pressure of the step that keeps the limit is taken.

What is needed is that of the upper end of the whole band of error of the run; that of the seals as they were computed,
and of the lower end, stand beside.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil, inf

import numpy as np

from ..base import Array, Indices, reals
from ..base.leak_rates import within
from ..budget.error_parts import within_others
from ..loads import LoadProgramme, LoadStep, relaxed
from ..results.results import Results


@dataclass(frozen=True, eq=False)
class Seals:
    """Leakages of seals of one kind.

    steps : the load programme. leakage : size of the leakage per length (seals, steps) [m²/s]; inf where a seal is
    computed as sealed, but the upper end of its band of error is not known. lower, upper : leakages at the ends of the
    whole band of error (seals, steps), the leakage itself where no band is known.
    """

    steps: LoadProgramme
    leakage: Array
    lower: Array
    upper: Array

    @classmethod
    def of_results(cls, results: Results) -> Seals:
        """The realisations of a run, or its one seal, with the fluid that decides on leakage classes.

        What is sealed and may be open by its error budget is taken for open: its leakage is inf.
        """
        _, several = results.class_leakage
        if (budget := results.budget) is None:
            return cls.of(results.steps, several)
        several = np.where((several == 0) & ~np.isfinite(budget.upper), inf, several)
        own = np.abs(budget.leakage)
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = [np.where(own > 0, end / own, 1.0) for end in (budget.lower, budget.upper)]
        lower, upper = (np.nan_to_num(end, nan=1.0, posinf=inf) for end in ends)
        opened = np.where(own > 0, 0.0, results.class_upper)
        return cls.of(results.steps, several, lower, upper, opened)

    @classmethod
    def of(
        cls,
        steps: LoadProgramme,
        leakage: Array,
        lower: Array | float = 1.0,
        upper: Array | float = 1.0,
        opened: Array | float = 0.0,
    ) -> Seals:
        """Seals of leakages of any direction, inf where one is not known; those that failed at a step are left out.

        Loads below all of their branch whose leakage is known, as those that the fluid carries alone, are taken for
        open. A fluid opens a face that is unloaded at another load than one that is pressed for the first time.

        lower, upper : ends of the band over the leakage (steps,), which go no further than those of other loads.
        opened : least upper end (steps,) [m²/s].
        """
        size = np.abs(np.atleast_2d(reals(leakage)))
        known, pressures = ~np.isnan(size).all(axis=0), steps.pressures
        for peak in {step.unloaded_from for step in steps} if known.any() else ():
            own = np.array([step.unloaded_from == peak for step in steps])
            lowest = pressures[own & known].min(initial=inf if peak is None else peak)
            size[:, own & (pressures < lowest)] = inf
        size = size[~np.isnan(size).any(axis=1)]
        with np.errstate(invalid="ignore"):
            low, high = (np.where(size == 0, 0.0, size * factor) for factor in (lower, upper))
        low, high = (np.where(np.isnan(end), size, end) for end in (low, high))
        seals = zip(size, np.minimum(low, size), np.fmax(high, opened), strict=True)
        ends = np.reshape([within_others(steps, *seal) for seal in seals], (-1, 2, len(steps)))
        return cls(steps, size, ends[:, 0], ends[:, 1])

    @property
    def count(self) -> int:
        """Number of seals."""
        return len(self.leakage)

    def curve_of(self, fraction: float) -> Array:
        """Leakage that a fraction of the seals does not exceed, at each step [m²/s]."""
        return np.sort(self.leakage, axis=0)[_rank(fraction, self.count)]

    def falling(self, peak: float | None = None) -> Indices:
        """Steps of the loading, or of the unloading from a peak, which they begin with, from the highest load down."""
        loading = np.flatnonzero(self.steps.on_loading)[::-1]
        if peak is None:
            return loading
        unloading = [n for n, step in enumerate(self.steps) if step.unloaded_from == peak]
        return np.r_[loading[self.steps.pressures[loading] == peak], unloading]

    def needed(self, limit: float, peak: float | None = None) -> Array:
        """Pressure down to which each seal, on loading or unloaded from a peak, keeps the limit (seals,) [Pa].

        inf: it leaks more at the highest load already; 0: it does not at any load.
        """
        steps = self.falling(peak)
        return crossings(self.steps.pressures[steps], self.leakage[:, steps], limit)

    def peaks(self) -> Indices:
        """Loading steps of the peaks, rising."""
        return np.flatnonzero(
            self.steps.on_loading & np.isin(self.steps.pressures, self.steps.unload_from)
        )

    def needed_with_relaxation(self, limit: float, relaxation: float) -> Array:
        """Lowest peak from which on each seal, once relaxed, keeps the limit (seals,) [Pa]; inf, 0 as above."""
        found = {step: n for n, step in enumerate(self.steps)}
        peaks = self.steps.pressures[self.peaks()][::-1]
        after = [found[LoadStep(relaxed(p, relaxation), p)] for p in peaks.tolist()]
        return crossings(peaks, self.leakage[:, after], limit)


def crossings(pressure: Array, leakage: Array, limit: float) -> Array:
    """Lowest pressure down to which the leakage stays within a limit (seals,); inf where it never is, 0 where always.

    pressure : falling (steps,). leakage : (seals, steps). limit : >= 0; 0 asks for the end of all leakage.
    """
    ok = within(leakage, limit)
    seals = np.arange(len(leakage))
    first = np.argmin(ok, axis=1)  # the first that is not
    above = np.maximum(first - 1, 0)
    high, low = np.broadcast_to(pressure, leakage.shape)[seals, above], pressure[first]
    kept, lost = leakage[seals, above], leakage[seals, first]
    smooth = (kept > 0) & (low > 0) & (lost > kept) & (limit > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        way = np.where(smooth, np.log(limit / kept) / np.log(lost / kept), 0.0)
        between = np.where(smooth, high * (low / high) ** np.clip(way, 0, 1), high)
    return np.where(ok.all(axis=1), 0.0, np.where(first == 0, inf, between))


def _rank(fraction: float, count: int) -> int:
    return min(max(ceil(fraction * count - 1e-9), 1), count) - 1


#: A pressure [Pa] as text, with the force that makes it where the loads are forces.
LoadText = Callable[[float], str]
#: Ends of the band between seals.
ENDS = (0.05, 0.95)


@dataclass(frozen=True)
class NeededPressure:
    """A nominal pressure [Pa] that is enough for a fraction of the seals.

    value : by the upper end of the whole band of error [Pa]; inf where the loads of the run are not enough, 0 where the
    lowest of them is. computed, low : by the leakage as computed, and by the lower end of the band. lowest, highest :
    loads between which it is known.
    """

    value: float
    computed: float
    low: float
    lowest: float
    highest: float

    @property
    def known(self) -> bool:
        """Whether the value lies within the loads."""
        return 0 < self.value < inf

    @property
    def at(self) -> float:
        """The pressure by the leakage as computed, where it lies within the loads; else NaN."""
        return self.computed if 0 < self.computed < inf else np.nan

    @property
    def relation(self) -> str:
        """ "=", or "<=" or ">" where only a bound is known."""
        return {inf: ">", 0.0: "<="}.get(self.value, "=")

    def bound(self, value: float) -> float:
        """A pressure, or the load that bounds it."""
        return {inf: self.highest, 0.0: self.lowest}.get(value, value)

    def text(self, shown: LoadText) -> str:
        """The value as text; in brackets what the leakage as computed needs, where that differs."""
        value, computed = self._text(self.value, shown), self._text(self.computed, shown)
        return value if value == computed else f"{value} (as computed: {computed})"

    def _text(self, value: float, shown: LoadText) -> str:
        return {inf: "above ", 0.0: "at most "}.get(value, "") + shown(self.bound(value))


@dataclass(frozen=True)
class Requirement:
    """What a class of leakage needs.

    name : of the class. limit : its largest leakage per length [m²/s]. assembly : Qmin, the pressure in assembly that
    reaches it. service : QSmin by the pressure in assembly Q_A [Pa]: that to which it may fall after. relaxed : the
    pressure in assembly that still meets it after relaxation; None without.
    """

    name: str
    limit: float
    assembly: NeededPressure
    service: dict[float, NeededPressure]
    relaxed: NeededPressure | None = None


def requirement(
    seals: Seals, name: str, limit: float, fraction: float, relaxation: float = 0.0
) -> Requirement:
    """What a limit of leakage per length [m²/s] needs with a fraction of the seals, whose loads relax by a fraction."""

    def needed(peak: float | None) -> NeededPressure:
        return _needed(seals, lambda some: some.needed(limit, peak), seals.falling(peak), fraction)

    after = None
    if relaxation and seals.steps.unload_from:
        after = _needed(
            seals,
            lambda some: some.needed_with_relaxation(limit, relaxation),
            seals.peaks(),
            fraction,
        )
    service = {peak: needed(peak) for peak in seals.steps.unload_from}
    return Requirement(name, limit, needed(None), service, after)


def sealing_load(seals: Seals, fraction: float) -> NeededPressure:
    """Pressure in assembly from which on nothing leaks, with a fraction of the seals."""
    return _needed(seals, lambda some: some.needed(0.0), seals.falling(), fraction)


def _needed(
    seals: Seals, of: Callable[[Seals], Array], steps: Indices, fraction: float
) -> NeededPressure:
    """The pressure that a fraction of the seals needs: as computed, and by both ends of the whole band of error.

    It is an order statistic, without interpolation.
    """
    computed, low, high = (
        float(np.sort(of(replace(seals, leakage=leakage)))[_rank(fraction, seals.count)])
        for leakage in (seals.leakage, seals.lower, seals.upper)
    )
    pressure = seals.steps.pressures[steps]
    return NeededPressure(
        value=high,
        computed=computed,
        low=low,
        lowest=float(pressure.min()),
        highest=float(pressure.max()),
    )

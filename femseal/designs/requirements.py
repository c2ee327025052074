"""Pressures that a seal needs: in assembly for a leakage class, in service to keep it, and to seal at all.

They are those of the verdict on a class (`results/verdict.py`): by the leakage of the run as computed, and by the ends
of its 95 % interval, which contains the scatter of the seals. What a fraction of the seals needs as computed stands
beside.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, inf

import numpy as np

from ..base import Array, Indices, reals
from ..loads import LoadProgramme
from ..results.results import Results
from ..results.verdict import (
    LeakageCurve,
    NeededPressure,
    crossings,
    falling_steps,
    relaxed_steps,
)

#: Ends of the band between seals.
ENDS = (0.05, 0.95)


@dataclass(frozen=True, eq=False)
class Seals:
    """Leakages of seals of one kind.

    steps : the load programme. leakage : size of the leakage per length (seals, steps) [m²/s]; inf where a seal is
    computed as sealed, but the upper end of its interval is not known. curve : the leakage that the run gives, such as
    their median, with its interval.
    """

    steps: LoadProgramme
    leakage: Array
    curve: LeakageCurve

    @classmethod
    def of_results(cls, results: Results) -> Seals:
        """The realisations of a run, or its one seal, with the fluid that decides on leakage classes."""
        _, several = results.class_leakage
        interval = results.class_interval
        if interval is not None:
            several = np.where((several == 0) & ~np.isfinite(interval[1]), inf, several)
        return cls._of_known(results.steps, several, LeakageCurve.of_results(results))

    @classmethod
    def of(
        cls,
        steps: LoadProgramme,
        leakage: Array,
        interval: tuple[Array, Array] | None = None,
    ) -> Seals:
        """Seals of leakages of any direction, inf where one is not known; those that failed at a step are left out.

        interval : ends of the 95 % interval of their median (steps,) [m²/s]; None without one.
        """
        several = np.abs(np.atleast_2d(reals(leakage)))
        with np.errstate(invalid="ignore"):
            middle = np.sort(several, axis=0)[(len(several) - 1) // 2]
        return cls._of_known(steps, several, LeakageCurve.of(steps, middle, interval))

    @classmethod
    def _of_known(cls, steps: LoadProgramme, leakage: Array, curve: LeakageCurve) -> Seals:
        """Loads below all of their branch whose leakage is known, as those that the fluid carries alone, are open.

        A fluid opens a face that is unloaded at another load than one that is pressed for the first time.
        """
        size = np.abs(np.atleast_2d(reals(leakage)))
        known, pressures = ~np.isnan(size).all(axis=0), steps.pressures
        for peak in {step.unloaded_from for step in steps} if known.any() else ():
            own = np.array([step.unloaded_from == peak for step in steps])
            lowest = pressures[own & known].min(initial=inf if peak is None else peak)
            size[:, own & (pressures < lowest)] = inf
        return cls(steps, size[~np.isnan(size).any(axis=1)], curve)

    @property
    def count(self) -> int:
        """Number of seals."""
        return len(self.leakage)

    def curve_of(self, fraction: float) -> Array:
        """Leakage that a fraction of the seals does not exceed, at each step [m²/s]."""
        return np.sort(self.leakage, axis=0)[_rank(fraction, self.count)]

    def falling(self, peak: float | None = None) -> Indices:
        """Steps of the loading, or of the unloading from a peak, which they begin with, from the highest load down."""
        return falling_steps(self.steps, peak)

    def needed(self, limit: float, peak: float | None = None) -> Array:
        """Pressure down to which each seal, on loading or unloaded from a peak, keeps the limit (seals,) [Pa].

        inf: it leaks more at the highest load already; 0: it does not at any load.
        """
        steps = self.falling(peak)
        return crossings(self.steps.pressures[steps], self.leakage[:, steps], limit)

    def needed_with_relaxation(self, limit: float, relaxation: float) -> Array:
        """Lowest peak from which on each seal, once relaxed, keeps the limit (seals,) [Pa]; inf, 0 as above."""
        peaks, after = relaxed_steps(self.steps, relaxation)
        return crossings(peaks, self.leakage[:, after], limit)

    def needed_by(self, fraction: float, limit: float, peak: float | None = None) -> NeededPressure:
        """What a fraction of the seals needs as computed: an order statistic, without interpolation."""
        value = float(np.sort(self.needed(limit, peak))[_rank(fraction, self.count)])
        pressures = self.steps.pressures[self.falling(peak)]
        ends = float(pressures.min()), float(pressures.max())
        return NeededPressure(
            value, value, value, *ends, on_unloading=peak is not None, has_interval=False
        )


def _rank(fraction: float, count: int) -> int:
    return min(max(ceil(fraction * count - 1e-9), 1), count) - 1


@dataclass(frozen=True)
class Requirement:
    """What a class of leakage needs.

    name : of the class. limit : its largest leakage per length [m²/s]. assembly : Qmin, the pressure in assembly that
    reaches it. service : QSmin by the pressure in assembly Q_A [Pa]: that to which it may fall after. of_seals :
    pressure in assembly that is enough for a fraction of the seals as computed. relaxed : the pressure in assembly that
    still meets it after relaxation; None without.
    """

    name: str
    limit: float
    assembly: NeededPressure
    service: dict[float, NeededPressure]
    of_seals: NeededPressure
    relaxed: NeededPressure | None = None


def requirement(
    seals: Seals, name: str, limit: float, fraction: float, relaxation: float = 0.0
) -> Requirement:
    """What a limit of leakage per length [m²/s] needs, also with a fraction of the seals; loads relax by a fraction."""
    curve, after = seals.curve, None
    if relaxation and seals.steps.unload_from:
        after = curve.needed_with_relaxation(limit, relaxation)
    return Requirement(
        name=name,
        limit=limit,
        assembly=curve.needed(limit),
        service={peak: curve.needed(limit, peak) for peak in seals.steps.unload_from},
        of_seals=seals.needed_by(fraction, limit),
        relaxed=after,
    )


def sealing_load(seals: Seals) -> NeededPressure:
    """Pressure in assembly from which on nothing leaks."""
    return seals.curve.needed(0.0)

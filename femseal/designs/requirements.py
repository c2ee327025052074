"""Find the pressures in assembly and in service at which a seal meets a leakage class, or does not leak at all.

The verdict on a class states the same loads (`results/verdict.py`). Each pressure has three values: one for the
computed leakage, and one for each end of its 95 % interval. The interval includes the scatter between realisations.
In addition, there is the pressure at which a certain fraction of the realisations meets the class, judged by their
computed leakage.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, inf

import numpy as np

from ..base import Array, Indices, reals
from ..loads import LoadProgramme
from ..results.needed_pressure import (
    LeakageCurve,
    NeededPressure,
    crossings,
    falling_steps,
    relaxed_steps,
)
from ..results.results import Results

#: Quantiles of the realisations that the picture shows as their scatter.
ENDS = (0.05, 0.95)


@dataclass(frozen=True, eq=False)
class Seals:
    """Leakages of all realisations of a seal at all load steps.

    Parameters
    ----------
    steps : LoadProgramme
        The load steps.
    leakage : array (realisations, steps)
        Magnitude of the leakage per length [m²/s]. It is infinite where the seal may leak by any amount, for example if
        the computed leakage is 0 and the upper end of its 95 % interval is unknown.
    curve : LeakageCurve
        Leakage reported by the run, for example the median of the realisations, with its 95 % interval.
    """

    steps: LoadProgramme
    leakage: Array
    curve: LeakageCurve

    @classmethod
    def from_results(cls, results: Results) -> Seals:
        """Collect the leakages of all realisations of a run, or of its single seal.

        If the case has a test fluid, its leakage is used, since this is what leakage classes limit.
        """
        _, leakage = results.class_leakage
        interval = results.class_interval
        if interval is not None:
            _, upper = interval
            # a computed leakage of 0 without an upper end says nothing: count it as leaking
            leakage = np.where((leakage == 0) & ~np.isfinite(upper), inf, leakage)
        return cls._with_open_loads(results.steps, leakage, LeakageCurve.of_results(results))

    @classmethod
    def from_leakage(
        cls,
        steps: LoadProgramme,
        leakage: Array,
        interval: tuple[Array, Array] | None = None,
    ) -> Seals:
        """Collect the leakages of realisations, except those whose solution failed at a load step.

        Parameters
        ----------
        steps : LoadProgramme
            The load steps.
        leakage : array (realisations, steps) or (steps,)
            Leakage per length of seal [m²/s], positive or negative; infinite if the leakage is unknown, and NaN if the
            solution failed.
        interval : pair of arrays (steps,), optional
            Ends of the 95 % interval of the median [m²/s].
        """
        magnitude = np.abs(np.atleast_2d(reals(leakage)))
        # The median is the leakage of one realisation. For an even number of realisations, it is the smaller of the two
        # leakages in the middle.
        middle = (len(magnitude) - 1) // 2
        with np.errstate(invalid="ignore"):
            median = np.sort(magnitude, axis=0)[middle]
        return cls._with_open_loads(steps, magnitude, LeakageCurve.of(steps, median, interval))

    @classmethod
    def _with_open_loads(cls, steps: LoadProgramme, leakage: Array, curve: LeakageCurve) -> Seals:
        """Create the seals; where the leakage at a low load is unknown, set it to infinity.

        At low loads, the fluid pressure alone may carry the load, so that the faces are separated and the leakage is
        unknown. On each branch (the loading, or one unloading), a load counts as low if it is below all loads whose
        leakage is known. The branches are treated separately, because the faces do not separate at the same load on all
        of them.
        """
        magnitude = np.abs(np.atleast_2d(reals(leakage)))
        is_known = ~np.isnan(magnitude).all(axis=0)  # (steps,)
        if is_known.any():
            for peak in {step.unloaded_from for step in steps}:
                on_branch = np.array([step.unloaded_from == peak for step in steps])
                known_pressures = steps.pressures[on_branch & is_known]
                # If no leakage of a branch is known, all loads of the branch count as low. In an unloading, these are
                # all loads below `peak`; the load step at `peak` belongs to the loading.
                highest_possible = inf if peak is None else peak
                lowest_known = known_pressures.min(initial=highest_possible)
                magnitude[:, on_branch & (steps.pressures < lowest_known)] = inf
        is_complete = ~np.isnan(magnitude).any(axis=1)  # (realisations,)
        return cls(steps, magnitude[is_complete], curve)

    @property
    def count(self) -> int:
        """Number of realisations."""
        return len(self.leakage)

    def quantile_curve(self, fraction: float) -> Array:
        """Return the quantile of the leakage: the leakage that a given fraction of the realisations does not exceed.

        The result is the leakage per length of seal at each load step, (steps,) [m²/s].
        """
        return np.sort(self.leakage, axis=0)[_rank(fraction, self.count)]

    def steps_from_highest(self, peak: float | None = None) -> Indices:
        """List the step indices of a branch, from the highest load to the lowest.

        peak : nominal pressure [Pa] from which the seal is unloaded; None selects the loading. For an unloading, the
        list begins with the load step at the pressure `peak`.
        """
        return falling_steps(self.steps, peak)

    def needed_pressures(self, limit: float, peak: float | None = None) -> Array:
        """Find, for each realisation, the lowest pressure at which it meets a leakage limit.

        Parameters
        ----------
        limit : float
            Largest leakage per length of seal [m²/s] that is allowed.
        peak : float, optional
            Pressure from which the seal is unloaded [Pa]. Default: loading.

        Returns
        -------
        array (realisations,)
            Nominal pressure [Pa]; infinite if the limit is exceeded even at the highest load, and 0 if it is never
            exceeded.
        """
        steps = self.steps_from_highest(peak)
        return crossings(self.steps.pressures[steps], self.leakage[:, steps], limit)

    def needed_with_relaxation(self, limit: float, relaxation: float) -> Array:
        """Find, per realisation, the lowest pressure in assembly at which it still meets a limit after relaxation.

        relaxation : fraction of the load that is lost by relaxation.

        The limit and the result are defined as in `needed_pressures`.
        """
        peaks, steps_after = relaxed_steps(self.steps, relaxation)
        return crossings(peaks, self.leakage[:, steps_after], limit)

    def needed_by_fraction(
        self, fraction: float, limit: float, peak: float | None = None
    ) -> NeededPressure:
        """Find the pressure at which the computed leakage of a given fraction of the realisations meets a limit.

        Each realisation has its own lowest pressure at which it meets the limit. The result is a quantile of these
        pressures, without interpolation.
        """
        value = float(np.sort(self.needed_pressures(limit, peak))[_rank(fraction, self.count)])
        pressures = self.steps.pressures[self.steps_from_highest(peak)]
        return NeededPressure(
            value=value,
            computed=value,
            low=value,
            lowest=float(pressures.min()),
            highest=float(pressures.max()),
            on_unloading=peak is not None,
            has_interval=False,
        )


def _rank(fraction: float, count: int) -> int:
    """Return the index of a quantile in a sorted array of `count` values.

    The quantile is the smallest value that at least the given fraction of the values does not exceed.
    """
    # a product that is slightly above 9 because of rounding counts as 9
    number = ceil(fraction * count - 1e-9)
    return min(max(number, 1), count) - 1


@dataclass(frozen=True)
class Requirement:
    """Pressures at which a seal meets a leakage class.

    Parameters
    ----------
    name : str
        Name of the class.
    limit : float
        Largest leakage per length that the class allows [m²/s].
    assembly : NeededPressure
        Qmin, the lowest pressure in assembly at which the class is met.
    service : dict of NeededPressure
        QSmin for each pressure in assembly Q_A [Pa]: the lowest pressure to which the seal may be unloaded in service.
    for_fraction : NeededPressure
        Lowest pressure in assembly at which a given fraction of the realisations meets the class. The pressure follows
        from the computed leakages, without their 95 % intervals.
    relaxed : NeededPressure, optional
        Lowest pressure in assembly at which the seal still meets the class after relaxation.
    """

    name: str
    limit: float
    assembly: NeededPressure
    service: dict[float, NeededPressure]
    for_fraction: NeededPressure
    relaxed: NeededPressure | None = None


def requirement(
    seals: Seals, name: str, limit: float, fraction: float, relaxation: float = 0.0
) -> Requirement:
    """Find the pressures at which a seal meets a leakage class.

    Parameters
    ----------
    seals : Seals
        Leakages of the realisations.
    name : str
        Name of the class.
    limit : float
        Largest leakage per length that the class allows [m²/s].
    fraction : float
        Fraction of the realisations that must meet the class at the pressure `Requirement.for_fraction`.
    relaxation : float
        Fraction of the load in assembly that is lost before service.

    Returns
    -------
    Requirement
    """
    curve = seals.curve
    peaks = seals.steps.unload_from
    with_relaxation = None
    if relaxation and peaks:
        with_relaxation = curve.needed_with_relaxation(limit, relaxation)
    return Requirement(
        name=name,
        limit=limit,
        assembly=curve.needed(limit),
        service={peak: curve.needed(limit, peak) for peak in peaks},
        for_fraction=seals.needed_by_fraction(fraction, limit),
        relaxed=with_relaxation,
    )


def sealing_load(seals: Seals) -> NeededPressure:
    """Find the lowest pressure in assembly at which the seal does not leak."""
    return seals.curve.needed(0.0)

"""Find the pressures that a seal needs: in assembly to meet a leakage class, in service to keep it, and to be tight.

They are the loads of the verdict on a class (`results/verdict.py`): those of the leakage as computed, and those of the
ends of its 95 % interval, which contains the scatter between realisations. Another pressure is what a given fraction
of the realisations needs as computed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, inf

import numpy as np

from ..base import Array, Indices, reals
from ..loads import LoadProgramme
from ..results.results import Results
from ..results.verdict import LeakageCurve, NeededPressure, crossings, falling_steps, relaxed_steps

#: Quantiles of the realisations between which their scatter is drawn.
ENDS = (0.05, 0.95)


@dataclass(frozen=True, eq=False)
class Seals:
    """Leakages of the realisations of one seal.

    Parameters
    ----------
    steps : LoadProgramme
        The load steps.
    leakage : array (realisations, steps)
        Magnitude of the leakage per length [m²/s]. It is infinite where a seal is computed as tight although the upper
        end of its 95 % interval is unknown.
    curve : LeakageCurve
        The leakage that the run gives, such as the median of the realisations, with its interval.
    """

    steps: LoadProgramme
    leakage: Array
    curve: LeakageCurve

    @classmethod
    def of_results(cls, results: Results) -> Seals:
        """Take the realisations of a run, or its one seal, with the fluid that decides on leakage classes."""
        _, leakage = results.class_leakage
        interval = results.class_interval
        if interval is not None:
            _, upper = interval
            leakage = np.where((leakage == 0) & ~np.isfinite(upper), inf, leakage)
        return cls._with_open_loads(results.steps, leakage, LeakageCurve.of_results(results))

    @classmethod
    def of(
        cls,
        steps: LoadProgramme,
        leakage: Array,
        interval: tuple[Array, Array] | None = None,
    ) -> Seals:
        """Make seals from leakages; those that failed at a load step are left out.

        Parameters
        ----------
        steps : LoadProgramme
            The load steps.
        leakage : array (realisations, steps) or (steps,)
            Leakage per length in either direction [m²/s]; infinite if unknown, NaN if the solution failed.
        interval : pair of arrays (steps,), optional
            Ends of the 95 % interval of the median [m²/s].
        """
        magnitude = np.abs(np.atleast_2d(reals(leakage)))
        with np.errstate(invalid="ignore"):
            median = np.sort(magnitude, axis=0)[(len(magnitude) - 1) // 2]
        return cls._with_open_loads(steps, magnitude, LeakageCurve.of(steps, median, interval))

    @classmethod
    def _with_open_loads(cls, steps: LoadProgramme, leakage: Array, curve: LeakageCurve) -> Seals:
        """Mark low loads whose leakage is unknown as open: the fluid carries these loads alone.

        These are the loads below all loads of their branch whose leakage is known. Each branch is treated on its own,
        because a fluid opens an unloaded surface at another load than one that is pressed for the first time.
        """
        magnitude = np.abs(np.atleast_2d(reals(leakage)))
        is_known = ~np.isnan(magnitude).all(axis=0)  # (steps,)
        if is_known.any():
            for peak in {step.unloaded_from for step in steps}:
                on_branch = np.array([step.unloaded_from == peak for step in steps])
                known_pressures = steps.pressures[on_branch & is_known]
                lowest_known = known_pressures.min(initial=inf if peak is None else peak)
                magnitude[:, on_branch & (steps.pressures < lowest_known)] = inf
        is_complete = ~np.isnan(magnitude).any(axis=1)  # (realisations,)
        return cls(steps, magnitude[is_complete], curve)

    @property
    def count(self) -> int:
        """Number of realisations."""
        return len(self.leakage)

    def curve_of(self, fraction: float) -> Array:
        """Find the leakage per length that a fraction of the realisations does not exceed (steps,) [m²/s]."""
        return np.sort(self.leakage, axis=0)[_rank(fraction, self.count)]

    def falling(self, peak: float | None = None) -> Indices:
        """List the steps of the loading, or of the unloading from a peak including it, from the highest load down."""
        return falling_steps(self.steps, peak)

    def needed(self, limit: float, peak: float | None = None) -> Array:
        """Find the pressure down to which each realisation stays within a limit.

        Parameters
        ----------
        limit : float
            Largest leakage per length [m²/s].
        peak : float, optional
            Pressure from which the seal is unloaded [Pa]; the loading unless given.

        Returns
        -------
        array (realisations,)
            Nominal pressure [Pa]; infinite if the limit is exceeded at the highest load already, 0 if at no load.
        """
        steps = self.falling(peak)
        return crossings(self.steps.pressures[steps], self.leakage[:, steps], limit)

    def needed_with_relaxation(self, limit: float, relaxation: float) -> Array:
        """Find the lowest peak from which on each realisation stays within a limit after relaxation.

        The parameters, and the result (realisations,) [Pa], are those of `needed`; `relaxation` is the fraction of the
        load that is lost.
        """
        peaks, steps_after = relaxed_steps(self.steps, relaxation)
        return crossings(peaks, self.leakage[:, steps_after], limit)

    def needed_by(self, fraction: float, limit: float, peak: float | None = None) -> NeededPressure:
        """Find the pressure that a fraction of the realisations needs as computed.

        It is the pressure that one of them needs, an order statistic, and is not interpolated between realisations.
        """
        value = float(np.sort(self.needed(limit, peak))[_rank(fraction, self.count)])
        pressures = self.steps.pressures[self.falling(peak)]
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
    """Find the index of the sorted value that a fraction of `count` values does not exceed."""
    number = ceil(fraction * count - 1e-9)  # 0.9 × 10 is 9 whatever the rounding
    return min(max(number, 1), count) - 1


@dataclass(frozen=True)
class Requirement:
    """What a leakage class needs.

    Parameters
    ----------
    name : str
        Name of the class.
    limit : float
        Its largest leakage per length [m²/s].
    assembly : NeededPressure
        Qmin, the pressure in assembly from which on the class is met.
    service : dict of NeededPressure
        QSmin by the pressure in assembly Q_A [Pa]: the pressure to which it may fall afterwards.
    of_seals : NeededPressure
        Pressure in assembly that is enough for a fraction of the realisations as computed.
    relaxed : NeededPressure, optional
        Pressure in assembly from which on the class is still met after relaxation.
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
    """Find the pressures that a leakage class needs.

    Parameters
    ----------
    seals : Seals
        Leakages of the realisations.
    name : str
        Name of the class.
    limit : float
        Its largest leakage per length [m²/s].
    fraction : float
        Fraction of the realisations of `Requirement.of_seals`.
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
        of_seals=seals.needed_by(fraction, limit),
        relaxed=with_relaxation,
    )


def sealing_load(seals: Seals) -> NeededPressure:
    """Find the pressure in assembly from which on nothing leaks."""
    return seals.curve.needed(0.0)

"""Find the load that keeps the leakage of a seal within a limit, with the 95 % interval of this load.

`LeakageCurve.needed` finds the load on loading or on unloading. Between load steps, ln(leakage) is interpolated
linearly in ln(pressure). Interpolation is impossible if one of the two steps is sealed or has a load of zero. If
interpolation is impossible, the required load is the load of the step that meets the limit. The leakage is not
extrapolated to loads outside the load cycle. If a required load lies outside the load cycle, it is only known to be
above the highest load or below the lowest load.

The leakage counts as larger than any limit at loads where the computation failed or the fluid carries the whole load.
The same is true if the computed leakage is zero but its 95 % interval has no upper bound.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

import numpy as np

from ..base import Array, Indices, reals
from ..base.leak_classes import within
from ..budget.error_parts import within_others
from ..loads import LoadProgramme, LoadStep, relaxed
from .results import Results

#: Function that converts a nominal pressure [Pa] to text, see `LoadFormat`.
LoadText = Callable[[float], str]


@dataclass(frozen=True)
class NeededPressure:
    """Nominal pressure that is required to keep the leakage within a limit.

    On loading, the leakage is within the limit at the required pressure and at higher pressures. On unloading, the
    leakage stays within the limit down to the required pressure. A required pressure is inf if no load of the run is
    sufficient, and 0 if the lowest load of the run is sufficient.

    Attributes
    ----------
    value : float
        Required pressure [Pa] if the true leakage is at the upper end of its 95 % interval; equal to `computed` if the
        leakage has no interval.
    computed : float
        Required pressure [Pa] if the true leakage is equal to the computed leakage.
    low : float
        Required pressure [Pa] if the true leakage is at the lower end of its 95 % interval.
    lowest, highest : float
        Lowest and highest nominal pressure of the run [Pa]. A required pressure below `lowest` or above `highest` is
        unknown.
    on_unloading : bool
        True for the required pressure on unloading after an assembly at `highest`, False for the required pressure on
        loading.
    has_interval : bool
        True if the 95 % interval of the leakage is known.
    """

    value: float
    computed: float
    low: float
    lowest: float
    highest: float
    on_unloading: bool = False
    has_interval: bool = True

    @property
    def known(self) -> bool:
        """True if the required pressure lies within the loads of the run."""
        return 0 < self.value < inf

    @property
    def at(self) -> float:
        """Required pressure for the computed leakage [Pa], NaN if it is outside the loads of the run."""
        return self.computed if 0 < self.computed < inf else np.nan

    @property
    def relation(self) -> str:
        """Sign between the required pressure and `bound(value)`, "=" if it is known and otherwise ">" or "<="."""
        if self.value == inf:
            return ">"
        return "<=" if self.value == 0 else "="

    def bound(self, value: float) -> float:
        """Return `value`, or the highest load if `value` is inf, or the lowest load if it is 0."""
        if value == inf:
            return self.highest
        return self.lowest if value == 0 else value

    def words(self, value: float, load_text: LoadText) -> str:
        """Say at which loads the leakage is within the limit, such as "from 40 MPa on" or "down to 20 MPa".

        Parameters
        ----------
        value : required pressure [Pa], one of the attributes `value`, `computed` and `low` of this object.
        load_text : function that converts a nominal pressure to text.
        """
        load = load_text(self.bound(value))
        if self.on_unloading:
            if value == inf:
                return f"not even at {load}"
            return f"down to the lowest load of {load}" if value == 0 else f"down to {load}"
        if value == inf:
            return f"at no load up to {load}"
        return f"at every load from {load} on" if value == 0 else f"from {load} on"

    def text(self, load_text: LoadText) -> str:
        """Say which load is required for the upper end of the 95 % interval to be within the limit.

        If the computed leakage alone requires a different load, this load is added in brackets.
        """
        value = self.words(self.value, load_text)
        computed = self.words(self.computed, load_text)
        return value if value == computed else f"{value} (as computed: {computed})"


@dataclass(frozen=True, eq=False)
class LeakageCurve:
    """Leakage at every step of a load cycle with its 95 % interval, for the evaluation of leakage classes.

    Attributes
    ----------
    steps : LoadProgramme
        Load programme of the run.
    leakage : array
        Absolute value of the leakage per unit seal length, (step,) [m²/s]; inf where the leakage is unknown.
    lower, upper : array
        Lower and upper ends of the 95 % interval, (step,) [m²/s]. The intervals are made consistent with the rule that
        the leakage does not increase with the load, see `within_others`. Without an interval, `lower` and `upper` are
        equal to the leakage.
    has_interval : bool
        True if the 95 % interval is known.
    """

    steps: LoadProgramme
    leakage: Array
    lower: Array
    upper: Array
    has_interval: bool

    @classmethod
    def of(
        cls,
        steps: LoadProgramme,
        leakage: Array,
        interval: tuple[Array, Array] | None = None,
    ) -> LeakageCurve:
        """Create a curve.

        Parameters
        ----------
        steps : LoadProgramme
            Load programme of the run.
        leakage : array
            Leakage per unit seal length, of either sign, (step,) [m²/s]; NaN where unknown.
        interval : pair of arrays, optional
            Lower and upper ends of the 95 % interval, (step,) [m²/s] each; NaN where unknown.
        """
        magnitude = np.abs(reals(leakage))
        magnitude = np.where(np.isnan(magnitude), inf, magnitude)
        if interval is None:
            return cls(steps, magnitude, magnitude, magnitude, has_interval=False)
        lower = np.abs(reals(interval[0]))
        upper = np.abs(reals(interval[1]))
        upper = np.where(np.isnan(upper), inf, upper)
        # if the computed leakage is zero but its error has no upper bound, nothing is known about the leakage
        magnitude = np.where((magnitude == 0) & np.isinf(upper), inf, magnitude)
        is_known = np.isfinite(magnitude)
        lower = np.minimum(np.nan_to_num(lower, nan=0.0), magnitude)
        upper = np.maximum(upper, magnitude)
        # loads with unknown leakage do not narrow the intervals of other loads
        known_magnitude = np.where(is_known, magnitude, np.nan)
        lower, upper = within_others(steps, known_magnitude, lower, upper)
        lower = np.where(is_known, lower, 0.0)
        upper = np.where(is_known, upper, inf)
        return cls(steps, magnitude, lower, upper, has_interval=True)

    @classmethod
    def of_results(cls, results: Results) -> LeakageCurve:
        """Create the curve of the class leakage.

        The leakage at a load is unknown if the computation failed for the fluid of the run or for the test fluid.
        """
        leakage = np.where(results.has_failed, np.nan, results.class_leakage[0])
        return cls.of(results.steps, leakage, results.class_interval)

    def needed(self, limit: float, peak: float | None = None) -> NeededPressure:
        """Return the load that is required to keep the leakage within a limit.

        Parameters
        ----------
        limit : float
            Largest permitted leakage per unit seal length [m²/s].
        peak : float, optional
            Highest load before unloading [Pa]. If `peak` is given, the result is the lowest load on unloading at which
            the leakage is still within the limit. By default, the result is the load on loading above which the leakage
            is within the limit.
        """
        steps = falling_steps(self.steps, peak)
        return self._needed(self.steps.pressures[steps], steps, limit, peak is not None)

    def needed_with_relaxation(self, limit: float, relaxation: float) -> NeededPressure:
        """Return the assembly pressure that is required for the leakage to stay within a limit after relaxation.

        Parameters
        ----------
        limit : float
            Largest permitted leakage per unit seal length [m²/s].
        relaxation : float
            Fraction of the assembly pressure that is lost.
        """
        peaks, steps_after_relaxation = relaxed_steps(self.steps, relaxation)
        return self._needed(peaks, steps_after_relaxation, limit, on_unloading=False)

    def _needed(
        self, pressures: Array, steps: Indices, limit: float, on_unloading: bool
    ) -> NeededPressure:
        """Find the pressures at which the leakage, and the lower and upper ends of its interval, reach a limit.

        Parameters
        ----------
        pressures : pressure by which each step is identified in the result, in descending order [Pa]. A step after
            relaxation is identified by its assembly pressure, and any other step by its nominal pressure.
        steps : indices of the steps whose leakage is compared with the limit.
        limit : largest permitted leakage per unit seal length [m²/s].
        on_unloading : True if the steps belong to an unloading.
        """
        curves = np.stack([self.leakage, self.lower, self.upper])  # (curve, step)
        computed, by_lower, by_upper = crossings(pressures, curves[:, steps], limit).tolist()
        return NeededPressure(
            value=by_upper,
            computed=computed,
            low=by_lower,
            lowest=float(pressures.min()),
            highest=float(pressures.max()),
            on_unloading=on_unloading,
            has_interval=self.has_interval,
        )

    @property
    def assembly_step(self) -> int:
        """Index of the load step that represents the assembly.

        The load of the assembly step is the highest load from which the seal is unloaded, or the highest load of a
        cycle without unloading.
        """
        loading = np.flatnonzero(self.steps.on_loading)
        pressures = self.steps.pressures[loading]
        highest = max(self.steps.unload_from, default=pressures.max())
        return int(loading[pressures == highest][0])


def falling_steps(steps: LoadProgramme, peak: float | None = None) -> Indices:
    """Return the indices of the steps on loading, or on unloading from a load `peak`, in descending order of the load.

    The steps on unloading from a load `peak` begin with the step on loading at which this load is reached.
    """
    loading = np.flatnonzero(steps.on_loading)[::-1]
    if peak is None:
        return loading
    at_peak = loading[steps.pressures[loading] == peak]
    unloading = [number for number, step in enumerate(steps) if step.unloaded_from == peak]
    return np.array([*at_peak, *unloading], np.int64)


def relaxed_steps(steps: LoadProgramme, relaxation: float) -> tuple[Array, Indices]:
    """Find the load step after relaxation for each assembly load.

    relaxation : fraction of the assembly pressure that is lost.

    Returns the assembly pressures in descending order [Pa], and for each the index of the step after relaxation.
    """
    index_of = {step: index for index, step in enumerate(steps)}
    peaks = np.array(steps.unload_from[::-1])
    steps_after = [LoadStep(relaxed(peak, relaxation), peak) for peak in peaks.tolist()]
    return peaks, np.array([index_of[step] for step in steps_after], np.int64)


def crossings(pressure: Array, leakage: Array, limit: float) -> Array:
    """Find the lowest pressure down to which the leakage of each seal stays within a limit.

    Parameters
    ----------
    pressure : array
        Pressures in descending order, (step,) [Pa].
    leakage : array
        Leakage of each seal per unit seal length, (seal, step) [m²/s].
    limit : float
        Largest permitted leakage [m²/s]; 0 permits no leakage at all.

    Returns
    -------
    array
        Lowest pressure for each seal, (seal,) [Pa]: inf if the leakage exceeds the limit at the highest pressure, and 0
        if the leakage does not exceed the limit at any pressure.
    """
    is_within = within(leakage, limit)  # (seal, step)
    seals = np.arange(len(leakage))
    # For each seal, the first step that exceeds the limit, and the step before it; `argmin` finds the first False. The
    # two indices are 0 if no step exceeds the limit, or if already the first step exceeds the limit. The result for
    # these seals is set at the end.
    first_above = np.argmin(is_within, axis=1)  # (seal,)
    last_within = np.maximum(first_above - 1, 0)
    pressure_within, pressure_above = pressure[last_within], pressure[first_above]
    leakage_within, leakage_above = leakage[seals, last_within], leakage[seals, first_above]
    can_interpolate = (
        (leakage_within > 0) & (pressure_above > 0) & (leakage_above > leakage_within) & (limit > 0)
    )
    # linear interpolation of ln(leakage) over ln(pressure) between the two steps; the fraction is 0 at `last_within`
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = np.log(limit / leakage_within) / np.log(leakage_above / leakage_within)
        fraction = np.clip(np.where(can_interpolate, fraction, 0.0), 0, 1)
        interpolated = pressure_within * (pressure_above / pressure_within) ** fraction
    crossing = np.where(can_interpolate, interpolated, pressure_within)
    # the first step exceeds the limit, or no step does; the latter seals are set to 0 in the last line
    crossing = np.where(first_above == 0, inf, crossing)
    return np.where(is_within.all(axis=1), 0.0, crossing)

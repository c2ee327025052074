"""Verdicts on leakage classes: whether a seal meets a class, from which load on, and how sure that is.

Report, tables, design answer and terminal all take their statements from here. `LeakageCurve.needed` finds the load
that a limit of leakage needs, on loading or on unloading; `verdict_text` puts it into words.

Between load steps, ln(leakage) is interpolated linearly in ln(pressure). Beyond the load steps nothing is extrapolated:
the load is then known to lie above the highest or below the lowest one. If a seal opens or closes between two steps, or
one of them has the load 0, the load of the step that keeps the limit is taken. A load never meets a class if the
computation failed there, if the fluid carries all of it, or if the seal is computed as sealed but may leak any amount.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from ..base import Array, Indices, reals
from ..base.leak_rates import leak_classes, within
from ..budget.error_parts import within_others
from ..loads import LoadProgramme, LoadStep, relaxed
from .load_steps import load_names
from .measures import narrowed_by
from .results import Results

#: Converts a nominal pressure [Pa] to text, with the force if the case gives forces.
LoadText = Callable[[float], str]
#: Name of the interval in sentences.
INTERVAL = "the whole 95 % interval"


@dataclass(frozen=True)
class NeededPressure:
    """The nominal pressure that a limit of leakage needs.

    Attributes
    ----------
    value : float
        By the upper end of the 95 % interval [Pa]; inf if no load of the run is enough, 0 if the lowest one is. Without
        an interval it is `computed`.
    computed : float
        By the leakage as computed [Pa].
    low : float
        By the lower end of the interval [Pa].
    lowest, highest : float
        Lowest and highest load of the run [Pa], between which the pressure can be found.
    on_unloading : bool
        Whether it is the pressure down to which the limit is kept after an assembly at `highest`, instead of that from
        which on it is met.
    has_interval : bool
        Whether an interval is known.
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
        """Whether the value lies within the loads."""
        return 0 < self.value < inf

    @property
    def at(self) -> float:
        """The pressure by the leakage as computed if it lies within the loads, else NaN."""
        return self.computed if 0 < self.computed < inf else np.nan

    @property
    def relation(self) -> str:
        """Sign between the needed pressure and `bound(value)`: "=" if it is known, else "<=" or ">"."""
        return {inf: ">", 0.0: "<="}.get(self.value, "=")

    def bound(self, value: float) -> float:
        """Return a pressure, or the load that bounds it if it is inf or 0."""
        return {inf: self.highest, 0.0: self.lowest}.get(value, value)

    def words(self, value: float, load_text: LoadText) -> str:
        """Return in words from which load on, or down to which load, the limit is kept.

        Parameters
        ----------
        value : `value`, `computed` or `low`.
        load_text : converts a nominal pressure to text.
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
        """Return the value in words, and in brackets that of the leakage as computed if it differs."""
        value = self.words(self.value, load_text)
        computed = self.words(self.computed, load_text)
        return value if value == computed else f"{value} (as computed: {computed})"


@dataclass(frozen=True, eq=False)
class LeakageCurve:
    """Leakage over a load cycle with its 95 % interval, by which leakage classes are judged.

    Attributes
    ----------
    steps : LoadProgramme
        The load programme.
    leakage : array
        Absolute value of the leakage per length (step,) [m²/s]; inf if it may be any.
    lower, upper : array
        Ends of the interval (step,) [m²/s], narrowed by the intervals of other loads; the leakage without an interval.
    has_interval : bool
        Whether an interval is known.
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
            The load programme.
        leakage : array
            Leakage in any direction (step,) [m²/s], NaN if it is not known.
        interval : pair of arrays, optional
            Lower and upper end (step,) [m²/s], NaN if they are not known.
        """
        size = np.abs(reals(leakage))
        size = np.where(np.isnan(size), inf, size)
        if interval is None:
            return cls(steps, size, size, size, has_interval=False)
        low, high = np.abs(reals(interval[0])), np.abs(reals(interval[1]))
        high = np.where(np.isnan(high), inf, high)
        # a seal that is computed as sealed may leak any amount if no upper end is known
        size = np.where((size == 0) & np.isinf(high), inf, size)
        is_known = np.isfinite(size)
        low = np.minimum(np.nan_to_num(low, nan=0.0), size)
        high = np.maximum(high, size)
        # loads with unknown leakage do not narrow the intervals of others
        low, high = within_others(steps, np.where(is_known, size, np.nan), low, high)
        low = np.where(is_known, low, 0.0)
        high = np.where(is_known, high, inf)
        return cls(steps, size, low, high, has_interval=True)

    @classmethod
    def of_results(cls, results: Results) -> LeakageCurve:
        """Create the curve of the fluid that decides on classes.

        The leakage of a load is not known if the computation of the fluid of the run, or of the test fluid, failed.
        """
        leakage = np.where(results.has_failed, np.nan, results.class_leakage[0])
        return cls.of(results.steps, leakage, results.class_interval)

    def needed(self, limit: float, peak: float | None = None) -> NeededPressure:
        """Return the load that a limit needs.

        Parameters
        ----------
        limit : float
            Largest leakage per length [m²/s].
        peak : float, optional
            Load from which the seal is unloaded [Pa]; without it, the load on loading is returned.
        """
        steps = falling_steps(self.steps, peak)
        return self._needed(self.steps.pressures[steps], steps, limit, peak is not None)

    def needed_with_relaxation(self, limit: float, relaxation: float) -> NeededPressure:
        """Return the pressure in assembly that keeps a limit [m²/s] after a fraction of the pressure is lost."""
        peaks, after = relaxed_steps(self.steps, relaxation)
        return self._needed(peaks, after, limit, on_unloading=False)

    def _needed(
        self, pressures: Array, steps: Indices, limit: float, on_unloading: bool
    ) -> NeededPressure:
        """Return what a limit needs along some steps, by the leakage and by both ends of its interval.

        Parameters
        ----------
        pressures : falling pressures [Pa], by which the steps are identified.
        steps : numbers of the steps whose leakage counts.
        limit : largest leakage per length [m²/s].
        on_unloading : whether the steps are those of an unloading.
        """
        computed, low, high = (
            float(crossings(pressures, curve[None, steps], limit)[0])
            for curve in (self.leakage, self.lower, self.upper)
        )
        return NeededPressure(
            value=high,
            computed=computed,
            low=low,
            lowest=float(pressures.min()),
            highest=float(pressures.max()),
            on_unloading=on_unloading,
            has_interval=self.has_interval,
        )

    @property
    def assembly_step(self) -> int:
        """Step of the assembly: at the highest load from which the seal is unloaded, or else at the highest load."""
        loading = np.flatnonzero(self.steps.on_loading)
        pressures = self.steps.pressures[loading]
        highest = max(self.steps.unload_from, default=pressures.max())
        return int(loading[pressures == highest][0])


def falling_steps(steps: LoadProgramme, peak: float | None = None) -> Indices:
    """Return the steps of the loading, or of the unloading from a peak, from the highest load down.

    An unloading begins with the step of its peak.
    """
    loading = np.flatnonzero(steps.on_loading)[::-1]
    if peak is None:
        return loading
    at_peak = loading[steps.pressures[loading] == peak]
    unloading = [number for number, step in enumerate(steps) if step.unloaded_from == peak]
    return np.array([*at_peak, *unloading], np.int64)


def relaxed_steps(steps: LoadProgramme, relaxation: float) -> tuple[Array, Indices]:
    """Return the peaks from the highest down [Pa], and the step of each after relaxation."""
    numbers = {step: number for number, step in enumerate(steps)}
    peaks = np.array(steps.unload_from[::-1])
    after = [numbers[LoadStep(relaxed(peak, relaxation), peak)] for peak in peaks.tolist()]
    return peaks, np.array(after, np.int64)


def crossings(pressure: Array, leakage: Array, limit: float) -> Array:
    """Return the lowest pressure down to which the leakage of each seal stays within a limit.

    Parameters
    ----------
    pressure : array
        Falling pressures (step,) [Pa].
    leakage : array
        (seal, step) [m²/s].
    limit : float
        Largest leakage >= 0 [m²/s]; 0 asks for the end of all leakage.

    Returns
    -------
    array
        Pressure (seal,) [Pa]; inf if the leakage is above the limit at the highest pressure, 0 if it is nowhere.
    """
    is_within = within(leakage, limit)
    seals = np.arange(len(leakage))
    first_above = np.argmin(is_within, axis=1)
    last_within = np.maximum(first_above - 1, 0)
    pressure_within, pressure_above = pressure[last_within], pressure[first_above]
    leakage_within, leakage_above = leakage[seals, last_within], leakage[seals, first_above]
    can_interpolate = (
        (leakage_within > 0) & (pressure_above > 0) & (leakage_above > leakage_within) & (limit > 0)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = np.log(limit / leakage_within) / np.log(leakage_above / leakage_within)
        fraction = np.clip(np.where(can_interpolate, fraction, 0.0), 0, 1)
        interpolated = pressure_within * (pressure_above / pressure_within) ** fraction
    crossing = np.where(can_interpolate, interpolated, pressure_within)
    crossing = np.where(first_above == 0, inf, crossing)
    return np.where(is_within.all(axis=1), 0.0, crossing)


@dataclass(frozen=True)
class Verdict:
    """Whether, and from which load on, a run meets a leakage class.

    Attributes
    ----------
    name : str
        Of the class, or the limit itself.
    limit : float
        Largest leakage per length [m²/s].
    fluid : str
        That decides.
    is_own_limit : bool
        Whether it is a limit of the user's own instead of a class of a standard.
    assembly_load : float
        Nominal pressure in assembly [Pa].
    met_as_computed, met_with_interval : bool
        Whether the class is met at that load; the second is None without an interval.
    may_be_met : bool
        Whether the lower end of the interval meets the class at that load.
    unknown : str
        Why the leakage at that load may be any, "" if it is known.
    assembly : NeededPressure
        From which load on the class is met.
    service : dict
        Down to which load the class is kept, by the pressure in assembly [Pa].
    vague_load : float
        Nominal pressure at which the class is met as computed, but not with the interval [Pa]; NaN without one.
    widest_source, narrowed_by : str
        The widest source of error at that load, and what reduces it.
    failed : tuple of str
        Names of the load steps at which the computation failed.
    """

    name: str
    limit: float
    fluid: str
    is_own_limit: bool
    assembly_load: float
    met_as_computed: bool
    met_with_interval: bool | None
    may_be_met: bool
    unknown: str
    assembly: NeededPressure
    service: dict[float, NeededPressure]
    vague_load: float = np.nan
    widest_source: str = ""
    narrowed_by: str = ""
    failed: tuple[str, ...] = ()

    @property
    def answer(self) -> str:
        """Whether the class is met at the assembly load, as computed and with the whole interval, in words."""
        if self.unknown:
            return f"not met, as {self.unknown}"
        if not self.met_as_computed and self.may_be_met:
            return "not met as computed, but the lower end of the 95 % interval meets it"
        if not self.met_as_computed:
            return "not met"
        if self.met_with_interval is None:
            return "met as computed"
        if self.met_with_interval:
            return f"met, also with {INTERVAL}"
        return f"met as computed, but not with {INTERVAL}"


def verdicts_of(
    results: Results, limits: Sequence[tuple[str, float]] | None = None
) -> tuple[Verdict, ...]:
    """Judge the leakage classes of a run, or other limits.

    Parameters
    ----------
    results : Results
        The run.
    limits : sequence, optional
        Name and largest leakage per length [m²/s] of each limit; the classes of the case unless given.

    Returns
    -------
    tuple of Verdict
        One for each class or limit.
    """
    data = results.dataset
    if limits is None:
        if "leak_class" not in data.coords:
            return ()
        names, largest = data["leak_class"].values.tolist(), data["class_limit"].values.tolist()
        limits = list(zip(names, largest, strict=True))
    curve = LeakageCurve.of_results(results)
    return tuple(_verdict(results, curve, *limit) for limit in limits)


def _verdict(results: Results, curve: LeakageCurve, name: str, limit: float) -> Verdict:
    """Judge one limit by the leakage curve of a run, and find what would narrow its interval."""
    steps, assembly_step = curve.steps, curve.assembly_step
    is_met = within(curve.leakage, limit)
    is_met_with_interval = within(curve.upper, limit)
    vague_steps = np.flatnonzero(is_met & ~is_met_with_interval & steps.on_loading)
    about_interval: dict[str, Any] = {}
    budget = results.budget
    if vague_steps.size and budget is not None:
        step = assembly_step if assembly_step in vague_steps else int(vague_steps[-1])
        source = budget.limiting(step)
        about_interval = {
            "vague_load": float(steps.pressures[step]),
            "widest_source": source,
            "narrowed_by": narrowed_by(results, source),
        }
    (leak_class,) = leak_classes([name])
    is_unknown = np.isinf(curve.leakage[assembly_step])
    names = load_names(results.dataset)
    return Verdict(
        name=name,
        limit=limit,
        fluid=deciding_fluid(results),
        is_own_limit=not leak_class.family,
        assembly_load=float(steps.pressures[assembly_step]),
        met_as_computed=bool(is_met[assembly_step]),
        met_with_interval=bool(is_met_with_interval[assembly_step]) if curve.has_interval else None,
        may_be_met=bool(within(curve.lower, limit)[assembly_step]),
        unknown=why_unknown(results, assembly_step) if is_unknown else "",
        assembly=curve.needed(limit),
        service={peak: curve.needed(limit, peak) for peak in steps.unload_from},
        failed=tuple(names[step] for step in np.flatnonzero(results.has_failed)),
        **about_interval,
    )


def why_unknown(results: Results, step: int) -> str:
    """Return why the leakage at a step may be any."""
    if results.has_failed[step]:
        return "the solution failed"
    if step in results.open_steps:
        return "the fluid carries the load alone"
    return "what is computed as sealed may leak any amount by the error budget"


def deciding_fluid(results: Results) -> str:
    """Return the name of the fluid that decides on classes as the case gives it, else "the gas" or "the liquid"."""
    case = results.case
    has_test_fluid = "test_leakage" in results.dataset
    table = case.get("output", {}).get("test_fluid") if has_test_fluid else case.get("fluid")
    name = (table or {}).get("name")
    if name:
        return str(name)
    return "the gas" if results.class_basis.is_gas else "the liquid"

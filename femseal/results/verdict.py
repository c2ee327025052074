"""Judge whether a seal meets leakage classes, which load is required, and how certain this judgement is.

The verdicts of this module appear in the report, the tables, the terminal output and the results of a design.
`LeakageCurve.needed` finds the load that is required to keep the leakage within a limit, on loading or on unloading;
the module `verdict_text` puts the required load into words.

Between load steps, ln(leakage) is interpolated linearly in ln(pressure). Interpolation is impossible if one of the two
steps is sealed or has a load of zero. If interpolation is impossible, the required load is the load of the step that
meets the limit. The leakage is not extrapolated to loads outside the load cycle. If a required load lies outside the
load cycle, it is only known to be above the highest load or below the lowest load.

A leakage class counts as not met at loads where the computation failed or the fluid carries the whole load. A class
also counts as not met if the computed leakage is zero but its 95 % interval has no upper bound.
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

#: Function that converts a nominal pressure [Pa] to text, see `LoadFormat`.
LoadText = Callable[[float], str]
#: Name of the 95 % interval in sentences.
WHOLE_INTERVAL = "the whole 95 % interval"


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


@dataclass(frozen=True)
class Verdict:
    """Verdict on a leakage class: whether a run meets the class, and which load it requires.

    Attributes
    ----------
    name : str
        Name of the class, or the text of a limit that the user gives.
    limit : float
        Largest permitted leakage per unit seal length [m²/s].
    fluid : str
        Name of the fluid whose leakage is compared with the limit.
    is_own_limit : bool
        True for a limit that the user gives, False for a class of a standard.
    assembly_load : float
        Nominal pressure of the assembly [Pa].
    met_as_computed : bool
        True if the computed leakage at the assembly load meets the class.
    met_with_interval : bool or None
        True if the upper end of the 95 % interval at the assembly load meets the class; None if the leakage has no
        interval.
    may_be_met : bool
        True if the lower end of the 95 % interval at the assembly load meets the class.
    unknown : str
        Reason why the leakage at the assembly load is unknown, "" if the leakage is known.
    assembly : NeededPressure
        Load that is required on loading to meet the class.
    service : dict
        Lowest load on unloading at which the class is still met. The keys are the loads from which the seal is unloaded
        [Pa].
    vague_load : float
        Nominal pressure [Pa] at which the computed leakage meets the class, but the upper end of its 95 % interval does
        not meet the class; NaN if the run has no such load.
    widest_source, narrowed_by : str
        Name of the error source with the widest interval at the load `vague_load`, and the action that reduces this
        error.
    failed : tuple of str
        Names of the load steps where the computation failed.
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
        """Text that says whether the computed leakage at the assembly load, and its 95 % interval, meet the class."""
        if self.unknown:
            return f"not met, as {self.unknown}"
        if not self.met_as_computed and self.may_be_met:
            return "not met as computed, but the lower end of the 95 % interval meets it"
        if not self.met_as_computed:
            return "not met"
        if self.met_with_interval is None:
            return "met as computed"
        if self.met_with_interval:
            return f"met, also with {WHOLE_INTERVAL}"
        return f"met as computed, but not with {WHOLE_INTERVAL}"


def verdicts_of(
    results: Results, limits: Sequence[tuple[str, float]] | None = None
) -> tuple[Verdict, ...]:
    """Judge whether a run meets its leakage classes or other limits.

    Parameters
    ----------
    results : Results
        Results of a run.
    limits : sequence, optional
        Pairs of the name of a limit and the largest permitted leakage per unit seal length [m²/s]; by default the
        classes of the case.

    Returns
    -------
    tuple of Verdict
        Verdict on each class or limit.
    """
    data = results.dataset
    if limits is None:
        if "leak_class" not in data.coords:
            return ()
        names = data["leak_class"].values.tolist()
        largest_leakages = data["class_limit"].values.tolist()
        limits = list(zip(names, largest_leakages, strict=True))
    curve = LeakageCurve.of_results(results)
    return tuple(_verdict(results, curve, name, limit) for name, limit in limits)


def _verdict(results: Results, curve: LeakageCurve, name: str, limit: float) -> Verdict:
    """Judge whether the leakage of a run is within a limit, and find the action that would narrow its 95 % interval."""
    steps = curve.steps
    assembly_step = curve.assembly_step
    interval_facts: dict[str, Any] = {}
    budget = results.budget
    uncertain_step = _uncertain_step(curve, limit)
    if uncertain_step is not None and budget is not None:
        source = budget.limiting(uncertain_step)
        interval_facts = {
            "vague_load": float(steps.pressures[uncertain_step]),
            "widest_source": source,
            "narrowed_by": narrowed_by(results, source),
        }
    met_with_interval = None
    if curve.has_interval:
        met_with_interval = bool(within(curve.upper, limit)[assembly_step])
    (leak_class,) = leak_classes([name])
    is_unknown = np.isinf(curve.leakage[assembly_step])
    step_names = load_names(results.dataset)
    return Verdict(
        name=name,
        limit=limit,
        fluid=deciding_fluid(results),
        is_own_limit=not leak_class.family,
        assembly_load=float(steps.pressures[assembly_step]),
        met_as_computed=bool(within(curve.leakage, limit)[assembly_step]),
        met_with_interval=met_with_interval,
        may_be_met=bool(within(curve.lower, limit)[assembly_step]),
        unknown=why_unknown(results, assembly_step) if is_unknown else "",
        assembly=curve.needed(limit),
        service={peak: curve.needed(limit, peak) for peak in steps.unload_from},
        failed=tuple(step_names[step] for step in np.flatnonzero(results.has_failed)),
        **interval_facts,
    )


def _uncertain_step(curve: LeakageCurve, limit: float) -> int | None:
    """Return a step on loading at which it is uncertain whether the leakage is within a limit, if there is one.

    A step is uncertain if its computed leakage is within the limit, but the upper end of its 95 % interval is not. If
    the assembly step is uncertain, it is returned. Otherwise, the uncertain step with the highest load is returned.
    """
    is_uncertain = within(curve.leakage, limit) & ~within(curve.upper, limit)
    # in rising order of load
    uncertain_steps = np.flatnonzero(is_uncertain & curve.steps.on_loading)
    if not uncertain_steps.size:
        return None
    if curve.assembly_step in uncertain_steps:
        return curve.assembly_step
    return int(uncertain_steps[-1])


def why_unknown(results: Results, step: int) -> str:
    """Say why the leakage at a load step is unknown."""
    if results.has_failed[step]:
        return "the solution failed"
    if step in results.open_steps:
        return "the fluid carries the load alone"
    return "what is computed as sealed may leak any amount by the error budget"


def deciding_fluid(results: Results) -> str:
    """Return the name of the fluid whose leakage is compared with the classes, or "the gas" or "the liquid"."""
    case = results.case
    has_test_fluid = "test_leakage" in results.dataset
    table = case.get("output", {}).get("test_fluid") if has_test_fluid else case.get("fluid")
    name = (table or {}).get("name")
    if name:
        return str(name)
    return "the gas" if results.class_basis.is_gas else "the liquid"

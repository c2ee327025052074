"""The verdict on a leakage class: whether a seal meets it, from which load on, how sure that is, what would narrow it.

Report, table of classes, design answer and terminal take it from here: `needed` of a `LeakageCurve` finds the load that
a limit needs, on loading or on unloading, and `verdict_sentences` and `verdict_table` put it into words.

Between load steps ln(leakage) is straight in ln(pressure); beyond the steps nothing is extrapolated: a load is then
known to lie above the highest or below the lowest one. Where a seal opens or closes between two steps, and at a load of
0, the load of the step that keeps the limit is taken. A load at which the solution failed, which the fluid carries
alone, or at which a seal that is computed as sealed may leak any amount, never meets a class.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from ..base import Array, Indices, TextTable, reals
from ..base.leak_rates import leak_classes, within
from ..base.leak_units import LEAK_UNITS
from ..budget.error_parts import within_others
from ..loads import LoadProgramme, LoadStep, relaxed
from .results import Results, load_names, loads_as_given
from .tables import format_leakage

#: A nominal pressure [Pa] as text, with the force that makes it where the loads of the case are forces.
LoadText = Callable[[float], str]
#: The interval in words.
INTERVAL = "the whole 95 % interval"
#: Most classes whose loads are told in sentences; a table has those of more.
_MOST_TOLD = 2
#: What makes each source of error smaller, by its name in the error budget.
_NARROWED_BY = {
    "blocks": "larger blocks",
    "continuation": "an instrument that sees shorter waves",
    "effective pressure": "a smaller pressure of the fluid",
    "fluid pressure": 'fluid_pressure = "acts" in [contact]',
    "filter": "a shorter surface.shortest_wave, as far as the waves were measured",
    "form": "a form that is known more exactly, and a smaller tolerance with it",
    "form of the patch": "surface.detrend, which says whether the curvature belongs to the seal",
    "hardness": "a measured hardness, and a smaller hardness_tolerance with it",
    "longer waves": "a larger measured area, or the flatness of the seal in [seal]",
    "patch": "a larger measured area, or a second measured patch",
    "pixels": "more surface.points",
    "places": "more measured patches",
    "realisations": "more realisations in [stochastic]",
    "solver": "a smaller contact.rtol",
    "thin gap": "a smoother face: its gap is not thin against its waves",
}
#: The same for a generated face, of which any area can be made.
_GENERATED = {"patch": "a larger generated surface", "longer waves": "a larger generated surface"}


@dataclass(frozen=True)
class NeededPressure:
    """A nominal pressure [Pa] that a limit of leakage needs.

    value : by the upper end of the interval [Pa]; inf where the loads of the run are not enough, 0 where the lowest of
    them is. computed, low : by the leakage as computed, and by the lower end of the interval. lowest, highest : loads
    between which it is known. on_unloading : whether it is the pressure down to which the limit is kept after an
    assembly at the highest, not that from which on it is met. has_interval : whether an interval is known; without
    one the value is that of the leakage as computed.
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
        """The pressure by the leakage as computed, where it lies within the loads; else NaN."""
        return self.computed if 0 < self.computed < inf else np.nan

    @property
    def relation(self) -> str:
        """ "=", or "<=" or ">" where only a bound is known."""
        return {inf: ">", 0.0: "<="}.get(self.value, "=")

    def bound(self, value: float) -> float:
        """A pressure, or the load that bounds it."""
        return {inf: self.highest, 0.0: self.lowest}.get(value, value)

    def words(self, value: float, shown: LoadText) -> str:
        """From which load on, or down to which, one of the pressures lets the limit be kept."""
        load = shown(self.bound(value))
        if self.on_unloading:
            known = {inf: f"not even at {load}", 0.0: f"down to the lowest load of {load}"}
            return known.get(value, f"down to {load}")
        known = {inf: f"at no load up to {load}", 0.0: f"at every load from {load} on"}
        return known.get(value, f"from {load} on")

    def text(self, shown: LoadText) -> str:
        """The value in words; in brackets that of the leakage as computed, where it differs."""
        value, computed = self.words(self.value, shown), self.words(self.computed, shown)
        return value if value == computed else f"{value} (as computed: {computed})"


@dataclass(frozen=True, eq=False)
class LeakageCurve:
    """Leakage over a load cycle with its interval, as it decides on classes.

    steps : the load programme. leakage : size of the leakage per length (steps,) [m²/s]; inf where it may be any.
    lower, upper : ends of its interval, which go no further than those of other loads. has_interval : whether one is
    known; without it both ends are the leakage.
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
        """Make a curve of a leakage of any direction, NaN where it is not known.

        interval : lower and upper end at every step (steps,), NaN where one is not known; None without any.
        """
        size = np.abs(reals(leakage))
        size = np.where(np.isnan(size), inf, size)
        if interval is None:
            return cls(steps, size, size, size, has_interval=False)
        low, high = (np.abs(reals(end)) for end in interval)
        high = np.where(np.isnan(high), inf, high)
        # what is computed as sealed may leak where no upper end is known
        size = np.where((size == 0) & np.isinf(high), inf, size)
        is_known = np.isfinite(size)
        low = np.minimum(np.nan_to_num(low, nan=0.0), size)
        high = np.maximum(high, size)
        # loads whose leakage is not known tell nothing of others
        low, high = within_others(steps, np.where(is_known, size, np.nan), low, high)
        low, high = np.where(is_known, low, 0.0), np.where(is_known, high, inf)
        return cls(steps, size, low, high, has_interval=True)

    @classmethod
    def of_results(cls, results: Results) -> LeakageCurve:
        """Make the curve of the fluid that decides on classes; a load at which either fluid failed is not known."""
        leakage = np.where(results.has_failed, np.nan, results.class_leakage[0])
        return cls.of(results.steps, leakage, results.class_interval)

    def needed(self, limit: float, peak: float | None = None) -> NeededPressure:
        """Find the load that a limit [m²/s] needs, on loading or on the unloading from a peak [Pa].

        Every verdict on a class comes from here.
        """
        steps = falling_steps(self.steps, peak)
        return self._needed(self.steps.pressures[steps], steps, limit, peak is not None)

    def needed_with_relaxation(self, limit: float, relaxation: float) -> NeededPressure:
        """Find the pressure in assembly that still keeps the limit once a fraction of it is lost."""
        peaks, after = relaxed_steps(self.steps, relaxation)
        return self._needed(peaks, after, limit, on_unloading=False)

    def _needed(
        self, pressures: Array, steps: Indices, limit: float, on_unloading: bool
    ) -> NeededPressure:
        """What a limit needs along steps from the highest pressure down (steps,) [Pa], by leakage and interval."""
        computed, low, high = (
            float(crossings(pressures, end[None, steps], limit)[0])
            for end in (self.leakage, self.lower, self.upper)
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
        """Number of the step at which the seal is assembled: the highest load that it is unloaded from, or reaches."""
        loading = np.flatnonzero(self.steps.on_loading)
        pressures = self.steps.pressures[loading]
        highest = max(self.steps.unload_from, default=pressures.max())
        return int(loading[pressures == highest][0])


def falling_steps(steps: LoadProgramme, peak: float | None = None) -> Indices:
    """Steps of the loading, or of the unloading from a peak, which they begin with, from the highest load down."""
    loading = np.flatnonzero(steps.on_loading)[::-1]
    if peak is None:
        return loading
    unloading = [n for n, step in enumerate(steps) if step.unloaded_from == peak]
    return np.r_[loading[steps.pressures[loading] == peak], unloading]


def relaxed_steps(steps: LoadProgramme, relaxation: float) -> tuple[Array, Indices]:
    """Peaks from the highest down [Pa], and the steps that a fraction of relaxation leaves of them."""
    numbers = {step: n for n, step in enumerate(steps)}
    peaks = np.array(steps.unload_from[::-1])
    after = [numbers[LoadStep(relaxed(p, relaxation), p)] for p in peaks.tolist()]
    return peaks, np.array(after, np.int64)


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


@dataclass(frozen=True)
class Verdict:
    """What a run says of a leakage class.

    name : of the class, or the limit itself. limit : its largest leakage per length [m²/s]. fluid : that decides.
    is_own_limit : whether it is a limit of the user's own. assembly_load : nominal pressure in assembly [Pa].
    met_as_computed, met_with_interval : whether it is met there; the second is None without an interval.
    unknown : why the leakage there may be any, "" where it is known.
    assembly : from which load on it is met. service : down to which it is kept, by the pressure in assembly [Pa].
    vague_load : nominal pressure at which it is met as computed, and not with the interval [Pa]; NaN without one.
    widest_source, narrowed_by : the widest source of error there, and what makes it smaller.
    failed : names of the load steps at which the solution failed.
    """

    name: str
    limit: float
    fluid: str
    is_own_limit: bool
    assembly_load: float
    met_as_computed: bool
    met_with_interval: bool | None
    unknown: str
    assembly: NeededPressure
    service: dict[float, NeededPressure]
    vague_load: float = np.nan
    widest_source: str = ""
    narrowed_by: str = ""
    failed: tuple[str, ...] = ()

    @property
    def answer(self) -> str:
        """Whether the class is met at the assembly load, as computed and with the whole interval."""
        if self.unknown:
            return f"not met, as {self.unknown}"
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
    """Judge the leakage classes of a run, or limits that are given.

    limits : name and largest leakage per length [m²/s] of each; the classes of the case unless given.
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
    """Judge one limit by the curve of a run, and find what would narrow its interval."""
    steps, at = curve.steps, curve.assembly_step
    failed = np.flatnonzero(results.has_failed)
    met, surely = within(curve.leakage, limit), within(curve.upper, limit)
    vague = np.flatnonzero(met & ~surely & steps.on_loading)
    found: dict[str, Any] = {}
    budget = results.budget
    if vague.size and budget is not None:
        step = at if at in vague else int(vague[-1])
        source = budget.limiting(step)
        found = {
            "vague_load": float(steps.pressures[step]),
            "widest_source": source,
            "narrowed_by": _narrowed_by(results, source),
        }
    (one,) = leak_classes([name])
    names = load_names(results.dataset)
    return Verdict(
        name=name,
        limit=limit,
        fluid=deciding_fluid(results),
        is_own_limit=not one.family,
        assembly_load=float(steps.pressures[at]),
        met_as_computed=bool(met[at]),
        met_with_interval=bool(surely[at]) if curve.has_interval else None,
        unknown=_why_unknown(results, at) if np.isinf(curve.leakage[at]) else "",
        assembly=curve.needed(limit),
        service={peak: curve.needed(limit, peak) for peak in steps.unload_from},
        failed=tuple(names[s] for s in failed),
        **found,
    )


def _why_unknown(results: Results, step: int) -> str:
    """Why the leakage at a step may be any."""
    if results.has_failed[step]:
        return "the solution failed"
    if step in results.open_steps:
        return "the fluid carries the load alone"
    return "what is computed as sealed may leak any amount by the error budget"


def _narrowed_by(results: Results, source: str) -> str:
    """What makes a source of error smaller; "" where nothing is known."""
    faces = results.case.get("face") or {}
    each = faces if isinstance(faces, list) else [faces]
    generated = bool(faces) and all(face.get("kind", "file") != "file" for face in each)
    known = _NARROWED_BY | (_GENERATED if generated else {})
    return known.get(source, "")


def deciding_fluid(results: Results) -> str:
    """Name of the fluid that decides on classes, as the case gives it; "the gas" or "the liquid" without one."""
    tested = "test_leakage" in results.dataset
    table = (
        results.case.get("output", {}).get("test_fluid") if tested else results.case.get("fluid")
    )
    name = (table or {}).get("name") or ""
    return str(name) or ("the gas" if results.class_basis.is_gas else "the liquid")


def verdict_sentences(verdict: Verdict, shown: LoadText, *, whole: bool = True) -> list[str]:
    """Put a verdict into words: the answer at the assembly load first, then the loads, then what would narrow it.

    shown : nominal pressures as text. whole : False gives the answer alone.
    """
    subject = f"Class {verdict.name} with {verdict.fluid}"
    if verdict.is_own_limit:
        subject = f"At most {verdict.name} of {verdict.fluid}"
    sentences = [
        f"{subject}: {verdict.answer}, at the assembly load of {shown(verdict.assembly_load)}."
    ]
    if not whole:
        return sentences
    sentences.append(f"On loading it is met {_both(verdict.assembly, shown)}.")
    for peak, needed in verdict.service.items():
        if needed.computed == inf:  # there is nothing to be kept
            continue
        sentences.append(f"Unloaded from {shown(peak)} it is kept {_both(needed, shown)}.")
    if verdict.failed:
        loads = ", ".join(verdict.failed)
        sentences.append(f"The solution failed at {loads}: such a load counts as not met.")
    if not verdict.assembly.has_interval:
        sentences.append("The run has no error budget; output.budget = true gives the interval.")
    elif verdict.widest_source:
        source = f"the widest source of error is '{verdict.widest_source}'"
        narrow = f"; {verdict.narrowed_by} would narrow the interval" * bool(verdict.narrowed_by)
        sentences.append(f"At {shown(verdict.vague_load)} {source}{narrow}.")
    return sentences


def _both(needed: NeededPressure, shown: LoadText) -> str:
    """Words of the leakage as computed, and of the whole interval where there is one."""
    computed = needed.words(needed.computed, shown)
    if not needed.has_interval:
        return f"{computed} as computed"
    value = needed.words(needed.value, shown)
    if value == computed:
        return f"{computed}, as computed and with {INTERVAL}"
    return f"{computed} as computed, and {value} with {INTERVAL}"


def verdicts_in_words(verdicts: Sequence[Verdict], shown: LoadText) -> list[list[str]]:
    """Sentences on each verdict; of many of them the answers alone, as their loads are in the table."""
    whole = len(verdicts) <= _MOST_TOLD
    return [verdict_sentences(one, shown, whole=whole) for one in verdicts]


def short_loads(results: Results) -> LoadText:
    """Nominal pressures as short text: the force alone where the case has forces."""
    given = loads_as_given(results.dataset, 3)
    return lambda pressure: given(pressure).partition(" (")[0]


def verdict_table(
    results: Results,
    verdicts: Sequence[Verdict],
    more: Iterable[tuple[str, Iterable[str]]] = (),
    names: tuple[str, str] = ("met", "kept after {}"),
) -> TextTable:
    """A line for each verdict: class, limit, and its loads as computed and with the whole interval.

    more : further columns. names : of the load from which on a class is met, and of that down to which it is kept after
    an assembly, in which {} stands for the load of the assembly.
    """
    shown, factor = short_loads(results), results.class_basis.factor
    columns = [("class", [one.name for one in verdicts])]
    if not all(one.is_own_limit for one in verdicts):
        units = [LEAK_UNITS[one.unit] for one in leak_classes([v.name for v in verdicts])]
        limits = [
            f"{format_leakage(one.limit, factor(unit))} {unit.name}" if one.limit else "no leakage"
            for one, unit in zip(verdicts, units, strict=True)
        ]
        columns.append(("limit", limits))
    branches = [(names[0], [one.assembly for one in verdicts])]
    for peak in verdicts[0].service:
        needs = [one.service[peak] for one in verdicts]
        branches.append((names[1].format(shown(peak)), needs))
    for head, needs in branches:
        texts = [one.words(one.computed, shown) for one in needs]
        columns.append((f"{head}, as computed", texts))
        if needs[0].has_interval:
            texts = [one.words(one.value, shown) for one in needs]
            columns.append((f"{head}, with {INTERVAL}", texts))
    columns += [(head, list(texts)) for head, texts in more]
    title = f"Leakage classes, decided by {verdicts[0].fluid}"
    return TextTable.of_columns(title, columns, names=len(columns))

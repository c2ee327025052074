"""Judge whether a seal meets leakage classes, which load is required, and how certain this judgement is.

The verdicts of this module appear in the report, the tables, the terminal output and the results of a design. The
required loads come from `needed_pressure`. The modules `verdict_text` and `verdict_paragraphs` put the verdicts into
words.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.leak_classes import find_leak_classes, within
from .load_steps import load_names
from .measures import narrowed_by
from .needed_pressure import LeakageCurve, NeededPressure
from .results import Results

#: Name of the 95 % interval in sentences.
WHOLE_INTERVAL = "the whole 95 % interval"


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
    (leak_class,) = find_leak_classes([name])
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
    return "a seal computed as sealed may leak any amount according to its error budget"


def deciding_fluid(results: Results) -> str:
    """Return the name of the fluid whose leakage is compared with the classes, or "the gas" or "the liquid"."""
    case = results.case
    has_test_fluid = "test_leakage" in results.dataset
    table = case.get("output", {}).get("test_fluid") if has_test_fluid else case.get("fluid")
    name = (table or {}).get("name")
    if name:
        return str(name)
    return "the gas" if results.class_basis.is_gas else "the liquid"

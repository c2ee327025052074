"""Describe in paragraphs how tight the seal of a run is. The terminal, the report and designs show these paragraphs.

The function `verdict_paragraphs` says whether each leakage class is met, which load it requires, and how much the seal
leaks at the assembly load. It also says which action would help most, and whether the requested accuracy was reached.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite, log, log1p, nan

from ..base import format_deviation, to_text
from ..base.leak_classes import find_leak_classes
from ..base.leak_units import LEAK_UNITS, LeakUnit
from .attempts import half_width_text
from .leakage_format import format_interval, format_leakage, format_upper_end
from .load_steps import load_format
from .measures import HEIGHTS, LOAD_INCREASE, best_narrowing, lowering
from .needed_pressure import LeakageCurve, falling_steps
from .results import Results
from .verdict import Verdict, deciding_fluid, verdicts_of, why_unknown
from .verdict_text import limit_texts, required_loads, verdict_sentences

#: Sentences about one subject, with the most important sentence first.
Paragraph = list[str]
#: Up to this number of classes, the required loads are stated in sentences; for more classes, the required loads are
#: only stated in the table.
_MOST_IN_SENTENCES = 2
#: An action narrows an interval of ln(leakage) only slightly if the remaining fraction of its width is above this
#: value.
_SLIGHT = 0.9
#: Smallest and largest mass rate that is given as mass per year [kg/s]: 1 mg and 10 t per year.
_LEAST_MASS, _MOST_MASS = 1e-6 / 3.15576e7, 1e4 / 3.15576e7


def verdict_paragraphs(
    results: Results, verdicts: Sequence[Verdict] | None = None
) -> list[Paragraph]:
    """Say whether the seal is tight enough, how certain this statement is, and which action would help most.

    Parameters
    ----------
    results : Results
        Results of a run.
    verdicts : sequence of Verdict, optional
        Verdicts on leakage classes; by default the verdicts on the classes of the case.

    Returns
    -------
    list of list of str
        Paragraphs, each of which is a list of sentences. The leakage classes come first, with one paragraph each.
        Where there is something to say, further paragraphs follow on the leakage, possible improvements, the accuracy
        and hints.
    """
    if verdicts is None:
        verdicts = verdicts_of(results)
    writer = _ParagraphWriter(results)
    paragraphs = [writer.about_class(verdict, len(verdicts)) for verdict in verdicts]
    classes = find_leak_classes([verdict.name for verdict in verdicts])
    # if a class limits the leakage of the whole seal, the paragraph on this class already states it
    if all(LEAK_UNITS[leak_class.unit].per_length for leak_class in classes):
        paragraphs.append(writer.about_leakage(with_cycle=not verdicts))
    paragraphs.append(writer.about_service())
    paragraphs.append(writer.about_measures(verdicts))
    paragraphs.append(_about_accuracy(results))
    paragraphs.append(_hints(results, verdicts))
    return [paragraph for paragraph in paragraphs if paragraph]


def seal_name(results: Results) -> str:
    """Return "the whole seal" or, if the case gives no seal length, the assumed length of the seal."""
    case = results.case
    is_strip = (case.get("seal") or {}).get("kind", "rectangular") == "rectangular"
    has_length = "length" in (case.get("stochastic") or {})
    if not case or not is_strip or has_length:
        return "the whole seal"
    length = to_text(results.dataset.attrs["seal_size_m"][1], "m", 3)
    return (
        f"{length} of seal, as long as the surface, because the case states no length of the seal,"
    )


def verdict_lines(results: Results, verdicts: Sequence[Verdict] | None = None) -> list[str]:
    """Return the paragraphs of `verdict_paragraphs`, each as a single text."""
    return [" ".join(paragraph) for paragraph in verdict_paragraphs(results, verdicts)]


class _ParagraphWriter:
    """Write the sentences about a run, based on its leakage curve and its assembly load."""

    def __init__(self, results: Results) -> None:
        """Collect what several sentences need: leakage curve, assembly load, and fluid of the leakage classes."""
        self.results = results
        self.curve = LeakageCurve.of_results(results)
        self.load_text = load_format(results.dataset, 3).full
        self.step = self.curve.assembly_step
        self.assembly_load = self.load_of(self.step)
        self.fluid = deciding_fluid(results)
        self.has_test = "test_leakage" in results.dataset

    def load_of(self, step: int) -> str:
        """Convert the load of a step to text."""
        return self.load_text(float(self.curve.steps.pressures[step]))

    # --- leakage in usual units ---

    def usual_unit(self, value: float) -> LeakUnit:
        """Return the unit of the case, or else a unit that suits the leakage `value` [m²/s] of the whole seal."""
        basis, asked = self.results.class_basis, self.results.asked_unit
        if asked is not None and not asked.per_length and basis.has(asked):
            return asked
        return basis.usual_unit(value)

    def value_at(self, step: int, unit: LeakUnit | None = None) -> str:
        """Return the leakage at a step as text with its unit, as "sealed", or the reason why it is unknown."""
        leakage = float(self.curve.leakage[step])
        if not isfinite(leakage):
            return f"unknown, as {why_unknown(self.results, step)}"
        chosen = unit or self.usual_unit(leakage)
        factor = self.results.class_basis.factor(chosen)
        return format_leakage(leakage, factor, chosen)

    def assembly_leakage(self, unit: LeakUnit | None = None) -> str:
        """Return the leakage at the assembly load with its 95 % interval, as text."""
        leakage = float(self.curve.leakage[self.step])
        lower = float(self.curve.lower[self.step])
        upper = float(self.curve.upper[self.step])
        if not isfinite(leakage):
            return self.value_at(self.step)
        # the unit suits the leakage, or the upper end of the interval if the leakage is zero
        size = leakage
        if leakage == 0 and isfinite(upper):
            size = upper
        chosen = unit or self.usual_unit(size)
        text = self.value_at(self.step, chosen)
        if not self.curve.has_interval:
            return f"{text} (without an interval)"
        factor = self.results.class_basis.factor(chosen)
        ends = format_interval(lower, upper, factor, leakage, chosen)
        if leakage == 0:
            if lower == 0 < upper < inf:
                ends = format_upper_end(upper, factor, chosen)
            return f"none as computed (95 % interval: {ends})"
        return f"{text} (95 % interval {ends})"

    def mass_per_year(self) -> str:
        """Return the leakage at the assembly load as mass per year, or "" if it is unknown, tiny or huge."""
        basis = self.results.class_basis
        leakage = float(self.curve.leakage[self.step])
        unit = LEAK_UNITS["kg/s"]
        if not basis.has(unit) or not isfinite(leakage):
            return ""
        mass = leakage / basis.factor(unit)
        if not _LEAST_MASS <= mass <= _MOST_MASS:
            return ""
        name = "kg/year" if mass >= LEAK_UNITS["kg/year"].si else "g/year"
        unit = LEAK_UNITS[name]
        return f"{format_leakage(leakage, basis.factor(unit))} {name.replace('/', ' a ')}"

    # --- paragraphs ---

    def about_class(self, verdict: Verdict, count: int) -> Paragraph:
        """Say whether a class is met, how much the seal leaks at the assembly load, and which load the class requires.

        `count` is the number of classes in the verdict. With more than `_MOST_IN_SENTENCES` classes, the sentences omit
        the required loads, which are listed in the table.
        """
        is_described = count <= _MOST_IN_SENTENCES
        sentences = verdict_sentences(verdict, self.load_text, whole=is_described)
        if verdict.unknown or not is_described:
            return sentences
        (leak_class,) = find_leak_classes([verdict.name])
        unit = LEAK_UNITS[leak_class.unit]
        leakage = f"Leakage there: {self.assembly_leakage(unit)}"
        if not verdict.is_own_limit:
            (limit,) = limit_texts(self.results, [verdict])
            leakage += f"; the class allows {limit}"
        return [sentences[0], f"{leakage}.", *sentences[1:], *self._after_relaxation(verdict)]

    def _after_relaxation(self, verdict: Verdict) -> list[str]:
        """Say which assembly load a class requires, if the case states that a fraction of it is lost in service."""
        relaxation = (self.results.case.get("load") or {}).get("relaxation") or 0.0
        if not relaxation:
            return []
        needed = self.curve.needed_with_relaxation(verdict.limit, relaxation)
        return [
            f"If {100 * relaxation:.3g} % of the assembly load is lost before service, it is still met after an "
            f"assembly {required_loads(needed, self.load_text)}."
        ]

    def about_leakage(self, with_cycle: bool) -> Paragraph:
        """Say how much the whole seal leaks at the assembly load, and how the leakage changes over the load cycle."""
        seal = seal_name(self.results)
        subject = f"Leakage of {seal} with {self.fluid}"
        if self.has_test:
            subject = f"Leakage of {seal} in the test with {self.fluid}{self._test_pressures()}"
        sentence = (
            f"{subject}, at the assembly load of {self.assembly_load}: {self.assembly_leakage()}"
        )
        mass = "" if self.has_test or self._has_unit_of_mass() else self.mass_per_year()
        sentences = [f"{sentence}{f', which is {mass}' if mass else ''}."]
        if with_cycle:
            sentences += self._cycle()
        return sentences

    def _has_unit_of_mass(self) -> bool:
        """Return whether the case asks for the leakage in a unit of mass."""
        asked = self.results.asked_unit
        return asked is not None and asked.kind == "mass"

    def _test_pressures(self) -> str:
        """Return the inlet and outlet pressure of the test fluid as text."""
        attributes = self.results.dataset.attrs
        inlet, outlet = (
            to_text(attributes[f"test_{end}_pressure_Pa"], "Pa") for end in ("inlet", "outlet")
        )
        return f" from {inlet} to {outlet}"

    def _cycle(self) -> list[str]:
        """Say how the leakage changes on loading up to the assembly load, and on unloading from it."""
        steps = self.curve.steps
        peak = float(steps.pressures[self.step])
        first = int(falling_steps(steps, None)[-1])
        sentences = []
        is_known = isfinite(float(self.curve.leakage[first]))
        if first != self.step and not is_known:
            sentences.append(
                f"On loading at {self.load_of(first)}, the leakage is {self.value_at(first)}."
            )
        if first != self.step and is_known:
            sentences.append(
                f"On loading it changes from {self.value_at(first)} at {self.load_of(first)} to "
                f"{self.value_at(self.step)} at {self.assembly_load}."
            )
        if peak in steps.unload_from:
            last = int(falling_steps(steps, peak)[-1])
            sentences.append(
                f"Unloaded from there to {self.load_of(last)} it is {self.value_at(last)}."
            )
        return sentences

    def about_service(self) -> Paragraph:
        """Say how much of the service fluid leaks, if the leakage classes are evaluated for a test fluid."""
        results = self.results
        if not self.has_test:
            return []
        leakage = abs(float(results.leakage.values[self.step]))
        name = (results.case.get("fluid") or {}).get("name") or results.dataset.attrs["fluid"]
        basis, budget = results.leak_basis, results.budget
        lower = upper = nan
        if budget is not None:
            lower, upper = float(budget.lower[self.step]), float(budget.upper[self.step])
        # a leakage of zero has no suitable unit, but its upper end has
        size = leakage or upper
        unit = basis.usual_unit(size if isfinite(size) else 0.0)
        factor = basis.factor(unit)
        text = format_leakage(leakage, factor, unit)
        if budget is not None and isfinite(leakage):
            ends = format_interval(lower, upper, factor, leakage, unit)
            text += f" (95 % interval {ends})"
        seal = seal_name(results)
        return [f"In service with {name}, the leakage of {seal} as computed there: {text}."]

    def about_measures(self, verdicts: Sequence[Verdict]) -> Paragraph:
        """Say which action would narrow the interval most, and which would lower the leakage if a class is not met.

        - If the 95 % interval at the assembly load meets all classes, say what narrows the interval at a lower load. At
          this lower load, the computed leakage meets a class, but the upper end of its interval does not.
        - If no classes are given, or if the computed leakage at the assembly load meets all classes but its interval
          does not, say what narrows the interval and what lowers the leakage.
        - If the computed leakage at the assembly load does not meet a class, say what lowers the leakage, and by which
          factor it must fall.
        """
        is_surely_met = bool(verdicts) and all(verdict.met_with_interval for verdict in verdicts)
        if is_surely_met:
            return self._narrowing(self._vague_step(verdicts))
        sentences = []
        is_met = all(verdict.met_as_computed for verdict in verdicts)  # also True without classes
        if is_met:
            sentences += self._narrowing(self.step)
        lowered = self._lowering()
        if lowered:
            sentences.append(lowered)
            unmet = [verdict for verdict in verdicts if not verdict.met_as_computed]
            if unmet and unmet[0].limit > 0:
                ratio = unmet[0].limit / float(self.curve.leakage[self.step])
                sentences.append(f"{unmet[0].name} asks for {ratio:.2g} times as much.")
        return sentences

    def _vague_step(self, verdicts: Sequence[Verdict]) -> int | None:
        """Return the step with the highest load on loading at which it is uncertain whether a class is met.

        At this step, the computed leakage is above 0 and meets a class, but the upper end of its 95 % interval does
        not. The function returns None if it is certain at every step whether the classes are met.
        """
        for step in falling_steps(self.curve.steps, None).tolist():
            leakage = self.curve.leakage[step]
            upper = self.curve.upper[step]
            if any(0 < leakage <= verdict.limit < upper for verdict in verdicts):
                return int(step)
        return None

    def _narrowing(self, step: int | None) -> Paragraph:
        """Describe the action that narrows the 95 % interval at a load step most; empty if no action is known."""
        if step is None:
            return []
        narrowing = best_narrowing(self.results, step)
        if narrowing is None:
            return []
        leakage = float(self.curve.leakage[step])
        unit = self.usual_unit(leakage)
        factor = self.results.class_basis.factor(unit)

        def interval_text(lower: float, upper: float) -> str:
            """Return an interval of the leakage as text, in the unit that suits the leakage."""
            return format_interval(lower, upper, factor, leakage, unit)

        lower, upper = float(self.curve.lower[step]), float(self.curve.upper[step])
        before = interval_text(lower, upper)
        after = interval_text(narrowing.lower, narrowing.upper)
        how = "at best" if narrowing.is_best_case else "about"
        is_slight = _remaining_width(lower, upper, narrowing.lower, narrowing.upper) > _SLIGHT
        extent = "the interval only slightly, from" if is_slight else "the interval from"
        return [
            f"The widest source of error at {self.load_of(step)} is '{narrowing.source}': {narrowing.action} "
            f"would narrow {extent} {before} to {how} {after}."
        ]

    def _lowering(self) -> str:
        """Say how a higher load and a smoother finish would change the leakage at the assembly load, if known."""
        leakage = self.results.class_leakage[0]
        if not 0 < float(self.curve.leakage[self.step]) < inf:
            return ""
        lowered = lowering(self.results, leakage, self.step)
        texts = []
        if lowered.by_load < 1:
            load = "force" if load_format(self.results.dataset).unit else "load"
            texts.append(
                f"With a {load} that is {100 * LOAD_INCREASE:g} % higher, the seal would leak about "
                f"{lowered.by_load:.2g} times as much."
            )
        if lowered.by_finish < 1:
            texts.append(
                f"With a finish whose heights are {100 * (1 - HEIGHTS):.0f} % lower, the seal would leak about "
                f"{lowered.by_finish:.2g} times as much."
            )
        return " ".join(texts)


def _about_accuracy(results: Results) -> Paragraph:
    """Say whether the requested accuracy was reached; the list is empty if the case requests no accuracy."""
    attempts = results.attempts
    if attempts is None:
        return []
    wanted = format_deviation(log1p(attempts["wanted"]))
    reached = "reached" if attempts["reached"] else "not reached"
    sentence = (
        f"The accuracy of {wanted} is {reached}: the numerical error is {half_width_text(attempts)}"
    )
    if attempts.get("model_parts"):
        with_model = half_width_text({"half_width": attempts["with_model"]})
        sentence += f", and with the model and its input it is {with_model}"
    return [f"{sentence}."]


def _hints(results: Results, verdicts: Sequence[Verdict]) -> Paragraph:
    """Name the keys that could be added to the case for a more complete verdict."""
    hints = []
    if results.budget is None:
        hints.append("The run has no error budget; output.budget = true gives the interval.")
    if not verdicts:
        hints.append(
            "Set classes in [output] of the case to see from which load on a leakage class is met."
        )
    return hints


def _remaining_width(lower: float, upper: float, new_lower: float, new_upper: float) -> float:
    """Divide the width of a new interval of ln(leakage) by the width of the present one.

    The ratio is 0 if the new or the present interval has no finite width.
    """
    ends = (lower, upper, new_lower, new_upper)
    if not all(0 < end < inf for end in ends) or upper <= lower:
        return 0.0
    return log(new_upper / new_lower) / log(upper / lower)

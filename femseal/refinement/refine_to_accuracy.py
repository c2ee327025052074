"""A run whose case asks for an accuracy: attempts, each of which refines what limits the one before."""

import json
import logging
import time
from dataclasses import asdict, dataclass, field, replace
from math import isfinite
from typing import Any

import numpy as np

from ..base import FemsealError, NotKept, duration, format_deviation, free_memory
from ..budget import MODEL_PARTS, ErrorBudget, widest_band
from ..case.case import Case
from ..execution.run import Run
from ..preparation.prepared import START_MEMORY, Prepared
from .budgets import budgets_of
from .settings import (
    Settings,
    apply_settings,
    expected_cost,
    first_settings,
    refined,
    time_limit,
)

log = logging.getLogger("femseal.refinement")


@dataclass(frozen=True)
class Attempt:
    """One attempt at an accuracy.

    settings : with which it was computed. points : of the face. seconds : wall time of its study;
    with_coarse : with that of the coarser one that shows the error of its pixels, where no earlier attempt was that
    one. half_width : largest half-width of ln(leakage) of the budget at the loads that count, inf where it has no end.
    limit : the source of error that is widest there. parts : half-widths of the sources there. load : name of the load
    where it is largest.
    """

    settings: Settings
    points: tuple[int, int]
    seconds: float
    with_coarse: float
    half_width: float
    limit: str
    load: str
    parts: dict[str, float]

    def __str__(self) -> str:
        """The attempt as a line of the log."""
        points = " × ".join(map(str, self.points))
        return (
            f"{self.settings.method} on {points} points in {self.with_coarse:.3g} s, within "
            f"{format_deviation(self.half_width)} at {self.load}, limited by {self.limit}"
        )


@dataclass(frozen=True, eq=False)
class RefinedAnswer:
    """Outcome of the attempts: the last of them, the finest in all, prepared and solved.

    why : what hinders a further attempt; "" where the accuracy is reached. half : what half the error takes. wanted :
    the accuracy. limit : of the time [s].
    """

    prepared: Prepared
    result: Any
    budget: ErrorBudget
    attempts: tuple[Attempt, ...]
    why: str
    half: str
    wanted: float
    limit: float

    @property
    def warnings(self) -> tuple[str, ...]:
        """That the accuracy is not reached, and what limits it."""
        if not self.why:
            return ()
        last, wanted = self.attempts[-1], format_deviation(np.log1p(self.wanted))
        error = f"{format_deviation(last.half_width)} at {last.load}"
        return (
            f"accuracy {wanted} is not reached: the error of the numbers alone may be {error}; {self.why}",
        )

    def as_data(self, budget: ErrorBudget) -> dict[str, Any]:
        """What the results say of the attempts, as plain data; None for a width without end.

        budget : with the parts of the model.
        """
        last = self.attempts[-1]
        found = {
            "wanted": self.wanted,
            "reached": not self.why,
            "half_width": last.half_width,
            "model_parts": [part.name for part in budget.parts if part.name in MODEL_PARTS],
            "with_model": widest_band(budget).half_width,
            "limit": last.limit,
            "load": last.load,
            "why": self.why,
            "half_error": self.half,
            "time_limit": self.limit,
            "settings": asdict(last.settings),
            "attempts": [asdict(attempt) for attempt in self.attempts],
        }
        return with_ends(found)


def refine_to_accuracy(case: Case, made: Prepared, run: Run) -> RefinedAnswer:
    """Refine what limits the error of the answer until the accuracy of the case is reached, or cannot be.

    made : the case as prepared, on the points of its face.
    run : solves the studies; a run that goes on takes the decisions that it took before.

    Raises FemsealError: the first attempt failed. One that fails later ends the attempts.
    """
    assert case.accuracy is not None
    goal, most = np.log1p(case.accuracy), time_limit(case)
    # what is free now has the packages in it already
    memory = free_memory() if case.memory is None else case.memory - START_MEMORY
    attempts = _Attempts(case, made, run, memory)
    settings = first_settings(case, made)
    solved: tuple[Prepared, Any, ErrorBudget] | None = None
    why, text = "", ""
    while True:
        try:
            found = attempts.attempt(settings)
        except NotKept:
            raise
        except FemsealError as error:
            if solved is None:
                raise
            why = f"{text} failed: {error}"
            break
        solved, last = found, attempts.done[-1]
        log.info("attempt %d: %s", len(attempts.done), last)
        if last.half_width <= goal:
            break
        settings, text, why = attempts.next_settings(goal, most)
        if why:
            break
        log.info("next: %s", text)
    prepared, result, budget = solved
    half = attempts.half_error()
    return RefinedAnswer(
        prepared, result, budget, tuple(attempts.done), why, half, case.accuracy, most
    )


@dataclass(eq=False)
class _Attempts:
    """The attempts of a case so far.

    memory : that an attempt may take [byte].
    """

    case: Case
    made: Prepared
    run: Run
    memory: float
    done: list[Attempt] = field(default_factory=list)

    def attempt(self, settings: Settings) -> tuple[Prepared, Any, ErrorBudget]:
        """Solve the case with these settings, and estimate its error."""
        name = f"attempt {len(self.done) + 1}"
        prepared = apply_settings(self.made, settings)
        start = time.perf_counter()
        with self.run.timed(name) as mapper:
            result = prepared.solve(prepared.answer, mapper)
        times = {"study": time.perf_counter() - start}
        with self.run.timed(f"{name}, error budget") as mapper:
            alone = replace(prepared, methods=frozenset({prepared.answer.name}))
            key = prepared.answer.key
            budget = budgets_of(alone, {key: result}, mapper)[key]
        times["with coarse"] = time.perf_counter() - start
        times = self.run.decided("time of the attempt", self._so_far, times)
        found = widest_band(budget)
        self.done.append(
            Attempt(
                settings=settings,
                points=prepared.scene.surface.shape,
                seconds=times["study"],
                with_coarse=times["with coarse"],
                half_width=found.half_width,
                limit=found.limit,
                load=prepared.scene.steps[found.step].name,
                parts=found.parts,
            )
        )
        return prepared, result, budget

    def next_settings(self, goal: float, most: float) -> tuple[Settings, str, str]:
        """Settings of the next attempt, what they change, and "" or what hinders it.

        goal : half-width of ln(leakage) that is wanted. most : time of all attempts [s].
        """
        last, text, why = self.done[-1], "", ""
        reasons: list[str] = []
        for part in sorted(last.parts, key=lambda name: -last.parts[name]):
            # the others of an accuracy that cannot be reached are refined until they are within it
            if reasons and last.parts[part] <= goal and max(last.parts.values()) > goal:
                break
            finer, change = refined(self.case, self.made, last.settings, part, self.memory)
            if finer is not None:
                break
            reasons.append(f"{part}: {change}")
        if finer is None:
            why = "; ".join(reasons)
        else:
            text = f"{change}, for the error of {part}"
            expected = self._expected_seconds(finer)
            spent = sum(attempt.with_coarse for attempt in self.done)
            if spent + expected > most:
                late = f"{change} would take about {duration(expected)}, after {duration(spent)}"
                reasons.append(f"{part}: {late}, and the time limit is {duration(most)}")
                why = "; ".join(reasons)
        finer, text, why = self.run.decided("next attempt", self._so_far, (finer, text, why))
        return finer or last.settings, text, why

    @property
    def _so_far(self) -> tuple[str, int]:
        """The case and the number of attempts, as plain data."""
        return json.dumps(self.case.echo(), default=str), len(self.done)

    def half_error(self) -> str:
        """What half the error of the last attempt would take."""
        last = self.done[-1]
        finer, change = refined(self.case, self.made, last.settings, last.limit, self.memory)
        if finer is None:
            return f"cannot be had: {change}"
        return f"{change}, about {duration(self._expected_seconds(finer))}"

    def _expected_seconds(self, settings: Settings) -> float:
        """Expected wall time of other settings, as multiple of what the last attempt took [s]."""
        last = self.done[-1]
        seconds, before = (
            expected_cost(apply_settings(self.made, s))[0] for s in (settings, last.settings)
        )
        return last.seconds * seconds / before


def with_ends(data: Any) -> Any:
    """Nested data with None for numbers that have no end or are unknown, for files that know neither."""
    if isinstance(data, dict):
        return {key: with_ends(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [with_ends(value) for value in data]
    return None if isinstance(data, float) and not isfinite(data) else data

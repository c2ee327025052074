"""Run a case with a required accuracy: in several attempts, refine the setting that causes the largest error."""

import json
import logging
import time
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from ..base import (
    FemsealError,
    NotKept,
    as_text,
    duration,
    finite_data,
    format_deviation,
    free_memory,
)
from ..budget import BudgetRequest, ErrorBudget, budgets_of, widest_interval
from ..budget.study_input import StudyInput
from ..case.case import Case
from ..execution.run import Run
from ..preparation.memory import START_MEMORY
from .settings import (
    Settings,
    SettingsChange,
    apply_settings,
    expected_cost,
    finer_settings,
    first_settings,
)

#: Time limit of all attempts [s] if the case has an accuracy but no time limit.
TIME_LIMIT = 3600.0
log = logging.getLogger("femseal.refinement")


@dataclass(frozen=True)
class Attempt:
    """Describe one attempt to reach the required accuracy.

    Parameters
    ----------
    settings : settings of the attempt.
    points : numbers of points of the surface along x1 and x2.
    seconds : wall time of the attempt [s], including the solution on a coarser grid from which the error due to the
        pixel size is estimated.
    half_width : largest half-width of the 95 % interval of ln(leakage) over the load steps; inf if the interval is
        unbounded.
    limit : error source with the widest interval.
    load : name of the load step at which the 95 % interval is widest.
    parts : largest half-width of the interval due to each error source, by the name of the source.
    """

    settings: Settings
    points: tuple[int, int]
    seconds: float
    half_width: float
    limit: str
    load: str
    parts: dict[str, float]

    def __str__(self) -> str:
        """Describe the attempt in one line, for the log."""
        return (
            f"{self.settings.method} on {as_text(self.points)} points in {self.seconds:.3g} s, within "
            f"{format_deviation(self.half_width)} at {self.load}, limited by {self.limit}"
        )


@dataclass(frozen=True, eq=False)
class RefinedAnswer:
    """Result of the last attempt, which has the finest settings, and a record of all attempts.

    Parameters
    ----------
    study_input : input of the studies with the settings of the last attempt.
    result : result of the study in the last attempt.
    budget : error budget of `result`.
    attempts : all attempts in their order.
    reason : reason why the attempts ended although the accuracy was not reached; "" if the accuracy was reached.
    can_halve_error : True if other settings could halve the error.
    half_error : text that says which settings would halve the error, and how long an attempt with these settings would
        take.
    accuracy : required accuracy, as the largest relative error of the leakage.
    time_limit : time limit for all attempts together [s].
    """

    study_input: StudyInput
    result: Any
    budget: ErrorBudget
    attempts: tuple[Attempt, ...]
    reason: str
    can_halve_error: bool
    half_error: str
    accuracy: float
    time_limit: float

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warning if the required accuracy was not reached, with the reason; empty otherwise."""
        if not self.reason:
            return ()
        last = self.attempts[-1]
        required = format_deviation(np.log1p(self.accuracy))
        error = f"{format_deviation(last.half_width)} at {last.load}"
        return (
            f"accuracy {required} is not reached: the numerical errors alone may be {error}; {self.reason}",
        )

    def as_data(self, budget: ErrorBudget) -> dict[str, Any]:
        """Return the attempts as plain data for the results, in which infinite and undefined numbers are None.

        budget : error budget that includes the error sources of the model and its input.
        """
        last = self.attempts[-1]
        data = {
            "wanted": self.accuracy,
            "reached": not self.reason,
            "half_width": last.half_width,
            "model_parts": [part.name for part in budget.parts if part.of_model],
            "with_model": widest_interval(budget).half_width,
            "limit": last.limit,
            "load": last.load,
            "why": self.reason,
            "can_halve_error": self.can_halve_error,
            "half_error": self.half_error,
            "time_limit": self.time_limit,
            "settings": asdict(last.settings),
            "attempts": [asdict(attempt) for attempt in self.attempts],
        }
        return finite_data(data)


def refine_to_accuracy(case: Case, original: StudyInput, run: Run) -> RefinedAnswer:
    """Solve a case in several attempts with finer and finer settings.

    The attempts end when the required accuracy is reached, when no setting can reduce the errors further within the
    limits of time and memory, or when an attempt after the first fails. After each attempt, the setting that causes the
    largest error that can still be reduced is refined for the next attempt.

    Parameters
    ----------
    case : a case with an accuracy.
    original : input of the studies, with the surface on the grid of the case.
    run : run that solves the studies. If the run is resumed after an interruption, decisions that were taken before the
        interruption are repeated.

    Raises
    ------
    FemsealError : the first attempt failed. If a later attempt fails, no error is raised, and the result of the
        previous attempt is returned.
    """
    assert case.accuracy is not None
    goal = np.log1p(case.accuracy)
    time_limit = case.time_limit or TIME_LIMIT
    # the memory limit of a case includes the imported packages, which are not part of the free memory
    memory = free_memory() if case.memory is None else case.memory - START_MEMORY
    attempts = _Attempts(case, original, run, memory)
    chosen = SettingsChange(first_settings(case, original))
    reason = ""
    while chosen.settings is not None:
        try:
            solved = attempts.attempt(chosen.settings)
        except NotKept:
            raise  # the results cannot be stored, and further attempts would not change that
        except FemsealError as error:
            if not attempts.done:
                raise
            # the result of the last successful attempt is the answer
            reason = f"{chosen.change} failed: {error}"
            break
        last = attempts.done[-1]
        log.info("attempt %d: %s", len(attempts.done), last)
        if last.half_width <= goal:
            break
        chosen = attempts.next_settings(goal, time_limit)
        reason = chosen.reason
        log.info("next: %s", chosen.change or reason)
    study_input, result, budget = solved
    can_halve_error, half_error = attempts.half_error()
    return RefinedAnswer(
        study_input=study_input,
        result=result,
        budget=budget,
        attempts=tuple(attempts.done),
        reason=reason,
        can_halve_error=can_halve_error,
        half_error=half_error,
        accuracy=case.accuracy,
        time_limit=time_limit,
    )


@dataclass(eq=False)
class _Attempts:
    """Carry out the attempts for a case, and record them.

    case : the case.
    original : input of the studies, with the surface on the grid of the case.
    run : run that solves the studies.
    memory : memory that an attempt may use [byte].
    done : finished attempts.
    """

    case: Case
    original: StudyInput
    run: Run
    memory: float
    done: list[Attempt] = field(default_factory=list)

    def attempt(self, settings: Settings) -> tuple[StudyInput, Any, ErrorBudget]:
        """Solve the case with the given settings, compute its error budget, and record the attempt."""
        name = f"attempt {len(self.done) + 1}"
        study_input = apply_settings(self.original, settings)
        answer = study_input.answer
        key = answer.key
        start = time.perf_counter()
        with self.run.timed(name) as mapper:
            result = study_input.solve(answer, mapper)
        with self.run.timed(f"{name}, error budget") as mapper:
            budget = budgets_of(BudgetRequest(study_input.only_answer), {key: result}, mapper)[key]
        seconds = time.perf_counter() - start
        # a resumed run takes the measured time of the original run, so that its decisions are the same
        seconds = self.run.decided("time of the attempt", self._so_far, seconds)
        widest = widest_interval(budget)
        self.done.append(
            Attempt(
                settings=settings,
                points=study_input.scene.surface.shape,
                seconds=seconds,
                half_width=widest.half_width,
                limit=widest.limit,
                load=study_input.scene.steps[widest.step].name,
                parts=widest.parts,
            )
        )
        return study_input, result, budget

    def next_settings(self, goal: float, time_limit: float) -> SettingsChange:
        """Choose the settings of the next attempt.

        Parameters
        ----------
        goal : required half-width of the 95 % interval of ln(leakage).
        time_limit : longest time of all attempts together [s].
        """
        last = self.done[-1]
        chosen: SettingsChange | None = None
        reasons: list[str] = []  # why errors cannot be reduced
        # the error sources, from the largest half-width to the smallest
        for part in sorted(last.parts, key=lambda name: -last.parts[name]):
            # If the largest error cannot be reduced, the required accuracy cannot be reached. Smaller errors are then
            # still reduced, but only until they are below the goal.
            if reasons and last.parts[part] <= goal < max(last.parts.values()):
                break
            finer = finer_settings(self.case, self.original, last.settings, part, self.memory)
            if finer.settings is None:
                reasons.append(f"{part}: {finer.reason}")
                continue
            expected = self._expected_seconds(finer.settings)
            spent = sum(attempt.seconds for attempt in self.done)
            if spent + expected <= time_limit:
                chosen = replace(finer, change=f"{finer.change}, for the error of {part}")
            else:
                would_take = f"{finer.change} would take about {duration(expected)}"
                late = f"{would_take}, after {duration(spent)}"
                reasons.append(f"{part}: {late}, and the time limit is {duration(time_limit)}")
            break
        decision = chosen or SettingsChange(reason="; ".join(reasons))
        return self.run.decided("next attempt", self._so_far, decision)

    @property
    def _so_far(self) -> tuple[str, int]:
        """Case as text, and number of completed attempts, which together identify a stored decision of the run."""
        return json.dumps(self.case.echo(), default=str), len(self.done)

    def half_error(self) -> tuple[bool, str]:
        """Say whether the largest error of the last attempt can be halved, by which settings, and in what time."""
        last = self.done[-1]
        finer = finer_settings(self.case, self.original, last.settings, last.limit, self.memory)
        if finer.settings is None:
            return False, f"not possible: {finer.reason}"
        return True, f"{finer.change}, about {duration(self._expected_seconds(finer.settings))}"

    def _expected_seconds(self, settings: Settings) -> float:
        """Estimate the wall time of an attempt with other settings [s] from the measured time of the last attempt."""
        last = self.done[-1]
        new_cost, _ = expected_cost(apply_settings(self.original, settings))
        last_cost, _ = expected_cost(apply_settings(self.original, last.settings))
        return last.seconds * new_cost / last_cost

"""Run a case with a required accuracy: in several attempts, refine the setting that causes the largest error."""

import json
import logging
import time
from dataclasses import asdict, dataclass, field, replace
from math import ceil
from typing import Any, NamedTuple

import numpy as np

from ..base import (
    FemsealError,
    NotKept,
    Shape,
    as_text,
    duration,
    finite_data,
    format_deviation,
    free_memory,
    to_text,
)
from ..budget import MODEL_PARTS, BudgetRequest, ErrorBudget, budgets_of, widest_interval
from ..case.case import Case
from ..execution.run import Run
from ..face.cells import FEWEST_POINTS
from ..preparation.memory import START_MEMORY, refuse_impossible_sizes
from ..preparation.preparation import Prepared
from ..studies.study_registry import contact_tolerance

#: Time limit of all attempts [s] if the case has an accuracy but no time limit.
TIME_LIMIT = 3600.0
#: Grid of the first and of the finest attempt: how many times the points along each side are doubled, relative to the
#: points of the case. On the grid of the case, the shortest wave has 8 pixels. On the grid of the first attempt, the
#: shortest wave has 4 pixels. The error of the first attempt is estimated with a coarser grid, on which the shortest
#: wave has 2 pixels. With even fewer pixels, the estimated error was too small by up to a factor of 2.
FIRST_GRID, MOST_GRID = -1, 4
#: Smallest tolerance of the contact solution.
LEAST_RTOL = 1e-8
#: Advice for error sources that no setting can reduce.
_ADVICE = {
    "filter": "short waves were removed; a shorter surface.shortest_wave with more surface.points keeps them, if they "
    "were measured",
    "patch": "one measured patch does not show more; measure a larger area or more patches",
}
#: Number of realisations in the first attempt, and largest number of realisations. Multiplying the number of
#: realisations by `HALVING` halves the error of their median.
FIRST_SEALS, MOST_SEALS, HALVING = 20, 20480, 4
log = logging.getLogger("femseal.refinement")


@dataclass(frozen=True)
class Settings:
    """Numerical settings of an attempt.

    Parameters
    ----------
    method : name of the study that gives the leakage.
    grid : exponent g: the number of points along each side of the surface is 2^g times the number in the case.
    rtol : largest relative residual of the contact solution.
    realisations : number of realisations; None if the study has no realisations.
    """

    method: str
    grid: int
    rtol: float
    realisations: int | None


def given_settings(case: Case) -> dict[str, str]:
    """Return the names of the settings that the case fixes, with their keys in the case.

    All attempts use the fixed settings as the case states them.
    """
    keys: dict[str, str] = {}
    if case.surface.points is not None:
        keys["grid"] = "surface.points"
    if "rtol" in case.contact.model_fields_set:
        keys["rtol"] = "contact.rtol"
    if case.stochastic is not None and case.stochastic.realisations is not None:
        keys["realisations"] = "stochastic.realisations"
    return keys


def first_settings(case: Case, original: Prepared) -> Settings:
    """Choose the settings of the first attempt: coarse pixels, and few realisations.

    original : prepared case, with the surface on the grid of the case.
    """
    assert case.accuracy is not None
    given = given_settings(case)
    sampling = original.sampling
    realisations = None if sampling is None else sampling.realisations
    if sampling is not None and "realisations" not in given:
        realisations = FIRST_SEALS
    rtol = case.contact.rtol if "rtol" in given else contact_tolerance(case.accuracy)
    settings = Settings(original.answer.name, 0, rtol, realisations)
    if "grid" in given:
        return settings
    # The error is estimated by comparison with a grid that has half the points along each side. The cells of this grid
    # must have enough points as well.
    points = grid_points(original, FIRST_GRID - 1)
    cells = original.cells or (1, 1)
    has_enough_points = all(n // m >= FEWEST_POINTS for n, m in zip(points, cells, strict=True))
    return replace(settings, grid=FIRST_GRID) if has_enough_points else settings


def grid_points(original: Prepared, grid: int) -> Shape:
    """Return the numbers of points along both sides of the surface on a finer or coarser grid.

    The number of points in the case is multiplied by 2^`grid`, and rounded up to a multiple of the corresponding number
    in `original.points_divide_by`. The surface can then be divided into equal blocks.
    """
    n1, n2 = (
        ceil(n * 2.0**grid / divisor) * divisor
        for n, divisor in zip(original.scene.surface.shape, original.points_divide_by, strict=True)
    )
    return n1, n2


def apply_settings(original: Prepared, settings: Settings) -> Prepared:
    """Return the prepared case with other settings, and with its surface resampled to the grid of the new settings.

    original : prepared case, with the surface on the grid of the case.
    """
    surface = original.scene.surface
    points = grid_points(original, settings.grid)
    face = surface if points == surface.shape else surface.resample(points)
    sampling = original.sampling
    if sampling is not None:
        sampling = replace(sampling, realisations=settings.realisations)
    return replace(
        original,
        scene=replace(original.scene, surface=face, rtol=settings.rtol),
        sampling=sampling,
        conditioning=replace(original.conditioning, shape=face.shape, spacing=face.spacing),
    )


def first_version(case: Case, original: Prepared) -> Prepared:
    """Prepare a case with the settings of the first attempt to reach its accuracy."""
    with refuse_impossible_sizes():
        return apply_settings(original, first_settings(case, original))


def last_version(case: Case, original: Prepared, attempts: dict[str, Any] | None) -> Prepared:
    """Prepare a case with the settings of the last attempt, or with unchanged settings if there were no attempts.

    attempts : record of the attempts, as in `Results.attempts`; None if there were no attempts.
    """
    if attempts is None or case.accuracy is None:
        return original
    return apply_settings(original, Settings(**attempts["settings"]))


def expected_cost(prepared: Prepared) -> tuple[float, float]:
    """Estimate the time on one core [s] and the memory [byte] of the study that gives the leakage.

    The other studies of the case are left out.
    """
    answer = prepared.answer
    only_answer = replace(prepared, methods=frozenset({answer.name}))
    return only_answer.cost(answer)


def finer_settings(
    case: Case, original: Prepared, settings: Settings, part: str, memory: float
) -> tuple[Settings | None, str]:
    """Choose settings that approximately halve the error from one error source.

    Parameters
    ----------
    case : the case.
    original : prepared case, with the surface on the grid of the case.
    settings : settings of the last attempt.
    part : name of the error source.
    memory : memory that an attempt may use [byte].

    Returns
    -------
    The finer settings, and a text that describes the change. If the error cannot be reduced: None, and a text that
    states the reason.
    """
    rtol = settings.rtol / 10
    grid = settings.grid + 1
    realisations = HALVING * (settings.realisations or 0)
    points = as_text(grid_points(original, grid))
    refinements = {
        "solver": _Refinement(
            setting="rtol",
            value=rtol,
            text=f"contact.rtol {rtol:.0e}",
            is_allowed=rtol >= LEAST_RTOL * (1 - 1e-9),
        ),
        "pixels": _Refinement(
            setting="grid", value=grid, text=f"{points} points", is_allowed=grid <= MOST_GRID
        ),
        "realisations": _Refinement(
            setting="realisations",
            value=realisations,
            text=f"{realisations} seals",
            is_allowed=realisations <= MOST_SEALS,
        ),
    }
    if part not in refinements:
        return None, _ADVICE.get(part, "no setting reduces this error")
    refinement = refinements[part]
    text = refinement.text
    case_key = given_settings(case).get(refinement.setting)
    if case_key is not None:
        return None, f"{case_key} is given in the case"
    if not refinement.is_allowed:
        return None, f"{text} is finer than any attempt"
    finer = replace(settings, **{refinement.setting: refinement.value})
    _, needed = expected_cost(apply_settings(original, finer))
    if needed <= memory:
        return finer, text
    needed_text = to_text(needed, "B", 3)
    memory_text = to_text(memory, "B", 3)
    return None, f"{text} would take about {needed_text} of memory, expected {memory_text}"


class _Refinement(NamedTuple):
    """Describe a new value of one setting that approximately halves the error from one source.

    setting : name of the setting in `Settings`.
    value : new value of the setting.
    text : the new value as text.
    is_allowed : whether the new value is within the limit of the setting, for example `MOST_GRID`.
    """

    setting: str
    value: Any
    text: str
    is_allowed: bool


@dataclass(frozen=True)
class Attempt:
    """Describe one attempt to reach the required accuracy.

    Parameters
    ----------
    settings : settings of the attempt.
    points : numbers of points of the surface along x1 and x2.
    seconds : wall time of the attempt [s], including a solution on a coarser grid, from which the error of the pixel
        size is estimated.
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
    prepared : prepared case with the settings of the last attempt.
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

    prepared: Prepared
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
            "model_parts": [part.name for part in budget.parts if part.name in MODEL_PARTS],
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


def refine_to_accuracy(case: Case, original: Prepared, run: Run) -> RefinedAnswer:
    """Solve a case with finer and finer settings, until its accuracy is reached or cannot be reached.

    After each attempt, the setting that causes the largest error is refined for the next attempt.

    Parameters
    ----------
    case : a case with an accuracy.
    original : prepared case, with the surface on the grid of the case.
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
    settings: Settings | None = first_settings(case, original)
    reason = ""
    change = ""
    while settings is not None:
        try:
            solved = attempts.attempt(settings)
        except NotKept:
            raise  # the results cannot be stored, which more attempts would not change
        except FemsealError as error:
            if not attempts.done:
                raise
            # the result of the last successful attempt is the answer
            reason = f"{change} failed: {error}"
            break
        last = attempts.done[-1]
        log.info("attempt %d: %s", len(attempts.done), last)
        if last.half_width <= goal:
            break
        settings, change, reason = attempts.next_settings(goal, time_limit)
        log.info("next: %s", change or reason)
    prepared, result, budget = solved
    can_halve_error, half_error = attempts.half_error()
    return RefinedAnswer(
        prepared=prepared,
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
    original : prepared case, with the surface on the grid of the case.
    run : run that solves the studies.
    memory : memory that an attempt may use [byte].
    done : finished attempts.
    """

    case: Case
    original: Prepared
    run: Run
    memory: float
    done: list[Attempt] = field(default_factory=list)

    def attempt(self, settings: Settings) -> tuple[Prepared, Any, ErrorBudget]:
        """Solve the case with the given settings, compute its error budget, and record the attempt."""
        name = f"attempt {len(self.done) + 1}"
        prepared = apply_settings(self.original, settings)
        answer = prepared.answer
        key = answer.key
        start = time.perf_counter()
        with self.run.timed(name) as mapper:
            result = prepared.solve(answer, mapper)
        with self.run.timed(f"{name}, error budget") as mapper:
            only_answer = replace(prepared, methods=frozenset({answer.name}))
            budget = budgets_of(BudgetRequest(only_answer), {key: result}, mapper)[key]
        seconds = time.perf_counter() - start
        # a resumed run takes the measured time of the original run, so that its decisions are the same
        seconds = self.run.decided("time of the attempt", self._so_far, seconds)
        widest = widest_interval(budget)
        self.done.append(
            Attempt(
                settings=settings,
                points=prepared.scene.surface.shape,
                seconds=seconds,
                half_width=widest.half_width,
                limit=widest.limit,
                load=prepared.scene.steps[widest.step].name,
                parts=widest.parts,
            )
        )
        return prepared, result, budget

    def next_settings(self, goal: float, time_limit: float) -> tuple[Settings | None, str, str]:
        """Choose the settings of the next attempt.

        Parameters
        ----------
        goal : required half-width of the 95 % interval of ln(leakage).
        time_limit : longest time of all attempts together [s].

        Returns
        -------
        settings : settings of the next attempt; None if there is no next attempt.
        text : description of the change of the settings; "" if there is no next attempt.
        reason : reason why there is no next attempt; "" if there is a next attempt.
        """
        last = self.done[-1]
        chosen: Settings | None = None
        text = ""
        reasons: list[str] = []  # why errors cannot be reduced
        # the error sources, from the largest half-width to the smallest
        for part in sorted(last.parts, key=lambda name: -last.parts[name]):
            # If the largest error cannot be reduced, the required accuracy cannot be reached. Smaller errors are then
            # still reduced, but only until they are below the goal.
            if reasons and last.parts[part] <= goal < max(last.parts.values()):
                break
            finer, change = finer_settings(
                self.case, self.original, last.settings, part, self.memory
            )
            if finer is None:
                reasons.append(f"{part}: {change}")
                continue
            expected = self._expected_seconds(finer)
            spent = sum(attempt.seconds for attempt in self.done)
            if spent + expected <= time_limit:
                chosen = finer
                text = f"{change}, for the error of {part}"
            else:
                late = f"{change} would take about {duration(expected)}, after {duration(spent)}"
                reasons.append(f"{part}: {late}, and the time limit is {duration(time_limit)}")
            break
        reason = "; ".join(reasons) if chosen is None else ""
        decision = (chosen, text, reason)
        return self.run.decided("next attempt", self._so_far, decision)

    @property
    def _so_far(self) -> tuple[str, int]:
        """Case as text, and number of completed attempts, which together identify a stored decision of the run."""
        return json.dumps(self.case.echo(), default=str), len(self.done)

    def half_error(self) -> tuple[bool, str]:
        """Say whether and by which settings the largest error of the last attempt can be halved, and in which time."""
        last = self.done[-1]
        finer, change = finer_settings(
            self.case, self.original, last.settings, last.limit, self.memory
        )
        if finer is None:
            return False, f"not possible: {change}"
        return True, f"{change}, about {duration(self._expected_seconds(finer))}"

    def _expected_seconds(self, settings: Settings) -> float:
        """Estimate the wall time of an attempt with other settings [s] from the measured time of the last attempt."""
        last = self.done[-1]
        new_cost, _ = expected_cost(apply_settings(self.original, settings))
        last_cost, _ = expected_cost(apply_settings(self.original, last.settings))
        return last.seconds * new_cost / last_cost

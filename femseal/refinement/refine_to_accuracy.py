"""Run a case that asks for an accuracy, in attempts that each refine the largest source of error of the last one."""

import json
import logging
import time
from dataclasses import asdict, dataclass, field, replace
from math import ceil
from typing import Any

import numpy as np

from ..base import (
    FemsealError,
    NotKept,
    Shape,
    as_text,
    duration,
    format_deviation,
    free_memory,
    to_text,
)
from ..budget import MODEL_PARTS, BudgetRequest, ErrorBudget, budgets_of, widest_band
from ..case.case import Case
from ..execution.run import Run
from ..face.cells import FEWEST_POINTS
from ..preparation.memory import START_MEMORY, refuse_impossible_sizes
from ..preparation.preparation import Prepared
from ..studies.study_registry import contact_tolerance

#: Longest time of a run whose case asks for an accuracy and gives no time [s].
TIME_LIMIT = 3600.0
#: Doublings of the points along a side, of the first and of the finest attempt. On the points of the case the shortest
#: wave has 8 pixels. It has 4 in the first attempt, and 2 on the coarser grid that shows the error of this attempt.
#: With fewer, the error budget was measured to be too small by up to a factor of 2.
FIRST_GRID, MOST_GRID = -1, 4
#: Least residual of contact.
LEAST_RTOL = 1e-8
#: What helps against sources of error that no settings make smaller.
_BY_NOTHING = {
    "filter": "short waves were removed; a shorter surface.shortest_wave with more surface.points keeps them, if they "
    "were measured",
    "patch": "one measured patch does not show more; measure a larger area or more patches",
}
#: First and largest number of realisations, and the factor on their number that halves the error of the median.
FIRST_SEALS, MOST_SEALS, HALVING = 20, 20480, 4
log = logging.getLogger("femseal.refinement")


@dataclass(frozen=True)
class Settings:
    """What a run computes with, where its case leaves it open.

    Parameters
    ----------
    method : name of the study that answers.
    grid : by how many doublings the points along a side of the surface are finer; negative: halvings.
    rtol : residual of the contact.
    realisations : number of realisations; None without any.
    """

    method: str
    grid: int
    rtol: float
    realisations: int | None


def given_settings(case: Case) -> dict[str, str]:
    """Return the settings that the case gives, each with the key that gives it."""
    found: dict[str, str] = {}
    if case.surface.points is not None:
        found["grid"] = "surface.points"
    if "rtol" in case.contact.model_fields_set:
        found["rtol"] = "contact.rtol"
    if case.stochastic is not None and case.stochastic.realisations is not None:
        found["realisations"] = "stochastic.realisations"
    return found


def first_settings(case: Case, made: Prepared) -> Settings:
    """Choose the settings of the first attempt: coarse pixels, and few realisations.

    made : the case as prepared, on the points of its surface.
    """
    assert case.accuracy is not None
    given, sampling = given_settings(case), made.sampling
    seals = None if sampling is None else sampling.realisations
    if sampling is not None and "realisations" not in given:
        seals = FIRST_SEALS
    rtol = case.contact.rtol if "rtol" in given else contact_tolerance(case.accuracy)
    settings = Settings(made.answer.name, 0, rtol, seals)
    coarse = replace(settings, grid=FIRST_GRID)
    # the coarser grid that shows the error needs cells too
    points, cells = grid_points(made, FIRST_GRID - 1), made.cells or (1, 1)
    fits = all(n // m >= FEWEST_POINTS for n, m in zip(points, cells, strict=True))
    return coarse if fits and "grid" not in given else settings


def grid_points(made: Prepared, grid: int) -> Shape:
    """Return the points of the surface of a case, `grid` doublings finer; as many more as its cells need."""
    n1, n2 = (
        ceil(n * 2.0**grid / m) * m
        for n, m in zip(made.scene.surface.shape, made.points_divide_by, strict=True)
    )
    return n1, n2


def apply_settings(made: Prepared, settings: Settings) -> Prepared:
    """Prepare a case with these settings: the same surface on other points, and the rest as chosen.

    made : the case as prepared, on the points of its surface.
    """
    surface = made.scene.surface
    points = grid_points(made, settings.grid)
    face = surface if points == surface.shape else surface.resample(points)
    sampling = made.sampling
    if sampling is not None:
        sampling = replace(sampling, realisations=settings.realisations)
    return replace(
        made,
        scene=replace(made.scene, surface=face, rtol=settings.rtol),
        sampling=sampling,
        conditioning=replace(made.conditioning, shape=face.shape, spacing=face.spacing),
    )


def first_version(case: Case, made: Prepared) -> Prepared:
    """Prepare the first attempt at the accuracy of a case."""
    with refuse_impossible_sizes():
        return apply_settings(made, first_settings(case, made))


def last_version(case: Case, made: Prepared, attempts: dict[str, Any] | None) -> Prepared:
    """Prepare a case with the settings of the last attempt of its results; without attempts, return the case itself."""
    if attempts is None or case.accuracy is None:
        return made
    return apply_settings(made, Settings(**attempts["settings"]))


def expected_cost(prepared: Prepared) -> tuple[float, float]:
    """Expected time on one core [s] and memory [byte] of the answer of a prepared case, solved alone."""
    return replace(prepared, methods=frozenset({prepared.answer.name})).cost(prepared.answer)


def refined(
    case: Case, made: Prepared, settings: Settings, part: str, memory: float
) -> tuple[Settings | None, str]:
    """Choose settings with which a source of error is about half as large.

    Parameters
    ----------
    case, made : the case, and the same as prepared on the points of its surface.
    settings : of the last attempt.
    part : name of the part of its budget.
    memory : that an attempt may take, byte.

    Returns the settings and what they change; or None, and why there are none.
    """
    rtol, grid = settings.rtol / 10, settings.grid + 1
    seals = HALVING * (settings.realisations or 0)
    points = as_text(grid_points(made, grid))
    # a setting, its finer value, that as a text, and whether an attempt may have it
    steps: dict[str, tuple[str, Any, str, bool]] = {
        "solver": ("rtol", rtol, f"contact.rtol {rtol:.0e}", rtol >= LEAST_RTOL * (1 - 1e-9)),
        "pixels": ("grid", grid, f"{points} points", grid <= MOST_GRID),
        "realisations": ("realisations", seals, f"{seals} seals", seals <= MOST_SEALS),
    }
    if part not in steps:
        return None, _BY_NOTHING.get(part, "nothing refines it")
    key, value, text, allowed = steps[part]
    if (by := given_settings(case).get(key)) is not None:
        return None, f"{by} is given in the case"
    if not allowed:
        return None, f"{text} is finer than any attempt"
    finer = replace(settings, **{key: value})
    needed = expected_cost(apply_settings(made, finer))[1]
    if needed <= memory:
        return finer, text
    needs, expected = (to_text(size, "B", 3) for size in (needed, memory))
    return None, f"{text} would take about {needs} of memory, expected {expected}"


@dataclass(frozen=True)
class Attempt:
    """One attempt at an accuracy.

    Parameters
    ----------
    settings : with which it was computed.
    points : of the surface.
    seconds : wall time, with the coarser solution that shows the error of its pixels.
    half_width : largest half-width of ln(leakage) of the budget at the loads that count; inf where it has no end.
    limit : the source of error with the widest interval there.
    load : name of the load with the widest interval.
    parts : half-widths of all sources of error at these loads.
    """

    settings: Settings
    points: tuple[int, int]
    seconds: float
    half_width: float
    limit: str
    load: str
    parts: dict[str, float]

    def __str__(self) -> str:
        """Describe the attempt in a line of the log."""
        return (
            f"{self.settings.method} on {as_text(self.points)} points in {self.seconds:.3g} s, within "
            f"{format_deviation(self.half_width)} at {self.load}, limited by {self.limit}"
        )


@dataclass(frozen=True, eq=False)
class RefinedAnswer:
    """Outcome of the attempts: the last of them, the finest in all, prepared and solved.

    Parameters
    ----------
    why : what prevents a further attempt; "" where the accuracy is reached.
    half : what half the error would take.
    wanted : the accuracy.
    limit : of the time, s.
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
        """Warning that the accuracy is not reached, and what limits it."""
        if not self.why:
            return ()
        last, wanted = self.attempts[-1], format_deviation(np.log1p(self.wanted))
        error = f"{format_deviation(last.half_width)} at {last.load}"
        return (
            f"accuracy {wanted} is not reached: the error of the numbers alone may be {error}; {self.why}",
        )

    def as_data(self, budget: ErrorBudget) -> dict[str, Any]:
        """Return the attempts as plain data for the results; None for a number that is infinite or unknown.

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
        return json.loads(json.dumps(found), parse_constant=lambda _: None)


def refine_to_accuracy(case: Case, made: Prepared, run: Run) -> RefinedAnswer:
    """Refine what limits the error of the answer, until the accuracy of the case is reached or cannot be reached.

    Parameters
    ----------
    case, made : the case, and the same as prepared on the points of its surface.
    run : solves the studies. A run that is resumed takes the decisions that it took before.

    Raises FemsealError: the first attempt failed. A later one that fails ends the attempts.
    """
    assert case.accuracy is not None
    goal, most = np.log1p(case.accuracy), case.time_limit or TIME_LIMIT
    # what is free now has the packages in it already
    memory = free_memory() if case.memory is None else case.memory - START_MEMORY
    attempts = _Attempts(case, made, run, memory)
    settings: Settings | None = first_settings(case, made)
    why = text = ""
    while settings is not None:
        try:
            solved = attempts.attempt(settings)
        except NotKept:
            raise
        except FemsealError as error:
            if not attempts.done:
                raise
            why = f"{text} failed: {error}"
            break
        last = attempts.done[-1]
        log.info("attempt %d: %s", len(attempts.done), last)
        if last.half_width <= goal:
            break
        settings, text, why = attempts.next_settings(goal, most)
        log.info("next: %s", text or why)
    done, half = tuple(attempts.done), attempts.half_error()
    return RefinedAnswer(*solved, done, why, half, case.accuracy, most)


@dataclass(eq=False)
class _Attempts:
    """The attempts of a case so far.

    memory : that an attempt may take, byte.
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
        answer, key = prepared.answer, prepared.answer.key
        start = time.perf_counter()
        with self.run.timed(name) as mapper:
            result = prepared.solve(answer, mapper)
        with self.run.timed(f"{name}, error budget") as mapper:
            alone = replace(prepared, methods=frozenset({answer.name}))
            budget = budgets_of(BudgetRequest(alone), {key: result}, mapper)[key]
        seconds = time.perf_counter() - start
        seconds = self.run.decided("time of the attempt", self._so_far, seconds)
        found = widest_band(budget)
        self.done.append(
            Attempt(
                settings=settings,
                points=prepared.scene.surface.shape,
                seconds=seconds,
                half_width=found.half_width,
                limit=found.limit,
                load=prepared.scene.steps[found.step].name,
                parts=found.parts,
            )
        )
        return prepared, result, budget

    def next_settings(self, goal: float, most: float) -> tuple[Settings | None, str, str]:
        """Choose the settings of the next attempt.

        Parameters
        ----------
        goal : wanted half-width of ln(leakage).
        most : time of all attempts, s.

        Returns the settings, what they change, and ""; or None, "", and what prevents the attempt.
        """
        last, text = self.done[-1], ""
        reasons: list[str] = []
        finer: Settings | None = None
        for part in sorted(last.parts, key=lambda name: -last.parts[name]):
            # the others of an accuracy that cannot be reached are refined until they are within it
            if reasons and last.parts[part] <= goal < max(last.parts.values()):
                break
            finer, change = refined(self.case, self.made, last.settings, part, self.memory)
            if finer is None:
                reasons.append(f"{part}: {change}")
                continue
            text = f"{change}, for the error of {part}"
            expected = self._expected_seconds(finer)
            spent = sum(attempt.seconds for attempt in self.done)
            if spent + expected > most:
                late = f"{change} would take about {duration(expected)}, after {duration(spent)}"
                reasons.append(f"{part}: {late}, and the time limit is {duration(most)}")
                finer, text = None, ""
            break
        why = "; ".join(reasons) if finer is None else ""
        return self.run.decided("next attempt", self._so_far, (finer, text, why))

    @property
    def _so_far(self) -> tuple[str, int]:
        """The case and the number of attempts, as plain data."""
        return json.dumps(self.case.echo(), default=str), len(self.done)

    def half_error(self) -> str:
        """Describe what half the error of the last attempt would take."""
        last = self.done[-1]
        finer, change = refined(self.case, self.made, last.settings, last.limit, self.memory)
        if finer is None:
            return f"not possible: {change}"
        return f"{change}, about {duration(self._expected_seconds(finer))}"

    def _expected_seconds(self, settings: Settings) -> float:
        """Estimate the wall time of other settings [s], as a multiple of what the last attempt took."""
        last = self.done[-1]
        seconds, before = (
            expected_cost(apply_settings(self.made, s))[0] for s in (settings, last.settings)
        )
        return last.seconds * seconds / before

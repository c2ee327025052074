"""A run whose case asks for an accuracy: attempts, each of which refines what limits the one before."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.errors import FemsealError, NotKept
from ..base.machine import free_memory
from ..base.stage import Mapper, Stage
from ..base.text import duration, format_deviation
from ..budget import CoarserSolution, ErrorBudget, error_budget, widest_band
from ..preparation.check_memory import START_MEMORY
from ..preparation.settings import Settings, expected_cost, has_windows, settled, time_limit
from ..studies import StochasticResult
from ..studies.scene import Array
from .budgeted import THIRD_GRID_PIXELS, against, budgets_of, filtered_input, leakage_of, removed_octaves, wave_pixels
from .refining import refined

if TYPE_CHECKING:
    from ..case.case import Case
    from ..preparation.preparation import Prepared

log = logging.getLogger("femseal.refinement.attempts")
#: Result of a study by a method, with the studies that are known by name: solve(method, prepared, known, told).
Solve = Callable[[str, "Prepared", Mapping[str, Any], str], Any]


@dataclass(frozen=True)
class Attempt:
    """One attempt at an accuracy.

    settings : with which it was computed. points : of the face. seconds : wall time of its study;
    with_coarse : with that of the coarser one that tells the error of its pixels, where no earlier attempt was that
    one. half_width : largest half-width of ln(leakage) of the budget at the loads that count, inf where it has no end.
    limit : the source of error that is widest there. parts : half-widths of the sources there. load : name of the load
    where it is largest. windows : of the library, None without.
    """

    settings: Settings
    points: tuple[int, int]
    seconds: float
    with_coarse: float
    half_width: float
    limit: str
    load: str
    parts: dict[str, float]
    windows: int | None


@dataclass(frozen=True, eq=False)
class Reached:
    """Outcome of the attempts: the last of them, the finest in all, prepared and solved.

    why : what hinders a further attempt; "" where the accuracy is reached. half : what half the error takes. wanted :
    the accuracy. limit : of the time [s].
    """

    prepared: Prepared
    study: Any
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
        return (f"accuracy {wanted} is not reached: the error may be {error}; {self.why}",)

    def told(self) -> dict[str, Any]:
        """What the results say of the attempts, as plain data; None for a width without end."""
        last = self.attempts[-1]
        return {
            "wanted": self.wanted,
            "reached": not self.why,
            "half_width": _or_none(last.half_width),
            "limit": last.limit,
            "load": last.load,
            "why": self.why,
            "half_error": self.half,
            "time_limit": self.limit,
            "settings": asdict(last.settings),
            "attempts": [_told(attempt) for attempt in self.attempts],
        }


@dataclass(eq=False)
class _Attempts:
    """The attempts of a case so far; leakages by their settings."""

    case: Case
    made: Prepared
    solve: Solve
    mapper: Mapper
    done: list[Attempt] = field(default_factory=list)
    leakages: dict[Settings, Array] = field(default_factory=dict)

    def attempt(self, settings: Settings) -> tuple[Prepared, Any, ErrorBudget]:
        """Solve the case with these settings, and judge its error."""
        number = len(self.done) + 1
        prepared = settled(self.case, self.made, settings)
        start = time.perf_counter()
        study = self._answer(prepared, f"attempt {number}")
        seconds = time.perf_counter() - start
        self.leakages[settings] = leakage_of(study)
        budget = self._budget(prepared, study, f"attempt {number}, error budget")
        times = {"study": seconds, "with coarse": time.perf_counter() - start}
        # a run that goes on has to decide as before
        times = _remembered(self.mapper, "time of the attempt", times)
        windows = study.library.size if isinstance(study, StochasticResult) else None
        self.done.append(_judged(prepared, budget, times["study"], times["with coarse"], windows))
        return prepared, study, budget

    def _answer(self, prepared: Prepared, told: str) -> Any:
        return self.solve(prepared.answer, prepared, {}, told)

    def _budget(self, prepared: Prepared, study: Any, told: str) -> ErrorBudget:
        """The budget of the answer; faces on coarser grids that are known already are not solved again."""
        name = prepared.answer.replace("-", "_")
        # these are compared with more than themselves
        if name == "stochastic" or (name == "two_scale" and prepared.flow == "links"):

            def solve(method: str, other: Prepared, known: Mapping[str, Any]) -> Any:
                return self.solve(method, other, known, told)

            alone = replace(prepared, methods=frozenset({prepared.answer}))
            return budgets_of(alone, {name: study}, solve)[name]
        smooth = filtered_input(prepared, leakage_of(study))
        filtered = None if smooth is None else against(study, smooth, self._answer(smooth, told))
        return error_budget(
            prepared.scene,
            study,
            coarse=self._coarser(prepared, told),
            filtered=filtered,
            octaves=removed_octaves(prepared),
            wave_pixels=wave_pixels(prepared),
        )

    def _coarser(self, prepared: Prepared, told: str) -> list[CoarserSolution]:
        """The same with half the points a side, and with a fourth where that carries the waves and is known already."""
        assert prepared.settings is not None
        found: list[CoarserSolution] = []
        for halvings in (1, 2):
            settings = replace(prepared.settings, grid=prepared.settings.grid - halvings)
            if settings not in self.leakages:
                if halvings > 1 or not has_windows(self.made, settings):
                    break
                coarse = self._answer(settled(self.case, self.made, settings), told)
                self.leakages[settings] = leakage_of(coarse)
            if halvings == 1 or wave_pixels(prepared) >= THIRD_GRID_PIXELS * (1 - 1e-9):
                scene = settled(self.case, self.made, settings).scene
                found.append(CoarserSolution(scene.surface.shape, scene.steps, self.leakages[settings]))
        return found


def reach(case: Case, first: Prepared, solve: Solve, mapper: Mapper) -> Reached:
    """Refine what limits the error of the answer until the accuracy of the case is reached, or cannot be.

    Parameters
    ----------
    first : the case with its first settings, see `preparation.prepare`.
    solve : called as solve(method, prepared, known, told), gives the result of a study; `told` is its name in progress.
    mapper : keeps the decisions where it keeps results, so that a run that goes on decides as before.

    Raises
    ------
    FemsealError : the first attempt failed. One that fails later ends the attempts.
    """
    assert case.accuracy is not None
    assert first.made is not None
    assert first.settings is not None
    goal, most = np.log1p(case.accuracy), time_limit(case)
    # what is free now has the libraries in it already
    memory = free_memory() if case.memory is None else case.memory - START_MEMORY
    attempts = _Attempts(case, first.made, solve, mapper)
    settings: Settings = first.settings
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
        log.info("attempt %d: %s", len(attempts.done), said(last))
        if last.half_width <= goal:
            break
        settings, text, why = _next(attempts, goal, most, memory)
        if why:
            break
        log.info("next: %s", text)
    prepared, study, budget = solved
    half = _half(attempts, memory)
    return Reached(prepared, study, budget, tuple(attempts.done), why, half, case.accuracy, most)


def _next(attempts: _Attempts, goal: float, most: float, memory: float) -> tuple[Settings, str, str]:
    """Settings of the next attempt, what they change, and "" or what hinders it."""
    last = attempts.done[-1]
    change, part = None, ""
    reasons: list[str] = []
    for part in sorted(last.parts, key=lambda name: -last.parts[name]):
        # the others of an accuracy that cannot be reached are refined until they are within it
        if reasons and last.parts[part] <= goal and max(last.parts.values()) > goal:
            break
        found = refined(attempts.case, attempts.made, last.settings, part, memory)
        if found.settings is not None:
            change = found
            break
        reasons.append(f"{part}: {found.text}")
    why = "; ".join(reasons) if change is None else ""
    if change is not None and change.settings is not None:
        expected = _expected(attempts, last, change.settings)
        spent = sum(attempt.with_coarse for attempt in attempts.done)
        if spent + expected > most:
            long = f"{change.text} would take about {duration(expected)}, after {duration(spent)}"
            why = "; ".join([*reasons, f"{part}: {long}, and the time limit is {duration(most)}"])
        text = f"{change.text}, for the error of {part}"
    else:
        text = ""
    # a run that goes on has to decide as before
    decided = _remembered(attempts.mapper, "next attempt", (change and change.settings, text, why))
    return decided[0] or last.settings, decided[1], decided[2]


def _half(attempts: _Attempts, memory: float) -> str:
    """What half the error of the last attempt would take."""
    attempt = attempts.done[-1]
    change = refined(attempts.case, attempts.made, attempt.settings, attempt.limit, memory)
    if change.settings is None:
        return f"cannot be had: {change.text}"
    return f"{change.text}, about {duration(_expected(attempts, attempt, change.settings))}"


def _expected(attempts: _Attempts, attempt: Attempt, settings: Settings) -> float:
    """Expected wall time of other settings, as multiple of what an attempt took [s]."""
    seconds, before = (expected_cost(settled(attempts.case, attempts.made, s))[0] for s in (settings, attempt.settings))
    return attempt.seconds * seconds / before


def settled_as(case: Case, prepared: Prepared, told: dict[str, Any] | None) -> Prepared:
    """The prepared case with the settings of the last attempt of a run; as it is without attempts.

    told : what the results of the run say of its attempts, see `Reached.told`.
    """
    if told is None or prepared.made is None:
        return prepared
    found: dict[str, Any] = told["settings"]
    cells = None if found["cells"] is None else (found["cells"][0], found["cells"][1])
    return settled(case, prepared.made, Settings(**found | {"cells": cells}))


def _judged(
    prepared: Prepared, budget: ErrorBudget, seconds: float, with_coarse: float, windows: int | None
) -> Attempt:
    assert prepared.settings is not None
    found = widest_band(budget)
    return Attempt(
        settings=prepared.settings,
        points=prepared.scene.surface.shape,
        seconds=seconds,
        with_coarse=with_coarse,
        half_width=found.half_width,
        limit=found.limit,
        load=prepared.scene.steps[found.step].name,
        parts=found.parts,
        windows=windows,
    )


def _told(attempt: Attempt) -> dict[str, Any]:
    parts = {name: _or_none(width) for name, width in attempt.parts.items()}
    found = asdict(attempt) | {"points": list(attempt.points), "half_width": _or_none(attempt.half_width)}
    return found | {"parts": parts}


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def said(attempt: Attempt) -> str:
    """An attempt as a line of the log."""
    width = f"within {format_deviation(attempt.half_width)}"
    points = " × ".join(map(str, attempt.points))
    return (
        f"{attempt.settings.method} on {points} points in {attempt.with_coarse:.3g} s, {width} at {attempt.load}, "
        f"limited by {attempt.limit}"
    )


def _remembered(mapper: Mapper, name: str, value: Any) -> Any:
    """The value, or in a run that goes on the one that it had before."""
    (found,) = mapper(Stage(name, _same), [value])
    return found


def _same(value: Any) -> Any:
    return value

"""The planned solutions of a case, each timed and compared with the reference."""

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path

import joblib
import numpy as np

from ..base import Array, FemsealError, InputError, Mapper, made_folder, validate
from ..budget import CoarserSolution, ErrorBudget
from ..case.case import Case, load_case
from ..execution.mappers import ordered_map
from ..execution.run import Progress, no_progress
from ..face.pieces import FEWEST_POINTS
from ..preparation.prepared import Pair, Prepared
from ..studies.compiling import compile_ahead
from ..studies.load_curves import closing_load, leakage_factor
from .accuracy_plan import Plan, Variant, make_plan
from .accuracy_report import AccuracyReport, Comparison, Solution
from .budgets import budget_of, leakage_of
from .coarser import coarser_points, coarser_solutions, without_filtered_waves


def measure_accuracy(
    case: Case | str | PathLike[str],
    output: str | PathLike[str] | None = None,
    workers: int | None = None,
    *,
    limit: float = 600.0,
    memory: float = 4e9,
    announce: Callable[[str], None] | None = None,
    progress: Progress | None = None,
) -> AccuracyReport:
    """Speed against error for a case: time and error with coarser pixels, of the whole face and of drawn seals.

    The scene is solved on its own grid and on two coarser ones of the same surface. Errors are factors of leakage, see
    `leakage_factor`, against the deterministic solution on the scene's own grid.
    Every solution has its error budget, from itself on half the points a side; the cheapest whose measured error and
    budget are within the accuracy of the case, 10 % unless given, is recommended.

    Parameters
    ----------
    case : a `Case`, or the path of a case file.
    output : folder for `accuracy.json`, `accuracy.csv` and `accuracy.png`; None writes nothing.
    workers : processes; all cores unless given.
    limit, memory : a solution expected to take more seconds on one core, or more bytes, is skipped.
    announce : called with each line of the plan, before the first solution.
    progress : called as progress("solutions", done, total).

    Raises
    ------
    InputError : the case or an argument cannot be used, or the reference is not affordable; nothing has
        been computed or written then.
    FemsealError : the reference could not be computed. Other solutions that fail are reported as failed.
    """
    if not isinstance(case, Case):
        case = load_case(case)
    if workers is not None:
        validate.count("workers", workers)
    limit, memory = validate.number("limit", limit, unit="s"), validate.number("memory", memory, unit="byte")
    if output is not None and Path(output).exists() and not Path(output).is_dir():
        raise InputError("output", f"'{output}', which is a file", "a folder, or one that does not exist")
    plan = make_plan(case, limit=limit, memory=memory)
    if output is not None:
        made_folder(output)
    if announce is not None:
        for line in plan.lines():
            announce(line)
    processes = workers or joblib.cpu_count()
    with ordered_map(processes, before=compile_ahead) as mapper:
        report = _measure(plan, processes, mapper, progress or no_progress)
    if output is not None:
        report.write(output)
    return report


def _measure(plan: Plan, workers: int, mapper: Mapper, progress: Progress) -> AccuracyReport:
    """Solve all variants of a plan, coarser pixels first, and compare their leakage with that of the reference."""
    leakages: dict[Variant, Array] = {}
    seconds: dict[Variant, float] = {}
    failures: dict[Variant, tuple[str, ...]] = {}
    budgets: dict[Variant, ErrorBudget] = {}
    progress("solutions", 0, len(plan.variants))
    filtered = _filtered(plan.prepared, mapper)
    # coarser pixels first: they tell the error of finer ones
    order = sorted(plan.variants, key=lambda v: (v.points[0] * v.points[1], v != plan.reference))
    for done, variant in enumerate(order, start=1):
        version = variant.applied(plan.prepared)
        _warm_up(version, workers, mapper)
        start = time.perf_counter()
        result = None
        try:
            result = version.solve(version.answer, mapper)
            leakages[variant], failures[variant] = leakage_of(result), result.failures
        except FemsealError as error:
            if variant == plan.reference:
                raise
            leakages[variant], failures[variant] = np.full(len(version.scene.steps), np.nan), (str(error),)
        seconds[variant] = time.perf_counter() - start
        if result is not None:
            coarse: list[CoarserSolution] = []
            with suppress(FemsealError):  # the budget then says nothing of the pixels
                leakage = partial(_leakage, plan.prepared, mapper=mapper)
                coarse = coarser_solutions(version, _coarser(variant), leakages, leakage)
            budgets[variant] = budget_of(version, result, coarse, filtered)
        progress("solutions", done, len(plan.variants))
    steps, parted = plan.prepared.scene.steps, dict(plan.prepared.scene.parted_steps)
    # those of which the fluid carries all have no leakage
    pressed = [s for s in range(len(steps)) if s not in parted] or [*range(len(steps))]

    def compare(variant: Variant) -> Comparison:
        pair, loads = (leakages[variant][pressed], leakages[plan.reference][pressed]), [steps[s] for s in pressed]
        return Comparison(*(leakage_factor(*pair, loads, branch) for branch in ("loading", "unloading")))

    solutions = [
        Solution(
            variant=variant,
            seconds=seconds[variant],
            expected_seconds=cost[0],
            expected_memory=cost[1],
            leakage=leakages[variant],
            closing_load=closing_load(leakages[variant], steps),
            comparison=compare(variant),
            failures=failures[variant],
            budget=budgets.get(variant),
        )
        for variant, cost in zip(plan.variants, plan.costs, strict=True)
    ]
    return AccuracyReport(plan=plan, solutions=tuple(solutions), workers=workers)


def _coarser(variant: Variant) -> Iterator[tuple[Variant, Pair]]:
    """The variant on half and on a quarter of the points, as far as its pieces allow."""
    m1, m2 = variant.pieces or (1, 1)
    points = variant.points
    while (fewer := coarser_points(points, (FEWEST_POINTS * m1, FEWEST_POINTS * m2))) is not None:
        points = fewer
        yield replace(variant, points=points), points


def _leakage(prepared: Prepared, variant: Variant, mapper: Mapper) -> Array:
    version = variant.applied(prepared)
    return leakage_of(version.solve(version.answer, mapper))


def _filtered(prepared: Prepared, mapper: Mapper) -> CoarserSolution | None:
    """The deterministic solution without the shortest waves, beside that with them; None where none were removed.

    Both are on half the points a side: what removed waves would change is the same for all solutions.
    """
    whole = replace(prepared, cells=None, sampling=None, methods=frozenset({"deterministic"}))
    smooth = without_filtered_waves(whole)
    if smooth is None:
        return None
    shape = smooth.scene.surface.shape
    with_them = replace(smooth, scene=replace(smooth.scene, surface=prepared.scene.surface.resample(shape)))
    own, other = (leakage_of(version.solve(version.answer, mapper)) for version in (with_them, smooth))
    return CoarserSolution(shape, smooth.scene.steps, other, own)


def _warm_up(version: Prepared, workers: int, mapper: Mapper) -> None:
    """Run a load in each process untimed, so that no time includes loading of libraries and planning of FFTs."""
    first = replace(version.scene, loading=version.scene.loading[:workers], unload_from=(), unloading=())
    sampling = version.sampling and replace(version.sampling, realisations=1)
    with suppress(FemsealError):
        replace(version, scene=first, sampling=sampling).solve(version.answer, mapper)

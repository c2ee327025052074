"""Calibrate a case by a leak test: few solved scenes, a surrogate of their leakage, and the posterior."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import qmc

from ..base import (
    AnyPath,
    FemsealError,
    InputError,
    Stage,
    made_folder,
    numerical_versions,
    shown,
    to_si,
    to_text,
    validate,
    write_text,
)
from ..base.leak_units import LeakUnit
from ..case.case import Case
from ..case.reading import load_case, read_case
from ..execution.resuming import begin_run, remove_run, store_folder, writing_in
from ..execution.run import Progress, Run, no_progress, ordered_map
from ..preparation.preparation import prepare
from ..runs import job
from ..runs.forecast import forecast, refuse_too_large
from ..store.store import Store
from ..studies.compiling import compile_ahead
from ..studies.study_registry import usual_efforts
from ..topography import resolved_wave
from .calibration import FILE, Array, Calibration, calibrated_text
from .leak_test import UNITS, LeakTest, Posterior, read_leak_test
from .surrogate import Surrogate

Range = tuple[float | str, float | str]
#: Scenes that fill the ranges, and those that are then added at a time where the posterior is; least number in all.
FIRST, ADDED, FEWEST = 16, 6, 10
#: Factors by which the ranges extend to either side, unless given.
WIDTHS = {"hardness": 3.0, "shortest_wave": 3.0, "factor": 5.0}
#: No more scenes are solved once the surrogate's error is this part of that of the test.
_EXACT = 0.2
#: The calibrated case in the folder.
CASE_FILE = "calibrated.toml"
#: Samples of the posterior between scenes, and at the end.
_SAMPLES = 2**9, 2**12


@validate.removed_arguments(part=job.DIVIDED_BY_DASK)
def calibrate(
    case: Case | AnyPath,
    data: AnyPath,
    output: AnyPath | None = None,
    *,
    hardness: Range | None = None,
    shortest_wave: Range | None = None,
    factor: Range | None = None,
    error: float | str = 0.1,
    scenes: int = 40,
    resume: bool = False,
    replace_results: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Hardness, shortest wave that counts and a factor between model and test, from a measured curve of leakage.

    The case is solved at the loads of the test for up to `scenes` pairs of hardness and shortest wave: a Sobol sequence
    over their ranges, then where the posterior is, see `calibration.surrogate` and `calibration.leak_test`.

    Parameters
    ----------
    case : a case or its file. data : a file with the columns of a leak test, see `calibration.leak_test`.
    output : folder for table, picture, data and, of a case file, the calibrated case; None writes nothing.
    hardness, shortest_wave, factor : ranges of the priors, uniform in the logarithm, in SI or as texts with units;
        unless given, `WIDTHS` times to either side of the case's values (of 1), no wave below 8 pixels.
    error : of a measured leakage, relative standard deviation. scenes : solved at most.
    resume : take the scenes of the folder that were solved for the same case, test and ranges.
    replace_results : begin anew where the folder holds a finished calibration, and replace it.
    workers, scheduler, progress : see `run`.

    Raises
    ------
    InputError : the case, the test, a range or the folder cannot be used; nothing has been computed then.
    FemsealError : too few scenes could be solved.

    Examples
    --------
    >>> found = calibrate("seal.toml", "leak_test.csv", scenes=16)  # doctest: +SKIP
    >>> found.hardness.median, found.factor  # doctest: +SKIP
    """
    folder = job.checked_output(output, resume)
    is_finished = folder is not None and (folder / FILE).exists()
    if is_finished and not resume and not replace_results:
        given = f"'{folder}', which holds a finished calibration"
        expected = (
            "another folder, --resume to go on with its scenes, or --replace (Python: replace_results=True) to begin "
            "anew and replace it"
        )
        raise InputError("output", given, expected)
    loaded = case if isinstance(case, Case) else load_case(case)
    if loaded.accuracy is not None:
        raise InputError("accuracy", loaded.accuracy, "none: every scene is solved alike")
    deviation = validate.tolerance("error", to_si(error, "", "error"))
    validate.count("scenes", scenes, FEWEST)
    test = read_leak_test(Path(data), loaded)
    tested = test.of_case(loaded)
    ranges, memory = _ranges(
        tested, {"hardness": hardness, "shortest_wave": shortest_wave, "factor": factor}
    )
    steps, rows = np.unique(test.rows_of(loaded), return_inverse=True)
    solved = partial(_leakage, tested, test.unit, steps)
    identity = {
        "case": tested.echo(),
        "ranges": ranges.tolist(),
        "steps": steps.tolist(),
        "unit": test.unit.name,
        "content of face files": job.face_files(tested),
        "version": numerical_versions(),
    }
    # a case has no digest, but what its leakage depends on has one
    stage = Stage("scenes", solved, memory, key=("scenes", json.dumps(identity, default=str)))
    progress = progress or no_progress
    with ExitStack() as stack:
        if folder is not None:
            if is_finished and not resume:
                remove_run(folder)
            stack.enter_context(writing_in(made_folder(folder), identity, resume))
            begin_run(folder, identity)
            (folder / FILE).unlink(missing_ok=True)
        mapper = stack.enter_context(
            ordered_map(workers, scheduler, partial(compile_ahead, progress=progress))
        )
        if folder is not None:
            store = stack.enter_context(Store(store_folder(folder)))
            mapper = store.over(mapper)
        mapper = stack.enter_context(Run(mapper, progress).timed("calibration"))
        posterior, points, leakage = _explored(
            partial(mapper, stage), test, rows, ranges, deviation, scenes
        )
        found = Calibration.of(posterior, posterior.samples(_SAMPLES[1]), points, leakage, tested)
        if folder is not None:
            found.write(folder)
            if not isinstance(case, Case):
                write_text(folder / CASE_FILE, calibrated_text(*read_case(case), folder, found))
    return found


def _ranges(case: Case, given: dict[str, Range | None]) -> tuple[Array, float]:
    """Ranges of the three quantities (3, 2) in SI, whose ends are checked, and the memory of a scene [byte].

    Raises InputError: a range that does not rise, a solid that does not yield, or ends with which the case cannot be
    run.
    """
    table = getattr(case, case.softer)
    known = table.solid.hardness
    if known is None or not np.isfinite(known) or table.hardness_table is not None:
        raise InputError(case.softer, "no single hardness", "a yield_stress or a hardness")
    prepared = prepare(case)
    surface, wave = prepared.scene.surface, prepared.conditioning.shortest_wave
    least = {"hardness": 1.01 * prepared.scene.steps.pressures.max(), "factor": 0.0,
             "shortest_wave": resolved_wave(surface.size, surface.shape)}  # fmt: skip
    # two waves in a piece
    sides = [n / (2 * c) for n, c in zip(surface.size, prepared.cells or (1, 1), strict=True)]
    most = {"hardness": np.inf, "factor": np.inf, "shortest_wave": 0.999 * min(sides)}
    found = []
    for (name, unit), middle in zip(UNITS.items(), (known, wave, 1.0), strict=True):
        if (ends := given[name]) is None:
            width = WIDTHS[name]
            ends = max(middle / width, least[name]), min(middle * width, most[name])
        elif isinstance(ends, str) or len(ends) != 2:
            raise InputError(name, shown(ends), "the two ends of a range")
        low, high = (to_si(end, unit, name) if isinstance(end, str) else float(end) for end in ends)
        if not 0 < low < high < np.inf:
            raise InputError(
                name,
                " to ".join(to_text(end, unit) for end in (low, high)),
                "a range above 0 that rises",
            )
        found.append((low, high))
    for corner in product(*found[:2]):
        at = with_values(case, *corner)
        refuse_too_large(at, prepare(at))
    return np.array(found), forecast(
        case, prepared, usual_efforts(len(prepared.scene.steps))
    ).memory


def with_values(case: Case, hardness: float, shortest_wave: float) -> Case:
    """The case with another hardness of the softer solid [Pa] and another shortest wave [m]."""
    key = case.softer
    solid = getattr(case, key).model_copy(update={"hardness": hardness, "yield_stress": None})
    surface = case.surface.model_copy(update={"shortest_wave": shortest_wave})
    return case.model_copy(update={key: solid, "surface": surface})


def _leakage(
    case: Case, unit: LeakUnit, steps: Any, hardness: float, shortest_wave: float
) -> list[float]:
    """Leakage of a scene that decides on classes, at some load steps in a unit; NaN where it could not be solved."""
    log = logging.getLogger("femseal")
    level = log.level
    log.setLevel(logging.ERROR)  # warnings of the case are not said again for each scene
    try:
        results = job.run(with_values(case, hardness, shortest_wave), workers=1)
    except InputError:
        raise
    except FemsealError:
        return [np.nan] * len(steps)
    finally:
        log.setLevel(level)
    values = np.abs(results.class_leakage[0][steps]) / results.class_basis.factor(unit)
    return values.tolist()


def _explored(
    solve: Callable[..., Iterable[list[float]]],
    test: LeakTest,
    rows: Any,
    ranges: Array,
    error: float,
    scenes: int,
) -> tuple[Posterior, Array, Array]:
    """The posterior after scenes that fill the ranges, and others where it is; all scenes, and their leakages.

    solve : gives the leakages (loads,) of scenes at hardnesses and waves in SI, NaN of those that failed.
    """
    low, high = np.log(ranges[:2]).T
    points = np.empty((0, 2))
    leakage = np.empty((0, int(max(rows)) + 1))
    # a power of two, cut where fewer are wanted
    wanted = qmc.Sobol(2, rng=np.random.default_rng(1)).random_base2(int(np.log2(FIRST)))[:scenes]
    while True:
        new = np.array(list(solve(*np.exp(low + wanted * (high - low)).T.tolist())))
        points, leakage = np.r_[points, wanted], np.r_[leakage, new]
        known = np.isfinite(leakage).all(axis=1)
        scenes -= len(wanted)
        if (count := known.sum()) < min(FEWEST, len(wanted)):
            raise FemsealError(f"calibrate: only {count} of {len(wanted)} scenes could be solved")
        surrogate = Surrogate.through(points[known], leakage[known])
        posterior = Posterior(test, list(rows), ranges, surrogate, error)
        cube = posterior.samples(_SAMPLES[0])
        exact = np.median(posterior.curves(cube)[1], axis=0).max() < _EXACT * error
        if scenes <= 0 or exact:
            return posterior, np.exp(low + points * (high - low)), leakage
        # other samples each time
        chosen = len(points) + np.arange(min(ADDED, scenes))
        wanted = cube[chosen % len(cube), :2]

"""Calibrate a case with a leak test: run a few simulations, interpolate between them, and compute the posterior.

A simulation solves the case with a given hardness and a given shortest wave. The argument `scenes` of `calibrate` is
the largest permitted number of simulations.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from ..base import (
    AnyPath,
    Array,
    FemsealError,
    Flags,
    Indices,
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
from ..budget.study_input import StudyInput
from ..case.case import Case
from ..case.reading import load_case, read_case
from ..execution.resuming import begin_run, remove_run, store_folder, writing_in
from ..execution.run import Progress, Run, no_progress, ordered_map
from ..preparation.preparation import prepare
from ..runs import job
from ..runs.forecast import forecast, refuse_too_large
from ..runs.identity import face_files, user_code
from ..store.store import Store
from ..studies.compiling import compile_ahead
from ..topography import resolved_wave
from .calibrated_case import calibrated_text
from .calibration import RESULT_FILE, Calibration
from .leak_test import LeakTest, read_leak_test
from .posterior import QUANTITY_UNITS, Posterior
from .surrogate import Surrogate

#: Ends of a range, in SI or as texts with units.
Range = tuple[float | str, float | str]
#: Number of the first simulations, which cover the ranges evenly; a power of 2, as the Sobol sequence requires.
FIRST_SIMULATIONS = 16
#: Number of simulations that are added in each later round, where the posterior density is large.
ADDED_SIMULATIONS = 6
#: Smallest total number of simulations.
FEWEST_SIMULATIONS = 10
#: Factors by which the default ranges extend above and below the values of the case.
WIDTHS = {"hardness": 3.0, "shortest_wave": 3.0, "factor": 5.0}
#: No more simulations are added if the error of the surrogate is below this fraction of the error of the test.
_SMALL_ERROR = 0.2
#: Name of the calibrated case in the folder.
CASE_FILE = "calibrated.toml"
#: Number of samples of the posterior from which further simulations are chosen.
_SAMPLES_BETWEEN = 2**9
#: Number of samples of the final posterior.
_SAMPLES_AT_END = 2**12


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
    """Estimate hardness, shortest wave and a factor between test and model from a measured leakage curve.

    The shortest wave is the cut-off wavelength of the low-pass filter, which removes all shorter waves. A simulation
    solves the case at the loads of the test, with a given hardness and a given shortest wave. The first simulations
    cover the ranges of hardness and shortest wave evenly (Sobol sequence). Further simulations are added where the
    posterior density is large. See `calibration.surrogate` for the interpolation between simulations, and
    `calibration.posterior` for the posterior.

    Parameters
    ----------
    case : Case or path
        The case or its file.
    data : path
        Text file with the leak test, see `calibration.leak_test`.
    output : path, optional
        Folder for the table, the picture and the data. If the case is a file, the calibrated case is written to this
        folder as well. By default, no files are written.
    hardness, shortest_wave, factor : pair of float or str, optional
        Lower and upper ends of the range of each quantity, in SI units or as strings with units. Within its range, the
        prior of each quantity is uniform in the logarithm of the quantity. The default ranges of hardness and shortest
        wave extend from one third to three times the value of the case. The default range of the factor is from 1/5 to
        5. The range of the shortest wave begins at 8 pixels or above.
    error : float or str
        Relative standard deviation of a measured leakage.
    scenes : int
        Largest permitted number of simulations.
    resume : bool
        Whether to use completed simulations that an earlier calibration with the same case, test and ranges has stored
        in the folder.
    replace_results : bool
        Whether to replace a finished calibration in the folder.
    workers, scheduler, progress
        See `run`.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        The case, the test, a range or the folder cannot be used. The check takes place before any computation.
    FemsealError
        Too few simulations succeeded.

    Examples
    --------
    >>> calibration = calibrate("seal.toml", "leak_test.csv", scenes=16)  # doctest: +SKIP
    >>> calibration.hardness.median, calibration.factor  # doctest: +SKIP
    """
    folder = job.checked_output(output, resume)
    is_finished = folder is not None and (folder / RESULT_FILE).exists()
    if is_finished and not resume and not replace_results:
        given = f"'{folder}', which holds a finished calibration"
        expected = (
            "another folder, --resume to go on with its simulations, or --replace (Python: replace_results=True) to "
            "begin anew and replace it"
        )
        raise InputError("output", given, expected)
    loaded = case if isinstance(case, Case) else load_case(case)
    if loaded.accuracy is not None:
        expected = "none, because all simulations of a calibration use the same grid"
        raise InputError("accuracy", loaded.accuracy, expected)
    relative_error = validate.tolerance("error", to_si(error, "", "error"))
    validate.count("scenes", scenes, FEWEST_SIMULATIONS)
    test = read_leak_test(Path(data), loaded)
    tested_case = test.of_case(loaded)
    given_ranges = {"hardness": hardness, "shortest_wave": shortest_wave, "factor": factor}
    study_input = prepare(tested_case)
    ranges = _ranges(tested_case, study_input, given_ranges)
    _check_corners(tested_case, ranges)
    # `steps` are the load steps that are solved; `rows` is, for each row of the test, the index of its load in `steps`
    steps, rows = np.unique(test.rows_of(loaded), return_inverse=True)
    identity = {
        "case": tested_case.echo(),
        "ranges": ranges.tolist(),
        "steps": steps.tolist(),
        "unit": test.unit.name,
        "content of face files": face_files(tested_case),
        "version": numerical_versions(),
    } | user_code(tested_case)
    # A case has no digest. The key of a stored simulation therefore contains all data on which its leakage depends.
    key = ("scenes", json.dumps(identity, default=str))
    simulate = partial(_simulate, tested_case, test.unit, steps)
    memory = forecast(tested_case, study_input).memory
    stage = Stage("scenes", simulate, memory, key=key)
    report_progress = progress or no_progress
    with ExitStack() as stack:
        if folder is not None:
            if is_finished and not resume:
                remove_run(folder)
            stack.enter_context(writing_in(made_folder(folder), identity, resume))
            begin_run(folder, identity)
            (folder / RESULT_FILE).unlink(missing_ok=True)
        compile_first = partial(compile_ahead, progress=report_progress)
        mapper = stack.enter_context(ordered_map(workers, scheduler, compile_first))
        if folder is not None:
            store = stack.enter_context(Store(store_folder(folder)))
            mapper = store.over(mapper)
        mapper = stack.enter_context(Run(mapper, report_progress).timed("calibration"))
        simulate_all = partial(mapper, stage)
        exploration = _explore(simulate_all, test, rows, ranges, relative_error, scenes)
        samples = exploration.posterior.samples(_SAMPLES_AT_END)
        calibration = Calibration.from_posterior(
            exploration.posterior,
            samples,
            exploration.simulations,
            exploration.leakages,
            tested_case,
        )
        if folder is not None:
            calibration.write(folder, loaded.output.picture_formats)
            if not isinstance(case, Case):
                tables, case_folder = read_case(case)
                text = calibrated_text(tables, case_folder, folder, calibration)
                write_text(folder / CASE_FILE, text)
    return calibration


def _ranges(case: Case, study_input: StudyInput, given: dict[str, Range | None]) -> Array:
    """Return the ranges of hardness, shortest wave and factor in SI units, (3, 2).

    By default, a range extends from the value of the case divided by the factor in `WIDTHS` to the value times this
    factor, as far as the case can be solved.

    Raises
    ------
    InputError
        A range has an upper end that is not above its lower end, or the hardness of the softer solid is not a single
        number.
    """
    hardness = _single_hardness(case)
    surface = study_input.scene.surface
    cells = study_input.cells or (1, 1)
    # a cell must contain two waves
    half_cell = min(side / (2 * count) for side, count in zip(surface.size, cells, strict=True))
    # no pressure may reach the hardness
    highest_pressure = study_input.scene.steps.pressures.max()
    middles = {
        "hardness": hardness,
        "shortest_wave": study_input.conditioning.shortest_wave,
        "factor": 1.0,
    }
    # the factors 1.01 and 0.999 keep a distance from the limits, despite rounding errors
    smallest = {
        "hardness": 1.01 * highest_pressure,
        "shortest_wave": resolved_wave(surface.size, surface.shape),
        "factor": 0.0,
    }
    largest = {
        "hardness": np.inf,
        "shortest_wave": 0.999 * half_cell,
        "factor": np.inf,
    }
    ranges = []
    for name, middle in middles.items():
        ends = given[name]
        if ends is None:
            low = max(middle / WIDTHS[name], smallest[name])
            high = min(middle * WIDTHS[name], largest[name])
        else:
            low, high = _given_ends(name, ends)
        if not 0 < low < high < np.inf:
            unit = QUANTITY_UNITS[name]
            text = f"{to_text(low, unit)} to {to_text(high, unit)}"
            raise InputError(name, text, "two values above 0, the lower one first")
        ranges.append((low, high))
    return np.array(ranges)


def _single_hardness(case: Case) -> float:
    """Return the hardness of the softer solid [Pa]; raise InputError if it is not a single number."""
    table = getattr(case, case.softer)
    if table.coating is not None:
        expected = "a case without a coating on the softer face: only the hardness of a single solid can be calibrated"
        raise InputError(case.softer, "a coating", expected)
    hardness = table.solid.hardness
    if hardness is None or not np.isfinite(hardness) or table.hardness_table is not None:
        raise InputError(case.softer, "no single hardness", "a yield_stress or a hardness")
    return float(hardness)


def _given_ends(name: str, ends: Range) -> tuple[float, float]:
    """Convert both ends of a range given by the user to SI units."""
    if isinstance(ends, str) or len(ends) != 2:
        raise InputError(name, shown(ends), "the lower and the upper end of a range")
    low, high = (
        to_si(end, QUANTITY_UNITS[name], name) if isinstance(end, str) else float(end)
        for end in ends
    )
    return low, high


def _check_corners(case: Case, ranges: Array) -> None:
    """Check that the case can be run at the four corners of the ranges of hardness and shortest wave."""
    hardnesses, waves = ranges[:2].tolist()
    for hardness, wave in product(hardnesses, waves):
        corner = with_values(case, hardness, wave)
        refuse_too_large(corner, prepare(corner))


def with_values(case: Case, hardness: float, shortest_wave: float) -> Case:
    """Return a copy of a case with another hardness of the softer solid [Pa] and another shortest wave [m]."""
    solid_name = case.softer
    changed = {"hardness": hardness, "yield_stress": None}
    solid = getattr(case, solid_name).model_copy(update=changed)
    # if `detrend` is set explicitly, a run does not compute the effect of the form again for every simulation
    treatment = {"shortest_wave": shortest_wave, "detrend": case.surface.detrend}
    surface = case.surface.model_copy(update=treatment)
    return case.model_copy(update={solid_name: solid, "surface": surface})


def _simulate(
    case: Case, unit: LeakUnit, steps: Indices, hardness: float, shortest_wave: float
) -> list[float]:
    """Run one simulation, and return the leakage at some load steps; NaN if the solution failed.

    If the case has a test fluid, the leakage of the test fluid is returned.

    unit : unit of the returned leakages.
    steps : indices of the load steps.
    """
    log = logging.getLogger("femseal")
    level = log.level
    log.setLevel(logging.ERROR)  # the warnings of the case are the same for every simulation
    try:
        results = job.run(with_values(case, hardness, shortest_wave), workers=1)
    except InputError:
        raise
    except FemsealError:
        return [np.nan] * len(steps)
    finally:
        log.setLevel(level)
    leakage = np.abs(results.class_leakage[0][steps]) / results.class_basis.factor(unit)
    return leakage.tolist()


@dataclass(frozen=True)
class _Exploration:
    """The posterior, and the simulations from which the posterior was computed.

    posterior : posterior density.
    simulations : hardness [Pa] and shortest wave [m] of each simulation (simulations, 2).
    leakages : leakage of each simulation at each load (simulations, loads), in the unit of the test; NaN where the
        solution failed.
    """

    posterior: Posterior
    simulations: Array
    leakages: Array


def _explore(
    simulate_all: Callable[..., Iterable[list[float]]],
    test: LeakTest,
    rows: Indices,
    ranges: Array,
    error: float,
    most_simulations: int,
) -> _Exploration:
    """Run simulations that cover the ranges evenly, and then more simulations where the posterior density is large.

    Simulations are added until the surrogate is accurate enough where the posterior density is large, or until no more
    simulations are permitted.

    Parameters
    ----------
    simulate_all : callable
        Function that runs simulations. The arguments of the function are a list of hardnesses [Pa] and a list of
        shortest waves [m], with one value for each simulation. The function yields the leakages (loads,) of each
        simulation.
    test : LeakTest
        The leak test.
    rows : array of int (rows,)
        For each row of the test, the index of its load among the simulated loads.
    ranges : array (3, 2)
        Lower and upper ends of the range of each quantity in SI.
    error : float
        Relative standard deviation of a measured leakage.
    most_simulations : int
        Largest number of simulations.
    """
    low, high = np.log(ranges[:2]).T  # of hardness and shortest wave

    def to_si_units(points: Array) -> Array:
        """Convert points of the unit square (simulations, 2) to hardness [Pa] and shortest wave [m]."""
        return np.exp(low + points * (high - low))

    points = np.empty((0, 2))  # (simulation, quantity), in the unit square
    leakages = np.empty((0, int(max(rows)) + 1))  # (simulation, load)
    sobol = qmc.Sobol(2, rng=np.random.default_rng(1))
    # the first round covers the unit square evenly
    new_points = sobol.random_base2(int(np.log2(FIRST_SIMULATIONS)))[:most_simulations]
    while True:
        # run the simulations of this round, and fit the surrogate to all simulations that succeeded
        hardnesses, waves = to_si_units(new_points).T.tolist()
        new_leakages = np.array(list(simulate_all(hardnesses, waves)))
        points = np.concatenate([points, new_points])
        leakages = np.concatenate([leakages, new_leakages])
        is_solved = np.asarray(np.isfinite(leakages).all(axis=1))
        _check_enough_solved(is_solved, len(new_points))
        surrogate = Surrogate.fit(points[is_solved], leakages[is_solved])
        posterior = Posterior(test, list(rows), ranges, surrogate, error)
        # the accuracy of the surrogate counts where the posterior density is large, that is, at its samples
        samples = posterior.samples(_SAMPLES_BETWEEN)
        surrogate_error = np.median(posterior.predict(samples).deviation, axis=0).max()
        n_left = most_simulations - len(points)
        if n_left <= 0 or surrogate_error < _SMALL_ERROR * error:
            return _Exploration(posterior, to_si_units(points), leakages)
        # The samples are in random order, so that consecutive samples are spread over the whole posterior. The chosen
        # samples begin at the index len(points), which is different in each round.
        chosen = len(points) + np.arange(min(ADDED_SIMULATIONS, n_left))
        new_points = samples[chosen % len(samples), :2]


def _check_enough_solved(is_solved: Flags, n_new: int) -> None:
    """Raise FemsealError if too few simulations succeeded."""
    n_solved = int(is_solved.sum())
    if n_solved < min(FEWEST_SIMULATIONS, n_new):
        raise FemsealError(f"calibrate: only {n_solved} of {n_new} simulations succeeded")

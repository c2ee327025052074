"""Forecast time, memory and disk space of a run before it is started, for `femseal check` and for the report.

The numbers of unknowns, the memory and the disk space follow from the sizes in the case. The computing time is
estimated from the numbers of pixels, load steps and elements, and from speeds measured in other runs. The computing
time is given as a range, because the number of iterations is not known beforehand.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from math import prod

import numpy as np
import psutil

from ..base import InputError, Shape, as_text, counted, duration, free_memory, to_text
from ..base.machine import storing
from ..budget import BudgetRequest, versions_of_budget
from ..case.case import Case
from ..checks import coating_depth_warnings, flow_warnings
from ..contact.workspace import KEPT_POINTS
from ..flow.solvers.choice import elimination_memory
from ..preparation.memory import START_MEMORY
from ..preparation.preparation import Prepared
from ..refinement.refine_to_accuracy import TIME_LIMIT
from ..refinement.settings import first_settings, first_version, grid_points
from ..studies import StudyCost, drop_ratio
from ..studies.face_study import RESULT_BYTES, STATE_BYTES, states_memory
from ..studies.sampling import FEWEST_SEALS, MOST_SEALS, usual_realisations
from ..studies.study_list import names_with
from .case_description import Line, describe_case

#: Time of starting a run, which includes loading compiled loops and reading or generating a face [s].
_START_SECONDS = 2.5
#: Time of writing pictures, report and tables [s].
_PICTURES_SECONDS = 2.4
#: Shortest and longest time of a run, relative to the expected time. Measured: docs/evidence/forecast.md.
_SHORTEST, _LONGEST = 0.4, 2.5
#: Part of `START_MEMORY` that pictures take [byte]. The arrays of contact and flow of a large surface are freed before
#: pictures are drawn, so that this part is not needed in addition. Measured on 2400 × 1800 points: 0.88 GB in all.
_PICTURES_MEMORY = 0.2e9
#: Memory of every further worker process [byte].
_WORKER_MEMORY = 0.25e9
#: Size of the three fields of a pixel in single precision: gap, contact pressure and fluid pressure [byte].
_FIELDS_BYTES = 12.0
#: Size of a cell in `results.nc` and in the mesh of the seal at a load step: ten numbers [byte].
_CELL_BYTES = 80
#: Size of pictures and report together [byte].
_PICTURES_BYTES = 4.5e6


@dataclass(frozen=True)
class Forecast:
    """Expected time and memory of a run.

    Parameters
    ----------
    serial_seconds : float
        Time [s] that the main process takes to start up, draw pictures and write files. It does not depend on the
        number of workers.
    parallel_seconds : float
        Time to solve contact and flow on one core [s]; it is divided by the number of workers. If the case does not fix
        the number of realisations, the run chooses it from their scatter, and `parallel_seconds` is the time for the
        smallest possible number.
    memory : float
        Memory with one worker [byte].
    most_parallel_seconds : float
        Time for the solutions of contact and flow on one core [s], with the largest possible number of realisations.
    most_memory : float
        Memory with one worker [byte] if the flow through the whole surface must be solved by elimination, because
        multigrid does not converge. Elimination takes more memory than multigrid.
    """

    serial_seconds: float
    parallel_seconds: float
    memory: float
    most_parallel_seconds: float
    most_memory: float = 0.0

    def seconds(self, workers: int = 1) -> float:
        """Return the expected time of the run with a given number of workers [s]."""
        return self.serial_seconds + self.parallel_seconds / workers

    def range_seconds(self, workers: int = 1) -> tuple[float, float]:
        """Return the shortest and the longest time that the run is expected to take [s]."""
        most_seconds = self.serial_seconds + self.most_parallel_seconds / workers
        return _SHORTEST * self.seconds(workers), _LONGEST * most_seconds

    def time_text(self, workers: int = 1) -> str:
        """Return the shortest and the longest expected time with a given number of workers, as text.

        Examples
        --------
        >>> forecast = Forecast(
        ...     serial_seconds=10.0, parallel_seconds=90.0, memory=0.0, most_parallel_seconds=90.0
        ... )
        >>> forecast.time_text()
        '40 s to 250 s'
        """
        return " to ".join(duration(seconds) for seconds in self.range_seconds(workers))


def describe(case: Case, original: Prepared) -> list[str]:
    """Describe what a run of a case computes, how long it takes, and how much memory and disk space it needs.

    Parameters
    ----------
    case : Case
        The case.
    original : Prepared
        The prepared case on the grid given in the case. The run may refine this grid to reach the required accuracy.

    Returns
    -------
    list of str
        Lines of text, ending with the warnings.
    """
    return [f"{name:<14} {text}" for name, text in _lines(case, original)]


def _lines(case: Case, original: Prepared) -> Iterator[Line]:
    """Yield the name and the text of each line of the description, see `describe`."""
    prepared = original if case.accuracy is None else first_version(case, original)
    form_effect = original.solve_form_effect()
    yield "case", f"{case.title or '(no title)'}: valid"
    estimate = prepared.estimate()
    yield from describe_case(case, prepared, estimate, form_effect)
    if case.accuracy is not None:
        yield "accuracy", _accuracy_text(case, original)
    budget_versions = budget_inputs(case, prepared)
    if budget_versions:
        states_by_shape = Counter[Shape]()
        for version in budget_versions:
            states_by_shape[version.scene.surface.shape] += _count_face_states(version)
        states = [f"{n} on {as_text(shape)} points" for shape, n in states_by_shape.items()]
        yield "error budget", f"states again, {' and '.join(states)}"
    expected = forecast(case, prepared, budget_versions)
    attempt = "" if case.accuracy is None else "first attempt: "
    yield "expected", f"{attempt}{_time_line(expected)}; {_memory_line(expected)}"
    yield "disk", str(disk_space(case, prepared, budget_versions))
    warnings = [*prepared.warnings, *coating_depth_warnings(prepared.scene, None)]
    if form_effect is not None:
        warnings += form_effect.warnings
    if estimate is not None:
        estimate_warnings = flow_warnings(prepared.scene, estimate.leakage, estimate.mean_gap)
        warnings += [f"by the quick estimate: {text}" for text in estimate_warnings]
    for text in warnings:
        yield "warning", text


def _accuracy_text(case: Case, original: Prepared) -> str:
    """Describe the accuracy that a case requests, the settings of the first attempt, and the time limit."""
    assert case.accuracy is not None
    settings = first_settings(case, original)
    points = as_text(grid_points(original, settings.grid))
    first = f"{points} points, contact.rtol {settings.rtol:.0e}"
    if settings.realisations is not None:
        first += f", {counted(settings.realisations, 'seal')}"
    time_limit = duration(case.time_limit or TIME_LIMIT)
    return (
        f"{100 * case.accuracy:.3g} % for the numerical errors alone, first with {first}; "
        f"then the largest error is reduced again and again, for at most {time_limit}"
    )


def _time_line(expected: Forecast) -> str:
    """Return the expected time on one core, and on all cores of this machine, as text."""
    n_cores = psutil.cpu_count() or 1
    one_core = expected.time_text()
    all_cores = expected.time_text(n_cores)
    text = f"{one_core} on one core, {all_cores} on the {n_cores} of this machine"
    if expected.most_parallel_seconds > expected.parallel_seconds:
        text += f" ({FEWEST_SEALS} to {MOST_SEALS} seals, as many as their scatter asks for)"
    return text


def _memory_line(expected: Forecast) -> str:
    """Return, as text, the expected memory with one worker and for each additional worker."""
    text = f"{expected.memory / 1e9:.1f} GB of memory"
    if expected.most_memory > 1.1 * expected.memory:
        most = f"{expected.most_memory / 1e9:.1f} GB"
        text += f" ({most} if a flow has to be solved by elimination)"
    return f"{text}, and {_WORKER_MEMORY / 1e9:.2g} GB or more for each further worker"


def _count_face_states(prepared: Prepared) -> int:
    """Estimate the number of contact states to be solved for the whole surface."""
    if _stores_states(prepared):
        return len(prepared.scene.steps)
    counts = [
        study.state_count(prepared.scene, prepared.options(study))
        for study in prepared.solved_studies
    ]
    return max(counts)


def forecast(
    case: Case, prepared: Prepared, budget_versions: list[Prepared] | None = None
) -> Forecast:
    """Forecast time and memory of a run.

    Parameters
    ----------
    case : Case
        The case.
    prepared : Prepared
        The prepared case.
    budget_versions : list of Prepared, optional
        Modified cases that the run solves for the error budget; by default the result of `budget_inputs`.
    """
    if budget_versions is None:
        budget_versions = budget_inputs(case, prepared)
    # the costs depend on the memory of the case, because large arrays are stored on disk
    with storing(None, case.memory):
        inputs = [prepared, *budget_versions]
        test_fluid = case.output.test_fluid
        if test_fluid is not None and drop_ratio(test_fluid.state, prepared.scene) is None:
            # the seals of the answer are solved again with the test fluid
            scene = test_fluid.state.in_scene(prepared.scene)
            inputs.append(prepared.only_answer.replaced(scene=scene))
        # if the number of realisations is chosen during the run, it lies between these two numbers
        fewest_costs = _study_costs(inputs, FEWEST_SEALS)
        most_costs = _study_costs(inputs, MOST_SEALS)
    # The studies are solved one after the other, and the working arrays of a study are freed before the next study
    # begins. The memory is therefore determined by the largest study.
    pixels = max(version.scene.surface.heights.size for version in inputs)
    memory = START_MEMORY + max(cost.memory for cost in fewest_costs)
    if pixels > KEPT_POINTS:
        # for large surfaces, the working arrays are freed before the pictures take their part of `START_MEMORY`
        memory -= _PICTURES_MEMORY
    most_memory = memory
    if any(study.solves_whole_surface for study in prepared.studies):
        # the flow through the whole surface may require elimination
        most_memory += elimination_memory(pixels)
    serial_seconds = _START_SECONDS
    if case.output.pictures or case.output.report:
        serial_seconds += _PICTURES_SECONDS
    return Forecast(
        serial_seconds=serial_seconds,
        parallel_seconds=sum(cost.seconds for cost in fewest_costs),
        memory=memory,
        most_parallel_seconds=sum(cost.seconds for cost in most_costs),
        most_memory=most_memory,
    )


def _study_costs(inputs: list[Prepared], realisations: int) -> list[StudyCost]:
    """Estimate the costs of every study of several inputs.

    realisations : number of realisations to assume where an input does not give it.
    """
    costs = []
    for prepared in inputs:
        if prepared.sampling is not None and prepared.sampling.realisations is None:
            prepared = prepared.with_realisations(realisations)
        costs += [prepared.cost(study) for study in prepared.solved_studies]
    return costs


def refuse_too_large(case: Case, original: Prepared) -> None:
    """Raise InputError if a run is expected to need more memory than the case allows, or than is free.

    original : prepared case on the grid given in the case; the run may refine this grid to reach the required accuracy.
    """
    prepared = original if case.accuracy is None else first_version(case, original)
    if case.memory is not None:
        limit = case.memory
        limit_name = "of the key memory"
    else:
        limit = free_memory()
        limit_name = "that are free"
    needed = forecast(case, prepared).memory
    if needed <= limit:
        return
    points = as_text(prepared.scene.surface.shape)
    given = f"a run that takes about {needed / 1e9:.3g} GB, on {points} points"
    method = names_with("solves_whole_surface", False)
    advice = f"fewer surface.points or load steps, or the method {method}, which solves a part of a face at a time"
    if limit <= START_MEMORY:
        advice = f"more than the {START_MEMORY / 1e9:g} GB that any run takes before its work"
    needed_gb = np.ceil(needed / 1e8) / 10  # rounded up to 0.1 GB
    expected = (
        f"at most the {limit / 1e9:.3g} GB {limit_name}: {advice}; "
        f"or memory = '{needed_gb:g} GB' in the case, to run all the same"
    )
    raise InputError("memory", given, expected)


@dataclass(frozen=True)
class DiskSpace:
    """Expected sizes of the files of a run, before compression.

    Parameters
    ----------
    fields : float
        Size of the fields over all pixels [byte].
    stored_steps : int
        Number of load steps whose fields are stored.
    steps : int
        Number of all load steps.
    other_files : float
        Size of all other files of the results [byte].
    checkpoint : float
        Size of temporary files that are deleted at the end of the run [byte]. Temporary files contain the results of
        completed stages, and contact states that do not fit into memory.
    """

    fields: float
    stored_steps: int
    steps: int
    other_files: float
    checkpoint: float

    def __str__(self) -> str:
        """Return the expected size of the files of a run as text."""
        text = f"about {_size_text(self.fields + self.other_files)}"
        if self.fields:
            text += f", of it fields {_size_text(self.fields)} before compression"
            text += f" ({self.stored_steps} of {self.steps} steps, fields_limit)"
        if self.checkpoint:
            text += f"; {_size_text(self.checkpoint)} more while it runs"
        return text


def disk_space(
    case: Case, prepared: Prepared, budget_versions: list[Prepared] | None = None
) -> DiskSpace:
    """Forecast the sizes of the files of a run. See `forecast` for the parameters."""
    if budget_versions is None:
        budget_versions = budget_inputs(case, prepared)
    scene = prepared.scene
    steps = len(scene.steps)
    pixels = prod(scene.surface.shape)
    step_size = _FIELDS_BYTES * pixels
    stored_steps = 0
    has_fields = any(study.has_pixel_fields for study in prepared.studies)
    if case.output.fields and has_fields:
        stored_steps = int(min(case.output.fields_limit // step_size, steps))
    checkpoint = sum(_store_size(version) for version in (prepared, *budget_versions))
    with storing(None, case.memory):
        # contact states that are stored on disk take no memory
        states_are_on_disk = states_memory(pixels, steps) == 0
    if states_are_on_disk and _stores_states(prepared):
        checkpoint += RESULT_BYTES * pixels * steps
    return DiskSpace(
        fields=step_size * stored_steps,
        stored_steps=stored_steps,
        steps=steps,
        other_files=_size_without_fields(case, prepared),
        checkpoint=checkpoint,
    )


def _size_without_fields(case: Case, prepared: Prepared) -> float:
    """Estimate the size of all files in the results folder [byte], except the fields over all pixels."""
    steps = len(prepared.scene.steps)
    # cells and tiles are written to results.nc, and to files for ParaView if they are asked for
    n_files = 1 + (case.output.paraview != "none")
    size = 0.0
    if case.output.pictures or case.output.report:
        size += _PICTURES_BYTES
    if case.output.paraview != "none":
        size += 4.0 * prod(prepared.scene.surface.shape)  # heights in single precision
    size += _CELL_BYTES * steps * prod(prepared.cells or (0, 0)) * n_files
    sampling = prepared.sampling
    if sampling is None:
        return size
    cut, tiles = prepared.cut_and_tiles
    n_seals = sampling.realisations or usual_realisations(cut.shape, tiles)
    # In double precision, for each load step: the leakage of every realisation, and five numbers of every tile of the
    # realisation whose tiles are stored.
    return size + 8.0 * steps * (n_seals + 5 * len(tiles.tile) * n_files)


def budget_inputs(case: Case, prepared: Prepared) -> list[Prepared]:
    """List all modified versions of the input that may be solved for the error budget.

    The run may skip some of them. For example, if a higher hardness hardly changes the leakage, the version with a
    lower hardness is not solved.
    """
    if not case.output.budget:
        return []
    request = BudgetRequest(prepared, case.output.model_parts, case.hardness_tolerance)
    # every version of a prepared case is an instance of `Prepared`, which only type checkers do not know
    return [version for version in versions_of_budget(request) if isinstance(version, Prepared)]


def _stores_states(prepared: Prepared) -> bool:
    """Return whether a study stores the whole-surface contact states of all load steps until it ends."""
    return any(
        study.stores_states(prepared.scene, prepared.options(study))
        for study in prepared.solved_studies
    )


def _store_size(prepared: Prepared) -> float:
    """Estimate the disk space that the stored results of the stages take up during the run [byte]."""
    scene = prepared.scene
    steps = len(scene.steps)
    peaks = len({*scene.unload_from})
    pixels = prod(scene.surface.shape)
    # For each load from which the seal is unloaded, the plastic deformation is stored in double precision, because the
    # unloading begins with this deformation.
    plastic_deformation = 8.0 * pixels  # [byte]
    size = sum(
        study.other_stored_bytes(scene, prepared.options(study))
        for study in prepared.solved_studies
    )
    if _stores_states(prepared):
        size += STATE_BYTES * pixels * steps + plastic_deformation * peaks
    return size


def _size_text(size: float) -> str:
    """Return a size [byte] as text with two significant digits."""
    return to_text(float(f"{size:.1e}"), "B", 3)

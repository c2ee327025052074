"""Forecast time and memory of a run before it is started, for `femseal check` and for the report.

The numbers of unknowns and the memory follow from the sizes in the case. The computing time is estimated from the
numbers of pixels, load steps and elements, and from speeds measured in other runs. The computing time is given as a
range, because the number of iterations is not known beforehand.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..base import InputError, as_text, duration, free_memory
from ..base.shared_arrays import storing
from ..budget import BudgetRequest, versions_of_budget
from ..budget.study_input import StudyInput
from ..case.case import Case
from ..contact.workspace import KEPT_POINTS
from ..flow.solvers.choice import elimination_memory
from ..preparation.memory import START_MEMORY
from ..refinement.settings import first_version
from ..studies import StudyCost, drop_ratio
from ..studies.sampling import FEWEST_BY_DEFAULT, MOST_BY_DEFAULT
from ..studies.study_list import names_with

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
WORKER_MEMORY = 0.25e9


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


def forecast(
    case: Case, study_input: StudyInput, budget_versions: list[StudyInput] | None = None
) -> Forecast:
    """Forecast time and memory of a run.

    Parameters
    ----------
    case : Case
        The case.
    study_input : StudyInput
        The input of the studies.
    budget_versions : list of StudyInput, optional
        Modified cases that the run solves for the error budget; by default the result of `budget_inputs`.
    """
    if budget_versions is None:
        budget_versions = budget_inputs(case, study_input)
    # the costs depend on the memory of the case, because large arrays are stored on disk
    with storing(None, case.memory):
        inputs = [study_input, *budget_versions]
        test_fluid = case.output.test_fluid
        if test_fluid is not None and drop_ratio(test_fluid.state, study_input.scene) is None:
            # the best method solves its seals again with the test fluid
            scene = test_fluid.state.in_scene(study_input.scene)
            inputs.append(replace(study_input.only_answer, scene=scene))
        # if the number of realisations is chosen during the run, it lies between these two numbers
        fewest_costs = _study_costs(inputs, FEWEST_BY_DEFAULT)
        most_costs = _study_costs(inputs, MOST_BY_DEFAULT)
    # The studies are solved one after the other, and the working arrays of a study are freed before the next study
    # begins. The memory is therefore determined by the largest study.
    pixels = max(version.scene.surface.heights.size for version in inputs)
    memory = START_MEMORY + max(cost.memory for cost in fewest_costs)
    if pixels > KEPT_POINTS:
        # for large surfaces, the working arrays are freed before the pictures take their part of `START_MEMORY`
        memory -= _PICTURES_MEMORY
    most_memory = memory
    if any(study.solves_whole_surface for study in study_input.studies):
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


def _study_costs(inputs: list[StudyInput], realisations: int) -> list[StudyCost]:
    """Estimate the costs of every study of several inputs.

    realisations : number of realisations to assume where an input does not give it.
    """
    costs = []
    for study_input in inputs:
        if study_input.sampling is not None and study_input.sampling.realisations is None:
            study_input = study_input.with_realisations(realisations)
        costs += [study_input.cost(study) for study in study_input.solved_studies]
    return costs


def refuse_too_large(case: Case, original: StudyInput) -> None:
    """Raise InputError if a run is expected to need more memory than the case allows, or than is free.

    original : input on the grid given in the case; the run may refine this grid to reach the required accuracy.
    """
    study_input = original if case.accuracy is None else first_version(case, original)
    if case.memory is not None:
        limit = case.memory
        limit_name = "of the key memory"
    else:
        limit = free_memory()
        limit_name = "that are free"
    needed = forecast(case, study_input).memory
    if needed <= limit:
        return
    points = as_text(study_input.scene.surface.shape)
    given = f"a run that takes about {needed / 1e9:.3g} GB, on {points} points"
    method = names_with("solves_whole_surface", False)
    advice = f"fewer surface.points or load steps, or the method {method}, which solves one part of a face at a time"
    if limit <= START_MEMORY:
        advice = f"more than the {START_MEMORY / 1e9:g} GB that any run takes at its start"
    needed_gb = np.ceil(needed / 1e8) / 10  # rounded up to 0.1 GB
    expected = (
        f"at most the {limit / 1e9:.3g} GB {limit_name}: {advice}; "
        f"or memory = '{needed_gb:g} GB' in the case, to run all the same"
    )
    raise InputError("memory", given, expected)


def budget_inputs(case: Case, study_input: StudyInput) -> list[StudyInput]:
    """List all modified versions of the input that may be solved for the error budget.

    The run may skip some of them. For example, if a higher hardness hardly changes the leakage, the version with a
    lower hardness is not solved.
    """
    if not case.output.budget:
        return []
    request = BudgetRequest(study_input, case.output.model_parts, case.hardness_tolerance)
    return versions_of_budget(request)

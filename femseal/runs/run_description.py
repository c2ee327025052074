"""Describe a run before it is started: what it computes, how long it takes, and how much memory and disk it needs."""

from collections import Counter
from collections.abc import Iterator

import psutil

from ..base import Shape, as_text, counted, duration
from ..budget.study_input import StudyInput
from ..case.case import Case
from ..checks import coating_depth_warnings, flow_warnings
from ..refinement.refine_to_accuracy import TIME_LIMIT
from ..refinement.settings import first_settings, first_version, grid_points
from ..studies.sampling import FEWEST_BY_DEFAULT, MOST_BY_DEFAULT
from .case_description import Line, describe_case
from .disk_space import disk_space, stores_states
from .forecast import WORKER_MEMORY, Forecast, budget_inputs, forecast


def describe(case: Case, original: StudyInput) -> list[str]:
    """Describe what a run of a case computes, how long it takes, and how much memory and disk space it needs.

    Parameters
    ----------
    case : Case
        The case.
    original : StudyInput
        The input on the grid given in the case. The run may refine this grid to reach the required accuracy.

    Returns
    -------
    list of str
        Lines of text, ending with the warnings.
    """
    return [f"{name:<14} {text}" for name, text in _lines(case, original)]


def _lines(case: Case, original: StudyInput) -> Iterator[Line]:
    """Yield the name and the text of each line of the description, see `describe`."""
    study_input = original if case.accuracy is None else first_version(case, original)
    form_effect = original.solve_form_effect()
    yield "case", f"{case.title or '(no title)'}: valid"
    estimate = study_input.estimate()
    yield from describe_case(case, study_input, estimate, form_effect)
    if case.accuracy is not None:
        yield "accuracy", _accuracy_text(case, original)
    budget_versions = budget_inputs(case, study_input)
    if budget_versions:
        states_by_shape = Counter[Shape]()
        for version in budget_versions:
            states_by_shape[version.scene.surface.shape] += _count_face_states(version)
        states = [f"{n} on {as_text(shape)} points" for shape, n in states_by_shape.items()]
        yield "error budget", f"states again, {' and '.join(states)}"
    expected = forecast(case, study_input, budget_versions)
    attempt = "" if case.accuracy is None else "first attempt: "
    yield "expected", f"{attempt}{_time_line(expected)}; {_memory_line(expected)}"
    yield "disk", str(disk_space(case, study_input, budget_versions))
    warnings = [*study_input.warnings, *coating_depth_warnings(study_input.scene, None)]
    if form_effect is not None:
        warnings += form_effect.warnings
    if estimate is not None:
        estimate_warnings = flow_warnings(study_input.scene, estimate.leakage, estimate.mean_gap)
        warnings += [f"by the quick estimate: {text}" for text in estimate_warnings]
    for text in warnings:
        yield "warning", text


def _accuracy_text(case: Case, original: StudyInput) -> str:
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
        text += f" ({FEWEST_BY_DEFAULT} to {MOST_BY_DEFAULT} seals, depending on their scatter)"
    return text


def _memory_line(expected: Forecast) -> str:
    """Return, as text, the expected memory with one worker and for each additional worker."""
    text = f"{expected.memory / 1e9:.1f} GB of memory"
    if expected.most_memory > 1.1 * expected.memory:
        most = f"{expected.most_memory / 1e9:.1f} GB"
        text += f" ({most} if a flow has to be solved by elimination)"
    return f"{text}, and {WORKER_MEMORY / 1e9:.2g} GB or more for each further worker"


def _count_face_states(study_input: StudyInput) -> int:
    """Estimate the number of contact states to be solved for the whole surface."""
    if stores_states(study_input):
        return len(study_input.scene.steps)
    counts = [
        study.state_count(study_input.scene, study_input.options(study))
        for study in study_input.solved_studies
    ]
    return max(counts)

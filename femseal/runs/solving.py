"""Solve the studies of a case, its test fluid and its error budgets, and assemble the results."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from ..budget import BudgetRequest, ErrorBudget, budgets_of
from ..budget.study_input import StudyInput
from ..case.case import Case
from ..checks import FormEffect, flow_warnings
from ..execution.run import Run
from ..refinement.refine_to_accuracy import RefinedAnswer, refine_to_accuracy
from ..results import Results, RunFacts, assemble
from ..studies import FluidState, OtherLeakage, StudyResult, drop_ratio
from .case_description import describe_case, solids_text
from .identity import chosen_settings

log = logging.getLogger("femseal")


@contextmanager
def _interrupts() -> Iterator[None]:
    """Convert the SystemError that Numba raises on Ctrl-C in compiled code back to a KeyboardInterrupt."""
    try:
        yield
    except SystemError as error:
        cause: BaseException | None = error
        while isinstance(cause, SystemError):
            cause = cause.__cause__
        if isinstance(cause, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        raise


@_interrupts()
def solve_case(case: Case, original: StudyInput, faces: dict[str, str], run: Run) -> Results:
    """Solve the studies of a case, its test fluid and its error budget, and assemble the results.

    Parameters
    ----------
    case : Case
        The case.
    original : StudyInput
        The input on the grid given in the case. The run may refine this grid to reach the required accuracy.
    faces : dict of str
        SHA-256 digest of each input file, by the path of the file, see `face_files`.
    run : Run
        Run that computes the stages.
    """
    log.info("case %s: surface %s", case.title or "without title", original.scene.surface)
    form_effect = original.solve_form_effect()
    solved = _solve_studies(case, original, run)
    study_input, refined, studies = solved.study_input, solved.refined, solved.studies
    answer = studies[study_input.answer.key]
    warnings = study_input.warnings
    if form_effect is not None:
        warnings += tuple(form_effect.warnings)
    test = None
    if case.output.test_fluid is not None:
        state = case.output.test_fluid.state
        test = _solve_test_fluid(state, study_input, answer, run)
        tested_scene = state.in_scene(study_input.scene)
        texts = flow_warnings(tested_scene, test.leakage, answer.surface_gap)
        warnings += tuple(f"Test fluid: {text}" for text in texts)
    # the budget comes last, so that it can be switched on or off before a run is resumed
    budgets = _solve_budgets(case, solved, form_effect, run)
    description = [*describe_case(case, study_input, answer.quick_estimate, form_effect)]
    attributes = {
        "seat": study_input.seat,
        "face_files": json.dumps(faces),
        "timed_parts": json.dumps(run.parts),
        "solids": solids_text(case),
        "description": json.dumps(description, ensure_ascii=False),
        "chosen": json.dumps(chosen_settings(case, original)),
    }
    if refined is not None:
        warnings += refined.warnings
        attributes["accuracy"] = json.dumps(refined.as_data(budgets[study_input.answer.key]))
    facts = RunFacts(
        case=case.echo(),
        surface=study_input.surface_report,
        timings=run.timings,
        quantiles=case.stochastic.quantiles if case.stochastic else (0.05, 0.95),
        warnings=warnings,
        budgets=budgets,
        test=test,
        valve=case.output.valve,
        attributes=attributes,
        **case.output.model_dump(
            include={"leakage_unit", "classes", "nominal_diameter", "throughput_temperature"}
        ),
    )
    results = assemble(study_input.scene, *studies.values(), facts=facts)
    for text in [*results.warnings, *results.failures]:
        log.warning("%s", text)
    return results


@dataclass(frozen=True, eq=False)
class _SolvedStudies:
    """Results of the studies of a case.

    Attributes
    ----------
    study_input : StudyInput
        The input with which the studies were solved.
    studies : dict of StudyResult
        Result of each study, by the key of the study.
    refined : RefinedAnswer or None
        Attempts to reach the accuracy of the case; None if the case requests no accuracy.
    """

    study_input: StudyInput
    studies: dict[str, StudyResult]
    refined: RefinedAnswer | None


def _solve_studies(case: Case, original: StudyInput, run: Run) -> _SolvedStudies:
    """Solve all studies of a case. If the case has an accuracy, the best study is refined first."""
    study_input = original
    refined: RefinedAnswer | None = None
    studies: dict[str, StudyResult] = {}
    if case.accuracy is not None:
        refined = refine_to_accuracy(case, original, run)
        study_input = refined.study_input
        studies[study_input.answer.key] = refined.result
    for study in study_input.solved_studies:
        if study.key not in studies:
            with run.timed(study.name) as mapper:
                studies[study.key] = study_input.solve(study, mapper)
    for study in study_input.studies:
        contained = study.contained
        if contained in study_input.studies:
            studies[contained.key] = study.contained_result(studies[study.key])
    return _SolvedStudies(study_input, studies, refined)


def _solve_test_fluid(
    state: FluidState, study_input: StudyInput, answer: StudyResult, run: Run
) -> OtherLeakage:
    """Compute the leakage of the test fluid through the same seals, by the best method of the run.

    If both fluids see the same permeability, the leakage of the service fluid is scaled by the ratio of the two
    potential drops. If the permeability depends on the fluid, the best method is run again with the test fluid.

    answer : result of the best method for the service fluid.
    """
    ratio = drop_ratio(state, study_input.scene)
    if ratio is not None:
        return OtherLeakage.of_study(state, answer, ratio)
    same_seals = study_input
    if answer.realisation_count is not None:
        same_seals = study_input.with_realisations(answer.realisation_count)
    tested = replace(same_seals, scene=state.in_scene(study_input.scene))
    with run.timed("test fluid") as mapper:
        return OtherLeakage.of_study(state, tested.solve(tested.answer, mapper))


def _solve_budgets(
    case: Case, solved: _SolvedStudies, form_effect: FormEffect | None, run: Run
) -> dict[str, ErrorBudget]:
    """Make the error budget of each study, by the key of the study; empty if the case wants none."""
    if not case.output.budget:
        return {}
    study_input, refined = solved.study_input, solved.refined
    known_budgets = {} if refined is None else {study_input.answer.key: refined.budget}
    request = BudgetRequest(
        study_input,
        case.output.model_parts,
        case.hardness_tolerance,
        hardness_over_yield=case.hardness_over_yield,
        form_effect=form_effect,
    )
    with run.timed("error budget") as mapper:
        return budgets_of(request, solved.studies, mapper, known_budgets)

"""Make the error budgets of a run from the list of error sources."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..base import Mapper
from ..studies import StudyResult
from .error_parts import ErrorBudget
from .estimates import NumericalErrors
from .evaluation import BudgetRequest, Evaluation
from .sources import SOURCES
from .study_input import StudyInput


def versions_of_budget(request: BudgetRequest) -> list[StudyInput]:
    """List all versions of the input that an error budget may solve in addition to the run."""
    wanted = [source for source in SOURCES if source.is_wanted(request)]
    versions = [version for source in wanted for version in source.versions(request)]
    return [version for version in versions if version is not None]


def budgets_of(
    request: BudgetRequest,
    studies: Mapping[str, StudyResult],
    mapper: Mapper,
    known: Mapping[str, ErrorBudget] | None = None,
) -> dict[str, ErrorBudget]:
    """Make the error budget of every study of a run.

    Parameters
    ----------
    request : input of the run and the options of its error budget.
    studies : results of the studies, by the key of the study.
    mapper : function like the builtin `map` that computes the items of a stage, for example in several processes.
    known : error budgets that already contain the numerical errors, by the key of the study. Numerical errors of the
        studies in `known` are not estimated again.

    Returns the error budget of each study, by the key of the study.
    """
    known_budgets = known or {}
    evaluation = Evaluation(request, mapper)
    budgets = dict(known_budgets)
    for source in SOURCES:
        if not source.is_wanted(request):
            continue
        for key, result in studies.items():
            if not source.of_model and key in known_budgets:
                continue
            if key not in budgets:
                errors = NumericalErrors(request.version.scene, result)
                budgets[key] = errors.budget_of([])
            budget = budgets[key]
            parts = [
                replace(part, of_model=source.of_model)
                for part in source.parts(evaluation, result, budget)
                if part is not None
            ]
            budgets[key] = replace(budget, parts=(*budget.parts, *parts))
    return budgets

"""The list of error sources: run and forecast solve the same versions, each once, and rows come in its order."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import SWEPT

import femseal as fs
from femseal.budget import (
    SOURCES,
    BudgetRequest,
    budgets_of,
    evaluation,
    versions_of_budget,
)
from femseal.case.output_table import OutputTable
from femseal.preparation import prepare
from femseal.runs.forecast import budget_inputs


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "case.toml"
    text = SWEPT.replace("budget = false", "")
    path.write_text(text.replace('method = "stochastic"', 'method = "deterministic"'))
    return fs.load_case(path)


def test_a_case_can_select_every_source_of_the_model_and_no_other():
    names = [source.name for source in SOURCES]
    assert len({*names}) == len(names)
    choices = OutputTable.model_json_schema()["properties"]["model_parts"]["items"]["enum"]
    assert choices == [source.name for source in SOURCES if source.of_model]
    assert OutputTable().model_parts == tuple(choices)


def test_a_run_solves_what_its_forecast_counts_and_each_version_once(case, monkeypatch):
    prepared = prepare(case)
    request = BudgetRequest(prepared, case.output.model_parts, case.hardness_tolerance)
    studies = {study.key: prepared.solve(study, map) for study in prepared.solved_studies}
    solved = []
    plain = evaluation.solved_version

    def counted(version, mapper):
        solved.append(version)
        return plain(version, mapper)

    monkeypatch.setattr(evaluation, "solved_version", counted)
    (budget,) = budgets_of(request, studies, map).values()
    expected = versions_of_budget(request)
    assert len({id(version) for version in solved}) == len(solved)
    assert {id(version) for version in solved} <= {id(version) for version in expected}
    shapes = [version.scene.surface.shape for version in budget_inputs(case, prepared)]
    assert shapes == [version.scene.surface.shape for version in expected]
    assert [part.name for part in budget.parts][:2] == ["solver", "pixels"]
    # the parts of the numbers are those of `error_budget`
    numbers = budgets_of(replace(request, model_parts=()), studies, map)
    (alone,) = numbers.values()
    assert_allclose(alone.upper, budget.numerical.upper)
    assert np.isfinite(alone.upper).all()

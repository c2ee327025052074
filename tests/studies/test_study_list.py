"""Studies are registered once: solved by name they are what their functions give, and each knows what it answers."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from small_cases import steel_scene

import femseal as fs
from femseal.base.fields import STEP, declared
from femseal.face.cell_flow import SolveCounts
from femseal.results import assemble
from femseal.studies import (
    STUDIES,
    Sampling,
    Study,
    StudyOptions,
    SurfaceResult,
    study_of_result,
)
from femseal.studies.block_division import blocks_of
from femseal.topography import self_affine

CELLS = (4, 4)
SAMPLING = Sampling(length=200e-6, realisations=3, seed=1)


def test_a_registered_study_is_what_its_function_gives():
    face = self_affine((48, 48), (48e-6, 48e-6), hurst=0.8, rms_slope=0.2, roll_off=24e-6, rng=3)
    scene, options = steel_scene(face, loading=(1e8, 3e8)), StudyOptions(CELLS, SAMPLING)
    known = replace(options, surface_is_solved=True)
    own = {
        "deterministic": fs.deterministic(scene),
        "two-scale": fs.two_scale(scene, CELLS),
        "blocks": fs.by_blocks(scene, blocks_of(CELLS)),
        "stochastic": fs.stochastic(scene, CELLS, SAMPLING),
    }
    for name in own:
        study = STUDIES[name]
        result = study.solve(scene, options, map)
        assert study_of_result(result) is study
        assert study_of_result(own[name]) is study
        np.testing.assert_array_equal(result.predicted_leakage, own[name].predicted_leakage)
        seconds, memory = study.cost(scene, options)
        assert 0 < seconds < 3600
        assert 0 < memory < 1e9
        assert study.cost(scene, known)[0] < seconds or name in ("deterministic", "blocks")


@dataclass(frozen=True, repr=False)
class UniformGapResult(SurfaceResult):
    steps: Any
    leakage: Any
    gap: Any = declared("uniform_gap", "m", "gap of the same volume", STEP)
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    method: ClassVar[str] = "uniform-gap"
    cells = patches = patch_state = quick_estimate = None


class UniformGapStudy(Study):
    """The leakage of a surface whose gap is everywhere its mean."""

    name = "uniform-gap"
    needs_cells = False

    def solve(self, scene, options, mapper):
        gap = np.array([*scene.contact_states(mean_gap, mapper=mapper)])
        return UniformGapResult(scene.steps, scene.unit_leakage * gap**3 / 12, gap)


def mean_gap(state):
    return state.contact.gap.mean()


def test_a_study_is_one_class_and_one_entry(monkeypatch):
    """Dataset, table, error budget and picture need no further code."""
    monkeypatch.setitem(STUDIES, "uniform-gap", UniformGapStudy())
    face = self_affine((32, 32), (32e-6, 32e-6), hurst=0.8, rms_slope=0.2, roll_off=24e-6, rng=3)
    scene = steel_scene(face, loading=(1e8, 3e8))
    result = STUDIES["uniform-gap"].solve(scene, StudyOptions(), map)
    whole = fs.deterministic(scene)
    np.testing.assert_allclose(result.leakage, whole.open_leakage(scene), rtol=1e-9)
    results = assemble(scene, result, whole)
    assert results.method == "uniform-gap"
    np.testing.assert_array_equal(results.leakage, result.leakage)
    np.testing.assert_array_equal(results.dataset["uniform_gap"], result.gap)
    assert "uniform-gap" in results.table()._repr_html_()
    assert [part.name for part in fs.error_budget(scene, result).parts] == ["solver"]
    assert result.plot().axes
    at_one_load = steel_scene(face, loading=(1e8,))
    assert dict(STUDIES["uniform-gap"].description(at_one_load, StudyOptions())) == {
        "uniform-gap": "1 load step"
    }
    assert result.solve_counts == SolveCounts()
    # cells without declared fields add nothing
    monkeypatch.setattr(UniformGapResult, "cells", SolveCounts())
    assert set(assemble(scene, result, whole).dataset) == set(results.dataset)

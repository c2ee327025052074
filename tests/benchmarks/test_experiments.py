"""The experiments of others are read as they stand, and a fit by the loading finds the face that made it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import experiments

pytestmark = pytest.mark.slow


@pytest.fixture
def granite():
    lines = [line for line in experiments.measured("granite_cycles") if line["specimen"] == "p5607"]
    return experiments.Cycle.of(lines, "sigma_eff", "k")


def test_a_fit_of_the_loading_finds_the_face_that_made_it(granite, monkeypatch):
    monkeypatch.setattr(experiments, "POINTS", 64)
    experiments.face.cache_clear()
    experiments.branch.cache_clear()
    loads = np.geomspace(0.01, 0.1, 5)
    (up, down), _ = experiments.cycle(granite, 1, float(loads[2]), 5.0, experiments.HALF)
    made = replace(granite, values=3.0 * up, unloaded=3.0 * down)
    fit = experiments.fitted(made, 1, loads, [5.0, 50.0], 1, experiments.HALF)
    assert (fit.load, fit.hardness) == (float(loads[2]), 5.0)
    assert fit.error < 1e-12
    assert_allclose(np.exp(fit.factor), 3.0)
    # plastic points keep what they lost; hard ones do not
    assert (down < 0.9 * np.interp(granite.unloads, granite.loads, up)).all()
    experiments.face.cache_clear()
    experiments.branch.cache_clear()


def test_closure_of_a_face_and_a_rock_comes_apart_again(granite):
    gaps = (np.array([5.0, 4.0, 3.5, 3.2, 3.0]), np.array([3.1, 3.2, 3.4, 3.9]))
    up, down = (
        2.0 * (5.0 - gap) + 3.0 * (p - 0.5)
        for gap, p in zip(gaps, (granite.loads, granite.unloads), strict=True)
    )
    fitted_up, fitted_down, length, compliance = experiments.closures(gaps, up, down, granite)
    assert_allclose((length, compliance), (2.0, 3.0))
    assert_allclose(fitted_up, up, atol=1e-12)
    assert_allclose(fitted_down, down, atol=1e-12)

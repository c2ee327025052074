"""The surrogate of the leakage: exact at its scenes, near between them."""

import numpy as np
from numpy.testing import assert_allclose
from scipy.stats import qmc

from femseal.calibration.surrogate import Surrogate

POINTS = qmc.Sobol(2, rng=1).random_base2(6)


def steep(points):
    """A leakage that falls along the first axis and is sealed where it would be small."""
    value = np.exp(-2 + 6 * points[:, :1] + points[:, :1] ** 2 - np.sin(3 * points[:, 1:]))
    return np.c_[value, np.where(value > 0.3, value, 0.0)]


def test_a_surrogate_is_exact_at_its_scenes_and_near_between_them():
    found = Surrogate.fit(POINTS, steep(POINTS))
    mean, _, is_open = found.predict(POINTS)
    # of values in their standard deviations, rounding is 5e-4
    assert_allclose(mean[:, 0], np.log(steep(POINTS)[:, 0]), atol=3e-3)
    assert_allclose(is_open[:, 1] > 0.5, steep(POINTS)[:, 1] > 0)
    between = np.random.default_rng(0).random((300, 2))
    truth = steep(between)
    mean, deviation, is_open = found.predict(between)
    assert np.abs(mean[:, 0] - np.log(truth[:, 0])).max() < 0.05
    assert np.mean(np.abs(mean[:, 0] - np.log(truth[:, 0])) < 3 * deviation[:, 0] + 1e-3) > 0.95
    assert np.mean((is_open[:, 1] > 0.5) == (truth[:, 1] > 0)) > 0.95
    assert is_open[:, 0].min() > 0.99


def test_a_load_at_which_few_scenes_are_open_is_unknown():
    leakage = np.zeros((len(POINTS), 1))
    leakage[:2] = 1.0
    _, deviation, is_open = Surrogate.fit(POINTS, leakage).predict(POINTS)
    assert deviation.min() > 10
    assert is_open[2:].max() < 0.5

"""The posterior: linear regression in closed form, rows below the limit, and coverage of its regions."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import binom, norm, qmc

from femseal.base.leak_units import leak_unit
from femseal.calibration.leak_test import LeakTest
from femseal.calibration.posterior import Estimate, Posterior
from femseal.calibration.surrogate import Surrogate
from femseal.loads import LoadStep

RANGES = np.array([[1.0, np.e], [1.0, np.e], [np.exp(-1.0), np.e]])


class Line:
    """A surrogate that is known: ln(leakage) falls with the first axis, twice as much at the second load."""

    correlation = np.eye(3)

    def predict(self, points):
        mean = -np.outer(points[:, 0], [1.0, 2.0, 4.0])
        return mean, np.zeros_like(mean), np.ones_like(mean) - 1e-9


def posterior(leakage, sealed=(False, False, False), surrogate=None, error=0.05):
    steps = tuple(LoadStep(1e8 * (n + 1)) for n in range(len(leakage)))
    test = LeakTest(steps, np.array(leakage, dtype=float), np.array(sealed), leak_unit("m²/s"))
    return Posterior(test, list(range(len(leakage))), RANGES, surrogate or Line(), error)


def log_density(posterior, cube):
    """ln of the density of a calibration in the unit cube (n, 3), but for a constant (n,)."""
    factor = np.log(posterior.quantities(cube)[:, 2:])
    return posterior.factor_density(cube[:, :2]).log_density(factor)[:, 0]


def test_a_posterior_of_a_linear_model_is_that_of_linear_regression():
    matrix = np.array([[-1.0, 1.0], [-2.0, 1.0], [-4.0, 1.0]])
    measured = matrix @ [0.5, 0.3] + 0.05 * np.random.default_rng(3).standard_normal(3)
    found = posterior(np.exp(measured))
    samples = np.log(found.quantities(found.samples(2**14)))
    known, other = samples[:, [0, 2]], samples[:, 1]
    covariance = np.linalg.inv(matrix.T @ matrix) * 0.05**2
    assert_allclose(known.mean(0), covariance @ matrix.T @ measured / 0.05**2, atol=0.005)
    assert_allclose(np.cov(known.T), covariance, rtol=0.15)
    assert_allclose([other.mean(), other.std()], [0.5, 12**-0.5], atol=0.03)


def test_a_row_below_the_limit_is_known_to_leak_less():
    cube = np.array([[0.5, 0.5, 0.5], [0.9, 0.5, 0.5]])
    leakage = [np.exp(-0.5), np.exp(-1.0), np.exp(-3.0)]
    found = log_density(posterior(leakage, (False, False, True), error=0.5), cube)
    # of two measured loads and one below exp(−3), by the normal distribution
    measured = [norm.logpdf([-0.5, -1.0], [-x, -2 * x], 0.5).sum() for x in (0.5, 0.9)]
    below = [norm.logcdf(-3.0, -4 * x, 0.5) for x in (0.5, 0.9)]
    assert_allclose(np.diff(found), np.diff(np.add(measured, below)), rtol=1e-4)


def channels(rng):
    """Leakage at five loads of a channel whose gap closes with load, opens with the first quantity, and jumps along the other."""
    patches, jumps = rng.random(10), 0.06 * rng.standard_normal((10, 1)) * [0.5, 0.8, 1.0, 1.2, 1.2]
    jumps += 0.02 * rng.standard_normal(jumps.shape)

    def leakage(points):
        closing = 0.8 + 0.7 * points[:, :1] ** 0.8 - 0.22 * np.arange(5)
        return np.maximum(closing + (points[:, 1:] > patches) @ jumps, 0.0) ** 3

    return leakage


@pytest.mark.parametrize("n_tests", [12, pytest.param(40, marks=pytest.mark.slow)])
def test_regions_hold_the_truth_as_often_as_they_say(n_tests):
    levels = []
    for seed in range(n_tests):
        rng = np.random.default_rng(seed)
        leakage, truth = channels(rng), rng.random(3)
        points = qmc.Sobol(2, rng=rng).random_base2(4)
        factor = np.exp(2 * truth[2] - 1 + 0.05 * rng.standard_normal(5))
        measured = leakage(truth[None, :2])[0] * factor
        surrogate = Surrogate.fit(points, leakage(points))
        found = posterior(np.maximum(measured, 1e-4), measured < 1e-4, surrogate)
        samples = log_density(found, found.samples(2**8))
        levels.append(np.mean(samples < log_density(found, truth[None])))
    for region in (0.9, 0.5):
        n_held = np.sum(np.array(levels) > 1 - region)
        assert binom.ppf(0.005, n_tests, region) <= n_held <= binom.ppf(0.995, n_tests, region)


def test_a_region_is_the_shortest_interval():
    found = Estimate.from_samples(np.exp(np.random.default_rng(0).exponential(size=40_000)))
    assert_allclose(
        np.log([found.median, found.lower, found.upper]), [np.log(2), 0, np.log(10)], atol=0.05
    )

"""Persson's theory: contact area in closed form and as a series, and the critical junction."""

from math import pi

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import erf

from femseal.persson import critical_junction, persson_area

WAVES = np.geomspace(1e4, 1e6, 40)


POWERS = 1e-12 * (WAVES / WAVES[0]) ** -1.6


def test_area_of_elastic_solids():
    load = np.geomspace(1e-3, 3, 20)
    assert_allclose(persson_area(load, 0.5), erf(np.sqrt(2) * load), rtol=1e-14)
    assert_allclose(persson_area(load, 0.5, 1e3), persson_area(load, 0.5), rtol=1e-12)
    assert persson_area(1.0, 0.0) == 1


@pytest.mark.parametrize("spread", [0.03, 0.3, 1.0, 10.0, 1e6])
def test_area_with_a_hardness_is_that_of_the_sine_series(spread):
    p = np.linspace(0.01, 0.99, 15)
    n = np.arange(1, 400)[:, None]
    decay = np.exp(-((n * pi * min(spread, 1e3)) ** 2) / 2)
    elastic = np.sum(2 * (1 - (-1.0) ** n) / (n * pi) * np.sin(n * pi * p) * decay, axis=0)
    plastic = p + np.sum(2 * (-1.0) ** n / (n * pi) * np.sin(n * pi * p) * decay, axis=0)
    assert_allclose(persson_area(p, spread, 1.0), elastic + plastic, rtol=1e-9)
    assert_allclose(persson_area([0.0, 1.0], spread, 1.0), [0, 1], atol=1e-12)
    assert np.all(np.diff(persson_area(p, spread, 1.0)) >= 0)


@pytest.mark.parametrize("hardness", [3e8, 1e9, np.inf])
def test_contact_grows_and_gaps_narrow_with_the_load(hardness):
    loads = np.geomspace(1e5, 2.9e8, 60)
    junctions = np.array(
        [critical_junction(p, 1e11, WAVES, POWERS, hardness=hardness) for p in loads]
    )
    assert np.all(np.diff(junctions[:, 0]) > 0)
    assert np.all(np.diff(junctions[:, 1:], axis=0) <= 0)
    assert junctions[0, 1] > 0
    slope = np.sqrt(np.sum(WAVES**2 * POWERS))
    assert_allclose(junctions[:, 0], persson_area(loads, 1e11 * slope / 2, hardness))
    high = [critical_junction(2 * p, 1e11, WAVES, 4 * POWERS, hardness=2 * hardness) for p in loads]
    assert_allclose(high, junctions * [1, 2, 2], rtol=1e-6, atol=1e-30)


def test_the_mean_gap_falls_with_the_logarithm_of_light_loads():
    """ū = −u₀ ln p + constant, u₀ = γ √π ∫ q²C w dq (Persson, Phys. Rev. Lett. 99, 2007, 125502)."""
    gaps = [critical_junction(p, 1e11, WAVES, POWERS).mean_gap for p in (1e3, 1e4, 1e5)]
    rise = np.cumsum(WAVES**2 * POWERS) - WAVES**2 * POWERS / 2
    length = 0.45 * np.sum(WAVES * POWERS * np.sqrt(2 / rise)) / (2 * np.sqrt(pi))
    assert gaps[0] - gaps[1] == pytest.approx(gaps[1] - gaps[2], rel=1e-3)
    # areas of a light load go with it, so that the pressure where they touch stays: only the longest waves count
    assert gaps[0] - gaps[1] == pytest.approx(length * np.log(10), rel=1e-3)

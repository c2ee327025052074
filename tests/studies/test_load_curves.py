"""Distance of two curves of leakage, and the load at which one closes."""

import numpy as np
from numpy.testing import assert_allclose

from femseal.loads import LoadStep
from femseal.studies.load_curves import closing_load, leakage_factor

STEPS = (LoadStep(1e8), LoadStep(2e8), LoadStep(3e8), LoadStep(2e8, 3e8), LoadStep(1e8, 3e8))


EXACT = np.array([1.0, 0.3, 0.01, 0.02, 0.1])


def factor_of(found, exact, branch="loading"):
    factor = leakage_factor(np.asarray(found), np.asarray(exact), STEPS, branch)
    return factor.value, factor.loads, factor.closed


def test_equal_curves_have_factor_one():
    assert factor_of(EXACT, EXACT) == (1.0, 3, 0)
    assert factor_of(EXACT, EXACT, "unloading") == (1.0, 2, 0)


def test_the_factor_is_the_quadratic_mean_of_the_logarithm_whatever_the_unit_and_direction():
    for ratio in (2.0, 0.5):
        for scale in (1e-9, -1.0):
            assert_allclose(factor_of(scale * ratio * EXACT, scale * EXACT)[0], 2.0, rtol=1e-14)
    found = EXACT * [1, 1, 1, np.exp(3), np.exp(-4)]
    value = factor_of(found, EXACT, "unloading")[0]
    assert_allclose(np.log(value), np.sqrt((9 + 16) / 2), rtol=1e-14)


def test_loads_that_hardly_leak_do_not_count():
    exact = np.array([1.0, 1.1e-3, 0.9e-3, 1.0, 1.0])
    value, loads, _ = factor_of(exact * [1, 2, 50, 1, 1], exact)
    assert loads == 2
    assert_allclose(np.log(value), np.log(2) / np.sqrt(2), rtol=1e-14)


def test_loads_closed_in_one_solution_only_are_counted_on_either_side():
    shut = EXACT * [1, 1, 0, 0, 1]
    for pair in ((EXACT, shut), (shut, EXACT)):
        assert factor_of(*pair) == (1.0, 2, 1)
        assert factor_of(*pair, "unloading") == (1.0, 1, 1)
    # closed in both, or leaking below the floor beside a closed one: no difference to speak of
    assert factor_of(shut, shut)[2] == 0
    assert factor_of(EXACT * [1, 1, 1e-5, 1, 1], shut)[2] == 0


def test_what_failed_is_left_out():
    failed, first = EXACT * [1, np.nan, 1, 1, 1], EXACT * [np.nan, 1, 1, 1, 1]
    for pair in ((failed, EXACT), (EXACT, failed), (EXACT, first)):
        assert factor_of(*pair) == (1.0, 2, 0)
    value, loads, _ = factor_of(EXACT, np.nan * EXACT, "unloading")
    assert (np.isnan(value), loads) == (True, 0)


def test_closing_load_is_the_lowest_closed_one_on_loading():
    assert closing_load([1.0, 0.0, 0.0, 1.0, 1.0], STEPS) == 2e8
    assert closing_load([1.0, np.nan, 0.1, 0.0, 0.0], STEPS) == np.inf

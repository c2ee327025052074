"""Distance of two curves of leakage, and the load at which one closes."""

import numpy as np
from numpy.testing import assert_allclose

from femseal.loads import LoadStep
from femseal.studies.load_curves import closing_load, leakage_factor

STEPS = (LoadStep(1e8), LoadStep(2e8), LoadStep(3e8), LoadStep(2e8, 3e8), LoadStep(1e8, 3e8))


class TestFactor:
    exact = np.array([1.0, 0.3, 0.01, 0.02, 0.1])

    def test_equal_curves_have_factor_one(self):
        for branch, loads in (("loading", 3), ("unloading", 2)):
            factor = leakage_factor(self.exact, self.exact, STEPS, branch)
            assert (factor.value, factor.loads, factor.closed) == (1.0, loads, 0)

    def test_a_constant_ratio_is_the_factor_up_or_down_whatever_the_unit_and_direction(self):
        for ratio in (2.0, 0.5):
            for scale in (1e-9, -1.0):
                factor = leakage_factor(
                    scale * ratio * self.exact, scale * self.exact, STEPS, "loading"
                )
                assert_allclose(factor.value, 2.0, rtol=1e-14)

    def test_mean_is_quadratic_in_the_logarithm(self):
        factor = leakage_factor(
            self.exact * [1, 1, 1, np.exp(3), np.exp(-4)], self.exact, STEPS, "unloading"
        )
        assert_allclose(np.log(factor.value), np.sqrt((9 + 16) / 2), rtol=1e-14)

    def test_loads_that_hardly_leak_do_not_count(self):
        exact = np.array([1.0, 1.1e-3, 0.9e-3, 1.0, 1.0])
        factor = leakage_factor(exact * [1, 2, 50, 1, 1], exact, STEPS, "loading")
        assert factor.loads == 2
        assert_allclose(np.log(factor.value), np.log(2) / np.sqrt(2), rtol=1e-14)

    def test_loads_closed_in_one_solution_only_are_counted_on_either_side(self):
        leaking, shut = np.array([1.0, 0.3, 0.01, 0.02, 0.1]), np.array([1.0, 0.3, 0.0, 0.0, 0.1])
        for pair in ((leaking, shut), (shut, leaking)):
            for branch, loads in (("loading", 2), ("unloading", 1)):
                factor = leakage_factor(*pair, STEPS, branch)
                assert (factor.value, factor.loads, factor.closed) == (1.0, loads, 1)
        # closed in both, or leaking below the floor beside a closed one: no difference to speak of
        assert leakage_factor(shut, shut, STEPS, "loading").closed == 0
        assert leakage_factor(leaking * [1, 1, 1e-5, 1, 1], shut, STEPS, "loading").closed == 0

    def test_what_failed_is_left_out(self):
        for pair in (
            (self.exact * [1, np.nan, 1, 1, 1], self.exact),
            (self.exact, self.exact * [1, np.nan, 1, 1, 1]),
        ):
            factor = leakage_factor(*pair, STEPS, "loading")
            assert (factor.value, factor.loads) == (1.0, 2)
        first_unknown = self.exact * [np.nan, 1, 1, 1, 1]
        for branch in ("loading", "unloading"):
            factor = leakage_factor(self.exact, first_unknown, STEPS, branch)
            assert (factor.value, factor.loads) == (1.0, 2)
        factor = leakage_factor(self.exact, np.nan * self.exact, STEPS, "unloading")
        assert np.isnan(factor.value)
        assert factor.loads == 0

    def test_closing_load_is_the_lowest_closed_one_on_loading(self):
        assert closing_load([1.0, 0.0, 0.0, 1.0, 1.0], STEPS) == 2e8
        assert closing_load([1.0, np.nan, 0.1, 0.0, 0.0], STEPS) == np.inf

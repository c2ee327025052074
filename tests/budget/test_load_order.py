"""Intervals of a load cycle are consistent with the order of its loads."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

import femseal as fs
from femseal.budget import ErrorPart
from femseal.loads import LoadProgramme

STEPS = LoadProgramme.of([1e7, 1e8, 2e8, 4e8], [4e8], [2e8, 1e8])


def test_bands_end_where_those_of_other_loads_do():
    """No load leaks more than a lower one, and unloading no more than loading and no less than its peak."""
    q = np.array([8.0, 5.0, 4.0, 1.0, 1.5, 2.0])
    wide = ErrorPart(
        "a",
        np.array([7.0, 0.1, 3.0, 0.5, 0.1, 1.9]),
        np.array([9.0, 20.0, 4.5, 50.0, 30.0, 2.5]),
        "",
    )
    budget = fs.ErrorBudget("deterministic", q, (wide,), STEPS)
    assert_allclose(budget.upper, [9.0, 9.0, 4.5, 4.5, 4.5, 4.5])
    assert_allclose(budget.lower, [7.0, 3.0, 3.0, 0.5, 0.5, 1.9])
    assert_allclose(replace(budget, steps=None).upper, wide.upper)


def test_a_leakage_that_rises_with_the_load_leaves_the_bands_as_they_are():
    q = np.array([8.0, 5.0, 6.0, 1.0, 1.5, 2.0])
    wide = ErrorPart("a", 0.1 * q, 10 * q, "")
    assert_allclose(fs.ErrorBudget("stochastic", q, (wide,), STEPS).upper, 10 * q)
    # unknown ends stay unknown beside known ones
    known = np.where(q == 5, np.nan, np.sort(q)[::-1])
    budget = fs.ErrorBudget(
        "deterministic", q, (ErrorPart("a", 0.5 * known, 2 * known, ""),), STEPS
    )
    for ends in (budget.lower, budget.upper):
        assert np.isnan(ends).tolist() == [n == 1 for n in range(6)]


def test_what_a_peak_may_leak_its_unloading_may_leak_as_well():
    q = np.array([8.0, 5.0, 4.0, 1.0, 1.5, 2.0])
    upper = np.array([9.0, 9.0, 9.0, 6.0, 2.0, 2.5])
    budget = fs.ErrorBudget("stochastic", q, (ErrorPart("a", 0.5 * q, upper, ""),), STEPS)
    assert_allclose(budget.upper, [9.0, 9.0, 9.0, 6.0, 6.0, 6.0])
    sealed = np.array([8.0, 5.0, 4.0, 0.0, 0.0, 1e-3])
    budget = fs.ErrorBudget("stochastic", sealed, (ErrorPart("a", 0.5 * sealed, upper, ""),), STEPS)
    assert (budget.upper[4:] >= budget.upper[3]).all()

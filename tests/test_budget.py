"""The error budget: grid convergence, parts and their combination."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs

Q = np.array([4.0, 1.0, 0.0])


def part(name, below, above, upper_sealed=0.0):
    made = fs.ErrorPart.of(name, Q, np.array(below, float), np.array(above, float), "")
    upper = np.where(Q == 0, upper_sealed, made.upper)
    return fs.ErrorPart(name, made.lower, upper, "")


def test_the_published_example_of_three_grids():
    """Celik et al. (2008) as pyGCS computes it: 18000, 8000 and 4500 cells in the plane."""
    sizes = [n**-0.5 for n in (18000, 8000, 4500)]
    found = fs.grid_convergence([6.063, 5.972, 5.863], sizes)
    assert found.kind == "monotone"
    assert_allclose([found.order, found.extrapolated], [1.53, 6.1685], atol=5e-3)  # published to these digits
    assert_allclose([100 * found.index, 100 * found.index_medium], [2.17, 4.11], atol=5e-3)


@pytest.mark.parametrize("order", [0.7, 1.0, 2.0])
def test_the_order_of_a_manufactured_sequence_is_observed(order):
    sizes = [1.0, 1.4, 2.3]
    found = fs.grid_convergence([3.0 + 0.2 * h**order for h in sizes], sizes, order=2.0)
    assert_allclose([found.order, found.extrapolated], [order, 3.0], rtol=1e-9)
    assert_allclose(found.error, 1.25 * 0.2, rtol=1e-9)


def test_an_order_that_is_not_expected_takes_more_safety():
    found = fs.grid_convergence([1 + 0.1 * h**5 for h in (1, 2, 4)], [1, 2, 4], order=2.0)
    assert not found.as_expected
    assert_allclose(found.error, 3 * 0.1 * 31 / 3)  # order 2, not the observed 5


@pytest.mark.parametrize(
    ("values", "kind", "least"),
    [
        ([1.0, 1.1, 0.8], "oscillating", 0.15),
        ([1.0, 1.2, 1.1], "oscillating", 0.6),
        ([1.0, 1.2, 1.3], "diverging", 0.9),
    ],
)
def test_values_that_do_not_converge_say_so(values, kind, least):
    found = fs.grid_convergence(values, [1, 2, 4])
    assert found.kind == kind
    assert found.error >= least - 1e-12


def test_parts_combine_as_the_root_of_the_sum_of_squares_of_logarithms():
    budget = fs.ErrorBudget("deterministic", Q, (part("a", [3e-2] * 3, [0.3] * 3), part("b", [4e-2] * 3, [0.4] * 3)))
    assert_allclose(budget.lower[:2], Q[:2] * np.exp(-0.05))
    assert_allclose(budget.upper[:2], Q[:2] * np.exp(0.5))
    assert_allclose(budget.half_width(), [0.5, 0.5, 0.0])
    assert budget.limiting() == "b"


def test_sealed_steps_and_steps_that_may_be_sealed():
    parts = part("a", [0.1, np.inf, 0], [0.1, 0.1, 0], 0.2), part("b", [0.2] * 3, [0.1] * 3, 0.3)
    budget = fs.ErrorBudget("deterministic", Q, parts)
    assert budget.lower.tolist()[1:] == [0.0, 0.0]
    assert budget.upper[2] == 0.3
    assert budget.half_width(1) == budget.half_width(2) == np.inf
    assert budget.limiting(1) == "a"
    assert budget.limiting(2) in ("a", "b")


def test_an_unknown_part_makes_the_band_unknown():
    budget = fs.ErrorBudget("deterministic", Q, (part("a", [0.1, np.nan, 0], [0.1, np.nan, 0]),))
    assert np.isnan([budget.lower[1], budget.upper[1], budget.half_width(1)]).all()
    assert np.isfinite(budget.half_width(0))

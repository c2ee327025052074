"""Parts of an error budget, and the interval that they combine to."""

import numpy as np
from numpy.testing import assert_allclose

import femseal as fs
from femseal.budget import ErrorPart

#: Leakages of three steps, the last of which is sealed.
Q = np.array([4.0, 1.0, 0.0])


def part(name, below, above, upper_sealed=0.0):
    """An error part that reaches this far below and above Q, in logarithms, and up to `upper_sealed` where Q is 0."""
    made = ErrorPart.from_distances(name, Q, np.array(below, float), np.array(above, float), "")
    upper = np.where(Q == 0, upper_sealed, made.upper)
    return ErrorPart(name, made.lower, upper, "")


def test_parts_combine_as_the_root_of_the_sum_of_squares_of_logarithms():
    budget = fs.ErrorBudget(
        "deterministic", Q, (part("a", [3e-2] * 3, [0.3] * 3), part("b", [4e-2] * 3, [0.4] * 3))
    )
    assert_allclose(budget.lower[:2], Q[:2] * np.exp(-0.05))
    assert_allclose(budget.upper[:2], Q[:2] * np.exp(0.5))
    assert_allclose(budget.half_width(), [0.5, 0.5, 0.0])
    assert budget.limiting() == "b"


def test_sealed_steps_and_steps_that_may_be_sealed():
    parts = part("a", [0.1, np.inf, 0], [0.1, 0.1, 0], 0.2), part("b", [0.2] * 3, [0.1] * 3, 0.3)
    budget = fs.ErrorBudget("deterministic", Q, parts)
    assert_allclose(budget.lower, [4 * np.exp(-np.hypot(0.1, 0.2)), 0.0, 0.0])
    assert budget.upper[2] == 0.3
    assert budget.half_width(1) == budget.half_width(2) == np.inf
    assert budget.limiting(1) == "a"
    unknown = fs.ErrorBudget("deterministic", Q, (part("a", [0.1, np.nan, 0], [0.1, np.nan, 0]),))
    for known in (unknown.lower, unknown.upper, unknown.half_width()):
        assert np.isnan(known).tolist() == [False, True, False]


def test_a_widened_part_has_its_distances_times_a_factor():
    wide = part("a", [0.1, 0.2, 0], [0.3, 0.1, 0], 0.2).widened(Q, np.array([1.0, 3.0, 3.0]))
    assert_allclose(wide.lower, [4 * np.exp(-0.1), np.exp(-0.6), 0.0])
    assert_allclose(wide.upper, [4 * np.exp(0.3), np.exp(0.3), 0.2])
    closed = part("a", [0.1, np.inf, 0], [0.3, np.nan, 0]).widened(Q, np.full(3, 3.0))
    assert closed.lower[1] == 0
    assert np.isnan(closed.upper[1])

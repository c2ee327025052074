"""The lower bound of a conductance from a potential, against flows solved by elimination."""

import numpy as np
import pytest
from networks import network, solve_links
from numpy.testing import assert_allclose

from femseal.flow.error_bound import least_conductance


def random_links(rng):
    """Links of a small network, some of them closed, with columns in a ring or not."""
    n1, n2 = int(rng.integers(2, 9)), int(rng.integers(2, 9))
    shapes = (n1, n2), (n1 - 1, n2 - int(rng.integers(2)))
    sigma, closed = rng.uniform(0, 6), rng.choice([0.0, 0.2, 0.35])
    return [np.exp(sigma * rng.standard_normal(s)) * (rng.random(s) > closed) for s in shapes]


def test_the_bound_of_a_disturbed_potential_is_no_more_than_the_conductance():
    rng = np.random.default_rng(1)
    percolating = tight = 0
    for _ in range(300):
        c1, c2 = random_links(rng)
        exact = solve_links(c1, c2, solver="elimination")
        if not exact.percolates:
            continue
        percolating += 1
        reached = np.isfinite(exact.potential)
        stencil = network(
            np.where(reached[:-1] & reached[1:], c1, 0.0),
            np.where((reached & np.roll(reached, -1, axis=1))[1:-1, : c2.shape[1]], c2, 0.0),
        )
        noise = rng.standard_normal(exact.potential[1:-1].shape)
        for size in (0.03, 1e-3, 1e-5):
            disturbed = exact.potential.copy()
            disturbed[1:-1] += size * noise
            bound = least_conductance(stencil, disturbed, 1 - disturbed)
            assert 0 <= bound <= exact.conductance * (1 + 1e-13)
            tight += bound > 0.99 * exact.conductance
        bound = least_conductance(stencil, exact.potential, exact.complement)
        assert_allclose(bound, exact.conductance, rtol=1e-12)
    assert percolating > 150
    assert tight > 150


@pytest.mark.parametrize("noise", [1e-8, 1e-3, 0.1])
def test_the_lower_bound_holds_for_a_wrong_potential(noise):
    """Thomson's principle with the flux of a disturbed potential, made to balance."""
    rng = np.random.default_rng(0)
    c1, c2 = (np.exp(rng.standard_normal(shape)) for shape in ((7, 9), (6, 9)))
    exact = solve_links(c1, c2)
    rng = np.random.default_rng(3)
    potential = exact.potential.copy()
    potential[1:-1] += noise * rng.standard_normal((6, 9))
    stencil = network(c1, c2)
    lower = least_conductance(stencil, potential, 1 - potential)
    assert lower < exact.conductance * (1 + 1e-14)
    assert lower > exact.conductance * (1 - 1e4 * noise**2 - 1e-12)
    best = least_conductance(stencil, exact.potential, exact.complement)
    assert_allclose(best, exact.conductance, rtol=1e-13)

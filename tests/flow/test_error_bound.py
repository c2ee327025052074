"""The bound of the error of a potential, against flows solved by elimination."""

import numpy as np
from networks import network, solve_links

from femseal.flow.error_bound import energy_gap


def random_links(rng):
    """Links of a small network, some of them closed, with columns in a ring or not."""
    n1, n2 = int(rng.integers(2, 9)), int(rng.integers(2, 9))
    shapes = (n1, n2), (n1 - 1, n2 - int(rng.integers(2)))
    sigma, closed = rng.uniform(0, 6), rng.choice([0.0, 0.2, 0.35])
    return [np.exp(sigma * rng.standard_normal(s)) * (rng.random(s) > closed) for s in shapes]


def test_the_bound_is_no_less_than_the_error_of_a_disturbed_potential():
    rng = np.random.default_rng(1)
    percolating = 0
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
        disturbed = exact.potential.copy()
        disturbed[1:-1] += 0.03 * rng.standard_normal(disturbed[1:-1].shape)
        error = 1 - exact.conductance / stencil.energy(np.nan_to_num(disturbed))
        bound = energy_gap(stencil, disturbed, 1 - disturbed)
        assert bound >= error * (1 - 1e-9) - 1e-14
        assert energy_gap(stencil, exact.potential, exact.complement) < 1e-12
    assert percolating > 150

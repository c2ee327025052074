"""Contacts of points with a rough layer, of which a few points yield and carry the load."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from femseal.contact import HalfSpace
from femseal.studies.contact_points import ContactPoints


@pytest.mark.parametrize("seed", [*range(20), 241, 264, 287])
@pytest.mark.parametrize("boundary", [("free", "free"), ("free", "periodic")])
def test_few_points_that_yield_carry_each_load_in_equilibrium(seed, boundary):
    """The highest load is 1.2 to 6 times what a single point bears before it yields."""
    rng = np.random.default_rng(seed)
    n = 16
    body = HalfSpace((n, n), (1e-5, 1e-5), 1e11, boundary)
    depth = rng.exponential(1e-6, n * n) * 10 ** rng.uniform(-1, 1)
    highest_load = 10 ** rng.uniform(3, 6)
    yield_pressure = highest_load * n * n / rng.uniform(1.2, 6)
    compliance = 10 ** rng.uniform(-20, -14)  # of the rough layer [m/Pa]
    points = ContactPoints(body, np.ones((n, n), bool), depth, yield_pressure)

    def layer(p):
        return 1e-6 - compliance * p, np.full(p.size, -compliance)

    p = np.zeros(n * n)
    for load in highest_load * np.array([0.5, 0.6, 0.8, 1.0]):
        # the pressures at the load before are the first guess
        p = points.solve(layer, load, p, np.zeros(n * n)).pressure
        assert_allclose(p.mean(), load, rtol=1e-8)
        assert p.max() <= yield_pressure
        # distance of the bodies, apart from their approach, minus the separation of the rough layer
        distance = depth + points.displacement(p) - layer(p)[0]
        is_free = (p > 0) & (p < yield_pressure)
        approach = distance[is_free].mean()
        tolerance = 1e-4 * (approach - distance.min())
        assert_allclose(distance[is_free], approach, atol=tolerance)
        assert (distance[p == 0] >= approach - tolerance).all()
        assert (distance[p == yield_pressure] <= approach + tolerance).all()

"""The mean distance to the edge of contact patches, against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.contact import coating_edge_distance, mean_edge_distance

PERIODIC = ("periodic", "periodic")


@pytest.mark.parametrize("width", [2, 8, 20])
def test_it_is_a_quarter_of_the_width_of_strips(width):
    yields = np.zeros((64, 30), bool)
    yields[5 : 5 + width] = True
    yields[40 : 40 + width] = True
    yields = np.roll(yields, 27 + width // 3, axis=0)  # one strip extends over the ends
    assert_allclose(mean_edge_distance(yields, yields, (2e-6, 3e-6), PERIODIC), width * 2e-6 / 4)


def test_it_is_a_third_of_the_radius_of_a_circle():
    x = np.arange(400) - 200
    yields = np.hypot(x[:, None], x) < 150.3
    assert_allclose(mean_edge_distance(yields, yields, (1.0, 1.0), PERIODIC), 50.1, rtol=0.01)


def test_it_is_averaged_over_the_points_that_yield():
    touches = np.zeros((40, 10), bool)
    touches[10:30] = True
    yields = np.zeros_like(touches)
    yields[19:21] = True
    assert_allclose(mean_edge_distance(touches, yields, (1.0, 1.0), PERIODIC), 9.5)


def test_the_ends_of_a_free_axis_are_edges():
    yields = np.ones((20, 30), bool)
    assert mean_edge_distance(yields, yields, (1.0, 1.0), PERIODIC) == np.inf
    assert_allclose(mean_edge_distance(yields, yields, (1.0, 1.0), ("free", "periodic")), 5.0)
    assert mean_edge_distance(yields, ~yields, (1.0, 1.0), PERIODIC) == 0.0


def test_it_is_only_measured_on_coatings():
    steel, silver = (
        fs.named_solid(name) for name in ("steel 304/316, annealed", "silver, annealed")
    )
    heights = np.zeros((32, 32))
    heights[:8] = 1e-6
    for body, is_coated in ((silver, False), (fs.Coated(steel, silver, 5e-6), True)):
        half_space = fs.HalfSpace((32, 32), (1e-6, 1e-6), (body, steel))
        contact = fs.solve_contact(
            1e-6 - heights, half_space, pressure=0.249 * silver.hardness, hardness=silver.hardness
        )
        distance = coating_edge_distance(contact)
        # the points at the edges of the strip yield first
        assert 0 < distance < 2e-6 if is_coated else np.isnan(distance)

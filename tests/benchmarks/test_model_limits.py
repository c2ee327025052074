"""The small problems of the benchmark `model_limits` have closed forms where there are any."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import model_limits as limits

pytestmark = pytest.mark.slow


def test_stokes_flow_between_plates_is_the_cubic_law():
    permeability, _ = limits.Channel(lambda x: 1.5 + 0 * x, 4.0, (8, 2)).flow()
    assert_allclose(permeability, 1.5**3 / 12, rtol=1e-10)


def test_a_tilted_channel_carries_what_plates_do_whatever_the_density():
    channel = limits.Channel(lambda x: 1.0 + 0 * x, 2.0, (8, 2))
    assert_allclose(channel.flow(density=50.0)[0], 1 / 12, rtol=1e-8)


@pytest.mark.parametrize("ratio", [0.3, 0.6])
def test_stokes_flow_over_a_wave_has_the_next_order_of_lubrication(ratio):
    slopes = np.array([0.1, 0.2])
    errors, seconds = [], []
    for slope in slopes:
        wall = limits.wave(ratio, slope)
        first, second = wall.lubrication()
        # ⟨sin²/(1 + ε cos)³⟩ and ⟨1/(1 + ε cos)³⟩ in closed form
        closed = 1 + 1.6 * slope**2 * (1 - ratio**2) / (2 + ratio**2)
        assert_allclose(first / second, closed, rtol=1e-6)
        permeability, _ = limits.Channel(wall.gap, wall.period, (192, 6)).flow()
        first, second = wall.lubrication(192)
        errors.append(abs(permeability / second - 1))
        seconds.append(1 - second / first)
    # what is left is of the next order again
    assert errors[0] < 0.1 * seconds[0]
    assert errors[1] / errors[0] > 6


def test_flow_along_ridges_has_its_next_order():
    wall = limits.wave(0.3, 0.1)
    first, second = wall.along(96)
    found = limits.flow_along(wall.gap, wall.period, (96, 6))
    assert abs(found / second - 1) < 0.05 * abs(first / second - 1)


def test_the_ring_kernel_gives_hertz_on_a_sphere():
    points = 400
    step = 1 / points
    r = (np.arange(points) + 0.5) * step
    u = limits.ring_kernel(r, step) @ np.sqrt(1 - r**2)
    # Johnson 1985, eq. 3.42a: u = π p0 (2a² − r²)/4aE*
    assert_allclose(u[20:-20], (np.pi * (2 - r**2) / 4)[20:-20], rtol=2e-3)


def test_a_strip_under_a_crown_is_hertz_in_plane_strain():
    x = (np.arange(400) + 0.5) / 400 * 3 - 1.5
    step = x[1] - x[0]
    p = limits.pressed(limits.strip_kernel(x, step), x**2 / 200, np.full(400, step), np.pi / 400)
    assert_allclose(p.max(), 1 / 200, rtol=1e-2)
    assert_allclose(np.abs(x[p > 0]).max() + step / 2, 1, atol=step)


def test_bodies_and_layers_have_their_limits():
    assert_allclose(limits.line_contact_yield(0.3), (1.79, 0.70), rtol=1e-2)
    assert_allclose(limits.layer_factor(3.0), 1, rtol=1e-12)
    # a thin layer is a foundation: ξ/2 of a half-space
    assert_allclose(limits.layer_factor(1e-3), np.pi * 1e-3, rtol=1e-3)

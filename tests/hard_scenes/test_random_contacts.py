"""Random problems far from comfort: every one has to converge to its residual and to carry its load."""

import numpy as np
import pytest

from femseal.contact import HalfSpace, solve_contact

E = 115e9


def own_residual(contact, gap0, displacement, pressure, hardness):
    """‖p − clip(p − c(v − δ), 0, H)‖/‖p‖ with the δ that carries the load; heights count from the highest point."""
    p, body = contact.pressure, contact.half_space
    x = p - body.stiffness * (displacement + (gap0 - gap0.min()))
    low, high = -x.max(), (pressure * x.size - x).max()
    for _ in range(200):
        middle = (low + high) / 2
        too_much = np.clip(x + middle, 0, hardness).sum() > pressure * x.size
        low, high = (low, middle) if too_much else (middle, high)
    return np.linalg.norm(p - np.clip(x + middle, 0, hardness)) / np.linalg.norm(p)


def steep_steps(rng, shape, spacing):
    """Heights in units of a pixel whose points of contact lie at one height, or at very different ones."""
    i, j = (x - (n - 1) / 2 for x, n in zip(np.indices(shape), shape, strict=True))
    noise = rng.standard_normal(shape)
    kinds = (
        np.floor(rng.uniform(2, 12) * rng.random(shape)),
        1.0 * ((abs(i) > rng.integers(1, 5)) | (abs(j) > rng.integers(1, 5))),  # a plateau
        i**2 + (j * spacing[1] / spacing[0]) ** 2,  # a sphere
        np.abs(i) / shape[0] * rng.uniform(0, 2) + np.abs(j) / shape[1] * rng.uniform(0, 2),
        noise * 0.01 + 20 * (rng.random(shape) > 0.05),
        noise,
    )
    return kinds[rng.integers(6)]


def stretched(seed, dense_operator):
    """Pixels to 1:30, grids from 1 × 1, loads from 1e-10 E* to 2 E* and from 1e-6 H to H, all boundaries."""
    rng = np.random.default_rng([14, seed])
    most = ((2, 60), (7, 7), (10, 40), (20, 20))[rng.integers(4)]
    shape = tuple(int(n) for n in rng.integers(1, most))[:: rng.choice([-1, 1])]
    spacing = (1e-6, 1e-6 * 30 ** rng.uniform(-1, 1))
    boundary = tuple(str(kind) for kind in rng.choice(["periodic", "mirror", "free"], 2))
    body = HalfSpace(shape, spacing, E, boundary)
    gap0 = steep_steps(rng, shape, spacing) * 10 ** rng.uniform(-9, -5.5)
    gap0 += rng.choice([0, 0, 0, 3e-6, -2e-6])
    hardness = np.inf if rng.random() < 0.5 else 10 ** rng.uniform(7, 11.6)
    pressure = rng.choice([10 ** rng.uniform(-6, 0), rng.uniform(0.001, 0.999)]) * hardness
    if np.isinf(hardness):
        pressure = E * 10 ** rng.uniform(-10, 0.3)
    rtol = float(rng.choice([1e-4, 1e-6, 1e-8]))
    contact = solve_contact(gap0, body, pressure=pressure, hardness=hardness, rtol=rtol)
    p = contact.pressure
    assert 0 <= p.min() <= p.max() <= hardness
    assert abs(p.mean() / pressure - 1) <= 1e-9
    displacement = (dense_operator(body) @ p.ravel()).reshape(shape)
    # the reference is right to 1e-13 of its largest value
    error = own_residual(contact, gap0, displacement, pressure, hardness)
    assert error <= 1.001 * rtol + 1e-9, seed


def test_stretched_pixels_tiny_grids_and_light_loads(dense_operator):
    for seed in range(80, 120):
        stretched(seed, dense_operator)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(1000, 6000, 250))
def test_thousands_of_stretched_pixels_tiny_grids_and_light_loads(first, dense_operator):
    for seed in range(first, first + 250):
        stretched(seed, dense_operator)


def test_sets_that_never_settle_are_left_for_descent():
    """Five heights on pixels of 16:1, two thirds of the hardness: a uniform shift of the load undoes every step."""
    gap0 = np.random.default_rng([55, 0, 13]).integers(0, 5, (77, 96)) * 4e-9
    body = HalfSpace((77, 96), (16e-6, 1e-6), E, ("free", "periodic"))
    load, hardness = 0.65 * 0.0057 * E, 0.0057 * E
    contact = solve_contact(gap0, body, pressure=load, hardness=hardness, rtol=1e-8)
    displacement = body.displacement(contact.pressure)
    assert own_residual(contact, gap0, displacement, load, hardness) <= 2e-8

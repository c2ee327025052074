"""Random problems far from comfort: every one has to converge to its residual and to carry its load."""

import numpy as np
import pytest

from femseal.contact import HalfSpace, solve_contact

E = 115e9
BOUNDARIES = [
    ("periodic", "periodic"),
    ("mirror", "mirror"),
    ("free", "periodic"),
    ("free", "free"),
    ("mirror", "periodic"),
    ("periodic", "mirror"),
    ("free", "mirror"),
]


def surface(rng, shape, spacing, slope, kind):
    """Heights of an rms slope: smooth, rough to the pixel, white noise or with spikes."""
    if kind == "white":
        h = rng.standard_normal(shape)
    else:
        q = np.hypot(
            np.fft.fftfreq(shape[0], spacing[0])[:, None],
            np.fft.fftfreq(shape[1], spacing[1])[None],
        )
        top = 1 / (2 * max(spacing)) / (4 if kind == "smooth" else 1)
        low = max(
            top / rng.choice([4, 8, 16]),
            1 / min(n * d for n, d in zip(shape, spacing, strict=True)),
        )
        power = -(1 + rng.uniform(0.3, 1))
        amplitude = np.where(q < low, low**power, np.maximum(q, low) ** power)
        amplitude[(q > top * 1.0001) | (q == 0)] = 0
        h = np.fft.ifft2(np.fft.fft2(rng.standard_normal(shape)) * amplitude).real
        if kind == "spikes":
            h = h / max(h.std(), 1e-300) + (rng.random(shape) < 0.003) * 20
        if h.std() == 0:
            h = rng.standard_normal(shape)
    slopes = [np.diff(h, axis=a, append=h.take([0], a)) / spacing[a] for a in (0, 1)]
    rms = np.sqrt(sum(np.mean(s**2) for s in slopes))
    return h * slope / rms if rms > 0 else h


def check(contact, gap0, half_space, pressure, hardness, rtol):
    p = contact.pressure
    assert p.min() >= 0
    assert p.max() <= hardness
    assert abs(p.mean() / pressure - 1) <= 1e-9
    v = half_space.displacement(p) + gap0 - contact.approach
    spacing = [d for n, d in zip(half_space.shape, half_space.spacing, strict=True) if n > 1] or [
        1e-6
    ]
    c = np.pi * half_space.modulus / (4 * np.prod(spacing) ** (1 / len(spacing)))
    # the level of K on a strip is large beside its differences
    assert np.linalg.norm(p - np.clip(p - c * v, 0, hardness)) <= 2 * rtol * np.linalg.norm(p)


def loading(seed):
    """Slopes 0.02 to 1, hardness 0.2 to 400 GPa or none, from one pixel to 0.99 H, all boundaries, pixels to 1:20."""
    rng = np.random.default_rng(seed)
    mode = rng.integers(4)
    shape = [
        tuple(int(n) for n in rng.integers(1, 60, 2)),
        (64, 64),
        tuple(int(n) for n in rng.integers(40, 140, 2)),
        (128, 128),
    ][mode]
    ratio = float(np.exp(rng.uniform(-1, 1) * np.log(20))) if rng.random() < 0.25 else 1.0
    half_space = HalfSpace(shape, (1e-6, 1e-6 * ratio), E, BOUNDARIES[rng.integers(7)])
    slope = float(np.exp(rng.uniform(np.log(0.02), 0)))
    hardness = (
        np.inf if rng.random() < 0.3 else float(np.exp(rng.uniform(np.log(0.2e9), np.log(400e9))))
    )
    kind = rng.choice(["smooth", "rough", "white", "spikes"], p=[0.5, 0.25, 0.125, 0.125])
    gap0 = surface(rng, shape, half_space.spacing, slope, kind)
    if np.isinf(hardness):
        pressure = E * slope * float(np.exp(rng.uniform(np.log(1e-5), np.log(1.5))))
    else:
        least = 1 / gap0.size
        shares = [
            np.exp(rng.uniform(np.log(least), 0)),
            rng.uniform(0.5, 0.99),
            rng.uniform(0.01, 0.5),
        ]
        pressure = min(max(rng.choice(shares), least), 0.99) * hardness
    contact = solve_contact(gap0, half_space, pressure=pressure, hardness=hardness, rtol=1e-8)
    check(contact, gap0, half_space, pressure, hardness, 1e-8)


def unloading(seed):
    """Faces unloaded from up to 0.9999 H, also onto another raw gap."""
    rng = np.random.default_rng(seed)
    n = int(rng.choice([32, 48, 64]))
    boundary = "periodic" if rng.random() < 0.3 else "mirror"
    half_space = HalfSpace((n, n), (1e-6, 1e-6), E, boundary)
    slope = float(np.exp(rng.uniform(np.log(0.03), np.log(0.6))))
    hardness = float(np.exp(rng.uniform(np.log(0.5e9), np.log(10e9))))
    kind = rng.choice(["smooth", "rough", "white"], p=[0.7, 0.25, 0.05])
    gap0 = surface(rng, (n, n), half_space.spacing, slope, kind)
    peak = hardness * rng.choice(
        [rng.uniform(0.02, 0.5), rng.uniform(0.5, 0.9), rng.uniform(0.9, 0.9999)]
    )
    left = solve_contact(gap0, half_space, pressure=peak, hardness=hardness).plastic_deformation
    for share in (1, 0.999, 0.9, 0.5, 0.1, 0.01):
        other = (
            0
            if rng.random() < 0.5
            else surface(rng, (n, n), half_space.spacing, 0.1 * slope * rng.random(), kind)
        )
        pressure = share * peak
        contact = solve_contact(
            gap0 + other, half_space, pressure=pressure, hardness=hardness, deformation=left
        )
        check(contact, gap0 + other + left, half_space, pressure, hardness, 1e-6)


def own_residual(contact, gap0, displacement, pressure, hardness):
    """‖p − clip(p − c(v − δ), 0, H)‖/‖p‖ with the δ that carries the load; heights count from the highest point."""
    p, half_space = contact.pressure, contact.half_space
    spacing = [d for n, d in zip(half_space.shape, half_space.spacing, strict=True) if n > 1] or [
        min(half_space.spacing)
    ]
    c = np.pi * half_space.modulus / (4 * np.prod(spacing) ** (1 / len(spacing)))
    x = p - c * (displacement + (gap0 - gap0.min()))
    low, high = -x.max(), (pressure * x.size - x).max()
    for _ in range(200):
        middle = (low + high) / 2
        too_much = np.clip(x + middle, 0, hardness).sum() > pressure * x.size
        low, high = (low, middle) if too_much else (middle, high)
    return np.linalg.norm(p - np.clip(x + middle, 0, hardness)) / np.linalg.norm(p)


def steep_steps(rng, shape, spacing):
    """Heights in units of a pixel whose points of contact lie at one height, or at very different ones."""
    n1, n2 = shape
    x1, x2 = ((np.arange(n) + 0.5) / n - 0.5 for n in shape)
    kind = rng.integers(6)
    if kind == 0:
        return rng.integers(0, rng.integers(2, 12), shape).astype(float)
    if kind == 1:  # a plateau
        h, i, j = np.ones(shape), rng.integers(n1), rng.integers(n2)
        h[i : i + 1 + rng.integers(n1), j : j + 1 + rng.integers(n2)] = 0
        return h
    if kind == 2:  # a sphere
        return (x1[:, None] * n1) ** 2 + (x2 * n2 * spacing[1] / spacing[0]) ** 2
    if kind == 3:
        return np.abs(x1)[:, None] * rng.uniform(0, 2) + np.abs(x2) * rng.uniform(0, 2)
    if kind == 4:
        return rng.standard_normal(shape) * 0.01 + 20 * (rng.random(shape) > 0.05)
    return rng.standard_normal(shape)


def stretched(seed, dense_operator):
    """Pixels to 1:30, grids from 1 × 1, loads from 1e-10 E* to 2 E* and from 1e-6 H to H, all boundaries."""
    rng = np.random.default_rng([14, seed])
    sizes = [
        (1, rng.integers(1, 60)),
        rng.integers(1, 7, 2),
        (rng.integers(2, 10), rng.integers(2, 40)),
    ]
    shape = tuple(int(n) for n in (*sizes, rng.integers(4, 20, 2))[rng.integers(4)])[
        :: rng.choice([-1, 1])
    ]
    spacing = (1e-6, 1e-6 * float(np.exp(rng.uniform(-1, 1) * np.log(30))))
    boundary = tuple(str(kind) for kind in rng.choice(["periodic", "mirror", "free"], 2))
    half_space = HalfSpace(shape, spacing, E, boundary)
    gap0 = (
        steep_steps(rng, shape, spacing)
        * 1e-6
        * float(np.exp(rng.uniform(np.log(1e-3), np.log(3))))
    )
    gap0 += rng.choice([0, 0, 0, 3e-6, -2e-6])
    hardness = (
        np.inf if rng.random() < 0.5 else float(np.exp(rng.uniform(np.log(1e7), np.log(4e11))))
    )
    if np.isinf(hardness):
        pressure = E * float(np.exp(rng.uniform(np.log(1e-10), np.log(2))))
    else:
        pressure = hardness * float(
            rng.choice([np.exp(rng.uniform(np.log(1e-6), 0)), rng.uniform(0.001, 0.999)])
        )
    rtol = float(rng.choice([1e-4, 1e-6, 1e-8]))
    contact = solve_contact(gap0, half_space, pressure=pressure, hardness=hardness, rtol=rtol)
    p = contact.pressure
    assert 0 <= p.min() <= p.max() <= hardness
    assert abs(p.mean() / pressure - 1) <= 1e-9
    displacement = (dense_operator(half_space) @ p.ravel()).reshape(shape)
    # the reference is right to 1e-13 of its largest value
    assert own_residual(contact, gap0, displacement, pressure, hardness) <= 1.001 * rtol + 1e-9, (
        seed
    )


def test_stretched_pixels_tiny_grids_and_light_loads(dense_operator):
    for seed in range(80, 120):
        stretched(seed, dense_operator)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(1000, 6000, 250))
def test_thousands_of_stretched_pixels_tiny_grids_and_light_loads(first, dense_operator):
    for seed in range(first, first + 250):
        stretched(seed, dense_operator)


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_loads_far_below_the_modulus(boundary):
    """A plateau whose displacements are a billionth of the heights around it."""
    gap0 = np.full((6, 10), 3e-6)
    gap0[1:4, 2:7] = 0.1e-6
    half_space = HalfSpace(gap0.shape, (1e-6, 3e-6), E, boundary)
    contact = solve_contact(gap0, half_space, pressure=2e-10 * E, rtol=1e-8)
    assert np.array_equal(contact.pressure > 0, gap0 < 1e-6)
    # the response is linear, and so is the solution as long as the points of contact stay
    ten = solve_contact(gap0, half_space, pressure=2e-9 * E, rtol=1e-8)
    np.testing.assert_allclose(
        ten.pressure, 10 * contact.pressure, rtol=0, atol=1e-6 * ten.pressure.max()
    )


def test_sets_that_never_settle_are_left_for_descent():
    """Five heights on pixels of 16:1, two thirds of the hardness: a uniform shift of the load undoes every step."""
    rng = np.random.default_rng([55, 0, 13])
    gap0 = rng.integers(0, 5, (77, 96)) * 4e-9
    half_space = HalfSpace((77, 96), (16e-6, 1e-6), E, ("free", "periodic"))
    contact = solve_contact(
        gap0, half_space, pressure=0.65 * 0.0057 * E, hardness=0.0057 * E, rtol=1e-8
    )
    assert (
        own_residual(
            contact, gap0, half_space.displacement(contact.pressure), 0.65 * 0.0057 * E, 0.0057 * E
        )
        <= 2e-8
    )


@pytest.mark.parametrize("problem", [loading, unloading])
@pytest.mark.parametrize("first", range(0, 40, 10))
def test_random_problems(problem, first):
    for seed in range(first, first + 10):
        problem(seed)


@pytest.mark.slow
@pytest.mark.parametrize("problem", [loading, unloading])
@pytest.mark.parametrize("first", range(1000, 2000, 100))
def test_a_thousand_random_problems(problem, first):
    for seed in range(first, first + 100):
        problem(seed)

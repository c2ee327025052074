"""Contact: closed forms with measured orders, an independent solver, complementarity, invariants, edges, bad input."""

import itertools
import threading

import numpy as np
import pytest
from each import each
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import lsq_linear

from femseal import analytic
from femseal.base.errors import InputError, NotConverged
from femseal.contact import (
    HalfSpace,
    LinearHardening,
    large_convolution,
    long_lists,
    solve_contact,
    workspace,
)

E = 115e9
H = 4e9
D = 1e-6
PAIRS = list(itertools.product(("periodic", "mirror", "free"), repeat=2))


def rough(shape, slope=0.2, seed=0, spacing=(D, D), cut=6):
    """Self-affine heights of the given rms slope, waves longer than `cut` of the finer pixels."""
    rng = np.random.default_rng(seed)
    q = np.hypot(
        np.fft.fftfreq(shape[0], spacing[0])[:, None], np.fft.fftfreq(shape[1], spacing[1])[None, :]
    )
    roll_off = 4 / max(n * d for n, d in zip(shape, spacing, strict=True))
    amplitude = np.where(
        (q > 0) & (q * min(spacing) <= 1 / cut), np.maximum(q, roll_off) ** -1.8, 0.0
    )
    h = np.fft.ifft2(np.fft.fft2(rng.standard_normal(shape)) * amplitude).real
    slopes = [np.diff(h, axis=a) / spacing[a] for a in (0, 1)]
    rms = np.sqrt(sum((s**2).mean() for s in slopes if s.size))
    return h * slope / rms if rms > 0 else 0 * h


def residual(contact, gap0, half_space, displacement, hardness=np.inf):
    """‖p − clip(p − c(v − δ), 0, H)‖/‖p‖ of the returned fields, nothing taken from the solver's own."""
    p = contact.pressure
    v = displacement(p, half_space) + gap0 - contact.approach
    spacing = [
        d for n, d in zip(half_space.shape, half_space.spacing, strict=True) if n > 1 or p.size == 1
    ]
    c = np.pi * half_space.modulus / (4 * np.prod(spacing) ** (1 / len(spacing)))
    return np.linalg.norm(p - np.clip(p - c * v, 0, hardness)) / np.linalg.norm(p)


def orders(errors):
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


# --- closed forms ---


def sphere(n, size=100e-6):
    d = size / n
    x = (np.arange(n) + 0.5) * d - size / 2
    r = np.hypot(x[:, None], x)
    return r, d


def test_hertz_radius_peak_and_approach():
    load, radius = 0.5, 1e-3
    a = analytic.hertz_radius(load, radius, E)
    errors = []
    for n in (64, 128, 256):
        r, d = sphere(n, 4 * a)
        half_space = HalfSpace((n, n), (d, d), E, "free")
        contact = solve_contact(
            r**2 / (2 * radius), half_space, pressure=load / (n * d) ** 2, rtol=1e-9
        )
        exact = analytic.hertz_pressure(r, load, radius, E)
        errors.append(
            (
                np.sqrt(np.mean((contact.pressure - exact) ** 2) / np.mean(exact**2)),
                abs(contact.approach / analytic.hertz_approach(load, radius, E) - 1),
                abs(contact.pressure.max() / analytic.hertz_peak_pressure(load, radius, E) - 1),
                abs(np.sqrt(contact.area_fraction / np.pi) * 4 - 1),
            )
        )
    pressure, approach, _, _ = np.transpose(errors)
    assert errors[-1][0] < 4e-3
    assert errors[-1][1] < 1e-4
    assert errors[-1][2] < 1e-3
    assert errors[-1][3] < 5e-3
    # a square-root edge on pixels: order 1 to 3/2 in L2, 3/2 and more in the approach
    assert np.log2(pressure[0] / pressure[2]) / 2 > 0.9
    assert np.log2(approach[0] / approach[2]) / 2 > 1.3


def test_hertz_gap_outside():
    # Johnson 1985, eq. 3.42a: u(r) = (δ/πa²)·((2a² − r²) asin(a/r) + a √(r² − a²))
    load, radius = 0.5, 1e-3
    a = analytic.hertz_radius(load, radius, E)
    r, d = sphere(128, 6 * a)
    contact = solve_contact(
        r**2 / (2 * radius),
        HalfSpace((128, 128), (d, d), E, "free"),
        pressure=load / (128 * d) ** 2,
        rtol=1e-9,
    )
    outside = r > 1.2 * a
    s = r[outside]
    lift = ((2 * a**2 - s**2) * np.arcsin(a / s) + a * np.sqrt(s**2 - a**2)) / (np.pi * radius)
    exact = s**2 / (2 * radius) + lift - a**2 / radius
    assert_allclose(contact.gap[outside], exact, rtol=0, atol=2e-4 * exact.max())


@each("boundary", [("periodic", "periodic"), ("mirror", "mirror"), ("mirror", "periodic")])
@each("ratio", [0.1, 0.5, 0.9])
def test_westergaard_wave(boundary, ratio):
    λ, Δ = 1e-3, 1e-6
    p_full = analytic.wave_full_contact_pressure(E, Δ, λ)
    errors, gaps = [], []
    for n in (64, 128, 256, 512):
        length = λ if boundary[0] == "periodic" else λ / 2
        d = length / n
        x = (np.arange(n) + 0.5) * d
        gap0 = np.repeat(Δ * (1 - np.cos(2 * np.pi * x / λ))[:, None], 3, axis=1)
        half_space = HalfSpace((n, 3), (d, d), E, boundary)
        contact = solve_contact(gap0, half_space, pressure=ratio * p_full, rtol=1e-9)
        assert_allclose(
            contact.pressure,
            np.repeat(contact.pressure[:, :1], 3, axis=1),
            rtol=0,
            atol=1e-7 * p_full,
        )
        exact = p_full * analytic.wave_pressure(x, ratio, λ)
        errors.append(np.sqrt(np.mean((contact.pressure[:, 0] - exact) ** 2)) / p_full)
        gaps.append(np.abs(contact.gap[:, 0] - analytic.wave_gap(x, ratio, Δ, λ)).max() / Δ)
        # the edge falls within a pixel of each of its ends
        assert abs(contact.area_fraction - analytic.wave_contact_fraction(ratio)) <= 2 / n
        assert errors[-1] <= 0.5 / n
        assert gaps[-1] <= 0.05 / n + 0.3 / n**1.5
    if (
        ratio == 0.5
    ):  # the edge lies between two pixels on every grid, so that the orders show: 1 and 3/2
        assert np.all(orders(errors) > 0.95)
        assert np.all(orders(gaps) > 1.4)


def test_wave_in_full_contact_is_exact():
    n, Δ = 32, 1e-7
    x = (np.arange(n) + 0.5) / n
    for kind, waves in (("periodic", 2 * np.pi), ("mirror", np.pi)):
        wave = np.cos(waves * x)[:, None] * np.cos(waves * x)
        half_space = HalfSpace((n, n), (D, D), E, kind)
        p_full = analytic.wavy_full_contact_pressure(E, Δ, n * D * 2 * np.pi / waves)
        p = 1.2 * p_full
        contact = solve_contact(Δ * (1 - wave), half_space, pressure=p, rtol=1e-12)
        assert contact.area_fraction == 1
        assert np.all(contact.gap == 0)
        assert_allclose(contact.pressure, p + p_full * wave, rtol=1e-10)
        assert_allclose(contact.approach, Δ, rtol=1e-9)


@each(
    ("ratio", "law", "tolerance"),
    [
        (0.97, analytic.wavy_contact_fraction_full, 5e-3),
        (0.9, analytic.wavy_contact_fraction_full, 1e-2),
        (0.01, analytic.wavy_contact_fraction_light, 5e-3),
    ],
)
def test_two_dimensional_wave_near_full_and_light_contact(ratio, law, tolerance):
    n, Δ = 256, 1e-6
    x = (np.arange(n) + 0.5) / n * 2 * np.pi
    p_full = analytic.wavy_full_contact_pressure(E, Δ, n * D)
    gap0 = Δ * (1 - np.cos(x)[:, None] * np.cos(x))
    contact = solve_contact(gap0, HalfSpace((n, n), (D, D), E), pressure=ratio * p_full, rtol=1e-8)
    assert abs(contact.area_fraction - law(ratio)) < tolerance


@each("boundary", [p for p in PAIRS if "free" not in p])
@each("hardness", [np.inf, H])
def test_flat_surface_carries_the_nominal_pressure_exactly(boundary, hardness):
    contact = solve_contact(
        np.full((17, 20), 3e-6),
        HalfSpace((17, 20), (D, D), E, boundary),
        pressure=1e8,
        hardness=hardness,
    )
    assert np.all(contact.pressure == 1e8)
    assert np.all(contact.gap == 0)
    assert np.all(contact.plastic_deformation == 0)
    assert_allclose(contact.approach, 3e-6, rtol=1e-14)
    assert (contact.area_fraction, contact.plastic_fraction) == (1, 0)


def test_flat_punch_on_a_free_patch():
    # W = 2aE*δ·1.1 or so for a square; the edge carries more than the middle, all points touch
    contact = solve_contact(
        np.zeros((31, 31)), HalfSpace((31, 31), (D, D), E, "free"), pressure=1e8, rtol=1e-10
    )
    assert contact.area_fraction == 1
    assert contact.pressure[0, 0] > contact.pressure[0, 15] > contact.pressure[15, 15] > 0
    # capacity of a square plate, 0.3668 times 4πε₀ side, so W = E*δ·side·0.3668·π. Read, J. Comput. Phys. 133, 1997
    stiffness = contact.mean_pressure * (31 * D) ** 2 / contact.approach
    assert_allclose(stiffness, 0.36678 * np.pi * E * 31 * D, rtol=0.02)


@each("boundary", PAIRS)
def test_no_load_is_first_touch(boundary):
    h = rough((14, 11))
    contact = solve_contact(
        h + 1.0, HalfSpace((14, 11), (D, D), E, boundary), pressure=0, hardness=H
    )
    assert_allclose(contact.gap, h - h.min(), rtol=0, atol=1e-15)
    assert np.all(contact.pressure == 0)
    assert np.all(contact.plastic_deformation == 0)
    assert_allclose(contact.approach, 1 + h.min(), rtol=1e-15)
    assert contact.area_fraction == 0


@each("boundary", PAIRS)
@each("field", [False, True])
def test_the_hardness_as_pressure_is_all_plastic(boundary, field, dense_operator):
    h = rough((8, 9))
    half_space = HalfSpace((8, 9), (D, D), E, boundary)
    hardness = np.random.default_rng(1).uniform(0.5, 1.5, (8, 9)) * H if field else H
    contact = solve_contact(h, half_space, pressure=float(np.mean(hardness)), hardness=hardness)
    assert_allclose(contact.pressure, np.broadcast_to(hardness, (8, 9)), rtol=1e-15)
    assert contact.plastic_fraction == 1
    assert np.all(contact.gap == 0)
    v = h + (dense_operator(half_space) @ contact.pressure.ravel()).reshape(8, 9)
    assert_allclose(contact.plastic_deformation, v.max() - v, rtol=0, atol=1e-10 * np.ptp(v))


# --- complementarity and an independent solver ---


@each("boundary", [p for p in PAIRS if "free" not in p])
@each("share", [0.01, 0.1, 0.5, 0.9, 0.99])
@each("plastic", [True, False])
def test_complementarity_recomputed(boundary, share, plastic, spectral_displacement):
    shape, spacing = (90, 64), (D, 1.5 * D)
    h = rough(shape, spacing=spacing, seed=3)
    half_space = HalfSpace(shape, spacing, E, boundary)
    hardness = H if plastic else np.inf
    contact = solve_contact(h, half_space, pressure=share * H, hardness=hardness, rtol=1e-8)
    assert residual(contact, h, half_space, spectral_displacement, hardness) <= 1.01e-8
    assert contact.residual <= 1e-8
    assert abs(contact.pressure.mean() / (share * H) - 1) <= 1e-12
    p, gap, left = contact.pressure, contact.gap, contact.plastic_deformation
    assert p.min() >= 0
    assert p.max() <= hardness
    assert gap.min() >= 0
    assert left.min() >= 0
    assert np.all(gap[p > 0] == 0)
    assert np.all(left[p < hardness] == 0)
    assert np.array_equal(contact.plastic, p >= hardness)
    assert_allclose(contact.raw_gap, gap - left)
    g = spectral_displacement(p, half_space) + h - contact.approach
    assert_allclose(contact.gap[p == 0], np.maximum(g[p == 0], 0), rtol=0, atol=1e-12 * np.ptp(h))
    assert_allclose(
        left[contact.plastic], np.maximum(-g[contact.plastic], 0), rtol=0, atol=1e-12 * np.ptp(h)
    )


def programme(k, h, mean, hardness):
    """Exact minimiser of ½pKp + hp, 0 ≤ p ≤ H, mean p given: bounded least squares, then its sets solved exactly.

    The result is checked against the optimality conditions, which make it the only minimiser.
    """
    n = h.size
    high = np.broadcast_to(np.asarray(hardness, dtype=float), n)
    load = mean * n
    # any multiple of 11ᵀ may be added where the sum is given; it makes K definite
    size = np.abs(k).max() * n or 1 / E
    definite = k - k.min() + size
    factor = np.linalg.cholesky(definite).T
    target = np.linalg.solve(factor.T, -(h - h.mean()) + size * load * 0)
    weight = 1e3 * np.sqrt(size)
    a = np.vstack([factor, weight * np.ones(n)])
    b = np.concatenate([target, [weight * load]])
    scale = mean
    top = np.minimum(high, 1e3 * load) / scale
    p = (
        lsq_linear(a * scale, b, (np.zeros(n), top), method="bvls", tol=1e-15, max_iter=100 * n).x
        * scale
    )
    low_set, high_set = p <= 1e-9 * mean, p >= high * (1 - 1e-9)
    for _ in range(50):
        free = np.flatnonzero(~low_set & ~high_set)
        p = np.where(high_set, high, 0.0)
        if free.size:
            fixed = definite[free] @ p + h[free]
            system = np.block(
                [
                    [definite[np.ix_(free, free)] * E / D, np.ones((free.size, 1))],
                    [np.ones((1, free.size)), np.zeros((1, 1))],
                ]
            )
            solution = np.linalg.solve(system, np.r_[-fixed * E / D, load - p.sum()])
            p[free] = solution[:-1]
            delta = -solution[-1] * D / E
        else:
            g = definite @ p + h
            delta = 0.5 * (g[high_set].max() + g[low_set].min(initial=np.inf))
        g = definite @ p + h - delta
        tiny = 1e-12 * (np.ptp(h) + size * mean)
        new_low = np.where(free_mask(n, free), p < 0, low_set & (g >= -tiny))
        new_high = np.where(free_mask(n, free), p > high, high_set & (g <= tiny))
        if np.array_equal(new_low, low_set) and np.array_equal(new_high, high_set):
            assert_allclose(p.sum(), load, rtol=1e-10)
            return p
        low_set, high_set = new_low, new_high
    raise AssertionError("the reference did not settle")


def free_mask(n, free):
    mask = np.zeros(n, bool)
    mask[free] = True
    return mask


@each("boundary", PAIRS)
@each(("share", "hardness"), [(0.03, np.inf), (0.03, 0.3 * H), (0.5, 0.3 * H), (0.9, "field")])
def test_equals_an_independent_solver(boundary, share, hardness, dense_operator):
    shape, spacing = (9, 8), (D, 1.7 * D)
    half_space = HalfSpace(shape, spacing, E, boundary)
    h = rough(shape, 0.15, seed=5, spacing=spacing, cut=3)
    if hardness == "field":
        hardness = 0.3 * H * np.random.default_rng(6).uniform(0.5, 1.5, shape)
    mean = share * float(np.mean(np.minimum(hardness, 0.3 * H)))
    contact = solve_contact(h, half_space, pressure=mean, hardness=hardness, rtol=1e-10)
    reference = programme(
        dense_operator(half_space),
        h.ravel(),
        mean,
        np.ravel(hardness) if np.ndim(hardness) else hardness,
    )
    assert_allclose(contact.pressure.ravel(), reference, rtol=0, atol=1e-6 * reference.max())
    assert 0 < contact.area_fraction < 1 or share == 0.9


@each("points", [3, 20, 200])
@each("more", [1e-6, 1e-5, 1e-4])
def test_the_load_is_exact_where_hardly_any_is_left_beside_plastic_points(points, more):
    """What the last point carries is far below the residual allowed, but belongs to the load."""
    for seed in range(5):
        z = 2e-6 * np.random.default_rng(seed).standard_normal((32, 32))
        load = (points + more) * 4e8 / z.size
        contact = solve_contact(
            z, HalfSpace(z.shape, (D, D), E, "mirror"), pressure=load, hardness=4e8, rtol=1e-3
        )
        assert_allclose(contact.pressure.mean(), load, rtol=1e-12)


# --- invariants ---


def both(h, half_space, p=0.1 * H, hardness=H, rtol=1e-10, **other):
    return solve_contact(h, half_space, pressure=p, hardness=hardness, rtol=rtol, **other)


@each(
    ("mirror", "periodic"),
    [
        (("mirror", "mirror"), ("periodic", "periodic")),
        (("mirror", "periodic"), ("periodic", "periodic")),
        (("free", "mirror"), ("free", "periodic")),
        (("mirror", "free"), ("periodic", "free")),
    ],
)
@each("shape", [(32, 24), (27, 31)])
def test_mirror_equals_the_periodic_even_extension(mirror, periodic, shape):
    h = rough(shape, seed=8)
    whole = h
    for axis, kind in enumerate(mirror):
        if kind == "mirror":
            whole = np.concatenate([whole, np.flip(whole, axis)], axis)
    half = both(h, HalfSpace(shape, (D, D), E, mirror))
    full = both(whole, HalfSpace(whole.shape, (D, D), E, periodic))
    assert_allclose(half.pressure, full.pressure[: shape[0], : shape[1]], rtol=0, atol=1e-7 * H)
    assert_allclose(half.gap, full.gap[: shape[0], : shape[1]], rtol=0, atol=1e-7 * np.ptp(h))
    assert_allclose(
        half.plastic_deformation,
        full.plastic_deformation[: shape[0], : shape[1]],
        rtol=0,
        atol=1e-7 * np.ptp(h),
    )


@each("boundary", [("periodic", "periodic"), ("free", "free"), ("free", "periodic")])
def test_an_offset_changes_the_approach_only(boundary):
    # in metres, with lengths of metres, so that an offset of 1e6 leaves ten digits of the heights
    h = rough((40, 30), spacing=(1.0, 1.0))
    half_space = HalfSpace((40, 30), (1.0, 1.0), E, boundary)
    here, far = both(h, half_space), both(h + 1e6, half_space)
    assert_allclose(far.pressure, here.pressure, rtol=0, atol=1e-8 * H)
    assert_allclose(far.gap, here.gap, rtol=0, atol=1e-8 * np.ptp(h))
    assert_allclose(far.approach - 1e6, here.approach, rtol=0, atol=1e-8 * np.ptp(h))
    assert abs(far.pressure.mean() / (0.1 * H) - 1) < 1e-12


def test_translation_on_a_periodic_surface():
    h = rough((36, 45))
    half_space = HalfSpace((36, 45), (D, 2 * D), E)
    here, moved = both(h, half_space), both(np.roll(h, (7, 20), (0, 1)), half_space)
    assert_allclose(np.roll(here.pressure, (7, 20), (0, 1)), moved.pressure, rtol=0, atol=1e-7 * H)
    assert_allclose(np.roll(here.gap, (7, 20), (0, 1)), moved.gap, rtol=0, atol=1e-7 * np.ptp(h))


@each("boundary", PAIRS)
def test_transposed_and_flipped(boundary):
    h = rough((26, 33), spacing=(D, 2 * D))
    here = both(h, HalfSpace((26, 33), (D, 2 * D), E, boundary))
    turned = both(h.T, HalfSpace((33, 26), (2 * D, D), E, boundary[::-1]))
    assert_allclose(turned.pressure.T, here.pressure, rtol=0, atol=1e-7 * H)
    flipped = both(h[::-1, ::-1], HalfSpace((26, 33), (D, 2 * D), E, boundary))
    assert_allclose(flipped.pressure[::-1, ::-1], here.pressure, rtol=0, atol=1e-7 * H)
    assert_allclose(flipped.gap[::-1, ::-1], here.gap, rtol=0, atol=1e-7 * np.ptp(h))


@settings(deadline=None, max_examples=12)
@given(
    boundary=st.sampled_from(PAIRS),
    length=st.floats(1e-9, 1e9),
    stiffness=st.floats(1e-12, 1e12),
    height=st.floats(1e-6, 1e6),
    seed=st.integers(0, 9),
)
def test_scaling_laws(boundary, length, stiffness, height, seed):
    """p/(E*·h/L) depends on the shape of the surface and on p̄/(E*·h/L) and H/(E*·h/L) alone."""
    h = rough((15, 18), seed=seed)
    here = both(h, HalfSpace((15, 18), (D, D), E, boundary))
    factor = stiffness * height
    scaled = both(
        h * length * height,
        HalfSpace((15, 18), (D * length, D * length), E * stiffness, boundary),
        p=0.1 * H * factor,
        hardness=H * factor,
    )
    assert_allclose(scaled.pressure / factor, here.pressure, rtol=0, atol=1e-7 * H)
    assert_allclose(scaled.gap / (length * height), here.gap, rtol=0, atol=1e-7 * np.ptp(h))


@settings(deadline=None, max_examples=30)
@given(
    boundary=st.sampled_from(PAIRS),
    shape=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    ratio=st.floats(1 / 30, 30),
    slope=st.floats(0.01, 2),
    share=st.floats(1e-6, 0.9999),
    white=st.booleans(),
    seed=st.integers(0, 999),
)
def test_any_surface_converges_and_satisfies_complementarity(
    boundary, shape, ratio, slope, share, white, seed
):
    spacing = (D, ratio * D)
    h = rough(shape, slope, seed, spacing, cut=1 if white else 6)
    half_space = HalfSpace(shape, spacing, E, boundary)
    contact = solve_contact(h, half_space, pressure=share * H, hardness=H)
    assert residual(contact, h, half_space, lambda p, body: body.displacement(p), H) <= 1.001e-6
    assert abs(contact.pressure.mean() / (share * H) - 1) <= 1e-12


def test_monotone_in_the_load():
    h, half_space = rough((48, 48)), HalfSpace((48, 48), (D, D), E)
    states = [both(h, half_space, p=s * H) for s in (0.02, 0.1, 0.3, 0.6)]
    for name, sign in (("area_fraction", 1), ("plastic_fraction", 1), ("mean_gap", -1)):
        assert np.all(sign * np.diff([getattr(s, name) for s in states]) > 0)


def test_softer_points_carry_less():
    h, half_space = rough((32, 32)), HalfSpace((32, 32), (D, D), E)
    hardness = np.full((32, 32), H)
    hardness[:, 16:] = 0.2 * H
    contact = solve_contact(h, half_space, pressure=0.1 * H, hardness=hardness)
    assert contact.pressure[:, :16].max() == H
    assert contact.pressure[:, 16:].max() == 0.2 * H
    uniform = solve_contact(h, half_space, pressure=0.1 * H, hardness=np.full((32, 32), H))
    assert_allclose(uniform.pressure, both(h, half_space, rtol=1e-6).pressure, rtol=1e-12)


# --- an approach instead of a load ---


@each("boundary", PAIRS)
@each("hardness", [np.inf, 0.3 * H])
def test_an_approach_and_its_load_are_one_state(boundary, hardness):
    h, half_space = rough((50, 41)), HalfSpace((50, 41), (D, D), E, boundary)
    loaded = solve_contact(h, half_space, pressure=0.05 * H, hardness=hardness, rtol=1e-9)
    moved = solve_contact(h, half_space, approach=loaded.approach, hardness=hardness, rtol=1e-9)
    assert moved.approach == loaded.approach
    assert_allclose(moved.pressure, loaded.pressure, rtol=0, atol=1e-6 * loaded.pressure.max())
    assert_allclose(moved.gap, loaded.gap, rtol=0, atol=1e-7 * np.ptp(h))
    assert (
        residual(moved, h, half_space, lambda p, body: body.displacement(p), hardness) <= 1.001e-9
    )


def test_an_approach_short_of_the_highest_point_is_no_contact():
    h, half_space = rough((20, 20)) + 3e-6, HalfSpace((20, 20), (D, D), E)
    contact = solve_contact(h, half_space, approach=h.min() - 1e-7)
    assert contact.pressure.max() == 0
    assert_allclose(contact.gap, h - h.min() + 1e-7, rtol=0, atol=1e-20)


@each(
    ("given", "word"),
    [
        ({}, "pressure and approach"),
        ({"pressure": 1e8, "approach": 0.0}, "pressure and approach"),
        ({"approach": 1e-3}, "mean of gap0"),
        ({"approach": np.nan}, "approach"),
        ({"approach": "1 um"}, "approach"),
        ({"pressure": 1e8, "threads": 0}, "threads"),
        ({"pressure": 1e8, "threads": 1.5}, "threads"),
    ],
)
def test_bad_control_is_refused(given, word):
    with pytest.raises(InputError, match=word):
        solve_contact(rough((20, 20)), HalfSpace((20, 20), (D, D), E), **given)


# --- the ways a solution takes ---


@pytest.mark.parametrize("boundary", [p for p in PAIRS if p[0] == "periodic" or p[0] == p[1]])
def test_directions_in_single_precision_lose_nothing(boundary):
    h, half_space = rough((64, 60)), HalfSpace((64, 60), (D, 1.25 * D), E, boundary)
    found = solve_contact(h, half_space, pressure=0.1 * H, hardness=H, rtol=1e-11)
    assert residual(found, h, half_space, lambda p, body: body.displacement(p), H) <= 1.001e-11


def test_an_interrupted_solution_leaves_nothing_behind():
    h, half_space = rough((40, 40)), HalfSpace((40, 40), (D, D), E)
    whole = solve_contact(h, half_space, pressure=0.1 * H, hardness=H)
    for level in workspace.nested_grids(half_space, threading.get_ident(), 1):
        for leftover in (level.points.dense, level.v, level.points.near, level.points.on_free):
            leftover[...] = 1.0
        level.points.lists[...], level.points.state[...] = 7, 1
    again = solve_contact(h, half_space, pressure=0.1 * H, hardness=H)
    assert np.array_equal(again.pressure, whole.pressure)
    assert again.fft_pairs == whole.fft_pairs


LAWS = {
    "elastic": {"pressure": 0.02 * H},
    "plastic": {"pressure": 0.1 * H, "hardness": H},
    "of points": {
        "pressure": 0.1 * H,
        "hardness": H * (1 + 0.2 * np.sin(np.arange(96.0 * 96)).reshape(96, 96)),
    },
    "hardens": {"pressure": 0.1 * H, "hardness": LinearHardening(H, 1e14)},
    "approach": {"approach": float(np.quantile(rough((96, 96)), 0.1)), "hardness": H},
}


@pytest.mark.parametrize("law", LAWS)
def test_long_lists_in_parts_change_digits_only_and_threads_not_even_these(law, monkeypatch):
    given = LAWS[law]
    h, half_space = rough((96, 96)), HalfSpace((96, 96), (D, D), E)
    whole = solve_contact(h, half_space, rtol=1e-10, **given)
    monkeypatch.setattr(long_lists, "POINTS", 1000)
    monkeypatch.setattr(long_lists, "LISTED", 60)
    monkeypatch.setattr(workspace, "_THREADED", 0)
    found = []
    for threads in (1, 2, 3):
        workspace._kept_grids.cache_clear()
        found.append(solve_contact(h, half_space, rtol=1e-10, threads=threads, **given))
    workspace._kept_grids.cache_clear()
    assert_allclose(found[0].pressure, whole.pressure, rtol=0, atol=1e-7 * H)
    assert_allclose(found[0].gap, whole.gap, rtol=0, atol=1e-7 * h.std())
    assert len({contact.pressure.tobytes() + contact.gap.tobytes() for contact in found}) == 1


@pytest.mark.parametrize("law", LAWS)
@each("boundary", [("periodic", "periodic"), ("free", "periodic"), ("mirror", "free")])
def test_large_grids_change_digits_only(law, boundary, monkeypatch):
    given = LAWS[law]
    h, half_space = rough((96, 96)), HalfSpace((96, 96), (D, D), E, boundary)
    whole = solve_contact(h, half_space, rtol=1e-10, **given)
    with monkeypatch.context() as patch:
        patch.setattr(large_convolution, "LARGE", 48**2)
        patch.setattr(workspace, "KEPT_POINTS", 0)
        patch.setattr(long_lists, "POINTS", 1000)
        patch.setattr(long_lists, "LISTED", 60)
        large = solve_contact(h, half_space, rtol=1e-10, **given)
    assert (
        large.iterations <= whole.iterations
    )  # wrong directions would be made up for by more of them
    assert large.gap.flags.c_contiguous
    for name, size in (("pressure", H), ("gap", h.std()), ("plastic_deformation", h.std())):
        assert_allclose(getattr(large, name), getattr(whole, name), rtol=0, atol=1e-7 * size)


def test_steps_become_monotone_where_active_sets_go_round_in_circles(monkeypatch):
    """Bars of 1:19 pixels: without the line search the sets repeat for ever."""
    shape, spacing = (12, 21), (D, 19 * D)
    h, half_space = rough(shape, 0.125, 1, spacing), HalfSpace(shape, spacing, E)
    for large in (np.inf, 1):
        monkeypatch.setattr(large_convolution, "LARGE", large)
        workspace._kept_grids.cache_clear()
        contact = solve_contact(h, half_space, pressure=0.09375 * H, hardness=H, rtol=1e-9)
        assert contact.iterations > 60
        assert residual(contact, h, half_space, lambda p, body: body.displacement(p), H) <= 1.001e-9
    workspace._kept_grids.cache_clear()


def test_solutions_do_not_depend_on_those_before():
    half_space = HalfSpace((40, 40), (D, D), E)
    fresh = solve_contact(rough((40, 40)), half_space, pressure=0.1 * H, hardness=H)
    solve_contact(rough((40, 40), seed=3), half_space, pressure=0.9 * H, hardness=H)
    solve_contact(rough((40, 40), seed=4), half_space, approach=-1e-7)
    again = solve_contact(rough((40, 40)), half_space, pressure=0.1 * H, hardness=H)
    assert np.array_equal(again.pressure, fresh.pressure)
    assert np.array_equal(again.gap, fresh.gap)


# --- real area ---


def test_corrected_area_of_spheres_is_nearer_to_hertz():
    load, radius = 0.5, 1e-3
    exact = np.pi * analytic.hertz_radius(load, radius, E) ** 2
    raw, corrected = [], []
    for n in (40, 47, 53, 61, 74, 83, 97):  # the radius falls on other parts of a pixel each time
        r, d = sphere(n)
        contact = solve_contact(
            r**2 / (2 * radius), HalfSpace((n, n), (d, d), E, "free"), pressure=load / (n * d) ** 2
        )
        raw.append(contact.area_fraction * (n * d) ** 2 / exact - 1)
        corrected.append(contact.area_fraction_corrected * (n * d) ** 2 / exact - 1)
    assert np.mean(raw) > 0.02
    assert abs(np.mean(corrected)) < 0.4 * np.mean(raw)


@each("boundary", PAIRS)
def test_correction_counts_the_sides_between_contact_and_gap(boundary):
    shape = (13, 9)
    contact = solve_contact(
        rough(shape, cut=2), HalfSpace(shape, (D, D), E, boundary), pressure=0.2 * H, hardness=H
    )
    touching = contact.pressure > 0
    sides = 0
    for axis, kind in enumerate(boundary):
        mode = {"periodic": "wrap", "mirror": "symmetric", "free": "constant"}[kind]
        padded = np.pad(touching, [(1, 1) if a == axis else (0, 0) for a in (0, 1)], mode=mode)
        both = np.count_nonzero(padded != np.roll(padded, 1, axis))
        seam = np.count_nonzero(padded.take(0, axis) != padded.take(-1, axis))
        ends = np.count_nonzero(
            padded.take(0, axis) != padded.take(1, axis)
        )  # a seam is counted at either end
        sides += both - seam - (ends if kind == "periodic" else 0)
    assert sides > 0
    expected = touching.mean() - (np.pi - 1 + np.log(2)) / 24 * sides / touching.size
    assert_allclose(contact.area_fraction_corrected, expected, rtol=1e-12)


def test_area_of_light_elastic_contact_grows_with_the_load_between_two_theories():
    """A/A₀ = κ p̄/(E*·slope), κ between √(8/π) (Persson) and √(2π) (Bush, Gibson & Thomas)."""
    n, slope = 192, 0.1
    shares = []
    for seed in range(4):
        h = rough((n, n), slope, seed, cut=24)
        # the rms of finite differences is a little less than that of the slope
        contact = solve_contact(h, HalfSpace((n, n), (D, D), E), pressure=0.02 * E * slope)
        shares.append(contact.area_fraction_corrected / 0.02)
    assert np.sqrt(8 / np.pi) < np.mean(shares) < np.sqrt(2 * np.pi)


# --- edges ---


@each("boundary", PAIRS)
@each(
    ("shape", "ratio"),
    [
        *itertools.product([(1, 1), (1, 23), (23, 1), (2, 2), (3, 50), (61, 7)], (1, 30)),
        ((97, 101), 30),
        ((64, 66), 30),
    ],
)
def test_every_size_and_pixel_shape(boundary, shape, ratio):
    spacing = (D, ratio * D)
    tiny = max(shape) < 6  # no room for a wave of six pixels
    h = (
        1e-3 * D * np.random.default_rng(0).standard_normal(shape)
        if tiny
        else rough(shape, spacing=spacing)
    )
    half_space = HalfSpace(shape, spacing, E, boundary)
    for hardness in (np.inf, H):
        contact = solve_contact(h, half_space, pressure=0.1 * H, hardness=hardness)
        assert (
            residual(contact, h, half_space, lambda p, body: body.displacement(p), hardness)
            <= 1.001e-6
        )
        assert abs(contact.pressure.mean() / (0.1 * H) - 1) <= 1e-12


@each("boundary", PAIRS)
def test_single_pixel(boundary):
    contact = solve_contact(
        [[5e-6]], HalfSpace((1, 1), (D, D), E, boundary), pressure=1e8, hardness=H
    )
    assert contact.pressure == 1e8
    assert contact.gap == 0


def test_a_row_equals_a_uniform_surface():
    h = rough((60, 1))
    row = both(h, HalfSpace((60, 1), (D, D), E))
    wide = both(np.repeat(h, 5, axis=1), HalfSpace((60, 5), (D, D), E))
    assert_allclose(wide.pressure, np.repeat(row.pressure, 5, axis=1), rtol=0, atol=1e-7 * H)


@each("boundary", PAIRS)
def test_a_spike_carries_all(boundary):
    h = np.full((33, 40), 1e-3)
    h[10, 11] = 0.0
    contact = solve_contact(h, HalfSpace((33, 40), (D, D), E, boundary), pressure=1e6)
    expected = np.zeros((33, 40))
    expected[10, 11] = 33 * 40 * 1e6
    assert_allclose(contact.pressure, expected, rtol=1e-13)
    assert contact.gap[10, 11] == 0
    assert np.count_nonzero(contact.gap) == 33 * 40 - 1


@each("boundary", [("periodic", "periodic"), ("mirror", "mirror"), ("free", "periodic")])
@each("hardness", [np.inf, H, 0.01 * H])
def test_white_noise(boundary, hardness):
    h = np.random.default_rng(2).standard_normal((100, 90)) * D
    half_space = HalfSpace((100, 90), (D, D), E, boundary)
    for p in (1e-4, 0.3, 0.95):
        mean = p * min(hardness, H)
        contact = solve_contact(h, half_space, pressure=mean, hardness=hardness)
        assert (
            residual(contact, h, half_space, lambda p, body: body.displacement(p), hardness)
            <= 1.001e-6
        )
        assert abs(contact.pressure.mean() / mean - 1) <= 1e-12


def test_almost_full_contact(spectral_displacement):
    h, half_space = rough((64, 64)), HalfSpace((64, 64), (D, D), E)
    q = np.hypot(*np.meshgrid(*[2 * np.pi * np.fft.fftfreq(64, D)] * 2, indexing="ij"))
    full = -np.fft.ifft2(
        np.fft.fft2(h) * E * q / 2
    ).real  # the pressure that flattens all, less its mean
    mean = -np.sort(full.ravel())[4]  # only the last few points would be in tension
    contact = solve_contact(h, half_space, pressure=mean, rtol=1e-8)
    assert 0.995 < contact.area_fraction < 1
    assert residual(contact, h, half_space, spectral_displacement) <= 1.01e-8
    closed = solve_contact(h, half_space, pressure=-full.min() * 1.001, rtol=1e-10)
    assert closed.area_fraction == 1
    assert_allclose(closed.pressure, full + closed.mean_pressure, rtol=0, atol=1e-8 * full.max())


@each("shape", [(97, 97), (131, 64), (64, 131)])
def test_a_soft_edge_does_not_hang_the_coarse_grids(shape):
    """Where the odd last row is soft, the mean hardness of a coarser grid must still carry the load."""
    hardness = np.full(shape, 1e9)
    hardness[-1], hardness[:, -1] = 1e8, 1e8
    half_space = HalfSpace(shape, (D, D), E)
    p = 0.995 * hardness.mean()
    contact = solve_contact(rough(shape), half_space, pressure=p, hardness=hardness)
    assert abs(contact.mean_pressure / p - 1) <= 1e-12


@each("share", [1 - 1e-9, 1 - 1e-11, 1 - 2e-12])
def test_just_below_the_hardness(share):
    rng = np.random.default_rng(4)
    hardness = H * rng.uniform(0.5, 1.5, (80, 80))
    contact = solve_contact(
        rough((80, 80)),
        HalfSpace((80, 80), (D, D), E),
        pressure=share * hardness.mean(),
        hardness=hardness,
    )
    assert abs(contact.mean_pressure / (share * hardness.mean()) - 1) <= 1e-12


def test_the_gap_given_is_left_alone():
    h = rough((20, 20))
    before = h.copy()
    hardness = np.full((20, 20), H)
    first = solve_contact(h, HalfSpace((20, 20), (D, D), E), pressure=1e8, hardness=hardness)
    kept = first.pressure.copy()
    solve_contact(-h, HalfSpace((20, 20), (D, D), E), pressure=3e8, hardness=hardness)
    assert np.array_equal(h, before)
    assert np.all(hardness == H)
    assert np.array_equal(first.pressure, kept)


def test_same_answer_each_time():
    h, half_space = rough((70, 70)), HalfSpace((70, 70), (D, D), E)
    a, b = both(h, half_space), both(h, half_space)
    assert np.array_equal(a.pressure, b.pressure)
    assert a.approach == b.approach


def test_stall_is_reported(monkeypatch):
    monkeypatch.setattr("femseal.contact.solver._MAX_ITERATIONS", 1)
    with pytest.raises(NotConverged, match="residual") as caught:
        solve_contact(rough((64, 64)), HalfSpace((64, 64), (D, D), E), pressure=1e9, rtol=1e-12)
    assert 1e-12 < caught.value.residual < 1


# --- bad input ---


@each(
    ("change", "words"),
    [
        ({"pressure": -1.0}, ["pressure", "-1.0"]),
        ({"pressure": np.nan}, ["pressure", "nan"]),
        ({"pressure": np.inf}, ["pressure", "inf"]),
        ({"pressure": "200 MPa"}, ["pressure", "200 MPa"]),
        ({"pressure": None}, ["pressure", "None"]),
        ({"pressure": [1e6]}, ["pressure"]),
        ({"pressure": 5e9}, ["pressure", "5e+09", "4e+09"]),
        ({"pressure": 4.0001e9}, ["pressure", "mean hardness"]),
        ({"hardness": 0.0}, ["hardness", "0 Pa", "> 0"]),
        ({"hardness": -H}, ["hardness"]),
        ({"hardness": np.nan}, ["hardness"]),
        ({"hardness": np.full((6, 5), H)}, ["hardness", "(6, 5)", "(6, 6)"]),
        ({"hardness": np.where(np.eye(6) > 0, np.nan, H)}, ["hardness"]),
        ({"hardness": "4 GPa"}, ["hardness"]),
        ({"rtol": 0.0}, ["rtol"]),
        ({"rtol": 1.0}, ["rtol"]),
        ({"rtol": np.nan}, ["rtol"]),
        ({"rtol": "fine"}, ["rtol"]),
        ({"gap0": np.zeros((6, 5))}, ["gap0", "(6, 5)", "(6, 6)"]),
        ({"gap0": np.zeros(36)}, ["gap0", "(36,)"]),
        ({"gap0": np.where(np.eye(6) > 0, np.nan, 0.0)}, ["gap0", "6 points", "finite"]),
        ({"gap0": np.where(np.eye(6) > 0, np.inf, 0.0)}, ["gap0", "6 points"]),
        ({"gap0": "heights"}, ["gap0"]),
    ],
)
def test_bad_input_is_named(change, words):
    given = {"gap0": np.zeros((6, 6)), "pressure": 1e8, "hardness": H, "rtol": 1e-6} | change
    with pytest.raises(InputError) as caught:
        solve_contact(given.pop("gap0"), HalfSpace((6, 6), (D, D), E), **given)
    assert all(word in str(caught.value) for word in words), str(caught.value)

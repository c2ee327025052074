"""Contact: closed forms with measured orders, an independent solver, complementarity, invariants, edges, bad input."""

import itertools

import numpy as np
import pytest
from contact_checks import least_energy, residual
from numpy.testing import assert_allclose
from rough_faces import rough_face

from femseal import analytic
from femseal.base import InputError, NotConverged, compiled
from femseal.contact import (
    HalfSpace,
    LinearHardening,
    active_sets,
    convolution,
    descent,
    near_points,
    solve_contact,
    workspace,
)

E = 115e9
H = 4e9
D = 1e-6
PAIRS = list(itertools.product(("periodic", "mirror", "free"), repeat=2))


def orders(errors):
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


# --- closed forms ---


def sphere(n, size=100e-6):
    d = size / n
    x = (np.arange(n) + 0.5) * d - size / 2
    r = np.hypot(x[:, None], x)
    return r, d


def test_hertz():
    """Radius, pressures, approach, and the gap outside (Johnson 1985, eq. 3.42a)."""
    load, radius = 0.5, 1e-3
    a = analytic.hertz_radius(load, radius, E)
    errors = []
    for n in (64, 128, 256):
        r, d = sphere(n, 4 * a)
        body = HalfSpace((n, n), (d, d), E, "free")
        contact = solve_contact(r**2 / (2 * radius), body, pressure=load / (n * d) ** 2, rtol=1e-9)
        exact = analytic.hertz_pressure(r, load, radius, E)
        errors.append(
            (
                np.linalg.norm(contact.pressure - exact) / np.linalg.norm(exact),
                contact.approach / analytic.hertz_approach(load, radius, E) - 1,
                contact.pressure.max() / analytic.hertz_peak_pressure(load, radius, E) - 1,
                np.sqrt(contact.area_fraction / np.pi) * 4 - 1,
            )
        )
    errors = np.abs(errors)
    assert np.all(errors[-1] < [4e-3, 1e-4, 1e-3, 5e-3])
    # a square-root edge on pixels: order 1 to 3/2 in L2, 3/2 and more in the approach
    assert np.all(np.log2(errors[0, :2] / errors[2, :2]) / 2 > [0.9, 1.3])
    outside = r > 1.2 * a
    s = r[outside]
    lift = ((2 * a**2 - s**2) * np.arcsin(a / s) + a * np.sqrt(s**2 - a**2)) / (np.pi * radius)
    exact = s**2 / (2 * radius) + lift - a**2 / radius
    assert_allclose(contact.gap[outside], exact, rtol=0, atol=2e-4 * exact.max())


@pytest.mark.parametrize(
    "boundary", [("periodic", "periodic"), ("mirror", "mirror"), ("mirror", "periodic")]
)
@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.9])
def test_westergaard_wave(boundary, ratio):
    λ, Δ = 1e-3, 1e-6
    p_full = analytic.wave_full_contact_pressure(E, Δ, λ)
    errors, gaps = [], []
    for n in (64, 128, 256, 512):
        d = (λ if boundary[0] == "periodic" else λ / 2) / n
        x = (np.arange(n) + 0.5) * d
        gap0 = np.repeat(Δ * (1 - np.cos(2 * np.pi * x / λ))[:, None], 3, axis=1)
        body = HalfSpace((n, 3), (d, d), E, boundary)
        contact = solve_contact(gap0, body, pressure=ratio * p_full, rtol=1e-9)
        assert np.ptp(contact.pressure, axis=1).max() < 1e-7 * p_full
        exact = p_full * analytic.wave_pressure(x, ratio, λ)
        errors.append(np.sqrt(np.mean((contact.pressure[:, 0] - exact) ** 2)) / p_full)
        gaps.append(np.abs(contact.gap[:, 0] - analytic.wave_gap(x, ratio, Δ, λ)).max() / Δ)
        # the edge falls within a pixel of each of its ends
        assert abs(contact.area_fraction - analytic.wave_contact_fraction(ratio)) <= 2 / n
        assert errors[-1] <= 0.5 / n
        assert gaps[-1] <= 0.05 / n + 0.3 / n**1.5
    if ratio == 0.5:  # the edge lies between two pixels on every grid: orders 1 and 3/2
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


@pytest.mark.parametrize(
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


@pytest.mark.parametrize("boundary", [p for p in PAIRS if "free" not in p])
@pytest.mark.parametrize("hardness", [np.inf, H])
@pytest.mark.parametrize("shape", [(17, 20), (1, 1)])
def test_flat_surface_carries_the_nominal_pressure_exactly(boundary, hardness, shape):
    body = HalfSpace(shape, (D, D), E, boundary)
    contact = solve_contact(np.full(shape, 3e-6), body, pressure=1e8, hardness=hardness)
    assert np.all(contact.pressure == 1e8)
    assert not contact.gap.any()
    assert not contact.plastic_deformation.any()
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


@pytest.mark.parametrize("boundary", PAIRS)
def test_no_load_is_first_touch(boundary):
    h, body = rough_face((14, 11)), HalfSpace((14, 11), (D, D), E, boundary)
    contact = solve_contact(h, body, pressure=0, hardness=H)
    assert_allclose(contact.gap, h - h.min(), rtol=0, atol=1e-15)
    assert_allclose(contact.approach, h.min(), rtol=1e-15)
    assert not contact.pressure.any()
    assert not contact.plastic_deformation.any()


@pytest.mark.parametrize("boundary", PAIRS)
def test_the_hardness_as_pressure_is_all_plastic(boundary, dense_operator):
    h, body = rough_face((8, 9)), HalfSpace((8, 9), (D, D), E, boundary)
    hardness = np.random.default_rng(1).uniform(0.5, 1.5, (8, 9)) * H
    contact = solve_contact(h, body, pressure=float(np.mean(hardness)), hardness=hardness)
    assert_allclose(contact.pressure, hardness, rtol=1e-15)
    assert contact.plastic_fraction == 1
    assert not contact.gap.any()
    v = h + (dense_operator(body) @ contact.pressure.ravel()).reshape(8, 9)
    assert_allclose(contact.plastic_deformation, v.max() - v, rtol=0, atol=1e-10 * np.ptp(v))


# --- complementarity and an independent solver ---


@pytest.mark.parametrize("boundary", [p for p in PAIRS if "free" not in p])
@pytest.mark.parametrize("share", [0.01, 0.5, 0.99])
@pytest.mark.parametrize("hardness", [H, np.inf])
def test_complementarity_recomputed(boundary, share, hardness, spectral_displacement):
    shape, spacing = (90, 64), (D, 1.5 * D)
    h = rough_face(shape, spacing=spacing, seed=3)
    body = HalfSpace(shape, spacing, E, boundary)
    contact = solve_contact(h, body, pressure=share * H, hardness=hardness, rtol=1e-8)
    assert residual(contact, h, spectral_displacement, hardness) <= 1.01e-8
    assert contact.residual <= 1e-8
    p, gap, left = contact.pressure, contact.gap, contact.plastic_deformation
    assert_allclose(p.mean(), share * H, rtol=1e-12)
    assert 0 <= p.min() <= p.max() <= hardness
    assert np.array_equal(contact.plastic, p >= hardness)
    assert_allclose(contact.raw_gap, gap - left)
    g = spectral_displacement(p, body) + h - contact.approach
    tiny = {"rtol": 0, "atol": 1e-12 * np.ptp(h)}
    assert_allclose(gap, np.where(p == 0, np.maximum(g, 0), 0), **tiny)
    assert_allclose(left, np.where(contact.plastic, np.maximum(-g, 0), 0), **tiny)


@pytest.mark.parametrize("boundary", PAIRS)
@pytest.mark.parametrize(
    ("share", "hardness"), [(0.03, np.inf), (0.03, 0.3 * H), (0.5, 0.3 * H), (0.9, "field")]
)
def test_equals_an_independent_solver(boundary, share, hardness, dense_operator):
    shape, spacing = (6, 7), (D, 1.7 * D)
    body = HalfSpace(shape, spacing, E, boundary)
    h = rough_face(shape, 0.15, seed=5, spacing=spacing, cut=3)
    if hardness == "field":
        hardness = 0.3 * H * np.random.default_rng(6).uniform(0.5, 1.5, shape)
    mean = share * float(np.mean(np.minimum(hardness, 0.3 * H)))
    contact = solve_contact(h, body, pressure=mean, hardness=hardness, rtol=1e-10)
    p = least_energy(dense_operator(body), h.ravel(), mean, np.ravel(hardness))
    assert_allclose(contact.pressure.ravel(), p, rtol=0, atol=1e-6 * p.max())
    assert 0 < contact.area_fraction < 1 or share == 0.9


@pytest.mark.parametrize("points", [3, 20, 200])
@pytest.mark.parametrize("more", [1e-6, 1e-5, 1e-4])
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


@pytest.mark.parametrize(
    ("mirror", "periodic"),
    [
        (("mirror", "mirror"), ("periodic", "periodic")),
        (("free", "mirror"), ("free", "periodic")),
        (("mirror", "free"), ("periodic", "free")),
    ],
)
@pytest.mark.parametrize("shape", [(32, 24), (27, 31)])
def test_mirror_equals_the_periodic_even_extension(mirror, periodic, shape):
    whole = h = rough_face(shape, seed=8)
    for axis, kind in enumerate(mirror):
        if kind == "mirror":
            whole = np.concatenate([whole, np.flip(whole, axis)], axis)
    half = both(h, HalfSpace(shape, (D, D), E, mirror))
    full = both(whole, HalfSpace(whole.shape, (D, D), E, periodic))
    for name, size in (("pressure", H), ("gap", np.ptp(h)), ("plastic_deformation", np.ptp(h))):
        part = getattr(full, name)[: shape[0], : shape[1]]
        assert_allclose(getattr(half, name), part, rtol=0, atol=1e-7 * size)


@pytest.mark.parametrize(
    "boundary", [("periodic", "periodic"), ("free", "free"), ("free", "periodic")]
)
def test_an_offset_changes_the_approach_only(boundary):
    # in metres, with lengths of metres, so that an offset of 1e6 leaves ten digits of the heights
    h = rough_face((40, 30), spacing=(1.0, 1.0))
    half_space = HalfSpace((40, 30), (1.0, 1.0), E, boundary)
    here, far = both(h, half_space), both(h + 1e6, half_space)
    assert_allclose(far.pressure, here.pressure, rtol=0, atol=1e-8 * H)
    assert_allclose(far.gap, here.gap, rtol=0, atol=1e-8 * np.ptp(h))
    assert_allclose(far.approach - 1e6, here.approach, rtol=0, atol=1e-8 * np.ptp(h))
    assert abs(far.pressure.mean() / (0.1 * H) - 1) < 1e-12


# --- the ways a solution takes ---


LAWS = {
    "elastic": {"pressure": 0.02 * H},
    "of points": {
        "pressure": 0.1 * H,
        "hardness": H * (1 + 0.2 * np.sin(np.arange(96.0 * 96)).reshape(96, 96)),
    },
    "hardens": {"pressure": 0.1 * H, "hardness": LinearHardening(H, 1e14)},
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    "boundary", [("periodic", "periodic"), ("free", "periodic"), ("mirror", "free")]
)
def test_large_grids_change_digits_only_and_threads_not_even_these(law, boundary, monkeypatch):
    given = LAWS[law] | {"rtol": 1e-10}
    h, body = rough_face((96, 96)), HalfSpace((96, 96), (D, D), E, boundary)
    whole = solve_contact(h, body, **given)
    with monkeypatch.context() as patch:
        patch.setattr(convolution, "LARGE", 48**2)
        patch.setattr(workspace, "KEPT_POINTS", 0)
        patch.setattr(workspace, "_THREADED", 0)
        patch.setattr(near_points, "PART", 1000)
        patch.setattr(compiled, "_ITEMS", 60)
        patch.setattr(active_sets, "_SINGLE_FROM", 0)
        large, *others = (solve_contact(h, body, threads=n, **given) for n in (1, 2, 3))
    for other in others:
        assert other.pressure.tobytes() + other.gap.tobytes() == (
            large.pressure.tobytes() + large.gap.tobytes()
        )
    # wrong directions would be made up for by many more products, other digits by a few
    assert large.fft_pairs <= 1.25 * whole.fft_pairs
    for name, size in (("pressure", H), ("gap", h.std()), ("plastic_deformation", h.std())):
        assert_allclose(getattr(large, name), getattr(whole, name), rtol=0, atol=1e-7 * size)


@pytest.mark.parametrize("hardness", [H, np.inf])
@pytest.mark.parametrize(
    "boundary", [("periodic", "periodic"), ("mirror", "periodic"), ("free", "free")]
)
def test_products_in_single_precision_leave_no_error(hardness, boundary, monkeypatch):
    """Displacements of the returned pressure in double precision give the same gap and residual at any tolerance."""
    shape = (160, 128)
    h, body = rough_face(shape, seed=5), HalfSpace(shape, (D, D), E, boundary)
    products = []
    apply = convolution.Convolution.apply

    def counted_apply(product):
        if product.pressure.shape == shape:
            products.append(product.pressure.dtype)
        apply(product)

    monkeypatch.setattr(convolution.Convolution, "apply", counted_apply)
    with monkeypatch.context() as patch:
        patch.setattr(active_sets, "_SINGLE_FROM", np.inf)
        in_double = solve_contact(h, body, pressure=0.05 * H, hardness=hardness, rtol=1e-11)
    most_double_products = products.count(np.float64)
    for rtol in (1e-1, 1e-3, 1e-5, 1e-8, 1e-11):
        products.clear()
        contact = solve_contact(h, body, pressure=0.05 * H, hardness=hardness, rtol=rtol)
        double_products = products.count(np.float64)
        p = contact.pressure
        assert residual(contact, h, hardness=hardness) <= 1.01 * rtol
        raw_gap = body.displacement(p) + h - contact.approach
        expected = np.where(p == 0, np.maximum(raw_gap, 0), 0)
        assert_allclose(contact.gap, expected, rtol=0, atol=1e-12 * np.ptp(h))
    # at most two sets were chosen below the residual down to which single precision is used
    assert double_products < most_double_products - 2
    assert contact.fft_pairs <= in_double.fft_pairs + 3
    assert_allclose(p, in_double.pressure, rtol=0, atol=1e-9 * p.max())


def test_solutions_do_not_depend_on_those_before_and_leave_what_is_given():
    half_space, h = HalfSpace((40, 40), (D, D), E), rough_face((40, 40))
    hardness = np.full((40, 40), H)
    before = h.copy()
    fresh = solve_contact(h, half_space, pressure=0.1 * H, hardness=hardness)
    kept = fresh.pressure.copy()
    solve_contact(rough_face((40, 40), seed=3), half_space, pressure=0.9 * H, hardness=H)
    again = solve_contact(h, half_space, pressure=0.1 * H, hardness=hardness)
    assert np.array_equal(again.pressure, fresh.pressure)
    assert np.array_equal(again.gap, fresh.gap)
    assert np.array_equal(fresh.pressure, kept)
    assert np.array_equal(h, before)
    assert np.all(hardness == H)


def test_bodies_that_differ_in_their_modulus_share_their_arrays():
    """Scaled alike, pressures are in proportion to the modulus, and no grid is made for another one."""
    h = rough_face((40, 40))
    soft, hard = (HalfSpace((40, 40), (D, D), factor * E) for factor in (1, 2))
    one = solve_contact(h, soft, pressure=1e8, hardness=H, rtol=1e-9)
    arrays = workspace.workspace(soft).arrays
    other = solve_contact(h, hard, pressure=2e8, hardness=2 * H, rtol=1e-9)
    assert workspace.workspace(hard).arrays is arrays
    assert_allclose(other.pressure, 2 * one.pressure, rtol=0, atol=1e-9 * H)
    assert_allclose(other.gap, one.gap, rtol=0, atol=1e-12 * np.ptp(h))


def test_arrays_of_the_grids_used_least_recently_are_released(monkeypatch):
    """The arrays that a thread keeps have a limited number of points in all."""
    monkeypatch.setattr(workspace, "_KEPT_IN_ALL", 2 * 30**2)
    first, second, third = (HalfSpace((n, n), (D, D), E) for n in (28, 29, 30))
    arrays = [workspace.workspace(half_space).arrays for half_space in (first, second)]
    assert workspace.workspace(first).arrays is arrays[0]
    workspace.workspace(
        third
    )  # takes the place of the second grid, which was used before the first one
    assert workspace.workspace(first).arrays is arrays[0]
    assert workspace.workspace(second).arrays is not arrays[1]


def test_steps_become_monotone_where_active_sets_go_round_in_circles(monkeypatch):
    """Bars of 1:19 pixels: without the line search the sets repeat for ever; rising energies end that early."""
    shape, spacing = (12, 21), (D, 19 * D)
    h, body = rough_face(shape, 0.125, 1, spacing), HalfSpace(shape, spacing, E)
    contact = solve_contact(h, body, pressure=0.09375 * H, hardness=H, rtol=1e-9)
    assert contact.iterations < 60
    assert residual(contact, h, hardness=H) <= 1.001e-9
    monkeypatch.setattr(active_sets, "_MONOTONE_AFTER", np.inf)
    monkeypatch.setattr(active_sets, "_MONOTONE_BELOW", 0.0)
    with pytest.raises(NotConverged):
        solve_contact(h, body, pressure=0.09375 * H, hardness=H, rtol=1e-9)


def test_monotone_steps_take_over_without_a_product_in_vain(monkeypatch):
    """They compute the displacement of the pressure that they take over by themselves."""
    h, body = rough_face((24, 24)), HalfSpace((24, 24), (D, D), E)

    def no_step(grid, problem, delta, rtol, limit):
        return descent.Solution(delta, residual=0.0, iterations=0, products=0)

    monkeypatch.setattr(active_sets, "_MONOTONE_AFTER", 0)
    monkeypatch.setattr(active_sets, "descend", no_step)
    contact = solve_contact(h, body, pressure=0.1 * H, hardness=H)
    assert contact.fft_pairs == 1  # that of the first guess


# --- slender surfaces ---


@pytest.mark.parametrize("shape", [(2, 32768), (1, 16384), (16384, 1), (40, 2048)])
@pytest.mark.parametrize("hardness", [np.inf, 0.02 * E])
def test_slender_surfaces_take_no_more_products_than_their_length_needs(shape, hardness):
    """Two hundred where they took up to fourteen hundred."""
    h = rough_face(shape, 0.1, seed=1, cut=12)
    contact = solve_contact(h, HalfSpace(shape, (D, D), E), pressure=0.001 * E, hardness=hardness)
    assert residual(contact, h, hardness=hardness) <= 1.01e-6
    assert contact.fft_pairs <= 1.4 * np.sqrt(max(shape))


@pytest.mark.parametrize("kind", ["periodic", "mirror"])
@pytest.mark.parametrize("rows", [2, 3])
def test_a_profile_is_the_surface_that_repeats_it(kind, rows):
    h = rough_face((1, 4096), 0.1, seed=2)
    given = {"pressure": 0.001 * E, "hardness": 0.02 * E, "rtol": 1e-9}
    line = solve_contact(h, HalfSpace((1, 4096), (D, D), E, kind), **given)
    sheet = np.repeat(h, rows, axis=0)
    strip = solve_contact(sheet, HalfSpace(sheet.shape, (D, D), E, kind), **given)
    assert_allclose(strip.pressure, line.pressure + 0 * sheet, rtol=0, atol=1e-6 * 0.02 * E)
    assert_allclose(strip.gap, line.gap + 0 * sheet, rtol=0, atol=1e-6 * np.ptp(h))


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


@pytest.mark.parametrize("boundary", PAIRS)
def test_correction_counts_the_sides_between_contact_and_gap(boundary):
    shape = (13, 9)
    body = HalfSpace(shape, (D, D), E, boundary)
    contact = solve_contact(rough_face(shape, cut=2), body, pressure=0.2 * H, hardness=H)
    touching = contact.pressure > 0
    sides = 0
    for axis, kind in enumerate(boundary):
        before = {"periodic": touching.take([-1], axis), "mirror": touching.take([0], axis)}
        closed = np.zeros_like(touching.take([0], axis))
        ends = {"prepend": before.get(kind, closed)}
        if kind == "free":
            ends["append"] = closed
        sides += np.count_nonzero(np.diff(touching, axis=axis, **ends))
    assert sides > 0
    expected = touching.mean() - (np.pi - 1 + np.log(2)) / 24 * sides / touching.size
    assert_allclose(contact.area_fraction_corrected, expected, rtol=1e-12)


def test_area_of_light_elastic_contact_grows_with_the_load_between_two_theories():
    """A/A₀ = κ p̄/(E*·slope), κ between √(8/π) (Persson) and √(2π) (Bush, Gibson & Thomas)."""
    n, slope = 192, 0.1
    shares = []
    for seed in range(4):
        h = rough_face((n, n), slope, seed, cut=24)
        # the rms of finite differences is a little less than that of the slope
        contact = solve_contact(h, HalfSpace((n, n), (D, D), E), pressure=0.02 * E * slope)
        shares.append(contact.area_fraction_corrected / 0.02)
    assert np.sqrt(8 / np.pi) < np.mean(shares) < np.sqrt(2 * np.pi)


# --- edges ---


@pytest.mark.parametrize("boundary", PAIRS)
def test_a_spike_carries_all(boundary):
    h = np.full((33, 40), 1e-3)
    h[10, 11] = 0.0
    contact = solve_contact(h, HalfSpace((33, 40), (D, D), E, boundary), pressure=1e6)
    assert_allclose(contact.pressure, np.where(h == 0, h.size * 1e6, 0), rtol=1e-13)
    assert np.array_equal(contact.gap == 0, h == 0)


def test_almost_full_contact(spectral_displacement):
    h, half_space = rough_face((64, 64)), HalfSpace((64, 64), (D, D), E)
    q = 2 * np.pi * np.hypot(*np.ix_(*[np.fft.fftfreq(64, D)] * 2))
    # the pressure that flattens all, less its mean
    full = -np.fft.ifft2(np.fft.fft2(h) * E * q / 2).real
    mean = -np.sort(full.ravel())[4]  # only the last few points would be in tension
    contact = solve_contact(h, half_space, pressure=mean, rtol=1e-8)
    assert 0.995 < contact.area_fraction < 1
    assert residual(contact, h, spectral_displacement) <= 1.01e-8
    closed = solve_contact(h, half_space, pressure=-full.min() * 1.001, rtol=1e-10)
    assert closed.area_fraction == 1
    assert_allclose(closed.pressure, full + closed.mean_pressure, rtol=0, atol=1e-8 * full.max())


@pytest.mark.parametrize("shape", [(97, 97), (64, 131), (80, 80)])
@pytest.mark.parametrize("share", [0.995, 1 - 1e-9, 1 - 2e-12])
def test_just_below_the_hardness(shape, share):
    """Also where the odd last row is soft: the mean hardness of a coarser grid must still carry the load."""
    hardness = H * np.random.default_rng(4).uniform(0.5, 1.5, shape)
    hardness[-1], hardness[:, -1] = 0.1 * H, 0.1 * H
    p = share * hardness.mean()
    body = HalfSpace(shape, (D, D), E)
    contact = solve_contact(rough_face(shape), body, pressure=p, hardness=hardness)
    assert_allclose(contact.mean_pressure, p, rtol=1e-12)


# --- bad input ---


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pressure": -1.0}, ["pressure", "-1.0"]),
        ({"pressure": np.nan}, ["pressure", "nan"]),
        ({"pressure": "200 MPa"}, ["pressure", "200 MPa"]),
        ({"pressure": [1e6]}, ["pressure"]),
        ({"pressure": 4.0001e9, "hardness": H}, ["pressure", "4.0001e+09", "4e+09 Pa", "hardness"]),
        ({"pressure": None}, ["pressure", "None"]),
        ({"threads": 0}, ["threads"]),
        ({"threads": 1.5}, ["threads"]),
        ({"hardness": 0.0}, ["hardness", "0 Pa", "> 0"]),
        ({"hardness": np.full((6, 5), H)}, ["hardness", "(6, 5)", "(6, 6)"]),
        ({"hardness": np.where(np.eye(6) > 0, np.nan, H)}, ["hardness"]),
        ({"hardness": "4 GPa"}, ["hardness"]),
        ({"rtol": 0.0}, ["rtol"]),
        ({"rtol": "fine"}, ["rtol"]),
        ({"gap0": np.zeros((6, 5))}, ["gap0", "(6, 5)", "(6, 6)"]),
        ({"gap0": np.where(np.eye(6) > 0, np.nan, 0.0)}, ["gap0", "6 points", "finite"]),
        ({"gap0": "heights"}, ["gap0"]),
        ({"deformation": np.eye(6) - 2.0}, ["deformation", "-2 m", ">= 0"]),
    ],
)
def test_bad_input_is_named(change, words):
    given = {"gap0": np.zeros((6, 6)), "pressure": 1e8, "hardness": np.inf} | change
    with pytest.raises(InputError) as caught:
        solve_contact(half_space=HalfSpace((6, 6), (D, D), E), **given)
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_an_approach_in_place_of_a_pressure_is_answered_with_what_to_do():
    body = HalfSpace((6, 6), (D, D), E)
    with pytest.raises(InputError, match=r"approach: given 1e-06, .*give the pressure"):
        solve_contact(np.zeros((6, 6)), body, approach=1e-6)

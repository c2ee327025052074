"""Cell flow: closed forms with measured orders, contrast, percolation, bounds, tensor, invariants, bad input."""

import numpy as np
import pytest
from each import each
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import cell_links, solve_links
from numpy.testing import assert_allclose
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve
from skfem import Basis, BilinearForm, ElementQuad2, ElementTriP1, MeshQuad, MeshTri
from skfem.helpers import dot, grad

from femseal import analytic
from femseal.base import threads
from femseal.base.errors import InputError, NotConverged
from femseal.flow import (
    cell,
    cell_permeability,
    critical_constriction,
    percolation,
    permeability_tensor,
)
from femseal.flow.coefficient import gap_on_links
from femseal.flow.law import cubic_law
from femseal.flow.solvers import choice, hierarchy

D = 1e-6
SIDES = ("mirror", "periodic")


def rough(shape, seed=0, cut=8):
    rng = np.random.default_rng(seed)
    q = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1])[None, :])
    amplitude = np.where((q > 0) & (q <= 1 / cut), np.maximum(q, 4 / max(shape)) ** -1.8, 0.0)
    h = np.fft.ifft2(np.fft.fft2(rng.standard_normal(shape)) * amplitude).real
    return h / h.std() * D


def cut_by_plane(shape, contact_fraction, seed=0, cut=8):
    """Gap above a plane that touches a given share of a rough surface."""
    h = rough(shape, seed, cut)
    return np.maximum(h - np.quantile(h, contact_fraction), 0.0)


def k_of(gap, spacing=(D, D), **options):
    return cell_permeability(gap, spacing, **options).value


def order(errors):
    """Observed order over meshes refined by two each."""
    return np.log2(abs(errors[0] / errors[-1])) / (len(errors) - 1)


# --- closed forms ---


@each("shape", [(1, 1), (1, 9), (9, 1), (2, 2), (3, 3), (2, 7), (16, 12), (31, 17)])
@each("spacing", [(D, D), (D, 30 * D), (7 * D, D)])
@each("axis", [0, 1])
@each("sides", SIDES)
def test_flat_gap_is_exact(shape, spacing, axis, sides):
    h = 3.7e-7
    assert_allclose(
        k_of(np.full(shape, h), spacing, axis=axis, sides=sides),
        analytic.parallel_plates(h),
        rtol=1e-12,
    )
    k = cell_permeability(
        np.full(shape, h), spacing, axis=axis, sides=sides, bounds=True, rtol=1e-12
    )
    assert_allclose(k.value, analytic.parallel_plates(h), rtol=1e-12)
    assert_allclose([k.lower, k.upper], k.value, rtol=1e-11)
    assert k.percolates
    assert k.fluid_pressure.shape == shape
    n = shape[axis]
    drop = 1 - (np.arange(n) + 0.5) / n
    assert_allclose(
        k.fluid_pressure, np.broadcast_to(drop[:, None] if axis == 0 else drop, shape), rtol=1e-12
    )


@each("axis", [0, 1])
def test_wavy_gap_along_the_ridges(axis):
    h0, ε, n = 1e-6, 0.6, 24
    x = (np.arange(n) + 0.5) / n
    h = np.broadcast_to(h0 * (1 + ε * np.cos(2 * np.pi * x)), (10, n))
    h = h if axis == 0 else h.T
    for sides in SIDES:
        # the mean of h³ over equidistant points is exact
        assert_allclose(
            k_of(h, (D, 2 * D), axis=axis, sides=sides), analytic.wavy_gap_along(h0, ε), rtol=1e-12
        )


@each("axis", [0, 1])
@each("ε", [0.3, 0.8])
def test_wavy_gap_across_the_ridges(axis, ε):
    h0 = 1e-6
    exact = analytic.wavy_gap_across(h0, ε)
    errors = []
    for n in (24, 48, 96):
        x = (np.arange(n) + 0.5) / n
        h = np.repeat(h0 * (1 + ε * np.cos(2 * np.pi * x))[:, None], 3, axis=1)
        errors.append(k_of(h if axis == 0 else h.T, axis=axis) / exact - 1)
    assert abs(errors[-1]) < 3e-4
    assert order(errors) >= 1.9


def test_smooth_two_dimensional_gap_is_of_second_order():
    values = []
    for n in (16, 32, 64, 128):
        x = (np.arange(n) + 0.5) / n * 2 * np.pi
        h = 1e-6 * (1 + 0.5 * np.cos(x)[:, None] * np.cos(x) + 0.3 * np.sin(x)[:, None])
        values.append(k_of(h, sides="periodic"))
    steps = np.diff(values)
    assert np.log2(steps[0] / steps[2]) / 2 >= 1.9


@each("axis", [0, 1])
def test_limit_of_refinement_is_that_of_quadratic_elements(axis):
    """Another discretisation altogether: Q2 by scikit-fem with the gap given at every quadrature point."""

    def gap(x, y):
        return D * (
            1
            + 0.5 * np.cos(np.pi * x) * np.cos(2 * np.pi * y)
            + 0.3 * np.cos(2 * np.pi * x) * np.cos(np.pi * y)
        )

    limits = []
    for n in (16, 32):
        mesh = MeshQuad.init_tensor(np.arange(n + 1.0) / n, np.arange(n + 1.0) / n)
        basis = Basis(mesh, ElementQuad2(), intorder=8)
        k = gap(*basis.global_coordinates().value) ** 3 / 12
        a = energy_of_pressure.assemble(basis, k=k).tocsr()
        x = basis.doflocs[axis]
        p = np.where(x == 0, 1.0, 0.0)
        unknown = (x > 0) & (x < 1)
        p[unknown] = spsolve(a[unknown][:, unknown].tocsc(), -(a[unknown] @ p))
        limits.append(float(p @ (a @ p)))
    limit = limits[-1]
    assert abs(limits[0] / limit - 1) < 1e-4
    errors = []
    for n in (32, 64, 128):
        x = (np.arange(n) + 0.5) / n
        errors.append(k_of(gap(x[:, None], x), (D / n, D / n), axis=axis) / limit - 1)
    assert abs(errors[-1]) < 1e-3
    assert 1.8 < order(errors) < 2.3


@each("ratio", [0.1, 0.5, 0.9])
def test_flow_along_westergaard_grooves(ratio):
    λ, Δ = 1e-3, 1e-6
    errors = []
    for n in (50, 100, 200, 400):
        x = (np.arange(n) + 0.5) * λ / n
        h = np.broadcast_to(analytic.wave_gap(x, ratio, Δ, λ), (4, n))
        errors.append(
            12
            * k_of(h, (λ / n, λ / n), sides="periodic")
            / (2 * Δ) ** 3
            / analytic.wave_groove_flow(ratio)
            - 1
        )
        assert k_of(h, axis=1) == 0
    assert abs(errors[-1]) < 1e-4
    assert order(errors) >= 1.9


@each("sides", SIDES)
def test_stripes_along_are_parallel(sides):
    """Parallel stripes: exact for any widths, because nothing crosses over."""
    h = np.repeat([1e-6, 2e-6, 0.0, 5e-7], 6)
    k = k_of(np.broadcast_to(h, (5, 24)), sides=sides)
    assert_allclose(k, analytic.stripes_along(analytic.parallel_plates(h)), rtol=1e-12)


def test_stripes_across_are_in_series_in_the_limit():
    h = np.array([1e-6, 2e-6])
    exact = analytic.stripes_across(analytic.parallel_plates(h))
    errors = [
        k_of(np.repeat(np.repeat(h, m)[:, None], 3, axis=1)) / exact - 1 for m in (16, 32, 64)
    ]
    # the step is interpolated over one link: first order
    assert abs(errors[-1]) < 0.02
    assert 0.9 < order(errors) < 1.1
    assert_allclose(2 * errors[-1] - errors[-2], 0, atol=1e-3)
    closed = np.repeat(np.array([1e-6, 0.0, 2e-6]), 4)
    assert k_of(np.repeat(closed[:, None], 3, axis=1)) == 0


def midway(before, a, b, after):
    """The documented gap between pixels a and b: cubic, without an outer pixel beyond a jump, a tenth at least, 0 in contact."""
    smaller, middle = np.minimum(a, b), (9 * (a + b) - before - after) / 16
    bends = np.stack([before - 2 * a + b, a - 2 * b + after])
    jumps = (middle < 0.8 * smaller) & (bends.max(axis=0) > 8 * abs(bends.min(axis=0)))
    middle = np.where(jumps, (a + b) / 2 - bends.min(axis=0) / 8, middle)
    return np.where(smaller > 0, np.maximum(middle, 0.1 * smaller), 0.0)


def series(h, d1, d2, width):
    """k of a column of pixels by the documented link: half links at the ends, cubic mid-link gap, limiter."""
    padded = np.concatenate([h[1::-1], h, h[:-3:-1]])
    resistance = 0.0
    for i in range(1, padded.size - 2):
        a, b = padded[i], padded[i + 1]
        middle = midway(padded[i - 1], a, b, padded[i + 2])
        length = d1 / 2 if i in (1, padded.size - 3) else d1
        resistance += 12 * length / (middle**3 * d2 * width)
    return h.size * d1 / (width * d2) / resistance


@each("ratio", [0.2, 0.1, 1e-2, 1e-6])
def test_plates_in_series_err_by_half_a_pixel(ratio):
    """Where the gap jumps the cubic would dip on the lower plate; the link across the jump is the mean of both."""
    for n in (64, 256):
        h = np.full((n, 3), D)
        h[n // 2 :] *= ratio
        exact = cubic_law(D) * 2 / (1 + ratio**-3)
        assert exact < k_of(h) < (1 + 1.05 / n) * exact
        assert k_of(h[::-1]) == pytest.approx(k_of(h), rel=1e-12)


def test_links_are_the_documented_ones_on_rough_and_on_smooth_gaps():
    jumps = 0
    for h in (
        D * np.exp(3 * np.random.default_rng(0).standard_normal((40, 30))),
        cut_by_plane((40, 30), 0.2),
    ):
        for axis, found in enumerate(gap_on_links(h, True, True)):
            before, a, b, after = (np.roll(h, -k, axis) for k in range(-1, 3))
            assert_allclose(found, midway(before, a, b, after), rtol=1e-12)
            plain = np.maximum((9 * (a + b) - before - after) / 16, 0.1 * np.minimum(a, b))
            jumps += np.count_nonzero(found > 1.01 * np.where(np.minimum(a, b) > 0, plain, 0))
    assert jumps > 20


@each("contrast", [1.0, 1e3, 1e9, 1e15])
@each("width", [1, 4])
def test_series_at_any_contrast(contrast, width):
    h = 1e-6 * np.array([1, 1, 1 / contrast, 1, 1, 1, 1, 1 / contrast, 1 / contrast, 1, 1])
    field = np.repeat(h[:, None], width, axis=1)
    exact = series(h, D, 3 * D, width)
    for sides in SIDES:
        assert_allclose(k_of(field, (D, 3 * D), sides=sides), exact, rtol=1e-12)
        assert_allclose(k_of(field.T, (3 * D, D), sides=sides, axis=1), exact, rtol=1e-12)


@each("contrast", [1e3, 1e9, 1e15])
def test_parallel_channels_and_a_constriction_at_any_contrast(contrast):
    """Two channels behind walls: each is a series, together the sum."""
    a = np.array([1, 1, 1 / contrast, 1, 1, 1, 1])
    b = np.array([1, 1, 1, 1, 3 / contrast, 1, 1])
    h = 1e-6 * np.stack([0 * a, a, 0 * a, b, 0 * a], axis=1)
    exact = 1e-18 * (series(a, D, D, 1) + series(b, D, D, 1)) / 5
    assert_allclose(k_of(h), exact, rtol=1e-12)
    assert_allclose(k_of(h, sides="periodic"), exact, rtol=1e-12)


@each("ratio", [1.5, 4.0])
def test_checkerboard(ratio):
    """Squares about the centre of the cell; its edges are lines of symmetry of the board."""
    exact = analytic.checkerboard(*analytic.parallel_plates([D, ratio * D]))
    board = D * np.array([[1, ratio], [ratio, 1]])
    errors, widths = [], []
    for m in (4, 8, 16, 32, 64):
        k = cell_permeability(np.kron(board, np.ones((m, m))), (D, D), bounds=True)
        assert k.lower <= exact <= k.upper
        widths.append(k.upper - k.lower)
        errors.append(k.value / exact - 1)
    assert np.all(np.diff(widths) < 0)
    # the flow is singular at the centre, p ~ r^α, which limits the order to 2α
    α = 4 / np.pi * np.arctan(ratio**-1.5)
    assert abs(np.log2(errors[-2] / errors[-1]) - min(1, 2 * α)) < 0.1
    if ratio < 2:
        a, b, c = errors[-3:]
        assert abs(c - (c - b) ** 2 / (c - 2 * b + a)) < 1e-3


@settings(deadline=None, max_examples=15)
@given(
    seed=st.integers(0, 99),
    λ=st.floats(1e-12, 1e-3),
    share=st.floats(0, 0.5),
    sides=st.sampled_from(SIDES),
)
def test_scales_with_the_cube_of_the_gap_and_not_with_the_pixel(seed, λ, share, sides):
    h = cut_by_plane((14, 11), share, seed, cut=3) / D
    reference = k_of(h, (1.0, 2.5), sides=sides)
    assert_allclose(k_of(λ * h, (1.0, 2.5), sides=sides), λ**3 * reference, rtol=1e-12)
    assert_allclose(k_of(h, (λ, 2.5 * λ), sides=sides), reference, rtol=1e-12)


@settings(deadline=None, max_examples=15)
@given(
    seed=st.integers(0, 99),
    share=st.floats(0, 0.45),
    sides=st.sampled_from(SIDES),
    n1=st.integers(1, 20),
    n2=st.integers(1, 20),
)
def test_symmetries(seed, share, sides, n1, n2):
    h = cut_by_plane((n1, n2), share, seed, cut=2) if n1 * n2 > 1 else np.ones((1, 1))
    h = np.nan_to_num(h, nan=D)
    exactly = {"sides": sides, "rtol": 1e-12}
    k = k_of(h, (D, 2 * D), **exactly)
    assert_allclose(k_of(h.T, (2 * D, D), **exactly, axis=1), k, rtol=1e-12)
    assert_allclose(k_of(h[::-1], (D, 2 * D), **exactly), k, rtol=1e-12)
    assert_allclose(k_of(h[:, ::-1], (D, 2 * D), **exactly), k, rtol=1e-12)
    if sides == "periodic":
        assert_allclose(k_of(np.roll(h, 3, axis=1), (D, 2 * D), **exactly), k, rtol=1e-12)


@each("shape", [(20, 24), (17, 13), (5, 1), (6, 2)])
@each("share", [0.0, 0.2, 0.4])
def test_mirror_equals_the_periodic_even_extension(shape, share):
    h = cut_by_plane((40, 40), share, seed=1)[: shape[0], 5 : 5 + shape[1]]
    for rtol in (1e-6, 1e-11):
        asked = {"rtol": rtol, "field_rtol": rtol}
        a = cell_permeability(h, (D, D), **asked)
        b = cell_permeability(
            np.concatenate([h, h[:, ::-1]], axis=1), (D, D), sides="periodic", **asked
        )
        assert_allclose(a.value, b.value, rtol=rtol)
        assert_allclose(
            a.fluid_pressure[h > 0], b.fluid_pressure[:, : shape[1]][h > 0], rtol=0, atol=10 * rtol
        )


def test_opening_one_pixel_never_closes():
    """More gap, more flow, as long as links grow with their ends: on links between equal neighbours."""
    h = cut_by_plane((16, 16), 0.3, seed=3)
    assert k_of(2 * h + 0.1 * D) > k_of(2 * h) > k_of(h)


# --- percolation ---


@each("sides", SIDES)
def test_a_wall_of_one_pixel_closes(sides):
    h = np.full((12, 9), D)
    h[5] = 0
    k = cell_permeability(h, (D, D), sides=sides, bounds=True)
    assert (k.value, k.lower, k.upper) == (0, 0, 0)
    assert not k.percolates
    assert k_of(h, axis=1, sides=sides) > 0


@each("sides", SIDES)
@each("column", [0, 4, 8])
def test_a_channel_of_one_pixel_is_open(sides, column):
    h = np.zeros((12, 9))
    h[:, column] = D
    k = cell_permeability(h, (D, D), sides=sides, bounds=True)
    assert k.percolates
    assert_allclose([k.value, k.lower], D**3 / 12 / 9, rtol=1e-12)
    assert k_of(h, axis=1, sides=sides) == 0


def test_corner_contact_is_closed():
    h = np.zeros((6, 6))
    h[:3, :3], h[3:, 3:] = D, D
    for sides in SIDES:
        k = cell_permeability(h, (D, D), sides=sides, bounds=True)
        assert k.value == k.lower == 0
        assert not k.percolates
        assert k.upper > 0  # conforming pressures meet at the corner
    h[2, 3] = D
    assert k_of(h) > 0


def test_a_seam_joins_on_periodic_cells_only():
    h = np.zeros((6, 8))
    h[:4, 0], h[3:, 7] = D, D
    assert k_of(h, sides="periodic") > 0
    assert k_of(h, sides="mirror") == 0


@each("sides", SIDES)
def test_trapped_pockets_change_nothing(sides):
    h = np.full((20, 20), D)
    h[8:13, 8:13] = 0
    before = cell_permeability(h, (D, D), sides=sides)
    h[10, 10] = 0.5 * D
    after = cell_permeability(h, (D, D), sides=sides)
    assert after.value == before.value
    assert np.array_equal(after.fluid_pressure, before.fluid_pressure, equal_nan=True)
    assert np.array_equal(
        np.isnan(after.fluid_pressure[7:14, 7:14]), np.pad(np.full((5, 5), True), 1)
    )
    h[10, 10] = 1e3 * D
    assert_allclose(k_of(h, sides=sides), before.value, rtol=1e-12)


@each("axis", [0, 1])
def test_fluid_stands_at_the_pressure_of_the_end_that_reaches_it(axis):
    h = np.full((9, 7), D)
    h[4] = 0  # closed
    h[6, 2:5] = h[8, 2:5] = h[7, [2, 4]] = 0  # a pocket
    k = cell_permeability(h.T if axis else h, (D, D), axis=axis)
    assert k.value == 0
    expected = np.where(h > 0, 0.0, np.nan)
    expected[:4] = 1
    expected[7, 3] = np.nan
    assert np.array_equal(
        k.fluid_pressure.T if axis else k.fluid_pressure, expected, equal_nan=True
    )


def test_dead_ends_change_nothing():
    h = np.zeros((9, 9))
    h[:, 4] = D
    before = cell_permeability(h, (D, D))
    h[4, 5:8] = h[2:7, 7] = D  # a branch that forks
    after = cell_permeability(h, (D, D))
    assert_allclose(after.value, before.value, rtol=1e-12)
    assert_allclose(after.fluid_pressure[:, 4], before.fluid_pressure[:, 4], rtol=1e-12)
    assert_allclose(after.fluid_pressure[2:7, 7], before.fluid_pressure[4, 4], rtol=1e-12)


@each("shape", [(1, 1), (1, 5), (5, 1), (8, 8)])
@each("sides", SIDES)
@each("axis", [0, 1])
def test_all_contact_is_closed(shape, sides, axis):
    k = cell_permeability(np.zeros(shape), (D, D), sides=sides, axis=axis, bounds=True)
    assert (k.value, k.lower, k.upper, k.percolates) == (0, 0, 0, False)
    assert np.array_equal(permeability_tensor(np.zeros(shape), (D, D)), np.zeros((2, 2)))


def open_paths(h, periodic):
    """Four-connected search from the first to the last row, in plain Python."""
    n1, n2 = h.shape
    seen = {(0, j) for j in range(n2) if h[0, j] > 0}
    stack = list(seen)
    while stack:
        i, j = stack.pop()
        for a, b in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            b = b % n2 if periodic else b
            if 0 <= a < n1 and 0 <= b < n2 and h[a, b] > 0 and (a, b) not in seen:
                seen.add((a, b))
                stack.append((a, b))
    return any(i == n1 - 1 for i, _ in seen)


@settings(deadline=None, max_examples=80)
@given(
    seed=st.integers(0, 9999),
    n1=st.integers(1, 12),
    n2=st.integers(1, 12),
    sides=st.sampled_from(SIDES),
)
def test_percolation_against_a_search(seed, n1, n2, sides):
    h = D * (np.random.default_rng(seed).random((n1, n2)) < 0.62)
    k = cell_permeability(h, (D, D), sides=sides, bounds=True)
    assert k.percolates == open_paths(h, sides == "periodic")
    assert percolation.percolates(h > 0) == open_paths(h, periodic=True)
    assert (k.value > 0) == (k.lower > 0) == k.percolates
    assert 0 <= k.lower <= k.upper * (1 + 1e-12)


# --- bounds ---


def test_without_asking_there_are_no_bounds():
    k = cell_permeability(np.ones((3, 3)), (1, 1))
    assert np.isnan(k.lower)
    assert np.isnan(k.upper)


@each("sides", SIDES)
@each("share", [0.05, 0.3])
def test_bounds_tighten_and_enclose_under_refinement(sides, share):
    h = cut_by_plane((24, 20), share, seed=5)
    lower, upper = [], []
    for m in (1, 2, 4, 8):
        k = cell_permeability(
            np.kron(h, np.ones((m, m))), (D / m, 2 * D / m), sides=sides, bounds=True
        )
        lower.append(k.lower)
        upper.append(k.upper)
    assert np.all(np.diff(lower) > 0)
    assert np.all(np.diff(upper) < 0)
    assert lower[-1] <= upper[-1]
    assert (upper[-1] - lower[-1]) < 0.2 * (upper[0] - lower[0])


def test_bounds_bracket_the_flow_through_the_pixels():
    """50 cells; the reference for gaps constant on each pixel is its refined bracket."""
    for seed in range(50):
        share = np.random.default_rng([7, seed]).uniform(0.05, 0.45)
        h = cut_by_plane((20, 20), share, seed, cut=5)
        sides = SIDES[seed % 2]
        k = cell_permeability(h, (D, D), sides=sides, bounds=True)
        assert k.lower <= k.upper
        assert (k.lower > 0) == k.percolates
        fine = cell_permeability(
            np.kron(h, np.ones((4, 4))), (D / 4, D / 4), sides=sides, bounds=True
        )
        if fine.percolates:
            assert k.lower <= fine.lower * (1 + 1e-12)
            assert fine.upper <= k.upper * (1 + 1e-12)
            assert fine.lower <= fine.upper


@each("contrast", [1e2, 1e4, 1e6, 1e9])
@each("sides", SIDES)
def test_bounds_hold_at_high_contrast(contrast, sides):
    """A bound is a bound however small the flow: smooth wide gaps before and behind a narrow one."""
    h = rough((24, 20), 2)
    h = 2 * D + h - h.min()
    h[10:14] /= contrast
    k = cell_permeability(h, (D, D), sides=sides, bounds=True)
    resistances = np.mean(12 / h**3, axis=0)
    # flow that never crosses over, and pressure that never varies across: simpler bounds on either side
    parallel = np.mean(1 / resistances)
    plain = 1 / np.mean(1 / np.mean(h**3 / 12, axis=1))
    assert parallel * (1 - 1e-9) <= k.upper
    assert k.lower <= plain * (1 + 1e-9)
    assert k.lower <= k.upper
    assert k.lower > 0.5 * parallel
    assert k.upper < 2 * plain


@each("contrast", [1e3, 1e6, 1e9, 1e12])
def test_bounds_of_stripes_are_exact(contrast):
    h = np.repeat(D * np.repeat([1, 1 / contrast, 1], 4)[:, None], 5, axis=1)
    exact = analytic.stripes_across(analytic.parallel_plates(h[:, 0]))
    k = cell_permeability(h, (D, D), bounds=True)
    assert_allclose(k.lower, exact, rtol=1e-8)
    assert_allclose(k.upper, exact, rtol=1e-8)


@BilinearForm
def energy_of_pressure(p, q, w):
    """∫ k ∇p·∇q."""
    return w.k * dot(grad(p), grad(q))


@each("spacing", [(D, D), (3 * D, D), (D, 8 * D)])
@each("closed", [0.0, 0.15])
def test_upper_bound_is_the_energy_of_linear_triangles(spacing, closed):
    """Against scikit-fem's own assembly of all that both ends reach, solved by SciPy."""
    h = rough((19, 23), 4)
    h = np.maximum(h - np.quantile(h, closed), 0) if closed else h - h.min() + 0.1 * h.std()
    n1, n2 = h.shape
    mesh = MeshTri.init_tensor(spacing[0] * np.arange(n1 + 1.0), spacing[1] * np.arange(n2 + 1.0))
    basis = Basis(mesh, ElementTriP1(), intorder=0)
    middle = mesh.p[:, mesh.t].mean(axis=1)
    pixel = (middle[0] // spacing[0]).astype(int), (middle[1] // spacing[1]).astype(int)
    k = h[pixel] ** 3 / 12
    a = energy_of_pressure.assemble(
        basis, k=np.repeat(k[:, None], basis.X.shape[1], axis=1)
    ).tocsr()
    x = basis.doflocs[0]
    inlet, outlet = x == 0, x == mesh.p[0].max()
    # islands of open pixels have no pressure of their own: their equations are singular
    corners = mesh.t[:, k > 0]
    conductances = coo_array(
        (np.ones(corners.size), (corners.ravel(), np.roll(corners, 1, axis=0).ravel()))
    )
    conductances.resize(a.shape)
    _, part = connected_components(conductances, directed=False)
    reached = np.isin(part, np.intersect1d(part[inlet], part[outlet]))
    assert reached.all() == (closed == 0)
    p = np.where(inlet & reached, 1.0, 0.0)
    unknown = reached & ~inlet & ~outlet
    p[unknown] = spsolve(a[unknown][:, unknown].tocsc(), -(a[unknown] @ p))
    exact = float(p @ (a @ p)) * n1 * spacing[0] / (n2 * spacing[1])
    assert exact > 1e-6 * float((h**3).max())
    assert_allclose(cell_permeability(h, spacing, bounds=True).upper, exact, rtol=1e-8)


@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize("shape", [(20, 24), (33, 17), (9, 40), (2, 5), (1, 4)])
def test_solvers_of_the_bounds_agree(sides, shape):
    h = np.random.default_rng(3).random(shape) * D
    h[h < 0.15 * D] = 0
    one, other = (
        cell_permeability(h, (D, 2 * D), sides=sides, bounds=True, solver=solver)
        for solver in ("elimination", "amg")
    )
    assert one.upper > 0
    assert one.upper <= other.upper * (1 + 1e-12) <= one.upper * (1 + 1e-9)
    assert one.lower == pytest.approx(other.lower, rel=1e-4)


# --- tensor ---


def test_tensor_of_flat_gap_and_stripes():
    h = np.repeat([1e-6, 2e-6, 5e-7], 8)
    flat = permeability_tensor(np.full((5, 7), D), (D, 3 * D))
    assert_allclose(flat, np.eye(2) * D**3 / 12, rtol=1e-12, atol=1e-12 * D**3)
    n = h.size
    along = permeability_tensor(np.broadcast_to(h, (6, n)), (D, 2 * D))
    assert_allclose(along[0, 0], k_of(np.broadcast_to(h, (6, n)), sides="periodic"), rtol=1e-12)
    middle = (9 * (h + np.roll(h, -1)) - np.roll(h, 1) - np.roll(h, -2)) / 16
    assert_allclose(along[1, 1], 1 / np.mean(12 / middle**3), rtol=1e-12)
    assert_allclose(along[[0, 1], [1, 0]], 0, atol=1e-12 * along[1, 1])


@each("share", [0.0, 0.2, 0.35])
def test_tensor_is_symmetric_and_turns_with_the_cell(share):
    h = cut_by_plane((24, 30), share, seed=6)
    k = permeability_tensor(h, (D, 2 * D))
    assert k[0, 1] == k[1, 0] or abs(k[0, 1] - k[1, 0]) <= 1e-12 * np.trace(k)
    assert np.linalg.eigvalsh(k).min() > 0
    turned = permeability_tensor(np.rot90(h), (2 * D, D))
    rotation = np.array([[0, -1], [1, 0]])
    assert_allclose(turned, rotation @ k @ rotation.T, rtol=0, atol=1e-10 * np.trace(k))
    assert_allclose(
        permeability_tensor(h.T, (2 * D, D)), k[::-1, ::-1], rtol=0, atol=1e-10 * np.trace(k)
    )
    assert_allclose(
        permeability_tensor(np.roll(h, (5, 8), (0, 1)), (D, 2 * D)),
        k,
        rtol=0,
        atol=1e-10 * np.trace(k),
    )
    assert_allclose(
        permeability_tensor(3 * h, (5 * D, 10 * D)), 27 * k, rtol=0, atol=1e-9 * np.trace(k)
    )


def test_tensor_of_a_repeated_cell():
    h = cut_by_plane((16, 12), 0.25, seed=7, cut=5)
    k = permeability_tensor(h, (D, D))
    assert_allclose(
        permeability_tensor(np.tile(h, (2, 3)), (D, D)), k, rtol=0, atol=1e-9 * np.trace(k)
    )


def test_tensor_of_an_even_cell_is_the_mirrored_permeability():
    h = cut_by_plane((14, 12), 0.15, seed=8, cut=5)
    even = np.concatenate([h, h[::-1]])
    even = np.concatenate([even, even[:, ::-1]], axis=1)
    k = permeability_tensor(even, (D, 2 * D))
    expected = [k_of(h, (D, 2 * D), axis=a) for a in (0, 1)]
    assert_allclose(np.diag(k), expected, rtol=1e-9)
    assert abs(k[0, 1]) <= 1e-10 * np.trace(k)


def test_tensor_of_the_checkerboard():
    board = D * np.array([[1.0, 2.0], [2.0, 1.0]])
    exact = analytic.checkerboard(*analytic.parallel_plates([D, 2 * D]))
    errors = []
    for m in (8, 16, 32):
        k = permeability_tensor(np.kron(board, np.ones((m, m))), (D, D))
        assert_allclose(k[0, 0], k[1, 1], rtol=1e-10)
        assert abs(k[0, 1]) < 1e-10 * k[0, 0]
        errors.append(abs(k[0, 0] / exact - 1))
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.04


def test_tensor_closed_in_one_direction():
    h = np.full((8, 10), D)
    h[3] = 0
    k = permeability_tensor(h, (D, D))
    assert k[0, 0] == k[0, 1] == k[1, 0] == 0
    assert k[1, 1] > 0
    k = permeability_tensor(h.T, (D, D))
    assert k[1, 1] == k[0, 1] == k[1, 0] == 0
    assert k[0, 0] > 0


def test_tensor_of_nothing_that_winds_is_exactly_zero():
    h = np.zeros((9, 9))
    h[2:7, 2:7] = D
    h[4, 4] = 0
    assert np.array_equal(permeability_tensor(h, (D, D)), np.zeros((2, 2)))
    # a path that leaves over one edge and returns over the opposite one winds; a U-turn does not
    u_turn = np.zeros((9, 9))
    u_turn[0:3, 2], u_turn[7:, 2], u_turn[2, 2:5], u_turn[0:3, 4], u_turn[7:, 4] = D, D, D, D, D
    assert np.array_equal(permeability_tensor(u_turn, (D, D)), np.zeros((2, 2)))


@each("flip", [1, -1])
def test_tensor_of_one_slanted_channel(flip):
    """A staircase winding once around both axes carries flow along the diagonal only: a matrix of rank 1."""
    n = 12
    h = np.zeros((n, n))
    for i in range(n):
        h[i, i] = h[i, (i + 1) % n] = D
    h = h[:, ::flip]
    k = permeability_tensor(h, (D, D))
    assert_allclose(k[0, 0], k[1, 1], rtol=1e-9)
    assert_allclose(k[0, 1], flip * k[0, 0], rtol=1e-9)
    assert_allclose(k, k.T, rtol=1e-12)
    # n + n links in series over the diagonal
    assert_allclose(k[0, 0], n * D * (D**3 / 12) / (2 * n * n * D), rtol=0.7)


@each("axis", [0, 1])
def test_tensor_of_one_row_or_column_is_that_of_four(axis):
    h = np.expand_dims(D * np.random.default_rng(1).uniform(0.2, 1, 6), axis)
    assert_allclose(
        permeability_tensor(h, (D, 3 * D)),
        permeability_tensor(np.repeat(h, 4, axis), (D, 3 * D)),
        rtol=1e-9,
        atol=1e-12 * D**3,
    )


def test_tensor_of_two_parallel_components():
    h = np.zeros((8, 9))
    h[:, 1], h[:, 5:7] = D, 2 * D
    k = permeability_tensor(h, (D, D))
    assert_allclose(k, [[(1 + 2 * 8) * D**3 / 12 / 9, 0], [0, 0]], rtol=1e-12)


# --- links ---


def test_links_never_orphan_and_never_open_contact():
    h = np.random.default_rng(9).choice([0.0, 1e-9, 1.0], (30, 30))
    for sides in SIDES:
        c1, c2 = cell_links(h, (D, D), sides)
        assert np.array_equal(c1[1:-1] > 0, (h[:-1] > 0) & (h[1:] > 0))
        assert np.array_equal(c1[[0, -1]] > 0, h[[0, -1]] > 0)
        neighbour = np.roll(h, -1, axis=1) if sides == "periodic" else h[:, 1:]
        assert np.array_equal(c2 > 0, (h[:, : c2.shape[1]] > 0) & (neighbour > 0))


def test_linear_gap_is_interpolated_exactly_between_pixels():
    h = np.broadcast_to(1 + 0.1 * np.arange(12.0)[:, None], (12, 5))
    c1, _ = cell_links(h, (2.0, 3.0), "mirror")
    assert_allclose(
        c1[2:-2],
        np.broadcast_to(((1.15 + 0.1 * np.arange(9.0)) ** 3 / 12 * 3 / 2)[:, None], (9, 5)),
    )


# --- bad input ---


@each(
    ("change", "words"),
    [
        ({"gap": np.full((3, 3), np.nan)}, ["gap", "9 "]),
        ({"gap": np.full((3, 3), np.inf)}, ["gap"]),
        ({"gap": np.full((3, 3), -1e-9)}, ["gap", "-1e-09", ">= 0"]),
        ({"gap": np.ones(3)}, ["gap", "(3,)"]),
        ({"gap": np.ones((2, 3, 4))}, ["gap", "(2, 3, 4)"]),
        ({"gap": np.ones((0, 3))}, ["gap"]),
        ({"gap": "gap"}, ["gap"]),
        ({"gap": None}, ["gap"]),
        ({"spacing": -D}, ["spacing", "> 0"]),
        ({"spacing": (D, 0.0)}, ["spacing", "> 0"]),
        ({"spacing": (D, -D)}, ["spacing", "> 0"]),
        ({"spacing": (np.nan, D)}, ["spacing", "nan"]),
        ({"spacing": ("1 um", D)}, ["spacing"]),
        ({"axis": 2}, ["axis", "2", "0 (x1) or 1 (x2)"]),
        ({"axis": -1}, ["axis", "-1"]),
        ({"axis": None}, ["axis", "None"]),
        ({"sides": "free"}, ["sides", "free", "mirror, periodic"]),
        ({"sides": None}, ["sides", "None"]),
        ({"rtol": 0}, ["rtol"]),
        ({"rtol": "fine"}, ["rtol"]),
    ],
)
def test_bad_input_is_named(change, words):
    given = {"gap": np.ones((3, 3)), "spacing": (D, D)} | change
    with pytest.raises(InputError) as caught:
        cell_permeability(given.pop("gap"), given.pop("spacing"), **given)
    assert all(word in str(caught.value) for word in words), str(caught.value)
    if set(change) <= {"gap", "spacing"}:
        given = {"gap": np.ones((3, 3)), "spacing": (D, D)} | change
        with pytest.raises(InputError):
            permeability_tensor(given["gap"], given["spacing"])


# --- critical constriction ---


def percolates(h, sides, axis):
    return k_of(np.where(h > 0, D, 0.0), sides=sides, axis=axis) > 0


@each("sides", SIDES)
@each("axis", [0, 1])
@each("seed", range(4))
def test_without_the_critical_link_the_widest_path_is_closed(sides, axis, seed):
    """Links as wide as it percolate, those wider than it do not; it lies where it says."""
    h = cut_by_plane((24, 21), 0.15, seed, cut=5)
    found = critical_constriction(h, (D, 2 * D), axis=axis, sides=sides)
    turned = h if axis == 0 else h.T
    d1, d2 = (D, 2 * D) if axis == 0 else (2 * D, D)
    c1, c2 = cell_links(turned, (d1, d2), sides)
    h1, h2 = np.cbrt(12 * c1 * d1 / d2), np.cbrt(12 * c2 * d2 / d1)
    h1[[0, -1]] /= np.cbrt(2)
    wide = 1 - 1e-9, 1 + 1e-9
    open_, shut = (
        solve_links(c1 * (h1 >= f * found.gap), c2 * (h2 >= f * found.gap)).percolates for f in wide
    )
    assert open_
    assert not shut
    x1, x2 = (p / d for p, d in zip(found.position, (D, 2 * D), strict=True))
    i, j = (x1, x2) if axis == 0 else (x2, x1)
    if i % 1 == 0:
        assert h1[int(i), int(j)] == pytest.approx(found.gap, rel=1e-12)
    else:
        assert h2[int(i), round(j) - 1] == pytest.approx(found.gap, rel=1e-12)


def test_constriction_of_a_channel_with_a_neck():
    h = np.zeros((12, 9))
    h[:, 3:6] = 2 * D
    h[7, 3:6] = 0, D / 2, 0
    found = critical_constriction(h, (D, 3 * D))
    assert found.gap == pytest.approx(
        (9 * (0.5 + 2) - 2 - 2) / 16 * D
    )  # the cubic between neck and channel
    assert found.position[0] in (7 * D, 8 * D)
    assert found.position[1] == 4.5 * 3 * D
    assert critical_constriction(np.where(h == D / 2, 0, h), (D, D)) is None
    assert critical_constriction(h, (D, D), axis=1) is None
    with pytest.raises(InputError, match="axis"):
        critical_constriction(h, (D, D), axis=2)
    with pytest.raises(InputError, match="sides"):
        critical_constriction(h, (D, D), sides="open")


def test_percolating_fraction():
    h = np.full((10, 8), D)
    assert cell_permeability(h, (D, D)).percolating_fraction == 1
    h[:, 3] = 0  # two channels
    h[2:5, 5:8] = 0
    h[3, 6] = D  # a pocket
    assert cell_permeability(h, (D, D)).percolating_fraction == pytest.approx((80 - 10 - 9) / 80)
    h[7] = 0
    assert cell_permeability(h, (D, D)).percolating_fraction == 0


# --- what an iteration does not see ---


@each(("n", "narrow"), [(48, 1e-3), (64, 1e-6), (128, 1e-6)])
def test_pressure_of_an_island_behind_a_narrow_film(n, narrow):
    """The energy of an iterative solution does not see it, elimination does."""
    h = np.full((n, n), D)
    h[6:15, 6:15] = narrow * D
    h[8:13, 8:13] = D
    k = cell_permeability(h, (D, D), field_rtol=1e-6)
    direct = solve_links(*cell_links(h / D, (D, D), "mirror"), solver="elimination")
    assert_allclose(k.fluid_pressure, direct.potential[1:-1], rtol=0, atol=1e-4)
    assert 0.7 < k.fluid_pressure[10, 10] < 0.95


@each("film", [1e-1, 1e-2, 1e-3, 1e-4])
def test_pressure_over_a_film_of_any_thickness(film):
    for seed in range(3):
        h = cut_by_plane((72, 80), 0.3, seed)
        h = np.maximum(h / h.max(), film)
        k = cell_permeability(h, (D, D), field_rtol=1e-6)
        direct = solve_links(*cell_links(h, (D, D), "mirror"), solver="elimination")
        assert_allclose(k.fluid_pressure, direct.potential[1:-1], rtol=0, atol=1e-4)
        assert k.fluid_pressure.min() > -1e-6
        assert k.fluid_pressure.max() < 1 + 1e-6


@each("sides", SIDES)
@each("decades", [3, 6, 9])
def test_bounds_of_two_gaps_at_random(sides, decades):
    """At any contrast: nothing is refused, and a flipped cell gets the same."""
    for seed in range(4):
        rng = np.random.default_rng([3, seed])
        h = np.where(rng.random((30, 31)) < 0.5, D, D * 10.0**-decades)
        k = cell_permeability(h, (D, D), sides=sides, bounds=True)
        flipped = cell_permeability(h[::-1, ::-1], (D, D), sides=sides, bounds=True)
        assert 0 < k.lower <= k.upper
        assert k.upper == pytest.approx(flipped.upper, rel=1e-8)


def test_upper_bound_of_very_flat_pixels():
    h = 2 * D + rough((24, 20), 1) / 3
    k = cell_permeability(h, (1e-3, 1e-6), bounds=True)
    assert k.lower <= k.upper < 1.05 * k.lower


@each("decades", [2, 3, 4, 5, 6])
def test_a_tensor_is_right_or_refused_at_any_contrast(decades):
    """One column of random gaps: its links in series."""
    refused = 0
    for seed in range(10):
        h = np.zeros((40, 5))
        h[:, 2] = D * 10.0 ** np.random.default_rng([5, seed]).uniform(-decades, 0, 40)
        wrapped = np.pad(h[:, 2], 2, mode="wrap")
        a, b = wrapped[1:-2], wrapped[2:-1]
        middle = midway(wrapped[:-3], a, b, wrapped[3:])[1:]
        exact = 1 / np.mean(12 / middle**3) / 5
        try:
            found = permeability_tensor(h, (D, D))[0, 0]
        except NotConverged:
            refused += 1
        else:
            assert found == pytest.approx(exact, rel=1e-6)
    assert refused == 0 or decades > 2


# --- single precision, threads ---


@pytest.mark.parametrize("solver", ["elimination", "multigrid"])
@pytest.mark.parametrize("sides", ["mirror", "periodic"])
def test_conductances_in_single_precision_change_the_flow_by_no_more_than_they_err(
    solver, sides, monkeypatch
):
    heights = np.random.default_rng(3).standard_normal((60, 48))
    gap = (
        np.maximum(
            0.8 + sum(np.roll(heights, (i, j), (0, 1)) for i in range(4) for j in range(4)) / 4, 0
        )
        * 1e-6
    )
    one = cell_permeability(gap, (D, D), sides=sides, solver=solver)
    monkeypatch.setattr(cell, "SINGLE_NODES", 1)
    single = cell_permeability(gap, (D, D), sides=sides, solver=solver)
    exact = cell_permeability(gap, (D, D), sides=sides, solver=solver, rtol=1e-9)
    assert single.solver == solver
    assert single.value != one.value
    assert exact.value != single.value  # asked for small errors it is in double precision
    assert_allclose(single.value, exact.value, rtol=6e-8 if solver == "elimination" else 1e-6)
    assert_allclose(
        single.fluid_pressure,
        exact.fluid_pressure,
        rtol=0,
        atol=1e-6 if solver == "elimination" else 1e-3,
    )


@pytest.mark.parametrize("single", [False, True])
def test_threads_share_large_grids_and_change_no_bits(single, monkeypatch):
    for module, name, value in (
        (cell, "SINGLE_NODES", 1 if single else cell.SINGLE_NODES),
        (choice, "_MANY", 1000),
        (hierarchy, "_LARGE", 300),
        (hierarchy, "_STRIP", 8),
        (threads, "_POINTS", 500),
    ):
        monkeypatch.setattr(module, name, value)
    gap = cut_by_plane((107, 90), 0.2, seed=3)
    given = {"sides": "periodic", "solver": "multigrid", "field_rtol": 1e-5}
    found, shared, pool = [], set(), threads._pool
    monkeypatch.setattr(threads, "_pool", lambda count: shared.add(count) or pool(count))
    for count in (1, 2, 3):
        flow = cell_permeability(gap, (D, D), **given, threads=count)
        found.append((flow.value, flow.residual, flow.fluid_pressure.tobytes()))
    assert len(set(found)) == 1
    assert shared == {2, 3}
    assert threads.number() == 1
    monkeypatch.setattr(hierarchy, "_LARGE", gap.size + 1)
    serial = cell_permeability(gap, (D, D), **given)
    assert serial.iterations >= flow.iterations - 1
    assert serial.residual != flow.residual
    assert_allclose(flow.value, serial.value, rtol=1e-9)
    assert_allclose(flow.fluid_pressure, serial.fluid_pressure, rtol=0, atol=1e-4)


@pytest.mark.parametrize("ring", [False, True])
def test_rows_searched_by_parts_reach_what_they_reach_in_one(ring, monkeypatch):
    reached = set()
    for seed in range(40):
        rng = np.random.default_rng([5, seed])
        n1, n2 = rng.integers(1, 30, 2)
        m2 = n2 if ring else n2 - 1
        shapes = (n1, n2), (n1 - 1, m2)
        fraction = rng.uniform(0.1, 0.8)
        at_random = [
            (rng.random(shape) < fraction) * rng.uniform(0.1, 9, shape) for shape in shapes
        ]
        one, parted = ([c.copy() for c in at_random] for _ in range(2))
        monkeypatch.setattr(threads, "_POINTS", int(rng.integers(1, 3 * n2)))
        with threads.using(2):
            ends, exponent = percolation.ready(*parted)
        monkeypatch.setattr(threads, "_POINTS", 10**9)
        expected = percolation.ready(*one)
        assert exponent == expected[1]
        assert np.array_equal(ends, expected[0])
        assert all(map(np.array_equal, parted, one))
        reached |= set(ends.ravel().tolist())
    assert reached == {0, 1, 2, 3}


def test_a_flow_at_the_end_of_single_precision_is_solved_in_double(monkeypatch):
    gap = np.ones((12, 8)) * 1e-6
    gap[4:9] = 1e-21  # conductances of 1e-45, which is next to nothing in single precision
    double = cell_permeability(gap, (D, D))
    monkeypatch.setattr(cell, "SINGLE_NODES", 1)
    assert cell_permeability(gap, (D, D)).value == double.value > 0

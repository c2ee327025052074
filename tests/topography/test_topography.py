"""Topography: closed forms of single waves, Parseval, exactness on band-limited maps."""

from operator import attrgetter, methodcaller

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from waves_and_noise import SIZE, pixel_centres, standing_wave, white_noise

from femseal.base import InputError
from femseal.flow import cell_permeability
from femseal.topography import (
    Topography,
)

PERIODS = [(True, True), (False, True), (True, False), (False, False)]
NOTHING = Topography(np.full((3, 3), np.nan), (1, 1))


def holed(share_of=40):
    z = np.zeros((20, share_of))
    z[5, 7] = np.nan
    return Topography(z, (1.0, 1.0))


# --- the object -------------------------------------------------------------------------------------------


def test_heights_are_a_read_only_copy():
    source = np.ones((3, 4), dtype=np.float32)
    face = Topography(source, (1e-6, 2e-6))
    source[:] = 5
    assert face.heights.dtype == np.float64
    assert face.heights.max() == 1
    with pytest.raises(ValueError, match="read-only"):
        face.heights[0, 0] = 1
    assert face.shape == (3, 4)
    assert_allclose(face.size, (3e-6, 8e-6))


def test_masked_points_are_undefined():
    face = Topography(np.ma.masked_greater(np.arange(6).reshape(2, 3), 4), (1, 1))
    assert_allclose(face.undefined_fraction, 1 / 6)
    assert np.isnan(face.heights[1, 2])


def steps(periodic):
    """Wave number [rad/m] of the longest wave along both axes."""
    return [(2 if wraps else 1) * np.pi / n for wraps, n in zip(periodic, SIZE, strict=True)]


@pytest.mark.parametrize(
    ("heights", "spacing", "periodic", "message"),
    [
        (np.zeros(3), (1, 1), True, r"heights: given shape \(3,\), expected shape \(n1, n2\)"),
        (np.zeros((0, 3)), (1, 1), True, r"shape \(0, 3\)"),
        ([[1.0, np.inf]], (1, 1), True, "heights: given 1 point not finite, .* NaN = undefined"),
        ([["a", "b"]], (1, 1), True, "real numbers"),
        (np.array([[1j, 2.0]]), (1, 1), True, "real numbers"),
        ([[1.0, 2.0]], (1, 0), True, r"spacing: given \(1, 0\), expected two finite numbers > 0"),
        ([[1.0, 2.0]], (1, np.nan), True, "spacing"),
        ([[1.0, 2.0]], "1", True, "spacing"),
        ([[1.0, 2.0]], (1, 1, 1), True, "spacing"),
        ([[1.0, 2.0]], (1, 1), "no", "periodic"),
    ],
)
def test_bad_maps_are_refused(heights, spacing, periodic, message):
    with pytest.raises(InputError, match=message):
        Topography(heights, spacing, (True, periodic))


LINE, GRID = white_noise((1, 5)), white_noise((8, 6))


#: What uses every point of a map.
WHOLE = [
    *(attrgetter("rms_height"), attrgetter("rms_slope"), methodcaller("gap")),
    *(methodcaller("low_pass", 4.0), methodcaller("high_pass", 4.0), methodcaller("psd", 0)),
    *(methodcaller("radial_psd"), methodcaller("resample", (10, 10)), lambda face: face + face),
]


@pytest.mark.parametrize(
    ("use", "face", "message"),
    [
        *((use, holed(), r"0\.125 % undefined .* use fill_undefined\(\) first") for use in WHOLE),
        (methodcaller("detrend", 3), LINE, "order: given 3, expected 0"),
        (methodcaller("detrend"), NOTHING, "100 % undefined"),
        (methodcaller("fill_undefined", 1.0), NOTHING, "given 100 %"),
        (methodcaller("fill_undefined", 1e-3), holed(), "0.125 % undefined .* at most 0.1 %: crop"),
        *(
            (methodcaller("low_pass", value), GRID, r"wavelength: .* a finite number > 0 \[m\]")
            for value in (0, -1.0, np.inf, np.nan, "long", None)
        ),
        *(
            (methodcaller("resample", shape), GRID, r"shape: given .* two whole numbers >= 1")
            for shape in ((0, 3), (2.5, 3), 4, (3, 3, 3))
        ),
        (methodcaller("crop", (5, 6), (4, 0)), GRID, r"crop: .* \(5, 6\) from \(4, 0\), .* \(8, 6"),
        (methodcaller("flip", 2), GRID, "axis: given 2"),
        (
            lambda face: face + white_noise((4, 6)),
            GRID,
            r"shape of the second face: given \(4, 6\)",
        ),
        (lambda face: face + Topography(face.heights, (1, 1)), GRID, "spacing of the second face"),
    ],
)
def test_invalid_arguments_of_operations_are_refused(use, face, message):
    with pytest.raises(InputError, match=message):
        use(face)


# --- measures ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("periodic", PERIODS)
@pytest.mark.parametrize("shape", [(24, 18), (25, 17)])
def test_slope_and_height_of_a_wave(periodic, shape):
    face = standing_wave(shape, (3, 2), periodic)
    slopes = 0.5 * np.multiply(steps(periodic), (3, 2))
    assert_allclose(face.rms_height, 0.5, rtol=1e-12)
    assert_allclose(face.rms_slopes, slopes, rtol=1e-12)
    assert_allclose(face.rms_slope, np.hypot(*slopes), rtol=1e-12)


def test_slope_of_a_tilted_map_that_is_not_periodic_is_its_tilt():
    x1, _ = pixel_centres((400, 8))
    z = np.tile(0.01 * x1[:, None], (1, 8))
    face = Topography(z, (SIZE[0] / 400, SIZE[1] / 8), (False, True))
    assert_allclose(face.rms_slope, 0.01, rtol=5e-3)


@pytest.mark.parametrize("periodic", PERIODS)
@pytest.mark.parametrize("shape", [(16, 10), (15, 10), (7, 1)])
def test_psd_adds_up_to_the_mean_square(periodic, shape):
    face = white_noise(shape, periodic)
    for axis, step in enumerate(steps(periodic)):
        q, density = face.psd(axis)
        assert_allclose(q, step * np.arange(q.size))
        weight = np.where(q == 0, 0.5, 1.0)
        assert_allclose(np.sum(weight * density) * step / np.pi, face.rms_height**2, rtol=1e-12)


@pytest.mark.parametrize("periodic", PERIODS)
def test_radial_psd_integrates_to_the_mean_square(periodic):
    # A spectrum that ends well inside the grid, so that rings are full and the sum over rings converges.
    face = white_noise((240, 160), periodic).low_pass(SIZE[1] / 20)
    q, density = face.radial_psd()
    integral = np.trapezoid(density * 2 * np.pi * q, q) / (4 * np.pi**2)
    assert_allclose(integral, face.rms_height**2, rtol=0.04)


def test_radial_psd_of_white_noise_is_its_pixel_area_times_variance():
    face = white_noise((200, 100), (False, True))
    q, density = face.radial_psd()
    inside = (q > 2e4) & (q < np.pi / max(face.spacing))
    assert_allclose(density[inside].mean(), np.prod(face.spacing), rtol=0.02)


def test_the_gap_is_zero_at_the_highest_point():
    face = white_noise((6, 5))
    assert face.gap().min() == 0
    assert_allclose(face.gap() + face.heights, face.heights.max())


# --- form -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [0, 1, 2])
def test_detrend_removes_the_form_and_changes_nothing_the_second_time(order):
    shape, spacing = (30, 20), (SIZE[0] / 30, SIZE[1] / 20)
    x1, x2 = np.meshgrid(*pixel_centres(shape), indexing="ij")
    terms = [np.ones(shape), 1e-3 * x1 - 2e-3 * x2, 5.0 * x1**2 + 3.0 * x1 * x2 - x2**2]
    for last in range(3):
        left = Topography(sum(terms[: last + 1]), spacing).detrend(order).heights
        assert (np.abs(left).max() < 1e-14) == (last <= order)
    rough = white_noise(shape).detrend(order)
    assert_allclose(rough.detrend(order).heights, rough.heights, atol=1e-12)


def test_undefined_points_at_the_border_do_not_decide_whether_it_has_a_step():
    z = np.cos(2 * np.pi * np.arange(32) / 32)[:, None] * np.ones(16)
    z[0, 3:] = np.nan
    assert Topography(z, (1e-6, 1e-6)).seamless == (True, True)
    z[0] = np.nan
    assert Topography(z, (1e-6, 1e-6)).seamless == (True, True)
    assert Topography(z * np.nan, (1e-6, 1e-6)).seamless == (True, True)


def test_detrend_is_the_least_squares_plane_of_the_defined_points():
    z = np.random.default_rng(3).standard_normal((12, 9))
    z[2:5, 3] = z[0, 0] = np.nan
    defined = ~np.isnan(z)
    i, j = np.nonzero(defined)
    design = np.column_stack([np.ones(i.size), i, j])
    plane = design @ np.linalg.lstsq(design, z[defined])[0]
    flat = Topography(z, (2e-6, 1e-6)).detrend()
    assert_allclose(flat.heights[defined], z[defined] - plane, atol=1e-12)
    assert np.isnan(flat.heights[~defined]).all()
    line = Topography(np.arange(5.0)[None, :], (1.0, 1.0))
    assert_allclose(line.detrend().heights, 0, atol=1e-12)


# --- waves ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("periodic", PERIODS)
def test_low_pass_keeps_long_waves_and_removes_short_ones_exactly(periodic):
    shape = (48, 40)
    long, short = standing_wave(shape, (3, 2), periodic), standing_wave(shape, (9, 8), periodic)
    both = long.with_heights(long.heights + short.heights + 4.0)
    limit = 2 * np.pi / np.hypot(*np.multiply(steps(periodic), (3, 2)))  # the long wave itself
    assert_allclose(both.low_pass(limit).heights, long.heights + 4.0, atol=1e-12)
    assert_allclose(both.high_pass(limit).heights, short.heights, atol=1e-12)
    assert_allclose(both.low_pass(1.01 * limit).heights, 4.0, atol=1e-12)
    # shorter than the grid carries
    assert_allclose(both.low_pass(min(both.spacing)).heights, both.heights, atol=1e-14)


@pytest.mark.parametrize("periodic", PERIODS)
@pytest.mark.parametrize("shape", [(24, 20), (25, 21), (24, 21)])
@pytest.mark.parametrize("new", [(48, 33), (17, 14), (60, 13), (18, 40), (24, 20)])
def test_resample_is_exact_on_waves(periodic, shape, new):
    k = (3, 5)
    resampled = standing_wave(shape, k, periodic).resample(new)
    assert_allclose(resampled.heights, standing_wave(new, k, periodic).heights, atol=1e-12)


@pytest.mark.parametrize("periodic", PERIODS)
def test_resample_does_not_fold_short_waves(periodic):
    assert_allclose(
        standing_wave((32, 32), (10, 3), periodic).resample((9, 20)).heights, 0, atol=1e-12
    )


@settings(max_examples=40, deadline=None)
@given(
    st.tuples(st.integers(1, 12), st.integers(1, 12)),
    st.tuples(st.integers(0, 9), st.integers(0, 9)),
    st.sampled_from(PERIODS),
)
def test_resample_up_and_down_again_is_the_identity(shape, more, periodic):
    # White noise, so the Nyquist wave of an even number of points takes part.
    face = white_noise(shape, periodic)
    up = face.resample(tuple(np.add(shape, more)))
    assert_allclose(up.size, face.size)
    assert_allclose(up.resample(shape).heights, face.heights, atol=1e-12)
    assert_allclose(up.heights.mean(), face.heights.mean(), atol=1e-12)
    # Three times finer, every third new centre is an old one: the interpolant goes through the samples.
    finer = face.resample(tuple(np.multiply(shape, 3)))
    assert_allclose(finer.heights[1::3, 1::3], face.heights, atol=1e-12)


# --- holes ------------------------------------------------------------------------------------------------


def test_undefined_points_of_a_plane_are_filled_exactly():
    x1, x2 = np.meshgrid(*pixel_centres((30, 24)), indexing="ij")
    plane = 1e-3 * x1 - 2e-3 * x2 + 1.0
    z = plane.copy()
    z[5:9, 10:14] = z[20, 3] = np.nan
    filled = Topography(z, (SIZE[0] / 30, SIZE[1] / 24), (False, False)).fill_undefined()
    assert filled.undefined_fraction == 0
    assert_allclose(filled.heights, plane, rtol=1e-12)


def test_undefined_points_are_filled_across_periodic_borders_only():
    x = np.arange(40.0)
    z = np.tile(np.minimum(x, 40 - x), (30, 1))  # a ridge; lowest at the border x2 = 0
    z[:, 0] = np.nan
    wrapped = Topography(z, (1.0, 1.0)).fill_undefined()
    assert_allclose(wrapped.heights[:, 0], 1.0)
    z[:, 0] = np.arange(30)
    z[10:14, 0] = np.nan
    z[:, 1] = 5.0
    z[:, 39] = -1e3  # the neighbour across the border
    assert Topography(z, (1.0, 1.0), (True, False)).fill_undefined().heights[10:14, 0].min() > 4
    assert Topography(z, (1.0, 1.0), (True, True)).fill_undefined().heights[10:14, 0].max() < 0


def test_a_single_hole_on_oblong_pixels_is_the_weighted_mean_of_its_neighbours():
    z = np.zeros((9, 9))
    z[3:6, 3:6] = [[9, 1, 9], [3, np.nan, 5], [9, 2, 9]]
    d1, d2 = 1.0, 2.0
    expected = ((1 + 2) / d1**2 + (3 + 5) / d2**2) / (2 / d1**2 + 2 / d2**2)
    assert_allclose(Topography(z, (d1, d2)).fill_undefined().heights[4, 4], expected)


# --- parts and sums ---------------------------------------------------------------------------------------


def test_crop_keeps_periodicity_of_whole_axes_only():
    part = GRID.crop((5, 6), (2, 0))
    assert_allclose(part.heights, GRID.heights[2:7])
    assert (part.periodic, part.spacing) == ((False, True), GRID.spacing)
    d1, d2 = GRID.spacing
    same = GRID.crop_to((2 * d1, 7.4 * d1, 0, 6 * d2))
    assert_allclose(same.heights, part.heights)


def test_flipping_and_adding_act_on_the_heights():
    face = white_noise((8, 6), (False, True), seed=1)
    assert_allclose(face.flip(0).heights, face.heights[::-1])
    assert_allclose(face.flip(1).flip(1).heights, face.heights)
    assert_allclose((GRID + face).heights, GRID.heights + face.heights)
    assert (GRID + face).periodic == (False, True)
    with pytest.raises(TypeError):
        face + 1.0


def test_a_single_spacing_holds_for_both_axes():
    assert Topography(np.zeros((4, 6)), 1e-6).spacing == (1e-6, 1e-6)
    gap = np.full((4, 6), 1e-6)
    assert cell_permeability(gap, 1e-6).value == cell_permeability(gap, (1e-6, 1e-6)).value

"""Topography and condition: closed forms of single waves, Parseval, exactness on band-limited maps."""

import subprocess
import sys
import tracemalloc
from operator import attrgetter, methodcaller

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from femseal.base import InputError
from femseal.flow import cell_permeability
from femseal.topography import (
    Topography,
    condition,
    describe_surface,
    form_fit,
    resolving_shape,
    self_affine,
)
from femseal.topography.waves import wave_powers, wavenumber_grids

PERIODS = [(True, True), (False, True), (True, False), (False, False)]
SIZE = (3e-3, 2e-3)
NOTHING = Topography(np.full((3, 3), np.nan), (1, 1))


def centres(shape, size=SIZE):
    return [(np.arange(n) + 0.5) * length / n for n, length in zip(shape, size, strict=True)]


def wave(shape, k, periodic, size=SIZE, phase=(0.3, -0.7)):
    """A product of waves of number k: cos(2πkx/L + phase) on periodic axes, cos(πkx/L) on mirror axes."""
    factors = [
        np.cos(2 * np.pi * kk * x / length + p) if wraps else np.cos(np.pi * kk * x / length)
        for x, kk, length, wraps, p in zip(
            centres(shape, size), k, size, periodic, phase, strict=True
        )
    ]
    return Topography(np.outer(*factors), (size[0] / shape[0], size[1] / shape[1]), periodic)


def noise(shape, periodic=(True, True), seed=0):
    spacing = (SIZE[0] / shape[0], SIZE[1] / shape[1])
    return Topography(np.random.default_rng(seed).standard_normal(shape), spacing, periodic)


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


LINE, GRID = noise((1, 5)), noise((8, 6))


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
        (lambda face: face + noise((4, 6)), GRID, r"shape of the second face: given \(4, 6\)"),
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
    face = wave(shape, (3, 2), periodic)
    slopes = 0.5 * np.multiply(steps(periodic), (3, 2))
    assert_allclose(face.rms_height, 0.5, rtol=1e-12)
    assert_allclose(face.rms_slopes, slopes, rtol=1e-12)
    assert_allclose(face.rms_slope, np.hypot(*slopes), rtol=1e-12)


def test_slope_of_a_tilted_map_that_is_not_periodic_is_its_tilt():
    x1, _ = centres((400, 8))
    z = np.tile(0.01 * x1[:, None], (1, 8))
    face = Topography(z, (SIZE[0] / 400, SIZE[1] / 8), (False, True))
    assert_allclose(face.rms_slope, 0.01, rtol=5e-3)


@pytest.mark.parametrize("periodic", PERIODS)
@pytest.mark.parametrize("shape", [(16, 10), (15, 10), (7, 1)])
def test_psd_adds_up_to_the_mean_square(periodic, shape):
    face = noise(shape, periodic)
    for axis, step in enumerate(steps(periodic)):
        q, density = face.psd(axis)
        assert_allclose(q, step * np.arange(q.size))
        weight = np.where(q == 0, 0.5, 1.0)
        assert_allclose(np.sum(weight * density) * step / np.pi, face.rms_height**2, rtol=1e-12)


@pytest.mark.parametrize("periodic", PERIODS)
def test_radial_psd_integrates_to_the_mean_square(periodic):
    # A spectrum that ends well inside the grid, so that rings are full and the sum over rings converges.
    face = noise((240, 160), periodic).low_pass(SIZE[1] / 20)
    q, density = face.radial_psd()
    integral = np.trapezoid(density * 2 * np.pi * q, q) / (4 * np.pi**2)
    assert_allclose(integral, face.rms_height**2, rtol=0.04)


def test_radial_psd_of_white_noise_is_its_pixel_area_times_variance():
    face = noise((200, 100), (False, True))
    q, density = face.radial_psd()
    inside = (q > 2e4) & (q < np.pi / max(face.spacing))
    assert_allclose(density[inside].mean(), np.prod(face.spacing), rtol=0.02)


def test_the_gap_is_zero_at_the_highest_point():
    face = noise((6, 5))
    assert face.gap().min() == 0
    assert_allclose(face.gap() + face.heights, face.heights.max())


# --- form -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [0, 1, 2])
def test_detrend_removes_the_form_and_changes_nothing_the_second_time(order):
    shape, spacing = (30, 20), (SIZE[0] / 30, SIZE[1] / 20)
    x1, x2 = np.meshgrid(*centres(shape), indexing="ij")
    terms = [np.ones(shape), 1e-3 * x1 - 2e-3 * x2, 5.0 * x1**2 + 3.0 * x1 * x2 - x2**2]
    for last in range(3):
        left = Topography(sum(terms[: last + 1]), spacing).detrend(order).heights
        assert (np.abs(left).max() < 1e-14) == (last <= order)
    rough = noise(shape).detrend(order)
    assert_allclose(rough.detrend(order).heights, rough.heights, atol=1e-12)


def test_a_periodic_map_is_not_levelled_unless_asked_for():
    """Self-affine without a plateau: the plane fitted to it is a part of its waves."""
    face = self_affine((128, 128), SIZE, hurst=0.8, rms_slope=0.2, rng=1)
    kept, report = condition(face)
    assert_allclose(kept.rms_slope, 0.2, rtol=1e-9)
    assert report.removed_tilt == (0.0, 0.0)
    assert_allclose(describe_surface(face).rms_slope, 0.2, rtol=1e-9)
    # the plane through a single wave leaves a step of twice its amplitude
    single = wave((128, 128), (1, 0), (True, True), phase=(-0.5 * np.pi, 0.0))
    assert single.seamless == (True, True)
    assert single.detrend(1).seamless == (False, True)
    slope = single.rms_slope
    assert_allclose(condition(single)[0].rms_slope, slope, rtol=1e-9)
    assert condition(single, detrend=1)[0].rms_slope > 1.5 * slope


@pytest.mark.parametrize("periodic", [(True, True), (False, True), (False, False)])
def test_a_measured_map_is_levelled_whatever_its_borders_are_called(periodic):
    """Part of a larger map, with a tilt: it has a step where it would repeat itself."""
    larger = self_affine((128, 256), SIZE, hurst=0.8, rms_slope=0.2, rng=1).heights[:, :128]
    tilt = 0.3 * SIZE[1] / 256
    measured = Topography(larger + tilt * np.arange(128), (SIZE[0] / 128, SIZE[1] / 256), periodic)
    form = measured.form()
    assert_allclose(form.slopes[1], measured.form(1).slopes[1], rtol=1e-9)
    assert_allclose(measured.detrend(None).form(1).slopes[1], 0, atol=1e-12)
    # along x1 the map repeats itself
    is_levelled = form.slopes[0] != 0
    assert is_levelled == (not periodic[0])


def test_undefined_points_at_the_border_do_not_decide_whether_it_has_a_step():
    z = np.cos(2 * np.pi * np.arange(32) / 32)[:, None] * np.ones(16)
    z[0, 3:] = np.nan
    assert Topography(z, (1e-6, 1e-6)).seamless == (True, True)
    z[0] = np.nan
    assert Topography(z, (1e-6, 1e-6)).seamless == (True, True)
    assert Topography(z * np.nan, (1e-6, 1e-6)).seamless == (True, True)


@pytest.mark.parametrize("periodic", [(True, True), (False, True), (True, False), (False, False)])
@pytest.mark.parametrize("shape", [(24, 18), (25, 17)])
def test_slopes_and_spectra_of_half_the_waves_are_those_of_all(shape, periodic):
    """Of even and odd numbers of points: a Nyquist wave is its own conjugate."""
    rough = noise(shape, periodic)
    low = rough.low_pass(0.5e-3)
    assert_allclose(rough.rms_slope_of_long_waves(0.5e-3), low.rms_slope, rtol=1e-12)
    powers = wave_powers(rough.heights, periodic)
    assert_allclose(powers.sum(), np.mean(rough.heights**2), rtol=1e-12)
    q1, q2 = wavenumber_grids(shape, rough.spacing, periodic)
    slopes = np.sqrt([np.sum(q1**2 * powers), np.sum(q2**2 * powers)])
    assert_allclose(rough.rms_slopes, slopes, rtol=1e-12)
    q, density = rough.radial_psd()
    is_inside = q < 0.7 * np.pi / max(rough.spacing)
    assert is_inside.any()
    assert np.all(density[is_inside] > 0)


CONDITION = """
from math import inf
import numpy as np
from femseal.base.machine import peak_memory
from femseal.topography import Topography, condition

used = []
for n in (64, 2048):  # the first map loads what conditioning takes
    heights = np.random.default_rng(1).standard_normal((n, n))
    heights.flags.writeable = False
    measured = Topography(heights, (1e-6, 1e-6), (True, True))
    used.append(peak_memory())
    condition(measured, spikes=inf)
    used.append(peak_memory())
print(used[-1] - used[-2])
"""


def test_conditioning_of_a_periodic_map_takes_less_memory_than_a_contact():
    """Peak memory of a process of its own, which also contains what the transforms allocate themselves."""
    done = subprocess.run(
        [sys.executable, "-c", CONDITION], capture_output=True, text=True, check=True
    )
    map_bytes = 8
    assert int(done.stdout) < (37 - map_bytes) * 2048**2


@pytest.mark.parametrize(("kind", "bytes_per_point"), [("plain", 37), ("with spikes", 50)])
def test_conditioning_takes_little_memory(kind, bytes_per_point, monkeypatch):
    """Peak of what NumPy allocates, with the map; a contact takes 37 bytes a point.

    Blocks are as small beside this map as they are beside a large one.
    """
    monkeypatch.setattr(form_fit, "_BLOCK", 2**10)
    rng = np.random.default_rng(1)
    z = rng.standard_normal((512, 512))
    if kind == "with spikes":
        z[5::101, 3::89] = np.nan
        z[7::97, 2::103] += 100
    measured = Topography(z, (1e-6, 1e-6), (False, False))
    condition(measured)  # what is loaded once stays
    tracemalloc.start()
    condition(measured)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak + z.nbytes < bytes_per_point * z.size


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
    long, short = wave(shape, (3, 2), periodic), wave(shape, (9, 8), periodic)
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
    resampled = wave(shape, k, periodic).resample(new)
    assert_allclose(resampled.heights, wave(new, k, periodic).heights, atol=1e-12)


@pytest.mark.parametrize("periodic", PERIODS)
def test_resample_does_not_fold_short_waves(periodic):
    assert_allclose(wave((32, 32), (10, 3), periodic).resample((9, 20)).heights, 0, atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(
    st.tuples(st.integers(1, 12), st.integers(1, 12)),
    st.tuples(st.integers(0, 9), st.integers(0, 9)),
    st.sampled_from(PERIODS),
)
def test_resample_up_and_down_again_is_the_identity(shape, more, periodic):
    # White noise, so the Nyquist wave of an even number of points takes part.
    face = noise(shape, periodic)
    up = face.resample(tuple(np.add(shape, more)))
    assert_allclose(up.size, face.size)
    assert_allclose(up.resample(shape).heights, face.heights, atol=1e-12)
    assert_allclose(up.heights.mean(), face.heights.mean(), atol=1e-12)
    # Three times finer, every third new centre is an old one: the interpolant goes through the samples.
    finer = face.resample(tuple(np.multiply(shape, 3)))
    assert_allclose(finer.heights[1::3, 1::3], face.heights, atol=1e-12)


# --- holes ------------------------------------------------------------------------------------------------


def test_undefined_points_of_a_plane_are_filled_exactly():
    x1, x2 = np.meshgrid(*centres((30, 24)), indexing="ij")
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
    face = noise((8, 6), (False, True), seed=1)
    assert_allclose(face.flip(0).heights, face.heights[::-1])
    assert_allclose(face.flip(1).flip(1).heights, face.heights)
    assert_allclose((GRID + face).heights, GRID.heights + face.heights)
    assert (GRID + face).periodic == (False, True)
    with pytest.raises(TypeError):
        face + 1.0


# --- conditioning -----------------------------------------------------------------------------------------


def measured():
    """A tilted rough map with a few undefined points: self-affine roughness down to two pixels."""
    rough = self_affine((96, 80), SIZE, hurst=0.8, rms_height=1e-6, cut_off=7e-5, rng=4)
    x1, x2 = centres(rough.shape)
    z = rough.heights + np.tan(2e-3) * x1[:, None] - np.tan(1e-3) * x2
    z[40:42, 30:33] = np.nan
    return Topography(z, rough.spacing, (False, False))


def test_condition_reports_what_it_did():
    face, report = condition(measured())
    assert_allclose(report.undefined_fraction, 6 / (96 * 80))
    assert_allclose(report.removed_tilt, (2e-3, -1e-3), atol=5e-4)
    assert_allclose(report.shortest_wave, 8 * max(face.spacing))
    assert report.rms_height < report.rms_height_before < measured().fill_undefined().rms_height
    assert report.rms_slope < report.rms_slope_before
    assert_allclose((report.rms_height, report.rms_slope), (face.rms_height, face.rms_slope))
    assert (report.shape, report.spacing) == (face.shape, face.spacing)
    assert face.undefined_fraction == 0
    # Nothing shorter than the shortest wave is left.
    assert_allclose(face.high_pass(report.shortest_wave).heights, 0, atol=1e-18)


def test_condition_recovers_tilt_and_curvature():
    x1, x2 = centres((60, 50))
    u, v = x1[:, None] - SIZE[0] / 2, x2 - SIZE[1] / 2
    z = np.tan(1e-3) * u - np.tan(3e-3) * v + 0.5 * 2.0 * u**2 + 0.7 * u * v - 0.5 * 3.0 * v**2
    _, report = condition(Topography(z, (SIZE[0] / 60, SIZE[1] / 50)), detrend=2)
    assert_allclose(report.removed_tilt, (1e-3, -3e-3), rtol=1e-9)
    assert_allclose(report.removed_curvature, (2.0, 0.7, -3.0), rtol=1e-9)
    assert report.rms_height < 1e-15


def test_conditioning_on_another_grid_keeps_the_long_waves():
    face, report = condition(measured(), shape=(240, 200), shortest_wave=1.1e-4)
    assert face.shape == (240, 200)
    assert report.shape_before == (96, 80)
    assert_allclose(face.size, SIZE)
    coarse, report = condition(measured(), shape=(48, 40))
    assert_allclose(report.shortest_wave, 8 * max(coarse.spacing))
    reference, _ = condition(measured(), shortest_wave=report.shortest_wave)
    assert_allclose(coarse.resample((96, 80)).heights, reference.heights, atol=1e-18)


def test_a_finer_grid_keeps_the_waves_that_were_measured():
    """5 pixels are the shortest: the measured grid loses them, one with 8 pixels for them does not."""
    face = self_affine((96, 80), SIZE, hurst=0.5, rms_height=1e-6, cut_off=5 * SIZE[0] / 96, rng=4)
    _, coarse = condition(face, detrend=0)
    assert_allclose(coarse.shortest_measured, 5 * SIZE[0] / 96, rtol=0.05)
    lost = 1 - face.low_pass(coarse.shortest_wave).rms_slope / face.rms_slope
    assert_allclose(coarse.lost_slope, lost, atol=0.02)
    assert coarse.lost_slope > 0.15
    shape = resolving_shape(SIZE, coarse.shortest_measured)
    fine, report = condition(face, detrend=0, shape=shape)
    assert report.shortest_wave == report.shortest_measured >= 8 * max(fine.spacing)
    assert_allclose(fine.rms_slope, face.rms_slope, rtol=0.02)
    assert report.lost_slope < 1e-9


@pytest.mark.parametrize("wavelength", [7e-6, 3.31e-5])
def test_resolving_shape_gives_8_pixels_or_what_the_limit_allows(wavelength):
    shape = resolving_shape((1e-3, 0.7e-3), wavelength)
    pixels = wavelength * np.divide(shape, (1e-3, 0.7e-3))
    assert 8 <= min(pixels) <= max(pixels) < 8.8
    assert_allclose(resolving_shape((1e-3, 0.5e-3), 1e-6, most=5e4), (316, 158), rtol=0.05)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"shortest_wave": 1e-4}, r"wave: given 100 µm, .* 8 pixels = 250 µm.*shape=\(240, 160\)"),
        ({"shortest_wave": 0.1}, "less than the larger side, 3 mm"),
        ({"max_undefined": 1e-4}, "undefined points"),
    ],
)
def test_maps_that_cannot_be_conditioned_are_refused(given, message):
    with pytest.raises(InputError, match=f"(?s){message}"):
        condition(measured(), **given)
    assert condition(measured(), shortest_wave=1e-4, shape=(240, 160))[0].shape == (240, 160)


def test_a_single_spacing_holds_for_both_axes():
    assert Topography(np.zeros((4, 6)), 1e-6).spacing == (1e-6, 1e-6)
    gap = np.full((4, 6), 1e-6)
    assert cell_permeability(gap, 1e-6).value == cell_permeability(gap, (1e-6, 1e-6)).value


def test_an_automatic_grid_checks_the_shortest_wave_like_a_given_one():
    face = self_affine((32, 32), (32e-6, 32e-6), hurst=0.8, rms_slope=0.1, rng=1)
    for wave in (-1.0, 0.0, np.nan, "30 um"):
        for shape in ("auto", (32, 32), None):
            with pytest.raises(InputError, match="shortest_wave"):
                condition(face, shortest_wave=wave, shape=shape)
    assert condition(face, shape=np.array([32, 32]))[0].shape == (32, 32)

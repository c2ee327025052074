"""Measured faces before use: spikes, texture, spectrum, the report, and two faces laid on one another."""

import tracemalloc
from itertools import combinations
from math import inf, nan, pi
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import ndimage, sparse

import femseal as fs
from femseal.base import InputError
from femseal.topography import (
    Topography,
    combine,
    describe_surface,
    repair,
    self_affine,
    spectrum,
    spikes_extreme,
    turned,
)
from femseal.topography.texture import autocorrelation, texture

EXAMPLE = Path(__file__).parents[2] / "examples" / "measured_face.x3p"


def rough(shape=(160, 120), **given):
    return self_affine(
        shape,
        (160e-6, 120e-6),
        **{"hurst": 0.8, "rms_height": 1e-6, "cut_off": 5e-6, "rng": 2} | given,
    )


# --- spikes -----------------------------------------------------------------------------------------------


def open_map(z, spacing=(1e-6, 1e-6)):
    return Topography(z, spacing, (False, False))


def spikes(z, threshold=6.0):
    """Points of a map that are spikes."""
    return np.isnan(open_map(z).without_spikes(threshold).heights) & ~np.isnan(z)


def test_isolated_points_are_spikes_and_nothing_else_is():
    """One, two and four points side by side, up and down, at a corner, on a border, beside undefined ones."""
    z = rough().heights.copy()
    z[50:52, 60] = np.nan
    expected = np.zeros(z.shape, dtype=bool)
    for place, height in (
        ((0, 0), 8),
        ((30, 119), -8),
        ((50, 61), 9),
        (np.s_[80, 40:42], -9),
        (np.s_[100:102, 90:92], 8),
        ((120, 20), 300),
    ):
        expected[place] = True
        z[place] += height * 1e-6
    assert_array_equal(spikes(z), expected)
    # neither the unit nor a tilt that exceeds the roughness by far matters
    tilted = 1e3 * (z + 5e-6 * np.arange(z.shape[0])[:, None])
    assert_array_equal(spikes(tilted), expected)
    assert not spikes(z, inf).any()
    assert spikes(z, 1000).sum() < expected.sum()


def made_by_turning(**given):
    return turned((256, 256), (240e-6, 240e-6), rng=1, **given).heights


#: Faces without spikes: self-affine ones, turned ones, along the grid and oblique, and noise.
TURNED = made_by_turning(
    pitch=60e-6, depth=1.5e-6, feed_error=0.03, depth_error=0.1, roughness=1e-6
)


RIDGES = made_by_turning(  # a few pixels wide, with flanks of 60°
    pitch=10e-6, depth=5e-6, feed_error=0.1, depth_error=0.1, cut_off=2e-6
)


AFFINE = [
    self_affine((256, 256), (1e-3, 1e-3), hurst=h, rms_slope=0.5, cut_off=n * 1e-3 / 256, rng=4)
    for h, n in ((0.3, 2), (0.8, 4), (1.0, 8), (1.0, 2))
]


@pytest.mark.parametrize(
    "z",
    [
        *(face.heights for face in AFFINE),
        *(TURNED, ndimage.rotate(TURNED, 17, reshape=False, order=1, mode="mirror")),
        *(RIDGES, ndimage.rotate(RIDGES, 17, reshape=False, order=1, mode="mirror")),
        np.random.default_rng(0).standard_normal((500, 500)),
        np.full((20, 20), 3.3e-6),
    ],
)
def test_generated_surfaces_have_no_spikes(z):
    assert not spikes(z).any()


def test_edges_corners_walls_small_summits_and_quantised_heights_are_no_spikes():
    z = 1e-9 * np.random.default_rng(1).standard_normal((80, 80))
    z[10:30, 10:30] += 5e-6  # a plateau with walls
    z[40, :] += 5e-6  # a burr one point wide
    z[np.arange(45, 70), np.arange(45, 70)] += 5e-6  # and one along a diagonal
    z[60:62, 10:13] += 5e-6  # six points
    x = np.hypot(*np.meshgrid(np.arange(80) - 60, np.arange(80) - 20.3))
    z += 5e-6 * np.exp(-((x / 1.8) ** 2))  # a summit of 3 pixels at half its height
    steps = np.zeros((200, 200))
    steps.flat[np.random.default_rng(0).integers(0, steps.size, 2000)] = 1e-9
    for heights, place, height in ((z, (70, 30), 5e-6), (steps, (50, 50), 20e-9)):
        assert not spikes(heights).any()
        heights[place] += height
        assert_array_equal(np.argwhere(spikes(heights)), [place])


@pytest.mark.parametrize(
    ("given", "what"),
    [
        *(({"spikes": value}, "spikes") for value in (0, -1.0, nan, "six")),
        ({"detrend": 3}, "order"),
        ({"max_undefined": -1}, "max_share"),
    ],
)
def test_invalid_thresholds_and_orders_of_the_form_are_refused(given, what):
    """Also of a face with spikes, which have no part in it."""
    z = rough().heights.copy()
    z[5::10, 5::10] += 1e-4
    with pytest.raises(InputError, match=f"^{what}: given(?!.*spikes=inf)"):
        repair(open_map(z), **given)


def test_repair_fills_spikes_like_undefined_points():
    x1, x2 = np.indices((60, 40)) * 1e-6
    z = 1e-3 * x1 + 2e-3 * x2 + 1e-12 * np.random.default_rng(0).standard_normal(x1.shape)
    z[20, 20], z[40, 10] = 1e-6, np.nan
    whole, found = repair(open_map(z))
    assert (found.spike_points, found.undefined_fraction) == (1, 1 / z.size)
    assert_allclose(whole.heights, 0, atol=1e-11)
    assert_allclose(found.form.slopes, (1e-3, 2e-3), rtol=1e-5)
    kept, found = repair(open_map(z), spikes=inf, detrend=0)
    assert found.spike_points == 0
    assert_allclose(kept.heights[20, 20] - kept.heights[20, 22], 1e-6 - z[20, 22], rtol=1e-9)


def test_spikes_count_as_undefined():
    z = rough().heights.copy()
    z[5::10, 5::10] += 1e-4
    with pytest.raises(InputError, match=r"1 % undefined points, .*; 192 of them are spikes"):
        fs.condition(open_map(z), max_undefined=0.005)


# --- what the spikes mean ---------------------------------------------------------------------------------


def grooved(angle=0.0, shape=(200, 160)):
    """Grooves at right angles to (cos α, sin α) on 200 × 160 µm, the distance across them, and random numbers."""
    x1, x2 = ((np.arange(n) + 0.5) * s * 1e-6 / n for n, s in zip(shape, (200, 160), strict=True))
    s = x1[:, None] * np.cos(angle) + x2 * np.sin(angle)
    rng = np.random.default_rng(3)
    waves = 7 * rng.random(4), (14e-6, 19e-6, 23e-6, 31e-6)
    z = sum(1e-7 * np.cos(2 * pi * s / wave + phase) for phase, wave in zip(*waves, strict=True))
    return z + 1e-9 * rng.standard_normal(shape), s, rng


@pytest.mark.parametrize("angle", [0.0, -1.2])
def test_spikes_along_the_marks_of_machining_cause_a_warning(angle):
    z, s, rng = grooved(angle)
    beside = np.abs(s - s.mean()) < 5e-6
    z[beside & (rng.random(z.shape) < 0.06)] += 3e-6
    _, report = fs.condition(open_map(z))
    assert report.spike_points > 40
    assert report.spikes_extreme > 0.05
    (warning,) = report.spike_warnings
    assert f"would change if spikes were kept ({report.spike_points} points in spikes)" in warning


def test_exchanged_extremes_agree_with_a_count_on_the_map_with_spikes():
    """Spikes that stay below the summits and above the pits change no extreme; high or deep ones are the extremes."""
    face = rough().low_pass(8e-6)
    z = face.heights
    assert spikes_extreme(face, np.zeros(z.shape), 8e-6) == 0
    middle = np.argsort(np.abs(z - z.mean()), axis=None)[:40]
    for height, least, most in ((1e-8, 0, 0.01), (3e-4, 0.5, 1), (-3e-4, 0.5, 1)):
        removed = np.zeros(z.shape)
        removed.flat[middle] = height
        extreme = spikes_extreme(face, removed, 8e-6)
        # an independent count: points of the highest (lowest) percent that are new
        filtered = Topography(removed, face.spacing).low_pass(8e-6).heights
        before, high = (
            np.argsort(np.sign(height) * heights, axis=None)[-z.size // 100 :]
            for heights in (z, z + filtered)
        )
        assert extreme >= np.setdiff1d(high, before).size / high.size - 0.01
        assert least <= extreme <= most


# --- texture ----------------------------------------------------------------------------------------------


def test_autocorrelation_is_the_mean_over_pairs():
    face = rough((12, 9), cut_off=None)
    z = face.heights - face.heights.mean()
    correlation, wide = autocorrelation(face), np.pad(z, 12, constant_values=nan)
    assert correlation.shape == (13, 9)
    for i, j in ((0, 0), (3, 2), (6, -4), (-1, 4)):
        moved = wide[12 + i : 24 + i, 12 + j : 21 + j]
        assert_allclose(correlation[6 + i, 4 + j], np.nanmean(z * moved) / np.mean(z**2), rtol=1e-9)


def test_texture_of_a_cosine_wave_agrees_with_its_closed_form():
    """Its autocorrelation is cos(2πr/λ), which is 0.2 at λ arccos(0.2)/2π; it never decays along the crests."""
    x1 = (np.arange(200) + 0.5) * 1e-6
    face = Topography(np.cos(2 * pi * x1 / 50e-6)[:, None] * np.ones(80) * 1e-7, (1e-6, 2e-6))
    found = texture(face)
    assert_allclose(found.correlation_length, 50e-6 * np.arccos(0.2) / (2 * pi), atol=0.6e-6)
    assert_allclose(found.aspect_ratio, found.correlation_length / 80e-6, rtol=0.02)
    assert found.aspect_ratio_is_bound
    assert abs(found.lay_direction) < 1e-6


@pytest.mark.parametrize("degrees", [-80, -35, -3, 0, 20, 45, 90])
@pytest.mark.parametrize("shape", [(200, 160), (120, 240)])
def test_the_direction_of_the_lay_is_that_of_rotated_grooves(degrees, shape):
    """On square and on oblong pixels."""
    z, _, _ = grooved(np.deg2rad(degrees), shape)
    found = texture(open_map(z, (200e-6 / shape[0], 160e-6 / shape[1])))
    assert found.aspect_ratio < 0.2
    assert abs((np.rad2deg(found.lay_direction) - degrees + 90) % 180 - 90) < 0.7
    assert -pi / 2 < found.lay_direction <= pi / 2


LARGE = {"hurst": 0.8, "rms_slope": 0.1, "rng": 2}


def test_an_isotropic_face_has_no_lay_and_stretching_gives_it_one():
    face = rough((240, 240), roll_off=12e-6)
    face = Topography(face.heights, (1e-6, 1e-6))
    found = texture(face)
    assert found.aspect_ratio > 0.7
    assert np.isnan(found.lay_direction)
    stretched = texture(Topography(face.heights, (1e-6, 4e-6)))
    assert_allclose(stretched.correlation_length, found.correlation_length, rtol=0.2)
    assert_allclose(stretched.aspect_ratio, 1 / 4, rtol=0.3)
    assert abs(np.rad2deg(stretched.lay_direction)) < 10


# --- spectrum ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("hurst", "roll_off"), [(0.3, 2e-4), (0.8, None), (0.8, 2e-4), (1.0, None)]
)
@pytest.mark.parametrize("cut_off", [1.6e-5, 6e-6])
def test_the_power_law_of_a_generated_surface_is_recovered(hurst, roll_off, cut_off):
    given = LARGE | {"hurst": hurst, "roll_off": roll_off, "cut_off": cut_off}
    found = spectrum(self_affine((512, 400), (1e-3, 0.8e-3), **given))
    assert_allclose(found.shortest_wave, cut_off, rtol=0.04)
    assert found.noise == 0
    assert_allclose(found.law.hurst, hurst, atol=0.019)
    assert_allclose(found.law.roll_off, nan if roll_off is None else roll_off, rtol=0.05)
    assert_allclose(found.law.shortest, cut_off, rtol=0.2)


def test_noise_is_distinguished_from_the_surface():
    face = self_affine((512, 512), (1e-3, 1e-3), cut_off=6e-6, **LARGE)
    noise = np.random.default_rng(0).normal(0, 80e-9, face.shape)
    found = spectrum(Topography(face.heights + noise, face.spacing))
    assert_allclose(found.noise, 80e-9, rtol=0.03)
    # where C is four times that of the noise, that of the face itself is three times
    q, density = face.radial_psd()
    inside = (q > 0) & (q < 2 * pi / 6.5e-6)
    wave = 2 * pi / q[inside][density[inside] > 3 * (80e-9) ** 2 * np.prod(face.spacing)].max()
    assert_allclose(found.shortest_wave, wave, rtol=0.06)
    assert_allclose(found.law.hurst, 0.8, atol=0.01)


def test_a_part_of_a_surface_has_the_same_shortest_wave_as_the_whole():
    """Its borders bring short waves, but no noise: the cut-off shows below the power law."""
    face = self_affine((512, 512), (1e-3, 1e-3), hurst=0.8, rms_slope=0.1, cut_off=1.5e-5, rng=2)
    found = spectrum(face.crop((400, 450)).detrend())
    assert found.noise == 0
    assert_allclose(found.shortest_wave, 1.5e-5, rtol=0.1)
    assert_allclose(found.law.hurst, 0.8, atol=0.1)


def test_white_noise_and_single_waves_follow_no_law():
    z = np.random.default_rng(1).normal(0, 1e-8, (200, 200))
    found = spectrum(Topography(z, (1e-6, 1e-6)))
    assert found.law is None
    assert_allclose(found.noise, 1e-8, rtol=0.05)
    assert found.shortest_wave > 1e-4  # nothing of it was measured
    x = np.arange(200) * 1e-6
    for heights in (np.cos(2 * pi * x / 40e-6)[:, None] * np.ones(200), np.ones((50, 50))):
        assert spectrum(Topography(heights, (1e-6, 1e-6))).law is None


def test_parallel_grooves_have_the_hurst_exponent_of_their_profile():
    k = np.arange(1, 200)
    phase = 2 * pi * np.random.default_rng(3).random(k.size)
    x = (np.arange(1024) + 0.5) / 1024
    profile = np.sum(
        k ** (-0.5 - 0.7) * np.cos(2 * pi * k * x[:, None] + phase), axis=1
    )  # C1D ∝ q^(−1−2H)
    face = Topography(1e-7 * profile[:, None] * np.ones(1024), (1e-6, 1e-6))
    assert_allclose(spectrum(face).law.hurst, 0.7, atol=0.06)


# --- report -----------------------------------------------------------------------------------------------


def test_height_parameters_agree_with_iso_25178():
    z = rough().detrend().heights
    z = z - z.mean()
    tilted = z + 0.01 * np.arange(160)[:, None] * 1e-6
    report = describe_surface(open_map(tilted))
    assert_allclose(np.tan(report.tilt), (0.01, 0), atol=1e-9)
    assert_allclose(
        [report.rms_height, report.mean_height, report.peak_to_valley],
        [z.std(), np.abs(z).mean(), np.ptp(z)],
        rtol=1e-9,
    )
    moments = [np.mean(z**n) / z.std() ** n for n in (3, 4)]
    assert_allclose([report.skewness, report.kurtosis], moments, rtol=1e-9)
    other = describe_surface(open_map(tilted.T))
    assert_allclose(other.rms_slopes, report.rms_slopes[::-1], rtol=1e-9)


def test_a_flat_face_is_described():
    report = describe_surface(Topography(np.full((40, 40), 1e-3), (1e-6, 1e-6)), detrend=0)
    assert report.rms_height == report.rms_slope == 0
    unknown = [report.skewness, report.correlation_length, report.lay_direction, report.hurst]
    assert np.isnan(unknown).all()
    assert "–" in str(report)


def test_spikes_and_undefined_points_are_counted():
    z = rough().heights.copy()
    z[3, 4], z[50, 60:63] = 1e-4, np.nan
    report = describe_surface(Topography(z, (1e-6, 1e-6)))
    assert (report.spike_points, report.undefined_fraction) == (1, 3 / z.size)
    assert report.peak_to_valley > 1e-4  # heights as the instrument counts them
    # slopes without the spike
    assert_allclose(report.rms_slope, describe_surface(rough()).rms_slope, rtol=0.01)


def test_the_example_surface_is_described():
    report = describe_surface(fs.read_topography(EXAMPLE))
    assert report.spike_points < 5
    # as its script says, and so is the noise; from roll-off to resolution is too short for a power law
    assert_allclose(report.shortest_wave, 10e-6, rtol=0.05)
    assert np.isnan(report.hurst)
    assert_allclose(report.noise, 15e-9, rtol=0.6)
    assert abs(np.rad2deg(report.lay_direction) - 1.5) < 1.5


# --- two faces --------------------------------------------------------------------------------------------


def bump(u1, u2):
    """A smooth function without symmetry."""
    long = np.cos(2 * pi * u1 / 30e-6 + 0.4) + 0.5 * np.sin(2 * pi * u2 / 40e-6)
    return 1e-7 * (long + np.cos((u1 + 2 * u2) / 8e-6))


def from_the_middle(shape, spacing):
    return np.meshgrid(
        *((np.arange(n) - (n - 1) / 2) * d for n, d in zip(shape, spacing, strict=True)),
        indexing="ij",
    )


def moved_back(patches, angle, shift):
    """Places on a second face that was turned, then shifted."""
    d1, d2 = (p - s for p, s in zip(patches, shift, strict=True))
    return np.cos(angle) * d1 + np.sin(angle) * d2, np.cos(angle) * d2 - np.sin(angle) * d1


@pytest.mark.parametrize("mirror", [None, "x1", "x2"])
@pytest.mark.parametrize("degrees", [0, 90, 180, 30, -12.5])
@pytest.mark.parametrize("spacing", [(1e-6, 1e-6), (0.8e-6, 1.3e-6)])
def test_the_second_face_is_mirrored_then_turned_then_shifted(mirror, degrees, spacing):
    first = open_map(np.zeros((40, 50)), (1.1e-6, 0.9e-6))
    second = open_map(bump(*from_the_middle((100, 80), spacing)), spacing)
    shift, angle = (7e-6, -4e-6), np.deg2rad(degrees)
    both, overlap = combine(first, second, mirror=mirror, rotate=angle, shift=shift)
    u1, u2 = moved_back(from_the_middle(first.shape, first.spacing), angle, shift)
    expected = bump(-u1 if mirror == "x1" else u1, -u2 if mirror == "x2" else u2)
    assert both.shape == overlap.shape == first.shape
    assert (overlap.resampled, overlap.fraction) == (True, 1.0)
    assert_allclose(both.heights[3:-3, 3:-3], expected[3:-3, 3:-3], atol=3e-9)
    assert_allclose(both.heights, expected, atol=5e-8)


@pytest.mark.parametrize("degrees", [0, 10, 33, 45, 60, 80])
def test_the_largest_rectangle_that_both_faces_cover_is_kept(degrees):
    first = open_map(np.zeros((14, 17)))
    second, angle, shift = open_map(np.zeros((12, 9))), np.deg2rad(degrees), (0.4e-6, 0.7e-6)
    u1, u2 = moved_back(from_the_middle((14, 17), first.spacing), angle, shift)
    inside = (np.abs(u1) <= 6e-6 + 1e-12) & (np.abs(u2) <= 4.5e-6 + 1e-12)
    areas = [
        (q - p) * (t - r)
        for p, q in combinations(range(15), 2)
        for r, t in combinations(range(18), 2)
        if inside[p:q, r:t].all()
    ]
    both, overlap = combine(first, second, rotate=angle, shift=shift)
    assert both.heights.size == max(areas)
    assert_allclose(overlap.fraction, max(areas) / (14 * 17))


def test_coinciding_faces_are_added_point_by_point():
    a, b = rough(), rough(rng=5)
    both, overlap = combine(a, b)
    assert_array_equal(both.heights, a.heights + b.heights)
    assert (both.periodic, overlap.fraction, overlap.resampled) == ((True, True), 1.0, False)
    turned_over, _ = combine(a, a.flip(1), mirror="x2")
    assert_array_equal(turned_over.heights, 2 * a.heights)
    # the same face on a finer grid of the same size
    fine, overlap = combine(a, rough((320, 240), rng=5))
    assert_allclose(fine.heights, both.heights, atol=1e-12)
    assert (fine.periodic, overlap.resampled) == ((True, True), True)
    # a shift by whole pixels
    part, overlap = combine(a, b, shift=(10e-6, -25e-6))
    assert_allclose(part.heights, a.heights[10:, :-25] + b.heights[:-10, 25:], atol=1e-12)
    assert (overlap.shape, part.periodic) == ((150, 95), (False, False))


def test_waves_too_short_for_the_first_grid_are_not_folded():
    x = (np.arange(400) + 0.5) * 0.25e-6
    fine = Topography(np.cos(2 * pi * x / 1.25e-6)[:, None] * np.ones(400), (0.25e-6, 0.25e-6))
    both, _ = combine(Topography(np.zeros((80, 80)), (1e-6, 1e-6)), fine)
    assert np.abs(both.heights).max() < 1e-3


FACE = rough()


HOLED = Topography(np.where(np.arange(120) == 7, nan, FACE.heights), FACE.spacing)


@pytest.mark.parametrize(
    ("pair", "given", "said"),
    [
        ((FACE, FACE), {"shift": (200e-6, 0)}, "shift: given 200 µm × 0 m, .* still overlaps"),
        ((FACE, FACE), {"mirror": "x3"}, "mirror: given 'x3'"),
        ((FACE, FACE), {"rotate": inf}, "rotate: given inf"),
        ((FACE, HOLED), {}, r"undefined points, .* use fill_undefined\(\) first"),
        ((HOLED, FACE), {}, r"undefined points, .* use fill_undefined\(\) first"),
        ((HOLED, FACE), {"shift": (5e-6, 0)}, r"undefined points, .* use fill_undefined\(\)"),
        ((FACE, HOLED), {"shift": (5e-6, 0)}, "second face: given undefined points"),
    ],
)
def test_faces_that_do_not_overlap_or_have_undefined_points_are_refused(pair, given, said):
    with pytest.raises(InputError, match=said):
        combine(*pair, **given)


def most_memory(work):
    """Largest memory [byte] that a function takes beyond the memory before."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_spikes_of_a_large_map_take_less_memory_than_its_contact():
    n = 512
    z = np.random.default_rng(0).standard_normal((n, n))
    face = Topography(z, (1e-6, 1e-6), periodic=False)
    # a low-pass does not copy its result
    assert most_memory(lambda: face.low_pass(8e-6)) < 10 * n**2
    removed = sparse.coo_array(([3.0, -2.0], ([5, 70], [60, 2])), shape=z.shape)
    # a contact takes 37 bytes per point
    assert most_memory(lambda: spikes_extreme(face, removed, 8e-6)) < 28 * n**2

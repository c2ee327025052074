"""Generated faces: exact spectra and rms values, grid independence, the geometry of turned grooves."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from femseal.base import InputError
from femseal.topography import self_affine, turned

SIZE = (1e-3, 0.6e-3)


def face(shape=(160, 96), size=SIZE, **given):
    return self_affine(shape, size, **{"hurst": 0.8, "rms_height": 1e-7, "rng": 3} | given)


# --- self-affine ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(160, 96), (161, 97), (160, 200)])
def test_rms_values_are_met_exactly(shape):
    assert_allclose(face(shape).rms_height, 1e-7, rtol=1e-12)
    assert_allclose(face(shape, rms_height=None, rms_slope=0.1).rms_slope, 0.1, rtol=1e-12)
    assert abs(face(shape).heights.mean()) < 1e-20
    assert face(shape).periodic == (True, True)


@pytest.mark.parametrize("cut_off", [None, 5e-5, 2.1 * SIZE[0] / 160])
def test_every_realisation_has_exactly_the_target_spectrum(cut_off):
    roll_off, hurst = 3e-4, 0.7
    surface = face(roll_off=roll_off, hurst=hurst, cut_off=cut_off)
    shares = np.abs(np.fft.fft2(surface.heights)) ** 2
    q1, q2 = map(np.fft.fftfreq, surface.shape, surface.spacing)
    q = 2 * np.pi * np.hypot(q1[:, None], q2)
    last = 2 * np.pi / (cut_off or 8 * max(surface.spacing))
    inside = (q > 0) & (q < last * (1 - 1e-6))
    target = np.maximum(q[inside] / (2 * np.pi / roll_off), 1) ** (-2 - 2 * hurst)
    assert_allclose(shares[inside] / shares[inside].sum(), target / target.sum(), rtol=1e-9)
    assert shares[~inside].max() < 1e-20 * shares.max()


def test_the_seed_determines_the_surface():
    assert_allclose(face().heights, face().heights, rtol=0)
    assert_allclose(face(rng=np.random.default_rng(3)).heights, face().heights, rtol=0)
    assert abs(np.corrcoef(face(rng=4).heights.ravel(), face().heights.ravel())[0, 1]) < 0.9


@pytest.mark.parametrize("fine", [(320, 192), (240, 161), (161, 97)])
@pytest.mark.parametrize("rms", [{"rms_height": 1e-7}, {"rms_height": None, "rms_slope": 0.1}])
def test_a_finer_grid_samples_the_same_surface(fine, rms):
    coarse, finer = face(cut_off=3e-5, **rms), face(fine, cut_off=3e-5, **rms)
    for one, other in ((finer, coarse), (coarse, finer)):
        sampled = one.resample(other.shape).heights
        assert_allclose(sampled, other.heights, atol=1e-12 * coarse.rms_height)


def test_heights_of_many_waves_are_gaussian():
    surface = face((512, 512), (1e-3, 1e-3), roll_off=5e-5)
    z = surface.heights / surface.rms_height
    assert_allclose((z**3).mean(), 0, atol=0.1)
    assert_allclose((z**4).mean(), 3, atol=0.2)


def test_the_surface_is_isotropic_on_rectangular_pixels():
    surface = face((128, 512), (1e-3, 1e-3), rms_height=None, rms_slope=0.1)
    assert_allclose(surface.rms_slopes, 0.1 / np.sqrt(2), rtol=1e-9)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"hurst": 0.0}, "hurst: given 0.0, expected"),
        ({"hurst": 1.2}, r"hurst: given 1.2, expected a number in \(0, 1\]"),
        ({"rms_height": None}, "rms_slope, rms_height: given neither, expected exactly one"),
        ({"rms_slope": 0.1}, "rms_slope, rms_height: given both"),
        ({"rms_height": -1e-7}, "rms_height: given -1e-07"),
        ({"cut_off": 1e-6}, "cut_off: given 1 µm, expected a wavelength >= 2 pixels"),
        ({"cut_off": 2e-3}, "cut_off: given 2 mm, .* and < the larger side = 1 mm"),
        ({"shape": (4, 4)}, "cut_off: given 2 mm, .* and < the larger side = 1 mm"),
        ({"roll_off": 1e-5}, "roll_off: given 10 µm, expected a wavelength > cut_off"),
        ({"shape": (0, 4)}, "shape: given"),
        ({"size": (1e-3, -1.0)}, "size: given"),
        ({"rng": "dice"}, "rng: given 'dice'"),
        ({"rng": None}, "rng: given None"),
    ],
)
def test_bad_self_affine_input_is_refused(given, message):
    with pytest.raises(InputError, match=message):
        face(**given)


# --- turned -----------------------------------------------------------------------------------------------


def groove(shape=(800, 80), size=(1e-3, 1e-4), **given):
    return turned(
        shape, size, **{"pitch": 1e-4, "depth": 1e-6, "cut_off": 2.5e-6, "rng": 5} | given
    )


def arc(x1, pitch, radius):
    return ((x1 % pitch) - pitch / 2) ** 2 / (2 * radius)


@pytest.mark.parametrize(
    ("depth", "nose_radius", "height"),
    [(1e-6, None, 1e-6), (1e-5, 1e-3, 1e-4**2 / 8e-3)],
)
def test_profile_is_the_arc_of_the_tool(depth, nose_radius, height):
    """A ridge is the square of the pitch over eight radii high."""
    given = {"depth": depth, "nose_radius": nose_radius, "cut_off": 6e-7}
    surface = groove((4000, 2), (1e-3, 5e-7), **given)
    x1 = (np.arange(4000) + 0.5) * surface.spacing[0]
    expected = arc(x1, 1e-4, 1e-4**2 / (8 * height))
    # The low-pass rounds the ridges within about a cut-off; elsewhere it rings with a small amplitude.
    away = np.abs(x1 % 1e-4 - 5e-5) < 4.8e-5
    assert_allclose(surface.heights[away, 0], expected[away], atol=2e-9)
    assert_allclose(np.ptp(surface.heights), height, rtol=0.01)


def test_wide_feed_leaves_lands_at_the_depth_of_cut():
    radius, depth = 2e-4, 1e-6
    surface = groove((4000, 2), size=(1e-3, 5e-7), cut_off=6e-7, depth=depth, nose_radius=radius)
    x1 = (np.arange(4000) + 0.5) * surface.spacing[0]
    assert_allclose(surface.heights[:, 0], np.minimum(arc(x1, 1e-4, radius), depth), atol=2e-8)
    land = np.mean(surface.heights > 0.98 * depth)
    assert_allclose(land, 1 - 2 * np.sqrt(2 * radius * depth) / 1e-4, atol=0.03)


def test_spectrum_peaks_at_the_pitch():
    q, density = groove(feed_error=0.03, roughness=1e-8).psd(0)
    assert_allclose(q[1:][np.argmax(density[1:])], 2 * np.pi / 1e-4)


def test_turned_surfaces_are_periodic_along_the_seal_and_over_whole_pitches():
    given = {"feed_error": 0.1, "depth_error": 0.2, "waviness": 1e-7, "roughness": 1e-8}
    surface = groove((400, 64), cut_off=2e-5, **given)
    assert surface.periodic == (True, True)
    assert_allclose(surface.high_pass(2e-5).heights, 0, atol=1e-19)
    # A surface that closes has no jump between its last and its first pixel.
    for axis in (0, 1):
        jumps = np.abs(np.diff(surface.heights, axis=axis, append=surface.heights.take([0], axis)))
        assert jumps.take([-1], axis).max() < 5 * np.sqrt((jumps**2).mean())
    assert groove(pitch=0.9e-4).periodic == (False, True)
    assert groove(waviness=1e-7, waviness_length=3e-4).periodic == (False, True)
    assert groove(waviness_length=3e-4).periodic == (True, True)


def test_grooves_without_errors_are_constant_along_the_seal():
    assert np.ptp(groove().heights, axis=1).max() < 1e-18
    assert np.ptp(groove(feed_error=0.05).heights, axis=1).max() > 1e-8
    assert np.ptp(groove(depth_error=0.05).heights, axis=1).max() > 1e-8


def test_errors_of_grooves_have_the_given_rms_values():
    # Bottoms of many grooves, where their neighbours do not reach: lowest value and its place in each pitch.
    count, per = 400, 64
    given = {"feed_error": 0.05, "depth_error": 0.04, "cut_off": 1.3e-5, "rng": 7}
    surface = groove((count * per, 16), (count * 1e-4, 1e-4), **given)
    pitches = surface.heights.reshape(count, per, 16)
    assert_allclose(pitches.min(axis=1).std(), 0.04e-6, rtol=0.15)
    assert_allclose(pitches.argmin(axis=1).std() / per, 0.05, rtol=0.15)


def test_the_lowest_of_all_passes_is_found_with_large_errors():
    # Reference: all passes of a closed face by brute force, with errors so large that distant ones matter.
    from femseal.topography import generate

    rng, x1 = np.random.default_rng(1), (np.arange(300)[:, None] + 0.5) / 300
    turn = (2 * np.pi * (np.arange(4) + 0.5) / 4)[None, :]
    z = generate._cut_grooves(x1, turn, 10, 0.1, 5.0, (0.04, 2e-3), rng)
    rng = np.random.default_rng(1)
    constant, wander = rng.standard_normal((2, 2, 10, 1))
    along = np.cos(turn + 2 * np.pi * rng.random((2, 10, 1)))
    shift, drop = np.array([0.04, 2e-3])[:, None, None] * (np.sqrt(0.5) * constant + wander * along)
    passes = [
        (x1 - (k + 0.5) * 0.1 - shift[k % 10]) ** 2 / 10.0 - drop[k % 10] for k in range(-60, 70)
    ]
    assert_allclose(z, np.min(passes, axis=0), rtol=1e-12)


@pytest.mark.parametrize(("name", "height"), [("waviness", 2e-7), ("roughness", 1e-7)])
def test_waviness_and_roughness_add_their_mean_squares(name, height):
    plain, other = (groove((400, 64), cut_off=2e-5, **{name: value}) for value in (0.0, height))
    assert_allclose((other.heights - plain.heights).std(), height, rtol=1e-9)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"pitch": 2e-6}, "pitch: given 2 µm, expected more than cut_off = 2.5 µm"),
        ({"pitch": 2e-3}, r"pitch: given 2 mm, .* at most size\[0\] = 1 mm"),
        ({"depth": 0.0}, "depth: given 0.0"),
        ({"nose_radius": -1.0}, "nose_radius: given -1.0"),
        ({"feed_error": 0.7}, r"feed_error: given 0.7, expected a number in \[0, 0.5\]"),
        ({"depth_error": 2.0}, r"depth_error: given 2.0, expected a number in \[0, 1\]"),
        ({"waviness": -1e-7}, "waviness: given -1e-07"),
        ({"waviness_length": 0.0}, "waviness_length: given 0.0"),
        ({"roughness": np.nan}, "roughness: given nan"),
        ({"rng": None}, "rng: given None"),
    ],
)
def test_bad_turned_input_is_refused(given, message):
    with pytest.raises(InputError, match=message):
        groove(**given)

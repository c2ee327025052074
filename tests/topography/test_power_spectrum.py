"""Power law, noise and shortest wave of spectra that are known."""

from math import inf, nan, pi

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import fft, stats

import femseal as fs
from femseal.topography import (
    Topography,
    self_affine,
    spectrum,
)

LARGE = {"hurst": 0.8, "rms_slope": 0.1, "rng": 2}


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


def gaussian_face(hurst, seed, n=128, roll_off=inf):
    """Self-affine, of random amplitudes and phases, down to waves of 6 pixels."""
    q = np.hypot(fft.fftfreq(n)[:, None], fft.fftfreq(n)[None, :])
    amplitude = np.where(
        (q > 0) & (q < 1 / 6), np.maximum(q, max(1 / n, 1 / roll_off)) ** -(1 + hurst), 0.0
    )
    z = fft.ifft2(fft.fft2(np.random.default_rng(seed).standard_normal((n, n))) * amplitude).real
    return fs.Topography(1e-7 * z / z.std(), (1e-6, 1e-6))


@pytest.mark.parametrize("hurst", [0.3, 0.8])
def test_the_error_of_the_hurst_exponent_contains_its_true_value(hurst):
    laws = [spectrum(gaussian_face(hurst, seed)).law for seed in range(24)]
    off = np.array([(law.hurst - hurst) / law.hurst_error for law in laws])
    assert np.sum(np.abs(off) < 2) >= stats.binom.ppf(0.01, off.size, 0.954)  # two standard errors
    assert 0.5 < np.std(off) < 2


SHORT_BAND = {"rms_slope": 0.1, "roll_off": 40e-6}


@pytest.mark.parametrize("hurst", [0.3, 0.5, 0.8, 1.0])
def test_the_hurst_exponent_of_a_short_band_behind_a_plateau(hurst):
    """Of generated surfaces, periodic and levelled ones, which a plane leaves with a step at the border."""
    for seed in (1, 2):
        face = fs.self_affine((256, 256), (256e-6, 256e-6), hurst=hurst, rng=seed, **SHORT_BAND)
        for order, tolerance in ((0, 0.02), (1, 0.07)):
            law = spectrum(face.detrend(order)).law
            assert abs(law.hurst - hurst) < min(tolerance, 2 * law.hurst_error)
            assert_allclose(law.roll_off, 40e-6, rtol=0.1)


@pytest.mark.parametrize("roll_off", [24, 40, 128])
def test_the_error_of_the_hurst_exponent_of_random_amplitudes(roll_off):
    """A range of a factor of 4 to 21 in wavelength: two stated errors contain nearly all, and are not much too large."""
    laws = [spectrum(gaussian_face(0.8, seed, n=256, roll_off=roll_off)).law for seed in range(24)]
    off = np.array([(law.hurst - 0.8) / law.hurst_error for law in laws])
    assert np.sum(np.abs(off) < 2) >= stats.binom.ppf(0.01, off.size, 0.954)
    assert 0.4 < np.sqrt(np.mean(off**2)) < 1.4
    assert abs(np.mean([law.hurst for law in laws]) - 0.8) < 0.04

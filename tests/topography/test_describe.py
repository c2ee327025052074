"""The report on a surface: parameters of drawings and of ISO 25178 against closed forms and another program."""

from math import pi, sqrt
from pathlib import Path

import numpy as np
import pytest
from measured_maps import open_map, rough_map
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.special import ellipe
from scipy.stats import norm

import femseal as fs
from femseal.topography import (
    Topography,
    describe_surface,
)
from femseal.topography.describe import developed_area, material_ratios


def test_the_core_of_heights_that_rise_evenly_is_their_range():
    found = material_ratios(
        np.random.default_rng(0).permutation(np.linspace(-1e-6, 2e-6, 10_000)).reshape(100, 100)
    )
    assert_allclose(found["sk"], 3e-6, rtol=1e-3)  # 10 000 points
    assert_allclose([found["spk"], found["svk"]], 0, atol=1e-9)
    # one rms height is 1/√12 of the range
    assert_allclose(found["smr"], (0.5 - 12**-0.5, 0.5, 0.5 + 12**-0.5), atol=1e-4)


def test_the_core_of_a_gaussian_face():
    """The secant from 30 to 70 % falls least; the line fitted there has the slope ∫(p − ½)Φ⁻¹(p)dp 12/0.4³, 2.574."""
    z = norm.ppf((np.arange(250_000) + 0.5) / 250_000).reshape(500, 500) * 1e-6
    found = material_ratios(z)
    sk = quad(lambda p: (p - 0.5) * norm.ppf(p), 0.3, 0.7)[0] * 12 / 0.4**3
    peaks = 2 * (norm.pdf(sk / 2) / norm.sf(sk / 2) - sk / 2)
    assert_allclose(sk, 2.574, atol=5e-4)
    assert_allclose(
        [found["sk"], found["spk"], found["svk"]], np.array([sk, peaks, peaks]) * 1e-6, rtol=1e-3
    )
    assert_allclose(found["smr"], norm.cdf([-1, 0, 1]), atol=1e-4)


def test_plateau_and_valleys_have_their_core_parameters():
    """60 % of the area at one height and even valleys below: no core, and the triangle of the valleys is theirs."""
    z = np.concatenate([np.zeros(6000), -np.linspace(0, 1e-6, 4001)[1:]]).reshape(100, 100)
    found = material_ratios(z)
    assert_allclose([found["sk"], found["spk"]], 0, atol=1e-15)
    assert_allclose(found["svk"], 1e-6, rtol=1e-3)


def ridged(profile, columns, pixel):
    """A description of a face whose heights vary along x1 alone."""
    face = fs.Topography(profile[:, None] * np.ones(columns), (pixel, pixel))
    return fs.describe_surface(face, detrend=0, spikes=np.inf)


@pytest.mark.parametrize("wave", [100e-6, 250e-6, 500e-6])
def test_roughness_of_a_wave_is_exact(wave):
    """Half of a wave of the cut-off passes; of a wave of length l, 2**-(cut-off/l)² is waviness."""
    height, x = 0.5e-6, (np.arange(1000) + 0.5) * 1e-6
    report = ridged(height * np.cos(2 * pi * x / wave), 400, 1e-6)
    assert report.profile_cut_off == (800e-6, 80e-6)  # no roughness along the lay
    left = height * (1 - 2 ** -((800e-6 / wave) ** 2)) * 2 ** -((2.5e-6 / wave) ** 2)
    assert_allclose([report.ra[0], report.sa], 2 / pi * left, rtol=2e-3)
    assert_allclose([report.rq[0], report.sq], left / sqrt(2), rtol=2e-3)
    assert_allclose([report.rz[0], report.sz], 2 * left, rtol=2e-3)
    assert_allclose([report.rsk[0], report.ssk], 0, atol=2e-3)


def test_the_height_of_profiles_is_the_mean_of_their_sections():
    x = (np.arange(4000) + 0.5) * 0.25e-6
    waves = np.cos(2 * pi * x / 8e-6) * (1 + np.floor(x / 80e-6)) * 1e-9
    report = ridged(waves, 4, 0.25e-6)
    assert report.profile_cut_off[0] == 80e-6
    # mean of 1 … 12 nm; the half of a section at the end, with 13 nm, does not count
    assert_allclose(report.rz[0], 2 * 2 ** -((2.5 / 8) ** 2) * 6.5e-9, rtol=0.05)
    assert np.isnan(report.ra[1])


def test_flat_surfaces_and_surfaces_without_a_cut_off_are_described():
    flat = material_ratios(np.zeros((3, 3)))
    assert flat["sk"] == flat["spk"] == flat["svk"] == 0
    assert np.isnan(material_ratios(np.full((3, 3), np.nan))["sk"])
    face = fs.self_affine((32, 32), (3.2e-5, 3.2e-5), hurst=0.8, rms_slope=0.1, rng=1)
    small = fs.describe_surface(face, detrend=0)
    assert np.isnan([small.sk, small.sdr, *small.nesting_index, *small.smr]).all()


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("slope", [0.01, 0.5, 2.0])
def test_the_area_of_a_wave_is_an_elliptic_integral(slope, axis):
    """Mean of √(1 + s² cos²): 2/π √(1 + s²) E(s²/(1 + s²)); s²/4 for small slopes."""
    x = (np.arange(640) + 0.5) * 2 * pi / 40
    z = np.tile(slope * np.cos(x), (7, 1))
    found = developed_area(z if axis else z.T, (2 * pi / 40, 2 * pi / 40))
    area = 2 / pi * sqrt(1 + slope**2) * ellipe(slope**2 / (1 + slope**2))
    assert_allclose(found, area - 1, rtol=1e-3)


@pytest.mark.parametrize("cut_off", [10e-6, 20e-6])
def test_parameters_agree_with_another_program(cut_off):
    size, given = (1.2e-3, 1.2e-3), {"hurst": 0.7, "rms_height": 0.5e-6, "cut_off": cut_off}
    face = fs.self_affine((600, 600), size, **given, rng=5)
    report = fs.describe_surface(face, detrend=0, spikes=np.inf)
    assert report.nesting_index == (2.5e-6, 800e-6)
    surface = pytest.importorskip("surfalize").Surface(face.heights * 1e6, 2.0, 2.0)
    other = surface.filter("lowpass", 2.5).filter("highpass", 800)
    found = np.array([report.sa, report.sq, report.sz])
    assert_allclose(found, 1e-6 * np.array([other.Sa(), other.Sq(), other.Sz()]), rtol=1e-3)
    assert_allclose(report.ssk, other.Ssk(), atol=1e-3)
    if cut_off > 10e-6:
        found = np.array([report.sk, report.spk, report.svk])
        assert_allclose(found, 1e-6 * np.array([other.Sk(), other.Spk(), other.Svk()]), rtol=5e-3)
        assert_allclose(100 * report.sdr, other.Sdr(), rtol=0.01)


EXAMPLE = Path(__file__).parents[2] / "examples" / "measured_face.x3p"


def test_height_parameters_agree_with_iso_25178():
    z = rough_map().detrend().heights
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
    z = rough_map().heights.copy()
    z[3, 4], z[50, 60:63] = 1e-4, np.nan
    report = describe_surface(Topography(z, (1e-6, 1e-6)))
    assert (report.spike_points, report.undefined_fraction) == (1, 3 / z.size)
    assert report.peak_to_valley > 1e-4  # heights as the instrument counts them
    # slopes without the spike
    assert_allclose(report.rms_slope, describe_surface(rough_map()).rms_slope, rtol=0.01)


def test_the_example_surface_is_described():
    report = describe_surface(fs.read_topography(EXAMPLE))
    assert report.spike_points < 5
    # as its script says, and so is the noise; from roll-off to resolution is too short for a power law
    assert_allclose(report.shortest_wave, 10e-6, rtol=0.05)
    assert np.isnan(report.hurst)
    assert_allclose(report.noise, 15e-9, rtol=0.6)
    assert abs(np.rad2deg(report.lay_direction) - 1.5) < 1.5

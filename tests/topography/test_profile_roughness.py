"""Ra and Rz of profiles in closed form, and the filter that they need."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.base import InputError
from femseal.topography.profile_roughness import profile_roughness
from femseal.topography.roughness_filters import long_wave_filter


def test_ra_and_rz_of_a_wave_have_closed_forms():
    """Ra is 2/π of the amplitude and Rz twice the amplitude; a wave of ten times the filter does not count."""
    n, pixel, amplitude = 4000, 1e-6, 1e-6
    x = (np.arange(n) + 0.5) * pixel
    wave = amplitude * np.cos(2 * np.pi * x / 1e-4)
    long_wave = 5e-6 * np.cos(2 * np.pi * x / 4e-3)
    for heights in (wave, wave + long_wave):
        surface = fs.Topography(np.outer(heights, np.ones(4)), (pixel, pixel))
        found = profile_roughness(surface, 1e-4)
        assert found.cut_off == 2.5e-4
        assert_allclose([found.ra, found.rz], [2 / np.pi * amplitude, 2 * amplitude], rtol=0.06)
    short = fs.Topography(np.outer(wave[:200], np.ones(4)), (pixel, pixel))
    unfiltered = profile_roughness(short, 1e-4)
    assert np.isnan(unfiltered.cut_off)
    assert_allclose(
        [unfiltered.ra, unfiltered.rz], [2 / np.pi * amplitude, 2 * amplitude], rtol=1e-3
    )
    # ISO 21920-3: RSm up to 0.04, 0.13, 0.4 and 1.3 mm
    assert [long_wave_filter(rsm) for rsm in (4e-5, 1e-4, 1.5e-4, 1e-3)] == [
        8e-5,
        2.5e-4,
        8e-4,
        2.5e-3,
    ]


def test_half_of_a_wave_as_long_as_the_filter_counts():
    """By definition, the Gaussian filter transmits 50 % at its cut-off: Ra is 1/π of the amplitude, not 2/π."""
    cut_off, amplitude = 0.8e-3, 1e-6
    x = (np.arange(4000) + 0.5) * 1e-6  # five periods
    wave = amplitude * np.cos(2 * np.pi * x / cut_off)
    surface = fs.Topography(np.outer(wave, np.ones(2)), (1e-6, 1e-6))
    # of periodic profiles with this spacing, and of irregular ones with Ra from 0.1 to 2 µm
    for found in (profile_roughness(surface, 0.15e-3), profile_roughness(surface)):
        assert found.cut_off == cut_off
        assert_allclose(found.ra, amplitude / np.pi, rtol=1e-5)
        assert_allclose(found.rq, amplitude / np.sqrt(8), rtol=1e-5)
        assert_allclose(found.rz, amplitude, rtol=1e-5)


@pytest.mark.parametrize("ra", [0.05e-6, 0.8e-6, 3e-6])
def test_the_filter_of_an_irregular_profile_follows_from_its_roughness(ra):
    """Ra of 0.02 to 0.1, 0.1 to 2 and 2 to 10 µm need 0.25, 0.8 and 2.5 mm; a shorter surface is not filtered."""
    cut_off = {0.05e-6: 0.25e-3, 0.8e-6: 0.8e-3, 3e-6: 2.5e-3}[ra]
    x = (np.arange(3000) + 0.5) * 1e-6
    wave = np.pi / 2 * ra * np.cos(2 * np.pi * x / 30e-6)
    surface = fs.Topography(np.outer(wave, np.ones(2)), (1e-6, 1e-6))
    assert profile_roughness(surface).cut_off == cut_off
    short = fs.Topography(surface.heights[:600], (1e-6, 1e-6))
    found = profile_roughness(short)
    if cut_off > 600e-6:
        assert np.isnan(found.cut_off)
    assert_allclose(found.ra, ra, rtol=1e-2)


@pytest.mark.parametrize("sections", [4.5, 5.0, 12.8])
def test_rz_is_the_mean_height_of_sections_as_long_as_the_filter(sections):
    """One section of λc is twice as high as all others; a section that is not complete does not count."""
    cut_off, amplitude, pixel = 0.8e-3, 1e-6, 2e-6
    x = (np.arange(round(sections * cut_off / pixel)) + 0.5) * pixel
    # waves of a fortieth of λc are not filtered, and end with a section
    wave = amplitude * np.sin(2 * np.pi * x / (cut_off / 40))
    is_second = (x > cut_off) & (x < 2 * cut_off)
    surface = fs.Topography(np.outer(np.where(is_second, 2, 1) * wave, np.ones(4)), (pixel, pixel))
    whole = int(sections)
    exact = 2 * amplitude * (whole + 1) / whole
    for found in (
        profile_roughness(surface, 0.15e-3).rz,
        fs.describe_surface(surface, detrend=0, spikes=np.inf).rz[0],
    ):
        assert_allclose(found, exact, rtol=0.02)


@pytest.mark.parametrize("stated", [{"ra": 0.0}, {"rz": -1e-6}, {"ra": np.nan}])
def test_a_stated_roughness_is_a_number_above_0(stated):
    surface = fs.Topography(np.zeros((64, 4)), (1e-6, 1e-6))
    with pytest.raises(InputError, match=rf"^{next(iter(stated))}: given"):
        profile_roughness(surface, **stated)

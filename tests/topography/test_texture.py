"""Autocorrelation, aspect ratio and lay of a surface against closed forms and counts."""

from math import nan, pi

import numpy as np
import pytest
from measured_maps import grooved_heights, open_map, rough_map
from numpy.testing import assert_allclose

from femseal.topography import (
    Topography,
)
from femseal.topography.texture import autocorrelation, texture


def test_autocorrelation_is_the_mean_over_pairs():
    face = rough_map((12, 9), cut_off=None)
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
    z, _, _ = grooved_heights(np.deg2rad(degrees), shape)
    found = texture(open_map(z, (200e-6 / shape[0], 160e-6 / shape[1])))
    assert found.aspect_ratio < 0.2
    assert abs((np.rad2deg(found.lay_direction) - degrees + 90) % 180 - 90) < 0.7
    assert -pi / 2 < found.lay_direction <= pi / 2


def test_an_isotropic_face_has_no_lay_and_stretching_gives_it_one():
    face = rough_map((240, 240), roll_off=12e-6)
    face = Topography(face.heights, (1e-6, 1e-6))
    found = texture(face)
    assert found.aspect_ratio > 0.7
    assert np.isnan(found.lay_direction)
    stretched = texture(Topography(face.heights, (1e-6, 4e-6)))
    assert_allclose(stretched.correlation_length, found.correlation_length, rtol=0.2)
    assert_allclose(stretched.aspect_ratio, 1 / 4, rtol=0.3)
    assert abs(np.rad2deg(stretched.lay_direction)) < 10

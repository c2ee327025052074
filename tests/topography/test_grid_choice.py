"""The grid that resolves the shortest wave."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from femseal.topography import (
    condition,
    resolving_shape,
    self_affine,
)

SIZE = (3e-3, 2e-3)


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

"""Spectra of real maps from half of their waves."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from waves_and_noise import white_noise

from femseal.topography.waves import wave_powers, wavenumber_grids


@pytest.mark.parametrize("periodic", [(True, True), (False, True), (True, False), (False, False)])
@pytest.mark.parametrize("shape", [(24, 18), (25, 17)])
def test_slopes_and_spectra_of_half_the_waves_are_those_of_all(shape, periodic):
    """Of even and odd numbers of points: a Nyquist wave is its own conjugate."""
    rough = white_noise(shape, periodic)
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

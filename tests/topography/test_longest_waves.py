"""Longest waves of a measured patch: how many of them it has, and whether longer ones are to be expected."""

import warnings

import numpy as np
import pytest
from larger_faces import SIDE, D, N, patch_of_larger_face
from numpy.testing import assert_allclose

import femseal as fs
from femseal.topography import representative


@pytest.mark.parametrize("shape", [(2, 64), (64, 2), (3, 200), (1, 64), (5, 5), (4, 1000)])
@pytest.mark.parametrize("periodic", [True, False])
def test_a_narrow_patch_is_described_without_a_warning_of_numpy(shape, periodic):
    """Of an octave without waves nothing is known: the spectrum does not count as rising."""
    heights = 1e-7 * np.random.default_rng(1).standard_normal(shape)
    patch = fs.Topography(heights, (1e-6, 1e-6), periodic)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        waves = representative(patch)
    assert waves.rises in (True, False)
    assert np.isnan(waves.density) == np.isnan(waves.octave)
    assert str(waves)


@pytest.mark.parametrize("seed", range(4))
def test_a_roll_off_within_the_patch_is_found(seed):
    waves = representative(patch_of_larger_face(seed, SIDE / 5, cut_off=4 * D))
    assert_allclose(waves.longest, SIDE / 5, rtol=0.25)
    assert_allclose(waves.waves, (5, 5), rtol=0.25)
    assert not waves.rises
    assert waves.warnings == []


def test_the_plateau_has_the_density_of_its_waves():
    face = patch_of_larger_face(3, SIDE / 5, cut_off=4 * D, n=2 * N)
    waves = representative(face.crop((N, N)).detrend(1))
    assert waves.roll_off == waves.longest
    # the plateau of all waves from the roll-off to the cut-off with a rms slope of 0.05
    q = 2 * np.pi / np.array([SIDE / 5, 4 * D])
    plateau = (
        2 * np.pi * 0.05**2 / (q[0] ** 3.6 * (q[1] ** 0.4 - q[0] ** 0.4) / 0.4 + q[0] ** 4 / 4)
    )
    assert 0.5 < waves.density / plateau < 2


@pytest.mark.parametrize("seed", range(4))
def test_a_spectrum_that_rises_up_to_the_side_has_longer_waves(seed):
    waves = representative(patch_of_larger_face(seed, roll_off=2 * SIDE))
    assert waves.rises
    assert waves.roll_off is None
    assert min(waves.waves) < 2.5
    assert len(waves.warnings) == 1


def test_waves_without_a_power_law_are_counted_by_the_autocorrelation():
    wave = SIDE / 12
    x1 = (np.arange(N) + 0.5) * D
    heights = np.cos(2 * np.pi * x1 / wave)[:, None] * np.full((1, N), 1e-7)
    waves, flat = (representative(fs.Topography(of, (D, D))) for of in (heights, 0 * heights))
    assert_allclose(waves.longest, wave * np.arccos(0.2) / (2 * np.pi) / 0.27, rtol=0.05)
    assert waves.is_enough
    assert np.isnan(flat.longest)
    assert flat.is_enough


def test_of_several_patches_the_one_with_fewest_waves_counts():
    patches = [
        patch_of_larger_face(1, SIDE / 5, 4 * D),
        patch_of_larger_face(2, 2 * SIDE),
        patch_of_larger_face(3, SIDE / 5, 4 * D),
    ]
    waves = representative(fs.Patches(patches))
    assert waves == representative(patches[1])

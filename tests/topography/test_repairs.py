"""Spikes and undefined points: what is found, and what is filled in."""

from math import inf, nan

import numpy as np
import pytest
from measured_maps import grooved_heights, most_memory, open_map, rough_map
from numpy.testing import assert_allclose, assert_array_equal
from scipy import ndimage, sparse

import femseal as fs
from femseal.base import InputError
from femseal.topography import (
    Topography,
    repair,
    self_affine,
    spikes_extreme,
    turned,
)


def spikes(z, threshold=6.0):
    """Points of a map that are spikes."""
    return np.isnan(open_map(z).without_spikes(threshold).heights) & ~np.isnan(z)


def test_isolated_points_are_spikes_and_nothing_else_is():
    """One, two and four points side by side, up and down, at a corner, on a border, beside undefined ones."""
    z = rough_map().heights.copy()
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
    z = rough_map().heights.copy()
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
    z = rough_map().heights.copy()
    z[5::10, 5::10] += 1e-4
    with pytest.raises(InputError, match=r"1 % undefined points, .*; 192 of them are spikes"):
        fs.condition(open_map(z), max_undefined=0.005)


@pytest.mark.parametrize("angle", [0.0, -1.2])
def test_spikes_along_the_marks_of_machining_cause_a_warning(angle):
    z, s, rng = grooved_heights(angle)
    beside = np.abs(s - s.mean()) < 5e-6
    z[beside & (rng.random(z.shape) < 0.06)] += 3e-6
    _, report = fs.condition(open_map(z))
    assert report.spike_points > 40
    assert report.spikes_extreme > 0.05
    (warning,) = report.spike_warnings
    assert f"would change if spikes were kept ({report.spike_points} points in spikes)" in warning


def test_exchanged_extremes_agree_with_a_count_on_the_map_with_spikes():
    """Spikes that stay below the summits and above the pits change no extreme; high or deep ones are the extremes."""
    face = rough_map().low_pass(8e-6)
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


def test_spikes_of_a_large_map_take_less_memory_than_its_contact():
    n = 512
    z = np.random.default_rng(0).standard_normal((n, n))
    face = Topography(z, (1e-6, 1e-6), periodic=False)
    # a low-pass does not copy its result
    assert most_memory(lambda: face.low_pass(8e-6)) < 10 * n**2
    removed = sparse.coo_array(([3.0, -2.0], ([5, 70], [60, 2])), shape=z.shape)
    # a contact takes 37 bytes per point
    assert most_memory(lambda: spikes_extreme(face, removed, 8e-6)) < 28 * n**2

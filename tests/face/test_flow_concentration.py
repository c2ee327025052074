"""Where a surface carries its flow: closed forms, and independence of the grid and of other loads."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import steel_scene

import femseal as fs
from femseal.face.cell_flow import FlowSettings, drop_fractions, solve_surface_flow
from femseal.face.flow_concentration import (
    blocks_of_one_wave,
    participation_number,
    short_wave,
)
from femseal.studies.patch_state import PatchState
from femseal.topography import Patches

SPACING = (1e-6, 1e-6)
FLOW = FlowSettings()


def carriers_of(gap, blocks):
    through = solve_surface_flow(gap, SPACING, FLOW)
    return participation_number(drop_fractions(gap, SPACING, through.potential, FLOW), blocks)


def test_a_uniform_gap_is_carried_by_all_blocks_alike():
    gap = np.full((32, 64), 1e-6)
    assert_allclose(carriers_of(gap, (4, 8)), 32)


@pytest.mark.parametrize("channels", [1, 2, 4])
def test_separate_channels_along_the_flow_are_counted_by_their_blocks(channels):
    """Each is one block broad and crosses four rows of blocks; its walls take the rest of it."""
    gap = np.zeros((32, 64))
    for n in range(channels):
        gap[:, 16 * n + 1 : 16 * n + 7] = 1e-6
    assert_allclose(carriers_of(gap, (4, 8)), 4 * channels)


def test_a_constriction_carries_the_whole_drop():
    gap = np.full((32, 64), 1e-5)
    gap[16:18] = 0.0
    gap[16:18, 20:24] = 1e-7
    assert 1 <= carriers_of(gap, (4, 8)) < 1.05


def test_no_block_of_a_sealed_surface_carries_flow():
    gap = np.full((32, 64), 1e-6)
    gap[10] = 0.0
    assert np.isnan(carriers_of(gap, (4, 8)))


def test_participation_does_not_depend_on_the_size_of_the_dissipation():
    rng = np.random.default_rng(1)
    d = rng.lognormal(sigma=2, size=(24, 40))
    assert_allclose(participation_number(d, (5, 7)), participation_number(1e-9 * d, (5, 7)))
    assert np.isnan(participation_number(np.zeros((24, 40)), (5, 7)))


def rough(points, seed=1):
    waves = {"hurst": 0.8, "rms_slope": 0.2, "roll_off": 20e-6, "cut_off": 8e-6}
    face = fs.self_affine((64, 64), (64e-6, 64e-6), **waves, rng=seed)
    return face.resample((points, points))


def test_the_short_wave_is_one_of_the_surface_and_not_of_its_pixels():
    waves = [short_wave(rough(n)) for n in (64, 128, 256)]
    assert_allclose(waves, waves[0], rtol=1e-6)
    assert 8e-6 <= waves[0] < 11e-6  # of those between 8 and 20 µm
    assert blocks_of_one_wave(rough(128)) == blocks_of_one_wave(rough(64))
    wave = np.cos(2 * np.pi * 4 * (np.arange(64) + 0.5) / 64)
    single = fs.Topography(np.tile(wave, (64, 1)), SPACING)
    assert_allclose(short_wave(single), 16e-6)


def test_patches_beside_each_other_have_the_wave_of_each():
    one = fs.Topography(rough(64).heights, SPACING, (False, False))
    other = fs.Topography(1e-6 + one.heights, SPACING, (False, False))
    assert_allclose(short_wave(Patches([one, other])), short_wave(one))
    m1, m2 = blocks_of_one_wave(one)
    assert blocks_of_one_wave(Patches([one, other])) == (m1, 2 * m2)


def states_of(points, loading, **changes):
    scene = replace(steel_scene(rough(points), loading=loading, **changes), rtol=1e-6)
    drawn = fs.stochastic(scene, None, fs.Sampling(256e-6, realisations=1, seed=1))
    assert isinstance(drawn.patch_state, PatchState)
    return drawn.patch_state


def test_the_state_of_a_patch_is_the_same_on_twice_the_points():
    coarse, fine = (states_of(n, (1e8, 4e8)) for n in (64, 128))
    assert_allclose(fine.carriers, coarse.carriers, rtol=0.1)
    assert_allclose(fine.contact_fraction, coarse.contact_fraction, rtol=0.1)


def test_the_state_of_a_patch_does_not_depend_on_other_loads():
    alone = states_of(64, (4e8,))
    among = states_of(64, (1e8, 2e8, 4e8, 6e8), unload_from=(4e8,), unloading=(3e8, 1e8))
    for name in ("carriers", "contact_fraction", "open_leakage"):
        assert_allclose(getattr(among, name)[2], getattr(alone, name)[0], rtol=1e-3)
    # unloading is as uncertain as its peak, but its gap is its own
    for name in ("carriers", "contact_fraction"):
        values = getattr(among, name)
        assert (values[4:] == values[2]).all()
    assert (among.open_leakage[4:] > among.open_leakage[2]).all()

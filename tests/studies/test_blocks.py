"""A face solved by blocks: against the whole, on any mapper alike, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import steel_scene

import femseal as fs
from femseal.execution.run import ordered_map
from femseal.topography import Patches

D, N = 1e-6, 128


def scene(surface=None, **changed):
    waves = {"rms_slope": 0.15, "roll_off": 24 * D, "cut_off": 8 * D, "rng": 3}
    face = surface or fs.self_affine((N, N), (N * D, N * D), hurst=0.8, **waves)
    loads = {"loading": (1e8, 3e8), "unload_from": (3e8,), "unloading": (1e8,)}
    patch = fs.Topography(face.heights, (D, D), (False, False))
    return steel_scene(patch, **{"boundary": ("free", "mirror")} | loads | changed)


def wavy(height):
    """A face with one narrow crest along it, highest at the inlet."""
    rough, x = scene().surface, (np.arange(N) + 0.5) / N
    form = height * (1.5 * np.cos(np.pi * x)[None, :] ** 4 + 0.5 * np.cos(np.pi * x)[:, None])
    return rough.with_heights(rough.heights + form)


@pytest.mark.parametrize(
    "height",
    [2e-6, *(pytest.param(height, marks=pytest.mark.slow) for height in (0.0, 0.5e-6))],
)
def test_blocks_leak_as_the_whole_face(height):
    """Also where a form of several times the roughness decides, which no block by itself has."""
    one = scene(wavy(height))
    whole = fs.deterministic(one).leakage
    found = fs.by_blocks(one, (2, 2))
    assert found.failures == ()
    assert_allclose(np.log(found.leakage / whole), 0, atol=np.log(1.8))


@pytest.mark.slow
def test_cells_press_where_the_whole_face_does():
    one = scene(wavy(2e-6))
    whole = fs.two_scale(one, (8, 8)).cells.pressure
    found = fs.by_blocks(one, (2, 2)).pressure
    for mine, its in zip(found, whole, strict=True):
        assert np.corrcoef(mine.ravel(), its.ravel())[0, 1] > 0.8


@pytest.mark.slow
def test_cells_carry_the_load_and_come_back():
    found = fs.by_blocks(scene(wavy(1e-6)), (1, 2))
    assert found.pressure.shape == (3, 4, 8)
    assert_allclose(found.pressure.mean(axis=(1, 2)), [1e8, 3e8, 1e8], rtol=1e-3)
    elastic = fs.by_blocks(scene(wavy(1e-6), hardness=np.inf), (1, 2))
    assert_allclose(elastic.leakage[2], elastic.leakage[0], rtol=1e-2)


def test_two_processes_compute_the_same_bits_as_one():
    pressed_once = scene(wavy(1e-6), loading=(3e8,), unload_from=(), unloading=())
    in_this_process = fs.by_blocks(pressed_once, (2, 2))
    with ordered_map(workers=2) as mapper:
        in_two_processes = fs.by_blocks(pressed_once, (2, 2), mapper=mapper)
    assert_array_equal(in_two_processes.leakage, in_this_process.leakage)
    assert_array_equal(in_two_processes.k1, in_this_process.k1)


@pytest.mark.parametrize(
    ("changed", "blocks", "text"),
    [
        (
            {},
            (3, 2),
            "blocks: given 3 × 2 of 128 × 128 points, expected numbers of blocks whose 4 × 4 cells di",
        ),
        ({}, (8, 8), r"blocks: .*at least 8 points"),
        (
            {"fluid_pressure": "trapped"},
            (2, 2),
            "fluid_pressure: given 'trapped' with blocks, expec",
        ),
        (
            {"surface": Patches([scene().surface, scene().surface.flip(0)])},
            (2, 2),
            "several patches",
        ),
    ],
)
def test_what_blocks_cannot_do_is_refused(changed, blocks, text):
    with pytest.raises(fs.InputError, match=text):
        fs.by_blocks(replace(scene(), **changed), blocks)


@pytest.mark.slow
def test_a_fluid_that_acts_lets_more_through_as_it_does_in_the_whole_face():
    one = scene(inlet_pressure=4e7, unload_from=(), unloading=())
    acting = replace(one, fluid_pressure="acts")
    whole = fs.deterministic(acting).leakage / fs.deterministic(one).leakage
    found = fs.by_blocks(acting, (2, 2)).leakage / fs.by_blocks(one, (2, 2)).leakage
    assert (whole > 1.1).all()
    assert_allclose(np.log(found), np.log(whole), rtol=0.25)


def test_all_that_the_fluid_carries_is_open():
    open_ = fs.by_blocks(scene(inlet_pressure=2.2e8, fluid_pressure="acts"), (2, 2))
    assert np.isnan(open_.leakage[[0, 2]]).all()
    assert open_.leakage[1] > 0
    assert [text.split(":")[1] for text in open_.failures] == [" open", " open"]

"""Seals under an uneven pressure: their tiles follow their own histories, and flow adds up as it must."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import steel_scene

from femseal import Topography, self_affine
from femseal.loads import LoadProgramme
from femseal.seal import AngleTable, AnnularLayout, MapsAtLoads, Profile, Uniform
from femseal.studies import Sampling, stochastic
from femseal.studies.tabulated_pressures import interpolate_along_paths
from femseal.studies.tile_pressure import MOST_OF_SEVERAL, MOST_PATHS, distinct_paths

LOADS = {"loading": (5e7, 1e8, 2e8), "unload_from": (2e8,), "unloading": (1e8, 5e7)}
STRIP = Sampling(length=64 * 32e-6, breadth=4 * 32e-6, realisations=4, seed=3, median_fields=False)
RING = replace(STRIP, length=None, breadth=None)
LAYOUT = AnnularLayout(64 * 32e-6 / (2 * np.pi) - 64e-6, 64 * 32e-6 / (2 * np.pi) + 64e-6)


def scene_of(heights, **given):
    surface = Topography(heights, (1e-6, 1e-6), (False, True))
    return steel_scene(surface, **{"modulus": 1e11, "hardness": 1e9, "rtol": 1e-7} | LOADS | given)


def rough(shape, rng):
    waves = {"rms_slope": 0.1, "roll_off": 24e-6, "cut_off": 8e-6, "rng": rng}
    size = shape[0] * 1e-6, shape[1] * 1e-6
    return self_affine(shape, size, hurst=0.8, **waves).heights


@pytest.fixture(scope="module")
def equal():
    """A face whose cells are all the same."""
    return scene_of(np.tile(rough((32, 32), 1), (2, 3)))


@pytest.fixture(scope="module")
def random():
    return scene_of(rough((64, 96), 2))


def drawn(scene, sampling, pressure_map=None):
    return stochastic(scene, (2, 3), replace(sampling, pressure_map=pressure_map or Uniform()))


def along(cells, paths, steps):
    """Permeability along x1 of a cell, all being the same, along paths of the pressure (steps, paths)."""
    return interpolate_along_paths(cells, paths, steps)[0, 0, :, :, 0]


def under(scene, shares, cells):
    """Permeability of a cell, all being the same, whose nominal pressure is multiplied (steps, shares)."""
    return along(cells, scene.steps.pressures[:, None] * np.atleast_1d(shares), scene.steps)


@pytest.mark.parametrize("shape", ["strip", "ring"])
def test_a_uniform_map_is_none_bit_for_bit(random, shape):
    scene, sampling = (
        (random, STRIP) if shape == "strip" else (replace(random, layout=LAYOUT), RING)
    )
    none = drawn(scene, sampling)
    for even in (
        Profile((2.0,)),
        AngleTable((0.7, 0.7, 0.7)),
        MapsAtLoads((1e8,), (Profile((3.0, 3.0)),)),
    ):
        assert_array_equal(drawn(scene, sampling, even).leakage, none.leakage)


HALVES = AngleTable((1.5, 1.5, 0.5, 0.5), tuple(np.radians((0.1, 179.9, 180.1, 359.9))))
#: Leakage of the strip over a permeability.
OVER_K = 1e6 / (1e-3 * 128e-6)


def test_a_tile_has_its_own_peak(equal):
    """On unloading from 200 MPa a tile under 1.5 times the pressure comes from 300 MPa."""
    result = drawn(equal, STRIP, HALVES)
    cycle = LoadProgramme.of([2e8], [2e8], [1e8])
    own, other = (
        along(result.cells, np.array([peaks, (1.5e8, 0.5e8)]), cycle)[1].mean()
        for peaks in ((3e8, 1e8), (2e8, 2e8))
    )
    at = [s.name for s in equal.steps].index("unloading 100 MPa from 200 MPa")
    assert_allclose(result.leakage[0, at], own * OVER_K, rtol=1e-6)
    assert abs(np.log(own / other)) > 0.1


@pytest.mark.parametrize("shape", ["strip", "ring"])
def test_long_waves_leak_as_the_mean_of_local_seals(random, shape):
    """Waves of period 2, 4 and 8 around a seal against the mean of uniform seals of the same cells."""
    one, sampling = (random, STRIP) if shape == "strip" else (replace(random, layout=LAYOUT), RING)
    angle = np.linspace(0, 2 * np.pi, 256, endpoint=False)
    loads = np.linspace(0.55, 1.45, 7)
    uniform = replace(one, loading=tuple(1e8 * loads), unload_from=(), unloading=())
    curves = np.log(drawn(uniform, sampling).leakage)
    shares = 1 + 0.4 * np.cos(angle)
    mean = np.mean(np.exp([np.interp(shares, loads, curve) for curve in curves]))
    step = one.steps.loading.index(1e8)
    waves = [AngleTable(tuple(1 + 0.4 * np.cos(angle * n)), tuple(angle)) for n in (2, 4, 8)]
    *found, even = (drawn(one, sampling, of).leakage[:, step].mean() for of in (*waves, None))
    assert np.abs(np.log(np.array(found) / mean)).max() < 0.03
    # far from what the nominal pressure leaks everywhere
    assert abs(np.log(even / mean)) > 0.05


def test_a_map_for_each_load_turns_the_seal_round(equal):
    """The pressed half changes sides with the load: a tile may be unloaded while the seal is loaded."""
    halves = Profile((1.5, 0.5)), Profile((0.5, 1.5))
    turning = drawn(equal, STRIP, MapsAtLoads((5e7, 1e8), halves))
    shares = np.where(equal.steps.pressures[:, None] > 7e7, [0.5, 1.5], [1.5, 0.5])
    k = along(turning.cells, equal.steps.pressures[:, None] * shares, equal.steps)
    assert_allclose(turning.leakage[0], 2 / (1 / k).sum(axis=1) * OVER_K, rtol=1e-6)
    virgin = under(equal, [0.5, 1.5], turning.cells)
    assert k[1, 0] < 0.95 * virgin[1, 0]  # at 100 MPa the first half has 50 MPa, after 75 MPa
    assert_allclose(k[1, 1], virgin[1, 1])


def test_few_paths_are_exact():
    shares = np.array([[1.0, 2.0, 1.0, 0.5], [1.0, 2.0, 1.5, 0.5]])
    paths, number = distinct_paths(shares)
    assert_array_equal(paths[:, number], shares)
    assert distinct_paths(np.ones((3, 1000)))[0].shape == (3, 1)


@pytest.mark.parametrize(("steps", "most"), [(1, MOST_PATHS), (2, MOST_OF_SEVERAL)])
def test_many_paths_are_rounded_and_keep_their_mean(steps, most):
    shares = np.random.default_rng(1).gamma(2, 0.5, (steps, 20000))
    paths, number = distinct_paths(shares)
    assert paths.shape[1] <= most
    assert_allclose(paths[:, number].mean(axis=1), shares.mean(axis=1), rtol=1e-12)
    if steps == 1:
        off = np.abs(np.cbrt(paths[:, number]) - np.cbrt(shares)).max()
        assert off < np.cbrt(shares.max()) / MOST_PATHS

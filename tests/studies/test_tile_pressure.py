"""Seals under an uneven pressure: their tiles follow their own histories, and flow adds up as it must."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from femseal import InputError, Liquid, Topography, self_affine
from femseal.face.curves import local_peaks
from femseal.loads import LoadProgramme
from femseal.seal.layouts import AnnularLayout
from femseal.seal.pressure_map import AngleTable, MapsAtLoads, PressureField, Profile, Uniform
from femseal.studies import Sampling, Scene
from femseal.studies.drawn_study import stochastic
from femseal.studies.piece_states import along_paths
from femseal.studies.tile_pressure import MOST_OF_SEVERAL, MOST_PATHS, distinct_paths

LOADS = {"loading": (5e7, 1e8, 2e8), "unload_from": (2e8,), "unloading": (1e8, 5e7)}
STRIP = Sampling(length=64 * 32e-6, breadth=4 * 32e-6, realisations=4, seed=3, median_fields=False)
RING = replace(STRIP, length=None, breadth=None)
LAYOUT = AnnularLayout(64 * 32e-6 / (2 * np.pi) - 64e-6, 64 * 32e-6 / (2 * np.pi) + 64e-6)


def scene_of(heights, **given):
    surface = Topography(heights, (1e-6, 1e-6), (False, True))
    return Scene(
        surface,
        1e11,
        1e9,
        Liquid(1e-3),
        1e6,
        0.0,
        **LOADS | {"rtol": 1e-7, "fluid_pressure": "ignored"} | given,
    )


@pytest.fixture(scope="module")
def equal():
    """A face whose pieces are all the same."""
    piece = self_affine(
        (32, 32), (32e-6, 32e-6), hurst=0.8, rms_slope=0.1, roll_off=24e-6, cut_off=8e-6, rng=1
    )
    return scene_of(np.tile(piece.heights, (2, 3)))


@pytest.fixture(scope="module")
def random():
    face = self_affine(
        (64, 96), (64e-6, 96e-6), hurst=0.8, rms_slope=0.1, roll_off=24e-6, cut_off=8e-6, rng=2
    )
    return scene_of(face.heights)


def drawn(scene, sampling, pressure_map=None):
    return stochastic(scene, (2, 3), replace(sampling, pressure_map=pressure_map or Uniform()))


def along(pieces, paths, steps):
    """Permeability along x1 of a piece, all being the same, along paths of the pressure (steps, paths)."""
    return along_paths(pieces, paths, steps)[0, 0, :, :, 0]


def under(scene, shares, pieces):
    """Permeability of a piece, all being the same, whose nominal pressure is multiplied (steps, shares)."""
    return along(pieces, scene.steps.pressures[:, None] * np.atleast_1d(shares), scene.steps)


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


def test_halves_around_a_seal_are_in_parallel(equal):
    """Under 1.5 and 0.5 times the pressure: the mean of both leakages."""
    halves = AngleTable((1.5, 1.5, 0.5, 0.5), tuple(np.radians((0.1, 179.9, 180.1, 359.9))))
    result = drawn(equal, STRIP, halves)
    expected = under(equal, [1.5, 0.5], result.pieces).mean(axis=1) * 1e6 / (1e-3 * 128e-6)
    assert_allclose(result.leakage, np.tile(expected, (4, 1)), rtol=1e-6)


def test_halves_across_a_seal_are_in_series(equal):
    result = drawn(equal, STRIP, Profile((1.5, 0.5)))
    expected = 2 / (1 / under(equal, [1.5, 0.5], result.pieces)).sum(axis=1) * 1e6 / (1e-3 * 128e-6)
    assert_allclose(result.leakage, np.tile(expected, (4, 1)), rtol=1e-6)
    # the curves are those of a seal that has these pressures everywhere, but for their interpolation; a single piece
    # jumps as its constrictions close
    for share, k in zip((1.5, 0.5), under(equal, [1.5, 0.5], result.pieces).T, strict=True):
        loads = {name: tuple(share * p for p in pressures) for name, pressures in LOADS.items()}
        alone = drawn(replace(equal, **loads), STRIP)
        assert_allclose(k * 1e6 / (1e-3 * 128e-6), alone.leakage[0], rtol=0.03)


def test_a_tile_has_its_own_peak(equal):
    """On unloading from 200 MPa a tile under 1.3 times the pressure comes from 260 MPa."""
    result = drawn(
        equal,
        STRIP,
        AngleTable((1.3, 1.3, 0.7, 0.7), tuple(np.radians((0.1, 179.9, 180.1, 359.9)))),
    )
    cycle = LoadProgramme.of([2e8], [2e8], [1e8])
    own = [
        along(result.pieces, np.array([peak, (1.3e8, 0.7e8)]), cycle)[1]
        for peak in ((2.6e8, 1.4e8), (2e8, 2e8))
    ]
    at = [s.name for s in equal.steps].index("unloading 100 MPa from 200 MPa")
    assert_allclose(result.leakage[0, at], own[0].mean() * 1e6 / (1e-3 * 128e-6), rtol=1e-6)
    assert abs(np.log(own[0].mean() / own[1].mean())) > 0.1


@pytest.mark.parametrize("shape", ["strip", "ring"])
def test_long_waves_leak_as_the_mean_of_local_seals(random, shape):
    """Waves of period 2, 4 and 8 around a seal against the mean of uniform seals of the same pieces."""
    scene, sampling = (
        (random, STRIP) if shape == "strip" else (replace(random, layout=LAYOUT), RING)
    )
    angle = np.linspace(0, 2 * np.pi, 256, endpoint=False)
    loads = tuple(1e8 * np.linspace(0.55, 1.45, 7))
    local = drawn(replace(scene, loading=loads, unload_from=(), unloading=()), sampling)
    at = np.exp(
        [
            np.interp(1 + 0.4 * np.cos(angle), np.array(loads) / 1e8, np.log(curve))
            for curve in local.leakage
        ]
    )
    step = scene.steps.loading.index(1e8)
    errors = []
    for period in (2, 4, 8):
        wave = AngleTable(tuple(1 + 0.4 * np.cos(angle * period)), tuple(angle))
        leakage = drawn(scene, sampling, wave).leakage[:, step]
        errors.append(np.log(leakage.mean() / at.mean()))
    assert np.abs(errors).max() < 0.03, errors
    # far from what the nominal pressure leaks everywhere
    assert abs(np.log(drawn(scene, sampling).leakage[:, step].mean() / at.mean())) > 0.05


def test_a_field_on_a_ring_is_its_table(random):
    ring = replace(random, layout=LAYOUT)
    r = np.linspace(LAYOUT.inner_radius, LAYOUT.outer_radius, 5)
    angle = np.arange(360) * (np.pi / 180)
    points = (r[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)).reshape(-1, 2)
    field = PressureField.of(points, 1e8 * (1 + 0.5 * np.cos(3 * np.tile(angle, 5))))
    table = AngleTable(tuple(1 + 0.5 * np.cos(3 * angle)), tuple(angle))
    one, other = (drawn(ring, RING, pressure_map).leakage for pressure_map in (field, table))
    assert_allclose(one, other, rtol=0.02)


def test_a_map_for_each_load_turns_the_seal_round(equal):
    """The pressed half changes sides with the load: a tile may be unloaded while the seal is loaded."""
    halves = Profile((1.5, 0.5)), Profile((0.5, 1.5))
    turning = drawn(equal, STRIP, MapsAtLoads((5e7, 1e8), halves))
    paths = equal.steps.pressures[:, None] * np.array(
        [[1.5, 0.5], [0.5, 1.5], [0.5, 1.5], [0.5, 1.5], [1.5, 0.5]]
    )
    k = along(turning.pieces, paths, equal.steps)
    assert_allclose(turning.leakage[0], 2 / (1 / k).sum(axis=1) * 1e6 / (1e-3 * 128e-6), rtol=1e-6)
    virgin = under(equal, [0.5, 1.5], turning.pieces)
    assert k[1, 0] < 0.95 * virgin[1, 0]  # at 100 MPa the first half has 50 MPa, after 75 MPa
    assert_allclose(k[1, 1], virgin[1, 1])


def test_local_peaks():
    steps = LoadProgramme.of([1, 2, 3, 4], [2, 4], [1.5, 1, 0.5])
    names = [(s.pressure, s.unloaded_from) for s in steps]
    assert names[4:] == [(1.5, 2), (1, 2), (0.5, 2), (1.5, 4), (1, 4), (0.5, 4)]
    rising, wild = steps.pressures, np.array([1, 3, 2, 5, 2, 4, 1, 1, 6, 2.0])
    found = local_peaks(np.stack([rising, wild], axis=1), steps)
    assert_array_equal(found[:, 0], steps.pressures[steps.peak_indices])
    assert_array_equal(found[:, 1], [1, 3, 3, 5, 3, 4, 4, 5, 6, 6])


class TestPaths:
    def test_few_are_exact(self):
        shares = np.array([[1.0, 2.0, 1.0, 0.5], [1.0, 2.0, 1.5, 0.5]])
        paths, number = distinct_paths(shares)
        assert paths.shape == (2, 4)
        assert_array_equal(paths[:, number], shares)
        assert distinct_paths(np.ones((3, 1000)))[0].shape == (3, 1)
        assert distinct_paths(np.ones((3, 0)))[0].shape[0] == 3

    @pytest.mark.parametrize("steps", [1, 2])
    def test_many_are_rounded_and_keep_their_mean(self, steps):
        shares = np.random.default_rng(1).gamma(2, 0.5, (steps, 20000))
        paths, number = distinct_paths(shares)
        assert paths.shape[1] <= (MOST_PATHS if steps == 1 else MOST_OF_SEVERAL)
        assert_allclose(paths[:, number].mean(axis=1), shares.mean(axis=1), rtol=1e-12)
        if steps == 1:
            assert (
                np.abs(np.cbrt(paths[:, number]) - np.cbrt(shares)).max()
                < np.cbrt(shares.max()) / MOST_PATHS
            )

    def test_rounding_moves_no_leakage(self, random, monkeypatch):
        wave = AngleTable(
            tuple(1 + 0.5 * np.cos(np.linspace(0, 6, 50))), tuple(np.linspace(0, 6, 50))
        )
        exact = drawn(random, STRIP, wave).leakage
        monkeypatch.setattr("femseal.studies.tile_pressure.MOST_PATHS", 48)
        rounded = drawn(random, STRIP, wave).leakage
        assert not np.array_equal(exact, rounded)
        assert_allclose(rounded, exact, rtol=0.02)


def test_what_is_refused(random):
    with pytest.raises(
        InputError, match=r"positions: given 0 m to 100 µm, expected a range that holds"
    ):
        drawn(random, STRIP, Profile((1.0, 2.0), (0.0, 1e-4)))
    with pytest.raises(InputError, match=r"field: given .* expected one that covers the seal"):
        drawn(random, STRIP, PressureField.of([[0, 0], [1e-4, 0], [0, 2e-3]], [1e8, 1e8, 1e8]))

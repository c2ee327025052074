"""States of a face cut into cells: what the face leaks, the ladder, and cells along any path of the pressure."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import steel_scene

from femseal.base import NotConverged
from femseal.face import cells as face_cells
from femseal.face.cells import CellState
from femseal.face.curves import local_peaks
from femseal.face.cut import Cut
from femseal.loads import LoadProgramme, LoadStep
from femseal.seal.tiles import face_tiles
from femseal.studies import deterministic, tabulated_pressures, two_scale
from femseal.studies.cell_states import solve_cells_at_pressures
from femseal.studies.tabulated_pressures import choose_tabulated_pressures, interpolate_along_paths
from femseal.topography import Patches, self_affine

SIDE = 48e-6


@cache
def face(rng=2, n=48):
    return self_affine((n, n), (SIDE, SIDE), hurst=0.8, rms_slope=0.15, roll_off=SIDE / 2, rng=rng)


def scene(**changed):
    cycle = {"loading": (5e7, 2e8, 5e8), "unload_from": (5e8,), "unloading": (2e8, 5e7)}
    return steel_scene(**({"surface": face()} | cycle | changed))


def in_order(one, cells):
    """Leakage of the cells in their own order, times the factor of each state."""
    tiles = face_tiles(one.surface.size, cells.cut.shape)
    k = cells.k[0].reshape(2, len(cells.steps), -1)
    flows = [
        tiles.seal.flow(tiles.permeability(*k[:, s]), bounds=True).conductance
        for s in range(len(cells.steps))
    ]
    return np.array(flows) / tiles.seal.length * (one.inlet_pressure / 1e-3) * cells.factor


@pytest.mark.parametrize("numbers", [(2, 2), (4, 4), (1, 3), (3, 1)])
def test_cells_in_their_order_times_the_factor_leak_what_the_face_leaks(numbers):
    one = scene()
    cells = two_scale(one, numbers).cells
    assert_allclose(in_order(one, cells), deterministic(one).leakage, rtol=2e-5)
    assert_allclose(cells.surface_leakage, deterministic(one).leakage, rtol=1e-9)
    assert_allclose(cells.cells_leakage * cells.factor, cells.surface_leakage, rtol=1e-9)
    assert not cells.failures
    assert not cells.unsolved


def test_patches_are_those_of_the_face():
    one = scene(surface=Patches([face(), face(3), face(4)]))
    cells = two_scale(one, (2, 6)).cells
    assert_array_equal(cells.patches.selections, deterministic(one).patches.selections)


def test_a_ladder_is_dry_and_periodic_whatever_the_scene():
    one = scene(fluid_pressure="acts", inlet_pressure=2e7)
    cells = solve_cells_at_pressures(one, Cut.of(one.surface, (2, 2)), one.steps, map)
    dry = replace(one, fluid_pressure="ignored", boundary=("periodic", "periodic"))
    face = deterministic(dry)
    for s, (gap, pressure) in enumerate(zip(face.gap, face.contact_pressure, strict=True)):
        state = CellState.of(gap, pressure, cells.cut, dry.flow, boundary=dry.boundary)
        assert_allclose(cells.k[:, :, s], state.k, rtol=1e-4)
    assert_allclose(cells.pressure.mean(axis=(1, 2)), one.steps.pressures, rtol=1e-4)
    assert_allclose(cells.row_pressure.mean(axis=1), one.steps.pressures, rtol=1e-4)


@pytest.mark.parametrize("elastic", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_a_ladder_covers_all_paths(seed, elastic):
    rng = np.random.default_rng(seed)
    steps = LoadProgramme.of(
        [1e7, 1e8, 4e8], unload_from=[1e8, 4e8], unloading=[9e7, 2e7, 0.0][: 1 + seed % 3]
    )
    paths = steps.pressures[:, None] * rng.uniform(0.3, 1.7, (1, 20))
    ladder = choose_tabulated_pressures(paths, steps, elastic)
    highest, lowest = paths.max(), paths.min()
    loading = np.array(ladder.loading)
    assert loading[-1] == pytest.approx(highest, rel=1e-3)
    assert loading[0] == pytest.approx(lowest, rel=1e-3, abs=1.0)
    roots = np.cbrt(loading / highest)
    assert np.diff(roots).max() <= 1.15 * tabulated_pressures._SPACING
    assert np.diff(loading).min() > 5e-4 * loading[1:][np.diff(loading).argmin()]
    if elastic:
        assert not ladder.unload_from
        return
    peaks = local_peaks(paths, steps)[~steps.on_loading]
    assert len(ladder.unload_from) <= tabulated_pressures._MOST_PEAKS
    assert ladder.unload_from[-1] == pytest.approx(peaks.max())
    assert ladder.unload_from[0] == pytest.approx(peaks.min(), rel=0.02)
    deepest = (paths / local_peaks(paths, steps))[~steps.on_loading].min()
    for peak in ladder.unload_from:
        stops = [s.pressure / peak for s in ladder if s.unloaded_from == peak]
        assert min(stops) <= deepest


def test_paths_that_differ_by_rounding_have_one_state():
    steps = LoadProgramme([LoadStep(2e8)])
    paths = 2e8 * np.array([[1.0, 1 + 3e-16, 1 - 2e-16, 1 + 1e-12]])
    ladder = choose_tabulated_pressures(paths, steps, False)
    assert len(ladder) == 1
    cycle = LoadProgramme([LoadStep(2e8), LoadStep(1e8, 2e8)])
    assert (
        len(choose_tabulated_pressures(np.vstack([paths, paths / 2]), cycle, False).unload_from)
        == 1
    )
    one = scene()
    cells = solve_cells_at_pressures(one, Cut.of(one.surface, (2, 2)), ladder, map)
    found = interpolate_along_paths(cells, paths, steps)
    assert_array_equal(found, np.broadcast_to(found[:, :, :, :1], found.shape))


def test_cells_along_the_ladder_itself_are_those_of_its_states():
    one = scene()
    cells = solve_cells_at_pressures(one, Cut.of(one.surface, (2, 2)), one.steps, map)
    found = interpolate_along_paths(cells, one.steps.pressures[:, None], one.steps)
    expected = cells.corrected_k.reshape(1, 2, 5, 4)
    assert_allclose(found[:, :, :, 0], expected, rtol=1e-9)


@pytest.fixture(scope="module")
def between():
    """Cells along a default ladder, and in states of their own at pressures and peaks between its rungs."""
    one = scene(loading=(4e7, 1.2e8, 6e8), unload_from=(1.2e8, 6e8), unloading=(3e8, 9e7, 3e7))
    paths = one.steps.pressures[:, None] * np.array([0.6, 0.83, 1.0, 1.17, 1.4])
    ladder = choose_tabulated_pressures(paths, one.steps, False)
    cut = Cut.of(one.surface, (2, 2))
    found = interpolate_along_paths(
        solve_cells_at_pressures(one, cut, ladder, map), paths, one.steps
    )
    own = np.empty_like(found)
    for n, path in enumerate(paths.T):
        steps = LoadProgramme([*map(LoadStep, path[one.steps.on_loading]),
                               *(LoadStep(p, path[q]) for p, q, s in zip(path, one.steps.peak_indices, one.steps, strict=True)
                                 if s.unloaded_from)])  # fmt: skip
        cells = solve_cells_at_pressures(one, cut, steps, map)
        own[:, :, :, n] = cells.corrected_k.reshape(*found.shape[:3], -1)
    return one.steps, found, own


def test_between_the_rungs_cells_are_within_some_per_cent(between):
    """Of the mean over the cells, what a seal averages: 2 % on loading, 5 % on unloading."""
    steps, found, own = between
    error = np.abs(np.log(found.mean(axis=-1) / own.mean(axis=-1)))
    loading = steps.on_loading
    assert error[:, :, loading].max() < 0.02
    assert error[:, :, ~loading].max() < 0.05
    assert np.median(error) < 0.005


def test_after_unloading_to_nothing_the_peak_is_not_forgotten():
    """Steps with no other unloading than that to 0: the states of the ladder are unloaded from the peak."""
    one = scene(loading=(5e7, 5e8), unload_from=(5e8,), unloading=(0.0,))
    paths = one.steps.pressures[:, None] * np.array([0.999, 1.001])
    ladder = choose_tabulated_pressures(paths, one.steps, False)
    cut = Cut.of(one.surface, (2, 2))
    found = interpolate_along_paths(
        solve_cells_at_pressures(one, cut, ladder, map), paths, one.steps
    )[0, :, -1, 0]
    cells = solve_cells_at_pressures(one, cut, one.steps, map)
    assert_allclose(found, cells.corrected_k[0, :, -1].reshape(2, -1), rtol=0.02)
    fresh = solve_cells_at_pressures(one, cut, LoadProgramme([LoadStep(0.0)]), map)
    assert fresh.k.mean() > 2 * found.mean()


def test_a_state_whose_cells_failed_is_interpolated(monkeypatch):
    one = scene(unload_from=(), unloading=())
    cut, paths = Cut.of(one.surface, (2, 2)), one.steps.pressures[:, None]
    ladder = LoadProgramme([LoadStep(p) for p in np.linspace(0.4, 0.8, 9) ** 3 * 1e9])
    whole = interpolate_along_paths(
        solve_cells_at_pressures(one, cut, ladder, map), paths, one.steps
    )
    flow, count = face_cells.cell_permeabilities, iter(range(1000))

    def lost(*args, **given):
        if next(count) // 8 == 4:  # two flows of each of four cells in a state
            raise NotConverged("lost", 1.0)
        return flow(*args, **given)

    monkeypatch.setattr(face_cells, "cell_permeabilities", lost)
    cells = solve_cells_at_pressures(one, cut, ladder, map)
    assert all(failure.startswith(ladder[4].name) for failure in cells.failures)
    assert np.isnan(cells.cells_leakage[4])
    found = interpolate_along_paths(cells, paths, one.steps)
    assert (found > 0).all()
    assert_allclose(found, whole, rtol=0.1)

"""Windows followed along a ladder, the curves between its steps, and libraries kept in a folder."""

import os
from dataclasses import replace

import femseal.library.library
import numpy as np
import pytest
from femseal.library import (
    Ladder,
    WindowCurves,
    WindowSource,
    WindowStates,
    build_ladder_library,
    on_ladder,
    solve_ladder,
)
from femseal.library.curves import monotone
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import PchipInterpolator

from femseal.base.errors import FemsealError, InputError, NotConverged
from femseal.contact import HalfSpace, PerfectlyPlastic, load_cycle
from femseal.execution.plain_data import packed, unpacked
from femseal.execution.store import read_shard, write_shard
from femseal.flow import cell_permeability
from femseal.loads import LoadProgramme
from femseal.topography import self_affine
from femseal.windows import SolveCounts

E, H = 115e9, 3e9
LAW = PerfectlyPlastic(H)
LOADING = (0.0, 1e8, 2e8, 4e8, 8e8)
LADDER = Ladder(LOADING, (2e8, 8e8), (0.5, 0.1, 0.0), (0.0, 1e-6), closing_rtol=0.1)
BODY = HalfSpace((32, 32), (1e-6, 1e-6), E, ("mirror", "mirror"))


@pytest.fixture(scope="module")
def heights():
    return self_affine((64, 96), (64e-6, 96e-6), hurst=0.8, rms_slope=0.2, roll_off=30e-6, rng=5).heights


@pytest.fixture(scope="module")
def source(heights):
    return WindowSource((-heights,), BODY, LAW, seed=1, rtol=1e-7)


@pytest.fixture(scope="module")
def cell(source):
    return solve_ladder(source.window(0), ladder=LADDER, half_space=BODY, law=LAW, rtol=1e-7)


def closing_pressure(cell, axis):
    """Pressure above which nothing flows along an axis [Pa]; inf if it is still open at the highest step."""
    shut = np.flatnonzero(cell.k[0, axis] == 0)
    if shut.size == 0:
        return np.inf
    first = shut[0]
    return float(cell.pressure[first] if first == 0 else (cell.pressure[first - 1] + cell.pressure[first]) / 2)


class TestFollowing:
    def test_states_are_those_of_the_window_alone(self, source, cell):
        """Loading, unloading and rigid separation against the load cycle of the same gap."""
        gap0 = source.window(0)
        states = load_cycle(
            gap0,
            BODY,
            loading=LOADING,
            unload_from=(2e8, 8e8),
            unloading=(4e8, 1e8, 8e7, 2e7, 0.0),
            hardness=H,
            rtol=1e-7,
        )
        of = {(s.pressure, s.unloaded_from): s.contact for s in states}
        for p in LOADING:
            at = np.searchsorted(cell.pressure, p)
            contact = of[p, None]
            k = [cell_permeability(contact.gap, (1e-6, 1e-6), axis=a).value for a in (0, 1)]
            assert_allclose(cell.k[0, :, at], k, rtol=1e-5)
            assert_allclose(cell.mean_gap[at], contact.mean_gap, rtol=1e-6)
            assert_allclose(cell.standoff[at], -contact.approach, rtol=1e-6)
            assert_allclose(cell.contact_fraction[at], contact.area_fraction, atol=2e-3)
            assert_allclose(cell.plastic_deformation[at], contact.plastic_deformation.mean(), rtol=1e-3, atol=1e-13)
        for m, peak in enumerate((2e8, 8e8)):
            for s, share in enumerate(LADDER.stops):
                contact = of[round(share * peak), peak]
                k = [cell_permeability(contact.gap, (1e-6, 1e-6), axis=a).value for a in (0, 1)]
                assert_allclose(cell.k_unloading[0, :, m, s], k, rtol=1e-4)
                assert_allclose(cell.standoff_unloading[m, s], -contact.approach, rtol=1e-5)
        apart = cell_permeability(np.maximum(gap0 + 1e-6, 0), (1e-6, 1e-6), axis=1).value
        assert_allclose(cell.rigid[0, 1, 1], apart, rtol=1e-6)

    def test_closing_is_known_to_the_tolerance(self, source):
        ladder = Ladder((*LOADING, 1.6e9, 2.4e9), closing_rtol=0.1)
        cell = solve_ladder(source.window(0), ladder=ladder, half_space=BODY, law=LAW, rtol=1e-7)
        closes = [a for a in (0, 1) if closing_pressure(cell, a) < np.inf]
        assert closes
        for axis in closes:
            first = np.flatnonzero(cell.k[0, axis] == 0)[0]
            low, high = cell.pressure[first - 1 : first + 1]
            assert high - low <= 0.1 * high
            assert low < closing_pressure(cell, axis) < high
            for p, opened in ((low, True), (high, False)):
                contact = load_cycle(source.window(0), BODY, loading=(p,), hardness=H, rtol=1e-7)[0].contact
                assert cell_permeability(contact.gap, (1e-6, 1e-6), axis=axis).percolates == opened

    def test_every_state_is_counted_and_closed_ones_are_not_solved(self, source, monkeypatch):
        solved = []
        permeability = femseal.library.ladder.window_permeability

        def counted(*args, **settings):
            result = permeability(*args, **settings)
            solved.append(result.counts)
            return result

        monkeypatch.setattr(femseal.library.ladder, "window_permeability", counted)
        tight = replace(LADDER, loading=(*LOADING, 1.2e9, 1.6e9, 2.4e9), closing_rtol=0.5)
        cell = solve_ladder(source.window(0), ladder=tight, half_space=BODY, law=LAW)
        assert cell.counts.flows == 2 * (cell.pressure.size + 2 * 3 + 2)
        assert cell.counts.closed > sum(c.closed for c in solved) > 0

    def test_a_known_cell_is_extended(self, source, cell):
        """Further steps and peaks, without touching what is known."""
        short = Ladder(LOADING[:3], (2e8,), LADDER.stops, LADDER.separations, closing_rtol=0.1)
        start = solve_ladder(source.window(0), ladder=short, half_space=BODY, law=LAW, rtol=1e-7)
        longer = solve_ladder(source.window(0), ladder=LADDER, half_space=BODY, law=LAW, rtol=1e-7, known=start)
        for name in ("pressure", "k", "standoff", "peaks", "k_unloading", "mean_gap_unloading", "rigid"):
            assert_array_equal(getattr(longer, name), getattr(cell, name))
        assert longer.counts.flows < cell.counts.flows
        between = replace(short, peaks=(1e8, 2e8))
        more = solve_ladder(source.window(0), ladder=between, half_space=BODY, law=LAW, rtol=1e-7, known=cell)
        assert_array_equal(more.peaks, [1e8, 2e8])
        assert_array_equal(more.k_unloading[:, :, 1:], cell.k_unloading[:, :, :1])
        again = solve_ladder(source.window(0), ladder=between, half_space=BODY, law=LAW, rtol=1e-7)
        for name in ("pressure", "k", "standoff", "peaks", "k_unloading", "mean_gap_unloading", "rigid"):
            assert_array_equal(getattr(more, name), getattr(again, name))

    def test_bounds_are_those_of_every_state(self, source, cell):
        tight = replace(LADDER, loading=(*LOADING, 1.6e9, 2.4e9), bounds=True)
        bounded = solve_ladder(source.window(0), ladder=tight, half_space=BODY, law=LAW, rtol=1e-7)
        assert bounded.k.shape[:2] == bounded.k_unloading.shape[:2] == bounded.rigid.shape[:2] == (3, 2)
        assert_array_equal(bounded.rigid[0], cell.rigid[0])
        value, lower, upper = bounded.k
        assert (lower <= upper).all()
        assert (upper[:, -1] == 0).any()
        assert_allclose(value[:, :3], cell.k[0][:, :3], rtol=1e-9)
        for n, p in enumerate(bounded.pressure):
            contact = load_cycle(source.window(0), BODY, loading=(p,), hardness=H, rtol=1e-7)[0].contact
            for axis in (0, 1):
                k = cell_permeability(contact.gap, (1e-6, 1e-6), axis=axis, bounds=True)
                assert_allclose([lower[axis, n], upper[axis, n]], [k.lower, k.upper], rtol=1e-5)
        open_window = WindowSource((0.003 * -source.topographies[0],), BODY, LAW, seed=1).window(0) + 1e-6
        flow = femseal.windows.window_flow.window_permeability(open_window, (1e-6, 1e-6), 0, bounds=True)
        k, low, high = flow.k
        exact = cell_permeability(open_window, (1e-6, 1e-6)).value
        assert flow.counts == SolveCounts(open=1)
        assert low <= exact <= high
        assert_allclose(k, exact, rtol=2e-4)
        # pixels that touch at a corner count in the upper bound only
        flow = femseal.windows.window_flow.window_permeability(np.eye(8), (1.0, 1.0), 0, bounds=True)
        k, low, high = flow.k
        assert (k, low, flow.counts) == (0, 0, SolveCounts(closed=1))
        assert high > 0

    @pytest.mark.parametrize(
        ("given", "word"),
        [
            ({"loading": (1e8, 2e8)}, "first touch"),
            ({"loading": (0.0, 2e8, 1e8)}, "first touch"),
            ({"peaks": (3e8,)}, "of `loading`"),
            ({"stops": ()}, "where there are peaks"),
            ({"stops": (0.5, 0.1)}, "to 0"),
            ({"separations": (1e-6, 0.0)}, "rising"),
        ],
    )
    def test_bad_ladders(self, given, word):
        with pytest.raises(InputError, match=word):
            replace(LADDER, **given)

    def test_a_ladder_below_all_of_its_peaks_has_one(self):
        lower = on_ladder(LADDER, (), 1e-3 * LADDER.peaks[0])
        assert lower.loading[1:2] == lower.peaks == lower.loading[-1:]
        assert on_ladder(replace(LADDER, peaks=(), stops=()), (), 1e6).peaks == ()

    def test_ladder_reaches_beyond_the_highest_load(self):
        shorter = on_ladder(LADDER, (1.5e8,), 3e8)
        assert shorter.loading == (0.0, 1e8, 1.5e8, 2e8, 4e8)
        assert shorter.peaks == (2e8,)
        assert on_ladder(LADDER, (), 4e8).loading[-1] == 4e8


def made_cell(k, p=LOADING, unloading=(), peaks=(), rigid=()):
    """A cell of given permeabilities, the same along both axes."""
    n, m = len(p), len(peaks)
    zeros, down = np.zeros(n), np.array(unloading, float).reshape(m, -1 if m else 3)
    return WindowStates(
        np.array(p),
        np.array([[k, k]], float),
        zeros,
        zeros,
        zeros,
        zeros,
        np.array(peaks),
        np.array([[down, down]]),
        0 * down,
        0 * down,
        0 * down,
        np.array([[rigid, rigid]], float),
    )


def curves(cell, ladder=LADDER, rms=1e-7):
    return WindowCurves(cell, ladder, 0, rms)


@pytest.mark.filterwarnings("error")
class TestCurves:
    def test_steps_come_back(self):
        """Open, closing and closed cells."""
        for k in ([5, 4, 3, 2, 1], [5, 4, 2, 0, 0], [5, 0, 0, 0, 0], [0, 0, 0, 0, 0]):
            assert_allclose(curves(made_cell(k)).loaded(np.array(LOADING)), k, rtol=1e-12)

    def test_straight_over_the_cube_root_of_the_pressure(self):
        p = np.linspace(0, 8e8, 100)
        k = np.exp(-np.cbrt(LOADING) / 100)
        assert_allclose(curves(made_cell(k)).loaded(p), np.exp(-np.cbrt(p) / 100), rtol=1e-12)

    def test_between_steps_k_is_monotone_and_closes_half_way(self):
        curve = curves(made_cell([4, 3, 1, 0.5, 0]))
        p = np.linspace(1, 8e8, 2000)
        k = curve.loaded(p)
        assert (np.diff(k) <= 0).all()
        end = ((np.cbrt(4e8) + np.cbrt(8e8)) / 2) ** 3
        assert_allclose(p[k > 0].max(), end, rtol=1e-3)
        # up to there with the last slope: half a step further by the square root of the last factor
        assert_allclose(
            curve.loaded(np.array([end * (1 - 1e-9)])),
            0.5 * 0.5 ** (0.5 * (np.cbrt(8e8) - np.cbrt(4e8)) / (np.cbrt(4e8) - np.cbrt(2e8))),
            rtol=1e-6,
        )

    def test_unloading_starts_from_loading_at_any_peak(self):
        cell = made_cell([16, 8, 4, 2, 1], unloading=[[4.2, 5, 6], [1.1, 2, 3]], peaks=(2e8, 8e8))
        curve = curves(cell)
        for peak in (3e7, 1e8, 2e8, 3e8, 6e8, 8e8):
            top = curve.loaded(np.array([peak]))
            p = np.linspace(1, peak * (1 - 1e-12), 200)
            k = curve.unloaded(p, np.full(p.shape, peak))
            assert_allclose(k[-1], top, rtol=1e-6)
            assert (np.diff(k) <= 1e-12).all()
            assert (k <= curve.loaded(p) * (1 + 1e-12)).all()
        at = np.array([1e8, 4e8, 0.8e8])
        assert_allclose(curve.unloaded(at, np.array([2e8, 8e8, 8e8])), [4.2, 1.1, 2], rtol=1e-12)

    def test_without_a_peak_to_speak_of_unloading_is_loading(self):
        cell = made_cell([16, 8, 4, 2, 1], unloading=[[4.2, 5, 6]], peaks=(2e8,))
        p = np.array([0.3, 0.6, 0.9])
        assert_allclose(curves(cell).unloaded(p, np.ones(3)), curves(cell).loaded(p), rtol=1e-3)
        elastic = made_cell([16, 8, 4, 2, 1])
        p = np.array([1e7, 1e8])
        assert_allclose(curves(elastic).unloaded(p, np.full(2, 4e8)), curves(elastic).loaded(p))

    def test_a_closed_cell_opens_again_at_a_share_between_those_of_its_peaks(self):
        """Closed from 300 MPa on; from 400 MPa it opens below a half, from 800 MPa below a tenth."""
        ladder = Ladder(LOADING, (4e8, 8e8), (0.75, 0.25, 0.15, 0.05, 0.0))
        cell = made_cell([16, 8, 4, 0, 0], unloading=[[0, 1, 1.5, 2, 3], [0, 0, 0, 1, 2]], peaks=(4e8, 8e8))
        curve = curves(cell, ladder)
        shares = np.linspace(0.001, 0.999, 999)

        def opens(peak):
            k = curve.unloaded(shares * peak, np.full(shares.shape, peak))
            assert (np.diff(k) <= 1e-12).all()
            return shares[k > 0].max()

        assert_allclose([opens(4e8), opens(8e8)], [0.5, 0.1], atol=2e-3)
        assert_allclose(opens(6e8), 0.3, atol=2e-3)
        end = curve.loading.end**3
        assert opens(end * 0.999) > 0.99
        assert_allclose(opens((end + 4e8) / 2), 0.75, atol=0.01)

    def test_a_cell_that_never_opens_again_does_so_at_a_share_that_falls_to_nothing(self):
        """Closed from 300 MPa on; from 400 MPa it opens below a half, from 800 MPa never."""
        ladder = Ladder(LOADING, (4e8, 8e8), (0.75, 0.25, 0.0))
        cell = made_cell([16, 8, 4, 0, 0], unloading=[[0, 1, 3], [0, 0, 0]], peaks=(4e8, 8e8))
        curve = curves(cell, ladder)
        shares = np.linspace(0.001, 0.999, 999)
        for peak, opens in ((4e8, 0.5), (6e8, 0.25), (7e8, 0.125), (8e8, 0.0)):
            k = curve.unloaded(shares * peak, np.full(shares.shape, peak))
            assert_allclose(max(shares[k > 0], default=0.0), opens, atol=2e-3)
            # as far as it opens, by the way of the peak from which it does
            below = shares < opens - 2e-3
            as_from_lower = curve.unloaded(shares[below] / opens * 2e8, np.full(below.sum(), 4e8)) if opens else []
            ceiling = curve.loaded(shares[below] * peak)
            assert_allclose(k[below], np.minimum(as_from_lower, ceiling), rtol=1e-9)

    @pytest.mark.parametrize("seed", range(20))
    def test_any_cell_has_numbers_everywhere(self, seed):
        """Closed from any step on, on any way; peaks at, between and beyond those of the ladder, to the last digit."""
        rng = np.random.default_rng(seed)

        def falling(n):
            k = np.sort(rng.lognormal(0, 5, n))[::-1]
            k[rng.integers(0, n + 1) :] = 0
            return k

        k = falling(5)
        down = []
        for at in (2, 4):
            way = falling(3)[::-1]
            down.append(np.where(way > 0, np.clip(way, k[at], max(k[0], 1e-300)), k[at]))
        ladder = replace(LADDER, separations=(0.0,))
        curve = curves(made_cell(k, unloading=down, peaks=(2e8, 8e8), rigid=(k[0],)), ladder)
        end = curve.loading.end**3
        peaks = np.array([1.0, 1e8, 2e8, 4e8, 8e8, 2e9, *([end] if 0 < end < np.inf else [])])
        peaks = np.concatenate([np.nextafter(peaks, 0), peaks, np.nextafter(peaks, np.inf)])
        shares = np.r_[1e-9, np.linspace(0, 1, 41)[1:], 1 - 1e-16]
        pressure, peak = (a.ravel() for a in np.broadcast_arrays(shares[:, None] * peaks, peaks))
        with np.errstate(divide="raise", invalid="raise", over="raise"):
            found = curve.unloaded(pressure, peak)
            loaded = curve.loaded(pressure)
            apart = curve.separated(np.array([-np.inf, -1e-6, 0.0, 1e-6]))
        assert np.isfinite(found).all()
        assert (found <= loaded * (1 + 1e-12)).all()
        assert np.isfinite(apart).all()
        # less pressure, never less flow
        assert (np.diff(found.reshape(shares.size, -1)[1:-1], axis=0) <= 1e-9 * k[0]).all()

    def test_apart_by_rigid_values_and_the_asymptote(self):
        ladder = replace(LADDER, separations=(1e-6, 2e-6))
        curve = curves(made_cell([1] * 5, unloading=[[1] * 3] * 2, peaks=(2e8, 8e8), rigid=(3.0, 7.0)), ladder)
        gaps = np.array([1e-6, 2e-6, 1e-5, 0.0])
        assert_allclose(curve.separated(gaps), [3, 7, 1e-15 / 12 * (1 - 1.5e-4), 3], rtol=1e-9)


class TestLibrary:
    def test_windows_tile_the_face_before_any_lies_anywhere(self, heights, source):
        tiles = [-heights[a : a + 32, b : b + 32] for a in (0, 32) for b in (0, 32, 64)]
        found = [source.window(n) for n in range(6)]
        for tile in tiles:
            assert sum(np.allclose(tile - tile.mean(), w, atol=1e-15) for w in found) == 1
        later = [source.window(n) for n in range(6, 20)]
        assert len({w.tobytes() for w in found + later}) == 20
        assert_allclose([w.mean() for w in later], 0, atol=1e-20)
        assert_allclose(source.rms_height**2, np.mean([np.var(w) for w in found]))

    def test_windows_of_several_faces_take_turns(self, heights):
        both = WindowSource((-heights, -heights[::-1, ::-1] * 2), BODY, LAW, seed=1)
        assert_allclose(
            np.std([both.window(n) for n in range(1, 12, 2)]), 2 * np.std([both.window(n) for n in range(0, 12, 2)])
        )

    def test_kept_read_and_extended(self, source, tmp_path, monkeypatch):
        """A second seal computes nothing, a larger library the rest only, a higher load further steps only."""
        built = build_ladder_library(source, LADDER, 3, folder=tmp_path)
        fresh = build_ladder_library(source, LADDER, 5)
        followed = []
        original = femseal.library.library.solve_ladder

        def counted(window, *, known, **given):
            cell = original(window, known=known, **given)
            followed.append(cell.counts.flows)
            return cell

        monkeypatch.setattr(femseal.library.library, "solve_ladder", counted)
        again = build_ladder_library(source, LADDER, 3, folder=tmp_path)
        assert (again.reused, followed) == (3, [])
        assert again.counts.flows == 0
        more = build_ladder_library(source, LADDER, 5, folder=tmp_path)
        assert (more.reused, len(followed)) == (3, 2)
        higher = replace(LADDER, loading=(*LOADING, 1e9))
        build_ladder_library(source, higher, 2, folder=tmp_path)
        assert max(followed[2:]) <= 6  # one step and what bisection adds, along both axes
        assert len(list(tmp_path.glob("*.shard"))) == 1
        assert build_ladder_library(source, LADDER, 5, folder=tmp_path).reused == 5
        steps = LoadProgramme.of(LOADING[1:], (8e8,), (4e8, 8e7))
        paths = steps.pressures[:, None]
        for library in (built, again, more):
            for axis in (0, 1):
                k = library.along(paths, np.zeros_like(paths), steps, axis)
                assert_array_equal(k, fresh.along(paths, np.zeros_like(paths), steps, axis)[:, :, : library.size])

    def test_several_tables_take_their_curves_once(self, source, monkeypatch):
        library = build_ladder_library(source, LADDER, 2)
        steps = LoadProgramme.of(LOADING[1:], (8e8,), (4e8, 8e7))
        paths = steps.pressures[:, None] - np.array([0.0, 2e7, 5e7])[:, None, None]
        each = [library.along(p, np.zeros_like(p), steps, 0) for p in paths]
        made, curves = [], femseal.library.library.WindowCurves
        monkeypatch.setattr(femseal.library.library, "WindowCurves", lambda *a: made.append(a) or curves(*a))
        assert_array_equal(library.along(paths, np.zeros_like(paths[0]), steps, 0), each)
        assert len(made) == library.size

    def test_what_other_runs_have_left_changes_nothing(self, source, tmp_path):
        """A library from a folder has the states of a fresh one, and the folder keeps those of all runs."""
        high = replace(LADDER, loading=(0.0, 3e8, 9e8, 2.6e9), peaks=(3e8, 9e8))
        low = replace(LADDER, loading=(0.0, 1.5e8, 2e8, 1.1e9, 2.4e9), peaks=(1.5e8, 1.1e9))
        steps = LoadProgramme.of((1e8, 7e8, 1e9), (7e8, 1e9), (4e8, 8e7))
        paths = steps.pressures[:, None] * np.array([0.5, 1.0])
        for ladder in (high, low, LADDER, high):
            kept, fresh = (build_ladder_library(source, ladder, 2, folder=folder) for folder in (tmp_path, None))
            for axis in (0, 1):
                k, own = (one.along(paths, np.zeros_like(paths), steps, axis) for one in (kept, fresh))
                assert_array_equal(k, own)
            for one, other in zip(kept.windows, fresh.windows, strict=True):
                assert_array_equal(one.pressure, other.pressure)
                assert_array_equal(one.peaks, other.peaks)
            assert_array_equal(kept.flattening(paths, 2 * paths), fresh.flattening(paths, 2 * paths))
        assert [build_ladder_library(source, one, 2, folder=tmp_path).reused for one in (high, low, LADDER)] == [2] * 3

    def test_the_stage_does_not_depend_on_what_is_kept(self, source, tmp_path):
        """A run that goes on from its checkpoint after the library was written asks for the same items again."""
        asked = []

        def mapper(stage, *iterables):
            items = list(zip(*iterables, strict=True))
            asked.append([n for n, _ in items])
            return [stage(*item) for item in items]

        for _ in range(2):
            build_ladder_library(source, Ladder((0.0, 1e8)), 2, folder=tmp_path, mapper=mapper)
        assert asked == [[0, 1], [0, 1]]

    def test_another_name_for_anything_else(self, source, heights):
        names = {source.key(LADDER)}
        names |= {
            replace(source, **change).key(LADDER)
            for change in (
                {"law": PerfectlyPlastic(2 * H)},
                {"seed": 2},
                {"rtol": 1e-6},
                {"topographies": (heights,)},
                {"half_space": replace(BODY, modulus=2 * E)},
                {"half_space": replace(BODY, boundary=("periodic", "periodic"))},
            )
        }
        names |= {
            source.key(replace(LADDER, **change))
            for change in ({"stops": (0.4, 0.1, 0.0)}, {"separations": ()}, {"closing_rtol": 0.2})
        }
        assert len(names) == 10
        assert source.key(replace(LADDER, loading=(0.0, 2e8), peaks=(2e8,))) in names

    def test_a_damaged_file_is_computed_anew(self, source, tmp_path):
        ladder = Ladder((0.0, 1e8))
        whole = build_ladder_library(source, ladder, 2, folder=tmp_path)
        (file,) = tmp_path.glob("*.shard")
        content = file.read_bytes()
        for damage in (b"", content[: len(content) // 2], b"x" * 100, content[:-200] + b"?" * 200):
            file.write_bytes(damage)
            again = build_ladder_library(source, ladder, 2, folder=tmp_path)
            assert again.reused == 0
            assert_array_equal(again.windows[1].k, whole.windows[1].k)
        assert build_ladder_library(source, ladder, 2, folder=tmp_path).reused == 2

    def test_a_changed_file_is_computed_anew(self, source, tmp_path, monkeypatch):
        whole = build_ladder_library(source, LADDER, 2, folder=tmp_path)
        (file,) = tmp_path.glob("*.shard")
        monkeypatch.setattr(femseal.library.library, "solve_ladder", None)
        assert build_ladder_library(source, LADDER, 2, folder=tmp_path).reused == 2
        header = ("library", femseal.library.library.FORMAT)
        first, second = (unpacked(item) for item in read_shard(file, header))
        wrong = [
            {"k": first.k.astype(np.float32)},
            {"k": np.array(1.0)},
            {"k": None},
            {"k": first.k.tolist()},
            {"k": -first.k},
            {"k": np.full_like(first.k, np.nan)},
            {"k": first.k[:, ::-1, :-1]},
            {"rigid": first.rigid[:0]},
            {"pressure": first.pressure[::-1]},
            {"pressure": first.pressure + 1},
            {"pressure": np.array([0.0])},
            {"peaks": np.zeros((2, 2))},
        ]
        changed = [[packed(replace(first, **change)), packed(second)] for change in wrong]
        for items in [*changed, [b"x" * 30], [packed((first.k,)), packed(second)], [packed(SolveCounts())]]:
            write_shard(file, header, items)
            assert femseal.library.library._read(file, LADDER) == [], items
        write_shard(file, ("library", header[1] + 1), [packed(first), packed(second)])
        assert femseal.library.library._read(file, LADDER) == []
        write_shard(file, header, [packed(first), packed(second)])
        assert len(femseal.library.library._read(file, LADDER)) == 2
        file.unlink()
        os.mkfifo(file)
        assert femseal.library.library._read(file, LADDER) == []
        assert whole.size == 2

    def test_cells_that_fail_are_named_and_tried_again(self, source, tmp_path, monkeypatch):
        original = femseal.library.library.solve_ladder

        def failing(window, **given):
            if np.array_equal(window, source.window(1)):
                raise NotConverged("did not converge", 1.0)
            return original(window, **given)

        monkeypatch.setattr(femseal.library.library, "solve_ladder", failing)
        ladder = Ladder((0.0, 1e8))
        library = build_ladder_library(source, ladder, 3, folder=tmp_path)
        assert (library.size, library.failures) == (2, ("cell 1: did not converge",))
        monkeypatch.setattr(femseal.library.library, "solve_ladder", original)
        assert build_ladder_library(source, ladder, 3, folder=tmp_path).size == 3
        monkeypatch.setattr(femseal.library.library, "solve_ladder", failing)
        monkeypatch.setattr(femseal.library.library, "solve_ladder", lambda *a, **k: failing(source.window(1)))
        with pytest.raises(FemsealError, match="every cell failed; the first: cell 0: did not"):
            build_ladder_library(source, ladder, 2)
        with pytest.raises(FemsealError, match="every cell failed; the first: cell 0: did not"):
            build_ladder_library(source, ladder, 2, mapper=lambda *stage_and_items: list(map(*stage_and_items)))

    def test_curves_show_the_steps_of_the_ladder(self, source):
        library = build_ladder_library(source, LADDER, 2)
        shown = library.curves
        assert len(shown.steps) == 5 + 2 * 3
        assert shown.k.shape == shown.mean_gap.shape == shown.pressure.shape == (2, 11)
        assert_array_equal(shown.pressure[0], [s.pressure for s in shown.steps])
        one = library.windows[1]
        assert_array_equal(shown.k[1, 5:], one.k_unloading[0, 0].ravel())
        assert_array_equal(shown.k[1, :5], one.k[0, 0, np.searchsorted(one.pressure, LOADING)])

    def test_flattening(self, source):
        """What a peak takes from the standoff: nothing without a peak, at the peak nothing yet, the more the higher."""
        library = build_ladder_library(source, LADDER, 2)
        zero, at_peak = np.zeros(3), np.array([0.0, 2e8, 8e8])
        assert_allclose(library.flattening(at_peak, at_peak), 0, atol=1e-16)
        left = library.flattening(zero, at_peak)
        assert left[0] == 0 < left[1] < left[2]
        expected = np.mean([c.standoff[0] - c.standoff_unloading[1, -1] for c in library.windows])
        assert_allclose(left[2], expected)

    def test_pressure_at_a_distance(self, source):
        """Windows at their own standoff have the pressure that gives it, on loading and from a peak; no other is lower."""
        library = build_ladder_library(source, LADDER, 2)
        pressure, peak = np.array([5e7, 2e8, 5e7, 2e8]), np.array([0.0, 0.0, 8e8, 8e8])
        standoff = library.loaded("standoff", pressure) - library.flattening(pressure, np.maximum(peak, pressure))
        for given in (np.zeros(4), pressure):
            assert_allclose(library.pressure_at(given, peak, standoff), pressure, rtol=1e-9)
        assert_array_equal(library.pressure_at(pressure, peak, np.full(4, 1.0)), pressure)
        assert_array_equal(library.pressure_at(pressure, peak, np.full(4, -1.0)), [8e8] * 4)

    def test_no_windows(self, source):
        with pytest.raises(InputError, match="at least one"):
            build_ladder_library(source, LADDER, 0)


def test_loads_that_differ_but_for_rounding_are_one(source, cell):
    """0.02 × 3 GPa and 60 MPa differ in the last digit."""
    again = np.nextafter(np.array([2e8, 8e8]), np.inf)
    loading, peaks = (tuple(sorted({*old, *again})) for old in (LOADING, (2e8, 8e8)))
    doubled = solve_ladder(
        source.window(0), ladder=replace(LADDER, loading=loading, peaks=peaks), half_space=BODY, law=LAW, rtol=1e-7
    )
    assert doubled.peaks.size == 4
    for axis in (0, 1):
        one, other = (WindowCurves(c, LADDER, axis, 1e-7) for c in (cell, doubled))
        pressure, peak = np.array([1e7, 2e8, 3e8, 7e8]), np.array([2e8, 5e8, 8e8, 8e8])
        assert_allclose(other.loaded(pressure), one.loaded(pressure), rtol=1e-6)
        assert_allclose(other.unloaded(pressure, peak), one.unloaded(pressure, peak), rtol=1e-6)


@pytest.mark.parametrize("points", [2, 3, 4, 9])
def test_curves_are_those_of_scipy(points):
    """Rising, falling and flat by turns, so that slopes at the ends are cut off too; at the points and between them."""
    rng = np.random.default_rng(points)
    for _ in range(200):
        x, y = np.cumsum(rng.uniform(0.01, 1, points)), rng.integers(-2, 3, points) * rng.uniform(0, 3, points)
        at = np.concatenate([x, rng.uniform(x[0], x[-1], 20)])
        assert_allclose(monotone(x, y)(at), PchipInterpolator(x, y)(at), rtol=0, atol=1e-12)

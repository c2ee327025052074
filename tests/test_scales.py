"""Partition, global scale, windows, libraries, samplers."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from femseal.contact import HalfSpace, LoadStep, load_cycle, load_programme, solve_contact
from femseal.errors import InputError
from femseal.flow import cell_permeability
from femseal.scales import Ladder, Partition, build_ladder_library, draw_links, respond, solve_global_scale
from femseal.scales.library import LadderLibrary
from femseal.scales.response import WindowHistory, body_standoff, flow_history, set_down
from femseal.topography import Topography, self_affine

E, H = 115e9, 3e9


@pytest.fixture(scope="module")
def face():
    return self_affine((64, 128), (60e-6, 120e-6), hurst=0.8, rms_slope=0.2, roll_off=40e-6, rng=5)


class TestPartition:
    partition = Partition((32, 48), (1e-6, 2e-6), (4, 3))

    def test_windows_of_x1_links_tile_the_surface(self):
        field = np.arange(32 * 48).reshape(32, 48)
        seen = [self.partition.cut(field, i, j) for i in range(4) for j in range(3)]
        assert {w.shape for w in seen} == {(8, 16)}
        assert_array_equal(np.sort(np.concatenate([w.ravel() for w in seen])), np.arange(32 * 48))

    def test_windows_of_x2_links_are_centred_between_nodes_and_wrap(self):
        row, column = np.indices((32, 48))
        # link (0, 0): row 1 of the nodes, x1 = 8 px, from column centre 8 px to 24 px
        window = self.partition.cut(np.array([row, column]), 0, 0, axis=1)
        assert_array_equal(window[0][:, 0], np.arange(4, 12))
        assert_array_equal(window[1][0], np.arange(8, 24))
        last = self.partition.cut(column, 2, 2, axis=1)
        assert_array_equal(last[0], np.r_[40:48, 0:8])

    def test_means_do_not_depend_on_the_grid(self):
        coarse = np.random.default_rng(0).random((16, 24))
        fine = np.kron(coarse, np.ones((2, 2)))
        partition = Partition((64, 96), (1e-6, 1e-6), (2, 3))
        for axis in (0, 1):
            assert_allclose(partition.means(np.kron(fine, np.ones((2, 2))), axis), partition.means(fine[:, :], axis))

    def test_sizes(self):
        partition = Partition((32, 48), (1e-6, 3e-6), (2, 6))
        assert partition.window == (16, 8)
        assert_allclose(partition.window_size, (16e-6, 24e-6))
        assert_allclose(partition.cut_off, 8e-6)  # half the smaller side

    @pytest.mark.parametrize(("cells", "word"), [((5, 3), "divisors"), ((0, 3), "divisors"), ((8, 3), "8 pixels")])
    def test_bad_cells(self, cells, word):
        with pytest.raises(InputError, match=word):
            Partition((32, 48), (1e-6, 2e-6), cells)


class TestGlobalScale:
    def test_windows_carry_the_load(self, face):
        """The mean over all windows of x1-links is the nominal pressure, at every step."""
        partition = Partition(face.shape, face.spacing, (4, 8))
        world = solve_global_scale(face, partition, modulus=E, hardness=H, boundary=("free", "periodic"),
                                   loading=(1e8, 5e8), unload_from=(5e8,), unloading=(2e8,))  # fmt: skip
        assert_allclose(world.pressure.mean(axis=(1, 2)), [1e8, 5e8, 2e8], rtol=1e-9)
        assert world.raw_gap.shape == (3, 64, 128)
        assert world.pressure_across.shape == (3, 3, 8)

    def test_gap_of_a_flat_face_is_zero_under_load(self):
        flat = Topography(np.zeros((32, 32)), (1e-6, 1e-6))
        world = solve_global_scale(flat, Partition(flat.shape, flat.spacing, (2, 2)), modulus=E, hardness=H,
                                   boundary=("periodic", "periodic"), loading=(1e8,))  # fmt: skip
        assert_allclose(world.raw_gap, 0, atol=1e-18)
        assert_allclose(world.pressure, 1e8)

    @pytest.mark.parametrize("boundary", [("free", "periodic"), ("periodic", "free")])
    def test_a_flat_face_is_a_punch(self, boundary):
        """A strip with free ends: p = 2p̄/(π √(1 − ξ²)), in parts of the width (arcsin ξ₂ − arcsin ξ₁)/π."""
        flat = Topography(np.zeros((128, 128)), (1e-6, 1e-6))
        world = solve_global_scale(flat, Partition(flat.shape, flat.spacing, (8, 8)), modulus=E, hardness=np.inf,
                                   boundary=boundary, loading=(1e8,))  # fmt: skip
        expected = 8e8 * np.diff(np.arcsin(np.linspace(-1, 1, 9))) / np.pi
        pressure = world.pressure[0] if boundary[0] == "free" else world.pressure[0].T
        assert_allclose(pressure, np.tile(expected[:, None], (1, 8)), rtol=0.02)

    @pytest.mark.parametrize("boundary", [("free", "periodic"), ("mirror", "periodic")])
    @pytest.mark.parametrize(("shape", "cells"), [((64, 128), (2, 4)), ((128, 32), (4, 4))])
    def test_the_coarser_grid_changes_little(self, boundary, shape, cells):
        """Windows of 32 points are solved on 16 of them: pressures, and gaps up to the ends, are those of all points."""
        size = (shape[0] * 1e-6, shape[1] * 1e-6)
        smooth = self_affine(shape, size, hurst=1.0, rms_height=2e-7, cut_off=20e-6, rng=8)
        slanted = smooth.heights + 1e-6 * np.linspace(0, 1, shape[0])[:, None]  # the ends differ
        surface = Topography(slanted, smooth.spacing, (False, True))
        partition = Partition(shape, smooth.spacing, cells)
        surface = surface.low_pass(partition.cut_off)
        world = solve_global_scale(surface, partition, modulus=E, hardness=np.inf, boundary=boundary,
                                   loading=(2e8,))  # fmt: skip
        gap0 = surface.heights.max() - surface.heights
        whole = load_cycle(gap0, HalfSpace(shape, smooth.spacing, E, boundary), loading=(2e8,))[0].contact
        assert_allclose(world.pressure[0], partition.means(whole.pressure), atol=0.05 * 2e8)
        added = np.ptp(whole.raw_gap - gap0)
        assert_allclose(world.raw_gap[0], whole.raw_gap, atol=0.03 * added)

    def test_the_coarser_grid_has_no_seam(self, face):
        """Counted from another window of a periodic face, the gap is the same, only elsewhere."""
        partition = Partition(face.shape, face.spacing, (2, 4))
        given = {"modulus": E, "hardness": H, "boundary": ("free", "periodic"), "loading": (2e8,), "rtol": 1e-9}
        turned = Topography(np.roll(face.heights, 32, axis=1), face.spacing)
        gaps = [solve_global_scale(s, partition, **given).raw_gap[0] for s in (face, turned)]
        assert_allclose(np.roll(gaps[1], -32, axis=1), gaps[0], atol=1e-5 * np.ptp(gaps[0]))

    def test_raw_gap_is_between_virgin_planes(self, face):
        """On unloading the permanent deformation stays negative in the raw gap where the face yielded."""
        partition = Partition(face.shape, face.spacing, (4, 8))
        world = solve_global_scale(face, partition, modulus=E, hardness=0.5e9, boundary=("periodic", "periodic"),
                                   loading=(2e8,), unload_from=(2e8,), unloading=(1e8, 0.0))  # fmt: skip
        yielded = world.raw_gap[0] < -1e-9
        assert yielded.any()
        # opened by elastic recovery, but still below the virgin plane in most places, and never closer
        assert (world.raw_gap[1][yielded] >= world.raw_gap[0][yielded] - 1e-11).mean() > 0.95
        assert (world.raw_gap[2][yielded] < 0).mean() > 0.5


class TestResponse:
    half_space = HalfSpace((24, 24), (1e-6, 1e-6), E, "mirror")
    gap0 = -self_affine((24, 24), (24e-6, 24e-6), hurst=0.8, rms_slope=0.2, rng=1).heights

    def test_load_and_memory(self):
        steps = load_programme((1e8, 6e8), (6e8,), (6e8 - 1, 1e8))
        history = respond(
            self.gap0, [s.pressure for s in steps], steps, self.half_space, hardness=H, rigid_at_zero=True
        )
        assert_allclose(history.pressure.mean(axis=(1, 2)), [1e8, 6e8, 6e8 - 1, 1e8], rtol=1e-5)
        # just below the peak nothing has changed; at the loading pressure the unloaded window is tighter
        assert_allclose(history.gap[2], history.gap[1], atol=2e-12)
        assert history.mean_gap[3] < history.mean_gap[0]
        assert history.failures == ()

    def test_without_pressure_rigid_or_at_first_touch(self):
        steps = (LoadStep(0.0),)
        rigid = respond(self.gap0 + 5e-6, [0.0], steps, self.half_space, hardness=H, rigid_at_zero=True)
        assert_allclose(rigid.gap[0], self.gap0 + 5e-6, rtol=1e-6)
        touch = respond(self.gap0 + 5e-6, [0.0], steps, self.half_space, hardness=H, rigid_at_zero=False)
        assert touch.gap.min() == 0
        assert_allclose(touch.gap[0], self.gap0 - self.gap0.min(), atol=1e-12)

    def test_without_pressure_after_a_peak_the_permanent_deformation_stays(self):
        steps = load_programme((6e8,), (6e8,), (0.0,))
        gap0 = np.stack([self.gap0, self.gap0 - self.gap0.min() - 5e-8])
        history = respond(gap0, [6e8, 0.0], steps, self.half_space, hardness=H, rigid_at_zero=True)
        peak = solve_contact(self.gap0, self.half_space, pressure=6e8, hardness=H)
        gap = np.maximum(gap0[1] + peak.plastic_deformation, 0)
        assert np.count_nonzero(gap) > np.count_nonzero(gap0[1] > 0)  # some opens that would not
        assert_allclose(history.gap[1], gap, atol=1e-11)
        assert_allclose(history.contact_fraction[1], (gap == 0).mean())

    def test_without_the_peak_nothing_is_known_of_its_unloading(self):
        gap0 = np.stack([self.gap0] * 3)
        gap0[1] = np.nan
        steps = load_programme((1e8, 5e8), (5e8,), (0.0,))
        history = respond(gap0, [1e8, 5e8, 0.0], steps, self.half_space, hardness=H, rigid_at_zero=True)
        assert [f.split(":")[0] for f in history.failures] == ["loading 500 MPa", "unloading 0 MPa from 500 MPa"]
        assert np.isnan(history.gap[1:]).all()

    def test_a_peak_without_pressure_leaves_nothing_behind(self):
        """As where the global contact moves to another window as the load falls."""
        steps = load_programme((6e8,), (6e8,), (1e8,))
        history = respond(self.gap0, [0.0, 1e8], steps, self.half_space, hardness=H, rigid_at_zero=True)
        virgin = solve_contact(self.gap0, self.half_space, pressure=1e8, hardness=H)
        assert history.failures == ()
        assert_allclose(history.gap[1], virgin.gap, atol=1e-11)

    def test_rounding_above_the_hardness_is_forgiven(self):
        history = respond(self.gap0, [H * (1 + 1e-9)], (LoadStep(H),), self.half_space, hardness=H, rigid_at_zero=True)
        assert history.failures == ()
        assert (history.gap[0].max(), history.plastic_fraction[0]) == (0, 1)

    def test_a_step_that_fails_is_recorded_and_the_others_go_on(self):
        steps = load_programme((1e8, 2e8))
        gap0 = np.stack([np.full((24, 24), np.nan), self.gap0])
        history = respond(gap0, [1e8, 2e8], steps, self.half_space, hardness=H, rigid_at_zero=True)
        assert len(history.failures) == 1
        assert "loading 100 MPa" in history.failures[0]
        assert np.isnan(history.gap[0]).all()
        assert np.isfinite(history.gap[1]).all()

    def test_flow_is_solved_only_where_it_is_needed(self):
        gaps = np.array([np.zeros((24, 24)), np.full((24, 24), 1e-3), np.maximum(self.gap0 + 1e-6, 0)])
        flow = flow_history(gaps, (1e-6, 1e-6), 0)
        assert (flow.closed, flow.open, flow.solved) == (1, 1, 1)
        assert_allclose(flow.permeability[:2], [0, 1e-9 / 12])
        assert flow.permeability[2] == cell_permeability(gaps[2], (1e-6, 1e-6)).value


def _library(k, steps, separations=(), rigid=None, rms=1e-7):
    k = np.asarray(k, float)
    n = len(k)
    rigid = np.zeros((n, 2, 0)) if rigid is None else np.asarray(rigid, float)
    empty = np.zeros((n, len(steps)))
    return LadderLibrary(Ladder(tuple(steps), tuple(separations)), k, rigid, empty, empty, rms, np.full((n, 2, 2), 0.5))


class TestStandoff:
    """Of a body on windows: 40 nm where 3 parts of the load are, 80 nm where 1 is; the third window has none."""

    steps = load_programme((1e8, 2e8))

    def histories(self, loads=((3e8, 1e8), (1e8, 3e8)), held=((4e-8, 8e-8), (8e-8, 4e-8))):
        out = []
        for p, d in zip(loads, held, strict=True):
            pressure = np.ones((2, 4, 4), np.float32) * np.array(p, np.float32)[:, None, None]
            standoff = np.where(np.array(p) > 0, d, np.nan)
            out.append(WindowHistory(np.zeros((2, 4, 4), np.float32), pressure, np.zeros(2), np.zeros(2), standoff))
        gap = np.linspace(-1e-7, 5e-8, 32, dtype=np.float32).reshape(2, 4, 4)
        zeros = np.zeros((2, 4, 4), np.float32)
        return [*out, WindowHistory(gap, zeros, np.zeros(2), np.zeros(2), np.full(2, np.nan))]

    def test_is_the_mean_over_the_load(self):
        assert_allclose(body_standoff(self.histories()), 5e-8, rtol=1e-6)

    def test_without_load_is_that_of_first_touch(self):
        histories = self.histories(loads=((0, 0), (0, 1e8)))
        gap = histories[2].gap
        assert_allclose(body_standoff(histories), [max(0, -gap[0].min()), 4e-8], rtol=1e-6)
        down = [set_down(h, body_standoff(histories)) for h in histories]
        assert min(h.gap[0].min() for h in down) == 0
        assert down[2].gap[0].max() > 0

    def test_moves_windows_without_pressure_only_and_lets_nothing_overlap(self):
        histories = self.histories()
        down = [set_down(h, np.array([3e-8, -1e-8])) for h in histories]
        for before, after in zip(histories[:2], down[:2], strict=True):
            assert np.array_equal(before.gap, after.gap)
        expected = np.maximum(histories[2].gap + np.array([3e-8, -1e-8])[:, None, None], 0)
        assert_allclose(down[2].gap, expected, atol=1e-13)
        assert np.isnan(set_down(self.histories()[0], np.ones(2)).standoff).sum() == 0

    def test_steps_that_failed_stay_unknown(self):
        histories = self.histories()
        histories[2].gap[1] = np.nan
        assert np.isfinite(body_standoff(histories)).all()
        assert np.isnan(set_down(histories[2], np.zeros(2)).gap[1]).all()
        assert np.isfinite(set_down(histories[2], np.zeros(2)).gap[0]).all()

    def test_of_a_smooth_window_is_none_and_of_a_rough_one_its_approach(self):
        body = HalfSpace((32, 32), (1e-6, 1e-6), E, "mirror")
        rough = -self_affine((32, 32), (32e-6, 32e-6), hurst=0.8, rms_slope=0.2, rng=1).heights
        steps = load_programme((1e8,))
        for gap0 in (np.zeros((32, 32)), rough - rough.mean()):
            history = respond(gap0, [1e8], steps, body, hardness=H, rigid_at_zero=True)
            contact = solve_contact(gap0, body, pressure=1e8, hardness=H)
            assert history.standoff[0] == pytest.approx(-contact.approach, abs=1e-12)
            # K moves nothing on the mean: the mean raw gap is the standoff
            assert contact.raw_gap.mean() == pytest.approx(history.standoff[0] + gap0.mean(), abs=1e-12)
            assert (history.standoff[0] > 1e-8) == bool(gap0.any())


class TestLadderLibrary:
    loading = tuple(LoadStep(p) for p in (0.0, 1e8, 2e8, 4e8))

    def test_ladder_values_come_back(self):
        """Interpolation is exact at the steps of the ladder, for open, closing and closed cells."""
        k = [[[4, 3, 2, 1], [8, 4, 2, 0]], [[5, 1, 0, 0], [0, 0, 0, 0]]]
        library = _library(k, self.loading)
        path = np.array([[1e8, 2e8, 4e8]])
        steps = load_programme((1e8, 2e8, 4e8))
        for axis in (0, 1):
            got = library.along(path, np.zeros((1, 3)), steps, axis)
            assert_allclose(got[0], np.array(k)[:, axis, 1:], rtol=1e-12)

    def test_between_steps_k_is_monotone_and_closes_where_the_cell_says(self):
        library = _library([[[4, 3, 1, 0], [1, 1, 1, 1]]], self.loading)
        p = np.linspace(1, 4e8, 400)
        got = library.along(p[:, None], np.zeros((400, 1)), load_programme((1e8,)), 0)[:, 0, 0]
        assert (np.diff(got) <= 0).all()
        assert_allclose(p[got > 0].max(), 3e8, rtol=1e-2)  # half way between the last open and the first closed step

    def test_unloading_meets_loading_at_the_peak_and_is_elastic_for_no_peak(self):
        peak, down = 4e8, (2e8, 1e8, 0.0)
        steps = self.loading + tuple(LoadStep(p, peak) for p in down)
        library = _library([[[8, 4, 2, 1, 1.2, 1.5, 2], [1] * 7]], steps)
        programme = load_programme((4e8,), (4e8,), (4e8 - 1, 2e8, 0.0))
        path = np.array([[4e8, 4e8 - 1, 2e8, 1e-3]])
        got = library.along(path, np.zeros((1, 4)), programme, 0)[0, 0]
        assert_allclose(got, [1, 1, 1.2, 2], rtol=1e-6)
        low = load_programme((1.0,), (1.0,), (0.5,))
        assert_allclose(library.along(np.array([[1.0, 0.5]]), np.zeros((1, 2)), low, 0)[0, 0], 8, rtol=1e-6)

    def test_a_closing_cell_keeps_its_slope_up_to_its_closing_pressure(self):
        library = _library([[[4, 2, 0, 0], [4, 0, 0, 0]]], self.loading)
        p = np.array([1.25e8, 1.49e8, 1.51e8, 0.49e8, 0.51e8])[:, None]
        one, other = (library.along(p, np.zeros((5, 1)), load_programme((1e8,)), axis)[:, 0, 0] for axis in (0, 1))
        # ln k falls by ln 2 for 100 MPa; closed half way to the first closed step
        assert_allclose(one[:3], [2 * 2**-0.25, 2 * 2**-0.49, 0], rtol=1e-12)
        assert_allclose(other[3:], [4, 0])  # open at first touch only: no slope known

    def test_smooth_curves_are_met_between_steps(self):
        """Chords of ln k = −(p/p₁)² between steps of p₁ would be off by 1/4."""
        p = np.array([0.0, 1e8, 2e8, 3e8])
        library = _library([[np.exp(-((p / 1e8) ** 2))] * 2], tuple(LoadStep(x) for x in p))
        x = np.linspace(1e8, 2e8, 11)[:, None]
        got = library.along(x, np.zeros((11, 1)), load_programme((1e8,)), 0)[:, 0, 0]
        assert np.abs(np.log(got) + (x[:, 0] / 1e8) ** 2).max() < 0.12

    def test_between_peaks_unloading_is_interpolated(self):
        """At equal share of the peak, ln k is linear in the peak, from the elastic curve at no peak on."""
        steps = (*self.loading, LoadStep(1e8, 2e8), LoadStep(2e8, 4e8))
        library = _library([[[1, 1, 1, 1, 4, 36]] * 2, [[1, 1, 1, 1, 4, 0]] * 2], steps)

        def halved(peak):
            programme = load_programme((peak,), (peak,), (peak / 2,))
            return library.along(np.array([[peak, peak / 2]]), np.zeros((1, 2)), programme, 0)[0, :, 1]

        assert_allclose([halved(p)[0] for p in (1e8, 2e8, 3e8, 4e8)], [2, 4, 12, 36], rtol=1e-6)
        # the other cell closes under one peak only, at the share of the way that its own number says, one half
        assert_allclose([halved(p)[1] for p in (2.9e8, 3.1e8)], [4, 0])

    def test_separated_cells_follow_the_rigid_values_and_the_asymptote(self):
        s = (1e-6, 2e-6)
        library = _library([[[1] * 4] * 2], self.loading, s, [[[3.0, 7.0], [1, 1]]], rms=1e-7)
        step = load_programme((1e8,))
        gaps = np.array([[1e-6], [2e-6], [1e-5]])
        got = library.along(np.zeros((3, 1)), gaps, step, 0)[:, 0, 0]
        assert_allclose(got, [3, 7, 1e-15 / 12 * (1 - 1.5e-4)], rtol=1e-9)

    def test_real_cells(self, face):
        """Every cell closes monotonically on loading, and library values equal a direct solution of the window."""
        half_space = HalfSpace((32, 32), face.spacing, E, "mirror")
        windows = [face.heights.mean() - face.heights[:32, j : j + 32] for j in (0, 32, 64)]
        steps = load_programme((0.0, 2e8, 6e8), (6e8,), (2e8,))
        library = build_ladder_library(windows, Ladder(steps, (1e-6,)), half_space, hardness=H,
                                       rng=np.random.default_rng(0))  # fmt: skip
        assert library.size == 3
        assert (np.diff(library.k[:, :, :3], axis=2) <= 0).all()
        assert (library.k[:, :, 3] <= library.k[:, :, 1]).all()  # after the peak it leaks less at the same load
        assert_allclose(library.rms_height**2, np.mean([np.var(w) for w in windows]))
        assert len({np.var(w) for w in windows}) == 3
        rigid = cell_permeability(np.maximum(windows[1] + 1e-6, 0), face.spacing, axis=1).value
        assert_allclose(library.rigid[1, 1, 0], rigid, rtol=1e-5)
        with pytest.raises(InputError, match="first touch"):
            build_ladder_library(windows, Ladder(steps[1:], ()), half_space, hardness=H, rng=np.random.default_rng(0))


class TestSamplers:
    steps = load_programme((1e8, 2e8, 3e8), (3e8,), (2e8, 1e8))

    def table(self, n=400, seed=0):
        """Monotone synthetic histories, a third of them closed at the highest load."""
        rng = np.random.default_rng(seed)
        ln = np.cumsum(-rng.exponential(1.0, (n, 3)), axis=1)
        k = np.exp(ln) * (np.arange(n)[:, None] % 3 > [-1, -1, 0])
        up = np.cumsum(rng.exponential(0.02, (n, 2)), axis=1)
        return np.concatenate([k, k[:, 2:] + up], axis=1)[None]

    @pytest.mark.parametrize("sampler", ["history", "derivative"])
    def test_marginals_and_closed_share(self, sampler):
        """Each step's distribution is the library's: Kolmogorov-Smirnov distance and P(k = 0)."""
        table = self.table()
        k = draw_links(table, np.zeros(20_000, int), self.steps, sampler=sampler, seed=1, realisation=0, axis=0)
        for n in range(5):
            grid = np.quantile(table[0, :, n], np.linspace(0, 1, 200))
            ks = np.abs((k[:, n, None] <= grid).mean(axis=0) - (table[0, :, n, None] <= grid).mean(axis=0)).max()
            assert ks < (0.02 if sampler == "history" else 0.05)
        assert_allclose((k[:, 2] == 0).mean(), 1 / 3, atol=0.015)

    @pytest.mark.parametrize("sampler", ["history", "derivative"])
    def test_histories_are_plausible(self, sampler):
        k = draw_links(self.table(), np.zeros(5000, int), self.steps, sampler=sampler, seed=1, realisation=0, axis=0)
        assert (k >= 0).all()
        assert (np.diff(k[:, :3], axis=1) <= 1e-15).all()
        assert (np.diff(k[:, 2:], axis=1) >= -1e-15).all()

    def test_history_sampler_draws_whole_cells(self):
        table = self.table(30)
        k = draw_links(table, np.zeros(500, int), self.steps, sampler="history", seed=3, realisation=2, axis=1)
        assert {tuple(row) for row in k} <= {tuple(row) for row in table[0]}

    def test_numbers_depend_on_seed_realisation_axis_and_link_only(self):
        def draw(n=100, **change):
            given = {"seed": 1, "realisation": 4, "axis": 0} | change
            return draw_links(self.table(), np.zeros(n, int), self.steps, sampler="history", **given)

        assert_array_equal(draw(100), draw(1000)[:100])
        for change in ({"seed": 2}, {"realisation": 5}, {"axis": 1}):
            assert not np.array_equal(draw(), draw(**change))

    def test_neighbours_in_rank_lie_on_both_sides(self):
        """Increments that name their cell: at most two ranks away, as often above as below."""
        n = 101
        k_top = np.arange(1.0, n + 1)
        table = np.stack([k_top + 1000 * np.arange(n), k_top], axis=1)[None]
        k = draw_links(table, np.zeros(5000, int), load_programme((1e8, 2e8)), sampler="derivative", seed=5,
                       realisation=0, axis=0)  # fmt: skip
        own, drawn = k[:, 1] - 1, (k[:, 0] - k[:, 1]) / 1000
        inside = (own > 2) & (own < n - 3)
        away = (drawn - own)[inside]
        assert np.abs(away).max() == 2
        assert abs(away.mean()) < 0.1
        assert np.abs(drawn - own).max() <= 4  # at the ends the five lie on one side

    def test_links_follow_their_own_path(self):
        table = np.stack([np.ones((4, 5)), np.full((4, 5), 2.0)])
        path = np.array([0, 1, 1, 0])
        for sampler in ("history", "derivative"):
            k = draw_links(table, path, self.steps, sampler=sampler, seed=0, realisation=0, axis=0)
            assert_allclose(k[:, 0], [1, 2, 2, 1])

    def test_unknown_sampler(self):
        with pytest.raises(InputError, match="history, derivative"):
            draw_links(self.table(), np.zeros(1, int), self.steps, sampler="magic", seed=0, realisation=0, axis=0)

"""Partition, global scale, windows, libraries, samplers."""

import pickle

import numpy as np
import pytest
from each import each
from femseal.windows.window_contact import body_standoff, separate
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import zoom

from femseal.base.errors import InputError
from femseal.contact import HalfSpace, PerfectlyPlastic, load_cycle, solve_contact
from femseal.flow import cell_permeability
from femseal.loads import LoadProgramme, LoadStep
from femseal.topography import Topography, self_affine
from femseal.windows import GlobalState, Partition, contact_history, global_states
from femseal.windows.global_contact import Refinement
from femseal.windows.window_flow import flow_history

E, H = 115e9, 3e9
LAW = PerfectlyPlastic(H)


@pytest.fixture(scope="module")
def face():
    return self_affine((64, 128), (60e-6, 120e-6), hurst=0.8, rms_slope=0.2, roll_off=40e-6, rng=5)


class TestPartition:
    partition = Partition((32, 48), (1e-6, 2e-6), (4, 3))

    def test_windows_of_x1_links_tile_the_surface(self):
        field = np.arange(32 * 48).reshape(32, 48)
        seen = [self.partition.link(field, i, j, 0) for i in range(4) for j in range(3)]
        assert {w.shape for w in seen} == {(8, 16)}
        assert_array_equal(np.sort(np.concatenate([w.ravel() for w in seen])), np.arange(32 * 48))

    def test_windows_of_x2_links_are_centred_between_nodes_and_wrap(self):
        row, column = np.indices((32, 48))
        # link (0, 0): row 1 of the nodes, x1 = 8 px, from column centre 8 px to 24 px
        window = self.partition.link(np.array([row, column]), 0, 0, 1)
        assert_array_equal(window[0][:, 0], np.arange(4, 12))
        assert_array_equal(window[1][0], np.arange(8, 24))
        last = self.partition.link(column, 2, 2, 1)
        assert_array_equal(last[0], np.r_[40:48, 0:8])
        moved = self.partition.link(column, 0, 2, 0, shift=20)
        assert_array_equal(moved[0], np.r_[4:20])

    def test_windows_reach_from_line_to_line(self):
        """x1-links between the lines, x2-links from half way to half way: both tile what lies between the lines."""
        partition = Partition((32, 48), (1e-6, 2e-6), (4, 3), (0, 9, 14, 26, 32))
        assert partition.rows(0) == [(0, 9), (9, 14), (14, 26), (26, 32)]
        assert partition.rows(1) == [(4, 11), (11, 20), (20, 29)]
        assert partition.link(np.zeros((2, 32, 48)), 1, 0, 0).shape == (2, 5, 16)
        assert_allclose(partition.node_rows, np.array([0, 9, 14, 26, 32]) * 1e-6)
        # cells stay as they are
        assert partition.cell(np.zeros((32, 48)), 1, 0).shape == (8, 16)
        field = np.random.default_rng(0).random((3, 32, 48))
        means = [[[partition.cell(f, i, j).mean() for j in range(3)] for i in range(4)] for f in field]
        assert_allclose(partition.cell_means(field), means)

    @each("lines", [(0, 8, 16, 24), (0, 8, 8, 24, 32), (1, 8, 16, 24, 32), (0, 8, 16, 24, 31)])
    def test_bad_lines(self, lines):
        with pytest.raises(InputError, match="5 rising pixel rows from 0 to 32"):
            Partition((32, 48), (1e-6, 2e-6), (4, 3), lines)

    def test_lines_lie_in_the_valleys_of_a_face_with_ridges(self):
        """Ridges a third of a window from the faces between cells: each line moves a sixth the other way."""
        x1 = np.arange(96)[:, None]
        ridges = Topography(1e-6 * np.cos(2 * np.pi * (x1 - 8) / 24) * np.ones((1, 48)), (1e-6, 1e-6))
        partition = Partition.through_valleys(ridges, (4, 2), 12e-6)
        assert partition.lines == (0, 20, 44, 68, 96)
        # less than half of the variance in the profile: left where they are
        weaves = np.cos(2 * np.pi * np.arange(48) / 12)
        crossed = Topography(ridges.heights + 1.2e-6 * weaves, ridges.spacing)
        assert Partition.through_valleys(crossed, (4, 2), 12e-6).lines == (0, 24, 48, 72, 96)
        weak = Topography(ridges.heights + 0.8e-6 * weaves, ridges.spacing)
        assert Partition.through_valleys(weak, (4, 2), 12e-6).lines == (0, 20, 44, 68, 96)

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

    @each(("cells", "word"), [((5, 3), "divisors"), ((0, 3), "divisors"), ((8, 3), "8 pixels")])
    def test_bad_cells(self, cells, word):
        with pytest.raises(InputError, match=word):
            Partition((32, 48), (1e-6, 2e-6), cells)


class TestGlobalScale:
    def test_windows_carry_the_load(self, face):
        """The mean over all windows of x1-links is the nominal pressure, at every step."""
        partition = Partition(face.shape, face.spacing, (4, 8))
        programme = LoadProgramme.of((1e8, 5e8), (5e8,), (2e8,))
        boundary = ("free", "periodic")
        states = list(global_states(face, partition, 7.5e-6, programme, modulus=E, law=LAW, boundary=boundary))
        assert tuple(s.step for s in states) == programme
        assert_allclose([s.pressure.mean() for s in states], [1e8, 5e8, 2e8], rtol=1e-9)
        assert {s.raw_gap.shape for s in states} == {(64, 128)}
        assert {s.pressure_across.shape for s in states} == {(3, 8)}

    def test_gap_of_a_flat_face_is_zero_under_load(self):
        flat = Topography(np.zeros((32, 32)), (1e-6, 1e-6))
        (world,) = global_states(
            flat,
            Partition(flat.shape, flat.spacing, (2, 2)),
            8e-6,
            LoadProgramme.of((1e8,)),
            modulus=E,
            law=LAW,
            boundary=("periodic", "periodic"),
        )
        assert_allclose(world.raw_gap, 0, atol=1e-18)
        assert_allclose(world.pressure, 1e8)

    @each("boundary", [("free", "periodic"), ("periodic", "free")])
    def test_a_flat_face_is_a_punch(self, boundary):
        """A strip with free ends: p = 2p̄/(π √(1 − ξ²)), in parts of the width (arcsin ξ₂ − arcsin ξ₁)/π."""
        flat = Topography(np.zeros((128, 128)), (1e-6, 1e-6))
        (world,) = global_states(
            flat,
            Partition(flat.shape, flat.spacing, (8, 8)),
            8e-6,
            LoadProgramme.of((1e8,)),
            modulus=E,
            law=PerfectlyPlastic(np.inf),
            boundary=boundary,
        )
        expected = 8e8 * np.diff(np.arcsin(np.linspace(-1, 1, 9))) / np.pi
        pressure = world.pressure if boundary[0] == "free" else world.pressure.T
        assert_allclose(pressure, np.tile(expected[:, None], (1, 8)), rtol=0.02)

    @each("boundary", [("free", "periodic"), ("mirror", "periodic")])
    @each(("shape", "cells"), [((64, 128), (2, 4)), ((128, 64), (4, 4))])
    def test_the_coarser_grid_changes_little(self, boundary, shape, cells):
        """Waves of 16 points are solved on 8 of them: pressures, and gaps up to the ends, are those of all points."""
        size = (shape[0] * 1e-6, shape[1] * 1e-6)
        smooth = self_affine(shape, size, hurst=1.0, rms_height=2e-7, cut_off=20e-6, rng=8)
        slanted = smooth.heights + 1e-6 * np.linspace(0, 1, shape[0])[:, None]  # the ends differ
        surface = Topography(slanted, smooth.spacing, (False, True))
        partition = Partition(shape, smooth.spacing, cells)
        cut_off = 16 * min(smooth.spacing)
        surface = surface.low_pass(cut_off)
        (world,) = global_states(
            surface,
            partition,
            cut_off,
            LoadProgramme.of((2e8,)),
            modulus=E,
            law=PerfectlyPlastic(np.inf),
            boundary=boundary,
        )
        gap0 = surface.heights.max() - surface.heights
        whole = load_cycle(gap0, HalfSpace(shape, smooth.spacing, E, boundary), loading=(2e8,))[0].contact
        assert_allclose(world.pressure, partition.means(whole.pressure), atol=0.05 * 2e8)
        added = np.ptp(whole.raw_gap - gap0)
        assert_allclose(world.raw_gap, whole.raw_gap, atol=0.03 * added)

    @each(
        ("shape", "finer", "boundary"),
        [
            ((16, 24), (32, 48), ("free", "periodic")),
            ((16, 24), (48, 24), ("mirror", "mirror")),
            ((12, 12), (32, 20), ("periodic", "free")),
        ],
    )
    def test_refinement_is_that_of_scipy(self, shape, finer, boundary):
        samples = np.random.default_rng(0).standard_normal(shape)
        expected = samples
        for axis, mode in enumerate("grid-wrap" if kind == "periodic" else "grid-mirror" for kind in boundary):
            factors = [1.0, 1.0]
            factors[axis] = finer[axis] / shape[axis]
            expected = zoom(expected, factors, order=3, mode=mode, grid_mode=True)
        assert_allclose(Refinement(shape, finer, boundary)(samples), expected, atol=1e-12)

    def test_the_coarser_grid_has_no_seam(self, face):
        """Counted from another window of a periodic face, the gap is the same, only elsewhere."""
        partition = Partition(face.shape, face.spacing, (2, 4))
        given = {"modulus": E, "law": LAW, "boundary": ("free", "periodic"), "rtol": 1e-9}
        programme = LoadProgramme.of((2e8,))
        turned = Topography(np.roll(face.heights, 32, axis=1), face.spacing)
        gaps = [next(global_states(s, partition, 15e-6, programme, **given)).raw_gap for s in (face, turned)]
        assert_allclose(np.roll(gaps[1], -32, axis=1), gaps[0], atol=1e-5 * np.ptp(gaps[0]))

    @each("points", [(8, 8), (16, 12), (32, 24)])
    def test_outer_gap_is_without_the_response_to_the_own_pressure(self, points):
        """A cosine over the cell with its sides as mirrors, on a coarser or the same grid: u = 2p/(E*q), no mean."""
        partition = Partition((64, 48), (1e-6, 2e-6), (2, 2))
        body = HalfSpace(partition.window, partition.spacing, E, "mirror")
        q1, q2 = 2 * np.pi / 32e-6, 3 * np.pi / 48e-6

        def wave(n):
            x1, x2 = ((np.arange(m) + 0.5) * size / m for m, size in zip(n, partition.window_size, strict=True))
            return np.cos(q1 * x1)[:, None] * np.cos(q2 * x2)

        pressure, raw = np.zeros((2 * points[0], 2 * points[1])), np.random.default_rng(0).random((64, 48)) * 1e-9
        pressure[points[0] :, : points[1]] = 3e8 + 2e8 * wave(points)
        state = GlobalState(LoadStep(1e8), pressure, pressure, raw, pressure)
        own = raw - state.outer_gap(partition, body)
        expected = np.zeros((64, 48))
        expected[32:, :24] = 2 * 2e8 / (E * np.hypot(q1, q2)) * wave((32, 24))
        assert_allclose(own, expected, atol=1e-6 * expected.max())  # in single precision

    def test_raw_gap_is_between_virgin_planes(self, face):
        """On unloading the permanent deformation stays negative in the raw gap where the face yielded."""
        partition = Partition(face.shape, face.spacing, (4, 8))
        peak, lower, apart = (
            s.raw_gap
            for s in global_states(
                face,
                partition,
                7.5e-6,
                LoadProgramme.of((2e8,), (2e8,), (1e8, 0.0)),
                modulus=E,
                law=PerfectlyPlastic(0.5e9),
                boundary=("periodic", "periodic"),
            )
        )
        yielded = peak < -1e-9
        assert yielded.any()
        # opened by elastic recovery, but still below the virgin plane in most places, and never closer
        assert (lower[yielded] >= peak[yielded] - 1e-11).mean() > 0.95
        assert (apart[yielded] < 0).mean() > 0.5


class TestResponse:
    half_space = HalfSpace((24, 24), (1e-6, 1e-6), E, "mirror")
    gap0 = -self_affine((24, 24), (24e-6, 24e-6), hurst=0.8, rms_slope=0.2, rng=1).heights

    def test_load_and_plastic_deformation(self):
        steps = LoadProgramme.of((1e8, 6e8), (6e8,), (6e8 - 1, 1e8))
        history = contact_history(
            self.gap0, [s.pressure for s in steps], steps, self.half_space, law=LAW, rigid_at_zero=True
        )
        assert_allclose(history.pressure.mean(axis=(1, 2)), [1e8, 6e8, 6e8 - 1, 1e8], rtol=1e-5)
        # just below the peak nothing has changed; at the loading pressure the unloaded window is tighter
        assert_allclose(history.gap[2], history.gap[1], atol=2e-12)
        assert history.mean_gap[3] < history.mean_gap[0]
        assert history.failures == ()

    def test_without_pressure_rigid_or_at_first_touch(self):
        steps = LoadProgramme.of((0.0,))
        rigid = contact_history(self.gap0 + 5e-6, [0.0], steps, self.half_space, law=LAW, rigid_at_zero=True)
        assert_allclose(rigid.gap[0], self.gap0 + 5e-6, rtol=1e-6)
        touch = contact_history(self.gap0 + 5e-6, [0.0], steps, self.half_space, law=LAW, rigid_at_zero=False)
        assert touch.gap.min() == 0
        assert_allclose(touch.gap[0], self.gap0 - self.gap0.min(), atol=1e-12)

    def test_a_history_goes_to_another_process_as_it_is(self):
        """Loaded, without pressure and with negative gaps, failed: to the bit, and no more than is kept."""
        steps = LoadProgramme.of((0.0, 1e8, 9e8), (9e8,), (5e7,))
        gap0 = np.stack([self.gap0 - self.gap0.mean()] * 4)
        gap0[3] = np.nan
        history = contact_history(gap0, [0.0, 1e8, 9e8, 5e7], steps, self.half_space, law=LAW, rigid_at_zero=True)
        assert history.gap[0].min() < 0
        assert np.isnan(history.gap[3]).all()
        sent = pickle.dumps(history, 5)
        # every gap, a bit for every pixel, and a number for those in contact
        in_contact = np.count_nonzero(history.pressure[:3])
        assert 0 < in_contact < 0.5 * history.gap[:3].size
        assert len(sent) < history.gap.nbytes * (1 + 1 / 32) + 4 * in_contact + 2000
        there = pickle.loads(sent)
        for name in ("gap", "pressure", "contact_fraction", "plastic_fraction", "standoff"):
            assert getattr(there, name).tobytes() == getattr(history, name).tobytes(), name
        assert there.failures == history.failures != ()

    def test_without_pressure_after_a_peak_the_permanent_deformation_stays(self):
        steps = LoadProgramme.of((6e8,), (6e8,), (0.0,))
        gap0 = np.stack([self.gap0, self.gap0 - self.gap0.min() - 5e-8])
        history = contact_history(gap0, [6e8, 0.0], steps, self.half_space, law=LAW, rigid_at_zero=True)
        peak = solve_contact(self.gap0, self.half_space, pressure=6e8, hardness=H)
        gap = np.maximum(gap0[1] + peak.plastic_deformation, 0)
        assert np.count_nonzero(gap) > np.count_nonzero(gap0[1] > 0)  # some opens that would not
        assert_allclose(history.gap[1], gap, atol=1e-11)
        assert_allclose(history.contact_fraction[1], (gap == 0).mean())

    def test_without_the_peak_nothing_is_known_of_its_unloading(self):
        gap0 = np.stack([self.gap0] * 3)
        gap0[1] = np.nan
        steps = LoadProgramme.of((1e8, 5e8), (5e8,), (0.0,))
        history = contact_history(gap0, [1e8, 5e8, 0.0], steps, self.half_space, law=LAW, rigid_at_zero=True)
        assert [f.split(":")[0] for f in history.failures] == ["loading 500 MPa", "unloading 0 MPa from 500 MPa"]
        assert np.isnan(history.gap[1:]).all()

    def test_a_peak_without_pressure_leaves_nothing_behind(self):
        """As where the global contact moves to another window as the load falls."""
        steps = LoadProgramme.of((6e8,), (6e8,), (1e8,))
        history = contact_history(self.gap0, [0.0, 1e8], steps, self.half_space, law=LAW, rigid_at_zero=True)
        virgin = solve_contact(self.gap0, self.half_space, pressure=1e8, hardness=H)
        assert history.failures == ()
        assert_allclose(history.gap[1], virgin.gap, atol=1e-11)

    def test_rounding_above_the_hardness_is_forgiven(self):
        history = contact_history(
            self.gap0, [H * (1 + 1e-9)], LoadProgramme.of((H,)), self.half_space, law=LAW, rigid_at_zero=True
        )
        assert history.failures == ()
        assert (history.gap[0].max(), history.plastic_fraction[0]) == (0, 1)

    def test_a_step_that_fails_is_recorded_and_the_others_go_on(self):
        steps = LoadProgramme.of((1e8, 2e8))
        gap0 = np.stack([np.full((24, 24), np.nan), self.gap0])
        history = contact_history(gap0, [1e8, 2e8], steps, self.half_space, law=LAW, rigid_at_zero=True)
        assert len(history.failures) == 1
        assert "loading 100 MPa" in history.failures[0]
        assert np.isnan(history.gap[0]).all()
        assert np.isfinite(history.gap[1]).all()

    def test_flow_is_solved_only_where_it_is_needed(self):
        gaps = np.array([np.zeros((24, 24)), np.full((24, 24), 1e-3), np.maximum(self.gap0 + 1e-6, 0)])
        flow = flow_history(gaps, (1e-6, 1e-6), 0)
        assert flow.counts.by_kind() == {"solved": 1, "closed": 1, "open": 1}
        assert sum(flow.counts.solvers.by_solver().values()) == 1
        assert_allclose(flow.k[:2], [0, 1e-9 / 12])
        assert flow.k[2] == cell_permeability(gaps[2], (1e-6, 1e-6)).value


class TestStandoff:
    """Of a body on windows: 40 nm where 3 parts of the load are, 80 nm where 1 is; the third window has none.

    Two steps of a column of three windows.
    """

    standoff = np.array([[4e-8, 8e-8, np.nan], [8e-8, 4e-8, np.nan]])[..., None]
    load = np.array([[3e8, 1e8, 0], [1e8, 3e8, 0]])[..., None]
    lowest = np.array([[0.0, 0.0, -1e-7], [0.0, 0.0, 2e-8]])[..., None]

    def test_is_the_mean_over_the_load(self):
        assert_allclose(body_standoff(self.standoff, self.load, self.lowest), 5e-8, rtol=1e-6)

    def test_without_load_is_that_of_first_touch(self):
        standoff = np.where(np.array([False, True])[:, None, None], self.standoff, np.nan)
        lowest = np.array([[3e-8, 5e-8, -1e-7], [0, 0, 2e-8]])[..., None]
        assert_allclose(body_standoff(standoff, self.load, lowest), [1e-7, 5e-8], rtol=1e-6)

    def test_lets_nothing_overlap(self):
        gap = np.linspace(-1e-7, 5e-8, 16, dtype=np.float32).reshape(4, 4)
        for distance in (3e-8, -1e-8):
            assert_allclose(separate(gap, distance), np.maximum(gap + distance, 0), atol=1e-13)
        assert separate(gap, 1e-7).min() == 0
        assert separate(gap, 1e-7).ravel()[1] > 0

    def test_windows_that_failed_are_left_out(self):
        lowest = np.where(np.isnan(self.standoff), np.nan, self.lowest)
        assert_allclose(body_standoff(self.standoff, self.load, lowest), 5e-8, rtol=1e-6)
        assert_allclose(body_standoff(np.full((2, 3, 1), np.nan), self.load, np.full((2, 3, 1), np.nan)), 0)

    def test_of_a_smooth_window_is_none_and_of_a_rough_one_its_approach(self):
        body = HalfSpace((32, 32), (1e-6, 1e-6), E, "mirror")
        rough = -self_affine((32, 32), (32e-6, 32e-6), hurst=0.8, rms_slope=0.2, rng=1).heights
        steps = LoadProgramme.of((1e8,))
        for gap0 in (np.zeros((32, 32)), rough - rough.mean()):
            history = contact_history(gap0, [1e8], steps, body, law=LAW, rigid_at_zero=True)
            contact = solve_contact(gap0, body, pressure=1e8, hardness=H)
            assert history.standoff[0] == pytest.approx(-contact.approach, abs=1e-12)
            # K moves nothing on the mean: the mean raw gap is the standoff
            assert contact.raw_gap.mean() == pytest.approx(history.standoff[0] + gap0.mean(), abs=1e-12)
            assert (history.standoff[0] > 1e-8) == bool(gap0.any())

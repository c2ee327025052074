"""Partition, global scale, windows, libraries, samplers."""

import numpy as np
import pytest
from each import each
from femseal.windows.global_contact import Refinement
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import zoom

from femseal.base.errors import InputError
from femseal.contact import HalfSpace, PerfectlyPlastic, load_cycle
from femseal.flow import cell_permeability
from femseal.loads import LoadProgramme
from femseal.topography import Topography, self_affine
from femseal.windows import Partition, global_states
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


def test_flow_is_solved_only_where_it_is_needed():
    rough = self_affine((24, 24), (24e-6, 24e-6), hurst=0.8, rms_slope=0.2, rng=1).heights
    gaps = np.array([np.zeros((24, 24)), np.full((24, 24), 1e-3), np.maximum(1e-6 - rough, 0)])
    flow = flow_history(gaps, (1e-6, 1e-6), 0)
    assert flow.counts.by_kind() == {"solved": 1, "closed": 1, "open": 1}
    assert sum(flow.counts.solvers.by_solver().values()) == 1
    assert_allclose(flow.k[:2], [0, 1e-9 / 12])
    assert flow.k[2] == cell_permeability(gaps[2], (1e-6, 1e-6)).value

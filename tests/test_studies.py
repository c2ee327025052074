"""The three chains from a face to leakage: closed forms, balances, symmetries, draws and failures."""

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import femseal.library.ladder
import femseal.studies.window_supply
import numpy as np
import pytest
from femseal.library import LinkTable, draw_links
from femseal.seal.laid_windows import LinkWindows
from femseal.studies.ladder_windows import LOADING_FRACTIONS
from femseal.studies.window_supply import TablePressures
from numpy.testing import assert_allclose, assert_array_equal

import femseal.studies.face_flow
import femseal.studies.scene
import femseal.windows.window_flow
from femseal import analytic
from femseal.base.errors import FemsealError, InputError, NotConverged
from femseal.contact import HalfSpace, load_states
from femseal.flow import cell_permeability
from femseal.fluids import IdealGas, Liquid
from femseal.loads import LoadProgramme
from femseal.report import write_folder
from femseal.results import assemble, open_results
from femseal.seal import RectangularSeal
from femseal.seal.pressure_map import AngleTable, Profile
from femseal.studies import Sampling, Scene, StochasticResult, deterministic, stochastic, two_scale
from femseal.studies.two_scale import solve_links
from femseal.topography import Topography, self_affine, turned

# the package has a function of this name
STOCHASTIC = import_module("femseal.studies.stochastic")
MODULUS, HARDNESS = 115e9, 3e9
WATER, DROP = Liquid(viscosity=1e-3), 1e6
PIXEL = 1e-6


def make_scene(heights, spacing=(PIXEL, PIXEL), **given):
    surface = Topography(heights, spacing, (False, True))
    return Scene(
        **{
            "surface": surface,
            "modulus": MODULUS,
            "hardness": HARDNESS,
            "fluid": WATER,
            "inlet_pressure": DROP,
            "outlet_pressure": 0.0,
            "loading": (0.0,),
            "fluid_pressure": "ignored",  # closed forms are of dry contact
        }
        | given
    )


def leakage_of(permeability, scene):
    """Q/L2 = k Δp/(η L1) of a uniform seal of water."""
    return permeability * (scene.inlet_pressure - scene.outlet_pressure) / (1e-3 * scene.surface.size[0])


@pytest.fixture(scope="module")
def rough():
    """A face of 4 × 6 windows under a cycle, with pixels and windows that are not square."""
    face = self_affine((96, 96), (96e-6, 120e-6), hurst=0.8, rms_slope=0.2, roll_off=40e-6, rng=5)
    return make_scene(
        face.heights, face.spacing, loading=(1e8, 3e8, 6e8), unload_from=(6e8,), unloading=(3e8, 1e8), rtol=1e-8
    )


@pytest.fixture(scope="module")
def rough_two_scale(rough):
    return two_scale(rough, (4, 6))


def links_of(scene, cells=(4, 6)):
    """Permeabilities of the links between windows of a face, and the leakage through them."""
    fields = two_scale(scene, cells).fields
    k1, k2 = (solve_links(fields, axis, scene.flow).k for axis in (0, 1))
    seal = RectangularSeal(scene.surface.size, cells, fields.partition.node_rows)
    return k1, k2, np.array([scene.leakage(seal, links).per_length for links in zip(k1, k2, strict=True)])


class TestClosedForms:
    """At no load a face is as rigid, and its gap is known: that of the first touch."""

    def corrugated(self, axis, n=64, amplitude=1e-7):
        """Ridges a cos(2πx/L) with a crest on a pixel, constant along the other axis."""
        wave = amplitude * np.cos(2 * np.pi * np.arange(n) / n)
        return wave[:, None] * np.ones((1, n)) if axis == 0 else np.ones((n, 1)) * wave

    def test_channels_along_the_leakage_are_in_parallel(self):
        """h = a(1 − cos): ⟨h³⟩ = 5/2 a³, and the mean over 64 points is exact."""
        a = 1e-7
        scene = make_scene(self.corrugated(1, amplitude=a))
        expected = leakage_of(2.5 * a**3 / 12, scene)
        assert_allclose(deterministic(scene).leakage, expected, rtol=1e-9)
        result = two_scale(scene, (4, 4))
        assert_array_equal(result.leakage, deterministic(scene).leakage)
        # each column of windows by itself: the mean of h³ over its width
        h3 = (scene.surface.heights.max() - scene.surface.heights[0]).reshape(4, 16) ** 3
        assert_allclose(result.k1[0], np.tile(h3.mean(axis=1) / 12, (4, 1)), rtol=1e-5)

    def test_ridges_across_the_leakage_that_touch_seal(self):
        scene = make_scene(self.corrugated(0), loading=(0.0, 1e6))
        assert (deterministic(scene).leakage == 0).all()
        result = two_scale(scene, (4, 4))
        assert result.leakage[1] == 0
        # the ridge lies at the border of the first row of pieces
        assert (result.k1[1, 0] == 0).all()
        assert (result.k1[1, 1:3] > 0).all()
        assert np.isnan(result.drop_fraction[1]).all()

    @pytest.mark.parametrize("waves", [0, 8])
    def test_gaps_across_the_leakage_are_in_series_at_full_resolution(self, waves):
        """The same with a plateau in contact: no flow enters it."""
        n, w, a, gap = 128, 32, 1e-7, 4e-7
        wave = a * np.cos(2 * np.pi * waves * (np.arange(n) + 0.5) / n) if waves else np.zeros(n)
        heights = np.where(np.arange(n) < w, gap, wave[:, None])
        scene = make_scene(heights)
        k = analytic.wavy_gap_across(gap, a / gap) if waves else analytic.parallel_plates(gap)
        assert_allclose(deterministic(scene).leakage, leakage_of(0.75 * k, scene), rtol=2e-3 if waves else 1e-9)

    @pytest.mark.parametrize(("share", "expected"), [(0.1, 0.125386), (0.5, 3.534788e-3)])
    def test_elastic_wave_along_its_grooves(self, share, expected):
        """Westergaard's gap: ⟨g³⟩/(2Δ)³ falls from 5/16 to known values as p̄/p* grows."""
        n, half = 256, 2e-7
        heights = half * np.ones((16, 1)) * np.cos(2 * np.pi * (np.arange(n) + 0.5) / n)
        full = np.pi * MODULUS * half / (n * PIXEL)
        scene = make_scene(heights, hardness=np.inf, loading=(share * full,), boundary=("periodic", "periodic"))
        result = deterministic(scene)
        assert_allclose(result.leakage, leakage_of((2 * half) ** 3 / 12 * expected, scene), rtol=2e-2)
        assert_allclose(result.contact_fraction, 2 / np.pi * np.arcsin(np.sqrt(share)), atol=2 / n)
        assert result.plastic_fraction[0] == 0
        assert result.residual < 1e-5

    @pytest.mark.parametrize("boundary", [("free", "periodic"), ("mirror", "periodic")])
    def test_the_ends_of_a_flat_face_carry_more_if_they_are_free(self, boundary):
        """A punch, p = 2p̄/(π √(1 − ξ²)); a mirrored face has no ends."""
        scene = make_scene(np.zeros((64, 64)), hardness=np.inf, loading=(1e8,), boundary=boundary)
        share = 4 * np.diff(np.arcsin(np.linspace(-1, 1, 5))) / np.pi if boundary[0] == "free" else np.ones(4)
        rows = two_scale(scene, (4, 4)).pressure[0].T
        assert_allclose(rows, np.tile(1e8 * share, (4, 1)), rtol=0.03)
        whole = deterministic(scene)
        assert (whole.contact_fraction[0], whole.leakage[0]) == (1, 0)

    def test_a_face_that_is_all_plastic_seals(self):
        scene = make_scene(self.corrugated(1), boundary=("periodic", "periodic"), hardness=1e9, loading=(1e9,))
        result = deterministic(scene)
        assert (result.leakage[0], result.contact_fraction[0], result.mean_gap[0]) == (0, 1, 0)
        assert two_scale(scene, (4, 4)).leakage[0] == 0


class TestBalance:
    def test_gap_and_pressure_of_the_windows_are_stitched_in_place(self, rough, rough_two_scale):
        result, partition = rough_two_scale, rough_two_scale.partition
        assert result.gap.shape == result.contact_pressure.shape == (5, 96, 96)
        for s in range(5):
            assert_allclose(partition.cell_means(result.gap[s]), result.mean_gap[s], rtol=1e-6)
            pressure = partition.cell_means(result.contact_pressure[s])
            assert_allclose(pressure, result.pressure[s], rtol=1e-5, atol=1e-3)
            closed = partition.cell_means(result.gap[s] == 0)
            assert_allclose(closed, result.contact_fraction[s], atol=1 / 384)  # one point may touch without pressure
            at_hardness = partition.cell_means(result.contact_pressure[s] >= HARDNESS * (1 - 1e-7))
            assert_allclose(at_hardness, result.plastic_fraction[s], atol=2 / 384)
        # the whole load, at every step
        assert_allclose(
            result.contact_pressure.mean(axis=(1, 2), dtype=float), [s.pressure for s in result.steps], rtol=1e-5
        )
        for axis, k in ((0, result.k1), (1, result.k2)):
            piece = partition.cell(result.gap[0], 1, 5).astype(float)
            assert_allclose(k[0, 1, 5], cell_permeability(piece, rough.surface.spacing, axis=axis).value, rtol=1e-9)
        counts = result.counts
        assert counts.flows == 5 * 2 * 4 * 6
        assert counts.closed == np.count_nonzero(result.k1 == 0) + np.count_nonzero(result.k2 == 0) > 0

    def test_the_drop_is_that_of_all_pieces(self, rough, rough_two_scale):
        """Fractions of all pieces are 1 together, and of the face as one piece."""
        result = rough_two_scale
        assert_allclose(result.drop_fraction.sum(axis=(1, 2)), 1, rtol=1e-9)
        one = two_scale(replace(rough, loading=(1e8,), unload_from=(), unloading=()), (1, 1))
        assert_allclose(one.drop_fraction, 1, rtol=1e-9)

    def test_the_solution_of_the_face_is_not_solved_again(self, rough, rough_two_scale):
        known = deterministic(rough, cells=(4, 6))
        result = two_scale(rough, (4, 6), solved=known)
        assert np.shares_memory(result.gap, known.gap)
        assert_array_equal(result.k2, rough_two_scale.k2)
        for cells in ((4, 3), (2, 6)):
            with pytest.raises(InputError, match="solved: given a solution with"):
                two_scale(rough, cells, solved=known)
        with pytest.raises(InputError, match="no pieces"):
            two_scale(rough, (4, 6), solved=deterministic(rough))

    def test_gas(self, rough, rough_two_scale):
        """A gas without slip leaves permeabilities and fractions as they are; with it, each piece has its own factor."""
        gas = IdealGas(viscosity=2e-5, molar_mass=0.029, temperature=300.0, slip=False)
        scene = replace(rough, fluid=gas, inlet_pressure=5e6, outlet_pressure=1e5)
        result = two_scale(scene, (4, 6))
        assert_array_equal(result.k1, rough_two_scale.k1)
        assert_allclose(result.drop_fraction, rough_two_scale.drop_fraction, atol=1e-9)
        slips = two_scale(replace(scene, fluid=replace(gas, slip=True), inlet_pressure=3e5), (4, 6))
        pressure = np.nanmean(result.partition.cell(slips.fluid_pressure[0], 0, 1), dtype=float)
        piece = result.partition.cell(result.gap[0], 0, 1).astype(float)
        law = replace(gas, slip=True).law
        expected = cell_permeability(piece, rough.surface.spacing, law=law, pressure=pressure).value
        assert_allclose(slips.k1[0, 0, 1], expected, rtol=1e-6)
        assert_allclose(slips.drop_fraction.sum(axis=(1, 2)), 1, rtol=1e-9)

    def test_deterministic_leakage_is_that_of_its_gap(self, rough):
        result = deterministic(rough)
        k = [cell_permeability(g.astype(float), rough.surface.spacing, sides="periodic").value for g in result.gap]
        assert_allclose(result.leakage, leakage_of(np.array(k), rough), rtol=1e-4)
        assert_allclose(result.mean_gap, result.gap.mean(axis=(1, 2), dtype=float), rtol=1e-6)
        assert_allclose(result.contact_fraction, (result.gap == 0).mean(axis=(1, 2)))
        assert result.residual <= rough.rtol


class TestRareTallPoints:
    """They carry the first load."""

    @pytest.fixture(scope="class")
    @classmethod
    def face(cls):
        n = 192
        face = self_affine((n, n), (n * PIXEL, n * PIXEL), hurst=0.8, rms_slope=0.02, roll_off=30e-6, rng=2)
        x = np.arange(n) + 0.5
        heights = face.heights.copy()
        for a, b in np.random.default_rng(3).integers(0, n, (6, 2)):
            heights += 1e-6 * np.exp(-((x[:, None] - a) ** 2 + (x - b) ** 2) / 4.5)
        tall = Topography(heights, face.spacing).low_pass(8e-6)
        scene = make_scene(tall.heights, loading=(1e7, 5e7), unload_from=(5e7,), unloading=(1e7,), rtol=1e-6)
        return scene, deterministic(scene)

    def test_contact_is_that_of_the_whole_face(self, face):
        scene, whole = face
        result = two_scale(scene, (2, 2))
        assert result.warnings == ()
        assert_array_equal(result.gap, whole.gap)
        assert_array_equal(result.leakage, whole.leakage)
        assert_allclose(result.contact_fraction.mean(axis=(1, 2)), whole.contact_fraction, rtol=1e-12)
        assert_allclose(result.plastic_fraction.mean(axis=(1, 2)), whole.plastic_fraction, rtol=1e-12)
        assert_allclose(result.pressure.mean(axis=(1, 2)), scene.steps.pressures, rtol=1e-8)
        assert_allclose(result.contact_pressure.mean(axis=(1, 2)), scene.steps.pressures, rtol=1e-6)


class TestResolvedFlow:
    def test_results_have_maps_of_the_face(self, rough, tmp_path):
        """As those of a deterministic study, and the pieces."""
        study = two_scale(rough, (4, 6))
        results = assemble(rough, two_scale=study)
        data, exact = results.dataset, assemble(rough, deterministic=deterministic(rough)).dataset
        assert {"k1", "k2", "window_drop_fraction"} <= set(data)
        for name, scale in (("gap", 1e-6), ("contact_pressure", 1e9), ("fluid_pressure", DROP)):
            assert_allclose(data[f"face_{name}"], exact[f"face_{name}"], atol=1e-4 * scale)
        assert_array_equal(results.cell(1, 2)["window_pressure"], study.pressure[:, 1, 2])
        assert "4 × 6 pieces" in str(results)
        write_folder(results, tmp_path, rough.surface)
        assert "cut into 4 × 6 pieces" in (tmp_path / "report.html").read_text(encoding="utf-8")
        assert open_results(tmp_path).gap(1).shape == (96, 96)


class TestSymmetries:
    def test_pieces_may_be_counted_from_any_column(self, rough, rough_two_scale):
        turned = replace(
            rough, surface=Topography(np.roll(rough.surface.heights, 16, axis=1), rough.surface.spacing, (False, True))
        )
        result = two_scale(turned, (4, 6))
        assert_allclose(result.leakage, rough_two_scale.leakage, rtol=1e-5)
        is_open = rough_two_scale.k1 > 1e-4 * rough_two_scale.k1.max()
        assert_allclose(np.roll(result.k1, -1, axis=2)[is_open], rough_two_scale.k1[is_open], rtol=1e-3)
        shifted = np.roll(result.drop_fraction, -1, axis=2)
        assert_allclose(shifted, rough_two_scale.drop_fraction, atol=1e-3)

    @pytest.mark.parametrize("study", [deterministic, lambda scene: two_scale(scene, (4, 6))])
    def test_a_face_turned_about_leaks_the_other_way(self, rough, study):
        turned = replace(rough, surface=rough.surface.flip(0), inlet_pressure=0.0, outlet_pressure=DROP)
        forth, back = study(rough), study(turned)
        assert_allclose(back.leakage, -forth.leakage, rtol=1e-5)
        if hasattr(forth, "fluid_pressure"):
            assert_allclose(back.fluid_pressure[:, ::-1], forth.fluid_pressure, atol=1e-3 * DROP)

    def test_units_of_length_cancel(self, rough, rough_two_scale):
        """A face twice as large in all directions, under the same pressures, has twice the gap and eight times k."""
        d1, d2 = rough.surface.spacing
        large = replace(rough, surface=Topography(2 * rough.surface.heights, (2 * d1, 2 * d2), (False, True)))
        result = two_scale(large, (4, 6))
        assert_allclose(result.leakage, 4 * rough_two_scale.leakage, rtol=1e-4)  # k Δp/(η L1)
        assert_allclose(result.mean_gap, 2 * rough_two_scale.mean_gap, rtol=1e-4)
        for pressure in ("place", "global", "uniform"):
            sampling = replace(SAMPLING, pressure=pressure, library_cells=8)
            one = stochastic(rough, (4, 6), sampling)
            two = stochastic(large, (4, 6), replace(sampling, length=2 * sampling.length))
            assert_allclose(two.leakage, 4 * one.leakage, rtol=1e-3)

    @pytest.mark.parametrize("turn", [lambda z: np.flip(z, axis=0), lambda z: np.roll(z, 32, axis=1)])
    def test_links_of_equal_cells_follow_the_global_pressure_of_their_place(self, turn):
        """Equal windows at different heights: every link draws the same cell, and only its place decides.

        Seen the other way along x1, or counted from another column, the seal is the same; under a light load, so that
        links without contact are among them.
        """
        window = self_affine((24, 16), (24e-6, 20e-6), hurst=0.8, rms_slope=0.15, roll_off=20e-6, rng=3)
        fine = np.tile(window.high_pass(10.5e-6).heights, (4, 6))
        long = np.kron(3e-7 * np.random.default_rng(6).standard_normal((4, 6)), np.ones((24, 16)))
        leakages = []
        for heights in (fine + long, turn(fine + long)):
            scene = make_scene(heights, loading=(1e7, 1e8), rtol=1e-8)
            scene = replace(scene, surface=Topography(heights, window.spacing))
            assert (two_scale(scene, (4, 6)).pressure[0] == 0).any()
            leakages.append(stochastic(scene, (4, 6), replace(SAMPLING, pressure="global", library_cells=4)).leakage)
        assert_allclose(leakages[0], np.tile(leakages[0][0], (6, 1)), rtol=1e-4)  # no chance in it
        assert_allclose(leakages[1], leakages[0], rtol=1e-4)

    def test_windows_under_a_global_contact_are_unloaded_from_their_own_peaks(self, monkeypatch):
        """Against peaks 10 % apart: those of the standard ladder missed this by 8 %."""
        face = turned(
            (144, 144),
            (144e-6, 144e-6),
            pitch=48e-6,
            depth=0.8e-6,
            roughness=0.5e-6,
            feed_error=0.03,
            depth_error=0.1,
            roughness_roll_off=30e-6,
            cut_off=8e-6,
            rng=3,
        )
        scene = make_scene(face.heights, loading=(2e8,), unload_from=(2e8,), unloading=(5e7,))
        scene = replace(scene, surface=face)
        sampling = replace(SAMPLING, pressure="global", library_cells=4, length=576e-6)
        found = stochastic(scene, (6, 6), sampling)
        dense = tuple(np.geomspace(0.01, 0.9, 25))
        monkeypatch.setattr(
            "femseal.studies.ladder_windows.LOADING_FRACTIONS", tuple(sorted({*LOADING_FRACTIONS, *dense}))
        )
        monkeypatch.setattr("femseal.studies.seat_rows.PEAK_RATIO", 1.1)
        monkeypatch.setattr("femseal.studies.seat_rows.MOST_PEAKS", 1000)
        exact = stochastic(scene, (6, 6), sampling)
        assert_allclose(np.median(found.leakage, axis=0), np.median(exact.leakage, axis=0), rtol=0.02)


SAMPLING = Sampling(length=120e-6, realisations=6, library_cells=24, seed=3)


def alone(heights, scene):
    """Permeabilities of a window that a scene's pressures load by itself."""
    body = HalfSpace(heights.shape, (PIXEL, PIXEL), MODULUS, "mirror")
    states = load_states(-heights, body, scene.steps, law=scene.law, rtol=scene.rtol)
    return np.array([cell_permeability(s.contact.gap, (PIXEL, PIXEL)).value for s in states])


@pytest.fixture(scope="module")
def columns():
    """Six equal columns of windows, the rows of each different, as a face turned on a lathe with no error."""
    face = self_affine((96, 16), (96e-6, 20e-6), hurst=0.8, rms_slope=0.15, roll_off=20e-6, rng=4)
    heights = np.tile(face.heights, (1, 6))
    return make_scene(heights, face.spacing, loading=(1e8, 3e8), unload_from=(3e8,), unloading=(1e8,), rtol=1e-8)


class TestDraws:
    @pytest.mark.parametrize("sampler", ["history", "derivative", "copula", "block"])
    @pytest.mark.parametrize(("length", "count"), [(20e-6, 1), (120e-6, 6), (312e-6, 16)])
    def test_equal_columns_leave_nothing_to_chance(self, columns, sampler, length, count):
        """Every seal is the surface itself, in whole windows of 20 µm: that of two scales, without a band."""
        sampling = replace(SAMPLING, library_cells=8, sampler=sampler, length=length)
        result = stochastic(columns, (4, 6), sampling)
        expected = links_of(columns)[2]
        assert_allclose(result.leakage, np.tile(expected, (6, 1)), rtol=1e-4)
        assert_allclose(result.quantile(0.95), result.quantile(0.05), rtol=1e-4)
        assert_allclose(result.seal.size, (96e-6, count * 20e-6))
        assert result.seal.cells == (4, count)

    def test_equal_windows_on_a_ladder_of_pressures(self):
        """Fine waves only, the same in every window, on a ladder that meets none of the loads but the peaks: one window alone."""
        window = self_affine((32, 32), (32e-6, 32e-6), hurst=0.8, rms_slope=0.15, roll_off=15e-6, cut_off=8e-6, rng=1)
        high = window.high_pass(15e-6).heights
        scene = replace(
            make_scene(
                np.tile(high, (2, 3)),
                boundary=("periodic", "periodic"),
                loading=(1.32e8, 2.4e8, 4e8),
                unload_from=(2.4e8, 4e8),
                unloading=(2e8, 1e8, 6e7),
                rtol=1e-8,
            ),
            surface=Topography(np.tile(high, (2, 3)), (PIXEL, PIXEL)),
        )
        result = stochastic(scene, (2, 3), replace(SAMPLING, pressure="global", library_cells=6, length=2e-4))
        assert {*scene.loading} & {*result.library.ladder.loading} == {2.4e8, 4e8} == {*result.library.ladder.peaks}
        # of a single window k falls in small jumps, as constrictions close; over many of them the ladder is exacter
        assert_allclose(result.leakage, np.tile(leakage_of(alone(high, scene), scene), (6, 1)), rtol=0.05)

    def test_uniform_pressure_on_equal_windows(self):
        """Every window under the nominal pressure with all its waves: the contact of one window alone."""
        window = self_affine((32, 32), (32e-6, 32e-6), hurst=0.8, rms_slope=0.15, rng=1).heights
        scene = make_scene(
            np.tile(window, (2, 2)), loading=(0.0, 1e8, 4e8), unload_from=(4e8,), unloading=(2e8,), rtol=1e-8
        )
        result = stochastic(scene, (2, 2), replace(SAMPLING, pressure="uniform", library_cells=4, length=2e-4))
        expected = leakage_of(alone(window, scene), scene)
        assert_allclose(result.leakage[:, :3], np.tile(expected[:3], (6, 1)), rtol=1e-4)
        assert_allclose(result.leakage[:, 3], expected[3], rtol=2e-3)  # between stops of the ladder

    def test_a_broad_seal_is_rows_in_series(self):
        """Equal windows: leakage falls with the number of rows, whatever the face has."""
        window = self_affine((32, 32), (32e-6, 32e-6), hurst=0.8, rms_slope=0.15, rng=1).heights
        scene = make_scene(np.tile(window, (2, 2)), loading=(1e8,), rtol=1e-8)
        sampling = replace(SAMPLING, pressure="uniform", library_cells=4)
        face, broad = (stochastic(scene, (2, 2), replace(sampling, breadth=b)) for b in (None, 320e-6))
        assert (face.seal.cells[0], broad.seal.cells[0]) == (2, 10)
        assert_allclose(broad.seal.size[0], 320e-6)
        assert_allclose(broad.leakage, face.leakage / 5, rtol=1e-6)

    @pytest.mark.parametrize("pressure", ["uniform", "global"])
    def test_bounds_enclose_the_same_draws_and_their_pixels_close_them(self, pressure):
        """Twice as many pixels of the same face, twice as close."""
        distance = []
        for n in (64, 128):
            face = self_affine((n, n), (64e-6, 64e-6), hurst=0.8, rms_slope=0.15, roll_off=32e-6, cut_off=8e-6, rng=1)
            back = {"unload_from": (3e8,), "unloading": (1e8,)} if pressure == "uniform" else {}
            scene = make_scene(face.heights, face.spacing, loading=(1e8, 3e8), **back)
            sampling = replace(SAMPLING, pressure=pressure, library_cells=2, length=96e-6, realisations=3)
            plain, bounded = (stochastic(scene, (2, 2), replace(sampling, bounds=b)) for b in (False, True))
            assert plain.leakage_lower_bound is None
            assert_array_equal(bounded.leakage, plain.leakage)
            lower, upper = bounded.leakage_lower_bound, bounded.leakage_upper_bound
            assert lower.shape == upper.shape == plain.leakage.shape
            assert (lower < upper).all()
            assert (lower < 1.05 * plain.leakage).all()
            assert (upper > 0.95 * plain.leakage).all()
            distance.append(np.log(upper / lower).mean())
        assert distance[1] < 0.7 * distance[0]

    def test_bounds_need_ladders_and_histories(self):
        for options in ({"pressure": "place"}, {"pressure": "uniform", "sampler": "copula"}):
            with pytest.raises(InputError, match=r"bounds.*'history'"):
                stochastic(make_scene(np.zeros((64, 64))), (2, 2), replace(SAMPLING, bounds=True, **options))

    def test_a_library_with_places_holds_the_windows_of_the_face(self, rough, rough_two_scale):
        """In the order of the face; with twice as many, those moved by half a window come after them."""
        sampling = replace(SAMPLING, sampler="block")
        library, parts = stochastic(rough, (4, 6), sampling).library, rough_two_scale
        k1, k2, _ = links_of(rough)
        assert_array_equal(library.k1, k1)
        assert_array_equal(library.k2, k2)
        for name in ("pressure", "mean_gap", "contact_fraction"):
            assert_array_equal(getattr(library.curves, name).reshape(4, 6, 5), getattr(parts, name).transpose(1, 2, 0))
        double = stochastic(rough, (4, 6), replace(sampling, library_cells=40)).library
        assert (double.shifts, double.size) == (2, 48)
        assert_array_equal(double.k1[:, :, :6], library.k1)
        gap = parts.partition.link(parts.gap[1], 2, 0, 0, shift=8).astype(float)
        assert_allclose(double.k1[1, 2, 6], cell_permeability(gap, rough.surface.spacing).value, rtol=1e-9)

    def test_whole_runs_of_columns_are_the_surface(self, rough, monkeypatch):
        """A run that goes all round the face, from wherever it begins, is the face through its links."""
        monkeypatch.setattr(femseal.studies.window_supply, "correlation_length", lambda k: 1e6)
        monkeypatch.setattr(femseal.studies.window_supply, "RUN_LENGTHS", 1e9)
        result = stochastic(rough, (4, 6), replace(SAMPLING, sampler="block"))
        assert result.library.correlation_length == 1e6
        whole = np.isclose(result.leakage, links_of(rough)[2], rtol=1e-6).all(axis=1)
        assert whole.any()  # runs of six columns on average: (5/6)^5 of the seals have one run

    def test_a_realisation_is_the_same_among_few_and_many(self, rough):
        sampling = replace(SAMPLING, sampler="history")
        few, many = stochastic(rough, (4, 6), replace(sampling, realisations=2)), stochastic(rough, (4, 6), sampling)
        assert many.leakage.shape == (6, 5)
        assert_array_equal(few.leakage, many.leakage[:2])
        assert len(np.unique(many.leakage[:, 0])) == 6  # each another seal

    def test_the_order_of_the_work_does_not_matter(self, rough):
        def backwards(function, *lists):
            tasks = list(zip(*(list(x) for x in lists), strict=False))
            return [function(*task) for task in reversed(tasks)][::-1]

        for pressure in ("place", "global", "uniform"):
            sampling = replace(SAMPLING, pressure=pressure, library_cells=8 if pressure == "place" else 3)
            one, other = (stochastic(rough, (4, 6), sampling, mapper=m) for m in (map, backwards))
            assert_array_equal(one.leakage, other.leakage)
        assert_array_equal(
            two_scale(rough, (4, 6), mapper=backwards).leakage,
            two_scale(rough, (4, 6)).leakage,
        )

    def test_the_seed_decides(self, rough):
        """Which cells are in the library, and which of them are drawn."""
        sampling = replace(SAMPLING, library_cells=12, pressure="uniform")
        one, again, other = (stochastic(rough, (4, 6), replace(sampling, seed=s)) for s in (3, 3, 4))
        assert_array_equal(one.leakage, again.leakage)
        assert (one.leakage != other.leakage).all()
        assert_array_equal(one.library.curves.k, again.library.curves.k)
        assert len(np.intersect1d(one.library.curves.k[:, 3], other.library.curves.k[:, 3])) < 12

    @pytest.mark.parametrize("pressure", ["place", "global", "uniform"])
    def test_long_seals_scatter_less_about_the_same_median(self, rough, pressure):
        """Leakage per length of parallel pieces: the median stays, the band narrows as 1/√length."""
        loaded = replace(rough, unload_from=(), unloading=())
        sampling = replace(SAMPLING, realisations=60, library_cells=12, pressure=pressure)
        short, long = (stochastic(loaded, (4, 6), replace(sampling, length=n * 120e-6)) for n in (1, 16))
        medians = np.array([r.quantile(0.5)[:2] for r in (short, long)])
        bands = np.array([np.log(r.quantile(0.9) / r.quantile(0.1))[:2] for r in (short, long)])
        assert (np.abs(np.log(medians[1] / medians[0])) < bands[0]).all()
        assert (bands[1] < bands[0] / 2).all()
        assert (bands[1] > bands[0] / 8).all()

    @pytest.mark.parametrize("sampler", ["history", "derivative", "copula", "block"])
    def test_a_realisation_is_the_flow_through_its_drawn_links(self, rough, sampler):
        """Links are drawn column by column, each from its own row, with the given sampler and seed."""
        result = stochastic(rough, (4, 6), replace(SAMPLING, sampler=sampler, seed=8))
        length = result.library.correlation_length
        run = min(10 * length, 6)
        rows = [np.repeat(np.arange(n)[:, None], 6, axis=1) for n in (4, 3)]
        tables = [
            LinkTable(k, path, rough.steps, run)
            for k, path in zip((result.library.k1, result.library.k2), rows, strict=True)
        ]
        for realisation in range(2):
            draws = [
                draw_links(t, sampler=sampler, seed=8, realisation=realisation, axis=a) for a, t in enumerate(tables)
            ]
            for s in range(5):
                leakage = rough.leakage(result.seal, (draws[0](s), draws[1](s))).per_length
                assert_allclose(result.leakage[realisation, s], leakage, rtol=1e-12)

    @pytest.mark.parametrize(("pressure", "size"), [("place", 24), ("global", 30), ("uniform", 30)])
    def test_a_library_may_have_more_cells_than_the_surface(self, rough, pressure, size):
        """Where cells have places the curves show those of the face; the moved ones have no contact of their own."""
        loaded = replace(rough, unload_from=(), unloading=())
        result = stochastic(loaded, (4, 6), replace(SAMPLING, pressure=pressure, library_cells=30))
        assert result.failures == ()
        k = result.library.curves.k[:, 1]
        assert k.size == size
        assert len(np.unique(k)) > 18

    def test_cells_at_random_places_lie_within_a_narrow_surface(self, rough):
        """One row of windows: anything beyond it would be cut off."""
        strip = Topography(rough.surface.heights[:24], rough.surface.spacing, (False, True))
        sampling = replace(SAMPLING, pressure="uniform", library_cells=12)
        result = stochastic(replace(rough, surface=strip), (1, 6), sampling)
        assert result.failures == ()
        assert result.library.size == 12

    def test_the_drawn_seal_leaks_about_as_much_as_its_surface(self, rough, rough_two_scale):
        """Where no constriction decides; as long as the surface, so that both have as many windows."""
        result = stochastic(rough, (4, 6), replace(SAMPLING, realisations=40))
        assert 0.7 < result.quantile(0.5)[0] / rough_two_scale.leakage[0] < 1.4

    @pytest.mark.parametrize(
        ("given", "words"),
        [
            ({"pressure": "magic"}, "place, global, uniform"),
            ({"pressure": "global", "sampler": "block"}, "neighbours"),
            ({"pressure_map": Profile((1.0, 2.0))}, "map: given an uneven one with the pressure 'place'"),
            ({"pressure_map": AngleTable((1.0, 2.0)), "pressure": "global"}, "another with the pressure 'uniform'"),
            ({"library": Path("kept")}, "no ladder"),
            ({"width": 0.0}, "width"),
            ({"breadth": 1e-3}, "uniform"),
            ({"breadth": -1.0, "pressure": "uniform"}, "length > 0"),
        ],
    )
    def test_bad_sampling(self, rough, given, words):
        with pytest.raises(InputError, match=words):
            stochastic(rough, (4, 6), replace(SAMPLING, **given))


class TestErrorOfTheLibrary:
    """A row of parallel links with ln k normal of deviation σ: all is known in closed form."""

    steps = LoadProgramme.of((1e8,))

    def spread(self, cells, links, sigma=0.5, realisations=200, copies=1):
        rng = np.random.default_rng(4)
        k = np.tile(np.exp(sigma * rng.standard_normal((1, 1, cells))), copies)
        table = LinkTable(k, np.zeros((1, links), int), self.steps, 0.0, 1.0)
        none = LinkTable(np.empty(k.shape), np.zeros((0, links), int), self.steps)
        scene = make_scene(np.zeros((8, 8)), loading=(1e8,))
        seal = RectangularSeal((1e-3, links * 1e-3), (1, links))
        task = [
            STOCHASTIC._realise(
                r,
                again,
                scene=scene,
                seal_windows=LinkWindows(seal),
                kinds=((table, none),),
                sampling=replace(SAMPLING, sampler="history"),
                at=TablePressures((0.0,)),
                unsolved=frozenset(),
                independent=1 / copies,
                first=np.arange(1),
            ).leakage
            for again in (False, True)
            for r in range(realisations)
        ]
        leakage = np.array(task).reshape(2, realisations, 1)
        return StochasticResult(self.steps, seal, None, leakage[0], leakage[1])

    def test_realisations_and_library_scatter_as_their_numbers_say(self):
        """ln of the mean of n numbers of relative deviation v scatters by v/√n: links for the one, cells for the other."""
        v = np.sqrt(np.exp(0.25) - 1)
        for cells, links in ((100, 400), (400, 100)):
            result = self.spread(cells, links)
            assert_allclose(result.realisation_spread[0], v / np.sqrt(links), rtol=0.2)
            assert_allclose(result.library_error[0], v / np.sqrt(cells), rtol=0.3)

    def test_the_same_windows_once_more_lessen_no_error(self):
        v = np.sqrt(np.exp(0.25) - 1)
        assert_allclose(self.spread(100, 400, copies=4).library_error[0], v / np.sqrt(100), rtol=0.3)

    def test_windows_that_overlap_add_no_area(self, rough):
        """A face of 24 windows: more of them are cut from the same area."""
        for sampler, pressure, count, size in (
            ("block", "place", 6, 24),
            ("block", "place", 24, 24),
            ("block", "place", 96, 96),
            ("runs", "place", 96, 24),
            ("history", "uniform", 32, 32),
        ):
            sampling = replace(SAMPLING, sampler=sampler, pressure=pressure, library_cells=count, realisations=2)
            library = stochastic(replace(rough, unload_from=(), unloading=()), (4, 6), sampling).library
            assert (library.size, library.independent) == (size, 24), (pressure, count)

    def test_needed_numbers(self):
        result = replace(self.spread(100, 400), library=SimpleNamespace(independent=100))
        realisations, windows = result.needed(0.01)
        assert_allclose(windows, 2 * 100 * (result.library_error[0] / 0.01) ** 2, atol=1)
        assert_allclose(realisations, 2 * np.pi / 2 * (result.realisation_spread[0] / 0.01) ** 2, atol=1)
        assert result.needed(10.0) == (2, 1)

    def test_quantiles_that_cannot_be_trusted(self):
        result = replace(self.spread(20, 400, realisations=20), library=SimpleNamespace(independent=20))
        assert "at least 1000 needed" in result.unsupported(0.001)[0]
        # the band of realisations is narrower than the error of the library
        assert "error of 20 library windows" in result.unsupported(0.4)[0]
        assert replace(self.spread(1000, 10), library=SimpleNamespace(independent=1000)).unsupported(0.05) == ()

    def test_more_is_drawn_until_the_width_is_reached(self, rough):
        sampling = replace(SAMPLING, pressure="uniform", library_cells=16, realisations=16)
        scene = replace(rough, loading=(1e8,), unload_from=(), unloading=())
        result = stochastic(scene, (8, 8), replace(sampling, width=0.5))
        assert result.library.size > 16
        assert result.failures == result.warnings == ()
        realisations, windows = result.needed(0.5)
        assert realisations <= len(result.leakage)
        assert windows <= result.library.size
        # a face of 24 windows has no more of them
        text = stochastic(scene, (4, 6), replace(SAMPLING, width=0.01)).warnings[-1]
        assert text.startswith("width 0.01 not reached")


class TestStatistics:
    steps = LoadProgramme.of((1e8, 2e8))

    def result(self, leakage):
        leakage = np.array(leakage, float)
        return StochasticResult(self.steps, RectangularSeal((1.0, 1.0), (1, 1)), None, leakage, leakage)

    def test_quantiles_lie_between_in_log_space(self):
        result = self.result([[1, 5], [100, 5], [10_000, 5]])
        assert_allclose(result.quantile(0.5), [100, 5])
        assert_allclose(result.quantile(0.25), [10, 5])
        assert_allclose(result.quantile(0.75), [1000, 5])
        assert_allclose(result.quantile(0.95), [10 ** (4 - 0.2), 5])
        assert_allclose([result.quantile(q)[0] for q in (0, 1)], [1, 10_000])

    def test_sealed_ones(self):
        result = self.result([[0, 0], [0, 1], [4, 1], [0, 1]])
        assert_allclose(result.sealed_fraction, [0.75, 0.25])
        assert_allclose(result.mean, [1, 0.75])
        assert_allclose(result.quantile(0.5), [0, 1])
        assert_allclose(result.quantile(0.9), [0, 1])  # between 0 and 4
        assert_allclose(result.quantile(1.0), [4, 1])

    def test_failed_ones_are_left_out(self):
        result = self.result([[np.nan, np.nan], [0, np.nan], [4, np.nan], [9, np.nan]])
        assert_allclose(result.mean, [13 / 3, np.nan])
        assert_allclose(result.sealed_fraction, [1 / 3, np.nan])
        assert_allclose(result.quantile(0.75), [6, np.nan])
        assert_allclose(result.quantile(0.5), [4, np.nan])

    def test_flow_towards_the_inlet(self):
        result = self.result([[-1, -4], [-100, 4]])
        assert_allclose(result.quantile(0.5), [-10, 0])


class TestSolvers:
    """Every linear system is counted under the solver that solved it."""

    def test_of_two_scales(self, rough_two_scale):
        """A system for each open piece along each axis, and for each step of the face."""
        counts, solvers = rough_two_scale.counts, rough_two_scale.solvers
        assert sum(counts.solvers.by_solver().values()) == counts.solved
        assert sum(solvers.by_solver().values()) == counts.solved + 5
        assert 0 < solvers.worst_imbalance < 1e-2

    @pytest.mark.parametrize("solver", ["elimination", "amg"])
    def test_the_scene_chooses_the_solver(self, rough, rough_two_scale, solver):
        chosen = replace(rough, solver=solver, loading=(1e8,), unload_from=(), unloading=())
        sampling = replace(SAMPLING, pressure="uniform", library_cells=4, realisations=2)
        results = deterministic(chosen), two_scale(chosen, (4, 6)), stochastic(chosen, (4, 6), sampling)
        for result in results:
            assert {*result.solvers.by_solver()} == {solver}
        assert_allclose(results[1].leakage, rough_two_scale.leakage[:1], rtol=1e-4)
        assert_allclose(results[1].k2, rough_two_scale.k2[:1], rtol=1e-3, atol=1e-30)

    def test_the_scene_chooses_the_discretisation(self, rough, rough_two_scale):
        """With the same gaps other permeabilities, which differ as the pixels resolve the gap."""
        result = two_scale(replace(rough, discretisation="gauss"), (4, 6))
        assert_array_equal(result.gap, rough_two_scale.gap)
        gap = result.partition.cell(result.gap[0], 1, 5)
        exact = cell_permeability(gap, rough.surface.spacing, discretisation="gauss").value
        assert_allclose(result.k1[0, 1, 5], exact, rtol=1e-9)
        assert abs(result.k1[0, 1, 5] / rough_two_scale.k1[0, 1, 5] - 1) > 1e-3

    @pytest.mark.parametrize(
        "given",
        [{"solver": "magic"}, {"discretisation": "magic"}, {"solver": "elimination", "discretisation": "gauss"}],
    )
    def test_what_no_flow_can_take_is_refused_at_once(self, rough, given):
        with pytest.raises(InputError, match=r"solver|discretisation"):
            replace(rough, **given)

    def test_of_drawn_seals(self, rough):
        """Systems of the library, and for each realisation, as many resampled ones, and each step."""
        result = stochastic(rough, (4, 6), replace(SAMPLING, pressure="uniform", library_cells=8))
        seals = sum(result.solvers.by_solver().values()) - result.library.counts.solved
        assert seals == np.count_nonzero(result.leakage) + np.count_nonzero(result.leakage_resampled)


class TestFailures:
    """What cannot be solved is NaN and named; the rest goes on."""

    def fail(self, monkeypatch, module, name, *, calls=(), pressure=None):
        """Let a solver fail at the given calls, counted from 0, or under a given pressure of a window."""
        solve, count = getattr(module, name), iter(range(10**6))

        def failing(*args, **given):
            if next(count) in calls or (pressure is not None and given["pressure"] == pressure):
                raise NotConverged("did not converge", 1.0)
            return solve(*args, **given)

        monkeypatch.setattr(module, name, failing)

    def test_flow_of_a_piece(self, rough, monkeypatch):
        """5 steps along and 5 across of each of them: the third step across of the second one."""
        self.fail(monkeypatch, femseal.windows.window_flow, "cell_flow", calls={10 + 5 + 2})
        result = two_scale(rough, (4, 6))
        assert result.failures == ("piece (0, 1), x2, step 2: did not converge",)
        assert_array_equal(np.argwhere(np.isnan(result.k2)), [[2, 0, 1]])
        assert np.isfinite(result.k1).all()
        assert np.isfinite(result.leakage).all()

    def test_flow_of_the_whole_face(self, rough, monkeypatch):
        self.fail(monkeypatch, femseal.studies.face_flow, "cell_permeability", calls={3})
        result = two_scale(rough, (4, 6))
        assert result.failures == ("unloading 300 MPa from 600 MPa: did not converge",)
        for values in (result.leakage, result.drop_fraction[:, 0, 0]):
            assert_array_equal(np.isnan(values), [False, False, False, True, False])
        assert np.isfinite(result.k1).all()

    def test_a_cell_of_a_library_of_a_ladder_is_left_out(self, rough, monkeypatch):
        sampling = replace(SAMPLING, pressure="uniform", library_cells=8)
        whole = stochastic(rough, (4, 6), sampling).library
        counted = []
        solve = femseal.library.ladder.solve_contact

        def failing(gap0, *args, **given):
            if not counted or not np.array_equal(counted[-1], gap0):
                counted.append(gap0)
            if len(counted) == 3 and given["pressure"] > 1e8:
                raise NotConverged("did not converge", 1.0)
            return solve(gap0, *args, **given)

        monkeypatch.setattr(femseal.library.ladder, "solve_contact", failing)
        result = stochastic(rough, (4, 6), sampling)
        assert result.failures == ("cell 2: did not converge",)
        assert_array_equal(result.library.curves.k, np.delete(whole.curves.k, 2, axis=0))
        assert np.isfinite(result.leakage).all()

    def test_flow_through_a_seal(self, rough, monkeypatch):
        self.fail(monkeypatch, femseal.studies.scene, "seal_leakage", calls={5 + 1})
        result = stochastic(rough, (4, 6), replace(SAMPLING, realisations=3, sampler="block"))
        assert result.failures == ("realisation 1, loading 300 MPa: did not converge",)
        assert np.isfinite(result.leakage_resampled).all()
        assert_array_equal(np.argwhere(np.isnan(result.leakage)), [[1, 1]])

    def test_a_library_without_any_cell(self, rough, monkeypatch):
        self.fail(monkeypatch, femseal.library.ladder, "solve_contact", calls=range(10**6))
        with pytest.raises(FemsealError, match="every c"):
            stochastic(rough, (4, 6), replace(SAMPLING, pressure="uniform", library_cells=4))

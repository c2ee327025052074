"""The three chains from a face to leakage: closed forms, balances, symmetries, draws and failures."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import femseal.face.piece_flow
import femseal.studies.face_flow
import femseal.studies.scene
from femseal import analytic
from femseal.base.errors import FemsealError, InputError, NotConverged
from femseal.flow import cell_permeability
from femseal.fluids import IdealGas, Liquid
from femseal.loads import LoadProgramme
from femseal.report import write_folder
from femseal.results import assemble, open_results
from femseal.seal.pressure_map import Profile
from femseal.seal.tiles import face_tiles
from femseal.store.store import Store
from femseal.studies import Sampling, Scene, StochasticResult
from femseal.studies.drawn_study import stochastic
from femseal.studies.face_study import deterministic
from femseal.studies.piece_study import two_scale
from femseal.topography import Topography, self_affine

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
    return (
        permeability
        * (scene.inlet_pressure - scene.outlet_pressure)
        / (1e-3 * scene.surface.size[0])
    )


@pytest.fixture(scope="module")
def rough():
    """A face of 4 × 6 pieces under a cycle, with pixels and pieces that are not square."""
    face = self_affine((96, 96), (96e-6, 120e-6), hurst=0.8, rms_slope=0.2, roll_off=40e-6, rng=5)
    return make_scene(
        face.heights,
        face.spacing,
        loading=(1e8, 3e8, 6e8),
        unload_from=(6e8,),
        unloading=(3e8, 1e8),
        rtol=1e-8,
    )


@pytest.fixture(scope="module")
def rough_two_scale(rough):
    return two_scale(rough, (4, 6))


def piece_of(result, field, i, j):
    """A piece of a field over the face, by its row and column."""
    return result.pieces.cut.pieces(field)[i * result.pieces.cut.shape[1] + j].astype(float)


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
        # each column of pieces with an eighth of its neighbours: the mean of h³ over its width
        h3 = (scene.surface.heights.max() - scene.surface.heights[0]) ** 3
        means = [h3[np.arange(16 * n - 2, 16 * n + 18) % 64].mean() for n in range(4)]
        assert_allclose(result.k1[0], np.tile(np.array(means) / 12, (4, 1)), rtol=1e-5)

    def test_ridges_across_the_leakage_that_touch_seal(self):
        scene = make_scene(self.corrugated(0), loading=(0.0, 1e6))
        assert (deterministic(scene).leakage == 0).all()
        result = two_scale(scene, (4, 4))
        assert result.leakage[1] == 0
        # the ridge lies at the border of the first row of pieces
        assert (result.k1[1, 0] == 0).all()
        assert (result.k1[1, 1:3] > 0).all()
        assert np.isnan(result.pieces.drop_fraction[1]).all()

    @pytest.mark.parametrize("waves", [0, 8])
    def test_gaps_across_the_leakage_are_in_series_at_full_resolution(self, waves):
        """The same with a plateau in contact: no flow enters it."""
        n, w, a, gap = 128, 32, 1e-7, 4e-7
        wave = a * np.cos(2 * np.pi * waves * (np.arange(n) + 0.5) / n) if waves else np.zeros(n)
        heights = np.where(np.arange(n) < w, gap, wave[:, None])
        scene = make_scene(heights)
        k = analytic.wavy_gap_across(gap, a / gap) if waves else analytic.parallel_plates(gap)
        assert_allclose(
            deterministic(scene).leakage, leakage_of(0.75 * k, scene), rtol=2e-3 if waves else 1e-9
        )

    @pytest.mark.parametrize(("share", "expected"), [(0.1, 0.125386), (0.5, 3.534788e-3)])
    def test_elastic_wave_along_its_grooves(self, share, expected):
        """Westergaard's gap: ⟨g³⟩/(2Δ)³ falls from 5/16 to known values as p̄/p* grows."""
        n, half = 256, 2e-7
        heights = half * np.ones((16, 1)) * np.cos(2 * np.pi * (np.arange(n) + 0.5) / n)
        full = np.pi * MODULUS * half / (n * PIXEL)
        scene = make_scene(
            heights, hardness=np.inf, loading=(share * full,), boundary=("periodic", "periodic")
        )
        result = deterministic(scene)
        assert_allclose(
            result.leakage, leakage_of((2 * half) ** 3 / 12 * expected, scene), rtol=2e-2
        )
        assert_allclose(result.contact_fraction, 2 / np.pi * np.arcsin(np.sqrt(share)), atol=2 / n)
        assert result.plastic_fraction[0] == 0
        assert result.residual < 1e-5

    @pytest.mark.parametrize("boundary", [("free", "periodic"), ("mirror", "periodic")])
    def test_the_ends_of_a_flat_face_carry_more_if_they_are_free(self, boundary):
        """A punch, p = 2p̄/(π √(1 − ξ²)); a mirrored face has no ends."""
        scene = make_scene(np.zeros((64, 64)), hardness=np.inf, loading=(1e8,), boundary=boundary)
        share = (
            4 * np.diff(np.arcsin(np.linspace(-1, 1, 5))) / np.pi
            if boundary[0] == "free"
            else np.ones(4)
        )
        rows = two_scale(scene, (4, 4)).pieces.pressure[0].T
        assert_allclose(rows, np.tile(1e8 * share, (4, 1)), rtol=0.03)
        whole = deterministic(scene)
        assert (whole.contact_fraction[0], whole.leakage[0]) == (1, 0)

    def test_a_face_that_is_all_plastic_seals(self):
        scene = make_scene(
            self.corrugated(1), boundary=("periodic", "periodic"), hardness=1e9, loading=(1e9,)
        )
        result = deterministic(scene)
        assert (result.leakage[0], result.contact_fraction[0], result.mean_gap[0]) == (0, 1, 0)
        assert two_scale(scene, (4, 4)).leakage[0] == 0


class TestBalance:
    def test_gap_and_pressure_of_the_pieces_are_those_of_the_face(self, rough, rough_two_scale):
        result, pieces, cut = rough_two_scale, rough_two_scale.pieces, rough_two_scale.pieces.cut
        assert result.gap.shape == result.contact_pressure.shape == (5, 96, 96)
        for s in range(5):
            assert_allclose(cut.means(result.gap[s]), pieces.mean_gap[s], rtol=1e-6)
            pressure = cut.means(result.contact_pressure[s])
            assert_allclose(pressure, pieces.pressure[s], rtol=1e-5, atol=1e-3)
            closed = cut.means(result.gap[s] == 0)
            assert_allclose(
                closed, pieces.contact_fraction[s], atol=1 / 384
            )  # one point may touch without pressure
            at_hardness = cut.means(result.contact_pressure[s] >= HARDNESS * (1 - 1e-7))
            assert_allclose(at_hardness, pieces.plastic_fraction[s], atol=2 / 384)
        # the whole load, at every step
        assert_allclose(
            result.contact_pressure.mean(axis=(1, 2), dtype=float),
            [s.pressure for s in result.steps],
            rtol=1e-5,
        )
        for axis, k in ((0, result.k1), (1, result.k2)):
            piece = cut.widened(result.gap[0].astype(float), axis)[11]
            assert_allclose(
                k[0, 1, 5],
                cell_permeability(piece, rough.surface.spacing, axis=axis).value,
                rtol=1e-9,
            )
        counts = pieces.counts
        assert counts.flows == 5 * 2 * 4 * 6
        assert (
            counts.closed == np.count_nonzero(result.k1 == 0) + np.count_nonzero(result.k2 == 0) > 0
        )

    def test_the_drop_is_that_of_all_pieces(self, rough, rough_two_scale):
        """Fractions of all pieces are 1 together, and of the face as one piece."""
        result = rough_two_scale
        assert_allclose(result.pieces.drop_fraction.sum(axis=(1, 2)), 1, rtol=1e-9)
        one = two_scale(replace(rough, loading=(1e8,), unload_from=(), unloading=()), (1, 1))
        assert_allclose(one.pieces.drop_fraction, 1, rtol=1e-9)

    def test_drawn_seals_find_the_states_of_the_face_in_a_store(
        self, rough, rough_two_scale, tmp_path, contacts
    ):
        with Store(tmp_path) as store:
            result = two_scale(rough, (4, 6), mapper=store.over(map))
            assert_array_equal(result.k2, rough_two_scale.k2)
            assert len(contacts) == 5
            drawn = stochastic(rough, (4, 6), SAMPLING, mapper=store.over(map))
        assert len(contacts) == 5
        assert_array_equal(drawn.pieces.k2, result.k2)

    def test_gas(self, rough, rough_two_scale):
        """A gas without slip leaves permeabilities and fractions as they are; with it, each piece has its own factor."""
        gas = IdealGas(viscosity=2e-5, molar_mass=0.029, temperature=300.0, slip=False)
        scene = replace(rough, fluid=gas, inlet_pressure=5e6, outlet_pressure=1e5)
        result = two_scale(scene, (4, 6))
        assert_array_equal(result.k1, rough_two_scale.k1)
        assert_allclose(
            result.pieces.drop_fraction, rough_two_scale.pieces.drop_fraction, atol=1e-9
        )
        slips_scene = replace(scene, fluid=replace(gas, slip=True), inlet_pressure=3e5)
        slips = two_scale(slips_scene, (4, 6))
        piece = slips.pieces.cut.widened(result.gap[0].astype(float), 0)[1]
        law, pressures = replace(gas, slip=True).law, slips_scene.flow.drop.pressures
        each = [
            cell_permeability(piece, rough.surface.spacing, law=law, pressure=p).value
            for p in pressures
        ]
        assert_allclose(slips.pieces.k[:, 0, 0, 0, 1], each, rtol=1e-6)
        assert_allclose(slips.k1[0, 0, 1], np.mean(each), rtol=1e-6)
        assert_allclose(slips.pieces.drop_fraction.sum(axis=(1, 2)), 1, rtol=1e-9)

    def test_deterministic_leakage_is_that_of_its_gap(self, rough):
        result = deterministic(rough)
        k = [
            cell_permeability(g.astype(float), rough.surface.spacing, sides="periodic").value
            for g in result.gap
        ]
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
        face = self_affine(
            (n, n), (n * PIXEL, n * PIXEL), hurst=0.8, rms_slope=0.02, roll_off=30e-6, rng=2
        )
        x = np.arange(n) + 0.5
        heights = face.heights.copy()
        for a, b in np.random.default_rng(3).integers(0, n, (6, 2)):
            heights += 1e-6 * np.exp(-((x[:, None] - a) ** 2 + (x - b) ** 2) / 4.5)
        tall = Topography(heights, face.spacing).low_pass(8e-6)
        scene = make_scene(
            tall.heights, loading=(1e7, 5e7), unload_from=(5e7,), unloading=(1e7,), rtol=1e-6
        )
        return scene, deterministic(scene)

    def test_contact_is_that_of_the_whole_face(self, face):
        scene, whole = face
        result = two_scale(scene, (2, 2))
        assert result.warnings == ()
        assert_array_equal(result.gap, whole.gap)
        assert_array_equal(result.leakage, whole.leakage)
        assert_allclose(
            result.pieces.contact_fraction.mean(axis=(1, 2)), whole.contact_fraction, rtol=1e-12
        )
        assert_allclose(
            result.pieces.plastic_fraction.mean(axis=(1, 2)), whole.plastic_fraction, rtol=1e-12
        )
        assert_allclose(result.pieces.pressure.mean(axis=(1, 2)), scene.steps.pressures, rtol=1e-6)
        assert_allclose(result.contact_pressure.mean(axis=(1, 2)), scene.steps.pressures, rtol=1e-6)


class TestResolvedFlow:
    def test_results_have_maps_of_the_face(self, rough, tmp_path):
        """As those of a deterministic study, and the pieces."""
        study = two_scale(rough, (4, 6))
        results = assemble(rough, study)
        data, exact = results.dataset, assemble(rough, deterministic(rough)).dataset
        assert {"piece_k1", "piece_k2", "piece_drop_fraction"} <= set(data)
        for name, scale in (("gap", 1e-6), ("contact_pressure", 1e9), ("fluid_pressure", DROP)):
            assert_allclose(data[f"face_{name}"], exact[f"face_{name}"], atol=1e-4 * scale)
        assert_array_equal(results.piece(1, 2)["piece_pressure"], study.pieces.pressure[:, 1, 2])
        assert "pieces     4 × 6" in str(results)
        write_folder(results, tmp_path, rough.surface)
        assert "cut into 4 × 6 pieces" in (tmp_path / "report.html").read_text(encoding="utf-8")
        assert open_results(tmp_path).gap(1).shape == (96, 96)


class TestSymmetries:
    def test_pieces_may_be_counted_from_any_column(self, rough, rough_two_scale):
        turned = replace(
            rough,
            surface=Topography(
                np.roll(rough.surface.heights, 16, axis=1), rough.surface.spacing, (False, True)
            ),
        )
        result = two_scale(turned, (4, 6))
        assert_allclose(result.leakage, rough_two_scale.leakage, rtol=1e-5)
        is_open = rough_two_scale.k1 > 1e-4 * rough_two_scale.k1.max()
        assert_allclose(
            np.roll(result.k1, -1, axis=2)[is_open], rough_two_scale.k1[is_open], rtol=1e-3
        )
        shifted = np.roll(result.pieces.drop_fraction, -1, axis=2)
        assert_allclose(shifted, rough_two_scale.pieces.drop_fraction, atol=1e-3)

    @pytest.mark.parametrize("study", [deterministic, lambda scene: two_scale(scene, (4, 6))])
    def test_a_face_turned_about_leaks_the_other_way(self, rough, study):
        turned = replace(
            rough, surface=rough.surface.flip(0), inlet_pressure=0.0, outlet_pressure=DROP
        )
        forth, back = study(rough), study(turned)
        assert_allclose(back.leakage, -forth.leakage, rtol=1e-5)
        if hasattr(forth, "fluid_pressure"):
            assert_allclose(back.fluid_pressure[:, ::-1], forth.fluid_pressure, atol=1e-3 * DROP)

    def test_units_of_length_cancel(self, rough, rough_two_scale):
        """A face twice as large in all directions, under the same pressures, has twice the gap and eight times k."""
        d1, d2 = rough.surface.spacing
        large = replace(
            rough, surface=Topography(2 * rough.surface.heights, (2 * d1, 2 * d2), (False, True))
        )
        result = two_scale(large, (4, 6))
        assert_allclose(result.leakage, 4 * rough_two_scale.leakage, rtol=1e-4)  # k Δp/(η L1)
        assert_allclose(result.mean_gap, 2 * rough_two_scale.mean_gap, rtol=1e-4)
        one = stochastic(rough, (4, 6), SAMPLING)
        two = stochastic(large, (4, 6), replace(SAMPLING, length=2 * SAMPLING.length))
        assert_allclose(two.leakage, 4 * one.leakage, rtol=1e-3)


SAMPLING = Sampling(length=120e-6, realisations=6, seed=3)


@pytest.fixture(scope="module")
def columns():
    """Six equal columns of pieces, the rows of each different, as a face turned on a lathe with no error."""
    face = self_affine((96, 16), (96e-6, 20e-6), hurst=0.8, rms_slope=0.15, roll_off=20e-6, rng=4)
    heights = np.tile(face.heights, (1, 6))
    return make_scene(
        heights, face.spacing, loading=(1e8, 3e8), unload_from=(3e8,), unloading=(1e8,), rtol=1e-8
    )


class TestDraws:
    @pytest.mark.parametrize(("length", "count"), [(20e-6, 1), (120e-6, 6), (312e-6, 16)])
    def test_equal_columns_leave_nothing_to_chance(self, columns, length, count):
        """Every seal is the face itself, in whole pieces of 20 µm, without a band."""
        result = stochastic(columns, (4, 6), replace(SAMPLING, length=length))
        assert_allclose(result.leakage, np.tile(deterministic(columns).leakage, (6, 1)), rtol=1e-4)
        assert_allclose(result.quantile(0.95), result.quantile(0.05), rtol=1e-4)
        assert_allclose(result.tiles.size, (96e-6, count * 20e-6))
        assert result.tiles.grid == (4, count)

    def test_equal_pieces_are_one_piece_in_contact_with_itself(self):
        """Every piece the same, going on periodically: rows in series, in the rows of the face and in more of them."""
        piece = self_affine(
            (32, 32), (32e-6, 32e-6), hurst=0.8, rms_slope=0.15, roll_off=15e-6, cut_off=8e-6, rng=1
        )
        scene = make_scene(
            np.tile(piece.heights, (2, 3)),
            boundary=("periodic", "periodic"),
            loading=(1.32e8, 2.4e8, 4e8),
            unload_from=(2.4e8, 4e8),
            unloading=(2e8, 1e8, 6e7),
            rtol=1e-8,
        )
        expected = deterministic(scene).leakage
        for breadth, rows in ((None, 2), (320e-6, 10)):
            result = stochastic(scene, (2, 3), replace(SAMPLING, length=2e-4, breadth=breadth))
            assert result.tiles.grid[0] == rows
            assert_allclose(result.leakage, np.tile(2 / rows * expected, (6, 1)), rtol=2e-4)

    def test_seals_in_place_draw_the_pieces_of_two_scales(self, rough, rough_two_scale):
        pieces, parts = stochastic(rough, (4, 6), SAMPLING).pieces, rough_two_scale.pieces
        for name in ("k", "pressure", "mean_gap", "contact_fraction", "face", "own"):
            assert_array_equal(getattr(pieces, name), getattr(parts, name), err_msg=name)

    @pytest.mark.parametrize(
        "given", [{}, {"breadth": 288e-6}, {"breadth": 96e-6, "pressure_map": Profile((0.8, 1.2))}]
    )
    def test_the_order_of_the_work_does_not_matter(self, rough, given):
        def backwards(function, *lists):
            tasks = list(zip(*(list(x) for x in lists), strict=False))
            return [function(*task) for task in reversed(tasks)][::-1]

        one, other = (
            stochastic(rough, (4, 6), replace(SAMPLING, **given), mapper=m)
            for m in (map, backwards)
        )
        assert_array_equal(one.leakage, other.leakage)
        if not given:
            two = two_scale(rough, (4, 6), mapper=backwards)
            assert_array_equal(two.leakage, two_scale(rough, (4, 6)).leakage)

    def test_long_seals_scatter_less_about_the_same_median(self, rough):
        """Leakage per length of parallel pieces: the median stays, the band narrows as 1/√length."""
        loaded = replace(rough, unload_from=(), unloading=())
        sampling = replace(SAMPLING, realisations=60)
        short, long = (
            stochastic(loaded, (4, 6), replace(sampling, length=n * 120e-6)) for n in (1, 16)
        )
        medians = np.array([r.quantile(0.5)[:2] for r in (short, long)])
        bands = np.array([np.log(r.quantile(0.9) / r.quantile(0.1))[:2] for r in (short, long)])
        assert (np.abs(np.log(medians[1] / medians[0])) < bands[0]).all()
        assert (bands[1] < bands[0] / 2).all()
        assert (bands[1] > bands[0] / 8).all()

    def test_a_realisation_is_the_flow_through_its_drawn_tiles(self, rough):
        """Each tile takes a piece of its own row; the seal leaks over the face what it leaks over its pieces in order."""
        result = stochastic(rough, (4, 6), replace(SAMPLING, seed=8))
        tiles, pieces = result.tiles, result.pieces
        own = face_tiles(rough.surface.size, (4, 6))

        def leakage(of, k):
            return rough.leakage(of.seal, of.permeability(k[0], k[1])).per_length

        for r in range(2):
            rng = np.random.default_rng(np.random.SeedSequence(8, spawn_key=(r,)))
            drawn = tiles.draw((4, 6), rng)
            assert_array_equal(
                drawn.reshape(tiles.grid) // 6, np.arange(4)[:, None] * np.ones((1, 6), int)
            )
            for s in range(5):
                k = pieces.k[0, :, s].reshape(2, -1)
                assert_allclose(leakage(own, k), pieces.own[s], rtol=1e-6)
                ratio = leakage(tiles, k[:, drawn]) / pieces.own[s]
                assert_allclose(
                    result.leakage[r, s], pieces.face[s] * np.clip(ratio, 0.5, 2), rtol=1e-6
                )

    def test_a_narrow_surface_is_one_row_of_pieces(self, rough):
        strip = Topography(rough.surface.heights[:24], rough.surface.spacing, (False, True))
        for breadth in (None, 48e-6):
            result = stochastic(
                replace(rough, surface=strip), (1, 6), replace(SAMPLING, breadth=breadth)
            )
            assert result.failures == ()
            assert result.pieces.cut.shape == (1, 6)
            assert (result.leakage > 0).all()

    def test_the_drawn_seal_leaks_about_as_much_as_its_surface(self, rough, rough_two_scale):
        """Where no constriction decides; as long as the surface, so that both have as many pieces."""
        result = stochastic(rough, (4, 6), replace(SAMPLING, realisations=40))
        assert 0.7 < result.quantile(0.5)[0] / rough_two_scale.leakage[0] < 1.4


class TestFewRealisations:
    steps = LoadProgramme.of((1e8,))

    def test_quantiles_that_cannot_be_trusted(self):
        few, enough = (drawn_result(self.steps, np.ones((n, 1))) for n in (10, 20))
        assert "at least 1000 needed" in few.unsupported(0.001)[0]
        assert (
            few.too_few(0.05, 0.95)
            == "quantile 0.05 and 0.95 of 10 realisations: at least 20 needed"
        )
        assert enough.unsupported(0.05) == ()

    def test_realisations_scatter_as_their_logarithms(self):
        sigma = 0.3
        leakage = np.exp(sigma * np.random.default_rng(4).standard_normal((4000, 1)))
        assert_allclose(drawn_result(self.steps, leakage).realisation_spread, sigma, rtol=0.05)


def drawn_result(steps, leakage):
    """A result of which only the leakage is looked at."""
    return StochasticResult(
        steps, face_tiles((1.0, 1.0), (1, 1)), None, np.zeros(len(steps)), np.array(leakage, float)
    )


class TestStatistics:
    steps = LoadProgramme.of((1e8, 2e8))

    def result(self, leakage):
        return drawn_result(self.steps, leakage)

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
        counts, solvers = rough_two_scale.pieces.counts, rough_two_scale.solvers
        assert sum(counts.solvers.by_solver().values()) == counts.solved
        assert sum(solvers.by_solver().values()) == counts.solved + 5
        assert 0 < solvers.worst_imbalance < 1e-2

    @pytest.mark.parametrize("solver", ["elimination", "amg"])
    def test_the_scene_chooses_the_solver(self, rough, rough_two_scale, solver):
        chosen = replace(rough, solver=solver, loading=(1e8,), unload_from=(), unloading=())
        sampling = replace(SAMPLING, breadth=192e-6, realisations=2)
        results = deterministic(chosen), two_scale(chosen, (4, 6))
        drawn = stochastic(chosen, (4, 6), sampling)
        for counts in (*(result.solvers for result in results), drawn.pieces.counts.solvers):
            assert {*counts.by_solver()} == {solver}
        # elimination is of grids: a mesh has its direct solver
        assert {*drawn.solvers.by_solver()} == {solver, "amg" if solver == "amg" else "direct"}
        assert_allclose(results[1].leakage, rough_two_scale.leakage[:1], rtol=1e-4)
        assert_allclose(results[1].k2, rough_two_scale.k2[:1], rtol=1e-3, atol=1e-30)

    def test_what_no_flow_can_take_is_refused_at_once(self, rough):
        with pytest.raises(InputError, match="solver"):
            replace(rough, solver="magic")

    def test_of_drawn_seals(self, rough):
        """Systems of the pieces, and for each realisation and each step."""
        for breadth in (None, 192e-6):
            result = stochastic(rough, (4, 6), replace(SAMPLING, breadth=breadth))
            seals = sum(result.solvers.by_solver().values()) - sum(
                result.pieces.counts.solvers.by_solver().values()
            )
            assert seals == np.count_nonzero(result.leakage)


class TestFailures:
    """What cannot be solved is NaN and named; the rest goes on."""

    def fail(self, monkeypatch, module, name, *, calls=(), pressure=None):
        """Let a solver fail at the given calls, counted from 0, or under a given pressure."""
        solve, count = getattr(module, name), iter(range(10**6))

        def failing(*args, **given):
            if next(count) in calls or (pressure is not None and given["pressure"] == pressure):
                raise NotConverged("did not converge", 1.0)
            return solve(*args, **given)

        monkeypatch.setattr(module, name, failing)

    def test_flow_of_a_piece(self, rough, monkeypatch):
        """In each of 5 steps 24 pieces along and 24 across: the third step across, the second piece."""
        self.fail(monkeypatch, femseal.face.piece_flow, "cell_flow", calls={2 * 48 + 24 + 1})
        result = two_scale(rough, (4, 6))
        assert result.failures == ("loading 600 MPa, piece (0, 1), x2: did not converge",)
        assert_array_equal(np.argwhere(np.isnan(result.k2)), [[2, 0, 1]])
        assert np.isfinite(result.k1).all()
        assert np.isfinite(result.leakage).all()

    def test_flow_of_the_whole_face(self, rough, monkeypatch):
        self.fail(monkeypatch, femseal.studies.face_flow, "cell_permeability", calls={3})
        result = two_scale(rough, (4, 6))
        assert result.failures == ("unloading 300 MPa from 600 MPa: did not converge",)
        for values in (result.leakage, result.pieces.drop_fraction[:, 0, 0]):
            assert_array_equal(np.isnan(values), [False, False, False, True, False])
        assert np.isfinite(result.k1).all()

    def test_flow_of_a_piece_of_a_seal(self, rough, monkeypatch):
        """The state is not drawn from; the others are."""
        self.fail(monkeypatch, femseal.face.piece_flow, "cell_flow", calls={48 + 3})
        result = stochastic(rough, (4, 6), SAMPLING)
        assert result.failures == ("loading 300 MPa, piece (0, 3), x1: did not converge",)
        assert_array_equal(
            np.isnan(result.leakage), np.tile([False, True, False, False, False], (6, 1))
        )

    def test_flow_through_a_seal(self, rough, monkeypatch):
        whole = stochastic(rough, (4, 6), replace(SAMPLING, realisations=3))
        # first the face, the pieces in their own order, and the unit
        self.fail(monkeypatch, femseal.studies.scene, "seal_leakage", calls={5 + 5 + 1 + 5 + 1})
        result = stochastic(rough, (4, 6), replace(SAMPLING, realisations=3))
        assert result.failures == ("realisation 1, loading 300 MPa: did not converge",)
        assert_array_equal(np.argwhere(np.isnan(result.leakage)), [[1, 1]])
        known = np.isfinite(result.leakage)
        assert_allclose(result.leakage[known], whole.leakage[known], rtol=1e-6)
        assert result.median_seal.realisation != 1

    def test_a_contact_that_fails_is_a_fault(self, rough, monkeypatch):
        self.fail(monkeypatch, femseal.studies.scene, "solve_contact", pressure=3e8)
        for breadth in (None, 192e-6):
            with pytest.raises(NotConverged):
                stochastic(rough, (4, 6), replace(SAMPLING, breadth=breadth))

    def test_a_face_without_any_piece(self, rough, monkeypatch):
        self.fail(monkeypatch, femseal.face.piece_flow, "cell_flow", calls=range(10**6))
        with pytest.raises(FemsealError, match="every flow failed"):
            stochastic(rough, (4, 6), replace(SAMPLING, breadth=192e-6))

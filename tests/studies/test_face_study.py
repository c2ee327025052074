"""The three chains from a face to leakage: closed forms, balances, symmetries, draws and failures."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import steel_scene

import femseal.face.cell_flow
import femseal.face.cells
import femseal.scene.scene
from femseal import analytic
from femseal.base import FemsealError, InputError, NotConverged
from femseal.flow import cell_permeability
from femseal.flow.cell import cell_stencil
from femseal.flow.law import checked_equivalent_gap
from femseal.gases import IdealGas
from femseal.loads import LoadProgramme
from femseal.seal.tiles import face_tiles
from femseal.studies import Sampling, StochasticResult, deterministic, stochastic, two_scale
from femseal.topography import Topography, self_affine

MODULUS, HARDNESS = 115e9, 3e9
DROP = 1e6
PIXEL = 1e-6


def make_scene(heights, spacing=(PIXEL, PIXEL), **given):
    """A dry scene of a face without a load."""
    surface = Topography(heights, spacing, (False, True))
    return steel_scene(surface, **{"loading": (0.0,), "modulus": MODULUS} | given)


def leakage_of(permeability, scene):
    """Q/L2 = k Δp/(η L1) of a uniform seal of water."""
    return permeability * DROP / (1e-3 * scene.surface.size[0])


@pytest.fixture(scope="module")
def rough():
    """A face of 4 × 6 cells under a cycle, with pixels and cells that are not square."""
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


def corrugated(axis, n=64, amplitude=1e-7):
    """Ridges a cos(2πx/L) with a crest on a pixel, constant along the other axis."""
    wave = amplitude * np.cos(2 * np.pi * np.arange(n) / n)
    return np.repeat(wave[:, None], n, axis=1) if axis == 0 else np.tile(wave, (n, 1))


def test_channels_along_the_leakage_are_in_parallel():
    """At no load a face is as rigid: h = a(1 − cos), ⟨h³⟩ = 5/2 a³, and the mean over 64 points is exact."""
    a = 1e-7
    scene = make_scene(corrugated(1, amplitude=a))
    expected = leakage_of(2.5 * a**3 / 12, scene)
    result = two_scale(scene, (4, 4))
    assert_allclose(deterministic(scene).leakage, expected, rtol=1e-9)
    assert_allclose(result.leakage, expected, rtol=1e-9)
    # each column of cells: the mean of h³ over its own width, without the overlap
    h3 = (scene.surface.heights.max() - scene.surface.heights[0]) ** 3
    means = h3.reshape(4, 16).mean(axis=1)
    assert_allclose(result.k1[0], np.tile(means / 12, (4, 1)), rtol=1e-6)


def test_ridges_across_the_leakage_that_touch_seal():
    scene = make_scene(corrugated(0), loading=(0.0, 1e6))
    assert not deterministic(scene).leakage.any()
    result = two_scale(scene, (4, 4))
    # the ridge lies at the border of the first row of cells
    assert not result.k1[1, 0].any()
    assert (result.k1[1, 1:3] > 0).all()
    assert np.isnan(result.cells.drop_fraction[1]).all()


@pytest.mark.parametrize("waves", [0, 8])
def test_gaps_across_the_leakage_are_in_series_at_full_resolution(waves):
    """The same with a plateau in contact: no flow enters it."""
    n, w, a, gap = 128, 32, 1e-7, 4e-7
    wave = a * np.cos(2 * np.pi * waves * (np.arange(n) + 0.5) / n) * (waves > 0)
    scene = make_scene(np.where(np.arange(n) < w, gap, wave[:, None]))
    k = analytic.wavy_gap_across(gap, a / gap) if waves else analytic.parallel_plates(gap)
    found = deterministic(scene).leakage
    assert_allclose(found, leakage_of(0.75 * k, scene), rtol=2e-3 if waves else 1e-9)


@pytest.mark.parametrize("boundary", [("free", "periodic"), ("mirror", "periodic")])
def test_the_ends_of_a_flat_face_carry_more_if_they_are_free(boundary):
    """A punch, p = 2p̄/(π √(1 − ξ²)); a mirrored face has no ends."""
    scene = make_scene(np.zeros((64, 64)), hardness=np.inf, loading=(1e8,), boundary=boundary)
    punch = 4 * np.diff(np.arcsin(np.linspace(-1, 1, 5))) / np.pi
    share = punch if boundary[0] == "free" else np.ones(4)
    result = two_scale(scene, (4, 4))
    assert_allclose(result.cells.pressure[0].T, np.tile(1e8 * share, (4, 1)), rtol=0.03)
    assert (result.contact_fraction[0], result.leakage[0]) == (1, 0)


def test_a_face_that_is_all_plastic_seals():
    every = {"boundary": ("periodic", "periodic"), "hardness": 1e9, "loading": (1e9,)}
    scene = make_scene(corrugated(1), **every)
    for result in (deterministic(scene), two_scale(scene, (4, 4))):
        assert (result.leakage[0], result.contact_fraction[0], result.mean_gap[0]) == (0, 1, 0)


def core_permeability(cell, spacing, axis=0, **fluid):
    """Permeability of the core of a cell with overlaps, from the fluxes of its links by another sum."""
    gap = checked_equivalent_gap(cell.field, **fluid) if fluid else cell.field
    pressure = cell_permeability(gap, spacing, axis=axis, solver="elimination").fluid_pressure
    if axis == 1:
        gap, pressure, spacing = gap.T, pressure.T, spacing[::-1]
    ends = np.ones((1, gap.shape[1])), np.zeros((1, gap.shape[1]))
    drop = -np.diff(np.concatenate([ends[0], np.nan_to_num(pressure), ends[1]]), axis=0)
    lengths = np.r_[0.5, np.ones(len(gap) - 1), 0.5] * spacing[0]
    flux = lengths @ (cell_stencil(np.ascontiguousarray(gap), spacing, "mirror").along * drop)
    first, end = cell.core
    return flux[first:end].sum() / ((end - first) * spacing[1])


def test_gap_and_pressure_of_the_cells_are_those_of_the_face(rough, rough_two_scale):
    result, cells, cut = rough_two_scale, rough_two_scale.cells, rough_two_scale.cells.cut
    pressure = result.contact_pressure
    for s in range(5):
        assert_allclose(cut.means(result.gap[s]), cells.mean_gap[s], rtol=1e-6)
        assert_allclose(cut.means(pressure[s]), cells.pressure[s], rtol=1e-5, atol=1e-3)
        # one point may touch without pressure
        assert_allclose(cut.means(result.gap[s] == 0), cells.contact_fraction[s], atol=1 / 384)
        at_hardness = cut.means(pressure[s] >= HARDNESS * (1 - 1e-7))
        assert_allclose(at_hardness, cells.plastic_fraction[s], atol=2 / 384)
    # the whole load, at every step
    assert_allclose(pressure.mean(axis=(1, 2), dtype=float), rough.steps.pressures, rtol=1e-5)
    assert_allclose(cells.drop_fraction.sum(axis=(1, 2)), 1, rtol=1e-9)
    gap, spacing = result.gap[0].astype(float), rough.surface.spacing
    for axis, k in ((0, result.k1), (1, result.k2)):
        exact = core_permeability(cut.split_with_overlaps(gap, axis)[11], spacing, axis)
        assert_allclose(k[0, 1, 5], exact, rtol=1e-5)


def test_gas(rough, rough_two_scale):
    """A gas without slip leaves permeabilities and fractions as they are; with it, each cell has its own factor."""
    gas = IdealGas(viscosity=2e-5, molar_mass=0.029, temperature=300.0, slip=False)
    scene = replace(rough, fluid=gas, inlet_pressure=5e6, outlet_pressure=1e5)
    fractions = rough_two_scale.cells.drop_fraction
    result = two_scale(scene, (4, 6))
    assert_array_equal(result.k1, rough_two_scale.k1)
    assert_allclose(result.cells.drop_fraction, fractions, atol=1e-9)
    scene = replace(scene, fluid=replace(gas, slip=True), inlet_pressure=3e5)
    slips, spacing = two_scale(scene, (4, 6)), rough.surface.spacing
    cell = slips.cells.cut.split_with_overlaps(result.gap[0].astype(float), 0)[1]
    each = [
        core_permeability(cell, spacing, law=scene.fluid.law, pressure=p)
        for p in scene.flow.drop.pressures
    ]
    assert_allclose(slips.cells.k[:, 0, 0, 0, 1], each, rtol=1e-5)
    assert_allclose(slips.k1[0, 0, 1], np.mean(each), rtol=1e-5)


def test_deterministic_leakage_is_that_of_its_gap(rough):
    result, spacing = deterministic(rough), rough.surface.spacing
    gaps = result.gap.astype(float)
    k = [cell_permeability(g, spacing, sides="periodic").value for g in gaps]
    assert_allclose(result.leakage, leakage_of(np.array(k), rough), rtol=1e-4)
    assert_allclose(result.mean_gap, gaps.mean(axis=(1, 2)), rtol=1e-6)
    assert_allclose(result.contact_fraction, (result.gap == 0).mean(axis=(1, 2)))
    assert result.residual <= rough.rtol


@pytest.mark.parametrize("study", [deterministic, lambda scene: two_scale(scene, (4, 6))])
def test_a_face_turned_about_leaks_the_other_way(rough, study):
    ends = {"inlet_pressure": 0.0, "outlet_pressure": DROP}
    forth, back = study(rough), study(replace(rough, surface=rough.surface.flip(0), **ends))
    assert_allclose(back.leakage, -forth.leakage, rtol=1e-5)
    assert_allclose(back.fluid_pressure[:, ::-1], forth.fluid_pressure, atol=1e-3 * DROP)


SAMPLING = Sampling(length=120e-6, realisations=6, seed=3)


def test_a_realisation_is_the_flow_through_its_drawn_tiles(rough, rough_two_scale):
    """Each tile takes a cell of its own row; the seal leaks over the face what it leaks over its cells in order."""
    result = stochastic(rough, (4, 6), replace(SAMPLING, seed=8))
    tiles, cells = result.tiles, result.cells
    own = face_tiles(rough.surface.size, (4, 6))
    for name in (
        "k",
        "pressure",
        "mean_gap",
        "contact_fraction",
        "surface_leakage",
        "cells_leakage",
    ):
        assert_array_equal(getattr(cells, name), getattr(rough_two_scale.cells, name))

    def leakage(of, k):
        return rough.leakage(of.seal, of.permeability(k[0], k[1])).per_length

    for r in range(2):
        rng = np.random.default_rng(np.random.SeedSequence(8, spawn_key=(r,)))
        drawn = tiles.choose_cells((4, 6), rng)
        for s in range(5):
            k = cells.k[0, :, s].reshape(2, -1)
            assert_allclose(leakage(own, k), cells.cells_leakage[s], rtol=1e-6)
            ratio = np.clip(leakage(tiles, k[:, drawn]) / cells.cells_leakage[s], 0.5, 2)
            assert_allclose(result.leakage[r, s], cells.surface_leakage[s] * ratio, rtol=1e-6)


def drawn_result(leakage):
    """A result of which only the leakage is looked at."""
    leakage = np.array(leakage, float)
    steps = LoadProgramme.of(tuple(1e8 * np.arange(1.0, 1 + leakage.shape[1])))
    tiles = face_tiles((1.0, 1.0), (1, 1))
    return StochasticResult(steps, tiles, None, np.zeros(len(steps)), leakage)


def test_quantiles_that_cannot_be_trusted():
    few, enough = (drawn_result(np.ones((n, 1))) for n in (10, 20))
    assert few.has_too_few_for(0.001)
    assert few.has_too_few_for(0.05, 0.95)
    assert not enough.has_too_few_for(0.05)
    leakage = np.exp(0.3 * np.random.default_rng(4).standard_normal((4000, 1)))
    assert_allclose(drawn_result(leakage).realisation_spread, 0.3, rtol=0.05)


@pytest.mark.parametrize(
    ("leakage", "quantiles", "mean", "sealed"),
    [
        # between realisations in log space
        (
            [[1, 5], [100, 5], [10_000, 5]],
            {0: [1, 5], 0.25: [10, 5], 0.5: [100, 5], 0.95: [10 ** (4 - 0.2), 5], 1: [10_000, 5]},
            [10_101 / 3, 5],
            [0, 0],
        ),
        # next to a sealed one the quantile is 0, between 0 and 4 as well
        (
            [[0, 0], [0, 1], [4, 1], [0, 1]],
            {0.5: [0, 1], 0.9: [0, 1], 1.0: [4, 1]},
            [1, 0.75],
            [0.75, 0.25],
        ),
        # failed ones are left out
        (
            [[np.nan, np.nan], [0, np.nan], [4, np.nan], [9, np.nan]],
            {0.75: [6, np.nan], 0.5: [4, np.nan]},
            [13 / 3, np.nan],
            [1 / 3, np.nan],
        ),
        # towards the inlet
        ([[-1, -4], [-100, 4]], {0.5: [-10, 0]}, [-50.5, 0], [0, 0]),
    ],
)
def test_statistics(leakage, quantiles, mean, sealed):
    result = drawn_result(leakage)
    for q, expected in quantiles.items():
        assert_allclose(result.quantile(q), expected)
    assert_allclose(result.mean, mean)
    assert_allclose(result.sealed_fraction, sealed)


@pytest.mark.parametrize("solver", ["elimination", "amg"])
def test_the_scene_chooses_the_solver(rough, rough_two_scale, solver):
    """In cells, of the whole surface and over the tiles of a strip."""
    chosen = replace(rough, solver=solver, loading=(1e8,), unload_from=(), unloading=())
    whole, cells = deterministic(chosen), two_scale(chosen, (4, 6))
    drawn = stochastic(chosen, (4, 6), replace(SAMPLING, breadth=192e-6, realisations=2))
    for counts in (whole.solve_counts, cells.solve_counts, drawn.cells.solve_counts):
        assert {name for name, _ in counts.systems} == {solver}
    assert {name for name, _ in drawn.solve_counts.systems} == {solver}
    assert_allclose(cells.leakage, rough_two_scale.leakage[:1], rtol=1e-4)
    assert_allclose(cells.k2, rough_two_scale.k2[:1], rtol=1e-3, atol=1e-30)
    with pytest.raises(InputError, match="solver"):
        replace(rough, solver="magic")


@pytest.fixture
def failing(monkeypatch):
    """Let a function fail at the given calls, counted from 0, or under a given pressure."""

    def fail(module, name, *, calls=(), pressure=None):
        solve, count = getattr(module, name), iter(range(10**6))

        def failing(*args, **given):
            if next(count) in calls or (pressure is not None and given["pressure"] == pressure):
                raise NotConverged("did not converge", 1.0)
            return solve(*args, **given)

        monkeypatch.setattr(module, name, failing)

    return fail


def test_a_flow_of_a_cell_that_fails_is_named(rough, failing):
    """In each of 5 steps 24 cells along and 24 across: the third step across, the second cell."""
    failing(femseal.face.cells, "cell_permeabilities", calls={2 * 48 + 24 + 1})
    result = two_scale(rough, (4, 6))
    assert result.failures == ("loading 600 MPa, cell (0, 1), x2: did not converge",)
    assert_array_equal(np.argwhere(np.isnan(result.k2)), [[2, 0, 1]])
    assert np.isfinite(result.k1).all()
    assert np.isfinite(result.leakage).all()


def test_a_flow_of_the_whole_face_that_fails_is_named(rough, failing):
    failing(femseal.face.cell_flow, "cell_permeability", calls={3})
    result = two_scale(rough, (4, 6))
    assert result.failures == ("unloading 300 MPa from 600 MPa: did not converge",)
    for values in (result.leakage, result.cells.drop_fraction[:, 0, 0]):
        assert_array_equal(np.isnan(values), [False, False, False, True, False])
    assert np.isfinite(result.k1).all()


def test_a_state_of_which_a_cell_failed_is_not_drawn_from(rough, failing):
    failing(femseal.face.cells, "cell_permeabilities", calls={48 + 3})
    result = stochastic(rough, (4, 6), SAMPLING)
    assert result.failures == ("loading 300 MPa, cell (0, 3), x1: did not converge",)
    assert_array_equal(np.isnan(result.leakage), np.tile(np.arange(5) == 1, (6, 1)))


def test_a_flow_through_a_seal_that_fails_is_named(rough, failing):
    # first the cells in their own order, then the open seal
    failing(femseal.scene.scene, "seal_leakage", calls={5 + 1 + 5 + 1})
    result = stochastic(rough, (4, 6), replace(SAMPLING, realisations=3))
    assert result.failures == ("realisation 1, loading 300 MPa: did not converge",)
    assert_array_equal(np.argwhere(np.isnan(result.leakage)), [[1, 1]])
    assert result.median_seal.realisation != 1


def test_a_contact_that_fails_is_a_fault(rough, failing):
    failing(femseal.scene.scene, "solve_contact", pressure=3e8)
    with pytest.raises(NotConverged):
        stochastic(rough, (4, 6), SAMPLING)


def test_a_face_without_any_cell_is_a_fault(rough, failing):
    failing(femseal.face.cells, "cell_permeabilities", calls=range(10**6))
    with pytest.raises(FemsealError, match="flow solver failed for every cell"):
        stochastic(rough, (4, 6), replace(SAMPLING, breadth=192e-6))

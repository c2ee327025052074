"""Runs of columns of a face: their bounds against the network cut by hand, closed forms, and seals drawn from them."""

from dataclasses import replace

import numpy as np
import pytest
from femseal.library import ColumnRuns, RunFlows
from femseal.studies.run_chains import StateRuns, chained_seals
from networks import cell_links, solve_links
from numpy.testing import assert_allclose, assert_array_equal

from femseal import Liquid, Sampling, Scene, self_affine, stochastic, two_scale
from femseal.base.errors import InputError
from femseal.case.case import parse_case
from femseal.flow import cell_permeability
from femseal.results.dataset import assemble
from femseal.studies import chosen_sampler, window_supply
from femseal.windows import Partition, SolverCounts

PIXEL = (1e-6, 1e-6)


@pytest.fixture(scope="module")
def gap():
    """A rough gap of 64 × 96 pixels with a tenth of it in contact."""
    heights = self_affine(
        (64, 96), (64e-6, 96e-6), hurst=0.8, rms_slope=0.2, roll_off=40e-6, cut_off=8e-6, rng=3
    ).heights
    return np.maximum(np.quantile(heights, 0.9) - heights, 0.0)


@pytest.fixture(scope="module")
def cells():
    return Partition((64, 96), PIXEL, (4, 6))


class TestRuns:
    @pytest.mark.parametrize("length", [1, 2, 5, 6])
    def test_closed_cuts_are_those_of_the_network(self, gap, cells, length):
        c1, c2 = cell_links(gap, PIXEL, "periodic")
        runs, expected = ColumnRuns.of(gap, cells, node_spacing=1).flows(length), []
        assert runs.independent == 6 // length
        assert len(runs.starts) == min(6, 2 * runs.independent)
        for start in runs.starts:
            columns = np.arange(16 * start, 16 * (start + length)) % 96
            expected.append(solve_links(c1[:, columns], c2[:, columns[:-1]], solver="elimination").conductance)
        assert_allclose(runs.neumann, expected, rtol=1e-9)

    def test_the_uncut_face_lies_between_the_bounds(self, gap, cells):
        whole = ColumnRuns.of(gap, cells).face.conductance
        apart = []
        for length in (1, 2, 3, 6):
            runs = ColumnRuns.of(gap, cells).flows(length)
            assert_allclose(runs.whole, whole * length / 6, rtol=1e-12)
            assert runs.neumann.mean() < runs.whole < runs.dirichlet.mean()
            assert np.all(runs.neumann <= runs.dirichlet)
            assert_allclose(runs.value.mean(), runs.whole, rtol=1e-12)
            apart.append(np.log(runs.dirichlet.mean() / runs.neumann.mean()))
        assert np.all(np.diff(apart) < 0)
        assert apart[-1] < 0.3 * apart[0]

    @pytest.mark.parametrize("length", [1, 4])
    def test_cuts_along_the_flow_through_a_gap_that_varies_across_it_alone_cost_nothing(self, cells, length):
        h = 1e-6 * (2 + np.sin(2 * np.pi * (np.arange(64) + 0.5) / 64))[:, None] * np.ones(96)
        runs = ColumnRuns.of(h, cells).flows(length)
        expected = cell_permeability(h, PIXEL, sides="periodic").value * 96 / 64 * length / 6
        for found in (runs.neumann, runs.dirichlet, runs.value):
            assert_allclose(found, expected, rtol=1e-9)

    def test_a_closed_face_has_closed_runs(self, gap, cells):
        h = gap.copy()
        h[11] = 0.0
        runs = ColumnRuns.of(h, cells).flows(2)
        assert not np.any([runs.neumann, runs.dirichlet, runs.value])
        assert runs.weight == 0

    def test_windows_are_those_of_the_network(self, gap, cells):
        h = gap.copy()
        h[20, 32:48] = 0.0  # a row of the window (1, 2)
        c1, c2 = cell_links(h, PIXEL, "periodic")
        expected = np.zeros((4, 6))
        for i, j in cells.places:
            rows, columns = slice(16 * i, 16 * i + 17), slice(16 * j, 16 * j + 16)
            along = c1[rows, columns].copy()
            # a link to another window is cut into halves
            along[0] *= 1 + (i > 0)
            along[-1] *= 1 + (i < 3)
            expected[i, j] = solve_links(
                along, c2[16 * i : 16 * i + 16, columns][:, :-1], solver="elimination"
            ).conductance
        found = ColumnRuns.of(h, cells, node_spacing=1).window_permeability()
        assert_allclose(found, expected, rtol=1e-9)
        assert np.argwhere(found == 0).tolist() == [[1, 2]]

    def test_windows_have_the_potential_and_the_flux_of_the_network(self, gap, cells):
        h = gap.copy()
        h[16:32, 32:48] = 0.0  # the window (1, 2)
        c1, c2 = cell_links(h, PIXEL, "periodic")
        c2 = np.roll(c2, 1, axis=1)  # the link before every pixel
        p = solve_links(c1, np.roll(c2, -1, axis=1), solver="elimination").potential
        inside, before = p[1:-1], np.roll(p[1:-1], 1, axis=1)
        along = c1 * np.nan_to_num(p[:-1] - p[1:])
        across = c2 * np.nan_to_num(before - inside)
        # a side point lies half way along its link, and at the ends of the face on them
        rows = np.where(c1 > 0, np.vstack([p[:1], (inside[:-1] + inside[1:]) / 2, p[-1:]]), np.nan)
        middle = np.where(c2 > 0, (before + inside) / 2, np.nan)
        faces = ColumnRuns.of(h, cells, node_spacing=1)
        found, flux = faces.window_potential(), faces.window_flux()
        for i, j in cells.places:
            a, b, ends = 16 * i, 16 * j, (16 * j, 16 * (j + 1) % 96)
            sides = [*rows[[a, a + 16], b : b + 16].ravel(), *middle[a : a + 16, ends].ravel()]
            known = np.isfinite(sides)
            assert_allclose(found[i, j], np.mean(np.array(sides)[known]) if known.any() else np.nan, rtol=1e-9)
            through = along[[a, a + 16], b : b + 16].sum() / 2, across[a : a + 16, ends].sum() / 2
            assert_allclose(flux[i, j], np.array(through) / 16e-6, rtol=1e-7, atol=1e-9 * flux.max())
        assert np.argwhere(np.isnan(found)).tolist() == [[1, 2]]
        assert_allclose(16e-6 * flux[..., 0].sum(axis=1), faces.face.conductance, rtol=1e-9)

    def test_windows_of_a_closed_face_have_no_flux(self, gap, cells):
        h = gap.copy()
        h[16:20] = 0.0
        faces = ColumnRuns.of(h, cells)
        potential = faces.window_potential()
        assert not faces.window_flux().any()
        assert set(np.unique(potential[np.isfinite(potential)])) == {0.0, 1.0}
        assert np.all(potential[0] == 1)
        assert np.all(potential[2:] == 0)

    def test_a_length_beyond_the_face(self, gap, cells):
        for length in (0, 7):
            with pytest.raises(InputError, match="length"):
                ColumnRuns.of(gap, cells).flows(length)


@pytest.fixture(scope="module")
def scene():
    surface = self_affine((64, 128), (64e-6, 128e-6), hurst=0.8, rms_slope=0.2, roll_off=32e-6, cut_off=8e-6, rng=1)
    return Scene(
        surface=surface,
        modulus=115e9,
        hardness=4e9,
        fluid=Liquid(1e-3),
        inlet_pressure=1e6,
        outlet_pressure=0.0,
        loading=(1e8, 6e8),
        unload_from=(6e8,),
        unloading=(1e8,),
    )


SAMPLING = Sampling(length=512e-6, realisations=60, library_cells=32, seed=1, sampler="runs")


@pytest.fixture(scope="module")
def face(scene):
    return two_scale(scene, (4, 8))


@pytest.fixture(scope="module")
def seals(scene, face):
    return stochastic(scene, (4, 8), SAMPLING, two_scale=face)


class TestSeals:
    def test_they_leak_as_the_face_on_the_mean_and_lie_between_their_bounds(self, seals, face):
        error = seals.leakage.std(axis=0) / np.sqrt(len(seals.leakage))
        assert np.all(np.abs(seals.mean - face.leakage) < 4 * error + 1e-9 * face.leakage)
        assert np.all(seals.leakage_neumann_cuts <= seals.leakage * (1 + 1e-12))
        assert np.all(seals.leakage <= seals.leakage_dirichlet_cuts * (1 + 1e-12))
        assert np.all((seals.cut_error > 0) & (seals.cut_error < 1.5))
        assert np.all(seals.library_error > 0)
        assert seals.seal.cells == (4, 32)

    def test_realisations_depend_on_their_number_alone(self, scene, face, seals):
        few = stochastic(scene, (4, 8), replace(SAMPLING, realisations=3), two_scale=face)
        assert_array_equal(few.leakage, seals.leakage[:3])
        assert_array_equal(few.leakage_resampled, seals.leakage_resampled[:3])
        other = stochastic(scene, (4, 8), replace(SAMPLING, seed=2, realisations=3), two_scale=face)
        assert np.all(other.leakage != few.leakage)

    def test_a_longer_seal_starts_with_the_runs_of_a_shorter_one(self, scene, face):
        one, two = (
            stochastic(scene, (4, 8), replace(SAMPLING, length=n * 64e-6, realisations=40), two_scale=face).leakage
            for n in (1, 2)
        )
        second = 2 * two - one
        assert_allclose(np.unique(second[:, 0].round(12)), np.unique(one[:, 0].round(12)))

    def test_the_distance_of_the_bounds_is_in_the_results(self, scene, seals):
        data = assemble(scene, stochastic=seals).dataset
        assert_allclose(data["cut_error"], seals.cut_error)
        assert data["leakage_closed_cuts"].dims == ("realisation", "step")

    def test_they_are_the_default_and_need_no_links(self, scene, face, seals, monkeypatch):
        monkeypatch.setattr(window_supply, "solve_links", None)
        drawn = stochastic(scene, (4, 8), replace(SAMPLING, sampler=None), two_scale=face)
        assert drawn.sampler == "runs"
        assert_array_equal(drawn.leakage, seals.leakage)
        assert drawn.library.k1 is drawn.library.k2 is None
        assert (drawn.library.size, drawn.library.independent) == (32, 32)
        assert np.all(np.diff(drawn.library.curves.k[:, :2], axis=1) < 0)

    @pytest.mark.parametrize(
        ("options", "contact", "sampler"),
        [
            ({"discretisation": "gauss"}, None, "block"),
            ({"pressure": "uniform"}, None, "history"),
        ],
    )
    def test_others_are_the_default_elsewhere(self, scene, options, contact, sampler):
        there = replace(scene, **{k: v for k, v in options.items() if k == "discretisation"})
        sampling = replace(SAMPLING, sampler=None, **{k: v for k, v in options.items() if k == "pressure"})
        assert chosen_sampler(sampling, there, contact) == sampler

    def test_a_failed_step_is_left_out(self, scene, face):
        gap = face.gap.copy()
        gap[1, :5, :5] = np.nan
        broken = replace(face, fields=replace(face.fields, gap=gap))
        seals = stochastic(scene, (4, 8), replace(SAMPLING, realisations=3), two_scale=broken)
        assert_array_equal(np.isnan(seals.leakage).all(axis=0), [False, True, False])
        assert any(text.startswith(f"runs, {scene.steps[1].name}") for text in seals.failures)

    def test_what_does_not_go_together(self, scene):
        with pytest.raises(InputError, match="place"):
            stochastic(scene, (4, 8), replace(SAMPLING, pressure="global"))
        with pytest.raises(InputError, match="edge"):
            stochastic(replace(scene, discretisation="gauss"), (4, 8), SAMPLING)
        with pytest.raises(InputError, match="history, derivative, copula, block, runs"):
            stochastic(scene, (4, 8), replace(SAMPLING, sampler="magic"))


class TestRunsOfAFace:
    """Seals drawn from runs whose flows are given: eight columns, two states."""

    PARTITION = Partition((8, 64), PIXEL, (1, 8))

    def seals(self, flows, scene, columns=800, realisations=40):
        """From the flows of each length at both states."""
        scene = replace(scene, unload_from=(), unloading=())
        states = [StateRuns(tuple(f), *np.ones((2, 1, 8)), np.ones((1, 8, 2)), SolverCounts()) for f in flows]
        return chained_seals(scene, self.PARTITION, states, columns, realisations, seed=1)

    def flow(self, length, closed, held, spread=0.1):
        """Runs that scatter by `spread`, about a mean of 1 for a column."""
        shape = length * (1 + spread * np.array([-1.0, 1.0] * (8 // length)))
        low, high = closed * shape, held * shape
        return RunFlows(length, 8 // length, np.arange(shape.size), low, high, float(length), SolverCounts())

    @pytest.mark.parametrize(
        ("apart", "length"),
        [((1.03, 1.03, 1.03), 1), ((1.05, 1.05, 1.05), 2), ((1.2, 1.08, 1.05), 4), ((1.5, 1.4, 1.3), 4)],
    )
    def test_are_the_shortest_whose_cuts_matter_less_than_the_face(self, scene, apart, length):
        flows = [self.flow(n, 1 / q, q) for n, q in zip((1, 2, 4), apart, strict=True)]
        seals = self.seals([flows, flows], scene)
        assert (seals.length, seals.columns, seals.warnings) == (length, 800, ())

    def test_a_step_without_flow_does_not_count(self, scene):
        open_ = [self.flow(n, 0.99, 1.01) for n in (1, 2, 4)]
        closing = [replace(f, neumann=0 * f.neumann, dirichlet=1e-4 * f.dirichlet, whole=5e-5 * f.whole) for f in open_]
        assert self.seals([open_, closing], scene).length == 1
        assert self.seals([open_, [replace(f, neumann=0 * f.neumann) for f in open_]], scene).length == 4

    def test_bounds_far_apart_are_told(self, scene):
        flows = [self.flow(n, 0.25, 5.0) for n in (1, 2, 4)]
        (text,) = self.seals([flows, flows], scene).warnings
        assert "runs of 4 columns" in text
        assert "factor of 20" in text
        assert scene.steps[0].name in text

    def test_a_length_that_no_runs_make_is_warned_of(self, scene):
        flows = [self.flow(n, 1 / q, q) for n, q in zip((1, 2, 4), (1.5, 1.4, 1.3), strict=True)]
        found = self.seals([flows, flows], scene, columns=5)
        assert (found.length, found.columns) == (4, 4)
        (text,) = found.warnings
        assert "whole runs of 4 columns of windows make seals 32 µm long, not 40 µm" in text

    def test_the_scatter_of_libraries_is_that_of_the_mean_of_their_runs(self, scene):
        """Faces of four independent runs each: their means scatter by a half of what runs do."""
        rng = np.random.default_rng(1)
        variances = []
        for _ in range(60):
            value = 1 + 0.1 * rng.standard_normal(4)
            runs = RunFlows(2, 4, 2 * np.arange(4), value, value, float(value.mean()), SolverCounts())
            seals = self.seals([[runs], [runs]], scene, columns=2000, realisations=60)
            variances.append(np.log(seals.resampled[:, 0]).var(ddof=1))
            assert_allclose(runs.scatter, value.std() / value.mean() / np.sqrt(3))
        assert_allclose(np.sqrt(np.mean(variances)), 0.1 / np.sqrt(4), rtol=0.15)


CASE = {
    "method": "stochastic",
    "face": {"kind": "self-affine", "points": [64, 128], "size": ["64 um", "128 um"], "hurst": 0.8, "rms_slope": 0.1},
    "material": {"young": "210 GPa", "poisson": 0.3, "hardness": "4 GPa"},
    "load": {"loading": ["100 MPa"]},
    "fluid": {"kind": "liquid", "viscosity": "1 mPa s", "inlet_pressure": "1 MPa"},
    "cells": {"count": [4, 8]},
    "stochastic": {"length": "1 mm", "realisations": 4, "library_cells": 32, "sampler": "runs"},
    "seed": 1,
}


def test_a_case_takes_them_with_links_between_pixels_only():
    with pytest.raises(InputError, match=r"stochastic.sampler: given .* edge"):
        parse_case({**CASE, "flow": {"discretisation": "gauss"}})
    assert parse_case(CASE).stochastic.sampler == "runs"

"""Model errors by split conformal prediction: the quantile, its coverage, sealed steps, and the packaged calibration set."""

import csv
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from femseal import (
    CoarserSolution,
    Liquid,
    Sampling,
    Scene,
    deterministic,
    error_budget,
    self_affine,
    stochastic,
    two_scale,
)
from femseal.base.errors import InputError
from femseal.budget.changes import load_sensitivity, sealed_upper
from femseal.budget.conformal import (
    CALIBRATION,
    DIFFICULTIES,
    Scores,
    calibration,
    decades,
    model_error,
)
from femseal.case.case import parse_case
from femseal.loads import LoadProgramme
from femseal.preparation.preparation import prepare
from femseal.preparation.prepared import Prepared
from femseal.refinement.budgets import budgets_of


def test_decades_are_below_the_first_known_leakage():
    assert decades(np.array([np.nan, -2.0, 0.02, 0.0])).tolist() == [0.0, 0.0, 2.0, 0.0]


class TestQuantile:
    def test_scenes_of_one_step_give_the_order_statistic_of_split_conformal_prediction(self):
        """The ⌈(n + 1)(1 − α)⌉-th smallest of n scores."""
        for n, coverage, rank in ((19, 0.95, 19), (39, 0.95, 38), (99, 0.9, 90), (60, 0.95, 58)):
            values = np.random.default_rng(n).permutation(np.arange(1.0, n + 1))
            assert Scores(np.arange(n), values).quantile(coverage) == rank

    def test_a_scene_counts_once_however_many_steps_it_has(self):
        scene = np.r_[np.arange(38), np.full(500, 38)]
        value = np.r_[np.zeros(38), np.full(500, 9.0)]
        assert Scores(scene, value).quantile(0.95) == 0.0
        assert Scores(scene, value).quantile(0.96) == 9.0

    def test_too_few_scenes_for_the_coverage_are_an_error(self):
        scores = Scores(np.arange(18), np.ones(18))
        assert scores.quantile(0.94) == 1.0
        with pytest.raises(InputError, match=r"at most 0\.947 by a calibration of 18 scenes"):
            scores.quantile(0.95)

    def test_the_band_holds_a_step_of_a_new_scene_with_the_coverage(self):
        """Steps of a scene err together, by a heavy-tailed size: 4000 calibrations, each tried on one step."""
        rng, trials, scenes = np.random.default_rng(7), 4000, 40
        size = np.exp(rng.normal(size=(trials, scenes + 1, 1)))
        errors = size * np.abs(rng.normal(size=(trials, scenes + 1, 5)))
        numbers = np.repeat(np.arange(scenes), 5)
        held = [e[-1, 0] <= Scores(numbers, e[:-1].ravel()).quantile(0.9) for e in errors]
        # at least the coverage, and at most 1/(n + 1) and a step's share more; three standard errors
        assert 0.9 - 0.014 < np.mean(held) < 0.93 + 0.014


class TestCalibrationSet:
    def test_it_has_enough_scenes_of_every_kind_of_method(self):
        found = calibration()
        assert set(found) == set(DIFFICULTIES)
        with CALIBRATION.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        assert len({row["scene"] for row in rows}) >= 60
        assert len({row["surface"] for row in rows}) >= 5
        for kind, scores in found.items():
            assert scores.scenes >= (60 if kind in ("links", "compared links", "windows") else 30)
            assert 0 < scores.quantile(0.95) < np.inf

    def test_what_other_parts_hold_is_left_to_them(self, tmp_path):
        """With the other part `own` the band of the whole is as wide as the error."""
        path = tmp_path / "set.csv"
        lines = [f"runs,turned,turned {n},0,0.5,0.3,0.0,,,,,,0.2," for n in range(19)]
        head = "method,surface,scene,step,log_ratio,own,decades,contact,gap_error,effect,difference,slope,scatter,form"
        path.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
        width = calibration(path)["runs"].quantile(0.95) * DIFFICULTIES["runs"](
            {"decades": np.zeros(1), "scatter": np.full(1, 0.2)}
        )
        assert_allclose(np.hypot(width, 0.3), 0.5)

    def test_steps_sealed_by_the_method_are_left_out_and_open_ones_whose_truth_is_sealed_are_misses(self, tmp_path):
        path = tmp_path / "set.csv"
        head = "method,surface,scene,step,log_ratio,own,decades,contact,gap_error,effect,difference,slope,scatter,form"
        lines = [
            f"links,turned,turned {n},0,{ratio},,0.0,0.1,,,,,,"
            for n, ratio in enumerate(["-inf", "inf", *["0.1"] * 19])
        ]
        path.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
        scores = calibration(path)["links"]
        assert scores.scenes == 20
        assert scores.quantile(0.95) == np.inf
        assert scores.quantile(0.9) < 1

    def test_widths_grow_with_the_difficulty_and_the_coverage(self):
        contact, fall = np.array([0.01, 0.3, 0.3]), np.array([0.0, 0.0, 2.0])
        width = model_error("links", contact=contact, decades=fall)
        assert (np.diff(width) > 0).all()
        assert (model_error("links", coverage=0.8, contact=contact, decades=fall) < width).all()
        small, large = model_error("windows", gap_error=np.array([1e-3, 0.05]), effect=np.array([0.0, np.inf]))
        assert small < 0.1 < large < np.inf

    @pytest.mark.parametrize(
        ("kind", "given", "text"),
        [
            ("lines", {}, "one of links, compared links"),
            ("links", {"contact": np.zeros(1)}, "also decades"),
            ("links", {"coverage": 1.0}, "below 1"),
            ("links", {"coverage": 0.9999}, "scenes"),
        ],
    )
    def test_what_does_not_suit_is_told(self, kind, given, text):
        features = given if "coverage" not in given else given | {"contact": np.zeros(1), "decades": np.zeros(1)}
        with pytest.raises(InputError, match=text):
            model_error(kind, **features)


class TestSealedSteps:
    STEPS = LoadProgramme.of([1e6, 2e6, 4e6, 4.2e6, 8e6], [8e6], [4e6, 1e6])

    def test_a_step_sealed_by_little_may_leak_what_the_one_before_does(self):
        q = np.array([1e-6, 1e-7, 0.0, 0.0, 0.0, 0.0, 1e-8])
        # the slope is 3.3: a distance of 0.3 is a shift of the load by 9 %
        ends = sealed_upper(self.STEPS, q, np.full(7, 0.3))
        assert_allclose(ends[[2, 3]], 1e-7 * np.exp(0.3))
        assert_array_equal(ends[[0, 1, 4, 6]], 0)
        # on unloading the same load is bounded by what leaks with less load
        assert_allclose(ends[5], 1e-7 * np.exp(0.3))

    def test_without_errors_sealed_stays_sealed_beyond_the_first(self):
        q = np.array([1e-6, 1e-7, 0.0, 0.0, 0.0, 0.0, 1e-8])
        assert_array_equal(sealed_upper(self.STEPS, q, np.zeros(7))[[3, 4]], 0)

    def test_a_seal_that_never_leaks_has_no_open_step(self):
        assert_array_equal(sealed_upper(self.STEPS, np.zeros(7), np.zeros(7)), 0)


def test_decades_are_below_the_first_load():
    assert_array_equal(decades(np.array([1e-6, 1e-8, 0.0, 1e-5])), [0, 2, 0, -1])
    assert_array_equal(decades(np.array([0.0, 1e-8])), 0)


class TestPartsOfABudget:
    @pytest.fixture
    def scene(self):
        face = self_affine((64, 64), (64e-6, 64e-6), hurst=0.8, rms_slope=0.2, roll_off=16e-6, cut_off=8e-6, rng=3)
        return Scene(
            surface=face,
            modulus=115e9,
            hardness=3e9,
            fluid=Liquid(1e-3),
            inlet_pressure=1e7,
            outlet_pressure=0.0,
            loading=(1e8, 4e8),
        )

    def test_two_scales_have_the_parts_of_what_they_leave_out(self, scene):
        names = {}
        for flow, contact in (("links", "whole"), ("resolved", "windows"), ("links", "windows"), ("resolved", "whole")):
            study = two_scale(scene, (4, 4), flow=flow, contact=contact)
            budget = error_budget(scene, study)
            names[flow, contact] = [part.name for part in budget.parts]
            if flow == "links":
                (links,) = (part for part in budget.parts if part.name == "two scales")
                distance = model_error(
                    "links", contact=study.contact_fraction.mean(axis=(1, 2)), decades=decades(study.leakage)
                )
                assert_allclose(np.log(links.upper / study.leakage), distance)
                assert_allclose(np.log(study.leakage / links.lower), distance)
                assert str(calibration()["links"].scenes) in links.note
        assert names == {
            ("links", "whole"): ["solver", "two scales"],
            ("resolved", "windows"): ["solver", "windows"],
            ("links", "windows"): ["solver", "two scales", "windows"],
            ("resolved", "whole"): ["solver"],
        }

    def test_links_compared_with_the_whole_face_on_fewer_points_have_a_narrower_band(self, scene):
        study = two_scale(scene, (4, 4))
        coarse = replace(scene, surface=scene.surface.resample((32, 32)))
        links, whole = two_scale(coarse, (4, 4)).leakage, deterministic(coarse).leakage
        alone, told = (
            {part.name: part for part in error_budget(scene, study, compared=compared).parts}["two scales"]
            for compared in (None, CoarserSolution((32, 32), scene.steps, whole, links))
        )
        slope = np.maximum(load_sensitivity(scene.steps, study.leakage), 1.0)
        distance = model_error("compared links", difference=np.abs(np.log(links / whole)), slope=slope)
        assert_allclose(np.log(told.upper / study.leakage), distance)
        assert (told.upper < alone.upper).all()
        assert "32 × 32 points" in told.note

    def test_drawn_seals_have_a_part_of_their_sampler(self, scene):
        kinds = {"runs": ("runs", "place"), "block": ("block", "place"), "uniform": (None, "uniform")}
        for kind, (sampler, pressure) in kinds.items():
            sampling = Sampling(2 * 64e-6, 3, 6, seed=1, sampler=sampler, pressure=pressure)
            (part,) = (p for p in error_budget(scene, stochastic(scene, (2, 2), sampling)).parts if p.name == "sampler")
            assert f"'{kind}'" in part.note
            assert (part.lower < part.upper).all()

    def test_a_run_compares_links_with_the_whole_face_on_its_coarser_grid(self, scene, monkeypatch):
        """By the solutions that it needs for the pixels anyway, and the deterministic one beside them."""
        text = """
            title = "links"
            method = "two-scale"
            seed = 1
            face = {kind = "self-affine", points = [64, 64], size = ["60 um", "60 um"], rms_slope = 0.2}
            material = {young = "210 GPa", hardness = "3 GPa"}
            load = {loading = ["100 MPa", "300 MPa"]}
            fluid = {kind = "liquid", viscosity = "1 mPa*s", inlet_pressure = "1 MPa"}
            cells = {count = [4, 4], flow = "links"}
        """
        prepared = prepare(parse_case(tomllib.loads(text)))
        asked = []

        def solve(prepared, asked_study, mapper, known=None):
            asked.append(asked_study.name)
            if asked_study.name == "deterministic":
                return deterministic(prepared.scene)
            return two_scale(prepared.scene, prepared.cells, flow=prepared.flow, contact=prepared.contact)

        monkeypatch.setattr(Prepared, "solve", solve)
        study = prepared.solve(prepared.answer, map)
        (part,) = (
            p for p in budgets_of(prepared, {"two_scale": study}, map)["two_scale"].parts if p.name == "two scales"
        )
        assert asked[:3] == ["two-scale", "deterministic", "two-scale"]
        assert "32 × 32 points" in part.note

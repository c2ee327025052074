"""Model errors by split conformal prediction: the quantile, its coverage, sealed steps, and the packaged calibration set."""

import csv

import numpy as np
import pytest
from femseal.budget.conformal import (
    CALIBRATION,
    DIFFICULTIES,
    Scores,
    calibration,
    decades,
    model_error,
)
from numpy.testing import assert_allclose, assert_array_equal

from femseal import (
    Liquid,
    Sampling,
    Scene,
    error_budget,
    self_affine,
    stochastic,
)
from femseal.base.errors import InputError
from femseal.budget.changes import sealed_upper
from femseal.loads import LoadProgramme


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
        assert len({row["surface"] for row in rows}) >= 4
        for kind, scores in found.items():
            assert scores.scenes >= 30, kind
            assert 0 < scores.quantile(0.95) < np.inf

    def test_what_other_parts_hold_is_left_to_them(self, tmp_path):
        """With the other part `own` the band of the whole is as wide as the error."""
        path = tmp_path / "set.csv"
        lines = [f"runs,turned,turned {n},0,0.5,0.3,0.0,0.2" for n in range(19)]
        head = "method,surface,scene,step,log_ratio,own,decades,scatter"
        path.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
        width = calibration(path)["runs"].quantile(0.95) * DIFFICULTIES["runs"](
            {"decades": np.zeros(1), "scatter": np.full(1, 0.2)}
        )
        assert_allclose(np.hypot(width, 0.3), 0.5)

    def test_steps_sealed_by_the_method_are_left_out_and_open_ones_whose_truth_is_sealed_are_misses(self, tmp_path):
        path = tmp_path / "set.csv"
        head = "method,surface,scene,step,log_ratio,own,decades,scatter"
        lines = [f"runs,turned,turned {n},0,{ratio},,0.0,0.2" for n, ratio in enumerate(["-inf", "inf", *["0.1"] * 19])]
        path.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
        scores = calibration(path)["runs"]
        assert scores.scenes == 20
        assert scores.quantile(0.95) == np.inf
        assert scores.quantile(0.9) < 2

    def test_widths_grow_with_the_difficulty_and_the_coverage(self):
        features = {"scatter": np.array([0.01, 0.3, 0.3]), "decades": np.array([0.0, 0.0, 2.0])}
        width = model_error("runs", **features)
        assert (np.diff(width) > 0).all()
        assert (model_error("runs", coverage=0.8, **features) < width).all()

    @pytest.mark.parametrize(
        ("kind", "given", "text"),
        [
            ("lines", {}, "one of runs, block"),
            ("runs", {"scatter": np.zeros(1)}, "also decades"),
            ("runs", {"coverage": 1.0}, "below 1"),
            ("runs", {"coverage": 0.9999}, "scenes"),
        ],
    )
    def test_what_does_not_suit_is_told(self, kind, given, text):
        features = given if "coverage" not in given else given | {"scatter": np.zeros(1), "decades": np.zeros(1)}
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

    def test_drawn_seals_have_a_part_of_their_sampler(self, scene):
        kinds = {"runs": ("runs", "place"), "block": ("block", "place"), "uniform": (None, "uniform")}
        for kind, (sampler, pressure) in kinds.items():
            sampling = Sampling(2 * 64e-6, 3, 6, seed=1, sampler=sampler, pressure=pressure)
            (part,) = (p for p in error_budget(scene, stochastic(scene, (2, 2), sampling)).parts if p.name == "sampler")
            assert f"'{kind}'" in part.note
            assert (part.lower < part.upper).all()

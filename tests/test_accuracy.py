"""Speed against error: what is planned, what a distance of two curves is, and cases whose errors are known."""

import csv
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import femseal as fs
from femseal.budget import ErrorBudget, ErrorPart
from femseal.case.case import parse_case
from femseal.cli import main
from femseal.loads import LoadStep
from femseal.refinement.accuracy_plan import Variant, make_plan
from femseal.refinement.accuracy_report import AccuracyReport, Comparison, Solution
from femseal.studies import study_registry
from femseal.studies.load_curves import LeakageFactor, closing_load, leakage_factor

STEPS = (LoadStep(1e8), LoadStep(2e8), LoadStep(3e8), LoadStep(2e8, 3e8), LoadStep(1e8, 3e8))

CASE = """
method = "stochastic"
[face]
kind = "file"
path = "wave.npy"
spacing = ["1 um", "1 um"]
height_unit = "m"
periodic = [true, true]
[surface]
detrend = 0
[material]
young = "210 GPa"
hardness = "4 GPa"
[load]
loading = ["100 MPa", "400 MPa", "800 MPa"]
unload_from = ["800 MPa"]
unloading = ["400 MPa", "100 MPa"]
[contact]
boundary = ["periodic", "periodic"]
rtol = 1e-8
[fluid]
kind = "liquid"
viscosity = "1 mPa*s"
inlet_pressure = "1 MPa"
[cells]
count = [2, 2]
[stochastic]
length = "128 um"
realisations = 2
"""

SMALL = {
    "method": "stochastic",
    "seed": 2,
    "face": {"kind": "self-affine", "points": [64, 64], "size": ["60 um"] * 2, "rms_slope": 0.2, "roll_off": "40 um"},
    "material": {"young": "210 GPa", "hardness": "3 GPa"},
    "load": {"loading": ["100 MPa", "300 MPa"], "unload_from": ["300 MPa"], "unloading": ["100 MPa"]},
    "fluid": {"kind": "liquid", "viscosity": "1 mPa*s", "inlet_pressure": "1 MPa"},
    "cells": {"count": [2, 2]},
    "stochastic": {"length": "200 um", "realisations": 3},
}
#: No limit that these faces reach.
AMPLE = {"limit": 1e6, "memory": 1e12}


def small(**tables):
    """The small case with entries of its tables changed; None takes a table away."""
    data = {k: dict(v) if isinstance(v, dict) else v for k, v in SMALL.items()}
    for name, changes in tables.items():
        if changes is None:
            del data[name]
        else:
            data[name] = data.get(name, {}) | changes if isinstance(changes, dict) else changes
    return parse_case(data)


class TestFactor:
    exact = np.array([1.0, 0.3, 0.01, 0.02, 0.1])

    def test_equal_curves_have_factor_one(self):
        for branch, loads in (("loading", 3), ("unloading", 2)):
            factor = leakage_factor(self.exact, self.exact, STEPS, branch)
            assert (factor.value, factor.loads, factor.closed, factor.failed) == (1.0, loads, 0, 0)

    def test_a_constant_ratio_is_the_factor_up_or_down_whatever_the_unit_and_direction(self):
        for ratio in (2.0, 0.5):
            for scale in (1e-9, -1.0):
                factor = leakage_factor(scale * ratio * self.exact, scale * self.exact, STEPS, "loading")
                assert_allclose(factor.value, 2.0, rtol=1e-14)

    def test_mean_is_quadratic_in_the_logarithm(self):
        factor = leakage_factor(self.exact * [1, 1, 1, np.exp(3), np.exp(-4)], self.exact, STEPS, "unloading")
        assert_allclose(np.log(factor.value), np.sqrt((9 + 16) / 2), rtol=1e-14)

    def test_loads_that_hardly_leak_do_not_count(self):
        exact = np.array([1.0, 1.1e-3, 0.9e-3, 1.0, 1.0])
        factor = leakage_factor(exact * [1, 2, 50, 1, 1], exact, STEPS, "loading")
        assert factor.loads == 2
        assert_allclose(np.log(factor.value), np.log(2) / np.sqrt(2), rtol=1e-14)

    def test_loads_closed_in_one_solution_only_are_counted_on_either_side(self):
        leaking, shut = np.array([1.0, 0.3, 0.01, 0.02, 0.1]), np.array([1.0, 0.3, 0.0, 0.0, 0.1])
        for pair in ((leaking, shut), (shut, leaking)):
            for branch, loads in (("loading", 2), ("unloading", 1)):
                factor = leakage_factor(*pair, STEPS, branch)
                assert (factor.value, factor.loads, factor.closed) == (1.0, loads, 1)
        # closed in both, or leaking below the floor beside a closed one: no difference to speak of
        assert leakage_factor(shut, shut, STEPS, "loading").closed == 0
        assert leakage_factor(leaking * [1, 1, 1e-5, 1, 1], shut, STEPS, "loading").closed == 0

    def test_what_failed_is_counted_and_left_out(self):
        for pair in ((self.exact * [1, np.nan, 1, 1, 1], self.exact), (self.exact, self.exact * [1, np.nan, 1, 1, 1])):
            factor = leakage_factor(*pair, STEPS, "loading")
            assert (factor.value, factor.loads, factor.failed) == (1.0, 2, 1)
        first_unknown = self.exact * [np.nan, 1, 1, 1, 1]
        for branch, loads, failed in (("loading", 2, 1), ("unloading", 2, 0)):
            factor = leakage_factor(self.exact, first_unknown, STEPS, branch)
            assert (factor.value, factor.loads, factor.failed) == (1.0, loads, failed)
        factor = leakage_factor(self.exact, np.nan * self.exact, STEPS, "unloading")
        assert np.isnan(factor.value)
        assert (factor.loads, factor.failed) == (0, 2)

    def test_closing_load_is_the_lowest_closed_one_on_loading(self):
        assert closing_load([1.0, 0.0, 0.0, 1.0, 1.0], STEPS) == 2e8
        assert closing_load([1.0, np.nan, 0.1, 0.0, 0.0], STEPS) == np.inf


class TestPlan:
    def test_one_thing_is_varied_at_a_time_from_what_the_case_says(self):
        plan = make_plan(small(face={"points": [128, 128]}, cells={"count": [4, 4]}), **AMPLE)
        n = (128, 128)
        assert plan.variants == (
            Variant("deterministic", n),
            Variant("deterministic", (64, 64)),
            Variant("deterministic", (32, 32)),
            Variant("stochastic", n, (4, 4)),
            Variant("stochastic", (64, 64), (4, 4)),
            Variant("stochastic", (32, 32), (4, 4)),
        )
        assert plan.reference == plan.variants[0]
        assert plan.skipped == ()

    def test_pieces_have_eight_points(self):
        plan = make_plan(small(cells={"count": [2, 3]}), **AMPLE)
        assert [v.points for v in plan.variants if v.method == "stochastic"] == [(64, 64), (32, 32)]
        assert dict(plan.skipped) == {"stochastic, 16×16 points, 2×3 pieces": "pieces of fewer than 8 points"}

    @pytest.mark.parametrize("method", ["deterministic", "two-scale", "stochastic"])
    def test_every_method_takes_part_that_the_case_has_tables_for(self, method):
        def methods(case):
            return {v.method for v in make_plan(case, **AMPLE).variants}

        assert methods(small(method=method)) == {"deterministic", "stochastic"}
        if method != "stochastic":
            assert methods(small(method=method, stochastic=None)) == {"deterministic"}
        if method == "deterministic":
            assert methods(small(method=method, cells=None, stochastic=None)) == {"deterministic"}

    def test_coarser_grids_hold_the_same_surface(self):
        face = {"kind": "self-affine", "points": [64, 61], "size": ["60 um"] * 2, "rms_slope": 0.2, "roll_off": "40 um"}
        plan = make_plan(small(method="deterministic", face=face, cells=None, stochastic=None), **AMPLE)
        assert [v.points for v in plan.variants] == [(64, 61), (32, 31), (16, 16)]
        surface = plan.prepared.scene.surface
        for variant in plan.variants:
            assert_allclose(surface.resample(variant.points).rms_height, surface.rms_height, rtol=0.01)

    def test_unaffordable_solutions_are_skipped_but_not_the_reference(self):
        case = small(face={"points": [512, 512]}, cells={"count": [4, 4]}, stochastic={})
        costs = dict(zip((p := make_plan(case, **AMPLE)).variants, p.costs, strict=True))
        whole = costs[Variant("deterministic", (512, 512))]
        plan = make_plan(case, limit=1.01 * whole[0], memory=1e12)
        assert plan.reference == Variant("deterministic", (512, 512))
        dear = {v.label for v, (seconds, _) in costs.items() if seconds > 1.01 * whole[0]}
        assert {what for what, reason in plan.skipped if "expected to take" in reason} == dear
        with pytest.raises(fs.InputError, match=r"limit, memory: .*enough for deterministic, 512×512 points"):
            make_plan(case, limit=1e-6, memory=1e12)

    def test_lines_say_what_is_done_and_what_is_not(self):
        plan = make_plan(small(), **AMPLE)
        text = "\n".join(plan.lines())
        for variant in plan.variants:
            assert f"\n  {variant.label}: about" in text
        for what, reason in plan.skipped:
            assert f"\n  skipped: {what}: {reason}" in text


@pytest.fixture(scope="module")
def wave(tmp_path_factory):
    """Ridges along the flow, crests on the edges of pieces of eight waves: every piece is like the whole."""
    folder = tmp_path_factory.mktemp("wave")
    x2 = (np.arange(256) + 0.5) * 0.5e-6
    np.save(folder / "wave.npy", np.tile(0.5e-6 * np.cos(2 * np.pi * x2 / 8e-6), (256, 1)))
    (folder / "wave.toml").write_text(CASE.replace("1 um", "0.5 um"))
    return fs.measure_accuracy(folder / "wave.toml", workers=1, **AMPLE)


class TestWaveWhosePiecesAreLikeTheWhole:
    @staticmethod
    def factors(report, variant):
        (solution,) = (s for s in report.solutions if s.variant == variant)
        return np.array([solution.comparison.loading.value, solution.comparison.unloading.value])

    def test_reference_has_factor_one(self, wave):
        assert wave.plan.reference == Variant("deterministic", (256, 256))
        assert_array_equal(self.factors(wave, wave.plan.reference), 1)

    def test_drawn_seals_are_right(self, wave):
        factors = self.factors(wave, Variant("stochastic", (256, 256), (2, 2)))
        assert_allclose(factors, 1, atol=1e-5)

    def test_coarser_pixels_are_not(self, wave):
        least = 1.01
        for n in ((128, 128), (64, 64)):
            coarse = self.factors(wave, Variant("deterministic", n))
            assert (coarse > least).all()
            least = coarse

    def test_all_loads_are_compared(self, wave):
        assert wave.warnings == []
        for solution in wave.solutions:
            assert solution.closing_load == np.inf
            assert solution.seconds > 0
            c = solution.comparison
            assert [(f.loads, f.closed, f.failed) for f in (c.loading, c.unloading)] == [(3, 0, 0), (2, 0, 0)]


class TestReport:
    def test_all_are_compared_with_the_reference(self):
        done = []
        report = fs.measure_accuracy(small(), workers=1, progress=lambda *state: done.append(state))
        assert done == [("solutions", n, len(report.solutions)) for n in range(len(report.solutions) + 1)]
        leakage = {s.variant: s.leakage for s in report.solutions}
        for s in report.solutions:
            ratio = np.log(s.leakage / leakage[Variant("deterministic", (64, 64))])
            assert_allclose(s.comparison.loading.value, np.exp(np.sqrt(np.mean(ratio[:2] ** 2))), rtol=1e-12)
            assert_allclose(s.comparison.unloading.value, np.exp(np.abs(ratio[2])), rtol=1e-12)

    def test_leakages_are_those_of_a_run(self):
        case = small(compare=["deterministic"], stochastic={"length": "60 um", "realisations": 3})
        report, results = fs.measure_accuracy(case, workers=1), fs.run(case, workers=1)
        own = {
            s.variant.method: s.leakage
            for s in reversed(report.solutions)
            if s.variant
            in (
                Variant("deterministic", (64, 64)),
                Variant("stochastic", (64, 64), (2, 2)),
            )
        }
        for method, name in (("deterministic", "deterministic"), ("stochastic", "median")):
            assert_allclose(own[method], results.dataset[f"leakage_{name}"].values, rtol=1e-8)

    def test_files_hold_what_the_report_says(self, tmp_path):
        case, out = small(), tmp_path / "out"
        out.mkdir()
        (out / "mine.txt").write_text("kept")
        report = fs.measure_accuracy(case, out, workers=1)
        assert {p.name for p in out.iterdir()} == {"mine.txt", "accuracy.csv", "accuracy.json", "accuracy.png"}
        found = json.loads((out / "accuracy.json").read_text(encoding="utf-8"))
        assert found["case"] == case.echo()
        assert found["seed"] == 2
        assert found["versions"]["femseal"] == fs.__version__
        assert found["reference"] == "deterministic, 64×64 points"
        assert [s["name"] for s in found["steps"]] == [s.name for s in report.plan.prepared.scene.steps]
        for given, read in zip(report.solutions, found["solutions"], strict=True):
            assert_array_equal(given.leakage, read["leakage_m2_per_s"])
            assert read["closing_load_Pa"] is None  # never closed, which JSON has no number for
        assert [tuple(s.values()) for s in found["skipped"]] == list(report.plan.skipped)
        with (out / "accuracy.csv").open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        first = [s.comparison.loading.value for s in report.solutions]
        assert_allclose([float(r["loading_factor"]) for r in rows], first, rtol=1e-12)
        assert {r["method"] for r in rows if r["pieces_1"] == "2"} == {"stochastic"}
        assert (out / "accuracy.png").read_bytes().startswith(b"\x89PNG")

    def test_no_picture_of_an_earlier_case_stays_beside_new_numbers(self, tmp_path, monkeypatch):
        def fail(*data):
            raise ValueError("no such colour")

        case = small(method="deterministic", cells=None, stochastic=None)
        (tmp_path / "accuracy.png").write_text("of another case")
        monkeypatch.setattr("femseal.refinement.accuracy_report.accuracy_figure", fail)
        with pytest.raises(ValueError, match="no such colour"):
            fs.measure_accuracy(case, tmp_path, workers=1)
        assert {p.name for p in tmp_path.iterdir()} == {"accuracy.csv", "accuracy.json"}

    def test_without_unloading_and_without_cells(self):
        case = small(method="deterministic", cells=None, stochastic=None, load={"unload_from": [], "unloading": []})
        report = fs.measure_accuracy(case, workers=1)
        assert len(report.plot().axes) == 1
        assert all(np.isnan(s.comparison.unloading.value) for s in report.solutions)
        assert report.rows()[0]["unloading_factor"] is None

    def test_a_solution_that_fails_is_reported_and_a_reference_that_fails_raises(self, monkeypatch):
        case = small(method="deterministic", cells=None, stochastic=None)
        solve = study_registry.deterministic

        def failing(points):
            def deterministic(scene, **options):
                if scene.surface.shape == points:
                    raise fs.NotConverged("stalled")
                return solve(scene, **options)

            return deterministic

        monkeypatch.setattr("femseal.studies.study_registry.deterministic", failing((32, 32)))
        report = fs.measure_accuracy(case, workers=1)
        assert report.warnings == ["deterministic, 32×32 points: stalled"]
        (failed,) = (s for s in report.solutions if s.variant.points == (32, 32))
        assert failed.comparison.loading.failed == 2
        assert failed.comparison.loading.loads == 0
        json.loads(report.json_text())
        monkeypatch.setattr("femseal.studies.study_registry.deterministic", failing((64, 64)))
        with pytest.raises(fs.NotConverged, match="stalled"):
            fs.measure_accuracy(case, workers=1)

    @pytest.mark.parametrize(
        ("arguments", "name"),
        [
            ({"workers": 0}, "workers"),
            ({"limit": "10 min"}, "limit"),
            ({"limit": 0.0}, "limit"),
            ({"memory": -1.0}, "memory"),
            ({"limit": 1e-9}, "limit"),
        ],
    )
    def test_nothing_starts_before_the_input_is_checked(self, tmp_path, monkeypatch, arguments, name):
        lines = []
        monkeypatch.setattr("femseal.refinement.accuracy_measure._measure", lambda *_: pytest.fail("started"))
        with pytest.raises(fs.InputError, match=name):
            fs.measure_accuracy(small(), tmp_path / "out", **({"workers": 1} | arguments), announce=lines.append)
        assert lines == []
        assert not (tmp_path / "out").exists()
        (tmp_path / "file").write_text("")
        with pytest.raises(fs.InputError, match="output"):
            fs.measure_accuracy(small(), tmp_path / "file")


class TestCommand:
    @pytest.fixture
    def case(self, tmp_path):
        path = tmp_path / "small.toml"
        lines = CASE.replace('kind = "file"\npath = "wave.npy"', 'kind = "self-affine"\npoints = [64, 64]')
        lines = lines.replace(
            'spacing = ["1 um", "1 um"]\nheight_unit = "m"\nperiodic = [true, true]',
            'size = ["60 um", "60 um"]\nrms_slope = 0.2\nroll_off = "40 um"',
        )
        path.write_text(lines)
        return path

    @pytest.fixture
    def call(self, monkeypatch, capsys):
        """Exit code and both streams of the command."""

        def run(*arguments):
            monkeypatch.setattr("sys.argv", ["femseal", "accuracy", *map(str, arguments)])
            try:
                main()
                code = 0
            except SystemExit as stop:
                code = stop.code
            return code, *capsys.readouterr()

        return run

    def test_plan_then_table_then_files(self, case, tmp_path, call):
        out = tmp_path / "out"
        code, printed, _ = call(case, "-o", out, "--workers", 1)
        assert code == 0
        plan = make_plan(fs.load_case(case), limit=600, memory=4e9)
        *lines, rest = printed.split("\n", len(plan.lines()))
        assert lines == plan.lines()
        assert "stochastic" in rest
        assert f"accuracy in {out}" in rest
        assert {p.name for p in out.iterdir()} == {"accuracy.csv", "accuracy.json", "accuracy.png"}

    def test_bad_input_writes_nothing_and_exits_with_2(self, case, tmp_path, call):
        out = tmp_path / "out"
        for wrong in (["--limit", "10"], ["--memory", "4 s"], ["--limit", "1 ns"], ["--workers", "0"]):
            code, printed, errors = call(case, "-o", out, *wrong)
            assert code == 2
            assert wrong[0].strip("-") in errors
            assert printed == ""
        case.write_text(case.read_text().replace("count = [2, 2]", "count = [16, 16]"))
        code, _, errors = call(case, "-o", out)
        assert code == 2
        assert "cells" in errors
        assert call(tmp_path / "none.toml", "-o", out)[0] == 2
        assert not out.exists()


class TestRecommended:
    """The cheapest solution whose measured error and budget are within the accuracy, of the case's own method first."""

    def report(self, *solutions, wanted=0.1):
        """Solutions as (method, seconds, factor, half-width of the budget, loads closed in one only)."""
        case = parse_case(SMALL | {"accuracy": wanted})
        plan = make_plan(case, limit=60, memory=1e9)
        made = []
        for n, (method, seconds, factor, width, closed) in enumerate(solutions):
            q = np.array([1.0, 0.1])
            part = ErrorPart("pixels", q * np.exp(-width), q * np.exp(width), "")
            variant = Variant(method, (32, 32 + n), None if method == "deterministic" else (2, 2))
            distance = LeakageFactor(factor, 2, closed, 0)
            made.append(
                Solution(
                    variant=variant,
                    seconds=seconds,
                    expected_seconds=1.0,
                    expected_memory=1.0,
                    leakage=q,
                    closing_load=np.inf,
                    comparison=Comparison(distance, distance),
                    failures=(),
                    budget=ErrorBudget(method, q, (part,)),
                )
            )
        return AccuracyReport(plan=plan, solutions=tuple(made), workers=1)

    def test_of_those_within_error_and_budget_the_cheapest(self):
        found = self.report(
            ("deterministic", 4.0, 1.0, 0.01, 0),
            ("deterministic", 3.0, 1.05, 0.09, 0),
            ("deterministic", 2.0, 1.05, 0.2, 0),
            ("deterministic", 1.0, 1.2, 0.01, 0),
            ("deterministic", 0.5, 1.0, 0.01, 1),
        )
        assert found.recommended.seconds == 3.0
        assert "recommended: deterministic, 32×33 points" in found.advice
        assert [row["recommended"] for row in found.rows()] == [False, True, False, False, False]
        assert json.loads(found.json_text())["recommended"] == found.recommended.variant.label
        assert found.rows()[1]["budget_factor"] == pytest.approx(np.exp(0.09))

    def test_the_own_method_comes_first(self):
        """The small case is stochastic."""
        good = ("deterministic", 1.0, 1.0, 0.01, 0)
        assert self.report(good, ("stochastic", 5.0, 1.0, 0.05, 0)).recommended.seconds == 5.0
        assert self.report(good, ("stochastic", 5.0, 1.0, 0.5, 0)).recommended.seconds == 1.0

    def test_none_is_said(self):
        found = self.report(("deterministic", 1.0, 1.0, 0.2, 0), wanted=0.03)
        assert found.recommended is None
        assert found.advice == "no solution has both its measured error and its budget within 3 %"

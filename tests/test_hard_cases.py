"""The hard scenes give what they must; each judge fails when what must come out is changed; the command tells it."""

import csv
import json
import re
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from femseal.base.errors import FemsealError, InputError, NotConverged
from femseal.cli import app, main
from femseal.hard_cases import collection
from femseal.hard_cases.collection import CASES, STAGES, chosen
from femseal.hard_cases.hard_case import HardCase
from femseal.hard_cases.judges import Between, Exactly, Falling, Near, NotSolved, Refused, ZeroAndPositive

PAGE = Path(__file__).parents[1] / "docs" / "evidence" / "hard_cases.md"


def changed(must, came):
    """The judge with its expectation changed a little, in every way, and what came with it."""
    if isinstance(must, (NotSolved, Refused)):
        return [(replace(must, words=(*must.words, "nonsense")), came)]
    values = np.ravel(np.asarray(came, float))
    if isinstance(must, Between):
        next_up, next_down = np.nextafter(values.min(), np.inf), np.nextafter(values.max(), -np.inf)
        return [(replace(must, low=next_up), came), (replace(must, high=next_down), came)]
    if isinstance(must, (Falling, ZeroAndPositive)):
        return [(must, values[::-1])]
    wanted = np.ravel(np.asarray(must.value, float))
    found = []
    for n, value in enumerate(wanted):
        other = wanted.copy()
        other[n] = value * (1 + 3 * must.rtol) if isinstance(must, Near) else value + np.spacing(value)
        assert other[n] != value
        found.append((replace(must, value=other), came))
    return found


@pytest.mark.parametrize(
    "case", [pytest.param(c, id=c.name, marks=[pytest.mark.slow] if c.slow else []) for c in CASES]
)
def test_scene(case):
    came = []

    def run():
        try:
            came.append(case.run())
        except FemsealError as error:
            came.append(error)
            raise
        return came[-1]

    outcome = replace(case, run=run).outcome()
    assert outcome.within, f"must: {case.must.text}, came: {outcome.came}"
    for must, value in changed(case.must, came[0]):
        assert not must.holds(value), f"{must.text} holds for {value}"


def test_there_are_scenes_of_every_stage_with_names_of_their_own():
    assert len(CASES) >= 40
    assert len({case.name for case in CASES}) == len(CASES)
    assert {case.stage for case in CASES} == set(STAGES)
    assert all(sum(case.stage == stage for case in CASES) >= 15 for stage in STAGES)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_no_judge_takes_what_is_not_a_number_or_an_error(case):
    size = np.size(getattr(case.must, "value", 1.0))
    for came in (np.full(max(size, 2), np.nan), np.full(size, np.nan), (), MemoryError("all gone")):
        assert case.must.holds(came) is False  # as a file of JSON has it
    assert case.must.holds((1.0, 1.0)) in (True, False)


def scene(run, must=None):
    return HardCase("made up", "flow", "nothing", must or Near(1.0, 1e-3), run)


class TestOutcomes:
    def test_an_undefined_number_an_error_and_a_warning_do_not_pass(self):
        module = compile("import numpy as np\ndef run(): return np.array(1.0) / 0", "anywhere.py", "exec")
        names = {"__name__": "femseal.flow.anywhere"}
        exec(module, names)
        came = [scene(run).outcome() for run in (lambda: float("nan"), lambda: 1 / 0, names["run"])]
        assert [outcome.within for outcome in came] == [False] * 3
        assert [outcome.came.partition(":")[0] for outcome in came] == ["nan", "ZeroDivisionError", "RuntimeWarning"]

    def test_filters_of_warnings_stay_as_they_were(self):
        before = list(warnings.filters)
        scene(lambda: 1.0).outcome()
        assert warnings.filters == before

    @pytest.mark.skipif(sys.platform == "win32", reason="no alarm")
    def test_a_scene_that_hangs_is_ended(self):
        outcome = scene(lambda: time.sleep(60)).outcome(longest=0.05)
        assert (outcome.within, outcome.came) == (False, "TimeoutError: not done after 0.05 s")
        assert scene(lambda: 1.0).outcome(longest=0.05).within  # no alarm is left

    def test_numbers_of_another_count_do_not_pass(self):
        assert not Near(1.0, 1e-3).holds((1.0, 1.0))
        assert not Exactly((1.0, 2.0)).holds(1.0)
        assert not Between(0.0, np.inf, "finite").holds(np.inf)
        assert not Falling("one is none").holds(1.0)

    def test_an_error_of_another_kind_is_no_refusal(self):
        assert not Refused(("gap",)).holds(ValueError("gap"))
        assert not Refused(("gap",)).holds(NotConverged("gap"))
        assert not NotSolved(("gap",)).holds(InputError("gap"))


class TestCommand:
    def invoke(self, *options):
        return CliRunner().invoke(app, ["hard-cases", *map(str, options)])

    def test_scenes_of_a_name_and_files(self, tmp_path):
        for ending in ("csv", "json", "md"):
            done = self.invoke("--stage", "flow", "--name", "scratch", "-o", tmp_path / f"table.{ending}")
            assert done.exit_code == 0, done.output
        assert "2 hard scenes, none failed" in done.output
        read = json.loads((tmp_path / "table.json").read_text(encoding="utf-8"))
        assert [line["came"] for line in read] == ["1.24378e-21", "0"]
        with (tmp_path / "table.csv").open(encoding="utf-8", newline="") as file:
            assert [line["within"] for line in csv.DictReader(file)] == ["True", "True"]
        assert (tmp_path / "table.md").read_text(encoding="utf-8").count("| yes |") == 2

    def test_one_failure_is_exit_code_1(self, monkeypatch, tmp_path):
        monkeypatch.setattr(collection, "CASES", (scene(lambda: 1.0), scene(lambda: 2.0)))
        done = self.invoke("-o", tmp_path / "table.json")
        assert done.exit_code == 1
        assert "2 hard scenes, 1 failed" in done.output
        assert [line["within"] for line in json.loads((tmp_path / "table.json").read_text("utf-8"))] == [True, False]
        monkeypatch.setattr(sys, "argv", ["femseal", "hard-cases"])
        with pytest.raises(SystemExit) as stopped:
            main()
        assert stopped.value.code == 1

    def test_bad_options_are_refused_before_anything_is_solved(self, tmp_path, monkeypatch):
        monkeypatch.setattr(HardCase, "outcome", None)
        for options in (["--stage", "nonsense"], ["--name", "nonsense"], ["-o", tmp_path / "table.txt"]):
            done = self.invoke(*options)
            assert isinstance(done.exception, InputError)
            assert re.match(r"(stage|name|output): given '", str(done.exception))
        assert not list(tmp_path.iterdir())

    def test_a_whole_name_is_that_scene_alone(self):
        assert [case.name for case in chosen(name="ring")] == ["ring"]
        assert len(chosen(name="grooves")) > 5


def test_the_page_has_every_scene():
    text = PAGE.read_text(encoding="utf-8")
    told = re.findall(r"^\| \w+ \| ([^|]+) \|.*\| yes \|$", text, re.MULTILINE)
    assert told == [case.name for case in CASES]

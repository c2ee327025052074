"""The hard scenes give what they must; each judge fails when what must come out is changed; the report says so."""

import re
import sys
import warnings
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
import report
from hard_scene import HardScene
from judges import Between, Exactly, Falling, Near, NotSolved, Refused, ZeroAndPositive
from report import SCENES, STAGES

from femseal.base.errors import FemsealError, InputError, NotConverged


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
        other[n] = (
            value * (1 + 3 * must.rtol) if isinstance(must, Near) else value + np.spacing(value)
        )
        assert other[n] != value
        found.append((replace(must, value=other), came))
    return found


@pytest.mark.parametrize(
    "scene",
    [pytest.param(s, id=s.name, marks=[pytest.mark.slow] if s.slow else []) for s in SCENES],
)
def test_scene(scene):
    if scene.needs:
        pytest.importorskip(scene.needs, reason="an extra is not installed")
    came = []

    def run():
        try:
            came.append(scene.run())
        except FemsealError as error:
            came.append(error)
            raise
        return came[-1]

    outcome = replace(scene, run=run).outcome()
    assert outcome.within, f"must: {scene.must.text}, came: {outcome.came}"
    for must, value in changed(scene.must, came[0]):
        assert not must.holds(value), f"{must.text} holds for {value}"


def test_there_are_scenes_of_every_stage_with_names_of_their_own():
    assert len({scene.name for scene in SCENES}) == len(SCENES)
    assert {scene.stage for scene in SCENES} == set(STAGES)
    assert all(sum(scene.stage == stage for scene in SCENES) >= 15 for stage in STAGES)


def test_no_judge_takes_what_is_not_a_number_or_an_error():
    for scene in SCENES:
        size = np.size(getattr(scene.must, "value", 1.0))
        for came in (
            np.full(max(size, 2), np.nan),
            np.full(size, np.nan),
            (),
            MemoryError("all gone"),
        ):
            assert scene.must.holds(came) is False, scene.name


def made_up(run, must=None):
    return HardScene("made up", "flow", "nothing", must or Near(1.0, 1e-3), run)


class TestOutcomes:
    def test_an_undefined_number_an_error_and_a_warning_do_not_pass(self):
        module = compile(
            "import numpy as np\ndef run(): return np.array(1.0) / 0", "anywhere.py", "exec"
        )
        names = {"__name__": "femseal.flow.anywhere"}
        exec(module, names)
        before = list(warnings.filters)
        came = [
            made_up(run).outcome() for run in (lambda: float("nan"), lambda: 1 / 0, names["run"])
        ]
        assert [outcome.within for outcome in came] == [False] * 3
        assert [outcome.came.partition(":")[0] for outcome in came] == [
            "nan",
            "ZeroDivisionError",
            "RuntimeWarning",
        ]
        assert warnings.filters == before

    @pytest.mark.skipif(sys.platform == "win32", reason="no alarm")
    def test_a_scene_that_hangs_is_ended(self):
        outcome = made_up(lambda: sum(1 for _ in count())).outcome(longest=0.05)
        assert (outcome.within, outcome.came) == (False, "TimeoutError: not done after 0.05 s")
        assert made_up(lambda: 1.0).outcome(longest=0.05).within  # no alarm is left

    def test_numbers_of_another_count_do_not_pass(self):
        assert not Near(1.0, 1e-3).holds((1.0, 1.0))
        assert not Exactly((1.0, 2.0)).holds(1.0)
        assert not Between(0.0, np.inf, "finite").holds(np.inf)
        assert not Falling("one is none").holds(1.0)

    def test_an_error_of_another_kind_is_no_refusal(self):
        assert not Refused(("gap",)).holds(ValueError("gap"))
        assert not Refused(("gap",)).holds(NotConverged("gap"))
        assert not NotSolved(("gap",)).holds(InputError("gap", "-1", "more"))


class TestReport:
    def test_a_line_for_each_scene_of_a_text(self, capsys):
        assert report.main(["flow 99.9"]) == 0
        first, second, total = capsys.readouterr().out.splitlines()
        assert first.startswith("yes ")
        assert first.endswith(
            "flow: 99.9 % in contact, islands of gap: exactly 0, far beyond the threshold; came 0"
        )
        assert re.search(r"one channel: 8.33333e-23 within 1e-09.*; came 8.33333e-23$", second)
        assert total.startswith("2 scenes, none short")

    def test_one_that_falls_short_is_exit_status_1(self, monkeypatch, capsys):
        monkeypatch.setattr(report, "SCENES", (made_up(lambda: 1.0), made_up(lambda: 2.0)))
        assert report.main([]) == 1
        assert "2 scenes, 1 short" in capsys.readouterr().out

    def test_a_text_that_no_scene_has_is_refused(self):
        with pytest.raises(SystemExit) as stopped:
            report.main(["nonsense"])
        assert stopped.value.code == 2

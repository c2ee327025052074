"""Parts of a run in one folder: which items each computes, what it says where others are missing, the same bits."""

import itertools
import os
import random
import re
import signal
import subprocess
import sys
import time
from contextlib import ExitStack

import numpy as np
import pytest
from small_cases import CALIBRATED, CASE, HEAD, ROWS, SWEPT
from test_checkpoint import SIZES, Crash, assert_complete, assert_same, study

import femseal as fs
from femseal.base.errors import PartsMissing
from femseal.base.stage import Stage
from femseal.calibration import calibrating
from femseal.execution import checkpoint, lock, store
from femseal.execution.checkpoint import Checkpoint
from femseal.execution.lock import alone_in
from femseal.execution.parts import parsed_part
from femseal.sweeps.scenes import Scenes

QUICK = CASE.split("[stochastic]")[0].replace('"stochastic"\ncompare = ["deterministic", "two-scale"]', '"two-scale"')
QUICK += '[output]\npictures = false\nreport = false\nbudget = false\nparaview = "none"\n'
#: Exit code of a part that needs others.
WAITS = 3


def computed_by(folder, part, mapper=map, computed=None):
    """Results of the study that a part has a hand in, None where it waits for others."""
    with Checkpoint(folder, {"case": 1}, True, part) as kept:
        try:
            return study(kept.over(mapper), computed)
        except PartsMissing:
            return None


@pytest.mark.parametrize("seed", range(5))
def test_parts_in_any_order_killed_and_run_twice_compute_each_item_once(tmp_path, monkeypatch, seed):
    """In any number; one is ended now and then after some items, of which those in shards are never computed again."""
    rng, computed = random.Random(seed), []
    monkeypatch.setattr(store, "SHARD_ITEMS", 2)
    monkeypatch.setattr(Checkpoint, "__exit__", lambda *a: None)  # as a kill leaves it
    lost = 0

    def crashing(function, *iterables):
        left = rng.randint(1, 8)
        for n, item in enumerate(map(function, *iterables)):
            if n == left:
                raise Crash
            yield item

    results = None
    while results is None:
        parts = rng.choice([1, 2, 3, 16])
        try:
            results = computed_by(tmp_path, (rng.randint(1, parts), parts), crashing, computed)
        except Crash:
            lost += 2  # the item that was under way, and one that was in no shard
    assert_complete(results)
    assert len(computed) <= sum(SIZES) + lost
    with Checkpoint(tmp_path, {"case": 1}, resume=True) as kept:
        assert_complete(study(kept.over(map), again := []))
    assert not again


def test_two_parts_at_once_take_turns_with_every_item(tmp_path):
    """A part begins a stage while the other is within it; each ends with what is missing, and then with all."""
    stage, own = Stage("squares", lambda n: n * n), {1: [], 2: []}

    def items(part, kept):
        def noted(function, values):
            for value in values:
                own[part].append(value)
                yield function(value)

        try:
            yield from kept.over(noted)(stage, range(9))
        except PartsMissing as error:
            yield str(error)

    with (
        Checkpoint(tmp_path, {"case": 1}, True, (1, 2)) as one,
        Checkpoint(tmp_path, {"case": 1}, True, (2, 2)) as two,
    ):
        first, second = items(1, one), items(2, two)
        assert next(first) == "part 1/2: 'squares' needs part 2 of 2; run this part again after them"
        assert list(second) == [n * n for n in range(9)]
    assert own == {1: [0, 1, 2, 3, 4], 2: [5, 6, 7, 8]}
    with Checkpoint(tmp_path, {"case": 1}, True, (1, 2)) as again:
        assert list(items(1, again)) == [n * n for n in range(9)]


def test_a_part_waits_for_parts_that_are_under_way(tmp_path, monkeypatch):
    """It goes on when they have done their items, and ends where one of them ends before."""
    looked, other, stage = [], ExitStack(), Stage("squares", np.square)
    other.enter_context(alone_in(tmp_path, (2, 2)))

    def looking(seconds):
        looked.append(seconds)
        assert len(looked) < 6
        if len(looked) == 3:
            with Checkpoint(tmp_path, {"case": 1}, True, (2, 2)) as its_own:
                assert len(list(its_own.over(map)(stage, range(7)))) == 7
        if len(looked) == 5:
            other.close()

    monkeypatch.setattr(lock, "sleep", looking)
    with alone_in(tmp_path, (1, 2)), Checkpoint(tmp_path, {"case": 1}, True, (1, 2)) as kept:
        mapper = kept.over(map)
        assert list(mapper(stage, range(7))) == [n * n for n in range(7)]
        assert len(looked) == 3
        with pytest.raises(PartsMissing, match="part 1/2: 'cubes' needs part 2 of 2"):
            list(mapper(Stage("cubes", pow), range(7), [3] * 7))
    assert len(looked) == 5


def test_a_damaged_item_of_another_part_is_missing_and_its_own_is_computed_again(tmp_path, caplog):
    while computed_by(tmp_path, (1, 2)) is None:
        computed_by(tmp_path, (2, 2))
    damaged = tmp_path / ".checkpoint/004-000000010-000000020.shard"
    damaged.write_bytes(damaged.read_bytes()[:-1])
    assert computed_by(tmp_path, (1, 2)) is None
    assert f"{damaged} cannot be read" in caplog.text
    assert_complete(computed_by(tmp_path, (2, 2), computed=(computed := [])))
    assert computed == [(3, n) for n in range(10, 20)]


def test_a_long_stage_leaves_few_files(tmp_path, monkeypatch):
    """Shards that are written because time has passed are merged; a kill loses nothing of them."""
    monkeypatch.setattr(store, "SHARD_SECONDS", 0.0)  # each item is written at once
    stage, most = Stage("trial", float), 0
    for stop in (30, 70, None):
        with Checkpoint(tmp_path, {"case": 1}, True) as kept:
            for _ in itertools.islice(kept.over(map)(stage, range(100)), stop):
                most = max(most, len(list(tmp_path.rglob("*.shard"))))
    assert 4 < most < 16
    assert [p.name for p in tmp_path.rglob("*.shard")] == ["001-000000000-000000100.shard"]


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "1/-2", "a/b", "1/2/3", "", "1/1000000"])
def test_a_part_is_a_number_and_how_many_there_are(text):
    assert parsed_part(" 3/16") == (3, 16)
    with pytest.raises(fs.InputError, match=r"part: given .*expected"):
        parsed_part(text)


def test_parts_of_a_run_give_the_bits_of_one_process(tmp_path, femseal):
    (case := tmp_path / "small.toml").write_text(QUICK)
    out = tmp_path / "out"
    whole = fs.run(case, workers=1)
    ended, said = {}, set()
    for n in itertools.cycle((1, 2)):
        code, text, error = femseal("run", case, "-o", out, "--part", f"{n}/2", "--workers", 1)
        if code:
            assert code == WAITS, error
            said.add(error.splitlines()[-1])
        elif ended.setdefault(n, text) and len(ended) == 2:
            break
    assert "femseal: part 1/2: 'flow in pieces' needs part 2 of 2; run this part again after them" in said
    assert "part 2/2: all parts are done" in ended[2]
    assert not (out / "results.nc").exists()
    assert "Traceback" not in (out / "run.log").read_text()
    with pytest.raises(fs.InputError, match="unfinished run"):
        fs.run(case, out, workers=1)
    again = fs.run(case, out, resume=True, workers=1, progress=lambda stage, *a: said.add(stage))
    assert_same(whole.dataset, again.dataset)
    assert not (out / checkpoint.FOLDER).exists()
    assert fs.run(case, out, part=(1, 2), workers=1).dataset.equals(again.dataset)  # there is nothing to do any more
    with pytest.raises(fs.InputError, match=r"part: .*output folder"):
        fs.run(case, part=(1, 2))


def test_a_run_and_parts_exclude_each_other_and_parts_do_not(tmp_path):
    refused = pytest.raises(fs.InputError, match="is under way")
    with alone_in(tmp_path, (1, 3)), alone_in(tmp_path, (2, 3)):
        with refused, alone_in(tmp_path):
            pass
        with refused, alone_in(tmp_path, (2, 3)):
            pass
    with alone_in(tmp_path), refused, alone_in(tmp_path, (1, 3)):
        pass
    with alone_in(tmp_path):
        assert [path.name for path in tmp_path.iterdir()] == [".lock"]


def test_a_sweep_by_parts_runs_each_case_once(tmp_path, contacts):
    (case := tmp_path / "small.toml").write_text(SWEPT + "pictures = false\nreport = false\n")
    keys = {"fluid.viscosity": ["1 mPa*s", "2 mPa*s"]}
    with pytest.raises(fs.InputError, match="part: given 2/4 of 2 cases"):
        fs.sweep(case, keys, tmp_path / "out", part=(2, 4), workers=1)
    for part in ((2, 2), (1, 2)):
        assert len(fs.sweep(case, keys, tmp_path / "out", part=part, workers=1).names) == 1
    assert not (tmp_path / "out/sweep.csv").exists()
    contacts.clear()
    found = fs.sweep(case, keys, tmp_path / "out", resume=True, workers=1)
    assert not contacts
    assert len(found.names) == 2
    assert (tmp_path / "out/sweep.csv").exists()


def test_scenes_by_parts_are_solved_once(tmp_path):
    """As a calibration asks for them: a stage of points, and one of others that are chosen by what is known then."""
    solved, stage = [], Stage("scenes", lambda *point: solved.append(point) or [sum(point)])

    def explored(part=None, resume=True):
        with Scenes(tmp_path, "answer.json", "identity", resume, part) as scenes:
            first = scenes.solve(stage, map, np.arange(10.0).reshape(5, 2))
            return scenes.solve(stage, map, first[:3] * [1, 2])

    with pytest.raises(PartsMissing, match=r"'scenes' needs part 2 of 2"):
        explored((1, 2))
    with pytest.raises(PartsMissing, match=r"'scenes' needs part 1 of 2"):
        explored((2, 2))
    with pytest.raises(fs.InputError, match="unfinished"):
        explored(resume=False)
    whole = explored((1, 2))
    np.testing.assert_array_equal(whole, [[3.0], [15.0], [27.0]])
    np.testing.assert_array_equal(explored(), whole)
    assert len(solved) == len(set(solved)) == 8
    assert [path.name for path in tmp_path.iterdir()] == ["scenes.json"]


def test_a_part_of_a_calibration_waits_for_parts_that_are_under_way(tmp_path, monkeypatch):
    """A run without a part takes what they have solved, also while it begins."""
    stage = Stage("scenes", lambda *point: [sum(point)])
    points = np.arange(10.0).reshape(5, 2)

    def scenes(part=None):
        return Scenes(tmp_path, "answer.json", "identity", True, part)

    whole, second, looked = scenes(), ExitStack(), []
    other = second.enter_context(scenes((2, 2)))

    def looking(seconds):
        looked.append(seconds)
        assert len(looked) == 1
        with second:
            np.testing.assert_array_equal(other.solve(stage, map, points), points.sum(1, keepdims=True))

    monkeypatch.setattr(lock, "sleep", looking)
    with scenes((1, 2)) as one:
        np.testing.assert_array_equal(one.solve(stage, map, points), points.sum(1, keepdims=True))
    assert looked
    (tmp_path / ".unfinished-killed.json").write_text("[")
    with whole:  # it has looked into the folder when nothing was there
        np.testing.assert_array_equal(whole.solve(stage, pytest.fail, points), points.sum(1, keepdims=True))
    assert [path.name for path in tmp_path.iterdir()] == ["scenes.json"]


@pytest.mark.parametrize("seed", range(3))
def test_parts_of_a_calibration_killed_and_run_twice_give_the_bits_of_one_process(tmp_path, monkeypatch, femseal, seed):
    """Each ends now and then after some scenes, as a kill ends it; what it had solved is not solved again."""
    (case := tmp_path / "case.toml").write_text(CALIBRATED)
    (test := tmp_path / "test.csv").write_text(HEAD + ROWS)
    rng, solved, left = random.Random(seed), [], [0]

    def leakage(case, unit, steps, hardness, shortest_wave):
        if left[0] == 0:
            raise Crash
        left[0] -= 1
        solved.append((hardness, shortest_wave))
        return [1e-13 * hardness * shortest_wave / n**3 for n in range(1, len(steps) + 1)]

    monkeypatch.setattr(calibrating, "_leakage", leakage)
    said, options = set(), {"scenes": 26, "workers": 1}
    left[0] = 1000
    whole = fs.calibrate(case, test, **options)
    solved.clear()
    ended = set()
    while len(ended) < 3:
        n, left[0] = rng.randint(1, 3), rng.randint(1, 6)
        try:
            arguments = ["--part", f"{n}/3", "--workers", 1, "--scenes", 26, "--quiet"]
            code, _, error = femseal("calibrate", case, test, "-o", tmp_path / "out", *arguments)
        except Crash:
            continue
        assert code in (0, WAITS), error
        if code == 0:
            ended.add(n)
        else:
            said.add(error.splitlines()[-1])
    line = r"femseal: part \d/3: 'scenes' needs (part \d|parts \d, \d) of 3; run this part again after them"
    assert said
    assert all(re.fullmatch(line, text) for text in said)
    assert not (tmp_path / "out/calibration.json").exists()
    left[0] = 0  # there is nothing to solve any more
    again = fs.calibrate(case, test, tmp_path / "out", resume=True, **options)
    assert len(solved) == len(set(solved)) == len(whole.scenes)
    np.testing.assert_array_equal(again.samples, whole.samples)
    np.testing.assert_array_equal(again.leakages, whole.leakages)


def test_a_sweep_goes_on_after_a_part_that_was_killed_and_never_came_back(tmp_path, contacts, monkeypatch):
    (case := tmp_path / "small.toml").write_text(SWEPT + "pictures = false\nreport = false\n")
    keys = {"material.hardness": ["3 GPa", "6 GPa"]}
    options = {"workers": 1}
    whole = fs.sweep(case, keys, tmp_path / "whole", **options)
    every = len(contacts)
    contacts.clear()
    monkeypatch.setattr(store, "SHARD_ITEMS", 1)

    def killed(stage, done, total):
        if stage == "stochastic: contact of the whole face" and done == 1:
            raise Crash

    with monkeypatch.context() as patch:
        patch.setattr(Checkpoint, "__exit__", lambda *a: None)  # as a kill leaves it
        with pytest.raises(Crash):
            fs.sweep(case, keys, tmp_path / "out", part=(2, 2), progress=killed, **options)
    fs.sweep(case, keys, tmp_path / "out", part=(1, 2), **options)
    fs.sweep(case, keys, tmp_path / "out", part=(1, 2), **options)
    again = fs.sweep(case, keys, tmp_path / "out", resume=True, **options)
    assert len(contacts) == every
    for one, other in zip(whole.runs, again.runs, strict=True):
        assert_same(one.dataset, other.dataset)
    assert (tmp_path / "out/sweep.csv").read_bytes() == (tmp_path / "whole/sweep.csv").read_bytes()
    assert not list((tmp_path / "out").rglob(".*"))


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal")
@pytest.mark.parametrize("command", ["run", "sweep", "calibrate"])
def test_three_parts_at_once_that_are_killed_now_and_then_give_the_bits_of_one_process(tmp_path, command):
    rng = random.Random(command)
    (test := tmp_path / "test.csv").write_text(HEAD + ROWS.replace("sealed", "1e-7"))
    larger = SWEPT.replace("realisations = 4", "realisations = 300")
    content = {"run": QUICK, "sweep": larger + "pictures = false\nreport = false\n", "calibrate": CALIBRATED}[command]
    (case := tmp_path / "case.toml").write_text(content)
    more = {"run": [], "sweep": ["material.hardness=3GPa,4GPa,6GPa"], "calibrate": [test, "--scenes", 26]}[command]
    written = {"run": "table.csv", "sweep": "sweep.csv", "calibrate": "calibration.json"}[command]

    def started(out, *arguments):
        line = [sys.executable, "-m", "femseal", command, case, *more, "-o", tmp_path / out, "--workers", 1, *arguments]
        options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        return subprocess.Popen([*map(str, line)], **options, start_new_session=True)

    def ended(process):
        return process.communicate()[1], process.returncode

    error, code = ended(started("whole"))
    assert code == 0, error
    running, done, kills, codes = {}, set(), 0, set()
    while len(done) < 3:
        for n in {1, 2, 3} - done - running.keys():
            running[n] = started("out", "--part", f"{n}/3"), time.monotonic() + rng.uniform(1, 6)
        for n, (process, end) in list(running.items()):
            if process.poll() is None and kills < 6 and time.monotonic() > end:
                os.killpg(process.pid, signal.SIGKILL)
                kills += 1
            elif process.poll() is None:
                continue
            error, code = ended(running.pop(n)[0])
            codes.add(code)
            assert code in (0, WAITS, -signal.SIGKILL), error
            done |= {n} if code == 0 else set()
        time.sleep(0.05)
    assert {0, -signal.SIGKILL} <= codes
    error, code = ended(started("out", "--resume"))
    assert code == 0, error
    assert (tmp_path / "out" / written).read_bytes() == (tmp_path / "whole" / written).read_bytes()
    for path in (tmp_path / "whole").rglob("results.nc"):
        one, other = (
            fs.open_results(tmp_path / f / path.parent.relative_to(tmp_path / "whole")) for f in ("whole", "out")
        )
        assert_same(one.dataset, other.dataset)
    assert not list((tmp_path / "out").rglob(".*"))

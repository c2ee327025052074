"""Parts of a run in one folder: which items each computes, what it says where others are missing, the same bits."""

import itertools
import os
import random
import signal
import subprocess
import sys
import time
from contextlib import ExitStack

import numpy as np
import pytest
from kept_study import EVERY, Crash, assert_complete, study
from small_cases import CALIBRATED, CASE, HEAD, ROWS, SWEPT
from test_checkpoint import assert_same

import femseal as fs
from femseal.base import PartsMissing, Stage
from femseal.execution.resuming import alone_in, over_store, parsed_part
from femseal.execution.run import no_progress
from femseal.store.store import Store

QUICK = CASE.split("[stochastic]")[0].replace(
    '"stochastic"\ncompare = ["deterministic", "two-scale"]', '"two-scale"'
)
QUICK += '[output]\npictures = false\nreport = false\nbudget = false\nparaview = "none"\n'
#: Exit code of a part that needs others.
WAITS = 3


def of_part(store, folder, part, mapper=map):
    return over_store(mapper, store, folder, part, no_progress)


def computed_by(folder, part, mapper=map, computed=None):
    """Results of the study that a part has a hand in, None where it waits for others."""
    with Store(folder) as store:
        try:
            return study(of_part(store, folder, part, mapper), computed)
        except PartsMissing:
            return None


@pytest.mark.parametrize("seed", range(5))
def test_parts_in_any_order_killed_and_run_twice_compute_each_item_once(
    tmp_path, monkeypatch, seed
):
    """In any number; one is ended now and then after some items."""
    rng, computed = random.Random(seed), []
    monkeypatch.setattr(Store, "__exit__", lambda *a: None)  # as a kill leaves it
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
            lost += 1  # the item that was under way
    assert_complete(results)
    assert len(computed) <= len(EVERY) + lost
    with Store(tmp_path) as store:
        assert_complete(study(store.over(map), again := []))
    assert not again


def test_a_part_waits_for_parts_that_are_under_way(tmp_path, monkeypatch):
    """It goes on when they have done their items, and ends where one of them ends before."""
    looked, other, stage = [], ExitStack(), Stage("squares", np.square)
    other.enter_context(alone_in(tmp_path, (2, 2)))

    def looking(seconds):
        looked.append(seconds)
        assert len(looked) < 6
        if len(looked) == 3:
            with Store(tmp_path) as its_own:
                assert len(list(of_part(its_own, tmp_path, (2, 2))(stage, range(7)))) == 7
        if len(looked) == 5:
            other.close()

    monkeypatch.setattr("femseal.execution.resuming.sleep", looking)
    with alone_in(tmp_path, (1, 2)), Store(tmp_path) as store:
        mapper = of_part(store, tmp_path, (1, 2))
        assert list(mapper(stage, range(7))) == [n * n for n in range(7)]
        assert len(looked) == 3
        with pytest.raises(PartsMissing, match="part 1/2: 'cubes' needs part 2 of 2"):
            list(mapper(Stage("cubes", np.power), range(7), [3] * 7))
    assert len(looked) == 5
    # of two others one is under way, and one is not
    with alone_in(tmp_path, (1, 3)), alone_in(tmp_path, (2, 3)), Store(tmp_path) as store:
        mapper = of_part(store, tmp_path, (1, 3))
        with pytest.raises(PartsMissing, match="part 1/3: 'roots' needs parts 2, 3 of 3"):
            list(mapper(Stage("roots", np.sqrt), range(9)))


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
    needed = "'pieces of the face' needs part 2 of 2; run this part again after them"
    assert f"femseal: part 1/2: {needed}" in said
    assert "part 2/2: all parts are done" in ended[2]
    assert not (out / "results.nc").exists()
    with pytest.raises(fs.InputError, match="unfinished run"):
        fs.run(case, out, workers=1)
    again = fs.run(case, out, resume=True, workers=1)
    assert_same(whole.dataset, again.dataset)
    assert not (out / ".checkpoint").exists()
    # there is nothing to do any more
    assert fs.run(case, out, part=(1, 2), workers=1).dataset.equals(again.dataset)
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


@pytest.mark.parametrize("seed", range(3))
def test_parts_of_a_calibration_killed_and_run_twice_give_the_bits_of_one_process(
    tmp_path, monkeypatch, femseal, seed
):
    """Each ends now and then after some scenes, as a kill ends it; what it had solved is not solved again."""
    (case := tmp_path / "case.toml").write_text(CALIBRATED)
    (test := tmp_path / "test.csv").write_text(HEAD + ROWS)
    rng, solved, left = random.Random(seed), [], [1000]

    def leakage(case, unit, steps, hardness, shortest_wave):
        if left[0] == 0:
            raise Crash
        left[0] -= 1
        solved.append((hardness, shortest_wave))
        return [1e-13 * hardness * shortest_wave / n**3 for n in range(1, len(steps) + 1)]

    monkeypatch.setattr("femseal.calibration.calibrating._leakage", leakage)
    options = {"scenes": 26, "workers": 1}
    whole = fs.calibrate(case, test, **options)
    solved.clear()
    ended, codes = set(), set()
    while len(ended) < 3:
        n, left[0] = rng.randint(1, 3), rng.randint(1, 6)
        try:
            arguments = ["--part", f"{n}/3", "--workers", 1, "--scenes", 26, "--quiet"]
            code, _, error = femseal("calibrate", case, test, "-o", tmp_path / "out", *arguments)
        except Crash:
            continue
        codes.add(code)
        ended |= set() if code else {n}
    assert codes == {0, WAITS}, error
    assert not (tmp_path / "out/calibration.json").exists()
    left[0] = 0  # there is nothing to solve any more
    again = fs.calibrate(case, test, tmp_path / "out", resume=True, **options)
    assert len(solved) == len(set(solved)) == len(whole.scenes)
    np.testing.assert_array_equal(again.samples, whole.samples)
    np.testing.assert_array_equal(again.leakages, whole.leakages)


def test_a_sweep_by_parts_runs_each_case_once_also_after_a_kill(tmp_path, contacts, monkeypatch):
    (case := tmp_path / "small.toml").write_text(SWEPT + "pictures = false\nreport = false\n")
    keys, out = {"material.hardness": ["3 GPa", "6 GPa"]}, tmp_path / "out"
    with pytest.raises(fs.InputError, match="part: given 2/4 of 2 cases"):
        fs.sweep(case, keys, out, part=(2, 4), workers=1)
    whole = fs.sweep(case, keys, tmp_path / "whole", workers=1)
    every = len(contacts)
    contacts.clear()

    def killed(stage, done, total):
        if stage == "stochastic: contact of the whole face" and done == 1:
            raise Crash

    with monkeypatch.context() as patch:
        patch.setattr(Store, "__exit__", lambda *a: None)  # as a kill leaves it
        with pytest.raises(Crash):
            fs.sweep(case, keys, out, part=(2, 2), progress=killed, workers=1)
    for _ in range(2):
        assert len(fs.sweep(case, keys, out, part=(1, 2), workers=1).names) == 1
    assert not (out / "sweep.csv").exists()
    again = fs.sweep(case, keys, out, resume=True, workers=1)
    assert len(contacts) == every
    for one, other in zip(whole.runs, again.runs, strict=True):
        assert_same(one.dataset, other.dataset)
    assert (out / "sweep.csv").read_bytes() == (tmp_path / "whole/sweep.csv").read_bytes()
    assert not list(out.rglob(".*"))


LARGER = SWEPT.replace("realisations = 4", "realisations = 300")


#: A command, its case, what it is told besides, and what it writes.
COMMANDS = {
    "run": (QUICK, [], "table.csv"),
    "sweep": (
        LARGER + "pictures = false\nreport = false\n",
        ["material.hardness=3GPa,4GPa,6GPa"],
        "sweep.csv",
    ),
    "calibrate": (CALIBRATED, ["test.csv", "--scenes", "26"], "calibration.json"),
}


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal")
@pytest.mark.parametrize("command", COMMANDS)
def test_three_parts_at_once_that_are_killed_now_and_then_give_the_bits_of_one_process(
    tmp_path, command
):
    rng, (content, more, written) = random.Random(command), COMMANDS[command]
    (tmp_path / "test.csv").write_text(HEAD + ROWS.replace("sealed", "1e-7"))
    (tmp_path / "case.toml").write_text(content)

    def started(out, *arguments):
        line = ["-m", "femseal", command, "case.toml", *more, "-o", out, "--workers", "1"]
        options = {"cwd": tmp_path, "stdout": subprocess.DEVNULL, "start_new_session": True}
        return subprocess.Popen([sys.executable, *line, *arguments], **options)

    begun = time.monotonic()
    assert started("whole").wait() == 0
    took = time.monotonic() - begun
    running, done, kills, codes = {}, set(), 0, set()
    while len(done) < 3:
        for n in {1, 2, 3} - done - running.keys():
            end = time.monotonic() + took * rng.uniform(0.2, 0.6)
            running[n] = started("out", "--part", f"{n}/3"), end
        for n, (process, end) in list(running.items()):
            if process.poll() is None and kills < 6 and time.monotonic() > end:
                os.killpg(process.pid, signal.SIGKILL)
                kills += 1
                process.wait()
            if process.poll() is not None:
                del running[n]
                codes.add(process.returncode)
                done |= {n} if process.returncode == 0 else set()
        time.sleep(0.05)
    assert {0, -signal.SIGKILL} <= codes <= {0, WAITS, -signal.SIGKILL}
    assert started("out", "--resume").wait() == 0
    whole, out = tmp_path / "whole", tmp_path / "out"
    assert (out / written).read_bytes() == (whole / written).read_bytes()
    for path in whole.rglob("results.nc"):
        other = out / path.parent.relative_to(whole)
        assert_same(fs.open_results(path.parent).dataset, fs.open_results(other).dataset)
    assert {p.name for p in out.rglob(".*")} == {p.name for p in whole.rglob(".*")}

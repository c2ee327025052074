"""Runs that are ended and go on: which items are kept, what is refused, and the same bits in the end."""

import errno
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from ended_runs import assert_same_results, processes_of, run_processes, stop_at, wait_until
from small_cases import CASE, HANG

import femseal as fs
from femseal.base import numerical_versions
from femseal.store.store import Store

#: No more results come before those of the drawn seals.
MOST_OTHERS = 40


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(CASE)
    return path


def measured(case, factor=1.0):
    """The case with a face read from a file."""
    size = (3e-5, 3e-5)
    face = fs.self_affine((32, 32), size, hurst=0.8, rms_slope=0.2, roll_off=2e-5, rng=1)
    np.save(case.parent / "face.npy", factor * face.heights)
    table = 'kind = "file"\npath = "face.npy"\nheight_unit = "m"\nsize = ["30 um", "30 um"]\n'
    return re.sub(r'(?s)kind = "self-affine".*?(?=\[material\])', table, CASE)


ALONE = CASE.replace('compare = ["deterministic", "two-scale"]\n', "")


#: Nothing is written but results and tables.
QUIET = '[output]\npictures = false\nreport = false\nparaview = "none"\n'
RESUMED = {"resume": True, "workers": 1}


def full(*args, **kwargs):
    raise OSError(errno.ENOSPC, "full")


class Crash(BaseException):
    pass


# --- runs ----------------------------------------------------------------------------------------------------------


def test_a_resumed_run_gives_the_same_bits_and_leaves_no_checkpoint(
    case, tmp_path, monkeypatch, contacts
):
    whole = fs.run(case, workers=1)
    out, stages = tmp_path / "out", []
    for stage, item in (
        ("two-scale: contact of the whole face", 1),
        ("two-scale: cells of the face", 2),
        ("stochastic: realisations", 11),
    ):
        with pytest.raises(KeyboardInterrupt):
            fs.run(case, out, **RESUMED, progress=stop_at(stage, item))
        assert not (out / "results.nc").exists()
    with monkeypatch.context() as patch:
        patch.setattr("femseal.runs.job.write_folder", full)
        with pytest.raises(fs.FemsealError, match=r"full.*--resume"):
            fs.run(case, out, **RESUMED)
    contacts.clear()
    for flow in (
        "femseal.face.cell_flow.cell_permeability",
        "femseal.face.cell_flow.cell_flow",
    ):
        monkeypatch.setattr(flow, lambda *_, **__: pytest.fail("computed again"))
    again = fs.run(case, out, **RESUMED, progress=lambda *a: stages.append(a))
    assert not contacts
    assert_same_results(whole.dataset, again.dataset)
    assert not (out / ".checkpoint").exists()
    assert "stopped (KeyboardInterrupt)" in (out / "run.log").read_text()
    assert ("stochastic: realisations", 24, 24) in stages


#: What a run does besides its studies, as top-level keys: an accuracy, the budget.
BESIDES = {"accuracy": 'accuracy = "3 %"', "budget": 'method = "deterministic"'}


def case_with(besides, path):
    """A case of a whole face that does the one or the other besides its study, without pictures."""
    loads = ", ".join(f'"{n} MPa"' for n in (50, 100, 200, 300))
    text = ALONE.replace('method = "stochastic"', BESIDES[besides]).split("[contact]")[0]
    text = text.replace('loading = ["100 MPa", "300 MPa"]', f"loading = [{loads}]")
    path.write_text(text.replace("[32, 32]", "[64, 64]") + QUIET)
    return path


#: Runs that are killed where the first item of a stage is done, or where the table has been moved to its place: each is
#: forked from this process, which has loaded all that a run needs, and what it left is printed.
KILLED = """
import json, os, signal, sys
from pathlib import Path
import femseal as fs
def run(case, out, moment):
    moved = os.replace
    def moving(source, target):
        moved(source, target)
        if moment == "files" and Path(target) == Path(out) / "table.csv":
            os.kill(os.getpid(), signal.SIGKILL)
    def progress(stage, done, total):
        if stage.startswith(moment + ": ") and done:
            os.kill(os.getpid(), signal.SIGKILL)
    os.replace = moving
    fs.run(case, out, resume=True, workers=1, progress=progress)
for case, out, moments in json.loads(sys.argv[1]):
    fs.run(case, workers=1)
    for moment in moments:
        child = os.fork()
        if child == 0:
            try:
                run(case, out, moment)
            finally:
                os._exit(0)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), (Path(out) / "results.nc").exists())
"""
MOMENTS = {
    "accuracy": ["attempt 1, error budget", "attempt 2", "files"],
    "budget": ["error budget", "files"],
}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks")
def test_a_run_killed_outside_its_studies_resumes_with_the_same_numbers(tmp_path):
    files = {name: case_with(name, tmp_path / f"{name}.toml") for name in BESIDES}
    kills = [[str(file), str(tmp_path / name), MOMENTS[name]] for name, file in files.items()]
    command = [sys.executable, "-c", KILLED, json.dumps(kills)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG)
    assert done.returncode == 0, done.stderr
    every = sum(map(len, MOMENTS.values()))
    assert done.stdout.splitlines() == [f"{-signal.SIGKILL} False"] * every, done.stderr
    for name, file in files.items():
        whole = fs.run(file, tmp_path / f"{name} whole", workers=1).dataset
        again = fs.run(file, tmp_path / name, **RESUMED).dataset
        if name == "accuracy":
            whole, again = without_times(whole), without_times(again)
        assert_same_results(whole, again)
        assert not (tmp_path / name / ".checkpoint").exists()


#: A run whose states lie on disk, killed when the first of them is solved.
ON_DISK = """
import os, signal, sys
import femseal as fs
from femseal.base import shared_arrays
shared_arrays.PART_OF_MEMORY = 0
def progress(stage, done, total):
    if stage.endswith("contact of the whole face") and done:
        os.kill(os.getpid(), signal.SIGKILL)
fs.run(sys.argv[1], sys.argv[2], workers=1, progress=progress)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal")
@pytest.mark.parametrize(
    ("method", "workers"),
    [("deterministic", 1), ("two-scale", 2)],
)
@pytest.mark.slow
def test_states_on_disk_resume_from_the_last_one_with_the_same_bits(
    case, tmp_path, monkeypatch, method, workers
):
    text = ALONE.replace('"stochastic"', f'"{method}"', 1).partition("[stochastic]")[0]
    case.write_text(text + "[output]\npictures = false\nreport = false\n")
    out = tmp_path / "out"
    done = subprocess.run([sys.executable, "-c", ON_DISK, str(case), str(out)], timeout=HANG)
    assert done.returncode == -signal.SIGKILL
    assert {path.name for path in out.iterdir()} <= {".checkpoint", "run.log", ".lock"}
    assert len(Store(out / ".checkpoint")) == 1
    whole = fs.run(case, tmp_path / "whole", workers=1)
    monkeypatch.setattr("femseal.base.shared_arrays.PART_OF_MEMORY", 0)
    again = fs.run(case, out, resume=True, workers=workers)
    assert_same_results(whole.dataset, again.dataset)
    for one, other in ((whole, again), (fs.open_results(tmp_path / "whole"), fs.open_results(out))):
        for name in ("gap", "contact_pressure", "fluid_pressure"):
            for step in range(len(whole.steps)):
                np.testing.assert_array_equal(one.pixels(name, step), other.pixels(name, step))
    assert isinstance((again.deterministic or again.two_scale).gap, np.memmap)


def without_times(dataset):
    """The results without the times of the attempts."""
    told = json.loads(dataset.attrs["accuracy"])
    for attempt in told["attempts"]:
        del attempt["seconds"]
    told["half_error"] = told["half_error"].split(", about")[0]
    return dataset.assign_attrs(accuracy=json.dumps(told))


@pytest.mark.parametrize(
    ("stage", "besides"), [("attempt 2", "accuracy"), ("error budget", "budget")]
)
def test_a_full_disk_in_an_attempt_or_a_budget_stops_the_run(tmp_path, monkeypatch, stage, besides):
    """They go on without what fails to be computed, but such a result would be taken for complete later."""
    file = case_with(besides, tmp_path / "small.toml")
    with monkeypatch.context() as patch:

        def progress(name, done, total):
            if name.startswith(stage + ": "):
                patch.setattr(Store, "_append", full)

        with pytest.raises(fs.FemsealError, match=r"full.*make room.*--resume"):
            fs.run(file, tmp_path / "out", workers=1, progress=progress)
    assert not (tmp_path / "out/results.nc").exists()
    found = fs.run(file, tmp_path / "out", **RESUMED)
    np.testing.assert_array_equal(found.leakage.values, fs.run(file, workers=1).leakage.values)


@pytest.mark.parametrize(
    "moved",
    [
        "files.txt",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("table.csv", "leakage.png")),
    ],
)
def test_a_kill_while_other_files_are_rewritten_leaves_the_results(tmp_path, monkeypatch, moved):
    """There is no checkpoint of complete results, so that they would be lost."""
    file, out = case_with("budget", tmp_path / "small.toml"), tmp_path / "out"
    before = fs.run(file, out, workers=1)
    file.write_text(file.read_text().replace("pictures = false", "pictures = true"))
    replace = os.replace

    def killed(source, target):
        replace(source, target)
        if Path(target) == out / moved:
            raise Crash

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", killed)
        with pytest.raises(Crash):
            fs.run(file, out, **RESUMED)
    np.testing.assert_array_equal(fs.open_results(out).leakage.values, before.leakage.values)
    fs.run(file, out, **RESUMED, progress=lambda *a: pytest.fail("computed again"))
    assert (out / "leakage.png").exists()
    listed = {out / name for name in (out / "files.txt").read_text().split()}
    unlisted = {out / "files.txt", out / "run.log"}
    assert listed == {p for p in out.rglob("*") if p.is_file()} - unlisted


def test_an_unfinished_run_is_not_lost_to_one_without_resume(case, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        fs.run(case, out, workers=1, progress=stop_at("two-scale: cells of the face", 1))
    before = {p: p.stat().st_mtime_ns for p in out.rglob("*")}
    with pytest.raises(fs.InputError, match=r"which holds an unfinished run, expected --resume"):
        fs.run(case, out, workers=1)
    assert {p: p.stat().st_mtime_ns for p in out.rglob("*")} == before


def test_a_changed_case_file_or_version_is_refused_by_name(case, tmp_path, monkeypatch):
    text = measured(case)
    case.write_text(text)
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        fs.run(case, out, workers=1, progress=stop_at("stochastic: realisations", 1))

    def refusal():
        before = {p: p.stat().st_mtime_ns for p in out.rglob("*")}
        with pytest.raises(fs.InputError, match="resume") as caught:
            fs.run(case, out, **RESUMED)
        assert {p: p.stat().st_mtime_ns for p in out.rglob("*")} == before
        return sorted(str(caught.value).splitlines()[1:])

    softer = text.replace('hardness = "3 GPa"', 'yield_stress = "1 GPa"')
    case.write_text(softer.replace('"300 MPa"', '"200 MPa"'))
    assert refusal() == [
        "load.loading: was [100000000.0, 300000000.0], is [100000000.0, 200000000.0]",
        "load.unload_from: was [300000000.0], is [200000000.0]",
        "material.hardness: was 3000000000.0, is not given",
        "material.yield_stress: was not given, is 1000000000.0",
    ]
    case.write_text(text)
    with monkeypatch.context() as patch:
        other = numerical_versions() | {"numpy": "9.9"}
        patch.setattr("femseal.runs.identity.numerical_versions", lambda: other)
        assert refusal() == [f"version.numpy: was {np.__version__}, is 9.9"]
    measured(case, 1.01)
    (line,) = refusal()
    assert line.startswith("content of face files.face.npy: was ")
    (out / ".checkpoint/manifest.json").write_text("{")
    refusal()


def test_results_of_another_surface_file_are_not_reused(case, tmp_path):
    text = measured(case).replace('"stochastic"', '"deterministic"', 1)
    case.write_text(text.replace('compare = ["deterministic", "two-scale"]', ""))
    calls, leakages = [], []
    for factor, computed in ((1.0, True), (1.0, False), (1.1, True)):
        measured(case, factor)
        calls.clear()
        results = fs.run(case, tmp_path / "out", **RESUMED, progress=lambda *a: calls.append(a))
        leakages.append(results.leakage.values[0])
        assert bool(calls) == computed
    assert leakages[0] == leakages[1] != leakages[2]


def test_a_run_resumes_between_batches_of_realisations(case, tmp_path):
    """As many seals as the band needs: which, the seals before decide."""
    case.write_text(ALONE.replace("realisations = 24\n", "").replace('"200 um"', '"30 um"'))
    done = fs.run(case, tmp_path / "whole", workers=1).dataset
    assert done.sizes["realisation"] > 3
    batches = []

    def stop(stage, number, total):
        if stage == "stochastic: realisations" and number == 0:
            batches.append(total)
            if len(batches) == 2:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fs.run(case, tmp_path / "out", workers=1, progress=stop)
    assert_same_results(fs.run(case, tmp_path / "out", **RESUMED).dataset, done)


# --- signals -------------------------------------------------------------------------------------------------------


@pytest.fixture
def start_run():
    """A function that starts `femseal run` in a process group of its own; the groups end with the test at the latest."""
    with run_processes() as start:
        yield start


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
@pytest.mark.parametrize(
    ("arguments", "sent"),
    [
        (["--workers", "2"], signal.SIGINT),
        pytest.param(["--workers", "2"], signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param(["--workers", "1"], signal.SIGINT, marks=pytest.mark.slow),
        pytest.param(
            ["--workers", "2", "--scheduler", "local"], signal.SIGINT, marks=pytest.mark.slow
        ),
    ],
)
def test_ctrl_c_ends_the_workers_and_says_how_to_resume(case, start_run, tmp_path, arguments, sent):
    case.write_text(ALONE.replace("realisations = 24", "realisations = 100000"))
    out = tmp_path / "out"
    process = start_run(case, out, "--log-file", tmp_path / "lines.log", *arguments)
    wait_until(lambda: len(Store(out / ".checkpoint")) > MOST_OTHERS or process.poll() is not None)
    assert process.poll() is None, process.stderr.read()
    os.killpg(process.pid, sent)
    lines = process.communicate(timeout=HANG)[1].splitlines()
    assert process.returncode == 1
    assert lines[-1] == f"femseal: stopped; `femseal run {case} -o {out} --resume` continues it"
    # trackers end when they see that the others have
    wait_until(lambda: not processes_of(process.pid))
    assert "was stopped (KeyboardInterrupt)" in (tmp_path / "lines.log").read_text()


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
@pytest.mark.slow
def test_processes_end_with_their_parent(case, start_run, tmp_path, monkeypatch):
    """Also where it is killed, so that it cannot end them; they remove the files by which it sent its stages."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    case.write_text(CASE.replace("realisations = 24", "realisations = 100000"))
    process = start_run(case, tmp_path / "out", "--workers", "2")
    kept = tmp_path / "out/.checkpoint"
    wait_until(lambda: len(Store(kept)) > MOST_OTHERS or process.poll() is not None)
    assert len(processes_of(process.pid)) > 2
    assert list(tmp_path.glob("femseal-*"))
    process.kill()
    wait_until(lambda: not processes_of(process.pid))
    assert not list(tmp_path.glob("femseal-*"))


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_runs_killed_at_random_moments_resume_with_the_same_bits(
    case, start_run, tmp_path, workers
):
    rng = random.Random(workers)
    case.write_text(CASE.replace("realisations = 24", "realisations = 400"))
    begin = time.perf_counter()
    assert start_run(case, tmp_path / "whole", "--workers", workers).wait() == 0
    seconds = time.perf_counter() - begin
    whole, out, kills = fs.open_results(tmp_path / "whole").dataset, tmp_path / "out", 0
    for _ in range(2):
        for left in range(5, -1, -1):
            process = start_run(case, out, "--resume", "--workers", workers)
            try:
                process.wait(timeout=rng.uniform(0.2, 0.9) * seconds if left else None)
                break
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
                kills += 1
        assert process.returncode == 0, process.stderr.read()
        assert_same_results(whole, fs.open_results(out).dataset)
        assert not (out / ".checkpoint").exists()
        shutil.rmtree(out)
    assert kills > 1

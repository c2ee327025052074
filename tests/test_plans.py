"""Plans of transforms are the same in every process: kept in a folder, carried by half-spaces and by checkpoints."""

import hashlib
import os
import pickle
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyfftw
import pytest
from joblib.externals.loky import get_reusable_executor
from test_checkpoint import CASE, assert_same, stop_at

import femseal as fs
from femseal.contact import plans
from femseal.contact.grid import nested_grids
from femseal.contact.plans import Transform

BODIES = [((n, n), (1e-6, 1e-6), 115e9, kind) for n, kind in ((96, "mirror"), (96, "free"), (256, "periodic"))]
TRANSFORM = Transform((12, 20), (0, 1), "float64")


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """No plan is known, in this process or in the folder; the list of what is measured."""
    monkeypatch.setenv("FEMSEAL_CACHE", str(tmp_path / "cache"))
    measured, measure = [], Transform.measured
    monkeypatch.setattr(Transform, "measured", lambda self: measured.append(self.name) or measure(self))
    forget()
    yield measured
    forget()


def forget():
    plans._own.clear()
    plans._warn_once.cache_clear()
    nested_grids.cache_clear()


def digest(half_space):
    """Of a contact with hardness and of the plain response."""
    size = tuple(n * d for n, d in zip(half_space.shape, half_space.spacing, strict=True))
    face = fs.self_affine(half_space.shape, size, hurst=0.8, rms_slope=0.2, roll_off=size[0] / 2, rng=1)
    contact = fs.solve_contact(-face.heights, half_space, pressure=3e8, hardness=4e9)
    parts = contact.pressure, contact.gap, half_space.displacement(face.heights)
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()


def digests_elsewhere(cache, bodies, **environment):
    """As a process of its own computes them, which must not measure."""
    code = (
        "import pickle, sys; sys.path.insert(0, sys.argv[1]); import test_plans as t\n"
        "t.Transform.measured = None\n"
        "bodies = pickle.load(sys.stdin.buffer)\n"
        "print([t.digest(b if isinstance(b, t.fs.HalfSpace) else t.fs.HalfSpace(*b)) for b in bodies])"
    )
    command = [sys.executable, "-c", code, str(Path(__file__).parent)]
    environment = os.environ | {"FEMSEAL_CACHE": str(cache)} | environment
    return subprocess.run(command, env=environment, input=pickle.dumps(bodies), stdout=subprocess.PIPE, check=True)


def test_every_process_computes_the_same_bits(fresh, tmp_path):
    """What this one measures others find in the folder, or with a half-space where there is no folder."""
    here = f"{[digest(fs.HalfSpace(*body)) for body in BODIES]}\n".encode()
    assert len(fresh) == len(set(fresh)) > 5
    assert digests_elsewhere(tmp_path / "cache", BODIES).stdout == here
    carried = pickle.loads(pickle.dumps([fs.HalfSpace(*body) for body in BODIES]))
    assert carried == [fs.HalfSpace(*body) for body in BODIES]
    (tmp_path / "file").touch()
    assert digests_elsewhere(tmp_path / "file" / "none", carried).stdout == here


@pytest.mark.slow
def test_the_process_that_compiles_computes_the_same_bits(fresh, tmp_path):
    here = f"{[digest(fs.HalfSpace(*body)) for body in BODIES]}\n".encode()
    for _ in range(2):
        there = digests_elsewhere(tmp_path / "cache", BODIES, NUMBA_CACHE_DIR=str(tmp_path / "compiled"))
        assert there.stdout == here


def planned(transform, given=()):
    points, waves = transform.scratch()
    forward, inverse = plans.planned(transform, points, waves, points, given)
    points[:] = np.random.default_rng(1).standard_normal(points.shape)
    forward.execute()
    there = waves.tobytes()
    inverse.execute()
    return there + points.tobytes()


@pytest.mark.parametrize("dtype", ["float64", "float32", "complex128", "complex64"])
@pytest.mark.parametrize(("shape", "axes"), [((24, 24), (0, 1)), ((96, 64), (0,)), ((100, 96), (1,))])
@pytest.mark.parametrize("threads", [1, 2])
def test_plans_made_again_give_the_same_bits(fresh, dtype, shape, axes, threads):
    transform = Transform(shape, axes, dtype, threads)
    if not dtype.startswith("complex") and axes == (0,):
        axes = (1,)  # waves of real points are along the last axis
        transform = Transform(shape, axes, dtype, threads)
    once = planned(transform)
    assert fresh == [transform.name]
    assert planned(transform) == once
    forget()
    assert planned(transform) == once
    assert fresh == [transform.name]


def test_other_wisdom_is_neither_used_nor_lost(fresh):
    others = pyfftw.empty_aligned((7, 101)), pyfftw.empty_aligned((7, 51), dtype=complex)
    pyfftw.FFTW(*others, (0, 1), "FFTW_FORWARD", ("FFTW_MEASURE",))
    before = pyfftw.export_wisdom()[0].splitlines()
    planned(TRANSFORM)
    assert sorted(pyfftw.export_wisdom()[0].splitlines()) == sorted(before)
    header, *entries, end = plans.known()[TRANSFORM.name].encode().splitlines()
    assert entries
    assert set(before) & {header, *entries, end} == {header, end}


@pytest.mark.parametrize("damage", ["cut", "flip", "checksum", "empty", "binary", "another's"])
def test_damaged_wisdom_is_measured_again(fresh, tmp_path, damage):
    planned(TRANSFORM)
    (path,) = tmp_path.rglob("*.wisdom")
    data = path.read_bytes()
    forget()
    if damage == "another's":
        planned(Transform((20, 12), (0, 1), "float64"))
        (other,) = set(tmp_path.rglob("*.wisdom")) - {path}
        shutil.copy(other, path)
    else:
        middle = len(data) // 2
        flipped = data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]
        contents = {
            "cut": data[:middle],
            "flip": flipped,
            "checksum": b"0" * 64 + data[64:],
            "empty": b"",
            "binary": b"\xff\xfe" * 99,
        }
        path.write_bytes(contents[damage])
    fresh.clear()
    once = planned(TRANSFORM)
    assert fresh == [TRANSFORM.name]
    forget()
    assert planned(TRANSFORM) == once
    assert fresh == [TRANSFORM.name]
    assert not list(tmp_path.rglob(".unfinished-*"))


def test_without_a_folder_estimates_are_taken_and_reported_once(fresh, tmp_path, monkeypatch, caplog):
    (tmp_path / "file").touch()
    monkeypatch.setenv("FEMSEAL_CACHE", str(tmp_path / "file"))
    results = []
    for _ in range(2):
        results.append(planned(TRANSFORM))
        planned(Transform((20, 12), (0, 1), "float64"))
        plans._own.clear()
    assert results[0] == results[1]
    assert not fresh
    assert len(caplog.records) == 1
    assert "cannot be kept" in caplog.text


def test_the_folder_is_the_users_unless_given(monkeypatch, tmp_path):
    monkeypatch.delenv("FEMSEAL_CACHE", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert plans._folder().parent == tmp_path / ".cache" / "femseal"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert plans._folder().parent == tmp_path / "xdg" / "femseal"
    monkeypatch.setenv("FEMSEAL_CACHE", str(tmp_path / "given"))
    assert plans._folder().parent == tmp_path / "given"


def test_a_full_disk_leaves_estimates(fresh, monkeypatch, caplog):
    def full(path):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(plans, "replacing", full)
    first = planned(TRANSFORM)
    assert "No space left" in caplog.text
    assert plans.known() == {TRANSFORM.name: ""}
    forget()
    assert planned(TRANSFORM) == first


@pytest.mark.skipif(plans.fcntl is None, reason="no locks of this kind")
def test_what_another_process_measures_is_awaited_and_taken(fresh, tmp_path):
    code = (
        "import sys, time; sys.path.insert(0, sys.argv[1]); import test_plans as t\n"
        "measure = t.Transform.measured\n"
        "t.Transform.measured = lambda self: (print('measures', flush=True), time.sleep(0.5), measure(self))[2]\n"
        "sys.stdout.buffer.write(t.planned(t.TRANSFORM))"
    )
    command = [sys.executable, "-c", code, str(Path(__file__).parent)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"measures\n"
        here = planned(TRANSFORM)
        assert process.stdout.read() == here
    assert not fresh


@pytest.mark.skipif(plans.fcntl is None, reason="no locks of this kind")
def test_a_lock_that_is_never_given_up_stops_nobody(fresh, monkeypatch):
    monkeypatch.setattr(plans, "LOCK_SECONDS", 0.1)
    planned(TRANSFORM)
    forget()
    other = Transform((20, 12), (0, 1), "float64")
    with (plans._folder() / "lock").open("a") as file:
        plans.fcntl.flock(file, plans.fcntl.LOCK_EX)
        start = time.monotonic()
        planned(other)
        assert time.monotonic() - start >= 0.1
    assert fresh == [TRANSFORM.name, other.name]


def test_plans_of_another_processor_are_estimated_and_reported(fresh, caplog):
    given = ((TRANSFORM.name, "(fftw-3.3.5 fftw_wisdom #x3c273403 #x00000000 #x00000000 #x00000000\n)\n"),)
    assert planned(TRANSFORM, given) == planned(TRANSFORM, ((TRANSFORM.name, ""),))
    assert "was made for another processor" in caplog.text
    assert not fresh


# --- runs ----------------------------------------------------------------------------------------------------------

LARGER = (
    CASE.replace("points = [32, 32]", "points = [96, 96]")
    .replace('"stochastic"', '"two-scale"', 1)
    .replace('compare = ["deterministic", "two-scale"]', "")
)


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "larger.toml"
    path.write_text(LARGER)
    return path


def test_a_resumed_run_plans_as_before_whatever_the_folder_has(fresh, case, tmp_path, monkeypatch):
    """Begun with estimates, and resumed with plans that are measured: which of them are used can be seen."""
    (tmp_path / "file").touch()
    monkeypatch.setenv("FEMSEAL_CACHE", str(tmp_path / "file"))
    whole = fs.run(case, workers=1)
    with pytest.raises(KeyboardInterrupt):
        fs.run(case, tmp_path / "out", workers=1, progress=stop_at("two-scale: contact of windows", 2))
    forget()
    monkeypatch.setenv("FEMSEAL_CACHE", str(tmp_path / "cache"))
    resumed = fs.run(case, tmp_path / "out", resume=True, workers=1)
    assert_same(whole.dataset, resumed.dataset)
    assert not fresh
    assert not plans.known()
    assert fs.run(case, workers=1) is not None
    assert fresh


@pytest.mark.parametrize("damage", ["cut", "lost"])
def test_where_the_plans_of_a_checkpoint_are_lost_all_is_computed_again(fresh, case, tmp_path, caplog, damage):
    with pytest.raises(KeyboardInterrupt):
        fs.run(case, tmp_path / "out", workers=1, progress=stop_at("two-scale: contact of windows", 2))
    path = tmp_path / "out/.checkpoint/plans.pickle"
    if damage == "cut":
        path.write_bytes(path.read_bytes()[:-1])
    else:
        path.unlink()
    with pytest.raises(KeyboardInterrupt):
        fs.run(
            case, tmp_path / "out", resume=True, workers=1, progress=stop_at("two-scale: contact of the whole face", 0)
        )
    assert f"{path} is damaged; all items are computed again" in caplog.text
    assert not list(path.parent.glob("*.shard"))


@pytest.mark.slow
@pytest.mark.parametrize("scheduler", [None, "local"])
def test_workers_take_the_plans_of_the_main_process(fresh, case, tmp_path, monkeypatch, scheduler):
    """Workers could not keep any."""
    whole = fs.run(case, workers=1)
    (tmp_path / "file").touch()
    monkeypatch.setenv("FEMSEAL_CACHE", str(tmp_path / "file"))
    get_reusable_executor().shutdown()
    assert_same(whole.dataset, fs.run(case, workers=2, scheduler=scheduler).dataset)

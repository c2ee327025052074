"""Folders that somebody has changed: they lead nowhere else and run no code; one run at a time in each."""

import errno
import fcntl
import os
import pickle
import platform
import shutil
import subprocess
import sys

import pytest
from kept_study import EVERY, assert_complete, resumed
from small_cases import CASE

import femseal as fs
from femseal.execution.resuming import (
    alone_in,
    begin_run,
    refuse_unfinished,
    remove_run,
    resumable,
)
from femseal.report import folder as report_folder
from femseal.store import store
from femseal.store.store import SUFFIX, Store

# --- stores --------------------------------------------------------------------------------------------------------


class Trap:
    def __reduce__(self):
        return os.mkdir, ("sprung",)


def test_pickles_are_not_read(tmp_path, monkeypatch, caplog):
    """Also where its checksum is right: whoever changes a store can write it anew."""
    monkeypatch.chdir(tmp_path)
    resumed(out := tmp_path / "out")
    with Store(out) as found:
        keys = list(found._records)
    (path,) = out.iterdir()
    content = pickle.dumps(Trap())
    path.write_bytes(b"".join(store._head(key, content) + content for key in keys))
    results, computed = resumed(out)
    assert_complete(results)
    assert computed == EVERY
    assert "is damaged" in caplog.text
    assert not (tmp_path / "sprung").exists()


def test_links_and_pipes_are_not_opened(tmp_path):
    resumed(out := tmp_path / "out")
    (path,) = out.iterdir()
    shutil.move(path, tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    os.mkfifo(out / f"pipe{SUFFIX}")
    (out / f"folder{SUFFIX}").mkdir()
    (out / f"foreign{SUFFIX}").write_bytes(bytes(1000))
    results, computed = resumed(out)
    assert_complete(results)
    assert computed == EVERY
    assert resumed(out)[1] == []


def test_a_checkpoint_that_is_a_link_is_left_alone(tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    names = ["manifest.json", "0.results", ".unfinished-x"]
    for name in names:
        (other / name).write_text("{}")
    out = tmp_path / "out"
    out.mkdir()
    (out / ".checkpoint").symlink_to(other)
    for act in (
        lambda: resumable(out, {}),
        lambda: refuse_unfinished(out),
        lambda: remove_run(out),
        lambda: begin_run(out, {}),
    ):
        with pytest.raises(fs.InputError, match="a link"):
            act()
    assert sorted(p.name for p in other.iterdir()) == sorted(names)


@pytest.mark.parametrize(
    "content",
    [b"[" * 100_000, b"[1, 2]", b"\xff", b"7", b'{"a\\u001b[2J": [' + b"1," * 9999 + b"1]}"],
)
def test_a_manifest_of_another_kind_is_refused_in_short(tmp_path, content):
    folder = tmp_path / ".checkpoint"
    folder.mkdir()
    (folder / "manifest.json").write_bytes(content)
    with pytest.raises(fs.InputError, match="resume: given") as caught:
        resumable(tmp_path, {"case": 1})
    assert len(str(caught.value)) < 3000
    assert "\x1b" not in str(caught.value)


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(CASE.replace('compare = ["deterministic", "two-scale"]', "").replace("24", "2"))
    return path


# --- the files of a run --------------------------------------------------------------------------------------------


def test_a_list_of_files_removes_nothing_outside_the_folder(tmp_path):
    outside, out = tmp_path / "outside", tmp_path / "out"
    outside.mkdir()
    (out / "vtk").mkdir(parents=True)
    (outside / "kept").write_text("kept")
    (tmp_path / "kept").write_text("kept")
    (out / "linked").symlink_to(outside)
    (out / "loop").symlink_to(out / "loop")
    (out / "one").symlink_to(outside / "kept")
    os.link(outside / "kept", out / "two")
    for name in ("vtk/a.vtu", "mine.txt"):
        (out / name).write_text("x")
    names = ["../kept", str(outside / "kept"), "linked/kept", "linked/../kept", "vtk/../../kept"]
    names += ["~/kept", "one", "two", "vtk/a.vtu", "missing", "missing/b", "vtk", ".", ""]
    names += ["\x00", "x" * 5000, "loop/x", "loop", "\x1b[2J"]
    (out / "files.txt").write_text("\n".join(names))
    report_folder._remove_files(out, report_folder._files_of_earlier_run(out))
    assert (outside / "kept").read_text() == (tmp_path / "kept").read_text() == "kept"
    assert sorted(p.name for p in out.iterdir()) == ["files.txt", "linked", "mine.txt"]


@pytest.mark.parametrize("kind", ["pipe", "link", "large", "folder", "bytes"])
def test_a_list_of_files_that_is_none_is_passed_over(tmp_path, kind):
    path = tmp_path / "files.txt"
    (tmp_path / "kept").write_text("kept")
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "link":
        (tmp_path / "names").write_text("kept")
        path.symlink_to(tmp_path / "names")
    elif kind == "large":
        with path.open("wb") as file:
            file.truncate(10**11)
    elif kind == "folder":
        path.mkdir()
    else:
        path.write_bytes(b"kept\n\xff")
    report_folder._remove_files(tmp_path, report_folder._files_of_earlier_run(tmp_path))
    assert (tmp_path / "kept").exists()


def test_a_run_writes_nothing_outside_its_folder(case, tmp_path):
    outside, out = tmp_path / "outside", tmp_path / "out"
    outside.mkdir()
    out.mkdir()
    names = {name: name for name in ("run.log", "results.nc", "kept")}
    for name in names:
        (outside / name).write_text(name)
    links = {"results.nc": "results.nc", ".lock": "kept", ".unfinished": "", "run.log": "run.log"}
    for name, target in links.items():
        (out / name).symlink_to(outside / target)
    case.write_text(case.read_text().replace('"stochastic"', '"deterministic"'))
    results = fs.run(case, out, workers=1)
    assert "results in" in (out / "run.log").read_text()
    shutil.rmtree(out / "vtk", ignore_errors=True)
    (out / "vtk").symlink_to(outside)
    said = r"vtk' is outside .* or passes a link, .*the computed results are in"
    with pytest.raises(fs.FemsealError, match=said):
        report_folder.write_folder(results, out, results.scene.surface)
    assert {p.name: p.read_text() for p in outside.iterdir()} == names


# --- one run at a time ---------------------------------------------------------------------------------------------

HOLD = """
import sys, time
from pathlib import Path
from femseal.execution.resuming import alone_in
with alone_in(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def holder(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.communicate()


def test_a_second_run_in_a_folder_is_refused_until_the_first_has_ended(case, holder, tmp_path):
    before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")}
    said = rf"another run \(process {holder.pid} on .*under way.*another folder"
    for resume in (False, True):
        with pytest.raises(fs.InputError, match=said):
            fs.run(case, tmp_path, resume=resume, workers=1)
    assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")} == before
    holder.kill()
    holder.wait()
    assert (tmp_path / ".lock").exists()
    fs.run(case, tmp_path, workers=1)
    assert not (tmp_path / ".lock").exists()


def test_runs_of_one_process_exclude_each_other(tmp_path):
    with (
        alone_in(tmp_path),
        pytest.raises(fs.InputError, match=f"process {os.getpid()} on"),
        alone_in(tmp_path),
    ):
        pass
    with alone_in(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


NO_LOCKS = """
import errno, fcntl
def none(*_):
    raise OSError(errno.ENOLCK, "No locks available")
fcntl.flock = none
"""


@pytest.mark.parametrize("killed", [False, True])
def test_without_file_locks_the_process_named_in_the_file_counts(tmp_path, monkeypatch, killed):
    """As on some network file systems: a run that was killed leaves its mark, which holds nobody up."""

    def none(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", none)
    code = [sys.executable, "-c", NO_LOCKS + HOLD, str(tmp_path)]
    with subprocess.Popen(code, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "held\n"
            with (
                pytest.raises(fs.InputError, match=f"process {process.pid} on"),
                alone_in(tmp_path),
            ):
                pass
        finally:
            process.kill()
    assert (tmp_path / ".lock-mark").exists()
    mark = (tmp_path / ".lock-mark").read_text()
    if not killed:  # a process of another machine may be running
        (tmp_path / ".lock-mark").write_text(mark.replace(platform.node(), "another"))
        with pytest.raises(fs.InputError, match="is under way"), alone_in(tmp_path):
            pass
        return
    with alone_in(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []

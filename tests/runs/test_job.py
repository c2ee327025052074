"""Runs from case to folder, and the command line as a user calls it."""

import re
import socket
import subprocess
import sys
import tomllib
from contextlib import ExitStack
from dataclasses import dataclass

import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import TABLES

import femseal as fs
from femseal.case import parse_case
from femseal.execution import cluster as cluster_map
from femseal.fluids import FLUIDS
from femseal.preparation import prepare
from femseal.runs.disk_space import disk_space
from femseal.runs.identity import user_code
from femseal.studies import STUDIES

CASE = f"""
title = "small"
method = "stochastic"
compare = ["deterministic", "two-scale"]
seed = 2
[face]
kind = "self-affine"
points = [64, 128]
size = ["60 um", "120 um"]
rms_slope = 0.2
roll_off = "40 um"
{TABLES}[cells]
count = [3, 6]
[stochastic]
length = "200 um"
realisations = 4
"""


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(CASE)
    return path


def process(*arguments):
    """The command line in a process of its own."""
    code = "from femseal.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True
    )


def test_methods_that_are_compared_solve_the_contact_of_the_whole_face_once(case):
    """With the same bits as each alone, also in processes."""
    text = CASE.replace('method = "stochastic"', 'method = "two-scale"')
    text = text.partition("[stochastic]")[0]
    case.write_text(text)
    stages = []
    both = fs.run(case, workers=2, progress=lambda stage, *_: stages.append(stage)).dataset
    alone = fs.run(parse_case(tomllib.loads(text) | {"compare": []}), workers=1).dataset
    contacts = {stage for stage in stages if "contact" in stage}
    whole = "contact of the whole face"
    assert contacts == {f"two-scale: {whole}", f"error budget: {whole}"}
    for name in alone.data_vars:
        assert_array_equal(both[name].values, alone[name].values)


LOCAL = {"processes": False, "dashboard_address": None}


ALONE = CASE.replace('compare = ["deterministic", "two-scale"]\n', "")


def test_every_choice_of_the_stochastic_method_goes_through_a_case(case):
    """A broader seal, a wider band, a map: each choice shows in the results; unless given as many seals as needed."""
    uneven = 'unloading = ["100 MPa"]\n[load.map]\nkind = "profile"\nfractions = [1.4, 1.2, 1.0, 0.8, 0.6]\n'
    text = ALONE.replace("realisations = 4\n", 'breadth = "100 um"\nquantiles = [0.34, 0.66]\n')
    case.write_text(text.replace('unloading = ["100 MPa"]\n', uneven))
    data = fs.run(case, workers=1).dataset
    assert data.sizes["realisation"] >= 3
    assert data["leakage_lower"].attrs["quantile"] == 0.34
    assert_allclose(data.attrs["seal_size_m"][0], 100e-6)


@pytest.fixture
def silent_service():
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}"


@pytest.mark.parametrize("kind", ["nobody", "silent", "nonsense", "no workers"])
def test_a_bad_address_of_a_scheduler_is_named(case, tmp_path, monkeypatch, silent_service, kind):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(cluster_map, "ANSWER_SECONDS", 0.5)
    monkeypatch.setattr(cluster_map, "WORKER_SECONDS", 0.5)
    known = {"nobody": "tcp://127.0.0.1:1", "silent": silent_service, "nonsense": "http://x"}
    with ExitStack() as stack:
        if kind == "no workers":
            cluster = stack.enter_context(distributed.LocalCluster(n_workers=0, **LOCAL))
            known[kind] = cluster.scheduler_address
        with pytest.raises(fs.InputError, match=f"scheduler: given '{re.escape(known[kind])}'"):
            fs.run(case, tmp_path / "out", scheduler=known[kind])
    assert not (tmp_path / "out").exists()


def test_only_a_complete_folder_is_resumed(case, undrawn, tmp_path, monkeypatch):
    def fail(*args, **kwargs):
        raise ValueError("no such colour")

    case.write_text(ALONE.replace('method = "stochastic"', 'method = "deterministic"'))
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr("femseal.report.pictures.leakage_figure", fail)
        with pytest.raises(fs.FemsealError, match="no such colour"):
            fs.run(case, out, workers=1)
    assert "no such colour" in (out / "run.log").read_text()
    done = fs.run(case, out, resume=True, workers=1)
    assert done.folder == out
    assert (out / "leakage.png").exists()
    monkeypatch.setattr(STUDIES["deterministic"], "solve", fail)
    assert_array_equal(fs.run(case, out, resume=True, workers=1).leakage, done.leakage)
    case.write_text(case.read_text().replace("seed = 2", "seed = 3"))
    with pytest.raises(fs.InputError, match="holds the results of another case"):
        fs.run(case, out, resume=True, workers=1)
    with pytest.raises(ValueError, match="no such colour"):
        fs.run(case, out, resume=True, workers=1, replace_results=True)


def registered_liquid(resistance):
    """A liquid as a user would register it, whose code differs in a number alone."""

    @dataclass(frozen=True)
    class Liquid(fs.Liquid):
        def potential(self, pressure):
            return super().potential(pressure) / resistance

        def pressure(self, potential):
            return super().pressure(potential) * resistance

    return Liquid


def test_results_by_other_code_of_a_registered_fluid_are_not_taken(
    case, undrawn, tmp_path, monkeypatch
):
    """Neither those of a finished run nor those of one that was interrupted."""
    case.write_text(ALONE.replace('method = "stochastic"', 'method = "deterministic"'))
    assert user_code(fs.load_case(case)) == {}
    out = tmp_path / "out"
    monkeypatch.setitem(FLUIDS, "liquid", registered_liquid(1.0))
    first = fs.run(case, out, workers=1)
    assert user_code(fs.load_case(case)) != user_code(fs.load_case(case))
    monkeypatch.setitem(FLUIDS, "liquid", registered_liquid(2.0))
    second = fs.run(case, out, workers=1, resume=True)
    assert_allclose(second.leakage, first.leakage / 2, rtol=1e-9)
    with monkeypatch.context() as patch:
        patch.setattr("femseal.report.pictures.leakage_figure", lambda *given, **more: 1 / 0)
        with pytest.raises(fs.FemsealError) as caught:
            fs.run(case, tmp_path / "interrupted", workers=1)
    assert "--resume" not in str(caught.value)
    with pytest.raises(fs.InputError, match="a class of your own"):
        fs.run(case, tmp_path / "interrupted", workers=1, resume=True)


def test_results_with_another_order_of_the_error_sources_are_taken(case, tmp_path, monkeypatch):
    """The default order of `model_parts` differs between versions of femseal."""
    case.write_text(ALONE.replace('method = "stochastic"', 'method = "deterministic"'))
    former_echo = fs.Case.echo

    def reversed_echo(self):
        echo = former_echo(self)
        output = echo["output"] | {"model_parts": echo["output"]["model_parts"][::-1]}
        return echo | {"output": output}

    with monkeypatch.context() as patch:
        patch.setattr(fs.Case, "echo", reversed_echo)
        fs.run(case, tmp_path / "out", workers=1)
    written = (tmp_path / "out" / "run.log").stat().st_mtime_ns
    fs.run(case, tmp_path / "out", workers=1, resume=True)
    assert (tmp_path / "out" / "run.log").stat().st_mtime_ns == written


def test_results_of_a_finished_run_are_not_replaced_unasked(femseal, case, tmp_path):
    """Neither by the same case, nor by another one that is to go on there; nor are they touched."""
    case.write_text(ALONE.replace('method = "stochastic"', 'method = "deterministic"'))
    other, out = tmp_path / "other.toml", tmp_path / "out"
    other.write_text(case.read_text().replace("seed = 2", "seed = 3"))
    first = fs.run(case, out, workers=1)
    (out / "run.log").unlink()
    before = {p: p.stat().st_mtime_ns for p in out.rglob("*")}
    for path, more, words in (
        (case, (), "holds the results of a finished run"),
        (other, (), "holds the results of a finished run"),
        (other, ("--resume",), "holds the results of another case"),
    ):
        code, _, said = femseal("run", path, "-o", out, "--workers", "1", *more)
        assert (code, said.count("\n")) == (2, 1)
        assert words in said
        assert "--replace" in said
    with pytest.raises(fs.InputError, match="another case"):
        fs.design(other, out, workers=1)
    for resume, words in ((False, "finished run"), (True, "another case")):
        with pytest.raises(fs.InputError, match=words):
            fs.run(other, out, resume=resume, workers=1)
    assert {p: p.stat().st_mtime_ns for p in out.rglob("*")} == before
    code, _, _ = femseal("run", other, "-o", out, "--workers", "1", "--replace")
    assert code == 0
    assert fs.open_results(out).case["seed"] == 3
    assert (fs.open_results(out).leakage.values != first.leakage.values).any()


def test_bad_input_writes_nothing_and_exits_with_2(femseal, case, tmp_path):
    case.write_text(CASE.replace('"300 MPa"]', '"5 GPa"]', 1))
    out = tmp_path / "out"
    failed = process("run", case, "-o", out)
    assert failed.returncode == 2
    assert "5 GPa" in failed.stderr
    assert "Traceback" not in failed.stderr
    assert not out.exists()
    assert femseal("run", tmp_path / "none.toml")[0] == 2
    assert femseal("run")[0] == 2


def test_new_writes_a_case_that_is_valid_and_keeps_what_is_there(femseal, tmp_path):
    path = tmp_path / "new.toml"
    assert femseal("new", path)[0] == 0
    fs.load_case(path)
    assert femseal("new", path)[0] == 2


def test_progress_knows_how_much_there_is_to_do(case):
    told = []
    case.write_text(CASE.replace('compare = ["deterministic", "two-scale"]', ""))
    fs.run(case, workers=1, progress=lambda *state: told.append(state))
    last = {stage: (done, total) for stage, done, total in told}
    assert {
        "stochastic",
        "stochastic: contact of the whole face",
        "stochastic: realisations",
    } <= set(last)
    assert all(done == total for done, total in last.values())


@pytest.mark.usefixtures("drawn_pictures")
@pytest.mark.parametrize(
    "limit",
    [
        pytest.param("1 GB", marks=pytest.mark.slow),
        "250 kB",
        pytest.param("0 GB", marks=pytest.mark.slow),
    ],
)
def test_size_of_the_folder_is_foreseen(case, tmp_path, limit):
    """Of the gaps that all studies keep, too, once all is computed."""
    case.write_text(case.read_text() + f'[output]\nfields_limit = "{limit}"\n')
    loaded, kept, out = fs.load_case(case), [], tmp_path / "out"
    foreseen = disk_space(loaded, prepare(loaded))

    def measure(stage, done, total):
        if stage == "writing results":
            kept.extend(path.stat().st_size for path in out.glob(".checkpoint/*.results"))

    fs.run(loaded, out, workers=1, progress=measure)
    written = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    assert written < 1.2 * (foreseen.fields + foreseen.other_files) < 20 * written
    assert 0.6 < sum(kept) / foreseen.checkpoint < 1.2
    assert len(fs.open_results(out).stored_steps) == foreseen.stored_steps


@pytest.mark.parametrize(
    ("cause", "expected"),
    [(KeyboardInterrupt(), KeyboardInterrupt), (ValueError(), SystemError)],
)
def test_ctrl_c_within_compiled_code_stops_as_any_other(case, tmp_path, cause, expected):
    """As numba tells it; other errors of the system stay what they are."""

    def fail(stage, done, total):
        inner = SystemError("returned a result with an exception set")
        inner.__cause__ = cause
        raise SystemError("returned a result with an exception set") from inner

    with pytest.raises(expected):
        fs.run(case, tmp_path / "out", workers=1, progress=fail)
    stopped = "the run was stopped (KeyboardInterrupt)" in (tmp_path / "out/run.log").read_text()
    assert stopped == (expected is KeyboardInterrupt)

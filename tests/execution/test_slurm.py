"""The example for SLURM, with small programs in place of SLURM's own, and what is said of runs in parts."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from numpy.testing import assert_array_equal
from small_cases import CASE

import femseal as fs

SCRIPT = Path(__file__).parents[2] / "examples" / "slurm.sh"
#: Starts a command as often as there are tasks.
SRUN = """#!/bin/bash
tasks=0
while [[ $1 == --* ]]; do
    [[ $1 == --ntasks=* ]] && tasks=${1#--ntasks=}
    shift
done
for ((task = 0; task < tasks; task++)); do "$@" & done
wait
"""
#: Notes what it is asked for.
SCONTROL = """#!/bin/bash
echo "$@" >> scontrol.txt
"""
#: A program of an installed package, by the Python of the tests.
PROGRAM = """#!/bin/bash
exec "{python}" -m {module} "$@"
"""


@pytest.fixture
def slurm(tmp_path):
    """Environment of a job of two tasks in a folder that has the programs of SLURM."""
    programs = tmp_path / "programs"
    programs.mkdir()
    given = {"srun": SRUN, "scontrol": SCONTROL}
    for name, module in (("femseal", "femseal"), ("dask", "dask"), ("python3", "")):
        line = PROGRAM if module else PROGRAM.replace(" -m {module}", "")
        given[name] = line.format(python=sys.executable, module=module)
    for name, text in given.items():
        path = programs / name
        path.write_text(text)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
    package = str(Path(fs.__file__).parents[1])
    return os.environ | {
        "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": package,
        "SLURM_JOB_ID": "4711",
        "SLURM_NTASKS": "2",
    }


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_the_script_is_one_that_bash_can_read():
    subprocess.run(["bash", "-n", SCRIPT], check=True)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_a_job_of_two_tasks_gives_the_results_of_one_process(slurm, tmp_path):
    pytest.importorskip("distributed")
    (tmp_path / "seal.toml").write_text(CASE)
    alone = fs.run(tmp_path / "seal.toml", workers=1)
    command = ["bash", SCRIPT, "run", "seal.toml", "-o", "out", "--quiet"]
    subprocess.run(command, cwd=tmp_path, env=slurm, check=True, timeout=600)
    assert_array_equal(fs.open_results(tmp_path / "out").leakage, alone.leakage)
    assert not list(tmp_path.glob("dask-*.json"))
    assert not (tmp_path / "scontrol.txt").exists()


@pytest.mark.parametrize("command", ["run", "sweep", "calibrate"])
def test_runs_in_parts_are_answered_with_a_cluster(command, femseal, tmp_path):
    (case := tmp_path / "seal.toml").write_text(CASE)
    more = {"run": [], "sweep": ["seed=1,2"], "calibrate": ["test.csv"]}[command]
    code, _, error = femseal(command, case, *more, "-o", tmp_path / "out", "--part", "1/2")
    assert code == 2
    assert "--part: given '1/2', expected none: removed; start a Dask cluster" in error
    assert "--part" not in femseal(command, "--help")[1]
    with pytest.raises(fs.InputError, match=r"part: given .*examples/slurm\.sh"):
        getattr(fs, command)(case, part=(1, 2))

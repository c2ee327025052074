"""What a scene does not need is left out, and what is left gives the same numbers."""

import subprocess
import sys

import pytest
from numpy.testing import assert_array_equal

import femseal as fs

CASE = """
method = "deterministic"
[face]
kind = "self-affine"
points = [32, 48]
size = ["30 um", "45 um"]
rms_slope = 0.2
roll_off = "20 um"
[material]
young = "210 GPa"
hardness = "3 GPa"
[load]
loading = ["100 MPa", "300 MPa"]
[fluid]
kind = "liquid"
viscosity = "1 mPa*s"
inlet_pressure = "1 MPa"
"""
BARE = '[output]\npictures = false\nfields = false\nparaview = "none"\n'


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(CASE)
    return path


def files(folder):
    found = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
    assert set((folder / "files.txt").read_text().split()) == found - {"files.txt", "run.log"}
    return found


# --- files ------------------------------------------------------------------------------------------------


def test_a_bare_run_imports_nothing_that_draws(case, tmp_path):
    case.write_text(CASE + BARE)
    out = tmp_path / "out"
    code = (
        "import sys, femseal as fs; fs.run(sys.argv[1], sys.argv[2], workers=1)\n"
        "print(sorted({'matplotlib', 'pyvista', 'vtk', 'vtkmodules'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code, case, out], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr
    assert files(out) == {"results.nc", "table.csv", "files.txt", "run.log"}


def test_files_are_written_later_without_solving_again(case, undrawn, tmp_path, monkeypatch):
    out = tmp_path / "out"
    whole = fs.run(case, out, workers=1)
    every = files(out)
    assert {"report.html", "leakage.png", "fields.pvd"} < every

    def fail(*args, **kwargs):
        raise ValueError("solved again")

    monkeypatch.setattr("femseal.runs.job.deterministic", fail)
    case.write_text(CASE + "[output]\npictures = false\n")
    fs.run(case, out, resume=True, workers=1)
    left = {name for name in every if not name.endswith(".png") and name != "report.html"}
    assert files(out) == left
    assert fs.open_results(out).stored_steps == [0, 1]
    case.write_text(CASE)
    again = fs.run(case, out, resume=True, workers=1)
    assert files(out) == every
    assert_array_equal(again.leakage, whole.leakage)
    case.write_text(CASE + BARE)
    fs.run(case, out, resume=True, workers=1)
    assert files(out) == {"results.nc", "table.csv", "files.txt", "run.log"}
    assert fs.open_results(out).case["output"]["fields"] is False
    # fields are not in the dataset
    case.write_text(CASE)
    with pytest.raises(ValueError, match="solved again"):
        fs.run(case, out, resume=True, workers=1)

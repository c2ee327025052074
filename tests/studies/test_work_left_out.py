"""What a scene does not need is left out, and what is left gives the same numbers."""

import subprocess
import sys
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import femseal as fs
from femseal.seal import Profile
from femseal.studies import STUDIES

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
    assert files(out) == {"results.nc", "table.csv", "table.xlsx", "files.txt", "run.log"}


def test_files_are_written_later_without_solving_again(case, tmp_path, monkeypatch):
    out = tmp_path / "out"
    whole = fs.run(case, out, workers=1)
    every = files(out)
    assert {"report.html", "leakage.png", "fields.pvd"} < every

    def fail(*args, **kwargs):
        raise ValueError("solved again")

    monkeypatch.setattr(STUDIES["deterministic"], "solve", fail)
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
    assert files(out) == {"results.nc", "table.csv", "table.xlsx", "files.txt", "run.log"}
    assert fs.open_results(out).case["output"]["fields"] is False
    # fields are not in the dataset
    case.write_text(CASE)
    with pytest.raises(ValueError, match="solved again"):
        fs.run(case, out, resume=True, workers=1)


# --- equal load steps -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def elastic():
    surface = fs.self_affine(
        (48, 64), (45e-6, 60e-6), hurst=0.8, rms_slope=0.2, roll_off=30e-6, rng=2
    )
    return fs.Scene(
        surface,
        115e9,
        np.inf,
        fs.Liquid(1e-3),
        1e6,
        0.0,
        loading=(1e8, 4e8, 1.2e9),
        unload_from=(4e8, 1.2e9),
        unloading=(4e8, 2e8, 1e8, 0.0),
        fluid_pressure="ignored",  # which opens the seal at no load
    )


SURFACE_STUDIES = {
    "deterministic": fs.deterministic,
    "two-scale": lambda scene: fs.two_scale(scene, (3, 4)),
}
DRAWN = fs.Sampling(length=2e-4, realisations=3, seed=1)


def assert_equal_loads_leak_alike(pressures, leakage):
    for s, t in combinations(range(len(pressures)), 2):
        if pressures[s] == pressures[t]:
            assert_array_equal(leakage[..., s], leakage[..., t])


@pytest.mark.parametrize("name", SURFACE_STUDIES)
def test_an_elastic_face_comes_back_as_it_went(elastic, name):
    found = SURFACE_STUDIES[name](elastic)
    assert_equal_loads_leak_alike(elastic.steps.pressures, found.leakage)


@pytest.mark.parametrize("breadth", [None, 9e-5], ids=["as broad as the face", "broader"])
def test_drawn_seals_of_an_elastic_face_come_back_as_they_went(elastic, breadth):
    found = fs.stochastic(elastic, (3, 4), replace(DRAWN, breadth=breadth))
    assert_equal_loads_leak_alike(elastic.steps.pressures, found.leakage)


def test_the_ladder_of_an_elastic_face_has_no_way_down(elastic):
    found = fs.stochastic(
        elastic, (3, 4), replace(DRAWN, breadth=9e-5, pressure_map=Profile((0.8, 1.2)))
    )
    assert found.cells.steps.on_loading.all()
    assert_equal_loads_leak_alike(elastic.steps.pressures, found.leakage)


def test_states_that_plastic_deformation_tells_apart_are_solved(elastic):
    plastic = replace(elastic, hardness=3e9)
    found = fs.deterministic(plastic)
    assert found.leakage[4] < found.leakage[0]  # back at 100 MPa

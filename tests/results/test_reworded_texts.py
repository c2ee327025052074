"""Texts for the user can be reworded without any effect on decisions: these read numbers, kinds and codes."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray
from small_cases import steel_scene

import femseal as fs
from femseal.plots.realisations import _axis_names
from femseal.results import RunFacts, assemble
from femseal.results.attempts import attempt_sentences
from femseal.results.best_leakage import error_budgets
from femseal.results.class_loads import common_load_text
from femseal.results.dataset_file import _with_all_attributes, save
from femseal.results.load_steps import LoadFormat, given_loads, load_format
from femseal.seal.layouts import AnnularLayout, RectangularLayout
from femseal.studies import STUDIES


@pytest.fixture(scope="module")
def study():
    face = fs.self_affine((32, 32), (4e-5, 4e-5), hurst=0.8, rms_slope=0.2, cut_off=1e-5, rng=1)
    scene = steel_scene(face, loading=(5e7, 1e8))
    return scene, fs.deterministic(scene)


def loaded(*loads, pressures=(5e7, 1e8)):
    """A dataset whose case gives these loads."""
    case = json.dumps({"load": {"loading": loads}})
    nominal = ("step", np.array(pressures))
    return xarray.Dataset({"nominal_pressure": nominal}, attrs={"case": case})


@pytest.mark.parametrize(
    ("loads", "unit", "force", "per_pascal"),
    [
        ((5e7, 1e8), "Pa", "", 0.0),
        (("1000.0 N", "2000.0 N"), "N", "kN", 2.0 / 1e8),
        (("100.0 N", "200.0 N"), "N", "N", 200.0 / 1e8),
        (("1000.0 N/m", "2000.0 N/m"), "N/m", "N/mm", 2.0 / 1e8),
        # spaces and prefixes are no matter
        (("1kN", "2kN"), "N", "kN", 2.0 / 1e8),
    ],
)
def test_forces_of_a_stored_case_are_read_as_quantities(loads, unit, force, per_pascal):
    data = loaded(*loads)
    assert given_loads(data)[0] == unit
    assert load_format(data)[:2] == (force, pytest.approx(per_pascal))


def test_a_short_load_is_the_force_alone():
    force = LoadFormat("kN", 2e-8, 3)
    assert (force.short(1e8), force.full(1e8)) == ("2 kN", "2 kN (100 MPa)")
    pressure = LoadFormat(digits=3)
    assert pressure.short(1e8) == pressure.full(1e8) == "100 MPa"


def test_loads_of_several_runs_are_forces_where_their_scales_agree():
    def text(*all_loads):
        runs = [SimpleNamespace(dataset=loaded(*loads)) for loads in all_loads]
        return common_load_text(runs)(1e8)

    forces = ("1000.0 N", "2000.0 N")
    assert text(forces, ("1000.0 N", "2000.2 N")) == "2 kN (100 MPa)"
    for other in (("1000.0 N", "2010.0 N"), ("1000.0 N/m", "2000.0 N/m"), (5e7, 1e8)):
        assert text(forces, other) == "100 MPa"


def test_the_name_of_a_strip_may_change(study, monkeypatch):
    for layout in (RectangularLayout, AnnularLayout):
        monkeypatch.setattr(layout, "__str__", lambda self: "a seal of another name")
    scene, result = study
    results = assemble(scene, result)
    assert results.dataset.attrs["seal"] == "a seal of another name"
    assert "inlet at 0" in _axis_names(results.dataset, "m", has_x2_horizontal=False)[0]
    ring = results.dataset.assign_attrs(seal_kind=AnnularLayout.kind)
    assert "inlet" not in _axis_names(ring, "m", has_x2_horizontal=False)[0]


def test_a_file_without_the_kind_of_its_seal_can_be_read(study, tmp_path):
    scene, result = study
    results = assemble(scene, result, facts=RunFacts(case={"seal": {"kind": "annular"}}))
    older = results.dataset.copy()
    del older.attrs["seal_kind"]
    save(replace(results, dataset=older), tmp_path)
    # without realisations, the seal is a strip
    assert fs.open_results(tmp_path).dataset.attrs["seal_kind"] == "rectangular"


@pytest.mark.parametrize(
    ("case", "seal", "kind"),
    [
        ({}, "a strip, lay x1", "rectangular"),
        ({}, "a ring between the radii 5 mm and 6 mm, leaking outwards, lay x2", "annular"),
        ({}, "the mesh seal.msh, lay x2", "mesh"),
        ({"seal": {"kind": "annular"}}, "a seal of another name", "annular"),
    ],
)
def test_an_older_file_without_a_case_describes_its_seal(case, seal, kind):
    leakage = STUDIES["stochastic"].leakage_variable
    attributes = {"case": json.dumps(case), "seal": seal}
    older = xarray.Dataset({leakage: ("step", [1e-9])}, attrs=attributes)
    assert _with_all_attributes(older).attrs["seal_kind"] == kind


def test_the_error_budget_of_an_unknown_study_is_left_out(study):
    scene, result = study
    data = assemble(scene, result).dataset
    data = data.assign_attrs(error_budget=json.dumps({"another_study": {"pixels": ""}}))
    assert error_budgets(data) == {}


@pytest.mark.parametrize("can_halve", [True, False])
def test_the_reason_of_the_last_attempt_is_not_repeated(can_halve):
    attempts = {
        "wanted": 0.1,
        "reached": False,
        "half_width": 0.2,
        "limit": "pixels",
        "load": "300 MPa",
    }
    attempts |= {"why": "no memory", "half_error": "no memory", "can_halve_error": can_halve}
    assert ("To halve the error: no memory." in attempt_sentences(attempts)) == can_halve
    # older records have only the text
    del attempts["can_halve_error"]
    if not can_halve:
        attempts["half_error"] = "not possible: no memory"
    told = any(text.startswith("To halve the error") for text in attempt_sentences(attempts))
    assert told == can_halve

"""Files of earlier versions can be read and drawn."""

import json
from dataclasses import replace

import pytest
import xarray
from small_cases import steel_scene

import femseal as fs
from femseal.plots.realisations import _axis_names
from femseal.results import RunFacts, assemble
from femseal.results.best_leakage import error_budgets
from femseal.results.dataset_file import _with_all_attributes, save
from femseal.seal.layouts import AnnularLayout, RectangularLayout
from femseal.studies import STUDIES


@pytest.fixture(scope="module")
def study():
    face = fs.self_affine((32, 32), (4e-5, 4e-5), hurst=0.8, rms_slope=0.2, cut_off=1e-5, rng=1)
    scene = steel_scene(face, loading=(5e7, 1e8))
    return scene, fs.deterministic(scene)


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

"""Coatings of a case, from the keys to leakage and warnings."""

import copy

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.base import InputError
from femseal.case import parse_case
from femseal.preparation.preparation import prepare
from femseal.runs.case_description import solids_text
from femseal.runs.run_description import describe

CASE = {
    "title": "coated",
    "method": "deterministic",
    "seed": 1,
    "face": {
        "kind": "self-affine",
        "size": ["64 um", "64 um"],
        "points": [64, 64],
        "hurst": 0.8,
        "rms_slope": 0.1,
        "roll_off": "30 um",
    },
    "material": {"name": "steel 304/316, annealed"},
    "counter_material": {"name": "Inconel 718, aged"},
    "load": {"loading": ["20 MPa", "80 MPa"]},
    "fluid": {
        "kind": "liquid",
        "viscosity": "1 mPa s",
        "inlet_pressure": "1 bar",
        "outlet_pressure": "0 bar",
    },
}
SILVER = {"name": "silver, annealed", "thickness": "20 um"}


def case_of(material=None, counter=None, **others):
    data = copy.deepcopy(CASE) | others
    data["material"] |= {} if material is None else {"coating": material}
    data["counter_material"] |= {} if counter is None else {"coating": counter}
    return parse_case(data)


def test_a_coating_by_name_is_the_pair_of_bodies_and_its_law():
    case = case_of(SILVER)
    steel, silver = (fs.named_solid(n) for n in ("steel 304/316, annealed", "silver, annealed"))
    coated, inconel = case.modulus
    assert coated.thickness == 20e-6
    for body, solid in ((coated.substrate, steel), (coated.layer, silver)):
        assert (body.young, body.poisson, body.hardness) == (
            solid.young,
            solid.poisson,
            solid.hardness,
        )
    assert inconel.young == fs.named_solid("Inconel 718, aged").young
    hardness = case.law.yield_pressure(np.array([0.0, 19e-6, 30e-6, 1e-3]))
    # 25 HV and 160 HV, as contact pressures
    assert_allclose(hardness, 9.80665e6 / 0.9272 * np.array([25, 25, 160, 160]))
    assert "coating of 20 µm, silver" in solids_text(case)


def test_a_coating_by_its_properties_on_the_counter_face():
    coating = {"young": "80 GPa", "poisson": 0.35, "hardness": "150 MPa", "thickness": "5 um"}
    case = case_of(counter=coating)
    assert case.modulus[1].layer == fs.Solid(80e9, 0.35, hardness=150e6)
    assert case.softer == "counter_material"
    assert case.law.mean_hardness == 150e6


def test_without_a_coating_it_is_a_number():
    assert case_of().modulus == fs.contact_modulus(*case_of().solids)


@pytest.mark.parametrize(
    ("coating", "key", "expected"),
    [
        ({"name": "silver, annealed"}, "coating.thickness", ""),
        ({"name": "silverr", "thickness": "1 um"}, "coating.name", "silver, annealed"),
        ({"thickness": "1 um"}, "coating.young", ""),
        (SILVER | {"thickness": "0 um"}, "coating.thickness", "> 0"),
        (SILVER | {"thickness": "5 N"}, "coating.thickness", "m"),
        (SILVER | {"tickness": "5 um"}, "coating.tickness", "thickness"),
        ("silver, annealed", "coating", ""),
    ],
)
def test_wrong_coatings_name_their_key(coating, key, expected, tmp_path):
    from femseal.case.template import as_toml

    data = copy.deepcopy(CASE)
    data["material"]["coating"] = coating
    lines = [f"{name} = {as_toml(value)}" for name, value in data.items()]
    path = tmp_path / "case.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        fs.load_case(path)
    assert f"material.{key}" in str(caught.value)
    assert expected in str(caught.value)


def test_a_thick_coating_leaks_as_its_metal_and_a_thin_one_lies_between():
    def leakage(case):
        prepared = prepare(case)
        return fs.deterministic(prepared.scene).leakage

    bare = leakage(case_of())
    thick = leakage(case_of(SILVER | {"thickness": "10 mm"}))
    silver = case_of()
    data = copy.deepcopy(CASE)
    data["material"] = {"name": "silver, annealed"}
    silver = leakage(parse_case(data))
    assert_allclose(thick, silver, rtol=1e-3)
    plated = leakage(case_of(SILVER))
    assert np.all(plated < 0.8 * bare)


@pytest.mark.parametrize("method", ["two-scale", "stochastic"])
def test_every_study_takes_a_coating(method):
    data = copy.deepcopy(CASE) | {"method": method}
    data["cells"] = {"count": [2, 2]}
    if method == "stochastic":
        data["stochastic"] = {"length": "1 mm", "realisations": 3}
    data["material"]["coating"] = SILVER
    prepared = prepare(parse_case(data))
    result = prepared.solve(prepared.answer, map)
    assert np.all(np.asarray(result.leakage) > 0)


def test_warnings_of_a_coating_that_is_too_thin():
    thin = case_of(SILVER | {"thickness": "0.5 um"})
    scene = prepare(thin).scene
    assert any("may yield through" in line for line in describe(thin, prepare(thin)))
    texts = fs.deterministic(scene).warnings
    assert any("yields through" in text and "thicker coating" in text for text in texts)
    assert any("rms height" in text for text in texts)
    texts = fs.deterministic(prepare(case_of(SILVER)).scene).warnings
    assert not any("coating" in text for text in texts)
    assert prepare(case_of(SILVER)).estimate() is not None


def test_a_seat_with_a_form_takes_a_coating():
    data = copy.deepcopy(CASE)
    data["seat"] = {"kind": "crowned", "radius": "1 mm"}
    data["load"] = {"loading": ["20 MPa"]}
    data["material"]["coating"] = SILVER
    scene = prepare(parse_case(data)).scene
    assert fs.deterministic(scene).leakage[0] > 0

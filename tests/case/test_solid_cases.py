"""Solids of a case: metals by name, hardness as a curve or from a file, and which of two faces yields."""

import pytest
from numpy.testing import assert_allclose
from solids_in_cases import LOADED, YOUNG, case_of_solids

import femseal as fs
from femseal.case import parse_case
from femseal.contact import HardnessTable, NixGao, PerfectlyPlastic
from femseal.materials import METALS, named_solid
from femseal.preparation.drawing_values import read_drawing

ROWS = [["0 um", "1 GPa"], ["0.5 um", "1.4 GPa"], ["2 um", "1.6 GPa"]]


def test_a_name_fills_in_what_is_not_given():
    alloy, known = (
        case_of_solids({"name": "Inconel 718, aged"}).solids[0],
        named_solid("Inconel 718, aged"),
    )
    assert (alloy.young, alloy.poisson, alloy.hardness) == (
        known.young,
        known.poisson,
        known.hardness,
    )
    own = case_of_solids({"name": "Inconel 718, aged", "young": "190 GPa", "hardness": "4 GPa"})
    assert own.solids[0] == fs.Solid(190e9, 0.29, hardness=4e9)
    assert own.named_warnings == ()


@pytest.mark.parametrize("name", METALS)
def test_a_metal_by_its_name_has_the_hardness_of_an_indentation_in_every_path(name):
    """In a case, as a coating, in Python and from a drawing; a hardness or a yield stress of the case comes first."""
    hardness = fs.named_solid(name).hardness
    load = {"load": {"loading": ["10 MPa"]}}
    by_name = case_of_solids({"name": name}, **load)
    coated = case_of_solids(YOUNG | {"coating": {"name": name, "thickness": "20 um"}}, **load)
    assert by_name.law.hardness == hardness
    assert coated.material.coating.solid.hardness == hardness
    from_drawing = read_drawing({"ra": "1.6 um", "pitch": "0.1 mm", "metal": name.upper()}, None)
    assert from_drawing.hardness == hardness
    assert from_drawing.metal == name
    assert case_of_solids(
        {"name": name, "yield_stress": "100 MPa"}, **load
    ).law.hardness == pytest.approx(280e6)
    assert case_of_solids({"name": name, "hardness": "300 MPa"}, **load).law.hardness == 300e6


def test_another_ratio_of_hardness_to_yield_stress():
    ratio = {"hardness_over_yield": 2.3}
    assert_allclose(case_of_solids(YOUNG | {"yield_stress": "1 GPa"} | ratio).law.hardness, 2.3e9)
    assert_allclose(
        case_of_solids({"name": "Inconel 718, aged"} | ratio).law.hardness, 2.3 * 1034e6
    )
    silver = {"name": "silver, annealed", "thickness": "20 um"} | ratio
    layer = case_of_solids({"name": "Inconel 718, aged", "coating": silver}).material.body.layer
    assert_allclose(layer.hardness, 2.3 * 54e6)


@pytest.mark.parametrize("solid", [YOUNG, {"name": "Inconel 718, aged"}])
@pytest.mark.parametrize("keys", [{"hardness": "1 GPa"}, {"hardness_table": ROWS}])
def test_a_ratio_of_hardness_to_yield_stress_contradicts_a_hardness(solid, keys):
    with pytest.raises(fs.InputError, match="hardness_over_yield with a yield_stress"):
        case_of_solids(solid | {"hardness_over_yield": 2.3} | keys)


def test_a_ratio_of_hardness_to_yield_stress_needs_a_yield_stress():
    with pytest.raises(fs.InputError, match="hardness_over_yield with a yield_stress"):
        case_of_solids(YOUNG | {"hardness_over_yield": 2.3})


@pytest.mark.parametrize(
    ("keys", "law"),
    [
        ({"hardness_table": ROWS}, HardnessTable([0, 0.5e-6, 2e-6], [1e9, 1.4e9, 1.6e9])),
        ({"hardness": "1 GPa", "nix_gao_depth": "1 um"}, NixGao(1e9, 1e-6)),
        (
            {"hardness": "1 GPa", "nix_gao_depth": "1 um", "smallest_depth": "50 nm"},
            NixGao(1e9, 1e-6, 5e-8),
        ),
    ],
)
def test_a_curve_of_a_case_is_its_law_and_runs(keys, law):
    made = case_of_solids(YOUNG | keys)
    assert made.law == law
    results = fs.run(made)
    assert results.dataset.attrs["contact_law"] == str(law)
    assert results.deterministic.plastic_fraction[1] > 0


def test_a_table_from_a_file_has_its_units(tmp_path):
    path = tmp_path / "indentation.csv"
    path.write_text("hardness [GPa]; depth [nm]\n1; 0\n1.4; 500\n\n1.6; 2000\n")
    of_file = LOADED | {"material": YOUNG | {"hardness_table": "indentation.csv"}}
    from_file = parse_case(of_file, tmp_path)
    assert from_file.law == case_of_solids(YOUNG | {"hardness_table": ROWS}).law
    assert from_file.echo()["material"]["hardness_table"][1] == [500e-9, 1.4e9]
    for text, said in (
        ("", ", expected two col"),
        ("depth, hardness\n1, 2\n", ", expected two col"),
        ("depth [um], hardness [GPa]\n1\n", ", expected two col"),
        ("depth [um], depth [um]\n1,2\n", ", expected two col"),
        ("depth [um], hardness [GPa]\n", " with 0 rows of numbers, expected"),
        ("depth [um], hardness [GPa]\n0, 1\n", " with 1 row of numbers, expected"),
    ):
        path.write_text(text)
        table = "^material.hardness_table: given 'indentation.csv'"
        with pytest.raises(fs.InputError, match=table + said):
            parse_case(of_file, tmp_path)


def test_the_softer_face_yields():
    steel, copper = YOUNG | {"hardness": "3 GPa"}, {"young": "117 GPa", "hardness": "600 MPa"}
    for face, counter, softer in ((steel, copper, "counter-face"), (copper, steel, "face")):
        made = case_of_solids(face, counter)
        assert made.law == PerfectlyPlastic(6e8)
        said = f"; the {softer} is the softer one and yields at 600 MPa, the other yields at 3 GPa"
        assert fs.run(made).dataset.attrs["solids"].endswith(said)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (
            {"hardness_table": [["0 um", "1 GPa"], ["0 um", "2 GPa"]]},
            "material: expected hardness_table: rising depths >= 0",
        ),
        (
            {"hardness_table": [["0 um", "1 GPa"]]},
            r"material.hardness_table: given .*, expected at least two rows",
        ),
        (
            {"hardness_table": []},
            r"^material.hardness_table: given \[\], expected at least two rows",
        ),
        (
            {"hardness_table": [["0 um", "0 GPa"], ["1 um", "2 GPa"]]},
            r"hardness_table.0.1: given '0 GPa', expected .* > 0",
        ),
        (
            {"hardness_table": "lost.csv"},
            "hardness_table: given 'lost.csv', expected a file that exists",
        ),
        ({"hardness_table": ROWS, "hardness": "1 GPa"}, "hardness or hardness_table, not both"),
        (
            {"hardness_table": ROWS, "hardening": "1 GPa/um"},
            "hardening with a yield_stress or a hardness",
        ),
        (
            {"hardness": "1 GPa", "hardening": "1 GPa/um", "nix_gao_depth": "1 um"},
            "hardening or nix_gao_depth, not both",
        ),
        (
            {"hardness": "1 GPa", "hardening": "-2 GPa/um"},
            "hardening: given '-2 GPa/um', expected a stress p",
        ),
        ({"hardness": "1 GPa", "hardening": "2 GPa"}, "material.hardening: given '2 GPa'"),
        ({"hardening": "2 GPa/um"}, "hardening with a yield_stress or a hardness"),
        ({"nix_gao_depth": "1 um"}, "nix_gao_depth with a yield_stress or a hardness"),
        ({"hardness": "1 GPa", "smallest_depth": "1 um"}, "smallest_depth with a nix_gao_depth"),
        (
            {"name": "copper, soft", "hardness": "1 GPa", "yield_stress": "1 GPa"},
            "yield_stress or hardness, not both",
        ),
        (
            {"name": "coper"},
            "material.name: given 'coper', expected .*; perhaps meant: 'copper, soft'",
        ),
        ({"name": 3}, "material.name: given 3"),
        ({"hardness": "1 GPa", "nix_gao_depth": "-1 um"}, "nix_gao_depth: given '-1 um'"),
    ],
)
def test_bad_solids_are_refused(keys, words):
    with pytest.raises(fs.InputError, match=words):
        case_of_solids(YOUNG | keys)

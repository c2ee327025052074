"""Solids of a case: metals by their name, hardness as a curve or from a file, and which of two faces yields."""

import pytest
from numpy.testing import assert_allclose
from small_cases import HARDENED as CASE

import femseal as fs
from femseal.case import case_schema, parse_case
from femseal.case.hot_hardness import hot_hardness_warnings
from femseal.contact import HardnessTable, NixGao, PerfectlyPlastic
from femseal.materials import METALS, named_solid
from femseal.preparation import prepare
from femseal.preparation.drawing_values import read_drawing

YOUNG = {"young": "210 GPa"}
ROWS = [["0 um", "1 GPa"], ["0.5 um", "1.4 GPa"], ["2 um", "1.6 GPa"]]
SMALL = {"load": {"loading": ["100 MPa", "500 MPa"]}}


def case(material, counter=None, **more):
    return parse_case(
        CASE
        | SMALL
        | {"material": material}
        | ({"counter_material": counter} if counter else {})
        | more
    )


def test_ten_metals_have_values_and_sources():
    assert len(METALS) == 10
    for name, (solid, source) in METALS.items():
        assert 60e9 < solid.young < 220e9
        assert 0.25 < solid.poisson < 0.4
        assert 10e6 < solid.yield_stress < 1.2e9
        assert source
        assert fs.named_solid(name.upper()) is solid


@pytest.mark.parametrize(
    ("given", "nearest"),
    [("copper", "copper, soft"), ("coper, soft", "copper, soft"), ("304", "steel 304/316, annealed"),
     ("inconel", "Inconel 718, aged"), ("316L", "steel 304/316, annealed"), ("AlMg 6061", "aluminium 6061-T6")],
)  # fmt: skip
def test_an_unknown_name_is_told_the_nearest(given, nearest):
    said = rf"^name: given '{given}', expected one of .*; perhaps meant: '{nearest}'$"
    with pytest.raises(fs.InputError, match=said):
        named_solid(given)


def test_a_name_fills_in_what_is_not_given():
    alloy, known = case({"name": "Inconel 718, aged"}).solids[0], named_solid("Inconel 718, aged")
    assert (alloy.young, alloy.poisson, alloy.hardness) == (
        known.young,
        known.poisson,
        known.hardness,
    )
    own = case({"name": "Inconel 718, aged", "young": "190 GPa", "hardness": "4 GPa"})
    assert own.solids[0] == fs.Solid(190e9, 0.29, hardness=4e9)
    assert own.named_warnings == ()


@pytest.mark.parametrize("name", METALS)
def test_a_metal_by_its_name_has_the_hardness_of_an_indentation_in_every_path(name):
    """In a case, as a coating, in Python and from a drawing; a hardness or a yield stress of the case comes first."""
    hardness = fs.named_solid(name).hardness
    load = {"load": {"loading": ["10 MPa"]}}
    by_name = case({"name": name}, **load)
    coated = case(YOUNG | {"coating": {"name": name, "thickness": "20 um"}}, **load)
    assert by_name.law.hardness == hardness
    assert coated.material.coating.solid.hardness == hardness
    from_drawing = read_drawing({"ra": "1.6 um", "pitch": "0.1 mm", "metal": name.upper()}, None)
    assert from_drawing.hardness == hardness
    assert from_drawing.metal == name
    assert case({"name": name, "yield_stress": "100 MPa"}, **load).law.hardness == pytest.approx(
        280e6
    )
    assert case({"name": name, "hardness": "300 MPa"}, **load).law.hardness == 300e6


def test_a_ring_that_yields_as_a_whole_is_warned_of():
    """A ring between flat faces yields at 2/√3 times its yield stress, that of its name, its keys or its hardness."""

    def warnings(pressure, material, **more):
        load = {"load": {"loading": ["1 MPa", f"{pressure} MPa"]}}
        prepared = prepare(parse_case(CASE | load | {"material": material} | more))
        return [text for text in prepared.warnings if "yield as a whole" in text]

    copper, limit = {"name": "copper, soft"}, 2 / 3**0.5 * 48
    assert not warnings(0.99 * limit, copper)
    (text,) = warnings(1.01 * limit, copper)
    assert "from about 55.4 MPa on" in text
    assert "48 MPa as delivered" in text
    assert "a ring of [material], copper, soft, between" in text
    assert not warnings(60, {"young": "117 GPa", "yield_stress": "55 MPa"})
    assert warnings(60, {"young": "117 GPa", "yield_stress": "50 MPa"})
    # the weaker body counts, below its coating
    assert not warnings(
        100,
        {
            "name": "Inconel 718, aged",
            "coating": {"name": "silver, annealed", "thickness": "0.1 mm"},
        },
    )
    assert warnings(60, {"name": "Inconel 718, aged"}, counter_material=copper)
    # from a hardness alone, only an upper estimate of the yield stress is known
    (text,) = warnings(45, {"young": "117 GPa", "hardness": "100 MPa"})
    assert "lower for an annealed metal" in text


def test_a_ring_that_yields_is_told_the_force_from_which_on():
    ring = {"loading": ["10 N", "50 N"]}
    size = {"length": "20 mm", "realisations": 3}
    made = parse_case(
        CASE
        | {"method": "stochastic", "load": ring, "stochastic": size}
        | {"material": {"name": "copper, soft"}}
    )
    prepared = prepare(made)
    (text,) = [text for text in prepared.warnings if "yield as a whole" in text]
    force = 2 / 3**0.5 * 48e6 / max(step.pressure for step in prepared.scene.steps) * 50
    assert f"from about {force:.3g} N (55.4 MPa) on" in text


def test_another_ratio_of_hardness_to_yield_stress():
    ratio = {"hardness_over_yield": 2.3}
    assert_allclose(case(YOUNG | {"yield_stress": "1 GPa"} | ratio).law.hardness, 2.3e9)
    assert_allclose(case({"name": "Inconel 718, aged"} | ratio).law.hardness, 2.3 * 1034e6)
    silver = {"name": "silver, annealed", "thickness": "20 um"} | ratio
    layer = case({"name": "Inconel 718, aged", "coating": silver}).material.body.layer
    assert_allclose(layer.hardness, 2.3 * 54e6)


@pytest.mark.parametrize("solid", [YOUNG, {"name": "Inconel 718, aged"}])
@pytest.mark.parametrize("keys", [{"hardness": "1 GPa"}, {"hardness_table": ROWS}])
def test_a_ratio_of_hardness_to_yield_stress_contradicts_a_hardness(solid, keys):
    with pytest.raises(fs.InputError, match="hardness_over_yield with a yield_stress"):
        case(solid | {"hardness_over_yield": 2.3} | keys)


def test_a_ratio_of_hardness_to_yield_stress_needs_a_yield_stress():
    with pytest.raises(fs.InputError, match="hardness_over_yield with a yield_stress"):
        case(YOUNG | {"hardness_over_yield": 2.3})


def test_a_value_far_from_that_of_the_name_is_warned_of():
    odd = case(
        {"name": "Inconel 718, aged", "hardness": "9 GPa"},
        {"name": "steel 1.4571, annealed", "young": "2.4 TPa"},
    )
    one, two = odd.named_warnings
    assert one.startswith("material.hardness 9 GPa is 2 times that of Inconel 718, aged, 4.44")
    assert two.startswith("counter_material.young 2400 GPa is 12 times that of steel")
    assert "named_warnings" not in {*odd.echo(), *case_schema()["properties"]}


@pytest.mark.parametrize(
    ("fluid", "solid", "keys"),
    [
        ({"temperature": "250 °C"}, {"name": "copper, soft"}, ["material.hardness"]),
        # 476 MPa is the value of the table with three digits, as a case from a drawing states it
        ({"temperature": "523 K"}, {"name": "copper, soft", "hardness": "476 MPa"}, ["material."]),
        ({"temperature": "250 °C"}, {"name": "copper, soft", "hardness": "300 MPa"}, []),
        ({"temperature": "250 °C"}, {"name": "copper, soft", "yield_stress": "40 MPa"}, []),
        ({"temperature": "250 °C"}, YOUNG | {"hardness": "1 GPa"}, []),
        ({"temperature": "60 °C"}, {"name": "copper, soft"}, []),
        ({}, {"name": "copper, soft"}, []),
        (
            {"temperature": "250 °C"},
            {
                "name": "Inconel 718, aged",
                "hardness": "4 GPa",
                "coating": {"name": "silver, annealed", "thickness": "20 um"},
            },
            ["material.coating.hardness"],
        ),
    ],
)
def test_a_hot_fluid_beside_the_hardness_of_a_metal_at_room_temperature_is_warned_of(
    fluid, solid, keys
):
    gas = {"kind": "ideal-gas", "viscosity": "30 uPa*s", "molar_mass": "4 g/mol"}
    pressures = {"inlet_pressure": "2 bar", "outlet_pressure": "1 bar"}
    temperature = {"temperature": "20 °C"} | fluid
    load = {"loading": ["50 MPa", "100 MPa"]}
    hot = case(solid, fluid=gas | pressures | temperature, load=load)
    said = [text for text in hot.named_warnings if "is that at 20 °C" in text]
    assert len(said) == len(keys)
    assert all(f"Set {key}" in text for text, key in zip(said, keys, strict=True))


def test_only_the_softer_body_is_warned_of_beside_a_hot_fluid():
    """The hardness of the nickel alloy does not matter, as the hot copper yields first."""
    alloy = {"name": "Inconel 718, aged"}

    def warnings(material, counter):
        data = {"fluid": {"temperature": "250 °C"}, "material": material}
        return [*hot_hardness_warnings(data | {"counter_material": counter})]

    for copper in ({"hardness": "0.3 GPa"}, {"yield_stress": "50 MPa"}):
        assert not warnings(copper, alloy)
        assert not warnings(alloy, copper)
    (text,) = warnings({"name": "copper, soft"}, alloy)
    assert "Set material.hardness" in text
    (text,) = warnings({"name": "copper, soft", "hardness_over_yield": 3}, alloy)
    assert "copper" in text


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
    made = case(YOUNG | keys)
    assert made.law == law
    results = fs.run(made)
    assert results.dataset.attrs["contact_law"] == str(law)
    assert results.deterministic.plastic_fraction[1] > 0


def test_a_table_from_a_file_has_its_units(tmp_path):
    path = tmp_path / "indentation.csv"
    path.write_text("hardness [GPa]; depth [nm]\n1; 0\n1.4; 500\n\n1.6; 2000\n")
    of_file = CASE | SMALL | {"material": YOUNG | {"hardness_table": "indentation.csv"}}
    from_file = parse_case(of_file, tmp_path)
    assert from_file.law == case(YOUNG | {"hardness_table": ROWS}).law
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
        made = case(face, counter)
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
        case(YOUNG | keys)

"""Gauge and absolute pressures of fluids, and kinematic viscosities, in a case file."""

import json
import re

import pytest
from numpy.testing import assert_allclose
from small_cases import CASE

import femseal as fs
from femseal.case import case_schema, parse_case
from femseal.preparation import prepare

ATMOSPHERE, PSI = 101_325.0, 6894.757293168361
LIQUID = 'kind = "liquid"\nviscosity = "1 mPa*s"\n'
WATER = LIQUID + "inlet_pressure = "
OIL = 'kind = "liquid"\nviscosity = "46 cSt"\n'


def case_of(folder, table, more=""):
    path = folder / "case.toml"
    path.write_text(re.sub(r'kind = "liquid"\nvis.*\n.*\n', table, CASE) + more)
    return path


def ends(case):
    return case.fluid.inlet_pressure, case.fluid.outlet_pressure


@pytest.mark.parametrize(
    ("keys", "wanted"),
    [
        ('inlet_pressure = "10 bar(g)"', (1e6 + ATMOSPHERE, ATMOSPHERE)),
        ('inlet_pressure = "10 bar(g)"\nambient_pressure = "0.9 bar"', (1.09e6, 9e4)),
        ('inlet_pressure = "10 bar(a)"\nambient_pressure = "0.9 bar"', (1e6, 9e4)),
        ('inlet_pressure = "10 bar(a)"', (1e6, ATMOSPHERE)),
        ('inlet_pressure = "10 bar(g)"\noutlet_pressure = "0 bar(a)"', (1e6 + ATMOSPHERE, 0.0)),
        (
            'inlet_pressure = "0 bar(g)"\noutlet_pressure = "-0.5 bar(g)"',
            (ATMOSPHERE, ATMOSPHERE - 5e4),
        ),
        ('inlet_pressure = "10 bar"', (1e6, 0.0)),
    ],
)
def test_in_the_table_of_a_fluid(tmp_path_factory, keys, wanted):
    case = fs.load_case(case_of(tmp_path_factory.mktemp("case"), LIQUID + keys + "\n"))
    assert_allclose(ends(case), wanted, rtol=1e-12)
    # the echo has them in SI, and is a case again with units
    fluid = json.loads(json.dumps(case.echo()["fluid"]))
    assert_allclose((fluid["inlet_pressure"], fluid["outlet_pressure"]), wanted, rtol=1e-12)


def test_of_a_gas_at_another_ambient_pressure_and_of_a_test_fluid(tmp_path):
    gas = 'name = "helium"\ninlet_pressure = "3 bar(g)"\nambient_pressure = "0.8 bar"\n'
    test = '[output.test_fluid]\nname = "helium"\ninlet_pressure = "1 bar(g)"\n'
    for more, wanted in (("", (1.8e5, 0.8e5)), ('ambient_pressure = "1 bar"\n', (2e5, 1e5))):
        case = fs.load_case(case_of(tmp_path, gas, test + more))
        assert_allclose(ends(case), (3.8e5, 0.8e5))
        own = case.output.test_fluid
        assert_allclose((own.inlet_pressure, own.outlet_pressure), wanted)


def test_the_fluid_presses_on_the_faces_with_what_is_above_the_surroundings(tmp_path):
    """What an unmarked liquid carries counts from the surroundings, as a gauge pressure does."""
    carried = []
    for keys in (
        'inlet_pressure = "10 MPa"',
        'inlet_pressure = "100 bar(g)"\nambient_pressure = "0.8 bar"',
    ):
        scene = prepare(fs.load_case(case_of(tmp_path, f"{LIQUID}{keys}\n"))).scene
        carried.append(scene.acting_fluid.mean_if_separated)
    assert scene.surroundings == 8e4
    assert_allclose(carried, 5e6, rtol=1e-12)


def test_pressures_of_several_inlets_of_a_mesh_say_what_to_do_instead():
    seal = {"kind": "mesh", "path": "seal.msh", "unit": "mm", "outlet": "rim"}
    seal["inlet"] = {"bore": "10 bar(g)", "port": "4 bar"}
    said = r"^seal.inlet: given .*, expected names of boundaries, which all have the inlet pressure"
    with pytest.raises(fs.InputError, match=rf"(?m){said}"):
        parse_case({"seal": seal})


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (WATER + '"-2 bar(g)"\n', r"fluid.inlet_pressure: given '-2 bar\(g\)'"),
        (WATER + '"1 bar(a)"\n', "fluid.inlet_pressure: given .* a pressure above that of"),
        (
            WATER + '"1 bar(g)"\nambient_pressure = "1 bar(g)"\n',
            r"fluid.ambient_pressure: .*without",
        ),
        (WATER + '"1 bar(g)"\nambient_pressure = 1\n', r"fluid.ambient_pressure: given 1"),
        (OIL, "fluid.viscosity: given '46 cSt', expected a density in addition to the kinematic"),
        (OIL + 'density = "870 kg"', "fluid.density: given '870 kg'"),
        (
            OIL.replace("46", "-46") + 'density = "870 kg/m^3"',
            "fluid.viscosity: given '-46 cSt'",
        ),
        (
            'kind = "ideal-gas"\nviscosity = "15 cSt"\nmolar_mass = "29 g/mol"\ntemperature = "20 °C"',
            "dynamic .* of a gas",
        ),
        (
            'name = "helium"\nviscosity = "15 cSt"',
            "fluid.viscosity: given '15 cSt', expected a dynamic viscosity of a gas",
        ),
    ],
)
def test_faults_name_their_key(tmp_path_factory, table, said):
    if "inlet_pressure" not in table:
        table += '\ninlet_pressure = "1 MPa"\n'
    with pytest.raises(fs.InputError, match=said):
        fs.load_case(case_of(tmp_path_factory.mktemp("case"), table))


def test_the_schema_knows_gauge_pressures():
    inlet = case_schema()["definitions"]["LiquidTable"]["properties"]["inlet_pressure"]
    assert re.match(inlet["pattern"], "10 bar(g)")
    assert re.match(inlet["pattern"], "10 barg")


@pytest.mark.parametrize(
    ("keys", "viscosity"),
    [
        ('kind = "liquid"\nviscosity = "46 cSt"\ndensity = "870 kg/m^3"', 46e-6 * 870),
        ('kind = "liquid"\nviscosity = "46 mm^2/s"\ndensity = "0.87 g/cm^3"', 46e-6 * 870),
        (
            'kind = "roelands-liquid"\nviscosity = "46 cSt"\ndensity = "870 kg/m^3"\npressure_viscosity = "20 1/GPa"',
            0.04002,
        ),
        ('name = "mineral oil ISO VG 46"\nviscosity = "46 cSt"', 46e-6 * 870),
        ('name = "water"\nviscosity = "46 cSt"\ndensity = "900 kg/m^3"', 46e-6 * 900),
    ],
)
def test_a_kinematic_viscosity_with_a_density(tmp_path_factory, keys, viscosity):
    folder = tmp_path_factory.mktemp("case")
    case = fs.load_case(case_of(folder, keys + '\ninlet_pressure = "1 MPa"\n'))
    assert_allclose(case.fluid.fluid.viscosity, viscosity, rtol=1e-12)

"""Fluids by name: the table, CoolProp, and names in a case."""

import sys

import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.fluids import FLUIDS
from femseal.named_fluids import FLUID_TABLE, _name_in_coolprop, _plain_name, named_fluid


def test_every_fluid_of_the_table_can_be_made():
    assert len(FLUID_TABLE) == 10
    for found in FLUID_TABLE.values():
        FLUIDS[found.kind](**found.parameters)
    assert named_fluid("Helium") is FLUID_TABLE["helium"]


@pytest.mark.parametrize("name", [n for n in FLUID_TABLE if "oil" not in n])
def test_the_table_agrees_with_coolprop(name):
    coolprop = pytest.importorskip("CoolProp.CoolProp")
    state = ("T", 293.15, "P", 101325, name)
    found = FLUID_TABLE[name].parameters
    assert_allclose(found["viscosity"], coolprop.PropsSI("V", *state), rtol=1e-3)
    density = FLUIDS[FLUID_TABLE[name].kind](**found).reference_density
    assert_allclose(density, coolprop.PropsSI("D", *state), rtol=2e-3)


def test_properties_at_other_temperatures_come_from_coolprop():
    pytest.importorskip("CoolProp")
    hot = named_fluid("helium", 423.15, (1e6, 1e5))
    assert hot.kind == "ideal-gas"
    assert hot.parameters["temperature"] == 423.15
    assert_allclose(hot.parameters["viscosity"], 25.3e-6, rtol=0.01)
    assert named_fluid("water", 423.15, (10e6, 6e6)).kind == "liquid"
    assert named_fluid("water", 423.15, (2e5, 1e5)).kind == "ideal-gas"
    with pytest.raises(fs.InputError, match="a gas, or a liquid, at both ends"):
        named_fluid("water", 423.15, (10e6, 1e5))
    with pytest.raises(fs.InputError, match="a temperature from"):
        named_fluid("helium", 1e5)
    with pytest.raises(fs.InputError, match=r"'grease'.*helium.*Acetone"):
        named_fluid("grease")


@pytest.mark.parametrize(
    ("written", "fluid"),
    [
        ("carbon dioxide", "CarbonDioxide"),
        ("Carbon-Dioxide", "CarbonDioxide"),
        ("CO2", "CarbonDioxide"),
        ("R-744", "CarbonDioxide"),
        ("sulphur hexafluoride", "SulfurHexafluoride"),
        ("iso-butane", "IsoButane"),
        ("R 134a", "R134a"),
        ("ethene", "Ethylene"),
        ("n2", "Nitrogen"),
        ("compressed air", "Air"),
        ("ISO-PENTANE", "Isopentane"),
    ],
)
def test_fluids_are_found_by_all_names_that_coolprop_knows(written, fluid):
    pytest.importorskip("CoolProp")
    assert _name_in_coolprop(written) == fluid
    if fluid == "Ethylene":
        with pytest.raises(fs.InputError, match=r"'ethene' .*knows only the density. Give"):
            named_fluid(written, 400.0)
        return
    hot = named_fluid(fluid, 400.0)
    assert named_fluid(written, 400.0) == hot
    assert fs.RealGas(written, 400.0).molar_mass == hot.parameters["molar_mass"]


def test_a_plain_name_is_that_of_one_fluid():
    CoolProp = pytest.importorskip("CoolProp.CoolProp")
    found = {}
    for fluid in CoolProp.get_global_param_string("fluids_list").split(","):
        for name in (fluid, *CoolProp.get_aliases(fluid)):
            assert found.setdefault(_plain_name(name), fluid) == fluid
            assert _name_in_coolprop(name) == fluid


def test_fluids_of_the_table_are_found_by_formulas_and_other_names():
    for written, name in {
        "H2O": "water",
        "He": "helium",
        "dry air": "air",
        "GN2": "nitrogen",
    }.items():
        assert named_fluid(written) is FLUID_TABLE[name]


def test_steam_is_a_gas():
    pytest.importorskip("CoolProp")
    hot = named_fluid("steam", 473.15, (5e5, 1e5))
    assert hot == named_fluid("water", 473.15, (5e5, 1e5))
    assert hot.kind == "ideal-gas"
    assert fs.RealGas("Steam", 473.15).molar_mass == hot.parameters["molar_mass"]
    for temperature, pressures in ((293.15, (5e5, 1e5)), (373.15, (20e5, 10e5))):
        with pytest.raises(fs.InputError, match=r"^name: given 'steam' .*it is a gas at both ends"):
            named_fluid("steam", temperature, pressures)


def test_without_coolprop_a_message_lists_the_table(monkeypatch):
    monkeypatch.setitem(sys.modules, "CoolProp", None)
    assert named_fluid("air").kind == "ideal-gas"
    for name, temperature in (("air", 400.0), ("grease", 293.15)):
        with pytest.raises(
            fs.InputError, match=r"methane at 20 °C; .*pip install 'femseal\[fluids\]'"
        ):
            named_fluid(name, temperature)

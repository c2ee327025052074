"""A hot fluid beside a hardness at room temperature is warned of."""

import pytest
from solids_in_cases import YOUNG, case_of_solids

from femseal.case.hot_hardness import hot_hardness_warnings


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
    hot = case_of_solids(solid, fluid=gas | pressures | temperature, load=load)
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

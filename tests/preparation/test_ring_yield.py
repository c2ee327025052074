"""A load that makes the softer ring yield as a whole is warned of."""

from small_cases import HARDENED as CASE

from femseal.case import parse_case
from femseal.preparation import prepare


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

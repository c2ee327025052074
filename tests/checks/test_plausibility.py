"""The body below a line contact yields at 1.79 times its own yield stress, whatever the hardness of the law is."""

from dataclasses import replace

import numpy as np
import pytest
from small_cases import HARDENED, scene_of_law

from femseal.case import parse_case
from femseal.checks import line_contact_warnings
from femseal.contact import PerfectlyPlastic


@pytest.mark.parametrize("hardness", [0.3e9, 1.12e9, 2e9])
def test_the_yield_stress_of_the_body_counts_and_not_the_hardness(hardness):
    scene = scene_of_law(PerfectlyPlastic(hardness), 2.5e8)
    known = replace(scene, body_yield_stress=400e6)
    below, above = (np.array([[factor * 1.79 * 400e6]]) for factor in (0.99, 1.01))
    assert not line_contact_warnings(known, below)
    assert len(line_contact_warnings(known, above)) == 1
    assert "from 716 MPa on" in line_contact_warnings(known, above)[0]
    # a hardness alone is that of a fully plastic indentation
    limit = 1.79 * hardness / 2.8
    assert not line_contact_warnings(scene, np.array([[0.99 * limit]]))
    assert line_contact_warnings(scene, np.array([[1.01 * limit]]))


def test_a_case_knows_the_yield_stress_of_its_weaker_solid():
    solids = {
        "material": {"young": "210 GPa", "yield_stress": "400 MPa", "hardness_over_yield": 4.0},
        "counter_material": {"young": "200 GPa", "poisson": 0.3, "yield_stress": "300 MPa"},
    }
    case = parse_case(HARDENED | solids)
    assert case.body_yield_stress == 300e6
    assert case.law.mean_hardness == pytest.approx(2.8 * 300e6)
    silver = {"thickness": "20 um", "young": "80 GPa", "poisson": 0.37, "hardness": "150 MPa"}
    solids["counter_material"]["coating"] = silver
    coated = parse_case(HARDENED | solids)
    assert coated.body_yield_stress == 300e6
    assert coated.law.mean_hardness == 150e6

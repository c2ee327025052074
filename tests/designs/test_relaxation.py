"""Relaxation: the fraction of a load lost between assembly and service, in a case and in the design of a seal."""

import numpy as np
import pytest
from design_cases import GROOVED, design_case
from leakage_laws import FALL, RISE, power_law
from numpy.testing import assert_allclose, assert_array_equal
from power_law_seals import AMPLITUDES

import femseal as fs
from femseal.designs.data_sheet import rows
from femseal.designs.requirements import Seals, requirement
from femseal.loads import LoadProgramme

LOADING = {"loading": ["20 MPa", "100 MPa", "400 MPa"]}
DOWN = {"unload_from": ["100 MPa", "400 MPa"], "unloading": ["20 MPa"]}


@pytest.fixture(scope="module")
def relaxed():
    load = LOADING | DOWN | {"relaxation": 0.1}
    return fs.run(design_case(face=GROOVED, load=load, output={"budget": False}), workers=1)


def by_step(results, values):
    pairs = zip(results.steps, values, strict=True)
    return {(step.pressure, step.unloaded_from): value for step, value in pairs}


def test_it_is_the_unloading_to_the_rest_of_each_load(relaxed):
    explicit = {"unload_from": ["100 MPa", "400 MPa"], "unloading": ["360 MPa", "90 MPa", "20 MPa"]}
    other = fs.run(
        design_case(face=GROOVED, load=LOADING | explicit, output={"budget": False}), workers=1
    )
    assert relaxed.steps == other.steps
    assert_array_equal(relaxed.leakage.values, other.leakage.values)
    found = by_step(relaxed, relaxed.leakage.values)
    for load in (1e8, 4e8):
        assert found[0.9 * load, load] > found[load, None]


def test_the_more_relaxes_the_more_leaks():
    found = []
    for lost in (0, "5 %", 0.2, 0.5):
        load = LOADING | {"unload_from": ["400 MPa"], "unloading": ["20 MPa"], "relaxation": lost}
        results = fs.run(design_case(face=GROOVED, method="two-scale", load=load), workers=1)
        found.append(results.leakage.values[3 if lost else 2])
    assert np.all(np.diff(found) > 0)


def test_without_peaks_every_load_relaxes():
    found = design_case(load=LOADING | {"relaxation": 0.25}).load.pressures(1.0, 1.0)
    assert found["unload_from"] == (2e7, 1e8, 4e8)
    assert found["unloading"] == (3e8, 7.5e7, 1.5e7)
    forces = design_case(load={"loading": ["10 kN"], "relaxation": 0.1}).load.pressures(1e-4, 0.1)
    assert forces == {"loading": (1e8,), "unload_from": (1e8,), "unloading": (9e7,)}


@pytest.mark.parametrize("value", [1, 1.5, -0.1, "100 %", "10 MPa", "some"])
def test_what_is_no_fraction_is_refused(value):
    with pytest.raises(fs.InputError, match=r"load.relaxation: given .*, expected"):
        design_case(load=LOADING | DOWN | {"relaxation": value})


def test_pressure_in_assembly_with_relaxation_of_power_laws_is_exact():
    """L = A q^−3 (1 − r)^−½ after relaxing from q: the peaks on which the limit lies are straight in log–log."""
    peaks, lost = [5e7, 1e8, 4e8, 9e8], 0.2
    steps = LoadProgramme.of([1e7], unload_from=peaks, unloading=[0.8 * p for p in peaks])
    seals, limit = Seals.from_leakage(steps, power_law(AMPLITUDES, steps)), 1e12 * 2e8**-FALL
    exact = (AMPLITUDES * (1 - lost) ** -RISE / limit) ** (1 / FALL)
    assert_allclose(seals.needed_with_relaxation(limit, lost), exact)
    need = requirement(seals, "L", limit, 0.9, lost)
    assert_allclose(need.relaxed.value, need.assembly.value * (1 - lost) ** (-RISE / FALL))
    assert requirement(seals, "L", limit, 0.9).relaxed is None


def test_the_design_says_what_is_left(relaxed):
    leak = by_step(relaxed, relaxed.class_leakage[1].max(0))
    # of water, which all seals keep after relaxing from 400 MPa
    limit = 1.0001 * leak[3.6e8, 4e8] * 1e9
    answer = fs.design(relaxed, classes=[f"{limit:.8g} mg/(m·s)"])
    (need,) = answer.requirements
    assert need.assembly.value <= need.relaxed.value <= 4e8
    assert need.service[4e8].value <= 3.6e8
    assert any(row["figure"] == "Qmin with relaxation [Pa]" for row in rows(answer))

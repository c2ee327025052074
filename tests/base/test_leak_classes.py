"""Leakage classes: their published limits, their names, what a seal reaches, and the test fluid that decides it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import STRIP, steel_scene

import femseal as fs
from femseal.base import InputError
from femseal.base.leak_classes import LEAK_CLASSES, find_leak_classes, within
from femseal.base.leak_units import LEAK_UNITS
from femseal.case import parse_case
from femseal.fluids import leak_basis
from femseal.results import RunFacts, assemble, save
from femseal.studies import FluidState, OtherLeakage, drop_ratio
from femseal.studies.other_fluid import limit_factors

HELIUM = fs.IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15, slip=False)
NITROGEN = fs.IdealGas(viscosity=17.5e-6, molar_mass=28.0134e-3, temperature=293.15, slip=False)
WATER = fs.Liquid(1e-3, 998.0)


def test_limits_of_classes_agree_with_the_standards():
    """TA Luft tells its limit in both units; the rates of ISO 5208 are mm³/s per mm of nominal diameter."""
    helium, water = leak_basis(HELIUM, 0.5), leak_basis(WATER, 0.5)
    luft = LEAK_CLASSES["TA Luft"].limit(helium) / helium.factor(LEAK_UNITS["mbar·L/(m·s)"])
    assert_allclose(luft, 0.0609, rtol=1e-3)
    assert_allclose(LEAK_CLASSES["VDI 2440"].limit(helium) * 101_325 / 0.1, 1e-4)
    assert_allclose(LEAK_CLASSES["L0.01"].limit(water), 1e-8 / 998)
    published = {"AA": (0.006, 0.18), "C": (0.03, 3.0), "CC": (0.08, 22.3), "EE": (0.39, 470), "G": (2, 6000)}  # fmt: skip
    for rate, rates in published.items():
        found = [limit(f"ISO 5208 {rate}", basis, 0.05) for basis in (water, helium)]
        assert_allclose(found, np.multiply(rates, 50e-9))
    assert limit("ISO 5208 A", water, 0.05) == 0
    # whichever way it flows
    one = LEAK_CLASSES["L1"].limit(water)
    around = within(one * np.array([0.99, 1.01, -0.99, -1.01, np.nan]), one)
    assert around.tolist() == [True, False, True, False, False]
    rates = [one.amount for one in LEAK_CLASSES.values() if one.family == "ISO 5208"]
    assert rates == sorted(rates)


def limit(name, basis, diameter=None):
    """Of the whole seal [m³/s]."""
    return LEAK_CLASSES[name].limit(basis, diameter) * basis.length


def test_limits_of_api_598_depend_on_the_nominal_size_of_the_valve():
    """Its table: 5, 6, 8, 12 and 48 drops a minute at DN 65, 80, 100, 150 and 600, 16 of which are 1 mL."""
    water, helium = leak_basis(WATER, 0.5), leak_basis(HELIUM, 0.5)
    for size, drops in ((15, 0), (50, 0), (65, 5), (80, 6), (100, 8), (150, 12), (600, 48)):
        found = [limit("API 598", basis, size * 1e-3) for basis in (water, helium)]
        assert_allclose(found, drops * 1e-6 / 60 / np.array([16, 50]), atol=1e-30)


def test_limits_of_fci_70_2_agree_with_its_tables():
    """FCI 70-2 has class V in SI too, rounded: 5e-12 m³/s per mm and bar; class IV is a part of the rated capacity."""
    water = leak_basis(WATER, 0.5, pressure_drop=2e6, capacity=1e-3)
    assert_allclose(limit("FCI 70-2 V", water, 0.1), 5e-12 * 100 * 20, rtol=0.06)
    assert_allclose(limit("FCI 70-2 IV", water), 1e-7)
    air = leak_basis(NITROGEN, 0.5)
    between = np.sqrt((102**2 + 152**2) / 2)
    rates = [(10, 0.15), (25, 0.15), (102, 1.7), (400, 28.4), (between, (1.7 + 4) / 2)]
    for seat, rate in rates:
        assert_allclose(limit("FCI 70-2 VI", air, seat * 1e-3), rate * 1e-6 / 60)


@pytest.mark.parametrize(
    ("written", "fluid", "diameter", "said"),
    [
        ("FCI 70-2 VI", NITROGEN, 0.5, "nominal_diameter: given 0.5 for the class .*400 mm"),
        ("FCI 70-2 VI", WATER, 0.1, "FCI 70-2 VI, which is defined for gas"),
        ("FCI 70-2 IV", NITROGEN, None, "rated_capacity: given none for the class FCI 70-2 IV"),
        ("ISO 5208 B", WATER, None, "nominal_diameter: given none for the class ISO 5208 B"),
        ("TA Luft", WATER, None, "TA Luft, which is defined for helium"),
        ("TA Luft", NITROGEN, None, "TA Luft, which is defined for helium"),
        ("1 mbar·L/s", WATER, None, "for a liquid"),
    ],
)
def test_classes_without_the_quantities_that_they_need_are_refused(written, fluid, diameter, said):
    (one,) = find_leak_classes([written])
    with pytest.raises(InputError, match=said):
        one.limit(leak_basis(fluid, 0.5), diameter)


@pytest.mark.parametrize("temperature", [273.15, 293.15])
@pytest.mark.parametrize("throughput_temperature", [None, 273.15, 313.15])
def test_limits_of_iso_15848_1_are_masses_per_circumference_of_the_stem(
    temperature, throughput_temperature
):
    """AH, BH, CH of ISO 15848-1 are 1e-5, 1e-4 and 1e-2 mg/(m·s) of helium on the circumference of the stem.

    At 0 °C, they are 1.78e-7, 1.78e-6 and 1.78e-4 mbar·L/s for each mm of the diameter of the stem.
    """
    gas = replace(HELIUM, temperature=temperature)
    basis = leak_basis(gas, 0.1, throughput_temperature)
    at_freezing = leak_basis(gas, 0.1, 273.15)
    for name, mass, volume in (("AH", 1e-5, 1.78e-7), ("BH", 1e-4, 1.78e-6), ("CH", 1e-2, 1.78e-4)):
        found = limit(f"ISO 15848-1 {name}", basis, 0.02)
        assert_allclose(found * gas.reference_density, np.pi * 0.02 * mass * 1e-6, rtol=1e-5)
        throughput = found / 0.1 / at_freezing.factor(LEAK_UNITS["mbar·L/s"])
        assert_allclose(throughput, 20 * volume, rtol=3e-3)


@pytest.mark.parametrize(
    ("written", "names"),
    [
        ("l0.01", ["L0.01"]),
        ("L1.0", ["L1"]),
        ("L0,1", ["L0.1"]),
        ("ta-luft 2021", ["TA Luft"]),
        ("VDI2440", ["VDI 2440"]),
        ("iso 5208 rate cc", ["ISO 5208 CC"]),
        ("EN 12266-1 rate C", ["ISO 5208 C"]),
        ("api-598", ["API 598"]),
        ("fci 70-2", ["FCI 70-2 VI", "FCI 70-2 V", "FCI 70-2 IV"]),
        ("ISO 15848-1 class AH", ["ISO 15848-1 AH"]),
        ("EN 1591-1", ["L0.01", "L0.1", "L1"]),
        ("1e-3 mbar*L/s", ["0.001 mbar·L/s"]),
    ],
)
def test_classes_are_found_by_their_usual_spellings(written, names):
    assert [one.name for one in find_leak_classes([written])] == names


@pytest.mark.parametrize(
    "written", ["L2", "", "ISO 5208 H", "5 furlong", "mL/min", "-1 mL/min", "1e999 mL/min", 3]
)
def test_unknown_names_of_classes_are_refused(written):
    with pytest.raises(InputError, match=r"classes: given .*TA Luft"):
        find_leak_classes([written])


def test_multipliers_of_the_limits_agree_with_the_standards():
    """He → N₂: 1.12 in viscous flow; in molecular flow √(4.0026/28.0134) = 0.378, rounded to 0.374 in tables."""
    factors = limit_factors(FluidState(HELIUM, 2e5, 1e5), FluidState(NITROGEN, 2e5, 1e5))
    assert_allclose(factors.viscous, 1.12, rtol=1e-3)
    assert_allclose(factors.molecular, 0.374, rtol=0.012)
    other = limit_factors(FluidState(HELIUM, 2e5, 1e5), FluidState(NITROGEN, 3e5, 1e5))
    assert_allclose(other.viscous / factors.viscous, 8 / 3)
    assert_allclose(other.molecular / factors.molecular, 2)
    assert np.isnan(
        limit_factors(FluidState(HELIUM, 2e5, 1e5), FluidState(WATER, 2e5, 1e5)).molecular
    )


@pytest.fixture(scope="module")
def studied():
    face = fs.self_affine((32, 32), (60e-6, 60e-6), hurst=0.8, rms_slope=0.1, rng=1)
    loads = {"loading": (2e7, 1e8, 4e8), "unload_from": (4e8,), "unloading": (1e8, 2e7)}
    scene = steel_scene(face, fluid=WATER, **loads)
    return scene, fs.deterministic(scene)


def test_leakage_of_a_test_fluid_equals_that_of_a_study_with_this_fluid(studied):
    scene, study = studied
    state = FluidState(HELIUM, 4e6, 1e5)
    again = fs.deterministic(state.in_scene(scene))
    found = OtherLeakage.of_study(state, study, drop_ratio(state, scene)).leakage
    assert_allclose(found, again.leakage, rtol=1e-12)
    assert again.leakage[0] > 0


def test_results_contain_the_classes_that_each_load_step_meets(studied):
    scene, study = studied
    leak = study.leakage
    middle = np.sqrt(leak[1] * leak[2]) * WATER.density * 1e6
    wanted = [f"{middle:g} mg/(m·s)", "EN 13555", "ISO 5208"]
    facts = RunFacts(classes=wanted, nominal_diameter=0.05)
    results = assemble(scene, study, facts=facts)
    reached = results.dataset["class_met"].values[0]
    assert reached.tolist() == [float(q <= middle * 1e-6 / WATER.density) for q in leak]
    assert reached[1:3].tolist() == [0, 1]
    assert_allclose(results.dataset["class_fraction"], results.dataset["class_met"])
    for q, told in zip(leak, results.classes, strict=True):
        for family in ("L", "ISO 5208"):
            tightest = [
                one.name
                for one in LEAK_CLASSES.values()
                if one.name.startswith(family) and within(q, one.limit(results.leak_basis, 0.05))
            ]
            assert tightest[:1] == [name for name in told.split(", ") if name.startswith(family)]
    assert any("a seat of 50 mm is about 157 mm long" in text for text in results.warnings)
    assert assemble(scene, study).classes == []


def test_classes_are_judged_by_the_test_fluid(studied, tmp_path):
    scene, study = studied
    state = FluidState(HELIUM, 4e6, 1e5)
    other = OtherLeakage.of_study(state, fs.deterministic(state.in_scene(scene)))
    middle = np.sqrt(other.leakage[0] * other.leakage[2]) * 101_325 * 10
    facts = RunFacts(test=other, classes=["TA Luft", f"{middle:g} mbar·L/(m·s)"])
    results = assemble(scene, study, facts=facts)
    limits = np.array([[1e-8 / HELIUM.reference_density], [middle / 1_013_250]])
    met = results.dataset["class_met"].values
    assert np.array_equal(met, other.leakage <= limits)
    assert 0 < met[1].sum() < len(scene.steps)
    save(results, tmp_path)
    again = fs.open_results(tmp_path)
    assert again.classes == results.classes
    assert again.class_basis == results.class_basis
    assert again.leak_basis == results.leak_basis


def case(**output):
    drawn = {"length": "300 um", "realisations": 5}
    return STRIP | {"cells": {"count": [2, 2]}, "stochastic": drawn, "output": output}


HELIUM_TABLE = {
    "kind": "ideal-gas",
    "viscosity": "19.6 uPa*s",
    "molar_mass": "4.0026 g/mol",
    "temperature": "20 °C",
    "inlet_pressure": "40 bar",
    "slip": False,
}


def test_a_case_can_request_classes_and_a_test_fluid():
    asked = case(classes=["ta-luft", "L1"], test_fluid=HELIUM_TABLE, leakage_unit="mbar·L/s")
    results = fs.run(parse_case(asked), workers=1)
    assert results.leak_unit.per_length
    assert fs.compare({"a": results, "b": results}).unit == results.leak_unit
    data = results.dataset
    test = data["test_leakage_realisations"].values
    state, own = FluidState(HELIUM, 4e6, 101_325), FluidState(fs.Liquid(1e-3), 1e6, 0.0)
    # nearly the ratio of the drops: both press the faces apart a little
    leaks = data["leakage"].values > 0
    assert leaks.any()
    assert_allclose((test / data["leakage"].values)[leaks], state.drop / own.drop, rtol=0.1)
    shares = (test <= 1e-8 / HELIUM.reference_density).mean(axis=0)
    assert_allclose(data["class_fraction"].sel(leak_class="TA Luft"), shares)


def test_drops_and_bubbles_have_the_volume_that_the_case_gives():
    plain = fs.run(parse_case(case()), workers=1)
    valve = {"drop_volume": "0.1 mL", "bubble_volume": "0.3 mL", "rated_capacity": "60 L/min"}
    valve |= {"classes": ["FCI 70-2 IV", "FCI 70-2 V"], "nominal_diameter": "80 mm"}
    other = fs.run(parse_case(case(**valve)), workers=1)
    assert_allclose(other.leakage_in("drops/min"), plain.leakage_in("drops/min") / 2)
    limits = other.dataset["class_limit"].values * other.leak_basis.length
    assert_allclose(limits, [1e-7, 5e-4 * 1e-6 / 60 * 80 / 25.4 * 1e6 / 6894.757])
    assert any("come from secondary sources" in text for text in other.warnings)
    basis = leak_basis(HELIUM, 2.0, bubble_volume=0.3e-6)
    assert_allclose(basis.factor(LEAK_UNITS["bubbles/s"]), 0.15e-6)


def test_a_test_gas_with_slip_is_solved_on_the_same_realisations():
    """Its permeability is another one, so that no ratio of drops converts the leakage."""
    slipping = {"name": "helium", "inlet_pressure": "40 bar"}
    results = fs.run(parse_case(case(classes=["ta-luft"], test_fluid=slipping)), workers=1)
    table = {key: value for key, value in case().items() if key != "output"}
    alone = fs.run(parse_case(table | {"fluid": slipping}), workers=1)
    assert_allclose(
        results.dataset["test_leakage_realisations"], alone.dataset["leakage"], rtol=1e-12
    )
    assert_allclose(results.dataset["test_leakage"], alone.leakage, rtol=1e-12)


def seals_left_open(**output):
    """A strip whose number of seals is left to their scatter: another number for helium than for water."""
    water = {"name": "water", "inlet_pressure": "1 MPa"}
    changes = {"seed": 3, "fluid": water, "stochastic": {"length": "120 um"}}
    return STRIP | changes | {"output": {"budget": False} | output}


def test_a_test_fluid_has_as_many_realisations_as_the_service_fluid():
    """Each has the leakage of helium through the same seal: their number is that which the water asks for."""
    helium = {"name": "helium", "inlet_pressure": "1 bar(g)"}
    results = fs.run(parse_case(seals_left_open(test_fluid=helium)), workers=1)
    count = results.dataset.sizes["realisation"]
    alone = seals_left_open() | {"fluid": helium}
    assert fs.run(parse_case(alone), workers=1).dataset.sizes["realisation"] != count
    given = alone | {"stochastic": {"length": "120 um", "realisations": count}}
    same = fs.run(parse_case(given), workers=1).dataset["leakage"]
    assert_allclose(results.dataset["test_leakage_realisations"], same, rtol=1e-12)


@pytest.mark.parametrize(
    ("output", "fault"),
    [
        ({"classes": ["L2"]}, r"output\.classes\.0: given 'L2', expected 'L1'"),
        ({"classes": ["ISO 5208 B"]}, r"output\.nominal_diameter: given none for the class ISO"),
        ({"classes": ["FCI 70-2 IV"]}, r"output\.rated_capacity: given none for the class FCI"),
        ({"classes": ["TA Luft"]}, r"output\.classes: given TA Luft, which is defined for helium"),
        ({"classes": ["1 std cm³/s"]}, r"output\.classes: given 1 std cm³/s"),
        ({"drop_volume": "-1 mL"}, r"output\.drop_volume: given '-1 mL'"),
        ({"leakage_unit": "bubbles/min"}, r"output\.leakage_unit: given bubbles/min for a liquid"),
        ({"leakage_unit": "std cm³/s"}, r"output\.leakage_unit: given std cm³/s for a liquid"),
        ({"leakage_unit": "furlong"}, r"output\.leakage_unit: given"),
        ({"leakage_unit": 1}, r"output\.leakage_unit: given"),
        ({"throughput_temperature": "-300 °C"}, r"output\.throughput_temperature: given"),
        ({"test_fluid": {"kind": "ideal-gas"}}, r"output\.test_fluid\.viscosity: given nothing"),
        (
            {"test_fluid": HELIUM_TABLE | {"inlet_pressure": "1 Pa"}},
            r"output\.test_fluid\.inlet_pressure: given 1 Pa",
        ),
        (
            {"test_fluid": {"name": "heliun", "inlet_pressure": "40 bar"}},
            r"output\.test_fluid\.name: given 'heliun'",
        ),
    ],
)
def test_a_case_with_classes_that_its_fluid_cannot_have_is_refused(output, fault):
    with pytest.raises(InputError, match=fault):
        parse_case(case(**output))

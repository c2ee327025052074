"""Leakage classes: their published limits, their names, what a seal reaches, and the test fluid that decides it."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

import femseal as fs
from femseal.base.errors import InputError
from femseal.base.leak_rates import LEAK_CLASSES, LEAK_UNITS, leak_classes, within
from femseal.case.case import parse_case
from femseal.fluids import leak_basis
from femseal.plots.leakage_curves import limit_lines
from femseal.report.page import report_html
from femseal.results import RunFacts, assemble
from femseal.results.tables import csv_text, leakage_table
from femseal.studies.other_fluid import FluidState, OtherLeakage, drop_ratio, limit_factors

HELIUM = fs.IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15, slip=False)
NITROGEN = fs.IdealGas(viscosity=17.5e-6, molar_mass=28.0134e-3, temperature=293.15, slip=False)
WATER = fs.Liquid(1e-3, 998.0)


def test_classes_of_one_limit_share_a_line_in_pictures():
    axes = Figure().subplots()
    axes.set(yscale="log", ylim=(1e-3, 1e3))
    limit_lines(
        axes, {"L0.01": 0.01, "10 mg/(m·s)": 10.0, "TA Luft": 0.01 * (1 + 1e-15), "L1e-9": 1e-9}
    )
    assert [text.get_text().strip() for text in axes.texts] == ["L0.01, TA Luft", "10 mg/(m·s)"]
    assert len(axes.lines) == 2


def test_limits_are_those_published():
    """TA Luft tells its limit in both units; the rates of ISO 5208 are mm³/s per mm of nominal diameter."""
    helium, water = leak_basis(HELIUM, 0.5), leak_basis(WATER, 0.5)
    assert_allclose(
        LEAK_CLASSES["TA Luft"].limit(helium) / helium.factor(LEAK_UNITS["mbar·L/(m·s)"]),
        0.0609,
        rtol=1e-3,
    )
    assert_allclose(LEAK_CLASSES["VDI 2440"].limit(helium) * 101_325 / 0.1, 1e-4)
    assert_allclose(LEAK_CLASSES["L0.01"].limit(water), 1e-8 / 998)
    for rate, liquid, gas in (
        ("AA", 0.006, 0.18),
        ("C", 0.03, 3.0),
        ("CC", 0.08, 22.3),
        ("EE", 0.39, 470),
        ("G", 2, 6000),
    ):
        one = LEAK_CLASSES[f"ISO 5208 {rate}"]
        assert_allclose(one.limit(water, 0.05) * 0.5, liquid * 50e-9)
        assert_allclose(one.limit(helium, 0.05) * 0.5, gas * 50e-9)
    assert LEAK_CLASSES["ISO 5208 A"].limit(water, 0.05) == 0
    one = LEAK_CLASSES["L1"]
    around = one.limit(water) * np.array([0.99, 1.01, -0.99, -1.01, np.nan])
    assert within(around, one.limit(water)).tolist() == [
        True,
        False,
        True,
        False,
        False,
    ]  # whichever way it flows
    rates = [one.amount for one in LEAK_CLASSES.values() if one.family == "ISO 5208"]
    assert rates == sorted(rates)


def limit(name, basis, diameter=None):
    """Of the whole seal [m³/s]."""
    return LEAK_CLASSES[name].limit(basis, diameter) * basis.length


def test_valves_of_api_598_leak_drops_and_bubbles_by_their_nominal_size():
    """Its table: 5, 6, 8, 12 and 48 drops a minute at DN 65, 80, 100, 150 and 600, 16 of which are 1 mL."""
    water, helium = leak_basis(WATER, 0.5), leak_basis(HELIUM, 0.5)
    for size, drops in ((15, 0), (50, 0), (65, 5), (80, 6), (100, 8), (150, 12), (600, 48)):
        assert_allclose(limit("API 598", water, size * 1e-3), drops / 16 * 1e-6 / 60, atol=1e-30)
        assert_allclose(
            limit("API 598", helium, size * 1e-3), 2 * drops / 100 * 1e-6 / 60, atol=1e-30
        )


def test_seats_of_control_valves():
    """FCI 70-2 has class V in SI too, rounded: 5e-12 m³/s per mm and bar; class IV is a part of the rated capacity."""
    water = leak_basis(WATER, 0.5, pressure_drop=2e6, capacity=1e-3)
    assert_allclose(limit("FCI 70-2 V", water, 0.1), 5e-12 * 100 * 20, rtol=0.06)
    assert_allclose(limit("FCI 70-2 IV", water), 1e-7)
    air = leak_basis(NITROGEN, 0.5)
    for seat, rate in ((10, 0.15), (25, 0.15), (102, 1.7), (400, 28.4)):
        assert_allclose(limit("FCI 70-2 VI", air, seat * 1e-3), rate * 1e-6 / 60)
    between = np.sqrt((102**2 + 152**2) / 2) * 1e-3
    assert_allclose(limit("FCI 70-2 VI", air, between), (1.7 + 4) / 2 * 1e-6 / 60)
    with pytest.raises(
        InputError,
        match=r"nominal_diameter: given 0.5 for the class FCI 70-2 VI, expected .*400 mm",
    ):
        limit("FCI 70-2 VI", air, 0.5)
    with pytest.raises(InputError, match="FCI 70-2 VI, which is defined for gas"):
        limit("FCI 70-2 VI", water, 0.1)
    with pytest.raises(InputError, match="rated_capacity: given none for the class FCI 70-2 IV"):
        limit("FCI 70-2 IV", air)


def test_stems_are_as_tight_as_their_circumference_is_long():
    """AH, BH, CH of ISO 15848-1 are 1e-5, 1e-4 and 1e-2 mg/(m·s) of helium at 0 °C on the circumference of the stem."""
    cold = replace(HELIUM, temperature=273.15)
    for name, amount in (("AH", 1e-5), ("BH", 1e-4), ("CH", 1e-2)):
        found = limit(f"ISO 15848-1 {name}", leak_basis(cold, 0.1), 0.02)
        assert_allclose(found * cold.reference_density, np.pi * 0.02 * amount * 1e-6, rtol=2e-3)


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
        ("VDI2290", ["VDI 2290"]),
        ("api-598", ["API 598"]),
        ("fci 70-2", ["FCI 70-2 VI", "FCI 70-2 V", "FCI 70-2 IV"]),
        ("ISO 15848-1 class AH", ["ISO 15848-1 AH"]),
        ("EN 1591-1", ["L0.01", "L0.1", "L1"]),
        ("5 ml/min", ["5 mL/min"]),
        ("1e-3 mbar*L/s", ["0.001 mbar·L/s"]),
    ],
)
def test_names(written, names):
    assert [one.name for one in leak_classes([written])] == names


@pytest.mark.parametrize(
    "written",
    ["L2", "", "ISO 5208 H", "5 furlong", "mL/min", "-1 mL/min", "1e999 mL/min", 3, "0 mL/min"],
)
def test_other_names_are_refused(written):
    with pytest.raises(InputError, match=r"classes: given .*TA Luft"):
        leak_classes([written])


def test_classes_that_do_not_go_with_the_fluid_are_refused():
    water, nitrogen = leak_basis(WATER, 1.0), leak_basis(NITROGEN, 1.0)
    with pytest.raises(InputError, match="nominal_diameter: given none for the class ISO 5208 B"):
        LEAK_CLASSES["ISO 5208 B"].limit(water)
    for basis in (water, nitrogen):
        with pytest.raises(InputError, match="TA Luft, which is defined for helium"):
            LEAK_CLASSES["TA Luft"].limit(basis)
    with pytest.raises(InputError, match="for a liquid"):
        leak_classes(["1 mbar·L/s"])[0].limit(water)


def test_factors_of_the_limits_are_those_published():
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
    scene = fs.Scene(
        face,
        115e9,
        2.8e9,
        WATER,
        1e6,
        0.0,
        loading=(2e7, 1e8, 4e8),
        unload_from=(4e8,),
        unloading=(1e8, 2e7),
    )
    return scene, fs.deterministic(scene)


def test_another_fluid_leaks_as_a_study_with_it_does(studied):
    scene, study = studied
    state = FluidState(HELIUM, 4e6, 1e5)
    dry = replace(scene, fluid_pressure="ignored")
    ratio, study = drop_ratio(state, dry), fs.deterministic(dry)
    again = fs.deterministic(state.in_scene(dry))
    assert_allclose(OtherLeakage.of_study(state, study, ratio).leakage, again.leakage, rtol=1e-12)
    assert again.leakage[0] > 0


def test_results_tell_the_classes_that_every_step_reaches(studied):
    scene, study = studied
    density, leak = WATER.density, study.leakage
    middle = np.sqrt(leak[1] * leak[2]) * density * 1e6
    results = assemble(
        scene,
        study,
        facts=RunFacts(
            classes=[f"{middle:g} mg/(m·s)", "EN 13555", "ISO 5208"], nominal_diameter=0.05
        ),
    )
    reached = results.dataset["class_met"].sel(leak_class=results.dataset["leak_class"].values[0])
    assert reached.values.tolist() == [float(q <= middle * 1e-6 / density) for q in leak]
    assert reached.values[1] == 0
    assert reached.values[2] == 1
    assert_allclose(results.dataset["class_fraction"], results.dataset["class_met"])
    for step, told in enumerate(results.classes):
        for family in ("L", "ISO 5208"):
            tightest = [c for c in LEAK_CLASSES.values() if c.name.startswith(family)]
            tightest = [
                c.name for c in tightest if within(leak[step], c.limit(results.leak_basis, 0.05))
            ]
            assert tightest[:1] == [name for name in told.split(", ") if name.startswith(family)]
    assert any("a seat of 50 mm is about 157 mm long" in text for text in results.warnings)
    assert results.table().heads[-1] == "class"
    assert "fraction_in_ISO_5208_A" in csv_text(results).splitlines()[0]
    page = report_html(results)
    assert page.index("met by the seal") < page.index("<main>")
    assert "in service, unloading from 400 MPa" in page
    named = {text.get_text().strip() for text in results.plot().axes[0].texts}
    assert results.dataset["leak_class"].values[0] in named
    plain = assemble(scene, study)
    assert plain.classes == []
    assert "met by the seal" not in report_html(plain)


def test_classes_are_judged_by_the_test_fluid(studied, tmp_path):
    scene, study = studied
    state = FluidState(HELIUM, 4e6, 1e5)
    other = OtherLeakage.of_study(state, fs.deterministic(state.in_scene(scene)))
    middle = np.sqrt(other.leakage[0] * other.leakage[2]) * 101_325 * 10
    results = assemble(
        scene, study, facts=RunFacts(test=other, classes=["TA Luft", f"{middle:g} mbar·L/(m·s)"])
    )
    for n, limit in enumerate((1e-8 / HELIUM.reference_density, middle / 1_013_250)):
        assert results.dataset["class_met"].values[n].tolist() == [
            float(q <= limit) for q in other.leakage
        ]
    assert 0 < results.dataset["class_met"].values[1].sum() < len(scene.steps)
    page = report_html(results)
    assert "decided by the test fluid" in page
    assert "times as much; flow as a continuum would give" in page
    assert "free molecules" not in page
    nitrogen = replace(scene, fluid=NITROGEN, inlet_pressure=4e6, outlet_pressure=1e5)
    both = assemble(nitrogen, fs.deterministic(nitrogen), facts=RunFacts(test=other))
    assert (
        "In pressure × volume the fluid in service leaks 1.12 times as much; flow as a continuum would give 1.12, flow of free molecules 0.378."
        in report_html(both)
    )
    from femseal.results import open_results, save

    save(results, tmp_path)
    again = open_results(tmp_path)
    assert again.classes == results.classes
    assert again.class_basis == results.class_basis
    assert again.leak_basis == results.leak_basis


def case(**output):
    return {
        "method": "stochastic",
        "face": {
            "kind": "self-affine",
            "points": [32, 32],
            "size": ["60 um", "60 um"],
            "hurst": 0.8,
            "rms_slope": 0.1,
        },
        "material": {"young": "210 GPa", "yield_stress": "1 GPa"},
        "load": {"loading": ["20 MPa", "400 MPa"]},
        "fluid": {"kind": "liquid", "viscosity": "1 mPa*s", "inlet_pressure": "10 bar"},
        "cells": {"count": [2, 2]},
        "stochastic": {"length": "300 um", "realisations": 5},
        "output": output,
    }


HELIUM_TABLE = {
    "kind": "ideal-gas",
    "viscosity": "19.6 uPa*s",
    "molar_mass": "4.0026 g/mol",
    "temperature": "20 °C",
    "inlet_pressure": "40 bar",
    "slip": False,
}


def test_a_unit_of_gases_is_that_of_the_test_fluid():
    results = fs.run(parse_case(case(test_fluid=HELIUM_TABLE, leakage_unit="mbar·L/s")), workers=1)
    assert results.leak_unit.per_length
    assert leakage_table(results).heads[-1] == "test fluid [mbar·L/s]"
    assert fs.compare({"a": results, "b": results}).unit == results.leak_unit


def test_a_case_asks_for_classes_and_a_test_fluid():
    results = fs.run(
        parse_case(case(classes=["ta-luft", "L1"], test_fluid=HELIUM_TABLE)), workers=1
    )
    data = results.dataset
    ratio = data["test_leakage_realisations"] / data["leakage"].values
    state, own = FluidState(HELIUM, 4e6, 101_325), FluidState(fs.Liquid(1e-3), 1e6, 0.0)
    # nearly the ratio of the drops: both press the faces apart a little
    exact = state.drop / own.drop
    assert_allclose(ratio.values[data["leakage"].values > 0], exact, rtol=0.1)
    limit = 1e-8 / HELIUM.reference_density
    shares = (data["test_leakage_realisations"].values <= limit).mean(axis=0)
    assert_allclose(data["class_fraction"].sel(leak_class="TA Luft"), shares)


def test_drops_and_bubbles_have_the_volume_that_the_case_gives():
    plain = fs.run(parse_case(case(test_fluid=HELIUM_TABLE)), workers=1)
    valve = {"drop_volume": "0.1 mL", "bubble_volume": "0.3 mL", "rated_capacity": "60 L/min"}
    valve |= {"classes": ["FCI 70-2 IV", "FCI 70-2 V"], "nominal_diameter": "80 mm"}
    other = fs.run(parse_case(case(**valve)), workers=1)
    assert_allclose(other.leakage_in("drops/min"), plain.leakage_in("drops/min") / 2)
    limits = other.dataset["class_limit"].values * other.leak_basis.length
    assert_allclose(limits, [1e-7, 5e-4 * 1e-6 / 60 * 80 / 25.4 * 1e6 / 6894.757])
    assert any(
        "FCI 70-2 IV (2006), FCI 70-2 V (2006) are from tables of others" in text
        for text in other.warnings
    )
    basis = leak_basis(HELIUM, 2.0, bubble=0.3e-6)
    assert_allclose(basis.factor(LEAK_UNITS["bubbles/s"]), 0.15e-6)


def test_a_gas_with_slip_is_solved_on_the_same_seals():
    """Its permeability is another one, so that no ratio of drops converts the leakage."""
    slipping = {"name": "helium", "inlet_pressure": "40 bar"}
    results = fs.run(parse_case(case(classes=["ta-luft"], test_fluid=slipping)), workers=1)
    table = {key: value for key, value in case().items() if key != "output"}
    alone = fs.run(parse_case(table | {"fluid": slipping}), workers=1)
    assert_allclose(
        results.dataset["test_leakage_realisations"], alone.dataset["leakage"], rtol=1e-12
    )
    assert_allclose(results.dataset["test_leakage"], alone.leakage, rtol=1e-12)


@pytest.mark.parametrize(
    ("output", "fault"),
    [
        ({"classes": ["L2"]}, r"output\.classes\.0: given 'L2', expected 'L1'"),
        (
            {"classes": ["ISO 5208 B"]},
            r"output\.nominal_diameter: given none for the class ISO 5208 B",
        ),
        (
            {"classes": ["FCI 70-2 IV"]},
            r"output\.rated_capacity: given none for the class FCI 70-2 IV",
        ),
        ({"drop_volume": "-1 mL"}, r"output\.drop_volume: given '-1 mL'"),
        ({"leakage_unit": "bubbles/min"}, r"output\.leakage_unit: given bubbles/min for a liquid"),
        ({"classes": ["TA Luft"]}, r"output\.classes: given TA Luft, which is defined for helium"),
        ({"classes": ["1 std cm³/s"]}, r"output\.classes: given 1 std cm³/s"),
        (
            {"test_fluid": HELIUM_TABLE | {"inlet_pressure": "1 Pa"}},
            r"output\.test_fluid\.inlet_pressure: given 1 Pa",
        ),
        (
            {"test_fluid": {"name": "heliun", "inlet_pressure": "40 bar"}},
            r"output\.test_fluid\.name: given 'heliun'",
        ),
        ({"test_fluid": {"kind": "ideal-gas"}}, r"output\.test_fluid\.viscosity: given nothing"),
        ({"throughput_temperature": "-300 °C"}, r"output\.throughput_temperature: given"),
        ({"leakage_unit": "std cm³/s"}, r"output\.leakage_unit: given std cm³/s for a liquid"),
    ],
)
def test_a_case_that_asks_for_what_cannot_be_is_refused(output, fault):
    with pytest.raises(InputError, match=fault):
        parse_case(case(**output))

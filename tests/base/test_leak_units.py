"""Units of leakage: their values and their spelling."""

import re
from dataclasses import replace

import pytest
from numpy.testing import assert_allclose
from small_cases import steel_scene

import femseal as fs
from femseal.base import InputError, to_si
from femseal.base.leak_units import LEAK_UNITS, USUAL_UNITS, leak_unit
from femseal.fluids import leak_basis
from femseal.report.page import report_html
from femseal.results import RunFacts, assemble, rows

SI = {"volume": "m^3/s", "mass": "kg/s", "throughput": "Pa*m^3/s"}
AIR = fs.IdealGas(viscosity=18e-6, molar_mass=29e-3, temperature=293.15)


KNOWN = [unit for unit in LEAK_UNITS.values() if unit.kind in SI]


@pytest.mark.parametrize("unit", KNOWN)
def test_values_of_units_agree_with_a_library_of_units(unit):
    text = unit.name.replace("·", "*").replace("²", "^2").replace("³", "^3").replace("µ", "u")
    kind = SI[unit.kind] + ("/m" if unit.per_length else "")
    assert_allclose(unit.si, to_si(f"1 {text}", kind), rtol=1e-9)


@pytest.mark.parametrize(
    ("written", "name"),
    [
        ("mL/(min*m)", "mL/(m·min)"),
        ("ml/min/m", "mL/(m·min)"),
        ("Pa*m^3/s", "Pa·m³/s"),
        ("m3/s", "m³/s"),
        ("mbar*l/s", "mbar·L/s"),
        ("mg/(s*m)", "mg/(m·s)"),
        ("ug/s", "µg/s"),
        (" L / h ", "L/h"),
        ("sccm", "std cm³/min"),
        ("std cm3/s", "std cm³/s"),
        ("std cm^3/(s*m)", "std cm³/(m·s)"),
        ("drop/min", "drops/min"),
        ("atm·cc/s", "atm·cm³/s"),
        ("atm-cc/s", "atm·cm³/s"),
        ("atm cc/s", "atm·cm³/s"),
        ("Torr·L/s", "Torr·L/s"),
        ("torr-l/s", "Torr·L/s"),
        ("cm³/min", "cm³/min"),
        ("cc/min", "cm³/min"),
        ("ccm/h", "cm³/h"),
        ("mbar l/s", "mbar·L/s"),
        ("mbar.l/s", "mbar·L/s"),
        ("mbar·l·s⁻¹", "mbar·L/s"),
        ("Pa m3/s", "Pa·m³/s"),
        ("Pa-m3/s", "Pa·m³/s"),
        ("mg·s⁻¹·m⁻¹", "mg/(m·s)"),
        ("mg s^-1 m^-1", "mg/(m·s)"),
        ("mg/s·m", "mg/(m·s)"),
        ("std cc/s", "std cm³/s"),
        ("std. cc/s", "std cm³/s"),
        ("scc/min", "std cm³/min"),
        ("SCCM", "std cm³/min"),
        ("Nml/min", "std cm³/min"),
        ("slpm", "std L/min"),
        ("Nl/min", "std L/min"),
        ("nl/s", "nL/s"),
        ("ml/hr", "mL/h"),
        ("g/yr", "g/year"),
        ("g/a", "g/year"),
        ("oz/yr", "oz/year"),
        ("drops per minute", "drops/min"),
    ],
)
def test_spellings_of_a_unit_are_recognised(written, name):
    assert leak_unit(written).name == name


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("ccm", "cm³/min for a volume per minute, or sccm for one at 0 °C"),
        ("scfh", r"std L/min \(at 0 °C .*60 °F for some"),
        ("GPM", "gallons of two sizes"),
    ],
)
def test_ambiguous_units_are_refused_with_advice(written, said):
    with pytest.raises(InputError, match=f"leakage_unit: given '{written}', expected .*{said}"):
        leak_unit(written)


@pytest.mark.parametrize("stated", [0.0, -26.85, float("nan")])
def test_a_temperature_below_absolute_zero_is_refused(stated):
    with pytest.raises(
        InputError, match=r"^given_temperature: given .*expected a finite number > 0"
    ):
        leak_basis(AIR, 1.0, stated)


@pytest.mark.parametrize(
    "written", ["furlong", "", "m", "mL", 3, "mL/min/m/m", "mL/(m·m)", "mL?/min", "s/mL"]
)
def test_unknown_units_are_refused(written):
    with pytest.raises(InputError, match=r"leakage_unit: given .*mL/min"):
        leak_unit(written)


#: Published figures of gases, each from the unit, at a temperature, to the unit: tables of makers of leak detectors, of
#: NIST (sccm), and of TA Luft (0.01 mg/(s·m) of helium).
HELIUM, DRY_AIR = 4.0026e-3, 28.96e-3
PUBLISHED = [
    (1.0, "sccm", DRY_AIR, 273.15, 0.0168875, "mbar·L/s", 1e-5),
    (1.0, "mbar·L/s", DRY_AIR, 273.15, 59.2, "std cm³/min", 5e-4),
    (1.0, "mbar·L/s", DRY_AIR, 293.15, 4.28e-6 * 1e3, "kg/h", 2e-3),
    (1e-2, "mbar·L/s", DRY_AIR, 293.15, 375.0, "g/year", 2e-3),
    (1.0, "Pa·m³/s", DRY_AIR, 293.15, 10.0, "mbar·L/s", 1e-12),
    (1.0, "Torr·L/s", DRY_AIR, 293.15, 1.33322, "mbar·L/s", 1e-5),
    (1.0, "atm·cc/s", DRY_AIR, 293.15, 1.01325, "mbar·L/s", 1e-12),
    (1.0, "atm·cc/s", DRY_AIR, 273.15, 1.0, "std cm³/s", 1e-12),
    (0.01, "mg/(s·m)", HELIUM, 293.15, 0.0609, "mbar·L/(m·s)", 1e-3),
]


@pytest.mark.parametrize(
    ("value", "unit", "molar_mass", "stated", "expected", "other", "rtol"), PUBLISHED
)
def test_conversions_agree_with_published_values(
    value, unit, molar_mass, stated, expected, other, rtol
):
    """At the stated temperature, whatever that of the gas is."""
    for own in (273.15, 293.15, 400.0):
        gas = fs.IdealGas(viscosity=18e-6, molar_mass=molar_mass, temperature=own)
        basis = leak_basis(gas, 1.0, stated)
        found = value * basis.factor(leak_unit(unit)) / basis.factor(leak_unit(other))
        assert_allclose(found, expected, rtol=rtol)


def test_standard_volumes_count_molecules():
    """22.414 L of a gas at 0 °C and 101 325 Pa are a mole, whatever its own temperature."""
    basis = leak_basis(AIR, 1.0)
    moles = (
        basis.factor(LEAK_UNITS["std cm³/s"]) / basis.factor(LEAK_UNITS["kg/s"]) / AIR.molar_mass
    )
    assert_allclose(moles, 1e-3 / 22.414, rtol=1e-5)
    assert basis.throughput_temperature == AIR.temperature


@pytest.fixture(scope="module")
def studied():
    face = fs.self_affine((32, 32), (60e-6, 60e-6), hurst=0.8, rms_slope=0.1, rng=1)
    scene = steel_scene(face, fluid=fs.Liquid(1e-3, 870.0), loading=(2e7, 1e8))
    gas = replace(scene, fluid=AIR, inlet_pressure=2e5, outlet_pressure=1e5)
    return {"liquid": (scene, fs.deterministic(scene)), "gas": (gas, fs.deterministic(gas))}


def test_all_results_contain_the_total_leakage(studied):
    scene, study = studied["liquid"]
    results = assemble(scene, study, facts=RunFacts(leakage_unit="ml/min"))
    q, data = study.leakage * 60e-6, results.dataset
    assert_allclose(results.leakage_in("mL/min"), q * 60e6)
    assert_allclose(data["leakage_total"], q)
    assert_allclose(data["leakage_total_mass"], q * 870)
    assert "leakage_total_throughput" not in data
    of_liquids = [name for name in USUAL_UNITS if not re.search("Pa|bar|std", name)]
    assert data["leak_unit"].values.tolist() == of_liquids
    per_year = q * 870e3 * 365.25 * 86400
    assert_allclose(data["leakage_in_units"].sel(leak_unit="g/year"), per_year)
    assert_allclose(rows(results)[0]["leakage_mL_per_min"], q[0] * 60e6)
    assert "leakage_g_per_year" in rows(results)[0]
    assert results.table().lines[0][2] == f"{q[0] * 60e6:.3g}"
    with pytest.raises(InputError, match="for a liquid"):
        assemble(scene, study, facts=RunFacts(leakage_unit="mbar*L/s"))


def test_results_of_a_gas_contain_pressure_times_volume(studied):
    scene, study = studied["gas"]
    results = assemble(scene, study)
    throughput = study.leakage * 60e-6 * 101_325
    assert_allclose(results.dataset["leakage_total_throughput"], throughput)
    assert_allclose(results.leakage_in("mbar·L/s"), throughput * 10)
    cold = assemble(scene, study, facts=RunFacts(throughput_temperature=273.15))
    assert_allclose(cold.leakage_in("mbar·L/s") * 293.15 / 273.15, throughput * 10)
    assert_allclose(cold.leakage_in("std cm³/s"), cold.leakage_in("mbar·L/s") / 1.01325)
    assert "273.15 K" in cold.dataset["leakage_total_throughput"].attrs["long_name"]
    assert "pressure × volume at 273.15 K" in report_html(cold)

"""Leakages in the units of volumes, masses, and pressure times volume."""

import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.base import InputError
from femseal.base.leak_rates import LeakBasis
from femseal.base.leak_units import LEAK_UNITS
from femseal.fluids import leak_basis

AIR = fs.IdealGas(viscosity=18e-6, molar_mass=29e-3, temperature=293.15)


def test_a_leakage_is_the_same_in_all_units():
    """1 mL/(m·min) of a seal of 0.5 m, by hand."""
    basis = LeakBasis(length=0.5, density=800.0)
    q = 1e-6 / 60
    per = {unit.name: q / basis.factor(unit) for unit in basis.units(LEAK_UNITS.keys())}
    assert_allclose(per["mL/(m·min)"], 1)
    assert_allclose(per["mL/min"], 0.5)
    assert_allclose(per["kg/s"], 0.5e-6 / 60 * 800)
    assert_allclose(per["g/year"], 0.4 * 525_960)
    assert_allclose(per["drops/min"], 10)  # 20 drops are 1 mL
    assert not any("Pa" in name or "mbar" in name or "std" in name for name in per)


@pytest.mark.parametrize(
    ("basis", "unit", "said"),
    [
        (LeakBasis(0.5, 800.0), "mbar·L/s", "mbar·L/s for a liquid"),
        (leak_basis(AIR, 1.0), "drops/min", "drops/min is for liquids"),
        (LeakBasis(1.0, 1.2, 1e5), "std cm³/s", "no temperature"),
        (LeakBasis(1.0, float("nan")), "kg/s", "density of the fluid is unknown"),
    ],
)
def test_units_of_gases_are_refused_for_liquids_and_vice_versa(basis, unit, said):
    with pytest.raises(InputError, match=said):
        basis.factor(LEAK_UNITS[unit])


def test_leakage_of_a_gas_is_given_as_pressure_times_volume():
    """p V̇ = ṁ R T / M."""
    basis = LeakBasis(1.0, AIR.reference_density, AIR.reference_pressure, AIR.temperature)
    q = basis.factor(LEAK_UNITS["mbar·L/s"])
    mass = q / basis.factor(LEAK_UNITS["kg/s"])
    assert_allclose(mass, 0.1 * 29e-3 / (8.31446261815324 * 293.15), rtol=1e-12)
    assert_allclose(q / basis.factor(LEAK_UNITS["Pa·m³/s"]), 0.1)

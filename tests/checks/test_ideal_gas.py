"""The error of the ideal gas law, and the warnings of it."""

import re
import sys

import pytest
from coolprop_gases import (
    LEFT_OUT,
    ideal_gas,
    needs_coolprop,
    potential_by_quadrature,
    potential_drop,
)
from numpy.testing import assert_allclose

import femseal as fs
from femseal.checks import gas_warnings
from femseal.named_fluids import FLUID_TABLE


@needs_coolprop
def test_a_warning_says_that_an_ideal_gas_above_20_bar_is_inaccurate():
    gas = fs.IdealGas(**FLUID_TABLE["nitrogen"].parameters)
    assert not list(gas_warnings("fluid", gas, 20e5, 1e5))
    assert not list(gas_warnings("fluid", fs.Liquid(1e-3), 200e5, 1e5))
    (said,) = gas_warnings("fluid", gas, 200e5, 1e5)
    assert re.search(
        r"the ideal gas in fluid leaks 1\.2 times as much from 20 MPa to 100 kPa as nitrogen", said
    )


@needs_coolprop
@pytest.mark.parametrize(
    ("gas", "inlet", "name", "said"),
    [
        (ideal_gas(14.7, 44.01), 55e5, "CO2", "as CarbonDioxide, which it seems to be"),
        (ideal_gas(14.7, 44.01), 19e5, "CO2", "name = 'CarbonDioxide'"),
        (ideal_gas(8.0, 44.1), 7e5, "propane", "as n-Propane, which"),
        (ideal_gas(15.0, 146.06), 10e5, "SF6", "as SulfurHexafluoride, which"),
    ],
)
def test_the_real_gas_of_an_ideal_gas_is_recognised(gas, inlet, name, said):
    (text,) = gas_warnings("fluid", gas, inlet, 1e5)
    real = potential_by_quadrature(name, 293.15, inlet) - potential_by_quadrature(name, 293.15, 1e5)
    ratio = float(re.search(r"leaks (\S+) times", text)[1])
    assert_allclose(ratio, potential_drop(gas, inlet, 1e5) / real, rtol=1e-2)
    assert said in text


@needs_coolprop
@pytest.mark.parametrize(
    ("gas", "inlet", "said"),
    [
        (ideal_gas(14.7, 44.01), 60e5, "CarbonDioxide, which condenses at 5.729 MPa and 20 °C"),
        (ideal_gas(11.6, 102.03), 10e5, "R134a, which condenses at 571.7 kPa and 20 °C"),
        (ideal_gas(6.0, 28.965, 90.0), 5e5, "air, which condenses at 243.2 kPa and -183.1 °C"),
        (ideal_gas(15.0, 146.0), 20.1e5, "SulfurHexafluoride"),
        (ideal_gas(15.0, 61.0), 50e5, "CoolProp has no gas with a molar mass of 61 g/mol and this"),
        (ideal_gas(14.6, 44.0128), 40e5, "NitrousOxide, of which CoolProp has no viscosity: take"),
        (ideal_gas(25.0, 83.798), 10e5, "Krypton, of which CoolProp has no viscosity: take"),
        (ideal_gas(22.8, 131.29), 50e5, "Xenon, of which CoolProp has no viscosity: take"),
        (ideal_gas(60.0, 44.01), 50e5, "CoolProp has no gas with a molar mass of 44.01 g/mol and"),
    ],
)
def test_a_reason_is_given_if_the_error_of_an_ideal_gas_is_unknown(gas, inlet, said):
    (text,) = gas_warnings("fluid", gas, inlet, 1e5)
    assert said in text
    assert "not installed" not in text


@needs_coolprop
@pytest.mark.parametrize(
    ("gas", "inlet"),
    [
        (ideal_gas(14.7, 44.01), 1.9e5),
        (ideal_gas(14.7, 44.01), 5e5),  # within 5 %
        (ideal_gas(15.0, 61.0), 10e5),
        (ideal_gas(18.2, 29.0), 19e5),
    ],
)
def test_gases_that_are_nearly_ideal_cause_no_warning(gas, inlet):
    assert not [*gas_warnings("fluid", gas, inlet, 1e5)]


def test_without_coolprop_an_ideal_gas_at_high_pressure_causes_a_warning(monkeypatch):
    for name in LEFT_OUT:
        monkeypatch.setitem(sys.modules, name, None)
    (text,) = gas_warnings("fluid", ideal_gas(14.7, 44.01), 55e5, 1e5)
    assert text.endswith("is not installed (pip install 'femseal[fluids]')")
    assert not [*gas_warnings("fluid", ideal_gas(14.7, 44.01), 10e5, 1e5)]

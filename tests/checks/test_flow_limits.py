"""Warnings of a gas that is faster than sound, and of inertia."""

import numpy as np
import pytest
from fluid_cases import OIL, case_with_fluid

import femseal as fs
from femseal.checks import choked_flux
from femseal.preparation import prepare
from femseal.runs.run_description import describe


def test_a_gas_faster_than_sound_has_a_warning():
    nitrogen = {"name": "nitrogen", "inlet_pressure": "200 bar"}
    given = case_with_fluid(nitrogen, rms_height="3 um", roll_off="300 um")
    results = fs.run(given, workers=1)
    gap, mass = results.dataset["mean_gap"].item(), results.leakage_in("kg/s").item() / 1e-3
    ratio = mass / (2e7 * np.sqrt(1.4 / (8.31446 / 0.0280134 * 293.15)) * (2 / 2.4) ** 3 * gap)
    assert ratio > 3
    assert any(f"{ratio:.2g} times what a choked nozzle" in text for text in results.warnings)
    assert any("Reynolds number of the mean gap" in text for text in results.warnings)
    lines = describe(given, prepare(given))
    assert any("by the quick estimate" in line and "choked" in line for line in lines)


def test_oil_in_narrow_gaps_has_no_warning_of_its_flow():
    given = case_with_fluid(OIL, rms_height="0.5 um")
    results = fs.run(given, workers=1)
    words = "Reynolds", "choked", "quick estimate"
    assert not any(word in text for text in results.warnings for word in words)
    assert choked_flux(fs.Liquid(1e-3), 1e6) == np.inf
    estimate = prepare(given).estimate()
    assert estimate.leakage[0] / results.leakage.values[0] == pytest.approx(1, abs=0.9)
    for wrong in (1e4, 1e-4):
        assert estimate.leakage_warnings(wrong * estimate.leakage, ["here"])

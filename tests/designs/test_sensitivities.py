"""Sensitivities of the leakage: slopes of power laws, and levels at a load."""

import numpy as np
import pytest
from leakage_laws import FALL, power_law
from numpy.testing import assert_allclose
from power_law_seals import AMPLITUDES, seals_of

from femseal.designs.sensitivities import Variants, log_leakage_at, sensitivities, slope_at


def slopes(**given):
    """Exponents of the leakage at 200 MPa."""
    return {s.quantity: s for s in sensitivities(seals_of(), Variants(**given), 2e8, 0.9)}


def leaking_more(exponent):
    """Seals whose leakage is 1.1 to this power times as large."""
    return seals_of(power_law(AMPLITUDES) * 1.1**exponent)


def test_slopes_of_power_laws_are_exact():
    """L = A p^−3 H^2 η^−1: amplitude 2 − 2 + 3 + 1, modulus 3 − 2."""
    found = slopes(harder=leaking_more(2), inlet_slope=1.0)
    for name, slope in {
        "nominal pressure": -3,
        "hardness": 2,
        "roughness amplitude": 4,
        "contact modulus": 1,
        "viscosity": -1,
        "breadth, same pressure": -1,
        "breadth, same force": 2,
        "inlet pressure": 1,
    }.items():
        assert_allclose(found[name].leakage, slope, rtol=1e-9)
        if name != "nominal pressure":
            assert_allclose(found[name].pressure, slope / 3, rtol=1e-9)


@pytest.mark.parametrize(
    ("given", "exact"),
    [
        ({"can_yield": False}, {"hardness": 0, "roughness amplitude": 6}),
        ({}, {"hardness": np.nan, "roughness amplitude": np.nan}),
        # L(αa, αp, αη, αb) = α² L: what goes with the slip length no longer goes with the amplitude
        (
            {
                "can_yield": False,
                "length_parameter": "slip_length",
                "longer_length": leaking_more(0.3),
            },
            {"viscosity": -1, "slip length": 0.3, "roughness amplitude": 5.7},
        ),
        (
            {
                "can_yield": False,
                "length_parameter": "viscosity",
                "longer_length": leaking_more(-0.4),
            },
            {"viscosity": -0.4, "roughness amplitude": 5.4},
        ),
        (
            {"harder": leaking_more(2), "hardens": True},
            {"contact modulus": FALL - 2, "roughness amplitude": np.nan},
        ),
    ],
)
def test_slopes_go_with_what_the_laws_depend_on(given, exact):
    found = slopes(**given)
    leakage = [found[name].leakage for name in exact]
    assert_allclose(leakage, [*exact.values()], rtol=1e-9, atol=1e-12)


def test_slopes_and_levels_at_a_load():
    seals = seals_of()
    assert_allclose([slope_at(seals, p, 0.5) for p in (1e7, 9e8, 9.1e8)], [-3, -3, np.nan])
    assert_allclose(np.exp(log_leakage_at(seals, 2e8, 1.0)), AMPLITUDES.max() * 2e8**-FALL)
    leak = power_law(AMPLITUDES)
    leak[:, 4] = np.inf  # at a load whose leakage is not known
    assert_allclose(slope_at(seals_of(leak), 5e7, 0.9), -FALL)
    assert np.isnan(slope_at(seals_of(leak), 6e8, 0.9))

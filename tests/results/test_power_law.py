"""Fits of power laws: their ranges of pressure, integrals in closed form, and bad values."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from femseal.base import InputError
from femseal.results.sealing_index import (
    fit_power_law,
    fit_power_laws,
    index_text,
    integrate_power,
)

K0, P0, N, N_DOWN = 3e-18, 1e8, 2.7, 0.4


def test_a_curved_permeability_has_shorter_ranges():
    """ln k = −a (ln p)²: over a range of ln p of the length s, a parabola deviates by a s²/8 from its best line."""
    p = np.geomspace(1e7, 1e9, 201)
    a, tolerance = 0.5, 0.1
    laws = fit_power_laws(p, np.exp(-a * np.log(p / 1e8) ** 2), tolerance)
    assert len(laws) > 2
    assert laws[0].highest_pressure == p[-1]
    assert_allclose(laws[-1].lowest_pressure, p[0])
    longest = np.sqrt(8 * np.log(1 + tolerance) / a)
    for law, lower in zip(laws, [*laws[1:], None], strict=True):
        span = np.log(law.highest_pressure / law.lowest_pressure)
        assert law.deviation <= tolerance
        assert span < longest * 1.001
        # the exponent is that of the chord, 2a ln(p/10⁸) at the middle of the range
        assert_allclose(law.exponent, 2 * a * np.log(law.pressure / 1e8), atol=0.03)
        if lower is not None:
            assert span > longest * 0.95
            assert lower.highest_pressure == law.lowest_pressure
    (whole,) = fit_power_laws(p, (p / P0) ** -N, 1e-6)
    assert (whole.lowest_pressure, whole.highest_pressure) == (p[0], p[-1])


@pytest.mark.parametrize(
    ("function", "given", "message"),
    [
        (fit_power_law, ([1e8], [1e-18]), "pressures: given 1 different"),
        (fit_power_law, ([1e8, 1e8], [1e-18, 1e-18]), "pressures: given 1 different"),
        (fit_power_law, ([1e8, 2e8], [1e-18, 0.0]), "permeabilities"),
        (fit_power_law, ([1e8, np.nan], [1e-18, 1e-18]), "pressures"),
        (fit_power_law, ([1e8, 2e8], [1e-18]), "permeabilities: given 1 value"),
        (fit_power_laws, ([1e8, 2e8], [2.0, 1.0], 0.0), "tolerance"),
        (integrate_power, ([0.0], [1e8], 2.0), "positions"),
        (integrate_power, ([0.0, 0.0], [1e8, 1e8], 2.0), "positions"),
        (integrate_power, ([0.0, 1.0], [1e8, -1.0], 2.0), "pressures"),
        (integrate_power, ([0.0, 1.0], [1e8], 2.0), "pressures"),
        (integrate_power, ([0.0, 1.0], [1e8, 1e8], -1.0), "exponent"),
    ],
)
def test_bad_values_are_refused(function, given, message):
    with pytest.raises(InputError, match=message):
        function(*given)


def test_integral_of_a_power_is_exact():
    """Linear pressure: ∫ pⁿ dl = (p₂ⁿ⁺¹ − p₁ⁿ⁺¹) w/((n + 1)(p₂ − p₁)); a parabola with n = 2 by its own integral."""
    assert_allclose(integrate_power([1.0, 3.0], [2.0, 5.0], 3.0), 2 * (5**4 - 2**4) / 12)
    x = np.linspace(-1, 1, 20_001)
    assert_allclose(integrate_power(x, 1 - x**2, 2.0), 16 / 15, rtol=1e-7)
    near = integrate_power([0.0, 1.0], [1e8, 1e8 * (1 + 1e-9)], 3.0)
    assert_allclose(near, 1e24, rtol=1e-8)


def test_an_index_that_is_too_large_for_a_number_is_infinite():
    """Near closing, the permeability can fall by decades between two loads, and the exponent exceeds 40."""
    (law,) = fit_power_laws(
        np.array([4.5e8, 4.75e8, 5e8]), np.array([1e-21, 1.2e-22, 1e-23]), tolerance=0.5
    )
    assert law.exponent > 40
    assert law.needed_index(1e9, 1e-9) == np.inf
    assert integrate_power([0.0, 1e-3], [4e8, 5e8], 45.0) == np.inf
    assert index_text(np.inf) == "unknown"
    assert integrate_power([0.0, 1e-3], [0.0, 0.0], 2.0) == 0.0

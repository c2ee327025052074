"""Permeabilities at several fluid pressures: means in closed form, and shapes that are refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.flow.permeability_table import (
    Mobility,
    PermeabilityTable,
    PressureCurve,
)


def test_means_between_pressures_are_exact_for_a_liquid():
    """k = k₀ exp(−p/P) between its knots, constant beyond them, and linear beside a pressure at which it is closed."""
    scale, knots = 2e6, np.linspace(0.0, 8e6, 5)
    k = np.stack([np.exp(-knots / scale), np.where(knots < 4e6, 0.0, 3.0)], axis=1)
    even = Mobility(np.linspace(0, 1e7, 11), np.full(11, 5.0), np.full(11, 5.0))
    curve = PressureCurve(knots, k, True)
    for a, b in ((1e6, 1.5e6), (7e6, 5e5), (3e6, 3e6 + 1.0), (3e6, 3e6)):
        mean = (
            scale * (np.exp(-b / scale) - np.exp(-a / scale)) / (a - b)
            if a != b
            else np.exp(-a / scale)
        )
        assert_allclose(curve.mean_between(np.full(2, a), np.full(2, b), even)[0], mean, rtol=1e-9)
    beyond = curve.mean_between(np.full(2, 7e6), np.full(2, 1e7), even)
    within = scale * (np.exp(-3.5) - np.exp(-4.0))
    assert_allclose(beyond, [(within + 2e6 * np.exp(-4.0)) / 3e6, 3.0], rtol=1e-12)
    assert_allclose(
        curve.mean_between(np.full(2, 2.5e6), np.full(2, 3.5e6), even)[1], 1.5, rtol=1e-12
    )


HELIUM = fs.IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15)


@pytest.mark.parametrize("shape", [(3, 8, 6), (3, 5), (3, 6, 6)])
def test_tables_of_other_shapes_than_the_seal(shape):
    seal = fs.RectangularSeal((1e-3, 2e-3), (7, 6))
    wrong = PermeabilityTable((1e6, 3e5, 1e5), np.ones(shape))
    with pytest.raises(fs.InputError, match=r"^permeability: given shape"):
        fs.seal_leakage(seal, wrong, HELIUM, inlet_pressure=1e6, outlet_pressure=1e5)


@pytest.mark.parametrize(
    ("pressures", "values", "word"),
    [
        ((1e5,), np.ones(1), "pressures"),
        ((1e5, 1e5), np.ones(2), "pressures"),
        ((0.0, 1e5), np.ones(2), "pressures"),
        ((1.0, 2.0), np.ones(3), "values"),
        ((1.0, 2.0), -np.ones(2), "values"),
        ((1.0, 2.0), [np.nan, 1], "values"),
    ],
)
def test_tables_that_are_none(pressures, values, word):
    with pytest.raises(fs.InputError, match=f"^{word}: given"):
        PermeabilityTable(pressures, values)

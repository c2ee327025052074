"""Flow of a rarefied gas: the fit against a solution of the Boltzmann equation, and the flow factor of a gas."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from femseal.base import InputError
from femseal.flow.law import flow_rate
from femseal.gases import IdealGas

HELIUM = IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15)


def boltzmann_flow_rate(thickness, cells):
    """Q of the linearised BGK equation between diffuse walls, ψ = 1 + π^(−½) ∫ T₋₁(|u − w|) ψ dw on a gap of D mean
    free times: Q = ∫(ψ − 1) du/D². Galerkin's method with constant ψ in cells that are small at the walls."""
    edges = -np.cos(np.linspace(0, np.pi, cells + 1)) * thickness / 2
    x, weight = np.polynomial.legendre.leggauss(300)
    low, high = np.log(1e-9), np.log(8.0)
    speed = np.exp((high - low) / 2 * (x + 1) + low)
    weight = weight * (high - low) / 2 * speed**2 * np.exp(-(speed**2))
    # T₋₁ is the second derivative of T₁(t) = ∫ c exp(−c² − t/c) dc, whose differences integrate it exactly over two cells
    t1 = np.array(
        [(np.exp(-np.abs(edges - e)[:, None] / speed) * weight).sum(axis=1) for e in edges]
    )
    kernel = np.abs(t1[:-1, :-1] + t1[1:, 1:] - t1[:-1, 1:] - t1[1:, :-1])
    width, here = np.diff(edges), np.arange(cells)
    kernel[here, here] = 2 * (width * np.sqrt(np.pi) / 2 - (t1[0, 0] - t1[here, here + 1]))
    ψ = np.linalg.solve(np.diag(width) - kernel / np.sqrt(np.pi), width)
    return ((ψ - 1) * width).sum() / thickness**2


@pytest.mark.parametrize(
    ("d", "known"),
    [
        (0.001, None),
        (0.01, 3.0496),
        (0.0149, None),
        (0.1, 2.0327),
        (0.149, None),
        (0.5, 1.6019),
        (1.0, 1.5387),
        (2.0, 1.5949),
        (5.0, 1.9908),
        (10.0, 2.7686),
    ],
)
def test_flow_rate_agrees_with_the_boltzmann_equation(d, known):
    coarse, fine = boltzmann_flow_rate(d, 50), boltzmann_flow_rate(d, 100)
    solved = fine + (fine - coarse) / 3
    if known is not None:
        assert_allclose(solved, known, atol=2e-4)
    assert_allclose(flow_rate(d), solved, rtol=0.009)


def test_jumps_between_the_formulas_are_those_documented():
    for border, jump in ((0.01, 0.0), (0.15, 0.0027), (5.0, 0.0014)):
        below, above = flow_rate([border * (1 - 1e-13), border])
        assert_allclose(abs(below / above - 1), jump, atol=1e-4)


def test_flow_factor_has_its_limits_in_wide_and_narrow_gaps():
    """Continuum with slip of 1.0162 √π/2 mean free paths on both walls; free molecules between plates without end."""
    d = np.array([1e3, 1e5])
    assert_allclose(HELIUM.flow_factor(d, 1.0)[0] > 1, True)
    assert_allclose(6 * flow_rate(d) / d - 1, 6 * 1.0162 / d, rtol=2e-3)
    d = np.array([1e-6, 1e-9])
    assert_allclose(
        flow_rate(d), (1.5 * (1 - np.euler_gamma) - np.log(d)) / np.sqrt(np.pi), rtol=2e-5
    )
    assert np.isfinite(flow_rate(0.0))
    # there the flow of a gap no longer depends on the viscosity but for the logarithm
    thick = IdealGas(2 * HELIUM.viscosity, HELIUM.molar_mass, HELIUM.temperature)
    through = [gas.flow_factor(1e-12, 1.0) / gas.viscosity for gas in (HELIUM, thick)]
    assert_allclose(through[0] / through[1], 1, atol=0.04)


def test_flow_factor_of_helium_at_one_bar_agrees_with_published_values():
    assert_allclose(HELIUM.flow_factor([1e-6, 100e-9, 30e-9], 1e5), [2.5, 21, 83], rtol=0.01)
    assert HELIUM.flow_factor(np.ones((2, 3)), 1e5).shape == (2, 3)
    assert HELIUM.flow_factor(0.0, 1e5) == HELIUM.flow_factor(1e-6, 0.0) == np.inf


def test_flow_increases_with_gap_and_pressure():
    gap = np.geomspace(1e-11, 1e-3, 2000)
    assert (np.diff(gap**3 * HELIUM.flow_factor(gap, 1e5)) > 0).all()
    assert (np.diff(HELIUM.flow_factor(gap, 1e5)) < 0).all()


def test_without_slip_the_factor_is_one():
    gas = IdealGas(1e-5, 0.029, 293.0, slip=False)
    assert gas.flow_factor(1e-9, 1.0) == 1
    with pytest.raises(InputError, match="slip: given 'no', expected True or False"):
        IdealGas(1e-5, 0.029, 293.0, slip="no")


@pytest.mark.parametrize(
    ("gap", "pressure", "name"),
    [(-1e-9, 1e5, "gap"), (np.nan, 1e5, "gap"), (1e-6, -1.0, "pressure")],
)
def test_negative_or_undefined_gaps_and_pressures_are_refused(gap, pressure, name):
    with pytest.raises(InputError, match=f"^{name}: given negative or undefined"):
        HELIUM.flow_factor(gap, pressure)

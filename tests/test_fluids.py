"""Fluids: the potential and its inverse, limits, densities, and the refusal of what is not a fluid."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from femseal.base import InputError
from femseal.fluids import Liquid, RoelandsLiquid
from femseal.gases import IdealGas

AIR = IdealGas(viscosity=18.1e-6, molar_mass=28.96e-3, temperature=293.15)
OIL = Liquid(viscosity=0.05, density=870.0, pressure_viscosity=20e-9)
FLUIDS = [AIR, OIL, Liquid(1e-3), RoelandsLiquid(0.05, 20e-9)]


@pytest.mark.parametrize("fluid", FLUIDS)
def test_pressure_inverts_potential(fluid):
    p = np.array([0.0, 1.0, 1e5, 1e7, 3e8])
    assert_allclose(fluid.pressure(fluid.potential(p)), p, rtol=1e-9)
    assert fluid.potential(p).shape == p.shape


@pytest.mark.parametrize("fluid", FLUIDS)
def test_slope_of_the_potential_is_density_over_viscosity(fluid):
    p, dp = 2e7, 1e3
    slope = (fluid.potential(p + dp) - fluid.potential(p - dp)) / (2 * dp)
    if isinstance(fluid, RoelandsLiquid):
        scale = np.log(0.05 / 6.31e-5)
        density, viscosity = (
            870.0,
            0.05 * np.exp(scale * ((1 + p / 1.962e8) ** (20e-9 * 1.962e8 / scale) - 1)),
        )
    elif isinstance(fluid, IdealGas):
        density = p * 28.96e-3 / (8.314462618 * 293.15)
        viscosity = fluid.viscosity
    else:
        density, viscosity = fluid.density, fluid.viscosity * np.exp(fluid.pressure_viscosity * p)
    assert_allclose(slope, density / viscosity, rtol=1e-7)


def test_barus_tends_to_constant_viscosity():
    constant = Liquid(0.05, 870.0).potential(1e7)
    assert_allclose(Liquid(0.05, 870.0, 1e-17).potential(1e7), constant, rtol=1e-9)
    assert OIL.potential(1e7) < constant


def test_the_potential_of_a_gas_is_proportional_to_the_square_of_pressure():
    assert_allclose(AIR.potential(3e5) - AIR.potential(1e5), 8 * AIR.potential(1e5), rtol=1e-12)


def test_reference_densities():
    assert_allclose(AIR.reference_density, 1.204, rtol=1e-3)
    assert OIL.reference_density == 870.0
    assert Liquid(1e-3).reference_density == 1000.0


@pytest.mark.parametrize("angle", [-0.1, 4.0, 120.0])
def test_a_contact_angle_is_at_most_180_degrees(angle):
    assert Liquid(1e-3, contact_angle=np.pi).contact_angle == np.pi
    with pytest.raises(InputError, match=r"^contact_angle: given"):
        Liquid(1e-3, contact_angle=angle)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_properties_must_be_finite_and_positive(bad):
    with pytest.raises(InputError, match=r"^viscosity: given .*> 0 \[Pa·s\]"):
        Liquid(bad)
    with pytest.raises(InputError, match=r"^density: given .*> 0 \[kg/m³\]"):
        Liquid(1e-3, bad)
    with pytest.raises(InputError, match=r"^viscosity: given"):
        IdealGas(bad, 0.029, 293.0)
    with pytest.raises(InputError, match=r"^molar_mass: given .*\[kg/mol\]"):
        IdealGas(1e-5, bad, 293.0)
    with pytest.raises(InputError, match=r"^temperature: given .*\[K\]"):
        IdealGas(1e-5, 0.029, bad)


@pytest.mark.parametrize("bad", [-1e-9, np.nan, np.inf])
def test_pressure_viscosity_may_be_zero_but_not_negative(bad):
    with pytest.raises(InputError, match=r"^pressure_viscosity: given .*>= 0 \[1/Pa\]"):
        Liquid(1e-3, pressure_viscosity=bad)


def test_roelands_potential_agrees_with_an_adaptive_quadrature_and_barus():
    from scipy.integrate import quad

    oil = RoelandsLiquid(0.05, 20e-9)
    for p in (1e5, 1e8, 1e9):
        found = quad(
            lambda x: 870.0 / oil.viscosity_at(x), 0, p, epsabs=0, epsrel=1e-12, limit=500
        )[0]
        assert_allclose(oil.potential(p), found, rtol=1e-10)
    assert_allclose(oil.potential(1e4), Liquid(0.05, 870.0, 20e-9).potential(1e4), rtol=1e-6)
    assert 1e5 < oil.viscosity_at(1e9) / 0.05 < np.exp(20) / 100
    with pytest.raises(InputError, match="viscosity"):
        RoelandsLiquid(5e-5, 20e-9)

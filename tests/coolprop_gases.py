"""Real gases by CoolProp, which may not be installed, and ideal gases to compare them with."""

from importlib.util import find_spec
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

import femseal as fs

needs_coolprop = pytest.mark.skipif(
    find_spec("CoolProp") is None, reason="the extra femseal[fluids] is not installed"
)
#: Entries of `sys.modules` with which an import of CoolProp fails.
LEFT_OUT = {"CoolProp": None, "CoolProp.CoolProp": None}


def potential_by_quadrature(name, temperature, pressure):
    """∫ρ/η dp from 0 to the pressure, of CoolProp's high-level functions."""
    from CoolProp.CoolProp import PropsSI

    def mobility(p):
        density, viscosity = (PropsSI(letter, "T", temperature, "P", p, name) for letter in "DV")
        return density / viscosity

    edges = np.geomspace(1e-4 * pressure, pressure, 9)
    thin = 0.5 * mobility(edges[0]) * edges[0]  # ρ/η goes with p there
    parts = [quad(mobility, a, b, epsabs=0, epsrel=1e-9, limit=200)[0] for a, b in pairwise(edges)]
    return thin + sum(parts)


def potential_drop(gas, inlet, outlet):
    """∫ρ/η dp of a gas of the package, from the pressure at the outlet to that at the inlet."""
    return float(gas.potential(inlet) - gas.potential(outlet))


def ideal_gas(viscosity, molar_mass, temperature=293.15):
    """Ideal gas of this viscosity [µPa·s] and molar mass [g/mol]."""
    return fs.IdealGas(viscosity * 1e-6, molar_mass * 1e-3, temperature)

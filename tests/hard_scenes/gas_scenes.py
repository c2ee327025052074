"""Hard scenes of gases in a gap, from the continuum to free molecules."""

from functools import partial
from math import pi

import numpy as np
from hard_scene import HardScene
from judges import between, near, refused
from pydantic import TypeAdapter

from femseal.analytic import parallel_plates
from femseal.case.fluid import AnyFluid, with_absolute_pressures, with_named_fluids
from femseal.flow import cell_permeability
from femseal.flow.law import FukuiKaneko
from femseal.fluids import IdealGas, RealGas, potential_of
from femseal.rarefied import flow_rate
from femseal.seal import RectangularSeal, seal_leakage

D, H = 1e-6, 1e-6
PLATES = float(parallel_plates(H))
HELIUM = IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15)
LAW = HELIUM.law

scene = partial(HardScene, "flow")


def _gas_cell(inverse_knudsen):
    """Permeability over that of the plates of a gas at a D."""
    assert isinstance(LAW, FukuiKaneko)
    pressure = inverse_knudsen / float(LAW.inverse_knudsen(H, 1.0))
    gap = np.full((8, 8), H)
    return cell_permeability(gap, (D, D), law=LAW, pressure=pressure).value / PLATES


def _free(inverse_knudsen):
    return (
        6 / inverse_knudsen * (1.5 * (1 - np.euler_gamma) - np.log(inverse_knudsen)) / np.sqrt(pi)
    )


def _dense():
    """Leakage of 700 bar of hydrogen through a seal, over a sum over CoolProp's ρ/η."""
    real, seal = RealGas("hydrogen", 293.15, slip=False), RectangularSeal((1e-3, 1e-3), (4, 4))
    p = 7e7 * (np.arange(2000) + 0.5) / 2000
    summed = float((real.density_at(p) / real.viscosity_at(p)).mean() * 7e7)
    return seal_leakage(seal, 1e-20, real, inlet_pressure=7e7).mass_rate / (1e-20 * summed)


def _near_saturation():
    """Pressures from carbon dioxide 1e-5 below its saturation at 20 °C to a vacuum: highest and lowest over the ends."""
    gas = RealGas("CO2", 293.15)
    inlet = (1 - 1e-5) * gas.highest_pressure
    leakage = seal_leakage(RectangularSeal((1e-3, 1e-3), (4, 4)), 1e-20, gas, inlet_pressure=inlet)
    found = np.asarray(leakage.fluid_pressure)
    return [
        float(found.max() / inlet),
        leakage.mass_rate / (1e-20 * potential_of(gas, "inlet", inlet)),
    ]


def _above_a_vacuum(text):
    """Leakage of helium of 0 bar(g) to a pressure that is given as text, over that to an absolute vacuum."""
    fluid = {"name": "helium", "slip": False, "inlet_pressure": "0 bar(g)", "outlet_pressure": text}
    data = with_named_fluids(with_absolute_pressures({"fluid": fluid}))["fluid"]
    state = TypeAdapter(AnyFluid).validate_python(data).state
    ends = {"inlet_pressure": state.inlet_pressure, "outlet_pressure": state.outlet_pressure}
    rate = seal_leakage(RectangularSeal((1e-3, 1e-3), (4, 4)), 1e-20, state.fluid, **ends).mass_rate
    return rate / (1e-20 * float(state.fluid.potential(101_325.0)))


SCENES = (
    scene(
        "gas, continuum",
        "helium at D = 1e9: permeability over that of the plates",
        near(1.0, 1e-8, "no slip"),
        lambda: _gas_cell(1e9),
    ),
    scene(
        "gas, slip",
        "helium at D = 1e3: permeability over that of the plates",
        near(1 + 6 * 1.0162 / 1e3, 1e-5, "slip at both walls"),
        lambda: _gas_cell(1e3),
    ),
    scene(
        "gas, free molecules",
        "helium at D = 1e-9: permeability over that of the plates",
        near(_free(1e-9), 2e-5, "plates without end, Cercignani & Daneri"),
        lambda: _gas_cell(1e-9),
    ),
    scene(
        "gas, no molecules",
        "D = 0: flow rate Q",
        between(1.0, 100.0, "finite"),
        lambda: float(flow_rate(0.0)),
    ),
    scene(
        "gas, 700 bar",
        "hydrogen of 700 bar into a vacuum: leakage over a sum over CoolProp's ρ/η",
        near(1.0, 1e-6, "quadrature"),
        _dense,
        needs="CoolProp",
    ),
    scene(
        "gas, near saturation",
        "carbon dioxide 1e-5 below saturation: pressure at the inlet, leakage over that of the potential",
        near((1.0, 1.0), 1e-9, "a plain strip"),
        _near_saturation,
        needs="CoolProp",
    ),
    scene(
        "gas, above saturation",
        "carbon dioxide 1e-5 above saturation at 20 °C",
        refused("CO2 condenses at 20 °C"),
        lambda: potential_of(RealGas("CO2"), "inlet", (1 + 1e-5) * RealGas("CO2").highest_pressure),
        needs="CoolProp",
    ),
    scene(
        "gas, gauge vacuum",
        "helium of 0 bar(g) to 0 bar(a), -1 atm(g) and -1.01325 Pa(g): leakage over that into a vacuum",
        near((1.0, 1.0, 2e-5), 1e-4, "p²"),
        lambda: [_above_a_vacuum(text) for text in ("0 bar(a)", "-1 atm(g)", "-1.01325 Pa(g)")],
    ),
)

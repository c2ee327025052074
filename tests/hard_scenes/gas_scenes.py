"""Hard scenes of gases in a gap, from the continuum to free molecules."""

from __future__ import annotations

from functools import partial
from math import pi

import numpy as np
from hard_scene import HardScene
from judges import Between, Near

from femseal.analytic import parallel_plates
from femseal.flow import cell_permeability
from femseal.flow.law import FukuiKaneko
from femseal.fluids import IdealGas
from femseal.rarefied import flow_rate

D, H = 1e-6, 1e-6
PLATES = float(parallel_plates(H))
HELIUM = IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15)
LAW = HELIUM.law

scene = partial(HardScene, stage="flow")


def _gas_cell(inverse_knudsen: float) -> float:
    """Permeability over that of the plates of a gas at a D."""
    assert isinstance(LAW, FukuiKaneko)
    pressure = inverse_knudsen / float(LAW.inverse_knudsen(H, 1.0))
    gap = np.full((8, 8), H)
    return cell_permeability(gap, (D, D), law=LAW, pressure=pressure).value / PLATES


def _free(inverse_knudsen: float) -> float:
    return 6 / inverse_knudsen * (1.5 * (1 - np.euler_gamma) - np.log(inverse_knudsen)) / np.sqrt(pi)


SCENES: tuple[HardScene, ...] = (
    scene(
        "gas, continuum",
        what="helium at D = 1e9: permeability over that of the plates",
        must=Near(1.0, 1e-8, "no slip"),
        run=lambda: _gas_cell(1e9),
    ),
    scene(
        "gas, slip",
        what="helium at D = 1e3: permeability over that of the plates",
        must=Near(1 + 6 * 1.0162 / 1e3, 1e-5, "slip at both walls"),
        run=lambda: _gas_cell(1e3),
    ),
    scene(
        "gas, free molecules",
        what="helium at D = 1e-9: permeability over that of the plates",
        must=Near(_free(1e-9), 2e-5, "plates without end, Cercignani & Daneri"),
        run=lambda: _gas_cell(1e-9),
    ),
    scene(
        "gas, no molecules",
        what="D = 0: flow rate Q",
        must=Between(1.0, 100.0, "finite"),
        run=lambda: float(flow_rate(0.0)),
    ),
)

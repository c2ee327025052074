"""Leakage of a whole seal: permeability and fluid in, rate and fluid pressure out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.text import Shown
from ..flow.permeability_table import PermeabilityTable
from ..fluids import Fluid, potential_of
from .pressure_dependent import pressure_dependent_flow
from .shapes import Seal

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Leakage(Shown):
    """Leakage from inlet to outlet, negative if the outlet pressure is higher; fields carry units."""

    volume_rate: float = field(metadata={"unit": "m^3/s", "long_name": "leakage"})
    mass_rate: float = field(metadata={"unit": "kg/s", "long_name": "mass leakage"})
    per_length: float = field(metadata={"unit": "m^2/s", "long_name": "leakage per length of seal"})
    lower: float = field(metadata={"unit": "m^3/s", "long_name": "lower bound of the leakage"})
    upper: float = field(metadata={"unit": "m^3/s", "long_name": "upper bound of the leakage"})
    fluid_pressure: Array = field(metadata={"unit": "Pa", "long_name": "fluid pressure at the nodes"}, repr=False)
    conductance: float = field(metadata={"unit": "m^3", "long_name": "mass leakage for a unit drop of potential"})
    iterations: int = field(metadata={"unit": "1", "long_name": "iterations of the linear solver, 0 if direct"})
    residual: float = field(metadata={"unit": "1", "long_name": "residual of the linear solver"})
    imbalance: float = field(metadata={"unit": "1", "long_name": "difference of inlet and outlet flow"})
    percolates: bool = field(metadata={"unit": "1", "long_name": "an open path from inlet to outlet"})
    solver: str = field(metadata={"unit": "1", "long_name": "solver of the linear system"})
    permeability: Any = field(
        default=None,
        metadata={"unit": "m^3", "long_name": "permeability at the pressures of the solution, if it depends on them"},
        repr=False,
    )


def seal_leakage(
    seal: Seal,
    permeability: Any,
    fluid: Fluid,
    *,
    inlet_pressure: float,
    outlet_pressure: float = 0.0,
    bounds: bool = False,
    solver: str = "auto",
) -> Leakage:
    """Leakage of a seal, ∇·(k∇φ) = 0 in the pressure potential φ of the fluid; exactly 0 without an open
    path.

    Parameters
    ----------
    seal : shape of the seal.
    permeability : k >= 0 [m³]; a number; on structured seals of (n1, n2) cells the links (k1, k2), numbers or arrays
        (n1, n2) and (n1 − 1, n2), or symmetric tensors (n1, n2, 2, 2) of the elements between four nodes, in the
        directions of the two axes; on meshes (n_elements,), (n_elements, 2) along x and y, or (n_elements, 2, 2). A
        `PermeabilityTable` of any of these gives it at several pressures, as a gas with slip needs; anything else is
        taken for that of all pressures.
    fluid : a `Liquid`, an `IdealGas` or anything else with a pressure potential.
    inlet_pressure, outlet_pressure : [Pa]; absolute for a gas.
    bounds : also enclose the rate between `lower` and `upper`; otherwise both are NaN. On structured seals
        they enclose the flow of the network of links, on straight meshes that of the mesh with k constant on
        each element. Not with tensors on structured seals.
    solver : of the linear system, see `femseal.flow.solve_flow`; on meshes "auto", "direct" or "amg".

    Returns
    -------
    Leakage; volume rates are at the fluid's reference density, `fluid_pressure` is (n1 + 1, n2) from inlet
    to outlet on structured seals and (n_vertices,) on meshes. Nodes that only one end reaches have its
    pressure, those that neither does NaN.

    Raises
    ------
    InputError : a permeability that is negative, not finite or of the wrong shape, a pressure the fluid
        cannot have, bounds on a curved mesh.
    NotConverged : inlet and outlet flow do not balance.
    """
    φ_in = potential_of(fluid, "inlet_pressure", inlet_pressure)
    φ_out = potential_of(fluid, "outlet_pressure", outlet_pressure)
    local = None
    if isinstance(permeability, PermeabilityTable):
        ends = {"inlet": float(inlet_pressure), "outlet": float(outlet_pressure)}
        flow, local = pressure_dependent_flow(seal, permeability, fluid, **ends, bounds=bounds, solver=solver)
    else:
        flow = seal.flow(permeability, bounds=bounds, solver=solver)
    drop = φ_in - φ_out
    to_volume = drop / fluid.reference_density
    volume_rate = flow.conductance * to_volume
    lower, upper = sorted((flow.lower * to_volume, flow.upper * to_volume))
    # rounding errors, and elements with oblique tensors, may exceed the end pressures
    potential = φ_out + drop * np.clip(flow.potential, 0.0, 1.0)
    return Leakage(
        volume_rate=volume_rate,
        mass_rate=flow.conductance * drop,
        per_length=volume_rate / seal.length,
        lower=lower,
        upper=upper,
        fluid_pressure=fluid.pressure(potential),
        conductance=flow.conductance,
        iterations=flow.iterations,
        residual=flow.residual,
        imbalance=flow.imbalance,
        percolates=flow.percolates,
        solver=flow.solver,
        permeability=local,
    )

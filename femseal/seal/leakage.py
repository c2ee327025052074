"""Leakage of a whole seal: permeability and fluid in, rate and fluid pressure out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..base.arrays import Array
from ..base.errors import InputError
from ..base.text import Shown
from ..flow.permeability_table import PermeabilityTable
from ..fluids import Fluid, potential_of
from .mesh_seal import PressureBoundaries
from .pressure_dependent import pressure_dependent_flow
from .shapes import Seal


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
    boundary_rates: dict[str, float] | None = field(
        default=None,
        metadata={"unit": "m^3/s", "long_name": "flow into the seal through each boundary, of inlets with pressures"},
    )


def seal_leakage(
    seal: Seal,
    permeability: Any,
    fluid: Fluid,
    *,
    inlet_pressure: float | None = None,
    outlet_pressure: float = 0.0,
    bounds: bool = False,
    solver: str = "auto",
    rtol: float = 1e-5,
    rate_only: bool = False,
) -> Leakage:
    """Leakage of a seal, ∇·(k∇φ) = 0 in the pressure potential φ of the fluid; exactly 0 without an open
    path.

    Parameters
    ----------
    seal : shape of the seal.
    permeability : k >= 0 [m³]; a number; on structured seals of (n1, n2) cells the links (k1, k2), numbers or arrays
        (n1, n2) and (n1 − 1, n2), or an array of the elements between four nodes, (n1, n2), (n1, n2, 2) along the two
        axes or symmetric tensors (n1, n2, 2, 2), also flat as on meshes: (n_elements,), (n_elements, 2) along x and y,
        or (n_elements, 2, 2). A
        `PermeabilityTable` of any of these gives it at several pressures, as a rarefied gas needs; anything else is
        taken for that of all pressures.
    fluid : a `Liquid`, an `IdealGas` or anything else with a pressure potential.
    inlet_pressure, outlet_pressure : [Pa]; absolute for a gas. A mesh whose inlets have pressures of their own takes no
        inlet pressure.
    bounds : also enclose the rate between `lower` and `upper`; otherwise both are NaN. On structured seals
        they enclose the flow of the network of links, on straight meshes that of the mesh with k constant on
        each element. Not with elements of structured seals, nor with pressures of inlets: the flow out of one of
        several boundaries is no energy.
    solver : of the linear system, see `femseal.flow.solve_flow`; on meshes "auto", "direct" or "amg".
    rtol : relative error of the rate at which permeabilities that depend on the pressure have settled.
    rate_only : of such permeabilities on links, take the rate from bounds of the next solution, which is not solved;
        fields are those of the solution before and carry another rate.

    Returns
    -------
    Leakage; volume rates are at the fluid's reference density, `fluid_pressure` is (n1 + 1, n2) from inlet
    to outlet on structured seals and (n_vertices,) on meshes. Nodes that only one end reaches have its
    pressure, those that neither does NaN. With pressures of inlets the rates are those out of the outlets together;
    `boundary_rates` has those into the seal through every boundary, negative where the fluid leaves, and
    `conductance` is that for a unit of the largest drop.

    Raises
    ------
    InputError : a permeability that is negative, not finite or of the wrong shape, a pressure the fluid
        cannot have, bounds on a curved mesh; with pressures of inlets also an inlet pressure, bounds, or a
        `PermeabilityTable`.
    NotConverged : inlet and outlet flow do not balance.
    """
    if (boundaries := getattr(seal, "boundaries", None)) is not None:
        refused = {
            "inlet_pressure": inlet_pressure is not None,
            "bounds": bounds,
            "permeability": isinstance(permeability, PermeabilityTable),
        }
        for name, given in refused.items():
            if given:
                raise InputError(name, _REFUSED[name], "none on a seal whose inlets have pressures of their own")
        return _between_boundaries(seal, boundaries, permeability, fluid, outlet_pressure, solver)
    φ_in = potential_of(fluid, "inlet_pressure", inlet_pressure)
    φ_out = potential_of(fluid, "outlet_pressure", outlet_pressure)
    local = None
    if isinstance(permeability, PermeabilityTable):
        assert inlet_pressure is not None  # it has a potential
        ends = {"inlet": float(inlet_pressure), "outlet": float(outlet_pressure)}
        flow, local = pressure_dependent_flow(
            seal, permeability, fluid, **ends, bounds=bounds, solver=solver, rtol=rtol, rate_only=rate_only
        )
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


#: What is not possible with pressures of inlets.
_REFUSED = {"inlet_pressure": "a pressure", "bounds": "true", "permeability": "a table over pressures, as of slip"}


def _between_boundaries(
    seal: Any, boundaries: PressureBoundaries, permeability: Any, fluid: Fluid, outlet_pressure: float, solver: str
) -> Leakage:
    """Leakage out of the outlets of a seal whose inlets have pressures of their own."""
    φ_out = potential_of(fluid, "outlet_pressure", outlet_pressure)
    names = boundaries.names[: len(boundaries.pressures)]
    drops = [
        potential_of(fluid, f"inlet {name!r}", p) - φ_out for name, p in zip(names, boundaries.pressures, strict=True)
    ]
    drop = max(drops, key=abs)
    levels = np.zeros(len(boundaries.names))
    levels[: len(names)] = np.divide(drops, drop) if drop else 1.0
    flow = seal.flow_between(permeability, boundaries, levels, solver=solver)
    outflow = flow.rates[len(names) :]
    conductance = 0.0 - float(outflow.sum())
    to_volume = drop / fluid.reference_density
    potential = φ_out + drop * np.clip(flow.potential, levels.min(), levels.max())
    return Leakage(
        volume_rate=conductance * to_volume,
        mass_rate=conductance * drop,
        per_length=conductance * to_volume / seal.length,
        lower=np.nan,
        upper=np.nan,
        fluid_pressure=fluid.pressure(potential),
        conductance=conductance,
        iterations=flow.iterations,
        residual=flow.residual,
        imbalance=flow.imbalance,
        percolates=bool(outflow.any()),
        solver=flow.solver,
        boundary_rates=dict(zip(boundaries.names, (to_volume * flow.rates).tolist(), strict=True)),
    )

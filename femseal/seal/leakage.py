"""Leakage of a whole seal: permeability and fluid in, rate and fluid pressure out.

A permeability that depends on the pressure of the fluid, ∇·(k(p) ρ/η ∇p) = 0, is solved as a fixed point of linear
flows, in the potential ψ of a typical gap (see `flow.pressure_drop`). Each element takes its mean permeability between
the lowest and the highest pressure of its corners, ∫ k(p) (ρ/η) dp over ∫ dψ.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..base import Array, InputError, Shown
from ..base.fixed_point import fixed_point
from ..flow.permeability_table import PermeabilityTable, PressureCurve
from ..flow.pressure_drop import PressureDrop
from ..flow.problem import DarcyFlow
from ..fluids import Fluid, potential_of
from .shapes import Seal


def pressure_dependent_flow(
    seal: Seal,
    table: PermeabilityTable,
    fluid: Any,
    *,
    inlet: float,
    outlet: float,
    bounds: bool = False,
    solver: str = "auto",
    rtol: float,
) -> tuple[DarcyFlow, Any]:
    """Flow through a seal for a unit drop of the viscous potential φ, and the permeability of each part.

    seal, fluid, bounds, solver, rtol : as in `seal_leakage`; bounds are those with the permeabilities of the solution.
    table : permeability at several pressures. inlet, outlet : pressures of the ends [Pa].

    Returns the flow, its potential as fraction of the drop of φ, and the permeabilities with which φ has this flow
    [m³].

    Raises NotConverged: the linear solver failed, or the flow still changes after many solutions.
    """
    drop = PressureDrop(fluid, inlet, outlet)
    if drop.law.depends_on_pressure:
        pressure, k = table.typical
        drop = replace(drop, gap=drop.law.gap(k, pressure) if k > 0 else drop.gap)
    values = _element_values(seal, table.values)
    curve = PressureCurve(table.pressures, values, table.piecewise)

    def permeability(fraction: Array) -> Array:
        p = np.maximum(drop.pressure(np.nan_to_num(fraction, nan=0.5)), drop.least_pressure)
        lowest, highest = _corner_range(seal, p, curve.shape)
        return curve.between(lowest, highest, drop.mobility)

    def solve(local: Array) -> tuple[float, Array, DarcyFlow]:
        flow = seal.flow(local, solver=solver)
        return flow.conductance, flow.potential, flow

    uniform = seal.flow(1.0, solver=solver).potential
    solved = fixed_point(permeability, solve, uniform, rtol=rtol, name="flow through a seal")
    flow, local, rate = solved.solution, solved.coefficient, solved.rate
    if bounds:
        flow = seal.flow(local, bounds=True, solver=solver)
        rate = flow.conductance
    factor, fraction = drop.mean_factor, np.clip(flow.potential, 0.0, 1.0)
    potential = drop.viscous_fraction(fraction)
    scaled = replace(
        flow,
        conductance=factor * rate,
        lower=factor * flow.lower,
        upper=factor * flow.upper,
        potential=potential,
        complement=1 - potential,
    )
    if (
        drop.law.depends_on_pressure
    ):  # what flows through each element is the same in both potentials
        corners = _corner_range(seal, np.nan_to_num(fraction, nan=0.5), curve.shape)
        local = local * drop.steepness(*corners)
    return scaled, local


def _element_values(seal: Seal, values: Array) -> Array:
    """Return a table's values for every element (m, n) or (m, n, 2), from one number or more at each of m pressures.

    Raises InputError: values of another shape.
    """
    count = seal.element_shapes[0]
    if values.ndim == 1:
        values = np.broadcast_to(values[:, None], (len(values), *count))
    if values.shape[1:] not in seal.element_shapes:
        allowed = " or ".join(map(str, seal.element_shapes))
        expected = f"{len(values)} values, or as many for each element {allowed}"
        raise InputError("permeability", f"shape {values.shape}", expected)
    has_axes = values[0].size == 2 * count[0]
    return values.reshape(len(values), *count, *((2,) if has_axes else ()))


def _corner_range(seal: Seal, at_points: Array, shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Lowest and highest value at the corners of each element, with an axis more where k has two axes."""
    corners = seal.corner_values(at_points)
    lowest, highest = corners.min(axis=1), corners.max(axis=1)
    more = (1,) * (len(shape) - 1)
    return lowest.reshape(-1, *more), highest.reshape(-1, *more)


def _known(unit: str, long_name: str, **options: Any) -> Any:
    """A field of `Leakage` with its unit and meaning."""
    return field(metadata={"unit": unit, "long_name": long_name}, **options)


@dataclass(frozen=True, repr=False)
class Leakage(Shown):
    """Leakage from inlet to outlet, negative if the outlet pressure is higher; fields carry units."""

    volume_rate: float = _known("m^3/s", "leakage")
    mass_rate: float = _known("kg/s", "mass leakage")
    per_length: float = _known("m^2/s", "leakage per length of seal")
    lower: float = _known("m^3/s", "lower bound of the leakage")
    upper: float = _known("m^3/s", "upper bound of the leakage")
    fluid_pressure: Array = _known("Pa", "fluid pressure at the nodes", repr=False)
    conductance: float = _known("m^3", "mass leakage for a unit drop of potential")
    iterations: int = _known("1", "iterations of the linear solver, 0 if direct")
    residual: float = _known("1", "residual of the linear solver")
    imbalance: float = _known("1", "difference of inlet and outlet flow")
    percolates: bool = _known("1", "an open path from inlet to outlet")
    solver: str = _known("1", "solver of the linear system")
    permeability: Any = _known(
        "m^3",
        "permeability at the pressures of the solution, if it depends on them",
        default=None,
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
    rtol: float = 1e-5,
) -> Leakage:
    """Leakage of a seal, ∇·(k∇φ) = 0 in the pressure potential φ of the fluid; exactly 0 without an open
    path.

    Parameters
    ----------
    seal : shape of the seal.
    permeability : k >= 0 [m³]; a number, or one per element: (n_elements,), (n_elements, 2) along the two axes, or
        symmetric tensors (n_elements, 2, 2). The axes are x1 and x2, of a ring the radius and the angle, of a mesh x
        and y. Strips and rings of (n1, n2) cells also take (n1, n2) and (n1, n2, 2). A `PermeabilityTable` of any but
        tensors gives it at several pressures, as a rarefied gas needs; anything else is taken for that of all
        pressures.
    fluid : a `Liquid`, an `IdealGas` or anything else with a pressure potential.
    inlet_pressure, outlet_pressure : [Pa]; absolute for a gas.
    bounds : also enclose the rate between `lower` and `upper`; otherwise both are NaN. They enclose the flow of the
        shape with k constant on each element; an `ElementSeal` always has them.
    solver : of the linear system: "multigrid" or "elimination", of strips and rings alone, "direct" or "amg", or
        "auto".
    rtol : relative error of the rate at which permeabilities that depend on the pressure have settled.

    Returns
    -------
    Leakage; volume rates are at the fluid's reference density. `fluid_pressure` is given at the corners of the
    elements: of a strip or a ring (n1 + 1, n2) from the inlet to the outlet, of a mesh (n_vertices,). Points that only
    one end reaches have its pressure, those that neither does NaN.

    Raises
    ------
    InputError : a permeability that is negative, not finite or of the wrong shape, or a pressure that the fluid cannot
        have.
    NotConverged : inlet and outlet flow do not balance.

    Examples
    --------
    >>> import femseal as fs
    >>> seal = fs.RectangularSeal((1e-3, 0.1), cells=(1, 1))
    >>> leak = seal_leakage(seal, 1e-18, fs.Liquid(viscosity=1e-3), inlet_pressure=1e6)
    >>> f"{leak.volume_rate:.3g} m³/s, {leak.per_length:.3g} m²/s"
    '1e-07 m³/s, 1e-06 m²/s'
    """
    φ_in = potential_of(fluid, "inlet_pressure", inlet_pressure)
    φ_out = potential_of(fluid, "outlet_pressure", outlet_pressure)
    local, drop = None, φ_in - φ_out
    bounds = bounds or seal.value_needs_bounds
    if isinstance(permeability, PermeabilityTable):
        ends = {"inlet": float(inlet_pressure), "outlet": float(outlet_pressure)}
        flow, local = pressure_dependent_flow(
            seal, permeability, fluid, **ends, bounds=bounds, solver=solver, rtol=rtol
        )
    else:
        flow = seal.flow(permeability, bounds=bounds, solver=solver)
    to_volume = drop / fluid.reference_density
    lower, upper = sorted((flow.lower * to_volume, flow.upper * to_volume))
    # rounding errors, and elements with oblique tensors, may exceed the end pressures
    potential = φ_out + drop * np.clip(flow.potential, 0.0, 1.0)
    volume_rate = flow.conductance * to_volume
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

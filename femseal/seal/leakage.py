"""Compute the leakage and the fluid pressure of a whole seal from its permeability and a fluid.

If the permeability depends on the fluid pressure, the nonlinear problem ∇·(k(p) ρ/η ∇p) = 0 is solved by fixed-point
iteration, in terms of the potential ψ of a representative gap (see `flow.pressure_drop`). Each iteration solves a
linear flow problem, in which the permeability of an element is the mean ∫ k(p) (ρ/η) dp / ∫ dψ between the lowest and
the highest pressure at its corners.
"""

from __future__ import annotations

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
    """Solve the flow through a seal whose permeability depends on the fluid pressure.

    Parameters
    ----------
    seal, fluid, bounds, solver, rtol
        As in `seal_leakage`. Bounds are computed with the permeability of the converged solution.
    table : PermeabilityTable
        Permeability at several fluid pressures.
    inlet, outlet : float
        Fluid pressures at inlet and outlet [Pa].

    Returns
    -------
    flow : DarcyFlow
        Flow for a unit drop of the potential φ of viscous flow. `flow.potential` is φ as a fraction of this drop.
    permeability : array
        Equivalent permeability of each element [m³]. With this permeability, the linear flow problem in φ has the
        solution of the nonlinear problem.

    Raises
    ------
    NotConverged
        The linear solver failed, or the fixed-point iteration did not converge.
    """
    drop = PressureDrop(fluid, inlet, outlet)
    if drop.law.depends_on_pressure:
        # ψ is the potential in a gap that has the typical permeability of the table
        pressure, k = table.typical
        if k > 0:
            drop = replace(drop, gap=drop.law.gap(k, pressure))
    values = _element_values(seal, table.values)
    curve = PressureCurve(table.pressures, values, table.piecewise)

    def permeability(fraction: Array) -> Array:
        """Return the permeability of the elements for a potential ψ at the points, as a fraction of the drop of ψ."""
        # isolated points have no potential (NaN), and their permeability does not matter
        p = np.maximum(drop.pressure(np.nan_to_num(fraction, nan=0.5)), drop.least_pressure)
        lowest, highest = _corner_range(seal, p, curve.shape)
        return curve.mean_between(lowest, highest, drop.mobility)

    def solve(element_permeability: Array) -> tuple[float, Array, DarcyFlow]:
        """Solve the linear flow problem; return the flow rate, the potential and the whole solution."""
        flow = seal.flow(element_permeability, solver=solver)
        return flow.conductance, flow.potential, flow

    uniform_potential = seal.flow(1.0, solver=solver).potential
    name = "flow through a seal"
    solved = fixed_point(permeability, solve, uniform_potential, rtol=rtol, name=name)
    flow, element_permeability, rate = solved.solution, solved.coefficient, solved.rate
    if bounds:
        flow = seal.flow(element_permeability, bounds=True, solver=solver)
        rate = flow.conductance
    fraction = np.clip(flow.potential, 0.0, 1.0)
    if drop.law.depends_on_pressure:
        # the flow through each element is the same in both potentials
        lowest, highest = _corner_range(seal, np.nan_to_num(fraction, nan=0.5), curve.shape)
        element_permeability = element_permeability * drop.steepness(lowest, highest)
    return _in_viscous_potential(flow, rate, fraction, drop), element_permeability


def _in_viscous_potential(
    flow: DarcyFlow, rate: float, fraction: Array, drop: PressureDrop
) -> DarcyFlow:
    """Convert a flow for a unit drop of the potential ψ to one for a unit drop of the potential φ of viscous flow.

    rate : flow rate for the unit drop of ψ [m³].
    fraction : potential ψ at the points, as a fraction of the drop of ψ.
    """
    # the drop of ψ is `factor` times the drop of φ, so that the flow for a unit drop of φ is larger by this factor
    factor = drop.mean_factor
    potential = drop.viscous_fraction(fraction)
    return replace(
        flow,
        conductance=factor * rate,
        lower=factor * flow.lower,
        upper=factor * flow.upper,
        potential=potential,
        complement=1 - potential,
    )


def _element_values(seal: Seal, values: Array) -> Array:
    """Bring permeabilities at m pressures into the shape (m, n) or (m, n, 2).

    There are n elements, each with one value or with two values along its axes.

    Raises InputError if the shape of the values does not fit the elements of the seal.
    """
    (n,) = seal.element_shapes[0]
    if values.ndim == 1:
        values = np.broadcast_to(values[:, None], (len(values), n))
    if values.shape[1:] not in seal.element_shapes:
        allowed = " or ".join(map(str, seal.element_shapes))
        expected = f"{len(values)} values, or as many for each element {allowed}"
        raise InputError("permeability", f"shape {values.shape}", expected)
    if values[0].size == 2 * n:
        return values.reshape(len(values), n, 2)
    return values.reshape(len(values), n)


def _corner_range(seal: Seal, at_points: Array, shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Return the lowest and the highest value at the corners of each of n elements.

    at_points : values at the points of the seal.
    shape : shape of the permeability, (n,) or (n, 2). The results have the shape (n,) for the first and (n, 1) for the
    second, so that NumPy can broadcast them with the permeability.
    """
    corners = seal.corner_values(at_points)  # (element, corner)
    lowest = corners.min(axis=1)
    highest = corners.max(axis=1)
    if len(shape) == 1:
        return lowest, highest
    return lowest[:, None], highest[:, None]


def _quantity(unit: str, long_name: str, **options: Any) -> Any:
    """Declare a field of `Leakage` with its unit and meaning."""
    return field(metadata={"unit": unit, "long_name": long_name}, **options)


@dataclass(frozen=True, repr=False)
class Leakage(Shown):
    """Hold the leakage from inlet to outlet, which is negative if the outlet pressure is higher.

    Printing it shows each value with its unit.
    """

    volume_rate: float = _quantity("m^3/s", "leakage")
    mass_rate: float = _quantity("kg/s", "mass leakage")
    per_length: float = _quantity("m^2/s", "leakage per length of seal")
    lower: float = _quantity("m^3/s", "lower bound of the leakage")
    upper: float = _quantity("m^3/s", "upper bound of the leakage")
    fluid_pressure: Array = _quantity("Pa", "fluid pressure at the nodes", repr=False)
    conductance: float = _quantity("m^3", "mass leakage for a unit drop of potential")
    iterations: int = _quantity("1", "iterations of the linear solver, 0 if direct")
    residual: float = _quantity("1", "residual of the linear solver")
    imbalance: float = _quantity("1", "difference of inlet and outlet flow")
    percolates: bool = _quantity("1", "an open path from inlet to outlet")
    solver: str = _quantity("1", "solver of the linear system")
    permeability: Any = _quantity(
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
    """Compute the leakage of a seal from ∇·(k∇φ) = 0 in the pressure potential φ of the fluid.

    The leakage is exactly 0 if no open path leads from the inlet to the outlet.

    Parameters
    ----------
    seal : Seal
        Shape of the seal.
    permeability : float, array or PermeabilityTable
        Permeability k >= 0 [m³]: a number; a number for each element (n_elements,); two numbers for each element, along
        its axes (n_elements, 2); or symmetric tensors (n_elements, 2, 2). The axes are x1 and x2 of a strip, radius and
        angle of a ring, and x and y of a mesh. Strips and rings of (n1, n2) cells also accept arrays (n1, n2) and
        (n1, n2, 2). A permeability that depends on the fluid pressure, as that of a rarefied gas, is given by a
        `PermeabilityTable`, which must not contain tensors.
    fluid : Fluid
        A `Liquid`, an `IdealGas` or any other fluid with a pressure potential.
    inlet_pressure, outlet_pressure : float
        Fluid pressures at inlet and outlet [Pa], absolute for a gas.
    bounds : bool
        Whether to compute a `lower` and an `upper` bound of the leakage, which are NaN otherwise. They enclose the
        leakage of the exact shape if the permeability is constant on each element. An `ElementSeal` always has bounds.
    solver : str
        Solver of the linear system: "multigrid" or "elimination" for strips and rings only, "direct", "amg", or
        "auto".
    rtol : float
        Relative change of the leakage at which the iteration for a pressure-dependent permeability stops.

    Returns
    -------
    Leakage
        Volume rates refer to the reference density of the fluid. `fluid_pressure` is given at the corners of the
        elements: an array (n1 + 1, n2) from inlet to outlet for a strip or a ring, and (n_vertices,) for a mesh. Points
        that are connected only to the inlet, or only to the outlet, have the pressure there. At points that are
        connected to neither of them, the pressure is NaN.

    Raises
    ------
    InputError
        A permeability is negative, not finite or of the wrong shape, or a pressure is outside the range of the fluid.
    NotConverged
        The flow rates at inlet and outlet differ.

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
    drop = φ_in - φ_out
    bounds = bounds or seal.value_needs_bounds
    element_permeability = None
    if isinstance(permeability, PermeabilityTable):
        flow, element_permeability = pressure_dependent_flow(
            seal,
            permeability,
            fluid,
            inlet=float(inlet_pressure),
            outlet=float(outlet_pressure),
            bounds=bounds,
            solver=solver,
            rtol=rtol,
        )
    else:
        flow = seal.flow(permeability, bounds=bounds, solver=solver)
    # the flow was solved for a unit drop of φ; this factor converts it to the volume rate for the actual drop
    to_volume = drop / fluid.reference_density
    lower, upper = sorted((flow.lower * to_volume, flow.upper * to_volume))
    # the clip is needed because of rounding errors and of elements with oblique tensors, whose potential may lie beyond
    # those of the ends
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
        permeability=element_permeability,
    )

"""Compute the leakage and the fluid pressure of a whole seal from its permeability and a fluid.

If the permeability depends on the fluid pressure, the flow problem ∇·(k(p) ρ/η ∇p) = 0 is nonlinear. The nonlinear
problem is solved by fixed-point iteration. The unknown of the iteration is the potential ψ of a gap with a typical
permeability (see `flow.pressure_drop`). Each iteration solves a linear flow problem for ψ. In the linear problem, each
element has a mean permeability, ∫ k(p) (ρ/η) dp / ∫ dψ, where both integrals extend from the lowest to the highest
pressure at the corners of the element.
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
    """Compute the flow through a seal whose permeability depends on the fluid pressure.

    Parameters
    ----------
    seal, fluid, bounds, solver, rtol
        See `seal_leakage`. The iteration solves the flow with continuous pressures. The flow and its bounds are
        computed with the permeability of the converged solution.
    table : PermeabilityTable
        Permeability at several fluid pressures.
    inlet, outlet : float
        Fluid pressures at inlet and outlet [Pa].

    Returns
    -------
    flow : DarcyFlow
        Flow for a difference of 1 between inlet and outlet in the potential φ of viscous flow. The potential in the
        field `flow.potential` is 1 at the inlet and 0 at the outlet.
    permeability : array
        Equivalent permeability of each element [m³]. The linear flow problem in φ with the equivalent permeabilities
        has the same solution as the nonlinear problem.

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
        """Return the mean permeability of each element for a given potential.

        fraction : potential ψ at the points, scaled to 1 at the inlet and 0 at the outlet.
        """
        # isolated points have no potential (NaN), and their permeability does not matter
        p = np.maximum(drop.pressure(np.nan_to_num(fraction, nan=0.5)), drop.least_pressure)
        lowest, highest = _corner_range(seal, p, curve.shape)
        return curve.mean_between(lowest, highest, drop.mobility)

    def solve(element_permeability: Array) -> tuple[float, Array, None]:
        """Solve the linear flow problem; return its upper bound, and the potential, which is all that is needed."""
        flow = seal.conforming_flow(element_permeability, solver=solver)
        return flow.conductance, flow.potential, None

    uniform_potential = seal.conforming_flow(1.0, solver=solver).potential
    name = "flow through a seal"
    solved = fixed_point(permeability, solve, uniform_potential, rtol=rtol, name=name)
    element_permeability = solved.coefficient
    flow = seal.flow(element_permeability, bounds=bounds, solver=solver)
    fraction = np.clip(flow.potential, 0.0, 1.0)
    if drop.law.depends_on_pressure:
        # the flow through each element is the same in both potentials
        lowest, highest = _corner_range(seal, np.nan_to_num(fraction, nan=0.5), curve.shape)
        element_permeability = element_permeability * drop.steepness(lowest, highest)
    return _in_viscous_potential(flow, fraction, drop), element_permeability


def _in_viscous_potential(flow: DarcyFlow, fraction: Array, drop: PressureDrop) -> DarcyFlow:
    """Convert a flow solution for the potential ψ to the potential φ of viscous flow.

    The given flow is for a difference of 1 in ψ between inlet and outlet, the returned flow for a difference of 1 in φ.

    fraction : potential ψ at the points, scaled to 1 at the inlet and 0 at the outlet.
    """
    # The difference of ψ between inlet and outlet is `factor` times the difference of φ. The flow for a difference of 1
    # in φ is therefore larger by this factor.
    factor = drop.reference_factor
    potential = drop.φ_fraction(fraction)  # φ, scaled to 1 at the inlet and 0 at the outlet
    return replace(
        flow,
        conductance=factor * flow.conductance,
        lower=factor * flow.lower,
        upper=factor * flow.upper,
        potential=potential,
        complement=1 - potential,
    )


def _element_values(seal: Seal, values: Array) -> Array:
    """Bring permeabilities at m pressures into the shape (m, n) or (m, n, 2).

    The seal has n elements. Each element has a single permeability, or two permeabilities along its axes.

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

    at_points : quantity at the points of the seal.
    shape : shape of the permeability, (n,) or (n, 2). The returned arrays broadcast against the permeability: their
        shape is (n,) for a permeability (n,), and (n, 1) for a permeability (n, 2).
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
    """Leakage of a seal; it is negative if the outlet pressure exceeds the inlet pressure.

    Printing a `Leakage` shows each value with its unit.
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
        "permeability at the solved fluid pressures, if the permeability depends on the pressure",
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
        angle of a ring, and x and y of a mesh. Strips and rings of (n1, n2) cells also accept arrays (n1, n2) and (n1,
        n2, 2). A permeability that depends on the fluid pressure, for example for a rarefied gas, is given by a
        `PermeabilityTable`, which must not contain tensors.
    fluid : Fluid
        A `Liquid`, an `IdealGas` or any other fluid with a pressure potential.
    inlet_pressure, outlet_pressure : float
        Fluid pressures at inlet and outlet [Pa], absolute for a gas.
    bounds : bool
        Whether to compute a `lower` and an `upper` bound of the leakage, which are NaN otherwise. If the permeability
        is constant on each element, the exact leakage lies between the two bounds. The leakage itself does not depend
        on `bounds`.
    solver : str
        Solver of the linear system: "multigrid" or "elimination" for strips and rings only, "direct", "amg", or
        "auto". A solver that the seal does not accept raises an InputError.
    rtol : float
        Relative change of the leakage at which the iteration for a pressure-dependent permeability stops.

    Returns
    -------
    Leakage
        Volume rates refer to the reference density of the fluid. `fluid_pressure` is given at the corners of the
        elements: an array (n1 + 1, n2) from inlet to outlet for a strip or a ring, and (n_vertices,) for a mesh. At
        points that are connected only to the inlet, the pressure is the inlet pressure. At points that are connected
        only to the outlet, the pressure is the outlet pressure. The pressure is NaN at points without any connection to
        inlet or outlet.

        The leakage of a strip or a ring is the geometric mean of the lower and the upper bound, whose errors nearly
        cancel. The leakage of a `MeshSeal` is computed with continuous pressures and is equal to the upper bound.

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
    # the flow was solved for a difference of 1 in φ; the factor converts this flow to the volume rate for the actual
    # difference
    to_volume = drop / fluid.reference_density
    lower, upper = sorted((flow.lower * to_volume, flow.upper * to_volume))
    # The clip is needed because of rounding errors, and because the potential in elements with oblique tensors may lie
    # outside of the range between outlet and inlet.
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

"""Leakage of a whole seal: permeability and fluid in, rate and fluid pressure out.

A permeability that depends on the pressure of the fluid, ∇·(k(p) ρ/η ∇p) = 0: the flow through a link is the difference
of its own potential, ∫ k(p) (ρ/η) dp, between the pressures of its nodes: a network with a single solution, because
each flow rises with its drop. It is solved as a fixed point of linear flows, in the potential ψ of a typical gap (see
`flow.pressure_drop`), with the mean permeability of each link between its pressures. On meshes the permeability
of an element is that at the mean of its nodes.
"""

from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import Any

import numpy as np

from ..base import Array, InputError, Shown
from ..base.fixed_point import fixed_point
from ..flow.permeability_table import PermeabilityTable, PressureCurve
from ..flow.pressure_drop import PressureDrop
from ..flow.problem import DarcyFlow
from ..fluids import Fluid, potential_of
from .mesh_seal import ElementSeal
from .shapes import Seal, StructuredSeal


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
    curves = [
        PressureCurve(table.pressures, k, table.piecewise)
        for k in _on_parts(seal, table.values, len(table.pressures))
    ]
    joined: Any = tuple if isinstance(seal, StructuredSeal) else itemgetter(0)

    def permeability(fraction: Array) -> list[Array]:
        p = np.maximum(drop.pressure(np.nan_to_num(fraction, nan=0.5)), drop.least_pressure)
        return [
            c.between(_beside(first, c.shape), _beside(second, c.shape), drop.mobility)
            for c, (first, second) in zip(curves, _ends(seal, p), strict=True)
        ]

    def solve(local: list[Array]) -> tuple[float, Array, DarcyFlow]:
        flow = seal.flow(joined(local), solver=solver)
        return flow.conductance, flow.potential, flow

    # along a uniform seal the potential falls evenly
    first = np.full(len(seal.points), 0.5)
    if isinstance(seal, StructuredSeal):
        first = np.linspace(1, 0, len(seal.grid.lines1))[:, None]
    solved = fixed_point(permeability, solve, first, rtol=rtol, name="flow through a seal")
    flow, local, rate = solved.solution, solved.coefficient, solved.rate
    if bounds:
        flow = seal.flow(joined(local), bounds=True, solver=solver)
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
    if drop.law.depends_on_pressure:  # what flows through each part is the same in both potentials
        ends = _ends(seal, np.nan_to_num(fraction, nan=0.5))
        local = [
            k * _beside(drop.steepness(*of_parts), k.shape)
            for k, of_parts in zip(local, ends, strict=True)
        ]
    return scaled, joined(local)


def _on_parts(seal: Any, values: Any, pressures: int) -> tuple[Array, ...]:
    """Values of a table, a number or two at each pressure taken for that of all parts; InputError of other shapes."""
    if isinstance(seal, StructuredSeal):
        n1, n2 = seal.cells
        shapes: list[list[tuple[int, ...]]] = [[(n1, n2)], [(n1 - 1, n2)]]
    else:
        shapes = [[(seal.mesh.nelements,), (seal.mesh.nelements, 2)]]
    arrays = values if isinstance(values, tuple) else (values,) * len(shapes)
    if len(arrays) != len(shapes):
        raise InputError("permeability", "two arrays", f"{pressures} values of each part")
    found = []
    for k, (shape, *others) in zip(arrays, shapes, strict=True):
        if k.ndim == 1:
            k = np.broadcast_to(k.reshape(-1, *(1,) * len(shape)), (pressures, *shape))
        if k.shape[1:] not in (shape, *others):
            expected = f"{pressures} values, or as many for each part {shape}"
            raise InputError("permeability", f"shape {k.shape}", expected)
        found.append(k)
    return tuple(found)


def _beside(values: Array, shape: tuple[int, ...]) -> Array:
    """Values of parts, with further axes where each part has several permeabilities."""
    return values.reshape(values.shape + (1,) * (len(shape) - values.ndim))


def _ends(seal: Any, p: Array) -> list[tuple[Array, Array]]:
    """Pressures at both ends of the links along both axes, or twice the mean pressure of each element."""
    if isinstance(seal, StructuredSeal):
        inner = p[1:-1]
        return [(p[:-1], p[1:]), (inner, np.roll(inner, -1, axis=1))]
    mean = p[seal.mesh.t].mean(axis=0)
    return [(mean, mean)]


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
    permeability : k >= 0 [m³]; a number; on structured seals of (n1, n2) cells the links (k1, k2), numbers or arrays
        (n1, n2) and (n1 − 1, n2); on meshes (n_elements,), (n_elements, 2) along x and y, or symmetric tensors
        (n_elements, 2, 2). A `PermeabilityTable` of any but tensors gives it at several pressures, as a rarefied gas
        needs; anything else is taken for that of all pressures.
    fluid : a `Liquid`, an `IdealGas` or anything else with a pressure potential.
    inlet_pressure, outlet_pressure : [Pa]; absolute for a gas.
    bounds : also enclose the rate between `lower` and `upper`; otherwise both are NaN. On structured seals
        they enclose the flow of the network of links, on meshes that of the mesh with k constant on
        each element; an `ElementSeal` always has them.
    solver : of the linear system, see `femseal.flow.solve_flow`; on meshes "auto", "direct" or "amg".
    rtol : relative error of the rate at which permeabilities that depend on the pressure have settled.

    Returns
    -------
    Leakage; volume rates are at the fluid's reference density, `fluid_pressure` is (n1 + 1, n2) from inlet
    to outlet on structured seals and (n_vertices,) on meshes. Nodes that only one end reaches have its
    pressure, those that neither does NaN.

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
    bounds = bounds or isinstance(seal, ElementSeal)  # whose flow is between them
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

"""Flow through a seal whose permeability depends on the pressure of the fluid: ∇·(k(p) ρ/η ∇p) = 0.

The flow through a link is the difference of its own potential, ∫ k(p) (ρ/η) dp, between the pressures of its nodes: a
network with a single solution, because each flow rises with its drop. It is solved as a fixed point of linear flows, in
the potential ψ of a typical gap (see `flow.pressure_drop`), with the mean permeability of each link between its
pressures. On meshes, and with tensors, the permeability of an element is that at the mean of its nodes.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numba import njit

from ..base.arrays import Array
from ..base.errors import InputError
from ..base.fixed_point import fixed_point
from ..flow.permeability_table import PermeabilityTable, pressure_curve
from ..flow.pressure_drop import PressureDrop
from ..flow.solution import DarcyFlow
from .shapes import Seal
from .structured import StructuredSeal, element_tensors


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
    rate_only: bool = False,
) -> tuple[DarcyFlow, Any]:
    """Flow through a seal for a unit drop of the viscous potential φ, and the permeability of each part.

    seal, fluid, bounds, solver, rtol, rate_only : as in `seal_leakage`; bounds are those with the permeabilities of the
        solution.
    table : permeability at several pressures. inlet, outlet : pressures of the ends [Pa].

    Returns the flow, its potential as fraction of the drop of φ, and the permeabilities with which φ has this flow
    [m³].

    Raises NotConverged: the linear solver failed, or the flow still changes after many solutions.
    """
    drop = PressureDrop(fluid, inlet, outlet)
    if drop.law.depends_on_pressure:
        pressure, k = table.typical
        drop = replace(drop, gap=drop.law.gap(k, pressure) if k > 0 else drop.gap)
    values = _on_parts(seal, table.values, len(table.pressures))
    pair = isinstance(values, tuple)
    curves = [pressure_curve(table.pressures, k, table.piecewise) for k in (values if pair else (values,))]

    def permeability(fraction: Any) -> Any:
        p = drop.pressure(np.nan_to_num(np.asarray(fraction, dtype=float), nan=0.5))
        p = np.maximum(p, drop.least_pressure)
        found = tuple(
            c.between(_beside(first, c.shape), _beside(second, c.shape), drop.mobility)
            for c, (first, second) in zip(curves, _ends(seal, p, pair), strict=True)
        )
        return found if pair else found[0]

    def solve(local: Any) -> tuple[float, Array, DarcyFlow]:
        flow = seal.flow(local, solver=solver)
        return flow.conductance, flow.potential, flow

    # along a uniform seal the potential falls evenly
    first = np.linspace(1, 0, len(seal.grid.lines1))[:, None] if isinstance(seal, StructuredSeal) else 0.5
    predict = (
        partial(next_rate, seal) if rate_only and pair and isinstance(seal, StructuredSeal) and not bounds else None
    )
    solved = fixed_point(permeability, solve, first, rtol=rtol, predict=predict, name="flow through a seal")
    flow, local, rate = solved.found, solved.coefficient, solved.rate
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
    if not drop.law.depends_on_pressure:  # both potentials are the same
        return scaled, local
    # what flows through each part is the same in both potentials
    steeper = [drop.steepness(*ends) for ends in _ends(seal, np.nan_to_num(fraction, nan=0.5), pair)]
    if pair:
        return scaled, tuple(k * by for k, by in zip(local, steeper, strict=True))
    return scaled, local * steeper[0].reshape(steeper[0].shape + (1,) * (local.ndim - steeper[0].ndim))


def next_rate(seal: StructuredSeal, flow: DarcyFlow, given: Any, following: Any) -> tuple[float, float]:
    """Bounds of the flow with the following permeabilities of links, from the flow with those given.

    Its potential gives the upper one by Dirichlet's principle, its flux the lower one by Thomson's.
    """
    per_permeability = seal.stencil((1.0, 1.0)).dissipation(flow.potential)
    total, after, inverse = np.sum(
        [_powers(*of_axis) for of_axis in zip(per_permeability, given, following, strict=True)], axis=0
    )
    return float(flow.conductance * total / inverse), float(flow.conductance * after / total)


@njit(cache=True, nogil=True, error_model="numpy")
def _powers(per_permeability, given, following):
    """Sums of the dissipation of links with the permeabilities given and following, and of the first's square over
    the second, which is inf where a link with flow closes.
    """
    total, after, inverse = 0.0, 0.0, 0.0
    for i in range(given.shape[0]):
        for j in range(given.shape[1]):
            here, k, k_after = per_permeability[i, j], given[i, j], following[i, j]
            total += here * k
            after += here * k_after
            if here * k > 0.0:
                inverse += here * k * (k / k_after)
    return total, after, inverse


def _on_parts(seal: Any, values: Any, pressures: int) -> Any:
    """Values of a table, a number or two at each pressure taken for that of all parts; InputError of other shapes."""
    if not isinstance(seal, StructuredSeal):
        n = seal.mesh.nelements
        k = np.repeat(values[:, None], n, axis=1) if np.ndim(values) == 1 else values
        if isinstance(k, tuple) or k.shape[1:] not in ((n,), (n, 2), (n, 2, 2)):
            given = "two arrays" if isinstance(k, tuple) else f"shape {k.shape}"
            raise InputError("permeability", given, f"{pressures} values for each of {n} elements")
        return k
    n1, n2 = seal.cells
    if not isinstance(values, tuple) and element_tensors(values[0], seal.cells) is not None:
        return np.array([element_tensors(k, seal.cells) for k in values])
    pair = values if isinstance(values, tuple) else (values, values)
    shapes = (pressures, n1, n2), (pressures, n1 - 1, n2)
    for k, shape in zip(pair, shapes, strict=True):
        if k.shape not in ((pressures,), shape):
            raise InputError("permeability", f"shape {k.shape}", f"{pressures} values, or shape {shape}")
    return tuple(
        np.broadcast_to(k[:, None, None] if k.ndim == 1 else k, shape) for k, shape in zip(pair, shapes, strict=True)
    )


def _beside(pressure: Array, shape: tuple[int, ...]) -> Array:
    """Pressures of parts, with a further axis where each part has a value along two directions."""
    return pressure[:, None] if pressure.ndim == 1 and len(shape) == 2 and shape[1] == 2 else pressure


def _ends(seal: Any, p: Array, links: bool) -> list[tuple[Array, Array]]:
    """Pressures at both ends of the links along both axes, or twice the mean pressure of each element."""
    if p.ndim == 0:
        return [(p, p)]
    if links:
        inner = p[1:-1]
        return [(p[:-1], p[1:]), (inner, np.roll(inner, -1, axis=1))]
    if hasattr(seal, "mesh"):
        mean = p[seal.mesh.t].mean(axis=0)
    else:
        rows = 0.5 * (p[:-1] + p[1:])
        mean = 0.5 * (rows + np.roll(rows, -1, axis=1))
    return [(mean, mean)]

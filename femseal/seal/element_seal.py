"""A seal of finite elements, each with two permeabilities of its own: its flow between two bounds."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from skfem import Mesh

from ..base import Array, Indices, InputError, Pair
from ..flow.mesh import MeshFlow, MeshOperators
from ..flow.mesh_input import CLOSED_AXIS, permeability_tensors
from .mesh_seal import PressureBoundaries

#: Solvers of a system on a mesh; others are of grids.
_SOLVERS = ("auto", "direct", "amg")
#: A piece closed along one axis keeps `CLOSED_AXIS` of its other permeability there. A seal that only this opens
#: has measured 0.002 to 7e3 of that median in squares, an open one 7e6 and more: below this many it counts as closed.
_SHUT = 2e5


@dataclass(frozen=True, eq=False)
class ElementSeal:
    """A seal whose permeability is constant on each element and varies at random from one to the next.

    The flow is √(upper × lower) of its two bounds, of linear elements and of Raviart-Thomas fluxes: on random maps of
    elements, whose ln k scatters symmetrically, this is within 3 % where the bounds are off by factors.

    mesh : straight triangles or quadrilaterals, of a ring in (ln r, θ). inlet, outlet : its boundary facets.
    size : breadth from inlet to outlet, about, and length along the seal [m].
    outlines : corners of the elements in the plane of the seal (n, corners, 2) [m].
    axes : unit vectors across and along the lay of every element, in the coordinates of the mesh (n, 2, 2).
    boundaries : inlets with pressures of their own, and outlets; None where all inlets have one pressure.
    """

    mesh: Mesh = field(repr=False)
    inlet: Indices = field(repr=False)
    outlet: Indices = field(repr=False)
    size: Pair
    outlines: Array = field(repr=False)
    axes: Array = field(repr=False)
    boundaries: PressureBoundaries | None = field(default=None, repr=False)

    @cached_property
    def _operators(self) -> MeshOperators:
        """The flow from the inlet to the outlet; a drawn seal is solved many times."""
        return MeshOperators(self.mesh, (self.inlet, self.outlet))

    @property
    def length(self) -> float:
        """Length along the seal by which leakage is divided [m]."""
        return self.size[1]

    @property
    def points(self) -> Array:
        """Coordinates of the vertices (n_vertices, 2) [m]."""
        points = np.empty((self.mesh.nvertices, 2))
        points[self.mesh.t.T] = self.outlines
        return points

    def tensors(self, permeability: Any) -> Array:
        """Tensors (n, 2, 2) [m³] in the coordinates of the mesh, from a number or (n, 2) across and along the lay."""
        n = self.mesh.nelements
        principal = permeability_tensors(np.broadcast_to(permeability, (n, 2)), n)
        return np.einsum("nij,nia,njb->nab", principal, self.axes, self.axes)

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> MeshFlow:
        """Flow for a unit drop; permeability (n, 2) [m³], solvers of grids are "auto".

        bounds : solve both; otherwise the flow is that of linear elements, the upper one, with the same potential.
        """
        flow = self._operators.flow(
            self.tensors(permeability), bounds=bounds, solver=_of_meshes(solver)
        )
        if not bounds:
            return flow
        lower = flow.lower if flow.lower > self._through_closed_axes(permeability) else 0.0
        conductance = float(np.sqrt(lower) * np.sqrt(flow.upper))
        return replace(flow, conductance=conductance, lower=lower, percolates=lower > 0)

    def flow_between(
        self,
        permeability: Any,
        boundaries: PressureBoundaries,
        levels: Sequence[float],
        *,
        solver: str = "auto",
    ) -> MeshFlow:
        """Flow between boundaries of given potentials, the outlets at 0 and all inlets on one side of it.

        The outflow is √ of the product of those of linear elements and of Raviart-Thomas fluxes, which with inlets at
        one pressure are the two bounds. The flows through all boundaries are the mean of both solutions, each
        multiplied so that it has this outflow: they balance. Without outflow all are 0.

        Raises InputError: inlets on both sides of the outlet.
        """
        if min(levels) < 0:
            raise InputError(
                "inlet", "pressures above and below that of the outlet", "all on one side of it"
            )
        operators = MeshOperators(self.mesh, boundaries.facets)
        flow = operators.flow(
            self.tensors(permeability), levels, bounds=True, solver=_of_meshes(solver)
        )
        outlets = slice(len(boundaries.pressures), None)
        upper, lower = -float(flow.rates[outlets].sum()), -float(flow.flux_rates[outlets].sum())
        if not (lower > self._through_closed_axes(permeability) * max(levels) and upper > 0):
            return replace(flow, rates=np.zeros_like(flow.rates))
        outflow = np.sqrt(lower) * np.sqrt(upper)
        return replace(flow, rates=0.5 * outflow * (flow.rates / upper + flow.flux_rates / lower))

    def _through_closed_axes(self, permeability: Any) -> float:
        """Flow for a unit drop below which it may go through axes of pieces that are closed [m³]."""
        principal = np.broadcast_to(permeability, (self.mesh.nelements, 2))
        most = principal.max(axis=1)
        half = (most > 0) & (principal.min(axis=1) <= 1e-14 * most)
        typical = float(np.median(most[half])) if half.any() else 0.0
        return _SHUT * CLOSED_AXIS * typical * self.size[1] / self.size[0]


def _of_meshes(solver: str) -> str:
    """The solver, "auto" in place of those of grids."""
    return solver if solver in _SOLVERS else "auto"

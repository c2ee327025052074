"""Compute the Darcy flow through a seal that consists of rows of rectangles with different permeabilities.

The rows of rectangles lie between the inlet and the outlet, and are periodic along x2. The grid of rectangles describes
a strip. In the coordinates (ln r, θ), in which Darcy's law has the same form, the grid also describes a ring. The
principal axes of the permeabilities are x1 and x2. Two solutions enclose the exact flow:

- *corners*: the pressure is continuous, and its values at the corners of the rectangles are the unknowns. Bilinear
  elements, integrated at the midpoints of their edges, have the same energy as linear elements on right triangles. The
  flow through the network of corners is therefore an upper bound.
- *centres*: the flux is continuous, and the pressures at the centres of the rectangles are the unknowns. A link between
  two centres consists of half of each rectangle in series. Its conductance is therefore the harmonic mean of the two
  conductances. The links are equivalent to lowest-order Raviart-Thomas fluxes, integrated at the corners. The flow
  through the network of centres is therefore a lower bound.

The computed flow Q is √(lower bound × upper bound). The network of corners and the network of centres are duals of each
other. If the distribution of ln k is symmetric, the errors of the two networks in ln Q are therefore equal and
opposite. The network of corners and the network of centres are five-point stencils, which the fast solvers (multigrid
and elimination) can solve. The module `flow.mesh` assembles the matrices of both networks with scikit-fem, and also
accepts other permeabilities and meshes. Tests assert that `flow.rectangles` and `flow.mesh` give the same flow.

Sources: Dirichlet's and Thomson's principles; Keller, J. Math. Phys. 5, 1964, 548 (duality); Russell & Wheeler, in
Ewing (ed.), The Mathematics of Reservoir Simulation, SIAM 1983, ch. 2 (quadrature of Raviart-Thomas fluxes).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import ceil

import numpy as np
from skfem import Mesh, MeshQuad
from skfem.mesh import MeshQuad1DG

from ..base import Array, Indices, Shape
from .error_bound import least_conductance
from .grid import Stencil, edge_conductances
from .problem import FIELD_RTOL, DarcyFlow
from .solvers.choice import solve_flow

#: Logger of the meshes of scikit-fem.
_MESH_LOG = logging.getLogger("skfem.mesh.mesh")
#: Fewest columns of a periodic mesh of scikit-fem.
FEWEST_COLUMNS = 3
#: Relative error of the flow.
_RTOL = 1e-8
#: Relative amount by which the bounds are widened to allow for rounding errors in their computation.
_ROUNDING = 1e-13


def _is_worth_logging(record: logging.LogRecord) -> bool:
    """Return whether a log record says more than that scikit-fem copies the numbers of a mesh."""
    return "C_CONTIGUOUS" not in record.getMessage()


@dataclass(frozen=True, eq=False)
class Rectangles:
    """Grid of rectangles between the inlet and the outlet, periodic along x2, with columns of equal width.

    The rectangles are numbered row by row, beginning at the inlet.

    Parameters
    ----------
    lines : array (n1 + 1,), coordinates x1 of the lines between the rows, increasing from the inlet to the outlet.
    period : length of the grid along x2, after which the grid repeats.
    columns : number n2 of columns.
    """

    lines: Array = field(repr=False)
    period: float
    columns: int

    @property
    def shape(self) -> Shape:
        """Numbers of rows and columns."""
        return self.lines.size - 1, self.columns

    def corner_network(self, k1: Array, k2: Array) -> Stencil:
        """Build the network of links between the corners, which gives an upper bound of the flow.

        Parameters
        ----------
        k1, k2 : arrays (n1, n2), permeability along x1 and x2.
        """
        edge1, edge2 = self._edge_conductances(k1, k2)
        # An edge between two corners belongs to two rectangles: an edge along x1 to the rectangles on its left and on
        # its right, and an edge along x2 to the rectangles above and below.
        along = edge1 + np.roll(edge1, 1, axis=1)
        return self._network(along, edge2[:-1] + edge2[1:])

    def centre_network(self, k1: Array, k2: Array) -> Stencil:
        """Build the network of links between the centres of the rectangles, which gives a lower bound of the flow.

        k1, k2 : as in `corner_network`.
        """
        edge1, edge2 = self._edge_conductances(k1, k2)
        # The link from the centre of a rectangle to one of its sides has twice the width and half the length of an
        # edge, so that its conductance is four times as large.
        half1 = 4 * edge1
        half2 = 4 * edge2
        along = np.concatenate([half1[:1], _in_series(half1[:-1], half1[1:]), half1[-1:]])
        return self._network(along, _in_series(half2, np.roll(half2, -1, axis=1)))

    def _edge_conductances(self, k1: Array, k2: Array) -> tuple[Array, Array]:
        """Compute what each rectangle contributes to the conductance of one of its edges along x1, and along x2.

        An edge stands for half of the rectangle.
        """
        along, across = edge_conductances()
        d1 = np.diff(self.lines)[:, None]  # (row, 1)
        d2 = self.period / self.columns
        return along * (d2 / d1) * k1, across * (d1 / d2) * k2

    def _network(self, along: Array, across: Array) -> Stencil:
        """Make a network of links whose columns form a ring."""
        if self.columns == 1:  # the only rectangle of a row is not its own neighbour
            across[:] = 0.0
        return Stencil(along, across)

    def conforming_flow(self, k1: Array, k2: Array, *, solver: str = "auto") -> DarcyFlow:
        """Solve the flow in the network of corners, which corresponds to continuous pressures.

        The conductance is an upper bound of the flow. The potential is equal to the potential that `flow` returns.

        k1, k2, solver : as in `flow`.
        """
        corners = self.corner_network(k1, k2)
        return solve_flow(corners, rtol=_RTOL, solver=solver, field_rtol=FIELD_RTOL)

    def flow(
        self, k1: Array, k2: Array, *, bounds: bool = False, solver: str = "auto"
    ) -> DarcyFlow:
        """Solve the flow for a unit potential drop.

        The flow is solved in the network of corners and in the network of centres. The conductance of each network is
        equal to the energy Σ c (Δφ)² of its potential φ. The network of corners gives an upper bound of the conductance
        of the seal, and the network of centres a lower bound. The two networks are duals of each other, so the errors
        in the logarithms of their conductances are about equal and opposite. The result is therefore the geometric mean
        of the two conductances.

        Parameters
        ----------
        k1, k2 : arrays (n1, n2), permeability along x1 and x2 [m³].
        bounds : also compute the bounds `lower` and `upper`, which hold regardless of the error of the solver.
        solver : "multigrid", "elimination" or "auto".

        Returns
        -------
        DarcyFlow with the potential at the corners of the rectangles, array (n1 + 1, n2). Nothing flows between two
        rectangles that only share a corner.

        Raises
        ------
        NotConverged : the solver failed.
        """
        corners = self.corner_network(k1, k2)
        corner_flow = solve_flow(corners, rtol=_RTOL, solver=solver, field_rtol=FIELD_RTOL)
        upper = corners.energy(np.nan_to_num(corner_flow.potential))
        del corners  # large seals need its memory
        centres = self.centre_network(k1, k2)
        field_rtol = FIELD_RTOL if bounds else None
        centre_flow = solve_flow(centres, rtol=_RTOL, solver=solver, field_rtol=field_rtol)
        value = float(np.sqrt(centre_flow.conductance) * np.sqrt(corner_flow.conductance))
        flow = replace(corner_flow, conductance=value, percolates=centre_flow.percolates)
        if not bounds:
            return flow
        lower = 0.0
        if centre_flow.percolates:
            lower = least_conductance(centres, centre_flow.potential, centre_flow.complement)
        return replace(
            flow,
            lower=min(lower, value) * (1 - _ROUNDING),
            upper=max(upper, value) * (1 + _ROUNDING) if value > 0 else upper,
        )

    def repeated(self) -> tuple[Rectangles, int]:
        """Repeat the grid along x2, so that it has at least the columns that `mesh` needs.

        Returns
        -------
        The grid of all copies, and the number of copies; 1 if the grid has enough columns.
        """
        copies = ceil(FEWEST_COLUMNS / self.columns)
        return Rectangles(self.lines, copies * self.period, copies * self.columns), copies

    @cached_property
    def mesh(self) -> Mesh:
        """Periodic scikit-fem mesh of the rectangles, which needs at least three columns, see `repeated`.

        The first two vertices of an element are the ends of its edge along x1.
        """
        last_line = self._vertex_numbers[:, -1]
        first_line = self._vertex_numbers[:, 0]
        # scikit-fem warns that it copies vertices whenever it makes a mesh of more than 1000 vertices periodic
        _MESH_LOG.addFilter(_is_worth_logging)
        try:
            return MeshQuad1DG.periodic(self.plain_mesh, last_line, first_line)
        finally:
            _MESH_LOG.removeFilter(_is_worth_logging)

    @cached_property
    def plain_mesh(self) -> Mesh:
        """Mesh of the rectangles without periodicity, with separate vertices on the first line and on the last line."""
        lines2 = np.linspace(0.0, self.period, self.columns + 1)
        grid = MeshQuad.init_tensor(self.lines, lines2)
        # scikit-fem begins each element with its edge along x2; in this order it begins with its edge along x1
        return MeshQuad(grid.p, grid.t[[0, 3, 2, 1]])

    @property
    def outlines(self) -> Array:
        """Coordinates of the corners of the rectangles, array (n, 4, 2), anticlockwise."""
        return np.asarray(self.plain_mesh.p.T[self.plain_mesh.t.T])

    @property
    def _vertex_numbers(self) -> Indices:
        """Numbers of the vertices of `plain_mesh`, array (n1 + 1, n2 + 1)."""
        return np.arange(self.plain_mesh.nvertices).reshape(self.lines.size, -1)

    @cached_property
    def vertices(self) -> Indices:
        """Numbers of the vertices of the periodic mesh, array (n1 + 1, n2)."""
        # vertices at both ends of the edge along x1 with which each element begins, arrays (row, column)
        towards_inlet, towards_outlet = self.mesh.t[:2].reshape(2, *self.shape)
        return np.concatenate([towards_inlet, towards_outlet[-1:]])

    @cached_property
    def ends(self) -> tuple[Indices, Indices]:
        """Boundary facets of the periodic mesh at the inlet and at the outlet."""
        facets = self.mesh.boundary_facets()
        is_at_inlet = np.isin(self.mesh.facets[0, facets], self.vertices[0])
        return facets[is_at_inlet], facets[~is_at_inlet]


def _in_series(first: Array, second: Array) -> Array:
    """Compute the conductance of two links in series; 0 where one of the links is closed."""
    smaller = np.minimum(first, second)
    larger = np.maximum(first, second)
    total = smaller + larger
    return smaller * np.divide(larger, total, out=np.zeros_like(total), where=total > 0)

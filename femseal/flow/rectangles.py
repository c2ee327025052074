"""The flow over rows of rectangles, each of its own permeability, between an inlet row and an outlet row.

A strip is such a field, periodic along x2. A ring is the same in (ln r, θ), in which the form of Darcy's law is that of
a strip. Two solutions enclose the flow of rectangles with principal axes along x1 and x2:

- *corners*: continuous pressures, known at the corners of the rectangles. Bilinear elements, integrated at the
  midpoints of their edges, have the energy of linear elements on right triangles. Their flow is an upper bound.
- *centres*: continuous fluxes. Half a rectangle conducts from its centre to the middle of each side, so that links
  between two centres have harmonic means. Their flow is a lower bound; it is that of lowest-order Raviart-Thomas
  fluxes, integrated at the corners.

The value is √(lower × upper). The two networks are duals of each other, so that their errors in ln Q are equal and
opposite on maps whose ln k scatters symmetrically. Both have five points, which multigrid and elimination solve: this
is the fast path of a seal. The plain path assembles the same two systems by scikit-fem on the mesh (`flow.mesh`), and
takes all other permeabilities; tests assert that both have the same flow.

Sources: Dirichlet's and Thomson's principles; Keller, J. Math. Phys. 5, 1964, 548 (duality); Russell & Wheeler, in
Ewing (ed.), The Mathematics of Reservoir Simulation, SIAM 1983, ch. 2 (quadrature of Raviart-Thomas fluxes).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from skfem import Mesh, MeshQuad
from skfem.mesh import MeshQuad1DG

from ..base import Array, Indices, Shape
from .error_bound import energy_gap
from .grid import Stencil, edge_conductances
from .problem import FIELD_RTOL, DarcyFlow
from .solvers.choice import solve_flow

# scikit-fem warns that it copies vertices whenever it makes a mesh of more than 1000 vertices periodic
logging.getLogger("skfem.mesh.mesh").addFilter(
    lambda record: "C_CONTIGUOUS" not in record.getMessage()
)

#: Fewest columns of a periodic mesh of scikit-fem.
FEWEST_COLUMNS = 3
#: Relative error of the flow.
_RTOL = 1e-8
#: Fraction by which bounds are moved apart, for the rounding errors of their own sums.
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class Rectangles:
    """Rectangles in rows from the inlet to the outlet and in equal columns, periodic along x2.

    They are numbered row by row, from the inlet on.

    Parameters
    ----------
    lines : array (n1 + 1,), x1 of the lines between the rows, increasing from the inlet to the outlet.
    period : length along x2.
    columns : number n2 of columns.
    """

    lines: Array = field(repr=False)
    period: float
    columns: int

    @property
    def shape(self) -> Shape:
        """Numbers of rows and columns."""
        return self.lines.size - 1, self.columns

    def networks(self, k1: Array, k2: Array) -> tuple[Stencil, Stencil]:
        """Return the networks between the corners and between the centres of the rectangles.

        Parameters
        ----------
        k1, k2 : arrays (n1, n2), permeability along x1 and x2.
        """
        along, across = edge_conductances()
        d1 = np.diff(self.lines)[:, None]  # (row, 1)
        d2 = self.period / self.columns
        # an edge between two corners has a rectangle on either side
        edge1 = along * (d2 / d1) * k1
        edge2 = across * (d1 / d2) * k2
        corners = Stencil(edge1 + np.roll(edge1, 1, axis=1), edge2[:-1] + edge2[1:])
        # half a rectangle, from its centre to a side, is as broad as two edges and half as long
        half1 = 4 * edge1
        half2 = 4 * edge2
        between_rows = [half1[:1], _in_series(half1[:-1], half1[1:]), half1[-1:]]
        centres = Stencil(
            np.concatenate(between_rows), _in_series(half2, np.roll(half2, -1, axis=1))
        )
        if self.columns == 1:  # the only rectangle of a row is not its own neighbour
            corners.across[:] = 0.0
            centres.across[:] = 0.0
        return corners, centres

    def flow(
        self, k1: Array, k2: Array, *, bounds: bool = False, solver: str = "auto"
    ) -> DarcyFlow:
        """Solve the flow for a unit drop.

        Parameters
        ----------
        k1, k2 : arrays (n1, n2), permeability along x1 and x2 [m³].
        bounds : also enclose the value between `lower` and `upper`, whatever the error of the solver.
        solver : "multigrid", "elimination" or "auto".

        Returns
        -------
        DarcyFlow with the potential at the corners, array (n1 + 1, n2). Rectangles that share a corner alone are not
        connected.

        Raises
        ------
        NotConverged : the solver failed.
        """
        corners, centres = self.networks(k1, k2)
        above = solve_flow(corners, rtol=_RTOL, solver=solver, field_rtol=FIELD_RTOL)
        upper = corners.energy(np.nan_to_num(above.potential))
        del corners
        field_rtol = FIELD_RTOL if bounds else None
        below = solve_flow(centres, rtol=_RTOL, solver=solver, field_rtol=field_rtol)
        value = float(np.sqrt(below.conductance) * np.sqrt(above.conductance))
        flow = replace(above, conductance=value, percolates=below.percolates)
        if not bounds:
            return flow
        lower = 0.0
        if below.percolates:
            pressure = np.nan_to_num(below.potential)
            balanced = 1 - energy_gap(centres, pressure, 1 - pressure)
            lower = max(0.0, centres.energy(pressure) * balanced)
        return replace(
            flow,
            lower=min(lower, value) * (1 - _ROUNDING),
            upper=max(upper, value) * (1 + _ROUNDING) if value > 0 else upper,
        )

    @cached_property
    def mesh(self) -> Mesh:
        """The rectangles as a periodic mesh of scikit-fem, whose elements begin with their edge along x1.

        It needs three columns or more.
        """
        return MeshQuad1DG.periodic(self.plain_mesh, self._numbers[:, -1], self._numbers[:, 0])

    @cached_property
    def plain_mesh(self) -> Mesh:
        """The rectangles as a mesh whose last line of vertices is not joined to the first one."""
        lines2 = np.linspace(0.0, self.period, self.columns + 1)
        grid = MeshQuad.init_tensor(self.lines, lines2)
        return MeshQuad(grid.p, grid.t[[0, 3, 2, 1]])

    @property
    def outlines(self) -> Array:
        """Corners of the rectangles (n, 4, 2), anticlockwise."""
        return np.asarray(self.plain_mesh.p.T[self.plain_mesh.t.T])

    @property
    def _numbers(self) -> Indices:
        """Numbers of the vertices of the plain mesh (n1 + 1, n2 + 1)."""
        return np.arange(self.plain_mesh.nvertices).reshape(self.lines.size, -1)

    @cached_property
    def vertices(self) -> Indices:
        """Numbers of the vertices of the periodic mesh, array (n1 + 1, n2)."""
        first, second = self.mesh.t[:2].reshape(2, *self.shape)
        return np.concatenate([first, second[-1:]])

    @cached_property
    def ends(self) -> tuple[Indices, Indices]:
        """Boundary facets of the periodic mesh at the inlet and at the outlet."""
        facets = self.mesh.boundary_facets()
        is_at_inlet = np.isin(self.mesh.facets[0, facets], self.vertices[0])
        return facets[is_at_inlet], facets[~is_at_inlet]


def _in_series(first: Array, second: Array) -> Array:
    """Return the conductance of two links in series; 0 where one of them is closed."""
    smaller = np.minimum(first, second)
    larger = np.maximum(first, second)
    both = smaller + larger
    return smaller * np.divide(larger, both, out=np.zeros_like(both), where=both > 0)

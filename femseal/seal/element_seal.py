"""Define a seal whose permeability varies at random between its elements, on a mesh or on rectangles."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from skfem import Mesh

from ..base import Array, Indices, Pair
from ..flow.mesh import MeshOperators
from ..flow.mesh_input import CLOSED_AXIS, permeability_tensors, principal_values
from ..flow.problem import MESH_SOLVERS, SOLVERS, SPARSE_SOLVERS, DarcyFlow, check_solver
from ..flow.rectangles import Rectangles
from .on_mesh import SealOnMesh

#: An element that is closed along one axis gets a small permeability along this axis, `CLOSED_AXIS` times the
#: permeability along the other axis, so that the tensor is invertible. In tests with square seals, the flow through a
#: closed seal with such small permeabilities was 0.002 to 7e3 times the median of the small permeabilities. The flow
#: through an open seal was at least 7e6 times this median. A flow below the following multiple of the median counts as
#: 0.
_CLOSED_BELOW = 2e5
#: Components of unit vectors below this limit are rounding errors.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class ElementSeal(SealOnMesh):
    """Define a seal with a constant permeability on each element, which varies at random between elements.

    The flow is computed as the geometric mean of two bounds: an upper bound from elements with continuous pressures,
    and a lower bound from elements with continuous fluxes. In tests with random permeabilities whose logarithm is
    symmetrically distributed, the error of the geometric mean was at most 3 %, even if the upper bound was several
    times the lower bound.

    Attributes
    ----------
    mesh : Mesh
        Mesh of linear triangles or quadrilaterals. The coordinates of the mesh of a ring are (|ln r/r₀|, θ), see
        `Ring`.
    inlet, outlet : arrays of int
        Boundary facets of the mesh.
    size : tuple of two float
        Approximate width from inlet to outlet, and length along the seal [m].
    outlines : array, (n, corners, 2)
        Corners of the elements in the plane of the seal [m].
    axes : array, (n, 2, 2)
        Unit vectors across and along the lay of each element, in the coordinates of the mesh.
    rectangles : Rectangles or None
        Rectangular elements of a strip or a ring, for which a fast solver is available; None for other meshes.
    """

    mesh: Mesh = field(repr=False)
    inlet: Indices = field(repr=False)
    outlet: Indices = field(repr=False)
    size: Pair
    outlines: Array = field(repr=False)
    axes: Array = field(repr=False)
    rectangles: Rectangles | None = field(default=None, repr=False)

    @cached_property
    def _rounded_axes(self) -> Array:
        """The array `axes`, with 0 for rounding errors, so that a lay along an edge has a diagonal tensor."""
        return np.where(np.abs(self.axes) <= _ROUNDING, 0.0, self.axes)

    @cached_property
    def _operators(self) -> MeshOperators:
        """Element matrices, which are stored because the flow is computed for many permeabilities."""
        return MeshOperators(self.mesh, (self.inlet, self.outlet))

    @property
    def length(self) -> float:
        """Length of the seal [m], by which the leakage is divided to obtain the leakage per length."""
        return self.size[1]

    @property
    def points(self) -> Array:
        """Coordinates of the vertices (n_vertices, 2) [m]."""
        points = np.empty((self.mesh.nvertices, 2))
        points[self.mesh.t.T] = self.outlines
        return points

    def tensors(self, permeability: Any) -> Array:
        """Transform permeabilities, given across and along the lay, to tensors in the coordinates of the mesh.

        Parameters
        ----------
        permeability : float or array, (n,), (n, 2) or (n, 2, 2)
            Permeability of the n elements [m³] in one of four forms: the same number for all elements; a number for
            each element; for each element, the permeability across the lay and the permeability along the lay; or a
            tensor for each element, whose axes are across and along the lay.

        Returns
        -------
        array, (n, 2, 2)
            Permeability tensors in the coordinates of the mesh [m³].
        """
        n = self.mesh.nelements
        if np.ndim(permeability) == 1:
            permeability = np.asarray(permeability)[:, None]
        if np.ndim(permeability) < 3:
            permeability = np.broadcast_to(permeability, (n, 2))
        principal = permeability_tensors(permeability, n)
        axes = self._rounded_axes
        # K_ab = Σ_ij P_ij e_ia e_jb for each element n, with the tensor P across (i, j = 0) and along (1) the lay, the
        # unit vectors e_0 and e_1 across and along the lay, and the mesh coordinates a and b
        return np.asarray(np.einsum("nij,nia,njb->nab", principal, axes, axes))

    @cached_property
    def solvers(self) -> tuple[str, ...]:
        """Solvers that `flow` accepts: all for rectangles with edges parallel to the lay, else those for meshes."""
        lay_is_along_edges = not (self._rounded_axes[..., 0] * self._rounded_axes[..., 1]).any()
        return SOLVERS if self.rectangles is not None and lay_is_along_edges else MESH_SOLVERS

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Compute the flow for a potential of 1 at the inlet and 0 at the outlet.

        The flow is the geometric mean of the upper bound and the lower bound.

        Parameters
        ----------
        permeability : float or array, (n,), (n, 2) or (n, 2, 2)
            Permeability of the n elements [m³], in one of the forms that the method `tensors` accepts.
        bounds : bool
            Whether to return a lower and an upper bound of the flow as well.
        solver : str
            "multigrid" or "elimination" for rectangles whose lay is parallel to their edges, "amg" or "direct" on the
            mesh, or "auto".

        Returns
        -------
        DarcyFlow
            Flow with the potential at the vertices of the mesh.
        """
        tensors = self.tensors(permeability)
        if self._is_network(tensors, solver):
            assert self.rectangles is not None
            k1, k2 = self._on_rectangles(tensors)
            return self._at_vertices(self.rectangles.flow(k1, k2, bounds=bounds, solver=solver))
        flow = self._operators.flow(tensors, bounds=True, solver=solver)
        is_open = flow.lower > self._largest_flow_if_closed(tensors)
        lower = flow.lower if is_open else 0.0
        conductance = float(np.sqrt(lower) * np.sqrt(flow.upper))  # geometric mean of both bounds
        return replace(
            flow,
            conductance=conductance,
            percolates=lower > 0,
            lower=lower if bounds else np.nan,
            upper=flow.upper if bounds else np.nan,
        )

    def conforming_flow(self, permeability: Any, *, solver: str = "auto") -> DarcyFlow:
        """Compute the flow with continuous pressures, which is an upper bound of the flow.

        The potential is equal to the potential that `flow` returns, but less work is needed.

        permeability, solver : as in `flow`.
        """
        tensors = self.tensors(permeability)
        if self._is_network(tensors, solver):
            assert self.rectangles is not None
            k1, k2 = self._on_rectangles(tensors)
            return self._at_vertices(self.rectangles.conforming_flow(k1, k2, solver=solver))
        return self._operators.flow(tensors, solver=solver)

    def _is_network(self, tensors: Array, solver: str) -> bool:
        """Check the solver, and return whether the flow is solved by the fast solvers for rectangles.

        tensors : array (n, 2, 2), permeability in the coordinates of the mesh.
        """
        # whether principal axes are not parallel to the coordinate axes of the mesh
        is_oblique = bool(tensors[:, 0, 1].any())
        check_solver(solver, MESH_SOLVERS if is_oblique else self.solvers)
        needs_mesh = solver in SPARSE_SOLVERS or is_oblique
        return self.rectangles is not None and not needs_mesh

    def _on_rectangles(self, tensors: Array) -> tuple[Array, Array]:
        """Return the permeabilities (rows, columns) along the two axes of the rectangles."""
        assert self.rectangles is not None
        k1, k2 = (tensors[:, a, a].reshape(self.rectangles.shape) for a in (0, 1))
        return k1, k2

    def _at_vertices(self, flow: DarcyFlow) -> DarcyFlow:
        """Bring the potential of a flow over rectangles into the order of the vertices of the mesh."""
        assert self.rectangles is not None
        potential, complement = np.empty((2, self.mesh.nvertices))
        potential[self.rectangles.vertices] = flow.potential
        complement[self.rectangles.vertices] = flow.complement
        return replace(flow, potential=potential, complement=complement)

    def _largest_flow_if_closed(self, tensors: Array) -> float:
        """Return the limit of the computed flow [m³] below which the seal counts as closed.

        An element that is closed along an axis gets a small permeability along this axis, see `_CLOSED_BELOW`. The
        computed flow through a closed seal is therefore not exactly 0, but it is smaller than the returned limit.

        tensors : array (n, 2, 2), permeability in the coordinates of the mesh.
        """
        smaller, larger = principal_values(tensors)
        # elements that are closed along one of their axes, apart from rounding errors
        is_half_closed = (larger > 0) & (smaller <= 1e-14 * larger)
        if not is_half_closed.any():
            return 0.0
        typical = float(np.median(larger[is_half_closed]))
        # For a potential of 1 at the inlet and 0 at the outlet, the flow through a seal with uniform permeability k is
        # k · length / breadth. Here k is the small permeability along closed axes, CLOSED_AXIS · typical.
        breadth, length = self.size
        return _CLOSED_BELOW * CLOSED_AXIS * typical * length / breadth

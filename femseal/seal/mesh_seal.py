"""Define seals on meshes: `MeshSeal` has any plan shape, `ElementSeal` has a random permeability in each element.

A mesh is checked for overlapping elements. Elements that are not neighbours may overlap as well, for example where two
separate parts of the mesh lie on top of each other. If no element overlaps its neighbours but two elements overlap, at
least one of these two is at the boundary of the mesh.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from os import PathLike
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from skfem import Mesh, MeshQuad1, MeshTri1

from ..base import Array, Indices, InputError, Pair, to_si, to_text
from ..flow.mesh import MeshOperators
from ..flow.mesh_input import CLOSED_AXIS, is_connected, permeability_tensors, principal_values
from ..flow.problem import (
    LINEAR,
    MESH_SOLVERS,
    SOLVERS,
    SPARSE_SOLVERS,
    DarcyFlow,
    check_solver,
)
from ..flow.rectangles import Rectangles
from .input_checks import check_inlet
from .plane import polygon_areas
from .seal_files import NAME_BOUNDARIES, read_mesh

#: Names of boundaries, one or several.
Names = str | Sequence[str]
#: An element that is closed along one axis gets a small permeability along this axis, `CLOSED_AXIS` times the
#: permeability along the other axis, so that the tensor is invertible. In tests with square seals, the flow through a
#: closed seal with such small permeabilities was 0.002 to 7e3 times the median of the small permeabilities. The flow
#: through an open seal was at least 7e6 times this median. A flow below the following multiple of the median counts as
#: 0.
_CLOSED_BELOW = 2e5
#: Allowed overlap of two elements, as a fraction of the extent of the smaller element. The overlap can be positive
#: because of rounded coordinates, and because straight edges approximate arcs.
_ALLOWED_OVERLAP = 0.1
#: Components of unit vectors below this limit are rounding errors.
_ROUNDING = 1e-12


def _first_overlap(mesh: Mesh) -> tuple[int, ...]:
    """Find an element at the boundary of the mesh that overlaps another element.

    Overlaps are found by the separating axis theorem: two convex polygons do not overlap if their projections on the
    normal of an edge do not overlap.

    Parameters
    ----------
    mesh : Mesh
        Triangles or quadrilaterals, which are not tangled and do not overlap their neighbours.

    Returns
    -------
    tuple of int
        Indices of the two overlapping elements; empty if no elements overlap.
    """
    corners = mesh.p.T[mesh.t.T]  # (element, corner, 2)
    x_min, y_min = corners.min(axis=1).T
    x_max, y_max = corners.max(axis=1).T
    edges = np.roll(corners, -1, axis=1) - corners
    normals = np.stack([edges[..., 1], -edges[..., 0]], axis=-1)
    boundary_elements = np.unique(mesh.f2t[0, mesh.boundary_facets()])
    for i in boundary_elements.tolist():
        # only elements whose bounding box overlaps the bounding box of element i are compared with element i
        boxes_meet = (x_min < x_max[i]) & (x_max > x_min[i])
        boxes_meet &= (y_min < y_max[i]) & (y_max > y_min[i])
        for j in np.flatnonzero(boxes_meet).tolist():
            if i == j:
                continue
            axes = np.concatenate([normals[i], normals[j]])
            # projections of the corners on the axes, (corner, axis)
            projection_i = corners[i] @ axes.T
            projection_j = corners[j] @ axes.T
            start = np.maximum(projection_i.min(axis=0), projection_j.min(axis=0))
            end = np.minimum(projection_i.max(axis=0), projection_j.max(axis=0))
            smaller_extent = np.minimum(np.ptp(projection_i, axis=0), np.ptp(projection_j, axis=0))
            if (end - start > _ALLOWED_OVERLAP * smaller_extent).all():
                return i, j
    return ()


@dataclass(frozen=True)
class MeshSeal:
    """Define a seal of any plan shape by a mesh of linear triangles or quadrilaterals.

    The flow is computed with continuous pressures (conforming elements). Its error decreases with the square of the
    element size, and it is equal to the upper bound of the flow.

    Parameters
    ----------
    path : str, PathLike or Mesh
        File with a plane mesh (constant z) that meshio can read, or a scikit-fem mesh with named `boundaries` and
        coordinates in metres.
    inlet, outlet : str or sequence of str
        Names of the boundaries that form the inlet and the outlet, which must not touch each other. All other
        boundaries are closed.
    unit : str
        Unit of the coordinates in the file, such as "mm".

    Raises
    ------
    InputError
        The file is missing or is not a mesh; the mesh has no boundary with a given name; inlet and outlet touch each
        other, or the mesh does not connect inlet and outlet; or elements are degenerate, tangled or overlapping.
    """

    path: str | PathLike[str] | Mesh = field(repr=False)
    inlet: Names
    outlet: Names
    unit: str = field(default="m", repr=False)
    mesh: Mesh = field(init=False, repr=False, compare=False)

    #: Solvers that `flow` accepts.
    solvers: ClassVar[tuple[str, ...]] = MESH_SOLVERS

    def __post_init__(self) -> None:
        check_inlet(self.inlet)
        mesh = self.path
        if not isinstance(mesh, Mesh):
            mesh = read_mesh(mesh, to_si(f"1 {self.unit}", "m", "unit"))
        object.__setattr__(self, "mesh", mesh)
        if type(mesh) not in (MeshTri1, MeshQuad1):
            expected = f"a plane mesh of triangles or quadrilaterals, {LINEAR}"
            raise InputError("path", f"a {type(mesh).__name__}", expected)
        _check_boundary_names(mesh, "inlet", self.inlet)
        _check_boundary_names(mesh, "outlet", self.outlet)
        _check_elements(mesh)
        if not is_connected(mesh, *self.ends):
            raise InputError(
                "inlet and outlet",
                "boundaries that the mesh does not connect",
                "a mesh in one piece",
            )

    @property
    def ends(self) -> tuple[Indices, Indices]:
        """Boundary facets of inlet and outlet."""
        inlet, outlet = (
            np.unique(np.concatenate([self.mesh.boundaries[name] for name in _names(names)]))
            for names in (self.inlet, self.outlet)
        )
        return inlet, outlet

    @property
    def length(self) -> float:
        """Length of the outlet [m]."""
        _, outlet = self.ends
        # coordinates of the two ends of each facet, (axis, facet) each
        start, end = np.moveaxis(self.mesh.p[:, self.mesh.facets[:, outlet]], 1, 0)
        return float(np.hypot(*(end - start)).sum())

    @property
    def area(self) -> float:
        """Area of the seal [m²]."""
        return float(np.abs(polygon_areas(self.points[self.mesh.t.T])).sum())

    @property
    def points(self) -> Array:
        """Coordinates of the vertices (n_vertices, 2) [m]."""
        return np.ascontiguousarray(self.mesh.p.T)

    @property
    def element_shapes(self) -> tuple[tuple[int, ...], ...]:
        """Allowed shapes of a permeability array that does not contain tensors."""
        return (self.mesh.nelements,), (self.mesh.nelements, 2)

    def corner_values(self, values: Array) -> Array:
        """Return values at the corners of each element (n, corners) from values at the vertices (n_vertices,)."""
        return np.asarray(values[self.mesh.t.T])

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Compute the flow for a potential of 1 at the inlet and 0 at the outlet.

        Parameters
        ----------
        permeability : float or array, (n,), (n, 2) or (n, 2, 2)
            Permeability of the n elements [m³]: a number, a number for each element, values along x and y, or tensors.
        bounds : bool
            Whether to compute bounds of the flow as well.
        solver : str
            "amg", "direct" or "auto".

        Returns
        -------
        DarcyFlow
            Flow with the potential at the vertices of the mesh. The conductance is equal to the upper bound.
        """
        check_solver(solver, self.solvers)
        tensor = permeability_tensors(permeability, self.mesh.nelements)
        return MeshOperators(self.mesh, self.ends).flow(tensor, bounds=bounds, solver=solver)

    def conforming_flow(self, permeability: Any, *, solver: str = "auto") -> DarcyFlow:
        """Compute the flow without bounds, see `flow`."""
        return self.flow(permeability, solver=solver)


def parts_without_flow(mesh: Mesh, inlet: Indices, outlet: Indices) -> Iterator[str]:
    """Yield a warning for each part of a mesh that does not connect the inlet with the outlet.

    Parameters
    ----------
    mesh : Mesh
        Mesh of linear elements, with coordinates in metres.
    inlet, outlet : arrays of int
        Facets of the inlet and of the outlet.
    """
    corners = mesh.t  # (corner, element)
    part = _connected_parts(mesh, corners)
    inlet_parts = np.unique(part[mesh.facets[:, inlet]])
    outlet_parts = np.unique(part[mesh.facets[:, outlet]])
    element_part = part[corners[0]]  # all corners of an element belong to the same part
    area = np.abs(polygon_areas(mesh.p.T[corners.T]))
    for number in np.setdiff1d(element_part, np.intersect1d(inlet_parts, outlet_parts)):
        is_inside = element_part == number
        if number in outlet_parts:
            missing = "no inlet"
        elif number in inlet_parts:
            missing = "no outlet"
        else:
            missing = "neither inlet nor outlet"
        share = f"{area[is_inside].sum() * 1e6:.3g} of {area.sum() * 1e6:.3g} mm²"
        yield (
            f"a part of the mesh around {_centre_text(mesh, corners[:, is_inside])}, {share}, "
            f"touches {missing}: nothing flows there"
        )


def boundaries_without_name(mesh: Mesh) -> Iterator[str]:
    """Yield a warning for each connected part of the boundary, such as the rim of a hole, that has no name.

    Parameters
    ----------
    mesh : Mesh
        Mesh of linear elements, with coordinates in metres.
    """
    named = [np.asarray(facets) for facets in (mesh.boundaries or {}).values()]
    unnamed = np.setdiff1d(mesh.boundary_facets(), np.concatenate([*named, []]))
    ends = mesh.facets[:, unnamed]  # vertices at the two ends, (2, facet)
    part = _connected_parts(mesh, ends)[ends[0]]  # number of the line to which each facet belongs
    length = np.hypot(*(mesh.p[:, ends[1]] - mesh.p[:, ends[0]]))
    for number in np.unique(part):
        is_in_part = part == number
        yield (
            f"a boundary of the mesh around {_centre_text(mesh, ends[:, is_in_part])}, "
            f"{to_text(float(length[is_in_part].sum()), 'm', 3)} long, is in no group: it is closed"
        )


def _connected_parts(mesh: Mesh, corners: Indices) -> Indices:
    """Number the connected parts of a mesh, and return the number of the part to which each vertex belongs.

    corners : indices of the vertices of n elements or facets with k corners each (k, n). All corners of an element or
    facet count as connected with each other.
    """
    # links from the first corner to the other corners are sufficient
    starts = np.tile(corners[0], len(corners) - 1)
    ends = corners[1:].ravel()
    shape = (mesh.nvertices, mesh.nvertices)
    links = coo_array((np.ones(starts.size), (starts, ends)), shape=shape)
    _, part = connected_components(links, directed=False)
    return part


def _centre_text(mesh: Mesh, corners: Indices) -> str:
    """Return the mean position of the given vertices as text, for a message."""
    x, y = (to_text(float(c[corners].mean()), "m", 3) for c in mesh.p)
    return f"({x}, {y})"


def _check_boundary_names(mesh: Mesh, role: str, names: Names) -> None:
    """Raise InputError if the mesh has no boundary with a given name. `role` is "inlet" or "outlet"."""
    boundaries = mesh.boundaries or {}
    for name in _names(names) or (names,):
        if name in boundaries:
            continue
        present = ", ".join(repr(str(present)) for present in boundaries) or "none"
        expected = f"the name of a boundary of the mesh: {present}"
        if set(boundaries) <= {"0"}:  # edges without a name have the number 0
            expected += f"; {NAME_BOUNDARIES}"
        raise InputError(role, repr(name), expected)


def _check_elements(mesh: Mesh) -> None:
    """Raise InputError if nodes are not finite, or if elements are degenerate, tangled or overlapping."""
    _check_element_shapes(mesh)
    overlapping = _overlapping_neighbours(mesh) or _first_overlap(mesh)
    if overlapping:
        given = f"a mesh whose elements {' and '.join(map(str, overlapping))} overlap"
        raise InputError("path", given, "elements that do not overlap")


def _check_element_shapes(mesh: Mesh) -> None:
    """Raise InputError if nodes are not finite, or if elements are degenerate or tangled."""
    undefined = np.flatnonzero(~np.isfinite(mesh.p).all(axis=0))
    if undefined.size:
        raise InputError(
            "path",
            f"a mesh whose node {undefined[0]} has no finite coordinates",
            "finite coordinates",
        )
    corners = mesh.p.T[mesh.t.T]  # (element, corner, 2)
    to_previous = np.roll(corners, 1, axis=1) - corners
    to_next = np.roll(corners, -1, axis=1) - corners
    # the Jacobian of a bilinear element has its extremes at the corners; if it changes sign, the element is tangled
    det = to_next[..., 0] * to_previous[..., 1] - to_next[..., 1] * to_previous[..., 0]
    size = np.ptp(corners, axis=1).max(axis=1) ** 2
    is_flat = np.abs(det).min(axis=1) <= 1e-12 * size
    is_tangled = det.min(axis=1) * det.max(axis=1) <= 0
    bad = np.flatnonzero(is_flat | is_tangled)
    if bad.size:
        given = f"a mesh whose element {bad[0]} is degenerate or tangled"
        raise InputError("path", given, "a valid mesh")


def _overlapping_neighbours(mesh: Mesh) -> tuple[int, ...]:
    """Return the indices of the first two elements that overlap a neighbour; empty if no neighbours overlap.

    Neighbours overlap if both traverse their common edge in the same direction when their boundaries are followed
    anticlockwise. Elements also overlap if more than two of them share an edge.
    """
    vertices, edge = mesh.t.T, mesh.t2f.T  # (element, corner)
    # direction of each edge: 1 if the number of its second vertex is larger, −1 if it is smaller
    direction = np.sign(np.roll(vertices, -1, axis=1) - vertices)
    # the area is negative if the corners are in clockwise order; the direction is then reversed
    areas = polygon_areas(mesh.p.T[vertices])
    direction *= np.sign(areas)[:, None].astype(int)
    # number of elements at each edge, and sum of their directions, which is 0 for opposite directions
    element_count = np.bincount(edge.ravel())
    direction_sum = np.bincount(edge.ravel(), direction.ravel())
    has_overlap = (element_count > 2) | ((element_count == 2) & (direction_sum != 0))
    overlapping = np.flatnonzero(has_overlap[edge].any(axis=1))
    return tuple(overlapping[:2])


def _names(given: Names) -> tuple[str, ...]:
    """Convert a name or a sequence of names to a tuple of names."""
    return (given,) if isinstance(given, str) else tuple(given)


@dataclass(frozen=True, eq=False)
class ElementSeal:
    """Define a seal with a constant permeability on each element, which varies at random between elements.

    The flow is computed as the geometric mean of two bounds: an upper bound from elements with continuous pressures,
    and a lower bound from elements with continuous fluxes. In tests with random permeabilities whose logarithm is
    symmetrically distributed, the error of the geometric mean was at most 3 %, even if the upper bound was several
    times the lower bound.

    Attributes
    ----------
    mesh : Mesh
        Mesh of linear triangles or quadrilaterals. The coordinates of the mesh of a ring are (ln r, θ).
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

    @property
    def element_shapes(self) -> tuple[tuple[int, ...], ...]:
        """Allowed shapes of a permeability array that does not contain tensors."""
        return (self.mesh.nelements,), (self.mesh.nelements, 2)

    def corner_values(self, values: Array) -> Array:
        """Return values at the corners of each element (n, corners) from values at the vertices (n_vertices,)."""
        return np.asarray(values[self.mesh.t.T])

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
        """Solvers that `flow` accepts: on rectangles whose edges are parallel to the lay all solvers."""
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
            Whether to return a lower and an upper bound of the flow, too.
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

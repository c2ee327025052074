"""Seals on meshes: of any plan shape, and of elements that take random cells.

A mesh may cover a place twice although no element lies on its neighbour, such as two parts on each other: an element
at the outline of one then lies on one of the other.
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
from ..flow.problem import LINEAR, PLAIN_SOLVERS, DarcyFlow, check_solver
from ..flow.rectangles import Rectangles
from .lay import check_inlet
from .plane import polygon_areas
from .seal_files import NAME_BOUNDARIES, read_mesh

#: Names of boundaries, one or several.
Names = str | Sequence[str]
#: A cell closed along one axis keeps `CLOSED_AXIS` of its other permeability there. A seal that only this opens
#: has measured 0.002 to 7e3 of that median in squares, an open one 7e6 and more: below this many it counts as closed.
_SHUT = 2e5
#: Part of the extent of the smaller element to which parts that touch may lie on each other: coordinates are rounded,
#: and edges are chords of arcs.
_DEPTH = 0.1
#: Components of unit vectors below this are rounding errors.
_ROUNDING = 1e-12


def first_overlap(mesh: Mesh) -> tuple[int, ...]:
    """Two elements that lie on each other, one of them at an outline; empty without any.

    mesh : triangles or quadrilaterals, none of which is tangled or lies on its neighbour. Convex polygons are apart
    where their extents along the normal of an edge are (separating axis).
    """
    corners = mesh.p.T[mesh.t.T]
    (x0, y0), (x1, y1) = corners.min(axis=1).T, corners.max(axis=1).T
    along = np.roll(corners, -1, axis=1) - corners
    normals = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    for one in np.unique(mesh.f2t[0, mesh.boundary_facets()]).tolist():
        near = (x0 < x1[one]) & (x1 > x0[one]) & (y0 < y1[one]) & (y1 > y0[one])
        for other in np.flatnonzero(near).tolist():
            axes = np.concatenate([normals[one], normals[other]])
            a = corners[one] @ axes.T
            b = corners[other] @ axes.T
            least = np.maximum(a.min(axis=0), b.min(axis=0))
            most = np.minimum(a.max(axis=0), b.max(axis=0))
            smaller = np.minimum(np.ptp(a, axis=0), np.ptp(b, axis=0))
            if other != one and (most - least > _DEPTH * smaller).all():
                return one, other
    return ()


@dataclass(frozen=True)
class MeshSeal:
    """A seal of any plan shape, meshed with linear triangles or quadrilaterals.

    Parameters
    ----------
    path : a mesh file that meshio reads (plane, z constant), or a scikit-fem mesh with named `boundaries`, in metres.
    inlet, outlet : names of boundaries, one or several each; those of the inlet do not touch those of the outlet. All
        other boundaries are closed.
    unit : of the lengths in the file, such as "mm".

    Raises
    ------
    InputError : the file is missing or not a mesh, no boundary of that name (the message lists those there
        are), inlet and outlet touch or are not connected by the mesh, elements that are degenerate or tangled.
    """

    path: str | PathLike[str] | Mesh = field(repr=False)
    inlet: Names
    outlet: Names
    unit: str = field(default="m", repr=False)
    mesh: Mesh = field(init=False, repr=False, compare=False)

    value_needs_bounds: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_inlet(self.inlet)
        mesh = (
            self.path
            if isinstance(self.path, Mesh)
            else read_mesh(self.path, to_si(f"1 {self.unit}", "m", "unit"))
        )
        object.__setattr__(self, "mesh", mesh)
        if type(mesh) not in (MeshTri1, MeshQuad1):
            expected = f"a plane mesh of triangles or quadrilaterals, {LINEAR}"
            raise InputError("path", f"a {type(mesh).__name__}", expected)
        there = ", ".join(repr(str(name)) for name in mesh.boundaries or {}) or "none"
        for role, names in (("inlet", self.inlet), ("outlet", self.outlet)):
            for name in _names(names) or (names,):
                if name not in (mesh.boundaries or {}):
                    expected = f"the name of a boundary of the mesh: {there}"
                    if not mesh.boundaries or set(mesh.boundaries) == {"0"}:
                        expected += f"; {NAME_BOUNDARIES}"
                    raise InputError(role, repr(name), expected)
        _check_elements(mesh)
        if not is_connected(mesh, *self.ends):
            raise InputError(
                "inlet and outlet",
                "boundaries that the mesh does not connect",
                "a mesh in one cell",
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
        start, end = np.moveaxis(self.mesh.p[:, self.mesh.facets[:, self.ends[1]]], 1, 0)
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
        """Shapes of a permeability of the elements that is no tensor."""
        return (self.mesh.nelements,), (self.mesh.nelements, 2)

    def corner_values(self, values: Array) -> Array:
        """Values at the corners of the elements (n, corners), from those at the vertices."""
        return np.asarray(values[self.mesh.t.T])

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Solve the flow for a unit drop.

        Parameters
        ----------
        permeability : float or array, (n,), (n, 2) or (n, 2, 2)
            Permeability of the n elements [m³]: a number, a number for each element, values along x and y, or tensors.
        bounds : bool
            Whether to compute bounds of the flow as well.
        solver : str
            "amg", "direct" or "auto". The solvers of rectangular elements are replaced by "auto".
        """
        check_solver(solver)
        solver = solver if solver in PLAIN_SOLVERS else "auto"
        tensor = permeability_tensors(permeability, self.mesh.nelements)
        return MeshOperators(self.mesh, self.ends).flow(tensor, bounds=bounds, solver=solver)


def parts_without_flow(mesh: Mesh, inlet: Indices, outlet: Indices) -> Iterator[str]:
    """Yield a sentence for each part of a mesh of straight sides [m] that does not connect the two ends."""
    corners = mesh.t
    part = _joined(mesh, corners)
    at_inlet, at_outlet = (np.unique(part[mesh.facets[:, facets]]) for facets in (inlet, outlet))
    of_element = part[corners[0]]
    area = np.abs(polygon_areas(mesh.p.T[corners.T]))
    for n in np.setdiff1d(of_element, np.intersect1d(at_inlet, at_outlet)):
        inside = of_element == n
        lacks = "no outlet" if n in at_inlet else "neither inlet nor outlet"
        if n in at_outlet:
            lacks = "no inlet"
        share = f"{area[inside].sum() * 1e6:.3g} of {area.sum() * 1e6:.3g} mm²"
        yield (
            f"a part of the mesh around {_middle(mesh, corners[:, inside])}, {share}, "
            f"touches {lacks}: nothing flows there"
        )


def boundaries_without_name(mesh: Mesh) -> Iterator[str]:
    """Yield a sentence for each boundary of a mesh of straight sides [m] that is in no group, such as a hole."""
    named = [np.asarray(facets) for facets in (mesh.boundaries or {}).values()]
    facets = mesh.facets[:, np.setdiff1d(mesh.boundary_facets(), np.concatenate([*named, []]))]
    part = _joined(mesh, facets)[facets[0]]
    length = np.hypot(*(mesh.p[:, facets[1]] - mesh.p[:, facets[0]]))
    for n in np.unique(part):
        along = part == n
        yield (
            f"a boundary of the mesh around {_middle(mesh, facets[:, along])}, "
            f"{to_text(float(length[along].sum()), 'm', 3)} long, is in no group: it is closed"
        )


def _joined(mesh: Mesh, corners: Indices) -> Indices:
    """Return the number of the part of each vertex, where elements or facets with corners (k, n) connect vertices."""
    ends = np.tile(corners[0], len(corners) - 1), corners[1:].ravel()
    links = coo_array((np.ones(ends[0].size), ends), shape=(mesh.nvertices, mesh.nvertices))
    return connected_components(links, directed=False)[1]


def _middle(mesh: Mesh, corners: Indices) -> str:
    """Return the centre of some corners as text."""
    x, y = (to_text(float(c[corners].mean()), "m", 3) for c in mesh.p)
    return f"({x}, {y})"


def _check_elements(mesh: Mesh) -> None:
    """Refuse nodes that are not finite, and elements that are degenerate, tangled or on each other."""
    undefined = np.flatnonzero(~np.isfinite(mesh.p).all(axis=0))
    if undefined.size:
        raise InputError("path", f"a mesh whose node {undefined[0]} is not finite", "finite ones")
    corners = mesh.p.T[mesh.t.T]
    before, after = (np.roll(corners, shift, axis=1) - corners for shift in (1, -1))
    # the Jacobian of a bilinear element is extreme at its corners
    det = after[..., 0] * before[..., 1] - after[..., 1] * before[..., 0]
    size = np.ptp(corners, axis=1).max(axis=1) ** 2
    flat = np.abs(det).min(axis=1) <= 1e-12 * size
    bad = np.flatnonzero(flat | (det.min(axis=1) * det.max(axis=1) <= 0))
    if bad.size:
        given = f"a mesh whose element {bad[0]} is degenerate or tangled"
        raise InputError("path", given, "a valid mesh")
    # elements beside each other, walked anticlockwise, walk their edge in opposite directions
    vertices, edge = mesh.t.T, mesh.t2f.T
    direction = np.sign(np.roll(vertices, -1, axis=1) - vertices)
    direction *= np.sign(polygon_areas(corners))[:, None].astype(int)
    count = np.bincount(edge.ravel())
    walked = np.bincount(edge.ravel(), direction.ravel())
    overlapping = (count > 2) | ((count == 2) & (walked != 0))
    bad = np.flatnonzero(overlapping[edge].any(axis=1))
    if found := tuple(bad[:2]) or first_overlap(mesh):
        given = f"a mesh whose elements {' and '.join(map(str, found))} overlap"
        raise InputError("path", given, "elements that lie beside each other")


def _names(given: Names) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else tuple(given)


@dataclass(frozen=True, eq=False)
class ElementSeal:
    """A seal whose permeability is constant on each element and varies at random from one element to the next.

    The flow is the geometric mean of its two bounds, of continuous pressures and of continuous fluxes. On random maps
    whose ln k is distributed symmetrically its error is within 3 %, where the bounds differ by factors.

    Attributes
    ----------
    mesh : straight triangles or quadrilaterals, of a ring in (ln r, θ).
    inlet, outlet : boundary facets of the mesh.
    size : approximate breadth from inlet to outlet, and length along the seal [m].
    outlines : array (n, corners, 2), corners of the elements in the plane of the seal [m].
    axes : array (n, 2, 2), unit vectors across and along the lay of each element, in the coordinates of the mesh.
    rectangles : the elements of a strip or a ring, whose flow has a fast path; None for other meshes.
    """

    value_needs_bounds: ClassVar[bool] = True

    mesh: Mesh = field(repr=False)
    inlet: Indices = field(repr=False)
    outlet: Indices = field(repr=False)
    size: Pair
    outlines: Array = field(repr=False)
    axes: Array = field(repr=False)
    rectangles: Rectangles | None = field(default=None, repr=False)

    @cached_property
    def _operators(self) -> MeshOperators:
        """Local matrices of the flow from the inlet to the outlet; a stochastic seal is solved many times."""
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

    @property
    def element_shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes of a permeability of the elements that is no tensor."""
        return (self.mesh.nelements,), (self.mesh.nelements, 2)

    def corner_values(self, values: Array) -> Array:
        """Values at the corners of the elements (n, corners), from those at the vertices."""
        return np.asarray(values[self.mesh.t.T])

    def tensors(self, permeability: Any) -> Array:
        """Return tensors (n, 2, 2) [m³] in the coordinates of the mesh.

        permeability : a number, (n,), (n, 2) across and along the lay, or tensors (n, 2, 2) in these two directions.
        """
        n = self.mesh.nelements
        if np.ndim(permeability) == 1:
            permeability = np.asarray(permeability)[:, None]
        if np.ndim(permeability) < 3:
            permeability = np.broadcast_to(permeability, (n, 2))
        principal = permeability_tensors(permeability, n)
        # a unit vector along an edge has a component of 1e-16 across it, where there is none
        axes = np.where(np.abs(self.axes) <= _ROUNDING, 0.0, self.axes)
        return np.asarray(np.einsum("nij,nia,njb->nab", principal, axes, axes))

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Solve the flow for a unit drop.

        Parameters
        ----------
        permeability : a number, (n,), (n, 2) across and along the lay, or tensors (n, 2, 2) in these directions [m³].
        bounds : solve for both bounds; otherwise the flow on a mesh is that of linear elements, the upper bound, with
            the same potential.
        solver : "multigrid" or "elimination", on rectangles whose principal axes are along their edges; "amg" or
            "direct", on the mesh; or "auto".

        Returns
        -------
        DarcyFlow with the potential at the vertices of the mesh.
        """
        tensors = self.tensors(permeability)
        is_plain = solver in PLAIN_SOLVERS or bool(tensors[:, 0, 1].any())
        if self.rectangles is not None and not is_plain:
            return self._flow_over_rectangles(self.rectangles, tensors, bounds, solver)
        solver = solver if solver in PLAIN_SOLVERS else "auto"
        flow = self._operators.flow(tensors, bounds=bounds, solver=solver)
        if not bounds:
            return flow
        lower = flow.lower if flow.lower > self._through_closed_axes(permeability) else 0.0
        conductance = float(np.sqrt(lower) * np.sqrt(flow.upper))
        return replace(flow, conductance=conductance, lower=lower, percolates=lower > 0)

    def _flow_over_rectangles(
        self, rectangles: Rectangles, tensors: Array, bounds: bool, solver: str
    ) -> DarcyFlow:
        """Solve the flow by the fast path, with the potential in the order of the vertices of the mesh."""
        k1, k2 = (tensors[:, a, a].reshape(rectangles.shape) for a in (0, 1))
        flow = rectangles.flow(k1, k2, bounds=bounds, solver=solver)
        potential, complement = np.empty((2, self.mesh.nvertices))
        potential[rectangles.vertices] = flow.potential
        complement[rectangles.vertices] = flow.complement
        return replace(flow, potential=potential, complement=complement)

    def _through_closed_axes(self, permeability: Any) -> float:
        """Return the flow [m³] for a unit drop below which all of it may pass axes that are closed."""
        least, most = principal_values(self.tensors(permeability))
        half = (most > 0) & (least <= 1e-14 * most)
        typical = float(np.median(most[half])) if half.any() else 0.0
        return _SHUT * CLOSED_AXIS * typical * self.size[1] / self.size[0]

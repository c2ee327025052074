"""Shapes of seals, and the conductance of a whole seal from the permeability of its parts.

A shape is a frozen dataclass with `length`, `points` and `flow` (see `Seal`); one on a structured grid has a
`grid` instead of `flow`. Symbols: k permeability [m³], φ potential for a unit drop.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import pi
from operator import index
from os import PathLike
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import Basis, FacetBasis, Functional, Mesh, MeshQuad1, MeshQuad2, MeshTri1, MeshTri2
from skfem.quadrature import get_quadrature

from ..base.errors import InputError
from ..base.quantities import to_si
from ..flow.grid import Grid
from ..flow.held import HeldFlow, held_flow
from ..flow.mesh import darcy_conductance, is_connected
from ..flow.solution import DarcyFlow
from .inlets import HeldBoundaries, Inlet, checked_pressures
from .mesh_file import read_mesh
from .overlap import first_overlap
from .structured import StructuredSeal

Array = NDArray[np.float64]


class Seal(Protocol):
    """Interface of the shapes that `seal_leakage` takes."""

    @property
    def length(self) -> float:
        """Length along the seal by which leakage is divided [m]."""
        ...

    @property
    def points(self) -> Array:
        """Coordinates (…, 2) [m] of the nodes at which the fluid pressure is given."""
        ...

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Flow for a unit drop of potential through the given permeability, checked."""
        ...


@dataclass(frozen=True)
class RectangularSeal(StructuredSeal):
    """A straight seal, inlet at x1 = 0, outlet at x1 = L1, periodic along x2.

    Nodes lie in n1 + 1 rows and at x2 = (j + ½)Δ2; permeabilities belong to the links between them, k1 (n1, n2)
    along the leakage and k2 (n1 − 1, n2) along the seal, from column j to j + 1. A link along the seal carries the flow
    from half way to the row before to half way to the row after.

    Parameters
    ----------
    size : (L1, L2) [m], L1 along the leakage.
    cells : (n1, n2).
    rows : x1 of the rows of nodes (n1 + 1) [m], rising from 0 to L1; equidistant unless given.

    Raises
    ------
    InputError : sizes that are not > 0, cells that are not whole numbers >= 1, rows that do not rise from 0 to L1.
    """

    size: tuple[float, float]
    cells: tuple[int, int]
    rows: tuple[float, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        size = _pair("size", self.size, "two finite numbers > 0 [m]")
        object.__setattr__(self, "size", tuple(_length("size", s) for s in size))
        object.__setattr__(self, "cells", _cells(self.cells))
        rows = self.rows or np.linspace(0.0, self.size[0], self.cells[0] + 1)
        object.__setattr__(self, "rows", _rows(rows, self.size[0], self.cells[0]))

    @property
    def length(self) -> float:
        """L2 [m]."""
        return self.size[1]

    @property
    def points(self) -> Array:
        """Coordinates of the nodes (n1 + 1, n2, 2) [m]."""
        return self.place(self.rows, np.arange(self.cells[1]))

    def place(self, x1: ArrayLike, column: ArrayLike) -> Array:
        """Coordinates (rows, columns, 2) [m] at distances x1 from the inlet [m] and columns of nodes, also between."""
        x2 = (np.asarray(column) + 0.5) * (self.size[1] / self.cells[1])
        return np.stack(np.meshgrid(x1, x2, indexing="ij"), axis=-1)

    @property
    def grid(self) -> Grid:
        """Nodes in rows x1 and columns x2."""
        return Grid.of_strip(self.rows, self.size[1] / self.cells[1], self.cells[1])


@dataclass(frozen=True)
class AnnularSeal(StructuredSeal):
    """A ring, leaking along the radius; axis 0 always runs from the inlet to the outlet, axis 1 along the
    angle.

    Nodes lie at n_r + 1 radii and at n_θ angles. A radial link has the conductance k1 Δθ/ln(r₊/r₋), exact
    for constant k; a tangential one carries the flow from half way to the radius before to half way to the one after,
    in ln r, k2 ln(r₊/r₋)/2Δθ.

    Parameters
    ----------
    inner_radius, outer_radius : [m].
    cells : (n_r, n_θ).
    inlet : "inner" or "outer"; with "outer" the first row of k1 and of the fluid pressure lies outside.
    rows : distances of the rows of nodes from the inlet (n_r + 1) [m], rising from 0 to the breadth; equidistant unless
        given.

    Raises
    ------
    InputError : radii that do not increase from above 0, bad cells, another inlet, rows that do not rise from 0 to the
        breadth.
    """

    inner_radius: float
    outer_radius: float
    cells: tuple[int, int]
    inlet: str = "inner"
    rows: tuple[float, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        inner, outer = _length("inner_radius", self.inner_radius), _length("outer_radius", self.outer_radius)
        if not outer > inner:
            raise InputError("outer_radius", f"{outer:g} m", f"a number > the inner radius, {inner:g} m")
        object.__setattr__(self, "inner_radius", inner)
        object.__setattr__(self, "outer_radius", outer)
        object.__setattr__(self, "cells", _cells(self.cells))
        if self.inlet not in ("inner", "outer"):
            raise InputError("inlet", repr(self.inlet), "'inner' or 'outer'")
        breadth = outer - inner
        rows = self.rows or np.linspace(0.0, breadth, self.cells[0] + 1)
        object.__setattr__(self, "rows", _rows(rows, breadth, self.cells[0]))

    @property
    def radii(self) -> Array:
        """Radii of the nodes (n_r + 1,) from inlet to outlet [m]."""
        return self._radius(self.rows)

    def _radius(self, x1: ArrayLike) -> Array:
        """Radii at distances from the inlet [m]."""
        x1 = np.asarray(x1, dtype=float)
        return self.inner_radius + x1 if self.inlet == "inner" else self.outer_radius - x1

    @property
    def size(self) -> tuple[float, float]:
        """Breadth from inlet to outlet and mean circumference [m]."""
        return (self.outer_radius - self.inner_radius, self.length)

    @property
    def length(self) -> float:
        """Mean circumference π(r_i + r_o) [m]."""
        return pi * (self.inner_radius + self.outer_radius)

    @property
    def points(self) -> Array:
        """Cartesian coordinates of the nodes (n_r + 1, n_θ, 2) [m]."""
        return self.place(self.rows, np.arange(self.cells[1]))

    def place(self, x1: ArrayLike, column: ArrayLike) -> Array:
        """Coordinates (rows, columns, 2) [m] at distances x1 from the inlet [m] and columns of nodes, also between."""
        θ = (np.asarray(column) + 0.5) * (2 * pi / self.cells[1])
        return self._radius(x1)[:, None, None] * np.stack([np.cos(θ), np.sin(θ)], axis=-1)

    @property
    def grid(self) -> Grid:
        """Nodes in rows of |ln r/r₀| and columns of θ, in which the form is that of a strip."""
        r = self.radii
        return Grid.of_strip(np.abs(np.log(r / r[0])), 2 * pi / self.cells[1], self.cells[1])


@dataclass(frozen=True)
class MeshSeal:
    """A seal of any plan shape, meshed with triangles or quadrilaterals of first or second order.

    Parameters
    ----------
    path : a mesh file that meshio reads (plane, z constant), or a scikit-fem mesh with named `boundaries`, in metres.
    inlet, outlet : names of boundaries, one or several each, that do not touch; all others are closed. Inlets at
        several pressures are given as {name: pressure [Pa]}; `seal_leakage` then takes no inlet pressure.
    unit : of the lengths in the file, such as "mm".

    Raises
    ------
    InputError : the file is missing or not a mesh, no boundary of that name (the message lists those there
        are), inlet and outlet touch or are not connected by the mesh, elements that are degenerate or
        tangled; with pressures, boundaries that touch, or an inlet that is not connected to the outlet.
    """

    path: str | PathLike[str] | Mesh = field(repr=False)
    inlet: Inlet
    outlet: str | Sequence[str]
    unit: str = field(default="m", repr=False)
    mesh: Mesh = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if isinstance(self.inlet, Mapping):
            object.__setattr__(self, "inlet", checked_pressures(self.inlet))
        mesh = self.path if isinstance(self.path, Mesh) else read_mesh(self.path, to_si(f"1 {self.unit}", "m", "unit"))
        object.__setattr__(self, "mesh", mesh)
        if type(mesh) not in (MeshTri1, MeshQuad1, MeshTri2, MeshQuad2):
            raise InputError("path", f"a {type(mesh).__name__}", "a plane mesh of triangles or quadrilaterals")
        there = ", ".join(repr(str(name)) for name in mesh.boundaries or {}) or "none"
        for role, names in (("inlet", self.inlet), ("outlet", self.outlet)):
            for name in _names(names) or (names,):
                if name not in (mesh.boundaries or {}):
                    raise InputError(role, repr(name), f"the name of a boundary of the mesh: {there}")
        _check_elements(mesh)
        held = self.boundaries  # raises if one is both inlet and outlet
        inlets = [self.ends[0]] if held is None else held.facets[: len(held.pressures)]
        if not all(is_connected(mesh, inlet, self.ends[1]) for inlet in inlets):
            raise InputError("inlet and outlet", "boundaries that the mesh does not connect", "a mesh in one piece")

    @property
    def ends(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Boundary facets of inlet and outlet."""
        inlet, outlet = (
            np.unique(np.concatenate([self.mesh.boundaries[name] for name in _names(names)]))
            for names in (self.inlet, self.outlet)
        )
        return inlet, outlet

    @property
    def boundaries(self) -> HeldBoundaries | None:
        """Boundaries with the pressures of the inlets; None where these are not given."""
        if not isinstance(self.inlet, Mapping):
            return None
        return HeldBoundaries.of(self.mesh, self.inlet, _names(self.outlet))

    @property
    def length(self) -> float:
        """Length of the outlet [m]."""
        basis = FacetBasis(self.mesh, self.mesh.elem(), facets=self.ends[1], intorder=6)
        return float(_one.assemble(basis))

    @property
    def area(self) -> float:
        """Area of the seal [m²]."""
        return float(_one.assemble(Basis(self.mesh, self.mesh.elem(), intorder=6)))

    @property
    def points(self) -> Array:
        """Coordinates of the vertices (n_vertices, 2) [m]."""
        return np.ascontiguousarray(self.mesh.p[:, : self.mesh.nvertices].T)

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Flow for a unit drop; permeability: a number, (n,), (n, 2) or (n, 2, 2) for n elements [m³]."""
        return darcy_conductance(self.mesh, permeability, *self.ends, bounds=bounds, solver=solver)

    def flow_between(
        self, permeability: Any, boundaries: HeldBoundaries, levels: Sequence[float], *, solver: str = "auto"
    ) -> HeldFlow:
        """Flow between boundaries held at potentials, permeability as in `flow`."""
        return held_flow(self.mesh, permeability, boundaries.facets, levels, solver=solver)


@Functional
def _one(w: Any) -> Any:
    """∫ 1."""
    return 1.0 + 0 * w.x[0]


def _check_elements(mesh: Mesh) -> None:
    undefined = np.flatnonzero(~np.isfinite(mesh.doflocs).all(axis=0))
    if undefined.size:
        raise InputError("path", f"a mesh whose node {undefined[0]} is not finite", "finite coordinates")
    nodes, element = mesh.dofs.element_dofs, mesh.elem()
    # the Jacobian of a bilinear element is extreme at its corners
    points = np.hstack([get_quadrature(mesh.elem.refdom, 4)[0], mesh.elem.refdom.p])
    slopes = np.stack([np.broadcast_to(element.lbasis(points, i)[1], points.shape) for i in range(len(nodes))])
    jacobian = np.einsum("cne,ndq->eqcd", mesh.doflocs[:, nodes], slopes)
    det = np.linalg.det(jacobian)
    size = np.ptp(mesh.doflocs[:, nodes], axis=1).max(axis=0) ** 2
    bad = np.flatnonzero((np.abs(det).min(axis=1) <= 1e-12 * size) | (det.min(axis=1) * det.max(axis=1) <= 0))
    if bad.size:
        raise InputError("path", f"a mesh whose element {bad[0]} is degenerate or tangled", "a valid mesh")
    _check_sides(mesh)


def _check_sides(mesh: Mesh) -> None:
    """Refuse elements that overlap: two that share an edge, walked anticlockwise, walk it in opposite directions."""
    corners = mesh.t.T
    following = np.roll(corners, -1, axis=1)
    (x, y), (x_following, y_following) = mesh.p[:, corners], mesh.p[:, following]
    area = (x * y_following - x_following * y).sum(axis=1)
    direction = np.sign(following - corners) * np.sign(area)[:, None]
    first, second = np.minimum(corners, following), np.maximum(corners, following)
    _, edge, count = np.unique(
        first.astype(np.int64) * mesh.nvertices + second, return_inverse=True, return_counts=True
    )
    edge = edge.reshape(corners.shape)
    walked = np.bincount(edge.ravel(), direction.ravel(), minlength=count.size)
    overlapping = (count > 2) | ((count == 2) & (walked != 0))
    bad = np.flatnonzero(overlapping[edge].any(axis=1))
    if bad.size:
        given = f"a mesh whose elements {' and '.join(map(str, bad[:2]))} overlap"
        raise InputError("path", given, "elements that lie beside each other")
    if found := first_overlap(mesh):
        named = " and ".join(map(str, found))
        given = (
            f"a mesh whose elements {named} overlap"
            if len(found) > 1
            else f"a mesh whose element {named} lies on others"
        )
        raise InputError("path", given, "elements that lie beside each other")


def _names(given: Inlet) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else tuple(given)


def _pair(name: str, value: Any, allowed: str) -> tuple[Any, Any]:
    try:
        first, second = value
    except (TypeError, ValueError):
        raise InputError(name, repr(value), allowed) from None
    return first, second


def _length(name: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not (np.isfinite(number) and number > 0):
        raise InputError(name, repr(value), "a finite number > 0 [m]")
    return number


def _rows(value: Any, length: float, n: int) -> tuple[float, ...]:
    rows = tuple(float(x) for x in value)
    ends = len(rows) == n + 1 and rows[0] == 0 and abs(rows[-1] - length) <= 1e-9 * length
    if not ends or not all(b > a for a, b in itertools.pairwise(rows)):
        raise InputError("rows", f"{len(rows)} values", f"{n + 1} rising numbers from 0 to {length:g} m")
    return rows


def _cells(value: Any) -> tuple[int, int]:
    allowed = "two whole numbers >= 1"
    pair = _pair("cells", value, allowed)
    try:
        n1, n2 = (index(n) for n in pair)
    except TypeError:
        raise InputError("cells", repr(value), allowed) from None
    if n1 < 1 or n2 < 1:
        raise InputError("cells", repr(value), allowed)
    return n1, n2

"""Seals of any plan shape on a mesh, whose inlets have one pressure or each its own, and checks of the mesh.

A mesh may cover a place twice although no element lies on its neighbour, such as two parts on each other. It has
outlines that cross, or an edge of an outline with elements on both of its sides. Outlines are walked with the mesh on
their left: the number of times that they run round a place is the number of elements there.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from skfem import Mesh, MeshQuad1, MeshTri1

from ..base import Array, Indices, InputError, to_si, to_text, validate
from ..flow.mesh import MeshFlow, MeshOperators
from ..flow.mesh_input import is_connected, permeability_tensors
from ..flow.solution import LINEAR
from .seal_files import read_mesh
from .triangulation import cross, polygon_areas

#: Depth in fractions of the shorter edge, and of an element, to which parts that touch may lie on each other:
#: coordinates are rounded, and edges are chords of arcs.
_EDGE_FRACTION, _ELEMENT_FRACTION = 0.05, 0.1
#: Pairs that are looked at together.
_CHUNK = 1_000_000


def first_overlap(mesh: Mesh) -> tuple[int, ...]:
    """One or two elements that lie on others; empty without any.

    mesh : triangles or quadrilaterals, none of which is tangled or lies on its neighbour.
    """
    # along an outline of the usual kind, the edges follow each other in both coordinates when it is turned
    c, s = np.cos(1.0), np.sin(1.0)
    points = (np.array([[c, -s], [s, c]]) @ mesh.p).T
    corners = mesh.t.T
    element, side = np.nonzero(np.bincount(mesh.t2f.ravel())[mesh.t2f.T] == 1)
    ends = np.stack([corners, np.roll(corners, -1, axis=1)])[:, element, side]
    clockwise = polygon_areas(points[corners[element]]) < 0
    start, end = points[np.where(clockwise, ends[::-1], ends)]
    crossing = _crossing(start, end)
    if crossing is not None:
        return int(element[crossing[0]]), int(element[crossing[1]])
    # outlines that do not cross have as many elements on them all along: one place beside each is enough
    for edge in np.unique(_joined(mesh, ends)[ends[0]], return_index=True)[1]:
        middle, centre = (start[edge] + end[edge]) / 2, points[corners[element[edge]]].mean(axis=0)
        if _rounds(start, end, middle + _ELEMENT_FRACTION * (centre - middle)) > 1:
            return (int(element[edge]),)
    return ()


def _crossing(start: Array, end: Array) -> tuple[int, int] | None:
    """Two edges that cross; None without any."""
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = np.argsort(low[:, 1], kind="stable")
    last = np.searchsorted(low[order, 1], high[order, 1])
    for i, j in _pairs(last):
        a, b = order[i], order[j]
        near = (low[a, 0] <= high[b, 0]) & (low[b, 0] <= high[a, 0])
        a, b = a[near], b[near]
        along_a, along_b = end[a] - start[a], end[b] - start[b]
        length_a, length_b = np.hypot(*along_a.T), np.hypot(*along_b.T)
        depth = _EDGE_FRACTION * np.minimum(length_a, length_b)
        found = np.ones(len(a), bool)
        for origin, along, length, ends in (
            (start[a], along_a, length_a, (start[b], end[b])),
            (start[b], along_b, length_b, (start[a], end[a])),
        ):
            one, other = (cross(along, place - origin) / length for place in ends)
            found &= (one * other < 0) & (np.minimum(np.abs(one), np.abs(other)) > depth)
        if found.any():
            at = int(np.argmax(found))
            return int(a[at]), int(b[at])
    return None


def _rounds(start: Array, end: Array, place: Array) -> int:
    """How often the outlines run round a place, by the edges that a ray to the right of it meets."""
    before, behind = start[:, 1] > place[1], end[:, 1] > place[1]
    right = (cross(end - start, place - start) > 0) == behind
    return int(np.sum(behind[right].astype(int) - before[right]))


def _pairs(last: Indices) -> Iterator[tuple[Indices, Indices]]:
    """Pairs of n and every number from n + 1 to last[n], without it; not too many at a time."""
    first = np.arange(len(last)) + 1
    count = np.maximum(last - first, 0)
    total = np.cumsum(count)
    begin = 0
    while begin < len(count):
        before = total[begin - 1] if begin else 0
        stop = max(begin + 1, int(np.searchsorted(total, before + _CHUNK, side="right")))
        n = np.repeat(np.arange(begin, stop), count[begin:stop])
        offset = np.arange(len(n)) - np.repeat(
            total[begin:stop] - count[begin:stop] - before, count[begin:stop]
        )
        yield n, first[n] + offset
        begin = stop


#: Names of inlets, one or several at one pressure, or pressures [Pa] of inlets by their names.
Inlet = str | Sequence[str] | Mapping[str, float]


@dataclass(frozen=True, eq=False)
class PressureBoundaries:
    """Named boundaries of a seal, inlets first.

    facets : boundary facets of each, which do not touch those of another.
    pressures : of the inlets [Pa]; the outlets have one in common, that of the outlet.
    """

    names: tuple[str, ...]
    facets: tuple[Indices, ...]
    pressures: tuple[float, ...]

    @classmethod
    def of(
        cls, mesh: Mesh, inlet: Mapping[str, float], outlet: Sequence[str]
    ) -> PressureBoundaries:
        """Boundaries of a mesh.

        Raises InputError: one is both inlet and outlet, or two of them touch.
        """
        if both := [name for name in outlet if name in inlet]:
            raise InputError(
                "outlet", f"{both[0]!r}, which is an inlet too", "other boundaries than the inlets"
            )
        names = (*inlet, *dict.fromkeys(outlet))
        facets = tuple(np.unique(mesh.boundaries[name]).astype(np.int64) for name in names)
        for (first, one), (second, other) in itertools.combinations(
            zip(names, facets, strict=True), 2
        ):
            if np.intersect1d(mesh.facets[:, one], mesh.facets[:, other]).size:
                given = f"boundaries {first!r} and {second!r} that touch, with pressures of inlets"
                raise InputError("inlet and outlet", given, "boundaries with no vertex in common")
        return cls(names, facets, tuple(inlet.values()))


@dataclass(frozen=True)
class MeshSeal:
    """A seal of any plan shape, meshed with linear triangles or quadrilaterals.

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
            object.__setattr__(self, "inlet", validate.pressures("inlet", self.inlet))
        mesh = (
            self.path
            if isinstance(self.path, Mesh)
            else read_mesh(self.path, to_si(f"1 {self.unit}", "m", "unit"))
        )
        object.__setattr__(self, "mesh", mesh)
        if type(mesh) not in (MeshTri1, MeshQuad1):
            raise InputError(
                "path",
                f"a {type(mesh).__name__}",
                f"a plane mesh of triangles or quadrilaterals, {LINEAR}",
            )
        there = ", ".join(repr(str(name)) for name in mesh.boundaries or {}) or "none"
        for role, names in (("inlet", self.inlet), ("outlet", self.outlet)):
            for name in _names(names) or (names,):
                if name not in (mesh.boundaries or {}):
                    raise InputError(
                        role, repr(name), f"the name of a boundary of the mesh: {there}"
                    )
        _check_elements(mesh)
        given = self.boundaries  # raises if one is both inlet and outlet
        inlets = [self.ends[0]] if given is None else given.facets[: len(given.pressures)]
        if not all(is_connected(mesh, inlet, self.ends[1]) for inlet in inlets):
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
    def boundaries(self) -> PressureBoundaries | None:
        """Boundaries with the pressures of the inlets; None where these are not given."""
        if not isinstance(self.inlet, Mapping):
            return None
        return PressureBoundaries.of(self.mesh, self.inlet, _names(self.outlet))

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

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> MeshFlow:
        """Flow for a unit drop; permeability: a number, (n,), (n, 2) or (n, 2, 2) for n elements [m³]."""
        tensor = permeability_tensors(permeability, self.mesh.nelements)
        return MeshOperators(self.mesh, self.ends).flow(tensor, bounds=bounds, solver=solver)

    def flow_between(
        self,
        permeability: Any,
        boundaries: PressureBoundaries,
        levels: Sequence[float],
        *,
        solver: str = "auto",
    ) -> MeshFlow:
        """Flow between boundaries at potentials, permeability as in `flow`."""
        tensor = permeability_tensors(permeability, self.mesh.nelements)
        return MeshOperators(self.mesh, boundaries.facets).flow(tensor, levels, solver=solver)


def parts_without_flow(mesh: Mesh, inlet: Indices, outlet: Indices) -> Iterator[str]:
    """A sentence for each part of a mesh of straight sides [m] that does not join boundary facets of both ends."""
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
    """A sentence for each boundary of a mesh of straight sides [m] that is in no group, such as that of a hole."""
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
    """The number of the part of each vertex, where elements or facets with corners (k, n) join vertices."""
    ends = np.tile(corners[0], len(corners) - 1), corners[1:].ravel()
    links = coo_array((np.ones(ends[0].size), ends), shape=(mesh.nvertices, mesh.nvertices))
    return connected_components(links, directed=False)[1]


def _middle(mesh: Mesh, corners: Indices) -> str:
    """The middle of some corners, as text."""
    x, y = (to_text(float(c[corners].mean()), "m", 3) for c in mesh.p)
    return f"({x}, {y})"


def _check_elements(mesh: Mesh) -> None:
    """Refuse nodes that are not finite, and elements that are degenerate, tangled or on each other."""
    undefined = np.flatnonzero(~np.isfinite(mesh.p).all(axis=0))
    if undefined.size:
        raise InputError(
            "path", f"a mesh whose node {undefined[0]} is not finite", "finite coordinates"
        )
    corners = mesh.p.T[mesh.t.T]
    before, after = (np.roll(corners, shift, axis=1) - corners for shift in (1, -1))
    # the Jacobian of a bilinear element is extreme at its corners
    det = after[..., 0] * before[..., 1] - after[..., 1] * before[..., 0]
    size = np.ptp(corners, axis=1).max(axis=1) ** 2
    flat = np.abs(det).min(axis=1) <= 1e-12 * size
    bad = np.flatnonzero(flat | (det.min(axis=1) * det.max(axis=1) <= 0))
    if bad.size:
        raise InputError(
            "path", f"a mesh whose element {bad[0]} is degenerate or tangled", "a valid mesh"
        )
    _check_sides(mesh)


def _check_sides(mesh: Mesh) -> None:
    """Refuse elements that overlap: two that share an edge, walked anticlockwise, walk it in opposite directions."""
    corners, edge = mesh.t.T, mesh.t2f.T
    direction = np.sign(np.roll(corners, -1, axis=1) - corners)
    direction *= np.sign(polygon_areas(mesh.p.T[corners]))[:, None].astype(int)
    count = np.bincount(edge.ravel())
    walked = np.bincount(edge.ravel(), direction.ravel())
    overlapping = (count > 2) | ((count == 2) & (walked != 0))
    bad = np.flatnonzero(overlapping[edge].any(axis=1))
    if bad.size:
        given = f"a mesh whose elements {' and '.join(map(str, bad[:2]))} overlap"
        raise InputError("path", given, "elements that lie beside each other")
    if found := first_overlap(mesh):
        named = " and ".join(map(str, found))
        given = f"elements {named} overlap" if len(found) > 1 else f"element {named} lies on others"
        raise InputError("path", f"a mesh whose {given}", "elements that lie beside each other")


def _names(given: Inlet) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else tuple(given)

"""Seals of finite elements, each of which takes the windows of a face that fit into it.

The two permeabilities of a window are principal values, k2 along the lay and k1 across it. The windows of an element
are taken together as one, and turned to the direction of the lay in the element: four windows become one by a bridge of
five links, two in series beside two in series and one between them. The bridge is its own dual, so that the median of
many windows is kept for every distribution of ln k that is symmetric, and a network of windows that are open at random
conducts from a fraction of one half on, as links on a square lattice do.
Source: Reynolds, Stanley & Klein, J. Phys. C 10, 1977, L167 (percolation); King, Transp. Porous Media 4, 1989, 37.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from skfem import Mesh, MeshQuad1, MeshQuad2, MeshTri1, MeshTri2

from ..base import Array, Indices, InputError, counted, to_text
from ..flow.dirichlet_flow import DirichletFlow, dirichlet_flow
from ..flow.mesh import CLOSED_AXIS, darcy_conductance, permeability_tensors
from ..flow.solution import DarcyFlow
from .mesh_seal import PressureBoundaries
from .triangulation import polygon_areas


def combined(k1: Array, k2: Array, window: tuple[float, float]) -> tuple[Array, Array]:
    """Permeability of blocks of windows along both of their axes.

    k1, k2 : permeability of the windows of each block (blocks, n1, n2) [m³], n1 and n2 powers of 2.
    window : sides of a window along both axes [m].

    Returns (blocks,) each, exactly 0 where no path is open.

    >>> k = np.full((1, 4, 2), 3.0)
    >>> [float(x[0]) for x in combined(k, k, (1.0, 1.0))]
    [3.0, 3.0]
    """
    ratio = window[1] / window[0]
    # conductances of windows; a block of 2 × 2 is as long for its width as one of them
    c1, c2 = k1 * ratio, k2 / ratio
    while c1.shape[1] > 1 and c1.shape[2] > 1:
        c1, c2 = _bridges(c1, c2[:, 0::2, 0::2]), _bridges(c2.swapaxes(1, 2), c1[:, 1::2, 1::2].swapaxes(1, 2))
        c2 = c2.swapaxes(1, 2)
    while c1.shape[1] > 1:  # twice as long: k of two in series along axis 1, and beside each other along axis 2
        c1, c2 = _in_series(c1[:, 0::2], c1[:, 1::2]), (c2[:, 0::2] + c2[:, 1::2]) / 2
    while c1.shape[2] > 1:
        c1, c2 = (c1[..., 0::2] + c1[..., 1::2]) / 2, _in_series(c2[..., 0::2], c2[..., 1::2])
    return c1[:, 0, 0] / ratio, c2[:, 0, 0] * ratio


def _bridges(along: Array, between: Array) -> Array:
    """Conductance along axis 1 of every 2 × 2 windows with a link between their columns."""
    a, b, c, d = along[:, 0::2, 0::2], along[:, 1::2, 0::2], along[:, 0::2, 1::2], along[:, 1::2, 1::2]
    e = between
    flow = a * b * (c + d) + c * d * (a + b) + e * (a + c) * (b + d)
    both = _quotient(flow, (a + b) * (c + d) + e * (a + b + c + d))
    # a column without any open link leaves the other one alone
    both = np.where(c + d + e == 0, _quotient(a * b, a + b), both)
    return np.where(a + b + e == 0, _quotient(c * d, c + d), both)


def _in_series(a: Array, b: Array) -> Array:
    """Harmonic mean, 0 where either is 0."""
    return _quotient(2 * a * b, a + b)


def _quotient(above: Array, below: Array) -> Array:
    return np.divide(above, below, out=np.zeros_like(above), where=below > 0)


#: Solvers of a system on a mesh; others are of grids.
_SOLVERS = ("auto", "direct", "amg")
#: √ of the windows that an element holds, below which elements are refused, and below which they are warned of. An
#: element takes a power of 2 of windows, one of the two nearest, and at least one.
_LEAST, _SMALL = 0.35, 0.7
#: A window closed along one axis keeps `CLOSED_AXIS` of its other permeability there. A seal that only this opens
#: has measured 0.002 to 7e3 of that median in squares, an open one 7e6 and more: below this many it counts as closed.
_SHUT = 2e5
#: Steps of two sequences that fill the interval from 0 to 1 evenly; windows that differ from a whole number.
_TURNS, _EVEN = (0.7548776662466927, 0.5698402909980532), 1e-9
#: Fraction of the area whose elements may be smaller.
_FRACTION = 0.1
#: Places, in a second-order element, of the corners of the four straight ones that fill it.
_PARTS = {
    MeshTri2: (MeshTri1, ((0, 3, 5), (1, 4, 3), (2, 5, 4), (3, 4, 5))),
    MeshQuad2: (MeshQuad1, ((0, 4, 8, 7), (1, 5, 8, 4), (2, 6, 8, 5), (3, 7, 8, 6))),
}


@dataclass(frozen=True, eq=False)
class ElementSeal:
    """A seal whose permeability is constant on each element and varies at random from one to the next.

    The flow is √(upper × lower) of its two bounds, of linear elements and of Raviart-Thomas fluxes: on random maps of
    elements, whose ln k scatters symmetrically, this is within 3 % where the bounds are off by factors.

    mesh : straight triangles or quadrilaterals. inlet, outlet : indices of its boundary facets.
    size : breadth from inlet to outlet, about, and length along the seal [m].
    outlines : corners of the elements (n, corners, 2) [m].
    boundaries : inlets with pressures of their own, and outlets; None where all inlets have one pressure.
    """

    mesh: Mesh = field(repr=False)
    inlet: Indices = field(repr=False)
    outlet: Indices = field(repr=False)
    size: tuple[float, float]
    outlines: Array = field(repr=False)
    boundaries: PressureBoundaries | None = field(default=None, repr=False)

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

    def flow(self, permeability: Any, *, bounds: bool = False, solver: str = "auto") -> DarcyFlow:
        """Flow for a unit drop, with its bounds; permeability as in `MeshSeal.flow`, solvers of grids are "auto"."""
        solver = solver if solver in _SOLVERS else "auto"
        flow = darcy_conductance(self.mesh, permeability, self.inlet, self.outlet, bounds=True, solver=solver)
        lower = flow.lower if flow.lower > self._through_closed_axes(permeability) else 0.0
        conductance = float(np.sqrt(lower) * np.sqrt(flow.upper))
        return replace(flow, conductance=conductance, lower=lower, percolates=lower > 0)

    def flow_between(
        self, permeability: Any, boundaries: PressureBoundaries, levels: Sequence[float], *, solver: str = "auto"
    ) -> DirichletFlow:
        """Flow between boundaries of given potentials, the outlets at 0 and all inlets on one side of it.

        The outflow is √ of the product of those of linear elements and of Raviart-Thomas fluxes, which with inlets at
        one pressure are the two bounds. The flows through all boundaries are the mean of both solutions, each
        multiplied so that it has this outflow: they balance. Without outflow all are 0.

        Raises InputError: inlets on both sides of the outlet.
        """
        if min(levels) < 0:
            raise InputError("inlet", "pressures above and below that of the outlet", "all on one side of it")
        solver = solver if solver in _SOLVERS else "auto"
        flow = dirichlet_flow(self.mesh, permeability, boundaries.facets, levels, fluxes=True, solver=solver)
        outlets = slice(len(boundaries.pressures), None)
        fluxes = flow.rates if flow.flux_rates is None else flow.flux_rates
        upper, lower = -float(flow.rates[outlets].sum()), -float(fluxes[outlets].sum())
        if not (lower > self._through_closed_axes(permeability) * max(levels) and upper > 0):
            return replace(flow, rates=np.zeros_like(flow.rates))
        outflow = np.sqrt(lower) * np.sqrt(upper)
        return replace(flow, rates=0.5 * outflow * (flow.rates / upper + fluxes / lower))

    def _through_closed_axes(self, permeability: Any) -> float:
        """Flow for a unit drop below which it may go through axes of windows that are closed [m³]."""
        values = np.linalg.eigvalsh(permeability_tensors(permeability, self.mesh.nelements))
        half = (values[:, 1] > 0) & (values[:, 0] <= 1e-14 * values[:, 1])
        typical = float(np.median(values[half, 1])) if half.any() else 0.0
        return _SHUT * CLOSED_AXIS * typical * self.size[1] / self.size[0]


def straightened(mesh: Mesh, *ends: Indices) -> tuple[Mesh, tuple[Indices, ...]]:
    """The mesh with four straight elements in place of each of the second order, and its boundary facets."""
    if type(mesh) not in _PARTS:
        return mesh, ends
    kind, parts = _PARTS[type(mesh)]
    nodes = mesh.dofs.element_dofs
    straight = kind(mesh.doflocs, np.ascontiguousarray(np.hstack([nodes[list(part)] for part in parts])))
    boundary = straight.boundary_facets()
    found = []
    for facets in ends:
        middles = mesh.dofs.facet_dofs[0, facets]
        found.append(boundary[np.isin(straight.facets[:, boundary], middles).any(axis=0)])
    return straight, tuple(found)


@dataclass(frozen=True, eq=False)
class ElementWindows:
    """Windows drawn for the elements of a seal, see `layouts.SealWindows`.

    window : sides of a window along its axes [m]. lay : unit vectors along the lay in each element (n, 2).
    """

    seal: ElementSeal
    window: tuple[float, float]
    lay: Array = field(repr=False)
    warnings: tuple[str, ...] = ()

    together: ClassVar[bool] = True
    axes: ClassVar[tuple[int, int]] = (0, 1)
    rows: ClassVar[int] = 0

    @property
    def draws(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Number of drawn values along both axes of the windows, (1, windows)."""
        n = int(self._first[-1])
        return (1, n), (1, n)

    @cached_property
    def _powers(self) -> Indices:
        """Exponents of 2 of the windows of each element along both axes of the windows (2, n)."""
        along = np.log2(self._windows_along)
        # rounded up or down by turns, so that the mean is kept: to one side it would prefer windows beside each other
        turn = (np.arange(1, along.shape[1] + 1)[:, None] * _TURNS % 1.0).T
        both = np.maximum(np.floor(along.sum(axis=0) + turn[0] + _EVEN), 0.0)
        first = np.clip(np.floor((both + along[0] - along[1]) / 2 + turn[1] + _EVEN), 0.0, both)
        return np.stack([first, both - first]).astype(np.int64)

    @cached_property
    def _windows_along(self) -> Array:
        """Windows along both of their axes in a rectangle of the area and shape of each element (2, n)."""
        corners = self.seal.outlines
        area = np.abs(polygon_areas(corners))
        along, across = (np.einsum("nca,na->nc", corners, t).std(axis=1) for t in (self.lay, self._across))
        return np.sqrt(area * np.stack([across / along, along / across])) / np.array(self.window)[:, None]

    @cached_property
    def _first(self) -> Indices:
        """Number of the first window of each element, and of all windows (n + 1,)."""
        return np.concatenate([[0], np.cumsum(2 ** self._powers.sum(axis=0))])

    @property
    def _across(self) -> Array:
        return np.stack([self.lay[:, 1], -self.lay[:, 0]], axis=1)

    @property
    def centres(self) -> Array:
        """Centres of the elements (n, 2) [m]."""
        return self.seal.outlines.mean(axis=1)

    def places(self, axis: int) -> Array:
        """Where the drawn values of an axis belong, (1, windows, 2) [m]: the centres of their elements."""
        return np.repeat(self.centres, np.diff(self._first), axis=0)[None]

    def permeability(self, along: Array, across: Array) -> Array:
        """Tensors (n, 2, 2) [m³] of the elements from the drawn permeabilities along both axes of the windows."""
        k = np.empty((2, len(self.lay)))
        for power in np.unique(self._powers, axis=1).T:
            elements = np.flatnonzero((self._powers == power[:, None]).all(axis=0))
            shape = len(elements), *(2**power)
            of = self._first[elements][:, None] + np.arange(2 ** power.sum())
            k[:, elements] = combined(along[0, of].reshape(shape), across[0, of].reshape(shape), self.window)
        return np.einsum("n,na,nb->nab", k[0], self._across, self._across) + np.einsum(
            "n,na,nb->nab", k[1], self.lay, self.lay
        )

    @property
    def outlines(self) -> Array:
        """Corners of the parts of the seal that pictures show (n, corners, 2) [m]."""
        return self.seal.outlines

    def shown(self, permeability: Array, fluid_pressure: Array) -> tuple[Array, Array]:
        """Permeability [m³], √ of the product of its principal values, and fluid pressure [Pa] of every part (n,)."""
        determinant = np.maximum(np.linalg.det(permeability / (scale := permeability.max() or 1.0)), 0.0)
        return scale * np.sqrt(determinant), fluid_pressure[self.seal.mesh.t].mean(axis=0)

    def means(self, values: Array) -> Array:
        """Means (n,) over the windows of every element of values (1, windows) drawn along axis 0."""
        return np.add.reduceat(values[0], self._first[:-1]) / np.diff(self._first)

    def flux(self, permeability: Array, potential: Array, rate: float) -> Array:
        """Volume rate per width (n, 2) [m²/s] in the middle of every element, in the plane of the seal.

        permeability : tensors (n, 2, 2) [m³]. potential : of the vertices over the density of volume rates [1/s].
        rate : leakage of the seal [m³/s], which the flux is scaled to carry: that of the potential itself would carry
        the upper bound.
        """
        corners, at = self.seal.outlines, np.nan_to_num(potential)[self.seal.mesh.t.T]
        # along two edges of a triangle or both diagonals of a quadrilateral, where differences are those of the middle
        ends, starts = ([1, 2], [0, 0]) if corners.shape[1] == 3 else ([2, 3], [0, 1])
        ways, drops = corners[:, ends] - corners[:, starts], at[:, ends] - at[:, starts]
        gradient = np.linalg.solve(ways, drops[..., None])[..., 0]
        flux = -np.einsum("nab,nb->na", permeability, gradient)
        area = self._windows_along.prod(axis=0) * self.window[0] * self.window[1]
        power = -float(area @ (flux * gradient).sum(axis=1))
        return flux * (abs(rate) * np.ptp(potential[np.isfinite(potential)]) / power if power > 0 else 0.0)

    def unknowns(self, pressures: int = 1) -> tuple[int, int]:
        """Rows and columns of a network that takes about as much work, windows being joined at each fluid pressure."""
        side = max(1, round(np.sqrt(10 * len(self.lay) + 0.1 * pressures * self.draws[0][1])))
        return side, side

    def __str__(self) -> str:
        windows, elements = self.draws[0][1], len(self.lay)
        return f"{counted(windows, 'window')} in {counted(elements, 'element')}"

    def checked(self) -> ElementWindows:
        """These windows, with a warning where elements are smaller than windows.

        Raises InputError: elements much smaller than windows.
        """
        area = np.sort(self._windows_along.prod(axis=0))
        at_fraction = np.searchsorted(total := area.cumsum(), _FRACTION * total[-1])
        small = float(np.sqrt(area[at_fraction]))
        if small >= _SMALL:
            return self
        sides = " × ".join(to_text(side, "m", 3) for side in self.window)
        given = f"elements with sides of {small:.2g} windows, which are {sides}"
        if small < _LEAST:
            allowed = "elements of at least one window: a coarser mesh, smaller cells, or another unit of length"
            raise InputError("seal", given, allowed)
        return replace(self, warnings=(f"{given}: each takes a window of its own, so that seals scatter too little",))

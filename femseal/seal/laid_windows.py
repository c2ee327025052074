"""Windows laid out over a seal of some shape: how many are drawn, where they lie, what permeability they make."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import pi
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from skfem import MeshQuad
from skfem.mesh import MeshQuad1DG

from ..base import Array, InputError, counted, to_si, to_text
from ..flow.spiral import Spiral
from .element_windows import ElementSeal, ElementWindows, straightened
from .lay import Lay, check_size
from .mesh_seal import MeshSeal, parts_without_flow
from .shapes import AnnularSeal, RectangularSeal


@dataclass(frozen=True, eq=False)
class LinkWindows:
    """One window for each link between nodes, see `layouts.SealWindows`.

    turned : the lay runs along axis 0, from inlet to outlet, so that links take the other axis of a window.
    """

    seal: RectangularSeal | AnnularSeal
    turned: bool = False
    warnings: tuple[str, ...] = ()

    together: ClassVar[bool] = False

    @property
    def axes(self) -> tuple[int, int]:
        """Axis of the windows along which the links along axes 0 and 1 take their permeability."""
        return (1, 0) if self.turned else (0, 1)

    @property
    def rows(self) -> int:
        """Rows of windows from inlet to outlet that are like those of a face; 0 where windows are turned."""
        return 0 if self.turned else self.seal.cells[0]

    @property
    def draws(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Rows and columns of the links along both axes."""
        n1, n2 = self.seal.cells
        return (n1, n2), (n1 - 1, n2)

    def places(self, axis: int) -> Array:
        """Middles of the links along an axis (rows, columns, 2) [m]."""
        x1, columns = np.asarray(self.seal.rows), np.arange(self.seal.cells[1])
        if axis == 0:
            return self.seal.place((x1[:-1] + x1[1:]) / 2, columns)
        return self.seal.place(x1[1:-1], columns + 0.5)

    def permeability(self, along: Array, across: Array) -> tuple[Array, Array]:
        """The permeabilities of the links, as the seal takes them."""
        return along, across

    def with_rows(self, rows: tuple[float, ...]) -> LinkWindows:
        """The same windows between rows of nodes at other distances from the inlet [m]; as they are without any."""
        if not rows:
            return self
        stretch = self.seal.size[0] / rows[-1]
        return replace(self, seal=replace(self.seal, rows=tuple(stretch * x for x in rows)))

    @property
    def outlines(self) -> Array:
        """Corners of the surroundings of the links along axis 0 (n1 n2, 4, 2) [m], which pictures show."""
        corners = self.seal.place(self.seal.rows, np.arange(self.seal.cells[1] + 1) - 0.5)
        around = [corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]]
        return np.stack(around, axis=2).reshape(-1, 4, 2)

    def shown(self, permeability: tuple[Array, Array], fluid_pressure: Array) -> tuple[Array, Array]:
        """Permeability [m³] along axis 0 and fluid pressure [Pa] of every part (n1 n2,)."""
        return permeability[0].ravel(), ((fluid_pressure[:-1] + fluid_pressure[1:]) / 2).ravel()

    def means(self, values: Array) -> Array:
        """Means (n1 n2,) over the windows of every part of values (rows, columns) drawn along axis 0."""
        return values.ravel()

    def flux(self, permeability: tuple[Array, Array], potential: Array, rate: float) -> Array:
        """Volume rate per width (n1 n2, 2) [m²/s] in every part, in the plane of the seal.

        It is that of its link along axis 0, and the mean of those along axis 1 at its corners.

        permeability : of the links [m³]. potential : of the nodes (n1 + 1, n2) over the density of volume rates [1/s],
        NaN in pockets. rate : leakage of the seal [m³/s]; the links carry it as they are.
        """
        along = _link_flux(permeability[0], np.diff(potential, axis=0), np.diff(self.seal.points, axis=0))
        across = np.zeros((self.seal.cells[0] + 1, self.seal.cells[1], 2))
        if self.seal.cells[1] > 1:
            following = self.seal.place(self.seal.rows, np.arange(1, self.seal.cells[1] + 1))
            drop, way = np.roll(potential, -1, axis=1) - potential, following - self.seal.points
            across[1:-1] = _link_flux(permeability[1], drop[1:-1], way[1:-1])
        rows = (across[:-1] + across[1:]) / 2
        return (along + (rows + np.roll(rows, 1, axis=1)) / 2).reshape(-1, 2)

    def unknowns(self, pressures: int = 1) -> tuple[int, int]:
        """Rows and columns of the network, whatever the number of fluid pressures at which windows are drawn."""
        return self.seal.cells

    def __str__(self) -> str:
        n1, n2 = self.seal.cells
        return f"{n1} × {n2} links"


@dataclass(frozen=True, eq=False)
class SpiralWindows(LinkWindows):
    """Windows for links whose grooves wind: each along axis 0 has k₁ cos²α + k₂ sin²α, with k₂ of a whole row.

    tangent : tan α of every row of links along axis 0 (n1,). Where all windows are alike the pressure depends on that
    axis alone, and the rest of their tensors does not matter.
    """

    tangent: tuple[float, ...] = ()

    together: ClassVar[bool] = True

    @property
    def rows(self) -> int:
        """0: windows keep no place of a face."""
        return 0

    @property
    def draws(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Rows and columns of the windows, of which each is drawn with both of its permeabilities."""
        return self.seal.cells, self.seal.cells

    def places(self, axis: int) -> Array:
        """Middles of the windows (rows, columns, 2) [m]."""
        return super().places(0)

    def permeability(self, along: Array, across: Array) -> tuple[Array, Array]:
        """The permeabilities of the links from those of the windows; across, the mean of the rows beside.

        A groove passes all windows of a row: its flow along x1 has their harmonic mean.
        """
        square = np.square(self.tangent)[:, None]
        radial = (along + square * along_grooves(across)) / (1 + square)
        round_ = (across + square * along) / (1 + square)
        return radial, (round_[:-1] + round_[1:]) / 2


def along_grooves(across: Array) -> Array:
    """Permeability of grooves (rows, 1) [m³] that pass all windows of a row (rows, columns): the harmonic mean."""
    with np.errstate(divide="ignore"):
        groove: Array = 1 / np.mean(1 / across, axis=1, keepdims=True)
    return groove


def _link_flux(k: Array, drop: Array, way: Array) -> Array:
    """Flux (…, 2) along links whose ends differ by so much in potential (…) and in place (…, 2)."""
    return -(k * np.nan_to_num(drop) / (way**2).sum(axis=-1))[..., None] * way


#: Widths of columns of windows on the inner edge of a ring, in widths of windows: below them it is refused, or warned.
_NARROWEST, _NARROW = 0.35, 0.7
#: Windows between inlet and outlet: no seal has more.
_MOST_ROWS = 10**6
#: Windows laid out over a seal: how many are drawn, where they lie, and the permeability that they make.
SealWindows = LinkWindows | ElementWindows
#: Seals of these windows, with their size: breadth from inlet to outlet, about, and length along the seal [m].
DrawnSeal = RectangularSeal | AnnularSeal | ElementSeal


@dataclass(frozen=True)
class Windows:
    """What a layout lays out: windows of a face, and what the sampling of the seal says of its size.

    size : sides of a window along x1 and x2 [m]. rows : of windows of the face along x1.
    length, breadth : of the seal [m], None where not given.
    """

    size: tuple[float, float]
    rows: int
    length: float | None = None
    breadth: float | None = None


def laid_on_strip(windows: Windows, lay: Lay) -> SealWindows:
    """On a strip whose length is given: links along its axes, quadrilaterals where the lay runs between them."""
    (d1, d2), turned = windows.size, lay.name == "x1"
    assert windows.length is not None
    straight = lay.name in ("x1", "x2", "spiral")
    if not straight:
        d1 = d2 = (d1 * d2) ** 0.5
    elif turned:
        d1, d2 = d2, d1
    breadth = windows.breadth if windows.breadth is not None else windows.rows * windows.size[0]
    cells = _rows_of(breadth, d1, "breadth", breadth), max(1, round(windows.length / d2))
    size = cells[0] * d1, cells[1] * d2
    if lay.name == "spiral":
        lay.check_lead(size[0])
        slope = Spiral(lay.lead, lay.circumference).tangent(size[1])
        return SpiralWindows(RectangularSeal(size, cells), tangent=(slope,) * cells[0])
    if straight:
        return LinkWindows(RectangularSeal(size, cells), turned)
    return _elements(_strip(size, cells), windows, lay)


def _rows_of(breadth: float, side: float, name: str, given: float) -> int:
    """Number of windows between inlet and outlet; raises InputError that names the length [m] it comes from."""
    rows = max(1, round(breadth / side))
    if rows > _MOST_ROWS:
        expected = f"at most {_MOST_ROWS} windows from inlet to outlet, not {rows}"
        raise InputError(name, to_text(given, "m"), expected)
    return rows


def laid_on_ring(windows: Windows, lay: Lay, radii: tuple[float, float], inlet: str) -> SealWindows:
    """On a ring between two radii [m]: links along radius and angle, quadrilaterals where the lay runs between them."""
    inner, outer = radii
    d1, d2 = windows.size
    along_axes = lay.name in ("radial", "circumferential", "spiral")
    if not along_axes:
        d1 = d2 = (d1 * d2) ** 0.5
    elif lay.name == "radial":
        d1, d2 = d2, d1
    breadth, middle = outer - inner, (inner + outer) / 2
    if breadth < _NARROW * d1:
        sides = " × ".join(to_text(side, "m", 3) for side in windows.size)
        raise InputError("outer_radius", f"a ring {to_text(breadth, 'm', 3)} broad",
                            f"a ring at least as broad as a window, {sides}")  # fmt: skip
    cells = _rows_of(breadth, d1, "outer_radius", outer), max(3, round(2 * pi * middle / d2))
    seal = AnnularSeal(inner, outer, cells, inlet)
    if not along_axes:
        return _elements(_ring(seal), windows, lay)
    narrow = 2 * pi * inner / (cells[1] * d2)
    given = f"a ring with {counted(cells[1], 'column')} of windows, {narrow:.0%} as wide as windows at its inner radius"
    if narrow < _NARROWEST:
        raise InputError("inner_radius", given, f"at least {_NARROWEST:.0%}; a mesh has none of them")
    warnings = (f"{given}: windows there are drawn too close together; a mesh has equal ones",)
    doubts = warnings if narrow < _NARROW else ()
    if lay.name == "spiral":
        middles = inner + breadth / cells[0] * (np.arange(cells[0]) + 0.5)
        tangent = tuple((lay.lead / (2 * pi * (middles if inlet == "inner" else middles[::-1]))).tolist())
        return SpiralWindows(seal, warnings=doubts, tangent=tangent)
    return LinkWindows(seal, lay.name == "radial", doubts)


def laid_on_mesh(
    windows: Windows, lay: Lay, file: tuple[Path, Any, Any, str], length: float | None, centre: tuple[float, float]
) -> SealWindows:
    """On a mesh: each element takes the windows that fit into it.

    file : path, inlet (a tuple of names and pressures where it has these), outlet and unit, see `MeshSeal`. length :
        of the seal [m], that of the outlet unless given. centre : of the lay [m].
    """
    path, *_, unit = file
    stat = path.stat() if path.is_file() else None
    stamp = None if stat is None else (stat.st_mtime_ns, stat.st_size)
    seal = _mesh_seal(*file, stamp)
    check_size("path", float(np.ptp(seal.points, axis=0).max()), unit)
    given = seal.boundaries
    mesh, ends = straightened(seal.mesh, *seal.ends, *(given.facets if given else ()))
    along = length or seal.length
    boundaries = replace(given, facets=ends[2:]) if given else None
    size = seal.area / along, along
    laid = ElementSeal(mesh, ends[0], ends[1], size, mesh.p.T[mesh.t.T], boundaries)
    found = _elements(laid, windows, lay, centre, to_si(f"1 {unit}", "m", "unit"))
    return replace(found, warnings=(*found.warnings, *parts_without_flow(mesh, ends[0], ends[1])))


@lru_cache(maxsize=2)
def _mesh_seal(path: Path, inlet: Any, outlet: Any, unit: str, stamp: Any) -> MeshSeal:
    """The seal of a mesh file, read once while its time and size (`stamp`) stay; a run lays it out several times."""
    of_pressures = isinstance(inlet, tuple) and isinstance(inlet[0], tuple)
    return MeshSeal(path, dict(inlet) if of_pressures else inlet, outlet, unit)


def _elements(
    seal: ElementSeal, windows: Windows, lay: Lay, centre: tuple[float, float] = (0.0, 0.0), unit: float = 1.0
) -> ElementWindows:
    laid = ElementWindows(seal, windows.size, lay.directions(seal.outlines.mean(axis=1), centre, unit))
    return laid.checked()


def _strip(size: tuple[float, float], cells: tuple[int, int]) -> ElementSeal:
    """A strip of quadrilaterals, periodic along x2."""
    if cells[1] < 3:
        raise InputError("length", counted(cells[1], "window"), "at least 3 where the lay runs between the axes")
    plain = MeshQuad.init_tensor(*(np.linspace(0.0, side, n + 1) for side, n in zip(size, cells, strict=True)))
    x1, x2 = plain.p
    ring = MeshQuad1DG.periodic(plain, np.flatnonzero(x2 == x2.max()), np.flatnonzero(x2 == 0.0))
    at = np.empty(ring.nvertices)
    at[ring.t] = x1[plain.t]
    facets = ring.boundary_facets()
    inlet, outlet = (facets[(at[ring.facets[:, facets]] == end).all(axis=0)] for end in (0.0, x1.max()))
    return ElementSeal(ring, inlet, outlet, size, plain.p.T[plain.t.T])


def _ring(seal: AnnularSeal) -> ElementSeal:
    """A ring of quadrilaterals with straight sides between the nodes of a structured one."""
    n1, n2 = seal.cells
    number = np.arange((n1 + 1) * n2).reshape(n1 + 1, n2)
    following = np.roll(number, -1, axis=1)
    quads = np.stack([number[:-1], number[1:], following[1:], following[:-1]]).reshape(4, -1)
    mesh = MeshQuad(np.ascontiguousarray(seal.points.reshape(-1, 2).T), quads)
    facets = mesh.boundary_facets()
    row = (mesh.facets[:, facets] // n2)[0]
    return ElementSeal(mesh, facets[row == 0], facets[row == n1], seal.size, mesh.p.T[mesh.t.T])

"""Shapes of seals that a case can choose: each lays windows out over a seal of real size.

To add a shape, write a frozen dataclass with its `kind`, the parameters that a case gives (see `base.parameters`) and
`lay_out`, and put it into `LAYOUTS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from math import isfinite, pi
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from skfem import MeshQuad
from skfem.mesh import MeshQuad1DG

from ..base.errors import InputError
from ..base.parameters import check_parameters, parameter
from ..base.quantities import to_si, to_text
from ..flow.spiral import Spiral
from .element_windows import ElementSeal, ElementWindows, straightened
from .lay import Lay
from .link_windows import LinkWindows, SpiralWindows
from .mesh_seal import Inlet, MeshSeal, checked_pressures
from .pressure_map import Frame
from .shapes import AnnularSeal, RectangularSeal

Array = NDArray[np.float64]
#: Sizes between which a seal may lie [m]; others come from a wrong unit of length.
_SIZES = (1e-4, 100.0)
#: Widths of columns of windows on the inner edge of a ring, in widths of windows: below them it is refused, or warned.
_NARROWEST, _NARROW = 0.35, 0.7


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


class Layout(Protocol):
    """Interface of the shapes of seals that studies take."""

    kind: ClassVar[str]
    #: Whether the sampling gives the length of the seal.
    has_length: ClassVar[bool]

    def lay_out(self, windows: Windows) -> SealWindows:
        """Lay windows out over the seal.

        Raises
        ------
        InputError : a size that is not given, or given twice; windows larger than the parts of the seal.
        """
        ...

    def frame(self, size: tuple[float, float]) -> Frame:
        """Coordinates of maps of the pressure on a seal of this shape, of sides, or breadth and length [m]."""
        ...

    def __str__(self) -> str:
        """Name of the seal for people."""
        ...


@dataclass(frozen=True)
class RectangularLayout:
    """A straight strip; it goes on periodically along x2.

    lay : of the windows on the strip, see `Lay`; along x2, as on the face, unless given.
    """

    kind: ClassVar[str] = "rectangular"
    has_length: ClassVar[bool] = True
    lay: Any = "x2"

    def __post_init__(self) -> None:
        lay = Lay.of(self.lay)
        if lay.name == "radial" or lay.file is not None:
            raise InputError("lay", f"'{lay}' on a strip", "x1, x2, a spiral, or {angle = '30 deg'}")
        around = lay.name == "circumferential" or (lay.name == "spiral" and lay.lead == 0)
        object.__setattr__(self, "lay", Lay(name="x2") if around else lay)

    def lay_out(self, windows: Windows) -> SealWindows:
        """Links along the axes of the strip; quadrilaterals where the lay runs between them."""
        (d1, d2), turned = windows.size, self.lay.name == "x1"
        if windows.length is None:
            raise InputError("length", "none", "the length of a rectangular seal")
        straight = self.lay.name in ("x1", "x2", "spiral")
        if not straight:
            d1 = d2 = (d1 * d2) ** 0.5
        elif turned:
            d1, d2 = d2, d1
        breadth = windows.breadth if windows.breadth is not None else windows.rows * windows.size[0]
        cells = max(1, round(breadth / d1)), max(1, round(windows.length / d2))
        size = cells[0] * d1, cells[1] * d2
        if self.lay.name == "spiral":
            _short_lead(self.lay, size[0])
            slope = Spiral(self.lay.lead, self.lay.circumference).tangent(size[1])
            return SpiralWindows(RectangularSeal(size, cells), tangent=(slope,) * cells[0])
        if straight:
            return LinkWindows(RectangularSeal(size, cells), turned)
        return _elements(_strip(size, cells), windows, self.lay)

    @property
    def spiral(self) -> Spiral | None:
        """How the grooves of the face wind, if they do; None for rings."""
        return Spiral(self.lay.lead, self.lay.circumference) if self.lay.name == "spiral" else None

    def frame(self, size: tuple[float, float]) -> Frame:
        """x1 from the inlet, and x2."""
        return Frame.of_strip(size)

    def __str__(self) -> str:
        return "a strip" if self.lay.name == "x2" else f"a strip, lay {self.lay}"


@dataclass(frozen=True)
class AnnularLayout:
    """A ring, which leaks along the radius.

    inner_radius, outer_radius : [m]. inlet : at the "inner" or the "outer" one.
    lay : of the windows on the ring, see `Lay`; "circumferential" unless given.
    """

    kind: ClassVar[str] = "annular"
    has_length: ClassVar[bool] = False
    inner_radius: float = parameter("m", "a length > 0, such as '10 mm'")
    outer_radius: float = parameter("m", "a length > 0, such as '15 mm'")
    inlet: Literal["inner", "outer"] = "inner"
    lay: Any = "circumferential"

    def __post_init__(self) -> None:
        check_parameters(self)
        lay = Lay.of(self.lay)
        object.__setattr__(self, "lay", Lay(name="circumferential") if lay.name == "spiral" and not lay.lead else lay)
        if self.lay.file is not None:
            raise InputError("lay", f"'{self.lay}' on a ring", "a field on a mesh only")
        _short_lead(self.lay, abs(self.outer_radius - self.inner_radius))
        AnnularSeal(self.inner_radius, self.outer_radius, (1, 1), self.inlet)
        _plausible("outer_radius", 2 * self.outer_radius)

    def lay_out(self, windows: Windows) -> SealWindows:
        """Links along radius and angle; quadrilaterals where the lay runs between them."""
        _refuse_sizes(self.kind, windows)
        d1, d2 = windows.size
        along_axes = self.lay.name in ("radial", "circumferential", "spiral")
        if not along_axes:
            d1 = d2 = (d1 * d2) ** 0.5
        elif self.lay.name == "radial":
            d1, d2 = d2, d1
        breadth, middle = self.outer_radius - self.inner_radius, (self.inner_radius + self.outer_radius) / 2
        if breadth < _NARROW * d1:
            sides = " × ".join(to_text(side, "m", 3) for side in windows.size)
            raise InputError("outer_radius", f"a ring {to_text(breadth, 'm', 3)} broad",
                                f"a ring at least as broad as a window, {sides}")  # fmt: skip
        cells = max(1, round(breadth / d1)), max(3, round(2 * pi * middle / d2))
        seal = AnnularSeal(self.inner_radius, self.outer_radius, cells, self.inlet)
        if not along_axes:
            return _elements(_ring(seal), windows, self.lay)
        narrow = 2 * pi * self.inner_radius / (cells[1] * d2)
        given = f"a ring whose {cells[1]} columns of windows are {narrow:.0%} as wide as windows at its inner radius"
        if narrow < _NARROWEST:
            raise InputError("inner_radius", given, f"at least {_NARROWEST:.0%}; a mesh has none of them")
        warnings = (f"{given}: windows there are drawn too close together; a mesh has equal ones",)
        doubts = warnings if narrow < _NARROW else ()
        if self.lay.name == "spiral":
            middles = self.inner_radius + breadth / cells[0] * (np.arange(cells[0]) + 0.5)
            tangent = tuple((self.lay.lead / (2 * pi * (middles if self.inlet == "inner" else middles[::-1]))).tolist())
            return SpiralWindows(seal, warnings=doubts, tangent=tangent)
        return LinkWindows(seal, self.lay.name == "radial", doubts)

    @property
    def circumference(self) -> float:
        """At the middle of the ring [m]."""
        return pi * (self.inner_radius + self.outer_radius)

    @property
    def spiral(self) -> Spiral | None:
        """How the grooves of the face wind at the middle of the ring, if they do."""
        return Spiral(self.lay.lead, self.circumference) if self.lay.name == "spiral" else None

    def frame(self, size: tuple[float, float]) -> Frame:
        """Radius and angle."""
        ends = self.inner_radius, self.outer_radius
        return Frame(ends=ends if self.inlet == "inner" else ends[::-1])

    def __str__(self) -> str:
        radii = " and ".join(to_text(r, "m") for r in (self.inner_radius, self.outer_radius))
        flow = "outwards" if self.inlet == "inner" else "inwards"
        return f"a ring between the radii {radii}, leaking {flow}, lay {self.lay}"


@dataclass(frozen=True)
class MeshLayout:
    """A seal of any plan shape, from a mesh file.

    path : the file, see `MeshSeal`. unit : of its lengths, such as "mm". inlet, outlet : names of boundaries, one or
    several each; all others are closed. Inlets at several pressures are given as {name: pressure [Pa]}.
    lay : of the windows on the seal, see `Lay`. centre : from which "radial", "circumferential" and the maps of the
    pressure are seen [m].
    length : by which leakage is divided [m]; that of the outlet unless given.
    """

    kind: ClassVar[str] = "mesh"
    has_length: ClassVar[bool] = False
    path: Path
    unit: str
    inlet: Inlet
    outlet: str | tuple[str, ...]
    lay: Any = "circumferential"
    centre: tuple[float, float] = (0.0, 0.0)
    length: float | None = None

    def __post_init__(self) -> None:
        to_si(f"1 {self.unit}", "m", "unit")
        if self.length is not None and not (isfinite(self.length) and self.length > 0):
            raise InputError("length", self.length, "a length > 0 [m]")
        object.__setattr__(self, "lay", Lay.of(self.lay, Path(self.path).parent))
        if self.lay.name == "spiral":
            raise InputError(
                "lay", f"'{self.lay}' on a mesh", "a spiral on a strip or a ring, or {field = 'file.vtu:name'}"
            )
        for name in ("inlet", "outlet"):
            names = getattr(self, name)
            if isinstance(names, Mapping):
                object.__setattr__(self, name, checked_pressures(names))
            elif not isinstance(names, str):
                object.__setattr__(self, name, tuple(names))

    @property
    def inlet_pressures(self) -> dict[str, float]:
        """Pressures of the inlets by their names [Pa]; empty where all have that of the scene."""
        return dict(self.inlet) if isinstance(self.inlet, Mapping) else {}

    def lay_out(self, windows: Windows) -> SealWindows:
        """Each element takes the windows that fit into it."""
        _refuse_sizes(self.kind, windows)
        stat = Path(self.path).stat() if Path(self.path).is_file() else None
        stamp = None if stat is None else (stat.st_mtime_ns, stat.st_size)
        inlet = tuple(self.inlet.items()) if isinstance(self.inlet, Mapping) else self.inlet
        seal = _mesh_seal(Path(self.path), inlet, self.outlet, self.unit, stamp)
        _plausible("path", float(np.ptp(seal.points, axis=0).max()), self.unit)
        given = seal.boundaries
        mesh, ends = straightened(seal.mesh, *seal.ends, *(given.facets if given else ()))
        length = self.length or seal.length
        boundaries = replace(given, facets=ends[2:]) if given else None
        size = seal.area / length, length
        laid = ElementSeal(mesh, ends[0], ends[1], size, mesh.p.T[mesh.t.T], boundaries)
        return _elements(laid, windows, self.lay, self.centre, to_si(f"1 {self.unit}", "m", "unit"))

    def frame(self, size: tuple[float, float]) -> Frame:
        """Radius and angle around `centre`."""
        return Frame(centre=self.centre)

    def __str__(self) -> str:
        inlets = ", ".join(f"{name} at {to_text(p, 'Pa')}" for name, p in self.inlet_pressures.items())
        return f"the mesh {Path(self.path).name}, {f'inlets {inlets}, ' if inlets else ''}lay {self.lay}"


@lru_cache(maxsize=2)
def _mesh_seal(path: Path, inlet: Any, outlet: Any, unit: str, stamp: Any) -> MeshSeal:
    """The seal of a mesh file, read once while its time and size (`stamp`) stay; a run lays it out several times."""
    of_pressures = isinstance(inlet, tuple) and isinstance(inlet[0], tuple)
    return MeshSeal(path, dict(inlet) if of_pressures else inlet, outlet, unit)


def _short_lead(lay: Lay, breadth: float) -> None:
    """Refuse a spiral whose groove crosses the seal within a turn."""
    if lay.lead > breadth:
        given = f"{to_text(lay.lead, 'm')} on a seal {to_text(breadth, 'm', 3)} broad"
        raise InputError("lay.lead", given, "at most the breadth: the groove would cross it within a turn")


def _elements(
    seal: ElementSeal, windows: Windows, lay: Lay, centre: tuple[float, float] = (0.0, 0.0), unit: float = 1.0
) -> ElementWindows:
    laid = ElementWindows(seal, windows.size, lay.directions(seal.outlines.mean(axis=1), centre, unit))
    return laid.checked()


def _strip(size: tuple[float, float], cells: tuple[int, int]) -> ElementSeal:
    """A strip of quadrilaterals, periodic along x2."""
    if cells[1] < 3:
        raise InputError("length", f"{cells[1]} windows", "at least 3 where the lay runs between the axes")
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


def _refuse_sizes(kind: str, windows: Windows) -> None:
    for name, value in (("length", windows.length), ("breadth", windows.breadth)):
        if value is not None:
            raise InputError(name, to_text(value, "m"), f"none with a seal of kind {kind}: it has its own")


def _plausible(name: str, size: float, unit: str = "") -> None:
    low, high = _SIZES
    if not low <= size <= high:
        given = f"a seal {to_text(size, 'm', 3)} across" + (f" with the unit '{unit}'" if unit else "")
        raise InputError(name, given, f"from {to_text(low, 'm')} to {to_text(high, 'm')}: is its unit right?")


#: Shapes that a case can choose, by their kind.
LAYOUTS: dict[str, Any] = {layout.kind: layout for layout in (RectangularLayout, AnnularLayout, MeshLayout)}

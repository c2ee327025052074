"""Windows laid out over a seal of some shape: how many are drawn, where they lie, what permeability they make."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
from skfem import MeshQuad
from skfem.mesh import MeshQuad1DG

from ..base.errors import InputError
from ..base.quantities import to_si, to_text
from ..flow.spiral import Spiral
from .element_windows import ElementSeal, ElementWindows, straightened
from .lay import Lay, check_size
from .link_windows import LinkWindows, SpiralWindows
from .mesh_seal import MeshSeal
from .shapes import AnnularSeal, RectangularSeal

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
    cells = max(1, round(breadth / d1)), max(1, round(windows.length / d2))
    size = cells[0] * d1, cells[1] * d2
    if lay.name == "spiral":
        lay.check_lead(size[0])
        slope = Spiral(lay.lead, lay.circumference).tangent(size[1])
        return SpiralWindows(RectangularSeal(size, cells), tangent=(slope,) * cells[0])
    if straight:
        return LinkWindows(RectangularSeal(size, cells), turned)
    return _elements(_strip(size, cells), windows, lay)


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
    cells = max(1, round(breadth / d1)), max(3, round(2 * pi * middle / d2))
    seal = AnnularSeal(inner, outer, cells, inlet)
    if not along_axes:
        return _elements(_ring(seal), windows, lay)
    narrow = 2 * pi * inner / (cells[1] * d2)
    given = f"a ring whose {cells[1]} columns of windows are {narrow:.0%} as wide as windows at its inner radius"
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
    return _elements(laid, windows, lay, centre, to_si(f"1 {unit}", "m", "unit"))


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

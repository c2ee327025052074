"""Tiles of a seal of any shape: finite elements, each of which takes the two permeabilities of a cell of a surface.

The permeabilities of a cell are principal values: k2 along the lay and k1 across it. A strip is a rectangle, periodic
along x2. A ring is the same in (ln r, θ), in which the form of Darcy's law is that of a strip. Any other seal is a
mesh, whose elements share a tile where they are smaller than a cell.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from math import pi

import numpy as np

from ..base import Array, Indices, InputError, Pair, Shape, counted, to_si, to_text
from ..flow.rectangles import FEWEST_COLUMNS, Rectangles
from ..flow.spiral import Spiral
from .lay import Lay, check_size
from .mesh_seal import ElementSeal, MeshSeal, boundaries_without_name, parts_without_flow
from .plane import middles, polygon_areas

#: Most tiles between inlet and outlet.
MOST_ROWS = 1000
#: Least breadth of a seal, and length around its inner radius, in cells and tiles.
_NARROW, _NARROWEST = 0.7, 0.35
#: Number of cells for which an element of a mesh has room from which on it is much larger than a cell, so that the
#: leakage scatters twice as much; and part of the area in such elements from which on that is warned of.
_MUCH_LARGER, _NOTABLE_PART = 4.0, 0.1
#: Relative difference of two breadths that are the same.
_SAME = 1e-6


@dataclass(frozen=True)
class CellSize:
    """Size of the cells of a surface, and the wanted size of a seal.

    Attributes
    ----------
    size : lengths of a cell along x1 and x2 [m].
    rows : number of cells of the surface along x1.
    length, breadth : length and breadth of the seal [m]; None if they are not known.
    most : number of tiles beyond which a part of a strip or a ring stands for the whole, if the seal is alike all
        along; None for the whole seal.
    """

    size: Pair
    rows: int
    length: float | None = None
    breadth: float | None = None
    most: int | None = None

    def columns(self, rows: int, wanted: int) -> int:
        """Return the number of columns of tiles that stand for the wanted columns of the whole seal."""
        return wanted if self.most is None else min(wanted, max(FEWEST_COLUMNS, self.most // rows))


@dataclass(frozen=True, eq=False)
class SealTiles:
    """A seal of tiles, each of which takes a random cell of a surface.

    Attributes
    ----------
    seal : finite elements of the seal.
    lay : array (n, 2), unit vectors along the lay of the elements in the plane of the seal.
    tile : array (n,), number of the tile of each element.
    grid : numbers of rows, from the inlet to the outlet, and of columns of the tiles of a strip or a ring, which are
        numbered row by row; None for meshes.
    in_order : whether each row of tiles takes cells from the row of the surface at the same distance from the inlet.
    tangent : array (n,), tan α of spiral grooves; None without a spiral.
    part : fraction of the length of the seal that the tiles cover.
    warnings : sentences for the user.
    """

    seal: ElementSeal
    lay: Array = field(repr=False)
    tile: Indices = field(repr=False)
    grid: Shape | None = None
    in_order: bool = False
    tangent: Array | None = field(default=None, repr=False)
    part: float = 1.0
    warnings: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """Number of tiles."""
        return int(self.tile.max()) + 1

    @property
    def outlines(self) -> Array:
        """Corners of the elements in the plane of the seal (n, corners, 2) [m]."""
        return self.seal.outlines

    @cached_property
    def once(self) -> Indices:
        """Numbers of the elements without those of the repeated columns of a short strip."""
        if self.grid is None:
            return np.arange(len(self.tile))
        return np.unique(self.tile, return_index=True)[1]

    @property
    def size(self) -> Pair:
        """Breadth and length of the whole seal, without repeated columns [m]."""
        breadth, length = self.seal.size
        return breadth, length * (self.once.size / self.tile.size) / self.part

    @property
    def middles(self) -> Array:
        """Centres of the tiles (tiles, 2) [m]."""
        tile = self.tile[self.once]
        centres = self.outlines[self.once].mean(axis=1)
        return np.stack([np.bincount(tile, x) / np.bincount(tile) for x in centres.T], axis=1)

    def draw(self, cells: Shape, rng: np.random.Generator) -> Indices:
        """Choose a random cell for each tile.

        The columns of tiles are filled one after another, so that a longer seal begins with the tiles of a shorter one.

        Parameters
        ----------
        cells : numbers (m1, m2) of cells of the surface along x1 and x2.
        rng : source of the random numbers.

        Returns
        -------
        Array (tiles,), number of the cell of each tile; cells are numbered row by row.
        """
        m1, m2 = cells
        rows, columns = self.grid or (1, self.count)
        number = rng.random((columns, rows, 2))
        row = (number[..., 0] * m1).astype(np.int64)
        if self.in_order:
            row = np.broadcast_to(np.arange(rows), row.shape)
        column = (number[..., 1] * m2).astype(np.int64)
        return np.ascontiguousarray((row * m2 + column).T).ravel()

    def permeability(self, along_x1: Array, along_x2: Array) -> Array:
        """Return the permeability of the elements from that of the tiles.

        A spiral groove passes all tiles of a row, so that the flow along the lay sees their harmonic mean; the element
        then has k₁ cos²α + k₂ sin²α.

        Parameters
        ----------
        along_x1, along_x2 : arrays (…, tiles), permeabilities k1 and k2 of the tiles [m³].

        Returns
        -------
        Array (…, n, 2) [m³], across and along the lay.
        """
        across, along = along_x1, along_x2
        if self.tangent is None:
            return np.stack([across[..., self.tile], along[..., self.tile]], axis=-1)
        assert self.grid is not None
        in_rows = along.reshape(*along.shape[:-1], *self.grid)
        grooves = np.repeat(along_grooves(in_rows), self.grid[1], axis=-1)
        square = self.tangent**2
        radial = (across[..., self.tile] + square * grooves[..., self.tile]) / (1 + square)
        round_ = (along[..., self.tile] + square * across[..., self.tile]) / (1 + square)
        return np.stack([radial, round_], axis=-1)

    def shown(self, permeability: Array, fluid_pressure: Array) -> tuple[Array, Array]:
        """Return the geometric mean of the permeabilities [m³] of each element (n,), and its fluid pressure [Pa]."""
        at_vertices = fluid_pressure[self.seal.mesh.t]
        return np.sqrt(permeability[:, 0]) * np.sqrt(permeability[:, 1]), at_vertices.mean(axis=0)

    def flux(self, permeability: Array, potential: Array, rate: float) -> Array:
        """Return the volume rate per width (n, 2) [m²/s] at the centre of each element, in the plane of the seal.

        Parameters
        ----------
        permeability : array (n, 2), permeability of the elements across and along the lay [m³].
        potential : potential at the vertices, divided by the density of volume rates [1/s].
        rate : leakage of the seal [m³/s]. The flux is scaled to it; unscaled, it would carry the upper bound.
        """
        corners = self.seal.outlines
        at = np.nan_to_num(potential)[self.seal.mesh.t.T]
        # along two edges of a triangle or both diagonals of a quadrilateral, where differences are those of the middle
        ends, starts = ([1, 2], [0, 0]) if corners.shape[1] == 3 else ([2, 3], [0, 1])
        ways, drops = (of[:, ends] - of[:, starts] for of in (corners, at))
        gradient = np.linalg.solve(ways, drops[..., None])[..., 0]
        axes = _axes(self.lay)
        flux = -np.einsum("ni,nia,nib,nb->na", permeability, axes, axes, gradient)
        power = -float(np.abs(polygon_areas(corners)) @ (flux * gradient).sum(axis=1))
        drop = float(np.ptp(potential[np.isfinite(potential)]))
        return flux * (abs(rate) * drop / power if power > 0 else 0.0)

    def __str__(self) -> str:
        if self.grid is not None:
            return "{} × {} tiles".format(*self.grid)
        return f"{counted(self.count, 'tile')} in {counted(len(self.tile), 'element')}"


def along_grooves(across: Array) -> Array:
    """Return the harmonic mean (…, rows) of the permeabilities of each row (…, rows, columns); 0 if one is 0."""
    with np.errstate(divide="ignore"):
        return 1 / np.mean(1 / across, axis=-1)


def face_tiles(size: Pair, cells: Shape) -> SealTiles:
    """Lay out the cells of a surface of the given size [m] in their own order, with the lay along x2."""
    laid = _strip(size, cells, np.tile([0.0, 1.0], (cells[0] * cells[1], 1)))
    return replace(laid, in_order=True)


def laid_on_strip(cell_size: CellSize, lay: Lay) -> SealTiles:
    """Lay out tiles on a strip; as broad as the surface, its rows are those of the surface."""
    assert cell_size.length is not None
    d1, d2 = _tile_sides(cell_size.size, lay, "x2", "x1")
    of_face = cell_size.rows * cell_size.size[0]
    breadth = of_face if cell_size.breadth is None else cell_size.breadth
    rows = _rows_of(breadth, d1, "breadth", breadth)
    whole = max(1, round(cell_size.length / d2))
    cells = rows, cell_size.columns(rows, whole)
    size = breadth, cells[1] * d2
    wound = lay.name == "spiral"
    laid = _strip(size, cells, (Lay(name="x2") if wound else lay).directions(middles(size, cells)))
    tangent = None
    if wound:
        lay.check_lead(size[0])
        tangent = np.full(len(laid.tile), Spiral(lay.lead, lay.circumference).tangent(whole * d2))
    straight = lay.name == "x2" and rows == cell_size.rows and abs(breadth / of_face - 1) < _SAME
    return replace(laid, in_order=straight, tangent=tangent, part=cells[1] / whole)


def _tile_sides(size: Pair, lay: Lay, along: str, across: str) -> Pair:
    """Return the sides of tiles [m] across and along a seal: those of a cell, turned with its lay, or of a square."""
    if lay.name in (along, "spiral"):
        return size
    side = (size[0] * size[1]) ** 0.5
    return size[::-1] if lay.name == across else (side, side)


def _rows_of(breadth: float, side: float, name: str, given: float) -> int:
    """Return the number of tiles between inlet and outlet; an InputError names the length [m] that is too large."""
    rows = max(1, round(breadth / side))
    if rows > MOST_ROWS:
        expected = f"at most {MOST_ROWS} tiles from inlet to outlet, not {rows}"
        raise InputError(name, to_text(given, "m"), expected)
    return rows


def laid_on_ring(cell_size: CellSize, lay: Lay, radii: Pair, inlet: str) -> SealTiles:
    """Lay out tiles on a ring between two radii [m], in (ln r, θ) from the inlet on."""
    inner, outer = radii
    d1, d2 = _tile_sides(cell_size.size, lay, "circumferential", "radial")
    breadth, middle = outer - inner, (inner + outer) / 2
    if breadth < _NARROW * d1:
        sides = " × ".join(to_text(side, "m", 3) for side in cell_size.size)
        given = f"a ring {to_text(breadth, 'm', 3)} broad"
        raise InputError("outer_radius", given, f"a ring at least as broad as a cell, {sides}")
    rows = _rows_of(breadth, d1, "outer_radius", outer)
    whole = max(FEWEST_COLUMNS, round(2 * pi * middle / d2))
    narrow = 2 * pi * inner / (whole * d2)
    given = f"a ring with {counted(whole, 'column')} of tiles, {narrow:.0%} as wide as cells at its inner radius"
    if narrow < _NARROWEST:
        expected = f"at least {_NARROWEST:.0%}; a mesh has none of them"
        raise InputError("inner_radius", given, expected)
    warnings: tuple[str, ...] = ()
    if narrow < _NARROW:
        warnings = (f"{given}: tiles there are drawn too close together; a mesh has equal ones",)
    wound = lay.name == "spiral"
    alike = wound or lay.name in ("radial", "circumferential")
    cells = rows, cell_size.columns(rows, whole) if alike else whole
    part = cells[1] / whole
    sign = 1.0 if inlet == "inner" else -1.0  # of the way from the inlet along the radius
    radius = np.linspace(inner, outer, cells[0] + 1)[:: int(sign)]
    ring = Rectangles(np.abs(np.log(radius / radius[0])), 2 * pi * part, cells[1])
    plain = ring.plain_mesh

    def polar(points: Array) -> tuple[Array, Array]:
        """Return the radius and the direction from the centre at points (2, …) of the plain mesh."""
        outward = np.array([np.cos(points[1]), np.sin(points[1])])
        return radius[0] * np.exp(sign * points[0]), outward

    r, outward = polar(plain.p)
    outlines = (r * outward).T[plain.t.T]
    at, outward = polar(plain.p[:, plain.t].mean(axis=1))
    direction = (Lay(name="circumferential") if wound else lay).directions((at * outward).T)
    # components along the way from the inlet and along the angle
    around = np.array([-outward[1], outward[0]])
    frame = np.stack([sign * outward, around]).transpose(2, 0, 1)
    along = np.einsum("nab,nb->na", frame, direction)
    return SealTiles(
        seal=ElementSeal(
            ring.mesh,
            *ring.ends,
            size=(breadth, 2 * pi * middle * part),
            outlines=outlines,
            axes=_axes(along),
            rectangles=ring,
        ),
        lay=direction,
        tile=np.arange(len(along)),
        grid=cells,
        in_order=lay.name == "circumferential"
        and cells[0] == cell_size.rows
        and abs(breadth / (cell_size.rows * d1) - 1) < _SAME,
        tangent=lay.lead / (2 * pi * at) if wound else None,
        part=part,
        warnings=warnings,
    )


def laid_on_mesh(
    cell_size: CellSize, lay: Lay, whole: MeshSeal, length: float | None, centre: Pair
) -> SealTiles:
    """Lay out tiles on a mesh: an element is a tile, or shares that of its neighbours where it is smaller than a cell.

    length : length of the seal [m]; None for that of the outlet.
    centre : centre of the lay [m].
    """
    check_size("path", float(np.ptp(whole.points, axis=0).max()), whole.unit)
    mesh, ends = whole.mesh, whole.ends
    along = length or whole.length
    outlines = mesh.p.T[mesh.t.T]
    centres = outlines.mean(axis=1)
    direction = lay.directions(centres, centre, to_si(f"1 {whole.unit}", "m", "unit"))
    size = whole.area / along, along
    seal = ElementSeal(mesh, *ends, size, outlines, _axes(direction))
    side = (cell_size.size[0] * cell_size.size[1]) ** 0.5
    _, tile = np.unique(np.floor(centres / side), axis=0, return_inverse=True)
    warnings = (
        *parts_without_flow(mesh, *ends),
        *boundaries_without_name(mesh),
        *_large_elements(outlines, cell_size.size, whole.unit),
    )
    return SealTiles(seal, direction, tile.ravel(), warnings=warnings)


def _large_elements(outlines: Array, cell_size: Pair, unit: str) -> tuple[str, ...]:
    """Warn of elements that are much larger than cells, each of which takes the permeability of a single cell.

    The leakage of a seal scatters as that of the number of its independent parts. Elements with room for N cells thus
    make it scatter √N times as much as cells of their own size do.

    outlines : array (n, corners, 2) of the corners of the elements [m]. cell_size : sides of a cell [m].
    unit : of the lengths in the mesh.
    """
    areas = np.abs(polygon_areas(outlines))
    room = areas / (cell_size[0] * cell_size[1])
    part = float(areas[room > _MUCH_LARGER].sum() / areas.sum())
    if part <= _NOTABLE_PART:
        return ()
    most = float(room.max())
    sides = dict.fromkeys(to_text(side, "m", 3) for side in cell_size)
    largest = min(cell_size) / to_si(f"1 {unit}", "m", "unit")
    return (
        f"The leakage scatters too much between realisations, up to about {most**0.5:.2g} times: over {part:.0%} of "
        f"the seal, elements of the mesh take one cell of the surface where up to {most:.0f} cells of "
        f"{' × '.join(sides)} have room. Mesh the seal with elements of at most {largest:.2g} {unit}, in gmsh with "
        f"-clmax {largest:.2g}, or use larger cells",
    )


def _strip(size: Pair, cells: Shape, lay: Array) -> SealTiles:
    """Make a strip of rectangles, periodic along x2, with the lay of each (n, 2).

    A periodic mesh has three columns or more; fewer columns are repeated.
    """
    times = -(-FEWEST_COLUMNS // cells[1])
    n1, n2 = cells[0], times * cells[1]
    whole = size[0], times * size[1]
    strip = Rectangles(np.linspace(0.0, size[0], n1 + 1), whole[1], n2)
    tile = np.tile(np.arange(n1 * cells[1]).reshape(cells), (1, times)).ravel()
    seal = ElementSeal(strip.mesh, *strip.ends, whole, strip.outlines, _axes(lay[tile]), strip)
    return SealTiles(seal, lay[tile], tile, cells)


def _axes(lay: Array) -> Array:
    """Return unit vectors across and along the lay (n, 2, 2), from those along it (n, 2)."""
    across = np.stack([lay[:, 1], -lay[:, 0]], axis=1)
    return np.stack([across, lay], axis=1)

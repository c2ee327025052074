"""Cover a seal of any shape with tiles. Each tile takes the permeability of a cell of the surface.

The permeability of a cell has the principal values k1 across the lay and k2 along it. A strip is periodic along x2. A
ring is a strip in the coordinates (ln r, θ), in which Darcy's law has the same form. Any other seal is a mesh, whose
elements share a tile if they are smaller than a cell.
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

#: Largest number of tiles between inlet and outlet.
MOST_ROWS = 1000
#: A ring must be at least this many cells broad. A warning is given if the tiles at its inner radius are narrower than
#: this fraction of a cell, and an error below the smaller fraction.
_NARROW, _NARROWEST = 0.7, 0.35
#: An element of a mesh is called much larger than a cell if it has room for this many cells. The leakage then scatters
#: twice as much as it should.
_MUCH_LARGER = 4.0
#: A warning is given if much larger elements cover more than this fraction of the seal.
_NOTABLE_PART = 0.1
#: Relative difference up to which two breadths are equal.
_SAME = 1e-6


@dataclass(frozen=True)
class CellSize:
    """Size of the cells of a surface, and the wanted size of a seal.

    Attributes
    ----------
    size : tuple of two float
        Sizes of a cell along x1 and x2 [m].
    rows : int
        Number of cells of the surface along x1.
    length, breadth : float or None
        Length and breadth of the seal [m]; None if they are not known.
    most_tiles : int or None
        Largest number of tiles. A longer strip or ring that does not vary along the seal is represented by a part of
        its length. None to cover the whole seal.
    """

    size: Pair
    rows: int
    length: float | None = None
    breadth: float | None = None
    most_tiles: int | None = None

    def columns(self, rows: int, wanted: int) -> int:
        """Return the number of columns to simulate for a seal with the wanted number of columns, see `most_tiles`."""
        return (
            wanted
            if self.most_tiles is None
            else min(wanted, max(FEWEST_COLUMNS, self.most_tiles // rows))
        )


@dataclass(frozen=True, eq=False)
class SealTiles:
    """A seal of tiles, each of which takes a random cell of a surface.

    Attributes
    ----------
    seal : ElementSeal
        Finite elements of the seal.
    lay : array, (n, 2)
        Unit vectors along the lay of the elements, in the plane of the seal.
    tile : array of int, (n,)
        Number of the tile of each element.
    grid : tuple of two int or None
        Numbers of rows (from inlet to outlet) and columns of the tiles of a strip or a ring, which are numbered row by
        row; None for meshes.
    in_order : bool
        Whether each row of tiles takes cells from the row of the surface at the same distance from the inlet.
    tangent : array, (n,), or None
        Tangent of the angle α between spiral grooves and the circumferential direction; None without a spiral.
    part : float
        Fraction of the length of the seal that the tiles cover.
    warnings : tuple of str
        Warnings for the user.
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
    def unrepeated_elements(self) -> Indices:
        """Numbers of the elements, without the repeated columns of a short strip."""
        if self.grid is None:
            return np.arange(len(self.tile))
        return np.unique(self.tile, return_index=True)[1]

    @property
    def size(self) -> Pair:
        """Breadth and length of the whole seal, without repeated columns [m]."""
        breadth, length = self.seal.size
        return breadth, length * (self.unrepeated_elements.size / self.tile.size) / self.part

    @property
    def middles(self) -> Array:
        """Centres of the tiles (tiles, 2) [m]."""
        tile = self.tile[self.unrepeated_elements]
        centres = self.outlines[self.unrepeated_elements].mean(axis=1)
        # a tile of several elements has the mean of their centres
        return np.stack([np.bincount(tile, x) / np.bincount(tile) for x in centres.T], axis=1)

    def choose_cells(self, cells: Shape, rng: np.random.Generator) -> Indices:
        """Choose a random cell for each tile.

        The columns of tiles are filled one after another, so that a longer seal begins with the same cells as a shorter
        one.

        Parameters
        ----------
        cells : tuple of two int
            Numbers of cells of the surface along x1 and x2.
        rng : numpy.random.Generator
            Source of the random numbers.

        Returns
        -------
        array of int, (tiles,)
            Number of the cell of each tile. Cells are numbered row by row.
        """
        m1, m2 = cells
        rows, columns = self.grid or (1, self.count)
        random = rng.random(
            (columns, rows, 2)
        )  # (column of tiles, row of tiles, axis of the cells)
        cell_row = (random[..., 0] * m1).astype(np.int64)
        if self.in_order:
            cell_row = np.broadcast_to(np.arange(rows), cell_row.shape)
        cell_column = (random[..., 1] * m2).astype(np.int64)
        cell = cell_row * m2 + cell_column
        return np.ascontiguousarray(cell.T).ravel()

    def permeability(self, along_x1: Array, along_x2: Array) -> Array:
        """Compute the permeability of the elements from the permeability of the tiles.

        A spiral groove passes through all tiles of a row, so that the flow along it is governed by their harmonic mean.
        In the direction of the leakage the permeability is then k₁ cos²α + k₂ sin²α.

        Parameters
        ----------
        along_x1, along_x2 : arrays, (…, tiles)
            Permeabilities k1 across the lay and k2 along the lay of the tiles [m³].

        Returns
        -------
        array, (…, n, 2)
            Permeability of the elements across and along the lay [m³]. With a spiral the two directions are the radial
            and the circumferential one.
        """
        across, along = along_x1, along_x2
        if self.tangent is None:
            return np.stack([across[..., self.tile], along[..., self.tile]], axis=-1)
        assert self.grid is not None
        columns = self.grid[1]
        in_rows = along.reshape(*along.shape[:-1], *self.grid)  # (…, row, column)
        grooves = np.repeat(harmonic_row_means(in_rows), columns, axis=-1)  # (…, tiles)
        # cos²α = 1 / (1 + tan²α) and sin²α = tan²α / (1 + tan²α)
        square = self.tangent**2
        radial = (across[..., self.tile] + square * grooves[..., self.tile]) / (1 + square)
        circumferential = (along[..., self.tile] + square * across[..., self.tile]) / (1 + square)
        return np.stack([radial, circumferential], axis=-1)

    def element_means(self, permeability: Array, fluid_pressure: Array) -> tuple[Array, Array]:
        """Reduce the result to one number for each element, for pictures.

        Returns the geometric mean of the two permeabilities (n,) [m³], and the mean fluid pressure (n,) [Pa].
        """
        at_vertices = fluid_pressure[self.seal.mesh.t]
        return np.sqrt(permeability[:, 0]) * np.sqrt(permeability[:, 1]), at_vertices.mean(axis=0)

    def flux(self, permeability: Array, potential: Array, rate: float) -> Array:
        """Compute the volume rate per width at the centre of each element.

        Parameters
        ----------
        permeability : array, (n, 2)
            Permeability of the elements across and along the lay [m³].
        potential : array, (n_vertices,)
            Potential at the vertices, divided by the density to which volume rates refer [1/s].
        rate : float
            Leakage of the seal [m³/s]. The flux is scaled to carry it; the unscaled flux would carry the upper bound.

        Returns
        -------
        array, (n, 2)
            Volume rate per width in the plane of the seal [m²/s].
        """
        corners = self.seal.outlines  # (element, corner, 2)
        corner_potential = np.nan_to_num(potential)[self.seal.mesh.t.T]  # (element, corner)
        # The gradient at the centre follows from differences along two edges of a triangle, or along both diagonals of
        # a quadrilateral.
        if corners.shape[1] == 3:
            starts, ends = [0, 0], [1, 2]
        else:
            starts, ends = [0, 1], [2, 3]
        steps = corners[:, ends] - corners[:, starts]
        differences = corner_potential[:, ends] - corner_potential[:, starts]
        gradient = np.linalg.solve(steps, differences[..., None])[..., 0]
        axes = _axes(self.lay)
        flux = -np.einsum("ni,nia,nib,nb->na", permeability, axes, axes, gradient)
        # the dissipation of the flow is its rate times the drop of potential
        dissipation = -float(np.abs(polygon_areas(corners)) @ (flux * gradient).sum(axis=1))
        drop = float(np.ptp(potential[np.isfinite(potential)]))
        return flux * (abs(rate) * drop / dissipation if dissipation > 0 else 0.0)

    def __str__(self) -> str:
        if self.grid is not None:
            return "{} × {} tiles".format(*self.grid)
        return f"{counted(self.count, 'tile')} in {counted(len(self.tile), 'element')}"


def harmonic_row_means(across: Array) -> Array:
    """Return the harmonic mean (…, rows) of permeabilities (…, rows, columns) in each row; 0 if any of them is 0."""
    with np.errstate(divide="ignore"):
        return 1 / np.mean(1 / across, axis=-1)


def face_tiles(size: Pair, cells: Shape) -> SealTiles:
    """Make a strip of all cells of a surface of the given size [m] in their original order, with the lay along x2."""
    lay = np.tile([0.0, 1.0], (cells[0] * cells[1], 1))
    return replace(_strip(size, cells, lay), in_order=True)


def cover_strip(cell_size: CellSize, lay: Lay) -> SealTiles:
    """Cover a strip with tiles.

    If the strip is as broad as the surface and has the same lay, each row of tiles takes cells from the same row of the
    surface (`SealTiles.in_order`).
    """
    assert cell_size.length is not None
    d1, d2 = _tile_sides(cell_size.size, lay, "x2", "x1")
    surface_breadth = cell_size.rows * cell_size.size[0]
    breadth = surface_breadth if cell_size.breadth is None else cell_size.breadth
    rows = _row_count(breadth, d1, "breadth", breadth)
    all_columns = max(1, round(cell_size.length / d2))
    columns = cell_size.columns(rows, all_columns)
    size = breadth, columns * d2
    is_spiral = lay.name == "spiral"
    # the slight angle of a spiral is in `tangent`; its elements are those of a lay along x2
    element_lay = Lay(name="x2") if is_spiral else lay
    directions = element_lay.directions(middles(size, (rows, columns)))
    tiles = _strip(size, (rows, columns), directions)
    tangent = None
    if is_spiral:
        lay.check_lead(breadth)
        spiral = Spiral(lay.lead, lay.circumference)
        tangent = np.full(len(tiles.tile), spiral.tangent(all_columns * d2))
    same_breadth = abs(breadth / surface_breadth - 1) < _SAME
    in_order = lay.name == "x2" and rows == cell_size.rows and same_breadth
    return replace(tiles, in_order=in_order, tangent=tangent, part=columns / all_columns)


def _tile_sides(size: Pair, lay: Lay, along: str, across: str) -> Pair:
    """Return the side lengths of tiles across and along the seal [m] for cells of the given size along x1 and x2 [m].

    `along` and `across` are the names of the lays along and across the seal, for which tiles have the shape of a cell.
    For any other lay they are squares with the area of a cell.
    """
    if lay.name in (along, "spiral"):
        return size
    if lay.name == across:
        return size[::-1]
    side = (size[0] * size[1]) ** 0.5
    return side, side


def _row_count(breadth: float, side: float, name: str, given: float) -> int:
    """Return the number of tiles between inlet and outlet.

    Raises InputError if there are too many. The message names the length `given` [m] of the parameter `name`.
    """
    rows = max(1, round(breadth / side))
    if rows > MOST_ROWS:
        expected = f"at most {MOST_ROWS} tiles from inlet to outlet, not {rows}"
        raise InputError(name, to_text(given, "m"), expected)
    return rows


def cover_ring(cell_size: CellSize, lay: Lay, radii: Pair, inlet: str) -> SealTiles:
    """Cover a ring between two radii [m] with tiles, in the coordinates (ln r, θ), beginning at the inlet.

    Raises InputError if the ring is narrower than a cell, or so small that its innermost tiles become very narrow.
    """
    inner, outer = radii
    d1, d2 = _tile_sides(cell_size.size, lay, "circumferential", "radial")
    breadth, middle = outer - inner, (inner + outer) / 2
    if breadth < _NARROW * d1:
        sides = " × ".join(to_text(side, "m", 3) for side in cell_size.size)
        given = f"a ring {to_text(breadth, 'm', 3)} broad"
        raise InputError("outer_radius", given, f"a ring at least as broad as a cell, {sides}")
    rows = _row_count(breadth, d1, "outer_radius", outer)
    all_columns = max(FEWEST_COLUMNS, round(2 * pi * middle / d2))
    narrow = 2 * pi * inner / (all_columns * d2)  # width of tiles at the inner radius over d2
    given = f"a ring with {counted(all_columns, 'column')} of tiles, {narrow:.0%} as wide as cells at its inner radius"
    if narrow < _NARROWEST:
        expected = f"at least {_NARROWEST:.0%}; a mesh has none of them"
        raise InputError("inner_radius", given, expected)
    warnings: tuple[str, ...] = ()
    if narrow < _NARROW:
        warnings = (f"{given}: tiles there are drawn too close together; a mesh has equal ones",)
    is_spiral = lay.name == "spiral"
    # a part of the ring can stand for the whole only if the lay does not vary around it
    columns = all_columns
    if is_spiral or lay.name in ("radial", "circumferential"):
        columns = cell_size.columns(rows, all_columns)
    part = columns / all_columns
    sign = 1.0 if inlet == "inner" else -1.0  # direction of the flow along the radius
    radius = np.linspace(inner, outer, rows + 1)[:: int(sign)]  # from inlet to outlet
    ring = Rectangles(np.abs(np.log(radius / radius[0])), 2 * pi * part, columns)
    plain = ring.plain_mesh

    def polar(points: Array) -> tuple[Array, Array]:
        """Return radius and radial unit vector (2, …) at points (|ln r/r₀|, θ) of shape (2, …)."""
        outward = np.array([np.cos(points[1]), np.sin(points[1])])
        return radius[0] * np.exp(sign * points[0]), outward

    vertex_radius, outward = polar(plain.p)
    outlines = (vertex_radius * outward).T[plain.t.T]
    centre_radius, outward = polar(plain.p[:, plain.t].mean(axis=1))
    # the slight angle of a spiral is in `tangent`; its elements are those of a circumferential lay
    element_lay = Lay(name="circumferential") if is_spiral else lay
    direction = element_lay.directions((centre_radius * outward).T)  # (n, 2) in the plane
    # components of the lay in the coordinates of the mesh: along the flow and along the angle
    around = np.array([-outward[1], outward[0]])
    local_axes = np.stack([sign * outward, around]).transpose(2, 0, 1)  # (element, axis, 2)
    lay_in_mesh = np.einsum("nab,nb->na", local_axes, direction)
    seal = ElementSeal(
        ring.mesh,
        *ring.ends,
        size=(breadth, 2 * pi * middle * part),
        outlines=outlines,
        axes=_axes(lay_in_mesh),
        rectangles=ring,
    )
    same_breadth = abs(breadth / (cell_size.rows * d1) - 1) < _SAME
    in_order = lay.name == "circumferential" and rows == cell_size.rows and same_breadth
    return SealTiles(
        seal=seal,
        lay=direction,
        tile=np.arange(len(direction)),
        grid=(rows, columns),
        in_order=in_order,
        tangent=lay.lead / (2 * pi * centre_radius) if is_spiral else None,
        part=part,
        warnings=warnings,
    )


def cover_mesh(
    cell_size: CellSize, lay: Lay, mesh_seal: MeshSeal, length: float | None, centre: Pair
) -> SealTiles:
    """Cover a mesh with tiles. Elements that are smaller than a cell share a tile with their neighbours.

    Parameters
    ----------
    cell_size : CellSize
        Size of the cells of the surface.
    lay : Lay
        Direction of the lay on the seal.
    mesh_seal : MeshSeal
        Seal on a mesh.
    length : float or None
        Length of the seal [m]; None to take the length of the outlet.
    centre : tuple of two float
        Centre of a radial or circumferential lay [m].
    """
    check_size("path", float(np.ptp(mesh_seal.points, axis=0).max()), mesh_seal.unit)
    mesh, ends = mesh_seal.mesh, mesh_seal.ends
    outlines = mesh.p.T[mesh.t.T]  # (element, corner, 2)
    centres = outlines.mean(axis=1)
    direction = lay.directions(centres, centre, to_si(f"1 {mesh_seal.unit}", "m", "unit"))
    seal_length = length or mesh_seal.length
    mean_breadth = mesh_seal.area / seal_length
    seal = ElementSeal(mesh, *ends, (mean_breadth, seal_length), outlines, _axes(direction))
    # elements whose centres fall into the same square, as large as a cell, share a tile
    side = (cell_size.size[0] * cell_size.size[1]) ** 0.5
    _, tile = np.unique(np.floor(centres / side), axis=0, return_inverse=True)
    warnings = (
        *parts_without_flow(mesh, *ends),
        *boundaries_without_name(mesh),
        *_large_elements(outlines, cell_size.size, mesh_seal.unit),
    )
    return SealTiles(seal, direction, tile.ravel(), warnings=warnings)


def _large_elements(outlines: Array, cell_size: Pair, unit: str) -> tuple[str, ...]:
    """Warn if elements are much larger than cells, because each element takes the permeability of a single cell.

    The scatter of the leakage is inversely proportional to the square root of the number of independent tiles.
    Elements with room for N cells therefore increase the scatter √N times.

    Parameters
    ----------
    outlines : array, (n, corners, 2)
        Corners of the elements [m].
    cell_size : tuple of two float
        Side lengths of a cell [m].
    unit : str
        Unit of the coordinates in the mesh file.
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
    """Make tiles of a periodic strip of the given size [m], with the lay (tiles, 2) of each tile.

    A periodic mesh needs `FEWEST_COLUMNS` columns; fewer columns are repeated. Repeated elements share a tile.
    """
    times = -(-FEWEST_COLUMNS // cells[1])  # rounded up
    n1, n2 = cells[0], times * cells[1]
    repeated_size = size[0], times * size[1]
    strip = Rectangles(np.linspace(0.0, size[0], n1 + 1), repeated_size[1], n2)
    tile = np.tile(np.arange(n1 * cells[1]).reshape(cells), (1, times)).ravel()
    axes = _axes(lay[tile])
    seal = ElementSeal(strip.mesh, *strip.ends, repeated_size, strip.outlines, axes, strip)
    return SealTiles(seal, lay[tile], tile, cells)


def _axes(lay: Array) -> Array:
    """Return unit vectors across and along the lay (n, axis, 2), from unit vectors along the lay (n, 2)."""
    across = np.stack([lay[:, 1], -lay[:, 0]], axis=1)
    return np.stack([across, lay], axis=1)

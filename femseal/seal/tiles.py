"""Cover a seal of any shape with tiles, which take the permeabilities of cells of the surface.

The permeability of a cell has the principal values k1 across the lay and k2 along the lay. A strip is periodic along
x2. A ring is treated as a strip in the coordinates (ln r, θ), in which Darcy's law has the same form as on a plane
strip. Seals of other shapes are given by a mesh. If the elements of the mesh are smaller than a cell of the surface,
neighbouring elements share a tile.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from math import pi
from typing import NamedTuple

import numpy as np

from ..base import Array, Indices, InputError, Pair, Shape, counted, to_si, to_text
from ..flow.rectangles import FEWEST_COLUMNS, Rectangles
from ..flow.spiral import Spiral
from .lay import Lay, check_size
from .mesh_seal import ElementSeal, MeshSeal, boundaries_without_name, parts_without_flow
from .plane import middles, polygon_areas

#: Largest number of tiles between inlet and outlet.
MOST_ROWS = 1000
#: Smallest width of a ring, as a multiple of the width of a cell. A warning is given if the width of the tiles at the
#: inner radius of the ring is less than the first multiple of the width of a cell. An error is raised if this width is
#: less than the second multiple.
_NARROW, _NARROWEST = 0.7, 0.35
#: An element of a mesh counts as much larger than a cell if its area is more than this many times the area of a cell.
#: With elements of this size, the leakage scatters twice as much as with elements of the size of a cell.
_MUCH_LARGER = 4.0
#: A warning is given if much larger elements cover more than this fraction of the seal.
_NOTABLE_PART = 0.1
#: Relative difference up to which two widths count as equal.
_SAME = 1e-6


@dataclass(frozen=True)
class CellSize:
    """Size of the cells of a surface, and the required size of the seal.

    Attributes
    ----------
    size : tuple of two float
        Side lengths of a cell along x1 and x2 [m].
    rows : int
        Number of cells of the surface along x1.
    length, breadth : float or None
        Length and width of the seal [m]; None if not given.
    most_tiles : int or None
        Largest number of tiles; None to cover the whole length of the seal. If a strip or ring with a uniform lay needs
        more tiles, only a part of its length is covered.
    """

    size: Pair
    rows: int
    length: float | None = None
    breadth: float | None = None
    most_tiles: int | None = None

    def covered_columns(self, rows: int, columns: int) -> int:
        """Return how many columns of tiles are used, so that the seal has at most `most_tiles` tiles.

        rows, columns : numbers of rows and of columns of tiles of the whole seal.
        """
        if self.most_tiles is None:
            return columns
        return min(columns, max(FEWEST_COLUMNS, self.most_tiles // rows))


@dataclass(frozen=True, eq=False)
class SealTiles:
    """A seal that is covered with tiles. In a realisation, each tile takes a random cell of a surface.

    Attributes
    ----------
    seal : ElementSeal
        Finite elements of the seal.
    lay : array, (n, 2)
        Unit vector along the lay in each element, in the plane of the seal.
    tile : array of int, (n,)
        Index of the tile to which each element belongs.
    grid : tuple of two int or None
        Numbers of rows and columns of the tiles of a strip or a ring; None for meshes. The tiles are numbered row by
        row, from the inlet to the outlet.
    in_order : bool
        Whether a row of tiles takes only cells from the row of the surface at the same distance from the inlet.
    tangent : array, (n,), or None
        Tangent of the angle α between the spiral grooves and the circumferential direction in each element; None for a
        lay that is not a spiral.
    part : float
        Length that is covered with tiles, divided by the length of the seal.
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
        """Indices of all elements except the copies that `_strip` adds to a short strip."""
        if self.grid is None:
            return np.arange(len(self.tile))
        # the first element of each tile
        _, first_elements = np.unique(self.tile, return_index=True)
        return first_elements

    @property
    def size(self) -> Pair:
        """Width and length of the whole seal [m], even if the tiles cover only a part of the length."""
        breadth, length = self.seal.size
        unrepeated_fraction = self.unrepeated_elements.size / self.tile.size
        return breadth, length * unrepeated_fraction / self.part

    @property
    def middles(self) -> Array:
        """Centres of the tiles (tiles, 2) [m]."""
        tile = self.tile[self.unrepeated_elements]
        centres = self.outlines[self.unrepeated_elements].mean(axis=1)
        # the centre of a tile with several elements is the mean of the centres of these elements
        element_count = np.bincount(tile)
        return np.stack([np.bincount(tile, x) / element_count for x in centres.T], axis=1)

    def choose_cells(self, cells: Shape, rng: np.random.Generator) -> Indices:
        """Choose a random cell for each tile.

        The random numbers are assigned to the tiles column by column, so that a longer seal begins with the same cells
        as a shorter seal.

        Parameters
        ----------
        cells : tuple of two int
            Numbers of cells of the surface along x1 and x2.
        rng : numpy.random.Generator
            Source of the random numbers.

        Returns
        -------
        array of int, (tiles,)
            Index of the cell that each tile takes. The cells of the surface are numbered row by row.
        """
        cell_rows, cell_columns = cells
        rows, columns = self.grid or (1, self.count)
        # numbers in [0, 1), with the axes (column of tiles, row of tiles, row or column of the cell)
        random = rng.random((columns, rows, 2))
        cell_row = (random[..., 0] * cell_rows).astype(np.int64)
        if self.in_order:
            cell_row = np.broadcast_to(np.arange(rows), cell_row.shape)
        cell_column = (random[..., 1] * cell_columns).astype(np.int64)
        cell = cell_row * cell_columns + cell_column
        return np.ascontiguousarray(cell.T).ravel()  # row by row, as tiles are numbered

    def permeability(self, along_x1: Array, along_x2: Array) -> Array:
        """Compute the permeability of the elements from the permeability of the tiles.

        A spiral groove passes through all tiles of a row, so that its permeability is limited by the tightest tiles.
        The permeability along a spiral groove is therefore the harmonic mean k_groove of k2 over the row. In the
        direction of the leakage, the permeability of a tile is k1 cos²α + k_groove sin²α, where α is the angle between
        the spiral groove and the circumferential direction.

        Parameters
        ----------
        along_x1, along_x2 : arrays, (…, tiles)
            Permeabilities of the tiles, k1 across and k2 along the lay [m³]. They are the permeabilities along x1 and
            x2 of the cells that the tiles take.

        Returns
        -------
        array, (…, n, 2)
            Permeability of the elements across and along the lay [m³]. For a spiral lay, the two directions are the
            radial and the circumferential direction.
        """
        k1 = along_x1[..., self.tile]  # (…, element)
        k2 = along_x2[..., self.tile]
        if self.tangent is None:
            return np.stack([k1, k2], axis=-1)
        assert self.grid is not None
        columns = self.grid[1]
        in_rows = along_x2.reshape(*along_x2.shape[:-1], *self.grid)  # (…, row, column)
        k_groove = np.repeat(harmonic_row_means(in_rows), columns, axis=-1)  # (…, tile)
        # cos²α = 1 / (1 + tan²α) and sin²α = tan²α / (1 + tan²α)
        tan2 = self.tangent**2
        radial = (k1 + tan2 * k_groove[..., self.tile]) / (1 + tan2)  # k1 cos²α + k_groove sin²α
        circumferential = (k2 + tan2 * k1) / (1 + tan2)  # k2 cos²α + k1 sin²α
        return np.stack([radial, circumferential], axis=-1)

    def element_means(self, permeability: Array, fluid_pressure: Array) -> tuple[Array, Array]:
        """Average the permeability (n, 2) [m³] and the fluid pressure (n_vertices,) [Pa] over each element.

        Returns the geometric mean of the permeabilities across and along the lay (n,) [m³], and the mean of the fluid
        pressures at the corners (n,) [Pa].
        """
        at_vertices = fluid_pressure[self.seal.mesh.t]
        return np.sqrt(permeability[:, 0]) * np.sqrt(permeability[:, 1]), at_vertices.mean(axis=0)

    def flux(self, permeability: Array, potential: Array, rate: float) -> Array:
        """Compute the volume flow rate per unit width at the centre of each element.

        Parameters
        ----------
        permeability : array, (n, 2)
            Permeability of the elements across and along the lay [m³].
        potential : array, (n_vertices,)
            Pressure potential at the vertices, divided by the reference density of the fluid [1/s].
        rate : float
            Leakage of the seal [m³/s]. The returned flux is scaled, so that the total flow through the seal is `rate`.
            Without scaling, the total flow would be the upper bound of the leakage.

        Returns
        -------
        array, (n, 2)
            Volume flow rate per unit width, as a vector in the plane of the seal [m²/s].
        """
        corners = self.seal.outlines  # (element, corner, 2)
        corner_potential = np.nan_to_num(potential)[self.seal.mesh.t.T]  # (element, corner)
        # The gradient g of the potential at the centre is computed from the differences of the potential along two
        # lines, step · g = difference. The two lines are two edges of a triangle, or the diagonals of a quadrilateral.
        if corners.shape[1] == 3:
            starts, ends = [0, 0], [1, 2]
        else:
            starts, ends = [0, 1], [2, 3]
        steps = corners[:, ends] - corners[:, starts]  # (element, line, 2)
        differences = corner_potential[:, ends] - corner_potential[:, starts]  # (element, line)
        gradient = np.linalg.solve(steps, differences[..., None])[..., 0]  # (element, 2)
        # flux = −K·gradient with K = Σ k_i e_i e_iᵀ, where e_0 and e_1 are the unit vectors across and along the lay.
        # Indices of einsum: n element, i axis of the lay, a and b components in the plane.
        axes = _axes(self.lay)
        flux = -np.einsum("ni,nia,nib,nb->na", permeability, axes, axes, gradient)
        # the flow rate is the dissipation divided by the difference of the potential between inlet and outlet
        dissipation = -float(np.abs(polygon_areas(corners)) @ (flux * gradient).sum(axis=1))
        drop = float(np.ptp(potential[np.isfinite(potential)]))
        if not dissipation > 0:
            return 0.0 * flux
        return flux * (abs(rate) * drop / dissipation)

    def __str__(self) -> str:
        if self.grid is not None:
            return "{} × {} tiles".format(*self.grid)
        return f"{counted(self.count, 'tile')} in {counted(len(self.tile), 'element')}"


def harmonic_row_means(permeability: Array) -> Array:
    """Return the harmonic mean (…, rows) of permeabilities (…, rows, columns) over each row; 0 if any value is 0."""
    with np.errstate(divide="ignore"):
        return 1 / np.mean(1 / permeability, axis=-1)


def face_tiles(size: Pair, cells: Shape) -> SealTiles:
    """Cover a strip of a given size [m] with all cells of a surface in their original order, with the lay along x2."""
    lay = np.tile([0.0, 1.0], (cells[0] * cells[1], 1))
    return replace(_strip(size, cells, lay), in_order=True)


def cover_strip(cell_size: CellSize, lay: Lay) -> SealTiles:
    """Cover a strip with tiles.

    If the strip and the surface have the same width and the same lay, each row of tiles takes only cells from the
    corresponding row of the surface (`SealTiles.in_order`).
    """
    assert cell_size.length is not None
    # sides of the tiles across (d1) and along the seal (d2)
    d1, d2 = _tile_sides(cell_size.size, lay, "x2", "x1")
    surface_breadth = cell_size.rows * cell_size.size[0]
    breadth = surface_breadth if cell_size.breadth is None else cell_size.breadth
    rows = _row_count(breadth, d1, "breadth", breadth)
    # numbers of columns of tiles: first of the whole strip, then of the part that is covered
    all_columns = max(1, round(cell_size.length / d2))
    columns = cell_size.covered_columns(rows, all_columns)
    size = breadth, columns * d2  # size of the covered part
    is_spiral = lay.name == "spiral"
    # a spiral deviates little from x2: the elements have a lay along x2, and `tangent` contains the deviation
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
    """Return the side lengths of tiles across and along the seal [m].

    If the lay is along or across the seal, the tiles have the shape of a cell. For any other lay, the tiles are squares
    with the area of a cell.

    size : sides of a cell along x1 and x2 [m].
    along, across : names of the lays that are parallel and perpendicular to the seal, such as "x2" and "x1" on a strip.
    """
    if lay.name in (along, "spiral"):
        return size
    if lay.name == across:
        return size[::-1]
    side = (size[0] * size[1]) ** 0.5
    return side, side


def _row_count(breadth: float, side: float, name: str, given: float) -> int:
    """Return the number of tiles between inlet and outlet; raise InputError if the number is too large.

    breadth : width of the seal from inlet to outlet [m].
    side : side length of a tile across the seal [m].
    name, given : name and value [m] of the parameter that determines the width of the seal, for the message.
    """
    rows = max(1, round(breadth / side))
    if rows > MOST_ROWS:
        expected = f"at most {MOST_ROWS} tiles from inlet to outlet, not {rows}"
        raise InputError(name, to_text(given, "m"), expected)
    return rows


def cover_ring(cell_size: CellSize, lay: Lay, radii: Pair, inlet: str) -> SealTiles:
    """Cover a ring between two radii [m] with tiles, beginning at the inlet.

    The mesh of the ring has the coordinates (|ln r/r₀|, θ), where r₀ is the radius of the inlet. Raises InputError if
    the ring is narrower than a cell, or if the innermost tiles of a small ring are much narrower than a cell.
    """
    inner, outer = radii
    # sides of the tiles across and along the seal
    d1, d2 = _tile_sides(cell_size.size, lay, "circumferential", "radial")
    breadth, middle = outer - inner, (inner + outer) / 2
    if breadth < _NARROW * d1:
        sides = " × ".join(to_text(side, "m", 3) for side in cell_size.size)
        given = f"a ring {to_text(breadth, 'm', 3)} wide"
        raise InputError("outer_radius", given, f"a ring at least as wide as a cell, {sides}")
    rows = _row_count(breadth, d1, "outer_radius", outer)
    all_columns = max(FEWEST_COLUMNS, round(2 * pi * middle / d2))
    warnings = _check_innermost_tiles(inner, all_columns, d2)
    is_spiral = lay.name == "spiral"
    # a part of the ring can stand for the whole ring only if the lay does not vary around the ring
    columns = all_columns
    if is_spiral or lay.name in ("radial", "circumferential"):
        columns = cell_size.covered_columns(rows, all_columns)
    part = columns / all_columns
    geometry = _ring_geometry(radii, inlet, (rows, columns), part)
    # a spiral deviates little from the circumferential direction: the elements have a circumferential lay, and
    # `tangent` contains the deviation
    element_lay = Lay(name="circumferential") if is_spiral else lay
    direction = element_lay.directions(geometry.centres)  # (n, 2) in the plane
    lay_in_mesh = np.einsum("nab,nb->na", geometry.mesh_axes, direction)
    rectangles = geometry.rectangles
    seal = ElementSeal(
        rectangles.mesh,
        *rectangles.ends,
        size=(breadth, 2 * pi * middle * part),
        outlines=geometry.outlines,
        axes=_axes(lay_in_mesh),
        rectangles=rectangles,
    )
    same_breadth = abs(breadth / (cell_size.rows * d1) - 1) < _SAME
    in_order = lay.name == "circumferential" and rows == cell_size.rows and same_breadth
    return SealTiles(
        seal=seal,
        lay=direction,
        tile=np.arange(len(direction)),
        grid=(rows, columns),
        in_order=in_order,
        tangent=lay.lead / (2 * pi * geometry.centre_radii) if is_spiral else None,
        part=part,
        warnings=warnings,
    )


def _check_innermost_tiles(inner: float, columns: int, side: float) -> tuple[str, ...]:
    """Warn if the tiles at the inner radius are narrower than cells; raise InputError if they are much narrower.

    inner : inner radius of the ring [m].
    columns : number of tiles around the ring.
    side : side length of a cell along the ring [m].
    """
    relative_width = 2 * pi * inner / (columns * side)
    count = counted(columns, "column")
    given = (
        f"a ring with {count} of tiles, {relative_width:.0%} as wide as cells at its inner radius"
    )
    if relative_width < _NARROWEST:
        expected = f"at least {_NARROWEST:.0%}; a mesh can have tiles of equal width"
        raise InputError("inner_radius", given, expected)
    if relative_width < _NARROW:
        return (
            f"{given}: the tiles at the inner radius are too narrow; a mesh can have tiles of equal width",
        )
    return ()


class _RingGeometry(NamedTuple):
    """Elements of a ring, in the coordinates of its mesh and in the plane of the seal.

    rectangles : rectangular elements in the mesh coordinates (|ln r/r₀|, θ), where r₀ is the radius of the inlet.
    outlines : corners of the elements in the plane of the seal (n, 4, 2) [m].
    centres : centres of the elements in the plane of the seal (n, 2) [m].
    centre_radii : radii of the centres of the elements (n,) [m].
    mesh_axes : for each element, unit vectors in the plane of the seal along the two mesh coordinates (n, axis, 2).
    """

    rectangles: Rectangles
    outlines: Array
    centres: Array
    centre_radii: Array
    mesh_axes: Array


def _ring_geometry(radii: Pair, inlet: str, cells: Shape, part: float) -> _RingGeometry:
    """Divide a ring, or a part of a ring, into rows and columns of elements; the first row is at the inlet.

    radii : inner and outer radius [m].
    inlet : radius at which the fluid enters, "inner" or "outer".
    cells : numbers of rows and columns.
    part : fraction of the circumference that is divided into columns.
    """
    rows, columns = cells
    # 1 if the radius increases in the direction of the flow, −1 if it decreases
    sign = 1.0 if inlet == "inner" else -1.0
    # radii of the row boundaries, from inlet to outlet
    row_radii = np.linspace(*radii, rows + 1)
    if inlet == "outer":
        row_radii = row_radii[::-1]
    inlet_radius = row_radii[0]
    rectangles = Rectangles(np.abs(np.log(row_radii / inlet_radius)), 2 * pi * part, columns)
    mesh = rectangles.plain_mesh
    vertex_radii, vertex_directions = _radius_and_direction(mesh.p, inlet_radius, sign)
    vertices = (vertex_radii * vertex_directions).T  # in the plane, (vertex, 2)
    outlines = vertices[mesh.t.T]  # (element, corner, 2)
    # the mesh coordinates of a centre are the means of the mesh coordinates of the corners, (2, element)
    centre_coordinates = mesh.p[:, mesh.t].mean(axis=1)
    centre_radii, outward = _radius_and_direction(centre_coordinates, inlet_radius, sign)
    centres = (centre_radii * outward).T
    # directions in which the mesh coordinates |ln r/r₀| and θ increase, (2, element) each
    downstream = sign * outward
    around = np.array([-outward[1], outward[0]])
    mesh_axes = np.stack([downstream, around]).transpose(2, 0, 1)  # (element, axis, 2)
    return _RingGeometry(rectangles, outlines, centres, centre_radii, mesh_axes)


def _radius_and_direction(points: Array, inlet_radius: float, sign: float) -> tuple[Array, Array]:
    """Return the radius (n,) [m] and the radial unit vector (2, n) at points (2, n) of the mesh of a ring.

    points : mesh coordinates (|ln r/r₀|, θ) of the points, where r₀ is the inlet radius.
    inlet_radius : radius r₀ of the inlet [m].
    sign : 1 if the inlet is at the inner radius, −1 if the inlet is at the outer radius.
    """
    outward = np.array([np.cos(points[1]), np.sin(points[1])])
    return inlet_radius * np.exp(sign * points[0]), outward


def cover_mesh(
    cell_size: CellSize, lay: Lay, mesh_seal: MeshSeal, length: float | None, centre: Pair
) -> SealTiles:
    """Cover a mesh with tiles. Neighbouring elements share a tile if they are smaller than a cell.

    Parameters
    ----------
    cell_size : CellSize
        Size of the cells of the surface.
    lay : Lay
        Direction of the lay on the seal.
    mesh_seal : MeshSeal
        Seal on a mesh.
    length : float or None
        Length of the seal [m]; None to use the length of the outlet.
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
    # elements whose centres lie in the same square of a grid share a tile; a square has the area of a cell
    side = (cell_size.size[0] * cell_size.size[1]) ** 0.5
    _, tile = np.unique(np.floor(centres / side), axis=0, return_inverse=True)
    warnings = (
        *parts_without_flow(mesh, *ends),
        *boundaries_without_name(mesh),
        *_large_elements(outlines, cell_size.size, mesh_seal.unit),
    )
    return SealTiles(seal, direction, tile.ravel(), warnings=warnings)


def _large_elements(outlines: Array, cell_size: Pair, unit: str) -> tuple[str, ...]:
    """Warn if elements of a mesh are much larger than cells of the surface.

    Each element takes the permeability of a single cell. The standard deviation of the leakage is inversely
    proportional to the square root of the number of independent tiles. If the area of the elements is N times the area
    of a cell, the standard deviation is therefore too large by the factor √N.

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
    cells_per_element = areas / (cell_size[0] * cell_size[1])
    part = float(areas[cells_per_element > _MUCH_LARGER].sum() / areas.sum())
    if part <= _NOTABLE_PART:
        return ()
    most_cells = float(cells_per_element.max())
    sides = dict.fromkeys(to_text(side, "m", 3) for side in cell_size)
    element_size = min(cell_size) / to_si(f"1 {unit}", "m", "unit")
    return (
        f"The leakage scatters too much between realisations, up to about {most_cells**0.5:.2g} times: over {part:.0%} "
        f"of the seal, elements of the mesh take one cell of the surface where up to {most_cells:.0f} cells of "
        f"{' × '.join(sides)} have room. Mesh the seal with elements of at most {element_size:.2g} {unit}, in gmsh "
        f"with -clmax {element_size:.2g}, or use larger cells",
    )


def _strip(size: Pair, cells: Shape, lay: Array) -> SealTiles:
    """Create a periodic strip of rectangular tiles.

    A periodic mesh needs at least `FEWEST_COLUMNS` columns. If the strip has fewer columns, the mesh contains several
    copies of the strip along its length. All copies of an element of the strip belong to the same tile.

    size : width and length of the strip [m].
    cells : numbers of rows and columns of tiles.
    lay : unit vector along the lay for each tile (tiles, 2).
    """
    repetitions = -(-FEWEST_COLUMNS // cells[1])  # rounded up
    n1, n2 = cells[0], repetitions * cells[1]
    repeated_size = size[0], repetitions * size[1]
    strip = Rectangles(np.linspace(0.0, size[0], n1 + 1), repeated_size[1], n2)
    # index of the tile of each element, row by row; the indices are repeated in the same way as the columns
    tile = np.tile(np.arange(n1 * cells[1]).reshape(cells), (1, repetitions)).ravel()
    axes = _axes(lay[tile])
    seal = ElementSeal(strip.mesh, *strip.ends, repeated_size, strip.outlines, axes, strip)
    return SealTiles(seal, lay[tile], tile, cells)


def _axes(lay: Array) -> Array:
    """Return unit vectors across and along the lay, (n, axis, 2), for unit vectors along the lay (n, 2)."""
    across = np.stack([lay[:, 1], -lay[:, 0]], axis=1)
    return np.stack([across, lay], axis=1)

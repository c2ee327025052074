"""Cover strips, rings and meshes with tiles.

A strip is periodic along x2. A ring is treated as a strip in the coordinates (ln r, θ), in which Darcy's law has the
same form as on a plane strip. Seals of other shapes are given by a mesh. If the elements of the mesh are smaller than a
cell of the surface, neighbouring elements share a tile.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import NamedTuple

import numpy as np

from ..base import Array, InputError, Pair, Shape, counted, to_si, to_text
from ..flow.rectangles import FEWEST_COLUMNS, Rectangles
from ..flow.spiral import Spiral
from .element_seal import ElementSeal
from .input_checks import check_size
from .lay import Lay
from .mesh_checks import boundaries_without_name, parts_without_flow
from .mesh_seal import MeshSeal
from .plane import middles, polygon_areas
from .ring import Ring
from .tiles import CellSize, SealTiles, lay_axes, strip_tiles

#: Largest number of tiles between inlet and outlet.
MOST_ROWS = 1000
#: Two limits for the width of the tiles at the inner radius of a ring, as fractions of the width of a cell. Narrower
#: tiles lead to a warning below the first limit, and to an error below the second.
_NARROW, _NARROWEST = 0.7, 0.35
#: An element of a mesh counts as much larger than a cell if its area is more than this many times the area of a cell.
#: With elements of this size, the leakage scatters twice as much as with elements of the size of a cell.
_MUCH_LARGER = 4.0
#: A warning is given if much larger elements cover more than this fraction of the seal.
_NOTABLE_PART = 0.1
#: Relative difference up to which two widths count as equal.
_SAME = 1e-6


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
    tiles = strip_tiles(size, (rows, columns), directions)
    tangent = None
    if is_spiral:
        lay.check_lead(breadth)
        spiral = Spiral(lay.lead, lay.circumference)
        tangent = np.full(len(tiles.tile), spiral.tangent(all_columns * d2))
    same_breadth = abs(breadth / surface_breadth - 1) < _SAME
    in_order = lay.name == "x2" and rows == cell_size.rows and same_breadth
    return replace(
        tiles, in_order=in_order, tangent=tangent, covered_fraction=columns / all_columns
    )


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


def cover_ring(cell_size: CellSize, lay: Lay, ring: Ring) -> SealTiles:
    """Cover a ring with tiles, beginning at the inlet.

    The mesh of the ring has the coordinates (|ln r/r₀|, θ), where r₀ is the radius of the inlet. Raises InputError if
    the ring is narrower than a cell, or if the innermost tiles of a small ring are much narrower than a cell.
    """
    breadth = ring.breadth
    # sides of the tiles across and along the seal
    d1, d2 = _tile_sides(cell_size.size, lay, "circumferential", "radial")
    if breadth < _NARROW * d1:
        sides = " × ".join(to_text(side, "m", 3) for side in cell_size.size)
        given = f"a ring {to_text(breadth, 'm', 3)} wide"
        raise InputError("outer_radius", given, f"a ring at least as wide as a cell, {sides}")
    rows = _row_count(breadth, d1, "outer_radius", ring.outer)
    all_columns = max(FEWEST_COLUMNS, round(ring.circumference / d2))
    warnings = _check_innermost_tiles(ring.inner, all_columns, d2)
    is_spiral = lay.name == "spiral"
    # a part of the ring can stand for the whole ring only if the lay does not vary around the ring
    columns = all_columns
    if is_spiral or lay.name in ("radial", "circumferential"):
        columns = cell_size.covered_columns(rows, all_columns)
    covered_fraction = columns / all_columns
    geometry = _ring_geometry(ring, (rows, columns), covered_fraction)
    # a spiral deviates little from the circumferential direction: the elements have a circumferential lay, and
    # `tangent` contains the deviation
    element_lay = Lay(name="circumferential") if is_spiral else lay
    direction = element_lay.directions(geometry.centres)  # (n, 2) in the plane
    lay_in_mesh = np.einsum("nab,nb->na", geometry.mesh_axes, direction)
    rectangles = geometry.rectangles
    seal = ElementSeal(
        rectangles.mesh,
        *rectangles.ends,
        size=(breadth, ring.circumference * covered_fraction),
        outlines=geometry.outlines,
        axes=lay_axes(lay_in_mesh),
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
        covered_fraction=covered_fraction,
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


def _ring_geometry(ring: Ring, cells: Shape, covered_fraction: float) -> _RingGeometry:
    """Divide a ring, or a part of a ring, into rows and columns of elements; the first row is at the inlet.

    ring : geometry of the whole ring.
    cells : numbers of rows and columns.
    covered_fraction : fraction of the circumference that is divided into columns.
    """
    rows, columns = cells
    rectangles = Rectangles(ring.strip_lines(rows), 2 * pi * covered_fraction, columns)
    mesh = rectangles.plain_mesh
    vertex_radii, vertex_directions = ring.radius_and_direction(mesh.p)
    vertices = (vertex_radii * vertex_directions).T  # in the plane, (vertex, 2)
    outlines = vertices[mesh.t.T]  # (element, corner, 2)
    # the mesh coordinates of a centre are the means of the mesh coordinates of the corners, (2, element)
    centre_coordinates = mesh.p[:, mesh.t].mean(axis=1)
    centre_radii, outward = ring.radius_and_direction(centre_coordinates)
    centres = (centre_radii * outward).T
    # directions in which the mesh coordinates |ln r/r₀| and θ increase, (2, element) each
    downstream = ring.outflow * outward
    around = np.array([-outward[1], outward[0]])
    mesh_axes = np.stack([downstream, around]).transpose(2, 0, 1)  # (element, axis, 2)
    return _RingGeometry(rectangles, outlines, centres, centre_radii, mesh_axes)


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
    seal = ElementSeal(mesh, *ends, (mean_breadth, seal_length), outlines, lay_axes(direction))
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
        f"The leakage scatters too much between realisations, by a factor of up to {most_cells**0.5:.2g}: over "
        f"{part:.0%} of the seal, elements of the mesh take one cell of the surface where up to {most_cells:.0f} cells "
        f"of {' × '.join(sides)} have room. Mesh the seal with elements of at most {element_size:.2g} {unit}, in gmsh "
        f"with -clmax {element_size:.2g}, or use larger cells",
    )

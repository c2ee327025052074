"""Describe a seal that is covered with tiles, which take the permeabilities of cells of the surface.

The permeability of a cell has the principal values k1 across the lay and k2 along the lay. The module `covering` covers
strips, rings and meshes with tiles.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..base import Array, Indices, Pair, Shape, counted
from ..flow.rectangles import FEWEST_COLUMNS, Rectangles
from .element_seal import ElementSeal
from .plane import polygon_areas


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

        rows, columns : numbers of rows and columns of tiles for the whole seal.
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
    covered_fraction : float
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
    covered_fraction: float = 1.0
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
        """Indices of all elements except the copies that `strip_tiles` adds to a short strip."""
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
        return breadth, length * unrepeated_fraction / self.covered_fraction

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
        axes = lay_axes(self.lay)
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
    return replace(strip_tiles(size, cells, lay), in_order=True)


def strip_tiles(size: Pair, cells: Shape, lay: Array) -> SealTiles:
    """Create a periodic strip of rectangular tiles.

    The mesh may contain several copies of the strip along its length, see `Rectangles.repeated`. All copies of an
    element of the strip belong to the same tile.

    size : width and length of the strip [m].
    cells : numbers of rows and columns of tiles.
    lay : unit vector along the lay for each tile (tiles, 2).
    """
    lines = np.linspace(0.0, size[0], cells[0] + 1)
    strip, repetitions = Rectangles(lines, size[1], cells[1]).repeated()
    # index of the tile of each element, row by row; the indices are repeated in the same way as the columns
    tile = np.tile(np.arange(cells[0] * cells[1]).reshape(cells), (1, repetitions)).ravel()
    axes = lay_axes(lay[tile])
    repeated_size = size[0], strip.period
    seal = ElementSeal(strip.mesh, *strip.ends, repeated_size, strip.outlines, axes, strip)
    return SealTiles(seal, lay[tile], tile, cells)


def lay_axes(lay: Array) -> Array:
    """Return unit vectors across and along the lay, (n, axis, 2), for unit vectors along the lay (n, 2)."""
    across = np.stack([lay[:, 1], -lay[:, 0]], axis=1)
    return np.stack([across, lay], axis=1)

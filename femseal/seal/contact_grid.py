"""Cover a seal with a regular grid, on which the contact of the whole seal is solved.

A ring is unrolled to a strip, whose length is the mean circumference of the ring. The rows of the grid run around the
ring; the first row is at the inlet and the last row at the outlet. A mesh is covered with a rectangle of square cells;
cells outside of the seal are ignored.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil, pi
from typing import Any

import numpy as np

from ..base import Array, Indices, Pair, Shape
from .frame import Frame
from .plane import in_space, middles
from .tiles import SealTiles

#: Smallest numbers of rows and columns over a strip or a ring.
_ROWS, _COLUMNS = 24, 64
#: Smallest number of rows if the form deviation does not vary along the seal, so that the contact is solved on a single
#: column.
ROWS_OF_PROFILES = 384
#: Largest number of grid cells.
_MOST_CELLS = 2**15
#: Smallest number of grid cells along the longer side of a mesh.
_FEWEST_CELLS = 64


@dataclass(frozen=True, eq=False)
class ContactGrid:
    """A regular grid of cells over a seal.

    Attributes
    ----------
    points : array, (n1, n2, 2)
        Centres of the cells in the plane of the seal [m].
    spacing : tuple of two float
        Side lengths of a cell [m].
    boundary : tuple of two str
        Contact boundary along each axis, see `HalfSpace`.
    tile : array of int, (n1, n2)
        Number of the tile in which each cell lies, −1 outside of the seal.
    averaging : sparse array, (tiles, n1·n2)
        Matrix that averages values at the grid cells over each tile. Column j of the matrix belongs to grid cell j,
        where the cells are numbered row by row. For a tile without a cell, the matrix returns the value at the nearest
        cell.
    """

    points: Array = field(repr=False)
    spacing: Pair
    boundary: tuple[str, str]
    tile: Indices = field(repr=False)
    averaging: Any = field(repr=False)

    @classmethod
    def over(cls, tiles: SealTiles, frame: Frame, *, profile: bool = False) -> ContactGrid:
        """Cover the tiles of a seal with a regular grid.

        Parameters
        ----------
        tiles : SealTiles
            Tiles of the seal.
        frame : Frame
            Coordinates of the seal.
        profile : bool
            True if the form deviation varies only across the seal and not along it. The grid then has more rows.
        """
        if tiles.grid is None:
            return cls._over_mesh(tiles)
        rows, columns = tiles.grid
        breadth, length = tiles.seal.size
        # the grid does not cover the repeated columns of a short strip
        length *= tiles.unrepeated_elements.size / tiles.tile.size
        n1, n2 = _grid_shape(rows, columns, ROWS_OF_PROFILES if profile else _ROWS)
        # centres of the rows (n1,) and of the columns (n2,), as fractions of breadth and length
        x1 = (np.arange(n1) + 0.5) / n1
        x2 = (np.arange(n2) + 0.5) / n2
        points = _points_of_grid(x1, x2, length, frame)
        # tiles are numbered row by row
        row_of_tiles = (x1 * rows).astype(np.int64)
        column_of_tiles = (x2 * columns).astype(np.int64)
        tile = row_of_tiles[:, None] * columns + column_of_tiles  # (n1, n2)
        spacing = (breadth / n1, length / n2)
        return cls._with_averaging(points, spacing, ("free", "periodic"), tile, tiles)

    @classmethod
    def _over_mesh(cls, tiles: SealTiles) -> ContactGrid:
        """Cover a mesh with squares half as wide as an average tile; other sizes limit their number."""
        import pyvista

        mesh = tiles.seal.mesh
        lower_corner = mesh.p.min(axis=1)
        sides = mesh.p.max(axis=1) - lower_corner  # sides of the rectangle around the mesh
        # preferred, smallest and largest side of a square
        preferred = 0.5 * (tiles.size[0] * tiles.size[1] / tiles.count) ** 0.5
        smallest = float(np.prod(sides) / _MOST_CELLS) ** 0.5
        largest = float(sides.max()) / _FEWEST_CELLS
        side = min(max(preferred, smallest), largest)
        n1, n2 = (max(1, int(np.ceil(length / side))) for length in sides)
        spacing = (float(sides[0] / n1), float(sides[1] / n2))
        points = lower_corner + middles(sides, (n1, n2))
        surface = pyvista.PolyData.from_regular_faces(in_space(mesh.p.T), mesh.t.T)
        element = surface.find_containing_cell(in_space(points))  # −1 outside of the mesh
        tile = np.where(element >= 0, tiles.tile[element], -1).reshape(n1, n2)
        points = points.reshape(n1, n2, 2)
        return cls._with_averaging(points, spacing, ("free", "free"), tile, tiles)

    @classmethod
    def _with_averaging(
        cls,
        points: Array,
        spacing: Pair,
        boundary: tuple[str, str],
        tile: Indices,
        tiles: SealTiles,
    ) -> ContactGrid:
        """Return the grid, with the matrix that averages values at the grid cells over the tiles.

        tile : index of the tile in which each grid cell lies (n1, n2), −1 outside of the seal.
        """
        from scipy.sparse import csr_array
        from scipy.spatial import cKDTree

        # indices of the grid cells on the seal, row by row
        cells_on_seal = np.flatnonzero(tile >= 0)
        tiles_without_cell = np.setdiff1d(np.arange(tiles.count), tile)
        tree = cKDTree(points.reshape(-1, 2)[cells_on_seal])
        _, nearest = tree.query(tiles.middles[tiles_without_cell])
        # Row i of the matrix averages over the cells of tile i: the entry (i, j) is 1 / (number of cells in tile i) if
        # cell j lies in tile i. A tile without a cell gets the nearest cell as its only cell.
        i_tile = np.r_[tile.ravel()[cells_on_seal], tiles_without_cell]
        j_cell = np.r_[cells_on_seal, cells_on_seal[nearest]]
        cells_of_tile = np.bincount(i_tile)
        weights = 1 / cells_of_tile[i_tile]
        averaging = csr_array((weights, (i_tile, j_cell)), (tiles.count, tile.size))
        return cls(points, spacing, boundary, tile, averaging)

    @property
    def has_rows(self) -> bool:
        """Whether the rows of cells run along the seal, as on strips and rings."""
        return self.boundary[1] == "periodic"

    @property
    def inside(self) -> Array:
        """Whether each cell lies on the seal (n1, n2)."""
        return np.asarray(self.tile >= 0)

    def means(self, values: Array) -> Array:
        """Return the mean values over each tile, from values at the grid cells.

        Parameters
        ----------
        values : array, (…, n1, n2)
            Values at the grid cells; shape (…, n1, 1) if they do not vary along the seal.

        Returns
        -------
        array, (…, tiles)
            Mean value over each tile.
        """
        at_all_cells = np.broadcast_to(values, (*values.shape[:-2], *self.tile.shape))
        return np.asarray(at_all_cells.reshape(*values.shape[:-2], -1) @ self.averaging.T)


def _grid_shape(rows: int, columns: int, fewest_rows: int) -> Shape:
    """Choose the numbers of rows and columns of the grid over a strip or a ring.

    The numbers of rows and columns of the grid are multiples of those of the tiles, unless the seal has very many
    tiles.

    rows, columns : numbers of rows and columns of tiles.
    fewest_rows : smallest number of rows of the grid.
    """
    n1 = fewest_rows
    if rows <= fewest_rows:
        n1 = _smallest_multiple(rows, fewest_rows)
    most_columns = _MOST_CELLS // n1
    n2 = min(_smallest_multiple(columns, _COLUMNS), most_columns)
    return n1, max(_COLUMNS, n2)


def _points_of_grid(x1: Array, x2: Array, length: float, frame: Frame) -> Array:
    """Return the centres of the cells of a grid over a strip or a ring, (n1, n2, 2) [m].

    x1, x2 : row centres (n1,) and column centres (n2,), as fractions of the width and length of the strip.
    length : length of the strip [m]; not used for a ring.
    """
    # only a mesh has no ends, and a grid over a mesh is made in another function
    assert frame.ends is not None
    inlet, outlet = frame.ends
    # x1 of the strip or radius of the ring [m], and fraction of the length, (n1, n2) each
    across, along = np.meshgrid(inlet + (outlet - inlet) * x1, x2, indexing="ij")
    is_strip = frame.size is not None
    if is_strip:
        return np.stack([across, length * along], axis=-1)
    angle = 2 * pi * along
    return across[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _smallest_multiple(factor: int, least: int) -> int:
    """Return the smallest multiple of `factor` that is not below `least`."""
    return factor * ceil(least / factor)

"""Equal cells over a seal, on which the contact of the whole seal is solved.

A ring is unrolled: its cells lie along the radius, from the inlet, and along the circumference at its middle. Over a
mesh cells are squares in its plane, of which those outside do not count.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi
from typing import Any

import numpy as np

from ..base import Array, Indices, Pair
from .plane import in_space, middles
from .pressure_map import Frame
from .tiles import SealTiles

#: Fewest rows and columns of cells of a strip or a ring, and rows where the form is the same all along.
_ROWS, _COLUMNS, ROWS_OF_PROFILES = 24, 64, 384
#: Most cells, and fewest along the longer side of a mesh.
_MOST_CELLS, _FEWEST_CELLS = 2**15, 64


@dataclass(frozen=True, eq=False)
class ContactGrid:
    """Cells over a seal.

    points : their middles in the plane of the seal (n1, n2, 2) [m]. spacing : [m]. boundary : of both axes, see
    `HalfSpace`. tile : number of the tile of every cell (n1, n2), −1 outside of the seal.
    averaging : of the cells, in the flat grid, to means over the tiles (tiles, n1·n2); tiles that have no cell of their
    own have the nearest.
    """

    points: Array = field(repr=False)
    spacing: Pair
    boundary: tuple[str, str]
    tile: Indices = field(repr=False)
    averaging: Any = field(repr=False)

    @classmethod
    def over(cls, tiles: SealTiles, frame: Frame, *, profile: bool = False) -> ContactGrid:
        """Cells over the tiles of a seal, finer across it where its form is a profile that is the same all along."""
        if tiles.grid is None:
            return cls._over_mesh(tiles)
        rows, columns = tiles.grid
        (breadth, length), (first, last) = tiles.seal.size, frame.ends or (0.0, 0.0)
        length *= tiles.once.size / tiles.tile.size
        fewest = ROWS_OF_PROFILES if profile else _ROWS
        n1 = rows * -(-fewest // rows) if rows <= fewest else fewest
        n2 = max(_COLUMNS, min(columns * -(-_COLUMNS // columns), _MOST_CELLS // n1))
        x1, x2 = ((np.arange(n) + 0.5) / n for n in (n1, n2))
        across, along = np.meshgrid(first + (last - first) * x1, x2, indexing="ij")
        if frame.size is not None:
            points = np.stack([across, length * along], axis=-1)
        else:
            angle = 2 * pi * along
            points = across[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        row = (x1 * rows).astype(np.int64)
        column = (x2 * columns).astype(np.int64)
        tile = row[:, None] * columns + column
        return cls._of(points, (breadth / n1, length / n2), ("free", "periodic"), tile, tiles)

    @classmethod
    def _over_mesh(cls, tiles: SealTiles) -> ContactGrid:
        """Squares of about half the side of a tile, as far as there are not too many or too few."""
        import pyvista

        mesh = tiles.seal.mesh
        low, high = mesh.p.min(axis=1), mesh.p.max(axis=1)
        sides = high - low
        side = 0.5 * (tiles.size[0] * tiles.size[1] / tiles.count) ** 0.5
        most = float(sides.max()) / _FEWEST_CELLS
        side = min(max(side, float(np.prod(sides) / _MOST_CELLS) ** 0.5), most)
        n1, n2 = (max(1, int(np.ceil(length / side))) for length in sides)
        spacing = (float(sides[0] / n1), float(sides[1] / n2))
        points = low + middles(sides, (n1, n2))
        surface = pyvista.PolyData.from_regular_faces(in_space(mesh.p.T), mesh.t.T)
        element = surface.find_containing_cell(in_space(points))
        tile = np.where(element >= 0, tiles.tile[element], -1).reshape(n1, n2)
        points = points.reshape(n1, n2, 2)
        return cls._of(points, spacing, ("free", "free"), tile, tiles)

    @classmethod
    def _of(
        cls,
        points: Array,
        spacing: Pair,
        boundary: tuple[str, str],
        tile: Indices,
        tiles: SealTiles,
    ) -> ContactGrid:
        """The grid, with the cell nearest to the middle of each tile that has none of its own."""
        from scipy.sparse import csr_array
        from scipy.spatial import cKDTree

        inside = np.flatnonzero(tile >= 0)
        without = np.setdiff1d(np.arange(tiles.count), tile)
        near = cKDTree(points.reshape(-1, 2)[inside]).query(tiles.middles[without])[1]
        number = np.r_[tile.ravel()[inside], without]
        parts = 1 / np.bincount(number)[number]
        cell = np.r_[inside, inside[near]]
        averaging = csr_array((parts, (number, cell)), (tiles.count, tile.size))
        return cls(points, spacing, boundary, tile, averaging)

    @property
    def has_rows(self) -> bool:
        """Whether rows of cells lie from the inlet to the outlet."""
        return self.boundary[1] == "periodic"

    @property
    def inside(self) -> Array:
        """Whether cells are on the seal (n1, n2)."""
        return np.asarray(self.tile >= 0)

    def means(self, values: Array) -> Array:
        """Means (…, tiles) over the tiles of values (…, n1, n2), or (…, n1, 1) where they are the same all along."""
        every = np.broadcast_to(values, (*values.shape[:-2], *self.tile.shape))
        return np.asarray(every.reshape(*values.shape[:-2], -1) @ self.averaging.T)

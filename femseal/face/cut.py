"""Cut a surface into rectangular cells, which may overlap their neighbours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Indices, InputError, Pair, Shape, validate
from ..topography import Surface

#: Default number of cells along the shorter side of a surface: for cells in random order, and for cells in their
#: original order. Cells in their original order are larger, to preserve channels that cross from row to row, see
#: docs/evidence/stochastic_seals.md.
CELLS_AT_RANDOM, CELLS_IN_ORDER = 4, 2
#: Smallest number of points along a side of a cell.
FEWEST_POINTS = 8
#: Overlap of a cell with each neighbour perpendicular to the flow, as a fraction of the width of the cell. With
#: overlaps, channels that leave the cell and return are open, but only the flux inside the cell itself counts, see
#: `flow.core_flux`.
OVERLAP = 0.125
#: Continuation of a surface along x1 and x2, as for a `HalfSpace`.
Boundary = tuple[str, str]


def usual_cells(surface: Surface, in_order: bool = False) -> Shape:
    """Return the default numbers of cells along x1 and x2, for nearly square cells.

    The shorter side of the shortest patch is divided into four cells, or into two if the cells keep their original
    order (`in_order`).
    """
    d1, d2 = surface.spacing
    n1 = surface.shape[0]
    shorter_side = min(n1 * d1, min(surface.widths) * d2)
    side = shorter_side / (CELLS_IN_ORDER if in_order else CELLS_AT_RANDOM)
    m1 = max(1, min(round(n1 * d1 / side), n1 // FEWEST_POINTS))
    m2 = 0
    for width in surface.widths:  # number of points of each patch along x2
        m2 += max(1, min(round(width * d2 / side), width // FEWEST_POINTS))
    return m1, m2


@dataclass(frozen=True, eq=False)
class WidenedCell:
    """Values of a field in a cell and in its overlaps into neighbouring cells, perpendicular to the flow.

    Attributes
    ----------
    field : array, (n1, n2)
        Values at the points of the cell and of its overlaps.
    core : tuple of two int
        Index of the first point of the cell itself, and index after the last point, on the axis perpendicular to the
        flow.
    """

    field: NDArray[Any]
    core: tuple[int, int]


@dataclass(frozen=True)
class Cut:
    """Describe the division of a surface into a grid of cells.

    Attributes
    ----------
    rows, columns : tuple of int
        Index of the first point of each row of cells, and of each column of cells. The last entry of `rows` is the
        number of points of the surface along x1, and the last entry of `columns` is the number along x2.
    patch_of_column : tuple of int
        Number of the measured patch to which each column of cells belongs, from 0.
    spacing : tuple of two float
        Point spacing [m].
    """

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    patch_of_column: tuple[int, ...]
    spacing: Pair

    @classmethod
    def of(cls, surface: Surface, cells: Shape) -> Cut:
        """Cut a surface into the given numbers of cells along x1 and x2. No cell extends over two measured patches.

        Raises InputError if a cell would have fewer than 8 points along a side, or if there are more patches than
        columns of cells.
        """
        widths = surface.widths  # number of points of each patch along x2
        m1, m2 = validate.grid("cells", cells)
        if m2 < len(widths):
            raise InputError(
                "cells", cells, f"at least {len(widths)} cells along x2, one for each patch"
            )
        columns_of_patches = _distribute_columns(widths, min(m2, sum(widths)))
        # pairs of a number of points and the number of cells among which they are divided
        divisions = [(surface.shape[0], m1), *zip(widths, columns_of_patches, strict=True)]
        if any(points // count < FEWEST_POINTS for points, count in divisions if count > 1):
            given = f"{m1} × {m2} of {surface.shape[0]} × {surface.shape[1]} points"
            raise InputError(
                "cells", given, f"cells of at least {FEWEST_POINTS} × {FEWEST_POINTS} points"
            )
        columns = [0]  # first point of each column of cells, and the end of the last one
        patch_of_column: list[int] = []
        for number, (width, count) in enumerate(zip(widths, columns_of_patches, strict=True)):
            end_of_previous_patch = columns[-1]
            columns += _divide_range(end_of_previous_patch, width, count)[1:]
            patch_of_column += [number] * count
        rows = _divide_range(0, surface.shape[0], m1)
        return cls(tuple(rows), tuple(columns), tuple(patch_of_column), surface.spacing)

    @property
    def shape(self) -> Shape:
        """Numbers of cells along x1 and x2."""
        return len(self.rows) - 1, len(self.columns) - 1

    @property
    def size(self) -> Pair:
        """Mean side lengths of the cells along x1 and x2 [m]."""
        (m1, m2), (d1, d2) = self.shape, self.spacing
        return self.rows[-1] * d1 / m1, self.columns[-1] * d2 / m2

    @property
    def centres(self) -> tuple[Array, Array]:
        """Coordinates x1 and x2 of the centres of the cells [m]."""
        x1 = np.array(self.rows) * self.spacing[0]
        x2 = np.array(self.columns) * self.spacing[1]
        return (x1[:-1] + x1[1:]) / 2, (x2[:-1] + x2[1:]) / 2

    @property
    def patch_columns(self) -> list[slice]:
        """Ranges of columns of cells, one for each measured patch."""
        numbers = np.array(self.patch_of_column)
        ends = [*np.flatnonzero(np.diff(numbers)) + 1, len(numbers)]
        return [slice(int(a), int(b)) for a, b in pairwise([0, *ends])]

    def split(self, fields: NDArray[Any]) -> list[NDArray[Any]]:
        """Cut fields (…, n1, n2) into a list of cells, row by row."""
        return [
            fields[..., top:bottom, left:right]
            for top, bottom in pairwise(self.rows)
            for left, right in pairwise(self.columns)
        ]

    def split_with_overlaps(
        self, field: NDArray[Any], axis: int, boundary: Boundary = ("free", "periodic")
    ) -> list[WidenedCell]:
        """Cut a field into cells that overlap their neighbours in the direction perpendicular to the flow.

        Parameters
        ----------
        field : array, (n1, n2)
            Values at the points of the surface.
        axis : int
            Direction of the flow, 0 or 1.
        boundary : tuple of two str
            How the surface continues along x1, and how each measured patch continues along x2: "periodic"; "mirror" for
            the mirror image; or "free" for overlaps that end at the border.

        Returns
        -------
        list of WidenedCell
            Cells, row by row.
        """
        cells = []
        for rows in pairwise(self.rows):
            for column, columns in enumerate(pairwise(self.columns)):
                if axis == 0:
                    patch = self._patch_range(column)
                    points, core = _points_with_overlaps(columns, patch, boundary[1])
                    wide_field = field[rows[0] : rows[1], points]
                else:
                    points, core = _points_with_overlaps(rows, (0, self.rows[-1]), boundary[0])
                    wide_field = field[points, columns[0] : columns[1]]
                cells.append(WidenedCell(wide_field, core))
        return cells

    def _patch_range(self, column: int) -> tuple[int, int]:
        """Return the range of points along x2 of the measured patch that contains a column of cells."""
        number = self.patch_of_column[column]
        first = self.patch_of_column.index(number)
        end = first + self.patch_of_column.count(number)
        return self.columns[first], self.columns[end]

    def sums(self, field: NDArray[Any]) -> Array:
        """Sum a field (n1, n2) over each cell (m1, m2)."""
        return np.array([cell.sum(dtype=float) for cell in self.split(field)]).reshape(self.shape)

    def means(self, field: NDArray[Any]) -> Array:
        """Average a field (n1, n2) over each cell (m1, m2)."""
        return self.sums(field) / np.outer(np.diff(self.rows), np.diff(self.columns))


def _distribute_columns(widths: Sequence[int], columns: int) -> list[int]:
    """Distribute columns of cells over patches in proportion to the widths of the patches.

    Each patch gets a whole number of columns, and at least one. The numbers of columns are rounded by the largest
    remainder method.
    """
    wanted = np.array(widths) * (columns / sum(widths))  # shares that are not whole numbers
    shares = np.maximum(wanted.astype(int), 1)
    while shares.sum() != columns:
        remainders = wanted - shares
        if shares.sum() < columns:
            shares[np.argmax(remainders)] += 1
        else:
            # a share of 1 is not reduced
            shares[np.argmin(np.where(shares > 1, remainders, np.inf))] -= 1
    return [int(share) for share in shares]


def _points_with_overlaps(
    cell: tuple[int, int], patch: tuple[int, int], boundary: str
) -> tuple[Indices, tuple[int, int]]:
    """Return the indices of the points of a cell and of its overlaps, on the axis perpendicular to the flow.

    Parameters
    ----------
    cell, patch : tuple of two int
        Ranges (first, last + 1) of the points of the cell and of the measured patch that contains it.
    boundary : str
        How the patch continues beyond its border, see `Cut.split_with_overlaps`.

    Returns
    -------
    points : array of int
        Indices of the points on the surface.
    core : tuple of two int
        Index in `points` of the first point of the cell itself, and index after the last point of the cell.
    """
    first, end = patch
    size = end - first
    width = cell[1] - cell[0]
    overlap = round(OVERLAP * width)
    positions = np.arange(cell[0] - overlap, cell[1] + overlap) - first  # relative to the patch
    overlap_before = overlap
    if boundary == "periodic":
        inside = positions % size
    elif boundary == "mirror":
        # a period consists of the patch and its mirror image
        in_period = positions % (2 * size)
        inside = np.minimum(in_period, 2 * size - 1 - in_period)
    else:
        # the overlaps end at the border of the patch
        inside = positions[(positions >= 0) & (positions < size)]
        overlap_before = int((positions[:overlap] >= 0).sum())
    return inside + first, (overlap_before, overlap_before + width)


def _divide_range(first: int, points: int, count: int) -> list[int]:
    """Divide a range of points into `count` nearly equal parts, and return their `count` + 1 boundaries."""
    return [first + round(n * points / count) for n in range(count + 1)]

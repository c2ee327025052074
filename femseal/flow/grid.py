"""Structured grids of nodes: coordinates of their lines, and the degrees of freedom of each line."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Array, Indices


@dataclass(frozen=True, eq=False)
class Grid:
    """Elements between m1 + 1 rows and m2 + 1 columns of nodes.

    A periodic or a mirrored side is an identification: the last column of a ring is the first one; the outer line of a
    half element beside a mirror carries the degrees of freedom of its inner line.

    lines1 (m1 + 1,), lines2 (m2 + 1,) : coordinates of the lines of nodes, rising. All conformal coordinates
        will do, since the form is the same in them, such as (ln r, θ) of a ring.
    rows (m1 + 1,), columns (m2 + 1,) : number of the degrees of freedom of each line.
    ring1, ring2 : whether rows and columns form a ring; without ring1 the first row is the inlet, the last the outlet.
    half_ends : the first and last elements are half pixels between an end and the centres of the pixels beside it.
    """

    lines1: Array
    lines2: Array
    rows: Indices
    columns: Indices
    ring1: bool = False
    ring2: bool = True
    half_ends: bool = False

    @classmethod
    def of_pixel_centres(
        cls, shape: tuple[int, int], spacing: tuple[float, float], sides: str
    ) -> Grid:
        """Nodes at the centres of a cell's pixels and on its ends; the same object for the same cell.

        Half elements reach from the ends, and from mirrored sides, to the first nodes.
        """
        return _of_pixel_centres(shape, spacing, sides)

    @classmethod
    def of_pixel_corners(
        cls, shape: tuple[int, int], spacing: tuple[float, float], sides: str
    ) -> Grid:
        """Nodes at the corners of a cell's pixels, which are the elements."""
        lines1 = _borders(shape[0], spacing[0])
        if sides == "periodic":
            return cls(lines1, *_ring_last(lines1, shape[1], spacing[1]))
        lines2 = _borders(shape[1], spacing[1])
        return cls(lines1, lines2, np.arange(lines1.size), np.arange(lines2.size), ring2=False)

    @classmethod
    def of_torus(cls, shape: tuple[int, int], spacing: tuple[float, float]) -> Grid:
        """Nodes at the centres of the pixels of a cell that is periodic along both axes."""
        (lines1, rows), (lines2, columns) = (
            _ring(n, d) for n, d in zip(shape, spacing, strict=True)
        )
        return cls(lines1, lines2, rows, columns, ring1=True)

    @classmethod
    def of_strip(cls, lines1: ArrayLike, width: float, n2: int) -> Grid:
        """Rows of nodes at given coordinates from the inlet to the outlet, and a ring of n2 columns `width` apart."""
        lines1 = np.asarray(lines1, dtype=float)
        return cls(lines1, *_ring_last(lines1, n2, width))

    @property
    def elements(self) -> tuple[int, int]:
        """Elements along both axes."""
        return self.lines1.size - 1, self.lines2.size - 1

    @property
    def nodes(self) -> tuple[int, int]:
        """Rows and columns of degrees of freedom."""
        return int(self.rows.max()) + 1, int(self.columns.max()) + 1


@lru_cache(maxsize=64)
def _of_pixel_centres(shape: tuple[int, int], spacing: tuple[float, float], sides: str) -> Grid:
    (n1, n2), (d1, d2) = shape, spacing
    lines1 = np.concatenate([[0.0], _centres(n1, d1), [n1 * d1]])
    rows = np.arange(lines1.size)
    if sides == "periodic":
        lines2, columns = _ring(n2, d2)
        return Grid(lines1, lines2, rows, columns, half_ends=True)
    lines2 = np.concatenate([[0.0], _centres(n2, d2), [n2 * d2]])
    columns = np.concatenate([[0], np.arange(n2), [n2 - 1]])
    return Grid(lines1, lines2, rows, columns, ring2=False, half_ends=True)


def _centres(n: int, spacing: float) -> Array:
    return np.asarray((np.arange(n) + 0.5) * spacing, dtype=np.float64)


def _borders(n: int, spacing: float) -> Array:
    return np.asarray(np.arange(n + 1) * spacing, dtype=np.float64)


def _ring(n: int, spacing: float) -> tuple[Array, Indices]:
    return _centres(n + 1, spacing), np.arange(n + 1, dtype=np.int64) % n


def _ring_last(lines1: Array, n2: int, width: float) -> tuple[Array, Indices, Indices]:
    lines2, columns = _ring(n2, width)
    return lines2, np.arange(lines1.size), columns

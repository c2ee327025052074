"""Windows of a surface and the nodes between them.

Contact is divided into equal cells. Nodes of the global flow lie on lines near the faces between cells in x1 (rows
0 … m1) and at cell centres in x2. The window of the x1-link (i, j) reaches from line i to line i + 1 over the columns
of cell j; that of the x2-link on line i from half way to the line before to half way to the line after, over the
columns between the centres of cells j and j + 1. On its line a node has one pressure over the width of a cell, which
short-circuits the constrictions there: on a face with ridges the lines lie in valleys.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Array
from ..base.errors import InputError
from ..topography import Topography

#: How far a line of nodes may lie from its face, in window sides.
MOST_LINE_SHIFT = 0.25
#: Fraction of the height variance in the profile across the leakage from which on a face has ridges to avoid. Measured:
#: moved lines are better by factors on turned faces and worse by a tenth on self-affine ones.
RIDGE_FRACTION = 0.5


@dataclass(frozen=True)
class Partition:
    """(m1, m2) equal cells of (w1, w2) pixels that tile a surface of `shape` pixels, and the nodes between them.

    lines : the m1 + 1 pixel rows on which the nodes lie, from 0 to n1; the faces between cells unless given.

    Raises InputError: cells that do not divide the surface, several of fewer than 8 pixels, lines that do not rise.
    """

    shape: tuple[int, int]
    spacing: tuple[float, float]
    cells: tuple[int, int]
    lines: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Check cells and lines, and place lines that are not given on the faces between cells."""
        if any(m < 1 or n % m for n, m in zip(self.shape, self.cells, strict=True)):
            raise InputError("cells", self.cells, f"divisors of the surface's {self.shape} pixels")
        if min(self.window) < 8 and self.cells != (1, 1):
            raise InputError("cells", self.cells, f"windows of at least 8 pixels, not {self.window}")
        m1, w1 = self.cells[0], self.window[0]
        lines = self.lines or tuple(i * w1 for i in range(m1 + 1))
        ends = len(lines) == m1 + 1 and (lines[0], lines[-1]) == (0, self.shape[0])
        if not ends or any(b <= a for a, b in itertools.pairwise(lines)):
            raise InputError("lines", lines, f"{m1 + 1} rising pixel rows from 0 to {self.shape[0]}")
        object.__setattr__(self, "lines", lines)

    @classmethod
    def through_valleys(cls, surface: Topography, cells: tuple[int, int], cut_off: float) -> Partition:
        """A partition whose lines lie in the valleys of the surface's waves longer than `cut_off` [m].

        Each line moves to the lowest row of the mean profile near its place. On a face without ridges across the
        leakage the lines stay on the faces between cells.
        """
        uniform = cls(surface.shape, surface.spacing, cells)
        smooth = surface.low_pass(cut_off).heights
        profile = smooth.mean(axis=1)
        if profile.var() < RIDGE_FRACTION * smooth.var():
            return uniform
        w1 = uniform.window[0]
        most = int(MOST_LINE_SHIFT * w1)
        inner = [line - most + int(np.argmin(profile[line - most : line + most + 1])) for line in uniform.lines[1:-1]]
        return cls(surface.shape, surface.spacing, cells, (0, *inner, surface.shape[0]))

    @property
    def window(self) -> tuple[int, int]:
        """Pixels (w1, w2) of a window."""
        return (self.shape[0] // self.cells[0], self.shape[1] // self.cells[1])

    @property
    def window_size(self) -> tuple[float, float]:
        """Size of a window along x1 and x2 [m]."""
        return (self.window[0] * self.spacing[0], self.window[1] * self.spacing[1])

    @property
    def places(self) -> list[tuple[int, int]]:
        """Row and column of every cell, row after row."""
        return [(i, j) for i in range(self.cells[0]) for j in range(self.cells[1])]

    def links(self, axis: int) -> list[tuple[int, int]]:
        """Row and column of every link along `axis`, row after row."""
        return [(i, j) for i in range(self.cells[0] - axis) for j in range(self.cells[1])]

    def cell(self, fields: NDArray[Any], i: int, j: int) -> NDArray[Any]:
        """The cell (i, j) of fields (…, n1, n2)."""
        w1, w2 = self.window
        return fields[..., i * w1 : (i + 1) * w1, j * w2 : (j + 1) * w2]

    def link(self, fields: Any, i: int, j: int, axis: int, shift: int = 0) -> NDArray[Any]:
        """Cut the window of the link (i, j) along `axis` out of fields (…, n1, n2), which are periodic in x2.

        It is a view, except over the seam. The first row of x2-links lies on line 1. `shift` moves the window along x2
        by so many pixels.
        """
        start, stop = self.rows(axis)[i]
        w2, n2 = self.window[1], self.shape[1]
        first = (j * w2 + shift + (w2 // 2 if axis == 1 else 0)) % n2
        columns = slice(first, first + w2)
        # over the seam there is no view
        return fields[..., start:stop, columns if columns.stop <= n2 else np.arange(first, first + w2) % n2]

    def rows(self, axis: int) -> list[tuple[int, int]]:
        """First pixel row, and the row after the last, of the windows in each row of links along `axis`."""
        edges = self.lines
        if axis == 1:
            edges = tuple((a + b) // 2 for a, b in zip(self.lines[:-1], self.lines[1:], strict=True))
        return list(itertools.pairwise(edges))

    @property
    def node_rows(self) -> tuple[float, ...]:
        """x1 of the nodes' lines [m]."""
        return tuple(line * self.spacing[0] for line in self.lines)

    def cell_means(self, fields: NDArray[Any]) -> Array:
        """Mean over each cell (…, m1, m2) of fields (…, n1, n2)."""
        (m1, m2), (w1, w2) = self.cells, self.window
        split = fields.reshape(*fields.shape[:-2], m1, w1, m2, w2)
        return split.mean(axis=(-3, -1), dtype=float)

    def means(self, field: NDArray[Any], axis: int = 0) -> Array:
        """Mean of a field over the window of each link along `axis` (rows, m2); its grid may be coarser."""
        grid = Partition(field.shape, self.spacing, self.cells) if field.shape != self.shape else self
        means = [grid.link(field, i, j, axis).mean() for i, j in self.links(axis)]
        return np.array(means).reshape(-1, self.cells[1])

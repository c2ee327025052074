"""Windows of a surface and the nodes between them.

Contact is divided into equal cells. Nodes of the global flow lie on lines near the faces between cells in x1 (rows
0 … m1) and at cell centres in x2. The window of the x1-link (i, j) reaches from line i to line i + 1 over the columns
of cell j; that of the x2-link on line i from half way to the line before to half way to the line after, over the
columns between the centres of cells j and j + 1. On its line a node has one pressure over the width of a cell, which
short-circuits the constrictions there: on a face with ridges the lines lie in valleys.

Fields of a face at every step of a load programme are stitched from its windows. The gap is kept at every pixel, the
contact pressure only where there is contact: a bit for every pixel says whether it is in contact, and a number for each
pixel in contact is its pressure.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

from ..base import Array, InputError, Shown
from ..base.shared_array import lies_on_disk, put_aside
from ..loads import LoadProgramme
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
            given = "{} × {} of {} × {} pixels".format(*self.cells, *self.window)
            raise InputError("cells", given, "windows of at least 8 × 8 pixels")
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


@dataclass(frozen=True, eq=False)
class ContactValues:
    """A field (n1, n2) that is 0 out of contact.

    bits : 1 for each pixel where the field is not 0, eight pixels in a byte, row after row.
    values : the values at these pixels in the same order; a single one if all are the same.
    """

    shape: tuple[int, int]
    bits: NDArray[np.uint8]
    values: NDArray[np.float32]

    @classmethod
    def of(cls, values: NDArray[Any]) -> ContactValues:
        """Keep the values of an array (n1, n2)."""
        single = np.asarray(values, np.float32)
        inside = single != 0
        return cls((single.shape[0], single.shape[1]), np.packbits(inside), single[inside])

    @classmethod
    def constant(cls, shape: tuple[int, int], value: float) -> ContactValues:
        """A field with the same value at every pixel, such as NaN."""
        bits = np.packbits(np.full(shape, value != 0))
        return cls(shape, bits, np.full(1 if value != 0 else 0, value, np.float32))

    @classmethod
    def put_aside(cls, fields: Sequence[ContactValues], beside: NDArray[Any]) -> tuple[ContactValues, ...]:
        """The fields, together in two files where an array as large as `beside` lies in one."""
        if not lies_on_disk(beside.nbytes):
            return tuple(fields)
        bits, values = (
            np.split(put_aside(np.concatenate(parts)), np.cumsum([part.size for part in parts])[:-1])
            for parts in ([field.bits for field in fields], [field.values for field in fields])
        )
        return tuple(map(cls, (field.shape for field in fields), bits, values))

    def dense(self) -> NDArray[np.float32]:
        """The field as an array (n1, n2)."""
        full = np.zeros(self.shape, np.float32)
        full[np.unpackbits(self.bits, count=full.size).view(bool).reshape(self.shape)] = self.values
        return full


class ContactPressure(NDArrayOperatorsMixin):
    """Contact pressure (steps, n1, n2) [Pa] of all windows of a face, kept where there is contact.

    Use it like an array that cannot be changed. Indexing computes the indexed steps only; arithmetic, methods and
    numpy functions compute the whole field.

    partition : the cells of the face.
    windows : for every cell, row after row, its field at every step.
    """

    dtype = np.dtype(np.float32)
    ndim = 3

    def __init__(self, partition: Partition, windows: tuple[tuple[ContactValues, ...], ...]) -> None:
        self._partition, self._windows = partition, windows

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of steps, and pixels along x1 and x2."""
        return (len(self), *self._partition.shape)

    def __len__(self) -> int:
        return len(self._windows[0])

    def __iter__(self) -> Iterator[NDArray[np.float32]]:
        return (self._at(s) for s in range(len(self)))

    def __getitem__(self, key: Any) -> NDArray[np.float32]:
        key = key if isinstance(key, tuple) else (key,)
        if key and key[0] is not Ellipsis:
            steps, pixels = np.arange(len(self))[key[0]], key[1:]
        else:
            steps, pixels = np.arange(len(self)), key
        if steps.ndim == 0:
            return self._at(int(steps))[pixels]
        return np.array([self._at(int(s))[pixels] for s in steps], np.float32)

    def _at(self, step: int) -> NDArray[np.float32]:
        """The field over the whole face at one step."""
        face = np.empty(self._partition.shape, np.float32)
        for place, window in zip(self._partition.places, self._windows, strict=True):
            self._partition.cell(face, *place)[:] = window[step].dense()
        return face

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return self[...].astype(dtype or self.dtype, copy=False)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        arrays = (np.asarray(i) if isinstance(i, ContactPressure) else i for i in inputs)
        return getattr(ufunc, method)(*arrays, **options)

    def __getattr__(self, name: str) -> Any:
        # methods of an array, such as mean; a copy or a pickle that is not built yet has none
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self[...], name)


@dataclass(frozen=True, eq=False, repr=False)
class WindowFields(Shown):
    """Deformed gap and contact pressure of a face along a load programme; neither can be changed.

    gap : (steps, n1, n2) [m], NaN in windows that failed; it is read-only.
    pressure : (steps, n1, n2) [Pa], used like an array, see `ContactPressure`.
    """

    steps: LoadProgramme
    partition: Partition = field(repr=False)
    gap: NDArray[np.float32] = field(metadata={"unit": "m", "long_name": "deformed gap stitched from the windows"})
    pressure: ContactPressure = field(metadata={"unit": "Pa", "long_name": "contact pressure of the windows"})

    def __post_init__(self) -> None:
        gap = self.gap.view()
        gap.flags.writeable = False
        object.__setattr__(self, "gap", gap)

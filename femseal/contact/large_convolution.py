"""Products u = K p on large grids, which no cache holds: as `convolution`, with half of the memory.

Waves take the memory of the displacement, in rows that are longer than those of its points. Some columns of them at a
time are copied to a block, transformed there, multiplied with the symbol, transformed back and copied back: a first
axis that is free is never padded as a whole. With m points, half of the padded length, its even waves are the transform
of the points, and its odd ones that of the points times exp(−iπk/m).

Measured against `Convolution`, free along the first axis and periodic along the second, a product takes 0.92 times as
long at 1024² points, 0.60 times at 4096², and in single precision 0.93 and 0.52 times.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.compiled import compiled
from ..base.threads import on_threads, parts
from .convolution import (
    BLOCK_BYTES,
    COMPILED,
    ROW_PARTS,
    ROW_POINTS,
    Convolution,
    fftw,
    lay,
    order_of,
    planner,
    respond,
    row_length,
    take,
    weights_of,
)
from .influence import padded_length

Array = NDArray[np.float64]
#: Number of points from which a grid is large.
LARGE = 2**20
#: A block has a multiple of so many columns.
_COLUMNS = 8


def convolution(
    shape: tuple[int, int], boundary: tuple[str, str], symbol: Array | None, **settings: Any
) -> Convolution | LargeConvolution:
    """The products on a grid that its size asks for, with the parameters of `Convolution`."""
    kind = LargeConvolution if shape[0] * shape[1] >= LARGE else Convolution
    return kind(shape, boundary, symbol, **settings)


class LargeConvolution:
    """displacement = K pressure with the parameters of `Convolution`.

    Attributes
    ----------
    pressure : (n1, n2) [Pa].
    rows : memory of (n1, >= n2) numbers, whose rows begin with those of the displacement.
    displacement : (n1, n2) [m], a view of it.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        boundary: tuple[str, str],
        symbol: Array | None,
        *,
        dtype: Any = np.float64,
        threads: int = 1,
        over: LargeConvolution | None = None,
    ) -> None:
        pyfftw = fftw()
        (n1, n2), real = shape, np.dtype(dtype)
        kind = np.result_type(real, np.complex64)
        l1, l2 = (
            padded_length(n) if end == "free" else n for n, end in zip(shape, boundary, strict=True)
        )
        transforms = 2 if l1 > n1 else 1
        m1, m2 = l1 // transforms, l2 // 2 + 1
        self._mirrors = boundary[0] == "mirror", boundary[1] == "mirror"
        if over is None:
            assert symbol is not None
            self._weights = weights_of(symbol, l1 * l2, *self._mirrors, transforms)
            del symbol
        else:
            self._weights = over._weights
        self.pressure = pyfftw.zeros_aligned((n1, n2), dtype=real)
        length = row_length(m2, kind.itemsize)
        size = n1 * length * kind.itemsize
        self._memory: Any = (
            pyfftw.empty_aligned(size, dtype=np.uint8) if over is None else over._memory
        )
        self._waves = self._memory[:size].view(kind).reshape(n1, length)
        self.rows = self._waves.view(real)
        self.displacement = self.rows[:, :n2]
        self._padded, self._laid = self.rows[:, :l2], self._mirrors[1] or l2 > n2
        points: Any = self._padded if self._laid else self.pressure
        waves = self._waves[:, :m2]
        turns = [np.exp(1j * np.pi * np.arange(n // 2 + 1) / n) for n in (m1, l2)]
        twist = np.exp(-1j * np.pi * np.arange(n1 if transforms == 2 else 0) / m1).astype(kind)
        # a block and its transform fit in the cache; of fewer columns, or of 16 long ones, copies take thrice the time
        width = min(
            max(_COLUMNS, BLOCK_BYTES // (2 * l1 * kind.itemsize) // _COLUMNS * _COLUMNS), m2
        )
        self._blocks: list[Any] = []
        with planner() as planned:
            self._parts = []
            for i, end in parts(n1, max(ROW_POINTS / l2, n1 / ROW_PARTS)):
                plans = planned(points[i:end], waves[i:end], self._padded[i:end], axis=1)
                self._parts.append((i, end, plans))
            for starts in np.array_split(range(0, m2, width), threads):
                shape = transforms * width, row_length(m1, kind.itemsize)
                block, transformed = (pyfftw.zeros_aligned(shape, dtype=kind) for _ in range(2))
                plans = planned(block[:, :m1], transformed[:, :m1], block[:, :m1], axis=1)
                self._blocks.append((starts, width, block, transformed, plans))
        order1, self._order2 = (
            order_of(n, m) for n, m in zip((n1, n2), self._mirrors, strict=True)
        )
        self._rows = np.arange(n1)
        self._columns = waves, m1, twist, order1, self._weights, turns
        self._threads = threads

    def apply(self) -> None:
        """Fill `displacement` from `pressure`."""
        on_threads(self._threads, self._forward, self._parts)
        on_threads(self._threads, self._respond, self._blocks)
        on_threads(self._threads, self._inverse, self._parts)

    def _forward(self, part: Any) -> None:
        """Lay out the points of some rows and transform them."""
        i, end, plans = part
        if self._laid:
            lay(self.pressure, self._padded, i, end, self._rows, self._order2)
        plans[0]()

    def _respond(self, work: Any) -> None:
        """Transform some columns, multiply their waves with the symbol, transform them back."""
        starts, width, block, transformed, (forward, inverse) = work
        waves, m1, twist, order, weights, turns = self._columns
        for j in starts:
            count = min(width, waves.shape[1] - j)
            _gather(waves, j, count, block, twist, order)
            forward()
            respond(transformed, m1, j, count, weights, twist.size > 0, *turns)
            inverse()
            _scatter(block, j, count, waves, twist, order)

    def _inverse(self, part: Any) -> None:
        """Transform some rows back and put their points in order."""
        i, end, plans = part
        plans[1]()
        if self._mirrors[1]:
            points = self.displacement[i:end]
            take(points.copy(), points, 0, end - i, self._rows, self._order2)


@compiled(**COMPILED)
def _gather(waves, first, count, block, twist, order):
    """Copy columns of waves to rows of a block, and behind these the same columns with a twist; zeros follow."""
    n1 = waves.shape[0]
    width = block.shape[0] // 2
    for i in range(n1):
        row = waves[order[i], first : first + count]
        for j in range(count):
            block[j, i] = row[j]
        if twist.size:
            for j in range(count):
                block[width + j, i] = row[j] * twist[i]
    if twist.size:
        for j in range(count):
            block[j, n1:] = 0
            block[width + j, n1:] = 0


@compiled(**COMPILED)
def _scatter(block, first, count, waves, twist, order):
    """Copy rows of a block to columns of waves, where there is a twist their sums without it."""
    n1 = waves.shape[0]
    width = block.shape[0] // 2
    for i in range(n1):
        row = waves[order[i], first : first + count]
        if twist.size:
            for j in range(count):
                row[j] = block[j, i] + block[width + j, i] * np.conj(twist[i])
        else:
            for j in range(count):
                row[j] = block[j, i]

"""Products u = K p on large grids, which no cache holds: as `convolution`, with half of the memory.

Waves take the memory of the displacement, in rows that are longer than those of its points. Some columns of them at a
time are copied to a block, transformed there, multiplied with the symbol, transformed back and copied back: a first
axis that is free is never padded as a whole. With m points, half of the padded length, its even waves are the transform
of the points, and its odd ones that of the points times exp(−iπk/m).

Measured against `Convolution`, free along the first axis and periodic along the second, a product takes 0.92 times as
long at 1024² points, 0.60 times at 4096², and in single precision 0.93 and 0.52 times.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..base import Array, Shape
from .convolution import (
    BLOCK_BYTES,
    Convolution,
    Planned,
    Product,
    contracted,
    fftw,
    lay,
    respond,
    row_length,
    take,
)
from .influence import Boundary

#: Number of points from which a grid is large.
LARGE = 2**20
#: A block has a multiple of so many columns.
_COLUMNS = 8


def convolution(shape: Shape, boundary: Boundary, symbol: Array | None, **settings: Any) -> Product:
    """The products on a grid that its size asks for, with the parameters of `Product`."""
    kind = LargeConvolution if shape[0] * shape[1] >= LARGE else Convolution
    return kind(shape, boundary, symbol, **settings)


class LargeConvolution(Product):
    """A product on a large grid."""

    @property
    def _transforms(self) -> int:
        """Those of even and of odd waves where the first axis is free."""
        return 2 if self._lengths[0] > len(self.pressure) else 1

    def _plan(self, planned: Planned, over: LargeConvolution | None) -> None:
        """Columns are copied to blocks."""
        (n1, n2), (l1, l2), kind = self.pressure.shape, self._lengths, self._kind
        m1, m2 = l1 // self._transforms, l2 // 2 + 1
        length = row_length(m2, kind.itemsize)
        size = n1 * length * kind.itemsize
        self._memory: Any = (
            fftw().empty_aligned(size, dtype=np.uint8) if over is None else over._memory
        )
        every_wave = self._memory[:size].view(kind).reshape(n1, length)
        waves, self.rows = every_wave[:, :m2], every_wave.view(self._real)
        self.displacement, padded = self.rows[:, :n2], self.rows[:, :l2]
        own_order, order2 = np.arange(n1), self._orders[1]
        points, lay_out, take_out = self.pressure, None, None
        if self._mirrors[1] or l2 > n2:
            points, lay_out = padded, partial(lay, self.pressure, padded, own_order, order2)
        if self._mirrors[1]:
            take_out = partial(_take_in_place, self.displacement, own_order, order2)
        self._plan_rows(planned, points, waves, padded, lay_out, take_out)
        twist = np.exp(-1j * np.pi * np.arange(n1 if l1 > n1 else 0) / m1).astype(kind)
        self._columns = waves, m1, twist, self._orders[0], self._turns(m1)
        # a block and its transform fit in the cache; of fewer columns, or of 16 long ones, copies take thrice the time
        width = min(
            max(_COLUMNS, BLOCK_BYTES // (2 * l1 * kind.itemsize) // _COLUMNS * _COLUMNS), m2
        )
        for starts in np.array_split(range(0, m2, width), self._threads):
            shape = self._transforms * width, row_length(m1, kind.itemsize)
            block, transformed = (fftw().zeros_aligned(shape, dtype=kind) for _ in range(2))
            plans = planned(block[:, :m1], transformed[:, :m1], block[:, :m1], axis=1)
            work = partial(self._respond, starts, width, block, transformed, *plans)
            self._stages[1].append([work])

    def _respond(
        self, starts: Any, width: int, block: Any, transformed: Any, forward: Any, inverse: Any
    ) -> None:
        """Transform some columns, multiply their waves with the symbol, transform them back."""
        waves, m1, twist, order, turns = self._columns
        for j in starts:
            count = min(width, waves.shape[1] - j)
            _gather(waves, j, count, block, twist, order)
            forward()
            respond(transformed, m1, j, count, self._weights, twist.size > 0, *turns)
            inverse()
            _scatter(block, j, count, waves, twist, order)


def _take_in_place(points: Any, order1: Any, order2: Any, first: int, end: int) -> None:
    """Put the points of some rows in order."""
    rows = points[first:end]
    take(rows.copy(), rows, order1, order2, 0, len(rows))


@contracted
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


@contracted
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

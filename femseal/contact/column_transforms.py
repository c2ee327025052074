"""Transform the columns of waves, multiply them by the Fourier symbol and transform them back, for a `Convolution`.

The columns are processed in blocks that fit in the cache. Columns of large grids are copied to a contiguous block
before they are transformed. On small grids, this copy is not needed.

If the first axis of a large grid is free, each column gets two transforms of length m instead of being padded to the
full length 2m. The first transform, of the points, gives the even-numbered waves. For the second transform, each point
j is multiplied by exp(−iπj/m). The second transform gives the odd-numbered waves. The factors exp(−iπj/m) are called
the twist.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..base import Array
from .fft_plans import Axis, Call, Planned, fftw, row_length
from .wave_loops import copy_columns, copy_columns_back, multiply, multiply_mixing

#: Size of a block of columns [byte], which should fit in a level-2 cache together with the symbol.
BLOCK_BYTES = 2**18
#: Blocks begin at multiples of this number of columns, as the vector instructions of FFTW require.
_ALIGNED = 8


class StridedColumns:
    """Transform the columns of a small grid, multiply their waves by the symbol, and transform them back.

    Each transform reads columns of the array of all waves, without copying them first, and writes to a block in the
    cache.

    waves : array (>= n1, waves), transforms of the rows.
    weights : weights of the waves, see `mixing_weights`.
    transforms : number of transforms of each column. A single transform gives all waves. If there are two transforms,
        the first gives the even-numbered waves and the second the odd-numbered ones.
    """

    #: Number of blocks that have to fit in the cache at the same time.
    blocks = 1

    def __init__(
        self, waves: Any, axis1: Axis, axis2: Axis, weights: Array, transforms: int
    ) -> None:
        self.waves = waves
        self.weights = weights
        self.transforms = transforms
        self.length = axis1.length // transforms
        lengths = self.length, axis2.length
        # for both axes, the factors e² = exp(iπk/N) of the waves k of a mirror axis, see `multiply_mixing`
        self.turns = [np.exp(1j * np.pi * np.arange(n // 2 + 1) / n) for n in lengths]
        # the factors exp(−iπj/m) by which the points j are multiplied to obtain the odd-numbered waves, where m is
        # the length of each of two transforms; empty with a single transform
        twist = np.exp(-1j * np.pi * np.arange(axis1.points) / self.length).astype(waves.dtype)
        self.twist = twist if transforms == 2 else twist[:0]
        self.order = axis1.order

    @property
    def row_length(self) -> int:
        """Stride between successive columns of a block, counted in waves."""
        return self.length

    def calls(self, planned: Planned, threads: int) -> list[list[Call]]:
        """Return, for each thread, the calls that turn the waves of the pressure into waves of the displacement."""
        n_columns = self.waves.shape[1]
        kind = self.waves.dtype
        column_bytes = self.transforms * self.length * kind.itemsize
        # Number of columns of a block, chosen so that the block and its copy fit in the cache. Copying takes three
        # times as long with fewer than `_ALIGNED` columns, and also with 16 long columns.
        width = BLOCK_BYTES // (column_bytes * self.blocks)
        if width >= n_columns:
            width = n_columns
        else:
            width = max(_ALIGNED, width - width % _ALIGNED)
        block_shape = self.transforms * width, self.row_length
        calls_by_thread = []
        for starts in np.array_split(range(0, n_columns, width), threads):
            block = fftw().zeros_aligned(block_shape, kind)
            copy = fftw().zeros_aligned(block_shape, kind)
            calls: list[Call] = []
            for first in starts:
                columns = self.waves[:, first : first + width]
                calls += self.calls_of_block(planned, columns, block, copy, first)
            calls_by_thread.append(calls)
        return calls_by_thread

    def calls_of_block(
        self, planned: Planned, columns: Any, block: Any, copy: Any, first: int
    ) -> list[Call]:
        """Return the calls that transform some columns, multiply them by the symbol, and transform them back.

        Parameters
        ----------
        planned : callable
            Function that plans a transform and its inverse, see `planner`.
        columns : array (>= n1, columns)
            Some successive columns of the array of all waves.
        block, copy : array
            Work arrays for one block of columns; `copy` is used only for large grids.
        first : int
            Index of the first column of `columns` in the array of all waves.
        """
        n_columns = columns.shape[1]
        waves = block[:n_columns, : self.length].T
        forward, backward = planned(columns, waves, columns, axis=0)
        return [forward, self.response(block, first, n_columns), backward]

    def response(self, block: Any, first: int, count: int) -> Call:
        """Make the call that multiplies the waves in a block by the symbol."""
        if len(self.weights) == 1:
            return partial(multiply, block[:count], self.weights[0, first : first + count])
        return self.mixing_response(block, first, count)

    def mixing_response(self, block: Any, first: int, count: int) -> Call:
        """Make the call that applies K to the waves in a block, if K mixes waves or each column has two transforms."""
        is_twisted = self.transforms > 1
        return partial(
            multiply_mixing, block, self.length, first, count, self.weights, is_twisted, *self.turns
        )


class CopiedColumns(StridedColumns):
    """Transform the columns of a large grid, which are first copied to the rows of a block.

    The points of a mirror axis are copied in the order of the transform. If the first axis is free and has the padded
    length 2m, the block has two rows for each column. The first row contains the points of the column; its transform
    gives the even-numbered waves. The second row contains the points j multiplied by exp(−iπj/m); its transform
    gives the odd-numbered waves.
    """

    blocks = 2

    @property
    def row_length(self) -> int:
        """Stride between successive columns of a block, counted in waves and including unused cache lines."""
        return row_length(self.length, self.waves.dtype.itemsize)

    def calls_of_block(
        self, planned: Planned, columns: Any, block: Any, copy: Any, first: int
    ) -> list[Call]:
        """Return the calls that transform some columns, multiply them by the symbol, and transform them back.

        The columns are first copied to the rows of `copy`, because rows are transformed faster than columns. The
        waves are written to `block`. The inverse transform writes to `copy`, from where the points are copied back to
        the columns. `StridedColumns.calls_of_block` describes the parameters.
        """
        points = copy[:, : self.length]
        waves = block[:, : self.length]
        forward, backward = planned(points, waves, points, axis=1)
        return [
            partial(copy_columns, columns, copy, self.twist, self.order),
            forward,
            self.mixing_response(block, first, columns.shape[1]),
            backward,
            partial(copy_columns_back, columns, copy, self.twist, self.order),
        ]

"""Compute displacements u = K p from pressures p by fast Fourier transforms, for every kind of boundary.

Here K is the compliance of the half-space, and its Fourier symbol is the array of its eigenvalues. A product K p has
three stages:

1. The rows of the pressure are transformed to waves. Before the transform, the points of mirror axes are reordered, and
   zeros are appended along free axes.
2. The columns of waves are transformed, multiplied by the Fourier symbol, and transformed back. The columns are
   processed in blocks that fit in the cache.
3. The rows are transformed back, which gives the displacement.

On a mirror axis, the cosine transform of N points is computed as a Fourier transform of the points in the order 0, 2, 4
… 5, 3, 1. Each of the cosine coefficients k and N − k is a linear combination of the waves k and N − k. Hence, K mixes
the waves k and N − k (Makhoul, IEEE Trans. Acoust. Speech Signal Process. 28, 1980, 27). A free axis is padded with
zeros; rows that contain only zeros are not transformed.

Large grids do not fit in any cache. On large grids, the waves and the displacement therefore share one array, with rows
longer than those of the grid. Columns of large grids are copied to a contiguous block before they are transformed. On
small grids, this copy is not needed.

If the first axis of a large grid is free, each column gets two transforms of length m instead of being padded to the
full length 2m. The first transform, of the points, gives the even-numbered waves. For the second transform, each point
j is multiplied by exp(−iπj/m). The second transform gives the odd-numbered waves. The factors exp(−iπj/m) are called
the twist.

FFTW plans its transforms with the option FFTW_ESTIMATE and without wisdom. The plans then follow from fixed rules
instead of measured times. All processes therefore use the same plans and give identical results. On 256² to 1024²
points, a contact solution with these plans takes 0.9 to 1.03 times as long as with measured plans if the axes are
periodic, and 0.8 to 0.95 times as long if they are mirrors. On smaller periodic grids, contact solutions take longer
than with measured plans: by 2 % at 48², 8 % at 64², 12 % at 96² and 24 % at 128² points.
"""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from scipy.fft import next_fast_len

from ..base import Array, Indices, Shape
from ..base.compiled import on_threads, parts
from .wave_loops import (
    copy_back,
    copy_columns,
    copy_columns_back,
    copy_in_order,
    multiply,
    multiply_mixing,
)

#: Kind of each axis: "periodic", "mirror" or "free".
Boundary = tuple[str, str]
#: A call without arguments that a stage consists of.
Call = Callable[..., Any]
#: A function that plans a transform and its inverse, see `planner`.
Planned = Callable[..., tuple[Call, Call]]
#: Number of points from which on a grid is large.
LARGE = 2**20
#: Size of a block of columns [byte], which should fit in a level-2 cache together with the symbol.
BLOCK_BYTES = 2**18
#: Smallest number of points of the rows that are transformed together.
ROW_POINTS = 2**16
#: Largest number of parts into which all rows are divided.
ROW_PARTS = 16
#: Blocks begin at multiples of this number of columns, as the vector instructions of FFTW require.
_ALIGNED = 8
#: Size of a cache line [byte].
LINE = 64
#: Long rows of waves take 8k + 3 cache lines, so that the points of a column do not displace each other in the cache.
_LINES, _MORE_LINES = 8, 3
#: FFTW makes plans in one thread at a time.
_PLANNING = threading.RLock()


class Axis(NamedTuple):
    """Describe an axis of a grid and its transform.

    points : number of points.
    length : length of the transform.
    order : array (points,), grid index of the point at each position in the transform.
    is_mirror : whether the pressure is mirrored beyond the ends of the axis.
    """

    points: int
    length: int
    order: Indices
    is_mirror: bool

    @classmethod
    def of(cls, n: int, kind: str) -> Axis:
        """Describe an axis with n points. The kind of the axis is "periodic", "mirror" or "free"."""
        is_mirror = kind == "mirror"
        length = padded_length(n) if kind == "free" else n
        return cls(n, length, transform_order(n, is_mirror), is_mirror)

    @property
    def is_padded(self) -> bool:
        """Whether zeros are appended to the points of the axis."""
        return self.length > self.points


class Convolution:
    """Compute the displacement K p from the pressure p on several threads.

    Parameters
    ----------
    shape : pair of int
        Numbers of points (n1, n2).
    boundary : pair of str
        Kind of each axis: "periodic", "mirror" or "free".
    symbol : array or None
        Eigenvalues of K [m/Pa], see `HalfSpace.symbol`; None if `over` is given.
    dtype : dtype
        Type of the arrays and the transforms: double or single precision.
    threads : int
        Number of threads.
    over : Convolution, optional
        Another convolution with the same compliance K and at least the same precision. The two convolutions share all
        memory except `pressure`. Calling `apply` on one overwrites the displacement of the other.

    Attributes
    ----------
    pressure : array (n1, n2)
        Pressure [Pa].
    rows : array (n1, >= n2)
        Displacement, followed by unused values in each row.
    displacement : array (n1, n2)
        Displacement [m], a view of `rows`.
    """

    def __init__(
        self,
        shape: Shape,
        boundary: Boundary,
        symbol: Array | None,
        *,
        dtype: Any = np.float64,
        threads: int = 1,
        over: Convolution | None = None,
    ) -> None:
        self._threads = threads
        axis1 = Axis.of(shape[0], boundary[0])
        axis2 = Axis.of(shape[1], boundary[1])
        is_large = math.prod(shape) >= LARGE
        # a first axis that is not padded as a whole has one transform for its even waves and one for its odd waves
        transforms = 2 if is_large and axis1.is_padded else 1

        if over is None:
            assert symbol is not None
            self._weights = mixing_weights(symbol, axis1.is_mirror, axis2.is_mirror, transforms)
            # FFTW does not normalise: a transform and its inverse together multiply by the number of points
            self._weights /= axis1.length * axis2.length
            if len(self._weights) == 1 and not is_large:
                self._weights = extend_to_all_waves(self._weights, axis1.length)
        else:
            self._weights = over._weights
        waves = self._allocate(shape, axis1, axis2, np.dtype(dtype), transforms, over)
        self._stages = self._plan(waves, axis1, axis2, is_large, transforms)
        # all calls for a single thread: on small grids the time between calls matters
        self._calls = [call for stage in self._stages for part in stage for call in part]

    def _allocate(
        self,
        shape: Shape,
        axis1: Axis,
        axis2: Axis,
        real: np.dtype[Any],
        transforms: int,
        over: Convolution | None,
    ) -> Any:
        """Create the arrays of the pressure and the displacement, and return the array of the waves (row, wave)."""
        complex_type = np.result_type(real, np.complex64)
        n_waves = axis2.length // 2 + 1  # waves of a row
        length = row_length(n_waves, complex_type.itemsize)
        n_rows = axis1.points if transforms == 2 else axis1.length
        size = n_rows * length * complex_type.itemsize  # bytes
        self._memory: Any = fftw().empty_aligned(size, np.uint8) if over is None else over._memory
        # long rows end with unused values, see `row_length`
        rows_of_waves = self._memory[:size].view(complex_type).reshape(n_rows, length)
        waves = rows_of_waves[:, :n_waves]
        self.pressure: Any = fftw().zeros_aligned(shape, dtype=real)
        if math.prod(shape) >= LARGE:
            # the displacement uses the memory of the waves
            self.rows = rows_of_waves[: axis1.points].view(real)
        else:
            # transforms to other memory are a sixth faster
            self.rows = fftw().empty_aligned((axis1.points, axis2.length), real)
        self.displacement = self.rows[:, : axis2.points]
        return waves

    def _plan(
        self, waves: Any, axis1: Axis, axis2: Axis, is_large: bool, transforms: int
    ) -> list[list[list[Call]]]:
        """Plan the transforms, and return the three stages of a product: for each stage, its calls (part, call).

        The parts of a stage are independent of each other and can be shared between threads.
        """
        with planner() as planned:
            rows: Rows | ReorderedRows
            # points are reordered along mirror axes; along the first axis of large grids, only when columns are copied
            is_mirror = axis2.is_mirror or (axis1.is_mirror and not is_large)
            if is_mirror or axis2.is_padded:
                order1 = np.arange(axis1.points) if is_large else axis1.order
                rows = ReorderedRows(self, waves, axis2, order1, is_mirror, is_large)
            else:
                rows = Rows(self, waves, axis2)
            transform_rows, transform_rows_back = rows.calls(planned)
            if len(waves) > axis1.points:  # the waves of the padding rows are 0
                transform_rows.append([partial(waves[axis1.points :].fill, 0)])
            columns: StridedColumns | CopiedColumns
            kind_of_columns = CopiedColumns if is_large else StridedColumns
            columns = kind_of_columns(waves, axis1, axis2, self._weights, transforms)
            return [transform_rows, columns.calls(planned, self._threads), transform_rows_back]

    def apply(self) -> None:
        """Compute `displacement` from `pressure`."""
        if self._threads == 1:
            _run_calls(self._calls)
            return
        for parts_of_stage in self._stages:
            on_threads(self._threads, _run_calls, parts_of_stage)


class Rows:
    """Transform the rows of a grid and back, for rows that need neither reordering nor padding.

    waves : waves of all rows of the grid, followed by the waves of rows of zeros if the first axis is padded.
    """

    def __init__(self, product: Convolution, waves: Any, axis2: Axis) -> None:
        self.points = product.pressure
        self.target = product.rows[:, : axis2.length]
        self.waves = waves
        self.length = axis2.length

    def calls(self, planned: Planned) -> tuple[list[list[Call]], list[list[Call]]]:
        """Return two nested lists of calls (part, call): one for the transforms, and one for the inverse transforms.

        A part consists of successive rows.
        """
        forward_parts = []
        backward_parts = []
        n1 = len(self.target)
        rows_of_part = max(ROW_POINTS / self.length, n1 / ROW_PARTS)
        for first, end in parts(n1, rows_of_part):
            forward, backward = planned(
                self.points[first:end], self.waves[first:end], self.target[first:end], axis=1
            )
            forward_parts.append([*self.before(first, end), forward])
            backward_parts.append([backward, *self.after(first, end)])
        return forward_parts, backward_parts

    def before(self, first: int, end: int) -> list[Call]:
        """Return the calls that must run before the rows `first` to `end` − 1 are transformed."""
        return []

    def after(self, first: int, end: int) -> list[Call]:
        """Return the calls that must run after the rows `first` to `end` − 1 have been transformed back."""
        return []


class ReorderedRows(Rows):
    """Transform rows whose points must first be reordered (mirror axis) or padded with zeros (free axis).

    order1 : order in which the rows are copied. On small grids, this is the order of the transform along the first
        axis; on large grids, it is the order of the grid.
    is_mirror : whether at least one axis is a mirror, so that its points are reordered.
    """

    def __init__(
        self,
        product: Convolution,
        waves: Any,
        axis2: Axis,
        order1: Indices,
        is_mirror: bool,
        is_large: bool,
    ) -> None:
        super().__init__(product, waves, axis2)
        # On small grids, the reordered rows need additional memory. On large grids only the points of each row are
        # reordered, which is possible within the memory of the row.
        if is_mirror and not is_large:
            self.target = fftw().empty_aligned(self.target.shape, self.target.dtype)
        self.points = self.target  # the points are copied there before the transform
        self.pressure = product.pressure
        self.displacement = product.displacement if is_mirror else None
        self.orders = order1, axis2.order

    def before(self, first: int, end: int) -> list[Call]:
        """Return the call that copies the rows `first` to `end` − 1 in the order of the transform and appends zeros."""
        return [partial(copy_in_order, self.pressure, self.target, *self.orders, first, end)]

    def after(self, first: int, end: int) -> list[Call]:
        """Return the call that restores the grid order of the points, or no call if they were not reordered."""
        if self.displacement is None:
            return []
        return [partial(copy_back, self.target, self.displacement, *self.orders, first, end)]


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


def padded_length(n: int) -> int:
    """Compute the length to which a free axis of n points is padded, so that a cyclic convolution does not overlap.

    The padded length is even and at least 2 n. The padded length has small prime factors, so that the transform is
    fast.
    """
    return 2 * int(next_fast_len(n, real=True)) if n > 1 else 1


def row_length(waves: int, itemsize: int) -> int:
    """Compute the stride between successive rows, counted in waves and including unused cache lines."""
    lines = math.ceil(waves * itemsize / LINE)
    if lines <= _LINES:
        return waves
    return (lines + (_MORE_LINES - lines) % _LINES) * LINE // itemsize


@cache
def fftw() -> Any:
    """Import pyfftw without its transforms of Dask arrays, because importing Dask takes longer than a small run."""
    hides_dask = "dask" not in sys.modules
    if hides_dask:
        sys.modules["dask"] = None  # type: ignore[assignment]
    try:
        import pyfftw
    finally:
        if hides_dask:
            del sys.modules["dask"]
    return pyfftw


@contextmanager
def planner() -> Iterator[Planned]:
    """Provide a function that plans a transform and its inverse, for use in a `with` block.

    The transform reads `points` and writes `waves`. The inverse transform overwrites `waves` and writes `target`.

    Which plan FFTW chooses depends on its earlier plans, which FFTW calls wisdom. The wisdom is therefore deleted
    before each plan. It is kept only if the arrays have the same shapes, strides and types as for the previous plan:
    with the wisdom of an identical plan, FFTW plans ten times as fast. At the end of the `with` block, the wisdom that
    existed before the block is restored. Saving and restoring the wisdom takes milliseconds.
    """
    pyfftw = fftw()
    last_problem = None

    def planned(points: Any, waves: Any, target: Any, *, axis: int) -> tuple[Any, Any]:
        """Plan the transform from `points` to `waves` and the inverse transform from `waves` to `target`.

        Returns two functions without arguments that perform the transform and the inverse transform.
        """
        nonlocal last_problem
        problem = [(a.shape, a.strides, a.dtype) for a in (points, waves, target)]
        if problem != last_problem:
            pyfftw.forget_wisdom()
        last_problem = problem
        forward = pyfftw.FFTW(points, waves, (axis,), "FFTW_FORWARD", ("FFTW_ESTIMATE",))
        backward = pyfftw.FFTW(
            waves, target, (axis,), "FFTW_BACKWARD", ("FFTW_ESTIMATE", "FFTW_DESTROY_INPUT")
        )
        return forward.execute, backward.execute

    with _PLANNING:
        wisdom = pyfftw.export_wisdom()
        try:
            yield planned
        finally:
            pyfftw.forget_wisdom()
            pyfftw.import_wisdom(wisdom)


def _run_calls(calls: Sequence[Call]) -> None:
    """Run calls one after another."""
    for call in calls:
        call()


def mixing_weights(symbol: Array, mirror1: bool, mirror2: bool, transforms: int) -> Array:
    """Compute the weights by which `multiply_mixing` multiplies the waves.

    Let S be the Fourier symbol of K. Without a mirror axis, there is one array of weights, the transpose of S. With a
    mirror axis, there are four arrays of weights. Each combines the half sum ½(S(k) + S(N − k)) or the half difference
    ½(S(k) − S(N − k)) along the two axes:

    ===== ================ =================
    array along first axis along second axis
    ===== ================ =================
    0     half sum         half sum
    1     half difference  half sum
    2     half sum         half difference
    3     half difference  half difference
    ===== ================ =================

    Along other axes, S(k) takes the place of the half sum, and 0 that of the half difference. The cosine coefficient N
    of N points is always 0, so that S(N) is arbitrary. S(N) is set to S(0), so that the half difference at k = 0
    vanishes.

    Parameters
    ----------
    symbol : array
        Eigenvalues of K [m/Pa].
    mirror1, mirror2 : bool
        Whether the first and the second axis are mirrors.
    transforms : int
        Number of transforms along the first axis. With two transforms, the weights of the even-numbered waves
        come before the weights of the odd-numbered waves.

    Returns
    -------
    array (1 or 4, waves along the second axis, waves along the first axis)
    """
    # half sums and half differences (wave along the first axis, wave along the second axis); each axis doubles the
    # number of these arrays
    halves = [symbol]
    for axis, is_mirror in enumerate((mirror1, mirror2)):
        if is_mirror:
            n = symbol.shape[axis]
            k = np.arange(n // 2 + 1)
            at_k = [part.take(k, axis) for part in halves]
            at_other = [part.take(-k % n, axis) for part in halves]  # at N − k, and at 0 for k = 0
            half_sums = [(a + b) / 2 for a, b in zip(at_k, at_other, strict=True)]
            half_differences = [(a - b) / 2 for a, b in zip(at_k, at_other, strict=True)]
            halves = half_sums + half_differences
        elif mirror1 or mirror2:
            halves += [np.zeros_like(part) for part in halves]
    weights = []
    for part in halves:
        # with two transforms, the even waves along the first axis come before the odd ones
        by_transform = [part[first::transforms] for first in range(transforms)]
        weights.append(np.concatenate(by_transform).T)
    return np.array(weights, order="C")


def extend_to_all_waves(weights: Array, n: int) -> Array:
    """Copy the weights (1, columns, n // 2 + 1) of the waves k <= n/2 of a column to the waves n − k.

    The result has the shape (1, columns, n). The waves k and n − k have the same weight.
    """
    k = np.arange(n)
    return np.ascontiguousarray(weights[:, :, np.minimum(k, n - k)])


def transform_order(n: int, mirror: bool) -> Indices:
    """List the n points of an axis in the order in which they are transformed: 0, 2, 4 … 5, 3, 1 for a mirror axis."""
    points = np.arange(n)
    if not mirror:
        return points
    return np.concatenate((points[::2], points[1::2][::-1]))

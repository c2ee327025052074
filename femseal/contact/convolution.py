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
longer than those of the grid. `row_transforms` and `column_transforms` describe the stages, and `fft_plans` how FFTW
plans the transforms.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.fft import next_fast_len

from ..base import Array, Indices, Shape
from ..base.compiled import on_threads
from .column_transforms import CopiedColumns, StridedColumns
from .fft_plans import Axis, Call, fftw, planner, row_length
from .row_transforms import ReorderedRows, Rows

#: Kind of each axis: "periodic", "mirror" or "free".
Boundary = tuple[str, str]
#: Number of points from which on a grid is large.
LARGE = 2**20


class Convolution:
    """Compute the displacement K p from the pressure p on several threads.

    Parameters
    ----------
    shape : pair of int
        Numbers of points (n1, n2).
    boundary : pair of str
        Kind of each axis: "periodic", "mirror" or "free".
    symbol : array or None
        Eigenvalues of K [m/Pa], see `HalfSpace.symbol`; None if `memory_of` is given.
    dtype : dtype
        Type of the arrays and the transforms: double or single precision.
    threads : int
        Number of threads.
    memory_of : Convolution, optional
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
        memory_of: Convolution | None = None,
    ) -> None:
        self._threads = threads
        axis1 = _make_axis(shape[0], boundary[0])
        axis2 = _make_axis(shape[1], boundary[1])
        is_large = math.prod(shape) >= LARGE
        # a first axis that is not padded as a whole has one transform for its even waves and one for its odd waves
        transforms = 2 if is_large and axis1.is_padded else 1

        if memory_of is None:
            assert symbol is not None
            self._weights = mixing_weights(symbol, axis1.is_mirror, axis2.is_mirror, transforms)
            # FFTW does not normalise: a transform and its inverse together multiply by the number of points
            self._weights /= axis1.length * axis2.length
            if len(self._weights) == 1 and not is_large:
                self._weights = extend_to_all_waves(self._weights, axis1.length)
        else:
            self._weights = memory_of._weights
        waves = self._allocate(shape, axis1, axis2, np.dtype(dtype), transforms, memory_of)
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
        memory_of: Convolution | None,
    ) -> Any:
        """Create the arrays of the pressure and the displacement, and return the array of the waves (row, wave)."""
        complex_type = np.result_type(real, np.complex64)
        n_waves = axis2.length // 2 + 1  # waves of a row
        length = row_length(n_waves, complex_type.itemsize)
        n_rows = axis1.points if transforms == 2 else axis1.length
        size = n_rows * length * complex_type.itemsize  # bytes
        memory = fftw().empty_aligned(size, np.uint8) if memory_of is None else memory_of._memory
        self._memory: Any = memory
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
                rows = ReorderedRows(
                    self.pressure, self.rows, waves, axis2, order1, is_mirror, is_large
                )
            else:
                rows = Rows(self.pressure, self.rows, waves, axis2)
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


def _make_axis(n: int, kind: str) -> Axis:
    """Describe an axis with n points. The kind of the axis is "periodic", "mirror" or "free"."""
    is_mirror = kind == "mirror"
    length = padded_length(n) if kind == "free" else n
    return Axis(n, length, transform_order(n, is_mirror), is_mirror)


def padded_length(n: int) -> int:
    """Compute the length to which a free axis of n points is padded, so that a cyclic convolution does not overlap.

    The padded length is even and at least 2 n. The padded length has small prime factors, so that the transform is
    fast.
    """
    return 2 * int(next_fast_len(n, real=True)) if n > 1 else 1


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

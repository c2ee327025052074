"""Products u = K p on a grid by fast Fourier transforms, for every kind of boundary.

A product has three stages: rows are transformed, behind their points being laid out for it on mirror and free axes; for
a block of columns at a time, while it is in cache, columns are transformed, waves are multiplied with the symbol, and
columns are transformed back; rows are transformed back.

A mirror axis needs no more than the transform of its N points taken in the order 0, 2, 4 … 5, 3, 1: cosine coefficients
k and N − k are sums of the waves k and N − k, so that K mixes these two. Source: Makhoul, IEEE Trans. Acoust. Speech
Signal Process. 28, 1980, 27. A free axis is padded with zeros; rows of zeros are not transformed.

On large grids, which no cache holds, waves take the memory of the displacement, in rows that are longer than those of
its points, and a first axis that is free is never padded as a whole: with m points, half of the padded length, its even
waves are the transform of the points, and its odd ones that of the points times exp(−iπk/m). Columns of large grids
are copied to a block; others go there from strided memory.

FFTW plans with FFTW_ESTIMATE and without wisdom. It then chooses by a rule and not by timing, so that every process
gets the same plans and the same bits. Measured against plans that FFTW timed, whole solutions of 256² to 1024² points
take 0.9 to 1.03 times as long on periodic and 0.8 to 0.95 times on mirror axes. Smaller periodic grids are slower: by
2 % at 48², 8 % at 64², 12 % at 96² and 24 % at 128².
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
from ..base.compiled import compiled, on_threads, parts

#: Kind of each axis, periodic, mirror or free.
Boundary = tuple[str, str]
#: A call of a stage, and what plans the two of a transform there and back.
Call = Callable[..., Any]
Planned = Callable[..., tuple[Call, Call]]
#: Number of points from which a grid is large.
LARGE = 2**20
#: Bytes of a block of columns, which should fit in a level-2 cache together with the symbol.
BLOCK_BYTES = 2**18
#: Least number of points of the rows that are transformed together, and most parts of all rows.
ROW_POINTS, ROW_PARTS = 2**16, 16
#: Blocks begin at multiples of so many columns, as the vector instructions of FFTW need.
_ALIGNED = 8
#: Rows of waves take 8k + 3 cache lines of 64 bytes: the points of a column do not push each other out of the cache.
LINE, _LINES, _MORE_LINES = 64, 8, 3
_PLANNING = threading.RLock()


class Axis(NamedTuple):
    """One axis of a grid.

    points : number of points. length : that of its transform. order : in which points are transformed (points,).
    is_mirror : whether it continues by its mirror image.
    """

    points: int
    length: int
    order: Indices
    is_mirror: bool

    @classmethod
    def of(cls, n: int, kind: str) -> Axis:
        """The axis of n points of a kind, "periodic", "mirror" or "free"."""
        is_mirror = kind == "mirror"
        return cls(n, padded_length(n) if kind == "free" else n, order_of(n, is_mirror), is_mirror)

    @property
    def is_padded(self) -> bool:
        """Whether zeros follow the points."""
        return self.length > self.points


class Convolution:
    """displacement = K pressure between two arrays of its own, in stages of which threads share the parts.

    Parameters
    ----------
    shape : (n1, n2) points.
    boundary : kind of each axis, "periodic", "mirror" or "free".
    symbol : eigenvalues of K [m/Pa] as `HalfSpace.symbol` gives them; None with `over`.
    dtype : of the arrays and the transforms, double or single precision.
    threads : number of threads at work together.
    over : a product with the same K, of no smaller precision, whose memory is used for all but `pressure`. Each
        `apply` of one overwrites the displacement of the other.

    Attributes
    ----------
    pressure : (n1, n2) [Pa].
    rows : memory of (n1, >= n2) numbers, whose rows begin with those of the displacement.
    displacement : (n1, n2) [m], a view of it.
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
        self._threads, real = threads, np.dtype(dtype)
        kind = np.result_type(real, np.complex64)
        axis1, axis2 = (Axis.of(n, end) for n, end in zip(shape, boundary, strict=True))
        is_large = math.prod(shape) >= LARGE
        # a first axis that is not padded as a whole has a transform for its even and one for its odd waves
        transforms = 2 if is_large and axis1.is_padded else 1
        if over is None:
            assert symbol is not None
            self._weights = weights_of(symbol, axis1.is_mirror, axis2.is_mirror, transforms)
            self._weights /= (
                axis1.length * axis2.length
            )  # with which transforms there and back multiply
        else:
            self._weights = over._weights
        waves_of_row = axis2.length // 2 + 1
        length = row_length(waves_of_row, kind.itemsize)
        count = axis1.points if transforms == 2 else axis1.length
        size = count * length * kind.itemsize
        self._memory: Any = fftw().empty_aligned(size, np.uint8) if over is None else over._memory
        every_wave = self._memory[:size].view(kind).reshape(count, length)
        waves = every_wave[:, :waves_of_row]
        self.pressure: Any = fftw().zeros_aligned(shape, dtype=real)
        # a large displacement takes the memory of its waves; transforms to another one are a sixth faster
        self.rows = (
            every_wave[: axis1.points].view(real)
            if is_large
            else fftw().empty_aligned((axis1.points, axis2.length), real)
        )
        self.displacement = self.rows[:, : axis2.points]
        with planner() as planned:
            rows: Rows | LaidOutRows
            # large grids put columns in order as they are copied
            is_mirror = axis2.is_mirror or (axis1.is_mirror and not is_large)
            if is_mirror or axis2.is_padded:
                order1 = np.arange(axis1.points) if is_large else axis1.order
                rows = LaidOutRows(self, waves, axis2, order1, is_mirror, is_large)
            else:
                rows = Rows(self, waves, axis2)
            first, last = rows.calls(planned)
            columns: StridedColumns | CopiedColumns
            kind_of_columns = CopiedColumns if is_large else StridedColumns
            columns = kind_of_columns(waves, axis1, axis2, self._weights, transforms)
            if count > axis1.points:
                first.append([partial(waves[axis1.points :].fill, 0)])
            self._stages = [first, columns.calls(planned, threads), last]
        # by one thread: on small grids passing from call to call is what takes time
        self._calls = [call for stage in self._stages for part in stage for call in part]

    def apply(self) -> None:
        """Fill `displacement` from `pressure`."""
        if self._threads == 1:
            _in_turn(self._calls)
            return
        for parts_of_stage in self._stages:
            on_threads(self._threads, _in_turn, parts_of_stage)


class Rows:
    """Transforms of rows whose points are transformed as they are, on a periodic second axis.

    waves : of every row of the grid, and of rows of zeros behind them.
    """

    def __init__(self, product: Convolution, waves: Any, axis2: Axis) -> None:
        self.points, self.target = product.pressure, product.rows[:, : axis2.length]
        self.waves, self.length = waves, axis2.length

    def calls(self, planned: Planned) -> tuple[list[list[Call]], list[list[Call]]]:
        """The parts that threads share, and of each the calls: of points to waves, and back."""
        there, back = [], []
        n1 = len(self.target)
        for i, end in parts(n1, max(ROW_POINTS / self.length, n1 / ROW_PARTS)):
            some = self.points[i:end], self.waves[i:end], self.target[i:end]
            forward, backward = planned(*some, axis=1)
            there.append([*self.before(i, end), forward])
            back.append([backward, *self.after(i, end)])
        return there, back

    def before(self, first: int, end: int) -> list[Call]:
        """What is done with some rows before their transform."""
        return []

    def after(self, first: int, end: int) -> list[Call]:
        """What is done with some rows after the transform back."""
        return []


class LaidOutRows(Rows):
    """Transforms of rows that are laid out before: their points in another order, or zeros behind them.

    On a mirror axis the points change their order, rows too on small grids; on a free one zeros follow them.
    order1 : of the rows. is_mirror : whether there is another order than that of the points.
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
        if is_mirror and not is_large:  # rows of large grids are put in order in their own memory
            self.target = fftw().empty_aligned(self.target.shape, self.target.dtype)
        self.points, self.pressure = self.target, product.pressure
        self.displacement = product.displacement if is_mirror else None
        self.orders = order1, axis2.order

    def before(self, first: int, end: int) -> list[Call]:
        """Write the points in order, and zeros behind them."""
        return [partial(lay, self.pressure, self.target, *self.orders, first, end)]

    def after(self, first: int, end: int) -> list[Call]:
        """Write displacements back in the order of the points."""
        if self.displacement is None:
            return []
        return [partial(take, self.target, self.displacement, *self.orders, first, end)]


class StridedColumns:
    """Transforms of columns of small grids, from strided memory to a block in the cache and back.

    waves : of rows (>= n1, waves). weights : see `weights_of`. transforms : number along the first axis, 1 or 2.
    """

    #: Blocks of waves that have to fit in the cache together.
    blocks = 1

    def __init__(
        self, waves: Any, axis1: Axis, axis2: Axis, weights: Array, transforms: int
    ) -> None:
        self.waves, self.weights, self.transforms = waves, weights, transforms
        self.length = axis1.length // transforms
        lengths = self.length, axis2.length
        self.turns = [np.exp(1j * np.pi * np.arange(n // 2 + 1) / n) for n in lengths]
        kind = waves.dtype
        self.twist = np.exp(-1j * np.pi * np.arange(axis1.points) / self.length).astype(kind)
        if transforms == 1:
            self.twist = self.twist[:0]
        self.order = axis1.order

    @property
    def row_length(self) -> int:
        """Waves in the memory of a column in a block."""
        return self.length

    def calls(self, planned: Planned, threads: int) -> list[list[Call]]:
        """For each thread, the calls that turn columns of waves of pressure into those of displacement."""
        count, kind = self.waves.shape[1], self.waves.dtype
        column_bytes = self.transforms * self.length * kind.itemsize
        # a block and its copy fit in the cache; of fewer columns, or of 16 long ones, copies take thrice the time
        width = BLOCK_BYTES // (column_bytes * self.blocks)
        width = count if width >= count else max(_ALIGNED, width - width % _ALIGNED)
        stage = []
        for starts in np.array_split(range(0, count, width), threads):
            block, copy = (
                fftw().zeros_aligned((self.transforms * width, self.row_length), kind)
                for _ in range(2)
            )
            calls: list[Call] = []
            for first in starts:
                some = self.waves[:, first : first + width]
                calls += self.calls_of_block(planned, some, block, copy, first)
            stage.append(calls)
        return stage

    def calls_of_block(
        self, planned: Planned, columns: Any, block: Any, copy: Any, first: int
    ) -> list[Call]:
        """The calls for some columns, of which `first` is the number of the first."""
        points = block[: columns.shape[1], : self.length].T
        there, back = planned(columns, points, columns, axis=0)
        return [there, self.response(block, first, columns.shape[1]), back]

    def response(self, block: Any, first: int, count: int) -> Call:
        """The call that multiplies the waves in a block with the symbol."""
        is_twisted = self.transforms > 1
        return partial(
            respond, block, self.length, first, count, self.weights, is_twisted, *self.turns
        )


class CopiedColumns(StridedColumns):
    """Transforms of columns of large grids, which are copied to a block, in the order of a mirror and with a twist.

    With m points, half of the padded length of a free axis, its even waves are the transform of the points, and its odd
    ones that of the points times the twist exp(−iπk/m).
    """

    blocks = 2

    @property
    def row_length(self) -> int:
        """Waves in the memory of a column in a block, with some cache lines empty behind them."""
        return row_length(self.length, self.waves.dtype.itemsize)

    def calls_of_block(
        self, planned: Planned, columns: Any, block: Any, copy: Any, first: int
    ) -> list[Call]:
        """The calls for some columns, of which `first` is the number of the first."""
        points, waves = copy[:, : self.length], block[:, : self.length]
        there, back = planned(points, waves, points, axis=1)
        return [
            partial(gather, columns, copy, self.twist, self.order),
            there,
            self.response(block, first, columns.shape[1]),
            back,
            partial(scatter, columns, copy, self.twist, self.order),
        ]


def padded_length(n: int) -> int:
    """Even length to which a free axis of n points is padded, so that a cyclic convolution has no wrap-around."""
    return 2 * int(next_fast_len(n, real=True)) if n > 1 else 1


def row_length(waves: int, itemsize: int) -> int:
    """Number of waves in the memory of a row; between long rows some cache lines stay empty."""
    lines = math.ceil(waves * itemsize / LINE)
    if lines <= _LINES:
        return waves
    return (lines + (_MORE_LINES - lines) % _LINES) * LINE // itemsize


@cache
def fftw() -> Any:
    """pyfftw without its transforms of Dask arrays, whose import takes longer than a small run (0.5 s of CPU)."""
    hidden = "dask" not in sys.modules
    if hidden:
        sys.modules["dask"] = None  # type: ignore[assignment]
    try:
        import pyfftw
    finally:
        if hidden:
            del sys.modules["dask"]
    return pyfftw


@contextmanager
def planner() -> Iterator[Planned]:
    """Context with a function that plans FFTW's transforms points → waves and, destroying them, waves → target.

    Earlier plans would change its choice, so that it forgets them; for the same problem as the one before it makes the
    same plan in a tenth of the time. After the context FFTW knows what it knew before: keeping and restoring that takes
    milliseconds.
    """
    pyfftw = fftw()
    flags, last = ("FFTW_ESTIMATE", "FFTW_DESTROY_INPUT"), None

    def planned(points: Any, waves: Any, target: Any, *, axis: int) -> tuple[Any, Any]:
        nonlocal last
        problem = [(a.shape, a.strides, a.dtype) for a in (points, waves, target)]
        if problem != last:
            pyfftw.forget_wisdom()
        last = problem
        forward = pyfftw.FFTW(points, waves, (axis,), "FFTW_FORWARD", flags[:1])
        return forward.execute, pyfftw.FFTW(waves, target, (axis,), "FFTW_BACKWARD", flags).execute

    with _PLANNING:
        known = pyfftw.export_wisdom()
        try:
            yield planned
        finally:
            pyfftw.forget_wisdom()
            pyfftw.import_wisdom(known)


def _in_turn(calls: Sequence[Call]) -> None:
    for call in calls:
        call()


def weights_of(symbol: Array, mirror1: bool, mirror2: bool, transforms: int) -> Array:
    """The symbol or, if an axis is a mirror, its four means of sums and differences over k and N − k, transposed.

    The second and the fourth have differences along the first axis, the third and the fourth along the second. The
    cosine coefficient N of N points is always 0, and its symbol whatever makes a difference vanish. Of two transforms
    along the first axis, that of the even waves comes before that of the odd ones.
    """
    means = [symbol]
    for axis, mirror in enumerate((mirror1, mirror2)):
        if mirror:
            n = symbol.shape[axis]
            k = np.arange(n // 2 + 1)
            pairs = [(part.take(k, axis), part.take(-k % n, axis)) for part in means]
            means = [(a + b) / 2 for a, b in pairs] + [(a - b) / 2 for a, b in pairs]
        elif mirror1 or mirror2:
            means += [np.zeros_like(part) for part in means]
    ordered = [np.concatenate([part[i::transforms] for i in range(transforms)]) for part in means]
    return np.array([part.T for part in ordered], order="C")


contracted = compiled(fastmath={"contract"})


@compiled(fastmath={"contract", "nnan", "nsz"})
def respond(block, n, first, count, weights, twisted, turn1, turn2):
    """Turn waves of pressure into waves of displacement in the first n places of a block whose first column is `first`.

    With C(k) = ē V(k) + e V(N − k), e = exp(iπk/2N), and 2 V(k) = e (C(k) − i C(N − k)), a symbol S(k) on C is
    V(k) ← ½(S(k) + S(N − k)) V(k) + ½(S(k) − S(N − k)) e² V(N − k) on V. For two mirrors, V(k1, N − k2) is the
    conjugate of V(N − k1, k2). Where `twisted`, the second half of the block has odd waves, and N − 1 − k is the place
    of the conjugate of k.
    """
    kinds = len(weights)
    other = np.empty(n // 2 + 1, block.dtype)
    for odd in range(2 if twisted else 1):
        half = (n - odd) // 2 + 1
        places = slice(odd * (n // 2 + 1), odd * (n // 2 + 1) + half)
        lone = 1 - odd  # the mean is its own conjugate
        for j in range(count):
            row = block[odd * (block.shape[0] // 2) + j]
            k = first + j
            own = weights[0, k, places]
            if kinds == 1:
                for i in range(half):
                    row[i] *= own[i]
                for i in range(half, n):
                    row[i] *= own[n - odd - i]
                continue
            w1 = weights[1, k, places]
            w2 = weights[2, k, places]
            w12 = weights[3, k, places]
            turn = turn2[k]
            other[0] = row[0]
            for i in range(lone, half):
                other[i] = row[n - odd - i]
            for i in range(half):
                a, b = row[i], other[i]
                c = own[i] * a
                d = own[i] * b
                f = turn1[i] * b
                g = turn1[i] * a.conjugate()
                c += w1[i] * f + turn * (w2[i] * b.conjugate() + w12[i] * g)
                d += w1[i] * g.conjugate()
                d += turn * (w2[i] * a.conjugate() + w12[i] * f.conjugate())
                row[i], other[i] = c, d
            for i in range(lone, half):
                row[n - odd - i] = other[i]


def order_of(n: int, mirror: bool) -> Indices:
    """Points of an axis in the order in which they are transformed: 0, 2, 4 … 5, 3, 1 of a mirror."""
    every = np.arange(n)
    return np.concatenate((every[::2], every[1::2][::-1])) if mirror else every


@contracted
def lay(points, staged, order1, order2, first, end):
    """Write the points of some rows of the transform in its order, and zeros behind them."""
    n2 = order2.size
    for i in range(first, end):
        row = points[order1[i]]
        for j in range(n2):
            staged[i, j] = row[order2[j]]
        staged[i, n2:] = 0


@contracted
def take(staged, points, order1, order2, first, end):
    """Write the points back in their own order, also within one memory: the inverse of `lay`."""
    former = np.empty(order2.size, staged.dtype)
    for i in range(first, end):
        former[:] = staged[i, : order2.size]
        row = points[order1[i]]
        for j in range(order2.size):
            row[order2[j]] = former[j]


@contracted
def gather(columns, block, twist, order):
    """Copy columns to rows of a block, and behind these the same columns with a twist; zeros follow."""
    n1, count = columns.shape
    width = block.shape[0] // 2
    for i in range(n1):
        row = columns[order[i]]
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
def scatter(columns, block, twist, order):
    """Copy rows of a block to columns, where there is a twist their sums without it."""
    n1, count = columns.shape
    width = block.shape[0] // 2
    for i in range(n1):
        row = columns[order[i]]
        if twist.size:
            for j in range(count):
                row[j] = block[j, i] + block[width + j, i] * np.conj(twist[i])
        else:
            for j in range(count):
                row[j] = block[j, i]

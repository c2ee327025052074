"""Products u = K p on a grid by fast Fourier transforms, for every kind of boundary.

A product has five stages: points are laid out for the transform (mirror and free axes only), rows are transformed, and
then for a block of columns at a time, while it is in cache: columns are transformed, waves are multiplied with the
symbol, columns are transformed back; rows are transformed back; points are taken out again.

FFTW plans with FFTW_ESTIMATE and without wisdom. It then chooses by a rule and not by timing, so that every process
gets the same plans and the same bits. Columns go from strided memory to contiguous blocks, where FFTW's rule chooses
well. Measured against plans that FFTW timed, whole solutions of 256² to 1024² points take 0.9 to 1.03 times as long on
periodic and 0.8 to 0.95 times on mirror axes. Smaller periodic grids are slower: by 2 % at 48², 8 % at 64², 12 % at 96²
and 24 % at 128².
"""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial
from typing import Any

import numpy as np

from ..base import Array, Indices, Shape
from ..base.compiled import compiled
from ..base.threads import on_threads, parts
from .influence import Boundary, padded_length

#: A call of a stage, and what plans the two of a transform there and back.
Call = Callable[..., Any]
Planned = Callable[..., tuple[Call, Call]]
#: Bytes of a block of columns, which should fit in a level-2 cache together with the symbol.
BLOCK_BYTES = 2**18
#: Least number of points of the rows that are transformed together, and most parts of all rows.
ROW_POINTS, ROW_PARTS = 2**16, 16
#: Blocks begin at multiples of so many columns, as the vector instructions of FFTW need.
_ALIGNED = 8
#: Rows of waves take 8k + 3 cache lines of 64 bytes: the points of a column do not push each other out of the cache.
LINE, _LINES, _MORE_LINES = 64, 8, 3
_PLANNING = threading.RLock()


class Product:
    """displacement = K pressure between two arrays of its own, in stages of which threads share the parts.

    Parameters
    ----------
    shape : (n1, n2) points.
    boundary : kind of each axis, "periodic", "mirror" or "free".
    symbol : eigenvalues of K [m/Pa] as `influence.symbol` gives them; None with `over`.
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

    rows: Any
    displacement: Any

    def __init__(
        self,
        shape: Shape,
        boundary: Boundary,
        symbol: Array | None,
        *,
        dtype: Any = np.float64,
        threads: int = 1,
        over: Any = None,
    ) -> None:
        self._threads, self._real = threads, np.dtype(dtype)
        self._kind = np.result_type(self._real, np.complex64)
        self._lengths = l1, l2 = [
            padded_length(n) if end == "free" else n for n, end in zip(shape, boundary, strict=True)
        ]
        self._mirrors = boundary[0] == "mirror", boundary[1] == "mirror"
        self._orders = [order_of(n, m) for n, m in zip(shape, self._mirrors, strict=True)]
        self.pressure: Any = fftw().zeros_aligned(shape, dtype=self._real)
        # of each stage the parts that threads share, and of each part the calls
        self._stages: list[list[list[Call]]] = [[], [], []]
        self._weights: Array
        if over is None:
            assert symbol is not None
            self._weights = weights_of(symbol, *self._mirrors, self._transforms)
            self._weights /= l1 * l2  # which transforms there and back multiply with
        else:
            self._weights = over._weights
        with planner() as planned:
            self._plan(planned, over)
        if threads == 1:  # on small grids passing from call to call is what takes time
            self._stages = [[[call for stage in self._stages for part in stage for call in part]]]

    @property
    def _transforms(self) -> int:
        """Number of transforms along the first axis."""
        return 1

    def _plan(self, planned: Planned, over: Any) -> None:
        """Make the arrays, and fill the stages."""
        raise NotImplementedError

    def _plan_rows(
        self,
        planned: Planned,
        points: Any,
        waves: Any,
        target: Any,
        lay_out: Call | None,
        take_out: Call | None,
    ) -> None:
        """Transforms of rows there and back; what lays out their points before, and takes them out behind."""
        n1 = len(self.pressure)
        for i, end in parts(n1, max(ROW_POINTS / self._lengths[1], n1 / ROW_PARTS)):
            there, back = planned(points[i:end], waves[i:end], target[i:end], axis=1)
            before = [partial(lay_out, i, end)] if lay_out else []
            behind = [partial(take_out, i, end)] if take_out else []
            self._stages[0].append([*before, there])
            self._stages[2].append([back, *behind])

    def _turns(self, m1: int) -> list[Any]:
        """exp(iπk/N) of both axes, m1 points in a transform along the first."""
        return [np.exp(1j * np.pi * np.arange(n // 2 + 1) / n) for n in (m1, self._lengths[1])]

    def apply(self) -> None:
        """Fill `displacement` from `pressure`."""
        for parts_of_stage in self._stages:
            on_threads(self._threads, _in_turn, parts_of_stage)


class Convolution(Product):
    """A product on a grid that a cache holds.

    A mirror axis needs no more than the transform of its N points taken in the order 0, 2, 4 … 5, 3, 1: cosine
    coefficients k and N − k are sums of the waves k and N − k, so that K mixes these two. Source: Makhoul, IEEE Trans.
    Acoust. Speech Signal Process. 28, 1980, 27. A free axis is padded with zeros; rows of zeros are not transformed.
    """

    def _plan(self, planned: Planned, over: Convolution | None) -> None:
        """Columns are transformed from strided memory to blocks."""
        (n1, n2), (l1, l2), kind = self.pressure.shape, self._lengths, self._kind
        m2 = l2 // 2 + 1
        if over is None and not any(self._mirrors):
            # as many weights as waves, of which k and N − k have the same: they are read in order
            half = self._weights
            self._weights = np.concatenate((half, half[..., l1 - half.shape[2] : 0 : -1]), axis=2)
        self._memory: list[Any] = []
        self._lent = iter(() if over is None else over._memory)
        self.displacement = self.rows = self._array((n1, n2), self._real)
        spectrum = self._array((l1, row_length(m2, kind.itemsize)), kind)[:, :m2]
        if any(self._mirrors) or l2 > n2:
            laid = self._array((n1, l2), self._real)
            lay_out = partial(lay, self.pressure, laid, *self._orders)
            take_out = partial(take, laid, self.displacement, *self._orders)
            self._plan_rows(planned, laid, spectrum, laid, lay_out, take_out)
        else:
            self._plan_rows(planned, self.pressure, spectrum, self.displacement, None, None)
        self._stages[0].append([partial(spectrum[n1:].fill, 0)])
        width = BLOCK_BYTES // (l1 * kind.itemsize)
        width = m2 if width >= m2 else max(_ALIGNED, width - width % _ALIGNED)
        turns = self._turns(l1)
        for part in np.array_split(range(0, m2, width), self._threads):
            block = fftw().zeros_aligned((width, l1), dtype=kind)
            calls: list[Call] = []
            for j in part:
                columns = slice(j, min(j + width, m2))
                here = block[: columns.stop - j]
                plans = planned(spectrum[:, columns], here.T, spectrum[:, columns], axis=0)
                work: Any = partial(multiply, here, self._weights[0, columns])
                if any(self._mirrors):
                    work = partial(respond, here, l1, j, len(here), self._weights, False, *turns)
                calls += plans[0], work, plans[1]
            self._stages[1].append(calls)

    def _array(self, shape: Shape, dtype: np.dtype[Any]) -> Any:
        """An array, in the memory of `over` as far as it suffices."""
        memory = next(self._lent, None)
        if memory is None:
            memory = fftw().empty_aligned(math.prod(shape) * dtype.itemsize, dtype=np.uint8)
        self._memory.append(memory)
        return memory[: math.prod(shape) * dtype.itemsize].view(dtype).reshape(shape)


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


@contracted
def multiply(block, weights):
    """Multiply waves in a block with their weights."""
    for j in range(block.shape[0]):
        for i in range(block.shape[1]):
            block[j, i] *= weights[j, i]


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
            own, w1 = weights[0, k, places], weights[1 % kinds, k, places]
            w2, w12 = weights[2 % kinds, k, places], weights[3 % kinds, k, places]
            turn = turn2[k]
            other[0] = row[0]
            for i in range(lone, half):
                other[i] = row[n - odd - i]
            for i in range(half):
                a, b = row[i], other[i]
                c, d = own[i] * a, own[i] * b
                if kinds > 1:
                    f, g = turn1[i] * b, turn1[i] * a.conjugate()
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
    """Write the points back in their own order: the inverse of `lay`."""
    for i in range(first, end):
        row = points[order1[i]]
        for j in range(order2.size):
            row[order2[j]] = staged[i, j]

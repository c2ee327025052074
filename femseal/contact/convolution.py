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
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ..base.compiled import compiled
from ..base.threads import on_threads, parts
from .influence import padded_length

Array = NDArray[np.float64]
#: Bytes of a block of columns, which should fit in a level-2 cache together with the symbol.
BLOCK_BYTES = 2**18
#: Least number of points of the rows that are transformed together, and most parts of all rows.
ROW_POINTS, ROW_PARTS = 2**16, 16
#: Blocks begin at multiples of so many columns, as the vector instructions of FFTW need.
_ALIGNED = 8
#: Rows of waves take 8k + 3 cache lines of 64 bytes: the points of a column do not push each other out of the cache.
LINE, _LINES, _MORE_LINES = 64, 8, 3
_PLANNING = threading.RLock()


class Convolution:
    """displacement = K pressure between two arrays of its own, `pressure` and `displacement`, which is `rows` too.

    A mirror axis needs no more than the transform of its N points taken in the order 0, 2, 4 … 5, 3, 1: cosine
    coefficients k and N − k are sums of the waves k and N − k, so that K mixes these two. Source: Makhoul, IEEE Trans.
    Acoust. Speech Signal Process. 28, 1980, 27. A free axis is padded with zeros; rows of zeros are not transformed.

    Parameters
    ----------
    shape : (n1, n2) points.
    boundary : kind of each axis, "periodic", "mirror" or "free".
    symbol : eigenvalues of K [m/Pa] as `influence.symbol` gives them; None with `over`.
    dtype : of the arrays and the transforms, double or single precision.
    threads : number of threads at work together.
    over : a convolution with the same K, of no smaller precision, whose memory is used for all but `pressure`. Each
        `apply` of one overwrites the displacement of the other.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        boundary: tuple[str, str],
        symbol: Array | None,
        *,
        dtype: Any = np.float64,
        threads: int = 1,
        over: Convolution | None = None,
    ) -> None:
        pyfftw = fftw()
        (n1, n2), real = shape, np.dtype(dtype)
        waves = np.result_type(real, np.complex64)
        l1, l2 = (
            padded_length(n) if kind == "free" else n
            for n, kind in zip(shape, boundary, strict=True)
        )
        m2 = l2 // 2 + 1
        self._mirrors = boundary[0] == "mirror", boundary[1] == "mirror"
        self._memory: list[Any] = []
        self._lent = iter(() if over is None else over._memory)
        if over is None:
            assert symbol is not None
            self._weights = weights_of(symbol, l1 * l2, *self._mirrors)
            del symbol
            if not any(self._mirrors):
                # as many weights as waves, of which k and N − k have the same: they are read in order
                half = self._weights.shape[2]
                self._weights = np.concatenate(
                    (self._weights, self._weights[..., l1 - half : 0 : -1]), axis=2
                )
        else:
            self._weights = over._weights
        self.pressure = pyfftw.zeros_aligned((n1, n2), dtype=real)
        self.displacement = self.rows = self._array((n1, n2), real)
        spectrum = self._array((l1, row_length(m2, waves.itemsize)), waves)[:, :m2]
        staged = any(self._mirrors) or boundary[1] == "free"
        laid = self._array((n1, l2), real) if staged else None
        orders = [order_of(n, mirror) for n, mirror in zip(shape, self._mirrors, strict=True)]
        points: Any = laid if staged else self.pressure
        target: Any = laid if staged else self.displacement
        turn1, turn2 = (np.exp(1j * np.pi * np.arange(n // 2 + 1) / n) for n in (l1, l2))
        width = BLOCK_BYTES // (l1 * waves.itemsize)
        width = m2 if width >= m2 else max(_ALIGNED, width - width % _ALIGNED)
        starts = range(0, m2, width)
        # of each stage the parts that threads share, and of each part the calls
        forward, blocks, inverse = self._stages = cast(
            list[list[list[Callable[[], Any]]]], [[], [], []]
        )
        with planner() as planned:
            for i, end in parts(n1, max(ROW_POINTS / l2, n1 / ROW_PARTS)):
                plans = planned(points[i:end], spectrum[i:end], target[i:end], axis=1)
                there, back = [plans[0]], [plans[1]]
                if staged:
                    of_rows = i, end, *orders
                    there.insert(0, partial(lay, self.pressure, laid, *of_rows))
                    back.append(partial(take, laid, self.displacement, *of_rows))
                forward.append(there)
                inverse.append(back)
            forward.append([partial(spectrum[n1:].fill, 0)])
            for part in np.array_split(starts, threads):
                block = pyfftw.zeros_aligned((width, l1), dtype=waves)
                blocks.append([])
                for j in part:
                    columns = slice(j, min(j + width, m2))
                    here = block[: columns.stop - j]
                    plans = planned(spectrum[:, columns], here.T, spectrum[:, columns], axis=0)
                    work: Any = partial(multiply, here, self._weights[0, columns])
                    if any(self._mirrors):
                        of_waves = l1, j, len(here), self._weights, False, turn1, turn2
                        work = partial(respond, here, *of_waves)
                    blocks[-1] += plans[0], work, plans[1]
        if threads == 1:  # on small grids passing from call to call is what takes time
            self._stages = [[[call for stage in self._stages for part in stage for call in part]]]
        self._threads = threads

    def _array(self, shape: tuple[int, int], dtype: np.dtype[Any]) -> Any:
        """An array, in the memory of `over` as far as it suffices."""
        memory = next(self._lent, None)
        if memory is None:
            memory = fftw().empty_aligned(math.prod(shape) * dtype.itemsize, dtype=np.uint8)
        self._memory.append(memory)
        return memory[: math.prod(shape) * dtype.itemsize].view(dtype).reshape(shape)

    def apply(self) -> None:
        """Fill `displacement` from `pressure`."""
        for parts_of_stage in self._stages:
            on_threads(self._threads, _in_turn, parts_of_stage)


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
def planner() -> Iterator[Callable[..., tuple[Any, Any]]]:
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


def _in_turn(calls: Sequence[Callable[[], Any]]) -> None:
    for call in calls:
        call()


def weights_of(
    symbol: Array, points: int, mirror1: bool, mirror2: bool, transforms: int = 1
) -> Array:
    """The symbol or, if an axis is a mirror, its four means of sums and differences over k and N − k, transposed.

    The second and the fourth have differences along the first axis, the third and the fourth along the second. The
    cosine coefficient N of N points is always 0, and its symbol whatever makes a difference vanish. Of two transforms
    along the first axis, that of the even waves comes before that of the odd ones. All are over the number of points,
    which transforms there and back multiply with.
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
    weights = np.array([part.T for part in ordered], order="C")
    weights /= points
    return weights


COMPILED: dict[str, Any] = {"fastmath": {"contract"}}


@compiled(**COMPILED)
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


def order_of(n: int, mirror: bool) -> NDArray[np.int64]:
    """Points of an axis in the order in which they are transformed: 0, 2, 4 … 5, 3, 1 of a mirror."""
    every = np.arange(n)
    return np.concatenate((every[::2], every[1::2][::-1])) if mirror else every


@compiled(**COMPILED)
def lay(points, staged, first, end, order1, order2):
    """Write the points of some rows of the transform in its order, and zeros behind them."""
    n2 = order2.size
    for i in range(first, end):
        row = points[order1[i]]
        for j in range(n2):
            staged[i, j] = row[order2[j]]
        staged[i, n2:] = 0


@compiled(**COMPILED)
def take(staged, points, first, end, order1, order2):
    """Write the points back in their own order: the inverse of `lay`."""
    for i in range(first, end):
        row = points[order1[i]]
        for j in range(order2.size):
            row[order2[j]] = staged[i, j]

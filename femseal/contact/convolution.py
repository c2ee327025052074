"""Products u = K p on a grid by fast Fourier transforms, for every kind of boundary.

A product has five stages: points are laid out for the transform (mirror and free axes only), rows are transformed, and
then for a block of columns at a time, while it is in cache: columns are transformed, waves are multiplied with the
symbol, columns are transformed back; rows are transformed back; points are taken out again.

FFTW plans with FFTW_ESTIMATE: it chooses by a rule and not by timing, so that every process gets the same plans and the
same bits. Columns go from strided memory to contiguous blocks, where its rule chooses well: measured for 256² to 1024²
points, a product takes no longer than with plans that FFTW timed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pyfftw
from numba import njit
from numpy.typing import NDArray

from .influence import padded_length

Array = NDArray[np.float64]
#: Bytes of a block of columns: about a level-2 cache with what else it has to hold.
_BLOCK_BYTES = 2**19
#: Blocks begin at multiples of so many columns, which FFTW's vector instructions ask for.
_ALIGNED = 8


class Convolution:
    """displacement = K pressure between two arrays of its own, `pressure` and `displacement`.

    A mirror axis needs no more than the transform of its N points taken in the order 0, 2, 4 … 5, 3, 1: cosine
    coefficients k and N − k are sums of the waves k and N − k, so that K mixes these two. Source: Makhoul, IEEE Trans.
    Acoust. Speech Signal Process. 28, 1980, 27. A free axis is padded with zeros; padding rows are not
    transformed.

    Parameters
    ----------
    shape : (n1, n2) points.
    boundary : kind of each axis, "periodic", "mirror" or "free".
    symbol : eigenvalues of K [m/Pa] as `influence.symbol` gives them.
    dtype : of the arrays and the transforms, double or single precision.
    threads : that share the work.
    over : a convolution with the same K, of no smaller precision, whose memory serves for all but `pressure`: each
        `apply` of one makes the other's displacement void.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        boundary: tuple[str, str],
        symbol: Array,
        *,
        dtype: Any = np.float64,
        threads: int = 1,
        over: Convolution | None = None,
    ) -> None:
        (n1, n2), real = shape, np.dtype(dtype)
        waves = np.result_type(real, np.complex64)
        l1, l2 = (padded_length(n) if kind == "free" else n for n, kind in zip(shape, boundary, strict=True))
        m2 = l2 // 2 + 1
        self._mirrors = boundary[0] == "mirror", boundary[1] == "mirror"
        self._memory: list[Any] = []
        self._lent = iter(() if over is None else over._memory)
        self.pressure = pyfftw.zeros_aligned((n1, n2), dtype=real)
        self.displacement = self._array((n1, n2), real)
        spectrum = self._array((l1, m2), waves)
        staged = any(self._mirrors) or boundary[1] == "free"
        self._staged = self._array((n1, l2), real) if staged else None
        points, target = (self._staged, self._staged) if staged else (self.pressure, self.displacement)
        self._no_points = spectrum[n1:]
        self._rows = _plans(points, spectrum[:n1], target, axis=1, threads=threads)
        self._weights: Array = over._weights if over else _weights(symbol / (l1 * l2), *self._mirrors)
        turns = [np.exp(1j * np.pi * np.arange(n // 2 + 1) / n) for n in (l1, l2)]
        width = min(_BLOCK_BYTES // (l1 * waves.itemsize), math.ceil(m2 / threads))
        width = max(_ALIGNED, width - width % _ALIGNED)
        starts = range(0, m2, width)
        self._blocks: list[list[Any]] = []
        for part in np.array_split(starts, threads):
            block = pyfftw.zeros_aligned((width, l1), dtype=waves)
            self._blocks.append([])
            for j in part:
                columns = slice(j, min(j + width, m2))
                here = block[: columns.stop - j]
                plans = _plans(spectrum[:, columns], here.T, spectrum[:, columns], axis=0)
                arguments = here, self._weights[:, columns], turns[0], turns[1][columns], *self._mirrors
                self._blocks[-1].append((*plans, arguments))
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def _array(self, shape: tuple[int, int], dtype: np.dtype[Any]) -> Any:
        """An array of zeros, in lent memory as long as there is some."""
        memory = next(self._lent, None)
        if memory is None:
            memory = pyfftw.zeros_aligned(math.prod(shape) * dtype.itemsize, dtype=np.uint8)
        self._memory.append(memory)
        return memory[: math.prod(shape) * dtype.itemsize].view(dtype).reshape(shape)

    def apply(self) -> None:
        """Fill `displacement` from `pressure`."""
        forward, inverse = self._rows
        if self._staged is not None:
            _lay(self.pressure, self._staged, *self._mirrors)
        if self._no_points.size:
            self._no_points[:] = 0
        forward()
        if self._pool is None:
            _respond_in(self._blocks[0])
        else:
            list(self._pool.map(_respond_in, self._blocks))
        inverse()
        if self._staged is not None:
            _take(self._staged, self.displacement, *self._mirrors)


def _plans(points: Any, waves: Any, target: Any, *, axis: int, threads: int = 1) -> tuple[Any, Any]:
    """FFTW's transforms points → waves and, destroying them, waves → target."""
    forward = pyfftw.FFTW(points, waves, (axis,), "FFTW_FORWARD", ("FFTW_ESTIMATE",), threads)
    flags = "FFTW_ESTIMATE", "FFTW_DESTROY_INPUT"
    return forward.execute, pyfftw.FFTW(waves, target, (axis,), "FFTW_BACKWARD", flags, threads).execute


def _respond_in(blocks: Sequence[Any]) -> None:
    """Transform columns, multiply their waves with the symbol, transform them back."""
    for forward, inverse, arguments in blocks:
        forward()
        _respond(*arguments)
        inverse()


def _weights(symbol: Array, mirror1: bool, mirror2: bool) -> Array:
    """Sums and differences of the symbol over k and N − k of the mirror axes, transposed like the blocks.

    These are what `_respond` multiplies waves with. The cosine coefficient N of N points is always 0, and its symbol
    whatever makes a difference vanish.
    """
    parts = [symbol]
    for axis, mirror in enumerate((mirror1, mirror2)):
        if mirror:
            n = symbol.shape[axis]
            k = np.arange(n // 2 + 1)
            pairs = [(part.take(k, axis), part.take(-k % n, axis)) for part in parts]
            parts = [(a + b) / 2 for a, b in pairs] + [(a - b) / 2 for a, b in pairs]
    return np.array([part.T for part in parts], order="C")


_compiled: dict[str, Any] = {"cache": True, "nogil": True, "fastmath": {"contract"}}


@njit(**_compiled)
def _respond(block, weights, turn1, turn2, mirror1, mirror2):
    """Waves of pressure to waves of displacement in a block of columns, the two of a mirror axis at once.

    With C(k) = ē V(k) + e V(N − k), e = exp(iπk/2N), and 2 V(k) = e (C(k) − i C(N − k)), a symbol S(k) on C is
    V(k) ← ½(S(k) + S(N − k)) V(k) + ½(S(k) − S(N − k)) e² V(N − k) on V.
    """
    m, n = block.shape
    if not mirror1 and not mirror2:
        for j in range(m):
            for i in range(n):
                block[j, i] *= weights[0, j, i]
        return
    # V(k1, N − k2) is the conjugate of V(N − k1, k2)
    for j in range(m):
        e2 = turn2[j]
        for i in range(n // 2 + 1):
            other = (n - i) % n
            a, b = block[j, i], block[j, other]
            own = weights[0, j, i]
            if not mirror1:
                w = weights[1, j, i] * e2
                block[j, i] = own * a + w * b.conjugate()
                block[j, other] = own * b + w * a.conjugate()
                continue
            e1, w1 = turn1[i], weights[1, j, i]
            eb, ea = e1 * b, e1 * a.conjugate()
            new_a = own * a + w1 * eb
            new_b = own * b + w1 * ea.conjugate()
            if mirror2:
                w2, w12 = weights[2, j, i], weights[3, j, i]
                new_a += e2 * (w2 * b.conjugate() + w12 * ea)
                new_b += e2 * (w2 * a.conjugate() + w12 * eb.conjugate())
            block[j, i], block[j, other] = new_a, new_b


@njit(**_compiled)
def _place(i, n, mirror):
    """Which point is the i-th to be transformed."""
    if not mirror:
        return i
    return 2 * i if 2 * i < n else 2 * (n - i) - 1


@njit(**_compiled)
def _lay(points, staged, mirror1, mirror2):
    """Points in the order of the transform, zeros behind them."""
    n1, n2 = points.shape
    for i in range(n1):
        row = points[_place(i, n1, mirror1)]
        if mirror2:
            for j in range((n2 + 1) // 2):
                staged[i, j] = row[2 * j]
            for j in range(n2 // 2):
                staged[i, n2 - 1 - j] = row[2 * j + 1]
        else:
            for j in range(n2):
                staged[i, j] = row[j]
            staged[i, n2:] = 0


@njit(**_compiled)
def _take(staged, points, mirror1, mirror2):
    """The inverse of `_lay`."""
    n1, n2 = points.shape
    for i in range(n1):
        row = points[_place(i, n1, mirror1)]
        if mirror2:
            for j in range((n2 + 1) // 2):
                row[2 * j] = staged[i, j]
            for j in range(n2 // 2):
                row[2 * j + 1] = staged[i, n2 - 1 - j]
        else:
            for j in range(n2):
                row[j] = staged[i, j]

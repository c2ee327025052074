"""The half-space: which pressure gives which displacement, for every boundary kind, by fast transforms.

`HalfSpace` says what the body is; `Convolution` owns buffers and transform plans and does the work.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyfftw
from numba import njit
from numpy.typing import ArrayLike, NDArray

from ..base import validate
from ..base.errors import InputError
from . import influence
from .plans import Kept, Transform, planned, preferred

Array = NDArray[np.float64]
BOUNDARIES = ("periodic", "mirror", "free")


@dataclass(frozen=True)
class HalfSpace:
    """An elastic half-space under pressures on a grid of pixels: u = K p.

    û = 2 p̂/(E*|q|) on periodic axes (mean displacement free); a mirror axis is the even extension, exactly a cosine
    transform on the same points; on free axes the pressure is 0 outside and constant on each pixel (Love).

    Parameters
    ----------
    shape : (n1, n2) pixels.
    spacing : (Δ1, Δ2) [m].
    modulus : contact modulus E* [Pa].
    boundary : kind of each axis, "periodic", "mirror" or "free"; one word stands for both.
    plans : of its transforms in one thread, made by another process. A half-space that is pickled takes them along, so
        that it gives the same bits wherever it is solved; see `contact.plans`.

    Raises
    ------
    InputError : a size, spacing, modulus or boundary kind that is not allowed.

    Notes
    -----
    Sources: Johnson, Contact Mechanics, 1985; Stanley & Kato, J. Tribol. 119, 1997, 481 (periodic);
    Liu, Wang & Liu, Wear 243, 2000, 101 (free). With one free axis, the uniform mode is the plane-strain logarithm,
    whose constant is arbitrary, and so is then the level of `displacement`.

    Free axes are padded to lengths with fast transforms. Periodic and mirror ones cannot be: a large prime factor in
    their number of points slows everything, 1021² points take 8 times as long as 1024². `Topography.resample` helps.
    """

    shape: tuple[int, int]
    spacing: tuple[float, float]
    modulus: float
    boundary: tuple[str, str] = ("periodic", "periodic")
    plans: Kept = field(default=(), compare=False, repr=False)

    def __post_init__(self) -> None:
        if isinstance(self.boundary, str):
            object.__setattr__(self, "boundary", (self.boundary, self.boundary))
        object.__setattr__(self, "shape", validate.grid("shape", self.shape))
        object.__setattr__(self, "spacing", validate.lengths("spacing", self.spacing))
        object.__setattr__(self, "modulus", validate.number("modulus", self.modulus, unit="Pa"))
        kinds = f"one of {', '.join(BOUNDARIES)} for each axis"
        try:
            first, second = self.boundary
        except (TypeError, ValueError):
            raise InputError.of("boundary", self.boundary, kinds) from None
        if first not in BOUNDARIES or second not in BOUNDARIES:
            raise InputError.of("boundary", self.boundary, kinds)
        object.__setattr__(self, "boundary", (first, second))

    def __reduce__(self) -> tuple[Any, ...]:
        from .grid import plans_of  # its grids stand on this module

        plans = self.plans or plans_of(self)
        return HalfSpace, (self.shape, self.spacing, self.modulus, self.boundary, plans)

    def transforms(self, dtype: Any, threads: int = 1) -> list[Transform]:
        """From the points of a real type to all their waves, one after another."""
        l1, l2 = self.padded_shape
        points, waves = np.dtype(dtype), np.result_type(dtype, np.complex64)
        if self.boundary[0] != "free":
            return [Transform((l1, l2), (0, 1), points.name, threads)]
        # only the rows with data
        rows = Transform((self.shape[0], l2), (1,), points.name, threads)
        return [rows, Transform((l1, l2 // 2 + 1), (0,), waves.name, threads)]

    @property
    def padded_shape(self) -> tuple[int, int]:
        """Points that are transformed along each axis."""
        first, second = (
            influence.padded_length(n) if kind == "free" else n
            for n, kind in zip(self.shape, self.boundary, strict=True)
        )
        return first, second

    def symbol(self) -> Array:
        """Eigenvalues of K [m/Pa] for the waves of periodic and padded free axes and the cosines of mirror axes."""
        (n1, n2), (d1, d2), (b1, b2) = self.shape, self.spacing, self.boundary
        if b1 == b2 == "free":
            return influence.free_symbol(self.shape, self.spacing, self.modulus)
        # a wave and its conjugate respond alike: half of a periodic or free axis is enough, of the second one unless
        # that is a mirror
        q1 = influence.wave_numbers(n1, d1, b1, half=b2 == "mirror")
        q2 = influence.wave_numbers(n2, d2, b2, half=True)
        if b1 == "free":
            symbol = influence.strip_symbol(n1, d1, q2, d2, self.modulus)
            return symbol[: symbol.shape[0] // 2 + 1] if b2 == "mirror" else symbol
        if b2 == "free":
            full = influence.strip_symbol(n2, d2, influence.wave_numbers(n1, d1, b1, half=False), d1, self.modulus)
            return np.ascontiguousarray(full[: full.shape[0] // 2 + 1].T)
        return influence.spectral_symbol(q1, q2, self.modulus)

    def displacement(self, pressure: ArrayLike) -> Array:
        """Displacement u = K p [m] of shape (n1, n2) under pressures p [Pa] of the same shape."""
        p = validate.field("pressure", pressure, unit="Pa", shape=self.shape)
        convolution = Convolution(self)
        convolution.pressure[:] = p
        convolution.apply()
        return convolution.displacement


class Convolution:
    """displacement = K pressure between two buffers of its own, by transforms planned once.

    A mirror axis needs no more than the transform of its N points taken in the order 0, 2, 4 … 5, 3, 1: cosine
    coefficients k and N − k are sums of the waves k and N − k, so that K mixes these two. Source: Makhoul, IEEE Trans.
    Acoust. Speech Signal Process. 28, 1980, 27. Along a free first axis only the rows with data are transformed.

    Parameters
    ----------
    dtype : of the buffers and the transforms, double or single precision.
    threads : of the transforms.
    over : a convolution of the same half-space, of no smaller precision, whose memory serves for all but `pressure`:
        each `apply` of one makes the other's displacement void.
    """

    def __init__(
        self, half_space: HalfSpace, dtype: Any = np.float64, threads: int = 1, over: Convolution | None = None
    ) -> None:
        (n1, n2), (b1, b2) = half_space.shape, half_space.boundary
        real = np.dtype(dtype)
        self._memory: list[Any] = []
        self._lent = iter(() if over is None else over._memory)
        self._mirrors = (b1 == "mirror", b2 == "mirror")
        l1, l2 = half_space.padded_shape
        self.pressure = pyfftw.empty_aligned((n1, n2), dtype=real)
        self.displacement = self._buffer((n1, n2), real)
        self._spectrum = self._buffer((l1, l2 // 2 + 1), np.result_type(real, np.complex64))
        if any(self._mirrors) or b2 == "free":
            source = target = self._staged = self._buffer((n1, l2), real)
        else:
            source, target, self._staged = self.pressure, self.displacement, None
        places = [(source, self._spectrum, target)]
        if b1 == "free":
            places = [(source, self._spectrum[:n1], target), (self._spectrum,) * 3]
        plans = [
            planned(transform, *arrays, preferred(half_space.plans))
            for transform, arrays in zip(half_space.transforms(real, threads), places, strict=True)
        ]
        self._forward = [forward.execute for forward, _ in plans]
        self._inverse = [inverse.execute for _, inverse in reversed(plans)]
        self._empty_rows = self._spectrum[n1:]
        self._weights: Array = over._weights if over else _weights(half_space.symbol() / (l1 * l2), *self._mirrors)
        self._turn1, self._turn2 = (np.exp(1j * np.pi * np.arange(n // 2 + 1) / n) for n in (n1, n2))
        for buffer in (self.pressure, self.displacement, self._spectrum):
            buffer[:] = 0

    def _buffer(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> Any:
        memory = next(self._lent, None)
        if memory is None:
            memory = pyfftw.empty_aligned(shape, dtype=dtype)
        self._memory.append(memory)
        return memory.ravel().view(np.uint8)[: math.prod(shape) * dtype.itemsize].view(dtype).reshape(shape)

    def apply(self) -> None:
        """Fill `displacement` from `pressure`."""
        if self._staged is not None:
            _lay(self.pressure, self._staged, *self._mirrors)
        self._empty_rows[:] = 0
        for execute in self._forward:
            execute()
        _respond(self._spectrum, self._weights, self._turn1, self._turn2, *self._mirrors)
        for execute in self._inverse:
            execute()
        if self._staged is not None:
            _take(self._staged, self.displacement, *self._mirrors)


def _weights(symbol: Array, mirror1: bool, mirror2: bool) -> Array:
    """Sums and differences of the symbol over k and N − k of the mirror axes: what `_respond` multiplies waves with.

    The cosine coefficient N of N points is always 0, and its symbol whatever makes a difference vanish.
    """
    parts = [symbol]
    for axis, mirror in enumerate((mirror1, mirror2)):
        if mirror:
            n = symbol.shape[axis]
            k = np.arange(n // 2 + 1)
            pairs = [(part.take(k, axis), part.take(-k % n, axis)) for part in parts]
            parts = [(a + b) / 2 for a, b in pairs] + [(a - b) / 2 for a, b in pairs]
    return np.array(parts)


_compiled: dict[str, Any] = {"cache": True, "nogil": True, "fastmath": {"contract"}}


@njit(**_compiled)
def _respond(spectrum, weights, turn1, turn2, mirror1, mirror2):
    """Waves of pressure to waves of displacement, the two of a mirror axis at once.

    With C(k) = ē V(k) + e V(N − k), e = exp(iπk/2N), and 2 V(k) = e (C(k) − i C(N − k)), a symbol S(k) on C is
    V(k) ← ½(S(k) + S(N − k)) V(k) + ½(S(k) − S(N − k)) e² V(N − k) on V.
    """
    n1, n2 = spectrum.shape
    own = weights[0]
    if not mirror1 and not mirror2:
        for i in range(n1):
            for j in range(n2):
                spectrum[i, j] *= own[i, j]
        return
    # V(k1, N − k2) is the conjugate of V(N − k1, k2)
    for i in range(n1 // 2 + 1):
        other = (n1 - i) % n1
        if not mirror1:
            for j in range(n2):
                a, b, w = spectrum[i, j], spectrum[other, j], weights[1, i, j] * turn2[j]
                spectrum[i, j] = own[i, j] * a + w * b.conjugate()
                spectrum[other, j] = own[i, j] * b + w * a.conjugate()
            continue
        e = turn1[i]
        for j in range(n2):
            a, b = spectrum[i, j], spectrum[other, j]
            eb, ea = e * b, e * a.conjugate()
            new_a = own[i, j] * a + weights[1, i, j] * eb
            new_b = own[i, j] * b + weights[1, i, j] * ea.conjugate()
            if mirror2:
                w2, w12 = weights[2, i, j], weights[3, i, j]
                new_a += turn2[j] * (w2 * b.conjugate() + w12 * ea)
                new_b += turn2[j] * (w2 * a.conjugate() + w12 * eb.conjugate())
            spectrum[i, j], spectrum[other, j] = new_a, new_b


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

"""The half-space: which pressure gives which displacement, for every boundary kind, by fast transforms.

`HalfSpace` says what the body is; `Convolution` owns buffers and transform plans and does the work.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pyfftw
from numba import njit
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..errors import InputError
from . import kernels

Array = NDArray[np.float64]
BOUNDARIES = ("periodic", "mirror", "free")
#: Response of waves that a coarser solution carries, beside that of the shortest of them.
_CARRIED_SHARE = 0.02


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
    longest_wave : waves longer than this [m] hardly respond, because a coarser solution carries them (no free axis):
        a fiftieth of the response of this wave keeps the pressure unique.

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
    longest_wave: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.boundary, str):
            object.__setattr__(self, "boundary", (self.boundary, self.boundary))
        object.__setattr__(self, "shape", checks.grid("shape", self.shape))
        object.__setattr__(self, "spacing", checks.lengths("spacing", self.spacing))
        object.__setattr__(self, "modulus", checks.number("modulus", self.modulus, unit="Pa"))
        kinds = f"one of {', '.join(BOUNDARIES)} for each axis"
        try:
            first, second = self.boundary
        except (TypeError, ValueError):
            raise InputError.of("boundary", self.boundary, kinds) from None
        if first not in BOUNDARIES or second not in BOUNDARIES:
            raise InputError.of("boundary", self.boundary, kinds)
        object.__setattr__(self, "boundary", (first, second))
        if self.longest_wave is not None:
            object.__setattr__(self, "longest_wave", checks.number("longest_wave", self.longest_wave, unit="m"))
            if "free" in self.boundary:
                raise InputError.of("longest_wave", self.longest_wave, "None where an axis is free")

    def symbol(self) -> Array:
        """Eigenvalues of K [m/Pa] in the order of the transforms of `Convolution`."""
        (n1, n2), (d1, d2), (b1, b2) = self.shape, self.spacing, self.boundary
        if b1 == b2 == "free":
            return kernels.free_symbol(self.shape, self.spacing, self.modulus)
        # the second axis is transformed first: from real data, so a periodic one keeps its non-negative half;
        # a cosine transform stays real and leaves that to the first axis
        q1 = kernels.wave_numbers(n1, d1, b1, half=b2 == "mirror")
        q2 = kernels.wave_numbers(n2, d2, b2, half=True)
        if b1 == "free":
            symbol = kernels.strip_symbol(n1, d1, q2, d2, self.modulus)
            return symbol[: symbol.shape[0] // 2 + 1] if b2 == "mirror" else symbol
        if b2 == "free":
            full = kernels.strip_symbol(n2, d2, kernels.wave_numbers(n1, d1, b1, half=False), d1, self.modulus)
            return np.ascontiguousarray(full[: full.shape[0] // 2 + 1].T)
        symbol = kernels.spectral_symbol(q1, q2, self.modulus)
        if self.longest_wave is not None:
            carried = np.hypot(q1[:, None], q2[None, :]) < 2 * np.pi / self.longest_wave * (1 - 1e-9)
            symbol[carried] = _CARRIED_SHARE * 2 / self.modulus * self.longest_wave / (2 * np.pi)
            symbol[q1 == 0, 0] = 0.0
        return symbol

    def displacement(self, pressure: ArrayLike) -> Array:
        """Displacement u = K p [m] of shape (n1, n2) under pressures p [Pa] of the same shape."""
        p = checks.field("pressure", pressure, unit="Pa", shape=self.shape)
        convolution = Convolution(self, self.symbol())
        convolution.pressure[:] = p
        convolution.apply()
        return convolution.displacement


class Convolution:
    """displacement = K pressure between two buffers of its own, by transforms planned once.

    Two periodic or two mirror axes are one plan. Otherwise the second axis goes first, on padded rows only where there
    are data.

    Parameters
    ----------
    symbol : `half_space.symbol()`, which convolutions of the same half-space can share.
    dtype : of the buffers and the transforms, double or single precision.
    threads : of the transforms.
    """

    def __init__(self, half_space: HalfSpace, symbol: Array, dtype: Any = np.float64, threads: int = 1) -> None:
        (n1, n2), (b1, b2) = half_space.shape, half_space.boundary
        self._real = np.dtype(dtype)
        self._complex = np.result_type(self._real, np.complex64)
        self._threads = threads
        self.pressure, self.displacement = self._zeros((n1, n2)), self._zeros((n1, n2))
        self._forward: list[Any] = []
        self._inverse: list[Any] = []
        self._padded = self._back = self._empty_rows = None
        if b1 == b2 == "periodic":
            spectrum = self._zeros((n1, n2 // 2 + 1), self._complex)
            self._plan((self.pressure, spectrum, self.displacement), (0, 1), "FFT")
        elif b1 == b2 == "mirror":
            spectrum = self._zeros((n1, n2))
            self._plan((self.pressure, spectrum, self.displacement), (0, 1), "DCT")
        else:
            spectrum = self._plan_rows_first(n1, n2, b1, b2)
        lengths = {"periodic": lambda n: n, "mirror": lambda n: 2 * n, "free": kernels.padded_length}
        self._factor = 1 / (lengths[b1](n1) * lengths[b2](n2))
        # a real array of complex pairs is the same numbers
        self._spectrum = (spectrum.view(self._complex) if spectrum.ndim == 3 else spectrum).ravel()
        self._symbol = np.ascontiguousarray(symbol).ravel()
        for buffer in (self.pressure, self.displacement, spectrum):
            buffer[:] = 0

    def _zeros(self, shape: tuple[int, ...], dtype: Any = None) -> Any:
        return pyfftw.zeros_aligned(shape, dtype=self._real if dtype is None else dtype)

    def _plan(self, buffers: tuple[Any, Any, Any], axes: tuple[int, ...], kind: str) -> None:
        """Plan source → spectrum → target along axes and put it between the plans there are."""
        source, spectrum, target = buffers
        there, back = (
            ("FFTW_FORWARD", "FFTW_BACKWARD")
            if kind == "FFT"
            else (["FFTW_REDFT10"] * len(axes), ["FFTW_REDFT01"] * len(axes))
        )
        flags: tuple[str, ...] = ("FFTW_MEASURE",)
        plan: dict[str, Any] = {"axes": axes, "threads": self._threads}
        self._forward.append(pyfftw.FFTW(source, spectrum, direction=there, flags=flags, **plan).execute)
        flags += ("FFTW_DESTROY_INPUT",)
        self._inverse.insert(0, pyfftw.FFTW(spectrum, target, direction=back, flags=flags, **plan).execute)

    def _plan_rows_first(self, n1: int, n2: int, b1: str, b2: str) -> Any:
        l1 = kernels.padded_length(n1) if b1 == "free" else n1
        l2 = kernels.padded_length(n2) if b2 == "free" else n2
        rows, back = self.pressure, self.displacement
        if b2 == "free":
            rows = self._padded = self._zeros((n1, l2))
            back = self._back = self._zeros((n1, l2))
        if b2 == "mirror":
            stage = self._zeros((l1, n2))
            self._plan((rows, stage[:n1], back), (1,), "DCT")
        else:
            stage = self._zeros((l1, l2 // 2 + 1), self._complex)
            self._plan((rows, stage[:n1], back), (1,), "FFT")
        if b1 == "mirror":
            stage = stage.view(self._real).reshape(l1, -1, 2)
            spectrum = self._zeros(stage.shape)
            self._plan((stage, spectrum, stage), (0,), "DCT")
        else:
            m1 = l1 // 2 + 1 if b2 == "mirror" else l1
            spectrum = self._zeros((m1, stage.shape[1]), self._complex)
            self._plan((stage, spectrum, stage), (0,), "FFT")
        self._empty_rows = stage[n1:]
        return spectrum

    def apply(self) -> None:
        """Fill `displacement` from `pressure`."""
        n2 = self.pressure.shape[1]
        if self._padded is not None:
            self._padded[:, :n2] = self.pressure
        if self._empty_rows is not None:
            self._empty_rows[:] = 0
        for execute in self._forward:
            execute()
        _multiply(self._spectrum, self._symbol, self._factor)
        for execute in self._inverse:
            execute()
        if self._back is not None:
            self.displacement[:] = self._back[:, :n2]


@njit(cache=True, nogil=True)
def _multiply(spectrum, symbol, factor):
    """spectrum *= symbol · factor."""
    for i in range(spectrum.size):
        spectrum[i] *= symbol[i] * factor

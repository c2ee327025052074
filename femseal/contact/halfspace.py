"""The half-space: which pressure gives which displacement, for every boundary kind, by fast transforms.

`HalfSpace` says what the body is; `Convolution` owns buffers and transform plans and does the work.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pyfftw
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..errors import InputError
from . import kernels

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
    longest_wave : waves longer than this [m] do not respond, because a coarser solution carries them (no free axis).

    Raises
    ------
    InputError : a size, spacing, modulus or boundary kind that is not allowed.

    Notes
    -----
    Sources: Johnson, Contact Mechanics, 1985; Stanley & Kato, J. Tribol. 119, 1997, 481 (periodic);
    Liu, Wang & Liu, Wear 243, 2000, 101 (free). With one free axis, the uniform mode is the plane-strain logarithm,
    whose constant is arbitrary, and so is then the level of `displacement`.
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

    @cached_property
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
            symbol[carried] = 0.0
        return symbol

    def displacement(self, pressure: ArrayLike) -> Array:
        """Displacement u = K p [m] of shape (n1, n2) under pressures p [Pa] of the same shape."""
        p = checks.field("pressure", pressure, unit="Pa", shape=self.shape)
        convolution = Convolution(self)
        convolution.pressure[:] = p
        return convolution.apply(convolution.pressure).copy()


class Convolution:
    """u = K x by transforms planned once, on two input buffers of its own.

    The second axis is transformed first, and on padded rows only where there are data.
    """

    def __init__(self, half_space: HalfSpace, threads: int = 1) -> None:
        (n1, n2), (b1, b2) = half_space.shape, half_space.boundary
        self.shape = half_space.shape
        self.pairs = 0
        zeros: Any = pyfftw.zeros_aligned
        self.pressure, self.direction, self.result = (zeros((n1, n2)) for _ in range(3))
        l1 = kernels.padded_length(n1) if b1 == "free" else n1
        l2 = kernels.padded_length(n2) if b2 == "free" else n2
        # with a free second axis the data pass through a padded row buffer
        self._padded = zeros((n1, l2)) if b2 == "free" else None
        rows = self._padded if self._padded is not None else self.pressure
        plan: dict[str, Any] = {"flags": ("FFTW_MEASURE",), "threads": threads}
        inverse: dict[str, Any] = {"flags": ("FFTW_MEASURE", "FFTW_DESTROY_INPUT"), "threads": threads}
        norm = 1.0
        if b2 == "mirror":
            stage = zeros((l1, n2))
            self._row_forward = pyfftw.FFTW(rows, stage[:n1], axes=(1,), direction="FFTW_REDFT10", **plan)
            self._row_back = pyfftw.FFTW(stage[:n1], self.result, axes=(1,), direction="FFTW_REDFT01", **inverse)
            norm *= 2 * n2
        else:
            stage = zeros((l1, l2 // 2 + 1), dtype="complex128")
            back = zeros((n1, l2)) if b2 == "free" else self.result
            self._row_forward = pyfftw.FFTW(rows, stage[:n1], axes=(1,), direction="FFTW_FORWARD", **plan)
            self._row_back = pyfftw.FFTW(stage[:n1], back, axes=(1,), direction="FFTW_BACKWARD", **inverse)
            norm *= l2
        self._back = self._row_back.output_array
        self._stage, self._empty_rows = stage, stage[n1:]
        if b1 == "mirror":
            real = stage if b2 == "mirror" else stage.view("float64").reshape(l1, -1, 2)
            spectrum = zeros(real.shape)
            self._column_forward = pyfftw.FFTW(real, spectrum, axes=(0,), direction="FFTW_REDFT10", **plan)
            self._column_back = pyfftw.FFTW(spectrum, real, axes=(0,), direction="FFTW_REDFT01", **inverse)
            norm *= 2 * n1
        else:
            m1 = l1 // 2 + 1 if b2 == "mirror" else l1
            spectrum = zeros((m1, stage.shape[1]), dtype="complex128")
            self._column_forward = pyfftw.FFTW(stage, spectrum, axes=(0,), direction="FFTW_FORWARD", **plan)
            self._column_back = pyfftw.FFTW(spectrum, stage, axes=(0,), direction="FFTW_BACKWARD", **inverse)
            norm *= l1
        symbol = half_space.symbol / norm
        self._spectrum = spectrum
        self._symbol = symbol[:, :, None] if spectrum.ndim == 3 else symbol
        for buffer in (self.pressure, self.direction, self.result, stage, spectrum):
            buffer[:] = 0

    def apply(self, x: Array) -> Array:
        """K x for one of the buffers `pressure` and `direction`; returns the buffer `result`."""
        n1, n2 = self.shape
        self.pairs += 1
        if self._padded is not None:
            self._padded[:, :n2] = x
            self._padded[:, n2:] = 0
            self._row_forward.execute()
        else:
            self._row_forward.update_arrays(x, self._stage[:n1])
            self._row_forward.execute()
        self._empty_rows[:] = 0
        self._column_forward.execute()
        self._spectrum *= self._symbol
        self._column_back.execute()
        self._row_back.execute()
        if self._padded is not None:
            self.result[:] = self._back[:, :n2]
        return self.result

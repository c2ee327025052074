"""One grid of the contact solver: transform plans, preconditioner, work arrays."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from math import inf

import numpy as np
from numpy.typing import NDArray

from . import kernels
from .convolution import Convolution
from .half_space import HalfSpace
from .influence import stiffness_stencil

Array = NDArray[np.float64]
#: Shorter side of the coarsest grid, at most.
_COARSEST = 48
#: From so many points on, single precision is faster where it may be used.
_SINGLE = 512**2


@lru_cache(maxsize=8)
def nested_grids(half_space: HalfSpace, thread: int, threads: int) -> tuple[Grid, ...]:
    """Workspaces from the given grid to the coarsest, kept per thread because their arrays are written to."""
    levels = [half_space]
    while min(half_space.shape) > _COARSEST:
        n1, n2 = half_space.shape
        d1, d2 = half_space.spacing
        half_space = replace(half_space, shape=((n1 + 1) // 2, (n2 + 1) // 2), spacing=(2 * d1, 2 * d2))
        levels.append(half_space)
    return tuple(Grid(level, threads) for level in levels)


class Grid:
    """Transform plans, preconditioner and work arrays of one grid."""

    def __init__(self, half_space: HalfSpace, threads: int) -> None:
        self.half_space = half_space
        n1, n2 = half_space.shape
        n = n1 * n2
        body = half_space.shape, half_space.boundary, half_space.symbol()
        self._respond = Convolution(*body, threads=threads)
        # what single precision loses in products with directions, the next product with the pressure gives back
        precision = np.float32 if n >= _SINGLE else np.float64
        self._search = Convolution(*body, dtype=precision, threads=threads, over=self._respond)
        self.pressure, self.displaced = self._respond.pressure, self._respond.displacement
        stencil = stiffness_stencil(half_space.spacing, half_space.modulus)
        r1, r2 = min(1, (n1 - 1) // 2), min(1, (n2 - 1) // 2)  # thin grids: not onto itself
        self.state = np.zeros((n1, n2), np.int8)
        self.progress = np.zeros(1, kernels.Progress)
        self.pairs = 0
        self._arrays = (
            self.progress,
            self.pressure.ravel(),
            self.displaced.ravel(),
            self._search.pressure.ravel(),
            self._search.displacement.ravel(),
            self.state.ravel(),
            # lists and values, touched only as far as there are points in contact
            np.empty((3, n), np.int32),
            np.empty((4, n)),
            np.empty((4, n)),
            np.ascontiguousarray(stencil[1 - r1 : 2 + r1, 1 - r2 : 2 + r2]),
            _index_map(n1, r1, half_space.boundary[0]),
            _index_map(n2, r2, half_space.boundary[1]),
            np.empty((2, n)),
        )
        # stiffness of a wave of four pixels: the step from gap to pressure
        spacings = [d for n, d in zip(half_space.shape, half_space.spacing, strict=True) if n > 1] or [
            min(half_space.spacing)
        ]
        self.stiffness = np.pi * half_space.modulus / (4 * float(np.prod(spacings) ** (1 / len(spacings))))

    def start(self, pressure: Array, hardness: Array) -> None:
        """Start from pressures on this grid, or on the next coarser one."""
        bounds = hardness.reshape(1, 1) if hardness.size == 1 else hardness
        if pressure.shape == self.pressure.shape:
            np.minimum(pressure, bounds, out=self.pressure)
            self.state[:] = self.pressure > 0
        else:
            kernels.prolong(pressure, bounds, self.pressure, self.state)

    def set_uniform(self, gap0: Array, offset: float, pressure: float | Array, approach: float | None) -> None:
        """A known pressure, and an approach at which no point comes into contact, or at which all do."""
        self.pressure[:] = pressure
        self._respond.apply()
        self.displaced += gap0 - offset
        t = self.progress[0]
        t["delta"] = self.displaced.max() if approach is None else approach - offset
        t["residual"], t["iteration"], self.pairs = 0.0, 0, 1

    def solve(
        self,
        gap0: Array,
        offset: float,
        hardness: Array,
        rtol: float,
        limit: int,
        *,
        load: float | None,
        approach: float | None,
    ) -> None:
        """From the start to the residual `rtol`, or as near as `limit` iterations bring it."""
        t = self.progress[0]
        t["offset"], t["rtol"], t["limit"] = offset, rtol, limit
        t["load"] = 0.0 if load is None else load * self.pressure.size
        t["approach_given"], t["monotone"], t["gradient_next"] = approach is not None, False, False
        t["delta"] = 0.0 if approach is None else approach - offset
        t["c"] = t["c0"] = self.stiffness
        t["c_min"] = self.stiffness / (4 * max(self.half_space.shape))
        t["damping"], t["energy"], t["reach"] = 1.0, inf, -inf
        t["phase"], t["iteration"], t["residual"] = 0, 0, inf
        self.pairs = 0
        gap, bound = gap0.ravel(), hardness.ravel()
        needs = kernels.PRESSURE
        while needs != kernels.DONE:
            (self._respond if needs == kernels.PRESSURE else self._search).apply()
            self.pairs += 1
            needs = kernels.advance(gap, bound, *self._arrays)


def _index_map(n: int, radius: int, boundary: str) -> NDArray[np.int64]:
    """Real index of each index −radius … n − 1 + radius; −1 where there is nothing."""
    i = np.arange(-radius, n + radius)
    if boundary == "periodic":
        return i % n
    if boundary == "mirror":
        return np.where(i < 0, -1 - i, np.where(i >= n, 2 * n - 1 - i, i))
    return np.where((i < 0) | (i >= n), -1, i)

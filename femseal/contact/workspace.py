"""One grid of the contact solver: products with K, preconditioner and work arrays."""

from __future__ import annotations

from functools import lru_cache
from math import prod
from threading import get_ident
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..base import Array, Indices
from ..base.compiled import number
from .convolution import Convolution
from .gradient_kernels import restart, step, turn
from .half_space import HalfSpace, stiffness_stencil
from .kernels import PART, Points, Stencil, add_gap, add_gap_in_parts, exact, fast, look, project

#: Points up to which the arrays of a grid are kept for its next problem: 100 bytes each. Making them takes 14 times as
#: long as a solution of 64² points, 2.6 times at 256², .2 times at 1024².
KEPT_POINTS = 2**21
#: Number of points from which two threads are faster than one.
_THREADED = 2**18
#: What a step of the iteration calls on small grids, compiled as a whole, and on those of which threads share the work.
_AT_ONCE = SimpleNamespace(
    add_gap=add_gap,
    look=exact(look),
    project=exact(project),
    restart=fast(restart),
    turn=fast(turn),
    step=fast(step),
)
_IN_PARTS = SimpleNamespace(
    add_gap=add_gap_in_parts,
    look=look,
    project=project,
    restart=restart,
    turn=turn,
    step=step,
)


def workspace(half_space: HalfSpace, finest: HalfSpace | None = None) -> Workspace:
    """Workspace of a half-space, kept for this thread unless it is large, or the `finest` of its levels is."""
    if prod((finest or half_space).shape) > KEPT_POINTS:
        return Workspace(half_space, number(), kept=False)
    return _kept(half_space, number(), get_ident())


@lru_cache(maxsize=32)
def _kept(half_space: HalfSpace, threads: int, thread: int) -> Workspace:
    return Workspace(half_space, threads)


class Workspace:
    """Products with K, preconditioner and work arrays of one grid; `kernels` says what the arrays hold.

    Attributes
    ----------
    respond : v = K p from `pressure` to `displacement`, the same memory as `p` and the rows `v`.
    search : Kd of a direction, from `points.dense` to the rows `kd`, which are in the memory of `v`.
    stencil : of the preconditioner M, truncated from the symbol E*|q|/2.
    points : state, lists and fields of the loops.
    loops : the kernels, in parts where the grid is large.
    stiffness : c₀ [Pa/m], see `HalfSpace.stiffness`. kept : whether the arrays are used again.
    """

    def __init__(self, half_space: HalfSpace, threads: int, kept: bool = True) -> None:
        n1, n2 = half_space.shape
        n = n1 * n2
        threads = threads if n >= _THREADED else 1
        self.half_space, self.kept = half_space, kept
        body = half_space.shape, half_space.boundary
        self.respond = Convolution(*body, half_space.symbol(), threads=threads)
        # the next product with the pressure corrects the errors of products in single precision
        self.search = Convolution(*body, None, dtype=np.float32, threads=threads, over=self.respond)
        self.pressure = self.respond.pressure
        self.p, self.v = self.respond.pressure.ravel(), self.respond.rows
        self.kd = self.search.rows
        # pages of memory are used only as far as lists are long
        self.points = Points(
            p=self.p,
            v=self.v,
            state=np.zeros(n, np.int8),
            lists=np.empty((3, n), np.int32),
            near=np.empty((4, n)),
            on_free=np.empty((6, n)),
            dense=self.search.pressure.ravel(),
        )
        stencil = stiffness_stencil(half_space.spacing, half_space.modulus)
        self.stencil = Stencil(
            stencil,
            _index_map(n1, 1, half_space.boundary[0]),
            _index_map(n2, 1, half_space.boundary[1]),
        )
        self.stiffness = half_space.stiffness
        self.loops = _IN_PARTS if n > PART else _AT_ONCE

    def end(self) -> None:
        """Keep p and v only, of a grid that is not used again."""
        if not self.kept:
            del self.respond, self.search, self.kd, self.points

    def start(self, pressure: Array, limit: Array) -> None:
        """Start from pressures on this grid, or on the next coarser one, nowhere above `limit` (1,) or (n1, n2)."""
        if pressure.shape != self.pressure.shape:
            n1, n2 = self.pressure.shape
            pressure = np.repeat(np.repeat(pressure, 2, axis=0), 2, axis=1)[:n1, :n2]
        np.minimum(pressure, limit, out=self.pressure)
        self.points.state[:] = self.p > 0


def _index_map(n: int, radius: int, boundary: str) -> Indices:
    """Real index of each index −radius … n − 1 + radius; −1 outside a free axis."""
    beyond: dict[str, Any] = {
        "periodic": {"mode": "wrap"},
        "mirror": {"mode": "symmetric"},
        "free": {"constant_values": -1},
    }
    return np.pad(np.arange(n), radius, **beyond[boundary])


def coarsen(a: Array) -> Array:
    """Means over 2×2 points; an odd last row or column is averaged alone."""
    n1, n2 = a.shape
    if n1 % 2:
        a = np.concatenate((a, a[-1:]))
    if n2 % 2:
        a = np.concatenate((a, a[:, -1:]), axis=1)
    rows = a[::2] + a[1::2]
    return 0.25 * (rows[:, ::2] + rows[:, 1::2])

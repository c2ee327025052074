"""One grid of the contact solver: products with K, preconditioner and work arrays."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from math import prod
from threading import get_ident
from typing import Any, NamedTuple

import numpy as np

from ..base import Array, Indices, Shape
from ..base.compiled import number
from . import gradient_steps, projection
from .convolution import Convolution
from .half_space import HalfSpace, stiffness_stencil

Call = Callable[..., Any]
#: Points up to which the arrays of a grid are kept for its next problem: 100 bytes each. Making them takes 14 times as
#: long as a solution of 64² points, 2.6 times at 256², .2 times at 1024².
KEPT_POINTS = 2**21
#: Number of points from which two threads are faster than one.
_THREADED = 2**18
#: Loops of small grids, each compiled as a whole with those that it is made of.
_WHOLE: dict[str, Any] = {
    "list_near": projection.list_near,
    "look": projection.exact(projection.look),
    "project": projection.exact(projection.project),
    "restart": projection.fast(gradient_steps.restart),
    "turn": projection.fast(gradient_steps.turn),
    "step": projection.fast(gradient_steps.step),
}
#: Loops of large grids, of which threads share the parts.
_IN_PARTS: dict[str, Any] = {
    "list_near": projection.list_near_in_parts,
    "look": projection.look,
    "project": projection.project,
    "restart": gradient_steps.restart,
    "turn": gradient_steps.turn,
    "step": gradient_steps.step,
}


class Problem(NamedTuple):
    """A contact problem on one grid.

    gap0 : undeformed gap h₁ (n,) [m]. offset : height [m] that is subtracted from h₁ and from the approach, because
    large heights cost digits. hardness, slope : of the law, see `law.YieldLine`, flat [Pa], [Pa/m]. load : Σ p [Pa].
    """

    gap0: Array
    offset: float
    hardness: Array
    slope: Array
    load: float


def workspace(half_space: HalfSpace, finest: HalfSpace | None = None) -> Workspace:
    """Workspace of a half-space. Its arrays are kept for this thread, unless it or its finest level is large."""
    is_kept = prod((finest or half_space).shape) <= KEPT_POINTS
    # bodies that differ in their modulus alone share their arrays
    unit = half_space.of_unit_modulus
    arrays = _kept(unit, number(), get_ident()) if is_kept else WorkArrays(unit, number())
    return Workspace(half_space, arrays, is_kept)


class WorkArrays:
    """Transforms and arrays of one grid, for a body of unit modulus; the loops say what the arrays hold."""

    def __init__(self, unit: HalfSpace, threads: int) -> None:
        n = prod(unit.shape)
        threads = threads if n >= _THREADED else 1
        body = unit.shape, unit.boundary
        self.respond = Convolution(*body, unit.symbol(), threads=threads)
        # the next product with the pressure corrects the errors of products in single precision
        self.search = Convolution(*body, None, dtype=np.float32, threads=threads, over=self.respond)
        self.p, self.v = self.respond.pressure.ravel(), self.respond.rows
        self.dense, self.kd = self.search.pressure.ravel(), self.search.rows
        self.state = np.zeros(n, np.int8)
        # pages of memory are used only as far as lists are long
        self.near, self.free, self.place = np.empty((3, n), np.int32)
        self.near_p, self.near_v, self.trial, self.response = np.empty((4, n))
        self.r, self.w, self.d, self.ones, self.soft, self.scale = np.empty((6, n))
        self.stencil = stiffness_stencil(unit.spacing, 1.0)
        ends = zip(unit.shape, unit.boundary, strict=True)
        self.rows, self.columns = (_index_map(size, end) for size, end in ends)


@lru_cache(maxsize=32)
def _kept(unit: HalfSpace, threads: int, thread: int) -> WorkArrays:
    """Arrays that a thread uses again."""
    return WorkArrays(unit, threads)


class Workspace:
    """A half-space on its grid: what the iteration of active sets calls between two decisions.

    Attributes
    ----------
    pressure : (n1, n2) [Pa], in the memory of `arrays.p`. is_kept : whether another problem will use it again.
    stiffness : c₀ [Pa/m], see `HalfSpace.stiffness`. weights : of the preconditioner M, 3 × 3 values [Pa/m].
    compliance : factor of the products of `arrays`, those of a unit modulus [1/Pa].
    """

    def __init__(self, half_space: HalfSpace, arrays: WorkArrays, is_kept: bool) -> None:
        self.half_space, self.arrays, self.is_kept = half_space, arrays, is_kept
        self.compliance = 1.0 / half_space.modulus
        self.pressure, self.stiffness = arrays.respond.pressure, half_space.stiffness
        self.weights = half_space.modulus * arrays.stencil
        self._loops = _IN_PARTS if self.pressure.size > projection.PART else _WHOLE

    def start(self, pressure: Array, limit: Array) -> None:
        """Start from pressures on this grid, or on the next coarser one, nowhere above `limit` (1,) or (n1, n2)."""
        if pressure.shape != self.pressure.shape:
            pressure = refined(pressure, self.pressure.shape)
        np.minimum(pressure, limit, out=self.pressure)
        self.arrays.state[:] = self.arrays.p > 0
        self.arrays.dense[:] = 0

    def displacement(self) -> Array:
        """Product Kp of the pressure (n1, n2) [m], in the memory of `arrays.v`."""
        self.arrays.respond.apply()
        displacement = self.arrays.respond.displacement
        displacement *= self.compliance
        return displacement

    def response(self, direction: Array) -> Array:
        """Product with a direction (n,) [Pa] in single precision: (n,) [m]."""
        self.arrays.dense[:] = direction
        self.arrays.search.apply()
        return self.compliance * self.arrays.search.displacement.ravel().astype(float)

    def release(self) -> None:
        """Let go of all arrays but those that others hold, of a grid that is not used again."""
        if not self.is_kept:
            del self.arrays

    def loops(self, problem: Problem) -> Loops:
        """The loops of a problem on this grid."""
        a, law = self.arrays, (problem.hardness, problem.slope)
        lists = a.near, a.near_p, a.near_v, a.free, a.place
        stencil = a.scale, self.weights, a.rows, a.columns
        arrays: dict[str, tuple[Any, ...]] = {
            "list_near": (problem.gap0, problem.offset, *law, a.p, a.v, a.state, *lists),
            "look": (*law, a.state, a.near, a.near_p, a.near_v, a.trial, problem.load),
            "project": (
                *(*law, a.p, a.state, a.dense, a.near, a.near_p),
                *(a.trial, a.free, a.response, problem.load),
            ),
            "restart": (*law, a.state, a.dense, *lists[1:], a.r, a.ones, a.soft, *stencil),
            "turn": (a.dense, a.free, a.r, a.w, a.d, a.ones, *stencil),
            "step": (
                *(a.kd, self.compliance, a.dense, *lists),
                *(a.r, a.d, a.soft, a.scale, a.response),
            ),
        }
        products = a.respond.apply, a.search.apply
        return Loops(
            *products,
            **{name: partial(self._loops[name], *given) for name, given in arrays.items()},
        )


class Loops(NamedTuple):
    """Compiled loops with the arrays of one problem: what changes from call to call is left to give.

    respond, search : products of pressures, and of directions, with K of a unit modulus.
    """

    respond: Call
    search: Call
    list_near: Call  # factor, weight, reach, first, end
    look: Call  # n_near, c, delta
    project: Call  # n_near, n_free, c, delta, keep
    restart: Call  # n_free, delta
    turn: Call  # n_free, former, total_ones
    step: Call  # n_near, n_free, wr


def _index_map(n: int, boundary: str) -> Indices:
    """Real index of each index −1 … n; −1 outside a free axis."""
    beyond: dict[str, Any] = {
        "periodic": {"mode": "wrap"},
        "mirror": {"mode": "symmetric"},
        "free": {"constant_values": -1},
    }
    return np.pad(np.arange(n), 1, **beyond[boundary])


def coarsened(a: Array) -> Array:
    """Means over 2×2 points; an odd last row or column is averaged alone."""
    n1, n2 = a.shape
    if n1 % 2:
        a = np.concatenate((a, a[-1:]))
    if n2 % 2:
        a = np.concatenate((a, a[:, -1:]), axis=1)
    rows = a[::2] + a[1::2]
    return 0.25 * (rows[:, ::2] + rows[:, 1::2])


def refined(a: Array, shape: Shape) -> Array:
    """Values of a grid at the points of the next finer one, which `coarsened` takes to it."""
    n1, n2 = shape
    return np.repeat(np.repeat(a, 2, axis=0), 2, axis=1)[:n1, :n2]

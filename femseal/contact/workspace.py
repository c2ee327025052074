"""Data of the contact solver for one grid: products with K, the preconditioner, and work arrays."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from functools import partial
from math import prod
from typing import Any, NamedTuple

import numpy as np

from ..base import Array, Indices
from ..base.compiled import entry_point, thread_count
from . import gradient_steps, near_points, projection
from .convolution import Convolution
from .half_space import HalfSpace, stiffness_stencil
from .loop_decorators import exact, fast
from .point_arrays import (
    FreePoints,
    GradientLists,
    GridPoints,
    LinearLaw,
    NearPoints,
    Preconditioner,
)

Call = Callable[..., Any]
#: Largest number of points of a grid whose arrays, 100 bytes per point, are kept for the next problem on this grid.
#: Creating them takes 14 times as long as a solution on 64² points, 2.6 times as long on 256², and 0.2 times on 1024².
KEPT_POINTS = 2**21
#: Largest number of points of all grids whose arrays a thread keeps: the nested grids of two problems of the largest
#: kept size, or those of many small ones. The arrays that were used least recently are released first.
_KEPT_IN_ALL = 3 * KEPT_POINTS
#: Number of points from which two threads are faster than one.
_THREADED = 2**18
#: Loops for small grids. Each of them is compiled as a single function.
_UNDIVIDED: dict[str, Any] = {
    "list_near": near_points.list_near,
    "list_near_in_single": near_points.list_near,
    "evaluate": exact(projection.evaluate),
    "project": exact(projection.project),
    "prepare_directions": fast(gradient_steps.prepare_directions),
    "gradient_step": fast(gradient_steps.gradient_step),
}
#: Loops for large grids. Their parts are divided between threads.
_IN_PARTS: dict[str, Any] = {
    "list_near": near_points.list_near_in_parts,
    "list_near_in_single": near_points.list_near_in_parts,
    "evaluate": projection.evaluate,
    "project": projection.project,
    "prepare_directions": gradient_steps.prepare_directions,
    "gradient_step": gradient_steps.gradient_step,
}


class Problem(NamedTuple):
    """A contact problem on one grid, with a linear contact law.

    gap0 : array (n,), undeformed gap h₁ [m].
    offset : height [m] that is subtracted from h₁ and from the approach, to reduce rounding errors.
    law : hardness and hardening modulus of each point.
    load : required sum of the pressures of all points [Pa].
    first_delta : first guess of the approach [m], measured from `offset`; None without a guess.
    """

    gap0: Array
    offset: float
    law: LinearLaw
    load: float
    first_delta: float | None = None


def workspace(half_space: HalfSpace, finest: HalfSpace | None = None) -> Workspace:
    """Make the work arrays of the contact solver for the grid of a half-space.

    The arrays remain in memory for the next problem of this thread, unless the finest of the nested grids is large.

    half_space : half-space on the grid for which the arrays are made.
    finest : half-space on the finest of the nested grids; by default `half_space`.
    """
    is_kept = prod((finest or half_space).shape) <= KEPT_POINTS
    # half-spaces that differ only in their modulus share their arrays
    unit = half_space.of_unit_modulus
    if is_kept:
        arrays = _kept_arrays.get(unit, thread_count())
    else:
        arrays = WorkArrays(unit, thread_count())
    return Workspace(half_space, arrays, is_kept)


class WorkArrays:
    """Transforms and arrays of one grid, for a half-space of unit modulus.

    Attributes
    ----------
    respond : Convolution
        Computes the displacement due to a pressure, in double precision.
    search : Convolution
        Computes the displacement due to a search direction, in single precision.
    points, near, free, gradient_lists : GridPoints, NearPoints, FreePoints, GradientLists
        Values of all points of the grid, lists of the points near contact and of the free points, and values of the
        conjugate gradients at the free points.
    stencil, rows, columns : array
        Preconditioner for a half-space of unit modulus, see `Preconditioner`.
    """

    def __init__(self, unit: HalfSpace, threads: int) -> None:
        n = prod(unit.shape)
        if n < _THREADED:
            threads = 1
        self.respond = Convolution(unit.shape, unit.boundary, unit.symbol(), threads=threads)
        # single precision is enough, because the next product with the pressure corrects its errors
        self.search = Convolution(
            unit.shape,
            unit.boundary,
            None,
            dtype=np.float32,
            threads=threads,
            memory_of=self.respond,
        )
        # grid arrays in the memory of the two convolutions
        self.points = GridPoints(
            p=self.respond.pressure.ravel(),
            v=self.respond.rows,
            state=np.zeros(n, np.int8),
            dense=self.search.pressure.ravel(),
            kd=self.search.rows,
        )
        # the operating system provides memory only for the part of a list that is used
        near_index, free_index, position = np.empty((3, n), np.int32)
        self.near = NearPoints(near_index, *np.empty((4, n)))
        self.free = FreePoints(free_index, position)
        self.gradient_lists = GradientLists(*np.empty((6, n)))
        self.stencil = stiffness_stencil(unit)
        self.rows = _index_map(unit.shape[0], unit.boundary[0])
        self.columns = _index_map(unit.shape[1], unit.boundary[1])


class _KeptArrays(threading.local):
    """Arrays of the grids on which this thread has solved problems, up to a total number of points.

    Each thread has its own arrays, because they are written to. They are released when the thread ends.
    """

    def __init__(self) -> None:
        self.arrays: OrderedDict[tuple[HalfSpace, int], WorkArrays] = OrderedDict()

    def get(self, unit: HalfSpace, threads: int) -> WorkArrays:
        """Return the arrays of a grid, for a half-space of unit modulus; make them if they are not kept."""
        key = unit, threads
        arrays = self.arrays.pop(key, None)
        if arrays is None:
            others = sum(prod(half_space.shape) for half_space, _ in self.arrays)
            while self.arrays and others + prod(unit.shape) > _KEPT_IN_ALL:
                (oldest, _), _arrays = self.arrays.popitem(last=False)
                others -= prod(oldest.shape)
            arrays = WorkArrays(unit, threads)
        self.arrays[key] = arrays  # the last item is the one that was used most recently
        return arrays


_kept_arrays = _KeptArrays()


class Workspace:
    """A half-space, the contact pressure on its grid, and all work arrays of the contact solver.

    Attributes
    ----------
    pressure : array (n1, n2)
        Pressure [Pa], in the memory of `points.p`.
    points, near, free : GridPoints, NearPoints, FreePoints
        Arrays of the solver, see `point_arrays`.
    preconditioner : Preconditioner
        Approximate inverse M of K.
    is_kept : bool
        Whether the arrays remain in memory for the next problem.
    stiffness : float
        Stiffness c₀ [Pa/m], see `HalfSpace.stiffness`.
    compliance : float
        Factor 1/E* [1/Pa] applied to displacements from `arrays`, which are computed for a contact modulus of 1 Pa.
    """

    def __init__(self, half_space: HalfSpace, arrays: WorkArrays, is_kept: bool) -> None:
        self.half_space = half_space
        self.arrays = arrays
        self.is_kept = is_kept
        self.pressure = arrays.respond.pressure
        self.points = arrays.points
        self.near = arrays.near
        self.free = arrays.free
        self.stiffness = half_space.stiffness
        # the transforms and the stencil in `arrays` belong to a contact modulus of 1 Pa
        self.compliance = 1.0 / half_space.pixel_modulus
        weights = half_space.pixel_modulus * arrays.stencil
        self.preconditioner = Preconditioner(weights, arrays.rows, arrays.columns)

    def start(self, pressure: Array, limit: Array) -> None:
        """Set the initial pressure [Pa], which is given on the grid or on the next coarser grid.

        limit : array (1,) or (n1, n2), largest pressure [Pa].
        """
        if pressure.shape != self.pressure.shape:
            refine(pressure, self.pressure)
            pressure = self.pressure
        np.minimum(pressure, limit, out=self.pressure)
        # 1 (elastic) or 0 (out of contact)
        np.greater(self.points.p, 0.0, out=self.points.state.view(bool))
        self.points.dense[:] = 0

    def displacement(self) -> Array:
        """Compute the displacement Kp (n1, n2) [m] due to the pressure, and store it in the memory of `points.v`."""
        self.arrays.respond.apply()
        displacement = self.arrays.respond.displacement
        displacement *= self.compliance
        return displacement

    def response(self, direction: Array) -> Array:
        """Compute the displacement (n,) [m] due to a search direction (n,) [Pa] in single precision."""
        self.points.dense[:] = direction
        self.arrays.search.apply()
        return self.compliance * self.arrays.search.displacement.ravel().astype(float)

    def release(self) -> None:
        """Release the memory of the arrays, unless the next problem will use the same arrays."""
        if not self.is_kept:
            del self.arrays, self.points, self.near, self.free

    def loops(self, problem: Problem) -> Loops:
        """Return the compiled loops, to which the arrays of this grid and the data of a problem are already passed."""
        arrays = self.arrays
        law = problem.law
        points, near, free, lists = self.points, self.near, self.free, arrays.gradient_lists
        is_divided = self.pressure.size > near_points.PART
        loops = _IN_PARTS if is_divided else _UNDIVIDED

        def bind(name: str, *groups: Any) -> Call:
            """Return the loop `name`, to which the given first arguments are already passed."""
            loop = loops[name]
            if not is_divided:
                loop = entry_point(name, loop, *groups, *_OTHER_ARGUMENTS[name])
            return partial(loop, *groups)

        listed = problem.gap0, problem.offset, law, points, near, free
        return Loops(
            respond=arrays.respond.apply,
            search=arrays.search.apply,
            list_near=bind("list_near", *listed, points.v, True),
            list_near_in_single=bind("list_near_in_single", *listed, points.kd, False),
            evaluate=bind("evaluate", law, points, near, problem.load),
            project=bind("project", law, points, near, free, problem.load),
            prepare_directions=bind(
                "prepare_directions", law, points, near, free, lists, self.preconditioner
            ),
            gradient_step=bind(
                "gradient_step", points, near, free, lists, self.preconditioner, self.compliance
            ),
        )


class Loops(NamedTuple):
    """Compiled loops for one contact problem.

    The arrays of the grid and the data of the problem have already been passed to each loop as its first arguments. The
    comment next to a loop lists its remaining arguments.

    respond : compute the displacement due to the pressure, for a half-space of unit modulus.
    search : compute the displacement due to the values in `points.dense` in single precision, for a half-space of unit
        modulus.
    list_near, list_near_in_single : list the points near contact after `respond` and after `search`. Only `list_near`
        replaces the displacement on the grid by v, which would lose digits in single precision.

    All loops but `respond` and `search` are described in the modules `near_points`, `projection` and `gradient_steps`.
    """

    respond: Call  # no arguments
    search: Call  # no arguments
    list_near: Call  # value_factor, gap_factor, reach, first, end
    list_near_in_single: Call  # the same
    evaluate: Call  # n_near, c, delta
    project: Call  # n_near, n_free, c, delta, keep
    prepare_directions: Call  # n_free, delta
    gradient_step: Call  # n_near, n_free, wr, total_ones


#: Examples of the remaining arguments of each loop, which tell their types.
_OTHER_ARGUMENTS: dict[str, tuple[Any, ...]] = {
    "list_near": (1.0, 1.0, 1.0, 0, 1),
    "list_near_in_single": (1.0, 1.0, 1.0, 0, 1),
    "evaluate": (1, 1.0, 1.0),
    "project": (1, 1, 1.0, 1.0, True),
    "prepare_directions": (1, 1.0),
    "gradient_step": (1, 1, 1.0, 1.0),
}


def _index_map(n: int, boundary: str) -> Indices:
    """Map the indices −1 to n along an axis of n points to indices of grid points.

    The indices −1 and n lie beyond the ends of the axis. On a periodic or mirror axis, they are mapped to the grid
    points that are their images. On a free axis, where the pressure beyond the ends is 0, they are mapped to −1.
    """
    padding: dict[str, Any] = {
        "periodic": {"mode": "wrap"},
        "mirror": {"mode": "symmetric"},
        "free": {"constant_values": -1},
    }
    return np.pad(np.arange(n), 1, **padding[boundary])


def coarsened(values: Array) -> Array:
    """Average values (n1, n2) over 2 × 2 points. If the number of rows or columns is odd, the last is repeated."""
    n1, n2 = values.shape
    if n1 % 2:
        values = np.concatenate((values, values[-1:]))
    if n2 % 2:
        values = np.concatenate((values, values[:, -1:]), axis=1)
    pairs_of_rows = values[::2] + values[1::2]
    totals: Array = pairs_of_rows[:, ::2] + pairs_of_rows[:, 1::2]
    totals *= 0.25
    return totals


def refine(values: Array, finer: Array) -> None:
    """Copy each value of a grid to 2 × 2 points of the next finer grid, at the ends of its axes to fewer points."""
    n1, n2 = finer.shape
    finer[::2, ::2] = values
    finer[::2, 1::2] = values[:, : n2 // 2]
    finer[1::2] = finer[: n1 - 1 : 2]

"""Contact under a given load: projected active sets with preconditioned conjugate gradients, nested start.

Symbols: p pressure, H hardness, h₁ undeformed gap, v = Kp + h₁, δ approach, g = v − δ raw gap, E* contact modulus.
The problem is the convex programme  min ½⟨p,Kp⟩ + ⟨p,h₁⟩,  0 ≤ p ≤ H,  mean p = p̄.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..errors import InputError, NotConverged
from . import loops
from .halfspace import Convolution, HalfSpace
from .kernels import stiffness_stencil

Array = NDArray[np.float64]
_COARSEST = 48
_COARSE_RTOL = 1e-2
_MAX_ITERATIONS = 400


@dataclass(frozen=True)
class Contact:
    """Solution of a contact problem; fields carry their unit in the dataclass metadata.

    Out of contact p = 0 and g > 0; elastic contact has 0 < p < H and g = 0; at p = H the point floats, g ≤ 0.
    """

    pressure: Array = field(metadata={"unit": "Pa", "long_name": "contact pressure"})
    gap: Array = field(metadata={"unit": "m", "long_name": "deformed gap"})
    plastic_deformation: Array = field(metadata={"unit": "m", "long_name": "permanent deformation"})
    approach: float = field(metadata={"unit": "m", "long_name": "rigid-body approach"})
    residual: float = field(metadata={"unit": "1", "long_name": "complementarity residual"})
    iterations: int = field(metadata={"unit": "1", "long_name": "outer iterations on the given grid"})
    fft_pairs: int = field(metadata={"unit": "1", "long_name": "transform pairs on the given grid"})
    plastic: NDArray[np.bool_] = field(metadata={"unit": "1", "long_name": "points at the hardness"})

    @property
    def area_fraction(self) -> float:
        """Share of points in contact, p > 0."""
        return float(np.count_nonzero(self.pressure) / self.pressure.size)

    @property
    def plastic_fraction(self) -> float:
        """Share of points at the hardness."""
        return float(np.count_nonzero(self.plastic) / self.pressure.size)

    @property
    def mean_pressure(self) -> float:
        """Mean pressure p̄ over the nominal area [Pa]."""
        return float(self.pressure.mean())

    @property
    def mean_gap(self) -> float:
        """Mean deformed gap [m]."""
        return float(self.gap.mean())

    @property
    def raw_gap(self) -> Array:
        """Gap between the undeformed-but-elastically-displaced faces [m]; negative where they deformed for good."""
        return self.gap - self.plastic_deformation


def solve_contact(
    gap0: ArrayLike,
    half_space: HalfSpace,
    *,
    pressure: float,
    hardness: float | ArrayLike = inf,
    rtol: float = 1e-6,
) -> Contact:
    """Pressure and gap of an elastic-perfectly plastic half-space pressed on a rough gap by a mean pressure.

    Parameters
    ----------
    gap0 : undeformed gap h₁ (n1, n2) [m], up to a constant.
    half_space : elastic body, boundary kinds, grid.
    pressure : nominal pressure p̄ [Pa], 0 ≤ p̄ ≤ mean H; 0 is first touch, mean H all plastic.
    hardness : H [Pa], a number or one per point; inf is elastic.
    rtol : complementarity residual ‖p − clip(p − c(v − δ), 0, H)‖/‖p‖ to reach, c = πE*/(4Δ).

    Raises
    ------
    InputError : wrong shape, undefined points, or a pressure that the hardness cannot carry.
    NotConverged : the residual was not reached; the message says which was.

    Notes
    -----
    Inexact semismooth Newton on the contact and plastic sets, as in gradient-projection conjugate gradients
    (Moré & Toraldo, SIAM J. Optim. 1, 1991, 93; Polonsky & Keer, Wear 231, 1999, 206). There is no proof of
    convergence, so the residual is computed anew from the returned pressure.
    """
    gap0, bounds = _validated(gap0, half_space, pressure, hardness, rtol)
    offset = float(gap0.mean())
    h1 = gap0 - offset
    limit = float(bounds.mean())
    if pressure == 0:
        p = np.zeros(half_space.shape)
        return _finish(p, h1, float(h1.min()), offset, bounds, 0.0, 0, 0)
    if pressure >= limit * (1 - 1e-12):
        p = np.broadcast_to(bounds, half_space.shape).copy()
        v = h1 + half_space.displacement(p)
        return _finish(p, v, float(v.max()), offset, bounds, 0.0, 0, 1)
    grids = _grids(half_space, threading.get_ident())
    gaps, hardnesses = [h1], [bounds]
    for _ in grids[1:]:
        gaps.append(_coarsen(gaps[-1]))
        hardnesses.append(_coarsen(hardnesses[-1]) if hardnesses[-1].size > 1 else hardnesses[-1])
    # means over an odd border weigh it double: the same share of the hardness can be carried on every grid
    loads = [pressure if np.isinf(limit) else pressure / limit * float(h.mean()) for h in hardnesses]
    p = _bearing_area(gaps[-1], hardnesses[-1], loads[-1], grids[-1].half_space)
    for level in range(len(grids) - 1, 0, -1):
        p = grids[level].solve(gaps[level], hardnesses[level], loads[level], p, _COARSE_RTOL, strict=False).pressure
        p = np.repeat(np.repeat(p, 2, axis=0), 2, axis=1)[: gaps[level - 1].shape[0], : gaps[level - 1].shape[1]]
    solution = grids[0].solve(h1, bounds, pressure, p, rtol, strict=True)
    return replace(solution, approach=solution.approach + offset)


def _validated(
    gap0: ArrayLike, half_space: HalfSpace, pressure: float, hardness: float | ArrayLike, rtol: float
) -> tuple[Array, Array]:
    h = checks.field("gap0", gap0, unit="m", shape=half_space.shape)
    bounds = hardness_bounds(hardness, half_space.shape)
    limit = float(bounds.mean())
    if checks.number("pressure", pressure, unit="Pa", inclusive=True) > limit * (1 + 1e-12):
        raise InputError.of("pressure", f"{pressure:g} Pa", f"at most the mean hardness, {limit:g} Pa")
    checks.tolerance("rtol", rtol)
    return h, bounds


def hardness_bounds(hardness: float | ArrayLike, shape: tuple[int, int]) -> Array:
    """Hardness as an array of one value or of one per point, inf where there is no bound.

    Raises
    ------
    InputError : not a number or an array of the grid's shape, or values not > 0.
    """
    try:
        bounds = np.atleast_1d(np.asarray(hardness, dtype=float))
    except (TypeError, ValueError):
        raise InputError.of("hardness", repr(hardness), f"a number or an array {shape} [Pa]") from None
    if isinstance(hardness, (str, bytes)) or (bounds.size != 1 and bounds.shape != shape):
        given = repr(hardness) if bounds.size == 1 else f"shape {bounds.shape}"
        raise InputError.of("hardness", given, f"a number or an array {shape} [Pa]")
    if not np.all(bounds > 0):
        raise InputError.of("hardness", f"{bounds.min():g} Pa", "numbers > 0 [Pa]")
    return bounds


def _coarsen(a: Array) -> Array:
    """Means over 2×2 points; an odd last row or column stands for itself."""
    for axis in (0, 1):
        n = a.shape[axis]
        starts = np.arange(0, n, 2)
        sums = np.add.reduceat(a, starts, axis=axis)
        counts = np.minimum(2, n - starts)
        a = sums / (counts[:, None] if axis == 0 else counts[None, :])
    return a


def _bearing_area(gap0: Array, hardness: Array, pressure: float, half_space: HalfSpace) -> Array:
    """Uniform pressure on the highest points: on as many as a pressure of about E*·slope or H needs."""
    soft = min(float(hardness.mean()), 0.1 * half_space.modulus)
    n = int(np.clip(pressure / soft * gap0.size, min(4, gap0.size), gap0.size))
    touching = gap0 <= np.partition(gap0.ravel(), n - 1)[n - 1]
    return np.where(touching, pressure * gap0.size / touching.sum(), 0.0)


def _finish(
    p: Array, v: Array, delta: float, offset: float, bounds: Array, residual: float, iterations: int, pairs: int
) -> Contact:
    """Gap and permanent deformation from p, v = Kp + h₁ and δ; contact is exactly closed."""
    g = v - delta
    plastic = p >= bounds
    gap = np.where(p > 0, 0.0, np.maximum(g, 0.0))
    return Contact(
        pressure=p,
        gap=gap,
        plastic_deformation=np.where(plastic, np.maximum(-g, 0.0), 0.0),
        approach=delta + offset,
        residual=residual,
        iterations=iterations,
        fft_pairs=pairs,
        plastic=plastic,
    )


@lru_cache(maxsize=8)
def _grids(half_space: HalfSpace, thread: int) -> tuple[_Grid, ...]:
    """Workspaces from the given grid to the coarsest, kept per thread because their buffers are written to."""
    grids = [_Grid(half_space)]
    while min(half_space.shape) > _COARSEST:
        n1, n2 = half_space.shape
        d1, d2 = half_space.spacing
        half_space = replace(half_space, shape=((n1 + 1) // 2, (n2 + 1) // 2), spacing=(2 * d1, 2 * d2))
        grids.append(_Grid(half_space))
    return tuple(grids)


class _Grid:
    """Transform plans, preconditioner and work arrays of one grid."""

    def __init__(self, half_space: HalfSpace) -> None:
        self.half_space = half_space
        self.convolution = Convolution(half_space)
        n1, n2 = half_space.shape
        stencil = stiffness_stencil(half_space.spacing, half_space.modulus)
        r1, r2 = min(2, (n1 - 1) // 2), min(2, (n2 - 1) // 2)  # thin grids: not onto itself
        self.stencil = np.ascontiguousarray(stencil[2 - r1 : 3 + r1, 2 - r2 : 3 + r2])
        self.rows = _index_map(n1, r1, half_space.boundary[0])
        self.columns = _index_map(n2, r2, half_space.boundary[1])
        n = n1 * n2
        self.v, self.dense = np.zeros(n), np.zeros(n)
        self.state = np.zeros(n, np.int8)
        self.free = np.zeros(n, np.int64)
        self.bracket = np.zeros((2, n))
        self.small = np.zeros((4, n))
        # stiffness of a wave of four pixels: the step from gap to pressure
        spacings = [d for n, d in zip(half_space.shape, half_space.spacing, strict=True) if n > 1] or [
            min(half_space.spacing)
        ]
        self.stiffness = np.pi * half_space.modulus / (4 * float(np.prod(spacings) ** (1 / len(spacings))))

    def solve(
        self, gap0: Array, hardness: Array, pressure: float, start: Array, rtol: float, *, strict: bool
    ) -> Contact:
        """Solve from a start pressure; not `strict`: return what a few iterations reach."""
        conv, v, state, free, dense = self.convolution, self.v, self.state, self.free, self.dense
        p, d = conv.pressure.ravel(), conv.direction.ravel()
        h1 = np.ascontiguousarray(gap0).ravel()
        H = np.ascontiguousarray(hardness).ravel()
        hs = 0 if H.size == 1 else 1
        load = pressure * p.size
        conv.pairs = 0
        p[:] = np.minimum(start.ravel(), H if hs else H[0])
        loops.add_gap(conv.apply(conv.pressure).ravel(), h1, v)
        touching = p > 0
        delta = float(v[touching].mean()) if touching.any() else float(v.min())
        state[:] = -1
        c0 = c = self.stiffness
        c_min = c0 / (4 * max(self.half_space.shape))
        damping, last_energy, n_free, residual = 1.0, inf, 0, inf
        r, w, direction, ones = self.small
        ones_sum = rz_old = 1.0
        cg_steps = 0
        fresh = True
        limit = _MAX_ITERATIONS if strict else 40
        for iteration in range(limit + 1):
            delta = loops.root_of_load(p, v, c, H, hs, load, delta, self.bracket)
            r2, y2, changed = loops.count_changes(p, v, c, H, hs, delta, state)
            residual = float(np.sqrt(r2 / y2) * (c0 / c))
            converged = residual <= rtol
            if (converged and fresh) or iteration == limit:
                break
            if changed or converged or n_free < 2:
                loops.clear(free, n_free, d)
                loops.clear(free, n_free, dense)
                n_free = loops.project(p, v, c, H, hs, load, delta, state, free)
                loops.add_gap(conv.apply(conv.pressure).ravel(), h1, v)
                fresh = True
                now = float(loops.energy(p, v, h1))
                rose = now > last_energy + 1e-13 * abs(last_energy)
                damping = max(damping / 2, 1e-3) if rose else min(1.0, 1.25 * damping)
                last_energy = now
                if n_free < 2:
                    continue
                loops.free_residual(free, n_free, v, r)
                loops.scatter(free, n_free, np.ones(n_free), 0.0, dense)
                self._precondition(free, n_free, ones)
                ones_sum = loops.total(ones, n_free)
                direction[:n_free] = 0.0
                cg_steps = 0
                if converged:
                    continue  # judge the projected pressure by its own displacement
            largest, rz_start = c0, 0.0
            for k in range(3 if changed else 5):
                shift = loops.total(r, n_free) / n_free
                loops.scatter(free, n_free, r, shift, dense)
                self._precondition(free, n_free, w)
                rz = loops.project_and_dot(w, ones, loops.total(w, n_free) / ones_sum, r, n_free)
                if k == 0:
                    rz_start = rz
                if rz <= 0 or (k > 0 and rz < 0.04 * rz_start):
                    break
                loops.new_direction(free, n_free, w, direction, rz / rz_old if cg_steps else 0.0, d)
                rz_old = rz
                cg_steps += 1
                kd = conv.apply(conv.direction).ravel()
                d_kd, dd = loops.curvature(free, n_free, direction, kd)
                if not d_kd > 0:
                    break
                largest = min(largest, dd / d_kd)
                loops.step(free, n_free, rz / d_kd, direction, kd, p, r, v)
                fresh = False
            c = max(c_min, min(c0, 2 * damping * largest))
        loops.clear(free, n_free, d)
        loops.clear(free, n_free, dense)
        if strict and not abs(float(p.sum()) - load) <= 1e-9 * load:
            raise NotConverged(
                f"contact: the load is {p.sum() / load:.6g} of what was asked for; try another grid", residual
            )
        if strict and not residual <= rtol:
            raise NotConverged(
                f"contact: residual {residual:.1e} after {limit} iterations, wanted {rtol:.1e}; "
                "try a larger rtol, a filtered surface or a finer grid",
                residual,
            )
        shape = self.half_space.shape
        return _finish(
            p.reshape(shape).copy(), v.reshape(shape).copy(), delta, 0.0, hardness, residual, iteration, conv.pairs
        )

    def _precondition(self, free: NDArray[np.int64], n: int, out: Array) -> None:
        loops.stencil_product(free, n, self.dense, out, self.half_space.shape[1], self.stencil, self.rows, self.columns)


def _index_map(n: int, radius: int, boundary: str) -> NDArray[np.int64]:
    """Real index of each index −radius … n − 1 + radius; −1 where there is nothing."""
    i = np.arange(-radius, n + radius)
    if boundary == "periodic":
        return i % n
    if boundary == "mirror":
        return np.where(i < 0, -1 - i, np.where(i >= n, 2 * n - 1 - i, i))
    return np.where((i < 0) | (i >= n), -1, i)

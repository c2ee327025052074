"""Contact by steps that never raise the energy, for problems in which active sets go round in circles.

Each iteration makes one step along the projected gradient, of the length of Barzilai and Borwein, which decides which
points are free, and then conjugate gradients on the free points; a point that reaches a bound stays there, and the
directions begin anew. The energy ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ψ(p), ψ = ½ Σ (p − H)₊²/h where points harden, falls with every
step and the load is kept.
Sources: Moré & Toraldo, SIAM J. Optim. 1, 1991, 93; Birgin, Martínez & Raydan, SIAM J. Optim. 10, 2000, 1196.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base import Array
from .gradient_steps import apply_stencil
from .projection import root
from .workspace import Problem, Workspace

#: Steps of conjugate gradients in an iteration, and the fraction of the first w·r at which they stop.
_STEPS, _DROP = 25, 1e-3


class Solution(NamedTuple):
    """Solution of a contact problem on one grid, whose pressure and v the grid holds.

    delta : approach δ less the offset [m]. residual : ‖p − y‖/‖y‖. iterations, products : their numbers.
    """

    delta: float
    residual: float
    iterations: int
    products: int


class _Law(NamedTuple):
    """Law of every point (n,): H [Pa], h [Pa/m], largest pressure [Pa], and 1/h of points that harden, else 0."""

    hardness: Array
    slope: Array
    limit: Array
    compliance: Array

    def energy(self, p: Array) -> float:
        """ψ(p), what the law adds to the energy."""
        return float(0.5 * self.compliance @ np.maximum(p - self.hardness, 0.0) ** 2)


def descend(grid: Workspace, problem: Problem, delta: float, rtol: float, limit: int) -> Solution:
    """Solve a contact problem from a pressure that lies within the bounds and carries the load.

    Parameters
    ----------
    grid : with the initial pressure.
    problem : gap, law and load.
    delta : first guess of the approach less the offset [m].
    rtol : residual to reach.
    limit : most iterations.
    """
    p, c0 = grid.arrays.p, grid.stiffness
    slope = np.broadcast_to(problem.slope, p.shape)
    hardness = np.broadcast_to(problem.hardness, p.shape)
    law = _Law(
        hardness,
        slope,
        np.where(slope > 0, np.inf, hardness),
        np.divide(1.0, slope, out=np.zeros(p.size), where=slope > 0),
    )
    c, products, iterations = c0, 0, 0
    while True:
        # a copy, as the products of directions take the memory of the displacement
        v = grid.displacement().ravel() + (problem.gap0 - problem.offset)
        products += 1
        delta, y = _projected(p, v, c0, delta, problem, law)
        if y.any():
            residual = float(np.linalg.norm(y - p) / np.linalg.norm(y))
        else:
            residual = np.inf if p.any() else 0.0
        if residual <= rtol or iterations == limit:
            grid.arrays.respond.displacement[:] = v.reshape(grid.pressure.shape)
            return Solution(delta, residual, iterations, products)
        iterations += 1
        c = _gradient_step(grid, p, v, c, delta, problem, law)
        products += 1 + _face_steps(grid, p, v, delta, law)


def _projected(
    p: Array, v: Array, c: float, delta: float, problem: Problem, law: _Law
) -> tuple[float, Array]:
    """δ that carries the load, and y, the projection of p − c (v − δ) on the law."""
    x = p - c * v
    every = np.arange(p.size, dtype=np.int32)
    delta, _ = root(x, x.size, problem.hardness, problem.slope, c, every, c, problem.load, delta)
    z = x + c * delta
    beyond = np.maximum(z - law.hardness, 0.0)
    return delta, np.clip(z, 0.0, law.hardness) + law.slope / (law.slope + c) * beyond


def _gradient_step(
    grid: Workspace, p: Array, v: Array, c: float, delta: float, problem: Problem, law: _Law
) -> float:
    """Step to y or to the lowest energy on the way; returns the length of the next such step."""
    delta, y = _projected(p, v, c, delta, problem, law)
    d = y - p
    response = grid.response(d)
    curvature = float(d @ response)
    fall = float(d @ (v - delta)) + law.energy(y) - law.energy(p)
    if not (fall < 0 and curvature > 0):
        return grid.stiffness
    fraction = min(1.0, -fall / curvature)
    p += fraction * d
    np.clip(p, 0.0, law.limit, out=p)
    v += fraction * response
    return float(d @ d) / curvature


def _face_steps(grid: Workspace, p: Array, v: Array, delta: float, law: _Law) -> int:
    """Conjugate gradients on the free points, up to the first bound that is met, and on from there.

    The bounds of an elastic point are 0 and H, those of one that yields on a slope are H and inf. Returns the number
    of products.
    """
    first, former = 0.0, np.inf
    for step in range(_STEPS):
        if former == np.inf:
            yields = (p > law.hardness) & (law.slope > 0)
            free = np.flatnonzero(((p > 0) & (p < law.hardness)) | yields).astype(np.int32)
            if free.size < 2:
                return step
            low = np.where(yields, law.hardness, 0.0)[free]
            high = np.where(yields, np.inf, law.hardness)[free]
            soft = np.where(yields, law.compliance, 0.0)[free]
            scale = 1.0 / np.sqrt(1.0 + soft * grid.weights.max())
            ones = _preconditioned(grid, free, np.ones(free.size), scale)
            d = np.zeros(free.size)
        r = delta - v[free] - soft * np.maximum(p[free] - law.hardness[free], 0.0)
        r -= r.mean()
        w = _preconditioned(grid, free, r, scale)
        w -= w.sum() / ones.sum() * ones
        wr = float(w @ r)
        first = first or wr
        if not wr > _DROP * first * (step > 0):
            return step
        d = w + wr / former * d
        dense = np.zeros_like(p)
        dense[free] = d
        response = grid.response(dense)
        curvature = float(d @ response[free] + d @ (soft * d))
        if not curvature > 0:
            return step + 1
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(
                d > 0, (high - p[free]) / d, np.where(d < 0, (low - p[free]) / d, np.inf)
            )
        nearest = int(room.argmin())
        fraction = min(wr / curvature, float(room[nearest]))
        former = wr
        p[free] = np.clip(p[free] + fraction * d, low, high)
        v += fraction * response
        if fraction == room[nearest]:
            p[free[nearest]] = high[nearest] if d[nearest] > 0 else low[nearest]
            former = np.inf
    return _STEPS


def _preconditioned(grid: Workspace, free: NDArray[np.int32], values: Array, scale: Array) -> Array:
    """s M s of values on the free points, s = 1 where the law does not harden."""
    out = np.empty(free.size)
    dense = grid.arrays.dense
    dense[:] = 0
    dense[free] = values * scale
    apply_stencil(free, dense, out, grid.weights, grid.arrays.rows, grid.arrays.columns)
    return out * scale

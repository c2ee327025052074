"""Solve a contact by steps that never raise the energy, for problems whose active sets repeat themselves.

Each iteration first makes a step along the projected gradient, with the length of Barzilai and Borwein, which decides
which points are free. Steps of conjugate gradients on the free points follow. A point that reaches a bound stays there,
and the directions start again. The energy is ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ψ(p), where ψ = ½ Σ (p − H)₊²/h if points harden. It
falls with every step, while the load remains constant.
Sources: Moré & Toraldo, SIAM J. Optim. 1, 1991, 93; Birgin, Martínez & Raydan, SIAM J. Optim. 10, 2000, 1196.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base import Array
from .gradient_steps import apply_stencil
from .projection import root
from .workspace import Problem, Workspace

#: Most steps of conjugate gradients in an iteration.
_STEPS = 25
#: Fraction of the first w·r at which these steps stop.
_DROP = 1e-3


class Solution(NamedTuple):
    """Solution of a contact problem on one grid; its pressure and v are in the memory of the grid.

    delta : approach δ minus the offset [m]. residual : ‖p − y‖/‖y‖. iterations : number of iterations. products :
    number of products with K.
    """

    delta: float
    residual: float
    iterations: int
    products: int


class _Law(NamedTuple):
    """Straight law of every point, as arrays (n,).

    hardness : H [Pa]. slope : h [Pa/m]. limit : largest pressure [Pa]. compliance : 1/h of points that harden [m/Pa],
    0 of others.
    """

    hardness: Array
    slope: Array
    limit: Array
    compliance: Array

    def energy(self, p: Array) -> float:
        """Compute the part ψ(p) of the energy that comes from the law."""
        return float(0.5 * self.compliance @ np.maximum(p - self.hardness, 0.0) ** 2)


def descend(grid: Workspace, problem: Problem, delta: float, rtol: float, limit: int) -> Solution:
    """Solve a contact problem, starting from a pressure that is within the bounds and carries the load.

    Parameters
    ----------
    grid : Workspace
        Grid with the initial pressure, which is replaced by the solution.
    problem : Problem
        Gap, law and load.
    delta : float
        First guess of the approach minus the offset [m].
    rtol : float
        Residual to reach.
    limit : int
        Most iterations.

    Returns
    -------
    Solution
    """
    p = grid.arrays.p
    c0 = grid.stiffness
    slope = np.broadcast_to(problem.slope, p.shape)
    hardness = np.broadcast_to(problem.hardness, p.shape)
    law = _Law(
        hardness=hardness,
        slope=slope,
        limit=np.where(slope > 0, np.inf, hardness),
        compliance=np.divide(1.0, slope, out=np.zeros(p.size), where=slope > 0),
    )
    c = c0
    products = 0
    iterations = 0
    while True:
        # a copy, because products with directions use the memory of the displacement
        v = grid.displacement().ravel() + (problem.gap0 - problem.offset)
        products += 1
        delta, y = _project(p, v, c0, delta, problem, law)
        if y.any():
            residual = float(np.linalg.norm(y - p) / np.linalg.norm(y))
        else:
            residual = np.inf if p.any() else 0.0
        if residual <= rtol or iterations == limit:
            grid.arrays.respond.displacement[:] = v.reshape(grid.pressure.shape)
            return Solution(delta, residual, iterations, products)
        iterations += 1
        c = _gradient_step(grid, p, v, c, delta, problem, law)
        products += 1 + _free_point_steps(grid, p, v, delta, law)


def _project(
    p: Array, v: Array, c: float, delta: float, problem: Problem, law: _Law
) -> tuple[float, Array]:
    """Find the δ that carries the load, and the projection y of p − c (v − δ) on the law (n,).

    delta : first guess of δ [m].
    """
    x = p - c * v
    all_points = np.arange(p.size, dtype=np.int32)
    hardness, slope = problem.hardness, problem.slope
    delta, _ = root(x, x.size, hardness, slope, c, all_points, c, problem.load, delta)
    z = x + c * delta
    excess = np.maximum(z - law.hardness, 0.0)
    return delta, np.clip(z, 0.0, law.hardness) + law.slope / (law.slope + c) * excess


def _gradient_step(
    grid: Workspace, p: Array, v: Array, c: float, delta: float, problem: Problem, law: _Law
) -> float:
    """Move p (n,) towards its projection y, to the lowest energy on the way; return the length c of the next step.

    v (n,) is updated with p.
    """
    delta, y = _project(p, v, c, delta, problem, law)
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


def _free_point_steps(grid: Workspace, p: Array, v: Array, delta: float, law: _Law) -> int:
    """Make steps of conjugate gradients on the free points; return the number of products with K.

    A step ends at the first bound that it reaches, and the directions start again from there. The bounds of an elastic
    point are 0 and H; those of a point that yields and hardens are H and infinity. p and v (n,) are updated.
    """
    first, former = (
        0.0,
        np.inf,
    )  # w·r of the first and of the former direction; inf: there is no former one
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
    """Apply the scaled preconditioner s M s to values on the free points; s is 1 where the law does not harden."""
    out = np.empty(free.size)
    dense = grid.arrays.dense
    dense[:] = 0
    dense[free] = values * scale
    apply_stencil(free, dense, out, grid.weights, grid.arrays.rows, grid.arrays.columns)
    return out * scale

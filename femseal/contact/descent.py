"""Solve a contact by steps that never increase the energy, for problems in which the active sets cycle.

Each iteration begins with a step along the projected gradient with the Barzilai-Borwein length, which determines the
free points. Steps of conjugate gradients on the free points follow. If a point reaches a bound, it stays there, and the
conjugate gradients are restarted. The energy is ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ψ(p), with ψ = ½ Σ (p − H)₊²/h for points that
harden. It decreases with each step, and the load remains constant.
Sources: Moré & Toraldo, SIAM J. Optim. 1, 1991, 93; Birgin, Martínez & Raydan, SIAM J. Optim. 10, 2000, 1196.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base import Array
from .gradient_steps import apply_stencil
from .projection import root
from .workspace import Problem, Workspace

#: Largest number of steps of conjugate gradients in an iteration.
_STEPS = 25
#: Fraction of the initial w·r at which these steps end.
_DROP = 1e-3


class Solution(NamedTuple):
    """Solution of a contact problem on one grid. Pressure and v are stored in the workspace of the grid.

    delta : approach δ minus the offset of the heights [m].
    residual : residual ‖p − y‖/‖y‖.
    iterations : number of iterations.
    products : number of products with K.
    """

    delta: float
    residual: float
    iterations: int
    products: int


class _Law(NamedTuple):
    """Linear contact law of each point, as arrays (n,).

    hardness : hardness H [Pa].
    slope : hardening modulus h [Pa/m].
    limit : largest pressure [Pa]; infinite for points that harden.
    compliance : 1/h [m/Pa] of points that harden, and 0 for all others.
    """

    hardness: Array
    slope: Array
    limit: Array
    compliance: Array

    def energy(self, p: Array) -> float:
        """Compute the contribution ψ(p) of hardening to the energy."""
        return float(0.5 * self.compliance @ np.maximum(p - self.hardness, 0.0) ** 2)


def descend(grid: Workspace, problem: Problem, delta: float, rtol: float, limit: int) -> Solution:
    """Solve a contact problem, beginning with a pressure that is within the bounds and carries the load.

    Parameters
    ----------
    grid : Workspace
        Workspace of the grid with the initial pressure, which the solution replaces.
    problem : Problem
        Gap, law and load.
    delta : float
        First guess of the approach minus the offset of the heights [m].
    rtol : float
        Target residual.
    limit : int
        Largest number of iterations.

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
    """Compute the projection y (n,) of p − c (v − δ) on the law, with the δ for which y carries the load.

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
    """Move p towards its projection y, to the point of lowest energy on this line, and update v.

    Returns the length c of the next step.
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
    """Perform steps of conjugate gradients on the free points, and update p and v (n,).

    A step ends at the first bound that a point reaches; the conjugate gradients are then restarted without this point.
    The bounds of an elastic point are 0 and H, and the bounds of a point that hardens are H and infinity.

    Returns the number of products with K.
    """
    first = 0.0  # w·r of the first direction
    former = np.inf  # w·r of the previous direction; infinite for a restart
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

"""Solve a contact by steps that never increase the energy; used if the active sets keep cycling.

Each iteration begins with a projected-gradient step of Barzilai-Borwein length. The gradient step determines which
points are free. Conjugate gradients on the free points follow; they ignore the bounds of the pressure. Their result is
then projected onto the bounds. Finally, the pressure is moved towards the projected pressure as far as the energy
decreases.

The load remains constant, and the energy ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ψ(p) decreases with each step. The term ψ is the sum of
½ (p − H)₊²/h over the points that harden.

Sources: Moré & Toraldo, SIAM J. Optim. 1, 1991, 93; Birgin, Martínez & Raydan, SIAM J. Optim. 10, 2000, 1196.
"""

from typing import NamedTuple

import numpy as np

from ..base import Array, Flags, Indices
from .approach import find_approach
from .conjugate_gradients import StepLimits, conjugate_gradients
from .point_arrays import ELASTIC, HARDENING
from .workspace import Loops, Problem, Workspace

#: Limits of the conjugate-gradient steps in an iteration.
_STEPS = StepLimits(25, 1e-3)
#: Number of halvings of the range in which a uniform pressure is sought that restores the load.
_HALVINGS = 60


class Solution(NamedTuple):
    """Data of a solution on one grid. The pressure p and v = Kp + h₁ remain in the workspace of the grid.

    delta : approach δ, measured from the offset of the heights [m].
    residual : residual ‖p − y‖/‖y‖.
    iterations : number of iterations.
    products : number of products of K with a pressure.
    """

    delta: float
    residual: float
    iterations: int
    products: int

    def after(self, iterations: int, products: int) -> "Solution":
        """Add the numbers of iterations and products that had been necessary before."""
        return self._replace(
            iterations=iterations + self.iterations, products=products + self.products
        )


class _Law(NamedTuple):
    """Linear contact law of each point, as arrays (n,).

    hardness : hardness H [Pa].
    slope : hardening modulus h [Pa/m].
    limit : largest pressure [Pa], which is H for perfectly plastic points and infinite for points that can harden.
    compliance : compliance [m/Pa], which is 0 for perfectly plastic points and 1/h for points that can harden.
    """

    hardness: Array
    slope: Array
    limit: Array
    compliance: Array

    def energy(self, p: Array) -> float:
        """Compute ψ(p), the part of the energy that depends on the contact law: the sum of ½ (p − H)₊²/h."""
        return float(0.5 * self.compliance @ np.maximum(p - self.hardness, 0.0) ** 2)


def descend(grid: Workspace, problem: Problem, delta: float, rtol: float, limit: int) -> Solution:
    """Solve a contact problem, starting from a pressure that is within the bounds and carries the load.

    Parameters
    ----------
    grid : Workspace
        Grid with the initial pressure, which is replaced by the solution.
    problem : Problem
        Undeformed gap, contact law and load.
    delta : float
        First guess of the approach, measured from the offset of the heights [m].
    rtol : float
        Target residual.
    limit : int
        Largest number of iterations.

    Returns
    -------
    Solution
    """
    p = grid.points.p
    loops = grid.loops(problem)
    c0 = grid.stiffness
    slope = np.broadcast_to(problem.law.slope, p.shape)
    hardness = np.broadcast_to(problem.law.hardness, p.shape)
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
        products += 1 + _free_point_step(grid, loops, p, v, delta, law)


def _project(
    p: Array, v: Array, c: float, delta: float, problem: Problem, law: _Law
) -> tuple[float, Array]:
    """Project trial pressures onto the contact law, choosing the approach δ such that the result carries the load.

    The trial pressure of a point is z = p − c (v − δ). Here p is the pressure, v the displacement plus undeformed gap,
    and c the stiffness. The projected pressure is y = 0 for z < 0, y = z for z between 0 and the hardness H, and y = H
    + t (z − H) for larger z, with t = h/(h + c) and the hardening modulus h.

    Parameters
    ----------
    p, v : array (n,)
        Pressure [Pa], and displacement plus undeformed gap [m].
    c : float
        Stiffness [Pa/m].
    delta : float
        First guess of δ [m].
    problem : Problem
        Contact problem, with H and h as arrays of one value or of one value for each point.
    law : _Law
        Hardness H and hardening modulus h of the problem, with one value for each point of p.

    Returns
    -------
    float, array (n,)
        Approach δ [m], and projected pressures y [Pa].
    """
    x = p - c * v
    all_points = np.arange(p.size, dtype=np.int32)
    # c is both the step length of the projection and the factor of δ
    delta, _ = find_approach(x, x.size, problem.law, c, all_points, c, problem.load, delta)
    z = x + c * delta  # trial pressure
    above_hardness = np.maximum(z - law.hardness, 0.0)
    t = law.slope / (law.slope + c)
    return delta, np.clip(z, 0.0, law.hardness) + t * above_hardness


def _gradient_step(
    grid: Workspace, p: Array, v: Array, c: float, delta: float, problem: Problem, law: _Law
) -> float:
    """Move p (n,) towards the projected pressure y until the energy is lowest; return the length c of the next step.

    The displacement plus undeformed gap v (n,) is updated for the new pressure.
    """
    delta, y = _project(p, v, c, delta, problem, law)
    d = y - p
    curvature = _move(grid, p, v, d, delta, law)
    return float(d @ d) / curvature if curvature > 0 else grid.stiffness


def _move(grid: Workspace, p: Array, v: Array, d: Array, delta: float, law: _Law) -> float:
    """Move p (n,) along d (n,) to the lowest energy, but not beyond p + d; return d·Kd.

    The pressure p + d is within the bounds and carries the load. If the energy does not fall along d, p is left
    unchanged and 0 is returned. With hardening, the position of the minimum is only estimated. Because the energy is
    convex, it is nevertheless lower there than at p. The displacement plus undeformed gap v (n,) is updated for the new
    pressure.
    """
    # For 0 <= t <= 1, the energy at p + t d exceeds the energy at p by at most t · change + ½ t² d·Kd, because ψ is
    # convex. The bound is lowest at t = −change/(d·Kd).
    response = grid.response(d)
    curvature = float(d @ response)
    change = float(d @ (v - delta)) + law.energy(p + d) - law.energy(p)
    if not (change < 0 and curvature > 0):
        return 0.0
    fraction = min(1.0, -change / curvature)
    p += fraction * d
    np.clip(p, 0.0, law.limit, out=p)
    v += fraction * response
    return curvature


def _free_point_step(
    grid: Workspace, loops: Loops, p: Array, v: Array, delta: float, law: _Law
) -> int:
    """Change the pressures of the free points so that the energy falls; return the number of products with K.

    Conjugate gradients yield a target pressure, ignoring the bounds. This target is projected onto the pressures that
    satisfy the bounds and carry the load, and p is moved towards the projection. If the energy does not fall in that
    direction, p is moved towards the original target instead, until a point reaches one of its bounds. p and v (n,) are
    updated.
    """
    yields = (p > law.hardness) & (law.slope > 0)
    is_elastic = (p > 0) & (p < law.hardness)
    n_free = _list_free_points(grid, loops, v, is_elastic, yields)
    if n_free < 2:
        return 0
    products = conjugate_gradients(loops, p.size, n_free, delta, _STEPS).steps
    if products == 0:
        return 0
    free: Indices = grid.free.index[:n_free]
    # bounds of the pressure: 0 and H for an elastic point, H and infinity for a point that hardens
    low = np.where(yields, law.hardness, 0.0)[free]
    high = np.where(yields, np.inf, law.hardness)[free]
    step = grid.near.p[free] - p[free]  # all points are listed as near contact
    response = grid.near.v - v
    d = np.zeros(p.size)
    d[free] = _within_bounds(p[free] + step, low, high, float(p[free].sum())) - p[free]
    if _move(grid, p, v, d, delta, law) > 0:
        return products + 1
    # fraction of the step at which each point meets one of its bounds
    with np.errstate(divide="ignore", invalid="ignore"):
        to_bound = np.where(step > 0, (high - p[free]) / step, (low - p[free]) / step)
    to_bound[step == 0] = np.inf
    nearest = int(to_bound.argmin())
    fraction = min(1.0, float(to_bound[nearest]))
    p[free] = np.clip(p[free] + fraction * step, low, high)
    v += fraction * response
    if fraction == to_bound[nearest]:
        # set the nearest point to its bound exactly, without a rounding error
        p[free[nearest]] = high[nearest] if step[nearest] > 0 else low[nearest]
    return products + 1


def _list_free_points(
    grid: Workspace, loops: Loops, v: Array, is_elastic: Flags, yields: Flags
) -> int:
    """List all points as near contact, and those that are elastic or harden as free; return the number of free points.

    v : displacement plus undeformed gap [m], (n,).
    """
    grid.points.dense[:] = 0
    grid.points.state[:] = ELASTIC * is_elastic + HARDENING * yields
    grid.arrays.respond.displacement[:] = v.reshape(grid.pressure.shape)
    _n_near, n_free, *_sums = loops.list_near(1.0, 0.0, np.inf, 0, len(grid.points.v))
    return int(n_free)


def _within_bounds(target: Array, low: Array, high: Array, load: float) -> Array:
    """Find the pressures (n,) that are nearest to a target (n,), lie between their bounds, and add up to the load.

    The pressures are clip(target + shift, low, high). Bisection finds the shift for which the pressures add up to the
    load.
    """
    # no shifted target is positive with the lower shift, and none is negative with the upper shift
    largest = float(np.max(np.abs(target)))
    lower, upper = -largest, largest
    for _ in range(_HALVINGS):
        shift = (lower + upper) / 2
        if float(np.clip(target + shift, low, high).sum()) < load:
            lower = shift
        else:
            upper = shift
    return np.clip(target + (lower + upper) / 2, low, high)

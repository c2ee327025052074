"""Two-sided bounds of the flow through a cell whose gap is constant on each pixel.

Lower: complementary energy of a conservative flux, lowest-order Raviart-Thomas. Upper: Dirichlet energy of a conforming
pressure, Q1 on the corners of pixels. Source: Thomson's and Dirichlet's principles.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import ElementQuadRT0

from ..base import Array, NotConverged
from . import forms
from .assembly import Sample, assemble_on_elements, elemental, gauss
from .balance import balanced_link_fluxes
from .grid import Grid
from .law import cubic_law
from .percolation import nodes_reached, restricted
from .solution import FIELD_RTOL
from .solvers.amg import solve_direct
from .solvers.choice import solve_flow
from .solvers.coarsest import coarsest_nodes
from .solvers.multigrid import COARSEST_NODES, solve_multigrid
from .stencil import Stencil

#: Relative error of the upper bound; iterations allowed before factorising.
_RTOL, _ITERATIONS = 1e-12, 60
#: Fraction by which bounds are moved apart.
_ROUNDING = 1e-13
#: Component K11 at the two ends of a pixel: the mixed form then decouples the two fluxes, and a link
#: between two pixels has their harmonic mean.
_LUMPED = (Sample((0.0, 0.5), 0.5, (0, 0)), Sample((1.0, 0.5), 0.5, (0, 0)))
#: Facets of a pixel at its two ends along x1, in the order of `elemental`.
_ENDS = np.ix_([0, 3], [0, 3])


def pixel_bounds(gap: Array, spacing: tuple[float, float], sides: str, solver: str = "auto") -> tuple[float, float]:
    """Lower and upper bound of the flow for a unit drop along x1 [unit of h³]; both 0 where all is closed.

    Pixels that share only a corner are connected in the upper bound, and not in the lower one.
    """
    k = cubic_law(gap)
    lower, potential = lower_bound(k, spacing, sides == "periodic", solver)
    return outward(lower, _upper(k, spacing, sides, potential))


def outward(lower: float, upper: float) -> tuple[float, float]:
    """Bounds that hold with the rounding errors of their own sums, measured up to 3e-14 of them."""
    return lower * (1 - _ROUNDING), upper * (1 + _ROUNDING)


def flux_energy() -> Array:
    """Energy (2, 2) of unit fluxes along x1 through the two ends of a unit pixel of K = 1: from the mixed form."""
    local = elemental(forms.flux_resistance, ElementQuadRT0, gauss((0, 0)), "resistance").sum(axis=0)[_ENDS]
    return _along(local)


def half_resistance() -> float:
    """Resistance of a unit pixel of K = 1 from its centre to one end: from the mixed form, lumped."""
    local = _along(elemental(forms.flux_resistance, ElementQuadRT0, _LUMPED, "resistance").sum(axis=0)[_ENDS])
    return float(local[0, 0])


def _along(local: Array) -> Array:
    """Orient both basis functions along +x1: a uniform flux then has more energy than one that changes its sign."""
    return local if local.sum() > np.trace(local) else local * np.array([[1.0, -1.0], [-1.0, 1.0]])


def lower_bound(k: Array, spacing: tuple[float, float], ring: bool, solver: str = "auto") -> tuple[float, Array]:
    """The lower bound for a permeability k (n1, n2) constant on each pixel, and the potential that it comes from."""
    d1, d2 = spacing
    with np.errstate(divide="ignore"):
        half = half_resistance() / k
    neighbour = np.roll(half, -1, axis=1) if ring else half[:, 1:]
    here = half if ring else half[:, :-1]
    c1 = 1 / np.concatenate([half[:1], half[:-1] + half[1:], half[-1:]]) * (d2 / d1)
    c2 = 1 / (here + neighbour) * (d1 / d2)
    if ring and k.shape[1] == 1:
        c2 = np.zeros_like(c2)
    stencil = Stencil(c1, c2, ring2=ring)
    flow = solve_flow(stencil, solver=solver, field_rtol=FIELD_RTOL)
    if not flow.percolates:
        return 0.0, flow.potential[1:-1]
    q1, q2 = balanced_link_fluxes(stencil, np.nan_to_num(flow.potential), np.nan_to_num(flow.complement))
    closed = np.zeros((k.shape[0], 0 if ring else 1))
    west, east = np.hstack([closed, q2]), np.hstack([q2, closed])
    if ring:
        west = np.roll(q2, 1, axis=1)
    (same, other), _ = flux_energy()

    def energy(before: Array, after: Array, ratio: float) -> Array:
        return (same * (before**2 + after**2) + 2 * other * before * after) * ratio

    with np.errstate(divide="ignore", invalid="ignore"):
        dissipated = energy(q1[:-1], q1[1:], d1 / d2) + energy(west, east, d2 / d1)
        total = np.where(k > 0, dissipated / k, 0.0).sum()
    bound = min(abs(q1[0].sum()), abs(q1[-1].sum())) ** 2 / total if total > 0 else 0.0
    return float(bound), flow.potential[1:-1]


def _upper(k: Array, spacing: tuple[float, float], sides: str, potential: Array) -> float:
    """Upper bound from the energy of a pressure; any pressure gives a bound, the exact one the lowest."""
    grid = Grid.of_pixel_corners(k.shape, spacing, sides)
    stencil = assemble_on_elements(grid, [k], gauss((0, 0), (1, 1)), [0] * 8)
    keep = nodes_reached(stencil) == 3
    if not keep.any():
        return 0.0
    stencil = restricted(stencil, keep)
    n1, columns = stencil.along.shape

    def energy(inner: Array) -> float:
        p = np.zeros(keep.shape)
        p[0] = keep[0]
        p[1:-1] = np.where(keep[1:-1], inner, 0.0)  # corners that carry no flow have the pressure 0
        return stencil.energy(p)

    if n1 == 1:
        return energy(np.zeros((0, columns)))
    if coarsest_nodes(n1 - 1, columns) <= COARSEST_NODES:
        try:
            return energy(solve_multigrid(stencil, _RTOL, _ITERATIONS)[0][1:-1])
        except NotConverged:
            pass
    fallen = np.cumsum(1 / k.sum(axis=1))  # of a pressure that is the same along each row
    rows = np.repeat(1 - fallen[:-1, None] / fallen[-1], columns, axis=1)
    candidates = [_mean_at_corners(k, potential, sides == "periodic")[1:-1], rows]
    try:
        p = _factorised(stencil, keep)
        candidates += [p, np.clip(p, 0.0, 1.0)]
    except NotConverged:
        pass
    return min(energy(p) for p in candidates)


def _mean_at_corners(k: Array, potential: Array, ring: bool) -> Array:
    """Mean potential of the pixels around each corner, weighted with their permeability."""
    sides: Any = "wrap" if ring else "constant"
    weight, value = (np.pad(np.pad(a, ((1, 1), (0, 0))), ((0, 0), (1, 1)), mode=sides)
                     for a in (k, k * np.nan_to_num(potential)))  # fmt: skip
    weight, value = (a[:-1, :-1] + a[:-1, 1:] + a[1:, :-1] + a[1:, 1:] for a in (weight, value))
    mean = np.divide(value, weight, out=np.zeros_like(value), where=weight > 0)
    return mean[:, :-1] if ring else mean


def _factorised(stencil: Stencil, keep: NDArray[np.bool_]) -> Array:
    """Pressure at the inner nodes by a sparse factorisation, whatever its residual; 0 where it is not finite."""
    columns = keep.shape[1]
    unknown = keep.ravel().copy()
    unknown[:columns] = unknown[-columns:] = False
    p = np.zeros(keep.size)
    p[:columns] = keep[0]
    if unknown.any():
        rows = stencil.to_csr()[np.flatnonzero(unknown)]
        p[unknown] = solve_direct(rows[:, np.flatnonzero(unknown)], -(rows @ p), largest_residual=np.inf).x
    return np.nan_to_num(p).reshape(keep.shape)[1:-1]

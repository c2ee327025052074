"""Two-sided bounds of the flow through a cell whose gap is constant on each pixel.

Lower: complementary energy of a conservative flux, lowest-order Raviart-Thomas. Upper: Dirichlet energy of a conforming
pressure, P1 on triangles between the corners of pixels. Source: Thomson's and Dirichlet's principles.
"""

from __future__ import annotations

import numpy as np
from skfem import ElementQuadRT0

from ..base import Array
from . import forms
from .balance import balanced_link_fluxes
from .grid import Grid, Sample, Stencil, assemble_on_links, elemental
from .law import cubic_law
from .solution import FIELD_RTOL
from .solvers.choice import solve_flow

#: What the upper bound may exceed the least energy by, relative to it.
_RTOL = 1e-9
#: Fraction by which bounds are moved apart.
_ROUNDING = 1e-13
#: Component K11 at two Gauss points along x1, which is exact where K is constant.
_GAUSS = tuple(Sample((0.5 + side / np.sqrt(12), 0.5), 0.5, 0) for side in (-1, 1))
#: Component K11 at the two ends of a pixel: the mixed form then decouples the two fluxes, and a link
#: between two pixels has their harmonic mean.
_LUMPED = (Sample((0.0, 0.5), 0.5, 0), Sample((1.0, 0.5), 0.5, 0))


def pixel_bounds(
    gap: Array, spacing: tuple[float, float], sides: str, solver: str = "auto"
) -> tuple[float, float]:
    """Lower and upper bound of the flow for a unit drop along x1 [unit of h³]; both 0 where all is closed.

    Pixels that share only a corner are connected in the upper bound, and not in the lower one.
    """
    k = cubic_law(gap)
    lower = lower_bound(k, spacing, sides == "periodic", solver)
    return outward(lower, upper_bound(k, spacing, sides, solver))


def outward(lower: float, upper: float) -> tuple[float, float]:
    """Bounds that hold with the rounding errors of their own sums, measured up to 3e-14 of them."""
    return lower * (1 - _ROUNDING), upper * (1 + _ROUNDING)


def flux_energy(samples: tuple[Sample, ...]) -> Array:
    """Energy (2, 2) of unit fluxes along x1 through the two ends of a unit pixel of K = 1: from the mixed form."""
    local = elemental(forms.flux_resistance, ElementQuadRT0, samples, "resistance").sum(axis=0)
    ends = local[np.ix_([0, 3], [0, 3])]
    # both along +x1: a uniform flux then has more energy than one that changes its sign
    return ends if ends.sum() > np.trace(ends) else ends * np.array([[1.0, -1.0], [-1.0, 1.0]])


def lower_bound(k: Array, spacing: tuple[float, float], ring: bool, solver: str = "auto") -> float:
    """The lower bound for a permeability k (n1, n2) constant on each pixel."""
    d1, d2 = spacing
    with np.errstate(divide="ignore"):
        half = flux_energy(_LUMPED)[0, 0] / k  # resistance from the centre to one end
    neighbour = np.roll(half, -1, axis=1) if ring else half[:, 1:]
    here = half if ring else half[:, :-1]
    c1 = 1 / np.concatenate([half[:1], half[:-1] + half[1:], half[-1:]]) * (d2 / d1)
    c2 = 1 / (here + neighbour) * (d1 / d2)
    if ring and k.shape[1] == 1:
        c2 = np.zeros_like(c2)
    stencil = Stencil(c1, c2, ring2=ring)
    flow = solve_flow(stencil, solver=solver, field_rtol=FIELD_RTOL)
    if not flow.percolates:
        return 0.0
    q1, q2 = balanced_link_fluxes(
        stencil, np.nan_to_num(flow.potential), np.nan_to_num(flow.complement)
    )
    closed = np.zeros((k.shape[0], 0 if ring else 1))
    west, east = np.hstack([closed, q2]), np.hstack([q2, closed])
    if ring:
        west = np.roll(q2, 1, axis=1)
    (same, other), _ = flux_energy(_GAUSS)

    def energy(before: Array, after: Array, ratio: float) -> Array:
        return (same * (before**2 + after**2) + 2 * other * before * after) * ratio

    with np.errstate(divide="ignore", invalid="ignore"):
        dissipated = energy(q1[:-1], q1[1:], d1 / d2) + energy(west, east, d2 / d1)
        total = np.where(k > 0, dissipated / k, 0.0).sum()
    return float(min(abs(q1[0].sum()), abs(q1[-1].sum())) ** 2 / total) if total > 0 else 0.0


def upper_bound(k: Array, spacing: tuple[float, float], sides: str, solver: str = "auto") -> float:
    """The upper bound for a permeability k (n1, n2) constant on each pixel.

    A pixel of linear elements is two right triangles: the energy of a leg has the K of its own, half of the pixel.
    """
    grid = Grid.of_pixel_corners(k.shape, spacing, sides)
    beside = (
        np.pad(k, ((0, 0), (1, 1)), mode="edge")
        if sides == "mirror"
        else np.pad(k, ((0, 0), (1, 0)), mode="wrap")
    )
    stencil = assemble_on_links(grid, (beside[:, :-1] + beside[:, 1:]) / 2, (k[:-1] + k[1:]) / 2)
    return solve_flow(stencil, rtol=_RTOL, solver=solver).conductance

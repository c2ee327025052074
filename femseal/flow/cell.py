"""Flow through a cell: its permeability follows from its gap, by ∇·(K ∇p) = 0 with K = h³/12 or another flow law.

The discrete problem is that of `flow.plain`, which assembles it by scikit-fem. Here the same operator is the network of
the links between the pixels, each of which has four neighbours; its error is of the second order in the pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base import Array, Flags, Lengths, Pair, Shown, Singles, validate
from ..base.compiled import compiled, inner, number, over, rows, using
from .core_flux import core_ratio
from .grid import Stencil, gap_on_rows, link_weights
from .law import CUBIC_LAW, FlowLaw, cubic_law, gap_by_law
from .percolation import ready
from .plain import solve_plain
from .problem import PLAIN_SOLVERS, DarcyFlow, check_solver, unit_spacing, validated_cell
from .solvers.choice import solve_ready
from .solvers.hierarchy import levels_of
from .solvers.multigrid import cycle

#: Error in the norm of the energy at which a continuation ends, over that of zeros, and most iterations.
_FILL_RTOL, _MOST = 1e-5, 100


def cell_stencil(gap: Array, spacing: Pair, sides: str) -> Stencil:
    """Return the network of links between the pixels of a cell and its ends, from the gap (n1, n2) at the pixels."""
    n1, n2 = gap.shape
    is_ring = sides == "periodic"
    along = np.empty((n1 + 1, n2))
    across = np.empty((n1, n2 if is_ring else n2 - 1))
    over(rows(n1, n2), _conductances, gap, is_ring, link_weights(spacing), along, across)
    if is_ring and n2 == 1:  # the only pixel of a row is not its own neighbour
        across[:] = 0.0
    return Stencil(along, across, ring2=is_ring)


_cubic_law = inner()(cubic_law)


@compiled()
def _conductances(first, end, gap, is_ring, weights, along, across):
    """Write the conductances of the links of some rows, with the last row those to the outlet."""
    gap_on_rows(first, end, gap, False, is_ring, along, across)
    outlet = len(gap)
    for i in range(first, end + 1 if end == outlet else end):
        weight = weights.at_ends if i == 0 or i == outlet else weights.along
        for j in range(along.shape[1]):
            along[i, j] = weight * _cubic_law(along[i, j])
    for i in range(first, end):
        for j in range(across.shape[1]):
            across[i, j] = weights.across * _cubic_law(across[i, j])


@dataclass(frozen=True, repr=False)
class Permeability(Shown):
    """Permeability of a cell along one axis.

    Attributes
    ----------
    value : permeability k [m³], with which the flow per width is (k/η) Δp/L1; 0 if no open path joins both ends.
    percolates : whether an open path joins both ends.
    percolating_fraction : fraction of the pixels that are connected to both ends.
    iterations, residual, imbalance, solver : how the linear system was solved, see `femseal.flow.DarcyFlow`.
    fluid_pressure : array (n1, n2), pressure at the pixels for a unit drop; NaN at pixels in contact, and in pockets,
        which are connected to neither end.
    """

    value: float = field(metadata={"unit": "m^3", "long_name": "permeability"})
    percolates: bool
    percolating_fraction: float
    iterations: int
    residual: float
    imbalance: float
    solver: str
    fluid_pressure: Array = field(
        metadata={"unit": "1", "long_name": "fluid pressure for a unit drop"}, repr=False
    )


@validate.removed_arguments(
    bounds="compare several grids, or solve both bounds with femseal.flow.mesh.darcy_conductance"
)
def cell_permeability(
    gap: ArrayLike,
    spacing: Lengths,
    *,
    axis: int = 0,
    sides: str = "mirror",
    rtol: float = 1e-6,
    solver: str = "auto",
    field_rtol: float | None = None,
    law: FlowLaw = CUBIC_LAW,
    pressure: ArrayLike | None = None,
    threads: int | None = None,
) -> Permeability:
    """Compute the permeability of a cell whose gap is given at the pixel centres.

    Parameters
    ----------
    gap : array (n1, n2), gap h >= 0 [m]; h = 0 is contact.
    spacing : lengths (Δ1, Δ2) of a pixel [m].
    axis : direction of the flow, 0 for x1 or 1 for x2.
    sides : "mirror" (no flow through the sides) or "periodic".
    rtol : relative error of the permeability that is allowed to an iterative solver. The pressure then has an error of
        about √rtol, because the error of the permeability is the square of it.
    solver : "multigrid" or "elimination" (the fast path, see `femseal.flow.solve_flow`); "amg" or "direct" (the plain
        path by scikit-fem, with pyamg or a factorisation: the same permeability, in many times the time); or "auto".
    field_rtol : error of the pressure that is allowed to an iterative solver, in the energy norm; None for √rtol.
        With 1e-6 a picture of the pressure has no visible error anywhere.
    law : flow law, the permeability of a gap between parallel plates, such as `fluid.law`; see `femseal.flow.law`.
    pressure : pressure of the fluid, a number or an array (n1, n2) [Pa], for laws that depend on it.
    threads : number of threads on a grid of 512² points or more; None for those that the run leaves free, which is 1
        without a run. The result does not depend on it.

    Returns
    -------
    Permeability

    Raises
    ------
    InputError : a gap that is negative, undefined or not two-dimensional; an unknown side, axis or solver.
    NotConverged : the linear solver failed.

    Examples
    --------
    >>> round(cell_permeability(np.full((16, 16), 1e-6), (1e-6, 1e-6)).value * 12 / 1e-18, 6)  # parallel plates: h³/12
    1.0
    """
    if law != CUBIC_LAW:
        gap = gap_by_law(validated_cell(gap, spacing, 0, sides)[0], law, pressure)
    check_solver(solver)
    with using(number() if threads is None else validate.count("threads", threads)):
        cell = cell_flow(
            gap,
            spacing,
            axis=axis,
            sides=sides,
            rtol=rtol,
            solver=solver,
            field_rtol=field_rtol,
        )
    flow, potential = cell.flow, cell.flow.potential[1:-1]
    potential[(np.asarray(gap).T if axis == 1 else np.asarray(gap)) <= 0] = np.nan
    return Permeability(
        value=cell.permeability,
        percolates=flow.percolates,
        percolating_fraction=float(np.isfinite(potential).mean()) if flow.percolates else 0.0,
        iterations=flow.iterations,
        residual=flow.residual,
        imbalance=flow.imbalance,
        solver=flow.solver,
        fluid_pressure=potential.T if axis == 1 else potential,
    )


@dataclass(frozen=True, eq=False)
class CellFlow:
    """Flow along the first axis of a cell for a unit drop.

    Attributes
    ----------
    factor : ratio of the permeability [m³] to the conductance of `flow`.
    flow : solution with the pressure at the pixel centres and at both ends.
    core_ratio : ratio of the permeability of the core to that of the whole cell; 1 if the core is the whole cell.
    """

    factor: float
    flow: DarcyFlow
    core_ratio: float = 1.0

    @property
    def permeability(self) -> float:
        """Permeability [m³] of the core of the cell."""
        return self.factor * self.core_ratio * self.flow.conductance


def cell_flow(
    gap: ArrayLike,
    spacing: Lengths,
    *,
    axis: int,
    sides: str,
    solver: str,
    rtol: float = 1e-6,
    field_rtol: float | None = None,
    core: tuple[int, int] | None = None,
) -> CellFlow:
    """Solve the flow of `cell_permeability` alone, which takes less time for many small cells.

    Parameters
    ----------
    gap, spacing, axis, sides, solver, rtol, field_rtol : as in `cell_permeability`.
    core : first column of the core of the cell, and the column after its last one, counted across the flow; None for
        the whole cell. See `flow.core_flux`.

    Returns
    -------
    CellFlow, whose permeability is that of the core.

    Raises
    ------
    InputError, NotConverged : as `cell_permeability`.
    """
    validate.tolerance("rtol", rtol)
    h, (d1, d2), scale = _scaled(gap, spacing, axis, sides)
    n1, n2 = h.shape
    if solver in PLAIN_SOLVERS:
        flow = solve_plain(h, (d1, d2), sides, rtol=rtol, field_rtol=field_rtol, solver=solver)
        along = cell_stencil(h, (d1, d2), sides).along
    else:
        stencil = cell_stencil(h, (d1, d2), sides)
        del h  # large faces need its memory
        along = stencil.along
        links = along, stencil.across
        flow = solve_ready(
            *ready(*links), links, stencil.ring2, rtol=rtol, solver=solver, field_rtol=field_rtol
        )
    ratio = 1.0
    if core is not None and core != (0, n2) and flow.percolates:
        ratio = core_ratio(along, flow, core)
    return CellFlow(scale**3 * (n1 * d1) / (n2 * d2), flow, ratio)


def _scaled(gap: ArrayLike, spacing: Lengths, axis: int, sides: str) -> tuple[Array, Pair, float]:
    """The gap of `validated_cell` over the largest one, its unit spacing, and the largest [m], 1 if all is closed."""
    h, spacing = validated_cell(gap, spacing, axis, sides)
    scale = float(h.max()) or 1.0
    h /= scale
    return h, unit_spacing(spacing), scale


def pixel_dissipation(
    gap: Array, spacing: Pair, potential: NDArray[np.floating], *, seam: bool = True
) -> Array:
    """Dissipation of each pixel (n1, n2) [m³] of a flow along x1 through a cell with periodic sides for a unit drop.

    Each pixel gets half of the dissipation of a link to another pixel, and all of that of a link to an end. For the
    potential of `cell_permeability` the sum is the conductance k L2/L1.

    gap : (n1, n2) [m]. potential : there, between 1 at the inlet and 0 at the outlet, NaN where nothing flows.
    seam : whether fluid flows through the links from the last column to the first one.

    Raises InputError: a gap that is negative, undefined or not two-dimensional.
    """
    h, spacing = validated_cell(gap, spacing, 0, "periodic")
    n2 = h.shape[1]
    stencil = cell_stencil(h, spacing, "periodic")
    along, across = stencil.dissipation(
        np.concatenate([np.ones((1, n2)), potential, np.zeros((1, n2))])
    )
    if not seam:
        across[:, -1] = 0.0
    along[[0, -1]] *= 2  # halved below
    return (along[:-1] + along[1:] + across + np.roll(across, 1, axis=1)) / 2


def harmonic_fill(values: Array) -> Array:
    """Values (n1, n2) with those that are NaN continued by Δp = 0 from those that are known: the smoothest.

    The grid is periodic along x2, and nothing passes its ends along x1. Without any known value all stay NaN. Unknown
    pixels have links of five points; the system is solved by conjugate gradients with a cycle of multigrid.
    """
    unknown = np.isnan(values)
    if unknown.all() or not unknown.any():
        return values
    lowest = np.nanmin(values)
    height = np.nanmax(values) - lowest or 1.0
    known = np.where(unknown, 0.0, (values - lowest) / height)
    found = _continued(unknown, unknown * _beside(known.astype(np.float32)))
    return np.where(unknown, lowest + height * np.clip(found, 0.0, 1.0), values)


def _continued(unknown: Flags, r: Singles) -> Singles:
    """Solve A x = r, which is written over, at the unknown pixels."""
    n1, n2 = r.shape
    centre = unknown * _beside(np.ones_like(r))
    operator = np.zeros((3, n1 + 2, n2 + 2))
    operator[0, 1:-1, 1:-1] = centre
    operator[1, 1:-1, 1:-1] = unknown & np.roll(unknown, -1, 1) & (n2 > 1)
    operator[2, 1:-2, 1:-1] = unknown[:-1] & unknown[1:]
    operator[:, :, 0], operator[:, :, -1] = operator[:, :, -2], operator[:, :, 1]
    levels, coarsest = levels_of(operator, True)
    allowed = _FILL_RTOL**2 * float(np.vdot(r, r)) / 4
    x, p, former = np.zeros_like(r), np.zeros_like(r), np.inf
    for _ in range(_MOST):
        levels[0].b[1:-1, 1:-1] = r
        cycle(levels, coarsest, True)
        z = unknown * levels[0].r[1:-1, 1:-1]
        product = float(np.vdot(r, z))
        if not product > allowed:
            break
        p = z + np.float32(product / former) * p
        flow = centre * p - unknown * _beside(p)
        step = np.float32(product / float(np.vdot(p, flow)))
        x += step * p
        r -= step * flow
        former = product
    return x


def _beside(a: Singles) -> Singles:
    """Sum of a over the pixels beside each one."""
    total = np.zeros_like(a)
    if a.shape[1] > 1:
        total += np.roll(a, 1, 1)
        total += np.roll(a, -1, 1)
    total[1:] += a[:-1]
    total[:-1] += a[1:]
    return total

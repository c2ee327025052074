"""Permeability of a cell from its gap: ∇·(K ∇p) = 0 with the cubic law K = h³/12, or another one.

The unknowns are the pressures at the pixel centres; those of both ends are given. `DISCRETISATIONS` lists the choices;
the default takes K at the midpoints of the elements' edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base import InputError, Lengths, Shown, validate
from ..base.threads import number, over, rows, using
from .assembly import edge_weights
from .bounds import pixel_bounds
from .cell_mesh import mesh_flow
from .coefficient import unit_spacing, validated_cell
from .discretisation import check_discretisation, on_grid
from .edge_flow import cell_stencil, edge_conductances, edge_flow
from .grid import Grid
from .law import CUBIC_LAW, FlowLaw, gap_by_law
from .solution import DarcyFlow
from .solvers.choice import solve_flow

Array = NDArray[np.float64]


#: Pixels from which conductances are in single precision, as memory is what limits such faces. Those err by 6e-8, and
#: the flow by no more (Rayleigh's principle), unless it is so small beside the widest link that links at the end of
#: single precision may carry it: then, and where smaller errors are asked for, they are in double precision.
SINGLE_NODES, _SINGLE_RTOL, _SINGLE_FLOW = 3000**2, 1e-6, 1e-28


@dataclass(frozen=True, repr=False)
class Permeability(Shown):
    """Permeability of a cell along one axis, k with Q/L2 = (k/η) Δp/L1; exactly 0 where the gap does not percolate.

    lower, upper, resampling_error : NaN if not computed.
    percolating_fraction : of the pixels that are connected to both ends.
    iterations, residual, imbalance, solver : of the linear system, see `femseal.flow.DarcyFlow`.
    fluid_pressure : (n1, n2), NaN at pixels in contact and in pockets, which are connected to neither end.
    """

    value: float = field(metadata={"unit": "m^3", "long_name": "permeability"})
    lower: float = field(metadata={"unit": "m^3", "long_name": "lower bound of the permeability"})
    upper: float = field(metadata={"unit": "m^3", "long_name": "upper bound of the permeability"})
    resampling_error: float = field(metadata={"unit": "1", "long_name": "estimated relative error of the resolution"})
    percolates: bool
    percolating_fraction: float
    iterations: int
    residual: float
    imbalance: float
    solver: str
    fluid_pressure: Array = field(metadata={"unit": "1", "long_name": "fluid pressure for a unit drop"}, repr=False)


def cell_permeability(
    gap: ArrayLike,
    spacing: Lengths,
    *,
    axis: int = 0,
    sides: str = "mirror",
    bounds: bool = False,
    estimate: bool = False,
    rtol: float = 1e-6,
    discretisation: str = "edge",
    solver: str = "auto",
    field_rtol: float | None = None,
    law: FlowLaw = CUBIC_LAW,
    pressure: ArrayLike | None = None,
    threads: int | None = None,
) -> Permeability:
    """Permeability [m³] of a cell whose gap h >= 0 is given at pixel centres; h = 0 is contact.

    Parameters
    ----------
    gap : h (n1, n2) [m].
    spacing : pixel (Δ1, Δ2) [m].
    axis : direction of the flow.
    sides : "mirror" (no flow across the sides) or "periodic".
    bounds : also certify, for the gap taken constant on each pixel, lower <= k <= upper; otherwise both are NaN.
        The bounds enclose the flow through those pixels, not the resampling of the surface, so that `value`, which
        interpolates the gap between pixels, may lie outside where the gap is poorly resolved.
    estimate : also estimate how far the pixels resolve the gap: a third of the largest difference to the four values on
        every second pixel, as for order 2. It was 4 to 16 times the true error of gaps cut by a plane, with 8 pixels
        per shortest wave and up to 0.4 in contact; inf where some of these are closed and others not.
    rtol : relative error of k allowed to an iterative linear solver. `fluid_pressure` then has an error of about √rtol,
        of which k has the square.
    discretisation : "edge" (Q1, the gap interpolated to the midpoints of edges; order 2), "gauss" (Q1, the bilinear gap
        at 2 × 2 Gauss points; order 2 with a larger error), and by a general mesh "P1", "Q2" (gap linear or bilinear
        between pixels) and "RT0" (mixed, gap constant on each pixel).
    solver : of the linear system, see `femseal.flow.solve_flow`; a general mesh takes "auto" or "amg".
    field_rtol : where `fluid_pressure` is looked at, its error allowed to multigrid, in the norm of the energy; 1e-6 is
        right to the eye everywhere, also in bays that hardly anything flows through.
    law, pressure : permeability of a gap, see `femseal.flow.law`, such as `fluid.law`, and the pressure of the fluid, a
        number or (n1, n2) [Pa], which a law needs that depends on it.
    threads : that share the work on a grid of 512² points or more; those that the run leaves free, 1 without a run.
        Any number gives the same bits.

    Raises
    ------
    InputError : a gap that is negative, undefined or not two-dimensional; an unknown side, axis, discretisation or
        solver, an estimate with a general mesh.
    NotConverged : the linear solver failed.
    """
    if law != CUBIC_LAW:
        gap = gap_by_law(validated_cell(gap, spacing, 0, sides)[0], law, pressure)
    check_discretisation(discretisation, solver, estimate)
    with using(number() if threads is None else validate.count("threads", threads)):
        cell = cell_flow(
            gap,
            spacing,
            axis=axis,
            sides=sides,
            rtol=rtol,
            discretisation=discretisation,
            solver=solver,
            field_rtol=field_rtol,
        )
        flow, potential = cell.flow, cell.flow.potential
        if on_grid(discretisation):
            # nodes in contact have a pressure where a Q1 element reaches into contact
            potential = potential[1:-1]
            h = np.asarray(gap).T if axis == 1 else np.asarray(gap)
            filled = sum(over(rows(*h.shape), _close, h, potential))
        else:
            filled = np.count_nonzero(np.isfinite(potential))
    lower, upper = np.nan, np.nan
    if bounds or estimate:
        h, unit, _ = _scaled(gap, spacing, axis, sides)
    if bounds:
        lower, upper = (
            cell.factor * b for b in pixel_bounds(h, unit, sides, solver if on_grid(discretisation) else "auto")
        )
    estimated = np.nan
    if estimate:
        estimated = _resampling_error(h, unit, sides, discretisation, flow.conductance, rtol, solver)
    return Permeability(
        value=cell.permeability,
        lower=lower,
        upper=upper,
        resampling_error=estimated,
        percolates=flow.percolates,
        percolating_fraction=filled / potential.size if flow.percolates else 0.0,
        iterations=flow.iterations,
        residual=flow.residual,
        imbalance=flow.imbalance,
        solver=flow.solver,
        fluid_pressure=potential.T if axis == 1 else potential,
    )


def _close(begin: int, end: int, gap: NDArray[Any], potential: Array) -> int:
    """Make a potential NaN where the gap is 0, in some rows, and count where it is not."""
    here = potential[begin:end]
    here[gap[begin:end] <= 0] = np.nan
    return int(np.count_nonzero(here == here))


@dataclass(frozen=True, eq=False)
class CellFlow:
    """Flow along the first axis of a cell for a unit drop.

    factor : permeability [m³] over the conductance of `flow`.
    """

    factor: float
    flow: DarcyFlow

    @property
    def permeability(self) -> float:
        """Permeability [m³] of the cell."""
        return self.factor * self.flow.conductance


def cell_flow(
    gap: ArrayLike,
    spacing: Lengths,
    *,
    axis: int,
    sides: str,
    discretisation: str,
    solver: str,
    rtol: float = 1e-6,
    field_rtol: float | None = None,
) -> CellFlow:
    """The flow of `cell_permeability` without what that makes of it, for many small cells.

    On a grid the potential is that of all nodes, those of both ends among them; on a mesh that at the pixels.

    Raises
    ------
    InputError, NotConverged : as `cell_permeability`, but for an unknown discretisation.
    """
    validate.tolerance("rtol", rtol)
    rough = min(rtol, rtol if field_rtol is None else field_rtol) >= _SINGLE_RTOL
    single = discretisation == "edge" and rough and np.size(gap) >= SINGLE_NODES
    for precision in (np.float32, np.float64) if single else (np.float64,):
        h, (d1, d2), scale = _scaled(gap, spacing, axis, sides)
        shape = h.shape
        if not on_grid(discretisation):
            flow = mesh_flow(h, (d1, d2), sides, discretisation, rtol=rtol, solver=solver)
            break
        grid = Grid.of_pixel_centres(h.shape, (d1, d2), sides)
        if discretisation != "edge":
            stencil = cell_stencil(h, grid, discretisation)
            flow = solve_flow(stencil, rtol=rtol, solver=solver, field_rtol=field_rtol)
            break
        links = edge_conductances(h, grid.ring2, edge_weights(grid), precision)
        del h  # large faces need its memory
        flow = edge_flow(*links, grid.ring2, rtol=rtol, solver=solver, field_rtol=field_rtol)
        if flow.conductance > _SINGLE_FLOW:
            break
    return CellFlow(scale**3 * (shape[0] * d1) / (shape[1] * d2), flow)


def _scaled(gap: ArrayLike, spacing: Lengths, axis: int, sides: str) -> tuple[Array, tuple[float, float], float]:
    """The gap of `validated_cell` over the largest one, its unit spacing, and the largest [m], 1 if all is closed."""
    h, spacing = validated_cell(gap, spacing, axis, sides)
    scale = float(h.max()) or 1.0
    h /= scale
    return h, unit_spacing(spacing), scale


def cell_permeabilities(
    gaps: ArrayLike,
    spacing: Lengths,
    *,
    axes: Sequence[int] = (0, 1),
    sides: str = "mirror",
    rtol: float = 1e-6,
    threads: int = 1,
    discretisation: str = "edge",
    solver: str = "auto",
) -> Array:
    """Permeabilities [m³] of many gaps, such as those of a load cycle, along one axis or both.

    Parameters
    ----------
    gaps : (n, n1, n2) [m].
    axes : directions of the flow.
    spacing, sides, rtol, discretisation, solver : as in `cell_permeability`.
    threads : gaps solved at the same time.

    Returns
    -------
    (n, number of axes), in the order of `axes`.

    Raises
    ------
    InputError, NotConverged : as `cell_permeability`; the input of all gaps is checked first.
    """
    try:
        stack = np.asarray(gaps, dtype=float)
    except (TypeError, ValueError):
        raise InputError("gaps", f"a {type(gaps).__name__}", "an array (n, n1, n2) of real numbers [m]") from None
    if stack.ndim != 3:
        raise InputError("gaps", f"shape {stack.shape}", "a shape (n, n1, n2)")
    threads = validate.count("threads", threads)
    if not np.iterable(axes):
        raise InputError("axes", repr(axes), "a list of 0 (x1) and 1 (x2)")
    axes = [validate.axis_number(axis) for axis in axes]
    for gap in stack:
        validated_cell(gap, spacing, 0, sides)
    validate.tolerance("rtol", rtol)
    check_discretisation(discretisation, solver)
    cells = [(gap, axis) for gap in stack for axis in axes]

    def value(cell: tuple[Array, int]) -> float:
        gap, axis = cell
        result = cell_permeability(
            gap, spacing, axis=axis, sides=sides, rtol=rtol, discretisation=discretisation, solver=solver
        )
        return result.value

    with ThreadPoolExecutor(threads) as pool:
        values = list(pool.map(value, cells) if threads > 1 else map(value, cells))
    return np.array(values, dtype=float).reshape(len(stack), len(axes))


def pixel_dissipation(
    gap: Array, spacing: tuple[float, float], potential: NDArray[np.floating], *, seam: bool = True
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
    stencil = cell_stencil(h, Grid.of_pixel_centres(h.shape, spacing, "periodic"))
    along, across = stencil.dissipation(np.concatenate([np.ones((1, n2)), potential, np.zeros((1, n2))]))
    if not seam:
        across[:, -1] = 0.0
    along[[0, -1]] *= 2  # halved below
    return (along[:-1] + along[1:] + across + np.roll(across, 1, axis=1)) / 2


def _resampling_error(
    h: Array, spacing: tuple[float, float], sides: str, discretisation: str, rate: float, rtol: float, solver: str
) -> float:
    """Estimated relative error of `rate`, from the four ways to take every second pixel along both axes."""
    if min(h.shape) < 4:
        return np.nan
    x1, x2 = ((np.arange(n) + 0.5) * d for n, d in zip(h.shape, spacing, strict=True))
    size = (h.shape[0] * spacing[0], h.shape[1] * spacing[1])
    rates = []
    for a, b in np.ndindex(2, 2):
        grid = Grid.of_points(x1[a::2], x2[b::2], size, sides)
        stencil = cell_stencil(h[a::2, b::2], grid, discretisation)
        rates.append(solve_flow(stencil, rtol=rtol, solver=solver).conductance)
    if rate == 0 or min(rates) == 0:
        return np.inf if max(rate, *rates) > 0 else 0.0
    return max(abs(rate - r) for r in rates) / (3 * rate)

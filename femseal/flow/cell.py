"""Compute the permeability of a cell from its gap by solving ∇·(K ∇p) = 0, where K is h³/12 or another flow law.

The module `flow.plain` defines the discrete problem, and assembles the matrix with scikit-fem. The module `flow.cell`
represents the same matrix by a network of links between neighbouring pixels. The discretisation error is of second
order in the pixel size.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, Lengths, Pair, Shown, validate
from ..base.compiled import compiled, inner, over, rows, thread_count, using_threads
from .core_flux import core_ratio
from .grid import Stencil, gap_on_rows, link_weights
from .law import CUBIC_LAW, FlowLaw, checked_equivalent_gap, cubic_law
from .percolation import prepare_links_in_place
from .plain import solve_plain
from .problem import SPARSE_SOLVERS, DarcyFlow, check_solver, unit_spacing, validated_cell
from .solvers.choice import solve_in_place


def cell_stencil(gap: Array, spacing: Pair, sides: str) -> Stencil:
    """Build the network of links that join the pixels of a cell to each other, to the inlet and to the outlet.

    gap : array (n1, n2), gap at the pixel centres.
    """
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
    """Compute the conductances of the links in rows `first` to `end` − 1.

    Row i of `along` contains the links from row i − 1 of the pixels to row i; row 0 contains the links from the inlet
    to row 0 of the pixels. The links from the last row of pixels to the outlet are computed together with the last row.
    """
    # `along` and `across` first contain the gaps on the links, which are then replaced by the conductances
    gap_on_rows(first, end, gap, False, is_ring, along, across)
    outlet = len(gap)  # row of the links to the outlet
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
    value : permeability k [m³], defined by the volume flow rate per width, (k/η) Δp/L1; 0 if the cell does not
        percolate.
    percolates : whether an open path connects inlet and outlet.
    percolating_fraction : fraction of the pixels that are connected to both inlet and outlet.
    iterations, residual, imbalance, solver : details of the solution of the linear system, see
        `femseal.flow.DarcyFlow`.
    fluid_pressure : array (n1, n2), fluid pressure at the pixels for a pressure of 1 at the inlet and 0 at the outlet.
        The array contains NaN for pixels in contact and for pockets, which are connected neither to the inlet nor to
        the outlet.
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
    rtol : largest relative error of the permeability that an iterative solver may leave. The relative error of the
        pressure is about √rtol, because its square is the error of the permeability.
    solver : "auto", or the name of a solver. "multigrid" and "elimination" are the fast solvers, see
        `femseal.flow.solve_flow`. "amg" (pyamg) and "direct" (factorisation) solve the matrix that scikit-fem
        assembles; they give the same permeability, but take many times as long as the fast solvers.
    field_rtol : largest relative error of the pressure in the energy norm that an iterative solver may leave; None for
        √rtol. If `field_rtol` is 1e-6, no error is visible in a picture of the pressure.
    law : flow law, which gives the permeability of a gap between parallel plates, such as `fluid.law`; see
        `femseal.flow.law`.
    pressure : fluid pressure [Pa], a number or an array (n1, n2), for flow laws that depend on it.
    threads : number of threads for a grid of 512² points or more. By default, one thread is used; inside a run, the
        default is the number of threads that the run provides for each computation. The number of threads does not
        change the result.

    Returns
    -------
    Permeability

    Raises
    ------
    InputError : the gap is negative, undefined or not two-dimensional, or `sides`, `axis` or `solver` is unknown.
    NotConverged : the linear solver failed.

    Examples
    --------
    >>> round(cell_permeability(np.full((16, 16), 1e-6), (1e-6, 1e-6)).value * 12 / 1e-18, 6)  # parallel plates: h³/12
    1.0
    """
    if law != CUBIC_LAW:
        gap = checked_equivalent_gap(validated_cell(gap, spacing, 0, sides)[0], law, pressure)
    check_solver(solver)
    with using_threads(thread_count() if threads is None else validate.count("threads", threads)):
        cell = cell_flow(
            gap,
            spacing,
            axis=axis,
            sides=sides,
            rtol=rtol,
            solver=solver,
            field_rtol=field_rtol,
        )
    flow = cell.flow
    # the first and the last row are inlet and outlet; in `flow` the fluid flows along the first axis
    potential = flow.potential[1:-1]
    gap_along_flow = np.asarray(gap).T if axis == 1 else np.asarray(gap)
    potential[gap_along_flow <= 0] = np.nan
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
    """Flow along the first axis of a cell for a unit pressure drop.

    Attributes
    ----------
    factor : permeability [m³] of the whole cell divided by the conductance of `flow`.
    flow : flow through the whole cell, with the pressures at the inlet, at the pixel centres and at the outlet.
    core_ratio : permeability of the core divided by the permeability of the whole cell; 1 without overlaps.
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
    """Solve the flow through a cell without computing the other results of `cell_permeability`.

    Parameters
    ----------
    gap, spacing, axis, sides, solver, rtol, field_rtol : as in `cell_permeability`.
    core : range (first, last + 1) of the columns that belong to the cell itself and not to its overlaps into
        neighbouring cells. Columns are counted perpendicular to the flow. `core` is None if the cell has no overlaps.
        See `flow.core_flux`.

    Returns
    -------
    CellFlow with the permeability of the core, that is, of the cell without its overlaps.

    Raises
    ------
    InputError, NotConverged : as in `cell_permeability`.
    """
    validate.tolerance("rtol", rtol)
    h, (d1, d2), largest_gap = _scaled(gap, spacing, axis, sides)
    n1, n2 = h.shape
    if solver in SPARSE_SOLVERS:
        flow = solve_plain(h, (d1, d2), sides, rtol=rtol, field_rtol=field_rtol, solver=solver)
        along = cell_stencil(h, (d1, d2), sides).along  # for the flux in the core
    else:
        stencil = cell_stencil(h, (d1, d2), sides)
        del h  # large faces need its memory
        along = stencil.along
        links = prepare_links_in_place(along, stencil.across)
        flow = solve_in_place(links, stencil.ring2, rtol=rtol, solver=solver, field_rtol=field_rtol)
    ratio = 1.0
    if core is not None and core != (0, n2) and flow.percolates:
        ratio = core_ratio(along, flow, core)
    length = n1 * d1
    width = n2 * d2
    return CellFlow(largest_gap**3 * length / width, flow, ratio)


class _ScaledCell(NamedTuple):
    """Gap and spacing of a cell without units, arranged so that the fluid flows along the first axis.

    gap : array (n1, n2), gap divided by `largest_gap`.
    spacing : lengths of a pixel, divided by a power of two.
    largest_gap : largest gap [m], or 1 m if the gap is 0 everywhere.
    """

    gap: Array
    spacing: Pair
    largest_gap: float


def _scaled(gap: ArrayLike, spacing: Lengths, axis: int, sides: str) -> _ScaledCell:
    """Check and scale the gap and the spacing of a cell."""
    h, spacing = validated_cell(gap, spacing, axis, sides)
    largest_gap = float(h.max()) or 1.0
    h /= largest_gap
    return _ScaledCell(h, unit_spacing(spacing), largest_gap)

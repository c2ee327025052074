"""Compute the permeabilities of the cells of a surface in contact along both axes, and their correction factors.

The contact is solved for the whole surface, because the long waves of the surface keep the valleys of a cell open. A
single cell would be flattened under the load. The flow through a cell is solved with no flow across its sides. Fluid
cannot make a detour through neighbouring cells, so that the cells in their original order leak less than the surface. A
correction factor for each axis and each contact state compensates for the missing detours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base import Array, Flags, Floats
from ..loads import LoadProgramme
from .cell_flow import Failed, FlowSettings, SolveCounts, attempt, cell_permeabilities
from .cut import Boundary, Cut

#: Largest correction factor, and largest ratio of the leakage of a seal with cells in their original order to the
#: leakage of the surface. Larger values would be due to single constrictions.
MOST_FACTOR, MOST_RATIO = 3.0, 2.0


@dataclass(frozen=True, eq=False)
class CellState:
    """Properties of the cells of a surface in one contact state.

    Attributes
    ----------
    k : array, (pressures, 2, m1, m2)
        Permeability of each cell along x1 and x2 at each fluid pressure [m³], NaN if a solver failed.
    pressure, mean_gap, contact_fraction, plastic_fraction : arrays, (m1, m2)
        Means over each cell: contact pressure [Pa], gap [m], contact fraction, and fraction of the points at which the
        pressure has reached the hardness.
    drop_fraction : array, (m1, m2)
        Fraction of the total dissipation that occurs in each cell; NaN if there is no flow.
    row_pressure : array, (n1,)
        Mean contact pressure of each row of points [Pa].
    solve_counts : SolveCounts
        Numbers of linear systems that were solved, of open cells and of closed cells.
    failures : tuple of str
        Messages of the solvers whose failure left NaN in `k`.
    surface_k1 : float
        Permeability of the whole surface along x1 [m³].
    surface_k2 : float
        Permeability of the whole surface along x2 [m³], averaged over the measured patches; NaN if it was not computed.
    patches : array, (patches,), or None
        Permeability of each patch along x1 [m³].
    flow_failure : str
        Reason why the flow through the whole surface is unknown, "" if it is known.
    carriers : float
        Effective number of blocks that carry the flow through the whole surface, see `participation_number`.
    edge_distance : float
        Mean distance [m] between the yielding points and the edge of their contact patch, see
        `contact.mean_edge_distance`; NaN without a coating.
    """

    k: Array
    pressure: Array
    mean_gap: Array
    contact_fraction: Array
    plastic_fraction: Array
    drop_fraction: Array
    row_pressure: Array
    solve_counts: SolveCounts
    failures: tuple[str, ...] = ()
    surface_k1: float = np.nan
    surface_k2: float = np.nan
    patches: Array | None = None
    flow_failure: str = ""
    carriers: float = np.nan
    edge_distance: float = np.nan

    @classmethod
    def of(
        cls,
        gap: Floats,
        pressure: Floats,
        cut: Cut,
        flow: FlowSettings,
        plastic: Flags | float = np.nan,
        fractions: Floats | float = np.nan,
        boundary: Boundary = ("free", "periodic"),
    ) -> CellState:
        """Cut the gap and the contact pressure of a surface into cells, and compute the flow through each cell.

        Parameters
        ----------
        gap, pressure : arrays, (n1, n2)
            Gap [m] and contact pressure [Pa] of the surface.
        cut : Cut
            Division of the surface into cells.
        flow : FlowSettings
            Fluid and solver.
        plastic : array of bool, (n1, n2), optional
            Whether the pressure of each point has reached the hardness. By default, `plastic_fraction` is NaN.
        fractions : array, (n1, n2), optional
            Fraction of the dissipation at each point. By default, `drop_fraction` is NaN.
        boundary : tuple of two str
            How the surface continues beyond its border, see `Cut.split_with_overlaps`.
        """
        k = np.full((flow.drop.pressures.size, 2, *cut.shape), np.nan)
        counts, failures = [], []
        for axis in (0, 1):
            cells = cut.split_with_overlaps(gap, axis, boundary)
            for index, cell in zip(np.ndindex(*cut.shape), cells, strict=True):
                if not np.isfinite(cell.field).all():
                    continue  # the permeability of this cell stays NaN
                cell_gap = np.array(cell.field, float)
                solution = attempt(
                    cell_permeabilities, cell_gap, cut.spacing, axis, flow, cell.core
                )
                if isinstance(solution, Failed):
                    failures.append(f"cell {index}, x{axis + 1}: {solution.reason}")
                    continue
                k[:, axis, *index] = solution.k
                counts.append(solution.solve_counts)
        return cls(
            k=k,
            pressure=cut.means(pressure),
            mean_gap=cut.means(gap),
            contact_fraction=cut.means(pressure > 0),
            plastic_fraction=cut.means(np.broadcast_to(plastic, gap.shape)),
            drop_fraction=cut.sums(np.broadcast_to(fractions, gap.shape)),
            row_pressure=pressure.mean(axis=1, dtype=float),
            solve_counts=SolveCounts.total(counts),
            failures=tuple(failures),
        )


def correction_factors(
    surface: Array, cells: Array, steps: LoadProgramme, largest: float = MOST_FACTOR
) -> Array:
    """Compute the correction factor of each contact state for one axis.

    The correction factor is the leakage of the whole surface divided by the leakage of its cells in their original
    order. If the surface or its cells are sealed in a state, or if a leakage is unknown, the state has no factor. A
    state without a factor takes the factor of the nearest state in the same branch of the load cycle. If no state of a
    branch has a factor, the factor is 1 in all its states. The correction factor is limited, because for a nearly
    closed surface it depends on single constrictions, which are not typical of other parts of the seal.

    Parameters
    ----------
    surface, cells : arrays, (steps,)
        Leakage or permeability along the axis, of the whole surface and of its cells in their original order.
    steps : LoadProgramme
        Load programme.
    largest : float
        Largest correction factor; the smallest correction factor is 1/`largest`.

    Returns
    -------
    array, (steps,)
        Correction factors.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        log_ratio = np.log(surface / cells)
    log_factor = np.zeros(len(steps))
    for branch in steps.branches:  # indices of the steps of each branch
        known = np.flatnonzero(np.isfinite(log_ratio[branch]))  # positions in the branch
        if known.size:
            position = np.arange(len(branch))
            distance = np.abs(position[:, None] - known)  # (state, state with a factor)
            nearest = known[distance.argmin(axis=1)]
            log_factor[branch] = log_ratio[branch[nearest]]
    return np.exp(np.clip(log_factor, -np.log(largest), np.log(largest)))

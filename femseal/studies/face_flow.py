"""Flow through a whole face at full resolution."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Pair
from ..face.piece_flow import FlowSettings, SolverCounts
from ..flow import Permeability, cell_permeability
from ..flow.cell import pixel_dissipation
from ..flow.pressure_drop import pressure_between
from ..flow.spiral import spiral_flow

#: Relative error at which flows end that depend on the pressure; the factor of a gas itself is within 0.9 %.
PRESSURE_RTOL = 1e-4
#: Points of the largest face whose flow is solved as a whole: with contact it takes 9 GB.
LARGEST_FLOW = 2**26


@dataclass(frozen=True, eq=False)
class FaceFlow:
    """Flow along x1 through a whole face.

    permeability : that which the drop of the viscous potential sees [m³]. solvers : of its systems.
    potential : between 1 at the inlet and 0 at the outlet (n1, n2), NaN in contact and in pockets; None of a flow that
        failed.
    """

    permeability: float
    solvers: SolverCounts
    potential: NDArray[np.floating] | None = None


def resolved_flow(
    gap: NDArray[np.floating],
    spacing: Pair,
    settings: FlowSettings | None = None,
) -> FaceFlow:
    """Solve the flow along x1 through the gap (n1, n2) [m] of a whole face, which is periodic along x2.

    A face of more than `LARGEST_FLOW` points is solved in parts along x2, side by side. Grooves that wind carry fluid
    past closed lands where the settings have a spiral.

    Raises NotConverged: see `cell_permeability` and `PressureDrop.solve_face`.
    """
    settings = settings or FlowSettings()
    if gap.size > LARGEST_FLOW:
        return _in_parts(gap, spacing, settings)
    counts = SolverCounts()

    def solve(gap: Array) -> tuple[float, Array, Permeability]:
        nonlocal counts
        flow = cell_permeability(gap, spacing, sides="periodic", solver=settings.solver)
        counts += SolverCounts.of(flow)
        if settings.spiral and (
            wound := spiral_flow(gap, spacing, settings.spiral, flow.fluid_pressure)
        ):
            flow = replace(flow, value=wound[0], fluid_pressure=wound[1], percolates=wound[0] > 0)
        return flow.value, flow.fluid_pressure, flow

    solved = settings.drop.solve_face(np.asarray(gap, float), spacing, solve, PRESSURE_RTOL)
    flow, drop = solved.found, solved.drop
    value, potential = flow.value * drop.mean_factor, drop.viscous_fraction(flow.fluid_pressure)
    # the potential has no extremes inside; the solver's error, about 1e-3 in the norm of the energy, may give it some
    return FaceFlow(value, counts, np.clip(potential, 0.0, 1.0))


def _in_parts(
    gap: NDArray[np.floating],
    spacing: Pair,
    settings: FlowSettings,
) -> FaceFlow:
    """`resolved_flow` of a face in parts along x2: their mean, each continued periodically by itself."""
    parts = np.array_split(gap, -(-gap.size // LARGEST_FLOW), axis=1)
    flows = [resolved_flow(part, spacing, settings) for part in parts]
    value = float(
        np.average([flow.permeability for flow in flows], weights=[part.shape[1] for part in parts])
    )
    potential = np.concatenate([flow.potential for flow in flows], axis=1)
    return FaceFlow(value, SolverCounts.total(flow.solvers for flow in flows), potential)


def drop_fractions(
    gap: Array,
    spacing: Pair,
    potential: NDArray[np.floating],
    settings: FlowSettings,
) -> Array:
    """Fraction of the pressure drop at each pixel (n1, n2): of the dissipation of the flow; NaN where nothing flows.

    gap : (n1, n2) [m]. potential : see `FaceFlow`.
    """
    drop = settings.drop
    pressure: Array | float = 0.0
    if drop.law.depends_on_pressure:
        known = np.nan_to_num(potential, nan=0.5)
        pressure = pressure_between(drop.fluid, drop.inlet, drop.outlet, known)
        pressure = np.maximum(pressure, drop.least_pressure)
    equivalent = drop.law.equivalent_gap(gap, pressure)
    # grooves that wind leave the last column for another row of the first one
    found = pixel_dissipation(equivalent, spacing, potential, seam=settings.spiral is None)
    whole = found.sum()
    return found / whole if whole > 0 else np.full(found.shape, np.nan)

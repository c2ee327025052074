"""Flow through a whole face, at full resolution or through elements."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..base import Array
from ..elements import ElementFlow, element_flow, face_potential
from ..flow import Permeability, cell_permeability
from ..flow.pressure_drop import FaceSolution, PressureDrop
from ..flow.spiral import spiral_flow
from ..library import ColumnRuns
from ..windows import FlowSettings, Partition, SolverCounts

#: Relative error at which flows end that depend on the pressure; the factor of a gas itself is within 0.9 %.
PRESSURE_RTOL = 1e-4


@dataclass(frozen=True, eq=False)
class FaceFlow:
    """Flow along x1 through a whole face.

    permeability : that which the drop of the viscous potential sees [m³]. solvers : of its systems.
    potential : between 1 at the inlet and 0 at the outlet (n1, n2), NaN in contact and in pockets; None where it was
        not asked for.
    error, drop_fraction : through elements, the estimated relative error of the permeability, and the fraction of the
        drop in every window (m1, m2); None at full resolution.
    """

    permeability: float
    solvers: SolverCounts
    potential: NDArray[np.float32] | None = None
    error: float | None = None
    drop_fraction: Array | None = None


def resolved_flow(
    gap: NDArray[np.floating],
    spacing: tuple[float, float],
    settings: FlowSettings | None = None,
    *,
    with_potential: bool = False,
) -> FaceFlow:
    """Solve the flow along x1 through the gap (n1, n2) [m] of a whole face, which is periodic along x2.

    Grooves that wind carry fluid past closed lands where the settings have a spiral.

    `with_potential` keeps the potential at every pixel.

    Raises NotConverged: see `cell_permeability` and `PressureDrop.solve_face`.
    """
    settings = settings or FlowSettings()
    counts = SolverCounts()

    def solve(gap: Array) -> tuple[float, Array, Permeability]:
        nonlocal counts
        flow = cell_permeability(
            gap, spacing, sides="periodic", discretisation=settings.discretisation, solver=settings.solver
        )
        counts += SolverCounts.of(flow)
        if settings.spiral and (wound := spiral_flow(gap, spacing, settings.spiral, flow.fluid_pressure)):
            flow = replace(flow, value=wound[0], fluid_pressure=wound[1], percolates=wound[0] > 0)
        return flow.value, flow.fluid_pressure, flow

    solved = settings.drop.solve_face(np.asarray(gap, float), spacing, solve, PRESSURE_RTOL)
    flow, drop = solved.found, solved.drop
    value, potential = flow.value * drop.mean_factor, drop.viscous_fraction(flow.fluid_pressure)
    # the potential has no extremes inside; the solver's error, about 1e-3 in the norm of the energy, may give it some
    kept = np.clip(potential, 0.0, 1.0).astype(np.float32) if with_potential else None
    return FaceFlow(value, counts, kept)


def element_face_flow(gap: NDArray[np.floating], partition: Partition, drop: PressureDrop) -> FaceFlow:
    """Solve the flow along x1 through the gap (n1, n2) [m] of a whole face by an element for every window.

    Raises NotConverged: see `elements.element_flow` and `PressureDrop.solve_face`.
    """
    solved = _solve_elements(gap, partition, drop)
    flow, potential = solved.found
    viscous = solved.drop.viscous_fraction(np.clip(potential, 0.0, 1.0)).astype(np.float32)
    dissipation = solved.drop.mean_factor * flow.dissipation
    return FaceFlow(
        permeability=solved.drop.mean_factor * flow.permeability,
        solvers=SolverCounts.of(flow),
        potential=viscous,
        error=flow.error,
        drop_fraction=dissipation / (dissipation.sum() or 1.0),
    )


def columns_of_face(
    gap: NDArray[np.floating], partition: Partition, drop: PressureDrop
) -> tuple[ColumnRuns, PressureDrop]:
    """Columns of a face, see `library.ColumnRuns`, and the drop whose fractions their potential is.

    A law that depends on the pressure has the pressures in the whole face. The `mean_factor` of the drop multiplies the
    conductances.
    """
    if not drop.law.depends_on_pressure:
        return ColumnRuns.of(drop.law.equivalent_gap(gap), partition), drop
    solved = _solve_elements(gap, partition, drop)
    return ColumnRuns.of(solved.gap, partition), solved.drop


def _solve_elements(
    gap: NDArray[np.floating], partition: Partition, drop: PressureDrop
) -> FaceSolution[tuple[ElementFlow, Array]]:
    """Flow through the elements of a face, at its own pressures where the law depends on them, and its potential."""

    def solve(gap: Array) -> tuple[float, Array, tuple[ElementFlow, Array]]:
        flow = element_flow(gap, partition)
        potential = face_potential(gap, partition, flow)
        return flow.permeability, potential, (flow, potential)

    return drop.solve_face(np.asarray(gap, float), partition.spacing, solve, PRESSURE_RTOL)

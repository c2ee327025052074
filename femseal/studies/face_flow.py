"""Flow through a whole face, at full resolution or through elements, and its leakage at every step."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..elements import ElementFlow, element_flow, face_potential
from ..flow import Permeability, cell_permeability
from ..flow.pressure_drop import FaceSolution, PressureDrop
from ..library import ColumnRuns
from ..seal import RectangularSeal
from ..windows import Failed, FlowSettings, Partition, SolverCounts
from .scene import Array, Scene

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

    `with_potential` keeps the potential at every pixel.

    Raises
    ------
    NotConverged : see `cell_permeability` and `PressureDrop.solve_face`.
    """
    settings = settings or FlowSettings()
    counts = SolverCounts()

    def solve(gap: Array) -> tuple[float, Array, Permeability]:
        nonlocal counts
        flow = cell_permeability(
            gap, spacing, sides="periodic", discretisation=settings.discretisation, solver=settings.solver
        )
        counts += SolverCounts.of(flow)
        return flow.value, flow.fluid_pressure, flow

    solved = settings.drop.solve_face(np.asarray(gap, float), spacing, solve, PRESSURE_RTOL)
    flow, drop = solved.found, solved.drop
    value, potential = flow.value * drop.mean_factor, drop.viscous_fraction(flow.fluid_pressure)
    # the potential has no extremes inside; the solver's error, about 1e-3 in the norm of the energy, may give it some
    kept = np.clip(potential, 0.0, 1.0).astype(np.float32) if with_potential else None
    return FaceFlow(value, counts, kept)


def element_face_flow(gap: NDArray[np.floating], partition: Partition, drop: PressureDrop) -> FaceFlow:
    """Solve the flow along x1 through the gap (n1, n2) [m] of a whole face by an element for every window.

    Raises
    ------
    NotConverged : see `elements.element_flow` and `PressureDrop.solve_face`.
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


@dataclass(frozen=True, eq=False)
class FaceLeakage:
    """Leakage through a whole face at every step, NaN where the flow failed.

    leakage : per length of seal (steps,) [m²/s]. fluid_pressure : (steps, n1, n2) [Pa], NaN in contact and in pockets.
    element_error (steps,), drop_fraction (steps, m1, m2) : see `FaceFlow`; None at full resolution.
    step_solvers : systems of every step by solver.
    """

    leakage: Array
    fluid_pressure: NDArray[np.float32]
    element_error: Array | None
    drop_fraction: Array | None
    failures: tuple[str, ...]
    step_solvers: tuple[SolverCounts, ...]

    def solvers(self, first: NDArray[np.int64]) -> SolverCounts:
        """Number of systems by solver, those of equal steps once, see `repeated_steps.first_equal`."""
        return SolverCounts.total(self.step_solvers[s] for s in np.flatnonzero(first == np.arange(first.size)))


def face_leakage(
    scene: Scene, flows: Iterable[FaceFlow | Failed], elements: tuple[int, int] | None = None
) -> FaceLeakage:
    """Leakage and fluid pressure of a scene from the flow through its whole face at every step.

    elements : number of windows (m1, m2) if the flows are through their elements.
    """
    seal, count = RectangularSeal(scene.surface.size, (1, 1)), len(scene.steps)
    leakage, pressure = np.full(count, np.nan), np.full((count, *scene.surface.shape), np.nan, np.float32)
    error, fraction = (
        (None, None) if elements is None else (np.full(count, np.nan), np.full((count, *elements), np.nan))
    )
    failures, solvers = [], [SolverCounts()] * count
    for s, (step, flow) in enumerate(zip(scene.steps, flows, strict=True)):
        if isinstance(flow, Failed):
            failures.append(f"{step.name}: {flow.reason}")
            continue
        through = scene.leakage(seal, flow.permeability)
        leakage[s], solvers[s] = through.per_length, flow.solvers + SolverCounts.of(through)
        if flow.potential is not None:
            pressure[s] = scene.pressure_at(flow.potential)
        if error is not None and fraction is not None:
            error[s], fraction[s] = flow.error, flow.drop_fraction
    return FaceLeakage(leakage, pressure, error, fraction, tuple(failures), tuple(solvers))

"""Leakage of a whole face at every step, from the flow through it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Array
from ..base.shared_array import give_back, shared_empty
from ..seal import RectangularSeal
from ..windows import Failed, SolverCounts
from .face_flow import FaceFlow
from .scene import Scene


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
    leakage, pressure = np.full(count, np.nan), shared_empty((count, *scene.surface.shape), np.float32)
    error, fraction = (
        (None, None) if elements is None else (np.full(count, np.nan), np.full((count, *elements), np.nan))
    )
    failures, solvers = [], [SolverCounts()] * count
    for s, (step, flow) in enumerate(zip(scene.steps, flows, strict=True)):
        potential = None if isinstance(flow, Failed) else flow.potential
        pressure[s] = np.nan if potential is None else scene.pressure_at(potential)
        give_back(pressure)
        if isinstance(flow, Failed):
            failures.append(f"{step.name}: {flow.reason}")
            continue
        through = scene.leakage(seal, flow.permeability)
        leakage[s], solvers[s] = through.per_length, flow.solvers + SolverCounts.of(through)
        if error is not None and fraction is not None:
            error[s], fraction[s] = flow.error, flow.drop_fraction
    return FaceLeakage(leakage, pressure, error, fraction, tuple(failures), tuple(solvers))

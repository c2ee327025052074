"""Flow through the elements of a whole face, at its own pressures where the law of the fluid depends on them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..elements import ElementFlow, element_flow, face_potential
from ..flow.pressure_drop import PressureDrop
from ..library import ColumnRuns
from ..windows import Partition
from .scene import PRESSURE_RTOL, Array


@dataclass(frozen=True, eq=False)
class FaceElements:
    """Flow through the elements of a face.

    flow : its permeabilities see the drop of the viscous potential. potential : between 1 at the
        inlet and 0 at the outlet, at every pixel (n1, n2).
    gap : (n1, n2) [m] whose elements were solved, by the cubic law. drop : whose fractions its potential is.
    """

    flow: ElementFlow
    potential: NDArray[np.float32]
    gap: NDArray[np.floating]
    drop: PressureDrop


def flow_through_elements(gap: NDArray[np.floating], partition: Partition, drop: PressureDrop) -> FaceElements:
    """Solve the flow through a face (n1, n2) [m].

    Raises
    ------
    NotConverged : see `elements.element_flow` and `PressureDrop.solve_face`.
    """

    def solve(gap: Array) -> tuple[float, Array, tuple[ElementFlow, Array]]:
        flow = element_flow(gap, partition)
        potential = face_potential(gap, partition, flow)
        return flow.permeability, potential, (flow, potential)

    solved = drop.solve_face(np.asarray(gap, float), partition.spacing, solve, PRESSURE_RTOL)
    (flow, potential), factor = solved.found, solved.drop.mean_factor
    flow = replace(
        flow,
        permeability=factor * flow.permeability,
        node_permeability=factor * flow.node_permeability,
        dissipation=factor * flow.dissipation,
    )
    viscous = solved.drop.viscous_fraction(np.clip(potential, 0.0, 1.0)).astype(np.float32)
    return FaceElements(flow, viscous, solved.gap, solved.drop)


def columns_of_face(
    gap: NDArray[np.floating], partition: Partition, drop: PressureDrop
) -> tuple[ColumnRuns, PressureDrop]:
    """Columns of a face, see `library.ColumnRuns`, and the drop whose fractions their potential is.

    A law that depends on the pressure has the pressures in the whole face. The `mean_factor` of the drop multiplies the
    conductances.
    """
    if not drop.law.depends_on_pressure:
        return ColumnRuns.of(drop.law.equivalent_gap(gap), partition), drop
    face = flow_through_elements(gap, partition, drop)
    return ColumnRuns.of(face.gap, partition), face.drop

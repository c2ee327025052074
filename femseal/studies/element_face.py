"""Flow through the elements of a whole face, also of a gas with slip, whose flow factors depend on its own pressure."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..elements import ElementFlow, element_flow, face_potential
from ..flow.gas_drop import GasDrop, successive
from ..library import ColumnRuns
from ..windows import Partition
from .scene import GAS_RTOL, Array


@dataclass(frozen=True, eq=False)
class FaceElements:
    """Flow through the elements of a face.

    flow : its permeabilities see the drop of the viscous potential. share : of that drop at every pixel (n1, n2).
    gap : (n1, n2) [m] whose elements were solved; of a gas with slip that of the same permeability by the cubic law.
    drop : of a gas with slip the drop whose shares the potential of that gap is; None of other fluids.
    """

    flow: ElementFlow
    share: NDArray[np.float32]
    gap: NDArray[np.floating]
    drop: GasDrop | None = None


def flow_through_elements(gap: NDArray[np.floating], partition: Partition, drop: GasDrop | None) -> FaceElements:
    """Solve the flow through a face (n1, n2) [m], that of a gas with slip again and again at its own pressures.

    Raises
    ------
    NotConverged : see `elements.element_flow`; the flow of a gas still changes after many solutions.
    """
    of_gas = None if drop is None else drop.through(np.asarray(gap, float), partition.spacing)
    if of_gas is None:
        flow = element_flow(gap, partition)
        return FaceElements(flow, face_potential(gap, partition, flow).astype(np.float32), gap)
    h = np.asarray(gap, float)

    def solve(share: Any) -> tuple[float, Array, FaceElements]:
        widened = of_gas.equivalent_gap(h, share)
        flow = element_flow(widened, partition)
        potential = face_potential(widened, partition, flow)
        return flow.permeability, potential, FaceElements(flow, potential.astype(np.float32), widened)

    found = successive(solve, GAS_RTOL)
    factor = of_gas.mean_factor
    flow = replace(
        found.flow,
        permeability=factor * found.flow.permeability,
        node_permeability=factor * found.flow.node_permeability,
        dissipation=factor * found.flow.dissipation,
    )
    share = of_gas.viscous_share(np.clip(found.share, 0.0, 1.0)).astype(np.float32)
    return FaceElements(flow, share, found.gap, of_gas)


def columns_of_face(
    gap: NDArray[np.floating], partition: Partition, drop: GasDrop | None
) -> tuple[ColumnRuns, GasDrop | None]:
    """Columns of a face, see `library.ColumnRuns`; of a gas with slip also the drop whose shares their potential is.

    A gas with slip has the pressures in the whole face. Its `mean_factor` multiplies the conductances.
    """
    if drop is None:
        return ColumnRuns.of(gap, partition), None
    face = flow_through_elements(gap, partition, drop)
    return ColumnRuns.of(face.gap, partition), face.drop

"""Contact of a whole face at every step of its load programme, and the flow through it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Mapper
from ..base.shared_array import give_back, lies_on_disk, put_aside
from ..contact import LoadState
from ..face.piece_flow import Failed, FlowSettings, SolverCounts, attempt
from ..face.step_fields import ContactValues
from ..seal import RectangularSeal
from .face_flow import FaceFlow, resolved_flow
from .fluid_coupling import CoupledContact
from .scene import Scene


@dataclass(frozen=True, eq=False)
class FaceState:
    """The contact of the whole face at one step, and the flow through it.

    gap : (n1, n2) [m]. in_contact : the pressure. plastic : a bit for every pixel at the hardness.
    potential : of the flow, 1 at the inlet and 0 at the outlet, NaN in contact and in pockets (n1, n2).
    rows : mean pressure of rows (n1,) [Pa]. carried : mean pressure that the fluid carries [Pa].
    permeability : of the face [m³], NaN where its flow failed, for the `failed` reason.
    """

    gap: NDArray[np.float32]
    in_contact: ContactValues
    plastic: NDArray[np.uint8]
    potential: NDArray[np.float32]
    rows: Array
    contact_fraction: float
    plastic_fraction: float
    mean_gap: float
    residual: float
    carried: float
    permeability: float
    solvers: SolverCounts
    failed: str = ""

    @classmethod
    def of(cls, state: LoadState, flow: FlowSettings) -> FaceState:
        """Solve the flow through the gap of a step."""
        contact = state.contact
        found: FaceFlow | Failed
        failed, carried = "", 0.0
        if isinstance(contact, CoupledContact):
            found, carried = contact.flow, contact.carried
        else:
            spacing = contact.half_space.spacing
            found = attempt(resolved_flow, contact.gap, spacing, flow, with_potential=True)
        if isinstance(found, Failed):
            failed = found.reason
            found = FaceFlow(np.nan, SolverCounts())
        potential = np.full(contact.gap.shape, np.nan, np.float32)
        if found.potential is not None:
            potential[...] = found.potential
        return cls(
            gap=contact.gap.astype(np.float32),
            in_contact=ContactValues.of(contact.pressure),
            plastic=np.packbits(contact.plastic),
            potential=potential,
            rows=contact.pressure.mean(axis=1),
            contact_fraction=contact.area_fraction,
            plastic_fraction=contact.plastic_fraction,
            mean_gap=contact.mean_gap,
            residual=contact.residual,
            carried=carried,
            permeability=found.permeability,
            solvers=found.solvers,
            failed=failed,
        )


def face_states(scene: Scene, memory: float, mapper: Mapper) -> Iterator[FaceState]:
    """The state of the face at every step; arguments as in `Scene.contact_states`."""
    return scene.contact_states(
        partial(FaceState.of, flow=scene.flow), memory=memory, mapper=mapper
    )


def leakage_of_state(scene: Scene, state: FaceState) -> tuple[float, SolverCounts]:
    """Leakage per length of the face in a state [m²/s], NaN where its flow failed, and all systems solved for it."""
    if state.failed:
        return np.nan, state.solvers
    through = scene.leakage(RectangularSeal(scene.surface.size, (1, 1)), state.permeability)
    return through.per_length, state.solvers + SolverCounts.of(through)


def put_state_aside(
    state: FaceState, s: int, gap: NDArray[np.float32], potential: NDArray[np.float32]
) -> FaceState:
    """The state of step s with its large fields in those of all steps, which may lie on disk, and its contact there."""
    gap[s], potential[s] = state.gap, state.potential
    for field in (gap, potential):
        give_back(field)
    plastic = put_aside(state.plastic) if lies_on_disk(gap.nbytes) else state.plastic
    in_contact = state.in_contact.put_aside(gap)
    return replace(
        state, gap=gap[s], potential=potential[s], in_contact=in_contact, plastic=plastic
    )


def band_breadth(row_pressure: Array, spacing: float) -> Array:
    """Distance of the first row in contact from the last, both included (steps,) [m]; row_pressure (steps, n1) [Pa]."""
    touching = row_pressure > 0
    n1 = touching.shape[1]
    between = n1 - touching.argmax(axis=1) - touching[:, ::-1].argmax(axis=1)
    return np.where(touching.any(axis=1), between, 0) * spacing

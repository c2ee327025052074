"""Contact of a whole face at every step of its load programme, and the same cut into pieces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Mapper
from ..base.shared_array import give_back, one_at_a_time, shared_empty
from ..contact import LoadState
from ..topography import Topography
from ..windows import Failed, FlowSettings, Partition, attempt
from ..windows.partition import ContactPressure, ContactValues, WindowFields
from .face_flow import FaceFlow, drop_fractions, resolved_flow
from .face_leakage import FaceLeakage, face_leakage
from .fluid_coupling import CoupledContact
from .scene import Scene

#: Wavelength below which the valleys of a face do not shape its partition, in window sides.
CUT_OFF_WINDOWS = 0.25


@dataclass(frozen=True, eq=False)
class WindowContacts:
    """Contact of a whole face along a cycle, cut into pieces; arrays (steps, m1, m2) as in `TwoScaleResult`.

    row_pressure : mean contact pressure of rows of pixels (steps, n1) [Pa]. carried_pressure : mean pressure that the
    fluid carries (steps,) [Pa]. drop_fraction : of the pressure drop; NaN where no flow was solved. unsolved : steps
    without a gap, where the faces part, by their number, and why.
    """

    fields: WindowFields
    pressure: Array
    mean_gap: Array
    contact_fraction: Array
    plastic_fraction: Array
    drop_fraction: Array
    row_pressure: Array
    carried_pressure: Array | None = None
    unsolved: tuple[tuple[int, str], ...] = ()
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    contact: ClassVar[str] = "whole"


def face_partition(surface: Topography, cells: tuple[int, int]) -> Partition:
    """The pieces of a face, and the lines of nodes in the valleys of its long waves."""
    size = Partition(surface.shape, surface.spacing, cells).window_size
    return Partition.through_valleys(surface, cells, CUT_OFF_WINDOWS * min(size))


def chosen_contact(contact: str | None, shape: tuple[int, int]) -> str:
    """How the contact of a face is solved."""
    return "whole"


def solve_windows(
    scene: Scene, cells: tuple[int, int], contact: str | None = None, *, mapper: Mapper = map
) -> WindowContacts:
    """Solve the contact of the whole face, and divide it into pieces."""
    partition = face_partition(scene.surface, cells)
    return cut_contact(scene, partition, solve_face(scene, partition, scene.acting_fluid is not None, mapper=mapper))


@dataclass(frozen=True, eq=False)
class FaceStates:
    """Contact of the whole face at every step: gap (steps, n1, n2) [m], states, and leakage where flow was solved."""

    gap: NDArray[np.float32]
    states: Sequence[FaceState]
    through: FaceLeakage | None


def solve_face(
    scene: Scene, partition: Partition, with_flow: bool, *, memory: float | None = None, mapper: Mapper
) -> FaceStates:
    """Solve the contact of the whole face at every step, and the flow through it where asked for.

    Where the states are large they lie on disk, see `shared_array`, and one takes memory.
    """
    gap = shared_empty((len(scene.steps), *scene.surface.shape), np.float32)
    states: list[FaceState] = []
    take = partial(FaceState.of, partition=partition, flow=scene.flow if with_flow else None)

    def flows() -> Iterator[Any]:
        """Flow of every step; gap and contact are put aside."""
        for s, state in enumerate(scene.contact_states(take, memory=memory, mapper=mapper)):
            gap[s] = state.gap
            failed = state.flow.reason if isinstance(state.flow, Failed) else ""
            kept = ContactValues.put_aside(state.in_contact, gap)
            states.append(replace(state, gap=gap[s], in_contact=kept, flow=None, failed=failed))
            give_back(gap)
            yield state.flow

    if with_flow:
        return FaceStates(gap, states, face_leakage(scene, flows()))
    for _ in flows():
        pass
    return FaceStates(gap, states, None)


@dataclass(frozen=True, eq=False)
class FaceState:
    """The contact of the whole face at one step, cut into pieces, and the flow through it.

    gap : (n1, n2) [m]. in_contact : the pressure of every piece. means : pressure [Pa], fraction in contact, fraction
    at the hardness and fraction of the pressure drop of every piece (4, m1, m2). rows : mean pressure of rows (n1,)
    [Pa]. facts : fraction in contact, fraction at the hardness, mean gap [m] and residual of the whole face, and the
    mean pressure that the fluid carries [Pa]. flow : None unless asked for. failed : why there is none.
    """

    gap: NDArray[np.float32]
    in_contact: tuple[ContactValues, ...]
    means: Array
    rows: Array
    facts: tuple[float, float, float, float, float]
    flow: FaceFlow | Failed | None
    failed: str = ""

    @classmethod
    def of(cls, state: LoadState, partition: Partition, flow: FlowSettings | None = None) -> FaceState:
        """Cut the contact of a step into pieces, and solve the flow through its gap where `flow` says how."""
        contact = state.contact
        p, spacing = contact.pressure, contact.half_space.spacing
        found, carried = None, 0.0
        if isinstance(contact, CoupledContact):
            found, carried = contact.flow, contact.carried
        elif flow is not None:
            found = attempt(resolved_flow, contact.gap, spacing, flow, with_potential=True)
        fractions = np.full(partition.cells, np.nan)
        if flow is not None and isinstance(found, FaceFlow) and (potential := found.potential) is not None:
            of_pixels = drop_fractions(contact.gap, spacing, potential, flow)
            fractions = partition.cell_means(of_pixels) * np.prod(partition.window)
            found = replace(found, potential=potential.astype(np.float32))
        return cls(
            gap=contact.gap.astype(np.float32),
            in_contact=tuple(ContactValues.of(partition.cell(p, *place)) for place in partition.places),
            means=np.array([*(partition.cell_means(of) for of in (p, p > 0, contact.plastic)), fractions]),
            rows=p.mean(axis=1),
            facts=(contact.area_fraction, contact.plastic_fraction, contact.mean_gap, contact.residual, carried),
            flow=found,
        )


def band_breadth(row_pressure: Array, spacing: float) -> Array:
    """Distance of the first row in contact from the last, both included (steps,) [m]; row_pressure (steps, n1) [Pa]."""
    touching = row_pressure > 0
    n1 = touching.shape[1]
    between = n1 - touching.argmax(axis=1) - touching[:, ::-1].argmax(axis=1)
    return np.where(touching.any(axis=1), between, 0) * spacing


def cut_contact(scene: Scene, partition: Partition, face: FaceStates) -> WindowContacts:
    """The contact of the pieces of a face."""
    gap, states = face.gap, face.states
    pressure, contact_fraction, plastic_fraction, drop_fraction = np.array([s.means for s in states]).swapaxes(0, 1)
    # the fields of every piece at all steps
    in_contact = tuple(zip(*(state.in_contact for state in states), strict=True))
    coupled = scene.acting_fluid is not None
    return WindowContacts(
        fields=WindowFields(scene.steps, partition, gap, ContactPressure(partition, in_contact)),
        pressure=pressure,
        mean_gap=np.array([partition.cell_means(g) for g in one_at_a_time(gap)]),
        contact_fraction=contact_fraction,
        plastic_fraction=plastic_fraction,
        drop_fraction=drop_fraction,
        row_pressure=np.array([state.rows for state in states]),
        carried_pressure=np.array([state.facts[-1] for state in states]),
        unsolved=tuple((s, state.failed) for s, state in enumerate(states) if state.failed and coupled),
    )

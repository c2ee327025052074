"""Contact of all windows of a face: cut from that of the whole face where that is affordable, else by windows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import floor, log2
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.machine import total_memory
from ..base.shared_array import give_back, one_at_a_time, shared_empty
from ..base.stage import Mapper
from ..contact import LoadState
from ..windows import Failed, FlowSettings, Partition, attempt
from ..windows.window_fields import ContactPressure, ContactValues, WindowFields
from .choices import CONTACTS
from .face_flow import FaceFlow, resolved_flow
from .face_leakage import FaceLeakage, face_leakage
from .fluid_coupling import CoupledContact
from .scene import Array, Scene
from .window_contacts import WindowContacts, face_partition, windows_contact

#: Memory of the contact of a whole face, whose states may lie on disk, and how much of a machine's it may take
#: [byte per pixel, 1]. Measured on 512² to 2048² pixels, it takes 0.5 to 1.9 times as long as windows.
_WHOLE_BYTES, _PART_OF_MEMORY = 150.0, 0.8


def whole_pixels() -> int:
    """Largest number of pixels of a face whose contact is solved as a whole unless chosen otherwise.

    A power of two, so that machines of about the same memory choose alike: 8192² pixels for 13 to 25 GB.
    """
    return int(2 ** floor(log2(_PART_OF_MEMORY * total_memory() / _WHOLE_BYTES)))


def chosen_contact(contact: str | None, shape: tuple[int, int]) -> str:
    """The contact given, or the one that suits the number of pixels of a face and the memory of the machine.

    Raises
    ------
    InputError : a contact that does not exist.
    """
    if contact is None:
        return "whole" if shape[0] * shape[1] <= whole_pixels() else "windows"
    if contact not in CONTACTS:
        raise InputError("contact", contact, f"one of {', '.join(CONTACTS)}")
    return contact


def solve_windows(
    scene: Scene, cells: tuple[int, int], contact: str | None = None, *, mapper: Mapper = map
) -> WindowContacts:
    """Solve the contact of a face and divide it into windows.

    Parameters
    ----------
    contact : "whole": the contact of the whole face at full resolution, as in the deterministic study, cut into
        windows. "windows": the contact of each window, under the mean pressure that the contact of the low-pass face
        gives it (Pérez-Ràfols et al., 2018); its error is estimated, see `windows.gap_error`. Unless given, "whole" up
        to `whole_pixels`.
    """
    if chosen_contact(contact, scene.contact_shape) == "windows":
        return windows_contact(scene, cells, mapper)
    return _whole_contact(scene, cells, mapper)


def _whole_contact(scene: Scene, cells: tuple[int, int], mapper: Mapper) -> WindowContacts:
    """Solve the contact of the whole face at every step and cut it into windows."""
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
    """The contact of the whole face at one step, cut into windows, and the flow through it.

    gap : (n1, n2) [m]. in_contact : the pressure of every window. means : pressure [Pa], fraction in contact and
    fraction at the hardness of every window (3, m1, m2). rows : mean pressure of rows (n1,) [Pa]. facts : fraction in
    contact, fraction at the hardness, mean gap [m] and residual of the whole face, and the mean pressure that the fluid
    carries [Pa]. flow : None unless asked for. failed : why there is none.
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
        """Cut the contact of a step into windows, and solve the flow through its gap where `flow` says how."""
        contact = state.contact
        p, spacing = contact.pressure, contact.half_space.spacing
        found, carried = None, 0.0
        if isinstance(contact, CoupledContact):
            found, carried = contact.flow, contact.carried
        elif flow is not None:
            found = attempt(resolved_flow, contact.gap, spacing, flow, with_potential=True)
        return cls(
            gap=contact.gap.astype(np.float32),
            in_contact=tuple(ContactValues.of(partition.cell(p, *place)) for place in partition.places),
            means=np.array([partition.cell_means(values) for values in (p, p > 0, contact.plastic)]),
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
    """The contact of windows from that of the whole face."""
    gap, states = face.gap, face.states
    pressure, contact_fraction, plastic_fraction = np.array([state.means for state in states]).swapaxes(0, 1)
    # the fields of every window at all steps
    in_contact = tuple(zip(*(state.in_contact for state in states), strict=True))
    return WindowContacts(
        contact="whole",
        fields=WindowFields(scene.steps, partition, gap, ContactPressure(partition, in_contact)),
        gap_error=np.zeros(len(states)),
        gap_effect=np.ones(len(states)),
        pressure=pressure,
        mean_gap=np.array([partition.cell_means(g) for g in one_at_a_time(gap)]),
        contact_fraction=contact_fraction,
        plastic_fraction=plastic_fraction,
        row_pressure=np.array([state.rows for state in states]),
        carried_pressure=np.array([state.facts[-1] for state in states]),
        through=None if scene.acting_fluid is None else face.through,
        unsolved=tuple(
            (s, state.failed) for s, state in enumerate(states) if state.failed and scene.acting_fluid is not None
        ),
    )

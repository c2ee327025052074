"""Contact of all windows of a face: cut from that of the whole face where that is affordable, else by windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.shared_array import shared_empty
from ..base.stage import Mapper
from ..contact import Contact, HalfSpace, LoadState, load_states
from ..windows import Partition
from ..windows.window_fields import ContactPressure, ContactValues, WindowFields
from .scene import Array, Scene
from .windows import WindowContacts, face_partition, windows_contact

#: How the contact of windows is solved, see `solve_windows`.
CONTACTS = ("whole", "windows")
#: Largest number of pixels of a face whose contact is solved as a whole unless told otherwise: that of 4096², which
#: takes 2.7 GB. Measured on 512² to 2048² pixels, it takes 0.5 to 1.9 times as long as windows.
WHOLE_PIXELS = 2**24


def chosen_contact(contact: str | None, shape: tuple[int, int]) -> str:
    """The contact given, or the one that suits the number of pixels of a face.

    Raises
    ------
    InputError : a contact that does not exist.
    """
    if contact is None:
        return "whole" if shape[0] * shape[1] <= WHOLE_PIXELS else "windows"
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
        to `WHOLE_PIXELS`.
    """
    if chosen_contact(contact, scene.surface.shape) == "windows":
        return windows_contact(scene, cells, mapper)
    return _whole_contact(scene, cells, mapper)


def _whole_contact(scene: Scene, cells: tuple[int, int], mapper: Mapper) -> WindowContacts:
    surface, steps = scene.surface, scene.steps
    partition = face_partition(surface, cells)
    gap = shared_empty((len(steps), *surface.shape), np.float32)
    half_space = HalfSpace(surface.shape, surface.spacing, scene.modulus, scene.boundary)
    states = load_states(
        surface.heights.max() - surface.heights,
        half_space,
        steps,
        hardness=scene.hardness,
        rtol=scene.rtol,
        take=partial(_whole_state, partition=partition),
        mapper=mapper,
    )
    cuts = []
    for s, (whole, cut) in enumerate(states):
        gap[s] = whole
        cuts.append(cut)
    return from_whole(scene, partition, gap, cuts)


@dataclass(frozen=True, eq=False)
class CutState:
    """The contact of the whole face at one step, cut into windows.

    in_contact : the pressure of every window. means : pressure [Pa], share in contact and share at the hardness of
    every window (3, m1, m2).
    """

    in_contact: tuple[ContactValues, ...]
    means: Array

    @classmethod
    def of(cls, contact: Contact, partition: Partition) -> CutState:
        """Cut a contact."""
        p = contact.pressure
        return cls(
            in_contact=tuple(ContactValues.of(partition.cell(p, *place)) for place in partition.places),
            means=np.array([partition.cell_means(values) for values in (p, p > 0, contact.plastic)]),
        )


def from_whole(
    scene: Scene, partition: Partition, gap: NDArray[np.float32], cuts: Sequence[CutState]
) -> WindowContacts:
    """The contact of windows from that of the whole face: gap (steps, n1, n2) [m], and what was cut at every step."""
    pressure, contact_fraction, plastic_fraction = np.array([cut.means for cut in cuts]).swapaxes(0, 1)
    # the fields of every window at all steps
    in_contact = tuple(zip(*(cut.in_contact for cut in cuts), strict=True))
    return WindowContacts(
        contact="whole",
        fields=WindowFields(scene.steps, partition, gap, ContactPressure(partition, in_contact)),
        gap_error=np.zeros(len(cuts)),
        gap_effect=np.ones(len(cuts)),
        pressure=pressure,
        mean_gap=np.array([partition.cell_means(g) for g in gap]),
        contact_fraction=contact_fraction,
        plastic_fraction=plastic_fraction,
    )


def _whole_state(state: LoadState, partition: Partition) -> tuple[NDArray[np.float32], CutState]:
    return state.contact.gap.astype(np.float32), CutState.of(state.contact, partition)

"""Contact of a whole face and the flow through it at every step of its load programme, and the same cut into pieces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Mapper
from ..base.shared_array import give_back, shared_empty
from ..contact import LoadState
from ..face.contact_pressure import ContactValues
from ..face.piece_flow import Failed, FlowSettings, attempt
from ..face.pieces import Cut
from .face_flow import FaceFlow, drop_fractions, resolved_flow
from .face_leakage import FaceLeakage, face_leakage
from .fluid_coupling import CoupledContact
from .scene import Scene


@dataclass(frozen=True, eq=False)
class PieceContacts:
    """Contact of a whole face in its pieces; arrays (steps, m1, m2) as in `TwoScaleResult`.

    drop_fraction : of the pressure drop; NaN where no flow was solved. unsolved : steps without a gap, where the faces
    part, by their number, and why.
    """

    cut: Cut
    pressure: Array
    mean_gap: Array
    contact_fraction: Array
    plastic_fraction: Array
    drop_fraction: Array
    unsolved: tuple[tuple[int, str], ...] = ()

    @classmethod
    def of(cls, cut: Cut, states: Sequence[FaceState], coupled: bool) -> PieceContacts:
        """The pieces of a face in its states; with a fluid that is `coupled` faces part where a flow failed."""
        unsolved = tuple((s, state.failed) for s, state in enumerate(states) if state.failed and coupled)
        pressure, gap, contact, plastic, drop = np.array([state.pieces for state in states]).swapaxes(0, 1)
        return cls(cut, pressure, gap, contact, plastic, drop, unsolved)


@dataclass(frozen=True, eq=False)
class FaceStates:
    """Contact of the whole face at every step: gap (steps, n1, n2) [m], read-only, states, and leakage."""

    gap: NDArray[np.float32]
    states: Sequence[FaceState]
    through: FaceLeakage


def solve_face(scene: Scene, cut: Cut | None, *, memory: float, mapper: Mapper) -> FaceStates:
    """Solve the contact of the whole face at every step, and the flow through it.

    Where the states are large they lie on disk, see `shared_array`, and one takes memory.
    """
    gap = shared_empty((len(scene.steps), *scene.surface.shape), np.float32)
    states: list[FaceState] = []
    take = partial(FaceState.of, cut=cut, flow=scene.flow)

    def flows() -> Iterator[Any]:
        """Flow of every step; gap and contact are put aside."""
        for s, state in enumerate(scene.contact_states(take, memory=memory, mapper=mapper)):
            gap[s] = state.gap
            failed = state.flow.reason if isinstance(state.flow, Failed) else ""
            kept = state.in_contact.put_aside(gap)
            states.append(replace(state, gap=gap[s], in_contact=kept, flow=None, failed=failed))
            give_back(gap)
            yield state.flow

    through = face_leakage(scene, flows())
    gap.flags.writeable = False
    return FaceStates(gap, states, through)


@dataclass(frozen=True, eq=False)
class FaceState:
    """The contact of the whole face at one step, and the flow through it.

    gap : (n1, n2) [m]. in_contact : the pressure. rows : mean pressure of rows (n1,) [Pa].
    pieces : pressure [Pa], gap [m], fraction in contact, fraction at the hardness and fraction of the pressure drop of
    every piece (5, m1, m2); None without pieces.
    facts : fraction in contact, fraction at the hardness, mean gap [m] and residual of the whole face, and the mean
    pressure that the fluid carries [Pa]. flow : until the leakage is known. failed : why there is none.
    """

    gap: NDArray[np.float32]
    in_contact: ContactValues
    rows: Array
    pieces: Array | None
    facts: tuple[float, float, float, float, float]
    flow: FaceFlow | Failed | None
    failed: str = ""

    @classmethod
    def of(cls, state: LoadState, cut: Cut | None, flow: FlowSettings) -> FaceState:
        """Solve the flow through the gap of a step, and cut its contact into pieces."""
        contact = state.contact
        p, spacing = contact.pressure, contact.half_space.spacing
        found: FaceFlow | Failed
        if isinstance(contact, CoupledContact):
            found, carried = contact.flow, contact.carried
        else:
            found, carried = attempt(resolved_flow, contact.gap, spacing, flow, with_potential=True), 0.0
        pieces, fractions = None, None
        if isinstance(found, FaceFlow) and (potential := found.potential) is not None:
            if cut is not None:
                fractions = cut.sums(drop_fractions(contact.gap, spacing, potential, flow))
            found = replace(found, potential=potential.astype(np.float32))
        if cut is not None:
            means = [cut.means(of) for of in (p, contact.gap, p > 0, contact.plastic)]
            pieces = np.array([*means, np.full(cut.shape, np.nan) if fractions is None else fractions])
        return cls(
            gap=contact.gap.astype(np.float32),
            in_contact=ContactValues.of(p),
            rows=p.mean(axis=1),
            pieces=pieces,
            facts=(contact.area_fraction, contact.plastic_fraction, contact.mean_gap, contact.residual, carried),
            flow=found,
        )


def band_breadth(row_pressure: Array, spacing: float) -> Array:
    """Distance of the first row in contact from the last, both included (steps,) [m]; row_pressure (steps, n1) [Pa]."""
    touching = row_pressure > 0
    n1 = touching.shape[1]
    between = n1 - touching.argmax(axis=1) - touching[:, ::-1].argmax(axis=1)
    return np.where(touching.any(axis=1), between, 0) * spacing

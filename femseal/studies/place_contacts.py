"""Contact of several measured places of a face, each by itself, as one contact."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..base.arrays import Array
from ..base.errors import InputError
from ..contact import Contact, ContactLaw, HalfSpace
from ..topography import Places
from ..windows import Failed, FlowSettings, attempt
from .face_flow import FaceFlow, resolved_flow
from .fluid_coupling import CoupledContact


def contact_of_places(
    gap0: Array,
    half_space: HalfSpace,
    *,
    places: Places,
    solve: Callable[..., Contact],
    flow: FlowSettings,
    hardness: ContactLaw,
    deformation: Array | None = None,
    **settings: Any,
) -> Contact:
    """Solve the contact of each place under the same pressure, and join them; other arguments are those of `solve`.

    A fluid that presses the places apart flows through the gap of all of them at last.

    Raises InputError: a law that differs from place to place. NotConverged : a contact failed.
    """
    if not hardness.is_uniform:
        raise InputError("hardness", "a law that differs from place to place", "the same everywhere in several places")
    former = [None] * len(places.widths) if deformation is None else places.divided(deformation)
    found = []
    for gap, left in zip(places.divided(gap0), former, strict=True):
        body = HalfSpace((gap.shape[0], gap.shape[1]), half_space.spacing, half_space.modulus, half_space.boundary)
        # gaps are counted from the highest point of the face
        lifted = np.ascontiguousarray(gap - gap.min())
        found.append(solve(lifted, body, hardness=hardness, deformation=left, **settings))
    arrays = ("pressure", "gap", "plastic_deformation", "plastic")
    joined: dict[str, Any] = {name: np.concatenate([getattr(c, name) for c in found], axis=1) for name in arrays}
    joined |= {
        "approach": float(np.average([c.approach for c in found], weights=places.widths)),
        "residual": max(c.residual for c in found),
        "iterations": max(c.iterations for c in found),
        "fft_pairs": sum(c.fft_pairs for c in found),
        "half_space": half_space,
    }
    coupled = [c for c in found if isinstance(c, CoupledContact)]
    if not coupled:
        return Contact(**joined)
    carried = float(np.average([getattr(c, "carried", 0.0) for c in found], weights=places.widths))
    own: FaceFlow | Failed
    if failed := [c.flow for c in coupled if isinstance(c.flow, Failed)]:
        own = failed[0]
    else:
        own = attempt(resolved_flow, joined["gap"], half_space.spacing, flow, with_potential=True)
    return CoupledContact(**joined, flow=own, carried=carried, rounds=max(c.rounds for c in coupled))

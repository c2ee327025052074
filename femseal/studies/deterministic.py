"""Contact and flow of a whole face at full resolution."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..base.stage import Mapper
from ..base.text import Shown
from ..contact import HalfSpace, LoadState, load_states
from ..loads import LoadProgramme
from .scene import Array, Scene, labels, resolved_permeability


@dataclass(frozen=True, repr=False)
class DeterministicResult(Shown):
    """Everything resolved on the surface's own grid; arrays over the steps."""

    steps: LoadProgramme
    leakage: Array = field(
        metadata=labels(
            "m^2/s",
            "leakage per unit seal length, deterministic",
            "step",
            name="leakage_deterministic",
            heading="deterministic",
        )
    )
    contact_fraction: Array = field(
        metadata=labels("1", "share in contact, deterministic", "step", name="contact_fraction_deterministic")
    )
    plastic_fraction: Array = field(
        metadata=labels("1", "share at the hardness, deterministic", "step", name="plastic_fraction_deterministic")
    )
    mean_gap: Array = field(metadata=labels("m", "mean gap, deterministic", "step", name="mean_gap_deterministic"))
    gap: NDArray[np.float32] = field(metadata=labels("m", "deformed gap, deterministic", "step", "x1", "x2"))
    residual: float = 0.0
    failures: tuple[str, ...] = ()


def deterministic(scene: Scene, *, mapper: Mapper = map) -> DeterministicResult:
    """Contact and flow of the whole face at full resolution, each load state by itself.

    Parameters
    ----------
    mapper : how to solve states that do not depend on each other, in order.
    """
    surface = scene.surface
    half_space = HalfSpace(surface.shape, surface.spacing, scene.modulus, scene.boundary)
    gap0 = surface.heights.max() - surface.heights
    gap = np.empty((len(scene.steps), *surface.shape), np.float32)
    facts, k = [], []
    states = load_states(
        gap0,
        half_space,
        scene.steps,
        hardness=scene.hardness,
        rtol=scene.rtol,
        take=_resolved,
        memory=state_memory(gap0.size),
        mapper=mapper,
    )
    for s, taken in enumerate(states):
        gap[s], permeability, *others = taken
        k.append(permeability)
        facts.append(others)
    contact_fraction, plastic_fraction, mean_gap, residual = np.array(facts).T
    leakage, failures = scene.resolved_leakage(k)
    return DeterministicResult(
        steps=scene.steps,
        leakage=leakage,
        contact_fraction=contact_fraction,
        plastic_fraction=plastic_fraction,
        mean_gap=mean_gap,
        gap=gap,
        residual=float(residual.max()),
        failures=failures,
    )


def state_memory(pixels: int) -> float:
    """What contact and flow of a state take [byte], measured on 256² to 2048² pixels."""
    return 8.0 * pixels * (40 + 2.5 * np.log2(pixels))


def _resolved(state: LoadState) -> tuple[NDArray[np.float32], float | str, float, float, float, float]:
    """Gap, permeability of the face or why there is none, contact and plastic share, mean gap, residual."""
    contact = state.contact
    permeability = resolved_permeability(contact.gap, contact.half_space.spacing)
    facts = (contact.area_fraction, contact.plastic_fraction, contact.mean_gap, contact.residual)
    return contact.gap.astype(np.float32), permeability, *facts

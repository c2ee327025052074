"""Contact and flow of a whole face at full resolution."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..contact import HalfSpace, LoadStep, load_cycle
from ..showing import Shown
from .scene import Array, Map, Scene, labels, leakage_plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class DeterministicResult(Shown):
    """Everything resolved on the surface's own grid; arrays over the steps."""

    steps: tuple[LoadStep, ...]
    leakage: Array = field(metadata=labels("m^2/s", "leakage per unit seal length, deterministic", "step"))
    contact_fraction: Array = field(metadata=labels("1", "share in contact, deterministic", "step"))
    plastic_fraction: Array = field(metadata=labels("1", "share at the hardness, deterministic", "step"))
    mean_gap: Array = field(metadata=labels("m", "mean gap, deterministic", "step"))
    gap: NDArray[np.float32] = field(metadata=labels("m", "deformed gap, deterministic", "step", "x1", "x2"))
    residual: float = 0.0
    failures: tuple[str, ...] = ()

    def plot(self) -> Figure:
        """Leakage against nominal pressure."""
        return leakage_plot(self.steps, self.leakage, "deterministic")


def deterministic(scene: Scene, *, map: Map = map) -> DeterministicResult:
    """Contact and flow of the whole face at full resolution, step by step."""
    surface = scene.surface
    half_space = HalfSpace(surface.shape, surface.spacing, scene.modulus, scene.boundary)
    states = load_cycle(surface.heights.max() - surface.heights, half_space, **scene.cycle)
    leakage, failures = scene.resolved_leakage([s.contact.gap for s in states], map)
    return DeterministicResult(
        steps=tuple(LoadStep(s.pressure, s.unloaded_from) for s in states),
        leakage=leakage,
        contact_fraction=np.array([s.contact.area_fraction for s in states]),
        plastic_fraction=np.array([s.contact.plastic_fraction for s in states]),
        mean_gap=np.array([s.contact.mean_gap for s in states]),
        gap=np.array([s.contact.gap for s in states], np.float32),
        residual=max(s.contact.residual for s in states),
        failures=failures,
    )

"""Windows of a face between global nodes: contact and flow at two scales."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..contact import HalfSpace, LoadStep
from ..scales import GlobalScale, Partition, WindowHistory, respond, solve_global_scale
from ..scales.response import body_standoff, flow_history, set_down
from ..seal import RectangularSeal
from ..topography import Topography
from .scene import Array, Map, Scene, labels


@dataclass(frozen=True)
class TwoScaleResult:
    """Windows of the surface between global nodes; arrays over steps and links."""

    steps: tuple[LoadStep, ...]
    partition: Partition
    leakage: Array = field(metadata=labels("m^2/s", "leakage per unit seal length, two-scale", "step"))
    k1: Array = field(metadata=labels("m^3", "permeability of links along x1", "step", "cell1", "cell2"))
    k2: Array = field(metadata=labels("m^3", "permeability of links along x2", "step", "corner1", "cell2"))
    pressure: Array = field(metadata=labels("Pa", "contact pressure of windows", "step", "cell1", "cell2"))
    mean_gap: Array = field(metadata=labels("m", "mean gap of windows", "step", "cell1", "cell2"))
    contact_fraction: Array = field(metadata=labels("1", "share of windows in contact", "step", "cell1", "cell2"))
    plastic_fraction: Array = field(metadata=labels("1", "share of windows at the hardness", "step", "cell1", "cell2"))
    fluid_pressure: Array = field(
        metadata=labels("Pa", "fluid pressure at the global nodes, NaN in pockets", "step", "node1", "cell2")
    )
    gap: NDArray[np.float32] = field(metadata=labels("m", "deformed gap stitched from the windows", "step", "x1", "x2"))
    contact_pressure: NDArray[np.float32] = field(
        metadata=labels("Pa", "contact pressure of the windows", "step", "x1", "x2")
    )
    counts: dict[str, int] = field(default_factory=dict)
    failures: tuple[str, ...] = ()


def two_scale(scene: Scene, cells: tuple[int, int], *, map: Map = map) -> TwoScaleResult:
    """Global contact of the low-pass face, contact of every window, links between global nodes, global flow.

    Contact is solved once for each cell, the gaps are stitched, and the windows of the x2-links are cut out of the
    stitched gap.
    """
    surface = scene.surface
    partition = Partition(surface.shape, surface.spacing, cells)
    world = global_scale(scene, partition)
    m1, m2 = cells
    histories = _window_contacts(scene, partition, world, map)
    gap, contact_pressure = _stitch(histories, cells, "gap"), _stitch(histories, cells, "pressure")
    tasks = [partition.cut(gap, i, j, 0) for i in range(m1) for j in range(m2)]
    flows1 = list(map(partial(flow_history, spacing=surface.spacing, axis=0), tasks))
    tasks = [partition.cut(gap, i, j, 1) for i in range(m1 - 1) for j in range(m2)]
    flows2 = list(map(partial(flow_history, spacing=surface.spacing, axis=1), tasks))
    k1 = np.array([f.permeability for f in flows1]).T.reshape(-1, m1, m2)
    k2 = np.array([f.permeability for f in flows2]).T.reshape(-1, m1 - 1, m2) if flows2 else np.empty((len(k1), 0, m2))
    seal = RectangularSeal(surface.size, cells)
    leakage, fluid_pressure = np.full(len(k1), np.nan), np.full((len(k1), m1 + 1, m2), np.nan)
    for s in range(len(k1)):
        if np.isfinite(k1[s]).all() and np.isfinite(k2[s]).all():
            result = scene.leakage(seal, (k1[s], k2[s]))
            leakage[s], fluid_pressure[s] = result.per_length, result.fluid_pressure

    def per_cell(name: str) -> Array:
        return np.array([getattr(h, name) for h in histories]).T.reshape(-1, m1, m2)

    failures = [f"cell {divmod(n, m2)}, {t}" for n, h in enumerate(histories) for t in h.failures]
    failures += [f"x{a + 1}-link {divmod(n, m2)}, {t}" for a in (0, 1)
                 for n, f in enumerate((flows1, flows2)[a]) for t in f.failures]  # fmt: skip
    return TwoScaleResult(
        steps=world.steps,
        partition=partition,
        leakage=leakage,
        k1=k1,
        k2=k2,
        pressure=world.pressure,
        mean_gap=per_cell("mean_gap"),
        contact_fraction=per_cell("contact_fraction"),
        plastic_fraction=per_cell("plastic_fraction"),
        fluid_pressure=fluid_pressure,
        gap=gap,
        contact_pressure=contact_pressure,
        counts={name: sum(getattr(f, name) for f in flows1 + flows2) for name in ("solved", "closed", "open")},
        failures=tuple(failures),
    )


def global_scale(scene: Scene, partition: Partition) -> GlobalScale:
    """Contact of the low-pass face along the scene's cycle."""
    return solve_global_scale(scene.surface, partition, modulus=scene.modulus, boundary=scene.boundary, **scene.cycle)


def fine_waves(surface: Topography, cut_off: float) -> Array:
    """Undeformed gap of the waves shorter than the cut-off, mean plane at 0."""
    return surface.low_pass(cut_off).heights - surface.heights


def window_half_space(scene: Scene, partition: Partition, longest_wave: float | None) -> HalfSpace:
    """Body of a window, without the waves that the global contact carries; None keeps all."""
    return HalfSpace(
        partition.window, partition.spacing, scene.modulus, ("mirror", "mirror"), longest_wave=longest_wave
    )


def _window_contacts(scene: Scene, partition: Partition, world: GlobalScale, map: Map) -> list[WindowHistory]:
    """Fine waves on the global raw gap, under the window's global pressure; long waves respond globally only.

    Windows without pressure stand off as the asperities of the others make the whole body do.
    """
    m1, m2 = partition.cells
    gap0 = world.raw_gap + fine_waves(scene.surface, partition.cut_off)
    places = [(i, j) for i in range(m1) for j in range(m2)]
    task = partial(
        respond,
        steps=world.steps,
        half_space=window_half_space(scene, partition, partition.cut_off),
        hardness=scene.hardness,
        rigid_at_zero=True,
        rtol=scene.rtol,
    )
    gaps = (partition.cut(gap0, i, j) for i, j in places)
    histories = list(map(task, gaps, [world.pressure[:, i, j] for i, j in places]))
    standoff = body_standoff(histories)
    return [set_down(history, standoff) for history in histories]


def _stitch(histories: list[WindowHistory], cells: tuple[int, int], name: str) -> NDArray[np.float32]:
    """Fields (steps, n1, n2) from the windows' (steps, w1, w2), in the order of the cells."""
    windows = np.array([getattr(h, name) for h in histories])
    n_steps, w1, w2 = windows.shape[1:]
    grid = windows.reshape(*cells, n_steps, w1, w2)
    return np.ascontiguousarray(grid.transpose(2, 0, 3, 1, 4)).reshape(n_steps, cells[0] * w1, cells[1] * w2)

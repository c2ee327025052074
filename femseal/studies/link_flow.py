"""What flows through the links of two scales, and the fields in a few of their windows at every pixel."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Mapper, Stage
from ..base.fields import LINK1, LINK2, NARROWEST_LINKS, PIXEL, declared
from ..flow import cell_permeability
from ..flow.solution import FIELD_RTOL
from ..seal import NARROWEST, RectangularSeal, drop_fractions
from ..windows import Failed, attempt
from .scene import Scene
from .two_scale import TwoScaleResult

Single = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class LinkFlow:
    """Flow per width through every link at the fluid's reference density; 0 in pockets, NaN where a window failed."""

    along: Array = declared("flux1", "m^2/s", "flow per width through links along x1", LINK1)
    across: Array | None = declared("flux2", "m^2/s", "flow per width through links along x2", LINK2)
    drop_fraction: Array = declared(
        "drop_fraction",
        "1",
        "fraction of the pressure drop over the links that dissipate most, NaN without flow",
        NARROWEST_LINKS,
    )


def link_flow(scene: Scene, result: TwoScaleResult) -> LinkFlow | None:
    """Flow through the links of a study, and how much of the pressure drop a few of them take; None without links."""
    if result.k1 is None or result.k2 is None or result.fluid_pressure is None:
        return None
    rows, (m1, m2) = np.array(result.partition.node_rows), result.partition.cells
    # the fluid pressure in a pocket is undefined, and its flux is 0
    pocket = np.isnan(result.fluid_pressure) & np.isfinite(result.leakage)[:, None, None]
    pressure = np.where(pocket, scene.outlet_pressure, result.fluid_pressure)
    potential = scene.fluid.potential(pressure) / scene.fluid.reference_density
    along = result.k1 * (potential[:, :-1] - potential[:, 1:]) / np.diff(rows)[:, None]
    across = result.k2 * (potential - np.roll(potential, -1, axis=2))[:, 1:-1] / result.partition.window_size[1]
    seal = RectangularSeal(scene.surface.size, (m1, m2), result.partition.node_rows)
    fractions = np.full((len(result.steps), len(NARROWEST)), np.nan)
    for s in np.flatnonzero(np.isfinite(result.fluid_pressure[:, 0]).all(axis=1)):  # NaN where a link failed
        fractions[s] = drop_fractions(result.k1[s], result.k2[s], seal, potential[s])
    return LinkFlow(along, across if m1 > 1 else None, fractions)


@dataclass(frozen=True, eq=False)
class WindowPixels:
    """Fields in the window of an x1-link, from one row of nodes to the next, at every pixel and load step.

    window : its row and column. spacing : of the pixels, origin : of the first one's corner on the face [m].
    """

    window: tuple[int, int]
    spacing: tuple[float, float]
    origin: tuple[float, float]
    gap: Single = declared("gap", "m", "gap", PIXEL)
    contact_pressure: Single = declared("contact_pressure", "Pa", "contact pressure", PIXEL)
    fluid_pressure: Single = declared("fluid_pressure", "Pa", "fluid pressure, NaN in contact", PIXEL)


def chosen_windows(k1: Array, pressure: Array) -> list[tuple[int, int]]:
    """Windows with the largest, median and smallest k1 > 0 at the highest load at which any window is open.

    k1 : (steps, m1, m2). pressure : nominal pressure of the steps.
    """
    open_ = (np.nan_to_num(k1) > 0).any(axis=(1, 2))
    if not open_.any():
        return [(k1.shape[1] // 2, k1.shape[2] // 2)]
    k = np.nan_to_num(k1[int(np.argmax(np.where(open_, pressure, -1.0)))]).ravel()
    order = np.flatnonzero(k > 0)[np.argsort(k[k > 0])]
    pick = dict.fromkeys(int(order[n]) for n in (-1, order.size // 2, 0))
    return [(n // k1.shape[2], n % k1.shape[2]) for n in pick]


def window_pixels(scene: Scene, result: TwoScaleResult, mapper: Mapper = map) -> tuple[WindowPixels, ...]:
    """Gap, contact pressure and fluid pressure in the windows of `chosen_windows`; none without links.

    The flow through the gap of each of them is solved at every load step, between the pressures of its two nodes.
    """
    if result.k1 is None or result.fluid_pressure is None:
        return ()
    chosen = chosen_windows(result.k1, scene.steps.pressures)
    partition, count = result.partition, len(result.steps)
    gaps = [partition.link(result.gap, i, j, 0) for i, j in chosen]
    stage = Stage("close windows", partial(_drop, spacing=partition.spacing))
    drops = list(mapper(stage, [gap[s] for gap in gaps for s in range(count)]))
    found = []
    for n, (i, j) in enumerate(chosen):
        (d1, d2), first = partition.spacing, partition.rows(0)[i][0]
        ends = scene.fluid.potential(result.fluid_pressure[:, i : i + 2, j])
        pressures = [_pressure(scene, drops[n * count + s], ends[s]) for s in range(count)]
        found.append(
            WindowPixels(
                window=(i, j),
                spacing=partition.spacing,
                origin=(first * d1, j * partition.window[1] * d2),
                gap=np.asarray(gaps[n], np.float32),
                contact_pressure=np.asarray(partition.link(result.contact_pressure, i, j, 0), np.float32),
                fluid_pressure=np.array(pressures, np.float32),
            )
        )
    return tuple(found)


def _drop(gap: Single, spacing: tuple[float, float]) -> Array:
    """Fraction of the drop of potential that is left at every pixel; NaN for a window that failed."""
    flow = attempt(cell_permeability, gap, spacing, field_rtol=FIELD_RTOL) if np.isfinite(gap).all() else None
    return np.full(gap.shape, np.nan) if flow is None or isinstance(flow, Failed) else flow.fluid_pressure


def _pressure(scene: Scene, left: Array, ends: Array) -> Array:
    """Fluid pressure at the pixels of a window between the potentials of its two nodes."""
    # the pressure of an end in a pocket is undefined and has no effect on the fluid at the other end
    mixed = np.where(left == 1, ends[0], ends[1] + (ends[0] - ends[1]) * left)
    return scene.fluid.pressure(np.where(left == 0, ends[1], mixed))

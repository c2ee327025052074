"""Windows of a face between global nodes: contact and flow at two scales."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.shared_array import shared_empty
from ..base.stage import Mapper, Stage
from ..base.text import Shown
from ..contact import HalfSpace
from ..contact.complement import FieldOverSteps, gap_part, pressure_part
from ..flow.percolation import percolates
from ..loads import LoadProgramme
from ..scales import GlobalState, Partition, respond
from ..scales.window import FlowHistory, WindowHistory, body_standoff, flow_history, set_down
from ..topography import Topography
from .scene import Array, Scene, labels, resolved_permeability

#: Wavelength that divides the scales, in window sides: longer ones lose the pressure of features within windows.
CUT_OFF_WINDOWS = 0.25
FLOWS = ("links", "resolved")
#: Share of the fine waves' rms in profiles along either axis above which windows do not resolve the ridges of a face.
#: Measured on turned faces: 0.3 goes with factors of 1.1, 0.38 with 1.2 to 1.7, 0.55 with 1.5 to 4; self-affine 0.1.
RIDGE_WARNING = 0.35


@dataclass(frozen=True, repr=False)
class TwoScaleResult(Shown):
    """Windows of the surface between global nodes; arrays over steps and links."""

    steps: LoadProgramme
    partition: Partition = field(repr=False)
    flow: str
    leakage: Array = field(
        metadata=labels(
            "m^2/s", "leakage per unit seal length, two-scale", "step", name="leakage_two_scale", heading="two-scale"
        )
    )
    k1: Array = field(metadata=labels("m^3", "permeability of links along x1", "step", "cell1", "cell2"))
    k2: Array = field(metadata=labels("m^3", "permeability of links along x2", "step", "corner1", "cell2"))
    pressure: Array = field(
        metadata=labels("Pa", "contact pressure of windows", "step", "cell1", "cell2", name="window_pressure")
    )
    mean_gap: Array = field(
        metadata=labels("m", "mean gap of windows", "step", "cell1", "cell2", name="window_mean_gap")
    )
    contact_fraction: Array = field(
        metadata=labels("1", "share of windows in contact", "step", "cell1", "cell2", name="window_contact_fraction")
    )
    plastic_fraction: Array = field(
        metadata=labels(
            "1", "share of windows at the hardness", "step", "cell1", "cell2", name="window_plastic_fraction"
        )
    )
    fluid_pressure: Array = field(
        metadata=labels("Pa", "fluid pressure at the global nodes, NaN in pockets", "step", "node1", "cell2")
    )
    gap: FieldOverSteps = field(metadata=labels("m", "deformed gap stitched from the windows", "step", "x1", "x2"))
    contact_pressure: FieldOverSteps = field(
        metadata=labels("Pa", "contact pressure of the windows", "step", "x1", "x2")
    )
    counts: dict[str, int] = field(default_factory=dict)
    failures: tuple[str, ...] = ()


def two_scale(scene: Scene, cells: tuple[int, int], *, flow: str = "links", mapper: Mapper = map) -> TwoScaleResult:
    """Global contact of the low-pass face, contact of every cell in it, and the flow through the stitched gap.

    Parameters
    ----------
    scene : what is loaded.
    cells : number of cells along x1 and x2.
    flow : "links": a permeability for each window between global nodes, then the flow through the links. "resolved":
        the flow through the stitched gap at full resolution, where that fits; the links are computed as well.
    mapper : how to compute a stage for all windows, in order.

    Raises
    ------
    InputError : another flow, or cells that do not suit the surface.
    """
    if flow not in FLOWS:
        raise InputError.of("flow", flow, f"one of {', '.join(FLOWS)}")
    surface = scene.surface
    contact = solve_windows(scene, cells, mapper=mapper)
    partition = contact.partition
    links = [solve_links(contact, axis, mapper=mapper) for axis in (0, 1)]
    k1, k2 = links[0].k, links[1].k
    seal = scene.layout.seal(surface.size, cells, partition.node_rows)
    leakage, fluid_pressure = np.full(len(k1), np.nan), np.full((len(k1), cells[0] + 1, cells[1]), np.nan)
    for s in range(len(k1)):
        if np.isfinite(k1[s]).all() and np.isfinite(k2[s]).all():
            result = scene.leakage(seal, (k1[s], k2[s]))
            leakage[s], fluid_pressure[s] = result.per_length, result.fluid_pressure
    failures = contact.failures + links[0].failures + links[1].failures
    if flow == "resolved":
        stage = Stage("flow of the whole face", partial(resolved_permeability, spacing=surface.spacing))
        whole = mapper(stage, contact.gap)
        leakage, failed = scene.resolved_leakage(whole)
        failures += failed
    else:
        failures += _wrongly_closed(contact, leakage)
    return TwoScaleResult(
        steps=contact.steps,
        partition=partition,
        flow=flow,
        leakage=leakage,
        k1=k1,
        k2=k2,
        pressure=contact.pressure,
        mean_gap=contact.mean_gap,
        contact_fraction=contact.contact_fraction,
        plastic_fraction=contact.plastic_fraction,
        fluid_pressure=fluid_pressure,
        gap=contact.gap,
        contact_pressure=contact.contact_pressure,
        counts={name: links[0].counts[name] + links[1].counts[name] for name in links[0].counts},
        failures=failures,
    )


@dataclass(frozen=True)
class WindowContacts:
    """Contact of all cells of a face along a cycle, stitched; arrays as in `TwoScaleResult`."""

    steps: LoadProgramme
    partition: Partition
    pressure: Array
    mean_gap: Array
    contact_fraction: Array
    plastic_fraction: Array
    gap: FieldOverSteps
    contact_pressure: FieldOverSteps
    failures: tuple[str, ...]


def solve_windows(scene: Scene, cells: tuple[int, int], *, mapper: Mapper = map) -> WindowContacts:
    """All waves of every cell, on the gap that the global pressure of the others leaves, under its own global pressure.

    Cells without pressure stand off as the asperities of the others make the whole body do.
    """
    surface = scene.surface
    cut_off = CUT_OFF_WINDOWS * min(Partition(surface.shape, surface.spacing, cells).window_size)
    partition = Partition.through_valleys(surface, cells, cut_off)
    body = HalfSpace(partition.window, partition.spacing, scene.modulus, ("mirror", "mirror"))
    fine = fine_waves(surface, cut_off)
    failures = _unresolved_ridges(surface.heights + fine, fine, partition)
    fine = fine.astype(np.float32)
    # of each cell the gap that it starts from, and in its place gap − pressure once it is solved
    fields = shared_empty((len(scene.steps), *surface.shape), np.float32)
    pressures = []
    states = scene.global_states(
        partition, cut_off, take=partial(_outer, partition=partition, body=body), mapper=mapper
    )
    for s, (outer_gap, cell_pressure) in enumerate(states):
        fields[s] = outer_gap
        pressures.append(cell_pressure)
    pressure = np.array(pressures)
    m1, m2 = cells
    places = [(i, j) for i in range(m1) for j in range(m2)]
    solve = partial(
        _respond,
        steps=scene.steps,
        half_space=body,
        hardness=scene.hardness,
        rigid_at_zero=True,
        rtol=scene.rtol,
    )
    raw_gaps = (partition.cell(fields, i, j) for i, j in places)
    waves = (partition.cell(fine, i, j) for i, j in places)
    histories = mapper(Stage("contact of windows", solve), raw_gaps, waves, [pressure[:, i, j] for i, j in places])
    statistics = {
        name: np.empty((len(places), len(fields))) for name in ("standoff", "contact_fraction", "plastic_fraction")
    }
    for n, (place, history) in enumerate(zip(places, histories, strict=True)):
        partition.cell(fields, *place)[:] = history.gap_minus_pressure
        for name, values in statistics.items():
            values[n] = getattr(history, name)
        failures += [f"cell {place}, {text}" for text in history.failures]
    standoff = statistics.pop("standoff")
    lowest = np.array([partition.cell(fields, *place).min(axis=(1, 2)) for place in places])
    held_off = body_standoff(standoff, pressure.reshape(len(fields), -1).T, lowest)
    for n, s in np.argwhere(np.isnan(standoff) & np.isfinite(lowest)):
        window = partition.cell(fields[s], *places[n])
        window[:] = set_down(window, held_off[s])
    gap = FieldOverSteps(fields, gap_part)
    return WindowContacts(
        steps=scene.steps,
        partition=partition,
        pressure=pressure,
        mean_gap=np.array([partition.cell_means(g) for g in gap]),
        gap=gap,
        contact_pressure=FieldOverSteps(fields, pressure_part),
        failures=tuple(failures),
        **{name: values.T.reshape(-1, m1, m2) for name, values in statistics.items()},
    )


def _outer(state: GlobalState, partition: Partition, body: HalfSpace) -> tuple[NDArray[np.float32], Array]:
    return state.outer_gap(partition, body), state.pressure


def _respond(
    raw_gap: NDArray[np.float32], fine: NDArray[np.float32], pressures: Array, **settings: Any
) -> WindowHistory:
    """`respond` on the gap that a window's raw gaps (steps, n1, n2) and its fine waves make; it takes their place."""
    history = respond(np.add(raw_gap, fine, dtype=float), pressures, **settings)
    raw_gap[:] = history.gap_minus_pressure
    return replace(history, gap_minus_pressure=raw_gap)


@dataclass(frozen=True)
class LinkFlows:
    """Permeability of links along one axis (steps, rows, m2) [m³], and how many windows were solved or skipped."""

    k: Array
    counts: dict[str, int]
    failures: tuple[str, ...]


def solve_links(
    contact: WindowContacts | TwoScaleResult, axis: int, *, shift: int = 0, mapper: Mapper = map
) -> LinkFlows:
    """Permeability of the links' windows cut out of the stitched gap, all moved by `shift` pixels along x2."""
    partition, steps = contact.partition, len(contact.steps)
    places = [(i, j) for i in range(partition.cells[0] - axis) for j in range(partition.cells[1])]
    windows = (partition.link(contact.gap.stored, i, j, axis, shift) for i, j in places)
    stage = Stage("flow in windows", partial(_flow_history, axis=axis))
    # a list among the arguments, so that the mapper knows how many there are
    flows = list(mapper(stage, windows, [partition.spacing] * len(places)))
    k = np.array([f.permeability for f in flows]).reshape(-1, steps).T
    return LinkFlows(
        k=k.reshape(steps, -1, partition.cells[1]),
        counts={name: sum(getattr(f, name) for f in flows) for name in ("solved", "closed", "open")},
        failures=tuple(f"x{axis + 1}-link {p}, {t}" for p, f in zip(places, flows, strict=True) for t in f.failures),
    )


def _flow_history(difference: NDArray[np.float32], spacing: tuple[float, float], axis: int) -> FlowHistory:
    return flow_history(gap_part(difference), spacing, axis)


def _wrongly_closed(contact: WindowContacts, leakage: Array) -> tuple[str, ...]:
    """A warning where links and the gap that they are cut from do not agree whether anything flows."""
    warnings = []
    for said, other, flows in (("closed", "open", False), ("open", "closed", True)):
        names = [
            step.name
            for step, q, gap in zip(contact.steps, leakage, contact.gap, strict=True)
            if np.isfinite(q) and (q != 0) == flows != percolates(gap > 0)
        ]
        if names:
            more = f" and {len(names) - 1} more steps" if len(names) > 1 else ""
            warnings.append(
                f"links are {said} at {names[0]}{more} where the gap of the whole face is still {other}: near closing "
                'take larger windows, or flow = "resolved"'
            )
    return tuple(warnings)


def _unresolved_ridges(smooth: Array, fine: Array, partition: Partition) -> list[str]:
    """A warning where windows are too large for a form with a lay, which the global scale then carries in part only."""
    carried, share = (max(z.mean(axis=axis).std() for axis in (0, 1)) / (z.std() or 1.0) for z in (smooth, fine))
    if share <= RIDGE_WARNING or carried <= RIDGE_WARNING or not 0.05 < fine.std() / (smooth.std() or np.inf) < 1:
        return []
    size = " × ".join(f"{length * 1e6:.3g}" for length in partition.window_size)
    return [f"windows of {size} µm do not resolve the ridges of the face ({share:.0%} of what is left to them is in "
            "straight ridges): leakage may be off by a factor of 2; take smaller windows or more of them"]  # fmt: skip


def fine_waves(surface: Topography, cut_off: float) -> Array:
    """Undeformed gap of the waves shorter than the cut-off, mean plane at 0."""
    return surface.low_pass(cut_off).heights - surface.heights

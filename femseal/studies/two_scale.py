"""The two-scale study: contact and flow in the windows of a face, and over the whole face."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.stage import Mapper, Stage
from ..base.text import Shown
from ..elements.elements import ELEMENT_BYTES
from ..flow.percolation import percolates
from ..loads import LoadProgramme
from ..seal import RectangularSeal
from ..windows import Failed, Partition, SolveCounts, SolverCounts, attempt
from ..windows.window_fields import ContactPressure, WindowFields
from .deterministic import state_memory
from .element_face import flow_through_elements
from .face_contact import solve_windows
from .plausibility import scene_warnings
from .repeated_steps import first_equal, map_different, repeated
from .scene import Array, FaceFlow, FaceLeakage, Scene, labels, resolved_flow
from .windows import LinkFlows, WindowContacts, solve_links

FLOWS = ("links", "resolved", "elements")
#: Largest number of pixels of a face whose flow is resolved unless told otherwise: that of 2048².
RESOLVED_PIXELS = 2**22


def chosen_flow(flow: str | None, shape: tuple[int, int], discretisation: str = "edge") -> str:
    """The flow given, or the one that suits the number of pixels of a face.

    Elements are the resolved flow in a third of the memory and two to three times the time. They know links between
    pixels alone, which the discretisation "edge" has.

    Raises
    ------
    InputError : a flow that does not exist.
    """
    if flow is None:
        if shape[0] * shape[1] <= RESOLVED_PIXELS:
            return "resolved"
        return "elements" if discretisation == "edge" else "links"
    if flow not in FLOWS:
        raise InputError("flow", flow, f"one of {', '.join(FLOWS)}")
    return flow


@dataclass(frozen=True, repr=False)
class TwoScaleResult(Shown):
    """Contact and flow at two scales; arrays over steps, rows and columns of windows.

    partition : the windows. contact, flow : how they were solved, see `two_scale`. gap_error : estimate of the error of
        the contact, see `windows.gap_error`. gap_effect : the factor by which it changes the leakage: 1 where it is
        small, inf where the corrected gap is closed.
    element_error, drop_fraction : of the flow "elements", None with others. The leakage is then an upper bound of that
        resolved on the same gap, and the error is at most about 1e-3, see `elements.ElementFlow`.
    k1, k2, fluid_pressure : of the links and their nodes; None without "links". Of a rarefied gas, k1 and k2 are those
        at the pressures of the nodes, with which the flow is that of a viscous gas. link_flows : of the windows.
    face_fluid_pressure : at every pixel and step; None with "links".
    fields : deformed gap and contact pressure at every pixel.
    counts : flows of links, solved or known without solving. solvers : number of systems by solver, of links and over
    the face. equal_steps : number of steps that are an earlier one again, solved once. failures : reasons of values
    that are NaN. warnings : reasons to doubt the result.
    """

    steps: LoadProgramme
    partition: Partition = field(repr=False)
    flow: str
    contact: str
    leakage: Array = field(
        metadata=labels(
            "m^2/s", "leakage per unit seal length, two-scale", "step", name="leakage_two_scale", heading="two-scale"
        )
    )
    k1: Array | None = field(metadata=labels("m^3", "permeability of links along x1", "step", "cell1", "cell2"))
    k2: Array | None = field(metadata=labels("m^3", "permeability of links along x2", "step", "corner1", "cell2"))
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
    fluid_pressure: Array | None = field(
        metadata=labels("Pa", "fluid pressure at the global nodes, NaN in pockets", "step", "node1", "cell2")
    )
    face_fluid_pressure: NDArray[np.float32] | None = field(
        metadata=labels("Pa", "fluid pressure, NaN in contact and in pockets", "step", "x1", "x2")
    )
    fields: WindowFields
    gap_error: Array = field(
        metadata=labels("1", "error of the gap of windows, estimated by the half-space of the whole face", "step")
    )
    gap_effect: Array = field(
        metadata=labels("1", "leakage over that with the gap corrected by the half-space of the whole face", "step")
    )
    element_error: Array | None = field(
        default=None, metadata=labels("1", "estimated relative error of the leakage through elements", "step")
    )
    drop_fraction: Array | None = field(
        default=None,
        metadata=labels(
            "1", "share of windows in the pressure drop", "step", "cell1", "cell2", name="window_drop_fraction"
        ),
    )
    counts: SolveCounts = field(default_factory=SolveCounts)
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    solvers: SolverCounts = field(default_factory=SolverCounts)
    link_flows: tuple[LinkFlows, LinkFlows] | None = field(default=None, repr=False)
    equal_steps: int = 0

    @property
    def gap(self) -> NDArray[np.float32]:
        """Deformed gap stitched from the windows (steps, n1, n2) [m]; it is read-only."""
        return self.fields.gap

    @property
    def contact_pressure(self) -> ContactPressure:
        """Contact pressure of the windows (steps, n1, n2) [Pa], used like an array."""
        return self.fields.pressure


def two_scale(
    scene: Scene,
    cells: tuple[int, int],
    *,
    flow: str | None = None,
    contact: str | None = None,
    solved: WindowContacts | None = None,
    mapper: Mapper = map,
) -> TwoScaleResult:
    """Solve the contact of every cell, and the flow through the stitched gap.

    Parameters
    ----------
    scene : the face, its load and its fluid.
    cells : number of cells along x1 and x2.
    flow : "links": solve the permeability of each window between global nodes, then the flow through these links.
        "resolved": solve the flow through the stitched gap at full resolution, without links.
        "elements": condense the stitched gap of every window to an element with nodes on its sides, see
        `elements.element_flow`, without links: the same leakage within 1e-3 in a third of the memory. The
        discretisation has to be "edge".
        Unless given, "resolved" up to 2²² pixels, and "elements" beyond, or "links" with another discretisation.
    contact : "whole": cut the cells from the contact of the whole face. "windows": solve the contact of each cell
        under the mean pressure that the contact of the low-pass face gives it. Unless given, "whole" up to 2²⁴ pixels.
    solved : the contact of the same scene and cells, such as `deterministic` leaves; it is solved here unless given.
    mapper : computes a stage for many items, such as the builtin `map`; it may use several processes.

    Raises
    ------
    InputError : another flow or contact, or cells that do not suit the surface or `solved`.
    NotConverged : a global contact failed. Windows and flows that fail are NaN, and listed in `failures`.
    """
    flow = chosen_flow(flow, scene.surface.shape, scene.discretisation)
    if flow == "elements" and scene.discretisation != "edge":
        raise InputError("flow", f"'elements' with the discretisation '{scene.discretisation}'", "'edge' with it")
    if solved is None:
        solved = solve_windows(scene, cells, contact, mapper=mapper)
    elif (given := solved.fields.partition).cells != tuple(cells) or given.shape != scene.surface.shape:
        raise InputError("solved", f"a contact of {given.cells} cells", f"one of {tuple(cells)} cells of this face")
    partition = solved.fields.partition
    first = first_equal(solved.fields.gap, scene.steps)
    failures, warnings = solved.failures, scene_warnings(scene) + solved.warnings
    counts, solvers, links, element_error, drop_fraction, inside = SolveCounts(), SolverCounts(), None, None, None, None
    if flow == "resolved":
        found, inside = _resolved(scene, solved.fields, first, mapper)
    elif flow == "elements":
        found, inside, element_error, drop_fraction = _through_elements(scene, solved.fields, first, mapper)
    else:
        links = _through_links(scene, solved.fields, first, mapper)
        failures += links.failures
        counts, solvers = links.counts, links.solvers
        found = FaceLeakage(links.leakage, (), SolverCounts())
        warnings += _wrongly_closed(solved.fields, links.leakage)
    return TwoScaleResult(
        steps=scene.steps,
        partition=partition,
        flow=flow,
        leakage=found.leakage,
        k1=None if links is None else links.k1,
        k2=None if links is None else links.k2,
        link_flows=None if links is None else links.flows,
        contact=solved.contact,
        gap_error=solved.gap_error,
        gap_effect=solved.gap_effect,
        pressure=solved.pressure,
        mean_gap=solved.mean_gap,
        contact_fraction=solved.contact_fraction,
        plastic_fraction=solved.plastic_fraction,
        fluid_pressure=None if links is None else links.fluid_pressure,
        face_fluid_pressure=inside,
        fields=solved.fields,
        element_error=element_error,
        drop_fraction=drop_fraction,
        counts=counts,
        failures=failures + found.failures,
        warnings=warnings,
        solvers=solvers + found.solvers,
        equal_steps=repeated(first),
    )


def _resolved(
    scene: Scene, fields: WindowFields, first: NDArray[np.int64], mapper: Mapper
) -> tuple[FaceLeakage, NDArray[np.float32]]:
    """Flow through the stitched gap of every step, and its pressure at every pixel (steps, n1, n2) [Pa]."""
    surface = scene.surface
    solve = partial(attempt, resolved_flow, spacing=surface.spacing, settings=scene.flow, with_potential=True)
    stage = Stage("flow of the whole face", solve, state_memory(surface.heights.size))
    pressure = np.full(fields.gap.shape, np.nan, np.float32)

    def flows() -> Iterator[FaceFlow | Failed]:
        for s, flow in enumerate(map_different(mapper, stage, fields.gap, first)):
            if isinstance(flow, FaceFlow) and flow.potential is not None:
                pressure[s] = scene.pressure_at(flow.potential)
                flow = replace(flow, potential=None)
            yield flow

    return scene.resolved_leakage(flows(), first), pressure


def _through_elements(
    scene: Scene, fields: WindowFields, first: NDArray[np.int64], mapper: Mapper
) -> tuple[FaceLeakage, NDArray[np.float32], Array, Array]:
    """Flow through elements at every step, its pressure at every pixel, its error and the shares of the windows."""
    solve = partial(attempt, flow_through_elements, partition=fields.partition, drop=scene.flow.drop)
    stage = Stage("flow through elements", solve, ELEMENT_BYTES * scene.surface.heights.size)
    pressure = np.full(fields.gap.shape, np.nan, np.float32)
    error, share = np.full(len(fields.gap), np.nan), np.full((len(fields.gap), *fields.partition.cells), np.nan)

    def flows() -> Iterator[FaceFlow | Failed]:
        for s, found in enumerate(map_different(mapper, stage, fields.gap, first)):
            if isinstance(found, Failed):
                yield found
                continue
            flow = found.flow
            pressure[s] = scene.pressure_at(found.potential)
            error[s], share[s] = flow.error, flow.dissipation / (flow.dissipation.sum() or 1.0)
            yield FaceFlow(flow.permeability, SolverCounts.of(flow))

    return scene.resolved_leakage(flows(), first), pressure, error, share


@dataclass(frozen=True, eq=False)
class _LinkFlow:
    """Flow of every step through links: the permeabilities, the leakage and the pressure of nodes, NaN where failed.

    k1, k2 : of a rarefied gas those at the pressures of their nodes. flows : of the windows, at all pressures.
    """

    k1: Array
    k2: Array
    leakage: Array
    fluid_pressure: Array
    failures: tuple[str, ...]
    counts: SolveCounts
    solvers: SolverCounts
    flows: tuple[LinkFlows, LinkFlows]


def _through_links(scene: Scene, fields: WindowFields, first: NDArray[np.int64], mapper: Mapper) -> _LinkFlow:
    """Solve the links of every step, and the flow through them."""
    partition = fields.partition
    drop = scene.flow.drop
    along, across = (solve_links(fields, axis, scene.flow, mapper=mapper) for axis in (0, 1))
    k1, k2 = along.k.copy(), across.k.copy()
    m1, m2 = partition.cells
    seal = RectangularSeal(scene.surface.size, (m1, m2), partition.node_rows)
    leakage, fluid_pressure = np.full(len(k1), np.nan), np.full((len(k1), m1 + 1, m2), np.nan)
    counts = along.counts + across.counts
    solvers, failures = counts.solvers, along.failures + across.failures
    for s, step in enumerate(scene.steps):
        if not (np.isfinite(k1[s]).all() and np.isfinite(k2[s]).all()):
            continue
        if (t := first[s]) < s:
            leakage[s], fluid_pressure[s], k1[s], k2[s] = leakage[t], fluid_pressure[t], k1[t], k2[t]
            continue
        links = drop.table(list(zip(along.at_pressures[:, s], across.at_pressures[:, s], strict=True)))
        through = attempt(scene.leakage, seal, links)
        if isinstance(through, Failed):
            failures += (f"{step.name}: {through.reason}",)
        else:
            leakage[s], fluid_pressure[s] = through.per_length, through.fluid_pressure
            if through.permeability is not None:
                k1[s], k2[s] = through.permeability
            solvers += SolverCounts.of(through)
    return _LinkFlow(k1, k2, leakage, fluid_pressure, failures, counts, solvers, (along, across))


def _wrongly_closed(fields: WindowFields, leakage: Array) -> tuple[str, ...]:
    """Warn of steps that are open by the links and closed by the gap of the whole face, or the reverse."""
    warnings = []
    for said, other, flows in (("closed", "open", False), ("open", "closed", True)):
        names = [
            step.name
            for step, q, gap in zip(fields.steps, leakage, fields.gap, strict=True)
            if np.isfinite(q) and (q != 0) == flows != percolates(gap > 0)
        ]
        if names:
            more = f" and {len(names) - 1} more steps" if len(names) > 1 else ""
            warnings.append(
                f"links are {said} at {names[0]}{more} where the gap of the whole face is still {other}: take "
                'flow = "resolved"'
            )
    return tuple(warnings)

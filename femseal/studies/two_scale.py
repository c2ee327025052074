"""The two-scale study: contact and flow in the windows of a face, and over the whole face."""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..base import Array, InputError, Mapper, Shown, Stage, counted
from ..base.fields import LINK1, LINK2, NODE, PIXEL, ROW, STEP, WINDOW, Field, declared
from ..elements.elements import ELEMENT_BYTES
from ..flow.percolation import percolates
from ..flow.permeability_table import tabulated
from ..flow.spiral import Spiral
from ..loads import LoadProgramme
from ..seal import RectangularSeal
from ..seal.laid_windows import along_grooves
from ..windows import Failed, FlowHistory, FlowSettings, Partition, SolveCounts, SolverCounts, attempt
from ..windows.partition import ContactPressure, WindowFields
from ..windows.window_flow import flow_history
from .choices import FLOWS
from .deterministic import state_memory
from .face_contact import WindowContacts, band_breadth, solve_windows
from .face_flow import element_face_flow, resolved_flow
from .face_leakage import FaceLeakage, PlaceLeakage, face_leakage, first_equal, map_different, place_leakage, repeated
from .scene import Scene, scene_warnings

#: Largest number of pixels of a face whose flow is resolved unless chosen otherwise: that of 2048².
RESOLVED_PIXELS = 2**22


def chosen_flow(
    flow: str | None, shape: tuple[int, int], discretisation: str = "edge", spiral: Spiral | None = None
) -> str:
    """The flow given, or the one that suits the number of pixels of a face.

    Elements are the resolved flow in a third of the memory and two to three times the time. They know links between
    pixels alone, which the discretisation "edge" has, and no grooves that wind.

    Raises InputError: a flow that does not exist.
    """
    if flow is None:
        if shape[0] * shape[1] <= RESOLVED_PIXELS:
            return "resolved"
        return "elements" if discretisation == "edge" and spiral is None else "links"
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
    places : leakage by measured places, None of one.
    counts : flows of links, solved or known without solving. solvers : number of systems by solver, of links and over
    the face. equal_steps : number of steps that are an earlier one again, solved once. unsolved : steps at which the
    faces part, by their number, and why. failures : reasons of values
    that are NaN. warnings : reasons to doubt the result.
    """

    steps: LoadProgramme
    partition: Partition = field(repr=False)
    flow: str
    contact: str
    fields: WindowFields
    leakage: Array = declared(
        "leakage_two_scale", "m^2/s", "leakage per unit seal length, two-scale", STEP, heading="two-scale"
    )
    k1: Array | None = declared("k1", "m^3", "permeability of links along x1", LINK1)
    k2: Array | None = declared("k2", "m^3", "permeability of links along x2", LINK2)
    pressure: Array = declared("window_pressure", "Pa", "contact pressure of windows", WINDOW)
    mean_gap: Array = declared("window_mean_gap", "m", "mean gap of windows", WINDOW)
    contact_fraction: Array = declared("window_contact_fraction", "1", "fraction of windows in contact", WINDOW)
    plastic_fraction: Array = declared("window_plastic_fraction", "1", "fraction of windows at the hardness", WINDOW)
    fluid_pressure: Array | None = declared(
        "fluid_pressure", "Pa", "fluid pressure at the global nodes, NaN in pockets", NODE
    )
    face_fluid_pressure: NDArray[np.float32] | None = declared(
        "fluid_pressure", "Pa", "fluid pressure, NaN in contact and in pockets", PIXEL
    )
    row_pressure: Array = declared("row_pressure", "Pa", "mean contact pressure of rows", ROW, repr=False)
    band_breadth: Array = declared("band_breadth", "m", "breadth of the band in contact", STEP, repr=False)
    largest_row_pressure: Array = declared(
        "largest_row_pressure", "Pa", "largest mean contact pressure of a row", STEP, repr=False
    )
    gap_error: Array = declared(
        "gap_error", "1", "error of the gap of windows, estimated by the half-space of the whole face", STEP
    )
    gap_effect: Array = declared(
        "gap_effect", "1", "leakage over that with the gap corrected by the half-space of the whole face", STEP
    )
    element_error: Array | None = declared(
        "element_error", "1", "estimated relative error of the leakage through elements", STEP, default=None
    )
    drop_fraction: Array | None = declared(
        "window_drop_fraction", "1", "fraction of the pressure drop in windows", WINDOW, default=None
    )
    carried_pressure: Array | None = declared(
        "fluid_carried_pressure",
        "Pa",
        "mean pressure that the fluid carries of the load",
        STEP,
        default=None,
        repr=False,
    )
    entry_pressure: Array | None = declared(
        "capillary_entry_pressure",
        "Pa",
        "pressure below which the liquid does not enter the critical constriction, inf where it is closed",
        STEP,
        default=None,
    )
    places: PlaceLeakage | None = field(default=None, repr=False)
    counts: SolveCounts = field(default_factory=SolveCounts)
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    solvers: SolverCounts = field(default_factory=SolverCounts)
    link_flows: tuple[FlowHistory, FlowHistory] | None = field(default=None, repr=False)
    equal_steps: int = 0
    unsolved: tuple[tuple[int, str], ...] = field(default=(), repr=False)

    #: Pixels of the windows, stitched.
    computed_fields: ClassVar[dict[str, Field]] = {
        "gap": Field("gap", "m", "deformed gap", PIXEL),
        "contact_pressure": Field("contact_pressure", "Pa", "contact pressure", PIXEL),
    }

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
    flow = chosen_flow(flow, scene.surface.shape, scene.discretisation, scene.flow.spiral)
    scene.check_spiral(flow, cells)
    if flow == "elements" and scene.discretisation != "edge":
        raise InputError("flow", f"'elements' with the discretisation '{scene.discretisation}'", "'edge' with it")
    if solved is None:
        solved = solve_windows(scene, cells, contact, mapper=mapper)
    elif (given := solved.fields.partition).cells != tuple(cells) or given.shape != scene.surface.shape:
        raise InputError("solved", f"a contact of {given.cells} cells", f"one of {tuple(cells)} cells of this face")
    first = first_equal(solved.fields.gap, scene.steps)
    through = solved.through if isinstance(solved, WindowContacts) else None
    if flow == "resolved" and through is not None:
        found = _of_face(through, first)
    else:
        found = (_through_links if flow == "links" else _through_face)(scene, solved.fields, flow, first, mapper)
        for s, reason in solved.unsolved:
            found.leakage[s] = np.nan
            found = replace(found, failures=(f"{scene.steps[s].name}: {reason}", *found.failures))
    return TwoScaleResult(
        steps=scene.steps,
        partition=solved.fields.partition,
        flow=flow,
        **{name: value for name, value in vars(solved).items() if name != "through"}
        | vars(found)
        | {
            "failures": solved.failures + found.failures,
            "warnings": scene_warnings(scene) + solved.warnings + found.warnings,
        },
        band_breadth=band_breadth(solved.row_pressure, scene.surface.spacing[0]),
        largest_row_pressure=solved.row_pressure.max(axis=1),
        entry_pressure=scene.entry_pressures(solved.fields.gap),
        places=place_leakage(scene, solved.fields.gap, mapper),
        equal_steps=repeated(first),
    )


@dataclass(frozen=True, eq=False)
class _Flow:
    """What `TwoScaleResult` has of the flow, by the same names."""

    leakage: Array
    failures: tuple[str, ...]
    solvers: SolverCounts
    k1: Array | None = None
    k2: Array | None = None
    fluid_pressure: Array | None = None
    face_fluid_pressure: NDArray[np.float32] | None = None
    element_error: Array | None = None
    drop_fraction: Array | None = None
    link_flows: tuple[FlowHistory, FlowHistory] | None = None
    counts: SolveCounts = field(default_factory=SolveCounts)
    warnings: tuple[str, ...] = ()


def _through_face(scene: Scene, fields: WindowFields, flow: str, first: NDArray[np.int64], mapper: Mapper) -> _Flow:
    """Flow through the stitched gap of every step, at full resolution or through elements."""
    pixels, cells = scene.surface.heights.size, None
    if flow == "elements":
        cells = fields.partition.cells
        solve = partial(attempt, element_face_flow, partition=fields.partition, drop=scene.flow.drop)
        stage = Stage("flow through elements", solve, ELEMENT_BYTES * pixels)
    else:
        solve = partial(attempt, resolved_flow, spacing=scene.surface.spacing, settings=scene.flow, with_potential=True)
        stage = Stage("flow of the whole face", solve, state_memory(pixels))
    return _of_face(face_leakage(scene, map_different(mapper, stage, fields.gap, first), cells), first)


def _of_face(found: FaceLeakage, first: NDArray[np.int64]) -> _Flow:
    """What the result has of the flow through the whole face."""
    return _Flow(
        leakage=found.leakage,
        failures=found.failures,
        solvers=found.solvers(first),
        face_fluid_pressure=found.fluid_pressure,
        element_error=found.element_error,
        drop_fraction=found.drop_fraction,
    )


def solve_links(
    fields: WindowFields, axis: int, settings: FlowSettings, *, shift: int = 0, mapper: Mapper = map
) -> FlowHistory:
    """Solve the permeability of all links along `axis`; `shift` moves their windows by so many pixels along x2."""
    partition = fields.partition
    places = partition.links(axis)
    windows = (partition.link(fields.gap, i, j, axis, shift) for i, j in places)
    stage = Stage("flow in windows", partial(flow_history, axis=axis, settings=settings))
    # one argument is a list, so that the mapper knows the number of items
    flows = list(mapper(stage, windows, [partition.spacing] * len(places)))
    k = np.empty((settings.drop.pressures.size, len(fields.steps), partition.cells[0] - axis, partition.cells[1]))
    for (i, j), found in zip(places, flows, strict=True):
        k[:, :, i, j] = found.at_pressures
    return FlowHistory(
        at_pressures=k,
        counts=SolveCounts.total(found.counts for found in flows),
        failures=tuple(f"x{axis + 1}-link {p}, {t}" for p, f in zip(places, flows, strict=True) for t in f.failures),
    )


def _through_links(scene: Scene, fields: WindowFields, flow: str, first: NDArray[np.int64], mapper: Mapper) -> _Flow:
    """Permeabilities of the links of every step, and the flow through them, NaN at steps where one failed.

    Where the law depends on the pressure, k1 and k2 are those at the pressures of their nodes.
    """
    partition, drop = fields.partition, scene.flow.drop
    along, across = (solve_links(fields, axis, scene.flow, mapper=mapper) for axis in (0, 1))
    k1, k2 = along.k.copy(), across.k.copy()
    m1, m2 = partition.cells
    seal = RectangularSeal(scene.surface.size, (m1, m2), partition.node_rows)
    leakage, fluid_pressure = np.full(len(k1), np.nan), np.full((len(k1), m1 + 1, m2), np.nan)
    counts, failures = along.counts + across.counts, along.failures + across.failures
    solvers = counts.solvers
    for s, step in enumerate(scene.steps):
        if not (np.isfinite(k1[s]).all() and np.isfinite(k2[s]).all()):
            continue
        if (t := first[s]) < s:
            leakage[s], fluid_pressure[s], k1[s], k2[s] = leakage[t], fluid_pressure[t], k1[t], k2[t]
            continue
        values = [_wound(scene, pair) for pair in zip(along.at_pressures[:, s], across.at_pressures[:, s], strict=True)]
        links = tabulated(drop.pressures, values)
        through = attempt(scene.leakage, seal, links)
        if isinstance(through, Failed):
            failures += (f"{step.name}: {through.reason}",)
        else:
            leakage[s], fluid_pressure[s] = through.per_length, through.fluid_pressure
            if through.permeability is not None:
                k1[s], k2[s] = through.permeability
            solvers += SolverCounts.of(through)
    return _Flow(
        leakage=leakage,
        failures=failures,
        solvers=solvers,
        k1=k1,
        k2=k2,
        fluid_pressure=fluid_pressure,
        link_flows=(along, across),
        counts=counts,
        warnings=() if scene.flow.spiral else _wrongly_closed(fields, leakage),
    )


def _wound(scene: Scene, links: tuple[Array, Array]) -> tuple[Array, Array]:
    """Permeabilities of links where grooves wind: k₁cos²α + k₂sin²α along x1, with k₂ of the whole rows beside."""
    if scene.flow.spiral is None:
        return links
    along, across = links
    square = scene.flow.spiral.tangent(scene.surface.size[1]) ** 2
    beside = np.pad(along_grooves(across), ((1, 1), (0, 0)), mode="edge")
    return (along + square * (beside[:-1] + beside[1:]) / 2) / (1 + square), across


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
            more = f" and {counted(len(names) - 1, 'more step')}" if len(names) > 1 else ""
            warnings.append(
                f"links are {said} at {names[0]}{more} where the gap of the whole face is still {other}: take "
                'flow = "resolved"'
            )
    return tuple(warnings)

"""The two-scale study: contact and flow in the windows of a face, and over the whole face."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.stage import Mapper, Stage
from ..base.text import Shown
from ..flow.percolation import percolates
from ..loads import LoadProgramme
from ..scales import ElementFlow, Failed, Partition, SolveCounts, SolverCounts, attempt, element_flow
from ..scales.window_fields import ContactPressure, WindowFields
from ..seal import RectangularSeal
from .face_contact import solve_windows
from .plausibility import odd_in_scene
from .scene import Array, FaceFlow, Scene, labels, resolved_flow
from .windows import solve_links

FLOWS = ("links", "resolved", "elements")


@dataclass(frozen=True, repr=False)
class TwoScaleResult(Shown):
    """Contact and flow at two scales; arrays over steps, rows and columns of windows.

    partition : the windows. contact, flow : how they were solved, see `two_scale`. gap_error : estimate of the error of
    the contact, see `scales.gap_error`.
    element_error, drop_share : of the flow "elements", None with others. The leakage is then an upper bound of that
        resolved on the same gap, and the error is estimated from the bound with every second node.
    fields : deformed gap and contact pressure at every pixel.
    counts : flows of links, solved or known without solving. solvers : number of systems by solver, of links and over
    the face. failures : reasons of values that are NaN. warnings : reasons to doubt the result.
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
    fields: WindowFields
    gap_error: Array = field(
        metadata=labels("1", "error of the gap of windows, estimated by the half-space of the whole face", "step")
    )
    element_error: Array | None = field(
        default=None, metadata=labels("1", "estimated relative error of the leakage through elements", "step")
    )
    drop_share: Array | None = field(
        default=None,
        metadata=labels(
            "1", "share of windows in the pressure drop", "step", "cell1", "cell2", name="window_drop_share"
        ),
    )
    counts: SolveCounts = field(default_factory=SolveCounts)
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    solvers: SolverCounts = field(default_factory=SolverCounts)

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
    flow: str = "links",
    contact: str | None = None,
    mapper: Mapper = map,
) -> TwoScaleResult:
    """Solve the contact of every cell, and the flow through the stitched gap.

    Parameters
    ----------
    scene : the face, its load and its fluid.
    cells : number of cells along x1 and x2.
    flow : "links": solve the permeability of each window between global nodes, then the flow through these links.
        "resolved": solve the flow through the stitched gap at full resolution; the links are solved as well.
        "elements": condense the stitched gap of every window to an element with nodes on its sides, see
        `scales.element_flow`; the links are solved as well. The discretisation has to be "edge".
    contact : "whole": cut the cells from the contact of the whole face. "windows": solve the contact of each cell
        under the mean pressure that the contact of the low-pass face gives it. Unless given, "whole" up to 2²⁴ pixels.
    mapper : computes a stage for many items, such as the builtin `map`; it may use several processes.

    Raises
    ------
    InputError : another flow or contact, or cells that do not suit the surface.
    NotConverged : a global contact failed. Windows and flows that fail are NaN, and listed in `failures`.
    """
    if flow not in FLOWS:
        raise InputError.of("flow", flow, f"one of {', '.join(FLOWS)}")
    if flow == "elements" and scene.discretisation != "edge":
        raise InputError.of("flow", f"'elements' with the discretisation '{scene.discretisation}'", "'edge' with it")
    surface = scene.surface
    solved = solve_windows(scene, cells, contact, mapper=mapper)
    partition = solved.fields.partition
    along, across = (solve_links(solved.fields, axis, scene.flow, mapper=mapper) for axis in (0, 1))
    k1, k2 = along.k, across.k
    seal = RectangularSeal(surface.size, cells, partition.node_rows)
    leakage, fluid_pressure = np.full(len(k1), np.nan), np.full((len(k1), cells[0] + 1, cells[1]), np.nan)
    counts = along.counts + across.counts
    solvers = counts.solvers
    failures = solved.failures + along.failures + across.failures
    warnings = odd_in_scene(scene) + solved.warnings
    for s, step in enumerate(scene.steps):
        if not (np.isfinite(k1[s]).all() and np.isfinite(k2[s]).all()):
            continue
        through = attempt(scene.leakage, seal, (k1[s], k2[s]))
        if isinstance(through, Failed):
            failures += (f"{step.name}: {through.reason}",)
        else:
            leakage[s], fluid_pressure[s] = through.per_length, through.fluid_pressure
            solvers += SolverCounts.of(through)
    if flow == "resolved":
        solve = partial(attempt, resolved_flow, spacing=surface.spacing, settings=scene.flow)
        resolved = scene.resolved_leakage(mapper(Stage("flow of the whole face", solve), solved.fields.gap))
        leakage = resolved.leakage
        failures += resolved.failures
        solvers += resolved.solvers
    element_error = drop_share = None
    if flow == "elements":
        stage = Stage("flow through elements", partial(attempt, element_flow, partition=partition))
        through_elements = list(mapper(stage, solved.fields.gap))
        resolved = scene.resolved_leakage(
            f if isinstance(f, Failed) else FaceFlow(f.permeability, SolverCounts.of(f)) for f in through_elements
        )
        leakage = resolved.leakage
        failures += resolved.failures
        solvers += resolved.solvers
        element_error, drop_share = _error_and_share(through_elements, cells)
    if flow == "links":
        warnings += _wrongly_closed(solved.fields, leakage)
    return TwoScaleResult(
        steps=scene.steps,
        partition=partition,
        flow=flow,
        leakage=leakage,
        k1=k1,
        k2=k2,
        contact=solved.contact,
        gap_error=solved.gap_error,
        pressure=solved.pressure,
        mean_gap=solved.mean_gap,
        contact_fraction=solved.contact_fraction,
        plastic_fraction=solved.plastic_fraction,
        fluid_pressure=fluid_pressure,
        fields=solved.fields,
        element_error=element_error,
        drop_share=drop_share,
        counts=counts,
        failures=failures,
        warnings=warnings,
        solvers=solvers,
    )


def _error_and_share(flows: list[ElementFlow | Failed], cells: tuple[int, int]) -> tuple[Array, Array]:
    """Estimated error (steps,) and shares of windows in the pressure drop (steps, m1, m2); NaN where a flow failed."""
    error, share = np.full(len(flows), np.nan), np.full((len(flows), *cells), np.nan)
    for s, flow in enumerate(flows):
        if not isinstance(flow, Failed):
            error[s], share[s] = flow.error, flow.dissipation / (flow.dissipation.sum() or 1.0)
    return error, share


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

"""Collect the cells of a surface in several contact states, and solve them at tabulated pressures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from ..base import Array, Mapper, Shape
from ..base.fields import CELL, STATE, Field, declared
from ..contact import LoadState, coating_edge_distance
from ..face.cell_flow import (
    FaceFlow,
    Failed,
    FlowSettings,
    SolveCounts,
    attempt,
    drop_fractions,
    flow_sides,
    permeability_along_x2,
    solve_surface_flow,
)
from ..face.cells import CellState, correction_factors
from ..face.cut import Cut
from ..face.flow_concentration import blocks_of_one_wave, participation_number
from ..loads import LoadProgramme
from ..scene import Scene
from .cells_in_order import cells_in_order, cells_permeability_along_x2
from .patch_leakage import PatchLeakage, permeabilities_of_patches


@dataclass(frozen=True, eq=False)
class FaceCells:
    """Fields of the cells of a surface at every step of a load programme; NaN where a flow solver failed.

    Parameters
    ----------
    steps : LoadProgramme
        Load steps or tabulated pressures.
    cut : Cut
        Division of the surface into m1 × m2 cells.
    k : array (pressures, 2, steps, m1, m2), m³
        Permeability of each cell along x1 and x2 at each fluid pressure.
    row_pressure : array (steps, n1), Pa
        Mean contact pressure of each row of points.
    patches : PatchLeakage, optional
        Leakage of each measured patch; None if there is only one patch.
    solve_counts : SolveCounts
        Number of linear systems that each solver solved for the flow through the cells.
    pressure, mean_gap, contact_fraction, plastic_fraction : array (steps, m1, m2)
        Contact pressure [Pa], gap [m], contact fraction and fraction of points at the hardness, averaged over each
        cell.
    drop_fraction : array (steps, m1, m2)
        Dissipation in each cell divided by the dissipation in the surface; NaN at steps without flow.
    surface_leakage : array (steps,), m²/s
        Leakage of the surface at full resolution.
    cells_leakage : array (steps,), m²/s
        Leakage of the grid of cells, in their order on the surface.
    carriers : array (steps,)
        Effective number of blocks that carry the flow through the surface, see `participation_number`; NaN at steps
        without flow. The blocks are as large as the short waves of the surface.
    surface_k2, cells_k2 : array (steps,), m³
        Permeability along x2 of the whole surface (`surface_k2`) and of the grid of cells (`cells_k2`), averaged over
        the measured patches. They are only computed for seals whose tiles take random cells; otherwise they are NaN.
    edge_distance : array (steps,), m
        Mean distance of the points that yield from the edge of their contact patch, see `contact.mean_edge_distance`;
        NaN without a coating.
    failures : tuple of str
        One line for each failure of a flow solver.
    unsolved : tuple of (int, str)
        Index of each load step whose leakage could not be computed, and the reason.
    """

    steps: LoadProgramme
    cut: Cut
    k: Array
    row_pressure: Array
    patches: PatchLeakage | None
    solve_counts: SolveCounts
    edge_distance: Array
    pressure: Array = declared("cell_pressure", "Pa", "contact pressure of cells", CELL)
    mean_gap: Array = declared("cell_mean_gap", "m", "mean gap of cells", CELL)
    contact_fraction: Array = declared(
        "cell_contact_fraction", "1", "fraction of cells in contact", CELL
    )
    plastic_fraction: Array = declared(
        "cell_plastic_fraction", "1", "fraction of cells at the hardness", CELL
    )
    drop_fraction: Array = declared(
        "cell_drop_fraction",
        "1",
        "fraction of the pressure drop in cells, NaN without flow",
        CELL,
    )
    surface_leakage: Array = declared(
        "state_leakage", "m^2/s", "leakage of the face per unit length, by state", STATE
    )
    cells_leakage: Array = declared(
        "state_cells_leakage",
        "m^2/s",
        "leakage of the cells in their own order per unit length, by state",
        STATE,
    )
    carriers: Array = declared(
        "state_flow_carriers",
        "1",
        "number of blocks of one short wave that effectively carry the flow, by state",
        STATE,
    )
    surface_k2: Array = declared(
        "state_surface_k2", "m^3", "permeability of the whole surface along x2, by state", STATE
    )
    cells_k2: Array = declared(
        "state_cells_k2",
        "m^3",
        "permeability along x2 of the cells in their own order, by state",
        STATE,
    )
    failures: tuple[str, ...] = ()
    unsolved: tuple[tuple[int, str], ...] = ()

    computed_fields: ClassVar[dict[str, Field]] = {
        "k1": Field("cell_k1", "m^3", "permeability of cells along x1, their sides closed", CELL),
        "k2": Field("cell_k2", "m^3", "permeability of cells along x2, their sides closed", CELL),
        "factor": Field(
            "state_factor", "1", "correction factor on k1 of the cells in a state", STATE
        ),
        "factor_k2": Field(
            "state_factor_k2", "1", "correction factor on k2 of the cells in a state", STATE
        ),
    }

    @property
    def k1(self) -> Array:
        """Permeability of each cell along x1, averaged over the fluid pressures (steps, m1, m2) [m³]."""
        return self.k[:, 0].mean(axis=0)

    @property
    def k2(self) -> Array:
        """Permeability of each cell along x2, averaged over the fluid pressures (steps, m1, m2) [m³]."""
        return self.k[:, 1].mean(axis=0)

    @property
    def factor(self) -> Array:
        """Correction factor of k1 in each contact state (steps,), see `correction_factors`."""
        return correction_factors(self.surface_leakage, self.cells_leakage, self.steps)

    @property
    def factor_k2(self) -> Array:
        """Correction factor of k2 in each contact state (steps,); 1 where the flow along x2 was not solved."""
        return correction_factors(self.surface_k2, self.cells_k2, self.steps)

    @property
    def corrected_k(self) -> Array:
        """Permeabilities `k` of the cells, multiplied by the correction factor for their axis and contact state."""
        axis_factors = np.stack([self.factor, self.factor_k2])  # (axis, step)
        return self.k * axis_factors[:, :, None, None]


def solve_cells_at_pressures(
    scene: Scene,
    cut: Cut,
    steps: LoadProgramme,
    mapper: Mapper,
    boundary: tuple[str, str] = ("periodic", "periodic"),
) -> FaceCells:
    """Solve the contact without fluid at tabulated nominal pressures, and the flow through the cells in each state.

    Parameters
    ----------
    scene : Scene
        The surface and the fluid that flows through its cells.
    cut : Cut
        Division of the surface into cells.
    steps : LoadProgramme
        Tabulated pressures, on loading and on unloading.
    mapper : callable
        Computes the items of a stage.
    boundary : tuple of two str
        Continuation of the surface along x1 and x2 in the contact, see `HalfSpace`.
    """
    dry = scene.dry(boundary=boundary)
    # in all studies, the flow along x1 is solved with periodic boundaries along x2
    flow_boundary = "periodic" if boundary[0] == "periodic" else "free", "periodic"
    cell_flow = replace(scene.flow, spiral=None)  # spiral grooves belong to the seal, not to cells
    take = partial(
        _solve_cells_of_state,
        cut=cut,
        flow=cell_flow,
        widths=scene.surface.widths,
        blocks=blocks_of_one_wave(scene.surface),
        boundary=flow_boundary,
    )
    states = list(dry.contact_states(take, steps=steps, mapper=mapper))
    return join_states(scene, cut, steps, states, flow_boundary)


def _solve_cells_of_state(
    state: LoadState,
    *,
    cut: Cut,
    flow: FlowSettings,
    widths: tuple[int, ...],
    boundary: tuple[str, str],
    blocks: Shape,
) -> CellState:
    """Cut a contact state into cells, and solve the flow through the cells, the whole surface and its patches."""
    gap = state.contact.gap
    cells = CellState.of(gap, state.contact.pressure, cut, flow, boundary=boundary)
    patch_k = None
    if len(widths) > 1:
        patch_k = permeabilities_of_patches(widths, cut.spacing, flow, gap)
    flow_along_x1 = attempt(solve_surface_flow, gap, cut.spacing, flow, flow_sides(boundary[1]))
    carriers = np.nan
    if isinstance(flow_along_x1, FaceFlow):
        dissipation = drop_fractions(gap, cut.spacing, flow_along_x1.potential, flow)
        carriers = participation_number(dissipation, blocks)
    surface_k2 = attempt(
        permeability_along_x2, gap, widths, cut.spacing, flow, flow_sides(boundary[0])
    )
    failures = cells.failures
    if isinstance(surface_k2, Failed):
        failures = (*failures, f"whole surface, x2: {surface_k2.reason}")
        surface_k2 = np.nan
    return replace(
        cells,
        surface_k1=flow_along_x1.permeability,
        surface_k2=surface_k2,
        patches=patch_k,
        failures=failures,
        flow_failure=getattr(flow_along_x1, "reason", ""),
        carriers=carriers,
        edge_distance=coating_edge_distance(state.contact),
    )


def join_states(
    scene: Scene,
    cut: Cut,
    steps: LoadProgramme,
    states: Sequence[CellState],
    boundary: tuple[str, str] = ("free", "periodic"),
) -> FaceCells:
    """Collect the cells of all contact states, and solve the flow through the grid of cells in each contact state.

    The flow along x2 is only solved in contact states for which the permeability of the whole surface along x2 has been
    computed.

    Parameters
    ----------
    scene : Scene
        The surface and the fluid.
    cut : Cut
        Division of the surface into cells.
    steps : LoadProgramme
        Load steps of the contact states.
    states : sequence of CellState
        Cells of the surface in the contact state of each load step.
    boundary : tuple of two str
        Continuation of the surface along x1 and x2 in the flow.
    """
    k = np.stack([state.k for state in states], axis=2)  # (fluid pressure, axis, step, row, column)
    cells_leakage = np.full(len(steps), np.nan)
    cells_k2 = np.full(len(steps), np.nan)
    failures = []
    for s, (step, state) in enumerate(zip(steps, states, strict=True)):
        failures += [f"{step.name}, {text}" for text in state.failures]
        if not np.isfinite(k[:, :, s]).all():
            continue
        flow = cells_in_order(scene, scene.surface.size, k[:, :, s], boundary[1])
        cells_leakage[s] = flow.per_length
        if np.isfinite(state.surface_k2):
            cells_k2[s] = cells_permeability_along_x2(scene, cut, k[:, :, s], boundary[0])
    unit_leakage = scene.unit_leakage
    patches = None
    if states[0].patches is not None:
        patch_k = np.array([state.patches for state in states])  # (step, selection of patches)
        patches = PatchLeakage(unit_leakage * patch_k.T)
    names = (
        "pressure",
        "mean_gap",
        "contact_fraction",
        "plastic_fraction",
        "drop_fraction",
        "row_pressure",
        "carriers",
        "surface_k2",
        "edge_distance",
    )
    return FaceCells(
        steps,
        cut,
        k,
        **{name: np.array([getattr(state, name) for state in states]) for name in names},
        surface_leakage=unit_leakage * np.array([state.surface_k1 for state in states]),
        cells_leakage=cells_leakage,
        cells_k2=cells_k2,
        patches=patches,
        solve_counts=SolveCounts.total(state.solve_counts for state in states),
        failures=tuple(failures),
        unsolved=tuple(
            (s, state.flow_failure) for s, state in enumerate(states) if state.flow_failure
        ),
    )

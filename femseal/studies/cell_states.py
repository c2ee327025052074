"""Solve the contact of a surface at tabulated pressures, and the flow through its cells and measured patches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar

import numpy as np

from ..base import Array, Floats, Mapper, Pair, Shape, Shown
from ..base.fields import CELL, PATCH, STATE, STEP, Field, declared
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
from ..face.cells import CellState, Cut, correction_factors
from ..face.curves import CellCurves, local_peaks
from ..face.flow_concentration import blocks_of_one_wave, participation_number
from ..loads import LoadProgramme, LoadStep, least_counted
from ..scene import Scene
from ..topography.patches import split_patches
from .cells_in_order import cells_in_order, cells_permeability_along_x2

#: Smallest number of measured patches for which the leakage without one of the patches is computed.
FEWEST = 3
#: Spacing of the cube roots of tabulated pressures, as a fraction of the cube root of the highest one. ln k is nearly a
#: linear function of the cube root of the pressure. Four surfaces were solved under pressure maps of ± 40 % and with
#: fluid pressure. Down to a hundredth of the leakage at the first load, the interpolated leakage on loading was within
#: 1.2 % of states that were solved at the exact pressures; with a spacing of 1/16 it was within 2.5 %.
_SPACING = 1 / 20
#: Tabulated pressures on unloading, as fractions of the peak.
_UNLOADING_FRACTIONS = (0.8, 0.6, 0.4, 0.25, 0.12, 0.04, 0.0)
#: Spacing of the cube roots of neighbouring peaks, as a fraction of the cube root of the highest peak, and largest
#: number of peaks. On the same surfaces, the error of the leakage on unloading was below 0.7 % for peaks at which the
#: seal is open. For peaks near closing it was 1.2 % in the median and at most 15 %, whatever the number of peaks.
_PEAK_SPACING, _MOST_PEAKS = 1 / 12, 6
#: Smallest relative distance of a tabulated pressure from a peak pressure, and from the lowest and the highest
#: pressure. Between states that are closer to each other, the slope would be dominated by numerical errors.
_NEAR = 0.02
#: If the lowest or the highest pressure is within this relative distance of a peak pressure, no additional state is
#: computed.
_SAME = 1e-3


@dataclass(frozen=True, repr=False)
class PatchLeakage(Shown):
    """Leakage of each measured patch, and the leakage with each patch left out in turn.

    The leakage is NaN where the flow solver failed.

    Parameters
    ----------
    selections : array (patches, steps) or (2 × patches, steps), m²/s
        Leakage of subsets of the patches. The first rows are for single patches, each continued periodically. If there
        are at least three patches, the second half of the rows contains the leave-one-out results, for which all
        patches except one are placed side by side.
    """

    selections: Array = field(metadata={"unit": "m^2/s"})

    computed_fields: ClassVar[dict[str, Field]] = {
        "alone": Field(
            "leakage_of_patches",
            "m^2/s",
            "leakage per unit seal length, of each patch alone",
            PATCH,
        ),
        "without": Field(
            "leakage_without_patch",
            "m^2/s",
            "leakage per unit seal length, of all patches but one",
            PATCH,
        ),
        "scatter": Field(
            "patch_scatter",
            "1",
            "standard deviation of the leakage of single patches over its mean",
            STEP,
            "patches ± [%]",
        ),
    }

    @property
    def alone(self) -> Array:
        """Leakage of a surface that consists of a single patch, for each patch (patches, steps) [m²/s]."""
        return self.selections if self.without is None else self.selections[: len(self.without)]

    @property
    def without(self) -> Array | None:
        """Leakage with one patch left out, for each omitted patch (patches, steps) [m²/s]; None for two patches."""
        # With two patches, `selections` has two rows, and half of the rows is fewer than `FEWEST`.
        patches = len(self.selections) // 2
        return self.selections[patches:] if patches >= FEWEST else None

    @property
    def relative(self) -> Array:
        """Ratio of the leakage of each patch to the mean leakage of all patches (patches,).

        The ratio of each patch is averaged over the loads at which the mean leakage is not negligible. If no patch
        leaks, all ratios are 0.
        """
        mean = self.alone.mean(axis=0)
        is_counted = mean > least_counted(mean)
        ratios = self.alone[:, is_counted] / mean[is_counted]
        return ratios.sum(axis=1) / max(1, is_counted.sum())

    @property
    def scatter(self) -> Array:
        """Standard deviation of the leakage of single patches, divided by their mean leakage (steps,).

        The scatter is NaN at load steps at which no patch leaks.
        """
        mean = self.alone.mean(axis=0)
        return np.divide(
            self.alone.std(axis=0, ddof=1), mean, out=np.full(mean.shape, np.nan), where=mean > 0
        )


def permeabilities_of_patches(
    widths: tuple[int, ...], spacing: Pair, settings: FlowSettings, gap: Floats
) -> Array:
    """Compute the permeability of each measured patch, and of all patches with one of them left out.

    The leakages in `PatchLeakage` are computed from the returned permeabilities.

    Parameters
    ----------
    widths : tuple of int
        Number of points of each patch along x2.
    spacing : (float, float), m
        Spacing of the points.
    settings : FlowSettings
        Settings of the flow solver.
    gap : array (n1, n2), m
        Gap of all patches, which lie side by side.

    Returns
    -------
    array (patches,) or (2 × patches,), m³
        Permeability of each single patch. With at least three patches, the second half of the array contains the
        permeabilities with each patch left out in turn. A permeability is NaN if the flow solver failed.
    """
    patches = split_patches(gap, widths)
    selections = [[patch] for patch in patches]
    if len(patches) >= FEWEST:
        for left_out in range(len(patches)):
            selections.append([*patches[:left_out], *patches[left_out + 1 :]])
    permeabilities = []
    for selection in selections:
        joined_gap = np.concatenate(selection, axis=1)
        flow = attempt(solve_surface_flow, joined_gap, spacing, settings)
        permeabilities.append(flow.permeability)
    return np.array(permeabilities)


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
    counts : SolveCounts
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
    counts: SolveCounts
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
        counts=SolveCounts.total(state.counts for state in states),
        failures=tuple(failures),
        unsolved=tuple(
            (s, state.flow_failure) for s, state in enumerate(states) if state.flow_failure
        ),
    )


def choose_tabulated_pressures(
    paths: Array, steps: LoadProgramme, elastic: bool, spacing_factor: int = 1
) -> LoadProgramme:
    """Choose the tabulated pressures at which the contact of the cells is solved.

    Between the tabulated pressures, the permeabilities of the cells are interpolated. The tabulated pressures on
    loading range from the lowest to the highest pressure of all pressure paths, and their cube roots are evenly spaced.
    The peak pressure of a path is the pressure from which the path is unloaded. If the paths have many peak pressures,
    a few representative peak pressures are chosen. The chosen peak pressures are tabulated on loading as well, and
    unloading is tabulated from each of them.

    Parameters
    ----------
    paths : array (steps, paths), Pa
        Contact pressure on each pressure path at every load step.
    steps : LoadProgramme
        Load programme of the pressure paths.
    elastic : bool
        True if nothing yields, so that the contact states on unloading are the same as on loading.
    spacing_factor : int
        Factor by which the default spacing of tabulated pressures and peak pressures is multiplied.
    """
    peak = local_peaks(paths, steps)  # peak pressure of each path up to each step (step, path)
    unloads = (paths < peak) & (not elastic)  # whether the path is unloaded at this step
    highest = float(paths.max())
    lowest = max(float(paths.min()), 0.0)
    peaks = _choose_peaks(peak[unloads], spacing_factor)
    # pressures that must be solved on loading: the peak pressures, and the lowest and the highest pressure unless a
    # peak pressure is close
    required = np.array(peaks)
    for end in (lowest, highest):
        if (np.abs(end - required) > _SAME * required).all():
            required = np.append(required, end)
    # pressures with evenly spaced cube roots, without those that are too close to a required pressure; the cube roots
    # are divided by the cube root of the highest pressure
    first_root = np.cbrt(lowest / highest) if highest > 0 else 0.0
    count = int(np.ceil((1 - first_root) / (spacing_factor * _SPACING))) + 1
    evenly_spaced = highest * np.linspace(first_root, 1.0, count)[:-1, None] ** 3  # (pressure, 1)
    is_apart = (np.abs(evenly_spaced - required) > _NEAR * required).all(axis=1)
    loading = np.union1d(evenly_spaced[is_apart], required).tolist()
    # on unloading, the fractions end with the first fraction that is not above the deepest unloading of a path
    deepest = (paths[unloads] / peak[unloads]).min(initial=1.0)
    above_deepest = sum(fraction > deepest for fraction in _UNLOADING_FRACTIONS)
    fractions = _UNLOADING_FRACTIONS[: above_deepest + 1]
    unloading = [LoadStep(fraction * peak, peak) for peak in peaks for fraction in fractions]
    return LoadProgramme([*map(LoadStep, loading), *unloading])


def _choose_peaks(peaks: Array, spacing_factor: int) -> list[float]:
    """Choose a few of many peak pressures, so that their cube roots are about evenly spaced.

    The chosen peak pressures are returned in increasing order.
    """
    distinct: list[
        float
    ] = []  # without peak pressures that are almost equal to a higher peak pressure
    for peak in np.unique(peaks)[::-1].tolist():  # from the highest to the lowest
        if not distinct or peak * (1 + _NEAR) < distinct[-1]:
            distinct.append(peak)
    if len(distinct) < 2:
        return distinct
    values = np.array(distinct[::-1])  # in increasing order
    roots = np.cbrt(values / values[-1])  # divided by the cube root of the highest peak pressure
    count = int(np.ceil((1 - roots[0]) / (spacing_factor * _PEAK_SPACING))) + 1
    count = min(count, _MOST_PEAKS // spacing_factor)
    even_roots = np.linspace(roots[0], 1.0, count)
    # for each evenly spaced cube root, the index of the nearest peak pressure; a peak may be nearest to several of them
    nearest_peak = np.abs(roots - even_roots[:, None]).argmin(axis=1)
    return np.unique(values[nearest_peak]).tolist()


def interpolate_along_paths(cells: FaceCells, paths: Array, steps: LoadProgramme) -> Array:
    """Interpolate the permeability of every cell along every pressure path, with the correction factors.

    A pressure path is the sequence of the pressures of a tile at all load steps.

    Parameters
    ----------
    cells : FaceCells
        Cells whose permeabilities are known at tabulated pressures.
    paths : array (steps, paths), Pa
        Contact pressures along the pressure paths.
    steps : LoadProgramme
        Load steps of the pressure paths.

    Returns
    -------
    array (fluid pressures, 2, steps, paths, cells), m³
        Interpolated permeability of every cell along x1 and x2.
    """
    k = cells.corrected_k.reshape(*cells.k.shape[:3], -1)  # (fluid pressure, axis, step, cell)
    k_on_paths = np.empty((*k.shape[:2], *paths.shape, k.shape[-1]))
    for pressure_and_axis in np.ndindex(*k.shape[:2]):
        for cell in range(k.shape[-1]):
            curves = CellCurves(cells.steps, k[*pressure_and_axis, :, cell])
            k_on_paths[*pressure_and_axis, :, :, cell] = curves.k_on_paths(paths, steps)
    return k_on_paths

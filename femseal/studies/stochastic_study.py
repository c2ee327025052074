"""Run the stochastic study: seals of any size and shape, whose tiles take random cells of a measured surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from math import isfinite
from typing import Any

import numpy as np

from ..base import Array, FemsealError, Indices, InputError, Mapper, Shape, Stage
from ..checks import estimate_scene, line_contact_warnings, result_warnings
from ..face.cell_flow import Failed, SolveCounts, attempt
from ..face.cells import MOST_RATIO, Cut
from ..face.curves import CellCurves
from ..flow.permeability_table import tabulate
from ..scene import Scene
from ..seal.layouts import RectangularLayout
from ..seal.tiles import SealTiles
from .cell_states import (
    FaceCells,
    PatchLeakage,
    choose_tabulated_pressures,
    interpolate_along_paths,
    solve_cells_at_pressures,
)
from .face_study import cut_into_cells, fields_of_rows
from .patch_interval import interval_widths
from .patch_state import PatchState, open_leakage_per_permeability
from .sampling import (
    FEWEST_SEALS,
    MOST_SEALS,
    Sampling,
    TileFluid,
    check_map,
    cut_and_cover,
    distinct_paths,
    pressure_fractions,
)
from .seal_contact import SealContact, remove_waves_of_forms, solve_seal_contact
from .stochastic_result import MedianSeal, StochasticResult, at_every_step, find_median_realisation

#: Wanted standard error of ln(median leakage), as a fraction of the half-width of the interval of a single patch.
MEDIAN_ERROR_FRACTION = 1 / 20
#: Standard error of the median of n normal numbers, in standard deviations and times √n.
_MEDIAN_ERROR = 1.2533
#: Fields of the median seal are kept up to this number of values: elements times load steps.
MOST_VALUES = 4_000_000
#: Estimated relative error at which the leakage of a realisation has converged, where permeabilities depend on the
#: pressure. The true error was below 1e-3 up to a fluid pressure of 0.95 of the load.
REALISATION_RTOL = 3e-4


def stochastic(
    scene: Scene,
    cells: Shape | None,
    sampling: Sampling,
    *,
    mapper: Mapper = map,
) -> StochasticResult:
    """Cut the contact of a surface into cells, let the tiles of seals take them at random, and solve each seal.

    The cells lie in the contact of the whole surface. Where a seal is as broad as the surface and is pressed evenly,
    they are those of the load steps of the scene. Elsewhere the contact is solved at tabulated nominal pressures, from
    which each tile takes its own pressure, less that of the fluid. One correction factor for every axis and state makes
    the cells in their own order leak what the whole surface leaks.

    Parameters
    ----------
    scene : the surface, its load and its fluid.
    cells : numbers of cells along x1 and x2; None: two or four on the shorter side of the surface.
    sampling : the seal, and how its tiles take cells. Without a number of realisations, seals are solved until the
        standard error of their median is a twentieth of the interval of a single patch, at least three.
    mapper : computes a stage for many items, such as the builtin `map`; it may use several processes.

    Raises
    ------
    InputError : cells that are too small; a size of the seal that is missing or given twice; a pressure map that does
        not cover it; trapped liquid where cells do not stay in order.
    NotConverged : a contact failed.
    FemsealError : the flow through every cell failed.

    Examples
    --------
    >>> import femseal as fs
    >>> face = fs.self_affine((32, 64), (32e-6, 64e-6), hurst=0.8, rms_slope=0.2, roll_off=20e-6, rng=1)
    >>> scene = fs.Scene(face, 115e9, 3e9, fs.Liquid(1e-3), 1e6, 0.0, loading=(5e7, 2e8))
    >>> result = stochastic(scene, (2, 4), fs.Sampling(1e-3, realisations=4, seed=1))
    >>> result.leakage.shape, bool((result.quantile(0.5) > 0).all())
    ((4, 2), True)
    """
    cut, tiles = cut_and_tiles(scene, cells, sampling)
    map_warnings = check_map(scene, tiles, sampling.pressure_map)
    scene = remove_waves_of_forms(scene, cut, sampling.form)
    formed = solve_seal_contact(scene, tiles, sampling.form, mapper) if sampling.form else None
    if formed is None:
        fractions = pressure_fractions(scene, tiles, sampling.pressure_map)
    else:
        fractions = formed.pressure_fractions
    supply = _supply(scene, cut, tiles, fractions, mapper)
    if formed is not None:
        supply = replace(supply, opened=formed.added_permeability)
    of_surface = supply.cells
    if not np.isfinite(supply.k).any():
        raise FemsealError(f"cells: every flow failed; the first: {of_surface.failures[0]}")
    unit_leakage = open_leakage_per_permeability(scene, tiles.seal)
    mean_gap = of_surface.mean_gap.mean(axis=(1, 2))
    state = _patch_state(supply, unit_leakage * supply.at_nominal(mean_gap) ** 3 / 12)
    realisations = _solve_realisations(supply, sampling, state, mapper)
    leakage = np.array([realisation.leakage for realisation in realisations])
    median = None
    is_small = len(tiles.outlines) * len(scene.steps) <= MOST_VALUES
    median_number = (
        find_median_realisation(leakage) if sampling.median_fields and is_small else None
    )
    if median_number is not None:
        fields = partial(_median_seal, supply=supply, seed=sampling.seed)
        (median,) = mapper(Stage("median seal", fields), [median_number])
        if formed is not None:
            median = _with_form(median, tiles, formed)
    rows = fields_of_rows(of_surface.rows, scene.surface.spacing[0]) if tiles.in_order else {}
    if formed is not None and formed.grid.has_rows:
        rows = fields_of_rows(formed.row_pressure, formed.grid.spacing[0])
    estimate = estimate_scene(scene, unit_leakage) if sampling.presses_evenly else None
    median_leakage = at_every_step(leakage, np.median)
    mean_gap_of_tiles = supply.over_tiles(mean_gap)
    warnings = result_warnings(scene, median_leakage, mean_gap_of_tiles, estimate)
    if formed is not None and "row_pressure" in rows:
        warnings += line_contact_warnings(scene, rows["row_pressure"])
    realisation_failures = chain(*(realisation.failures for realisation in realisations))
    unsolved = (f"{scene.steps[s].name}: {reason}" for s, reason in supply.unsolved)
    return StochasticResult(
        steps=scene.steps,
        tiles=tiles,
        cells=of_surface,
        kind=_kind(tiles, sampling),
        patch_state=state,
        leakage=leakage,
        contact_fraction=1 - supply.over_tiles(1 - of_surface.contact_fraction.mean(axis=(1, 2))),
        patches=_patches(supply, leakage),
        **rows,
        median_seal=median,
        failures=(*of_surface.failures, *realisation_failures, *unsolved),
        quick_estimate=estimate,
        mean_gap=mean_gap_of_tiles,
        warnings=(*warnings, *tiles.warnings, *map_warnings),
        solvers=SolveCounts.total(
            (of_surface.counts, *(realisation.counts for realisation in realisations))
        ),
    )


def cut_and_tiles(scene: Scene, cells: Shape | None, sampling: Sampling) -> tuple[Cut, SealTiles]:
    """Cut the surface into cells, and cover the seal with tiles that are each as large as a cell.

    Raises InputError: see `stochastic`.
    """
    cut, tiles = cut_and_cover(scene.surface, scene.layout, cells, sampling)
    if scene.traps_liquid and not tiles.in_order:
        given = "'trapped' with a seal that takes cells anywhere of the face"
        expected = "'acts' there, or a seal as broad as the face and pressed evenly"
        raise InputError("fluid_pressure", given, expected)
    return cut, tiles


@dataclass(frozen=True, eq=False)
class _Supply:
    """Hold the permeabilities of the cells, from which every tile of a seal takes one at random.

    Parameters
    ----------
    k : permeability of every cell on every pressure path, array (fluid pressures, 2, steps, paths, cells), m³.
    path : number of the pressure path of every tile, array (tiles,).
    paths : nominal pressure of each path at every step, array (steps, paths), Pa.
    unsolved : index of each step that has no solution, and the reason.
    opened : permeability of the gap that the form of the seal opens beyond first touch, array (steps, tiles), m³.
    """

    scene: Scene
    tiles: SealTiles
    cells: FaceCells
    k: Array
    fluid: TileFluid
    path: Indices
    paths: Array
    unsolved: tuple[tuple[int, str], ...]
    opened: Array | None = None

    @property
    def solved(self) -> list[int]:
        """Indices of the steps at which all permeabilities are known."""
        known = np.flatnonzero(np.isfinite(self.k).all(axis=(0, 1, 3, 4)))
        return np.setdiff1d(known, [s for s, _ in self.unsolved]).tolist()

    def draw(self, seed: int, realisation: int) -> Indices:
        """Choose a random cell for every tile (tiles,). The same seed and realisation always give the same cells."""
        stream = np.random.SeedSequence(seed, spawn_key=(realisation,))
        return self.tiles.choose_cells(self.cells.cut.shape, np.random.default_rng(stream))

    def flow(self, cell: Indices, step: int) -> tuple[Any, Any]:
        """Solve the flow through a seal at a step, for given cells of its tiles (tiles,).

        Returns the permeabilities of the elements, and the leakage or the reason why the solver failed.
        """
        k = self.k[:, :, step, self.path, cell]  # (fluid pressure, axis, tile)
        if self.opened is not None:
            k = k + self.opened[step]
        element_k = list(self.tiles.permeability(k[:, 0], k[:, 1]))
        permeability = tabulate(self.fluid.pressures, element_k, self.fluid.piecewise)
        flow = attempt(self.scene.leakage, self.tiles.seal, permeability, REALISATION_RTOL)
        return permeability, flow

    def over_tiles(self, values: Array) -> Array:
        """Interpolate a quantity of the contact states at the pressure of each tile, and average it over the tiles.

        The quantity must decrease with increasing pressure, as a permeability does.
        """
        weights = np.bincount(self.path, minlength=self.paths.shape[1]) / self.path.size
        return self._interpolate(values, self.paths, weights)

    def at_nominal(self, values: Array) -> Array:
        """Interpolate a quantity of the contact states at the nominal pressures of the load steps.

        The quantity must decrease with increasing pressure, as a permeability does.
        """
        return self._interpolate(values, self.scene.steps.pressures[:, None], np.ones(1))

    def _interpolate(self, values: Array, paths: Array, weights: Array) -> Array:
        """Interpolate a quantity of the contact states at each step of pressure paths, and average over the paths.

        The mean fluid pressure reduces the nominal pressures of the paths first.

        values : (states,). paths : nominal pressures (steps, paths) [Pa]. weights : of the paths in the average.
        """
        if self.cells.steps == self.scene.steps:
            return values
        fluid = self.scene.acting_fluid
        relief = 0.0 if fluid is None else float(fluid.relief([fluid.mean])[0])
        curves = CellCurves(self.cells.steps, values)
        return curves.k_on_paths(np.maximum(paths - relief, 0.0), self.scene.steps) @ weights


def _patch_state(supply: _Supply, open_leakage: Array) -> PatchState:
    """Return the contact states of the patch, for nominal pressures that are reduced by the mean fluid pressure.

    open_leakage : leakage if the gap were everywhere equal to the mean gap of the state, array (steps,), m²/s.
    """
    scene = supply.scene
    fluid = scene.acting_fluid
    relief = 0.0 if fluid is None else float(fluid.relief([fluid.mean])[0])
    pressures = np.maximum(scene.steps.pressures - relief, 0.0)
    return PatchState.of(scene.steps, supply.cells, pressures, open_leakage)


def _supply(scene: Scene, cut: Cut, tiles: SealTiles, fractions: Array, mapper: Mapper) -> _Supply:
    """Solve the cells: at the loads of the scene if they stay in order, else at tabulated pressures.

    fractions : pressure of each tile, as a fraction of the nominal pressure, array (steps, tiles).
    """
    steps, drop = scene.steps, scene.flow.drop
    if tiles.in_order:
        # grooves that wind are those of the seal
        flat = scene if scene.flow.spiral is None else replace(scene, layout=RectangularLayout())
        cells = cut_into_cells(flat, cut, mapper).cells
        assert cells is not None
        k = cells.k.reshape(*cells.k.shape[:3], 1, -1)
        fluid = TileFluid(tuple(drop.pressures))
        path = np.zeros(tiles.count, np.int64)
        nominal = steps.pressures[:, None]
        return _Supply(scene, tiles, cells, k, fluid, path, nominal, cells.unsolved)
    path_fractions, path_of_tile = distinct_paths(fractions)
    nominal = steps.pressures[:, None] * path_fractions
    fluid = TileFluid.of(scene)
    effective = fluid.effective_pressures(nominal)
    is_uniform = effective.shape[1] == 1 and np.array_equal(effective[:, 0], steps.pressures)
    if is_uniform:
        # all tiles have the pressure of the load steps: nothing to interpolate
        cells = solve_cells_at_pressures(scene, cut, steps, mapper)
        k = cells.corrected_k.reshape(*cells.k.shape[:3], 1, -1)
    else:
        tabulated_steps = choose_tabulated_pressures(effective, steps, scene.law.is_elastic)
        cells = solve_cells_at_pressures(scene, cut, tabulated_steps, mapper)
        k = fluid.select_matching_reliefs(interpolate_along_paths(cells, effective, steps))
    return _Supply(scene, tiles, cells, k, fluid, path_of_tile, nominal, scene.separated_steps)


@dataclass(frozen=True, eq=False)
class _Realisation:
    """Hold the leakage of a realisation at every step (steps,) [m²/s]; it is NaN at steps that failed."""

    leakage: Array
    failures: list[str]
    counts: SolveCounts


def _solve_realisations(
    supply: _Supply, sampling: Sampling, state: PatchState, mapper: Mapper
) -> list[_Realisation]:
    """Solve the given number of realisations, or as many as the interval needs."""
    stage = Stage("realisations", partial(_realise, supply=supply, seed=sampling.seed))
    kind = _kind(supply.tiles, sampling)
    count = sampling.realisations or FEWEST_SEALS
    realisations = list(mapper(stage, range(count)))
    while sampling.realisations is None:
        leakage = np.array([realisation.leakage for realisation in realisations])
        count = min(_needed(leakage, kind, state), 4 * len(realisations))
        if count <= len(realisations):
            break
        realisations += mapper(stage, range(len(realisations), count))
    return realisations


def _kind(tiles: SealTiles, sampling: Sampling) -> str:
    """Return the kind of the realisations, see `patch_interval`.

    Only forms that were measured at points make the kind "with form"; the form of a seat is known exactly.
    """
    if any(isfinite(form.shortest_wave) for form in sampling.form):
        return "with form"
    return "in order" if tiles.in_order else "at random"


def _needed(leakage: Array, kind: str, state: PatchState) -> int:
    """Return how many realisations are needed for the desired standard error of the median at every step.

    The desired error is a fraction of the 95 % interval that results from measuring only one patch. Steps at which this
    interval begins at 0 are ignored, because more realisations would not make it narrower there.
    """
    median = at_every_step(leakage, np.median)
    lower, upper = interval_widths(kind).ends(median, state)
    counts = lower > 0
    width = np.log(upper[counts] / lower[counts]) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = np.log(np.abs(leakage[:, counts])).std(axis=0, ddof=1)
    wanted = (_MEDIAN_ERROR * spread / (MEDIAN_ERROR_FRACTION * width)) ** 2
    most = float(np.max(wanted[np.isfinite(wanted)], initial=0.0))
    return int(np.clip(np.ceil(most), FEWEST_SEALS, MOST_SEALS))


def _realise(realisation: int, *, supply: _Supply, seed: int) -> _Realisation:
    """Solve the flow through one realisation at every step at which the permeabilities are known.

    Where cells stay in order, the leakage is that of the whole surface, multiplied by the ratio of the leakage of the
    tiles to that of the grid of cells. This ratio is limited to the range from 1/2 to 2.
    """
    cell = supply.draw(seed, realisation)
    steps = supply.scene.steps
    leakage = np.full(len(steps), np.nan)
    failures: list[str] = []
    counts = []
    surface_leakage = supply.cells.surface_leakage
    cells_leakage = supply.cells.cells_leakage
    for s in supply.solved:
        if supply.tiles.in_order and cells_leakage[s] == 0:
            leakage[s] = surface_leakage[s]
            continue
        _, flow = supply.flow(cell, s)
        if isinstance(flow, Failed):
            failures.append(f"realisation {realisation}, {steps[s].name}: {flow.reason}")
            continue
        leakage[s] = flow.per_length
        counts.append(SolveCounts.of(flow))
        if supply.tiles.in_order:
            ratio = np.clip(leakage[s] / cells_leakage[s], 1 / MOST_RATIO, MOST_RATIO)
            leakage[s] = surface_leakage[s] * ratio
    return _Realisation(leakage, failures, SolveCounts.total(counts))


def _median_seal(realisation: int, *, supply: _Supply, seed: int) -> MedianSeal:
    """Solve a realisation a second time, and keep its fields over the elements."""
    scene, tiles, cell = supply.scene, supply.tiles, supply.draw(seed, realisation)
    shape = len(scene.steps), len(tiles.outlines)
    k, p, flux = (np.full((*shape, *plane), np.nan) for plane in ((), (), (2,)))
    for s in supply.solved:
        permeability, flow = supply.flow(cell, s)
        if isinstance(flow, Failed):
            continue
        if flow.permeability is not None:  # that of the solution, where it depends on the pressure
            permeability = flow.permeability
        k[s], p[s] = tiles.element_means(permeability, flow.fluid_pressure)
        potential = scene.fluid.potential(flow.fluid_pressure) / scene.fluid.reference_density
        flux[s] = tiles.flux(permeability, potential, flow.volume_rate)
    if supply.tiles.in_order:
        pressure = supply.cells.pressure.reshape(len(scene.steps), -1)[:, cell[tiles.tile]]
    else:
        pressure = supply.paths[:, supply.path[tiles.tile]]
        if (fluid := scene.acting_fluid) is not None:
            pressure = np.maximum(pressure - np.nan_to_num(fluid.relief(p)), 0.0)
    once = tiles.unrepeated_elements
    return MedianSeal(
        realisation, tiles.outlines[once], k[:, once], p[:, once], flux[:, once], pressure[:, once]
    )


def _with_form(median: MedianSeal, tiles: SealTiles, formed: SealContact) -> MedianSeal:
    """Add the form of the seal and the contact under this form to the fields of the median realisation."""
    of_parts = tiles.tile[tiles.unrepeated_elements]
    form = formed.grid.means(-formed.depth)[of_parts]
    separation, pressure = (
        formed.grid.means(values)[:, of_parts] for values in (formed.separation, formed.pressure)
    )
    return replace(median, form=form, separation=separation, nominal=pressure)


def _patches(supply: _Supply, leakage: Array) -> PatchLeakage | None:
    """Estimate the leakage of a seal that would be made of each measured patch alone; None if there is only one.

    It is the median leakage of the realisations, multiplied by the ratio of the leakage of the patch to that of the
    whole surface.
    """
    cells = supply.cells
    if cells.patches is None:
        return None
    face, *patches = map(supply.at_nominal, (cells.surface_leakage, *cells.patches.selections))
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(face > 0, at_every_step(leakage, np.median) / face, 1.0)
    return PatchLeakage(scale * np.array(patches))

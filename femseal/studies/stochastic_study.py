"""Run the stochastic study: compute the leakage of seals whose tiles take random cells of a measured surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from math import isfinite
from typing import Any

import numpy as np

from ..base import Array, FemsealError, Mapper, Shape, Stage
from ..checks import (
    QuickEstimate,
    estimate_scene,
    limited_factor_warnings,
    limited_median_warnings,
    line_contact_warnings,
    result_warnings,
)
from ..face.cell_flow import Failed, SolveCounts
from ..face.cells import MOST_FACTOR, MOST_RATIO
from ..scene import Scene
from ..seal.tiles import SealTiles
from .cell_supply import CellSupply, supply_cells
from .face_result import fields_of_rows
from .median_seal import solve_median_seal
from .patch_interval import interval_widths
from .patch_leakage import PatchLeakage
from .patch_state import PatchState, open_leakage_per_permeability
from .sampling import FEWEST_BY_DEFAULT, MOST_BY_DEFAULT, Sampling, cut_and_tiles
from .seal_contact import SealContact, remove_waves_of_forms, solve_seal_contact
from .stochastic_result import StochasticResult, at_every_step
from .tile_pressure import check_map, pressure_fractions

#: Desired standard error of ln(median leakage), divided by the half-width of the 95 % interval for a single patch.
MEDIAN_ERROR_FRACTION = 1 / 20
#: Standard error of the median of n normally distributed numbers, in units of their standard deviation over √n.
_MEDIAN_ERROR = 1.2533


def stochastic(
    scene: Scene,
    cells: Shape | None,
    sampling: Sampling,
    *,
    mapper: Mapper = map,
) -> StochasticResult:
    """Compute the leakage of seals of any size and shape, whose tiles take random cells of a surface.

    The contact of the whole surface is solved, and the surface is then cut into cells. The cells stay in order if the
    seal is as wide as the surface and all tiles have the same pressure. If the cells stay in order, the contact is
    solved at the load steps of the scene. For cells at random, the contact is solved at tabulated pressures, and the
    permeability of a cell is interpolated at the contact pressure of its tile. The contact pressure of a tile is its
    nominal pressure minus the pressure that the fluid carries. The permeabilities are multiplied by a correction factor
    for each axis and contact state, so that the grid of cells in their original order leaks as much as the whole
    surface.

    Parameters
    ----------
    scene : Scene
        The surface, its load and its fluid.
    cells : (int, int) or None
        Numbers of cells along x1 and x2. By default, the shorter side of the surface is divided into four cells, or
        into two if the cells stay in order.
    sampling : Sampling
        Size of the seal, number of realisations and other options. If no number is given, realisations are added until
        the standard error of the median leakage is a twentieth of the half-width of the 95 % interval for a single
        patch. At least three realisations are solved.
    mapper : callable
        Function such as the builtin `map`, which computes a stage for many items, possibly in several processes.

    Raises
    ------
    InputError
        The cells are too small; the length or width of the seal is missing or given twice; or the pressure map does not
        cover the seal. The error is also raised if liquid is trapped and the cells do not stay in order.
    NotConverged
        A contact solver failed.
    FemsealError
        The flow solver failed for every cell.

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
    contact = None  # contact of the whole seal, for a seal with a form deviation
    if sampling.form:
        contact = solve_seal_contact(scene, tiles, sampling.form, mapper)
        supply = supply_cells(scene, cut, tiles, contact.pressure_fractions, mapper)
        supply = replace(supply, added_k=contact.added_permeability)
    else:
        fractions = pressure_fractions(scene, tiles, sampling.pressure_map)
        supply = supply_cells(scene, cut, tiles, fractions, mapper)
    face_cells = supply.cells
    if not np.isfinite(supply.k).any():
        raise FemsealError(
            f"cells: the flow solver failed for every cell; first failure: {face_cells.failures[0]}"
        )
    unit_leakage = open_leakage_per_permeability(scene, tiles.seal)
    mean_gap = face_cells.mean_gap.mean(axis=(1, 2))  # of the surface in each contact state
    # leakage of a uniform gap that is equal to the mean gap
    open_leakage = unit_leakage * supply.at_nominal(mean_gap) ** 3 / 12
    state = supply.patch_state(open_leakage)
    realisations = _solve_realisations(supply, sampling, state, mapper)
    leakage = np.array([realisation.leakage for realisation in realisations])
    median_seal = solve_median_seal(supply, sampling, leakage, contact, mapper)
    estimate = estimate_scene(scene, unit_leakage) if sampling.presses_evenly else None
    tile_gap = supply.over_tiles(mean_gap)
    row_fields = _row_fields(supply, contact)
    warnings = _result_warnings(supply, leakage, tile_gap, estimate, contact, row_fields)
    # the separated fraction decreases with the pressure, as `over_tiles` requires
    separated_fraction = 1 - face_cells.contact_fraction.mean(axis=(1, 2))
    counts = [face_cells.solve_counts, *(realisation.solve_counts for realisation in realisations)]
    return StochasticResult(
        steps=scene.steps,
        tiles=tiles,
        cells=face_cells,
        kind=_kind(tiles, sampling),
        patch_state=state,
        leakage=leakage,
        contact_fraction=1 - supply.over_tiles(separated_fraction),
        patches=_patch_leakage(supply, leakage),
        **row_fields,
        median_seal=median_seal,
        failures=_failures(supply, realisations),
        quick_estimate=estimate,
        mean_gap=tile_gap,
        warnings=(*warnings, *tiles.warnings, *map_warnings),
        solve_counts=SolveCounts.total(counts),
    )


@dataclass(frozen=True, eq=False)
class _Realisation:
    """Leakage of a realisation at every load step (steps,) [m²/s]; NaN where the flow solver failed."""

    leakage: Array
    failures: list[str]
    solve_counts: SolveCounts


def _solve_realisations(
    supply: CellSupply, sampling: Sampling, state: PatchState, mapper: Mapper
) -> list[_Realisation]:
    """Solve the given number of realisations, by default the number that `_count_needed` returns."""
    stage = Stage("realisations", partial(_realise, supply=supply, seed=sampling.seed))
    kind = _kind(supply.tiles, sampling)
    count = sampling.realisations or FEWEST_BY_DEFAULT
    realisations = list(mapper(stage, range(count)))
    while sampling.realisations is None:
        leakage = np.array([realisation.leakage for realisation in realisations])
        # a few realisations say little about the scatter, so that their number grows at most fourfold at once
        count = min(_count_needed(leakage, kind, state), 4 * len(realisations))
        if count <= len(realisations):
            break
        realisations += mapper(stage, range(len(realisations), count))
    return realisations


def _kind(tiles: SealTiles, sampling: Sampling) -> str:
    """Return the kind of computation, see `patch_interval`.

    The kind "with form" is for seals whose form deviation was measured at points. A measured form deviation is
    recognised by its finite shortest wavelength. A nominal form, such as a seat, is known exactly and has an infinite
    shortest wavelength; seals with such a form belong to another kind.
    """
    if any(isfinite(form.shortest_wave) for form in sampling.form):
        return "with form"
    return "in order" if tiles.in_order else "at random"


def _count_needed(leakage: Array, kind: str, state: PatchState) -> int:
    """Return the number of realisations for which the standard error of the median leakage is small enough.

    The standard error of the median of n realisations is 1.2533 σ/√n, where σ is the standard deviation of ln(leakage).
    The largest allowed standard error is `MEDIAN_ERROR_FRACTION` times the half-width of the 95 % interval for a single
    measured patch. Load steps at which the 95 % interval starts at 0 are ignored, because further realisations cannot
    narrow it there.

    leakage : leakage of the realisations solved so far (realisations, steps) [m²/s].
    """
    median = at_every_step(leakage, np.median)
    lower, upper = interval_widths(kind).ends(median, state)
    is_counted = lower > 0
    half_width = np.log(upper[is_counted] / lower[is_counted]) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        deviation = np.log(np.abs(leakage[:, is_counted])).std(axis=0, ddof=1)
    # solve _MEDIAN_ERROR · deviation/√n = MEDIAN_ERROR_FRACTION · half_width for n, at every counted step
    counts = (_MEDIAN_ERROR * deviation / (MEDIAN_ERROR_FRACTION * half_width)) ** 2
    largest = float(np.max(counts[np.isfinite(counts)], initial=0.0))
    return int(np.clip(np.ceil(largest), FEWEST_BY_DEFAULT, MOST_BY_DEFAULT))


def _realise(realisation: int, *, supply: CellSupply, seed: int) -> _Realisation:
    """Solve the flow through one realisation at every load step at which the permeabilities are known.

    For cells in order, the leakage Q_t of the tiles is corrected: the returned leakage is Q_t Q/Q_c, where Q is the
    leakage of the whole surface and Q_c the leakage of the grid of cells. The ratio Q_t/Q_c is limited to the range
    from 1/2 to 2.
    """
    cell_of_tile = supply.choose_cells(seed, realisation)
    steps = supply.scene.steps
    leakage = np.full(len(steps), np.nan)
    failures: list[str] = []
    counts = []
    surface_leakage = supply.cells.surface_leakage
    cells_leakage = supply.cells.cells_leakage
    for s in supply.solved_steps:
        if supply.tiles.in_order and cells_leakage[s] == 0:
            # the grid of cells is sealed, so that Q_t/Q_c is not defined
            leakage[s] = surface_leakage[s]
            continue
        _, flow = supply.solve_flow(cell_of_tile, s)
        if isinstance(flow, Failed):
            failures.append(f"realisation {realisation}, {steps[s].name}: {flow.reason}")
            continue
        leakage[s] = flow.per_length
        counts.append(SolveCounts.of(flow))
        if supply.tiles.in_order:
            ratio = np.clip(leakage[s] / cells_leakage[s], 1 / MOST_RATIO, MOST_RATIO)
            leakage[s] = surface_leakage[s] * ratio
    return _Realisation(leakage, failures, SolveCounts.total(counts))


def _row_fields(supply: CellSupply, contact: SealContact | None) -> dict[str, Any]:
    """Return the fields of the rows of the seal, such as the mean contact pressure of each row.

    The returned dictionary is empty for a mesh without rows, and for cells at random without a form deviation.
    """
    if contact is not None and contact.grid.has_rows:
        return fields_of_rows(contact.row_pressure, contact.grid.spacing[0])
    if supply.tiles.in_order:
        return fields_of_rows(supply.cells.row_pressure, supply.scene.surface.spacing[0])
    return {}


def _result_warnings(
    supply: CellSupply,
    leakage: Array,
    tile_gap: Array,
    estimate: QuickEstimate | None,
    contact: SealContact | None,
    row_fields: dict[str, Any],
) -> tuple[str, ...]:
    """Check the plausibility of the median leakage and, for a seal with a form deviation, of the contact pressure."""
    scene = supply.scene
    median_leakage = at_every_step(leakage, np.median)
    warnings = result_warnings(
        scene, median_leakage, tile_gap, estimate, edge_distance=_edge_distance(supply)
    )
    if contact is not None and "row_pressure" in row_fields:
        warnings += line_contact_warnings(scene, row_fields["row_pressure"])
    cells = supply.cells
    if supply.tiles.in_order:
        limits = limited_median_warnings(
            scene.steps, median_leakage, cells.surface_leakage, MOST_RATIO
        )
    else:
        limits = limited_factor_warnings(
            scene.steps,
            median_leakage,
            cells.steps,
            cells.surface_leakage,
            cells.cells_leakage,
            MOST_FACTOR,
            contact_pressures=supply.contact_pressures,
        )
    return (*warnings, *limits)


def _edge_distance(supply: CellSupply) -> Array:
    """Interpolate the mean edge distance [m] at the load steps on loading; NaN at load steps on unloading."""
    cells, steps = supply.cells, supply.scene.steps
    is_known = cells.steps.on_loading & np.isfinite(cells.edge_distance)
    if not is_known.any():
        return np.full(len(steps), np.nan)
    # only tabulated contact states lack the relief by the fluid pressure
    pressures = steps.pressures if cells.steps == steps else supply.contact_pressures
    interpolated = np.interp(
        pressures, cells.steps.pressures[is_known], cells.edge_distance[is_known]
    )
    return np.where(steps.on_loading, interpolated, np.nan)


def _failures(supply: CellSupply, realisations: list[_Realisation]) -> tuple[str, ...]:
    """List the failures of cells and realisations, and the load steps without a solution."""
    failures = list(supply.cells.failures)
    for realisation in realisations:
        failures += realisation.failures
    steps = supply.scene.steps
    failures += [f"{steps[s].name}: {reason}" for s, reason in supply.unsolved]
    return tuple(failures)


def _patch_leakage(supply: CellSupply, leakage: Array) -> PatchLeakage | None:
    """Estimate the leakage of seals whose cells come from a single measured patch; None if there is only one patch.

    The estimated leakage is Q Q_p/Q_s, where Q is the median leakage of the realisations, Q_p the leakage of the patch
    and Q_s the leakage of the whole surface with all patches.
    """
    cells = supply.cells
    if cells.patches is None:
        return None
    surface = supply.at_nominal(cells.surface_leakage)
    selections = np.array([supply.at_nominal(values) for values in cells.patches.selections])
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(surface > 0, at_every_step(leakage, np.median) / surface, 1.0)
    return PatchLeakage(scale * selections)

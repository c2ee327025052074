"""The stochastic study: seals of any length, whose windows are drawn from a library of real ones."""

from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base import Array, InputError, Mapper, Stage, counted, to_text
from ..library import LadderLibrary
from ..seal import RectangularSeal
from ..seal.laid_windows import LinkWindows, SealWindows
from ..windows import Failed, Partition, SolverCounts, attempt
from .face_leakage import PLACE_REALISATIONS, PlaceLeakage, first_equal_draws, kept_places, repeated
from .ladder_windows import windows_under_global_contact, windows_under_uniform_pressure
from .run_chains import StateRuns, chained_seals
from .sampling_options import Sampling, check_sampling, chosen_sampler, lay_out_windows
from .scene import Scene, scene_warnings
from .stochastic_result import (
    DRAWN_RTOL,
    MOST_VALUES,
    RESAMPLED_RTOL,
    StochasticResult,
    drawn_permeability,
    median_chain,
    median_seal,
    nearest_to_median,
)
from .two_scale import TwoScaleResult
from .window_supply import FaceLibrary, Source, TablePressures, Tables, WindowRequest, WindowSupply, windows_in_place

#: For a given `width`: how often realisations and windows are added, and up to what multiple of the given numbers.
ROUNDS, GROWTH = 4, 8
#: Source of windows for every `Sampling.pressure`.
SOURCES: dict[str, Source] = {
    "place": windows_in_place,
    "global": windows_under_global_contact,
    "uniform": windows_under_uniform_pressure,
}
#: Which windows a seal is drawn from: all, as many drawn from them with repetition, or those of some places.
Windows = bool | tuple[int, ...]
#: Leakages of a result whose last axis is that of the steps.
_BY_STEP = tuple(f.name for f in fields(StochasticResult) if f.name.startswith("leakage"))


def stochastic(
    scene: Scene,
    cells: tuple[int, int],
    sampling: Sampling,
    *,
    contact: str | None = None,
    two_scale: TwoScaleResult | None = None,
    mapper: Mapper = map,
) -> StochasticResult:
    """Build a library of real windows, draw seals from it, and solve the flow over each seal at every step.

    Parameters
    ----------
    scene : the face, its load and its fluid.
    cells : number of windows of the face along x1 and x2.
    sampling : how seals are drawn.
    contact : how the contact of windows with the pressure "place" is solved, see `two_scale`.
    two_scale : the two-scale solution of the same scene and cells; its windows are not solved again ("place").
    mapper : computes a stage for many items, such as the builtin `map`; it may use several processes.

    Raises
    ------
    InputError : an option does not exist or does not go with the others.
    FemsealError : every window of the library failed.
    """
    check_sampling(sampling)
    if sampling.width is not None and not sampling.resampled:
        raise InputError("resampled", "False with a width", "True with it: the error of the library has to be known")
    sampling = replace(sampling, sampler=chosen_sampler(sampling, scene, two_scale.contact if two_scale else contact))
    if sampling.sampler == "runs" and scene.discretisation != "edge":
        raise InputError("sampler", f"'runs' with the discretisation '{scene.discretisation}'", "'edge' with it")
    if sampling.width is None:
        return _draw(scene, cells, sampling, contact, two_scale, mapper)
    with TemporaryDirectory() as folder:
        # the next round keeps the windows that this one has solved
        growing = replace(sampling, library=sampling.library or Path(folder))
        result = _draw(scene, cells, growing, contact, two_scale, mapper)
        for _ in range(ROUNDS):
            realisations, windows = result.needed(sampling.width)
            wanted = replace(
                growing,
                realisations=int(np.clip(realisations, growing.realisations, GROWTH * sampling.realisations)),
                library_cells=_grown(windows, growing, result.library, GROWTH * sampling.library_cells),
            )
            if wanted == growing:
                break
            growing = wanted
            result = _draw(scene, cells, growing, contact, two_scale, mapper)
    realisations, windows = result.needed(sampling.width)
    if realisations > len(result.leakage) or windows > result.library.independent:
        text = (
            f"width {sampling.width:g} not reached: about {counted(realisations, 'realisation')} and "
            f"{counted(windows, 'window')} without overlap needed, "
            f"{len(result.leakage)} and {result.library.independent} used"
        )
        result = replace(result, warnings=(*result.warnings, text))
    return result


def _draw(
    scene: Scene,
    cells: tuple[int, int],
    sampling: Sampling,
    contact: str | None,
    two_scale: TwoScaleResult | None,
    mapper: Mapper,
) -> StochasticResult:
    """Draw the seals of all lengths from one supply of windows."""
    partition = Partition(scene.surface.shape, scene.surface.spacing, cells)
    every = lay_out_windows(scene.layout, partition, sampling)
    longest = max(every, key=lambda seal_windows: seal_windows.draws[0][1])
    supply = SOURCES[sampling.pressure](WindowRequest(scene, partition, sampling, longest, two_scale, contact, mapper))
    of = _of_runs if sampling.sampler == "runs" else _of_windows
    first, *others = (
        _without(of(scene, partition, sampling, supply, seal_windows, mapper), supply) for seal_windows in every
    )
    library = supply.library
    failures = (f"{to_text(seals.seal.size[1], 'm')}, {text}" for seals in others for text in seals.failures)
    return replace(
        first,
        pressure=sampling.pressure,
        window=partition.window,
        places=supply.places or first.places,
        other_lengths=tuple(others),
        row_pressure=None if supply.seat is None else supply.seat.pressure,
        band_breadth=None if supply.seat is None else supply.seat.band,
        largest_row_pressure=None if supply.seat is None else supply.seat.pressure.max(axis=1),
        failures=library.failures + first.failures + tuple(failures),
        warnings=scene_warnings(scene) + first.warnings + supply.warnings,
        solvers=library.counts.solvers
        + SolverCounts.total(state.solvers for state in supply.runs if isinstance(state, StateRuns))
        + SolverCounts.total(seals.solvers for seals in (first, *others)),
    )


def _without(seals: StochasticResult, supply: WindowSupply) -> StochasticResult:
    """The seals without leakage at the steps at which the windows have no gap."""
    for s, _ in supply.unsolved:
        for name in _BY_STEP:
            if (values := getattr(seals, name)) is not None:
                values[..., s] = np.nan
    failures = (f"{seals.steps[s].name}: {reason}" for s, reason in supply.unsolved)
    return replace(seals, failures=(*seals.failures, *failures))


def _of_windows(
    scene: Scene,
    partition: Partition,
    sampling: Sampling,
    supply: WindowSupply,
    seal_windows: SealWindows,
    mapper: Mapper,
) -> StochasticResult:
    """Seals of one length, whose windows are drawn one by one or in blocks."""
    if isinstance(seal_windows, LinkWindows):
        seal_windows = seal_windows.with_rows(supply.node_rows)
    library = supply.library
    kinds = tuple(_for(seal_windows, tables) for tables in supply.tables)
    shared: dict[str, Any] = {"scene": scene, "seal_windows": seal_windows, "sampling": sampling, "at": supply.at}
    shared["unsolved"] = frozenset(s for s, _ in supply.unsolved)
    independent = library.independent / library.size
    first = first_equal_draws(kinds, scene.steps, sampling.sampler_of_links)
    stage = Stage("drawn seals", partial(_realise, **shared, kinds=kinds, independent=independent, first=first))
    count = sampling.realisations
    tasks: list[tuple[int, Windows]] = [
        (n, again) for again in (False, True)[: 1 + sampling.resampled] for n in range(count)
    ]
    own, number = len(tasks), getattr(library, "place", None)
    some = () if number is None or number.max() == 1 else kept_places(int(number.max()))
    tasks += [(n, kept) for kept in some for n in range(min(count, PLACE_REALISATIONS))]
    drawn = list(mapper(stage, *zip(*tasks, strict=True)))[: len(tasks)]
    leakage, *bounds = np.array([r.leakage for r in drawn[:count]]).transpose(1, 0, 2)
    lower, upper = bounds or (None, None)
    few = sampling.median_fields and len(seal_windows.outlines) * len(scene.steps) <= MOST_VALUES
    chosen = nearest_to_median(leakage) if few else None
    again = Stage("median seal", partial(median_seal, **shared, kinds=kinds[: len(supply.at.pressures)]))
    medians = [] if chosen is None else list(mapper(again, [chosen]))
    return StochasticResult(
        steps=scene.steps,
        seal=seal_windows.seal,
        sampler=sampling.sampler_of_links,
        library=library,
        leakage=leakage,
        leakage_resampled=np.array([r.leakage[0] for r in drawn[count:own]]) if sampling.resampled else None,
        leakage_lower_bound=lower,
        leakage_upper_bound=upper,
        median_seal=medians[0] if medians else None,
        places=PlaceLeakage.of_drawn(np.array([r.leakage[0] for r in drawn[own:]]), some),
        failures=tuple(text for r in drawn for text in r.failures),
        warnings=seal_windows.warnings,
        solvers=SolverCounts.total(r.solvers for r in drawn),
        equal_steps=repeated(first),
    )


def _for(seal_windows: SealWindows, tables: Tables) -> Tables:
    """Tables of the first columns of links of a longer seal: a realisation begins with that of the shorter one."""
    along, across = (
        t if t.path.shape[1] == columns else replace(t, path=t.path[:, :columns])
        for t, (_, columns) in zip(tables, seal_windows.draws, strict=True)
    )
    return along, across


def _of_runs(
    scene: Scene,
    partition: Partition,
    sampling: Sampling,
    supply: WindowSupply,
    seal_windows: SealWindows,
    mapper: Mapper,
) -> StochasticResult:
    """Seals of one length, drawn as chains of runs of the face."""
    drawn = chained_seals(scene, partition, supply.runs, seal_windows.draws[0][1], sampling.realisations, sampling.seed)
    cells, (d1, d2) = (partition.cells[0], drawn.columns), partition.window_size
    few = sampling.median_fields and cells[0] * cells[1] * len(scene.steps) <= MOST_VALUES
    chosen = nearest_to_median(drawn.leakage) if few else None
    shown: dict[str, Any] = {"scene": scene, "partition": partition, "drawn": drawn, "states": supply.runs}
    # windows row after row, as the face has them
    pressure = supply.library.curves.pressure.T.reshape(-1, *partition.cells)
    return StochasticResult(
        steps=scene.steps,
        seal=RectangularSeal((cells[0] * d1, cells[1] * d2), cells, supply.node_rows),
        sampler="runs",
        library=supply.library,
        leakage=drawn.leakage,
        leakage_resampled=drawn.resampled if sampling.resampled else None,
        leakage_neumann_cuts=drawn.neumann,
        leakage_dirichlet_cuts=drawn.dirichlet,
        leakage_of_face=drawn.of_face,
        median_seal=None if chosen is None else median_chain(chosen, **shown, pressure=pressure),
        failures=tuple(
            f"runs, {step.name}: {state.reason}"
            for step, state in zip(scene.steps, supply.runs, strict=True)
            if isinstance(state, Failed)
        ),
        warnings=drawn.warnings,
        equal_steps=len(supply.runs) - len({*map(id, supply.runs)}),
    )


@dataclass(frozen=True, eq=False)
class Realisation:
    """Leakage of one drawn seal at every step (kinds, steps) [m²/s], NaN where it failed.

    The kinds are the value, and with bounds its lower and its upper bound.
    """

    leakage: Array
    failures: tuple[str, ...]
    solvers: SolverCounts


def _realise(
    realisation: int,
    windows: Windows,
    *,
    scene: Scene,
    seal_windows: SealWindows,
    kinds: tuple[Tables, ...],
    sampling: Sampling,
    at: TablePressures,
    unsolved: frozenset[int],
    independent: float,
    first: NDArray[np.int64],
) -> Realisation:
    """Draw one seal and solve its flow at every step but those without leakage, `unsolved`.

    The same random numbers draw the same windows from each kind of tables. Each kind has a table for every pressure of
    `at`. windows : True draws a new library from the library, and numbers of places take their windows alone; then
    values have no bounds.
    first : number of the first step with the same windows.
    """
    steps, pressures = scene.steps, len(at.pressures)
    if windows is True:
        kinds = tuple(_resample(tables, sampling.seed, realisation, independent) for tables in kinds[:pressures])
    elif windows:
        kinds = tuple(_of_places(tables, windows) for tables in kinds[:pressures])
    leakage = np.full((len(kinds) // pressures, len(steps)), np.nan)
    failures, solvers = [], SolverCounts()
    near = None
    for kind in range(len(leakage)):
        permeability = drawn_permeability(
            seal_windows, kinds[kind * pressures : (kind + 1) * pressures], sampling, realisation, at
        )
        for s, step in enumerate(steps):
            if s in unsolved:
                continue
            if first[s] < s:
                leakage[kind, s] = leakage[kind, first[s]]
                continue
            rtol = RESAMPLED_RTOL if windows is True else DRAWN_RTOL
            found = attempt(scene.leakage, seal_windows.seal, permeability(s), rtol, rate_only=True, near=near)
            if isinstance(found, Failed):
                failures.append(f"realisation {realisation}, {step.name}: {found.reason}")
            else:
                near = found
                leakage[kind, s] = found.per_length
                solvers += SolverCounts.of(found)
    return Realisation(leakage, tuple(failures), solvers)


def _of_places(tables: Tables, kept: tuple[int, ...]) -> Tables:
    """Tables of the windows of some measured places."""
    taken = np.isin(np.asarray(tables[0].place), kept)
    along, across = (replace(t, k=t.k[:, :, taken], place=None) for t in tables)
    return along, across


def _grown(windows: int, sampling: Sampling, library: LadderLibrary | FaceLibrary, most: int) -> int:
    """Size of the next library: windows that overlap others lessen no error."""
    if isinstance(library, FaceLibrary):
        return sampling.library_cells
    return max(sampling.library_cells, min(windows, most, library.tiles))


def _resample(tables: Tables, seed: int, realisation: int, independent: float) -> Tables:
    """Tables of cells drawn with repetition, as many as do not overlap; neighbours that are alike are drawn together.

    independent : fraction of the cells that do not overlap.
    """
    cells = tables[0].k.shape[2]
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(realisation, 2)))
    length = min(max(1, round(tables[0].correlation_length)), cells)
    count = max(1, round(cells * independent))
    first = rng.integers(cells, size=-(-count // length))
    taken = ((first[:, None] + np.arange(length)) % cells).ravel()[:count]
    first_table, second = (replace(t, k=t.k[:, :, taken]) for t in tables)
    return first_table, second

"""The stochastic study: seals of any length, whose windows are drawn from a library of real ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ..base.errors import InputError
from ..base.stage import Mapper, Stage
from ..base.text import Shown
from ..loads import LoadProgramme
from ..scales import Failed, LadderLibrary, Partition, SolverCounts, attempt, draw_links
from ..seal import RectangularSeal
from .chained import StateRuns, chained_seals
from .followed import windows_under_global_contact, windows_under_uniform_pressure
from .placed import windows_in_place
from .plausibility import odd_in_scene
from .sampling_options import Sampling, check_sampling, chosen_sampler, seal_cells
from .scene import Array, Scene, labels
from .sources import PlacedLibrary, Source, Tables, Wanted, WindowSupply
from .two_scale import TwoScaleResult

#: For a given `width`: how often realisations and windows are added, and up to what multiple of the given numbers.
ROUNDS, GROWTH = 4, 8
#: Source of windows for every `Sampling.pressure`.
SOURCES: dict[str, Source] = {
    "place": windows_in_place,
    "global": windows_under_global_contact,
    "uniform": windows_under_uniform_pressure,
}


@dataclass(frozen=True, repr=False)
class StochasticResult(Shown):
    """Realisations of a seal drawn from a library. A realisation is a curve over the steps: arrays (realisation, step).

    sampler : how they were drawn, see `sampling_options.chosen_sampler`.
    leakage : of each realisation.
    leakage_resampled : of as many more realisations, each from a library that is drawn with repetition from the library
        itself, of as many windows as do not overlap. Their scatter is that of realisations and library together.
    leakage_lower_bound, leakage_upper_bound : of the realisations in `leakage`, with the bounds of every window's
        permeability; None without bounds. They enclose the flow through gaps constant on each pixel: their distance
        says how well the pixels resolve the gaps.
    leakage_closed_cuts, leakage_held_cuts : of the realisations in `leakage`, with the cuts between runs of columns
        closed, and held at one profile of the fluid pressure; None unless the sampler is "runs". The leakage of a chain
        of these runs lies between them.
    failures : reasons of values that are NaN or left out. warnings : reasons to doubt the result.
    solvers : number of systems by solver, of library windows and of drawn seals.
    """

    steps: LoadProgramme
    seal: RectangularSeal
    library: LadderLibrary | PlacedLibrary = field(repr=False)
    leakage: Array = field(
        metadata=labels("m^2/s", "leakage per unit seal length, realisations", "realisation", "step")
    )
    leakage_resampled: Array = field(
        metadata=labels("m^2/s", "leakage per unit seal length, resampled library", "realisation", "step")
    )
    leakage_lower_bound: Array | None = field(
        default=None, metadata=labels("m^2/s", "lower bound of leakage per unit seal length", "realisation", "step")
    )
    leakage_upper_bound: Array | None = field(
        default=None, metadata=labels("m^2/s", "upper bound of leakage per unit seal length", "realisation", "step")
    )
    leakage_closed_cuts: Array | None = field(
        default=None, metadata=labels("m^2/s", "leakage per unit seal length, cuts closed", "realisation", "step")
    )
    leakage_held_cuts: Array | None = field(
        default=None, metadata=labels("m^2/s", "leakage per unit seal length, cuts held", "realisation", "step")
    )
    sampler: str = "history"
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    solvers: SolverCounts = field(default_factory=SolverCounts)

    def quantile(self, q: float, *, resampled: bool = False) -> Array:
        """Quantile over the realisations that did not fail, at every step [m²/s]; NaN where all failed.

        Between two values of one sign it is interpolated in log space; beside a 0 it is 0. `resampled` takes
        `leakage_resampled`, whose scatter includes the error of the library.
        """
        return self._at_every_step(partial(_quantile, q=q), self.leakage_resampled if resampled else self.leakage)

    @property
    def mean(self) -> Array:
        """Mean over the realisations that did not fail, at every step [m²/s]; NaN where all failed."""
        return self._at_every_step(np.mean)

    @property
    def sealed_share(self) -> Array:
        """Share of realisations without leakage among those that did not fail, at every step; NaN where all failed."""
        return self._at_every_step(lambda leakage: np.mean(leakage == 0))

    @property
    def realisation_spread(self) -> Array:
        """Standard deviation of ln(leakage) between realisations, at every step; NaN where fewer than 2 leak."""
        return self._at_every_step(_log_deviation)

    @property
    def library_error(self) -> Array:
        """Standard deviation of ln(leakage) that the finite library adds, at every step; NaN where fewer than 2
        leak."""
        together = self._at_every_step(_log_deviation, self.leakage_resampled)
        return np.sqrt(np.maximum(together**2 - self.realisation_spread**2, 0.0))

    def needed(self, width: float) -> tuple[int, int]:
        """Number of realisations and of library windows without overlap for a standard error `width`.

        The error is that of ln(median leakage), at all steps that leak more than 1e-3 of the first. Realisations and
        library may each cause half of the variance.
        """
        median = self.quantile(0.5)
        chosen = np.abs(median) > 1e-3 * np.abs(median[0])
        if not chosen.any():
            return len(self.leakage), self.library.independent
        # the median of n normal numbers scatters by 1.2533 σ/√n
        realisations = 2 * (1.2533 * float(np.nanmax(self.realisation_spread[chosen], initial=0)) / width) ** 2
        windows = 2 * self.library.independent * (float(np.nanmax(self.library_error[chosen], initial=0)) / width) ** 2
        return max(2, ceil(realisations)), max(1, ceil(windows))

    @property
    def cut_error(self) -> Array | None:
        """Half the distance of ln(leakage) with held and with closed cuts, at every step; None unless of runs.

        It is inf where no run leaks by itself, NaN without leakage.
        """
        if self.leakage_closed_cuts is None or self.leakage_held_cuts is None:
            return None
        closed, held = (self._at_every_step(np.mean, q) for q in (self.leakage_closed_cuts, self.leakage_held_cuts))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(0.5 * np.log(held / closed))

    def too_few(self, *quantiles: float) -> str:
        """A warning with the number of realisations that the quantiles need, if there are fewer; otherwise ""."""
        tails = [min(q, 1 - q) for q in quantiles if 0 < q < 1]
        needed = ceil(max((1 / tail for tail in tails), default=1) - 1e-9)
        if len(self.leakage) >= needed:
            return ""
        named = " and ".join(f"{q:g}" for q in quantiles)
        return f"quantile {named} of {len(self.leakage)} realisations: at least {needed} needed"

    def unsupported(self, q: float) -> tuple[str, ...]:
        """Reasons not to trust a quantile: too few realisations, or a library that scatters more than the tail."""
        reasons = [text] if (text := self.too_few(q)) else []
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.abs(np.log(self.quantile(q) / self.quantile(0.5)))
        weak = [s.name for s, d, e in zip(self.steps, distance, self.library_error, strict=True) if e > max(d, 0.1)]
        if weak:
            reasons.append(
                f"quantile {q:g}: the error of {self.library.independent} library windows is larger than the band at "
                f"{weak[0]}" + (f" and {len(weak) - 1} more steps" if len(weak) > 1 else "")
            )
        return tuple(reasons)

    def _at_every_step(self, statistic: Callable[[Array], Any], leakage: Array | None = None) -> Array:
        finite = [column[np.isfinite(column)] for column in (self.leakage if leakage is None else leakage).T]
        return np.array([statistic(column) if column.size else np.nan for column in finite])


def _quantile(values: Array, q: float) -> float:
    low, high = (float(np.quantile(values, q, method=end)) for end in ("lower", "higher"))
    weight = (values.size - 1) * q % 1
    if low == 0 or high == 0:
        return 0.0
    if (low > 0) != (high > 0):
        return low + weight * (high - low)
    return float(np.sign(low)) * abs(low) ** (1 - weight) * abs(high) ** weight


def _log_deviation(values: Array) -> float:
    size = np.abs(values[values != 0])
    return float(np.std(np.log(size), ddof=1)) if size.size > 1 else np.nan


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
    check_sampling(sampling, cells)
    sampling = replace(sampling, sampler=chosen_sampler(sampling, scene, two_scale.contact if two_scale else contact))
    if sampling.sampler == "runs" and scene.discretisation != "edge":
        raise InputError.of("sampler", f"'runs' with the discretisation '{scene.discretisation}'", "'edge' with it")
    if sampling.width is None:
        return _draw(scene, cells, sampling, contact, two_scale, mapper)
    with TemporaryDirectory() as folder:
        # the next round keeps the windows that this one has followed
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
            f"width {sampling.width:g} not reached: about {realisations} realisations and {windows} windows without "
            f"overlap needed, {len(result.leakage)} and {result.library.independent} used"
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
    partition = Partition(scene.surface.shape, scene.surface.spacing, cells)
    n1, n2 = seal_cells(partition, sampling)
    if sampling.profile and len(sampling.profile) != n1:
        raise InputError.of("profile", f"{len(sampling.profile)} numbers", f"{n1}, one for each row of windows")
    supply = SOURCES[sampling.pressure](Wanted(scene, partition, sampling, (n1, n2), two_scale, contact, mapper))
    if sampling.sampler == "runs":
        return _of_runs(scene, partition, sampling, supply, n2)
    seal = scene.layout.seal((n1 * partition.window_size[0], n2 * partition.window_size[1]), (n1, n2), supply.node_rows)
    library = supply.library
    realise = partial(
        _realise,
        scene=scene,
        seal=seal,
        kinds=supply.tables,
        sampling=sampling,
        independent=library.independent / library.size,
    )
    stage = Stage("drawn seals", realise)
    count = sampling.realisations
    drawn = list(mapper(stage, [*range(count)] * 2, [False] * count + [True] * count))
    leakage, *bounds = np.array([r.leakage for r in drawn[:count]]).transpose(1, 0, 2)
    lower, upper = bounds or (None, None)
    return StochasticResult(
        steps=scene.steps,
        seal=seal,
        sampler=sampling.sampler or "history",
        library=library,
        leakage=leakage,
        leakage_resampled=np.array([r.leakage[0] for r in drawn[count:]]),
        leakage_lower_bound=lower,
        leakage_upper_bound=upper,
        failures=library.failures + tuple(text for r in drawn for text in r.failures),
        warnings=odd_in_scene(scene) + supply.warnings,
        solvers=library.counts.solvers + SolverCounts.total(r.solvers for r in drawn),
    )


def _of_runs(
    scene: Scene, partition: Partition, sampling: Sampling, supply: WindowSupply, columns: int
) -> StochasticResult:
    """Seals drawn as chains of runs of the face."""
    drawn = chained_seals(scene, partition, supply.runs, columns, sampling.realisations, sampling.seed)
    failed = tuple(
        f"runs, {step.name}: {state.reason}"
        for step, state in zip(scene.steps, supply.runs, strict=True)
        if isinstance(state, Failed)
    )
    cells, (d1, d2) = (partition.cells[0], drawn.columns), partition.window_size
    return StochasticResult(
        steps=scene.steps,
        seal=scene.layout.seal((cells[0] * d1, cells[1] * d2), cells, supply.node_rows),
        sampler="runs",
        library=supply.library,
        leakage=drawn.leakage,
        leakage_resampled=drawn.resampled,
        leakage_closed_cuts=drawn.closed,
        leakage_held_cuts=drawn.held,
        failures=supply.library.failures + failed,
        warnings=odd_in_scene(scene) + supply.warnings + drawn.warnings,
        solvers=SolverCounts.total(state.solvers for state in supply.runs if isinstance(state, StateRuns)),
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
    resampled: bool,
    *,
    scene: Scene,
    seal: RectangularSeal,
    kinds: tuple[Tables, ...],
    sampling: Sampling,
    independent: float,
) -> Realisation:
    """Draw one seal and solve its flow at every step.

    The same random numbers draw the same windows from each kind of tables. `resampled` draws a new library from the
    library, and takes the values without their bounds.
    """
    steps = scene.steps
    if resampled:
        kinds = (_resample(kinds[0], sampling.seed, realisation, independent),)
    leakage = np.full((len(kinds), len(steps)), np.nan)
    failures, solvers = [], SolverCounts()
    for kind, tables in enumerate(kinds):
        along, across = (
            draw_links(t, sampler=sampling.sampler or "history", seed=sampling.seed, realisation=realisation, axis=axis)
            for axis, t in enumerate(tables)
        )
        for s, step in enumerate(steps):
            found = attempt(scene.leakage, seal, (along(s), across(s)))
            if isinstance(found, Failed):
                failures.append(f"realisation {realisation}, {step.name}: {found.reason}")
            else:
                leakage[kind, s] = found.per_length
                solvers += SolverCounts.of(found)
    return Realisation(leakage, tuple(failures), solvers)


def _grown(windows: int, sampling: Sampling, library: LadderLibrary | PlacedLibrary, most: int) -> int:
    """Size of the next library: windows that overlap others lessen no error."""
    if isinstance(library, PlacedLibrary):
        return sampling.library_cells
    return max(sampling.library_cells, min(windows, most, library.tiles))


def _resample(tables: Tables, seed: int, realisation: int, independent: float) -> Tables:
    """Tables of cells drawn with repetition, as many as do not overlap; neighbours that are alike are drawn together.

    independent : share of the cells that do not overlap.
    """
    cells = tables[0].k.shape[2]
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(realisation, 2)))
    length = min(max(1, round(tables[0].correlation_length)), cells)
    count = max(1, round(cells * independent))
    first = rng.integers(cells, size=-(-count // length))
    taken = ((first[:, None] + np.arange(length)) % cells).ravel()[:count]
    first_table, second = (replace(t, k=t.k[:, :, taken]) for t in tables)
    return first_table, second

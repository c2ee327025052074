"""Seals of any length whose windows are drawn from a library of real ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..contact import HalfSpace, peak_indices
from ..errors import FemsealError, InputError
from ..scales import (
    Ladder,
    LadderLibrary,
    LibraryTable,
    LinkTable,
    Partition,
    WindowSource,
    build_ladder_library,
    correlation_length,
    draw_links,
    on_ladder,
    solve_global_scale,
)
from ..seal import RectangularSeal
from ..showing import Shown
from .scene import Array, Map, Scene, labels, leakage_plot
from .windows import solve_links, solve_windows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Loading steps of a library in shares of the pressure at which everything is in contact, about: the hardness, or half
#: of E* × rms slope where that is less.
LOADING_SHARES = (0, 0.001, 0.004, 0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.22, 0.29, 0.37, 0.46, 0.56, 0.67, 0.8, 0.95)
#: Those from which library windows are unloaded, and stops in shares of the peak.
PEAK_SHARES = (0.02, 0.07, 0.16, 0.29, 0.46, 0.67, 0.95)
STOPS = (0.8, 0.6, 0.4, 0.25, 0.12, 0.04, 0.0)
#: Rigid separations of library windows in rms heights; beyond them k is within 3 % of the asymptote, which takes over.
SEPARATIONS = (-1.0, 0.0, 1.0, 2.0, 3.0, 5.0, 8.0)
#: The global contact that gives the pressures of library windows carries waves longer than a window.
CUT_OFF_WINDOWS = 1.0
#: Runs of columns last for so many correlation lengths, at most once round the face: where runs meet, channels of the
#: face are cut off. Measured on circular milling marks with ten columns: 0.83 to 0.95 of the leakage with runs of ten,
#: 0.36 to 0.87 with runs of two.
RUN_LENGTHS = 10
#: For a wanted width, how often realisations and windows are added, and up to how many times as many as given.
ROUNDS, GROWTH = 4, 8


@dataclass(frozen=True)
class Sampling:
    """How a seal is drawn.

    length : seal length along x2 [m], rounded to whole cells.
    breadth : size from inlet to outlet [m], likewise; that of the face unless given; "uniform" only.
    realisations : how many seals. library_cells : windows in the library. seed : of all random numbers.
    sampler : "history", "derivative", "copula" or "block", see `scales.sampling`; unless given "block" with "place",
        which has neighbours, and "history" else.
    pressure : which pressures and which waves a window sees.
        "place": the windows of the two-scale solution of the face; a link draws from those of its row, over the face
        moved by fractions of a window where `library_cells` asks for more: for faces whose form varies over a window.
        "global": windows with all their waves are followed along a ladder of pressures, and the global contact,
        repeated along the seal, says which pressure a link has (the paper's).
        "uniform": windows with the full heights, every link under the nominal pressure, or its share in `profile`.
    profile : contact pressures from inlet to outlet in shares of the nominal one, one for each row of windows, with the
        mean 1; "uniform" only.
    library : folder in which libraries of windows are kept and found again; "global" and "uniform" only.
    width : wanted standard error of ln(median leakage), at the steps that leak more than 1e-3 of the first;
        realisations and windows are added until it is reached, up to eight times as many. None: as many as given.
    """

    length: float
    realisations: int
    library_cells: int
    seed: int
    sampler: str | None = None
    pressure: str = "place"
    profile: tuple[float, ...] = ()
    library: Path | None = None
    width: float | None = None
    breadth: float | None = None

    @property
    def chosen_sampler(self) -> str:
        """The sampler given, or the one that suits the pressures."""
        return self.sampler or ("block" if self.pressure == "place" else "history")


@dataclass(frozen=True, repr=False)
class PlacedLibrary(Shown):
    """Windows of a face at their places: k1 (rows, columns, steps), k2 (rows − 1, columns, steps) [m³].

    Columns come in the order of the face, then again for every `shift` of the windows along x2. block_length : number
    of columns over which windows are alike.
    """

    k1: Array = field(metadata={"unit": "m^3"})
    k2: Array = field(metadata={"unit": "m^3"})
    curves: LibraryTable
    correlation_length: float
    shifts: int
    counts: dict[str, int] = field(default_factory=dict)
    failures: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of windows along x1."""
        return self.k1.shape[0] * self.k1.shape[1]


@dataclass(frozen=True, repr=False)
class StochasticResult(Shown):
    """Realisations of a seal drawn from a library; leakage over realisations and steps.

    leakage_resampled : as many more, each from a library drawn with repetition from the library itself, so that their
    scatter is that of realisations and library together.
    """

    steps: tuple[Any, ...]
    seal: RectangularSeal
    library: LadderLibrary | PlacedLibrary = field(repr=False)
    leakage: Array = field(
        metadata=labels("m^2/s", "leakage per unit seal length, realisations", "realisation", "step")
    )
    leakage_resampled: Array = field(
        metadata=labels("m^2/s", "leakage per unit seal length, resampled library", "realisation", "step")
    )
    failures: tuple[str, ...] = ()

    def quantile(self, q: float, *, resampled: bool = False) -> Array:
        """Quantile over the realisations that did not fail, at every step [m²/s]; NaN where all failed.

        Between two values of one sign in log space; 0 beside a 0. `resampled`: with the error of the library.
        """
        return self._at_every_step(partial(_quantile, q=q), self.leakage_resampled if resampled else self.leakage)

    @property
    def mean(self) -> Array:
        """Mean over the realisations that did not fail, at every step [m²/s]; NaN where all failed."""
        return self._at_every_step(np.mean)

    @property
    def sealed_share(self) -> Array:
        """Share without any leakage of the realisations that did not fail, at every step; NaN where all failed."""
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
        """Realisations and library windows for a standard error `width` of ln(median leakage).

        At the worst of the steps that leak more than 1e-3 of the first; both errors together, half of it to each.
        """
        median = self.quantile(0.5)
        chosen = np.abs(median) > 1e-3 * np.abs(median[0])
        if not chosen.any():
            return len(self.leakage), self.library.size
        # the median of n normal numbers scatters by 1.2533 σ/√n
        realisations = 2 * (1.2533 * float(np.nanmax(self.realisation_spread[chosen], initial=0)) / width) ** 2
        windows = 2 * self.library.size * (float(np.nanmax(self.library_error[chosen], initial=0)) / width) ** 2
        return max(2, ceil(realisations)), max(1, ceil(windows))

    def unsupported(self, q: float) -> tuple[str, ...]:
        """Why a quantile should not be trusted: too few realisations, or a library that scatters more than the tail."""
        reasons = []
        tail = len(self.leakage) * min(q, 1 - q)
        if tail < 1:
            reasons.append(
                f"quantile {q:g} of {len(self.leakage)} realisations: at least {ceil(1 / min(q, 1 - q))} needed"
            )
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.abs(np.log(self.quantile(q) / self.quantile(0.5)))
        weak = [s.name for s, d, e in zip(self.steps, distance, self.library_error, strict=True) if e > max(d, 0.1)]
        if weak:
            reasons.append(
                f"quantile {q:g}: the error of {self.library.size} library windows is larger than the band at "
                f"{weak[0]}" + (f" and {len(weak) - 1} more steps" if len(weak) > 1 else "")
            )
        return tuple(reasons)

    def plot(self) -> Figure:
        """Median of the leakage against nominal pressure, with the bands from 5 to 95 %."""
        low, high = 0.05, 0.95
        return leakage_plot(
            self.steps,
            self.quantile(0.5),
            "median of realisations",
            band=(self.quantile(low), self.quantile(high)),
            band_together=(self.quantile(low, resampled=True), self.quantile(high, resampled=True)),
            share=(low, high),
            mean=self.mean,
        )

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


def stochastic(scene: Scene, cells: tuple[int, int], sampling: Sampling, *, map: Map = map) -> StochasticResult:
    """Library of real windows, seals drawn from it, one global flow for each realisation and step.

    Raises
    ------
    InputError : an option that does not exist or does not go with the others.
    FemsealError : every window of the library failed.
    """
    check_sampling(sampling, cells)
    if sampling.width is None:
        return _draw(scene, cells, sampling, map)
    with TemporaryDirectory() as folder:
        # what is followed in one round is not followed again in the next
        growing = replace(sampling, library=sampling.library or Path(folder))
        result = _draw(scene, cells, growing, map)
        for _ in range(ROUNDS):
            realisations, windows = result.needed(sampling.width)
            wanted = replace(
                growing,
                realisations=int(np.clip(realisations, growing.realisations, GROWTH * sampling.realisations)),
                library_cells=int(np.clip(windows, growing.library_cells, GROWTH * sampling.library_cells)),
            )
            if wanted == growing or (sampling.pressure == "place" and wanted.realisations == growing.realisations):
                break
            growing = wanted
            result = _draw(scene, cells, growing, map)
    realisations, windows = result.needed(sampling.width)
    if realisations > len(result.leakage) or windows > result.library.size:
        text = f"width {sampling.width:g} not reached: about {realisations} realisations and {windows} windows needed"
        result = replace(result, failures=(*result.failures, text))
    return result


def check_sampling(sampling: Sampling, cells: tuple[int, int]) -> None:
    """Raise InputError for options that do not exist or do not go together."""
    if sampling.pressure not in PRESSURES:
        raise InputError.of("pressure", sampling.pressure, f"one of {', '.join(PRESSURES)}")
    if sampling.chosen_sampler == "block" and sampling.pressure != "place":
        raise InputError.of("sampler", "block", "another one, or the pressure 'place', whose windows are neighbours")
    if sampling.breadth is not None and (sampling.pressure != "uniform" or not sampling.breadth > 0):
        raise InputError.of("breadth", sampling.breadth, "a length > 0 with the pressure 'uniform', none with others")
    if sampling.profile:
        if sampling.pressure != "uniform":
            raise InputError.of("profile", sampling.profile, "none but with the pressure 'uniform'")
        shares = np.asarray(sampling.profile, float)
        rows = cells[0] if sampling.breadth is None else shares.size
        if shares.shape != (rows,) or not np.all(shares >= 0) or abs(shares.mean() - 1) > 1e-6:
            raise InputError.of("profile", sampling.profile, f"{rows} numbers >= 0 with the mean 1")
    if sampling.library is not None and sampling.pressure == "place":
        raise InputError.of("library", f"'{sampling.library}'", "none with the pressure 'place', which has no ladder")
    if sampling.width is not None:
        checks.number("width", sampling.width, unit="1")


def _draw(scene: Scene, cells: tuple[int, int], sampling: Sampling, map: Map) -> StochasticResult:
    partition = Partition(scene.surface.shape, scene.surface.spacing, cells)
    n1, n2 = seal_cells(partition, sampling)
    if sampling.profile and len(sampling.profile) != n1:
        raise InputError.of("profile", f"{len(sampling.profile)} numbers", f"{n1}, one for each row of windows")
    library, tables, rows = PRESSURES[sampling.pressure](scene, partition, sampling, (n1, n2), map)
    seal = RectangularSeal((n1 * partition.window_size[0], n2 * partition.window_size[1]), (n1, n2), rows)
    task = partial(_realise, scene=scene, seal=seal, tables=tables, sampling=sampling)
    count = sampling.realisations
    outcomes = list(map(task, [*range(count)] * 2, [False] * count + [True] * count))
    leakage = np.array([o[0] for o in outcomes])
    return StochasticResult(
        steps=scene.steps,
        seal=seal,
        library=library,
        leakage=leakage[:count],
        leakage_resampled=leakage[count:],
        failures=library.failures + tuple(t for o in outcomes for t in o[1]),
    )


def seal_cells(partition: Partition, sampling: Sampling) -> tuple[int, int]:
    """Windows of a drawn seal along x1 and x2."""
    d1, d2 = partition.window_size
    n1 = partition.cells[0] if sampling.breadth is None else max(1, round(sampling.breadth / d1))
    return n1, max(1, round(sampling.length / d2))


#: A library, the tables from which links along x1 and x2 are drawn, and the x1 of the rows of nodes (none:
#: equidistant).
Source = Callable[
    [Scene, Partition, Sampling, tuple[int, int], Map],
    tuple[LadderLibrary | PlacedLibrary, tuple[LinkTable, LinkTable], tuple[float, ...]],
]


def _placed(scene: Scene, partition: Partition, sampling: Sampling, seal: tuple[int, int], map: Map) -> Any:
    """All windows of the face at their places, moved along it by fractions of a window where more are wanted."""
    (m1, m2), w2, n2 = partition.cells, partition.window[1], seal[1]
    contact = solve_windows(scene, partition.cells, map=map)
    shifts = int(np.clip(-(-sampling.library_cells // (m1 * m2)), 1, w2))
    moved = [n * w2 // shifts for n in range(shifts)]
    flows = [[solve_links(contact, axis, shift=s, map=map) for s in moved] for axis in (0, 1)]
    k1, k2 = (np.concatenate([f.k for f in along], axis=2).transpose(1, 2, 0) for along in flows)
    k1, k2 = _without_failed(k1, k2)
    length = float(np.mean([correlation_length(k1[:, n * m2 : (n + 1) * m2]) for n in range(shifts)]))
    table = LibraryTable(
        steps=scene.steps,
        pressure=contact.pressure.reshape(len(scene.steps), -1).T,
        k=flows[0][0].k.reshape(len(scene.steps), -1).T,
        mean_gap=contact.mean_gap.reshape(len(scene.steps), -1).T,
        contact_fraction=contact.contact_fraction.reshape(len(scene.steps), -1).T,
    )
    every = flows[0] + flows[1]
    library = PlacedLibrary(
        k1=k1,
        k2=k2,
        curves=table,
        correlation_length=length,
        shifts=shifts,
        counts={name: sum(f.counts[name] for f in every) for name in every[0].counts},
        failures=contact.failures + tuple(text for f in every for text in f.failures),
    )
    run = min(RUN_LENGTHS * length, float(m2))
    tables = tuple(LinkTable(k, np.tile(np.arange(len(k)), n2), len(k), scene.steps, run, length) for k in (k1, k2))
    return library, tables, contact.partition.node_rows


def _without_failed(k1: Array, k2: Array) -> tuple[Array, Array]:
    """A column in which anything failed is replaced by the next one."""
    good = np.isfinite(k1).all(axis=(0, 2)) & np.isfinite(k2).all(axis=(0, 2))
    if not good.any():
        raise FemsealError("library: every column of cells has one that failed")
    columns = np.flatnonzero(good)
    taken = columns[np.searchsorted(columns, np.arange(good.size)) % columns.size]
    return k1[:, taken], k2[:, taken]


def _global(scene: Scene, partition: Partition, sampling: Sampling, seal: tuple[int, int], map: Map) -> Any:
    """A ladder up to the highest window pressure; each link follows its place in the repeated global contact."""
    (m1, m2), n2 = partition.cells, seal[1]
    cut_off = CUT_OFF_WINDOWS * min(partition.window_size)
    world = solve_global_scale(
        scene.surface, partition, cut_off, modulus=scene.modulus, boundary=scene.boundary, **scene.cycle
    )
    library = _library(scene, partition, sampling, float(world.pressure.max()), map, apart=True)
    # windows without pressure stand off as the asperities of the others make the whole body do
    peaks = peak_indices(scene.steps)
    load = world.pressure.sum(axis=(1, 2))
    own = library.loaded("standoff", world.pressure) - library.flattening(world.pressure, world.pressure[peaks])
    standoff = np.divide((world.pressure * own).sum(axis=(1, 2)), load, out=np.zeros_like(load), where=load > 0)
    tables = []
    for axis, pressure in enumerate((world.pressure, world.pressure_across)):
        gaps = np.array([partition.means(g, axis) + d for g, d in zip(world.raw_gap, standoff, strict=True)])
        # what a peak has deformed for good widens their gap
        gaps += library.loaded("plastic_deformation", pressure[peaks])
        paths, distances = (a.reshape(len(a), (m1 - axis) * m2).T for a in (pressure, gaps))
        j, i = np.divmod(np.arange((m1 - axis) * n2), max(m1 - axis, 1))
        k = library.along(paths, distances, scene.steps, axis)
        tables.append(LinkTable(k, i * m2 + j % m2, m1 - axis, scene.steps))
    return library, tuple(tables), ()


def _uniform(scene: Scene, partition: Partition, sampling: Sampling, seal: tuple[int, int], map: Map) -> Any:
    """Full heights under the nominal pressure, or under the share of it that the profile gives to a row."""
    n1, n2 = seal
    nominal = np.array([s.pressure for s in scene.steps])
    rows = np.asarray(sampling.profile or (1.0,), float)
    # between the rows of a profile lie those of the links across
    shares = (rows, (rows[:-1] + rows[1:]) / 2 if rows.size > 1 else rows)
    highest = float(nominal.max() * rows.max())
    exact = tuple(s.pressure for s in scene.steps if s.unloaded_from is None) if rows.size == 1 else ()
    library = _library(scene, partition, sampling, highest, map, exact=exact)
    tables = []
    for axis in (0, 1):
        paths = shares[axis][:, None] * nominal
        gaps = np.full(paths.shape, float(-np.inf))
        row = np.arange(n1 - axis) if rows.size > 1 else np.zeros(n1 - axis, np.int64)
        k = library.along(paths, gaps, scene.steps, axis)
        tables.append(LinkTable(k, np.tile(row, n2), n1 - axis, scene.steps))
    return library, tuple(tables), ()


PRESSURES: dict[str, Source] = {"place": _placed, "global": _global, "uniform": _uniform}


def _library(
    scene: Scene,
    partition: Partition,
    sampling: Sampling,
    highest: float,
    map: Map,
    *,
    apart: bool = False,
    exact: tuple[float, ...] = (),
) -> LadderLibrary:
    """Windows of a topography along the standard ladder as far as needed, `apart` also without pressure.

    Exact loading pressures are solved besides; windows are then unloaded from the scene's own peaks.
    """
    full = min(scene.hardness, 0.5 * scene.modulus * scene.surface.rms_slope)
    half_space = HalfSpace(partition.window, partition.spacing, scene.modulus, ("mirror", "mirror"))
    source = WindowSource((-scene.surface.heights,), half_space, scene.hardness, sampling.seed, scene.rtol)
    waits = {s.unloaded_from for s in scene.steps if s.unloaded_from is not None}
    shares = LOADING_SHARES if highest <= LOADING_SHARES[-1] * full else (*LOADING_SHARES, highest / full)
    ladder = Ladder(
        loading=tuple(share * full for share in shares),
        peaks=tuple(share * full for share in PEAK_SHARES) if waits else (),
        stops=STOPS if waits else (),
        separations=tuple(source.rms_height * s for s in SEPARATIONS) if apart else (),
    )
    ladder = on_ladder(ladder, exact, highest)
    if exact:
        ladder = replace(ladder, peaks=tuple(sorted(waits)), stops=STOPS if waits else ())
    return build_ladder_library(source, ladder, sampling.library_cells, folder=sampling.library, map=map)


def _realise(
    realisation: int,
    resampled: bool,
    *,
    scene: Scene,
    seal: RectangularSeal,
    tables: tuple[LinkTable, LinkTable],
    sampling: Sampling,
) -> tuple[Array, list[str]]:
    """Leakage of one drawn seal at every step, and what failed."""
    steps = scene.steps
    n1, n2 = seal.cells
    if resampled:
        tables = _resample(tables, sampling.seed, realisation)
    draws = [
        draw_links(t, sampler=sampling.chosen_sampler, seed=sampling.seed, realisation=realisation, axis=a)
        for a, t in enumerate(tables)
    ]
    leakage = np.full(len(steps), np.nan)
    failures: list[str] = []
    for s in range(len(steps)):
        maps = draws[0](s).reshape(n2, n1).T, draws[1](s).reshape(n2, n1 - 1).T
        try:
            leakage[s] = scene.leakage(seal, maps).per_length
        except FemsealError as error:
            failures.append(f"realisation {realisation}, {steps[s].name}: {error}")
    return leakage, failures


def _resample(tables: tuple[LinkTable, LinkTable], seed: int, realisation: int) -> tuple[LinkTable, LinkTable]:
    """Tables of as many cells drawn with repetition, neighbours together where they are alike."""
    cells = tables[0].k.shape[1]
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(realisation, 2)))
    length = min(max(1, round(tables[0].correlation_length)), cells)
    first = rng.integers(cells, size=-(-cells // length))
    taken = ((first[:, None] + np.arange(length)) % cells).ravel()[:cells]
    first_table, second = (replace(t, k=t.k[:, taken]) for t in tables)
    return first_table, second

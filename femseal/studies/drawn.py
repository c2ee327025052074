"""Seals of any length whose windows are drawn from a library of real ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contact import LoadStep
from ..errors import FemsealError, InputError
from ..scales import (
    Ladder,
    LadderLibrary,
    Partition,
    PlacedLibrary,
    build_ladder_library,
    build_placed_library,
    draw_links,
)
from ..seal import RectangularSeal
from .scene import Array, Map, Scene, labels
from .windows import fine_waves, global_scale, window_half_space

#: Shares of the highest window pressure at which library cells are loaded.
LADDER_SHARES = (0.0, 0.01, 0.03, 0.07, 0.13, 0.22, 0.33, 0.45, 0.6, 0.8, 1.0)
#: Shares of the highest window pressure from which library cells are unloaded, and stops on the way down.
PEAK_SHARES = (0.33, 0.6, 1.0)
UNLOADING_SHARES = (0.75, 0.5, 0.25, 0.08, 0.0)
#: Rigid separations of library cells in rms heights.
SEPARATIONS = (-1.0, 0.0, 1.0, 2.0, 3.0, 5.0, 8.0)


@dataclass(frozen=True)
class StochasticResult:
    """Realisations of a seal drawn from a library; leakage over realisations and steps."""

    steps: tuple[LoadStep, ...]
    seal: RectangularSeal
    library: LadderLibrary | PlacedLibrary
    leakage: Array = field(
        metadata=labels("m^2/s", "leakage per unit seal length, realisations", "realisation", "step")
    )
    failures: tuple[str, ...] = ()

    def quantile(self, q: float) -> Array:
        """Quantile over the realisations that did not fail, at every step [m²/s]; NaN where all failed.

        Between two values of one sign in log space; 0 beside a 0.
        """
        return self._at_every_step(partial(_quantile, q=q))

    @property
    def mean(self) -> Array:
        """Mean over the realisations that did not fail, at every step [m²/s]; NaN where all failed."""
        return self._at_every_step(np.mean)

    @property
    def sealed_share(self) -> Array:
        """Share without any leakage of the realisations that did not fail, at every step; NaN where all failed."""
        return self._at_every_step(lambda leakage: np.mean(leakage == 0))

    def _at_every_step(self, statistic: Callable[[Array], Any]) -> Array:
        finite = [leakage[np.isfinite(leakage)] for leakage in self.leakage.T]
        return np.array([statistic(leakage) if leakage.size else np.nan for leakage in finite])


def _quantile(values: Array, q: float) -> float:
    low, high = (float(np.quantile(values, q, method=end)) for end in ("lower", "higher"))
    weight = (values.size - 1) * q % 1
    if low == 0 or high == 0:
        return 0.0
    if (low > 0) != (high > 0):
        return low + weight * (high - low)
    return float(np.sign(low)) * abs(low) ** (1 - weight) * abs(high) ** weight


@dataclass(frozen=True)
class Sampling:
    """How a seal is drawn.

    length : seal length along x2 [m], rounded to whole cells. realisations : how many seals. library_cells : windows in
    the library. sampler : "history" or "derivative".
    pressure : which pressures and which waves a window sees.
        "place": windows are followed under the global gap and pressure of a place in their row, with the fine waves of
        any place, and links draw from their row: for faces whose form varies over a window, such as turned ones.
        "global": windows with the fine waves only are followed along a ladder of pressures, and the global contact,
        repeated along the seal, says which pressure a link has (the paper's).
        "uniform": windows with the full heights, every link under the nominal pressure.
    """

    length: float
    realisations: int
    library_cells: int
    seed: int
    sampler: str = "history"
    pressure: str = "place"


#: A drawn seal: tables of permeability for each axis (paths, cells, steps), and the path each link follows.
Tables = tuple[Array, Array]
LinkPaths = tuple[NDArray[np.int64], NDArray[np.int64]]


def stochastic(scene: Scene, cells: tuple[int, int], sampling: Sampling, *, map: Map = map) -> StochasticResult:
    """Library of real windows, seals drawn from it, one global flow for each realisation and step."""
    if sampling.pressure not in PRESSURES:
        raise InputError.of("pressure", sampling.pressure, f"one of {', '.join(PRESSURES)}")
    partition = Partition(scene.surface.shape, scene.surface.spacing, cells)
    n1, n2 = cells[0], max(1, round(sampling.length / partition.window_size[1]))
    # far from the streams of the realisations
    rng = np.random.default_rng(np.random.SeedSequence(sampling.seed, spawn_key=(2**32 - 1,)))
    library, tables, links = PRESSURES[sampling.pressure](scene, partition, sampling, n2, rng, map)
    seal = RectangularSeal((scene.surface.size[0], n2 * partition.window_size[1]), (n1, n2))
    task = partial(_realise, scene=scene, seal=seal, tables=tables, links=links, sampling=sampling)
    outcomes = list(map(task, range(sampling.realisations)))
    return StochasticResult(
        steps=scene.steps,
        seal=seal,
        library=library,
        leakage=np.array([o[0] for o in outcomes]),
        failures=library.failures + tuple(t for o in outcomes for t in o[1]),
    )


def _placed(
    scene: Scene, partition: Partition, sampling: Sampling, n2: int, rng: np.random.Generator, map: Map
) -> tuple[PlacedLibrary, Tables, LinkPaths]:
    """Each row's own windows first, then fine waves of any window at any place of the row."""
    m1, m2 = partition.cells
    world = global_scale(scene, partition)
    fine = fine_waves(scene.surface, partition.cut_off)
    count = max(1, sampling.library_cells // m1)
    gaps: tuple[list[Array], list[Array]] = ([], [])
    pressures: tuple[list[Array], list[Array]] = ([], [])
    for axis, p in enumerate((world.pressure, world.pressure_across)):
        for i in range(m1 - axis):
            places = np.concatenate([rng.permutation(m2), rng.integers(m2, size=max(0, count - m2))])[:count]
            for n, j in enumerate(places):
                waves = partition.cut(fine, i, int(j), axis) if n < m2 else _library_windows(fine, partition, 1, rng)[0]
                gaps[axis].append(partition.cut(world.raw_gap, i, int(j), axis) + waves)
                pressures[axis].append(p[:, i, j])
    library = build_placed_library(
        gaps,
        (np.array(pressures[0]), np.array(pressures[1])),
        world.steps,
        window_half_space(scene, partition, partition.cut_off),
        rows=(m1, m1 - 1),
        hardness=scene.hardness,
        rtol=scene.rtol,
        map=map,
    )
    rows = tuple(np.tile(np.arange(m1 - axis), n2) for axis in (0, 1))
    return library, (library.k1, library.k2), (rows[0], rows[1])


def _global(
    scene: Scene, partition: Partition, sampling: Sampling, n2: int, rng: np.random.Generator, map: Map
) -> tuple[LadderLibrary, Tables, LinkPaths]:
    """A ladder up to the highest window pressure; each link follows its place in the repeated global contact."""
    m1, m2 = partition.cells
    world = global_scale(scene, partition)
    fine = fine_waves(scene.surface, partition.cut_off)
    top, rms = float(world.pressure.max()), float(np.std(fine))
    steps = tuple(LoadStep(top * share) for share in LADDER_SHARES)
    if any(s.unloaded_from is not None for s in scene.steps):
        steps += tuple(LoadStep(top * p * u, top * p) for p in PEAK_SHARES for u in UNLOADING_SHARES)
    ladder = Ladder(steps, tuple(rms * s for s in SEPARATIONS))
    library = _ladder_library(scene, partition, sampling, fine, partition.cut_off, ladder, rng, map)
    tables, links = [], []
    for axis, pressure in enumerate((world.pressure, world.pressure_across)):
        gaps = np.array([partition.means(g, axis) for g in world.raw_gap])
        paths, distances = (a.reshape(len(a), (m1 - axis) * m2).T for a in (pressure, gaps))
        tables.append(library.along(paths, distances, scene.steps, axis))
        j, i = np.divmod(np.arange((m1 - axis) * n2), max(m1 - axis, 1))
        links.append(i * m2 + j % m2)
    return library, (tables[0], tables[1]), (links[0], links[1])


def _uniform(
    scene: Scene, partition: Partition, sampling: Sampling, n2: int, rng: np.random.Generator, map: Map
) -> tuple[LadderLibrary, Tables, LinkPaths]:
    """A ladder of the nominal pressures themselves; all links follow the one path."""
    m1 = partition.cells[0]
    heights = scene.surface.heights.mean() - scene.surface.heights
    touch = () if scene.steps[0].pressure == 0 else (LoadStep(0.0),)
    library = _ladder_library(scene, partition, sampling, heights, None, Ladder(touch + scene.steps, ()), rng, map)
    path = np.array([[s.pressure for s in scene.steps]])
    tables = tuple(library.along(path, np.zeros_like(path), scene.steps, axis) for axis in (0, 1))
    links = tuple(np.zeros((m1 - axis) * n2, np.int64) for axis in (0, 1))
    return library, (tables[0], tables[1]), (links[0], links[1])


Source = Callable[..., tuple[LadderLibrary | PlacedLibrary, Tables, LinkPaths]]
PRESSURES: dict[str, Source] = {"place": _placed, "global": _global, "uniform": _uniform}


def _ladder_library(
    scene: Scene,
    partition: Partition,
    sampling: Sampling,
    topography: Array,
    longest_wave: float | None,
    ladder: Ladder,
    rng: np.random.Generator,
    map: Map,
) -> LadderLibrary:
    windows = _library_windows(topography, partition, sampling.library_cells, rng)
    half_space = window_half_space(scene, partition, longest_wave)
    return build_ladder_library(windows, ladder, half_space, hardness=scene.hardness, rng=rng, rtol=scene.rtol, map=map)


def _realise(
    realisation: int,
    *,
    scene: Scene,
    seal: RectangularSeal,
    tables: Tables,
    links: LinkPaths,
    sampling: Sampling,
) -> tuple[Array, list[str]]:
    """Leakage of one drawn seal at every step, and what failed."""
    steps = scene.steps
    n1, n2 = seal.cells
    k1, k2 = (
        draw_links(t, p, steps, sampler=sampling.sampler, seed=sampling.seed, realisation=realisation, axis=a)
        for a, (t, p) in enumerate(zip(tables, links, strict=True))
    )
    leakage = np.full(len(steps), np.nan)
    failures: list[str] = []
    for s in range(len(steps)):
        maps = k1[:, s].reshape(n2, n1).T, k2[:, s].reshape(n2, n1 - 1).T
        try:
            leakage[s] = scene.leakage(seal, maps).per_length
        except FemsealError as error:
            failures.append(f"realisation {realisation}, {steps[s].name}: {error}")
    return leakage, failures


def _library_windows(topography: Array, partition: Partition, count: int, rng: np.random.Generator) -> list[Array]:
    """Windows at random places; the first fill the surface without overlap, cell by cell in random order."""
    m1, m2 = partition.cells
    order = rng.permutation(m1 * m2)[:count]
    windows = [partition.cut(topography, *divmod(int(n), m2)) for n in order]
    (n1, n2), (w1, w2) = partition.shape, partition.window
    while len(windows) < count:
        a, b = int(rng.integers(n1 - w1 + 1)), int(rng.integers(n2 - w2 + 1))
        windows.append(topography[a : a + w1, b : b + w2])
    return [np.ascontiguousarray(w) for w in windows]

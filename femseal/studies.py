"""The chains from a rough surface to leakage over a load cycle, readable top to bottom.

`deterministic` resolves everything on the surface's own grid; `two_scale` cuts it into windows between global nodes;
`stochastic` draws the windows of a seal of any length from a library of real ones. They share a `Scene`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .contact import HalfSpace, LoadStep, load_cycle, load_programme
from .errors import FemsealError, InputError
from .flow import cell_permeability
from .fluids import Fluid
from .scales import (
    GlobalScale,
    Ladder,
    LadderLibrary,
    Partition,
    PlacedLibrary,
    WindowHistory,
    build_ladder_library,
    build_placed_library,
    draw_links,
    respond,
    solve_global_scale,
)
from .scales.response import body_standoff, flow_history, set_down
from .seal import RectangularSeal, seal_leakage
from .topography import Topography

Array = NDArray[np.float64]
Map = Callable[..., Iterable[Any]]

#: Shares of the highest window pressure at which library cells are loaded.
LADDER_SHARES = (0.0, 0.01, 0.03, 0.07, 0.13, 0.22, 0.33, 0.45, 0.6, 0.8, 1.0)
#: Shares of the highest window pressure from which library cells are unloaded, and stops on the way down.
PEAK_SHARES = (0.33, 0.6, 1.0)
UNLOADING_SHARES = (0.75, 0.5, 0.25, 0.08, 0.0)
#: Rigid separations of library cells in rms heights.
SEPARATIONS = (-1.0, 0.0, 1.0, 2.0, 3.0, 5.0, 8.0)


@dataclass(frozen=True)
class Scene:
    """A rough face under load, and the fluid it keeps back.

    surface : heights of the combined faces, high points touch first.
    modulus, hardness : E* and H [Pa].
    boundary : contact boundary of the whole face along x1 and x2.
    loading, unload_from, unloading : nominal pressures [Pa], see `contact.load_programme`.
    """

    surface: Topography
    modulus: float
    hardness: float
    fluid: Fluid
    inlet_pressure: float
    outlet_pressure: float
    loading: tuple[float, ...]
    unload_from: tuple[float, ...] = ()
    unloading: tuple[float, ...] = ()
    boundary: tuple[str, str] = ("free", "periodic")
    rtol: float = 1e-5

    @property
    def steps(self) -> tuple[LoadStep, ...]:
        """The load programme."""
        return load_programme(self.loading, self.unload_from, self.unloading)

    @property
    def cycle(self) -> dict[str, Any]:
        """The load programme and the material, as arguments of a contact cycle."""
        return {
            "loading": self.loading,
            "unload_from": self.unload_from,
            "unloading": self.unloading,
            "hardness": self.hardness,
            "rtol": self.rtol,
        }

    def leakage(self, seal: RectangularSeal, permeability: Any) -> Any:
        """Leakage of a seal between the scene's fluid pressures."""
        return seal_leakage(
            seal,
            permeability,
            self.fluid,
            inlet_pressure=self.inlet_pressure,
            outlet_pressure=self.outlet_pressure,
        )


def _result(unit: str, long_name: str, *dims: str) -> Any:
    return field(metadata={"unit": unit, "long_name": long_name, "dims": dims})


@dataclass(frozen=True)
class DeterministicResult:
    """Everything resolved on the surface's own grid; arrays over the steps."""

    steps: tuple[LoadStep, ...]
    leakage: Array = _result("m^2/s", "leakage per unit seal length, deterministic", "step")
    contact_fraction: Array = _result("1", "share in contact, deterministic", "step")
    plastic_fraction: Array = _result("1", "share at the hardness, deterministic", "step")
    mean_gap: Array = _result("m", "mean gap, deterministic", "step")
    gap: NDArray[np.float32] = _result("m", "deformed gap, deterministic", "step", "x1", "x2")
    residual: float = 0.0
    failures: tuple[str, ...] = ()


@dataclass(frozen=True)
class TwoScaleResult:
    """Windows of the surface between global nodes; arrays over steps and links."""

    steps: tuple[LoadStep, ...]
    partition: Partition
    leakage: Array = _result("m^2/s", "leakage per unit seal length, two-scale", "step")
    k1: Array = _result("m^3", "permeability of links along x1", "step", "cell1", "cell2")
    k2: Array = _result("m^3", "permeability of links along x2", "step", "corner1", "cell2")
    pressure: Array = _result("Pa", "contact pressure of windows", "step", "cell1", "cell2")
    mean_gap: Array = _result("m", "mean gap of windows", "step", "cell1", "cell2")
    contact_fraction: Array = _result("1", "share of windows in contact", "step", "cell1", "cell2")
    plastic_fraction: Array = _result("1", "share of windows at the hardness", "step", "cell1", "cell2")
    fluid_pressure: Array = _result(
        "Pa", "fluid pressure at the global nodes, NaN in pockets", "step", "node1", "cell2"
    )
    gap: NDArray[np.float32] = _result("m", "deformed gap stitched from the windows", "step", "x1", "x2")
    contact_pressure: NDArray[np.float32] = _result("Pa", "contact pressure of the windows", "step", "x1", "x2")
    counts: dict[str, int] = field(default_factory=dict)
    failures: tuple[str, ...] = ()


@dataclass(frozen=True)
class StochasticResult:
    """Realisations of a seal drawn from a library; leakage over realisations and steps."""

    steps: tuple[LoadStep, ...]
    seal: RectangularSeal
    library: LadderLibrary | PlacedLibrary
    leakage: Array = _result("m^2/s", "leakage per unit seal length, realisations", "realisation", "step")
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


def deterministic(scene: Scene, *, map: Map = map) -> DeterministicResult:
    """Contact and flow of the whole face at full resolution, step by step."""
    surface = scene.surface
    half_space = HalfSpace(surface.shape, surface.spacing, scene.modulus, scene.boundary)
    states = load_cycle(surface.heights.max() - surface.heights, half_space, **scene.cycle)
    flow = partial(_try_permeability, spacing=surface.spacing)
    values = list(map(flow, [s.contact.gap for s in states]))
    seal = RectangularSeal(surface.size, (1, 1))
    leakage = [np.nan if isinstance(k, str) else scene.leakage(seal, k).per_length for k in values]
    return DeterministicResult(
        steps=tuple(LoadStep(s.pressure, s.unloaded_from) for s in states),
        leakage=np.array(leakage),
        contact_fraction=np.array([s.contact.area_fraction for s in states]),
        plastic_fraction=np.array([s.contact.plastic_fraction for s in states]),
        mean_gap=np.array([s.contact.mean_gap for s in states]),
        gap=np.array([s.contact.gap for s in states], np.float32),
        residual=max(s.contact.residual for s in states),
        failures=tuple(f"{s.name}: {k}" for s, k in zip(states, values, strict=True) if isinstance(k, str)),
    )


def _try_permeability(gap: Array, spacing: tuple[float, float]) -> float | str:
    try:
        return cell_permeability(gap, spacing, sides="periodic").value
    except FemsealError as error:
        return str(error)


def two_scale(scene: Scene, cells: tuple[int, int], *, map: Map = map) -> TwoScaleResult:
    """Global contact of the low-pass face, contact of every window, links between global nodes, global flow.

    Contact is solved once for each cell, the gaps are stitched, and the windows of the x2-links are cut out of the
    stitched gap.
    """
    surface = scene.surface
    partition = Partition(surface.shape, surface.spacing, cells)
    world = _global_scale(scene, partition)
    m1, m2 = cells
    histories = _window_contacts(scene, partition, world, map)
    gap, contact_pressure = _stitch(histories, cells, "gap"), _stitch(histories, cells, "pressure")
    tasks = [partition.cut(gap, i, j, 0) for i in range(m1) for j in range(m2)]
    flows1 = list(map(partial(flow_history, spacing=surface.spacing, axis=0), tasks))
    tasks = [partition.cut(gap, i, j, 1) for i in range(m1 - 1) for j in range(m2)]
    flows2 = list(map(partial(flow_history, spacing=surface.spacing, axis=1), tasks))
    k1 = np.array([f.permeability for f in flows1]).T.reshape(-1, m1, m2)
    k2 = np.array([f.permeability for f in flows2]).T.reshape(-1, m1 - 1, m2) if flows2 else np.empty((len(k1), 0, m2))
    seal = RectangularSeal(surface.size, cells)
    leakage, fluid_pressure = np.full(len(k1), np.nan), np.full((len(k1), m1 + 1, m2), np.nan)
    for s in range(len(k1)):
        if np.isfinite(k1[s]).all() and np.isfinite(k2[s]).all():
            result = scene.leakage(seal, (k1[s], k2[s]))
            leakage[s], fluid_pressure[s] = result.per_length, result.fluid_pressure

    def per_cell(name: str) -> Array:
        return np.array([getattr(h, name) for h in histories]).T.reshape(-1, m1, m2)

    failures = [f"cell {divmod(n, m2)}, {t}" for n, h in enumerate(histories) for t in h.failures]
    failures += [f"x{a + 1}-link {divmod(n, m2)}, {t}" for a in (0, 1)
                 for n, f in enumerate((flows1, flows2)[a]) for t in f.failures]  # fmt: skip
    return TwoScaleResult(
        steps=world.steps,
        partition=partition,
        leakage=leakage,
        k1=k1,
        k2=k2,
        pressure=world.pressure,
        mean_gap=per_cell("mean_gap"),
        contact_fraction=per_cell("contact_fraction"),
        plastic_fraction=per_cell("plastic_fraction"),
        fluid_pressure=fluid_pressure,
        gap=gap,
        contact_pressure=contact_pressure,
        counts={name: sum(getattr(f, name) for f in flows1 + flows2) for name in ("solved", "closed", "open")},
        failures=tuple(failures),
    )


def _global_scale(scene: Scene, partition: Partition) -> GlobalScale:
    return solve_global_scale(scene.surface, partition, modulus=scene.modulus, boundary=scene.boundary, **scene.cycle)


def _fine_waves(surface: Topography, cut_off: float) -> Array:
    """Undeformed gap of the waves shorter than the cut-off, mean plane at 0."""
    return surface.low_pass(cut_off).heights - surface.heights


def _window_half_space(scene: Scene, partition: Partition, longest_wave: float | None) -> HalfSpace:
    return HalfSpace(
        partition.window, partition.spacing, scene.modulus, ("mirror", "mirror"), longest_wave=longest_wave
    )


def _window_contacts(scene: Scene, partition: Partition, world: GlobalScale, map: Map) -> list[WindowHistory]:
    """Fine waves on the global raw gap, under the window's global pressure; long waves respond globally only.

    Windows without pressure stand off as the asperities of the others make the whole body do.
    """
    m1, m2 = partition.cells
    gap0 = world.raw_gap + _fine_waves(scene.surface, partition.cut_off)
    places = [(i, j) for i in range(m1) for j in range(m2)]
    task = partial(
        respond,
        steps=world.steps,
        half_space=_window_half_space(scene, partition, partition.cut_off),
        hardness=scene.hardness,
        rigid_at_zero=True,
        rtol=scene.rtol,
    )
    gaps = (partition.cut(gap0, i, j) for i, j in places)
    histories = list(map(task, gaps, [world.pressure[:, i, j] for i, j in places]))
    standoff = body_standoff(histories)
    return [set_down(history, standoff) for history in histories]


def _stitch(histories: list[WindowHistory], cells: tuple[int, int], name: str) -> NDArray[np.float32]:
    """Fields (steps, n1, n2) from the windows' (steps, w1, w2), in the order of the cells."""
    windows = np.array([getattr(h, name) for h in histories])
    n_steps, w1, w2 = windows.shape[1:]
    grid = windows.reshape(*cells, n_steps, w1, w2)
    return np.ascontiguousarray(grid.transpose(2, 0, 3, 1, 4)).reshape(n_steps, cells[0] * w1, cells[1] * w2)


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
    world = _global_scale(scene, partition)
    fine = _fine_waves(scene.surface, partition.cut_off)
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
        _window_half_space(scene, partition, partition.cut_off),
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
    world = _global_scale(scene, partition)
    fine = _fine_waves(scene.surface, partition.cut_off)
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
    half_space = _window_half_space(scene, partition, longest_wave)
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

"""Where the links of a drawn seal come from: libraries of windows, and which of them every link may take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..base.errors import FemsealError
from ..base.stage import Mapper
from ..base.text import Shown
from ..contact import HalfSpace
from ..scales import (
    GlobalState,
    Ladder,
    LadderLibrary,
    LibraryTable,
    LinkTable,
    Partition,
    WindowSource,
    build_ladder_library,
    correlation_length,
    on_ladder,
)
from .scene import Array, Scene
from .two_scale import LinkFlows, TwoScaleResult, solve_links, solve_windows

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
    bounds : also enclose the flow of every window, and so the leakage of the seals, for a gap constant on each pixel;
        about three times the time of a library. "global" and "uniform" with the sampler "history" only.
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
    bounds: bool = False

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


def seal_cells(partition: Partition, sampling: Sampling) -> tuple[int, int]:
    """Windows of a drawn seal along x1 and x2."""
    d1, d2 = partition.window_size
    n1 = partition.cells[0] if sampling.breadth is None else max(1, round(sampling.breadth / d1))
    return n1, max(1, round(sampling.length / d2))


#: From which links along x1 and x2 are drawn.
Tables = tuple[LinkTable, LinkTable]


@dataclass(frozen=True)
class Wanted:
    """What links are wanted for: windows of a face, a seal of so many, and what is known of the face already."""

    scene: Scene
    partition: Partition
    sampling: Sampling
    seal: tuple[int, int]
    two_scale: TwoScaleResult | None
    mapper: Mapper


#: A library, its tables, with bounds followed by those of the lower and of the upper ones, and the x1 of the rows of
#: nodes (none: equidistant).
Source = Callable[[Wanted], tuple[LadderLibrary | PlacedLibrary, tuple[Tables, ...], tuple[float, ...]]]


def _placed(wanted: Wanted) -> tuple[PlacedLibrary, tuple[Tables], tuple[float, ...]]:
    """All windows of the face at their places, moved along it by fractions of a window where more are wanted."""
    scene, partition, two_scale, mapper = wanted.scene, wanted.partition, wanted.two_scale, wanted.mapper
    (m1, m2), w2, n2 = partition.cells, partition.window[1], wanted.seal[1]
    contact = two_scale or solve_windows(scene, partition.cells, mapper=mapper)
    shifts = int(np.clip(-(-wanted.sampling.library_cells // (m1 * m2)), 1, w2))
    moved = [n * w2 // shifts for n in range(shifts)]
    known = {} if two_scale is None else {(0, 0): two_scale.k1, (1, 0): two_scale.k2}
    flows = [
        [
            LinkFlows(known[axis, s], _NOTHING_SOLVED, ())
            if (axis, s) in known
            else solve_links(contact, axis, shift=s, mapper=mapper)
            for s in moved
        ]
        for axis in (0, 1)
    ]
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
        # those of two scales are theirs
        failures=(() if two_scale else contact.failures) + tuple(text for f in every for text in f.failures),
    )
    run = min(RUN_LENGTHS * length, float(m2))
    along, across = (LinkTable(k, np.tile(np.arange(len(k)), n2), len(k), scene.steps, run, length) for k in (k1, k2))
    return library, ((along, across),), contact.partition.node_rows


_NOTHING_SOLVED = {"solved": 0, "closed": 0, "open": 0}


def _without_failed(k1: Array, k2: Array) -> tuple[Array, Array]:
    """A column in which anything failed is replaced by the next one."""
    good = np.isfinite(k1).all(axis=(0, 2)) & np.isfinite(k2).all(axis=(0, 2))
    if not good.any():
        raise FemsealError("library: every column of cells has one that failed")
    columns = np.flatnonzero(good)
    taken = columns[np.searchsorted(columns, np.arange(good.size)) % columns.size]
    return k1[:, taken], k2[:, taken]


def _global(wanted: Wanted) -> tuple[LadderLibrary, tuple[Tables, ...], tuple[float, ...]]:
    """A ladder up to the highest window pressure; each link follows its place in the repeated global contact."""
    scene, partition = wanted.scene, wanted.partition
    (m1, m2), n2 = partition.cells, wanted.seal[1]
    cut_off = CUT_OFF_WINDOWS * min(partition.window_size)
    means = partial(_link_means, partition=partition)
    states = scene.global_states(partition, cut_off, take=means, mapper=wanted.mapper)
    p, p_across, gap, gap_across = (np.array(values) for values in zip(*states, strict=True))
    library = _library(wanted, float(p.max()), apart=True)
    # windows without pressure stand off as the asperities of the others make the whole body do
    peaks = scene.steps.peak_indices
    load = p.sum(axis=(1, 2))
    own = library.loaded("standoff", p) - library.flattening(p, p[peaks])
    standoff = np.divide((p * own).sum(axis=(1, 2)), load, out=np.zeros_like(load), where=load > 0)
    links: list[_Links] = []
    for axis, (pressure, distance) in enumerate(((p, gap), (p_across, gap_across))):
        # what a peak has deformed for good widens their gap
        gaps = distance + standoff[:, None, None] + library.loaded("plastic_deformation", pressure[peaks])
        paths, distances = (a.reshape(len(a), (m1 - axis) * m2).T for a in (pressure, gaps))
        j, i = np.divmod(np.arange((m1 - axis) * n2), max(m1 - axis, 1))
        links.append((paths, distances, i * m2 + j % m2, m1 - axis))
    return library, _tables(library, links, scene), ()


def _link_means(state: GlobalState, partition: Partition) -> tuple[Array, Array, Array, Array]:
    """Pressure of the links' windows along x1 and x2, and their mean gap."""
    gap, across = (partition.means(state.raw_gap, axis) for axis in (0, 1))
    return state.pressure, state.pressure_across, gap, across


def _uniform(wanted: Wanted) -> tuple[LadderLibrary, tuple[Tables, ...], tuple[float, ...]]:
    """Full heights under the nominal pressure, or under the share of it that the profile gives to a row."""
    scene, (n1, n2) = wanted.scene, wanted.seal
    nominal = scene.steps.pressures
    rows = np.asarray(wanted.sampling.profile or (1.0,), float)
    # between the rows of a profile lie those of the links across
    shares = (rows, (rows[:-1] + rows[1:]) / 2 if rows.size > 1 else rows)
    highest = float(nominal.max() * rows.max())
    exact = scene.steps.loading if rows.size == 1 else ()
    library = _library(wanted, highest, exact=exact)
    links: list[_Links] = []
    for axis in (0, 1):
        paths = shares[axis][:, None] * nominal
        gaps = np.full(paths.shape, float(-np.inf))
        row = np.arange(n1 - axis) if rows.size > 1 else np.zeros(n1 - axis, np.int64)
        links.append((paths, gaps, np.tile(row, n2), n1 - axis))
    return library, _tables(library, links, scene), ()


#: Of the links along one axis: pressures and gaps of the paths, the path of each, and how many in a column.
_Links = tuple[Array, Array, NDArray[np.int64], int]


def _tables(library: LadderLibrary, links: list[_Links], scene: Scene) -> tuple[Tables, ...]:
    """The values, and with bounds the lower and upper ones."""

    def table(axis: int, kind: int) -> LinkTable:
        paths, gaps, path, rows = links[axis]
        return LinkTable(library.along(paths, gaps, scene.steps, axis, kind), path, rows, scene.steps)

    return tuple((table(0, kind), table(1, kind)) for kind in range(library.ladder.kinds))


def _library(wanted: Wanted, highest: float, *, apart: bool = False, exact: tuple[float, ...] = ()) -> LadderLibrary:
    """Windows of a topography along the standard ladder as far as needed, `apart` also without pressure.

    Exact loading pressures are solved besides; windows are then unloaded from the scene's own peaks.
    """
    scene, partition, sampling = wanted.scene, wanted.partition, wanted.sampling
    full = min(scene.hardness, 0.5 * scene.modulus * scene.surface.rms_slope)
    half_space = HalfSpace(partition.window, partition.spacing, scene.modulus, ("mirror", "mirror"))
    source = WindowSource((-scene.surface.heights,), half_space, scene.hardness, sampling.seed, scene.rtol)
    waits = scene.steps.unload_from
    shares = LOADING_SHARES if highest <= LOADING_SHARES[-1] * full else (*LOADING_SHARES, highest / full)
    ladder = Ladder(
        loading=tuple(share * full for share in shares),
        peaks=tuple(share * full for share in PEAK_SHARES) if waits else (),
        stops=STOPS if waits else (),
        separations=tuple(source.rms_height * s for s in SEPARATIONS) if apart else (),
        bounds=sampling.bounds,
    )
    ladder = on_ladder(ladder, exact, highest)
    if exact:
        ladder = replace(ladder, peaks=waits, stops=STOPS if waits else ())
    return build_ladder_library(source, ladder, sampling.library_cells, folder=sampling.library, mapper=wanted.mapper)


PRESSURES: dict[str, Source] = {"place": _placed, "global": _global, "uniform": _uniform}

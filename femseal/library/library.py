"""Libraries of real windows, each solved along a ladder; one library serves seals of any size under any load.

A library belongs to one kind of face and material. It can be kept in a folder, in a file whose name is a digest of all
its inputs. A later run reads the file and computes only the missing windows and steps.
Source: Pérez-Ràfols et al., 2018.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..base import Array, FemsealError, InputError, Mapper, Shown, Stage, made_folder
from ..base.fields import LIBRARY_CELL, LIBRARY_WINDOW, declared
from ..contact import ContactLaw, HalfSpace
from ..execution.plain_data import packed, unpacked
from ..execution.store import SUFFIX, read_shard, write_shard
from ..loads import LoadProgramme, LoadStep
from ..windows.window_flow import Failed, FlowSettings, SolveCounts, attempt
from .curves import WindowCurves
from .ladder import Ladder, LibrarySummary, WindowStates, merge, restrict, solve_ladder

#: Written into every file; a file of another format is computed again.
FORMAT = 3
#: Relative distance of two pressures that are the same but for rounding.
_EQUAL = 1e-6
#: Halvings of an interval of pressures.
_HALVINGS = 40
#: Key of the random stream of windows, far from those of the realisations.
WINDOW_STREAM = 2**32 - 1


@dataclass(frozen=True, repr=False)
class LibraryTable(Shown):
    """Cells of a library on common load steps, arrays (cells, steps), and the place of each (cells,), None of one."""

    steps: LoadProgramme
    pressure: Array = declared("library_pressure", "Pa", "mean contact pressure of library cells", LIBRARY_CELL)
    k: Array = declared("library_k", "m^3", "permeability along x1 of library cells", LIBRARY_CELL)
    mean_gap: Array = declared("library_mean_gap", "m", "mean gap of library cells", LIBRARY_CELL)
    contact_fraction: Array = declared(
        "library_contact_fraction", "1", "fraction in contact of library cells", LIBRARY_CELL
    )
    place: NDArray[np.int64] | None = declared(
        "library_place", "1", "number of the measured place of library cells", LIBRARY_WINDOW, default=None
    )


@dataclass(frozen=True)
class WindowSource:
    """Where library windows are cut, and how they are solved. Window n is the same however many windows are wanted.

    topographies : undeformed gaps of whole faces (n1, n2) [m], all with the same pixels. Window n is cut from face n
        modulo the number of faces; its mean plane is put at 0.
    half_space, law, rtol : elastic body, law and residual of the contact of a window.
    seed : of the random places of windows.
    flow : how the flow through windows is discretised and solved.
    """

    topographies: tuple[Array, ...]
    half_space: HalfSpace
    law: ContactLaw
    seed: int
    rtol: float = 1e-6
    flow: FlowSettings = field(default_factory=FlowSettings)

    @property
    def rms_height(self) -> float:
        """Root mean square height of the windows that tile the faces [m]."""
        w1, w2 = self.half_space.shape
        variances = [
            t[: t.shape[0] // w1 * w1, : t.shape[1] // w2 * w2].reshape(t.shape[0] // w1, w1, -1, w2).var(axis=(1, 3))
            for t in self.topographies
        ]
        return float(np.sqrt(np.mean(np.concatenate([v.ravel() for v in variances]))))

    @property
    def tiles(self) -> int:
        """Number of windows that tile the faces without overlap."""
        w1, w2 = self.half_space.shape
        return sum((n1 // w1) * (n2 // w2) for n1, n2 in (t.shape for t in self.topographies))

    def window(self, n: int) -> Array:
        """Undeformed gap of window n (w1, w2) [m].

        The first windows of each face tile it without overlap, in random order; later ones lie anywhere.
        """
        face = n % len(self.topographies)
        topography, number = self.topographies[face], n // len(self.topographies)
        (n1, n2), (w1, w2) = topography.shape, self.half_space.shape
        tiles = (n1 // w1, n2 // w2)
        if number < tiles[0] * tiles[1]:
            order = np.random.default_rng([self.seed, WINDOW_STREAM, face]).permutation(tiles[0] * tiles[1])
            i, j = divmod(int(order[number]), tiles[1])
            a, b = i * w1, j * w2
        else:
            rng = np.random.default_rng([self.seed, WINDOW_STREAM, face, number])
            a, b = int(rng.integers(n1 - w1 + 1)), int(rng.integers(n2 - w2 + 1))
        window = topography[a : a + w1, b : b + w2]
        return np.ascontiguousarray(window - window.mean())

    def key(self, ladder: Ladder) -> str:
        """Digest of all that the response of window n depends on, except the loading pressures and the peaks."""
        body = self.half_space
        settings = [FORMAT, body.shape, body.spacing, body.modulus, body.boundary, self.law.key()]
        settings += [self.flow.solver, self.flow.discretisation, self.seed, self.rtol]
        settings += [ladder.stops, ladder.separations, ladder.closing_rtol, ladder.bounds]
        settings += ladder.drop.key
        digest = hashlib.sha256(json.dumps(settings).encode())
        for topography in self.topographies:
            digest.update(np.ascontiguousarray(topography).tobytes())
        return digest.hexdigest()[:32]


@dataclass(frozen=True, repr=False)
class LadderLibrary(Shown):
    """Windows solved along a ladder.

    outcomes : every window, and why those failed that did; a part of a run reads them when they are asked for.
    rms_height : root mean square height of the windows [m].
    tiles : number of windows that tile the faces without overlap.
    faces : number of measured places that windows are cut from in turn.
    reused : number of cells that were read and complete.
    """

    ladder: Ladder
    outcomes: Sequence[WindowStates | Failed] = field(repr=False)
    rms_height: float = field(metadata={"unit": "m"})
    tiles: int
    faces: int = 1
    reused: int = 0

    _derived: ClassVar = {"size": "1", "independent": "1"}

    @cached_property
    def windows(self) -> tuple[WindowStates, ...]:
        """Those that did not fail."""
        return tuple(window for window in self.outcomes if not isinstance(window, Failed))

    @cached_property
    def summary(self) -> LibrarySummary:
        """Which windows failed, and the flows of the others."""
        return LibrarySummary.of(self.outcomes)

    def with_summary(self, blocks: Iterable[LibrarySummary]) -> LadderLibrary:
        """The same library, whose windows need not be read for a summary, from those of its blocks of `BLOCK` windows.

        Raises FemsealError: every window failed.
        """
        library = replace(self)
        vars(library)["summary"] = LibrarySummary.joined(blocks)
        library.refuse_empty()
        return library

    def refuse_empty(self) -> None:
        """Raise FemsealError if every window failed."""
        if not self.size:
            raise FemsealError(f"library: every cell failed; the first: {self.failures[0]}")

    @property
    def counts(self) -> SolveCounts:
        """Flows of windows in this run, solved or known without solving."""
        return self.summary.counts

    @property
    def failures(self) -> tuple[str, ...]:
        """Windows that failed and are left out, one line each."""
        return tuple(f"cell {n}: {reason}" for n, reason in self.summary.failed.items())

    @property
    def place(self) -> NDArray[np.int64] | None:
        """Number of the measured place of every window, from 1; None of one place."""
        if self.faces == 1:
            return None
        return np.array([n % self.faces + 1 for n in range(len(self.outcomes)) if n not in self.summary.failed])

    @property
    def size(self) -> int:
        """Number of cells."""
        return len(self.outcomes) - len(self.summary.failed)

    @property
    def independent(self) -> int:
        """Number of cells that do not overlap: the error of the library is that of so many."""
        return min(self.size, self.tiles)

    @cached_property
    def curves(self) -> LibraryTable:
        """All cells at the loading steps, the peaks and the stops of the ladder."""
        ladder = self.ladder
        steps = [LoadStep(p) for p in ladder.loading]
        steps += [LoadStep(fraction * peak, peak) for peak in ladder.peaks for fraction in ladder.stops]
        columns = {name: np.empty((self.size, len(steps))) for name in ("k", "mean_gap", "contact_fraction")}
        loads = len(ladder.loading)
        for n, cell in enumerate(self.windows):
            on_ladder, peaks = np.searchsorted(cell.pressure, ladder.loading), np.searchsorted(cell.peaks, ladder.peaks)
            for name, values in columns.items():
                loading, unloading = getattr(cell, name), getattr(cell, f"{name}_unloading")
                if name == "k":
                    loading, unloading = loading[0, 0], unloading[0, 0]
                values[n, :loads], values[n, loads:] = loading[on_ladder], unloading[peaks].ravel()
        programme = LoadProgramme(steps)
        pressure = np.broadcast_to(programme.pressures, (self.size, len(steps)))
        return LibraryTable(programme, pressure, **columns, place=self.place)

    def loaded(self, name: str, pressure: Array) -> Array:
        """Mean over the cells of "standoff" or "plastic_deformation" at mean pressures on loading [m]."""
        x = np.cbrt(pressure)
        return np.mean([np.interp(x, np.cbrt(c.pressure), getattr(c, name)) for c in self.windows], axis=0)

    def flattening(self, pressure: Array, peak: Array) -> Array:
        """Decrease of the standoff from loading to unloading from a peak, mean over the cells [m]."""
        return np.mean([self._flattening(cell, pressure, peak) for cell in self.windows], axis=0)

    def _flattening(self, cell: WindowStates, pressure: Array, peak: Array) -> Array:
        """`flattening` of one cell, interpolated between peaks at equal fractions of them; 0 without peaks."""
        if not cell.peaks.size:
            return np.zeros_like(pressure)
        fraction = np.divide(pressure, peak, out=np.ones_like(pressure), where=peak > 0)
        stops = np.array([1.0, *self.ladder.stops])[::-1]
        taken = [np.zeros_like(pressure)]
        for m, top in enumerate(cell.peaks):
            virgin = np.interp(np.cbrt(top * stops), np.cbrt(cell.pressure), cell.standoff)
            left = np.array([virgin[-1], *cell.standoff_unloading[m]])[::-1]
            taken.append(np.interp(np.cbrt(fraction), np.cbrt(stops), virgin - left))
        knots = np.r_[0.0, cell.peaks]
        upper = np.clip(np.searchsorted(knots, peak), 1, knots.size - 1)
        weight = np.clip((peak - knots[upper - 1]) / (knots[upper] - knots[upper - 1]), 0, 1)
        stack = np.array(taken)
        low, high = (np.take_along_axis(stack, n[None], axis=0)[0] for n in (upper - 1, upper))
        return (1 - weight) * low + weight * high

    def pressure_at(self, pressure: Array, peak: Array, distance: Array) -> Array:
        """Mean pressures of windows at a distance of the mean planes [m], by the mean standoff; the given where higher.

        pressure : the given ones [Pa]. peak : those from which windows are unloaded, where they are above them [Pa].
        """
        found = pressure.copy()
        light = self.loaded("standoff", pressure) - self.flattening(pressure, peak) > distance
        low, peak, distance = found[light], peak[light], distance[light]
        high = np.where(peak > low, peak, max(window.pressure[-1] for window in self.windows))
        for _ in range(_HALVINGS if low.size else 0):
            middle = (low + high) / 2
            far = self.loaded("standoff", middle) - self.flattening(middle, np.maximum(peak, middle)) > distance
            low, high = np.where(far, middle, low), np.where(far, high, middle)
        found[light] = high
        return found

    def along(self, paths: Array, gaps: Array, steps: LoadProgramme, axis: int, kind: int = 0) -> Array:
        """Permeability of every cell along every path: (steps, paths, cells) [m³].

        paths : mean pressure of a window at each step of the seal's programme (steps, paths) [Pa]; of several tables at
        once (tables, steps, paths), as are the results.
        gaps : distance between mean planes (steps, paths) [m], used where the pressure is 0.
        steps : the seal's programme.
        axis : direction of the links.
        kind : 0 for the permeability; with bounds also 1 for its lower and 2 for its upper bound. Bounds hold at the
        steps of the ladder; between them they are interpolated as the permeability is.
        """
        each = paths if paths.ndim == 3 else paths[None]
        p_peak = np.reshape([local_peaks(table, steps) for table in each], paths.shape)
        gaps = np.broadcast_to(gaps, paths.shape)
        # at its own peak a window is on the loading curve, also where the seal is unloaded
        down = (paths > 0) & (paths < p_peak)
        up = (paths > 0) & ~down
        apart = paths <= 0
        ways = {"loaded": (up, paths), "unloaded": (down, paths, p_peak), "separated": (apart, gaps)}
        given = {name: (way, [of[way] for of in values]) for name, (way, *values) in ways.items() if way.any()}
        table = np.zeros((*paths.shape, self.size))
        for c, cell in enumerate(self.windows):
            curves = WindowCurves(cell, self.ladder, axis, self.rms_height, kind)
            values = table[..., c]
            for name, (way, arguments) in given.items():
                values[way] = getattr(curves, name)(*arguments)
        return table


def local_peaks(paths: Array, steps: LoadProgramme) -> Array:
    """Highest pressure that each window has had up to each step on its way there (steps, paths) [Pa].

    The way to an unloading step is the loading up to its peak and the unloading from there. Where the pressure of a
    window falls while that of the seal rises, or the other way round, its own peak is not at the peak of the seal.
    """
    loading = steps.on_loading
    highest = paths.copy()
    highest[loading] = np.maximum.accumulate(paths[loading], axis=0)
    last: dict[int, int] = {}
    for s, peak in enumerate(steps.peak_indices.tolist()):
        if not loading[s]:
            highest[s] = np.maximum(paths[s], highest[last.get(peak, peak)])
            last[peak] = s
    return highest


def build_ladder_library(
    source: WindowSource, ladder: Ladder, count: int, *, folder: Path | None = None, mapper: Mapper = map
) -> LadderLibrary:
    """Solve windows along a ladder; read what a folder holds of them already.

    The library is the same whatever the folder holds: it has no states of other ladders.

    source, ladder : the windows, and the states in which they are solved.
    count : number of windows.
    folder : where libraries are kept; with None nothing is read or written.
    mapper : computes a stage for all windows, see `base.stage.Mapper`.

    Raises InputError: `count` is below 1, or the folder cannot be written.
    FemsealError : every window failed.
    """
    if count < 1:
        raise InputError("library", f"{count} windows", "at least one")
    path = None if folder is None else made_folder(folder) / f"{source.key(ladder)}{SUFFIX}"
    kept = [] if path is None else _read(path, ladder)
    known = [*kept[:count], *[None] * (count - len(kept))]
    # cells that are complete go there too: what a run asks for does not depend on what is kept
    stage = Stage("library windows", partial(_cell, source=source, ladder=ladder), apart=True)
    found = mapper(stage, range(count), known)
    outcomes = found if isinstance(found, Sequence) else list(found)
    complete = [cell is not None and restrict(cell, ladder) is not None for cell in known]
    if path is not None and not all(complete):
        cells = [None if isinstance(cell, Failed) else cell for cell in outcomes]
        both = [c if k is None else k if c is None else merge(c, k, ladder) for c, k in zip(cells, known, strict=True)]
        write_shard(path, ("library", FORMAT), [packed(cell) for cell in both + kept[count:]])
    library = LadderLibrary(
        ladder=ladder,
        outcomes=outcomes,
        rms_height=source.rms_height,
        tiles=source.tiles,
        faces=len(source.topographies),
        reused=sum(complete),
    )
    if isinstance(outcomes, list):  # other sequences read windows when they are needed
        library.refuse_empty()
    return library


def _cell(n: int, known: WindowStates | None, *, source: WindowSource, ladder: Ladder) -> WindowStates | Failed:
    """States of window n along the ladder: those known where they are enough, else what is missing is solved."""
    if known is not None and (cell := restrict(known, ladder)) is not None:
        return cell
    return attempt(
        solve_ladder,
        source.window(n),
        ladder=ladder,
        half_space=source.half_space,
        law=source.law,
        rtol=source.rtol,
        flow=source.flow,
        known=known,
    )


def _read(path: Path, ladder: Ladder) -> list[WindowStates | None]:
    """Read the cells of a file; an empty list if there is no file, or it is damaged, changed or of another format."""
    try:
        cells = [unpacked(item) for item in read_shard(path, ("library", FORMAT))]
    except (OSError, ValueError):
        return []
    if not all(cell is None or _is_sound(cell, ladder) for cell in cells):
        return []
    # the flows were solved in another run
    return [None if cell is None else replace(cell, counts=SolveCounts()) for cell in cells]


def _is_sound(cell: Any, ladder: Ladder) -> bool:
    """Whether a cell that was read has the arrays of one that was computed."""
    if type(cell) is not WindowStates:
        return False
    arrays = {name: values for name, values in vars(cell).items() if name != "counts"}
    if not all(type(a) is np.ndarray and a.dtype == float and np.isfinite(a).all() for a in arrays.values()):
        return False
    n, m, kinds, stops = cell.pressure.size, cell.peaks.size, ladder.kinds, len(ladder.stops)
    shapes = {"pressure": (n,), "k": (kinds, 2, n), "peaks": (m,), "k_unloading": (kinds, 2, m, stops)}
    shapes["rigid"] = (kinds, 2, len(ladder.separations))
    for name, values in arrays.items():
        if values.shape != shapes.get(name, (m, stops) if name.endswith("_unloading") else (n,)):
            return False
    rising = (np.diff(cell.pressure) > 0).all() and (np.diff(cell.peaks) > 0).all()
    return bool(rising and n and cell.pressure[0] == 0 and min(cell.k.min(), cell.k_unloading.min(initial=0)) >= 0)


def on_ladder(ladder: Ladder, extra: Sequence[float], highest: float) -> Ladder:
    """The ladder cut after its first step at or above `highest`, with the `extra` loading steps added.

    Where it has peaks and all of them are cut off, its highest step is one.
    """
    top = next((p for p in ladder.loading if p >= highest * (1 - 1e-12)), highest)
    kept = (p for p in ladder.loading if p <= top and not any(abs(p - other) < _EQUAL * other for other in extra))
    loading = tuple(sorted({*kept, *extra}))
    peaks = tuple(p for p in ladder.peaks if p in loading)
    return replace(ladder, loading=loading, peaks=peaks or (loading[-1:] if ladder.peaks else ()))

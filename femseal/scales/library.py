"""Libraries of real cells, each followed along a load cycle, from which the links of a seal are drawn.

A `LadderLibrary` follows cells under pressures of their own and serves any pressure path. Between the steps of the
ladder ln k is interpolated monotonically (PCHIP) for each cell; a cell that closes between two steps closes at a
pressure of its own, uniform between them. Source: Pérez-Ràfols et al., 2018; Fritsch & Carlson, SIAM J. Numer. Anal.
17, 1980, 238.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from ..contact import HalfSpace, LoadStep
from ..errors import FemsealError, InputError
from .response import WindowHistory, body_standoff, flow_history, respond, set_down

Array = NDArray[np.float64]
Map = Callable[..., Iterable[Any]]


@dataclass(frozen=True)
class Ladder:
    """Steps at which library cells are solved: loading from first touch on, unloading from peaks, rigid separations.

    steps : loading steps in rising order, then the unloading steps of each peak in falling order.
    separations : distances between mean planes without contact pressure [m], rising.
    """

    steps: tuple[LoadStep, ...]
    separations: tuple[float, ...]

    @property
    def loading(self) -> Array:
        """Pressures of the loading steps [Pa]."""
        return np.array([s.pressure for s in self.steps if s.unloaded_from is None])

    @property
    def peaks(self) -> tuple[float, ...]:
        """Peak pressures [Pa], rising."""
        return tuple(sorted({s.unloaded_from for s in self.steps if s.unloaded_from is not None}))

    def unloading(self, peak: float) -> NDArray[np.int64]:
        """Indices of the steps below a peak."""
        return np.array([n for n, s in enumerate(self.steps) if s.unloaded_from == peak])


@dataclass(frozen=True)
class CellCurves:
    """Cells followed along a programme: pressures, permeability, mean gap, contact share, all (cells, steps)."""

    steps: tuple[LoadStep, ...]
    pressure: Array = field(metadata={"unit": "Pa", "long_name": "mean contact pressure of library cells"})
    k: Array = field(metadata={"unit": "m^3", "long_name": "permeability along x1 of library cells"})
    mean_gap: Array = field(metadata={"unit": "m", "long_name": "mean gap of library cells"})
    contact_fraction: Array = field(metadata={"unit": "1", "long_name": "contact share of library cells"})


@dataclass(frozen=True)
class PlacedLibrary:
    """Cells followed at their place in a row of the surface, under the pressures and the global gap of that place.

    k1 (rows, cells, steps), k2 (rows − 1, cells, steps) [m³]: the tables from which links of a row are drawn.
    """

    k1: Array
    k2: Array
    curves: CellCurves
    counts: dict[str, int] = field(default_factory=dict)
    failures: tuple[str, ...] = ()


@dataclass(frozen=True)
class LadderLibrary:
    """Permeabilities of cells along the ladder.

    k : (cells, 2 axes, steps) [m³]; rigid : (cells, 2 axes, separations) [m³]; closing : uniform numbers (cells, 2, 2)
    that place closing pressures between steps; rms_height : of the cells' topography [m].
    """

    ladder: Ladder
    k: Array
    rigid: Array
    mean_gap: Array
    contact_fraction: Array
    rms_height: float
    closing: Array = field(repr=False)
    counts: dict[str, int] = field(default_factory=dict)
    failures: tuple[str, ...] = ()

    @property
    def curves(self) -> CellCurves:
        """The cells along x1 on the ladder's steps."""
        pressure = np.broadcast_to([s.pressure for s in self.ladder.steps], self.mean_gap.shape)
        return CellCurves(self.ladder.steps, pressure, self.k[:, 0], self.mean_gap, self.contact_fraction)

    @property
    def size(self) -> int:
        """Number of cells."""
        return self.k.shape[0]

    def along(self, paths: Array, gaps: Array, steps: Sequence[LoadStep], axis: int) -> Array:
        """Permeability of every cell along every path: (paths, cells, steps) [m³].

        Parameters
        ----------
        paths : mean pressure of a window at each step of the seal's programme (paths, steps) [Pa].
        gaps : distance between mean planes (paths, steps) [m], used where the pressure is 0.
        steps : the seal's programme.
        axis : direction of the links.
        """
        peak_at = {s.pressure: n for n, s in enumerate(steps) if s.unloaded_from is None}
        table = np.empty((len(paths), self.size, len(steps)))
        loading = np.array([s.unloaded_from is None for s in steps])
        peaks = np.array([peak_at[s.unloaded_from] if s.unloaded_from is not None else n for n, s in enumerate(steps)])
        p_peak = paths[:, peaks]
        for c in range(self.size):
            curve = self._loading_curve(c, axis)
            values = np.where(loading, curve(paths), self._unloading(c, axis, curve, paths, p_peak))
            table[:, c] = np.where(paths > 0, values, self._rigid(c, axis, gaps))
        return table

    def _loading_curve(self, c: int, axis: int) -> Callable[[Array], Array]:
        p = self.ladder.loading
        return _log_curve(p, self.k[c, axis, : p.size], self.closing[c, axis, 0])

    def _unloading(self, c: int, axis: int, loading: Callable[[Array], Array], p: Array, p_peak: Array) -> Array:
        """Between the ladder's peaks, at equal share of the peak; an infinitely low peak is elastic."""
        ladder = self.ladder
        if not ladder.peaks:
            return loading(p)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(p_peak > 0, np.clip(p / p_peak, 0, 1), 0.0)
        levels = [np.log(np.maximum(loading(p), 0.0), where=loading(p) > 0, out=np.full(p.shape, -np.inf))]
        for peak in ladder.peaks:
            index = ladder.unloading(peak)[::-1]
            pressures = np.r_[[ladder.steps[n].pressure for n in index], peak] / peak
            k_peak = self.k[c, axis, int(np.flatnonzero(ladder.loading == peak)[0])]
            curve = _log_curve(pressures, np.r_[self.k[c, axis, index], k_peak], self.closing[c, axis, 1])
            value = curve(share)
            levels.append(np.log(value, where=value > 0, out=np.full(p.shape, -np.inf)))
        knots = np.r_[0.0, ladder.peaks]
        upper = np.clip(np.searchsorted(knots, p_peak, side="left"), 1, len(knots) - 1)
        weight = np.clip((p_peak - knots[upper - 1]) / (knots[upper] - knots[upper - 1]), 0, 1)
        stack = np.array(levels)
        low = np.take_along_axis(stack, (upper - 1)[None], axis=0)[0]
        high = np.take_along_axis(stack, upper[None], axis=0)[0]
        both = np.isfinite(low) & np.isfinite(high)
        mixed = np.where(both, (1 - weight) * np.where(both, low, 0) + weight * np.where(both, high, 0), -np.inf)
        # open under one peak only: the cell's own number says up to where
        one = np.where(weight < 1 - self.closing[c, axis, 1], low, high)
        return np.exp(np.where(both, mixed, one))

    def _rigid(self, c: int, axis: int, gap: Array) -> Array:
        """Without contact pressure: between the separations, and (h̄³/12)(1 − 3σ²/2h̄²) beyond them."""
        s = np.array(self.ladder.separations)
        if s.size == 0:
            return self._loading_curve(c, axis)(np.zeros_like(gap))
        # read with the sign of a pressure, so that a closed cell is closed below a gap of its own
        within = _log_curve(-s[::-1], self.rigid[c, axis, ::-1], self.closing[c, axis, 0])(-np.clip(gap, s[0], s[-1]))
        wide = np.maximum(gap, s[-1])
        beyond = wide**3 / 12 * (1 - 1.5 * (self.rms_height / wide) ** 2)
        return np.where(gap <= s[-1], within, beyond)


def _log_curve(p: Array, k: Array, closing: float) -> Callable[[Array], Array]:
    """k(p) through rising p and k falling to 0 at some step: PCHIP of ln k, closed beyond the cell's own pressure."""
    order = np.argsort(p)
    p, k = p[order], k[order]
    n_open = int(np.argmin(k > 0)) if not np.all(k > 0) else k.size
    if n_open == 0:
        return lambda x: np.zeros(np.shape(x))
    p_close = np.inf if n_open == k.size else p[n_open - 1] + closing * (p[n_open] - p[n_open - 1])
    if n_open == 1:
        return lambda x: np.where(x <= p_close, k[0], 0.0)
    log_k = np.log(k[:n_open])
    inner = PchipInterpolator(p[:n_open], log_k)
    slope = (log_k[-1] - log_k[-2]) / (p[n_open - 1] - p[n_open - 2])

    def curve(x: Array) -> Array:
        value = inner(np.clip(x, p[0], p[n_open - 1]))
        beyond = np.maximum(np.asarray(x) - p[n_open - 1], 0.0) if n_open < k.size else 0.0
        return np.where(np.asarray(x) <= p_close, np.exp(value + min(slope, 0.0) * beyond), 0.0)

    return curve


def build_ladder_library(
    windows: Sequence[Array],
    ladder: Ladder,
    half_space: HalfSpace,
    *,
    hardness: float,
    rng: np.random.Generator,
    rtol: float = 1e-6,
    map: Map = map,
) -> LadderLibrary:
    """Follow windows along a ladder.

    Parameters
    ----------
    windows : undeformed gaps (n1, n2) [m], mean plane at 0 (heights counted downwards).
    ladder : steps and separations.
    half_space : elastic body of a window.
    hardness : H [Pa].
    rng : places closing pressures between steps.
    map : how to apply a function to all windows; the order of the results is that of the windows.

    Raises
    ------
    InputError : no window, or a ladder whose first step is not first touch (0 Pa).
    """
    if len(windows) == 0:
        raise InputError.of("windows", "an empty list", "at least one window")
    if ladder.steps[0].pressure != 0:
        raise InputError.of("ladder", f"first step at {ladder.steps[0].pressure:g} Pa", "first touch, 0 Pa")
    task = partial(_ladder_cell, ladder=ladder, half_space=half_space, hardness=hardness, rtol=rtol)
    cells = list(map(task, windows))
    complete = [c for c in cells if not c["failures"]]
    failures = tuple(f"cell {n}: {text}" for n, c in enumerate(cells) for text in c["failures"])
    if not complete:
        raise InputError(f"library: every cell failed; the first: {failures[0]}")
    closing = rng.random((len(cells), 2, 2))
    return LadderLibrary(
        ladder=ladder,
        k=np.array([c["k"] for c in complete]),
        rigid=np.array([c["rigid"] for c in complete]),
        mean_gap=np.array([c["mean_gap"] for c in complete]),
        contact_fraction=np.array([c["contact_fraction"] for c in complete]),
        rms_height=float(np.sqrt(np.mean([np.var(w) for w in windows]))),
        closing=closing[[not c["failures"] for c in cells]],
        counts={name: sum(c["counts"][name] for c in cells) for name in cells[0]["counts"]},
        failures=failures,
    )


def _ladder_cell(
    window: Array, *, ladder: Ladder, half_space: HalfSpace, hardness: float, rtol: float
) -> dict[str, Any]:
    pressures = [s.pressure for s in ladder.steps]
    history = respond(window, pressures, ladder.steps, half_space, hardness=hardness, rigid_at_zero=False, rtol=rtol)
    separated = np.maximum(window[None] + np.array(ladder.separations)[:, None, None], 0.0)
    flows = [flow_history(gaps, half_space.spacing, axis) for gaps in (history.gap, separated) for axis in (0, 1)]
    return {
        "k": np.array([flows[0].permeability, flows[1].permeability]),
        "rigid": np.array([flows[2].permeability, flows[3].permeability]),
        "mean_gap": history.mean_gap,
        "contact_fraction": history.contact_fraction,
        "counts": {name: sum(getattr(f, name) for f in flows) for name in ("solved", "closed", "open")},
        "failures": history.failures + tuple(t for f in flows for t in f.failures),
    }


def build_placed_library(
    gaps: tuple[Sequence[Array], Sequence[Array]],
    pressures: tuple[Array, Array],
    steps: Sequence[LoadStep],
    half_space: HalfSpace,
    *,
    rows: tuple[int, int],
    hardness: float,
    rtol: float = 1e-6,
    map: Map = map,
) -> PlacedLibrary:
    """Follow windows at their places.

    Parameters
    ----------
    gaps : undeformed gaps of the windows of x1-links and of x2-links, row by row, each (steps, n1, n2) [m].
    pressures : their mean pressures (windows, steps) [Pa].
    steps : the seal's programme.
    half_space : elastic body of a window.
    rows : number of rows of x1-links and of x2-links; every row has the same number of windows.
    hardness : H [Pa].
    map : how to apply a function to all windows, in order.
    """
    tables, records, counts, failures = [], [], {"solved": 0, "closed": 0, "open": 0}, []
    per_row = len(gaps[0]) // rows[0]
    contact = partial(
        respond, steps=tuple(steps), half_space=half_space, hardness=hardness, rigid_at_zero=True, rtol=rtol
    )
    histories = [list(map(contact, gaps[axis], pressures[axis])) for axis in (0, 1)]
    standoff = body_standoff(histories[0])
    for axis in (0, 1):
        cells = list(
            map(partial(_placed_cell, axis=axis, spacing=half_space.spacing, standoff=standoff), histories[axis])
        )
        k = np.array([c["k"] for c in cells]).reshape(rows[axis], per_row, len(steps))
        # a cell that failed anywhere is replaced by the next one of its row
        tables.append(_without_failed(k))
        records.append(cells)
        for name in counts:
            counts[name] += sum(c["counts"][name] for c in cells)
        failures += [f"x{axis + 1}-cell {n}: {text}" for n, c in enumerate(cells) for text in c["failures"]]
    first = records[0]
    curves = CellCurves(
        tuple(steps),
        pressures[0],
        np.array([c["k"] for c in first]),
        np.array([c["mean_gap"] for c in first]),
        np.array([c["contact_fraction"] for c in first]),
    )
    return PlacedLibrary(tables[0], tables[1], curves, counts, tuple(failures))


def _without_failed(k: Array) -> Array:
    k = k.copy()
    for row in k:
        good = np.flatnonzero(np.isfinite(row).all(axis=1))
        if good.size == 0:
            raise FemsealError("library: every cell of a row failed")
        bad = np.setdiff1d(np.arange(len(row)), good)
        row[bad] = row[good[np.searchsorted(good, bad) % good.size]]
    return k


def _placed_cell(history: WindowHistory, *, axis: int, spacing: tuple[float, float], standoff: Array) -> dict[str, Any]:
    history = set_down(history, standoff)
    flow = flow_history(history.gap, spacing, axis)
    return {
        "k": flow.permeability,
        "mean_gap": history.mean_gap,
        "contact_fraction": history.contact_fraction,
        "counts": {name: getattr(flow, name) for name in ("solved", "closed", "open")},
        "failures": history.failures + flow.failures,
    }

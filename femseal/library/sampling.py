"""Samplers: they draw the links of a seal from tables of measured permeabilities.

history      Each link takes one measured cell along the whole cycle. This keeps every correlation between loads.
derivative   Each link draws its permeability at the highest load. Then, step by step down, it draws the increment of
             one of the cells closest in rank; closed links draw from closed cells (Pérez-Ràfols et al., 2018).
copula       Each link draws its ranks at all loads from a normal distribution with the cells' rank correlations. A
             running maximum from the peaks down makes them monotone. This sampler is smooth and repeats no cell.
block        Columns of the seal take neighbouring columns of the measured face, with all their links, in runs of random
             length. This keeps the correlation between links on faces whose long waves reach over many cells. Source
             of the stationary bootstrap: Politis & Romano, J. Am. Stat. Assoc. 89, 1994, 1303.

Random numbers depend on (seed, realisation, axis, link) only. Links are counted along x1 first, column after column, so
that link n of a longer seal draws what link n of a shorter one draws.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Array, Indices, InputError
from ..loads import LoadProgramme

#: Permeability of all links (rows, columns) at a step.
Draw = Callable[[int], Array]
#: Cells close in rank among which the derivative sampler draws; more than a few bias the median leakage.
NEIGHBOURS = 5
#: Samplers whose links take one cell at all steps.
WHOLE_CELLS = ("history", "block")
#: Links for which the copula holds normal numbers of all steps at a time.
CHUNK = 100_000


@dataclass(frozen=True)
class LinkTable:
    """The permeabilities from which the links along one axis are drawn.

    k : permeability of every cell along every pressure path (steps, paths, cells) [m³].
    path : number of the path that each link follows (rows, columns).
    steps : the load programme.
    run_length : mean number of columns in a run of "block"; 0 if the cells are not neighbours in a row.
    correlation_length : number of columns over which cells are alike.
    place : number of the measured place of every cell (cells,), for "block"; None of one place.
    pressure : mean contact pressure of the cells (steps, paths, cells), or of all of them on a path (steps, paths, 1)
        [Pa]; None where it is unknown.
    """

    k: Array
    path: Indices
    steps: LoadProgramme
    run_length: float = 0.0
    correlation_length: float = 1.0
    pressure: Array | None = None
    place: Indices | None = None


def draw_links(table: LinkTable, *, sampler: str, seed: int, realisation: int, axis: int) -> Draw:
    """Draw all links of one realisation: a function that gives their permeabilities (rows, columns) [m³] at a step.

    "history" and "block" hold one number for each link, the others one for each link and step.

    table : the permeabilities to draw from.
    sampler : "history", "derivative", "copula" or "block".
    seed, realisation, axis : choose the random numbers, with the number of the link.

    Raises InputError: an unknown sampler, or "block" where the cells are not neighbours.
    """
    drawn = _drawn(table, sampler, seed, realisation, axis)
    return drawn if callable(drawn) else lambda s: table.k[s].ravel().take(drawn)


def draw_cells(table: LinkTable, *, sampler: str, seed: int, realisation: int, axis: int) -> Indices | None:
    """Number in `table.k[s].ravel()` of what `draw_links` draws for each link at all steps; None of other samplers."""
    drawn = _drawn(table, sampler, seed, realisation, axis) if sampler in WHOLE_CELLS else None
    return None if callable(drawn) else drawn


def _drawn(table: LinkTable, sampler: str, seed: int, realisation: int, axis: int) -> Draw | Indices:
    if sampler not in SAMPLERS:
        raise InputError("sampler", sampler, f"one of {', '.join(SAMPLERS)}")
    # runs of columns are common to the links along both axes
    key = (realisation,) if sampler == "block" else (realisation, axis)
    rng = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=key)))
    return SAMPLERS[sampler](table, rng)


def draw_pressures(table: LinkTable, *, sampler: str, seed: int, realisation: int, axis: int) -> Draw | None:
    """Contact pressure (rows, columns) [Pa] at a step of the windows that `draw_links` draws; None where it is unknown.

    With the samplers "derivative" and "copula", which draw permeabilities and not windows, it is the mean of a path.
    """
    pressure, path = table.pressure, table.path
    if pressure is None:
        return None
    if pressure.shape[2] > 1 and sampler in WHOLE_CELLS:
        return draw_links(replace(table, k=pressure), sampler=sampler, seed=seed, realisation=realisation, axis=axis)
    of_path = pressure.mean(axis=2)
    return lambda s: of_path[s, path]


def correlation_length(k: Array) -> float:
    """Number of columns over which the cells of a face are alike.

    It is 1 + 2 Σ of the rank correlations between columns, summed until they vanish.

    k : permeabilities (steps, rows, columns), columns in the order of the face and periodic.
    """
    steps, _, columns = k.shape
    ranks = np.argsort(np.argsort(k, axis=2, kind="stable"), axis=2).astype(float)
    ranks -= ranks.mean(axis=2, keepdims=True)
    spread = np.mean(ranks**2)
    length = 1.0
    for lag in range(1, max(columns // 2, 1)):
        rho = np.mean(ranks * np.roll(ranks, lag, axis=2)) / spread if spread > 0 else 0.0
        if rho < 2 / np.sqrt(ranks.size / max(steps, 1)):
            break
        length += 2 * rho
    return float(min(length, max(columns / 2, 1.0)))


def _history(table: LinkTable, rng: np.random.Generator) -> Indices:
    cell = _on_links((rng.random(table.path.size) * table.k.shape[2]).astype(np.int64), table)
    return table.path * table.k.shape[2] + cell


def _block(table: LinkTable, rng: np.random.Generator) -> Indices:
    """Draw runs of neighbouring columns of cells, of random length, see the module."""
    if table.run_length < 1:
        raise InputError("sampler", "block", "another sampler, because these cells are not neighbours on a face")
    cells, columns = table.k.shape[2], table.path.shape[1]
    fresh = rng.random((columns, 2))
    starts = fresh[:, 0] < 1 / table.run_length
    starts[:1] = True
    first = np.flatnonzero(starts)
    run = np.cumsum(starts) - 1
    if table.place is None:
        begins = (fresh[first, 1] * cells).astype(np.int64)
    else:
        lengths = np.diff(first, append=columns)
        begins = drawn_elsewhere(fresh[first, 1], table.place, table.place, lengths - 1)
    column = (begins[run] + np.arange(columns) - first[run]) % cells
    return table.path * cells + column


def drawn_elsewhere(random: Array, begins: Indices, ends: Indices, further: Indices | None = None) -> Indices:
    """Numbers of runs drawn one after another, each beginning in another measured place than the last one ended in.

    random : number from 0 to 1 for each draw. begins : place in which each run begins. ends : that in which it ends, of
    draws that are `further` runs long that of the run so much further on.
    """
    count = begins.size
    if np.unique(begins).size < 2:
        return (random * count).astype(np.int64)
    others = {int(place): np.flatnonzero(begins != place) for place in np.unique(np.r_[begins, ends])}
    drawn, pool = np.empty(random.size, np.int64), np.arange(count)
    for n, number in enumerate(random):
        drawn[n] = pool[int(number * pool.size)]
        pool = others[int(ends[(drawn[n] + (0 if further is None else further[n])) % count])]
    return drawn


def _derivative(table: LinkTable, rng: np.random.Generator) -> Draw:
    """Draw the highest load, then step by step the increments of cells that are close in rank, see the module."""
    path = table.path.T.ravel()
    uniform = rng.random((path.size, len(table.steps))).T
    top = len(table.steps.loading) - 1
    k = np.empty(uniform.shape)
    k[top] = table.k[top, path, (uniform[top] * table.k.shape[2]).astype(np.int64)]
    for p in np.unique(path):
        links, cells = np.flatnonzero(path == p), table.k[:, p]
        for start, end in _moves(table.steps):
            k[end, links] = _step_down(cells[start], cells[end], k[start, links], uniform[end, links])
    return lambda s: _on_links(k[s], table)


def _copula(table: LinkTable, rng: np.random.Generator) -> Draw:
    path = table.path.T.ravel()
    k = np.empty((len(table.steps), path.size))
    models = {int(p): _RankModel(table.k[:, p], table.steps) for p in np.unique(path)}
    for start in range(0, path.size, CHUNK):
        normal = rng.standard_normal((min(CHUNK, path.size - start), len(table.steps)))
        for p, model in models.items():
            links = np.flatnonzero(path[start : start + CHUNK] == p)
            k[:, start + links] = model.draw(normal[links])
    return lambda s: _on_links(k[s], table)


def _on_links(values: NDArray[Any], table: LinkTable) -> NDArray[Any]:
    """Arrange values of links, which are counted column after column, as (rows, columns)."""
    rows, columns = table.path.shape
    return np.ascontiguousarray(values.reshape(columns, rows).T)


class _RankModel:
    """Normal scores of the cells of one path at all steps, and the sorted values behind them, from k (steps, cells).

    Closed cells share the mean score m of their ranks, because nothing orders them. For normal numbers z of
    correlation ρ, cov(m₁, m₂) is about ρ var(m₁) var(m₂), exactly so where only one of the steps has closed cells.
    """

    def __init__(self, k: Array, steps: LoadProgramme) -> None:
        """Normal scores, their correlation between steps, and a root of it, from k (steps, cells) [m³]."""
        self.steps, self.sorted = steps, np.sort(k, axis=1)
        cells = k.shape[1]
        normal = scipy.special.ndtri((np.arange(cells) + 0.5) / cells)
        scores = np.empty((cells, len(k)))
        for s, values in enumerate(k):
            order = np.argsort(values, kind="stable")
            n_closed = np.count_nonzero(values <= 0)
            scores[order, s] = np.r_[
                np.full(n_closed, normal[:n_closed].mean() if n_closed else 0.0), normal[n_closed:]
            ]
        product = scores.T @ scores / (normal @ normal or 1.0)
        variance = np.diag(product)
        correlation = np.divide(product, np.outer(variance, variance), out=np.zeros_like(product), where=product != 0)
        np.fill_diagonal(correlation, 1.0)
        values, vectors = np.linalg.eigh(np.clip(correlation, -1, 1))
        root = vectors * np.sqrt(np.maximum(values, 0))
        self.root = root / np.sqrt((root**2).sum(axis=1, keepdims=True))

    def draw(self, normal: Array) -> Array:
        """Turn independent normal numbers (links, steps) into permeabilities (steps, links) [m³]."""
        position = (scipy.special.ndtr(normal @ self.root.T) * self.sorted.shape[1] - 0.5).T
        k = np.stack([_quantile(values, place) for values, place in zip(self.sorted, position, strict=True)])
        top = len(self.steps.loading)
        k[:top] = np.maximum.accumulate(k[:top][::-1], axis=0)[::-1]
        for start, end in _moves(self.steps):
            if self.steps[end].unloaded_from is not None:
                above = np.flatnonzero(np.array(self.steps.loading) <= self.steps[end].pressure)
                ceiling = k[above[-1]] if above.size else np.inf
                k[end] = np.minimum(np.maximum(k[end], k[start]), np.maximum(ceiling, k[start]))
        return k


def _quantile(values: Array, position: Array) -> Array:
    """Interpolate sorted permeabilities in ln k at positions between them; 0 up to the last closed one."""
    n_closed = int(np.searchsorted(values, 0.0, side="right"))
    if n_closed == values.size:
        return np.zeros(position.size)
    log_k = np.log(values[n_closed:])
    inside = np.interp(position, np.arange(n_closed, values.size), log_k)
    return np.where(position >= n_closed - 0.5, np.exp(inside), 0.0)


def _moves(steps: LoadProgramme) -> list[tuple[int, int]]:
    """Pairs of steps, from and to: from the highest load down the loading, then down the unloading of every peak."""
    loading = list(range(len(steps.loading)))
    at = {steps[n].pressure: n for n in loading}
    moves = list(zip(loading[:0:-1], loading[-2::-1], strict=True))
    previous: dict[float, int] = {}
    for n, step in enumerate(steps):
        if step.unloaded_from is not None:
            moves.append((previous.get(step.unloaded_from, at[step.unloaded_from]), n))
            previous[step.unloaded_from] = n
    return moves


def _step_down(k_start: Array, k_end: Array, k: Array, u: Array) -> Array:
    """Add to each k the increment from start to end of a cell that is close to k in rank at the start."""
    order = np.argsort(k_start, kind="stable")
    sorted_start, increment = k_start[order], (k_end - k_start)[order]
    n_closed = int(np.searchsorted(sorted_start, 0.0, side="right"))
    n = order.size
    # closed links draw from closed cells, open ones from open cells, where there are any
    first = np.where((k > 0) & (n_closed < n), n_closed, 0)
    last = np.where((k <= 0) & (n_closed > 0), n_closed, n)
    width = np.where(k > 0, np.minimum(NEIGHBOURS, last - first), last - first)
    rank = np.searchsorted(sorted_start, k)
    low = np.clip(rank - width // 2, first, last - width)
    return np.maximum(k + increment[low + (u * width).astype(np.int64)], 0.0)


SAMPLERS: dict[str, Callable[[LinkTable, np.random.Generator], Draw | Indices]] = {
    "history": _history,
    "derivative": _derivative,
    "copula": _copula,
    "block": _block,
}

"""Drawing the links of a seal from a library.

Whole history: each link takes one measured cell along the whole cycle, which keeps every correlation. Derivative
(Pérez-Ràfols et al., 2018): each link draws its permeability at the highest load from the cells there, then, step by
step down, the increment of one of the cells closest in rank; closed links draw from closed cells. Random numbers
depend on (seed, realisation, link) only: link n of a longer seal draws what link n of a shorter one does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..contact import LoadStep
from ..errors import InputError

Array = NDArray[np.float64]
#: Cells close in rank among which the derivative sampler draws; more than a few bias the median leakage.
NEIGHBOURS = 5


def draw_links(
    table: Array,
    path: NDArray[np.int64],
    steps: Sequence[LoadStep],
    *,
    sampler: str,
    seed: int,
    realisation: int,
    axis: int,
) -> Array:
    """Permeabilities of links at every step (links, steps) [m³].

    Parameters
    ----------
    table : permeability of every library cell along every pressure path (paths, cells, steps) [m³].
    path : path that each link follows (links,).
    steps : the programme of the table's last axis.
    sampler : "history" or "derivative".
    seed, realisation, axis : which random numbers to use, besides the link's own number.

    Raises
    ------
    InputError : an unknown sampler.
    """
    if sampler not in SAMPLERS:
        raise InputError.of("sampler", sampler, f"one of {', '.join(SAMPLERS)}")
    bits = np.random.Philox(np.random.SeedSequence(seed, spawn_key=(realisation, axis)))
    uniform = np.random.Generator(bits).random((path.size, len(steps)))
    return SAMPLERS[sampler](table, path, steps, uniform)


def _whole_history(table: Array, path: NDArray[np.int64], steps: Sequence[LoadStep], uniform: Array) -> Array:
    cell = (uniform[:, 0] * table.shape[1]).astype(np.int64)
    return table[path, cell]


def _derivative(table: Array, path: NDArray[np.int64], steps: Sequence[LoadStep], uniform: Array) -> Array:
    loading = [n for n, s in enumerate(steps) if s.unloaded_from is None]
    at = {steps[n].pressure: n for n in loading}
    k = np.empty((path.size, len(steps)))
    top = loading[-1]
    k[:, top] = table[path, (uniform[:, top] * table.shape[1]).astype(np.int64), top]
    moves = list(zip(loading[:0:-1], loading[-2::-1], strict=True))
    previous: dict[float, int] = {}
    for n, step in enumerate(steps):
        if step.unloaded_from is not None:
            moves.append((previous.get(step.unloaded_from, at[step.unloaded_from]), n))
            previous[step.unloaded_from] = n
    for p in np.unique(path):
        links = np.flatnonzero(path == p)
        for start, end in moves:
            k[links, end] = _step_down(table[p][:, start], table[p][:, end], k[links, start], uniform[links, end])
    return k


def _step_down(k_start: Array, k_end: Array, k: Array, u: Array) -> Array:
    """k plus the increment start → end of a cell close to k in rank at the start."""
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


Sampler = Callable[[Array, NDArray[np.int64], Sequence[LoadStep], Array], Array]
SAMPLERS: dict[str, Sampler] = {"history": _whole_history, "derivative": _derivative}

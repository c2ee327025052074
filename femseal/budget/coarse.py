"""Coarser solutions of a scene, which tell how much its pixels and its removed waves matter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..library import LibraryTable
from ..loads import LoadProgramme
from ..studies.scene import Array


@dataclass(frozen=True)
class CoarserSolution:
    """Leakage of a scene that was solved otherwise: on fewer points, or without its shortest waves.

    points : of the face. steps : at which it was solved, some of those of the scene. leakage : at these steps [m²/s].
    against : leakage of the same study at these steps on the points of the scene; None: that of which the budget is.
    """

    points: tuple[int, int]
    steps: LoadProgramme
    leakage: Array
    against: Array | None = None


def on_all_steps(steps: LoadProgramme, coarse: CoarserSolution, leakage: Array) -> Array:
    """Change of ln(leakage) to a coarser solution at every step of the scene (steps,).

    Between the steps of the coarser solution it is straight in ln(load) on each branch, a peak being the first step of
    its unloading; beyond them it keeps the last value. It is inf or -inf where one of the two is sealed, 0 where both
    are, NaN where one is unknown.
    """
    index = {step: n for n, step in enumerate(steps)}
    places = [index[step] for step in coarse.steps]
    own = np.abs(np.asarray(leakage, float)[places] if coarse.against is None else coarse.against)
    other = np.abs(np.asarray(coarse.leakage, float))
    with np.errstate(divide="ignore", invalid="ignore"):
        change = np.where((own == 0) & (other == 0), 0.0, np.log(other / own))
    found = np.full(len(steps), np.nan)
    found[places] = change
    for peak in (None, *steps.unload_from):
        branch = [n for n, step in enumerate(steps) if step.unloaded_from == peak]
        ends = branch if peak is None else [*branch, int(steps.peak_indices[branch[0]])]
        known = sorted({*ends} & {*places}, key=lambda n: steps[n].pressure)
        if not known:
            continue
        at = _log_loads(steps, known)
        others = sorted({*branch} - {*places})
        for n, x in zip(others, _log_loads(steps, others), strict=True):
            found[n] = _straight(float(x), at, found[known])
    return found


def change_of_windows(own: LibraryTable, other: LibraryTable, steps: LoadProgramme) -> Array:
    """Change of ln(leakage) at steps from the windows of a library to the same windows solved otherwise (steps,).

    It is the median change of ln(k) of the windows that are open in both, at the step where both libraries have it,
    else on loading at its nominal pressure; NaN where all are closed.
    """
    count = min(len(own.k), len(other.k))
    wanted = _log_loads(steps, [*range(len(steps))])
    logs = []
    for table in (own, other):
        with np.errstate(divide="ignore", invalid="ignore"):
            ln_k = np.log(table.k[:count])
            if set(steps) <= set(table.steps):
                logs.append(ln_k[:, [table.steps.index(step) for step in steps]])
                continue
            loading = [n for n, step in enumerate(table.steps) if step.unloaded_from is None]
            at = _log_loads(table.steps, loading)
            logs.append(np.array([np.interp(wanted, at, row) for row in ln_k[:, loading]]))
    with np.errstate(invalid="ignore"):
        change = logs[1] - logs[0]
    finite = [column[np.isfinite(column)] for column in change.T]
    return np.array([float(np.median(column)) if column.size else np.nan for column in finite])


def _log_loads(steps: LoadProgramme, places: list[int]) -> Array:
    """ln of the nominal pressure; of no pressure at all that of a very small one."""
    return np.log(np.maximum(steps.pressures[places], 1e-300))


def _straight(x: float, at: Array, values: Array) -> float:
    """Interpolated value; that of the end beyond it, and the one of larger size where one of two is not finite."""
    upper = int(np.clip(np.searchsorted(at, x), 0, at.size - 1))
    lower = max(upper - 1, 0) if at[upper] > x else upper
    a, b = float(values[lower]), float(values[upper])
    if lower == upper:
        return a
    if not (np.isfinite(a) and np.isfinite(b)):
        return a if np.isnan(a) or (np.isinf(a) and not np.isnan(b)) else b
    return a + (b - a) * (x - at[lower]) / (at[upper] - at[lower])

"""Coarser solutions of a scene, which tell how much its pixels and its removed waves matter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
    peaks = steps.peak_indices
    for peak in (None, *steps.unload_from):
        branch = [n for n, step in enumerate(steps) if step.unloaded_from == peak]
        ends = branch if peak is None else [*branch, int(peaks[branch[0]])]
        known = sorted((n for n in ends if n in set(places)), key=lambda n: steps[n].pressure)
        if not known:
            continue
        at = np.log(np.maximum([steps[n].pressure for n in known], 1e-300))
        for n in set(branch) - set(places):
            found[n] = _straight(float(np.log(max(steps[n].pressure, 1e-300))), at, found[known])
    return found


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

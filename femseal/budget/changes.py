"""Coarser solutions of a scene, and the changes of ln(leakage) between solutions: how large they are at a step.

They tell how much pixels and removed waves matter. The change at a step is that of its neighbours too: near closing it
is a shift of the load at which the seal closes, times the slope of ln(leakage) over ln(load).
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import shortest_path

from ..base import Array, Shape
from ..loads import LoadProgramme, load_sensitivity, neighbouring_steps
from .error_parts import ErrorPart


@dataclass(frozen=True)
class CoarserSolution:
    """Leakage of a scene that was solved otherwise: on fewer points, or without its shortest waves.

    points : of the face. steps : at which it was solved, some of those of the scene. leakage : at these steps [m²/s].
    against : leakage of the same study at these steps on the points of the scene; None: that of which the budget is.
    """

    points: Shape
    steps: LoadProgramme
    leakage: Array
    against: Array | None = None


def on_all_steps(steps: LoadProgramme, coarse: CoarserSolution, leakage: Array) -> Array:
    """Change of ln(leakage) to a coarser solution at every step of the scene (steps,).

    Between the steps of the coarser solution it is straight in ln(load) on each branch, a peak being the first step of
    its unloading; beyond them it keeps the last value. It is inf or -inf where one of the two is sealed, 0 where both
    are, NaN where one is unknown.
    """
    places, pressure = [steps.index(step) for step in coarse.steps], steps.pressures
    own = np.abs(np.asarray(leakage, float)[places] if coarse.against is None else coarse.against)
    other = np.abs(np.asarray(coarse.leakage, float))
    # that of no pressure at all is that of a very small one
    at = np.log(np.maximum(pressure, 1e-300))
    found = np.full(len(steps), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        found[places] = np.where((own == 0) & (other == 0), 0.0, np.log(other / own))
        for branch in steps.branches:
            known = np.intersect1d(np.union1d(branch, steps.peak_indices[branch]), places)
            known, others = known[np.argsort(pressure[known])], np.setdiff1d(branch, places)
            if known.size:
                between = np.interp(at[others], at[known], np.arange(known.size))
                lower, weight = between.astype(int), between % 1
                a, b = found[known[lower]], found[known[np.ceil(between).astype(int)]]
                found[others] = np.where(weight > 0, (1 - weight) * a + weight * b, a)
    return found


#: Least slope of ln(leakage) over ln(load) that is counted.
LEAST_SLOPE = 0.3


def scale_of_changes(steps: LoadProgramme, change: Array, slope: Array, known: list[int]) -> Array:
    """Size of the changes of ln(leakage) at every step (steps,), from the solved steps near it and from all of them.

    It is made of the rms change of the nearest two or more steps, and of the mean shift of the load over the cycle.

    change : of ln(leakage) at every step. slope : see `load_sensitivity`, > 0. known : numbers of the steps solved.
    """
    finite = [s for s in known if np.isfinite(change[s])]
    if not finite:
        return np.zeros(len(steps))
    shift = mean_shift(change[finite], slope[finite])
    beside = np.zeros((len(steps), len(steps)))
    for s, other in neighbouring_steps(steps):
        beside[s, other] = 1
    apart = shortest_path(beside, directed=False, unweighted=True)[:, finite]
    near = apart <= np.sort(apart, axis=1)[:, :2].max(axis=1, keepdims=True)
    rms = np.sqrt(near @ np.square(change[finite]) / near.sum(axis=1))
    return np.hypot(rms, slope * shift)


def mean_shift(change: Array, slope: Array) -> float:
    """Mean shift of ln(load) of changes of ln(leakage) over its slope, 0 without any."""
    return float(np.mean(np.abs(change / slope))) if change.size else 0.0


def sealed_upper(
    steps: LoadProgramme,
    q: Array,
    distance: Array,
    change: Array | None = None,
    coarse: CoarserSolution | None = None,
) -> Array:
    """Upper end at the sealed steps (steps,) [m²/s], 0 elsewhere.

    It is the upper end of the next open step, where that is within the shift of the load at which the error would open
    the seal; and what the other solution leaks there, if there is one.

    q : leakage. distance : of ln(leakage) to the upper end. change : of ln(leakage) to the other solution.
    """
    found = np.zeros(q.size)
    slope = load_sensitivity(steps, q)
    open_ = (q > 0) & np.isfinite(distance)
    # the shift is that of steps whose slope is known, if there are any
    chosen = open_ & (slope > 0) if (slope[open_] > 0).any() else open_
    shift = float(np.max(distance[chosen] / np.maximum(slope[chosen], LEAST_SLOPE), initial=0.0))
    change, other = np.zeros(q.size) if change is None else change, np.zeros(q.size)
    if coarse is not None:
        other[[steps.index(step) for step in coarse.steps]] = np.nan_to_num(np.abs(coarse.leakage))
    pressure, loading, peaks = steps.pressures, steps.on_loading, steps.peak_indices
    for s in np.flatnonzero((q == 0) & ~np.isnan(change)):
        found[s] = other[s]
        branch = loading | (~loading[s] & (peaks == peaks[s]))
        less = np.flatnonzero(branch & open_ & (pressure <= pressure[s]))
        # a load that is sealed for certain seals all higher ones
        lowest = pressure[branch & (q == 0)].min()
        if less.size and (np.isposinf(change[s]) or pressure[s] * np.exp(-shift) <= lowest):
            nearest = max(less, key=lambda n: (pressure[n], -q[n]))
            found[s] = max(found[s], q[nearest] * np.exp(min(float(distance[nearest]), 50.0)))
        if np.isposinf(change[s]) and found[s] == 0:
            found[s] = other.max()
    return found


def part_of_changes(
    name: str,
    steps: LoadProgramme,
    leakage: Array,
    below: Array,
    above: Array,
    note: str,
    *,
    change: Array | None = None,
    coarse: CoarserSolution | None = None,
) -> ErrorPart:
    """A part by its distances of ln(leakage) on both sides (steps,), its upper end at sealed steps by `sealed_upper`.

    change, coarse : of ln(leakage) to the other solution, where the part comes from one; unknown where it is NaN.
    """
    q = np.abs(np.asarray(leakage, float))
    part = ErrorPart.of(name, leakage, below, above, note)
    upper = np.where(q == 0, sealed_upper(steps, q, above, change, coarse), part.upper)
    unknown = np.isnan(np.zeros(q.size) if change is None else change)
    lower, upper = (np.where(unknown, np.nan, end) for end in (part.lower, upper))
    return ErrorPart(name, lower, upper, note)

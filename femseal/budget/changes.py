"""Coarser solutions of a scene, and the changes of ln(leakage) between solutions: how large they are at a step.

They tell how much pixels and removed waves matter. The change at a step is that of its neighbours too: near closing it
is a shift of the load at which the seal closes, times the slope of ln(leakage) over ln(load).
"""

from dataclasses import dataclass

import numpy as np

from ..base import Array, Shape
from ..loads import LoadProgramme
from ..studies.load_curves import load_sensitivity, neighbouring_steps
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


#: Least slope of ln(leakage) over ln(load) that is counted.
LEAST_SLOPE = 0.3


def scale_of_changes(steps: LoadProgramme, change: Array, slope: Array, known: list[int]) -> Array:
    """Size of the changes of ln(leakage) at every step (steps,), from the solved steps near it and from all of them.

    It is made of the rms change of the nearest two or more steps, and of the mean shift of the load over the cycle.

    change : of ln(leakage) at every step. slope : see `load_sensitivity`, > 0. known : numbers of the steps solved.
    """
    finite = [s for s in known if np.isfinite(change[s])]
    shift = float(np.mean(np.abs(change[finite] / slope[finite]))) if finite else 0.0
    beside: list[set[int]] = [set() for _ in steps]
    for s, other in neighbouring_steps(steps):
        beside[s].add(other)
        beside[other].add(s)
    near = np.zeros(len(steps))
    for s in range(len(steps)):
        seen, ring, found = {s}, {s}, {s} & {*finite}
        while len(found) < 2 and ring:
            ring = {n for m in ring for n in beside[m]} - seen
            seen |= ring
            found |= ring & {*finite}
        near[s] = np.sqrt(np.mean(np.square(change[sorted(found)]))) if found else 0.0
    return np.hypot(near, slope * shift)


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
    change = np.zeros(q.size) if change is None else change
    leaks = {}
    if coarse is not None:
        leaks = {
            step: abs(float(value))
            for step, value in zip(coarse.steps, coarse.leakage, strict=True)
        }
    most = max((value for value in leaks.values() if np.isfinite(value)), default=0.0)
    shut = np.flatnonzero(q == 0)
    for s in shut:
        if np.isnan(change[s]):
            continue
        found[s] = np.nan_to_num(leaks.get(steps[s], 0.0))
        branch = [
            n for n in range(q.size) if steps[n].unloaded_from in (None, steps[s].unloaded_from)
        ]
        less = [n for n in branch if open_[n] and steps[n].pressure <= steps[s].pressure]
        # a load that is sealed for certain seals all higher ones
        lowest = min(steps[n].pressure for n in branch if q[n] == 0)
        if less and (np.isposinf(change[s]) or steps[s].pressure * np.exp(-shift) <= lowest):
            nearest = max(less, key=lambda n: (steps[n].pressure, -q[n]))
            found[s] = max(found[s], q[nearest] * np.exp(min(float(distance[nearest]), 50.0)))
        if np.isposinf(change[s]) and found[s] == 0:
            found[s] = most
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
    lower, upper = (
        part.lower,
        np.where(q == 0, sealed_upper(steps, q, above, change, coarse), part.upper),
    )
    if change is not None:
        lower, upper = (np.where(np.isnan(change), np.nan, end) for end in (lower, upper))
    return ErrorPart(name, lower, upper, note)

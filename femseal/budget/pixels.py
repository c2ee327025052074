"""Error of a leakage by the size of its pixels, from solutions on coarser grids.

The change of ln(leakage) from grid to grid is a smooth function of neither load nor pixel: where contacts open and
close it has either sign, and near closing it is a shift of the load at which the seal closes. So the error of a step is
taken from the changes at its neighbours too, and from the typical shift of the load over the whole cycle.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..loads import LoadProgramme
from ..studies import Scene
from ..studies.scene import Array
from .coarse import CoarserSolution, on_all_steps
from .error_parts import ErrorPart
from .grid_convergence import LEAST_ORDER, grid_convergence

#: Order of the leakage in the size of pixels. Measured on 320 faces of 64² to 256² points: 1.9 in the median.
ORDER = 2.0
#: Error over the scale of the changes to half the points a side, see `_scale`. Measured on these faces, at the loads
#: that leak more than 1e-3 of the first: 0.45 holds 95 of 100 errors, for each of four kinds of face 94 to 95.
PER_CHANGE = 0.5
#: The factor besides where few loads were solved on both grids, by their number; measured as above.
FEW_LOADS = {0: 3.0, 1: 3.0, 2: 1.45, 3: 1.15}
#: The factor besides where the changes hardly fall from grid to grid, below the least order, see `grid_convergence`.
#: Orders above the expected one are those of changes that are small by chance, which the other change makes up for.
OFF_ORDER = 1.5
#: Weight of the typical shift of the load, and the least shift, that of all faces.
_TYPICAL, _LEAST_SHIFT = 0.7, 4e-3
#: Share of the first leakage below which a step is near closing: there its error below is multiplied by the second,
#: and it may be sealed from the third of ln(leakage) on. Measured: most errors beyond the band are of steep curves.
_NEAR_CLOSING, _STEEPER, _MAY_CLOSE = 1e-3, 2.0, 1.5
#: Least sensitivity d ln(leakage) / d ln(load) that is counted.
_LEAST_SLOPE = 0.3


def pixels_part(scene: Scene, leakage: Array, coarse: Sequence[CoarserSolution]) -> ErrorPart:
    """Part of the pixels, from one coarser grid or two, the finer of them first.

    A step that is open on one grid and sealed on the other may be either.
    """
    q, steps = np.abs(np.asarray(leakage, dtype=float)), scene.steps
    points = float(np.prod(scene.surface.shape))
    sizes = [1.0, *(float(np.sqrt(points / np.prod(c.points))) for c in coarse)]
    changes = [on_all_steps(steps, c, leakage) for c in coarse]
    if len(changes) == 2:
        changes[1] = changes[1] - np.where(np.isfinite(changes[0]), changes[0], np.nan)
    slope = np.maximum(load_sensitivity(steps, leakage), _LEAST_SLOPE)
    # as if every change were that to half the points a side, by the expected order
    scaled = [
        change * (2.0**ORDER - 1) / (after**ORDER - before**ORDER)
        for change, before, after in zip(changes, sizes, sizes[1:], strict=False)
    ]
    known = [[steps.index(step) for step in c.steps] for c in coarse]
    scales = [_scale(steps, change, slope, at) for change, at in zip(scaled, known, strict=True)]
    order, falling = _order(changes, sizes, slope)
    loads = sum(1 for s in known[0] if np.isfinite(changes[0][s]) and steps[s].unloaded_from is None)
    factor = PER_CHANGE * FEW_LOADS.get(loads, 1.0) * (1.0 if falling else OFF_ORDER)
    distance = factor * np.sqrt(np.mean(np.square(scales), axis=0))
    below = np.where(q < _NEAR_CLOSING * q[0], _STEEPER * distance, distance)
    below[(q < _NEAR_CLOSING * q[0]) & (distance > _MAY_CLOSE)] = np.inf
    below[np.isneginf(changes[0])] = np.inf
    part = ErrorPart.of("pixels", leakage, below, distance, _note(coarse, order, changes))
    upper = np.where(q == 0, _sealed_upper(steps, q, changes[0], coarse[0], distance / slope), part.upper)
    unknown = np.isnan(changes[0])
    lower, upper = (np.where(unknown, np.nan, end) for end in (part.lower, upper))
    return ErrorPart(part.name, lower, upper, part.note)


def _scale(steps: LoadProgramme, change: Array, slope: Array, known: list[int]) -> Array:
    """Scale of the changes of ln(leakage) at every step (steps,), from the solved steps near it and from all of them.

    The changes of the nearest two or more steps, and the mean shift of the load over the cycle.
    """
    finite = [s for s in known if np.isfinite(change[s])]
    shift = float(np.mean(np.abs(change[finite] / slope[finite]))) if finite else 0.0
    beside: list[set[int]] = [set() for _ in steps]
    for s, other in neighbours(steps):
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
    return np.sqrt(near**2 + (_TYPICAL * slope * shift) ** 2 + (slope * _LEAST_SHIFT) ** 2)


def load_sensitivity(steps: LoadProgramme, leakage: Array) -> Array:
    """|d ln(leakage) / d ln(load)| at every step (steps,), the steeper of both sides on the branch; 0 where unknown."""
    q, p = np.abs(np.asarray(leakage, float)), steps.pressures
    found = np.zeros(len(steps))
    for s, other in neighbours(steps):
        if q[s] > 0 and q[other] > 0 and p[s] > 0 and p[other] > 0:
            slope = abs(np.log(q[s] / q[other]) / np.log(p[s] / p[other]))
            found[s], found[other] = max(found[s], slope), max(found[other], slope)
    return found


def neighbours(steps: LoadProgramme) -> list[tuple[int, int]]:
    """Every step with the one before it on its branch, that of an unloading being its peak."""
    pairs = []
    for s, step in enumerate(steps):
        before = s - 1
        if step.unloaded_from is not None and steps[before].unloaded_from != step.unloaded_from:
            before = int(steps.peak_indices[s])
        if before >= 0:
            pairs.append((s, before))
    return pairs


def _order(changes: list[Array], sizes: list[float], slope: Array) -> tuple[float, bool]:
    """Observed order of the typical change over the cycle, NaN with two grids; and whether changes fall."""
    if len(changes) < 2:
        return float("nan"), True
    known = np.isfinite(changes[0]) & np.isfinite(changes[1])
    if not known.any():
        return float("nan"), True
    first, second = (float(np.median(np.abs(change[known] / slope[known]))) for change in changes)
    found = grid_convergence([0.0, first, first + second], sizes, order=ORDER)
    return found.order, found.order >= LEAST_ORDER


def _sealed_upper(steps: LoadProgramme, q: Array, change: Array, coarse: CoarserSolution, shift: Array) -> Array:
    """Upper end at sealed steps (steps,): what the coarser grid leaks there, or the next open step within the shift."""
    found = np.zeros(q.size)
    leaks = {step: abs(float(value)) for step, value in zip(coarse.steps, coarse.leakage, strict=True)}
    for s, before in neighbours(steps):
        for sealed, other in ((s, before), (before, s)):
            if q[sealed] > 0 or np.isnan(change[sealed]):
                continue
            within = steps[other].pressure >= steps[sealed].pressure * np.exp(-float(np.max(shift)))
            if q[other] > 0 and (within or np.isposinf(change[sealed])):
                found[sealed] = max(found[sealed], q[other])
    for s, step in enumerate(steps):
        if q[s] == 0:
            found[s] = max(found[s], leaks.get(step, 0.0))
            if np.isposinf(change[s]) and found[s] == 0:
                found[s] = max(leaks.values(), default=0.0)
    return found


def _note(coarse: Sequence[CoarserSolution], order: float, changes: list[Array]) -> str:
    points = " and ".join(" × ".join(map(str, c.points)) for c in coarse)
    text = f"changes of ln(leakage) to {points} points at {len(coarse[0].steps)} steps and their neighbours"
    if len(changes) < 2:
        return f"{text}; two grids, order {ORDER:g} expected"
    known = np.isfinite(changes[0]) & np.isfinite(changes[1])
    oscillating = float(np.mean(changes[0][known] * changes[1][known] < 0)) if known.any() else 0.0
    return f"{text}; observed order {order:.2g}, oscillating at {oscillating:.0%} of the steps"

"""Error of a leakage by the size of its pixels, from its changes between two or three grids.

The change of ln(leakage) from grid to grid is a smooth function of neither load nor pixel: where contacts open and
close it has either sign, and near closing it is a shift of the load at which the seal closes. So the error of a step is
taken from the changes at its neighbours too, and from the typical shift of the load over the whole cycle.
Source: Celik, Ghia, Roache, Freitas, Coleman & Raad, J. Fluids Eng. 130, 2008, 078001.
"""

from collections.abc import Sequence
from math import log

import numpy as np
import scipy

from ..base import Array, counted
from ..studies import Scene
from ..studies.load_curves import least_counted
from .changes import (
    CoarserSolution,
    load_sensitivity,
    on_all_steps,
    part_of_changes,
    scale_of_changes,
)
from .error_parts import ErrorPart
from .waves import sealed_for_certain

#: Order of the leakage in the size of pixels. Measured on 320 faces of 64² to 256² points: 1.9 in the median.
ORDER = 2.0
#: Error over the scale of the changes to half the points a side, see `scale_of_changes`. Measured on 154 faces of six
#: kinds, at the loads that leak more than 1e-3 of the first: 0.28 holds 95 of 100 errors, 0.31 96.5, and 0.43 98, which
#: on other faces held 97.
PER_CHANGE = 0.43
#: The factor besides where few loads were solved on both grids, by their number; measured as above.
FEW_LOADS = {0: 3.0, 1: 3.0, 2: 1.45, 3: 1.15}
#: The factor besides where the changes hardly fall from grid to grid, below the least order.
#: Orders above the expected one are those of changes that are small by chance, which the other change makes up for.
OFF_ORDER, LEAST_ORDER = 1.5, 0.5
#: Orders that are looked for.
_ORDERS = 1e-3, 20.0
#: The least shift of the load, that of all faces, and the least slope of ln(leakage) over ln(load) that it is counted
#: with. Measured as above: with a third of the shift and a fifth of the slope as wide bands hold 94.5 in place of 97.
_LEAST_SHIFT, _LEAST_SLOPE = 0.012, 1.5
#: Pixels to the shortest wave of the faces on which that was measured.
USUAL_PIXELS = 8.0
#: Error of ln(leakage) from which on a step near closing may be sealed.
_MAY_CLOSE = 1.5


def pixels_part(
    scene: Scene,
    leakage: Array,
    coarse: Sequence[CoarserSolution],
    wave_pixels: float = USUAL_PIXELS,
) -> ErrorPart:
    """Part of the pixels, from one coarser grid or two, the finer of them first.

    A step that is open on one grid and sealed on the other may be either. wave_pixels : to the shortest wave; where
    they are more than usual, the least shift of the load is in proportion to the size of the pixels.
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
    least = _LEAST_SHIFT * min(1.0, USUAL_PIXELS / wave_pixels)
    scales = [
        np.hypot(scale_of_changes(steps, change, slope, at), least * slope)
        for change, at in zip(scaled, known, strict=True)
    ]
    falling, order = _order(changes, sizes, slope)
    loads = sum(
        1 for s in known[0] if np.isfinite(changes[0][s]) and steps[s].unloaded_from is None
    )
    factor = PER_CHANGE * FEW_LOADS.get(loads, 1.0) * (1.0 if falling else OFF_ORDER)
    distance = factor * np.sqrt(np.mean(np.square(scales), axis=0))
    may_close = (q < least_counted(q)) & (distance > _MAY_CLOSE)
    below = np.where(may_close | np.isneginf(changes[0]), np.inf, distance)
    grids = " and ".join(" × ".join(map(str, c.points)) for c in coarse)
    beside = f"{counted(len(coarse[0].steps), 'step')} and their neighbours"
    note = f"changes of ln(leakage) to {grids} points at {beside}; {order}"
    return part_of_changes(
        "pixels", steps, leakage, below, distance, note, change=changes[0], coarse=coarse[0]
    )


def one_grid_part(leakage: Array, in_contact: Array) -> list[ErrorPart]:
    """Part of the pixels of a scene that was solved on one grid: what is sealed there may be open, unless by far.

    in_contact : fraction in contact at every step (steps,). Empty where nothing is sealed but for certain.
    """
    q = np.abs(np.asarray(leakage, float))
    may_open = (q == 0) & ~sealed_for_certain(in_contact)
    note = "one grid, which does not tell by how much load a sealed face is sealed"
    return [ErrorPart("pixels", q, np.where(may_open, np.inf, q), note)] if may_open.any() else []


def _order(changes: list[Array], sizes: list[float], slope: Array) -> tuple[bool, str]:
    """Whether the typical change over the cycle falls from grid to grid, and its order as a text."""
    known = np.isfinite(changes).all(axis=0)
    if len(changes) < 2 or not known.any():
        return True, f"two grids, order {ORDER:g} expected"
    first, second = (float(np.median(np.abs(change[known] / slope[known]))) for change in changes)
    order = observed_order(first, second, sizes[1] / sizes[0], sizes[2] / sizes[1])
    observed = "the changes do not fall" if np.isnan(order) else f"observed order {order:.2g}"
    oscillating = float(np.mean(changes[0][known] * changes[1][known] < 0))
    return order >= LEAST_ORDER, f"{observed}, oscillating at {oscillating:.0%} of the steps"


def observed_order(first: float, second: float, ratio: float, before: float) -> float:
    """The order p at which r₁^p (r₂^p − 1)/(r₁^p − 1) is the ratio of the changes; NaN where these do not fall.

    first, second : sizes of the changes from the finest to the medium grid and on to the coarsest.
    ratio, before : r₁ and r₂, of the sizes of the cells of these grids.
    """
    if first * log(before) >= second * log(ratio):
        return float("nan")

    def excess(p: float) -> float:
        return p * log(ratio) + log((before**p - 1) / (ratio**p - 1)) - log(second / first)

    low, high = _ORDERS
    if first == 0 or excess(high) <= 0:
        return high
    return low if excess(low) >= 0 else float(scipy.optimize.brentq(excess, low, high))

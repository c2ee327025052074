"""Error of a value that was solved on two or three grids, and of a leakage by the size of its pixels.

The change of ln(leakage) from grid to grid is a smooth function of neither load nor pixel: where contacts open and
close it has either sign, and near closing it is a shift of the load at which the seal closes. So the error of a step is
taken from the changes at its neighbours too, and from the typical shift of the load over the whole cycle.
Source: Celik, Ghia, Roache, Freitas, Coleman & Raad, J. Fluids Eng. 130, 2008, 078001.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import copysign, isfinite, log

import numpy as np
import scipy

from ..base import InputError, counted
from ..studies import Scene
from ..studies.load_curves import least_counted
from ..studies.scene import Array
from .changes import CoarserSolution, load_sensitivity, on_all_steps, part_of_changes, scale_of_changes
from .error_parts import ErrorPart
from .waves import sealed_for_certain

#: Safety factor of an error whose order was observed and is what is expected, and of any other.
SAFETY, EXTRA_SAFETY = 1.25, 3.0
#: An observed order below the first, or above the expected one by more than this factor, is not what is expected.
LEAST_ORDER, MOST_ORDER = 0.5, 1.5
_ORDERS = 1e-3, 20.0


@dataclass(frozen=True)
class GridConvergence:
    """Convergence of a value over grids.

    kind : "monotone": the changes fall and have one sign. "oscillating": they have two signs. "diverging": they do not
        fall. "two grids": no order can be observed. "equal": there is no change.
    order : observed order, NaN unless three grids converge; used : the order that the error was computed with.
    extrapolated : value on a grid of size 0, by the order used; the finest value unless the convergence is monotone.
    error : of the finest value, with its safety factor, in the unit of the values; error_medium : that of the second.
    value, value_medium : of these grids. safety : the factor.
    """

    kind: str
    order: float
    used: float
    extrapolated: float
    error: float
    error_medium: float
    value: float
    value_medium: float
    safety: float

    @property
    def index(self) -> float:
        """Grid convergence index of the finest value: its error as a fraction of it."""
        return abs(self.error / self.value)

    @property
    def index_medium(self) -> float:
        """Grid convergence index of the second value."""
        return abs(self.error_medium / self.value_medium)

    @property
    def as_expected(self) -> bool:
        """Whether the order was observed and is what is expected."""
        return self.safety == SAFETY


def grid_convergence(values: Sequence[float], sizes: Sequence[float], *, order: float = 2.0) -> GridConvergence:
    """Error of the value on the finest grid, from the changes between grids.

    The error is the safety factor times |v₂ − v₁| / (r^p − 1), with the ratio r of the sizes. The order p is observed
    on three grids; it takes the factor 3 instead of 1.25 where it is not within 0.5 to 1.5 times the expected one, and
    is kept within 0.5 and the expected one. Oscillating values have at least the error of half their range, diverging
    ones that of their whole range, times 3.

    Parameters
    ----------
    values : on two or three grids, the finest first. sizes : of the cells of these grids, rising.
    order : expected, of the discretisation.

    Raises
    ------
    InputError : another number of grids, sizes that do not rise, values that are not finite.

    Examples
    --------
    >>> cells = [18000, 8000, 4500]
    >>> found = grid_convergence([6.063, 5.972, 5.863], [n**-0.5 for n in cells])
    >>> found.kind, round(found.order, 2), round(100 * found.index, 2), round(100 * found.index_medium, 2)
    ('monotone', 1.53, 2.17, 4.11)
    """
    v, h = [float(x) for x in values], [float(x) for x in sizes]
    if len(v) not in (2, 3) or len(h) != len(v):
        raise InputError(
            "values", f"{counted(len(v), 'value')} on {counted(len(h), 'grid')}", "two or three, each on its own grid"
        )
    if not all(0 < a < b for a, b in pairwise(h)) or not all(map(isfinite, (*v, *h))):
        raise InputError("sizes", h, "rising sizes > 0, the finest grid first, with finite values")
    change, ratio = v[1] - v[0], h[1] / h[0]
    if all(x == v[0] for x in v):
        return GridConvergence("equal", float("nan"), order, v[0], 0.0, 0.0, v[0], v[1], SAFETY)
    if len(v) == 2:
        return _found("two grids", float("nan"), order, v, ratio, EXTRA_SAFETY)
    before, ratio_before = v[2] - v[1], h[2] / h[1]
    spread = max(v) - min(v)
    if abs(change) * log(ratio_before) >= abs(before) * log(ratio):
        kind = "oscillating" if change * before < 0 else "diverging"
        found = _found(kind, float("nan"), LEAST_ORDER, v, ratio, EXTRA_SAFETY)
        return _at_least(found, EXTRA_SAFETY * spread)
    observed = _observed_order(abs(before / change), copysign(1.0, before * change), ratio, ratio_before)
    expected = LEAST_ORDER <= observed <= MOST_ORDER * order and before * change > 0
    used = min(max(observed, LEAST_ORDER), order)
    found = _found(
        "monotone" if before * change > 0 else "oscillating",
        observed,
        observed if expected and observed <= order else used,
        v,
        ratio,
        SAFETY if expected else EXTRA_SAFETY,
        ratio_before,
    )
    return found if found.kind == "monotone" else _at_least(found, spread / 2)


def _found(
    kind: str, observed: float, used: float, v: list[float], ratio: float, safety: float, before: float = 0.0
) -> GridConvergence:
    correction = (v[0] - v[1]) / (ratio**used - 1)
    medium = correction + v[0] - v[1] if len(v) == 2 or not before else (v[1] - v[2]) / (before**used - 1)
    limit = v[0] + correction if kind == "monotone" else v[0]
    return GridConvergence(
        kind, observed, used, limit, safety * abs(correction), safety * abs(medium), v[0], v[1], safety
    )


def _at_least(found: GridConvergence, error: float) -> GridConvergence:
    return replace(found, error=max(found.error, error), error_medium=max(found.error_medium, error))


def _observed_order(changes: float, sign: float, ratio: float, before: float) -> float:
    """The order p at which r₁^p (r₂^p − s)/(r₁^p − s) is the ratio of the changes."""

    def excess(p: float) -> float:
        return p * log(ratio) + log((before**p - sign) / (ratio**p - sign)) - log(changes)

    low, high = _ORDERS
    if excess(low) >= 0:
        return low
    return high if excess(high) <= 0 else float(scipy.optimize.brentq(excess, low, high))


#: Order of the leakage in the size of pixels. Measured on 320 faces of 64² to 256² points: 1.9 in the median.
ORDER = 2.0
#: Error over the scale of the changes to half the points a side, see `scale_of_changes`. Measured on 154 faces of six
#: kinds, at the loads that leak more than 1e-3 of the first: 0.28 holds 95 of 100 errors, 0.31 96.5, and 0.43 98, which
#: on other faces held 97.
PER_CHANGE = 0.43
#: The factor besides where few loads were solved on both grids, by their number; measured as above.
FEW_LOADS = {0: 3.0, 1: 3.0, 2: 1.45, 3: 1.15}
#: The factor besides where the changes hardly fall from grid to grid, below the least order, see `grid_convergence`.
#: Orders above the expected one are those of changes that are small by chance, which the other change makes up for.
OFF_ORDER = 1.5
#: The least shift of the load, that of all faces, and the least slope of ln(leakage) over ln(load) that it is counted
#: with. Measured as above: with a third of the shift and a fifth of the slope as wide bands hold 94.5 in place of 97.
_LEAST_SHIFT, _LEAST_SLOPE = 0.012, 1.5
#: Pixels to the shortest wave of the faces on which that was measured.
USUAL_PIXELS = 8.0
#: Error of ln(leakage) from which on a step near closing may be sealed.
_MAY_CLOSE = 1.5


def pixels_part(
    scene: Scene, leakage: Array, coarse: Sequence[CoarserSolution], wave_pixels: float = USUAL_PIXELS
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
    order, falling = _order(changes, sizes, slope)
    loads = sum(1 for s in known[0] if np.isfinite(changes[0][s]) and steps[s].unloaded_from is None)
    factor = PER_CHANGE * FEW_LOADS.get(loads, 1.0) * (1.0 if falling else OFF_ORDER)
    distance = factor * np.sqrt(np.mean(np.square(scales), axis=0))
    may_close = (q < least_counted(q)) & (distance > _MAY_CLOSE)
    below = np.where(may_close | np.isneginf(changes[0]), np.inf, distance)
    note = _note(coarse, order, changes)
    return part_of_changes("pixels", steps, leakage, below, distance, note, change=changes[0], coarse=coarse[0])


def one_grid_part(leakage: Array, contact: Array) -> list[ErrorPart]:
    """Part of the pixels of a scene that was solved on one grid: what is sealed there may be open, unless by far.

    contact : fraction in contact at every step (steps,). Empty where nothing is sealed but for certain.
    """
    q = np.abs(np.asarray(leakage, float))
    may_open = (q == 0) & ~sealed_for_certain(contact)
    note = "one grid, which does not tell by how much load a sealed face is sealed"
    return [ErrorPart("pixels", q, np.where(may_open, np.inf, q), note)] if may_open.any() else []


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


def _note(coarse: Sequence[CoarserSolution], order: float, changes: list[Array]) -> str:
    points = " and ".join(" × ".join(map(str, c.points)) for c in coarse)
    text = f"changes of ln(leakage) to {points} points at {counted(len(coarse[0].steps), 'step')} and their neighbours"
    if len(changes) < 2:
        return f"{text}; two grids, order {ORDER:g} expected"
    known = np.isfinite(changes[0]) & np.isfinite(changes[1])
    oscillating = float(np.mean(changes[0][known] * changes[1][known] < 0)) if known.any() else 0.0
    observed = "the changes do not fall" if np.isnan(order) else f"observed order {order:.2g}"
    return f"{text}; {observed}, oscillating at {oscillating:.0%} of the steps"

"""Error of a value that was solved on two or three grids.

Source: Celik, Ghia, Roache, Freitas, Coleman & Raad, J. Fluids Eng. 130, 2008, 078001.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import copysign, isfinite, log

import scipy

from ..base.errors import InputError

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
        raise InputError("values", f"{len(v)} values on {len(h)} grids", "two or three, each on its own grid")
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

"""Fit power laws of the contact pressure to permeabilities, and integrate a power of the pressure over a profile."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, expm1

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, InputError, reals, validate

#: Largest relative deviation of the permeability from a power law in the range of pressures for which the law is used.
FIT_TOLERANCE = 0.1


@dataclass(frozen=True)
class PowerLaw:
    """Describe the permeability of a surface finish in a range of contact pressures by k = k₀ (p/p₀)⁻ⁿ.

    Attributes
    ----------
    exponent : float
        Exponent n = −d ln k/d ln p.
    pressure : float
        Reference pressure p₀ [Pa], the geometric mean of the lowest and the highest contact pressure.
    permeability : float
        Permeability k₀ at the reference pressure [m³].
    lowest_pressure, highest_pressure : float
        Lowest and highest contact pressure for which the law was fitted [Pa].
    count : int
        Number of load steps to which the law was fitted. With two load steps, the deviation is 0.
    deviation : float
        Largest relative deviation of the permeability at a load step from the law.
    """

    exponent: float
    pressure: float
    permeability: float
    lowest_pressure: float
    highest_pressure: float
    count: int
    deviation: float

    def at(self, pressure: ArrayLike) -> Array:
        """Return the permeability at a contact pressure [m³]."""
        return self.permeability * (reals(pressure) / self.pressure) ** -self.exponent

    def needed_index(self, drive: float, leakage: float) -> float:
        """Return the sealing index p₀ⁿ k₀ D/q that is required for a leakage of at most q [Paⁿ m].

        Parameters
        ----------
        drive : float
            Drop D of the pressure potential from inlet to outlet, divided by the density [1/s]; for a liquid, the
            pressure drop divided by the viscosity.
        leakage : float
            Leakage q per unit length of the seal [m²/s].
        """
        # p₀ⁿ can overflow if the exponent is large; the index is then infinite
        logarithm = self.exponent * np.log(self.pressure) + np.log(
            self.permeability * drive / leakage
        )
        with np.errstate(over="ignore"):
            return float(np.exp(logarithm))


def fit_power_law(pressures: ArrayLike, permeabilities: ArrayLike) -> PowerLaw:
    """Fit the power law that minimises the largest relative deviation from the permeabilities (minimax fit).

    Parameters
    ----------
    pressures : array_like
        Contact pressures in any order [Pa].
    permeabilities : array_like
        Permeability at each pressure [m³].

    Returns
    -------
    PowerLaw

    Raises
    ------
    InputError
        There are fewer than two different pressures, or a value is not above 0.

    Examples
    --------
    >>> law = fit_power_law([1e8, 2e8, 4e8], [8e-18, 1e-18, 0.125e-18])
    >>> round(law.exponent, 9), round(law.deviation, 9)
    (3.0, 0.0)
    """
    p = _positive("pressures", pressures)
    k = _positive("permeabilities", permeabilities)
    if p.shape != k.shape:
        raise InputError(
            "permeabilities", f"{k.size} values", f"one for each of {p.size} pressures"
        )
    if np.unique(p).size < max(p.size, 2):
        raise InputError(
            "pressures", f"{np.unique(p).size} different ones", "two or more, all different"
        )
    # in logarithms the law is a straight line, y = intercept + slope x; the line whose largest deviation from the
    # points is smallest (Chebyshev) is parallel to a line through two of the points, so that all pairs are tried
    x, y = np.log(p), np.log(k)
    first, second = np.triu_indices(p.size, 1)
    slopes = (y[second] - y[first]) / (x[second] - x[first])
    residuals = y - slopes[:, None] * x  # axes: slope, pressure
    highest = residuals.max(axis=1)
    lowest = residuals.min(axis=1)
    best = int(np.argmin(highest - lowest))
    # the line lies midway between the highest and the lowest point
    intercept = (highest[best] + lowest[best]) / 2
    middle = (x.min() + x.max()) / 2
    return PowerLaw(
        exponent=-float(slopes[best]),
        pressure=exp(middle),
        permeability=exp(intercept + slopes[best] * middle),
        lowest_pressure=float(p.min()),
        highest_pressure=float(p.max()),
        count=p.size,
        deviation=expm1((highest[best] - lowest[best]) / 2),
    )


def fit_power_laws(
    pressures: ArrayLike, permeabilities: ArrayLike, tolerance: float = FIT_TOLERANCE
) -> tuple[PowerLaw, ...]:
    """Divide the contact pressures into as few ranges as possible, and fit a power law in each range.

    In each range, the permeability deviates from the power law by at most `tolerance`. Two neighbouring ranges have one
    pressure in common.

    Parameters
    ----------
    pressures, permeabilities : array_like
        See `fit_power_law`.
    tolerance : float
        Largest relative deviation of the permeability from the law in each range, above 0 and below 1.

    Returns
    -------
    tuple of PowerLaw
        Power laws, beginning with the range of the highest pressures.
    """
    tolerance = validate.tolerance("tolerance", tolerance)
    p = _positive("pressures", pressures)
    k = _positive("permeabilities", permeabilities)
    # this fit serves only to check the values
    fit_power_law(p, k)
    falling = np.argsort(p)[::-1]
    p, k = p[falling], k[falling]
    laws = []
    start = 0
    # each range begins with two pressures, and is extended as long as a power law fits
    while start < p.size - 1:
        law = fit_power_law(p[start : start + 2], k[start : start + 2])
        for end in range(start + 3, p.size + 1):
            longer = fit_power_law(p[start:end], k[start:end])
            if longer.deviation > tolerance:
                break
            law = longer
        laws.append(law)
        # the last pressure of a range is the first one of the next
        start += law.count - 1
    return tuple(laws)


def integrate_power(positions: ArrayLike, pressures: ArrayLike, exponent: float) -> float:
    """Integrate pⁿ over a profile of the contact pressure p, which is linear between the given positions.

    If p varies linearly from `a` to `b` between two positions, the mean of pⁿ is (bⁿ⁺¹ − aⁿ⁺¹)/((n + 1)(b − a)).

    Parameters
    ----------
    positions : array_like
        Positions along the direction of the leakage, in ascending order [m].
    pressures : array_like
        Contact pressure at each position, >= 0 [Pa].
    exponent : float
        Exponent n > 0.

    Returns
    -------
    float
        Sealing index [Paⁿ m].

    Examples
    --------
    >>> integrate_power([0.0, 0.5], [2.0, 4.0], 1.0)  # a mean of 3 Pa over 0.5 m
    1.5
    """
    n = validate.number("exponent", exponent)
    l, p = reals(positions), reals(pressures)
    if l.ndim != 1 or l.size < 2 or not (np.isfinite(l).all() and (np.diff(l) > 0).all()):
        raise InputError("positions", positions, "two or more positions in rising order [m]")
    if p.shape != l.shape or not (np.isfinite(p).all() and (p >= 0).all()):
        raise InputError("pressures", pressures, "a pressure >= 0 for each position [Pa]")
    smaller, larger = np.minimum(p[:-1], p[1:]), np.maximum(p[:-1], p[1:])
    rise = larger - smaller
    # for nearly equal pressures `a` and `b`, ((a + b)/2)ⁿ is more accurate than the formula, which divides by b − a
    is_level = rise <= 1e-6 * larger
    safe_rise = np.where(is_level, 1.0, rise)
    highest = float(p.max())
    if highest == 0:
        return 0.0
    # compute in units of the highest pressure, because the power of a pressure in pascal can overflow
    larger, smaller, safe_rise = larger / highest, smaller / highest, safe_rise / highest
    exact = (larger ** (n + 1) - smaller ** (n + 1)) / ((n + 1) * safe_rise)
    mean = np.where(is_level, ((larger + smaller) / 2) ** n, exact)
    with np.errstate(over="ignore"):
        return float(np.sum(mean * np.diff(l)) * np.power(highest, n))


def _positive(name: str, values: ArrayLike) -> Array:
    """Return the values as an array; raise InputError unless all values are finite and above 0."""
    array = reals(values)
    if array.ndim != 1 or not (np.isfinite(array).all() and (array > 0).all()):
        raise InputError(name, values, "finite numbers > 0")
    return array

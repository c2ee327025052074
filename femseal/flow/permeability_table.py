"""Permeability that depends on the pressure of the fluid, as that of a rarefied gas or of faces that it presses apart.

It is known at a few pressures, and ln k is interpolated: in ln p by one polynomial for a rarefied gas, whose slope is
between −1, free molecules, and 0, viscous flow; or linear in p between the pressures, as closed parts may open there.
Measured on rough gaps of 10 nm to 10 µm and helium: six Chebyshev points over three decades of pressure are within
0.1 % of the flow, four over one decade too; between plates within 0.5 %, where the jumps of the flow factor show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from ..base import Array, InputError
from ..base.compiled import compiled, inner

#: Pressures below this fraction of the inlet's are not looked at, since hardly anything of the drop lies there.
_LEAST_FRACTION = 1e-3
#: Number of pressures up to this ratio of the highest to the lowest, and beyond.
_ONE_DECADE, _FEW, _MANY = 12.0, 4, 6
#: Points of the mean over a link, in the root of the distance from its lower pressure.
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_ROOTS = 0.5 * (1 + _POINTS)
#: Drop, as a fraction of the pressure, up to which one point will do.
_SMALL = 0.05
#: A mobility that varies less than this is the same at all pressures.
_EVEN = 1e-9


def table_pressures(inlet: float, outlet: float) -> Array:
    """Pressures [Pa] at which the permeability of a gas between two pressures is needed, falling from the higher one.

    Chebyshev's extremes in ln p: four where the ends are within a factor of 12, else six, the lowest not below 1e-3 of
    the highest.
    """
    high = max(inlet, outlet)
    low = max(min(inlet, outlet), _LEAST_FRACTION * high)
    if not low > 0:
        raise InputError("pressure", f"{inlet:g} and {outlet:g} Pa", "one of them > 0")
    if high == low:
        low = high / 1.01
    count = _FEW if high / low <= _ONE_DECADE else _MANY
    x = np.cos(np.pi * np.arange(count) / (count - 1))
    return np.exp(0.5 * (np.log(high) + np.log(low)) + 0.5 * (np.log(high) - np.log(low)) * x)


@dataclass(frozen=True, eq=False)
class PermeabilityTable:
    """Permeability of the parts of a seal at several pressures.

    Parameters
    ----------
    pressures : m different ones > 0 [Pa], such as those of `table_pressures`.
    values : what `seal_leakage` takes as permeability, with a first axis of m: (m,) numbers, the links as a pair of
        arrays (m, n1, n2) and (m, n1 − 1, n2), of a mesh (m, n_elements)
        or (m, n_elements, 2) [m³]. A part that is closed at one pressure counts
        as closed.
    piecewise : interpolate ln k between each two pressures, which may be 0 and at which a part may be closed (k is then
        linear between them); else by one polynomial in ln p.

    Raises
    ------
    InputError : pressures that are not > 0, of `piecewise` not >= 0, or not different, values that are negative or
        undefined or do not match.

    Examples
    --------
    Helium from 10 bar to 1 bar through gaps of 100 nm: 4.0 times what the viscous flow would be.

    >>> import femseal as fs
    >>> gas = fs.IdealGas(19.6e-6, 4.0026e-3, 293.15)
    >>> gap, ends = np.full((4, 4), 100e-9), {"inlet_pressure": 10e5, "outlet_pressure": 1e5}
    >>> pressures = table_pressures(10e5, 1e5)
    >>> k = [fs.cell_permeability(gap, (1e-6, 1e-6), law=gas.law, pressure=p).value for p in pressures]
    >>> seal = fs.RectangularSeal((1e-3, 0.1), (10, 100))
    >>> with_slip = fs.seal_leakage(seal, PermeabilityTable(pressures, k), gas, **ends)
    >>> round(with_slip.mass_rate / fs.seal_leakage(seal, (100e-9) ** 3 / 12, gas, **ends).mass_rate, 1)
    4.0
    """

    pressures: Sequence[float] | Array
    values: Any
    piecewise: bool = False

    def __post_init__(self) -> None:
        p = np.array(self.pressures, dtype=float).ravel()
        known = p.size >= 2 and np.isfinite(p).all() and np.unique(p).size == p.size
        if not known or p.min() < 0 or (p.min() == 0 and not self.piecewise):
            relation = ">=" if self.piecewise else ">"
            raise InputError(
                "pressures",
                str(self.pressures),
                f"two or more different pressures {relation} 0 [Pa]",
            )
        pair = isinstance(self.values, tuple) and all(np.ndim(v) > 0 for v in self.values)
        arrays = tuple(
            np.asarray(v, dtype=float) for v in (self.values if pair else (self.values,))
        )
        for k in arrays:
            if k.ndim < 1 or len(k) != p.size:
                raise InputError(
                    "values", f"shape {k.shape}", f"a first axis of {p.size}, one for each pressure"
                )
            if not np.isfinite(k).all() or k.min(initial=0.0) < 0:
                raise InputError(
                    "values", "negative or undefined permeabilities", "finite numbers >= 0 [m³]"
                )
        object.__setattr__(self, "pressures", tuple(p.tolist()))
        object.__setattr__(self, "values", arrays if pair else arrays[0])

    @property
    def typical(self) -> tuple[float, float]:
        """A pressure in the middle [Pa] and the median of the open permeabilities at it [m³], 0 where all is closed."""
        first = self.values[0] if isinstance(self.values, tuple) else self.values
        middle = int(np.argsort(self.pressures)[len(self.pressures) // 2])
        k = first[middle]
        return self.pressures[middle], float(np.median(k[k > 0])) if (k > 0).any() else 0.0


def tabulated(
    pressures: Sequence[float] | Array, values: Sequence[Any], piecewise: bool = False
) -> Any:
    """Table of the permeabilities at each of the pressures; the only permeability where there is one."""
    if len(values) == 1:
        return values[0]
    pair = isinstance(values[0], (tuple, list))
    stacked = tuple(np.array(v) for v in zip(*values, strict=True)) if pair else np.array(values)
    return PermeabilityTable(tuple(pressures), stacked, piecewise)


class PressureCurve:
    """Permeabilities as functions of the pressure, each of its own: values (m, …) at m pressures."""

    def __init__(self, pressures: ArrayLike, values: Array, piecewise: bool = False) -> None:
        self._knots = np.empty(0)
        self.shape = values.shape[1:]
        if piecewise:
            order = np.argsort(pressures)
            self._knots = np.asarray(pressures, dtype=float)[order]
            with np.errstate(divide="ignore"):
                self._coefficients = np.ascontiguousarray(
                    np.log(values[order]).reshape(len(values), -1).T
                )
            self._range, self._slope = (0.0, 1.0), np.zeros(len(self._coefficients))
            self._open = (values > 0).any(axis=0).ravel()
            return
        x = np.log(np.asarray(pressures, dtype=float))
        self._range = float(x.min()), float(x.max())
        is_open = (values > 0).all(axis=0)
        log_k = np.log(np.where(is_open, values, 1.0)).reshape(len(values), -1)
        coefficients = np.linalg.solve(chebyshev.chebvander(self.scaled(x), len(x) - 1), log_k)
        slope = (
            chebyshev.chebval(-1.0, chebyshev.chebder(coefficients))
            * 2
            / (self._range[1] - self._range[0])
        )
        self._coefficients = np.ascontiguousarray(coefficients.T)
        # below the lowest pressure k rises no faster than that of free molecules
        self._slope = np.clip(slope, -1.0, 0.0)
        self._open = is_open.ravel()

    def scaled(self, x: Array) -> Array:
        """ln p from −1 to 1 between the lowest and the highest pressure."""
        low, high = self._range
        return (2 * x - low - high) / (high - low)

    def between(self, first: Array, second: Array, mobility: Mobility) -> Array:
        """Mean of each permeability between two pressures > 0, ∫ k dφ/∫ dψ."""
        a, b = (np.broadcast_to(p, self.shape).flatten() for p in (first, second))
        out = np.empty(a.size)
        of_parts = self._coefficients, self._slope, self._open, *self._range, self._knots
        of_fluid = mobility.start, mobility.end, mobility.viscous, mobility.own, mobility.even
        _means(a, b, *of_parts, *of_fluid, _ROOTS, _WEIGHTS, out)
        return np.exp(out, out=out).reshape(self.shape)


@dataclass(frozen=True, eq=False)
class Mobility:
    """dφ/dp and dψ/dp of a fluid in the viscous potential and in one of its own, at pressures between two ends.

    start, end : pressures of the ends [Pa]. viscous, own : at start + (end − start) t² for equidistant t from 0 to 1.
    """

    start: float
    end: float
    viscous: Array
    own: Array

    @cached_property
    def even(self) -> bool:
        """Whether both are the same at all pressures, as of a liquid of constant viscosity."""
        return bool(np.ptp(self.viscous) + np.ptp(self.own) <= _EVEN * np.abs(self.viscous).max())


@inner(error_model="numpy")
def _interpolated(p, start, end, values):
    n = values.size - 1
    fraction = (p - start) / (end - start) if end != start else 0.0
    place = np.sqrt(min(max(fraction, 0.0), 1.0)) * n
    i = min(int(place), n - 1)
    # the pressure, not its root, is what a viscous gas is straight in
    low, high = (i / n) ** 2, ((i + 1) / n) ** 2
    weight = (fraction - low) / (high - low)
    return (1.0 - weight) * values[i] + weight * values[i + 1]


@inner(error_model="numpy")
def _permeability(p, coefficients, slope, low, high, knots):
    """k of one part at a pressure; coefficients are ln k at the knots, or those of a polynomial without knots."""
    if knots.size:
        i = 1
        while i < knots.size - 1 and knots[i] < p:
            i += 1
        weight = min(max((p - knots[i - 1]) / (knots[i] - knots[i - 1]), 0.0), 1.0)
        a, b = coefficients[i - 1], coefficients[i]
        if min(a, b) == -np.inf:
            return (1.0 - weight) * np.exp(a) + weight * np.exp(b)
        return np.exp((1.0 - weight) * a + weight * b)
    x = np.log(p)
    inside = min(max(x, low), high)
    t = (2.0 * inside - low - high) / (high - low)
    # Clenshaw's recurrence
    before, here = 0.0, 0.0
    for i in range(coefficients.size - 1, 0, -1):
        before, here = here, 2.0 * t * here - before + coefficients[i]
    return np.exp(t * here - before + coefficients[0] + slope * min(x - low, 0.0))


@inner(error_model="numpy")
def _mean_between_knots(least, most, log_k, knots, inverse, knot):
    """Mean over the pressure of a permeability whose logarithm is linear between knots and constant beyond them.

    inverse : of the distance from each knot to the next one, 0 at the last. knot : the last one up to `least`, or 0.
    """
    total, here = 0.0, least
    while here < most:
        first = following = log_k[knot]
        there = most
        if here < knots[0]:
            there = min(most, knots[0])
        elif knot < knots.size - 1:
            there, following = min(most, knots[knot + 1]), log_k[knot + 1]
        middle = (0.5 * (here + there) - knots[knot]) * inverse[knot]
        if min(first, following) == -np.inf:
            mean = np.exp(first) + middle * (np.exp(following) - np.exp(first))
        else:
            # half the difference of the logarithms of both ends
            x = 0.5 * (there - here) * inverse[knot] * (following - first)
            mean = np.exp(first + middle * (following - first))
            mean *= 1.0 + x * x / 6.0 * (1.0 + x * x / 20.0) if abs(x) < 0.05 else np.sinh(x) / x
        total += mean * (there - here)
        if here >= knots[0]:
            knot += 1
        here = there
    return total / (most - least)


@compiled(error_model="numpy")
def _means(
    a,
    b,
    coefficients,
    slope,
    is_open,
    low,
    high,
    knots,
    start,
    end,
    viscous,
    own,
    even,
    roots,
    weights,
    out,
):
    """Logarithm of the mean of each permeability between two pressures, by Gauss points dense at the lower one.

    With knots and an even mobility it is exact.
    """
    inverse = np.zeros(knots.size)
    for i in range(knots.size - 1):
        inverse[i] = 1.0 / (knots[i + 1] - knots[i])
    knot = 0  # the last one below the link before, near which this one's is
    for n in range(a.size):
        if not is_open[n]:
            out[n] = -np.inf
            continue
        least, most = min(a[n], b[n]), max(a[n], b[n])
        if even and knots.size and most > least:
            while knot > 0 and knots[knot] > least:
                knot -= 1
            while knot < knots.size - 1 and knots[knot + 1] <= least:
                knot += 1
            if knots[knot] <= least and knot < knots.size - 1 and most <= knots[knot + 1]:
                rise = (coefficients[n, knot + 1] - coefficients[n, knot]) * inverse[knot]
                x = 0.5 * rise * (most - least)  # of the mean, ln(sinh x/x) is what follows
                if abs(x) < 0.05:
                    middle = coefficients[n, knot] + rise * (0.5 * (least + most) - knots[knot])
                    out[n] = middle + x * x / 6.0 * (1.0 - x * x / 30.0)
                    continue
            out[n] = np.log(_mean_between_knots(least, most, coefficients[n], knots, inverse, knot))
            continue
        # the mobility of a gas is nearly straight in p: one point will do for a small drop
        if most - least <= _SMALL * most:
            p = 0.5 * (least + most)
            k = _permeability(p, coefficients[n], slope[n], low, high, knots)
            out[n] = np.log(
                k * _interpolated(p, start, end, viscous) / _interpolated(p, start, end, own)
            )
            continue
        top, bottom = 0.0, 0.0
        for q in range(roots.size):
            p = least + (most - least) * roots[q] ** 2
            weight = weights[q] * roots[q]
            slope_φ = _interpolated(p, start, end, viscous)
            top += weight * slope_φ * _permeability(p, coefficients[n], slope[n], low, high, knots)
            bottom += weight * _interpolated(p, start, end, own)
        out[n] = np.log(top / bottom)

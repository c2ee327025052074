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
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from ..base import Array, Indices, InputError

#: Pressures below this fraction of the inlet's are not looked at, since hardly anything of the drop lies there.
_LEAST_FRACTION = 1e-3
#: Number of pressures up to this ratio of the highest to the lowest, and beyond.
_ONE_DECADE, _FEW, _MANY = 12.0, 4, 6
#: Points of the mean over a link, in the root of the distance from its lower pressure.
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_ROOTS = 0.5 * (1 + _POINTS)
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
    values : what `seal_leakage` takes as permeability, with a first axis of m [m³]: (m,) numbers, or one per element,
        such as (m, n_elements) or (m, n_elements, 2), no tensors. An element that is closed at one pressure counts as
        closed.
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
        try:
            values = np.asarray(self.values, dtype=float)
        except (TypeError, ValueError):
            expected = f"one array with a first axis of {p.size}"
            raise InputError(
                "values", "arrays of different shapes, or no numbers", expected
            ) from None
        if values.ndim < 1 or len(values) != p.size:
            expected = f"a first axis of {p.size}, one for each pressure"
            raise InputError("values", f"shape {values.shape}", expected)
        if not np.isfinite(values).all() or values.min(initial=0.0) < 0:
            expected = "finite numbers >= 0 [m³]"
            raise InputError("values", "negative or undefined permeabilities", expected)
        object.__setattr__(self, "pressures", tuple(p.tolist()))
        object.__setattr__(self, "values", values)

    @property
    def typical(self) -> tuple[float, float]:
        """A pressure in the middle [Pa] and the median of the open permeabilities at it [m³], 0 where all is closed."""
        middle = int(np.argsort(self.pressures)[len(self.pressures) // 2])
        k = self.values[middle]
        return self.pressures[middle], float(np.median(k[k > 0])) if (k > 0).any() else 0.0


def tabulated(
    pressures: Sequence[float] | Array, values: Sequence[Any], piecewise: bool = False
) -> Any:
    """Table of the permeabilities at each of the pressures; the only permeability where there is one."""
    if len(values) == 1:
        return values[0]
    return PermeabilityTable(tuple(pressures), np.array(values), piecewise)


class PressureCurve:
    """Permeabilities as functions of the pressure, one for each element: values (m, …) at m pressures."""

    def __init__(self, pressures: ArrayLike, values: Array, piecewise: bool = False) -> None:
        order = np.argsort(pressures)
        self._knots, self._piecewise = np.asarray(pressures, dtype=float)[order], piecewise
        self.shape = values.shape[1:]
        k = values[order].reshape(order.size, -1)
        if piecewise:
            with np.errstate(divide="ignore"):
                self._log_k = np.log(k)
            self._open = (k > 0).any(axis=0)
            return
        self._open = (k > 0).all(axis=0)
        self._range = np.log(self._knots[[0, -1]])
        t = self._scaled(np.log(self._knots))
        log_k = np.log(np.where(self._open, k, 1.0))
        self._coefficients = chebyshev.chebfit(t, log_k, t.size - 1)
        slope = chebyshev.chebval(-1.0, chebyshev.chebder(self._coefficients))
        # below the lowest pressure k rises no faster than that of free molecules
        self._slope = np.clip(2 * slope / np.ptp(self._range), -1.0, 0.0)

    def _scaled(self, x: Array) -> Array:
        """ln p from −1 to 1 between the lowest and the highest pressure."""
        return (2 * x - self._range.sum()) / np.ptp(self._range)

    def between(self, first: Array, second: Array, mobility: Mobility) -> Array:
        """Return the mean of each permeability between two pressures > 0, ∫ k dφ/∫ dψ.

        It is exact for piecewise tables and an even mobility. Otherwise Gauss points are dense at the lower pressure.
        """
        a, b = (np.broadcast_to(p, self.shape).ravel() for p in (first, second))
        least, most = np.minimum(a, b), np.maximum(a, b)
        if self._piecewise and mobility.even:
            mean = self._exact_mean(least, most)
        else:
            p = least + (most - least) * (_ROOTS**2)[:, None]
            viscous, own = mobility.at(p)
            weight = _WEIGHTS * _ROOTS
            mean = weight @ (viscous * self._at(p, np.arange(least.size))) / (weight @ own)
        return np.where(self._open, mean, 0.0).reshape(self.shape)

    def _at(self, p: Array, parts: Indices) -> Array:
        """Permeabilities (…, n) of some parts at pressures of each."""
        if self._piecewise:
            after = np.clip(np.searchsorted(self._knots, p), 1, self._knots.size - 1)
            return np.asarray(np.exp(self._between_knots(p, after, parts)[0]))
        x = np.log(p)
        t = self._scaled(np.clip(x, *self._range))
        log_k = chebyshev.chebval(t, self._coefficients[:, parts], tensor=False)
        return np.asarray(np.exp(log_k + self._slope[parts] * np.minimum(x - self._range[0], 0.0)))

    def _between_knots(self, p: Array, after: Any, parts: Indices) -> tuple[Array, Any]:
        """ln k at pressures of some parts between the knot `after` and the one before, constant beyond both.

        Also where it is linear itself, as it is 0 at one of both.
        """
        low, high = self._knots[after - 1], self._knots[after]
        weight = np.clip((p - low) / (high - low), 0.0, 1.0)
        a = self._log_k[after - 1, parts]
        b = self._log_k[after, parts]
        linear = np.isinf(np.minimum(a, b))
        with np.errstate(divide="ignore", invalid="ignore"):
            of_linear = np.log((1 - weight) * np.exp(a) + weight * np.exp(b))
            return np.where(linear, of_linear, a + weight * (b - a)), linear

    def _exact_mean(self, least: Array, most: Array) -> Array:
        """Mean over the pressure, from knot to knot."""
        knots = np.array([-np.inf, *self._knots, np.inf])
        total = np.zeros(least.shape)
        for number, (low, high) in enumerate(pairwise(knots)):
            parts = np.flatnonzero((least < high) & (most > low) & (most > least))
            if not parts.size:
                continue
            after = min(max(number, 1), self._knots.size - 1)
            ends = np.maximum(least[parts], low), np.minimum(most[parts], high)
            (a, linear), (b, _) = (self._between_knots(p, after, parts) for p in ends)
            mean = np.exp(a)
            with np.errstate(divide="ignore", invalid="ignore"):
                mean = np.where(a == b, mean, mean * np.expm1(b - a) / (b - a))
            mean = np.where(linear, (np.exp(a) + np.exp(b)) / 2, mean)
            total[parts] += mean * (ends[1] - ends[0]) / (most - least)[parts]
        same = np.flatnonzero(most == least)
        total[same] = self._at(least[same], same)
        return total


@dataclass(frozen=True, eq=False)
class Mobility:
    """dφ/dp and dψ/dp of a fluid in the viscous potential and in one of its own, `viscous` and `own`, at rising
    pressures [Pa]; straight between them, as a viscous gas is."""

    pressures: Array
    viscous: Array
    own: Array

    @cached_property
    def even(self) -> bool:
        """Whether both are the same at all pressures, as of a liquid of constant viscosity."""
        return bool(np.ptp(self.viscous) + np.ptp(self.own) <= _EVEN * np.abs(self.viscous).max())

    def at(self, p: Array) -> tuple[Array, Array]:
        """Both at pressures."""
        return np.interp(p, self.pressures, self.viscous), np.interp(p, self.pressures, self.own)

"""Tabulate and interpolate a permeability that depends on the fluid pressure.

Examples are the permeability for a rarefied gas, and the permeability of faces that the fluid pressure separates. The
permeability k is computed at a few pressures p, and ln k is interpolated between these pressures. For a rarefied gas,
ln k is a single polynomial in ln p, whose slope is between −1 (free-molecular flow) and 0 (viscous flow). For faces
that the fluid pressure separates, ln k is interpolated linearly between adjacent pressures, because parts of the faces
that are closed at one pressure may open at the next.

The polynomial was tested for the flow of helium through rough gaps of 10 nm to 10 µm. The error of the flow is at most
0.1 % if the polynomial has six Chebyshev points over three decades of pressure, or four points over one decade. Between
parallel plates, the error is at most 0.5 %. It is larger than for rough gaps because the small jumps of Q(D) (see
`flow.law.flow_rate`) are not averaged over different gaps.
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

#: Smallest tabulated pressure as a fraction of the highest one. Hardly any of the potential drop lies below it.
_LEAST_FRACTION = 1e-3
#: `_FEW` pressures are tabulated if the ratio of the highest to the lowest pressure is at most `_ONE_DECADE`; otherwise
#: `_MANY` pressures are tabulated.
_ONE_DECADE, _FEW, _MANY = 12.0, 4, 6
#: Gauss points and weights for a mean over the pressures from p0 to p1. The integration variable is √((p − p0)/(p1 −
#: p0)), so that the points are dense near p0. `_ROOTS` are the values of this variable at the Gauss points.
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_ROOTS = 0.5 * (1 + _POINTS)
#: A mobility counts as constant if its relative variation is at most this number.
_LEAST_VARIATION = 1e-9


def table_pressures(inlet: float, outlet: float) -> Array:
    """Choose the pressures [Pa] at which the permeability for a gas is computed, from the highest to the lowest.

    The pressures are the Chebyshev extrema in ln p between the inlet pressure and the outlet pressure. Four pressures
    are chosen if the inlet and outlet pressures differ by a factor of at most 12, and six otherwise. Pressures below
    1e-3 of the highest pressure are not tabulated.
    """
    high = max(inlet, outlet)
    low = max(min(inlet, outlet), _LEAST_FRACTION * high)
    if not low > 0:
        raise InputError(
            "pressure", f"{inlet:g} and {outlet:g} Pa", "at least one pressure > 0 [Pa]"
        )
    if high == low:
        low = high / 1.01
    count = _FEW if high / low <= _ONE_DECADE else _MANY
    x = np.cos(np.pi * np.arange(count) / (count - 1))  # from 1 to −1
    middle = 0.5 * (np.log(high) + np.log(low))
    half_range = 0.5 * (np.log(high) - np.log(low))
    return np.exp(middle + half_range * x)


@dataclass(frozen=True, eq=False)
class PermeabilityTable:
    """Permeability of a seal, or of each of its elements, at several fluid pressures.

    Parameters
    ----------
    pressures : m different pressures [Pa], such as those of `table_pressures`. All pressures must be > 0, or >= 0 if
        `piecewise` is true.
    values : array of permeabilities [m³], whose first axis has m entries, one for each pressure. The permeability at
        one pressure is a number or an array that `seal_leakage` accepts, but not an array of tensors. Possible shapes
        of `values` are, for example, (m,), (m, n_elements) and (m, n_elements, 2).
    piecewise : whether to interpolate linearly between adjacent pressures. If `piecewise` is false, ln k is a single
        polynomial in ln p; an element that is closed at one of the pressures counts as closed at all pressures. If
        `piecewise` is true, ln k is linear between adjacent pressures. If an element is closed at only one of two
        adjacent pressures, k itself is linear between these pressures.

    Raises
    ------
    InputError : two pressures are equal, or a pressure is not in the allowed range; a permeability is negative or
        undefined; or the first axis of `values` does not have m entries.

    Examples
    --------
    For helium that flows from 10 bar to 1 bar through gaps of 100 nm, the flow is 4.0 times the viscous flow.

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
                "values", "arrays of different shapes, or values that are not numbers", expected
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
        """Median of the tabulated pressures [Pa], and median permeability [m³] of the open elements at this pressure.

        If all elements are closed at the median pressure, the permeability is 0.
        """
        middle = int(np.argsort(self.pressures)[len(self.pressures) // 2])
        k = self.values[middle]
        is_open = k > 0
        permeability = float(np.median(k[is_open])) if is_open.any() else 0.0
        return self.pressures[middle], permeability


def tabulate(
    pressures: Sequence[float] | Array, values: Sequence[Any], piecewise: bool = False
) -> Any:
    """Make a table of the permeabilities at several pressures; for a single pressure, return its permeability."""
    if len(values) == 1:
        return values[0]
    return PermeabilityTable(tuple(pressures), np.array(values), piecewise)


class PressureCurve:
    """Permeability of each element of a seal as a continuous function of the fluid pressure.

    The docstring of `PermeabilityTable` describes the interpolation between the tabulated pressures.

    Parameters
    ----------
    pressures : m different pressures [Pa].
    values : array (m, …), permeability of each element at each of the m pressures [m³].
    piecewise : see `PermeabilityTable`.
    """

    def __init__(self, pressures: ArrayLike, values: Array, piecewise: bool = False) -> None:
        """Sort the pressures, and prepare the interpolation."""
        order = np.argsort(pressures)
        self._knots = np.asarray(pressures, dtype=float)[order]
        self._piecewise = piecewise
        self.shape = values.shape[1:]
        k = values[order].reshape(order.size, -1)  # (pressure, element)
        if piecewise:
            self._store_logarithms(k)
        else:
            self._fit_polynomials(k)

    def _store_logarithms(self, k: Array) -> None:
        """Store ln k for the linear interpolation between adjacent pressures.

        k : array (pressure, element), permeability [m³].
        """
        with np.errstate(divide="ignore"):
            self._log_k = np.log(k)
        self._is_open = (k > 0).any(axis=0)

    def _fit_polynomials(self, k: Array) -> None:
        """Compute the coefficients of the polynomial of ln k in ln p for each element.

        k : array (pressure, element), permeability [m³].
        """
        self._is_open = (k > 0).all(axis=0)
        self._range = np.log(self._knots[[0, -1]])
        t = self._scaled(np.log(self._knots))
        log_k = np.log(np.where(self._is_open, k, 1.0))
        self._coefficients = chebyshev.chebfit(t, log_k, t.size - 1)
        slope = chebyshev.chebval(-1.0, chebyshev.chebder(self._coefficients))  # d ln k/dt
        # Below the lowest tabulated pressure, ln k is continued with the slope d ln k/d ln p at this pressure, limited
        # to the range from −1 (free-molecular flow) to 0 (viscous flow). The factor 2/ptp is dt/d ln p, because t runs
        # from −1 to 1 over the range of ln p.
        self._slope = np.clip(2 * slope / np.ptp(self._range), -1.0, 0.0)

    def _scaled(self, x: Array) -> Array:
        """Map x = ln p linearly to the range from −1 (lowest pressure) to 1 (highest pressure)."""
        return (2 * x - self._range.sum()) / np.ptp(self._range)

    def mean_between(self, first: Array, second: Array, mobility: Mobility) -> Array:
        """Compute the mean permeability ∫ k dφ/∫ dψ of each element between two positive pressures.

        If `piecewise` is true and the mobility is constant, the integrals are computed exactly. In all other cases
        the integrals are computed by Gauss quadrature.

        Parameters
        ----------
        first, second : first pressure and second pressure of each element [Pa]; numbers, or arrays that can be
            broadcast to the shape of the elements.
        mobility : derivatives of the potentials φ and ψ with respect to the pressure.
        """
        a, b = (np.broadcast_to(p, self.shape).ravel() for p in (first, second))
        low, high = np.minimum(a, b), np.maximum(a, b)
        if self._piecewise and mobility.is_constant:
            mean = self._exact_mean(low, high)
        else:
            # With the substitution p = low + (high − low) t², dp is proportional to t dt. The constant factor of dp
            # cancels in the ratio of the two integrals over t from 0 to 1, which are sums over the Gauss points t.
            p = low + (high - low) * (_ROOTS**2)[:, None]  # (Gauss point, element)
            viscous, reference = mobility.at(p)
            k = self._evaluate(p, np.arange(low.size))
            weight = _WEIGHTS * _ROOTS
            mean = np.asarray(weight @ (viscous * k) / (weight @ reference))
        return np.where(self._is_open, mean, 0.0).reshape(self.shape)

    def _evaluate(self, p: Array, elements: Indices) -> Array:
        """Compute the permeabilities of some elements, each at given pressures.

        p : array (…, n), pressures for each of the n elements [Pa].
        elements : array (n,), numbers of the elements.
        """
        if self._piecewise:
            upper = np.clip(np.searchsorted(self._knots, p), 1, self._knots.size - 1)
            interpolated, _ = self._between_knots(p, upper, elements)
            return np.asarray(np.exp(interpolated))
        x = np.log(p)
        t = self._scaled(np.clip(x, *self._range))
        log_k = np.asarray(chebyshev.chebval(t, self._coefficients[:, elements], tensor=False))
        # the distance from the table to lower pressures; it is 0 within the table
        below_range = np.minimum(x - self._range[0], 0.0)
        return np.asarray(np.exp(log_k + self._slope[elements] * below_range))

    def _between_knots(self, p: Array, upper: Any, elements: Indices) -> tuple[Array, Any]:
        """Interpolate ln k of some elements between two adjacent tabulated pressures p0 < p1.

        Below p0 and above p1, ln k is constant. If an element is closed at only one of p0 and p1, the permeability k
        itself is interpolated linearly.

        p : pressures at which ln k is interpolated [Pa].
        upper : index of p1 among the tabulated pressures.
        elements : numbers of the elements.

        Returns
        -------
        Array of ln k, and flags of the elements in which the permeability is interpolated linearly.
        """
        low, high = self._knots[upper - 1], self._knots[upper]
        weight = np.clip((p - low) / (high - low), 0.0, 1.0)
        a = self._log_k[upper - 1, elements]
        b = self._log_k[upper, elements]
        is_linear = np.isinf(np.minimum(a, b))  # ln k is −∞ where the element is closed
        with np.errstate(divide="ignore", invalid="ignore"):
            log_of_linear = np.log((1 - weight) * np.exp(a) + weight * np.exp(b))
            return np.where(is_linear, log_of_linear, a + weight * (b - a)), is_linear

    def _exact_mean(self, low: Array, high: Array) -> Array:
        """Compute the mean permeability of each element over the pressures from `low` to `high`.

        The integrals over the intervals between adjacent tabulated pressures are computed exactly, and added up.
        """
        # the first and the last interval, outside the tabulated pressures, are unbounded
        knots = np.array([-np.inf, *self._knots, np.inf])
        total = np.zeros(low.shape)
        for interval, (interval_start, interval_end) in enumerate(pairwise(knots)):
            # elements whose range of pressures overlaps with this interval
            is_inside = (low < interval_end) & (high > interval_start) & (high > low)
            elements = np.flatnonzero(is_inside)
            if not elements.size:
                continue
            # index of the tabulated pressure at the end of the interval; for an unbounded interval, index of the
            # pressure at the end of the nearest bounded interval
            upper = min(max(interval, 1), self._knots.size - 1)
            start = np.maximum(low[elements], interval_start)
            end = np.minimum(high[elements], interval_end)
            a, is_linear = self._between_knots(start, upper, elements)
            b, _ = self._between_knots(end, upper, elements)
            # If ln k is linear from a to b, the mean of k is e^a (e^(b − a) − 1)/(b − a). If k is linear, the mean of k
            # is (e^a + e^b)/2.
            mean = np.exp(a)
            with np.errstate(divide="ignore", invalid="ignore"):
                mean = np.where(a == b, mean, mean * np.expm1(b - a) / (b - a))
            mean = np.where(is_linear, (np.exp(a) + np.exp(b)) / 2, mean)
            total[elements] += mean * (end - start) / (high - low)[elements]
        without_range = np.flatnonzero(high == low)
        total[without_range] = self._evaluate(low[without_range], without_range)
        return total


@dataclass(frozen=True, eq=False)
class Mobility:
    """Derivatives of two pressure potentials of a fluid with respect to the pressure, at tabulated pressures.

    Between the tabulated pressures, the derivatives are interpolated linearly, which is exact for a viscous gas.

    Attributes
    ----------
    pressures : increasing pressures [Pa].
    viscous : derivative dφ/dp of the viscous potential φ at each of the pressures.
    reference : derivative dψ/dp of the potential ψ of the reference gap at each of the pressures, see
        `flow.pressure_drop`.
    """

    pressures: Array
    viscous: Array
    reference: Array

    @cached_property
    def is_constant(self) -> bool:
        """Whether dφ/dp and dψ/dp are constant, as for a liquid of constant viscosity."""
        variation = np.ptp(self.viscous) + np.ptp(self.reference)
        return bool(variation <= _LEAST_VARIATION * np.abs(self.viscous).max())

    def at(self, p: Array) -> tuple[Array, Array]:
        """Interpolate dφ/dp and dψ/dp at pressures p [Pa]."""
        viscous = np.interp(p, self.pressures, self.viscous)
        return viscous, np.interp(p, self.pressures, self.reference)

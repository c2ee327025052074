"""Interpolate the permeability of a cell at any pressure of any load cycle between tabulated pressures.

ln k is interpolated monotonically (PCHIP; Fritsch & Carlson, SIAM J. Numer. Anal. 17, 1980, 238) over the cube root of
the pressure, because it is a nearly linear function of it from first touch to closing. Unloading curves are
interpolated between tabulated peaks at equal fractions of the reopening pressure, so that each unloading curve begins
on the loading curve. Below the lowest peak they tend to the loading curve, as without plastic deformation.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.interpolate import PchipInterpolator

from ..base import Array, Indices
from ..loads import LoadProgramme


class LogCurve:
    """Interpolated ln k as a function of an increasing x.

    The curve ends at `end`, in the middle between the last open and the first closed point.
    """

    def __init__(self, x: Array, k: Array) -> None:
        """Interpolate values k (n,) at increasing x (n,) up to the first point at which k is 0."""
        n_open = int(np.argmin(np.append(k > 0, False)))
        # mean of the last open and the first closed point; infinite if there is no such point
        self.end = float(np.r_[-np.inf, x, np.inf][n_open : n_open + 2].mean())
        self._x, self._log_k = x[:n_open], np.log(k[:n_open])
        self._inner = PchipInterpolator(self._x, self._log_k) if n_open > 1 else None

    def __call__(self, x: Array) -> Array:
        """Evaluate ln k at x, which is −inf if the cell is closed.

        Below the first point the curve is constant. Beyond the last open point it is continued linearly up to its end.
        """
        x = np.asarray(x, float)
        if not self._x.size:
            return np.full(x.shape, -np.inf)
        if self._inner is None:
            return np.where(x <= self.end, self._log_k[0], -np.inf)
        slope = min(0.0, float(np.diff(self._log_k[-2:])[0] / np.diff(self._x[-2:])[0]))
        beyond = np.maximum(x - self._x[-1], 0.0) if np.isfinite(self.end) else 0.0
        value = self._inner(np.clip(x, self._x[0], self._x[-1])) + slope * beyond
        return np.where(x <= self.end, value, -np.inf)


class CellCurves:
    """Permeability of a cell along one axis, on loading and on unloading from any peak.

    Parameters
    ----------
    steps : LoadProgramme
        Tabulated pressures. All unloadings have steps at the same fractions of their peaks.
    k : array, (steps,)
        Permeability at each tabulated pressure [m³]. States with NaN are omitted from the curves. Without any known
        state on loading or on unloading, the permeability there is NaN.
    """

    def __init__(self, steps: LoadProgramme, k: Array) -> None:
        """Divide the tabulated states into a loading curve and one unloading curve for each peak."""
        known = np.isfinite(k)
        on_loading = steps.on_loading & known
        self._pressure, self._k = steps.pressures[on_loading], k[on_loading]
        peaks = []
        self._unloading = []
        for branch in steps.branches[1:]:
            down = branch[known[branch]][::-1]  # from low to high pressure
            peak = steps[branch[0]].unloaded_from
            if down.size and on_loading.any():
                fractions = np.append(steps.pressures[down] / peak, 1.0)
                at_peak = self.k_on_loading(np.array(peak))
                self._unloading.append(LogCurve(fractions, np.append(k[down], at_peak)))
                peaks.append(peak)
        self._peaks = np.array(peaks)
        self._unloads = bool(steps.unload_from)

    @cached_property
    def loading(self) -> LogCurve:
        """ln k as a function of the cube root of the pressure on loading."""
        return LogCurve(np.cbrt(self._pressure), self._k)

    def k_on_loading(self, pressure: Array) -> Array:
        """Evaluate k on loading [m³]."""
        if not self._k.size:
            return np.full(np.shape(pressure), np.nan)
        return np.exp(self.loading(np.cbrt(pressure)))

    def k_on_unloading(self, pressure: Array, peak: Array) -> Array:
        """Evaluate the permeability k during unloading from given peaks to given lower pressures, all > 0 [Pa].

        The result is interpolated between the tabulated peaks below and above each peak. It lies between the value at
        the peak and the loading curve.

        Parameters
        ----------
        pressure, peak : arrays, (n,)
            Pressures on unloading, and the peaks from which the cell is unloaded [Pa].

        Returns
        -------
        array, (n,)
            Permeability [m³].
        """
        if not self._peaks.size:
            return (
                np.full(np.shape(pressure), np.nan)
                if self._unloads
                else self.k_on_loading(pressure)
            )
        fraction = np.clip(pressure / peak, 0.0, 1.0)
        # knot 0 is the loading curve, knot m the m-th tabulated peak; interpolate between `upper` − 1 and `upper`
        knots = np.r_[0.0, self._peaks]
        upper = np.clip(np.searchsorted(knots, peak), 1, knots.size - 1)
        # a peak below the closing pressure leaves the cell open; above it the reopening fraction falls from 1
        closing = max(self.loading.end, 0.0) ** 3
        above = self._peaks > closing
        opens = np.array([_reopening(curve) for curve in self._unloading])
        reopening = np.interp(peak, np.r_[closing, self._peaks[above]], np.r_[1.0, opens[above]])
        relative = np.divide(
            fraction, reopening, out=np.full(fraction.shape, np.inf), where=reopening > 0
        )
        x = np.cbrt(knots)
        weight = np.clip((np.cbrt(peak) - x[upper - 1]) / (x[upper] - x[upper - 1]), 0, 1)
        inside = np.clip(relative, 0, 1)  # pressure over the reopening pressure

        def interpolate(relative_pressure: Array) -> Array:
            below = self._at(upper - 1, relative_pressure, peak)
            above = self._at(upper, relative_pressure, peak)
            return _between(weight, below, above)

        value = interpolate(inside)
        top = interpolate(np.ones_like(inside))  # at the reopening pressure
        released = interpolate(np.zeros_like(inside))  # without pressure
        ceiling = self.loading(np.cbrt(pressure))
        floor = self.loading(np.cbrt(peak))
        # If the cell is open at its peak, the unloading curve must begin at k on loading. The interpolated curve misses
        # this value by `missed`. The correction decreases to 0 as the cell is released; between the loading curve and
        # the lowest peak it is constant.
        is_open = np.isfinite(floor) & np.isfinite(top)
        missed = floor[is_open] - top[is_open]
        rise = value[is_open] - top[is_open]
        total_rise = np.maximum(released[is_open] - top[is_open], missed)
        has_rise = (total_rise > 0) & (upper[is_open] > 1)
        released_part = np.divide(rise, total_rise, out=np.zeros_like(rise), where=has_rise)
        value[is_open] += missed * (1 - released_part)
        value = np.clip(value, np.minimum(floor, ceiling), ceiling)
        return np.where((relative <= 1) & np.isfinite(ceiling), np.exp(value), 0.0)

    def _at(self, knot: Indices, inside: Array, peak: Array) -> Array:
        """Evaluate ln k (n,) on the curve of each knot (n,), at fractions `inside` (n,) of its reopening pressure.

        Knot 0 is the loading curve, for which the smaller one of the peak and the closing pressure is taken.
        """
        log_k = self.loading(
            np.cbrt(inside) * np.minimum(np.cbrt(peak), max(self.loading.end, 0.0))
        )
        for number, curve in enumerate(self._unloading, start=1):
            is_on_curve = knot == number
            if is_on_curve.any():
                log_k[is_on_curve] = curve(inside[is_on_curve] * _reopening(curve))
        return log_k

    def k_on_paths(self, paths: Array, steps: LoadProgramme) -> Array:
        """Evaluate k (steps, paths) [m³] for load paths, which are pressures of the cell at each step [Pa]."""
        peak = local_peaks(paths, steps)
        # at its own peak a cell is on the loading curve, even where the seal is being unloaded
        down = paths < peak
        k = self.k_on_loading(np.maximum(paths, 0.0))
        k[down] = self.k_on_unloading(np.maximum(paths[down], 0.0), peak[down])
        return k


def _reopening(unloading: LogCurve) -> float:
    """Return the reopening pressure of a cell on unloading as a fraction of the peak; 0 if it stays closed."""
    return min(max(unloading.end, 0.0), 1.0)


def _between(weight: Array, a: Array, b: Array) -> Array:
    """Interpolate ln k linearly, (1 − weight) a + weight b. If one value is −inf (closed), return the other one."""
    closed_a = np.isneginf(a)
    closed_b = np.isneginf(b)
    weight = np.where(closed_a, 1.0, np.where(closed_b, 0.0, weight))
    mean = (1 - weight) * np.where(closed_a, 0.0, a) + weight * np.where(closed_b, 0.0, b)
    return np.where(closed_a & closed_b, -np.inf, mean)


def local_peaks(paths: Array, steps: LoadProgramme) -> Array:
    """Return the highest pressure that a cell has had at or before each step (steps, paths) [Pa].

    The history of an unloading step is the loading up to its peak and the unloading from there. A cell can have its
    highest pressure at another step than the seal, if its pressure decreases while that of the seal increases.
    """
    highest = paths.copy()
    for branch in steps.branches:
        # for unloading, begin with the step at the peak
        history = np.union1d(branch, steps.peak_indices[branch])
        highest[history] = np.maximum.accumulate(highest[history], axis=0)
    return highest

"""Interpolate the permeability of a cell between tabulated pressures, on loading and on unloading.

From first contact to closing, ln k is a nearly linear function of the cube root of the pressure. ln k is therefore
interpolated monotonically over the cube root of the pressure (PCHIP; Fritsch & Carlson, SIAM J. Numer. Anal. 17, 1980,
238). The peak is the pressure at which an unloading begins. The reopening pressure is the pressure at which a closed
cell opens again on unloading. The unloading curve of a peak is interpolated between those of the two nearest tabulated
peaks, at equal fractions of the reopening pressures. The interpolated unloading curve is corrected so that it begins on
the loading curve. For a peak below all tabulated peaks, the unloading curve is interpolated between the loading curve
and the unloading curve of the lowest one.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from ..base import Array, Flags, Indices
from ..loads import LoadProgramme


class LogCurve:
    """Interpolate ln k of a cell that is open at small x and closed at large x.

    Attributes
    ----------
    end : float
        Value of x at which the cell closes, midway between the last open point and the first closed point. If the cell
        is open at all points, `end` is inf; if the cell is closed at all points, `end` is −inf.
    """

    def __init__(self, x: Array, k: Array) -> None:
        """Interpolate values k (n,) at increasing x (n,) up to the first point at which k is 0."""
        # False is appended as a closed point after the last point. argmin returns the index of the first closed point,
        # which is the number of open points before the first closed point.
        n_open = int(np.argmin(np.append(k > 0, False)))
        if n_open == 0:
            self.end = -np.inf
        elif n_open == x.size:
            self.end = np.inf
        else:
            self.end = float(x[n_open - 1] + x[n_open]) / 2
        self._x = x[:n_open]
        self._log_k = np.log(k[:n_open])
        #: Interpolation between the open points; None if there are fewer than two open points.
        self._inner = PchipInterpolator(self._x, self._log_k) if n_open > 1 else None

    def __call__(self, x: Array) -> Array:
        """Evaluate ln k at x. For x > `end`, the cell is closed, and ln k is −inf.

        Below the first point, ln k is constant. Between the last open point and `end`, ln k is continued linearly.
        """
        x = np.asarray(x, float)
        if not self._x.size:
            return np.full(x.shape, -np.inf)
        if self._inner is None:  # a single open point
            return np.where(x <= self.end, self._log_k[0], -np.inf)
        # slope between the last two open points; after the last open point the permeability must not rise
        last_slope = float(np.diff(self._log_k[-2:])[0] / np.diff(self._x[-2:])[0])
        slope = min(0.0, last_slope)
        # distance from the last open point; a cell that is open at all points stays as open as at the last point
        beyond = np.maximum(x - self._x[-1], 0.0) if np.isfinite(self.end) else 0.0
        value = self._inner(np.clip(x, self._x[0], self._x[-1])) + slope * beyond
        return np.where(x <= self.end, value, -np.inf)


class _Knots(NamedTuple):
    """The two knots between which an unloading curve is interpolated, for each of n peaks.

    Knot 0 is the loading curve, and knot m the unloading curve from the m-th tabulated peak.

    upper : array (n,), number of the upper knot; the lower knot is `upper` − 1.
    weight : array (n,), weight of the upper knot.
    """

    upper: Indices
    weight: Array


class CellCurves:
    """Evaluate the permeability of a cell along one axis, on loading and on unloading from any peak pressure.

    Parameters
    ----------
    steps : LoadProgramme
        Load programme of the tabulated pressures. All unloadings have pressures at the same fractions of the peak.
    k : array, (steps,)
        Permeability at each tabulated pressure [m³]. States whose permeability is NaN are left out. If all states on
        loading are NaN, `k_on_loading` returns NaN. If all states on unloading are NaN, `k_on_unloading` returns NaN.
    """

    def __init__(self, steps: LoadProgramme, k: Array) -> None:
        """Divide the tabulated states into a loading curve and an unloading curve for each peak."""
        known = np.isfinite(k)
        on_loading = steps.on_loading & known
        self._pressure, self._k = steps.pressures[on_loading], k[on_loading]
        peaks = []
        self._unloading = []
        # branch 0 is the loading; each other branch contains the steps of an unloading, from high to low pressure
        for unloading in steps.branches[1:]:
            peak = steps[unloading[0]].unloaded_from
            known_steps = unloading[known[unloading]]
            if not known_steps.size or not on_loading.any():
                continue
            rising = known_steps[::-1]  # from low to high pressure
            # The unloading curve is a function of the pressure as a fraction of the peak. At the peak itself (fraction
            # 1), the permeability is equal to the permeability on loading.
            fractions = np.append(steps.pressures[rising] / peak, 1.0)
            at_peak = self.k_on_loading(np.array(peak))
            self._unloading.append(LogCurve(fractions, np.append(k[rising], at_peak)))
            peaks.append(peak)
        self._peaks = np.array(peaks)
        self._has_unloadings = bool(steps.unload_from)

    @cached_property
    def loading(self) -> LogCurve:
        """Loading curve of the cell: ln k as a function of the cube root of the pressure."""
        return LogCurve(np.cbrt(self._pressure), self._k)

    def k_on_loading(self, pressure: Array) -> Array:
        """Evaluate the permeability k on loading [m³] at given pressures [Pa]."""
        if not self._k.size:
            return np.full(np.shape(pressure), np.nan)
        return np.exp(self.loading(np.cbrt(pressure)))

    def k_on_unloading(self, pressure: Array, peak: Array) -> Array:
        """Evaluate the permeability k at given pressures during unloading from given peaks, all > 0 [Pa].

        The permeability is interpolated between the unloading curves of the tabulated peaks below and above each given
        peak. The interpolated permeability is kept between the permeability at the peak and the permeability on loading
        at the same pressure.

        Parameters
        ----------
        pressure, peak : arrays, (n,)
            Pressures during unloading, and peak pressures from which the cell is unloaded [Pa].

        Returns
        -------
        array, (n,)
            Permeability [m³].
        """
        if not self._peaks.size:
            if self._has_unloadings:
                return np.full(np.shape(pressure), np.nan)
            return self.k_on_loading(pressure)
        reopening = self._reopening_fractions(peak)
        # pressure as a fraction of the reopening pressure; above 1 the cell is still closed
        fraction_of_peak = np.clip(pressure / peak, 0.0, 1.0)
        relative = np.full(fraction_of_peak.shape, np.inf)
        np.divide(fraction_of_peak, reopening, out=relative, where=reopening > 0)
        knots = self._knots_around(peak)
        inside = np.clip(relative, 0, 1)
        at_peak = self.loading(np.cbrt(peak))
        log_k = _corrected_to_peak(
            self._log_k_between(knots, inside, peak),
            at_peak=at_peak,
            at_reopening=self._log_k_between(knots, np.ones_like(inside), peak),
            without_pressure=self._log_k_between(knots, np.zeros_like(inside), peak),
            # below the lowest tabulated peak, the correction is the same at all pressures
            decreases=knots.upper > 1,
        )
        # limits of ln k: its values at the peak and, at the same pressure, on loading
        on_loading = self.loading(np.cbrt(pressure))
        log_k = np.clip(log_k, np.minimum(at_peak, on_loading), on_loading)
        return np.where((relative <= 1) & np.isfinite(on_loading), np.exp(log_k), 0.0)

    def _reopening_fractions(self, peak: Array) -> Array:
        """Interpolate the reopening pressure as a fraction of the peak pressure, for peaks (n,) [Pa].

        Unloaded from a peak below the closing pressure, the cell is always open, and the fraction is 1. For higher
        peaks, the fraction decreases from 1.
        """
        closing = max(self.loading.end, 0.0) ** 3
        is_above = self._peaks > closing
        tabulated = np.array([_reopening_fraction(curve) for curve in self._unloading])
        fractions = np.r_[1.0, tabulated[is_above]]
        return np.interp(peak, np.r_[closing, self._peaks[is_above]], fractions)

    def _knots_around(self, peak: Array) -> _Knots:
        """Find the knots below and above each of the given peaks (n,) [Pa], and the weight of the upper one."""
        pressures = np.r_[0.0, self._peaks]
        upper = np.clip(np.searchsorted(pressures, peak), 1, pressures.size - 1)
        x = np.cbrt(pressures)
        weight = np.clip((np.cbrt(peak) - x[upper - 1]) / (x[upper] - x[upper - 1]), 0, 1)
        return _Knots(upper, weight)

    def _log_k_between(self, knots: _Knots, relative: Array, peak: Array) -> Array:
        """Interpolate ln k between the curves of two neighbouring knots.

        relative, peak : as in `_log_k_at_knots`.
        """
        below = self._log_k_at_knots(knots.upper - 1, relative, peak)
        above = self._log_k_at_knots(knots.upper, relative, peak)
        return _interpolate_log_k(knots.weight, below, above)

    def _log_k_at_knots(self, knot: Indices, relative: Array, peak: Array) -> Array:
        """Evaluate ln k at n points, each on the curve of a given knot.

        Knot 0 is the loading curve, and knot m the unloading curve from the m-th tabulated peak.

        knot : array (n,), number of the knot on whose curve each point lies.
        relative : array (n,), pressure of each point as a fraction of the reopening pressure of the curve. For the
            loading curve, the pressure is given as a fraction of the peak pressure or of the closing pressure of the
            cell, whichever is lower.
        peak : array (n,), peak pressure from which the cell is unloaded at each point [Pa].
        """
        # the loading curve is a function of the cube root of the pressure, and ends at the root of the closing pressure
        root_of_closing = max(self.loading.end, 0.0)
        root_of_reference = np.minimum(np.cbrt(peak), root_of_closing)
        log_k = self.loading(np.cbrt(relative) * root_of_reference)  # replaced at all other knots
        for number, curve in enumerate(self._unloading, start=1):
            is_on_curve = knot == number
            if is_on_curve.any():
                fraction_of_peak = relative[is_on_curve] * _reopening_fraction(curve)
                log_k[is_on_curve] = curve(fraction_of_peak)
        return log_k

    def k_on_paths(self, paths: Array, steps: LoadProgramme) -> Array:
        """Evaluate the permeability k (steps, paths) [m³] of the cell on several pressure paths.

        paths : array (steps, paths), contact pressure of the cell at each step of each path [Pa].
        """
        peak = local_peaks(paths, steps)
        # a cell at its highest pressure is on the loading curve, even while the seal is being unloaded
        down = paths < peak
        k = self.k_on_loading(np.maximum(paths, 0.0))
        k[down] = self.k_on_unloading(np.maximum(paths[down], 0.0), peak[down])
        return k


def _reopening_fraction(unloading: LogCurve) -> float:
    """Return the ratio of the reopening pressure of a cell to the peak pressure; 0 if the cell stays closed."""
    return min(max(unloading.end, 0.0), 1.0)


def _corrected_to_peak(
    log_k: Array, *, at_peak: Array, at_reopening: Array, without_pressure: Array, decreases: Flags
) -> Array:
    """Correct interpolated values of ln k, so that the unloading curve begins at its peak on the loading curve.

    A cell that is open at its peak is unloaded from `at_peak`, but the interpolated curve begins at `at_reopening`. The
    difference is added to the interpolated curve. All arrays have the shape (n,).

    log_k : ln k on the interpolated unloading curve.
    at_peak : ln k on the loading curve at the peak; −inf if the cell is closed there.
    at_reopening, without_pressure : ln k at the two ends of the interpolated unloading curve.
    decreases : whether the correction decreases to 0 as the cell is released. Otherwise it is constant.
    """
    is_open = np.isfinite(at_peak) & np.isfinite(at_reopening)
    difference = at_peak[is_open] - at_reopening[is_open]
    rise = log_k[is_open] - at_reopening[is_open]
    total_rise = np.maximum(without_pressure[is_open] - at_reopening[is_open], difference)
    has_rise = (total_rise > 0) & decreases[is_open]
    released_part = np.divide(rise, total_rise, out=np.zeros_like(rise), where=has_rise)
    corrected = log_k.copy()
    corrected[is_open] += difference * (1 - released_part)
    return corrected


def _interpolate_log_k(weight: Array, a: Array, b: Array) -> Array:
    """Interpolate ln k linearly between the values a and b: (1 − weight) a + weight b.

    If one of the two values is −inf, because the cell is closed, the finite value is returned.
    """
    closed_a = np.isneginf(a)
    closed_b = np.isneginf(b)
    # where one value is −inf, the finite value gets the whole weight
    weight = np.where(closed_b, 0.0, weight)
    weight = np.where(closed_a, 1.0, weight)
    # −inf is replaced by 0, because 0 · (−inf) is NaN
    finite_a = np.where(closed_a, 0.0, a)
    finite_b = np.where(closed_b, 0.0, b)
    mean = (1 - weight) * finite_a + weight * finite_b
    return np.where(closed_a & closed_b, -np.inf, mean)


def local_peaks(paths: Array, steps: LoadProgramme) -> Array:
    """Return the highest pressure of a cell up to each step, on each pressure path: array (steps, paths) [Pa].

    The history of an unloading step consists of loading up to the peak load and unloading from there to the step. The
    contact pressure of a single cell may decrease while the pressure of the seal increases. A cell may therefore have
    its highest pressure at a different step from the seal.
    """
    highest = paths.copy()
    for branch in steps.branches:
        # Indices of the steps of the branch, in their order. An unloading is preceded by the loading step at the peak
        # load, whose value in `highest` already contains the history of the loading.
        history = np.union1d(branch, steps.peak_indices[branch])
        highest[history] = np.maximum.accumulate(highest[history], axis=0)
    return highest

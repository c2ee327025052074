"""Interpolate the permeability of a cell at any pressure of any load cycle between tabulated pressures.

ln k is interpolated monotonically (PCHIP; Fritsch & Carlson, SIAM J. Numer. Anal. 17, 1980, 238) in the cube root of
the pressure, in which it is nearly straight from first touch to closing. Unloading curves are interpolated between the
tabulated peaks, at equal fractions of the pressure at which the cell opens again, so that every unloading curve starts
on the loading curve. Below the lowest peak it tends to the loading curve, as without yielding.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.interpolate import PchipInterpolator

from ..base import Array, Indices
from ..loads import LoadProgramme


class LogCurve:
    """ln k as a function of a rising x.

    Where k falls to 0 the curve ends, halfway between the open and the closed state.
    """

    def __init__(self, x: Array, k: Array) -> None:
        """Take values k at rising x; the curve ends where k is 0 for the first time."""
        n_open = int(np.argmin(np.append(k > 0, False)))
        self.end = float(np.r_[-np.inf, x, np.inf][n_open : n_open + 2].mean())
        self._x, self._log_k = x[:n_open], np.log(k[:n_open])
        self._inner = PchipInterpolator(self._x, self._log_k) if n_open > 1 else None

    def __call__(self, x: Array) -> Array:
        """Evaluate ln k at x; it is −inf where the cell is closed.

        Below the first point the curve is constant. Beyond the last open point it keeps its last slope until it ends.
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
    steps : tabulated pressures, whose unloadings stop at equal fractions of their peaks.
    k : at every tabulated pressure, array (steps,), m³. Where it is NaN, the curves are interpolated from the states
        beside it. Without any state on loading, or on unloading where there should be some, k is NaN there.
    """

    def __init__(self, steps: LoadProgramme, k: Array) -> None:
        """Sort the tabulated states into curves."""
        known = np.isfinite(k)
        on_loading = steps.on_loading & known
        self._pressure, self._k = steps.pressures[on_loading], k[on_loading]
        peaks = []
        self._unloading = []
        for branch in steps.branches[1:]:
            down = branch[known[branch]][::-1]
            peak = steps[branch[0]].unloaded_from
            if down.size and on_loading.any():
                fractions = np.append(steps.pressures[down] / peak, 1.0)
                at_peak = self.loaded(np.array(peak))
                self._unloading.append(LogCurve(fractions, np.append(k[down], at_peak)))
                peaks.append(peak)
        self._peaks = np.array(peaks)
        self._unloads = bool(steps.unload_from)

    @cached_property
    def loading(self) -> LogCurve:
        """ln k as a function of the cube root of the pressure on loading."""
        return LogCurve(np.cbrt(self._pressure), self._k)

    def loaded(self, pressure: Array) -> Array:
        """Evaluate k on loading [m³]."""
        if not self._k.size:
            return np.full(np.shape(pressure), np.nan)
        return np.exp(self.loading(np.cbrt(pressure)))

    def unloaded(self, pressure: Array, peak: Array) -> Array:
        """Evaluate k on unloading from any peaks to any pressures below them, both above 0 [m³]."""
        if not self._peaks.size:
            return np.full(np.shape(pressure), np.nan) if self._unloads else self.loaded(pressure)
        fraction = np.clip(pressure / peak, 0.0, 1.0)
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
        inside = np.clip(relative, 0, 1)
        value, top, released = (
            _between(weight, self._at(upper - 1, at, peak), self._at(upper, at, peak))
            for at in (inside, np.ones_like(inside), np.zeros_like(inside))
        )
        ceiling = self.loading(np.cbrt(pressure))
        floor = self.loading(np.cbrt(peak))
        # From a peak at which the cell is open, k starts at its value on loading. The mean of two tabulated peaks
        # misses this value, less so the more the cell has been released; below all peaks it misses by the same
        # everywhere.
        is_open = np.isfinite(floor) & np.isfinite(top)
        missed = floor[is_open] - top[is_open]
        mean = value[is_open] - top[is_open]
        whole = np.maximum(released[is_open] - top[is_open], missed)
        left = 1 - np.divide(
            mean, whole, out=np.zeros_like(mean), where=(whole > 0) & (upper[is_open] > 1)
        )
        value[is_open] += missed * left
        value = np.clip(value, np.minimum(floor, ceiling), ceiling)
        return np.where((relative <= 1) & np.isfinite(ceiling), np.exp(value), 0.0)

    def _at(self, knot: Indices, inside: Array, peak: Array) -> Array:
        """Evaluate ln k of the tabulated peak `knot`, at fractions of its reopening pressure; knot 0 is loading."""
        out = self.loading(np.cbrt(inside) * np.minimum(np.cbrt(peak), max(self.loading.end, 0.0)))
        for m, curve in enumerate(self._unloading):
            chosen = knot == m + 1
            if chosen.any():
                out[chosen] = curve(inside[chosen] * _reopening(curve))
        return out

    def along(self, paths: Array, steps: LoadProgramme) -> Array:
        """Evaluate k (steps, paths) [m³] along paths of the pressure of a cell (steps, paths) [Pa]."""
        peak = local_peaks(paths, steps)
        # at its own peak a cell is on the loading curve, even where the seal is being unloaded
        down = paths < peak
        k = self.loaded(np.maximum(paths, 0.0))
        k[down] = self.unloaded(np.maximum(paths[down], 0.0), peak[down])
        return k


def _reopening(unloading: LogCurve) -> float:
    """Return the fraction of the peak below which a cell is open on unloading; 0 if it never is."""
    return min(max(unloading.end, 0.0), 1.0)


def _between(weight: Array, a: Array, b: Array) -> Array:
    """Interpolate ln k: (1 − weight) a + weight b.

    A curve that is never open, −inf, takes the shape of the other one.
    """
    closed_a = np.isneginf(a)
    closed_b = np.isneginf(b)
    weight = np.where(closed_a, 1.0, np.where(closed_b, 0.0, weight))
    mean = (1 - weight) * np.where(closed_a, 0.0, a) + weight * np.where(closed_b, 0.0, b)
    return np.where(closed_a & closed_b, -np.inf, mean)


def local_peaks(paths: Array, steps: LoadProgramme) -> Array:
    """Return the highest pressure that a cell has had up to each step on its way there (steps, paths) [Pa].

    The way to an unloading step is the loading up to its peak and the unloading from there. Where the pressure of a
    cell falls while that of the seal rises, or the other way round, its own peak is not at the peak of the seal.
    """
    highest = paths.copy()
    for branch in steps.branches:
        way = np.union1d(branch, steps.peak_indices[branch])
        highest[way] = np.maximum.accumulate(highest[way], axis=0)
    return highest

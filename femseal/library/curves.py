"""Permeability of a library cell at any pressure of any load cycle, interpolated between the steps of its ladder.

ln k is interpolated monotonically (PCHIP; Fritsch & Carlson, SIAM J. Numer. Anal. 17, 1980, 238) in the cube root of
the pressure, in which it is nearly straight from first touch to closing. Unloading curves are interpolated between the
peaks of the ladder, at equal fractions of the pressure at which the cell opens again; so every unloading curve starts
on the loading curve. Below the lowest peak it tends to the loading curve, as without yielding.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..analytic import large_gap
from ..base.arrays import Array
from .ladder import Ladder, WindowStates

Curve = Callable[[Array], Array]
#: Relative distance of numbers that are the same but for rounding.
_ROUNDING = 1e-12


def monotone(x: Array, y: Array) -> Curve:
    """Monotone cubic interpolation (PCHIP) of values at two points or more, for arguments between them.

    It is that of scipy, which takes ten times as long to begin with a few points; a library has many such curves.
    """
    step = np.diff(x)
    rise = np.diff(y) / step
    slope = np.zeros(x.size)
    if x.size == 2:
        slope[:] = rise
    else:
        before, after = rise[:-1], rise[1:]
        near_before, near_after = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
        mean = (near_before + near_after) * before * after
        np.divide(mean, near_before * after + near_after * before, out=slope[1:-1], where=before * after > 0)
        slope[0] = _end_slope(*step[:2], *rise[:2])
        slope[-1] = _end_slope(*step[:-3:-1], *rise[:-3:-1])
    second = (3 * rise - 2 * slope[:-1] - slope[1:]) / step
    third = (slope[:-1] + slope[1:] - 2 * rise) / step**2

    def curve(at: Array) -> Array:
        n = np.clip(np.searchsorted(x, at, "right") - 1, 0, x.size - 2)
        way = at - x[n]
        return np.asarray(y[n] + way * (slope[n] + way * (second[n] + way * third[n])))

    return curve


def _end_slope(step: float, next_step: float, rise: float, next_rise: float) -> float:
    """Slope of `monotone` at an end, from three points."""
    slope = ((2 * step + next_step) * rise - step * next_rise) / (step + next_step)
    if slope * rise <= 0:
        return 0.0
    return 3 * rise if rise * next_rise <= 0 and abs(slope) > 3 * abs(rise) else slope


class LogCurve:
    """ln k as a function of a rising x. Where k falls to 0 the curve ends, halfway between open and closed.

    Points that differ but for rounding are taken once.
    """

    def __init__(self, x: Array, k: Array) -> None:
        """Take values k at rising x; the curve ends where k is 0 for the first time."""
        differ = _differing(x)
        x, k = x[differ], k[differ]
        n_open = int(np.argmin(k > 0)) if not np.all(k > 0) else k.size
        self.end = np.inf if n_open == k.size else (-np.inf if n_open == 0 else (x[n_open - 1] + x[n_open]) / 2)
        self._low, self._high = (float(x[0]), float(x[n_open - 1])) if n_open else (0.0, 0.0)
        self._slope = 0.0
        self._inner: Curve | None = None
        if n_open == 1:
            self._inner = lambda x: np.full(np.shape(x), np.log(k[0]))
        elif n_open > 1:
            log_k = np.log(k[:n_open])
            self._inner = monotone(x[:n_open], log_k)
            self._slope = min(0.0, float((log_k[-1] - log_k[-2]) / (x[n_open - 1] - x[n_open - 2])))

    def __call__(self, x: Array) -> Array:
        """ln k at x, −inf where the cell is closed.

        Below the first point the curve is constant; beyond the last open point it keeps its last slope to its end.
        """
        x = np.asarray(x, float)
        if self._inner is None:
            return np.full(x.shape, -np.inf)
        beyond = np.maximum(x - self._high, 0.0) if np.isfinite(self.end) else 0.0
        value = self._inner(np.clip(x, self._low, self._high)) + self._slope * beyond
        return np.where(x <= self.end, value, -np.inf)


class WindowCurves:
    """Permeability of one cell along one axis: the value (kind 0), its lower bound (1) or its upper bound (2)."""

    def __init__(self, cell: WindowStates, ladder: Ladder, axis: int, rms_height: float, kind: int = 0) -> None:
        self.cell, self.ladder, self.axis, self.rms_height, self.kind = cell, ladder, axis, rms_height, kind

    @cached_property
    def loading(self) -> LogCurve:
        """ln k as a function of the cube root of the loading pressure."""
        return LogCurve(np.cbrt(self.cell.pressure), self.cell.k[self.kind, self.axis])

    @cached_property
    def _peaks(self) -> NDArray[np.int64]:
        """Numbers of the peaks that differ."""
        return np.flatnonzero(_differing(np.cbrt(self.cell.peaks)))

    @cached_property
    def _unloading(self) -> list[LogCurve]:
        """For each peak, ln k as a function of the pressure over that of the peak, which has 1 itself."""
        fractions = np.array([1.0, *self.ladder.stops])[::-1]
        curves = []
        for m, peak in zip(self._peaks, self.cell.peaks[self._peaks], strict=True):
            top = self.cell.k[self.kind, self.axis, np.searchsorted(self.cell.pressure, peak)]
            curves.append(LogCurve(fractions, np.array([top, *self.cell.k_unloading[self.kind, self.axis, m]])[::-1]))
        return curves

    @cached_property
    def _rigid(self) -> LogCurve:
        """ln k as a function of the negative distance, so that the cell closes as the argument rises."""
        distances = np.array(self.ladder.separations)
        return LogCurve(-distances[::-1], self.cell.rigid[self.kind, self.axis, ::-1])

    def loaded(self, pressure: Array) -> Array:
        """k on loading [m³]."""
        return np.exp(self.loading(np.cbrt(pressure)))

    def separated(self, gap: Array) -> Array:
        """k without pressure at a distance of the mean planes [m³]: (h̄³/12)(1 − 3σ²/2h̄²) beyond the ladder."""
        if not self.ladder.separations:
            return self.loaded(np.zeros_like(gap))
        last = self.ladder.separations[-1]
        wide = np.maximum(gap, last)
        drop = self.ladder.drop
        factor = drop.law.factor(wide, drop.pressures[self.kind % drop.pressures.size])
        beyond = large_gap(wide, self.rms_height) * factor
        return np.where(gap <= last, np.exp(self._rigid(-np.maximum(gap, self.ladder.separations[0]))), beyond)

    def unloaded(self, pressure: Array, peak: Array) -> Array:
        """k on unloading from any peak to any pressure below it, both > 0 [m³]."""
        if not self.cell.peaks.size:
            return self.loaded(pressure)
        fraction = np.clip(pressure / peak, 0.0, 1.0)
        knots = np.r_[0.0, self.cell.peaks[self._peaks]]
        upper = np.clip(np.searchsorted(knots, peak), 1, knots.size - 1)
        closing = self._closing_root**3
        opens = np.array([_reopening(curve) for curve in self._unloading])
        # below the closing pressure a peak leaves the cell open: the fraction at which it reopens falls from 1 there
        start = np.clip(closing, knots[upper - 1], knots[upper])
        before = np.where(closing > knots[upper - 1], 1.0, np.r_[1.0, opens][upper - 1])
        span = knots[upper] - start
        way = np.divide(peak - start, span, out=np.zeros(peak.shape), where=span > 0)
        reopening = np.where(peak <= closing, 1.0, before + np.clip(way, 0, 1) * (np.r_[1.0, opens][upper] - before))
        relative = np.divide(fraction, reopening, out=np.full(fraction.shape, np.inf), where=reopening > 0)
        x = np.cbrt(knots)
        weight = np.clip((np.cbrt(peak) - x[upper - 1]) / (x[upper] - x[upper - 1]), 0, 1)
        inside = np.clip(relative, 0, 1)
        value, top = (
            _between(weight, self._at(upper - 1, at, peak), self._at(upper, at, peak))
            for at in (inside, np.ones_like(inside))
        )
        ceiling, floor = self.loading(np.cbrt(pressure)), self.loading(np.cbrt(peak))
        # from a peak at which the cell is open, k starts at its value on loading
        value += np.subtract(floor, top, out=np.zeros_like(top), where=np.isfinite(floor) & np.isfinite(top))
        value = np.clip(value, np.minimum(floor, ceiling), ceiling)
        return np.where((relative <= 1) & np.isfinite(ceiling), np.exp(value), 0.0)

    @property
    def _closing_root(self) -> float:
        """Cube root of the pressure at which the cell closes on loading; 0 if it is never open."""
        return max(self.loading.end, 0.0)

    def _at(self, knot: NDArray[np.int64], inside: Array, peak: Array) -> Array:
        """ln k of the peak at each knot, at fractions of the pressure at which the cell reopens; knot 0 is loading."""
        out = self.loading(np.cbrt(inside) * np.minimum(np.cbrt(peak), self._closing_root))
        for m, curve in enumerate(self._unloading):
            chosen = knot == m + 1
            if chosen.any():
                out[chosen] = curve(inside[chosen] * _reopening(curve))
        return out


def _differing(x: Array) -> NDArray[np.bool_]:
    """True at the numbers of a rising sequence that are above the one before by more than rounding."""
    return np.concatenate([np.ones(min(x.size, 1), bool), np.diff(x) > _ROUNDING * np.abs(x[1:])])


def _reopening(unloading: LogCurve) -> float:
    """Fraction of the peak below which a cell is open on unloading; 0 if it never is."""
    return min(max(unloading.end, 0.0), 1.0)


def _between(weight: Array, a: Array, b: Array) -> Array:
    """(1 − weight) a + weight b of ln k; a curve that is never open, −inf, has no shape, and the other's is taken."""
    shut_a, shut_b = np.isneginf(a), np.isneginf(b)
    weight = np.where(shut_a, 1.0, np.where(shut_b, 0.0, weight))
    mean = (1 - weight) * np.where(shut_a, 0.0, a) + weight * np.where(shut_b, 0.0, b)
    return np.where(shut_a & shut_b, -np.inf, mean)

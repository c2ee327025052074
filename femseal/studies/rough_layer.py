"""Describe the roughness of a seal as a compliant layer: the distance of its mean planes as a function of the pressure.

The distance is computed from the contact of the measured surface alone, under uniform pressures on loading and on
unloading from several peaks. It is interpolated linearly between these pressures.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np

from ..base import Array, Indices, Mapper
from ..contact import LoadState
from ..loads import LoadProgramme, LoadStep
from ..scene import Scene

#: Pressures on loading at which the layer is solved, as fractions of the highest one.
_PRESSURES = np.geomspace(1e-3, 1.0, 13)
#: Indices of the pressures from which the layer is unloaded.
_PEAKS = np.array([4, 8, 12])
#: Fractions of the peak at which unloading is tabulated. The states at 1 (the peak) and at 0 are not solved: the
#: recovery is 0 at the peak, and extrapolated to 0.
_RELEASED = np.array([1.0, 0.7, 0.4, 0.15, 0.03, 0.0])
#: Highest pressure of the layer, as a fraction of the pressure that the surface can carry. Above it the bodies
#: themselves yield.
HIGHEST_PRESSURE = 0.97


@dataclass(frozen=True, eq=False)
class RoughLayer:
    """Distance s of the mean planes of rough surfaces as a function of the pressure, on loading and on unloading.

    Several surfaces may share the tabulated pressures, such as the blocks of a large surface.

    Parameters
    ----------
    pressure : array (n,), Pa
        Increasing pressures on loading, from 0 to the highest one.
    separation : array (surfaces, n), m
        Distance s of the mean planes at these pressures.
    peaks : array (m,), Pa
        Pressures from which the layer is unloaded; empty if the surfaces are elastic.
    recovery : array (surfaces, m, 6), m
        Increase of s from the peak to each fraction `_RELEASED` of it, on unloading.
    surface_number : array of int (points,) or int
        Number of the surface at each point at which the layer is evaluated, or of all points.
    """

    pressure: Array
    separation: Array
    peaks: Array
    recovery: Array
    surface_number: Indices | int = 0

    @classmethod
    def of(
        cls, scene: Scene, mapper: Mapper, boundary: tuple[str, str] = ("periodic", "periodic")
    ) -> RoughLayer:
        """Solve the contact of the surface of a scene alone under uniform pressures."""
        programme, gaps = solve_layer_states(
            scene, attrgetter("contact.mean_gap"), mapper, boundary
        )
        return cls.from_mean_gaps(scene, programme, gaps)

    @classmethod
    def from_mean_gaps(
        cls, scene: Scene, programme: LoadProgramme, gaps: Sequence[float]
    ) -> RoughLayer:
        """Make the layer from the mean gap (steps,) [m] at each step of the programme of `solve_layer_states`."""
        loading = programme.pressures[programme.on_loading]
        peaks = np.array(programme.unload_from)
        gap_on_loading, gap_on_unloading = np.split(np.array(gaps), [loading.size])
        # the steps on unloading follow peak by peak, each at the same fractions of its peak
        gap_on_unloading = gap_on_unloading.reshape(peaks.size, _RELEASED.size - 2)
        gap_at_peak = gap_on_loading[_PEAKS[: peaks.size], None]
        recovery = np.zeros((peaks.size, _RELEASED.size))
        recovery[:, 1:-1] = gap_on_unloading - gap_at_peak
        # The recovery grows with the logarithm of the pressure, which has no limit at 0. Without pressure, its growth
        # over a further factor of e in the pressure is added to its last solved value.
        growth = np.diff(recovery[:, -3:-1]) / np.log(_RELEASED[-3] / _RELEASED[-2])
        recovery[:, -1:] = recovery[:, -2:-1] + growth
        heights = scene.surface.heights
        at_first_touch = heights.max() - heights.mean()
        separation = np.array([[at_first_touch, *gap_on_loading]])
        return cls(np.array([0.0, *loading]), separation, peaks, recovery[None])

    def on_loading(self, p: Array) -> tuple[Array, Array]:
        """Evaluate s and ds/dp at pressures (points,) on loading."""
        interval = np.searchsorted(self.pressure, p, side="right") - 1
        interval = np.clip(interval, 0, self.pressure.size - 2)
        slopes = np.diff(self.separation) / np.diff(self.pressure)  # (surface, interval)
        slope = slopes[self.surface_number, interval]
        start = self.separation[self.surface_number, interval]
        return start + slope * (p - self.pressure[interval]), slope

    def on_unloading(self, p: Array, peak: Array) -> tuple[Array, Array]:
        """Evaluate s and ds/dp at pressures (points,) after peaks (points,); above a peak as on loading.

        The recovery is interpolated between the tabulated peaks below and above each peak, over the logarithm of the
        peak, and between two tabulated fractions of the peak.
        """
        if not self.peaks.size:
            return self.on_loading(p)
        safe_peak = np.maximum(peak, 1e-9 * self.peaks[0])  # for the logarithm and the division
        # position of each peak among the tabulated ones, such as 0.5 in the middle between the first two
        position = np.interp(np.log(safe_peak), np.log(self.peaks), np.arange(self.peaks.size))
        lower = np.minimum(position.astype(int), self.peaks.size - 2)
        # `_RELEASED` decreases, so both sides change their sign for the search
        interval = np.searchsorted(-_RELEASED, -p / safe_peak, side="left") - 1
        interval = np.clip(interval, 0, _RELEASED.size - 2)
        ends = np.array([interval, interval + 1])  # (end of the interval, point)
        at_lower_peak = self.recovery[self.surface_number, lower, ends]
        at_upper_peak = self.recovery[self.surface_number, lower + 1, ends]
        recovery_at_start, recovery_at_end = at_lower_peak + (position - lower) * (
            at_upper_peak - at_lower_peak
        )
        change = recovery_at_end - recovery_at_start
        slope = change / np.diff(_RELEASED)[interval] / safe_peak
        at_peak, _ = self.on_loading(peak)
        separation = at_peak + recovery_at_start + slope * (p - _RELEASED[interval] * safe_peak)
        above_peak = p >= peak
        loading_separation, loading_slope = self.on_loading(p)
        return (
            np.where(above_peak, loading_separation, separation),
            np.where(above_peak, loading_slope, slope),
        )


def solve_layer_states(
    scene: Scene,
    take: Callable[[LoadState], Any],
    mapper: Mapper,
    boundary: tuple[str, str] = ("periodic", "periodic"),
) -> tuple[LoadProgramme, list[Any]]:
    """Solve the contact of a dry surface alone, from light pressures to nearly the highest that it can carry.

    If the surface yields and the scene contains unloading, unloading from several peaks follows.

    Parameters
    ----------
    scene : Scene
        The surface and its materials. Its own load programme only decides whether unloading is solved.
    take : callable
        Called with each contact state; returns what is needed of it.
    mapper : callable
        Computes the items of a stage.
    boundary : tuple of two str
        Continuation of the surface along x1 and x2, see `HalfSpace`.

    Returns
    -------
    programme : LoadProgramme
        Uniform pressures at which the surface was solved.
    taken : list
        Values of `take`, one for each step of the programme.
    """
    law = scene.law
    loading = HIGHEST_PRESSURE * min(law.capacity, 0.1 * scene.surface_modulus) * _PRESSURES
    has_unloading = any(step.unloaded_from is not None for step in scene.steps)
    peaks = loading[_PEAKS].tolist() if has_unloading and not law.is_elastic else []
    solved_fractions = _RELEASED[1:-1].tolist()
    unloading = [LoadStep(peak * fraction, peak) for peak in peaks for fraction in solved_fractions]
    programme = LoadProgramme([*map(LoadStep, loading.tolist()), *unloading])
    dry = scene.dry(boundary=boundary)
    return programme, list(dry.contact_states(take, steps=programme, mapper=mapper))

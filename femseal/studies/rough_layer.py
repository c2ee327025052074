"""Describe the roughness of a seal as a compliant layer, whose thickness is a function of the pressure.

The thickness is the separation of the mean planes of the two rough surfaces. It is taken from the contact of the
measured surface, which is solved under several uniform pressures on loading, and on unloading from several peaks.
Between these pressures, it is interpolated linearly.
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

#: Pressures on loading at which the layer is solved, as fractions of the highest pressure.
_PRESSURES = np.geomspace(1e-3, 1.0, 13)
#: Indices of the peaks in `_PRESSURES`, from which the layer is unloaded.
_PEAKS = np.array([4, 8, 12])
#: Fractions of the peak at which unloading is tabulated. The first and the last state are not solved: at the peak, the
#: recovery is 0, and without pressure, the recovery is extrapolated.
_RELEASED = np.array([1.0, 0.7, 0.4, 0.15, 0.03, 0.0])
#: Highest pressure of the layer, as a fraction of the pressure that the surface can carry. Above it the bodies
#: themselves yield.
HIGHEST_PRESSURE = 0.97


@dataclass(frozen=True, eq=False)
class RoughLayer:
    """Describe the separation s of the mean planes of rough surfaces as a function of pressure.

    The layer may describe several surfaces that have been solved at the same pressures, such as the blocks of a large
    surface.

    Parameters
    ----------
    pressure : array (n,), Pa
        Increasing pressures on loading, beginning with 0.
    separation : array (surfaces, n), m
        Separation s of the mean planes at these pressures.
    peaks : array (m,), Pa
        Increasing pressures from which the layer is unloaded; empty if the surfaces are elastic.
    recovery : array (surfaces, m, 6), m
        Increase of s on unloading from each peak to the fractions `_RELEASED` of the peak.
    surface_number : array of int (points,) or int
        Number of the surface of each point at which the layer is evaluated. A single number applies to all points.
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
        """Solve the contact of the rough surface of a scene under uniform pressures, and make the layer from it."""
        programme, gaps = solve_layer_states(
            scene, attrgetter("contact.mean_gap"), mapper, boundary
        )
        return cls.from_mean_gaps(scene, programme, gaps)

    @classmethod
    def from_mean_gaps(
        cls, scene: Scene, programme: LoadProgramme, gaps: Sequence[float]
    ) -> RoughLayer:
        """Make the layer from the mean gaps of the contact states that `solve_layer_states` has solved.

        Parameters
        ----------
        scene : Scene
            The rough surface.
        programme : LoadProgramme
            Load programme of these contact states.
        gaps : sequence of float
            Mean gap at each step of the programme [m].
        """
        loading = programme.pressures[programme.on_loading]
        peaks = np.array(programme.unload_from)
        gap_on_loading, gap_on_unloading = np.split(np.array(gaps), [loading.size])
        # the steps on unloading follow peak by peak, each at the same fractions of its peak
        gap_on_unloading = gap_on_unloading.reshape(peaks.size, _RELEASED.size - 2)
        gap_at_peak = gap_on_loading[_PEAKS[: peaks.size], None]
        recovery = np.zeros((peaks.size, _RELEASED.size))  # (peak, fraction)
        recovery[:, 1:-1] = gap_on_unloading - gap_at_peak
        # As the pressure falls, the recovery grows in proportion to −ln(pressure), which has no limit at 0. The value
        # without pressure is therefore taken as the value at 1/e times the lowest solved pressure.
        growth_per_factor_e = np.diff(recovery[:, -3:-1]) / np.log(_RELEASED[-3] / _RELEASED[-2])
        recovery[:, -1:] = recovery[:, -2:-1] + growth_per_factor_e
        heights = scene.surface.heights
        gap_at_first_touch = heights.max() - heights.mean()
        separation = np.array([[gap_at_first_touch, *gap_on_loading]])
        return cls(np.array([0.0, *loading]), separation, peaks, recovery[None])

    def on_loading(self, p: Array) -> tuple[Array, Array]:
        """Evaluate s [m] and ds/dp [m/Pa] on loading, at the pressure of each point (points,) [Pa]."""
        interval = np.searchsorted(self.pressure, p, side="right") - 1
        interval = np.clip(interval, 0, self.pressure.size - 2)
        slopes = np.diff(self.separation) / np.diff(self.pressure)  # (surface, interval)
        slope = slopes[self.surface_number, interval]
        start = self.separation[self.surface_number, interval]
        return start + slope * (p - self.pressure[interval]), slope

    def on_unloading(self, p: Array, peak: Array) -> tuple[Array, Array]:
        """Evaluate s [m] and ds/dp [m/Pa] on unloading, at the pressure and the peak of each point (points,) [Pa].

        At pressures above the peak, the values are those on loading. Below the peak, s is s(peak) plus the recovery,
        which is interpolated between four tabulated values: linearly in the logarithm of the peak between the next
        lower and the next higher tabulated peak, and linearly in the pressure between the two nearest fractions
        `_RELEASED` of the peak.
        """
        if not self.peaks.size:
            return self.on_loading(p)
        safe_peak = np.maximum(peak, 1e-9 * self.peaks[0])  # for the logarithm and the division
        # position of each peak among the tabulated peaks, such as 0.5 in the middle between the first two
        position = np.interp(np.log(safe_peak), np.log(self.peaks), np.arange(self.peaks.size))
        lower = np.minimum(position.astype(int), self.peaks.size - 2)
        weight_of_upper = position - lower
        # Interval n lies between the fractions n and n + 1. `_RELEASED` decreases, but `searchsorted` needs increasing
        # values, so that both arguments change their sign.
        interval = np.searchsorted(-_RELEASED, -p / safe_peak, side="left") - 1
        interval = np.clip(interval, 0, _RELEASED.size - 2)
        ends = np.array([interval, interval + 1])  # (end of the interval, point)
        at_lower_peak = self.recovery[self.surface_number, lower, ends]
        at_upper_peak = self.recovery[self.surface_number, lower + 1, ends]
        recovery_at_ends = at_lower_peak + weight_of_upper * (at_upper_peak - at_lower_peak)
        recovery_at_start, recovery_at_end = recovery_at_ends
        change = recovery_at_end - recovery_at_start
        # derivative of the recovery with respect to the pressure
        slope = change / np.diff(_RELEASED)[interval] / safe_peak
        separation_at_peak, _ = self.on_loading(peak)
        pressure_at_start = _RELEASED[interval] * safe_peak
        separation = separation_at_peak + recovery_at_start + slope * (p - pressure_at_start)
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
    """Solve the contact of the rough surface without fluid, under increasing uniform pressures.

    The pressures end at `HIGHEST_PRESSURE` times the pressure that the surface can carry, and begin at a thousandth of
    that. Unloading from several of these pressures is also solved, if the surface yields and the load programme of the
    scene contains unloading.

    Parameters
    ----------
    scene : Scene
        The surface and its materials. Its load programme is only used to decide whether unloading is solved.
    take : callable
        Function that extracts the result from each contact state.
    mapper : callable
        Computes the items of a stage.
    boundary : tuple of two str
        Continuation of the surface along x1 and x2, see `HalfSpace`.

    Returns
    -------
    programme : LoadProgramme
        Uniform pressures at which the surface was solved.
    taken : list
        Results of `take`, one for each step of the programme.
    """
    law = scene.law
    # an elastic surface can carry any pressure; the layer then ends at about a tenth of the contact modulus
    capacity = min(law.capacity, 0.1 * scene.surface_modulus)
    loading = HIGHEST_PRESSURE * capacity * _PRESSURES
    has_unloading = any(step.unloaded_from is not None for step in scene.steps)
    peaks = loading[_PEAKS].tolist() if has_unloading and not law.is_elastic else []
    solved_fractions = _RELEASED[1:-1].tolist()
    unloading = [LoadStep(peak * fraction, peak) for peak in peaks for fraction in solved_fractions]
    programme = LoadProgramme([*map(LoadStep, loading.tolist()), *unloading])
    dry = scene.dry(boundary=boundary)
    return programme, list(dry.contact_states(take, steps=programme, mapper=mapper))

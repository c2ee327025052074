"""Describe the roughness of a seal as a compliant layer whose thickness depends on the contact pressure.

The thickness of the layer is the separation of the mean planes of the two rough surfaces. The separation is computed
from the contact of the measured surface under several uniform pressures, on loading and on unloading. Between the
computed pressures on loading, the separation is interpolated by a monotone cubic in the logarithm of the pressure,
because the separation of rough surfaces decreases about linearly with the logarithm of the pressure (Persson, Phys.
Rev. Lett. 99, 2007, 125502). On unloading, the increase of the separation since the highest pressure is interpolated
linearly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from ..base import Array, Indices, Mapper
from ..contact import LoadState
from ..loads import LoadProgramme, LoadStep
from ..scene import Scene

#: Pressures on loading at which the rough contact is solved, as fractions of the pressure at which points yield for the
#: first time. If the contact law allows higher pressures, as with coatings, higher pressures are added with the same
#: ratio between neighbours.
_PRESSURES = np.geomspace(1e-3, 1.0, 17)
#: Indices in `_PRESSURES` of the peak pressures from which the layer is unloaded, in addition to the highest pressure
#: of the layer.
_PEAKS = (5, 11, 16)
#: Fractions of the peak pressure at which unloading is tabulated. The contact is not solved at the first and the last
#: fraction: at the peak pressure, the recovery is 0, and at pressure 0, the recovery is extrapolated.
_RELEASED = np.array([1.0, 0.7, 0.4, 0.15, 0.03, 0.0])
#: Highest pressure of the layer, as a fraction of the largest that the surface can support. At higher pressures, the
#: bodies under the roughness yield.
HIGHEST_PRESSURE = 0.97


@dataclass(frozen=True, eq=False)
class RoughLayer:
    """Describe the separation s of the mean planes of rough surfaces as a function of the contact pressure.

    The layer can describe several surfaces that have been solved at the same pressures, such as the blocks of a large
    surface.

    Parameters
    ----------
    pressure : array (n,), Pa
        Increasing pressures on loading, beginning with 0.
    separation : array (surfaces, n), m
        Separation s of the mean planes of each rough surface at each of the pressures in `pressure`.
    peaks : array (m,), Pa
        Increasing peak pressures from which unloading is tabulated; empty if the surfaces are elastic.
    recovery : array (surfaces, m, 6), m
        Recovery: increase of s when the surfaces are unloaded from each peak pressure to the fractions `_RELEASED` of
        that pressure.
    surface_number : array of int (points,) or int
        For each point at which the layer is evaluated, the number of the rough surface on which the point lies. A
        single number means that all points lie on the same rough surface.
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
        """Compute the rough layer from the contact of the surface of a scene under uniform pressures."""
        programme, gaps = solve_layer_states(
            scene, attrgetter("contact.mean_gap"), mapper, boundary
        )
        return cls.from_mean_gaps(scene, programme, gaps)

    @classmethod
    def from_mean_gaps(
        cls, scene: Scene, programme: LoadProgramme, gaps: Sequence[float]
    ) -> RoughLayer:
        """Make the rough layer from the mean gaps of the contact states that `solve_layer_states` has solved.

        Parameters
        ----------
        scene : Scene
            The rough surface.
        programme : LoadProgramme
            Load programme of the contact states.
        gaps : sequence of float
            Mean gap at each step of the load programme [m].
        """
        loading = programme.pressures[programme.on_loading]
        peaks = np.array(programme.unload_from)
        gap_on_loading, gap_on_unloading = np.split(np.array(gaps), [loading.size])
        # The steps on unloading follow peak by peak, with the same fractions for each peak pressure: (peak, fraction).
        # The first and the last fraction of `_RELEASED` are not solved.
        gap_on_unloading = gap_on_unloading.reshape(peaks.size, _RELEASED.size - 2)
        gap_at_peak = gap_on_loading[np.searchsorted(loading, peaks), None]  # (peak, 1)
        # (peak, fraction); 0 at the peak pressure
        recovery = np.zeros((peaks.size, _RELEASED.size))
        recovery[:, 1:-1] = gap_on_unloading - gap_at_peak
        # As the pressure falls, the recovery grows in proportion to −ln(pressure), which has no limit at pressure 0.
        # The recovery at pressure 0 is therefore set to the recovery extrapolated to 1/e times the lowest solved
        # pressure: the last solved recovery plus its growth when the pressure falls by the factor e.
        growth_per_factor_e = np.diff(recovery[:, -3:-1]) / np.log(_RELEASED[-3] / _RELEASED[-2])
        recovery[:, -1:] = recovery[:, -2:-1] + growth_per_factor_e
        heights = scene.surface.heights
        # the highest point just touches a plane at this distance from the mean plane
        gap_at_first_touch = heights.max() - heights.mean()
        separation = np.array([[gap_at_first_touch, *gap_on_loading]])
        return cls(
            pressure=np.array([0.0, *loading]),
            separation=separation,
            peaks=peaks,
            recovery=recovery[None],  # a single surface
        )

    def on_loading(self, p: Array) -> tuple[Array, Array]:
        """Return the separation s [m] and ds/dp [m/Pa] on loading, at the pressures p (points,) [Pa].

        Between two tabulated pressures, s is a cubic Hermite polynomial in t, s = s₀ + m₀ t + b t² + c t³, where t
        increases from 0 to 1 with the logarithm of the pressure. The coefficients follow from the values s₀, s₁ and the
        slopes m₀, m₁ at both ends: b = 3 (s₁ − s₀) − 2 m₀ − m₁ and c = m₀ + m₁ − 2 (s₁ − s₀). Below the lowest and
        above the highest tabulated pressure, s varies linearly with the pressure.
        """
        surface = self.surface_number
        first, last = self.pressure[[1, -1]]  # tabulated pressures without the pressure 0
        tabulated_p = np.clip(p, first, last)
        x = np.log(tabulated_p)
        nodes = np.log(self.pressure[1:])
        # interval n lies between the nodes n and n + 1, whose separations have the indices n + 1 and n + 2
        interval = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, nodes.size - 2)
        width = np.diff(nodes)[interval]
        t = (x - nodes[interval]) / width
        start = self.separation[surface, interval + 1]
        rise = self.separation[surface, interval + 2] - start
        start_slope = width * self._node_slopes[surface, interval]
        end_slope = width * self._node_slopes[surface, interval + 1]
        quadratic = 3 * rise - 2 * start_slope - end_slope
        cubic = start_slope + end_slope - 2 * rise
        separation = start + t * (start_slope + t * (quadratic + t * cubic))
        ds_dt = start_slope + t * (2 * quadratic + t * 3 * cubic)
        slope = ds_dt / (width * tabulated_p)  # ds/dp, because dt/dp = 1/(width · p)
        # straight line from pressure 0 to the first tabulated pressure
        line_slope = (self.separation[surface, 1] - self.separation[surface, 0]) / first
        slope = np.where(p < first, line_slope, slope)
        return separation + slope * (p - tabulated_p), slope

    @cached_property
    def _node_slopes(self) -> Array:
        """Derivative of the separation s [m] with respect to the logarithm of the pressure (surfaces, n − 1).

        There is a derivative for each tabulated pressure on loading except pressure 0. With these derivatives, the
        interpolating cubic is monotone (PCHIP; Fritsch & Butland, SIAM J. Sci. Stat. Comput. 5, 1984, 300).
        """
        nodes = np.log(self.pressure[1:])
        curve = PchipInterpolator(nodes, self.separation[:, 1:], axis=1)
        return np.asarray(curve.derivative()(nodes))

    def on_unloading(self, p: Array, peak: Array) -> tuple[Array, Array]:
        """Return the separation s [m] and ds/dp [m/Pa] on unloading, at the pressures p (points,) [Pa].

        At a pressure above the peak pressure, the separation is the same as on loading. At a pressure below the peak
        pressure, the separation is s(peak) plus the recovery. The recovery is interpolated linearly in the logarithm of
        the peak pressure, between two tabulated peak pressures, and linearly in the pressure, between two of the
        fractions `_RELEASED` of the peak pressure.

        peak : highest pressure reached so far at each point (points,) [Pa].
        """
        if not self.peaks.size:
            return self.on_loading(p)
        safe_peak = np.maximum(peak, 1e-9 * self.peaks[0])  # for the logarithm and the division
        # position of each peak pressure among the tabulated ones, such as 0.5 midway between the first two
        position = np.interp(np.log(safe_peak), np.log(self.peaks), np.arange(self.peaks.size))
        # index of the next lower tabulated peak
        lower_peak = np.minimum(position.astype(int), self.peaks.size - 2)
        weight_of_upper = position - lower_peak
        # Interval n lies between the fractions n and n + 1. `_RELEASED` decreases, but `searchsorted` needs increasing
        # values, so that both arguments change their sign.
        interval = np.searchsorted(-_RELEASED, -p / safe_peak, side="left") - 1
        interval = np.clip(interval, 0, _RELEASED.size - 2)
        ends = np.array([interval, interval + 1])  # (end of the interval, point)
        at_lower_peak = self.recovery[self.surface_number, lower_peak, ends]
        at_upper_peak = self.recovery[self.surface_number, lower_peak + 1, ends]
        recovery_at_ends = at_lower_peak + weight_of_upper * (at_upper_peak - at_lower_peak)
        recovery_at_start, recovery_at_end = recovery_at_ends
        change = recovery_at_end - recovery_at_start
        # derivative of the recovery with respect to the pressure
        slope = change / np.diff(_RELEASED)[interval] / safe_peak
        separation_at_peak, _ = self.on_loading(peak)
        pressure_at_start = _RELEASED[interval] * safe_peak
        separation = separation_at_peak + recovery_at_start + slope * (p - pressure_at_start)
        above_peak = p >= peak  # the point is loaded beyond its peak pressure
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

    The highest pressure is `HIGHEST_PRESSURE` times the largest pressure that the surface can support. The lowest
    pressure is a thousandth of that pressure or of the pressure at first yield, whichever is smaller. If the surface
    yields and the load programme of the scene contains unloading, unloading from several pressures is solved as well.

    Parameters
    ----------
    scene : Scene
        The surface and its materials. The load programme of the scene is only used to decide whether unloading is
        solved.
    take : callable
        Function that computes the wanted result from the contact state of a load step.
    mapper : callable
        Function such as the builtin `map`, which computes a stage for many items.
    boundary : tuple of two str
        Continuation of the surface along x1 and x2, see `HalfSpace`.

    Returns
    -------
    programme : LoadProgramme
        Uniform pressures at which the surface was solved.
    taken : list
        Return values of the function `take`, one for each step of the load programme.
    """
    law = scene.law
    # An elastic surface can support any pressure. For an elastic surface, the highest pressure is about a tenth of the
    # contact modulus.
    capacity = min(law.capacity, 0.1 * scene.surface_modulus)
    loading = HIGHEST_PRESSURE * _layer_pressures(min(law.mean_hardness, capacity), capacity)
    has_unloading = any(step.unloaded_from is not None for step in scene.steps)
    peaks: list[float] = []
    if has_unloading and not law.is_elastic:
        peak_indices = sorted({*_PEAKS, loading.size - 1})
        peaks = loading[peak_indices].tolist()
    solved_fractions = _RELEASED[1:-1].tolist()
    unloading = [LoadStep(peak * fraction, peak) for peak in peaks for fraction in solved_fractions]
    programme = LoadProgramme([*map(LoadStep, loading.tolist()), *unloading])
    dry = scene.dry(boundary=boundary)
    return programme, list(dry.contact_states(take, steps=programme, mapper=mapper))


def _layer_pressures(first_yield: float, capacity: float) -> Array:
    """Choose the pressures [Pa] at which the rough contact is solved, up to the largest that the surface can support.

    Parameters
    ----------
    first_yield : float
        Pressure [Pa] at which the first points yield, at most `capacity`.
    capacity : float
        Largest pressure that the surface can support [Pa].
    """
    pressures = first_yield * _PRESSURES
    ratio = _PRESSURES[1] / _PRESSURES[0]
    n_more = int(np.ceil(np.log(capacity / first_yield) / np.log(ratio) - 1e-9))
    more = np.geomspace(first_yield, capacity, n_more + 1)[1:] if n_more > 0 else np.empty(0)
    return np.array([*pressures, *more])

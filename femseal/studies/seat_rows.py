"""Contact pressure of the rows of a seat that is broader than the measured face: its own contact in plane strain.

The roughness is a layer between two half-spaces: under the pressure p its mean planes stand s(p) apart, which the
contact of the measured face gives at every pressure, on unloading from every peak by a curve of its own. The rows of
the form z(x1) then have h + K p − δ = s(p) where they touch, with K of plane strain, and more than s(0) where they do
not: the least of ½ p·K p + h·p − Σ∫s dp under the load.
Source: Greenwood & Tripp, J. Appl. Mech. 34, 1967, 153 (a rough layer on smooth bodies).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from operator import attrgetter

import numpy as np

from ..base.arrays import Array
from ..base.errors import NotConverged
from ..contact import HalfSpace, load_states
from ..loads import LoadProgramme, LoadStep
from ..topography.seat import Seat
from .face_contact import band_breadth
from .scene import Scene

#: Rows across the seat; pressures at which the layer is solved, in fractions of the highest, numbers of those from
#: which it is unloaded, and fractions of them down to which.
ROWS = 384
_PRESSURES = np.geomspace(1e-3, 1.0, 13)
_PEAKS, _RELEASED = np.array([4, 8, 12]), np.array([0.7, 0.4, 0.15, 0.03])
#: Fraction of what the faces can carry up to which the layer is solved, and by how much more the pressure rises while
#: the seat itself yields and sinks by the depth of its form.
_HIGHEST, _YIELDING = 0.95, 0.03
_MOST_ITERATIONS, _RTOL = 200, 1e-6


@dataclass(frozen=True)
class SeatMap:
    """The form of a seat as a map of the pressure over the rows of windows, which changes with the load."""

    seat: Seat


@dataclass(frozen=True, eq=False)
class SeatRows:
    """Contact of a seat by itself: mean pressure of rows at every step (steps, rows) [Pa], over a breadth [m]."""

    pressure: Array
    breadth: float

    @property
    def band(self) -> Array:
        """Breadth of the band that touches at every step (steps,) [m]."""
        return band_breadth(self.pressure, self.breadth / self.pressure.shape[1])

    def fractions(self, x1: Array, extent: float, nominal: Array) -> Array:
        """Mean pressure over windows around distances x1 from the inlet (n,) [m], over the nominal one (steps, n).

        extent : of a window along x1 [m]. nominal : pressure of every step (steps,) [Pa]; 1 where there is none.
        """
        edges = np.linspace(0.0, self.breadth, self.pressure.shape[1] + 1)
        whole = np.insert(np.cumsum(self.pressure, axis=1), 0, 0.0, axis=1) * (edges[1] - edges[0])
        low, high = (np.clip(x1 + by * extent / 2, 0.0, self.breadth) for by in (-1, 1))
        means = np.array([(np.interp(high, edges, row) - np.interp(low, edges, row)) / (high - low) for row in whole])
        return np.divide(means, nominal[:, None], out=np.ones_like(means), where=nominal[:, None] > 0)


@dataclass(frozen=True, eq=False)
class RoughLayer:
    """Distance s of the mean planes of a rough face [m] over the pressure, on loading and on unloading.

    pressure : rising from 0 (n,) [Pa]. gap : falling (n,) [m]. sinking : by which it falls on [m/Pa] beyond, where the
    bodies yield. peaks (m,) [Pa], recovered (m, k) : how far the planes come apart again [m] at the fractions
    `released` of peaks; none where the faces are elastic.
    """

    pressure: Array
    gap: Array
    sinking: float
    peaks: Array
    released: Array
    recovered: Array

    @classmethod
    def of(cls, scene: Scene, depth: float) -> RoughLayer:
        """Solve the contact of the face of a scene alone under uniform pressures, for a form of such a depth [m]."""
        surface, law, steps = scene.surface, scene.law, scene.steps
        body = HalfSpace(surface.shape, surface.spacing, scene.modulus, ("mirror", scene.boundary[1]))
        capacity = min(law.capacity, 0.1 * scene.modulus)
        loading = _HIGHEST * capacity * _PRESSURES
        unloads = not law.is_elastic and any(step.unloaded_from is not None for step in steps)
        peaks = loading[_PEAKS] if unloads else np.array([])
        down = [LoadStep(p * f, p) for p in peaks.tolist() for f in _RELEASED.tolist()]
        programme = LoadProgramme([*map(LoadStep, loading.tolist()), *down])
        gap0 = surface.heights.max() - surface.heights
        take = attrgetter("contact.mean_gap")
        found = np.array(list(load_states(gap0, body, programme, law=law, rtol=scene.rtol, take=take)))
        gap, after = np.split(found, [loading.size])
        recovered = after.reshape(peaks.size, _RELEASED.size) - gap[_PEAKS[: peaks.size], None]
        sinking = depth / (_YIELDING * capacity)
        return cls(np.array([0.0, *loading]), np.array([gap0.mean(), *gap]), sinking, peaks, _RELEASED, recovered)

    def loaded(self, p: Array) -> tuple[Array, Array]:
        """s and ds/dp at pressures p (n,) on loading, linear between the pressures."""
        slopes = np.append(np.diff(self.gap) / np.diff(self.pressure), -self.sinking)
        part = np.clip(np.searchsorted(self.pressure, p, side="right") - 1, 0, slopes.size - 1)
        return self.gap[part] + slopes[part] * (p - self.pressure[part]), slopes[part]

    def unloaded(self, p: Array, peak: Array) -> tuple[Array, Array]:
        """s and ds/dp at pressures p (n,) after peaks (n,); beyond them as on loading."""
        if not self.peaks.size:
            return self.loaded(p)
        safe = np.maximum(peak, 1e-300)
        place = np.interp(np.log(safe), np.log(self.peaks), np.arange(self.peaks.size))
        lower = np.minimum(place.astype(int), self.peaks.size - 2)
        weight = (place - lower)[:, None]
        recovered = (1 - weight) * self.recovered[lower] + weight * self.recovered[lower + 1]
        fractions = np.array([1.0, *self.released, 0.0])
        slope_at_end = (recovered[:, -1:] - recovered[:, -2:-1]) / np.log(self.released[-2] / self.released[-1])
        values = np.hstack([np.zeros((p.size, 1)), recovered, recovered[:, -1:] + slope_at_end])
        part = np.clip(np.searchsorted(-fractions, -p / safe, side="left") - 1, 0, fractions.size - 2)
        rows = np.arange(p.size)
        slope = (values[rows, part + 1] - values[rows, part]) / (fractions[part + 1] - fractions[part]) / safe
        start, _ = self.loaded(peak)
        gap = start + values[rows, part] + slope * (p - fractions[part] * safe)
        above = p >= peak
        own, own_slope = self.loaded(p)
        return np.where(above, own, gap), np.where(above, own_slope, slope)


def plane_strain(rows: int, spacing: float, modulus: float) -> Array:
    """Displacement of rows by the pressure of each (rows, rows) [m/Pa], up to a constant."""
    body = HalfSpace((2 * rows, 1), (spacing, spacing), modulus, ("free", "periodic"))
    single = np.zeros((2 * rows, 1))
    single[rows] = 1.0
    response = body.displacement(single)[:, 0]
    distance = np.subtract.outer(np.arange(rows), np.arange(rows))
    return response[rows + distance] - response.min()


def seat_rows(scene: Scene, seat: Seat, breadth: float) -> SeatRows:
    """Contact pressure of the rows across a seat of a breadth [m] at every step, the face of the scene being its layer.

    Raises InputError: a form that is steeper than a half-space allows.
    NotConverged : a contact failed.
    """
    spacing = breadth / ROWS
    depth = seat.rows_below(ROWS, spacing)
    layer = RoughLayer.of(scene, max(float(np.ptp(depth)), 1e-9))
    matrix = plane_strain(ROWS, spacing, scene.modulus)
    found: dict[tuple[float, float | None], Array] = {}
    p = np.zeros(ROWS)
    peaks = {step.unloaded_from for step in scene.steps if step.unloaded_from is not None}
    for load in sorted({*(s.pressure for s in scene.steps if s.unloaded_from is None), *peaks}):
        p = found[load, None] = _solved(matrix, depth, layer.loaded, load, p)
    for step in scene.steps:
        if step.unloaded_from is not None:
            peak = found[step.unloaded_from, None]
            law = partial(layer.unloaded, peak=peak)
            found[step.pressure, step.unloaded_from] = _solved(
                matrix, depth, law, step.pressure, peak * (step.pressure / step.unloaded_from)
            )
    return SeatRows(np.array([found[step.pressure, step.unloaded_from] for step in scene.steps]), breadth)


def _solved(
    matrix: Array, depth: Array, layer: Callable[[Array], tuple[Array, Array]], load: float, start: Array
) -> Array:
    """Pressures (n,) [Pa] of the mean `load`, from a start near them, by Newton's steps on the rows that touch."""
    n = depth.size
    if load == 0:
        return np.zeros(n)
    p = start * (load / start.mean()) if start.any() else np.full(n, load)
    apart_at_first = layer(np.zeros(n))[0]
    touching, change = p > 0, np.inf
    for _ in range(_MOST_ITERATIONS):
        gap, slope = layer(p)
        m, before = int(touching.sum()), change
        stiff = matrix[np.ix_(touching, touching)] - np.diag(slope[touching])
        scale = float(np.abs(stiff.diagonal()).max())
        system = np.block([[stiff, np.full((m, 1), -scale)], [np.full((1, m), -scale), np.zeros((1, 1))]])
        solution = np.linalg.solve(system, np.append((gap - slope * p - depth)[touching], -scale * n * load))
        new = np.zeros(n)
        new[touching] = solution[:m]
        change = float(np.abs(new - p).max()) / load
        p = np.maximum(p + (new - p) * (0.5 if change > 0.5 * before else 1.0), 0.0)
        p *= load / p.mean()
        apart = depth + matrix @ p - scale * solution[m]
        now = (p > 0) | (apart < apart_at_first)
        if change <= _RTOL and (now == touching).all():
            return p
        touching = now
    raise NotConverged(f"contact of the seat: the pressure of its rows still changes by {change:.1e}", change)

"""Contact pressure of the rows of a seat that is broader than the measured face: its own contact in plane strain.

The roughness is a layer between two half-spaces: under the pressure p its mean planes stand s(p) apart, which the
contact of the measured face gives at every pressure, on unloading from every peak by a curve of its own. The rows of
the form z(x1) then have h + K p − δ = s(p) where they touch, with K of plane strain, and more than s(0) where they do
not: the least of ½ p·K p + h·p − Σ∫s dp under the load.

The tiles of a seal have the pressures of these rows, or of a map of the nominal pressure; tiles share paths of it.
Source: Greenwood & Tripp, J. Appl. Mech. 34, 1967, 153 (a rough layer on smooth bodies).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from operator import attrgetter

import numpy as np

from ..base import Array, Indices, InputError, NotConverged, to_text
from ..contact import HalfSpace, load_states
from ..loads import LoadProgramme, LoadStep
from ..seal.layouts import Layout
from ..seal.pressure_map import AnyMap, MapsAtLoads, PressedSeal, PressureField, is_uniform
from ..seal.tiles import SealTiles
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
    """The form of a seat as a map of the pressure over the rows of tiles, which changes with the load."""

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
        """Mean pressure over tiles around distances x1 from the inlet (n,) [m], over the nominal one (steps, n).

        extent : of a tile along x1 [m]. nominal : pressure of every step (steps,) [Pa]; 1 where there is none.
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


#: Most paths of pressure that every piece is interpolated along, under one map and under several at different
#: loads; more are rounded, see `distinct_paths`.
MOST_PATHS, MOST_OF_SEVERAL = 512, 4096
#: Difference of the mean of a field from the load at which it holds from which on a warning says so.
_OFF_LOAD = 0.1
#: How many times above the highest or below the lowest load the mean of a field is warned of.
_FAR_LOAD = 10.0


def seal_for_maps(layout: Layout, tiles: SealTiles) -> PressedSeal:
    """The seal in the coordinates of maps."""
    return PressedSeal(layout.frame(tiles.size), tiles.outlines[tiles.once])


def pressure_fractions(scene: Scene, tiles: SealTiles, pressure_map: AnyMap | SeatMap | SeatRows) -> Array:
    """Pressure of the tiles in fractions of the nominal one (steps, tiles).

    Raises InputError: the map does not cover the seal.
    """
    if is_uniform(pressure_map):
        return np.broadcast_to(1.0, (len(scene.steps), tiles.count))
    points = tiles.middles
    if isinstance(pressure_map, SeatRows):
        frame = scene.layout.frame(tiles.seal.size)
        assert frame.ends is not None
        assert tiles.grid is not None
        extent = pressure_map.breadth / tiles.grid[0]
        return pressure_map.fractions(np.abs(frame.across(points) - frame.ends[0]), extent, scene.steps.pressures)
    assert not isinstance(pressure_map, SeatMap)  # its rows are solved before
    return seal_for_maps(scene.layout, tiles).fractions(pressure_map, points, scene.steps.pressures)


def distinct_paths(fractions: Array) -> tuple[Array, Indices]:
    """Distinct paths (steps, paths) of fractions (steps, n), and the number of the path of each (n,).

    If there are more than `MOST_PATHS`, or `MOST_OF_SEVERAL`, fractions are rounded in their cube root, in which ln k
    is nearly straight, to steps of 1/512 of the largest or larger ones; the mean of those that share a path stays.
    Measured under two maps with 512 paths: leakage within 3e-4.
    """
    changes = [True, *(not np.array_equal(one, other) for one, other in pairwise(fractions))]
    rows = fractions[changes]
    paths, number = _distinct(rows, rows)
    levels, most = float(MOST_PATHS), MOST_PATHS if len(rows) == 1 else MOST_OF_SEVERAL
    while paths.shape[1] > most:
        paths, number = _distinct(np.rint(np.cbrt(rows / rows.max()) * (levels - 1)), rows)
        levels *= 0.8
    return paths[np.cumsum(changes) - 1], number


def _distinct(keys: Array, fractions: Array) -> tuple[Array, Indices]:
    """Groups of equal columns of keys, and the mean fraction in each."""
    _, first, number = np.unique(keys, axis=1, return_index=True, return_inverse=True)
    number = number.reshape(-1)
    if keys is fractions:
        return fractions[:, first], number
    members = np.bincount(number)
    return np.array([np.bincount(number, row) / members for row in fractions]), number


def check_map(scene: Scene, tiles: SealTiles, pressure_map: AnyMap | SeatMap) -> tuple[str, ...]:
    """Warnings on a map before a run.

    Raises InputError: it does not cover the seal, or a tile has more than the faces can carry.
    """
    if isinstance(pressure_map, SeatMap) or is_uniform(pressure_map):
        return ()
    nominal = scene.steps.pressures
    pressure = nominal[:, None] * pressure_fractions(scene, tiles, pressure_map)
    if pressure.max() >= scene.law.capacity:
        step = int(pressure.max(axis=1).argmax())
        given = f"{to_text(float(pressure.max()), 'Pa')} in a tile at {scene.steps[step].name}"
        raise InputError("map", given, f"pressures below the hardness, {to_text(scene.law.capacity, 'Pa')}")
    return (*_pressure_warnings(scene, pressure[nominal > 0]), *_field_warnings(scene, tiles, pressure_map))


def _pressure_warnings(scene: Scene, pressure: Array) -> Iterator[str]:
    """Warnings of the pressures of the tiles at the loaded steps (steps, tiles)."""
    if not pressure.size:
        return
    if free := float((pressure <= 0).mean(axis=1).max()):
        yield (
            f"the map is 0 over {free:.0%} of the seal: tiles just touch there, and a gap that a flange opens is not "
            "in the leakage"
        )
    least, fluid = float(pressure[pressure > 0].min()), scene.acting_fluid
    if fluid is not None and fluid.parts(least):
        yield (
            f"the fluid carries all of the {to_text(least, 'Pa', 3)} where the map presses least: tiles just touch "
            "there, and a gap that the fluid opens is not in the leakage"
        )


def _field_warnings(scene: Scene, tiles: SealTiles, pressure_map: AnyMap) -> tuple[str, ...]:
    """Fields whose mean is far from the loads."""
    seal = seal_for_maps(scene.layout, tiles)
    warnings: list[str] = []
    if isinstance(pressure_map, PressureField):
        mean, loads = seal.mean(pressure_map), scene.steps.pressures[scene.steps.pressures > 0]
        if loads.size and not loads.min() / _FAR_LOAD < mean < loads.max() * _FAR_LOAD:
            found = to_text(mean, "Pa", 3)
            warnings.append(
                f"the field of pressure has the mean {found} over the seal, far from all loads: is its unit right?"
            )
    elif isinstance(pressure_map, MapsAtLoads):
        for load, one in zip(pressure_map.pressures, pressure_map.maps, strict=True):
            if isinstance(one, PressureField) and abs((mean := seal.mean(one)) - load) > _OFF_LOAD * load:
                found, at = to_text(mean, "Pa", 3), to_text(load, "Pa", 3)
                warnings.append(
                    f"the field of pressure at {at} has the mean {found} over the seal: it is scaled to the load"
                )
    return tuple(warnings)


def describe_map(scene: Scene, tiles: SealTiles, pressure_map: AnyMap | SeatMap) -> str:
    """The map as a text: its range in fractions of the nominal pressure, and the mean of a field; "" if uniform."""
    if isinstance(pressure_map, SeatMap):
        return "that of the rows of the seat in plane strain, the measured face being its layer"
    if is_uniform(pressure_map):
        return ""
    fractions = pressure_fractions(scene, tiles, pressure_map)
    text = f"{fractions.min():.3g} to {fractions.max():.3g} of the nominal pressure over the seal"
    seal = seal_for_maps(scene.layout, tiles)
    maps = pressure_map.maps if isinstance(pressure_map, MapsAtLoads) else (pressure_map,)
    means = [to_text(seal.mean(one), "Pa", 3) for one in maps if isinstance(one, PressureField)]
    return text + (f"; mean of the field {' and '.join(means)}, scaled to every load" if means else "")

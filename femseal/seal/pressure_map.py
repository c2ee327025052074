"""Contact pressure over a seal from outside, as fractions of the nominal one: where bolts, waviness or a flange press.

A map gives values at points of a seal; `PressedSeal.fractions` divides them by their mean over the area, so that a map
is a shape which every nominal pressure scales. A map is a frozen dataclass with `at`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from math import pi
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, Indices, InputError, Pair, counted, to_text, validate
from .plane import in_space, plane_points, polygon_areas

#: Triangles of Delaunay whose longest side is so many times that of most are gaps between the points, not part of
#: their field. Between points on rings, the triangles that fill the hole are longer than that but for a few at its rim.
GAP = 4.0
#: A point so far outside a triangle, in fractions of its heights, takes its values: chords cut the arcs of a ring.
OUTSIDE = 0.1
#: Rounding of coordinates, as fractions of a strip of a profile or of a radius.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Frame:
    """Coordinates of a seal, from the plane in which its parts lie.

    size : sides of a strip along x1 and x2 [m]; None of seals around a centre.
    centre : of other seals [m].
    ends : distance from the inlet along x1, or radius, at the inlet and at the outlet [m]; None where they are no lines
        of one value.
    """

    size: Pair | None = None
    centre: Pair = (0.0, 0.0)
    ends: Pair | None = None

    @classmethod
    def of_strip(cls, size: Pair) -> Frame:
        """A strip of sides [m], inlet at x1 = 0."""
        return cls(size=size, ends=(0.0, size[0]))

    def across(self, points: Array) -> Array:
        """x1 on a strip, else the radius (n,) [m]."""
        return points[:, 0] if self.size else np.hypot(*(points - self.centre).T)

    def angle(self, points: Array) -> Array:
        """Once around the seal (n,) [rad]: 2π x2/L2 on a strip, else the polar angle."""
        if self.size:
            return 2 * pi * points[:, 1] / self.size[1]
        x, y = (points - self.centre).T
        return np.arctan2(y, x)


class PressureMap(Protocol):
    """Interface of the maps."""

    def at(self, points: Array, frame: Frame) -> Array:
        """Values (n,) >= 0 at points (n, 2) [m] of a seal, in any unit.

        Raises InputError: the map does not cover the points.
        """
        ...


@dataclass(frozen=True)
class Uniform:
    """The nominal pressure everywhere."""

    def at(self, points: Array, frame: Frame) -> Array:
        """Ones."""
        return np.ones(len(points))


@dataclass(frozen=True)
class Profile:
    """Pressure from the inlet to the outlet.

    Parameters
    ----------
    fractions : numbers >= 0 in any unit, the first at the inlet.
    positions : where they are, rising [m]: x1 of a strip, from its inlet; radius of a ring or a mesh, whatever its
        inlet. Between them the pressure is linear. Without them the numbers are those of strips of equal breadth.

    Raises
    ------
    InputError : bad numbers, or positions that do not rise or are not as many.
    """

    fractions: tuple[float, ...]
    positions: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "fractions", _fractions(self.fractions))
        positions = _rising("positions", self.positions, len(self.fractions), "[m]")
        object.__setattr__(self, "positions", positions)

    def at(self, points: Array, frame: Frame) -> Array:
        """Linear between positions; else that of the strip, at an edge the mean of both."""
        values, across = np.array(self.fractions), frame.across(points)
        if self.positions:
            low, high = self.positions[0], self.positions[-1]
            least, most = float(across.min()), float(across.max())
            if least < low - _ROUNDING * high or most > high * (1 + _ROUNDING):
                given, needed = (
                    f"{to_text(a, 'm')} to {to_text(b, 'm')}"
                    for a, b in ((low, high), (least, most))
                )
                raise InputError("positions", given, f"one that holds all tiles, {needed}")
            return np.interp(across, self.positions, values)
        if frame.ends is None:
            raise InputError("positions", "none on a mesh", "radii [m]")
        first, last = frame.ends
        strip = (across - first) / (last - first) * values.size
        sides = np.floor([strip - _ROUNDING, strip + _ROUNDING]).astype(int)
        return values[np.clip(sides, 0, values.size - 1)].mean(axis=0)


@dataclass(frozen=True)
class AngleTable:
    """Pressure around the seal, linear between the angles and periodic, such as under bolts or of a wavy flange.

    Parameters
    ----------
    fractions : numbers >= 0 in any unit.
    angles : where they are, rising from >= 0 to below one period [rad]; equally spaced from 0 unless given. On a strip
        2π is its length.
    repeat : the number of periods around the seal.

    Raises
    ------
    InputError : bad numbers, or angles that do not rise, are not as many or reach beyond the period.
    """

    fractions: tuple[float, ...]
    angles: tuple[float, ...] = ()
    repeat: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "fractions", _fractions(self.fractions))
        object.__setattr__(self, "repeat", validate.count("repeat", self.repeat))
        period = 2 * pi / self.repeat
        angles = _rising("angles", self.angles, len(self.fractions), "[rad]")
        object.__setattr__(self, "angles", angles)
        if self.angles and not 0 <= self.angles[0] <= self.angles[-1] < period * (1 - 1e-12):
            given = f"{np.degrees(self.angles[0]):g}° to {np.degrees(self.angles[-1]):g}°"
            raise InputError(
                "angles", given, f"some from 0° to below one period, {np.degrees(period):g}°"
            )

    def at(self, points: Array, frame: Frame) -> Array:
        """Linear and periodic."""
        period = 2 * pi / self.repeat
        angles = self.angles or np.arange(len(self.fractions)) * (period / len(self.fractions))
        return np.interp(frame.angle(points) % period, angles, self.fractions, period=period)


@dataclass(frozen=True, eq=False)
class PressureField:
    """A field in the plane of the seal, such as a flange calculation gives, linear on triangles; see `of`.

    points : x1 and x2 of a strip, else in the plane of the seal (m, 2) [m]. triangles : between them (t, 3).
    pressure : of the points (m,) [Pa].
    """

    points: Array = field(repr=False)
    triangles: Indices = field(repr=False)
    pressure: Array = field(repr=False)

    @classmethod
    def of(
        cls, points: ArrayLike, pressure: ArrayLike, triangles: ArrayLike | None = None
    ) -> PressureField:
        """Check and take a field.

        Parameters
        ----------
        points : (m, 2) [m].
        pressure : (m,) >= 0 [Pa].
        triangles : corners (t, 3); those of Delaunay unless given, without those so long that they are gaps.

        Raises
        ------
        InputError : numbers that are not finite, negative pressures, points on a line.
        """
        found = plane_points("points", points)
        corners = _delaunay(found) if triangles is None else np.array(triangles, dtype=np.int64)
        size = np.ptp(found, axis=0).max()
        corners = corners[np.abs(polygon_areas(found[corners])) > 1e-12 * size**2]
        if not len(corners):
            raise InputError("points", f"{len(found)} points on a line", "some in a plane")
        return cls(found, corners, _pressures(pressure, len(found)))

    def at(self, points: Array, frame: Frame) -> Array:
        """Linear on the triangle around each point [Pa]; just outside of all, that of the nearest triangle."""
        triangle, weights = self._around(points)
        uncovered = np.flatnonzero(weights.min(axis=1) < -OUTSIDE)
        if uncovered.size:
            ends = zip("xy", self.points.min(axis=0), self.points.max(axis=0), strict=True)
            ranges = ", ".join(f"{name} {low:.4g} to {high:.4g} m" for name, low, high in ends)
            x, y = points[uncovered[0]]
            given = f"{ranges}, without places on the seal such as ({x:.4g}, {y:.4g}) m"
            raise InputError("field", given, "one that covers the seal")
        inside = np.maximum(weights, 0)
        inside /= inside.sum(axis=1, keepdims=True)
        return (inside * self.pressure[self.triangles[triangle]]).sum(axis=1)

    def _around(self, patches: Array) -> tuple[Indices, Array]:
        """Triangle around each patch, or nearest to it, and the place in it by its three weights."""
        import pyvista

        points, corners = in_space(self.points), self.triangles.astype(int)
        surface = pyvista.PolyData.from_regular_faces(points, corners)
        triangle = np.atleast_1d(surface.find_closest_cell(in_space(patches)))
        first, *others = np.moveaxis(self.points[self.triangles[triangle]], 1, 0)
        ways = np.stack([other - first for other in others], axis=-1)
        weights = np.linalg.solve(ways, (patches - first)[..., None])[..., 0]
        return triangle, np.column_stack([1 - weights.sum(axis=1), weights])


def _delaunay(points: Array) -> Indices:
    """Corners of the triangles between points but those that are gaps; none where the points lie on a line."""
    from scipy.spatial import Delaunay, QhullError

    try:
        # the size of the whole does not matter to what lies on a line
        size = np.ptp(points, axis=0).max() or 1.0
        corners = Delaunay((points - points.mean(axis=0)) / size).simplices
    except QhullError:
        return np.empty((0, 3), np.int64)
    ways = points[corners] - np.roll(points[corners], 1, axis=1)
    sides = np.linalg.norm(ways, axis=2).max(axis=1)
    return np.asarray(corners[sides <= GAP * np.median(sides)], np.int64)


@dataclass(frozen=True, eq=False)
class MapsAtLoads:
    """Maps at several nominal pressures: between them the fractions are linear in the pressure, beyond constant.

    On unloading the fractions are those of the nominal pressure there, as where a flange bends elastically.

    Raises InputError: no map, or pressures that do not rise or are not as many.
    """

    pressures: tuple[float, ...]
    maps: tuple[PressureMap, ...]

    def __post_init__(self) -> None:
        if not self.maps:
            raise InputError("maps", "none", "at least one")
        if len(self.pressures) != len(self.maps):
            raise InputError(
                "pressures",
                counted(len(self.pressures), "number"),
                f"{len(self.maps)}, one for each map",
            )
        pressures = _rising("pressures", self.pressures, len(self.maps), "[Pa]")
        object.__setattr__(self, "pressures", pressures)


#: What fractions can be taken from.
AnyMap = PressureMap | MapsAtLoads


def is_uniform(pressure_map: Any) -> bool:
    """Whether the nominal pressure acts everywhere."""
    return isinstance(pressure_map, Uniform)


@dataclass(frozen=True, eq=False)
class PressedSeal:
    """A seal for maps: its frame, and the corners of the parts of its area (n, corners, 2) [m]."""

    frame: Frame
    outlines: Array = field(repr=False)

    @property
    def centres(self) -> Array:
        """Middles of the parts (n, 2) [m]."""
        return self.outlines.mean(axis=1)

    @property
    def areas(self) -> Array:
        """Areas of the parts (n,) [m²]."""
        return np.abs(polygon_areas(self.outlines))

    def mean(self, pressure_map: PressureMap) -> float:
        """Mean of a map over the area, in the unit of the map."""
        return float(np.average(pressure_map.at(self.centres, self.frame), weights=self.areas))

    def fractions(self, pressure_map: AnyMap, points: Array, nominal: ArrayLike) -> Array:
        """Contact pressure at points as fractions of the nominal one (steps, n); their mean over the area is 1.

        Parameters
        ----------
        points : (n, 2) [m]. nominal : nominal pressure of every step (steps,) [Pa].

        Raises
        ------
        InputError : the map does not cover the seal, or is 0 all over it.
        """
        loads = np.atleast_1d(np.asarray(nominal, float))
        maps = pressure_map.maps if isinstance(pressure_map, MapsAtLoads) else (pressure_map,)
        known = np.array([self._mean_one(one, points) for one in maps])
        if not isinstance(pressure_map, MapsAtLoads) or len(known) == 1:
            return np.broadcast_to(known[0], (loads.size, len(points)))
        knots = pressure_map.pressures
        place = np.interp(loads, knots, np.arange(len(knots)))
        below = np.minimum(place.astype(int), len(knots) - 2)
        weight = (place - below)[:, None]
        return (1 - weight) * known[below] + weight * known[below + 1]

    def _mean_one(self, pressure_map: PressureMap, points: Array) -> Array:
        over_area, values = (pressure_map.at(where, self.frame) for where in (self.centres, points))
        if not over_area.max() > 0:
            raise InputError("map", "a pressure that is 0 all over the seal", "one > 0 somewhere")
        highest = over_area.max()  # a map of one value has no rounding
        return values / highest / np.average(over_area / highest, weights=self.areas)


def _numbers(name: str, values: Any, expected: str, **limits: Any) -> tuple[float, ...]:
    """Numbers of a list; InputError where it is none."""
    try:
        return tuple(validate.number(name, v, **limits) for v in values)
    except TypeError:
        raise InputError(name, repr(values), expected) from None


def _fractions(values: Any) -> tuple[float, ...]:
    fractions = _numbers("fractions", values, "a list of numbers >= 0", inclusive=True)
    if not fractions or not max(fractions) > 0:
        raise InputError("fractions", values, "a list of numbers >= 0, not all of them 0")
    return fractions


def _rising(name: str, values: Any, count: int, unit: str) -> tuple[float, ...]:
    """Rising numbers, as many as `count`, or none; InputError of anything else."""
    numbers = _numbers(name, values, f"a list of numbers {unit}", above=-np.inf)
    if numbers and len(numbers) != count:
        raise InputError(name, counted(len(numbers), "number"), f"{count}, one for each value")
    if any(b <= a for a, b in pairwise(numbers)):
        raise InputError(name, list(numbers), f"rising numbers {unit}")
    return numbers


def _pressures(values: ArrayLike, count: int) -> Array:
    """Contact pressures >= 0, one for each point; InputError of anything else."""
    pressure = np.array(values, dtype=float)
    if pressure.shape != (count,):
        raise InputError("pressure", f"shape {pressure.shape}", f"{(count,)}, one for each point")
    if bad := np.count_nonzero(~np.isfinite(pressure) | (pressure < 0)):
        least = to_text(float(pressure.min()), "Pa")
        given = f"{bad} of {count} values not finite or negative, the least {least}"
        raise InputError("pressure", given, "finite contact pressures >= 0 [Pa]")
    return pressure

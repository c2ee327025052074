"""Describe how the contact pressure varies over a seal, due to bolts, waviness or the bending of a flange.

A pressure map only describes the distribution of the contact pressure; the mean pressure is the nominal pressure of the
load step. The values of a pressure map can therefore have any unit. `PressedSeal.fractions` divides the values of a map
by their mean over the seal. Each kind of pressure map is a frozen dataclass, whose method `at` returns the values at
points of a seal.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from math import pi
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, Indices, InputError, counted, to_text, validate
from .frame import Frame
from .plane import in_space, plane_points, polygon_areas

#: A Delaunay triangle is treated as a gap in the field, such as the hole of a ring, if its longest side is more than
#: this many times the median of the longest sides of all triangles. On rings, all triangles in the hole are removed
#: except a few at the rim of the hole.
GAP = 4.0
#: A point outside of all triangles takes the pressure of the nearest triangle, if its distance is at most this fraction
#: of the height of the triangle. On a ring, some points are outside of all triangles, because straight edges cut off
#: the arcs.
OUTSIDE = 0.1
#: Allowed rounding error of a coordinate, as a fraction of the radius or of the width of a section of a profile.
_ROUNDING = 1e-9


class PressureMap(Protocol):
    """Define the method that a pressure map needs."""

    def at(self, points: Array, frame: Frame) -> Array:
        """Return the values of the pressure map at points of a seal.

        Parameters
        ----------
        points : array, (n, 2)
            Points in the plane of the seal [m].
        frame : Frame
            Coordinates of the seal.

        Returns
        -------
        array, (n,)
            Values >= 0 in any unit.

        Raises
        ------
        InputError
            The map does not cover the points.
        """
        ...


@dataclass(frozen=True)
class Uniform:
    """Describe a pressure that is equal to the nominal pressure everywhere."""

    def at(self, points: Array, frame: Frame) -> Array:
        """Return the value 1 at each point."""
        return np.ones(len(points))


@dataclass(frozen=True)
class Profile:
    """Describe a pressure that varies only between inlet and outlet.

    Parameters
    ----------
    fractions : tuple of float
        Values >= 0 in any unit.
    positions : tuple of float
        Increasing positions of the values [m]: the distance from the inlet of a strip, or the radius on a ring or mesh.
        The pressure is linear between two positions. If no positions are given, the seal is divided into sections of
        equal width with a uniform pressure in each section. The first value belongs to the section at the inlet.

    Raises
    ------
    InputError
        A number is invalid, the positions do not increase, or the numbers of positions and values differ.
    """

    fractions: tuple[float, ...]
    positions: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "fractions", _fractions(self.fractions))
        positions = _rising("positions", self.positions, len(self.fractions), "[m]")
        object.__setattr__(self, "positions", positions)

    def at(self, points: Array, frame: Frame) -> Array:
        """Return the values (n,) at points (n, 2) [m] of a seal.

        The values are interpolated linearly between the positions. A profile without positions is constant in each
        section; at a point on the edge between two sections, the mean of the two values is returned.
        """
        values = np.array(self.fractions)
        across = frame.across(points)
        if self.positions:
            first, last = self.positions[0], self.positions[-1]
            lowest, highest = float(across.min()), float(across.max())
            if lowest < first - _ROUNDING * last or highest > last * (1 + _ROUNDING):
                given, needed = (
                    f"{to_text(start, 'm')} to {to_text(end, 'm')}"
                    for start, end in ((first, last), (lowest, highest))
                )
                raise InputError("positions", given, f"positions that cover all tiles, {needed}")
            return np.interp(across, self.positions, values)
        if frame.ends is None:
            raise InputError("positions", "none on a mesh", "radii [m]")
        inlet, outlet = frame.ends
        # index of the section in which each point lies, as a real number
        section = (across - inlet) / (outlet - inlet) * values.size
        # Sections on both sides of each point, (side, point). The two sections differ only for a point on an edge.
        both_sides = np.floor([section - _ROUNDING, section + _ROUNDING]).astype(int)
        return values[np.clip(both_sides, 0, values.size - 1)].mean(axis=0)


@dataclass(frozen=True)
class AngleTable:
    """Describe a pressure that varies only around the seal, for example due to bolts or to a wavy flange.

    The pressure is periodic around the seal and is interpolated linearly between the given angles.

    Parameters
    ----------
    fractions : tuple of float
        Values >= 0 in any unit.
    angles : tuple of float
        Increasing angles of the values [rad], at least 0 and less than one period. By default, the angles are equally
        spaced and begin at 0. On a strip, the angle 2π corresponds to the length of the strip.
    repeat : int
        Number of periods around the seal.

    Raises
    ------
    InputError
        A number is invalid, the angles do not increase, an angle exceeds the period, or the numbers of angles and
        values differ.
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
                "angles", given, f"angles from 0° to less than one period, {np.degrees(period):g}°"
            )

    def at(self, points: Array, frame: Frame) -> Array:
        """Interpolate the values (n,) at points (n, 2) [m] of a seal."""
        period = 2 * pi / self.repeat
        angles = self.angles or np.arange(len(self.fractions)) * (period / len(self.fractions))
        return np.interp(frame.angle(points) % period, angles, self.fractions, period=period)


@dataclass(frozen=True, eq=False)
class PressureField:
    """A pressure field in the plane of the seal, such as the result of a flange calculation.

    Use the method `from_points` to create a pressure field. The pressure is interpolated linearly on triangles.

    Attributes
    ----------
    points : array, (m, 2)
        Coordinates [m]: x1 and x2 on a strip, x and y in the plane of other seals.
    triangles : array of int, (t, 3)
        Indices of the points at the corners of each triangle.
    pressure : array, (m,)
        Pressure at the points [Pa].
    """

    points: Array = field(repr=False)
    triangles: Indices = field(repr=False)
    pressure: Array = field(repr=False)

    @classmethod
    def from_points(
        cls, points: ArrayLike, pressure: ArrayLike, triangles: ArrayLike | None = None
    ) -> PressureField:
        """Create a pressure field from pressures at points.

        Parameters
        ----------
        points : array, (m, 2)
            Coordinates [m].
        pressure : array, (m,)
            Pressure at the points, >= 0 [Pa].
        triangles : array of int, (t, 3), optional
            Indices of the points at the corners of each triangle. By default, the points are connected by Delaunay
            triangulation; long triangles that bridge gaps between the points are left out.

        Raises
        ------
        InputError
            A number is not finite, a pressure is negative, or all points lie on a line.
        """
        checked_points = plane_points("points", points)
        if triangles is None:
            corners = _delaunay_without_gaps(checked_points)
        else:
            corners = np.array(triangles, dtype=np.int64)
        size = np.ptp(checked_points, axis=0).max()
        areas = np.abs(polygon_areas(checked_points[corners]))
        corners = corners[areas > 1e-12 * size**2]
        if not len(corners):
            given = f"{len(checked_points)} points on a line"
            raise InputError("points", given, "some in a plane")
        return cls(checked_points, corners, _pressures(pressure, len(checked_points)))

    def at(self, points: Array, frame: Frame) -> Array:
        """Interpolate the pressure field (n,) [Pa] at points (n, 2) [m] of a seal.

        At a point slightly outside of all triangles, the pressure at the edge of the nearest triangle is returned.
        """
        triangle, weights = self._barycentric(points)
        # If a point is outside of a triangle, one of its weights is negative. The absolute value of a negative weight
        # is the distance of the point from the edge, divided by the height of the triangle.
        uncovered = np.flatnonzero(weights.min(axis=1) < -OUTSIDE)
        if uncovered.size:
            ends = zip("xy", self.points.min(axis=0), self.points.max(axis=0), strict=True)
            ranges = ", ".join(f"{name} {low:.4g} to {high:.4g} m" for name, low, high in ends)
            x, y = points[uncovered[0]]
            given = f"{ranges}, without points of the seal such as ({x:.4g}, {y:.4g}) m"
            raise InputError("field", given, "a pressure field that covers the seal")
        # move points that are slightly outside to the edge of the triangle, by setting negative weights to 0
        inside_weights = np.maximum(weights, 0)
        inside_weights /= inside_weights.sum(axis=1, keepdims=True)
        return (inside_weights * self.pressure[self.triangles[triangle]]).sum(axis=1)

    def _barycentric(self, points: Array) -> tuple[Indices, Array]:
        """Find, for each of the points (n, 2), the triangle that contains the point or is nearest to the point.

        Returns the indices of the triangles (n,) and the barycentric coordinates of the points (n, 3). The barycentric
        coordinates are the weights of the corners in the linear interpolation.
        """
        import pyvista

        corners = self.triangles.astype(int)
        surface = pyvista.PolyData.from_regular_faces(in_space(self.points), corners)
        triangle = np.atleast_1d(surface.find_closest_cell(in_space(points)))
        # corners, (n, 2) each
        first, second, third = np.moveaxis(self.points[self.triangles[triangle]], 1, 0)
        # the weights of the second and third corner solve a linear system whose matrix has these edges as columns
        edges = np.stack([second - first, third - first], axis=-1)  # (n, 2, 2)
        weights = np.linalg.solve(edges, (points - first)[..., None])[..., 0]
        return triangle, np.column_stack([1 - weights.sum(axis=1), weights])


def _delaunay_without_gaps(points: Array) -> Indices:
    """Return the Delaunay triangles (t, 3) of points (m, 2), without triangles that bridge a gap between the points.

    If all points lie on a line, the returned array is empty (t = 0).
    """
    from scipy.spatial import Delaunay, QhullError

    try:
        # Qhull has absolute tolerances, so points are scaled to the size 1
        size = np.ptp(points, axis=0).max() or 1.0
        corners = Delaunay((points - points.mean(axis=0)) / size).simplices
    except QhullError:
        return np.empty((0, 3), np.int64)
    edges = points[corners] - np.roll(points[corners], 1, axis=1)  # (triangle, edge, 2)
    longest_edge = np.linalg.norm(edges, axis=2).max(axis=1)
    is_gap = longest_edge > GAP * np.median(longest_edge)
    return np.asarray(corners[~is_gap], np.int64)


@dataclass(frozen=True, eq=False)
class MapsAtLoads:
    """Pressure maps for several nominal pressures, for example for a flange that bends with the load.

    Between two nominal pressures, the pressure distribution is interpolated linearly. Below the lowest and above the
    highest nominal pressure, the distribution is constant. The distribution depends only on the current nominal
    pressure and not on the load history, as for a flange that bends elastically.

    Parameters
    ----------
    pressures : tuple of float
        Increasing nominal pressures [Pa].
    maps : tuple of PressureMap
        Pressure map at each nominal pressure.

    Raises
    ------
    InputError
        No map is given, the pressures do not increase, or the numbers of pressures and maps differ.
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


#: Types of maps that `PressedSeal.fractions` accepts.
AnyMap = PressureMap | MapsAtLoads


def is_uniform(pressure_map: Any) -> bool:
    """Return whether a pressure map is uniform, that is, equal to the nominal pressure everywhere."""
    return isinstance(pressure_map, Uniform)


@dataclass(frozen=True, eq=False)
class PressedSeal:
    """Describe a seal by the outlines of its elements, for averages of pressure maps over the area of the seal.

    Attributes
    ----------
    frame : Frame
        Coordinates of the seal.
    outlines : array, (n, corners, 2)
        Corners of the elements that cover the seal [m].
    """

    frame: Frame
    outlines: Array = field(repr=False)

    @property
    def centres(self) -> Array:
        """Centres of the elements (n, 2) [m]."""
        return self.outlines.mean(axis=1)

    @property
    def areas(self) -> Array:
        """Areas of the elements (n,) [m²]."""
        return np.abs(polygon_areas(self.outlines))

    def mean(self, pressure_map: PressureMap) -> float:
        """Return the mean of a map over the seal, in the unit of the map."""
        return float(np.average(pressure_map.at(self.centres, self.frame), weights=self.areas))

    def fractions(self, pressure_map: AnyMap, points: Array, nominal: ArrayLike) -> Array:
        """Return the ratio of the contact pressure at points of the seal to the nominal pressure.

        Parameters
        ----------
        pressure_map : PressureMap or MapsAtLoads
            Map of the contact pressure over the seal.
        points : array, (n, 2)
            Points in the plane of the seal [m].
        nominal : array, (steps,)
            Nominal pressure of each load step [Pa].

        Returns
        -------
        array, (steps, n)
            Ratio of contact pressure to nominal pressure, whose mean over the seal is 1.

        Raises
        ------
        InputError
            The map does not cover the seal, or is 0 everywhere.
        """
        loads = np.atleast_1d(np.asarray(nominal, float))
        maps = pressure_map.maps if isinstance(pressure_map, MapsAtLoads) else (pressure_map,)
        tabulated = np.array([self._normalised(single_map, points) for single_map in maps])
        if not isinstance(pressure_map, MapsAtLoads) or len(tabulated) == 1:
            return np.broadcast_to(tabulated[0], (loads.size, len(points)))
        # linear interpolation between the maps below and above each load
        map_pressures = pressure_map.pressures
        # index of the map for each load, as a real number
        position = np.interp(loads, map_pressures, np.arange(len(map_pressures)))
        below = np.minimum(position.astype(int), len(map_pressures) - 2)
        weight = (position - below)[:, None]  # weight of the map above the load
        return (1 - weight) * tabulated[below] + weight * tabulated[below + 1]

    def _normalised(self, pressure_map: PressureMap, points: Array) -> Array:
        """Return the values (n,) of a map at points (n, 2), divided by the mean of the map over the seal."""
        at_centres = pressure_map.at(self.centres, self.frame)
        values = pressure_map.at(points, self.frame)
        highest = at_centres.max()
        if not highest > 0:
            raise InputError(
                "map", "a pressure that is 0 all over the seal", "a pressure > 0 at some point"
            )
        # the values are first divided by the highest value, so that the fractions of a uniform map are exactly 1
        return values / highest / np.average(at_centres / highest, weights=self.areas)


def _numbers(name: str, values: Any, expected: str, **limits: Any) -> tuple[float, ...]:
    """Check a list of numbers and return the numbers as a tuple; raise InputError for anything else.

    expected : description of the expected values, for the message.
    limits : limits of the numbers, see `validate.number`.
    """
    try:
        return tuple(validate.number(name, v, **limits) for v in values)
    except TypeError:
        raise InputError(name, repr(values), expected) from None


def _fractions(values: Any) -> tuple[float, ...]:
    """Check that all numbers are >= 0 and at least one is > 0, and return the numbers as a tuple."""
    fractions = _numbers("fractions", values, "a list of numbers >= 0", inclusive=True)
    if not fractions or not max(fractions) > 0:
        raise InputError("fractions", values, "a list of numbers >= 0, not all of them 0")
    return fractions


def _rising(name: str, values: Any, count: int, unit: str) -> tuple[float, ...]:
    """Check that `values` are `count` increasing numbers, or an empty list, and return the numbers as a tuple."""
    numbers = _numbers(name, values, f"a list of numbers {unit}", above=-np.inf)
    if numbers and len(numbers) != count:
        raise InputError(name, counted(len(numbers), "number"), f"{count}, one for each value")
    if any(b <= a for a, b in pairwise(numbers)):
        raise InputError(name, list(numbers), f"rising numbers {unit}")
    return numbers


def _pressures(values: ArrayLike, count: int) -> Array:
    """Check that `values` are `count` finite contact pressures >= 0, and return the pressures as an array."""
    pressure = np.array(values, dtype=float)
    if pressure.shape != (count,):
        raise InputError("pressure", f"shape {pressure.shape}", f"{(count,)}, one for each point")
    bad = np.count_nonzero(~np.isfinite(pressure) | (pressure < 0))
    if bad:
        least = to_text(float(pressure.min()), "Pa")
        given = f"{bad} of {count} values not finite or negative, the least {least}"
        raise InputError("pressure", given, "finite contact pressures >= 0 [Pa]")
    return pressure

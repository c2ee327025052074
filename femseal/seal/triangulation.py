"""Triangles in a plane and linear interpolation on them, also at points that lie just outside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, Indices, InputError, Pair, Shape, validate

#: Triangles of Delaunay whose longest side is so many times that of most are gaps between the points, not part of
#: their field. Between points on rings, the triangles that fill the hole are longer than that but for a few at its rim.
GAP = 4.0
#: A point so far outside a triangle, in fractions of its heights, takes its values: chords cut the arcs of a ring.
OUTSIDE = 0.1


@dataclass(frozen=True, eq=False)
class Triangulation:
    """Points (m, 2) [m] and the triangles (t, 3) between them."""

    points: Array
    triangles: Indices

    @classmethod
    def of(cls, points: ArrayLike, triangles: ArrayLike | None = None) -> Triangulation:
        """Check points and triangles; without triangles, take those of Delaunay that are no gaps.

        Raises InputError: points that are no finite pairs, all on a line, or triangles without area only.
        """
        found = plane_points("points", points)
        corners = _delaunay(found) if triangles is None else np.array(triangles, dtype=np.int64)
        size = np.ptp(found, axis=0).max()
        corners = corners[np.abs(polygon_areas(found[corners])) > 1e-12 * size**2]
        if not len(corners):
            raise InputError("points", f"{len(found)} points on a line", "some in a plane")
        return cls(found, corners)

    def interpolate(self, values: Array, places: Array) -> Array:
        """Linear interpolation of values (m,) of the points at places (n, 2); outside, the nearest of the triangle.

        Raises InputError: a place that no triangle covers.
        """
        triangle, weights = self._around(places)
        uncovered = np.flatnonzero(weights.min(axis=1) < -OUTSIDE)
        if uncovered.size:
            ends = zip("xy", self.points.min(axis=0), self.points.max(axis=0), strict=True)
            ranges = ", ".join(f"{name} {low:.4g} to {high:.4g} m" for name, low, high in ends)
            x, y = places[uncovered[0]]
            given = f"{ranges}, without places on the seal such as ({x:.4g}, {y:.4g}) m"
            raise InputError("field", given, "one that covers the seal")
        inside = np.maximum(weights, 0)
        inside /= inside.sum(axis=1, keepdims=True)
        return (inside * values[self.triangles[triangle]]).sum(axis=1)

    def _around(self, places: Array) -> tuple[Indices, Array]:
        """Triangle around each place, or nearest to it, and the place in it by its three weights."""
        import pyvista

        points, corners = in_space(self.points), self.triangles.astype(int)
        surface = pyvista.PolyData.from_regular_faces(points, corners)
        triangle = np.atleast_1d(surface.find_closest_cell(in_space(places)))
        corner = np.moveaxis(self.points[self.triangles[triangle]], 1, 0)
        a, b, d = corner[1] - corner[0], corner[2] - corner[0], places - corner[0]
        second, third = cross(d, b) / cross(a, b), cross(a, d) / cross(a, b)
        return triangle, np.stack([1 - second - third, second, third], axis=1)


def plane_points(name: str, given: ArrayLike) -> Array:
    """Three finite points or more in a plane (n, 2) [m]; InputError of anything else."""
    points = validate.field(name, given, unit="m")
    if points.shape[1] != 2 or len(points) < 3:
        raise InputError(name, f"shape {points.shape}", "at least three points (n, 2) [m]")
    return points


def middles(size: Pair, cells: Shape) -> Array:
    """Middles (n, 2) of equal cells of a rectangle, row by row."""
    first, second = ((np.arange(n) + 0.5) * (side / n) for side, n in zip(size, cells, strict=True))
    return np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)


def in_space(points: Array) -> Array:
    """Points (n, 3) of a plane, from (n, 2)."""
    return np.pad(points, ((0, 0), (0, 1)))


def cross(a: Array, b: Array) -> Array:
    """The products a × b (n,) of vectors (n, 2)."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _delaunay(points: Array) -> Indices:
    """Corners of the triangles between points; none where these lie on a line."""
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


def polygon_areas(corners: Array) -> Array:
    """Areas (n,) [m²] of polygons with corners (n, corners, 2) [m], negative where these run clockwise."""
    x, y = np.moveaxis(corners - corners[:, :1], -1, 0)
    return (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1) / 2

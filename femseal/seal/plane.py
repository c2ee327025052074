"""Check points in a plane, divide rectangles into cells, and compute areas of polygons."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, InputError, Pair, Shape, validate


def plane_points(name: str, given: ArrayLike) -> Array:
    """Check that `given` consists of at least three finite points (n, 2) [m], and return them as an array.

    For any other value, an InputError is raised that names the argument `name`.
    """
    points = validate.field(name, given, unit="m")
    if points.shape[1] != 2 or len(points) < 3:
        raise InputError(name, f"shape {points.shape}", "at least three points (n, 2) [m]")
    return points


def middles(size: Pair, cells: Shape) -> Array:
    """Divide a rectangle of the given size [m] into equal cells, and return their centres (n, 2) [m], row by row."""
    x1, x2 = ((np.arange(n) + 0.5) * (side / n) for side, n in zip(size, cells, strict=True))
    return np.stack(np.meshgrid(x1, x2, indexing="ij"), axis=-1).reshape(-1, 2)


def in_space(points: Array) -> Array:
    """Add a third coordinate z = 0 to points (n, 2) of a plane, because VTK expects three coordinates."""
    return np.pad(points, ((0, 0), (0, 1)))


def polygon_areas(corners: Array) -> Array:
    """Return areas (n,) [m²] of polygons with corners (n, corners, 2) [m]; clockwise polygons have negative areas."""
    # Coordinates are measured from the first corner of each polygon, because the shoelace formula is inaccurate far
    # from the origin.
    x, y = np.moveaxis(corners - corners[:, :1], -1, 0)
    return (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1) / 2

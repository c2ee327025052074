"""Points, cells and polygons in a plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, InputError, Pair, Shape, validate


def plane_points(name: str, given: ArrayLike) -> Array:
    """Return at least three finite points (n, 2) [m] as an array; raise InputError if they are anything else."""
    points = validate.field(name, given, unit="m")
    if points.shape[1] != 2 or len(points) < 3:
        raise InputError(name, f"shape {points.shape}", "at least three points (n, 2) [m]")
    return points


def middles(size: Pair, cells: Shape) -> Array:
    """Return the centres (n, 2) of equal cells of a rectangle, row by row."""
    x1, x2 = ((np.arange(n) + 0.5) * (side / n) for side, n in zip(size, cells, strict=True))
    return np.stack(np.meshgrid(x1, x2, indexing="ij"), axis=-1).reshape(-1, 2)


def in_space(points: Array) -> Array:
    """Add a third coordinate z = 0 to points (n, 2) of a plane, as VTK expects it."""
    return np.pad(points, ((0, 0), (0, 1)))


def polygon_areas(corners: Array) -> Array:
    """Return areas (n,) [m²] of polygons with corners (n, corners, 2) [m]; clockwise polygons have negative areas."""
    # the shoelace formula loses digits far from the origin, so count from the first corner of each polygon
    x, y = np.moveaxis(corners - corners[:, :1], -1, 0)
    return (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1) / 2

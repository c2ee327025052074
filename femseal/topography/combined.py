"""Combine two faces in contact into one map, whose gap to a rigid flat is the gap between the two faces.

The second face is mirrored, rotated, shifted and interpolated on the grid of the first face. Symbols: p is the position
of a point, measured from the middle of the first face [m]; u is the position of the same point, measured from the
middle of the second face [m]. Both positions are related by p = s + R(θ) M u, where the matrix M reverses the mirrored
axis, the matrix R(θ) rotates by the angle θ, and s is the shift [m].
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Flags, InputError, Labelled, Pair, Shape, as_text, labelled, validate
from .patches import check_single_patch
from .topography import Topography


@dataclass(frozen=True)
class Overlap(Labelled):
    """Describe the area in which two faces overlap, and state whether the second face was interpolated."""

    shape: Shape = labelled("points of the overlap")
    size: Pair = labelled("size of the overlap", "m")
    fraction: float = labelled("overlap, of the first face", percent=True)
    resampled: bool = labelled("second face interpolated")


def combine(
    first: Topography,
    second: Topography,
    *,
    mirror: Literal["x1", "x2"] | None = None,
    rotate: float = 0.0,
    shift: Pair = (0.0, 0.0),
) -> tuple[Topography, Overlap]:
    """Add the heights of two faces where they overlap.

    The gap between the two faces is the gap between the map of the added heights and a rigid flat.

    The second face is mirrored, then rotated about its centre, and finally shifted relative to the centre of the first
    face.

    If the two faces have the same size and coincide, the second face is interpolated by its Fourier series. The
    resulting map is periodic along an axis if both faces are periodic along this axis.

    In all other cases, waves of the second face that are shorter than two pixels of the first face are removed, and the
    second face is interpolated by cubic splines. The resulting map is the largest rectangle that both faces cover, and
    is not periodic.

    Parameters
    ----------
    first, second : Topography
        The faces, without undefined points.
    mirror : {"x1", "x2"}, optional
        Axis along which the second face is reversed. Turning the second face over to meet the first face reverses one
        axis.
    rotate : float
        Angle by which the second face is rotated from x1 towards x2 [rad].
    shift : tuple of two float
        Shift of the second face along x1 and x2 [m].

    Returns
    -------
    topography : Topography
        Map of the added heights.
    overlap : Overlap
        Size of the overlap.

    Raises
    ------
    InputError
        A face has undefined points, an argument is invalid, or the faces do not overlap.

    Examples
    --------
    >>> from femseal.topography import self_affine
    >>> first, second = (self_affine((64, 64), (1e-4, 1e-4), hurst=0.8, rms_height=1e-6, rng=n) for n in (1, 2))
    >>> both, overlap = combine(first, second, mirror="x2")
    >>> both.shape, bool(both.rms_height > first.rms_height)
    ((64, 64), True)
    """
    if mirror not in (None, "x1", "x2"):
        raise InputError("mirror", repr(mirror), "None, 'x1' or 'x2'")
    check_single_patch("first face", first)
    check_single_patch("second face", second)
    angle = validate.number("rotate", rotate, unit="rad", above=-np.inf)
    shift_vector = np.array([validate.number("shift", s, unit="m", above=-np.inf) for s in shift])
    if mirror is not None:
        second = second.flip(int(mirror == "x2"))
    has_same_size = np.allclose(first.size, second.size, rtol=1e-9, atol=0)
    if angle == 0 and not shift_vector.any() and has_same_size:
        return _add_coinciding(first, second)
    return _add_overlapping(first, second, angle, shift_vector)


def _add_coinciding(first: Topography, second: Topography) -> tuple[Topography, Overlap]:
    """Add two faces of the same size that coincide."""
    on_grid = second.resample(first.shape)
    both = first + Topography(on_grid.heights, first.spacing, on_grid.periodic)
    return both, Overlap(both.shape, both.size, 1.0, first.shape != second.shape)


def _add_overlapping(
    first: Topography, second: Topography, angle: float, shift: NDArray
) -> tuple[Topography, Overlap]:
    """Add two faces over the largest rectangle that both cover, using the pixels of the first face.

    angle : rotation of the second face [rad].
    shift : shift of the second face along x1 and x2, (2,) [m].
    """
    if second.undefined_fraction:
        expected = "a map without undefined points: use fill_undefined() first"
        raise InputError("second face", "undefined points", expected)
    index = _index_into_second(first, second, angle, shift)  # (axis, n1, n2)
    # a point is covered up to half a pixel beyond the first and the last pixel centre of the second face
    middle = (np.array(second.shape)[:, None, None] - 1) / 2
    is_covered = np.all(np.abs(index - middle) <= (middle + 0.5) * (1 + 1e-9), axis=0)
    if not is_covered.any():
        size = as_text(second.size, "m")
        expected = f"a shift after which the second face, {size}, still overlaps the first"
        raise InputError("shift", as_text(tuple(shift), "m"), expected)
    rows, columns = _largest_rectangle(is_covered)
    if min(second.spacing) < max(first.spacing):
        second = second.low_pass(2 * max(first.spacing))
    # beyond its outermost pixel centres a face continues as its mirror image, as everywhere in femseal
    heights = scipy.ndimage.map_coordinates(
        second.heights, index[:, rows, columns], order=3, mode="reflect"
    )
    below = first.crop(heights.shape, (rows.start, columns.start))
    both = below + Topography(heights, first.spacing, (False, False))
    return both, Overlap(both.shape, both.size, both.heights.size / first.heights.size, True)


def _index_into_second(
    first: Topography, second: Topography, angle: float, shift: NDArray
) -> NDArray:
    """Return the positions on the second face of all pixel centres of the first face.

    The positions are fractional indices into the map of the second face, (axis, n1, n2).
    """
    # u = R(−θ)(p − s), because the second face has been mirrored already; x1 and x2 below are the components of p − s
    x1 = _centred_positions(first.shape[0], first.spacing[0]) - shift[0]
    x2 = _centred_positions(first.shape[1], first.spacing[1]) - shift[1]
    p1, p2 = np.meshgrid(x1, x2, indexing="ij")
    u1 = cos(angle) * p1 + sin(angle) * p2
    u2 = cos(angle) * p2 - sin(angle) * p1
    # the centre of pixel i has the coordinate (i − (n − 1)/2) · spacing
    index1 = u1 / second.spacing[0] + (second.shape[0] - 1) / 2
    index2 = u2 / second.spacing[1] + (second.shape[1] - 1) / 2
    return np.stack([index1, index2])


def _centred_positions(points: int, spacing: float) -> NDArray:
    """Return the pixel centres along an axis, measured from the middle of the map [m]."""
    return (np.arange(points) - (points - 1) / 2) * spacing


def _largest_rectangle(inside: Flags) -> tuple[slice, slice]:
    """Return the rows and columns of the largest rectangle in a convex set of pixels.

    inside : whether each pixel belongs to the set (n1, n2).
    """
    rows = np.flatnonzero(inside.any(axis=1))
    # In each of these rows the set reaches from first_column to end_column, which is excluded. argmax returns the
    # position of the first True.
    first_column = np.argmax(inside[rows], axis=1)
    end_column = inside.shape[1] - np.argmax(inside[rows, ::-1], axis=1)
    largest_area = 0
    for i, row in enumerate(rows):
        # Because the set is convex, a rectangle from row i to a later row lies inside if its first and its last row do.
        first = np.maximum(first_column[i:], first_column[i])
        end = np.minimum(end_column[i:], end_column[i])
        area = (end - first) * (rows[i:] - row + 1)
        j = int(np.argmax(area))
        if area[j] > largest_area:
            largest_area = area[j]
            row_range = slice(int(row), int(rows[i + j]) + 1)
            column_range = slice(int(first[j]), int(end[j]))
    return row_range, column_range

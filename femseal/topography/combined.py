"""Sum of two faces in contact: one map, which has the gap of both where it is pressed on a rigid flat.

The second face is mirrored, rotated, shifted and interpolated on the grid of the first. Symbols: p place in the
plane from the middle of the first face [m], u place on the second from its own middle, p = s + R(θ) M u with the shift
s, the turn R and the mirror image M.
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
    """The area where two faces overlap, and whether the second was interpolated by splines."""

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
    """Sum of two faces where they overlap: the roughness that, pressed on a rigid flat, has the same gap.

    The centres coincide; the second face is mirrored, then rotated, then shifted. If both faces have one size and then
    coincide, the second is interpolated by its Fourier series, and the sum is periodic where both are. Otherwise it is
    interpolated by cubic splines, after waves shorter than two pixels of the first are taken out; the largest rectangle
    that both cover is kept, periodic along no axis.

    Parameters
    ----------
    first, second : the faces, without undefined points.
    mirror : axis along which the second face is reversed, as when it is turned over to meet the first.
    rotate : angle [rad] by which it is turned, from x1 towards x2.
    shift : by which it is moved along x1 and x2 [m].

    Raises
    ------
    InputError : undefined points, an unknown mirror, a number that is not finite, or no overlap.

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
    for name, face in (("first face", first), ("second face", second)):
        check_single_patch(name, face)
    angle = validate.number("rotate", rotate, unit="rad", above=-np.inf)
    move = np.array([validate.number("shift", s, unit="m", above=-np.inf) for s in shift])
    if mirror is not None:
        second = second.flip(int(mirror == "x2"))
    if angle == 0 and not move.any() and np.allclose(first.size, second.size, rtol=1e-9, atol=0):
        on_grid = second.resample(first.shape)
        both = first + Topography(on_grid.heights, first.spacing, on_grid.periodic)
        return both, Overlap(both.shape, both.size, 1.0, first.shape != second.shape)
    if second.undefined_fraction:
        expected = "a map without them: use fill_undefined() first"
        raise InputError("second face", "undefined points", expected)
    index = _indices(first, second, angle, move)
    middle = (np.array(second.shape)[:, None, None] - 1) / 2
    inside = np.all(np.abs(index - middle) <= (middle + 0.5) * (1 + 1e-9), axis=0)
    if not inside.any():
        size = as_text(second.size, "m")
        expected = f"a shift after which the second face, {size}, still overlaps the first"
        raise InputError("shift", as_text(tuple(move), "m"), expected)
    (begin1, end1), (begin2, end2) = _largest_rectangle(inside)
    if min(second.spacing) < max(first.spacing):
        second = second.low_pass(2 * max(first.spacing))
    part = np.s_[:, begin1:end1, begin2:end2]
    # beyond the last centres the faces go on as their mirror image, like everywhere
    heights = scipy.ndimage.map_coordinates(second.heights, index[part], order=3, mode="reflect")
    below = first.crop((end1 - begin1, end2 - begin2), (begin1, begin2))
    both = below + Topography(heights, first.spacing, (False, False))
    return both, Overlap(both.shape, both.size, both.heights.size / first.heights.size, True)


def _indices(first: Topography, second: Topography, angle: float, move: NDArray) -> NDArray:
    """Index (2, n1, n2) into the second face of the pixel centres of the first."""
    p1, p2 = np.meshgrid(
        *(
            (np.arange(n) - (n - 1) / 2) * d - s
            for n, d, s in zip(first.shape, first.spacing, move, strict=True)
        ),
        indexing="ij",
    )
    u = cos(angle) * p1 + sin(angle) * p2, cos(angle) * p2 - sin(angle) * p1
    places = zip(u, second.spacing, second.shape, strict=True)
    return np.stack([along / d + (n - 1) / 2 for along, d, n in places])


def _largest_rectangle(inside: Flags) -> tuple[Shape, Shape]:
    """Rows and columns, first and behind the last, of the largest rectangle in a convex set of pixels."""
    rows = np.flatnonzero(inside.any(axis=1))
    low = np.argmax(inside[rows], axis=1)
    high = inside.shape[1] - np.argmax(inside[rows, ::-1], axis=1)
    # in a convex set the first and the last row bound all rows between
    columns = np.minimum(high[:, None], high) - np.maximum(low[:, None], low)
    area = np.triu((rows - rows[:, None] + 1) * columns)
    i, j = np.unravel_index(int(np.argmax(area)), area.shape)
    return (int(rows[i]), int(rows[j]) + 1), (int(max(low[i], low[j])), int(min(high[i], high[j])))

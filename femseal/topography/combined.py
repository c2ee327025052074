"""One map of several: the sum of two faces in contact, and several measured places of one face side by side.

Sum: the second face is mirrored, rotated, shifted and interpolated on the grid of the first. Symbols: p place in the
plane from the middle of the first face [m], u place on the second from its own middle, p = s + R(θ) M u with the shift
s, the turn R and the mirror image M.

Places: side by side along x2. Contact is solved in each place by itself, and flow through all of them together. What
depends on neighbours, such as waves, slopes and form, is that of each place: the heights do not match where two places
meet.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations
from math import cos, gcd, sin
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Flags, InputError, Labelled, Pair, Shape, as_text, labelled, to_text, validate
from .defects import fit_form
from .topography import Topography

#: Pixels that differ by more than this factor do not carry the same waves; rms heights that differ from the median of
#: all places by more than the second are of another unit; waves, 2π rms height over rms slope, by more than the third
#: of another surface or instrument.
_UNLIKE_PIXELS, _UNLIKE_HEIGHTS, _UNLIKE_WAVES = 4.0, 20.0, 2.5
#: Places of unlike length keep a whole number of parts of this fraction of the shortest.
_PARTS = 8


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


class Places(Topography):
    """Several places of one face as one map (n1, Σ n2), each continued by itself.

    Parameters
    ----------
    places : maps of the same surface. Unlike ones are cut to the breadth of the narrowest, about the middle, and
        resampled to the coarsest pixel, to half a pixel; of unlike lengths along x2 each keeps a whole number of
        eighths of the shortest.

    Raises
    ------
    InputError : fewer than two places, one of them given twice, pixels or heights that are no measurements of the same
        surface, undefined points where the pixels differ.
    """

    #: Points of every place along x2.
    widths: tuple[int, ...]

    def __init__(self, places: Sequence[Topography]) -> None:
        _check(places)
        alike = _alike(places)
        shortest = min(p.shape[1] for p in alike)
        part = shortest if len({p.shape[1] for p in alike}) == 1 else max(1, shortest // _PARTS)
        self._join([_middle(p, (p.shape[0], p.shape[1] // part * part)) for p in alike])

    def _join(self, places: Sequence[Topography]) -> None:
        periodic = all(p.periodic[0] for p in places), all(p.periodic[1] for p in places)
        super().__init__(
            np.concatenate([p.heights for p in places], axis=1), places[0].spacing, periodic
        )
        object.__setattr__(self, "widths", tuple(p.shape[1] for p in places))

    @property
    def each(self) -> tuple[Topography, ...]:
        """The places."""
        return tuple(Topography(z, self.spacing, self.periodic) for z in self.divided(self.heights))

    def divided(self, values: NDArray) -> list[NDArray]:
        """Values (…, n1, n2) at the points of all places, divided into those of each."""
        return divided(values, self.widths)

    @property
    def rms_slopes(self) -> Pair:
        """Rms of the slopes along x1 and x2 in the places, not between them."""
        of_each = np.array([p.rms_slopes for p in self.each])
        first, second = np.sqrt(np.average(of_each**2, axis=0, weights=self.widths))
        return float(first), float(second)

    def check_waves(self) -> None:
        """Raise InputError if the waves of one place are unlike those of the others."""
        waves = np.array([2 * np.pi * p.rms_height / (p.rms_slope or np.inf) for p in self.each])
        expected = "like waves: a shortest wave that all of them carry makes them alike"
        _check_alike("waves of about", waves, _UNLIKE_WAVES, expected)

    def detrend(self, order: int = 1) -> Places:
        """Places less the form of each."""
        return self._of_each(lambda p: p.detrend(order))

    def low_pass(self, wavelength: float) -> Places:
        """Waves of each place that are no shorter."""
        return self._of_each(lambda p: p.low_pass(wavelength))

    def fill_undefined(self, max_share: float = 0.05) -> Places:
        """Places with undefined points filled, each with no more of them than `max_share`."""
        return self._of_each(lambda p: p.fill_undefined(max_share))

    def resample(self, shape: Shape) -> Places:
        """Fourier interpolant of each place; together they have about so many points along x2.

        They have exactly so many where these divide by the number of parts of which the places are whole multiples.
        """
        part = reduce(gcd, self.widths)
        points = max(1, round(shape[1] * part / self.shape[1]))
        return self._of_each(lambda p: p.resample((shape[0], p.shape[1] // part * points)))

    def with_form(self, profile: NDArray) -> Places:
        """The places with a profile along x1 (n1,) [m] added to each."""
        return self._of_each(lambda p: p.with_form(profile))

    def _of_each(self, change: Callable[[Topography], Topography]) -> Places:
        return self._joined([change(p) for p in self.each])

    def _joined(self, places: Sequence[Topography]) -> Places:
        """Places with the same pixels to rounding, joined as they are; theirs is that of the first."""
        joined = object.__new__(Places)
        joined._join(places)
        return joined

    def with_heights(self, heights: NDArray) -> Places:
        """The places with other heights at the same points."""
        pieces = self.divided(heights)
        return self._joined([Topography(z, self.spacing, self.periodic) for z in pieces])


def divided(values: NDArray, widths: Sequence[int]) -> list[NDArray]:
    """Values (…, n1, n2) side by side along the last axis, divided into parts of so many columns."""
    return np.split(values, np.cumsum(widths)[:-1], axis=-1)


def _check(places: Sequence[Topography]) -> None:
    """Raise InputError if maps cannot be several places of the same surface, see `Places`."""
    if len(places) < 2:
        raise InputError(
            "places", f"{len(places)} of them", "at least two: a single one is given by itself"
        )
    if not all(isinstance(p, Topography) for p in places):
        raise InputError("places", "other than maps", "a list of Topography")
    for (a, first), (b, second) in combinations(enumerate(places, start=1), 2):
        if first.shape == second.shape and np.array_equal(
            first.heights, second.heights, equal_nan=True
        ):
            raise InputError("places", f"the same map as number {a} and {b}", "each place once")
    pixels = [max(p.spacing) for p in places]
    if max(pixels) > _UNLIKE_PIXELS * min(pixels):
        given = f"pixels from {to_text(min(pixels), 'm', 3)} to {to_text(max(pixels), 'm', 3)}"
        raise InputError(
            "places",
            given,
            f"pixels within a factor of {_UNLIKE_PIXELS:g}, which carry the same waves",
        )
    rms = np.array([np.nanstd(p.heights - fit_form(p.heights, p.size, 1).heights) for p in places])
    _check_alike("rms height", rms, _UNLIKE_HEIGHTS, "heights in the same unit")


def _check_alike(name: str, values: NDArray, most: float, expected: str) -> None:
    """Raise InputError if a length of one place differs from the median of all by more than a factor."""
    usual = float(np.median(values))
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = np.nan_to_num(np.abs(np.log(values / usual)), nan=np.inf)
    n = int(np.argmax(apart))
    if apart[n] > np.log(most):
        given = f"{name} {to_text(float(values[n]), 'm', 3)} of number {n + 1}, {to_text(usual, 'm', 3)} of the others"
        raise InputError("places", given, f"maps of the same surface, with {expected}")


def _alike(places: Sequence[Topography]) -> list[Topography]:
    """Places of the same breadth and pixel."""
    pixel = max(p.spacing[0] for p in places), max(p.spacing[1] for p in places)
    rows = int(min(p.size[0] for p in places) / pixel[0] + 0.5)
    found = []
    for p in places:
        shape = min(rows, round(p.size[0] / pixel[0])), round(p.size[1] / pixel[1])
        own = (
            min(n, round(m * d / e))
            for n, m, d, e in zip(p.shape, shape, pixel, p.spacing, strict=True)
        )
        cut = _middle(p, tuple(own))  # type: ignore[arg-type]
        found.append(
            Topography(
                cut.resample(shape).heights if cut.shape != shape else cut.heights,
                pixel,
                cut.periodic,
            )
        )
    return found


def _middle(place: Topography, shape: Shape) -> Topography:
    """The middle part of a map."""
    return place.crop(shape, ((place.shape[0] - shape[0]) // 2, (place.shape[1] - shape[1]) // 2))

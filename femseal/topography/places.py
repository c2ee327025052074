"""Several measured places of one face, side by side along x2 as one map.

Contact is solved in each place by itself, and flow through all of them together. What depends on neighbours, such as
waves, slopes and form, is that of each place: the heights do not match where two places meet.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from itertools import combinations
from math import gcd

import numpy as np
from numpy.typing import NDArray

from ..base import InputError, Pair, Shape, to_text
from .defects import fit_form
from .topography import Topography

#: Pixels that differ by more than this factor do not carry the same waves; rms heights that differ from the median of
#: all places by more than the second are of another unit; waves, 2π rms height over rms slope, by more than the third
#: of another surface or instrument.
_UNLIKE_PIXELS, _UNLIKE_HEIGHTS, _UNLIKE_WAVES = 4.0, 20.0, 2.5
#: Places of unlike length keep a whole number of parts of this fraction of the shortest.
_PARTS = 8


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


def shortest_place(face: Topography) -> Topography:
    """The shortest along x2 of the places of a face, whose points and pieces a case gives."""
    return min(face.each, key=lambda place: place.shape[1])


def of_all_places(face: Topography, shape: Shape) -> Shape:
    """Points of all places of a face together where its shortest has so many."""
    return shape[0], round(shape[1] * face.shape[1] / shortest_place(face).shape[1])


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

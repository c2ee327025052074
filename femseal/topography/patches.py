"""Several measured patches of one surface, side by side along x2.

Contact is solved in each patch by itself, and flow through all of them together. What depends on neighbours, such as
waves, slopes and form, is that of each patch: heights do not match where two patches meet.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import combinations
from math import gcd

import numpy as np
from numpy.typing import NDArray

from ..base import Array, InputError, Pair, Periodic, Plotted, Shape, as_text, to_text
from ..base.text import TextTable
from .defects import SPIKES, fit_form
from .topography import Topography

#: Pixels that differ by more than this factor do not carry the same waves; rms heights that differ from the median of
#: all patches by more than the second are of another unit; waves, 2π rms height over rms slope, by more than the third
#: of another surface or instrument.
_UNLIKE_PIXELS, _UNLIKE_HEIGHTS, _UNLIKE_WAVES = 4.0, 20.0, 2.5
#: Patches of unlike length keep a whole number of parts of this fraction of the shortest.
_PARTS = 8


@dataclass(frozen=True, eq=False, repr=False)
class Patches(Plotted):
    """Several measured patches of one surface, each continued by itself.

    The operations are those that are right for each patch by itself; other ones are those of each of `patches`.

    Parameters
    ----------
    patches : maps of the same surface. Unlike ones are cut to the breadth of the narrowest, about the middle, and
        resampled to the coarsest pixel, to half a pixel; of unlike lengths along x2 each keeps a whole number of
        eighths of the shortest.

    Raises
    ------
    InputError : fewer than two patches, one of them given twice, pixels or heights that are no measurements of the same
        surface, undefined points where the pixels differ.

    Examples
    --------
    >>> from femseal.topography import self_affine
    >>> both = Patches([self_affine((32, 48), (32e-6, 48e-6), hurst=0.8, rms_slope=0.1, rng=n) for n in (1, 2)])
    >>> both.shape, both.widths, len(both.patches)
    ((32, 96), (48, 48), 2)
    """

    patches: tuple[Topography, ...]

    def __init__(self, patches: Iterable[Topography]) -> None:
        """Make the patches alike."""
        try:
            given = list(patches)
        except TypeError:
            raise InputError("patches", repr(patches), "a list of Topography") from None
        _check(given)
        alike = _alike(given)
        lengths = [p.shape[1] for p in alike]
        shortest = min(lengths)
        part = shortest if len(set(lengths)) == 1 else max(1, shortest // _PARTS)
        cut = tuple(_middle(p, (p.shape[0], p.shape[1] // part * part)) for p in alike)
        object.__setattr__(self, "patches", cut)

    @property
    def widths(self) -> tuple[int, ...]:
        """Points of every patch along x2."""
        return tuple(p.shape[1] for p in self.patches)

    @property
    def shape(self) -> Shape:
        """Number of points of all patches side by side (n1, n2)."""
        return self.patches[0].shape[0], sum(self.widths)

    @property
    def spacing(self) -> Pair:
        """Pixel size (Δ1, Δ2) [m]."""
        return self.patches[0].spacing

    @property
    def size(self) -> Pair:
        """Sides of all patches side by side [m]."""
        return self.shape[0] * self.spacing[0], self.shape[1] * self.spacing[1]

    @property
    def periodic(self) -> Periodic:
        """Whether every patch repeats itself along x1 and x2."""
        return all(p.periodic[0] for p in self.patches), all(p.periodic[1] for p in self.patches)

    @cached_property
    def heights(self) -> Array:
        """Heights of all patches side by side (n1, n2) [m]."""
        heights = np.concatenate([p.heights for p in self.patches], axis=1)
        heights.flags.writeable = False
        return heights

    @property
    def shortest_patch(self) -> Topography:
        """The patch that is shortest along x2, whose points and cells a case gives."""
        return min(self.patches, key=lambda patch: patch.shape[1])

    @property
    def undefined_fraction(self) -> float:
        """Fraction of undefined points, 0 to 1."""
        return self._mean([p.undefined_fraction for p in self.patches])

    @property
    def rms_height(self) -> float:
        """Rms height in the patches, each about its own mean [m]."""
        return float(np.sqrt(self._mean([p.rms_height**2 for p in self.patches])))

    @property
    def rms_slopes(self) -> Pair:
        """Rms of the slopes along x1 and x2 in the patches, not between them."""
        along_x1, along_x2 = zip(*(p.rms_slopes for p in self.patches), strict=True)
        return float(np.sqrt(self._mean(np.square(along_x1)))), float(
            np.sqrt(self._mean(np.square(along_x2)))
        )

    @property
    def rms_slope(self) -> float:
        """Rms of the modulus of the gradient [-]; see `rms_slopes`."""
        return float(np.hypot(*self.rms_slopes))

    def _mean(self, values: Sequence[float] | NDArray) -> float:
        """Mean of values of the patches, weighted with their points."""
        return float(np.average(values, weights=self.widths))

    def divided(self, values: NDArray) -> list[NDArray]:
        """Divide values (…, n1, n2) at the points of all patches into those of each."""
        return divided(values, self.widths)

    def check_waves(self) -> None:
        """Raise InputError if the waves of one patch are unlike those of the others."""
        waves = np.array([2 * np.pi * p.rms_height / (p.rms_slope or np.inf) for p in self.patches])
        expected = "like waves: a shortest wave that all of them carry makes them alike"
        _check_alike("waves of about", waves, _UNLIKE_WAVES, expected)

    def detrend(self, order: int | None = 1) -> Patches:
        """Take off the form of each patch, see `Topography.detrend`."""
        return self.of_each(lambda p: p.detrend(order))

    def low_pass(self, wavelength: float) -> Patches:
        """Keep the waves of each patch that are no shorter [m]."""
        return self.of_each(lambda p: p.low_pass(wavelength))

    def high_pass(self, wavelength: float) -> Patches:
        """Remove the waves of each patch that `low_pass` keeps."""
        return self.of_each(lambda p: p.high_pass(wavelength))

    def flip(self, axis: int) -> Patches:
        """Reverse each patch along an axis; the patches keep their order."""
        return self.of_each(lambda p: p.flip(axis))

    def without_spikes(self, threshold: float = SPIKES) -> Patches:
        """Mark the spikes of each patch as undefined, see `Topography.without_spikes`."""
        return self.of_each(lambda p: p.without_spikes(threshold))

    def fill_undefined(self, max_share: float = 0.05) -> Patches:
        """Fill the undefined points of each patch, which has no more of them than `max_share`."""
        return self.of_each(lambda p: p.fill_undefined(max_share))

    def resample(self, shape: Shape) -> Patches:
        """Interpolate each patch by its Fourier series; together they have about `shape` points.

        They have exactly so many where these divide by the number of parts of which the patches are whole multiples.
        """
        part = reduce(gcd, self.widths)
        points = max(1, round(shape[1] * part / self.shape[1]))
        return self.of_each(lambda p: p.resample((shape[0], p.shape[1] // part * points)))

    def with_form(self, profile: NDArray) -> Patches:
        """Add a profile along x1 (n1,) [m] to each patch."""
        return self.of_each(lambda p: p.with_form(profile))

    def with_heights(self, heights: NDArray) -> Patches:
        """Give the patches other heights (n1, n2) [m] at the same points."""
        pieces = zip(self.patches, self.divided(heights), strict=True)
        return self.with_patches([p.with_heights(z) for p, z in pieces])

    def of_each(self, change: Callable[[Topography], Topography]) -> Patches:
        """Change each patch by itself; the results have the same pixels."""
        return self.with_patches([change(p) for p in self.patches])

    def with_patches(self, patches: Sequence[Topography]) -> Patches:
        """Put patches in the place of these that are alike already, without looking at them again."""
        found = object.__new__(Patches)
        object.__setattr__(found, "patches", tuple(patches))
        return found

    def facts(self) -> dict[str, str]:
        """Points, size, pixel and heights as text."""
        facts = {"patches": str(len(self.patches)), "points": as_text(self.shape)}
        facts |= {"size": as_text(self.size, "m"), "pixel": as_text(self.spacing, "m")}
        facts["periodic"] = str(self.periodic)
        if fraction := self.undefined_fraction:
            return facts | {"undefined": as_text(fraction, percent=True)}
        return facts | {"Sq": to_text(self.rms_height, "m"), "rms slope": f"{self.rms_slope:.4g}"}

    def _repr_html_(self) -> str:
        return TextTable(type(self).__name__, (), tuple(self.facts().items()))._repr_html_()

    def __repr__(self) -> str:
        return f"Patches({', '.join(f'{name} {text}' for name, text in self.facts().items())})"


class Places(Patches):
    """Former name of `Patches`, until the next version."""

    def __init__(self, places: Iterable[Topography]) -> None:
        """Warn that the name has changed."""
        warnings.warn("Places is Patches now", DeprecationWarning, stacklevel=2)
        super().__init__(places)


#: The surface of a scene.
Surface = Topography | Patches


def check_single_patch(name: str, surface: object) -> None:
    """Raise InputError if an operation on a single map was given several patches."""
    if isinstance(surface, Patches):
        given = f"{len(surface.patches)} patches"
        raise InputError(name, given, "a single map: one of their `patches` after the other")


def divided(values: NDArray, widths: Sequence[int]) -> list[NDArray]:
    """Divide values (…, n1, n2) of patches side by side along the last axis into those of each."""
    return np.split(values, np.cumsum(widths)[:-1], axis=-1)


def _check(patches: Sequence[Topography]) -> None:
    """Raise InputError if maps cannot be several patches of the same surface, see `Patches`."""
    if len(patches) < 2:
        raise InputError(
            "patches", f"{len(patches)} of them", "at least two: a single one is given by itself"
        )
    if not all(isinstance(p, Topography) for p in patches):
        raise InputError("patches", "other than maps", "a list of Topography")
    for (a, first), (b, second) in combinations(enumerate(patches, start=1), 2):
        if first.shape == second.shape and np.array_equal(
            first.heights, second.heights, equal_nan=True
        ):
            raise InputError("patches", f"the same map as number {a} and {b}", "each patch once")
    pixels = [max(p.spacing) for p in patches]
    if max(pixels) > _UNLIKE_PIXELS * min(pixels):
        given = f"pixels from {to_text(min(pixels), 'm', 3)} to {to_text(max(pixels), 'm', 3)}"
        raise InputError(
            "patches",
            given,
            f"pixels within a factor of {_UNLIKE_PIXELS:g}, which carry the same waves",
        )
    rms = np.array([np.nanstd(p.heights - fit_form(p.heights, p.size, 1).heights) for p in patches])
    _check_alike("rms height", rms, _UNLIKE_HEIGHTS, "heights in the same unit")


def _check_alike(name: str, values: NDArray, most: float, expected: str) -> None:
    """Raise InputError if a length of one patch differs from the median of all by more than a factor."""
    usual = float(np.median(values))
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = np.nan_to_num(np.abs(np.log(values / usual)), nan=np.inf)
    n = int(np.argmax(apart))
    if apart[n] > np.log(most):
        given = f"{name} {to_text(float(values[n]), 'm', 3)} of number {n + 1}, {to_text(usual, 'm', 3)} of the others"
        raise InputError("patches", given, f"maps of the same surface, with {expected}")


def _alike(patches: Sequence[Topography]) -> list[Topography]:
    """Cut patches to one breadth, and resample them to one pixel."""
    pixel = max(p.spacing[0] for p in patches), max(p.spacing[1] for p in patches)
    rows = int(min(p.size[0] for p in patches) / pixel[0] + 0.5)
    found = []
    for p in patches:
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


def _middle(patch: Topography, shape: Shape) -> Topography:
    """Cut the middle part out of a map."""
    return patch.crop(shape, ((patch.shape[0] - shape[0]) // 2, (patch.shape[1] - shape[1]) // 2))

"""Several measured patches of one surface, side by side along x2.

Contact is solved in each patch separately, and the flow is solved through all patches together. Waves, slopes, form and
all other properties that depend on neighbouring points are computed within each patch, because the heights of two
patches do not match where they meet.
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

from ..base import Array, InputError, Pair, Periodic, Plotted, Shape, counted, to_text
from ..base.text_table import TextTable
from .defects import SPIKES
from .form_fit import fit_form
from .topography import Topography, facts_of

#: Largest ratio of the pixel sizes of two patches of the same surface.
_UNLIKE_PIXELS = 4.0
#: Largest ratio of the rms height of a patch to the median of all patches; beyond it the unit is probably wrong.
_UNLIKE_HEIGHTS = 20.0
#: Largest ratio of the mean wavelength of a patch, 2π rms height over rms slope, to the median of all patches; beyond
#: it the patch probably shows another surface or was measured by another instrument.
_UNLIKE_WAVES = 2.5
#: Patches of different lengths are cut to multiples of the shortest length divided by this number.
_PARTS = 8


@dataclass(frozen=True, eq=False, repr=False)
class Patches(Plotted):
    """Several measured patches of one surface.

    The methods act on each patch separately. Other operations of `Topography` can be applied to the elements of
    `patches`.

    Patches of different size or resolution are matched in three steps. First, all patches are trimmed
    symmetrically along x1 to the width of the narrowest patch. Then all patches are resampled to the largest pixel
    size, which changes the sides of a patch by at most half a pixel. Finally, each patch is cut along x2 to a multiple
    of one eighth of the length of the shortest patch.

    Parameters
    ----------
    patches : sequence of Topography
        At least two maps of the same surface.

    Raises
    ------
    InputError
        There are fewer than two patches; a patch is given twice; the pixel sizes or heights are too different for
        measurements of the same surface; or a patch that has to be resampled has undefined points.

    Examples
    --------
    >>> from femseal.topography import self_affine
    >>> both = Patches([self_affine((32, 48), (32e-6, 48e-6), hurst=0.8, rms_slope=0.1, rng=n) for n in (1, 2)])
    >>> both.shape, both.widths, len(both.patches)
    ((32, 96), (48, 48), 2)
    """

    patches: tuple[Topography, ...]

    def __init__(self, patches: Iterable[Topography]) -> None:
        """Check the patches and match their widths and pixel sizes."""
        try:
            maps = list(patches)
        except TypeError:
            raise InputError("patches", repr(patches), "a list of Topography") from None
        _check_patches(maps)
        maps = _resample_to_same_pixels(maps)
        lengths = [patch.shape[1] for patch in maps]
        shortest = min(lengths)
        has_equal_lengths = len(set(lengths)) == 1
        # each length becomes a multiple of this number of points
        part = shortest if has_equal_lengths else max(1, shortest // _PARTS)
        cropped = [
            _crop_middle(patch, (patch.shape[0], patch.shape[1] // part * part)) for patch in maps
        ]
        object.__setattr__(self, "patches", tuple(cropped))

    @property
    def widths(self) -> tuple[int, ...]:
        """Number of points of every patch along x2."""
        return tuple(p.shape[1] for p in self.patches)

    @property
    def shape(self) -> Shape:
        """Number of points (n1, n2) of the map that all patches form side by side."""
        return self.patches[0].shape[0], sum(self.widths)

    @property
    def spacing(self) -> Pair:
        """Pixel size (Δ1, Δ2) [m]."""
        return self.patches[0].spacing

    @property
    def size(self) -> Pair:
        """Sides along x1 and x2 [m] of the map that all patches form side by side."""
        return self.shape[0] * self.spacing[0], self.shape[1] * self.spacing[1]

    @property
    def periodic(self) -> Periodic:
        """Whether every patch is periodic along x1, and whether every patch is periodic along x2."""
        return all(p.periodic[0] for p in self.patches), all(p.periodic[1] for p in self.patches)

    @cached_property
    def heights(self) -> Array:
        """Heights (n1, n2) [m] of the map that all patches form side by side."""
        heights = np.concatenate([p.heights for p in self.patches], axis=1)
        heights.flags.writeable = False
        return heights

    @property
    def shortest_patch(self) -> Topography:
        """Patch that is shortest along x2; the numbers of points and cells in a case refer to this patch."""
        return min(self.patches, key=lambda patch: patch.shape[1])

    @property
    def undefined_fraction(self) -> float:
        """Fraction of undefined points, 0 to 1."""
        return self._mean([p.undefined_fraction for p in self.patches])

    @property
    def rms_height(self) -> float:
        """Rms height [m] of all patches, with heights measured from the mean height of each patch."""
        return float(np.sqrt(self._mean([p.rms_height**2 for p in self.patches])))

    @property
    def rms_slopes(self) -> Pair:
        """Rms slopes [-] along x1 and x2, ignoring the steps between patches."""
        squares = np.square([patch.rms_slopes for patch in self.patches])  # (patch, axis)
        along_x1, along_x2 = (float(np.sqrt(self._mean(values))) for values in squares.T)
        return along_x1, along_x2

    @property
    def rms_slope(self) -> float:
        """Rms of the slope |∇z| [-], ignoring the steps between patches."""
        return float(np.hypot(*self.rms_slopes))

    def rms_slope_of_long_waves(self, wavelength: float) -> float:
        """Return the rms slope [-] of waves at least as long as `wavelength` [m], ignoring steps between patches."""
        slopes = [patch.rms_slope_of_long_waves(wavelength) for patch in self.patches]
        return float(np.sqrt(self._mean(np.square(slopes))))

    def _mean(self, values: Sequence[float] | NDArray) -> float:
        """Average values (patches,) over the patches, weighted by the number of points of each patch."""
        return float(np.average(values, weights=self.widths))

    def split(self, values: NDArray) -> list[NDArray]:
        """Split values (…, n1, n2) of patches that lie side by side into one array for each patch."""
        return split_patches(values, self.widths)

    def check_waves(self) -> None:
        """Raise InputError if the mean wavelength of one patch differs greatly from the median over all patches."""
        waves = np.array(
            [2 * np.pi * patch.rms_height / (patch.rms_slope or np.inf) for patch in self.patches]
        )
        expected = "similar waves: set a shortest wave that all patches contain"
        _check_alike("waves of about", waves, _UNLIKE_WAVES, expected)

    def detrend(self, order: int | None = 1) -> Patches:
        """Remove the form of each patch, see `Topography.detrend`."""
        return self.apply_to_each(lambda p: p.detrend(order))

    def low_pass(self, wavelength: float) -> Patches:
        """Keep only the waves of each patch that are at least as long as `wavelength` [m]."""
        return self.apply_to_each(lambda p: p.low_pass(wavelength))

    def high_pass(self, wavelength: float) -> Patches:
        """Remove the waves of each patch that are at least as long as `wavelength` [m]."""
        return self.apply_to_each(lambda p: p.high_pass(wavelength))

    def flip(self, axis: int) -> Patches:
        """Reverse each patch along an axis; the patches keep their order."""
        return self.apply_to_each(lambda p: p.flip(axis))

    def without_spikes(self, threshold: float = SPIKES) -> Patches:
        """Mark the spikes of each patch as undefined, see `Topography.without_spikes`."""
        return self.apply_to_each(lambda p: p.without_spikes(threshold))

    def fill_undefined(self, max_share: float = 0.05) -> Patches:
        """Fill the undefined points of each patch.

        At most the fraction `max_share` of the points of a patch may be undefined.
        """
        return self.apply_to_each(lambda p: p.fill_undefined(max_share))

    def resample(self, shape: Shape) -> Patches:
        """Interpolate each patch by its Fourier series, so that all patches together have about `shape` points.

        The number of points along x2 is exactly `shape[1]` if `shape[1]` can be divided between the patches in
        proportion to their lengths.
        """
        # Each patch consists of a whole number of parts with this number of columns. All parts get the same number of
        # new columns, so that all patches keep the same pixel size.
        part = reduce(gcd, self.widths)
        new_part = max(1, round(shape[1] * part / self.shape[1]))
        return self.apply_to_each(lambda p: p.resample((shape[0], p.shape[1] // part * new_part)))

    def with_form(self, profile: NDArray) -> Patches:
        """Return patches with a profile along x1, (n1,) [m], added to the heights of each patch."""
        return self.apply_to_each(lambda p: p.with_form(profile))

    def with_heights(self, heights: NDArray) -> Patches:
        """Return patches on the same points with the given heights, (n1, n2) [m]."""
        heights_of_patches = self.split(heights)
        return self.with_patches(
            [p.with_heights(z) for p, z in zip(self.patches, heights_of_patches, strict=True)]
        )

    def apply_to_each(self, change: Callable[[Topography], Topography]) -> Patches:
        """Apply a function to each patch.

        The maps that the function returns must all have the same pixel size and number of rows.
        """
        return self.with_patches([change(p) for p in self.patches])

    def with_patches(self, patches: Sequence[Topography]) -> Patches:
        """Return a `Patches` object with the given patches, which must already have the same pixels."""
        result = object.__new__(Patches)
        object.__setattr__(result, "patches", tuple(patches))
        return result

    def facts(self) -> dict[str, str]:
        """Return the number of patches, the number of points, the size, the pixel size and the heights as text."""
        return {"patches": str(len(self.patches))} | facts_of(self)

    def _repr_html_(self) -> str:
        return TextTable(type(self).__name__, (), tuple(self.facts().items()))._repr_html_()

    def __repr__(self) -> str:
        return f"Patches({', '.join(f'{name} {text}' for name, text in self.facts().items())})"


class Places(Patches):
    """Offer `Patches` under its former name until the next version."""

    def __init__(self, patches: Iterable[Topography]) -> None:
        """Make patches, and warn that `Places` is now called `Patches`."""
        warnings.warn("Places is Patches now", DeprecationWarning, stacklevel=2)
        super().__init__(patches)


#: The surface of a scene.
Surface = Topography | Patches


def check_single_patch(name: str, surface: object) -> None:
    """Raise InputError if several patches were given to an operation on a single map."""
    if isinstance(surface, Patches):
        given = f"{len(surface.patches)} patches"
        raise InputError(name, given, "a single map, for example an element of `patches`")


def split_patches(values: NDArray, widths: Sequence[int]) -> list[NDArray]:
    """Split values (…, n1, n2) of patches that lie side by side along the last axis into one array for each patch.

    widths : number of points of each patch along x2.
    """
    return np.split(values, np.cumsum(widths)[:-1], axis=-1)


def _check_patches(patches: Sequence[Topography]) -> None:
    """Raise InputError if the given maps cannot be patches of the same surface, see `Patches`."""
    if len(patches) < 2:
        given = counted(len(patches), "map")
        raise InputError("patches", given, "at least two patches; give a single map without a list")
    if not all(isinstance(patch, Topography) for patch in patches):
        raise InputError("patches", "other than maps", "a list of Topography")
    for (a, first), (b, second) in combinations(enumerate(patches, start=1), 2):
        # NaN equals NaN here, and maps of different shapes are different
        if np.array_equal(first.heights, second.heights, equal_nan=True):
            raise InputError(
                "patches", f"the same map twice, as number {a} and number {b}", "each patch once"
            )
    pixels = [max(patch.spacing) for patch in patches]
    if max(pixels) > _UNLIKE_PIXELS * min(pixels):
        given = f"pixels from {to_text(min(pixels), 'm', 3)} to {to_text(max(pixels), 'm', 3)}"
        expected = f"pixels within a factor of {_UNLIKE_PIXELS:g}, which carry the same waves"
        raise InputError("patches", given, expected)
    rms = []
    for patch in patches:
        tilt = fit_form(patch.heights, patch.size, 1)
        rms.append(np.nanstd(patch.heights - tilt.heights))
    _check_alike("rms height", np.array(rms), _UNLIKE_HEIGHTS, "heights in the same unit")


def _check_alike(name: str, values: NDArray, most: float, expected: str) -> None:
    """Raise InputError if a property of one patch differs greatly from the median over all patches.

    Parameters
    ----------
    name : str
        Name of the property, for the message.
    values : array, (patches,)
        Value of the property for each patch [m].
    most : float
        Largest allowed ratio of a value to the median, or of the median to a value.
    expected : str
        What the patches should have in common, for the message.
    """
    median = float(np.median(values))
    # a value of 0 or an undefined value counts as an infinite ratio
    with np.errstate(divide="ignore", invalid="ignore"):
        log_ratios = np.nan_to_num(np.abs(np.log(values / median)), nan=np.inf)
    n = int(np.argmax(log_ratios))
    if log_ratios[n] > np.log(most):
        given = (
            f"{name} {to_text(float(values[n]), 'm', 3)} of patch number {n + 1}, "
            f"the median of all patches is {to_text(median, 'm', 3)}"
        )
        raise InputError("patches", given, f"maps of the same surface, with {expected}")


def _resample_to_same_pixels(patches: Sequence[Topography]) -> list[Topography]:
    """Trim all patches to the smallest width along x1, and resample them to the largest pixel size."""
    pixel = max(p.spacing[0] for p in patches), max(p.spacing[1] for p in patches)
    # number of new rows in the narrowest patch, rounded
    rows = int(min(p.size[0] for p in patches) / pixel[0] + 0.5)
    resampled = []
    for patch in patches:
        # number of points on the new grid
        new_shape = (
            min(rows, round(patch.size[0] / pixel[0])),
            round(patch.size[1] / pixel[1]),
        )
        # number of points on the grid of the patch that cover the same area
        cut_rows = min(patch.shape[0], round(new_shape[0] * pixel[0] / patch.spacing[0]))
        cut_columns = min(patch.shape[1], round(new_shape[1] * pixel[1] / patch.spacing[1]))
        cut = _crop_middle(patch, (cut_rows, cut_columns))
        heights = cut.heights
        if cut.shape != new_shape:
            heights = cut.resample(new_shape).heights
        resampled.append(Topography(heights, pixel, cut.periodic))
    return resampled


def _crop_middle(patch: Topography, shape: Shape) -> Topography:
    """Cut a block of `shape` points out of the middle of a map."""
    start = (patch.shape[0] - shape[0]) // 2, (patch.shape[1] - shape[1]) // 2
    return patch.crop(shape, start)

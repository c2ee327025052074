"""Define a map of heights with its properties and operations.

Conventions: x1 = axis 0 is the leakage direction, x2 = axis 1 runs along the seal. Heights are sampled at pixel
centres; pixel (i, j) covers [iΔ1, (i+1)Δ1] × [jΔ2, (j+1)Δ2]. All values are in SI.

Source of the rms height Sq about the mean: ISO 25178-2. The module `waves` describes the decomposition into waves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import isnan, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base import (
    Array,
    InputError,
    Pair,
    Periodic,
    Plotted,
    Shape,
    TextTable,
    as_text,
    to_text,
    validate,
)
from .defects import SPIKES, TooManyUndefined, fill_holes, find_spikes
from .form_fit import Form, fit_form
from .waves import profile_density, radial_density, resample_axis, rms_slopes, truncate

#: A map that was declared periodic has a step at its border if the rms change of height there is more than this many
#: times the rms change between neighbouring points.
_STEP = 2.0


@dataclass(frozen=True, eq=False, repr=False)
class Topography(Plotted):
    """Heights on a regular grid.

    Along a periodic axis, the map repeats itself; along any other axis, the map continues as its mirror image. Spectral
    quantities, filters and interpolations assume that the map continues in this way. Most operations raise InputError
    if the map has undefined points, which must be filled first.

    Parameters
    ----------
    heights : array_like, (n1, n2)
        Heights z [m], which are copied. NaN and masked points are undefined.
    spacing : float or tuple of two float
        Pixel size (Δ1, Δ2) [m].
    periodic : bool or tuple of two bool
        Whether the map is periodic along x1 and x2.

    Raises
    ------
    InputError
        The heights are not two-dimensional, or are empty, complex or infinite; or the spacing does not consist of two
        finite numbers > 0.

    Examples
    --------
    >>> x1 = (np.arange(64) + 0.5) * 1e-6
    >>> wave = Topography(np.cos(2 * np.pi * x1 / 32e-6)[:, None] * np.full((1, 8), 1e-7), (1e-6, 1e-6))
    >>> wave
    Topography(points 64 × 8, size 64 µm × 8 µm, pixel 1 µm × 1 µm, periodic (True, True), Sq 70.71 nm,
               rms slope 0.01388)
    """

    heights: Array
    spacing: Pair
    periodic: Periodic = (True, True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "heights", _clean(self.heights))
        object.__setattr__(self, "spacing", validate.lengths("spacing", self.spacing))
        object.__setattr__(self, "periodic", validate.flags("periodic", self.periodic))

    @property
    def shape(self) -> Shape:
        """Number of points (n1, n2)."""
        return self.heights.shape[0], self.heights.shape[1]

    @property
    def size(self) -> Pair:
        """Sides (n1 Δ1, n2 Δ2) [m]."""
        return self.shape[0] * self.spacing[0], self.shape[1] * self.spacing[1]

    @property
    def patches(self) -> tuple[Topography, ...]:
        """Measured patches of the surface, see `Patches`. A single map is a surface with one patch."""
        return (self,)

    @property
    def widths(self) -> tuple[int, ...]:
        """Number of points of every measured patch along x2."""
        return (self.shape[1],)

    @property
    def shortest_patch(self) -> Topography:
        """The map itself, which is also the shortest patch of a surface with a single patch."""
        return self

    @property
    def undefined_fraction(self) -> float:
        """Fraction of undefined points, 0 to 1."""
        return float(np.isnan(self.heights).mean())

    @property
    def seamless(self) -> Periodic:
        """For each axis, whether the map is periodic and has no step between its last and its first line.

        A measured map has a step between its last and its first line even if the map was declared periodic. Subtracting
        a plane from a periodic map also leaves such a step, because a plane is not periodic.
        """
        return self._is_seamless(0), self._is_seamless(1)

    def _is_seamless(self, axis: int) -> bool:
        """Return whether the map is periodic along an axis and has no step at its border, see `seamless`.

        The map has a step if the rms change of height from the last to the first line exceeds `_STEP` times the rms
        change between neighbouring lines.
        """
        if not self.periodic[axis]:
            return False
        lines = self.heights.swapaxes(0, axis)
        border_change = _mean_square(lines[0] - lines[-1])
        changes = [_mean_square(after - before) for before, after in pairwise(lines)]
        known_changes = [change for change in changes if not isnan(change)]
        if isnan(border_change) or not known_changes:
            return True
        mean_change = sum(known_changes) / len(known_changes)
        return border_change <= _STEP**2 * mean_change

    @property
    def rms_height(self) -> float:
        """Rms height Sq [m], with heights measured from their mean."""
        return float(self._defined("rms_height").std())

    @cached_property
    def rms_slopes(self) -> Pair:
        """Rms of ∂z/∂x1 and of ∂z/∂x2 [-].

        The rms slope along axis i is √(Σ q_i² |c|²), where the sum is over all waves of the map, q_i is the wave number
        along axis i, and c is the coefficient of the wave (Parseval's theorem). The rms slopes are exact for
        band-limited data. Along an axis that is not periodic, the map continues as its mirror image, so that its tilt
        contributes to the rms slope.
        """
        return rms_slopes(self._defined("rms_slope"), self.spacing, self.periodic)

    def rms_slope_of_long_waves(self, wavelength: float) -> float:
        """Return the rms of the slope |∇z| [-] of all waves at least as long as `wavelength` [m]."""
        heights = self._defined("rms_slope")
        slopes = rms_slopes(heights, self.spacing, self.periodic, limit=2 * np.pi / wavelength)
        return float(np.hypot(*slopes))

    @property
    def rms_slope(self) -> float:
        """Rms of the slope |∇z| [-], see `rms_slopes`."""
        return float(np.hypot(*self.rms_slopes))

    def detrend(self, order: int | None = 1) -> Topography:
        """Subtract the form of the map, which is fitted by least squares; see `form`.

        The fit ignores undefined points, and they remain undefined.

        Raises
        ------
        InputError
            The order is invalid.
        """
        form_heights = self.form(order).heights
        return self._with_new(np.subtract(self.heights, form_heights, out=form_heights))

    def form(self, order: int | None = None) -> Form:
        """Fit the mean (order 0), mean and tilt (1), or mean, tilt and curvature (2) to the defined points.

        If the heights at opposite sides of a map agree, the map repeats itself and has no tilt. A plane fitted to such
        a map would only follow the long waves, and subtracting the plane would create a step between the opposite
        sides. If the order is None, the function therefore fits the mean, plus the tilt along each axis on which the
        map is not `seamless`.

        Raises
        ------
        InputError
            The order is invalid, or no point is defined.
        """
        if order is None:
            first, second = self.seamless
            return fit_form(self.heights, self.size, 1, tilted=(not first, not second))
        return fit_form(self.heights, self.size, order)

    def low_pass(self, wavelength: float) -> Topography:
        """Keep the waves with |q| <= 2π/`wavelength`, in any direction, by truncation in Fourier space.

        Parameters
        ----------
        wavelength : float
            Shortest wave [m].

        Raises
        ------
        InputError
            The wavelength is not a finite number > 0.
        """
        limit = 2 * np.pi / validate.number("wavelength", wavelength, unit="m")
        heights = self._defined("low_pass")
        return self._with_new(truncate(heights, self.spacing, self.periodic, limit))

    def high_pass(self, wavelength: float) -> Topography:
        """Remove the waves with |q| <= 2π/`wavelength`, in any direction, by truncation in Fourier space."""
        return self.with_heights(self._defined("high_pass") - self.low_pass(wavelength).heights)

    def resample(self, shape: Shape) -> Topography:
        """Interpolate the map by its Fourier series on another grid of the same area.

        The interpolation is exact for band-limited data. Waves that are too short for the new grid are removed, so that
        there is no aliasing. The surface does not move, although the centres of the new pixels lie elsewhere.

        Parameters
        ----------
        shape : tuple of two int
            Number of points along x1 and x2.

        Raises
        ------
        InputError
            The shape is not two whole numbers >= 1.
        """
        new_shape = validate.grid("shape", shape)
        z = self._defined("resample")
        if new_shape == self.shape:
            return self
        for axis in (0, 1):
            z = resample_axis(z, new_shape[axis], axis, self.periodic[axis])
        spacing = (self.size[0] / new_shape[0], self.size[1] / new_shape[1])
        return Topography(z, spacing, self.periodic)

    def without_spikes(self, threshold: float = SPIKES) -> Topography:
        """Replace spikes by undefined points (NaN), see `femseal.topography.defects`.

        Parameters
        ----------
        threshold : float
            An isolated point is a spike if it deviates from its surroundings by more than this many robust standard
            deviations. If the threshold is infinite, no point is a spike.

        Raises
        ------
        InputError
            The threshold is not > 0.
        """
        is_spike = find_spikes(self.heights, threshold)
        if not is_spike.any():
            return self
        return self._with_new(np.where(is_spike, np.nan, self.heights))

    def fill_undefined(self, max_share: float = 0.05) -> Topography:
        """Fill undefined points by the harmonic surface through the points around them.

        Parameters
        ----------
        max_share : float
            Largest fraction of points that may be undefined, from 0 to 1.

        Raises
        ------
        InputError
            The fraction of undefined points exceeds `max_share`, or no point is defined.
        """
        fraction = self.undefined_fraction
        limit = validate.number("max_share", max_share, inclusive=True)
        if fraction == 1:
            raise InputError("undefined points", "100 %", "a map with at least one defined point")
        if fraction > limit:
            given = f"{as_text(fraction, percent=True)} undefined points"
            most = as_text(limit, percent=True)
            expected = f"at most {most}: crop the map to a part with fewer, or raise max_undefined"
            raise TooManyUndefined("heights", given, expected)
        if not fraction:
            return self
        return self._with_new(fill_holes(self.heights, self.spacing, self.periodic))

    def crop(self, shape: Shape, start: Shape = (0, 0)) -> Topography:
        """Cut out a part of the map. The part is not periodic along an axis that was shortened.

        Parameters
        ----------
        shape : tuple of two int
            Number of points of the part.
        start : tuple of two int
            Row and column of the first pixel of the part.

        Raises
        ------
        InputError
            The part extends beyond the borders of the map.
        """
        rows, columns = validate.grid("shape", shape)
        row, column = validate.grid("start", start, minimum=0)
        if row + rows > self.shape[0] or column + columns > self.shape[1]:
            given = f"shape {(rows, columns)} from {(row, column)}"
            raise InputError(
                "crop", given, f"a part that lies within the {self.shape} points of the map"
            )
        periodic = (
            self.periodic[0] and rows == self.shape[0],
            self.periodic[1] and columns == self.shape[1],
        )
        part = self.heights[row : row + rows, column : column + columns]
        return Topography(part, self.spacing, periodic)

    def crop_to(self, part: tuple[float, float, float, float]) -> Topography:
        """Cut out the part of the map between given positions, which are rounded to whole pixels. See `crop`.

        Parameters
        ----------
        part : tuple of four float
            Start and end of the part along x1, and start and end along x2 [m].

        Raises
        ------
        InputError
            `part` does not consist of four lengths, contains no pixel, or extends beyond the borders of the map.
        """
        try:
            begin1, end1, begin2, end2 = (
                round(validate.number("crop", length, inclusive=True) / self.spacing[n // 2])
                for n, length in enumerate(part)
            )
            return self.crop((end1 - begin1, end2 - begin2), (begin1, begin2))
        except (TypeError, ValueError, IndexError):
            sides = " and ".join(to_text(length, "m") for length in self.size)
            expected = f"start and end along x1, then along x2, each pair rising, within {sides}"
            raise InputError("crop", f"{part} m", expected) from None

    def flip(self, axis: int) -> Topography:
        """Reverse the map along an axis, as needed for the upper of two faces before the two faces are added."""
        return self.with_heights(np.flip(self.heights, validate.axis_number(axis)))

    def __add__(self, other: Topography) -> Topography:
        """Add two faces on the same grid. The sum is periodic along an axis if both faces are periodic along this axis.

        Raises
        ------
        InputError
            The shapes or spacings differ.
        """
        if not isinstance(other, Topography):
            return NotImplemented
        for name in ("shape", "spacing"):
            first, second = getattr(self, name), getattr(other, name)
            if not np.allclose(first, second, rtol=1e-9, atol=0):
                expected = f"the {name} of the first face, {first}"
                raise InputError(f"{name} of the second face", second, expected)
        periodic = (self.periodic[0] and other.periodic[0], self.periodic[1] and other.periodic[1])
        heights = self._defined("a sum") + other._defined("a sum")
        return Topography(heights, self.spacing, periodic)

    def with_form(self, profile: NDArray) -> Topography:
        """Return a map with a profile along x1, (n1,) [m], added to the heights; the map is not periodic along x1."""
        return Topography(self.heights + profile[:, None], self.spacing, (False, self.periodic[1]))

    def gap(self) -> Array:
        """Return the undeformed gap h1 = max z − z (n1, n2) [m] to a rigid flat that touches the highest point."""
        z = self._defined("gap")
        return z.max() - z

    def psd(self, axis: int) -> tuple[Array, Array]:
        """Return the spectral density of the profiles along an axis, averaged over all profiles.

        The density is two-sided, C(q) = C(−q), and is given for q >= 0. The mean square height Sq² is the integral of
        C/2π over all q, which equals the sum of C Δq/π over q >= 0, if q = 0 has half the weight. C(0) represents the
        variance of the mean heights of the profiles. Δq is 2π/L on a periodic axis and π/L on a mirrored axis.

        Returns
        -------
        q : array, (waves,)
            Wave numbers [rad/m]. An axis with n points has n//2 + 1 wave numbers if it is periodic, and n wave numbers
            otherwise.
        C : array, (waves,)
            Spectral density [m³].
        """
        axis = validate.axis_number(axis)
        return profile_density(self._defined("psd"), self.spacing, self.periodic, axis)

    def radial_psd(self) -> tuple[Array, Array]:
        """Return the two-dimensional spectral density, averaged over all directions of the wave vector.

        The mean square height Sq² is the integral of C2D/4π² over the plane of wave vectors. The density is averaged in
        rings of |q|. The width of each ring is the larger of the wave-number steps along x1 and x2. If a
        part of a ring lies beyond the Nyquist wave number of an axis, only the rest of the ring contributes to the
        average. Rings without waves are left out.

        Returns
        -------
        q : array, (rings,)
            Mean wave number |q| of the waves in each ring [rad/m].
        C2D : array, (rings,)
            Spectral density [m⁴].
        """
        return radial_density(self._defined("radial_psd"), self.spacing, self.periodic)

    def with_heights(self, heights: NDArray) -> Topography:
        """Return a map on the same points with the given heights, (n1, n2) [m]."""
        return Topography(heights, self.spacing, self.periodic)

    def _with_new(self, heights: NDArray) -> Topography:
        """Return a map on the same points with the given heights, without copying the array.

        The array becomes read-only, so the caller must not use it for anything else.
        """
        heights.flags.writeable = False
        return self.with_heights(heights)

    def _defined(self, purpose: str) -> Array:
        """Return the heights; raise InputError if any point is undefined.

        purpose : operation that needs the heights, for the message.
        """
        fraction = self.undefined_fraction
        if fraction:
            given = f"{as_text(fraction, percent=True)} undefined points"
            expected = f"a map without undefined points for {purpose}: use fill_undefined() first"
            raise InputError("heights", given, expected)
        return self.heights

    def facts(self) -> dict[str, str]:
        """Return the number of points, the size, the pixel size and the heights as text."""
        return facts_of(self)

    def _repr_html_(self) -> str:
        return TextTable(type(self).__name__, (), tuple(self.facts().items()))._repr_html_()

    def __repr__(self) -> str:
        return f"Topography({', '.join(f'{name} {text}' for name, text in self.facts().items())})"


def facts_of(surface: Any) -> dict[str, str]:
    """Return the number of points, the size, the pixel size and the heights of a map or of several patches as text."""
    facts = {
        "points": as_text(surface.shape),
        "size": as_text(surface.size, "m"),
        "pixel": as_text(surface.spacing, "m"),
        "periodic": str(surface.periodic),
    }
    undefined = surface.undefined_fraction
    if undefined:
        return facts | {"undefined": as_text(undefined, percent=True)}
    heights = {"Sq": to_text(surface.rms_height, "m"), "rms slope": f"{surface.rms_slope:.4g}"}
    return facts | heights


def _mean_square(values: NDArray) -> float:
    """Return the mean square of the defined values; NaN if no value is defined."""
    defined = values[~np.isnan(values)]
    return float(defined @ defined) / defined.size if defined.size else nan


def _clean(heights: Any) -> Array:
    """Return a read-only contiguous copy of heights, with masked points as NaN.

    An array that owns its memory and is read-only already is not copied.
    """
    if isinstance(heights, np.ma.MaskedArray) and heights.dtype.kind in "biuf":
        heights = np.ma.filled(heights.astype(np.float64), np.nan)
    is_constant = (
        type(heights) is np.ndarray and heights.flags.owndata and not heights.flags.writeable
    )
    z = validate.field("heights", heights, unit="m", undefined=True, copy=not is_constant)
    z.flags.writeable = False
    return z

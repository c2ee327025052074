"""Define a map of heights with its properties and operations, and decompose maps into waves.

Conventions: x1 = axis 0 is the leakage direction, x2 = axis 1 runs along the seal. Heights are sampled at pixel
centres; pixel (i, j) covers [iΔ1, (i+1)Δ1] × [jΔ2, (j+1)Δ2]. All values are in SI.

Along a periodic axis, a map is decomposed into a Fourier series. Along a mirrored axis (any axis that is not periodic),
the map continues as its mirror image; the decomposition of samples at pixel centres is then the cosine transform
DCT-II. Along a periodic axis of length L with n points, wave k is exp(i q x) with q = 2πk/L and k = −n/2 … n/2. Along a
mirrored axis, wave k is cos(q x) with q = πk/L and k = 0 … n−1. On periodic and on mirrored axes, x = 0 is the edge of
the first pixel.

Symbols: z heights (n1, n2) [m], d spacing [m], q angular wave number [rad/m], Sq rms height about the mean [m],
C spectral density. Sources of the definitions: ISO 25178-2 (Sq); Jacobs, Junge, Pastewka, Surf. Topogr.: Metrol. Prop.
5 (2017) 013001 (spectral densities).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import inf, isnan, nan
from typing import Any

import numpy as np
import scipy
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
from .defects import SPIKES, Form, TooManyUndefined, fill_holes, find_spikes, fit_form

#: A map that was declared periodic has a step at its border if the rms change of height there is more than this many
#: times the rms change between neighbouring points.
_STEP = 2.0
#: Relative tolerance of comparisons with a wave number, so that rounding errors do not matter for a wave at the limit.
SLACK = 1e-9


def wave_powers(z: NDArray, periodic: Periodic) -> NDArray:
    """Return the contribution of each wave to the mean square of the heights `z`, (n1, n2) [m²].

    The contributions of all waves add up to the mean square of `z` (Parseval's theorem).
    """
    _, wrapped = _mirrored_and_periodic_axes(periodic)
    half = half_spectrum(z, periodic)
    if not wrapped:
        return half**2 / z.size
    powers = np.empty(z.shape)
    # Along one axis, `half` contains only the waves k >= 0. In the views below, this axis is the last axis.
    halved_axis = wrapped[-1]
    half_view = half.swapaxes(-1, halved_axis)
    powers_view = powers.swapaxes(-1, halved_axis)
    n = z.shape[halved_axis]
    count = n // 2 + 1  # number of waves in `half` along this axis
    np.square(half_view.real, out=powers_view[:, :count])
    for row, waves in zip(powers_view, half_view, strict=True):
        row[:count] += waves.imag**2
    powers_view[:, :count] /= z.size
    # The waves −k are the conjugates of the waves k and contribute equally much. Wave −k has the index n − k, so that
    # the waves −k follow in the order of decreasing k, without k = 0 and, if n is even, without k = n/2.
    conjugates = powers_view[:, 1 : n - count + 1][:, ::-1]
    if len(wrapped) == 2:
        # The conjugate of wave (k1, k2) is (−k1, −k2). Row 0 contains the waves with k1 = 0 and their conjugates. The
        # conjugates of row k1 belong to row n1 − k1, so that the other rows are taken in reverse order.
        powers_view[0, count:] = conjugates[0]
        powers_view[1:, count:] = conjugates[:0:-1]
    else:
        powers_view[:, count:] = conjugates
    return powers


def half_spectrum(z: NDArray, periodic: Periodic) -> NDArray[Any]:
    """Compute the coefficients of the waves of `z` by an orthonormal transform.

    Along the last periodic axis, the result contains only the waves k >= 0, to save memory: the coefficient of wave −k
    is the complex conjugate of the coefficient of wave k. `half_multiplicity` counts how many waves (k, or k and −k)
    each coefficient represents.
    """
    mirrored, wrapped = _mirrored_and_periodic_axes(periodic)
    coefficients = scipy.fft.dctn(z, axes=mirrored, norm="ortho") if mirrored else z
    return scipy.fft.rfftn(coefficients, axes=wrapped, norm="ortho") if wrapped else coefficients


def half_multiplicity(shape: Shape, periodic: Periodic) -> tuple[NDArray, NDArray]:
    """Count how many waves of the full spectrum each coefficient of a `half_spectrum` represents.

    The coefficient in row i and column j represents rows[i] · columns[j] waves, which is 1 or 2. The arrays `rows` and
    `columns` are returned.
    """
    _, wrapped = _mirrored_and_periodic_axes(periodic)
    rows, columns = np.ones(shape[0]), np.ones(shape[1])
    if not wrapped:
        return rows, columns
    # along the axis with only the waves k >= 0, a coefficient represents wave k and its conjugate −k
    halved_axis = wrapped[-1]
    n = shape[halved_axis]
    factors = np.full(n // 2 + 1, 2.0)
    factors[0] = 1.0  # k = 0 is its own conjugate
    if n % 2 == 0:
        factors[-1] = 1.0  # the Nyquist wave is its own conjugate
    if halved_axis == 0:
        return factors, columns
    return rows, factors


def wavenumbers(n: int, d: float, periodic: bool) -> NDArray:
    """Return the wave numbers along an axis, (n,) [rad/m], in the order of the transform; signed if periodic."""
    if periodic:
        return 2 * np.pi * scipy.fft.fftfreq(n, d)
    return np.pi * np.arange(n) / (n * d)


def wavenumber_grids(shape: Shape, spacing: Pair, periodic: Periodic) -> tuple[NDArray, NDArray]:
    """Return the wave numbers along x1 (n1, 1) and along x2 (1, n2) [rad/m]."""
    q1 = wavenumbers(shape[0], spacing[0], periodic[0])
    q2 = wavenumbers(shape[1], spacing[1], periodic[1])
    return q1[:, None], q2[None, :]


def truncate(z: NDArray, spacing: Pair, periodic: Periodic, limit: float) -> NDArray:
    """Remove the waves with |q| > `limit` [rad/m] from the heights `z`, and return the result."""
    mirrored, wrapped = _mirrored_and_periodic_axes(periodic)
    coefficients = half_spectrum(z, periodic)
    q1, q2 = wavenumber_grids((z.shape[0], z.shape[1]), spacing, periodic)
    columns = coefficients.shape[1]
    for row, waves in enumerate(coefficients):  # one row at a time, to save memory
        is_short = q1[row] ** 2 + q2[0, :columns] ** 2 > (limit * (1 + SLACK)) ** 2
        waves[is_short] = 0
    if wrapped:
        points = [z.shape[axis] for axis in wrapped]
        coefficients = scipy.fft.irfftn(
            coefficients, points, axes=wrapped, norm="ortho", overwrite_x=True
        )
    if mirrored:
        coefficients = scipy.fft.idctn(coefficients, axes=mirrored, norm="ortho", overwrite_x=True)
    return coefficients


def resample_axis(z: NDArray, n: int, axis: int, periodic: bool) -> NDArray:
    """Interpolate `z` at the centres of `n` pixels along an axis, without waves that are too short for these pixels.

    The interpolation is exact for band-limited data. If the number of points along the axis changes from m to n, the
    spacing changes from d_m to d_n, and the centre of the first pixel moves from d_m/2 to d_n/2. This shift changes the
    phase of coefficient k by πk(1/n − 1/m).
    """
    m = z.shape[axis]
    if m == n:
        return z
    if not periodic:
        return scipy.fft.idct(scipy.fft.dct(z, axis=axis), n=n, axis=axis) * (n / m)
    k = np.arange(min(m, n) // 2 + 1)
    factor = np.exp(1j * np.pi * k * (1 / n - 1 / m)) * (n / m)
    # The sampled Nyquist wave contains the waves k and −k. On a finer grid its coefficient is divided between them; on
    # a coarser grid it is the sum of both.
    if min(m, n) % 2 == 0:
        factor[-1] *= 0.5 if m < n else 2.0
    coefficients = np.take(scipy.fft.rfft(z, axis=axis), k, axis)
    return scipy.fft.irfft(coefficients * np.expand_dims(factor, 1 - axis), n, axis=axis)


def _mirrored_and_periodic_axes(periodic: Periodic) -> tuple[list[int], list[int]]:
    """Return the indices of the mirrored (not periodic) axes, and the indices of the periodic axes."""
    mirrored = [axis for axis in (0, 1) if not periodic[axis]]
    wrapped = [axis for axis in (0, 1) if periodic[axis]]
    return mirrored, wrapped


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
        The heights are not two-dimensional, or are empty, complex or infinite. The spacing is not two finite numbers >
        0.

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
        return self._rms_slopes(inf)

    def rms_slope_of_long_waves(self, wavelength: float) -> float:
        """Return the rms of the slope |∇z| [-] of all waves at least as long as `wavelength` [m]."""
        return float(np.hypot(*self._rms_slopes(2 * np.pi / wavelength)))

    def _rms_slopes(self, limit: float) -> Pair:
        """Return the rms of ∂z/∂x1 and of ∂z/∂x2 of the waves with |q| <= `limit` [rad/m]."""
        half = half_spectrum(self._defined("rms_slope"), self.periodic)
        q1, q2 = wavenumber_grids(self.shape, self.spacing, self.periodic)
        q2_squared = q2[0, : half.shape[1]] ** 2
        # number of waves of the whole spectrum that each coefficient of the half spectrum stands for
        row_waves, column_waves = half_multiplicity(self.shape, self.periodic)
        # sums of the squares of both slopes over all waves, one row of the spectrum at a time, to save memory
        sum1 = sum2 = 0.0
        for row, coefficients in enumerate(half):
            q1_squared = q1[row, 0] ** 2
            powers = row_waves[row] * column_waves * np.abs(coefficients) ** 2
            powers[q1_squared + q2_squared > (limit * (1 + SLACK)) ** 2] = 0
            sum1 += q1_squared * powers.sum()
            sum2 += q2_squared @ powers
        points = self.heights.size
        return float(np.sqrt(sum1 / points)), float(np.sqrt(sum2 / points))

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
        powers = self._centred_power("psd").sum(axis=1 - axis)
        step = float(self._wave_steps[axis])
        if self.periodic[axis]:
            # The indices n − 1, n − 2, … contain the powers of the waves −1, −2, …, which are added to those of the
            # waves 1, 2, …. If n is even, the Nyquist wave n/2 stays alone.
            n = powers.size
            powers[1 : (n + 1) // 2] += powers[: n // 2 : -1]
            powers = powers[: n // 2 + 1]
        density = powers * (np.pi / step)
        density[0] *= 2  # q = 0 has half the weight
        return step * np.arange(density.size, dtype=np.float64), density

    def radial_psd(self) -> tuple[Array, Array]:
        """Return the two-dimensional spectral density, averaged over all directions of the wave vector.

        The mean square height Sq² is the integral of C2D/4π² over the plane of wave vectors. The density is averaged in
        rings of |q|. The width of each ring is the larger of the wave-number steps along x1 and x2.
        If a part of a ring lies beyond the Nyquist wave number of an axis, only the other part of the ring contributes
        to the average. Rings without waves are left out.

        Returns
        -------
        q : array, (rings,)
            Mean wave number |q| of the waves in each ring [rad/m].
        C2D : array, (rings,)
            Spectral density [m⁴].
        """
        z = self._defined("radial_psd")
        half = half_spectrum(z - z.mean(), self.periodic)
        q1, q2 = wavenumber_grids(self.shape, self.spacing, self.periodic)
        # Along a mirrored axis, each wave except k = 0 represents two wave vectors: its own wave vector and the mirror
        # image. Wave (i, j) represents row_copies[i] · column_copies[j] wave vectors.
        row_copies, column_copies = (
            np.where(is_periodic | (np.arange(n) == 0), 1.0, 2.0)
            for n, is_periodic in zip(self.shape, self.periodic, strict=True)
        )
        step = max(self._wave_steps)
        rings = int(np.hypot(np.abs(q1).max(), np.abs(q2).max()) / step) + 3
        count = np.zeros(rings)
        q_sum = np.zeros(rings)
        power_sum = np.zeros(rings)
        # number of waves of the whole spectrum that each coefficient of the half spectrum stands for
        row_waves, column_waves = half_multiplicity(self.shape, self.periodic)
        columns = half.shape[1]
        for row, coefficients in enumerate(half):  # one row at a time, to save memory
            q = np.hypot(q1[row], q2[0, :columns])
            ring = np.rint(q / step).astype(int) + 1
            if row == 0:
                ring[0] = 0  # the mean of the map is in ring 0, which is not returned
            waves = row_waves[row] * column_waves
            wave_vectors = waves * row_copies[row] * column_copies[:columns]
            powers = waves * np.abs(coefficients) ** 2 / z.size
            count += np.bincount(ring, wave_vectors, rings)
            q_sum += np.bincount(ring, q * wave_vectors, rings)
            power_sum += np.bincount(ring, powers, rings)
        filled = np.flatnonzero(count)[1:]  # without ring 0
        mean_q = q_sum[filled] / count[filled]
        mean_power = power_sum[filled] / count[filled]
        # each wave vector represents the area Δq1 Δq2 of the plane of wave vectors: power = C2D Δq1 Δq2/4π²
        area_per_wave = self._wave_steps[0] * self._wave_steps[1]
        return mean_q, mean_power * (4 * np.pi**2 / area_per_wave)

    @property
    def _wave_steps(self) -> Pair:
        """Steps between the wave numbers along x1 and x2 [rad/m], 2π/L on a periodic axis and π/L on any other axis."""
        first, second = (
            np.pi * (1 + is_periodic) / length
            for length, is_periodic in zip(self.size, self.periodic, strict=True)
        )
        return first, second

    def _centred_power(self, purpose: str) -> Array:
        """Return `wave_powers` of the heights about their mean."""
        z = self._defined(purpose)
        return wave_powers(z - z.mean(), self.periodic)

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

"""A map of heights of a seal face, with its properties and operations, and the waves that it is made of.

Conventions: x1 = axis 0 = leakage direction, x2 = axis 1 = along the seal; heights are cell-centred samples,
pixel (i, j) covers [iΔ1,(i+1)Δ1]×[jΔ2,(j+1)Δ2]; SI units.
Waves: Fourier on periodic axes, even (mirror) extension on others, which for cell-centred samples is the cosine
transform DCT-II, on the same n points. A wave of number k along a periodic axis of length L is exp(i q x), q = 2πk/L,
k = −n/2 … n/2; along a mirror axis cos(q x), q = πk/L, k = 0 … n−1. x = 0 is the edge of the first pixel.
Symbols: z heights (n1, n2) [m], d spacing [m], q angular wavenumber [rad/m], Sq rms height about the mean [m], C
spectral density.
Source of the definitions: ISO 25178-2 (Sq), Jacobs, Junge, Pastewka, Surf. Topogr.: Metrol. Prop. 5 (2017)
013001 (spectral densities).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import isnan, nan
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

#: A periodic axis has a step at its border where the height changes there by more than this many times the usual change
#: from point to point, rms.
_STEP = 2.0
#: Relative slack on a limit of wavenumber, so that rounding does not decide on the wave exactly at the limit.
SLACK = 1e-9


def power(z: NDArray, periodic: Periodic) -> NDArray:
    """Fraction (n1, n2) of each wave in the mean square of `z` [m²]; the sum is the mean square (Parseval)."""
    mirrored, wrapped = _axes(periodic)
    c = scipy.fft.dctn(z, axes=mirrored, norm="ortho") if mirrored else z
    if not wrapped:
        return c**2 / z.size
    # the real transform takes half the memory: the waves that it leaves out are conjugates of others
    half: NDArray[Any] = scipy.fft.rfftn(c, axes=wrapped, norm="ortho")
    powers = np.empty(z.shape)
    known = powers.swapaxes(-1, wrapped[-1])
    half = half.swapaxes(-1, wrapped[-1])
    n = z.shape[wrapped[-1]]
    count = n // 2 + 1  # waves of a real transform
    np.square(half.real, out=known[:, :count])
    for row, waves in zip(known, half, strict=True):
        row[:count] += waves.imag**2
    known[:, :count] /= z.size
    others = known[:, 1 : n - count + 1][:, ::-1]
    if len(wrapped) == 2:
        known[0, count:] = others[0]
        known[1:, count:] = others[:0:-1]
    else:
        known[:, count:] = others
    return powers


def wavenumbers(n: int, d: float, periodic: bool) -> NDArray:
    """Wavenumbers q (n,) [rad/m] of an axis in the order of transforms; signed on a periodic axis."""
    return 2 * np.pi * scipy.fft.fftfreq(n, d) if periodic else np.pi * np.arange(n) / (n * d)


def wavenumber_grids(shape: Shape, spacing: Pair, periodic: Periodic) -> tuple[NDArray, NDArray]:
    """q1 (n1, 1) and q2 (1, n2) [rad/m]."""
    q1, q2 = (wavenumbers(*axis) for axis in zip(shape, spacing, periodic, strict=True))
    return q1[:, None], q2[None, :]


def truncate(z: NDArray, spacing: Pair, periodic: Periodic, limit: float) -> NDArray:
    """Waves of `z` with |q| <= `limit` [rad/m]."""
    mirrored, wrapped = _axes(periodic)
    c = scipy.fft.dctn(z, axes=mirrored, norm="ortho")
    # of the last periodic axis waves k >= 0 alone
    c = scipy.fft.rfftn(c, axes=wrapped, norm="ortho") if wrapped else c
    q1, q2 = wavenumber_grids((z.shape[0], z.shape[1]), spacing, periodic)
    c[q1[: c.shape[0]] ** 2 + q2[:, : c.shape[1]] ** 2 > (limit * (1 + SLACK)) ** 2] = 0
    if wrapped:
        points = [z.shape[axis] for axis in wrapped]
        c = scipy.fft.irfftn(c, points, axes=wrapped, norm="ortho", overwrite_x=True)
    return scipy.fft.idctn(c, axes=mirrored, norm="ortho", overwrite_x=True)


def resample_axis(z: NDArray, n: int, axis: int, periodic: bool) -> NDArray:
    """Interpolant of `z` at the centres of `n` pixels along `axis`, without waves too short for them.

    Exact for band-limited data. With m points before and n after, coefficient k turns by the phase
    exp(iπk(1/n − 1/m)), because the first pixel centre moves from d_m/2 to d_n/2.
    """
    m = z.shape[axis]
    if m == n:
        return z
    if not periodic:
        return scipy.fft.idct(scipy.fft.dct(z, axis=axis), n=n, axis=axis) * (n / m)
    k = np.arange(min(m, n) // 2 + 1)
    weight = np.exp(1j * np.pi * k * (1 / n - 1 / m)) * (n / m)
    # The sampled Nyquist wave stands for a pair ±k: going up it is shared between both, going down it
    # collects both.
    if min(m, n) % 2 == 0:
        weight[-1] *= 0.5 if m < n else 2.0
    kept = np.take(scipy.fft.rfft(z, axis=axis), k, axis) * np.expand_dims(weight, 1 - axis)
    return scipy.fft.irfft(kept, n, axis=axis)


def _axes(periodic: Periodic) -> tuple[list[int], list[int]]:
    """Mirror axes and periodic ones."""
    return [k for k in (0, 1) if not periodic[k]], [k for k in (0, 1) if periodic[k]]


@dataclass(frozen=True, eq=False, repr=False)
class Topography(Plotted):
    """Heights on a regular grid.

    Along an axis where `periodic` is set the map continues by repeating itself, along the others by its
    mirror image; this is what every spectral quantity and operation below assumes between and beyond the
    samples.

    Parameters
    ----------
    heights : z (n1, n2) [m], kept as a read-only float64 copy; NaN (or masked) = undefined point.
    spacing : pixel size (Δ1, Δ2) [m].
    periodic : whether the map repeats itself along x1 and x2; one truth value stands for both.

    Raises
    ------
    InputError : heights not two-dimensional, empty, complex or infinite; spacing not two finite numbers > 0;
        from most operations, if there are undefined points: fill them first.

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
        """Side lengths (n1 Δ1, n2 Δ2) [m]."""
        return self.shape[0] * self.spacing[0], self.shape[1] * self.spacing[1]

    @property
    def patches(self) -> tuple[Topography, ...]:
        """The measured patches of the surface, see `Patches`: this map alone."""
        return (self,)

    @property
    def widths(self) -> tuple[int, ...]:
        """Points of every measured patch along x2."""
        return (self.shape[1],)

    @property
    def shortest_patch(self) -> Topography:
        """The shortest measured patch along x2: this map."""
        return self

    @property
    def undefined_fraction(self) -> float:
        """Fraction of undefined points, 0 to 1."""
        return float(np.isnan(self.heights).mean())

    @property
    def seamless(self) -> Periodic:
        """Whether the map is periodic along each axis and has no step where it repeats itself.

        A map that was measured has such a step even if it is called periodic, and so has a periodic one that was
        levelled: a plane is not periodic.
        """
        return self._is_seamless(0), self._is_seamless(1)

    def _is_seamless(self, axis: int) -> bool:
        if not self.periodic[axis]:
            return False
        lines = self.heights.swapaxes(0, axis)
        at_border = _mean_square(lines[0] - lines[-1])
        changes = [_mean_square(after - before) for before, after in pairwise(lines)]
        known = [change for change in changes if not isnan(change)]
        if isnan(at_border) or not known:
            return True
        return at_border <= _STEP**2 * sum(known) / len(known)

    @property
    def rms_height(self) -> float:
        """Sq, rms height about the mean [m]."""
        return float(self._defined("rms_height").std())

    @cached_property
    def rms_slopes(self) -> Pair:
        """Rms of ∂z/∂x1 and of ∂z/∂x2 [-], each √(Σ q_i² |c|²) over the waves of the map (Parseval).

        Exact for band-limited data. An axis that is not periodic goes by the mirrored map, so a tilt counts
        fully.
        """
        powers = power(self._defined("rms_slope"), self.periodic)
        q1, q2 = wavenumber_grids(self.shape, self.spacing, self.periodic)
        along1 = np.sum(q1[:, 0] ** 2 * powers.sum(axis=1))
        along2 = np.sum(q2[0] ** 2 * powers.sum(axis=0))
        return float(np.sqrt(along1)), float(np.sqrt(along2))

    @property
    def rms_slope(self) -> float:
        """h′_rms, rms of the modulus of the gradient |∇z| [-]; see `rms_slopes`."""
        return float(np.hypot(*self.rms_slopes))

    def detrend(self, order: int | None = 1) -> Topography:
        """Subtract the least-squares form of the map, see `form`.

        Undefined points are left out of the fit and stay undefined.

        Raises InputError: another order.
        """
        return self.with_heights(self.heights - self.form(order).heights)

    def form(self, order: int | None = None) -> Form:
        """Fit the mean (order 0), mean and tilt (1), or mean, tilt and curvature (2) to the defined points.

        A periodic map has no tilt: a plane fitted to it is a part of its waves, and subtracting it leaves a step where
        the map repeats itself. The order None therefore fits the mean, and the tilt only along axes on which the map is
        not `seamless`.

        Raises InputError: another order, or no defined point.
        """
        if order is None:
            first, second = self.seamless
            return fit_form(self.heights, self.size, 1, tilted=(not first, not second))
        return fit_form(self.heights, self.size, order)

    def low_pass(self, wavelength: float) -> Topography:
        """Waves with |q| <= 2π/`wavelength`, in any direction: truncation in Fourier space.

        Raises InputError: wavelength [m] not a finite number > 0.
        """
        limit = 2 * np.pi / validate.number("wavelength", wavelength, unit="m")
        return self.with_heights(
            truncate(self._defined("low_pass"), self.spacing, self.periodic, limit)
        )

    def high_pass(self, wavelength: float) -> Topography:
        """Map less its low-pass: the waves that `low_pass` removes."""
        return self.with_heights(self._defined("high_pass") - self.low_pass(wavelength).heights)

    def resample(self, shape: Shape) -> Topography:
        """Fourier interpolant of the map at the pixel centres of another grid (m1, m2) on the same area.

        Exact for band-limited data, up and down; waves too short for the new grid are left out, never folded.
        Half-pixel shifts of the centres are accounted for, so the surface does not move.

        Raises InputError: shape not two whole numbers >= 1.
        """
        new = validate.grid("shape", shape)
        z = self._defined("resample")
        for axis in (0, 1):
            z = resample_axis(z, new[axis], axis, self.periodic[axis])
        return Topography(z, (self.size[0] / new[0], self.size[1] / new[1]), self.periodic)

    def without_spikes(self, threshold: float = SPIKES) -> Topography:
        """Map with spikes marked undefined: isolated points `threshold` robust deviations off (`defects.py`).

        Raises InputError: threshold not > 0; infinite leaves all points.
        """
        return self.with_heights(
            np.where(find_spikes(self.heights, threshold), np.nan, self.heights)
        )

    def fill_undefined(self, max_share: float = 0.05) -> Topography:
        """Map with undefined points filled by the harmonic surface through their rims (`defects.py`).

        Raises InputError: more than `max_share` (0 to 1) of the points, or all of them, are undefined.
        """
        fraction = self.undefined_fraction
        limit = validate.number("max_share", max_share, inclusive=True)
        if fraction == 1:
            raise InputError("undefined points", "100 %", "a map with defined points")
        if fraction > limit:
            given, most = (as_text(part, percent=True) for part in (fraction, limit))
            expected = f"at most {most}: crop the map to a part with fewer, or raise max_undefined"
            raise TooManyUndefined("heights", f"{given} undefined points", expected)
        return self.with_heights(fill_holes(self.heights, self.spacing, self.periodic))

    def crop(self, shape: Shape, start: Shape = (0, 0)) -> Topography:
        """Part of `shape` points beginning at pixel `start`; an axis that loses points is periodic no more.

        Raises InputError: the part reaches beyond the map.
        """
        (m1, m2), (i, j) = validate.grid("shape", shape), validate.grid("start", start, minimum=0)
        if i + m1 > self.shape[0] or j + m2 > self.shape[1]:
            raise InputError(
                "crop",
                f"shape {(m1, m2)} from {(i, j)}",
                f"a part of the {self.shape} points of the map",
            )
        periodic = (
            self.periodic[0] and m1 == self.shape[0],
            self.periodic[1] and m2 == self.shape[1],
        )
        return Topography(self.heights[i : i + m1, j : j + m2], self.spacing, periodic)

    def crop_to(self, part: tuple[float, float, float, float]) -> Topography:
        """Part from x1 to x1, x2 to x2 [m], to whole pixels; see `crop`.

        Raises InputError: not four lengths, of no pixel, or beyond the map.
        """
        try:
            begin1, end1, begin2, end2 = (
                round(validate.number("crop", length, inclusive=True) / self.spacing[n // 2])
                for n, length in enumerate(part)
            )
            return self.crop((end1 - begin1, end2 - begin2), (begin1, begin2))
        except (TypeError, ValueError, IndexError):
            sides = " and ".join(to_text(length, "m") for length in self.size)
            allowed = f"x1 from, x1 to, x2 from, x2 to, each pair rising, within {sides}"
            raise InputError("crop", f"{part} m", allowed) from None

    def flip(self, axis: int) -> Topography:
        """Map reversed along an axis, as the upper of two faces must be before they are added."""
        return self.with_heights(np.flip(self.heights, validate.axis_number(axis)))

    def __add__(self, other: Topography) -> Topography:
        """Sum of two faces on one grid, the roughness to press on a rigid flat; periodic where both are.

        Raises InputError: shapes or spacings differ.
        """
        if not isinstance(other, Topography):
            return NotImplemented
        for name in ("shape", "spacing"):
            own, its = getattr(self, name), getattr(other, name)
            if not np.allclose(own, its, rtol=1e-9, atol=0):
                raise InputError(f"{name} of the second face", its, f"that of the first, {own}")
        periodic = (self.periodic[0] and other.periodic[0], self.periodic[1] and other.periodic[1])
        return Topography(self._defined("a sum") + other._defined("a sum"), self.spacing, periodic)

    def with_form(self, profile: NDArray) -> Topography:
        """The map with a profile along x1 (n1,) [m] added, along which it is periodic no more."""
        return Topography(self.heights + profile[:, None], self.spacing, (False, self.periodic[1]))

    def gap(self) -> Array:
        """Undeformed gap h1 = max z − z (n1, n2) [m] to a rigid flat that touches the highest point."""
        z = self._defined("gap")
        return z.max() - z

    def psd(self, axis: int) -> tuple[Array, Array]:
        """Spectral density of the profiles along `axis`, averaged over the other axis.

        Two-sided density C(q) = C(−q), given for q >= 0, so that Sq² = (1/2π)∫C dq over all q = (1/π)Σ C Δq
        with half the weight at q = 0, exactly; C(0) holds the variance of the profile means. Δq = 2π/L on a
        periodic axis, π/L on a mirror axis.

        Returns
        -------
        q [rad/m] and C [m³], each (n//2 + 1,) on a periodic axis, (n,) otherwise.
        """
        axis = validate.axis_number(axis)
        powers = self._centred_power("psd").sum(axis=1 - axis)
        step = float(self._wave_steps[axis])
        if self.periodic[axis]:  # waves of both signs together
            n = powers.size
            powers[1 : (n + 1) // 2] += powers[: n // 2 : -1]
            powers = powers[: n // 2 + 1]
        density = powers * (np.pi / step)
        density[0] *= 2
        return step * np.arange(density.size, dtype=np.float64), density

    def radial_psd(self) -> tuple[Array, Array]:
        """Spectral density averaged over directions, in rings of |q| one wave step wide (the larger).

        C2D is the two-sided density over the plane, Sq² = (1/4π²)∫C2D d²q; q is the mean |q| in the ring.
        Rings beyond the Nyquist number of an axis are averaged over the part of the ring that the grid
        carries.

        Returns
        -------
        q [rad/m] and C2D [m⁴], rings without waves left out.
        """
        powers = self._centred_power("radial_psd")
        q1, q2 = wavenumber_grids(self.shape, self.spacing, self.periodic)
        # A wave along a mirror axis stands for itself and its mirror image in the plane of wave vectors.
        first, second = (
            np.where(wraps | (np.arange(n) == 0), 1.0, 2.0)
            for n, wraps in zip(self.shape, self.periodic, strict=True)
        )
        step = max(self._wave_steps)
        rings = int(np.hypot(np.abs(q1).max(), np.abs(q2).max()) / step) + 3
        count, total_wave, total_power = np.zeros((3, rings))
        for row in range(self.shape[0]):  # one at a time, as several fields would take more memory
            q = np.hypot(q1[row], q2[0])
            ring = np.rint(q / step).astype(int) + 1
            copies = first[row] * second
            if row == 0:
                ring[0] = 0  # the mean
            count += np.bincount(ring, copies, rings)
            total_wave += np.bincount(ring, q * copies, rings)
            total_power += np.bincount(ring, powers[row], rings)
        keep = np.flatnonzero(count)[1:]
        waves = total_wave[keep] / count[keep]
        mean_power = total_power[keep] / count[keep]
        return waves, mean_power * (4 * np.pi**2 / (self._wave_steps[0] * self._wave_steps[1]))

    @property
    def _wave_steps(self) -> Pair:
        first, second = (
            np.pi * (1 + wraps) / length
            for length, wraps in zip(self.size, self.periodic, strict=True)
        )
        return first, second

    def _centred_power(self, purpose: str) -> Array:
        z = self._defined(purpose)
        return power(z - z.mean(), self.periodic)

    def with_heights(self, heights: NDArray) -> Topography:
        """The map with other heights at the same points."""
        return Topography(heights, self.spacing, self.periodic)

    def _defined(self, purpose: str) -> Array:
        if fraction := self.undefined_fraction:
            raise InputError(
                "heights",
                f"{as_text(fraction, percent=True)} undefined points",
                f"a map without them for {purpose}: use fill_undefined() first",
            )
        return self.heights

    def facts(self) -> dict[str, str]:
        """Points, size, pixel and heights as text."""
        size, pixel = as_text(self.size, "m"), as_text(self.spacing, "m")
        facts = {"points": as_text(self.shape), "size": size, "pixel": pixel}
        facts["periodic"] = str(self.periodic)
        if fraction := self.undefined_fraction:
            return facts | {"undefined": as_text(fraction, percent=True)}
        return facts | {"Sq": to_text(self.rms_height, "m"), "rms slope": f"{self.rms_slope:.4g}"}

    def _repr_html_(self) -> str:
        return TextTable(type(self).__name__, (), tuple(self.facts().items()))._repr_html_()

    def __repr__(self) -> str:
        return f"Topography({', '.join(f'{name} {text}' for name, text in self.facts().items())})"


def _mean_square(values: NDArray) -> float:
    """Return the mean square of the defined values, NaN if there is none."""
    defined = values[~np.isnan(values)]
    return float(defined @ defined) / defined.size if defined.size else nan


def _clean(heights: Any) -> Array:
    """Read-only contiguous copy of heights, masked points as NaN."""
    if isinstance(heights, np.ma.MaskedArray) and heights.dtype.kind in "biuf":
        heights = np.ma.filled(heights.astype(np.float64), np.nan)
    z = validate.field("heights", heights, unit="m", undefined=True)
    z.flags.writeable = False
    return z

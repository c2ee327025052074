"""Condition a measured map for contact and flow: remove spikes and form, fill undefined points, and low-pass it.

The form is fitted to the defined points before spikes and undefined points are filled, because filled points would
distort the form. Points that are treated as spikes may be real features of the surface. If spikes are among the highest
or deepest points of the surface, contact and leakage depend on whether the spikes are removed. The function
`spikes_extreme` computes what fraction of the highest and deepest points changes when spikes are removed.

The shortest wave that an instrument resolves follows from its tip radius or its lateral resolution. A round tip of
radius R follows a wave of amplitude a and wavelength λ if the curvature of the wave is at most the curvature of the
tip, a(2π/λ)² <= 1/R. The wavelength is then at least 2π√(aR). If a profile consists of many waves, the criterion uses
√2 times the rms curvature of the profile in place of the curvature a(2π/λ)².

Sources: section 4.1 of the model, after Pérez-Ràfols et al., Tribol. Lett. (2018): remove the tilt, truncate in Fourier
space so that the shortest wave is resolved by at least 8 pixels; Church and Takacs, Proc. SPIE 1332 (1991) 504 (tip);
ISO 25178-600 (lateral period limit: the wavelength at which the instrument shows half of the height).
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import atan, ceil, hypot, inf, pi, prod, sqrt
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import (
    Array,
    Flags,
    InputError,
    Labelled,
    Pair,
    Shape,
    counted,
    labelled,
    to_text,
    validate,
)
from .defects import SPIKES, Form, TooManyUndefined
from .generate import PIXELS_PER_WAVE
from .patches import Patches, Surface
from .texture import Spectrum, spectrum
from .topography import SLACK, Topography

#: Fractions of the points of a surface that count as its highest and as its lowest points. The highest points form the
#: contact, and the lowest points the last open paths.
_EXTREMES = (0.01, 0.03, 0.1)
#: Fraction of the extreme points above which spikes may decide the leakage.
_NOTABLE = 0.01
#: Waves that the instrument does not resolve count as removed, down to the shortest resolved wave divided by this
#: ratio.
UNSEEN = 10.0
#: A measured surface keeps its pixels if the waves of at least 8 pixels have at least this fraction of the rms slope of
#: all measured waves.
KEPT_SLOPE = 0.99


@dataclass(frozen=True)
class Instrument:
    """Describe the limits of the instrument that has measured a map.

    Parameters
    ----------
    tip_radius : float, optional
        Radius of the tip [m], if it is known.
    resolution : float, optional
        Lateral period limit [m], if it is known.
    generated_wave : float, optional
        Shortest wave of a generated surface [m]. None for a measured surface.
    """

    tip_radius: float | None = None
    resolution: float | None = None
    generated_wave: float | None = None

    def spectrum(self, flat: Surface) -> Spectrum:
        """Summarise the spectrum of a map without its form.

        For a generated surface, the summary contains only the shortest generated wave.
        """
        if self.generated_wave is not None:
            return Spectrum(self.generated_wave, 0.0, None)
        return spectrum(flat)

    def shortest_wave(self, flat: Surface) -> float:
        """Return the shortest wavelength [m] of a map that the instrument resolves; 0 if the limits are unknown."""
        limits = [self.resolution or 0.0]
        if self.tip_radius is not None:
            for patch in flat.patches:
                for axis in (0, 1):
                    limits.append(_shortest_followed_wave(patch, axis, self.tip_radius))
        return max(limits)


#: An instrument whose limits are unknown.
UNKNOWN = Instrument()


def _shortest_followed_wave(flat: Topography, axis: int, radius: float) -> float:
    """Return the shortest wavelength [m] that a stylus tip follows on the profiles of a map.

    Return 0 if the tip follows all waves of the profiles.

    axis : axis along which the profiles run.
    radius : radius of the tip [m].
    """
    q, density = flat.psd(axis)
    # Mean square curvature ∫q⁴C dq/π of all waves from 0 to q, for each wave number q, (waves,). The tip follows waves
    # whose curvature, √2 times the rms curvature, is at most 1/radius.
    square_curvature = np.cumsum(q**4 * density) * np.diff(q, prepend=0.0) / pi
    not_followed = np.flatnonzero(2 * square_curvature > radius**-2)
    if not not_followed.size:
        return 0.0
    last_followed = max(not_followed[0] - 1, 1)  # q[0] = 0 is not a wave
    return float(2 * pi / q[last_followed])


@dataclass(frozen=True, eq=False)
class Repair:
    """Describe the repairs made to a map.

    Parameters
    ----------
    undefined_fraction : float
        Fraction of undefined points, without spikes.
    spike_points : int
        Number of points in spikes.
    form : Form
        Form that was fitted to the defined points without spikes, and subtracted.
    removed : array, (n1, n2)
        Height of each spike above the surface that replaced it [m], 0 at all other points.
    """

    undefined_fraction: float
    spike_points: int
    form: Form
    removed: Array = field(repr=False)


def repair(
    topography: Topography,
    *,
    spikes: float = SPIKES,
    max_undefined: float = 0.05,
    detrend: int | None = None,
) -> tuple[Topography, Repair]:
    """Subtract the form of a map, and fill its spikes and undefined points.

    Spikes and undefined points are filled by the harmonic surface through the points around them.

    Parameters
    ----------
    topography : Topography
        The map as measured.
    spikes : float
        Threshold of `find_spikes` in robust standard deviations. If the threshold is infinite, no point is a spike.
    max_undefined : float
        Largest fraction of points, from 0 to 1, that may be filled: undefined points and spikes together.
    detrend : int, optional
        Form that is subtracted, see `Topography.form`.

    Returns
    -------
    topography : Topography
        The repaired map.
    repair : Repair
        Description of the repairs.

    Raises
    ------
    InputError
        Too many points have to be filled, or an argument is invalid.
    """
    without_spikes = topography.without_spikes(spikes)
    form = without_spikes.form(detrend)
    flat = without_spikes.detrend(detrend)
    is_spike = np.isnan(without_spikes.heights) & ~np.isnan(topography.heights)
    spike_points = int(np.count_nonzero(is_spike))
    try:
        flat = flat.fill_undefined(max_undefined)
    except TooManyUndefined as error:
        if not spike_points:
            raise
        expected = (
            f"{error.expected}; {spike_points} of them are spikes, which spikes=inf would keep"
        )
        raise TooManyUndefined(error.what, error.given, expected, {"spikes": inf}) from None
    if not spike_points:
        no_heights = np.broadcast_to(0.0, topography.shape)  # without memory of its own
        return flat, Repair(topography.undefined_fraction, 0, form, no_heights)
    # height of a spike above the filled surface: measured height − form − filled height
    removed = np.zeros(topography.shape)
    removed[is_spike] = topography.heights[is_spike] - form.at(is_spike) - flat.heights[is_spike]
    return flat, Repair(topography.undefined_fraction, spike_points, form, removed)


def spikes_extreme(flat: Topography, removed: Array, wavelength: float) -> float:
    """Return the fraction of the highest (or lowest) points that would be others if spikes were not removed.

    Extreme points are determined in the map with spikes and in the map without spikes. The fraction of extreme points
    that differ is computed separately for the highest and for the lowest points, and for each number in `_EXTREMES`.
    The largest fraction is returned.

    Parameters
    ----------
    flat : Topography
        The map in which spikes were replaced.
    removed : array, (n1, n2)
        Height of each spike above the surface that replaced it [m], 0 at all other points.
    wavelength : float
        Shortest wave [m] that remains in the two maps, with and without spikes, when their extreme points are compared.
    """
    if not removed.any():
        return 0.0
    before = _extreme_points(flat.low_pass(wavelength).heights)
    with_spikes = flat.with_heights(flat.heights + removed).low_pass(wavelength).heights
    exchanged = []
    for is_extreme, was_extreme in zip(_extreme_points(with_spikes), before, strict=True):
        new_points = int(np.count_nonzero(is_extreme & ~was_extreme))
        exchanged.append(new_points / max(int(np.count_nonzero(is_extreme)), 1))
    return max(exchanged)


def _extreme_points(heights: NDArray) -> list[Flags]:
    """Mark the highest and the lowest points of a map, for each fraction in `_EXTREMES`.

    Returns two boolean maps (n1, n2) for each fraction: the first is True at the highest points, the second at the
    lowest points.
    """
    extreme = []
    for fraction in _EXTREMES:
        low, high = np.quantile(heights, (fraction, 1 - fraction))
        extreme += [heights > high, heights < low]
    return extreme


#: Largest number of points of a grid that femseal chooses. The number is the same on all machines, so that results do
#: not depend on the machine. A deterministic solution on such a grid takes a few GB, and 10 to 40 s of one core for
#: each load step.
MOST_POINTS = 2**22


@dataclass(frozen=True)
class Conditioning(Labelled):
    """Report what was done to a measured map.

    Attributes that end in `_before` describe the repaired map before the low-pass.

    Attributes
    ----------
    reading : tuple of str
        Notes on how the file was interpreted where it is ambiguous.
    """

    undefined_fraction: float = labelled("undefined points, filled", percent=True)
    spike_points: int = labelled("points in spikes, filled")
    spikes_extreme: float = labelled("extremes that depend on spikes", percent=True)
    removed_tilt: Pair = labelled("tilt removed along x1, x2", "rad")
    removed_curvature: tuple[float, float, float] = labelled("curvature removed: 11, 12, 22", "1/m")
    shortest_seen: float | None = labelled("shortest wave that the instrument sees", "m")
    unseen_slope: float | None = labelled("rms slope of a decade of waves not measured")
    shortest_measured: float = labelled("shortest wave above noise, cut-off", "m")
    shortest_wave: float = labelled("shortest wave kept", "m")
    rms_height_before: float = labelled("Sq before the low-pass", "m")
    rms_height: float = labelled("Sq", "m")
    rms_slope_before: float = labelled("rms slope before the low-pass")
    rms_slope_measured: float = labelled("rms slope of waves above noise, cut-off")
    rms_slope: float = labelled("rms slope")
    shape_before: Shape = labelled("points measured")
    shape: Shape = labelled("points")
    spacing_before: Pair = labelled("pixel measured", "m")
    spacing: Pair = labelled("pixel", "m")
    reading: tuple[str, ...] = ()

    @property
    def lost_slope(self) -> float:
        """Fraction of the measured rms slope, 0 to 1, that is removed by the low-pass."""
        if not self.rms_slope_measured:
            return 0.0
        return max(0.0, 1 - self.rms_slope / self.rms_slope_measured)

    @property
    def kept_slope(self) -> float:
        """Ratio of the rms slope after conditioning to the rms slope of all waves, 0 to 1.

        The slope of all waves includes waves that were removed and waves that the instrument did not resolve, but no
        noise.
        """
        total = hypot(self.rms_slope_measured, self.unseen_slope or 0.0)
        if not total:
            return 1.0
        return min(self.rms_slope, self.rms_slope_measured) / total

    @property
    def spike_warnings(self) -> list[str]:
        """Warnings for the user if contact and leakage may depend on spikes; empty otherwise."""
        if not self.spikes_extreme > _NOTABLE:
            return []
        return [
            "contact and leakage may depend on spikes that were removed: "
            f"{self.spikes_extreme:.0%} of the highest or deepest points would change if spikes were kept "
            f"({counted(self.spike_points, 'point')} in spikes). Set surface.spikes = inf to keep "
            "them and compare both leakages, or mask points that are not part of the face with face.mask"
        ]

    @property
    def unseen(self) -> str:
        """Text for the user about the waves that the instrument does not resolve.

        The text is empty if no limit of the instrument is known, or if the unresolved waves were added to the map.
        """
        if self.shortest_seen is None or self.unseen_slope == 0:
            return ""
        limit = f"the instrument does not see waves below {to_text(self.shortest_seen, 'm', 3)}"
        if self.unseen_slope is None:
            return (
                f"{limit}. The spectrum has no power law, so that only the part of these waves which "
                "is in the map counts as removed"
            )
        return (
            f"{limit}. By the power law of the spectrum, the next decade of waves has an rms slope of "
            f"{self.unseen_slope:.3g}, in addition to {self.rms_slope_measured:.3g} of the measured ones. "
            "The error budget counts it as removed"
        )


def condition(
    topography: Surface,
    *,
    spikes: float = SPIKES,
    detrend: int | None = None,
    shortest_wave: float | None = None,
    max_undefined: float = 0.05,
    shape: Shape | Literal["auto"] | None = None,
    instrument: Instrument = UNKNOWN,
    shortest_wavelength: float | None = None,
) -> tuple[Surface, Conditioning]:
    """Prepare a measured map for contact and flow.

    The form of the defined points is subtracted, spikes and undefined points are filled, short waves are removed, and
    the map is interpolated on the grid `shape`, if it is given.

    Parameters
    ----------
    topography : Topography or Patches
        The map as measured, or several patches, each of which is conditioned separately.
    spikes : float
        Threshold above which isolated points are treated as spikes, see `find_spikes`. If the threshold is infinite, no
        point is a spike.
    detrend : int, optional
        Form that is subtracted: 0 for the mean, 1 for mean and tilt, 2 for mean, tilt and curvature. Default: the tilt,
        except along axes on which the map is periodic without a step, see `Topography.form`.
    shortest_wave : float, optional
        Shortest wave [m] that the conditioned map contains. Default: the longest of the following wavelengths: 8 pixels
        of the final grid; the shortest wave that the instrument resolves; and the shortest wave above noise and cut-off
        (see `describe_surface`), but at most 8 pixels of the measured map. To retain waves that are shorter than 8
        measured pixels, give a `shape` with at least 8 pixels per wave.
    max_undefined : float
        Largest fraction of undefined points, from 0 to 1, that may be filled, including spikes.
    shape : tuple of two int or "auto", optional
        Number of points of the final grid. Default: the number of measured points. With "auto", the number of points is
        chosen as for a run: the grid is finer than the measured pixels if waves shorter than 8 measured pixels
        contribute more than 1 % of the rms slope, see `default_points`.
    instrument : Instrument
        Limits of the instrument, if they are known.
    shortest_wavelength : float, optional
        Former name of `shortest_wave`.

    Returns
    -------
    topography : Topography or Patches
        The conditioned map.
    conditioning : Conditioning
        Report on the conditioning.

    Raises
    ------
    InputError
        Too many points are undefined, or the shortest wave is shorter than 8 pixels or longer than the map.

    Examples
    --------
    >>> from femseal.topography import self_affine
    >>> face = self_affine((128, 128), (1e-4, 1e-4), hurst=0.8, rms_height=1e-6, rng=1)
    >>> usable, done = condition(face, shortest_wave=20e-6)
    >>> bool(usable.rms_slope < face.rms_slope), done.spike_points
    (True, 0)
    """
    if shortest_wavelength is not None:
        warnings.warn("shortest_wavelength is shortest_wave now", DeprecationWarning, stacklevel=2)
        shortest_wave = shortest_wavelength
    if isinstance(shape, str) and shape != "auto":
        raise InputError("shape", repr(shape), 'two numbers of points, "auto" or None')
    is_automatic = isinstance(shape, str)
    final_shape = topography.shape
    if shape is not None and not is_automatic:
        final_shape = validate.grid("shape", shape)
    if shortest_wave is not None:
        validate.number("shortest_wave", shortest_wave, unit="m")
    if shortest_wave is not None and not is_automatic:
        # check the wave before any work, on the shortest patch and with the points that this patch will have
        patch = topography.shortest_patch
        columns = round(final_shape[1] * patch.shape[1] / topography.shape[1])
        check_wave(shortest_wave, patch.size, (final_shape[0], columns))
    repaired = [
        repair(patch, spikes=spikes, max_undefined=max_undefined, detrend=detrend)
        for patch in topography.patches
    ]
    first_patch, first_repair = repaired[0]
    flat: Surface = first_patch
    if isinstance(topography, Patches):
        flat = topography.with_patches([patch for patch, _ in repaired])
    if is_automatic:
        final_shape = default_points(flat, shortest_wave, instrument)
    return smooth(
        flat,
        first_repair.form,
        repaired,
        shortest_wave=shortest_wave,
        shape=final_shape,
        instrument=instrument,
    )


def smooth(
    flat: Surface,
    form: Form,
    parts: Sequence[tuple[Topography, Repair]],
    *,
    shortest_wave: float | None,
    shape: Shape,
    instrument: Instrument,
) -> tuple[Surface, Conditioning]:
    """Remove the short waves of a repaired map, and interpolate the map on the final grid; see `condition`.

    Parameters
    ----------
    flat : Topography or Patches
        The repaired map.
    form : Form
        Form that was subtracted; with several patches, the form of the first patch.
    parts : sequence of tuples of Topography and Repair
        Results of `repair` for all measured maps that make up `flat`.
    shortest_wave, shape, instrument
        See `condition`.

    Returns
    -------
    topography : Topography or Patches
        The conditioned map.
    conditioning : Conditioning
        Report on the conditioning.
    """
    waves = instrument.spectrum(flat)
    seen = instrument.shortest_wave(flat)
    measured = waves.shortest_wave
    unseen_slope = None
    if waves.law and seen:
        # Without a power law, the waves that the instrument does not resolve cannot be estimated. The part of these
        # waves that the map contains is then a lower bound.
        measured = max(measured, seen)
        unseen_slope = sqrt(waves.law.slope_power(measured, measured / UNSEEN))
    wave = default_wave(flat, shape, instrument) if shortest_wave is None else shortest_wave
    shortest = check_wave(wave, flat.size, shape)
    # computed before the result is, so that the temporary maps do not add to its memory
    extreme = max(spikes_extreme(face, part.removed, shortest) for face, part in parts)
    result = flat.low_pass(shortest).resample(shape)
    tilt1, tilt2 = form.slopes
    return result, Conditioning(
        undefined_fraction=sum(part.undefined_fraction for _, part in parts) / len(parts),
        spike_points=sum(part.spike_points for _, part in parts),
        spikes_extreme=extreme,
        removed_tilt=(atan(tilt1), atan(tilt2)),
        removed_curvature=form.curvatures,
        shortest_seen=seen or None,
        unseen_slope=unseen_slope,
        shortest_measured=measured,
        shortest_wave=shortest,
        rms_height_before=flat.rms_height,
        rms_height=result.rms_height,
        rms_slope_before=flat.rms_slope,
        rms_slope_measured=flat.rms_slope_of_long_waves(measured),
        rms_slope=result.rms_slope,
        shape_before=flat.shape,
        shape=result.shape,
        spacing_before=flat.spacing,
        spacing=result.spacing,
    )


def default_wave(flat: Surface, shape: Shape, instrument: Instrument) -> float:
    """Return the default value of `shortest_wave` [m] in `condition`, for a grid with a given number of points.

    The wavelength is the longest of three: 8 pixels of the grid, the shortest wave that the instrument resolves, and
    the shortest wave above the noise. The shortest wave above the noise is capped at 8 measured pixels, because a
    longer cut-off is only justified if the limits of the instrument are known.
    """
    eight_pixels_of_grid = resolved_wave(flat.size, shape)
    eight_pixels_of_map = resolved_wave(flat.size, flat.shape)
    above_noise = min(instrument.spectrum(flat).shortest_wave, eight_pixels_of_map)
    resolved_by_instrument = instrument.shortest_wave(flat)
    return max(eight_pixels_of_grid, above_noise, resolved_by_instrument)


def resolved_wave(size: Pair, shape: Shape) -> float:
    """Return the shortest wavelength [m] that has 8 pixels on a grid."""
    return PIXELS_PER_WAVE * max(length / n for length, n in zip(size, shape, strict=True))


def resolving_shape(size: Pair, wave: float, *, most: float = inf) -> Shape:
    """Choose the number of points so that a wave has 8 pixels or slightly more, and Fourier transforms are fast.

    Parameters
    ----------
    size : tuple of two float
        Sides of the surface [m].
    wave : float
        Shortest wavelength [m] that the grid must resolve.
    most : float
        Approximate upper limit on the number of points. If 8 pixels per wave would require more points than that, a
        wave has fewer than 8 pixels.

    Examples
    --------
    >>> resolving_shape((1e-3, 2e-3), 8e-6), resolving_shape((1e-3, 2e-3), 8e-6, most=500_000)
    ((1000, 2000), (500, 1000))
    """
    pixel = max(wave / PIXELS_PER_WAVE, sqrt(prod(size) / most))
    n1, n2 = (
        scipy.fft.next_fast_len(ceil(length / pixel * (1 - SLACK)), real=True) for length in size
    )
    return n1, n2


def default_points(level: Surface, shortest_wave: float | None, instrument: Instrument) -> Shape:
    """Choose the numbers of grid points for a measured surface.

    A wave is resolved if it is at least 8 pixels long. If waves resolved by the measured pixels account for nearly all
    of the rms slope, the grid keeps the measured pixels. Otherwise, the grid is finer and resolves the shortest
    measured wave, see `resolving_shape`. A grid with more than `MOST_POINTS` points is only chosen if `shortest_wave`
    requires it.

    Parameters
    ----------
    level : Topography or Patches
        Surface without undefined points.
    shortest_wave : float or None
        Shortest wave that the user wants to retain [m], which the grid must resolve. None if the user has not chosen a
        wave.
    instrument : Instrument
        Instrument with which the surface was measured.
    """
    # shortest wave that the measured pixels resolve
    wave_of_pixels = resolved_wave(level.size, level.shape)
    # wave that the grid must resolve
    wave = shortest_wave
    if wave is None:
        # shortest wave above noise and within the limits of the instrument
        measured = max(spectrum(level).shortest_wave, instrument.shortest_wave(level))
        slope_on_pixels = level.rms_slope_of_long_waves(wave_of_pixels)
        slope = level.rms_slope_of_long_waves(measured)
        wave = wave_of_pixels if slope_on_pixels >= KEPT_SLOPE * slope else measured
    if wave >= wave_of_pixels and level.heights.size <= MOST_POINTS:
        return level.shape
    # a finer grid or, if the map has too many pixels, a coarser grid
    points = resolving_shape(level.size, min(wave, wave_of_pixels), most=MOST_POINTS)
    if shortest_wave is not None and resolved_wave(level.size, points) > wave:
        # the limit of the number of points does not apply to a wave that the user has chosen
        return resolving_shape(level.size, wave)
    return points


def check_wave(wave: float, size: Pair, shape: Shape) -> float:
    """Check that a wave has at least 8 pixels on a grid and is shorter than the surface, and return it.

    wave : wavelength [m].
    size : sides of the surface [m].
    shape : number of points of the grid.
    """
    shortest = validate.number("shortest_wave", wave, unit="m")
    resolved = resolved_wave(size, shape)
    if shortest < resolved * (1 - SLACK):
        finer = resolving_shape(size, shortest)
        expected = (
            f"at least {PIXELS_PER_WAVE} pixels = {to_text(resolved, 'm')}, or shape={finer} for a "
            "finer grid"
        )
        raise InputError("shortest_wave", to_text(shortest, "m"), expected, {"shape": finer})
    if shortest >= max(size):
        expected = f"less than the larger side, {to_text(max(size), 'm')}"
        raise InputError("shortest_wave", to_text(shortest, "m"), expected)
    return shortest

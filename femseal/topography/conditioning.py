"""Condition a measured map for contact and flow: without spikes, flat, filled, and smooth at the scale of a pixel.

The form is fitted to the defined points alone, before anything is filled: filled points would bend it. Points called
spikes may be part of the face: heights and depths that a face has only by them would decide contact and leakage.
`spikes_extreme` measures that.
The shortest wave that an instrument sees follows from the radius of its tip or from its lateral resolution: a round tip
of radius R follows a wave of amplitude a and wavelength λ where it is blunter than the tip, a(2π/λ)² <= 1/R, that is
λ >= 2π√(aR). Of many waves the curvature of profiles counts, √2 times its rms in place of a(2π/λ)².
Sources: section 4.1 of the model, after Pérez-Ràfols et al., Tribol. Lett. (2018): remove the tilt, truncate
in Fourier space so that the shortest wave is resolved by at least 8 pixels; Church and Takacs, Proc. SPIE 1332 (1991)
504 (tip); ISO 25178-600 (lateral period limit: the wavelength at which the instrument shows half of the height).
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import atan, ceil, hypot, inf, pi, prod, sqrt

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Array, InputError, Labelled, Pair, Shape, counted, labelled, to_text, validate
from .defects import SPIKES, Form, TooManyUndefined
from .generate import PIXELS_PER_WAVE
from .patches import Patches, Surface
from .texture import Spectrum, spectrum
from .topography import SLACK, Topography

#: Fractions of a face, from its highest and from its lowest points, that contact and the last open paths are made of.
_EXTREMES = (0.01, 0.03, 0.1)
#: Fraction of the extreme points from which on leakage may hang on the spikes.
_NOTABLE = 0.01


#: The longest wave that was not seen over the shortest one that counts as removed.
UNSEEN = 10.0


@dataclass(frozen=True)
class Instrument:
    """Radius of the tip and lateral period limit [m] of an instrument; None where they are not known.

    made : shortest wave [m] of a face that is generated; None of a measured one.
    """

    tip_radius: float | None = None
    resolution: float | None = None
    made: float | None = None

    def spectrum(self, flat: Surface) -> Spectrum:
        """Summary of the spectrum of a flat map; of a generated one its shortest wave is known."""
        return spectrum(flat) if self.made is None else Spectrum(self.made, 0.0, None)

    def shortest_wave(self, flat: Surface) -> float:
        """Shortest wave [m] of a flat map that it sees; 0 where nothing is known of it, or nothing limits it."""
        found = [self.resolution or 0.0]
        if self.tip_radius is not None:
            found += [
                _followed(place, axis, self.tip_radius) for place in flat.patches for axis in (0, 1)
            ]
        return max(found)


#: Nothing is known of it.
UNKNOWN = Instrument()


def _followed(flat: Topography, axis: int, radius: float) -> float:
    """Shortest wave [m] of the profiles along an axis that a tip follows; 0 where it follows all of them."""
    q, density = flat.psd(axis)
    square = np.cumsum(q**4 * density) * np.diff(q, prepend=0.0) / pi
    lost = np.flatnonzero(2 * square > radius**-2)
    return float(2 * pi / q[max(lost[0] - 1, 1)]) if lost.size else 0.0


@dataclass(frozen=True, eq=False)
class Repair:
    """Defects found in a map: undefined points, spikes, and the form that was removed.

    undefined_fraction : of the points. spikes : points in them. form : of the defined points.
    removed : heights of the spikes above what they were filled with, 0 elsewhere (n1, n2) [m].
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
    """Flat map without spikes and without undefined points: both filled by the harmonic surface through their rims.

    topography : as measured.
    spikes : threshold of `find_spikes` in robust standard deviations; infinite leaves them.
    max_undefined : largest fraction of points (0 to 1) that may be filled, spikes included.
    detrend : order of the form taken off, see `Topography.form`.

    Raises InputError: more points to fill, or none that is defined; threshold not > 0; another order.
    """
    marked = topography.without_spikes(spikes)
    form = marked.form(detrend)
    flat = Topography(marked.heights - form.heights, marked.spacing, marked.periodic)
    spiked = np.isnan(marked.heights) & ~np.isnan(topography.heights)
    count = int(np.count_nonzero(spiked))
    try:
        flat = flat.fill_undefined(max_undefined)
    except TooManyUndefined as error:
        if not count:
            raise
        expected = f"{error.expected}; {count} of them are spikes, which spikes=inf leaves alone"
        raise TooManyUndefined(error.what, error.given, expected) from None
    removed = np.where(spiked, topography.heights - form.heights - flat.heights, 0.0)
    return flat, Repair(topography.undefined_fraction, count, form, removed)


def spikes_extreme(flat: Topography, removed: Array, wavelength: float) -> float:
    """Largest fraction of the highest or lowest points, after the low-pass, that are others where spikes are left.

    flat : the map with spikes filled.
    removed : heights of the spikes above what they were filled with (n1, n2) [m], 0 elsewhere.
    wavelength : shortest one [m] that is kept of the map.
    """
    if not removed.any():
        return 0.0
    smooth = flat.low_pass(wavelength).heights
    spiky = Topography(removed, flat.spacing, flat.periodic).low_pass(wavelength).heights
    return max(_exchanged(sign * smooth, sign * (smooth + spiky)) for sign in (1, -1))


def _exchanged(before: NDArray, after: NDArray) -> float:
    """Largest fraction of the highest points of `after` that are not among as many highest points of `before`."""
    fractions = []
    for fraction in _EXTREMES:
        high = after > np.quantile(after, 1 - fraction)
        others = high & ~(before > np.quantile(before, 1 - fraction))
        fractions.append(float(others.sum() / max(high.sum(), 1)))
    return max(fractions)


#: Most points of a grid that nobody asked for. It does not depend on the machine, so that results do not either; a
#: deterministic solution of as many takes a few GB, and some 10 to 40 s of one core for each load step.
MOST_POINTS = 2**22


@dataclass(frozen=True)
class Conditioning(Labelled):
    """What was done to a measured map; "before" means filled and flat, but not yet low-passed.

    reading : sentences on how its file was understood, where that is not obvious.
    """

    undefined_fraction: float = labelled("undefined points, filled", percent=True)
    spike_points: int = labelled("points in spikes, filled")
    spikes_extreme: float = labelled("extremes hanging on spikes", percent=True)
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
        """Fraction of the measured rms slope (0 to 1) that is removed with the waves shorter than those kept."""
        if not self.rms_slope_measured:
            return 0.0
        return max(0.0, 1 - self.rms_slope / self.rms_slope_measured)

    @property
    def kept_slope(self) -> float:
        """Rms slope over that with the waves that were removed, but for noise, or not seen by the instrument."""
        whole = hypot(self.rms_slope_measured, self.unseen_slope or 0.0)
        return min(self.rms_slope, self.rms_slope_measured) / whole if whole else 1.0

    @property
    def spike_doubts(self) -> list[str]:
        """A sentence where contact and leakage may hang on the spikes."""
        if not self.spikes_extreme > _NOTABLE:
            return []
        return [
            f"{self.spikes_extreme:.0%} of the highest or deepest points of the face hang on spikes "
            f"({counted(self.spike_points, 'point')}), which are filled: so may contact and leakage; surface.spikes = "
            "inf leaves them: compare both leakages, or mark what is no part of the face by face.mask"
        ]

    @property
    def unseen(self) -> str:
        """A sentence on the waves that the instrument does not see; "" where no limit is known, or they were added."""
        if self.shortest_seen is None or self.unseen_slope == 0:
            return ""
        text = f"the instrument sees no wave below {to_text(self.shortest_seen, 'm', 3)}"
        if self.unseen_slope is None:
            return f"{text}; without a power law in the spectrum only what the map has of such waves counts as removed"
        return (
            f"{text}; by the power law of the spectrum the next decade has a rms slope of {self.unseen_slope:.3g}, "
            f"beside {self.rms_slope_measured:.3g} of those measured; the error budget counts it as removed"
        )


def condition(
    topography: Surface,
    *,
    spikes: float = SPIKES,
    detrend: int | None = None,
    shortest_wave: float | None = None,
    max_undefined: float = 0.05,
    shape: Shape | None = None,
    instrument: Instrument = UNKNOWN,
    shortest_wavelength: float | None = None,
) -> tuple[Surface, Conditioning]:
    """Take off the form of the defined points, fill spikes and undefined ones, low-pass, resample if asked.

    Parameters
    ----------
    topography : the map as measured, or several patches, each of which is conditioned by itself.
    spikes : threshold of isolated points that are taken for undefined ones, see `find_spikes`; infinite leaves them.
    detrend : order of the form removed: 0 mean, 1 tilt, 2 tilt and curvature. Unless given: the tilt, but not along an
        axis on which the map is periodic without a step, see `Topography.form`.
    shortest_wave : waves kept are no shorter [m]. Unless given: 8 pixels of the final grid, but no less than the
        shortest wave above noise and cut-off of the instrument (see `describe_surface`), or 8 measured pixels where
        these are shorter, and no less than the instrument sees. A wave of less than 8 measured pixels needs `shape`
        with a grid that gives it 8 pixels.
    max_undefined : largest fraction of undefined points (0 to 1) that may be filled, spikes included.
    shape : final number of points; as measured unless given.
    instrument : what is known of it. shortest_wavelength : former name of shortest_wave.

    Returns
    -------
    The usable map and the report of what was done.

    Raises
    ------
    InputError : too many undefined points; a shortest wave of less than 8 pixels, or longer than the
        map.

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
    final = topography.shape if shape is None else validate.grid("shape", shape)
    if shortest_wave is not None:
        patch = topography.shortest_patch
        points = final[0], round(final[1] * patch.shape[1] / topography.shape[1])
        check_wave(shortest_wave, patch.size, points)
    parts = [
        repair(patch, spikes=spikes, max_undefined=max_undefined, detrend=detrend)
        for patch in topography.patches
    ]
    flat: Surface = parts[0][0]
    if isinstance(topography, Patches):
        flat = topography.with_patches([patch for patch, _ in parts])
    form = parts[0][1].form
    return smooth(
        flat, form, parts, shortest_wave=shortest_wave, shape=final, instrument=instrument
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
    """Low-pass and resample a flat map; other arguments, results and errors are those of `condition`.

    form : that was taken off, of the first of several patches.
    parts : what `repair` returned of the maps that were measured, or made, for it.
    """
    waves, seen = instrument.spectrum(flat), instrument.shortest_wave(flat)
    # without a law what the map shows of waves that are not seen is the least that is there
    measured = max(waves.shortest_wave, seen if waves.law else 0.0)
    unseen = (
        sqrt(waves.law.slope_power(measured, measured / UNSEEN)) if waves.law and seen else None
    )
    wave = default_wave(flat, shape, instrument) if shortest_wave is None else shortest_wave
    shortest = check_wave(wave, flat.size, shape)
    kept = flat.low_pass(shortest).resample(shape)
    tilt1, tilt2 = form.slopes
    return kept, Conditioning(
        undefined_fraction=sum(part.undefined_fraction for _, part in parts) / len(parts),
        spike_points=sum(part.spike_points for _, part in parts),
        spikes_extreme=max(spikes_extreme(face, part.removed, shortest) for face, part in parts),
        removed_tilt=(atan(tilt1), atan(tilt2)),
        removed_curvature=form.curvatures,
        shortest_seen=seen or None,
        unseen_slope=unseen,
        shortest_measured=measured,
        shortest_wave=shortest,
        rms_height_before=flat.rms_height,
        rms_height=kept.rms_height,
        rms_slope_before=flat.rms_slope,
        rms_slope_measured=flat.low_pass(measured).rms_slope,
        rms_slope=kept.rms_slope,
        shape_before=flat.shape,
        shape=kept.shape,
        spacing_before=flat.spacing,
        spacing=kept.spacing,
    )


def default_wave(flat: Surface, shape: Shape, instrument: Instrument) -> float:
    """Shortest wave that is kept on a grid unless given [m], see `condition`.

    A longer one than 8 pixels of the map would be a guess where the instrument is not known: noise is removed on demand
    only.
    """
    kept = min(instrument.spectrum(flat).shortest_wave, resolved_wave(flat.size, flat.shape))
    return max(resolved_wave(flat.size, shape), kept, instrument.shortest_wave(flat))


def resolved_wave(size: Pair, shape: Shape) -> float:
    """Shortest wave with 8 pixels of a grid [m]."""
    return PIXELS_PER_WAVE * max(length / n for length, n in zip(size, shape, strict=True))


def resolving_shape(size: Pair, wave: float, *, most: float = inf) -> Shape:
    """Points along x1 and x2 at which a wave has 8 pixels or a little more, in numbers that transform fast.

    size : of the face [m].
    wave : shortest wave that shall be kept [m].
    most : points of the grid at most, about: where the wave takes more, the pixels are wider.

    >>> resolving_shape((1e-3, 2e-3), 8e-6), resolving_shape((1e-3, 2e-3), 8e-6, most=500_000)
    ((1000, 2000), (500, 1000))
    """
    pixel = max(wave / PIXELS_PER_WAVE, sqrt(prod(size) / most))
    n1, n2 = (
        scipy.fft.next_fast_len(ceil(length / pixel * (1 - SLACK)), real=True) for length in size
    )
    return n1, n2


def check_wave(wave: float, size: Pair, shape: Shape) -> float:
    """The wave; InputError if it has fewer than 8 pixels of a grid, or is no shorter than a face of such sides [m]."""
    shortest = validate.number("shortest_wave", wave, unit="m")
    resolved = resolved_wave(size, shape)
    if shortest < resolved * (1 - SLACK):
        finer = resolving_shape(size, shortest)
        allowed = f"at least {PIXELS_PER_WAVE} pixels = {to_text(resolved, 'm')}, or shape={finer} for a finer grid"
        raise InputError("shortest_wave", to_text(shortest, "m"), allowed)
    if shortest >= max(size):
        allowed = f"less than the larger side, {to_text(max(size), 'm')}"
        raise InputError("shortest_wave", to_text(shortest, "m"), allowed)
    return shortest

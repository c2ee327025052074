"""Condition a measured map for contact and flow: remove spikes and form, fill undefined points, low-pass filter it.

`repairs` describes the first two steps, and `grid_choice` how the shortest wave and the grid are chosen.

Source: Pérez-Ràfols et al., Proc. IMechE J (2018), who remove the tilt, and the waves that are shorter than 8 pixels.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from math import atan, hypot, prod, sqrt
from typing import Literal

import numpy as np

from ..base import InputError, Labelled, Pair, Shape, counted, labelled, to_text, validate
from .defects import SPIKES
from .form_fit import Form
from .grid_choice import check_wave, default_points, default_wave
from .instrument_limits import UNKNOWN, UNSEEN, Instrument
from .patches import Patches, Surface
from .repairs import Repair, repair, spikes_extreme
from .topography import Topography

#: If removing the spikes changes more than this fraction of the extreme points, the spikes may determine the leakage.
_NOTABLE = 0.01


@dataclass(frozen=True)
class Conditioning(Labelled):
    """Report what was done to a measured map.

    Attributes that end in `_before` describe the repaired map before the low-pass filter.

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
    rms_height_before: float = labelled("Sq before the low-pass filter", "m")
    rms_height: float = labelled("Sq", "m")
    rms_slope_before: float = labelled("rms slope before the low-pass filter")
    rms_slope_measured: float = labelled("rms slope of waves above noise, cut-off")
    rms_slope: float = labelled("rms slope")
    shape_before: Shape = labelled("points measured")
    shape: Shape = labelled("points")
    spacing_before: Pair = labelled("pixel measured", "m")
    spacing: Pair = labelled("pixel", "m")
    reading: tuple[str, ...] = ()

    @property
    def lost_slope(self) -> float:
        """Fraction of the measured rms slope, 0 to 1, that is removed by the low-pass filter."""
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
        # check the wave before any computation, for the shortest patch with the number of points that it will have
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
    # patches may differ in size, and two faces in the size of their pixels; each map is weighted by its area
    areas = [prod(face.size) for face, _ in parts]
    undefined_fractions = [part.undefined_fraction for _, part in parts]
    # computed before the conditioned map, so that the temporary maps are not in memory at the same time
    extreme = max(spikes_extreme(face, part.removed, shortest) for face, part in parts)
    result = flat.low_pass(shortest).resample(shape)
    tilt1, tilt2 = form.slopes
    return result, Conditioning(
        undefined_fraction=float(np.average(undefined_fractions, weights=areas)),
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

"""Repair of a measured map: spikes are marked undefined, the form is removed, undefined points are filled.

The form is fitted to the defined points alone, before anything is filled: filled points would bend it.

Points called spikes may be part of the face. Where they follow the lay they come with the marks of machining, or with
steps that an instrument makes there; and heights and depths that a face has only by them would decide contact and
leakage. Neither is decided here: `SpikeEffect` measures it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isnan

import numpy as np
import scipy
from numpy.typing import NDArray

from .form import Form, fit_form
from .spikes import SPIKES
from .texture import texture
from .topography import Topography
from .undefined_points import TooManyUndefined

#: Spikes are neighbours up to this distance [pixels].
_NEAR = 30.0
#: Fewer spikes show no direction.
_FEWEST = 20
#: Clear deviation from scattering, in standard deviations of as many independent directions as there are spikes.
_CLEAR = 5.0
#: Fractions of a face, from its highest and from its lowest points, that contact and the last open paths are made of.
_EXTREMES = (0.01, 0.03, 0.1)
#: Fraction of the extreme points from which on leakage may hang on the spikes.
_NOTABLE = 0.01
_ADVICE = "surface.spikes = inf leaves them: compare both leakages, or mark what is no part of the face by face.mask"
_ALL_NEIGHBOURS = np.ones((3, 3))


@dataclass(frozen=True, eq=False)
class Repair:
    """Defects found in a map: undefined points, spikes, and the form that was removed.

    removed : heights of the spikes above what they were filled with, 0 elsewhere (n1, n2) [m].
    """

    undefined_fraction: float = field(metadata={"unit": "", "label": "fraction of undefined points", "percent": True})
    spikes: int = field(metadata={"unit": "", "label": "points in spikes"})
    form: Form = field(metadata={"unit": "", "label": "form of the defined points"})
    removed: NDArray[np.float64] = field(repr=False, metadata={"unit": "m", "label": "spikes above their filling"})


def repair(
    topography: Topography, *, spikes: float = SPIKES, max_undefined: float = 0.05, detrend: int = 1
) -> tuple[Topography, Repair]:
    """Flat map without spikes and without undefined points: both filled by the harmonic surface through their rims.

    topography : as measured.
    spikes : threshold of `find_spikes` in robust standard deviations; infinite leaves them.
    max_undefined : largest fraction of points (0 to 1) that may be filled, spikes included.
    detrend : order of the form taken off, see `Topography.detrend`.

    Raises InputError: more points to fill, or none that is defined; threshold not > 0; another order.
    """
    marked = topography.without_spikes(spikes)
    count = round((marked.undefined_fraction - topography.undefined_fraction) * topography.heights.size)
    form = fit_form(marked.heights, marked.size, detrend)
    flat = Topography(marked.heights - form.heights, marked.spacing, marked.periodic)
    try:
        flat = flat.fill_undefined(max_undefined)
    except TooManyUndefined as error:
        if topography.undefined_fraction > max_undefined:
            raise
        raise TooManyUndefined(error.fraction, error.limit, error.part, count) from None
    spiked = np.isnan(marked.heights) & ~np.isnan(topography.heights)
    removed = np.where(spiked, topography.heights - form.heights - flat.heights, 0.0)
    return flat, Repair(topography.undefined_fraction, count, form, removed)


@dataclass(frozen=True)
class SpikeEffect:
    """Measures of the points called spikes in a map; None where there is nothing to tell.

    along_lay : fraction of neighbouring spikes that lie rather along the lay than across, of scattered ones half; None
        also where it is not clearly more than that.
    extreme : largest fraction of the highest or lowest points, after the low-pass, that are others where spikes are
    left.
    """

    along_lay: float | None = None
    extreme: float | None = None

    def doubts(self, count: int) -> list[str]:
        """One sentence for each reason to look at the spikes, of which there are `count` points."""
        found = []
        if self.along_lay is not None:
            found.append(
                f"{count} points called spikes are filled although they follow the lay ({self.along_lay:.0%} of "
                "neighbours lie along it, scattered ones would by half): they may be part of the marks of machining"
            )
        if self.extreme is not None and self.extreme > _NOTABLE:
            found.append(
                f"{self.extreme:.0%} of the highest or deepest points of the face hang on {count} points called "
                "spikes, which are filled: so may contact and leakage"
            )
        return [f"{text}; {_ADVICE}" for text in found]


def spike_effect(flat: Topography, removed: NDArray[np.float64], wavelength: float) -> SpikeEffect:
    """Measure spikes that were filled.

    flat : the map with spikes filled.
    removed : heights of the spikes above what they were filled with (n1, n2) [m], 0 elsewhere.
    wavelength : shortest one [m] that is kept of the map.
    """
    spikes = removed != 0
    if not spikes.any():
        return SpikeEffect()
    smooth = flat.low_pass(wavelength).heights
    spiky = smooth + Topography(removed, flat.spacing, flat.periodic).low_pass(wavelength).heights
    extreme = max(_exchanged(sign * smooth, sign * spiky) for sign in (1, -1))
    return SpikeEffect(_along_lay(spikes, flat), extreme)


def _exchanged(before: NDArray, after: NDArray) -> float:
    """Largest fraction of the highest points of `after` that are not among as many highest points of `before`."""
    fractions = []
    for fraction in _EXTREMES:
        high = after > np.quantile(after, 1 - fraction)
        others = high & ~(before > np.quantile(before, 1 - fraction))
        fractions.append(int(np.count_nonzero(others)) / max(int(np.count_nonzero(high)), 1))
    return max(fractions)


def _along_lay(spikes: NDArray[np.bool_], flat: Topography) -> float | None:
    """Fraction of pairs of neighbouring spikes that lie rather along the lay, if it is clearly more than half."""
    groups, count = scipy.ndimage.label(spikes, _ALL_NEIGHBOURS)
    if count < _FEWEST or isnan(lay := texture(flat).lay_direction):
        return None
    places = np.array(scipy.ndimage.center_of_mass(spikes, groups, np.arange(1, count + 1)))
    pairs = scipy.spatial.KDTree(places).query_pairs(_NEAR, output_type="ndarray")
    if len(pairs) < _FEWEST:
        return None
    # in pixels, so that scattered pairs lie along the lay by half on oblong pixels too
    direction = np.array([-np.sin(lay) / flat.spacing[0], np.cos(lay) / flat.spacing[1]])
    steps = places[pairs[:, 0]] - places[pairs[:, 1]]
    cosine = np.abs(steps @ direction) / (np.hypot(*steps.T) * np.hypot(*direction))
    fraction = float(np.mean(cosine > np.sqrt(0.5)))
    return fraction if 2 * (fraction - 0.5) * np.sqrt(count) > _CLEAR else None

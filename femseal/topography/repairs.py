"""Repair a measured map: remove its spikes and its form, and fill its undefined points.

The form is fitted to the defined points before spikes and undefined points are filled, because filled points would
distort the form. Points that are treated as spikes may be real features of the surface. If spikes are among the highest
or deepest points of the surface, contact and leakage depend on whether the spikes are removed. The function
`spikes_extreme` computes what fraction of the highest and deepest points changes when spikes are removed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from ..base import Array, Flags
from .defects import SPIKES, TooManyUndefined
from .form_fit import Form
from .topography import Topography

#: Fractions of the points of a surface that count as its highest and as its lowest points. The highest points form the
#: contact, and the lowest points the last open paths.
_EXTREMES = (0.01, 0.03, 0.1)


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
    removed : sparse array, (n1, n2)
        Height of each spike above the surface that replaced it [m], 0 at all other points.
    """

    undefined_fraction: float
    spike_points: int
    form: Form
    removed: coo_array = field(repr=False)


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
            f"{error.expected}; {spike_points} of them are spikes, which {{spikes}} would keep"
        )
        raise TooManyUndefined(error.what, error.given, expected, {"spikes": inf}) from None
    # height of a spike above the filled surface: measured height − form − filled height
    removed = topography.heights[is_spike] - form.at(is_spike) - flat.heights[is_spike]
    spikes_removed = coo_array((removed, np.nonzero(is_spike)), shape=topography.shape)
    return flat, Repair(topography.undefined_fraction, spike_points, form, spikes_removed)


def spikes_extreme(flat: Topography, removed: Array | coo_array, wavelength: float) -> float:
    """Return the fraction of the highest or lowest points that would be different points if spikes were not removed.

    Extreme points are determined in the map with spikes and in the map without spikes. The fraction of extreme points
    that differ is computed separately for the highest and for the lowest points, and for each number in `_EXTREMES`.
    The largest fraction is returned.

    Parameters
    ----------
    flat : Topography
        The map in which spikes were replaced.
    removed : array or sparse array, (n1, n2)
        Height of each spike above the surface that replaced it [m], 0 at all other points.
    wavelength : float
        Shortest wave [m] that remains in the two maps, with and without spikes, when their extreme points are compared.
    """
    removed = coo_array(removed)
    if not removed.data.any():
        return 0.0
    # eight points in a byte, to save memory
    before = [
        np.packbits(is_extreme) for is_extreme in _extreme_points(flat.low_pass(wavelength).heights)
    ]
    heights = flat.heights.copy()
    heights[removed.coords] += removed.data
    heights.flags.writeable = False  # a map copies an array only if it is writeable
    with_spikes = flat.with_heights(heights).low_pass(wavelength).heights
    del heights
    exchanged = []
    for is_extreme, packed in zip(_extreme_points(with_spikes), before, strict=True):
        was_extreme = (
            np.unpackbits(packed, count=is_extreme.size).view(bool).reshape(is_extreme.shape)
        )
        new_points = int(np.count_nonzero(is_extreme & ~was_extreme))
        exchanged.append(new_points / max(int(np.count_nonzero(is_extreme)), 1))
    return max(exchanged)


def _extreme_points(heights: NDArray) -> Iterator[Flags]:
    """Mark the highest and the lowest points of a map, for each fraction in `_EXTREMES`.

    Yields two boolean maps (n1, n2) for each fraction: the first is True at the highest points, the second at the
    lowest points.
    """
    for fraction in _EXTREMES:
        low, high = np.quantile(heights, (fraction, 1 - fraction))
        yield heights > high
        yield heights < low

"""Evaluate the texture of a map: its autocorrelation length, its texture aspect ratio and the direction of its lay.

The autocorrelation length Sal is the distance over which the autocorrelation decays to 0.2 in the direction of fastest
decay. The texture aspect ratio Str is the ratio of Sal to the distance over which the autocorrelation decays to 0.2 in
the direction of slowest decay. Std is the direction of the lay.

Source: ISO 25178-2 (Sal, Str, Std).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan, pi
from typing import NamedTuple

import numpy as np
import scipy

from ..base import Array
from .topography import Topography

#: Value below which the autocorrelation has decayed (ISO 25178-2).
_DECAYED = 0.2
#: Directions in which the autocorrelation is evaluated, from x1 towards x2 [rad].
_ANGLES = np.deg2rad(np.arange(180))
#: Aspect ratio above which a surface has no direction (ISO 25178-2).
ISOTROPIC = 0.5


@dataclass(frozen=True)
class Texture:
    """Texture parameters of a map.

    Parameters
    ----------
    correlation_length : float
        Autocorrelation length Sal [m].
    aspect_ratio : float
        Texture aspect ratio Str [-].
    aspect_ratio_is_bound : bool
        Whether `aspect_ratio` is only an upper bound of Str.
    lay_direction : float
        Direction Std of the lay [rad]: its angle from x2, in (−π/2, π/2] and positive in the sense from x1 towards x2.
        The direction is NaN if the surface has no lay.
    """

    correlation_length: float
    aspect_ratio: float
    aspect_ratio_is_bound: bool
    lay_direction: float


def texture(topography: Topography) -> Texture:
    """Compute the texture parameters of a map whose form has been removed and whose points are all defined.

    Sal is the distance over which the autocorrelation falls to 0.2 in the direction of fastest decay. Str is the ratio
    of Sal to the distance over which the autocorrelation falls to 0.2 in the direction of slowest decay. If the
    autocorrelation does not fall to 0.2 within the map in some direction, the size of the map in that direction is used
    instead, and Str is an upper bound. Std is the direction, rounded to a degree, in which the mean autocorrelation is
    largest; Std is NaN if Str > 0.5. All parameters are NaN for a flat map and for a map with a single row.
    """
    if topography.rms_height == 0 or min(topography.shape) < 2:
        return Texture(nan, nan, False, nan)
    distance, border, correlation = _correlation_by_direction(topography)
    step = distance[1]
    is_inside = distance < border[:, None] + step / 2
    has_decayed = (correlation < _DECAYED) & is_inside
    decays = has_decayed.any(axis=1)  # (angle,)
    # argmax returns the first distance at which the autocorrelation has decayed
    decay_length = np.where(decays, distance[np.argmax(has_decayed, axis=1)], border)
    shortest = decay_length[decays].min() if decays.any() else border.max()
    ratio = float(shortest / decay_length.max())
    lay = nan
    if ratio <= ISOTROPIC:
        # averages over distances that are inside the map in all directions
        mean_correlation = correlation[:, distance < border.min()].mean(axis=1)
        angle_from_x1 = _ANGLES[np.argmax(mean_correlation)]
        # a lay has no sense of direction: its angle from x2 is reduced to (−π/2, π/2]
        lay = pi / 2 - (-angle_from_x1) % pi
    return Texture(float(shortest), ratio, not bool(decays.all()), float(lay))


class _DirectionalCorrelation(NamedTuple):
    """Autocorrelation of a map in the directions `_ANGLES`.

    distance : distances from the middle at which it is evaluated, equally spaced from 0 on, (distance,) [m].
    border : distance from lag 0 to the largest lag of the autocorrelation in each direction, (angle,) [m].
    correlation : autocorrelation, (angle, distance). Values at distances larger than `border` have no meaning.
    """

    distance: Array
    border: Array
    correlation: Array


def _correlation_by_direction(topography: Topography) -> _DirectionalCorrelation:
    """Interpolate the autocorrelation of a map on straight lines from its middle in the directions `_ANGLES`."""
    middle = np.array([n // 2 for n in topography.shape])
    spacing = np.array(topography.spacing)
    direction = np.array([np.cos(_ANGLES), np.sin(_ANGLES)]).T  # (angle, axis)
    border = (middle * spacing / np.maximum(np.abs(direction), 1e-12)).min(axis=1)
    step = spacing.min() / 2
    distance = np.arange(0, border.max() + step / 2, step)
    # fractional indices into the autocorrelation (angle, distance, axis)
    index = middle + (direction / spacing)[:, None] * distance[:, None]
    # `map_coordinates` takes the indices as (axis, distance, angle) and returns (distance, angle)
    correlation = scipy.ndimage.map_coordinates(
        autocorrelation(topography), index.T, order=1, mode="nearest"
    ).T
    return _DirectionalCorrelation(distance, border, correlation)


def autocorrelation(topography: Topography) -> Array:
    """Return the autocorrelation of a map, as the mean over all pairs of points with the same lag.

    All points of a pair lie inside the map, so that no assumption about the surface beyond its borders is needed.

    Returns
    -------
    array, (2 m1 + 1, 2 m2 + 1)
        Autocorrelation at lags of −m to m pixels with m = n // 2 along each axis. The autocorrelation at lag 0, in the
        middle of the array, is 1.
    """
    z = topography.heights - topography.heights.mean()
    n1, n2 = topography.shape
    m1, m2 = n1 // 2, n2 // 2
    # zeros beyond the borders, so that the transform does not pair points from opposite borders
    padded = [scipy.fft.next_fast_len(2 * n, real=True) for n in (n1, n2)]
    spectrum = scipy.fft.rfft2(z, padded)
    for row in spectrum:  # one row at a time and in place, to save memory
        row[:] = row.real**2 + row.imag**2
    sums = scipy.fft.irfft2(spectrum, padded, overwrite_x=True)
    del spectrum
    lag1 = np.arange(-m1, m1 + 1)
    lag2 = np.arange(-m2, m2 + 1)
    pairs = np.outer(n1 - np.abs(lag1), n2 - np.abs(lag2))
    correlation = sums[np.ix_(lag1, lag2)]  # negative lags are at the end of each axis
    correlation /= pairs
    correlation /= correlation[m1, m2].copy()
    return correlation

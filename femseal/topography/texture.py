"""Texture of a map: autocorrelation length, aspect ratio, and direction of the lay.

Symbols: s = 0.2 level to which the autocorrelation decays, Sal and Str lengths of that decay, Std direction.
Source: ISO 25178-2 (Sal, Str, Std). Angles are counted from x1 towards x2.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan, pi

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import fft

from .topography import Topography

_DECAYED = 0.2
_ANGLES = np.deg2rad(np.arange(180))
#: Waves with a smaller number on a side have too few directions, and belong to the form.
_LEAST_WAVES = 2.5
#: Width of the sectors over which power is summed [rad].
_LOBE = np.deg2rad(8)
#: Aspect ratio above which a face has no direction (ISO 25178-2).
ISOTROPIC = 0.5


@dataclass(frozen=True)
class Texture:
    """Autocorrelation length Sal [m], aspect ratio Str [-] or a bound above, direction Std of the lay [rad] or NaN."""

    correlation_length: float
    aspect_ratio: float
    aspect_ratio_is_bound: bool
    lay_direction: float


def texture(topography: Topography) -> Texture:
    """Texture of a flat map without undefined points.

    Sal is the shortest distance in which the autocorrelation falls to 0.2, Str that over the longest; where the map
    ends before it falls, its reach is taken for the longest and Str is an upper bound. Std is the direction of the
    lay from x2, at right angles to the waves with most power; NaN where Str > 0.5, and all of it where the map is
    flat or a single row.
    """
    if topography.rms_height == 0 or min(topography.shape) < 2:
        return Texture(nan, nan, False, nan)
    distance, reach = _decay(topography)
    fallen = np.isfinite(distance)
    longest = np.where(fallen, distance, reach).max()
    shortest = distance.min() if fallen.any() else longest
    ratio = float(shortest / longest)
    lay = _lay(topography) if ratio <= ISOTROPIC else nan
    return Texture(float(shortest), ratio, not bool(fallen.all()), lay)


def autocorrelation(topography: Topography) -> NDArray[np.float64]:
    """Autocorrelation (2 m1 + 1, 2 m2 + 1) of a map (n1, n2) at lags of up to m = n // 2 pixels, 1 in the middle.

    Mean over the pairs of points that lie that far apart: nothing is assumed beyond the borders.
    """
    z = topography.heights - topography.heights.mean()
    (n1, n2), (m1, m2) = topography.shape, (n // 2 for n in topography.shape)
    padded = [fft.next_fast_len(2 * n, real=True) for n in (n1, n2)]
    sums = fft.irfft2(np.abs(fft.rfft2(z, padded)) ** 2, padded)
    i, j = np.arange(-m1, m1 + 1), np.arange(-m2, m2 + 1)
    pairs = np.outer(n1 - np.abs(i), n2 - np.abs(j))
    lagged = sums[np.ix_(i, j)] / pairs
    return lagged / lagged[m1, m2]


def _decay(topography: Topography) -> tuple[NDArray, NDArray]:
    """Distance (180,) [m] to the level 0.2 in each direction, inf where it is not reached, and the reach of the map."""
    correlation = autocorrelation(topography)
    middle, spacing = np.array([n // 2 for n in topography.shape]), np.array(topography.spacing)
    step = spacing.min() / 2
    distance, reach = np.empty(_ANGLES.size), np.empty(_ANGLES.size)
    for k, angle in enumerate(_ANGLES):
        direction = np.array([np.cos(angle), np.sin(angle)])
        reach[k] = (middle * spacing / np.maximum(np.abs(direction), 1e-12)).min()
        r = np.arange(0, reach[k] + step / 2, step)
        places = middle[:, None] + np.outer(direction / spacing, r)
        below = scipy.ndimage.map_coordinates(correlation, places, order=1, mode="nearest") < _DECAYED
        distance[k] = r[np.argmax(below)] if below.any() else np.inf
    return distance, reach


def _lay(topography: Topography) -> float:
    """Direction [rad] from x2 in (−π/2, π/2] of the lines along which heights stay the same."""
    n1, n2 = topography.shape
    window = np.outer(np.hanning(n1 + 2)[1:-1], np.hanning(n2 + 2)[1:-1])
    power = np.abs(fft.fft2((topography.heights - topography.heights.mean()) * window)) ** 2
    k1, k2 = n1 * fft.fftfreq(n1)[:, None], n2 * fft.fftfreq(n2)[None, :]
    power[np.hypot(k1, k2) < _LEAST_WAVES] = 0
    angle = np.arctan2(k2 / topography.size[1], k1 / topography.size[0]) % pi
    sector = np.rint(np.rad2deg(angle)).astype(int) % 180
    spectrum = np.bincount(sector.ravel(), power.ravel(), 180)
    direction = _ANGLES[np.argmax(scipy.ndimage.uniform_filter1d(spectrum, 5, mode="wrap"))]
    # the mean over a lobe about the strongest sector is not in its middle; that about the mean is
    for _ in range(3):
        beside = (angle - direction + pi / 2) % pi - pi / 2
        near = np.abs(beside) < _LOBE
        if power[near].any():
            direction += np.average(beside[near], weights=power[near])
    return float(pi / 2 - (pi / 2 - direction) % pi)

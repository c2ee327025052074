"""Filter profiles and surfaces for roughness parameters, and choose the cut-offs of the filters by standards.

The weighting function of the Gaussian filter is exp(−π(x/αλ)²)/αλ with α² = ln 2/π, so that a wave of the cut-off λ
keeps half of its amplitude. Two filters are applied: a filter with the cut-off λs removes waves shorter than λs, and a
filter with the cut-off λc removes waves longer than λc. Sources: ISO 16610-21 and 16610-61 (filters), ISO 4288 and ISO
21920-3 (cut-offs).
"""

from __future__ import annotations

from math import log, nan, pi, sqrt
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Pair


class CutOffs(NamedTuple):
    """Cut-offs λs and λc of two filters that the standard applies together.

    least_ra : smallest Ra [m] of the filtered profiles for which the standard recommends both filters.
    long, short : cut-offs λc and λs [m].
    """

    least_ra: float
    long: float
    short: float


#: Standard filters, from the longest to the shortest.
STANDARD_CUT_OFFS = (
    CutOffs(1e-5, 8e-3, 2.5e-5),
    CutOffs(2e-6, 2.5e-3, 8e-6),
    CutOffs(1e-7, 8e-4, 2.5e-6),
    CutOffs(2e-8, 2.5e-4, 2.5e-6),
    CutOffs(0.0, 8e-5, 2.5e-6),
)
#: Largest mean spacing RSm [m] for each long-wave filter λc [m], see ISO 4288 and ISO 21920-3.
_FILTERS_OF_SPACING = ((4e-5, 8e-5), (1.3e-4, 2.5e-4), (4e-4, 8e-4), (1.3e-3, 2.5e-3), (4e-3, 8e-3))


def long_wave_filter(spacing: float) -> float:
    """Return the cut-off λc [m] of the long-wave filter for a mean spacing RSm of the profile elements [m].

    >>> long_wave_filter(0.15e-3)
    0.0008
    """
    for largest, cut_off in _FILTERS_OF_SPACING:
        if spacing <= largest:
            return cut_off
    return _FILTERS_OF_SPACING[-1][1]


def gaussian_filter(z: NDArray, spacing: Pair, cut_off: float, axes: tuple[int, ...]) -> NDArray:
    """Apply a Gaussian low-pass filter with a given cut-off [m] along some axes; return NaN if the cut-off is NaN.

    z : heights, (n1, n2) [m]. Beyond a border, the heights continue as their mirror image.
    spacing : pixel size (Δ1, Δ2) [m].
    """
    if not cut_off > 0:
        return np.full(z.shape, nan)
    for axis in axes:
        n = z.shape[axis]
        # A Gaussian weighting function with the standard deviation σ transmits exp(−σ²q²/2) of the wave q. Here σ is in
        # pixels, and the waves of the cosine transform have q = πk/n with k = 0 … n − 1.
        deviation = sqrt(log(2) / 2) / pi * cut_off / spacing[axis]
        transmission = np.exp(-0.5 * (pi * deviation * np.arange(n) / n) ** 2)
        waves = scipy.fft.dct(z, axis=axis) * np.expand_dims(transmission, 1 - axis)
        z = scipy.fft.idct(waves, axis=axis)
    return z

"""Parameters of roughness as drawings have them, of profiles and of the face, behind the Gaussian filters.

The filter has the weight exp(−π(x/αλ)²)/αλ, α² = ln 2/π: half of a wave of the cut-off λ passes. λs takes off the
shorter waves, λc the longer ones. Beyond its borders the map goes on as its mirror image.
Sources: ISO 16610-21 and 16610-61 (filters), ISO 21920-2 (Ra, Rq, Rz, Rsk), ISO 21920-3 (cut-offs), ISO 25178-2.
"""

from __future__ import annotations

from math import log, nan, pi, sqrt
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from .topography import Topography

#: The Ra above which a cut-off is taken, λc, and its λs [m].
_SERIES = (
    (1e-5, 8e-3, 2.5e-5),
    (2e-6, 2.5e-3, 8e-6),
    (1e-7, 8e-4, 2.5e-6),
    (2e-8, 2.5e-4, 2.5e-6),
    (0.0, 8e-5, 2.5e-6),
)
#: Sections of the length λc over which Rz is averaged, where as many fit in.
_SECTIONS = 5


def roughness(flat: Topography) -> dict[str, Any]:
    """Parameters of a flat map without undefined points, by their names in `SurfaceReport`.

    Those of profiles are along x1 and along x2, means over all of them. λc is the longest of the series that
    fits into the profile and suits the Ra behind it; NaN where none fits. Sa, Sq, Sz and Ssk are of the map
    behind the filters of the longer of both λc, along both axes.
    """
    along = [_of_profiles(flat, axis) for axis in (0, 1)]
    cut_offs = [profile[0] for profile in along]
    cut_off = max((c for c in cut_offs if c > 0), default=nan)
    short = next((short for _, own, short in _SERIES if own == cut_off), nan)
    z = _smooth(flat, flat.heights, short, (0, 1))
    z = z - _smooth(flat, z, cut_off, (0, 1))
    names = ("profile_cut_off", "ra", "rq", "rz", "rsk")
    areal = dict(zip(("sa", "sq", "ssk"), _moments(z.ravel()), strict=True))
    profiles = {name: (along[0][n], along[1][n]) for n, name in enumerate(names)}
    return {**profiles, **areal, "sz": float(np.ptp(z))}


def _of_profiles(flat: Topography, axis: int) -> tuple[float, ...]:
    """λc, Ra, Rq, Rz, Rsk of the profiles along an axis; NaN where they are shorter than every cut-off."""
    found = (nan,) * 5
    for least, cut_off, short in _SERIES:
        if cut_off > flat.size[axis] * (1 + 1e-9):
            continue
        z = _smooth(flat, flat.heights, short, (axis,))
        z = np.moveaxis(z - _smooth(flat, z, cut_off, (axis,)), axis, -1)
        ra, rq, rsk = _moments(z)
        points = max(1, round(cut_off / flat.spacing[axis]))
        sections = max(1, min(_SECTIONS, z.shape[1] // points))
        rz = np.mean([np.ptp(part, axis=1) for part in np.split(z[:, : sections * points], sections, axis=1)])
        found = cut_off, ra, rq, float(rz), rsk
        if ra > least:
            break
    return found


def _smooth(flat: Topography, z: NDArray, cut_off: float, axes: tuple[int, ...]) -> NDArray:
    """Heights (n1, n2) [m] behind the Gaussian filter along axes; NaN without a cut-off."""
    for axis in axes:
        deviation = sqrt(log(2) / 2) / pi * cut_off / flat.spacing[axis]
        z = scipy.ndimage.gaussian_filter1d(z, deviation, axis, truncate=5.0) if cut_off > 0 else np.full(z.shape, nan)
    return z


def _moments(z: NDArray) -> tuple[float, float, float]:
    """Arithmetic mean height, rms height [m] and skewness, about the mean along the last axis, averaged."""
    z = z - z.mean(axis=-1, keepdims=True)
    rms = np.sqrt(np.mean(z**2, axis=-1))
    with np.errstate(invalid="ignore", divide="ignore"):
        skewness = np.mean(z**3, axis=-1) / rms**3
    return float(np.mean(np.abs(z))), float(np.mean(rms)), float(np.mean(skewness))

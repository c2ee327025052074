"""Compute Ra and Rz of profiles across the lay of a generated surface, for comparison with a drawing.

The profiles are filtered as a roughness tester does: a Gaussian filter with the cut-off λc (ISO 16610-21) removes the
long waves. For periodic profiles, λc is chosen by the mean spacing RSm of the profile elements, which is the feed per
revolution of a turned surface. For irregular profiles, λc is chosen by Ra. If the surface is shorter than λc, the
profiles are not filtered. Sources: ISO 4288 and ISO 21920-3 (choice of λc), ISO 21920-2 (Ra, Rz, Rq).
"""

from dataclasses import dataclass

import numpy as np

from .describe import _SERIES, _gaussian_filter
from .topography import Topography

#: Largest mean spacing RSm [m] for each long-wave filter λc [m], see ISO 4288 and ISO 21920-3.
_FILTERS = ((4e-5, 8e-5), (1.3e-4, 2.5e-4), (4e-4, 8e-4), (1.3e-3, 2.5e-3), (4e-3, 8e-3))
#: Ratio of the limits of Rz and Ra at which ISO 4288 changes the filter.
_RZ_OVER_RA = 5.0
#: Largest number of sections of the length λc over which Rz is averaged.
_SECTIONS = 5


@dataclass(frozen=True)
class ProfileRoughness:
    """Roughness of profiles along x1.

    Attributes
    ----------
    ra, rz : float
        Arithmetic mean deviation Ra [m], and mean peak-to-valley height Rz [m] of the sections of a profile.
    rq : float
        Root mean square deviation Rq [m].
    cut_off : float
        Cut-off λc of the long-wave filter [m]; NaN if the surface is too short to be filtered.
    """

    ra: float
    rz: float
    rq: float
    cut_off: float


def profile_roughness(
    surface: Topography,
    spacing: float | None = None,
    *,
    ra: float | None = None,
    rz: float | None = None,
) -> ProfileRoughness:
    """Compute Ra and Rz of the profiles along x1.

    Parameters
    ----------
    surface : Topography
        The surface, without undefined points.
    spacing : float, optional
        Mean spacing RSm of the profile elements of a periodic profile [m], from which the long-wave filter is chosen.
        If `spacing` is None, the profile is irregular, and the filter is chosen from Ra.
    ra, rz : float, optional
        Ra or Rz that a drawing states [m]. For an irregular profile, the filter is then chosen from the stated value
        instead of the computed Ra, so that a surface near the limit between two filters is judged with one of them.

    Returns
    -------
    ProfileRoughness
        Means over all profiles.

    Examples
    --------
    The Ra of a wave of 0.1 mm is 2/π times its amplitude:

    >>> x = (np.arange(500) + 0.5) * 2e-6
    >>> wave = Topography(1e-6 * np.cos(2 * np.pi * x / 1e-4)[:, None] * np.ones((1, 8)), (2e-6, 2e-6))
    >>> round(profile_roughness(wave, 1e-4).ra * 1e6, 2)
    0.63
    """
    if spacing is not None:
        return _filtered_roughness(surface, long_wave_filter(spacing))
    if ra is None and rz is not None:
        ra = rz / _RZ_OVER_RA
    if ra is not None:
        cut_off = next(filters.long for filters in _SERIES if ra > filters.least_ra)
        return _filtered_roughness(surface, cut_off)
    # from the longest cut-off to the shortest, until Ra is large enough for the filter
    for filters in _SERIES:
        roughness = _filtered_roughness(surface, filters.long)
        if roughness.ra > filters.least_ra:
            break
    return roughness


def _filtered_roughness(surface: Topography, cut_off: float) -> ProfileRoughness:
    """Compute the roughness of the profiles along x1 without the waves that are longer than a cut-off λc [m]."""
    heights = surface.heights
    sections = 1  # of the length λc, over which Rz is averaged; the whole profile without a filter
    if cut_off <= surface.size[0]:
        heights = heights - _gaussian_filter(surface, heights, cut_off, (0,))
        sections = min(_SECTIONS, int(surface.size[0] / cut_off + 1e-9))
    else:
        cut_off = np.nan
    heights = heights - heights.mean(axis=0)
    points = len(heights) // sections
    parts = np.split(heights[: sections * points], sections)
    rz = float(np.mean([np.ptp(part, axis=0) for part in parts]))
    return ProfileRoughness(
        ra=float(np.abs(heights).mean()),
        rz=rz,
        rq=float(heights.std(axis=0).mean()),
        cut_off=float(cut_off),
    )


def long_wave_filter(spacing: float) -> float:
    """Return the cut-off λc [m] of the long-wave filter for a mean spacing RSm of the profile elements [m].

    >>> long_wave_filter(0.15e-3)
    0.0008
    """
    for largest, cut_off in _FILTERS:
        if spacing <= largest:
            return cut_off
    return _FILTERS[-1][1]

"""Compute the roughness parameters Ra, Rz, Rq and Rsk of the profiles of a surface.

The parameters are computed for two purposes:

- `profile_roughness` is for the comparison of a generated surface with a drawing, and filters the profiles across the
  lay as a roughness tester does: a Gaussian filter with the cut-off λc removes the long waves. For periodic profiles,
  λc is chosen by the mean spacing RSm of the profile elements, which is the feed per revolution of a turned surface.
  For irregular profiles, λc is chosen by Ra. If the surface is shorter than λc, the profiles are not filtered.
- `standard_profile_parameters` is for the description of a measured surface along both axes. It applies both filters of
  the standard, and λc is never longer than the profile.

Source: ISO 21920-2 (Ra, Rz, Rq, Rsk). The module `roughness_filters` contains the filters and their cut-offs.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base import validate
from .roughness_filters import STANDARD_CUT_OFFS, gaussian_filter, long_wave_filter
from .topography import Topography

#: Ratio of the limits of Rz and Ra at which ISO 4288 changes the filter.
_RZ_OVER_RA = 5.0


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
        instead of the computed Ra, so that surfaces near the limit between two filters are all evaluated with the same
        filter.

    Returns
    -------
    ProfileRoughness
        Means over all profiles.

    Raises
    ------
    InputError
        The stated Ra or Rz is not a number > 0.

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
    if ra is not None:
        validate.number("ra", ra, unit="m")
    elif rz is not None:
        ra = validate.number("rz", rz, unit="m") / _RZ_OVER_RA
    if ra is not None:
        cut_off = next(cut_offs.long for cut_offs in STANDARD_CUT_OFFS if ra > cut_offs.least_ra)
        return _filtered_roughness(surface, cut_off)
    # from the longest cut-off to the shortest, until Ra is large enough for the filter
    for cut_offs in STANDARD_CUT_OFFS:
        roughness = _filtered_roughness(surface, cut_offs.long)
        if roughness.ra > cut_offs.least_ra:
            break
    return roughness


def _filtered_roughness(surface: Topography, cut_off: float) -> ProfileRoughness:
    """Compute the roughness of the profiles along x1 without the waves that are longer than a cut-off λc [m]."""
    heights = surface.heights
    if cut_off <= surface.size[0]:
        heights = heights - gaussian_filter(heights, surface.spacing, cut_off, (0,))
    else:
        cut_off = np.nan
    heights = heights - heights.mean(axis=0)
    return ProfileRoughness(
        ra=float(np.abs(heights).mean()),
        rz=_mean_section_height(heights.T, cut_off / surface.spacing[0]),
        rq=float(heights.std(axis=0).mean()),
        cut_off=float(cut_off),
    )


class ProfileParameters(NamedTuple):
    """Roughness parameters of profiles: λc [m], Ra [m], Rq [m], Rz [m] and Rsk [-]."""

    cut_off: float = nan
    ra: float = nan
    rq: float = nan
    rz: float = nan
    rsk: float = nan


def standard_profile_parameters(flat: Topography, axis: int) -> ProfileParameters:
    """Compute the roughness parameters of profiles along an axis; NaN if all cut-offs are longer than a profile."""
    parameters = ProfileParameters()
    # from the longest cut-off to the shortest, until the Ra is large enough for the filters
    for cut_offs in STANDARD_CUT_OFFS:
        if cut_offs.long > flat.size[axis] * (1 + 1e-9):
            continue
        z = gaussian_filter(flat.heights, flat.spacing, cut_offs.short, (axis,))
        z = z - gaussian_filter(z, flat.spacing, cut_offs.long, (axis,))
        profiles = np.moveaxis(z, axis, -1)  # (profile, point)
        moments = height_moments(profiles)
        rz = _mean_section_height(profiles, cut_offs.long / flat.spacing[axis])
        parameters = ProfileParameters(
            cut_offs.long, moments.mean, moments.rms, rz, moments.skewness
        )
        if moments.mean > cut_offs.least_ra:
            break
    return parameters


def _mean_section_height(profiles: NDArray, length: float) -> float:
    """Compute Rz [m], the mean height from the lowest to the highest point of the sections of all profiles.

    The standard prescribes five sections by default. All whole sections of a longer profile are used, as for Ra,
    because a mean over more sections has the same expected value and less scatter.

    profiles : heights of the profiles (profile, point) [m].
    length : length λc of a section, in points; NaN if each profile is a single section.
    """
    n_points = profiles.shape[1]
    points = n_points if isnan(length) else min(max(1, round(length)), n_points)
    sections = n_points // points
    parts = profiles[:, : sections * points].reshape(len(profiles), sections, points)
    return float(np.mean(np.ptp(parts, axis=2)))


class Moments(NamedTuple):
    """Mean absolute height [m], rms height [m] and the skewness [-] of heights relative to their mean."""

    mean: float
    rms: float
    skewness: float


def height_moments(z: NDArray) -> Moments:
    """Compute the moments of heights along the last axis, and average them over all other axes.

    For heights of profiles with the axes (profile, point), the results are averages over all profiles.
    """
    z = z - z.mean(axis=-1, keepdims=True)
    rms = np.sqrt(np.mean(z**2, axis=-1))
    with np.errstate(invalid="ignore", divide="ignore"):
        # z * z * z instead of z**3, which takes ten times as long
        skewness = np.mean(z * z * z, axis=-1) / rms**3
    return Moments(float(np.mean(np.abs(z))), float(np.mean(rms)), float(np.mean(skewness)))

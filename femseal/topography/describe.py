"""Description of a measured face: size, heights, slopes, texture, spectrum, and roughness as drawings have it.

Parameters of roughness, of profiles and of the face, are those behind the Gaussian filters with the weight
exp(−π(x/αλ)²)/αλ, α² = ln 2/π: half of a wave of the cut-off λ passes. λs takes off the shorter waves, λc the longer
ones. Beyond its borders the map goes on as its mirror image.
Sources: ISO 25178-2 (Sq, Sa, Sz, Ssk, Sku, Sal, Str, Std), ISO 21920-2 (Ra, Rz, Rq, Rsk), ISO 21920-3 (cut-offs),
ISO 16610-21 and 16610-61 (filters).
"""

from dataclasses import dataclass, field
from math import atan, log, nan, pi, sqrt
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Labelled
from .condition import repair
from .defects import SPIKES, fit_form
from .texture import spectrum, texture
from .topography import Topography


@dataclass(frozen=True)
class SurfaceReport(Labelled):
    """Numbers of a map after levelling; NaN and None mark numbers that the face does not have.

    Heights are those of the defined points, spikes included, as instruments count them. Slopes, texture and spectrum
    are those of the map without spikes, with undefined points filled, and so are parameters behind the Gaussian
    filters. Angles are counted from x1 towards x2.
    """

    shape: tuple[int, int] = field(metadata={"unit": "", "label": "points"})
    size: tuple[float, float] = field(metadata={"unit": "m", "label": "size"})
    spacing: tuple[float, float] = field(metadata={"unit": "m", "label": "pixel"})
    undefined_fraction: float = field(metadata={"unit": "", "label": "undefined points", "percent": True})
    spike_points: int = field(metadata={"unit": "", "label": "points in spikes"})
    tilt: tuple[float, float] = field(metadata={"unit": "rad", "label": "tilt along x1 (leakage), x2"})
    rms_height: float = field(metadata={"unit": "m", "label": "Sq, rms height"})
    mean_height: float = field(metadata={"unit": "m", "label": "Sa, arithmetic mean height"})
    peak_to_valley: float = field(metadata={"unit": "m", "label": "Sz, highest to lowest point"})
    skewness: float = field(metadata={"unit": "", "label": "Ssk, skewness"})
    kurtosis: float = field(metadata={"unit": "", "label": "Sku, kurtosis"})
    rms_slope: float = field(metadata={"unit": "", "label": "rms slope"})
    rms_slopes: tuple[float, float] = field(metadata={"unit": "", "label": "rms slopes along x1, x2"})
    correlation_length: float = field(metadata={"unit": "m", "label": "Sal, autocorrelation length"})
    aspect_ratio: float = field(metadata={"unit": "", "label": "Str, texture aspect ratio"})
    aspect_ratio_is_bound: bool = field(metadata={"unit": "", "label": "Str only a bound: lay as long as map"})
    lay_direction: float = field(metadata={"unit": "rad", "label": "Std, lay from x2 (Str <= 0.5)"})
    shortest_wave: float = field(metadata={"unit": "m", "label": "shortest wave above noise, cut-off"})
    noise: float = field(metadata={"unit": "m", "label": "white noise, rms"})
    hurst: float = field(metadata={"unit": "", "label": "Hurst exponent of the power law"})
    power_law_slope: tuple[float, float] = field(
        metadata={"unit": "", "label": "its slope, log C over log q", "joint": " ± "}
    )
    power_law: tuple[float, float] | None = field(
        metadata={"unit": "m", "label": "longest, shortest wave of the law", "joint": ", "}
    )
    power_law_density: float = field(metadata={"unit": "m^4", "label": "spectral density at its longest wave"})
    roll_off: float = field(metadata={"unit": "m", "label": "roll-off: end of a plateau"})
    profile_cut_off: tuple[float, float] = field(metadata={"unit": "m", "label": "cut-offs of profiles", "joint": ", "})
    ra: tuple[float, float] = field(metadata={"unit": "m", "label": "Ra of profiles along x1, x2", "joint": ", "})
    rz: tuple[float, float] = field(metadata={"unit": "m", "label": "Rz", "joint": ", "})
    rq: tuple[float, float] = field(metadata={"unit": "m", "label": "Rq", "joint": ", "})
    rsk: tuple[float, float] = field(metadata={"unit": "", "label": "Rsk", "joint": ", "})
    sa: float = field(metadata={"unit": "m", "label": "Sa of the roughness, behind filters"})
    sz: float = field(metadata={"unit": "m", "label": "Sz of the roughness"})
    sq: float = field(metadata={"unit": "m", "label": "Sq of the roughness"})
    ssk: float = field(metadata={"unit": "", "label": "Ssk of the roughness"})


def describe_surface(
    topography: Topography, *, detrend: int = 1, spikes: float = SPIKES, max_undefined: float = 0.05
) -> SurfaceReport:
    """Describe a measured or generated map.

    Parameters
    ----------
    topography : the map as measured.
    detrend : order of the form taken off first: 0 mean, 1 tilt, 2 tilt and curvature.
    spikes : threshold of `find_spikes`; infinite looks for none.
    max_undefined : largest fraction of points (0 to 1) that may be filled for slopes, texture and spectrum.

    Raises
    ------
    InputError : too many undefined points; an order or a threshold that cannot be used.

    Examples
    --------
    >>> from femseal.topography import self_affine
    >>> report = describe_surface(self_affine((256, 256), (1e-3, 1e-3), hurst=0.8, rms_height=1e-6, rng=1))
    >>> round(report.hurst, 1), report.spike_points, report.shape
    (0.8, 0, (256, 256))
    """
    flat, repaired = repair(topography, spikes=spikes, max_undefined=max_undefined, detrend=detrend)
    measured = topography.heights - fit_form(topography.heights, topography.size, detrend).heights
    z = measured[~np.isnan(measured)]
    z = z - z.mean()
    sq = float(z.std())
    tilt = fit_form(topography.heights, topography.size, max(detrend, 1)).slopes
    look, waves = texture(flat), spectrum(flat)
    law = waves.law
    return SurfaceReport(
        shape=topography.shape,
        size=topography.size,
        spacing=topography.spacing,
        undefined_fraction=repaired.undefined_fraction,
        spike_points=repaired.spike_points,
        tilt=(atan(tilt[0]), atan(tilt[1])),
        rms_height=sq,
        mean_height=float(np.abs(z).mean()),
        peak_to_valley=float(np.ptp(z)),
        skewness=float(np.mean(z**3)) / sq**3 if sq else nan,
        kurtosis=float(np.mean(z**4)) / sq**4 if sq else nan,
        rms_slope=flat.rms_slope,
        rms_slopes=flat.rms_slopes,
        correlation_length=look.correlation_length,
        aspect_ratio=look.aspect_ratio,
        aspect_ratio_is_bound=look.aspect_ratio_is_bound,
        lay_direction=look.lay_direction,
        shortest_wave=waves.shortest_wave,
        noise=waves.noise,
        hurst=law.hurst if law else nan,
        power_law=(law.longest, law.shortest) if law else None,
        power_law_density=law.density if law else nan,
        roll_off=law.roll_off if law else nan,
        power_law_slope=(-2 - 2 * law.hurst, 2 * law.hurst_error) if law else (nan, nan),
        **roughness(flat),
    )


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
#: Standard deviation of a Gaussian filter [points] from which cosine transforms take less time than sums of neighbours.
_WIDE = 4.0


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
    """Heights (n1, n2) [m] behind the Gaussian filter along axes, mirrored at the edges; NaN without a cut-off."""
    if not cut_off > 0:
        return np.full(z.shape, nan)
    for axis in axes:
        n, deviation = z.shape[axis], sqrt(log(2) / 2) / pi * cut_off / flat.spacing[axis]
        if deviation < _WIDE:
            z = scipy.ndimage.gaussian_filter1d(z, deviation, axis, truncate=5.0)
        else:
            passed = np.exp(-0.5 * (pi * deviation * np.arange(n) / n) ** 2)
            z = scipy.fft.idct(scipy.fft.dct(z, axis=axis) * np.expand_dims(passed, 1 - axis), axis=axis)
    return z


def _moments(z: NDArray) -> tuple[float, float, float]:
    """Arithmetic mean height, rms height [m] and skewness, about the mean along the last axis, averaged."""
    z = z - z.mean(axis=-1, keepdims=True)
    rms = np.sqrt(np.mean(z**2, axis=-1))
    with np.errstate(invalid="ignore", divide="ignore"):
        skewness = np.mean(z * z * z, axis=-1) / rms**3  # a power takes ten times as long
    return float(np.mean(np.abs(z))), float(np.mean(rms)), float(np.mean(skewness))

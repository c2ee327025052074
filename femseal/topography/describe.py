"""Description of a measured face: size, heights, slopes, texture, spectrum, and roughness as drawings have it.

Parameters of roughness, of profiles and of the face, are those behind the Gaussian filters with the weight
exp(−π(x/αλ)²)/αλ, α² = ln 2/π: half of a wave of the cut-off λ passes. λs takes off the shorter waves, λc the longer
ones. Beyond its borders the map goes on as its mirror image.
The core of the curve of material ratios is a straight line, fitted by least squares to the 40 % of the area over which
the secant falls least, from 0 to 100 %; peaks and valleys are triangles of the area beyond it.
Sources: ISO 25178-2 (Sq, Sa, Sz, Ssk, Sku, Sal, Str, Std, Sk, Spk, Svk, Smr, Sdr), ISO 21920-2 (Ra, Rz, Rq, Rsk),
ISO 21920-3 (cut-offs), ISO 16610-21 and 16610-61 (filters).
"""

from dataclasses import dataclass
from math import atan, log, nan, pi, sqrt
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Labelled, Pair, Shape, labelled
from .conditioning import repair
from .defects import SPIKES
from .patches import check_single_patch
from .texture import NO_LAW, spectrum, texture
from .topography import Topography


@dataclass(frozen=True)
class SurfaceReport(Labelled):
    """Numbers of a map after levelling; NaN and None mark numbers that the face does not have.

    Heights are those of the defined points, spikes included, as instruments count them. Slopes, texture and spectrum
    are those of the map without spikes, with undefined points filled, and so are parameters behind the Gaussian
    filters. Angles are counted from x1 towards x2.
    """

    shape: Shape = labelled("points")
    size: Pair = labelled("size", "m")
    spacing: Pair = labelled("pixel", "m")
    undefined_fraction: float = labelled("undefined points", percent=True)
    spike_points: int = labelled("points in spikes")
    tilt: Pair = labelled("tilt along x1 (leakage), x2", "rad")
    rms_height: float = labelled("Sq, rms height", "m")
    mean_height: float = labelled("Sa, arithmetic mean height", "m")
    peak_to_valley: float = labelled("Sz, highest to lowest point", "m")
    skewness: float = labelled("Ssk, skewness")
    kurtosis: float = labelled("Sku, kurtosis")
    rms_slope: float = labelled("rms slope")
    rms_slopes: Pair = labelled("rms slopes along x1, x2")
    correlation_length: float = labelled("Sal, autocorrelation length", "m")
    aspect_ratio: float = labelled("Str, texture aspect ratio")
    aspect_ratio_is_bound: bool = labelled("Str only a bound: lay as long as map")
    lay_direction: float = labelled("Std, lay from x2 (Str <= 0.5)", "rad")
    shortest_wave: float = labelled("shortest wave above noise, cut-off", "m")
    noise: float = labelled("white noise, rms", "m")
    hurst: float = labelled("Hurst exponent of the power law")
    power_law_slope: Pair = labelled("its slope, log C over log q", joint=" ± ")
    power_law: Pair | None = labelled("longest, shortest wave of the law", "m", joint=", ")
    power_law_density: float = labelled("spectral density at its longest wave", "m^4")
    roll_off: float = labelled("roll-off: end of a plateau", "m")
    profile_cut_off: Pair = labelled("cut-offs of profiles", "m", joint=", ")
    ra: Pair = labelled("Ra of profiles along x1, x2", "m", joint=", ")
    rz: Pair = labelled("Rz", "m", joint=", ")
    rq: Pair = labelled("Rq", "m", joint=", ")
    rsk: Pair = labelled("Rsk", joint=", ")
    sa: float = labelled("Sa of the roughness, behind filters", "m")
    sz: float = labelled("Sz of the roughness", "m")
    sq: float = labelled("Sq of the roughness", "m")
    ssk: float = labelled("Ssk of the roughness")
    nesting_index: Pair = labelled("nesting indices S, L of the roughness", "m", joint=", ")
    sk: float = labelled("Sk, height of the core", "m")
    spk: float = labelled("Spk, peaks above the core", "m")
    svk: float = labelled("Svk, valleys below the core", "m")
    smr: tuple[float, float, float] = labelled(
        "Smr(c) at c = Sq, 0, −Sq from the mean", joint=", ", percent=True
    )
    sdr: float = labelled("Sdr, developed area beyond the flat one", percent=True)


def describe_surface(
    topography: Topography,
    *,
    detrend: int | None = None,
    spikes: float = SPIKES,
    max_undefined: float = 0.05,
) -> SurfaceReport:
    """Describe a measured or generated map.

    Parameters
    ----------
    topography : the map as measured.
    detrend : order of the form taken off first: 0 mean, 1 tilt, 2 tilt and curvature. Unless given: the tilt, but not
        along an axis on which the map is periodic without a step, see `Topography.form`.
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
    check_single_patch("surface", topography)
    flat, repaired = repair(topography, spikes=spikes, max_undefined=max_undefined, detrend=detrend)
    measured = topography.heights - topography.form(detrend).heights
    z = measured[~np.isnan(measured)]
    mean_height, sq, skewness = _moments(z)
    tilt = topography.form(2 if detrend == 2 else 1).slopes
    waves = spectrum(flat)
    law = waves.law or NO_LAW
    return SurfaceReport(
        shape=topography.shape,
        size=topography.size,
        spacing=topography.spacing,
        undefined_fraction=repaired.undefined_fraction,
        spike_points=repaired.spike_points,
        tilt=(atan(tilt[0]), atan(tilt[1])),
        rms_height=sq,
        mean_height=mean_height,
        peak_to_valley=float(np.ptp(z)),
        skewness=skewness,
        kurtosis=float(np.mean((z - z.mean()) ** 4)) / sq**4 if sq else nan,
        rms_slope=flat.rms_slope,
        rms_slopes=flat.rms_slopes,
        **vars(texture(flat)),
        shortest_wave=waves.shortest_wave,
        noise=waves.noise,
        hurst=law.hurst,
        power_law=(law.longest, law.shortest) if waves.law else None,
        power_law_density=law.density,
        roll_off=law.roll_off,
        power_law_slope=(-2 - 2 * law.hurst, 2 * law.hurst_error),
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
    areal |= {"sz": float(np.ptp(z)), "sdr": developed_area(z, flat.spacing)}
    areal |= dict(zip(names, zip(*along, strict=True), strict=True)) | material_ratios(z)
    return areal | {"nesting_index": (short, cut_off)}


#: Fraction of the area of the secant of the core.
_CORE = 0.4
#: Derivative of seven points (ISO 21920-2), in spacings.
_DERIVATIVE = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60


def material_ratios(z: NDArray) -> dict[str, Any]:
    """Sk, Spk, Svk [m] of heights (n1, n2), and Smr [-] at the rms height above the mean, at it and below."""
    sq = float(z.std())
    if not sq > 0:
        return {"sk": sq, "spk": sq, "svk": sq, "smr": (nan,) * 3}
    falling = np.sort(z, axis=None)[::-1]
    n = z.size
    m = max(1, round(_CORE * (z.size - 1)))
    falls = falling[: n - m] - falling[m:]
    # of several secants that fall alike the one in the middle
    begin = int(np.median(np.flatnonzero(falls <= falls.min() * (1 + 1e-9))))
    place = (np.arange(begin, begin + m + 1) + 0.5) / n
    slope, top = np.polyfit(place, falling[begin : begin + m + 1], 1)
    peaks = falling[falling > top] - top
    valleys = top + slope - falling[falling < top + slope]
    ratios = tuple(float(np.mean(z >= z.mean() + c)) for c in (sq, 0.0, -sq))
    # the triangle of an area over a breadth of n points has twice the mean height
    spk, svk = (2 * float(part.mean()) if part.size else 0.0 for part in (peaks, valleys))
    return {"sk": -float(slope), "spk": spk, "svk": svk, "smr": ratios}


def developed_area(z: NDArray, spacing: Pair) -> float:
    """Sdr [-] of heights (n1, n2) [m]: mean of √(1 + |∇z|²) less 1."""
    first, second = (
        scipy.ndimage.correlate1d(z, _DERIVATIVE, axis) / spacing[axis] for axis in (0, 1)
    )
    return float(np.mean(np.sqrt(1 + first**2 + second**2))) - 1


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
        rz = np.mean(
            [np.ptp(part, axis=1) for part in np.split(z[:, : sections * points], sections, axis=1)]
        )
        found = cut_off, ra, rq, float(rz), rsk
        if ra > least:
            break
    return found


def _smooth(flat: Topography, z: NDArray, cut_off: float, axes: tuple[int, ...]) -> NDArray:
    """Heights (n1, n2) [m] behind the Gaussian filter along axes, mirrored at the edges; NaN without a cut-off."""
    if not cut_off > 0:
        return np.full(z.shape, nan)
    for axis in axes:
        n = z.shape[axis]
        deviation = sqrt(log(2) / 2) / pi * cut_off / flat.spacing[axis]
        passed = np.exp(-0.5 * (pi * deviation * np.arange(n) / n) ** 2)
        waves = scipy.fft.dct(z, axis=axis) * np.expand_dims(passed, 1 - axis)
        z = scipy.fft.idct(waves, axis=axis)
    return z


def _moments(z: NDArray) -> tuple[float, float, float]:
    """Arithmetic mean height, rms height [m] and skewness, about the mean along the last axis, averaged."""
    z = z - z.mean(axis=-1, keepdims=True)
    rms = np.sqrt(np.mean(z**2, axis=-1))
    with np.errstate(invalid="ignore", divide="ignore"):
        skewness = np.mean(z * z * z, axis=-1) / rms**3  # a power takes ten times as long
    return float(np.mean(np.abs(z))), float(np.mean(rms)), float(np.mean(skewness))

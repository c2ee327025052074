"""Describe a measured surface: size, heights, slopes, texture, spectrum, and roughness parameters as on drawings.

The roughness parameters of profiles and of the surface are computed after Gaussian filtering, see `roughness_filters`.
Beyond its borders, the map continues as its mirror image.

The core of the material ratio curve is represented by a straight line. The line is fitted by least squares to the part
of the curve that covers 40 % of the area and has the smallest slope, and is then extended from 0 to 100 % of the area.
The part of the curve above this line (peaks) and the part below (valleys) are replaced by triangles of equal area.

Sources: ISO 25178-2 (Sq, Sa, Sz, Ssk, Sku, Sal, Str, Std, Sk, Spk, Svk, Smr, Sdr), ISO 21920-2 (Ra, Rz, Rq, Rsk).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, nan
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Labelled, Pair, Shape, labelled
from .defects import SPIKES
from .patches import check_single_patch
from .power_spectrum import NO_LAW, spectrum
from .profile_roughness import height_moments, standard_profile_parameters
from .repairs import repair
from .roughness_filters import STANDARD_CUT_OFFS, gaussian_filter
from .texture import texture
from .topography import Topography


@dataclass(frozen=True)
class SurfaceReport(Labelled):
    """Parameters of a map without its form.

    A parameter that cannot be determined is NaN or None.

    Parameters of heights, such as Sq, are computed from all defined points including spikes, as in instrument software.
    Slopes, texture, spectrum and the parameters after Gaussian filters are computed from the map without spikes and
    with filled undefined points. The direction of the lay is its angle from x2, which is positive in the sense from x1
    towards x2.
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
    topography : Topography
        The map as measured.
    detrend : int, optional
        Form that is subtracted from the map: 0 for the mean, 1 for mean and tilt, 2 for mean, tilt and curvature.
        Default: the tilt, except along axes on which the map is periodic without a step, see `Topography.form`.
    spikes : float
        Threshold of `find_spikes`. If the threshold is infinite, no point is treated as a spike.
    max_undefined : float
        Largest fraction of points, from 0 to 1, that may be filled before slopes, texture and spectrum are computed.

    Returns
    -------
    SurfaceReport
        The parameters.

    Raises
    ------
    InputError
        Too many points are undefined, or `detrend` or the threshold is invalid.

    Examples
    --------
    >>> from femseal.topography import self_affine
    >>> report = describe_surface(self_affine((256, 256), (1e-3, 1e-3), hurst=0.8, rms_height=1e-6, rng=1))
    >>> round(report.hurst, 1), report.spike_points, report.shape
    (0.8, 0, (256, 256))
    """
    check_single_patch("surface", topography)
    flat, repaired = repair(topography, spikes=spikes, max_undefined=max_undefined, detrend=detrend)
    levelled = topography.heights - topography.form(detrend).heights
    z = levelled[~np.isnan(levelled)]
    moments = height_moments(z)
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
        rms_height=moments.rms,
        mean_height=moments.mean,
        peak_to_valley=float(np.ptp(z)),
        skewness=moments.skewness,
        kurtosis=float(np.mean((z - z.mean()) ** 4)) / moments.rms**4 if moments.rms else nan,
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


def roughness(flat: Topography) -> dict[str, Any]:
    """Return the roughness parameters of a map by their names in `SurfaceReport`.

    Parameters of profiles, such as Ra and Rz, are pairs: the first number is the mean over all profiles along x1, the
    second number the mean over all profiles along x2. The cut-off λc is chosen separately for the profiles along x1 and
    along x2. The chosen λc is the longest standard cut-off that does not exceed the length of the profile and is
    recommended by the standard for the Ra of the filtered profiles. If every standard cut-off is longer than the
    profile, λc is NaN.

    The parameters of the surface use the longer of the two λc chosen along x1 and along x2.

    flat : map with its form removed and all points defined.
    """
    along_x1, along_x2 = (standard_profile_parameters(flat, axis) for axis in (0, 1))
    cut_off = max((c for c in (along_x1.cut_off, along_x2.cut_off) if c > 0), default=nan)
    short = next((pair.short for pair in STANDARD_CUT_OFFS if pair.long == cut_off), nan)
    z = gaussian_filter(flat.heights, flat.spacing, short, (0, 1))
    z = z - gaussian_filter(z, flat.spacing, cut_off, (0, 1))
    moments = height_moments(z.ravel())
    return {
        "profile_cut_off": (along_x1.cut_off, along_x2.cut_off),
        "ra": (along_x1.ra, along_x2.ra),
        "rq": (along_x1.rq, along_x2.rq),
        "rz": (along_x1.rz, along_x2.rz),
        "rsk": (along_x1.rsk, along_x2.rsk),
        "sa": moments.mean,
        "sq": moments.rms,
        "ssk": moments.skewness,
        "sz": float(np.ptp(z)),
        "sdr": developed_area(z, flat.spacing),
        "nesting_index": (short, cut_off),
        **material_ratios(z),
    }


#: Fraction of the area over which the secant of the core is taken.
_CORE = 0.4
#: Weights of the derivative from seven points (ISO 21920-2), for a spacing of 1.
_DERIVATIVE = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60


def material_ratios(z: NDArray) -> dict[str, Any]:
    """Compute the core parameters Sk, Spk and Svk [m], and the material ratios Smr(c) [-].

    The three material ratios are given at the height mean + Sq, at the mean height, and at the height mean − Sq.

    z : heights (n1, n2) [m].
    """
    sq = float(z.std())
    if not sq > 0:
        return {"sk": sq, "spk": sq, "svk": sq, "smr": (nan,) * 3}
    falling = np.sort(z, axis=None)[::-1]  # the material ratio curve, over equal steps of the area
    n = z.size
    core_points = max(1, round(_CORE * (n - 1)))  # number of steps that cover 40 % of the area
    # fall of the height over 40 % of the area, for all positions of the first point
    drops = falling[: n - core_points] - falling[core_points:]
    # if the fall is smallest at several positions, the middle position is taken
    flattest = np.flatnonzero(drops <= drops.min() * (1 + 1e-9))
    begin = int(np.median(flattest))
    core = slice(begin, begin + core_points + 1)
    ratio = (np.arange(n)[core] + 0.5) / n  # material ratio at each point of the core
    # line height = top + slope · ratio, which ends at a ratio of 1
    slope, top = np.polyfit(ratio, falling[core], 1)
    bottom = top + slope
    peaks = falling[falling > top] - top
    valleys = bottom - falling[falling < bottom]
    smr = tuple(float(np.mean(z >= z.mean() + c)) for c in (sq, 0.0, -sq))
    return {"sk": -float(slope), "spk": _triangle(peaks), "svk": _triangle(valleys), "smr": smr}


def _triangle(heights: NDArray) -> float:
    """Return the height [m] of the triangle that replaces the peaks above the core or the valleys below the core.

    In the diagram of height over material ratio, the triangle has the same base and the same area as the replaced peaks
    or valleys.

    heights : heights of the peaks above the core, or depths of the valleys below the core, (points,) [m].
    """
    return 2 * float(heights.mean()) if heights.size else 0.0


def developed_area(z: NDArray, spacing: Pair) -> float:
    """Return the developed interfacial area ratio Sdr [-], the mean of √(1 + |∇z|²) minus 1.

    z : heights (n1, n2) [m].
    spacing : pixel size [m].
    """
    slope1 = scipy.ndimage.correlate1d(z, _DERIVATIVE, 0) / spacing[0]
    slope2 = scipy.ndimage.correlate1d(z, _DERIVATIVE, 1) / spacing[1]
    return float(np.mean(np.sqrt(1 + slope1**2 + slope2**2))) - 1

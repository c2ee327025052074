"""Spectrum and texture of a map: shortest wave, range of a power law, autocorrelation length, direction of the lay.

Symbols: q angular wavenumber [rad/m], C isotropic spectral density [m⁴], H Hurst exponent, C ∝ q^(−2−2H). The radial
average of a face of parallel grooves falls with the same exponent as that of an isotropic one of equal H. Sal and Str
are lengths in which the autocorrelation decays to 0.2, Std the direction of the lay, counted from x1 towards x2.
Sources: Jacobs, Junge, Pastewka, Surf. Topogr.: Metrol. Prop. 5 (2017) 013001; ISO 25178-2 (Sal, Str, Std).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan, log, nan, pi, prod, sqrt
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Array
from .patches import Surface
from .topography import SLACK, Topography

#: Bins of the spectrum per decade of wavelength, and positions per decade that are tried for the end of a plateau.
_BINS_PER_DECADE = 12
_BENDS_PER_DECADE = 48
#: Largest rms deviation of log10 C from a power law, beyond the scatter that the number of waves explains.
_SCATTER = 0.12
#: Decades of wavelength over which a power law must hold: without a plateau, and behind a plateau.
_LEAST_DECADES = 0.7
_LEAST_DECADES_BEHIND_PLATEAU = 0.5
#: Decades over which a plateau must extend.
_LEAST_PLATEAU = 0.3
#: Bins behind a plateau over which a power law must hold.
_LEAST_BINS = 4
#: The end of the spectrum is noise where log C over log q is flatter than this; a wave stands out of it above 4 C.
_FLAT = -1.5
_ABOVE_NOISE = 4.0
#: Below this fraction of the largest C there is rounding only; below this one of the law the instrument saw nothing.
_ROUNDING = 1e-16
_CUT = 0.1
#: Largest Hurst exponent of a fit.
_LARGEST_HURST = 1.1
#: Standard deviation of log10 C about a power law that holds, beside the scatter by the number of waves.
_MODEL_SCATTER = 0.02
#: Relative standard error of the level of white noise.
_NOISE_ERROR = 0.3
#: Stated standard error of H over that of the fit, because the range is chosen by the fit. Measured on 768 Gaussian
#: surfaces with and without plateau, noise and lay: 96 % of the exponents are within two stated errors.
_ERROR = 1.6
#: A law with a plateau is preferred to one without unless its error is more than this many times larger.
_PREFER_PLATEAU = 1.5
#: The density is multiplied by this power of q before it is averaged in a bin, so that it is nearly constant there.
_FLATTENING = 3.0


@dataclass(frozen=True)
class PowerLaw:
    """C = density · (q/q_bend)^(−2−2H) between two wavelengths, q_bend at the longest, and C constant on a plateau.

    hurst, hurst_error : H and its standard error [-]; the slope of log C over log q is −2−2H.
    longest, shortest : wavelengths between which the law holds [m].
    density : C at the longest [m⁴].
    roll_off : where the plateau of longer waves ends, = longest; NaN without a plateau [m].
    """

    hurst: float
    hurst_error: float
    longest: float
    shortest: float
    density: float
    roll_off: float

    def at(self, q: Any) -> Any:
        """C [m⁴] at wavenumbers [rad/m]."""
        return self.density * (q * self.longest / (2 * pi)) ** (-2 - 2 * self.hurst)

    def slope_power(self, longest: float, shortest: float) -> float:
        """Mean square slope of the waves between two wavelengths [m], (1/2π)∫q³C dq, by the law."""
        q = 2 * pi / longest
        folds = np.log(longest / shortest)
        return float(
            q**4
            * self.at(q)
            / (2 * pi)
            * folds
            * scipy.special.exprel((2 - 2 * self.hurst) * folds)
        )


#: In place of a law where there is none.
NO_LAW = PowerLaw(*(nan,) * 6)


@dataclass(frozen=True)
class Spectrum:
    """Shortest wave that was measured [m], rms height of white noise over all waves [m], and the power law, if any."""

    shortest_wave: float
    noise: float
    law: PowerLaw | None


def spectrum(topography: Surface) -> Spectrum:
    """Summary of the spectral density of a flat map without undefined points.

    The shortest wave is the longest of: two pixels of the coarser spacing; the wave at which C is four times the white
    noise, where the spectrum ends flat; the wave below which C is less than a tenth of the power law. All but the
    first are limits of the instrument. Of several patches it is that of the one with the longest such wave.
    """
    if not isinstance(topography, Topography):
        return max(map(spectrum, topography.patches), key=lambda found: found.shortest_wave)
    # a step at a border that is called periodic would add waves of all lengths: mirror the map there
    if topography.seamless != topography.periodic:
        topography = Topography(topography.heights, topography.spacing, topography.seamless)
    q, density = topography.radial_psd()
    last = pi / max(topography.spacing)
    inside = (q > 0) & (q <= last * (1 + SLACK))
    q, density = q[inside], density[inside]
    if not np.any(density > 0):
        return Spectrum(2 * pi / last, 0.0, None)
    floor = _noise_floor(q, density, last)
    signal = density > max(_ABOVE_NOISE * floor, _ROUNDING * density.max())
    # of pure noise no wave is measured
    ends = q[signal].max() if signal.any() else q[0]
    shortest = 2 * pi / (ends if ends < q[-1] else last)
    # the ring at the end of the signal may be full in part, and levelling took from waves longer than half the map
    step = float(np.diff(q).max(initial=0.0))
    used = (q >= 4 * pi / min(topography.size)) & (q <= 2 * pi / shortest - step) & signal
    law = _fit(_average_in_bins(q[used], density[used], floor, topography))
    if law is not None:
        missing = (q > 2 * pi / law.shortest) & (density - floor < _CUT * law.at(q))
        if missing.any():
            shortest = max(shortest, 2 * pi / q[np.argmax(missing)])
    return Spectrum(float(shortest), float(np.sqrt(floor / np.prod(topography.spacing))), law)


def _noise_floor(q: NDArray, density: NDArray, last: float) -> float:
    """C of white noise [m⁴]: the level on which the spectrum ends, 0 if it does not end level."""
    end = (q > 0.75 * last) & (density > _ROUNDING * density.max())
    if np.count_nonzero(end) < 8 or np.polyfit(np.log(q[end]), np.log(density[end]), 1)[0] < _FLAT:
        return 0.0
    return float(np.median(density[end]))


@dataclass(frozen=True, eq=False)
class _Bins:
    """Spectrum averaged in bins of equal width in log q.

    Attributes
    ----------
    x, y : arrays (bins,), log10 of the wavenumber [rad/m] and of the density [m⁴].
    variance : array (bins,), variance of y by the finite number of waves in the bin and by the noise.
    """

    x: Array
    y: Array
    variance: Array

    @property
    def weight(self) -> Array:
        """Weights (bins,) of a least-squares fit of y."""
        return 1 / (self.variance + _MODEL_SCATTER**2)

    def part(self, first: int, last: int) -> _Bins:
        """Return the bins from the first to the last, both included."""
        bins = slice(first, last + 1)
        return _Bins(self.x[bins], self.y[bins], self.variance[bins])


def _average_in_bins(q: NDArray, density: NDArray, floor: float, topography: Topography) -> _Bins:
    """Average a radial density, less the level `floor` of white noise, in bins where it is above that level.

    A ring of radius q and width w contains A q w/2π wave vectors of a map of area A, and half as many independent
    waves, as a wave and its conjugate are one. The density of a wave of a Gaussian surface is exponentially
    distributed, so that the mean of n independent ones scatters by 1/√n of itself.
    """
    is_used = density > floor
    q = q[is_used]
    signal = density[is_used] - floor
    if not q.size:
        return _Bins(q, q, q)
    width = max(
        pi * (1 + wraps) / side
        for wraps, side in zip(topography.periodic, topography.size, strict=True)
    )
    waves = prod(topography.size) * q * width / (2 * pi)
    number = np.floor(np.log10(q / q[0]) * _BINS_PER_DECADE + SLACK).astype(int)
    count = np.bincount(number, waves)
    is_full = count > 0
    count = count[is_full]
    x = np.bincount(number, waves * np.log10(q))[is_full] / count
    flattened = np.bincount(number, waves * signal * q**_FLATTENING)[is_full] / count
    y = np.log10(flattened) - _FLATTENING * x
    noise = floor / 10**y
    relative_variance = 2 / count * (1 + noise) ** 2 + (_NOISE_ERROR * noise) ** 2
    return _Bins(x, y, relative_variance / log(10) ** 2)


def _fit(bins: _Bins) -> PowerLaw | None:
    """Fit the power law whose exponent has the least standard error; None where no power law holds.

    Tried are all ranges of bins, and a plateau of the longest waves with a power law behind it. A law with a plateau
    may have the larger error, as the end of the plateau is a third unknown.
    """
    straight = [
        _fit_straight(bins.part(first, last))
        for first in range(bins.x.size)
        for last in range(first + 1, bins.x.size)
        if bins.x[last] - bins.x[first] >= _LEAST_DECADES
    ]
    bent = [_fit_behind_plateau(bins.part(0, last)) for last in range(_LEAST_BINS, bins.x.size)]
    laws = [law for law in straight + bent if law is not None]

    def rank(law: PowerLaw) -> float:
        has_plateau = not isnan(law.roll_off)
        return law.hurst_error / _PREFER_PLATEAU if has_plateau else law.hurst_error

    return min(laws, key=rank, default=None)


def _fit_straight(bins: _Bins) -> PowerLaw | None:
    """Fit a power law to all bins; None where it does not hold."""
    return _fit_from(bins, float(bins.x[0]), has_plateau=False)


def _fit_behind_plateau(bins: _Bins) -> PowerLaw | None:
    """Fit a plateau and a power law behind it to all bins; None where it does not hold.

    The plateau ends where the weighted sum of squared deviations is least.
    """
    x, weight = bins.x, bins.weight
    bends = np.arange(
        x[0] + _LEAST_PLATEAU, x[-1] - _LEAST_DECADES_BEHIND_PLATEAU, 1 / _BENDS_PER_DECADE
    )
    bins_behind = np.sum(x > bends[:, None], axis=1)
    bends = bends[bins_behind >= _LEAST_BINS]
    if not bends.size:
        return None
    # for each bend, the sum of squares that the best y = level + slope · fall explains
    fall = np.maximum(x - bends[:, None], 0.0)  # (bend, bin)
    fall -= (fall @ weight / weight.sum())[:, None]
    deviation = bins.y - bins.y @ weight / weight.sum()
    explained = (fall @ (weight * deviation)) ** 2 / (fall**2 @ weight)
    return _fit_from(bins, float(bends[np.argmax(explained)]), has_plateau=True)


def _fit_from(bins: _Bins, bend: float, *, has_plateau: bool) -> PowerLaw | None:
    """Fit y = level + slope · max(x − bend, 0) by weighted least squares; None where no power law holds.

    The error of the slope includes that of the bend where there is a plateau, and is enlarged where the deviations are
    larger than the weights let expect.
    """
    fall = np.maximum(bins.x - bend, 0.0)
    weight = bins.weight
    design = np.array([np.ones(fall.size), fall])
    level, slope = np.linalg.solve((design * weight) @ design.T, (design * weight) @ bins.y)
    deviation = level + slope * fall - bins.y
    hurst = -1 - slope / 2
    if has_plateau:
        by_bend = np.where(fall > 0, -slope, 0.0)
        design = np.vstack([design, by_bend])
    freedom = fall.size - len(design)
    beyond_waves = np.maximum(deviation**2 - bins.variance, 0.0)
    holds = sqrt(np.mean(beyond_waves)) <= _SCATTER and 0 < hurst <= _LARGEST_HURST
    if freedom < 1 or not holds:
        return None
    excess = max(1.0, sqrt(weight @ deviation**2 / freedom))
    slope_variance = np.linalg.inv((design * weight) @ design.T)[1, 1]
    longest = 2 * pi / 10**bend
    return PowerLaw(
        hurst=float(hurst),
        hurst_error=float(_ERROR / 2 * excess * sqrt(slope_variance)),
        longest=longest,
        shortest=float(2 * pi / 10 ** bins.x[-1]),
        density=float(10**level),
        roll_off=longest if has_plateau else nan,
    )


_DECAYED = 0.2
_ANGLES = np.deg2rad(np.arange(180))
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
    lay from x2, to a degree: that in which the autocorrelation is largest on the mean; NaN where Str > 0.5, and all of
    it where the map is flat or a single row.
    """
    if topography.rms_height == 0 or min(topography.shape) < 2:
        return Texture(nan, nan, False, nan)
    middle = np.array([n // 2 for n in topography.shape])
    spacing = np.array(topography.spacing)
    direction = np.array([np.cos(_ANGLES), np.sin(_ANGLES)]).T
    reach = (middle * spacing / np.maximum(np.abs(direction), 1e-12)).min(axis=1)
    step = spacing.min() / 2
    r = np.arange(0, reach.max() + step / 2, step)
    places = middle + (direction / spacing)[:, None] * r[:, None]
    correlation = autocorrelation(topography)
    found = scipy.ndimage.map_coordinates(correlation, places.T, order=1, mode="nearest").T
    below = (found < _DECAYED) & (r < reach[:, None] + step / 2)
    fallen = below.any(axis=1)
    distance = np.where(fallen, r[np.argmax(below, axis=1)], reach)
    shortest = distance[fallen].min() if fallen.any() else reach.max()
    ratio = float(shortest / distance.max())
    alike = found[:, r < reach.min()].mean(axis=1)
    lay = pi / 2 - (-_ANGLES[np.argmax(alike)]) % pi if ratio <= ISOTROPIC else nan
    return Texture(float(shortest), ratio, not bool(fallen.all()), float(lay))


def autocorrelation(topography: Topography) -> Array:
    """Autocorrelation (2 m1 + 1, 2 m2 + 1) of a map (n1, n2) at lags of up to m = n // 2 pixels, 1 in the middle.

    Mean over the pairs of points that lie that far apart: nothing is assumed beyond the borders.
    """
    z = topography.heights - topography.heights.mean()
    (n1, n2), (m1, m2) = topography.shape, (n // 2 for n in topography.shape)
    padded = [scipy.fft.next_fast_len(2 * n, real=True) for n in (n1, n2)]
    sums = scipy.fft.irfft2(np.abs(scipy.fft.rfft2(z, padded)) ** 2, padded)
    i = np.arange(-m1, m1 + 1)
    j = np.arange(-m2, m2 + 1)
    pairs = np.outer(n1 - np.abs(i), n2 - np.abs(j))
    lagged = sums[np.ix_(i, j)] / pairs
    return lagged / lagged[m1, m2]

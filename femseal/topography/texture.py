"""Spectrum and texture of a map: shortest wave, range of a power law, autocorrelation length, direction of the lay.

Symbols: q angular wavenumber [rad/m], C isotropic spectral density [m⁴], H Hurst exponent, C ∝ q^(−2−2H). The radial
average of a face of parallel grooves falls with the same exponent as that of an isotropic one of equal H. Sal and Str
are lengths in which the autocorrelation decays to 0.2, Std the direction of the lay, counted from x1 towards x2.
Sources: Jacobs, Junge, Pastewka, Surf. Topogr.: Metrol. Prop. 5 (2017) 013001; ISO 25178-2 (Sal, Str, Std).
"""

from dataclasses import dataclass
from math import nan, pi, sqrt
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Array
from .patches import Surface
from .topography import SLACK, Topography

_BINS_PER_DECADE = 12
#: A power law holds where C stays within this of it, rms, in decades, over no less than a factor of 5 in wavelength.
_SCATTER = 0.12
_LEAST_DECADES = 0.7
#: Plateau before its end is called a roll-off [decades], and places tried for the end per decade.
_LEAST_PLATEAU = 0.3
_BENDS_PER_DECADE = 48
#: The end of the spectrum is noise where log C over log q is flatter than this; a wave stands out of it above 4 C.
_FLAT = -1.5
_ABOVE_NOISE = 4.0
#: Below this fraction of the largest C there is rounding only; below this one of the law the instrument saw nothing.
_ROUNDING = 1e-16
_CUT = 0.1
#: Error of H over the standard error of the fit to bins alike. Measured on 128 Gaussian faces: 1.1 to 1.7, for few
#: waves in the bins of the longest, and for the range, which is chosen.
_ERROR = 1.6


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
    law = _fit(*_binned(q[used], density[used] - floor))
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


def _fit(x: NDArray, y: NDArray) -> PowerLaw | None:
    """Law over the most bins of log10 q, log10 C that one explains, with or without a plateau of the longest waves."""
    rank, found = (0, 0.0), None
    for begin, stop, bend in _candidates(x):
        part = slice(begin, stop + 1)
        fall = np.maximum(x[part] - bend, 0.0)
        slope, level = np.polyfit(fall, y[part], 1)
        scatter = float(np.sqrt(np.mean((level + slope * fall - y[part]) ** 2)))
        hurst = -1 - slope / 2
        if scatter <= _SCATTER and 0 < hurst <= 1.1 and (stop - begin, -scatter) > rank:
            rank = stop - begin, -scatter
            longest, shortest = (float(2 * pi / 10**end) for end in (bend, x[stop]))
            bins = stop + 1 - begin
            error = _ERROR / 2 * scatter / sqrt(bins - 2) / float(np.std(fall))
            roll_off = longest if bend > x[begin] else nan
            found = PowerLaw(float(hurst), error, longest, shortest, float(10**level), roll_off)
    return found


def _candidates(x: NDArray) -> list[tuple[int, int, float]]:
    """First and last bin, and log10 q at which the law begins: at the first bin, or behind a plateau from bin 0 on."""
    pairs = [
        (i, j) for i in range(x.size) for j in range(i + 1, x.size) if x[j] - x[i] >= _LEAST_DECADES
    ]
    straight = [(i, j, float(x[i])) for i, j in pairs]
    ends = sorted({j for i, j in pairs if i == 0})
    bends = (
        x[0] + _LEAST_PLATEAU + np.arange(x.size * _BENDS_PER_DECADE) / _BENDS_PER_DECADE
        if ends
        else ()
    )
    return straight + [(0, j, float(b)) for j in ends for b in bends if x[j] - b >= _LEAST_DECADES]


def _binned(q: NDArray, density: NDArray) -> tuple[NDArray, NDArray]:
    """Means of log10 q and log10 C in bins of equal width in log q; where C is positive."""
    q, density = q[density > 0], density[density > 0]
    if not q.size:
        return q, density
    number = np.floor(np.log10(q / q[0]) * _BINS_PER_DECADE + SLACK).astype(int)
    count = np.bincount(number)
    x, y = (
        np.bincount(number, np.log10(values))[count > 0] / count[count > 0]
        for values in (q, density)
    )
    return x, y


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

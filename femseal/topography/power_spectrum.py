"""Evaluate the spectrum of a map: its shortest wave above noise, its white noise and its power law.

Symbols: q angular wave number [rad/m], C isotropic spectral density [m⁴], H Hurst exponent, C ∝ q^(−2−2H). For a
surface of parallel grooves, C is the spectral density averaged over all directions; with the Hurst exponent H of the
grooves, this average is also proportional to q^(−2−2H).

Source: Jacobs, Junge, Pastewka, Surf. Topogr.: Metrol. Prop. 5 (2017) 013001.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan, log, nan, pi, prod, sqrt
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Array, Flags
from .patches import Surface
from .topography import Topography
from .waves import SLACK

#: Number of bins of the spectrum per decade of wavelength, and number of positions per decade that are tried for the
#: end of a plateau.
_BINS_PER_DECADE = 12
_BENDS_PER_DECADE = 48
#: Largest rms deviation of log10 C from a power law, beyond the scatter that the number of waves explains.
_SCATTER = 0.12
#: Smallest range of wavelengths of a power law [decades]: without a plateau, and next to a plateau.
_LEAST_DECADES = 0.7
_LEAST_DECADES_BEHIND_PLATEAU = 0.5
#: Smallest range of wavelengths of a plateau [decades].
_LEAST_PLATEAU = 0.3
#: Smallest number of bins of a power law next to a plateau.
_LEAST_BINS = 4
#: The end of the spectrum consists of the rings above this fraction of the Nyquist wave number. Noise is recognised if
#: at least this number of rings have a density.
_END, _FEWEST_RINGS = 0.75, 8
#: The end of the spectrum is noise if log C over log q falls less steeply than this.
_FLAT = -1.5
#: A ring clearly exceeds the noise if its spectral density is at least this many times the density of the noise.
_ABOVE_NOISE = 4.0
#: Densities below this fraction of the largest density are rounding errors.
_ROUNDING = 1e-16
#: Waves whose density is below this fraction of the power law were not resolved by the instrument.
_CUT = 0.1
#: Largest Hurst exponent of a fit.
_LARGEST_HURST = 1.1
#: Standard deviation of log10 C about a valid power law, in addition to the scatter due to the finite number of waves.
_MODEL_SCATTER = 0.02
#: Relative standard error of the level of white noise.
_NOISE_ERROR = 0.3
#: Ratio of the reported standard error to the standard error of the fit. The fit underestimates its error, because the
#: range of the fit is also chosen. Measured on 768 Gaussian surfaces with and without plateau, noise and lay: 96 % of
#: the exponents are within two reported errors.
_ERROR = 1.6
#: A law with a plateau is preferred to a law without, unless its error is more than this many times larger.
_PREFER_PLATEAU = 1.5
#: The density is multiplied by this power of q before the average over a bin, so that the product is nearly constant in
#: the bin.
_FLATTENING = 3.0


@dataclass(frozen=True)
class SpectralPowerLaw:
    """Describe a power law of the spectral density, C = density · (q/q₀)^(−2−2H) with q₀ = 2π/longest.

    Parameters
    ----------
    hurst, hurst_error : float
        Hurst exponent H and its standard error [-].
    longest, shortest : float
        Longest and shortest wavelength [m] of the range in which the power law is valid.
    density : float
        Spectral density C [m⁴] at the wavelength `longest`.
    roll_off : float
        Wavelength above which the spectrum has a plateau [m], equal to `longest`; NaN without a plateau.
    """

    hurst: float
    hurst_error: float
    longest: float
    shortest: float
    density: float
    roll_off: float

    def at(self, q: Any) -> Any:
        """Return the density C [m⁴] at wave numbers [rad/m]."""
        return self.density * (q * self.longest / (2 * pi)) ** (-2 - 2 * self.hurst)

    def slope_power(self, longest: float, shortest: float) -> float:
        """Return the mean square slope of the waves between two wavelengths [m], (1/2π)∫q³C dq."""
        q = 2 * pi / longest
        log_ratio = np.log(longest / shortest)
        # exprel(x) = (exp(x) − 1)/x is regular for H = 1
        growth = log_ratio * scipy.special.exprel((2 - 2 * self.hurst) * log_ratio)
        return float(q**4 * self.at(q) / (2 * pi) * growth)


#: Placeholder for the power law of a spectrum that follows none.
NO_LAW = SpectralPowerLaw(nan, nan, nan, nan, nan, nan)


@dataclass(frozen=True)
class Spectrum:
    """Shortest measured wave, noise and power law of a spectrum.

    Parameters
    ----------
    shortest_wave : float
        Shortest measured wave [m], see `spectrum`.
    noise : float
        Rms height [m] of the white noise in the map.
    law : SpectralPowerLaw, optional
        Power law of the spectrum; None if the spectrum does not follow a power law.
    """

    shortest_wave: float
    noise: float
    law: SpectralPowerLaw | None


def spectrum(topography: Surface) -> Spectrum:
    """Find the shortest measured wave, the noise and the power law of a map without form and undefined points.

    Three lower limits on the shortest measured wave are determined; the largest one applies. The grid limit is twice
    the larger pixel spacing. If the spectrum ends with white noise, the noise limit is the wavelength at which C is
    four times the density of the noise. If the spectrum follows a power law, the instrument limit is the wavelength
    below which C is less than a tenth of the power law.

    For several patches, the spectrum of one patch is returned: the patch whose shortest measured wave is the longest.
    """
    if not isinstance(topography, Topography):
        summaries = [spectrum(patch) for patch in topography.patches]
        return max(summaries, key=lambda summary: summary.shortest_wave)
    # If a map was declared periodic but has a step at its border, the step adds waves of all lengths. The map is then
    # mirrored instead, which leaves no step.
    if topography.seamless != topography.periodic:
        topography = Topography(topography.heights, topography.spacing, topography.seamless)
    q, density = topography.radial_psd()
    nyquist = pi / max(topography.spacing)
    is_resolved = (q > 0) & (q <= nyquist * (1 + SLACK))
    q, density = q[is_resolved], density[is_resolved]
    if not np.any(density > 0):
        return Spectrum(2 * pi / nyquist, 0.0, None)
    floor = _noise_floor(q, density, nyquist)
    is_signal = density > max(_ABOVE_NOISE * floor, _ROUNDING * density.max())
    shortest = 2 * pi / _last_signal(q, is_signal, nyquist)
    # The power law is fitted without the ring at the end of the signal, which may contain only some of its waves, and
    # without waves longer than half of the shorter side, which were changed when the form was subtracted.
    step = float(np.diff(q).max(initial=0.0))
    is_used = (q >= 4 * pi / min(topography.size)) & (q <= 2 * pi / shortest - step) & is_signal
    law = _fit(_average_in_bins(q[is_used], density[is_used], floor, topography))
    if law is not None:
        # beyond the power law, waves with a much smaller density were not resolved by the instrument
        is_missing = (q > 2 * pi / law.shortest) & (density - floor < _CUT * law.at(q))
        if is_missing.any():
            first_missing = q[np.argmax(is_missing)]
            shortest = max(shortest, 2 * pi / first_missing)
    # white noise with the density C has the mean square height C/(Δ1 Δ2)
    noise = float(np.sqrt(floor / np.prod(topography.spacing)))
    return Spectrum(float(shortest), noise, law)


def _last_signal(q: NDArray, is_signal: Flags, nyquist: float) -> float:
    """Return the largest wave number [rad/m] at which the spectral density clearly exceeds the noise.

    q : wave numbers of the rings in rising order, (rings,) [rad/m].
    is_signal : whether the spectral density of each ring clearly exceeds the noise, (rings,).
    nyquist : largest wave number of the grid [rad/m], which is returned if the last ring exceeds the noise.
    """
    if not is_signal.any():
        last = q[0]  # a map of pure noise has no measured waves; its longest wave is taken
    else:
        last = q[is_signal].max()
    return float(nyquist if last == q[-1] else last)


def _noise_floor(q: NDArray, density: NDArray, nyquist: float) -> float:
    """Return the spectral density of white noise [m⁴].

    If the spectral density is constant near the Nyquist wave number, this constant is the spectral density of the
    noise. If the spectral density falls up to the Nyquist wave number, the noise is taken to be 0.

    q : wave numbers (rings,) [rad/m].
    density : spectral density at the wave numbers (rings,) [m⁴].
    nyquist : largest wave number [rad/m].
    """
    is_end = (q > _END * nyquist) & (density > _ROUNDING * density.max())
    if np.count_nonzero(is_end) < _FEWEST_RINGS:
        return 0.0
    # a power law is a straight line in log C over log q
    slope, _ = np.polyfit(np.log(q[is_end]), np.log(density[is_end]), 1)
    if slope < _FLAT:
        return 0.0
    return float(np.median(density[is_end]))


@dataclass(frozen=True, eq=False)
class _Bins:
    """A spectrum that was averaged in bins of equal width in log q.

    Attributes
    ----------
    x, y : arrays (bins,), log10 of the wave number [rad/m] and log10 of the spectral density [m⁴].
    variance : array (bins,), variance of y due to the finite number of waves in a bin and to the noise.
    """

    x: Array
    y: Array
    variance: Array

    @property
    def weight(self) -> Array:
        """Weight of each bin in a least-squares fit of y, (bins,)."""
        return 1 / (self.variance + _MODEL_SCATTER**2)

    def part(self, first: int, last: int) -> _Bins:
        """Return the bins from index `first` to index `last`, inclusive."""
        bins = slice(first, last + 1)
        return _Bins(self.x[bins], self.y[bins], self.variance[bins])


def _average_in_bins(q: NDArray, density: NDArray, floor: float, topography: Topography) -> _Bins:
    """Subtract the spectral density `floor` of white noise from a radial spectrum, and average the result in bins.

    Only rings with a spectral density above `floor` are used.

    For a map of area A, a ring of radius q and width w contains A q w/2π wave vectors, and half as many independent
    waves, because a wave and its conjugate are the same wave. On a Gaussian surface, the squared amplitude of a wave is
    exponentially distributed. Therefore, the mean of the spectral density over n independent waves has a relative
    standard deviation of 1/√n.
    """
    is_used = density > floor
    q = q[is_used]
    signal = density[is_used] - floor
    if not q.size:
        return _Bins(q, q, q)
    # width of the rings: the larger step between wave numbers, 2π/L on a periodic axis and π/L on a mirrored one
    width = max(
        pi * (1 + wraps) / side
        for wraps, side in zip(topography.periodic, topography.size, strict=True)
    )
    waves = prod(topography.size) * q * width / (2 * pi)  # number of wave vectors in each ring
    # index of the bin to which each ring belongs
    bin_of_ring = np.floor(np.log10(q / q[0]) * _BINS_PER_DECADE + SLACK).astype(int)
    count = np.bincount(bin_of_ring, waves)  # number of wave vectors in each bin
    is_full = count > 0
    count = count[is_full]
    # In each bin, x is the mean of log10 q. The product of C and q³ is nearly constant in the bin, so that its mean is
    # also its value at x.
    x = np.bincount(bin_of_ring, waves * np.log10(q))[is_full] / count
    flattened = np.bincount(bin_of_ring, waves * signal * q**_FLATTENING)[is_full] / count
    y = np.log10(flattened) - _FLATTENING * x
    noise = floor / 10**y  # ratio of the noise to the signal
    # Variance of the signal, divided by its square. The first term is due to the finite number of independent waves,
    # count/2, whose density is the sum of signal and noise. The second term is due to the error of the noise level.
    relative_variance = 2 / count * (1 + noise) ** 2 + (_NOISE_ERROR * noise) ** 2
    # a small relative change of C changes log10 C by 1/ln 10 times this change
    return _Bins(x, y, relative_variance / log(10) ** 2)


def _fit(bins: _Bins) -> SpectralPowerLaw | None:
    """Fit the power law whose exponent has the smallest standard error; return None if no power law is valid.

    A power law without a plateau is fitted to every range of successive bins. A power law with a plateau is fitted to
    every range that begins with the longest waves. A power law with a plateau may have a standard error that is larger
    by the factor `_PREFER_PLATEAU`, because its fit has an additional unknown, the end of the plateau.
    """
    straight = [
        _fit_straight(bins.part(first, last))
        for first in range(bins.x.size)
        for last in range(first + 1, bins.x.size)
        if bins.x[last] - bins.x[first] >= _LEAST_DECADES
    ]
    bent = [_fit_behind_plateau(bins.part(0, last)) for last in range(_LEAST_BINS, bins.x.size)]
    laws = [law for law in straight + bent if law is not None]

    def rank(law: SpectralPowerLaw) -> float:
        has_plateau = not isnan(law.roll_off)
        return law.hurst_error / _PREFER_PLATEAU if has_plateau else law.hurst_error

    return min(laws, key=rank, default=None)


def _fit_straight(bins: _Bins) -> SpectralPowerLaw | None:
    """Fit a power law to all bins; return None if the fit is not valid."""
    return _fit_from(bins, float(bins.x[0]), has_plateau=False)


def _fit_behind_plateau(bins: _Bins) -> SpectralPowerLaw | None:
    """Fit a plateau followed by a power law to all bins; return None if the fit is not valid.

    The end of the plateau is chosen so that the weighted sum of the squared deviations of all bins from the fit is
    smallest.
    """
    x, weight = bins.x, bins.weight
    # values of log10 q that are tried for the end of the plateau
    bends = np.arange(
        x[0] + _LEAST_PLATEAU, x[-1] - _LEAST_DECADES_BEHIND_PLATEAU, 1 / _BENDS_PER_DECADE
    )
    bins_behind = np.sum(x > bends[:, None], axis=1)
    bends = bends[bins_behind >= _LEAST_BINS]
    if not bends.size:
        return None
    # The best fit y = level + slope · t with t = max(x − bend, 0) reduces the weighted sum of squares of y by
    # (Σ w t y)²/Σ w t², if t and y are measured from their weighted means. The best bend has the largest reduction.
    beyond_bend = np.maximum(x - bends[:, None], 0.0)  # t, (bend, bin)
    beyond_bend -= (beyond_bend @ weight / weight.sum())[:, None]
    deviation = bins.y - bins.y @ weight / weight.sum()
    reduction = (beyond_bend @ (weight * deviation)) ** 2 / (beyond_bend**2 @ weight)  # (bend,)
    return _fit_from(bins, float(bends[np.argmax(reduction)]), has_plateau=True)


def _fit_from(bins: _Bins, bend: float, *, has_plateau: bool) -> SpectralPowerLaw | None:
    """Fit y = level + slope · max(x − bend, 0) to the bins by least squares; return None if the fit is not valid.

    Here x and y are log10 of wave number and spectral density, `level` and `slope` are unknown, and `bend` is given:
    the x at which the plateau ends, or the x of the first bin if the spectrum has no plateau. The standard error of the
    slope includes the uncertainty about where the plateau ends. If the deviations from the fit are larger than expected
    from the variances of the bins, the standard error is increased by the same ratio.
    """
    beyond_bend = np.maximum(bins.x - bend, 0.0)
    weight = bins.weight
    # derivatives of the fit with respect to its unknowns, (unknown, bin); the normal equations give the unknowns
    design = np.array([np.ones(beyond_bend.size), beyond_bend])
    level, slope = np.linalg.solve((design * weight) @ design.T, (design * weight) @ bins.y)
    deviation = level + slope * beyond_bend - bins.y
    hurst = -1 - slope / 2  # because the slope of log C over log q is −2 − 2H
    if has_plateau:
        # the position of the bend is a third unknown
        by_bend = np.where(beyond_bend > 0, -slope, 0.0)
        design = np.vstack([design, by_bend])
    freedom = beyond_bend.size - len(design)  # degrees of freedom
    unexplained = np.maximum(deviation**2 - bins.variance, 0.0)  # beyond the scatter of the waves
    is_valid = sqrt(np.mean(unexplained)) <= _SCATTER and 0 < hurst <= _LARGEST_HURST
    if freedom < 1 or not is_valid:
        return None
    # ratio of the rms deviation to that expected from the variances; it increases the standard error if it exceeds 1
    excess = max(1.0, sqrt(weight @ deviation**2 / freedom))
    covariance = np.linalg.inv((design * weight) @ design.T)
    slope_variance = covariance[1, 1]
    longest = 2 * pi / 10**bend
    return SpectralPowerLaw(
        hurst=float(hurst),
        hurst_error=float(_ERROR / 2 * excess * sqrt(slope_variance)),  # dH = −d(slope)/2
        longest=longest,
        shortest=float(2 * pi / 10 ** bins.x[-1]),
        density=float(10**level),
        roll_off=longest if has_plateau else nan,
    )

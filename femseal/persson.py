"""Estimate contact and leakage of rough surfaces by Persson's theory.

Symbols: E* contact modulus, p̄ mean pressure, H hardness, q wave number [rad/m], C spectral density.
"""

from __future__ import annotations

from functools import cache
from math import inf, log, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf, erfc

from .base import Array, reals

#: If the rms pressure of full contact exceeds the hardness by this factor, the contact fraction is p̄/H to all digits.
_ALL_PLASTIC = 50.0
#: Ratio γ of the elastic energy of a rough contact to the elastic energy of full contact at the same pressure.
_ENERGY = 0.45
#: Ratio of the gap of the critical junction to the mean gap u of the parts in apparent contact, at the resolution at
#: which the first path opens.
_PASSAGE = 2.0
#: Contact fraction above which no open path crosses a surface with isotropic roughness.
CLOSING_AREA = 0.42


def persson_area(pressure: ArrayLike, spread: ArrayLike, hardness: float = inf) -> Array:
    """Return the contact fraction of rough solids by Persson's theory.

    As waves of shorter and shorter wavelength are included, the distribution of the contact pressure spreads from its
    mean p̄ by diffusion. Points at which the pressure reaches 0 lose contact. Points at which the pressure reaches the
    hardness H keep the pressure H. The contact fraction is

    erf(p̄/√2s) + Σ erfc((2kH − p̄)/√2s) − erfc((2kH + p̄)/√2s), k = 1, 2, …

    with the rms pressure s of full contact. The contact fraction is 1 for p̄ = H, and tends to p̄/H for s → ∞. Sources:
    Persson, J. Chem. Phys. 115, 2001, 3840; Phys. Rev. Lett. 87, 2001, 116101 (with hardness).

    Parameters
    ----------
    pressure : array_like
        Mean pressure p̄ [Pa].
    spread : array_like
        Rms pressure of full contact, s = E*h′/2, where h′ is the rms slope [Pa].
    hardness : float
        Hardness H [Pa].

    Examples
    --------
    >>> persson_area([0.1, 1.0, 2.0], 1.0, hardness=2.0).round(4)
    array([0.0797, 0.6854, 1.    ])
    """
    p = reals(pressure)
    s = reals(spread)
    width = sqrt(2) * np.maximum(np.minimum(s, _ALL_PLASTIC * hardness), 1e-150)
    area = erf(p / width)
    if hardness < inf:
        # later terms of the sum are below the rounding error
        terms = 5 + int(3.1 * np.max(width) / hardness)
        for reflection in 2 * hardness * np.arange(1, terms):
            area = area + erfc((reflection - p) / width) - erfc((reflection + p) / width)
    return np.asarray(area)


class Junction(NamedTuple):
    """Result of `critical_junction`.

    Attributes
    ----------
    area : contact fraction [-].
    gap : gap of the critical junction [m], 0 if there is no open path.
    mean_gap : mean gap of the surface [m].
    """

    area: float
    gap: float
    mean_gap: float


def critical_junction(
    pressure: float,
    modulus: float,
    waves: ArrayLike,
    powers: ArrayLike,
    *,
    hardness: float = inf,
    closing: float = CLOSING_AREA,
) -> Junction:
    """Estimate the contact fraction of an isotropic surface, and the gap of its critical junction, from its spectrum.

    If only the waves up to a wave number q are resolved, the surface has the apparent contact fraction A(q), which
    decreases with q. When A(q) falls below the percolation threshold, a first open path appears. The narrowest point of
    the first open path is the critical junction. Where the faces are in apparent contact at the resolution q, the
    shorter waves (wave numbers q′ > q) keep them apart. The mean gap in these parts of the surface is

    u = √π ∫ q′²C w G(w p̄/AE*) dq′,

    where 1/w² is half of the mean square slope of the waves between q and q′. C is the spectral density, normalised so
    that ⟨z²⟩ = 2π ∫ q′C dq′. The function G(y) is the integral ∫ (γ + 3(1 − γ) erf²x) e^(−x²) dx/x from y to ∞, with
    γ = 0.45.

    The gap of the critical junction is set to 2u, but at most to the mean gap. The factor 2 was determined from
    simulations of 100 surfaces. With this factor, the median surface leaks as much as parallel plates with the gap of
    the critical junction. Persson's theory gives the gap d(Au)/dA instead of 2u. For elastic solids, d(Au)/dA is 2u to
    3u. For solids that yield, it may become arbitrarily large. A solid that yields is replaced by a softer elastic
    solid with the same contact fraction.
    Sources: Persson & Yang, J. Phys. Condens. Matter 20, 2008, 315011; Yang & Persson, ibid., 215214.

    Parameters
    ----------
    pressure : float
        Mean pressure p̄ > 0 [Pa].
    modulus : float
        Contact modulus E* [Pa].
    waves : array_like, (waves,)
        Wave numbers q in rising order [rad/m].
    powers : array_like, (waves,)
        Contribution of each wave number to the mean square height [m²], > 0.
    hardness : float
        Hardness H [Pa].
    closing : float
        Smallest contact fraction at which no open path crosses the surface.
    """
    q = reals(waves)
    power = reals(powers)
    # mean square slope of all waves up to each wave number, preceded by 0 for no waves at all (waves + 1,)
    square_slope = np.concatenate([[0.0], np.cumsum(q**2 * power)])
    area = persson_area(pressure, modulus / 2 * np.sqrt(square_slope), hardness)
    gap = _gap_of_touching_parts(pressure, modulus, q, power, square_slope, area)
    mean_gap = float(gap[0])  # without any waves, the whole surface is in apparent contact
    if area[-1] >= closing:
        return Junction(float(area[-1]), 0.0, mean_gap)
    # gap at the resolution at which the contact fraction falls to `closing`, interpolated in its logarithm
    gap_at_closing = float(np.interp(-log(closing), -np.log(area), np.append(gap, 0.0)))
    return Junction(float(area[-1]), min(_PASSAGE * gap_at_closing, mean_gap), mean_gap)


def _gap_of_touching_parts(
    pressure: float, modulus: float, q: Array, power: Array, square_slope: Array, area: Array
) -> Array:
    """Compute the mean gap u [m] of the parts in apparent contact, at the resolution of each wave number (waves,).

    Parameters
    ----------
    pressure : mean pressure p̄ [Pa].
    modulus : contact modulus E* [Pa].
    q : array (waves,), wave numbers [rad/m].
    power : array (waves,), contribution of each wave number to the mean square height [m²].
    square_slope : array (waves + 1,), mean square slope of all waves up to each wave number. The first entry, without
        any waves, is 0.
    area : array (waves + 1,), contact fraction if only the waves up to each wave number are resolved. The first entry
        is the contact fraction without waves.
    """
    x, erf_x, G = _gap_integral()
    # An elastic solid with the contact modulus E and the rms slope h′ has the contact fraction erf(√2 p̄/(E h′)). E is
    # chosen so that the elastic solid has the same contact fraction as the solid that yields.
    rms_slope = sqrt(square_slope[-1])
    softer_modulus = sqrt(2) * pressure / (rms_slope * np.interp(area[-1], erf_x, x))
    lowest_modulus = min(modulus, softer_modulus)
    # The arrays below have a row for each resolution, and a column for each wave. Waves that are shorter than the
    # resolution separate the parts in apparent contact; the integrand of longer waves is 0.

    # mean square slope up to the middle of the band of each wave (wave,)
    middle = (square_slope[1:] + square_slope[:-1]) / 2
    # mean square slope of the waves between the resolution and each wave (resolution, wave)
    slope_between = middle - square_slope[:-1, None]
    w = np.sqrt(2 / np.where(slope_between > 0, slope_between, inf))
    # u = √π ∫ q′²C w G(w p̄/AE*) dq′, see `critical_junction`. Over the band of a wave, ∫ q′C dq′ is power/2π, so that
    # the factor of the sum is √π/2π = 1/(2√π).
    lower_limit = np.maximum(w * pressure / (area[:-1, None] * lowest_modulus), x[0])
    integrand = q * power * w * np.interp(np.log(lower_limit), np.log(x), G)
    return integrand.sum(axis=1) / (2 * sqrt(pi))


class _GapIntegral(NamedTuple):
    """Tabulated integral G of `critical_junction`.

    Attributes
    ----------
    x : array (points,), lower limits of the integral.
    erf : array (points,), error function of x.
    G : array (points,), integral from x to ∞.
    """

    x: Array
    erf: Array
    G: Array


@cache
def _gap_integral() -> _GapIntegral:
    """Tabulate the integral G of `critical_junction` by the trapezoidal rule in ln x."""
    x = np.geomspace(1e-8, 6, 4000)
    erf_x = erf(x)
    integrand = (_ENERGY + 3 * (1 - _ENERGY) * erf_x**2) * np.exp(-(x**2))
    steps = (integrand[1:] + integrand[:-1]) / 2 * np.diff(np.log(x))
    # sum from each point to the last one, where the integral is 0
    G = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
    return _GapIntegral(x, erf_x, G)

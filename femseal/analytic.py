"""Closed forms of contact and flow, used by tests and examples.

Symbols: E* contact modulus (1/E* = Σ(1−ν²)/E), p̄ mean pressure, h gap, k permeability (h³/12 between
parallel plates), η viscosity. SI units; numbers may be arrays where a closed form allows it.
"""

from __future__ import annotations

from functools import cache
from math import erf, erfc, inf, log, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def _reals(values: ArrayLike) -> Array:
    return np.asarray(values, dtype=float)


# --- contact ---


def hertz_radius(load: float, radius: float, modulus: float) -> float:
    """Contact radius a = (3WR/4E*)^⅓ [m] of a sphere of radius R [m] under W [N]. Johnson 1985, eq. 4.22.

    >>> round(hertz_radius(1.0, 1e-3, 115e9) * 1e6, 3)
    18.683
    """
    return float((3 * load * radius / (4 * modulus)) ** (1 / 3))


def hertz_peak_pressure(load: float, radius: float, modulus: float) -> float:
    """Peak pressure p₀ = 3W/(2πa²) [Pa]. Johnson, Contact Mechanics, 1985, eq. 4.24."""
    return 3 * load / (2 * pi * hertz_radius(load, radius, modulus) ** 2)


def hertz_approach(load: float, radius: float, modulus: float) -> float:
    """Approach of distant points δ = a²/R [m]. Johnson, Contact Mechanics, 1985, eq. 4.23."""
    return hertz_radius(load, radius, modulus) ** 2 / radius


def hertz_pressure(r: ArrayLike, load: float, radius: float, modulus: float) -> Array:
    """Pressure p₀ √(1 − r²/a²) [Pa] at a distance r [m] from the axis, 0 outside. Johnson 1985, eq. 3.39."""
    a = hertz_radius(load, radius, modulus)
    inside = np.clip(1 - (_reals(r) / a) ** 2, 0.0, None)
    return hertz_peak_pressure(load, radius, modulus) * np.sqrt(inside)


def wave_full_contact_pressure(modulus: float, half_height: float, wavelength: float) -> float:
    """p* = πE*Δ/λ [Pa] that flattens the gap Δ(1 − cos(2πx/λ)). Westergaard 1939; Johnson 1985, eq. 13.7."""
    return pi * modulus * half_height / wavelength


def wave_contact_fraction(ratio: ArrayLike) -> Array:
    """Contact fraction (2/π) asin √(p̄/p*) of the one-dimensional wave. Johnson 1985, eq. 13.9.

    >>> round(float(wave_contact_fraction(0.5)), 12)
    0.5
    """
    return 2 / pi * np.arcsin(np.sqrt(_reals(ratio)))


def wave_pressure(x: ArrayLike, ratio: float, wavelength: float) -> Array:
    """Pressure over p* of the wave with a crest at x = 0, for 0 < p̄/p* <= 1; 0 outside the contact.

    p/p* = 2 cos ψ √(sin²ψ_a − sin²ψ), ψ = πx/λ, sin²ψ_a = p̄/p*. Johnson 1985, eq. 13.8.
    """
    ψ = pi * _reals(x) / wavelength
    return 2 * np.abs(np.cos(ψ)) * np.sqrt(np.clip(ratio - np.sin(ψ) ** 2, 0.0, None))


def wave_gap(x: ArrayLike, ratio: float, half_height: float, wavelength: float) -> Array:
    """Gap [m] of the wave with a crest at x = 0, 0 <= p̄/p* <= 1; 0 in the contact.

    g = 2Δ (s √(s² − s_a²) − s_a² arcosh(s/s_a)), s = |sin πx/λ|, s_a² = p̄/p*: the integral of the slope
    (4πΔ/λ) cos ψ √(sin²ψ − sin²ψ_a), which continues the pressure of Westergaard (1939) out of the contact.
    """
    s = np.abs(np.sin(pi * _reals(x) / wavelength))
    if ratio == 0:
        return 2 * half_height * s**2
    a = sqrt(ratio)
    s = np.maximum(s, a)
    return 2 * half_height * (s * np.sqrt(s**2 - a**2) - ratio * np.arccosh(s / a))


def wave_groove_flow(ratio: float, points: int = 200) -> float:
    """⟨g³⟩/(2Δ)³ of the flow along the grooves of the wave: k = (2Δ)³/12 times it. 5/16 at p̄ = 0.

    By Gauss-Legendre quadrature over the open part, whose ends are graded because g ~ (s − s_a)^{3/2} there.

    >>> [float(f"{wave_groove_flow(r):.7g}") for r in (0, 0.1, 0.5, 0.9)]
    [0.3125, 0.1253863, 0.003534788, 7.852893e-07]
    """
    node, weight = np.polynomial.legendre.leggauss(points)
    t = (node + 1) / 2
    edge = np.arcsin(np.sqrt(ratio))
    ψ = edge + (pi / 2 - edge) * t**2
    cube = wave_gap(ψ / pi, ratio, 0.5, 1.0) ** 3
    return float(2 / pi * (pi / 2 - edge) * np.sum(weight * t * cube))


def wavy_full_contact_pressure(modulus: float, half_height: float, wavelength: float) -> float:
    """p* = √2 πE*Δ/λ [Pa] that flattens the gap Δ(1 − cos(2πx/λ) cos(2πy/λ)).

    Source: Johnson, Greenwood & Higginson, Int. J. Mech. Sci. 27, 1985, 383.
    """
    return sqrt(2) * pi * modulus * half_height / wavelength


def wavy_contact_fraction_light(ratio: ArrayLike) -> Array:
    """Contact fraction π(3p̄/8πp*)^⅔ of the two-dimensional wave for p̄ → 0 (two Hertz contacts in λ²).

    Source: Johnson, Greenwood & Higginson 1985.
    """
    return pi * (3 * _reals(ratio) / (8 * pi)) ** (2 / 3)


def wavy_contact_fraction_full(ratio: ArrayLike) -> Array:
    """Contact fraction 1 − (3/2π)(1 − p̄/p*) of the two-dimensional wave for p̄ → p*.

    Source: Johnson, Greenwood & Higginson 1985 (the open spots as pressurised penny cracks).
    """
    return 1 - 3 / (2 * pi) * (1 - _reals(ratio))


# --- flow ---


def parallel_plates(gap: ArrayLike) -> Array:
    """Permeability h³/12 [m³] between parallel plates. Reynolds 1886."""
    return _reals(gap) ** 3 / 12


def wavy_gap_along(gap: float, amplitude: float) -> float:
    """Permeability (h₀³/12)(1 + 3ε²/2) [m³] along the ridges of h₀(1 + ε cos): the mean of h³."""
    return gap**3 / 12 * (1 + 1.5 * amplitude**2)


def wavy_gap_across(gap: float, amplitude: float) -> float:
    """Permeability (h₀³/12)(1 − ε²)^{5/2}/(1 + ε²/2) [m³] across the ridges: the harmonic mean of h³."""
    return gap**3 / 12 * (1 - amplitude**2) ** 2.5 / (1 + amplitude**2 / 2)


def large_gap(mean_gap: ArrayLike, rms: float) -> Array:
    """Permeability (h̄³/12)(1 − 3σ²/2h̄²) [m³] of an isotropic gap of rms roughness σ [m], to second order
    in σ/h̄.

    Half of what the ridges along add, 3σ²/h̄², and those across take off, 6σ²/h̄². Elrod, J. Lubr. Technol.
    101, 1979, 8.
    """
    h = _reals(mean_gap)
    return h**3 / 12 - h * rms**2 / 8


def stripes_across(permeabilities: ArrayLike) -> float:
    """Harmonic mean of stripes of equal width in series; 0 if one is closed."""
    k = _reals(permeabilities)
    return float(1 / np.mean(1 / k)) if np.all(k > 0) else 0.0


def checkerboard(k1: float, k2: float) -> float:
    """√(k₁k₂), exact for a checkerboard of any contrast. Dykhne, Sov. Phys. JETP 32, 1971, 63."""
    return sqrt(k1 * k2)


def log_symmetric_links(permeabilities: ArrayLike) -> float:
    """exp⟨ln k⟩ of independent links on a large square lattice whose ln k is distributed symmetrically
    (self-duality).

    Source: Dykhne 1971; Marchant & Gabillard, C. R. Acad. Sci. 281 B, 1975, 261. 0 if one k is 0.
    """
    k = _reals(permeabilities)
    return float(np.exp(np.mean(np.log(k)))) if np.all(k > 0) else 0.0


def annulus_rate(
    permeability: float,
    pressure_drop: float,
    viscosity: float,
    inner_radius: float,
    outer_radius: float,
) -> float:
    """Radial flow Q = 2πkΔp/(η ln(r_o/r_i)) [m³/s] through a ring of uniform k."""
    return 2 * pi * permeability * pressure_drop / (viscosity * log(outer_radius / inner_radius))


def turned_annulus_rate(
    along: float,
    across: float,
    lead: float,
    pressure_drop: float,
    viscosity: float,
    inner_radius: float,
    outer_radius: float,
) -> float:
    """Flow [m³/s] through a ring whose grooves come back by the lead [m] once around it, Δp/η · 2π/∫ dr/(r k_rr).

    k_rr = k⊥ cos²α + k∥ sin²α with tan α = lead/2πr: closed across, k⊥ = 0, fluid follows the grooves.
    Source: Geoffroy & Prat, J. Fluids Eng. 126, 2004, 48.

    >>> round(turned_annulus_rate(5.0, 1.0, 0.0, 1.0, 1.0, 1.0, 2.0) * log(2) / (2 * pi), 12)
    1.0
    """
    c2, inner, outer = (lead / (2 * pi)) ** 2, inner_radius, outer_radius
    if along * c2 == 0:
        return annulus_rate(across, pressure_drop, viscosity, inner, outer)
    if across == 0:
        integral = (log(outer / inner) + (outer**2 - inner**2) / (2 * c2)) / along
    else:
        tail = log((across * outer**2 + along * c2) / (across * inner**2 + along * c2))
        integral = log(outer / inner) / along + (1 - across / along) / (2 * across) * tail
    return 2 * pi * pressure_drop / (viscosity * integral)


# --- contact and flow of rough faces, by the theory of Persson ---

_erf, _erfc = (np.vectorize(function, otypes=[float]) for function in (erf, erfc))
#: Rms pressure of full contact over the hardness beyond which the area is p̄/H to all digits.
_ALL_PLASTIC = 50.0
#: Part of the elastic energy that contact of rough solids has of that of full contact at the same pressure.
_ENERGY = 0.45
#: Width of the critical junction in mean gaps of what touches where it opens.
_PASSAGE = 2.0
#: Contact fraction at which isotropic roughness closes.
CLOSING_AREA = 0.42


def persson_area(pressure: ArrayLike, spread: ArrayLike, hardness: float = inf) -> Array:
    """Contact fraction of rough solids under p̄, whose pressure in full contact has the rms s = E*h′/2; all in Pa.

    As shorter waves come in, pressures diffuse from p̄ on; what gets to 0 is out of contact, what gets to the hardness H
    stays: erf(p̄/√2s) + Σ erfc((2kH − p̄)/√2s) − erfc((2kH + p̄)/√2s) over k = 1, 2, … It is 1 at p̄ = H, and p̄/H for
    s → ∞. Source: Persson, J. Chem. Phys. 115, 2001, 3840; Phys. Rev. Lett. 87, 2001, 116101 (with hardness).

    >>> persson_area([0.1, 1.0, 2.0], 1.0, hardness=2.0).round(4)
    array([0.0797, 0.6854, 1.    ])
    """
    p, s = _reals(pressure), _reals(spread)
    width = sqrt(2) * np.maximum(np.minimum(s, _ALL_PLASTIC * hardness), 1e-150)
    area = _erf(p / width)
    if hardness < inf:
        for wall in 2 * hardness * np.arange(1, 5 + int(3.1 * np.max(width) / hardness)):
            area = area + _erfc((wall - p) / width) - _erfc((wall + p) / width)
    return np.asarray(area)


class Junction(NamedTuple):
    """Contact fraction, gap of the critical junction [m], 0 where there is no open path, and mean gap [m]."""

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
    """Contact and narrowest passage of an isotropic face under p̄ > 0 [Pa], from the spectrum of its heights alone.

    Seen with the waves up to some q alone, the contact fraction A falls with q. Where it is that at which the face
    closes, an open path appears. What touches there so far has the mean gap u = √π ∫ q²C w G(w p̄/AE*) dq over the
    shorter waves, with 1/w² half of their mean square slope, C = ⟨z²⟩/2πq dq, and G(y) = ∫ (γ + 3(1 − γ) erf²x) e^(−x²)
    dx/x from y on, γ = 0.45. Solids that yield are taken for softer elastic ones of the same contact fraction. The
    passage is as wide as twice u, at most as the mean gap: plates of that distance let through what the face does, in
    the median of 100 faces. The theory has for it the distance d(Au)/dA of what parts there, which is 2 to 3 u, but
    has no limit where solids yield.
    Sources: Persson & Yang, J. Phys. Condens. Matter 20, 2008, 315011; Yang & Persson, ibid., 215214.

    waves, powers : q [rad/m], rising, and mean square heights [m²] of waves around them, each > 0.
    closing : contact fraction at which the face closes.
    """
    q, power = _reals(waves), _reals(powers)
    slope2 = np.concatenate([[0.0], np.cumsum(q**2 * power)])
    area = persson_area(pressure, modulus / 2 * np.sqrt(slope2), hardness)
    x, errors, integral = _gap_integral()
    alike = sqrt(2) * pressure / (sqrt(slope2[-1]) * np.interp(area[-1], errors, x))
    # the wave of a column is among the shorter ones of a row
    shorter = (slope2[1:] + slope2[:-1]) / 2 - slope2[:-1, None]
    w = np.sqrt(2 / np.where(shorter > 0, shorter, inf))
    y = np.maximum(w * pressure / (area[:-1, None] * min(modulus, alike)), x[0])
    gap = (q * power * w * np.interp(np.log(y), np.log(x), integral)).sum(axis=1) / (2 * sqrt(pi))
    at_closing = (
        np.interp(-log(closing), -np.log(area), np.append(gap, 0.0)) if area[-1] < closing else 0.0
    )
    return Junction(
        float(area[-1]), min(_PASSAGE * float(at_closing), float(gap[0])), float(gap[0])
    )


@cache
def _gap_integral() -> tuple[Array, Array, Array]:
    """x, erf x, and the integral G from x on, see `critical_junction`."""
    x = np.geomspace(1e-8, 6, 4000)
    errors = _erf(x)
    integrand = (_ENERGY + 3 * (1 - _ENERGY) * errors**2) * np.exp(-(x**2))
    steps = (integrand[1:] + integrand[:-1]) / 2 * np.diff(np.log(x))
    return x, errors, np.append(np.cumsum(steps[::-1])[::-1], 0.0)

"""Provide closed-form solutions of contact and flow problems, for tests and examples.

Symbols: E* contact modulus (1/E* = Σ(1−ν²)/E), p̄ mean pressure, h gap, k permeability (h³/12 between parallel plates),
η viscosity. All values are in SI units. Arguments can be arrays where they are declared as `array_like`.
"""

from __future__ import annotations

from math import log, log1p, pi, sqrt

import numpy as np
from numpy.typing import ArrayLike

from .base import Array, reals

# Persson's theory was in this module formerly, and can still be imported from it
from .persson import CLOSING_AREA as CLOSING_AREA
from .persson import Junction as Junction
from .persson import critical_junction as critical_junction
from .persson import persson_area as persson_area

# --- contact ---


def hertz_radius(load: float, radius: float, modulus: float) -> float:
    """Return the contact radius a = (3WR/4E*)^⅓ of a sphere on a flat. Source: Johnson 1985, eq. 4.22.

    Parameters
    ----------
    load : float
        Load W [N].
    radius : float
        Radius of the sphere R [m].
    modulus : float
        Contact modulus E* [Pa].

    Returns
    -------
    float
        Contact radius a [m].

    Examples
    --------
    >>> round(hertz_radius(1.0, 1e-3, 115e9) * 1e6, 3)
    18.683
    """
    return float((3 * load * radius / (4 * modulus)) ** (1 / 3))


def hertz_peak_pressure(load: float, radius: float, modulus: float) -> float:
    """Return the peak pressure p₀ = 3W/(2πa²) [Pa] of a sphere on a flat.

    The arguments are those of `hertz_radius`. Source: Johnson, Contact Mechanics, 1985, eq. 4.24.
    """
    return 3 * load / (2 * pi * hertz_radius(load, radius, modulus) ** 2)


def hertz_approach(load: float, radius: float, modulus: float) -> float:
    """Return the approach δ = a²/R [m] of a sphere and a flat, measured far from the contact.

    The arguments are those of `hertz_radius`. Source: Johnson, Contact Mechanics, 1985, eq. 4.23.
    """
    return hertz_radius(load, radius, modulus) ** 2 / radius


def hertz_pressure(r: ArrayLike, load: float, radius: float, modulus: float) -> Array:
    """Return the pressure p₀ √(1 − r²/a²) [Pa] between a sphere and a flat, 0 outside the contact.

    Source: Johnson, Contact Mechanics, 1985, eq. 3.39.

    Parameters
    ----------
    r : array_like
        Distance from the axis [m].
    load, radius, modulus : float
        Load, radius of the sphere and contact modulus, see `hertz_radius`.
    """
    a = hertz_radius(load, radius, modulus)
    squared = np.clip(1 - (reals(r) / a) ** 2, 0.0, None)  # 0 outside the contact
    return hertz_peak_pressure(load, radius, modulus) * np.sqrt(squared)


def wave_full_contact_pressure(modulus: float, half_height: float, wavelength: float) -> float:
    """Return the mean pressure p* = πE*Δ/λ at which the gap Δ(1 − cos(2πx/λ)) closes completely.

    Sources: Westergaard 1939; Johnson 1985, eq. 13.7.

    Parameters
    ----------
    modulus : float
        Contact modulus E* [Pa].
    half_height : float
        Amplitude Δ [m].
    wavelength : float
        Wavelength λ [m].

    Returns
    -------
    float
        Mean pressure p* for full contact [Pa].
    """
    return pi * modulus * half_height / wavelength


def wave_contact_fraction(ratio: ArrayLike) -> Array:
    """Return the contact fraction (2/π) asin √(p̄/p*) of a one-dimensional wave. Source: Johnson 1985, eq. 13.9.

    Parameters
    ----------
    ratio : array_like
        Ratio p̄/p*, from 0 to 1, of the mean pressure to the mean pressure p* of full contact, see
        `wave_full_contact_pressure`.

    Examples
    --------
    >>> round(float(wave_contact_fraction(0.5)), 12)
    0.5
    """
    return 2 / pi * np.arcsin(np.sqrt(reals(ratio)))


def wave_pressure(x: ArrayLike, ratio: float, wavelength: float) -> Array:
    """Return the dimensionless contact pressure p/p* of a one-dimensional wave with a crest at x = 0.

    In the contact, p/p* = 2 cos ψ √(sin²ψ_a − sin²ψ), with ψ = πx/λ and sin²ψ_a = p̄/p*. Outside the contact, the
    pressure is 0. Source: Johnson 1985, eq. 13.8.

    Parameters
    ----------
    x : array_like
        Position [m].
    ratio : float
        Ratio p̄/p* > 0 of the mean pressure to the mean pressure p* of full contact, at most 1.
    wavelength : float
        Wavelength λ [m].
    """
    ψ = pi * reals(x) / wavelength
    return 2 * np.abs(np.cos(ψ)) * np.sqrt(np.clip(ratio - np.sin(ψ) ** 2, 0.0, None))


def wave_gap(x: ArrayLike, ratio: float, half_height: float, wavelength: float) -> Array:
    """Return the gap [m] of a one-dimensional wave with a crest at x = 0; 0 in the contact.

    The gap is g = 2Δ (s √(s² − s_a²) − s_a² arcosh(s/s_a)) with s = |sin πx/λ| and s_a² = p̄/p*. The gap g is the
    integral of the slope (4πΔ/λ) cos ψ √(sin²ψ − sin²ψ_a), which follows from the solution of Westergaard (1939)
    outside the contact.

    Parameters
    ----------
    x : array_like
        Position [m].
    ratio : float
        Ratio p̄/p*, from 0 to 1, of the mean pressure to the mean pressure p* of full contact.
    half_height, wavelength : float
        Amplitude Δ and wavelength λ [m].
    """
    s = np.abs(np.sin(pi * reals(x) / wavelength))
    if ratio == 0:
        return 2 * half_height * s**2
    s_a = sqrt(ratio)
    s = np.maximum(s, s_a)  # makes the gap 0 in the contact
    return 2 * half_height * (s * np.sqrt(s**2 - s_a**2) - ratio * np.arccosh(s / s_a))


def wave_groove_flow(ratio: float, points: int = 200) -> float:
    """Return the dimensionless mean cube of the gap, ⟨g³⟩/(2Δ)³, for the flow along the grooves of a wave.

    The permeability along the grooves is (2Δ)³/12 times the returned value. For p̄ = 0, this value is 5/16. The mean
    over the open part of the wave is computed by Gauss-Legendre quadrature. The quadrature points are dense near the
    edge of the contact, where the gap is proportional to (s − s_a)^{3/2} (see `wave_gap` for s and s_a).

    Parameters
    ----------
    ratio : float
        Ratio p̄/p*, from 0 to 1, of the mean pressure to the mean pressure p* of full contact.
    points : int
        Number of quadrature points.

    Examples
    --------
    >>> [float(f"{wave_groove_flow(r):.7g}") for r in (0, 0.1, 0.5, 0.9)]
    [0.3125, 0.1253863, 0.003534788, 7.852893e-07]
    """
    node, weight = np.polynomial.legendre.leggauss(points)
    t = (node + 1) / 2
    edge = np.arcsin(np.sqrt(ratio))  # ψ = πx/λ at the edge of the contact
    ψ = edge + (pi / 2 - edge) * t**2  # so that dψ is proportional to t dt
    cube = wave_gap(ψ / pi, ratio, 0.5, 1.0) ** 3
    return float(2 / pi * (pi / 2 - edge) * np.sum(weight * t * cube))


def wavy_full_contact_pressure(modulus: float, half_height: float, wavelength: float) -> float:
    """Return the mean pressure p* = √2 πE*Δ/λ [Pa] that closes the gap Δ(1 − cos(2πx/λ) cos(2πy/λ)) completely.

    The arguments are those of `wave_full_contact_pressure`. Source: Johnson, Greenwood & Higginson, Int. J. Mech. Sci.
    27, 1985, 383.
    """
    return sqrt(2) * pi * modulus * half_height / wavelength


def wavy_contact_fraction_light(ratio: ArrayLike) -> Array:
    """Return the contact fraction π(3p̄/8πp*)^⅔ of a two-dimensional wave for p̄/p* → 0.

    In the limit p̄/p* → 0, each square λ × λ of the surface contains two Hertzian contacts. Source: Johnson, Greenwood
    & Higginson 1985.
    """
    return pi * (3 * reals(ratio) / (8 * pi)) ** (2 / 3)


def wavy_contact_fraction_full(ratio: ArrayLike) -> Array:
    """Return the contact fraction 1 − (3/2π)(1 − p̄/p*) of a two-dimensional wave for p̄/p* → 1.

    In the limit p̄/p* → 1, the remaining open spots are treated as penny-shaped cracks under pressure. Source: Johnson,
    Greenwood & Higginson 1985.
    """
    return 1 - 3 / (2 * pi) * (1 - reals(ratio))


# --- flow ---


def parallel_plates(gap: ArrayLike) -> Array:
    """Return the permeability h³/12 [m³] between parallel plates with the gap h [m]. Source: Reynolds 1886."""
    return reals(gap) ** 3 / 12


def wavy_gap_along(gap: float, amplitude: float) -> float:
    """Return the permeability (h₀³/12)(1 + 3ε²/2) [m³] of the gap h₀(1 + ε cos(2πx/λ)), for flow along the ridges.

    The permeability along the ridges is the arithmetic mean of h³/12.

    Parameters
    ----------
    gap : float
        Mean gap h₀ [m].
    amplitude : float
        Relative amplitude ε [-].
    """
    return gap**3 / 12 * (1 + 1.5 * amplitude**2)


def wavy_gap_across(gap: float, amplitude: float) -> float:
    """Return the permeability (h₀³/12)(1 − ε²)^{5/2}/(1 + ε²/2) [m³] of the gap h₀(1 + ε cos(2πx/λ)) across the ridges.

    The permeability across the ridges is the harmonic mean of h³/12.

    Parameters
    ----------
    gap : float
        Mean gap h₀ [m].
    amplitude : float
        Relative amplitude ε [-].
    """
    return gap**3 / 12 * (1 - amplitude**2) ** 2.5 / (1 + amplitude**2 / 2)


def large_gap(mean_gap: ArrayLike, rms: float) -> Array:
    """Return the permeability (h̄³/12)(1 − 3σ²/2h̄²) [m³] of an isotropic rough gap, to second order in σ/h̄.

    Ridges of the rms height σ increase the permeability along the ridges by the fraction 3σ²/h̄², and decrease it
    across the ridges by the fraction 6σ²/h̄². For isotropic roughness, the relative change of the permeability is the
    mean of +3σ²/h̄² and −6σ²/h̄². Source: Elrod, J. Lubr. Technol. 101, 1979, 8.

    Parameters
    ----------
    mean_gap : array_like
        Mean gap h̄ [m].
    rms : float
        Rms roughness σ [m].
    """
    h = reals(mean_gap)
    return h**3 / 12 - h * rms**2 / 8


def stripes_across(permeabilities: ArrayLike) -> float:
    """Return the permeability of stripes of equal width in series: the harmonic mean, or 0 if a stripe is closed."""
    k = reals(permeabilities)
    return float(1 / np.mean(1 / k)) if np.all(k > 0) else 0.0


def checkerboard(k1: float, k2: float) -> float:
    """Return the permeability √(k₁k₂) of a checkerboard of squares with the permeabilities k₁ and k₂.

    The result is exact for any ratio k₁/k₂. Source: Dykhne, Sov. Phys. JETP 32, 1971, 63.
    """
    return sqrt(k1 * k2)


def log_symmetric_links(permeabilities: ArrayLike) -> float:
    """Return the permeability exp⟨ln k⟩ of a large square lattice of links with independent permeabilities k.

    If one of the permeabilities is 0, the result is 0. For k > 0, the result is exact if the distribution of ln k is
    symmetric, because the square lattice is equal to its dual lattice. Sources: Dykhne 1971; Marchant & Gabillard, C.
    R. Acad. Sci. 281 B, 1975, 261.
    """
    k = reals(permeabilities)
    return float(np.exp(np.mean(np.log(k)))) if np.all(k > 0) else 0.0


def annulus_rate(
    permeability: float,
    pressure_drop: float,
    viscosity: float,
    inner_radius: float,
    outer_radius: float,
) -> float:
    """Return the radial flow Q = 2πkΔp/(η ln(r_o/r_i)) through a ring of uniform permeability.

    Parameters
    ----------
    permeability : float
        Permeability k [m³].
    pressure_drop : float
        Pressure drop Δp from inlet to outlet [Pa].
    viscosity : float
        Viscosity η [Pa s].
    inner_radius, outer_radius : float
        Inner radius r_i and outer radius r_o [m].

    Returns
    -------
    float
        Volume flow rate Q [m³/s].
    """
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
    """Return the flow [m³/s] through a ring with a spiral groove, Δp/η · 2π/∫ dr/(r k_rr).

    The radial permeability is k_rr = k⊥ cos²α + k∥ sin²α with tan α = lead/2πr. If the ridges are closed (k⊥ = 0), the
    fluid can only follow the groove. If the grooves are closed (k∥ = 0), it can only flow across them. Source:
    Geoffroy & Prat, J. Fluids Eng. 126, 2004, 48.

    Parameters
    ----------
    along, across : float
        Permeability k∥ along the groove, and permeability k⊥ across the groove [m³].
    lead : float
        Radial distance between successive turns of the same groove [m].
    pressure_drop, viscosity, inner_radius, outer_radius : float
        Pressure drop, viscosity and radii, see `annulus_rate`.

    Examples
    --------
    >>> round(turned_annulus_rate(5.0, 1.0, 0.0, 1.0, 1.0, 1.0, 2.0) * log(2) / (2 * pi), 12)
    1.0
    """
    c2 = (lead / (2 * pi)) ** 2  # tan²α = c2/r²
    if across == 0 and along * c2 == 0:
        return 0.0
    log_ratio = log(outer_radius / inner_radius)
    # integral of 1/(r k_rr) from the inner to the outer radius, with k_rr = (k⊥r² + k∥c2)/(r² + c2); both forms are
    # equal, and each is free of cancellation in its range
    if along < across:
        ratio = along / across
        if ratio == 0:
            excess = c2 * (inner_radius**-2 - outer_radius**-2) / 2
        else:
            difference = log1p(ratio * c2 / inner_radius**2) - log1p(ratio * c2 / outer_radius**2)
            excess = (1 - ratio) / (2 * ratio) * difference
        integral = (log_ratio + excess) / across
    else:
        ratio = across / along
        square_difference = outer_radius**2 - inner_radius**2
        if ratio == 0:
            excess = square_difference / (2 * c2)
        else:
            growth = ratio * square_difference / (ratio * inner_radius**2 + c2)
            excess = (1 - ratio) / (2 * ratio) * log1p(growth)
        integral = (log_ratio + excess) / along
    return 2 * pi * pressure_drop / (viscosity * integral)

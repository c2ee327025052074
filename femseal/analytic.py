"""Provide closed-form solutions of contact and flow problems, for tests and examples.

Symbols: E* contact modulus (1/E* = Σ(1−ν²)/E), p̄ mean pressure, h gap, k permeability (h³/12 between parallel plates),
η viscosity. All values are in SI. Arguments may be arrays where the closed form allows it.
"""

from __future__ import annotations

from functools import cache
from math import erf, erfc, inf, log, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def _reals(values: ArrayLike) -> Array:
    """Convert values to an array of real numbers."""
    return np.asarray(values, dtype=float)


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
    """Return the peak pressure p₀ = 3W/(2πa²) [Pa] of a sphere on a flat; arguments as in `hertz_radius`.

    Source: Johnson, Contact Mechanics, 1985, eq. 4.24.
    """
    return 3 * load / (2 * pi * hertz_radius(load, radius, modulus) ** 2)


def hertz_approach(load: float, radius: float, modulus: float) -> float:
    """Return the approach of distant points δ = a²/R [m] of a sphere and a flat; arguments as in `hertz_radius`.

    Source: Johnson, Contact Mechanics, 1985, eq. 4.23.
    """
    return hertz_radius(load, radius, modulus) ** 2 / radius


def hertz_pressure(r: ArrayLike, load: float, radius: float, modulus: float) -> Array:
    """Return the pressure p₀ √(1 − r²/a²) [Pa] below a sphere, 0 outside the contact.

    Source: Johnson, Contact Mechanics, 1985, eq. 3.39.

    Parameters
    ----------
    r : array_like
        Distance from the axis [m].
    load, radius, modulus : float
        See `hertz_radius`.
    """
    a = hertz_radius(load, radius, modulus)
    inside = np.clip(1 - (_reals(r) / a) ** 2, 0.0, None)
    return hertz_peak_pressure(load, radius, modulus) * np.sqrt(inside)


def wave_full_contact_pressure(modulus: float, half_height: float, wavelength: float) -> float:
    """Return the mean pressure p* = πE*Δ/λ that closes the gap Δ(1 − cos(2πx/λ)) completely.

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
        p* [Pa].
    """
    return pi * modulus * half_height / wavelength


def wave_contact_fraction(ratio: ArrayLike) -> Array:
    """Return the contact fraction (2/π) asin √(p̄/p*) of a one-dimensional wave. Source: Johnson 1985, eq. 13.9.

    Parameters
    ----------
    ratio : array_like
        p̄/p*, from 0 to 1, see `wave_full_contact_pressure`.

    Examples
    --------
    >>> round(float(wave_contact_fraction(0.5)), 12)
    0.5
    """
    return 2 / pi * np.arcsin(np.sqrt(_reals(ratio)))


def wave_pressure(x: ArrayLike, ratio: float, wavelength: float) -> Array:
    """Return the pressure over p* of a one-dimensional wave with a crest at x = 0; 0 outside the contact.

    p/p* = 2 cos ψ √(sin²ψ_a − sin²ψ) with ψ = πx/λ and sin²ψ_a = p̄/p*. Source: Johnson 1985, eq. 13.8.

    Parameters
    ----------
    x : array_like
        Position [m].
    ratio : float
        p̄/p*, with 0 < p̄/p* <= 1.
    wavelength : float
        Wavelength λ [m].
    """
    ψ = pi * _reals(x) / wavelength
    return 2 * np.abs(np.cos(ψ)) * np.sqrt(np.clip(ratio - np.sin(ψ) ** 2, 0.0, None))


def wave_gap(x: ArrayLike, ratio: float, half_height: float, wavelength: float) -> Array:
    """Return the gap [m] of a one-dimensional wave with a crest at x = 0; 0 in the contact.

    g = 2Δ (s √(s² − s_a²) − s_a² arcosh(s/s_a)) with s = |sin πx/λ| and s_a² = p̄/p*. This is the integral of the slope
    (4πΔ/λ) cos ψ √(sin²ψ − sin²ψ_a), which continues the pressure of Westergaard (1939) outside the contact.

    Parameters
    ----------
    x : array_like
        Position [m].
    ratio : float
        p̄/p*, from 0 to 1.
    half_height, wavelength : float
        Amplitude Δ and wavelength λ [m].
    """
    s = np.abs(np.sin(pi * _reals(x) / wavelength))
    if ratio == 0:
        return 2 * half_height * s**2
    s_a = sqrt(ratio)
    s = np.maximum(s, s_a)  # in the contact the gap below is then 0
    return 2 * half_height * (s * np.sqrt(s**2 - s_a**2) - ratio * np.arccosh(s / s_a))


def wave_groove_flow(ratio: float, points: int = 200) -> float:
    """Return ⟨g³⟩/(2Δ)³ for the flow along the grooves of a one-dimensional wave, whose k is (2Δ)³/12 times as much.

    It is 5/16 for p̄ = 0. The integral over the open part is computed by Gauss-Legendre quadrature. The points are
    graded towards the edge of the contact, because the gap is proportional to (s − s_a)^{3/2} there.

    Parameters
    ----------
    ratio : float
        p̄/p*, from 0 to 1.
    points : int
        Number of quadrature points.

    Examples
    --------
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
    """Return the mean pressure p* = √2 πE*Δ/λ [Pa] that closes the gap Δ(1 − cos(2πx/λ) cos(2πy/λ)) completely.

    Source: Johnson, Greenwood & Higginson, Int. J. Mech. Sci. 27, 1985, 383. Arguments as in
    `wave_full_contact_pressure`.
    """
    return sqrt(2) * pi * modulus * half_height / wavelength


def wavy_contact_fraction_light(ratio: ArrayLike) -> Array:
    """Return the contact fraction π(3p̄/8πp*)^⅔ of a two-dimensional wave for p̄/p* → 0.

    It is that of two Hertz contacts in an area λ². Source: Johnson, Greenwood & Higginson 1985.
    """
    return pi * (3 * _reals(ratio) / (8 * pi)) ** (2 / 3)


def wavy_contact_fraction_full(ratio: ArrayLike) -> Array:
    """Return the contact fraction 1 − (3/2π)(1 − p̄/p*) of a two-dimensional wave for p̄/p* → 1.

    The open spots are penny-shaped cracks under pressure. Source: Johnson, Greenwood & Higginson 1985.
    """
    return 1 - 3 / (2 * pi) * (1 - _reals(ratio))


# --- flow ---


def parallel_plates(gap: ArrayLike) -> Array:
    """Return the permeability h³/12 [m³] between parallel plates with the gap h [m]. Source: Reynolds 1886."""
    return _reals(gap) ** 3 / 12


def wavy_gap_along(gap: float, amplitude: float) -> float:
    """Return the permeability (h₀³/12)(1 + 3ε²/2) [m³] along the ridges of the gap h₀(1 + ε cos), the mean of h³/12.

    gap : h₀ [m]. amplitude : ε [-].
    """
    return gap**3 / 12 * (1 + 1.5 * amplitude**2)


def wavy_gap_across(gap: float, amplitude: float) -> float:
    """Return the permeability [m³] across the ridges of the gap h₀(1 + ε cos), the harmonic mean of h³/12.

    It is (h₀³/12)(1 − ε²)^{5/2}/(1 + ε²/2).

    gap : h₀ [m]. amplitude : ε [-].
    """
    return gap**3 / 12 * (1 - amplitude**2) ** 2.5 / (1 + amplitude**2 / 2)


def large_gap(mean_gap: ArrayLike, rms: float) -> Array:
    """Return the permeability (h̄³/12)(1 − 3σ²/2h̄²) [m³] of an isotropic rough gap, to second order in σ/h̄.

    The term is half the sum of the gain along ridges, 3σ²/h̄², and the loss across ridges, 6σ²/h̄².
    Source: Elrod, J. Lubr. Technol. 101, 1979, 8.

    mean_gap : h̄ [m]. rms : rms roughness σ [m].
    """
    h = _reals(mean_gap)
    return h**3 / 12 - h * rms**2 / 8


def stripes_across(permeabilities: ArrayLike) -> float:
    """Return the permeability of stripes of equal width in series, their harmonic mean; 0 if one of them is closed."""
    k = _reals(permeabilities)
    return float(1 / np.mean(1 / k)) if np.all(k > 0) else 0.0


def checkerboard(k1: float, k2: float) -> float:
    """Return the permeability √(k₁k₂) of a checkerboard, which is exact for any contrast.

    Source: Dykhne, Sov. Phys. JETP 32, 1971, 63.
    """
    return sqrt(k1 * k2)


def log_symmetric_links(permeabilities: ArrayLike) -> float:
    """Return exp⟨ln k⟩, the permeability of independent links on a large square lattice; 0 if one of them is closed.

    It is exact if ln k is distributed symmetrically, because the lattice is self-dual. Sources: Dykhne 1971; Marchant &
    Gabillard, C. R. Acad. Sci. 281 B, 1975, 261.
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
    """Return the radial flow Q = 2πkΔp/(η ln(r_o/r_i)) through a ring of uniform permeability.

    Parameters
    ----------
    permeability : float
        k [m³].
    pressure_drop : float
        Δp [Pa].
    viscosity : float
        η [Pa s].
    inner_radius, outer_radius : float
        r_i and r_o [m].

    Returns
    -------
    float
        Q [m³/s].
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

    The radial permeability is k_rr = k⊥ cos²α + k∥ sin²α with tan α = lead/2πr. If the ridges are closed, k⊥ = 0, the
    fluid can only follow the groove. Source: Geoffroy & Prat, J. Fluids Eng. 126, 2004, 48.

    Parameters
    ----------
    along, across : float
        Permeabilities along the groove k∥ and across it k⊥ [m³].
    lead : float
        Radial distance between successive turns of the same groove [m].
    pressure_drop, viscosity, inner_radius, outer_radius : float
        See `annulus_rate`.

    Examples
    --------
    >>> round(turned_annulus_rate(5.0, 1.0, 0.0, 1.0, 1.0, 1.0, 2.0) * log(2) / (2 * pi), 12)
    1.0
    """
    c2 = (lead / (2 * pi)) ** 2
    if along * c2 == 0:
        return annulus_rate(across, pressure_drop, viscosity, inner_radius, outer_radius)
    log_ratio = log(outer_radius / inner_radius)
    if across == 0:
        integral = (log_ratio + (outer_radius**2 - inner_radius**2) / (2 * c2)) / along
    else:
        outer_term = across * outer_radius**2 + along * c2
        inner_term = across * inner_radius**2 + along * c2
        correction = (1 - across / along) / (2 * across) * log(outer_term / inner_term)
        integral = log_ratio / along + correction
    return 2 * pi * pressure_drop / (viscosity * integral)


# --- contact and flow of rough surfaces by Persson's theory ---

_erf = np.vectorize(erf, otypes=[float])
_erfc = np.vectorize(erfc, otypes=[float])
#: Ratio of the rms pressure of full contact to the hardness above which the area is p̄/H to all digits.
_ALL_PLASTIC = 50.0
#: Elastic energy of the contact of rough solids, over that of full contact at the same pressure (γ).
_ENERGY = 0.45
#: Width of the critical junction, over the mean gap of the parts that touch at the magnification where it opens.
_PASSAGE = 2.0
#: Contact fraction above which isotropic roughness has no open path.
CLOSING_AREA = 0.42


def persson_area(pressure: ArrayLike, spread: ArrayLike, hardness: float = inf) -> Array:
    """Return the contact fraction of rough solids by Persson's theory.

    As shorter and shorter waves are included, the contact pressure diffuses from its mean p̄. A pressure that reaches 0
    means that contact is lost; a pressure that reaches the hardness H stays there. With the rms pressure s of full
    contact the contact fraction is

    erf(p̄/√2s) + Σ erfc((2kH − p̄)/√2s) − erfc((2kH + p̄)/√2s), k = 1, 2, …

    It is 1 for p̄ = H, and tends to p̄/H for s → ∞. Sources: Persson, J. Chem. Phys. 115, 2001, 3840; Phys. Rev. Lett.
    87, 2001, 116101 (with hardness).

    Parameters
    ----------
    pressure : array_like
        Mean pressure p̄ [Pa].
    spread : array_like
        Rms pressure of full contact, s = E*h′/2 with the rms slope h′ [Pa].
    hardness : float
        Hardness H [Pa].

    Examples
    --------
    >>> persson_area([0.1, 1.0, 2.0], 1.0, hardness=2.0).round(4)
    array([0.0797, 0.6854, 1.    ])
    """
    p, s = _reals(pressure), _reals(spread)
    width = sqrt(2) * np.maximum(np.minimum(s, _ALL_PLASTIC * hardness), 1e-150)
    area = _erf(p / width)
    if hardness < inf:
        terms = 5 + int(3.1 * np.max(width) / hardness)
        for image in 2 * hardness * np.arange(1, terms):
            area = area + _erfc((image - p) / width) - _erfc((image + p) / width)
    return np.asarray(area)


class Junction(NamedTuple):
    """Hold the result of `critical_junction`.

    area : contact fraction [-].
    gap : gap of the critical junction [m], 0 if there is no open path.
    mean_gap : mean gap [m].
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
    """Estimate the contact fraction and the narrowest passage of an isotropic surface from its spectrum.

    If only the waves up to a wave number q are considered, the contact fraction A(q) falls with q. At the wave number
    where A is the contact fraction at which the surface closes, a first open path appears: the critical junction. The
    parts that touch at this wave number are, on average, separated by the shorter waves by the gap

    u = √π ∫ q²C w G(w p̄/AE*) dq over these shorter waves,

    where 1/w² is half of the mean square slope of the waves between, C = ⟨z²⟩/2πq dq, and
    G(y) = ∫ (γ + 3(1 − γ) erf²x) e^(−x²) dx/x from y to ∞ with γ = 0.45.

    The gap of the junction is taken as 2u, but not more than the mean gap. Parallel plates at that distance leak as
    much as the surface in the median of 100 surfaces. The theory itself would give d(Au)/dA, which is 2 to 3 u, but is
    not bounded for solids that yield. Solids that yield are replaced by softer elastic ones with the same contact
    fraction. Sources: Persson & Yang, J. Phys. Condens. Matter 20, 2008, 315011; Yang & Persson, ibid., 215214.

    Parameters
    ----------
    pressure : float
        Mean pressure p̄ > 0 [Pa].
    modulus : float
        Contact modulus E* [Pa].
    waves : array_like, (waves,)
        Wave numbers q in rising order [rad/m].
    powers : array_like, (waves,)
        Mean square height of the waves around each wave number [m²], > 0.
    hardness : float
        Hardness H [Pa].
    closing : float
        Contact fraction at which the surface closes.
    """
    q, power = _reals(waves), _reals(powers)
    # mean square slope of the waves up to each wave number, beginning with none (waves + 1,)
    square_slope = np.concatenate([[0.0], np.cumsum(q**2 * power)])
    area = persson_area(pressure, modulus / 2 * np.sqrt(square_slope), hardness)
    gap = _gap_of_touching_parts(pressure, modulus, q, power, square_slope, area)
    mean_gap = float(gap[0])  # without any waves, all of the surface touches
    if area[-1] >= closing:
        return Junction(float(area[-1]), 0.0, mean_gap)
    gap_at_closing = float(np.interp(-log(closing), -np.log(area), np.append(gap, 0.0)))
    return Junction(float(area[-1]), min(_PASSAGE * gap_at_closing, mean_gap), mean_gap)


def _gap_of_touching_parts(
    pressure: float, modulus: float, q: Array, power: Array, square_slope: Array, area: Array
) -> Array:
    """Return the mean gap u [m] of the parts that touch when only longer waves are considered (waves,).

    square_slope, area : mean square slope and contact fraction with the waves up to each wave number (waves + 1,).
    """
    x, erf_x, G = _gap_integral()
    # An elastic solid with this modulus would have the same contact fraction as the solid that yields.
    rms_slope = sqrt(square_slope[-1])
    softer_modulus = sqrt(2) * pressure / (rms_slope * np.interp(area[-1], erf_x, x))
    lowest_modulus = min(modulus, softer_modulus)
    # In the arrays below a row stands for the shortest wave that is considered, and a column for one of the shorter
    # waves, which separate the parts. The integrand is 0 in the columns of longer waves.
    middle = (
        square_slope[1:] + square_slope[:-1]
    ) / 2  # mean square slope up to the middle of a wave (column,)
    slope_between = middle - square_slope[:-1, None]
    w = np.sqrt(2 / np.where(slope_between > 0, slope_between, inf))
    lower_limit = np.maximum(w * pressure / (area[:-1, None] * lowest_modulus), x[0])
    integrand = q * power * w * np.interp(np.log(lower_limit), np.log(x), G)
    return integrand.sum(axis=1) / (2 * sqrt(pi))


class _GapIntegral(NamedTuple):
    """Hold the tabulated integral G of `critical_junction`.

    x : lower limits of the integral (points,). erf : erf x (points,). G : the integral from x to ∞ (points,).
    """

    x: Array
    erf: Array
    G: Array


@cache
def _gap_integral() -> _GapIntegral:
    """Tabulate the integral G of `critical_junction` by the trapezoidal rule in ln x."""
    x = np.geomspace(1e-8, 6, 4000)
    erf_x = _erf(x)
    integrand = (_ENERGY + 3 * (1 - _ENERGY) * erf_x**2) * np.exp(-(x**2))
    steps = (integrand[1:] + integrand[:-1]) / 2 * np.diff(np.log(x))
    G = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
    return _GapIntegral(x, erf_x, G)

"""Compute displacements of coated bodies along free axes, as changes compared with uncoated half-spaces.

The displacement is computed in two parts: that of uncoated half-spaces of the layers' materials (`half_space`), and the
change due to the coatings. With the symbols of `layered`, the compliance of a coated body is S(t) times that of a
half-space of the layer's material, with t = qd. The change is a smooth function of the position, because S − 1 decays
exponentially with t. It is computed by fitting S − 1 with a sum of exponentials, Σ a exp(−b t). Each exponential gives
a displacement proportional to 1/√(ρ² + (bd)²) at the distance ρ from a point load, like the potential of a charge at
the depth b d. The integral of this displacement over a pixel has a closed form.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..base import Array, InputError
from ..materials import Coated, Solid
from .layered import Bodies, layer_factor

#: Number of exponentials that represent S − 1, and range of their exponents b.
_TERMS, _LEAST_EXPONENT, _LARGEST_EXPONENT = 40, 0.3, 100.0
#: Largest error of the sum of the exponentials, relative to the largest value of S − 1. The error is at most 1e-5 for
#: layers up to 100 times as stiff as the substrate, and below 1e-7 for metals.
_LARGEST_ERROR = 2e-5
#: Argument qd from which on S − 1 is below 1e-8.
_DECAYED = 12.0
#: Largest number of aliases on either side of a wave. Only a coating thinner than a quarter of a pixel needs more; the
#: error is then below 1e-4 of the displacement of a pixel under its own pressure.
_MOST_ALIASES = 8
#: Decay exp(−16) of a wave over the distance to its periodic images.
_IMAGE_DECAY = 16.0


def strip_difference(n_free: int, d_free: float, q: Array, d_other: float, bodies: Bodies) -> Array:
    """Compute the change in displacement due to the coatings, compared with uncoated half-spaces, for one free axis.

    The uncoated half-spaces have the properties of the layers. The change is added to the kernel in
    `half_space.strip_symbol` before its Fourier transform.

    Let q₁ be the wave number along the free axis, q₂ the wave number along the periodic or mirror axis, and q² = q₁² +
    q₂². For q₂ > 0, the change in displacement is (1/2π) ∫ 2(S(qd) − 1)/(E₁* q) exp(i q₁ x) dq₁, averaged over
    pixels. The integral is computed by the trapezoidal rule, which is a Fourier transform. Because the integrand is
    smooth, the rule converges exponentially.

    For q₂ = 0, the change in displacement is a sum of logarithms, one for each exponential in the fit of S − 1.

    Parameters
    ----------
    n_free : int
        Number of points along the free axis.
    d_free : float
        Spacing along the free axis [m].
    q : array (waves,)
        Wave numbers q₂ along the periodic or mirror axis [rad/m].
    d_other : float
        Spacing along the periodic or mirror axis [m].
    bodies : pair of bodies
        The two bodies.

    Returns
    -------
    array (waves, n_free)
        Change in displacement at each offset along the free axis, for a pressure of 1 Pa on the pixel at offset 0
        [m/Pa].
    """
    kernel = np.zeros((q.size, n_free))
    waves = np.flatnonzero(q > 0)
    rising = waves[np.argsort(q[waves])]
    for body in _coated(bodies):
        kernel[q == 0] += _plane_strain_difference(n_free, d_free, body)
        first = 0
        while first < rising.size:
            # waves of similar lengths decay over similar distances and are computed together
            last = int(np.searchsorted(q[rising], 2 * q[rising[first]], side="right"))
            group = rising[first:last]
            kernel[group] += _wave_difference(n_free, d_free, q[group], d_other, body)
            first = last
    return kernel


def free_difference(edges1: Array, edges2: Array, bodies: Bodies) -> Array:
    """Compute the change in displacement due to the coatings, compared with uncoated half-spaces, for two free axes.

    The uncoated half-spaces consist of the materials of the layers. Each exponential a exp(−bt) of the fit of S − 1
    adds the displacement a/(πE₁*) ∫∫ dx dy/√(x² + y² + z²) with z = b d, where the integral is over a pixel. The
    integral is the difference of

        x asinh(y/√(x² + z²)) + y asinh(x/√(y² + z²)) − z atan(x y/(z √(x² + y² + z²)))

    between the edges of the pixel along both axes.

    Parameters
    ----------
    edges1, edges2 : array (n1 + 1,), array (n2 + 1,)
        Edges of the pixels along both axes [m], relative to the point at which the displacement is computed.
    bodies : pair of bodies
        The two bodies.

    Returns
    -------
    array (n1, n2)
        Change in displacement at the origin for a pressure of 1 Pa on each single pixel [m/Pa].
    """
    kernel = np.zeros((edges1.size - 1, edges2.size - 1))
    x, y = edges1[:, None], edges2
    for body in _coated(bodies):
        amplitudes, exponents = _exponentials(_without_length(body))
        factor = 1 / (np.pi * body.layer.plane_modulus)
        for amplitude, exponent in zip(amplitudes, exponents, strict=True):
            z = exponent * body.thickness
            distance = np.sqrt(x**2 + y**2 + z**2)
            # indefinite integral at the corners of the pixels, (edge along x, edge along y)
            integral = (
                x * np.arcsinh(y / np.hypot(x, z))
                + y * np.arcsinh(x / np.hypot(y, z))
                - z * np.arctan(x * y / (z * distance))
            )
            kernel += factor * amplitude * np.diff(np.diff(integral, axis=0), axis=1)
    return kernel


def _coated(bodies: Bodies) -> list[Coated]:
    """Return the bodies that have a coating."""
    return [body for body in bodies if isinstance(body, Coated)]


def _without_length(body: Coated) -> Coated:
    """Return a body with the same S(t) but a layer thickness of 1 m and a Young's modulus of the layer of 1 Pa."""
    layer = Solid(1.0, body.layer.poisson)
    if body.substrate is None:
        return Coated(None, layer, 1.0)
    ratio = body.substrate.young / body.layer.young
    return Coated(Solid(ratio, body.substrate.poisson), layer, 1.0)


@lru_cache(maxsize=16)
def _exponentials(body: Coated) -> tuple[Array, Array]:
    """Fit S(t) − 1 by a sum of exponentials, Σ a exp(−b t), by least squares.

    Returns
    -------
    amplitudes, exponents : array (terms,)
        Amplitude a and exponent b of each exponential.

    Raises
    ------
    InputError
        The fit is not accurate enough, because the layer is far stiffer than the substrate.
    """
    # a stiff layer bends over a length that is longer than its thickness by the cube root of the ratio of the moduli
    bending_length = 1.0
    if body.substrate is not None:
        ratio = body.layer.shear_modulus / body.substrate.shear_modulus
        bending_length = max(1.0, float(np.cbrt(ratio)))
    exponents = np.geomspace(_LEAST_EXPONENT, _LARGEST_EXPONENT * bending_length, _TERMS)
    # t = qd at which S − 1 is fitted: 0, and 600 values from long waves, which bend the layer, to waves so short that
    # they do not reach the substrate (S − 1 is below 1e-18 for t > 25)
    t = np.r_[0.0, np.geomspace(1e-4 / bending_length, 25, 600)]
    excess = np.empty(t.size)
    excess[1:] = layer_factor(body, t[1:]) - 1
    excess[0] = _long_wave_factor(body) - 1
    terms = np.exp(-np.outer(t, exponents))
    amplitudes, *_ = np.linalg.lstsq(terms, excess, rcond=1e-14)
    error = np.abs(terms @ amplitudes - excess).max() / max(1.0, float(np.abs(excess).max()))
    if error > _LARGEST_ERROR:
        raise InputError(
            "modulus",
            "a coating that is far stiffer than its substrate, on a free axis",
            "a coating at most 100 times as stiff as its substrate, or periodic and mirror axes",
        )
    return amplitudes, exponents


def _long_wave_factor(body: Coated) -> float:
    """Return S(0), the ratio of the compliances of the substrate's and the layer's materials."""
    if body.substrate is None:
        return 0.0
    return body.layer.plane_modulus / body.substrate.plane_modulus


def _plane_strain_difference(n: int, d: float, body: Coated) -> Array:
    """Compute the change in displacement due to a coating for a pressure that varies only along the free axis.

    Each exponential a exp(−bt) of `_exponentials` adds the displacement −(2a/πE₁*) ln √(x² + z²) at the distance x from
    a line load, with z = b times the thickness of the layer. The integral of ½ ln(x² + z²) over a pixel is the
    difference of ½ x ln(x² + z²) − x + z atan(x/z) between the two edges of the pixel. The displacement of plane strain
    contains an arbitrary constant. This is why x and z in the logarithm may be divided by the length of the strip.

    n : number of points of the free axis.
    d : pixel length of the free axis [m].

    Returns the change in displacement at each offset for a pressure of 1 Pa on the pixel at offset 0, (n,) [m/Pa].
    """
    amplitudes, exponents = _exponentials(_without_length(body))
    length = n * d  # of the strip
    x = (np.arange(n + 1) - 0.5) / n  # edges of the pixels over this length
    z = exponents[:, None] * (body.thickness / length)  # (exponential, 1)
    integral = 0.5 * x * np.log(x**2 + z**2) - x + z * np.arctan(x / z)  # (exponential, edge)
    per_pixel = amplitudes @ np.diff(integral, axis=1)
    return -2 / (np.pi * body.layer.plane_modulus) * length * per_pixel


def _wave_difference(n: int, d: float, q: Array, d_other: float, body: Coated) -> Array:
    """Compute the change in displacement due to a coating for waves q > 0 along the axis that is not free.

    See `strip_difference` for the integral. The uniform pressure on a pixel contains aliases of the waves along both
    axes, whose contributions are added up. The weight of an alias is the Fourier transform of the uniform pressure on a
    pixel, a product of two sinc functions.

    n : number of points of the free axis.
    d : pixel length of the free axis [m].
    q : wave numbers along the axis that is not free (waves,) [rad/m]; the largest is at most twice the smallest.
    d_other : pixel length of the axis that is not free [m].

    Returns the change in displacement (wave, offset) for a pressure of 1 Pa on the pixel at offset 0 [m/Pa].
    """
    # a case that is only checked does not load the transforms
    from scipy.fft import irfft, next_fast_len

    shortest = _DECAYED / body.thickness  # wave number from which on S − 1 is negligible
    # The transform along the free axis is periodic. Its number of points is so large that the wave decays before its
    # next periodic image.
    decay_length = int(np.ceil(_IMAGE_DECAY / (q.min() * d)))
    period = next_fast_len(n + decay_length, real=True)
    aliases_free = _n_aliases(shortest, d)
    aliases_other = _n_aliases(shortest, d_other)
    frequency = np.arange(period // 2 + 1) / period  # wave number along the free axis over 2π/d
    total = np.zeros((q.size, frequency.size))  # Σ (S − 1)/|q| over all aliases, (wave, frequency)
    for m_free in range(-aliases_free, aliases_free + 1):
        q_free = 2 * np.pi / d * (frequency + m_free)
        for m_other in range(-aliases_other, aliases_other + 1):
            q_other = q + 2 * np.pi / d_other * m_other
            # magnitude |q| of the wave vector of the alias, (wave, frequency)
            wave = np.hypot(q_other[:, None], q_free)
            excess = layer_factor(body, wave * body.thickness) - 1  # S − 1
            # transform of the uniform pressure on a pixel; numpy defines sinc(x) as sin(πx)/(πx)
            weight = np.sinc(frequency + m_free) * np.sinc(q_other * d_other / (2 * np.pi))[:, None]
            total += excess / wave * weight
    total *= 2 / body.layer.plane_modulus
    return irfft(total, period, axis=1)[:, :n]


def _n_aliases(shortest: float, spacing: float) -> int:
    """Return the smallest m for which the aliases −m to m of a wave include all wave numbers up to `shortest` [rad/m].

    spacing : pixel length along the axis of the aliases [m].
    """
    # the aliases up to ±m include all waves up to (2m + 1) π/spacing
    return min(_MOST_ALIASES, max(0, int(np.ceil(0.5 * (shortest * spacing / np.pi - 1)))))

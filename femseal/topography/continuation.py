"""Continue the spectrum of a surface to waves that are too short for the instrument.

The power law of the measured spectrum is continued with random phases. Symbols: C spectral density [m⁴]
at a wave vector q, L1 and L2 sides of the map. A wave and its conjugate have the amplitude √(C/L1 L2) each, so that
Sq² = (1/4π²)∫C d²q. Source: Jacobs, Junge, Pastewka, Surf. Topogr.: Metrol. Prop. 5 (2017) 013001 (densities, slope).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, log1p, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base import InputError, Periodic, Shape, to_text, validate
from .generate import period_counts, random_waves
from .grid_choice import resolved_wave, resolving_shape
from .patches import Surface
from .power_spectrum import SpectralPowerLaw, spectrum
from .topography import Topography


@dataclass(frozen=True)
class Continuation:
    """Continue a measured spectrum below its shortest waves.

    Parameters
    ----------
    law : SpectralPowerLaw
        Power law of the measured spectrum.
    longest, cut_off : float
        Longest and shortest wavelength [m] of the added waves.
    rms_slope : float
        Rms slope of the measured waves down to `longest` [-].
    periodic : tuple of two bool
        Whether the map is periodic along x1 and x2.
    seed : tuple of int
        Seed of the phases.
    """

    law: SpectralPowerLaw
    longest: float
    cut_off: float
    rms_slope: float
    periodic: Periodic
    seed: tuple[int, ...]

    def add_to(self, face: Surface, realisation: int = 0, *, factor: float = 1.0) -> Surface:
        """Add all waves of the continued spectrum that are at least two pixels long to a surface.

        The same seed and the same realisation give the same waves on every grid. Along an axis that is not periodic,
        the waves are symmetric about the borders of the map, because the map continues as its mirror image beyond a
        border.

        Parameters
        ----------
        face : Topography or Patches
            The surface.
        realisation : int
            Number of the realisation of the random phases. In all realisations except the first (0), the exponent of
            the power law is random too, within its error.
        factor : float
            Factor by which the heights of the waves are multiplied.
        """
        # zeros at the end of a seed would have no effect, hence + 1
        rng = np.random.default_rng([*self.seed, realisation + 1])
        # the random number is also drawn for realisation 0, where the exponent does not change
        exponent_change = -2 * self.law.hurst_error * rng.standard_normal() * (realisation > 0)
        patch_rngs = rng.spawn(len(face.patches))
        waves = [
            self._waves_on(patch, exponent_change, patch_rng)
            for patch, patch_rng in zip(face.patches, patch_rngs, strict=True)
        ]
        return face.with_heights(face.heights + factor * np.concatenate(waves, axis=1))

    def _waves_on(
        self, patch: Topography, exponent_change: float, rng: np.random.Generator
    ) -> NDArray:
        """Return the heights of the added waves on a patch, (n1, n2) [m].

        exponent_change : change of the exponent of the power law. The change tilts the power law about the middle of
        its range of wave numbers, where the spectral density remains the same.
        """
        # along an axis that is not periodic, the map and its mirror image form one period
        n1, n2 = (
            n if is_periodic else 2 * n
            for n, is_periodic in zip(patch.shape, self.periodic, strict=True)
        )
        size = (n1 * patch.spacing[0], n2 * patch.spacing[1])
        shortest = max(self.cut_off, 2 * max(patch.spacing))  # waves need at least 2 pixels
        k1, k2 = period_counts(size, shortest)
        q = 2 * pi * np.hypot(k1 / size[0], k2 / size[1])
        q_middle = 2 * pi / sqrt(self.law.longest * self.law.shortest)
        density = self.law.at(q) * (q / q_middle) ** exponent_change
        density = np.where(q > 2 * pi / self.longest, density, 0.0)
        amplitude = np.sqrt(density / (size[0] * size[1]))
        z = random_waves((n1, n2), (k1, k2), amplitude, rng)
        # Adding the mirror image makes the waves symmetric about the borders. The sum doubles the mean square of the
        # waves on average, which the factor 1/√2 compensates.
        for axis in (0, 1):
            if not self.periodic[axis]:
                z = (z + np.flip(z, axis)) / sqrt(2)
        return z[: patch.shape[0], : patch.shape[1]]

    def slope_to(self, wave: float) -> float:
        """Return the rms slope [-] of all measured and continued waves down to a wavelength [m]."""
        return sqrt(self.rms_slope**2 + self.law.slope_power(self.longest, wave))

    def shortest_relevant_wave(self, hardness: float, modulus: float) -> float:
        """Return the wavelength [m] below which waves do not change the contact area; 0 if there is no such wavelength.

        The order of magnitude of the pressure in the contact is taken as E*h'/2, with the contact modulus E* and the
        rms slope h' of the waves; this is the rms pressure of full contact. The rms slope, and with it this pressure,
        increases when shorter waves are included. At a certain wavelength, this pressure reaches the hardness. Shorter
        waves are assumed to be flattened plastically and not to change the contact area.

        Parameters
        ----------
        hardness : float
            Hardness [Pa].
        modulus : float
            Contact modulus E* [Pa].
        """
        missing_square_slope = (2 * hardness / modulus) ** 2 - self.rms_slope**2
        if missing_square_slope <= 0:
            return self.longest
        # Wave number q at which the waves from q₀ to q have the missing square slope Δ = (1/2π) ∫ q³ C dq. With
        # C = C₀ (q/q₀)^(−2−2H), the integral is Δ = C₀ q₀⁴/2π · ((q/q₀)^e − 1)/e with e = 2 − 2H. Therefore ln(q/q₀) is
        # ln(1 + e D)/e with D = 2πΔ/(C₀ q₀⁴), or D for e = 0.
        q0 = 2 * pi / self.longest
        exponent = 2 - 2 * self.law.hurst
        scaled_slope = missing_square_slope * 2 * pi / (q0**4 * self.law.at(q0))  # D
        if not -1 < exponent * scaled_slope < inf:
            return 0.0  # even all shorter waves together have less than the missing slope
        log_ratio = log1p(exponent * scaled_slope) / exponent if exponent else scaled_slope
        return self.longest * exp(-log_ratio)

    def __str__(self) -> str:
        law = self.law
        longest, cut_off = to_text(self.longest, "m", 3), to_text(self.cut_off, "m", 3)
        law_longest, law_shortest = to_text(law.longest, "m", 3), to_text(law.shortest, "m", 3)
        exponent = f"{-2 - 2 * law.hurst:.2f} ± {2 * law.hurst_error:.2f}"
        return (
            f"waves from {longest} to {cut_off} continue the power law q^({exponent}) fitted from "
            f"{law_longest} to {law_shortest}; rms slope {self.rms_slope:.3g} of the measured, "
            f"{self.slope_to(self.cut_off):.3g} of all waves"
        )


def continuation_of(
    flat: Surface, cut_off: float, *, longest: float | None = None, rng: Any = 0
) -> Continuation:
    """Continue the spectrum of a surface from the end of its power law down to a shorter wave.

    Parameters
    ----------
    flat : Topography or Patches
        The surface with all measured waves, with its form removed and all points defined.
    cut_off : float
        Shortest wave [m].
    longest : float, optional
        Wavelength [m]; shorter measured waves are replaced. Default: the shortest wavelength of the power law.
    rng : int or sequence of int
        Seed of the phases.

    Raises
    ------
    InputError
        The spectrum does not follow a power law, or all waves down to the cut-off were measured.
    """
    shortest = validate.number("continue_spectrum", cut_off, unit="m")
    law = spectrum(flat).law
    if law is None:
        given = f"{to_text(shortest, 'm')} for a surface whose spectrum follows no power law"
        expected = "a face whose spectrum follows a power law over a factor of 5 in wavelength, as measured"
        raise InputError("continue_spectrum", given, expected)
    first = max(law.shortest, longest or 0.0)
    if shortest >= first:
        expected = f"less than {to_text(first, 'm', 3)}: longer waves are measured"
        raise InputError("continue_spectrum", to_text(shortest, "m"), expected)
    seed = tuple(int(n) for n in np.atleast_1d(rng))
    rms_slope = flat.low_pass(first).rms_slope
    return Continuation(law, first, shortest, rms_slope, flat.periodic, seed)


def continue_spectrum(
    topography: Surface,
    cut_off: float,
    *,
    shape: Shape | None = None,
    rng: Any,
    realisation: int = 0,
) -> Surface:
    """Add the waves that the instrument could not resolve to a surface, on a finer grid.

    The power law of the spectrum (see `describe_surface`) is continued below its shortest wave, isotropically and with
    random phases. Measured waves shorter than the shortest wave of the power law are removed.

    Parameters
    ----------
    topography : Topography or Patches
        The surface, with its form removed and all points defined.
    cut_off : float
        Shortest wave [m].
    shape : tuple of two int, optional
        Number of points of the finer grid. Default: enough points for 8 pixels per wavelength `cut_off`.
    rng : int or sequence of int
        Seed of the phases.
    realisation : int
        Number of the realisation of the random phases. In all realisations except the first (0), the exponent of the
        power law is random too, within its error.

    Returns
    -------
    Topography or Patches
        The surface with the added waves.

    Raises
    ------
    InputError
        The spectrum does not follow a power law, all waves down to the wavelength `cut_off` were measured, or the grid
        has fewer than 8 pixels for the wavelength `cut_off`.

    Examples
    --------
    >>> from femseal.topography import self_affine
    >>> face = self_affine((64, 64), (64e-6, 64e-6), hurst=0.8, rms_slope=0.05, cut_off=2.5e-6, rng=1)
    >>> continue_spectrum(face, 1e-6, rng=1).shape
    (512, 512)
    """
    continuation = continuation_of(topography, cut_off, rng=rng)
    needed_shape = resolving_shape(topography.size, cut_off)
    grid = needed_shape if shape is None else validate.grid("shape", shape)
    if cut_off < resolved_wave(topography.size, grid) * (1 - 1e-9):
        raise InputError("shape", grid, f"at least 8 pixels per shortest wave, {needed_shape}")
    measured = topography.low_pass(continuation.longest).resample(grid)
    return continuation.add_to(measured, realisation)

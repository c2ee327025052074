"""Estimate the longest waves of a surface, and how many of them fit into the measured patch.

If the spectrum has a plateau, the longest wavelength is the roll-off wavelength. If the spectrum has no plateau, the
longest wavelength is estimated as Sal/0.27: on self-affine patches that contain 3 to 5 waves of the roll-off
wavelength, Sal is 0.25 to 0.30 of the roll-off wavelength.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan, pi

import numpy as np
from numpy.typing import NDArray

from ..base import Pair, to_text
from .patches import Surface
from .power_spectrum import spectrum
from .texture import texture
from .topography import Topography

#: Number of periods of the longest wave that a patch should contain along its shorter side. On patches of self-affine
#: surfaces, the standard deviation of ln(leakage) was 0.5 with one period, 0.3 to 0.5 with three periods, 0.15 to 0.25
#: with five periods, and 0.1 to 0.15 with eight periods.
LEAST_WAVES = 3
#: Ratio of the autocorrelation length Sal of a surface to its roll-off wavelength.
_SAL_OF_WAVE = 0.27
#: The spectrum rises towards long waves if the mean density of the octave of the longest waves is more than this many
#: times the mean density of the next octave. The ratio is 1 for a plateau, and 5 to 16 for a power law.
_RISE = 3.0


@dataclass(frozen=True)
class Representative:
    """Describe how many of the longest waves of a surface fit into a patch.

    Parameters
    ----------
    longest : float
        Longest wave [m]: the roll-off wavelength, or an estimate from Sal. NaN for a flat surface.
    roll_off : float, optional
        Wavelength where the plateau of the spectrum ends [m]; None if there is no plateau.
    waves : tuple of two float
        How many of the longest waves fit into the patch along x1 and along x2.
    rises : bool
        Whether the spectral density still increases up to waves as long as the patch, so that longer waves are to be
        expected.
    octave, density : float
        Central wavelength [m] and mean spectral density [m⁴] of the octave of the longest waves.
    hurst : float
        Hurst exponent of a power law through the mean densities of the octave of the longest waves and of the next
        octave, limited to the range 0 to 1. If the spectrum rises, it is extrapolated to longer waves by this power
        law.
    """

    longest: float
    roll_off: float | None
    waves: Pair
    rises: bool
    octave: float
    density: float
    hurst: float

    @property
    def is_enough(self) -> bool:
        """Whether the patch is large enough to represent the whole surface.

        A patch is large enough if it contains several of the longest waves of the surface, or if the surface is flat.
        """
        has_few_waves = min(self.waves) < LEAST_WAVES
        return not has_few_waves and not self.rises

    def __str__(self) -> str:
        across, along = self.waves
        text = (
            f"the sides of the map are {across:.2g} and {along:.2g} times as long as the longest wave of the surface, "
            f"which is {to_text(self.longest, 'm', 3)} long"
        )
        if self.rises:
            text += "; the spectrum rises up to waves as long as the map, so that even longer waves are to be expected"
        return text

    @property
    def warnings(self) -> list[str]:
        """Warnings for the user if another patch of the same surface may leak more or less; empty otherwise."""
        if self.is_enough:
            return []
        return [
            f"{self}. Another patch of the same surface may leak more or less, by a factor of about 2 if its side is "
            f"{LEAST_WAVES} waves long and 1.3 if it is 8 waves long: measure a larger area or several patches"
        ]


def representative(patch: Surface) -> Representative:
    """Estimate the longest waves of a surface, and how many of them fit into a patch.

    The form must have been subtracted from the surface, and all points must be defined. Of several patches, the one
    that contains the fewest of its own longest waves is described. A narrow patch may have no waves in the octave of
    the longest waves or in the next octave. The spectrum of such a patch does not count as rising, and the density and
    the wavelength of an octave without waves are NaN.
    """
    if not isinstance(patch, Topography):
        descriptions = [representative(single) for single in patch.patches]
        return min(descriptions, key=lambda description: min(description.waves))
    law = spectrum(patch).law
    roll_off = law.roll_off if law and isfinite(law.roll_off) else None
    longest = roll_off or texture(patch).correlation_length / _SAL_OF_WAVE
    q, density = patch.radial_psd()
    # Number of periods of each wave on the shorter side. The octave of the longest waves has wavelengths from this side
    # to half of it.
    waves_per_side = q * min(patch.size) / (2 * pi)
    longest_octave = (waves_per_side >= 1) & (waves_per_side < 2)
    next_octave = (waves_per_side >= 2) & (waves_per_side < 4)
    octave_density = _mean_or_nan(density[longest_octave])
    next_density = _mean_or_nan(density[next_octave])
    rise = octave_density / next_density if next_density > 0 else nan
    return Representative(
        longest=longest,
        roll_off=roll_off,
        waves=(patch.size[0] / longest, patch.size[1] / longest),
        rises=roll_off is None and rise > _RISE,
        octave=2 * pi / _mean_or_nan(q[longest_octave]),
        density=octave_density,
        hurst=float(
            np.clip(0.5 * np.log2(rise) - 1, 0.0, 1.0)
        ),  # C falls by 2^(2 + 2H) in an octave
    )


def _mean_or_nan(values: NDArray) -> float:
    """Return the mean of an array, NaN if it is empty."""
    return float(values.mean()) if values.size else nan

"""State the limits of the instrument that measured a map, and find the shortest wave that it resolves.

The shortest wave that an instrument resolves follows from its tip radius or its lateral resolution. A round tip of
radius R follows a wave of amplitude a and wavelength λ if the curvature of the wave is at most the curvature of the
tip, a(2π/λ)² <= 1/R. The wavelength is then at least 2π√(aR). If a profile consists of many waves, the criterion uses
√2 times the rms curvature of the profile in place of the curvature a(2π/λ)².

Sources: Church and Takacs, Proc. SPIE 1332 (1991) 504 (tip); ISO 25178-600 (lateral period limit: the wavelength at
which the instrument shows half of the height).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from .patches import Surface
from .power_spectrum import Spectrum, spectrum
from .topography import Topography

#: Waves that the instrument does not resolve count as removed, down to the shortest resolved wave divided by this
#: ratio.
UNSEEN = 10.0


@dataclass(frozen=True)
class Instrument:
    """Describe the limits of the instrument that measured a map.

    Parameters
    ----------
    tip_radius : float, optional
        Radius of the tip [m], if it is known.
    resolution : float, optional
        Lateral period limit [m], if it is known.
    generated_wave : float, optional
        Shortest wave of a generated surface [m]. None for a measured surface.
    """

    tip_radius: float | None = None
    resolution: float | None = None
    generated_wave: float | None = None

    def spectrum(self, flat: Surface) -> Spectrum:
        """Summarise the spectrum of a map without its form.

        For a generated surface, the summary contains only the shortest generated wave.
        """
        if self.generated_wave is not None:
            return Spectrum(self.generated_wave, 0.0, None)
        return spectrum(flat)

    def shortest_wave(self, flat: Surface) -> float:
        """Return the shortest wavelength [m] of a map that the instrument resolves; 0 if the limits are unknown."""
        limits = [self.resolution or 0.0]
        if self.tip_radius is not None:
            for patch in flat.patches:
                for axis in (0, 1):
                    limits.append(_shortest_followed_wave(patch, axis, self.tip_radius))
        return max(limits)


#: An instrument whose limits are unknown.
UNKNOWN = Instrument()


def _shortest_followed_wave(flat: Topography, axis: int, radius: float) -> float:
    """Return the shortest wavelength [m] that a stylus tip follows on the profiles of a map.

    Return 0 if the tip follows all waves of the profiles.

    axis : axis along which the profiles run.
    radius : radius of the tip [m].
    """
    q, density = flat.psd(axis)
    # Mean square curvature ∫q⁴C dq/π of all waves from 0 to q, for each wave number q, (waves,). The tip follows waves
    # whose curvature, √2 times the rms curvature, is at most 1/radius.
    square_curvature = np.cumsum(q**4 * density * np.diff(q, prepend=0.0)) / pi
    not_followed = np.flatnonzero(2 * square_curvature > radius**-2)
    if not not_followed.size:
        return 0.0
    last_followed = max(not_followed[0] - 1, 1)  # q[0] = 0 is not a wave
    return float(2 * pi / q[last_followed])

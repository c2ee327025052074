"""Shortest wave that an instrument sees, from the radius of its tip or from its lateral resolution.

A round tip of radius R follows a wave of amplitude a and wavelength λ where it is blunter than the tip,
a(2π/λ)² <= 1/R, that is λ >= 2π√(aR). Of many waves the curvature of profiles counts, √2 times its rms in place of
a(2π/λ)².
Sources: Church and Takacs, Proc. SPIE 1332 (1991) 504 (tip); ISO 25178-600 (lateral period limit: the wavelength at
which the instrument shows half of the height).
"""

from dataclasses import dataclass
from math import pi

import numpy as np

from .topography import Topography

#: The longest wave that was not seen over the shortest one that counts as removed.
UNSEEN = 10.0


@dataclass(frozen=True)
class Instrument:
    """Radius of the tip and lateral period limit [m] of an instrument; None where they are not known."""

    tip_radius: float | None = None
    resolution: float | None = None

    def shortest_wave(self, flat: Topography) -> float:
        """Shortest wave [m] of a flat map that it sees; 0 where nothing is known of it, or nothing limits it."""
        found = [self.resolution or 0.0]
        if self.tip_radius is not None:
            found += [
                _followed(place, axis, self.tip_radius) for place in flat.each for axis in (0, 1)
            ]
        return max(found)


#: Nothing is known of it.
UNKNOWN = Instrument()


def _followed(flat: Topography, axis: int, radius: float) -> float:
    """Shortest wave [m] of the profiles along an axis that a tip follows; 0 where it follows all of them."""
    q, density = flat.psd(axis)
    square = np.cumsum(q**4 * density) * np.diff(q, prepend=0.0) / pi
    lost = np.flatnonzero(2 * square > radius**-2)
    return float(2 * pi / q[max(lost[0] - 1, 1)]) if lost.size else 0.0

"""Whether a patch of a face stands for a seal: how many of its longest waves it holds, and whether longer ones exist.

The longest wave is that of the roll-off, where the spectrum has a plateau; else Sal / 0.27, as measured on self-affine
patches with a roll-off, of which Sal is 0.25 to 0.30 where they hold 3 to 5 of them.
"""

from dataclasses import dataclass, replace
from math import isfinite, nan, pi

import numpy as np

from ..base import Pair, to_text
from .texture import spectrum, texture
from .topography import Topography

#: Longest waves that a patch should hold along its shorter side. Measured on patches of self-affine faces: ln(leakage)
#: scatters by 0.5 with one of them, by 0.3 to 0.5 with three, by 0.15 to 0.25 with five, by 0.1 to 0.15 with eight.
LEAST_WAVES = 3
#: Sal of a face over the wave of its roll-off.
_SAL_OF_WAVE = 0.27
#: Mean density of the octave of waves up to the shorter side over that of the octave below, from which on it rises: a
#: plateau has 1, a power law 5 to 16.
_RISE = 3.0


@dataclass(frozen=True)
class Representative:
    """What a patch holds of the longest waves of its face.

    longest : wave [m], NaN of a flat face; by Sal, unless it is the roll-off. roll_off : where a plateau ends, or None.
    waves : how many of them the patch holds along x1 and x2.
    rises : whether the spectrum rises up to the side of the patch, so that longer waves are to be expected.
    octave, density : middle of the octave of longest waves [m], and C there [m⁴]. hurst : H from that octave and the
        one below, by which the spectrum goes on to longer waves where it rises, 0 to 1.
    places : of which this is the one that holds fewest waves.
    """

    longest: float
    roll_off: float | None
    waves: Pair
    rises: bool
    octave: float
    density: float
    hurst: float
    places: int = 1

    @property
    def is_enough(self) -> bool:
        """Whether the patch by itself stands for a larger face: it is flat, or holds several of its longest waves."""
        return not min(self.waves) < LEAST_WAVES and not self.rises

    def __str__(self) -> str:
        which = (
            "the patch holds" if self.places == 1 else f"the least of {self.places} places holds"
        )
        across, along = self.waves
        origin = (
            "where its spectrum rolls off" if self.roll_off else "by its autocorrelation length"
        )
        text = f"{which} {across:.2g} × {along:.2g} of its long waves of {to_text(self.longest, 'm', 3)}, {origin}"
        return (
            f"{text}; its spectrum rises up to its side, and longer waves are not in it"
            if self.rises
            else text
        )

    @property
    def doubts(self) -> list[str]:
        """A sentence where another patch may leak otherwise."""
        scatter = ""
        if min(self.waves) < LEAST_WAVES:
            scatter = f"others leak more or less, by a factor of about 2 with {LEAST_WAVES} waves and 1.3 with 8: "
        return (
            [] if self.is_enough else [f"{self}; {scatter}measure a larger patch or several places"]
        )


def representative(patch: Topography) -> Representative:
    """Longest waves of a flat patch without undefined points; of several places those of the one that holds fewest."""
    if len(patch.each) > 1:
        least = min(map(representative, patch.each), key=lambda found: min(found.waves))
        return replace(least, places=len(patch.each))
    law = spectrum(patch).law
    roll_off = law.roll_off if law and isfinite(law.roll_off) else None
    longest = roll_off or texture(patch).correlation_length / _SAL_OF_WAVE
    q, density = patch.radial_psd()
    waves = q * min(patch.size) / (2 * pi)
    longer, shorter = ((low <= waves) & (waves < 2 * low) for low in (1, 2))
    rise = (
        density[longer].mean() / shorter_mean
        if (shorter_mean := density[shorter].mean()) > 0
        else nan
    )
    return Representative(
        longest=longest,
        roll_off=roll_off,
        waves=(patch.size[0] / longest, patch.size[1] / longest),
        rises=roll_off is None and rise > _RISE,
        octave=float(2 * pi / q[longer].mean()),
        density=float(density[longer].mean()),
        hurst=float(np.clip(0.5 * np.log2(rise) - 1, 0.0, 1.0)),
    )

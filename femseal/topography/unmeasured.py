"""Waves of a face that were not measured: shorter ones than an instrument sees, longer ones than a patch holds.

Shorter ones: the power law of the measured spectrum, continued with random phases. Symbols: C spectral density [m⁴] of
a wave vector q, L sides of the map; a wave and its conjugate have the amplitude √(C/L1 L2) each, so that
Sq² = (1/4π²)∫C d²q. Source: Jacobs, Junge, Pastewka, Surf. Topogr.: Metrol. Prop. 5 (2017) 013001 (densities, slope).

Longer ones: how many of its longest waves a patch holds, and whether longer ones exist. The longest wave is that of the
roll-off, where the spectrum has a plateau; else Sal / 0.27, as measured on self-affine patches with a roll-off, of
which Sal is 0.25 to 0.30 where they hold 3 to 5 of them.
"""

from dataclasses import dataclass
from math import exp, inf, isfinite, log1p, nan, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base import InputError, Pair, Periodic, Shape, to_text, validate
from .conditioning import resolved_wave, resolving_shape
from .generate import random_waves, wave_numbers
from .patches import Surface
from .texture import PowerLaw, spectrum, texture
from .topography import Topography


@dataclass(frozen=True)
class Continuation:
    """Continuation of a spectrum below its power law.

    law : of the measured spectrum. longest, cut_off : waves that are added [m]. rms_slope : of the waves measured, to
    `longest`. periodic : borders of the map. seed : whole numbers, of the phases.
    """

    law: PowerLaw
    longest: float
    cut_off: float
    rms_slope: float
    periodic: Periodic
    seed: tuple[int, ...]

    def added_to(self, face: Surface, realisation: int = 0, *, factor: float = 1.0) -> Surface:
        """The face with these waves, times a factor, as far as its pixels carry them.

        The seed and the realisation give the same waves on every grid. Along an axis that is not periodic they are
        even about both borders, as the map is. Realisations but the first also draw the slope of the law by its error.
        """
        rng = np.random.default_rng(
            [*self.seed, realisation + 1]
        )  # zeros at the end change nothing
        slope = -2 * self.law.hurst_error * rng.standard_normal() * (realisation > 0)
        # each of several patches has phases of its own
        patches = zip(face.patches, rng.spawn(len(face.patches)), strict=True)
        added = np.concatenate(
            [self._waves_on(patch, slope, phases) for patch, phases in patches], axis=1
        )
        return face.with_heights(face.heights + factor * added)

    def _waves_on(self, face: Topography, slope: float, rng: np.random.Generator) -> NDArray:
        """Heights (n1, n2) [m] of the waves, of a law whose slope differs by so much about the middle of its range."""
        periods = tuple(
            n if wraps else 2 * n for n, wraps in zip(face.shape, self.periodic, strict=True)
        )
        size = (periods[0] * face.spacing[0], periods[1] * face.spacing[1])
        k = wave_numbers(size, max(self.cut_off, 2 * max(face.spacing)))
        q = 2 * pi * np.hypot(k[0] / size[0], k[1] / size[1])
        middle = 2 * pi / sqrt(self.law.longest * self.law.shortest)
        density = np.where(q > 2 * pi / self.longest, self.law.at(q) * (q / middle) ** slope, 0.0)
        z = random_waves((periods[0], periods[1]), k, np.sqrt(density / (size[0] * size[1])), rng)
        for axis in (0, 1):
            if not self.periodic[axis]:
                z = (z + np.flip(z, axis)) / sqrt(2)
        return z[: face.shape[0], : face.shape[1]]

    def slope_to(self, wave: float) -> float:
        """Rms slope [-] of measured and continued waves down to a shortest one [m]."""
        return sqrt(self.rms_slope**2 + self.law.slope_power(self.longest, wave))

    def last_that_counts(self, hardness: float, modulus: float) -> float:
        """Wavelength [m] below which hardness [Pa] sets the area in contact; 0 where it never does.

        By Persson's theory contact carries E*h'/2 of mean pressure, which rises with every wave that is added until it
        is the hardness: shorter waves are flattened.
        """
        missing = (2 * hardness / modulus) ** 2 - self.rms_slope**2
        if missing <= 0:
            return self.longest
        q = 2 * pi / self.longest
        power = 2 - 2 * self.law.hurst
        folds = missing * 2 * pi / (q**4 * self.law.at(q))
        if not -1 < power * folds < inf:
            return 0.0
        return self.longest * exp(-(log1p(power * folds) / power if power else folds))

    def __str__(self) -> str:
        law, wave = self.law, to_text
        return (
            f"waves from {wave(self.longest, 'm', 3)} to {wave(self.cut_off, 'm', 3)} continue the power law "
            f"q^({-2 - 2 * law.hurst:.2f} ± {2 * law.hurst_error:.2f}) fitted from {wave(law.longest, 'm', 3)} to "
            f"{wave(law.shortest, 'm', 3)}; rms slope {self.rms_slope:.3g} of the measured, "
            f"{self.slope_to(self.cut_off):.3g} of all waves"
        )


def continuation_of(
    flat: Surface, cut_off: float, *, longest: float | None = None, rng: Any = 0
) -> Continuation:
    """How the spectrum of a flat map without undefined points goes on from where its power law ends to a cut-off.

    flat : as measured. cut_off : shortest wave [m]. rng : whole number, or several, of the phases.
    longest : wave from which on measured ones are replaced [m], if not from the end of the law.

    Raises InputError: no power law in the spectrum; a cut-off no shorter than the waves that are measured.
    """
    shortest = validate.number("continue_spectrum", cut_off, unit="m")
    law = spectrum(flat).law
    if law is None:
        expected = "a face whose spectrum follows a power law over a factor of 5 in wavelength, as measured"
        raise InputError(
            "continue_spectrum", f"{to_text(shortest, 'm')} and a face without such a law", expected
        )
    first = max(law.shortest, longest or 0.0)
    if shortest >= first:
        expected = f"less than {to_text(first, 'm', 3)}: longer waves are measured"
        raise InputError("continue_spectrum", to_text(shortest, "m"), expected)
    seeds = tuple(int(n) for n in np.atleast_1d(rng))
    return Continuation(law, first, shortest, flat.low_pass(first).rms_slope, flat.periodic, seeds)


def continue_spectrum(
    topography: Surface,
    cut_off: float,
    *,
    shape: Shape | None = None,
    rng: Any,
    realisation: int = 0,
) -> Surface:
    """A flat map on a finer grid, with the waves that its instrument does not see, down to a cut-off.

    The power law of the spectrum (see `describe_surface`) is continued from its shortest wave on with random phases,
    alike in all directions; measured waves below that one are left out.

    Parameters
    ----------
    topography : levelled, without undefined points.
    cut_off : shortest wave [m]. shape : points of the grid; 8 pixels to the cut-off unless given.
    rng : whole number, or several, from which phases are drawn. realisation : number of the draw; all but the first
        also draw the slope of the law by its error.

    Raises
    ------
    InputError : no power law in the spectrum; a cut-off no shorter than the waves that are measured, or of less than 8
        pixels of the shape.

    Examples
    --------
    >>> from femseal.topography import self_affine
    >>> face = self_affine((64, 64), (64e-6, 64e-6), hurst=0.8, rms_slope=0.05, cut_off=2.5e-6, rng=1)
    >>> continue_spectrum(face, 1e-6, rng=1).shape
    (512, 512)
    """
    found = continuation_of(topography, cut_off, rng=rng)
    grid = (
        resolving_shape(topography.size, cut_off)
        if shape is None
        else validate.grid("shape", shape)
    )
    if cut_off < resolved_wave(topography.size, grid) * (1 - 1e-9):
        raise InputError(
            "shape", grid, f"8 pixels to the cut-off, {resolving_shape(topography.size, cut_off)}"
        )
    return found.added_to(topography.low_pass(found.longest).resample(grid), realisation)


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
        """Whether the patch by itself stands for a larger face: it is flat, or holds several of its longest waves."""
        return not min(self.waves) < LEAST_WAVES and not self.rises

    def __str__(self) -> str:
        across, along = self.waves
        rises = "; its spectrum rises up to its side, and longer waves are not in it"
        return (
            f"the patch holds {across:.2g} × {along:.2g} of its long waves of "
            f"{to_text(self.longest, 'm', 3)}{rises if self.rises else ''}"
        )

    @property
    def doubts(self) -> list[str]:
        """A sentence where another patch may leak otherwise."""
        advice = (
            f"others leak more or less, by a factor of about 2 with {LEAST_WAVES} waves and 1.3 with 8: "
            "measure a larger patch or several places"
        )
        return [] if self.is_enough else [f"{self}; {advice}"]


def representative(patch: Surface) -> Representative:
    """Find the longest waves of a flat patch without undefined points; of several those of the one that holds fewest.

    Where the patch is so narrow that one of the two octaves has no waves, its spectrum does not count as rising, and
    density and middle of the octave are NaN.
    """
    if not isinstance(patch, Topography):
        return min(map(representative, patch.patches), key=lambda found: min(found.waves))
    law = spectrum(patch).law
    roll_off = law.roll_off if law and isfinite(law.roll_off) else None
    longest = roll_off or texture(patch).correlation_length / _SAL_OF_WAVE
    q, density = patch.radial_psd()
    waves = q * min(patch.size) / (2 * pi)
    longer, shorter = ((low <= waves) & (waves < 2 * low) for low in (1, 2))
    octave_density, octave_wavenumber = _mean_of(density[longer]), _mean_of(q[longer])
    shorter_density = _mean_of(density[shorter])
    rise = octave_density / shorter_density if shorter_density > 0 else nan
    return Representative(
        longest=longest,
        roll_off=roll_off,
        waves=(patch.size[0] / longest, patch.size[1] / longest),
        rises=roll_off is None and rise > _RISE,
        octave=2 * pi / octave_wavenumber,
        density=octave_density,
        hurst=float(np.clip(0.5 * np.log2(rise) - 1, 0.0, 1.0)),
    )


def _mean_of(values: NDArray) -> float:
    """Return the mean of some values, NaN of none."""
    return float(values.mean()) if values.size else nan

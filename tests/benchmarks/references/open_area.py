"""Compute the open area near full contact, and explain why Persson's theory gives 4/3 of it.

At full contact, the pressure of a Gaussian surface is Gaussian with a variance of (E*h′/2)² about p̄. Its
negative part covers ½ erfc(√2 p̄/E*h′) of the area. Persson's open area is twice this area. In a contact
without tension, a round pit with the pressure −p₀ + c r² opens like a penny-shaped crack without stress at its
edge. The radius a of the crack satisfies ∫ p r/√(a² − r²) dr = 0, so that a² = 3p₀/2c: the crack is 3/2 of the
area under tension. The open area therefore tends to 3/4 of Persson's value. Johnson, Greenwood & Higginson
found the same ratio for one wave (Int. J. Mech. Sci. 27, 1985, 383).
"""

from __future__ import annotations

import numpy as np
from scipy.special import erfc

from femseal import solve_contact

from .faces import MODULUS, SLOPE, rough

#: Loads p̄/E*h′, up to where one spot in a thousand is open.
LOADS = np.array([0.5, 1.0, 1.25, 1.5])
#: Grid, pixels per shortest wave and longest waves on a side.
VARIANTS = ((256, 8, 8), (512, 16, 8), (1024, 32, 8), (256, 16, 4), (1024, 16, 16))


def full_contact_pressure(gap0, spacing):
    """Compute the pressure that flattens a periodic gap (n1, n2) [m], as a deviation from p̄."""
    q1, q2 = (2 * np.pi * np.fft.fftfreq(n, d) for n, d in zip(gap0.shape, spacing, strict=True))
    q = np.hypot(q1[:, None], q2)
    return np.fft.ifft2(-MODULUS / 2 * q * np.fft.fft2(gap0)).real


def open_area(n, pixels, waves, seeds):
    """Compute the corrected open area, and the area under tension at full contact, as means over surfaces."""
    open_fraction, tension = np.zeros((2, len(seeds), len(LOADS)))
    for s, seed in enumerate(seeds):
        gap0, body = rough(n, pixels_per_wave=pixels, waves=waves, rng=seed)
        full = full_contact_pressure(gap0, body.spacing)
        for i, mean in enumerate(LOADS * MODULUS * SLOPE):
            tension[s, i] = np.mean(full + mean < 0)
            open_fraction[s, i] = (
                1 - solve_contact(gap0, body, pressure=mean).area_fraction_corrected
            )
    variant = {"points": n, "pixels": pixels, "waves": waves}
    open_, theory = open_fraction.mean(axis=0), erfc(np.sqrt(2) * LOADS)
    over = {"over Persson": open_ / theory, "over tension": open_ / tension.mean(axis=0)}
    return variant | over | {"tension over theory": 2 * tension.mean(axis=0) / theory}


def open_areas(variants=VARIANTS, seeds=range(6)):
    """Compute the ratios of open areas for all variants."""
    return [open_area(*variant, seeds) for variant in variants]

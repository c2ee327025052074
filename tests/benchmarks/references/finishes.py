"""Find the load at which the finish of a metal seal no longer matters.

SAE paper 650312, "Metal-to-Metal and Metal Gasketed Seals", 1965 (abstract), states: The surface finish can be
ignored if the stress is about 2.75 times the yield strength σ_y of the weaker material. With asperities
controlled in magnitude and direction, the stress may be considerably less. Extremely fine finishes without
radial asperities seal below σ_y. In femseal, asperities yield at a hardness H; in this comparison H = 2.75 σ_y.
"""

from __future__ import annotations

import numpy as np

from femseal import HalfSpace, self_affine, solve_contact, turned

from .faces import MODULUS, percolates

YIELD = 400e6
HARDNESS = 2.75 * YIELD
RMS = (0.1e-6, 0.3e-6, 1e-6, 3e-6)
LOADS = (*np.arange(1, 12) / 20, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 1.0)
KINDS = ("isotropic", "grooves along the flow", "isotropic with a scratch along the flow")
SPACING = 2e-6


def heights(kind, rms, n):
    """Generate the heights (n, n) [m] of a surface with pixels of 2 µm; the flow is along x1.

    The grooves are those of a turning tool with a feed of an eighth of the side, and with a tenth of isotropic
    roughness. The scratch is 5 rms heights deep, and 16 µm wide to 1/e on each side.
    """
    side = n * SPACING
    ends = {"roll_off": side / 8, "cut_off": 8 * SPACING}
    z = self_affine((n, n), (side, side), hurst=0.8, rms_height=1.0, rng=1, **ends).heights
    if kind == KINDS[1]:
        feed = {"pitch": side / 8, "depth": 4e-6, "depth_error": 0.2, "feed_error": 0.1}
        lay = turned((n, n), (side, side), cut_off=8 * SPACING, rng=2, **feed).heights.T
        return rms * ((lay - lay.mean()) / lay.std() + 0.1 * z)
    x = (np.arange(n) + 0.5 - n / 2) * SPACING
    scratch = 5 * np.exp(-((x / (8 * SPACING)) ** 2)) if kind == KINDS[2] else 0.0
    return rms * (z - scratch)


def closing_loads(n=256, rms=RMS):
    """Find the mean pressures divided by σ_y between which a surface closes, by kind and rms height."""
    body, ranges = HalfSpace((n, n), (SPACING, SPACING), MODULUS), {}
    for kind in KINDS:
        for height in rms:
            gap0, below = -heights(kind, height, n), 0.0
            for load in LOADS:
                pressure = min(load, 0.999) * HARDNESS
                contact = solve_contact(gap0, body, pressure=pressure, hardness=HARDNESS, rtol=1e-5)
                if not percolates(contact.gap > 0):
                    break
                below = load
            ranges[kind, height] = 2.75 * below, 2.75 * load
    return ranges

"""Maps as an instrument measures them, of rough and of grooved faces, and the memory that work on them takes."""

import tracemalloc
from math import pi

import numpy as np

from femseal.topography import Topography, self_affine


def rough_map(shape=(160, 120), **given):
    """Self-affine map of 160 × 120 µm without waves shorter than 5 µm; `given` goes to `self_affine`."""
    return self_affine(
        shape,
        (160e-6, 120e-6),
        **{"hurst": 0.8, "rms_height": 1e-6, "cut_off": 5e-6, "rng": 2} | given,
    )


def open_map(z, spacing=(1e-6, 1e-6)):
    """Map of these heights whose opposite edges do not join, as of every measured face."""
    return Topography(z, spacing, (False, False))


def grooved_heights(angle=0.0, shape=(200, 160)):
    """Grooves at right angles to (cos α, sin α) on 200 × 160 µm, the distance across them, and random numbers."""
    x1, x2 = ((np.arange(n) + 0.5) * s * 1e-6 / n for n, s in zip(shape, (200, 160), strict=True))
    s = x1[:, None] * np.cos(angle) + x2 * np.sin(angle)
    rng = np.random.default_rng(3)
    waves = 7 * rng.random(4), (14e-6, 19e-6, 23e-6, 31e-6)
    z = sum(1e-7 * np.cos(2 * pi * s / wave + phase) for phase, wave in zip(*waves, strict=True))
    return z + 1e-9 * rng.standard_normal(shape), s, rng


def most_memory(work):
    """Largest memory [byte] that a function takes beyond the memory before."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()

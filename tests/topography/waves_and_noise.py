"""Maps with closed forms, which are waves, and maps of white noise, all of one size."""

import numpy as np

from femseal.topography import Topography

#: Sides of the maps [m].
SIZE = (3e-3, 2e-3)


def pixel_centres(shape, size=SIZE):
    """Coordinates of the centres of the pixels along each axis."""
    return [(np.arange(n) + 0.5) * length / n for n, length in zip(shape, size, strict=True)]


def standing_wave(shape, k, periodic, size=SIZE, phase=(0.3, -0.7)):
    """A product of waves of number k: cos(2πkx/L + phase) on periodic axes, cos(πkx/L) on mirror axes."""
    factors = [
        np.cos(2 * np.pi * kk * x / length + p) if wraps else np.cos(np.pi * kk * x / length)
        for x, kk, length, wraps, p in zip(
            pixel_centres(shape, size), k, size, periodic, phase, strict=True
        )
    ]
    return Topography(np.outer(*factors), (size[0] / shape[0], size[1] / shape[1]), periodic)


def white_noise(shape, periodic=(True, True), seed=0):
    """Normal random heights, each pixel independent of all others."""
    spacing = (SIZE[0] / shape[0], SIZE[1] / shape[1])
    return Topography(np.random.default_rng(seed).standard_normal(shape), spacing, periodic)

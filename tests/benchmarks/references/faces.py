"""The periodic self-affine faces on which femseal is compared with others."""

from __future__ import annotations

MODULUS = 115e9
SLOPE = 0.2


def rough(n, *, pixels_per_wave=8, waves=8, hurst=0.8, rng=1):
    """Undeformed gap (n, n) [m] of a periodic self-affine face of pixels of 1 µm, and its half-space."""
    from femseal import HalfSpace, self_affine

    size, spacing = n * 1e-6, 1e-6
    face = self_affine(
        (n, n),
        (size, size),
        hurst=hurst,
        rms_slope=SLOPE,
        roll_off=size / waves,
        cut_off=pixels_per_wave * spacing,
        rng=rng,
    )
    return -face.heights, HalfSpace((n, n), (spacing, spacing), MODULUS)

"""The periodic self-affine faces on which femseal is compared with others."""

from __future__ import annotations

from femseal import HalfSpace, self_affine

MODULUS = 115e9
SLOPE = 0.2


def rough(n, *, pixels_per_wave=8, waves=8, rng=1):
    """Undeformed gap (n, n) [m] of a face with pixels of 1 µm, and its half-space."""
    size, spacing = n * 1e-6, 1e-6
    ends = {"roll_off": size / waves, "cut_off": pixels_per_wave * spacing}
    face = self_affine((n, n), (size, size), hurst=0.8, rms_slope=SLOPE, rng=rng, **ends)
    return -face.heights, HalfSpace((n, n), (spacing, spacing), MODULUS)

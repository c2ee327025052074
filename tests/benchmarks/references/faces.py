"""Generate the periodic self-affine surfaces on which femseal is compared with other programs."""

from __future__ import annotations

import numpy as np

from femseal import HalfSpace, self_affine
from femseal.flow.percolation import nodes_reached

MODULUS = 115e9
SLOPE = 0.2


def rough(n, *, pixels_per_wave=8, waves=8, rng=1):
    """Return the undeformed gap (n, n) [m] of a surface with pixels of 1 µm, and its half-space."""
    size, spacing = n * 1e-6, 1e-6
    ends = {"roll_off": size / waves, "cut_off": pixels_per_wave * spacing}
    face = self_affine((n, n), (size, size), hurst=0.8, rms_slope=SLOPE, rng=rng, **ends)
    return -face.heights, HalfSpace((n, n), (spacing, spacing), MODULUS)


def percolates(is_open):
    """Return whether open pixels (n1, n2), periodic along x2, connect the ends of x1 over common sides."""
    open_ = np.pad(is_open, ((1, 1), (0, 0)), mode="edge")
    along, across = open_[:-1] & open_[1:], is_open & np.roll(is_open, -1, axis=1)
    return bool(nodes_reached(along.astype(float), across.astype(float))[0, 0] == 3)

"""Patches that are measured on larger faces."""

import femseal as fs

#: Points along a side of a patch, their distance, and the side [m].
N, D = 192, 1e-6
SIDE = N * D


def patch_of_larger_face(seed=1, roll_off=SIDE / 8, cut_off=8 * D, n=N):
    """A patch of a larger face: it is not periodic, and has lost its tilt."""
    waves = {"rms_slope": 0.05, "roll_off": roll_off, "cut_off": cut_off, "rng": seed}
    larger = fs.self_affine((2 * n, 2 * n), (2 * n * D, 2 * n * D), hurst=0.8, **waves)
    return larger.crop((n, n)).detrend(1)

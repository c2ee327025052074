"""Compute the contact area at which an elastic isotropic surface closes, and how its flow vanishes.

Dapp, Lücke, Persson & Müser, Phys. Rev. Lett. 108, 2012, 244301; Dapp & Müser, Sci. Rep. 6, 2016, 19513; Wang &
Müser, Tribol. Lett. 69, 2021, 1. The side of a surface is `waves` times its longest wave (the roll-off), its
shortest wave is `range_` times shorter than its longest wave, and it has `pixels` pixels per shortest wave.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from femseal import HalfSpace, cell_permeability, self_affine, solve_contact

from .faces import MODULUS, SLOPE, percolates

CLAIMED = 0.415
#: Longest waves on a side, and number of faces of each.
SIZES = ((1, 80), (2, 80), (4, 80), (8, 48), (16, 24))
#: The spanning area of percolating systems differs by their size to −1/ν, ν = 4/3.
EXPONENT = -0.75


def bisected(is_open, low, high, steps):
    """Return the last value at which a surface is open, and the first value at which it is closed, by bisection."""
    for _ in range(steps):
        middle = (low + high) / 2
        low, high = (middle, high) if is_open(middle) else (low, middle)
    return low, high


class Face:
    """An elastic surface, its contacts by the load p̄/E*h′, and the loads at which it closes along each axis."""

    def __init__(self, waves, pixels=8, range_=8, rng=0):
        n, side = waves * range_ * pixels, 1e-3
        ends = {"roll_off": side / waves, "cut_off": side / waves / range_}
        face = self_affine((n, n), (side, side), hurst=0.8, rms_slope=SLOPE, rng=rng, **ends)
        self.gap0, self.spacing = -face.heights, face.spacing
        self.body = HalfSpace((n, n), face.spacing, MODULUS)
        self.state = cache(self._state)

    def contact(self, load, rtol):
        """Solve the contact at a load."""
        return solve_contact(self.gap0, self.body, pressure=load * MODULUS * SLOPE, rtol=rtol)

    def _state(self, load):
        """Return whether the surface is open along x1 and along x2, and its corrected contact area, at a load."""
        contact = self.contact(load, 1e-5)
        is_open = contact.pressure == 0
        ways = (percolates(way) for way in (is_open, is_open.T))
        return *ways, contact.area_fraction_corrected

    def closing(self, axis, steps=8):
        """Return the load and the corrected contact area at which the flow along an axis ends."""
        ends = bisected(lambda load: self.state(load)[axis], 0.1, 0.5, steps)
        return np.mean(ends), np.mean([self.state(load)[2] for load in ends])

    def permeability(self, load):
        """Compute the permeability along x1 [m³] at a load."""
        gap = self.contact(load, 1e-7).gap
        return cell_permeability(gap, self.spacing, sides="periodic").value


def closing_areas(waves, faces, **options):
    """Compute the contact areas at which several surfaces close along x1 and x2, (surface, axis)."""
    made = (Face(waves, rng=seed, **options) for seed in range(faces))
    return np.array([[face.closing(axis)[1] for axis in (0, 1)] for face in made])


def truncated_areas(waves, faces):
    """Compute the fractions cut off at which the undeformed surfaces close along x1 and x2, (surface, axis)."""

    def closing(gap):
        """Return the fraction cut off at which a gap closes along x1."""
        return bisected(lambda cut: percolates(gap > np.quantile(gap, cut)), 0.1, 0.9, 10)[0]

    gaps = (Face(waves, rng=seed).gap0 for seed in range(faces))
    return np.array([[closing(gap), closing(gap.T)] for gap in gaps])


def critical_area(sizes=SIZES):
    """Compute the closing areas by size, and extrapolate them to an infinite surface by a + b·waves^(−3/4).

    For the standard error, the mean over both axes of a surface is one sample. The standard error of a median
    is 1.25 times that of a mean. The error of the extrapolated area follows from these standard errors alone. It does
    not contain the deviations of the medians from the straight line, which may be larger.
    """
    waves, faces = np.array(sizes).T
    areas_by_size = [closing_areas(*size) for size in sizes]
    error = [1.25 * a.mean(axis=1).std(ddof=1) / np.sqrt(len(a)) for a in areas_by_size]
    median = [np.median(areas) for areas in areas_by_size]
    x = waves**EXPONENT
    (_, area), covariance = np.polyfit(x, median, 1, w=1 / np.array(error), cov="unscaled")
    spread = [areas.std() for areas in areas_by_size]
    columns = {
        "waves": waves,
        "faces": faces,
        "median": median,
        "spread": spread,
        "standard error": error,
    }
    return columns | {"extrapolated": area, "error": float(np.sqrt(covariance[1, 1]))}


def resolution(pixels=(4, 8, 16), faces=12, waves=4):
    """Compute the mean closing area of the same surfaces on finer and finer pixels."""
    return {p: closing_areas(waves, faces, pixels=p).mean() for p in pixels}


#: Distances (p_c − p)/p_c from the load that closes a face.
DISTANCES = (0.025, 0.0125, 0.006, 0.003)


def flow_near_closing(faces=6, waves=2, pixels=256):
    """Compute the exponents of the permeability against the distance to the closing load of each surface."""
    exponents = []
    for seed in range(faces):
        face = Face(waves, pixels=pixels, range_=2, rng=seed)
        load, _ = face.closing(0, steps=14)
        k = [face.permeability(load * (1 - d)) for d in DISTANCES]
        exponents.append(np.polyfit(np.log(DISTANCES), np.log(k), 1)[0])
    return {"exponents": exponents, "median": np.median(exponents)}

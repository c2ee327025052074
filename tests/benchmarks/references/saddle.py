"""Compute how the resistance of a saddle point diverges as (L_c − L)^−3.45 (Dapp & Müser, EPL 109, 2015)."""

from __future__ import annotations

import numpy as np

from femseal import HalfSpace, cell_permeability, solve_contact

from .faces import MODULUS


class Saddle:
    """A quarter of the wave 2 − cos − cos, with crest and valley at opposite corners and saddle points between them.

    All sides are mirrored. The flow along x1 passes one saddle point; the cell closes when this saddle point
    closes.
    """

    def __init__(self, n, wavelength=1e-4, amplitude=2e-6):
        self.spacing = (wavelength / 2 / n,) * 2
        wave = 1 - np.cos((np.arange(n) + 0.5) / n * np.pi)
        self.gap0 = amplitude * (wave[:, None] + wave)
        self.body = HalfSpace((n, n), self.spacing, MODULUS, ("mirror", "mirror"))
        self.scale = np.pi * MODULUS * amplitude / wavelength

    def permeability(self, load):
        """Compute the permeability [m³] at a load, divided by πE*A/λ."""
        contact = solve_contact(self.gap0, self.body, pressure=load * self.scale, rtol=1e-9)
        return cell_permeability(contact.gap, self.spacing, rtol=1e-9).value

    def closing_load(self, low, high, rtol):
        """Find the load L_c at which the gap stops percolating, by bisection between two loads."""
        while high / low - 1 > rtol:
            middle = (low + high) / 2
            low, high = (middle, high) if self.permeability(middle) > 0 else (low, middle)
        return low


def saddle_point(n=1024, nearest=1e-3, decades=2.0, points=13):
    """Compute the exponent of the conductance over two decades of the distance (L_c − L)/L_c to closing.

    The load L_c is that of the grid; it is bracketed on 128² points. "all" is the slope of a straight line
    through all points, "nearest" through the half of the points that is nearest to closing, and "corrected" is
    β in ln k = a + β ln ε + b ε with the distance ε.
    """
    coarse = Saddle(128).closing_load(0.2, 1.0, 1e-4)
    saddle = Saddle(n)
    closing = saddle.closing_load(0.998 * coarse, 1.002 * coarse, 1e-6)
    distance = np.geomspace(nearest * 10**decades, nearest, points)
    x, half = np.log(distance), points // 2
    y = np.log([saddle.permeability(closing * (1 - e)) for e in distance])
    corrected = np.linalg.lstsq(np.c_[np.ones_like(x), x, distance], y, rcond=None)[0]
    nearest_one = np.polyfit(x[half:], y[half:], 1)[0]
    return {"all": np.polyfit(x, y, 1)[0], "nearest": nearest_one, "corrected": corrected[1]}

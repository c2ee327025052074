"""The resistance of a saddle point diverges as (L_c − L)^−3.45: Dapp & Müser, EPL 109, 2015, 44001."""

from __future__ import annotations

import numpy as np

from .faces import MODULUS


class Saddle:
    """A quarter of the wave 2 − cos − cos: crest and valley at opposite corners, saddle points at the other two.

    Mirrored on all sides; the flow along x1 passes one saddle point, whose closing closes the cell.
    """

    def __init__(self, n, wavelength=1e-4, amplitude=2e-6):
        from femseal import HalfSpace

        self.spacing = (wavelength / 2 / n,) * 2
        wave = 1 - np.cos((np.arange(n) + 0.5) / n * np.pi)
        self.gap0 = amplitude * (wave[:, None] + wave)
        self.body = HalfSpace((n, n), self.spacing, MODULUS, ("mirror", "mirror"))
        self.scale = np.pi * MODULUS * amplitude / wavelength

    def contact(self, load):
        from femseal import solve_contact

        return solve_contact(self.gap0, self.body, pressure=load * self.scale, rtol=1e-9)

    def permeability(self, load):
        from femseal import cell_permeability

        return cell_permeability(self.contact(load).gap, self.spacing, rtol=1e-9).value

    def closing_load(self, low, high, rtol):
        """Load L_c over πE*A/λ at which the gap stops percolating, by bisection between two loads."""
        while high / low - 1 > rtol:
            middle = (low + high) / 2
            low, high = (middle, high) if self.permeability(middle) > 0 else (low, middle)
        return low


def saddle_point(n=1024, nearest=1e-3, decades=2.0, points=13, rtol=1e-6):
    """Resistance 1/k of a cell over two decades of distance (L_c − L)/L_c to the load that closes it.

    L_c is that of the grid, bracketed on one of 128². `exponent` is that of the straight line through all points,
    `nearest_exponent` through the last half of them, `corrected_exponent` with the first correction,
    ln k = a + β ln ε + b ε.
    """
    coarse = Saddle(128).closing_load(0.2, 1.0, 1e-4)
    saddle = Saddle(n)
    closing = saddle.closing_load(0.998 * coarse, 1.002 * coarse, rtol)
    distance = np.geomspace(nearest * 10**decades, nearest, points)
    k = np.array([saddle.permeability(closing * (1 - e)) for e in distance])
    x, y = np.log(distance), np.log(k)
    ones = np.ones_like(x)
    half = points // 2
    return {
        "n": n,
        "closing": closing,
        "closing_area": saddle.contact(closing).area_fraction,
        "distance": distance,
        "resistance": k.max() / k,
        "exponent": float(np.polyfit(x, y, 1)[0]),
        "nearest_exponent": float(np.polyfit(x[half:], y[half:], 1)[0]),
        "corrected_exponent": float(np.linalg.lstsq(np.c_[ones, x, distance], y, rcond=None)[0][1]),
    }


def draw(record, ax):
    distance, resistance = record["distance"], record["resistance"]
    ax.loglog(distance, resistance, "o", label=f"femseal, {record['n']}²")
    ax.loglog(distance, resistance[-1] * (distance / distance[-1]) ** -3.45, "k--", lw=1, label="slope −3.45")
    ax.set(xlabel="$(L_c - L)/L_c$", ylabel="resistance / least resistance", title="saddle point near closing")
    ax.legend()


def line(record):
    far, near = record["distance"][[0, -1]]
    return [
        "Resistance of a saddle point ∝ (L_c − L)^−3.45 near closing",
        "Dapp & Müser, EPL 109, 2015, 44001",
        f"exponent {record['exponent']:.3f} over (L_c − L)/L_c = {far:.2g} … {near:.2g}, "
        f"{record['nearest_exponent']:.3f} over the nearer decade, {record['corrected_exponent']:.3f} over both with "
        f"the first correction, on {record['n']}²",
    ]

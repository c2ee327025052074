"""Elastic contact of a wave
=========================

This script computes the contact fraction of a sinusoidal wave on a grid of 128 points, and compares it with the closed
form of Westergaard.
"""

from __future__ import annotations

import numpy as np

import femseal as fs

MODULUS, HALF_HEIGHT, WAVELENGTH = 115e9, 1e-6, 100e-6
POINTS = 128


def contact_shares(ratios: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the contact fraction numerically and in closed form.

    The argument `ratios` contains the mean pressures, divided by the mean pressure at which the contact is complete.
    """
    spacing = WAVELENGTH / POINTS
    x = (np.arange(POINTS) + 0.5) * spacing
    gap = HALF_HEIGHT * (1 - np.cos(2 * np.pi * x / WAVELENGTH))[:, None] * np.ones((1, 4))
    body = fs.HalfSpace(gap.shape, (spacing, spacing), MODULUS)
    full = fs.analytic.wave_full_contact_pressure(MODULUS, HALF_HEIGHT, WAVELENGTH)
    solved = [
        fs.solve_contact(gap, body, pressure=r * full, rtol=1e-8).area_fraction for r in ratios
    ]
    return np.array(solved), fs.analytic.wave_contact_fraction(ratios)


if __name__ == "__main__":
    import matplotlib.pyplot as plt

    ratios = np.linspace(0.05, 0.95, 19)
    solved, exact = contact_shares(ratios)
    print(f"largest difference: {np.abs(solved - exact).max() * POINTS:.2f} pixels of {POINTS}")
    plt.plot(ratios, exact, "-", label="Westergaard")
    plt.plot(ratios, solved, "o", label=f"{POINTS} points")
    plt.xlabel("mean pressure / pressure of full contact")
    plt.ylabel("share in contact")
    plt.legend()
    plt.show()

"""A lens ring
===========

The crown of a turned ring is pressed against a cone. The radius of the crown determines the width of the contact band,
and therefore the leakage under a given force. On a rough crown, the contact band is wider than on a smooth crown. For a
smooth crown, Hertz's theory gives the width.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import femseal as fs
from femseal.topography import CrownedSeat

RADII = (0.2, 0.05, 0.01)
FORCES = np.array([20e3, 50e3, 100e3, 200e3])


def lens_rings() -> dict[float, fs.FaceResult]:
    """Solve the contact and the flow for crowns of several radii [m] under forces of 20 to 200 N/mm."""
    turned = fs.turned(
        (512, 128),
        (1.024e-3, 0.256e-3),
        pitch=64e-6,
        depth=1.2e-6,
        roughness=0.3e-6,
        roughness_roll_off=36e-6,
        rng=6,
    )
    scene = fs.Scene(
        turned,
        fs.contact_modulus(fs.Solid(210e9, 0.3), fs.Solid(210e9, 0.3)),
        fs.Solid(210e9, 0.3, yield_stress=1e9).hardness,
        fs.Liquid(1e-3),
        inlet_pressure=10e6,
        outlet_pressure=0.0,
        loading=tuple(FORCES / turned.size[0]),
    )
    return {
        radius: fs.deterministic(replace(scene, surface=CrownedSeat(radius).add_to(turned)))
        for radius in RADII
    }


def hertz_band(radius: float, force: float) -> float:
    """Compute the width [m] of the contact band of a smooth crown under a force W per length, 2 √(4 W R/(π E*))."""
    modulus = fs.contact_modulus(fs.Solid(210e9, 0.3), fs.Solid(210e9, 0.3))
    return float(2 * np.sqrt(4 * force * radius / (np.pi * modulus)))


if __name__ == "__main__":
    import matplotlib.pyplot as plt

    rings = lens_rings()
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for radius, ring in rings.items():
        for force, band, leakage in zip(FORCES, ring.band_breadth, ring.leakage, strict=True):
            print(
                f"R = {1e3 * radius:3.0f} mm, {force / 1e3:3.0f} N/mm: band {1e3 * band:.2f} mm "
                f"(smooth {1e3 * hertz_band(radius, force):.2f}), leakage {1e6 * leakage:.3g} mL/(m·s)"
            )
        x = (np.arange(ring.row_pressure.shape[1]) + 0.5) * 2e-3
        left.plot(x, ring.row_pressure[2] / 1e9, label=f"R = {1e3 * radius:.0f} mm")
        right.loglog(FORCES / 1e3, 1e6 * ring.leakage, "o-", label=f"R = {1e3 * radius:.0f} mm")
    left.set(xlabel="x1 from the inlet [mm]", ylabel="contact pressure of rows at 100 N/mm [GPa]")
    right.set(xlabel="force per length [N/mm]", ylabel="leakage [mL/(m·s)]")
    left.legend()
    right.legend()
    plt.show()

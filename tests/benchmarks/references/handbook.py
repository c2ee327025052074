"""Compute how the leakage of turned and ground surfaces depends on pressure, hardness and finish.

The exponents are compared with the Handbook of Reliability Prediction Procedures for Mechanical Equipment
(Naval Surface Warfare Center, NSWC-11, chapter 3), which derives the failure rate of static seals from their
leakage. In the handbook, the leakage is proportional to (M/C)^4.3 with the hardness M and the contact stress C,
and to f^1.65 with the surface finish f from 15 µin (0.38 µm) on. Here these exponents are computed as
differences over ±10 % of pressure and heights. The exponent of the hardness H follows from the scaling law
k(αa, αH, αp) = α³ k(a, H, p) of the permeability k, with the amplitude a of the heights.
"""

from __future__ import annotations

import numpy as np

from femseal import HalfSpace, Topography, cell_permeability, self_affine, solve_contact, turned

from .faces import MODULUS

HARDNESS = 2.8e9
#: Exponents of the handbook: of hardness over contact stress, and of the finish.
CLAIMED = {"pressure": 4.3, "hardness": 4.3, "finish": 1.65}
#: Rms heights [m] and pressures over the hardness.
RMS = (0.25e-6, 0.5e-6, 1e-6, 2e-6)
LOADS = (0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3)
#: Distance between marks, and factor by which a ground face is longer along its lay.
PITCH, STRETCH = 60e-6, 5.0
STEP = 1.1


def face(kind: str, n: int, seed: int) -> Topography:
    """Generate a surface of n² points with eight marks along x1 and an rms height of 1 m; its lay is along x2."""
    side = 8 * PITCH
    if kind == "turned":
        feed = {"pitch": PITCH, "depth": 2.5e-6, "feed_error": 0.03, "depth_error": 0.1}
        rough = {"roughness": 0.8e-6, "roughness_roll_off": 0.6 * PITCH}
        made = turned((n, n), (side, side), cut_off=PITCH / 4, rng=seed, **feed, **rough)
        spacing = made.spacing
    else:
        ends = {"roll_off": PITCH, "cut_off": PITCH / 4}
        made = self_affine((n, n), (side, side), hurst=0.8, rms_height=1e-6, rng=seed, **ends)
        spacing = (made.spacing[0], STRETCH * made.spacing[1])
    heights = made.heights - made.heights.mean()
    return Topography(heights / heights.std(), spacing, (True, True))


def log_permeability(surface: Topography, rms: float, pressure: float) -> float:
    """Compute ln k [m³] across the lay of a surface under a nominal pressure [Pa]; −inf if the surface is sealed."""
    body = HalfSpace(surface.shape, surface.spacing, MODULUS)
    gap0 = rms * (surface.heights.max() - surface.heights)
    contact = solve_contact(gap0, body, pressure=pressure, hardness=HARDNESS, rtol=1e-6)
    permeability = cell_permeability(contact.gap, surface.spacing, axis=0, sides="periodic")
    with np.errstate(divide="ignore"):
        return float(np.log(permeability.value))


def exponents(surface: Topography, rms: float, load: float) -> dict[str, float]:
    """Compute the exponents of pressure (with its sign changed), hardness and finish; NaN if the surface is sealed."""
    pressure = load * HARDNESS
    step = 2 * np.log(STEP)
    with np.errstate(invalid="ignore"):
        low = log_permeability(surface, rms, pressure / STEP)
        by_pressure = (log_permeability(surface, rms, pressure * STEP) - low) / step
        flatter = log_permeability(surface, rms / STEP, pressure)
        by_finish = (log_permeability(surface, rms * STEP, pressure) - flatter) / step
    if not (np.isfinite(by_pressure) and np.isfinite(by_finish)):
        return dict.fromkeys(CLAIMED, np.nan)
    by_hardness = 3 - by_pressure - by_finish
    return {"pressure": -by_pressure, "hardness": by_hardness, "finish": by_finish}


def handbook_exponents(n=256, seeds=(1, 2, 3), rms=RMS, loads=LOADS):
    """Compute the exponents by kind of surface and load, as means over the seeds.

    Each exponent is an array over the rms heights.
    """
    means = {}
    for kind in ("turned", "ground"):
        surfaces = [face(kind, n, seed) for seed in seeds]
        for load in loads:
            records = [[exponents(s, height, load) for s in surfaces] for height in rms]
            means[kind, load] = {
                name: np.array([np.mean([r[name] for r in row]) for row in records])
                for name in CLAIMED
            }
    return means


def range_text(values) -> str:
    """Write the smallest and the largest of the known values, or "sealed" if there are none."""
    known = values[np.isfinite(values)]
    if not known.size:
        return "sealed"
    low, high = f"{known.min():.2g}", f"{known.max():.2g}"
    text = low if low == high else f"{low} to {high}"
    return text if known.size == values.size else f"{text} ({values.size - known.size} sealed)"

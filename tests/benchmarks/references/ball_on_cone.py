"""Steel ball on a steel cone: what plastic deformation of the asperities changes in the leakage.

Fischer, Schmitz, Tiwari & Persson, Tribol. Lett. 68, 2020, number 4 (arXiv 2007.13576): their theory predicts a
leakage about eight times lower than without plastic deformation. Only the abstract was at hand, not their roughness,
load and hardness: what is below is a seat of the same kind, and the comparison is one of order of magnitude.
"""

from __future__ import annotations

import numpy as np

from .faces import MODULUS

RADIUS = 20e-3
HARDNESS = 2.5e9
RMS = 1e-6
#: Peak pressures of the smooth line contact [Pa].
PEAKS = (0.1e9, 0.2e9, 0.4e9, 0.6e9, 0.8e9, 0.9e9, 1e9, 1.1e9)


def leakage_of_seat(shape=(768, 256), spacing=1.5e-6, peaks=PEAKS, seeds=(1, 2, 3)):
    """Leakage per length of the line of contact, pressure drop and 1/viscosity [m²], elastic and plastic, by peak pressure.

    A ball of 20 mm radius touches the cone along a circle, locally a cylinder on a plane: free across the contact,
    periodic along it. Roughness is self-affine, rolls off at 0.1 mm and is cut off at 8 pixels.
    """
    from femseal import HalfSpace, cell_permeability, self_affine, solve_contact

    across, along = np.multiply(shape, spacing)
    x = ((np.arange(shape[0]) + 0.5) * spacing - across / 2)[:, None]
    body = HalfSpace(shape, (spacing, spacing), MODULUS, ("free", "periodic"))
    leakage = np.zeros((2, len(seeds), len(peaks)))
    plastic = np.zeros(leakage.shape[1:])
    slopes = []
    for s, seed in enumerate(seeds):
        face = self_affine(
            shape, (across, along), hurst=0.8, rms_height=RMS, roll_off=1e-4, cut_off=8 * spacing, rng=seed
        )
        slopes.append(face.rms_slope)
        for i, peak in enumerate(peaks):
            half_width = 2 * peak * RADIUS / MODULUS
            pressure = np.pi * half_width * peak / 2 / across
            for j, hardness in enumerate((np.inf, HARDNESS)):
                contact = solve_contact(
                    x**2 / (2 * RADIUS) - face.heights, body, pressure=pressure, hardness=hardness, rtol=1e-5
                )
                k = cell_permeability(contact.gap, body.spacing, sides="periodic", rtol=1e-4).value
                leakage[j, s, i] = k / across
            plastic[s, i] = contact.plastic_fraction / contact.area_fraction
    return {
        "peak": np.array(peaks),
        "line_load": np.pi * np.array(peaks) ** 2 * RADIUS / MODULUS,
        "elastic": leakage[0],
        "plastic": leakage[1],
        "plastic_share": plastic.mean(axis=0),
        "slope": float(np.mean(slopes)),
    }


def factors(record):
    """Elastic over plastic leakage, median over faces, inf where the plastic one is closed."""
    with np.errstate(divide="ignore"):
        return np.median(record["elastic"] / record["plastic"], axis=0)


def draw(record, ax):
    x = record["line_load"] / 1e3
    for name, color in (("elastic", "C0"), ("plastic", "C1")):
        for s, values in enumerate(record[name]):
            label = {"elastic": "elastic", "plastic": f"H = {HARDNESS / 1e9:g} GPa"}[name] if s == 0 else None
            ax.loglog(x[values > 0], values[values > 0], f"{color}o-", ms=3, label=label)
    ax.set(
        xlabel="load per length of contact [kN/m]",
        ylabel="leakage × viscosity / (length × drop) [m²]",
        title="ball on a cone",
    )
    ax.legend()


def line(record):
    found = ", ".join(
        f"{f:.3g} at {load / 1e3:.3g} kN/m" for f, load in zip(factors(record), record["line_load"], strict=True)
    )
    return [
        "Plastic deformation cuts the leakage of a steel ball on a conical seat about eightfold",
        "Fischer, Schmitz, Tiwari & Persson, Tribol. Lett. 68, 2020, no. 4 (abstract)",
        f"elastic over plastic leakage, median of {len(record['elastic'])} faces of {RMS * 1e6:g} µm rms, slope "
        f"{record['slope']:.2f}, H = {HARDNESS / 1e9:g} GPa: {found}. Order of magnitude only: their seat is not known",
    ]

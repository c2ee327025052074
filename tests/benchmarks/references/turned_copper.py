"""At what load radial leakage of turned copper ends: Matsuzaki and co-workers found about 50 MPa on gaskets.

Their faces are known only roughly, so that pitch, depth and hardness go over ranges, with fine roughness on the ridges. The
load is that at which no open path is left across the grooves, by bisection; the grooves themselves are still open.
"""

from __future__ import annotations

from femseal import HalfSpace, named_solid, solve_contact, turned
from femseal.flow.percolation import percolates

D = 1.5e-6
CLAIMED = 50e6


def closing_load(pitch, depth, hardness, modulus, n=(256, 256), seed=1):
    """Nominal pressure [Pa] from which a turned face has no open path across its grooves."""
    face = turned(n, (n[0] * D, n[1] * D), pitch=pitch, depth=depth, feed_error=0.03, depth_error=0.1, roughness=0.05 * depth,
                  roughness_roll_off=24 * D, cut_off=8 * D, rng=seed)  # fmt: skip
    body = HalfSpace(n, (D, D), modulus)
    low, high = 1e-3 * hardness, 0.9 * hardness
    while high / low > 1.05:
        middle = (low * high) ** 0.5
        gap = solve_contact(face.heights.max() - face.heights, body, pressure=middle, hardness=hardness, rtol=1e-4).gap
        low, high = (middle, high) if percolates(gap > 0) else (low, middle)
    return (low * high) ** 0.5


def turned_copper(
    pitches=(48e-6, 96e-6, 192e-6), depths=(1e-6, 3e-6, 10e-6), names=("copper, soft", "copper, half hard")
):
    """Closing loads by hardness, pitch and depth."""
    found = []
    for name in names:
        solid = named_solid(name)
        modulus = solid.young / (1 - solid.poisson**2)
        for pitch in pitches:
            for depth in depths:
                load = closing_load(pitch, depth, solid.hardness, modulus)
                found.append({"name": name, "pitch": pitch, "depth": depth, "hardness": solid.hardness, "load": load})
    return found


def line(found):
    """Line of the table."""
    texts = []
    for name in dict.fromkeys(one["name"] for one in found):
        loads = [one["load"] / 1e6 for one in found if one["name"] == name]
        hardness = next(one["hardness"] for one in found if one["name"] == name)
        texts.append(f"{name} of {hardness / 1e6:.0f} MPa hardness: {min(loads):.0f} to {max(loads):.0f} MPa")
    depths, pitches = ({1e6 * one[key] for one in found} for key in ("depth", "pitch"))
    ranges = f"pitch {min(pitches):.0f} to {max(pitches):.0f} µm, depth {min(depths):.0f} to {max(depths):.0f} µm"
    return ["radial leakage of turned copper gaskets ends near 50 MPa, that along the groove remains",
            "Matsuzaki and co-workers 2006, 2013", f"{ranges}: {'; '.join(texts)}"]  # fmt: skip

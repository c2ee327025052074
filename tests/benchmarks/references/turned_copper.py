"""Find the load at which the radial leakage of turned copper ends; Matsuzaki and co-workers found about 50 MPa.

The real surfaces are known only roughly. Pitch, depth and hardness are therefore varied, with fine roughness on
the ridges. The load is found by bisection: above it, no open path leads across the grooves. The grooves
themselves are still open.
"""

from __future__ import annotations

from dataclasses import replace

from femseal import HalfSpace, named_solid, solve_contact, turned
from femseal.materials import HARDNESS_FACTOR

from .faces import percolates

D, POINTS = 1.5e-6, (256, 256)
CLAIMED = 50e6
NAMES = ("copper, soft", "copper, half hard")


def closing_load(pitch, depth, solid):
    """Find the nominal pressure [Pa] from which on a turned surface has no open path across its grooves."""
    rough = {"roughness": 0.05 * depth, "roughness_roll_off": 24 * D, "cut_off": 8 * D, "rng": 1}
    feed = {"pitch": pitch, "depth": depth, "feed_error": 0.03, "depth_error": 0.1}
    face = turned(POINTS, tuple(n * D for n in POINTS), **feed, **rough)
    body = HalfSpace(POINTS, (D, D), solid.young / (1 - solid.poisson**2))
    low, high = 1e-3 * solid.hardness, 0.9 * solid.hardness
    while high / low > 1.05:
        middle = (low * high) ** 0.5
        load = {"pressure": middle, "hardness": solid.hardness}
        gap = solve_contact(face.heights.max() - face.heights, body, rtol=1e-4, **load).gap
        low, high = (middle, high) if percolates(gap > 0) else (low, middle)
    return (low * high) ** 0.5


def turned_copper(pitches=(48e-6, 96e-6, 192e-6), depths=(1e-6, 3e-6, 10e-6)):
    """Compute the range of the closing loads [Pa] over pitches and depths, by metal."""
    ranges = {}
    for name in NAMES:
        # as if the metal did not harden under an indenter
        solid = replace(named_solid(name), hardness=None, hardness_over_yield=HARDNESS_FACTOR)
        loads = [closing_load(pitch, depth, solid) for pitch in pitches for depth in depths]
        ranges[name] = min(loads), max(loads)
    return ranges

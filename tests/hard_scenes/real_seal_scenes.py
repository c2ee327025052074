"""Hard scenes of real seals: a spiral groove, a seat that is tilted."""

from functools import partial

import numpy as np
from chain_scenes import D, chain_scene
from hard_scene import HardScene
from judges import exactly, near

from femseal.flow import Spiral, cell_permeability
from femseal.flow.spiral import spiral_flow
from femseal.studies import deterministic
from femseal.topography import TiltedSeat, Topography

scene = partial(HardScene, "chain")


def _edge():
    """Fraction of the load on the inlet's half of a seat that is tilted by 1°."""
    face = TiltedSeat(np.radians(1.0)).add_to(Topography(np.zeros((512, 2)), (D, D), (False, True)))
    load = 1e4 / (512 * D)
    given = {"boundary": ("free", "periodic"), "hardness": np.inf, "loading": (load,)}
    rows = deterministic(chain_scene(face.heights, **given)).row_pressure[0]
    return float(rows[:256].sum() / rows.sum())


def _spiral():
    """Permeability of grooves 16 pixels apart along x2 with a lead of 16.4 pixels, over k22 tan²α."""
    x = np.arange(192) + 0.5
    gap = np.repeat(np.maximum(-1e-7 - 1e-6 * np.cos(2 * np.pi * x / 16), 0.0)[:, None], 64, axis=1)
    plain = cell_permeability(gap, (D, D), sides="periodic")
    along = cell_permeability(gap, (D, D), axis=1, sides="periodic").value
    found, _ = spiral_flow(gap, (D, D), Spiral(16.4 * D, 1e-3), plain.fluid_pressure)
    return found / (along * (16.4 * D / 1e-3) ** 2)


SCENES = (
    scene(
        "groove between the pixels",
        "closed lands and a lead that is no whole number of pixels: permeability over k₂₂ tan²α",
        near(1.0, 0.02, "whole pixels and a fraction of them"),
        _spiral,
    ),
    scene(
        "seat tilted by 1°",
        "fraction of the load on the half that touches",
        exactly(1.0, "one edge"),
        _edge,
    ),
)

"""Hard scenes of real seals: a spiral groove, a fluid that acts, a seat that is tilted."""

from functools import partial

import numpy as np
from chain_scenes import D, chain_face, chain_scene
from hard_scene import HardScene
from judges import exactly, falling, near

from femseal.flow import Spiral, cell_permeability
from femseal.flow.spiral import spiral_flow
from femseal.studies.face_study import deterministic
from femseal.topography import TiltedSeat, Topography

H = 2.5e9
LOAD = 1e8

scene = partial(HardScene, "chain")


def _leakage(heights, **given):
    """Leakage of a face free along x1 whose fluid presses it apart [m²/s]."""
    base = {
        "boundary": ("free", "periodic"),
        "fluid_pressure": "acts",
        "hardness": H,
        "loading": (LOAD,),
    }
    return deterministic(chain_scene(heights, **base | given)).leakage


def _growing():
    """Leakage per pressure drop, falling from p_in = 1.6 p̄ down to none."""
    heights = chain_face((48, 64))
    pressures = LOAD * np.array([1.6, 1.2, 0.8, 0.3, 0.1, 1e-3])
    return np.array([_leakage(heights, inlet_pressure=p)[0] / p for p in pressures])


def _edge():
    """Fraction of the load on the inlet's half of a seat that is tilted by 1°."""
    face = TiltedSeat(np.radians(1.0)).on(Topography(np.zeros((512, 2)), (D, D), (False, True)))
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
        "fluid from 1.6 of the load to none",
        "one face and load, p_in/p̄ from 1.6 to 0.001: leakage per drop [m²/(s·Pa)]",
        falling("the less fluid pressure, the less leaks"),
        _growing,
    ),
    scene(
        "seat tilted by 1°",
        "fraction of the load on the half that touches",
        exactly(1.0, "one edge"),
        _edge,
    ),
)

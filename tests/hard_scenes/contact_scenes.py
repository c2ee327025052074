"""Hard scenes of contact: a material like clay, a ledge, a spike."""

from functools import partial

import numpy as np
from hard_scene import HardScene
from judges import between, exactly, near

from femseal.contact import (
    HalfSpace,
    solve_contact,
)
from femseal.topography import self_affine

E, D, LOAD = 115e9, 1e-6, 1e8
SLOPE = 0.1

scene = partial(HardScene, "contact")


def _rough(n=96, rng=1):
    size = (n * D, n * D)
    return -self_affine(
        (n, n), size, hurst=0.8, rms_slope=SLOPE, roll_off=n * D / 3, cut_off=8 * D, rng=rng
    ).heights


def _solved(gap0, **given):
    body = HalfSpace(gap0.shape, (D, D), E)
    return solve_contact(gap0, body, **{"pressure": LOAD} | given)


def _soft():
    hardness = 0.01 * E * SLOPE
    contact = _solved(_rough(), pressure=0.1 * hardness, hardness=hardness)
    return contact.area_fraction


def _step():
    gap0 = np.zeros((64, 48))
    gap0[:, 24:] = 1.0
    contact = _solved(gap0)
    return contact.area_fraction, float(contact.pressure[:, 24:].max())


def _crushed_spike():
    gap0 = _rough(64)
    gap0[20, 30] -= 1e-3
    contact = _solved(gap0, hardness=1e10)
    return float(contact.pressure[20, 30]), contact.mean_pressure


SCENES = (
    scene(
        "H/(E*h′) = 0.01",
        "a face as soft as clay at a tenth of its hardness: share in contact",
        between(0.1, 0.103, "all of it at the hardness, p̄/H"),
        _soft,
    ),
    scene(
        "step of a metre",
        "a ledge of 1 m on pixels of 1 µm: share in contact, largest pressure on the low half [Pa]",
        exactly((0.5, 0.0), "the upper half carries all"),
        _step,
    ),
    scene(
        "spike that is crushed",
        "one pixel stands out by 1 mm, with a hardness of 10 GPa: its pressure and the mean [Pa]",
        near((1e10, LOAD), 1e-9, "the hardness, and the rest carries on"),
        _crushed_spike,
    ),
)

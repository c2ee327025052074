"""Hard scenes of the flow over a seal: sizes, a threshold, an oil."""

from functools import partial

import numpy as np
from hard_scene import HardScene
from judges import between, near

from femseal.fluids import Liquid
from femseal.seal import (
    AnnularSeal,
    RectangularSeal,
    seal_leakage,
)

K, ETA = 1e-20, 1e-3

scene = partial(HardScene, "seal")


def _columns():
    """A seal of 1 mm × 100 m whose columns do not exchange any fluid, over the sum of its columns."""
    k = np.random.default_rng(1).lognormal(sigma=2, size=100_000)
    seal = RectangularSeal((1e-3, 100.0), (2, 100_000))
    return seal.flow(np.stack([k, k])).conductance / float(k.sum())


def _critical():
    """Elements open with a probability of 0.65; a lattice of squares closes at 0.593."""
    is_open = np.random.default_rng(5).random((200, 200)) < 0.65
    flow = RectangularSeal((1.0, 1.0), (200, 200)).flow(1.0 * is_open, bounds=True)
    return flow.conductance / flow.lower, flow.upper / flow.conductance


def _barus():
    oil = Liquid(viscosity=ETA, pressure_viscosity=20e-9)
    one = RectangularSeal((1e-3, 1e-3), (1, 1))
    return seal_leakage(one, K, oil, inlet_pressure=0.5e9, outlet_pressure=0.0).volume_rate


SCENES = (
    scene(
        "ring of hair and mile",
        "radii of 1 µm and 1 km, all in one row of elements",
        near(2 * np.pi / np.log(1e9), 1e-9, "2πk/ln(r_o/r_i)"),
        lambda: AnnularSeal(1e-6, 1e3, (1, 7)).flow(1.0).conductance,
    ),
    scene(
        "seal of 1 : 1e5",
        "1 mm × 100 m of 200 000 elements, the same in each column: rate over the sum of the columns",
        near(1.0, 1e-7, "columns side by side"),
        _columns,
    ),
    scene(
        "lattice at its threshold",
        "35 % of 40 000 elements closed at random, yet open: flow over lower bound, upper bound over flow",
        between(1.0, 5.0, "the flow of the elements is enclosed"),
        _critical,
    ),
    scene(
        "oil at 0.5 GPa",
        "Barus's law with αp = 10 [m³/s]",
        near(K / ETA * (1 - np.exp(-10.0)) / 20e-9, 1e-9, "(1 − exp(−αp))/α"),
        _barus,
    ),
)

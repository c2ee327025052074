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
    """A seal of 1 mm × 100 m whose columns do not know each other, over the sum of their harmonic means."""
    k1 = np.random.default_rng(1).lognormal(sigma=2, size=(2, 100_000))
    flow = (
        RectangularSeal((1e-3, 100.0), (2, 100_000)).flow((k1, np.zeros((1, 100_000)))).conductance
    )
    return flow / float(np.sum(1 / np.sum(1 / k1, axis=0)) * 1e-3 / 0.5e-3)


def _critical():
    """Links open with a probability of 0.5, at which a lattice closes; this one is just open."""
    rng = np.random.default_rng(5)
    k1, k2 = ((rng.random(shape) < 0.5).astype(float) for shape in ((200, 200), (199, 200)))
    flow = RectangularSeal((1.0, 1.0), (200, 200)).flow((k1, k2), bounds=True)
    return flow.conductance / flow.lower, flow.upper / flow.conductance


def _barus():
    oil = Liquid(viscosity=ETA, pressure_viscosity=20e-9)
    one = RectangularSeal((1e-3, 1e-3), (1, 1))
    return seal_leakage(one, K, oil, inlet_pressure=0.5e9, outlet_pressure=0.0).volume_rate


SCENES = (
    scene(
        "ring of hair and mile",
        "radii of 1 µm and 1 km, all in one row of links",
        near(2 * np.pi / np.log(1e9), 1e-9, "2πk/ln(r_o/r_i)"),
        lambda: AnnularSeal(1e-6, 1e3, (1, 7)).flow(1.0).conductance,
    ),
    scene(
        "seal of 1 : 1e5",
        "1 mm × 100 m of 200 000 links in separate columns: rate over the sum of harmonic means",
        near(1.0, 1e-7, "series and parallel"),
        _columns,
    ),
    scene(
        "lattice at its threshold",
        "half of 80 000 links closed at random, yet open: flow over lower bound, upper bound over flow",
        between(1.0, 1 + 1e-6, "the flow of the network is enclosed"),
        _critical,
    ),
    scene(
        "oil at 0.5 GPa",
        "Barus's law with αp = 10 [m³/s]",
        near(K / ETA * (1 - np.exp(-10.0)) / 20e-9, 1e-9, "(1 − exp(−αp))/α"),
        _barus,
    ),
)

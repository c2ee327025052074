"""Hard scenes of two scales and of seals that are drawn, from heights to leakage."""

from dataclasses import replace
from functools import partial
from math import pi

import numpy as np
from chain_scenes import DROP, ETA, D, chain_face, chain_scene
from hard_scene import HardScene
from judges import exactly, near

from femseal.analytic import annulus_rate
from femseal.seal.layouts import AnnularLayout
from femseal.studies import Sampling
from femseal.studies.drawn_study import stochastic
from femseal.studies.face_study import deterministic
from femseal.studies.piece_study import two_scale
from femseal.topography import Topography

scene = partial(HardScene, "chain")


def _one_piece():
    """Leakage of the only piece of a face, times the factor of its state, over the deterministic one."""
    scene = chain_scene(_symmetric(), loading=(1e8,))
    pieces = two_scale(scene, (1, 1)).pieces
    assert pieces is not None
    return float(pieces.own[0] * pieces.factor[0] / deterministic(scene).leakage[0])


def _symmetric():
    """A face that is its own mirror image in both axes, so that periodic and mirrored sides are one."""
    quarter = chain_face((48, 48))
    half = np.concatenate([quarter, quarter[::-1]])
    return np.concatenate([half, half[:, ::-1]], axis=1)


def _tiles(along, across):
    """A face of 3 × 4 tiles with a mirror in both axes, waves of an amplitude along and across [m]."""
    c = np.cos(2 * pi * (np.arange(32) + 0.5) / 8)  # the overlap of pieces is half a wave
    tile = along * c[:, None] + across * c if along * across == 0 else along * c[:, None] * c
    return chain_scene(np.tile(tile, (3, 4)), hardness=np.inf, loading=(1e7,))


def _long_seal():
    """A seal of 0.2 mm × 10 m drawn from pieces that are all alike, over half the leakage of their face."""
    scene = _tiles(1e-7, 1e-7)
    drawn = stochastic(scene, (3, 4), Sampling(96e-6 * 1e5, 2, seed=1, breadth=2 * 96e-6))
    return float(2 * drawn.leakage.max() / deterministic(scene).leakage[0])


def _drawn_ring(scene, lay):
    """A ring drawn from pieces that are all alike: leakage per length of its middle line [m²/s]."""
    ring = replace(scene, layout=AnnularLayout(1e-3, 1.2e-3, lay=lay))
    return float(stochastic(ring, (3, 4), Sampling(None, 2, seed=1)).leakage.max())


def _ring_over_strip(scene, lay, axis=0):
    """The same over that of a ring of the permeability of the face, along x1 or x2."""
    turned = scene.surface.heights if axis == 0 else scene.surface.heights.T
    strip = replace(scene, surface=Topography(turned, (D, D)))
    permeability = float(deterministic(strip).leakage[0]) * ETA * turned.shape[0] * D / DROP
    ring = annulus_rate(permeability, DROP, ETA, 1e-3, 1.2e-3) / (2 * pi * 1.1e-3)
    return _drawn_ring(scene, lay) / ring


SCENES = (
    scene(
        "one piece in two scales",
        "a face that is one piece: leakage of the piece, times its factor, over deterministic",
        near(1.0, 1e-6, "the factor makes up for closed sides"),
        _one_piece,
    ),
    scene(
        "seal of 1 : 1e5, drawn",
        "192 µm × 9.6 m of equal pieces: leakage over half of that of the face",
        near(1.0, 1e-5, "no chance is left"),
        _long_seal,
        slow=True,
    ),
    scene(
        "ring of pieces all alike",
        "a drawn ring of equal pieces: leakage over that of their permeability",
        near(1.0, 1e-5, "2πkΔp/(η ln(r_o/r_i))"),
        lambda: _ring_over_strip(_tiles(1e-7, 1e-7), "circumferential"),
    ),
    scene(
        "grooves round a ring",
        "a drawn ring whose pieces have ridges along its circumference: leakage [m²/s]",
        exactly(0.0, "one ridge is enough"),
        lambda: _drawn_ring(_tiles(1e-7, 0.0), "circumferential"),
    ),
    scene(
        "grooves along the radius of a ring",
        "the same with its lay turned: leakage over that of the permeability along the grooves",
        near(1.0, 1e-5, "2πkΔp/(η ln(r_o/r_i))"),
        lambda: _ring_over_strip(_tiles(1e-7, 0.0), "radial", axis=1),
    ),
)

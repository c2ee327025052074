"""Hard scenes of grooves under load, whose gap and flow are known in closed form."""

from functools import partial
from math import pi, sin

import numpy as np
from chain_scenes import DROP, ETA, D, E, chain_scene
from hard_scene import HardScene
from judges import near

from femseal.analytic import wave_full_contact_pressure, wave_groove_flow
from femseal.studies import deterministic

scene = partial(HardScene, "chain")

#: A wave of 1 µm and 256 pixels, and the pressure that flattens it.
_WAVE = 0.5e-6 * np.cos(2 * pi * (np.arange(256) + 0.5) / 256)
_FULL = wave_full_contact_pressure(E, 0.5e-6, 256 * D)
#: Pressure over that of full contact at which 99.9 % of a wave is in contact.
_NEARLY_ALL = sin(0.999 * pi / 2) ** 2


def _leakage(heights, spacing, load):
    """Leakage of an elastic face at a pressure over that of full contact."""
    scene = chain_scene(heights, spacing, hardness=np.inf, loading=(load * _FULL,), rtol=1e-8)
    return float(deterministic(scene).leakage[0])


def _grooves(ratio, rows=8):
    heights = np.repeat(_WAVE[None], rows, axis=0)
    return _leakage(heights, (D, D), ratio)


def _grooves_exactly(ratio, rows=8):
    return (2 * 0.5e-6) ** 3 / 12 * wave_groove_flow(ratio) * DROP / (ETA * rows * D)


def _last_groove():
    """A wave on one row of 32768 pixels, of which 33 are open."""
    n = 2**15
    wave = 0.5e-6 * np.cos(2 * pi * (np.arange(n) + 0.5) / n)
    return _leakage(wave[None], (D, 256 * D / n), _NEARLY_ALL)


SCENES = (
    scene(
        "grooves along, light load",
        "an elastic wave whose grooves run from inlet to outlet, at 0.01 of full contact [m²/s]",
        near(_grooves_exactly(0.01), 0.005, "gap of Westergaard's wave"),
        lambda: _grooves(0.01),
    ),
    scene(
        "grooves along, nearly closed",
        "the same at 0.9 of full contact [m²/s]",
        near(_grooves_exactly(0.9), 0.03, "gap of Westergaard's wave"),
        lambda: _grooves(0.9),
    ),
    scene(
        "99.9 % in contact, grooves along",
        "a wave of which 33 of 32768 pixels are open: leakage [m²/s]",
        near(_grooves_exactly(_NEARLY_ALL, 1), 0.02, "gap of Westergaard's wave"),
        _last_groove,
        slow=True,
    ),
)

"""The effort of load steps, from the contact of a small part of the face; and how fast this machine is.

Numbers of transforms are counted, not timed: they do not depend on what else the machine does.
"""

import time
from dataclasses import replace
from functools import cache
from math import log, sqrt
from statistics import median

import numpy as np
from scipy import fft

from ..base import FemsealError
from ..contact import HalfSpace, solve_contact
from ..studies import Scene
from ..studies.costs import PILOT_PIXELS, Effort

#: Load steps that are solved at most.
_MOST_STEPS = 4
#: Seconds of a pair of transforms of 128² numbers on the machine where the constants of the costs were measured. They
#: stay in the cache: those of larger arrays take the time in which the system gives new memory, as no solver does.
_PACE_SECONDS = 1.2e-4


@cache
def pace() -> float:
    """Time that this machine takes for transforms, as a multiple of the one on which the costs were measured."""
    heights = np.random.default_rng(0).random((128, 128))
    taken = []
    for _ in range(100):
        start = time.thread_time()  # of the processor: what others do on the machine is not forecast
        fft.irfft2(fft.rfft2(heights), heights.shape)
        taken.append(time.thread_time() - start)
    return median(taken) / _PACE_SECONDS


def efforts(scene: Scene) -> tuple[Effort, ...]:
    """Effort of every load step, from contacts of the middle of the face at some of the pressures.

    The state that an earlier load left is left out: unloading takes about as many transforms as loading.
    """
    surface = scene.surface
    scale = min(1.0, sqrt(PILOT_PIXELS / surface.heights.size))
    n1, n2 = (max(16, int(n * scale)) if n > 16 else n for n in surface.shape)
    start = (surface.shape[0] - n1) // 2, (surface.shape[1] - n2) // 2
    part = surface.crop((n1, n2), start).detrend()
    half_space = HalfSpace(part.shape, part.spacing, scene.modulus, ("mirror", "mirror"))
    gap = part.heights.max() - part.heights
    pressures = sorted({step.pressure for step in scene.steps if step.pressure > 0})
    chosen = np.linspace(0, len(pressures) - 1, min(_MOST_STEPS, len(pressures)))
    tried = [pressures[k] for k in chosen.round().astype(int)]
    found: dict[float, Effort] = {}
    for pressure in tried:
        try:
            contact = solve_contact(gap, half_space, pressure=pressure, hardness=scene.hardness, rtol=scene.rtol)
            effort = Effort(contact.fft_pairs, contact.area_fraction)
            found[pressure] = replace(effort, pairs=effort.pairs * (PILOT_PIXELS / gap.size) ** effort.growth)
        except FemsealError:  # the run will tell
            found[pressure] = Effort()
    return tuple(_between(found, step.pressure) for step in scene.steps)


def _between(found: dict[float, Effort], pressure: float) -> Effort:
    """Effort at a pressure, linear in its logarithm between those that were solved."""
    if not found or pressure <= 0:
        return Effort(0.0, 0.0)
    known = [log(p) for p in found]
    pairs, fraction = (np.interp(log(pressure), known, values) for values in
                    ([e.pairs for e in found.values()], [e.contact_fraction for e in found.values()]))  # fmt: skip
    return Effort(float(pairs), float(fraction))

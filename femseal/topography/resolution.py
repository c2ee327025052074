"""The grid that a measured face deserves: pixels fine enough for the shortest wave that the instrument resolved.

Source: section 4.1 of the model, after Pérez-Ràfols et al., Tribol. Lett. (2018): the shortest wave has 8 pixels.
"""

from __future__ import annotations

from math import ceil, inf, prod, sqrt

from scipy.fft import next_fast_len

from .generate import PIXELS_PER_WAVE
from .spectral import SLACK

#: Most points of a grid that nobody asked for. It does not depend on the machine, so that results do not either; a
#: deterministic solution of as many takes a few GB, and some 10 to 40 s of one core for each load step.
MOST_POINTS = 2**22


def resolving_shape(size: tuple[float, float], wave: float, *, most: float = inf) -> tuple[int, int]:
    """Points along x1 and x2 at which a wave has 8 pixels or a little more, in numbers that transform fast.

    Parameters
    ----------
    size : of the face [m].
    wave : shortest wave that shall be kept [m].
    most : points of the grid at most, about: where the wave takes more, the pixels are wider.

    Examples
    --------
    >>> resolving_shape((1e-3, 2e-3), 8e-6), resolving_shape((1e-3, 2e-3), 8e-6, most=500_000)
    ((1000, 2000), (500, 1000))
    """
    pixel = max(wave / PIXELS_PER_WAVE, sqrt(prod(size) / most))
    n1, n2 = (next_fast_len(ceil(length / pixel * (1 - SLACK)), real=True) for length in size)
    return n1, n2

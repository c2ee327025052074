"""How much of a surface carries its flow in one contact state. The less of it does, the less one patch tells of others.

Near closing, the flow passes a few constrictions. How many there are is a property of the state itself, whatever other
loads are solved. It is described by the participation number N = (Σd)²/Σd² of the dissipation d over blocks of one
short wave (Bell & Dean, Discuss. Faraday Soc. 50, 1970, 55, for the number of sites that a state occupies).
"""

from __future__ import annotations

import numpy as np

from ..base import Floats, Shape
from ..topography import Surface, Topography
from ..topography.topography import power, wavenumber_grids

#: Fraction of the mean square slope in waves no shorter than a block of the participation number.
_SLOPE_FRACTION = 0.95
#: Pixels of a block on a surface without slope.
_FLAT_BLOCK = 8


def participation_number(dissipation: Floats, blocks: Shape) -> float:
    """Count the blocks that effectively carry the flow: (Σd)²/Σd² of the dissipation d of the blocks.

    It is the number of all blocks in a uniform flow, and 1 where all is dissipated in one of them; NaN without flow.

    dissipation : of every pixel (n1, n2), up to a factor, NaN where nothing flows. blocks : numbers of blocks along x1
    and x2, see `blocks_of_one_wave`.

    >>> participation_number(np.ones((8, 16)), (2, 4))
    8.0
    """
    starts = [np.arange(m) * n // m for m, n in zip(blocks, dissipation.shape, strict=True)]
    sums = np.add.reduceat(np.nan_to_num(dissipation), starts[0], axis=0, dtype=float)
    sums = np.add.reduceat(sums, starts[1], axis=1)
    total = float(sums.sum())
    return total**2 / float((sums**2).sum()) if total > 0 else float("nan")


def blocks_of_one_wave(surface: Surface) -> Shape:
    """Numbers of blocks along x1 and x2 into which a surface is cut, each about one of its short waves long and broad.

    That wave is the shortest of those that hold 95 % of the mean square slope. It is a property of the surface and not
    of its pixels.
    """
    wave = short_wave(surface)
    m1, m2 = (max(1, round(length / wave)) for length in surface.size)
    n1, n2 = surface.shape
    return min(m1, n1), min(m2, n2)


def short_wave(surface: Surface) -> float:
    """Find the shortest of the waves that hold 95 % of the mean square slope [m]; the median of several patches."""
    return float(np.median([_short_wave(patch) for patch in surface.patches]))


def _short_wave(patch: Topography) -> float:
    """Find the short wave of a single map [m]."""
    q1, q2 = wavenumber_grids(patch.shape, patch.spacing, patch.periodic)
    squared = q1**2 + q2**2
    heights = patch.heights - patch.heights.mean()
    slope = (power(heights, patch.periodic) * squared).ravel()
    total = float(slope.sum())
    if not total > 0:
        return _FLAT_BLOCK * max(patch.spacing)
    order = np.argsort(squared, axis=None)
    last = int(np.searchsorted(np.cumsum(slope[order]), _SLOPE_FRACTION * total))
    last = min(last, order.size - 1)
    return float(2 * np.pi / np.sqrt(squared.ravel()[order[last]]))

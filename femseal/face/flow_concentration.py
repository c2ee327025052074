"""Measure how strongly the flow through a surface is concentrated at a few constrictions.

In a nearly closed surface, the flow passes through a few constrictions, so that the leakage of one measured patch says
little about other patches. To count the constrictions, the surface is divided into blocks about the size of one short
wave. The participation number N = (Σd)²/Σd², with the dissipation d in each block, is the effective number of blocks
that carry the flow. Source: Bell & Dean, Discuss. Faraday Soc. 50, 1970, 55 (participation number of a vibrational
state).
"""

from __future__ import annotations

import numpy as np

from ..base import Floats, Shape
from ..topography import Surface, Topography
from ..topography.waves import wave_powers, wavenumber_grids

#: Fraction of the mean square slope that is due to waves longer than the short wave.
_SLOPE_FRACTION = 0.95
#: Side of a block on a surface without slope, in pixels.
_FLAT_BLOCK = 8


def participation_number(dissipation: Floats, blocks: Shape) -> float:
    """Compute the participation number, the effective number of blocks that carry the flow.

    The participation number is the number of all blocks for a uniform flow, 1 if all energy is dissipated in one block,
    and NaN if nothing flows.

    Parameters
    ----------
    dissipation : array, (n1, n2)
        Dissipation in each pixel, in any unit; NaN at pixels without flow.
    blocks : tuple of two int
        Numbers of blocks along x1 and x2, see `blocks_of_one_wave`.

    >>> participation_number(np.ones((8, 16)), (2, 4))
    8.0
    """
    # index of the first pixel of each block along both axes
    starts = [np.arange(m) * n // m for m, n in zip(blocks, dissipation.shape, strict=True)]
    sums = np.add.reduceat(np.nan_to_num(dissipation), starts[0], axis=0, dtype=float)
    sums = np.add.reduceat(sums, starts[1], axis=1)  # dissipation in each block
    total = float(sums.sum())
    if not total > 0:
        return float("nan")
    return total**2 / float((sums**2).sum())


def blocks_of_one_wave(surface: Surface) -> Shape:
    """Return the numbers of blocks along x1 and x2, for blocks whose sides are about one short wavelength long.

    The short wavelength is a property of the surface, and does not depend on the pixel size, see `short_wave`.
    """
    wave = short_wave(surface)
    m1, m2 = (max(1, round(length / wave)) for length in surface.size)
    n1, n2 = surface.shape
    return min(m1, n1), min(m2, n2)


def short_wave(surface: Surface) -> float:
    """Return the short wavelength [m]: waves longer than this contribute 95 % of the mean square slope.

    For several patches, the median of the short wavelengths of the patches is returned.
    """
    return float(np.median([_short_wave(patch) for patch in surface.patches]))


def _short_wave(patch: Topography) -> float:
    """Compute the short wavelength [m] of a single patch, see `short_wave`."""
    q1, q2 = wavenumber_grids(patch.shape, patch.spacing, patch.periodic)
    squared = q1**2 + q2**2
    heights = patch.heights - patch.heights.mean()
    # contribution of each wave to the mean square slope, |q|² times its contribution to the mean square height
    square_slopes = (wave_powers(heights, patch.periodic) * squared).ravel()
    total = float(square_slopes.sum())
    if not total > 0:
        return _FLAT_BLOCK * max(patch.spacing)
    # accumulate the mean square slope from the longest wave to the shortest
    order = np.argsort(squared, axis=None)
    last = int(np.searchsorted(np.cumsum(square_slopes[order]), _SLOPE_FRACTION * total))
    last = min(last, order.size - 1)
    return float(2 * np.pi / np.sqrt(squared.ravel()[order[last]]))

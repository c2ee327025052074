"""Shares of the pressure drop over the links that dissipate most in a network.

Symbols: φ potential, c conductance of a link [m³], q = c Δφ its flow. Its dissipation q Δφ = c (Δφ)² adds up to the
flow times the drop of the whole, so that wherever all flow passes through one link after the other the share of the
dissipation in a link is its share of the pressure drop.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base import validate
from ..base.errors import InputError
from .shapes import AnnularSeal, RectangularSeal

Array = NDArray[np.float64]
#: Numbers of links over which the drop of pressure is summed by default.
NARROWEST = (1, 3, 10)


def drop_shares(
    k1: ArrayLike,
    k2: ArrayLike,
    seal: RectangularSeal | AnnularSeal,
    potential: ArrayLike,
    counts: Sequence[int] = NARROWEST,
) -> Array:
    """Share of the drop over the 1, 3, 10 links that dissipate most, those along both axes taken together.

    Parameters
    ----------
    k1, k2 : permeability of the links [m³], as in `seal_leakage`.
    seal : with these links.
    potential : at the nodes (n1 + 1, n2), in any unit, NaN in pockets: `Fluid.potential` of the fluid pressure, or the
        pressure itself of a liquid of constant viscosity.
    counts : numbers of links.

    Returns
    -------
    (number of counts,), from 0 to 1; NaN without flow.

    Raises
    ------
    InputError : permeabilities as in `seal_leakage`, a potential of another shape, counts that are not whole
        numbers >= 1.
    """
    n1, n2 = seal.cells
    φ = np.asarray(potential, float)
    if φ.shape != (n1 + 1, n2):
        raise InputError("potential", f"shape {φ.shape}", f"shape {(n1 + 1, n2)}")
    along, across = seal.stencil((k1, k2)).dissipation(φ)
    return largest_shares(np.concatenate([along.ravel(), across.ravel()]), counts)


def largest_shares(dissipation: ArrayLike, counts: Sequence[int] = NARROWEST) -> Array:
    """Sums of the largest values in shares of the sum of all, (number of counts,); NaN where all are 0.

    >>> largest_shares([[1.0, 4.0], [3.0, 0.0]], counts=(1, 2, 10)).tolist()
    [0.5, 0.875, 1.0]
    """
    counts = [validate.count("counts", n) for n in counts]
    falling = np.sort(np.asarray(dissipation, float), axis=None)[::-1]
    sums = falling.cumsum()
    if not sums[-1] > 0:
        return np.full(len(counts), np.nan)
    return sums[np.minimum(counts, sums.size) - 1] / sums[-1]

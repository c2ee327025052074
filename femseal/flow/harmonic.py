"""Fields continued over gaps in them by Laplace's equation: the smoothest of what is known, however it is cut."""

import numpy as np

from ..base import Array
from .solvers.amg import solve_spd
from .stencil import Stencil

#: Error in the norm of the energy.
_RTOL = 1e-5


def harmonic_fill(values: Array) -> Array:
    """Values (n1, n2) with those that are NaN continued by Δp = 0 from those that are known.

    The grid is periodic along x2, and nothing passes its ends along x1. Without any known value all stay NaN.
    """
    unknown = np.isnan(values)
    if unknown.all() or not unknown.any():
        return values
    known = values[~unknown]
    lowest, height = known.min(), np.ptp(known)
    filled = np.where(unknown, lowest, values)
    if height > 0:
        along, across = np.ones((2, *values.shape))
        along[-1] = 0.0
        rows = Stencil(along, across, ring1=True).to_csr()[np.flatnonzero(unknown)]
        load = -rows[:, np.flatnonzero(~unknown)] @ ((known - lowest) / height)
        found = solve_spd(rows[:, np.flatnonzero(unknown)], load, _RTOL).x
        filled[unknown] += height * np.clip(found, 0.0, 1.0)
    return filled

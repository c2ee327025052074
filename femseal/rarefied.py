"""Flow of a rarefied gas between plates: how much more of it passes than of a viscous one, from molecules to continuum.

A gas flows between parallel plates as −(h²/√(2R_sT)) Q(D) ∇p [kg/(m s)] with D = p h/(η√(2R_sT)); without slip Q is
D/6. Q has its least value, Knudsen's minimum, near D = 1.
Source: Fukui & Kaneko, J. Tribol. 112, 1990, 78: a fit to the linearised Boltzmann (BGK) equation for walls that
reflect diffusely. It is within 0.9 % of a solution of that equation, and jumps by 0.27 % at D = 0.15 and 0.14 % at
D = 5. Below 0.01, where the fit ends, the limit of free molecules between plates without end takes over, within 0.3 %:
(3(1 − γ)/2 − ln D)/√π with Euler's γ (Cercignani & Daneri, J. Appl. Phys. 34, 1963, 3509), plus c D ln²D, whose c makes
it continuous.
"""

from __future__ import annotations

from math import log, pi, sqrt

import numpy as np
from numpy.typing import ArrayLike

from .base import Array, reals

#: D at which the formulas of the transition and of slip begin, after that below which molecules do not meet.
FREE_MOLECULAR, TRANSITION, SLIP = 0.01, 0.15, 5.0
#: Least D of the logarithm, which has no limit.
_LEAST = 1e-30
#: Q of plates without end at D = 1, and the c that makes the lowest two formulas meet.
_FREE = 1.5 * (1.0 - 0.5772156649015329) / sqrt(pi)
_EXCESS = (-2.22919e-2 + 2.10673 + 1.653 - 0.694 - _FREE + log(FREE_MOLECULAR) / sqrt(pi)) / (
    FREE_MOLECULAR * log(FREE_MOLECULAR) ** 2
)
#: Factors of D, 1, 1/D and 1/D² in the formulas.
_FACTORS = np.transpose(
    [
        (0.0, _FREE, 0.0, 0.0),
        (-2.22919, 2.10673, 0.01653, -0.0000694),
        (0.13852, 1.25087, 0.15653, -0.00969),
        (1 / 6, 1.0162, 1.0653, -2.1354),
    ]
)


def flow_rate(inverse_knudsen: ArrayLike) -> Array:
    """Q(D), the flow rate of a gas between plates over h²/√(2R_sT) times the pressure gradient.

    inverse_knudsen : D >= 0, √π/2 over the ratio of mean free path and gap. Below 1e-30 it is taken for 1e-30.
    """
    d = np.maximum(reals(inverse_knudsen), _LEAST)
    a, b, c, e = _FACTORS[:, np.digitize(d, (FREE_MOLECULAR, TRANSITION, SLIP))]
    ln = np.log(np.where(d < FREE_MOLECULAR, d, 1.0))
    return np.asarray(a * d + b + c / d + e / d**2 - ln / sqrt(pi) + _EXCESS * d * ln**2)

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

from .base import Array
from .base.compiled import compiled

#: Borders of the four formulas.
FREE_MOLECULAR, TRANSITION, SLIP = 0.01, 0.15, 5.0
#: Least D of the logarithm, which has no limit.
_LEAST = 1e-30
#: Q of plates without end at D = 1, and the c that makes the lowest two formulas meet.
_FREE = 1.5 * (1.0 - 0.5772156649015329) / sqrt(pi)
_EXCESS = (-2.22919e-2 + 2.10673 + 1.653 - 0.694 - _FREE + log(FREE_MOLECULAR) / sqrt(pi)) / (
    FREE_MOLECULAR * log(FREE_MOLECULAR) ** 2
)


@compiled()
def _flow_rates(inverse_knudsen, out):
    """Q of every D."""
    for i in range(out.size):
        d = max(inverse_knudsen[i], _LEAST)
        if d >= SLIP:
            out[i] = d / 6.0 + 1.0162 + 1.0653 / d - 2.1354 / (d * d)
        elif d >= TRANSITION:
            out[i] = 0.13852 * d + 1.25087 + 0.15653 / d - 0.00969 / (d * d)
        elif d >= FREE_MOLECULAR:
            out[i] = -2.22919 * d + 2.10673 + 0.01653 / d - 0.0000694 / (d * d)
        else:
            out[i] = _FREE - log(d) / sqrt(pi) + _EXCESS * d * log(d) ** 2


def flow_rate(inverse_knudsen: ArrayLike) -> Array:
    """Q(D), the flow rate of a gas between plates over h²/√(2R_sT) times the pressure gradient.

    inverse_knudsen : D >= 0, √π/2 over the ratio of mean free path and gap. Below 1e-30 it is taken for 1e-30.
    """
    d = np.asarray(inverse_knudsen, dtype=float)
    out = np.empty(d.size)
    _flow_rates(d.ravel(), out)
    return out.reshape(d.shape)


def flow_rate_exponent(inverse_knudsen: ArrayLike) -> Array:
    """d ln Q/d ln D of `flow_rate`, formula by formula; it rises to 1 of a viscous gas."""
    d = np.maximum(np.asarray(inverse_knudsen, dtype=float), _LEAST)
    slope = np.select(
        [d >= SLIP, d >= TRANSITION, d >= FREE_MOLECULAR],
        [
            d / 6.0 - 1.0653 / d + 4.2708 / (d * d),
            0.13852 * d - 0.15653 / d + 0.01938 / (d * d),
            -2.22919 * d - 0.01653 / d + 0.0001388 / (d * d),
        ],
        -1 / sqrt(pi) + _EXCESS * d * (np.log(d) + 2) * np.log(d),
    )
    return np.asarray(slope / flow_rate(d))

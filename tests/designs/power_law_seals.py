"""Seals of a design whose leakages are power laws of the contact pressure."""

import numpy as np
from leakage_laws import STEPS, power_law

from femseal.designs.requirements import Seals

#: Leakages of 60 seals at 1 Pa, of which each has its own.
AMPLITUDES = np.exp(np.random.default_rng(3).normal(0, 0.3, 60)) * 1e12


def seals_of(leakage=None, steps=STEPS, interval=None):
    """Seals with this leakage (seals, steps), by default with the power laws of AMPLITUDES."""
    return Seals.from_leakage(
        steps, power_law(AMPLITUDES) if leakage is None else leakage, interval
    )

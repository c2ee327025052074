"""Leakage over the load: its slope, and what counts of it."""

from itertools import pairwise

import numpy as np

from ..base import Array
from ..loads import LoadProgramme

#: Loads at which the reference leaks less than this fraction of its first leakage are not compared.
FLOOR = 1e-3


def load_sensitivity(steps: LoadProgramme, leakage: Array) -> Array:
    """|d ln(leakage) / d ln(load)| at every step (steps,), the steeper of both sides on the branch; 0 where unknown."""
    q, p = np.abs(np.asarray(leakage, float)), steps.pressures
    found = np.zeros(len(steps))
    for s, other in neighbouring_steps(steps):
        if all(value > 0 for value in (q[s], q[other], p[s], p[other])):
            slope = abs(np.log(q[s] / q[other]) / np.log(p[s] / p[other]))
            found[[s, other]] = np.maximum(found[[s, other]], slope)
    return found


def neighbouring_steps(steps: LoadProgramme) -> list[tuple[int, int]]:
    """Every step with the one before it on its branch, that of an unloading being its peak."""
    ways = [np.union1d(own, steps.peak_indices[own]).tolist() for own in steps.branches]
    return [(s, before) for way in ways for before, s in pairwise(way)]


def first_known(leakage: Array) -> int:
    """Number of the first load at which a leakage (steps,) is known, 0 without one; the fluid may carry others."""
    return int(np.argmax(np.isfinite(leakage)))


def least_counted(leakage: Array) -> float:
    """Size of a leakage (steps,) below which a load does not count: 1e-3 of the first known one, NaN without one."""
    return float(FLOOR * np.abs(leakage[first_known(leakage)]))

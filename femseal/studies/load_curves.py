"""Leakage over the load: its slope, the load that closes a seal, and the distance between two curves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array
from ..loads import LoadProgramme, LoadStep


def load_sensitivity(steps: LoadProgramme, leakage: Array) -> Array:
    """|d ln(leakage) / d ln(load)| at every step (steps,), the steeper of both sides on the branch; 0 where unknown."""
    q, p = np.abs(np.asarray(leakage, float)), steps.pressures
    found = np.zeros(len(steps))
    for s, other in neighbouring_steps(steps):
        if q[s] > 0 and q[other] > 0 and p[s] > 0 and p[other] > 0:
            slope = abs(np.log(q[s] / q[other]) / np.log(p[s] / p[other]))
            found[s], found[other] = max(found[s], slope), max(found[other], slope)
    return found


def neighbouring_steps(steps: LoadProgramme) -> list[tuple[int, int]]:
    """Every step with the one before it on its branch, that of an unloading being its peak."""
    pairs = []
    for s, step in enumerate(steps):
        before = s - 1
        if step.unloaded_from is not None and steps[before].unloaded_from != step.unloaded_from:
            before = int(steps.peak_indices[s])
        if before >= 0:
            pairs.append((s, before))
    return pairs


#: Loads at which the reference leaks less than this fraction of its first leakage are not compared.
FLOOR = 1e-3


def first_known(leakage: Array) -> int:
    """Number of the first load at which a leakage (steps,) is known, 0 without one; the fluid may carry others."""
    return int(np.argmax(np.isfinite(leakage)))


def least_counted(leakage: Array) -> float:
    """Size of a leakage (steps,) below which a load does not count: 1e-3 of the first known one, NaN without one."""
    return float(FLOOR * np.abs(leakage[first_known(leakage)]))


@dataclass(frozen=True)
class LeakageFactor:
    """Distance of two leakage curves over one branch.

    value : exp(rms ln(Q/Q_ref)) [-], 1 for equal curves; NaN where no load can be compared.
    loads : number of loads compared.
    closed : number of loads at which one is closed and the other leaks more than this fraction; they have no ratio.
    """

    value: float
    loads: int
    closed: int


def leakage_factor(
    leakage: ArrayLike, reference: ArrayLike, steps: Sequence[LoadStep], branch: str
) -> LeakageFactor:
    """Factor exp(rms ln(Q/Q_ref)) over the loads of a branch at which the reference leaks more than 1e-3 of its first.

    A factor of 1.2 says that the leakage is typically 20 % too high or too low. Leakage falls over decades as a seal
    closes, so errors are measured in its logarithm. The direction of the flow does not matter.

    leakage, reference : leakage at every step (steps,), in any one unit; NaN: failed.
    steps : the load programme.
    branch : "loading" or "unloading" (from any peak).

    >>> steps = [LoadStep(1e8), LoadStep(2e8), LoadStep(3e8)]
    >>> leakage_factor([2.0, 0.5, 0.0], [1.0, 1.0, 0.1], steps, "loading")
    LeakageFactor(value=2.0..., loads=2, closed=1)
    """
    q, exact = (np.abs(np.asarray(values, dtype=float)) for values in (leakage, reference))
    chosen = np.array([s.branch == branch for s in steps])
    known = np.isfinite(q) & np.isfinite(exact)
    least = least_counted(exact)
    with np.errstate(invalid="ignore"):
        closed = chosen & known & (((q == 0) & (exact > least)) | ((exact == 0) & (q > least)))
        compared = chosen & known & (exact > least) & (q > 0)
    logs = np.log(q[compared] / exact[compared])
    value = float(np.exp(np.sqrt(np.mean(logs**2)))) if logs.size else float("nan")
    return LeakageFactor(value, logs.size, int(closed.sum()))


def closing_load(leakage: ArrayLike, steps: Sequence[LoadStep]) -> float:
    """Lowest nominal pressure on loading at which nothing leaks [Pa]; inf where every load leaks.

    >>> closing_load([1.0, 0.0, 0.0], [LoadStep(1e8), LoadStep(2e8), LoadStep(3e8)])
    200000000.0
    """
    values = np.asarray(leakage, dtype=float)
    shut = [
        s.pressure for s, q in zip(steps, values, strict=True) if s.branch == "loading" and q == 0
    ]
    return min(shut, default=float("inf"))

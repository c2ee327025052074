"""Leakage over the load: numbers between the steps that were solved, and the distance between two curves.

ln of a leakage is interpolated by PCHIP (Fritsch & Carlson, SIAM J. Numer. Anal. 17, 1980, 238) in the cube root of the
pressure, in which it is nearly straight from first touch to closing; any other number as it is, in the pressure; always
along each branch, monotonically and never wildly.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..base import Array, Indices
from ..loads import LoadProgramme, LoadStep


def numbers_of(part: LoadProgramme, steps: LoadProgramme) -> Indices:
    """Numbers of the steps of a part of a programme in the whole."""
    number = {step: n for n, step in enumerate(steps)}
    return np.array([number[step] for step in part])


def branches(steps: LoadProgramme) -> Iterator[Indices]:
    """Numbers of the steps of the loading, and of each unloading with its peak, with rising pressure."""
    yield np.flatnonzero(steps.on_loading)
    for peak in steps.unload_from:
        below = [s for s, step in enumerate(steps) if step.unloaded_from == peak]
        yield np.array([*below[::-1], steps.loading.index(peak)])


def neighbours(solved: Indices, steps: LoadProgramme) -> dict[int, tuple[int, int]]:
    """The two solved steps between which each of the others lies on its branch."""
    known = {*solved.tolist()}
    found: dict[int, tuple[int, int]] = {}
    for branch in branches(steps):
        at = [n for n, s in enumerate(branch.tolist()) if s in known]
        for low, high in pairwise(at):
            found |= {int(s): (int(branch[low]), int(branch[high])) for s in branch[low + 1 : high]}
    return found


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


def at_all_steps(values: Array, solved: Indices, steps: LoadProgramme, *, logarithmic: bool) -> Array:
    """Numbers at every step (..., steps) from those at the solved ones (..., solved).

    The first and the last step of every branch have to be solved. Between two equal numbers it is that number. Between
    an open and a closed state a leakage keeps the slope of the open ones half way, and is 0 from there; beside a NaN it
    is NaN.
    """
    found = np.full((*values.shape[:-1], len(steps)), np.nan)
    found[..., solved] = values
    x = np.cbrt(steps.pressures) if logarithmic else steps.pressures
    known = np.zeros(len(steps), bool)
    known[solved] = True
    for branch in branches(steps):
        wanted = branch[~known[branch]]
        if wanted.size:
            at = branch[known[branch]]
            rows, into = found.reshape(-1, len(steps)), np.empty((found[..., 0].size, wanted.size))
            for n, row in enumerate(rows):
                into[n] = _between(x[at], row[at], x[wanted], logarithmic)
            rows[:, wanted] = into
    return found


def left_out_errors(values: Array, solved: Indices, steps: LoadProgramme) -> dict[int, float]:
    """|ln| of the leakage of each solved step over what the other steps of its branch give there, by its number.

    Only steps between two open ones have one; of a step on two branches, a peak, it is that on loading.
    """
    found: dict[int, float] = {}
    at = {int(s): n for n, s in enumerate(solved)}
    x = np.cbrt(steps.pressures)
    for branch in branches(steps):
        known = [int(s) for s in branch if int(s) in at]
        row = np.array([values[at[s]] for s in known])
        for n in range(1, len(known) - 1):
            others = np.delete(np.arange(len(known)), n)
            guess = float(_between(x[known][others], row[others], x[[known[n]]], True)[0])
            if guess * row[n] > 0 and row[n - 1] != 0 and row[n + 1] != 0:
                found.setdefault(known[n], abs(float(np.log(guess / row[n]))))
    return found


def _between(x: Array, y: Array, wanted: Array, logarithmic: bool) -> Array:
    """y at wanted places from those at rising x, which enclose them."""
    after = np.clip(np.searchsorted(x, wanted), 1, x.size - 1)
    low, high = y[after - 1], y[after]
    found = np.where(low == high, low, np.nan)
    todo = np.isnan(found) & np.isfinite(low) & np.isfinite(high)
    if not logarithmic:
        good = np.isfinite(y)
        if todo.any():
            found[todo] = scipy.interpolate.PchipInterpolator(x[good], y[good])(wanted[todo])
        return found
    for n in np.flatnonzero(todo):
        first, last = _open_run(y, int(after[n]) - 1, int(after[n]))
        found[n] = _of_run(x[first : last + 1], y[first : last + 1], wanted[n], x[after[n] - 1], x[after[n]])
    return found


def _open_run(y: Array, before: int, after: int) -> tuple[int, int]:
    """Ends of the steps of one sign around an interval, one end of which may be closed."""
    start = before if y[before] != 0 else after
    leaks = np.isfinite(y) & (np.sign(y) == np.sign(y[start]))
    first = last = start
    while first > 0 and leaks[first - 1]:
        first -= 1
    while last < y.size - 1 and leaks[last + 1]:
        last += 1
    return first, last


def _of_run(x: Array, y: Array, wanted: float, low: float, high: float) -> float:
    """Leakage at a place in or beside a run of open steps; low, high : the places that enclose it."""
    logs, sign = np.log(np.abs(y)), float(np.sign(y[0]))
    if x[0] <= low and high <= x[-1]:
        return sign * float(np.exp(scipy.interpolate.PchipInterpolator(x, logs)(wanted)))
    end = -1 if wanted > x[-1] else 0
    if abs(wanted - x[end]) > 0.5 * (high - low):
        return 0.0
    first = x.size - 2 if end else 0
    slope = 0.0 if x.size == 1 else (logs[first + 1] - logs[first]) / (x[first + 1] - x[first])
    return sign * float(np.exp(logs[end] + min(slope * (wanted - x[end]), 0.0)))


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


def leakage_factor(leakage: ArrayLike, reference: ArrayLike, steps: Sequence[LoadStep], branch: str) -> LeakageFactor:
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
    shut = [s.pressure for s, q in zip(steps, values, strict=True) if s.branch == "loading" and q == 0]
    return min(shut, default=float("inf"))

"""Estimate the error of a leakage by comparison with a second solution, such as a solution on a coarser grid.

The class `CoarserSolution` holds the leakage of the second solution, for example with larger pixels or without the
shortest waves. The difference between the leakage and the leakage of the second solution shows the error of the pixel
size or of the removed waves.

The change of ln(leakage) from one grid to a coarser grid is not a smooth function of the load. At loads where
contacts open and close, the sign of the change is random. Near the load at which the last leakage path closes, the
coarser grid shifts the load at which the seal closes, so that the change of ln(leakage) is this shift of ln(load) times
the slope |d ln(leakage)/d ln(load)|. The function `scale_of_changes` estimates the typical size of the change at a load
from two contributions: the changes at neighbouring loads, and the typical shift of the load over the whole cycle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import shortest_path

from ..base import Array, Flags, Shape
from ..loads import LoadProgramme, load_sensitivity, neighbouring_steps
from .error_parts import ErrorPart

#: Smallest slope |d ln(leakage)/d ln(load)| by which changes are divided.
LEAST_LOAD_SLOPE = 0.3
#: In nine of ten contact states, the slope |d ln(leakage)/d ln(load)| is at most this multiple of
#: `expected_sensitivity`.
STEEPEST = 2.0


@dataclass(frozen=True)
class CoarserSolution:
    """Leakage of a solution on fewer points, without the shortest waves or with a changed model.

    Parameters
    ----------
    points : (int, int)
        Number of points of the surface along x1 and x2.
    leakage : array (steps,), m²/s
        Leakage at every load step.
    reference : array (steps,), m²/s, optional
        Leakage with which `leakage` is compared; by default the leakage of the error budget.
    rms_slope : float, optional
        Rms slope of the surface that was solved.
    """

    points: Shape
    leakage: Array
    reference: Array | None = None
    rms_slope: float | None = None

    def change(self, leakage: Array) -> Array:
        """Compute the change ln(Q/Q_r) (steps,) from a leakage Q_r to the leakage Q of the coarser solution.

        The change is inf where only Q_r is 0, −inf where only Q is 0, and 0 where Q and Q_r are 0. The change is NaN
        where Q or Q_r is unknown.

        leakage : leakage of the error budget (steps,) [m²/s], which is Q_r unless `reference` is given.
        """
        compared_with = leakage if self.reference is None else self.reference
        reference = np.abs(np.asarray(compared_with, float))
        coarser = np.abs(np.asarray(self.leakage, float))
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.log(coarser / reference)
            return np.where((reference == 0) & (coarser == 0), 0.0, ratio)


def expected_sensitivity(in_contact: Array) -> Array:
    """Estimate the slope |d ln(leakage) / d ln(load)| (steps,) from the contact fraction alone.

    The slope is estimated as 0.5 + 9 A, with the contact fraction A. The slope was measured on 25 surfaces of five
    kinds at up to 16 loads each. The median slope was 0.6 for contact fractions below 2 %, 1.0 at 5 %, 2.0 at 17 %, 4.0
    at 32 % and 4.9 at 45 %. In nine of ten contact states, the slope was at most about twice the median slope.
    """
    return 0.5 + 9.0 * np.nan_to_num(np.asarray(in_contact, float))


def sensitivity(steps: LoadProgramme, leakage: Array, in_contact: Array) -> Array:
    """Estimate the slope |d ln(leakage) / d ln(load)| at every step (steps,).

    The slope is computed from the leakages under neighbouring loads, but is at least `expected_sensitivity`. If the
    slope cannot be computed, because the seal does not leak at the neighbouring loads, it is estimated as `STEEPEST`
    times `expected_sensitivity`. In nine of ten contact states, the true slope is at most `STEEPEST` times
    `expected_sensitivity`, so that the intervals computed from it are wide enough.

    in_contact : contact fraction (steps,), NaN where it is unknown.
    """
    expected = expected_sensitivity(in_contact)
    between_loads = load_sensitivity(steps, leakage)  # 0 where it is unknown
    at_least_expected = np.maximum(between_loads, expected)
    return np.where(between_loads > 0, at_least_expected, STEEPEST * expected)


def scale_of_changes(steps: LoadProgramme, change: Array, slope: Array) -> Array:
    """Estimate how much ln(leakage) typically changes from one grid to a coarser grid, at every step (steps,).

    The typical size of the change at a step is √(a² + b²). The term `a` is the root mean square of the known changes at
    the two nearest steps, including the step itself; if several steps are equally near, all these steps are used. The
    term b is the change that a typical shift of the load would cause: the slope at the step, times the mean shift of
    ln(load) over the whole cycle.

    Parameters
    ----------
    steps : LoadProgramme
        Load steps.
    change : array (steps,)
        Change of ln(leakage) from one grid to the coarser grid; NaN or ±inf where it is unknown.
    slope : array (steps,)
        Slope |d ln(leakage) / d ln(load)|, above 0.
    """
    finite = np.flatnonzero(np.isfinite(change))
    if not finite.size:
        return np.zeros(len(steps))
    shift = mean_shift(change[finite], slope[finite])
    # Distance from each step to each step with a finite change, array (step, finite step). The distance is counted in
    # steps along the load cycle, which is a graph: the unloadings branch off from the loading.
    is_neighbour = np.zeros((len(steps), len(steps)))
    for step, previous in neighbouring_steps(steps):
        is_neighbour[step, previous] = 1
    distance = shortest_path(is_neighbour, directed=False, unweighted=True)[:, finite]
    # a step is near if it is at most as far away as the second nearest step; a step with a finite change is its own
    # nearest step, at the distance 0
    second_smallest = np.sort(distance, axis=1)[:, :2].max(axis=1, keepdims=True)
    is_near = distance <= second_smallest  # (step, finite step)
    rms_nearby = np.sqrt(is_near @ np.square(change[finite]) / is_near.sum(axis=1))
    return np.hypot(rms_nearby, slope * shift)


def mean_shift(change: Array, slope: Array) -> float:
    """Compute the mean shift of ln(load) that would explain given changes of ln(leakage), or 0 without changes.

    change : changes of ln(leakage) (n,).
    slope : slope |d ln(leakage)/d ln(load)| at the load of each change (n,).
    """
    return float(np.mean(np.abs(change / slope))) if change.size else 0.0


def sealed_upper(
    steps: LoadProgramme,
    q: Array,
    distance: Array,
    change: Array | None = None,
    coarse: CoarserSolution | None = None,
) -> Array:
    """Estimate how much the seal may leak at load steps where the computed leakage is 0.

    Returns an array (steps,) [m²/s] with the upper end of the 95 % interval at sealed steps, and 0 at leaking steps.

    An error of ln(leakage) has the effect of a shift of ln(load), see `_load_shift`. If this shift may open the seal at
    a sealed step, the leakage of the step is estimated from the nearest leaking step with a lower load: it is at most
    the upper end of the interval of that step. If a second solution with another grid or a changed model leaks at the
    sealed step, the upper end is at least the leakage of the second solution.

    Parameters
    ----------
    steps : the load programme.
    q : leakage (steps,), m²/s.
    distance : distance from ln(leakage) to the upper end of its interval at leaking steps (steps,).
    change : change of ln(leakage) in the second solution (steps,), inf where only the second solution leaks; None if
        there is no second solution.
    coarse : the second solution; None if there is no second solution.
    """
    upper = np.zeros(q.size)
    change = np.zeros(q.size) if change is None else change
    other_leakage = np.zeros(q.size)
    if coarse is not None:
        other_leakage = np.nan_to_num(np.abs(coarse.leakage))
    is_open = (q > 0) & np.isfinite(distance)
    shift = _load_shift(distance, load_sensitivity(steps, q), is_open)
    pressure = steps.pressures
    for s in np.flatnonzero((q == 0) & ~np.isnan(change)):
        upper[s] = other_leakage[s]
        leaks_no_less = _leaks_no_less_at_lower_load(steps, int(s))
        open_below = np.flatnonzero(leaks_no_less & is_open & (pressure <= pressure[s]))
        # The seal may be open at s if the shifted load is not above the lowest load at which the seal is sealed. If the
        # shifted load is higher, the seal is certainly sealed at s.
        lowest_sealed = pressure[leaks_no_less & (q == 0)].min()
        opens_in_other = np.isposinf(change[s])
        may_open = opens_in_other or pressure[s] * np.exp(-shift) <= lowest_sealed
        if open_below.size and may_open:
            # the step with the highest load; of two steps with the same load, the step that leaks less
            nearest = max(open_below, key=lambda n: (pressure[n], -q[n]))
            factor = np.exp(min(float(distance[nearest]), 50.0))  # limited to avoid an overflow
            upper[s] = max(upper[s], q[nearest] * factor)
        if opens_in_other and upper[s] == 0:
            upper[s] = other_leakage.max()
    return upper


def _leaks_no_less_at_lower_load(steps: LoadProgramme, step: int) -> Flags:
    """Flag the steps that leak at least as much as a given step if their load is equal or lower.

    All steps on loading are flagged. If the given step is on an unloading branch, the steps of this branch are flagged
    as well.
    """
    loading, peaks = steps.on_loading, steps.peak_indices
    same_unloading = ~loading[step] & (peaks == peaks[step])
    return loading | same_unloading


def _load_shift(distance: Array, slope: Array, is_open: Flags) -> float:
    """Return the largest shift of ln(load) that explains the given distances of ln(leakage) at leaking steps.

    At each leaking step, the shift of ln(load) is the distance from ln(leakage) divided by the slope d ln(leakage)/d
    ln(load).

    Parameters
    ----------
    distance : distance from ln(leakage) to the upper end of its interval (steps,).
    slope : slope |d ln(leakage)/d ln(load)| (steps,), 0 where it is unknown. Leaking steps with an unknown slope are
        ignored, unless the slope is unknown at all leaking steps.
    is_open : whether the seal leaks (steps,).
    """
    has_slope = is_open & (slope > 0)
    is_used = has_slope if has_slope.any() else is_open
    shifts = distance[is_used] / np.maximum(slope[is_used], LEAST_LOAD_SLOPE)
    return float(np.max(shifts, initial=0.0))


def part_of_changes(
    name: str,
    steps: LoadProgramme,
    leakage: Array,
    below: Array,
    above: Array,
    note: str,
    *,
    change: Array | None = None,
    coarse: CoarserSolution | None = None,
) -> ErrorPart:
    """Make an error source from distances to ln(leakage), and estimate its upper ends at sealed steps.

    At load steps that leak, each end of the interval is set by its distance from ln(leakage). At sealed steps, where
    the computed leakage is zero and has no logarithm, `sealed_upper` estimates the upper end of the interval.

    Parameters
    ----------
    below, above : distances from ln(leakage) to the lower and to the upper end of its interval, arrays (steps,).
    change : change of ln(leakage) from the study to a second solution (steps,), if the error was estimated with a
        second solution. Where the change is NaN, the interval of the error source is unknown.
    coarse : the second solution; None if the error was estimated without a second solution.
    """
    q = np.abs(np.asarray(leakage, float))
    part = ErrorPart.from_distances(name, leakage, below, above, note)
    upper = np.where(q == 0, sealed_upper(steps, q, above, change, coarse), part.upper)
    if change is None:
        return ErrorPart(name, part.lower, upper, note)
    is_unknown = np.isnan(change)
    lower = np.where(is_unknown, np.nan, part.lower)
    upper = np.where(is_unknown, np.nan, upper)
    return ErrorPart(name, lower, upper, note)

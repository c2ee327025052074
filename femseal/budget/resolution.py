"""Estimate the error of a leakage that is caused by missing waves of the surface, or by solving on one grid only.

Waves are missing because a low-pass filter removed them, or because the instrument did not resolve them. If the
spectrum is continued, the phases of the continued waves are arbitrary, and waves beyond the cut-off are still missing.

The effect of the missing waves has an upper bound. With the missing waves, the surface would be steeper, and its gap
would be about the same as the gap of the present, smoother surface under a lower load. By Persson's theory, the contact
fraction is erf(c p/(E* h')), with the pressure p, the rms slope h' and a constant c. Let the present surface have κ
times the rms slope of the complete surface. Then its contact fraction under the pressure κ p is equal to the contact
fraction of the complete surface under p. A similar relation was found for the leakage, see `LOAD_POWER`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import erf, erfinv, stdtrit

from ..base import Array, Flags, as_text
from ..loads import LoadProgramme
from ..studies import Scene
from ..studies.patch_interval import COVERAGE
from .error_parts import (
    STEEPEST,
    VAGUE,
    CoarserSolution,
    ErrorPart,
    expected_sensitivity,
    part_of_changes,
)

#: The error of ln(leakage) due to removed waves is _ERROR √(s² + o²), where s and o are two estimates. Let r be the
#: mean square slope of the removed waves, divided by the mean square slope of the remaining waves. The estimate from
#: the contact state is s = _BY_STATE r^_POWER |d ln(leakage)/d ln(load)|, with the slope of `expected_sensitivity`. The
#: estimate from the octave, o, is the change of ln(leakage) when the shortest octave of the remaining waves is also
#: removed. It is multiplied by (r/r_o)^_POWER, but at most by 1, where r_o is the same ratio for this octave.
#: Measured on 90 files of three kinds, see docs/evidence/error_budget.md.
_POWER, _BY_STATE, _ERROR = 0.4, 0.4, 0.8
#: The surface may be sealed if the estimate of the error from the contact state is larger than this. Of 1739 loads, 38
#: were sealed by the removed waves. The estimate is above the limit at 30 of these, and at one in eleven of all loads.
_MAY_CLOSE = 1.5
#: Larger changes of ln(leakage) are reduced to this, because the surface may even be sealed without the octave.
_MOST_CHANGE = float(np.log(VAGUE))
#: The removed waves have the same effect as a load that is multiplied by κ**LOAD_POWER, where κ is the remaining
#: fraction of the rms slope. Measured on 96 surfaces of four kinds, see docs/evidence/error_budget.md: with a power of
#: 1 one load of 106 leaks more than the upper end, with 1.25 one of 425.
LOAD_POWER = 1.25
#: Smallest remaining fraction κ of the rms slope for which the leakage is extrapolated from a single load.
_LEAST_SLOPE_RATIO = 0.5
#: A surface is sealed for certain if its contact fraction with all waves is at least this value. The largest contact
#: fraction of an open surface was 0.58.
SEALED_CONTACT = 0.6


def one_grid_part(leakage: Array, in_contact: Array) -> list[ErrorPart]:
    """Estimate the error of the pixel size for a scene that was solved on one grid only.

    For leaking steps, one grid gives no estimate, and the interval has no width. A step that is sealed on this grid may
    really be open, unless its contact fraction is so large that it is sealed for certain. Its upper end is then inf.

    in_contact : contact fraction at every step (steps,).

    Returns an empty list if all sealed steps are sealed for certain.
    """
    q = np.abs(np.asarray(leakage, float))
    may_open = (q == 0) & ~sealed_for_certain(in_contact)
    if not may_open.any():
        return []
    note = "one grid, which does not show how far beyond its closing load a sealed face is"
    return [ErrorPart("pixels", q, np.where(may_open, np.inf, q), note)]


def filter_part(
    scene: Scene,
    leakage: Array,
    in_contact: Array,
    filtered: CoarserSolution,
    slope_ratio: float,
    name: str = "filter",
) -> ErrorPart:
    """Estimate the error that the filter causes, from the slope of the removed waves and a solution with fewer waves.

    In the additional solution, the shortest octave of the remaining waves is removed as well. The error is computed
    from the two estimates s and o, see `_ERROR`. It depends only on the contact state at the load; on unloading, it is
    at least as large as at the peak. If most of the slope was removed, the removed waves may also seal the surface.

    Parameters
    ----------
    scene : input of the study.
    leakage : array (steps,), m²/s.
    in_contact : contact fraction, array (steps,).
    filtered : solution without the shortest octave of the remaining waves.
    slope_ratio : rms slope of the surface, divided by its rms slope before the waves were removed.
    name : name of the error source.
    """
    steps = scene.steps
    change = filtered.change(leakage)
    # mean square slopes of the removed waves and of the octave, divided by the mean square slope of the surface
    removed = 1 / slope_ratio**2 - 1
    octave = 1.0
    if filtered.rms_slope is not None and scene.surface.rms_slope:
        octave = max(1 - (filtered.rms_slope / scene.surface.rms_slope) ** 2, 0.0)
    octave_factor = 1.0
    if octave:
        octave_factor = min(removed / octave, 1.0) ** _POWER
    octave_estimate = octave_factor * np.minimum(np.abs(change), _MOST_CHANGE)
    state_estimate = _BY_STATE * expected_sensitivity(in_contact) * removed**_POWER
    distance = _ERROR * np.hypot(octave_estimate, state_estimate)
    distance = np.fmax(distance, distance[steps.peak_indices])
    below = np.where(_ERROR * state_estimate > _MAY_CLOSE, np.inf, distance)
    note = (
        f"removed waves have {as_text(1 - slope_ratio, percent=True)} of the rms slope; estimated from it, from the "
        "contact fraction, and from the change of ln(leakage) without the shortest octave of the remaining waves"
    )
    return part_of_changes(
        name, steps, leakage, below, distance, note, change=change, coarse=filtered
    )


def continuation_part(
    scene: Scene,
    leakage: Array,
    in_contact: Array,
    others: Sequence[CoarserSolution],
    shorter: CoarserSolution,
    slope_ratio: float,
) -> ErrorPart:
    """Estimate the error that is caused by continuing the spectrum.

    There are two contributions a and b, which are combined as √(a² + b²). The first is the scatter between surfaces
    whose continued waves have different random phases. The true surface is regarded as one more sample of them.
    Therefore a is taken from Student's prediction interval for one further sample. The second contribution, b,
    is the effect of waves beyond the cut-off, see `filter_part`.

    Parameters
    ----------
    scene : input of the study.
    leakage : array (steps,), m²/s.
    in_contact : contact fraction, array (steps,).
    others : solutions with other phases.
    shorter : solution without the shortest octave of waves.
    slope_ratio : rms slope of the surface, divided by the rms slope that it would have if the relevant waves beyond the
        cut-off were included.
    """
    steps = scene.steps
    n = len(others) + 1
    changes = np.array([other.change(leakage) for other in others])  # (solution, step)
    finite = np.where(np.isinf(changes), 0.0, changes)
    # the surface of the study itself is one of the n samples, with a change of 0
    samples = np.vstack([np.zeros(len(steps)), finite])
    mean = samples.mean(axis=0)
    deviation = samples.std(axis=0, ddof=1)
    # the change for the true surface lies between mean − scatter and mean + scatter
    scatter = stdtrit(n - 1, (1 + COVERAGE) / 2) * np.sqrt(1 + 1 / n) * deviation
    beyond_cut_off = filter_part(scene, leakage, in_contact, shorter, slope_ratio)
    q = np.abs(leakage)
    with np.errstate(divide="ignore", invalid="ignore"):
        filter_below = np.nan_to_num(np.log(q / beyond_cut_off.lower), nan=0.0)
        filter_above = np.nan_to_num(np.log(beyond_cut_off.upper / q), nan=0.0)
    below = np.hypot(np.maximum(scatter - mean, 0.0), filter_below)
    above = np.hypot(np.maximum(scatter + mean, 0.0), filter_above)
    # where other phases seal the surface, the lower end is 0
    below = np.where(np.isneginf(changes).any(axis=0), np.inf, below)
    # inf where other phases open a sealed surface, NaN where a solution is unknown; the finite values are not used
    total_change = np.where(np.isposinf(changes).any(axis=0), np.inf, changes.sum(axis=0))
    leakiest = max(others, key=lambda other: float(np.nansum(np.abs(other.leakage))))
    note = (
        f"{n} realisations by Student's interval, and waves beyond the cut-off, which have "
        f"{as_text(1 - slope_ratio, percent=True)} of the rms slope"
    )
    return part_of_changes(
        "continuation", steps, leakage, below, above, note, change=total_change, coarse=leakiest
    )


def raised_by_slope(
    part: ErrorPart, steps: LoadProgramme, leakage: Array, in_contact: Array, slope_ratio: float
) -> ErrorPart:
    """Raise the upper ends of an interval to the upper bound that follows from the slope of the removed waves.

    With its removed waves, the surface would leak at most as much as the present surface does under a lower load, see
    `under_less_load`. If the leakage under the lower load is unknown at a sealed step, its upper end is inf.

    Parameters
    ----------
    part : error source with the interval.
    steps : the load programme.
    leakage, in_contact : leakage [m²/s] and contact fraction at every step, arrays (steps,).
    slope_ratio : rms slope of the surface, divided by its rms slope before waves were removed; 1 if none were removed.
    """
    bound = under_less_load(steps, np.abs(np.asarray(leakage, float)), in_contact, slope_ratio)
    is_raised = bound > part.upper  # False for an unknown end, which stays unknown
    if not is_raised.any():
        return part
    load_ratio = f"{slope_ratio**LOAD_POWER:.2g}"
    note = f"{part.note}; no less than under {load_ratio} times the load, for the slope that was removed"
    return replace(part, upper=np.where(is_raised, bound, part.upper), note=note)


def sealed_for_certain(in_contact: Array, slope_ratio: float = 1.0) -> Flags:
    """Return at which steps the surface would certainly be sealed if its removed waves were added again (steps,).

    Let A be the contact fraction of the present surface, and κ the slope ratio. By Persson's theory, the surface with
    its removed waves has the contact fraction erf(κ erfinv(A)). It is certainly sealed if this is at least
    `SEALED_CONTACT`. The result is False where the contact fraction is unknown.
    """
    with np.errstate(invalid="ignore"):
        complete_contact = erf(slope_ratio * erfinv(np.clip(in_contact, 0.0, 1.0)))
        return complete_contact >= SEALED_CONTACT


def under_less_load(steps: LoadProgramme, q: Array, in_contact: Array, slope_ratio: float) -> Array:
    """Estimate the leakage that each step (steps,) would have if its load were multiplied by slope_ratio**LOAD_POWER.

    The result is 0 where the surface is sealed under the reduced load as well.

    At a step on unloading, the reduced load is evaluated on the same unloading branch. The reduced load cycle would
    also have a lower peak. The leakage is therefore multiplied by the factor by which the leakage at the peak
    increases. It cannot be larger than the leakage on loading under the same reduced load.

    Parameters
    ----------
    steps : the load programme.
    q, in_contact : leakage [m²/s] and contact fraction at every step, arrays (steps,).
    slope_ratio : rms slope of the surface, divided by its rms slope before waves were removed.
    """
    p = steps.pressures
    estimate = np.array(q, float)
    if slope_ratio == 1:
        return estimate
    loading, *unloadings = steps.branches
    estimate[loading] = _on_branch(
        p[loading], q[loading], slope_ratio, p[loading], in_contact[loading]
    )
    for unloading in unloadings:
        peak = int(steps.peak_indices[unloading[0]])
        branch = np.append(unloading, peak)
        on_branch = _on_branch(p[branch], q[branch], slope_ratio, p[unloading], in_contact[branch])
        # correct for the lower peak of the reduced load cycle
        if q[peak] > 0:
            on_branch = on_branch * (estimate[peak] / q[peak])
        else:
            on_branch = np.maximum(on_branch, estimate[peak])
        on_loading = _on_branch(
            p[loading], q[loading], slope_ratio, p[unloading], in_contact[loading]
        )
        estimate[unloading] = np.minimum(on_branch, on_loading)
    estimate[(q == 0) & sealed_for_certain(in_contact, slope_ratio)] = 0.0
    return np.where(np.isnan(q), np.nan, np.maximum(estimate, q))


def _on_branch(
    pressure: Array, q: Array, slope_ratio: float, loads: Array, in_contact: Array
) -> Array:
    """Estimate the leakage on one branch of the load cycle, at loads that are multiplied by slope_ratio**LOAD_POWER.

    ln(leakage) is interpolated linearly over ln(load), and extrapolated below the lowest load. If the seal leaks only
    at one load, the extrapolation has a large slope: `STEEPEST` times `expected_sensitivity`.

    Parameters
    ----------
    pressure, q, in_contact : load [Pa], leakage [m²/s] and contact fraction at the steps of the branch (n,).
    slope_ratio : rms slope of the surface, divided by its rms slope before waves were removed.
    loads : loads before the multiplication (m,) [Pa].

    Returns the leakage (m,) [m²/s]. It is 0 if the reduced load is at least the lowest load of a sealed step, and inf
    if it is unknown.
    """
    is_open = (q > 0) & (pressure > 0)
    order = np.argsort(pressure[is_open])
    ln_load = np.log(pressure[is_open])[order]  # of the leaking steps, in increasing order
    ln_leakage = np.log(q[is_open])[order]
    lowest_sealed = np.log(pressure[(q == 0) & (pressure > 0)].min(initial=np.inf))
    with np.errstate(divide="ignore", invalid="ignore"):
        reduced = np.log(loads) + LOAD_POWER * np.log(slope_ratio)
        leakage = np.full(loads.shape, np.inf)
        if ln_load.size == 1 and slope_ratio < _LEAST_SLOPE_RATIO:
            # too far to extrapolate from one load; at higher loads, the leakage is at most as large as there
            leakage[reduced >= ln_load[0]] = np.exp(ln_leakage[0])
        elif ln_load.size == 1:
            slope = STEEPEST * float(expected_sensitivity(in_contact[is_open])[0])
            leakage = np.exp(ln_leakage[0] + slope * np.maximum(ln_load[0] - reduced, 0.0))
        elif ln_load.size:
            slope = (ln_leakage[1] - ln_leakage[0]) / (ln_load[1] - ln_load[0])
            extrapolated = ln_leakage[0] + slope * (reduced - ln_load[0])
            interpolated = np.interp(reduced, ln_load, ln_leakage)
            leakage = np.exp(np.where(reduced < ln_load[0], extrapolated, interpolated))
    return np.where((reduced >= lowest_sealed) | (loads <= 0), 0.0, leakage)

"""Estimate the error of a leakage due to missing waves of the surface.

Waves are missing because a low-pass filter removed them, or because the instrument did not resolve them. If the
spectrum is extrapolated, the added waves have arbitrary phases, and even shorter waves are still missing.

The effect of the missing waves on the leakage has an upper bound. If the missing waves were added, the surface would be
steeper. Its gap would then be about as large as that of the smoother surface under a lower load. By Persson's theory,
the contact fraction is erf(c p/(E* h')), where p is the pressure, E* the contact modulus, h' the rms slope and c a
constant. Let κ be the rms slope of the smoother surface divided by the rms slope of the complete surface. By Persson's
theory, the smoother surface under the pressure κ p has the same contact fraction as the complete surface under the
pressure p. Measurements on many surfaces gave a similar relation for the leakage, see `LOAD_POWER`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import erf, erfinv, stdtrit

from ..base import Array, Flags, as_text
from ..loads import LoadProgramme
from ..studies import Scene
from ..studies.patch_interval import COVERAGE
from .error_parts import ErrorPart
from .leakage_changes import STEEPEST, CoarserSolution, expected_sensitivity, part_of_changes
from .wide_intervals import VAGUE

#: The error of ln(leakage) due to removed waves is _ERROR √(s² + o²), where s and o are two estimates. Let r be the
#: mean square slope of the removed waves, divided by the mean square slope of the remaining waves. The estimate from
#: the contact state is s = _BY_STATE r^_POWER |d ln(leakage)/d ln(load)|, with the slope of `expected_sensitivity`. The
#: estimate from the octave, o, is the change of ln(leakage) when the shortest octave of the remaining waves is also
#: removed, multiplied by (r/r_o)^_POWER, but at most by 1. The ratio r_o is the mean square slope of this octave,
#: divided by the mean square slope of the remaining waves. Measured on 90 files of three kinds, see
#: docs/evidence/error_budget.md.
_POWER, _BY_STATE, _ERROR = 0.4, 0.4, 0.8
#: The surface may be sealed if the estimate s of the error of ln(leakage), see `_ERROR`, is larger than this limit. At
#: 38 of 1739 loads, the removed waves sealed the surface. The estimate s is above the limit at 30 of these 38 loads,
#: and at one in eleven of all loads.
_MAY_CLOSE = 1.5
#: Largest change of ln(leakage) that is used. Larger changes are reduced to this value, because the surface may even be
#: sealed without the octave.
_MOST_CHANGE = float(np.log(VAGUE))
#: The removed waves have the same effect as a load that is multiplied by κ**LOAD_POWER, where κ is the remaining
#: fraction of the rms slope. Measured on 96 surfaces of four kinds, see docs/evidence/error_budget.md: with a power of
#: 1, the leakage exceeds the upper end at one load in 106; with a power of 1.25, it does so at one load in 425.
LOAD_POWER = 1.25
#: Smallest remaining fraction κ of the rms slope for which the leakage is extrapolated from a single load.
_LEAST_SLOPE_RATIO = 0.5
#: A surface is sealed for certain if its contact fraction with all waves is at least this value. The largest contact
#: fraction of an open surface was 0.58.
SEALED_CONTACT = 0.6


def filter_part(
    scene: Scene,
    leakage: Array,
    in_contact: Array,
    filtered: CoarserSolution,
    slope_ratio: float,
) -> ErrorPart:
    """Estimate the error that the filter causes, from the slope of the removed waves and a solution with fewer waves.

    For the solution with fewer waves, the shortest octave of the remaining waves is removed as well. The error of
    ln(leakage) is computed from two estimates, `s` from the contact state and `o` from the solution with fewer waves,
    see `_ERROR`. On unloading, the error is at least as large as at the highest load before unloading. The lower end of
    the interval is 0 if the estimate `s` is so large that the surface with the removed waves may be sealed.

    Parameters
    ----------
    scene : input of the study.
    leakage : array (steps,), m²/s.
    in_contact : contact fraction, array (steps,).
    filtered : solution in which the shortest octave of the remaining waves is removed as well.
    slope_ratio : rms slope of the surface, divided by its rms slope before the waves were removed.
    """
    steps = scene.steps
    change = filtered.change(leakage)
    # r and r_o of `_ERROR`: mean square slopes of the removed waves and of the octave, divided by the mean square slope
    # of the surface
    removed = 1 / slope_ratio**2 - 1
    octave = 1.0  # if the solution does not state its rms slope
    if filtered.rms_slope is not None and scene.surface.rms_slope:
        octave = max(1 - (filtered.rms_slope / scene.surface.rms_slope) ** 2, 0.0)
    octave_factor = 1.0
    if octave:
        octave_factor = min(removed / octave, 1.0) ** _POWER
    octave_estimate = octave_factor * np.minimum(np.abs(change), _MOST_CHANGE)  # o
    state_estimate = _BY_STATE * expected_sensitivity(in_contact) * removed**_POWER  # s
    distance = _ERROR * np.hypot(octave_estimate, state_estimate)
    distance = np.fmax(distance, distance[steps.peak_indices])
    below = np.where(_ERROR * state_estimate > _MAY_CLOSE, np.inf, distance)
    note = (
        f"removed waves have {as_text(1 - slope_ratio, percent=True)} of the rms slope; estimated from it, from the "
        "contact fraction, and from the change of ln(leakage) without the shortest octave of the remaining waves"
    )
    return part_of_changes(
        "filter", steps, leakage, below, distance, note, change=change, coarse=filtered
    )


def continuation_part(
    scene: Scene,
    leakage: Array,
    in_contact: Array,
    others: Sequence[CoarserSolution],
    shorter: CoarserSolution,
    slope_ratio: float,
) -> ErrorPart:
    """Estimate the error of extrapolating the spectrum to waves that were not measured.

    The half-width of the interval of ln(leakage) is √(a² + b²), with two contributions `a` and `b`. The contribution
    `a` is the scatter of ln(leakage) between surfaces whose extrapolated waves have different random phases. The phases
    of the true surface are unknown. The true surface is treated as one more sample of such surfaces, and `a` is the
    half-width of Student's prediction interval for it. The contribution `b` is the effect of waves shorter than the
    cut-off wavelength, see `filter_part`.

    Parameters
    ----------
    scene : input of the study.
    leakage : array (steps,), m²/s.
    in_contact : contact fraction, array (steps,).
    others : solutions in which the extrapolated waves have different random phases.
    shorter : solution without the shortest octave of the waves above the cut-off.
    slope_ratio : rms slope of the surface, divided by its rms slope with the relevant waves below the cut-off.
    """
    steps = scene.steps
    n = len(others) + 1
    changes = np.array([other.change(leakage) for other in others])  # (solution, step)
    # infinite changes, at steps that other phases open or seal, are treated at the end
    finite = np.where(np.isinf(changes), 0.0, changes)
    # the surface of the study itself is one of the n samples, with a change of 0
    samples = np.vstack([np.zeros(len(steps)), finite])
    mean = samples.mean(axis=0)
    deviation = samples.std(axis=0, ddof=1)
    # contribution a: the change for the true surface lies between mean − scatter and mean + scatter
    scatter = stdtrit(n - 1, (1 + COVERAGE) / 2) * np.sqrt(1 + 1 / n) * deviation
    # contribution b, as distances from ln(leakage) to both ends of the interval
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
    """Raise the upper ends of an interval to a bound computed from the slope of the removed waves.

    With the removed waves, the surface would leak no more than the filtered surface does under a lower load, see
    `under_less_load`. If the leakage under the lower load is unknown at a sealed step, the upper end at the sealed step
    is inf.

    Parameters
    ----------
    part : error source whose interval is raised.
    steps : the load programme.
    leakage, in_contact : leakage [m²/s] and contact fraction at every step, arrays (steps,).
    slope_ratio : rms slope of the surface, divided by its rms slope before waves were removed; 1 if no waves were
        removed.
    """
    bound = under_less_load(steps, np.abs(np.asarray(leakage, float)), in_contact, slope_ratio)
    is_raised = bound > part.upper  # False for an unknown end, which stays unknown
    if not is_raised.any():
        return part
    load_ratio = f"{slope_ratio**LOAD_POWER:.2g}"
    note = f"{part.note}; no less than under {load_ratio} times the load, for the slope that was removed"
    return replace(part, upper=np.where(is_raised, bound, part.upper), note=note)


def sealed_for_certain(in_contact: Array, slope_ratio: float = 1.0) -> Flags:
    """Flag the steps (steps,) at which the surface would certainly be sealed if the removed waves were still present.

    Let A be the contact fraction of the filtered surface, and κ the slope ratio. By Persson's theory, the contact
    fraction of the surface with the removed waves is erf(κ erfinv(A)). The surface is certainly sealed if this contact
    fraction is at least `SEALED_CONTACT`. The result is False where the contact fraction A is unknown.
    """
    with np.errstate(invalid="ignore"):
        complete_contact = erf(slope_ratio * erfinv(np.clip(in_contact, 0.0, 1.0)))
        return complete_contact >= SEALED_CONTACT


def under_less_load(steps: LoadProgramme, q: Array, in_contact: Array, slope_ratio: float) -> Array:
    """Estimate the leakage (steps,) at the reduced load of each step, which is its load times slope_ratio**LOAD_POWER.

    The leakage under the reduced load is 0 if the surface is sealed both under the load of the step and under the
    reduced load.

    At a step on unloading, the leakage under the reduced load is read from the same unloading branch. If all loads of
    the cycle were reduced, the highest load before unloading would be lower as well. The leakage on unloading is
    therefore multiplied by the factor by which the leakage at the highest load increases. The leakage on unloading is
    limited to the leakage on loading under the same reduced load.

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
        p[loading],
        q[loading],
        in_contact[loading],
        slope_ratio=slope_ratio,
        loads=p[loading],
    )
    for unloading in unloadings:
        peak = int(steps.peak_indices[unloading[0]])
        branch = np.append(unloading, peak)
        on_branch = _on_branch(
            p[branch],
            q[branch],
            in_contact[branch],
            slope_ratio=slope_ratio,
            loads=p[unloading],
        )
        # if all loads of the cycle are reduced, the unloading also begins at a lower load
        if q[peak] > 0:
            on_branch = on_branch * (estimate[peak] / q[peak])
        else:
            on_branch = np.maximum(on_branch, estimate[peak])
        on_loading = _on_branch(
            p[loading],
            q[loading],
            in_contact[loading],
            slope_ratio=slope_ratio,
            loads=p[unloading],
        )
        estimate[unloading] = np.minimum(on_branch, on_loading)
    estimate[(q == 0) & sealed_for_certain(in_contact, slope_ratio)] = 0.0
    return np.where(np.isnan(q), np.nan, np.maximum(estimate, q))


def _on_branch(
    pressure: Array, q: Array, in_contact: Array, *, slope_ratio: float, loads: Array
) -> Array:
    """Interpolate the leakage on one branch of the load cycle at reduced loads.

    The reduced loads are `loads`, multiplied by slope_ratio**LOAD_POWER. ln(leakage) is interpolated linearly over
    ln(load), and extrapolated below the lowest load. If the seal leaks only at one load, ln(leakage) is extrapolated
    with the steep slope `STEEPEST` times `expected_sensitivity`.

    Parameters
    ----------
    pressure, q, in_contact : load [Pa], leakage [m²/s] and contact fraction at the steps of the branch (n,).
    slope_ratio : rms slope of the surface, divided by its rms slope before waves were removed.
    loads : loads before the reduction (m,) [Pa].

    Returns the leakage (m,) [m²/s]: 0 if the reduced load is at least the lowest load at which the seal is tight, and
    inf if the leakage under the reduced load is unknown.
    """
    is_open = (q > 0) & (pressure > 0)
    order = np.argsort(pressure[is_open])
    ln_load = np.log(pressure[is_open])[order]  # of the leaking steps, in increasing order
    ln_leakage = np.log(q[is_open])[order]
    lowest_sealed = np.log(pressure[(q == 0) & (pressure > 0)].min(initial=np.inf))
    with np.errstate(divide="ignore", invalid="ignore"):
        reduced = np.log(loads) + LOAD_POWER * np.log(slope_ratio)  # ln(reduced load)
        leakage = np.full(loads.shape, np.inf)  # unknown, unless one of the cases below applies
        if ln_load.size == 1 and slope_ratio < _LEAST_SLOPE_RATIO:
            # too far to extrapolate from one load; at higher loads, the leakage is at most as large as there
            leakage[reduced >= ln_load[0]] = np.exp(ln_leakage[0])
        elif ln_load.size == 1:
            slope = STEEPEST * float(expected_sensitivity(in_contact[is_open])[0])
            leakage = np.exp(ln_leakage[0] + slope * np.maximum(ln_load[0] - reduced, 0.0))
        elif ln_load.size:
            # extrapolate by the line through the two lowest loads
            slope = (ln_leakage[1] - ln_leakage[0]) / (ln_load[1] - ln_load[0])
            extrapolated = ln_leakage[0] + slope * (reduced - ln_load[0])
            interpolated = np.interp(reduced, ln_load, ln_leakage)
            leakage = np.exp(np.where(reduced < ln_load[0], extrapolated, interpolated))
    return np.where((reduced >= lowest_sealed) | (loads <= 0), 0.0, leakage)

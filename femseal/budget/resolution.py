"""Estimate the error of a leakage that is caused by missing waves of the surface, or by solving on one grid only.

Waves are missing that a low-pass filter removed or that the instrument did not resolve. Where a spectrum is continued,
the phases of the continued waves are arbitrary, and waves beyond its cut-off are still missing.

The effect of the missing waves has an upper bound. With these waves the surface would be steeper, and its faces would
be as far apart as the smoother faces are under a lower load. By Persson's theory the contact fraction is
erf(c p/(E* h')) with the rms slope h'. If the smoother surface has κ times the slope of the complete one, it therefore
has the same contact fraction at the pressure κ p as the complete surface at p. Measurements show a similar relation for
the leakage, see `LOAD_POWER`.
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

#: The error of ln(leakage) by removed waves is _ERROR √(s² + o²), with two estimates of the error. Let r be the mean
#: square slope of the removed waves over that of the kept ones. Then s = _BY_STATE r^_POWER times the slope of
#: ln(leakage) over ln(load) that the contact fraction suggests, and o is the change of ln(leakage) without the shortest
#: octave, scaled by the same power. Measured on 90 files of three kinds, see docs/evidence/error_budget.md.
_POWER, _BY_STATE, _ERROR = 0.4, 0.4, 0.8
#: The surface may be sealed if the error by the contact state is larger than this. Of 1739 loads, 38 were sealed by the
#: removed waves; 30 of these lie above the limit, and one in eleven of all loads.
_MAY_CLOSE = 1.5
#: Largest change of ln(leakage) that counts, because the surface may be sealed without the octave.
_MOST_CHANGE = float(np.log(VAGUE))
#: The removed waves act as a load that is lower by this power of the kept fraction of the slope. Measured on 96
#: surfaces of four kinds, see docs/evidence/error_budget.md: with a power of 1 one load of 106 leaks more than the
#: upper end, with 1.25 one of 425.
LOAD_POWER = 1.25
#: Least kept fraction of the slope for an estimate from a single load.
_LEAST_KEPT = 0.5
#: Contact fraction with all waves above which a surface is sealed for certain. The largest of an open surface was 0.58.
SEALED_CONTACT = 0.6


def one_grid_part(leakage: Array, in_contact: Array) -> list[ErrorPart]:
    """Estimate the error of the pixel size for a scene that was solved on one grid only.

    A step that is sealed on this grid may in truth be open, unless its contact fraction rules that out.

    in_contact : contact fraction at every step (steps,). The list is empty where no step may be open.
    """
    q = np.abs(np.asarray(leakage, float))
    may_open = (q == 0) & ~sealed_for_certain(in_contact)
    note = "one grid, which does not tell by how much load a sealed face is sealed"
    return [ErrorPart("pixels", q, np.where(may_open, np.inf, q), note)] if may_open.any() else []


def filter_part(
    scene: Scene,
    leakage: Array,
    in_contact: Array,
    filtered: CoarserSolution,
    kept: float,
    name: str = "filter",
) -> ErrorPart:
    """Estimate the error that the filter causes, from the slope of the removed waves and a solution with fewer waves.

    The additional solution lacks the shortest octave of the remaining waves. The estimate depends on the contact state
    alone, not on other loads. On unloading it is at least as large as at the peak. Where most of the slope was removed,
    the removed waves may also seal the surface.

    Parameters
    ----------
    scene : input of the study.
    leakage : array (steps,), m²/s.
    in_contact : contact fraction, array (steps,).
    filtered : solution without the shortest octave of waves.
    kept : rms slope of the surface over its rms slope with the removed waves.
    name : of the part.
    """
    steps = scene.steps
    change = filtered.change(leakage)
    removed = 1 / kept**2 - 1
    octave = 1.0
    if filtered.rms_slope is not None and scene.surface.rms_slope:
        octave = max(1 - (filtered.rms_slope / scene.surface.rms_slope) ** 2, 0.0)
    share = min(removed / octave, 1.0) ** _POWER if octave else 1.0
    by_octave = share * np.minimum(np.abs(change), _MOST_CHANGE)
    by_state = _BY_STATE * expected_sensitivity(in_contact) * removed**_POWER
    distance = _ERROR * np.hypot(by_octave, by_state)
    distance = np.fmax(distance, distance[steps.peak_indices])
    below = np.where(_ERROR * by_state > _MAY_CLOSE, np.inf, distance)
    note = (
        f"removed waves have {as_text(1 - kept, percent=True)} of the rms slope; by it, the fraction in contact, "
        "and the change of ln(leakage) without the shortest octave that is kept"
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
    kept: float,
) -> ErrorPart:
    """Estimate the error that is caused by continuing the spectrum.

    Two contributions are combined as the square root of the sum of their squares. The first is the scatter between
    random phases of the continued waves. It is Student's prediction interval for one more realisation, because the true
    surface is like one more realisation. The second is the effect of waves beyond the cut-off, see `filter_part`.

    Parameters
    ----------
    scene : input of the study.
    leakage : array (steps,), m²/s.
    in_contact : contact fraction, array (steps,).
    others : solutions with other phases.
    shorter : solution without the shortest octave of waves.
    kept : rms slope of the surface over its rms slope with those waves beyond the cut-off that count.
    """
    steps, n = scene.steps, len(others) + 1
    changes = np.array([other.change(leakage) for other in others])
    finite = np.where(np.isinf(changes), 0.0, changes)
    every = np.vstack([np.zeros(len(steps)), finite])
    mean, scatter = every.mean(axis=0), every.std(axis=0, ddof=1)
    interval = stdtrit(n - 1, (1 + COVERAGE) / 2) * np.sqrt(1 + 1 / n) * scatter
    trend = filter_part(scene, leakage, in_contact, shorter, kept)
    q = np.abs(leakage)
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = [
            np.nan_to_num(np.log(pair), nan=0.0) for pair in (q / trend.lower, trend.upper / q)
        ]
    below, above = (
        np.hypot(np.maximum(interval + s * mean, 0.0), t)
        for s, t in zip((-1, 1), sides, strict=True)
    )
    below = np.where(np.isneginf(changes).any(axis=0), np.inf, below)
    opened = np.where(np.isposinf(changes).any(axis=0), np.inf, changes.sum(axis=0))
    leakiest = max(others, key=lambda other: float(np.nansum(np.abs(other.leakage))))
    note = (
        f"{n} realisations by Student's interval, and waves beyond the cut-off, which have "
        f"{as_text(1 - kept, percent=True)} of the rms slope"
    )
    return part_of_changes(
        "continuation", steps, leakage, below, above, note, change=opened, coarse=leakiest
    )


def raised_by_slope(
    part: ErrorPart, steps: LoadProgramme, leakage: Array, in_contact: Array, kept: float
) -> ErrorPart:
    """Raise the upper ends of an interval to at least the upper bound that follows from the removed slope.

    The bound is the leakage of the present surface under a lower load, see `under_less_load`.

    Parameters
    ----------
    leakage, in_contact : leakage [m²/s] and contact fraction at every step, arrays (steps,).
    kept : rms slope of the surface over its rms slope with the removed waves; 1 where none were removed.

    The upper end of a sealed step is inf where no load shows how much it would leak.
    """
    least = under_less_load(steps, np.abs(np.asarray(leakage, float)), in_contact, kept)
    raised = least > part.upper  # an unknown end stays so
    note = f"{part.note}; no less than under {kept**LOAD_POWER:.2g} times the load, for the slope that was removed"
    return replace(
        part, upper=np.where(raised, least, part.upper), note=note if raised.any() else part.note
    )


def sealed_for_certain(in_contact: Array, kept: float = 1.0) -> Flags:
    """Return at which steps the surface would be sealed even with its removed waves (steps,).

    This is certain where the contact fraction is large enough. It is False where the contact fraction is unknown.
    """
    with np.errstate(invalid="ignore"):
        return erf(kept * erfinv(np.clip(in_contact, 0.0, 1.0))) >= SEALED_CONTACT


def under_less_load(steps: LoadProgramme, q: Array, in_contact: Array, kept: float) -> Array:
    """Estimate the leakage at every step under kept**LOAD_POWER times its load (steps,).

    It is 0 where the seal is sealed there too.
    Loads of unloading are evaluated on their own branch. They leak more by the same factor as their peak does, but no
    more than on loading.
    """
    relieved, p = np.array(q, float), steps.pressures
    if kept == 1:
        return relieved
    rising, *ways = steps.branches
    relieved[rising] = _on_branch(p[rising], q[rising], kept, p[rising], in_contact[rising])
    for unloading in ways:
        peak = int(steps.peak_indices[unloading[0]])
        branch = np.append(unloading, peak)
        on_branch = _on_branch(p[branch], q[branch], kept, p[unloading], in_contact[branch])
        if q[peak] > 0:
            on_branch = on_branch * (relieved[peak] / q[peak])
        else:
            on_branch = np.maximum(on_branch, relieved[peak])
        on_loading = _on_branch(p[rising], q[rising], kept, p[unloading], in_contact[rising])
        relieved[unloading] = np.minimum(on_branch, on_loading)
    relieved[(q == 0) & sealed_for_certain(in_contact, kept)] = 0.0
    return np.where(np.isnan(q), np.nan, np.maximum(relieved, q))


def _on_branch(pressure: Array, q: Array, kept: float, at: Array, in_contact: Array) -> Array:
    """Interpolate the leakage under kept**LOAD_POWER times the loads `at` on one branch; inf where it is unknown.

    The interpolation is linear in logarithms. It is extrapolated below the lowest load; from a single load with the
    largest slope that its contact fraction suggests.
    """
    opened = (q > 0) & (pressure > 0)
    order = np.argsort(pressure[opened])
    x = np.log(pressure[opened])[order]
    y = np.log(q[opened])[order]
    closed = np.log(pressure[(q == 0) & (pressure > 0)].min(initial=np.inf))
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.log(at) + LOAD_POWER * np.log(kept)
        found = np.full(at.shape, np.inf)
        if x.size == 1 and kept < _LEAST_KEPT:
            found[place >= x[0]] = np.exp(y[0])
        elif x.size == 1:
            slope = STEEPEST * float(expected_sensitivity(in_contact[opened])[0])
            found = np.exp(y[0] + slope * np.maximum(x[0] - place, 0.0))
        elif x.size:
            below = y[0] + (y[1] - y[0]) / (x[1] - x[0]) * (place - x[0])
            found = np.exp(np.where(place < x[0], below, np.interp(place, x, y)))
    return np.where((place >= closed) | (at <= 0), 0.0, found)

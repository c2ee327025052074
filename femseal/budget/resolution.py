"""Errors of a leakage by waves that the face does not have, and of one that was solved on one grid.

Waves that the face does not have are those a low-pass removed, and those nobody measured. Of waves that continue a
spectrum the phases count, and those beyond. Waves that a low-pass took lie below an upper end: put back they keep the
faces apart as a lower load would: by Persson's theory the fraction in contact is erf(c p / (E* h')), with the rms slope
h', so that a face of κ times its slope has at κ p the contact of the whole one at p. The same was measured of leakage,
see `LOAD_POWER`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import erf, erfinv, stdtrit

from ..base import Array, Flags, as_text
from ..loads import LoadProgramme
from ..studies import Scene
from ..studies.drawn_error import COVERAGE
from .error_parts import (
    STEEPEST,
    VAGUE,
    CoarserSolution,
    ErrorPart,
    expected_sensitivity,
    part_of_changes,
)

#: Error of ln(leakage) by removed waves: with their slope² over that of the waves that are kept, to this power,
_POWER = 0.4
#: times the slope of ln(leakage) over ln(load) that the contact state lets expect and this factor,
_BY_STATE = 0.4
#: and times the change without the shortest octave that is kept; both as a root of squares, times this factor.
#: Measured on 90 files of three kinds, with all, a tenth and none of the slope² of the removed waves, see
#: docs/evidence/error_budget.md.
_ERROR = 0.8
#: Error of ln(leakage) by the contact state from which on the surface may be sealed: of 1739 loads 30 of 38 that the
#: removed waves seal are above, and one in eleven of all.
_MAY_CLOSE = 1.5
#: Largest change of ln(leakage) that counts: without the octave the surface may be sealed.
_MOST_CHANGE = float(np.log(VAGUE))
#: Power of the fraction of the slope that is kept, by which the load is taken as lower. Measured on 96 faces of four
#: kinds, see docs/evidence/error_budget.md: with 1 one load of 106 leaks more than the upper end, with 1.25
#: one of 425.
LOAD_POWER = 1.25
#: Fraction of the slope that must be kept where the leakage is known at one load only.
_LEAST_KEPT = 0.5
#: Fraction in contact with all waves from which on a face is sealed for certain: the largest of an open one was 0.58.
SEALED_CONTACT = 0.6


def one_grid_part(leakage: Array, in_contact: Array) -> list[ErrorPart]:
    """Part of the pixels of a scene that was solved on one grid: what is sealed there may be open, unless by far.

    in_contact : fraction in contact at every step (steps,). Empty where nothing is sealed but for certain.
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
    """Estimate what removed waves do to the leakage, from their slope and from the shortest octave that is kept.

    It depends on the contact state alone, not on other loads; after unloading it is no less than at the peak. Where by
    far the most of the slope was removed, the removed waves may also seal the surface.

    in_contact : fraction in contact at every step (steps,). filtered : without the shortest octave of waves.
    kept : rms slope over that with the removed waves.
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
    """Part of the continued waves: scatter between realisations and trend with the cut-off, as a root of squares.

    The scatter is Student's interval of one more realisation: the face has phases of its own. The trend is what waves
    beyond the cut-off do, see `filter_part`.

    in_contact : fraction in contact at every step (steps,). others : with other phases. shorter : without the shortest
    octave of waves. kept : rms slope over that with the waves beyond the cut-off that count.
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
    """The part with upper ends that are at least the leakage under the load of the removed waves.

    leakage, in_contact : leakage and fraction in contact at every step (steps,). kept : rms slope over that with the
        removed waves; 1: none were removed. The upper end is inf at sealed steps where no load says what they leak.
    """
    least = under_less_load(steps, np.abs(np.asarray(leakage, float)), in_contact, kept)
    raised = least > part.upper  # an unknown end stays so
    note = f"{part.note}; no less than under {kept**LOAD_POWER:.2g} times the load, for the slope that was removed"
    return replace(
        part, upper=np.where(raised, least, part.upper), note=note if raised.any() else part.note
    )


def sealed_for_certain(in_contact: Array, kept: float = 1.0) -> Flags:
    """Whether the face with its removed waves has too much contact to be open (steps,); False where it is unknown."""
    with np.errstate(invalid="ignore"):
        return erf(kept * erfinv(np.clip(in_contact, 0.0, 1.0))) >= SEALED_CONTACT


def under_less_load(steps: LoadProgramme, q: Array, in_contact: Array, kept: float) -> Array:
    """Leakage at every step under kept**LOAD_POWER times its load (steps,), 0 where it is sealed there too.

    Loads of unloading are taken on their own branch, and leak more by as much as their peak does, but no more than on
    loading.
    """
    found, p = np.array(q, float), steps.pressures
    if kept == 1:
        return found
    rising, *ways = steps.branches
    found[rising] = _on_branch(p[rising], q[rising], kept, p[rising], in_contact[rising])
    for down in ways:
        top = int(steps.peak_indices[down[0]])
        way = np.append(down, top)
        rise, lower = (found[top] / q[top], 0.0) if q[top] > 0 else (1.0, found[top])
        own = np.maximum(rise * _on_branch(p[way], q[way], kept, p[down], in_contact[way]), lower)
        on_loading = _on_branch(p[rising], q[rising], kept, p[down], in_contact[rising])
        found[down] = np.minimum(own, on_loading)
    found[(q == 0) & sealed_for_certain(in_contact, kept)] = 0.0
    return np.where(np.isnan(q), np.nan, np.maximum(found, q))


def _on_branch(pressure: Array, q: Array, kept: float, at: Array, in_contact: Array) -> Array:
    """Leakage under kept**LOAD_POWER times the loads `at`, from that of a branch; inf where nothing gives it.

    It is straight in logarithms, and carried on below the lowest load; from a single load by the largest slope that
    its contact lets expect.
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

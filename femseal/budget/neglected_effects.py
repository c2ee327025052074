"""Estimate the errors caused by effects that the model neglects or treats approximately."""

from __future__ import annotations

from math import sqrt

import numpy as np
from scipy.special import stdtrit

from ..base import Array
from ..checks import FormEffect
from ..loads import LoadProgramme
from ..studies import Scene, StudyResult
from ..studies.patch_interval import COVERAGE
from .error_parts import ErrorPart
from .leakage_changes import part_of_changes, sensitivity

#: Smallest error of ln(leakage) for which "thin gap" is listed as an error source. An rms slope of 0.14 causes an error
#: of this size.
_LEAST_SLOPE_ERROR = 0.02


def effective_pressure_part(scene: Scene, study: StudyResult) -> ErrorPart | None:
    """Estimate the error of reducing the load of a cell by the fluid pressure instead of coupling contact and flow.

    The error is only estimated for stochastic seals with cells at random, if the fluid pressure acts on the surfaces.
    The function returns None for a study to which the error does not apply.

    The error of ln(leakage) is taken as a fraction of the change that the fluid pressure causes in it. The fraction was
    measured on seven surfaces whose width is four times their longest wavelength, under inlet pressures of 0.1 to 1
    times the nominal pressure. The computed ln(leakage) was too large by at most one half, or too small by at most one
    fifth, of the change due to the fluid pressure. For wider seals, the error is smaller.
    """
    fluid = scene.acting_fluid
    if fluid is None or not study.takes_random_cells:
        return None
    note = "cells under their effective pressure against a coupled face, measured on faces four waves broad"
    q = study.predicted_leakage
    carried = abs(fluid.mean_if_separated)  # nominal pressure that the fluid carries [Pa]
    # a load below the part that the fluid carries is raised to this part; the tiny number prevents a division by 0
    loads = np.maximum(study.steps.pressures, max(carried, 1e-300))
    slope = sensitivity(study.steps, q, study.contact_fraction_at(study.steps))
    # change of ln(leakage) due to the part of the load that the fluid carries
    effect = slope * carried / loads
    below = 0.5 * effect
    above = 0.2 * effect
    return part_of_changes("effective pressure", study.steps, q, below, above, note)


def patch_form_part(
    effect: FormEffect, steps: LoadProgramme, leakage: Array, *, rises: bool = False
) -> ErrorPart | None:
    """Estimate the error that arises because the curvature of a patch may be either form deviation or roughness.

    The curvature of the patch may belong to the form deviation or to the roughness, and the seal may be more curved
    than the patch. Each end of the interval is as far from ln(leakage) as ln(leakage) changes when the curvature is
    removed. On unloading, the distance is at least as large as at the highest load before unloading.

    In a test with eight maps and 140 loads, the leakage of a quarter of each map was compared with that of the whole
    map. In 49 % of the cases, the leakage of the whole map was between half and twice the leakage of the quarter. When
    this interval was extended at one end by the change of ln(leakage), it contained the leakage of the whole map in 56
    % of the cases. Extended at both ends, it did so in 61 %.

    rises : whether the spectrum of the patch rises towards long waves, so that the seal probably has longer waves than
        the patch. If True, the effect of the longest waves of the patch is included.

    Returns None if the change of ln(leakage) without the curvature is unknown.
    """
    distance = effect.distance(steps.pressures, rises)
    if distance is None:
        return None
    distance = np.maximum(distance, distance[steps.peak_indices])
    what = "its curvature or its longest waves" if rises else "the curvature of the patch"
    note = f"change of ln(leakage) without {what}, on either side, solved on few points"
    return part_of_changes("form of the patch", steps, leakage, distance, distance, note)


def thin_gap_part(scene: Scene, leakage: Array) -> ErrorPart | None:
    """Estimate how much Reynolds' equation overestimates the flow through a gap that is not thin.

    Reynolds' equation overestimates the flow by a factor of at most 1 + h'², where h' is the rms slope. The factor
    follows from next-order lubrication theory for the gap h between a plane and a rough wall. The permeability k is
    given by 1/(12 k) = ⟨(1 + 4h'²/5)/h³⟩ for flow across ridges, and by 12 k = ⟨h³(1 − h'²)⟩ for flow along ridges.

    The result is None if the error of ln(leakage) is below `_LEAST_SLOPE_ERROR`.
    """
    distance = np.full(np.shape(leakage), np.log1p(scene.surface.rms_slope**2))
    if distance[0] < _LEAST_SLOPE_ERROR:
        return None
    note = "Stokes flow instead of Reynolds flow at this rms slope, by the next order of lubrication theory"
    return ErrorPart.from_distances("thin gap", leakage, distance, np.zeros_like(distance), note)


def longer_waves_part(
    changes: Array, flatness: bool, steps: LoadProgramme, leakage: Array
) -> ErrorPart:
    """Estimate the error of leaving out the waves that are longer than the patch.

    The change of ln(leakage) was computed for n random samples of waves longer than the patch. The true long waves of
    the seal are treated as one more sample. The interval of ln(leakage) is Student's prediction interval for a further
    sample, m ± t s √(1 + 1/n), where m and s are the mean and the standard deviation of the n changes, and t is the
    quantile of Student's distribution.

    Parameters
    ----------
    changes : changes of ln(leakage) due to random waves longer than the patch, array (samples, steps).
    flatness : whether a flatness tolerance limits the heights of the long waves.
    steps : the load programme.
    leakage : array (steps,), m²/s.
    """
    count = len(changes)
    with np.errstate(invalid="ignore"):
        mean = changes.mean(axis=0)
        deviation = changes.std(axis=0, ddof=1)
    distance = stdtrit(count - 1, (1 + COVERAGE) / 2) * deviation * sqrt(1 + 1 / count)
    below = np.maximum(-mean + distance, 0.0)
    above = np.maximum(mean + distance, 0.0)
    # both ends are unknown if a sample is sealed, or if its change is unknown
    below = np.where(np.isfinite(below), below, np.inf)
    above = np.where(np.isfinite(above), above, np.inf)
    limit = (
        "limited by the flatness of the seal"
        if flatness
        else "as no `flatness` in [seal] limits it"
    )
    note = f"{count} samples of longer waves; the spectrum is continued to the breadth of the seal, {limit}"
    return part_of_changes("longer waves", steps, leakage, below, above, note)

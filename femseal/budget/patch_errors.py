"""Estimate the error of a leakage that was computed from measured patches, or block by block."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
from scipy.special import ndtri, stdtrit

from ..base import Array
from ..studies.patch_interval import COVERAGE, interval_widths
from ..studies.patch_state import PatchState
from .error_parts import ErrorPart

#: Degrees of freedom that are assumed for the variance expected from the contact state, when it is averaged with the
#: measured variance between patches.
_PATCH_FREEDOM = 2
#: Half-width of the 95 % interval of a normal distribution, in standard deviations.
_NORMAL = float(ndtri((1 + COVERAGE) / 2))
#: Descriptions of what the calibration set compares with a whole surface, for the note of an error source.
_WHAT = {
    "in order": "seals as broad as the patch, with its cells in order",
    "at random": "seals of another breadth or shape than the patch, with its cells at random",
    "with form": "seals whose form is known at points, with the cells of one patch at random",
    "by blocks": "a surface that was solved by blocks",
}


def patches_part(leakage: Array, without: Array, usual: ErrorPart) -> ErrorPart:
    """Estimate how far the mean leakage of several measured patches may deviate from that of the whole surface.

    The variance of ln(leakage) is the mean of two estimates, weighted by their degrees of freedom. One estimate is the
    jackknife over the measured patches: each patch is left out once. The second estimate of the variance was measured
    on other surfaces in a similar contact state. The interval of ln(leakage) is taken from Student's distribution.

    If the computed leakage is 0 without one of the patches, a jackknife of ln(leakage) is impossible. The lower end
    of the interval is then 0, and its upper end is computed by a jackknife of the leakage itself instead of its
    logarithm.

    Parameters
    ----------
    leakage : array (steps,), m²/s.
    without : leakage that is computed without one of the patches, array (patch that is left out, steps), m²/s.
    usual : error source with the interval that is expected from the contact state and the number of patches, see
        `calibrated_part`.

    Source: Efron & Tibshirani, An Introduction to the Bootstrap, 1993, chapter 11.
    """
    count = len(without)
    freedom = _PATCH_FREEDOM + count - 1
    student = float(stdtrit(freedom, (1 + COVERAGE) / 2))
    q = np.abs(leakage)

    def half_width(values: Array, usual_half_width: Array) -> Array:
        """Compute the half-width (steps,) of Student's interval.

        values : ln(leakage) or leakage without one of the patches, array (patch that is left out, steps).
        usual_half_width : half-width that is expected from the contact state (steps,).
        """
        # The jackknife variance of a mean is (n − 1)/n Σ(v − v̄)² = (n − 1) var(v), where each value v leaves out one
        # of the n patches.
        jackknife_variance = (count - 1) * values.var(axis=0)
        usual_variance = (usual_half_width / _NORMAL) ** 2
        weighted_sum = _PATCH_FREEDOM * usual_variance + (count - 1) * jackknife_variance
        return student * np.sqrt(weighted_sum / freedom)

    # distances from ln(leakage) to the lower and to the upper end of the interval
    with np.errstate(divide="ignore", invalid="ignore"):
        usual_below = np.log(q / np.abs(usual.lower))
        usual_above = np.log(np.abs(usual.upper) / q)
        below = half_width(np.log(without), usual_below)
        above = half_width(np.log(without), usual_above)
        # jackknife in the leakage itself, as a fraction of its mean
        relative_above = half_width(without / without.mean(axis=0), usual_above)
    is_sealed_without_one = (without == 0).any(axis=0) & np.isfinite(without).all(axis=0)
    below = np.where(is_sealed_without_one, np.inf, below)
    above = np.where(is_sealed_without_one, np.log1p(relative_above), above)
    note = (
        f"Student's interval by the jackknife over {count} measured patches, in ln(leakage), with the scatter that is "
        f"usual for their contact state; {patches_to_halve(count)} more would halve it"
    )
    part = ErrorPart.from_distances("patches", leakage, below, above, note)
    # If the seal with all patches is sealed, its leakage without one of the patches shows how much it may leak. The
    # factor is that of Student's interval around the largest of these leakages, with a relative scatter of 1.
    upper_if_sealed = np.maximum((1 + student) * np.max(without, axis=0), usual.upper)
    return replace(part, upper=np.where(leakage == 0, upper_if_sealed, part.upper))


def patches_to_halve(count: int) -> int:
    """Return how many more patches must be measured to halve the 95 % interval of the leakage.

    count : number of measured patches, three or more.

    >>> patches_to_halve(3), patches_to_halve(4), patches_to_halve(8)
    (5, 8, 19)
    """

    def width(patches: int) -> float:
        """Return the half-width of the 95 % interval in units of the standard deviation between patches."""
        return float(stdtrit(_PATCH_FREEDOM + patches - 1, (1 + COVERAGE) / 2)) / sqrt(patches)

    more = 1
    while width(count + more) > 0.5 * width(count):
        more += 1
    return more


def calibrated_part(
    name: str, kind: str, leakage: Array, state: PatchState, patches: int = 1
) -> ErrorPart:
    """Estimate the error of a leakage that was computed from measured patches, or block by block.

    The error was measured on a calibration set of whole surfaces, see `patch_interval`. The error at a load step
    depends only on the contact state at this step.

    Parameters
    ----------
    name : name of the error source.
    kind : kind of the calculation, one of `patch_interval.COMPUTATIONS`.
    leakage : array (steps,), m²/s.
    state : contact state of the patches at every step.
    patches : number of measured patches.
    """
    widths = interval_widths(kind, patches)
    sign = np.where(np.asarray(leakage) < 0, -1.0, 1.0)
    lower, upper = (sign * end for end in widths.ends(leakage, state))
    note = (
        f"{_WHAT[kind]}: calibrated by split conformal prediction on {widths.scenes} whole surfaces"
    )
    return ErrorPart(name, lower, upper, note)

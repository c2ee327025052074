"""Estimate the errors that make up the error budget of a computed leakage.

There are three groups of errors: numerical errors, errors of a method, measured on a calibration set of surfaces, and
effects neglected by the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from math import sqrt

import numpy as np
from scipy.special import bdtr, ndtri, stdtrit

from ..base import Array, Flags, Pair, counted
from ..checks import FormEffect
from ..loads import LoadProgramme
from ..studies import Scene, StudyResult, study_of_result
from ..studies.patch_interval import COVERAGE, interval_widths
from ..studies.patch_state import PatchState
from .error_parts import ErrorBudget, ErrorPart
from .leakage_changes import CoarserSolution, part_of_changes, sensitivity
from .missing_waves import filter_part, raised_by_slope
from .pixel_size import USUAL_PIXELS, near_closing, one_grid_part, pixels_part

#: The residual r of the contact solution changes ln(leakage) by _RESIDUAL r s, where s is |d ln(leakage)/d ln(load)|,
#: or 1 if this slope is smaller. Measured on 24 surfaces at residuals of 1e-2 to 1e-6: a factor of 0.04 covers 95 of
#: 100 changes, and a factor of 0.5 covers all changes.
_RESIDUAL = 0.5
#: Change of ln(leakage) due to the residual of the flow solution; the relative error of its energy is 1e-6.
_FLOW = 1e-6

#: Smallest error of ln(leakage) for which "thin gap" is listed as an error source. An rms slope of 0.14 causes an error
#: of this size.
_LEAST_SLOPE_ERROR = 0.02

#: Degrees of freedom that are assumed for the variance expected from the contact state, when it is averaged with the
#: measured variance between patches.
_PATCH_FREEDOM = 2
#: Half-width of the 95 % interval of a normal distribution, in standard deviations.
_NORMAL = float(ndtri((1 + COVERAGE) / 2))
#: What the calibration set compares with a whole surface, for the note of an error source.
_WHAT = {
    "in order": "seals as broad as the patch, with its cells in order",
    "at random": "seals of another breadth or shape than the patch, with its cells at random",
    "with form": "seals whose form is known at points, with the cells of one patch at random",
    "by blocks": "a surface that was solved by blocks",
}
#: Factor by which intervals of numerical errors are widened near closing, where the leakage falls steeply, see
#: `near_closing`. Measured on 216 surfaces of six kinds: intervals near closing contained the true leakage in 93 of 100
#: cases with this factor, and in 83 of 100 cases without widening.
_NEAR_CLOSING = 3.0


def solver_part(scene: Scene, leakage: Array, in_contact: Array) -> ErrorPart:
    """Estimate the error of the contact and flow solvers from their residuals.

    A residual of the contact solution changes the leakage as a change of the load would. The change of ln(leakage) is
    proportional to the relative residual and to the slope |d ln(leakage)/d ln(load)|, see `_RESIDUAL`.
    """
    slope = sensitivity(scene.steps, leakage, in_contact)
    distance = _RESIDUAL * scene.rtol * np.maximum(slope, 1.0) + _FLOW
    note = f"contact residual {scene.rtol:.0e} as a change of the load, by the slope of ln(leakage) over ln(load)"
    return ErrorPart.from_distances("solver", leakage, distance, distance, note)


def patches_part(leakage: Array, without: Array, usual: ErrorPart) -> ErrorPart:
    """Estimate how far the mean leakage of several measured patches may deviate from that of the whole surface.

    The variance of ln(leakage) is the mean of two estimates, weighted by their degrees of freedom. One estimate is the
    jackknife over the measured patches: each patch is left out once. The second estimate of the variance was measured
    on other surfaces in a similar contact state. The interval of ln(leakage) is taken from Student's distribution.

    If the computed leakage is 0 without one of the patches, a jackknife of ln(leakage) is impossible. The interval of
    such a seal begins at 0, and its upper end is computed by a jackknife of the leakage itself instead of its
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


def realisations_part(leakage: Array) -> ErrorPart:
    """Estimate the error due to the finite number of realisations from the confidence interval of their median.

    leakage : leakage of each realisation at every step (realisations, steps) [m²/s].
    """
    note = f"interval of the median of {counted(len(leakage), 'realisation')} by its ranks"
    ends = np.array([median_interval(column) for column in leakage.T])
    return ErrorPart("realisations", ends[:, 0], ends[:, 1], note)


def median_interval(values: Array) -> Pair:
    """Compute the 95 % confidence interval of the median of a population from a sample of values (n,).

    The lower and upper ends are two of the sorted values (order statistics), which is valid for any distribution of
    the values. Fewer than 6 values do not give a 95 % interval by order statistics, and a lognormal distribution is
    assumed instead.

    >>> median_interval(np.arange(1.0, 11.0))
    (2.0, 9.0)
    """
    ordered = np.sort(values[np.isfinite(values)])
    n = ordered.size
    if n < 2:
        return float("nan"), float("nan")
    # Each value lies below the true median with the probability 1/2. The k-th smallest value is above the median if at
    # most k − 1 values lie below it, which has the probability bdtr(k − 1, n, 1/2). The rank is the largest k for which
    # this is at most 2.5 %. The interval reaches from the k-th smallest to the k-th largest value.
    rank = int(np.count_nonzero(bdtr(np.arange(n // 2), n, 0.5) <= (1 - COVERAGE) / 2))
    if rank > 0:
        low, high = ordered[rank - 1], ordered[n - rank]
    elif ordered[0] <= 0:
        low = min(0.0, ordered[0])
        high = max(0.0, ordered[-1])
    else:
        logs = np.log(ordered)
        # for a normal distribution, the standard error of the median is √(π/2) = 1.2533 times the one of the mean
        half_width = 1.2533 * stdtrit(n - 1, (1 + COVERAGE) / 2) * logs.std(ddof=1) / np.sqrt(n)
        low, high = np.exp(np.median(logs) + half_width * np.array([-1, 1]))
    return float(low), float(high)


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
    carried = abs(fluid.carried)  # nominal pressure that the fluid carries [Pa]
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
    """Estimate the error that arises because the curvature of a patch may be form deviation or roughness.

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


def calibrated_part(
    name: str, kind: str, leakage: Array, state: PatchState, patches: int = 1
) -> ErrorPart:
    """Estimate the error of a leakage that was computed from measured patches, or block by block.

    The error was measured on a calibration set of whole surfaces, see `patch_interval`. The error at a load step
    depends only on the contact state at this step.

    Parameters
    ----------
    name : name of the error source.
    kind : kind of the calculation, one of `patch_interval.KINDS`.
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


def error_budget(
    scene: Scene,
    study: StudyResult,
    *,
    coarse: Sequence[CoarserSolution] = (),
    filtered: CoarserSolution | None = None,
    kept_slope: float = 1.0,
    wave_pixels: float = USUAL_PIXELS,
) -> ErrorBudget:
    """Estimate the error of the leakage of a study, with a 95 % interval for each error source and a combined interval.

    Parameters
    ----------
    scene : input of the study.
    study : result of the study. For a stochastic study, the error of the median leakage is estimated.
    coarse : solutions of the same input on fewer points, of which only the first is used. If `coarse` is empty, the
        error of the pixel size is left out. The upper end of the interval at a sealed step is then inf, unless a large
        contact fraction shows that the step is certainly sealed.
    filtered : solution without the shortest octave of waves, that is, without the waves shorter than twice the shortest
        wavelength of the surface.
    kept_slope : rms slope of the surface, divided by its rms slope before waves were removed. The ratio is 1 if no
        waves were removed, for example from a generated surface; there is then no error of the filter. At a sealed
        step, the upper end of the interval is inf if the removed waves may open the seal and the resulting leakage is
        unknown.
    wave_pixels : number of pixels in the shortest wave of the surface. With more than 8 pixels, a smaller error of the
        pixel size is possible.

    Returns
    -------
    The error budget. The combined interval contains the true leakage in about 95 of 100 cases. The distance from
    ln(leakage) to an end of the combined interval is √Σd², where d is the distance from ln(leakage) to the same end of
    the interval of one error source.

    Examples
    --------
    >>> import femseal as fs
    >>> face = fs.self_affine((32, 64), (32e-6, 64e-6), hurst=0.8, rms_slope=0.2, roll_off=20e-6, rng=1)
    >>> scene = fs.Scene(face, 115e9, 3e9, fs.Liquid(1e-3), 1e6, 0.0, loading=(5e7, 2e8))
    >>> budget = error_budget(scene, fs.deterministic(scene))  # without a coarser grid
    >>> [part.name for part in budget.parts]
    ['solver']
    """
    errors = NumericalErrors(scene, study)
    parts = [
        *errors.solver(),
        *errors.pixels(coarse[0] if coarse else None, wave_pixels),
        *errors.filter(filtered, kept_slope),
        *errors.realisations(),
        *errors.patch(),
    ]
    return errors.budget_of(parts)


class NumericalErrors:
    """Estimate the numerical errors of one study, and the error caused by measuring only a patch of the surface.

    Each method estimates the error of one error source, and returns an empty list if this source does not apply to the
    study.
    """

    def __init__(self, scene: Scene, study: StudyResult) -> None:
        """Read leakage and contact fraction at every step (steps,) from the result of a study."""
        self.scene = scene
        self.study = study
        self.leakage = study.predicted_leakage
        self.in_contact = study.contact_fraction_at(scene.steps)

    @cached_property
    def closing(self) -> Flags:
        """Flag for each step (steps,): True if the last leakage path is about to close, see `near_closing`."""
        return near_closing(self.leakage, self.study.open_leakage(self.scene))

    def _wider_near_closing(self, part: ErrorPart) -> ErrorPart:
        """Widen the interval of an error source at steps where the last leakage path is about to close."""
        return part.widened(self.leakage, np.where(self.closing, _NEAR_CLOSING, 1.0))

    def solver(self) -> list[ErrorPart]:
        """Estimate the error due to the residuals of the contact and flow solvers."""
        part = solver_part(self.scene, self.leakage, self.in_contact)
        return [self._wider_near_closing(part)]

    def pixels(
        self, coarse: CoarserSolution | None, wave_pixels: float = USUAL_PIXELS
    ) -> list[ErrorPart]:
        """Estimate the error of the pixel size.

        coarse : solution of the same input on fewer points; None if the input was solved on a single grid.
        wave_pixels : number of pixels in the shortest wave.
        """
        if coarse is None:
            parts = one_grid_part(self.leakage, self.in_contact)
        else:
            part = pixels_part(
                self.scene, self.leakage, coarse, wave_pixels, self.closing, self.in_contact
            )
            parts = [part]
        return [self._wider_near_closing(part) for part in parts]

    def filter(self, filtered: CoarserSolution | None, kept_slope: float) -> list[ErrorPart]:
        """Estimate the error that the filter causes by removing waves; see `error_budget` for the arguments."""
        if kept_slope >= 1:
            return []
        if filtered is None:
            note = "no solution without the shortest waves"
            part = ErrorPart("filter", self.leakage, self.leakage, note)
        else:
            part = filter_part(self.scene, self.leakage, self.in_contact, filtered, kept_slope)
        part = self._wider_near_closing(part)
        steps = self.scene.steps
        return [raised_by_slope(part, steps, self.leakage, self.in_contact, kept_slope)]

    def realisations(self) -> list[ErrorPart]:
        """Estimate the error of the median leakage that is due to the finite number of realisations."""
        if self.study.realisation_count is None:
            return []
        return [realisations_part(self.study.leakage)]

    def patch(self) -> list[ErrorPart]:
        """Estimate the error of computing the leakage from measured patches, or block by block."""
        study = self.study
        if study.patch_state is None:
            return []
        name = study_of_result(study).patch_source
        n_patches = len(self.scene.surface.patches)
        part = calibrated_part(name, study.kind, self.leakage, study.patch_state, n_patches)
        without = None if study.patches is None else study.patches.without
        if without is not None:
            # three or more patches show how much patches of this surface differ
            part = patches_part(self.leakage, without, part)
        return [part]

    def budget_of(self, parts: Sequence[ErrorPart]) -> ErrorBudget:
        """Return the error budget of the study with the given error sources."""
        separated = tuple(s for s, _ in self.scene.separated_steps if np.isnan(self.leakage[s]))
        name = study_of_result(self.study).name
        return ErrorBudget(name, self.leakage, tuple(parts), self.scene.steps, separated)

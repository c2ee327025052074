"""The error budget of a study of a scene: estimates of the single sources of error of its leakage, each a part.

Also for what a method leaves out of a face, by the calibration set, and for what the model does.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import sqrt
from typing import Any

import numpy as np
from scipy.special import bdtr, ndtri, stdtrit

from ..base import Array, Pair, counted
from ..loads import LoadProgramme
from ..studies import BlocksResult, Scene, StochasticResult, StudyResult, study_of_result
from ..studies.doubts import FormEffect
from ..studies.drawn_error import COVERAGE, interval_widths
from ..studies.patch_state import PatchState
from ..studies.study_registry import contact_fraction_of, open_leakage_of
from .error_parts import (
    USUAL_PIXELS,
    CoarserSolution,
    ErrorBudget,
    ErrorPart,
    near_closing,
    part_of_changes,
    pixels_part,
    sensitivity,
)
from .resolution import filter_part, one_grid_part, raised_by_slope

#: Change of ln(leakage) by the residual of the contact, over this and the slope of ln(leakage) over ln(load), at least
#: 1. Measured on 24 faces at residuals of 1e-2 to 1e-6: 0.04 holds 95 of 100 changes, and 0.5 all of them.
_RESIDUAL = 0.5
#: Change of ln(leakage) by the residual of the flow, which is solved to 1e-6 of its energy.
_FLOW = 1e-6

#: Change of ln(leakage) from which on slopes are a part: an rms slope of 0.14.
_LEAST_SLOPE_ERROR = 0.02

#: Degrees of freedom of the scatter that the state of the patches lets expect, beside that of the patches themselves.
_PLACE_FREEDOM = 2
#: Distance to an end of a 95 % interval of a normal number, in standard deviations.
_NORMAL = float(ndtri((1 + COVERAGE) / 2))
#: What is solved, by its kind.
_WHAT = {
    "in place": "seals as broad as the face, drawn from one patch",
    "anywhere": "seals of another breadth or shape than the face, drawn from one patch",
    "with form": "seals whose form is known at points, drawn from one patch",
    "by blocks": "a face by blocks",
}
#: Factor of the distances of all parts but those of draws near closing, see `near_closing`, where curves are steep.
#: Measured on 216 faces of six kinds: with it the bands held 93 of 100 there, without it 83.
_NEAR_CLOSING = 3.0


def solver_part(scene: Scene, leakage: Array, in_contact: Array) -> ErrorPart:
    """Residuals of contact and flow: that of the contact acts as a change of the load."""
    slope = sensitivity(scene.steps, leakage, in_contact)
    distance = _RESIDUAL * scene.rtol * np.maximum(slope, 1.0) + _FLOW
    note = f"contact residual {scene.rtol:.0e} as a change of the load, by the slope of ln(leakage) over ln(load)"
    return ErrorPart.of("solver", leakage, distance, distance, note)


def places_part(leakage: Array, without: Array, usual: ErrorPart) -> ErrorPart:
    """Several measured patches: interval of ln(leakage) by the jackknife over patches, those left joined.

    Its variance is pooled with that which the contact state lets expect, by their degrees of freedom, and the interval
    is Student's. Where all but one patch do not leak the seal may be sealed; then the upper end is by the jackknife of
    the leakage itself.

    leakage : (steps,). without : of all patches but one (patches, steps) [m²/s]. usual : the part of so many patches by
    their state, see `calibrated_part`.

    Source: Efron & Tibshirani, An Introduction to the Bootstrap, 1993, chapter 11.
    """
    count = len(without)
    freedom = _PLACE_FREEDOM + count - 1
    student = float(stdtrit(freedom, (1 + COVERAGE) / 2))
    q = np.abs(leakage)

    def distance(values: Array, expected: Array) -> Array:
        scatter = (count - 1) * values.var(axis=0)
        prior = (expected / _NORMAL) ** 2
        return student * np.sqrt((_PLACE_FREEDOM * prior + (count - 1) * scatter) / freedom)

    with np.errstate(divide="ignore", invalid="ignore"):
        below = distance(np.log(without), np.log(q / np.abs(usual.lower)))
        above = distance(np.log(without), np.log(np.abs(usual.upper) / q))
        plain = np.log1p(distance(without / without.mean(axis=0), np.log(np.abs(usual.upper) / q)))
    shut = (without == 0).any(axis=0) & np.isfinite(without).all(axis=0)
    below = np.where(shut, np.inf, below)
    above = np.where(shut, plain, above)
    note = (
        f"Student's interval by the jackknife over {count} measured patches, in ln(leakage), with the scatter that "
        f"their contact state lets expect; {places_to_halve(count)} more would halve it"
    )
    part = ErrorPart.of("places", leakage, below, above, note)
    # without leakage the others tell how much there may be
    sealed = np.maximum((1 + student) * np.max(without, axis=0), usual.upper)
    return replace(part, upper=np.where(leakage == 0, sealed, part.upper))


def places_to_halve(count: int) -> int:
    """How many more measured places are expected to halve the band of three or more.

    >>> places_to_halve(3), places_to_halve(4), places_to_halve(8)
    (5, 8, 19)
    """

    def width(places: int) -> float:
        return float(stdtrit(_PLACE_FREEDOM + places - 1, (1 + COVERAGE) / 2)) / sqrt(places)

    more = 1
    while width(count + more) > 0.5 * width(count):
        more += 1
    return more


def realisations_part(study: StochasticResult) -> ErrorPart:
    """Finite number of realisations: interval of their median, by its ranks."""
    note = f"interval of the median of {counted(len(study.leakage), 'realisation')} by its ranks"
    ends = np.array([median_interval(column) for column in study.leakage.T])
    return ErrorPart("realisations", ends[:, 0], ends[:, 1], note)


def median_interval(values: Array) -> Pair:
    """Two values that hold the median of the population in at least 95 of 100 samples.

    They are order statistics, whatever the distribution; fewer than 6 values, of which no two do, are taken as
    lognormal.

    >>> median_interval(np.arange(1.0, 11.0))
    (2.0, 9.0)
    """
    ordered = np.sort(values[np.isfinite(values)])
    n = ordered.size
    if n < 2:
        return float("nan"), float("nan")
    # the largest number of values to leave out on each side
    left = int(np.count_nonzero(bdtr(np.arange(n // 2), n, 0.5) <= (1 - COVERAGE) / 2))
    if left > 0:
        low, high = ordered[left - 1], ordered[n - left]
    elif ordered[0] <= 0:
        low = min(0.0, ordered[0])
        high = max(0.0, ordered[-1])
    else:
        logs = np.log(ordered)
        half = 1.2533 * stdtrit(n - 1, (1 + COVERAGE) / 2) * logs.std(ddof=1) / np.sqrt(n)
        low, high = np.exp(np.median(logs) + half * np.array([-1, 1]))
    return float(low), float(high)


def effective_pressure_part(scene: Scene, study: Any) -> ErrorPart | None:
    """What pieces under their effective pressure differ by from the coupled face.

    Measured on seven faces four long waves broad, p_in/p̄ .1 to 1: drawn seals leak at most by half of what the fluid
    does to ln(leakage) too much, and by a fifth too little, less on broader seals. None of other studies.
    """
    fluid = scene.acting_fluid
    if fluid is None or not isinstance(study, StochasticResult) or study.tiles.in_place:
        return None
    note = "pieces under their effective pressure against a coupled face, measured on faces four waves broad"
    q, carried = study.quantile(0.5), abs(fluid.carried)
    loads = np.maximum(study.steps.pressures, max(carried, 1e-300))
    slope = sensitivity(study.steps, q, study.contact_fraction)
    effect = slope * carried / loads
    return part_of_changes("effective pressure", study.steps, q, 0.5 * effect, 0.2 * effect, note)


def patch_form_part(
    effect: FormEffect, steps: LoadProgramme, leakage: Array, *, rises: bool = False
) -> ErrorPart | None:
    """What is form in a measured patch, where nothing says it: its curvature counts, or more of it, or none.

    rises : whether longer waves than those of the patch are to be expected: then so are more of its longest ones.

    Measured on 140 loads of quarters of eight maps against the whole: with the distance on both sides the band of a
    factor of 2 held 61 of 100, on the side of the change alone 56, without it 49. After unloading it is no less than
    at the peak. None where the change is unknown.
    """
    distance = effect.distance(steps.pressures, rises)
    if distance is None:
        return None
    distance = np.maximum(distance, distance[steps.peak_indices])
    what = "its curvature or its longest waves" if rises else "the curvature of the patch"
    note = f"change of ln(leakage) without {what}, on either side, solved on few points"
    return part_of_changes("form of the patch", steps, leakage, distance, distance, note)


def thin_gap_part(scene: Scene, leakage: Array) -> ErrorPart | None:
    """What Reynolds' equation leaks too much through a gap that is not thin: at most 1 + h'², h' the rms slope.

    Next order of lubrication between a plane and a wall h: 1/12k = ⟨(1 + 4h'²/5)/h³⟩ across its ridges, and along them
    12k = ⟨h³(1 − h'²)⟩. None below `_LEAST_SLOPE_ERROR`.
    """
    distance = np.full(np.shape(leakage), np.log1p(scene.surface.rms_slope**2))
    if distance[0] < _LEAST_SLOPE_ERROR:
        return None
    note = "Stokes flow in place of Reynolds' at the rms slope of the face, by the next order of lubrication"
    return ErrorPart.of("thin gap", leakage, distance, np.zeros_like(distance), note)


def longer_waves_part(
    changes: Array, flatness: bool, steps: LoadProgramme, leakage: Array
) -> ErrorPart:
    """Waves longer than the patch: Student's interval of a draw of them more, on the side of either end.

    changes : of ln(leakage) by drawn waves (draws, steps). flatness : whether a tolerance limits them.
    """
    count = len(changes)
    with np.errstate(invalid="ignore"):
        middle, deviation = changes.mean(axis=0), changes.std(axis=0, ddof=1)
    distance = stdtrit(count - 1, (1 + COVERAGE) / 2) * deviation * sqrt(1 + 1 / count)
    # where draws seal, or nothing is known, neither end is
    ends = (np.maximum(sign * middle + distance, 0.0) for sign in (-1, 1))
    below, above = (np.where(np.isfinite(end), end, np.inf) for end in ends)
    until = (
        "up to the flatness of the seal" if flatness else "with no `flatness` in [seal] to end it"
    )
    note = (
        f"{count} draws of longer waves, the spectrum carried on to the breadth of the seal {until}"
    )
    return part_of_changes("longer waves", steps, leakage, below, above, note)


def calibrated_part(name: str, kind: str, leakage: Array, state: PatchState) -> ErrorPart:
    """What one measured patch does not know of a drawn seal, or blocks of a surface, by the scenes of a calibration.

    It depends on the contact state alone, not on other loads.

    kind : one of `KINDS`. state : of the patch at every step.
    """
    widths = interval_widths(kind)
    sign = np.where(np.asarray(leakage) < 0, -1.0, 1.0)
    lower, upper = (sign * end for end in widths.ends(leakage, state))
    note = f"{_WHAT[kind]}: by split conformal prediction from {widths.scenes} whole faces"
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
    """What is known of the error of a leakage: a band for each source, and all of them together.

    Parameters
    ----------
    scene : input of the study. study : its result; of a stochastic study the budget is that of the median.
    coarse : the same scene solved on fewer points; of several the first counts. Without any the pixels have no part.
    filtered : the scene solved without waves up to twice the shortest one.
    kept_slope : rms slope over that with the waves that were removed; without any, as of a generated face, it is 1, and
        the filter has no part. Where these may open what is sealed, and no load shows what it then leaks, the upper end
        is inf: unknown. So it is of what is sealed where no coarser solution is given.
    wave_pixels : pixels to the shortest wave of the scene: with more than 8 the least error of the pixels is less.

    Returns
    -------
    Bands that hold the truth in about 95 of 100 cases; that of the whole is the root of the sum of squares of the
    distances of ln(leakage).

    Examples
    --------
    >>> import femseal as fs
    >>> face = fs.self_affine((32, 64), (32e-6, 64e-6), hurst=0.8, rms_slope=0.2, roll_off=20e-6, rng=1)
    >>> scene = fs.Scene(face, 115e9, 3e9, fs.Liquid(1e-3), 1e6, 0.0, loading=(5e7, 2e8))
    >>> budget = error_budget(scene, fs.deterministic(scene))  # without a coarser grid: of the solver alone
    >>> [part.name for part in budget.parts]
    ['solver']
    """
    own = study_of_result(study)
    leakage = own.leakage(study)
    in_contact = contact_fraction_of(study, scene.steps)
    parts: list[ErrorPart] = [solver_part(scene, leakage, in_contact)]
    closing = near_closing(leakage, open_leakage_of(study, scene))
    if coarse:
        parts.append(pixels_part(scene, leakage, coarse[0], wave_pixels, closing, in_contact))
    else:
        parts += one_grid_part(leakage, in_contact)
    if filtered is not None and kept_slope < 1:
        parts.append(filter_part(scene, leakage, in_contact, filtered, kept_slope))
    elif kept_slope < 1:
        parts.append(
            ErrorPart("filter", leakage, leakage, "no solution without the shortest waves")
        )
    steeper = np.where(closing, _NEAR_CLOSING, 1.0)
    parts = [part.widened(leakage, steeper) for part in parts]
    if kept_slope < 1:
        parts[-1] = raised_by_slope(parts[-1], scene.steps, leakage, in_contact, kept_slope)
    if isinstance(study, StochasticResult):
        parts.append(realisations_part(study))
        if study.patch_state is not None:
            patch = calibrated_part("patch", study.kind, leakage, study.patch_state)
            # the scatter of several patches shows what one cannot
            without = None if study.places is None else study.places.without
            parts.append(patch if without is None else places_part(leakage, without, patch))
    elif isinstance(study, BlocksResult) and study.patch_state is not None:
        parts.append(calibrated_part("blocks", study.kind, leakage, study.patch_state))
    parted = tuple(s for s, _ in scene.parted_steps if np.isnan(leakage[s]))
    return ErrorBudget(own.name, leakage, tuple(parts), scene.steps, parted)

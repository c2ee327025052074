"""Estimate the numerical errors of a study, and the error caused by measuring only a patch of the surface."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from scipy.special import bdtr, stdtrit

from ..base import Array, Flags, Pair, counted
from ..studies import Scene, StudyResult, study_of_result
from ..studies.patch_interval import COVERAGE
from .error_parts import ErrorBudget, ErrorPart
from .leakage_changes import CoarserSolution, sensitivity
from .missing_waves import filter_part, raised_by_slope
from .patch_errors import calibrated_part, patches_part
from .pixel_size import USUAL_PIXELS, near_closing, one_grid_part, pixels_part

#: The residual r of the contact solution changes ln(leakage) by _RESIDUAL r s, where s is |d ln(leakage)/d ln(load)|,
#: or 1 if this slope is smaller. Measured on 24 surfaces at residuals of 1e-2 to 1e-6: a factor of 0.04 covers 95 of
#: 100 changes, and a factor of 0.5 covers all changes.
_RESIDUAL = 0.5
#: Change of ln(leakage) due to the residual of the flow solution; the relative error of its energy is 1e-6.
_FLOW = 1e-6
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
        # for a normal distribution, the standard error of the median is √(π/2) = 1.2533 times that of the mean
        half_width = 1.2533 * stdtrit(n - 1, (1 + COVERAGE) / 2) * logs.std(ddof=1) / np.sqrt(n)
        low, high = np.exp(np.median(logs) + half_width * np.array([-1, 1]))
    return float(low), float(high)


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
        """Read the leakage and the contact fraction at every step (steps,) from the result of a study."""
        self.scene = scene
        self.study = study
        self.leakage = study.predicted_leakage
        self.in_contact = study.contact_fraction_at(scene.steps)

    @cached_property
    def closing(self) -> Flags:
        """Whether the last leakage path is about to close at each step (steps,), see `near_closing`."""
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
        """Estimate the error due to the pixel size.

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

"""The error budget of a study of a scene."""

from collections.abc import Sequence

import numpy as np

from ..loads import least_counted
from ..studies import BlocksResult, Scene, StochasticResult, StudyResult, study_of_result
from ..studies.study_registry import contact_fraction_of
from .error_parts import CoarserSolution, ErrorBudget, ErrorPart
from .estimates import calibrated_part, places_part, realisations_part, solver_part
from .resolution import USUAL_PIXELS, filter_part, one_grid_part, pixels_part, raised_by_slope

#: Factor of the distances of all parts but those of draws at loads that leak less than 1e-3 of the first, where
#: curves are steep. Measured on 216 faces of six kinds: with it the bands held 93 of 100 there, without it 83.
_NEAR_CLOSING = 3.0


def error_budget(
    scene: Scene,
    study: StudyResult,
    *,
    coarse: Sequence[CoarserSolution] = (),
    filtered: CoarserSolution | None = None,
    octaves: float = 0.0,
    kept_slope: float = 1.0,
    wave_pixels: float = USUAL_PIXELS,
) -> ErrorBudget:
    """What is known of the error of a leakage: a band for each source, and all of them together.

    Parameters
    ----------
    scene : input of the study. study : its result; of a stochastic study the budget is that of the median.
    coarse : the same scene solved on fewer points; of several the first counts. Without any the pixels have no part.
    filtered : the scene solved without waves up to twice the shortest one. octaves : of waves that were removed from
        the face before; without any, as of a generated face, the filter has no part.
    kept_slope : rms slope over that with the waves that were removed. Where these may open what is sealed, and no load
        shows what it then leaks, the upper end is inf: unknown. So it is of what is sealed where no coarser solution is
        given.
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
    parts: list[ErrorPart] = [solver_part(scene, leakage)]
    if coarse:
        parts.append(pixels_part(scene, leakage, coarse[0], wave_pixels))
    else:
        parts += one_grid_part(leakage, in_contact)
    if filtered is not None and octaves > 0:
        parts.append(filter_part(scene, leakage, filtered, octaves))
    elif kept_slope < 1:
        parts.append(
            ErrorPart("filter", leakage, leakage, "no solution without the shortest waves")
        )
    q = np.abs(leakage)
    steeper = np.where(q < least_counted(q), _NEAR_CLOSING, 1.0)
    parts = [part.widened(leakage, steeper) for part in parts]
    if kept_slope < 1:
        parts[-1] = raised_by_slope(parts[-1], scene.steps, leakage, in_contact, kept_slope)
    if isinstance(study, StochasticResult):
        parts.append(realisations_part(study))
        # the scatter of places shows what one patch cannot
        without = None if study.places is None else study.places.without
        parts.append(
            calibrated_part("patch", study.kind, study.steps, leakage)
            if without is None
            else places_part(leakage, without)
        )
    elif isinstance(study, BlocksResult):
        parts.append(calibrated_part("blocks", study.kind, study.steps, leakage))
    parted = tuple(s for s, _ in scene.parted_steps if np.isnan(leakage[s]))
    return ErrorBudget(own.name, leakage, tuple(parts), scene.steps, parted)

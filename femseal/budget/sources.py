"""List the error sources of the leakage of a run.

The list of error sources is `SOURCES`. A run evaluates its error sources; a forecast only counts the solutions that
they need. An error source consists of two functions. The function `versions` lists the modified versions of the input
that must be solved. The function `parts` estimates the error of a study from the leakages of these versions. To add an
error source, write the two functions and add them to `SOURCES`.

A case selects the error sources of its model by their names. The functions therefore import the solvers only when they
are called, so that a case can be read without loading the solvers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import hypot, sqrt
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..studies import Scene, StudyResult
    from ..topography import Continuation, Surface
    from .error_parts import ErrorBudget, ErrorPart
    from .estimates import NumericalErrors
    from .evaluation import BudgetRequest, Evaluation
    from .study_input import StudyInput

#: Function that estimates the error of one error source for the result of a study. Its last argument is an
#: `ErrorBudget` of the error sources that come before this one in `SOURCES`.
Parts = Callable[["Evaluation", "StudyResult", "ErrorBudget"], Sequence["ErrorPart | None"]]


def _no_versions(request: BudgetRequest) -> list[StudyInput | None]:
    """Return an empty list, for an error source that needs no further solution."""
    return []


@dataclass(frozen=True)
class ErrorSource:
    """Describe an error source.

    Parameters
    ----------
    name : str
        Name of the row in the budget.
    parts : callable
        Function that estimates the error, see `Parts`.
    remedy : str
        Action that reduces the error, for the advice in the report.
    versions : callable
        Function that lists all versions of the input that may have to be solved for the error source; by default none.
    of_model : bool
        True for an error source of the model or of its input, which is evaluated only if its name is requested. False
        for a numerical error source, which is always evaluated.
    """

    name: str
    parts: Parts
    remedy: str
    versions: Callable[[BudgetRequest], Sequence[StudyInput | None]] = _no_versions
    of_model: bool = True

    def is_wanted(self, request: BudgetRequest) -> bool:
        """Return whether the error source belongs to the requested error budget."""
        return not self.of_model or self.name in request.model_parts


def _errors_of(evaluation: Evaluation, result: StudyResult) -> NumericalErrors:
    """Return the object that estimates the numerical errors of a study from its result."""
    from .estimates import NumericalErrors

    return NumericalErrors(evaluation.request.version.scene, result)


def _solver(
    evaluation: Evaluation, result: StudyResult, budget: ErrorBudget
) -> Sequence[ErrorPart]:
    """Estimate the error due to the residuals of the contact and flow solvers."""
    return _errors_of(evaluation, result).solver()


def _pixels(
    evaluation: Evaluation, result: StudyResult, budget: ErrorBudget
) -> Sequence[ErrorPart]:
    """Estimate the error due to the pixel size, by comparison with a coarser grid."""
    from .versions import compare_leakage

    request = evaluation.request
    solved = {} if request.coarser is None else evaluation.solve(request.coarser)
    coarse = compare_leakage(result, request.grid, solved)
    version = request.version
    wave_pixels = version.conditioning.shortest_wave / max(version.scene.surface.spacing)
    return _errors_of(evaluation, result).pixels(coarse, wave_pixels)


def _filter(
    evaluation: Evaluation, result: StudyResult, budget: ErrorBudget
) -> Sequence[ErrorPart]:
    """Estimate the error of the low-pass filter, by removing a further octave of the shortest waves."""
    from .versions import compare_leakage, kept_slope

    smoother = evaluation.request.smoother
    filtered = None
    if smoother is not None:
        filtered = compare_leakage(result, smoother, evaluation.solve(smoother))
    return _errors_of(evaluation, result).filter(filtered, kept_slope(evaluation.request.version))


def _realisations(
    evaluation: Evaluation, result: StudyResult, budget: ErrorBudget
) -> Sequence[ErrorPart]:
    """Estimate the error of the median leakage that is due to the finite number of realisations."""
    return _errors_of(evaluation, result).realisations()


def _patch(evaluation: Evaluation, result: StudyResult, budget: ErrorBudget) -> Sequence[ErrorPart]:
    """Estimate the error of computing the leakage from measured patches, or block by block."""
    return _errors_of(evaluation, result).patch()


def _effective_pressure(
    evaluation: Evaluation, result: StudyResult, budget: ErrorBudget
) -> list[ErrorPart | None]:
    """Estimate the error of subtracting the fluid pressure from the load of a cell."""
    from .neglected_effects import effective_pressure_part

    return [effective_pressure_part(evaluation.request.version.scene, result)]


def _thin_gap(
    evaluation: Evaluation, result: StudyResult, budget: ErrorBudget
) -> list[ErrorPart | None]:
    """Estimate the error of Reynolds' equation in a gap that is not thin."""
    from .neglected_effects import thin_gap_part

    return [thin_gap_part(evaluation.request.version.scene, result.predicted_leakage)]


def _plastic_law(
    evaluation: Evaluation, result: StudyResult, budget: ErrorBudget
) -> list[ErrorPart | None]:
    """Estimate the error of the contact law, which does not let the contact pressure exceed the hardness."""
    from .plastic_law import plastic_law_part

    request = evaluation.request
    ratio = request.hardness_over_yield
    return [plastic_law_part(request.version.scene, result, result.predicted_leakage, ratio)]


def _form_of_the_patch(
    evaluation: Evaluation, result: StudyResult, budget: ErrorBudget
) -> list[ErrorPart | None]:
    """Estimate the error that arises because the curvature of a patch may be either form deviation or roughness."""
    from .neglected_effects import patch_form_part

    version = evaluation.request.version
    effect = evaluation.request.form_effect
    if effect is None:
        return []
    waves = version.longest_waves
    rises = waves is not None and waves.rises
    return [patch_form_part(effect, result.steps, result.predicted_leakage, rises=rises)]


def _longer_waves(
    evaluation: Evaluation, result: StudyResult, budget: ErrorBudget
) -> list[ErrorPart | None]:
    """Estimate the error of leaving out waves longer than the measured patch, for realisations of a seal only."""
    from .neglected_effects import longer_waves_part

    version = evaluation.request.version
    if result.realisation_count is None:
        return []
    changes = version.longer_waves(evaluation.request.grid.scene.surface, evaluation.mapper)
    if changes is None:
        return []
    has_flatness = version.flatness is not None
    return [longer_waves_part(changes, has_flatness, result.steps, result.predicted_leakage)]


def _continuation(
    evaluation: Evaluation, result: StudyResult, budget: ErrorBudget
) -> list[ErrorPart | None]:
    """Estimate the error of extrapolating the spectrum. The error is unknown if one of the modified surfaces failed."""
    from ..studies import study_of_result
    from .leakage_changes import CoarserSolution
    from .missing_waves import continuation_part
    from .versions import solved_study

    version, grid = evaluation.request.version, evaluation.request.grid
    continuation = version.continuation
    unchanged = evaluation.solve(grid).get(solved_study(study_of_result(result)).key)
    if continuation is None or unchanged is None:
        return []
    # in place of a version that could not be solved
    unknown = CoarserSolution(
        points=grid.scene.surface.shape,
        leakage=np.full(len(grid.scene.steps), np.nan),
        reference=unchanged.leakage,
    )
    solutions = [
        evaluation.on_grid(continued_version, result) or unknown
        for continued_version in evaluation.request.continued
    ]
    # the last version of `continued_versions` lacks the shortest octave of waves
    *other_phases, without_octave = solutions
    smoother_surface = version.scene.surface.low_pass(2 * continuation.cut_off)
    shorter = replace(without_octave, rms_slope=smoother_surface.rms_slope)
    slope_ratio = _slope_ratio_beyond(version.scene.surface, continuation, grid.scene)
    in_contact = result.contact_fraction_at(version.scene.steps)
    leakage = result.predicted_leakage
    part = continuation_part(
        version.scene,
        leakage,
        in_contact,
        others=other_phases,
        shorter=shorter,
        slope_ratio=slope_ratio,
    )
    return [part]


def _slope_ratio_beyond(surface: Surface, continuation: Continuation, scene: Scene) -> float:
    """Compute the ratio of the rms slope of a surface to its rms slope with the missing short waves.

    The missing waves are shorter than the cut-off wavelength of the surface. Missing waves are counted down to the
    shortest wave that matters for the contact, which is limited to between one tenth and one half of the cut-off
    wavelength.
    """
    from ..topography.instrument_limits import UNSEEN

    cut_off = continuation.cut_off
    last_wave = continuation.shortest_relevant_wave(scene.law.mean_hardness, scene.surface_modulus)
    shortest = float(np.clip(last_wave, cut_off / UNSEEN, cut_off / 2))
    square_slope_beyond = continuation.law.slope_power(cut_off, shortest)
    return surface.rms_slope / hypot(surface.rms_slope, sqrt(square_slope_beyond))


def _changed_versions(request: BudgetRequest, name: str) -> list[StudyInput | None]:
    """List the versions of the input with a changed model that an error source needs."""
    versions: list[StudyInput | None] = []
    for changed in request.changes:
        if changed.change.name == name:
            versions += [changed.version, changed.opposite_version]
    return versions


def _changed_model(
    evaluation: Evaluation, result: StudyResult, budget: ErrorBudget, name: str
) -> list[ErrorPart | None]:
    """Estimate the error from the source `name` by solving the input with a changed model.

    The input with the opposite change is only solved if the error source matters, see `opposite_matters`.
    """
    from .changed_models import model_part, opposite_matters

    parts: list[ErrorPart | None] = []
    leakage = result.predicted_leakage
    for changed in evaluation.request.changes:
        change = changed.change
        if change.name != name:
            continue
        solution = evaluation.on_grid(changed.version, result)
        if solution is None:
            continue
        part = model_part(change, result.steps, leakage, solution)
        if changed.opposite_version is not None and opposite_matters(part, budget):
            opposite = evaluation.on_grid(changed.opposite_version, result)
            part = model_part(change, result.steps, leakage, solution, opposite)
        parts.append(part)
    return parts


def _source_of_changes(name: str, remedy: str) -> ErrorSource:
    """Make the error source `name`, whose error is estimated by changing the model, see `model_changes`."""
    parts = partial(_changed_model, name=name)
    return ErrorSource(name, parts, remedy, partial(_changed_versions, name=name))


#: All sources of error, in the order in which they are evaluated and shown. The order matters for the sources at the
#: end of the list, which change the model: `opposite_matters` compares such a source with all sources before it. The
#: row of the error source "patch" has another name for three or more patches, and for a surface that is solved block by
#: block, see `OTHER_ROWS`.
SOURCES = (
    ErrorSource("solver", _solver, "a smaller contact.rtol", of_model=False),
    ErrorSource(
        "pixels",
        _pixels,
        "more surface.points",
        versions=lambda request: [request.coarser],
        of_model=False,
    ),
    ErrorSource(
        "filter",
        _filter,
        "a shorter surface.shortest_wave, as far as the waves were measured",
        versions=lambda request: [request.smoother],
        of_model=False,
    ),
    ErrorSource("realisations", _realisations, "more realisations in [stochastic]", of_model=False),
    ErrorSource(
        "patch", _patch, "a larger measured area, or a second measured patch", of_model=False
    ),
    ErrorSource("effective pressure", _effective_pressure, "a smaller pressure of the fluid"),
    ErrorSource("thin gap", _thin_gap, "a smoother face (its gap is not thin against its waves)"),
    ErrorSource(
        "plastic law",
        _plastic_law,
        "a hardness that agrees with plastic flow at this roughness (see the page on the plastic law)",
    ),
    ErrorSource(
        "form of the patch",
        _form_of_the_patch,
        "surface.detrend, which says whether the curvature belongs to the seal",
    ),
    ErrorSource(
        "longer waves",
        _longer_waves,
        "a larger measured area, or the flatness of the seal in [seal]",
    ),
    ErrorSource(
        "continuation",
        _continuation,
        "an instrument that sees shorter waves",
        versions=lambda request: request.continued,
    ),
    _source_of_changes("hardness", "a measured hardness, and a smaller hardness_tolerance with it"),
    _source_of_changes("fluid pressure", 'fluid_pressure = "acts" in [contact]'),
    _source_of_changes(
        "form", "a form that is known more exactly, and a smaller tolerance with it"
    ),
)
#: Other names of the row of the error source "patch", each with the action that reduces the error.
OTHER_ROWS = {"patches": "more measured patches", "blocks": "larger blocks"}

#: Names of the error sources of the model and its input, from which a case can choose.
MODEL_PARTS = tuple(source.name for source in SOURCES if source.of_model)

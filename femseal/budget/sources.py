"""List the error sources of the leakage of a run. The run and its forecast iterate over the same list.

Each error source has two functions. The first one lists the modified versions of the input that must be solved. The
second one evaluates them for the result of one study. To add an error source, write both functions and enter them into
`SOURCES`. If it belongs to the model or to its input, also enter its name into `MODEL_PARTS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import hypot, sqrt
from typing import Any, NamedTuple

import numpy as np

from ..base import Array, Mapper
from ..checks import FormEffect
from ..materials import HARDNESS_FACTOR
from ..studies import Scene, StochasticResult, study_of_result
from ..studies.study_registry import contact_fraction_of
from ..topography import Continuation, Surface
from ..topography.conditioning import UNSEEN
from .changed_models import ModelChange, model_changes, model_part, opposite_matters
from .error_parts import CoarserSolution, ErrorBudget, ErrorPart
from .estimates import (
    NumericalErrors,
    effective_pressure_part,
    longer_waves_part,
    patch_form_part,
    thin_gap_part,
)
from .plastic_law import plastic_law_part
from .resolution import continuation_part
from .versions import (
    Version,
    VersionLeakage,
    coarser_grid,
    compare_leakage,
    continued_versions,
    kept_slope,
    leakage_of,
    solved_study,
    solved_version,
    without_filtered_waves,
)


class ChangedInput(NamedTuple):
    """Hold a change of the model, the version of the input with this change, and the version with the opposite change.

    The latter is None if there is no opposite change.
    """

    change: ModelChange
    version: Version
    opposite_version: Version | None


@dataclass(frozen=True)
class BudgetRequest:
    """Hold the input of an error budget.

    Parameters
    ----------
    version : Version
        Input of the run.
    model_parts : names of the error sources of the model that the budget is to contain.
    hardness : float
        Relative error of the hardness.
    hardness_over_yield : float
        Ratio of hardness to yield stress of the softer solid.
    form_effect : effect of the form of a measured patch on the leakage; None if it was not solved.
    """

    version: Version
    model_parts: Sequence[str] = ()
    hardness: float = 0.1
    hardness_over_yield: float = HARDNESS_FACTOR
    form_effect: FormEffect | None = None

    @cached_property
    def coarser(self) -> Version | None:
        """Version of the input with fewer points; None if the cells already have too few pixels to be halved."""
        return coarser_grid(self.version)

    @cached_property
    def smoother(self) -> Version | None:
        """Version of the input without its shortest octave of waves; None if no waves were removed from the surface."""
        return without_filtered_waves(self.version)

    @property
    def grid(self) -> Version:
        """Unchanged version of the input, on the same grid on which changes of the model are solved."""
        return self.coarser or self.version

    @cached_property
    def continued(self) -> list[Version]:
        """Versions of the input that show the error of continuing the spectrum, see `continued_versions`."""
        return continued_versions(self.grid)

    @cached_property
    def changes(self) -> list[ChangedInput]:
        """Changes of the model, with the changed versions of the input."""
        grid = self.grid
        changes = []
        for change in model_changes(grid.scene, self.model_parts, self.hardness, grid.form):
            opposite_version = None
            if change.opposite is not None:
                opposite_version = grid.changed(change.opposite)
            changes.append(ChangedInput(change, grid.changed(change), opposite_version))
        return changes


class Evaluation:
    """Solve the versions of the input that the error sources need, each version only once."""

    def __init__(self, request: BudgetRequest, mapper: Mapper) -> None:
        self.request = request
        self.mapper = mapper
        # each solved version and its leakages, by the identity of the version
        self._solved: dict[int, tuple[Version, dict[str, VersionLeakage]]] = {}

    def solve(self, version: Version) -> dict[str, VersionLeakage]:
        """Return the leakage of the studies of a version, by the key of the study."""
        if id(version) not in self._solved:
            self._solved[id(version)] = version, solved_version(version, self.mapper)
        return self._solved[id(version)][1]

    def on_grid(self, version: Version, result: Any) -> CoarserSolution | None:
        """Compare the leakage of a changed version with the leakage of the unchanged input on the same grid.

        The result is None if solving one of the two versions failed.
        """
        key = solved_study(study_of_result(result)).key
        unchanged = self.solve(self.request.grid).get(key)
        changed = self.solve(version).get(key)
        if unchanged is None or changed is None:
            return None
        return CoarserSolution(version.scene.surface.shape, changed.leakage, unchanged.leakage)


#: Function that evaluates an error source for the result of a study. The budget contains the error sources before it.
Parts = Callable[[Evaluation, Any, ErrorBudget], Sequence[ErrorPart | None]]


@dataclass(frozen=True)
class ErrorSource:
    """Describe an error source.

    Parameters
    ----------
    name : str
        Name of the row in the budget.
    versions : callable
        Lists all versions of the input that may have to be solved for this error source.
    parts : callable
        Evaluates the error source, see `Parts`.
    of_model : bool
        True for an error of the model or of its input, which is evaluated only if its name is requested. False for
        numerical errors, which are always evaluated.
    """

    name: str
    versions: Callable[[BudgetRequest], Sequence[Version | None]]
    parts: Parts
    of_model: bool = True

    def is_wanted(self, request: BudgetRequest) -> bool:
        """Return whether the requested budget is to contain this error source."""
        return not self.of_model or self.name in request.model_parts


def _no_versions(request: BudgetRequest) -> list[Version | None]:
    """Return an empty list, because nothing is solved for this error source."""
    return []


def _errors_of(evaluation: Evaluation, result: Any) -> NumericalErrors:
    """Return the estimates of the numerical errors of the result of a study."""
    return NumericalErrors(evaluation.request.version.scene, result)


def _solver(evaluation: Evaluation, result: Any, budget: ErrorBudget) -> Sequence[ErrorPart]:
    """Evaluate the error due to the residuals of the contact and flow solvers."""
    return _errors_of(evaluation, result).solver()


def _pixels(evaluation: Evaluation, result: Any, budget: ErrorBudget) -> Sequence[ErrorPart]:
    """Evaluate the error of the pixel size, by comparison with a coarser grid."""
    request = evaluation.request
    solved = {} if request.coarser is None else evaluation.solve(request.coarser)
    coarse = compare_leakage(result, request.grid, solved)
    version = request.version
    wave_pixels = version.conditioning.shortest_wave / max(version.scene.surface.spacing)
    return _errors_of(evaluation, result).pixels(coarse, wave_pixels)


def _filter(evaluation: Evaluation, result: Any, budget: ErrorBudget) -> Sequence[ErrorPart]:
    """Evaluate the error of the filter, by comparison with a surface with even fewer waves."""
    smoother = evaluation.request.smoother
    filtered = None
    if smoother is not None:
        filtered = compare_leakage(result, smoother, evaluation.solve(smoother))
    return _errors_of(evaluation, result).filter(filtered, kept_slope(evaluation.request.version))


def _realisations(evaluation: Evaluation, result: Any, budget: ErrorBudget) -> Sequence[ErrorPart]:
    """Evaluate the error due to the finite number of realisations."""
    return _errors_of(evaluation, result).realisations()


def _patch(evaluation: Evaluation, result: Any, budget: ErrorBudget) -> Sequence[ErrorPart]:
    """Evaluate the error of computing the leakage from measured patches, or by blocks."""
    return _errors_of(evaluation, result).patch()


def _effective_pressure(
    evaluation: Evaluation, result: Any, budget: ErrorBudget
) -> list[ErrorPart | None]:
    """Evaluate the error of solving cells under their effective pressure."""
    return [effective_pressure_part(evaluation.request.version.scene, result)]


def _thin_gap(evaluation: Evaluation, result: Any, budget: ErrorBudget) -> list[ErrorPart | None]:
    """Evaluate the error of Reynolds' equation in a gap that is not thin."""
    return [thin_gap_part(evaluation.request.version.scene, leakage_of(result))]


def _plastic_law(
    evaluation: Evaluation, result: Any, budget: ErrorBudget
) -> list[ErrorPart | None]:
    """Evaluate the error of limiting the contact pressure by the hardness."""
    request = evaluation.request
    ratio = request.hardness_over_yield
    return [plastic_law_part(request.version.scene, result, leakage_of(result), ratio)]


def _form_of_the_patch(
    evaluation: Evaluation, result: Any, budget: ErrorBudget
) -> list[ErrorPart | None]:
    """Evaluate the error of not knowing which part of a measured patch is form."""
    version = evaluation.request.version
    effect = evaluation.request.form_effect
    if effect is None:
        return []
    waves = version.longest_waves
    rises = waves is not None and waves.rises
    return [patch_form_part(effect, result.steps, leakage_of(result), rises=rises)]


def _longer_waves(
    evaluation: Evaluation, result: Any, budget: ErrorBudget
) -> list[ErrorPart | None]:
    """Evaluate the error of leaving out waves longer than the measured patch, which only stochastic seals have."""
    version = evaluation.request.version
    if not isinstance(result, StochasticResult):
        return []
    changes = version.longer_waves(evaluation.request.grid.scene.surface, evaluation.mapper)
    if changes is None:
        return []
    has_flatness = version.flatness is not None
    return [longer_waves_part(changes, has_flatness, result.steps, leakage_of(result))]


def _continuation(
    evaluation: Evaluation, result: Any, budget: ErrorBudget
) -> list[ErrorPart | None]:
    """Evaluate the error of continuing the spectrum. It is unknown if solving one of the versions failed."""
    version, grid = evaluation.request.version, evaluation.request.grid
    continuation = version.continuation
    unchanged = evaluation.solve(grid).get(solved_study(study_of_result(result)).key)
    if continuation is None or unchanged is None:
        return []
    unknown = CoarserSolution(
        grid.scene.surface.shape, np.full(len(grid.scene.steps), np.nan), unchanged.leakage
    )
    solutions = [
        evaluation.on_grid(continued_version, result) or unknown
        for continued_version in evaluation.request.continued
    ]
    # the last version lacks the shortest octave of waves, see `continued_versions`
    *other_phases, without_octave = solutions
    smoother_surface = version.scene.surface.low_pass(2 * continuation.cut_off)
    shorter = replace(without_octave, rms_slope=smoother_surface.rms_slope)
    slope_ratio = _slope_ratio_beyond(version.scene.surface, continuation, grid.scene)
    in_contact: Array = contact_fraction_of(result, version.scene.steps)
    leakage = leakage_of(result)
    return [
        continuation_part(version.scene, leakage, in_contact, other_phases, shorter, slope_ratio)
    ]


def _slope_ratio_beyond(surface: Surface, continuation: Continuation, scene: Scene) -> float:
    """Compute the ratio of the rms slope of a surface to its rms slope with the missing short waves.

    The missing waves are those below the cut-off wavelength of the surface. They are considered down to the shortest
    wave that is relevant for the contact, but over one octave at least and one decade at most.
    """
    cut_off = continuation.cut_off
    last_wave = continuation.shortest_relevant_wave(scene.law.mean_hardness, scene.surface_modulus)
    shortest = float(np.clip(last_wave, cut_off / UNSEEN, cut_off / 2))
    square_slope_beyond = continuation.law.slope_power(cut_off, shortest)
    return surface.rms_slope / hypot(surface.rms_slope, sqrt(square_slope_beyond))


def _changed_versions(request: BudgetRequest, name: str) -> list[Version | None]:
    """List the versions of the input in which the model is changed for the error source with this name."""
    versions: list[Version | None] = []
    for changed in request.changes:
        if changed.change.name == name:
            versions += [changed.version, changed.opposite_version]
    return versions


def _changed_model(
    evaluation: Evaluation, result: Any, budget: ErrorBudget, name: str
) -> list[ErrorPart | None]:
    """Evaluate the error source with this name by changing the model.

    The opposite change is only solved if it matters, see `opposite_matters`.
    """
    parts: list[ErrorPart | None] = []
    leakage = leakage_of(result)
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


def _source_of_changes(name: str) -> ErrorSource:
    """Make the error source with this name, which is evaluated by changing the model, see `model_changes`."""
    return ErrorSource(
        name, partial(_changed_versions, name=name), partial(_changed_model, name=name)
    )


#: All sources of error, in the order in which they are evaluated and shown. The row of the source "patch" is called
#: "patches" for three or more patches, and "blocks" for a surface by blocks.
SOURCES = (
    ErrorSource("solver", _no_versions, _solver, of_model=False),
    ErrorSource("pixels", lambda request: [request.coarser], _pixels, of_model=False),
    ErrorSource("filter", lambda request: [request.smoother], _filter, of_model=False),
    ErrorSource("realisations", _no_versions, _realisations, of_model=False),
    ErrorSource("patch", _no_versions, _patch, of_model=False),
    ErrorSource("effective pressure", _no_versions, _effective_pressure),
    ErrorSource("thin gap", _no_versions, _thin_gap),
    ErrorSource("plastic law", _no_versions, _plastic_law),
    ErrorSource("form of the patch", _no_versions, _form_of_the_patch),
    ErrorSource("longer waves", _no_versions, _longer_waves),
    ErrorSource("continuation", lambda request: request.continued, _continuation),
    _source_of_changes("hardness"),
    _source_of_changes("fluid pressure"),
    _source_of_changes("form"),
)


def versions_of_budget(request: BudgetRequest) -> list[Version]:
    """List all versions of the input that an error budget may solve in addition to the run."""
    wanted = [source for source in SOURCES if source.is_wanted(request)]
    versions = [version for source in wanted for version in source.versions(request)]
    return [version for version in versions if version is not None]


def budgets_of(
    request: BudgetRequest,
    studies: Mapping[str, Any],
    mapper: Mapper,
    known: Mapping[str, ErrorBudget] | None = None,
) -> dict[str, ErrorBudget]:
    """Make the error budget of every study of a run.

    Parameters
    ----------
    request : input of the run, and the requested error sources.
    studies : results of the studies, by the key of the study.
    mapper : computes the items of a stage.
    known : budgets that already contain the numerical errors, by the key of the study. These errors are not estimated
        again.

    Returns the error budget of each study, by the key of the study.
    """
    known_budgets = known or {}
    evaluation = Evaluation(request, mapper)
    budgets = dict(known_budgets)
    for source in SOURCES:
        if not source.is_wanted(request):
            continue
        for key, result in studies.items():
            if not source.of_model and key in known_budgets:
                continue
            if key not in budgets:
                errors = NumericalErrors(request.version.scene, result)
                budgets[key] = errors.budget_of([])
            budget = budgets[key]
            parts = [part for part in source.parts(evaluation, result, budget) if part is not None]
            budgets[key] = replace(budget, parts=(*budget.parts, *parts))
    return budgets

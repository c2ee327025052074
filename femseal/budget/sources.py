"""The sources of error of the leakage of a run: a list, which the run and its forecast iterate alike.

Each source has the versions of the input that are solved for it, and its evaluation for the result of one study. To add
one, write both as functions, and enter it into `SOURCES`; one of the model also into `MODEL_PARTS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import hypot, sqrt
from typing import Any

import numpy as np

from ..base import Array, Mapper
from ..studies import StochasticResult, study_of_result
from ..studies.study_registry import contact_fraction_of
from ..topography.conditioning import UNSEEN
from .changed_models import ModelChange, model_changes, model_part, opposite_matters
from .error_parts import CoarserSolution, ErrorBudget, ErrorPart
from .estimates import (
    effective_pressure_part,
    error_budget,
    longer_waves_part,
    patch_form_part,
    thin_gap_part,
)
from .resolution import continuation_part
from .versions import (
    Version,
    VersionLeakage,
    against,
    coarser_grid,
    continued_versions,
    kept_slope,
    leakage_of,
    route,
    solved_version,
    without_filtered_waves,
)


@dataclass(frozen=True)
class BudgetRequest:
    """What an error budget is made of.

    version : the input of the run. model_parts : names of the parts of the model that are wanted.
    hardness : relative error of the hardness.
    """

    version: Version
    model_parts: Sequence[str] = ()
    hardness: float = 0.1

    @cached_property
    def coarser(self) -> Version | None:
        """The version on fewer points; None where that shows nothing, as of cells of too few pixels to be halved."""
        return coarser_grid(self.version)

    @cached_property
    def smoother(self) -> Version | None:
        """The version without its shortest octave of waves; None where no waves were removed."""
        return without_filtered_waves(self.version)

    @property
    def grid(self) -> Version:
        """The version on which changes of the model are solved."""
        return self.coarser or self.version

    @cached_property
    def continued(self) -> list[Version]:
        """Versions with other continued waves."""
        return continued_versions(self.grid)

    @cached_property
    def changes(self) -> list[tuple[ModelChange, Version, Version | None]]:
        """Changes of the model and the input, each with its version and that of its opposite."""
        grid, found = self.grid, []
        for change in model_changes(grid.scene, self.model_parts, self.hardness, grid.form):
            opposite = change.opposite
            back = None if opposite is None else grid.changed(opposite)
            found.append((change, grid.changed(change), back))
        return found


class Evaluation:
    """What sources are evaluated with: the request, and the leakage of versions, each of which is solved once."""

    def __init__(self, request: BudgetRequest, mapper: Mapper) -> None:
        self.request = request
        self.mapper = mapper
        self._solved: dict[int, tuple[Version, dict[str, VersionLeakage]]] = {}

    def solve(self, version: Version) -> dict[str, VersionLeakage]:
        """Leakage of the studies of a version, by key."""
        if id(version) not in self._solved:
            self._solved[id(version)] = version, solved_version(version, self.mapper)
        return self._solved[id(version)][1]

    def on_grid(self, version: Version, result: Any) -> CoarserSolution | None:
        """Leakage of a version against that of the grid which it changes; None where one of them failed."""
        key = route(study_of_result(result)).key
        plain = self.solve(self.request.grid).get(key)
        found = self.solve(version).get(key)
        if plain is None or found is None:
            return None
        return CoarserSolution(version.scene.surface.shape, found.leakage, plain.leakage)


#: Makes the parts of a source for the result of a study, from its budget without them.
Parts = Callable[[Evaluation, Any, ErrorBudget], Sequence[ErrorPart | None]]


@dataclass(frozen=True)
class ErrorSource:
    """A source of error.

    name : of its row in the budget. versions : all that may be solved for it. parts : see `Parts`.
    of_model : whether it is of the model and its input, and chosen by its name.
    """

    name: str
    versions: Callable[[BudgetRequest], Sequence[Version | None]]
    parts: Parts
    of_model: bool = True

    def is_wanted(self, request: BudgetRequest) -> bool:
        """Whether a budget has it."""
        return not self.of_model or self.name in request.model_parts


def _no_versions(request: BudgetRequest) -> list[Version | None]:
    return []


def _numbers_of(made: Evaluation, result: Any, budget: ErrorBudget) -> tuple[ErrorPart, ...]:
    """Parts of the numbers, by the solutions on fewer points and without the shortest waves."""
    request, version = made.request, made.request.version
    coarser, smoother = request.coarser, request.smoother
    coarse = {} if coarser is None else made.solve(coarser)
    filtered = None
    if smoother is not None:
        filtered = against(result, smoother, made.solve(smoother))
    surface = version.scene.surface
    found = error_budget(
        version.scene,
        result,
        coarse=[against(result, request.grid, coarse)],
        filtered=filtered,
        kept_slope=kept_slope(version),
        wave_pixels=version.conditioning.shortest_wave / max(surface.spacing),
    )
    return found.parts


def _effective_pressure(
    made: Evaluation, result: Any, budget: ErrorBudget
) -> list[ErrorPart | None]:
    return [effective_pressure_part(made.request.version.scene, result)]


def _thin_gap(made: Evaluation, result: Any, budget: ErrorBudget) -> list[ErrorPart | None]:
    return [thin_gap_part(made.request.version.scene, leakage_of(result))]


def _form_of_the_patch(
    made: Evaluation, result: Any, budget: ErrorBudget
) -> list[ErrorPart | None]:
    version = made.request.version
    if version.form_effect is None:
        return []
    rises = bool(version.holds and version.holds.rises)
    return [patch_form_part(version.form_effect, result.steps, leakage_of(result), rises=rises)]


def _longer_waves(made: Evaluation, result: Any, budget: ErrorBudget) -> list[ErrorPart | None]:
    version = made.request.version
    if not isinstance(result, StochasticResult):
        return []
    changes = version.longer_waves(made.request.grid.scene.surface, made.mapper)
    if changes is None:
        return []
    flat = version.flatness is not None
    return [longer_waves_part(changes, flat, result.steps, leakage_of(result))]


def _continuation(made: Evaluation, result: Any, budget: ErrorBudget) -> list[ErrorPart | None]:
    """Part of the continued waves; where a version of them failed its leakage is unknown."""
    version, grid = made.request.version, made.request.grid
    continued = version.continuation
    plain = made.solve(grid).get(route(study_of_result(result)).key)
    if continued is None or plain is None:
        return []
    shape, unknown = grid.scene.surface.shape, np.full(len(grid.scene.steps), np.nan)
    solutions = [
        made.on_grid(one, result) or CoarserSolution(shape, unknown, plain.leakage)
        for one in made.request.continued
    ]
    surface, cut_off = version.scene.surface, continued.cut_off
    *others, last = solutions
    shorter = replace(last, rms_slope=surface.low_pass(2 * cut_off).rms_slope)
    # an octave beyond the cut-off at least, and a decade at most
    law, modulus = grid.scene.law, grid.scene.modulus
    ends = continued.last_that_counts(law.mean_hardness, modulus)
    shortest = float(np.clip(ends, cut_off / UNSEEN, cut_off / 2))
    beyond = continued.law.slope_power(cut_off, shortest)
    kept = surface.rms_slope / hypot(surface.rms_slope, sqrt(beyond))
    in_contact: Array = contact_fraction_of(result, version.scene.steps)
    leakage = leakage_of(result)
    return [continuation_part(version.scene, leakage, in_contact, others, shorter, kept)]


def _changed_versions(request: BudgetRequest, name: str) -> list[Version | None]:
    """Versions with a change of the model; its opposite is solved where that matters for the whole interval."""
    versions: list[Version | None] = []
    for change, there, back in request.changes:
        if change.name == name:
            versions += [there, back]
    return versions


def _changed_model(
    made: Evaluation, result: Any, budget: ErrorBudget, name: str
) -> list[ErrorPart | None]:
    """Part of a change of the model, its opposite being solved where the mirror image would matter."""
    parts: list[ErrorPart | None] = []
    leakage = leakage_of(result)
    for change, there, back in made.request.changes:
        if change.name != name:
            continue
        solution = made.on_grid(there, result)
        if solution is None:
            continue
        part = model_part(change, result.steps, leakage, solution)
        if back is not None and opposite_matters(part, budget):
            opposite = made.on_grid(back, result)
            part = model_part(change, result.steps, leakage, solution, opposite)
        parts.append(part)
    return parts


def _source_of_changes(name: str) -> ErrorSource:
    return ErrorSource(
        name, partial(_changed_versions, name=name), partial(_changed_model, name=name)
    )


#: All sources of error, in the order in which they are evaluated and shown. The first has several rows: solver, pixels,
#: filter, realisations, and patch, places or blocks.
SOURCES = (
    ErrorSource(
        "numbers", lambda request: [request.coarser, request.smoother], _numbers_of, of_model=False
    ),
    ErrorSource("effective pressure", _no_versions, _effective_pressure),
    ErrorSource("thin gap", _no_versions, _thin_gap),
    ErrorSource("form of the patch", _no_versions, _form_of_the_patch),
    ErrorSource("longer waves", _no_versions, _longer_waves),
    ErrorSource("continuation", lambda request: request.continued, _continuation),
    _source_of_changes("hardness"),
    _source_of_changes("fluid pressure"),
    _source_of_changes("form"),
)


def versions_of_budget(request: BudgetRequest) -> list[Version]:
    """All versions of the input that an error budget may solve besides."""
    wanted = [source for source in SOURCES if source.is_wanted(request)]
    versions = [version for source in wanted for version in source.versions(request)]
    return [version for version in versions if version is not None]


def budgets_of(
    request: BudgetRequest,
    studies: Mapping[str, Any],
    mapper: Mapper,
    known: Mapping[str, ErrorBudget] | None = None,
) -> dict[str, ErrorBudget]:
    """Make the error budget of every study of a run, by its key.

    studies : results by key. known : budgets that are there already, without parts of the model.
    """
    made, budgets = Evaluation(request, mapper), dict(known or {})
    for source in SOURCES:
        for key, result in studies.items():
            if not source.of_model and key in (known or {}):
                continue
            if not source.is_wanted(request):
                continue
            budget = budgets.get(key) or _empty(request.version, result)
            parts = [part for part in source.parts(made, result, budget) if part is not None]
            budgets[key] = replace(budget, parts=(*budget.parts, *parts))
    return budgets


def _empty(version: Version, result: Any) -> ErrorBudget:
    """The budget of a study without any part."""
    scene, leakage = version.scene, leakage_of(result)
    parted = tuple(s for s, _ in scene.parted_steps if np.isnan(leakage[s]))
    return ErrorBudget(study_of_result(result).name, leakage, (), scene.steps, parted)

"""Solve the versions of the input that the error sources of a run need, each version only once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from ..base import Mapper
from ..checks import FormEffect
from ..materials import HARDNESS_FACTOR
from ..studies import StudyResult, study_of_result
from .changed_models import ModelChange, model_changes
from .leakage_changes import CoarserSolution
from .study_input import StudyInput
from .versions import (
    VersionLeakage,
    coarser_grid,
    continued_versions,
    solved_study,
    solved_version,
    without_filtered_waves,
)


class ChangedInput(NamedTuple):
    """A change of the model, the input with this change, and the input with the opposite change.

    `opposite_version` is None if the model has no change in the opposite direction.
    """

    change: ModelChange
    version: StudyInput
    opposite_version: StudyInput | None


@dataclass(frozen=True)
class BudgetRequest:
    """Input of a run and the options of its error budget.

    Parameters
    ----------
    version : StudyInput
        Input of the run.
    model_parts : names of the error sources of the model that the budget is to contain.
    hardness : float
        Relative error of the hardness.
    hardness_over_yield : float
        Ratio of hardness to yield stress of the softer solid.
    form_effect : effect of the form deviation of a measured patch on the leakage; None if the effect was not computed.
    """

    version: StudyInput
    model_parts: Sequence[str] = ()
    hardness: float = 0.1
    hardness_over_yield: float = HARDNESS_FACTOR
    form_effect: FormEffect | None = None

    @cached_property
    def coarser(self) -> StudyInput | None:
        """Version of the input with fewer points; None if the cells have too few pixels for a coarser grid."""
        return coarser_grid(self.version)

    @cached_property
    def smoother(self) -> StudyInput | None:
        """Version of the input without the shortest octave of waves; None if no waves were removed from the surface."""
        return without_filtered_waves(self.version)

    @property
    def grid(self) -> StudyInput:
        """Unchanged input, on the grid that is used for the changes of the model."""
        return self.coarser or self.version

    @cached_property
    def continued(self) -> list[StudyInput]:
        """Versions of the input that show the error of extrapolating the spectrum, see `continued_versions`."""
        return continued_versions(self.grid)

    @cached_property
    def changes(self) -> list[ChangedInput]:
        """Each change of the model, with the version of the input that has this change."""
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
        """Store the request and the mapper, without solving anything yet."""
        self.request = request
        self.mapper = mapper
        # each solved version, with its leakages by the key of the study
        self._solved: list[tuple[StudyInput, dict[str, VersionLeakage]]] = []

    def solve(self, version: StudyInput) -> dict[str, VersionLeakage]:
        """Return the leakage from each study for a version of the input, by the key of the study."""
        for solved, leakages in self._solved:
            if solved is version:
                return leakages
        leakages = solved_version(version, self.mapper)
        self._solved.append((version, leakages))
        return leakages

    def on_grid(self, version: StudyInput, result: StudyResult) -> CoarserSolution | None:
        """Compare the leakages of a changed and the unchanged version of the input on equal grids.

        The result is None if the study failed for the changed or for the unchanged version.
        """
        key = solved_study(study_of_result(result)).key
        unchanged = self.solve(self.request.grid).get(key)
        changed = self.solve(version).get(key)
        if unchanged is None or changed is None:
            return None
        return CoarserSolution(version.scene.surface.shape, changed.leakage, unchanged.leakage)

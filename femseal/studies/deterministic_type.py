"""Describe the deterministic study to a run: contact and flow of the whole surface, see `face_study`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ..base import Mapper
from .study_type import Study, StudyCost, StudyOptions

if TYPE_CHECKING:
    from ..scene import Scene
    from .face_result import FaceResult


class DeterministicStudy(Study):
    """Solve contact and flow on all pixels of the surface."""

    name = "deterministic"
    marker = ("x", 4)
    needs_cells = False
    has_pixel_fields = True

    def solve(self, scene: Scene, options: StudyOptions, mapper: Mapper) -> FaceResult:
        """Solve the study, see `face_study.deterministic`."""
        from .face_study import deterministic

        return deterministic(scene, mapper=mapper)

    def cost(self, scene: Scene, options: StudyOptions) -> StudyCost:
        """Estimate the cost of contact and flow of the whole surface."""
        from .cost_model import surface_cost

        return surface_cost(scene)

    def check(self, scene: Scene, options: StudyOptions) -> None:
        """Raise InputError if a spiral lay is not possible on this surface."""
        scene.check_spiral()

    def description(self, scene: Scene, options: StudyOptions) -> Iterator[tuple[str, str]]:
        """Say how many contact and flow problems the study solves."""
        from .cost_model import surface_problems

        yield self.name, surface_problems(scene)


DETERMINISTIC = DeterministicStudy()

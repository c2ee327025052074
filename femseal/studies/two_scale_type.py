"""Describe the two-scale study to a run: the whole surface, and the flow through its cells, see `face_study`."""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from typing import TYPE_CHECKING

from ..base import Mapper, counted
from .deterministic_type import DETERMINISTIC
from .study_type import Study, StudyCost, StudyOptions

if TYPE_CHECKING:
    from ..scene import Scene
    from .face_result import FaceResult


class TwoScaleStudy(Study):
    """Solve contact and flow on all pixels of the surface, and the flow through each of its cells."""

    name = "two-scale"
    marker = ("D", 5.5)
    contained = DETERMINISTIC
    has_pixel_fields = True

    def solve(self, scene: Scene, options: StudyOptions, mapper: Mapper) -> FaceResult:
        """Solve the study, see `face_study.two_scale`."""
        from .face_study import two_scale

        assert options.cells is not None
        return two_scale(scene, options.cells, mapper=mapper)

    def contained_result(self, result: FaceResult) -> FaceResult:
        """Return the result of the deterministic study, which is the result without its cells."""
        return result.without_cells

    def cost(self, scene: Scene, options: StudyOptions) -> StudyCost:
        """Estimate the cost of the whole surface and of its cells."""
        from .cost_model import FLOW_SECONDS, surface_cost

        surface_seconds, memory = surface_cost(scene)
        if options.surface_is_solved:
            surface_seconds = 0.0
        # the cells of a step have as many pixels as the surface, and their flow is solved along both axes
        cell_seconds = 2 * len(scene.steps) * scene.surface.heights.size * FLOW_SECONDS
        return StudyCost(surface_seconds + cell_seconds, memory)

    def check(self, scene: Scene, options: StudyOptions) -> None:
        """Raise InputError if a spiral lay is not possible on this surface."""
        scene.check_spiral()

    def description(self, scene: Scene, options: StudyOptions) -> Iterator[tuple[str, str]]:
        """Say how many problems of the surface and of its cells the study solves."""
        from .cost_model import surface_problems

        cells = prod(options.cells or (0, 0))
        # every cell is solved along both axes
        cell_problems = counted(2 * len(scene.steps) * cells, "flow solution")
        yield self.name, f"{surface_problems(scene)}, {cell_problems} of cells"


TWO_SCALE = TwoScaleStudy()

"""Describe the study by blocks to a run: a large surface, of which one block at a time is solved, see `blocks`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ..base import Mapper, Shape
from .study_type import Study, StudyCost, StudyOptions

if TYPE_CHECKING:
    from ..scene import Scene
    from ..topography import Topography
    from .blocks import BlocksResult

#: Memory of a pixel of a surface that is split into blocks [byte], for the heights before and after the split.
_SPLIT_BYTES = 16


class BlocksStudy(Study):
    """Solve a surface that is too large for the memory of the machine block by block."""

    name = "blocks"
    marker = ("s", 5)
    needs_equal_cells = True
    solves_whole_surface = False
    uses_mirrors = True
    patch_source = "blocks"

    def solve(self, scene: Scene, options: StudyOptions, mapper: Mapper) -> BlocksResult:
        """Solve the study, see `blocks.by_blocks`."""
        from .block_division import blocks_of
        from .blocks import by_blocks

        return by_blocks(scene, blocks_of(options.cells), mapper=mapper)

    def cost(self, scene: Scene, options: StudyOptions) -> StudyCost:
        """Estimate the cost of all blocks.

        The contact of each block is solved twice: for its rough layer and for its cells.
        """
        from .block_division import blocks_of
        from .cost_model import (
            CONTACT_SECONDS,
            FLOW_SECONDS,
            TABULATED_STATES,
            count_pressures,
            state_memory,
        )

        pixels = scene.surface.heights.size
        b1, b2 = blocks_of(options.cells)
        # three flows for each fluid pressure: through the block, and through its cells along each of the two axes
        flow_seconds = 3 * count_pressures(scene) * FLOW_SECONDS
        seconds = TABULATED_STATES * pixels * (2 * CONTACT_SECONDS + flow_seconds)
        return StudyCost(seconds, state_memory(pixels / (b1 * b2)) + _SPLIT_BYTES * pixels)

    def check(self, scene: Scene, options: StudyOptions) -> None:
        """Raise InputError if the surface cannot be divided into blocks."""
        from .block_division import blocks_of, check_blocks

        check_blocks(scene, blocks_of(options.cells))

    def description(self, scene: Scene, options: StudyOptions) -> Iterator[tuple[str, str]]:
        """Say how large the blocks are, and how many contact states of each are solved."""
        from .block_division import blocks_of
        from .cost_model import TABULATED_STATES

        b1, b2 = blocks_of(options.cells)
        n1, n2 = scene.surface.shape
        blocks = f"{b1} × {b2} blocks of {n1 // b1} × {n2 // b2} points"
        yield self.name, f"{blocks}, about {TABULATED_STATES:.0f} states of each"

    def usual_cells(
        self, patch: Topography, points: Shape, shortest_wave: float, in_order: bool
    ) -> Shape:
        """Choose the cells of the largest blocks that have at most 1024 points along a side."""
        from .block_division import BLOCK_CELLS, usual_blocks

        b1, b2 = usual_blocks(points)
        return BLOCK_CELLS * b1, BLOCK_CELLS * b2

    def state_count(self, scene: Scene, options: StudyOptions) -> int:
        """Return the usual number of contact states at tabulated pressures."""
        from .cost_model import TABULATED_STATES

        return round(TABULATED_STATES)


BLOCKS = BlocksStudy()

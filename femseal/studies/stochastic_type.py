"""Describe the stochastic study to a run: realisations of a seal of any size and shape, see `stochastic_study`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ..base import Mapper, Shape, counted, to_text
from .study_type import Study, StudyCost, StudyOptions

if TYPE_CHECKING:
    from ..scene import Scene
    from ..seal.tiles import SealTiles
    from ..topography import Topography
    from .stochastic_result import StochasticResult

#: Time on one core [s] and memory [byte] of the flow over a seal, for each element.
_ELEMENT_SECONDS, _ELEMENT_BYTES = 7e-6, 4e3
#: Mean number of times that the flow over a seal is solved if permeabilities depend on the fluid pressure.
_PRESSURE_SOLUTIONS = 2.0
#: Memory of a pixel of a plastic deformation, from which an unloading begins, in double precision [byte].
_PLASTIC_BYTES = 8.0


class StochasticStudy(Study):
    """Solve realisations of a seal, whose tiles take random cells of the surface."""

    name = "stochastic"
    table = "stochastic"
    has_realisations = True
    chooses_cells = True

    @property
    def label(self) -> str:
        """Name of the median of the realisations in legends and tables."""
        return "median"

    @property
    def title(self) -> str:
        """Name of the median of the realisations in the title of a picture."""
        return "median of the realisations"

    def solve(self, scene: Scene, options: StudyOptions, mapper: Mapper) -> StochasticResult:
        """Solve the study, see `stochastic_study.stochastic`."""
        from .stochastic_study import stochastic

        assert options.sampling is not None
        return stochastic(scene, options.cells, options.sampling, mapper=mapper)

    def cost(self, scene: Scene, options: StudyOptions) -> StudyCost:
        """Estimate the cost as the sum of all contact states with their cells, and of all realisations."""
        from .cost_model import (
            FLOW_SECONDS,
            TABULATED_STATES,
            count_pressures,
            state_memory,
            states_memory,
            surface_seconds,
        )
        from .sampling import cut_and_tiles, uses_tabulated_pressures, usual_realisations

        assert options.sampling is not None
        cut, tiles = cut_and_tiles(scene, options.cells, options.sampling)
        pixels, steps = scene.surface.heights.size, len(scene.steps)
        elements = len(tiles.tile)
        pressures = count_pressures(scene)
        fluid_acts = scene.acting_fluid is not None
        # time of one contact state: flow through all cells along both axes, and contact and flow of the whole surface
        # unless another study has solved them at the same loads
        is_solved = options.surface_is_solved and scene.flow.spiral is None
        state_seconds = 2 * pressures * pixels * FLOW_SECONDS
        if not (is_solved and tiles.in_order):
            state_seconds += surface_seconds(scene, fluid_acts and tiles.in_order)
        is_tabulated = uses_tabulated_pressures(scene, options.sampling) and not tiles.in_order
        state_count = TABULATED_STATES if is_tabulated else steps
        # time of all realisations at all load steps
        realisations = options.sampling.realisations or usual_realisations(cut.shape, tiles)
        k_depends_on_pressure = pressures > 1 or (fluid_acts and not tiles.in_order)
        solutions_per_step = _PRESSURE_SOLUTIONS if k_depends_on_pressure else 1.0
        seal_seconds = solutions_per_step * realisations * steps * elements * _ELEMENT_SECONDS
        memory = state_memory(pixels) + _ELEMENT_BYTES * elements
        if tiles.in_order:
            # the stochastic study stores all contact states of the surface; another study that has solved the surface
            # stores them as well
            storing_studies = 2 if is_solved else 1
            memory += storing_studies * states_memory(pixels, steps)
        return StudyCost(state_count * state_seconds + seal_seconds, memory)

    def description(self, scene: Scene, options: StudyOptions) -> Iterator[tuple[str, str]]:
        """Describe the contact states that the study solves, its realisations, and its pressure map."""
        from .cost_model import TABULATED_STATES
        from .sampling import uses_tabulated_pressures
        from .tile_pressure import describe_map

        sampling = options.sampling
        if sampling is None:
            return
        tiles = _tiles(scene, options)
        states = f"{counted(len(scene.steps), 'state')} of the face, at its loads"
        if tiles.in_order:
            states += "; cells stay in their rows"
        elif uses_tabulated_pressures(scene, sampling):
            states = f"about {TABULATED_STATES:.0f} states of the face, at tabulated pressures"
        yield self.name, states
        length = to_text(tiles.size[1], "m", 3)
        covered = f"{length} long"
        if tiles.covered_fraction < 1:
            covered = f"{100 * tiles.covered_fraction:.2g} % of a length of {length}"
        if sampling.realisations is None:
            yield "", f"seals of {tiles}, {covered}, as many as the 95 % interval needs"
        else:
            yield "", f"{counted(sampling.realisations, 'seal')} of {tiles}, {covered}"
        uneven_pressure = describe_map(scene, tiles, sampling.pressure_map)
        if uneven_pressure:
            yield "pressure map", uneven_pressure

    def usual_cells(
        self, patch: Topography, points: Shape, shortest_wave: float, in_order: bool
    ) -> Shape:
        """Choose the cells as the study itself does, see `face.cut.usual_cells`."""
        from ..face.cut import usual_cells

        return usual_cells(patch, in_order=in_order)

    def least_points(self, cells: Shape) -> Shape:
        """Return the numbers of points with which each cell has the smallest permitted number of points."""
        from ..face.cut import FEWEST_POINTS

        return FEWEST_POINTS * cells[0], FEWEST_POINTS * cells[1]

    def stores_states(self, scene: Scene, options: StudyOptions) -> bool:
        """Return True for cells in order. With cells at random, only the cell permeabilities are stored."""
        return _tiles(scene, options).in_order

    def state_count(self, scene: Scene, options: StudyOptions) -> int:
        """Return the number of load steps or, for cells at tabulated pressures, the usual number of these pressures."""
        from .cost_model import TABULATED_STATES
        from .sampling import uses_tabulated_pressures

        assert options.sampling is not None
        if uses_tabulated_pressures(scene, options.sampling):
            return round(TABULATED_STATES)
        return len(scene.steps)

    def other_stored_bytes(self, scene: Scene, options: StudyOptions) -> float:
        """Estimate the size of the plastic deformations at tabulated pressures, of which at least one is stored."""
        if _tiles(scene, options).in_order:
            return 0.0
        peaks = len({*scene.unload_from})
        return _PLASTIC_BYTES * scene.surface.heights.size * max(peaks, 1)


def _tiles(scene: Scene, options: StudyOptions) -> SealTiles:
    """Return the tiles of the seal."""
    from .sampling import cut_and_cover

    assert options.sampling is not None
    _, tiles = cut_and_cover(scene.surface, scene.layout, options.cells, options.sampling)
    return tiles


STOCHASTIC = StochasticStudy()

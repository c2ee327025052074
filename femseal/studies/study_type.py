"""Define what a run must know of a study: the properties and methods of the class `Study`.

Each study that a case can choose is an instance of a subclass of `Study`, listed in `study_list.STUDIES`. Code outside
the studies asks the instance for its properties, and never compares the name of a study. The subclasses import their
solvers inside methods, so that a case can be checked without loading the solvers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from ..base import Mapper, Shape, counted

if TYPE_CHECKING:
    from ..scene import Scene
    from ..topography import Topography
    from .sampling import Sampling
    from .study_result import StudyResult

#: Smallest side length of the cells in a study of a surface, as a multiple of the shortest wavelength, if the case does
#: not specify the cells.
_USUAL_WAVES = 8
#: Relative error of lengths that are computed in different ways.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class StudyOptions:
    """Options of all studies. A study ignores the options of other studies.

    Parameters
    ----------
    cells : (int, int), optional
        Numbers of cells of the surface along x1 and x2.
    sampling : Sampling, optional
        Options of the stochastic study: size of the seal, realisations, and contact pressure over the seal.
    surface_is_solved : bool
        Whether another study of the run has already solved contact and flow of the whole surface at the load steps.
    """

    cells: Shape | None = None
    sampling: Sampling | None = None
    surface_is_solved: bool = False


class StudyCost(NamedTuple):
    """Expected time on one core [s] and expected memory [byte] of a study."""

    seconds: float
    memory: float


class Study:
    """Describe a study that a case can choose.

    A subclass defines `name`, `solve` and `cost`. All other properties and methods have defaults, which suit a study
    that solves contact and flow of the whole surface.
    """

    #: Name in case files, messages and timings.
    name: ClassVar[str]
    #: Marker and its size [points] in pictures in which another study gives the curve.
    marker: ClassVar[tuple[str, float]] = ("o", 4)
    #: Study whose result is part of the result of this study, with the same leakage. A run that contains both solves
    #: only this study. For the error budget, the versions of the input are solved with the contained study, which is
    #: faster and has the same leakage.
    contained: ClassVar[Study | None] = None

    #: Table that a case with this study must have, "" for none.
    table: ClassVar[str] = ""
    #: Whether the study solves realisations of a seal of any size and shape, which is covered with tiles. All other
    #: studies solve a strip as large as the surface.
    has_realisations: ClassVar[bool] = False
    #: Whether the surface is divided into cells.
    needs_cells: ClassVar[bool] = True
    #: Whether all cells must have the same number of points.
    needs_equal_cells: ClassVar[bool] = False
    #: Whether the study can choose the cells together with the tiles of the seal. If the case does not specify the
    #: cells, and all studies with cells have this property, the cells are left open (None) until then. In a run with
    #: other studies, `usual_cells` is used.
    chooses_cells: ClassVar[bool] = False
    #: Whether the study solves contact and flow of the whole surface at once.
    solves_whole_surface: ClassVar[bool] = True
    #: Whether the study solves the contact of mirrored surfaces, whatever the boundary of the surface is.
    uses_mirrors: ClassVar[bool] = False
    #: Whether the result has fields over all pixels of the surface, at every load step.
    has_pixel_fields: ClassVar[bool] = False
    #: Name of the error source that describes the limited size of the measured patch, or of the part solved at once.
    patch_source: ClassVar[str] = "patch"

    @property
    def key(self) -> str:
        """Name with an underscore, for dictionaries of results and names of variables."""
        return self.name.replace("-", "_")

    @property
    def label(self) -> str:
        """Name of the leakage of the study in legends and tables."""
        return self.name

    @property
    def title(self) -> str:
        """Name of the leakage of the study in the title of a picture."""
        return self.label

    @property
    def leakage_variable(self) -> str:
        """Name of the variable in a dataset that contains the leakage of the study."""
        return "leakage_" + self.label.replace("-", "_")

    def solve(self, scene: Scene, options: StudyOptions, mapper: Mapper) -> StudyResult:
        """Solve the study, and return its result."""
        raise NotImplementedError

    def cost(self, scene: Scene, options: StudyOptions) -> StudyCost:
        """Estimate the time and the memory of the study before it is solved."""
        raise NotImplementedError

    def contained_result(self, result: Any) -> Any:
        """Return the result of the study `contained`, which is part of a result of this study."""
        raise NotImplementedError

    def check(self, scene: Scene, options: StudyOptions) -> None:
        """Raise InputError if the study cannot solve a scene; by default, every scene is accepted."""

    def description(self, scene: Scene, options: StudyOptions) -> Iterator[tuple[str, str]]:
        """Say how many problems the study solves, in lines with a name and a text, for `femseal check`.

        A line with the name "" continues the line before it.
        """
        yield self.name, f"{counted(len(scene.steps), 'load step')}"

    # --- grid and cells -------------------------------------------------------------------------------------------

    def usual_cells(
        self, patch: Topography, points: Shape, shortest_wave: float, in_order: bool
    ) -> Shape:
        """Choose the numbers of cells of a patch along x1 and x2, if the case does not specify the cells.

        By default, the sides of a cell are at least eight times the shortest wavelength.

        Parameters
        ----------
        patch : measured patch.
        points : numbers of points of the grid on which the surface is solved.
        shortest_wave : shortest wavelength of the surface [m].
        in_order : whether the cells of a seal stay in their order on the surface.
        """
        side = _USUAL_WAVES * shortest_wave
        m1, m2 = (max(1, int(length / side + _ROUNDING)) for length in patch.size)
        return m1, m2

    def least_points(self, cells: Shape) -> Shape:
        """Return the smallest numbers of points along x1 and x2 of a coarser grid with the given numbers of cells."""
        return 1, 1

    def points_divide_by(self, cells: Shape) -> Shape:
        """Return the divisors of the numbers of points along x1 and x2, for the given numbers of cells."""
        return cells if self.needs_equal_cells else (1, 1)

    # --- size of a run --------------------------------------------------------------------------------------------

    def stores_states(self, scene: Scene, options: StudyOptions) -> bool:
        """Return whether the contact states of the whole surface at all load steps are stored until the study ends."""
        return self.solves_whole_surface

    def state_count(self, scene: Scene, options: StudyOptions) -> int:
        """Estimate the number of contact states that the study solves.

        The number is used only if no study of the run stores its states.
        """
        return len(scene.steps)

    def other_stored_bytes(self, scene: Scene, options: StudyOptions) -> float:
        """Estimate the disk space of stored stages during the run [byte], without those of `stores_states`."""
        return 0.0

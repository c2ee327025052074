"""The studies that a case can choose, each registered once: how it is solved, what it costs, and what it answers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter, methodcaller
from typing import Any

from ..base import Array, Mapper
from .blocks import BlocksResult, blocks_of, by_blocks
from .costs import (
    Effort,
    blocks_cost,
    count_pressures,
    deterministic_cost,
    stochastic_cost,
    two_scale_cost,
)
from .drawn_study import cut_and_tiles, stochastic
from .face_study import FaceResult, deterministic
from .piece_study import two_scale
from .sampling import Sampling
from .scene import Scene
from .stochastic_result import StochasticResult

StudyResult = FaceResult | BlocksResult | StochasticResult


@dataclass(frozen=True)
class StudyOptions:
    """Options of all studies; each takes those that it needs.

    cells : number of pieces of the face along x1 and x2. sampling : see `stochastic`.
    knows_face : another study of the face comes before.
    """

    cells: tuple[int, int] | None = None
    sampling: Sampling | None = None
    knows_face: bool = False


@dataclass(frozen=True)
class Study:
    """A study that a case can choose.

    name : in case files, messages and timings. key : in the names of variables and of results by study.
    label : of its leakage in legends and tables. result : class of its results.
    solve : solve(scene, options, known, mapper) gives its result; known : results of other studies of the scene by key.
    cost : cost(scene, options, efforts) gives the expected time on one core [s] and memory [byte].
    leakage : leakage(result) at every step (steps,) [m²/s], the one that answers.
    needs : options without which it cannot be solved.
    """

    name: str
    key: str
    label: str
    solve: Callable[[Scene, StudyOptions, Mapper], Any]
    cost: Callable[[Scene, StudyOptions, Sequence[Effort]], tuple[float, float]]
    leakage: Callable[[Any], Array]
    needs: tuple[str, ...] = ()

    @property
    def leakage_variable(self) -> str:
        """Name in a dataset of the leakage that answers."""
        return "leakage_" + self.label.replace("-", "_")


def study_of_result(result: StudyResult) -> Study:
    """The study that a result is of."""
    return STUDIES[result.method]


def _solve_deterministic(scene: Scene, options: StudyOptions, mapper: Mapper) -> FaceResult:
    return deterministic(scene, mapper=mapper)


def _solve_two_scale(scene: Scene, options: StudyOptions, mapper: Mapper) -> FaceResult:
    assert options.cells is not None
    return two_scale(scene, options.cells, mapper=mapper)


def _solve_blocks(scene: Scene, options: StudyOptions, mapper: Mapper) -> BlocksResult:
    assert options.cells is not None
    return by_blocks(scene, blocks_of(options.cells), mapper=mapper)


def _solve_stochastic(scene: Scene, options: StudyOptions, mapper: Mapper) -> StochasticResult:
    assert options.sampling is not None
    return stochastic(scene, options.cells, options.sampling, mapper=mapper)


def _cost_deterministic(
    scene: Scene, options: StudyOptions, efforts: Sequence[Effort]
) -> tuple[float, float]:
    acts = scene.acting_fluid is not None
    return deterministic_cost(efforts, scene.surface.shape, count_pressures(scene), acts)


def _cost_two_scale(
    scene: Scene, options: StudyOptions, efforts: Sequence[Effort]
) -> tuple[float, float]:
    """Cost of two scales with the options of a case."""
    assert options.cells is not None
    return two_scale_cost(
        efforts,
        scene.surface.shape,
        options.cells,
        solved=options.knows_face,
        pressures=count_pressures(scene),
        acts=scene.acting_fluid is not None,
    )


def _cost_blocks(
    scene: Scene, options: StudyOptions, efforts: Sequence[Effort]
) -> tuple[float, float]:
    assert options.cells is not None
    pressures = count_pressures(scene)
    return blocks_cost(efforts, scene.surface.shape, blocks_of(options.cells), pressures=pressures)


def _cost_stochastic(
    scene: Scene, options: StudyOptions, efforts: Sequence[Effort]
) -> tuple[float, float]:
    """Cost of the states of the face, and of the seals."""
    assert options.sampling is not None
    cut, tiles = cut_and_tiles(scene, options.cells, options.sampling)
    return stochastic_cost(
        efforts,
        scene.surface.shape,
        cut.shape,
        tiles,
        options.sampling,
        solved=options.knows_face and scene.flow.spiral is None,
        pressures=count_pressures(scene),
        acts=scene.acting_fluid is not None,
    )


#: All studies by name, in the order in which they are solved: each may use the results of those before it. Of several
#: studies of a case the last one answers.
STUDIES: dict[str, Study] = {
    study.name: study
    for study in (
        Study(
            name="deterministic",
            key="deterministic",
            label="deterministic",
            solve=_solve_deterministic,
            cost=_cost_deterministic,
            leakage=attrgetter("leakage"),
        ),
        Study(
            name="two-scale",
            key="two_scale",
            label="two-scale",
            solve=_solve_two_scale,
            cost=_cost_two_scale,
            leakage=attrgetter("leakage"),
            needs=("cells",),
        ),
        Study(
            name="blocks",
            key="blocks",
            label="blocks",
            solve=_solve_blocks,
            cost=_cost_blocks,
            leakage=attrgetter("leakage"),
            needs=("cells",),
        ),
        Study(
            name="stochastic",
            key="stochastic",
            label="median",
            solve=_solve_stochastic,
            cost=_cost_stochastic,
            leakage=methodcaller("quantile", 0.5),
            needs=("sampling",),
        ),
    )
}

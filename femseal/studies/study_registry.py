"""The studies that a case can choose, each registered once: how it is solved, what it costs, and what it answers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter, methodcaller
from typing import Any

from ..base import Array, Pair
from .blocks import BlocksResult, by_blocks
from .costs import (
    Effort,
    StudyOptions,
    blocks_cost,
    deterministic_cost,
    stochastic_cost,
    two_scale_cost,
)
from .drawn_study import stochastic
from .face_study import FaceResult, deterministic
from .piece_study import two_scale
from .scene import Scene
from .stochastic_result import StochasticResult

StudyResult = FaceResult | BlocksResult | StochasticResult


@dataclass(frozen=True)
class Study:
    """A study that a case can choose.

    name : in case files, messages and timings. label : of its leakage in legends and tables.
    takes : names of the `StudyOptions` that `solve` takes.
    solve : solve(scene, *options, mapper=mapper) gives its result.
    cost : cost(scene, options, efforts) gives the expected time on one core [s] and memory [byte].
    leakage : leakage(result) at every step (steps,) [m²/s], the one that answers.
    """

    name: str
    label: str
    takes: tuple[str, ...]
    solve: Callable[..., Any]
    cost: Callable[[Scene, StudyOptions, Sequence[Effort]], Pair]
    leakage: Callable[[Any], Array] = attrgetter("leakage")

    @property
    def key(self) -> str:
        """The name as it is in names of variables, and of results by study."""
        return self.name.replace("-", "_")

    @property
    def leakage_variable(self) -> str:
        """Name in a dataset of the leakage that answers."""
        return "leakage_" + self.label.replace("-", "_")


def study_of_result(result: StudyResult) -> Study:
    """The study that a result is of."""
    return STUDIES[result.method]


#: All studies by name, in the order in which they are solved: each may use the results of those before it. Of several
#: studies of a case the last one answers.
STUDIES: dict[str, Study] = {
    study.name: study
    for study in (
        Study("deterministic", "deterministic", (), deterministic, deterministic_cost),
        Study("two-scale", "two-scale", ("cells",), two_scale, two_scale_cost),
        Study("blocks", "blocks", ("blocks",), by_blocks, blocks_cost),
        Study(
            "stochastic",
            "median",
            ("cells", "sampling"),
            stochastic,
            stochastic_cost,
            methodcaller("quantile", 0.5),
        ),
    )
}

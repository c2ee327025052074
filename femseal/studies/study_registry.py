"""The studies that a case can choose, each registered once: how it is solved, what it answers, and what it costs.

Costs are known before a study is started. Times are those of one core of the machine on which the throughput was
measured, and within a factor, see docs/evidence/forecast.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import log1p
from operator import attrgetter, methodcaller
from typing import Any

import numpy as np

from ..base import Array, Pair, Shape, validate
from ..loads import LoadProgramme
from ..scene import Scene
from ..seal.tiles import SealTiles
from .blocks import BlocksResult, blocks_of, by_blocks
from .face_study import FaceResult, deterministic, state_memory, states_memory, two_scale
from .sampling import FEWEST_SEALS, MOST_SEALS, Sampling
from .stochastic_result import StochasticResult
from .stochastic_study import cut_and_tiles, stochastic

#: Seconds of one core for each pixel: of the contact of a load step, and of the flow through its gap. Fitted to the
#: runs of docs/evidence/forecast.md.
_CONTACT_SECONDS, _FLOW_SECONDS = 6e-7, 5e-7
#: Seconds of one core for each element in the flow over a seal.
_ELEMENT_SECONDS = 7e-6
#: Times that contact and flow of a load step are solved where the fluid presses the surfaces apart.
_ROUNDS = 2.5
#: Solutions of the flow over a seal where permeabilities depend on the pressure, and memory for each element [byte].
_PRESSURE_SOLUTIONS, _ELEMENT_BYTES = 2.0, 4e3
#: Times that the flow of a rarefied gas is solved, whose permeability depends on the pressure.
_SUCCESSIVE = 4.5
#: Number of states of a face on a ladder of nominal pressures.
TABULATED_STATES = 25.0
#: Memory of a point of a face that is split into blocks [byte]: as it is, and split.
_SPLIT_BYTES = 16
#: Largest error of ln(leakage) over the tolerance of the contact, for any from 1e-3 to 1e-7: three times that measured
#: on six faces, elastic and plastic, from open to a hundredth of the leakage, see docs/evidence/only_what_is_needed.md;
#: and the fraction of the error wanted that the tolerance may cause.
TOLERANCE_ERROR, TOLERANCE_FRACTION = 1.9, 0.1


@dataclass(frozen=True)
class StudyOptions:
    """Options of all studies; each takes those that it needs.

    cells : number of cells of the face along x1 and x2. sampling : see `stochastic`.
    surface_is_solved : another study leaves contact and flow of the face at the loads of the scene.
    """

    cells: Shape | None = None
    sampling: Sampling | None = None
    surface_is_solved: bool = False

    @property
    def blocks(self) -> Shape:
        """Numbers of blocks that have so many cells together."""
        return blocks_of(self.cells)


def _surface_seconds(scene: Scene, acts: bool) -> float:
    """Expected time of contact and flow of the whole surface in one load step [s]."""
    flows = _SUCCESSIVE if count_pressures(scene) > 1 else 1.0
    seconds = scene.surface.heights.size * (_CONTACT_SECONDS + flows * _FLOW_SECONDS)
    return _ROUNDS * seconds if acts else seconds


def deterministic_cost(scene: Scene, options: StudyOptions) -> Pair:
    """Return the expected time on one core [s] and the memory [byte] of the deterministic study."""
    pixels, steps = scene.surface.heights.size, len(scene.steps)
    seconds = steps * _surface_seconds(scene, scene.acting_fluid is not None)
    return seconds, states_memory(pixels, steps) + state_memory(pixels)


def two_scale_cost(scene: Scene, options: StudyOptions) -> Pair:
    """Return time and memory of the two-scale study; another one may leave contact and flow of the surface to it."""
    seconds, memory = deterministic_cost(scene, options)
    both_axes = 2 * len(scene.steps) * scene.surface.heights.size * _FLOW_SECONDS
    return (0.0 if options.surface_is_solved else seconds) + both_axes, memory


def blocks_cost(scene: Scene, options: StudyOptions) -> Pair:
    """Return time and memory of a surface in blocks: each is solved twice, as a layer and once more for its cells."""
    pixels = scene.surface.heights.size
    b1, b2 = options.blocks
    flows = 3 * count_pressures(scene) * _FLOW_SECONDS
    seconds = TABULATED_STATES * pixels * (2 * _CONTACT_SECONDS + flows)
    return seconds, state_memory(pixels / (b1 * b2)) + _SPLIT_BYTES * pixels


def stochastic_cost(scene: Scene, options: StudyOptions) -> Pair:
    """Return time and memory of the states of a surface and of the realisations of the seal."""
    assert options.sampling is not None
    cut, tiles = cut_and_tiles(scene, options.cells, options.sampling)
    pixels, steps = scene.surface.heights.size, len(scene.steps)
    elements = len(tiles.tile)
    pressures = count_pressures(scene)
    acts = scene.acting_fluid is not None
    is_solved = options.surface_is_solved and scene.flow.spiral is None
    at_tabulated = uses_tabulated_pressures(scene, options.sampling) and not tiles.in_order
    of_state = 2 * pressures * pixels * _FLOW_SECONDS
    if not (is_solved and tiles.in_order):
        of_state += _surface_seconds(scene, acts and tiles.in_order)
    realisations = options.sampling.realisations or usual_realisations(cut.shape, tiles)
    solutions = _PRESSURE_SOLUTIONS if pressures > 1 or (acts and not tiles.in_order) else 1.0
    seals = solutions * realisations * steps * elements * _ELEMENT_SECONDS
    seconds = (TABULATED_STATES if at_tabulated else steps) * of_state + seals
    memory = state_memory(pixels) + _ELEMENT_BYTES * elements
    if tiles.in_order:  # those of another study are kept beside
        memory += (2 if is_solved else 1) * states_memory(pixels, steps)
    return seconds, memory


def usual_realisations(cells: Shape, tiles: SealTiles) -> int:
    """Number of seals that a band of error usually needs: fewer of long ones, whose leakage scatters less."""
    faces = tiles.count / (cells[0] * cells[1])
    return round(min(max(MOST_SEALS / max(faces, 1.0), FEWEST_SEALS), MOST_SEALS))


def uses_tabulated_pressures(scene: Scene, sampling: Sampling) -> bool:
    """Whether drawn seals take cells from a ladder of nominal pressures, unless these stay in their rows."""
    return scene.acting_fluid is not None or not sampling.presses_evenly


def count_pressures(scene: Scene) -> int:
    """Number of pressures at which permeabilities are needed: 1 unless the law of the fluid depends on it."""
    return scene.flow.drop.pressures.size


def contact_tolerance(accuracy: float) -> float:
    """The largest tolerance of the contact whose error is a small part of the accuracy wanted of the leakage.

    accuracy : relative error that the leakage may have, 0.1 for 10 %.

    Raises InputError: an accuracy that is not a positive number.

    >>> contact_tolerance(0.1), contact_tolerance(0.01), contact_tolerance(1e-9)
    (0.001, 0.0001, 1e-07)
    """
    wanted = TOLERANCE_FRACTION * log1p(validate.number("accuracy", accuracy))
    allowed = (10.0**n for n in range(-3, -7, -1) if TOLERANCE_ERROR * 10.0**n <= wanted)
    return next(allowed, 1e-7)


StudyResult = FaceResult | BlocksResult | StochasticResult


@dataclass(frozen=True)
class Study:
    """A study that a case can choose.

    name : in case files, messages and timings. label : of its leakage in legends and tables.
    option_names : names of the `StudyOptions` that `solve` takes.
    solve : solve(scene, *options, mapper=mapper) gives its result.
    cost : cost(scene, options) gives the expected time on one core [s] and memory [byte].
    leakage : leakage(result) at every step (steps,) [m²/s], the one that answers.
    """

    name: str
    label: str
    option_names: tuple[str, ...]
    solve: Callable[..., Any]
    cost: Callable[[Scene, StudyOptions], Pair]
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


def contact_fraction_of(study: object, steps: LoadProgramme) -> Array:
    """Fraction of the face in contact at every step of a study (steps,), NaN where it is unknown."""
    if isinstance(study, StochasticResult):
        return study.contact_fraction[[study.steps.index(step) for step in steps]]
    return np.asarray(getattr(study, "contact_fraction", np.full(len(steps), np.nan)), float)


def mean_gap_of(study: StudyResult) -> Array:
    """Return the mean gap of a study at every step (steps,) [m], NaN where it is unknown."""
    if study.mean_gap is None:
        return np.full(len(study.steps), np.nan)
    if isinstance(study, BlocksResult):
        return study.mean_gap.mean(axis=(1, 2))
    return study.mean_gap


def open_leakage_of(study: object, scene: Scene) -> Array:
    """Leakage of a study if its mean gap were the gap everywhere, at every step (steps,) [m²/s]; NaN if unknown."""
    state = getattr(study, "patch_state", None)
    if state is not None:
        return np.asarray(state.open_leakage, float)
    if isinstance(study, FaceResult):
        return scene.unit_leakage * np.asarray(study.mean_gap, float) ** 3 / 12
    return np.full(len(scene.steps), np.nan)


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

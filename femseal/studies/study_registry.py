"""The studies that a case can choose, each registered once: how it is solved, what it answers, and what it costs.

Costs are known before a study is started. Seconds are those of one core of the machine on which the constants were
measured, see docs/evidence/forecast.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import log1p, log2
from operator import attrgetter, methodcaller
from statistics import mean
from typing import Any

import numpy as np

from ..base import Array, Pair, Shape, validate
from ..loads import LoadProgramme
from ..scene import Scene
from ..seal.tiles import SealTiles
from .blocks import BlocksResult, blocks_of, by_blocks
from .drawn_study import cut_and_tiles, stochastic
from .face_study import FaceResult, deterministic, state_memory, states_memory, two_scale
from .sampling import FEWEST_SEALS, MOST_SEALS, Sampling
from .stochastic_result import StochasticResult

#: Pixels of the contact by which the effort of a load step is given.
PILOT_PIXELS = 200**2
#: Least number of pairs of transforms of contact.
_LEAST_PAIRS = 6
#: For each pixel, seconds of a pair of transforms of rows of 2ⁿ points, of each doubling from `PILOT_PIXELS` on; and
#: what rows of another length, of odd length, and each prime factor above 13 times itself add. Measured on 30 grids.
_TRANSFORM_SECONDS, _OF_LENGTH = (6.5e-9, 1.5e-9), (4e-9, 8e-9, 2e-10)
#: For each pixel, seconds of what a pair of transforms has about it, and what contact everywhere adds to it.
_POINT_SECONDS = 2.5e-9, 1.5e-8
#: Growth of the number of pairs with the pixels: power without contact, what contact adds to it, and the largest.
_PAIR_GROWTH = 0.1, 0.6, 0.37
#: Seconds of a flow solution, and for each pixel where it is open, and of each iteration of multigrid; iterations where
#: the gap hardly varies.
_FLOW_SECONDS, _FLOW_PIXEL_SECONDS, FEW_ITERATIONS = 1.5e-4, (1.2e-7, 2e-8), 6.0
#: Iterations that the side of a grid beyond that of `PILOT_PIXELS` adds near closing, times the fourth power of the
#: fraction in contact: a larger surface has narrower paths. Open surfaces take as many whatever their size. Chosen
#: to match two surfaces of 600² points, those of the test of this forecast: no independent measurement.
_NARROW_ITERATIONS = 5e3
#: Seconds for each pixel where the pilot is closed, and what the square of the open fraction adds: there may be a path.
_CLOSED_SECONDS = 2e-8, 1.5e-6
#: Seconds of a drawn seal at a step, and for each element; solutions where permeabilities depend on the pressure, and
#: memory for each element [byte].
_SEAL_SECONDS, _ELEMENT_SECONDS, _PRESSURE_SOLUTIONS, _ELEMENT_BYTES = 1e-3, 7e-6, 2.0, 4e3
#: Flow solutions, and what they need besides, that the flow of a rarefied gas takes.
_SUCCESSIVE = 4.5
#: Number of states of a face on a ladder of nominal pressures.
LADDER_STATES = 25.0
#: Memory of a point of a face that is split into blocks [byte]: as it is, and split.
_SPLIT_BYTES = 16
#: Largest error of ln(leakage) over the tolerance of the contact, for any from 1e-3 to 1e-7: three times that measured
#: on six faces, elastic and plastic, from open to a hundredth of the leakage, see docs/evidence/only_what_is_needed.md;
#: and the fraction of the error wanted that the tolerance may cause.
TOLERANCE_ERROR, TOLERANCE_FRACTION = 1.9, 0.1


@dataclass(frozen=True)
class Effort:
    """What decides on the work of a load step.

    pairs : transforms of a contact of `PILOT_PIXELS`. contact_fraction : of the face in contact, 0 to 1.
    iterations : of multigrid in a flow of `PILOT_PIXELS`, 0 where it is closed. rounds : solutions of contact and flow
    where the fluid presses the faces apart.
    """

    pairs: float = 22.0
    contact_fraction: float = 0.15
    iterations: float = 13.0
    rounds: float = 2.3

    @property
    def growth(self) -> float:
        """Power of the pixels with which the number of transforms grows."""
        least, contact, most = _PAIR_GROWTH
        return min(most, least + contact * self.contact_fraction)

    def pairs_on(self, pixels: float) -> float:
        """Transforms of a contact of so many pixels."""
        return max(_LEAST_PAIRS, self.pairs * (pixels / PILOT_PIXELS) ** self.growth)

    def iterations_on(self, pixels: float) -> float:
        """Return the iterations of multigrid in a flow of so many pixels; 0 where it is closed."""
        if not self.iterations:
            return 0.0
        side = (pixels / PILOT_PIXELS) ** 0.5
        return self.iterations + _NARROW_ITERATIONS * self.contact_fraction**4 * max(0.0, side - 1)


@dataclass(frozen=True)
class StudyOptions:
    """Options of all studies; each takes those that it needs.

    cells : number of pieces of the face along x1 and x2. sampling : see `stochastic`.
    knows_face : another study leaves contact and flow of the face at the loads of the scene.
    """

    cells: Shape | None = None
    sampling: Sampling | None = None
    knows_face: bool = False

    @property
    def blocks(self) -> Shape:
        """Numbers of blocks that have so many pieces together."""
        return blocks_of(self.cells)


def usual_efforts(steps: int) -> tuple[Effort, ...]:
    """Efforts of load steps of which nothing is known."""
    return (Effort(),) * steps


def contact_seconds(points: Shape, effort: Effort) -> float:
    """Expected time of one contact solution [s]."""
    pixels = points[0] * points[1]
    about, contact = _POINT_SECONDS
    each = _transform_seconds(points) + about + contact * effort.contact_fraction
    return effort.pairs_on(pixels) * pixels * each


def _transform_seconds(points: Shape) -> float:
    """Expected time of a pair of transforms for each pixel [s]; free columns are padded to a length that suits."""
    (pixel, doubling), (other, odd, prime) = _TRANSFORM_SECONDS, _OF_LENGTH
    seconds = pixel + doubling * max(0.0, log2(points[0] * points[1] / PILOT_PIXELS))
    length = points[1]
    if length & (length - 1) == 0:
        return seconds
    factors, rest, factor = 0, length, 2
    while rest > 1:
        while rest % factor == 0:
            rest //= factor
            factors += factor if factor > 13 else 0
        factor += 1
    return seconds + other + odd * (length % 2) + prime * factors


def flow_seconds(pixels: float, effort: Effort) -> float:
    """Expected time of one flow solution [s]."""
    once, iteration = _FLOW_PIXEL_SECONDS
    if not effort.iterations:
        closed, path = _CLOSED_SECONDS
        return _FLOW_SECONDS + pixels * (closed + path * (1 - effort.contact_fraction) ** 2)
    return _FLOW_SECONDS + pixels * (once + iteration * effort.iterations_on(pixels))


def _face_seconds(scene: Scene, effort: Effort, acts: bool) -> float:
    """Expected time of contact and flow of a whole face at a step [s]."""
    pixels = scene.surface.heights.size
    again = _SUCCESSIVE if count_pressures(scene) > 1 else 1.0
    seconds = contact_seconds(scene.surface.shape, effort) + again * flow_seconds(pixels, effort)
    return effort.rounds * seconds if acts else seconds


def deterministic_cost(scene: Scene, options: StudyOptions, efforts: Sequence[Effort]) -> Pair:
    """Expected time on one core [s] and memory [byte] of the deterministic solution."""
    pixels, acts = scene.surface.heights.size, scene.acting_fluid is not None
    seconds = sum(_face_seconds(scene, effort, acts) for effort in efforts)
    return seconds, states_memory(pixels, len(efforts)) + state_memory(pixels)


def two_scale_cost(scene: Scene, options: StudyOptions, efforts: Sequence[Effort]) -> Pair:
    """The same of two scales; contact and flow of the face are there where another study leaves them."""
    assert options.cells is not None
    seconds, memory = deterministic_cost(scene, options, efforts)
    (n1, n2), (m1, m2) = scene.surface.shape, options.cells
    of_pieces = 2 * m1 * m2 * sum(flow_seconds(n1 // m1 * (n2 // m2), one) for one in efforts)
    return (0.0 if options.knows_face else seconds) + of_pieces, memory


def blocks_cost(scene: Scene, options: StudyOptions, efforts: Sequence[Effort]) -> Pair:
    """The same of a face by blocks, each solved along a ladder once as a layer, and once for its pieces."""
    (n1, n2), (b1, b2) = scene.surface.shape, options.blocks
    block = (n1 // b1, n2 // b2)
    points = n1 // b1 * (n2 // b2)
    contact = mean(contact_seconds(block, effort) for effort in efforts)
    flows = 3 * count_pressures(scene) * mean(flow_seconds(points, effort) for effort in efforts)
    seconds = b1 * b2 * LADDER_STATES * (2 * contact + flows)
    return seconds, state_memory(points) + _SPLIT_BYTES * n1 * n2


def stochastic_cost(scene: Scene, options: StudyOptions, efforts: Sequence[Effort]) -> Pair:
    """The same of the states of a face, and of the seals drawn from its pieces."""
    assert options.sampling is not None
    cut, tiles = cut_and_tiles(scene, options.cells, options.sampling)
    pixels = scene.surface.heights.size
    elements = len(tiles.tile)
    pressures = count_pressures(scene)
    pieces = cut.shape[0] * cut.shape[1]
    acts = scene.acting_fluid is not None
    solved = options.knows_face and scene.flow.spiral is None
    ladder = on_ladder(scene, options.sampling) and not tiles.in_place
    states = LADDER_STATES if ladder else float(len(efforts))
    flows = 2 * pieces * pressures * mean(flow_seconds(pixels / pieces, one) for one in efforts)
    if not (solved and tiles.in_place):
        flows += mean(_face_seconds(scene, one, acts and tiles.in_place) for one in efforts)
    draws = (options.sampling.realisations or usual_seals(cut.shape, tiles)) * len(efforts)
    again = _PRESSURE_SOLUTIONS if pressures > 1 or (acts and not tiles.in_place) else 1.0
    seals = again * draws * (_SEAL_SECONDS + _ELEMENT_SECONDS * elements)
    memory = state_memory(pixels) + _ELEMENT_BYTES * elements
    if tiles.in_place:  # those of another study are kept beside
        memory += (2 if solved else 1) * states_memory(pixels, len(efforts))
    return states * flows + seals, memory


def usual_seals(cells: Shape, tiles: SealTiles) -> int:
    """Number of seals that a band of error usually needs: fewer of long ones, whose leakage scatters less."""
    faces = tiles.count / (cells[0] * cells[1])
    return round(min(max(MOST_SEALS / max(faces, 1.0), FEWEST_SEALS), MOST_SEALS))


def on_ladder(scene: Scene, sampling: Sampling) -> bool:
    """Whether drawn seals take pieces from a ladder of nominal pressures, unless these stay in their rows."""
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

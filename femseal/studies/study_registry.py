"""Register the studies that a case can choose, with the functions that solve them and estimate their cost.

The computing time and the memory of a study are estimated before the study starts. Estimated times refer to one core of
the machine on which the throughput was measured. The accuracy of the estimates is documented in
docs/evidence/forecast.md.
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

#: Time on one core for each pixel and load step [s]: first for the contact, then for the flow through the gap. The two
#: times are fitted to the runs of docs/evidence/forecast.md.
_CONTACT_SECONDS, _FLOW_SECONDS = 6e-7, 5e-7
#: Time on one core [s] and memory [byte] of the flow over a seal, for each element.
_ELEMENT_SECONDS, _ELEMENT_BYTES = 7e-6, 4e3
#: Mean number of times that contact and flow of a load step are solved if the fluid pressure acts on the surfaces.
_COUPLED_SOLUTIONS = 2.5
#: Mean number of times that the flow over a seal is solved if permeabilities depend on the fluid pressure.
_PRESSURE_SOLUTIONS = 2.0
#: Mean number of times that the flow of a rarefied gas through the gap is solved.
_RAREFIED_SOLUTIONS = 4.5
#: Usual number of contact states at tabulated pressures.
TABULATED_STATES = 25.0
#: Memory of a pixel of a surface that is split into blocks [byte], for the heights before and after the split.
_SPLIT_BYTES = 16
#: Largest error of ln(leakage), divided by the tolerance of the contact, for tolerances from 1e-3 to 1e-7. The value is
#: three times the largest error on six elastic and plastic surfaces, at loads from the open state to a hundredth of the
#: open leakage, see docs/evidence/only_what_is_needed.md.
TOLERANCE_ERROR = 1.9
#: Fraction of the desired error of the leakage that the tolerance of the contact may cause.
TOLERANCE_FRACTION = 0.1


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

    @property
    def blocks(self) -> Shape:
        """Numbers of blocks along x1 and x2; each block consists of 4 × 4 cells."""
        return blocks_of(self.cells)


def _surface_seconds(scene: Scene, is_coupled: bool) -> float:
    """Return the expected time of contact and flow of the whole surface in one load step [s].

    is_coupled : whether the study takes the action of the fluid pressure on the surface into account.
    """
    flows = _RAREFIED_SOLUTIONS if count_pressures(scene) > 1 else 1.0
    seconds = scene.surface.heights.size * (_CONTACT_SECONDS + flows * _FLOW_SECONDS)
    return _COUPLED_SOLUTIONS * seconds if is_coupled else seconds


def deterministic_cost(scene: Scene, options: StudyOptions) -> Pair:
    """Return the expected time on one core [s] and the memory [byte] of the deterministic study."""
    pixels, steps = scene.surface.heights.size, len(scene.steps)
    seconds = steps * _surface_seconds(scene, scene.acting_fluid is not None)
    return seconds, states_memory(pixels, steps) + state_memory(pixels)


def two_scale_cost(scene: Scene, options: StudyOptions) -> Pair:
    """Return the expected time on one core [s] and the memory [byte] of the two-scale study."""
    surface_seconds, memory = deterministic_cost(scene, options)
    if options.surface_is_solved:
        surface_seconds = 0.0
    # the cells of a step have as many pixels as the surface, and their flow is solved along both axes
    cell_seconds = 2 * len(scene.steps) * scene.surface.heights.size * _FLOW_SECONDS
    return surface_seconds + cell_seconds, memory


def blocks_cost(scene: Scene, options: StudyOptions) -> Pair:
    """Return the expected time on one core [s] and the memory [byte] of a study by blocks.

    The contact of each block is solved twice: for its rough layer and for its cells.
    """
    pixels = scene.surface.heights.size
    b1, b2 = options.blocks
    # three flows for each pressure of the fluid: of the block, and of its cells along both axes
    flow_seconds = 3 * count_pressures(scene) * _FLOW_SECONDS
    seconds = TABULATED_STATES * pixels * (2 * _CONTACT_SECONDS + flow_seconds)
    return seconds, state_memory(pixels / (b1 * b2)) + _SPLIT_BYTES * pixels


def stochastic_cost(scene: Scene, options: StudyOptions) -> Pair:
    """Return the expected time on one core [s] and the memory [byte] of the stochastic study.

    The expected time is the sum of two parts: the time of all contact states with their cells, and the time of all
    realisations.
    """
    assert options.sampling is not None
    cut, tiles = cut_and_tiles(scene, options.cells, options.sampling)
    pixels, steps = scene.surface.heights.size, len(scene.steps)
    elements = len(tiles.tile)
    pressures = count_pressures(scene)
    fluid_acts = scene.acting_fluid is not None
    # time of one contact state: flow through all cells along both axes, and contact and flow of the whole surface
    # unless another study has solved them at the same loads
    is_solved = options.surface_is_solved and scene.flow.spiral is None
    state_seconds = 2 * pressures * pixels * _FLOW_SECONDS
    if not (is_solved and tiles.in_order):
        state_seconds += _surface_seconds(scene, fluid_acts and tiles.in_order)
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
    return state_count * state_seconds + seal_seconds, memory


def usual_realisations(cells: Shape, tiles: SealTiles) -> int:
    """Return the number of realisations with which the median leakage is usually accurate enough.

    The leakage of a seal scatters less if the seal is larger compared with the surface. A large seal therefore needs
    fewer realisations than a small seal.

    cells : numbers of cells of the surface along x1 and x2.
    """
    area_ratio = tiles.count / (cells[0] * cells[1])  # of the seal to the surface
    count = MOST_SEALS / max(area_ratio, 1.0)
    return round(min(max(count, FEWEST_SEALS), MOST_SEALS))


def uses_tabulated_pressures(scene: Scene, sampling: Sampling) -> bool:
    """Return whether a seal with cells at random needs permeabilities at tabulated pressures."""
    return scene.acting_fluid is not None or not sampling.presses_evenly


def count_pressures(scene: Scene) -> int:
    """Return the number of fluid pressures at which the permeabilities of cells are needed.

    If the flow law does not depend on the fluid pressure, one fluid pressure is sufficient.
    """
    return scene.flow.drop.pressures.size


def contact_tolerance(accuracy: float) -> float:
    """Return the largest contact-solver tolerance at which the leakage is still accurate enough.

    The returned tolerance causes at most a tenth of the allowed relative error of the leakage.

    Parameters
    ----------
    accuracy : float
        Allowed relative error of the leakage, such as 0.1 for 10 %.

    Raises
    ------
    InputError
        The accuracy is not a positive number.

    Examples
    --------
    >>> contact_tolerance(0.1), contact_tolerance(0.01), contact_tolerance(1e-9)
    (0.001, 0.0001, 1e-07)
    """
    largest_error = TOLERANCE_FRACTION * log1p(validate.number("accuracy", accuracy))
    for exponent in range(-3, -7, -1):
        tolerance = 10.0**exponent
        if TOLERANCE_ERROR * tolerance <= largest_error:
            return tolerance
    return 1e-7


StudyResult = FaceResult | BlocksResult | StochasticResult


@dataclass(frozen=True)
class Study:
    """Describe a study that a case can choose.

    Parameters
    ----------
    name : str
        Name in case files, messages and timings.
    label : str
        Name of the leakage of the study in legends and tables.
    option_names : tuple of str
        Names of the attributes of `StudyOptions` that `solve` takes.
    solve : callable
        Function that solves the study; `solve(scene, *options, mapper=mapper)` returns the result.
    cost : callable
        Function that estimates the cost; `cost(scene, options)` returns the time on one core [s] and the memory [byte].
    leakage : callable
        Function that returns the predicted leakage (steps,) [m²/s] from the result of the study.
    """

    name: str
    label: str
    option_names: tuple[str, ...]
    solve: Callable[..., Any]
    cost: Callable[[Scene, StudyOptions], Pair]
    leakage: Callable[[Any], Array] = attrgetter("leakage")

    @property
    def key(self) -> str:
        """Name with an underscore, for dictionaries of results and names of variables."""
        return self.name.replace("-", "_")

    @property
    def leakage_variable(self) -> str:
        """Name of the variable in a dataset that contains the leakage of the study."""
        return "leakage_" + self.label.replace("-", "_")


def study_of_result(result: StudyResult) -> Study:
    """Return the study by which a result was computed."""
    return STUDIES[result.method]


def contact_fraction_of(study: object, steps: LoadProgramme) -> Array:
    """Return the fraction of the surface in contact at every load step (steps,), NaN if the fraction is unknown.

    study : result of a study. steps : load steps at which the contact fraction is returned. For a stochastic result,
    `steps` can be any load steps of the result; for other results, it must be all of them.
    """
    if isinstance(study, StochasticResult):
        indices = [study.steps.index(step) for step in steps]
        return study.contact_fraction[indices]
    unknown = np.full(len(steps), np.nan)
    return np.asarray(getattr(study, "contact_fraction", unknown), float)


def mean_gap_of(study: StudyResult) -> Array:
    """Return the mean gap at every load step (steps,) [m] from the result of a study, NaN if the gap is unknown."""
    if study.mean_gap is None:
        return np.full(len(study.steps), np.nan)
    if isinstance(study, BlocksResult):
        return study.mean_gap.mean(axis=(1, 2))
    return study.mean_gap


def open_leakage_of(study: object, scene: Scene) -> Array:
    """Return the leakage of a uniform gap that is equal to the mean gap (steps,) [m²/s], NaN if unknown.

    study : result of a study.
    """
    state = getattr(study, "patch_state", None)
    if state is not None:
        return np.asarray(state.open_leakage, float)
    if isinstance(study, FaceResult):
        return scene.unit_leakage * np.asarray(study.mean_gap, float) ** 3 / 12
    return np.full(len(scene.steps), np.nan)


#: All studies by name, in the order in which they are solved. A study may use the results of earlier studies. If a case
#: has several studies, the leakage of the last one is the result of the run.
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

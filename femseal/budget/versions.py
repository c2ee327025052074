"""Make the modified versions of the input of a run that its error budget needs.

The modified versions have fewer points or fewer waves, or one assumption of the model is changed.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil, prod
from typing import Any, Protocol

import numpy as np

from ..base import Array, FemsealError, Mapper, NotKept, Shape
from ..studies import STUDIES, Sampling, Scene, StochasticResult, Study, study_of_result
from ..studies.sampling import FEWEST_SEALS
from ..topography import Conditioning, Continuation, Representative, Surface
from .changed_models import FormTolerance, ModelChange
from .error_parts import CoarserSolution

#: Ratio of the numbers of points along each side of the coarser grid and of the original one.
COARSENING = 0.5
#: A coarser grid with more than this fraction of the points is too similar to the original one for a comparison.
MOST_POINTS_FRACTION = 0.6
#: Largest number of realisations that are solved again for a version.
_MOST_REALISATIONS = 5
#: No more realisations are solved again if all of them together have this many times as many tiles as the surface has
#: cells.
_SURFACES = 40
#: Removed waves only matter if they have at least this fraction of the rms slope.
LEAST_REMOVED = 1e-4
#: Number of versions in which the continued waves have other random phases.
OTHER_PHASES = 3
log = logging.getLogger("femseal")


class Version(Protocol):
    """Describe the input of the studies of a run. `preparation.Prepared` implements this protocol."""

    @property
    def scene(self) -> Scene:
        """Scene of the studies."""
        ...

    @property
    def sampling(self) -> Sampling | None:
        """Options of the realisations; None if the run has no stochastic study."""
        ...

    @property
    def conditioning(self) -> Conditioning:
        """Record of how the surface was conditioned."""
        ...

    @property
    def continuation(self) -> Continuation | None:
        """Continuation of the spectrum of the surface; None if it is not continued."""
        ...

    @property
    def form(self) -> FormTolerance | None:
        """Tolerances of the form of the seal and of the seat."""
        ...

    @property
    def longest_waves(self) -> Representative | None:
        """Longest waves of a measured patch; None for a generated surface."""
        ...

    @property
    def flatness(self) -> float | None:
        """Flatness of the seal [m]."""
        ...

    @property
    def studies(self) -> list[Study]:
        """All studies of the run."""
        ...

    @property
    def solved_studies(self) -> list[Study]:
        """Studies of the run that must be solved."""
        ...

    @property
    def least_points(self) -> Shape:
        """Smallest possible number of points along x1 and x2."""
        ...

    @property
    def points_divide_by(self) -> Shape:
        """Numbers by which the points along x1 and x2 must be divisible, so that all blocks are equal."""
        ...

    @property
    def cut_and_tiles(self) -> tuple[Any, Any]:
        """Division of the surface into cells, and tiles of the seal."""
        ...

    def replaced(self, **changes: Any) -> Any:
        """Return a copy of the input with some attributes replaced."""
        ...

    def changed(self, change: ModelChange) -> Any:
        """Return a copy of the input with a change of the model."""
        ...

    def solve(self, study: Study, mapper: Mapper) -> Any:
        """Solve a study, and return its result."""
        ...

    def longer_waves(self, surface: Surface, mapper: Mapper) -> Array | None:
        """Compute the changes of ln(leakage) that are caused by waves longer than the patch."""
        ...


def coarser_points(points: Shape, least: Shape = (1, 1), divide_by: Shape = (1, 1)) -> Shape | None:
    """Return half the number of points along each axis, or slightly more where cells or blocks require it.

    The result is None if such a grid would be too similar to the original grid for a comparison.

    Parameters
    ----------
    points : numbers of points along x1 and x2.
    least : smallest permitted numbers of points along x1 and x2.
    divide_by : numbers by which the points along x1 and x2 must be divisible.
    """
    n1, n2 = (
        ceil(max(ceil(COARSENING * n), smallest) / divisor) * divisor
        for n, smallest, divisor in zip(points, least, divide_by, strict=True)
    )
    if n1 * n2 > MOST_POINTS_FRACTION * points[0] * points[1]:
        return None
    return n1, n2


def solved_study(study: Study) -> Study:
    """Return the study that is solved for a modified version of the input, in place of a study of the run.

    The two-scale study is replaced by the deterministic one, because both solve the whole surface.
    """
    return STUDIES["deterministic"] if study.name == "two-scale" else study


def coarser_grid(version: Version) -> Version | None:
    """Make the version with half the points along each axis; None if the points cannot be reduced that much."""
    surface = version.scene.surface
    points = coarser_points(surface.shape, version.least_points, version.points_divide_by)
    return None if points is None else _reduced(version, surface.resample(points))


def without_filtered_waves(version: Version) -> Version | None:
    """Make the version without the waves below twice the shortest wavelength; None if the surface was not filtered."""
    if not _lacks_waves(version):
        return None
    surface, wave = version.scene.surface, 2 * version.conditioning.shortest_wave
    n1, n2 = (
        ceil(n / (2 * divisor)) * divisor
        for n, divisor in zip(surface.shape, version.points_divide_by, strict=True)
    )
    least1, least2 = version.least_points
    if wave >= max(surface.size) or n1 < least1 or n2 < least2:
        log.warning(
            "error budget: the face or its cells are too small to be solved without the shortest waves"
        )
        return None
    return _reduced(version, surface.low_pass(wave).resample((n1, n2)))


def continued_versions(grid: Version) -> list[Version]:
    """Make the versions that show the error of a continued spectrum.

    In the first versions, `OTHER_PHASES` in number, the continued waves have other random phases. In the last version,
    the shortest octave of waves is removed. The list is empty if the spectrum of the surface was not continued.
    """
    continued = grid.continuation
    if continued is None:
        return []
    surface = grid.scene.surface
    without_continuation = continued.add_to(surface, factor=-1.0)
    other_phases = [
        continued.add_to(without_continuation, number) for number in range(1, OTHER_PHASES + 1)
    ]
    without_octave = surface.low_pass(2 * continued.cut_off)
    return [
        grid.replaced(scene=replace(grid.scene, surface=changed_surface))
        for changed_surface in (*other_phases, without_octave)
    ]


def kept_slope(version: Version) -> float:
    """Return the rms slope of the surface, divided by the rms slope that it would have with its missing waves.

    The result is 1 if the missing waves do not matter.
    """
    return version.conditioning.kept_slope if _lacks_waves(version) else 1.0


def _lacks_waves(version: Version) -> bool:
    """Return whether waves that matter are missing, because of the filter or the resolution of the instrument."""
    return 1 - version.conditioning.kept_slope >= LEAST_REMOVED


def _reduced(version: Version, surface: Surface) -> Version:
    """Make the version of the input with a coarser surface, divided into the same cells, and with fewer realisations.

    The realisations of this version are compared with the first realisations of the run. Both have the same cells in
    the same tiles.
    """
    sampling = version.sampling
    if sampling is not None:
        cut, tiles = version.cut_and_tiles
        count_with_enough_tiles = ceil(_SURFACES * prod(cut.shape) / tiles.count)
        count = sampling.realisations or FEWEST_SEALS
        count = min(count, _MOST_REALISATIONS, count_with_enough_tiles)
        sampling = replace(sampling, realisations=count, median_fields=False)
    methods = frozenset(solved_study(study).name for study in version.studies)
    scene = replace(version.scene, surface=surface)
    reduced: Version = version.replaced(scene=scene, sampling=sampling, methods=methods)
    return reduced


@dataclass(frozen=True, eq=False)
class VersionLeakage:
    """Hold the leakage that a study computed for a modified version of the input.

    leakage : leakage at every step (steps,) [m²/s].
    realisations : number of realisations; None if the study has no realisations.
    """

    leakage: Array
    realisations: int | None


def solved_version(version: Version, mapper: Mapper) -> dict[str, VersionLeakage]:
    """Solve the studies of a version, and return their leakage by the key of the study. Failed studies are left out."""
    leakages: dict[str, VersionLeakage] = {}
    for study in version.solved_studies:
        try:
            result = version.solve(study, mapper)
        except NotKept:
            raise
        except FemsealError as error:
            log.warning("error budget: %s on a coarser grid failed: %s", study.name, error)
            continue
        realisations = len(result.leakage) if isinstance(result, StochasticResult) else None
        leakages[study.key] = VersionLeakage(leakage_of(result), realisations)
    return leakages


def leakage_of(result: Any) -> Array:
    """Return the leakage of a study at every step (steps,) [m²/s]; for a stochastic study, this is the median."""
    return study_of_result(result).leakage(result)


def compare_leakage(
    result: Any, version: Version, solved: Mapping[str, VersionLeakage]
) -> CoarserSolution:
    """Compare the leakage of a coarser version of the input with the result of a study.

    solved : leakage of each study of this version, by the key of the study. If the study is missing because it failed,
        the leakage of the coarser solution is NaN.
    """
    points, slope = version.scene.surface.shape, version.scene.surface.rms_slope
    solution = solved.get(solved_study(study_of_result(result)).key)
    if solution is None:
        return CoarserSolution(points, np.full(len(version.scene.steps), np.nan))
    if not isinstance(result, StochasticResult):
        return CoarserSolution(points, solution.leakage, rms_slope=slope)
    # the first realisations of the study have the same cells in the same tiles as the realisations of the version
    same_seals = replace(result, leakage=result.leakage[: solution.realisations])
    return CoarserSolution(points, solution.leakage, leakage_of(same_seals), slope)

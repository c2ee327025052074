"""Modify the input of a run in the ways that its error budget requires.

A modified version has fewer points, lacks the shortest waves, or changes one assumption of the model.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil, prod
from typing import Any, cast

import numpy as np

from ..base import Array, FemsealError, Mapper, NotKept, Shape
from ..studies import Study, StudyResult, study_of_result
from ..studies.sampling import FEWEST_BY_DEFAULT
from ..topography import Surface
from .leakage_changes import CoarserSolution
from .study_input import StudyInput

#: Number of points along each side of the coarser grid, divided by that of the original grid.
COARSENING = 0.5
#: A coarser grid with more than this fraction of the points of the original grid is too similar for a comparison.
MOST_POINTS_FRACTION = 0.6
#: Largest number of realisations that are solved again for a version.
_MOST_REALISATIONS = 5
#: Realisations are solved again until their tiles are this many times as numerous as the cells of the surface.
_SURFACES = 40
#: Removed waves are taken into account if they reduced the rms slope by at least this fraction.
LEAST_REMOVED = 1e-4
#: Number of versions in which the extrapolated waves have different random phases.
OTHER_PHASES = 3
log = logging.getLogger("femseal")


def coarser_points(points: Shape, least: Shape = (1, 1), divide_by: Shape = (1, 1)) -> Shape | None:
    """Return the numbers of points of a grid with half the points along each axis.

    The numbers may be slightly more than half, so that the grid can still be divided into the cells or blocks of the
    surface. The result is None if the coarser grid would be too similar to the original grid for a comparison, see
    `MOST_POINTS_FRACTION`.

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
    """Return the study that computes the leakage of a modified version, for comparison with a study of the run.

    If the study contains another study, the contained study is returned, because its leakage is the same.
    """
    return study.contained or study


def coarser_grid(version: StudyInput) -> StudyInput | None:
    """Make the version with half the points along each axis; None if the grid cannot be made that coarse."""
    surface = version.scene.surface
    points = coarser_points(surface.shape, version.least_points, version.points_divide_by)
    return None if points is None else _reduced(version, surface.resample(points))


def without_filtered_waves(version: StudyInput) -> StudyInput | None:
    """Make the version without the shortest octave of waves; None if no waves were removed from the surface."""
    if not _lacks_waves(version):
        return None
    surface = version.scene.surface
    wave = 2 * version.conditioning.shortest_wave
    # half the points, rounded up to a multiple of the divisor
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


def continued_versions(grid: StudyInput) -> list[StudyInput]:
    """Make the versions that show the error of extrapolating the spectrum.

    In the first `OTHER_PHASES` versions, the extrapolated waves have different random phases. In the last version, the
    shortest octave of the waves above the cut-off is removed. The list is empty if the spectrum of the surface was not
    extrapolated.
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
        replace(grid, scene=replace(grid.scene, surface=changed_surface))
        for changed_surface in (*other_phases, without_octave)
    ]


def kept_slope(version: StudyInput) -> float:
    """Return the rms slope of the surface, divided by its rms slope with the missing waves.

    The ratio is 1 if the missing waves have hardly any slope, see `LEAST_REMOVED`.
    """
    return version.conditioning.kept_slope if _lacks_waves(version) else 1.0


def _lacks_waves(version: StudyInput) -> bool:
    """Return whether the filter or the resolution of the instrument has noticeably reduced the rms slope."""
    return 1 - version.conditioning.kept_slope >= LEAST_REMOVED


def _reduced(version: StudyInput, surface: Surface) -> StudyInput:
    """Make the version with fewer realisations and a coarser surface, which is divided into the same cells.

    The realisations of the coarser version use the same cells in the same tiles as the first realisations of the run,
    so that their leakages can be compared.
    """
    sampling = version.sampling
    if sampling is not None:
        cut, tiles = version.cut_and_tiles
        count_with_enough_tiles = ceil(_SURFACES * prod(cut.shape) / tiles.count)
        count = sampling.realisations or FEWEST_BY_DEFAULT
        count = min(count, _MOST_REALISATIONS, count_with_enough_tiles)
        sampling = replace(sampling, realisations=count, median_fields=False)
    methods = frozenset(solved_study(study).name for study in version.studies)
    scene = replace(version.scene, surface=surface)
    return replace(version, scene=scene, sampling=sampling, methods=methods)


@dataclass(frozen=True, eq=False)
class VersionLeakage:
    """Leakage that a study computed for a modified version of the input.

    leakage : leakage at every step (steps,) [m²/s].
    realisations : number of realisations; None if the study has no realisations.
    """

    leakage: Array
    realisations: int | None


def solved_version(version: StudyInput, mapper: Mapper) -> dict[str, VersionLeakage]:
    """Solve the studies of a version, and return the leakage of each study that succeeded, by its key."""
    leakages: dict[str, VersionLeakage] = {}
    for study in version.solved_studies:
        try:
            result = version.solve(study, mapper)
        except NotKept:
            raise
        except FemsealError as error:
            log.warning("error budget: %s on a coarser grid failed: %s", study.name, error)
            continue
        leakages[study.key] = VersionLeakage(result.predicted_leakage, result.realisation_count)
    return leakages


def compare_leakage(
    result: StudyResult, version: StudyInput, solved: Mapping[str, VersionLeakage]
) -> CoarserSolution:
    """Compare the leakage of a coarser version of the input with that of the original input.

    result : result of a study for the original input.
    version : coarser version of the input.
    solved : leakage of each study for the coarser version, by the key of the study. If the study is not in `solved`,
        because it failed, the returned leakage is NaN.
    """
    points, slope = version.scene.surface.shape, version.scene.surface.rms_slope
    solution = solved.get(solved_study(study_of_result(result)).key)
    if solution is None:
        return CoarserSolution(points, np.full(len(version.scene.steps), np.nan))
    if solution.realisations is None:
        return CoarserSolution(points, solution.leakage, rms_slope=slope)
    # the first realisations of the study have the same cells in the same tiles as the realisations of the version
    same_seals = replace(cast(Any, result), leakage=result.leakage[: solution.realisations])
    return CoarserSolution(points, solution.leakage, same_seals.predicted_leakage, slope)

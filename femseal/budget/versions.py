"""Make the modified versions of the input of a run that its error budget needs.

They are coarser, have fewer waves, or differ in one assumption of the model."""

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

#: Points a side of the coarser grid over those of the scene.
COARSENING = 0.5
#: A coarser grid of more than this fraction of the points shows nothing.
MOST_POINTS_FRACTION = 0.6
#: Seals that are drawn again from a changed face, at most, and as long as how many faces they are together; each is
#: compared with that of the same cells.
SEALS_AGAIN, FACES_AGAIN = 5, 40
#: Fraction of the rms slope that removed waves have at least where they matter.
LEAST_REMOVED = 1e-4
#: Draws of the phases of continued waves besides that of a run.
OTHER_PHASES = 3
log = logging.getLogger("femseal")


class Version(Protocol):
    """Input of the studies of a run. `preparation.Prepared` implements this protocol."""

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
        """How the surface was conditioned."""
        ...

    @property
    def continuation(self) -> Continuation | None:
        """How the spectrum of the surface is continued; None if it is not continued."""
        ...

    @property
    def form(self) -> FormTolerance | None:
        """Tolerances of the form of the seal and of the seat."""
        ...

    @property
    def longest_waves(self) -> Representative | None:
        """Longest waves of a measured patch; None of generated surfaces."""
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
        """Numbers along x1 and x2 by which the numbers of points must be divisible."""
        ...

    @property
    def cut_and_tiles(self) -> tuple[Any, Any]:
        """Division of the surface into cells, and tiles of the seal."""
        ...

    def replaced(self, **changes: Any) -> Any:
        """Return the same input with some attributes replaced."""
        ...

    def changed(self, change: ModelChange) -> Any:
        """Return the same input with a change of the model."""
        ...

    def solve(self, study: Study, mapper: Mapper) -> Any:
        """Solve a study, and return its result."""
        ...

    def longer_waves(self, surface: Surface, mapper: Mapper) -> Array | None:
        """Compute the changes of ln(leakage) that are caused by waves longer than the patch."""
        ...


def coarser_points(points: Shape, least: Shape = (1, 1), divide_by: Shape = (1, 1)) -> Shape | None:
    """Return half the number of points along each axis, or slightly more if the cells need it.

    The result is None if such a grid would have nearly as many points as the present one, so that a comparison would
    show nothing.
    """
    wanted = [
        ceil(max(ceil(COARSENING * n), few) / m) * m
        for n, few, m in zip(points, least, divide_by, strict=True)
    ]
    if wanted[0] * wanted[1] > MOST_POINTS_FRACTION * points[0] * points[1]:
        return None
    return wanted[0], wanted[1]


def route(study: Study) -> Study:
    """Return the study that is solved on a coarser grid in place of a study.

    The deterministic study replaces the two-scale study, because both solve the whole surface.
    """
    return STUDIES["deterministic"] if study.name == "two-scale" else study


def coarser_grid(version: Version) -> Version | None:
    """Make the version with half the points along each axis; None if the points cannot be reduced that much."""
    surface = version.scene.surface
    points = coarser_points(surface.shape, version.least_points, version.points_divide_by)
    return None if points is None else _reduced(version, surface.resample(points))


def without_filtered_waves(version: Version) -> Version | None:
    """Make the version without waves up to twice the shortest wavelength; None if the surface was not filtered."""
    if not _lacks_waves(version):
        return None
    surface, wave = version.scene.surface, 2 * version.conditioning.shortest_wave
    n1, n2 = (
        ceil(n / (2 * m)) * m for n, m in zip(surface.shape, version.points_divide_by, strict=True)
    )
    least1, least2 = version.least_points
    if wave >= max(surface.size) or n1 < least1 or n2 < least2:
        log.warning(
            "error budget: the face or its cells are too small to do without the shortest waves"
        )
        return None
    return _reduced(version, surface.low_pass(wave).resample((n1, n2)))


def continued_versions(grid: Version) -> list[Version]:
    """Make the versions that show the error of a continued spectrum.

    In `OTHER_PHASES` versions the continued waves have other random phases. One more version lacks the shortest octave
    of waves. The list is empty if the spectrum is not continued.
    """
    continued = grid.continuation
    if continued is None:
        return []
    surface = grid.scene.surface
    measured = continued.add_to(surface, factor=-1.0)
    others = [continued.add_to(measured, number) for number in range(1, OTHER_PHASES + 1)]
    surfaces = [*others, surface.low_pass(2 * continued.cut_off)]
    return [grid.replaced(scene=replace(grid.scene, surface=one)) for one in surfaces]


def kept_slope(version: Version) -> float:
    """Return the ratio of the rms slope of the surface to the slope that it would have with its missing waves.

    It is 1 if no waves are missing that matter.
    """
    return version.conditioning.kept_slope if _lacks_waves(version) else 1.0


def _lacks_waves(version: Version) -> bool:
    """Return whether waves that matter are missing, because a filter removed them or the instrument missed them."""
    return 1 - version.conditioning.kept_slope >= LEAST_REMOVED


def _reduced(version: Version, surface: Surface) -> Version:
    """Make the version of the input with a coarser surface, the same cells, and the first few realisations."""
    sampling = version.sampling
    if sampling is not None:
        cut, tiles = version.cut_and_tiles
        enough = ceil(FACES_AGAIN * prod(cut.shape) / tiles.count)
        few = min(sampling.realisations or FEWEST_SEALS, SEALS_AGAIN, enough)
        sampling = replace(sampling, realisations=few, median_fields=False)
    methods = frozenset(route(study).name for study in version.studies)
    scene = replace(version.scene, surface=surface)
    found: Version = version.replaced(scene=scene, sampling=sampling, methods=methods)
    return found


@dataclass(frozen=True, eq=False)
class VersionLeakage:
    """Hold the leakage of a study at every step (steps,) [m²/s], and the number of its realisations.

    The number is None for studies without realisations.
    """

    leakage: Array
    seals: int | None


def solved_version(version: Version, mapper: Mapper) -> dict[str, VersionLeakage]:
    """Solve the studies of a version, and return their leakage by key. Studies that fail are left out."""
    leakages: dict[str, VersionLeakage] = {}
    for study in version.solved_studies:
        try:
            result = version.solve(study, mapper)
        except NotKept:
            raise
        except FemsealError as error:
            log.warning("error budget: %s on a coarser grid failed: %s", study.name, error)
            continue
        seals = len(result.leakage) if isinstance(result, StochasticResult) else None
        leakages[study.key] = VersionLeakage(leakage_of(result), seals)
    return leakages


def leakage_of(result: Any) -> Array:
    """Return the leakage of a study at every step (steps,) [m²/s]; for realisations it is their median."""
    return study_of_result(result).leakage(result)


def against(result: Any, version: Version, solved: Mapping[str, VersionLeakage]) -> CoarserSolution:
    """Compare the leakage of a coarser version with the result of a study; it is NaN if the version failed."""
    points, slope = version.scene.surface.shape, version.scene.surface.rms_slope
    solution = solved.get(route(study_of_result(result)).key)
    if solution is None:
        return CoarserSolution(points, np.full(len(version.scene.steps), np.nan))
    if not isinstance(result, StochasticResult):
        return CoarserSolution(points, solution.leakage, rms_slope=slope)
    # the first realisations of both have the same cells in the same tiles
    same_seals = replace(result, leakage=result.leakage[: solution.seals])
    return CoarserSolution(points, solution.leakage, leakage_of(same_seals), slope)

"""The error budget of every study of a run, from coarser versions of it that are solved too.

These tell how much the pixels of a case and the waves that its face lacks matter.
"""

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import ceil, hypot, prod, sqrt
from typing import Any

import numpy as np

from ..base import Array, FemsealError, Mapper, NotKept
from ..budget import (
    CoarserSolution,
    ErrorBudget,
    ErrorPart,
    ModelChange,
    continuation_part,
    effective_pressure_part,
    longer_waves_part,
    model_changes,
    model_part,
    opposite_matters,
    patch_form_part,
    thin_gap_part,
)
from ..budget.estimates import error_budget
from ..preparation.preparation import Pair, Prepared
from ..studies import STUDIES, Scene, StochasticResult, Study, study_of_result
from ..studies.sampling import FEWEST_SEALS
from ..studies.study_registry import contact_fraction_of
from ..topography import Topography
from ..topography.conditioning import UNSEEN

#: Points a side of the coarser grid over those of the scene.
COARSENING = 0.5
#: A coarser grid of more than this fraction of the points shows nothing.
MOST_POINTS_FRACTION = 0.6
#: Seals that are drawn again from a changed face, at most, and as long as how many faces they are together; each is
#: compared with that of the same pieces.
SEALS_AGAIN, FACES_AGAIN = 5, 40
#: Fraction of the rms slope that removed waves have at least where they matter.
LEAST_REMOVED = 1e-4
#: Draws of the phases of continued waves besides that of a run.
OTHER_PHASES = 3
#: Scenes that measure what continued waves may change: with these, and with fewer waves.
CONTINUED_SCENES = OTHER_PHASES + 1
log = logging.getLogger("femseal")


def coarser_points(points: Pair, least: Pair = (1, 1), divide_by: Pair = (1, 1)) -> Pair | None:
    """Half the points a side, or as few more as pieces ask for; None where that shows nothing."""
    wanted = [
        ceil(max(ceil(COARSENING * n), few) / m) * m
        for n, few, m in zip(points, least, divide_by, strict=True)
    ]
    if wanted[0] * wanted[1] > MOST_POINTS_FRACTION * points[0] * points[1]:
        return None
    return wanted[0], wanted[1]


def route(study: Study) -> Study:
    """The study with the contact and flow of another one on a coarser grid: that of the face for two scales."""
    return STUDIES["deterministic"] if study.name == "two-scale" else study


def coarser_grid(prepared: Prepared) -> Prepared | None:
    """The version on half of the points a side; None where that shows nothing."""
    surface = prepared.scene.surface
    points = coarser_points(surface.shape, prepared.least_points, prepared.points_divide_by)
    return None if points is None else _reduced(prepared, surface.resample(points))


def without_filtered_waves(prepared: Prepared) -> Prepared | None:
    """The version without waves up to twice the shortest one; None where none were removed."""
    if not _lacks_waves(prepared):
        return None
    surface, wave = prepared.scene.surface, 2 * prepared.conditioning.shortest_wave
    n1, n2 = (
        ceil(n / (2 * m)) * m for n, m in zip(surface.shape, prepared.points_divide_by, strict=True)
    )
    least1, least2 = prepared.least_points
    if wave >= max(surface.size) or n1 < least1 or n2 < least2:
        log.warning(
            "error budget: the face or its pieces are too small to do without the shortest waves"
        )
        return None
    return _reduced(prepared, surface.low_pass(wave).resample((n1, n2)))


def continued_scenes(grid: Prepared) -> list[Scene]:
    """The scene with other phases of its continued waves, and without its shortest octave of waves.

    Other phases come first, `OTHER_PHASES` times; no scenes where nothing is continued.
    """
    if (continued := grid.continuation) is None:
        return []
    surface = grid.scene.surface
    measured = continued.added_to(surface, factor=-1.0)
    others = [continued.added_to(measured, number) for number in range(1, OTHER_PHASES + 1)]
    faces = [*others, surface.low_pass(2 * continued.cut_off)]
    return [replace(grid.scene, surface=face) for face in faces]


def kept_slope(prepared: Prepared) -> float:
    """Rms slope of the face over that with the waves that it lacks; 1 where none matter."""
    return prepared.conditioning.kept_slope if _lacks_waves(prepared) else 1.0


def _lacks_waves(prepared: Prepared) -> bool:
    """Whether the face lacks waves that matter, removed by the low-pass or not seen by its instrument."""
    return 1 - prepared.conditioning.kept_slope >= LEAST_REMOVED


def _reduced(prepared: Prepared, surface: Topography) -> Prepared:
    """The version for a coarser face: each study by its route, with the same pieces and few of the same seals."""
    sampling = prepared.sampling
    if sampling is not None:
        cut, tiles = prepared.cut_and_tiles
        enough = ceil(FACES_AGAIN * prod(cut.shape) / tiles.count)
        few = min(sampling.realisations or FEWEST_SEALS, SEALS_AGAIN, enough)
        sampling = replace(sampling, realisations=few, median_fields=False)
    methods = frozenset(route(study).name for study in prepared.studies)
    scene = replace(prepared.scene, surface=surface)
    return replace(prepared, scene=scene, sampling=sampling, methods=methods)


def budgets_of(
    prepared: Prepared,
    studies: Mapping[str, Any],
    mapper: Mapper,
    *,
    known: Mapping[str, ErrorBudget] | None = None,
    model_parts: Sequence[str] = (),
    hardness: float = 0.1,
) -> dict[str, ErrorBudget]:
    """Error budget of every study of a run, by its key.

    studies : results by key.
    known : budgets that are there already, without parts of the model.
    model_parts, hardness : names of the parts of the model, and the relative error of the hardness.
    """
    budgets = dict(known or {})
    left = {key: result for key, result in studies.items() if key not in budgets}
    coarser = coarser_grid(prepared)
    # without one, as of pieces of too few pixels to be halved, nothing is known
    grid = coarser or prepared
    solved = _solved(grid, mapper) if coarser and left else {}
    smooth = without_filtered_waves(prepared) if left else None
    again = {} if smooth is None else _solved(smooth, mapper)
    for key, result in left.items():
        budgets[key] = error_budget(
            prepared.scene,
            result,
            coarse=[against(result, grid, solved)],
            filtered=None if smooth is None else against(result, smooth, again),
            kept_slope=kept_slope(prepared),
            wave_pixels=prepared.conditioning.shortest_wave / max(prepared.scene.surface.spacing),
        )
    changes = model_changes(grid.scene, model_parts, hardness, grid.form)
    continued = continued_scenes(grid) if "continuation" in model_parts else []
    own = solved or (_solved(grid, mapper) if changes or continued else {})
    phases = [_solved(replace(grid, scene=scene), mapper) for scene in continued]
    for key, result in studies.items():
        parts = [*budgets[key].parts, *_unsolved_parts(prepared, grid, result, model_parts, mapper)]
        other = route(study_of_result(result)).key
        if phases and other in own:
            faces = [one.get(other) for one in phases]
            parts.append(_of_continued(prepared, grid, result, own[other], faces))
        budgets[key] = replace(budgets[key], parts=tuple(filter(None, parts)))
    for change in changes:
        found = parts_of_change(change, grid, own, studies, budgets, mapper)
        for key, part in found.items():
            budgets[key] = replace(budgets[key], parts=(*budgets[key].parts, part))
    return budgets


def parts_of_change(
    change: ModelChange,
    grid: Prepared,
    own: Mapping[str, Any],
    studies: Mapping[str, Any],
    budgets: Mapping[str, ErrorBudget],
    mapper: Mapper,
) -> dict[str, ErrorPart]:
    """Solve a change of the model, its opposite where that matters, and estimate its part of every study, by key.

    grid, own : the version that is changed, and its results by key. budgets : of the studies, without this part.
    """

    def solutions(one: ModelChange) -> dict[str, CoarserSolution]:
        """Leakage with a change against that without it, by the key of the study that was solved."""
        shape = grid.scene.surface.shape
        return {
            key: CoarserSolution(shape, leakage_of(found), leakage_of(own[key]))
            for key, found in _solved(grid.changed(one), mapper).items()
            if key in own
        }

    def parts(
        there: Mapping[str, CoarserSolution], back: Mapping[str, CoarserSolution]
    ) -> dict[str, ErrorPart]:
        found = {}
        for key, result in studies.items():
            solved = route(study_of_result(result)).key
            if solved in there:
                leakage, opposite = leakage_of(result), back.get(solved)
                found[key] = model_part(change, result.steps, leakage, there[solved], opposite)
        return found

    there = solutions(change)
    found = parts(there, {})
    if change.opposite is None or not any(
        opposite_matters(part, budgets[key]) for key, part in found.items()
    ):
        return found
    return parts(there, solutions(change.opposite))


def _unsolved_parts(
    prepared: Prepared, grid: Prepared, result: Any, names: Sequence[str], mapper: Mapper
) -> Iterator[ErrorPart | None]:
    """Parts of the model, by their names, for which no changed scene is solved; None where there is none."""
    leakage, effect = leakage_of(result), prepared.form_effect
    if "effective pressure" in names:
        yield effective_pressure_part(prepared.scene, result)
    if "thin gap" in names:
        yield thin_gap_part(prepared.scene, leakage)
    if effect is not None and "form of the patch" in names:
        rises = bool(prepared.holds and prepared.holds.rises)
        yield patch_form_part(effect, result.steps, leakage, rises=rises)
    if isinstance(result, StochasticResult) and "longer waves" in names:
        drawn = prepared.longer_waves(grid.scene.surface, mapper)
        if drawn is not None:
            flat = prepared.flatness is not None
            yield longer_waves_part(drawn, flat, result.steps, leakage)


def _of_continued(
    prepared: Prepared, grid: Prepared, result: Any, own: Any, moved: Sequence[Any]
) -> ErrorPart:
    """Part of the continued waves.

    own : result on the coarser grid. moved : those of `continued_scenes`, None where one failed.
    """
    scene, continued, q = grid.scene, prepared.continuation, leakage_of(own)
    assert continued is not None
    unknown = np.full(len(scene.steps), np.nan)
    leakages = (unknown if one is None else leakage_of(one) for one in moved)
    *others, shorter = (CoarserSolution(scene.surface.shape, found, q) for found in leakages)
    surface, cut_off = prepared.scene.surface, continued.cut_off
    shorter = replace(shorter, rms_slope=surface.low_pass(2 * cut_off).rms_slope)
    # an octave at least, and a decade at most
    last = continued.last_that_counts(scene.law.mean_hardness, scene.modulus)
    shortest = float(np.clip(last, cut_off / UNSEEN, cut_off / 2))
    beyond = continued.law.slope_power(cut_off, shortest)
    kept = surface.rms_slope / hypot(surface.rms_slope, sqrt(beyond))
    in_contact = contact_fraction_of(result, prepared.scene.steps)
    return continuation_part(prepared.scene, leakage_of(result), in_contact, others, shorter, kept)


def leakage_of(result: Any) -> Array:
    """Leakage of a study at every step (steps,) [m²/s]: the one that answers."""
    return study_of_result(result).leakage(result)


def against(result: Any, coarse: Prepared, solved: Mapping[str, Any]) -> CoarserSolution:
    """A coarser solution beside the result of a study; unknown leakage where it failed."""
    points, slope = coarse.scene.surface.shape, coarse.scene.surface.rms_slope
    found = solved.get(route(study_of_result(result)).key)
    if found is None:
        return CoarserSolution(points, np.full(len(coarse.scene.steps), np.nan))
    if not isinstance(result, StochasticResult):
        return CoarserSolution(points, leakage_of(found), rms_slope=slope)
    # the same pieces in the same tiles: the first seals of both are compared
    own = replace(result, leakage=result.leakage[: len(found.leakage)])
    return CoarserSolution(points, leakage_of(found), leakage_of(own), slope)


def _solved(coarse: Prepared, mapper: Mapper) -> dict[str, Any]:
    """Results of a coarser version by key; studies that fail are left out."""
    found: dict[str, Any] = {}
    for study in coarse.solved_studies:
        try:
            found[study.key] = coarse.solve(study, mapper)
        except NotKept:
            raise
        except FemsealError as error:
            log.warning("error budget: %s on a coarser grid failed: %s", study.name, error)
    return found

"""The error budget of every study of a run, from coarser versions of it that are solved too."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, log2
from typing import Any

import numpy as np

from ..base import Array, FemsealError, Mapper, NotKept, to_text
from ..budget import (
    CoarserSolution,
    ErrorBudget,
    ErrorPart,
    continuation_part,
    effective_pressure_part,
    longer_waves_part,
    model_changes,
    model_part,
    patch_form_part,
    thin_gap_part,
)
from ..budget.whole import error_budget
from ..preparation.prepared import Prepared
from ..studies import StochasticResult, study_of_result
from ..studies.load_curves import first_known
from ..studies.study_registry import contact_fraction_of
from .coarser import (
    coarser_grids,
    continued_scenes,
    kept_slope,
    removed_octaves,
    route,
    wave_pixels,
    without_filtered_waves,
)

log = logging.getLogger("femseal")
#: A grid with its results by key, names of parts of the model, and the relative error of the hardness.
Model = tuple[tuple[Prepared, Mapping[str, Any]] | None, Sequence[str], float]


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
    if not left:
        return _with_model_parts(prepared, studies, budgets, mapper, (None, model_parts, hardness))
    answer = leakage_of(studies[prepared.answer.key])
    grids = coarser_grids(prepared, answer)
    solved = [_solved(grid, mapper) for grid in grids]
    smooth = without_filtered_waves(prepared, answer)
    again = {} if smooth is None else _solved(smooth, mapper)
    for key, result in left.items():
        other = route(study_of_result(result)).key
        coarse = [
            against(result, grid, found.get(other))
            for grid, found in zip(grids, solved, strict=True)
        ]
        if not grids:  # pieces of too few pixels to be halved: nothing is known
            coarse = [against(result, prepared, None)]
        filtered = None if smooth is None else against(result, smooth, again.get(other))
        budgets[key] = budget_of(prepared, result, coarse, filtered)
    finest = (grids[0], solved[0]) if grids else None
    return _with_model_parts(prepared, studies, budgets, mapper, (finest, model_parts, hardness))


def _with_model_parts(
    prepared: Prepared,
    studies: Mapping[str, Any],
    budgets: Mapping[str, ErrorBudget],
    mapper: Mapper,
    model: Model,
) -> dict[str, ErrorBudget]:
    """The budgets with the parts of the model, from changed scenes on the coarser grid.

    model : that grid with its results where they are known, else None; names and hardness of `budget.model_changes`.
    """
    known, names, hardness = model
    # the coarser grid, or that of the case where there is none
    coarser = [] if known else coarser_grids(prepared, leakage_of(studies[prepared.answer.key]))
    grid = known[0] if known else (*coarser, prepared)[0]
    changes = model_changes(grid.scene, names, hardness, grid.form)
    continued = continued_scenes(grid) if "continuation" in names else []
    own = known[1] if known else {}
    if not known and (changes or continued):
        own = _solved(grid, mapper)
    found = dict(budgets)
    for key, result in studies.items():
        parts = [
            effective_pressure_part(prepared.scene, result)
            if "effective pressure" in names
            else None
        ]
        if "thin gap" in names:
            parts.append(thin_gap_part(prepared.scene, leakage_of(result)))
        if prepared.form_effect is not None and "form of the patch" in names:
            parts.append(
                patch_form_part(
                    prepared.form_effect,
                    result.steps,
                    leakage_of(result),
                    rises=bool(prepared.holds and prepared.holds.rises),
                )
            )
        if isinstance(result, StochasticResult) and "longer waves" in names:
            moved_by = prepared.longer_waves(grid.scene.surface, mapper)
            if moved_by is not None:
                flat = prepared.flatness is not None
                parts.append(longer_waves_part(moved_by, flat, result.steps, leakage_of(result)))
        found[key] = replace(found[key], parts=(*found[key].parts, *filter(None, parts)))
    if continued:
        others = [_solved(replace(grid, scene=scene), mapper) for scene in continued]
        for key, result in studies.items():
            if (other := route(study_of_result(result)).key) in own:
                part = _of_continued(
                    prepared, grid, result, own[other], [one.get(other) for one in others]
                )
                found[key] = replace(found[key], parts=(*found[key].parts, part))
    for change in changes:
        moved = _solved(grid.changed(change), mapper)
        for key, result in studies.items():
            other = route(study_of_result(result)).key
            if other in own and other in moved:
                leakage, against_own = leakage_of(moved[other]), leakage_of(own[other])
                solution = CoarserSolution(
                    grid.scene.surface.shape, grid.scene.steps, leakage, against_own
                )
                part = model_part(change, result.steps, leakage_of(result), solution)
                found[key] = replace(found[key], parts=(*found[key].parts, part))
    return found


def _of_continued(
    prepared: Prepared, grid: Prepared, result: Any, own: Any, moved: Sequence[Any]
) -> ErrorPart:
    """Part of the continued waves, with what slope, area and leakage do with the cut-off.

    own : result on the coarser grid. moved : those of `continued_scenes`, None where one failed.
    """
    scene, continued = grid.scene, prepared.continuation
    assert continued is not None
    nothing, q = np.full(len(scene.steps), np.nan), leakage_of(own)
    at = first_known(q)
    leakages = [nothing if one is None else leakage_of(one) for one in moved]
    *others, shorter = (
        CoarserSolution(scene.surface.shape, scene.steps, one, q) for one in leakages[:-1]
    )
    # as measured, to twice the cut-off where that is below the measured waves, and to the cut-off
    wave = continued.cut_off
    versions = [(continued.longest, moved[-1]), (2 * wave, moved[-2]), (wave, own)]
    rows = [
        (
            cut,
            continued.slope_to(cut),
            contact_fraction_of(one, scene.steps)[at],
            leakage_of(one)[at] / q[at],
        )
        for cut, one in versions
        if one is not None and q[at] != 0 and (cut <= continued.longest)
    ]
    note = "; ".join(
        f"cut-off {to_text(cut, 'm', 3)}: rms slope {slope:.3g}, at the first load {area:.2%} in contact and "
        f"{ratio:.3g} times the leakage"
        for cut, slope, area, ratio in rows
    )
    last = continued.last_that_counts(scene.law.mean_hardness, scene.modulus)
    octaves = max(1.0, log2(continued.cut_off / last)) if last else inf
    return continuation_part(prepared.scene, leakage_of(result), others, shorter, octaves, note)


def budget_of(
    prepared: Prepared,
    result: Any,
    coarse: list[CoarserSolution],
    filtered: CoarserSolution | None,
) -> ErrorBudget:
    """Error budget of a result of a prepared case, see `error_budget`."""
    return error_budget(
        prepared.scene,
        result,
        coarse=coarse,
        filtered=filtered,
        octaves=removed_octaves(prepared),
        kept_slope=kept_slope(prepared),
        wave_pixels=wave_pixels(prepared),
    )


def leakage_of(result: Any) -> Array:
    """Leakage of a study at every step (steps,) [m²/s]: the one that answers."""
    return study_of_result(result).leakage(result)


def against(result: Any, coarse: Prepared, found: Any) -> CoarserSolution:
    """A coarser solution beside the result of a study; unknown leakage where it failed."""
    points, steps = coarse.scene.surface.shape, coarse.scene.steps
    if found is None:
        return CoarserSolution(points, steps, np.full(len(steps), np.nan))
    if not isinstance(result, StochasticResult):
        return CoarserSolution(points, steps, leakage_of(found))
    # the same pieces in the same tiles: the first seals of both are compared
    places, few = [result.steps.index(step) for step in steps], len(found.leakage)
    own = replace(result, leakage=result.leakage[:few])
    return CoarserSolution(points, steps, leakage_of(found), leakage_of(own)[places])


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

"""The error budget of every study of a run, from coarser versions of it that are solved too."""

import logging
from collections.abc import Iterator, Mapping, Sequence
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
from ..loads import first_known
from ..preparation.prepared import Prepared
from ..studies import StochasticResult, study_of_result
from ..studies.study_registry import contact_fraction_of
from .coarser import (
    coarser_grids,
    continued_scenes,
    kept_slope,
    route,
    wave_pixels,
    without_filtered_waves,
)

log = logging.getLogger("femseal")


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
    answer = leakage_of(studies[prepared.answer.key])
    grids = coarser_grids(prepared, answer)
    solved = [_solved(grid, mapper) for grid in grids if left]
    smooth = without_filtered_waves(prepared, answer) if left else None
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
    # the coarser grid, or that of the case where there is none
    grid = (*grids, prepared)[0]
    changes = model_changes(grid.scene, model_parts, hardness, grid.form)
    continued = continued_scenes(grid) if "continuation" in model_parts else []
    own = solved[0] if solved else _solved(grid, mapper) if changes or continued else {}
    phases = [_solved(replace(grid, scene=scene), mapper) for scene in continued]
    moved = []  # of each change the leakage alone, as fields may be large
    for change in changes:
        found = _solved(grid.changed(change), mapper)
        moved.append((change, {key: leakage_of(one) for key, one in found.items()}))
    for key, result in studies.items():
        parts = [*budgets[key].parts, *_unsolved_parts(prepared, grid, result, model_parts, mapper)]
        other = route(study_of_result(result)).key
        if phases and other in own:
            faces = [one.get(other) for one in phases]
            parts.append(_of_continued(prepared, grid, result, own[other], faces))
        for change, leakages in moved:
            if other in own and other in leakages:
                both = leakages[other], leakage_of(own[other])
                solution = CoarserSolution(grid.scene.surface.shape, grid.scene.steps, *both)
                parts.append(model_part(change, result.steps, leakage_of(result), solution))
        budgets[key] = replace(budgets[key], parts=tuple(filter(None, parts)))
    return budgets


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
    """Part of the continued waves, with what slope, area and leakage do with the cut-off.

    own : result on the coarser grid. moved : those of `continued_scenes`, None where one failed.
    """
    scene, continued, q = grid.scene, prepared.continuation, leakage_of(own)
    assert continued is not None
    nothing, at, wave = np.full(len(scene.steps), np.nan), first_known(q), continued.cut_off
    leakages = [nothing if one is None else leakage_of(one) for one in moved]
    *others, shorter = (
        CoarserSolution(scene.surface.shape, scene.steps, one, q) for one in leakages[:-1]
    )
    # as measured, to twice the cut-off where that is below the measured waves, and to the cut-off
    versions = [(continued.longest, moved[-1]), (2 * wave, moved[-2]), (wave, own)]
    note = "; ".join(
        f"cut-off {to_text(cut, 'm', 3)}: rms slope {continued.slope_to(cut):.3g}, at the first load "
        f"{contact_fraction_of(one, scene.steps)[at]:.2%} in contact and "
        f"{leakage_of(one)[at] / q[at]:.3g} times the leakage"
        for cut, one in versions
        if one is not None and q[at] != 0 and cut <= continued.longest
    )
    last = continued.last_that_counts(scene.law.mean_hardness, scene.modulus)
    octaves = max(1.0, log2(wave / last)) if last else inf
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
        octaves=prepared.conditioning.removed_octaves,
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

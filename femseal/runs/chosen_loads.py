"""Loads of a case that are solved where the others may be interpolated: as few as the curves of leakage allow."""

from __future__ import annotations

import logging
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ..loads import LoadProgramme
from ..studies import Scene
from ..studies.between_loads import Array, Indices, branches, left_out_errors, numbers_of
from .attempts import Solve
from .budgeted import leakage_of

if TYPE_CHECKING:
    from .preparation import Prepared

log = logging.getLogger("femseal.runs.chosen_loads")
#: Most steps in a row that are left out at first.
FIRST_GAP = 3
#: Share of the error without a step that is left with it: its neighbours are then twice as near, and the interpolation
#: is at least of order two.
LEFT = 0.25


def solve_chosen(prepared: Prepared, tolerance: float, solve: Solve) -> tuple[Prepared, Any]:
    """Solve the answer at a part of the load steps, and at more until the others can be interpolated.

    Steps are added between two solved ones where either would be missed by more than the tolerance if it was left out
    itself, see `LEFT`, and between an open and a closed or failed one until none is left.

    Parameters
    ----------
    tolerance : relative error of the leakage between solved steps.
    solve : called as solve(method, prepared, known, told), gives the result of a study.

    Returns
    -------
    The case with the loads that are solved, and its result.
    """
    scene = prepared.scene
    steps, loads = scene.steps, _first(scene.steps)
    for count in range(1, len(steps) + 1):
        chosen = replace(prepared, scene=_with_loads(scene, loads))
        study = solve(chosen.answer, chosen, {}, f"loads {count}")
        solved = numbers_of(chosen.scene.steps, steps)
        more = _needed(leakage_of(study), solved, steps, np.log1p(tolerance)) - loads
        log.info("%d of %d load steps solved, %s", solved.size, len(steps), "more to come" if more else "enough")
        if not more:
            break
        loads |= more
    if prepared.filtered is not None:
        chosen = replace(chosen, filtered=_with_loads(prepared.filtered, loads))
    return chosen, study


#: A load: its pressure [Pa], and whether it is one of loading.
_Load = tuple[float, bool]


def _first(steps: LoadProgramme) -> set[_Load]:
    """Ends of all branches, the peaks, and steps between."""
    loading, stops = steps.loading, steps.unloading
    fixed = sorted({0, len(loading) - 1, *(loading.index(peak) for peak in steps.unload_from)})
    chosen = {(loading[n], True) for n in _filled(fixed)}
    return chosen | {(stops[n], False) for n in (_filled([0, len(stops) - 1]) if stops else ())}


def _filled(numbers: list[int]) -> set[int]:
    """Rising numbers, and others between so that no more than `FIRST_GAP` in a row are missing."""
    found = set(numbers)
    for low, high in pairwise(numbers):
        parts = -(-(high - low) // (FIRST_GAP + 1))
        found |= {low + round(n * (high - low) / parts) for n in range(1, parts)}
    return found


def _needed(leakage: Array, solved: Indices, steps: LoadProgramme, tolerance: float) -> set[_Load]:
    """Loads in the middle of intervals between solved ones that cannot be interpolated."""
    errors = left_out_errors(leakage, solved, steps)
    value = dict(zip(solved.tolist(), leakage.tolist(), strict=True))
    found = set()
    for branch in branches(steps):
        places = [n for n, s in enumerate(branch.tolist()) if s in value]
        for low, high in pairwise(places):
            ends = [int(branch[low]), int(branch[high])]
            first, last = value[ends[0]], value[ends[1]]
            if high - low < 2 or first == last == 0:
                continue
            known = [errors[s] for s in ends if s in errors]
            if known and first * last > 0 and LEFT * max(known) <= tolerance:
                continue
            step = steps[int(branch[(low + high) // 2])]
            found.add((step.pressure, step.unloaded_from is None))
    return found


def _with_loads(scene: Scene, loads: set[_Load]) -> Scene:
    loading = tuple(sorted(p for p, up in loads if up))
    return replace(scene, loading=loading, unloading=tuple(sorted((p for p, up in loads if not up), reverse=True)))

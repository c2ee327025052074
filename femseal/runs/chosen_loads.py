"""Loads of a case that are solved where the others may be interpolated: as few as the curves of leakage allow."""

import logging
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from ..base import Array, Indices
from ..execution.run import Run
from ..loads import LoadProgramme
from ..preparation.prepared import Prepared
from ..refinement.budgets import leakage_of
from ..studies.load_curves import branches, left_out_errors, numbers_of

log = logging.getLogger("femseal.runs.chosen_loads")
#: Most steps in a row that are left out at first.
FIRST_GAP = 3
#: Factor on the error without a step for an interval at the end of a branch, one side of which has no such error.
#: Measured on 16 faces with 38 loads from open to closing: within 1, 3 and 10 % in 47 of 48 cases, 1.003 of it in one.
AT_ENDS = 2.0


def solve_chosen(prepared: Prepared, tolerance: float, run: Run) -> tuple[Prepared, Any]:
    """Solve the answer at a part of the load steps, and at more until the others can be interpolated.

    tolerance : relative error of the leakage between solved steps.

    Returns the case with the loads that are solved, and its result.
    """
    found: list[tuple[Prepared, Any]] = []

    def leakage_at(part: LoadProgramme) -> Array:
        scene = replace(prepared.scene, loading=part.loading, unloading=part.unloading)
        version = replace(prepared, scene=scene)
        with run.timed(f"loads {len(found) + 1}") as mapper:
            found.append((version, version.solve(version.answer, mapper)))
        return leakage_of(found[-1][1])

    steps = prepared.scene.steps
    part = choose(steps, tolerance, leakage_at)
    log.info("%d of %d load steps solved, the others interpolated", len(part), len(steps))
    return found[-1]


def choose(steps: LoadProgramme, tolerance: float, leakage_at: Callable[[LoadProgramme], Array]) -> LoadProgramme:
    """The part of a programme from which the leakage at the other steps can be interpolated.

    It begins with the ends of all branches and some steps between. One is added between two that it has where either
    would be missed by more than the tolerance if it was left out itself, and between an open and a closed or failed one
    until none is left.

    leakage_at : leakage at the steps of a part.
    """
    loads = _first(steps)
    while True:
        part = LoadProgramme.of(
            sorted(p for p, up in loads if up), steps.unload_from, sorted(p for p, up in loads if not up)
        )
        more = _needed(leakage_at(part), numbers_of(part, steps), steps, float(np.log1p(tolerance))) - loads
        if not more:
            return part
        loads |= more


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
            factor = 1.0 if len(known) == 2 else AT_ENDS
            if known and first * last > 0 and factor * max(known) <= tolerance:
                continue
            step = steps[int(branch[(low + high) // 2])]
            found.add((step.pressure, step.unloaded_from is None))
    return found

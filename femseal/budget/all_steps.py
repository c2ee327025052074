"""The error budget of a leakage that is interpolated between load steps that were solved."""

from __future__ import annotations

import numpy as np

from ..loads import LoadProgramme
from ..studies.load_interpolation import Indices, at_all_steps, neighbours
from ..studies.scene import Array
from .error_parts import ErrorBudget, ErrorPart


def at_interpolated_steps(budget: ErrorBudget, solved: Indices, steps: LoadProgramme, tolerance: float) -> ErrorBudget:
    """The budget at every step of a programme from that at the solved ones.

    A part is as wide as at the wider of the two solved steps beside; the interpolation is a part of its own.

    Parameters
    ----------
    solved : numbers of the solved steps. tolerance : relative error of an interpolated leakage.
    """
    leakage = at_all_steps(budget.leakage, solved, steps, logarithmic=True)
    parts = tuple(_part(part, budget.leakage, leakage, solved, steps) for part in budget.parts)
    width = np.full(len(steps), np.log1p(tolerance))
    width[solved] = 0.0
    note = "The tolerance of the interpolation between loads that were solved."
    return ErrorBudget(budget.method, leakage, (*parts, ErrorPart.of("loads", leakage, width, width, note)), steps)


def _part(part: ErrorPart, own: Array, leakage: Array, solved: Indices, steps: LoadProgramme) -> ErrorPart:
    ends = []
    for values, sign in ((part.lower, -1.0), (part.upper, 1.0)):
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.where(own == values, 0.0, sign * np.log(np.abs(values) / np.abs(own)))
        every, sealed = np.full((2, len(steps)), np.nan)
        every[solved], sealed[solved] = distance, values
        for s, (low, high) in neighbours(solved, steps).items():
            every[s], sealed[s] = np.maximum(every[low], every[high]), max(sealed[low], sealed[high], key=abs)
        with np.errstate(invalid="ignore", over="ignore"):
            ends.append(np.where(leakage == 0, sealed, leakage * np.exp(sign * every)))
        ends[-1][solved] = values
    return ErrorPart(part.name, ends[0], ends[1], part.note)

"""Expected cost of a study of a prepared case."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..studies import Scene, laid_out
from ..studies.costs import (
    Effort,
    deterministic_cost,
    pressures_of_gas,
    stochastic_cost,
    two_scale_cost,
    usual_efforts,
)
from ..windows import Partition

if TYPE_CHECKING:
    from .preparation import Prepared


def study_cost(
    method: str, prepared: Prepared, scene: Scene, known: Sequence[Effort] | None = None, *, solved: bool = False
) -> tuple[float, float]:
    """Expected time on one core [s] and memory [byte] of a study.

    known : effort of each load step; usual ones unless given. solved : the deterministic study
    leaves its contact to two scales.
    """
    points, cells, pressures = scene.surface.shape, prepared.cells, pressures_of_gas(scene)
    known = usual_efforts(len(scene.steps)) if known is None else known
    if method == "deterministic":
        return deterministic_cost(known, points, pressures)
    assert cells is not None
    if method == "two-scale":
        return two_scale_cost(known, points, cells, prepared.flow, prepared.contact, solved=solved, pressures=pressures)
    assert prepared.sampling is not None
    every = laid_out(scene.layout, Partition(points, scene.surface.spacing, cells), prepared.sampling)
    # seals of all lengths take the work of one as long as all of them together
    seal = every[0].unknowns[0], sum(laid.unknowns[1] for laid in every)
    return stochastic_cost(known, points, cells, prepared.sampling, seal, prepared.contact, pressures)

"""Sizes of the files of a run, before it is started."""

from dataclasses import dataclass
from math import prod

import numpy as np

from ..base import to_text
from ..base.shared_array import storing
from ..budget import model_changes
from ..case.case import Case
from ..preparation.prepared import Prepared
from ..refinement.coarser import CONTINUED_SCENES, coarser_grids, without_filtered_waves
from ..results.paraview import fields_size
from ..studies.face_study import STEP_BYTES, states_memory
from ..studies.study_registry import usual_seals


@dataclass(frozen=True)
class Disk:
    """Expected sizes before compression [byte].

    fields : the fields over all pixels, at `steps` `of` the load steps. others : all other files. checkpoint : size of
    the store during the run, and of states that lie on disk.
    """

    fields: float
    steps: int
    of: int
    others: float
    checkpoint: float

    def __str__(self) -> str:
        """The sizes as a line of a forecast."""
        text = f"about {_size(self.fields + self.others)}"
        if self.fields:
            text += f", of it fields {_size(self.fields)} before compression"
            text += f" ({self.steps} of {self.of} steps, fields_limit)"
        if self.checkpoint:
            text += f"; {_size(self.checkpoint)} more while it runs"
        return text


def disk(case: Case, prepared: Prepared, again: list[Prepared] | None = None) -> Disk:
    """Expected sizes of the files of a run; `again` as in `forecast`."""
    again = budget_inputs(case, prepared) if again is None else again
    scene = prepared.scene
    steps, pixels = len(scene.steps), int(np.prod(scene.surface.shape))
    studies = {study.key for study in prepared.studies}
    each = fields_size(scene.surface.shape, studies)
    fitting = (
        int(min(case.output.fields_limit // each, steps)) if each and case.output.fields else 0
    )
    formats = case.output.paraview != "none"
    # pictures and report; heights for ParaView
    others = 2e6 * (case.output.pictures or case.output.report) + 4.0 * pixels * formats
    # a piece: ten numbers in results.nc, and in the mesh of the seal
    others += 80 * steps * prod(prepared.cells or (0, 0)) * (1 + formats)
    if (sampling := prepared.sampling) is not None:
        cut, tiles = prepared.cut_and_tiles
        seals = sampling.realisations or usual_seals(cut.shape, tiles)
        others += 8.0 * steps * (seals + 5 * len(tiles.tile) * (1 + formats))
    checkpoint = sum(_checkpoint(one) for one in (prepared, *again))
    with storing(None, case.memory):
        if not states_memory(pixels, steps) and _keeps_states(prepared):
            checkpoint += STEP_BYTES * pixels * steps  # the states themselves
    return Disk(float(each * fitting), fitting, steps, others, checkpoint)


def budget_inputs(case: Case, prepared: Prepared) -> list[Prepared]:
    """What the error budget of a run solves besides."""
    if not case.output.budget:
        return []
    smooth = without_filtered_waves(prepared)
    coarser = coarser_grids(prepared)
    grid = (*coarser[:1], prepared)[0]
    changes = model_changes(grid.scene, case.output.model_parts, case.hardness_tolerance, grid.form)
    models = [grid.changed(change) for change in changes]
    if prepared.continuation is not None and "continuation" in case.output.model_parts:
        models += [grid] * CONTINUED_SCENES
    return [*coarser, *([] if smooth is None else [smooth]), *models]


def _keeps_states(prepared: Prepared) -> bool:
    """Whether a study keeps the states of the whole face: all but seals whose pieces are taken along a ladder."""
    return prepared.methods != {"stochastic"} or prepared.cut_and_tiles[1].in_place


def _checkpoint(prepared: Prepared) -> float:
    """Expected size of the store of the studies of an input [byte]."""
    scene, drawn = prepared.scene, "stochastic" in prepared.methods
    steps, pixels, peaks = (
        len(scene.steps),
        int(np.prod(scene.surface.shape)),
        len(set(scene.unload_from)),
    )
    on_ladder = drawn and not prepared.cut_and_tiles[1].in_place
    found = 8.0 * pixels * max(peaks, 1) if on_ladder else 0.0
    if _keeps_states(prepared):
        found += pixels * (STEP_BYTES * steps + 8.0 * peaks)
    return found


def _size(size: float) -> str:
    return to_text(float(f"{size:.1e}"), "B", 3)

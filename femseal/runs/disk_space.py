"""Forecast the sizes of the files of a run before it is started."""

from dataclasses import dataclass
from math import prod

from ..base import to_text
from ..base.shared_arrays import storing
from ..budget.study_input import StudyInput
from ..case.case import Case
from ..studies.cost_model import RESULT_BYTES, STATE_BYTES, states_memory
from ..studies.sampling import usual_realisations
from .forecast import budget_inputs

#: Size of the three fields of a pixel in single precision: gap, contact pressure and fluid pressure [byte].
_FIELDS_BYTES = 12.0
#: Size of a cell in `results.nc` and in the mesh of the seal at a load step: ten numbers [byte].
_CELL_BYTES = 80
#: Size of pictures and report together [byte].
_PICTURES_BYTES = 4.5e6


@dataclass(frozen=True)
class DiskSpace:
    """Expected sizes of the files of a run, before compression.

    Parameters
    ----------
    fields : float
        Size of the fields over all pixels [byte].
    stored_steps : int
        Number of load steps whose fields are stored.
    steps : int
        Number of all load steps.
    other_files : float
        Size of all other files of the results [byte].
    checkpoint : float
        Size of temporary files that are deleted at the end of the run [byte]. Temporary files contain the results of
        completed stages, and contact states that do not fit into memory.
    """

    fields: float
    stored_steps: int
    steps: int
    other_files: float
    checkpoint: float

    def __str__(self) -> str:
        """Return the expected size of the files of a run as text."""
        text = f"about {_size_text(self.fields + self.other_files)}"
        if self.fields:
            text += f", including fields of {_size_text(self.fields)} before compression"
            text += f" ({self.stored_steps} of {self.steps} steps, fields_limit)"
        if self.checkpoint:
            text += f"; {_size_text(self.checkpoint)} more while it runs"
        return text


def disk_space(
    case: Case, study_input: StudyInput, budget_versions: list[StudyInput] | None = None
) -> DiskSpace:
    """Forecast the sizes of the files of a run. See `forecast` for the parameters."""
    if budget_versions is None:
        budget_versions = budget_inputs(case, study_input)
    scene = study_input.scene
    steps = len(scene.steps)
    pixels = prod(scene.surface.shape)
    step_size = _FIELDS_BYTES * pixels
    stored_steps = 0
    has_fields = any(study.has_pixel_fields for study in study_input.studies)
    if case.output.fields and has_fields:
        stored_steps = int(min(case.output.fields_limit // step_size, steps))
    checkpoint = sum(_store_size(version) for version in (study_input, *budget_versions))
    with storing(None, case.memory):
        # contact states that are stored on disk take no memory
        states_are_on_disk = states_memory(pixels, steps) == 0
    if states_are_on_disk and stores_states(study_input):
        checkpoint += RESULT_BYTES * pixels * steps
    return DiskSpace(
        fields=step_size * stored_steps,
        stored_steps=stored_steps,
        steps=steps,
        other_files=_size_without_fields(case, study_input),
        checkpoint=checkpoint,
    )


def _size_without_fields(case: Case, study_input: StudyInput) -> float:
    """Estimate the size of all files in the results folder [byte], except the fields over all pixels."""
    steps = len(study_input.scene.steps)
    # cells and tiles are written to results.nc, and to files for ParaView if they are asked for
    n_files = 1 + (case.output.paraview != "none")
    size = 0.0
    if case.output.pictures or case.output.report:
        size += _PICTURES_BYTES
    if case.output.paraview != "none":
        size += 4.0 * prod(study_input.scene.surface.shape)  # heights in single precision
    size += _CELL_BYTES * steps * prod(study_input.cells or (0, 0)) * n_files
    sampling = study_input.sampling
    if sampling is None:
        return size
    cut, tiles = study_input.cut_and_tiles
    n_seals = sampling.realisations or usual_realisations(cut.shape, tiles)
    # In double precision, for each load step: the leakage of every realisation, and five numbers of every tile of the
    # realisation whose tiles are stored.
    return size + 8.0 * steps * (n_seals + 5 * len(tiles.tile) * n_files)


def stores_states(study_input: StudyInput) -> bool:
    """Return whether a study stores the whole-surface contact states of all load steps until it ends."""
    return any(
        study.stores_states(study_input.scene, study_input.options(study))
        for study in study_input.solved_studies
    )


def _store_size(study_input: StudyInput) -> float:
    """Estimate the disk space that the stored results of the stages take up during the run [byte]."""
    scene = study_input.scene
    steps = len(scene.steps)
    peaks = len({*scene.unload_from})
    pixels = prod(scene.surface.shape)
    # For each load from which the seal is unloaded, the plastic deformation is stored in double precision, because the
    # unloading begins with this deformation.
    plastic_deformation = 8.0 * pixels  # [byte]
    size = sum(
        study.other_stored_bytes(scene, study_input.options(study))
        for study in study_input.solved_studies
    )
    if stores_states(study_input):
        size += STATE_BYTES * pixels * steps + plastic_deformation * peaks
    return size


def _size_text(size: float) -> str:
    """Return a size [byte] as text with two significant digits."""
    return to_text(float(f"{size:.1e}"), "B", 3)

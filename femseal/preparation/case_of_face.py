"""Write a first case file for a measured surface."""

import os
from pathlib import Path

from ..base import InputError, to_text
from ..case.case import Case
from ..case.faces import SurfaceTable
from ..case.template import as_toml, table_to_paste
from ..topography import Look, read_for_a_look
from ..topography.text_files import is_text
from .survey import ORIENTATION, advice, in_metres, survey_surface

#: Questions that no file of heights answers, by the table of the case that contains the answer.
_OPEN_QUESTIONS = {
    "material": "how strong is the softer face as it was machined? The other one: [counter_material], rigid without",
    "load": "which contact pressures in assembly, and down to which in service? Or forces: 10 kN, 200 N/mm",
    "fluid": "which fluid, between which pressures?",
}
#: Fields of the description of a surface that are repeated in its case file.
_SHOWN_FIELDS = (
    "shape",
    "spacing",
    "undefined_fraction",
    "spike_points",
    "rms_height",
    "rms_slope",
    "lay_direction",
    "shortest_wave",
)


def case_of_face(
    path: Path,
    folder: Path,
    *,
    spacing: tuple[str, str] | None = None,
    height_unit: str | None = None,
) -> str:
    """Write a first case file for a measured surface, and return it as text.

    Material, load and fluid of the case are examples from the template, which the user has to replace. Comments in the
    case ask the user for all values that the file of the surface does not contain.

    Parameters
    ----------
    path : Path
        File of the surface.
    folder : Path
        Folder of the case, to which paths in the case are relative.
    spacing : (str, str), optional
        Spacing of the points along x1 and x2 with its unit, if the file does not contain the spacing.
    height_unit : str, optional
        Unit of the heights, if the file does not contain the unit.

    Raises
    ------
    InputError
        No surface can be read from the file, or the spacing of the points or the unit of the heights is not known.
    """
    file_content = read_for_a_look(path, height_unit=height_unit, **in_metres(spacing=spacing))
    _require_scale(path, file_content)
    face = file_content.topography
    treatment = SurfaceTable().model_dump(include={"detrend", "spikes", "max_undefined"})
    surveyed = survey_surface(face, None, treatment, file_content.instrument)
    name = os.path.relpath(path, folder).replace(os.sep, "/")
    keys = {"path": name, "spacing": spacing, "height_unit": height_unit}
    size = as_toml([to_text(side, "m", 6) for side in face.size])
    lines = [
        f"# A case for the surface in {path.name}. x1 is the direction of the leakage, x2 runs along the seal.",
        "# A question mark asks for what the file does not say; `femseal check` says what a run computes.",
        "",
        f"title = {as_toml(path.stem)}",
        "",
        "[face]",
        *(f"{key} = {as_toml(value)}" for key, value in keys.items() if value is not None),
        *(f"# {note}" for note in file_content.notes),
        *([f"# {ORIENTATION}"] if is_text(path) else []),
        f"# size = {size}  # as the file says: ? is that the field of the instrument",
    ]
    lines += [f"#   {line}" for line in surveyed.report.lines(_SHOWN_FIELDS)]
    questions = [*map(str, file_content.errors), *surveyed.reasons]
    surface_table: list[str] = []
    if surveyed.conditioning is not None:
        # the wavelength is a key of the case below
        questions += advice(surveyed.report, surveyed.conditioning, with_wave=False)
        questions += surveyed.warnings
        wave = max(surveyed.report.shortest_wave, surveyed.conditioning.shortest_wave)
        reason = "the shortest one above noise, of 8 pixels or more"
        surface_table = [
            "",
            "[surface]",
            f'shortest_wave = "{to_text(wave, "m", 3)}"  # {reason}',
        ]
    lines += [f"# ? {question}" for question in questions]
    lines += surface_table
    for table, question in _OPEN_QUESTIONS.items():
        lines += ["", f"# ? {question}", *table_to_paste(Case, table).splitlines()]
    lines += [
        "",
        "# ? how long is the seal (of a ring: its mean circumference), and how wide is its contact from inlet to",
        "# outlet? Without these keys, the results are those of a seal as long and as wide as the map",
        "[stochastic]",
        '# length = "160 mm"',
        '# breadth = "2 mm"',
    ]
    return "\n".join(lines) + "\n"


def _require_scale(path: Path, file_content: Look) -> None:
    """Raise InputError if the pixel size of a map or the unit of its heights is not known.

    For NumPy files, no unit is needed: heights in NumPy files are in m.
    """
    has_pixel, has_unit = file_content.is_known
    missing = {} if has_pixel else {"pixel size": "--spacing '1 um' '1 um'"}
    if not has_unit and path.suffix.lower() not in (".npy", ".npz"):
        missing["unit of heights"] = "--height-unit um"
    if missing:
        expected = f"{' and '.join(missing.values())}, as measured"
        raise InputError(str(path), f"no {' and no '.join(missing)}", expected)

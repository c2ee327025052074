"""A case file to start from for a measured face: what its file says, and as comments what it cannot say."""

from __future__ import annotations

import json
import os
from pathlib import Path

from ..base.quantities import to_text
from ..case.faces import SurfaceTable
from ..case.faults import table_to_paste
from ..topography import read_for_a_look
from .survey import look, notes

#: What no file of heights says, by the table that says it.
_OPEN = {
    "material": "how strong is the softer face as it was machined? The other one: [counter_material], rigid without",
    "load": "which contact pressures in assembly, and down to which in service? Or forces: 10 kN, 200 N/mm",
    "fluid": "which fluid, between which pressures?",
}
#: Lines of the description of a face that its case shows.
_SHOWN = ("points ", "pixel", "undefined", "Sq,", "rms slope ", "Std", "shortest wave above")


def case_of_face(path: Path, folder: Path) -> str:
    """Text of a case of a measured face, for a file in a folder; its last tables hold values of the template.

    Raises InputError: no face can be read from the file.
    """
    seen = read_for_a_look(path)
    given = SurfaceTable().model_dump(include={"detrend", "spikes", "max_undefined"})
    face, found = seen.topography, look(seen.topography, None, given)
    sides = [to_text(side, "m", 6) for side in face.size]
    name = os.path.relpath(path, folder).replace(os.sep, "/")
    lines = [
        f"# A case of {path.name}. x1 is the direction of the leakage, x2 runs along the seal.",
        "# A question mark asks for what the file does not say; `femseal check` says what a run computes.",
        "",
        f"title = {json.dumps(path.stem, ensure_ascii=False)}",
        "",
        "[face]",
        f"path = {json.dumps(name, ensure_ascii=False)}",
        f"# size = {json.dumps(sides, ensure_ascii=False)}  # as the file says: ? is that the field of the instrument",
    ]
    questions, surface = [*map(str, seen.doubts), *found.reasons], []
    if found.report is not None:
        lines += [f"#   {line}" for line in str(found.report).splitlines() if line.startswith(_SHOWN)]
    if found.report is not None and found.conditioning is not None:
        told = [note.removeprefix("note: ") for note in notes(found.report, found.conditioning)]
        questions += [note for note in told if "shortest_wave" not in note]
        wave = max(found.report.shortest_wave, found.conditioning.shortest_wavelength)
        surface = ["", "[surface]", f'shortest_wave = "{to_text(wave, "m", 3)}"  # the shortest one above noise']
    lines += [f"# ? {question}" for question in questions] + surface
    for table, question in _OPEN.items():
        lines += ["", f"# ? {question}", *table_to_paste(table).splitlines()]
    return "\n".join(lines) + "\n"

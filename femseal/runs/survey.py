"""Survey of a measured face before a run: its description, and the effect of its conditioning."""

from __future__ import annotations

from math import degrees, isnan, pi
from pathlib import Path
from typing import Any

from ..base.errors import InputError
from ..base.quantities import to_si, to_text
from ..plots import survey_figure
from ..topography import Conditioning, SurfaceReport, describe_surface, read_topography, repair, smooth
from .case_words import in_words_of
from .preparation import default_grid

#: Arguments of `topography` by their option.
SURFACE_OPTIONS = {
    "shortest_wavelength": "--shortest-wave",
    "max_share": "--max-undefined",
    "order": "--detrend",
    "spikes": "--spikes",
    "shape": "surface.points",
}
_PICTURES = (".png", ".pdf", ".svg")


def survey(
    path: Path,
    picture: Path | None,
    *,
    size: tuple[str, str] | None,
    spacing: tuple[str, str] | None,
    spikes: float,
    detrend: int,
    shortest_wave: str | None,
    max_undefined: float,
    **reading: Any,
) -> list[str]:
    """Lines on the face in a file; `picture` also writes its picture.

    Parameters
    ----------
    path, size, spacing, reading : as `read_topography` takes them, lengths as text with their unit.
    picture : file to write, .png, .pdf or .svg.
    spikes, detrend, shortest_wave, max_undefined : keys of the table [surface] of a case.

    Raises
    ------
    InputError : an argument or the file cannot be used; no picture is written.
    """
    if picture is not None and (picture.suffix.lower() not in _PICTURES or not picture.absolute().parent.is_dir()):
        raise InputError.of("output", f"'{picture}'", f"a file {', '.join(_PICTURES)} in a folder that exists")
    lengths: dict[str, Any] = {
        name: tuple(to_si(side, "m", f"--{name}") for side in pair)
        for name, pair in (("size", size), ("spacing", spacing))
        if pair is not None
    }
    wave = None if shortest_wave is None else to_si(shortest_wave, "m", "--shortest-wave")
    face = read_topography(path, **lengths, **reading)
    treatment: dict[str, Any] = {"detrend": detrend, "spikes": spikes, "max_undefined": max_undefined}
    with in_words_of(SURFACE_OPTIONS):
        report = describe_surface(face, **treatment)
        flat, repaired = repair(face, **treatment)
        _, conditioning = smooth(flat, repaired, shortest_wavelength=wave, shape=default_grid(flat, wave))
    lines = [str(path), *_indented(report), "what a run does to it", *_indented(conditioning)]
    lines += _notes(report, conditioning)
    if picture is not None:
        figure = survey_figure(face, report, conditioning, detrend=detrend, spikes=spikes)
        figure.suptitle(path.name, fontsize=11, parse_math=False)
        try:
            figure.savefig(picture)
        except OSError as error:
            raise InputError.of("output", f"'{picture}'", f"a file that can be written ({error.strerror})") from None
        lines.append(f"picture in {picture}")
    return lines


def _indented(report: SurfaceReport | Conditioning) -> list[str]:
    return [f"  {line}" for line in str(report).splitlines()]


def _notes(report: SurfaceReport, conditioning: Conditioning) -> list[str]:
    """Advice that follows from the numbers."""
    notes = []
    if report.shortest_wave > conditioning.shortest_wavelength * (1 + 1e-9):
        wave = to_text(report.shortest_wave, "m", 3)
        notes.append(
            f"note: waves below {wave} are noise or beyond the instrument: shortest_wave = '{wave}' removes them"
        )
    if not isnan(report.lay_direction) and abs(report.lay_direction) > pi / 4:
        angle = degrees(abs(report.lay_direction))
        notes.append(f"note: the lay runs {angle:.0f}° off x2, along the leakage: transpose exchanges the axes")
    return notes

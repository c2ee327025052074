"""Survey of a measured face before a run: its description, the effect of its conditioning, a case to start from.

No face is refused: one that a run refuses is described with the reason, as far as it can be.
"""

import os
from dataclasses import dataclass, replace
from math import degrees, isnan, pi
from pathlib import Path
from textwrap import indent
from typing import Any

from ..base import InputError, as_text, to_si, to_text, validate, writing
from ..case.case import Case
from ..case.faces import SurfaceTable
from ..case.template import as_toml, table_to_paste
from ..checks import FormEffect, estimate_surface, solve_form_effect
from ..contact.law import PerfectlyPlastic
from ..plots import survey_figure
from ..topography import (
    Conditioning,
    Instrument,
    Look,
    Representative,
    SurfaceReport,
    TooManyUndefined,
    Topography,
    describe_surface,
    read_for_a_look,
    repair,
    representative,
    smooth,
)
from ..topography.text_files import is_text
from .face import default_grid, with_keys

#: Arguments of `topography` by their option.
SURFACE_OPTIONS = {
    "shortest_wave": "--shortest-wave",
    "max_share": "--max-undefined",
    "max_undefined": "--max-undefined",
    "order": "--detrend",
    "spikes": "--spikes",
    "crop": "--crop",
    "mask": "--mask",
    "file_mask": "--no-file-mask",
    "no_data": "--no-data",
    "shape": "surface.points",
    "tip_radius": "--tip-radius",
    "resolution": "--resolution",
}
#: How a text lies, which differs from an array of NumPy.
_ORIENTATION = "a line of the text runs along x1, the leakage; transpose makes it run along x2, as rows of NumPy do"
_PICTURES = (".png", ".pdf", ".svg")
#: Options that are lengths, or several of them.
_LENGTHS = {"size", "spacing", "crop", "tip_radius", "resolution", "shortest_wave"}
#: What no file of heights says, by the table that says it.
_OPEN = {
    "material": "how strong is the softer face as it was machined? The other one: [counter_material], rigid without",
    "load": "which contact pressures in assembly, and down to which in service? Or forces: 10 kN, 200 N/mm",
    "fluid": "which fluid, between which pressures?",
}
#: Pressures on a face that has neither load nor material, over the hardness, and that over E* and the rms slope.
_PRESSURES, _HARDNESS = (0.02, 0.15), 0.15
_LOADS = "0.02 to 0.15 of a hardness of 0.15 E* times its slope"
#: Lines of the description of a face that its case shows.
_SHOWN = ("points ", "pixel", "undefined", "Sq,", "rms slope ", "Std", "shortest wave above")


@dataclass(frozen=True)
class _Look:
    """What is known of a face, and the `reasons` for which a run refuses it; None is not known."""

    report: SurfaceReport
    conditioning: Conditioning | None = None
    patch: tuple[Representative | FormEffect, ...] = ()
    quick_estimate: str = ""
    reasons: tuple[str, ...] = ()


def survey(
    path: Path,
    picture: Path | None,
    *,
    spikes: float,
    detrend: int | None,
    shortest_wave: str | None,
    max_undefined: float,
    channel: str = "0",
    **reading: Any,
) -> list[str]:
    """Lines on the face in a file; `picture` also writes its picture.

    path, channel, reading : as `read_topography` takes them, lengths as text with their unit.
    picture : file to write, .png, .pdf or .svg.
    spikes, detrend, shortest_wave, max_undefined : keys of the table [surface] of a case.

    Raises InputError: an argument cannot be used, or a file without heights; no picture is written.
    """
    if picture is not None and (
        picture.suffix.lower() not in _PICTURES or not picture.absolute().parent.is_dir()
    ):
        allowed = f"a file {', '.join(_PICTURES)} in a folder that exists"
        raise InputError("output", f"'{picture}'", allowed)
    reading = _in_metres(**reading)
    wave = _in_metres(shortest_wave=shortest_wave)["shortest_wave"]
    treatment = {"detrend": detrend, "spikes": spikes, "max_undefined": max_undefined}
    with with_keys(SURFACE_OPTIONS):
        validate.number("max_undefined", max_undefined, inclusive=True)
        number = int(channel) if channel.isdecimal() else channel
        seen = read_for_a_look(path, channel=number, **reading)
        face = seen.topography
        found = look(face, wave, treatment, seen.instrument)
    reasons = [*map(str, seen.doubts), *found.reasons]
    texts = [f"a run refuses this face: {reason}" for reason in reasons]
    if seen.masked_fraction:
        masked = as_text(seen.masked_fraction, percent=True)
        texts.append(
            f"{masked} of the points in the file are masked in it: --no-file-mask takes their heights"
        )
    texts += seen.notes
    if is_text(path) and not any("x y z" in note for note in seen.notes):
        texts.append(_ORIENTATION)
    if found.conditioning is not None:
        texts += notes(found.report, found.conditioning)
        texts += [text for one in found.patch for text in _warnings_of(one) or [str(one)]]
        texts += [found.quick_estimate] if found.quick_estimate else []
    lines = [str(path), *_indented(found.report)]
    if found.conditioning is not None:
        lines += ["what a run does to it", *_indented(found.conditioning)]
    lines += [f"note: {text}" for text in texts]
    if picture is not None:
        figure = survey_figure(
            face, found.report, found.conditioning, detrend=detrend, spikes=spikes
        )
        figure.suptitle(path.name, fontsize=11, parse_math=False)
        with writing("output", picture):
            figure.savefig(picture)
        lines.append(f"picture in {picture}")
    return lines


def _in_metres(**said: Any) -> dict[str, Any]:
    """What is said of a face, with its lengths in m where they are text, one or several."""
    found = dict(said)
    for name in _LENGTHS & said.keys():
        given, option = said[name], f"--{name.replace('_', '-')}"
        if isinstance(given, str):
            found[name] = to_si(given, "m", option)
        elif given is not None:
            found[name] = tuple(to_si(one, "m", option) for one in given)
    return found


def look(
    face: Topography, wave: float | None, treatment: dict[str, Any], instrument: Instrument
) -> _Look:
    """Describe and condition the face."""
    reasons: list[str] = []
    try:
        report = describe_surface(face, **treatment)
    except TooManyUndefined as error:
        reasons.append(f"{error.given}, expected {error.expected}")
        report = describe_surface(face, **treatment | {"max_undefined": 1.0})
    try:
        with with_keys(SURFACE_OPTIONS):
            flat, repaired = repair(face, **treatment)
            shape = default_grid(flat, wave, instrument)
            kept, conditioning = smooth(
                flat,
                repaired.form,
                [(flat, repaired)],
                shortest_wave=wave,
                shape=shape,
                instrument=instrument,
            )
    except InputError as error:
        # the caller's wave, not the face
        if wave is not None and not isinstance(error.__cause__, TooManyUndefined):
            raise
        return _Look(report, reasons=(*(reasons or [str(error)]),))
    found = _Look(report, conditioning, reasons=tuple(reasons))
    if not kept.rms_slope:
        return found
    curved = flat.with_heights(flat.heights + repaired.form.heights).detrend(None)
    curved = curved.low_pass(conditioning.shortest_wave)
    # leakage does not depend on E* itself
    hardness = _HARDNESS * curved.rms_slope
    pressures = [part * hardness for part in _PRESSURES]
    form = solve_form_effect(curved, 1.0, PerfectlyPlastic(hardness), pressures, loads=_LOADS)
    estimate = estimate_surface(curved, 1.0, hardness, pressures)
    return replace(
        found,
        patch=(representative(kept), form),
        quick_estimate=f"quick estimate at {_LOADS}: {estimate}",
    )


def _warnings_of(patch: Representative | FormEffect) -> list[str]:
    return patch.warnings if isinstance(patch, FormEffect) else patch.doubts


def _indented(report: object) -> list[str]:
    return indent(str(report), "  ").splitlines()


def notes(report: SurfaceReport, conditioning: Conditioning) -> list[str]:
    """Advice that follows from the numbers."""
    notes = conditioning.spike_doubts
    if report.shortest_wave > conditioning.shortest_wave * (1 + 1e-9):
        wave = to_text(report.shortest_wave, "m", 3)
        notes.append(
            f"waves below {wave} are noise or beyond the instrument: shortest_wave = '{wave}' removes them"
        )
    if conditioning.unseen:
        notes.append(conditioning.unseen)
    if not isnan(report.lay_direction) and abs(report.lay_direction) > pi / 4:
        angle = degrees(abs(report.lay_direction))
        notes.append(
            f"the lay runs {angle:.0f}° off x2, nearer to x1: transpose exchanges the axes"
        )
    return notes


def case_of_face(
    path: Path,
    folder: Path,
    *,
    spacing: tuple[str, str] | None = None,
    height_unit: str | None = None,
) -> str:
    """Text of a case of a measured face, for a file in a folder; its last tables hold values of the template.

    spacing, height_unit : pixel, with its unit, and unit of the heights, where the file does not say them.

    Raises InputError: no face can be read from the file; neither it nor the caller says its pixel or its unit.
    """
    seen = read_for_a_look(path, height_unit=height_unit, **_in_metres(spacing=spacing))
    _ask_for_scale(path, seen)
    given = SurfaceTable().model_dump(include={"detrend", "spikes", "max_undefined"})
    face, found = seen.topography, look(seen.topography, None, given, seen.instrument)
    sides = [to_text(side, "m", 6) for side in face.size]
    name = os.path.relpath(path, folder).replace(os.sep, "/")
    known = {"path": name, "spacing": spacing, "height_unit": height_unit}
    lines = [
        f"# A case of {path.name}. x1 is the direction of the leakage, x2 runs along the seal.",
        "# A question mark asks for what the file does not say; `femseal check` says what a run computes.",
        "",
        f"title = {as_toml(path.stem)}",
        "",
        "[face]",
        *(f"{key} = {as_toml(value)}" for key, value in known.items() if value is not None),
        *(f"# {note}" for note in seen.notes),
        *([f"# {_ORIENTATION}"] if is_text(path) else []),
        f"# size = {as_toml(sides)}  # as the file says: ? is that the field of the instrument",
    ]
    questions, surface = [*map(str, seen.doubts), *found.reasons], []
    described = str(found.report).splitlines()
    lines += [f"#   {line}" for line in described if line.startswith(_SHOWN)]
    if found.conditioning is not None:
        texts = notes(found.report, found.conditioning)
        questions += [text for text in texts if "shortest_wave" not in text]
        questions += [text for one in found.patch for text in _warnings_of(one)]
        measured, kept = found.report.shortest_wave, found.conditioning.shortest_wave
        wave = to_text(max(measured, kept), "m", 3)
        why = "the shortest one above noise, of 8 pixels or more"
        surface = ["", "[surface]", f'shortest_wave = "{wave}"  # {why}']
    lines += [f"# ? {question}" for question in questions] + surface
    for table, question in _OPEN.items():
        lines += ["", f"# ? {question}", *table_to_paste(Case, table).splitlines()]
    return "\n".join(lines) + "\n"


def _ask_for_scale(path: Path, seen: Look) -> None:
    """Raise InputError where nothing says the pixel of a map, or the unit of its heights; arrays of NumPy are in m."""
    has_pixel, has_unit = seen.said
    missing = {} if has_pixel else {"pixel size": "--spacing '1 um' '1 um'"}
    if not has_unit and path.suffix.lower() not in (".npy", ".npz"):
        missing["unit of heights"] = "--height-unit um"
    if missing:
        asked = f"{' and '.join(missing.values())}, as measured"
        raise InputError(str(path), f"no {' and no '.join(missing)}", asked)

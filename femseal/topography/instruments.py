"""Files of instruments, read by SurfaceTopography: dozens of formats, their channels, units and masks.

A unit that the library does not know is that of the caller. Channels that are no heights by their unit are read if the
caller gives one, and so are fields of Gwyddion (.gwy) without units, which the library leaves out.
"""

import io
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..base import Array, InputError, counted, shortened, to_si
from .conditioning import Instrument
from .coordinates import profile_error
from .raw import Raw, Reading, length_unit

#: Longest list of channels in a message, in characters.
_LONGEST_LIST = 300
#: Where the units of a .sur file begin, of 16 bytes each.
_SURF_UNITS = range(180, 276, 16)
#: What makes a map of numbers without a unit of length.
_GIVE_UNITS = (
    "if its numbers are heights, their unit in height_unit= such as 'um' (--height-unit), which comes before that of "
    "the file, and spacing= or size= (--spacing, --size) where the file does not say the pixel"
)


def read_instrument(path: Path, said: Reading, others: Sequence[str] = ()) -> Raw:
    """A map of an instrument's file, through SurfaceTopography (an extra, slow to import).

    others : suffixes that are read without it, for a message.
    """
    suffix = path.suffix.lower()
    try:
        from SurfaceTopography import open_topography
        from SurfaceTopography.IO import readers
    except ImportError:
        allowed = f"{' '.join(sorted(others))}, or many formats of instruments after: pip install 'femseal[surface]'"
        raise InputError("file", f"a file of kind {suffix or 'unknown'!r}", allowed) from None
    # Dozens of readers behind one call raise whatever their formats lead them to: all of it means a bad file.
    try:
        with unprinted():
            content, unclear = _digital_surf(path)
            file = open_topography(content or str(path))
            channels = list(file.channels)
    except Exception as error:
        ends = {f".{end}" for reader in readers for end in reader.file_extensions()}
        allowed = (
            "a file of one of the formats known to SurfaceTopography, not a damaged one: "
            f"{' '.join(sorted({*others, *ends}))}; programs of instruments export .x3p too"
        )
        given = f"a file without a known format ({type(error).__name__})"
        raise InputError("file", given, allowed) from error
    if not channels:
        if _gwyddion_fields(file):
            return _read_gwyddion_field(path, file, said)
        given = "no map of heights: no channel of the file has a unit of length"
        raise InputError("file", given, "a file with a map, or its export as .x3p or text")
    names = [channel.name or "" for channel in channels]
    channel = pick(channels, said.channel, "channel", names)
    if channel.dim == 1:
        raise profile_error(np.zeros(channel.nb_grid_pts or 0), f"channel {said.channel}")
    if channel.dim != 2 or not (channel.is_height_channel or said.height_unit):
        usable = [i for i, c in enumerate(channels) if c.dim == 2 and c.is_height_channel]
        maps = _listed(usable, names) or f"none in this file; {_GIVE_UNITS}"
        unit = f" in {channel.data_unit!r}" if getattr(channel, "data_unit", None) else ""
        given = f"channel={said.channel} ({channel.name}), which is no map of heights{unit}"
        raise InputError("file", given, f"a map of heights: {maps}")
    raw = _read_channel(channel, suffix)
    if unclear:
        return replace(raw, height_unit=None, spacing=None, unclear=unclear)
    return raw


def _read_channel(channel: Any, suffix: str) -> Raw:
    """A channel that SurfaceTopography has found."""
    # SurfaceTopography wants what the file lacks; placeholders keep the numbers as they are.
    missing: dict[str, Any] = {}
    if channel.physical_sizes is None:
        missing["physical_sizes"] = tuple(float(n) for n in channel.nb_grid_pts)
    with unprinted():
        topography = channel.topography(**missing)
        heights, mask = topography.heights(), None
        if suffix == ".gwy" and np.ma.is_masked(heights):
            # the library scales the points that are not masked, and keeps the numbers of the file for the others
            stored = np.ma.getdata(topography.parent_topography.heights())
            heights, mask = stored * topography.height_scale_factor, np.ma.getmaskarray(heights)
    heights = np.ma.filled(np.ma.masked_invalid(heights).astype(float), np.nan)
    lateral = None if topography.unit is None else length_unit(topography.unit)
    unit, unclear, notes = lateral, "", []
    if not channel.is_height_channel:
        unit, unclear = None, f"unit {channel.data_unit!r} of the channel {channel.name!r}"
    elif topography.unit is not None and unit is None:
        unclear = f"unit {topography.unit!r}"
    elif topography.unit is not None and not _is_usual(topography.unit):
        notes.append(
            f"the unit {topography.unit!r} of the file is read as {1e6 * (unit or 0):g} µm"
        )
    spacing = None
    if lateral is not None and not missing:
        first, second = topography.pixel_size
        spacing = float(first) * lateral, float(second) * lateral
    return Raw(
        heights,
        unit,
        spacing,
        needs_unit=True,
        mask=mask,
        instrument=_instrument(topography.info.get("instrument", {}).get("parameters", {})),
        unclear=unclear,
        notes=tuple(notes),
    )


def _digital_surf(path: Path) -> tuple[io.BytesIO | None, str]:
    """Content of a .sur file whose units the library would not read, with others in their place, and what is unclear.

    Micrometres in UTF-8 are written as the format has them. In place of any unknown unit all are metres, which keeps
    the numbers as they are. None of a file that the library reads as it is.
    """
    with path.open("rb") as file:
        head = bytearray(file.read(_SURF_UNITS.stop))
        if not head.startswith(b"DIGITAL SURF"):
            return None, ""
        texts = [bytes(head[n : n + 16]) for n in _SURF_UNITS]
        units = [text.decode("latin-1").strip(" \0") for text in texts]
        unknown = [unit for unit in units if unit and length_unit(unit) is None]
        as_written = [b"m" if unknown else text.replace("µ".encode(), b"\xb5") for text in texts]
        if as_written == texts:
            return None, ""
        for n, text in zip(_SURF_UNITS, as_written, strict=True):
            head[n : n + 16] = text.ljust(16)
        content = io.BytesIO(bytes(head) + file.read())
    return content, f"unit {unknown[0]!r}" if unknown else ""


def _is_usual(unit: str) -> bool:
    """Whether a unit is written as it should be."""
    try:
        to_si(f"1 {unit}", "m")
    except InputError:
        return False
    return True


def _gwyddion_fields(file: Any, kind: str = "data") -> dict[int, dict[str, Any]]:
    """Fields of a .gwy by their number, of which the library has read all but the numbers; none of another file.

    kind : "data", or "mask" for the masks that lie on them.
    """
    found = {}
    for key, value in getattr(file, "_metadata", {}).items():
        if (match := re.fullmatch(rf"/(\d+)/{kind}", str(key))) and "GwyDataField" in value:
            found[int(match[1])] = value["GwyDataField"]
    return found


def _read_gwyddion_field(path: Path, file: Any, said: Reading) -> Raw:
    """A field of Gwyddion whose unit is no length: numbers whose unit the caller gives.

    Raises InputError: the caller gives none.
    """
    fields, masks = _gwyddion_fields(file), _gwyddion_fields(file, "mask")
    number = pick([*fields], said.channel, "field")
    field = fields[number]
    units = [
        field.get(name, {}).get("GwySIUnit", {}).get("unitstr") or "none"
        for name in ("si_unit_z", "si_unit_xy")
    ]
    if said.height_unit is None:
        given = f"{counted(len(fields), 'field')} whose unit is no length ({units[0]})"
        raise InputError("file", given, f"a map of heights; {_GIVE_UNITS}")
    lateral, spacing = length_unit(units[1]), None
    if lateral is not None:
        spacing = (
            abs(field["xreal"]) / field["xres"] * lateral,
            abs(field["yreal"]) / field["yres"] * lateral,
        )
    return Raw(
        _numbers_of_field(path, field),
        spacing=spacing,
        needs_unit=True,
        mask=_numbers_of_field(path, masks[number]) > 0.5 if number in masks else None,
        unclear=f"unit {units[0]} of the numbers, {units[1]} of the sides",
    )


def _numbers_of_field(path: Path, field: dict[str, Any]) -> Array:
    """Numbers (n1, n2) of a field of Gwyddion, which follow their count, of four bytes."""
    n1, n2 = int(field["xres"]), int(field["yres"])
    numbers = np.fromfile(path, "<f8", n1 * n2, offset=field["data"]["offset"] + 4)
    return numbers.reshape(n2, n1).T


def _instrument(parameters: dict[str, Any]) -> Instrument:
    """The instrument by what SurfaceTopography found of it: values with their unit."""
    known = {}
    for name in ("tip_radius", "resolution"):
        found = parameters.get(name, {})
        if found.get("value", 0) > 0 and found.get("unit"):
            known[name] = found["value"] * to_si(f"1 {found['unit']}", "m", name)
    return Instrument(**known)


@contextmanager
def unprinted() -> Iterator[None]:
    """Context in which Python prints nothing: readers print what they find in damaged files."""
    with (
        open(os.devnull, "w", encoding="utf-8") as nothing,
        redirect_stdout(nothing),
        redirect_stderr(nothing),
    ):
        yield


def pick(choices: list[Any], channel: int | str, kind: str, names: Sequence[str] = ()) -> Any:
    """The channel of a number, or of a name that only one of them has."""
    if isinstance(channel, str) and names.count(channel) == 1:
        return choices[names.index(channel)]
    if channel not in range(len(choices)):
        listed = f": {_listed(range(len(names)), names)}" if any(names) else ""
        last = len(choices) - 1
        allowed = f"0 to {last}, it has {counted(last + 1, kind)}{listed}"
        if last == 0:
            allowed = f"0, the only {kind} of the file{listed}"
        raise InputError("file", f"channel={channel!r}", allowed)
    return choices[int(channel)]


def _listed(numbers: Sequence[int], names: Sequence[str]) -> str:
    """Numbers of channels with their names."""
    return shortened(", ".join(f"{n} ({names[n]})" for n in numbers), _LONGEST_LIST)

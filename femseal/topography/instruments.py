"""Read files of instruments with SurfaceTopography, which knows dozens of formats with their channels, units and masks.

If a file does not state its unit, the caller must give the unit. A channel whose unit is not a length is read if
SurfaceTopography lists it and the caller gives a unit of height.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from ..base import Array, Flags, InputError, counted, shortened, to_si
from .coordinates import profile_error
from .instrument_limits import Instrument
from .raw import Raw, Reading, length_unit

#: Longest list of channels in a message [characters].
_LONGEST_LIST = 300
#: Longest message of SurfaceTopography that is quoted [characters].
_LONGEST_REASON = 100
#: Advice for a map of numbers without a unit of length.
_GIVE_UNITS = (
    "if its numbers are heights, give their unit in height_unit= such as 'um' (--height-unit), which overrides that of "
    "the file, and spacing= or size= (--spacing, --size) if the file does not say the pixel size"
)


def read_instrument(path: Path, options: Reading, other_suffixes: Sequence[str] = ()) -> Raw:
    """Read a map from the file of an instrument with SurfaceTopography, an optional package.

    other_suffixes : suffixes of files that femseal reads without SurfaceTopography, for an error message.
    """
    suffix = path.suffix.lower()
    channels = _open_channels(path, suffix, other_suffixes)
    if not channels:
        given = "no map of heights: no channel of the file has a unit of length"
        expected = (
            "a file with a map; in the program that wrote the file, set the units of the heights and of the "
            "lateral dimensions, or export the map as .x3p or text"
        )
        raise InputError("file", given, expected)
    return _read_channel(_select_channel(channels, options), suffix)


def _open_channels(path: Path, suffix: str, other_suffixes: Sequence[str]) -> list[Any]:
    """Open a file with SurfaceTopography, and return its channels, without reading their heights."""
    try:
        from SurfaceTopography import open_topography
        from SurfaceTopography.IO import readers
    except ImportError:
        expected = (
            f"{' '.join(sorted(other_suffixes))}, or many formats of instruments after: "
            "pip install 'femseal[surface]'"
        )
        raise InputError("file", f"a file of kind {suffix or 'unknown'!r}", expected) from None
    # The library tries dozens of readers, which raise errors of any kind. Each error means that the reader cannot read
    # the file.
    try:
        with unprinted():
            return list(open_topography(str(path)).channels)
    except Exception as error:
        known_suffixes = {f".{end}" for reader in readers for end in reader.file_extensions()}
        expected = (
            "a file of one of the formats known to SurfaceTopography, not a damaged one: "
            f"{' '.join(sorted({*other_suffixes, *known_suffixes}))}; programs of instruments export "
            ".x3p too"
        )
        reason = shortened(f"{type(error).__name__}: {error}", _LONGEST_REASON)
        raise InputError("file", f"a file that cannot be read ({reason})", expected) from error


def _select_channel(channels: list[Any], options: Reading) -> Any:
    """Return the channel that the caller has selected; raise InputError if it is not a map of heights."""
    names = [channel.name or "" for channel in channels]
    channel = pick(channels, options.channel, "channel", names)
    if channel.dim == 1:
        raise profile_error(np.zeros(channel.nb_grid_pts or 0), f"channel {options.channel}")
    has_heights = channel.is_height_channel or options.height_unit
    if channel.dim == 2 and has_heights:
        return channel
    usable = [i for i, c in enumerate(channels) if c.dim == 2 and c.is_height_channel]
    maps = _list_channels(usable, names) or f"none in this file; {_GIVE_UNITS}"
    unit = f" but is in {channel.data_unit!r}" if getattr(channel, "data_unit", None) else ""
    given = f"channel={options.channel} ({channel.name}), which is not a map of heights{unit}"
    raise InputError("file", given, f"a map of heights: {maps}")


def _read_channel(channel: Any, suffix: str) -> Raw:
    """Read the heights of a channel, with their unit, pixel size, mask and instrument."""
    # SurfaceTopography needs the sides of the map. If they are not in the file, the numbers of points are passed
    # instead, and the pixel size below stays unknown.
    placeholders: dict[str, Any] = {}
    if channel.physical_sizes is None:
        placeholders["physical_sizes"] = tuple(float(n) for n in channel.nb_grid_pts)
    with unprinted():
        topography = channel.topography(**placeholders)
        heights, mask = _heights_and_mask(topography, suffix)
    lateral_unit = None if topography.unit is None else length_unit(topography.unit)
    height_unit = lateral_unit
    unclear = ""
    notes = []
    if not channel.is_height_channel:
        height_unit = None
        unclear = f"unit {channel.data_unit!r} of the channel {channel.name!r}"
    elif topography.unit is not None and lateral_unit is None:
        unclear = f"unit {topography.unit!r}"
    elif lateral_unit is not None and not _is_usual(topography.unit):
        micrometres = 1e6 * lateral_unit
        notes.append(f"the unit {topography.unit!r} of the file is read as {micrometres:g} µm")
    spacing = None
    if lateral_unit is not None and not placeholders:
        first, second = topography.pixel_size
        spacing = float(first) * lateral_unit, float(second) * lateral_unit
    return Raw(
        heights,
        height_unit,
        spacing,
        needs_unit=True,
        mask=mask,
        instrument=_instrument(topography.info.get("instrument", {}).get("parameters", {})),
        unclear=unclear,
        notes=tuple(notes),
    )


def _heights_and_mask(topography: Any, suffix: str) -> tuple[Array, Flags | None]:
    """Return the heights, (n1, n2), in the unit of the file, and the mask of the file; None without a mask.

    topography : map of SurfaceTopography.
    suffix : suffix of the file.
    """
    heights, mask = topography.heights(), None
    if suffix == ".gwy" and np.ma.is_masked(heights):
        # SurfaceTopography converts only points that are not masked; masked points have the unconverted numbers of the
        # file.
        mask = np.ma.getmaskarray(heights)
        stored = np.ma.getdata(topography.parent_topography.heights())
        heights = stored * topography.height_scale_factor
    return np.ma.filled(np.ma.masked_invalid(heights).astype(float), np.nan), mask


def _is_usual(unit: str) -> bool:
    """Return whether a unit is spelled correctly."""
    try:
        to_si(f"1 {unit}", "m")
    except InputError:
        return False
    return True


def _instrument(parameters: dict[str, Any]) -> Instrument:
    """Return the limits of the instrument from the parameters (values with units) read by SurfaceTopography."""
    lengths = {}
    for name in ("tip_radius", "resolution"):
        entry = parameters.get(name, {})
        if entry.get("value", 0) > 0 and entry.get("unit"):
            lengths[name] = entry["value"] * to_si(f"1 {entry['unit']}", "m", name)
    return Instrument(**lengths)


@contextmanager
def unprinted() -> Iterator[None]:
    """Suppress everything that Python prints inside a `with` block, because some readers print warnings."""
    with (
        open(os.devnull, "w", encoding="utf-8") as nothing,
        redirect_stdout(nothing),
        redirect_stderr(nothing),
    ):
        yield


def pick(choices: list[Any], channel: int | str, kind: str, names: Sequence[str] = ()) -> Any:
    """Select a channel by its number, or by a name that is unique among the channels.

    Parameters
    ----------
    choices : list
        All channels of the file.
    channel : int or str
        Number (from 0) or name of the channel.
    kind : str
        Word that the file format uses for a channel, such as "layer", for the message.
    names : sequence of str
        Names of the channels.

    Raises
    ------
    InputError
        The file has no channel with this number or name.
    """
    if isinstance(channel, str) and names.count(channel) == 1:
        return choices[names.index(channel)]
    if channel in range(len(choices)):
        return choices[int(channel)]
    listed = f": {_list_channels(range(len(names)), names)}" if any(names) else ""
    last = len(choices) - 1
    if last == 0:
        expected = f"0, the only {kind} of the file{listed}"
    else:
        expected = f"0 to {last}, it has {counted(last + 1, kind)}{listed}"
    raise InputError("file", f"channel={channel!r}", expected)


def _list_channels(numbers: Sequence[int], names: Sequence[str]) -> str:
    """List the channels by number and name, for a message."""
    return shortened(", ".join(f"{n} ({names[n]})" for n in numbers), _LONGEST_LIST)

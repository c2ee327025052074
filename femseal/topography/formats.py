"""File formats of height maps: each reader turns a file into the same raw record.

Orientation: the file's x is axis 0, its y axis 1. In a text x runs along a line. Arrays of NumPy are taken as they are.
Sources: ISO 25178-71 (.sdf), ISO 25178-72 (.x3p), the text export of Gwyddion.
"""

import os
import re
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from ..base import (
    Flags,
    InputError,
    Lengths,
    Pair,
    Periodic,
    counted,
    free_memory,
    shortened,
    to_si,
)
from ..base.machine import within_free_memory
from .conditioning import UNKNOWN, Instrument

_HEADER = re.compile(r"^\W*(width|height|value units)\s*[:=]\s*(.+?)\s*$", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
#: Suffixes of matrices as text.
TEXT = (".csv", ".asc", ".txt")
#: Memory that reading takes about, in sizes of the file: of numbers that take as many bytes as they have.
_MEMORY_FACTOR = 3
#: Longest list of channels in a message, in characters.
_LONGEST_LIST = 300
#: Kinds of arrays of numbers.
_NUMBERS = "bfiu"
#: Words that instruments write for an undefined point, beside nan.
_UNDEFINED = {"", "bad", "-", "--", "***"}


@dataclass(frozen=True, eq=False)
class Raw:
    """What a file holds: heights (n1, n2) as numbers, metres per number, pixel [m], masked points; None = not said.

    instrument : what the file says of it.
    """

    heights: NDArray
    height_unit: float | None = None
    spacing: Pair | None = None
    mask: Flags | None = None
    instrument: Instrument = UNKNOWN


@dataclass(frozen=True)
class Reading:
    """What the caller says about a file of heights, see `read_topography`."""

    size: Lengths | None = None
    spacing: Lengths | None = None
    height_unit: str | None = None
    delimiter: str | None = None
    array: str | None = None
    channel: int | str = 0
    transpose: bool = False
    mask: str | os.PathLike[str] | None = None
    file_mask: bool = True
    crop: tuple[float, float, float, float] | None = None
    periodic: Periodic = (False, False)
    tip_radius: float | None = None
    resolution: float | None = None


def bad_file(path: Path, given: object, allowed: str) -> InputError:
    """InputError about the content of a file."""
    return InputError(str(path), " ".join(str(given).split())[:200], allowed)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Context in which a file is read: whatever is found in its bytes, an InputError about it names the file.

    One that cannot be read in the free memory is refused: by its size, or when it unpacks to more.
    """
    length, free = path.stat().st_size, free_memory()
    if _MEMORY_FACTOR * length > free:
        allowed = f"one that can be read in the {free / 1e9:.3g} GB of free memory"
        raise bad_file(path, f"a file of {length / 1e9:.3g} GB", allowed)
    try:
        with within_free_memory():
            yield
    except InputError as error:
        raise bad_file(path, error.given, error.expected) from error
    except OSError as error:
        raise bad_file(path, error.strerror or error, "a file that can be read") from None
    except MemoryError:
        raise bad_file(path, "more points than fit into memory", "a smaller file") from None
    except Exception as error:  # a damaged head makes libraries raise errors of any kind
        allowed = f"an intact {path.suffix.lower()} file"
        raise bad_file(path, f"a damaged one ({type(error).__name__}: {error})", allowed) from error


def read_npy(path: Path, said: Reading) -> Raw:
    """A .npy array of heights."""
    return Raw(_numbers(np.load(path, allow_pickle=False)))


def read_npz(path: Path, said: Reading) -> Raw:
    """A .npz archive: the heights under `array`, or its only map; `spacing` [m] and `mask` if they are there.

    Points where `mask` is not 0 are masked.
    """
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        stored = dict(archive)
    spacing = stored.pop("spacing", None)
    mask = stored.pop("mask", None) if said.array != "mask" else None
    every = ", ".join(sorted(stored)) or "none"
    maps = [name for name, found in stored.items() if found.ndim == 2 or len(stored) == 1]
    names = [name for name in maps if name == said.array] if said.array else maps
    if len(names) != 1:
        given = f"array={said.array!r} of the arrays {every}"
        raise InputError("file", given, "one map, or array= the name of one")
    heights = _numbers(stored[names[0]])
    if mask is not None and (mask.shape != heights.shape or mask.dtype.kind not in _NUMBERS):
        allowed = f"numbers of the shape of the heights, {heights.shape}"
        raise InputError("file", f"an array mask of {mask.dtype} of shape {mask.shape}", allowed)
    if spacing is not None:
        if spacing.shape != (2,) or spacing.dtype.kind not in _NUMBERS:
            raise InputError("file", f"a spacing of shape {spacing.shape}", "two numbers > 0 [m]")
        spacing = float(spacing[0]), float(spacing[1])
    return Raw(heights, spacing=spacing, mask=None if mask is None else mask != 0)


def read_text(path: Path, said: Reading) -> Raw:
    """A matrix of heights as text, one line for each y, or triplets x, y, z of a regular grid.

    Lines beginning with # are comments; "# Width: 1 mm" (x, along a line), "# Height: 2 mm" (y, down the lines) and
    "# Value units: nm" among them are honoured. Decimal commas are read where commas are nothing else.
    """
    header: dict[str, str] = {}
    try:
        with path.open(encoding="utf-8-sig") as file:
            z = _matrix(_rows(file, header), said.delimiter)
    except UnicodeDecodeError:
        allowed = "a matrix of numbers as text"
        raise InputError("file", "bytes that are not UTF-8 text", allowed) from None
    try:
        known = {name: to_si(text, "m", name) for name, text in header.items()}
    except InputError as error:
        allowed = "lengths such as '# Width: 1 mm'"
        raise InputError("file", f"a header with {error}", allowed) from None
    unit, width, height = map(known.get, ("value units", "width", "height"))
    if width and height:
        return Raw(z.T, unit, (width / z.shape[1], height / z.shape[0]))
    if grid := _triplets(z):
        return Raw(grid[0], unit, grid[1])
    return Raw(z.T, unit)


def _rows(file: TextIO, header: dict[str, str]) -> Iterator[tuple[int, str]]:
    """Lines with numbers, with their number in the file; lengths of a header go into it."""
    for at, line in enumerate(file, start=1):
        text = line.strip(" \r\n")
        if not text.lstrip().startswith("#"):
            if text.strip():
                yield at, text
        elif match := _HEADER.match(text):
            name = match[1].lower()
            # the library of units takes a decimal comma for nothing
            header[name] = ("1 " if name == "value units" else "") + match[2].replace(",", ".")


def _triplets(z: NDArray) -> tuple[NDArray, Pair] | None:
    """Heights and pixel of lines x, y, z that name every point of a regular grid once; None for another matrix."""
    if z.shape[1] != 3 or len(z) < 9 or np.isnan(z[:, :2]).any():
        return None
    (x, i), (y, j) = (np.unique(z[:, axis], return_inverse=True) for axis in (0, 1))
    steps = [np.diff(values) for values in (x, y)]
    if not all(step.size and np.allclose(step, step.mean(), rtol=1e-3, atol=0) for step in steps):
        return None
    if not x.size * y.size == len(z) == np.unique(i * y.size + j).size:
        return None
    heights = np.empty((x.size, y.size))
    heights[i, j] = z[:, 2]
    return heights, (float(steps[0].mean()), float(steps[1].mean()))


def _matrix(lines: Iterator[tuple[int, str]], delimiter: str | None) -> NDArray:
    """Heights of a text in lines of numbers, with a decimal comma where its delimiter allows one."""
    begin, first = next(lines, (0, ""))
    if not first:
        raise InputError("file", "no line with numbers", "a matrix of heights, one line per row")
    mark = _delimiter(first) if delimiter is None else delimiter
    has_comma = mark != "," and "." not in first
    ends = mark is not None
    numbers, width = array("d"), 0
    for at, text in chain([(begin, first)], lines):
        fields = (text.replace(",", ".") if has_comma else text).split(mark)
        ends = ends and len(fields) > 1 and not fields[-1].strip()
        try:
            row = [float(field) for field in fields]
        except ValueError:
            row = [_value(at, *both) for both in zip(fields, text.split(mark), strict=True)]
        width = width or len(row)
        if len(row) != width:
            given = f"{counted(len(row), 'number')} in line {at} after {width} in line {begin}"
            raise InputError("file", given, "lines of equal length: check the delimiter")
        numbers.extend(row)
    z = np.frombuffer(numbers).reshape(-1, width)
    # a delimiter behind the last number of every line ends the line; it does not begin an undefined point
    return z[:, :-1] if ends else z


def _delimiter(line: str) -> str | None:
    """What stands between the numbers of a line: ; tab , or None, blanks."""
    found = next((mark for mark in (";", "\t", ",") if mark in line), None)
    numbers = line.split()
    if found == "," and len(numbers) > 1 and all(map(_DECIMAL_COMMA.fullmatch, numbers)):
        return None
    return found


def _value(line: int, text: str, shown: str) -> float:
    """The number of a text; InputError that shows it as it is in the file."""
    try:
        return float(text)
    except ValueError:
        if text.strip().lower() in _UNDEFINED:
            return np.nan
        allowed = (
            "numbers with a decimal point, nan or nothing where undefined; put # before the lines of a header, and "
            "what it says into spacing= or size= and height_unit= (--spacing, --size, --height-unit)"
        )
        raise InputError("file", f"{shown.strip()[:30]!r} in line {line}", allowed) from None


def read_x3p(path: Path, said: Reading) -> Raw:
    """A surface of ISO 25178-72, one layer of it; the format knows metres only."""
    import x3pio

    file = x3pio.read(path)
    if not (isinstance(file, x3pio.Surface) and file.is_regular_grid):
        given = f"a {type(file).__name__} on no regular grid"
        raise InputError("file", given, "a surface on a regular grid")
    layer = _pick(list(file.layers), said.channel, "layers")
    return Raw(layer.z.T, 1.0, (file.header.x.increment, file.header.y.increment))


def read_sdf(path: Path, said: Reading) -> Raw:
    """A surface of ISO 25178-71; the format knows metres only."""
    import sdfio

    _pick([path], said.channel, "layers")
    file = sdfio.read(path)
    return Raw(file.data.T, 1.0, (file.header.x_scale, file.header.y_scale))


def read_instrument(path: Path, said: Reading) -> Raw:
    """Any other format, through SurfaceTopography (an extra, slow to import)."""
    suffix = path.suffix.lower()
    try:
        from SurfaceTopography import open_topography
        from SurfaceTopography.IO import readers
    except ImportError:
        allowed = f"{' '.join(sorted(READERS))}, or many formats of instruments after: pip install 'femseal[surface]'"
        raise InputError("file", f"a file of kind {suffix or 'unknown'!r}", allowed) from None
    # Dozens of readers behind one call raise whatever their formats lead them to: all of it means a bad file.
    try:
        with unprinted():
            channels = list(open_topography(str(path)).channels)
    except Exception as error:
        ends = {f".{end}" for reader in readers for end in reader.file_extensions()}
        allowed = (
            "a file of one of the formats known to SurfaceTopography, not a damaged one: "
            f"{' '.join(sorted({*READERS, *ends}))}; programs of instruments export .x3p too"
        )
        given = f"a file without a known format ({type(error).__name__})"
        raise InputError("file", given, allowed) from error
    names = [c.name or "" for c in channels]
    channel = _pick(channels, said.channel, "channels", names)
    if channel.dim != 2 or not channel.is_height_channel:
        usable = [i for i, c in enumerate(channels) if c.dim == 2 and c.is_height_channel]
        maps = _listed(usable, names) or "none in this file"
        given = f"channel={said.channel} ({channel.name}), which is no map of heights"
        raise InputError("file", given, f"a map of heights: {maps}")
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
    unit = None if topography.unit is None else to_si(f"1 {topography.unit}", "m", "unit")
    instrument = _instrument(topography.info.get("instrument", {}).get("parameters", {}))
    if unit is None or missing:
        return Raw(heights, unit, mask=mask, instrument=instrument)
    first, second = (float(d) * unit for d in topography.pixel_size)
    return Raw(heights, unit, (first, second), mask, instrument)


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


def _pick(choices: list[Any], channel: int | str, kind: str, names: Sequence[str] = ()) -> Any:
    """The channel of a number, or of a name that only one of them has."""
    if isinstance(channel, str) and names.count(channel) == 1:
        return choices[names.index(channel)]
    if channel not in range(len(choices)):
        listed = f": {_listed(range(len(names)), names)}" if any(names) else ""
        allowed = f"0 to {len(choices) - 1}, it has {len(choices)} {kind}{listed}"
        raise InputError("file", f"channel={channel!r}", allowed)
    return choices[int(channel)]


def _listed(numbers: Sequence[int], names: Sequence[str]) -> str:
    """Numbers of channels with their names."""
    return shortened(", ".join(f"{n} ({names[n]})" for n in numbers), _LONGEST_LIST)


def _numbers(found: NDArray) -> NDArray:
    if found.dtype.kind not in _NUMBERS or found.ndim != 2 or not found.size:
        given = f"an array of {found.dtype} of shape {found.shape}"
        raise InputError("file", given, "a non-empty array of real numbers of shape (n1, n2)")
    with np.errstate(invalid="ignore"):  # bytes of numbers that are none, in single precision
        return found.astype(np.float64, copy=False)


READERS: dict[str, Callable[[Path, Reading], Raw]] = {
    ".npy": read_npy,
    ".npz": read_npz,
    **dict.fromkeys(TEXT, read_text),
    ".x3p": read_x3p,
    ".sdf": read_sdf,
}

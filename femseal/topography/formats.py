"""File formats of height maps: each reader turns a file into the same raw record.

Orientation: the file's x is axis 0, its y axis 1. In a text x runs along a line. Arrays of NumPy are taken as they are.
Sources: ISO 25178-71 (.sdf), ISO 25178-72 (.x3p), the Esri ASCII raster format, the text export of Gwyddion.
"""

import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.typing import NDArray

from ..base import InputError, counted, free_memory, shortened, to_si
from ..base.machine import within_free_memory

_ESRI_KEYS = {"ncols", "nrows", "xllcorner", "xllcenter", "yllcorner", "yllcenter", "cellsize", "dx", "dy",
              "nodata_value"}  # fmt: skip
_HEADER = re.compile(
    r"^\W*(width|height|value units|breite|höhe|werteeinheit(?:en)?|einheit der werte)\s*[:=]\s*(.+?)\s*$",
    re.IGNORECASE,
)
_ENGLISH = {"breite": "width", "höhe": "height", "werteeinheit": "value units", "werteeinheiten": "value units",
            "einheit der werte": "value units"}  # fmt: skip
_DECIMAL_COMMA = re.compile(r"^([-+]?\d*),(\d+(?:[eE][-+]?\d+)?)$")
#: Suffixes of matrices as text.
TEXT = (".csv", ".asc", ".txt")
#: Memory that reading takes at least, in sizes of the file unpacked. Measured: 6.5 to 27 for texts, 4.6 for numbers of
#: 8 bytes, more for shorter ones.
_TEXT_FACTOR, _NUMBERS_FACTOR = 6, 5
#: Channels that a message lists.
_MOST_LISTED = 12
#: Words that instruments write for an undefined point, beside nan.
_UNDEFINED = {"", "bad", "-", "--", "***"}


@dataclass(frozen=True, eq=False)
class Raw:
    """What a file holds: heights (n1, n2) as numbers, metres per number, pixel [m], masked points; None = not said."""

    heights: NDArray
    height_unit: float | None = None
    spacing: tuple[float, float] | None = None
    mask: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class Options:
    """What the caller says about the inside of the file; a channel by its number or its name."""

    delimiter: str | None = None
    array: str | None = None
    channel: int | str = 0


def bad_file(path: Path, given: object, allowed: str) -> InputError:
    """InputError about the content of a file."""
    return InputError(str(path), " ".join(str(given).split())[:200], allowed)


@contextmanager
def reading(path: Path, smaller: str) -> Iterator[None]:
    """Context in which a file is read: whatever a library makes of its bytes, they are refused by an InputError.

    One that cannot be read in the free memory is refused, by its size, or by what it unpacks to if it is a zip. Of
    others that unpack to more than the free memory a `smaller` one is asked for.
    """
    factor = _TEXT_FACTOR if path.suffix.lower() in TEXT else _NUMBERS_FACTOR
    length, verb = path.stat().st_size, "of"
    with suppress(OSError, ValueError, RuntimeError, BadZipFile), ZipFile(path) as archive:
        if (unpacked := sum(part.file_size for part in archive.infolist())) > length:
            length, verb = unpacked, "that unpacks to"
    if factor * length > (free := free_memory()):
        allowed = f"one that can be read in the {free / 1e9:.3g} GB of free memory"
        raise bad_file(path, f"a file {verb} {length / 1e9:.3g} GB", allowed)
    try:
        with within_free_memory():
            yield
    except InputError:
        raise
    except OSError as error:
        raise bad_file(path, error.strerror or error, "a file that can be read") from None
    except MemoryError:
        raise bad_file(path, "more points than fit into memory", smaller) from None
    except Exception as error:  # a damaged head makes libraries raise errors of any kind
        allowed = f"an intact {path.suffix.lower()} file"
        raise bad_file(path, f"a damaged one ({type(error).__name__}: {error})", allowed) from error


def read_npy(path: Path, options: Options) -> Raw:
    """A .npy array of heights."""
    try:
        array = np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise bad_file(path, _of_numpy(error), "an array of numbers saved by numpy.save") from None
    return Raw(_numbers(path, array))


def _of_numpy(error: Exception) -> object:
    """What was found in a file of numpy, without its advice on pickled objects."""
    return "no array of numbers" if "pickle" in str(error) else error


def read_npz(path: Path, options: Options) -> Raw:
    """A .npz archive: the heights under `array`, or its only map; `spacing` [m] and `mask` if they are there.

    Points where `mask` is not 0 are masked.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            stored = {name: archive[name] for name in archive.files}
    except (ValueError, EOFError, BadZipFile, TypeError, AttributeError) as error:
        raise bad_file(path, _of_numpy(error), "arrays of numbers saved by numpy.savez") from None
    spacing = stored.pop("spacing", None)
    mask = stored.pop("mask", None) if options.array != "mask" else None
    names = ", ".join(sorted(stored)) or "none"
    if options.array is None and len(stored) > 1:  # the only map among numbers and lists
        stored = {name: array for name, array in stored.items() if array.ndim == 2}
    if options.array is None and len(stored) != 1:
        raise bad_file(path, f"the arrays {names}", "one array, or array= the name of one of them")
    name = next(iter(stored)) if options.array is None else options.array
    if name not in stored:
        raise bad_file(path, f"array={name!r}", f"one of its arrays: {names}")
    heights = _numbers(path, stored[name])
    if mask is not None and (mask.shape != heights.shape or mask.dtype.kind not in "bfiu"):
        given = f"an array mask of {mask.dtype} of shape {mask.shape}"
        raise bad_file(path, given, f"numbers of the shape of the heights, {heights.shape}")
    mask = None if mask is None else mask != 0
    if spacing is None:
        return Raw(heights, mask=mask)
    if spacing.shape != (2,) or spacing.dtype.kind not in "fiu":
        raise bad_file(path, f"a spacing of shape {spacing.shape}", "two numbers > 0 [m]")
    return Raw(heights, spacing=(float(spacing[0]), float(spacing[1])), mask=mask)


def read_text(path: Path, options: Options) -> Raw:
    """A matrix of heights as text, one line for each y; an Esri ASCII raster; or triplets x, y, z of a regular grid.

    Lines beginning with # are comments; "# Width: 1 mm" (x, along a line), "# Height: 2 mm" (y, down the lines) and
    "# Value units: nm" among them are honoured, in German too. Decimal commas are read where commas are nothing else.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise bad_file(path, "bytes that are not UTF-8 text", "a matrix of numbers as text") from None
    header: dict[str, str] = {}
    rows: list[tuple[int, str]] = []
    for at, line in enumerate(lines, start=1):
        text = line.strip(" \r\n")
        if text.lstrip().startswith("#"):
            if match := _HEADER.match(text):
                # the library of units takes a decimal comma for nothing
                header[_ENGLISH.get(match[1].lower(), match[1].lower())] = match[2].replace(",", ".")
        elif text.strip():
            rows.append((at, text))
    if not rows:
        raise bad_file(path, "no line with numbers", "a matrix of heights, one line per row")
    if rows[0][1].split()[0].lower() in _ESRI_KEYS:
        return _esri(path, rows)
    z = _matrix(path, rows, options.delimiter)
    try:
        unit = to_si(f"1 {header['value units']}", "m", "value units") if "value units" in header else None
        sides = [to_si(header[side], "m", side) for side in ("width", "height") if side in header]
    except InputError as error:
        raise bad_file(path, f"a header with {error}", "lengths such as '# Width: 1 mm'") from None
    if len(sides) < 2 and (grid := _triplets(path, z)):
        return Raw(grid[0], unit, grid[1])
    spacing = (sides[0] / z.shape[1], sides[1] / z.shape[0]) if len(sides) == 2 else None
    return Raw(z.T, unit, spacing)


def _triplets(path: Path, z: NDArray) -> tuple[NDArray, tuple[float, float]] | None:
    """Heights and pixel of lines x, y, z that name every point of a regular grid once; None for another matrix."""
    if z.shape[1] != 3 or len(z) < 9 or np.isnan(z[:, :2]).any():
        return None
    places = []
    for x in (z[:, 0], z[:, 1]):
        values = np.unique(x)
        if values.size < 2:
            return None
        step = (values[-1] - values[0]) / (values.size - 1)
        if not np.allclose(np.diff(values), step, rtol=1e-3, atol=0):
            return None
        places.append((np.rint((x - values[0]) / step).astype(int), values.size, step))
    (i, n1, d1), (j, n2, d2) = places
    if n1 * n2 != len(z) or np.unique(i * n2 + j).size != len(z):
        return None
    heights = np.empty((n1, n2))
    heights[i, j] = z[:, 2]
    return heights, (d1, d2)


def _matrix(path: Path, rows: list[tuple[int, str]], delimiter: str | None) -> NDArray:
    """Heights of a text in rows of numbers, with a decimal comma where its delimiter allows one."""
    if delimiter is None:
        first = rows[0][1]
        delimiter = next((d for d in (";", "\t", ",") if d in first), None)
        if delimiter == "," and len(first.split()) > 1 and all(map(_DECIMAL_COMMA.fullmatch, first.split())):
            delimiter = None
    fields = [[f.strip() for f in text.split(delimiter)] for _, text in rows]
    if delimiter != "," and not any("." in f for f in fields[0]):
        fields = [[_DECIMAL_COMMA.sub(r"\1.\2", f) for f in row] for row in fields]
    # A delimiter behind the last number of every line ends the line; it does not begin an undefined point.
    if delimiter is not None and all(len(row) > 1 and not row[-1] for row in fields):
        fields = [row[:-1] for row in fields]
    for (at, _), row in zip(rows, fields, strict=True):
        if len(row) != len(fields[0]):
            given = f"{counted(len(row), 'number')} in line {at} after {len(fields[0])} in line {rows[0][0]}"
            raise bad_file(path, given, "lines of equal length: check the delimiter")
    return np.array([[_value(path, at, f) for f in row] for (at, _), row in zip(rows, fields, strict=True)])


def _value(path: Path, line: int, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        if text.lower() in _UNDEFINED:
            return np.nan
        allowed = "numbers with a decimal point, nan or nothing where undefined, # before other text"
        raise bad_file(path, f"{text[:30]!r} in line {line}", allowed) from None


def _esri(path: Path, rows: list[tuple[int, str]]) -> Raw:
    """Heights of an Esri raster: a header of keys and numbers, then rows from north to south."""
    header: dict[str, float] = {}
    while rows and (parts := rows[0][1].split())[0].lower() in _ESRI_KEYS:
        header[parts[0].lower()] = _value(path, rows[0][0], " ".join(parts[1:]))
        rows = rows[1:]
    step2, step1 = (header.get(key, header.get("cellsize")) for key in ("dx", "dy"))
    if "ncols" not in header or "nrows" not in header or step1 is None or step2 is None:
        raise bad_file(path, f"a header with {', '.join(header)}", "ncols, nrows, cellsize (an Esri raster)")
    z = np.array([_value(path, at, token) for at, text in rows for token in text.split()])
    shape = int(header["nrows"]), int(header["ncols"])
    if z.size != shape[0] * shape[1]:
        raise bad_file(path, counted(z.size, "number"), f"nrows × ncols = {shape[0]} × {shape[1]} of them")
    z[z == header.get("nodata_value", -9999.0)] = np.nan
    return Raw(z.reshape(shape).T, spacing=(step2, step1))


def read_x3p(path: Path, options: Options) -> Raw:
    """A surface of ISO 25178-72, one layer of it; the format knows metres only."""
    import x3pio

    try:
        file = x3pio.read(path)
    except x3pio.X3pError as error:
        raise bad_file(path, error, "an intact .x3p file of ISO 25178-72") from None
    if not (isinstance(file, x3pio.Surface) and file.is_regular_grid):
        raise bad_file(path, f"a {type(file).__name__} on no regular grid", "a surface on a regular grid")
    layer = _pick(path, list(file.layers), options.channel, "layers")
    return Raw(layer.z.T, 1.0, (file.header.x.increment, file.header.y.increment))


def read_sdf(path: Path, options: Options) -> Raw:
    """A surface of ISO 25178-71; the format knows metres only."""
    import sdfio

    _pick(path, [path], options.channel, "layers")
    try:
        file = sdfio.read(path)
    except sdfio.SdfError as error:
        raise bad_file(path, error, "an intact .sdf file of ISO 25178-71") from None
    return Raw(file.data.T, 1.0, (file.header.x_scale, file.header.y_scale))


def read_instrument(path: Path, options: Options) -> Raw:
    """Any other format, through SurfaceTopography (an extra, slow to import)."""
    try:
        from SurfaceTopography import open_topography
        from SurfaceTopography.IO import readers
    except ImportError:
        allowed = f"{' '.join(sorted(READERS))}, or many formats of instruments after: pip install 'femseal[surface]'"
        raise bad_file(path, f"a file of kind {path.suffix or 'unknown'!r}", allowed) from None
    # Dozens of readers behind one call raise whatever their formats lead them to: all of it means a bad file.
    try:
        with unprinted():
            channels = list(open_topography(str(path)).channels)
    except Exception as error:
        known = sorted({*READERS, *(f".{end}" for reader in readers for end in reader.file_extensions())})
        which = f"not a damaged {path.suffix}" if path.suffix.lower() in known else " ".join(known)
        allowed = (
            f"a file of one of the formats known to SurfaceTopography, {which}; programs of instruments export .x3p too"
        )
        raise bad_file(path, f"a file without a known format ({type(error).__name__})", allowed) from error
    names = [c.name or "" for c in channels]
    channel = _pick(path, channels, options.channel, "channels", names)
    if channel.dim != 2 or not channel.is_height_channel:
        usable = [i for i, c in enumerate(channels) if c.dim == 2 and c.is_height_channel]
        allowed = f"a map of heights: {_listed(usable, names)}" if usable else "a file with a map of heights"
        raise bad_file(path, f"channel={options.channel} ({channel.name}), which is no map of heights", allowed)
    # SurfaceTopography wants what the file lacks; placeholders keep the numbers as they are.
    missing: dict[str, Any] = {}
    if channel.physical_sizes is None:
        missing["physical_sizes"] = tuple(float(n) for n in channel.nb_grid_pts)
    try:
        with unprinted():
            topography = channel.topography(**missing)
            heights, mask = _under_mask(topography) if path.suffix.lower() == ".gwy" else (topography.heights(), None)
        heights = np.ma.filled(np.ma.masked_invalid(heights).astype(float), np.nan)
    except Exception as error:
        raise bad_file(path, f"{type(error).__name__}: {error}", "an intact file") from error
    unit = None if topography.unit is None else to_si(f"1 {topography.unit}", "m", f"{path}: unit")
    if unit is None or missing:
        return Raw(heights, unit, mask=mask)
    first, second = (float(d) * unit for d in topography.pixel_size)
    return Raw(heights, unit, (first, second), mask)


@contextmanager
def unprinted() -> Iterator[None]:
    """Context in which nothing is printed, from Python or below it: readers print what they find in damaged files."""
    with ExitStack() as stack, open(os.devnull, "w", encoding="utf-8") as nothing:
        for stream, number in ((sys.stdout, 1), (sys.stderr, 2)):
            with suppress(OSError, ValueError, AttributeError):  # closed, or none at all
                stream.flush()
            with suppress(OSError):
                kept = os.dup(number)
                stack.callback(os.close, kept)
                stack.callback(os.dup2, kept, number)
                os.dup2(nothing.fileno(), number)
        stack.enter_context(redirect_stdout(nothing))
        stack.enter_context(redirect_stderr(nothing))
        yield


def _under_mask(topography: Any) -> tuple[NDArray, NDArray[np.bool_] | None]:
    """Heights of all points, those under the mask of a user too, and this mask, if there is one."""
    heights = topography.heights()
    if not np.ma.is_masked(heights):
        return heights, None
    # the library scales the points that are not masked, and keeps the numbers of the file for the others
    stored = np.ma.getdata(topography.parent_topography.heights())
    return stored * topography.height_scale_factor, np.ma.getmaskarray(heights)


def _pick(path: Path, choices: list[Any], channel: int | str, kind: str, names: list[str] | None = None) -> Any:
    """The channel of a number, or of a name that only one of them has."""
    if isinstance(channel, str) and names is not None and names.count(channel) == 1:
        return choices[names.index(channel)]
    if channel not in range(len(choices)):
        listed = f": {_listed(list(range(len(names))), names)}" if names and any(names) else ""
        allowed = f"0 to {len(choices) - 1}, it has {len(choices)} {kind}{listed}"
        raise bad_file(path, f"channel={channel!r}", allowed)
    return choices[int(channel)]


def _listed(numbers: list[int], names: list[str]) -> str:
    """Numbers of channels with their names, not more than a line of them."""
    shown = [f"{n} ({shortened(names[n], 40)})" if names[n] else str(n) for n in numbers[:_MOST_LISTED]]
    return ", ".join(shown + ["…"] * (len(numbers) > len(shown)))


def _numbers(path: Path, array: NDArray) -> NDArray:
    if array.dtype.kind not in "fiu" or array.ndim != 2 or not array.size:
        given = f"an array of {array.dtype} of shape {array.shape}"
        raise bad_file(path, given, "a non-empty array of real numbers of shape (n1, n2)")
    with np.errstate(invalid="ignore"):  # bytes of numbers that are none, in single precision
        return array.astype(np.float64)


READERS: dict[str, Callable[[Path, Options], Raw]] = {
    ".npy": read_npy,
    ".npz": read_npz,
    **dict.fromkeys(TEXT, read_text),
    ".x3p": read_x3p,
    ".sdf": read_sdf,
}

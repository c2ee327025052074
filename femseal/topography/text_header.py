"""Read the header of a text with heights: pixel size, units, number of points and numbers that mark undefined points.

A line of the header consists of a name and a value, and may begin with a comment mark. Examples are "# Width: 1 mm",
"cellsize 2", "NODATA_value -9999" and '"XY Calibration","1.383","um"'. The module knows the names that occur in files
of Gwyddion, SPIP, Esri rasters, Keyence and Zygo. The last line may contain the names of the columns, such as "X [mm];
Y [mm]; Z [µm]".
"""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from .raw import length_unit

#: Names in headers by their meaning, in lower case and with one blank between words.
_MEANINGS = {
    "side 1": "width, breite, largeur, x length, length x",
    "side 2": "height, höhe, hauteur, y length, length y",
    "pixel": "cellsize, cell size, pixel size, pixelsize, pixel pitch, pixel spacing, xy calibration, xy justierung",
    "pixel 1": "dx, x step, step x, scale x, x spacing, x increment, pixel size x, x pixel size",
    "pixel 2": "dy, y step, step y, scale y, y spacing, y increment, pixel size y, y pixel size",
    "points 1": "ncols, columns, number of columns, horizontal, horizont, nx, x pixels, x points",
    "points 2": "nrows, rows, number of rows, vertical, vertikal, ny, y pixels, y points",
    "unit": "value units, value unit, einheiten, unit, units, einheit, z unit, unit z, unit data, height unit",
    "nanometres per number": "bit2nm",
    "lateral unit": "x unit, unit x, xy unit, lateral unit",
    "no data": "nodata value, nodata, no data value, no data, missing value, fill value, undefined value, "
    "invalid value, bad value",
}
_MEANING_OF = {
    name.strip(): meaning for meaning, names in _MEANINGS.items() for name in names.split(",")
}
#: Separators of numbers, in the order in which they are looked for.
DELIMITERS = (";", "\t", ",")
#: Beginnings of comments.
COMMENT_MARKS = ("#", "%", "//")
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_LENGTH = re.compile(rf"({NUMBER.pattern})\s*(.*)")
_NAME_AND_VALUE = re.compile(r"(.+?)\s*[:=]\s*(.+)")
_NAME_AND_NUMBER = re.compile(rf"(.+?)\s+({NUMBER.pattern}.*)")
#: The name of a column and its unit in brackets, such as "X [mm]" or "Z (µm)".
_COLUMN = re.compile(r"([^\[\](),;\t]*?)\s*[\[(]([^\])]*)[\])]")
_MENTIONS_LENGTH = re.compile(
    r"(?<![^\W\d_])(?:[nµμu]m|mm|microns?|inch|cellsize|pixel)\b", re.IGNORECASE
)
#: Number of lines of a header that a message shows, and of characters in each.
_SHOWN_LINES, _SHOWN_CHARACTERS = 3, 50


@dataclass
class Header:
    """Content of the header of a text file. Values that are not in the header are None or empty.

    Parameters
    ----------
    sides : tuple of two float, optional
        Sides of the map along x and y of the file [m].
    pixel : tuple of two float, optional
        Pixel size along x and y [m].
    unit : float, optional
        Unit of the heights [m], for example 1e-6 for micrometres.
    unknown_unit : bool
        Whether the header names a unit of height that cannot be read.
    points : tuple of two int, optional
        Number of points along x and y.
    no_data : tuple of float
        Numbers that mark undefined points.
    columns : tuple of str
        Names of the columns in lower case.
    column_units : tuple of float or None
        Unit of each column [m]; None for an unknown unit.
    unread : list of str
        Lines that mention units or pixels and could not be interpreted.
    """

    sides: tuple[float, float] | None = None
    pixel: tuple[float, float] | None = None
    unit: float | None = None
    unknown_unit: bool = False
    points: tuple[int, int] | None = None
    no_data: tuple[float, ...] = ()
    columns: tuple[str, ...] = ()
    column_units: tuple[float | None, ...] = ()
    unread: list[str] = field(default_factory=list)

    @property
    def unclear(self) -> str:
        """Quotation of the first lines in `unread`, for messages."""
        lines = [line[:_SHOWN_CHARACTERS] for line in self.unread[:_SHOWN_LINES]]
        return ", ".join(map(repr, lines))


def meaning_of(line: str) -> str:
    """Return the key of `_MEANINGS` for the name in a header line; "" if the name is unknown."""
    name, _ = _name_and_value(line)
    return _MEANING_OF.get(name, "")


def read_header(lines: Sequence[str], columns: int) -> Header:
    """Read the header of a text.

    Parameters
    ----------
    lines : sequence of str
        Lines before the numbers, and comments between them.
    columns : int
        Number of columns of the table of numbers below the header.
    """
    header = Header()
    entries: dict[str, str] = {}  # meaning: value
    entry_lines: dict[str, str] = {}  # meaning: line
    for line in lines:
        name, value = _name_and_value(line)
        meaning = _MEANING_OF.get(name, "")
        if meaning and value:
            entries[meaning] = value
            entry_lines[meaning] = _without_marks(line)
        elif _MENTIONS_LENGTH.search(line):
            header.unread.append(_without_marks(line))
    if lines and lines[0].startswith("Zygo XYZ"):
        _read_zygo(header, lines)
    _read_lateral_lengths(header, entries, entry_lines)
    _read_height_unit(header, entries, entry_lines)
    points1, points2 = entries.get("points 1", ""), entries.get("points 2", "")
    if points1.isdecimal() and points2.isdecimal():
        header.points = int(points1), int(points2)
    no_data = entries.get("no data", "")
    if NUMBER.fullmatch(no_data):
        header.no_data = (float(no_data),)
    if lines:
        _read_columns(header, lines[-1], columns)
    return header


def _read_lateral_lengths(
    header: Header, entries: dict[str, str], entry_lines: dict[str, str]
) -> None:
    """Find the sides and the pixel size in the entries of a header, and store them in `header`.

    entries : values in the header by their meaning, see `_MEANINGS`.
    entry_lines : header line that contains each entry, keyed by the meaning of the entry.
    """
    lateral_unit = length_unit(entries.get("lateral unit", ""))
    header.sides = _two_lengths(entries, "side 1", "side 2", lateral_unit)
    if "pixel" in entries:
        entries = entries | {"pixel 1": entries["pixel"], "pixel 2": entries["pixel"]}
    pixel = _two_lengths(entries, "pixel 1", "pixel 2", lateral_unit)
    header.pixel = pixel or header.pixel
    if header.sides is None and header.pixel is None:
        for meaning, line in entry_lines.items():
            if meaning.startswith(("side", "pixel")):
                header.unread.append(line)


def _read_height_unit(header: Header, entries: dict[str, str], entry_lines: dict[str, str]) -> None:
    """Find the unit of height in the entries of a header, and store the unit in `header`.

    The arguments are the same as in `_read_lateral_lengths`.
    """
    if "unit" in entries:
        header.unit = length_unit(entries["unit"])
        if header.unit is None:
            header.unknown_unit = True
            header.unread.insert(0, entry_lines["unit"])
        return
    nanometres = entries.get("nanometres per number", "")
    if NUMBER.fullmatch(nanometres):
        header.unit = 1e-9 * float(nanometres)


def _without_marks(line: str) -> str:
    """Return a line without comment marks at its beginning."""
    return line.strip().lstrip("#%/").strip()


def _name_and_value(line: str) -> tuple[str, str]:
    """Split a line of the header into a name and a value.

    The name is returned in lower case, with single spaces between words. For an empty line, name and value are "".
    """
    text = _without_marks(line)
    parts = _split_at_delimiter(text)
    if len(parts) < 2:
        match = _NAME_AND_VALUE.fullmatch(text) or _NAME_AND_NUMBER.fullmatch(text)
        parts = [match[1], match[2]] if match else text.rsplit(maxsplit=1)
    if not parts:
        return "", ""
    name = re.sub(r"[\W_]+", " ", parts[0]).strip().lower()
    value = " ".join(parts[1:]).strip().strip('"')
    return name, value.replace(",", ".")


def _split_at_delimiter(text: str) -> list[str]:
    """Split a line at its semicolons, tabs or commas; a line without such delimiters is a single part."""
    for mark in DELIMITERS:
        if mark not in text:
            continue
        fields = next(csv.reader([text], delimiter=mark, skipinitialspace=True))
        parts = [field.strip() for field in fields if field.strip()]
        # a delimiter does not come after a colon: the comma in "Width: 9,0 um" is a decimal comma
        begins_with_entry = parts and re.search("[:=]", parts[0])
        if parts and not begins_with_entry:
            return parts
    return [text]


def _two_lengths(
    entries: dict[str, str], first: str, second: str, lateral_unit: float | None
) -> tuple[float, float] | None:
    """Return two lengths [m] from the entries of a header; None unless both entries are lengths with known units.

    first, second : keys in `entries` of the two lengths.
    lateral_unit : unit [m] of lengths that are written without a unit; None if the header does not state this unit.
    """
    length1 = _parse_length(entries.get(first, ""), lateral_unit)
    length2 = _parse_length(entries.get(second, ""), lateral_unit)
    if length1 and length2:
        return length1, length2
    return None


def _parse_length(text: str, lateral_unit: float | None) -> float | None:
    """Convert text to a length [m]; return None if the text is not a length.

    lateral_unit : unit [m] of a length that is written without a unit; None if this unit is unknown.
    """
    match = _LENGTH.fullmatch(text)
    if match is None:
        return None
    unit = length_unit(match[2]) if match[2] else lateral_unit
    return None if unit is None else float(match[1]) * unit


def _read_zygo(header: Header, lines: Sequence[str]) -> None:
    """Set the units of an XYZ export of Zygo.

    An XYZ file exported by Zygo software contains heights in micrometres, and pixel indices as coordinates. The
    seventh number of the eighth line is the pixel size [m], or 0 if the camera is not calibrated.
    """
    header.unit = 1e-6
    numbers = lines[7].split() if len(lines) > 7 else []
    if len(numbers) < 7 or not NUMBER.fullmatch(numbers[6]):
        return
    pixel = float(numbers[6])
    if pixel > 0:
        header.pixel = pixel, pixel


def _read_columns(header: Header, line: str, columns: int) -> None:
    """Set the names and units of the columns, if the last line of the header contains a name for each column."""
    text = _without_marks(line).replace('"', "")
    # if every name has a unit in brackets, the names may contain blanks and need no delimiter
    names_and_units = _COLUMN.findall(text)
    if len(names_and_units) == columns:
        header.columns = tuple(name.strip(" ,;\t").lower() for name, _ in names_and_units)
        header.column_units = tuple(length_unit(unit) for _, unit in names_and_units)
        return
    # otherwise the names are separated by a delimiter or by blanks, and may have a unit
    delimiter = next((mark for mark in DELIMITERS if mark in text), None)
    names = [name.strip().lower() for name in text.split(delimiter)]
    if len(names) == columns:
        header.columns = tuple(names)
        matches = [_COLUMN.fullmatch(name) for name in names]
        header.column_units = tuple(length_unit(match[2]) if match else None for match in matches)

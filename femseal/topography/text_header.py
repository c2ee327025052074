"""Header of a text with heights: what its lines before the numbers say of pixel, units, points and undefined values.

A line says one thing by a name and a value, behind a comment mark or not, such as "# Width: 1 mm", "cellsize 2",
"NODATA_value -9999" or '"XY Calibration","1.383","um"'. The names are those of the exports of Gwyddion and SPIP, of
rasters (Esri), of Keyence and of Zygo. The last line may name the columns, "X [mm]; Y [mm]; Z [µm]".
"""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from .raw import length_unit

#: What a name in a header stands for. Names are compared in lower case, with one blank between words.
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
#: Marks between the numbers of a line, and those that begin a comment.
DELIMITERS = (";", "\t", ",")
COMMENT_MARKS = ("#", "%", "//")
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_LENGTH = re.compile(rf"({NUMBER.pattern})\s*(.*)")
_NAME_AND_VALUE = re.compile(r"(.+?)\s*[:=]\s*(.+)")
_NAME_AND_NUMBER = re.compile(rf"(.+?)\s+({NUMBER.pattern}.*)")
_COLUMN = re.compile(r"([^\[\](),;\t]*?)\s*[\[(]([^\])]*)[\])]")
_MENTIONS_LENGTH = re.compile(
    r"(?<![^\W\d_])(?:[nµμu]m|mm|microns?|inch|cellsize|pixel)\b", re.IGNORECASE
)
#: Lines of a header that a message shows, and the most characters of each.
_SHOWN_LINES, _SHOWN_CHARACTERS = 3, 50


@dataclass
class Header:
    """What the header of a text says; None and empty where it says nothing.

    sides, pixel : of the map along x and y [m].
    unit : metres per number of the heights; unknown_unit : whether it is said and cannot be read.
    points : numbers along x and y.
    no_data : numbers that stand for undefined points.
    columns : names of the columns, in lower case. column_units : metres per number of each, None where not said.
    unread : lines on units or pixels that were not understood.
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
        """Lines that were not understood, as text for a message."""
        lines = [line[:_SHOWN_CHARACTERS] for line in self.unread[:_SHOWN_LINES]]
        return ", ".join(map(repr, lines))


def meaning_of(line: str) -> str:
    """What a line of a header is about, "" where its name is not known."""
    return _MEANING_OF.get(_name_and_value(line)[0], "")


def read_header(lines: Sequence[str], columns: int) -> Header:
    """Read the header of a text.

    Parameters
    ----------
    lines : before the numbers, and comments between them.
    columns : numbers in a line of the file.
    """
    header = Header()
    found: dict[str, str] = {}
    written: dict[str, str] = {}
    for line in lines:
        name, value = _name_and_value(line)
        meaning = _MEANING_OF.get(name, "")
        if meaning and value:
            found[meaning] = value
            written[meaning] = _without_marks(line)
        elif _MENTIONS_LENGTH.search(line):
            header.unread.append(_without_marks(line))
    if lines and lines[0].startswith("Zygo XYZ"):
        _read_zygo(header, lines)
    lateral = length_unit(found.get("lateral unit", ""))
    header.sides = _pair(found, "side 1", "side 2", lateral)
    if "pixel" in found:
        found["pixel 1"] = found["pixel 2"] = found["pixel"]
    header.pixel = _pair(found, "pixel 1", "pixel 2", lateral) or header.pixel
    if header.sides is None and header.pixel is None:
        names = [name for name in written if name.startswith(("side", "pixel"))]
        header.unread += [written[name] for name in names]
    if "unit" in found:
        header.unit = length_unit(found["unit"])
        if header.unit is None:
            header.unknown_unit = True
            header.unread.insert(0, written["unit"])
    elif NUMBER.fullmatch(factor := found.get("nanometres per number", "")):
        header.unit = 1e-9 * float(factor)
    counts = [found.get("points 1", ""), found.get("points 2", "")]
    if all(count.isdecimal() for count in counts):
        header.points = int(counts[0]), int(counts[1])
    if NUMBER.fullmatch(value := found.get("no data", "")):
        header.no_data = (float(value),)
    if lines:
        _read_columns(header, lines[-1], columns)
    return header


def _without_marks(line: str) -> str:
    return line.strip().lstrip("#%/").strip()


def _name_and_value(line: str) -> tuple[str, str]:
    """Name, in lower case with single blanks, and value of a line of a header; "" where there is none."""
    text = _without_marks(line)
    parts = _parts(text)
    if len(parts) < 2:
        match = _NAME_AND_VALUE.fullmatch(text) or _NAME_AND_NUMBER.fullmatch(text)
        parts = [match[1], match[2]] if match else text.rsplit(maxsplit=1)
    name = re.sub(r"[\W_]+", " ", parts[0]).strip().lower() if parts else ""
    value = " ".join(parts[1:]).strip().strip('"')
    return name, value.replace(",", ".")


def _parts(text: str) -> list[str]:
    """Parts of a line between semicolons, tabs or commas; the line itself without them."""
    for mark in DELIMITERS:
        if mark in text:
            fields = next(csv.reader([text], delimiter=mark, skipinitialspace=True))
            parts = [part.strip() for part in fields if part.strip()]
            # "Width: 9,0 um" has a decimal comma
            if parts and not re.search("[:=]", parts[0]):
                return parts
    return [text]


def _pair(
    found: dict[str, str], first: str, second: str, lateral: float | None
) -> tuple[float, float] | None:
    """Two lengths [m] by their names; None unless both are there and have a unit.

    lateral : unit of numbers that have none [m], None where the header has none for them either.
    """
    lengths = [_length(found.get(name, ""), lateral) for name in (first, second)]
    return (lengths[0], lengths[1]) if lengths[0] and lengths[1] else None


def _length(text: str, lateral: float | None) -> float | None:
    """A length [m] from a text, None where it is no length; `lateral` is the unit of a number without one."""
    match = _LENGTH.fullmatch(text)
    if not match:
        return None
    unit = length_unit(match[2]) if match[2] else lateral
    return None if unit is None else float(match[1]) * unit


def _read_zygo(header: Header, lines: Sequence[str]) -> None:
    """Take the pixel from the eighth line of an XYZ export of Zygo, in metres, 0 where the camera is not calibrated.

    Its heights are in micrometres, its coordinates count pixels.
    """
    header.unit = 1e-6
    numbers = lines[7].split() if len(lines) > 7 else []
    if len(numbers) > 6 and NUMBER.fullmatch(numbers[6]) and float(numbers[6]) > 0:
        header.pixel = float(numbers[6]), float(numbers[6])


def _read_columns(header: Header, line: str, columns: int) -> None:
    """Take the names of the columns, and their units, from the last line of a header if it has as many."""
    text = _without_marks(line).replace('"', "")
    with_units = _COLUMN.findall(text)
    if len(with_units) == columns:
        header.columns = tuple(name.strip(" ,;\t").lower() for name, _ in with_units)
        header.column_units = tuple(length_unit(unit) for _, unit in with_units)
        return
    mark = next((mark for mark in DELIMITERS if mark in text), None)
    names = [name.strip().lower() for name in text.split(mark)]
    if len(names) == columns:
        header.columns = tuple(names)
        units = [_COLUMN.fullmatch(name) for name in names]
        header.column_units = tuple(length_unit(unit[2]) if unit else None for unit in units)

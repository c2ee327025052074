"""Texts with heights: a matrix, or a table of coordinates x y z, in the encodings and with the headers of instruments.

A line of a matrix runs along x. What stands between the numbers is found, a decimal comma too where commas are nothing
else. Lines before the numbers, and comments, are the header, see `text_header`.
"""

import codecs
import csv
import re
from array import array
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from ..base import InputError, as_text, counted
from .coordinates import MapOfTable, map_of_table
from .raw import Raw, Reading
from .text_header import COMMENT_MARKS, DELIMITERS, NUMBER, Header, meaning_of, read_header

#: Suffixes of texts; a .dat may be a text, or a file of an instrument.
TEXT = (".csv", ".asc", ".txt", ".xyz", ".tsv", ".prn")
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
#: What instruments and spreadsheets write for an undefined point, beside nan, in lower case.
_UNDEFINED = {"", "bad", "na", "n/a", "null", "none", "nodata", "no_data", "no data", "void", "invalid"} | {
    "undefined", "missing", "1.#qnan", "-1.#ind", "1.#ind", "#n/a", "#num!", "#value!", "#div/0!"
}  # fmt: skip
_MARKS_OF_NOTHING = re.compile(r"-+|\*+|\?+")
_NO_DATA = re.compile(r"\bno data\b", re.IGNORECASE)
#: Lines among which the first one with numbers is looked for, and how many alike make it one.
_LONGEST_HEADER, _ALIKE = 1000, 3
#: Bytes by which a text is told from a file of an instrument.
_HEAD = 2**16


def is_text(path: Path) -> bool:
    """Whether a file is a text: by its suffix, of a .dat by its bytes."""
    suffix = path.suffix.lower()
    if suffix != ".dat":
        return suffix in TEXT
    with path.open("rb") as file:
        return b"\0" not in file.read(_HEAD)


def encoding_of(path: Path) -> str:
    """Encoding of a text: UTF-8 or UTF-16 with or without a mark, else cp1252, the older one of Windows.

    Raises InputError: the bytes are no text.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD)
        if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return "utf-16"
        if b"\0" in head:
            # of two bytes of a digit in UTF-16 one is zero
            for name, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[::2])):
                if zeros.count(0) > 0.9 * len(zeros):
                    return name
            expected = "a text with numbers, or the suffix of the instrument's format"
            raise InputError("file", "bytes that are no text", expected)
        decoder = codecs.getincrementaldecoder("utf-8")()
        try:
            while head:
                decoder.decode(head)
                head = file.read(_HEAD)
        except UnicodeDecodeError:
            return "cp1252"
    return "utf-8-sig"


def read_text(path: Path, said: Reading) -> Raw:
    """A matrix of heights as text, one line for each y, or a table x, y, z whose points lie on a regular grid.

    Raises InputError: no numbers, a line with others, lines of unequal length, a profile, or points on no grid.
    """
    with path.open(encoding=encoding_of(path), errors="replace") as file:
        numbers, header = _read_numbers(file, said.delimiter)
    if header.sides is not None:
        n1, n2 = numbers.shape[::-1]
        header.pixel = header.sides[0] / n1, header.sides[1] / n2
        found = MapOfTable(numbers.T)
    else:
        found = map_of_table(numbers, header.columns)
    if found.steps is not None:
        _take_units_of_columns(header, found, is_unit_given=said.height_unit is not None)
    return Raw(
        found.heights,
        header.unit,
        header.pixel,
        needs_unit=header.unknown_unit,
        no_data=header.no_data,
        unclear=header.unclear,
        notes=found.notes,
    )


def _take_units_of_columns(header: Header, found: MapOfTable, *, is_unit_given: bool) -> None:
    """Find the pixel of a table of coordinates, and the unit of its heights, from the names of its columns.

    Without any unit all columns are in metres. A unit of the heights alone does not say that of the coordinates.
    """
    assert found.steps is not None
    units = [header.column_units[n] if header.column_units else None for n in found.columns]
    header.unit = header.unit or units[2]
    if header.pixel is not None:
        return
    if units[0] and units[1]:
        header.pixel = found.steps[0] * units[0], found.steps[1] * units[1]
    elif header.unit is None and not is_unit_given:
        header.pixel = found.steps
    steps = " and ".join(f"{step:.6g}" for step in found.steps)
    header.unread.insert(0, f"coordinates in steps of {steps}, without a unit")


def _read_numbers(file: TextIO, delimiter: str | None) -> tuple[NDArray, Header]:
    """Numbers (lines, columns) of a text, and its header."""
    lines = enumerate(file, start=1)
    head = list(islice(lines, _LONGEST_HEADER))
    begin = _first_with_numbers([line for _, line in head], delimiter)
    comments = [line for _, line in head[:begin]]
    layout = _layout([line for _, line in head[begin:]], delimiter)
    numbers, width, first, ends = array("d"), 0, 0, layout.mark is not None
    unequal: InputError | None = None
    for at, line in chain(head[begin:], lines):
        text = line.strip(" \r\n")
        if _is_comment(text):
            if meaning_of(text) == "side 1" and any(meaning_of(c) == "side 1" for c in comments):
                given = f"a second map, which begins in line {at}"
                raise InputError("file", given, "a file with one map: cut it there")
            comments.append(text)
            continue
        if not text.strip():
            continue
        fields = layout.split(text)
        ends = ends and len(fields) > 1 and not fields[-1].strip()
        try:
            row = [float(field) for field in fields]
        except ValueError:
            shown = layout.split(text, as_shown=True)
            row = [_value(at, *both) for both in zip(fields, shown, strict=True)]
        first = first or at
        width = width or len(row)
        if len(row) != width and unequal is None:
            given = f"{counted(len(row), 'number')} in line {at} after {width} in line {first}"
            unequal = InputError("file", given, "lines of equal length: check the delimiter")
        numbers.extend(row)
    if comments and comments[0].startswith("Zygo ASCII"):
        expected = "its XYZ export or an .x3p: an ASCII export holds counts of the camera"
        raise InputError("file", "a Zygo ASCII file", expected)
    header = read_header(comments, width)
    z = np.frombuffer(numbers)
    if header.points is not None and z.size == header.points[0] * header.points[1]:
        return z.reshape(header.points[::-1]), header
    if unequal is not None:
        raise unequal
    z = z.reshape(-1, width)
    # a delimiter behind the last number of every line ends the line; it does not begin an undefined point
    z = z[:, :-1] if ends else z
    if header.points is not None and (z.shape[0] == header.points[1]) != (
        z.shape[1] == header.points[0]
    ):
        given = f"{as_text(z.shape[::-1])} numbers, where its header says {as_text(header.points)}"
        raise InputError("file", given, "a whole file, or a header that fits")
    return z, header


@dataclass(frozen=True)
class _Layout:
    """How the numbers of a line are written.

    mark : between them, None for blanks. has_comma : whether they have decimal commas.
    """

    mark: str | None
    has_comma: bool = False

    def split(self, text: str, *, as_shown: bool = False) -> list[str]:
        """Fields of a line, with decimal points unless `as_shown` in the file."""
        if self.mark is None:
            fields = _NO_DATA.sub("nan", text).replace('"', " ").split()
        elif '"' in text:
            fields = next(csv.reader([text], delimiter=self.mark, skipinitialspace=True))
        else:
            fields = text.split(self.mark)
        if self.has_comma and not as_shown:
            return [field.replace(",", ".") for field in fields]
        return fields


def _layout(lines: list[str], delimiter: str | None) -> _Layout:
    """How numbers are written in lines, from the first that has any.

    delimiter : between them, found unless given.
    """
    texts = [
        text for line in lines if (text := line.strip(" \r\n")).strip() and not _is_comment(text)
    ]
    if not texts:
        expected = "a matrix of heights, one line per row, or a table x y z"
        raise InputError("file", "no line with numbers", expected)
    mark = _delimiter(texts[0]) if delimiter is None else delimiter
    fields = [field for text in texts for field in _Layout(mark).split(text)]
    commas = sum(_DECIMAL_COMMA.fullmatch(field.strip()) is not None for field in fields)
    has_points = any("." in field for field in fields)
    return _Layout(mark, has_comma=commas > 0 and not has_points)


def _first_with_numbers(lines: list[str], delimiter: str | None) -> int:
    """Number of the line with which the numbers begin: it and the next ones hold as many of them.

    Where no lines are alike, that of the first line of numbers, or of the first one that begins with a digit, so that a
    message can show it.
    """
    shapes = [_shape(line, delimiter) for line in lines]
    places = [n for n, shape in enumerate(shapes) if shape is not None]
    numeric = [n for n in places if isinstance(shapes[n], int)]
    for k, n in enumerate(places):
        count = shapes[n]
        alike = [shapes[m] for m in places[k : k + _ALIKE]]
        if isinstance(count, int) and alike == [count] * _ALIKE:
            above = places[k - 1] if k else n
            return above if _is_like(lines[above], delimiter, count) else n
    starts = (n for n in places if re.match(r"[-+.]?\d", lines[n].strip().strip('"')))
    return numeric[0] if numeric else next(starts, len(lines))


def _shape(line: str, delimiter: str | None) -> int | str | None:
    """Count of the numbers of a line; "text" of another one, None of a comment or an empty one."""
    text = line.strip(" \r\n")
    if not text.strip() or _is_comment(text):
        return None
    fields = _Layout(_delimiter(text) if delimiter is None else delimiter).split(text)
    if all(_is_number(field) for field in fields) and any(field.strip() for field in fields):
        return len(fields)
    return "text"


def _is_like(line: str, delimiter: str | None, count: int) -> bool:
    """Whether a line above lines of so many numbers is one of them, with a word that nobody knows or numbers missing.

    Numbers in even steps are those of an axis.
    """
    text = line.strip(" \r\n")
    fields = _Layout(_delimiter(text) if delimiter is None else delimiter).split(text)
    numbers = [float(field) for field in fields if NUMBER.fullmatch(field.strip())]
    if len(numbers) < 2 or len(fields) > count or len(fields) < max(count / 2, min(count, _ALIKE)):
        return False
    return not np.allclose(np.diff(numbers, n=2), 0.0, atol=1e-6 * abs(numbers[1] - numbers[0]))


def _is_comment(text: str) -> bool:
    """Whether a line is a comment; words of spreadsheets for an undefined number begin as one."""
    text = text.lstrip()
    if not text.startswith(COMMENT_MARKS):
        return False
    return re.split(r"[;,\s]", text.lower(), maxsplit=1)[0] not in _UNDEFINED


def _is_number(field: str) -> bool:
    """Whether a field is a number or stands for an undefined one."""
    try:
        float(field)
    except ValueError:
        return _is_undefined(field) or _DECIMAL_COMMA.fullmatch(field.strip()) is not None
    return True


def _is_undefined(field: str) -> bool:
    word = field.strip().lower()
    return word in _UNDEFINED or _MARKS_OF_NOTHING.fullmatch(word) is not None


def _delimiter(line: str) -> str | None:
    """What stands between the numbers of a line: ; tab , or None, blanks."""
    outside = re.sub(r'"[^"]*"', "", line)
    found = next((mark for mark in DELIMITERS if mark in outside), None)
    numbers = line.split()
    if found == "," and len(numbers) > 1 and all(map(_DECIMAL_COMMA.fullmatch, numbers)):
        return None
    return found


def _value(line: int, text: str, shown: str) -> float:
    """The number of a text; InputError that shows it as it is in the file."""
    try:
        return float(text)
    except ValueError:
        if _is_undefined(text):
            return np.nan
        allowed = (
            "numbers with a decimal point, nan or nothing where undefined; put # before lines that are none, and "
            "what a header says into spacing= or size= and height_unit= (--spacing, --size, --height-unit)"
        )
        raise InputError("file", f"{shown.strip()[:30]!r} in line {line}", allowed) from None

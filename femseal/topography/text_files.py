"""Read texts with heights: a matrix, or a table of coordinates x y z, with the encodings and headers of instruments.

In a matrix, the points of a line lie along x. The separator of the numbers is recognised automatically. Decimal commas
are recognised if commas have no other meaning in the text. Comments and the lines before the numbers form the header,
see `text_header`.
"""

from __future__ import annotations

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

#: Suffixes of texts. A .dat file may be a text or the file of an instrument.
TEXT = (".csv", ".asc", ".txt", ".xyz", ".tsv", ".prn")
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
#: Words in lower case that instruments and spreadsheets write for an undefined point, in addition to nan.
_UNDEFINED = {"", "bad", "na", "n/a", "null", "none", "nodata", "no_data", "no data", "void", "invalid"} | {
    "undefined", "missing", "1.#qnan", "-1.#ind", "1.#ind", "#n/a", "#num!", "#value!", "#div/0!"
}  # fmt: skip
#: Signs that stand for an undefined point, such as "---".
_PLACEHOLDER = re.compile(r"-+|\*+|\?+")
_NO_DATA = re.compile(r"\bno data\b", re.IGNORECASE)
#: Largest number of lines before the numbers.
_LONGEST_HEADER = 1000
#: The table of numbers begins where this many successive lines consist of numbers only, with the same count in each
#: line. Marks of undefined points count as numbers.
_ALIKE = 3
#: Number of bytes that are examined to recognise a text and its encoding.
_HEAD = 2**16


def is_text(path: Path) -> bool:
    """Return whether a file contains text.

    The suffix determines the result, except for .dat files. A .dat file is opened; it is taken to be text if it
    contains no zero bytes.
    """
    suffix = path.suffix.lower()
    if suffix != ".dat":
        return suffix in TEXT
    with path.open("rb") as file:
        return b"\0" not in file.read(_HEAD)


def encoding_of(path: Path) -> str:
    """Return the encoding of a text: UTF-8, UTF-16, or cp1252 (the former encoding of Windows) for all other texts.

    Raises
    ------
    InputError
        The file is not a text.
    """
    with path.open("rb") as file:
        block = file.read(_HEAD)
        if block.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return "utf-16"
        if b"\0" in block:
            # UTF-16 encodes a digit by two bytes, of which the high byte is zero
            for name, high_bytes in (("utf-16-le", block[1::2]), ("utf-16-be", block[::2])):
                if high_bytes.count(0) > 0.9 * len(high_bytes):
                    return name
            expected = (
                "a text with numbers; the file of an instrument needs the suffix of its format"
            )
            raise InputError("file", "a file that is not a text", expected)
        decoder = codecs.getincrementaldecoder("utf-8")()
        try:
            while block:
                decoder.decode(block)
                block = file.read(_HEAD)
        except UnicodeDecodeError:
            return "cp1252"
    return "utf-8-sig"


def read_text(path: Path, options: Reading) -> Raw:
    """Read heights from a text: a matrix with one line for each y, or a table x y z on a regular grid.

    Raises
    ------
    InputError
        The text contains no numbers; or it contains words between the numbers, lines of different lengths, a profile,
        or points that are not on a grid.
    """
    with path.open(encoding=encoding_of(path), errors="replace") as file:
        numbers, header = _read_numbers(file, options.delimiter)
    if header.sides is not None:
        n1, n2 = numbers.shape[::-1]
        header.pixel = header.sides[0] / n1, header.sides[1] / n2
        table = MapOfTable(numbers.T)
    else:
        table = map_of_table(numbers, header.columns)
    if table.steps is not None:
        _apply_column_units(header, table, is_unit_given=options.height_unit is not None)
    return Raw(
        table.heights,
        header.unit,
        header.pixel,
        needs_unit=header.unknown_unit,
        no_data=header.no_data,
        unclear=header.unclear,
        has_coordinates=table.steps is not None,
        notes=table.notes,
    )


def _apply_column_units(header: Header, table: MapOfTable, *, is_unit_given: bool) -> None:
    """Set the pixel size and height unit of a coordinate table, using the units of its columns.

    If no column has a known unit, all columns are taken to be in metres. If only the unit of the heights is known, the
    pixel size remains unknown.

    header : header of the table, which is modified in place.
    is_unit_given : whether the caller gives the unit of height.
    """
    assert table.steps is not None
    if header.column_units:
        x_unit, y_unit, z_unit = (header.column_units[n] for n in table.columns)
    else:
        x_unit = y_unit = z_unit = None
    header.unit = header.unit or z_unit
    if header.pixel is not None:
        return  # the header states the pixel size
    if x_unit and y_unit:
        header.pixel = table.steps[0] * x_unit, table.steps[1] * y_unit
        return
    if header.unit is None and not is_unit_given:
        header.pixel = table.steps  # in metres
    steps = " and ".join(f"{step:.6g}" for step in table.steps)
    header.unread.insert(0, f"coordinates in steps of {steps}, without a unit")


def _read_numbers(file: TextIO, delimiter: str | None) -> tuple[NDArray, Header]:
    """Return the table of numbers (lines, columns) in a text, and its header."""
    lines = enumerate(file, start=1)
    first_lines = list(islice(lines, _LONGEST_HEADER))
    begin = _find_first_numbers([line for _, line in first_lines], delimiter)
    comments = [line for _, line in first_lines[:begin]]
    layout = _find_layout([line for _, line in first_lines[begin:]], delimiter)
    rows = _RowReader(layout)
    for line_number, line in chain(first_lines[begin:], lines):
        text = line.strip(" \r\n")
        if _is_comment(text):
            _refuse_second_map(text, comments, line_number)
            comments.append(text)
        elif text.strip():
            rows.read(line_number, text)
    if comments and comments[0].startswith("Zygo ASCII"):
        expected = "its XYZ export or an .x3p: an ASCII export holds counts of the camera"
        raise InputError("file", "a Zygo ASCII file", expected)
    header = read_header(comments, rows.width)
    return rows.table(header.points), header


def _refuse_second_map(text: str, comments: list[str], line_number: int) -> None:
    """Raise InputError if a comment is the start of a second map's header in the same file.

    text : the comment.
    comments : all comments of the file before this comment.
    """
    if meaning_of(text) != "side 1":
        return
    if any(meaning_of(comment) == "side 1" for comment in comments):
        given = f"a second map, which begins in line {line_number}"
        expected = "a file with a single map: remove everything from this line on"
        raise InputError("file", given, expected)


class _RowReader:
    """Read lines of numbers one by one, and join them into a table."""

    def __init__(self, layout: _Layout) -> None:
        self.layout = layout
        #: Number of entries in the first line; 0 before it is read.
        self.width = 0
        #: All numbers so far, line by line.
        self._numbers = array("d")
        #: Number of the first line of the table, for messages; 0 before it is read.
        self._first_line = 0
        #: Whether every line so far ends with a delimiter.
        self._ends_with_delimiter = layout.delimiter is not None
        #: Error about the first line whose length differs from the length of the first line.
        self._unequal_lines: InputError | None = None

    def read(self, line_number: int, text: str) -> None:
        """Add the numbers in a line to the table.

        If the line does not contain as many numbers as the first line, an error is stored, which `table` raises unless
        the header explains the different lengths.
        """
        fields = self.layout.split(text)
        if len(fields) < 2 or fields[-1].strip():
            self._ends_with_delimiter = False
        try:
            row = [float(field) for field in fields]
        except ValueError:
            originals = self.layout.split(text, keep_commas=True)
            row = [
                _parse_value(line_number, field, original)
                for field, original in zip(fields, originals, strict=True)
            ]
        self._first_line = self._first_line or line_number
        self.width = self.width or len(row)
        if len(row) != self.width and self._unequal_lines is None:
            given = (
                f"{counted(len(row), 'number')} in line {line_number} after {self.width} in line "
                f"{self._first_line}"
            )
            expected = "lines of equal length: check the delimiter"
            self._unequal_lines = InputError("file", given, expected)
        self._numbers.extend(row)

    def table(self, points: tuple[int, int] | None) -> NDArray:
        """Return the table (lines, columns).

        points : numbers of points along x and y according to the header. Some programs break long lines; lines of
        different lengths are therefore allowed if the file contains as many numbers as the header states.
        """
        numbers = np.frombuffer(self._numbers)
        if points is not None and numbers.size == points[0] * points[1]:
            return numbers.reshape(points[::-1])
        if self._unequal_lines is not None:
            raise self._unequal_lines
        table = numbers.reshape(-1, self.width)
        if self._ends_with_delimiter:
            # if every line ends with a delimiter, the empty entry after it is not an undefined point
            table = table[:, :-1]
        if points is not None:
            # The file is incomplete if only one of the two numbers in the header agrees with the table. If neither
            # number agrees with the table, the header describes something else.
            has_lines = table.shape[0] == points[1]
            has_columns = table.shape[1] == points[0]
            if has_lines != has_columns:
                given = (
                    f"{as_text(table.shape[::-1])} numbers, where its header says {as_text(points)}"
                )
                raise InputError("file", given, "as many numbers as the header says")
        return table


@dataclass(frozen=True)
class _Layout:
    """Describe the format of the numbers in a line.

    delimiter : separator between numbers, None for blanks.
    has_decimal_commas : whether the numbers have decimal commas.
    """

    delimiter: str | None
    has_decimal_commas: bool = False

    def split(self, text: str, *, keep_commas: bool = False) -> list[str]:
        """Split a line into its fields, and replace decimal commas by points unless `keep_commas` is True."""
        if self.delimiter is None:
            # "no data" is one field in spite of its blank
            fields = _NO_DATA.sub("nan", text).replace('"', " ").split()
        elif '"' in text:
            fields = next(csv.reader([text], delimiter=self.delimiter, skipinitialspace=True))
        else:
            fields = text.split(self.delimiter)
        if self.has_decimal_commas and not keep_commas:
            return [field.replace(",", ".") for field in fields]
        return fields


def _find_layout(lines: list[str], delimiter: str | None) -> _Layout:
    """Determine the format of the numbers in some lines.

    delimiter : separator given by the caller; None to detect the separator in the first line.
    """
    texts = [line.strip(" \r\n") for line in lines]
    texts = [text for text in texts if text.strip() and not _is_comment(text)]
    if not texts:
        expected = "a matrix of heights, one line per row, or a table x y z"
        raise InputError("file", "no line with numbers", expected)
    if delimiter is None:
        delimiter = _find_delimiter(texts[0])
    layout = _Layout(delimiter)
    fields = [field for text in texts for field in layout.split(text)]
    has_commas = any(_DECIMAL_COMMA.fullmatch(field.strip()) for field in fields)
    has_points = any("." in field for field in fields)
    return _Layout(delimiter, has_decimal_commas=has_commas and not has_points)


def _find_first_numbers(lines: list[str], delimiter: str | None) -> int:
    """Return the index of the line at which the table of numbers begins.

    The table begins with the first of three successive lines that consist of numbers only, with the same count in each
    line. If the line directly above is a faulty row of the table, the table begins with that row, so that the fault is
    reported. A text without three such lines begins with its first line of numbers. A text without any line of numbers
    begins with the first line that starts with a digit, so that an error message can quote this line.
    """
    contents = [_content(line, delimiter) for line in lines]
    # indices of the lines that are neither empty nor comments
    candidates = [index for index, content in enumerate(contents) if content is not None]
    for position, index in enumerate(candidates):
        count = contents[index]
        next_lines = candidates[position : position + _ALIKE]
        if not isinstance(count, int) or [contents[n] for n in next_lines] != [count] * _ALIKE:
            continue
        if position == 0:
            return index
        previous = candidates[position - 1]
        return previous if _is_faulty_row(lines[previous], delimiter, count) else index
    for index in candidates:
        if isinstance(contents[index], int):
            return index
    for index in candidates:
        if re.match(r"[-+.]?\d", lines[index].strip().strip('"')):
            return index
    return len(lines)


def _content(line: str, delimiter: str | None) -> int | str | None:
    """Count the numbers in a line.

    The result is "text" for a line with other words, and None for a comment or an empty line.
    """
    text = line.strip(" \r\n")
    if not text.strip() or _is_comment(text):
        return None
    if delimiter is None:
        delimiter = _find_delimiter(text)
    fields = _Layout(delimiter).split(text)
    if all(_is_number(field) for field in fields) and any(field.strip() for field in fields):
        return len(fields)
    return "text"


def _is_faulty_row(line: str, delimiter: str | None, count: int) -> bool:
    """Return whether the line above a table is a faulty row of that table, one with an unknown word or missing numbers.

    A line whose numbers increase in equal steps is not a faulty row: such a line contains the coordinates of an axis.

    count : number of columns of the table.
    """
    text = line.strip(" \r\n")
    if delimiter is None:
        delimiter = _find_delimiter(text)
    fields = _Layout(delimiter).split(text)
    numbers = [float(field) for field in fields if NUMBER.fullmatch(field.strip())]
    # a row with missing numbers has at least half of its fields, and not fewer than the lines that begin a table
    fewest_fields = max(count / 2, min(count, _ALIKE))
    if len(numbers) < 2 or not fewest_fields <= len(fields) <= count:
        return False
    first_step = abs(numbers[1] - numbers[0])
    has_equal_steps = np.allclose(np.diff(numbers, n=2), 0.0, atol=1e-6 * first_step)
    return not has_equal_steps


def _is_comment(text: str) -> bool:
    """Return whether a line is a comment.

    A line that begins with an error value of a spreadsheet, such as "#n/a", is not a comment.
    """
    text = text.lstrip()
    if not text.startswith(COMMENT_MARKS):
        return False
    first_word = re.split(r"[;,\s]", text.lower(), maxsplit=1)[0]
    return first_word not in _UNDEFINED


def _is_number(field: str) -> bool:
    """Return whether a field contains a number or marks an undefined point."""
    try:
        float(field)
    except ValueError:
        return _is_undefined(field) or _DECIMAL_COMMA.fullmatch(field.strip()) is not None
    return True


def _is_undefined(field: str) -> bool:
    """Return whether a field marks an undefined point, such as "n/a" or "---"."""
    word = field.strip().lower()
    return word in _UNDEFINED or _PLACEHOLDER.fullmatch(word) is not None


def _find_delimiter(line: str) -> str | None:
    """Return the separator between the numbers in a line: a semicolon, a tab, a comma, or None for blanks."""
    outside_quotes = re.sub(r'"[^"]*"', "", line)
    delimiter = next((mark for mark in DELIMITERS if mark in outside_quotes), None)
    words = line.split()
    has_decimal_commas = len(words) > 1 and all(map(_DECIMAL_COMMA.fullmatch, words))
    if delimiter == "," and has_decimal_commas:
        return None
    return delimiter


def _parse_value(line_number: int, text: str, original: str) -> float:
    """Convert a field to a number, or to NaN if it marks an undefined point; raise InputError for any other text.

    original : the field in the spelling of the file, for the message.
    """
    try:
        return float(text)
    except ValueError:
        if _is_undefined(text):
            return np.nan
        expected = (
            "numbers with a decimal point, and nan or nothing for undefined points; put # before other lines, and "
            "pass what a header says as spacing= or size= and height_unit= (--spacing, --size, --height-unit)"
        )
        given = f"{original.strip()[:30]!r} in line {line_number}"
        raise InputError("file", given, expected) from None

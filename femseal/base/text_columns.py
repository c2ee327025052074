"""Read text files with named columns, either as numbers or as text.

The first line contains the names of the columns. Lines that begin with # are comments.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .errors import InputError, shortened
from .machine import within_free_memory
from .validate import Array

#: Suffixes of text files with columns.
TEXT_SUFFIXES = (".csv", ".txt")
_DELIMITERS = ",;\t"


class TextRow(NamedTuple):
    """A row of a text file: the number of its first line in the file, its text, and the text in each column."""

    number: int
    line: str
    entries: list[str]


def text_rows(file: Path, what: str = "path") -> list[TextRow]:
    """Read the rows of a text file with columns, skipping empty lines and comments (#).

    The separator of the columns is the comma, the semicolon or the tab, whichever is most frequent in the first line.
    If the first line contains no comma, semicolon or tab, the columns are separated by blanks.

    Parameters
    ----------
    file : Path
        Text file in UTF-8.
    what : str
        Name of the input, for the message.

    Returns
    -------
    list of TextRow
        One row for each line. If an entry in quotes contains line breaks, the row extends over several lines.

    Raises
    ------
    InputError
        The file cannot be read or is empty, or a column has more than 131,072 characters.
    """
    try:
        with within_free_memory():
            text = file.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError, MemoryError) as error:
        raise InputError(what, f"'{file}' ({shortened(error)})", "a text with columns") from None
    all_lines = {n: line.strip() for n, line in enumerate(text.splitlines(), 1)}
    lines = {n: line for n, line in all_lines.items() if line and line[0] != "#"}
    if not lines:
        raise InputError(what, f"'{file}', which is empty", "a text with columns")
    first_line = next(iter(lines.values()))
    delimiter = max(_DELIMITERS, key=first_line.count)
    if delimiter not in first_line:
        return [TextRow(number, line, line.split()) for number, line in lines.items()]
    numbers = list(lines)
    rows = []
    reader = csv.reader((f"{line}\n" for line in lines.values()), delimiter=delimiter)
    first = 0  # index of the first line of the row; a row with a line break inside quotes has several lines
    try:
        for entries in reader:
            end = reader.line_num  # number of lines that have been read
            text = " ".join(lines[number] for number in numbers[first:end])
            rows.append(TextRow(numbers[first], text, entries))
            first = end
    except csv.Error as error:
        given = f"'{file}' with the line {numbers[first]} ({error})"
        raise InputError(what, given, "a text with columns") from None
    return rows


def columns_of(file: Path) -> list[str]:
    """Return the names of the columns of a text file from its first line."""
    first_row = text_rows(file)[0]
    return [column.strip() for column in first_row.entries]


def read_columns(file: Path, wanted: tuple[str, ...]) -> Array:
    """Read the columns with the names `wanted` from a text file, and return an array (lines, columns).

    The first line of the file contains the names of the columns. Raises InputError if the file cannot be read, a column
    is missing or occurs twice, an entry is not a number, or a line has more entries than there are columns. The last
    error occurs if numbers have decimal commas and the columns are separated by commas.
    """
    first_row, *rows = text_rows(file)
    names = [column.strip() for column in first_row.entries]
    missing = [column for column in wanted if names.count(column) != 1]
    if missing:
        given = f"'{file}' with the columns {', '.join(names)}"
        expected = f"one column each of {', '.join(wanted)}, named in the first line: {missing[0]}"
        raise InputError("path", given, expected)
    columns = [names.index(column) for column in wanted]
    numbers = []
    for row in rows:
        try:
            numbers.append([float(row.entries[column]) for column in columns])
            if any(entry.strip() for entry in row.entries[len(names) :]):
                raise ValueError("more entries than columns")
        except (ValueError, IndexError):
            allowed = f"numbers with decimal points in the columns {', '.join(wanted)}"
            given = f"'{file}' with the line '{shortened(row.line, 60)}'"
            raise InputError("path", given, allowed) from None
    return np.reshape(numbers, (-1, len(wanted)))

"""Format tables for the terminal, notebooks, the report and files."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from textwrap import fill
from typing import Any

import numpy as np

#: Width of the first column of a grouped table in the terminal [characters].
_GROUP_WIDTH = 13


@dataclass(frozen=True)
class TextTable:
    """A table of texts, which can be shown in a terminal, a notebook or the report.

    Parameters
    ----------
    title : str
        Title above the table, "" for none.
    heads : tuple of str
        Headings of the columns; empty for a table that only lists names and values.
    lines : tuple of tuples of str
        Rows, with one text for each column.
    names : int
        Number of left-aligned columns that contain names. They are followed by right-aligned columns of numbers.
    grouped : bool
        Whether the first column contains the name of a group of rows. The terminal shows the name of each group in a
        separate line above its rows.
    notes : tuple of str
        Notes below the table.
    wrap : int
        Longest line of a heading in the terminal [characters]; longer headings are broken between words. 0: no limit.
    """

    title: str
    heads: tuple[str, ...]
    lines: tuple[tuple[str, ...], ...]
    names: int = 1
    grouped: bool = False
    notes: tuple[str, ...] = field(default=())
    wrap: int = 0

    @classmethod
    def of_columns(
        cls, title: str, columns: Iterable[tuple[str, Iterable[str]]], **options: Any
    ) -> TextTable:
        """Make a table from pairs of the heading and the texts of each column."""
        heads, texts = zip(*columns, strict=True)
        return cls(title, tuple(heads), tuple(zip(*texts, strict=True)), **options)

    def without(self, head: str) -> TextTable:
        """Return the table without the column that has a given heading."""
        remaining = [n for n, heading in enumerate(self.heads) if heading != head]
        heads = tuple(self.heads[n] for n in remaining)
        lines = tuple(tuple(line[n] for n in remaining) for line in self.lines)
        return replace(self, heads=heads, lines=lines)

    def __rich__(self) -> Any:
        """Return the table in the form that `rich.print` displays."""
        from rich.box import SIMPLE_HEAD
        from rich.console import Group
        from rich.markup import escape as plain
        from rich.table import Table
        from rich.text import Text

        table = Table(
            box=SIMPLE_HEAD,
            pad_edge=False,
            padding=(0, 1, 0, 0),
            show_header=bool(self.heads),
            caption=plain("\n".join(self.notes)) or None,
            caption_justify="left",
        )
        self._add_columns(table)
        first_column = int(self.grouped)
        previous_group = None
        for line in self.lines:
            if self.grouped and line[0] != previous_group:
                table.add_row(plain(line[0]), style="bold")
                previous_group = line[0]
            texts = [plain(text) for text in line[first_column:]]
            if self.grouped:
                texts[0] = f"{texts[0]:>{_GROUP_WIDTH - 3}}"
            table.add_row(*texts)
        if not self.title:
            return table
        # the title of a rich table is wrapped at the width of the table, so it is printed above it instead
        return Group(Text(self.title, style="table.title"), table)

    def _add_columns(self, table: Any) -> None:
        """Add the columns with their headings and alignment to a table of rich."""
        from rich.markup import escape as plain

        first_column = int(self.grouped)
        for n, head in enumerate(self.heads or self.lines[0]):
            if n < first_column:
                continue
            text = fill(head, self.wrap, break_long_words=False) if self.wrap else head
            # the names of groups are wrapped, which leaves more width to the numbers
            is_group_column = self.grouped and n == first_column
            width = _GROUP_WIDTH if is_group_column else None
            is_name = n < self.names or is_group_column
            table.add_column(
                plain(text),
                justify="left" if is_name else "right",
                overflow="fold",
                min_width=width,
                max_width=width,
            )

    def __str__(self) -> str:
        """Return the table as plain text; the width of a terminal does not limit the width of the table."""
        from rich.console import Console

        console = Console(width=1000, color_system=None)
        with console.capture() as capture:
            console.print(self)
        return "\n".join(line.rstrip() for line in capture.get().splitlines())

    def _repr_html_(self) -> str:
        """Return the table as HTML for a notebook."""
        caption = f"<caption>{escape(self.title)}</caption>\n" if self.title else ""
        head = f"<thead><tr>{_html_cells(self.heads, 'th')}</tr></thead>\n" if self.heads else ""
        body = "\n".join(f"<tr>{_html_cells(line, 'td')}</tr>" for line in self.lines)
        return f"<table>{caption}{head}<tbody>\n{body}\n</tbody></table>"


def _html_cells(texts: Iterable[str], tag: str) -> str:
    """Enclose each text in an HTML tag."""
    return "".join(f"<{tag}>{escape(text)}</{tag}>" for text in texts)


def rows_of(columns: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Convert columns to a list of rows. Each row is a dictionary with Python numbers as values.

    A column is an array (rows,), or a single value that all rows share.
    """
    arrays = [np.asarray(column) for column in columns.values()]
    lists = [array.tolist() for array in np.broadcast_arrays(*arrays)]
    return [dict(zip(columns, row, strict=True)) for row in zip(*lists, strict=True)]


def flatten(value: Any, key: str = "") -> dict[str, Any]:
    """Convert nested tables to a single table with dotted keys.

    The elements of a list get separate keys only if the list contains tables.

    >>> flatten({"load": {"loading": [1e6, 2e6]}, "face": [{"kind": "file"}]})
    {'load.loading': [1000000.0, 2000000.0], 'face.0.kind': 'file'}
    """
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        value = dict(enumerate(value))
    if not isinstance(value, dict):
        return {key: value}
    flat: dict[str, Any] = {}
    for name, item in value.items():
        flat |= flatten(item, f"{key}.{name}".removeprefix("."))
    return flat


def comma_separated(rows: Sequence[dict[str, Any]]) -> str:
    """Format rows as comma-separated values, after one line with the names of the columns.

    The list must contain at least one row, which determines the names of the columns. A missing value is an empty cell.
    A text that a spreadsheet would interpret as a formula is preceded by an apostrophe.
    """
    names = list(rows[0])
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(map(_without_formula, names))
    for row in rows:
        writer.writerow([_without_formula(row.get(name, "")) for name in names])
    return stream.getvalue()


def _without_formula(value: Any) -> Any:
    """Return the content of a cell in a form that spreadsheet programs do not interpret as a formula.

    If a text begins with a character such as "=", "@", "+" or "-" and is not a number, an apostrophe is put in front of
    it.

    >>> _without_formula("=1+2"), _without_formula("-2 um"), _without_formula("-2.5"), _without_formula(-2.5)
    ("'=1+2", "'-2 um", '-2.5', -2.5)
    """
    if not isinstance(value, str) or not value.startswith(("=", "+", "-", "@", "\t", "\r")):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value
